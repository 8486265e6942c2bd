//! What of the interactions of a lattice goes along its rows, without neighbour lists and kernels.

use std::ops::Range;
use std::sync::Arc;

use super::DiscreteEnergy;
use super::abreast::AbreastRoom;
use super::abreast::tetrahedra::TetrahedronRuns;
use super::abreast::triangles::TriangleRuns;
use super::axes::{Axes, Wanted};
use super::kind::Kind;
use super::rows::Rows;
use super::runs::BondRuns;
use super::sum::Sum;
use crate::interaction::Bits;
use crate::interaction::runs::Runs;
use crate::kernel::Measure;
use crate::materials::Materials;

/// The interactions of a lattice that go without neighbour lists and kernels.
#[derive(Default)]
pub(super) struct OnLattice {
    pub(super) bonds: Option<BondRuns>,
    pub(super) triangles: Option<TriangleRuns>,
    pub(super) tetrahedra: Option<TetrahedronRuns>,
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
        let tetrahedra = energy.tetrahedra.as_ref().filter(is_affine);
        let mut kinds = [bonds, triangles, tetrahedra].into_iter().flatten().peekable();
        if kinds.peek().is_none() {
            return OnLattice::default();
        }
        let Some(runs) = Runs::new(&energy.body, &energy.neighborhood, &energy.slabs) else {
            return OnLattice::default();
        };
        let shape = (energy.body.dimension(), energy.neighborhood.horizon());
        let several = |materials: &&Arc<Materials>| materials.n_laws() > 1;
        let mut materials = kinds.filter_map(|kind| kind.materials.as_ref());
        let runs = match materials.find(several) {
            Some(materials) => runs.between(materials, shape.0),
            None => Some(runs),
        };
        let Some(runs) = runs.map(Arc::new) else { return OnLattice::default() };
        let around = (&*energy.body, &*energy.neighborhood);
        let degeneracy = energy.degeneracy;
        let of_triangles = |kind| TriangleRuns::new(&runs, kind, shape, degeneracy);
        let of_tetrahedra = |kind| TetrahedronRuns::new(&runs, kind, shape.1, degeneracy);
        OnLattice {
            bonds: bonds.and_then(|kind| BondRuns::new(&runs, kind, around)),
            triangles: triangles.and_then(of_triangles),
            tetrahedra: tetrahedra.and_then(of_tetrahedra),
        }
    }

    /// Whether something goes so.
    pub(super) fn is_empty(&self) -> bool {
        self.bonds.is_none() && self.triangles.is_none() && self.tetrahedra.is_none()
    }

    /// The measures of what goes so.
    pub(super) fn measures(&self) -> Vec<Measure> {
        let OnLattice { bonds, triangles, tetrahedra } = self;
        let go = [bonds.is_some(), triangles.is_some(), tetrahedra.is_some()];
        Measure::ALL
            .into_iter()
            .zip(go)
            .filter(|(_, goes)| *goes)
            .map(|(measure, _)| measure)
            .collect()
    }

    /// How many vectors the bonds of what goes abreast have.
    pub(super) fn vectors_abreast<const D: usize>(&self) -> usize {
        let triangles = self.triangles.as_ref().map(TriangleRuns::n_vectors::<D>);
        let tetrahedra = self.tetrahedra.as_ref().map(TetrahedronRuns::n_vectors);
        triangles.or(tetrahedra).unwrap_or(0)
    }

    /// Adds up what bonds and triangles of a slab have, in `axes`; nothing where some of it is not finite,
    /// or has lost digits: then all goes as on clouds, which names or repairs it. Products are with the direction `p`.
    pub(super) fn add<const D: usize>(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        (u, p): (&[f64], Option<&[f64]>),
        wanted: Wanted,
        (axes, abreast): (&mut Axes, &mut AbreastRoom<D>),
    ) -> Option<OnLatticeSums> {
        if self.bonds.is_none() && self.triangles.is_none() {
            return None;
        }
        axes.set::<D>(energy, slab, u, p);
        let mut sums = OnLatticeSums::default();
        if let Some(bonds) = &self.bonds {
            sums.bonds = Some(bonds.add::<D>(wanted, axes)?);
        }
        if let Some(triangles) = &self.triangles {
            let owners = owners(energy, slab);
            sums.triangles = Some(triangles.add::<D>(owners, wanted, axes, abreast)?);
        }
        Some(sums)
    }

    /// Whether tangents of triangles go so: by the triangles on bonds, of all slabs at once.
    pub(super) fn has_triangle_blocks(&self, energy: &DiscreteEnergy) -> bool {
        let (Some(triangles), Some(kind), None) =
            (&self.triangles, &energy.triangles, &energy.lost)
        else {
            return false;
        };
        match energy.body.dimension() {
            2 => triangles.has_blocks::<2>(kind, &energy.slabs),
            _ => triangles.has_blocks::<3>(kind, &energy.slabs),
        }
    }

    /// Adds these of the bonds from a slab's points to later ones.
    pub(super) fn add_triangle_blocks<const D: usize>(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        u: &[f64],
        (axes, abreast): (&mut Axes, &mut AbreastRoom<D>),
        rows: &mut Rows<'_>,
    ) {
        if let Some(triangles) = &self.triangles {
            axes.set_around::<D>(energy, slab, u);
            triangles.add_blocks((&energy.neighborhood, &energy.slabs), axes, abreast, rows);
        }
    }

    /// Adds up what the tetrahedra of a slab have, as [`OnLattice::add`] does.
    pub(super) fn add_tetrahedra(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        (u, p): (&[f64], Option<&[f64]>),
        wanted: Wanted,
        (axes, abreast): (&mut Axes, &mut AbreastRoom<3>),
    ) -> Option<Sum> {
        let tetrahedra = self.tetrahedra.as_ref()?;
        axes.set::<3>(energy, slab, u, p);
        tetrahedra.add(owners(energy, slab), wanted, axes, abreast)
    }

    /// Adds their tangent behind that, at the displacements in `axes`.
    pub(super) fn add_tetrahedron_blocks(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        room: (&mut Axes, &mut AbreastRoom<3>),
        rows: &mut Rows<'_>,
    ) {
        if let Some(tetrahedra) = &self.tetrahedra {
            tetrahedra.add_blocks(&energy.neighborhood, owners(energy, slab), room, rows);
        }
    }
}

/// The owners of a slab but for those that have lost interactions.
fn owners(energy: &DiscreteEnergy, slab: usize) -> (Range<usize>, Option<&Bits>) {
    (energy.slabs.owners(slab), energy.lost.as_ref().map(|lost| lost.owners()))
}
