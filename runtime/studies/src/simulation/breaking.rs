//! What is told of load steps of bodies that break.

use piola_output::Broken;
use piola_solvers::steps::{Control, Outcome, StepRecord};

use crate::scene::Scene;

/// What came loose is told in so many warnings at most.
const MOST_NOTES: usize = 100;

/// What broke, for the tables.
pub(super) fn told(record: &StepRecord) -> Option<Broken> {
    let broken = record.broken?;
    let account = broken.account;
    Some(Broken {
        bonds: broken.bonds,
        cliques: broken.cliques,
        rounds: broken.rounds,
        all: broken.all,
        all_cliques: broken.all_cliques,
        released: account.released,
        dissipated: account.dissipated,
        relaxed: account.relaxed,
        external: account.external,
        prescribed: account.prescribed,
        quadrature: account.quadrature,
    })
}

/// What came loose at a step, where there are not too many warnings yet.
pub(super) fn notes(record: &StepRecord, n_warnings: usize) -> Vec<String> {
    if record.broken.is_none() || n_warnings >= MOST_NOTES {
        return Vec::new();
    }
    record.notes.iter().map(|note| format!("at t = {}: {note}", record.t)).collect()
}

/// Whether there is a frame after so many steps by events or along the way: they are spread evenly over the most
/// there may be.
pub(super) fn has_frame(scene: &Scene, n_steps: usize) -> bool {
    let most = match scene.steps.control {
        Control::ArcLength => scene.steps.arcs,
        Control::Event | Control::Load => scene.steps.events,
    };
    let stride = most.div_ceil(scene.output.frames.max(1));
    n_steps.is_multiple_of(stride)
}

/// That a run along the way came to no end: there were as many steps as there may be.
pub(super) fn before_the_end(scene: &Scene, outcome: &Outcome) -> Option<String> {
    let steps = &scene.steps;
    let last = outcome.records.last()?;
    let is_over =
        outcome.stopped || outcome.records.len() < steps.arcs || last.t.abs() >= steps.end;
    if steps.control != Control::ArcLength || is_over {
        return None;
    }
    Some(format!(
        "at t = {}: the run ends after {} steps along the way, the most that `arcs` allows; it was to come \
         to t = {}",
        last.t, steps.arcs, steps.end
    ))
}
