//! What is known of an expression while it is checked.

use super::dimension::Dimension;
use crate::expression::NodeId;

/// What a value measures, as far as that is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Quantity {
    /// Fits anything: a literal 0, or anything in a file without units.
    Any,
    /// A quantity of this dimension.
    Known(Dimension),
}

impl Quantity {
    pub(crate) const NUMBER: Quantity = Quantity::Known(Dimension::NONE);

    /// The common dimension of two sides; `None` if they differ.
    pub(crate) fn unify(self, other: Quantity) -> Option<Quantity> {
        match (self, other) {
            (Quantity::Any, known) | (known, Quantity::Any) => Some(known),
            (x, y) if x == y => Some(x),
            _ => None,
        }
    }

    /// Of a product or quotient.
    pub(crate) fn combine(
        self,
        other: Quantity,
        f: impl Fn(Dimension, Dimension) -> Dimension,
    ) -> Quantity {
        match (self, other) {
            (Quantity::Known(x), Quantity::Known(y)) => Quantity::Known(f(x, y)),
            _ => Quantity::Any,
        }
    }

    /// The dimension if it is known and not a pure number.
    pub(crate) fn with_unit(self) -> Option<Dimension> {
        match self {
            Quantity::Known(d) if !d.is_none() => Some(d),
            _ => None,
        }
    }

    /// In words.
    pub(crate) fn describe(self) -> String {
        match self {
            Quantity::Any => "a number".to_string(),
            Quantity::Known(d) => d.describe(),
        }
    }
}

/// The bit of [`Value::uses`] for the deformation gradient; the measures have those below.
pub(crate) const GRADIENT: u8 = 1 << 3;

/// The same for integrals over families.
pub(crate) const INTEGRAL: u8 = 1 << 4;

/// The bit for values that are stated in a unit, among conditions, whose parameters are not in SI units.
pub(crate) const IN_UNIT: u8 = 1 << 5;

/// The bit for parts of triangles and tetrahedra.
pub(crate) const PART: u8 = 1 << 6;

/// The bit for how fast lengths of bonds change.
pub(crate) const RATE: u8 = 1 << 7;

/// Which of the tensors of a file a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct TensorId(pub(crate) u32);

/// A component of a tensor; `None` where the unit tensor makes it 0, whatever the deformation.
pub(super) type Component = Option<NodeId>;

/// The components of a tensor, row by row.
pub(super) type Components = Vec<Component>;

/// A number, a truth value, a tensor or a function of the right stretch tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Kind {
    Number(Quantity),
    Truth,
    Tensor(TensorId, Quantity),
    /// Its node is what it makes of a principal stretch.
    OfStretch(Quantity),
}

/// An elaborated expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Value {
    /// Its node in the graph under construction; of a tensor only its components count.
    pub(crate) node: NodeId,
    /// What it is.
    pub(crate) kind: Kind,
    /// Which measures it depends on, a bit per measure, and whether on [`GRADIENT`], [`INTEGRAL`],
    /// [`PART`] or [`RATE`].
    pub(crate) uses: u8,
    /// Its bits, if it is a number known before any parameter has a value.
    pub(crate) constant: Option<u64>,
}

impl Value {
    /// Whether it is a tensor.
    pub(crate) fn is_tensor(&self) -> bool {
        matches!(self.kind, Kind::Tensor(..) | Kind::OfStretch(_))
    }

    /// Whether it is a function of the right stretch tensor.
    pub(crate) fn is_of_stretch(&self) -> bool {
        matches!(self.kind, Kind::OfStretch(_))
    }
}

/// A value known before any parameter is: built from numbers, `d` and `pi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Constant {
    Number(f64),
    Truth(bool),
}
