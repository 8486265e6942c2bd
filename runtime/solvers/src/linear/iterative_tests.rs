//! Conjugate gradients, their preconditioners and what they say of the tangent.

use nalgebra::{DMatrix, SymmetricEigen};
use piola_mechanics::energy::Energy;
use piola_mechanics::matrix::BlockMatrix;
use piola_mechanics::testing::{SpringNetwork, linear, pseudo_random};
use piola_mechanics::vector::norm_of;

use super::tests::{assert_close, clamped, dense_free, options, shifted, tangent_at};
use super::*;

const CHOICES: [PreconditionerChoice; 2] =
    [PreconditionerChoice::BlockJacobi, PreconditionerChoice::TwoLevel];

fn iterating(
    network: &SpringNetwork,
    constraints: &Constraints,
    preconditioner: PreconditionerChoice,
) -> LinearSolver {
    let options = LinearOptions { preconditioner, ..options(LinearMethod::Cg) };
    LinearSolver::new(network.pattern(), &network.positions, constraints, options).unwrap()
}

/// A direct solver's answer.
fn expected(network: &SpringNetwork, constraints: &Constraints, k: &BlockMatrix) -> Vec<f64> {
    let options = options(LinearMethod::Cholesky);
    let mut solver =
        LinearSolver::new(network.pattern(), &network.positions, constraints, options).unwrap();
    let mut x = vec![0.0; constraints.n_dofs()];
    solver.solve(k, &pseudo_random(x.len(), 2), &mut x).unwrap();
    x
}

#[test]
fn two_levels_need_fewer_iterations_and_no_more_in_larger_bodies() {
    let mut counts = Vec::new();
    for side in [[24, 8, 8], [60, 8, 8]] {
        let network = SpringNetwork::lattice(&side, 2.0, linear);
        let fixed = network.dofs_where(|x| x[0] < 0.5);
        let constraints = Constraints::new(network.positions.len(), &fixed).unwrap();
        let k = tangent_at(&network, &vec![0.0; network.positions.len()]);
        let reference = expected(&network, &constraints, &k);
        for choice in CHOICES {
            let mut solver = iterating(&network, &constraints, choice);
            let mut x = vec![0.0; reference.len()];
            let report = solver.solve(&k, &pseudo_random(x.len(), 2), &mut x).unwrap();
            assert_close(&x, &reference, 1e-9, "iterations");
            assert_eq!(report.notes, Vec::<String>::new());
            counts.push(report.iterations);
        }
    }
    let [short_jacobi, short, long_jacobi, long] = counts[..] else { panic!("{counts:?}") };
    assert!(3 * short < short_jacobi && 5 * long < long_jacobi, "{counts:?}");
    assert!(2 * long < 3 * short, "{counts:?}");
}

/// A penalty on the change of area, or volume, of every unit cell: what makes a body nearly
/// incompressible.
fn stiffen_cells(network: &SpringNetwork, k: &mut BlockMatrix, counts: &[usize], stiffness: f64) {
    let d = counts.len();
    let n: usize = counts.iter().product();
    let stride: Vec<usize> = (0..d).map(|a| counts[a + 1..].iter().product()).collect();
    let corners = 1usize << d;
    for origin in 0..n {
        if (0..d).any(|a| origin / stride[a] % counts[a] == counts[a] - 1) {
            continue;
        }
        // The divergence: half (a quarter) of the differences along the edges.
        let mut gradient = Vec::new();
        for corner in 0..corners {
            let point: usize =
                origin + (0..d).map(|a| (corner >> a & 1) * stride[a]).sum::<usize>();
            for a in 0..d {
                let sign = if corner >> a & 1 == 1 { 1.0 } else { -1.0 };
                gradient.push((point, a, sign * 2.0 / corners as f64));
            }
        }
        for &(i, a, p) in &gradient {
            for &(j, b, q) in gradient.iter().filter(|(j, _, _)| *j >= i) {
                let pattern = network.pattern();
                let row = &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]];
                let place = pattern.row_start[i] + row.binary_search(&(j as u32)).unwrap();
                k.values[place * d * d + a * d + b] += stiffness * p * q;
            }
        }
    }
}

/// Rigid motions alone as coarse functions would lock: the uniform strains make the difference.
#[test]
fn a_nearly_incompressible_body_converges() {
    let counts = [14, 9, 9];
    let network = SpringNetwork::lattice(&counts, 2.0, linear);
    let fixed = network.dofs_where(|x| x[0] < 0.5);
    let constraints = Constraints::new(network.positions.len(), &fixed).unwrap();
    let mut k = tangent_at(&network, &vec![0.0; network.positions.len()]);
    stiffen_cells(&network, &mut k, &counts, 100.0);
    let reference = expected(&network, &constraints, &k);
    let iterations = CHOICES.map(|choice| {
        let mut solver = iterating(&network, &constraints, choice);
        let mut x = vec![0.0; reference.len()];
        let report = solver.solve(&k, &pseudo_random(x.len(), 2), &mut x).unwrap();
        assert_eq!(report.method, LinearMethod::Cg);
        assert_close(&x, &reference, 1e-8, "iterations");
        report.iterations
    });
    assert!(2 * iterations[1] < iterations[0], "{iterations:?}");
}

/// The preconditioned matrix has the eigenvalues of `L^T K L`, `M^-1 = L L^T`.
fn preconditioned_spectrum(k: &DMatrix<f64>, d: usize) -> (f64, f64) {
    let n = k.nrows();
    let mut l = DMatrix::zeros(n, n);
    for start in (0..n).step_by(d) {
        let inverse = k.view((start, start), (d, d)).clone_owned().try_inverse().unwrap();
        l.view_mut((start, start), (d, d)).copy_from(&inverse.cholesky().unwrap().l());
    }
    let eigenvalues = SymmetricEigen::new(l.transpose() * k * l).eigenvalues;
    (eigenvalues.min(), eigenvalues.max())
}

#[test]
fn ritz_values_are_the_ends_of_the_spectrum() {
    for (counts, reach) in [(&[9, 6][..], 2.0), (&[6, 4, 4][..], 2.0)] {
        let network = SpringNetwork::lattice(counts, reach, linear);
        let fixed = network.dofs_where(|x| x[0] < 0.5);
        let constraints = Constraints::new(network.positions.len(), &fixed).unwrap();
        let k = tangent_at(&network, &vec![0.0; network.positions.len()]);
        let (low, high) = preconditioned_spectrum(&dense_free(&k, &constraints), counts.len());
        let mut solver = iterating(&network, &constraints, PreconditionerChoice::BlockJacobi);
        let mut x = vec![0.0; network.positions.len()];
        let report = solver.solve(&k, &pseudo_random(x.len(), 3), &mut x).unwrap();
        let ritz = report.ritz.unwrap();
        assert!((ritz.smallest / low - 1.0).abs() < 1e-6, "{ritz:?} {low}");
        assert!((ritz.largest / high - 1.0).abs() < 1e-6, "{ritz:?} {high}");
        assert!((ritz.condition() * low / high - 1.0).abs() < 1e-5);
    }
}

#[test]
fn the_condition_by_conjugate_gradients_is_that_of_the_dense_inverse() {
    let norm = |matrix: &DMatrix<f64>| {
        matrix.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max)
    };
    for (counts, reach) in [(&[12, 6][..], 2.0), (&[9, 4, 4][..], 2.0), (&[30, 3][..], 1.5)] {
        let (network, constraints, matrix) = clamped(counts, reach);
        let dense = dense_free(&matrix, &constraints);
        let expected = norm(&dense) * norm(&dense.clone().try_inverse().unwrap());
        for choice in CHOICES {
            let mut solver = iterating(&network, &constraints, choice);
            assert_eq!(solver.factorize(&matrix), Ok(()));
            assert_eq!(solver.condition(&matrix), Ok(None), "nothing was seen yet");
            let judged = solver.judge(&matrix).unwrap();
            assert_eq!(judged.positive_definite, Some(true), "{judged:?}");
            assert!(judged.method.starts_with("conjugate gradients: "), "{judged:?}");
            assert!(judged.method.contains("all positive"), "{judged:?}");
            let found = solver.condition(&matrix).unwrap().unwrap();
            assert!((0.3..=1.02).contains(&(found / expected)), "{found:e} {expected:e}");
        }
    }
}

/// However little negative the smallest eigenvalue is, the judgement sees it.
#[test]
fn a_negative_eigenvalue_is_seen_by_the_judgement() {
    let (network, constraints, matrix) = clamped(&[9, 5, 5], 2.0);
    let eigenvalues = SymmetricEigen::new(dense_free(&matrix, &constraints)).eigenvalues;
    let (low, high) = (eigenvalues.min(), eigenvalues.max());
    for choice in CHOICES {
        for (shift, definite) in
            [(0.999, true), (1.001, false), (1.1, false), (0.3 * high / low, false)]
        {
            let k = shifted(&matrix, -shift * low);
            let mut solver = iterating(&network, &constraints, choice);
            let judged = solver.judge(&k).unwrap();
            assert_eq!(judged.positive_definite, Some(definite), "{shift} {judged:?}");
            let negative = eigenvalues.iter().filter(|&&x| x < shift * low).count();
            if !definite {
                assert_eq!(judged.negative_pivots, Some(negative), "{judged:?}");
            }
        }
    }
}

#[test]
fn indefinite_and_too_large_to_factorise_is_solved_by_minimum_residuals() {
    for (counts, shift) in [(&[9, 8][..], -0.5), (&[7, 4, 4][..], -0.5), (&[7, 4, 4][..], -5.0)] {
        let (network, constraints, matrix) = clamped(counts, 2.0);
        let k = shifted(&matrix, shift);
        let rhs = pseudo_random(constraints.n_dofs(), 4);
        let options = LinearOptions { memory_limit: 1.0, ..options(LinearMethod::Cg) };
        let mut solver =
            LinearSolver::new(&k.pattern, &network.positions, &constraints, options).unwrap();
        let mut x = vec![0.0; rhs.len()];
        let report = solver.solve(&k, &rhs, &mut x).unwrap();
        assert_eq!(report.method, LinearMethod::MinimumResidual, "{report:?}");
        assert!(report.relative_residual <= 1e-12, "{report:?}");
        assert_eq!((report.positive_definite, report.negative_pivots), (Some(false), None));
        assert_eq!(report.notes.len(), 1, "{report:?}");
        let reference = LinearSolver::new(
            &k.pattern,
            &network.positions,
            &constraints,
            super::tests::options(LinearMethod::Ldlt),
        );
        let mut expected = vec![0.0; rhs.len()];
        reference.unwrap().solve(&k, &rhs, &mut expected).unwrap();
        assert_close(&x, &expected, 1e-8, "minimum residuals");
        assert_eq!(solver.condition(&k), Ok(None));
    }
}

#[test]
fn auto_goes_over_to_cholesky_where_iterations_cost_more() {
    let (network, constraints, matrix) = clamped(&[12, 9], 2.0);
    let rhs = pseudo_random(constraints.n_dofs(), 5);
    let mut solver = LinearSolver::new(
        &matrix.pattern,
        &network.positions,
        &constraints,
        LinearOptions::default(),
    )
    .unwrap();
    solver.choice = Choice::new(LinearMethod::Cg, "");
    solver.limits.max_iterations = 3;
    let mut x = vec![0.0; rhs.len()];
    let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
    assert_eq!((report.method, report.iterations), (LinearMethod::Cholesky, 3));
    assert_eq!(solver.method(), LinearMethod::Cholesky);
    assert!(solver.choice().reason.contains("did not converge in 3 iterations"));
    assert_eq!(solver.solve(&matrix, &rhs, &mut x).unwrap().iterations, 0);
}

#[test]
fn a_tangent_that_is_not_stored_gives_the_same_solution() {
    for counts in [&[9, 6][..], &[6, 4, 4][..]] {
        let network = SpringNetwork::lattice(counts, 2.0, linear);
        let n = network.positions.len();
        let constraints = Constraints::new(n, &network.dofs_where(|x| x[0] < 0.5)).unwrap();
        let u: Vec<f64> = pseudo_random(n, 1).iter().map(|x| 0.02 * x).collect();
        let k = tangent_at(&network, &u);
        let mut diagonal = vec![0.0; n * counts.len()];
        network.tangent_diagonal(&u, &mut vec![0.0; n], &mut diagonal).unwrap();
        let options = options(LinearMethod::MatrixFree);
        let mut solver =
            LinearSolver::new(network.pattern(), &network.positions, &constraints, options)
                .unwrap();
        let rhs = pseudo_random(n, 2);
        let hessian = network.hessian(&u).unwrap();
        let free = Tangent::MatrixFree { hessian: &*hessian, diagonal: &diagonal };
        let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
        let report = solver.solve(free, &rhs, &mut x).unwrap();
        assert_eq!(report.method, LinearMethod::MatrixFree);
        assert_eq!(solver.preconditioner().unwrap(), "block Jacobi");
        let mut stored = iterating(&network, &constraints, PreconditionerChoice::BlockJacobi);
        let again = stored.solve(&k, &rhs, &mut y).unwrap();
        assert_eq!(report.iterations, again.iterations);
        assert_close(&x, &y, 1e-12, "matrix-free");
        assert_eq!(solver.judge(free).unwrap().positive_definite, Some(true));
        let condition = solver.condition(free).unwrap().unwrap();
        stored.judge(&k).unwrap();
        let expected = stored.condition(&k).unwrap().unwrap();
        assert!((0.5..2.0).contains(&(condition / expected)), "{condition:e} {expected:e}");
    }
}

#[test]
fn looser_tolerances_take_fewer_iterations() {
    let (network, constraints, matrix) = clamped(&[16, 5, 5], 2.0);
    let rhs = pseudo_random(constraints.n_dofs(), 6);
    let mut before = usize::MAX;
    for tolerance in [1e-12, 1e-8, 1e-4, 1e-1] {
        let mut solver = iterating(&network, &constraints, PreconditionerChoice::Auto);
        solver.set_tolerance(tolerance);
        let report = solver.solve(&matrix, &rhs, &mut vec![0.0; rhs.len()]).unwrap();
        assert!(report.relative_residual <= 2.0 * tolerance, "{report:?}");
        assert!(report.iterations < before, "{report:?}");
        before = report.iterations;
    }
}

#[test]
fn gmres_solve_indefinite_systems_too_and_see_no_signs() {
    let (network, constraints, definite) = clamped(&[12, 8, 8], 2.0);
    let n = constraints.n_dofs();
    let rhs = pseudo_random(n, 2);
    // Restarts end above the tolerance where the matrix is indefinite, and say so.
    let cases = [(definite.clone(), 2e-12, 1e-9), (shifted(&definite, -0.5), 1e-3, 1e-2)];
    for (matrix, residual, error) in cases {
        let mut direct = vec![0.0; n];
        let new = |options| {
            LinearSolver::new(network.pattern(), &network.positions, &constraints, options).unwrap()
        };
        new(options(LinearMethod::Ldlt)).solve(&matrix, &rhs, &mut direct).unwrap();
        for preconditioner in CHOICES {
            let chosen = LinearOptions { preconditioner, ..options(LinearMethod::Gmres) };
            let mut solver = new(chosen);
            let mut x = vec![0.0; n];
            let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
            assert_eq!(report.method, LinearMethod::Gmres, "{report:?}");
            println!("{preconditioner:?}: {}, {:e}", report.iterations, report.relative_residual);
            assert!(report.relative_residual <= residual, "{report:?}");
            assert_close(&x, &direct, error, "GMRES");
            let product = constraints.free_part(&matrix.multiply(&x));
            let left: Vec<f64> =
                product.iter().zip(constraints.free_part(&rhs)).map(|(p, b)| p - b).collect();
            let left = norm_of(&left) / norm_of(&constraints.free_part(&rhs));
            assert!((left - report.relative_residual).abs() <= 1e-3 * left + 1e-14, "{left:e}");
            assert_eq!((report.positive_definite, report.negative_pivots), (None, None));
            let judged = solver.judge(&matrix).unwrap();
            assert_eq!((judged.positive_definite, judged.negative_pivots), (None, None));
            assert!(judged.method.starts_with("GMRES: signs unknown"), "{}", judged.method);
            assert_eq!(solver.condition(&matrix).unwrap(), None);
            assert_eq!(solver.n_factorizations(), 0);
        }
    }
}

#[test]
fn where_gmres_fail_a_factorisation_takes_over() {
    let (network, constraints, matrix) = clamped(&[12, 8, 8], 2.0);
    let rhs = pseudo_random(constraints.n_dofs(), 2);
    for (k, expected) in
        [(matrix.clone(), LinearMethod::Cholesky), (shifted(&matrix, -0.5), LinearMethod::Ldlt)]
    {
        let options = options(LinearMethod::Gmres);
        let mut solver =
            LinearSolver::new(network.pattern(), &network.positions, &constraints, options)
                .unwrap();
        solver.limits.max_iterations = 3;
        let mut x = vec![0.0; rhs.len()];
        let report = solver.solve(&k, &rhs, &mut x).unwrap();
        assert_eq!((report.method, report.iterations), (expected, 3));
        let noted = |note: &String| note == "GMRES did not converge in 3 iterations";
        assert!(report.notes.iter().any(noted), "{:?}", report.notes);
        assert!(report.relative_residual < 1e-13);
        // The next matrix is solved by GMRES again.
        solver.limits.max_iterations = 1000;
        let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
        assert_eq!(report.method, LinearMethod::Gmres, "{report:?}");
    }
}
