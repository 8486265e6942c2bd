//! The bar under tension of partmann2026, section 5.1: 100 x 10 x 10 mm, E = 210 GPa, nu = 0.25, a
//! force of 200 kN on the last layer of points. The clamped layer, as thick as the horizon, lies
//! outside of the 100 mm.

use std::sync::Arc;
use std::time::Instant;

use piola_runtime::body::Body;
use piola_runtime::deformation::influence::CubicSpline;
use piola_runtime::deformation::{DeformationEnergy, Discretisation, Formulation, OperatorOrder};
use piola_runtime::energy::Energy;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::LinearOptions;
use piola_runtime::solve::newton::{Newton, NewtonError, NewtonSettings};

use super::common::st_venant_kirchhoff;

const LENGTH: f64 = 0.1;
const WIDTH: f64 = 0.01;
const YOUNG: f64 = 210e9;
const FORCE: f64 = 200e3;

/// A bar with its boundary conditions.
pub(crate) struct Bar {
    pub(crate) energy: DeformationEnergy,
    pub(crate) constraints: Constraints,
    pub(crate) loads: Vec<f64>,
    loaded: Vec<usize>,
}

/// The outcome of a solve.
#[derive(Debug)]
pub(crate) struct Solved {
    /// Of the elongation against the solution of the continuum (5.4).
    pub(crate) error: f64,
    pub(crate) newton_iterations: usize,
    pub(crate) linear_iterations: Vec<usize>,
    /// Free residual over the larger of reactions and loads.
    pub(crate) residual: f64,
    pub(crate) stores_matrix: bool,
    pub(crate) preconditioner: String,
    pub(crate) seconds: f64,
    pub(crate) u: Vec<f64>,
}

impl Bar {
    /// `across` points over the width, a horizon of `horizon` spacings, the cubic spline.
    pub(crate) fn new(across: usize, horizon: usize, discretisation: Discretisation) -> Bar {
        let spacing = WIDTH / across as f64;
        let along = 10 * across + horizon;
        let mut positions = Vec::new();
        for k in 0..along * across * across {
            let cell = [k / (across * across), k / across % across, k % across];
            let centre = |k: usize| (k as f64 + 0.5) * spacing;
            positions.extend([
                centre(cell[0]) - horizon as f64 * spacing,
                centre(cell[1]),
                centre(cell[2]),
            ]);
        }
        let volumes = vec![spacing * spacing * spacing; along * across * across];
        let body = Arc::new(Body::new(3, &positions, &volumes, Some(spacing)));
        let delta = horizon as f64 * spacing;
        let formulation = Formulation {
            horizon: delta,
            order: OperatorOrder::First,
            discretisation,
            influence: &CubicSpline { dimension: 3, horizon: delta },
        };
        let law = st_venant_kirchhoff(3, YOUNG, 0.25);
        let energy = DeformationEnergy::new(Arc::clone(&body), formulation, law).unwrap();
        let points = 0..body.n_points();
        let fixed: Vec<usize> = points
            .clone()
            .filter(|&p| body.position(p)[0] < 0.0)
            .flat_map(|p| 3 * p..3 * p + 3)
            .collect();
        let loaded: Vec<usize> =
            points.filter(|&p| body.position(p)[0] > LENGTH - spacing).collect();
        let mut loads = vec![0.0; body.positions().len()];
        loaded.iter().for_each(|&p| loads[3 * p] = FORCE / loaded.len() as f64);
        let constraints = Constraints::new(loads.len(), &fixed).unwrap();
        Bar { energy, constraints, loads, loaded }
    }

    /// The equilibrium, from rest in one step.
    pub(crate) fn solve(&self, options: LinearOptions) -> Solved {
        self.solve_by(&self.energy, NewtonSettings::default(), options).unwrap()
    }

    /// The same for this energy in another guise.
    pub(crate) fn solve_by(
        &self,
        energy: &dyn Energy,
        settings: NewtonSettings,
        options: LinearOptions,
    ) -> Result<Solved, NewtonError> {
        let mut newton = Newton::new(energy, &self.constraints, settings, options).unwrap();
        self.solve_with(&mut newton)
    }

    /// The same by Newton's method that is at hand.
    pub(crate) fn solve_with(&self, newton: &mut Newton<'_>) -> Result<Solved, NewtonError> {
        let start = Instant::now();
        let mut u = vec![0.0; self.loads.len()];
        let report = newton.solve(&mut u, &self.loads)?;
        let moved = |&p: &usize| u[3 * p..3 * p + 3].iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        let elongation = self.loaded.iter().map(moved).sum::<f64>() / self.loaded.len() as f64;
        Ok(Solved {
            error: elongation / elongation_of_the_continuum() - 1.0,
            newton_iterations: report.iterations,
            linear_iterations: report.linear.iter().map(|linear| linear.iterations).collect(),
            stores_matrix: newton.linear().stores_matrix(),
            preconditioner: newton.linear().preconditioner().unwrap_or_default(),
            seconds: start.elapsed().as_secs_f64(),
            residual: report.history.residual_over_reaction.last().copied().unwrap_or(0.0),
            u,
        })
    }
}

/// (5.3) and (5.4).
fn elongation_of_the_continuum() -> f64 {
    let stress = FORCE / (WIDTH * WIDTH);
    let mut stretch: f64 = 1.0;
    for _ in 0..20 {
        let residual = stretch * stretch * stretch - stretch - 2.0 * stress / YOUNG;
        stretch -= residual / (3.0 * stretch * stretch - 1.0);
    }
    (stretch - 1.0) * LENGTH
}
