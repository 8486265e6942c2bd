//! Where Newton's method starts in a load step.

use piola_mechanics::words::Words;

use super::LoadSteps;
use crate::linear::LinearReport;

/// Where Newton's method starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// Where the tangent of the last equilibrium puts the free points under the new prescribed values
    /// and loads.
    #[default]
    Tangent,
    /// Free points continue on the line through the last two equilibria; the first step starts at
    /// rest.
    Extrapolate,
    /// Free points keep their last displacements, the fixed ones jump to their new values.
    Last,
}

impl Words for Start {
    const WORDS: &'static [(&'static str, Start)] =
        &[("tangent", Start::Tangent), ("extrapolate", Start::Extrapolate), ("last", Start::Last)];
}

/// Displacements to start from, `n x d` in m, and the linear system that led there, if one did.
pub(super) type Guess = (Vec<f64>, Option<LinearReport>);

impl LoadSteps<'_> {
    /// A start that should be closer to the equilibrium at `t` than `last`, the last state with the
    /// fixed displacements of `t`; `None` where none is wanted or none is known.
    pub(super) fn guess(&mut self, last: &[f64], loads: &[f64], t: f64) -> Option<Guess> {
        match self.settings.start {
            Start::Tangent => self.by_tangent(last, loads),
            Start::Extrapolate => self.by_line(last, t).map(|u| (u, None)),
            Start::Last => None,
        }
    }

    /// The equilibrium of the body linearised at the last state. Where that tangent cannot be had or
    /// solved with there is none, and Newton's method says why, if it fails, too.
    fn by_tangent(&mut self, last: &[f64], loads: &[f64]) -> Option<Guess> {
        let jump: Vec<f64> = last.iter().zip(&self.u).map(|(new, old)| new - old).collect();
        let (answer, report) = self.newton.response(&self.u, &jump, loads).ok()?;
        Some((last.iter().zip(&answer).map(|(u, du)| u + du).collect(), Some(report)))
    }

    /// Free displacements on the line through the last two states, where there are two.
    pub(super) fn by_line(&self, last: &[f64], t: f64) -> Option<Vec<f64>> {
        let (t_before, before) = self.before.as_ref()?;
        let factor = (t - self.t) / (self.t - t_before);
        let mut u = last.to_vec();
        for &dof in self.constraints.free() {
            u[dof] += factor * (self.u[dof] - before[dof]);
        }
        Some(u)
    }
}
