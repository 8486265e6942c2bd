use nalgebra::{DMatrix, DVector, SymmetricEigen};
use piola_mechanics::energy::Energy;
use piola_mechanics::matrix::BlockMatrix;
use piola_mechanics::testing::{SpringNetwork, linear, pseudo_random, softening};
use piola_mechanics::vector::norm_of;

use super::*;

const METHODS: [LinearMethod; 5] = [
    LinearMethod::Cholesky,
    LinearMethod::Ldlt,
    LinearMethod::Lu,
    LinearMethod::Cg,
    LinearMethod::Gmres,
];

pub(super) fn options(method: LinearMethod) -> LinearOptions {
    LinearOptions { method, ..LinearOptions::default() }
}

pub(super) fn tangent_at(network: &SpringNetwork, u: &[f64]) -> BlockMatrix {
    let mut tangent = BlockMatrix::zeros(network.pattern());
    network.tangent(u, &mut vec![0.0; u.len()], &mut tangent).unwrap();
    tangent
}

/// A lattice clamped at its lower x end, one more component of a further point fixed, strained.
pub(super) fn clamped(counts: &[usize], reach: f64) -> (SpringNetwork, Constraints, BlockMatrix) {
    let network = SpringNetwork::lattice(counts, reach, linear);
    let mut fixed = network.dofs_where(|x| x[0] < 0.5);
    let n_dofs = network.positions.len();
    fixed.push(n_dofs - 2);
    let constraints = Constraints::new(n_dofs, &fixed).unwrap();
    let u: Vec<f64> = pseudo_random(n_dofs, 1).iter().map(|x| 0.02 * x).collect();
    let tangent = tangent_at(&network, &u);
    (network, constraints, tangent)
}

pub(super) fn dense_free(matrix: &BlockMatrix, constraints: &Constraints) -> DMatrix<f64> {
    let n = constraints.n_dofs();
    let mut dense = DMatrix::zeros(n, n);
    for (row, column, value) in matrix.entries() {
        dense[(row, column)] = value;
    }
    dense.select_rows(constraints.free()).select_columns(constraints.free())
}

fn dense_solution(matrix: &BlockMatrix, constraints: &Constraints, rhs: &[f64]) -> Vec<f64> {
    let b = DVector::from_vec(constraints.free_part(rhs));
    let x = dense_free(matrix, constraints).lu().solve(&b).unwrap();
    let mut full = vec![0.0; rhs.len()];
    constraints.scatter_free(x.as_slice(), &mut full);
    full
}

pub(super) fn assert_close(x: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    let difference: Vec<f64> = x.iter().zip(expected).map(|(a, b)| a - b).collect();
    let error = norm_of(&difference) / norm_of(expected);
    assert!(error <= tolerance, "{what}: {error:e}");
}

#[test]
fn all_methods_agree_with_a_dense_solve() {
    for (counts, reach) in [(&[7, 6][..], 2.0), (&[5, 4, 4][..], 2.0)] {
        let (network, constraints, matrix) = clamped(counts, reach);
        let rhs = pseudo_random(constraints.n_dofs(), 2);
        let expected = dense_solution(&matrix, &constraints, &rhs);
        for method in METHODS {
            let mut solver = LinearSolver::new(
                &matrix.pattern,
                &network.positions,
                &constraints,
                options(method),
            )
            .unwrap();
            let mut x = vec![f64::NAN; rhs.len()];
            let report = solver.solve(&matrix, &rhs, &mut x).unwrap();
            assert_eq!(report.method, method, "{report:?}");
            assert_close(&x, &expected, 1e-11, method.name());
            let iterates = matches!(method, LinearMethod::Cg | LinearMethod::Gmres);
            let bar = if iterates { 2e-12 } else { 1e-14 };
            assert!(report.relative_residual <= bar, "{report:?}");
            assert_eq!(report.iterations > 0, iterates);
            let definite = match method {
                LinearMethod::Lu | LinearMethod::Gmres => None,
                _ => Some(true),
            };
            assert_eq!(report.positive_definite, definite, "{report:?}");
            assert_eq!(report.notes, Vec::<String>::new());
        }
    }
}

#[test]
fn a_second_matrix_reuses_the_symbolic_work() {
    let (network, constraints, first) = clamped(&[5, 5], 2.0);
    let second = tangent_at(&network, &vec![0.0; constraints.n_dofs()]);
    let rhs = pseudo_random(constraints.n_dofs(), 3);
    for method in METHODS {
        let mut solver =
            LinearSolver::new(&first.pattern, &network.positions, &constraints, options(method))
                .unwrap();
        let mut x = vec![0.0; rhs.len()];
        solver.solve(&first, &rhs, &mut x).unwrap();
        solver.solve(&second, &rhs, &mut x).unwrap();
        let expected = dense_solution(&second, &constraints, &rhs);
        assert_close(&x, &expected, 1e-11, method.name());
    }
}

/// Adds `shift` to the diagonal: moves the spectrum through zero.
pub(super) fn shifted(matrix: &BlockMatrix, shift: f64) -> BlockMatrix {
    let d = matrix.pattern.dimension;
    let mut shifted = matrix.clone();
    for i in 0..matrix.pattern.n_rows() {
        for a in 0..d {
            shifted.values[matrix.pattern.row_start[i] * d * d + a * d + a] += shift;
        }
    }
    shifted
}

#[test]
fn the_inertia_counts_the_negative_eigenvalues() {
    for (counts, reach) in [(&[8, 7][..], 3.0), (&[5, 4, 4][..], 2.0)] {
        let (network, constraints, matrix) = clamped(counts, reach);
        let rhs = pseudo_random(constraints.n_dofs(), 4);
        for shift in [-0.05, -0.5, -2.0, -6.0, -100.0] {
            let indefinite = shifted(&matrix, shift);
            let eigen = SymmetricEigen::new(dense_free(&indefinite, &constraints));
            let negative = eigen.eigenvalues.iter().filter(|&&x| x < 0.0).count();
            let expected = dense_solution(&indefinite, &constraints, &rhs);
            for method in [LinearMethod::Cholesky, LinearMethod::Ldlt, LinearMethod::Cg] {
                let mut solver = LinearSolver::new(
                    &matrix.pattern,
                    &network.positions,
                    &constraints,
                    options(method),
                )
                .unwrap();
                let mut x = vec![0.0; rhs.len()];
                let report = solver.solve(&indefinite, &rhs, &mut x).unwrap();
                assert_close(&x, &expected, 1e-9, &format!("{report:?} shift {shift}"));
                if negative > 0 && report.method == LinearMethod::Ldlt {
                    assert_eq!(report.negative_pivots, Some(negative), "shift {shift}");
                    assert_eq!(report.positive_definite, Some(false));
                }
                // Only conjugate gradients may miss a negative eigenvalue, and only with a warning.
                assert!(
                    negative == 0 || report.method == LinearMethod::Ldlt,
                    "shift {shift}: {report:?}"
                );
            }
        }
    }
}

#[test]
fn two_by_two_pivots_are_counted() {
    // [[0, 1], [1, 0]] on the diagonal has no 1 x 1 pivot at all: one eigenvalue of each sign.
    let pattern = BlockPattern { dimension: 2, row_start: vec![0, 1, 2], columns: vec![0, 1] };
    let pattern = Arc::new(pattern);
    let values = vec![0.0, 1.0, 1.0, 0.0, 0.0, -3.0, -3.0, 0.0];
    let matrix = BlockMatrix { pattern: Arc::clone(&pattern), values };
    let constraints = Constraints::new(4, &[]).unwrap();
    let mut solver = LinearSolver::new(
        &pattern,
        &[0.0, 0.0, 1.0, 0.0],
        &constraints,
        options(LinearMethod::Cholesky),
    )
    .unwrap();
    let mut x = vec![0.0; 4];
    let report = solver.solve(&matrix, &[1.0, 2.0, 3.0, 6.0], &mut x).unwrap();
    assert_eq!(report.negative_pivots, Some(2), "{report:?}");
    assert_eq!(x, [2.0, 1.0, -2.0, -1.0]);
    assert_eq!(report.notes, [fallback::CHOLESKY_FAILED]);
}

#[test]
fn a_singular_matrix_is_an_error() {
    let network = SpringNetwork::lattice(&[3, 1], 1.0, linear);
    // A straight chain has no stiffness across itself.
    let constraints = Constraints::new(6, &[0, 1]).unwrap();
    let matrix = tangent_at(&network, &[0.0; 6]);
    for method in METHODS {
        let mut solver =
            LinearSolver::new(&matrix.pattern, &network.positions, &constraints, options(method))
                .unwrap();
        let error = solver.solve(&matrix, &[1.0; 6], &mut [0.0; 6]).unwrap_err();
        assert_eq!(error, LinearError::Singular { free: 4 }, "{}", method.name());
    }
}

#[test]
fn not_a_number_and_too_large_are_errors() {
    let (network, constraints, mut matrix) = clamped(&[4, 4], 2.0);
    let refused = LinearOptions { memory_limit: 100.0, ..options(LinearMethod::Ldlt) };
    let error = LinearSolver::new(&matrix.pattern, &network.positions, &constraints, refused)
        .err()
        .unwrap();
    assert!(matches!(error, LinearError::TooLarge { .. }), "{error}");
    let automatic = LinearOptions { memory_limit: 100.0, ..options(LinearMethod::Auto) };
    let solver =
        LinearSolver::new(&matrix.pattern, &network.positions, &constraints, automatic).unwrap();
    assert_eq!(solver.method(), LinearMethod::MatrixFree);
    let mut solver = LinearSolver::new(
        &matrix.pattern,
        &network.positions,
        &constraints,
        options(LinearMethod::Auto),
    )
    .unwrap();
    let mut x = vec![0.0; constraints.n_dofs()];
    let error = solver.solve(&matrix, &vec![f64::NAN; x.len()], &mut x).unwrap_err();
    assert_eq!(error, LinearError::NotFinite { what: "residual" });
    matrix.values[0] = f64::INFINITY;
    let error = solver.solve(&matrix, &vec![1.0; x.len()], &mut x).unwrap_err();
    assert_eq!(error, LinearError::NotFinite { what: "tangent stiffness" });
}

#[test]
fn the_condition_is_that_of_the_dense_inverse() {
    let norm = |matrix: &DMatrix<f64>| {
        matrix.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max)
    };
    for (counts, shift) in [(&[7, 6][..], 0.0), (&[5, 4, 4][..], 0.0), (&[7, 6][..], -0.5)] {
        let (network, constraints, matrix) = clamped(counts, 2.0);
        let matrix = shifted(&matrix, shift);
        let dense = dense_free(&matrix, &constraints);
        let expected = norm(&dense) * norm(&dense.clone().try_inverse().unwrap());
        let mut solver = LinearSolver::new(
            &matrix.pattern,
            &network.positions,
            &constraints,
            LinearOptions::default(),
        )
        .unwrap();
        solver.factorize(&matrix).unwrap();
        let found = solver.condition(&matrix).unwrap().unwrap();
        assert!((0.5..=1.0 + 1e-10).contains(&(found / expected)), "{found:e} {expected:e}");
    }
}

#[test]
fn extreme_scales_change_nothing_but_the_scale() {
    let (network, constraints, matrix) = clamped(&[5, 4], 2.0);
    let rhs = pseudo_random(constraints.n_dofs(), 5);
    let expected = dense_solution(&matrix, &constraints, &rhs);
    for (stiffness, load) in [(1e100, 1e-60), (1e-100, 1e-160), (1.0, 1e-170)] {
        let mut scaled = matrix.clone();
        scaled.values.iter_mut().for_each(|x| *x *= stiffness);
        let loads: Vec<f64> = rhs.iter().map(|x| x * load).collect();
        for method in METHODS {
            let mut solver = LinearSolver::new(
                &matrix.pattern,
                &network.positions,
                &constraints,
                options(method),
            )
            .unwrap();
            let mut x = vec![0.0; rhs.len()];
            solver.solve(&scaled, &loads, &mut x).unwrap();
            x.iter_mut().for_each(|x| *x = *x / load * stiffness);
            assert_close(&x, &expected, 1e-11, method.name());
        }
    }
}

#[test]
fn nothing_free_is_solved_at_once() {
    let network = SpringNetwork::lattice(&[2, 2], 1.5, linear);
    let constraints = Constraints::new(8, &[0, 1, 2, 3, 4, 5, 6, 7]).unwrap();
    let matrix = tangent_at(&network, &[0.0; 8]);
    for method in METHODS {
        let mut solver =
            LinearSolver::new(&matrix.pattern, &network.positions, &constraints, options(method))
                .unwrap();
        let mut x = [f64::NAN; 8];
        let report = solver.solve(&matrix, &[1.0; 8], &mut x).unwrap();
        assert_eq!((x, report.relative_residual), ([0.0; 8], 0.0), "{}", method.name());
    }
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let (network, constraints, matrix) = clamped(&[9, 8, 8], 2.0);
    let indefinite = shifted(&matrix, -0.5);
    let rhs = pseudo_random(constraints.n_dofs(), 6);
    for method in METHODS {
        let runs: Vec<Vec<u64>> = [1, 2, 4]
            .iter()
            .map(|&threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let mut bits = Vec::new();
                    let mut solver = LinearSolver::new(
                        &matrix.pattern,
                        &network.positions,
                        &constraints,
                        options(method),
                    )
                    .unwrap();
                    for k in [&matrix, &indefinite] {
                        let mut x = vec![0.0; rhs.len()];
                        solver.solve(k, &rhs, &mut x).unwrap();
                        bits.extend(x.iter().map(|x| x.to_bits()));
                    }
                    bits
                })
            })
            .collect();
        assert!(runs[0] == runs[1] && runs[1] == runs[2], "{}", method.name());
    }
}

#[test]
fn the_estimate_bounds_the_fill_and_decides() {
    let (network, constraints, matrix) = clamped(&[14, 13], 3.0);
    let mut solver = LinearSolver::new(
        &matrix.pattern,
        &network.positions,
        &constraints,
        options(LinearMethod::Auto),
    )
    .unwrap();
    assert_eq!(solver.method(), LinearMethod::Cholesky);
    let rhs = vec![1.0; constraints.n_dofs()];
    let report = solver.solve(&matrix, &rhs, &mut vec![0.0; rhs.len()]).unwrap();
    let (stored, estimated) =
        (report.factor_nonzeros.unwrap() as f64, solver.estimate().unwrap().factor_nonzeros);
    // Supernodes store the upper triangles of their diagonal blocks and some zeros besides.
    assert!((0.7..1.6).contains(&(stored / estimated)), "{stored} {estimated}");
    let dense = constraints.n_free() as f64;
    assert!(solver.estimate().unwrap().operations < dense * dense * dense / 3.0);
}

#[test]
fn judging_leaves_factors_that_solve() {
    let (network, constraints, matrix) = clamped(&[6, 6], 2.0);
    let rhs = pseudo_random(constraints.n_dofs(), 7);
    let mut solver = LinearSolver::new(
        &matrix.pattern,
        &network.positions,
        &constraints,
        options(LinearMethod::Auto),
    )
    .unwrap();
    let definiteness = solver.judge(&matrix).unwrap();
    assert_eq!(definiteness.positive_definite, Some(true));
    assert_eq!(definiteness.method, "Cholesky");
    let mut x = vec![0.0; rhs.len()];
    solver.solve_factorized(&matrix, &rhs, &mut x).unwrap();
    assert_eq!(solver.n_factorizations(), 1);
    assert_close(&x, &dense_solution(&matrix, &constraints, &rhs), 1e-12, "after judging");
    let definiteness = solver.judge(&shifted(&matrix, -0.5)).unwrap();
    assert_eq!(definiteness.positive_definite, Some(false));
    assert!(definiteness.negative_pivots.unwrap() > 0);
}

#[test]
fn springs_beyond_their_peak_are_indefinite() {
    // Two springs in series, both beyond the peak: one negative eigenvalue, the transverse one is
    // held by the tension.
    let network = SpringNetwork::lattice(&[3, 1], 1.0, softening);
    let matrix = tangent_at(&network, &[0.0, 0.0, 0.2, 0.0, 0.4, 0.0]);
    let constraints = Constraints::new(6, &[0, 1, 4, 5]).unwrap();
    let mut solver = LinearSolver::new(
        &matrix.pattern,
        &network.positions,
        &constraints,
        LinearOptions::default(),
    )
    .unwrap();
    let report = solver.solve(&matrix, &[1.0; 6], &mut [0.0; 6]).unwrap();
    assert_eq!(report.negative_pivots, Some(1), "{report:?}");
}
