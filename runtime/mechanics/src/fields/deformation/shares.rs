//! The energy of deformation gradients, and how it changes with a uniform gradient, point by point.

use super::sweep::{Duals, Fields, Pass, over_bonds, over_points};
use super::{DeformationEnergy, Places, Room, tensors};
use crate::energy::NonFinite;

impl DeformationEnergy {
    pub(super) fn share<const D: usize>(
        &self,
        u: &[f64],
        shares: &mut [f64],
    ) -> Result<(), NonFinite> {
        let mut room = self.room.take(Room::default);
        let Room { h, parts, .. } = &mut *room;
        let h = self.gradients_in::<D>(u, h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let duals = Duals { shares, ..Duals::default() };
        let done = self.sweep(fields, Pass::Energy, duals, parts);
        done.map(|_| ()).map_err(|failure| self.failed(failure, u))
    }

    /// Of shares of both parts those of `psi(F)`, which is the first, or of what stabilises it.
    pub(super) fn keep_part<const D: usize>(
        &self,
        part: usize,
        u: &[f64],
        shares: &mut [f64],
    ) -> Result<(), NonFinite> {
        let mut of_law = vec![0.0; shares.len()];
        let h = self.gradients::<D>(u);
        let fields = Fields { u: u.as_chunks::<D>().0, h: &h };
        let mut duals = Duals { shares: &mut of_law, ..Duals::default() };
        let (volumes, mut parts) = (self.body.volumes(), Vec::new());
        over_points(self.law(), volumes, fields, Pass::Energy, &mut duals, &mut parts)
            .map_err(|failure| self.failed(failure, u))?;
        for (share, of_law) in shares.iter_mut().zip(&of_law) {
            *share = if part == 0 { *of_law } else { *share - of_law };
        }
        Ok(())
    }

    /// Stabilisations have none: they resist what is left of displacements beside their gradient.
    pub(super) fn virial<const D: usize>(
        &self,
        u: &[f64],
        virials: &mut [f64],
    ) -> Result<(), NonFinite> {
        let mut room = self.room.take(Room::default);
        let Room { h, parts, .. } = &mut *room;
        let h = self.gradients_in::<D>(u, h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let (law, pass) = (self.law(), Pass::Virial);
        let mut duals = Duals { stress: tensors::<D>(virials), ..Duals::default() };
        let done = match &self.places {
            Places::Bonds(bonds) => {
                let whole = (&*self.body, self.operator.neighborhood(), &self.slabs);
                over_bonds(&self.slabs, duals, parts, |slab, duals| {
                    bonds.visit(law, whole, slab, (fields, pass), duals)
                })
            }
            _ => over_points(law, self.body.volumes(), fields, pass, &mut duals, parts),
        };
        done.map(|_| ()).map_err(|failure| self.failed(failure, u))
    }
}
