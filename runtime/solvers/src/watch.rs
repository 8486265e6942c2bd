//! Someone who looks on while equilibria are looked for or a body moves, and may end that.

use std::sync::Arc;

use super::linear::Choice;
use super::newton_outcome::NewtonError;
use super::steps::StepRecord;

/// What is going on.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// Work begins that takes its time and has no steps: what it is, in words.
    Phase(&'static str),
    /// An equilibrium is looked for at this `t`.
    Attempt(f64),
    /// Newton's method sets out from a start that is known now.
    Start,
    /// The residual before the first iteration of Newton's method, and after each.
    Residual {
        /// How many iterations were made.
        iterations: usize,
        /// 2-norm of the free residual over the larger of reactions and loads.
        over_reaction: f64,
    },
    /// The tangent was multiplied with a vector, for a linear system.
    Product,
    /// A stored tangent takes over from products: how linear systems are solved from here on, and why.
    Stores(&'a Choice),
    /// No equilibrium was found at `t`; half the increment is tried.
    CutBack {
        /// The time.
        t: f64,
        /// Why.
        cause: &'a NewtonError,
    },
    /// An equilibrium was found.
    Step(&'a StepRecord),
    /// A body that moves has come this far.
    Moved {
        /// The time in s.
        t: f64,
        /// How many steps led there.
        step: usize,
        /// How many lead to the end.
        n_steps: usize,
    },
}

/// Who looks on, from any thread.
pub trait Observer: Send + Sync {
    /// Something happened.
    fn notice(&self, event: Event<'_>);

    /// Whether the search shall end: soon, and with what has converged.
    fn wants_end(&self) -> bool {
        false
    }
}

/// An observer, or none.
#[derive(Clone, Default)]
pub struct Watch(Option<Arc<dyn Observer>>);

impl Watch {
    /// Someone looks on.
    pub fn by(observer: Arc<dyn Observer>) -> Watch {
        Watch(Some(observer))
    }

    /// Passes on what happened.
    pub fn notice(&self, event: Event<'_>) {
        if let Some(observer) = &self.0 {
            observer.notice(event);
        }
    }

    /// Who hears nothing, and may want an end.
    pub fn in_silence(&self) -> Watch {
        Watch(self.0.clone().map(|observer| Arc::new(Silent(observer)) as Arc<dyn Observer>))
    }

    /// Whether the search shall end.
    pub fn wants_end(&self) -> bool {
        self.0.as_ref().is_some_and(|observer| observer.wants_end())
    }
}

/// Passes nothing on.
struct Silent(Arc<dyn Observer>);

impl Observer for Silent {
    fn notice(&self, _: Event<'_>) {}

    fn wants_end(&self) -> bool {
        self.0.wants_end()
    }
}
