//! What load steps ask of a body that breaks: which bonds come first, and the status before an attempt.

use std::sync::Arc;

use super::criteria::margin::Foremost;
use super::memory::Memory;
use super::{Breaking, Fracture as _, Held, Release, Status};
use crate::energy::{Energy as _, NonFinite};
use crate::matrix::BlockMatrix;

impl Breaking {
    /// See [`super::Fracture::foremost`].
    pub(super) fn find_foremost(&self, u: &[f64], tie: f64) -> Result<Option<Foremost>, NonFinite> {
        let Status { is_broken, .. } = &*self.now();
        let around = (&*self.body, &*self.neighborhood);
        self.criteria.foremost(around, u, tie, |bond| !is_broken[bond])
    }

    /// See [`super::Fracture::advance_foremost`].
    pub(super) fn judge_foremost(&self, u: &[f64], tie: f64) -> Result<Release, NonFinite> {
        let breaks = {
            let Status { is_broken, .. } = &*self.now();
            let around = (&*self.body, &*self.neighborhood);
            let owners = self.all_owners();
            !self.criteria.judge(around, u, &owners, |bond| !is_broken[bond])?.is_empty()
        };
        match self.find_foremost(u, tie)? {
            Some(Foremost { bonds, .. }) if breaks => self.take_out_at(u, &bonds),
            _ => Ok(Release::default()),
        }
    }

    /// See [`super::Fracture::break_at`].
    pub(super) fn take_out_at(&self, u: &[f64], bonds: &[usize]) -> Result<Release, NonFinite> {
        self.see_breaking(u, bonds)?;
        let nowhere = vec![0.0; u.len()];
        let mut status = self.change();
        let release = status.energy.break_bonds(u, (0.0, &nowhere), bonds)?;
        status.note(&self.neighborhood, bonds);
        Ok(release)
    }

    /// See [`super::Fracture::evolve`].
    pub(super) fn evolve_states(
        &self,
        [from, to]: [&[f64]; 2],
        dt: f64,
    ) -> Result<Release, NonFinite> {
        let mut release = Release::default();
        self.memory.set_time_step(-1.0);
        let Status { energy, is_broken, .. } = &*self.now();
        let around = (&*self.body, &*self.neighborhood);
        let nowhere = vec![0.0; to.len()];
        for owners in Memory::blocks(&self.neighborhood) {
            let changes = self.memory.changes(around, (to, dt), owners, |bond| !is_broken[bond])?;
            let held = |u: &[f64]| {
                let mut held = vec![Held::default(); changes.bonds.len()];
                energy.add_held(u, (0.0, &nowhere), &changes.bonds, &mut held)?;
                Ok(held.iter().fold(0.0, |sum, one| sum + one.energy))
            };
            let before = [held(from)?, held(to)?];
            self.memory.make(&changes);
            release.dissipated += 0.5 * (before[0] - held(from)? + (before[1] - held(to)?));
            release.changed += changes.bonds.len();
        }
        Ok(release)
    }

    /// See [`super::Fracture::restore`].
    pub(super) fn put_back(&self, broken: &[usize]) {
        let mut regained = Vec::new();
        {
            let status = &mut *self.change();
            let mut kept = broken.iter().copied().peekable();
            for (bond, is_broken) in status.is_broken.iter_mut().enumerate() {
                let stays = kept.next_if_eq(&bond).is_some();
                if *is_broken && !stays {
                    *is_broken = false;
                    status.damage.touch(&self.neighborhood, bond);
                    regained.push(bond);
                }
            }
            self.inspected.forget(&regained);
            status.n_broken -= regained.len();
            if !regained.is_empty() {
                status.energy.regain(&regained);
                if !self.criteria.are_empty() {
                    status.energy.watch(self.criteria.limits());
                }
            }
        }
        let missing: Vec<usize> = {
            let status = self.now();
            broken.iter().copied().filter(|bond| !status.is_broken[*bond]).collect()
        };
        self.take_out(&missing);
    }

    /// Springs of what is left, on the pattern of the whole body.
    pub(super) fn springs_of_whole(&self, u: &[f64], springs: &mut BlockMatrix) {
        let status = self.now();
        let Some(left) = status.energy.bond_pattern() else { return };
        if Arc::ptr_eq(left, &springs.pattern) {
            return status.energy.springs(u, springs);
        }
        let mut own = BlockMatrix::zeros(left);
        status.energy.springs(u, &mut own);
        springs.values.fill(0.0);
        springs.add(&own);
    }
}
