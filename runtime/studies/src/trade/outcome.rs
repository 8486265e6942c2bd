//! What a study finds of one setting.

use super::Setting;
use super::front::Standing;
use super::statistics::Times;

/// What was found of a setting.
#[derive(Clone, Debug)]
pub struct Measured {
    /// For each quantity.
    pub errors: Vec<f64>,
    /// The size of each at the end in its unit; NaN where there is none.
    pub values: Vec<f64>,
    /// The largest of them, the residual left out.
    pub worst: f64,
    /// Time to solution.
    pub times: Times,
    /// Where it stands; `None` for settings that ask another question.
    pub standing: Option<Standing>,
    /// Converged steps.
    pub steps: usize,
    /// Newton iterations.
    pub iterations: usize,
    /// Iterations of conjugate gradients.
    pub linear_iterations: usize,
    /// Halved increments.
    pub cut_backs: usize,
}

/// A setting and what came of it: numbers, or why there are none.
#[derive(Debug)]
pub struct Outcome {
    /// The setting.
    pub setting: Setting,
    /// Its numbers, or the reason.
    pub result: Result<Measured, String>,
}
