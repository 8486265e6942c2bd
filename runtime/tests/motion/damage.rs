//! Bonds that break, step by step as other programs have them (damage_small.json).

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::crack::Crack;
use piola_runtime::fracture::criteria::{Criteria, Criterion, Layer};
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture, Inspection as _};
use piola_runtime::materials::{Interface, Materials};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings, Row};
use piola_runtime::weights::Weights;
use serde_json::Value;

use crate::families::{largest, numbers, reference};
use crate::reference::{conditions, go, number, off, places};
use crate::{Conditions, bonds, cloud, energy};

/// When bonds of the cases break, for a threshold.
fn criteria(text: &str, s0: f64, level: Level, dimension: usize) -> Vec<Criterion> {
    let text = format!("potential p\nparameter s0\npsi(l) = (l/L - 1)^2\nbreak when {text}");
    let (_, model) = check_text(&text).unwrap();
    let settings = [("s0".to_string(), Setting::Number(s0))];
    let values = model.values(dimension, &settings, Some(1.0)).unwrap();
    let found = model.criteria(&values, Mode::Jit(level), Form::Accurate).unwrap();
    let law = |one: piola_compiler::Criterion| Criterion {
        measure: one.measure(),
        holds_at_zero: one.holds_at_zero,
        margin: Box::new(one.margin),
    };
    found.into_iter().map(law).collect()
}

/// A body that breaks by the stretch of its bonds.
pub(crate) fn breaking(
    (body, horizon): (&Arc<Body>, f64),
    energy: Box<dyn Energy>,
    criterion: (&str, f64, Level),
    kept: &[usize],
) -> Breaking {
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).unwrap());
    let (text, s0, level) = criterion;
    let of_law = vec![criteria(text, s0, level, body.dimension())];
    let is_kept = (0..body.n_points()).map(|point| kept.contains(&point)).collect();
    let layers = vec![Layer { of_law, materials: None }];
    let criteria = Criteria::new((body, &neighborhood), layers, is_kept);
    let names = Arc::clone(energy.parts());
    Breaking::new(
        (Arc::clone(body), neighborhood),
        vec![energy],
        names,
        (criteria, Memory::default()),
        Vec::new(),
    )
}

/// Bonds as the file lists them: the user's numbers, ascending.
fn listed(body: &Body, horizon: f64, bonds: &[usize]) -> Vec<[usize; 2]> {
    let neighborhood = Neighborhood::new(body, horizon).unwrap();
    let user = |point: usize| body.user_index()[point] as usize;
    let ends = |bond: &usize| {
        let mut ends = neighborhood.ends(*bond).map(user);
        ends.sort_unstable();
        ends
    };
    let mut all: Vec<[usize; 2]> = bonds.iter().map(ends).collect();
    all.sort_unstable();
    all
}

fn pairs(list: &Value) -> Vec<[usize; 2]> {
    let pair = |pair: &Value| [0, 1].map(|k| pair[k].as_u64().unwrap() as usize);
    let mut all: Vec<[usize; 2]> = list.as_array().unwrap().iter().map(pair).collect();
    all.sort_unstable();
    all
}

/// What is in one list and not in another.
fn beyond(all: &[usize], known: &[usize]) -> Vec<usize> {
    all.iter().copied().filter(|bond| known.binary_search(bond).is_err()).collect()
}

const LEVELS: [Level; 2] = [Level::Fast, Level::Strict];

#[test]
fn bonds_break_on_given_paths_as_elsewhere() {
    let file = reference("damage_small.json");
    let paths = file["prescribed_paths"].as_array().unwrap();
    assert_eq!(paths.len(), 2);
    let criteria = [("l/L - 1 > s0", 1), ("(l/L)^2 > (1 + s0)^2", 2), ("not l <= L*(1 + s0)", 1)];
    for (path, level) in paths.iter().flat_map(|path| LEVELS.map(|level| (path, level))) {
        for (text, n) in criteria {
            let (body, horizon) = cloud(&file, &path["cloud"]);
            let d = body.dimension();
            let laws = bonds::laws([number(&path["c"]), 0.0, 0.0], 1);
            let energy = DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Volumes, laws);
            let s0 = number(&path["s0"]);
            let energy =
                breaking((&body, horizon), Box::new(energy.unwrap()), (text, s0, level), &[]);
            let u1 = body.from_user_order(&numbers(&path["u1"]), d);
            let mut released = 0.0;
            let mut known = Vec::new();
            for step in path["steps"].as_array().unwrap() {
                let u: Vec<f64> = u1.iter().map(|u| number(&step["factor"]) * u).collect();
                let release = energy.advance(&u, 0.0, (0.0, &u)).unwrap();
                released += release.energy;
                let broken = energy.broken();
                let new = listed(&body, horizon, &beyond(&broken, &known));
                assert_eq!(new, pairs(&step["newly_broken"]), "{text} {n}");
                assert_eq!(new.len(), release.bonds);
                known = broken;
                let total = number(&step["broken_total"]) as usize;
                assert_eq!(energy.counts()[1], total);
                let mut forces = vec![0.0; u.len()];
                let stored = energy.forces(&u, &mut forces).unwrap().total();
                let expected = numbers(&step["force"]);
                let scale = largest(&expected).max(1e-3);
                let found = body.to_user_order(&forces, d);
                let found: Vec<f64> = found.iter().map(|g| -g).collect();
                let errors = [
                    off(&found, &expected, scale),
                    (stored - number(&step["stored"])).abs() / number(&step["stored"]).max(1e-3),
                    (released - number(&step["stored_in_broken_at_break"])).abs()
                        / released.max(1e-3),
                    off(
                        &body.to_user_order(&energy.damage(), 1),
                        &numbers(&step["damage_volume"]),
                        1.0,
                    ),
                ];
                assert!(errors.iter().all(|error| *error <= 1e-11), "{errors:?}");
            }
        }
    }
}

#[test]
fn bonds_break_in_motion_as_elsewhere() {
    let file = reference("damage_small.json");
    let cases = file["explicit_with_breaking"].as_array().unwrap();
    let known =
        |case: &&Value| ["BB", "LPS", "CC"].iter().any(|name| case["model"]["model"] == *name);
    let mut count = 0;
    for (case, level) in
        cases.iter().filter(known).flat_map(|case| LEVELS.map(|level| (case, level)))
    {
        count += 1;
        let name = case["name"].as_str().unwrap();
        let (body, horizon) = cloud(&file, &case["cloud"]);
        let d = body.dimension();
        let place = places(&body);
        let kept: Vec<usize> =
            numbers(&case["no_fail"]).iter().map(|point| place[*point as usize]).collect();
        let s0 = number(&case["s0"]);
        let whole = energy(&case["model"], &body, horizon);
        let energy = breaking((&body, horizon), whole, ("l/L - 1 > s0", s0, level), &kept);
        let mut given = case.clone();
        given["pres"] = serde_json::json!({
            "points": case["moved"],
            "components": (0..d).collect::<Vec<_>>(),
            "velocity": case["velocity"],
        });
        let drive = conditions(&given, &body);
        let density = number(&case["rho"]);
        let masses: Vec<f64> = body.volumes().iter().map(|v| density * v).collect();
        let (dt, steps) = (number(&case["dt"]), number(&case["steps"]) as usize);
        let settings = MotionSettings {
            end: dt * steps as f64,
            step: Some(dt),
            rows: steps,
            ..MotionSettings::default()
        };
        let initial = Initial {
            displacements: vec![0.0; d * body.n_points()],
            velocities: body.from_user_order(&numbers(&case["v0"]), d),
        };
        let watch = Watch::default();
        let mut motion = Motion::new(&energy, &masses, initial, &drive, &settings, &watch).unwrap();
        let states = case["states"].as_array().unwrap();
        let scale = |key: &str| {
            states.iter().map(|state| largest(&numbers(&state[key]))).fold(0.0, f64::max)
        };
        let (u_scale, v_scale) = (scale("u"), scale("v"));
        let mut lists = case["broken_bonds"].as_array().unwrap().iter().peekable();
        let mut known = Vec::new();
        let mut worst = [0.0_f64; 4];
        for step in 0..=steps {
            let row = go(&mut motion, step);
            let broken = energy.broken();
            let new = listed(&body, horizon, &beyond(&broken, &known));
            known = broken;
            let expected = match lists.next_if(|list| list[0].as_u64() == Some(step as u64)) {
                Some(list) => pairs(&list[1]),
                None => Vec::new(),
            };
            assert_eq!(new, expected, "{name} at step {step}");
            assert_eq!(row.broken, Some(known.len()));
            let all = row.kinetic.max(row.energy.total()).max(row.prescribed.abs());
            worst[0] = worst[0].max(row.rounding.abs() / all.max(row.released));
            // The integrator's error alone: nothing of what breaking released is in it.
            worst[3] = worst[3].max(row.quadrature.abs() / all.max(row.released));
            if let Some(state) = states.iter().find(|state| state["step"] == step) {
                let present = motion.state();
                let u = body.to_user_order(present.displacements, d);
                worst[1] = worst[1].max(off(&u, &numbers(&state["u"]), u_scale));
                if step > 0 {
                    let v = body.to_user_order(present.velocities, d);
                    worst[2] = worst[2].max(off(&v, &numbers(&state["v"]), v_scale));
                }
                let lost = number(&state["energy_lost_in_breaking"]);
                assert!((row.released - lost).abs() <= 1e-11 * all.max(lost), "{name}: {lost}");
            }
        }
        assert!(lists.next().is_none(), "{name}");
        println!("{name}: account, u, v, quadrature {worst:?}");
        assert!(worst[0] <= 1e-12 && worst[1] <= 1e-11 && worst[2] <= 1e-11, "{name} {worst:?}");
    }
    assert_eq!(count, 8);
}

/// The bonds that cracks cut of lattices, by rational arithmetic.
#[test]
fn cracks_cut_the_bonds_that_cross_them() {
    let file = reference("damage_small.json");
    let cases = file["pre_cracks"].as_array().unwrap();
    assert_eq!(cases.len(), 3);
    let rational = |value: &Value| -> f64 {
        let text = value.as_str().unwrap();
        match text.split_once('/') {
            Some((p, q)) => p.parse::<f64>().unwrap() / q.parse::<f64>().unwrap(),
            None => text.parse().unwrap(),
        }
    };
    for case in cases {
        let counts = numbers(&case["lattice"]["points"]);
        let spacing = rational(&case["lattice"]["spacing"]);
        let horizon = rational(&case["delta"]);
        let d = counts.len();
        let mut positions = Vec::new();
        let n: usize = counts.iter().map(|count| *count as usize).product();
        for mut number in 0..n {
            let mut place = vec![0.0; d];
            for axis in (0..d).rev() {
                let count = counts[axis] as usize;
                place[axis] = spacing * (number % count) as f64;
                number /= count;
            }
            positions.extend(place);
        }
        let body = Body::new(d, &positions, &vec![1.0; n], Some(spacing));
        let neighborhood = Neighborhood::new(&body, horizon).unwrap();
        assert_eq!(neighborhood.n_bonds(), number(&case["bonds"]) as usize);
        let crack = if d == 2 {
            let end = |k: usize| [0, 1].map(|axis| rational(&case["segment"][k][axis]));
            Crack::Segment([end(0), end(1)])
        } else {
            let [z, x0, x1] = [
                rational(&case["rectangle"]["z"]),
                rational(&case["rectangle"]["x"][0]),
                rational(&case["rectangle"]["x"][1]),
            ];
            let (y0, y1) = (-1.0, 1.0);
            Crack::Polygon(vec![[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
        };
        crack.check().unwrap();
        let cut = crack.cut(&body, &neighborhood);
        assert_eq!(listed(&body, horizon, &cut.bonds), pairs(&case["cut"]));
        let touching = case["touching"].as_array().unwrap().len();
        assert_eq!(cut.through_front + cut.touching, touching);
    }
}

/// Two materials with thresholds of their own, and bonds between them that are those of the first.
#[test]
fn bonds_between_materials_break_as_elsewhere() {
    let file = reference("two_materials.json");
    let cases = file["explicit_with_breaking"].as_array().unwrap();
    assert_eq!(cases.len(), 2);
    for case in cases {
        let (body, horizon) = cloud(&file, &case["cloud"]);
        let d = body.dimension();
        let name = case["cloud"].as_str().unwrap();
        let of_user = numbers(&file["clouds"][name]["material"]);
        let of_point: Vec<u8> =
            body.user_index().iter().map(|user| of_user[*user as usize] as u8).collect();
        let first = Interface::As { counts: 1, as_material: 0 };
        let materials = Arc::new(Materials::new(of_point.clone(), vec![first]));
        let [c, s0, rho] = ["c", "s0", "rho"].map(|key| numbers(&case[key]));
        let elements = [0, 1].map(|k| bonds::laws([c[k], 0.0, 0.0], 1).into_elements(d));
        let neighborhood = Arc::new(Neighborhood::new(&body, horizon).unwrap());
        let energy = DiscreteEnergy::of_materials(
            Arc::clone(&body),
            Arc::clone(&neighborhood),
            Weights::Volumes,
            Some(Arc::clone(&materials)),
            elements.into(),
        );
        let of_law = s0.iter().map(|s0| criteria("l/L - 1 > s0", *s0, Level::Fast, d)).collect();
        let layers = vec![Layer { of_law, materials: Some(materials) }];
        let criteria = Criteria::new((&body, &neighborhood), layers, vec![false; body.n_points()]);
        let energy: Box<dyn Energy> = Box::new(energy.unwrap());
        let (names, around) = (Arc::clone(energy.parts()), (Arc::clone(&body), neighborhood));
        let energy =
            Breaking::new(around, vec![energy], names, (criteria, Memory::default()), Vec::new());
        let masses: Vec<f64> =
            body.volumes().iter().zip(&of_point).map(|(v, k)| rho[usize::from(*k)] * v).collect();
        let (dt, steps) = (number(&case["dt"]), number(&case["steps"]) as usize);
        let (end, step) = (dt * steps as f64, Some(dt));
        let settings = MotionSettings { end, step, rows: steps, ..MotionSettings::default() };
        let initial = Initial {
            displacements: vec![0.0; d * body.n_points()],
            velocities: body.from_user_order(&numbers(&case["v0"]), d),
        };
        let loads = vec![0.0; d * body.n_points()];
        let drive = Conditions { loads, ..Conditions::default() };
        let watch = Watch::default();
        let mut motion = Motion::new(&energy, &masses, initial, &drive, &settings, &watch).unwrap();
        let mut lists = case["broken_bonds"].as_array().unwrap().iter().peekable();
        let mut known = Vec::new();
        let states = case["states"].as_array().unwrap();
        let most = states.iter().map(|state| largest(&numbers(&state["u"]))).fold(0.0, f64::max);
        for step in 0..=steps {
            let row = go(&mut motion, step);
            let broken = energy.broken();
            let new = listed(&body, horizon, &beyond(&broken, &known));
            known = broken;
            let expected = match lists.next_if(|list| list[0].as_u64() == Some(step as u64)) {
                Some(list) => pairs(&list[1]),
                None => Vec::new(),
            };
            assert_eq!(new, expected, "{name} at step {step}");
            assert!(row.rounding.abs() <= 1e-12 * row.kinetic.max(row.released), "{name}");
            if let Some(state) = states.iter().find(|state| state["step"] == step) {
                let u = body.to_user_order(motion.state().displacements, d);
                assert!(off(&u, &numbers(&state["u"]), most) <= 1e-11, "{name} at step {step}");
                let lost = number(&state["energy_lost_in_breaking"]);
                assert!((row.released - lost).abs() <= 1e-11 * row.kinetic.max(lost), "{name}");
            }
        }
        assert!(lists.next().is_none(), "{name}");
    }
}

/// Bodies of which a rule has broken bonds: the whole model on the smaller families.
#[test]
fn models_on_smaller_families_are_those_of_elsewhere() {
    let file = reference("damage_small.json");
    let mut tried = 0;
    for mask in file["masks"].as_array().unwrap() {
        let (body, horizon) = cloud(&file, &mask["cloud"]);
        let d = body.dimension();
        let neighborhood = Neighborhood::new(&body, horizon).unwrap();
        let user = |point: usize| body.user_index()[point] as usize;
        let is_broken = |bond: &usize| {
            let mut ends = neighborhood.ends(*bond).map(user);
            ends.sort_unstable();
            (7 * ends[0] + 13 * ends[1]) % 10 == 0
        };
        let broken: Vec<usize> = (0..neighborhood.n_bonds()).filter(is_broken).collect();
        assert_eq!(broken.len(), number(&mask["broken"]) as usize);
        let u = body.from_user_order(&numbers(&mask["u"]), d);
        for row in mask["rows"].as_array().unwrap() {
            let mut energy = energy(&row["model"], &body, horizon);
            tried += 1;
            // In two parts, as bonds break.
            energy.lose(&broken[..7]);
            energy.lose(&broken[7..]);
            let mut forces = vec![0.0; u.len()];
            let stored = energy.forces(&u, &mut forces).unwrap().total();
            let expected = numbers(&row["force"]);
            let found: Vec<f64> = body.to_user_order(&forces, d).iter().map(|g| -g).collect();
            let errors = [
                off(&found, &expected, largest(&expected)),
                (stored / number(&row["stored"]) - 1.0).abs(),
            ];
            println!("{}: {errors:?}", row["model"]);
            assert!(errors.iter().all(|error| *error <= 1e-11), "{} {errors:?}", row["model"]);
        }
    }
    assert_eq!(tried, 6);
}

/// The bonds that broke in each step.
type Lists = Vec<(usize, Vec<usize>)>;

/// A body of bonds in free flight whose points part, in units of `length` m, `time` s and `mass` kg.
fn apart([length, time, mass]: [f64; 3], s0: f64) -> (Lists, Vec<Row>, Vec<f64>) {
    let file = reference("damage_small.json");
    let cloud = &file["clouds"]["solid"];
    let scaled = |values: Vec<f64>, by: f64| values.iter().map(|x| x * by).collect::<Vec<f64>>();
    let volume = length * length * length;
    let (positions, volumes) =
        (scaled(numbers(&cloud["X"]), length), scaled(numbers(&cloud["V"]), volume));
    let body = Arc::new(Body::new(3, &positions, &volumes, None));
    let horizon = number(&cloud["delta"]) * length;
    // psi is in J/m^6, C L s^2/2.
    let c = 11000.0 * mass * length * length / (time * time) / (volume * volume * length);
    let laws = bonds::laws([c, 0.0, 0.0], 1);
    let energy = DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Volumes, laws).unwrap();
    let energy =
        breaking((&body, horizon), Box::new(energy), ("l/L - 1 > s0", s0, Level::Fast), &[]);
    let n = body.n_points();
    // From the middle outwards, a little faster with every point.
    let speed = 2.0 * length / time;
    let start: Vec<f64> = (0..3 * n)
        .map(|dof| {
            let x = body.positions()[dof] / length;
            speed * (x - 0.4) * (1.0 + 0.01 * ((dof / 3) as f64))
        })
        .collect();
    let masses: Vec<f64> = volumes.iter().map(|v| 8.0 * mass * v / volume).collect();
    let masses = body.from_user_order(&masses, 1);
    let steps = 300;
    let settings = MotionSettings {
        end: 0.004 * time * steps as f64,
        step: Some(0.004 * time),
        rows: steps,
        ..MotionSettings::default()
    };
    let initial = Initial { displacements: vec![0.0; 3 * n], velocities: start };
    let drive = Conditions { loads: vec![0.0; 3 * n], ..Conditions::default() };
    let watch = Watch::default();
    let mut motion = Motion::new(&energy, &masses, initial, &drive, &settings, &watch).unwrap();
    let (mut lists, mut rows, mut known) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..=steps {
        rows.push(go(&mut motion, step));
        let broken = energy.broken();
        lists.push((step, beyond(&broken, &known)));
        known = broken;
    }
    (lists, rows, energy.damage())
}

/// All bonds of a body break, the last one of every point too: its dust flies on, and the account closes.
#[test]
fn a_body_may_break_into_dust() {
    let (lists, rows, damage) = apart([1.0; 3], 0.06);
    let count: usize = lists.iter().map(|(_, new)| new.len()).sum();
    let last = rows.last().unwrap();
    assert!(damage.iter().all(|d| *d == 1.0) && last.broken == Some(count));
    assert_eq!(last.energy.total(), 0.0);
    for row in &rows {
        assert!(row.rounding.abs() <= 1e-12 * row.kinetic.max(row.released), "{}", row.rounding);
    }
    // Nothing pulls any more: momentum is what it was, and energy too, but for what was released.
    let gone = rows.iter().position(|row| row.energy.total() == 0.0 && row.step > 0).unwrap();
    assert!(rows[gone..].iter().all(|row| (row.kinetic / last.kinetic - 1.0).abs() < 1e-13));
}

/// Thresholds of all sizes: everything breaks as soon as it moves, or nothing ever does.
#[test]
fn thresholds_may_have_any_size() {
    let (lists, rows, damage) = apart([1.0; 3], 1e-15);
    assert!(lists[1].1.len() > 400 && damage.iter().all(|d| *d == 1.0));
    assert!(rows.iter().all(|row| row.rounding.abs() <= 1e-12 * row.kinetic));
    let (lists, rows, damage) = apart([1.0; 3], 1e15);
    assert!(lists.iter().all(|(_, new)| new.is_empty()) && damage.iter().all(|d| *d == 0.0));
    assert!(rows.iter().all(|row| row.released == 0.0 && row.timing == 0.0));
}

/// In nanometres and in gigametres the same bonds break at the same steps, and the bits of what they release
/// are the same up to the power of two that energies are multiplied by.
#[test]
fn scaling_by_powers_of_two_breaks_the_same_bonds() {
    let power = |k: i32| libm::ldexp(1.0, k);
    let known = apart([1.0; 3], 0.06);
    for [length, time, mass] in [[-30, -40, -20], [30, 40, 20], [-80, 3, 0], [80, 0, 5]] {
        let found = apart([power(length), power(time), power(mass)], 0.06);
        assert_eq!(found.0, known.0);
        let energy = power(mass + 2 * length - 2 * time);
        for (found, known) in found.1.iter().zip(&known.1) {
            assert_eq!(found.released, known.released * energy);
            assert_eq!(found.timing, known.timing * energy);
        }
    }
}
