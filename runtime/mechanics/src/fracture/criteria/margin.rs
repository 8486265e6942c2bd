//! How close bonds are to breaking.

use std::ops::Range;

use rayon::prelude::*;

use super::{CHUNK, Candidate, Criteria, Margin, Margins, Room, room_for};
use crate::body::Body;
use crate::element::{CAPACITY, Element as _, Order};
use crate::energy::NonFinite;
use crate::materials::Materials;
use crate::neighborhood::Neighborhood;

/// The bonds that are closest to breaking.
#[derive(Clone, Debug, PartialEq)]
pub struct Foremost {
    /// The largest margin, over its amount at rest: -1 at rest, 0 at the threshold. A margin that is not
    /// negative at rest stands as it is.
    pub margin: f64,
    /// The bonds that have it, or nearly so, ascending.
    pub bonds: Vec<usize>,
}

impl Foremost {
    /// How small the margin of a bond may be that breaks with these: a `tie` is a share of the way from rest.
    fn least(&self, tie: f64) -> f64 {
        self.margin - tie * (1.0 + self.margin).abs()
    }
}

impl Criteria {
    /// The bonds that are closest to breaking at displacements `u` in m (`n x d`) among those that are
    /// `intact`, and those within `tie` of the largest margin.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub fn foremost(
        &self,
        around: (&Body, &Neighborhood),
        u: &[f64],
        tie: f64,
        intact: impl Fn(usize) -> bool + Sync,
    ) -> Result<Option<Foremost>, NonFinite> {
        if self.are_empty() {
            return Ok(None);
        }
        let n = around.0.n_points();
        let chunks: Vec<Range<usize>> =
            (0..n).step_by(CHUNK).map(|k| k..n.min(k + CHUNK)).collect();
        let parts: Result<Vec<Vec<(usize, f64)>>, NonFinite> = chunks
            .into_par_iter()
            .map(|owners| match around.0.dimension() {
                2 => self.margins::<2>(around, owners, u, &intact),
                _ => self.margins::<3>(around, owners, u, &intact),
            })
            .collect();
        let all = parts?.concat();
        let Some(margin) = all.iter().map(|(_, margin)| *margin).max_by(f64::total_cmp) else {
            return Ok(None);
        };
        let mut first = Foremost { margin, bonds: Vec::new() };
        let least = first.least(tie);
        first.bonds.extend(all.iter().filter(|(_, own)| *own >= least).map(|(bond, _)| *bond));
        Ok(Some(first))
    }

    /// The margins of the bonds of some owners, those that can break.
    fn margins<const D: usize>(
        &self,
        (body, neighborhood): (&Body, &Neighborhood),
        owners: Range<usize>,
        u: &[f64],
        intact: &impl Fn(usize) -> bool,
    ) -> Result<Vec<(usize, f64)>, NonFinite> {
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
                    let scaled = if rest < 0.0 { now / -rest } else { now };
                    margins[*k].1 = margins[*k].1.max(scaled);
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
