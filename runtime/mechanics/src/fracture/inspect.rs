//! What there is to see of a body that breaks: damage, states, and single bonds.

use std::fmt;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use super::Asked;
use super::criteria::Judged;
use super::damage::{OfCliques, lost_of, without_edges};
use super::means::States;
use super::{Breaking, Held};
use crate::energy::{Energy as _, NonFinite};
use crate::interaction::n_neighbors;
use crate::kernel::Measure;
use crate::materials::StateOf;

/// A bond at some displacements.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Its length in m.
    pub length: f64,
    /// Its length at rest in m.
    pub reference: f64,
    /// Its length over that at rest, less 1, with all digits.
    pub strain: f64,
    /// The conditions of the laws that it takes, layer by layer, law by law.
    pub margins: Vec<Judged>,
    /// What it remembers, as [`super::Fracture::states`] has it; nothing in the place of states of laws that it
    /// does not take, or of triangles and tetrahedra.
    pub states: Vec<Option<f64>>,
    /// The energy in J that it holds by itself; 0 of a broken one.
    pub energy: f64,
    /// Whether it is broken.
    pub is_broken: bool,
}

/// Bonds that rounding alone keeps from their threshold, or puts beyond it.
#[derive(Clone, Debug, PartialEq)]
pub struct OnThreshold {
    /// How many.
    pub bonds: usize,
    /// The points of one of them.
    pub ends: [usize; 2],
    /// Where these are at rest, in m.
    pub positions: [Vec<f64>; 2],
}

impl OnThreshold {
    /// The code of the warning.
    pub const CODE: &'static str = "on-threshold";
}

impl fmt::Display for OnThreshold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = |x: &[f64]| x.iter().map(f64::to_string).collect::<Vec<String>>().join(", ");
        let [one, other] = self.positions.each_ref().map(|position| place(position));
        let n = self.bonds;
        let are = if n == 1 { "bond is" } else { "bonds are" };
        write!(
            f,
            "{n} {are} at their threshold but for rounding, among them the one between ({one}) and \
             ({other}) m: the last bits of displacements decide which of them break; change the \
             threshold, or what moves the body, by a small part of itself [{}]",
            OnThreshold::CODE
        )
    }
}

/// What there is to see of a body that breaks. Nothing of it changes energies.
pub trait Inspection: Sync {
    /// The share of the volume of each point's neighbours whose bonds with it are broken, between 0 and 1:
    /// partmann2026 (5.8). 0 of a point that has no neighbours.
    fn damage(&self) -> Vec<f64>;

    /// The share of the triangles at each point that are gone, by their measures at rest, or of the tetrahedra:
    /// those with a broken edge, and those that broke themselves. 0 of a body without energies of them.
    fn damage_of(&self, measure: Measure) -> Vec<f64>;

    /// The mean of states by their numbers ([`super::Fracture::states`]) over what is unbroken at each point: a
    /// bond counts with the volume of the neighbour, a triangle or a tetrahedron with its measure at rest, each
    /// by the part that the law of the state has in it; not a number where there are none.
    fn mean_states(&self, states: &[usize]) -> Vec<f64>;

    /// The number of the bond between two points; nothing where there is none.
    fn bond_between(&self, ends: [usize; 2]) -> Option<usize>;

    /// Whether the bond of a number has never been there.
    fn is_absent(&self, bond: usize) -> bool;

    /// A bond at displacements `u` in m, `n x d`.
    ///
    /// # Errors
    /// Margins and energies that are not finite.
    fn look_at(&self, bond: usize, u: &[f64]) -> Result<Look, NonFinite>;

    /// Keeps from now on how this bond was when it broke.
    fn watch_bond(&self, bond: usize);

    /// How the bond that is watched was when it broke, before it was taken out; nothing as long as it is there.
    fn seen_breaking(&self) -> Option<Look>;

    /// Bonds that were at their threshold but for rounding when bonds were judged, the first time that there
    /// were some; told once.
    fn on_threshold(&self) -> Option<OnThreshold>;
}

/// What is kept for those who look.
#[derive(Default)]
pub(super) struct Inspected {
    /// Measures of the triangles, and of the tetrahedra, at each point.
    whole: [OnceLock<Vec<f64>>; 2],
    watched: Mutex<Option<Watched>>,
}

/// A bond that is watched, and how it broke.
struct Watched {
    bond: usize,
    breaking: Option<Look>,
}

impl Inspected {
    fn watched(&self) -> MutexGuard<'_, Option<Watched>> {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets how a bond broke that did not.
    pub(super) fn forget(&self, bonds: &[usize]) {
        if let Some(watched) = &mut *self.watched()
            && bonds.contains(&watched.bond)
        {
            watched.breaking = None;
        }
    }
}

impl Breaking {
    /// Looks at the bond that is watched, if it is among those that are about to break.
    pub(super) fn see_breaking(&self, u: &[f64], bonds: &[usize]) -> Result<(), NonFinite> {
        let watched = self.inspected.watched().as_ref().map(|watched| watched.bond);
        let Some(bond) = watched.filter(|bond| bonds.contains(bond)) else { return Ok(()) };
        let look = self.look_at(bond, u)?;
        if let Some(watched) = &mut *self.inspected.watched() {
            watched.breaking = Some(look);
        }
        Ok(())
    }

    /// What a bond remembers as a state, or the mean of what its ends do.
    fn state_beside(&self, number: usize, bond: usize) -> Option<f64> {
        let ends = self.neighborhood.ends(bond);
        if self.memory.kind_of(number)? != StateOf::Points {
            let kind = StateOf::Interactions(Measure::Length);
            return Some(self.memory.state_of(number, kind, (bond, &ends))?.1);
        }
        let of_end = |end| Some(self.memory.state_of(number, StateOf::Points, (end, &[end]))?.1);
        let (sum, n) =
            ends.into_iter().filter_map(of_end).fold((0.0, 0), |(sum, n), x| (sum + x, n + 1));
        (n > 0).then(|| sum / f64::from(n))
    }

    /// Damage by cliques of one size.
    fn damage_by<const D: usize, const K: usize>(&self, measure: Measure) -> Vec<f64> {
        let absent = &without_edges(&self.neighborhood, &self.absent);
        let all = OfCliques::<D, K> { body: &self.body, neighborhood: &self.neighborhood, absent };
        let whole = self.inspected.whole[K - 2].get_or_init(|| all.whole());
        let lost = lost_of(&self.now(), &self.neighborhood, (K, self.ranks(measure)));
        let share = |(gone, whole): (f64, &f64)| if *whole > 0.0 { gone / whole } else { 0.0 };
        all.gone(&lost).into_iter().zip(whole).map(share).collect()
    }
}

impl Inspection for Breaking {
    fn damage(&self) -> Vec<f64> {
        let mut status = self.change();
        let super::Status { damage, is_broken, .. } = &mut *status;
        damage.shares((&self.body, &self.neighborhood), is_broken, &self.absent).to_vec()
    }

    fn damage_of(&self, measure: Measure) -> Vec<f64> {
        let report = self.now().energy.report();
        let count = match measure {
            Measure::Length => return self.damage(),
            Measure::Area => report.triangles,
            Measure::Volume => report.tetrahedra,
        };
        if count == 0 {
            return vec![0.0; self.body.n_points()];
        }
        match (self.body.dimension(), n_neighbors(measure)) {
            (2, _) => self.damage_by::<2, 2>(measure),
            (_, 2) => self.damage_by::<3, 2>(measure),
            _ => self.damage_by::<3, 3>(measure),
        }
    }

    fn mean_states(&self, states: &[usize]) -> Vec<f64> {
        let around = (&*self.body, &*self.neighborhood);
        let states = States { around, memory: &self.memory, numbers: states };
        states.means(&self.now())
    }

    fn bond_between(&self, ends: [usize; 2]) -> Option<usize> {
        self.neighborhood.bond_between(ends)
    }

    fn is_absent(&self, bond: usize) -> bool {
        self.absent.binary_search(&bond).is_ok()
    }

    fn look_at(&self, bond: usize, u: &[f64]) -> Result<Look, NonFinite> {
        let ends = self.neighborhood.ends(bond);
        let d = self.body.dimension();
        let of = |x: &[f64], axis: usize| x[ends[1] * d + axis] - x[ends[0] * d + axis];
        let along = |part: &dyn Fn(f64, f64) -> f64| {
            (0..d).fold(0.0, |sum, axis| sum + part(of(self.body.positions(), axis), of(u, axis)))
        };
        let reference = along(&|xi, _| xi * xi).sqrt();
        let length = along(&|xi, eta| (xi + eta) * (xi + eta)).sqrt();
        // l^2 - L^2, without the digits that the difference would lose.
        let grown = along(&|xi, eta| eta * (2.0 * xi + eta));
        let around = (&*self.body, &*self.neighborhood);
        let mut margins = self.criteria.judged(around, bond, u)?;
        let states = (0..self.memory.n_states()).map(|number| self.state_beside(number, bond));
        let status = self.now();
        margins.extend(status.energy.field_margins(u, Asked::Bond(ends))?);
        let (nowhere, mut held) = (vec![0.0; u.len()], [Held::default()]);
        status.energy.add_held(u, (0.0, &nowhere), &[bond], &mut held)?;
        Ok(Look {
            length,
            reference,
            strain: grown / (reference * (length + reference)),
            margins,
            states: states.collect(),
            energy: held[0].energy,
            is_broken: status.is_broken[bond],
        })
    }

    fn watch_bond(&self, bond: usize) {
        *self.inspected.watched() = Some(Watched { bond, breaking: None });
    }

    fn seen_breaking(&self) -> Option<Look> {
        self.inspected.watched().as_ref()?.breaking.clone()
    }

    fn on_threshold(&self) -> Option<OnThreshold> {
        let bonds = self.criteria.take_ties();
        let ends = self.neighborhood.ends(*bonds.first()?);
        let positions = ends.map(|end| self.body.position(end).to_vec());
        Some(OnThreshold { bonds: bonds.len(), ends, positions })
    }
}
