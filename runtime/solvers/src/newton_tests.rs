use piola_mechanics::testing::{SpringNetwork, linear, logarithmic, softening};

use super::*;
use crate::linear::LinearMethod;

fn newton<'a>(network: &'a SpringNetwork, fixed: &[usize], tolerance: f64) -> Newton<'a> {
    let constraints = Constraints::new(network.positions.len(), fixed).unwrap();
    let settings = NewtonSettings { tolerance, ..NewtonSettings::default() };
    Newton::new(network, &constraints, settings, LinearOptions::default()).unwrap()
}

/// A lattice held at both x ends, the upper end moved by `stretch` times its distance and sheared.
fn pulled(counts: &[usize], stretch: f64) -> (SpringNetwork, Vec<usize>, Vec<f64>) {
    let network = SpringNetwork::lattice(counts, 2.0, linear);
    let d = counts.len();
    let end = (counts[0] - 1) as f64;
    let fixed = network.dofs_where(|x| x[0] == 0.0 || x[0] == end);
    let mut u = vec![0.0; network.positions.len()];
    for &dof in fixed.iter().filter(|&&dof| network.position(dof / d)[0] == end) {
        u[dof] = end * stretch * if dof % d == 0 { 1.0 } else { 0.3 };
    }
    (network, fixed, u)
}

#[test]
fn convergence_is_quadratic_with_full_steps() {
    for counts in [&[6, 6][..], &[5, 4, 4][..]] {
        let (network, fixed, mut u) = pulled(counts, 0.3);
        let loads = vec![0.0; u.len()];
        let report = newton(&network, &fixed, 1e-13).solve(&mut u, &loads).unwrap();
        assert!(report.step_lengths.iter().all(|&s| s == 1.0), "{:?}", report.step_lengths);
        let r = &report.history.residual_over_reaction;
        let mut compared = 0;
        for k in 0..r.len() - 1 {
            // Below 1e-8 the square is under the rounding floor.
            if r[k] < 0.3 && r[k] > 1e-7 {
                assert!(r[k + 1] <= 2.0 * r[k] * r[k], "{r:?}");
                compared += 1;
            }
        }
        assert!(compared >= 2, "{r:?}");
        assert!(*r.last().unwrap() <= 1e-13);
    }
}

#[test]
fn the_floor_of_the_residual_is_rounding_at_any_strain() {
    for stretch in [1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-100] {
        let (network, fixed, mut u) = pulled(&[8, 7], stretch);
        let loads = vec![0.0; u.len()];
        let report = newton(&network, &fixed, 1e-14).solve(&mut u, &loads).unwrap();
        let last = *report.history.residual_over_reaction.last().unwrap();
        assert!(last <= 1e-14, "strain {stretch:e}: {last:e}");
        assert!(report.iterations <= 6, "strain {stretch:e}: {:?}", report.history);
    }
}

#[test]
fn the_tolerance_is_relative_to_the_larger_of_reactions_and_loads() {
    for (pull, load) in [(0.2, 0.0), (0.0, 0.05), (0.2, 0.5)] {
        let (network, fixed, start) = pulled(&[6, 5], pull);
        let mut loads = vec![0.0; start.len()];
        for &dof in network.dofs_where(|x| x[0] == 3.0).iter().step_by(2) {
            loads[dof] = load;
        }
        for tolerance in [1e-2, 1e-5, 1e-12] {
            let mut u = start.clone();
            let mut solver = newton(&network, &fixed, tolerance);
            let history = solver.solve(&mut u, &loads).unwrap().history;
            let ratios = &history.residual_over_reaction;
            let (last, rest) = ratios.split_last().unwrap();
            assert!(*last <= tolerance && rest.iter().all(|&r| r > tolerance), "{ratios:?}");
            let mut gradient = vec![0.0; u.len()];
            network.forces(&u, &mut gradient).unwrap();
            assert_eq!(gradient, solver.internal_forces());
            let reaction: Vec<f64> = fixed.iter().map(|&dof| gradient[dof] - loads[dof]).collect();
            let scale = norm_of(&reaction).max(norm_of(&loads));
            assert_eq!(*last, history.residual.last().unwrap() / scale);
        }
    }
}

/// A chain of `n` springs along x with its lateral displacements held.
fn chain(n: usize, law: fn(f64, f64) -> (f64, f64, f64)) -> (SpringNetwork, Vec<usize>) {
    let network = SpringNetwork::lattice(&[n + 1, 1], 1.0, law);
    let fixed = (0..2 * (n + 1)).filter(|dof| *dof == 0 || dof % 2 == 1).collect();
    (network, fixed)
}

#[test]
fn a_chain_under_a_load_has_the_analytic_stretch() {
    // psi' = ln(s)/s = f at every spring.
    let (network, fixed) = chain(10, logarithmic);
    for stretch in [0.7, 1.0 + 1e-9, 1.3, 2.0] {
        let mut loads = vec![0.0; 22];
        loads[20] = libm::log1p(stretch - 1.0) / stretch;
        let mut u = vec![0.0; 22];
        let mut solver = newton(&network, &fixed, 1e-13);
        let report = solver.solve(&mut u, &loads).unwrap();
        for point in 0..11 {
            let expected = (stretch - 1.0) * point as f64;
            let error = (u[2 * point] - expected).abs();
            assert!(error <= 1e-11 * (stretch - 1.0).abs() * 10.0, "{stretch}: {error:e}");
        }
        // The reaction carries the load.
        assert!((solver.internal_forces()[0] + loads[20]).abs() <= 1e-12 * loads[20].abs());
        let ln = libm::log1p(stretch - 1.0);
        assert!((report.energy.total() / (10.0 * 0.5 * ln * ln) - 1.0).abs() < 1e-10);
    }
}

#[test]
fn steps_that_overshoot_are_shortened() {
    // Compressed by 60 % at once: the full step crosses into energies that are not finite.
    let (network, mut fixed) = chain(4, logarithmic);
    fixed.push(8);
    fixed.sort_unstable();
    let mut u = vec![0.0; 10];
    (u[2], u[4], u[6], u[8]) = (-0.1, 0.2, -0.3, -1.1);
    let report = newton(&network, &fixed, 1e-12).solve(&mut u, &[0.0; 10]).unwrap();
    for point in 1..4 {
        assert!((u[2 * point] + 0.275 * point as f64).abs() < 1e-11, "{u:?}");
    }
    // Softening springs far beyond the peak: the potential keeps the search from running away.
    let (network, fixed) = chain(1, softening);
    let mut u = vec![0.0; 4];
    let load = [0.0, 0.0, 0.99 * PEAK_FORCE, 0.0];
    let shortened = newton(&network, &fixed, 1e-12).solve(&mut u, &load).unwrap();
    assert!(u[2] > 0.08 && u[2] < 0.1, "{u:?}");
    assert!(report.iterations + shortened.iterations > 4);
}

/// `PEAK exp(-1)`: the most a softening spring carries.
const PEAK_FORCE: f64 = 0.1 * 0.367_879_441_171_442_33;

#[test]
fn a_load_beyond_the_peak_has_no_equilibrium() {
    let (network, fixed) = chain(1, softening);
    let load = [0.0, 0.0, 1.05 * PEAK_FORCE, 0.0];
    let error = newton(&network, &fixed, 1e-12).solve(&mut [0.0; 4], &load).unwrap_err();
    assert!(
        matches!(
            error.failure,
            NewtonFailure::LineSearch { .. } | NewtonFailure::Iterations { .. }
        ),
        "{error}"
    );
    assert!(error.history.residual.len() > 2, "{error:?}");
}

#[test]
fn a_tolerance_below_rounding_is_a_typed_error() {
    let (network, fixed, mut u) = pulled(&[8, 7], 0.1);
    let loads = vec![0.0; u.len()];
    let error = newton(&network, &fixed, 1e-18).solve(&mut u, &loads).unwrap_err();
    let NewtonFailure::RoundingFloor { residual, floor, .. } = error.failure else {
        panic!("{error}")
    };
    assert!(residual <= floor);
    let ratios = &error.history.residual_over_reaction;
    assert!(*ratios.last().unwrap() < 1e-14, "{ratios:?}");
    assert!(error.to_string().contains("rounding floor"), "{error}");
}

#[test]
fn rigid_motions_of_the_fixed_points_need_no_forces() {
    let network = SpringNetwork::lattice(&[6, 5], 2.0, linear);
    let fixed = network.dofs_where(|x| x[0] == 0.0);
    let (sin, cos) = (libm::sin(0.2), libm::cos(0.2));
    for turn in [false, true] {
        let mut u = vec![0.0; 60];
        let moved = |x: &[f64]| match turn {
            false => [0.3, -0.1],
            true => [cos * x[0] - sin * x[1] - x[0], sin * x[0] + cos * x[1] - x[1]],
        };
        for &dof in &fixed {
            u[dof] = moved(network.position(dof / 2))[dof % 2];
        }
        let report = newton(&network, &fixed, 1e-10).solve(&mut u, &[0.0; 60]).unwrap();
        for dof in 0..60 {
            assert!((u[dof] - moved(network.position(dof / 2))[dof % 2]).abs() < 1e-12);
        }
        assert!(report.energy.total() < 1e-26);
        // Either rounding spared every bond, or it is said why the state counts as converged.
        let exact = report.history.residual.last() == Some(&0.0);
        assert_eq!(report.notes.is_empty(), exact, "{:?}", report.history);
        assert!(!(exact && turn), "a rotation by 0.2 is not free of rounding");
    }
}

#[test]
fn at_rest_nothing_is_solved() {
    let (network, fixed, mut u) = pulled(&[5, 5], 0.0);
    let report = newton(&network, &fixed, 1e-10).solve(&mut u, &[0.0; 50]).unwrap();
    assert_eq!((report.iterations, report.history.residual), (0, vec![0.0]));
}

#[test]
fn an_energy_that_is_not_finite_at_the_start_is_named() {
    let (network, mut fixed) = chain(3, logarithmic);
    fixed.push(6);
    fixed.sort_unstable();
    let mut u = vec![0.0; 8];
    u[6] = -0.9;
    let error = newton(&network, &fixed, 1e-10).solve(&mut u, &[0.0; 8]).unwrap_err();
    let NewtonFailure::NonFinite(not_finite) = error.failure else { panic!("{error}") };
    assert_eq!(not_finite.points, [2, 3]);
}

#[test]
fn the_limit_of_iterations_is_kept() {
    let (network, fixed, mut u) = pulled(&[5, 5], 0.3);
    let mut solver = newton(&network, &fixed, 1e-12);
    solver.settings.max_iterations = 2;
    let error = solver.solve(&mut u, &[0.0; 50]).unwrap_err();
    assert_eq!(error.failure, NewtonFailure::Iterations { limit: 2 });
    assert_eq!(error.history.residual.len(), 3);
}

#[test]
fn the_judged_tangent_and_its_factors_serve_the_next_load() {
    let network = SpringNetwork::lattice(&[6, 5], 2.0, linear);
    let fixed = network.dofs_where(|x| x[0] == 0.0);
    let mut solver = newton(&network, &fixed, 1e-11);
    let mut u = vec![0.0; 60];
    let mut loads = vec![0.0; 60];
    let mut evaluations = 1;
    for load in [1e-3, 2e-3, 3e-3] {
        loads[58] = load;
        let before = solver.counters();
        let report = solver.solve(&mut u, &loads).unwrap();
        let definiteness = solver.judge().unwrap();
        assert_eq!(definiteness.positive_definite, Some(true));
        let after = solver.counters();
        // One tangent and one factorisation per iteration, once one more of the state at rest.
        evaluations += report.iterations;
        assert_eq!(after.tangents, evaluations);
        assert_eq!(after.factorizations, evaluations);
        assert_eq!(after.linear_solves - before.linear_solves, report.iterations);
    }
}

#[test]
fn every_method_finds_the_same_state_with_the_same_bits_for_any_threads() {
    let methods = [LinearMethod::Cholesky, LinearMethod::Ldlt, LinearMethod::Lu, LinearMethod::Cg];
    let (network, fixed, start) = pulled(&[6, 5, 5], 0.2);
    let constraints = Constraints::new(start.len(), &fixed).unwrap();
    let loads = vec![0.0; start.len()];
    let solve = |method, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = LinearOptions { method, ..LinearOptions::default() };
        pool.install(|| {
            let settings = NewtonSettings { tolerance: 1e-12, ..NewtonSettings::default() };
            let mut solver = Newton::new(&network, &constraints, settings, options).unwrap();
            let mut u = start.clone();
            let report = solver.solve(&mut u, &loads).unwrap();
            (u, report)
        })
    };
    let (reference, _) = solve(LinearMethod::Cholesky, 1);
    for method in methods {
        let (u, report) = solve(method, 1);
        for threads in [2, 4] {
            let (again, report_again) = solve(method, threads);
            assert!(u == again && report == report_again, "{} {threads}", method.name());
        }
        let difference: Vec<f64> = u.iter().zip(&reference).map(|(a, b)| a - b).collect();
        assert!(norm_of(&difference) <= 1e-11 * norm_of(&reference), "{}", method.name());
    }
}

fn with(variant: NewtonVariant, method: LinearMethod) -> (NewtonSettings, LinearOptions) {
    let settings = NewtonSettings { tolerance: 1e-11, max_iterations: 40, variant };
    (settings, LinearOptions { method, ..LinearOptions::default() })
}

#[test]
fn all_variants_reach_the_tolerance_at_the_same_state() {
    let (network, fixed, start) = pulled(&[9, 5, 5], 0.2);
    let constraints = Constraints::new(start.len(), &fixed).unwrap();
    let loads = vec![0.0; start.len()];
    let solve = |variant, method| {
        let (settings, options) = with(variant, method);
        let mut newton = Newton::new(&network, &constraints, settings, options).unwrap();
        let mut u = start.clone();
        let report = newton.solve(&mut u, &loads).unwrap();
        let definiteness = newton.judge().unwrap();
        assert_eq!(definiteness.positive_definite, Some(true), "{definiteness:?}");
        assert!(newton.condition().unwrap().unwrap() > 1.0);
        (u, report, newton.counters())
    };
    let (reference, full, _) = solve(NewtonVariant::Full, LinearMethod::Cholesky);
    let mut linear_iterations = Vec::new();
    for variant in [NewtonVariant::Full, NewtonVariant::Inexact, NewtonVariant::Modified] {
        for method in [LinearMethod::Cholesky, LinearMethod::Cg, LinearMethod::MatrixFree] {
            let (u, report, counters) = solve(variant, method);
            let what = format!("{variant:?} {}", method.name());
            assert!(*report.history.residual_over_reaction.last().unwrap() <= 1e-11, "{what}");
            let difference: Vec<f64> = u.iter().zip(&reference).map(|(a, b)| a - b).collect();
            assert!(norm_of(&difference) <= 1e-9 * norm_of(&reference), "{what}");
            let r = &report.history.residual_over_reaction;
            if variant == NewtonVariant::Full {
                assert_eq!(report.iterations, full.iterations, "{what}");
            }
            if variant == NewtonVariant::Modified {
                assert!(counters.tangents < full.iterations, "{what} {counters:?}");
                assert!(counters.factorizations <= counters.tangents, "{what} {counters:?}");
                assert!(report.iterations > full.iterations, "{what} {r:?}");
            }
            if method == LinearMethod::Cg {
                linear_iterations.push(report.linear.iter().map(|l| l.iterations).sum::<usize>());
            }
        }
    }
    assert!(linear_iterations[1] < linear_iterations[0], "{linear_iterations:?}");
}

#[test]
fn full_newton_is_quadratic_by_conjugate_gradients_too() {
    let (network, fixed, mut u) = pulled(&[9, 5, 5], 0.3);
    let constraints = Constraints::new(u.len(), &fixed).unwrap();
    let (settings, options) = with(NewtonVariant::Full, LinearMethod::Cg);
    let mut newton = Newton::new(&network, &constraints, settings, options).unwrap();
    let report = newton.solve(&mut u, &vec![0.0; network.positions.len()]).unwrap();
    let r = &report.history.residual_over_reaction;
    let quadratic = |k: &usize| r[k + 1] <= (2.0 * r[*k] * r[*k]).max(1e-11);
    assert!((1..r.len() - 1).filter(|&k| r[k] < 0.3).all(|k| quadratic(&k)), "{r:?}");
    let tolerances: Vec<usize> = report.linear.iter().map(|l| l.iterations).collect();
    assert!(tolerances.last() < tolerances.first(), "{tolerances:?}");
}

/// A jump so far that the old tangent leads nowhere: a new one is taken.
#[test]
fn modified_newton_renews_a_tangent_that_does_not_serve() {
    let (network, fixed) = chain(4, logarithmic);
    let constraints = Constraints::new(10, &fixed).unwrap();
    let (settings, options) = with(NewtonVariant::Modified, LinearMethod::Cholesky);
    let mut newton = Newton::new(&network, &constraints, settings, options).unwrap();
    let mut u = vec![0.0; 10];
    let mut loads = vec![0.0; 10];
    let mut tangents = 0;
    for stretch in [1.0 + 1e-3, 1.0 + 2e-3, 2.2] {
        loads[8] = libm::log(stretch) / stretch;
        let report = newton.solve(&mut u, &loads).unwrap();
        assert!((u[8] - 4.0 * (stretch - 1.0)).abs() < 1e-8, "{stretch}: {u:?} {report:?}");
        tangents = newton.counters().tangents - tangents;
        newton.judge().unwrap();
    }
    assert!(tangents > 2, "{tangents}");
}
