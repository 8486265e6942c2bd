//! The first increment of a case, solved as far as a plan has time to: what it takes there.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use piola_mechanics::energy::Energy;
use piola_solvers::constraint::Constraints;
use piola_solvers::linear::{LinearOptions, LinearSolver};
use piola_solvers::steps::{StepError, run_steps};
use piola_solvers::{Event, Observer, Watch};

use super::run::{SceneDrive, failed, settings};
use crate::case::{Case, CaseError, Compiled};
use crate::plan::{ChangeOver, FirstIncrement};
use crate::scene::boundary::BoundaryConditions;

/// Factorisations of more operations are not made for a plan: half a second.
const FACTOR_OPERATIONS: f64 = 1e10;

/// Solves the first increment as a run would, until it ends or the time is up, and for as long again where
/// a stored tangent takes over; nothing where a factorisation alone would take longer. One Newton iteration
/// with that tangent is expected to take so `long`: where it exceeds the patience it ends the search.
///
/// # Errors
/// A case that cannot start.
pub(super) fn first_increment(
    case: &Case,
    compiled: Vec<Compiled>,
    patience: Duration,
    long: Duration,
) -> Result<Option<FirstIncrement>, CaseError> {
    let (energy, fields) = case.solved_energy(compiled)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    let settings = settings(&case.scene);
    if is_long(&energy, boundary.fixed_dofs(), settings.linear) {
        return Ok(None);
    }
    let seen = Seen { until: Some(Instant::now() + patience), ..Seen::default() };
    let again = (long <= patience).then_some(patience);
    let ledger = Arc::new(Ledger { again, seen: Mutex::new(seen) });
    let watch = Watch::by(Arc::clone(&ledger) as Arc<dyn Observer>);
    let drive = SceneDrive::new(&boundary, &fields);
    let nominal = settings.end / settings.increments as f64;
    let outcome = run_steps(&energy, &drive, &settings, &watch, &mut |_, _| ControlFlow::Break(()));
    let mut first = ledger.read();
    match outcome {
        Ok(outcome) => {
            if let Some(record) = outcome.records.first() {
                first.assembly = record.times.assembly.as_secs_f64();
                first.linear = record.times.linear.as_secs_f64();
                first.line_search = record.times.line_search.as_secs_f64();
                first.solved = record.t / nominal;
            }
        }
        Err(StepError::NotConverged(failure)) => {
            first.failure = Some(failed(case, &failure).1);
        }
        Err(error) => return Err(drive.explain(case, error)),
    }
    Ok(Some(first))
}

/// Whether a factorisation would take longer than a plan may.
fn is_long(energy: &dyn Energy, fixed: &[usize], options: LinearOptions) -> bool {
    let Ok(constraints) = Constraints::new(energy.positions().len(), fixed) else { return false };
    let Ok(mut solver) = LinearSolver::of_energy(energy, &constraints, options) else {
        return false;
    };
    !solver.iterates() && solver.estimate().is_ok_and(|e| e.operations > FACTOR_OPERATIONS)
}

/// Wants an end when the time is up, and writes down what it sees.
struct Ledger {
    /// Time for a stored tangent that takes over, if there is any.
    again: Option<Duration>,
    seen: Mutex<Seen>,
}

#[derive(Default)]
struct Seen {
    first: FirstIncrement,
    until: Option<Instant>,
    /// Whether a stored tangent took over in the system that is being solved.
    takes_over: bool,
    /// When the increment was first tried, and Newton's method first set out.
    tried: Option<Instant>,
    begun: Option<Instant>,
    /// When the first linear system was posed, and the last Newton iteration was finished.
    posed: Option<Instant>,
    finished: Option<Instant>,
}

impl Observer for Ledger {
    fn notice(&self, event: Event<'_>) {
        let mut seen = self.seen.lock().unwrap_or_else(|error| error.into_inner());
        let now = Instant::now();
        if let Event::Residual { iterations, .. } = event {
            seen.first.iterations += usize::from(iterations > 0);
            seen.note_change(now);
            seen.takes_over = false;
        }
        match event {
            Event::Attempt(_) => drop(seen.tried.get_or_insert(now)),
            Event::Start => drop(seen.begun.get_or_insert(now)),
            Event::Residual { iterations: 0, .. } => drop(seen.posed.get_or_insert(now)),
            Event::Residual { .. } => seen.finished = Some(now),
            Event::Product => seen.first.products += 1,
            Event::CutBack { .. } => seen.first.cut_backs += 1,
            Event::Stores(choice) => {
                let reason = choice.reason.clone();
                seen.first.stored = Some(ChangeOver { reason, iterations: 0, seconds: 0.0 });
                seen.takes_over = true;
                seen.note_change(now);
                seen.until = self.again.map(|again| now + again);
            }
            Event::Phase(_) | Event::Moved { .. } | Event::Step(_) => {}
        }
    }

    fn wants_end(&self) -> bool {
        let seen = self.seen.lock().unwrap_or_else(|error| error.into_inner());
        seen.until.is_none_or(|until| Instant::now() > until)
    }
}

impl Seen {
    /// Writes down how far the search has come while a stored tangent takes over.
    fn note_change(&mut self, now: Instant) {
        if let (true, Some(change), Some(tried)) =
            (self.takes_over, &mut self.first.stored, self.tried)
        {
            change.iterations = self.first.iterations;
            change.seconds = (now - tried).as_secs_f64();
        }
    }
}

impl Ledger {
    /// What was seen, with the time of the first assembly for all of them and the rest of the time for
    /// linear systems.
    fn read(&self) -> FirstIncrement {
        let seen = self.seen.lock().unwrap_or_else(|error| error.into_inner());
        let mut first = seen.first.clone();
        let Some(tried) = seen.tried else { return first };
        let until = seen.finished.unwrap_or_else(Instant::now);
        // Before Newton's method sets out there is the linear system of its start.
        let assembly = match (seen.begun, seen.posed) {
            (Some(begun), Some(posed)) => (posed - begun).as_secs_f64(),
            _ => 0.0,
        };
        first.assembly = assembly * first.iterations.max(1) as f64;
        first.linear = ((until - tried).as_secs_f64() - first.assembly).max(0.0);
        first
    }
}
