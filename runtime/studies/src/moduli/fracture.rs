//! The fracture energy of a lattice: what the bonds that cross a unit of a plane hold at their thresholds.
//!
//! A lattice vector `xi` crosses a plane of normal `n` with `|xi . n|/V` bonds on each unit of area, where `V` is
//! the volume of a cell. Each holds its energy at the length at which it breaks; where bonds remember it takes
//! the work of its force up to there, with what is dissipated on the way. The continuum's integral over
//! a ball (partmann2026 5.6, for bonds of one stretch) is the limit of this sum for fine lattices.

use std::collections::BTreeMap;

use piola_compiler::{Criterion, NextState};
use piola_mechanics::kernel::{Batch, Law, Measure, Order, Outputs};
use piola_mechanics::neighborhood::HORIZON_TOLERANCE;
use serde::Serialize;

use super::inside::Inside;
use crate::case::{Case, CaseError};

/// The largest stretch at which a bond is seen to break.
const LARGEST: f64 = 10.0;

/// Strains that are tried of every decade.
const PER_DECADE: i32 = 20;

/// Even parts of the way to the threshold over which the force of a bond that remembers is summed, by two
/// points each: it may bend anywhere, and what a bend costs is less than 1e-7 of the work.
const PARTS: u32 = 4096;

/// What breaking a plane through the lattice releases, in J/m^2.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FractureEnergy {
    /// Of planes with these normals, in lattice coordinates: `[1, 0, 0]`, `[1, 1, 0]`, ..
    pub planes: Vec<(Vec<i32>, f64)>,
    /// The smallest and the largest stretch less 1 at which a bond breaks.
    pub critical_stretch: [f64; 2],
}

/// A bond at its threshold.
#[derive(Clone, Copy)]
struct Broken {
    strain: f64,
    /// psi there, or the work that leads there.
    energy: f64,
}

/// What one potential says of a bond.
struct Part<'a> {
    criteria: &'a [Criterion],
    next: &'a [NextState],
    law: Option<&'a dyn Law>,
    /// What the bond remembers at the start, as fields.
    fields: Vec<f64>,
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
        let case = &case.with_states_alone();
        let compiled = Inside::compile(case)?;
        let is_of_bonds = |one: &crate::case::Compiled| {
            one.gathered.is_none()
                && one.gradient.is_none()
                && one.measures.iter().all(|measure| *measure == Measure::Length)
        };
        if !compiled.iter().all(is_of_bonds) {
            return Ok(None);
        }
        let part = |(one, fields)| Part::of(one, fields);
        let parts: Vec<Part<'_>> = compiled.iter().zip(case.typical_fields()).map(part).collect();
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
        let mut known: BTreeMap<i32, Broken> = BTreeMap::new();
        for vector in &vectors {
            let length = spacing * norm(vector);
            let square = vector.iter().map(|x| x * x).sum();
            let broken = match known.get(&square) {
                Some(broken) => *broken,
                None => {
                    let Some(broken) = broken(&parts, length) else { return Ok(None) };
                    known.insert(square, broken);
                    broken
                }
            };
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

impl<'a> Part<'a> {
    fn of(one: &'a crate::case::Compiled, fields: Vec<f64>) -> Part<'a> {
        let element = one.elements.bond.as_ref();
        let law = element.and_then(|element| element.law()).map(|(law, _)| law);
        Part { criteria: &one.criteria, next: &one.next_states, law, fields }
    }

    /// What the bond remembers at a strain to which it comes with these fields.
    fn remember(&self, fields: &mut [f64], length: f64, strain: f64) {
        let at_once: Vec<f64> = fields.iter().copied().chain([0.0]).collect();
        for state in self.next {
            fields[state.field] = value(&state.next, (length, strain), &at_once, Order::Energy);
        }
    }

    fn breaks(&self, length: f64, strain: f64) -> bool {
        let mut fields = self.fields.clone();
        self.remember(&mut fields, length, strain);
        let margin = |one: &Criterion| value(&one.margin, (length, strain), &fields, Order::Energy);
        let mut of_bonds = self.criteria.iter().filter(|one| one.measure() == Measure::Length);
        of_bonds.any(|one| one.breaks(margin(one)))
    }

    /// psi at a strain; of a bond that remembers the work of its force on the way there.
    fn work(&self, length: f64, strain: f64) -> f64 {
        let Some(law) = self.law else { return 0.0 };
        if self.next.is_empty() {
            return value(law, (length, strain), &self.fields, Order::Energy);
        }
        let mut fields = self.fields.clone();
        let part = strain / f64::from(PARTS);
        let gauss = [-0.5, 0.5].map(|side| 0.5 + side / libm::sqrt(3.0));
        let mut work = 0.0;
        for start in 0..PARTS {
            for place in gauss {
                let strain = part * (f64::from(start) + place);
                self.remember(&mut fields, length, strain);
                work += 0.5 * part * length * value(law, (length, strain), &fields, Order::Force);
            }
        }
        work
    }
}

/// The shortest length beyond rest at which a bond breaks, and what it takes to get there.
fn broken(parts: &[Part<'_>], length: f64) -> Option<Broken> {
    let breaks = |strain: f64| parts.iter().any(|part| part.breaks(length, strain));
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
    let energy = parts.iter().fold(0.0, |sum, part| sum + part.work(length, high));
    Some(Broken { strain: high, energy })
}

/// The energy of a law or, for forces, its derivative by the length.
fn value(law: &dyn Law, (length, strain): (f64, f64), fields: &[f64], order: Order) -> f64 {
    let [mut psi, mut dpsi] = [0.0; 2];
    let batch = Batch {
        measure: &[length * (1.0 + strain)],
        reference: &[length],
        change: &[strain],
        fields: &fields[..law.fields().len()],
    };
    let (of_psi, of_dpsi) = (std::slice::from_mut(&mut psi), std::slice::from_mut(&mut dpsi));
    law.evaluate(batch, order, Outputs { psi: of_psi, dpsi: of_dpsi, d2psi: &mut [] });
    if order == Order::Force { dpsi } else { psi }
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
