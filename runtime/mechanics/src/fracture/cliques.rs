//! Which triangles and tetrahedra break by a criterion of their own, and which are closest to that.
//!
//! All that are left are judged, each by the laws that it takes. Those whose edges are broken are gone
//! already.

use rayon::prelude::*;

use super::criteria::margin::{WithMargins, leading, over_rest};
use super::criteria::{Margin, Margins};
use crate::body::Body;
use crate::element::{CAPACITY, Contributions, Element, InteractionBatch, Order};
use crate::energy::{Argument, NonFinite};
use crate::geometry::each;
use crate::interaction::{Clique, Degeneracy, Lost, OwnerCliques, Ranks, Slabs, n_neighbors};
use crate::kernel::Measure;
use crate::materials::Materials;
use crate::neighborhood::Neighborhood;

/// When the triangles and tetrahedra of a body break: each criterion is enough.
pub(super) struct CliqueCriteria {
    kinds: Vec<OfKind>,
    slabs: Slabs,
    degeneracy: Degeneracy,
}

/// The criteria of cliques of one size.
struct OfKind {
    measure: Measure,
    layers: Vec<Margins>,
    ranks: Ranks,
}

impl CliqueCriteria {
    /// Those among the criteria of some layers, of which none is left for bonds.
    pub(super) fn new(
        (body, neighborhood): (&Body, &Neighborhood),
        of_measures: [Vec<Margins>; 2],
    ) -> CliqueCriteria {
        let slabs = Slabs::new(neighborhood);
        let kind = |(measure, layers): (Measure, Vec<Margins>)| {
            let ranks = match (body.dimension(), measure) {
                (2, _) => Ranks::new::<2, 2>(body, neighborhood, &slabs),
                (_, Measure::Area) => Ranks::new::<3, 2>(body, neighborhood, &slabs),
                _ => Ranks::new::<3, 3>(body, neighborhood, &slabs),
            };
            OfKind { measure, layers, ranks }
        };
        let all = [Measure::Area, Measure::Volume].into_iter().zip(of_measures);
        let kinds = all.filter(|(_, layers)| !layers.is_empty()).map(kind).collect();
        CliqueCriteria { kinds, slabs, degeneracy: Degeneracy::new(body) }
    }

    /// Whether neither triangles nor tetrahedra can break but by their edges.
    pub(super) fn are_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// The measures that have criteria, with the numbers of their cliques.
    pub(super) fn kinds(&self) -> impl Iterator<Item = (Measure, &Ranks)> {
        self.kinds.iter().map(|kind| (kind.measure, &kind.ranks))
    }

    /// The triangles, and the tetrahedra, that break at displacements `u` in m (`n x d`), ascending: of what is
    /// not `lost`, and none with a point that `is_unbreakable`.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub(super) fn judge(
        &self,
        around: (&Body, &Neighborhood),
        u: &[f64],
        (lost, is_unbreakable): (&Lost, &[bool]),
    ) -> Result<[Vec<usize>; 2], NonFinite> {
        let mut all: [Vec<usize>; 2] = Default::default();
        for kind in &self.kinds {
            let judge =
                Judge { of: self, kind, around, u, lost, is_unbreakable, wanted: Wanted::Breaking };
            let found = judge.all(|found| found)?;
            all[n_neighbors(kind.measure) - 2] =
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
            let judge =
                Judge { of: self, kind, around, u, lost, is_unbreakable, wanted: Wanted::Margins };
            all[n_neighbors(kind.measure) - 2] = judge.all(|found| leading(found, tie))?;
        }
        Ok(all)
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
    of: &'a CliqueCriteria,
    kind: &'a OfKind,
    around: (&'a Body, &'a Neighborhood),
    u: &'a [f64],
    lost: &'a Lost,
    is_unbreakable: &'a [bool],
    wanted: Wanted,
}

impl Judge<'_> {
    /// What is found slab by slab, of which some is kept.
    fn all(
        &self,
        keep: impl Fn(WithMargins) -> WithMargins + Sync,
    ) -> Result<WithMargins, NonFinite> {
        let slabs = (0..self.of.slabs.len()).into_par_iter();
        let found = slabs.map(|slab| {
            let found = match (self.around.0.dimension(), self.kind.measure) {
                (2, _) => self.slab::<2, 2>(slab),
                (_, Measure::Area) => self.slab::<3, 2>(slab),
                _ => self.slab::<3, 3>(slab),
            };
            Ok(keep(found?))
        });
        let found: Result<Vec<WithMargins>, NonFinite> = found.collect();
        Ok(found?.concat())
    }

    fn slab<const D: usize, const K: usize>(&self, slab: usize) -> Result<WithMargins, NonFinite> {
        let (body, neighborhood) = self.around;
        let slabs = &self.of.slabs;
        let (touched, degeneracy) = (slabs.touched(slab), self.of.degeneracy);
        let cliques = OwnerCliques::<D>::new(body, neighborhood, degeneracy, touched);
        let mut cliques = cliques.with_lost(Some(self.lost));
        let measure = self.kind.measure;
        assert_eq!(K, n_neighbors(measure), "the size of the cliques");
        let mut room = Room {
            displacement: Vec::new(),
            nowhere: Vec::new(),
            listed: Vec::new(),
            batch: InteractionBatch::new(measure, D),
            out: Contributions::new(measure, D),
            found: Vec::new(),
        };
        let points = self.u.as_chunks::<D>().0;
        for owner in slabs.owners(slab).filter(|owner| !self.is_unbreakable[*owner]) {
            cliques.set_of::<K>(owner);
            let own = points[owner];
            room.displacement.clear();
            room.displacement.extend(cliques.members().iter().map(|member| -> [f64; D] {
                each(|axis| points[*member as usize][axis] - own[axis])
            }));
            room.nowhere.resize(cliques.members().len(), [0.0; D]);
            let (first, begun) = (self.kind.ranks.first(owner), room.found.len());
            cliques.each_numbered::<K, NonFinite>(|clique, number| {
                let mut members = clique.corners::<K>().into_iter();
                if !members.any(|m| self.is_unbreakable[cliques.members()[m] as usize]) {
                    room.listed.push((clique, first + number));
                }
                if room.listed.len() == CAPACITY {
                    return self.listed::<D, K>(&cliques, &mut room);
                }
                Ok(())
            })?;
            self.listed::<D, K>(&cliques, &mut room)?;
            // Of several criteria the largest margin comes first.
            room.found[begun..].sort_unstable_by(|p, q| p.0.cmp(&q.0).then(q.1.total_cmp(&p.1)));
        }
        room.found.dedup_by_key(|one| one.0);
        Ok(room.found)
    }

    /// Judges what is listed, layer by layer and law by law.
    fn listed<const D: usize, const K: usize>(
        &self,
        cliques: &OwnerCliques<'_, D>,
        room: &mut Room<D>,
    ) -> Result<(), NonFinite> {
        let mut listed = std::mem::take(&mut room.listed);
        for layer in &self.kind.layers {
            let takes = |law: usize, (clique, _): &(Clique, usize)| {
                let points = points::<D, K>(cliques, clique);
                layer.parts(&points).iter().any(|part| part.0 == law)
            };
            for (law, margins) in layer.of_law.iter().enumerate() {
                if layer.materials.is_none() && !listed.is_empty() {
                    self.judge::<D, K>((cliques, &listed), (layer, law), margins, room)?;
                    continue;
                }
                let own: Vec<(Clique, usize)> =
                    listed.iter().filter(|one| takes(law, one)).copied().collect();
                if !own.is_empty() {
                    self.judge::<D, K>((cliques, &own), (layer, law), margins, room)?;
                }
            }
        }
        listed.clear();
        room.listed = listed;
        Ok(())
    }

    fn judge<const D: usize, const K: usize>(
        &self,
        of: (&OwnerCliques<'_, D>, &[(Clique, usize)]),
        own: (&Margins, usize),
        margins: &[Margin],
        room: &mut Room<D>,
    ) -> Result<(), NonFinite> {
        let lanes = of.1;
        for margin in margins {
            let mut at_rest = Vec::new();
            if self.wanted == Wanted::Margins {
                self.evaluate::<D, K>(of, own, (margin, true), room)?;
                at_rest.extend_from_slice(&room.out.energy[..lanes.len()]);
            }
            self.evaluate::<D, K>(of, own, (margin, false), room)?;
            let now = lanes.iter().zip(&room.out.energy).map(|((_, number), now)| (*number, *now));
            match self.wanted {
                Wanted::Breaking => room.found.extend(now.filter(|(_, now)| margin.breaks(*now))),
                Wanted::Margins => {
                    let scaled = now.zip(at_rest).map(|((n, now), rest)| (n, over_rest(now, rest)));
                    room.found.extend(scaled);
                }
            }
        }
        Ok(())
    }

    /// Works out a margin of some cliques, as energies in the room: of what is displaced, or at rest.
    fn evaluate<const D: usize, const K: usize>(
        &self,
        (cliques, lanes): (&OwnerCliques<'_, D>, &[(Clique, usize)]),
        (layer, law): (&Margins, usize),
        (margin, at_rest): (&Margin, bool),
        room: &mut Room<D>,
    ) -> Result<(), NonFinite> {
        let Room { displacement, nowhere, batch, out, .. } = room;
        let displacement = if at_rest { nowhere } else { displacement };
        batch.gather(lanes.len(), cliques.reference(), displacement, |lane| {
            lanes[lane].0.corners::<K>()
        });
        batch.weight[..lanes.len()].fill(1.0);
        if let Some(fields) = layer.materials.as_deref().and_then(Materials::fields)
            && margin.element.n_fields() > 0
        {
            batch.take_fields((fields, fields.of_law(law)), |lane| {
                points::<D, K>(cliques, &lanes[lane].0).into_iter()
            });
        }
        margin.element.evaluate(batch, Order::Energy, out).map_err(|lane| {
            let points = points::<D, K>(cliques, &lanes[lane.lane].0);
            let of = |point: &usize| self.u[point * D..(point + 1) * D].to_vec();
            NonFinite {
                argument: Argument::Measure(self.kind.measure),
                displacements: points.iter().flat_map(of).collect(),
                points,
                value: lane.value,
                reference: lane.reference,
                inverted: false,
            }
        })
    }
}

/// Work arrays of a task.
struct Room<const D: usize> {
    /// Of the owner's members relative to it, in m.
    displacement: Vec<[f64; D]>,
    /// As many vectors of length 0.
    nowhere: Vec<[f64; D]>,
    /// Cliques that come next, with their numbers.
    listed: Vec<(Clique, usize)>,
    batch: InteractionBatch,
    out: Contributions,
    /// Numbers and margins.
    found: WithMargins,
}

/// The points of a clique.
fn points<const D: usize, const K: usize>(
    cliques: &OwnerCliques<'_, D>,
    clique: &Clique,
) -> Vec<usize> {
    let members = clique.corners::<K>().into_iter().map(|m| cliques.members()[m] as usize);
    std::iter::once(cliques.owner()).chain(members).collect()
}
