//! Bonds that remember: micro-plastic and softening ones as other programs have them (damage_small.json).

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Of, Setting, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Elements};
use piola_runtime::body::Body;
use piola_runtime::element::MeasureElement;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::{Criteria, Criterion, Layer};
use piola_runtime::fracture::memory::{self, Memory, NextState};
use piola_runtime::fracture::{Breaking, Fracture};
use piola_runtime::kernel::Measure;
use piola_runtime::materials::{Fields, Materials, StateOf};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings, Snapshot};
use piola_runtime::weights::Weights;
use serde_json::Value;

use crate::families::{largest, numbers, reference};
use crate::reference::{go, number, off};
use crate::{Conditions, cloud};

/// The return map of miranda (14), (15).
pub(crate) const MICRO_PLASTIC: &str = "potential micro_plastic
parameter c
parameter sY
state p = 0
s = l/L - 1
update p = if abs(s - p) > sY then s - sign(s - p)*sY else p
psi(l) = 1/2*c*L*(s - p)^2";

/// Straight down from s0 to sc.
pub(crate) const BILINEAR: &str = "potential bilinear
parameter c
parameter s0
parameter sc
state k = 0
s = l/L - 1
update k = max(k, s)
D = if k <= s0 then 0 else (if k >= sc then 1 else sc*(k - s0)/(k*(sc - s0)))
psi(l) = (1 - D)*1/2*c*L*s^2
break when k >= sc";

/// An exponential tail.
pub(crate) const EXPONENTIAL: &str = "potential exponential
parameter c
parameter s0
parameter sf
state k = 0
s = l/L - 1
update k = max(k, s)
D = if k <= s0 then 0 else 1 - s0/k*exp(-(k - s0)/(sf - s0))
psi(l) = (1 - D)*1/2*c*L*s^2";

/// A body whose bonds, triangles or tetrahedra remember.
pub(crate) fn remembering(
    around: (&Arc<Body>, f64),
    text: &str,
    parameters: &[(&str, f64)],
    level: Level,
) -> Breaking {
    remembering_as(around, text, parameters, (level, false))
}

/// The same; with kernels that follow what comes to be remembered, if wanted.
pub(crate) fn remembering_as(
    (body, horizon): (&Arc<Body>, f64),
    text: &str,
    parameters: &[(&str, f64)],
    (level, follows): (Level, bool),
) -> Breaking {
    let (_, model) = check_text(text).unwrap();
    let settings: Vec<(String, Setting)> =
        parameters.iter().map(|(name, x)| (name.to_string(), Setting::Number(*x))).collect();
    let values = model.values(body.dimension(), &settings, Some(horizon)).unwrap();
    let mut values = values.with_states(&model);
    if follows {
        values = values.following_states(&model);
    }
    let mode = Mode::Jit(level);
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).unwrap());
    let typical: Vec<f64> =
        values.fields.iter().map(|field| values.parameters[usize::from(*field)]).collect();
    let fields = Fields::new(body.n_points(), std::slice::from_ref(&typical), true);
    let time_steps = if follows { vec![typical.len() - 1] } else { Vec::new() };
    let kinds = values.fields.iter().map(|field| match model.kind_of_state(usize::from(*field)) {
        Some(Of::Measure(measure)) => Some(StateOf::Interactions(measure)),
        _ => None,
    });
    let directions = model.directions(body.dimension());
    let axis = |field: &u16| directions.contains(field).then(|| (field - directions.start) as u8);
    let axes = values.fields.iter().map(axis).collect();
    let fields = fields.with_states(kinds.collect()).with_time_steps(time_steps);
    let fields = Arc::new(fields.with_directions(axes, body));
    let materials = Materials::new(vec![0; body.n_points()], Vec::new());
    let materials = Arc::new(materials.with_fields(Arc::clone(&fields)));
    for (field, value) in typical.iter().enumerate() {
        (0..body.n_points()).for_each(|point| fields.set(field, point, *value));
    }
    let mut elements = Elements::default();
    for kernel in model.compile(&values, mode, Form::Accurate).unwrap().kernels {
        let place = match kernel.measure() {
            Measure::Length => &mut elements.bond,
            Measure::Area => &mut elements.triangle,
            Measure::Volume => &mut elements.tetrahedron,
        };
        let (measure, d) = (kernel.measure(), body.dimension());
        *place = Some(Box::new(MeasureElement::new(measure, d, Box::new(kernel))));
    }
    let energy = DiscreteEnergy::of_materials(
        Arc::clone(body),
        Arc::clone(&neighborhood),
        Weights::Volumes,
        Some(Arc::clone(&materials)),
        vec![elements],
    );
    let energy = energy.unwrap();
    let next = |one: piola_compiler::NextState| NextState {
        measure: one.measure(),
        field: one.field,
        next: Box::new(one.next),
    };
    let states = model.next_states(&values, mode, Form::Accurate).unwrap();
    let of_law = vec![states.into_iter().map(next).collect()];
    let memory = memory::Layer { of_law, materials: Arc::clone(&materials) };
    let memory = Memory::new((body, &neighborhood), vec![memory]);
    let criterion = |one: piola_compiler::Criterion| Criterion {
        measure: one.measure(),
        holds_at_zero: one.holds_at_zero,
        margin: Box::new(one.margin),
    };
    let found = model.criteria(&values, mode, Form::Accurate).unwrap();
    let of_law = vec![found.into_iter().map(criterion).collect()];
    let layer = Layer { of_law, materials: Some(materials) };
    let never = vec![false; body.n_points()];
    let criteria = Criteria::new((body, &neighborhood), vec![layer], never);
    let names = Arc::clone(energy.parts());
    let body = Arc::clone(body);
    Breaking::new(
        (body, neighborhood),
        vec![Box::new(energy)],
        names,
        (criteria, memory),
        Vec::new(),
    )
}

const LEVELS: [Level; 2] = [Level::Fast, Level::Strict];

/// Two points, and what makes them a bond of length `length` with volumes of 1.
fn pair(length: f64) -> (Arc<Body>, f64) {
    let body = Body::new(2, &[0.0, 0.0, length, 0.0], &[1.0, 1.0], None);
    (Arc::new(body), 1.5 * length)
}

/// Forces on points over the largest, and the stored energy, against those of a step.
fn errors(energy: &Breaking, body: &Body, u: &[f64], step: &Value) -> [f64; 2] {
    let mut forces = vec![0.0; u.len()];
    let stored = energy.forces(u, &mut forces).unwrap().total();
    let expected = numbers(&step["force"]);
    let found: Vec<f64> =
        body.to_user_order(&forces, body.dimension()).iter().map(|g| -g).collect();
    let known = number(&step["stored"]);
    [off(&found, &expected, largest(&expected)), (stored - known).abs() / known]
}

#[test]
fn micro_plastic_bonds_yield_as_elsewhere() {
    let file = reference("damage_small.json");
    for (case, level) in file["micro_plastic_bond"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|case| LEVELS.map(|level| (case, level)))
    {
        let [c, sy, length] = ["c", "sY", "L"].map(|key| number(&case[key]));
        let (body, horizon) = pair(length);
        let given = [("c", c), ("sY", sy)];
        let energy = remembering((&body, horizon), MICRO_PLASTIC, &given, level);
        let (mut dissipated, mut p) = (0.0, 0.0);
        for row in case["rows"].as_array().unwrap() {
            let row = numbers(row);
            let u = [0.0, 0.0, row[0] * length, 0.0];
            let release = energy.advance(&u, 0.0, (0.0, &u)).unwrap();
            let [state] = energy.states()[..] else { panic!("one bond") };
            let mut forces = vec![0.0; 4];
            let stored = energy.forces(&u, &mut forces).unwrap().total();
            let change: f64 = state - p;
            p = state;
            dissipated += c * sy * length * change.abs();
            // At once and not along the way the bond loses the square of the change, too.
            let lost = c * length * change.abs() * (sy + 0.5 * change.abs());
            let scale = c * length * sy * sy;
            let errors = [
                (state - row[1]) / sy,
                (forces[2] - row[2]) / (c * sy),
                (stored - row[3]) / scale,
                (dissipated - row[4]) / scale,
                (release.dissipated - lost) / scale,
            ];
            assert!(errors.iter().all(|error| error.abs() <= 1e-11), "{row:?} {errors:?}");
            assert_eq!(release.changed, usize::from(change != 0.0));
        }
    }
}

#[test]
fn micro_plastic_clouds_yield_as_elsewhere() {
    let file = reference("damage_small.json");
    let cases = file["micro_plastic_cloud"].as_array().unwrap();
    for (case, level) in cases.iter().flat_map(|case| LEVELS.map(|level| (case, level))) {
        let (body, horizon) = cloud(&file, &case["cloud"]);
        let d = body.dimension();
        let [c, sy] = ["c", "sY"].map(|key| number(&case[key]));
        let text = match case["stretch"].as_str() {
            Some("s") => MICRO_PLASTIC.to_string(),
            _ => MICRO_PLASTIC.replace("s = l/L - 1", "s = 1/2*((l/L)^2 - 1)"),
        };
        let energy = remembering((&body, horizon), &text, &[("c", c), ("sY", sy)], level);
        let neighborhood = Neighborhood::new(&body, horizon).unwrap();
        let u1 = body.from_user_order(&numbers(&case["u1"]), d);
        let mut before = energy.states();
        let mut dissipated = 0.0;
        for step in case["steps"].as_array().unwrap() {
            let u: Vec<f64> = u1.iter().map(|u| number(&step["factor"]) * u).collect();
            energy.advance(&u, 0.0, (0.0, &u)).unwrap();
            let states = energy.states();
            for (bond, (new, old)) in states.iter().zip(&before).enumerate() {
                let [i, j] = neighborhood.ends(bond);
                let (p, q) = (body.position(i), body.position(j));
                let length = p.iter().zip(q).map(|(p, q)| (p - q) * (p - q)).sum::<f64>().sqrt();
                let volumes = body.volumes()[i] * body.volumes()[j];
                dissipated += volumes * c * sy * length * (new - old).abs();
            }
            let all = errors(&energy, &body, &u, step);
            let known = number(&step["dissipated"]);
            let (least, most) =
                states.iter().fold((0.0_f64, 0.0_f64), |(a, b), x| (a.min(*x), b.max(*x)));
            let range = numbers(&step["shat_min_max"]);
            let others = [
                (dissipated - known).abs() / known.max(1e-3),
                (least - range[0].min(0.0)).abs(),
                (most - range[1].max(0.0)).abs(),
            ];
            assert!(all.iter().chain(&others).all(|e| *e <= 1e-11), "{all:?} {others:?}");
            before = states;
        }
    }
}

#[test]
fn softening_bonds_and_clouds_are_those_of_elsewhere() {
    let file = reference("damage_small.json");
    let text = |case: &Value| match case["law"].as_str().unwrap() {
        "bilinear" => BILINEAR,
        _ => EXPONENTIAL,
    };
    let given = |case: &Value| -> Vec<(String, f64)> {
        let all = case["parameters"].as_object().unwrap().iter();
        all.filter(|(key, _)| *key != "L").map(|(key, x)| (key.clone(), number(x))).collect()
    };
    for (case, level) in file["softening_bond"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|case| LEVELS.map(|level| (case, level)))
    {
        let length = number(&case["parameters"]["L"]);
        let (body, horizon) = pair(length);
        let own = given(case);
        let own: Vec<(&str, f64)> = own.iter().map(|(key, x)| (key.as_str(), *x)).collect();
        let energy = remembering((&body, horizon), text(case), &own, level);
        for row in case["rows"].as_array().unwrap() {
            let row = numbers(row);
            let u = [0.0, 0.0, row[0] * length, 0.0];
            energy.advance(&u, 0.0, (0.0, &u)).unwrap();
            let mut forces = vec![0.0; 4];
            let stored = energy.forces(&u, &mut forces).unwrap().total();
            let (force, density) = (number(&case["parameters"]["c"]) * 0.01, 1e-4 * length);
            let mut errors = vec![(forces[2] - row[3]) / force, (stored - row[4]) / density];
            if energy.broken().is_empty() {
                errors.push((energy.states()[0] - row[1]) / 0.01);
            }
            assert!(errors.iter().all(|error| error.abs() <= 1e-11), "{row:?} {errors:?}");
        }
    }
    for (case, level) in file["softening_cloud"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|case| LEVELS.map(|level| (case, level)))
    {
        let (body, horizon) = cloud(&file, &case["cloud"]);
        let own = given(case);
        let own: Vec<(&str, f64)> = own.iter().map(|(key, x)| (key.as_str(), *x)).collect();
        let energy = remembering((&body, horizon), text(case), &own, level);
        let u1 = body.from_user_order(&numbers(&case["u1"]), body.dimension());
        for step in case["steps"].as_array().unwrap() {
            let u: Vec<f64> = u1.iter().map(|u| number(&step["factor"]) * u).collect();
            energy.advance(&u, 0.0, (0.0, &u)).unwrap();
            let found = errors(&energy, &body, &u, step);
            assert!(found.iter().all(|error| *error <= 1e-11), "{found:?}");
            if let Some((_, sc)) = own.iter().find(|(key, _)| *key == "sc") {
                // Those of the step before are broken, the others hold nothing already.
                let gone = energy.states().iter().filter(|k| *k >= sc).count();
                assert_eq!(gone as f64, number(&step["gone"]));
                energy.advance(&u, 0.0, (0.0, &u)).unwrap();
                assert_eq!(energy.counts()[1], gone);
            }
        }
    }
}

#[test]
fn micro_plastic_bodies_move_as_elsewhere_and_their_account_closes() {
    let file = reference("damage_small.json");
    let case = &file["micro_plastic_motion"];
    let (body, horizon) = cloud(&file, &case["cloud"]);
    let d = body.dimension();
    let [c, sy, dt] = ["c", "sY", "dt"].map(|key| number(&case[key]));
    let steps = number(&case["steps"]) as usize;
    let masses: Vec<f64> = body.volumes().iter().map(|v| number(&case["rho"]) * v).collect();
    let given = [("c", c), ("sY", sy)];
    let settings = MotionSettings {
        end: dt * steps as f64,
        step: Some(dt),
        rows: steps,
        ..MotionSettings::default()
    };
    let initial = || Initial {
        displacements: vec![0.0; d * body.n_points()],
        velocities: body.from_user_order(&numbers(&case["v0"]), d),
    };
    let (drive, watch) = (Conditions::default(), Watch::default());
    let states = case["states"].as_array().unwrap();
    for level in LEVELS {
        let energy = remembering((&body, horizon), MICRO_PLASTIC, &given, level);
        let again = remembering((&body, horizon), MICRO_PLASTIC, &given, level);
        let mut motion =
            Motion::new(&energy, &masses, initial(), &drive, &settings, &watch).unwrap();
        let mut resumed: Option<Motion<'_>> = None;
        let scale = |key: &str| {
            states.iter().map(|state| largest(&numbers(&state[key]))).fold(0.0, f64::max)
        };
        let first = number(&states[0]["kinetic"]);
        let mut worst = [0.0_f64; 5];
        for step in 0..=steps {
            let row = go(&mut motion, step);
            worst[0] = worst[0].max(row.rounding.abs() / first);
            worst[1] = worst[1].max(row.quadrature.abs() / first);
            if let Some(state) = states.iter().find(|state| state["step"] == step) {
                let present = motion.state();
                let u = body.to_user_order(present.displacements, d);
                worst[2] = worst[2].max(off(&u, &numbers(&state["u"]), scale("u")));
                if step > 0 {
                    let v = body.to_user_order(present.velocities, d);
                    worst[3] = worst[3].max(off(&v, &numbers(&state["v"]), scale("v")));
                }
                let stored = (row.energy.total() - number(&state["stored"])).abs() / first;
                worst[4] = worst[4].max(stored);
            }
            if step == steps / 2 {
                let Snapshot { arrays, notes } = motion.snapshot();
                let arrays = arrays.map(|array| array.into_owned().into());
                let snapshot = Snapshot { arrays, notes: notes.into_owned().into() };
                let taken_up =
                    Motion::resume(&again, &masses, &drive, &settings, &watch, snapshot).unwrap();
                resumed = Some(taken_up);
            } else if let Some(resumed) = &mut resumed {
                assert_eq!(go(resumed, step), row, "a motion that was taken up");
                assert_eq!(resumed.state().displacements, motion.state().displacements);
            }
        }
        println!("account, quadrature, u, v, stored {worst:?}");
        assert!(worst[0] <= 1e-12, "{worst:?}");
        assert!(worst[1] <= 1e-3, "the integrator's error alone: {worst:?}");
        assert!(worst[2..].iter().all(|error| *error <= 1e-11), "{worst:?}");
        assert_eq!(again.states(), energy.states());
    }
}

/// Products with the Hessian at what bonds remember, against differences of forces.
#[test]
fn tangents_are_those_of_what_bonds_remember() {
    let file = reference("damage_small.json");
    let case = &file["micro_plastic_cloud"][0];
    let (body, horizon) = cloud(&file, &case["cloud"]);
    let given = [("c", number(&case["c"])), ("sY", number(&case["sY"]))];
    let energy = remembering((&body, horizon), MICRO_PLASTIC, &given, Level::Fast);
    let u = body.from_user_order(&numbers(&case["u1"]), body.dimension());
    energy.advance(&u, 0.0, (0.0, &u)).unwrap();
    let p: Vec<f64> = (0..u.len()).map(|k| ((k * k + 3) % 17) as f64 / 8.0 - 1.0).collect();
    let forces = |h: f64| {
        let moved: Vec<f64> = u.iter().zip(&p).map(|(u, p)| u + h * p).collect();
        let mut forces = vec![0.0; u.len()];
        energy.forces(&moved, &mut forces).unwrap();
        forces
    };
    let h = 1e-5;
    let [plus, minus] = [forces(h), forces(-h)];
    let differences: Vec<f64> = plus.iter().zip(&minus).map(|(a, b)| (a - b) / (2.0 * h)).collect();
    let mut product = vec![0.0; u.len()];
    energy.hessian(&u).unwrap().multiply(&p, &mut product);
    let scale = largest(&differences);
    let error = off(&product, &differences, scale);
    assert!(error <= 1e-7, "{error:e}");
    let mut tangent = piola_runtime::matrix::BlockMatrix::zeros(energy.pattern());
    let mut at = vec![0.0; u.len()];
    energy.tangent(&u, &mut at, &mut tangent).unwrap();
    let stored = tangent.multiply(&p);
    assert!(off(&product, &stored, scale) <= 1e-13);
}

/// Every potential of the library whose bonds remember, after some history: forces are derivatives of the
/// energy, the tangent is theirs and symmetric, momenta balance, and a turned body has the same energy.
#[test]
fn potentials_of_the_library_that_remember_have_one_energy() {
    let file = reference("damage_small.json");
    let case = &file["micro_plastic_cloud"][0];
    let (body, horizon) = cloud(&file, &case["cloud"]);
    let u1 = body.from_user_order(&numbers(&case["u1"]), 3);
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../potentials");
    let softening = [("K", 1e3), ("Gc", 5.0), ("s0", 0.03)];
    let (plastic, tired) = ([("K", 1e3), ("sY", 0.02)], [("K", 1e3), ("Gc", 5.0), ("rate", 1.0)]);
    for (name, parameters, dt) in [
        ("bilinear_softening", &softening[..], 0.0),
        ("exponential_softening", &softening, 0.0),
        ("micro_plastic", &plastic, 0.0),
        ("fatigue", &tired, 0.1),
    ] {
        let text = std::fs::read_to_string(format!("{folder}/{name}.piola")).unwrap();
        for level in LEVELS {
            let energy = remembering((&body, horizon), &text, parameters, level);
            let before = energy.states();
            let [far, near] = [1.0, 0.8].map(|f| u1.iter().map(|u| f * u).collect::<Vec<f64>>());
            let release = energy.advance(&far, dt, (0.0, &far)).unwrap();
            assert!(release.changed > 0 && energy.states() != before, "{name} remembers");
            assert!(release.dissipated >= 0.0, "{name} creates no energy");
            let stored = |u: &[f64]| energy.energy(u).unwrap().total();
            let mut tangent = piola_runtime::matrix::BlockMatrix::zeros(energy.pattern());
            let mut forces = vec![0.0; near.len()];
            energy.tangent(&near, &mut forces, &mut tangent).unwrap();
            let scale = largest(&forces);
            let p: Vec<f64> =
                (0..near.len()).map(|k| ((k * k + 3) % 17) as f64 / 8.0 - 1.0).collect();
            let q: Vec<f64> =
                (0..near.len()).map(|k| ((7 * k + 1) % 13) as f64 / 6.0 - 1.0).collect();
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let moved = |h: f64| near.iter().zip(&p).map(|(u, p)| u + h * p).collect::<Vec<f64>>();
            let h = 1e-6;
            let power = (stored(&moved(h)) - stored(&moved(-h))) / (2.0 * h);
            assert!((power - dot(&forces, &p)).abs() <= 1e-7 * scale * near.len() as f64, "{name}");
            let (of_p, of_q) = (tangent.multiply(&p), tangent.multiply(&q));
            let skew = (dot(&of_p, &q) - dot(&of_q, &p)).abs();
            assert!(skew <= 1e-13 * largest(&of_p) * near.len() as f64, "{name}: {skew:e}");
            for axis in 0..3 {
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                let points = 0..body.n_points();
                let sum: f64 = points.clone().map(|i| forces[3 * i + axis]).sum();
                let x = |i: usize, k: usize| body.position(i)[k] + near[3 * i + k];
                let turn: f64 =
                    points.map(|i| x(i, a) * forces[3 * i + b] - x(i, b) * forces[3 * i + a]).sum();
                assert!(sum.abs().max(turn.abs()) <= 1e-13 * scale * near.len() as f64, "{name}");
            }
            let (sine, cosine) = (0.6, 0.8);
            let turned: Vec<f64> = (0..body.n_points())
                .flat_map(|i| {
                    let rest = body.position(i);
                    let x: [f64; 3] = std::array::from_fn(|k| rest[k] + near[3 * i + k]);
                    let y = [cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1], x[2]];
                    std::array::from_fn::<f64, 3, _>(|k| y[k] - rest[k])
                })
                .collect();
            let all = stored(&near);
            assert!((stored(&turned) - all).abs() <= 1e-11 * all, "{name}");
        }
    }
}
