use std::sync::Arc;

use piola_mechanics::testing::{PEAK, SpringLaw, SpringNetwork, limited, linear, softening};

use super::*;
use crate::linear::LinearMethod;
use crate::{Event, Observer};

/// Prescribed values and loads that grow in proportion to `t`.
struct Proportional {
    fixed: Vec<usize>,
    values: Vec<f64>,
    loads: Vec<(usize, f64)>,
}

impl Drive for Proportional {
    fn fixed(&self) -> &[usize] {
        &self.fixed
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        for (value, full) in values.iter_mut().zip(&self.values) {
            *value = t * full;
        }
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        for &(dof, full) in &self.loads {
            loads[dof] = t * full;
        }
    }
}

/// All degrees of freedom in `prescribed` are fixed, with their displacements at `t = 1`.
fn displaced(prescribed: &[(usize, f64)]) -> Proportional {
    Proportional {
        fixed: prescribed.iter().map(|p| p.0).collect(),
        values: prescribed.iter().map(|p| p.1).collect(),
        loads: Vec::new(),
    }
}

fn settings(increments: usize) -> StepSettings {
    StepSettings { increments, ..StepSettings::default() }
}

fn run(
    network: &SpringNetwork,
    drive: &Proportional,
    settings: &StepSettings,
) -> Result<Outcome, StepError> {
    run_steps(network, drive, settings, &Watch::default(), &mut |_, _| ControlFlow::Continue(()))
}

fn not_converged(error: StepError) -> NotConverged {
    match error {
        StepError::NotConverged(details) => *details,
        other => panic!("{other}"),
    }
}

/// A chain of `n` springs along x, lateral displacements held.
fn chain(n: usize, law: SpringLaw) -> (SpringNetwork, Vec<(usize, f64)>) {
    let network = SpringNetwork::lattice(&[n + 1, 1], 1.0, law);
    let held = (0..2 * (n + 1)).filter(|dof| *dof == 0 || dof % 2 == 1);
    (network, held.map(|dof| (dof, 0.0)).collect())
}

#[test]
fn nominal_times_are_exact_and_the_observer_sees_equilibria() {
    let network = SpringNetwork::lattice(&[5, 4], 2.0, linear);
    let end: Vec<(usize, f64)> = network
        .dofs_where(|x| x[0] == 0.0 || x[0] == 4.0)
        .into_iter()
        .map(|dof| (dof, if dof >= 32 && dof % 2 == 0 { 1.0 } else { 0.0 }))
        .collect();
    let mut times = Vec::new();
    let outcome = run_steps(
        &network,
        &displaced(&end),
        &settings(7),
        &Watch::default(),
        &mut |record, state| {
            assert!(record.nominal && record.cut_backs == 0);
            assert_eq!(record.definiteness.positive_definite, Some(true));
            assert_eq!(record.residual.len(), record.iterations + 1);
            assert_eq!(record.linear.len(), record.iterations);
            assert_eq!(state.displacements[32], state.t);
            let free = |dof: &usize| end.iter().all(|(fixed, _)| fixed != dof);
            let residual: f64 =
                (0..40).filter(free).map(|dof| state.internal_forces[dof].abs()).sum();
            assert!(residual < 1e-8, "{residual:e}");
            let sum: f64 = state.internal_forces.iter().step_by(2).sum();
            assert!(sum.abs() < 1e-12);
            times.push(state.t);
            ControlFlow::Continue(())
        },
    )
    .unwrap();
    let expected: Vec<f64> = (1..8).map(|k| f64::from(k) / 7.0).collect();
    assert_eq!(times, expected);
    assert_eq!(outcome.records.len(), 7);
    assert!(!outcome.stopped);
    let iterations: usize = outcome.records.iter().map(|record| record.iterations).sum();
    // A start takes a system with the tangent of the equilibrium before, the first with that at rest.
    assert_eq!(outcome.counters.linear_solves, iterations + 7);
    assert_eq!(outcome.counters.tangents, 1 + iterations + 7);
}

#[test]
fn the_observer_can_stop_the_run() {
    let (network, mut held) = chain(3, linear);
    held.push((6, 0.5));
    held.sort_unstable_by_key(|p| p.0);
    let outcome = run_steps(
        &network,
        &displaced(&held),
        &settings(10),
        &Watch::default(),
        &mut |record, _| {
            if record.t > 0.35 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    )
    .unwrap();
    assert!(outcome.stopped);
    assert_eq!(outcome.records.len(), 4);
}

/// A sheet that is stretched by 40 %, from each start: records and displacements.
fn stretched(start: Start, increments: usize) -> Outcome {
    let network = SpringNetwork::lattice(&[6, 5], 2.0, linear);
    let fixed = network.dofs_where(|x| x[0] == 0.0 || x[0] == 5.0);
    let ends: Vec<_> = fixed.iter().map(|&dof| (dof, if dof >= 50 { 2.0 } else { 0.0 })).collect();
    run(&network, &displaced(&ends), &StepSettings { start, ..settings(increments) }).unwrap()
}

#[test]
fn good_starts_save_iterations_and_lead_to_the_same_equilibria() {
    let iterations =
        |outcome: &Outcome| outcome.records.iter().map(|r| r.iterations).sum::<usize>();
    let last = stretched(Start::Last, 20);
    let line = stretched(Start::Extrapolate, 20);
    let tangent = stretched(Start::Tangent, 20);
    let counts = [&tangent, &line, &last].map(iterations);
    assert!(counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
    // What the line misses is twice what the tangent misses: both are quadratic in the increment.
    let first = |outcome: &Outcome, step: usize| outcome.records[step].residual_over_reaction[0];
    let ratio = first(&line, 5) / first(&tangent, 5);
    assert!((ratio - 2.0).abs() < 0.5, "{ratio}");
    // There is no line to the first equilibrium.
    assert_eq!(first(&line, 0), first(&last, 0));
    assert!(first(&tangent, 0) < 0.1 * first(&last, 0));
    assert!(tangent.records.iter().all(|record| record.start.is_some()));
    assert!(line.records.iter().all(|record| record.start.is_none()));
    for (a, b) in
        last.displacements.iter().zip(line.displacements.iter().zip(&tangent.displacements))
    {
        assert!((a - b.0).abs() < 1e-9 && (a - b.1).abs() < 1e-9);
    }
}

#[test]
fn the_tangent_start_is_of_second_order_under_displacements_and_loads() {
    // Half the increment leaves a quarter of the residual.
    let first = |increments| {
        let network = SpringNetwork::lattice(&[6, 5], 2.0, linear);
        let fixed = network.dofs_where(|x| x[0] == 0.0);
        let held: Vec<_> = fixed.iter().map(|&dof| (dof, 0.2 * (dof % 2) as f64)).collect();
        let loads = network.dofs_where(|x| x[0] == 5.0);
        let loads = loads.into_iter().map(|dof| (dof, 0.02)).collect();
        let drive = Proportional { loads, ..displaced(&held) };
        run(&network, &drive, &settings(increments)).unwrap().records[0].residual[0]
    };
    let ratio = first(8) / first(16);
    assert!((ratio - 4.0).abs() < 0.3, "{ratio}");
}

#[test]
fn where_there_is_no_tangent_a_step_starts_at_the_last_state() {
    // At rest the point between the springs is held by nothing sideways, and is pushed that way: no
    // linear system has a solution, but with the springs stretched by the prescribed end there is one.
    let network = SpringNetwork::lattice(&[3, 1], 1.0, linear);
    let held = [(0, 0.0), (1, 0.0), (4, 0.2), (5, 0.0)];
    let drive = Proportional { loads: vec![(3, 1e-3)], ..displaced(&held) };
    let outcome = run(&network, &drive, &settings(2)).unwrap();
    let starts: Vec<bool> = outcome.records.iter().map(|record| record.start.is_some()).collect();
    assert_eq!(starts, [false, true]);
    assert!(outcome.displacements[3] > 1e-3);
}

/// Moves its prescribed values evenly up to `t = 1/2` and then holds them.
struct Halting(Proportional);

impl Drive for Halting {
    fn fixed(&self) -> &[usize] {
        self.0.fixed()
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        self.0.prescribed(t.min(0.5), values);
    }

    fn loads(&self, _: f64, _: &mut [f64]) {}
}

#[test]
fn where_the_line_leads_astray_a_step_starts_at_the_last_state() {
    // Both springs are strained by 0.275 at t = 1/2. The line through the last two states would take
    // the point between them on to 0.41, where the energy is not finite.
    let (network, mut held) = chain(2, limited);
    held.push((4, 1.1));
    held.sort_unstable_by_key(|p| p.0);
    let settings = StepSettings { start: Start::Extrapolate, ..settings(4) };
    let drive = Halting(displaced(&held));
    let go_on = &mut |_: &StepRecord, _: &State<'_>| ControlFlow::Continue(());
    let outcome = run_steps(&network, &drive, &settings, &Watch::default(), go_on).unwrap();
    assert_eq!(outcome.records.len(), 4);
    assert!(outcome.records.iter().all(|record| record.cut_backs == 0 && record.nominal));
    assert_eq!(outcome.records[2].iterations, 0);
    assert!((outcome.displacements[2] - 0.275).abs() < 1e-9);
}

#[test]
fn cut_backs_recover_and_land_on_the_nominal_times() {
    // One increment stretches the last spring by 2 at once, where the energy is not finite: the way
    // is taken in pieces that it can bear (0.25 at first), and each lets the chain relax.
    let (network, mut held) = chain(10, limited);
    held.push((20, 2.0));
    held.sort_unstable_by_key(|p| p.0);
    let jumping = |n| StepSettings { start: Start::Last, ..settings(n) };
    let outcome = run(&network, &displaced(&held), &jumping(1)).unwrap();
    let (last, sub_steps) = outcome.records.split_last().unwrap();
    assert!(last.nominal && last.t == 1.0);
    assert!(sub_steps.iter().all(|record| !record.nominal));
    assert_eq!((sub_steps[0].cut_backs, sub_steps[0].t), (3, 0.125));
    for point in 0..=10 {
        assert!((outcome.displacements[2 * point] - 0.2 * point as f64).abs() < 1e-9);
    }
    // Several nominal increments: each is reached exactly, whatever lies between.
    let outcome = run(&network, &displaced(&held), &jumping(3)).unwrap();
    let nominal: Vec<f64> =
        outcome.records.iter().filter(|record| record.nominal).map(|record| record.t).collect();
    assert_eq!(nominal, [1.0 / 3.0, 2.0 / 3.0, 1.0]);
    assert!(outcome.records.len() > 3);
    // By the tangent the chain relaxes while its end moves.
    let outcome = run(&network, &displaced(&held), &settings(1)).unwrap();
    assert_eq!((outcome.records.len(), outcome.records[0].cut_backs), (1, 0));
}

#[test]
fn too_few_iterations_cut_back_too() {
    let network = SpringNetwork::lattice(&[5, 4], 2.0, linear);
    let fixed = network.dofs_where(|x| x[0] == 0.0 || x[0] == 4.0);
    let ends: Vec<_> = fixed.iter().map(|&dof| (dof, if dof >= 32 { 2.0 } else { 0.0 })).collect();
    let newton = NewtonSettings { max_iterations: 3, tolerance: 1e-8, ..NewtonSettings::default() };
    let outcome = run(
        &network,
        &displaced(&ends),
        &StepSettings { start: Start::Last, newton, ..settings(1) },
    );
    let outcome = outcome.unwrap();
    assert!(outcome.records[0].cut_backs > 0);
    assert!(outcome.records.iter().all(|record| record.iterations <= 3));
    assert_eq!(outcome.records.last().unwrap().t, 1.0);
}

#[test]
fn a_load_beyond_the_peak_ends_in_a_typed_error_close_to_it() {
    let (network, held) = chain(1, softening);
    let peak_force = PEAK * libm::exp(-1.0);
    let drive = Proportional { loads: vec![(2, 1.3 * peak_force)], ..displaced(&held) };
    let mut seen = 0;
    let error =
        run_steps(&network, &drive, &settings(10), &Watch::default(), &mut |record, state| {
            assert!(state.displacements[2] < PEAK, "{record:?}");
            seen += 1;
            ControlFlow::Continue(())
        })
        .unwrap_err();
    let NotConverged { t_converged, t_failed, cut_backs, cause, outcome } = not_converged(error);
    assert_eq!(outcome.records.len(), seen);
    assert_eq!(outcome.records.last().unwrap().t, t_converged);
    let limit = 1.0 / 1.3;
    let smallest = 0.1 / 1024.0;
    assert!(t_converged <= limit && t_converged > limit - 2.0 * smallest, "{t_converged}");
    assert!(t_failed > t_converged && t_failed <= t_converged + 1.01 * smallest);
    assert!(cut_backs >= 1);
    assert!(!cause.history.residual.is_empty());
    assert!(seen > 7);
}

#[test]
fn displacements_pass_the_peak_and_unstable_states_are_reported() {
    // Two softening springs in series: beyond the peak the uniform state is an equilibrium, but a
    // small push would let one spring close and the other open.
    let (network, mut held) = chain(2, softening);
    held.push((4, 4.0 * PEAK));
    held.sort_unstable_by_key(|p| p.0);
    for method in [LinearMethod::Cholesky, LinearMethod::Ldlt, LinearMethod::Cg] {
        let linear = LinearOptions { method, ..LinearOptions::default() };
        let outcome =
            run(&network, &displaced(&held), &StepSettings { linear, ..settings(8) }).unwrap();
        for record in &outcome.records {
            // Strain 2 PEAK t in each spring.
            let stable = 2.0 * record.t < 1.0;
            let peak = (2.0 * record.t - 1.0).abs() < 1e-9;
            let found = &record.definiteness;
            match (method, stable) {
                _ if peak => {}
                (_, true) => assert_eq!(found.positive_definite, Some(true), "{record:?}"),
                (_, false) => {
                    assert_eq!(found.positive_definite, Some(false), "{record:?}");
                    assert_eq!(found.negative_pivots, Some(1), "{record:?}");
                }
            }
        }
        assert!((outcome.displacements[2] - 2.0 * PEAK).abs() < 1e-9, "{method:?}");
    }
}

/// Two bars that meet in an apex at height `h`, feet at x = -1 and 1.
fn truss(h: f64) -> SpringNetwork {
    let positions = vec![-1.0, 0.0, 0.0, h, 1.0, 0.0];
    SpringNetwork::new(2, positions, vec![(0, 1), (1, 2)], linear)
}

#[test]
fn a_steep_truss_pushed_through_is_unstable_on_the_way() {
    let (h, reference) = (4.0, 17.0_f64.sqrt());
    let drive = displaced(&[(0, 0.0), (1, 0.0), (3, -2.0 * h), (4, 0.0), (5, 0.0)]);
    let mut forces = Vec::new();
    let outcome =
        run_steps(&truss(h), &drive, &settings(40), &Watch::default(), &mut |_, state| {
            forces.push(state.internal_forces[3]);
            ControlFlow::Continue(())
        })
        .unwrap();
    for (k, (record, force)) in outcome.records.iter().zip(&forces).enumerate() {
        let y = h - 0.2 * (k + 1) as f64;
        let l = (1.0 + y * y).sqrt();
        let strain = l / reference - 1.0;
        // Analytic: vertical force 2 e y/l, sideways stiffness 2/l^2 (1/L + e y^2/l).
        assert!((force - 2.0 * strain * y / l).abs() < 1e-12, "{k}: {force}");
        let stable = 1.0 / reference + strain * y * y / l > 0.0;
        assert_eq!(record.definiteness.positive_definite, Some(stable), "{k}");
        assert_eq!(record.definiteness.negative_pivots, Some(usize::from(!stable)), "{k}");
    }
    let unstable =
        outcome.records.iter().filter(|r| r.definiteness.positive_definite == Some(false));
    assert!((20..38).contains(&unstable.count()));
    assert_eq!(outcome.records[7].definiteness.method, "LDLT: 1 negative pivots");
}

#[test]
fn a_shallow_truss_under_a_load_fails_at_the_limit_load() {
    let (h, load) = (0.2, 0.01);
    let drive = Proportional {
        loads: vec![(3, -load)],
        ..displaced(&[(0, 0.0), (1, 0.0), (4, 0.0), (5, 0.0)])
    };
    let reference = (1.0_f64 + h * h).sqrt();
    let carried = |y: f64| {
        let l = (1.0 + y * y).sqrt();
        2.0 * (1.0 - l / reference) * y / l
    };
    let limit = (0..10_000).map(|k| carried(h * f64::from(k) * 1e-4)).fold(0.0, f64::max) / load;
    // Neither start may snap through to the equilibrium on the other side.
    for start in [Start::Last, Start::Extrapolate, Start::Tangent] {
        let settings = StepSettings { start, ..settings(10) };
        let error =
            run_steps(&truss(h), &drive, &settings, &Watch::default(), &mut |record, state| {
                assert_eq!(record.definiteness.positive_definite, Some(true), "{record:?}");
                let y = h + state.displacements[3];
                assert!(y > 0.0, "{record:?}");
                assert!((carried(y) - load * record.t).abs() < 1e-11, "{record:?}");
                ControlFlow::Continue(())
            })
            .unwrap_err();
        let NotConverged { t_converged, cut_backs, cause, .. } = not_converged(error);
        assert!(t_converged <= limit && limit < t_converged + 2e-4, "{t_converged} {limit}");
        assert!(cut_backs >= 10, "{cut_backs}");
        assert!(matches!(cause.failure, NewtonFailure::LineSearch { .. }), "{cause}");
    }
}

#[test]
fn bad_drives_and_settings_are_refused() {
    let (network, held) = chain(2, linear);
    let run = |drive: &Proportional, settings: &StepSettings| {
        run(&network, drive, settings).unwrap_err().to_string()
    };
    let mut drive = displaced(&held);
    drive.values[1] = f64::NAN;
    assert_eq!(
        run(&drive, &settings(2)),
        "the prescribed displacement of component 1 of point 0 is NaN at t = 0.5"
    );
    let drive = Proportional { loads: vec![(4, f64::INFINITY)], ..displaced(&held) };
    assert_eq!(run(&drive, &settings(4)), "the load of component 0 of point 2 is inf at t = 0.25");
    let drive = displaced(&held);
    assert_eq!(run(&drive, &settings(0)), "increments must be at least 1 (it is 0)");
    let backwards = StepSettings { end: -1.0, ..settings(1) };
    assert_eq!(run(&drive, &backwards), "end must be positive (it is -1)");
    let outside = displaced(&[(77, 0.0)]);
    assert!(run(&outside, &settings(1)).contains("degree of freedom 77"));
}

#[test]
fn a_mechanism_is_a_typed_error() {
    // Nothing holds the chain's middle points sideways, and a load pushes there.
    let network = SpringNetwork::lattice(&[4, 1], 1.0, linear);
    let held = [(0, 0.0), (1, 0.0), (6, 0.0), (7, 0.0)];
    let drive = Proportional { loads: vec![(3, 1e-3)], ..displaced(&held) };
    let error = run(&network, &drive, &settings(1)).unwrap_err();
    let NotConverged { cause, t_converged, .. } = not_converged(error);
    assert_eq!(cause.failure, NewtonFailure::Linear(LinearError::Singular { free: 4 }));
    assert_eq!(t_converged, 0.0);
}

/// F, Table 6, first column (C2 = C3 = 0 is a network of springs): 21^3 points and one more layer
/// outside each x end, bonds up to two spacings, the two layers at each end follow
/// `x = (1 + g) X`, increments of 2 %; residuals over the first in the increment that ends at 20 %.
#[test]
fn the_published_residuals_are_reproduced_by_full_steps() {
    let network = SpringNetwork::lattice(&[23, 21, 21], 2.0, linear);
    let held = network.dofs_where(|x| x[0] <= 1.0 || x[0] >= 21.0);
    let pulled =
        |dof: usize| if dof.is_multiple_of(3) { network.position(dof / 3)[0] - 11.0 } else { 0.0 };
    let drive = displaced(&held.iter().map(|&dof| (dof, pulled(dof))).collect::<Vec<_>>());
    let newton = NewtonSettings { tolerance: 1e-13, ..NewtonSettings::default() };
    let settings = StepSettings { end: 0.2, start: Start::Last, newton, ..settings(10) };
    let outcome = run_steps(&network, &drive, &settings, &Watch::default(), &mut |record, _| {
        assert!(record.step_lengths.iter().all(|&length| length == 1.0));
        ControlFlow::Continue(())
    })
    .unwrap();
    let residual = &outcome.records.last().unwrap().residual;
    for (found, printed) in residual.iter().zip([1.0, 3.99e-2, 7.66e-5, 3.79e-10]) {
        let ratio = found / residual[0] / printed;
        assert!((ratio - 1.0).abs() < 5e-3, "{residual:?}");
    }
}

/// Wants an end after some products, and counts what it sees.
struct Impatient {
    most: usize,
    products: std::sync::atomic::AtomicUsize,
    steps: std::sync::atomic::AtomicUsize,
}

impl Observer for Impatient {
    fn notice(&self, event: Event<'_>) {
        use std::sync::atomic::Ordering::Relaxed;
        match event {
            Event::Product => drop(self.products.fetch_add(1, Relaxed)),
            Event::Step(_) => drop(self.steps.fetch_add(1, Relaxed)),
            _ => {}
        }
    }

    fn wants_end(&self) -> bool {
        self.products.load(std::sync::atomic::Ordering::Relaxed) >= self.most
    }
}

/// Within a linear system the search ends with the product after which an end is wanted, and what
/// converged before stays as it was; no other method takes over.
#[test]
fn whoever_looks_on_ends_the_search_within_a_step() {
    let network = SpringNetwork::lattice(&[12, 5, 5], 2.0, linear);
    let n = network.positions.len();
    let fixed = network.dofs_where(|x| x[0] < 0.5 || x[0] > 10.5);
    let held: Vec<(usize, f64)> = fixed
        .iter()
        .map(|&dof| (dof, if dof % 3 == 0 && dof > n / 2 { 0.4 } else { 0.0 }))
        .collect();
    for method in [LinearMethod::Cg, LinearMethod::MatrixFree, LinearMethod::Gmres] {
        let linear = LinearOptions { method, ..LinearOptions::default() };
        let settings = StepSettings { linear, ..settings(4) };
        let watched = |most: usize| {
            let observer = Arc::new(Impatient { most, products: 0.into(), steps: 0.into() });
            let watch = Watch::by(Arc::clone(&observer) as Arc<dyn Observer>);
            let go_on = &mut |_: &StepRecord, _: &State<'_>| ControlFlow::Continue(());
            let outcome = run_steps(&network, &displaced(&held), &settings, &watch, go_on).unwrap();
            (outcome, observer.products.load(std::sync::atomic::Ordering::Relaxed))
        };
        let (whole, products) = watched(usize::MAX);
        assert!(!whole.stopped && whole.records.len() == 4 && products > 20, "{products}");
        for most in [0, 1, products / 2, products - 1] {
            let (cut, seen) = watched(most);
            assert!(cut.stopped && seen == most, "{method:?}: {seen} products of {most}");
            let steps = cut.records.len();
            assert!(steps < 4 && (steps > 0) == (most > products / 4), "{steps}");
            for (record, expected) in cut.records.iter().zip(&whole.records) {
                assert_eq!(record.residual, expected.residual);
            }
        }
    }
}

/// Chains and lattices, under loads and prescribed displacements, soft and stiff beside each other.
#[test]
fn relaxation_comes_to_rest_where_newton_does() {
    for law in [linear, softening] {
        let network = SpringNetwork::lattice(&[12, 5], 2.1, law);
        let value = |dof: usize| match (dof % 2, network.positions[dof - dof % 2] > 1.0) {
            (0, true) => 0.2,
            (1, true) => -0.1,
            _ => 0.0,
        };
        let ends = network.dofs_where(|x| x[0] < 0.5 || x[0] > 10.5);
        let prescribed: Vec<(usize, f64)> = ends.iter().map(|dof| (*dof, value(*dof))).collect();
        let drive = Proportional { loads: vec![(31, 1e-3)], ..displaced(&prescribed) };
        let newton = run(&network, &drive, &settings(3)).unwrap();
        let relaxing = StepSettings { find: Find::Relaxation, ..settings(3) };
        let relaxed = run(&network, &drive, &relaxing).unwrap();
        assert_eq!(relaxed.records.len(), 3);
        let largest = newton.displacements.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
        for (u, known) in relaxed.displacements.iter().zip(&newton.displacements) {
            assert!((u - known).abs() < 1e-8 * largest, "{u} {known}");
        }
        for (record, other) in relaxed.records.iter().zip(&newton.records) {
            assert!(*record.residual_over_reaction.last().unwrap() <= 1e-10);
            assert!(record.iterations > 20 && record.linear.is_empty(), "{}", record.iterations);
            let (e, known) = (record.energy_parts.total(), other.energy_parts.total());
            assert!((e / known - 1.0).abs() < 1e-9);
            assert_eq!(record.definiteness.positive_definite, None);
        }
        assert_eq!(relaxed.counters.linear_solves, 0);
    }
}
