//! The standard streams: the only place that writes to them.
//!
//! A message that cannot be written is lost and nothing else: no run ends because its terminal went
//! away. Data are different: a reader that has seen enough and closed the pipe is no error, but data
//! that a full disk cut short are, and [`finish`] says so.

use std::fs::File;
use std::io::{self, IsTerminal as _, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use clap::ValueEnum;
use serde_json::{Value, json};

use crate::embedded::Host;

/// When messages have colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Color {
    /// On a terminal that knows them, unless NO_COLOR is set
    #[default]
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

/// How much is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Verbosity {
    /// Errors and warnings.
    Quiet,
    /// Also notes and progress.
    #[default]
    Normal,
    /// Also every iteration.
    Verbose,
}

#[derive(Clone, Copy, Debug)]
struct Style {
    color: bool,
    verbosity: Verbosity,
}

static STYLE: OnceLock<Style> = OnceLock::new();

/// Where everything goes in place of the streams, while another program has this one inside.
static CAPTURED: Mutex<Option<Captured>> = Mutex::new(None);

/// A file that gets messages, too.
static LOG: Mutex<Option<File>> = Mutex::new(None);

/// Whose turn it is to have it inside.
static TURN: Mutex<()> = Mutex::new(());

struct Captured {
    host: Arc<Host>,
    data: String,
    messages: String,
    findings: Vec<Value>,
}

/// What goes to the streams is kept until [`captured`]; others wait for the end of the guard.
pub(crate) fn capture(host: &Arc<Host>) -> MutexGuard<'static, ()> {
    let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let (data, messages) = (String::new(), String::new());
    *kept() = Some(Captured { host: host.clone(), data, messages, findings: Vec::new() });
    turn
}

/// Data, messages and findings since [`capture`]; from now on the streams get them again.
pub(crate) fn captured() -> (String, String, Vec<Value>) {
    kept().take().map_or_else(Default::default, |all| (all.data, all.messages, all.findings))
}

/// Who has this program inside.
pub(crate) fn host() -> Option<Arc<Host>> {
    kept().as_ref().map(|captured| captured.host.clone())
}

fn kept() -> MutexGuard<'static, Option<Captured>> {
    CAPTURED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps a finding for whoever has this program inside.
pub(crate) fn find(finding: impl FnOnce() -> Value) {
    if let Some(captured) = kept().as_mut() {
        captured.findings.push(finding());
    }
}

/// Why data could not be written, once that happened.
static LOST: Mutex<Option<io::Error>> = Mutex::new(None);

/// Decides how messages look, once and before the first of them.
pub(crate) fn set_up(color: Color, verbosity: Verbosity) {
    let color = match color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => moves_cursor() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty()),
    };
    let _ = STYLE.set(Style { color, verbosity });
}

/// From now on messages are added to a file, too; why not, in words.
pub(crate) fn log_to(path: &Path) -> Result<(), String> {
    let file = File::options().append(true).create(true).open(path);
    let file = file.map_err(|error| format!("cannot write `{}`: {error}", path.display()))?;
    *LOG.lock().unwrap_or_else(PoisonError::into_inner) = Some(file);
    Ok(())
}

/// Adds to the log, if there is one; a message that cannot be written is lost and nothing else.
fn log(text: &str) {
    if let Some(file) = LOG.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
        let _ = file.write_all(plain(text).as_bytes());
    }
}

/// A text without the codes of colours.
fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut parts = text.split("\u{1b}[");
    out.extend(parts.next());
    for part in parts {
        out.push_str(part.split_once('m').map_or("", |(_, rest)| rest));
    }
    out
}

fn style() -> Style {
    if host().is_some() {
        return Style { color: false, verbosity: Verbosity::Quiet };
    }
    let plain = Style { color: false, verbosity: Verbosity::Normal };
    STYLE.get().copied().unwrap_or(plain)
}

/// Whether messages have colours.
pub(crate) fn color() -> bool {
    style().color
}

/// How much is told.
pub(crate) fn verbosity() -> Verbosity {
    style().verbosity
}

/// Whether messages go to a terminal that can overwrite a line.
pub(crate) fn moves_cursor() -> bool {
    host().is_none()
        && io::stderr().is_terminal()
        && std::env::var_os("TERM").is_none_or(|term| term != "dumb")
}

/// A user's text without codes that a terminal would obey.
pub(crate) fn printable(text: &str) -> String {
    let obeyed = |c: char| c.is_control() && c != '\n' && c != '\t';
    text.chars().map(|c| if obeyed(c) { '\u{fffd}' } else { c }).collect()
}

/// Whether another process says what there is to say.
#[cfg(feature = "petsc")]
static SILENT: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

/// From now on nothing is said or logged: of many processes that find the same, one tells it.
#[cfg(feature = "petsc")]
pub(crate) fn fall_silent() {
    SILENT.store(true, std::sync::atomic::Ordering::Relaxed);
}

fn is_silent() -> bool {
    #[cfg(feature = "petsc")]
    return SILENT.load(std::sync::atomic::Ordering::Relaxed);
    #[cfg(not(feature = "petsc"))]
    false
}

/// Writes to stderr, as it is.
pub(crate) fn say(text: &str) {
    if is_silent() {
        return;
    }
    if let Some(captured) = kept().as_mut() {
        captured.messages.push_str(text);
        return;
    }
    log(text);
    let _ = io::stderr().lock().write_all(text.as_bytes());
}

/// Says what is wrong with a command line.
pub(crate) fn usage(error: &clap::Error) {
    if host().is_some() {
        say(&error.render().to_string());
        find(|| json!({ "severity": "error", "message": error.render().to_string(), "helps": [] }));
        return;
    }
    let _ = error.print();
}

/// A line that is no warning; silent with `--quiet`.
pub(crate) fn tell(line: &str) {
    let line = format!("{line}\n");
    if verbosity() > Verbosity::Quiet {
        say(&line);
    } else if !is_silent() {
        log(&line);
    }
}

/// What the user may want to know of what was done; silent with `--quiet`.
pub(crate) fn note(message: &str) {
    tell(&format!("note: {message}"));
}

/// Data for the standard output.
pub(crate) fn out(text: &str) {
    if let Some(captured) = kept().as_mut() {
        captured.data.push_str(text);
        return;
    }
    keep(io::stdout().lock().write_all(text.as_bytes()));
}

/// Remembers the first failure to write data.
fn keep(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != io::ErrorKind::BrokenPipe
    {
        LOST.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}

/// Writes what is left of the data; why they are not whole, if they are not.
pub(crate) fn finish() -> Result<(), io::Error> {
    keep(io::stdout().lock().flush());
    LOST.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_do_not_reach_the_log() {
        assert_eq!(plain("a \u{1b}[1m\u{1b}[31mb\u{1b}[0m c\n"), "a b c\n");
        assert_eq!(plain("plain"), "plain");
    }
}
