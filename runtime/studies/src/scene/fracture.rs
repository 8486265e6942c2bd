//! What a scene says of bonds that break: `[[crack]]`, `[fracture]`.

use piola_grammar::Span;
use piola_mechanics::fracture::crack::Crack;
use piola_solvers::steps::Loose;

use super::Located;

/// One `[[crack]]`: bonds that are cut from the start.
#[derive(Clone, Debug)]
pub struct CrackEntry {
    /// Where it is.
    pub shape: Crack,
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

/// `[fracture]`: what holds whatever its potential says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FractureSettings {
    /// Indices into [`super::Scene::sets`]: bonds with a point of one of them never break.
    pub unbreakable: Vec<Located<usize>>,
    /// Of load steps: what becomes of parts that hang on nothing.
    pub loose: Loose,
}
