use std::ops::ControlFlow;

use piola_mechanics::testing::{PEAK, SpringLaw, SpringNetwork, linear, softening};

use crate::Watch;
use crate::newton::NewtonSettings;
use crate::steps::{BreakSettings, Control, Drive, StepError, StepRecord, StepSettings, run_steps};

/// One value of a fixed degree of freedom, or one load, in proportion to `t`; the other fixed ones are 0.
struct One {
    fixed: Vec<usize>,
    prescribed: Option<(usize, f64)>,
    load: Option<(usize, f64)>,
}

impl Drive for One {
    fn fixed(&self) -> &[usize] {
        &self.fixed
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        values.fill(0.0);
        if let Some((dof, full)) = self.prescribed {
            values[self.fixed.iter().position(|fixed| *fixed == dof).unwrap()] = t * full;
        }
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        if let Some((dof, full)) = self.load {
            loads[dof] = t * full;
        }
    }
}

fn settings(increments: usize, arcs: usize) -> StepSettings {
    let breaking = BreakSettings { control: Control::ArcLength, arcs, ..BreakSettings::default() };
    let newton = NewtonSettings { tolerance: 1e-12, ..NewtonSettings::default() };
    StepSettings { increments, breaking, newton, ..StepSettings::default() }
}

/// The records, with the displacements of one degree of freedom.
fn follow(
    network: &SpringNetwork,
    drive: &One,
    settings: &StepSettings,
    dof: usize,
) -> Result<Vec<(StepRecord, f64)>, StepError> {
    let mut seen = Vec::new();
    run_steps(network, drive, settings, &Watch::default(), &mut |record, state| {
        assert_eq!(record.residual.len(), record.iterations + 1);
        assert_eq!(record.linear.len(), record.iterations);
        assert_eq!(record.t, state.t);
        seen.push((record.clone(), state.displacements[dof]));
        ControlFlow::Continue(())
    })?;
    Ok(seen)
}

/// Points along x at these places, joined one after the other, held but for x; the first is fixed.
fn chain(places: &[f64], law: SpringLaw) -> (SpringNetwork, Vec<usize>) {
    let positions = places.iter().flat_map(|x| [*x, 0.0]).collect();
    let bonds = (1..places.len()).map(|k| (k - 1, k)).collect();
    let fixed = (0..2 * places.len()).filter(|dof| *dof == 0 || dof % 2 == 1).collect();
    (SpringNetwork::new(2, positions, bonds, law), fixed)
}

#[test]
fn a_spring_that_softens_is_followed_over_its_peak_at_given_load() {
    let (network, fixed) = chain(&[0.0, 1.0], softening);
    let peak = PEAK / std::f64::consts::E;
    // The load goes to 2 peaks in 20 increments: it never gets there.
    let drive = One { fixed, prescribed: None, load: Some((2, 2.0 * peak)) };
    let seen = follow(&network, &drive, &settings(20, 120), 2).unwrap();
    assert_eq!(seen.len(), 120);
    let mut last = 0.0;
    for (record, u) in &seen {
        let force = u * libm::exp(-u / PEAK);
        assert!((record.t * 2.0 * peak - force).abs() <= 1e-11 * peak, "{} {force}", record.t);
        assert!(*u > last, "the spring only grows: {u} after {last}");
        assert_eq!(record.definiteness.positive_definite, Some(*u < PEAK));
        last = *u;
    }
    let most = seen.iter().map(|(record, _)| record.t).fold(0.0, f64::max);
    assert!((0.49..=0.5).contains(&most), "{most}");
    assert!(seen[119].0.t < 0.5 * most, "{}", seen[119].0.t);
}

/// Long springs are linear, others soften.
fn by_length(e: f64, length: f64) -> (f64, f64, f64) {
    if length > 1.5 { linear(e, length) } else { softening(e, length) }
}

#[test]
fn a_chain_snaps_back_at_given_displacement() {
    // The force is psi' of both: the end is at e + 20 e exp(-e/PEAK), with e the strain of the first.
    let (network, mut fixed) = chain(&[0.0, 1.0, 21.0], by_length);
    fixed.insert(3, 4);
    let drive = One { fixed, prescribed: Some((4, 1.2)), load: None };
    let seen = follow(&network, &drive, &settings(30, 400), 2).unwrap();
    let (mut last, mut falls) = ((0.0, 0.0), 0);
    for (record, e) in &seen {
        let end = e + 20.0 * e * libm::exp(-e / PEAK);
        assert!((1.2 * record.t - end).abs() <= 1e-10, "{} {end}", record.t);
        assert!(*e > last.1, "{e} after {}", last.1);
        falls += usize::from(record.t < last.0);
        last = (record.t, *e);
    }
    assert!(falls > 5, "{falls}");
    assert_eq!(last.0, 1.0, "the end is met exactly");
}

#[test]
fn a_flat_truss_snaps_through() {
    let height = 0.3;
    let positions = vec![0.0, 0.0, 1.0, height, 2.0, 0.0];
    let network = SpringNetwork::new(2, positions, vec![(0, 1), (1, 2)], linear);
    let drive = One { fixed: vec![0, 1, 4, 5], prescribed: None, load: Some((3, -0.02)) };
    let seen = follow(&network, &drive, &settings(20, 300), 3).unwrap();
    let long = libm::hypot(1.0, height);
    let mut last = 0.0;
    for (record, u) in &seen {
        let above = height + u;
        let length = libm::hypot(1.0, above);
        // Two bars of the force l/L - 1, downwards.
        let load = -2.0 * (length / long - 1.0) * above / length;
        assert!((0.02 * record.t - load).abs() <= 1e-12, "{} {load}", record.t);
        assert!(*u < last, "the top goes down: {u} after {last}");
        last = *u;
    }
    let least = seen.iter().map(|(record, _)| record.t).fold(1.0, f64::min);
    assert!(least < -0.1, "beyond the first peak the load pulls: {least}");
    let (end, u) = seen.last().unwrap();
    assert_eq!((end.t, end.definiteness.positive_definite), (1.0, Some(true)));
    assert!(*u < -2.0 * height, "{u}");
    let unstable = seen.iter().filter(|(r, _)| r.definiteness.positive_definite == Some(false));
    assert!(unstable.count() > 3);
}

#[test]
fn where_nothing_moves_steps_go_by_t() {
    let (network, fixed) = chain(&[0.0, 1.0], linear);
    let drive = One { fixed, prescribed: None, load: None };
    let seen = follow(&network, &drive, &settings(4, 100), 2).unwrap();
    let times: Vec<f64> = seen.iter().map(|(record, _)| record.t).collect();
    assert_eq!(times, [0.25, 0.5, 0.75, 1.0]);
}

#[test]
fn frames_are_of_times_that_were_not_there_before() {
    let (network, mut fixed) = chain(&[0.0, 1.0, 21.0], by_length);
    fixed.insert(3, 4);
    let drive = One { fixed, prescribed: Some((4, 1.2)), load: None };
    let seen = follow(&network, &drive, &settings(30, 400), 2).unwrap();
    let mut most = 0.0;
    for (record, _) in seen {
        let nominal = |t: f64| (t * 30.0 + 1e-9).floor();
        assert_eq!(record.nominal, nominal(record.t) > nominal(most), "{}", record.t);
        most = f64::max(most, record.t);
    }
}
