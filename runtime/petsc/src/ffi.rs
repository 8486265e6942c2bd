//! The border to C: what the shim has, behind functions that cannot be called wrongly.
#![allow(unsafe_code)] // each block states the fact it rests on

use std::any::Any;
use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;

use crate::error::EngineError;
use crate::newton::{Problem, Refusal};

/// Codes that callbacks return, as the shim knows them.
const FINE: i32 = 0;
const OUTSIDE: i32 = 1;
const FAILED: i32 = 2;

/// What the shim returns when a callback ended a solve.
const CALLBACK_FAILED: i32 = -1;

#[repr(C)]
struct Callbacks {
    problem: *mut c_void,
    residual: extern "C" fn(*mut c_void, *const f64, *mut f64) -> i32,
    tangent: extern "C" fn(*mut c_void, *const f64) -> i32,
    row: extern "C" fn(*mut c_void, i64, *mut f64, i64) -> i32,
    is_converged: extern "C" fn(*mut c_void, i64, f64) -> i32,
}

#[repr(C)]
struct RawOutcome {
    converged: i32,
    iterations: i64,
    linear_iterations: i64,
    residual: f64,
    reason: *const c_char,
    linear_reason: *const c_char,
}

impl RawOutcome {
    const EMPTY: RawOutcome = RawOutcome {
        converged: 0,
        iterations: 0,
        linear_iterations: 0,
        residual: 0.0,
        reason: std::ptr::null(),
        linear_reason: std::ptr::null(),
    };
}

/// How a solve ended, in numbers and names of ours.
pub(crate) struct Ended {
    pub(crate) converged: bool,
    pub(crate) iterations: u64,
    pub(crate) linear_iterations: u64,
    pub(crate) residual: f64,
    pub(crate) reason: String,
    pub(crate) linear_reason: Option<String>,
}

// SAFETY: these are the declarations of shim/shim.h, with the same types.
unsafe extern "C" {
    fn piola_message() -> *const c_char;
    fn piola_start(argc: i32, argv: *mut *mut c_char) -> i32;
    fn piola_finalise() -> i32;
    fn piola_rank() -> i32;
    fn piola_ranks() -> i32;
    fn piola_gather(own: *const f64, all: *mut f64, n: i32);
    fn piola_broadcast(bytes: *mut c_void, n: i64, root: i32);
    fn piola_all_gather(own: u64, all: *mut u64);
    fn piola_send(bytes: *const c_void, n: i64, to: i32);
    fn piola_receive(bytes: *mut c_void, n: i64, from: i32);
    fn piola_abort(code: i32);
    fn piola_most() -> i64;
    fn piola_note(text: *const c_char);
    fn piola_unused_options(joined: *mut *mut c_char) -> i32;
    fn piola_free_text(text: *mut c_char);
    fn piola_halo_new(
        own: i64,
        n_ghosts: i64,
        owners: *const i32,
        places: *const i64,
        d: i32,
        made: *mut *mut c_void,
    ) -> i32;
    fn piola_halo_fill(halo: *mut c_void, local: *mut f64) -> i32;
    fn piola_halo_add_back(halo: *mut c_void, local: *mut f64) -> i32;
    fn piola_halo_free(halo: *mut c_void);
    fn piola_newton_new(
        own: i64,
        first: i64,
        all: i64,
        d: i32,
        starts: *const i64,
        columns: *const i64,
        n_modes: i32,
        modes: *const *const f64,
        made: *mut *mut c_void,
    ) -> i32;
    fn piola_newton_solve(
        newton: *mut c_void,
        callbacks: *const Callbacks,
        u: *mut f64,
        outcome: *mut RawOutcome,
    ) -> i32;
    fn piola_newton_solve_linear(
        newton: *mut c_void,
        callbacks: *const Callbacks,
        right: *const f64,
        x: *mut f64,
        outcome: *mut RawOutcome,
    ) -> i32;
    fn piola_newton_free(newton: *mut c_void);
}

/// The text of a C string; empty for none.
fn text(start: *const c_char) -> String {
    if start.is_null() {
        return String::new();
    }
    // SAFETY: the shim hands out null or strings that end in a zero and live until its next call.
    unsafe { CStr::from_ptr(start) }.to_string_lossy().into_owned()
}

/// What a code of the shim says; its message is of the call just made.
fn check(code: i32) -> Result<(), EngineError> {
    if code == 0 {
        return Ok(());
    }
    // SAFETY: the function takes nothing and returns a static buffer that ends in a zero.
    let message = text(unsafe { piola_message() });
    let unknown = format!("PETSc ended with error {code}");
    Err(EngineError { message: if message.is_empty() { unknown } else { message } })
}

/// Proof that MPI and PETSc run: whoever has it may call what needs them, in this thread.
pub(crate) struct Running {
    _one_thread: std::marker::PhantomData<*const ()>,
}

impl Running {
    /// Starts MPI and PETSc; the caller sees to it that this happens once in a process.
    pub(crate) fn start(arguments: Vec<CString>) -> Result<Running, EngineError> {
        let count = i32::try_from(arguments.len());
        let count = count.map_err(|_| EngineError::new("too many options"))?;
        let mut pointers: Vec<*mut c_char> = arguments.into_iter().map(CString::into_raw).collect();
        pointers.push(std::ptr::null_mut());
        // PETSc keeps the arguments for as long as it runs, hence they are never freed.
        let argv = Box::leak(pointers.into_boxed_slice()).as_mut_ptr();
        // SAFETY: argv has `count` strings and a null behind them, all of which live for ever.
        check(unsafe { piola_start(count, argv) })?;
        Ok(Running { _one_thread: std::marker::PhantomData })
    }

    pub(crate) fn finalise(&mut self) -> Result<(), EngineError> {
        // SAFETY: PETSc runs, and who owns this structure calls nothing afterwards.
        check(unsafe { piola_finalise() })
    }

    pub(crate) fn rank(&self) -> usize {
        // SAFETY: MPI runs. A rank is not negative.
        unsafe { piola_rank() as usize }
    }

    pub(crate) fn ranks(&self) -> usize {
        // SAFETY: MPI runs. There is at least one rank.
        unsafe { piola_ranks() as usize }
    }

    /// The numbers of all ranks on rank 0, rank after rank; empty elsewhere. At most 2^20 numbers.
    pub(crate) fn gather(&self, own: &[f64]) -> Vec<f64> {
        assert!(own.len() <= 1 << 20, "numbers come in parts");
        let is_root = self.rank() == 0;
        let mut all = vec![0.0; if is_root { own.len() * self.ranks() } else { 0 }];
        // SAFETY: on rank 0 there is room for the numbers of all ranks, elsewhere none is written.
        unsafe { piola_gather(own.as_ptr(), all.as_mut_ptr(), own.len() as i32) };
        all
    }

    pub(crate) fn broadcast(&self, bytes: &mut [u8], root: usize) {
        // SAFETY: the slice is as long as said; any bytes are bytes.
        unsafe { piola_broadcast(bytes.as_mut_ptr().cast(), bytes.len() as i64, root as i32) };
    }

    pub(crate) fn broadcast_numbers(&self, numbers: &mut [f64]) {
        let n = size_of_val(numbers) as i64;
        // SAFETY: the slice has so many bytes, and any bits are a number.
        unsafe { piola_broadcast(numbers.as_mut_ptr().cast(), n, 0) };
    }

    pub(crate) fn all_gather(&self, own: u64) -> Vec<u64> {
        let mut all = vec![0; self.ranks()];
        // SAFETY: there is room for one number of each rank.
        unsafe { piola_all_gather(own, all.as_mut_ptr()) };
        all
    }

    pub(crate) fn send(&self, bytes: &[u8], to: usize) {
        // SAFETY: the slice is as long as said.
        unsafe { piola_send(bytes.as_ptr().cast(), bytes.len() as i64, to as i32) };
    }

    pub(crate) fn receive(&self, n: usize, from: usize) -> Vec<u8> {
        let mut bytes = vec![0; n];
        // SAFETY: there is room for n bytes.
        unsafe { piola_receive(bytes.as_mut_ptr().cast(), n as i64, from as i32) };
        bytes
    }

    pub(crate) fn abort(&self, code: i32) -> ! {
        // SAFETY: MPI runs; the function does not return.
        unsafe { piola_abort(code) };
        unreachable!("MPI_Abort ends the process")
    }

    /// The greatest number that this PETSc counts to.
    pub(crate) fn most(&self) -> u64 {
        // SAFETY: the function takes nothing and returns a constant, which is positive.
        unsafe { piola_most() as u64 }
    }

    pub(crate) fn unused_options(&self) -> Result<Vec<String>, EngineError> {
        let mut joined = std::ptr::null_mut();
        // SAFETY: PETSc runs, and the pointer is written before the function returns 0.
        check(unsafe { piola_unused_options(&mut joined) })?;
        let names = text(joined).lines().map(str::to_string).collect();
        // SAFETY: the text was allocated by the shim, and nobody reads it any more.
        unsafe { piola_free_text(joined) };
        Ok(names)
    }
}

/// A star forest; freed when dropped, before PETSc ends, as its owner borrows the engine.
pub(crate) struct RawHalo {
    handle: NonNull<c_void>,
    numbers: usize,
}

impl RawHalo {
    /// Each ghost has an owner and a place there; `own` points, `d` numbers a point.
    pub(crate) fn new(
        _: &Running,
        own: usize,
        owners: &[i32],
        places: &[i64],
        d: usize,
    ) -> Result<RawHalo, EngineError> {
        assert_eq!(owners.len(), places.len());
        let numbers = (own + owners.len()) * d;
        let (own, ghosts, d) = (own as i64, owners.len() as i64, d as i32);
        let mut made = std::ptr::null_mut();
        // SAFETY: PETSc runs; both arrays have as many elements as there are ghosts.
        check(unsafe {
            piola_halo_new(own, ghosts, owners.as_ptr(), places.as_ptr(), d, &mut made)
        })?;
        let handle = NonNull::new(made).ok_or_else(|| EngineError::new("PETSc made no halo"))?;
        Ok(RawHalo { handle, numbers })
    }

    pub(crate) fn fill(&self, local: &mut [f64]) -> Result<(), EngineError> {
        assert_eq!(local.len(), self.numbers, "numbers of owned points and ghosts");
        // SAFETY: the handle lives, and the array has all numbers that the forest knows of.
        check(unsafe { piola_halo_fill(self.handle.as_ptr(), local.as_mut_ptr()) })
    }

    pub(crate) fn add_back(&self, local: &mut [f64]) -> Result<(), EngineError> {
        assert_eq!(local.len(), self.numbers, "numbers of owned points and ghosts");
        // SAFETY: the handle lives, and the array has all numbers that the forest knows of.
        check(unsafe { piola_halo_add_back(self.handle.as_ptr(), local.as_mut_ptr()) })
    }
}

impl Drop for RawHalo {
    fn drop(&mut self) {
        // SAFETY: the handle lives, and nobody has it after this.
        unsafe { piola_halo_free(self.handle.as_ptr()) }
    }
}

/// The rows that a rank has of a matrix of blocks, as the shim takes them.
pub(crate) struct Rows<'a> {
    pub(crate) own: usize,
    pub(crate) first: u64,
    pub(crate) all: u64,
    pub(crate) d: usize,
    pub(crate) starts: &'a [i64],
    pub(crate) columns: &'a [i64],
}

/// A nonlinear solver with its matrix; freed when dropped, before PETSc ends.
pub(crate) struct RawNewton {
    handle: NonNull<c_void>,
    unknowns: usize,
}

/// How a solve ended. The inner error is what a callback of this or another rank ended with: none is another's.
pub(crate) type Solved<T> = Result<Result<T, Option<String>>, EngineError>;

/// What callbacks see of Rust.
struct Seen<'a> {
    problem: &'a mut dyn Problem,
    unknowns: usize,
    failure: Option<String>,
}

impl Seen<'_> {
    /// Callbacks for the time that this is borrowed.
    fn callbacks(&mut self) -> Callbacks {
        Callbacks {
            problem: (&raw mut *self).cast(),
            residual: on_residual,
            tangent: on_tangent,
            row: on_row,
            is_converged: on_converged,
        }
    }
}

impl RawNewton {
    pub(crate) fn new(
        _: &Running,
        rows: &Rows<'_>,
        modes: &[Vec<f64>],
    ) -> Result<RawNewton, EngineError> {
        let unknowns = rows.own * rows.d;
        assert_eq!(rows.starts.len(), rows.own + 1);
        assert_eq!(rows.starts[rows.own], rows.columns.len() as i64);
        assert!(modes.iter().all(|mode| mode.len() == unknowns));
        let pointers: Vec<*const f64> = modes.iter().map(|mode| mode.as_ptr()).collect();
        let mut made = std::ptr::null_mut();
        // SAFETY: PETSc runs; `starts` has one element more than there are rows, its last one is the
        // length of `columns`, and every mode has as many numbers as the rank has unknowns.
        check(unsafe {
            piola_newton_new(
                rows.own as i64,
                rows.first as i64,
                rows.all as i64,
                rows.d as i32,
                rows.starts.as_ptr(),
                rows.columns.as_ptr(),
                pointers.len() as i32,
                pointers.as_ptr(),
                &mut made,
            )
        })?;
        let handle = NonNull::new(made).ok_or_else(|| EngineError::new("PETSc made no solver"))?;
        Ok(RawNewton { handle, unknowns })
    }

    pub(crate) fn solve(&mut self, problem: &mut dyn Problem, u: &mut [f64]) -> Solved<Ended> {
        assert_eq!(u.len(), self.unknowns, "numbers of owned points");
        let mut seen = Seen { problem, unknowns: self.unknowns, failure: None };
        let callbacks = seen.callbacks();
        let mut raw = RawOutcome::EMPTY;
        // SAFETY: the handle lives, `u` is as long as checked, and the callbacks are used for the time
        // of the call only, in which nothing else touches `seen`.
        let code = unsafe {
            piola_newton_solve(self.handle.as_ptr(), &callbacks, u.as_mut_ptr(), &mut raw)
        };
        concluded(code, &raw, seen.failure)
    }

    pub(crate) fn solve_linear(
        &mut self,
        problem: &mut dyn Problem,
        right: &[f64],
        x: &mut [f64],
    ) -> Solved<Ended> {
        assert!(right.len() == self.unknowns && x.len() == self.unknowns, "a number an unknown");
        let mut seen = Seen { problem, unknowns: self.unknowns, failure: None };
        let callbacks = seen.callbacks();
        let mut raw = RawOutcome::EMPTY;
        // SAFETY: the handle lives, the two arrays are as long as checked, and the callbacks are used for
        // the time of the call only, in which nothing else touches `seen`.
        let code = unsafe {
            let (right, x) = (right.as_ptr(), x.as_mut_ptr());
            piola_newton_solve_linear(self.handle.as_ptr(), &callbacks, right, x, &mut raw)
        };
        concluded(code, &raw, seen.failure)
    }
}

impl Drop for RawNewton {
    fn drop(&mut self) {
        // SAFETY: the handle lives, and nobody has it after this.
        unsafe { piola_newton_free(self.handle.as_ptr()) }
    }
}

fn concluded(code: i32, raw: &RawOutcome, failure: Option<String>) -> Solved<Ended> {
    if code == CALLBACK_FAILED {
        return Ok(Err(failure));
    }
    check(code)?;
    Ok(Ok(ended(raw)))
}

fn ended(raw: &RawOutcome) -> Ended {
    Ended {
        converged: raw.converged != 0,
        iterations: raw.iterations as u64,
        linear_iterations: raw.linear_iterations as u64,
        residual: raw.residual,
        reason: text(raw.reason),
        linear_reason: (!raw.linear_reason.is_null()).then(|| text(raw.linear_reason)),
    }
}

/// Runs a callback; what it failed with, a panic also, is kept and told to the shim.
fn guarded(seen: &mut Seen<'_>, run: impl FnOnce(&mut Seen<'_>) -> Result<i32, String>) -> i32 {
    let result = catch_unwind(AssertUnwindSafe(|| run(seen)));
    let failure = match result {
        Ok(Ok(code)) => return code,
        Ok(Err(message)) => message,
        Err(payload) => format!("panic: {}", said(payload.as_ref())),
    };
    let line: String = failure.chars().filter(|&c| c != '\0').collect();
    if let Ok(line) = CString::new(line) {
        // SAFETY: the text ends in a zero and is copied.
        unsafe { piola_note(line.as_ptr()) };
    }
    seen.failure = Some(failure);
    FAILED
}

/// The text of a panic.
fn said(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}

fn code(result: Result<(), Refusal>) -> Result<i32, String> {
    match result {
        Ok(()) => Ok(FINE),
        Err(Refusal::Outside) => Ok(OUTSIDE),
        Err(Refusal::Failed(message)) => Err(message),
    }
}

/// The slice that begins at an address of C; PETSc has no array for a rank without unknowns.
///
/// # Safety
/// `start` is the address of `n` numbers that live and that nobody writes for the time of the slice.
unsafe fn numbers<'a>(start: *const f64, n: usize) -> &'a [f64] {
    if n == 0 {
        return &[];
    }
    // SAFETY: as the caller says.
    unsafe { std::slice::from_raw_parts(start, n) }
}

/// As [`numbers`], to be written.
///
/// # Safety
/// `start` is the address of `n` numbers that live and that nobody else touches for the time of the slice.
unsafe fn numbers_mut<'a>(start: *mut f64, n: usize) -> &'a mut [f64] {
    if n == 0 {
        return &mut [];
    }
    // SAFETY: as the caller says.
    unsafe { std::slice::from_raw_parts_mut(start, n) }
}

/// What [`RawNewton`] gave to the shim.
///
/// # Safety
/// `problem` is its pointer to a [`Seen`], for the time of the call.
unsafe fn seen<'a>(problem: *mut c_void) -> &'a mut Seen<'a> {
    // SAFETY: as the caller says, and callbacks do not run at the same time.
    unsafe { &mut *problem.cast() }
}

extern "C" fn on_residual(problem: *mut c_void, u: *const f64, r: *mut f64) -> i32 {
    // SAFETY: the shim calls with what `solve` gave it.
    let seen = unsafe { seen(problem) };
    // SAFETY: PETSc's arrays have a number for each unknown of the rank, and are two.
    let (u, r) = unsafe { (numbers(u, seen.unknowns), numbers_mut(r, seen.unknowns)) };
    guarded(seen, |seen| code(seen.problem.residual(u, r)))
}

extern "C" fn on_tangent(problem: *mut c_void, u: *const f64) -> i32 {
    // SAFETY: the shim calls with what `solve` gave it.
    let seen = unsafe { seen(problem) };
    // SAFETY: PETSc's array has a number for each unknown.
    let u = unsafe { numbers(u, seen.unknowns) };
    guarded(seen, |seen| code(seen.problem.tangent(u)))
}

extern "C" fn on_row(problem: *mut c_void, row: i64, values: *mut f64, n: i64) -> i32 {
    // SAFETY: the shim calls with what `solve` or `solve_linear` gave it.
    let seen = unsafe { seen(problem) };
    // SAFETY: the array is of the matrix or of the shim, has room for a row of `n` numbers, and all of it was
    // written before.
    let values = unsafe { numbers_mut(values, n as usize) };
    guarded(seen, |seen| {
        seen.problem.row(row as usize, values);
        Ok(FINE)
    })
}

extern "C" fn on_converged(problem: *mut c_void, iteration: i64, norm: f64) -> i32 {
    // SAFETY: the shim calls with what `solve` gave it.
    let seen = unsafe { seen(problem) };
    guarded(seen, |seen| {
        let done = seen.problem.is_converged(iteration as usize, norm);
        Ok(if done { FINE } else { OUTSIDE })
    })
}
