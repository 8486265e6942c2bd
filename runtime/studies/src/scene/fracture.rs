//! What a scene says of bonds that break: `[[crack]]`, `[fracture]`.

use piola_grammar::Span;
use piola_mechanics::fracture::crack::Crack;
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

/// `[fracture]`: what holds whatever its potential says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FractureSettings {
    /// Indices into [`super::Scene::sets`]: bonds with a point of one of them never break.
    pub unbreakable: Vec<Located<usize>>,
    /// Of load steps: what becomes of parts that hang on nothing.
    pub loose: Loose,
}
