//! One scene for many values of some of its keys: a run each, side by side, in one table and picture.
//!
//! | stage | where |
//! |---|---|
//! | what is varied | [`Variation`] |
//! | the runs, each on threads of its own | [`sweep()`] |
//! | what they leave | [`Sweep::to_text`], [`Sweep::to_csv`], [`Sweep::to_json`], [`Sweep::picture`] |
//!
//! Runs are those of [`solve`](crate::simulation::solve()), the same bits whatever runs beside them.

mod report;
mod variation;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, mpsc};
use std::time::Instant;

use piola_solvers::Watch;

use crate::case::{Case, CaseError};
use crate::simulation::{Attempt, Course, solve_watched};

pub use variation::{MOST_RUNS, Variation};

/// Why a study could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The scene, as it is with the first of values that all cannot be read.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A text that names no values.
    #[error("`{text}` varies nothing: {reason}")]
    Variation {
        /// What was given.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Nothing is varied.
    #[error("nothing is varied")]
    Nothing,
    /// More runs than anyone waits for.
    #[error("these values make {found} runs, more than {MOST_RUNS}")]
    TooMany {
        /// How many.
        found: usize,
    },
    /// Threads cannot be started.
    #[error("cannot start the threads: {reason}")]
    Threads {
        /// Why.
        reason: String,
    },
}

impl SweepError {
    /// What the user can do about it, where we know.
    pub fn help(&self) -> Option<&'static str> {
        match self {
            SweepError::Variation { .. } | SweepError::Nothing => Some(
                "write a key with first, last and count, `material.parameters.C2=0:200:10`, or with \
                 values, `body.spacing=0.1,0.05`; a name alone, `C2=..`, is a parameter of [material]",
            ),
            SweepError::TooMany { .. } => Some("take fewer values"),
            SweepError::Case(_) | SweepError::Threads { .. } => None,
        }
    }
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// At the end of the scene.
    Reached(Box<Course>),
    /// Before, the reason in words.
    NotConverged(String),
    /// It could not start, the reason in words.
    Refused(String),
    /// It was not begun, or not ended, when an end was wanted.
    Interrupted,
}

/// One run.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Of each key its value.
    pub values: Vec<String>,
    /// How it ended.
    pub outcome: Outcome,
    /// How long it took, in s.
    pub seconds: f64,
}

/// All runs, in the order of their values: those of the last key change fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// What was varied.
    pub variations: Vec<Variation>,
    /// One per combination of values.
    pub rows: Vec<Row>,
    /// Wall time of all, in s.
    pub seconds: f64,
}

/// Reads the scene with further overrides (`solver.linear=cg`), from any thread.
pub type ReadCase<'a> = dyn Fn(&[String]) -> Result<Case, CaseError> + Sync + 'a;

/// Solves the scene with every combination of values, as many side by side as there are threads.
///
/// `done` is told of every run that ends, with all rows so far; the others are
/// [`Interrupted`](Outcome::Interrupted). `watch` may want an end of all.
///
/// # Errors
/// Values that cannot be varied, and a scene that cannot be read with any of them. Those that cannot be read
/// beside others that can are rows.
pub fn sweep(
    read: &ReadCase<'_>,
    variations: &[Variation],
    threads: usize,
    watch: &Watch,
    done: &mut dyn FnMut(&Sweep, &Row),
) -> Result<Sweep, SweepError> {
    let start = Instant::now();
    let all = variation::combinations(variations)?;
    let overrides = |values: &[String]| -> Vec<String> {
        variations.iter().zip(values).map(|(v, value)| format!("{}={value}", v.key)).collect()
    };
    let first = first_readable(read, all.iter().map(|values| overrides(values)))?;
    let first = Mutex::new(Some(first));
    let workers = threads.clamp(1, all.len());
    let pools: Vec<rayon::ThreadPool> = (0..workers)
        .map(|worker| {
            // Threads that are left over go to the first workers.
            let own = threads / workers + usize::from(worker < threads % workers);
            rayon::ThreadPoolBuilder::new().num_threads(own.max(1)).build()
        })
        .collect::<Result<_, _>>()
        .map_err(|error| SweepError::Threads { reason: error.to_string() })?;
    let blank = |values: &Vec<String>| Row {
        values: values.clone(),
        outcome: Outcome::Interrupted,
        seconds: 0.0,
    };
    let rows = all.iter().map(blank).collect();
    let mut sweep = Sweep { variations: variations.to_vec(), rows, seconds: 0.0 };
    let next = AtomicUsize::new(0);
    let (send, receive) = mpsc::channel::<(usize, Row)>();
    std::thread::scope(|scope| {
        for pool in &pools {
            let (send, next, all, overrides) = (send.clone(), &next, &all, &overrides);
            let first = &first;
            scope.spawn(move || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(values) = all.get(number).filter(|_| !watch.wants_end()) else {
                        break;
                    };
                    let known = taken(first, number);
                    let case = || known.map_or_else(|| read(&overrides(values)), Ok);
                    let row = pool.install(|| run(case, values, watch));
                    if send.send((number, row)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(send);
        for (number, row) in receive {
            sweep.rows[number] = row;
            sweep.seconds = start.elapsed().as_secs_f64();
            let row = sweep.rows[number].clone();
            done(&sweep, &row);
        }
    });
    sweep.seconds = start.elapsed().as_secs_f64();
    Ok(sweep)
}

/// The first run whose scene can be read, by its number. Where none can, it is not about the values.
fn first_readable(
    read: &ReadCase<'_>,
    overrides: impl Iterator<Item = Vec<String>>,
) -> Result<(usize, Case), SweepError> {
    let mut refused = None;
    for (number, overrides) in overrides.enumerate() {
        match read(&overrides) {
            Ok(case) => return Ok((number, case)),
            Err(error) => refused = refused.or(Some(error)),
        }
    }
    Err(refused.map_or(SweepError::Nothing, SweepError::Case))
}

/// What was read before, where it is of the run of this number.
fn taken(first: &Mutex<Option<(usize, Case)>>, number: usize) -> Option<Case> {
    let mut first = first.lock().unwrap_or_else(PoisonError::into_inner);
    first.take_if(|(of, _)| *of == number).map(|(_, case)| case)
}

fn run(
    case: impl FnOnce() -> Result<Case, CaseError> + Send,
    values: &[String],
    watch: &Watch,
) -> Row {
    let start = Instant::now();
    let solved = || -> Result<Attempt, CaseError> {
        let case = case()?;
        case.check_rest()?;
        solve_watched(&case, &watch.in_silence())
    };
    let outcome = match solved() {
        Ok(Attempt::Reached(course)) => Outcome::Reached(course),
        Ok(Attempt::NotConverged(reason)) => Outcome::NotConverged(reason),
        Ok(Attempt::OutOfTime(_)) => Outcome::Interrupted,
        Err(error) => Outcome::Refused(error.to_string()),
    };
    Row { values: values.to_vec(), outcome, seconds: start.elapsed().as_secs_f64() }
}
