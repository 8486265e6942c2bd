//! Conditions of what points gather of vectors, under which bonds break. One that holds what belongs to a bond is asked
//! of a bond as each of its ends sees it, another of a point, and breaks all of its bonds.

use piola_compiler::FamilyKernel;
use rayon::prelude::*;

use super::VectorEnergy;
use super::passes::{At, Gathered, Room};
use crate::energy::NonFinite;
use crate::fracture::{Asked, FamilyCriterion, Judged};

/// Points that are worked out by one task, or whose bonds are; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// Places that go through a margin at once.
const CAPACITY: usize = 128;

impl VectorEnergy {
    /// The same with conditions under which bonds break.
    pub fn with_criteria(self, criteria: Vec<FamilyCriterion<FamilyKernel>>) -> VectorEnergy {
        VectorEnergy { criteria, ..self }
    }

    /// See [`crate::energy::Energy::field_margins`].
    pub(super) fn margins<const D: usize>(
        &self,
        u: &[f64],
        asked: Asked,
    ) -> Result<Vec<Judged>, NonFinite> {
        let nowhere = vec![0.0; u.len()];
        let gathered = |u: &[f64]| {
            let mut gathered = Gathered::default();
            self.gather::<D>(u, None, &mut gathered);
            gathered.values
        };
        let now = gathered(u);
        let at_rest = (asked != Asked::Breaking).then(|| gathered(&nowhere));
        let now = At { u, values: &now, adjoint: &[] };
        let at_rest = at_rest.as_deref().map(|values| At { u: &nowhere, values, adjoint: &[] });
        let mut all = Vec::new();
        for criterion in &self.criteria {
            let of_bonds = criterion.margin.of_bonds();
            if let Asked::Bond([i, j]) = asked {
                let mut places =
                    if of_bonds { [[i, j], [j, i]] } else { [[i; 2], [j; 2]] }.to_vec();
                places.retain(|ends| self.gathers_by(usize::from(criterion.law), ends));
                all.extend(self.judge(criterion, places, now, at_rest)?);
                continue;
            }
            // Of a slab whoever owns a point judges by what it gathers.
            let (n, counted) = (self.body.n_points(), self.body.counted());
            let chunk = |number: usize| {
                let points = number * CHUNK..n.min((number + 1) * CHUNK);
                let points = points.filter(|i| counted.contains(i));
                let row = |i: usize| self.neighborhood.row(i).iter().map(move |j| [i, j as usize]);
                let mut places: Vec<[usize; 2]> = match of_bonds {
                    true => points.flat_map(row).collect(),
                    false => points.map(|i| [i; 2]).collect(),
                };
                places.retain(|ends| self.is_of(usize::from(criterion.law), ends));
                let mut judged = self.judge(criterion, places, now, at_rest)?;
                judged.retain(|one| !one.margin.is_nan());
                Ok(judged)
            };
            let parts: Result<Vec<_>, NonFinite> =
                (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
            all.extend(parts?.concat());
        }
        Ok(all)
    }

    /// Judges places as their first points see them.
    fn judge(
        &self,
        criterion: &FamilyCriterion<FamilyKernel>,
        places: Vec<[usize; 2]>,
        now: At<'_>,
        at_rest: Option<At<'_>>,
    ) -> Result<Vec<Judged>, NonFinite> {
        let law = usize::from(criterion.law);
        let mut room = self.room.take(Room::default);
        let mut found = Vec::new();
        for places in places.chunks(CAPACITY) {
            let margin = (law, &criterion.margin);
            let rest = at_rest.map(|at_rest| self.values(margin, places, at_rest, &mut room));
            let rest = rest.transpose()?;
            let margins = self.values(margin, places, now, &mut room)?;
            criterion.judge(places, (&margins, rest.as_deref()), &mut found);
        }
        Ok(found)
    }

    /// A function at some places; not a number where it is none because what is left of a family spans no space, of
    /// which there is no inverse.
    fn values(
        &self,
        (law, kernel): (usize, &FamilyKernel),
        places: &[[usize; 2]],
        at: At<'_>,
        room: &mut Room,
    ) -> Result<Vec<f64>, NonFinite> {
        room.ends.clear();
        room.ends.extend_from_slice(places);
        self.prepare((law, kernel), (at, None), room);
        room.evaluate(kernel);
        for (ends, margin) in places.iter().zip(&mut room.value) {
            if margin.is_finite() {
                continue;
            }
            if ends.iter().all(|end| self.spans_space(*end)) {
                let gathered = at.values.get(ends[0] * self.n_gathered()).copied();
                return Err(self.named(ends[0], gathered, at.u));
            }
            *margin = f64::NAN;
        }
        Ok(room.value.clone())
    }
}
