//! The way of a body from state to state, whatever takes it there.

use std::ops::ControlFlow;

/// The state of a body; vectors are `n x d`, in the body's order.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// The time, or the load parameter.
    pub t: f64,
    /// Displacements in m.
    pub displacements: &'a [f64],
    /// Velocities in m/s; none of a body that goes from equilibrium to equilibrium.
    pub velocities: &'a [f64],
    /// `dE/du` in N; minus the loads they are the reactions of fixed degrees of freedom.
    pub internal_forces: &'a [f64],
    /// Loads in N.
    pub loads: &'a [f64],
}

/// How an advance ended.
pub enum Advance<T> {
    /// In the next state, and what is told of the step.
    Step(T),
    /// On the way to the next state, where a pause was asked for.
    Pause,
    /// There is no next state: this is the end.
    End,
    /// Who looks on wants an end.
    Interrupted,
}

/// A body on its way: load steps by Newton's method are one, a motion in time is another.
pub trait March {
    /// What is told of a step.
    type Step;
    /// Why there is no next state before the end.
    type Stop;

    /// Goes to the next state.
    ///
    /// # Errors
    /// Why it cannot; the state is then the last one that was reached.
    fn advance(&mut self) -> Result<Advance<Self::Step>, Self::Stop>;

    /// The present state.
    fn state(&self) -> State<'_>;
}

/// Goes on to the end, or until `see`, which is shown every step and where it led, or who looks on ends
/// it: then it breaks.
///
/// # Errors
/// As [`March::advance`].
pub fn march<M: March>(
    way: &mut M,
    see: &mut dyn FnMut(&M::Step, &M) -> ControlFlow<()>,
) -> Result<ControlFlow<()>, M::Stop> {
    loop {
        match way.advance()? {
            Advance::Step(step) => {
                if see(&step, way).is_break() {
                    return Ok(ControlFlow::Break(()));
                }
            }
            Advance::Pause => {}
            Advance::End => return Ok(ControlFlow::Continue(())),
            Advance::Interrupted => return Ok(ControlFlow::Break(())),
        }
    }
}
