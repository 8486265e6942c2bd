//! Trajectories, critical steps and a wave, step by step as other programs have them.

use std::sync::Arc;

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::solve::Watch;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::march::{Advance, March};
use piola_runtime::solve::motion::{
    CriticalStep, Initial, Method, Motion, MotionSettings, Precision, Row, step_by_row_sums,
};
use piola_runtime::weights::Weights;
use serde_json::Value;

use crate::families::{largest, numbers, reference};
use crate::{Conditions, bonds, cloud, energy};

/// The place of each of the user's points in the body's order.
pub(crate) fn places(body: &Body) -> Vec<usize> {
    let mut places = vec![0; body.n_points()];
    body.user_index().iter().enumerate().for_each(|(place, user)| places[*user as usize] = place);
    places
}

/// What a case of the file does to its body.
pub(crate) fn conditions(case: &Value, body: &Body) -> Conditions {
    let (d, place) = (body.dimension(), places(body));
    let dofs = |of: &Value| -> Vec<usize> {
        let components = numbers(&of["components"]);
        let points = numbers(&of["points"]);
        let all = points.iter().flat_map(|p| components.iter().map(move |c| (*p, *c)));
        all.map(|(p, c)| place[p as usize] * d + c as usize).collect()
    };
    let mut driven: Vec<(usize, [f64; 2])> = Vec::new();
    let mut displaced: Vec<(usize, f64)> = Vec::new();
    if case["held"].is_array() {
        for point in numbers(&case["held"]) {
            driven.extend((0..d).map(|c| (place[point as usize] * d + c, [0.0; 2])));
        }
    }
    if case["pres"].is_object() {
        let velocities = case["pres"]["velocity"].as_array().unwrap();
        let of = |k: usize| [0, 1].map(|i| velocities[k % velocities.len()][i].as_f64().unwrap());
        driven.extend(dofs(&case["pres"]).into_iter().enumerate().map(|(k, dof)| (dof, of(k))));
    }
    if case["cons"].is_object() {
        let given = numbers(&case["cons"]["displacement"]);
        let of = |k: usize| given[k % given.len()];
        displaced.extend(dofs(&case["cons"]).into_iter().enumerate().map(|(k, dof)| (dof, of(k))));
    }
    let mut loads = vec![0.0; body.positions().len()];
    if case["load"].is_object() {
        for point in numbers(&case["load"]["points"]) {
            let force = numbers(&case["load"]["force"]);
            (0..d).for_each(|c| loads[place[point as usize] * d + c] = force[c]);
        }
    }
    driven.sort_by_key(|(dof, _)| *dof);
    displaced.sort_by_key(|(dof, _)| *dof);
    let ramp = case["load"]["ramp_end"].as_f64().or(case["t_max"].as_f64()).unwrap_or(0.0);
    let (driven, velocities) = driven.into_iter().unzip();
    let (displaced, displacements) = displaced.into_iter().unzip();
    Conditions { displaced, displacements, driven, velocities, loads, ramp }
}

pub(crate) fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// A case, read.
struct Read {
    body: Arc<Body>,
    energy: Box<dyn Energy>,
    drive: Conditions,
    masses: Vec<f64>,
    initial: Initial,
    settings: MotionSettings,
}

impl Read {
    fn new(file: &Value, case: &Value) -> Read {
        let (body, horizon) = cloud(file, &case["cloud"]);
        let d = body.dimension();
        let (dt, steps) = (number(&case["dt"]), number(&case["steps"]));
        let density = number(&case["rho"]);
        let method = match case["integrator"].as_str().unwrap() {
            "velocity-verlet" => Method::Verlet,
            "leap-frog" => Method::LeapFrog,
            _ => Method::Kinematic,
        };
        Read {
            energy: energy(&case["model"], &body, horizon),
            drive: conditions(case, &body),
            masses: body.volumes().iter().map(|v| density * v).collect(),
            initial: Initial {
                displacements: body.from_user_order(&numbers(&case["u0"]), d),
                velocities: body.from_user_order(&numbers(&case["v0"]), d),
            },
            settings: MotionSettings {
                method,
                end: steps * dt,
                step: Some(dt),
                damping: case["c_v"].as_f64().unwrap_or(0.0) / density,
                ..MotionSettings::default()
            },
            body,
        }
    }

    fn motion(&self) -> Motion<'_> {
        let (energy, initial) = (&*self.energy, self.initial.clone());
        let watch = Watch::default();
        Motion::new(energy, &self.masses, initial, &self.drive, &self.settings, &watch).unwrap()
    }
}

pub(crate) fn go(motion: &mut Motion<'_>, step: usize) -> Row {
    match motion.advance_to(step).unwrap() {
        Advance::Step(row) => row,
        _ => panic!("nobody looks on"),
    }
}

/// The largest difference over a scale.
pub(crate) fn off(found: &[f64], expected: &[f64], scale: f64) -> f64 {
    assert_eq!(found.len(), expected.len());
    let difference: Vec<f64> = found.iter().zip(expected).map(|(f, e)| f - e).collect();
    largest(&difference) / scale
}

#[test]
fn trajectories_are_those_of_other_programs() {
    let file = reference("motion_small.json");
    let cases = file["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 12);
    for case in cases {
        let read = Read::new(&file, case);
        let mut motion = read.motion();
        let states = case["states"].as_array().unwrap();
        let most = |key: &str| {
            let of_state = |state: &Value| largest(&numbers(&state[key]));
            states.iter().map(of_state).fold(0.0, f64::max)
        };
        let (u_scale, v_scale) = (most("u"), most("v"));
        let total = |state: &Value| number(&state["stored"]) + number(&state["kinetic"]);
        let energy_scale = states.iter().map(total).fold(0.0, f64::max);
        let d = read.body.dimension();
        let fixed: Vec<usize> = [&read.drive.displaced[..], &read.drive.driven].concat();
        let mut worst = [0.0_f64; 3];
        for state in states {
            let row = go(&mut motion, state["step"].as_u64().unwrap() as usize);
            let present = motion.state();
            let mut expected = read.body.from_user_order(&numbers(&state["v"]), d);
            // Nothing depends on what is reported for points that are moved by miranda's rule, and at
            // the start for points whose velocity is prescribed.
            let is_kinematic = read.settings.method == Method::Kinematic;
            let is_open = !fixed.is_empty() && (is_kinematic || row.step == 0);
            if is_open {
                fixed.iter().for_each(|&dof| expected[dof] = present.velocities[dof]);
            }
            let u = read.body.to_user_order(present.displacements, d);
            let kinetic = if is_open { number(&state["kinetic"]) } else { row.kinetic };
            let mut energies = vec![
                row.energy.total() - number(&state["stored"]),
                kinetic - number(&state["kinetic"]),
            ];
            for (key, found) in [("work_loads", row.external), ("work_prescribed", row.prescribed)]
            {
                energies.extend(state[key].as_f64().map(|expected| found - expected));
            }
            let errors = [
                off(&u, &numbers(&state["u"]), u_scale),
                off(present.velocities, &expected, v_scale),
                largest(&energies) / energy_scale,
            ];
            (0..3).for_each(|k| worst[k] = worst[k].max(errors[k]));
        }
        let name = case["name"].as_str().unwrap();
        println!("{name}: u, v, energies {worst:?}");
        assert!(motion.notes().is_empty(), "{name}: {:?}", motion.notes());
        assert!(worst.iter().all(|error| *error <= 1e-11), "{name}: {worst:?}");
    }
}

#[test]
fn steps_converge_to_the_exact_motion() {
    let file = reference("motion_small.json");
    let exact = &file["exact_motion_of_bb_solid"];
    let case = &file["cases"][0];
    let mut read = Read::new(&file, case);
    for pair in exact["verlet_max_error_by_dt"].as_array().unwrap() {
        let (dt, expected) = (number(&pair[0]), number(&pair[1]));
        read.settings.step = Some(dt);
        read.settings.end = number(&exact["t"]);
        let mut motion = read.motion();
        let last = motion.n_steps();
        go(&mut motion, last);
        let found = read.body.to_user_order(motion.state().displacements, 3);
        let error = off(&found, &numbers(&exact["u"]), 1.0);
        println!("{dt}: {error:e}, {expected:e}");
        assert!((error / expected - 1.0).abs() <= 1e-8, "{dt}: {error:e}");
    }
}

#[test]
fn relaxation_ends_in_the_static_equilibrium() {
    let file = reference("motion_small.json");
    let cases = file["cases"].as_array().unwrap().iter();
    let relaxed: Vec<&Value> = cases.filter(|c| c["static_equilibrium"].is_object()).collect();
    assert_eq!(relaxed.len(), 2);
    for case in relaxed {
        let mut read = Read::new(&file, case);
        read.settings.end = 4000.0 * number(&case["dt"]);
        let mut motion = read.motion();
        let row = go(&mut motion, 4000);
        let found = read.body.to_user_order(motion.state().displacements, read.body.dimension());
        let expected = &case["static_equilibrium"];
        let u = numbers(&expected["u"]);
        let errors = [
            off(&found, &u, largest(&u)),
            (row.energy.total() / number(&expected["stored"]) - 1.0).abs(),
        ];
        println!("{}: {errors:?}", case["name"]);
        assert!(errors.iter().all(|error| *error <= 1e-10), "{errors:?}");
    }
}

#[test]
fn critical_steps_are_those_of_eigenvalues() {
    let file = reference("motion_small.json");
    let rows = file["critical_steps"]["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 22);
    let mut worst = [0.0_f64; 2];
    for row in rows {
        let (body, horizon) = cloud(&file, &row["cloud"]);
        let (d, n) = (body.dimension(), body.positions().len());
        let energy = energy(&row["model"], &body, horizon);
        let masses: Vec<f64> = body.volumes().iter().map(|v| number(&row["rho"]) * v).collect();
        let place = places(&body);
        let points = numbers(&row["fixed_points"]);
        let mut fixed: Vec<usize> =
            points.iter().flat_map(|p| (0..d).map(|c| place[*p as usize] * d + c)).collect();
        fixed.sort_unstable();
        let constraints = Constraints::new(n, &fixed).unwrap();
        let (rest, sharp) = (vec![0.0; n], Precision { tolerance: 1e-10, products: 1000 });
        let find = |precision| {
            let found = CriticalStep::find(&*energy, &rest, &masses, &constraints, precision);
            found.unwrap().unwrap()
        };
        let (found, sure) = (find(sharp), step_by_row_sums(&*energy, &rest, &masses, &constraints));
        let expected = number(&row["dt_critical"]);
        let errors = [
            (found.seconds / expected - 1.0).abs(),
            (sure.unwrap() / number(&row["dt_from_row_sums"]) - 1.0).abs(),
        ];
        println!("{} {}: {errors:?}", row["model"], found.products);
        (0..2).for_each(|k| worst[k] = worst[k].max(errors[k]));
        // What a run takes errs on the safe side, by little.
        let rough = find(Precision::default()).seconds / expected;
        assert!(rough <= 1.0 + 1e-12 && rough > 1.0 - 1e-4, "{rough}");
    }
    assert!(worst.iter().all(|error| *error <= 1e-9), "{worst:?}");
}

#[test]
fn a_wave_runs_along_a_row_as_it_should() {
    let file = reference("motion_small.json");
    let wave = &file["wave_in_a_row"];
    let (n, delta) = (number(&wave["points"]) as usize, number(&wave["delta"]));
    let positions: Vec<f64> = (0..n).flat_map(|i| [i as f64, 0.0]).collect();
    let body = Arc::new(Body::new(2, &positions, &vec![1.0; n], None));
    let laws = bonds::laws([2.0 / (delta * delta), 0.0, 0.0], 1);
    let energy = DiscreteEnergy::new(Arc::clone(&body), delta, Weights::Volumes, laws).unwrap();
    let along = numbers(&wave["u0"]);
    let u: Vec<f64> = along.iter().flat_map(|u| [*u, 0.0]).collect();
    let initial = Initial { displacements: u, velocities: vec![0.0; 2 * n] };
    let states = wave["states"].as_array().unwrap();
    let end = number(&states.last().unwrap()["t"]);
    let dt = number(&wave["dt"]);
    let settings = MotionSettings { end, step: Some(dt), ..MotionSettings::default() };
    let free = Conditions { loads: vec![0.0; 2 * n], ..Conditions::default() };
    let masses = vec![1.0; n];
    let watch = Watch::default();
    let mut motion = Motion::new(&energy, &masses, initial, &free, &settings, &watch).unwrap();
    // A named step that is well below needs no more than to know that: on the safe side, as far as it says.
    let critical = motion.critical().unwrap();
    let short = 1.0 - critical.seconds / number(&wave["dt_critical"]);
    assert!((-1e-12..critical.uncertainty).contains(&short), "{critical:?} {short}");
    assert!(critical.uncertainty < 1e-2 && critical.products <= 30, "{critical:?}");
    for state in states {
        go(&mut motion, (number(&state["t"]) / dt).round() as usize);
        let u = motion.state().displacements;
        let found: Vec<f64> = u.iter().step_by(2).copied().collect();
        let error = off(&found, &numbers(&state["u_velocity_verlet"]), largest(&along));
        println!("{}: {error:e}", state["t"]);
        assert!(error <= 1e-7, "{error:e}");
    }
}
