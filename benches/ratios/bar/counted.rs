//! An energy that counts what is asked of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use piola_runtime::energy::{Energy, Hessian, NonFinite, Wanted};
use piola_runtime::interaction::Report;
use piola_runtime::matrix::{BlockMatrix, BlockPattern};

/// An energy, and how often its forces and products were evaluated.
pub(crate) struct Counted<'a> {
    energy: &'a dyn Energy,
    gradients: AtomicUsize,
    products: AtomicUsize,
}

impl<'a> Counted<'a> {
    pub(crate) fn new(energy: &'a dyn Energy) -> Counted<'a> {
        Counted { energy, gradients: AtomicUsize::new(0), products: AtomicUsize::new(0) }
    }

    pub(crate) fn gradients(&self) -> usize {
        self.gradients.load(Ordering::Relaxed)
    }

    pub(crate) fn products(&self) -> usize {
        self.products.load(Ordering::Relaxed)
    }
}

impl Energy for Counted<'_> {
    fn dimension(&self) -> usize {
        self.energy.dimension()
    }

    fn positions(&self) -> &[f64] {
        self.energy.positions()
    }

    fn parts(&self) -> &Arc<[String]> {
        self.energy.parts()
    }

    fn report(&self) -> Report {
        self.energy.report()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        self.energy.pattern()
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        self.energy.bond_pattern()
    }

    fn springs(&self, u: &[f64], springs: &mut BlockMatrix) {
        self.energy.springs(u, springs);
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        self.energy.virials(u, virials)
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        if matches!(wanted, Wanted::Forces(_)) {
            self.gradients.fetch_add(1, Ordering::Relaxed);
        }
        self.energy.evaluate(u, wanted, parts)
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.energy.shares(u, shares)
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
