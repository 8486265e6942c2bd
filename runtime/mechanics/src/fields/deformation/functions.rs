//! Functions of deformation gradients that are no energies: conditions under which bonds break, and what is
//! remembered next. With bond quadrature a bond is judged by its own gradient and remembers with it, with
//! gradients at points a point does, and breaks all of its bonds.

use rayon::prelude::*;

use super::batch::{CAPACITY, LawBatch, determinant};
use super::quadrature::Bond;
use super::sweep::{Failure, Fields};
use super::{DeformationEnergy, Places, Room};
use crate::assembly::sum::Sum;
use crate::energy::NonFinite;
use crate::fields::stored::Tensor;
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};
use crate::kernel::VariablesLaw;
use crate::materials::{Fields as FieldsOfLaws, LawOfPoints, Place};

/// Owners whose places are worked out by one task; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// A function of deformation gradients, with the law to which it belongs: of the places that take this.
#[derive(Clone, Copy)]
struct Function<'a> {
    law: LawOfPoints<'a>,
    number: u8,
}

/// Places of a law with the volumes that count for it there in m^d, and their displacement gradients; and what
/// works out functions there.
struct Shown<'a, const D: usize> {
    function: Function<'a>,
    places: &'a [(Place, f64)],
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

    /// See [`crate::energy::Energy::change_field_states`].
    pub(super) fn change_states<const D: usize>(
        &self,
        u: &[f64],
        (step, direction): (f64, &[f64]),
        breaking: &[usize],
    ) -> Result<Release, NonFinite> {
        let Some(states) = self.law().fields() else { return Ok(Release::default()) };
        let (mut room, mut of_way) = (self.room.take(Room::default), self.room.take(Room::default));
        let h = self.gradients_in::<D>(u, &mut room.h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let along = (step != 0.0).then(|| {
            let h = self.gradients_in::<D>(direction, &mut of_way.h);
            Fields { u: direction.as_chunks::<D>().0, h }
        });
        let at_bonds = matches!(self.places, Places::Bonds(_));
        let mut laws: Vec<u8> = self.next_states.iter().map(|one| one.law).collect();
        laws.dedup();
        let (mut release, mut sums) = (Release::default(), [Sum::default(); 2]);
        for law in laws {
            let next: Vec<&FamilyNextState> =
                self.next_states.iter().filter(|one| one.law == law).collect();
            let remembering = Remembering { energy: self, next, states, at_bonds, breaking };
            let change = |shown: Shown<'_, D>| {
                Ok(vec![remembering.change(shown, |place| Some(self.gradient(along?, place)))?])
            };
            let function = self.function(&*self.law, law);
            let parts = self.everywhere(function, fields, change);
            for (changed, [energy, power]) in parts.map_err(|failure| self.failed(failure, u))? {
                release.changed += changed;
                sums[0].join(&energy);
                sums[1].join(&power);
            }
        }
        let [energy, power] = sums.map(|sum| sum.value());
        Ok(Release { dissipated: energy, timing: 0.5 * step * power, ..release })
    }

    /// `F - I` of a bond, or of a point in the place of both of its ends.
    fn gradient<const D: usize>(&self, fields: Fields<'_, D>, place: &Place) -> Tensor<D> {
        match place.ends {
            [i, j] if i == j => fields.h[i],
            ends => {
                let positions = self.body.positions().as_chunks::<D>().0;
                Bond::new(positions, ends, place.bond).gradient(fields)
            }
        }
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
                let place = Place { ends, bond: known.map_or(0, |bond| bonds.number(bond)) };
                vec![(place, 0.0)]
            }
            _ => ends.map(|end| (Place::at(end), 0.0)).to_vec(),
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
            let mut places: Vec<(Place, f64)> = Vec::new();
            for i in points {
                match &self.places {
                    Places::Bonds(quadrature) => {
                        let bonds = neighborhood.bonds(i).zip(neighborhood.upper(i));
                        places.extend(bonds.map(|(bond, &j)| {
                            let (ends, number) = ([i, j as usize], quadrature.number(bond));
                            (Place { ends, bond: number }, quadrature.weight[bond])
                        }));
                    }
                    // What is left of a released family determines no gradient.
                    _ if self.operator.is_released(i) => {}
                    _ => places.push((Place::at(i), self.body.volumes()[i])),
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

    /// Shows those of some places that take the law, by the parts that it has in them.
    fn show<const D: usize, T>(
        &self,
        function: Function<'_>,
        fields: Fields<'_, D>,
        places: &[(Place, f64)],
        batch: &mut LawBatch<D>,
        show: &impl Fn(Shown<'_, D>) -> Result<Vec<T>, Failure>,
    ) -> Result<Vec<T>, Failure> {
        let own: Vec<(Place, f64)> = places
            .iter()
            .filter_map(|(place, weight)| {
                Some((*place, function.law.part(place.ends, function.number)? * weight))
            })
            .collect();
        let mut all = Vec::new();
        for places in own.chunks(CAPACITY) {
            let h: Vec<Tensor<D>> =
                places.iter().map(|(place, _)| self.gradient(fields, place)).collect();
            all.extend(show(Shown { function, places, h: &h, batch: &mut *batch })?);
        }
        Ok(all)
    }
}

/// The states of one law that change.
struct Remembering<'a> {
    energy: &'a DeformationEnergy,
    next: Vec<&'a FamilyNextState>,
    states: &'a FieldsOfLaws,
    at_bonds: bool,
    /// The numbers of bonds that are about to break, ascending: they stay as they are.
    breaking: &'a [usize],
}

impl Remembering<'_> {
    /// Changes the states of places, all worked out from states as they are: how many places change, and what
    /// the energy falls by with that, and its power along a way, where `along` tells the gradients of this.
    fn change<const D: usize>(
        &self,
        shown: Shown<'_, D>,
        along: impl Fn(&Place) -> Option<Tensor<D>>,
    ) -> Result<(usize, [Sum; 2]), Failure> {
        let values = |one: &&FamilyNextState| {
            let function = self.energy.function(&*one.next, one.law);
            Shown { function, batch: &mut *shown.batch, ..shown }.values(None)
        };
        let next: Vec<Vec<f64>> = self.next.iter().map(values).collect::<Result<_, _>>()?;
        let number = |place: &Place| if self.at_bonds { place.bond } else { place.ends[0] };
        let changes = |lane: &usize| {
            let number = number(&shown.places[*lane].0);
            let differs = |(one, next): (&&FamilyNextState, &Vec<f64>)| {
                one.differs(self.states, number, next[*lane])
            };
            let stays = self.at_bonds && self.breaking.binary_search(&number).is_ok();
            !stays && self.next.iter().zip(&next).any(differs)
        };
        let lanes: Vec<usize> = (0..shown.places.len()).filter(changes).collect();
        if lanes.is_empty() {
            return Ok((0, [Sum::default(); 2]));
        }
        let places: Vec<(Place, f64)> = lanes.iter().map(|lane| shown.places[*lane]).collect();
        let h: Vec<Tensor<D>> = lanes.iter().map(|lane| shown.h[*lane]).collect();
        let of_way: Option<Vec<Tensor<D>>> = places.iter().map(|(place, _)| along(place)).collect();
        let (function, batch) = (shown.function, shown.batch);
        let mut held = || {
            let changing = Shown { function, places: &places, h: &h, batch: &mut *batch };
            changing.held(of_way.as_deref())
        };
        let before = held()?;
        for (one, next) in self.next.iter().zip(&next) {
            for (lane, (place, _)) in lanes.iter().zip(&places) {
                self.states.set_state(one.field, number(place), next[*lane]);
            }
        }
        let after = held()?;
        let weights: Vec<f64> = places.iter().map(|(_, weight)| *weight).collect();
        let fall = |k: usize| {
            let falls = before[k].iter().zip(&after[k]).map(|(before, after)| before - after);
            Sum::of_products(&falls.collect::<Vec<f64>>(), &weights)
        };
        Ok((lanes.len(), [fall(0), fall(1)]))
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
    let ends: Vec<[usize; 2]> = shown.places.iter().map(|(place, _)| place.ends).collect();
    let mut found = Vec::new();
    criterion.judge(&ends, (&margins, at_rest.as_deref()), &mut found);
    Ok(found)
}

impl<const D: usize> Shown<'_, D> {
    /// The function at the places, at their gradients or at others.
    fn values(&mut self, others: Option<&[Tensor<D>]>) -> Result<Vec<f64>, Failure> {
        self.evaluate(others.unwrap_or(self.h), false)?;
        Ok(self.batch.psi().to_vec())
    }

    /// The function, and its power where gradients change like this; nothing of the latter without.
    fn held(mut self, along: Option<&[Tensor<D>]>) -> Result<[Vec<f64>; 2], Failure> {
        self.evaluate(self.h, along.is_some())?;
        let power = |(lane, along): (usize, &Tensor<D>)| {
            let (stress, along) = (self.batch.tensor(lane), along.as_flattened());
            stress.as_flattened().iter().zip(along).fold(0.0, |sum, (p, h)| sum + p * h)
        };
        let powers = along.iter().flat_map(|all| all.iter().enumerate().map(power)).collect();
        Ok([self.batch.psi().to_vec(), powers])
    }

    fn evaluate(&mut self, h: &[Tensor<D>], with_stress: bool) -> Result<(), Failure> {
        let places = self.places;
        let laws = vec![self.function.number; places.len()];
        let law = (self.function.law, &laws[..]);
        let done = self.batch.evaluate(law, (|lane: usize| places[lane].0, h), with_stress);
        done.map_err(|lane| Failure {
            points: places[lane].0.ends.to_vec(),
            determinant: determinant(&h[lane]),
        })
    }
}
