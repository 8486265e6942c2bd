//! What a scene models: interactions, deformation gradients or gathered states, behind one face.

use std::sync::Arc;

use super::{Case, CaseError, Compiled, size};
use crate::assembly::{DiscreteEnergy, Inverted, Report};
use crate::body::Body;
use crate::correspondence::influence::{Constant, CubicSpline, Influence, InverseLength};
use crate::correspondence::{Correspondence, Discretisation, Formulation, Stabilisation};
use crate::energy::TotalEnergy;
use crate::kernel::{Law, Measure, VariablesLaw};
use crate::matrix::BlockPattern;
use crate::neighborhood::Neighborhood;
use crate::scene::{InfluenceChoice, NamedInfluence};
use crate::sheet::Thick;
use crate::states::{StateEnergy, StateLaws};
use crate::weights::Weights;

/// The discrete total energy of a scene.
pub enum ModelledEnergy {
    /// Energies of lengths, areas and volumes.
    Interactions(Box<DiscreteEnergy>),
    /// An energy of deformation gradients.
    Gradients(Box<Correspondence>),
    /// Energies of what points gather over their families.
    States(Box<StateEnergy>),
}

impl ModelledEnergy {
    /// As the solvers see it.
    pub fn total(&self) -> &dyn TotalEnergy {
        match self {
            ModelledEnergy::Interactions(energy) => &**energy,
            ModelledEnergy::Gradients(energy) => &**energy,
            ModelledEnergy::States(energy) => &**energy,
        }
    }

    /// What the body consists of.
    pub fn report(&self) -> Report {
        match self {
            ModelledEnergy::Interactions(energy) => energy.report().clone(),
            ModelledEnergy::Gradients(energy) => of_families(energy.neighborhood()),
            ModelledEnergy::States(energy) => of_families(energy.neighborhood()),
        }
    }

    /// How many interactions are turned inside out.
    pub fn inverted(&self, u: &[f64]) -> Inverted {
        match self {
            ModelledEnergy::Interactions(energy) => energy.inverted(u),
            ModelledEnergy::Gradients(_) | ModelledEnergy::States(_) => Inverted::default(),
        }
    }

    /// Which points are neighbours, as blocks.
    pub fn bonds(&self) -> &BlockPattern {
        let total = self.total();
        total.bond_pattern().unwrap_or_else(|| total.pattern())
    }
}

/// What a body of families consists of.
fn of_families(neighborhood: &Neighborhood) -> Report {
    Report {
        n_points: neighborhood.n_points(),
        bonds: neighborhood.n_bonds() as u64,
        shell_bonds: neighborhood.shell_bonds(),
        ..Report::default()
    }
}

impl Case {
    /// The discrete total energy.
    ///
    /// # Errors
    /// A body that cannot be assembled: isolated or coincident points, nothing to model, more
    /// neighbours than the machine's memory holds, neighbours that determine no deformation gradient.
    pub fn energy(&self, compiled: Compiled) -> Result<ModelledEnergy, CaseError> {
        let (body, horizon) = (Arc::clone(&self.body), self.scene.horizon_radius());
        size::check_neighbors(&body, horizon, size::family(&body, horizon))?;
        compiled.check_kind()?;
        if compiled.gathered.is_some() {
            let laws = compiled.state_laws(self.thickness());
            let energy = StateEnergy::new(body, horizon, laws)?;
            return Ok(ModelledEnergy::States(Box::new(energy)));
        }
        let Some(law) = compiled.gradient else {
            return interactions(body, horizon, self.scene.horizon.weights, compiled);
        };
        let thickness = self.thickness();
        let settings = self.scene.correspondence.clone().unwrap_or_default();
        let influence = influence(&settings.influence, body.dimension(), horizon);
        let formulation = Formulation {
            horizon,
            order: settings.order,
            discretisation: discretisation(settings.discretisation, thickness),
            influence: &*influence,
        };
        let energy = Correspondence::new(body, formulation, thick(law, thickness))?;
        Ok(ModelledEnergy::Gradients(Box::new(energy)))
    }
}

/// A law per volume as one per volume of points: per area in two dimensions.
fn thick(law: impl VariablesLaw + 'static, thickness: f64) -> Box<dyn VariablesLaw> {
    if thickness == 1.0 { Box::new(law) } else { Box::new(Thick { law, thickness }) }
}

impl Compiled {
    /// Refuses energies of several kinds.
    ///
    /// # Errors
    /// Which they are.
    pub(crate) fn check_kind(&self) -> Result<(), CaseError> {
        let message = if self.gathered.is_some() {
            let other = self.measures.iter().find(|measure| **measure != Measure::Length);
            let other = other.map(|m| m.symbol()).or(self.gradient.as_ref().map(|_| "F"));
            other.map(|other| {
                format!(
                    "the potential has energies of gathered values and of {other}: beside them there \
                     may be psi(l) only; put them into two potentials, or drop one by a coefficient 0"
                )
            })
        } else {
            let other = self.measures.first().filter(|_| self.gradient.is_some());
            other.map(|measure| {
                format!(
                    "the potential has energies of F and of {}: a scene models one kind; put them \
                     into two potentials, or drop one by a coefficient 0",
                    measure.symbol()
                )
            })
        };
        message.map_or(Ok(()), |message| Err(CaseError::Body { message }))
    }

    /// The energies of gathered states of a body of this thickness.
    pub(crate) fn state_laws(self, thickness: f64) -> StateLaws {
        let kernels = self.gathered.unwrap_or_default();
        StateLaws {
            integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
            points: kernels.points.map(|law| thick(law, thickness)),
            bonds: kernels.bonds.map(|law| thick(law, thickness)),
            plain: self.plain.map(|law| Box::new(law) as Box<dyn Law>),
        }
    }
}

fn interactions(
    body: Arc<Body>,
    horizon: f64,
    weights: Weights,
    compiled: Compiled,
) -> Result<ModelledEnergy, CaseError> {
    let energy = DiscreteEnergy::with_elements(body, horizon, weights, compiled.elements)?;
    Ok(ModelledEnergy::Interactions(Box::new(energy)))
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
