//! Least squares of the targets: starts on a grid, and Levenberg and Marquardt's method from them.

use nalgebra::{DMatrix, DVector};

use super::Problem;
use super::response::{Linear, Response};

/// Starts that are tried.
const STARTS: usize = 12;

/// Most steps from a start.
const STEPS: usize = 100;

/// Values of the parameters and how far they miss the targets.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// In declared units.
    pub(super) parameters: Vec<f64>,
    /// One per target.
    pub(super) residuals: Vec<f64>,
}

impl Found {
    /// The largest residual.
    pub(super) fn worst(&self) -> f64 {
        self.residuals.iter().fold(0.0f64, |worst, r| worst.max(r.abs()))
    }
}

/// The best of all.
pub(super) fn best(found: impl Iterator<Item = Option<Found>>) -> Option<Found> {
    let mut best: Option<Found> = None;
    for found in found.flatten() {
        if best.as_ref().is_none_or(|best| square(&found.residuals) < square(&best.residuals)) {
            best = Some(found);
        }
        // Better is rounding.
        if best.as_ref().is_some_and(|best| best.worst() < 1e-13) {
            break;
        }
    }
    best
}

/// Variables of both signs, spread over decades.
pub(super) fn grid(variables: usize) -> Vec<Vec<f64>> {
    let step = if variables < 3 { 0.25 } else { 0.5 };
    let mut levels = vec![0.0];
    let mut exponent = -4.0;
    while exponent <= 3.0 {
        let level = libm::exp10(exponent);
        levels.extend([level, -level]);
        exponent += step;
    }
    let mut points = vec![Vec::new()];
    for _ in 0..variables {
        let longer = |point: &Vec<f64>| {
            let point = point.clone();
            levels.iter().map(move |level| [&point[..], &[*level]].concat()).collect::<Vec<_>>()
        };
        points = points.iter().flat_map(longer).collect();
    }
    points
}

/// The points of the grid that miss the targets least; with `admissible`, of those whose values the
/// potential allows.
pub(super) fn explore(linear: &Linear, problem: &Problem<'_>, admissible: bool) -> Vec<Vec<f64>> {
    let mut ranked: Vec<(f64, Vec<f64>)> = grid(linear.len())
        .into_iter()
        .filter_map(|x| Some((square(&problem.residuals(&linear.stiffness(&x)?)?), x)))
        .collect();
    ranked.sort_by(|p, q| p.0.total_cmp(&q.0));
    let allowed = |x: &Vec<f64>| !admissible || problem.broken(&linear.parameters(x)).is_none();
    ranked.into_iter().map(|(_, x)| x).filter(allowed).take(STARTS).collect()
}

/// Least squares from a start, inside the domain where the body is stable and, if so wanted, the
/// values are admissible.
pub(super) fn refine(
    response: &dyn Response,
    problem: &Problem<'_>,
    start: &[f64],
    admissible: bool,
) -> Option<Found> {
    let evaluate = |x: &[f64]| {
        let parameters = response.parameters(x);
        if admissible && problem.broken(&parameters).is_some() {
            return None;
        }
        let stiffness = response.stiffness(x)?;
        let residuals = problem.residuals(&stiffness)?;
        Some((stiffness, Found { parameters, residuals }))
    };
    let mut x = start.to_vec();
    let (mut stiffness, mut found) = evaluate(&x)?;
    let mut damping = 1e-6;
    for _ in 0..STEPS {
        if found.worst() < 1e-15 {
            break;
        }
        let Some(slopes) = response.slopes(&x) else { break };
        let row = |target: usize| {
            let target = &problem.targets[target];
            slopes.iter().map(|slope| problem.residual_slope(target, &stiffness, slope)).collect()
        };
        let rows: Option<Vec<Vec<f64>>> = (0..problem.targets.len()).map(row).collect();
        let Some(rows) = rows else { break };
        let jacobian = DMatrix::from_fn(rows.len(), x.len(), |r, c| rows[r][c]);
        let before = square(&found.residuals);
        let mut accepted = false;
        while damping < 1e12 {
            let Some(step) = step(&jacobian, &found.residuals, damping) else { break };
            let next: Vec<f64> = x.iter().zip(step.iter()).map(|(x, s)| x + s).collect();
            match evaluate(&next) {
                Some((there, moved)) if square(&moved.residuals) < before => {
                    (x, stiffness, found) = (next, there, moved);
                    damping = (0.1 * damping).max(1e-18);
                    accepted = true;
                    break;
                }
                _ => damping = (10.0 * damping).max(1e-6),
            }
        }
        if !accepted {
            break;
        }
    }
    Some(found)
}

/// The damped step; damping is relative to the diagonal.
fn step(jacobian: &DMatrix<f64>, residuals: &[f64], damping: f64) -> Option<DVector<f64>> {
    let mut normal = jacobian.transpose() * jacobian;
    for k in 0..normal.nrows() {
        let diagonal = normal[(k, k)];
        if diagonal <= 0.0 || !diagonal.is_finite() {
            return None;
        }
        normal[(k, k)] = diagonal * (1.0 + damping);
    }
    let down = -(jacobian.transpose() * DVector::from_column_slice(residuals));
    // Scaled to a unit diagonal, so that parameters of any size can be told apart.
    let scale: Vec<f64> = (0..down.len()).map(|k| 1.0 / normal[(k, k)].sqrt()).collect();
    let n = down.len();
    let scaled = DMatrix::from_fn(n, n, |r, c| normal[(r, c)] * scale[r] * scale[c]);
    let rhs = DVector::from_fn(n, |r, _| down[r] * scale[r]);
    let solution = scaled.lu().solve(&rhs)?;
    let step = DVector::from_fn(n, |r, _| solution[r] * scale[r]);
    step.iter().all(|x| x.is_finite()).then_some(step)
}

fn square(residuals: &[f64]) -> f64 {
    residuals.iter().map(|r| r * r).sum()
}
