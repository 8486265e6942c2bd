//! The command line as a function.

use std::ffi::OsString;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};

use piola::embedded::{Host, run};
use pyo3::prelude::*;
use serde_json::Value;

use crate::error;
use crate::wait::wait;

/// Executes a command: exit code, data, messages, findings as JSON. KeyboardInterrupt ends a run after its
/// step. `progress` is told how far it is, from 0 to 1.
#[pyfunction]
#[pyo3(signature = (words, progress=None))]
pub(crate) fn command(
    py: Python<'_>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(u8, String, String, String)> {
    let host = Arc::new(Host::default());
    let inside = host.clone();
    let (send, from) = channel();
    let from = Mutex::new(from);
    std::thread::spawn(move || send.send(run(&words, &inside)));
    let mut told = 0.0;
    let mut interrupted = None;
    let outcome = loop {
        match wait(py, &from) {
            Ok(outcome) => break outcome,
            Err(RecvTimeoutError::Timeout) => {}
            Err(_) => return Err(error::plain("the command ended in a defect".into())),
        }
        if let Err(signal) = py.check_signals() {
            host.interrupt();
            interrupted.get_or_insert(signal);
        }
        if let Some(progress) = progress.as_ref().filter(|_| host.progress() > told) {
            told = host.progress();
            if let Err(error) = progress.call1(py, (told,)) {
                host.interrupt();
                interrupted.get_or_insert(error);
            }
        }
    };
    if let Some(signal) = interrupted {
        return Err(signal);
    }
    let findings = Value::Array(outcome.findings).to_string();
    Ok((outcome.exit, outcome.data, outcome.messages, findings))
}

/// The command line on the streams of the process, as the program has it; its exit code.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, words: Vec<String>) -> u8 {
    let all = std::iter::once("piola".to_string()).chain(words);
    py.detach(|| piola::command_line(all.map(OsString::from)))
}
