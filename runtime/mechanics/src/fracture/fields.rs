//! Bonds that break by deformation gradients and by gathered values: those of bonds each by its own, by those of
//! a point all of its bonds; and what is remembered with these.

use std::sync::PoisonError;

use super::criteria::margin::{WithMargins, over_rest};
use super::{Breaking, Interactions, Judged, Release, Status};
use crate::energy::{Energy as _, NonFinite};
use crate::kernel::VariablesLaw;
use crate::materials::Fields;

/// Whose margins are asked for, and which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Of all places, those that break; what margins are at rest is not told.
    Breaking,
    /// Of all places, all.
    All,
    /// Those by which a bond is judged, between these points.
    Bond([usize; 2]),
}

/// A condition of what families give: of deformation gradients, or of what points gather, with its margin as those
/// take it.
pub struct FamilyCriterion<M = Box<dyn VariablesLaw>> {
    /// The number of the layer of energies that it belongs to.
    pub layer: usize,
    /// The law in it: places that take this law are judged.
    pub law: u8,
    /// Which of such conditions of the law it is, from 0.
    pub number: usize,
    /// The margin, in the place of psi, with its variables.
    pub margin: M,
    /// Whether bonds break where it is 0, too.
    pub holds_at_zero: bool,
}

/// What a state becomes of deformation gradients, or of what points gather.
pub struct FamilyNextState<M = Box<dyn VariablesLaw>> {
    /// The law: places that take this law remember.
    pub law: u8,
    /// The number of the state among the fields of all laws.
    pub field: usize,
    /// The next value, in the place of psi, with its variables.
    pub next: M,
}

impl<M> FamilyNextState<M> {
    /// Whether a value is another than what is remembered by this number.
    pub(crate) fn differs(&self, fields: &Fields, number: usize, value: f64) -> bool {
        fields.state(self.field, number).is_some_and(|state| state.to_bits() != value.to_bits())
    }
}

impl<M> FamilyCriterion<M> {
    /// Adds what is judged at places between two points, or twice the same: all of it where margins at rest are
    /// there to tell, else what breaks.
    pub(crate) fn judge(
        &self,
        places: &[[usize; 2]],
        (margins, at_rest): (&[f64], Option<&[f64]>),
        found: &mut Vec<Judged>,
    ) {
        for (k, (&ends, &margin)) in places.iter().zip(margins).enumerate() {
            let breaks = margin > 0.0 || self.holds_at_zero && margin == 0.0;
            if at_rest.is_some() || breaks {
                found.push(Judged {
                    of: Some(ends),
                    layer: self.layer,
                    law: usize::from(self.law),
                    number: self.number,
                    margin,
                    at_rest: at_rest.map_or(f64::NAN, |all| all[k]),
                    breaks,
                });
            }
        }
    }
}

impl Breaking {
    /// Takes in the bonds that break by fields at displacements `u`: ascending, each once.
    pub(super) fn with_fields(
        &self,
        status: &Status,
        u: &[f64],
        mut bonds: Vec<usize>,
    ) -> Result<Vec<usize>, NonFinite> {
        let decided = self.decided.lock().unwrap_or_else(PoisonError::into_inner).take();
        let found = match decided {
            Some(decided) => decided.into_iter().filter(|bond| !status.is_broken[*bond]).collect(),
            None => self.judged(status, u)?,
        };
        if found.is_empty() {
            return Ok(bonds);
        }
        bonds.extend(found);
        bonds.sort_unstable();
        bonds.dedup();
        Ok(bonds)
    }

    /// The bonds that break by fields at displacements `u`, some of them twice.
    fn judged(&self, status: &Status, u: &[f64]) -> Result<Vec<usize>, NonFinite> {
        let judged = status.energy.field_margins(u, Asked::Breaking)?;
        Ok(judged.iter().flat_map(|one| self.bonds_of(status, one)).collect())
    }

    /// See [`super::Fracture::judged_by_families`].
    pub(super) fn broken_by_families(&self, u: &[f64]) -> Result<Vec<[usize; 2]>, NonFinite> {
        let mut bonds = self.judged(&self.now(), u)?;
        bonds.sort_unstable();
        bonds.dedup();
        Ok(bonds.into_iter().map(|bond| self.neighborhood.ends(bond)).collect())
    }

    /// See [`super::Fracture::decide_for_families`].
    pub(super) fn decide(&self, bonds: &[[usize; 2]]) {
        let numbers = bonds.iter().filter_map(|ends| self.neighborhood.bond_between(*ends));
        let mut decided = self.decided.lock().unwrap_or_else(PoisonError::into_inner);
        *decided = Some(numbers.collect());
    }

    /// The bonds that fields judge, with their margins over those at rest.
    pub(super) fn leading_by_fields(
        &self,
        status: &Status,
        u: &[f64],
    ) -> Result<WithMargins, NonFinite> {
        let judged = status.energy.field_margins(u, Asked::All)?;
        let with_margins = |one: &Judged| {
            let margin = over_rest(one.margin, one.at_rest);
            self.bonds_of(status, one).into_iter().map(move |bond| (bond, margin))
        };
        Ok(judged.iter().flat_map(with_margins).collect())
    }

    /// Changes at displacements `u` in m, `dt` s after the last time, what deformation gradients and gathered
    /// values are remembered by, but for bonds that are about to break.
    pub(super) fn change_field_states(
        &self,
        status: &Status,
        (u, dt): (&[f64], f64),
        way: (f64, &[f64]),
        breaking: &Interactions,
    ) -> Result<Release, NonFinite> {
        if !status.energy.has_field_states() {
            return Ok(Release::default());
        }
        // Next states take the time step as energies that follow do, and these hold again what is remembered.
        self.memory.set_time_step(dt);
        let release = status.energy.change_field_states(u, way, &breaking.bonds);
        self.memory.set_time_step(-1.0);
        release
    }

    /// The bonds that are there, and may break, of which a place decides.
    fn bonds_of(&self, status: &Status, judged: &Judged) -> Vec<usize> {
        let Some([i, j]) = judged.of else { return Vec::new() };
        let is_unbreakable = &self.criteria.is_unbreakable;
        let bond = |ends: [usize; 2]| {
            let may_break = !ends.iter().any(|end| is_unbreakable[*end]);
            let bond = self.neighborhood.bond_between(ends).filter(|_| may_break)?;
            (!status.is_broken[bond]).then_some(bond)
        };
        match i == j {
            true => {
                let all = self.neighborhood.row(i).iter();
                all.filter_map(|other| bond([i, other as usize])).collect()
            }
            false => bond([i, j]).into_iter().collect(),
        }
    }
}
