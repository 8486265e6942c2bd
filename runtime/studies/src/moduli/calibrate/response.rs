//! How the elasticity tensor answers to the parameters.

use std::cell::Cell;

use super::{CalibrateError, Problem, Stiffness, input};

/// An elasticity tensor as a function of variables that stand for the parameters.
pub(super) trait Response {
    /// The parameters in declared units.
    fn parameters(&self, x: &[f64]) -> Vec<f64>;

    /// The tensor; nothing where it cannot be evaluated.
    fn stiffness(&self, x: &[f64]) -> Option<Stiffness>;

    /// Its derivatives by the variables.
    fn slopes(&self, x: &[f64]) -> Option<Vec<Stiffness>>;
}

/// A tensor that is linear in the parameters, exactly. A variable of 1 is a parameter that by itself
/// gives stresses of the size of the targets.
pub(super) struct Linear {
    base: Vec<f64>,
    constant: Stiffness,
    /// By the parameters.
    columns: Vec<Stiffness>,
    units: Vec<f64>,
}

/// A column is sampled so that it changes the tensor by this part of it at least.
const VISIBLE: f64 = 1e-2;

/// Deviations from a linear function that are rounding, over the sum of the absolute values.
const ROUNDING: f64 = 1e-11;

impl Linear {
    /// One evaluation per parameter or a few, and one to see whether the tensor is linear; nothing
    /// if it is not.
    pub(super) fn sample(
        problem: &Problem<'_>,
        base: &[f64],
        first: &Stiffness,
        scale: f64,
        evaluations: &mut usize,
    ) -> Result<Option<Linear>, CalibrateError> {
        let size = first.size();
        let mut evaluate = |at: &[f64]| {
            *evaluations += 1;
            problem.moduli_at(at).ok()
        };
        let mut columns = Vec::new();
        let mut steps = Vec::new();
        for k in 0..base.len() {
            let mut step = if base[k] == 0.0 { 1.0 } else { base[k] };
            let mut column = None;
            for _ in 0..6 {
                let mut at = base.to_vec();
                at[k] += step;
                let Some(there) = evaluate(&at) else { break };
                let change = there.plus(-1.0, first).scaled(1.0 / step);
                let seen = (change.size() * step / size).abs();
                column = Some((change, step, seen));
                if seen >= VISIBLE {
                    break;
                }
                step *= if seen > 1e-12 { 1.0 / seen } else { 1e6 };
            }
            let Some((change, step, seen)) = column else { return Ok(None) };
            if seen.is_nan() || seen < 1e-9 {
                let message = format!("the moduli do not depend on `{}`", problem.names[k]);
                return Err(input(message, "vary another parameter"));
            }
            columns.push(change);
            steps.push(step);
        }
        // Another place, with no two steps in a ratio that a product could hide in.
        let parts = [0.37, 0.71, 0.59];
        let moves: Vec<f64> = (0..base.len()).map(|k| parts[k % 3] * steps[k]).collect();
        let at: Vec<f64> = base.iter().zip(&moves).map(|(b, m)| b + m).collect();
        let Some(there) = evaluate(&at) else { return Ok(None) };
        let mut expected = first.clone();
        let mut magnitude = size;
        for (column, step) in columns.iter().zip(&moves) {
            expected = expected.plus(*step, column);
            magnitude += (column.size() * *step).abs();
        }
        if there.plus(-1.0, &expected).size() > ROUNDING * magnitude {
            return Ok(None);
        }
        let units = columns.iter().map(|column| scale / column.size()).collect();
        Ok(Some(Linear { base: base.to_vec(), constant: first.clone(), columns, units }))
    }

    /// The same function around another place, where the tensor is known.
    pub(super) fn rebased(&self, base: &[f64], there: &Stiffness, scale: f64) -> Linear {
        Linear {
            base: base.to_vec(),
            constant: there.clone(),
            columns: self.columns.clone(),
            units: self.columns.iter().map(|column| scale / column.size()).collect(),
        }
    }

    /// How many variables there are.
    pub(super) fn len(&self) -> usize {
        self.base.len()
    }

    /// The variables of these parameters.
    pub(super) fn variables(&self, parameters: &[f64]) -> Vec<f64> {
        parameters.iter().zip(&self.units).map(|(p, unit)| p / unit).collect()
    }
}

impl Response for Linear {
    fn parameters(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.units).map(|(x, unit)| x * unit).collect()
    }

    fn stiffness(&self, x: &[f64]) -> Option<Stiffness> {
        let moves = self.parameters(x).into_iter().zip(&self.base).map(|(p, base)| p - base);
        let add = |sum: Stiffness, (column, step): (&Stiffness, f64)| sum.plus(step, column);
        Some(self.columns.iter().zip(moves).fold(self.constant.clone(), add))
    }

    fn slopes(&self, _: &[f64]) -> Option<Vec<Stiffness>> {
        Some(
            self.columns
                .iter()
                .zip(&self.units)
                .map(|(column, unit)| column.scaled(*unit))
                .collect(),
        )
    }
}

/// A tensor that has to be sampled. Parameters keep their signs: variables are logarithms of their
/// ratios to the scene's values, or the parameters themselves where those are 0.
pub(super) struct Sampled<'a> {
    problem: &'a Problem<'a>,
    base: Vec<f64>,
    evaluations: Cell<usize>,
}

/// The step of central differences, whose error slows Newton's method down and does no more.
const STEP: f64 = 1e-4;

impl<'a> Sampled<'a> {
    pub(super) fn new(problem: &'a Problem<'a>, base: &[f64]) -> Sampled<'a> {
        Sampled { problem, base: base.to_vec(), evaluations: Cell::new(0) }
    }

    pub(super) fn evaluations(&self) -> usize {
        self.evaluations.get()
    }

    /// The scene's values, and each of them larger and smaller.
    pub(super) fn starts(&self) -> Vec<Vec<f64>> {
        let n = self.base.len();
        let mut starts = vec![vec![0.0; n]];
        for k in 0..n {
            for moved in [1.0, -1.0] {
                let mut start = vec![0.0; n];
                start[k] = moved;
                starts.push(start);
            }
        }
        starts
    }
}

impl Response for Sampled<'_> {
    fn parameters(&self, x: &[f64]) -> Vec<f64> {
        let value = |(x, base): (&f64, &f64)| if *base == 0.0 { *x } else { base * libm::exp(*x) };
        x.iter().zip(&self.base).map(value).collect()
    }

    fn stiffness(&self, x: &[f64]) -> Option<Stiffness> {
        self.evaluations.set(self.evaluations.get() + 1);
        self.problem.moduli_at(&self.parameters(x)).ok()
    }

    fn slopes(&self, x: &[f64]) -> Option<Vec<Stiffness>> {
        let slope = |k: usize| {
            let at = |step: f64| {
                let mut moved = x.to_vec();
                moved[k] += step;
                self.stiffness(&moved)
            };
            Some(at(STEP)?.plus(-1.0, &at(-STEP)?).scaled(0.5 / STEP))
        };
        (0..x.len()).map(slope).collect()
    }
}
