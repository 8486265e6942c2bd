//! The study of a scene: reference, every setting once, other lattices, then interleaved repeats.

use std::time::{Duration, Instant};

use super::axes::{Changes, OWN, relaxed, settings};
use super::front::{Dot, Standing, standings};
use super::outcome::{Measured, Outcome};
use super::quantity::{quantities, worst};
use super::reference::{Reference, reference};
use super::resolution::{Resolution, resolution};
use super::statistics::{Times, allot};
use super::verdict::{Verdict, verdict};
use super::{Quantity, ReadCase, Setting, TradeError};
use crate::case::{Case, CaseError};
use crate::simulation::{Attempt, Course, solve};

/// A setting that takes this many times as long as the scene's own is given up, though not before
/// the first part of the budget is gone, and at the latest after the second.
const PATIENCE: f64 = 10.0;
const PATIENCE_SHARES: [f64; 2] = [1.0 / 30.0, 1.0 / 10.0];

/// The part of the time that is left after every setting ran once that other lattices may take.
const RESOLUTION_SHARE: f64 = 0.4;

/// What a study is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of quantities; the usual ones if empty.
    pub quantities: Vec<String>,
    /// Names of axes whose words are combined; usual axes one at a time if empty.
    pub axes: Vec<String>,
    /// Keys of the scene with values that are combined with these, `KEY=VALUE,VALUE`.
    pub varied: Vec<String>,
    /// Runs of each setting, as far as the budget allows.
    pub repeats: usize,
    /// Time for everything.
    pub budget: Duration,
    /// The relative error that is small enough, if the user says so.
    pub accuracy: Option<f64>,
}

/// A scene solved in many ways.
#[derive(Debug)]
pub struct Study {
    /// What was compared.
    pub quantities: Vec<Quantity>,
    /// The settings, the scene's own first.
    pub outcomes: Vec<Outcome>,
    /// What they were compared with.
    pub reference: Reference,
    /// What the lattice hides.
    pub resolution: Resolution,
    /// What follows.
    pub verdict: Verdict,
    /// What everything took in s.
    pub seconds: f64,
}

/// A setting on its way.
struct Running {
    setting: Setting,
    end: Result<Course, String>,
    times: Vec<Duration>,
}

/// Studies a scene; `progress` hears what is being done.
///
/// # Errors
/// Quantities and axes that the scene does not have, a scene that cannot start, no reference.
pub fn study(
    read: &ReadCase<'_>,
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> Result<Study, TradeError> {
    let start = Instant::now();
    let left = || options.budget.saturating_sub(start.elapsed());
    let settings = settings(read, &options.axes, &options.varied)?;
    let own = read(&[])?;
    let quantities = quantities(&own, &options.quantities)?;
    let reference = reference(read, &quantities, left(), progress)?;
    let mut running: Vec<Running> = Vec::new();
    let mut own_time = Duration::from_secs_f64(reference.seconds);
    for setting in settings {
        progress(&setting.name);
        let [least, most] = PATIENCE_SHARES.map(|share| options.budget.mul_f64(share));
        // The scene's own setting, and what is as fast, is always waited for.
        let most = most.max(2 * own_time);
        let patience = own_time.mul_f64(PATIENCE).clamp(least, most);
        let (end, time) = first_run(&setting.case, left().min(patience));
        if setting.name == OWN && end.is_ok() {
            own_time = time;
        }
        let rescued = match &end {
            Err(failure) if failure.is_a_stall() && own.scene.motion.is_none() => {
                rescued(read, &setting, &running, &mut || left().min(patience))
            }
            _ => None,
        };
        let end = end.map_err(|failure| failure.to_string());
        running.push(Running { setting, end, times: vec![time] });
        running.extend(rescued);
    }
    let limit = left().mul_f64(RESOLUTION_SHARE);
    let end = &reference.course;
    let seconds = own_time.as_secs_f64();
    let resolution = resolution(read, &own, &quantities, end, seconds, limit, progress);
    repeat(&mut running, options.repeats, left(), progress);

    let mut outcomes: Vec<Outcome> =
        running.into_iter().map(|run| outcome(run, &quantities, &reference)).collect();
    place(&mut outcomes, reference.level);
    let verdict = verdict(&outcomes, &quantities, &reference, &resolution, options.accuracy);
    let seconds = start.elapsed().as_secs_f64();
    Ok(Study { quantities, outcomes, reference, resolution, verdict, seconds })
}

/// What does not converge may do so to a looser tolerance, and the tightest is its accuracy: goes
/// from loose to tight until one fails.
fn rescued(
    read: &ReadCase<'_>,
    setting: &Setting,
    running: &[Running],
    limit: &mut dyn FnMut() -> Duration,
) -> Option<Running> {
    let is_new = |next: &Setting| running.iter().all(|r| r.setting.case.scene != next.case.scene);
    let mut tightest = None;
    for looser in relaxed(read, setting) {
        let (end, time) = first_run(&looser.case, limit());
        let Ok(end) = end else { break };
        tightest = Some(Running { setting: looser, end: Ok(end), times: vec![time] });
    }
    tightest.filter(|run| is_new(&run.setting))
}

/// Why a setting has no numbers.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("not run: the budget was spent")]
    NoTime,
    #[error("given up at t = {0} after {1:.1} s")]
    TooSlow(f64, f64),
    #[error("{0}")]
    NotConverged(String),
    #[error(transparent)]
    Case(#[from] CaseError),
}

impl Failure {
    /// Whether the first step was not reached: that may be for a tolerance below the rounding.
    fn is_a_stall(&self) -> bool {
        match self {
            Failure::NotConverged(_) => true,
            Failure::TooSlow(t, _) => *t == 0.0,
            Failure::NoTime | Failure::Case(_) => false,
        }
    }
}

fn first_run(case: &Case, limit: Duration) -> (Result<Course, Failure>, Duration) {
    if limit.is_zero() {
        return (Err(Failure::NoTime), Duration::ZERO);
    }
    let start = Instant::now();
    let end = match solve(case, limit) {
        Ok(Attempt::Reached(end)) => Ok(*end),
        Ok(Attempt::NotConverged(message)) => Err(Failure::NotConverged(message)),
        Ok(Attempt::OutOfTime(t)) => Err(Failure::TooSlow(t, start.elapsed().as_secs_f64())),
        Err(error) => Err(Failure::Case(error)),
    };
    (end, start.elapsed())
}

/// Runs the settings again and again, one after the other, so that whatever else the machine does
/// falls on all of them.
fn repeat(
    running: &mut [Running],
    wanted: usize,
    budget: Duration,
    progress: &mut dyn FnMut(&str),
) {
    let converged: Vec<usize> = (0..running.len()).filter(|&i| running[i].end.is_ok()).collect();
    let one: Vec<Duration> = converged.iter().map(|&i| running[i].times[0]).collect();
    let runs = allot(&one, wanted, budget);
    let start = Instant::now();
    for round in 1..runs.iter().copied().max().unwrap_or(1) {
        progress(&format!("round {} of up to {wanted}", round + 1));
        for (&index, _) in converged.iter().zip(&runs).filter(|(_, runs)| **runs > round) {
            if start.elapsed() > budget {
                return;
            }
            let run = &mut running[index];
            let begun = Instant::now();
            if let Ok(Attempt::Reached(_)) = solve(&run.setting.case, Duration::MAX) {
                run.times.push(begun.elapsed());
            }
        }
    }
}

fn outcome(run: Running, quantities: &[Quantity], reference: &Reference) -> Outcome {
    let measured = |end: Course| {
        let errors: Vec<f64> =
            quantities.iter().map(|q| q.error(&end, &reference.course)).collect();
        let times = Times::of(&run.times).ok_or("no run ended")?;
        Ok(Measured {
            values: quantities.iter().map(|q| q.of(&end).map_or(f64::NAN, |(x, _)| x)).collect(),
            worst: worst(quantities, &errors),
            errors,
            times,
            standing: None,
            steps: end.steps,
            iterations: end.iterations,
            linear_iterations: end.linear_iterations,
            cut_backs: end.cut_backs,
        })
    };
    Outcome { setting: run.setting, result: run.end.and_then(measured) }
}

/// Says of every setting that answers the scene's own question where it stands.
fn place(outcomes: &mut [Outcome], level: f64) {
    let answers = |outcome: &Outcome| {
        let measured = outcome.result.as_ref().ok()?;
        let own_question = outcome.setting.changes == Changes::Solution;
        let dot = Dot { times: measured.times, error: measured.worst };
        (own_question && !measured.worst.is_nan()).then_some(dot)
    };
    let dots: Vec<(usize, Dot)> =
        outcomes.iter().enumerate().filter_map(|(i, o)| Some((i, answers(o)?))).collect();
    let bare: Vec<Dot> = dots.iter().map(|(_, dot)| *dot).collect();
    for ((index, _), standing) in dots.iter().zip(standings(&bare, level)) {
        if let Ok(measured) = &mut outcomes[*index].result {
            measured.standing = Some(match standing {
                Standing::Dominated(by) => Standing::Dominated(dots[by].0),
                other => other,
            });
        }
    }
}
