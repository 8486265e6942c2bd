//! What a run or a study is doing: a bar or a line on a terminal, lines in a pipe.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use piola_grammar::counted;
use piola_runtime::solve::newton::{NewtonError, NewtonFailure};
use piola_runtime::solve::steps::StepRecord;
use piola_runtime::solve::{Event, Observer};

use crate::console::{self, Verbosity};
use crate::embedded::Host;
use crate::interrupt::Interrupt;

/// Silence in a pipe before a line says what is going on; twice as long after each such line.
const FIRST_SILENCE: Duration = Duration::from_secs(1);
const LONGEST_SILENCE: Duration = Duration::from_secs(60);

/// How often products change the bar.
const REFRESH: Duration = Duration::from_millis(100);

/// The observer of a run.
pub(crate) struct Progress {
    /// The last `t` of the scene.
    end: f64,
    interrupt: Interrupt,
    /// Who has this program inside.
    host: Option<Arc<Host>>,
    bar: Option<ProgressBar>,
    now: Mutex<Now>,
    /// Products since the last iteration.
    products: AtomicUsize,
    start: Instant,
    over: AtomicBool,
}

/// The present state of a run.
struct Now {
    doing: &'static str,
    /// The time of the attempt, with its iterations and the last residual over the reaction.
    t: Option<f64>,
    newton: Option<(usize, f64)>,
    /// How far a body in motion is.
    moved: Option<Moved>,
    /// When something was last shown.
    shown: Instant,
}

/// The steps that a body in motion has made, and all; when the first of them was seen, and which
/// that was: its pace is that since then.
#[derive(Clone, Copy)]
struct Moved {
    step: usize,
    n_steps: usize,
    since: Instant,
    from: usize,
}

impl Moved {
    /// `step 120 of 3000, 214 steps per second, 13 s left`.
    fn line(&self) -> String {
        let Moved { step, n_steps, since, from } = *self;
        let line = format!("step {step} of {n_steps}");
        let pace = (step - from) as f64 / since.elapsed().as_secs_f64();
        if step == from || !pace.is_finite() {
            return line;
        }
        let left = Duration::try_from_secs_f64(((n_steps - step) as f64 / pace).ceil());
        let left = left.map_or_else(|_| String::new(), |left| format!(", {} left", clock(left)));
        format!("{line}, {pace:.3e} steps per second{left}")
    }
}

/// `42 s`, `3 min 20 s`, `5 h 2 min`.
fn clock(time: Duration) -> String {
    match time.as_secs() {
        s @ ..60 => format!("{s} s"),
        s @ ..3600 => format!("{} min {} s", s / 60, s % 60),
        s => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

impl Progress {
    /// Nothing is shown yet; [`Progress::show`] begins.
    pub(crate) fn new(end: f64, interrupt: Interrupt) -> Progress {
        let shows_bar = console::moves_cursor() && console::verbosity() > Verbosity::Quiet;
        let bar = shows_bar.then(|| {
            let bar = ProgressBar::new(1000);
            let template = "{bar:24} {percent:>3} %  {elapsed}  {msg}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style);
            }
            bar.enable_steady_tick(REFRESH);
            bar
        });
        let start = Instant::now();
        let now = Now { doing: "start", t: None, newton: None, moved: None, shown: start };
        Progress {
            end,
            interrupt,
            host: console::host(),
            bar,
            now: Mutex::new(now),
            products: AtomicUsize::new(0),
            start,
            over: AtomicBool::new(false),
        }
    }

    /// Breaks the silence of long steps in a pipe, until the guard is dropped.
    pub(crate) fn show(self: &Arc<Self>) -> Shown {
        let silent = self.bar.is_some() || console::verbosity() == Verbosity::Quiet;
        let progress = Arc::clone(self);
        let speak = move || {
            let mut silence = FIRST_SILENCE;
            while !progress.over.load(Ordering::Relaxed) {
                std::thread::park_timeout(silence / 4);
                let mut now = progress.now();
                if now.shown.elapsed() >= silence {
                    now.shown = Instant::now();
                    let seconds = progress.start.elapsed().as_secs();
                    console::tell(&format!("{seconds} s: {}", progress.line(&now)));
                    silence = (2 * silence).min(LONGEST_SILENCE);
                }
            }
        };
        // Without a thread to be had the lines are missing, and nothing else.
        let speaker = if silent { None } else { std::thread::Builder::new().spawn(speak).ok() };
        Shown { progress: Arc::clone(self), speaker }
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is going on.
    fn line(&self, now: &Now) -> String {
        let Some(t) = now.t else { return now.doing.to_string() };
        if let Some(moved) = &now.moved {
            return format!("t = {t:.4e} s: {}", moved.line());
        }
        let mut line = format!("t = {t:.6}:");
        if let Some((iterations, over_reaction)) = now.newton {
            line += &format!(" iteration {iterations}, residual/reaction {over_reaction:.1e}");
        }
        match self.products.load(Ordering::Relaxed) {
            0 => {}
            products => line += &format!(", {products} products"),
        }
        line
    }

    fn tell_host(&self, part: f64) {
        if let Some(host) = &self.host {
            host.moved(part.clamp(0.0, 1.0));
        }
    }

    /// A line that stays.
    fn tell(&self, now: &mut Now, line: &str) {
        now.shown = Instant::now();
        match &self.bar {
            Some(bar) => bar.suspend(|| console::tell(line)),
            None => console::tell(line),
        }
    }

    fn refresh(&self, now: &mut Now) {
        if let Some(bar) = &self.bar {
            now.shown = Instant::now();
            bar.set_message(self.line(now));
        }
    }

    fn residual(&self, now: &mut Now, iterations: usize, over_reaction: f64) {
        now.newton = Some((iterations, over_reaction));
        if console::verbosity() == Verbosity::Verbose {
            let line = self.line(now);
            self.tell(now, &line);
        }
        self.products.store(0, Ordering::Relaxed);
        self.refresh(now);
    }

    /// A body that moves: the bar goes on; lines come where it would be silent.
    fn moved(&self, now: &mut Now, t: f64, step: usize, n_steps: usize) {
        let (since, from) = match now.moved {
            Some(before) => (before.since, before.from),
            None => (Instant::now(), step),
        };
        (now.t, now.moved) = (Some(t), Some(Moved { step, n_steps, since, from }));
        let Some(bar) = self.bar.as_ref().filter(|_| now.shown.elapsed() >= REFRESH) else {
            return;
        };
        bar.set_position((1000.0 * step as f64 / n_steps as f64) as u64);
        self.refresh(now);
    }

    fn step(&self, now: &mut Now, record: &StepRecord) {
        let ratio = record.residual_over_reaction.last().copied().unwrap_or(0.0);
        let stable = match record.definiteness.positive_definite {
            Some(false) => ", NOT STABLE",
            _ => "",
        };
        let line = format!(
            "t = {:.6}: {}, residual/reaction {ratio:.1e}{stable}",
            record.t,
            counted(record.iterations, "iteration")
        );
        match &self.bar {
            Some(bar) => {
                bar.set_position((1000.0 * record.t / self.end) as u64);
                bar.set_message(line);
            }
            None => self.tell(now, &line),
        }
    }
}

impl Observer for Progress {
    fn notice(&self, event: Event<'_>) {
        if let Event::Product = event {
            self.products.fetch_add(1, Ordering::Relaxed);
            if self.bar.is_none() {
                return;
            }
        }
        let now = &mut *self.now();
        match event {
            Event::Phase(doing) => {
                (now.doing, now.t, now.newton, now.moved) = (doing, None, None, None);
                self.refresh(now);
            }
            Event::Attempt(t) => {
                (now.t, now.newton) = (Some(t), None);
                self.products.store(0, Ordering::Relaxed);
                self.refresh(now);
            }
            Event::Start => self.products.store(0, Ordering::Relaxed),
            Event::Residual { iterations, over_reaction } => {
                self.residual(now, iterations, over_reaction);
            }
            Event::Product if now.shown.elapsed() >= REFRESH => self.refresh(now),
            Event::Product | Event::Stores(_) => {}
            Event::CutBack { t, cause } => {
                let why = reason(cause);
                let line = format!("t = {t:.6}: {why}; half the increment is tried");
                self.tell(now, &line);
            }
            Event::Step(record) => {
                self.tell_host(record.t / self.end);
                self.step(now, record);
            }
            Event::Moved { t, step, n_steps } => {
                self.tell_host(step as f64 / n_steps as f64);
                self.moved(now, t, step, n_steps);
            }
        }
    }

    fn wants_end(&self) -> bool {
        self.interrupt.signal().is_some()
    }
}

/// Why a step was cut back. Points have other numbers inside, so that none is named.
fn reason(cause: &NewtonError) -> String {
    match &cause.failure {
        NewtonFailure::NonFinite(found) if found.inverted => {
            "an interaction would turn inside out".to_string()
        }
        NewtonFailure::NonFinite(_) => "an energy is not a finite number".to_string(),
        _ => cause.to_string(),
    }
}

/// Progress is shown as long as this exists.
pub(crate) struct Shown {
    progress: Arc<Progress>,
    speaker: Option<JoinHandle<()>>,
}

impl Drop for Shown {
    fn drop(&mut self) {
        if let Some(bar) = &self.progress.bar {
            bar.finish_and_clear();
        }
        self.progress.over.store(true, Ordering::Relaxed);
        if let Some(speaker) = self.speaker.take() {
            speaker.thread().unpark();
            let _ = speaker.join();
        }
    }
}

/// What a study does: on a terminal in one line, in a pipe a line each.
pub(crate) struct Line {
    bar: ProgressBar,
    plain: bool,
}

impl Line {
    pub(crate) fn new() -> Line {
        let plain = !console::moves_cursor();
        let bar = if plain { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        Line { bar, plain }
    }

    pub(crate) fn say(&self, what: &str) {
        if self.plain {
            console::tell(what);
        } else {
            self.bar.set_message(what.to_string());
            self.bar.tick();
        }
    }

    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_said_as_people_say_them() {
        let said = [7, 200, 18_121].map(|s| clock(Duration::from_secs(s)));
        assert_eq!(said, ["7 s", "3 min 20 s", "5 h 2 min"]);
    }
}
