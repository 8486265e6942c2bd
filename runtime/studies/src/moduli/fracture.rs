//! The fracture energy of a lattice: the work that it takes to pull two halves of it apart.
//!
//! The halves are rigid and move away from each other along the normal of the plane between them, and
//! what crosses the plane breaks as its potential says. A lattice vector `xi` crosses it with `|xi . n|/V`
//! bonds on each unit of area, where `V` is the volume of a cell. Each holds its energy at the length at
//! which it breaks, whichever way it is pulled; where bonds remember it takes the work of its force up to
//! there, with what is dissipated on the way. The continuum's integral over a ball (partmann2026 5.6, for
//! bonds of one stretch) is the limit of this sum for fine lattices. What triangles and tetrahedra hold when
//! they break does depend on the way in which they are deformed: see `cliques`.

mod bonds;
mod cliques;

use std::collections::BTreeMap;

use piola_mechanics::kernel::Measure;
use piola_mechanics::neighborhood::HORIZON_TOLERANCE;
use serde::Serialize;

use super::inside::Inside;
use crate::case::{Case, CaseError, Compiled};
use bonds::{Broken, Part, broken, directed};
use cliques::Cliques;

/// What breaking a plane through the lattice releases, in J/m^2.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FractureEnergy {
    /// Of planes with these normals, in lattice coordinates: `[1, 0, 0]`, `[1, 1, 0]`, ..
    pub planes: Vec<(Vec<i32>, f64)>,
    /// The smallest and the largest stretch less 1 at which a bond breaks; nothing where none breaks by
    /// its own condition.
    pub critical_stretch: Option<[f64; 2]>,
    /// Whether triangles or tetrahedra are part of it.
    pub has_cliques: bool,
}

/// Why a body has no fracture energy that could be read off its lattice.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoFractureEnergy {
    /// Nothing breaks.
    #[error("no potential says when something breaks, by a line `break when`")]
    NothingBreaks,
    /// A cloud.
    #[error("a cloud of points has no planes between its points")]
    Cloud,
    /// Energies of what points gather, or of F.
    #[error(
        "energies of F and of gathered values are those of families, and what a family holds when it has \
         lost some of its bonds is no sum over bonds"
    )]
    Families,
    /// Energies of the vectors of bonds.
    #[error(
        "bonds with an energy of their vector resist being turned, too, and what they hold when they break is \
         not that of their length"
    )]
    Vectors,
    /// Something across a plane holds together.
    #[error(
        "some {0} across a plane never break: neither at ten times their size nor where the halves are \
         pulled apart by ten horizons"
    )]
    NeverBreaks(&'static str),
    /// What breaking takes depends on the whole way.
    #[error(
        "{0} remember, and what it takes to break them depends on the whole way there, which their own \
         conditions do not give"
    )]
    Remember(&'static str),
    /// Energies that are no numbers on the way.
    #[error("the energy of some {0} across a plane is not finite before they break")]
    NotFinite(&'static str),
    /// More than can be taken one by one.
    #[error("the horizon has {0} {1} for every point, and more than {2} are not taken one by one")]
    TooMany(u64, &'static str, u64),
    /// Weights that the lattice does not have.
    #[error("the lattice has no weights inside: {0}")]
    Weights(String),
}

/// The largest stretch at which a bond is seen to break, and the largest size of others.
const LARGEST: f64 = 10.0;

/// What is found, and otherwise why not.
pub(super) type Found = Result<FractureEnergy, NoFractureEnergy>;

impl FractureEnergy {
    /// Of a case on a lattice.
    ///
    /// # Errors
    /// Energies that cannot be compiled.
    pub(super) fn new(case: &Case, inside: &Inside) -> Result<Found, CaseError> {
        if !case.potentials.iter().any(|one| one.model.can_break()) {
            return Ok(Err(NoFractureEnergy::NothingBreaks));
        }
        if inside.spacing().is_infinite() {
            return Ok(Err(NoFractureEnergy::Cloud));
        }
        let case = &case.with_states_alone();
        let compiled = Inside::compile(case)?;
        if compiled.iter().any(|one| one.gathers() || one.gradient.is_some()) {
            return Ok(Err(NoFractureEnergy::Families));
        }
        let bonds = compiled.iter().filter_map(|one| one.elements.bond.as_ref());
        if bonds.into_iter().any(|bond| bond.law().is_none()) {
            return Ok(Err(NoFractureEnergy::Vectors));
        }
        Ok(FractureEnergy::of_interactions(case, inside, &compiled))
    }

    fn of_interactions(case: &Case, inside: &Inside, compiled: &[Compiled]) -> Found {
        let fields = case.typical_fields().into_iter().zip(case.places_of_directions());
        let parts: Vec<Part<'_>> =
            compiled.iter().zip(fields).map(|(one, fields)| Part::of(one, fields)).collect();
        let d = case.scene.body.dimension;
        let mut planes: Vec<(Vec<i32>, f64)> =
            FractureEnergy::normals(d).into_iter().map(|normal| (normal, 0.0)).collect();
        let edges = Edges::new(case, inside, &parts);
        let critical_stretch = edges.add(case, inside, &mut planes)?;
        let mut has_cliques = false;
        for one in compiled {
            for element in [&one.elements.triangle, &one.elements.tetrahedron].into_iter().flatten()
            {
                if parts.iter().any(|part| part.remembers(element.measure())) {
                    let many = element.measure().interactions();
                    return Err(NoFractureEnergy::Remember(many));
                }
                let cliques = Cliques::new(&**element, &parts, &edges);
                cliques.add((case, inside), &mut planes)?;
                has_cliques = true;
            }
        }
        Ok(FractureEnergy { planes, critical_stretch, has_cliques })
    }

    /// The normals of the planes in so many dimensions, in lattice coordinates.
    pub fn normals(d: usize) -> Vec<Vec<i32>> {
        (1..=d).map(|ones| (0..d).map(|k| i32::from(k < ones)).collect()).collect()
    }

    /// Of the plane with this normal; of the first one where none is given.
    pub fn along(&self, normal: Option<&[i32]>) -> Option<f64> {
        let mut planes = self.planes.iter();
        let is_wanted = |one: &&(Vec<i32>, f64)| normal.is_none_or(|normal| one.0 == normal);
        planes.find(is_wanted).map(|(_, energy)| *energy)
    }
}

/// As it is written in tables and targets: `Gc[110]`.
pub fn name_of_plane(normal: &[i32]) -> String {
    format!("Gc[{}]", normal.iter().map(i32::to_string).collect::<String>())
}

/// Bonds of the lattice at their thresholds.
struct Edges {
    /// One of each pair of opposite lattice vectors within the horizon, in spacings.
    vectors: Vec<Vec<i32>>,
    /// By the square of the length in spacings, or by the vector where its direction counts.
    known: BTreeMap<Vec<i32>, Option<Broken>>,
    /// Whether it counts.
    by_vector: bool,
    /// Whether bonds have an energy.
    has_energy: bool,
}

impl Edges {
    fn new(case: &Case, inside: &Inside, parts: &[Part<'_>]) -> Edges {
        let (d, spacing) = (case.scene.body.dimension, inside.spacing());
        let vectors = half_space(d, case.scene.horizon_radius() / spacing);
        let mut known = BTreeMap::new();
        let by_vector = parts.iter().any(Part::sees_directions);
        for vector in &vectors {
            let direction: Vec<f64> = vector.iter().map(|x| f64::from(*x) / norm(vector)).collect();
            let bond = || broken(&directed(parts, &direction), spacing * norm(vector));
            known.entry(key(vector, by_vector)).or_insert_with(bond);
        }
        Edges { vectors, known, by_vector, has_energy: parts.iter().any(Part::has_law) }
    }

    /// The stretch less 1 at which the bond with a vector breaks, if it does.
    fn strain(&self, vector: &[i32]) -> Option<f64> {
        let known = self.known.get(&key(vector, self.by_vector))?;
        known.map(|broken| broken.strain)
    }

    /// Adds what bonds hold to the planes; gives back the smallest and the largest strain at which they
    /// break.
    fn add(
        &self,
        case: &Case,
        inside: &Inside,
        planes: &mut [(Vec<i32>, f64)],
    ) -> Result<Option<[f64; 2]>, NoFractureEnergy> {
        let (spacing, horizon) = (inside.spacing(), case.scene.horizon_radius());
        let weighting = case.scene.horizon.weighting();
        let weight = if self.has_energy { weight(case, inside, Measure::Length)? } else { 0.0 };
        let mut critical: Option<[f64; 2]> = None;
        for vector in &self.vectors {
            let Some(broken) = self.known[&key(vector, self.by_vector)] else {
                if self.has_energy {
                    return Err(NoFractureEnergy::NeverBreaks("bonds"));
                }
                continue;
            };
            if !broken.energy.is_finite() {
                return Err(NoFractureEnergy::NotFinite("bonds"));
            }
            let [least, most] = critical.unwrap_or([broken.strain; 2]);
            critical = Some([least.min(broken.strain), most.max(broken.strain)]);
            let part = weighting.volumes.part(spacing * norm(vector), horizon, spacing);
            for (normal, sum) in &mut *planes {
                let along: i32 = normal.iter().zip(vector).map(|(n, x)| n * x).sum();
                let way = spacing * f64::from(along.abs()) / norm(normal);
                *sum += weight * part * broken.energy * way;
            }
        }
        Ok(critical)
    }
}

/// What bonds have alike: the square of their length, or the vector up to its sign.
fn key(vector: &[i32], by_vector: bool) -> Vec<i32> {
    if !by_vector {
        return vec![square(vector)];
    }
    let opposite: Vec<i32> = vector.iter().map(|x| -x).collect();
    opposite.max(vector.to_vec())
}

/// The weight of an interaction inside the lattice, over the volume of a cell.
fn weight(case: &Case, inside: &Inside, measure: Measure) -> Result<f64, NoFractureEnergy> {
    inside
        .weight(measure, case.scene.horizon.weighting().weights)
        .map_err(|error| NoFractureEnergy::Weights(error.to_string()))
}

fn norm(vector: &[i32]) -> f64 {
    f64::from(square(vector)).sqrt()
}

fn square(vector: &[i32]) -> i32 {
    vector.iter().map(|x| x * x).sum()
}

/// One of each pair of opposite lattice vectors within the horizon, in spacings.
pub(super) fn half_space(d: usize, horizon: f64) -> Vec<Vec<i32>> {
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
