//! How what is remembered changes at fixed displacements, and what is dissipated by it.

use std::borrow::Cow;

use super::memory::{Changes, Gone};
use super::{Breaking, CLIQUES, Held, Interactions, Release, Status};
use crate::energy::{Energy as _, NonFinite, Total};
use crate::interaction::{Lost, n_neighbors};
use crate::kernel::Measure;

impl Breaking {
    /// Changes what is remembered, but for what breaks.
    pub(super) fn change_states(
        &self,
        (u, dt): (&[f64], f64),
        way: (f64, &[f64]),
        breaking: &Interactions,
    ) -> Result<Release, NonFinite> {
        let mut release = Release::default();
        if self.memory.is_empty() {
            return Ok(release);
        }
        let status = &*self.now();
        let lost = self.lost_with(status, breaking);
        let (is_broken, whole, breaking) = (&status.is_broken, breaking, &breaking.bonds);
        let gone = Gone { is_broken, breaking, lost: lost.as_deref() };
        let around = (&*self.body, &*self.neighborhood);
        release.add(self.change_field_states(status, (u, dt), way, whole)?);
        for measure in self.memory.kinds() {
            for owners in self.memory.blocks(&self.neighborhood, measure) {
                let changes = self.memory.changes(around, (u, dt), (measure, owners), gone)?;
                let before = self.held(&status.energy, (u, way), measure, &changes)?;
                self.memory.make(&changes);
                let after = self.held(&status.energy, (u, way), measure, &changes)?;
                for (before, after) in before.iter().zip(&after) {
                    release.dissipated += before.energy - after.energy;
                    release.timing += before.timing - after.timing;
                }
                release.changed += changes.numbers.len();
            }
        }
        Ok(release)
    }

    /// What is gone of triangles and tetrahedra, with what is about to break.
    fn lost_with<'s>(&self, status: &'s Status, more: &Interactions) -> Option<Cow<'s, Lost>> {
        let lost = status.lost.as_ref()?;
        if more.is_empty() || !self.memory.has_cliques() {
            return Some(Cow::Borrowed(lost));
        }
        let mut lost = lost.clone();
        lost.lose_edges(&more.bonds, &Lost::owners_of(&self.neighborhood, &more.bonds));
        for (measure, numbers) in CLIQUES.into_iter().zip(&more.cliques) {
            if let Some(ranks) = self.ranks(measure) {
                lost.lose_cliques(n_neighbors(measure), ranks, numbers);
            }
        }
        Some(Cow::Owned(lost))
    }

    /// What those hold whose states change.
    pub(super) fn held(
        &self,
        energy: &Total<'_>,
        (u, way): (&[f64], (f64, &[f64])),
        measure: Measure,
        changes: &Changes,
    ) -> Result<Vec<Held>, NonFinite> {
        let mut held = vec![Held::default(); changes.numbers.len()];
        match self.memory.ranks(measure) {
            None => energy.add_held(u, way, &changes.numbers, &mut held)?,
            Some(ranks) => {
                let cliques = (measure, ranks, &changes.numbers[..]);
                energy.add_held_by_cliques(u, way, cliques, &mut held)?;
            }
        }
        Ok(held)
    }
}
