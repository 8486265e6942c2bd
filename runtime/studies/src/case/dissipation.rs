//! Cases whose bonds dissipate by how fast they change.

use std::sync::Arc;

use piola_grammar::Diagnostic;
use piola_mechanics::assembly::AssemblyError;
use piola_mechanics::dissipation::{Dashpots, Layer};
use piola_mechanics::kernel::Law;
use piola_mechanics::neighborhood::Neighborhood;
use piola_mechanics::surface::Surface;
use piola_solvers::motion::Method;

use super::fracture::of_layers;
use super::{Case, CaseError, Compiled, FieldsInTime};

impl Case {
    /// The bonds as dashpots, where a potential has a `dissipation(l)` that is not 0.
    pub(super) fn dashpots(
        &self,
        compiled: &mut [Compiled],
        fields: &FieldsInTime<'_>,
        neighborhood: &Arc<Neighborhood>,
    ) -> Result<Option<Dashpots>, CaseError> {
        if compiled.iter().all(|one| one.dissipation.is_none()) {
            return Ok(None);
        }
        let own = |one: &mut Compiled| one.dissipation.take().into_iter().collect();
        let boxed = |kernel| Box::new(kernel) as Box<dyn Law>;
        let layers = of_layers(compiled, self.scene.n_laws(), own, boxed);
        let layer = |(number, of_law): (usize, Vec<Vec<Box<dyn Law>>>)| Layer {
            of_law: of_law.into_iter().map(|mut own| own.pop()).collect(),
            materials: fields.materials(number),
        };
        let layers = layers.into_iter().enumerate().map(layer).collect();
        let around = (Arc::clone(&self.body), Arc::clone(neighborhood));
        let made = Dashpots::new(around, self.scene.horizon.weighting(), layers);
        Ok(Some(made.map_err(AssemblyError::from)?))
    }

    /// Refuses dissipation where nothing has a rate, and where what moves a body, or corrects its surface,
    /// does not know it.
    ///
    /// # Errors
    /// At the potential that dissipates, or at the key.
    pub(super) fn check_dissipation(&self) -> Result<(), CaseError> {
        let mut all = self.potentials.iter().zip(&self.scene.materials);
        let Some((potential, material)) = all.find(|(one, _)| !one.model.dissipations().is_empty())
        else {
            return Ok(());
        };
        let (name, horizon) = (potential.model.name(), &self.scene.horizon);
        let at = material.potential.span;
        let (span, message, help) = match &self.scene.motion {
            None => (
                at,
                format!(
                    "load steps are statics, which have no rates, and {name} has a dissipation(l)"
                ),
                "write [motion] in the place of [steps], or take a potential without `dissipation`: \
                 equilibria are the same",
            ),
            Some(motion) if motion.method == Method::Midpoint => (
                at,
                format!(
                    "the implicit midpoint rule knows no dissipative forces, and {name} has a \
                     dissipation(l)"
                ),
                "write method = \"verlet\" in [motion]; `damping` there is one that \"midpoint\" knows",
            ),
            Some(_) if horizon.weighting().surface != Surface::None => (
                horizon.correction_span.unwrap_or(at),
                format!(
                    "surface corrections compare what bonds store, and {name} has a dissipation(l), too"
                ),
                "leave `surface` out, or take a potential without `dissipation`",
            ),
            Some(_) => return Ok(()),
        };
        let found = Diagnostic::error("conflicting-keys", span, message).help(help);
        Err(CaseError::Scene(self.scene.report(vec![found])))
    }
}
