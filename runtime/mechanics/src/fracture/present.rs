//! Energy, forces and tangent of what is left, at the present status.

use std::ops::Range;
use std::sync::{Arc, RwLock};

use super::{Breaking, Fracture, Status, now};
use crate::dissipation::Dashpots;
use crate::energy::{Dissipation, Energy, Hessian, Inversion, NonFinite, Products, Wanted};
use crate::interaction::{Inverted, Report};
use crate::matrix::{BlockMatrix, BlockPattern};

impl Energy for Breaking {
    fn dimension(&self) -> usize {
        self.body.dimension()
    }

    fn counted(&self) -> Range<usize> {
        self.body.counted()
    }

    fn positions(&self) -> &[f64] {
        self.body.positions()
    }

    fn parts(&self) -> &Arc<[String]> {
        &self.names
    }

    fn report(&self) -> Report {
        self.now().energy.report()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        self.pattern.get_or_init(|| Arc::clone(self.now().energy.pattern()))
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        self.bond_pattern.get_or_init(|| self.now().energy.bond_pattern().cloned()).as_ref()
    }

    fn springs(&self, u: &[f64], springs: &mut BlockMatrix) {
        self.springs_of_whole(u, springs);
    }

    fn products(&self) -> Products {
        self.now().energy.products()
    }

    fn has_quick_products(&self) -> bool {
        self.now().energy.has_quick_products()
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.evaluate(u, wanted, parts)
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.shares(u, shares)
    }

    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.shares_of(part, u, shares)
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.virials(u, virials)
    }

    fn displacement_gradients(&self, u: &[f64]) -> Option<Vec<f64>> {
        self.now().energy.displacement_gradients(u)
    }

    fn stretches_across(&self, gradients: &[f64]) -> Option<Vec<f64>> {
        self.now().energy.stretches_across(gradients)
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        Ok(Box::new(AtPresent { energy: self, u: u.to_vec() }))
    }

    fn first_inversion(&self, u: &[f64], step: &[f64]) -> Option<Inversion> {
        self.now().energy.first_inversion(u, step)
    }

    fn inverted(&self, u: &[f64]) -> Inverted {
        self.now().energy.inverted(u)
    }

    fn singular(&self) -> Vec<usize> {
        self.now().energy.singular()
    }

    fn fracture(&self) -> Option<&dyn Fracture> {
        Some(self)
    }

    fn dissipation(&self) -> Option<&dyn Dissipation> {
        self.dissipation.as_ref().map(|own| own as &dyn Dissipation)
    }
}

/// What bonds dissipate that are not broken.
pub(super) struct Damping {
    pub(super) dashpots: Dashpots,
    pub(super) status: Arc<RwLock<Status>>,
}

impl Dissipation for Damping {
    fn forces(&self, u: &[f64], v: &[f64], forces: &mut [f64]) -> Result<(), NonFinite> {
        let Status { is_broken, .. } = &*now(&self.status);
        self.dashpots.forces_of((u, v), |bond| is_broken[bond], forces)
    }

    fn viscosity(&self, u: &[f64], v: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        let Status { is_broken, .. } = &*now(&self.status);
        Ok(Box::new(self.dashpots.viscosity_of((u, v), |bond| is_broken[bond])?))
    }
}

/// The Hessian at the present status.
struct AtPresent<'a> {
    energy: &'a Breaking,
    /// Displacements, `n x d`, in m.
    u: Vec<f64>,
}

impl Hessian for AtPresent<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        match self.energy.now().energy.hessian(&self.u) {
            Ok(hessian) => hessian.multiply(p, product),
            Err(_) => product.fill(f64::NAN),
        }
    }
}
