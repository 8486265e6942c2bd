//! An energy that counts what is asked of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use piola_runtime::energy::{EnergyParts, Hessian, NonFinite, TotalEnergy};
use piola_runtime::matrix::{BlockMatrix, BlockPattern};

/// An energy, and how often its forces and products were evaluated.
pub(crate) struct Counted<'a> {
    energy: &'a dyn TotalEnergy,
    gradients: AtomicUsize,
    products: AtomicUsize,
}

impl<'a> Counted<'a> {
    pub(crate) fn new(energy: &'a dyn TotalEnergy) -> Counted<'a> {
        Counted { energy, gradients: AtomicUsize::new(0), products: AtomicUsize::new(0) }
    }

    pub(crate) fn gradients(&self) -> usize {
        self.gradients.load(Ordering::Relaxed)
    }

    pub(crate) fn products(&self) -> usize {
        self.products.load(Ordering::Relaxed)
    }
}

impl TotalEnergy for Counted<'_> {
    fn dimension(&self) -> usize {
        self.energy.dimension()
    }

    fn positions(&self) -> &[f64] {
        self.energy.positions()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        self.energy.pattern()
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        self.energy.bond_pattern()
    }

    fn bond_tangent(&self, u: &[f64], tangent: &mut BlockMatrix) {
        self.energy.bond_tangent(u, tangent);
    }

    fn energy(&self, u: &[f64]) -> Result<EnergyParts, NonFinite> {
        self.energy.energy(u)
    }

    fn gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<EnergyParts, NonFinite> {
        self.gradients.fetch_add(1, Ordering::Relaxed);
        self.energy.gradient(u, gradient)
    }

    fn tangent(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        tangent: &mut BlockMatrix,
    ) -> Result<EnergyParts, NonFinite> {
        self.energy.tangent(u, gradient, tangent)
    }

    fn tangent_diagonal(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        diagonal: &mut [f64],
    ) -> Result<EnergyParts, NonFinite> {
        self.energy.tangent_diagonal(u, gradient, diagonal)
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        let hessian = self.energy.hessian(u)?;
        Ok(Box::new(CountedHessian { hessian, products: &self.products }))
    }
}

struct CountedHessian<'a> {
    hessian: Box<dyn Hessian + 'a>,
    products: &'a AtomicUsize,
}

impl Hessian for CountedHessian<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        self.products.fetch_add(1, Ordering::Relaxed);
        self.hessian.multiply(p, product);
    }
}
