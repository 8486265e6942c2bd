//! What `summary.json` tells of a run.

use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::interaction::Report;
use piola_output::summary::{
    InteractionCounts, MEMORY_SOURCE, Number, PhaseClock, ProbeSummary, SolverSummary, Summary,
    memory, scene_hash, versions,
};
use piola_solvers::steps::{self, Find};

use super::{Ending, RunOptions};
use crate::case::Case;
use crate::scene::selection::nearest;

/// The name of what is run.
pub(in crate::simulation) fn hash(case: &Case, resolved: &str) -> String {
    let content = case.content.map(|content| format!("{content:016x}"));
    let potentials = case.potentials.iter().map(|potential| potential.text.text.as_str());
    let beside = case.potentials.iter().flat_map(|potential| &potential.beside).map(String::as_str);
    scene_hash(resolved, potentials.chain(content.as_deref()).chain(beside))
}

/// What the summaries of all runs have.
pub(in crate::simulation) fn summary(
    case: &Case,
    energy: &Total<'_>,
    (ending, options): (&Ending, RunOptions<'_>),
    resolved: &str,
    clock: &mut PhaseClock,
) -> Summary {
    clock.leave();
    let (report, body) = (energy.report(), &case.body);
    let mut warnings = options.warnings;
    warnings.extend(ending.warnings.iter().cloned());
    Summary {
        versions: versions(),
        title: case.headline(options.title, energy.parts()),
        scene_hash: hash(case, resolved),
        exit_reason: ending.reason,
        exit_message: ending.message.clone(),
        dimension: body.dimension(),
        points: body.n_points(),
        spacing: body.spacing().map(Number),
        probes: probes(case),
        interactions: interactions(&report),
        dropped: InteractionCounts {
            bonds: 0,
            triangles: report.dropped_triangles as usize,
            tetrahedra: report.dropped_tetrahedra as usize,
        },
        warnings,
        solver: None,
        motion: None,
        threads: rayon::current_num_threads(),
        wall_seconds: Number(clock.wall_seconds()),
        phases: clock.phases().to_vec(),
        peak_memory_bytes: memory().map(|memory| memory.peak),
        memory_source: MEMORY_SOURCE,
        steps: Vec::new(),
    }
}

/// Where the points of the probes are: seldom where the scene wants them.
fn probes(case: &Case) -> Vec<ProbeSummary> {
    let numbers = |place: &[f64]| place.iter().copied().map(Number).collect();
    let told = case.scene.probes.iter().map(|probe| ProbeSummary {
        name: probe.name.value.clone(),
        at: numbers(&probe.at.value),
        point: numbers(case.body.position(nearest(&case.body, &probe.at.value).0)),
    });
    told.collect()
}

fn interactions(report: &Report) -> InteractionCounts {
    InteractionCounts {
        bonds: report.bonds as usize,
        triangles: report.triangles as usize,
        tetrahedra: report.tetrahedra as usize,
    }
}

/// How the equations of load steps were solved.
pub(super) fn solver_summary(outcome: &steps::Outcome, find: Find) -> SolverSummary {
    let (linear, counters) = (&outcome.linear, outcome.counters);
    if find == Find::Relaxation {
        return SolverSummary {
            linear: "none".to_string(),
            linear_reason: "equilibria are found by relaxation".to_string(),
            preconditioner: None,
            linear_iterations: 0,
            linear_solves: 0,
            factorizations: 0,
            tangents: counters.tangents,
            gradients: counters.gradients,
        };
    }
    SolverSummary {
        linear: linear.method.name().to_string(),
        linear_reason: linear.reason.clone(),
        preconditioner: linear.preconditioner.clone(),
        linear_iterations: linear.iterations,
        linear_solves: counters.linear_solves,
        factorizations: counters.factorizations,
        tangents: counters.tangents,
        gradients: counters.gradients,
    }
}

#[cfg(test)]
mod tests {
    use super::hash;
    use crate::case::{Case, Library};

    /// A table that changes makes another scene, as a potential that changes does.
    #[test]
    fn the_hash_covers_tables_and_imports() {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write(
            "scene.toml",
            "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n[material]\npotential = \"law.piola\"\n[steps]\nincrements = 1\n",
        );
        write(
            "law.piola",
            "potential p\nimport \"strain.piola\"\npsi(l) = L*table(\"curve.csv\", stretched)\n",
        );
        let curve = |last: f64| write("curve.csv", &format!("x,y\n-1,1\n0,0\n1,{last}\n"));
        let strain = |factor: f64| {
            write("strain.piola", &format!("potential strain\nstretched = {factor}*(l/L - 1)\n"));
        };
        let now = || {
            let path = folder.path().join("scene.toml");
            let case = Case::read(&path, &[], &Library { find: &|_| None, names: &[] }).unwrap();
            hash(&case, &case.scene.resolved_toml())
        };
        curve(1.0);
        strain(1.0);
        let first = now();
        assert_eq!(first, now());
        curve(2.0);
        let other = now();
        assert_ne!(first, other);
        strain(2.0);
        assert_ne!(other, now());
        curve(1.0);
        strain(1.0);
        assert_eq!(first, now());
    }
}
