//! What load steps ask of a body that breaks: what comes first, and the status before an attempt.

use std::sync::Arc;

use super::criteria::margin::Foremost;
use super::memory::Gone;
use super::{Breaking, Fracture as _, Interactions, Release, Status};
use crate::energy::{Energy as _, NonFinite};
use crate::interaction::n_neighbors;
use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};

/// A pattern of all bonds without those that are broken, by their numbers in ascending order.
pub fn left_of(bonds: &BlockPattern, broken: &[usize]) -> BlockPattern {
    let mut left = BlockPattern {
        dimension: bonds.dimension,
        row_start: vec![0],
        columns: Vec::with_capacity(bonds.columns.len()),
    };
    let (mut number, mut broken) = (0, broken.iter().copied().peekable());
    for row in bonds.row_start.windows(2) {
        let point = left.row_start.len() as u32 - 1;
        for &column in &bonds.columns[row[0]..row[1]] {
            let is_bond = column != point;
            if !(is_bond && broken.next_if_eq(&number).is_some()) {
                left.columns.push(column);
            }
            number += usize::from(is_bond);
        }
        left.row_start.push(left.columns.len());
    }
    left
}

impl Breaking {
    /// See [`super::Fracture::foremost`].
    pub(super) fn find_foremost(&self, u: &[f64], tie: f64) -> Result<Option<Foremost>, NonFinite> {
        let status = &*self.now();
        let Status { is_broken, lost, .. } = status;
        let around = (&*self.body, &*self.neighborhood);
        let others = (lost.as_ref(), self.leading_by_fields(status, u)?);
        self.criteria.foremost(around, (u, tie), |bond| !is_broken[bond], others)
    }

    /// See [`super::Fracture::advance_foremost`].
    pub(super) fn judge_foremost(&self, u: &[f64], tie: f64) -> Result<Release, NonFinite> {
        if self.judge(u, &self.all_owners(), [None, None])?.is_empty() {
            return Ok(Release::default());
        }
        match self.find_foremost(u, tie)? {
            Some(Foremost { which, .. }) => self.break_at(u, &which),
            None => Ok(Release::default()),
        }
    }

    /// See [`super::Fracture::evolve`].
    pub(super) fn evolve_states(
        &self,
        [from, to]: [&[f64]; 2],
        dt: f64,
    ) -> Result<Release, NonFinite> {
        let mut release = Release::default();
        self.memory.set_time_step(-1.0);
        let status = &*self.now();
        let Status { energy, is_broken, lost, .. } = status;
        let gone = Gone { is_broken, breaking: &[], lost: lost.as_ref() };
        let around = (&*self.body, &*self.neighborhood);
        let nowhere = vec![0.0; to.len()];
        // Energies of these do not follow on the way: they held what was remembered until its end.
        let way = ((to, dt), (0.0, &nowhere[..]));
        release.add(self.change_field_states(status, way.0, way.1, &Interactions::default())?);
        for measure in self.memory.kinds() {
            for owners in self.memory.blocks(&self.neighborhood, measure) {
                let changes = self.memory.changes(around, (to, dt), (measure, owners), gone)?;
                let held = |u: &[f64]| {
                    let held = self.held(energy, (u, (0.0, &nowhere)), measure, &changes)?;
                    Ok(held.iter().fold(0.0, |sum, one| sum + one.energy))
                };
                let before = [held(from)?, held(to)?];
                self.memory.make(&changes);
                release.dissipated += 0.5 * (before[0] - held(from)? + (before[1] - held(to)?));
                release.changed += changes.numbers.len();
            }
        }
        Ok(release)
    }

    /// See [`super::Fracture::restore`]: of bonds.
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
                if let Some(lost) = &mut status.lost {
                    lost.regain_edges(&self.neighborhood, &regained);
                }
                if !self.criteria.are_empty() && self.memory.is_empty() {
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

    /// The same of triangles or tetrahedra that broke by criteria of their own.
    pub(super) fn put_back_cliques(&self, measure: Measure, broken: &[usize]) {
        let without = |all: &[usize], others: &[usize]| -> Vec<usize> {
            let stays = |number: &usize| others.binary_search(number).is_err();
            all.iter().copied().filter(stays).collect()
        };
        let now = self.broken_cliques(measure);
        let regained = without(&now, broken);
        if !regained.is_empty() {
            let mut status = self.change();
            status.energy.regain_cliques(measure, &regained);
            if let Some(lost) = &mut status.lost {
                lost.regain_cliques(&self.neighborhood, n_neighbors(measure), &regained);
            }
        }
        self.take_out_cliques(measure, &without(broken, &now));
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
