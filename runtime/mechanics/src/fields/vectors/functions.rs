//! Functions of what points gather of vectors that are no energies: conditions under which bonds break, and what points
//! remember next. A condition that holds what belongs to a bond is asked of a bond as each of its ends sees it, another
//! of a point, and breaks all of its bonds.

use piola_compiler::FamilyKernel;

use super::VectorEnergy;
use super::passes::{At, Gathered, Room};
use crate::energy::NonFinite;
use crate::fields::judged::Question;
use crate::fields::remembered;
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};

impl VectorEnergy {
    /// The same with conditions under which bonds break.
    pub fn with_criteria(self, criteria: Vec<FamilyCriterion<FamilyKernel>>) -> VectorEnergy {
        VectorEnergy { criteria, ..self }
    }

    /// The same with what points remember.
    pub fn with_next_states(self, next_states: Vec<FamilyNextState<FamilyKernel>>) -> VectorEnergy {
        VectorEnergy { next_states, ..self }
    }

    /// See [`crate::energy::Energy::change_field_states`].
    pub(super) fn change_states<const D: usize>(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
    ) -> Result<Release, NonFinite> {
        let Some(fields) = self.fields() else { return Ok(Release::default()) };
        let values = self.gathered_in::<D>(u);
        let now = At { u, values: &values, adjoint: &[] };
        // What is left of a released family says nothing: its point goes on remembering what it did.
        let takes = |one: &FamilyNextState<FamilyKernel>, i: usize| {
            self.is_of(usize::from(one.law), &[i; 2]) && !self.body.is_cut(i)
        };
        let next = |one: &FamilyNextState<FamilyKernel>, places: &[[usize; 2]]| {
            self.values((usize::from(one.law), &one.next), places, now)
        };
        let points = (fields, self.body.n_points());
        let mut changes = remembered::changes(&self.next_states, points, takes, next)?;
        // No number where too little is left to work one out.
        changes.retain(|(.., next)| !next.is_nan());
        remembered::release(self, fields, &changes, (u, way))
    }

    fn gathered_in<const D: usize>(&self, u: &[f64]) -> Vec<f64> {
        let mut gathered = Gathered::default();
        self.gather::<D>(u, None, &mut gathered);
        gathered.values
    }

    /// See [`crate::energy::Energy::field_margins`].
    pub(super) fn margins<const D: usize>(
        &self,
        u: &[f64],
        asked: Asked,
    ) -> Result<Vec<Judged>, NonFinite> {
        let nowhere = vec![0.0; u.len()];
        let now = self.gathered_in::<D>(u);
        let at_rest = (asked != Asked::Breaking).then(|| self.gathered_in::<D>(&nowhere));
        let now = At { u, values: &now, adjoint: &[] };
        let at_rest = at_rest.as_deref().map(|values| At { u: &nowhere, values, adjoint: &[] });
        let is_bond = matches!(asked, Asked::Bond(_));
        let mut all = Vec::new();
        for criterion in &self.criteria {
            let of_bonds = criterion.margin.of_bonds();
            let law = usize::from(criterion.law);
            // Of a bond all of its margins are told, those of released ends among them.
            let takes = |ends: &[usize; 2]| match is_bond {
                true => self.gathers_by(law, ends),
                false => self.is_of(law, ends),
            };
            let margins = |places: &[[usize; 2]]| {
                let margin = (law, &criterion.margin);
                let rest = at_rest.map(|at_rest| self.values(margin, places, at_rest));
                Ok((self.values(margin, places, now)?, rest.transpose()?))
            };
            let around = (&*self.body, &*self.neighborhood);
            let mut judged =
                Question { criterion, of_bonds, asked }.answer(around, takes, margins)?;
            judged.retain(|one| is_bond || !one.margin.is_nan());
            all.extend(judged);
        }
        Ok(all)
    }

    /// A function at some places; not a number where it is none because what is left of a family spans no space, of
    /// which there is no inverse.
    fn values(
        &self,
        (law, kernel): (usize, &FamilyKernel),
        places: &[[usize; 2]],
        at: At<'_>,
    ) -> Result<Vec<f64>, NonFinite> {
        let mut room = self.room.take(Room::default);
        room.ends.clear();
        room.ends.extend_from_slice(places);
        self.prepare((law, kernel), (at, None), &mut room);
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
