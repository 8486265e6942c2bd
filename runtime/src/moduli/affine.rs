//! Energy per volume of homogeneous displacement gradients, to second order at rest.

use std::sync::Arc;

use nalgebra::DMatrix;

use crate::body::Body;
use crate::energy::TotalEnergy;
use crate::lattice::upper_family;
use crate::neighborhood::Neighborhood;
use crate::scene::{Points, WeightScheme};
use crate::simulation::{Case, CaseError, ModelledEnergy};

/// Derivatives at rest of the energy density W by the displacement gradient G in `u = G X`.
///
/// Components of `G` are numbered row by row: `G[a][i] = du_a/dX_i` has the number `d*a + i`.
#[derive(Clone, Debug, PartialEq)]
pub struct Affine {
    /// `dW/dG` in Pa: the stress at rest.
    pub stress: Vec<f64>,
    /// `d2W/dG2` in Pa.
    pub tangent: DMatrix<f64>,
}

impl Affine {
    /// For the material of a case: of a point inside an endless lattice, or of a whole cloud.
    ///
    /// # Errors
    /// As [`Case::compile`] and [`Case::energy`]; energies that are not finite at rest.
    pub fn new(case: &Case) -> Result<Affine, CaseError> {
        let d = case.scene.body.dimension;
        let mut affine = Affine { stress: vec![0.0; d * d], tangent: DMatrix::zeros(d * d, d * d) };
        let Points::Lattice(shape) = &case.scene.body.points else {
            let volume = case.thickness() * case.body.volumes().iter().sum::<f64>();
            affine.add(case, &case.body, case.scene.horizon.weights, 1.0 / volume)?;
            return Ok(affine);
        };
        let spacing = shape.spacing;
        let ratio = case.scene.horizon_radius() / spacing;
        let cell = (0..d).fold(1.0, |volume, _| volume * spacing);
        if case.model.has_gathered_energy() {
            return Affine::of_states(case, spacing, ratio);
        }
        if case.model.has_gradient_energy() {
            // The deformation gradient of a linear field is exact at every point of every body, and
            // so is the energy: any block has the density of the endless lattice.
            let reach = (ratio.floor() as i64).max(1);
            let block = body(d, spacing, &cube(d, reach));
            let volume = case.thickness() * cell * block.n_points() as f64;
            affine.add(case, &block, case.scene.horizon.weights, 1.0 / volume)?;
            return Ok(affine);
        }
        // Inside, all points have all their neighbours, and truncated weights are the uniform ones.
        let weights = match case.scene.horizon.weights {
            WeightScheme::Truncated => WeightScheme::Uniform,
            other => other,
        };
        // Every interaction of the endless lattice has one translate among these points that holds
        // the origin. Those that do not hold it are taken off again.
        let mut points = upper_family(d, ratio);
        points.push([0; 3]);
        affine.add(case, &body(d, spacing, &points), weights, 1.0 / cell)?;
        points.pop();
        let rest = connected(body(d, spacing, &points), case.scene.horizon_radius())?;
        if rest.n_points() > 0 {
            affine.add(case, &rest, weights, -1.0 / cell)?;
        }
        Ok(affine)
    }

    /// Of a point inside an endless lattice that gathers over its family: its energy is a function of
    /// that family alone.
    fn of_states(case: &Case, spacing: f64, ratio: f64) -> Result<Affine, CaseError> {
        let d = case.scene.body.dimension;
        let block = body(d, spacing, &cube(d, (ratio * (1.0 + 1e-6)).floor() as i64));
        let centre = (0..block.n_points()).find(|&p| block.position(p).iter().all(|x| *x == 0.0));
        let modelled =
            case.energy_of(Arc::clone(&block), case.scene.horizon.weights, case.compile()?)?;
        let (ModelledEnergy::States(energy), Some(centre)) = (modelled, centre) else {
            let message = "nothing is gathered".to_string();
            return Err(CaseError::Body { message });
        };
        let found = energy.homogeneous(centre);
        let per_volume = 1.0 / case.thickness();
        let stress: Vec<f64> = found.first.iter().map(|x| x * per_volume).collect();
        let tangent = found.second * per_volume;
        match stress.iter().chain(&tangent).all(|x| x.is_finite()) {
            true => Ok(Affine { stress, tangent }),
            false => {
                let message = "at rest, inside the body: an energy of gathered values or a \
                               derivative is not finite";
                Err(CaseError::Body { message: message.to_string() })
            }
        }
    }

    /// Adds `factor` times the derivatives of the total energy of a body.
    fn add(
        &mut self,
        case: &Case,
        body: &Arc<Body>,
        weights: WeightScheme,
        factor: f64,
    ) -> Result<(), CaseError> {
        let energy = case.energy_of(Arc::clone(body), weights, case.compile()?)?;
        self.add_energy(energy.total(), factor).map_err(|found| CaseError::Body {
            message: format!("at rest, inside the body: {found}"),
        })
    }

    fn add_energy(
        &mut self,
        energy: &dyn TotalEnergy,
        factor: f64,
    ) -> Result<(), crate::energy::NonFinite> {
        let d = energy.dimension();
        let positions = energy.positions();
        let n = positions.len() / d;
        let centre: Vec<f64> = (0..d)
            .map(|axis| positions.iter().skip(axis).step_by(d).sum::<f64>() / n.max(1) as f64)
            .collect();
        let field = |number: usize| {
            let (component, axis) = (number / d, number % d);
            let mut u = vec![0.0; n * d];
            for point in 0..n {
                u[point * d + component] = positions[point * d + axis] - centre[axis];
            }
            u
        };
        let fields: Vec<Vec<f64>> = (0..d * d).map(field).collect();
        let rest = vec![0.0; n * d];
        let mut force = vec![0.0; n * d];
        energy.gradient(&rest, &mut force)?;
        for (stress, u) in self.stress.iter_mut().zip(&fields) {
            *stress += factor * dot(&force, u);
        }
        for (column, direction) in fields.iter().enumerate() {
            energy.tangent_product(&rest, direction, &mut force)?;
            for (row, u) in fields.iter().enumerate() {
                self.tangent[(row, column)] += factor * dot(&force, u);
            }
        }
        Ok(())
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Lattice points of a cube around the origin, in spacings.
fn cube(dimension: usize, reach: i64) -> Vec<[i64; 3]> {
    let depth = if dimension == 3 { reach } else { 0 };
    let plane = (-reach..=reach).flat_map(|x| (-reach..=reach).map(move |y| [x, y]));
    plane.flat_map(|[x, y]| (-depth..=depth).map(move |z| [x, y, z])).collect()
}

fn body(dimension: usize, spacing: f64, points: &[[i64; 3]]) -> Arc<Body> {
    let coordinates = points.iter().flat_map(|point| &point[..dimension]);
    let positions: Vec<f64> = coordinates.map(|x| *x as f64 * spacing).collect();
    let volume = (0..dimension).fold(1.0, |volume, _| volume * spacing);
    Arc::new(Body::new(dimension, &positions, &vec![volume; points.len()], Some(spacing)))
}

/// The body without points that have no neighbours, which energies refuse.
fn connected(body: Arc<Body>, horizon: f64) -> Result<Arc<Body>, CaseError> {
    let neighborhood = Neighborhood::new(&body, horizon)
        .map_err(|error| CaseError::Body { message: error.to_string() })?;
    let kept: Vec<usize> =
        (0..body.n_points()).filter(|&p| !neighborhood.row(p).is_empty()).collect();
    if kept.len() == body.n_points() {
        return Ok(body);
    }
    let positions: Vec<f64> = kept.iter().flat_map(|&p| body.position(p)).copied().collect();
    let volumes: Vec<f64> = kept.iter().map(|&p| body.volumes()[p]).collect();
    Ok(Arc::new(Body::new(body.dimension(), &positions, &volumes, body.spacing())))
}
