//! What of the interactions of a lattice goes along its rows, without neighbour lists and kernels.

use std::sync::Arc;

use super::DiscreteEnergy;
use super::abreast::{AbreastRoom, TriangleRuns};
use super::axes::{Axes, Wanted};
use super::kind::Kind;
use super::runs::BondRuns;
use super::sum::Sum;
use crate::interaction::runs::Runs;
use crate::materials::Materials;

/// The interactions of a lattice that go without neighbour lists and kernels.
#[derive(Default)]
pub(super) struct OnLattice {
    pub(super) bonds: Option<BondRuns>,
    pub(super) triangles: Option<TriangleRuns>,
}

/// Energies of what went so.
#[derive(Clone, Copy, Default)]
pub(super) struct OnLatticeSums {
    pub(super) bonds: Option<Sum>,
    pub(super) triangles: Option<Sum>,
}

impl OnLattice {
    /// What goes of laws that are affine, where bonds repeat.
    pub(super) fn new(energy: &DiscreteEnergy) -> OnLattice {
        let is_affine = |kind: &&Kind| kind.is_affine();
        let bonds = energy.bonds.as_ref().filter(is_affine);
        let triangles = energy.triangles.as_ref().filter(is_affine);
        if bonds.is_none() && triangles.is_none() {
            return OnLattice::default();
        }
        let Some(runs) = Runs::new(&energy.body, &energy.neighborhood, &energy.slabs) else {
            return OnLattice::default();
        };
        let shape = (energy.body.dimension(), energy.neighborhood.horizon());
        let kinds = [bonds, triangles].into_iter().flatten();
        let several = |materials: &&Arc<Materials>| materials.n_laws() > 1;
        let mut materials = kinds.filter_map(|kind| kind.materials.as_ref());
        let runs = match materials.find(several) {
            Some(materials) => runs.between(materials, shape.0),
            None => Some(runs),
        };
        let Some(runs) = runs.map(Arc::new) else { return OnLattice::default() };
        let around = (&*energy.body, &*energy.neighborhood);
        let of_triangles = |kind| TriangleRuns::new(&runs, kind, shape, energy.degeneracy);
        OnLattice {
            bonds: bonds.and_then(|kind| BondRuns::new(&runs, kind, around)),
            triangles: triangles.and_then(of_triangles),
        }
    }

    /// Whether something goes so.
    pub(super) fn is_empty(&self) -> bool {
        self.bonds.is_none() && self.triangles.is_none()
    }

    /// Adds up what a slab has, in `axes`; nothing where some of it is not finite, or has lost digits:
    /// then all goes as on clouds, which names or repairs it. Of products there are those of bonds.
    pub(super) fn add<const D: usize>(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        (u, p): (&[f64], Option<&[f64]>),
        wanted: Wanted,
        (axes, abreast): (&mut Axes, &mut AbreastRoom<D>),
    ) -> Option<OnLatticeSums> {
        if self.is_empty() || p.is_some() && self.bonds.is_none() {
            return None;
        }
        axes.set::<D>(energy, slab, u, p);
        let mut sums = OnLatticeSums::default();
        if let Some(bonds) = &self.bonds {
            sums.bonds = Some(bonds.add::<D>(wanted, axes)?);
        }
        if let Some(triangles) = self.triangles.as_ref().filter(|_| wanted != Wanted::Product) {
            let owners = energy.slabs.owners(slab);
            let rest = energy.lost.as_ref().map(|lost| lost.owners());
            sums.triangles = Some(triangles.add::<D>((owners, rest), wanted, axes, abreast)?);
        }
        Some(sums)
    }
}
