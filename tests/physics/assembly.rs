//! The laws that every discrete energy obeys, for every potential of the library through the whole
//! program: derivatives that are exact, momentum, objectivity, units, sources of derivatives.

use crate::subjects::{Material, Subject, bodies, materials};
use crate::support::{Outcome, U, dense_tangent, distance, energy_part, norm, number, numbers};
use crate::witness::{State, Witness};

/// Every potential on every body that it can be tried on.
fn for_each_subject(mut work: impl FnMut(&Material, &Subject, &str)) {
    let of_dimension = [bodies(2), bodies(3)];
    for material in materials() {
        for body in &of_dimension[material.dimension - 2] {
            if material.potential == "tension_only" && !body.is_pulled() {
                continue; // there is no energy to compare
            }
            let label = format!("{}, {}", material.label(), body.label);
            work(&material, body, &label);
        }
    }
}

/// What the program says about a state.
fn state(body: &Subject, material: &Material, u: &[f64], scale: f64, more: &[&str]) -> State {
    let found = body.energy(&body.folder(material, scale), u, scale, more).json();
    let parts = ["psi(l)", "psi(a)", "psi(v)"].map(|part| energy_part(&found, part));
    assert_eq!(number(&found["energy"]), parts.iter().sum::<f64>());
    let gradient = numbers(&found["gradient"]);
    State { parts, gradient, tangent: dense_tangent(&found) }
}

/// The largest relative errors of energy, forces and of any column of the tangent.
fn errors(found: &State, expected: &State) -> [f64; 3] {
    let n = expected.gradient.len();
    let columns = found.tangent.chunks_exact(n).zip(expected.tangent.chunks_exact(n));
    [
        (found.energy() / expected.energy() - 1.0).abs(),
        distance(&found.gradient, &expected.gradient),
        columns.map(|(found, expected)| distance(found, expected)).fold(0.0, f64::max),
    ]
}

fn larger(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k].max(b[k]))
}

#[test]
fn forces_and_tangent_are_the_derivatives_of_the_total_energy() {
    // In units of rounding as the body magnifies it: positions of a nearly flat triangle or
    // tetrahedron, rounded, change its area or volume.
    const TOLERANCE: f64 = 16.0 * U;
    let mut worst = [0.0; 3];
    for_each_subject(|material, body, label| {
        let model = material.model();
        let values = material.values(&model, body.horizon);
        let witness = Witness::new(&body.points, body.horizon, body.weights, &model, &values);
        let expected = witness.state(&body.u);
        let found = state(body, material, &body.u, 1.0, &[]);
        for k in 0..3 {
            let modelled = material.modelled[k];
            assert_eq!(
                found.parts[k] > 1e-3 * found.energy(),
                modelled,
                "{label} {:?}",
                found.parts
            );
            let error = (found.parts[k] - expected.parts[k]).abs();
            assert!(error <= 64.0 * U * expected.energy(), "{label} part {k}: {error:e}");
        }
        let errors = errors(&found, &expected)
            .map(|error| error / (body.magnification * material.magnification()));
        worst = larger(worst, errors);
        assert!(errors.iter().all(|error| *error <= TOLERANCE), "{label}: {errors:?}");
    });
    println!("energy, forces, columns of the tangent over rounding: {:?}", worst.map(|x| x / U));
}

#[test]
fn forces_and_moments_sum_to_zero() {
    // In units of rounding of the sums of absolute values.
    const TOLERANCE: f64 = 5.0 * U;
    let mut worst = [0.0_f64; 2];
    for_each_subject(|material, body, label| {
        let found = state(body, material, &body.u, 1.0, &[]);
        let d = material.dimension;
        let now: Vec<f64> = body.points.positions.iter().zip(&body.u).map(|(x, u)| x + u).collect();
        let (mut force, mut moment) = ([0.0; 3], [0.0; 3]);
        let (mut force_scale, mut moment_scale) = (0.0, 0.0);
        for (x, f) in now.chunks_exact(d).zip(found.gradient.chunks_exact(d)) {
            let [x, f] = [x, f].map(|v| std::array::from_fn(|k| v.get(k).copied().unwrap_or(0.0)));
            let turning: [f64; 3] = cross(&x, &f);
            for axis in 0..3 {
                force[axis] += f[axis];
                moment[axis] += turning[axis];
            }
            force_scale += norm(&f);
            moment_scale += norm(&f) * norm(&x);
        }
        let errors = [norm(&force) / force_scale, norm(&moment) / moment_scale];
        worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
        assert!(errors.iter().all(|error| *error <= TOLERANCE), "{label}: {errors:?}");
    });
    println!("net force, net moment: {worst:?}");
}

fn cross(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

/// A rotation by 2 rad about a skew axis, or in the plane, row by row.
fn rotation(dimension: usize) -> Vec<f64> {
    let (sine, cosine) = (libm::sin(2.0), libm::cos(2.0));
    if dimension == 2 {
        return vec![cosine, -sine, sine, cosine];
    }
    let a = [2.0 / 7.0, 3.0 / 7.0, 6.0 / 7.0];
    let skew = [0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0];
    let entry = |k: usize| {
        let unit = if k / 3 == k % 3 { cosine } else { 0.0 };
        unit + sine * skew[k] + (1.0 - cosine) * a[k / 3] * a[k % 3]
    };
    (0..9).map(entry).collect()
}

fn rotate(matrix: &[f64], rows: &[f64], d: usize) -> Vec<f64> {
    let turn = |x: &[f64]| -> Vec<f64> {
        (0..d).map(|r| (0..d).map(|c| matrix[r * d + c] * x[c]).sum()).collect()
    };
    rows.chunks_exact(d).flat_map(turn).collect()
}

#[test]
fn a_rotation_of_the_strained_body_turns_the_forces_and_keeps_the_energy() {
    // As above; the turned displacements are as large as the body, and rounded.
    const TOLERANCE: f64 = 32.0 * U;
    let mut worst = [0.0_f64; 3];
    for_each_subject(|material, body, label| {
        let d = material.dimension;
        let matrix = rotation(d);
        let rest = &body.points.positions;
        let now: Vec<f64> = rest.iter().zip(&body.u).map(|(x, u)| x + u).collect();
        let turned: Vec<f64> =
            rotate(&matrix, &now, d).iter().zip(rest).map(|(x, rest)| x - rest).collect();
        let before = state(body, material, &body.u, 1.0, &[]);
        let after = state(body, material, &turned, 1.0, &[]);
        // The tangent turns from both sides: R K R^T block by block. It is symmetric, so turning
        // the rows, transposing and turning the rows again does it.
        let n = rest.len();
        let half = transposed(&rotate(&matrix, &before.tangent, d), n);
        let expected = State {
            parts: before.parts,
            gradient: rotate(&matrix, &before.gradient, d),
            tangent: rotate(&matrix, &half, d),
        };
        let errors = errors(&after, &expected)
            .map(|error| error / (body.magnification * material.magnification()));
        worst = larger(worst, errors);
        assert!(errors.iter().all(|error| *error <= TOLERANCE), "{label}: {errors:?}");
    });
    println!("energy, forces, columns of the tangent over rounding: {:?}", worst.map(|x| x / U));
}

fn transposed(matrix: &[f64], n: usize) -> Vec<f64> {
    (0..n * n).map(|k| matrix[k % n * n + k / n]).collect()
}

#[test]
fn millimetres_give_the_same_results_as_metres() {
    // On lattices: a cloud's nearly flat triangles magnify the rounding of its coordinates in mm.
    const TOLERANCE: f64 = 1.5e-14;
    const MILLIMETRES: f64 = 1e3;
    let mut worst = [0.0_f64; 3];
    for_each_subject(|material, body, label| {
        if body.points.spacing.is_none() {
            return;
        }
        let metres = state(body, material, &body.u, 1.0, &[]);
        let mut other = state(body, material, &body.u, MILLIMETRES, &[]);
        other.gradient.iter_mut().for_each(|force| *force *= MILLIMETRES);
        other.tangent.iter_mut().for_each(|entry| *entry *= MILLIMETRES * MILLIMETRES);
        let errors = errors(&other, &metres);
        worst = larger(worst, errors);
        assert!(errors.iter().all(|error| *error <= TOLERANCE), "{label}: {errors:?}");
    });
    println!("energy, forces, columns of the tangent over rounding: {:?}", worst.map(|x| x / U));
}

#[test]
fn parameters_with_units_are_converted() {
    for_each_subject(|material, body, label| {
        if body.points.spacing.is_none() {
            return;
        }
        let plain = state(body, material, &body.u, 1.0, &[]);
        let with_units: Vec<String> = material
            .parameters
            .iter()
            .map(|(name, value, lengths)| match lengths {
                0 => format!("{name} = {value:?}"),
                _ if *name == "C2" => format!("{name} = \"{:?} kJ/m^{lengths}\"", value / 1000.0),
                k => {
                    let power = (0..*k).fold(1.0, |power, _| power * 1e3);
                    format!("{name} = \"{:?} J/mm^{k}\"", value / power)
                }
            })
            .collect();
        let setting = format!("material.parameters={{ {} }}", with_units.join(", "));
        let converted = state(body, material, &body.u, 1.0, &["--set", &setting]);
        let errors = errors(&converted, &plain);
        assert!(errors.iter().all(|error| *error <= 4e-15), "{label}: {errors:?}");
    });
}

/// `piola energy` with another source of derivatives.
fn from_source(body: &Subject, material: &Material, source: &str) -> Outcome {
    let setting = format!("solver.derivatives={source}");
    // The level at which machine code has the interpreter's bits.
    let strict = ["--set", "solver.level=strict", "--set", &setting];
    body.energy(&body.folder(material, 1.0), &body.u, 1.0, &strict)
}

#[test]
fn every_source_of_derivatives_gives_the_same() {
    // As written, an energy loses u/strain; strains are 0.02 and more.
    const TOLERANCE: f64 = 1e-13;
    let mut worst = [0.0_f64; 2];
    for_each_subject(|material, body, label| {
        let compiled = from_source(body, material, "jit");
        let interpreted = from_source(body, material, "interpreter");
        assert!(
            compiled.stdout == interpreted.stdout,
            "{label}: bits of machine code and interpreter"
        );
        let compiled = compiled.json();
        for (k, source) in ["hyperdual", "hyperdual-coordinates"].into_iter().enumerate() {
            let dual = from_source(body, material, source).json();
            let errors = [
                (number(&dual["energy"]) / number(&compiled["energy"]) - 1.0).abs(),
                distance(&numbers(&dual["gradient"]), &numbers(&compiled["gradient"])),
                distance(
                    &numbers(&dual["tangent"]["values"]),
                    &numbers(&compiled["tangent"]["values"]),
                ),
            ];
            worst[k] = errors.iter().fold(worst[k], |a, b| a.max(*b));
            assert!(errors.iter().all(|error| *error <= TOLERANCE), "{label} {source}: {errors:?}");
        }
    });
    println!("hyperdual, hyperdual-coordinates: {worst:?}");
}
