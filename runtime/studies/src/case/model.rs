//! The energies that a scene models, added up.

use std::sync::Arc;

use piola_compiler::GatheredKernels;
use piola_mechanics::assembly::{AssemblyError, DiscreteEnergy};
use piola_mechanics::deformation::influence::{Constant, CubicSpline, Influence, InverseLength};
use piola_mechanics::deformation::{DeformationEnergy, Discretisation, Formulation, Stabilisation};
use piola_mechanics::energy::{Term, Total};
use piola_mechanics::kernel::{Law, VariablesLaw};
use piola_mechanics::neighborhood::Neighborhood;
use piola_mechanics::sheet::Thick;
use piola_mechanics::states::{StateEnergy, StateLaws};

use super::{Case, CaseError, Compiled, size};
use crate::scene::{InfluenceChoice, NamedInfluence, StrainSource};

impl Case {
    /// The discrete total energy: the sum of all energies of all potentials.
    ///
    /// # Errors
    /// A body that cannot be assembled: isolated or coincident points, nothing to model, more
    /// neighbours than the machine's memory holds, neighbours that determine no deformation gradient.
    pub fn energy(&self, compiled: Vec<Compiled>) -> Result<Total<'static>, CaseError> {
        let horizon = self.scene.horizon_radius();
        size::check_neighbors(&self.body, horizon, size::family(&self.body, horizon))?;
        let neighborhood = Neighborhood::new(&self.body, horizon).map_err(AssemblyError::from)?;
        let neighborhood = Arc::new(neighborhood);
        let alone = compiled.len() == 1;
        let (mut terms, mut names) = (Vec::new(), Vec::new());
        for compiled in compiled {
            let potential = compiled.name.clone();
            for term in self.terms(compiled, &neighborhood)? {
                let own = term.parts().iter();
                names.extend(own.map(|part| match alone {
                    true => part.clone(),
                    false => format!("{potential}: {part}"),
                }));
                terms.push(term);
            }
        }
        Ok(Total::named(terms, names.into()))
    }

    /// The same as a run of the scene sees it: strain and products come about as the scene says.
    ///
    /// # Errors
    /// As [`Case::energy`].
    pub fn solved_energy(&self, compiled: Vec<Compiled>) -> Result<Total<'static>, CaseError> {
        let solver = &self.scene.solver;
        let energy = self.energy(compiled)?.with_products(solver.products);
        Ok(energy.from_positions(solver.strain == StrainSource::Positions))
    }

    /// The energies of a potential: of interactions, of gathered states, of deformation gradients.
    fn terms(
        &self,
        compiled: Compiled,
        neighborhood: &Arc<Neighborhood>,
    ) -> Result<Vec<Term<'static>>, CaseError> {
        let found = || (Arc::clone(&self.body), Arc::clone(neighborhood));
        let mut terms = Vec::new();
        if compiled.has_interactions() {
            let ((body, neighborhood), weights) = (found(), self.scene.horizon.weights);
            let energy = DiscreteEnergy::among(body, neighborhood, weights, compiled.elements)?;
            terms.push(Box::new(energy).into());
        }
        if let Some(kernels) = compiled.gathered {
            let laws = state_laws(kernels, compiled.arguments, self.thickness());
            let (body, neighborhood) = found();
            let energy = StateEnergy::among(body, neighborhood, laws)?;
            terms.push(Box::new(energy).into());
        }
        if let Some(law) = compiled.gradient {
            terms.push(Box::new(self.correspondence(law, found().1)?).into());
        }
        Ok(terms)
    }

    fn correspondence(
        &self,
        law: Box<dyn VariablesLaw>,
        neighborhood: Arc<Neighborhood>,
    ) -> Result<DeformationEnergy, CaseError> {
        let (horizon, thickness) = (self.scene.horizon_radius(), self.thickness());
        let settings = self.scene.correspondence.clone().unwrap_or_default();
        let influence = influence(&settings.influence, self.body.dimension(), horizon);
        let formulation = Formulation {
            horizon,
            order: settings.order,
            discretisation: discretisation(settings.discretisation, thickness),
            influence: &*influence,
        };
        let (body, law) = (Arc::clone(&self.body), thick(law, thickness));
        Ok(DeformationEnergy::among(body, neighborhood, formulation, law)?)
    }
}

/// A law per volume as one per volume of points: per area in two dimensions.
fn thick(law: impl VariablesLaw + 'static, thickness: f64) -> Box<dyn VariablesLaw> {
    if thickness == 1.0 { Box::new(law) } else { Box::new(Thick { law, thickness }) }
}

/// The energies of gathered states of a body of this thickness.
pub(crate) fn state_laws(
    kernels: GatheredKernels,
    arguments: [String; 2],
    thickness: f64,
) -> StateLaws {
    StateLaws {
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        points: kernels.points.map(|law| thick(law, thickness)),
        bonds: kernels.bonds.map(|law| thick(law, thickness)),
        arguments,
    }
}

/// Of the material's volume as of the points': per area in two dimensions.
fn discretisation(of_material: Discretisation, thickness: f64) -> Discretisation {
    match of_material {
        Discretisation::Stabilised(Stabilisation::Silling { stiffness }) => {
            Discretisation::Stabilised(Stabilisation::Silling { stiffness: stiffness * thickness })
        }
        other => other,
    }
}

fn influence(choice: &InfluenceChoice, dimension: usize, horizon: f64) -> Box<dyn Influence> {
    match choice {
        InfluenceChoice::Named(NamedInfluence::CubicSpline) => {
            Box::new(CubicSpline { dimension, horizon })
        }
        InfluenceChoice::Named(NamedInfluence::Constant) => Box::new(Constant),
        InfluenceChoice::Named(NamedInfluence::Inverse) => Box::new(InverseLength),
        InfluenceChoice::Expression(expression) => {
            let expression = expression.clone();
            Box::new(move |length: f64| expression.influence(length, horizon))
        }
    }
}
