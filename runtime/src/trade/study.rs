//! The study of a scene: reference, other lattices, every setting once, then interleaved repeats.

use std::time::{Duration, Instant};

use super::axes::{Changes, OWN, settings};
use super::front::{Dot, Standing, standings};
use super::quantity::{quantities, worst};
use super::reference::{Reference, reference};
use super::resolution::{Resolution, resolution};
use super::statistics::{Times, allot};
use super::verdict::{Verdict, verdict};
use super::{Quantity, ReadCase, Setting, TradeError};
use crate::simulation::{Attempt, Case, Equilibrium, solve};

/// A setting that takes this many times as long as the scene's own, and more than a part of the
/// budget, is given up.
const PATIENCE: f64 = 10.0;
const PATIENCE_SHARE: f64 = 1.0 / 30.0;

/// The part of the budget that other lattices may take.
const RESOLUTION_SHARE: f64 = 0.25;

/// What a study is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of quantities; the usual ones if empty.
    pub quantities: Vec<String>,
    /// Names of axes whose words are combined; usual axes one at a time if empty.
    pub axes: Vec<String>,
    /// Runs of each setting, as far as the budget allows.
    pub repeats: usize,
    /// Time for everything.
    pub budget: Duration,
    /// The relative error that is small enough, if the user says so.
    pub accuracy: Option<f64>,
}

/// What was found of a setting.
#[derive(Clone, Debug)]
pub struct Measured {
    /// For each quantity.
    pub errors: Vec<f64>,
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
    end: Result<Equilibrium, String>,
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
    let settings = settings(read, &options.axes)?;
    let own = read(&[])?;
    let quantities = quantities(&own.scene, &options.quantities)?;
    let reference = reference(read, &quantities, left(), progress)?;
    let limit = left().min(options.budget.mul_f64(RESOLUTION_SHARE));
    let end = &reference.equilibrium;
    let seconds = reference.seconds;
    let resolution = resolution(read, &own, &quantities, end, seconds, limit, progress);

    let mut running: Vec<Running> = Vec::new();
    let mut own_time = Duration::from_secs_f64(seconds);
    for setting in settings {
        progress(&setting.name);
        let patience = own_time.mul_f64(PATIENCE).max(options.budget.mul_f64(PATIENCE_SHARE));
        let limit = left().min(patience);
        let (end, time) = first_run(&setting.case, limit);
        if setting.name == OWN && end.is_ok() {
            own_time = time;
        }
        running.push(Running { setting, end, times: vec![time] });
    }
    repeat(&mut running, options.repeats, left(), progress);

    let mut outcomes: Vec<Outcome> =
        running.into_iter().map(|run| outcome(run, &quantities, &reference)).collect();
    place(&mut outcomes, reference.level);
    let verdict = verdict(&outcomes, &quantities, &reference, &resolution, options.accuracy);
    let seconds = start.elapsed().as_secs_f64();
    Ok(Study { quantities, outcomes, reference, resolution, verdict, seconds })
}

fn first_run(case: &Case, limit: Duration) -> (Result<Equilibrium, String>, Duration) {
    if limit.is_zero() {
        return (Err("not run: the budget was spent".to_string()), Duration::ZERO);
    }
    let start = Instant::now();
    let end = match solve(case, limit) {
        Ok(Attempt::Reached(end)) => Ok(*end),
        Ok(Attempt::NotConverged(message)) => Err(message),
        Ok(Attempt::OutOfTime(t)) => {
            Err(format!("given up at t = {t} after {:.1} s", start.elapsed().as_secs_f64()))
        }
        Err(error) => Err(error.to_string()),
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
    let measured = |end: Equilibrium| {
        let errors: Vec<f64> =
            quantities.iter().map(|q| q.error(&end, &reference.equilibrium)).collect();
        let times = Times::of(&run.times).ok_or("no run ended")?;
        Ok(Measured {
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
