//! What a motion is told: the rule of integration, the step, what drives the body, where it starts.

use piola_mechanics::words::Words;

use crate::singular::Singular;

/// A rule of integration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Velocity Verlet; damping acts on the mean of the velocities before and after.
    #[default]
    Verlet,
    /// The same positions; velocities are those in the middle of the last step (ganzenmueller2015).
    LeapFrog,
    /// miranda, algorithm 3.2 with (32): the first kick is a whole one, loads are those at the end of
    /// the step, `v_(n+1/2) = (v_(n-1/2) + dt a)/(1 + c dt)`: damping acts on the velocity after, so
    /// that no damping is too much. Velocities are those of the last step.
    Kinematic,
    /// The implicit midpoint rule: stable for any step where forces are linear.
    Midpoint,
}

impl Words for Method {
    const WORDS: &'static [(&'static str, Method)] = &[
        ("verlet", Method::Verlet),
        ("leap-frog", Method::LeapFrog),
        ("kinematic", Method::Kinematic),
        ("midpoint", Method::Midpoint),
    ];
}

impl Method {
    /// The part of the velocity after the kick in what damping acts on.
    pub(super) fn damped_part(self) -> f64 {
        match self {
            Method::Verlet | Method::LeapFrog | Method::Midpoint => 0.5,
            Method::Kinematic => 1.0,
        }
    }
}

/// What drives a body: prescribed displacements, velocities and accelerations, loads, and parameters of its
/// energy, as functions of `t` in s. No degree of freedom is prescribed twice.
pub trait MotionDrive: Sync {
    /// The degrees of freedom with prescribed displacements, ascending; the same for all `t`.
    fn displaced(&self) -> &[usize];

    /// Fills in their displacements at `t`, in m.
    fn displacements(&self, t: f64, values: &mut [f64]);

    /// The degrees of freedom with prescribed velocities, ascending; the same for all `t`.
    fn driven(&self) -> &[usize];

    /// Fills in their velocities at `t`, in m/s.
    fn velocities(&self, t: f64, values: &mut [f64]);

    /// The degrees of freedom with prescribed accelerations, ascending; the same for all `t`.
    fn accelerated(&self) -> &[usize] {
        &[]
    }

    /// Fills in their accelerations at `t`, in m/s^2.
    fn accelerations(&self, _t: f64, _values: &mut [f64]) {}

    /// All degrees of freedom that are prescribed, ascending; those that are so twice stand twice.
    fn fixed(&self) -> Vec<usize> {
        let mut fixed = [self.displaced(), self.driven(), self.accelerated()].concat();
        fixed.sort_unstable();
        fixed
    }

    /// Fills in the loads (`n x d`) at `t`, in N.
    fn loads(&self, t: f64, loads: &mut [f64]);

    /// Whether the loads depend on `t`; if not they are asked for once.
    fn loads_change(&self) -> bool {
        true
    }

    /// Whether parameters of the energy depend on `t`.
    fn parameters_change(&self) -> bool {
        false
    }

    /// Gives those that do their values at `t` in s: the energy is another from then on. Whether they can be
    /// so.
    fn set_parameters(&self, _t: f64) -> bool {
        true
    }
}

/// Choices for a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSettings {
    /// The rule of integration.
    pub method: Method,
    /// The last `t` in s; positive. It is met exactly: the step is `end` over a whole number.
    pub end: f64,
    /// The longest step in s; without it `safety` times the critical one, of the midpoint rule ten times
    /// as long.
    pub step: Option<f64>,
    /// Between 0 and 1.
    pub safety: f64,
    /// Mass-proportional damping `c` in 1/s: the force `-m c v`.
    pub damping: f64,
    /// Whether a step beyond the critical one is taken.
    pub unstable: bool,
    /// Of the midpoint rule: the residual of a step over the forces that accelerate the body.
    pub tolerance: f64,
    /// How many rows of the account there are after the first, spread evenly over the steps.
    pub rows: usize,
    /// Whether rows come at even times whatever the step: then a further step or so may lead to each.
    pub even: bool,
    /// What becomes of the motion where families become too small.
    pub singular: Singular,
}

impl Default for MotionSettings {
    fn default() -> Self {
        MotionSettings {
            method: Method::default(),
            end: 1.0,
            step: None,
            safety: 0.9,
            damping: 0.0,
            unstable: false,
            tolerance: 1e-10,
            rows: 1000,
            even: false,
            singular: Singular::default(),
        }
    }
}

/// Where a body starts; vectors are `n x d`, in the body's order. What is prescribed overrides it.
#[derive(Clone, Debug, PartialEq)]
pub struct Initial {
    /// Displacements in m.
    pub displacements: Vec<f64>,
    /// Velocities in m/s.
    pub velocities: Vec<f64>,
}
