//! What may be done where load steps do not end as they should.

use piola_output::{History, StepRecord};
use piola_solvers::newton::NewtonFailure;
use piola_solvers::steps::{Control, Find};

use crate::scene::Scene;

/// Where the last equilibrium is not stable.
pub(super) fn unstable(history: &History) -> Vec<String> {
    let is_stable = |s: &&StepRecord| s.definiteness.positive_definite != Some(false);
    let last_stable = history.steps.iter().take_while(is_stable).last().map(|step| step.t);
    let there = last_stable.map(|t| {
        format!("the last equilibrium before any that is not stable: `--set steps.end={t}`")
    });
    let others = [
        "beyond a maximum of the load smaller steps do not help; where the first step is unstable look at \
         psi'' and the coefficients: `piola moduli`",
        "if such states are what the scene is about: unstable = \"accept\" in [solver]",
    ];
    there.into_iter().chain(others.map(String::from)).collect()
}

/// Where no equilibrium was found.
pub(super) fn not_found(scene: &Scene, failure: &NewtonFailure) -> Vec<String> {
    let steps = match scene.steps.find {
        Find::Newton => {
            "take smaller steps, `increments` in [steps], or `find = \"relaxation\"` there"
        }
        Find::Relaxation => {
            "take smaller steps, `increments` in [steps], or Newton's method: leave `find` out"
        }
    };
    let maximum = "loads may have no equilibrium beyond a maximum: prescribe a displacement in their place, or \
                   follow the way over it by `control = \"arc-length\"` in [steps]";
    match failure {
        NewtonFailure::RoundingFloor { within, .. } => {
            vec![format!("a `tolerance` in [solver] above {within:.0e} can be met here")]
        }
        NewtonFailure::Iterations { .. } | NewtonFailure::LineSearch { .. } => {
            let has_maximum = !scene.loads.is_empty() && scene.steps.control == Control::Load;
            let found = [steps].into_iter().chain(has_maximum.then_some(maximum));
            found.map(String::from).collect()
        }
        _ => Vec::new(),
    }
}
