//! A point inside an endless lattice: its cliques by their measure, and what its energies sum up to.

use std::sync::OnceLock;

use piola_compiler::VectorKernels;
use piola_mechanics::assembly::{AssemblyError, Elements};
use piola_mechanics::element::Element;
use piola_mechanics::kernel::{Batch, Law, Measure, Order, Outputs};
use piola_mechanics::lattice::{Shell, ordered, shells};
use piola_mechanics::neighborhood::check_horizon;
use piola_mechanics::states::StateLaws;
use piola_mechanics::surface::Weighting;
use piola_mechanics::weights::Weights;

use super::Affine;
use super::cliques::of_cliques;
use super::cubic::Cubic;
use super::directed;
use super::states::of_states;
use super::vectors;
use crate::case::{Case, CaseError, Compiled};
use crate::scene::DerivativeSource;

/// The cliques of an endless lattice, counted where they are needed, once.
pub(super) struct Inside {
    dimension: usize,
    /// In m.
    spacing: f64,
    /// In m.
    horizon: f64,
    shells: [OnceLock<Vec<Shell>>; 3],
}

impl Inside {
    /// The lattice of a case. That of a cloud is never asked for anything.
    pub(super) fn new(case: &Case) -> Inside {
        let spacing = case.scene.body.points.spacing().unwrap_or(f64::INFINITY);
        Inside {
            dimension: case.scene.body.dimension,
            spacing,
            horizon: case.scene.horizon_radius(),
            shells: Default::default(),
        }
    }

    /// Of the lattice in m; infinite of a cloud.
    pub(super) fn spacing(&self) -> f64 {
        self.spacing
    }

    pub(super) fn shells(&self, measure: Measure) -> &[Shell] {
        let find = || shells(self.dimension, self.horizon / self.spacing, measure);
        self.shells[measure.points() - 2].get_or_init(find)
    }

    /// The laws of a case, as functions of their measures.
    pub(super) fn compile(case: &Case) -> Result<Vec<Compiled>, CaseError> {
        let mut case = case.clone();
        // Measures follow a homogeneous displacement in closed form.
        if case.scene.solver.derivatives == DerivativeSource::HyperdualCoordinates {
            case.scene.solver.derivatives = DerivativeSource::Hyperdual;
        }
        case.compile()
    }

    /// Of energies of lengths, areas and volumes.
    pub(super) fn of_interactions(
        &self,
        elements: Elements,
        weighting: Weighting,
    ) -> Result<Affine, CaseError> {
        let kinds = [elements.bond, elements.triangle, elements.tetrahedron];
        if kinds.iter().all(Option::is_none) {
            return Err(refused(AssemblyError::NoEnergy));
        }
        check_horizon(self.horizon).map_err(refused)?;
        let mut sum = Cubic::new(self.dimension);
        let mut others = Affine::zero(self.dimension);
        for element in kinds.iter().flatten() {
            let is_bond = element.measure() == Measure::Length;
            match element.law() {
                law if is_bond && (element.n_fields() > 0 || law.is_none()) => {
                    others = others.plus(&self.of_directed_bonds(&**element, weighting)?);
                }
                Some((law, _)) => self.add(&mut sum, (element.measure(), law), weighting)?,
                None => others = others.plus(&self.of_cliques(&**element, weighting.weights)?),
            }
        }
        Ok(others.plus(&sum.affine()))
    }

    /// Of energies of bonds by their vectors; directions are the only fields that are left.
    fn of_directed_bonds(
        &self,
        element: &dyn Element,
        weighting: Weighting,
    ) -> Result<Affine, CaseError> {
        let whole = self.weight(Measure::Length, weighting.weights)?;
        let (horizon, spacing) = (self.horizon, self.spacing);
        let weight = |size: f64| whole * weighting.volumes.part(size * spacing, horizon, spacing);
        directed::of_bonds(element, (horizon / spacing, spacing), weight)
    }

    /// Of energies of gathered states.
    pub(super) fn of_states(&self, laws: &StateLaws) -> Result<Affine, CaseError> {
        check_horizon(self.horizon).map_err(refused)?;
        let shells = self.shells(Measure::Length);
        Ok(of_states(laws, self.dimension, self.spacing, shells).affine())
    }

    /// Of energies of what points gather of vectors.
    pub(super) fn of_vectors(&self, kernels: &VectorKernels) -> Result<Affine, CaseError> {
        check_horizon(self.horizon).map_err(refused)?;
        let ratio = self.horizon / self.spacing;
        Ok(vectors::of_vectors(kernels, self.dimension, ratio, self.spacing))
    }

    fn add(
        &self,
        sum: &mut Cubic,
        (measure, law): (Measure, &dyn Law),
        weighting: Weighting,
    ) -> Result<(), CaseError> {
        let shells = self.shells(measure);
        let weight = self.weight(measure, weighting.weights)?;
        let (horizon, spacing) = (self.horizon, self.spacing);
        let rest = AtRest::new(law, measure, shells, self.spacing);
        for (shell, [first, second]) in shells.iter().zip(rest.slopes()) {
            // What faces lack is nothing here: of corrections only parts of cells count.
            let part = weighting.volumes.part(shell.measure * spacing, horizon, spacing);
            let weight = weight * shell.count as f64 * part;
            sum.add(measure, shell.fourth, weight * first, weight * second);
        }
        Ok(())
    }
}

impl Inside {
    /// The weight of an interaction, per volume.
    pub(super) fn weight(&self, measure: Measure, weights: Weights) -> Result<f64, CaseError> {
        let count = ordered(measure, self.shells(measure));
        let (dimension, horizon, spacing) = (self.dimension, self.horizon, self.spacing);
        weights.inside(measure, dimension, horizon, spacing, count).map_err(refused)
    }

    /// Of energies that are no function of one measure: clique by clique.
    fn of_cliques(&self, element: &dyn Element, weights: Weights) -> Result<Affine, CaseError> {
        let weight = self.weight(element.measure(), weights)?;
        of_cliques(element, self.horizon / self.spacing, self.spacing, weight)
    }
}

fn refused(error: impl Into<AssemblyError>) -> CaseError {
    CaseError::Assembly(error.into())
}

/// A law at all measures of a lattice at rest.
pub(super) struct AtRest {
    /// In m, m^2 or m^3.
    pub(super) measures: Vec<f64>,
    pub(super) psi: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
}

impl AtRest {
    pub(super) fn new(law: &dyn Law, measure: Measure, shells: &[Shell], spacing: f64) -> AtRest {
        let unit = (1..measure.length_exponent()).fold(spacing, |unit, _| unit * spacing);
        let measures: Vec<f64> = shells.iter().map(|shell| shell.measure * unit).collect();
        let n = measures.len();
        let zeros = || vec![0.0; n];
        let (mut psi, mut first, mut second) = (zeros(), zeros(), zeros());
        let batch =
            Batch { measure: &measures, reference: &measures, change: &zeros(), fields: &[] };
        let out = Outputs { psi: &mut psi, dpsi: &mut first, d2psi: &mut second };
        law.evaluate(batch, Order::Tangent, out);
        AtRest { measures, psi, first, second }
    }

    /// `m psi'` and `m^2 psi''`.
    pub(super) fn slopes(&self) -> impl Iterator<Item = [f64; 2]> {
        let all = self.measures.iter().zip(&self.first).zip(&self.second);
        all.map(|((m, first), second)| [m * first, m * (m * second)])
    }
}
