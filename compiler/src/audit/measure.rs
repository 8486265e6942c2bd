//! Energies of a measure: regimes over the declared domain, and what an error counts in.

use super::{Place, Regime, Settings, in_units};
use crate::expression::interpret::Interpreter;
use crate::expression::{Comparison, Node, NodeId};
use crate::kernel::{Kernel, WrittenEnergy};
use crate::measure::{Argument, Measure};
use crate::model::Variant;
use crate::specialise::ScalarEnergy;
use crate::values::Values;
use crate::verify::Columns;
use crate::verify::sample::{Point, Random, contains};
use crate::verify::truth::truth;

/// Errors of a kernel in every regime.
pub(super) fn regimes(
    variant: &Variant,
    values: &Values,
    argument: Argument,
    (kernel, energy, written): (&Kernel, &ScalarEnergy, &WrittenEnergy),
    settings: &Settings,
) -> Vec<Regime> {
    let measure = kernel.measure();
    let of_square = argument == Argument::Square(measure);
    let mut regimes = Vec::new();
    for (name, strain, stretches) in stretches(energy, argument, settings.points) {
        let mut points = points_of(&stretches);
        points.retain(|&point| {
            let point = if of_square { point.root() } else { point };
            contains(variant, measure, values, point)
        });
        let columns = Columns::new(&points);
        let out = kernel.derivatives(columns.batch());
        let mut regime = Regime::new(name, strain);
        for (i, &point) in points.iter().enumerate() {
            let found = [out.psi[i], out.dpsi[i], out.d2psi[i]];
            measure_errors(&mut regime, written, point, found, settings.bar);
        }
        regimes.push(regime);
    }
    regimes
}

fn measure_errors(
    regime: &mut Regime,
    written: &WrittenEnergy,
    point: Point,
    found: [f64; 3],
    bar: f64,
) {
    let Some(expected) = truth(written, point) else { return };
    regime.n_points += 1;
    for order in 0..3 {
        let mut error = in_units(found[order], expected[order], expected[order].abs());
        if error > bar {
            let scale = expected[order].abs() + change(written, point, expected, order);
            error = in_units(found[order], expected[order], scale);
        }
        regime.see(order, error, || Place::Interaction(point));
    }
}

/// How much a value changes when the strain changes by its own size, from its derivative.
fn change(written: &WrittenEnergy, point: Point, expected: [f64; 3], order: usize) -> f64 {
    let strain = point.measure - point.reference;
    if order < 2 {
        return (strain * expected[order + 1]).abs();
    }
    // psi''' from differences of true values.
    let step = point.measure * libm::ldexp(1.0, -20);
    let moved = |measure: f64| truth(written, Point { measure, ..point });
    match (moved(point.measure + step), moved(point.measure - step)) {
        (Some(right), Some(left)) => (point.measure * (right[2] - left[2]) / (2.0 * step)).abs(),
        _ => 0.0,
    }
}

/// Regimes: name, decade of the strain near rest, stretches.
type Stretches = Vec<(String, Option<f64>, Vec<f64>)>;

fn stretches(energy: &ScalarEnergy, argument: Argument, n: usize) -> Stretches {
    let measure = energy.measure;
    // Strains and stretches are those of the measure, also where its square is given.
    let given = |stretch: f64| match argument {
        Argument::Square(_) => stretch * stretch,
        _ => stretch,
    };
    let mut random = Random::new(0x6175_6469_7400 ^ measure as u64);
    let mut regimes: Stretches = Vec::new();
    for decade in 1..=15 {
        let strain = libm::pow(10.0, -f64::from(decade));
        let around = |random: &mut Random, k: usize| {
            let size = strain * libm::pow(10.0, random.uniform(-0.5, 0.5)).min(9.0);
            if k.is_multiple_of(2) { 1.0 + size } else { 1.0 - size.min(0.9) }
        };
        let stretches = (0..n).map(|k| given(around(&mut random, k))).collect();
        regimes.push((format!("strain 1e-{decade}"), Some(strain), stretches));
    }
    for decade in [-8_i32, -6, -4, -2, -1, 0, 1, 2, 4, 6, 8] {
        let low = f64::from(decade) - 0.5;
        let stretch = |_| given(libm::pow(10.0, random.uniform(low, low + 1.0)));
        let stretches = (0..n).map(stretch).collect();
        regimes.push((format!("stretch 1e{decade}"), None, stretches));
    }
    if measure == Measure::Volume {
        let inverted = (0..n).map(|_| -libm::pow(10.0, random.uniform(-4.0, 4.0))).collect();
        regimes.push(("inverted".to_string(), None, inverted));
    }
    regimes.push(("guards".to_string(), None, guards(energy)));
    regimes.push(("zeros of psi''".to_string(), None, zeros(energy)));
    regimes
}

/// References that are no powers of two, in turn.
fn points_of(stretches: &[f64]) -> Vec<Point> {
    const REFERENCES: [f64; 3] = [1.0, 0.037, 5.3];
    let point = |(i, stretch): (usize, &f64)| {
        let reference = REFERENCES[i % 3];
        Point { measure: stretch * reference, reference }
    };
    stretches.iter().enumerate().map(point).collect()
}

/// Evaluates a node of an energy at a stretch of a bond of length 1.
fn at(energy: &ScalarEnergy, stretch: f64, read: impl Fn(&Interpreter<f64>) -> bool) -> bool {
    let mut interpreter = Interpreter::<f64>::new();
    energy.run(&mut interpreter, &stretch, &1.0, &(stretch - 1.0));
    read(&interpreter)
}

/// Stretches on both sides of every place where a comparison changes its mind, one rounding apart.
fn guards(energy: &ScalarEnergy) -> Vec<f64> {
    let mut found = Vec::new();
    for (id, node) in energy.graph.nodes() {
        if matches!(node, Node::Compare(Comparison::Less | Comparison::Greater, ..)) {
            found.extend(switches(energy, |interpreter| interpreter.truth(id)));
        }
    }
    // With reference 1 every third point is exact.
    found.into_iter().flat_map(|stretch| [stretch; 3]).collect()
}

/// Stretches around the zeros of psi''.
fn zeros(energy: &ScalarEnergy) -> Vec<f64> {
    let root: NodeId = energy.roots[2];
    let found = switches(energy, |interpreter| interpreter.number(root) < 0.0);
    let around = |stretch: f64| [1.0, 1.0 - 1e-12, 1.0 + 1e-8, 1.0 - 1e-4].map(|f| f * stretch);
    found.into_iter().flat_map(around).collect()
}

/// Pairs of neighbouring stretches between which a truth value changes, found on a grid.
fn switches(energy: &ScalarEnergy, read: impl Fn(&Interpreter<f64>) -> bool) -> Vec<f64> {
    let mut grid: Vec<f64> = (-80..=80).map(|k| libm::pow(10.0, f64::from(k) / 10.0)).collect();
    for decade in 1..=15 {
        let strain = libm::pow(10.0, -f64::from(decade));
        grid.extend([1.0 - strain, 1.0 + strain]);
    }
    grid.sort_by(f64::total_cmp);
    let mut found = Vec::new();
    for pair in grid.windows(2) {
        let (mut low, mut high) = (pair[0], pair[1]);
        let left = at(energy, low, &read);
        if left == at(energy, high, &read) {
            continue;
        }
        while low.next_up() < high {
            let middle = 0.5 * (low + high);
            if at(energy, middle, &read) == left { low = middle } else { high = middle }
        }
        found.extend([low, high]);
    }
    found
}
