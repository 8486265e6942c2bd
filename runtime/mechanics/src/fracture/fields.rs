//! Bonds that break by deformation gradients and by gathered values: those of bonds each by its own, by those of
//! a point all of its bonds.

use super::criteria::margin::{WithMargins, over_rest};
use super::{Breaking, Judged, Status};
use crate::energy::{Energy as _, NonFinite};

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

impl Breaking {
    /// Takes in the bonds that break by fields at displacements `u`: ascending, each once.
    pub(super) fn with_fields(
        &self,
        status: &Status,
        u: &[f64],
        mut bonds: Vec<usize>,
    ) -> Result<Vec<usize>, NonFinite> {
        let judged = status.energy.field_margins(u, Asked::Breaking)?;
        if judged.is_empty() {
            return Ok(bonds);
        }
        bonds.extend(judged.iter().flat_map(|one| self.bonds_of(status, one)));
        bonds.sort_unstable();
        bonds.dedup();
        Ok(bonds)
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
                all.filter_map(|other| bond([i, *other as usize])).collect()
            }
            false => bond([i, j]).into_iter().collect(),
        }
    }
}
