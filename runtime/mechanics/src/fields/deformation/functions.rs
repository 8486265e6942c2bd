//! Functions of deformation gradients that are no energies: conditions under which bonds break, and what is
//! remembered next. With bond quadrature a bond is judged by its own gradient and remembers with it, with
//! gradients at points a point does, and breaks all of its bonds.

use rayon::prelude::*;

use super::batch::{CAPACITY, LawBatch, determinant};
use super::quadrature::Bond;
use super::sweep::{Failure, Fields};
use super::{DeformationEnergy, Places, Room};
use crate::energy::NonFinite;
use crate::fields::stored::Tensor;
use crate::fracture::{Asked, Change, FamilyCriterion, FamilyNextState, Judged};
use crate::kernel::VariablesLaw;
use crate::materials::{LawOfPoints, Place};

/// Owners whose places are worked out by one task; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// A function of deformation gradients, with the law to which it belongs: of the places that take this.
#[derive(Clone, Copy)]
struct Function<'a> {
    law: LawOfPoints<'a>,
    number: u8,
}

/// Places of a law with their displacement gradients, and what works out functions there.
struct Shown<'a, const D: usize> {
    function: Function<'a>,
    places: &'a [Place],
    h: &'a [Tensor<D>],
    batch: &'a mut LawBatch<D>,
}

impl DeformationEnergy {
    /// The same with conditions under which bonds break.
    pub fn with_criteria(self, criteria: Vec<FamilyCriterion>) -> DeformationEnergy {
        DeformationEnergy { criteria, ..self }
    }

    /// The same with what is remembered.
    pub fn with_next_states(self, next_states: Vec<FamilyNextState>) -> DeformationEnergy {
        DeformationEnergy { next_states, ..self }
    }

    fn function<'a>(&'a self, function: &'a dyn VariablesLaw, number: u8) -> Function<'a> {
        Function { law: LawOfPoints { law: function, ..self.law() }, number }
    }

    /// See [`crate::energy::Energy::field_margins`].
    pub(super) fn margins<const D: usize>(
        &self,
        u: &[f64],
        asked: Asked,
    ) -> Result<Vec<Judged>, NonFinite> {
        let mut room = self.room.take(Room::default);
        let h = self.gradients_in::<D>(u, &mut room.h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let mut all = Vec::new();
        for criterion in &self.criteria {
            let judge = |shown: Shown<'_, D>| judge(criterion, asked != Asked::Breaking, shown);
            let function = self.function(&*criterion.margin, criterion.law);
            let found = match asked {
                Asked::Bond(ends) => self.around(function, fields, ends, judge),
                _ => self.everywhere(function, fields, judge),
            };
            all.extend(found.map_err(|failure| self.failed(failure, u))?);
        }
        Ok(all)
    }

    /// See [`crate::energy::Energy::field_changes`].
    pub(super) fn next_changes<const D: usize>(&self, u: &[f64]) -> Result<Vec<Change>, NonFinite> {
        let mut room = self.room.take(Room::default);
        let h = self.gradients_in::<D>(u, &mut room.h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let Some(states) = self.law().fields() else { return Ok(Vec::new()) };
        let at_bonds = matches!(self.places, Places::Bonds(_));
        let mut all = Vec::new();
        for one in &self.next_states {
            let change = |mut shown: Shown<'_, D>| {
                let next = shown.values(None)?;
                let number = |place: &Place| if at_bonds { place.bond } else { place.ends[0] };
                let changes = shown.places.iter().zip(next);
                let changes = changes.filter_map(|(place, x)| one.change(states, number(place), x));
                Ok(changes.collect())
            };
            let found = self.everywhere(self.function(&*one.next, one.law), fields, change);
            all.extend(found.map_err(|failure| self.failed(failure, u))?);
        }
        Ok(all)
    }

    /// Shows the places by which a bond is judged.
    fn around<const D: usize, T>(
        &self,
        function: Function<'_>,
        fields: Fields<'_, D>,
        ends: [usize; 2],
        show: impl Fn(Shown<'_, D>) -> Result<Vec<T>, Failure>,
    ) -> Result<Vec<T>, Failure> {
        let bond = || self.operator.neighborhood().bond_between(ends);
        let places = match &self.places {
            Places::Bonds(bonds) => {
                // One that is gone is judged as if it were there, with what it began with.
                let known = if bonds.remembers() { bond() } else { None };
                vec![Place { ends, bond: known.map_or(0, |bond| bonds.number(bond)) }]
            }
            _ => ends.map(Place::at).to_vec(),
        };
        self.show(function, fields, &places, &mut LawBatch::new(), &show)
    }

    /// Shows all places, those of points in their order, those of bonds owner by owner.
    fn everywhere<const D: usize, T: Send>(
        &self,
        function: Function<'_>,
        fields: Fields<'_, D>,
        show: impl Fn(Shown<'_, D>) -> Result<Vec<T>, Failure> + Sync,
    ) -> Result<Vec<T>, Failure> {
        let (n, neighborhood) = (self.body.n_points(), self.operator.neighborhood());
        let chunk = |number: usize| {
            let points = number * CHUNK..n.min((number + 1) * CHUNK);
            let mut places: Vec<Place> = Vec::new();
            for i in points {
                match &self.places {
                    Places::Bonds(quadrature) => {
                        let bonds = neighborhood.bonds(i).zip(neighborhood.upper(i));
                        places.extend(bonds.map(|(bond, &j)| Place {
                            ends: [i, j as usize],
                            bond: quadrature.number(bond),
                        }));
                    }
                    // What is left of a released family determines no gradient.
                    _ if self.operator.is_released(i) => {}
                    _ => places.push(Place::at(i)),
                }
            }
            self.show(function, fields, &places, &mut LawBatch::new(), &show)
        };
        let parts: Result<Vec<_>, Failure> =
            (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        let mut all = Vec::new();
        parts?.into_iter().for_each(|part| all.extend(part));
        Ok(all)
    }

    /// Shows those of some places that take the law.
    fn show<const D: usize, T>(
        &self,
        function: Function<'_>,
        fields: Fields<'_, D>,
        places: &[Place],
        batch: &mut LawBatch<D>,
        show: &impl Fn(Shown<'_, D>) -> Result<Vec<T>, Failure>,
    ) -> Result<Vec<T>, Failure> {
        let positions = self.body.positions().as_chunks::<D>().0;
        let gradient = |place: &Place| match place.ends {
            [i, j] if i == j => fields.h[i],
            ends => Bond::new(positions, ends, place.bond).gradient(fields),
        };
        let takes = |place: &&Place| function.law.part(place.ends, function.number).is_some();
        let own: Vec<Place> = places.iter().filter(takes).copied().collect();
        let mut all = Vec::new();
        for places in own.chunks(CAPACITY) {
            let h: Vec<Tensor<D>> = places.iter().map(gradient).collect();
            all.extend(show(Shown { function, places, h: &h, batch: &mut *batch })?);
        }
        Ok(all)
    }
}

/// Judges places: all of them with margins at rest, or those that break.
fn judge<const D: usize>(
    criterion: &FamilyCriterion,
    all: bool,
    mut shown: Shown<'_, D>,
) -> Result<Vec<Judged>, Failure> {
    let nowhere = vec![[[0.0; D]; D]; shown.h.len()];
    let at_rest = all.then(|| shown.values(Some(&nowhere))).transpose()?;
    let margins = shown.values(None)?;
    let ends: Vec<[usize; 2]> = shown.places.iter().map(|place| place.ends).collect();
    let mut found = Vec::new();
    criterion.judge(&ends, (&margins, at_rest.as_deref()), &mut found);
    Ok(found)
}

impl<const D: usize> Shown<'_, D> {
    /// The function at the places, at their gradients or at others.
    fn values(&mut self, others: Option<&[Tensor<D>]>) -> Result<Vec<f64>, Failure> {
        let (places, h) = (self.places, others.unwrap_or(self.h));
        let laws = vec![self.function.number; places.len()];
        let law = (self.function.law, &laws[..]);
        let done = self.batch.evaluate(law, (|lane: usize| places[lane], h), false);
        done.map_err(|lane| Failure {
            points: places[lane].ends.to_vec(),
            determinant: determinant(&h[lane]),
        })?;
        Ok(self.batch.psi().to_vec())
    }
}
