//! Energies of a measure: regimes over the declared domain, and what an error counts in.

use super::condition::error_left;
use super::places::Grid;
use super::{Place, Regime, Settings, in_units};
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
    (settings, orders): (&Settings, &[&str]),
) -> Vec<Regime> {
    let measure = kernel.measure();
    let of_square = argument == Argument::Square(measure);
    let mut regimes = Vec::new();
    for (name, strain, stretches) in stretches(energy, argument, (settings.points, orders)) {
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
            measure_errors(&mut regime, written, point, &found[..orders.len()], settings.bar);
        }
        regimes.push(regime);
    }
    regimes
}

pub(super) fn measure_errors(
    regime: &mut Regime,
    written: &WrittenEnergy,
    point: Point,
    found: &[f64],
    bar: f64,
) {
    let Some(expected) = truth(written, point) else { return };
    regime.n_points += 1;
    for (order, found) in found.iter().copied().enumerate() {
        let expected = expected[order];
        let raw = in_units(found, expected, expected.abs());
        let left = if raw > bar { error_left(written, point, order, found, expected) } else { raw };
        regime.see(order, [raw, left], || Place::Interaction(point));
    }
}

/// Regimes: name, decade of the strain near rest, stretches.
type Stretches = Vec<(String, Option<f64>, Vec<f64>)>;

fn stretches(
    energy: &ScalarEnergy,
    argument: Argument,
    (n, orders): (usize, &[&str]),
) -> Stretches {
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
    let grid = Grid::new(energy);
    regimes.push(("guards".to_string(), None, grid.guards()));
    for (order, of) in orders.iter().enumerate() {
        regimes.push((format!("zeros of {of}"), None, grid.zeros(order)));
    }
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
