//! What bonds remember: states, and what these become at given displacements.
//!
//! A state is a field of its law of which each bond has a value of its own, so the energy takes it like a
//! parameter that varies. The next values of a bond follow from its length, the time since the last and its
//! values as they are; no bond sees another.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::criteria::{CHUNK, Candidate, Room, room_for};
use crate::body::Body;
use crate::element::{CAPACITY, Element as _, MeasureElement, Order};
use crate::energy::NonFinite;
use crate::kernel::{Law, Measure};
use crate::materials::{Fields, Materials};
use crate::neighborhood::Neighborhood;

/// Bonds whose states are worked out and changed at a time, more or less: as many as fit a cache.
const BLOCK: usize = 1 << 16;

/// What a state becomes.
pub struct NextState {
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
    /// Which laws bonds take, with the fields among which the states are.
    pub materials: Arc<Materials>,
}

/// What the bonds of a body remember; by default nothing.
#[derive(Default)]
pub struct Memory {
    layers: Vec<Rules>,
}

/// A [`Layer`] as functions of bonds.
struct Rules {
    /// With the numbers of the states among all fields.
    of_law: Vec<Vec<(usize, MeasureElement)>>,
    materials: Arc<Materials>,
    fields: Arc<Fields>,
}

/// Another value of a state.
#[derive(Clone, Copy, Debug)]
struct Change {
    layer: usize,
    field: usize,
    bond: usize,
    value: f64,
}

/// The changes of some bonds at given displacements, all worked out from states as they were.
pub(super) struct Changes {
    all: Vec<Change>,
    /// The bonds, ascending.
    pub(super) bonds: Vec<usize>,
}

impl Memory {
    /// The states of some layers; bonds begin with what the fields of their points say.
    pub fn new((body, neighborhood): (&Body, &Neighborhood), layers: Vec<Layer>) -> Memory {
        let with_states =
            layers.into_iter().filter(|layer| !layer.of_law.iter().all(Vec::is_empty));
        let rules = |layer: Layer| {
            let fields = Arc::clone(layer.materials.shared_fields()?);
            let owners = 0..neighborhood.n_points();
            let ends = owners.flat_map(|owner| {
                neighborhood.upper(owner).iter().map(move |other| [owner, *other as usize])
            });
            fields.begin_states(ends);
            let own = |(law, next): (usize, Vec<NextState>)| {
                let first = fields.of_law(law).start;
                let element = |NextState { field, next }| {
                    let element = MeasureElement::new(Measure::Length, body.dimension(), next);
                    (first + field, element)
                };
                next.into_iter().map(element).collect()
            };
            let of_law = layer.of_law.into_iter().enumerate().map(own).collect();
            Some(Rules { of_law, materials: layer.materials, fields })
        };
        Memory { layers: with_states.filter_map(rules).collect() }
    }

    /// Whether no bond remembers anything.
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// Stretches of owners whose states are changed one after the other.
    pub(super) fn blocks(neighborhood: &Neighborhood) -> Vec<Range<usize>> {
        let starts = neighborhood.bond_starts();
        let n = neighborhood.n_points();
        let mut blocks = Vec::new();
        let mut first = 0;
        while first < n {
            let end = starts.partition_point(|start| *start < starts[first] + BLOCK);
            let end = end.clamp(first + 1, n);
            blocks.push(first..end);
            first = end;
        }
        blocks
    }

    /// What the states of some owners' bonds that are `intact` become at displacements `u` in m (`n x d`),
    /// `dt` s after the last change; only what changes.
    ///
    /// # Errors
    /// Next values that are not finite.
    pub(super) fn changes(
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
        let all = parts?.concat();
        let mut bonds: Vec<usize> = all.iter().map(|change| change.bond).collect();
        bonds.sort_unstable();
        bonds.dedup();
        Ok(Changes { all, bonds })
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
            let own = numbers.filter(|(bond, _)| intact(*bond)).map(|(bond, &other)| {
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
            for (law, states) in rules.of_law.iter().enumerate() {
                if states.is_empty() {
                    continue;
                }
                let is_alone = rules.of_law.len() == 1;
                let takes = |bond: &&Candidate<D>| {
                    let corners = || bond.ends.map(|end| rules.materials.of(end));
                    is_alone || rules.materials.parts(&corners()).iter().any(|part| part.0 == law)
                };
                let own: Vec<&Candidate<D>> = bonds.iter().filter(takes).collect();
                for bonds in own.chunks(CAPACITY) {
                    for (field, element) in states {
                        rules.next((law, element), bonds, (u, dt), room)?;
                        let next = bonds.iter().zip(&room.1.energy);
                        changes.extend(next.filter_map(|(candidate, &value)| {
                            let bond = candidate.bond;
                            let is_same =
                                rules.fields.state(*field, bond)?.to_bits() == value.to_bits();
                            (!is_same).then_some(Change { layer, field: *field, bond, value })
                        }));
                    }
                }
            }
        }
        Ok(())
    }

    /// Makes changes.
    pub(super) fn make(&self, changes: &Changes) {
        for &Change { layer, field, bond, value } in &changes.all {
            self.layers[layer].fields.set_state(field, bond, value);
        }
    }

    /// All states of all bonds: layer by layer, state by state, in the order of the bonds.
    pub(super) fn all(&self, n_bonds: usize) -> Vec<f64> {
        let states = self.states().flat_map(|(rules, field)| {
            (0..n_bonds).map(move |bond| rules.fields.state(field, bond).unwrap_or(f64::NAN))
        });
        states.collect()
    }

    /// Gives bonds the states that [`Memory::all`] told of them.
    pub(super) fn set_all(&self, all: &[f64], n_bonds: usize) {
        for ((rules, field), values) in self.states().zip(all.chunks_exact(n_bonds.max(1))) {
            let set = |(bond, value): (usize, &f64)| rules.fields.set_state(field, bond, *value);
            values.iter().enumerate().for_each(set);
        }
    }

    /// Lets laws follow what bonds come to remember in `dt` s; below 0 they hold what bonds remember.
    pub(super) fn set_time_step(&self, dt: f64) {
        self.layers.iter().for_each(|rules| rules.fields.set_time_step(dt));
    }

    /// A state of a bond by its number, with the part that the law of the state has in the bond; nothing where
    /// it has none.
    pub(super) fn state_of(
        &self,
        number: usize,
        bond: usize,
        ends: [usize; 2],
    ) -> Option<(f64, f64)> {
        let (rules, field) = self.states().nth(number)?;
        let law = (0..rules.of_law.len()).find(|law| rules.fields.of_law(*law).contains(&field))?;
        let parts = rules.materials.parts(&ends.map(|end| rules.materials.of(end)));
        let (_, part) = parts.iter().find(|part| part.0 == law)?;
        Some((part, rules.fields.state(field, bond)?))
    }

    /// How many states a bond has.
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
            let own = self.fields.of_law(law);
            let time_step = self.fields.time_steps().iter().find(|field| own.contains(field));
            let place = time_step.map_or(own.len(), |field| field - own.start);
            batch.take_fields_of_bonds((&*self.fields, own), |lane| {
                (bonds[lane].ends, bonds[lane].bond)
            });
            if element.n_fields() > place {
                let padded = batch.padded_len();
                batch.fields.resize(element.n_fields() * padded, dt);
                batch.fields[place * padded..][..padded].fill(dt);
            }
        }
        let evaluated = element.evaluate(batch, Order::Energy, out);
        evaluated.map_err(|lane| bonds[lane.lane].refused(lane.value, lane.reference, u))
    }
}
