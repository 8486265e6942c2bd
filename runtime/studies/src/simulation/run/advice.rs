//! What may be done where load steps do not end as they should.

use piola_output::History;
use piola_solvers::newton::NewtonFailure;

use crate::scene::Scene;

/// Where the last equilibrium is not stable.
pub(super) fn unstable(history: &History) -> Vec<String> {
    let is_stable = |s: &&piola_output::StepRecord| s.definiteness.positive_definite != Some(false);
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
    let steps = "take smaller steps, `increments` in [steps], or `find = \"relaxation\"` there";
    let maximum = "loads may have no equilibrium beyond a maximum: prescribe a displacement in their place, or \
                   follow the way over it by `control = \"arc-length\"` in [steps]";
    let found = match failure {
        NewtonFailure::RoundingFloor { .. } => {
            vec![
                "leave `tolerance` in [solver] out: the default is met wherever rounding lets it be",
            ]
        }
        NewtonFailure::Iterations { .. } | NewtonFailure::LineSearch { .. } => {
            let loads = (!scene.loads.is_empty()).then_some(maximum);
            [steps].into_iter().chain(loads).collect()
        }
        _ => Vec::new(),
    };
    found.into_iter().map(String::from).collect()
}
