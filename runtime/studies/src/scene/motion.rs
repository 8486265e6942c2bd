//! What a scene says of a body that moves: `[motion]`, `[[initial]]`.

use piola_grammar::Span;
use piola_solvers::motion::Method;

use super::{Located, Quantity};

/// `[motion]`: integration in time, in place of load steps.
#[derive(Clone, Debug)]
pub struct Motion {
    /// The rule of integration.
    pub method: Method,
    /// The last t, in s.
    pub end: f64,
    /// The longest step in s; nothing: a part of the critical one.
    pub step: Option<f64>,
    /// That part, where no step is given.
    pub safety: f64,
    /// Mass-proportional damping in 1/s.
    pub damping: f64,
    /// Whether a step beyond the critical one is taken.
    pub unstable: bool,
    /// Where the table stands.
    pub span: Span,
}

impl Default for Motion {
    fn default() -> Self {
        Motion {
            method: Method::default(),
            end: 1.0,
            step: None,
            safety: 0.9,
            damping: 0.0,
            unstable: false,
            span: Span::new(0, 0),
        }
    }
}

impl PartialEq for Motion {
    fn eq(&self, other: &Motion) -> bool {
        let Motion { method, end, step, safety, damping, unstable, span: _ } = self;
        *method == other.method
            && *end == other.end
            && *step == other.step
            && *safety == other.safety
            && *damping == other.damping
            && *unstable == other.unstable
    }
}

/// One `[[initial]]`: where points are and how they move at t = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Initial {
    /// Index into [`super::Scene::sets`], and where the set is named.
    pub set: Located<usize>,
    /// Displacements in m, one entry per dimension.
    pub displacements: Option<Located<Vec<Quantity>>>,
    /// Velocities in m/s, one entry per dimension.
    pub velocities: Option<Located<Vec<Quantity>>>,
}

/// What a `[[prescribe]]` gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Given {
    /// Displacements in m.
    #[default]
    Displacement,
    /// Velocities in m/s.
    Velocity,
    /// Accelerations in m/s^2.
    Acceleration,
}

impl Given {
    /// All of them.
    pub const ALL: [Given; 3] = [Given::Displacement, Given::Velocity, Given::Acceleration];

    /// Its key in a scene file.
    pub fn key(self) -> &'static str {
        match self {
            Given::Displacement => "u",
            Given::Velocity => "v",
            Given::Acceleration => "a",
        }
    }
}
