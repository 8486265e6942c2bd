//! Extension of a square and of a cube by 100 % against two independent implementations
//! (cpd_extension.json): energy, reactions and displacements of every stable equilibrium.

use serde_json::Value;

use crate::examples::{self, Finished};
use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{energy_part, number, numbers, reference};

/// Relative error of energies and reactions.
const FORCES: f64 = 1e-9;
/// Error of displacements, over a body of size 1.
const DISPLACEMENTS: f64 = 1e-8;

/// Energies without C2 or C3 beside the examples' own values.
const NO_AREAS: &str = "material.parameters.C2=0";
const HOLE: &str = r#"body.remove=["max(abs(X-0.5), max(abs(Y-0.5), abs(Z-0.5))) < 0.2 - 1e-9"]"#;
const ALL_THREE: &str = "material.parameters={ C1 = 1.0, C2 = 1000.0, C3 = 1e6 }";

/// The example and the overrides that make it a case of the reference, told apart by dimension,
/// hole and the coefficients that are not zero.
fn run(case: &Value) -> std::sync::Arc<Finished> {
    let hole = case["hole"].as_bool().unwrap();
    let energies: Vec<bool> = numbers(&case["C"]).iter().map(|c| *c != 0.0).collect();
    let (example, overrides): (&str, &[&str]) = match (number(&case["D"]), hole, &energies[..]) {
        (2.0, false, [true, false, false]) => ("square", &[NO_AREAS]),
        (2.0, false, [true, true, false]) => ("square", &[]),
        (2.0, true, [true, true, false]) => ("square_with_hole", &[]),
        (3.0, false, [true, false, false]) => ("cube_C1", &[]),
        (3.0, false, [true, false, true]) => ("cube_C1_C3", &[]),
        (3.0, true, [true, true, true]) => ("cube_C1_C3", &[HOLE, ALL_THREE]),
        _ => panic!("no example for {case}"),
    };
    examples::run(example, overrides)
}

/// The step and the frame at `t`.
fn at(run: &Finished, t: f64) -> (&Value, Current) {
    let near = |found: f64| (found - t).abs() < 1e-9;
    let step = run.steps().iter().find(|step| near(number(&step["t"]))).expect("a step there");
    let list = std::fs::read_to_string(run.path().join("run.pvd")).unwrap();
    let frames = read_pvd(&list).unwrap();
    let (_, file) = frames.iter().find(|(found, _)| near(*found)).expect("a frame there");
    let frame = read_vtu(&run.path().join(file)).unwrap();
    let u = frame.array("displacement").unwrap().values.clone();
    (step, Current { rest: frame.positions, u })
}

/// A deformed body, three numbers per point (the third is 0 in the plane).
struct Current {
    rest: Vec<f64>,
    u: Vec<f64>,
}

impl Current {
    /// The point at a reference position.
    fn point(&self, position: [f64; 3]) -> usize {
        let here = |rest: &[f64]| rest.iter().zip(position).all(|(x, p)| (x - p).abs() < 1e-9);
        self.rest.chunks_exact(3).position(here).unwrap_or_else(|| panic!("no {position:?}"))
    }

    fn displacement(&self, position: [f64; 3]) -> &[f64] {
        &self.u[3 * self.point(position)..][..3]
    }

    fn sum_of_squares(&self) -> f64 {
        self.rest.iter().zip(&self.u).map(|(x, u)| (x + u) * (x + u)).sum()
    }

    fn largest_on_the_midplane(&self) -> f64 {
        let rows = self.rest.chunks_exact(3).zip(self.u.chunks_exact(3));
        let middle = rows.filter(|(rest, _)| (rest[0] - 0.5).abs() < 1e-9);
        middle.map(|(_, u)| u[1].abs()).fold(0.0, f64::max)
    }
}

/// The largest errors of a state: of energies and reactions relative to themselves, of places.
fn errors(case: &Value, state: &Value, run: &Finished) -> (f64, f64) {
    let (step, current) = at(run, number(&state["g"]));
    let expected = number(&state["energy"]);
    let mut forces = (number(&step["energy"]) / expected - 1.0).abs();
    for (k, part) in ["psi(l)", "psi(a)", "psi(v)"].into_iter().enumerate() {
        let wanted = state["energy_parts"][(k + 1).to_string()].as_f64().unwrap_or(0.0);
        forces = forces.max((energy_part(step, part) - wanted).abs() / expected);
    }
    for side in ["left", "right"] {
        let wanted = number(&state[format!("reaction_{side}_x")]);
        forces = forces.max((number(&step["reactions"][side][0]) / wanted - 1.0).abs());
    }
    let dimension = number(&case["D"]) as usize;
    let depth = if dimension == 3 { 0.5 } else { 0.0 };
    let clamped = number(&case["layers"]) * number(&case["Delta"]);
    let places = [("x_top_mid", [0.5, 1.0, depth]), ("x_first_free_corner", [clamped, 0.0, 0.0])];
    let largest = number(&state["max_abs_uy_midplane"]);
    let mut displacements = (current.largest_on_the_midplane() - largest).abs();
    for (name, position) in places {
        let u = current.displacement(position);
        for (axis, wanted) in numbers(&state[name]).iter().enumerate() {
            displacements = displacements.max((position[axis] + u[axis] - wanted).abs());
        }
    }
    let squares = (current.sum_of_squares() / number(&state["sum_x2"]) - 1.0).abs();
    (forces, displacements.max(squares))
}

#[test]
fn stable_states_agree_with_two_other_codes() {
    let extension = reference("cpd_extension.json");
    let cases = extension["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 6);
    let mut compared = 0;
    for case in cases {
        let run = run(case);
        let count = |key: &str| case[key].as_u64().unwrap_or(0);
        assert_eq!(run.summary["points"], count("npoints"));
        let found = &run.summary["interactions"];
        for (kind, key) in [("bonds", "nbonds"), ("triangles", "ntri"), ("tetrahedra", "ntet")] {
            assert_eq!(found[kind], count(key), "{kind} of {case}");
        }
        for state in case["states"].as_array().unwrap() {
            if state["positive_definite"] != true {
                continue;
            }
            let (forces, displacements) = errors(case, state, &run);
            let (dimension, c, g) = (&case["D"], &case["C"], &state["g"]);
            println!("{dimension}D C = {c} g = {g}: {forces:.1e}, {displacements:.1e}");
            assert!(forces <= FORCES, "{dimension}D {c} g = {g}: forces {forces:e}");
            assert!(displacements <= DISPLACEMENTS, "{dimension}D {c} g = {g}: {displacements:e}");
            let step = at(&run, number(g)).0;
            assert_eq!(step["positive_definite"], true, "{dimension}D {c} g = {g}");
            compared += 1;
        }
    }
    assert_eq!(compared, 18, "all states of the reference are stable");
}
