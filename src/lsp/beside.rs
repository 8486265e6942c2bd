//! What takes long, beside the thread that answers: lints of large energies, and what energies cost and keep.
//!
//! One more thread looks at the newest of every text. What it finds it tells the editor itself, and only while
//! that text is the one that the editor has: the numbers of texts are locked while a message is sent.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use lsp_server::{Connection, Message};
use piola_compiler::audit::{Settings, audit};
use piola_compiler::verify::UNIT_ROUNDOFF;
use piola_compiler::{Argument, Form, Level, check_text_with};
use piola_runtime::element::cost;
use piola_runtime::scene::files_below;

use super::text::Document;
use super::{findings, told};

/// How long an answer waits for what energies cost and keep; who asks again has it.
const PATIENCE: Duration = Duration::from_millis(400);

/// What is wanted of a text, and the number of the text.
enum Task {
    Lints(Document, u64),
    Measures(Document, u64),
}

/// What both threads know; texts by their places.
#[derive(Default)]
struct State {
    /// Of the texts that the editor has their numbers. They never come again: editors begin to count anew where
    /// they open a text anew.
    current: BTreeMap<String, u64>,
    last: u64,
    lints: BTreeMap<String, Document>,
    measures: BTreeMap<String, Document>,
    /// What energies of the texts as they are cost and keep.
    measured: BTreeMap<String, String>,
    ends: bool,
}

impl State {
    fn number(&self, document: &Document) -> u64 {
        self.current.get(document.uri.as_str()).copied().unwrap_or_default()
    }
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    wakes: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The other thread.
pub(super) struct Beside {
    shared: Arc<Shared>,
    /// The other thread has it only as long as this one does: who ends does not wait for what is looked for.
    _sender: Arc<dyn Fn(Message) + Send + Sync>,
}

impl Beside {
    pub(super) fn start(connection: &Connection) -> Beside {
        let shared = Arc::<Shared>::default();
        let sender = connection.sender.clone();
        let send: Arc<dyn Fn(Message) + Send + Sync> = Arc::new(move |message| {
            // An editor that is gone hears nothing.
            let _ = sender.send(message);
        });
        let (own, weak) = (Arc::clone(&shared), Arc::downgrade(&send));
        let tell = move |message| {
            if let Some(send) = weak.upgrade() {
                send(message);
            }
        };
        std::thread::spawn(move || work(&own, &tell));
        Beside { shared, _sender: send }
    }

    /// The editor has another text at a place, or, where it `is_open` no more, none.
    pub(super) fn changed(&self, uri: &str, is_open: bool) {
        let mut state = self.shared.lock();
        state.lints.remove(uri);
        state.measures.remove(uri);
        // Others may import this one.
        state.measured.clear();
        state.last += 1;
        let number = state.last;
        match is_open {
            true => state.current.insert(uri.to_string(), number),
            false => state.current.remove(uri),
        };
    }

    /// Looks for lints and tells them.
    pub(super) fn lint(&self, document: &Document) {
        self.shared.lock().lints.insert(document.uri.to_string(), document.clone());
        self.shared.wakes.notify_all();
    }

    /// What the energies of a potential cost and keep, if that is known in time.
    pub(super) fn measured(&self, document: &Document) -> Option<String> {
        let uri = document.uri.as_str();
        let of_this = |state: &State| state.measured.get(uri).cloned();
        let start = Instant::now();
        let mut state = self.shared.lock();
        if of_this(&state).is_none() {
            state.measures.insert(uri.to_string(), document.clone());
            self.shared.wakes.notify_all();
        }
        loop {
            let left = PATIENCE.checked_sub(start.elapsed());
            match (of_this(&state), left) {
                (Some(text), _) => return Some(text),
                (None, None) => return None,
                (None, Some(left)) => {
                    let waited = self.shared.wakes.wait_timeout(state, left);
                    state = waited.unwrap_or_else(PoisonError::into_inner).0;
                }
            }
        }
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.shared.lock().ends = true;
        self.shared.wakes.notify_all();
    }
}

fn work(shared: &Shared, tell: &dyn Fn(Message)) {
    while let Some(task) = next(shared) {
        match task {
            Task::Lints(document, number) => {
                let Ok(message) = caught(|| told(&document, findings::of(&document))) else {
                    continue;
                };
                let state = shared.lock();
                if state.number(&document) == number {
                    tell(message.into());
                }
            }
            Task::Measures(document, number) => {
                let text = caught(|| measure(&document)).ok().flatten().unwrap_or_default();
                let mut state = shared.lock();
                if state.number(&document) == number {
                    state.measured.insert(document.uri.to_string(), text);
                }
                drop(state);
                shared.wakes.notify_all();
            }
        }
    }
}

/// A defect in what is looked for ends that, and not the thread.
fn caught<T>(look: impl FnOnce() -> T) -> std::thread::Result<T> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(look))
}

/// The next that is wanted; nothing at the end.
fn next(shared: &Shared) -> Option<Task> {
    let mut state = shared.lock();
    loop {
        if state.ends {
            return None;
        }
        if let Some((_, document)) = state.lints.pop_first() {
            let number = state.number(&document);
            return Some(Task::Lints(document, number));
        }
        if let Some((uri, document)) = state.measures.pop_first() {
            // Whoever asked again while it was measured has it.
            if state.measured.contains_key(&uri) {
                continue;
            }
            let number = state.number(&document);
            return Some(Task::Measures(document, number));
        }
        state = shared.wakes.wait(state).unwrap_or_else(PoisonError::into_inner);
    }
}

/// A line for every energy: nanoseconds an interaction, and digits.
fn measure(document: &Document) -> Option<String> {
    let (_, model) = check_text_with(&document.text, &files_below(document.folder())).ok()?;
    let dimension = model.dimensions().last()?;
    let mut settings = Vec::new();
    let mut chosen = model.fill_with_one(dimension, &mut settings);
    chosen.extend(model.switch_on(dimension, &mut settings, Some(1.0)));
    let values = model.values(dimension, &settings, Some(1.0)).ok()?;
    let cost = cost::fastest(&model, &values).ok()?;
    let few = Settings { form: Form::Accurate, level: Level::Fast, points: 1, bar: 64.0 };
    let audits = audit(&model, &values, &few).map(|(audits, _)| audits).unwrap_or_default();
    let mut lines: Vec<String> = Vec::new();
    for energy in &cost.energies {
        let [alone, _, all] = energy.nanoseconds;
        let of = |argument| audits.iter().find(|audit| audit.argument == Some(argument));
        let of_square = match energy.argument {
            Argument::Measure(measure) => of(Argument::Square(measure)),
            _ => None,
        };
        let digits = of_square.or_else(|| of(energy.argument)).map(|audit| {
            let [psi, first, second] = audit.worst().map(digits);
            let names =
                if energy.argument == Argument::Gradient { ["P", "dP"] } else { ["psi'", "psi''"] };
            format!(
                "; at least {psi} digits of psi, {first} of {}, {second} of {}",
                names[0], names[1]
            )
        });
        lines.push(format!(
            "psi({}): {alone:.1} ns, {all:.1} ns with both derivatives{}",
            energy.argument.symbol(),
            digits.unwrap_or_default()
        ));
    }
    let with = match chosen.is_empty() {
        true => String::new(),
        false => format!("with {} = 1", chosen.join(" = ")),
    };
    (!lines.is_empty()).then(|| [lines, vec![with]].concat().join("  \n"))
}

/// Digits that an error of so many roundings leaves.
fn digits(error: f64) -> usize {
    if error.is_nan() {
        return 0;
    }
    let mut powers = std::iter::successors(Some(0.1), |power| Some(power / 10.0));
    powers.position(|power| error.max(1.0) * UNIT_ROUNDOFF > power).unwrap_or(0)
}
