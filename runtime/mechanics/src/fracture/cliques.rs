//! Which triangles and tetrahedra break by a criterion of their own, and which are closest to that.
//!
//! All that are left are judged, each by the laws that it takes, or behind forces those of owners among which passes
//! of forces have seen some beyond their limits. Those whose edges are broken are gone already.

use std::ops::Range;

use rayon::prelude::*;

use super::criteria::margin::{WithMargins, leading, over_rest};
use super::criteria::{Margin, Margins, NEARLY};
use super::walk::{Listed, Of, OfOwners, Room, Walk};
use crate::assembly::affine_limits;
use crate::body::Body;
use crate::element::Element as _;
use crate::energy::{Energy, NonFinite};
use crate::interaction::{Clique, Lost, Ranks, n_neighbors};
use crate::kernel::Measure;
use crate::materials::Materials;
use crate::neighborhood::Neighborhood;

/// When the triangles and tetrahedra of a body break: each criterion is enough.
pub(super) struct CliqueCriteria {
    kinds: Vec<OfKind>,
}

/// The criteria of cliques of one size.
struct OfKind {
    layers: Vec<Margins>,
    cliques: OfOwners,
}

impl CliqueCriteria {
    /// Those among the criteria of some layers, of which none is left for bonds.
    pub(super) fn new(
        around: (&Body, &Neighborhood),
        of_measures: [Vec<Margins>; 2],
    ) -> CliqueCriteria {
        let all = [Measure::Area, Measure::Volume].into_iter().zip(of_measures);
        let kind = |(measure, layers)| OfKind { layers, cliques: OfOwners::new(around, measure) };
        CliqueCriteria { kinds: all.filter(|one| !one.1.is_empty()).map(kind).collect() }
    }

    /// Whether neither triangles nor tetrahedra can break but by their edges.
    pub(super) fn are_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// The triangles, or the tetrahedra, where these have criteria.
    pub(super) fn of(&self, measure: Measure) -> Option<&OfOwners> {
        self.kinds.iter().map(|kind| &kind.cliques).find(|cliques| cliques.measure == measure)
    }

    /// Lets an energy watch what may break while it works out forces.
    pub(super) fn be_watched(&self, energy: &mut dyn Energy) {
        for kind in &self.kinds {
            energy.watch_cliques(kind.cliques.measure, &|size| kind.limits(size));
        }
    }

    /// The measures that have criteria, with the numbers of their cliques.
    pub(super) fn kinds(&self) -> impl Iterator<Item = (Measure, &Ranks)> {
        self.kinds.iter().map(|kind| (kind.cliques.measure, &kind.cliques.ranks))
    }

    /// The triangles, and the tetrahedra, that break at displacements `u` in m (`n x d`), ascending: of what is
    /// not `lost`, and none with a point that `is_unbreakable`; among those of some owners, as far as these are known.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub(super) fn judge(
        &self,
        around: (&Body, &Neighborhood),
        u: &[f64],
        (lost, is_unbreakable): (&Lost, &[bool]),
        [areas, volumes]: [Option<Vec<Range<usize>>>; 2],
    ) -> Result<[Vec<usize>; 2], NonFinite> {
        let mut all: [Vec<usize>; 2] = Default::default();
        for kind in &self.kinds {
            let walk = Walk { around, u, lost };
            let judge = Judge { kind, walk, is_unbreakable, wanted: Wanted::Breaking };
            let owners = if kind.cliques.measure == Measure::Area { &areas } else { &volumes };
            let found = judge.all(owners.as_deref(), |found| found)?;
            all[n_neighbors(kind.cliques.measure) - 2] =
                found.into_iter().map(|(number, _)| number).collect();
        }
        Ok(all)
    }

    /// The triangles, and the tetrahedra, that may be the foremost of all, with their margins over those at
    /// rest.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub(super) fn leading(
        &self,
        around: (&Body, &Neighborhood),
        (u, tie): (&[f64], f64),
        (lost, is_unbreakable): (&Lost, &[bool]),
    ) -> Result<[WithMargins; 2], NonFinite> {
        let mut all: [WithMargins; 2] = Default::default();
        for kind in &self.kinds {
            let walk = Walk { around, u, lost };
            let judge = Judge { kind, walk, is_unbreakable, wanted: Wanted::Margins };
            all[n_neighbors(kind.cliques.measure) - 2] =
                judge.all(None, |found| leading(found, tie))?;
        }
        Ok(all)
    }
}

impl OfKind {
    /// How much one of this size at rest may shrink and grow before it is judged; nothing where that is not known.
    fn limits(&self, size: f64) -> Option<[f64; 2]> {
        let laws = self.layers.iter().flat_map(|layer| layer.of_law.iter().flatten());
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let least = |[low, high]: [f64; 2], margin: &Margin| {
            let (law, _) = margin.element.law()?;
            let [own_low, own_high] = affine_limits(law, size)?.map(|grown| grown * NEARLY);
            Some([low.max(own_low), high.min(own_high)])
        };
        laws.into_iter().try_fold(all, least)
    }
}

/// What is asked of cliques.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wanted {
    /// Those that break, with their margins.
    Breaking,
    /// All, with their largest margins over those at rest.
    Margins,
}

/// Cliques of one size on their way through their margins.
struct Judge<'a> {
    kind: &'a OfKind,
    walk: Walk<'a>,
    is_unbreakable: &'a [bool],
    wanted: Wanted,
}

impl Judge<'_> {
    /// What is found of some owners, or of all, slab by slab, of which some is kept.
    fn all(
        &self,
        owners: Option<&[Range<usize>]>,
        keep: impl Fn(WithMargins) -> WithMargins + Sync,
    ) -> Result<WithMargins, NonFinite> {
        let (body, _) = self.walk.around;
        let OfOwners { measure, .. } = self.kind.cliques;
        let all = 0..body.n_points();
        let owners = owners.unwrap_or(std::slice::from_ref(&all));
        let pieces = self.kind.cliques.by_slabs(owners).into_par_iter();
        let found = pieces.map(|piece| {
            let found = match (body.dimension(), measure) {
                (2, _) => self.piece::<2, 2>(piece),
                (_, Measure::Area) => self.piece::<3, 2>(piece),
                _ => self.piece::<3, 3>(piece),
            };
            Ok(keep(found?))
        });
        let found: Result<Vec<WithMargins>, NonFinite> = found.collect();
        Ok(found?.concat())
    }

    fn piece<const D: usize, const K: usize>(
        &self,
        (slab, owners): (usize, Vec<Range<usize>>),
    ) -> Result<WithMargins, NonFinite> {
        let OfKind { cliques, .. } = self.kind;
        let mut found = Found { room: Room::new(cliques.measure, D), all: Vec::new() };
        let is_left_out = |point: usize| self.is_unbreakable[point];
        let owners = owners.into_iter().flatten();
        cliques.show::<D, K>(self.walk, (slab, owners), is_left_out, |listed, lanes| {
            self.listed::<D, K>((listed, lanes), &mut found)
        })?;
        // Of several criteria the largest margin comes first.
        found.all.sort_unstable_by(|p, q| p.0.cmp(&q.0).then(q.1.total_cmp(&p.1)));
        found.all.dedup_by_key(|one| one.0);
        Ok(found.all)
    }

    /// Judges what is listed, layer by layer and law by law.
    fn listed<const D: usize, const K: usize>(
        &self,
        (listed, lanes): (&Listed<'_, '_, D>, &[Clique]),
        found: &mut Found,
    ) -> Result<(), NonFinite> {
        for layer in &self.kind.layers {
            for (law, margins) in layer.of_law.iter().enumerate() {
                if layer.materials.is_none() {
                    self.judge::<D, K>((listed, lanes), (layer, law), margins, found)?;
                    continue;
                }
                let takes = |clique: &&Clique| {
                    let points = listed.points::<K>(clique);
                    layer.parts(&points[..=K]).iter().any(|part| part.0 == law)
                };
                let own: Vec<Clique> = lanes.iter().filter(takes).copied().collect();
                if !own.is_empty() {
                    self.judge::<D, K>((listed, &own), (layer, law), margins, found)?;
                }
            }
        }
        Ok(())
    }

    fn judge<const D: usize, const K: usize>(
        &self,
        (listed, lanes): (&Listed<'_, '_, D>, &[Clique]),
        (layer, law): (&Margins, usize),
        margins: &[Margin],
        Found { room, all }: &mut Found,
    ) -> Result<(), NonFinite> {
        let fields = layer.materials.as_deref().and_then(Materials::fields);
        let fields = fields.map(|fields| (fields, fields.of_law(law)));
        for margin in margins {
            let of = |at_rest| {
                let (element, fields) = (&margin.element, fields.clone());
                Of { element, fields, dt: None, at_rest }
            };
            let mut at_rest = Vec::new();
            if self.wanted == Wanted::Margins {
                listed.evaluate::<K>(lanes, of(true), room)?;
                at_rest.extend_from_slice(&room.out.energy[..lanes.len()]);
            }
            listed.evaluate::<K>(lanes, of(false), room)?;
            let now = lanes.iter().zip(&room.out.energy);
            let now = now.map(|(clique, now)| (listed.number(clique), *now));
            match self.wanted {
                Wanted::Breaking => all.extend(now.filter(|(_, now)| margin.breaks(*now))),
                Wanted::Margins => {
                    let scaled = now.zip(at_rest);
                    all.extend(scaled.map(|((n, now), rest)| (n, over_rest(now, rest))));
                }
            }
        }
        Ok(())
    }
}

/// What is found, and where it is worked out.
struct Found {
    room: Room,
    /// Numbers and margins.
    all: WithMargins,
}
