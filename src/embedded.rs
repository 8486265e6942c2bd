//! The command line inside another program: nothing reaches its streams, no signal is listened for.

use std::ffi::OsString;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use piola_grammar::Diagnostic;
use serde_json::Value;

use crate::render::{self, Source};
use crate::{console, execute};

/// What the program around a command hears of it, and tells it.
#[derive(Debug, Default)]
pub struct Host {
    ends: AtomicBool,
    /// The bits of a number from 0 to 1.
    progress: AtomicU64,
}

impl Host {
    /// Ends a run after its step, as SIGINT does.
    pub fn interrupt(&self) {
        self.ends.store(true, Ordering::Relaxed);
    }

    /// Whether an end is wanted.
    pub(crate) fn wants_end(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }

    /// How far a run is, from 0 to 1.
    pub fn progress(&self) -> f64 {
        f64::from_bits(self.progress.load(Ordering::Relaxed))
    }

    pub(crate) fn moved(&self, part: f64) {
        self.progress.store(part.to_bits(), Ordering::Relaxed);
    }
}

/// What a command left.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Its exit code.
    pub exit: u8,
    /// What its standard output would have got.
    pub data: String,
    /// What people would have read.
    pub messages: String,
    /// Errors and warnings as objects, as `piola check --format json` writes them; those without a place have
    /// `severity`, `message` and `helps` alone.
    pub findings: Vec<Value>,
}

/// Executes a command without the name of the program; one at a time, others wait.
pub fn run(words: &[String], host: &Arc<Host>) -> Outcome {
    let _turn = console::capture(host);
    let all = std::iter::once("piola").chain(words.iter().map(String::as_str));
    let exit = execute(all.map(OsString::from)) as u8;
    let (data, messages, findings) = console::captured();
    Outcome { exit, data, messages, findings }
}

/// A finding in a text of this name as an object, as `piola check --format json` writes it.
pub fn finding(name: &str, text: &str, diagnostic: &Diagnostic) -> Value {
    render::json(Source { name, text }, diagnostic)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Vec<String> {
        line.split(' ').map(String::from).collect()
    }

    #[test]
    fn commands_leave_data_messages_and_findings() {
        let host = Arc::new(Host::default());
        let found = run(&words("info gent"), &host);
        assert_eq!(found.exit, 0);
        assert!(found.data.contains("gent"), "{}", found.data);
        let found = run(&words("moduli nowhere.toml"), &host);
        assert_eq!(found.exit, 2);
        assert!(found.messages.contains("nowhere.toml"), "{}", found.messages);
        assert_eq!(found.findings[0]["severity"], "error");
        let found = run(&words("nonsense"), &host);
        assert_eq!(found.exit, 2);
        assert!(found.messages.contains("nonsense"), "{}", found.messages);
        let law = tempfile::NamedTempFile::with_suffix(".piola").unwrap();
        std::fs::write(law.path(), "potential p\npsi(l) = C1*(l/L - 1)^2\n").unwrap();
        let found = run(&[String::from("derive"), law.path().display().to_string()], &host);
        assert_eq!(found.findings[0]["code"], "unknown-name");
        assert_eq!(found.findings[0]["line"], 2);
    }
}
