//! What a scene says of bonds that break: `[[crack]]`, `[fracture]`, `[[track]]`.

use piola_grammar::Span;
use piola_mechanics::fracture::crack::Crack;
use piola_mechanics::words::Words;
use piola_solvers::singular::Singular;
use piola_solvers::steps::Loose;

use super::Located;

/// Which bonds a crack cuts.
#[derive(Clone, Debug, PartialEq)]
pub enum CrackShape {
    /// Those that cross it.
    Across(Crack),
    /// Those between points of two sets, by indices into [`super::Scene::sets`].
    Between([Located<usize>; 2]),
}

/// One `[[crack]]`: bonds that are cut from the start.
#[derive(Clone, Debug)]
pub struct CrackEntry {
    /// Where it is.
    pub shape: CrackShape,
    /// Whether points at it are damaged; else the bonds that it cuts were never there.
    pub damaged: bool,
    /// Where it stands.
    pub span: Span,
}

impl PartialEq for CrackEntry {
    fn eq(&self, other: &CrackEntry) -> bool {
        let CrackEntry { shape, damaged, span: _ } = self;
        *shape == other.shape && *damaged == other.damaged
    }
}

/// One `[[track]]`: a crack whose tip is followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Its name.
    pub name: Located<String>,
    /// Which way the crack runs.
    pub axis: TrackAxis,
    /// Points of at least this damage are of the crack.
    pub threshold: f64,
    /// Index into [`super::Scene::sets`]: only its points count; all where there is none.
    pub set: Option<Located<usize>>,
    /// How long the front of the crack is across the body in m, where the scene says it.
    pub thickness: Option<f64>,
}

/// Which way a crack runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackAxis {
    /// Towards larger X.
    X,
    /// Towards larger Y.
    Y,
    /// Towards larger Z.
    Z,
    /// Towards smaller X.
    MinusX,
    /// Towards smaller Y.
    MinusY,
    /// Towards smaller Z.
    MinusZ,
}

impl TrackAxis {
    /// The number of the axis, from 0, and the sign of the way along it.
    pub fn number_and_sign(self) -> (usize, f64) {
        match self {
            TrackAxis::X => (0, 1.0),
            TrackAxis::Y => (1, 1.0),
            TrackAxis::Z => (2, 1.0),
            TrackAxis::MinusX => (0, -1.0),
            TrackAxis::MinusY => (1, -1.0),
            TrackAxis::MinusZ => (2, -1.0),
        }
    }
}

impl Words for TrackAxis {
    const WORDS: &'static [(&'static str, TrackAxis)] = &[
        ("X", TrackAxis::X),
        ("Y", TrackAxis::Y),
        ("Z", TrackAxis::Z),
        ("-X", TrackAxis::MinusX),
        ("-Y", TrackAxis::MinusY),
        ("-Z", TrackAxis::MinusZ),
    ];
}

/// `[fracture]`: what holds whatever its potential says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FractureSettings {
    /// Indices into [`super::Scene::sets`]: bonds with a point of one of them never break.
    pub unbreakable: Vec<Located<usize>>,
    /// Of load steps: what becomes of parts that hang on nothing.
    pub loose: Loose,
    /// What becomes of the run where families become too small.
    pub singular: Singular,
}
