//! Functions of gathered values that are no energies: conditions under which bonds break, and what points
//! remember next. A condition that holds the length of a bond is asked of a bond with what either of its ends
//! gathers, one without of a point, and breaks all of its bonds.

use super::StateEnergy;
use crate::energy::NonFinite;
use crate::fields::judged::Question;
use crate::fields::remembered;
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};
use crate::geometry::Geometry;
use crate::geometry::bond::Bond;
use crate::kernel::{Variables, VariablesLaw};

/// A body at some displacements: what points gather, point by point, and displacements in m.
#[derive(Clone, Copy)]
struct Deformed<'a> {
    integrals: &'a [f64],
    u: &'a [f64],
}

impl StateEnergy {
    /// The same where bonds go in batches through kernels, along lists of neighbours, also where a lattice and
    /// its laws allow rows; to compare with. Before bonds break.
    pub fn in_batches(self) -> StateEnergy {
        StateEnergy { rows: None, ..self }
    }

    /// The same with conditions under which bonds break.
    pub fn with_criteria(self, criteria: Vec<FamilyCriterion>) -> StateEnergy {
        StateEnergy { criteria, ..self }
    }

    /// The same with what points remember.
    pub fn with_next_states(self, next_states: Vec<FamilyNextState>) -> StateEnergy {
        StateEnergy { next_states, ..self }
    }

    /// See [`crate::energy::Energy::change_field_states`].
    pub(super) fn change_states<const D: usize>(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
    ) -> Result<Release, NonFinite> {
        let Some(fields) = self.fields() else { return Ok(Release::default()) };
        let integrals = self.integrals(u);
        let now = Deformed { integrals: &integrals, u };
        // A point that has nothing to gather from any more goes on remembering what it did.
        let takes = |one: &FamilyNextState, i: usize| {
            let is_left = !self.neighborhood.row(i).is_empty() && !self.body.is_cut(i);
            is_left && self.law_of(i) == one.law
        };
        let next = |one: &FamilyNextState, places: &[[usize; 2]]| {
            self.values::<D>((&*one.next, one.law), places, now)
        };
        let points = (fields, self.body.n_points());
        let changes = remembered::changes(&self.next_states, points, takes, next)?;
        remembered::release(self, fields, &changes, (u, way))
    }

    /// The law of a point.
    fn law_of(&self, point: usize) -> u8 {
        self.materials.as_ref().map_or(0, |materials| materials.of(point))
    }

    /// See [`crate::energy::Energy::field_margins`].
    pub(super) fn margins<const D: usize>(
        &self,
        u: &[f64],
        asked: Asked,
    ) -> Result<Vec<Judged>, NonFinite> {
        let integrals = self.integrals(u);
        let now = Deformed { integrals: &integrals, u };
        let nowhere = vec![0.0; u.len()];
        let at_rest = (asked != Asked::Breaking).then(|| self.integrals(&nowhere));
        let at_rest = at_rest.as_deref().map(|integrals| Deformed { integrals, u: &nowhere });
        let mut all = Vec::new();
        for criterion in &self.criteria {
            let of_bonds = self.holds_length(&*criterion.margin);
            let margin = (&*criterion.margin, criterion.law);
            let takes = |ends: &[usize; 2]| self.law_of(ends[0]) == criterion.law;
            let margins = |places: &[[usize; 2]]| {
                let rest = at_rest.map(|at_rest| self.values::<D>(margin, places, at_rest));
                Ok((self.values::<D>(margin, places, now)?, rest.transpose()?))
            };
            let around = (&*self.body, &*self.neighborhood);
            all.extend(Question { criterion, of_bonds, asked }.answer(around, takes, margins)?);
        }
        Ok(all)
    }

    /// Whether a condition holds the length of a bond, beside what points gather.
    fn holds_length(&self, function: &dyn VariablesLaw) -> bool {
        function.n_variables() > self.n_integrals()
    }

    /// A function at some places.
    fn values<const D: usize>(
        &self,
        (function, law): (&dyn VariablesLaw, u8),
        places: &[[usize; 2]],
        Deformed { integrals, u }: Deformed<'_>,
    ) -> Result<Vec<f64>, NonFinite> {
        let (n, m) = (places.len(), self.n_integrals());
        let positions = self.body.positions().as_chunks::<D>().0;
        let displacements = u.as_chunks::<D>().0;
        let (mut current, mut change, mut given) = (Vec::new(), Vec::new(), Vec::new());
        if self.holds_length(function) {
            for &[i, j] in places {
                let xi: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
                let eta = std::array::from_fn(|c| displacements[j][c] - displacements[i][c]);
                let now = <Bond as Geometry<D>>::change(&xi, &eta);
                current.push(now.measure);
                change.push(now.change);
                given.push(xi.iter().fold(0.0, |sum, x| sum + x * x).sqrt());
            }
        }
        current.extend((0..m).flat_map(|k| places.iter().map(move |[i, _]| integrals[i * m + k])));
        self.give(n, |place| places[place], &mut given);
        let laws = vec![law; n];
        let at = Variables { n, current: &current, change: &change, given: &given, laws: &laws };
        let mut margins = vec![0.0; n];
        function.evaluate(at, &mut margins, &mut []);
        match margins.iter().position(|margin| !margin.is_finite()) {
            Some(lane) => {
                let point = places[lane][0];
                Err(self.named(point, integrals.get(point * m).copied(), u))
            }
            None => Ok(margins),
        }
    }
}
