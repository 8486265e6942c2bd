//! How close bonds are to breaking, and which of them, of triangles and of tetrahedra come first.

use std::ops::Range;

use rayon::prelude::*;

use super::{CHUNK, Candidate, Criteria, Margin, Margins, Room, room_for};
use crate::body::Body;
use crate::element::{CAPACITY, Element as _, Order};
use crate::energy::NonFinite;
use crate::fracture::Interactions;
use crate::interaction::Lost;
use crate::kernel::Measure;
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

/// A margin over its amount at rest: -1 at rest, 0 at the threshold. One that is not negative at rest stands as
/// it is.
pub fn over_rest(now: f64, at_rest: f64) -> f64 {
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

/// A condition of a bond at some displacements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Of a condition of a deformation gradient, or of gathered values, whose these are: a bond's, between two
    /// points of which the first gathers, or a point's, the same twice. Nothing of a condition of the bond's
    /// length.
    pub of: Option<[usize; 2]>,
    /// The layer, and the law in it.
    pub layer: usize,
    /// The law in it.
    pub law: usize,
    /// Which of the conditions that this law has in the layer, from 0: of lengths, or of fields.
    pub number: usize,
    /// The margin: the bond breaks where it is above 0, or at 0 if the condition says so.
    pub margin: f64,
    /// The same of the bond at rest, with what it remembers now.
    pub at_rest: f64,
    /// Whether the condition holds.
    pub breaks: bool,
}

impl Criteria {
    /// The conditions of a bond at displacements `u` in m, `n x d`, whether or not it is broken.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub(in crate::fracture) fn judged(
        &self,
        around: (&Body, &Neighborhood),
        bond: usize,
        u: &[f64],
    ) -> Result<Vec<Judged>, NonFinite> {
        match around.0.dimension() {
            2 => self.judged_in::<2>(around, bond, u),
            _ => self.judged_in::<3>(around, bond, u),
        }
    }

    fn judged_in<const D: usize>(
        &self,
        (body, neighborhood): (&Body, &Neighborhood),
        bond: usize,
        u: &[f64],
    ) -> Result<Vec<Judged>, NonFinite> {
        let (positions, displacements) =
            (body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
        let bond = Candidate::new(bond, neighborhood.ends(bond), positions, displacements);
        let (mut room, mut found) = (room_for(D), Vec::new());
        for layer in &self.layers {
            layer.judged(&bond, &mut room, u, &mut found)?;
        }
        Ok(found)
    }

    /// What is closest to breaking at displacements `u` in m (`n x d`) among the bonds that are `intact` and the
    /// triangles and tetrahedra that are not `lost`, and what is within `tie` of the largest margin.
    /// `by_fields` has bonds with the margins that deformation gradients and gathered values give them.
    ///
    /// # Errors
    /// Margins that are not finite.
    pub(in crate::fracture) fn foremost(
        &self,
        around: (&Body, &Neighborhood),
        (u, tie): (&[f64], f64),
        intact: impl Fn(usize) -> bool + Sync,
        (lost, by_fields): (Option<&Lost>, WithMargins),
    ) -> Result<Option<Foremost>, NonFinite> {
        let mut bonds = self.leading_bonds(around, (u, tie), intact)?;
        bonds.extend(by_fields);
        let [areas, volumes] = match lost {
            Some(lost) => self.cliques.leading(around, (u, tie), (lost, &self.is_unbreakable))?,
            None => Default::default(),
        };
        let kinds = [bonds, areas, volumes];
        let most = kinds.iter().filter_map(|kind| largest(kind)).max_by(f64::total_cmp);
        let Some(margin) = most else { return Ok(None) };
        let first = |kind: WithMargins| -> Vec<usize> {
            let found = kind.into_iter().filter(|(_, own)| *own >= least(margin, tie));
            let mut numbers: Vec<usize> = found.map(|(number, _)| number).collect();
            numbers.sort_unstable();
            numbers.dedup();
            numbers
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
            for (bond, other) in neighborhood.bonds(owner).zip(neighborhood.upper(owner)) {
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
                let all: Vec<&Candidate<D>> = own.iter().map(|k| &bonds[*k]).collect();
                let rest = self.values((margin, law), &all, at_rest, room, u)?.to_vec();
                let now = self.values((margin, law), &all, |bond| bond.eta, room, u)?;
                for ((k, rest), now) in own.iter().zip(rest).zip(now) {
                    margins[*k].1 = margins[*k].1.max(over_rest(*now, rest));
                }
            }
        }
        Ok(())
    }

    /// A margin of some bonds, changed as said.
    pub(super) fn values<'r, const D: usize>(
        &self,
        (margin, law): (&Margin, usize),
        bonds: &[&Candidate<D>],
        eta: impl Fn(&Candidate<D>) -> [f64; D],
        (batch, out): &'r mut Room,
        u: &[f64],
    ) -> Result<&'r [f64], NonFinite> {
        batch.fill(bonds.len(), |lane| (bonds[lane].xi, eta(bonds[lane]), 1.0));
        if let Some(fields) = self.materials.as_deref().and_then(Materials::fields)
            && margin.element.n_fields() > 0
        {
            let of_law = fields.of_law(law);
            let numbered = bonds.iter().map(|bond| (bond.ends.into_iter(), bond.bond));
            batch.take_fields((fields, of_law), Measure::Length, numbered);
        }
        let evaluated = margin.element.evaluate(batch, Order::Energy, out);
        evaluated.map_err(|lane| bonds[lane.lane].refused(lane.value, lane.reference, u))?;
        Ok(&out.energy[..bonds.len()])
    }

    /// The conditions of a bond.
    fn judged<const D: usize>(
        &self,
        bond: &Candidate<D>,
        room: &mut Room,
        u: &[f64],
        found: &mut Vec<Judged>,
    ) -> Result<(), NonFinite> {
        for (law, _) in self.parts(&bond.ends).iter() {
            for (number, margin) in self.of_law[law].iter().enumerate() {
                let rest = self.values((margin, law), &[bond], at_rest, room, u)?[0];
                let now = self.values((margin, law), &[bond], |bond| bond.eta, room, u)?[0];
                let (of, layer, breaks) = (None, self.layer, margin.breaks(now));
                found.push(Judged { of, layer, law, number, margin: now, at_rest: rest, breaks });
            }
        }
        Ok(())
    }
}

/// Where nothing has moved.
pub(super) fn at_rest<const D: usize>(_: &Candidate<D>) -> [f64; D] {
    [0.0; D]
}
