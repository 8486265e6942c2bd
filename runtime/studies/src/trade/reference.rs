//! What errors are measured against, and below which size they are only rounding.

use std::time::{Duration, Instant};

use super::axes::reference_overrides;
use super::quantity::worst;
use super::{Quantity, ROUNDOFF, ReadCase, TradeError};
use crate::simulation::{Attempt, Course, solve};

/// Tolerances that are tried, the tightest first.
const TOLERANCES: [&str; 7] = ["1e-15", "1e-14", "1e-13", "1e-12", "1e-11", "1e-10", "1e-8"];

/// Runs that differ from the reference by rounding alone: the same tolerance on another way.
const WITNESSES: [&str; 2] = ["solver.linear=ldlt", "solver.start=tangent"];

/// Differences of fewer roundings are rounding in any scene: forces are sums of some 100 terms.
const LEAST_LEVEL: f64 = 32.0 * ROUNDOFF;

/// How far two runs of rounding errors differ, over how far the witnesses did.
const SPREAD: f64 = 2.0;

/// The run that the others are compared with.
#[derive(Clone, Debug)]
pub struct Reference {
    /// What was set in the scene for it.
    pub overrides: Vec<String>,
    /// Its end.
    pub course: Course,
    /// What it took in s.
    pub seconds: f64,
    /// The error below which there is only rounding: twice the largest distance of equally exact
    /// runs from the reference, at least 32 units of 2^-53. Of a motion the distance of a run with twice the
    /// step, which is about three times the error of the reference.
    pub level: f64,
    /// These runs, and how far each was.
    pub witnesses: Vec<(String, f64)>,
}

impl Reference {
    /// The relative error of the displacements that rounding implies at most: the condition of the
    /// tangent times 2^-53, where there were factors to estimate it from.
    pub fn displacement_error(&self) -> Option<f64> {
        Some(self.course.condition? * ROUNDOFF)
    }
}

/// Solves the scene as exactly as it can be: the reference words of all axes, and the tightest
/// tolerance that converges within `limit`, or the shortest step in time that a part of it allows.
///
/// # Errors
/// A scene that cannot be read or started, or that no tolerance converges for.
pub fn reference(
    read: &ReadCase<'_>,
    quantities: &[Quantity],
    limit: Duration,
    progress: &mut dyn FnMut(&str),
) -> Result<Reference, TradeError> {
    let own = read(&[])?.scene;
    let fixed = reference_overrides(&own.resolved_toml());
    if own.motion.is_some() {
        return of_motion(read, &fixed, quantities, limit, progress);
    }
    let started = Instant::now();
    let mut reason = String::new();
    for tolerance in TOLERANCES {
        let overrides = [fixed.as_slice(), &[format!("solver.tolerance={tolerance}")]].concat();
        progress(&format!("reference with tolerance {tolerance}"));
        let case = read(&overrides)?;
        let start = Instant::now();
        match solve(&case, limit.saturating_sub(started.elapsed()))? {
            Attempt::Reached(course) => {
                let seconds = start.elapsed().as_secs_f64();
                let mut reference = Reference {
                    overrides,
                    course: *course,
                    seconds,
                    level: LEAST_LEVEL,
                    witnesses: Vec::new(),
                };
                let left = limit.saturating_sub(started.elapsed());
                reference.add_witnesses(read, quantities, left, progress);
                return Ok(reference);
            }
            Attempt::NotConverged(message) => reason = message,
            Attempt::OutOfTime(t) => {
                reason = format!("the time was up at t = {t}");
                break;
            }
        }
    }
    Err(TradeError::NoReference { reason })
}

/// The step of the first run over the critical one, from which it is halved.
const FIRST_STEP: f64 = 0.8;

/// How often at most.
const HALVINGS: i32 = 6;

/// The part of the limit that the reference and its witness may take.
const SHARE_OF_MOTION: f64 = 1.0 / 3.0;

/// A motion with short steps, and one with twice as long ones as its witness.
fn of_motion(
    read: &ReadCase<'_>,
    fixed: &[String],
    quantities: &[Quantity],
    limit: Duration,
    progress: &mut dyn FnMut(&str),
) -> Result<Reference, TradeError> {
    let started = Instant::now();
    let mut run = |halvings: i32| -> Result<_, TradeError> {
        let step = FIRST_STEP / f64::from(1 << halvings);
        let step = ["motion.step=auto".to_string(), format!("motion.safety={step}")];
        let overrides = [fixed, &step].concat();
        progress(&format!("reference with {}", overrides[overrides.len() - 1]));
        let start = Instant::now();
        let reason = match solve(&read(&overrides)?, limit.saturating_sub(started.elapsed()))? {
            Attempt::Reached(course) => {
                return Ok((overrides, *course, start.elapsed().as_secs_f64()));
            }
            Attempt::NotConverged(message) => message,
            Attempt::OutOfTime(t) => format!("the time was up at t = {t} s"),
        };
        Err(TradeError::NoReference { reason })
    };
    let (_, _, first) = run(0)?;
    let allowed = SHARE_OF_MOTION * limit.as_secs_f64();
    let together = |halvings: i32| 1.5 * f64::from(1 << halvings) * first;
    let Some(halvings) = (1..=HALVINGS).rev().find(|n| together(*n) <= allowed) else {
        let reason = format!("one run takes {first:.1} s, and one with shorter steps more");
        return Err(TradeError::NoReference { reason });
    };
    let (twice, coarser, _) = run(halvings - 1)?;
    let (overrides, course, seconds) = run(halvings)?;
    let compared: Vec<Quantity> =
        quantities.iter().filter(|q| **q != Quantity::Residual).cloned().collect();
    let errors: Vec<f64> = compared.iter().map(|q| q.error(&coarser, &course)).collect();
    let distance = worst(&compared, &errors);
    let level = if distance.is_finite() { distance.max(LEAST_LEVEL) } else { LEAST_LEVEL };
    let witnesses = twice.last().map(|name| (name.clone(), distance)).into_iter().collect();
    Ok(Reference { overrides, course, seconds, level, witnesses })
}

impl Reference {
    fn add_witnesses(
        &mut self,
        read: &ReadCase<'_>,
        quantities: &[Quantity],
        limit: Duration,
        progress: &mut dyn FnMut(&str),
    ) {
        let start = Instant::now();
        for witness in WITNESSES {
            let left = limit.saturating_sub(start.elapsed());
            if left.as_secs_f64() < self.seconds {
                continue;
            }
            progress(&format!("reference once more with {witness}"));
            let overrides = [self.overrides.as_slice(), &[witness.to_string()]].concat();
            // A witness that cannot speak is none: the level rests on the others.
            let Ok(case) = read(&overrides) else { continue };
            let Ok(Attempt::Reached(found)) = solve(&case, left) else { continue };
            let compared: Vec<Quantity> =
                quantities.iter().filter(|q| **q != Quantity::Residual).cloned().collect();
            let errors: Vec<f64> = compared.iter().map(|q| q.error(&found, &self.course)).collect();
            let distance = worst(&compared, &errors);
            if distance.is_finite() {
                self.level = self.level.max(SPREAD * distance);
                self.witnesses.push((witness.to_string(), distance));
            }
        }
    }
}
