//! Waiting for a thread while the interpreter is free.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;

/// How often signals are looked for and progress is told.
const PATIENCE: Duration = Duration::from_millis(50);

/// What a thread sent, if it sends something soon.
pub(crate) fn wait<T: Send>(
    py: Python<'_>,
    from: &Mutex<Receiver<T>>,
) -> Result<T, RecvTimeoutError> {
    py.detach(|| from.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(PATIENCE))
}
