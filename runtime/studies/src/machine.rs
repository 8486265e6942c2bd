//! What the machine at hand can do in a second: bytes that pass between its memory and its processors,
//! multiply-adds in its widest registers, operations of a factorisation.
//!
//! It is measured in a second, and kept in a file that the caller names. A file of another
//! machine, of another version or without sense is measured anew: it is never an error.

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use piola_mechanics::pace::{self, Triad};
use piola_output::OutputError;
use piola_output::atomic::write_atomically;
use piola_solvers::linear::DenseCholesky;
use serde::{Deserialize, Serialize};

use crate::plan::available_memory;

/// Bytes of the three arrays of a triad together, far more than the caches of a processor hold.
const TRIAD_BYTES: usize = 192 << 20;

/// No larger part of the memory that is available is taken.
const MEMORY_PART: u64 = 8;

/// How long a rate is measured at least.
const PATIENCE: Duration = Duration::from_millis(120);

/// And in how many rounds at least: on a busy machine some are disturbed.
const ROUNDS: usize = 5;

/// A machine, and what it can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The version of this program, which decides how rates are measured.
    pub version: String,
    /// The processor as its maker calls it; its architecture where the system does not tell.
    pub processor: String,
    /// Numbers of 64 bits in its widest registers.
    pub lanes: usize,
    /// Threads that it runs at once.
    pub threads: usize,
    /// What one thread can do.
    pub one: Rates,
    /// What all threads can do together.
    pub all: Rates,
    /// Multiplications and additions per s of a dense Cholesky factorisation on one thread.
    pub factorisation: f64,
}

/// What some threads can do together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// Bytes per s that a triad `a = b + s c` reads and writes, on arrays that no cache holds.
    pub bandwidth: f64,
    /// Multiply-adds per s in the widest registers, on numbers that stay there: the peak.
    pub arithmetic: f64,
}

impl Machine {
    /// The machine as `file` has it; where that is missing, stale or broken measured, and kept there if
    /// that is possible.
    pub fn kept_in(file: Option<&Path>) -> Machine {
        file.and_then(Machine::read).unwrap_or_else(|| {
            let machine = Machine::measured();
            if let Some(file) = file {
                // Without its file it is measured again the next time.
                let _ = machine.keep_in(file);
            }
            machine
        })
    }

    /// Measures the machine.
    pub fn measured() -> Machine {
        let mut machine = Machine::unmeasured();
        machine.one = Rates::of(1);
        machine.all = if machine.threads > 1 { Rates::of(machine.threads) } else { machine.one };
        machine.factorisation = factorisation();
        machine
    }

    /// What a file says of this machine, if it says anything.
    pub fn read(file: &Path) -> Option<Machine> {
        let kept: Machine = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
        let unmeasured = Machine::unmeasured();
        let Machine { one, all, factorisation, .. } = unmeasured;
        let same = Machine { one, all, factorisation, ..kept.clone() };
        (same == unmeasured && kept.is_sound()).then_some(kept)
    }

    /// Writes the file, whole or not at all, and the folders that it is in.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn keep_in(&self, file: &Path) -> Result<(), OutputError> {
        if let Some(folder) = file.parent() {
            // What is wrong with it is said when the file is written.
            let _ = std::fs::create_dir_all(folder);
        }
        write_atomically(file, |out| Ok(serde_json::to_writer_pretty(out, self)?))
    }

    /// What so many threads can do: more threads than one and fewer than all share what these add.
    pub fn rates(&self, threads: usize) -> Rates {
        let others = self.threads.saturating_sub(1).max(1) as f64;
        let part = (threads.saturating_sub(1) as f64 / others).min(1.0);
        let between = |one: f64, all: f64| one + part * (all - one);
        Rates {
            bandwidth: between(self.one.bandwidth, self.all.bandwidth),
            arithmetic: between(self.one.arithmetic, self.all.arithmetic),
        }
    }

    /// What is known of it without measuring.
    fn unmeasured() -> Machine {
        Machine {
            version: env!("CARGO_PKG_VERSION").to_string(),
            processor: processor().unwrap_or_else(|| std::env::consts::ARCH.to_string()),
            lanes: pace::lanes(),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            one: Rates::NONE,
            all: Rates::NONE,
            factorisation: 0.0,
        }
    }

    /// Whether its rates can be those of a machine.
    fn is_sound(&self) -> bool {
        let Machine { one, all, factorisation, .. } = self;
        let rates = [one.bandwidth, one.arithmetic, all.bandwidth, all.arithmetic, *factorisation];
        rates.iter().all(|rate| rate.is_finite() && *rate > 0.0)
    }
}

/// What the system calls the processor.
fn processor() -> Option<String> {
    let mut system = sysinfo::System::new().ok()?;
    system.refresh_cpu_list(sysinfo::CpuRefreshKind::nothing());
    let brand = system.cpus().first()?.brand().trim();
    (!brand.is_empty()).then(|| brand.to_string())
}

impl Rates {
    const NONE: Rates = Rates { bandwidth: 0.0, arithmetic: 0.0 };

    /// Of so many threads at work together.
    fn of(threads: usize) -> Rates {
        match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => Rates {
                bandwidth: bandwidth(threads, |pass| drop(pool.broadcast(|c| pass(c.index())))),
                // Each by its own clock: the system may let them take turns on a busy machine.
                arithmetic: pool.broadcast(|_| arithmetic()).iter().sum(),
            },
            Err(_) => Rates { bandwidth: bandwidth(1, |pass| pass(0)), arithmetic: arithmetic() },
        }
    }
}

/// Bytes per s of triads that so many threads make `at_once`, which calls a pass for each.
fn bandwidth(threads: usize, at_once: impl Fn(&(dyn Fn(usize) + Sync))) -> f64 {
    let available = available_memory().map_or(usize::MAX, |bytes| (bytes / MEMORY_PART) as usize);
    let numbers = (TRIAD_BYTES.min(available) / (24 * threads)).max(1024);
    // Each thread has arrays of its own, and is the first to touch them.
    let triads: Vec<Mutex<Triad>> = (0..threads).map(|_| Mutex::default()).collect();
    let pass = |thread: usize| {
        triads[thread].lock().unwrap_or_else(PoisonError::into_inner).pass(numbers);
    };
    at_once(&pass);
    (24 * numbers * threads) as f64 / least_seconds(|| at_once(&pass))
}

/// Multiply-adds per s of this thread.
fn arithmetic() -> f64 {
    let mut made = 0;
    let seconds = least_seconds(|| made = pace::multiply_adds());
    made as f64 / seconds
}

/// Unknowns of a dense factorisation: as many as a large supernode has.
const BLOCK: usize = 512;

/// Operations per s of a factorisation on this thread.
fn factorisation() -> f64 {
    let mut block = DenseCholesky::new(BLOCK);
    block.factorise();
    block.operations() / least_seconds(|| block.factorise())
}

/// The least time of a work, in s. What ends after the patience does not count, where that was enough: by
/// then other threads may rest.
fn least_seconds(mut work: impl FnMut()) -> f64 {
    let (begin, mut least) = (Instant::now(), f64::INFINITY);
    for round in 0.. {
        let start = Instant::now();
        work();
        if round >= ROUNDS && begin.elapsed() > PATIENCE {
            break;
        }
        least = least.min(start.elapsed().as_secs_f64());
    }
    // A clock that stands still gives no rate.
    least.max(1e-9)
}

#[cfg(test)]
mod tests;
