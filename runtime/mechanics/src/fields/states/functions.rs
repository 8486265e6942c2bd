//! Functions of gathered values that are no energies: conditions under which bonds break, and what points
//! remember next. A condition that holds the length of a bond is asked of a bond with what either of its ends
//! gathers, one without of a point, and breaks all of its bonds.

use rayon::prelude::*;

use super::StateEnergy;
use crate::energy::{Energy, NonFinite, total};
use crate::fields::judged::Question;
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};
use crate::geometry::Geometry;
use crate::geometry::bond::Bond;
use crate::kernel::{Variables, VariablesLaw};
use crate::materials::Fields;

/// Points that are worked out by one task, or whose bonds are; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// Places that go through a margin at once.
const CAPACITY: usize = 128;

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

    /// See [`crate::energy::Energy::change_field_states`]: of what points remember all bonds of a point depend,
    /// so it is the energy of the body that falls.
    pub(super) fn change_states<const D: usize>(
        &self,
        u: &[f64],
        (step, direction): (f64, &[f64]),
    ) -> Result<Release, NonFinite> {
        let Some(fields) = self.fields() else { return Ok(Release::default()) };
        let changes = self.changes_of_states::<D>(u, fields)?;
        if changes.is_empty() {
            return Ok(Release::default());
        }
        let mut forces = vec![0.0; u.len()];
        let mut parts = vec![0.0; self.names.len()];
        let mut held = || {
            self.counted_energy(u, Some(&mut forces), &mut parts)?;
            let energy = total(&parts);
            let power = forces.iter().zip(direction).fold(0.0, |sum, (force, v)| sum + force * v);
            Ok([energy, power])
        };
        let before = held()?;
        for (field, point, next) in &changes {
            fields.set_state(*field, *point, *next);
        }
        let after = held()?;
        let mut points: Vec<usize> = changes.iter().map(|change| change.1).collect();
        points.sort_unstable();
        points.dedup();
        Ok(Release {
            changed: points.len(),
            dissipated: before[0] - after[0],
            timing: 0.5 * step * (before[1] - after[1]),
            ..Release::default()
        })
    }

    /// What points remember next, of those that do not remember it already: fields, points and values.
    fn changes_of_states<const D: usize>(
        &self,
        u: &[f64],
        fields: &Fields,
    ) -> Result<Vec<(usize, usize, f64)>, NonFinite> {
        let integrals = self.integrals(u);
        let now = Deformed { integrals: &integrals, u };
        let n = self.body.n_points();
        let mut all = Vec::new();
        for one in &self.next_states {
            let chunk = |number: usize| {
                let points = number * CHUNK..n.min((number + 1) * CHUNK);
                // A point that has nothing to gather from any more goes on remembering what it did.
                let is_left = |i: &usize| !self.neighborhood.row(*i).is_empty();
                let there = points.filter(|i| is_left(i) && !self.body.is_cut(*i));
                let own = there.filter(|i| self.law_of(*i) == one.law).map(|i| [i; 2]);
                let own: Vec<[usize; 2]> = own.collect();
                let mut changes = Vec::new();
                for places in own.chunks(CAPACITY) {
                    let next = self.values::<D>((&*one.next, one.law), places, now)?;
                    let places = places.iter().zip(next);
                    let differs = |([i, _], x): &(&[usize; 2], f64)| one.differs(fields, *i, *x);
                    changes.extend(places.filter(differs).map(|([i, _], x)| (one.field, *i, x)));
                }
                Ok(changes)
            };
            let parts: Result<Vec<_>, NonFinite> =
                (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
            all.extend(parts?.concat());
        }
        Ok(all)
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
