//! The fracture energy of a lattice: what the bonds that cross a unit of a plane hold at their thresholds.
//!
//! A lattice vector `xi` crosses a plane of normal `n` with `|xi . n|/V` bonds on each unit of area, where `V` is
//! the volume of a cell. Each holds its energy at the length at which it breaks. The continuum's integral over
//! a ball (partmann2026 5.6, for bonds of one stretch) is the limit of this sum for fine lattices.

use piola_compiler::Criterion;
use piola_mechanics::kernel::{Batch, Law, Measure, Order, Outputs};
use piola_mechanics::neighborhood::HORIZON_TOLERANCE;
use serde::Serialize;

use super::inside::Inside;
use crate::case::{Case, CaseError};

/// The largest stretch at which a bond is seen to break.
const LARGEST: f64 = 10.0;

/// Strains that are tried of every decade.
const PER_DECADE: i32 = 20;

/// What breaking a plane through the lattice releases, in J/m^2.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FractureEnergy {
    /// Of planes with these normals, in lattice coordinates: `[1, 0, 0]`, `[1, 1, 0]`, ..
    pub planes: Vec<(Vec<i32>, f64)>,
    /// The smallest and the largest stretch less 1 at which a bond breaks.
    pub critical_stretch: [f64; 2],
}

/// A bond at its threshold.
struct Broken {
    strain: f64,
    /// psi there.
    energy: f64,
}

impl FractureEnergy {
    /// Of the bonds of a case on a lattice; nothing where none breaks, where some never do, and of bodies with
    /// other energies.
    ///
    /// # Errors
    /// Energies that cannot be compiled.
    pub(super) fn new(case: &Case, inside: &Inside) -> Result<Option<FractureEnergy>, CaseError> {
        if !case.can_break() || inside.spacing().is_infinite() {
            return Ok(None);
        }
        let compiled = Inside::compile(case)?;
        let is_of_bonds = |one: &crate::case::Compiled| {
            one.gathered.is_none()
                && one.gradient.is_none()
                && one.measures.iter().all(|measure| *measure == Measure::Length)
        };
        if !compiled.iter().all(is_of_bonds) {
            return Ok(None);
        }
        let criteria: Vec<&Criterion> = compiled
            .iter()
            .flat_map(|one| &one.criteria)
            .filter(|one| one.measure() == Measure::Length)
            .collect();
        let elements = compiled.iter().filter_map(|one| one.elements.bond.as_ref());
        let laws: Vec<&dyn Law> =
            elements.filter_map(|element| element.law().map(|(law, _)| law)).collect();
        let (d, spacing, horizon) =
            (case.scene.body.dimension, inside.spacing(), case.scene.horizon_radius());
        let vectors = half_space(d, horizon / spacing);
        let weighting = case.scene.horizon.weighting();
        let count = 2 * vectors.len() as u64;
        let weight = weighting.weights.inside(Measure::Length, d, horizon, spacing, count);
        let Ok(weight) = weight else { return Ok(None) };
        let mut planes: Vec<(Vec<i32>, f64)> =
            (1..=d).map(|ones| ((0..d).map(|k| i32::from(k < ones)).collect(), 0.0)).collect();
        let mut critical = [f64::INFINITY, 0.0];
        for vector in &vectors {
            let length = spacing * norm(vector);
            let Some(broken) = broken(&criteria, &laws, length) else { return Ok(None) };
            critical = [critical[0].min(broken.strain), critical[1].max(broken.strain)];
            let part = weighting.volumes.part(length, horizon, spacing);
            for (normal, sum) in &mut planes {
                let along: i32 = normal.iter().zip(vector).map(|(n, x)| n * x).sum();
                let way = spacing * f64::from(along.abs()) / norm(normal);
                *sum += weight * part * broken.energy * way;
            }
        }
        Ok(Some(FractureEnergy { planes, critical_stretch: critical }))
    }
}

fn norm(vector: &[i32]) -> f64 {
    f64::from(vector.iter().map(|x| x * x).sum::<i32>()).sqrt()
}

/// One of each pair of opposite lattice vectors within the horizon, in spacings.
fn half_space(d: usize, horizon: f64) -> Vec<Vec<i32>> {
    let reach = (horizon * (1.0 + HORIZON_TOLERANCE)).floor() as i32;
    let side = 2 * reach + 1;
    let n = (0..d).fold(1, |n, _| n * side);
    let vector = |number: i32| -> Vec<i32> {
        let mut rest = number;
        (0..d)
            .map(|_| {
                let part = rest % side - reach;
                rest /= side;
                part
            })
            .collect()
    };
    // The middle number is the zero vector, and those behind it are the opposites of those before.
    let is_near = |vector: &Vec<i32>| norm(vector) <= horizon * (1.0 + HORIZON_TOLERANCE);
    (n / 2 + 1..n).map(vector).filter(is_near).collect()
}

/// The shortest length beyond rest at which a bond breaks, and what it holds there.
fn broken(criteria: &[&Criterion], laws: &[&dyn Law], length: f64) -> Option<Broken> {
    let breaks =
        |strain: f64| criteria.iter().any(|one| one.breaks(psi(&one.margin, length, strain)));
    let decades = -14 * PER_DECADE..=PER_DECADE;
    let strains = decades.map(|k| libm::pow(10.0, f64::from(k) / f64::from(PER_DECADE)));
    let mut low = 0.0;
    let mut high = None;
    for strain in strains.take_while(|strain| 1.0 + strain <= LARGEST) {
        if breaks(strain) {
            high = Some(strain);
            break;
        }
        low = strain;
    }
    let mut high = high?;
    loop {
        let middle = low + 0.5 * (high - low);
        if middle <= low || middle >= high {
            break;
        }
        if breaks(middle) { high = middle } else { low = middle }
    }
    let energy = laws.iter().fold(0.0, |sum, law| sum + psi(*law, length, high));
    Some(Broken { strain: high, energy })
}

fn psi(law: &dyn Law, length: f64, strain: f64) -> f64 {
    let mut psi = [0.0];
    let batch = Batch {
        measure: &[length * (1.0 + strain)],
        reference: &[length],
        change: &[strain],
        fields: law.fields(),
    };
    let out = Outputs { psi: &mut psi, dpsi: &mut [], d2psi: &mut [] };
    law.evaluate(batch, Order::Energy, out);
    psi[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_vectors_are_there_once() {
        for (d, horizon, count) in [(2, 1.0, 2), (2, 1.5, 4), (3, 3.015, 61), (3, 1.8, 13)] {
            let vectors = half_space(d, horizon);
            assert_eq!(vectors.len(), count, "{d} {horizon}");
            let opposite = |v: &Vec<i32>| v.iter().map(|x| -x).collect::<Vec<i32>>();
            assert!(vectors.iter().all(|v| !vectors.contains(&opposite(v))));
        }
    }
}
