//! Thin triangles and flat tetrahedra keep their digits: measures, changes and gradients against whole
//! numbers, which have no rounding.
//!
//! The vectors are 2^50 long and differ by single units; in plain numbers a measure of them is off by
//! one part in a hundred.

use piola_runtime::element::{Contributions, Element, InteractionBatch, MeasureElement, Order};
use piola_runtime::kernel::{Batch, Law, Measure, Outputs};

/// Half the distance from 1 to the next number.
const U: f64 = f64::EPSILON / 2.0;

type Vector = [i128; 3];

const P: Vector = [1 << 50, (1 << 50) - 12_345, (1 << 49) + 77];
/// The other corners at rest, from the first.
const STEPS: [Vector; 2] = [[3, -5, 7], [-2, 11, 4]];
/// Displacements of the three corners.
const ETA: [Vector; 3] = [[1, 0, -2], [0, 2, 1], [-1, 1, 3]];

fn plus(x: Vector, y: Vector) -> Vector {
    [x[0] + y[0], x[1] + y[1], x[2] + y[2]]
}

fn cross(x: Vector, y: Vector) -> Vector {
    [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
}

fn dot(x: Vector, y: Vector) -> i128 {
    x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
}

fn minus(x: Vector, y: Vector) -> Vector {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

/// The corners at rest and now.
fn corners(n: usize) -> (Vec<Vector>, Vec<Vector>) {
    let rest = [P, plus(P, STEPS[0]), plus(P, STEPS[1])];
    let now = [0, 1, 2].map(|k| plus(rest[k], ETA[k]));
    (rest[..n].to_vec(), now[..n].to_vec())
}

/// An energy that is the measure, or its change.
struct Linear {
    change: bool,
}

impl Law for Linear {
    fn evaluate(&self, batch: Batch<'_>, _: Order, out: Outputs<'_>) {
        let n = batch.measure.len();
        out.psi[..n].copy_from_slice(if self.change { batch.change } else { batch.measure });
        out.dpsi.fill(1.0);
        out.d2psi.fill(0.0);
    }
}

/// An energy that is this function of `q = m^2/M`, and knows no other form.
struct OfSquare(Linear);

impl Law for OfSquare {
    fn evaluate(&self, _: Batch<'_>, _: Order, out: Outputs<'_>) {
        out.psi.fill(f64::NAN);
    }

    fn squared(&self) -> Option<&dyn Law> {
        Some(&self.0)
    }
}

/// Energy and gradient of one interaction; the energy is the measure, or its change.
fn evaluate(measure: Measure, dimension: usize, change: bool) -> (f64, Vec<f64>) {
    evaluate_law(measure, dimension, change, Box::new(Linear { change }))
}

fn evaluate_law(
    measure: Measure,
    dimension: usize,
    change: bool,
    law: Box<dyn Law>,
) -> (f64, Vec<f64>) {
    let out = evaluate_lanes(measure, dimension, law, 1.0);
    assert_eq!(out.energy[0], if change { 0.0 } else { 1.0 }, "the plain lane");
    (out.energy[1], out.gradient.iter().map(|channel| channel[1]).collect())
}

/// Lane 1 of three is thin, all lengths are scaled.
fn evaluate_lanes(
    measure: Measure,
    dimension: usize,
    law: Box<dyn Law>,
    scale: f64,
) -> Contributions {
    let element = MeasureElement::new(measure, dimension, law);
    let mut batch = InteractionBatch::new(measure, dimension);
    let n_corners = if measure == Measure::Area { 2 } else { 3 };
    let (rest, _) = corners(n_corners);
    // More lanes than one, so that a thin one stands beside others.
    for lane in 0..3 {
        for corner in 0..n_corners {
            for axis in 0..dimension {
                let channel = corner * dimension + axis;
                let plain = if corner == axis { 1.0 } else { 0.0 };
                let thin = lane == 1;
                let (x, eta) = (rest[corner][axis] as f64, ETA[corner][axis] as f64);
                batch.reference[channel][lane] = scale * if thin { x } else { plain };
                batch.displacement[channel][lane] = if thin { scale * eta } else { 0.0 };
            }
        }
        batch.weight[lane] = 1.0;
    }
    set_len(&mut batch, 3, dimension, n_corners);
    let mut out = Contributions::new(measure, dimension);
    element.evaluate(&batch, Order::Tangent, &mut out).unwrap();
    out
}

/// Takes what stands in the channels as `len` interactions.
fn set_len(batch: &mut InteractionBatch, len: usize, dimension: usize, n_corners: usize) {
    let lane =
        |channels: &[[f64; piola_runtime::element::CAPACITY]], lane: usize, corner: usize| {
            let at = |axis: usize| channels[corner * dimension + axis.min(dimension - 1)][lane];
            [at(0), at(1), at(2)]
        };
    let vectors = |channels: &[[f64; piola_runtime::element::CAPACITY]]| -> Vec<[f64; 3]> {
        (0..len)
            .flat_map(|l| (0..n_corners).map(move |c| (l, c)))
            .map(|(l, c)| lane(channels, l, c))
            .collect()
    };
    let (rest, eta) = (vectors(&batch.reference), vectors(&batch.displacement));
    let plane = |all: &[[f64; 3]]| all.iter().map(|x| [x[0], x[1]]).collect::<Vec<[f64; 2]>>();
    match (n_corners, dimension) {
        (2, 2) => batch.gather(len, &plane(&rest), &plane(&eta), |l| [2 * l, 2 * l + 1]),
        (2, _) => batch.gather(len, &rest, &eta, |l| [2 * l, 2 * l + 1]),
        _ => batch.gather(len, &rest, &eta, |l| [3 * l, 3 * l + 1, 3 * l + 2]),
    }
}

#[track_caller]
fn close(found: f64, expected: f64, scale: f64) {
    assert!((found - expected).abs() <= 4.0 * U * scale, "{found:e}, expected {expected:e}");
}

/// Thinness has no unit: scaled by powers of two everything but the scale has the same bits.
#[test]
fn thin_interactions_are_thin_on_every_scale() {
    for (measure, dimension) in [(Measure::Area, 2), (Measure::Area, 3), (Measure::Volume, 3)] {
        for by_square in [false, true] {
            let law = |change| -> Box<dyn Law> {
                match by_square && measure == Measure::Area && dimension == 3 {
                    true => Box::new(OfSquare(Linear { change })),
                    false => Box::new(Linear { change }),
                }
            };
            let degree = measure.points() as i32 - 1;
            let energy = |change: bool, scale: f64| {
                evaluate_lanes(measure, dimension, law(change), scale).energy[1]
            };
            for exponent in [-70, -40, 20] {
                let scale = libm::ldexp(1.0, exponent);
                // `q = m^2/M` goes with the measure, and changes do not scale.
                let expected = libm::ldexp(energy(false, 1.0), degree * exponent);
                assert_eq!(energy(false, scale), expected, "{measure:?} {scale:e}");
                assert_eq!(energy(true, scale), energy(true, 1.0), "{measure:?} {scale:e}");
            }
        }
    }
}

#[test]
fn thin_triangles_in_the_plane() {
    let (rest, now) = corners(2);
    let area = |x: &[Vector]| cross([x[0][0], x[0][1], 0], [x[1][0], x[1][1], 0])[2];
    let sign = area(&rest).signum();
    let (before, after) = (area(&rest) * sign, area(&now) * sign);
    let expected = after as f64;
    close(evaluate(Measure::Area, 2, false).0, expected, expected.abs());
    let change = (after - before) as f64 / before as f64;
    close(evaluate(Measure::Area, 2, true).0, change, change.abs());
}

#[test]
fn thin_triangles_in_space() {
    let (rest, now) = corners(2);
    // xi1 x xi2 = xi1 x (xi2 - xi1) stays within whole numbers.
    let normal = |x: &[Vector]| cross(x[0], minus(x[1], x[0]));
    let square = |n: Vector| dot(n, n);
    let root = |square: i128| (square as f64).sqrt();
    let (before, after) = (square(normal(&rest)), square(normal(&now)));
    let (measure, gradient) = evaluate(Measure::Area, 3, false);
    close(measure, root(after), root(after));
    let change = (after - before) as f64 / (root(before) * (root(after) + root(before)));
    close(evaluate(Measure::Area, 3, true).0, change, change.abs());
    // da/dxi1 = xi2 x n/a, da/dxi2 = n x xi1/a
    let n = normal(&now).map(|x| x as f64 / root(after));
    let along = |x: Vector, sign: f64| {
        let x = x.map(|x| x as f64);
        [x[1] * n[2] - x[2] * n[1], x[2] * n[0] - x[0] * n[2], x[0] * n[1] - x[1] * n[0]]
            .map(|g| sign * g)
    };
    let expected = [along(now[1], 1.0), along(now[0], -1.0)].concat();
    let scale = expected.iter().map(|g| g.abs()).fold(0.0, f64::max);
    for (found, expected) in gradient.iter().zip(expected) {
        close(*found, expected, 2.0 * scale);
    }
}

#[test]
fn thin_triangles_in_space_by_their_squares() {
    let (rest, now) = corners(2);
    let normal = |x: &[Vector]| cross(x[0], minus(x[1], x[0]));
    let [before, after] = [&rest, &now].map(|x| dot(normal(x), normal(x)));
    let area = (before as f64).sqrt();
    let evaluate = |change: bool| {
        evaluate_law(Measure::Area, 3, change, Box::new(OfSquare(Linear { change })))
    };
    let (measure, gradient) = evaluate(false);
    close(measure, after as f64 / area, after as f64 / area);
    let change = (after - before) as f64 / before as f64;
    close(evaluate(true).0, change, change.abs());
    // With q = a^2/A: dq/dxi1 = 2 xi2 x n/A, dq/dxi2 = 2 n x xi1/A
    let n = normal(&now);
    let expected = [cross(now[1], n), cross(n, now[0])];
    let expected: Vec<f64> =
        expected.as_flattened().iter().map(|x| *x as f64 / area * 2.0).collect();
    let scale = expected.iter().map(|g| g.abs()).fold(0.0, f64::max);
    for (found, expected) in gradient.iter().zip(expected) {
        close(*found, expected, 2.0 * scale);
    }
}

#[test]
fn flat_tetrahedra() {
    let (rest, now) = corners(3);
    let volume = |x: &[Vector]| dot(x[0], cross(minus(x[1], x[0]), minus(x[2], x[0])));
    let sign = volume(&rest).signum();
    let (before, after) = (volume(&rest) * sign, volume(&now) * sign);
    let (measure, gradient) = evaluate(Measure::Volume, 3, false);
    close(measure, after as f64, (after as f64).abs());
    let change = (after - before) as f64 / before as f64;
    close(evaluate(Measure::Volume, 3, true).0, change, change.abs());
    let pairs = [(1, 2), (2, 0), (0, 1)];
    // xi_j x xi_k = xi_j x (xi_k - xi_j), exact in whole numbers.
    let normals = pairs.map(|(j, k)| cross(now[j], minus(now[k], now[j])));
    for (found, expected) in gradient.iter().zip(normals.as_flattened()) {
        let expected = (sign * expected) as f64;
        close(*found, expected, expected.abs());
    }
}
