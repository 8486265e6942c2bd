//! Which bonds break: those whose margin is above 0. Triangles and tetrahedra are judged beside them.
//!
//! Most bonds are far from breaking. Where a margin is affine in the length, or in its square, the bond
//! knows how much its square must have grown before the margin is worked out at all.

pub(super) mod margin;
mod ties;

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::cliques::CliqueCriteria;
use crate::assembly::affine_threshold;
use crate::body::Body;
use crate::element::{CAPACITY, Contributions, Element, InteractionBatch, MeasureElement};
use crate::energy::{Argument, NonFinite};
use crate::geometry::{dot, each};
use crate::interaction::n_neighbors;
use crate::kernel::{Law, Measure};
use crate::materials::{Materials, Parts};
use crate::neighborhood::Neighborhood;
pub use margin::Judged;
use ties::Ties;

/// Owners whose bonds are judged by one task; fixed, so that results do not depend on threads.
pub(super) const CHUNK: usize = 1024;

/// Bonds, triangles and tetrahedra are judged exactly from this share of what they may grow on. Rounding is far below,
/// unless strains come from positions and a body is 1e10 times as large as its bonds times their threshold: there one
/// may be found a step late.
pub(super) const NEARLY: f64 = 1.0 - 1e-6;

/// One condition under which bonds, triangles or tetrahedra break.
pub struct Criterion {
    /// Of which of them it is.
    pub measure: Measure,
    /// The margin, in the place of psi.
    pub margin: Box<dyn Law>,
    /// Whether one breaks where its margin is 0, too.
    pub holds_at_zero: bool,
}

/// The criteria of the potentials of a body that add up to one energy.
pub struct Layer {
    /// Those of each law of the materials, of the only one where there are none.
    pub of_law: Vec<Vec<Criterion>>,
    /// Which laws interactions take. One between points of several materials breaks if any of the laws that it
    /// takes says so.
    pub materials: Option<Arc<Materials>>,
}

/// When the bonds of a body break, its triangles and its tetrahedra: each criterion is enough.
pub struct Criteria {
    layers: Vec<Margins>,
    /// Of triangles and tetrahedra.
    pub(super) cliques: CliqueCriteria,
    /// Points whose interactions never break.
    pub(super) is_unbreakable: Vec<bool>,
    /// How much the square of the length of each bond in m^2 must have grown before it is judged.
    limits: Vec<f32>,
    ties: Ties,
}

/// A [`Layer`] as functions of interactions of one kind.
pub(super) struct Margins {
    /// The number of the layer.
    layer: usize,
    pub(super) of_law: Vec<Vec<Margin>>,
    pub(super) materials: Option<Arc<Materials>>,
}

/// A criterion as a function of an interaction.
pub(super) struct Margin {
    pub(super) element: MeasureElement,
    holds_at_zero: bool,
    /// What margins of bonds amount to at rest, as far as a few of them tell.
    at_rest: f64,
}

impl Margin {
    pub(super) fn breaks(&self, margin: f64) -> bool {
        margin > 0.0 || self.holds_at_zero && margin == 0.0
    }
}

impl Criteria {
    /// The criteria of some layers; interactions with a point of which `is_unbreakable` never break by them.
    pub fn new(
        (body, neighborhood): (&Body, &Neighborhood),
        layers: Vec<Layer>,
        is_unbreakable: Vec<bool>,
    ) -> Criteria {
        assert_eq!(is_unbreakable.len(), body.n_points(), "one for each point");
        let d = body.dimension();
        let mut of_measures = [const { Vec::new() }; 3];
        for layer in layers.into_iter().enumerate() {
            let by_measure = Margins::by_measure(layer, d);
            of_measures.iter_mut().zip(by_measure).for_each(|(all, own)| all.extend(own));
        }
        let [layers, areas, volumes] = of_measures;
        let cliques = CliqueCriteria::new((body, neighborhood), [areas, volumes]);
        let (limits, ties) = (Vec::new(), Ties::default());
        let mut criteria = Criteria { layers, cliques, is_unbreakable, limits, ties };
        if criteria.are_empty() {
            return criteria;
        }
        criteria.weigh((body, neighborhood));
        let owners: Vec<usize> = (0..body.n_points()).collect();
        let limits = owners.par_chunks(CHUNK).map(|owners| match d {
            2 => criteria.limits_of::<2>(body, neighborhood, owners),
            _ => criteria.limits_of::<3>(body, neighborhood, owners),
        });
        criteria.limits = limits.collect::<Vec<_>>().concat();
        criteria
    }

    /// Whether no bond can break; triangles and tetrahedra may.
    pub fn are_empty(&self) -> bool {
        self.layers.is_empty()
    }

    fn limits_of<const D: usize>(
        &self,
        body: &Body,
        neighborhood: &Neighborhood,
        owners: &[usize],
    ) -> Vec<f32> {
        let positions = body.positions().as_chunks::<D>().0;
        let mut limits = Vec::new();
        for &owner in owners {
            for other in neighborhood.upper(owner) {
                let xi = minus(&positions[other as usize], &positions[owner]);
                let length = dot(&xi, &xi).sqrt();
                let direction = xi.map(|component| component / length);
                limits.push(self.limit([owner, other as usize], length, &direction));
            }
        }
        limits
    }

    /// What the square of the length of a bond may grow by before it is judged.
    fn limit(&self, ends: [usize; 2], length: f64, direction: &[f64]) -> f32 {
        if ends.iter().any(|end| self.is_unbreakable[*end]) {
            return f32::INFINITY;
        }
        let mut least = f64::INFINITY;
        for layer in &self.layers {
            for (number, _) in layer.parts(&ends).iter() {
                let fields = layer.materials.as_deref().and_then(Materials::fields);
                let by_direction =
                    fields.is_some_and(|fields| fields.are_direction(fields.of_law(number)));
                let direction = by_direction.then_some(direction);
                for margin in &layer.of_law[number] {
                    let law = margin.element.law();
                    let grown = law.and_then(|(law, _)| affine_threshold(law, length, direction));
                    // Below rest, and where nothing is known, bonds are judged at any length.
                    let grown = grown.filter(|grown| *grown > 0.0).unwrap_or(f64::NEG_INFINITY);
                    least = least.min(grown);
                }
            }
        }
        rounded_down(least * NEARLY)
    }

    /// How much the square of the length of each bond may grow before it may break, in m^2; nothing where
    /// none can.
    pub fn limits(&self) -> &[f32] {
        &self.limits
    }

    /// The bonds that break at displacements `u` in m (`n x d`), ascending, among those of some owners that
    /// are `intact`.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub fn judge(
        &self,
        around: (&Body, &Neighborhood),
        u: &[f64],
        owners: &[Range<usize>],
        intact: impl Fn(usize) -> bool + Sync,
    ) -> Result<Vec<usize>, NonFinite> {
        if self.are_empty() {
            return Ok(Vec::new());
        }
        let pieces = |range: &Range<usize>| {
            let Range { start, end } = *range;
            (start..end).step_by(CHUNK).map(move |k| k..end.min(k + CHUNK))
        };
        let chunks: Vec<Range<usize>> = owners.iter().flat_map(pieces).collect();
        let parts: Result<Vec<Vec<usize>>, NonFinite> = chunks
            .into_par_iter()
            .map(|owners| match around.0.dimension() {
                2 => self.judge_owners::<2>(around, owners, u, &intact),
                _ => self.judge_owners::<3>(around, owners, u, &intact),
            })
            .collect();
        Ok(parts?.concat())
    }

    fn judge_owners<const D: usize>(
        &self,
        (body, neighborhood): (&Body, &Neighborhood),
        owners: Range<usize>,
        u: &[f64],
        intact: &impl Fn(usize) -> bool,
    ) -> Result<Vec<usize>, NonFinite> {
        let (positions, _) = body.positions().as_chunks::<D>();
        let (displacements, _) = u.as_chunks::<D>();
        let (mut found, mut nearly) = (Vec::new(), Vec::new());
        let mut room = None;
        for owner in owners {
            let (rest, moved) = (positions[owner], displacements[owner]);
            let bonds = neighborhood.bonds(owner);
            let limits = &self.limits[bonds.clone()];
            nearly.clear();
            for ((bond, other), limit) in bonds.zip(neighborhood.upper(owner)).zip(limits) {
                let other = other as usize;
                let xi = minus(&positions[other], &rest);
                let eta = minus(&displacements[other], &moved);
                // l^2 - L^2, without the digits that the difference would lose.
                let grown = dot(&eta, &each(|axis| 2.0 * xi[axis] + eta[axis]));
                // What is not a number is looked at.
                let is_far = grown < f64::from(*limit);
                if !is_far && *limit < f32::INFINITY && intact(bond) {
                    nearly.push(Candidate { bond, ends: [owner, other], xi, eta });
                }
            }
            if !nearly.is_empty() {
                let room = room.get_or_insert_with(|| room_for(D));
                let first = found.len();
                for layer in &self.layers {
                    layer.judge(&nearly, room, u, (&mut found, &self.ties))?;
                }
                found[first..].sort_unstable();
            }
        }
        found.dedup();
        Ok(found)
    }
}

impl Margins {
    /// Those of a layer for bonds, triangles and tetrahedra; nothing for those without.
    fn by_measure((number, layer): (usize, Layer), dimension: usize) -> [Option<Margins>; 3] {
        let n_laws = layer.materials.as_ref().map_or(1, |materials| materials.n_laws());
        assert_eq!(layer.of_law.len(), n_laws, "criteria for each law");
        let nothing = || (0..n_laws).map(|_| Vec::new()).collect::<Vec<Vec<Margin>>>();
        let mut all: [Vec<Vec<Margin>>; 3] = [nothing(), nothing(), nothing()];
        for (law, own) in layer.of_law.into_iter().enumerate() {
            // There are no tetrahedra in the plane.
            let own = own.into_iter().filter(|one| n_neighbors(one.measure) <= dimension);
            for Criterion { measure, margin, holds_at_zero } in own {
                let element = MeasureElement::new(measure, dimension, margin);
                all[measure as usize][law].push(Margin { element, holds_at_zero, at_rest: 0.0 });
            }
        }
        all.map(|of_law| {
            let materials = layer.materials.clone();
            let is_empty = of_law.iter().all(Vec::is_empty);
            (!is_empty).then_some(Margins { layer: number, of_law, materials })
        })
    }

    /// The laws of an interaction of these points.
    pub(super) fn parts(&self, points: &[usize]) -> Parts {
        let Some(materials) = &self.materials else { return Parts::whole(0) };
        let mut corners = [0; 4];
        let corners = &mut corners[..points.len()];
        corners.iter_mut().zip(points).for_each(|(corner, point)| *corner = materials.of(*point));
        materials.parts(corners)
    }

    /// The bonds of an owner that break, some perhaps twice.
    fn judge<const D: usize>(
        &self,
        bonds: &[Candidate<D>],
        room: &mut Room,
        u: &[f64],
        (found, ties): (&mut Vec<usize>, &Ties),
    ) -> Result<(), NonFinite> {
        for (law, margins) in self.of_law.iter().enumerate() {
            let takes = |bond: &&Candidate<D>| self.parts(&bond.ends).iter().any(|p| p.0 == law);
            let own: Vec<&Candidate<D>> = bonds.iter().filter(takes).collect();
            for (margin, bonds) in
                margins.iter().flat_map(|m| own.chunks(CAPACITY).map(move |c| (m, c)))
            {
                let margins = self.values((margin, law), bonds, |bond| bond.eta, room, u)?;
                let broken = bonds.iter().zip(margins).filter(|(_, m)| margin.breaks(**m));
                found.extend(broken.map(|(candidate, _)| candidate.bond));
                if !ties.are_told() && margins.iter().any(|m| margin.is_nearly_zero(*m)) {
                    let near =
                        bonds.iter().zip(margins).filter(|(_, m)| margin.is_nearly_zero(**m));
                    let near: Vec<&Candidate<D>> = near.map(|(bond, _)| *bond).collect();
                    ties.add(self.decided_by_rounding((margin, law), &near, room, u)?);
                }
            }
        }
        Ok(())
    }
}

/// In 32 bits, not above the number; what is too large for them is the largest of them, for an infinite limit
/// says that a bond never breaks.
fn rounded_down(x: f64) -> f32 {
    let near = x as f32;
    match f64::from(near) > x {
        true => near.next_down(),
        false => near,
    }
}

/// What functions of bonds are worked out in.
pub(super) type Room = (InteractionBatch, Contributions);

/// Room for bonds in so many dimensions.
pub(super) fn room_for(dimension: usize) -> Room {
    let bonds = Measure::Length;
    (InteractionBatch::new(bonds, dimension), Contributions::new(bonds, dimension))
}

/// A bond that may break, or whose states may change.
pub(super) struct Candidate<const D: usize> {
    pub(super) bond: usize,
    pub(super) ends: [usize; 2],
    /// At rest, in m.
    pub(super) xi: [f64; D],
    /// What it has changed by, in m.
    pub(super) eta: [f64; D],
}

impl<const D: usize> Candidate<D> {
    /// The bond of this number between two points, from positions at rest and displacements of all.
    pub(super) fn new(
        bond: usize,
        ends: [usize; 2],
        positions: &[[f64; D]],
        displacements: &[[f64; D]],
    ) -> Candidate<D> {
        let [owner, other] = ends;
        let xi = minus(&positions[other], &positions[owner]);
        Candidate { bond, ends, xi, eta: minus(&displacements[other], &displacements[owner]) }
    }

    pub(super) fn refused(&self, value: f64, reference: f64, u: &[f64]) -> NonFinite {
        let of = |point: &usize| u[point * D..(point + 1) * D].to_vec();
        NonFinite {
            argument: Argument::Measure(Measure::Length),
            points: self.ends.to_vec(),
            displacements: self.ends.iter().flat_map(of).collect(),
            value,
            reference,
            inverted: false,
        }
    }
}

/// `p - q`.
fn minus<const D: usize>(p: &[f64; D], q: &[f64; D]) -> [f64; D] {
    each(|axis| p[axis] - q[axis])
}
