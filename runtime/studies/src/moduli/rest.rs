//! Whether a body is free of stress at rest, and stiff.

use piola_grammar::Diagnostic;
use piola_mechanics::kernel::Measure;

use super::inside::Inside;
use super::{Affine, Stiffness};
use crate::case::{Case, CaseError, Potential};

/// Stress at rest over the largest modulus that is rounding.
const NO_STRESS: f64 = 1e-9;

impl Case {
    /// Refuses energies that have a force at rest, or leave the body without stiffness, for the
    /// scene's values.
    ///
    /// # Errors
    /// What [`Model::unfit_at_rest`](piola_compiler::Model::unfit_at_rest) finds, at its place in the
    /// potential.
    pub fn check_rest(&self) -> Result<(), CaseError> {
        for (_, case) in self.of_each_material() {
            case.check_rest_alone()?;
        }
        Ok(())
    }

    fn check_rest_alone(&self) -> Result<(), CaseError> {
        let is_stiff = |number: usize| {
            let others = self.potentials.iter().enumerate().filter(|(other, _)| *other != number);
            others.into_iter().any(|(_, other)| {
                let model = &other.model;
                let has_cliques = !model.coupled().is_empty();
                other.has_families() || has_cliques || model.measures().contains(&Measure::Length)
            })
        };
        for (number, potential) in self.potentials.iter().enumerate() {
            let found = potential.model.unfit_at_rest(&potential.values, is_stiff(number));
            if !found.is_empty() {
                return Err(potential.wrong(found));
            }
        }
        self.unfit_lattice().map_or(Ok(()), Err)
    }

    /// Stress at rest, and strains that cost nothing, of sums of energies and of energies of F, of
    /// gathered values and of several measures inside a lattice: what they are for one interaction or
    /// point does not tell.
    fn unfit_lattice(&self) -> Option<CaseError> {
        let is_lattice = self.scene.body.points.spacing().is_some();
        // The message is about the first potential of families or of several measures, or the first of all.
        let is_of_many = |p: &&Potential| p.has_families() || !p.model.coupled().is_empty();
        let of_many = self.potentials.iter().find(is_of_many);
        let several = self.potentials.first().filter(|_| self.potentials.len() > 1);
        let potential = of_many.or(several).filter(|_| is_lattice)?;
        // What is no number at rest is named by the run itself, with its place.
        let affine = Affine::with(&self.without_fields(), &Inside::new(self)).ok()?;
        let stiffness = Stiffness::new(&affine);
        let size = |values: &[f64]| values.iter().fold(0.0f64, |size, x| size.max(x.abs()));
        let (stress, kelvin) = (size(&affine.stress), stiffness.kelvin());
        let largest = size(&kelvin);
        let stressed = (stress > NO_STRESS * largest).then(|| {
            let message =
                format!("the body is not stress-free: {stress:.3e} Pa at rest, of moduli of {largest:.3e} Pa");
            potential.model.unfit_sum("not-stress-free", message)
        });
        let soft = (!stiffness.is_stable()).then(|| {
            let least = kelvin.iter().copied().fold(f64::INFINITY, f64::min);
            let message = format!(
                "the body is not stiff at rest: against one strain its modulus is {least:.3e} Pa, the \
                 largest is {largest:.3e} Pa"
            );
            potential.model.unfit_sum("not-stiff-at-rest", message)
        });
        let found: Vec<Diagnostic> = stressed.into_iter().chain(soft).flatten().collect();
        (!found.is_empty()).then(|| potential.wrong(found))
    }
}
