//! The command line as a function.

use std::sync::Arc;
use std::time::Duration;

use piola::embedded::{Host, run};
use pyo3::prelude::*;
use serde_json::Value;

/// How often signals are looked for and progress is told.
const PATIENCE: Duration = Duration::from_millis(50);

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
    let work = std::thread::spawn(move || run(&words, &inside));
    let mut told = 0.0;
    let mut interrupted = None;
    while !work.is_finished() {
        py.detach(|| std::thread::sleep(PATIENCE.min(Duration::from_millis(5))));
        let mut waited = Duration::ZERO;
        while !work.is_finished() && waited < PATIENCE {
            py.detach(|| std::thread::sleep(Duration::from_millis(5)));
            waited += Duration::from_millis(5);
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
    }
    let outcome =
        work.join().map_err(|_| super::error::plain("the command ended in a defect".into()))?;
    if let Some(signal) = interrupted {
        return Err(signal);
    }
    let findings = Value::Array(outcome.findings).to_string();
    Ok((outcome.exit, outcome.data, outcome.messages, findings))
}

/// The command line on the streams of the process, as the program has it; its exit code.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, words: Vec<String>) -> u8 {
    py.detach(|| piola::execute_words(words))
}
