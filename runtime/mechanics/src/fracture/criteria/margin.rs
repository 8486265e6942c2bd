//! How close bonds are to breaking, and which of them, of triangles and of tetrahedra come first.

use std::ops::Range;

use rayon::prelude::*;

use super::{CHUNK, Candidate, Criteria, Margin, Margins, Room, room_for};
use crate::body::Body;
use crate::element::{CAPACITY, Element as _, Order};
use crate::energy::NonFinite;
use crate::fracture::Interactions;
use crate::interaction::Lost;
use crate::materials::Materials;
use crate::neighborhood::Neighborhood;

/// What is closest to breaking.
#[derive(Clone, Debug, PartialEq)]
pub struct Foremost {
    /// The largest margin, over its amount at rest: -1 at rest, 0 at the threshold. A margin that is not
    /// negative at rest stands as it is.
    pub margin: f64,
    /// What has it, or nearly so.
    pub which: Interactions,
}

/// Interactions of one kind by their numbers, with their margins.
pub(in super::super) type WithMargins = Vec<(usize, f64)>;

/// A margin over its amount at rest.
pub(in super::super) fn over_rest(now: f64, at_rest: f64) -> f64 {
    if at_rest < 0.0 { now / -at_rest } else { now }
}

/// How small a margin may be that breaks with the largest: a `tie` is a share of the way from rest. It grows
/// with the largest.
fn least(largest: f64, tie: f64) -> f64 {
    largest - tie * (1.0 + largest).abs()
}

fn largest(found: &[(usize, f64)]) -> Option<f64> {
    found.iter().map(|(_, margin)| *margin).max_by(f64::total_cmp)
}

/// Leaves those that may be the foremost of all.
pub(in super::super) fn leading(mut found: WithMargins, tie: f64) -> WithMargins {
    if let Some(largest) = largest(&found) {
        found.retain(|(_, margin)| *margin >= least(largest, tie));
    }
    found
}

impl Criteria {
    /// What is closest to breaking at displacements `u` in m (`n x d`) among the bonds that are `intact` and the
    /// triangles and tetrahedra that are not `lost`, and what is within `tie` of the largest margin.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub fn foremost(
        &self,
        around: (&Body, &Neighborhood),
        (u, tie): (&[f64], f64),
        intact: impl Fn(usize) -> bool + Sync,
        lost: Option<&Lost>,
    ) -> Result<Option<Foremost>, NonFinite> {
        let bonds = self.leading_bonds(around, (u, tie), intact)?;
        let [areas, volumes] = match lost {
            Some(lost) => self.cliques.leading(around, (u, tie), (lost, &self.is_unbreakable))?,
            None => Default::default(),
        };
        let kinds = [bonds, areas, volumes];
        let most = kinds.iter().filter_map(|kind| largest(kind)).max_by(f64::total_cmp);
        let Some(margin) = most else { return Ok(None) };
        let first = |kind: WithMargins| -> Vec<usize> {
            let found = kind.into_iter().filter(|(_, own)| *own >= least(margin, tie));
            found.map(|(number, _)| number).collect()
        };
        let [bonds, areas, volumes] = kinds.map(first);
        let which = Interactions { bonds, cliques: [areas, volumes] };
        Ok(Some(Foremost { margin, which }))
    }

    /// The bonds that may be the foremost of all.
    fn leading_bonds(
        &self,
        around: (&Body, &Neighborhood),
        (u, tie): (&[f64], f64),
        intact: impl Fn(usize) -> bool + Sync,
    ) -> Result<WithMargins, NonFinite> {
        if self.are_empty() {
            return Ok(Vec::new());
        }
        let n = around.0.n_points();
        let chunks: Vec<Range<usize>> =
            (0..n).step_by(CHUNK).map(|k| k..n.min(k + CHUNK)).collect();
        let parts: Result<Vec<WithMargins>, NonFinite> = chunks
            .into_par_iter()
            .map(|owners| {
                let found = match around.0.dimension() {
                    2 => self.margins::<2>(around, owners, u, &intact),
                    _ => self.margins::<3>(around, owners, u, &intact),
                };
                Ok(leading(found?, tie))
            })
            .collect();
        Ok(parts?.concat())
    }

    /// The margins of the bonds of some owners, those that can break.
    fn margins<const D: usize>(
        &self,
        (body, neighborhood): (&Body, &Neighborhood),
        owners: Range<usize>,
        u: &[f64],
        intact: &impl Fn(usize) -> bool,
    ) -> Result<WithMargins, NonFinite> {
        let (positions, _) = body.positions().as_chunks::<D>();
        let (displacements, _) = u.as_chunks::<D>();
        let mut room = room_for(D);
        let (mut found, mut own) = (Vec::new(), Vec::new());
        for owner in owners {
            own.clear();
            for (bond, &other) in neighborhood.bonds(owner).zip(neighborhood.upper(owner)) {
                let ends = [owner, other as usize];
                if intact(bond) && !ends.iter().any(|end| self.is_unbreakable[*end]) {
                    own.push(Candidate::new(bond, ends, positions, displacements));
                }
            }
            let first = found.len();
            found.extend(own.iter().map(|candidate| (candidate.bond, f64::NEG_INFINITY)));
            for layer in &self.layers {
                layer.raise(&own, &mut room, u, &mut found[first..])?;
            }
        }
        // Bonds without a criterion never break.
        found.retain(|(_, margin)| *margin > f64::NEG_INFINITY);
        Ok(found)
    }
}

impl Margins {
    /// Raises the margins of an owner's bonds to those of this layer.
    fn raise<const D: usize>(
        &self,
        bonds: &[Candidate<D>],
        room: &mut Room,
        u: &[f64],
        margins: &mut [(usize, f64)],
    ) -> Result<(), NonFinite> {
        for (law, of_law) in self.of_law.iter().enumerate() {
            let takes = |k: &usize| self.parts(&bonds[*k].ends).iter().any(|part| part.0 == law);
            let own: Vec<usize> = (0..bonds.len()).filter(takes).collect();
            for (margin, own) in
                of_law.iter().flat_map(|one| own.chunks(CAPACITY).map(move |chunk| (one, chunk)))
            {
                let at_rest = self.values((margin, law), bonds, own, 0.0, room, u)?;
                let now = self.values((margin, law), bonds, own, 1.0, room, u)?;
                for ((k, rest), now) in own.iter().zip(at_rest).zip(now) {
                    margins[*k].1 = margins[*k].1.max(over_rest(now, rest));
                }
            }
        }
        Ok(())
    }

    /// A margin of some bonds, at a `part` of their displacements.
    fn values<const D: usize>(
        &self,
        (margin, law): (&Margin, usize),
        bonds: &[Candidate<D>],
        own: &[usize],
        part: f64,
        (batch, out): &mut Room,
        u: &[f64],
    ) -> Result<Vec<f64>, NonFinite> {
        batch.fill(own.len(), |lane| {
            let bond = &bonds[own[lane]];
            (bond.xi, bond.eta.map(|eta| part * eta), 1.0)
        });
        if let Some(fields) = self.materials.as_deref().and_then(Materials::fields)
            && margin.element.n_fields() > 0
        {
            let of_law = fields.of_law(law);
            let bond = |lane: usize| (bonds[own[lane]].ends, bonds[own[lane]].bond);
            batch.take_fields_of_bonds((fields, of_law), bond);
        }
        let evaluated = margin.element.evaluate(batch, Order::Energy, out);
        evaluated.map_err(|lane| bonds[own[lane.lane]].refused(lane.value, lane.reference, u))?;
        Ok(out.energy[..own.len()].to_vec())
    }
}
