//! What bonds, triangles, tetrahedra and points remember: states, and what these become at given displacements.
//!
//! A state is a field of its law of which each bond has a value of its own, or each triangle, or each
//! tetrahedron, so the energy takes it like a parameter that varies. The next values follow from the measure,
//! the time since the last and the values as they are; none sees another. Here bonds are worked out, in
//! `cliques` triangles and tetrahedra; what is remembered with deformation gradients and with gathered values is
//! worked out by the energies of these.

mod cliques;

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::criteria::{CHUNK, Candidate, Room, room_for};
use super::walk::OfOwners;
use crate::body::Body;
use crate::element::{CAPACITY, Element as _, MeasureElement, Order};
use crate::energy::NonFinite;
use crate::interaction::{Lost, Ranks};
use crate::kernel::{Law, Measure};
use crate::materials::{Fields, Materials, Parts, StateOf};
use crate::neighborhood::Neighborhood;

/// Interactions whose states are worked out and changed at a time, more or less: as many as fit a cache.
const BLOCK: usize = 1 << 16;

/// What a state becomes.
pub struct NextState {
    /// Of which interactions it is a state.
    pub measure: Measure,
    /// The number of the state among the fields of its law.
    pub field: usize,
    /// The next value, in the place of psi. It takes the fields of the law, and behind them the time in s
    /// since the last change if it takes one more; where the law has a field for the time step it is there.
    pub next: Box<dyn Law>,
}

/// The states of the potentials of a body that add up to one energy.
pub struct Layer {
    /// Those of each law of the materials.
    pub of_law: Vec<Vec<NextState>>,
    /// Which laws interactions take, with the fields among which the states are.
    pub materials: Arc<Materials>,
}

/// What the bonds of a body remember, its triangles and its tetrahedra; by default nothing.
#[derive(Default)]
pub struct Memory {
    layers: Vec<Rules>,
    /// Triangles, and tetrahedra, where these remember anything.
    cliques: [Option<OfOwners>; 2],
}

/// Of each law the states of one kind, with their numbers among all fields.
type OfLaws = Vec<Vec<(usize, MeasureElement)>>;

/// A [`Layer`] as functions of bonds, triangles and tetrahedra.
struct Rules {
    of_kinds: [OfLaws; 3],
    materials: Arc<Materials>,
    fields: Arc<Fields>,
}

/// Another value of a state.
#[derive(Clone, Copy, Debug)]
struct Change {
    layer: usize,
    field: usize,
    number: usize,
    value: f64,
}

/// The changes of some interactions of one kind at given displacements, all worked out from states as they were.
pub(super) struct Changes {
    all: Vec<Change>,
    /// Those that change by their numbers, ascending.
    pub(super) numbers: Vec<usize>,
}

impl Changes {
    fn new(parts: Vec<Vec<Change>>) -> Changes {
        let all = parts.concat();
        let mut numbers: Vec<usize> = all.iter().map(|change| change.number).collect();
        numbers.sort_unstable();
        numbers.dedup();
        Changes { all, numbers }
    }
}

/// What does not change its states: what is broken, and what is about to break.
#[derive(Clone, Copy)]
pub(super) struct Gone<'a> {
    pub(super) is_broken: &'a [bool],
    /// Bonds that are about to break, ascending.
    pub(super) breaking: &'a [usize],
    /// Of triangles and tetrahedra, where these remember anything.
    pub(super) lost: Option<&'a Lost>,
}

impl Memory {
    /// The states of some layers; interactions begin with the mean of what the fields of their points say.
    pub fn new((body, neighborhood): (&Body, &Neighborhood), layers: Vec<Layer>) -> Memory {
        let d = body.dimension();
        let layers = layers.into_iter().filter_map(|layer| Rules::new(layer, d));
        let layers: Vec<Rules> = layers.collect();
        let remember = |measure: Measure| layers.iter().any(|rules| rules.have(measure));
        let cliques = super::CLIQUES
            .map(|measure| remember(measure).then(|| OfOwners::new((body, neighborhood), measure)));
        let memory = Memory { layers, cliques };
        memory.begin((body, neighborhood));
        memory
    }

    /// Gives all interactions their first states.
    fn begin(&self, (body, neighborhood): (&Body, &Neighborhood)) {
        for Rules { fields, .. } in &self.layers {
            let owners = 0..neighborhood.n_points();
            let ends = owners.flat_map(|owner| {
                neighborhood.upper(owner).iter().map(move |other| [owner, other as usize])
            });
            fields.begin_states(Measure::Length, None, |field| {
                ends.clone().map(|ends| fields.mean(field, ends.into_iter())).collect()
            });
            for all in self.cliques.iter().flatten() {
                cliques::begin(all, (body, neighborhood), fields);
            }
        }
    }

    /// Whether nothing is remembered.
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// The measures of what remembers anything, ascending.
    pub(super) fn kinds(&self) -> impl Iterator<Item = Measure> {
        let remember = |measure: &Measure| self.layers.iter().any(|rules| rules.have(*measure));
        Measure::ALL.into_iter().filter(remember)
    }

    /// Whether triangles or tetrahedra remember anything.
    pub(super) fn has_cliques(&self) -> bool {
        self.cliques.iter().any(Option::is_some)
    }

    /// The triangles, or the tetrahedra, where these remember anything.
    pub(super) fn cliques(&self, measure: Measure) -> Option<&OfOwners> {
        self.cliques.get((measure as usize).wrapping_sub(1))?.as_ref()
    }

    /// Their numbers.
    pub(super) fn ranks(&self, measure: Measure) -> Option<&Ranks> {
        self.cliques(measure).map(|all| &all.ranks)
    }

    /// Stretches of owners whose states of one kind are changed one after the other.
    pub(super) fn blocks(
        &self,
        neighborhood: &Neighborhood,
        measure: Measure,
    ) -> Vec<Range<usize>> {
        let n = neighborhood.n_points();
        let ranks = self.ranks(measure);
        let start = |owner: usize| match ranks {
            Some(ranks) => ranks.first(owner),
            None => neighborhood.bond_starts()[owner],
        };
        let mut blocks: Vec<Range<usize>> = Vec::new();
        for owner in 0..n {
            match blocks.last_mut() {
                Some(block) if start(owner) < start(block.start) + BLOCK => block.end = owner + 1,
                _ => blocks.push(owner..owner + 1),
            }
        }
        blocks
    }

    /// What the states of one kind of some owners become at displacements `u` in m (`n x d`), `dt` s after the
    /// last change; only what changes.
    ///
    /// # Errors
    /// Next values that are not finite.
    pub(super) fn changes(
        &self,
        around: (&Body, &Neighborhood),
        at: (&[f64], f64),
        (measure, owners): (Measure, Range<usize>),
        gone: Gone<'_>,
    ) -> Result<Changes, NonFinite> {
        match (self.cliques(measure), gone.lost) {
            (Some(all), Some(lost)) => self.changes_of_cliques(all, (around, lost), at, owners),
            _ => {
                let Gone { is_broken, breaking, .. } = gone;
                let stays = |b: usize| !is_broken[b] && breaking.binary_search(&b).is_err();
                self.changes_of_bonds(around, at, owners, stays)
            }
        }
    }

    /// The same of bonds that are `intact`.
    fn changes_of_bonds(
        &self,
        around: (&Body, &Neighborhood),
        (u, dt): (&[f64], f64),
        owners: Range<usize>,
        intact: impl Fn(usize) -> bool + Sync,
    ) -> Result<Changes, NonFinite> {
        let Range { start, end } = owners;
        // An eighth of those that are judged: here every bond is worked out.
        let size = CHUNK / 8;
        let chunks: Vec<Range<usize>> =
            (start..end).step_by(size).map(|k| k..end.min(k + size)).collect();
        let parts: Result<Vec<Vec<Change>>, NonFinite> = chunks
            .into_par_iter()
            .map(|owners| match around.0.dimension() {
                2 => self.changes_of::<2>(around, (u, dt), owners, &intact),
                _ => self.changes_of::<3>(around, (u, dt), owners, &intact),
            })
            .collect();
        Ok(Changes::new(parts?))
    }

    fn changes_of<const D: usize>(
        &self,
        (body, neighborhood): (&Body, &Neighborhood),
        (u, dt): (&[f64], f64),
        owners: Range<usize>,
        intact: &impl Fn(usize) -> bool,
    ) -> Result<Vec<Change>, NonFinite> {
        let (positions, displacements) =
            (body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
        let mut room = room_for(D);
        let (mut bonds, mut changes) = (Vec::new(), Vec::new());
        for owner in owners {
            let numbers = neighborhood.bonds(owner).zip(neighborhood.upper(owner));
            let own = numbers.filter(|(bond, _)| intact(*bond)).map(|(bond, other)| {
                Candidate::new(bond, [owner, other as usize], positions, displacements)
            });
            bonds.extend(own);
            if bonds.len() >= CAPACITY {
                self.add_changes(&bonds, (u, dt), &mut room, &mut changes)?;
                bonds.clear();
            }
        }
        self.add_changes(&bonds, (u, dt), &mut room, &mut changes)?;
        Ok(changes)
    }

    fn add_changes<const D: usize>(
        &self,
        bonds: &[Candidate<D>],
        (u, dt): (&[f64], f64),
        room: &mut Room,
        changes: &mut Vec<Change>,
    ) -> Result<(), NonFinite> {
        for (layer, rules) in self.layers.iter().enumerate() {
            let of_laws = &rules.of_kinds[Measure::Length as usize];
            for (law, states) in of_laws.iter().enumerate() {
                if states.is_empty() {
                    continue;
                }
                let is_alone = of_laws.len() == 1;
                let takes = |bond: &&Candidate<D>| {
                    is_alone || rules.parts(&bond.ends).iter().any(|part| part.0 == law)
                };
                let own: Vec<&Candidate<D>> = bonds.iter().filter(takes).collect();
                for bonds in own.chunks(CAPACITY) {
                    for (field, element) in states {
                        rules.next((law, element), bonds, (u, dt), room)?;
                        let next = bonds.iter().zip(&room.1.energy);
                        changes.extend(next.filter_map(|(candidate, &value)| {
                            rules.change(layer, *field, candidate.bond, value)
                        }));
                    }
                }
            }
        }
        Ok(())
    }

    /// Makes changes.
    pub(super) fn make(&self, changes: &Changes) {
        for &Change { layer, field, number, value } in &changes.all {
            self.layers[layer].fields.set_state(field, number, value);
        }
    }

    /// All states: layer by layer, state by state, in the order of what remembers them.
    pub(super) fn all(&self) -> Vec<f64> {
        let states = self.states().flat_map(|(rules, field)| {
            let all = 0..rules.fields.n_remembering(field);
            all.map(move |number| rules.fields.state(field, number).unwrap_or(f64::NAN))
        });
        states.collect()
    }

    /// Gives back the states that [`Memory::all`] told.
    pub(super) fn set_all(&self, all: &[f64]) {
        let mut values = all.iter();
        for (rules, field) in self.states() {
            let own = 0..rules.fields.n_remembering(field);
            let set = |(number, value): (usize, &f64)| {
                rules.fields.set_state(field, number, *value);
            };
            own.zip(&mut values).for_each(set);
        }
    }

    /// Lets laws follow what comes to be remembered in `dt` s; below 0 they hold what is remembered.
    pub(super) fn set_time_step(&self, dt: f64) {
        self.layers.iter().for_each(|rules| rules.fields.set_time_step(dt));
    }

    /// What remembers a state, by its number.
    pub(super) fn kind_of(&self, number: usize) -> Option<StateOf> {
        let (rules, field) = self.states().nth(number)?;
        rules.fields.kind_of_state(field)
    }

    /// A state of an interaction by its number, or of a point, with the part that the law of the state has in
    /// it; nothing where it has none.
    pub(super) fn state_of(
        &self,
        number: usize,
        kind: StateOf,
        (own, points): (usize, &[usize]),
    ) -> Option<(f64, f64)> {
        let (rules, field) = self.states().nth(number)?;
        if rules.fields.kind_of_state(field) != Some(kind) {
            return None;
        }
        let n_laws = rules.of_kinds[0].len();
        let law = (0..n_laws).find(|law| rules.fields.of_law(*law).contains(&field))?;
        let parts = rules.parts(points);
        let (_, part) = parts.iter().find(|part| part.0 == law)?;
        Some((part, rules.fields.state(field, own)?))
    }

    /// How many states there are.
    pub(super) fn n_states(&self) -> usize {
        self.states().count()
    }

    /// The states of all layers, by the numbers of their fields.
    fn states(&self) -> impl Iterator<Item = (&Rules, usize)> {
        self.layers
            .iter()
            .flat_map(|rules| rules.fields.numbers_of_states().map(move |field| (rules, field)))
    }
}

impl Rules {
    /// Those of a layer whose laws have states.
    fn new(layer: Layer, dimension: usize) -> Option<Rules> {
        let fields = Arc::clone(layer.materials.shared_fields()?);
        fields.numbers_of_states().next()?;
        let nothing = || layer.of_law.iter().map(|_| Vec::new()).collect::<OfLaws>();
        let mut of_kinds = [(); 3].map(|()| nothing());
        for (law, own) in layer.of_law.into_iter().enumerate() {
            let first = fields.of_law(law).start;
            // There are no tetrahedra in the plane.
            let own = own.into_iter().filter(|next| next.measure.points() <= dimension + 1);
            for NextState { measure, field, next } in own {
                let element = MeasureElement::new(measure, dimension, next);
                of_kinds[measure as usize][law].push((first + field, element));
            }
        }
        Some(Rules { of_kinds, materials: layer.materials, fields })
    }

    /// Whether interactions of this measure remember anything.
    fn have(&self, measure: Measure) -> bool {
        !self.of_kinds[measure as usize].iter().all(Vec::is_empty)
    }

    /// The laws of an interaction of these points.
    fn parts(&self, points: &[usize]) -> Parts {
        let mut corners = [0; 4];
        let corners = &mut corners[..points.len()];
        corners.iter_mut().zip(points).for_each(|(corner, p)| *corner = self.materials.of(*p));
        self.materials.parts(corners)
    }

    /// Another value of a state, if it is another.
    fn change(&self, layer: usize, field: usize, number: usize, value: f64) -> Option<Change> {
        let is_same = self.fields.state(field, number)?.to_bits() == value.to_bits();
        (!is_same).then_some(Change { layer, field, number, value })
    }

    /// Works out the next values of a state of some bonds, as energies in the room.
    fn next<const D: usize>(
        &self,
        (law, element): (usize, &MeasureElement),
        bonds: &[&Candidate<D>],
        (u, dt): (&[f64], f64),
        (batch, out): &mut Room,
    ) -> Result<(), NonFinite> {
        batch.fill(bonds.len(), |lane| (bonds[lane].xi, bonds[lane].eta, 1.0));
        if element.n_fields() > 0 {
            let fields = (&*self.fields, self.fields.of_law(law));
            let numbered = bonds.iter().map(|bond| (bond.ends.into_iter(), bond.bond));
            batch.take_fields(fields.clone(), Measure::Length, numbered);
            batch.take_time_step(fields, element.n_fields(), dt);
        }
        let evaluated = element.evaluate(batch, Order::Energy, out);
        evaluated.map_err(|lane| bonds[lane.lane].refused(lane.value, lane.reference, u))
    }
}
