//! What tables and the summary say of the rows of a motion.

use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::kernel::Measure;
use piola_mechanics::words::Words as _;
use piola_output::fracture::{FractureColumns, FractureRow};
use piola_output::motion::{BrokenRow, MotionColumns, MotionEnergies, MotionRow, MotionSummary};
use piola_output::summary::Number;
use piola_solvers::motion::{self, Method, Others, Row};

use super::ready::frames;
use crate::case::Case;
use crate::scene::Motion;
use crate::scene::selection::Selection;

/// What is seen of a body where a row is due, beside what the row says.
pub(in crate::simulation) struct Seen {
    /// Of each set its reaction in N, of each probe its displacement in m.
    pub(in crate::simulation) reactions: Vec<Vec<f64>>,
    pub(in crate::simulation) probes: Vec<Vec<f64>>,
    pub(in crate::simulation) fracture: Option<FractureRow>,
}

fn remembers(energy: &Total<'_>) -> bool {
    energy.fracture().is_some_and(|fracture| fracture.n_states() > 0)
}

/// What the tables of the motion have columns for.
pub(in crate::simulation) fn columns(
    case: &Case,
    energy: &Total<'_>,
    selection: &Selection,
    fracture: Option<FractureColumns>,
) -> MotionColumns {
    MotionColumns {
        dimension: case.body.dimension(),
        parts: energy.parts().to_vec(),
        sets: selection.sets.iter().map(|set| set.name.clone()).collect(),
        probes: selection.probes.iter().map(|probe| probe.name.clone()).collect(),
        parameters_change: case.parameters_change(),
        breaks: energy.fracture().is_some(),
        breaks_cliques: [Measure::Area, Measure::Volume].map(|measure| {
            energy.fracture().is_some_and(|fracture| fracture.counts_of(measure).is_some())
        }),
        remembers: remembers(energy),
        fracture,
    }
}

/// The lines of the tables.
pub(in crate::simulation) fn row(row: &Row, energy: &Total<'_>, seen: Seen) -> MotionRow {
    MotionRow {
        step: row.step,
        t: row.t,
        kinetic: row.kinetic,
        kinetic_leapfrog: row.kinetic_leapfrog,
        parts: row.energy.iter().map(|(_, value)| value).collect(),
        damping: row.damping,
        external: row.external,
        prescribed: row.prescribed,
        quadrature: row.quadrature,
        rounding: row.rounding,
        parameters: row.parameters,
        broken: row.broken.map(|bonds| BrokenRow {
            bonds,
            cliques: row.broken_cliques,
            released: row.released,
            dissipated: remembers(energy).then_some(row.dissipated),
            timing: row.timing,
            created: row.created,
        }),
        momentum: row.momentum.clone(),
        angular_momentum: row.angular_momentum.clone(),
        reactions: seen.reactions,
        probes: seen.probes,
        fracture: seen.fracture,
    }
}

/// Whether there is a frame at `t` in s, behind so many: they are written at the first rows at or behind times that
/// divide the way evenly.
pub(in crate::simulation) fn is_due(case: &Case, n_frames: usize, t: f64) -> bool {
    let Some(motion) = &case.scene.motion else { return false };
    let frames = frames(case, motion);
    // The last row meets the end exactly, the others up to rounding.
    let reached = (t / motion.end * frames * (1.0 + 1e-12)).floor() as usize;
    reached >= n_frames
}

/// What the summary says of a motion behind its last row, of which the account closes to the share `rounding`, of a
/// body of so much `mass` in kg.
pub(in crate::simulation) fn summary(
    (scene, motion): (&Motion, &motion::Motion<'_, impl Others>),
    (row, rounding, resumed): (&Row, f64, Option<usize>),
    energy: &Total<'_>,
    mass: f64,
) -> MotionSummary {
    let finite = |x: f64| x.is_finite().then_some(Number(x));
    MotionSummary {
        method: scene.method.word().to_string(),
        step_seconds: Number(motion.step()),
        critical_step_seconds: motion.critical().map(|found| Number(found.seconds)),
        least_critical_step_seconds: finite(motion.least_critical()),
        steps: motion.n_steps(),
        steps_made: row.step,
        t: Number(row.t),
        mass: Number(mass),
        energies: MotionEnergies {
            kinetic: Number(row.kinetic),
            stored: Number(row.energy.total()),
            damping: Number(row.damping),
            external: Number(row.external),
            prescribed: Number(row.prescribed),
            quadrature: Number(row.quadrature),
            parameters: row.parameters.map(Number),
            released: row.broken.map(|_| Number(row.released)),
            dissipated: remembers(energy).then_some(Number(row.dissipated)),
            created: row.broken.map(|_| Number(row.created)),
            broken_bonds: row.broken,
            broken_areas: row.broken_cliques[0],
            broken_volumes: row.broken_cliques[1],
        },
        resumed_at_step: resumed,
        rounding: Number(rounding),
    }
}

/// What is said of a step beyond the critical one, which the scene allows.
pub(in crate::simulation) fn unstable(
    scene: &Motion,
    motion: &motion::Motion<'_, impl Others>,
) -> Option<String> {
    let is_explicit = scene.method != Method::Midpoint;
    let is_beyond = scene.unstable && is_explicit && motion.step() > motion.least_critical();
    is_beyond.then(|| {
        format!(
            "the step {:e} s is beyond the critical one, {:.6e} s: the motion is unstable",
            motion.step(),
            motion.least_critical()
        )
    })
}
