//! Start and end of MPI and PETSc, and what ranks tell each other.

use std::ffi::CString;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{EngineError, Failure};
use crate::ffi::Running;

/// MPI cannot start a second time in a process, not even after its end.
static STARTED: AtomicBool = AtomicBool::new(false);

/// Numbers that are gathered at once: rank 0 has room for those of all ranks.
const PART: usize = 1 << 14;

/// MPI and PETSc, from start to end of a run; at most one in a process, in the thread that started it.
///
/// Dropped, it ends both, which is collective. Dropped while its thread panics, it ends the whole run
/// instead ([`Engine::abort`] with code 101), because other ranks would wait for this one for ever.
///
/// Failures of MPI itself, as of the network or of a rank that died, end the run: this is MPI's own way,
/// and no function below returns them.
pub struct Engine {
    running: Running,
    rank: usize,
    ranks: usize,
}

impl Engine {
    /// Starts MPI and PETSc. `program` is a name for PETSc's reports; `options` are PETSc's, as they stand on
    /// a command line: `["-ksp_type", "cg", "-snes_monitor"]`. Options also come from the environment
    /// variable `PETSC_OPTIONS`, but never from a file `.petscrc`. Collective.
    ///
    /// PETSc installs no handlers of signals, as the program has its own.
    ///
    /// # Errors
    /// A second start in one process; an option with a zero byte; what PETSc reports, as when its library is
    /// of another version than its headers were. Where MPI cannot start it ends the process.
    pub fn start(program: &str, options: &[String]) -> Result<Engine, EngineError> {
        let all = std::iter::once(program).chain(options.iter().map(String::as_str));
        let arguments: Result<Vec<CString>, _> = all.map(CString::new).collect();
        let arguments = arguments.map_err(|error| {
            let text = String::from_utf8_lossy(&error.into_vec()).into_owned();
            EngineError::new(format!("the option {text:?} has a zero byte"))
        })?;
        if STARTED.swap(true, Ordering::SeqCst) {
            return Err(EngineError::new("PETSc was already started in this process"));
        }
        let running = Running::start(arguments)?;
        let (rank, ranks) = (running.rank(), running.ranks());
        Ok(Engine { running, rank, ranks })
    }

    pub(crate) fn running(&self) -> &Running {
        &self.running
    }

    /// This process's number, from 0.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// How many processes there are, at least 1.
    pub fn ranks(&self) -> usize {
        self.ranks
    }

    /// Replaces every number by its sum over the ranks, which all give equally many. Collective.
    ///
    /// The numbers are added on rank 0 in the order of the ranks: the sum has the same bits on every rank and
    /// in every run, which a reduction of MPI does not promise.
    pub fn sum(&self, values: &mut [f64]) {
        self.reduce(values, |total, own| total + own);
    }

    /// Replaces every number by its greatest over the ranks, which all give equally many; not a number where
    /// one rank has that. Collective.
    pub fn max(&self, values: &mut [f64]) {
        self.reduce(values, |most, own| if own > most || own.is_nan() { own } else { most });
    }

    fn reduce(&self, values: &mut [f64], with: impl Fn(f64, f64) -> f64) {
        for part in values.chunks_mut(PART) {
            let all = self.running.gather(part);
            if let Some((first, others)) = all.split_at_checked(part.len()) {
                part.copy_from_slice(first);
                for own in others.chunks_exact(part.len()) {
                    for (value, &own) in part.iter_mut().zip(own) {
                        *value = with(*value, own);
                    }
                }
            }
            self.running.broadcast_numbers(part);
        }
    }

    /// The bytes of all ranks, in their order, on rank 0; nothing elsewhere. Ranks may give different numbers
    /// of bytes. Collective.
    pub fn gather(&self, own: &[u8]) -> Option<Vec<Vec<u8>>> {
        let lengths = self.all_gather(own.len() as u64);
        if self.rank > 0 {
            self.running.send(own, 0);
            return None;
        }
        let others = (1..self.ranks).map(|rank| self.running.receive(lengths[rank] as usize, rank));
        Some(std::iter::once(own.to_vec()).chain(others).collect())
    }

    /// The bytes that rank 0 has for each rank, of which `part` makes those of one at a time: elsewhere it is not called.
    /// Collective.
    pub fn scatter(&self, mut part: impl FnMut(usize) -> Vec<u8>) -> Vec<u8> {
        if self.rank > 0 {
            let mut length = [0; 8];
            length.copy_from_slice(&self.running.receive(8, 0));
            return self.running.receive(u64::from_le_bytes(length) as usize, 0);
        }
        for rank in 1..self.ranks {
            let bytes = part(rank);
            self.running.send(&(bytes.len() as u64).to_le_bytes(), rank);
            self.running.send(&bytes, rank);
        }
        part(0)
    }

    /// Replaces the bytes of every rank by those of rank 0. Collective.
    pub fn broadcast(&self, bytes: &mut Vec<u8>) {
        self.broadcast_from(bytes, 0);
    }

    fn broadcast_from(&self, bytes: &mut Vec<u8>, root: usize) {
        let mut length = (bytes.len() as u64).to_le_bytes();
        self.running.broadcast(&mut length, root);
        bytes.resize(u64::from_le_bytes(length) as usize, 0);
        self.running.broadcast(bytes, root);
    }

    /// The numbers of all ranks, in their order, on every rank. Collective.
    pub fn all_gather(&self, own: u64) -> Vec<u64> {
        self.running.all_gather(own)
    }

    /// The sum of the numbers of the ranks before this one, 0 on rank 0: where a rank's part begins. Collective.
    pub fn exclusive_sum(&self, own: u64) -> u64 {
        self.all_gather(own)[..self.rank].iter().sum()
    }

    /// Whether all ranks are well, as all of them then know. Collective.
    ///
    /// # Errors
    /// On every rank the failure of the first rank that has one.
    pub fn agree(&self, own: Result<(), String>) -> Result<(), Failure> {
        let failed = self.all_gather(u64::from(own.is_err()));
        let Some(rank) = failed.iter().position(|&failed| failed != 0) else { return Ok(()) };
        let mut bytes = own.err().unwrap_or_default().into_bytes();
        self.broadcast_from(&mut bytes, rank);
        Err(Failure { rank, message: String::from_utf8_lossy(&bytes).into_owned() })
    }

    /// Ends all processes of the run at once, with this code. For errors that one rank alone knows of.
    pub fn abort(&self, code: i32) -> ! {
        self.running.abort(code)
    }

    /// Names of options that nothing has read so far, with their dash: after the first solve these are
    /// misspelt, or belong to a solver that was not chosen.
    ///
    /// # Errors
    /// What PETSc reports.
    pub fn unused_options(&self) -> Result<Vec<String>, EngineError> {
        let names = self.running.unused_options()?;
        // The engine's own, which PETSc reads at its end.
        let foreign = names.into_iter().filter(|name| name != "options_left");
        Ok(foreign.map(|name| format!("-{name}")).collect())
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.running.abort(101);
        }
        // At the end nobody is left who could act on an error.
        let _ = self.running.finalise();
    }
}
