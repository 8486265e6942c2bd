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
    changing: &'a mut Changing<D>,
}

/// Places that take a law, as one task works them out.
struct Work<const D: usize> {
    places: Vec<(Place, f64)>,
    h: Vec<Tensor<D>>,
    batch: LawBatch<D>,
    changing: Changing<D>,
}

/// Room for places whose states change.
#[derive(Default)]
struct Changing<const D: usize> {
    /// What states become at all places that are shown, state by state.
    next: Vec<f64>,
    /// Which of these change.
    lanes: Vec<usize>,
    places: Vec<(Place, f64)>,
    h: Vec<Tensor<D>>,
    /// How gradients change along the way.
    along: Vec<Tensor<D>>,
    /// The energy densities that go, and their powers.
    falls: [Vec<f64>; 2],
    /// The volumes of these places, and what of them counts.
    weights: Vec<f64>,
    counted: Vec<f64>,
}

impl<const D: usize> Work<D> {
    fn new() -> Work<D> {
        let (places, h, changing) = (Vec::new(), Vec::new(), Changing::default());
        Work { places, h, batch: LawBatch::new(), changing }
    }
}

impl DeformationEnergy {
    /// The same where gradients are gathered along lists of neighbours, also where a lattice has rows; to compare
    /// with. Before bonds break.
    pub fn in_batches(mut self) -> DeformationEnergy {
        self.operator.rows = None;
        self
    }

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
        let (counted, mut all) = (self.body.counted(), Vec::new());
        for criterion in &self.criteria {
            let judge = |shown: Shown<'_, D>| judge(criterion, asked != Asked::Breaking, shown);
            let function = self.function(&*criterion.margin, criterion.law);
            let found = match asked {
                Asked::Bond(ends) => self.around(function, fields, ends, judge),
                // Of a slab whoever owns a family judges it.
                _ => self.everywhere((function, |[i, _]| counted.contains(&i)), fields, judge),
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
            let are_whole = |ends: [usize; 2]| !ends.iter().any(|end| self.body.is_cut(*end));
            let parts = self.everywhere((function, are_whole), fields, change);
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
        let whole = self.whole.as_ref().map(|whole| &*whole.lost.neighborhood);
        let whole = whole.unwrap_or(self.operator.neighborhood());
        let mut work = Work::new();
        match &self.places {
            // One that is gone remembers what it did.
            Places::Bonds(bonds) if bonds.remembers() => {
                let bond = whole.bond_between(ends).unwrap_or(0);
                work.places.push((Place { ends, bond }, 0.0));
            }
            Places::Bonds(_) => work.places.push((Place { ends, bond: 0 }, 0.0)),
            _ => work.places.extend(ends.map(|end| (Place::at(end), 0.0))),
        }
        let takes = |place: &Place| function.law.part(place.ends, function.number).is_some();
        work.places.retain(|(place, _)| takes(place));
        self.show(function, fields, &mut work, &show)
    }

    /// Shows all places that are to be shown, by their ends: those of points in their order, those of bonds owner by
    /// owner.
    fn everywhere<const D: usize, T: Send>(
        &self,
        (function, shows): (Function<'_>, impl Fn([usize; 2]) -> bool + Sync),
        fields: Fields<'_, D>,
        show: impl Fn(Shown<'_, D>) -> Result<Vec<T>, Failure> + Sync,
    ) -> Result<Vec<T>, Failure> {
        let (n, neighborhood) = (self.body.n_points(), self.operator.neighborhood());
        let part = |points: [usize; 2]| function.law.part(points, function.number);
        let chunk = |work: &mut Work<D>, number: usize| {
            let points = number * CHUNK..n.min((number + 1) * CHUNK);
            work.places.clear();
            for i in points {
                match &self.places {
                    Places::Bonds(quadrature) => {
                        let bonds = neighborhood.bonds(i).zip(neighborhood.upper(i));
                        let place = |(bond, j): (usize, u32)| {
                            let (ends, number) = ([i, j as usize], quadrature.number(bond));
                            if !shows(ends) {
                                return None;
                            }
                            let weight = part(ends)? * quadrature.weight[bond];
                            Some((Place { ends, bond: number }, weight))
                        };
                        work.places.extend(bonds.filter_map(place));
                    }
                    // What is left of a released family determines no gradient.
                    _ if self.operator.is_released(i) || !shows([i; 2]) => {}
                    _ => {
                        let weight = part([i; 2]).map(|part| part * self.body.volumes()[i]);
                        work.places.extend(weight.map(|weight| (Place::at(i), weight)));
                    }
                }
            }
            self.show(function, fields, work, &show)
        };
        let chunks = (0..n.div_ceil(CHUNK)).into_par_iter();
        let parts: Result<Vec<_>, Failure> = chunks.map_init(Work::new, chunk).collect();
        let mut all = Vec::new();
        parts?.into_iter().for_each(|part| all.extend(part));
        Ok(all)
    }

    /// Shows the places of some work.
    fn show<const D: usize, T>(
        &self,
        function: Function<'_>,
        fields: Fields<'_, D>,
        Work { places, h, batch, changing }: &mut Work<D>,
        show: &impl Fn(Shown<'_, D>) -> Result<Vec<T>, Failure>,
    ) -> Result<Vec<T>, Failure> {
        let mut all = Vec::new();
        for places in places.chunks(CAPACITY) {
            h.clear();
            h.extend(places.iter().map(|(place, _)| self.gradient(fields, place)));
            let (batch, changing) = (&mut *batch, &mut *changing);
            all.extend(show(Shown { function, places, h, batch, changing })?);
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
        let Shown { function, places, h, batch, changing } = shown;
        let n = places.len();
        changing.next.clear();
        for one in &self.next {
            let next = self.energy.function(&*one.next, one.law);
            evaluate(next, (places, h), batch, false)?;
            changing.next.extend_from_slice(batch.psi());
        }
        let number = |place: &Place| if self.at_bonds { place.bond } else { place.ends[0] };
        changing.clear();
        for (lane, one) in places.iter().enumerate() {
            let number = number(&one.0);
            let mut next = self.next.iter().zip(changing.next.iter().skip(lane).step_by(n));
            let stays = self.at_bonds && self.breaking.binary_search(&number).is_ok();
            if !stays && next.any(|(state, next)| state.differs(self.states, number, *next)) {
                changing.lanes.push(lane);
                changing.places.push(*one);
                changing.h.push(h[lane]);
                changing.weights.push(one.1);
                changing.counted.push(one.1 * self.counted_share(one.0.ends));
                changing.along.extend(along(&one.0));
            }
        }
        let changed = changing.lanes.len();
        if changed > 0 {
            changing.hold(function, batch, 1.0)?;
            for (one, next) in self.next.iter().zip(changing.next.chunks(n)) {
                for (lane, (place, _)) in changing.lanes.iter().zip(&changing.places) {
                    self.states.set_state(one.field, number(place), next[*lane]);
                }
            }
            changing.hold(function, batch, -1.0)?;
        }
        // Points of a slab that do not count have no way: of its power whoever has a point tells the part of that.
        let Changing { falls: [energy, power], weights, counted, .. } = changing;
        Ok((changed, [Sum::of_products(energy, counted), Sum::of_products(power, weights)]))
    }

    /// The part of a place between these points that is of such as count.
    fn counted_share(&self, ends: [usize; 2]) -> f64 {
        let counted = self.energy.body.counted();
        ends.map(|end| if counted.contains(&end) { 0.5 } else { 0.0 }).iter().sum()
    }
}

impl<const D: usize> Changing<D> {
    /// Forgets the places that change.
    fn clear(&mut self) {
        let Changing { lanes, places, h, along, falls, weights, counted, .. } = self;
        lanes.clear();
        places.clear();
        h.clear();
        along.clear();
        weights.clear();
        counted.clear();
        falls.iter_mut().for_each(Vec::clear);
    }

    /// Adds what is held at these places, so many times, to what goes.
    fn hold(
        &mut self,
        function: Function<'_>,
        batch: &mut LawBatch<D>,
        times: f64,
    ) -> Result<(), Failure> {
        let Changing { places, h, along, falls: [energy, power], .. } = self;
        evaluate(function, (places, h), batch, !along.is_empty())?;
        energy.resize(h.len(), 0.0);
        power.resize(along.len(), 0.0);
        energy.iter_mut().zip(batch.psi()).for_each(|(sum, psi)| *sum += times * psi);
        for (lane, (sum, along)) in power.iter_mut().zip(along).enumerate() {
            let stress = batch.tensor(lane);
            let parts = stress.as_flattened().iter().zip(along.as_flattened());
            *sum += times * parts.fold(0.0, |sum, (p, h)| sum + p * h);
        }
        Ok(())
    }
}

/// Evaluates a function at places with their gradients.
fn evaluate<const D: usize>(
    function: Function<'_>,
    (places, h): (&[(Place, f64)], &[Tensor<D>]),
    batch: &mut LawBatch<D>,
    with_stress: bool,
) -> Result<(), Failure> {
    let laws = [function.number; CAPACITY];
    let law = (function.law, &laws[..places.len()]);
    let done = batch.evaluate(law, (|lane: usize| places[lane].0, h), with_stress);
    done.map_err(|lane| Failure {
        points: places[lane].0.ends.to_vec(),
        determinant: determinant(&h[lane]),
    })
}

/// Judges places: all of them with margins at rest, or those that break.
fn judge<const D: usize>(
    criterion: &FamilyCriterion,
    all: bool,
    mut shown: Shown<'_, D>,
) -> Result<Vec<Judged>, Failure> {
    let at_rest = match all {
        true => Some(shown.values(Some(&vec![[[0.0; D]; D]; shown.h.len()]))?),
        false => None,
    };
    let margins = shown.values(None)?;
    let ends: Vec<[usize; 2]> = shown.places.iter().map(|(place, _)| place.ends).collect();
    let mut found = Vec::new();
    criterion.judge(&ends, (&margins, at_rest.as_deref()), &mut found);
    Ok(found)
}

impl<const D: usize> Shown<'_, D> {
    /// The function at the places, at their gradients or at others.
    fn values(&mut self, others: Option<&[Tensor<D>]>) -> Result<Vec<f64>, Failure> {
        evaluate(self.function, (self.places, others.unwrap_or(self.h)), self.batch, false)?;
        Ok(self.batch.psi().to_vec())
    }
}
