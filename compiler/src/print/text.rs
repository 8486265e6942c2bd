//! Graphs in the piola language; what is printed parses, and means the same.

use super::{Binding, LONGEST_PIECE, Names, Notation, Piece, lines, lines_within, root_names};
use crate::expression::{Comparison, ExprGraph, Function, Input, NodeId, Operator};
use crate::model::Model;
use crate::specialise::ScalarEnergy;

/// psi, psi' and psi'' as lines of text, named parts first.
pub fn text(model: &Model, energy: &ScalarEnergy) -> String {
    let roots: Vec<_> = root_names(energy.measure).into_iter().zip(energy.roots).collect();
    let mut out = String::new();
    for (name, expression) in lines(&energy.graph, &roots, &Text { names: Names { model } }) {
        out.push_str(&format!("{name} = {expression}\n"));
    }
    out
}

/// One expression of a graph, named parts first: `t1 = ..; t1*t1`.
pub fn expression(model: &Model, graph: &ExprGraph, root: NodeId) -> String {
    let notation = Text { names: Names { model } };
    let named = |(name, text): (String, String)| {
        if name.is_empty() { text } else { format!("{name} = {text}") }
    };
    let lines = lines(graph, &[(String::new(), root)], &notation);
    lines.into_iter().map(named).collect::<Vec<_>>().join("; ")
}

/// One expression as messages quote it: parts are written out wherever they stand; only what grows too long for a line
/// has a name, which is explained behind: `t1 - 1, where t1 = ..`.
pub fn quoted(model: &Model, graph: &ExprGraph, root: NodeId) -> String {
    let notation = Text { names: Names { model } };
    let mut lines = lines_within(graph, &[(String::new(), root)], &notation, LONGEST_PIECE);
    let whole = lines.pop().map_or(String::new(), |(_, text)| text);
    let named = lines.into_iter().map(|(name, text)| format!("{name} = {text}"));
    match named.collect::<Vec<_>>().join(", ") {
        none if none.is_empty() => whole,
        parts => format!("{whole}, where {parts}"),
    }
}

pub(super) struct Text<'a> {
    pub(super) names: Names<'a>,
}

impl Text<'_> {
    /// In parentheses if it binds weaker than `least`.
    fn wrap(&self, piece: Piece, least: Binding) -> String {
        if piece.binding < least { format!("({})", piece.text) } else { piece.text }
    }
}

impl Notation for Text<'_> {
    fn number(&self, value: f64) -> Piece {
        let negative = value.is_sign_negative() && !value.is_nan();
        let text = match value.abs() {
            v if v.is_nan() => "(0/0)".to_string(),
            v if v.is_infinite() => "(1/0)".to_string(),
            v if v == 0.0 || (1e-4..1e7).contains(&v) => format!("{v}"),
            v => format!("{v:e}"),
        };
        if negative {
            Piece { text: format!("-{text}"), binding: Binding::Negation }
        } else {
            Piece::atom(text)
        }
    }

    fn input(&self, input: Input) -> Piece {
        match input {
            Input::Change(m) => {
                let text = format!("{}/{} - 1", m.symbol(), m.reference_symbol());
                Piece { text, binding: Binding::Sum }
            }
            other => Piece::atom(self.names.input(other)),
        }
    }

    fn temporary(&self, number: usize) -> Piece {
        Piece::atom(self.names.temporary(number))
    }

    fn unary(&self, function: Function, x: Piece) -> Piece {
        match function {
            Function::Negate => Piece {
                text: format!("-{}", self.wrap(x, Binding::Power)),
                binding: Binding::Negation,
            },
            named => Piece::atom(format!("{}({})", named.name(), x.text)),
        }
    }

    fn power(&self, x: Piece, y: Piece) -> Piece {
        let text = format!("{}^{}", self.wrap(x, Binding::Atom), self.wrap(y, Binding::Negation));
        Piece { text, binding: Binding::Power }
    }

    fn binary(&self, operator: Operator, x: Piece, y: Piece) -> Piece {
        use Binding::{Negation, Power, Product, Sum};
        let (text, binding) = match operator {
            Operator::Add => (format!("{} + {}", self.wrap(x, Sum), self.wrap(y, Product)), Sum),
            Operator::Subtract => {
                (format!("{} - {}", self.wrap(x, Sum), self.wrap(y, Product)), Sum)
            }
            Operator::Multiply => {
                (format!("{}*{}", self.wrap(x, Product), self.wrap(y, Negation)), Product)
            }
            Operator::Divide => {
                (format!("{}/{}", self.wrap(x, Product), self.wrap(y, Power)), Product)
            }
            Operator::Power => return self.power(x, y),
            Operator::Min | Operator::Max | Operator::Atan2 => {
                return Piece::atom(format!("{}({}, {})", operator.name(), x.text, y.text));
            }
        };
        Piece { text, binding }
    }

    fn compare(&self, comparison: Comparison, x: Piece, y: Piece) -> Piece {
        let (x, y) = (self.wrap(x, Binding::Sum), self.wrap(y, Binding::Sum));
        Piece { text: format!("{x} {} {y}", comparison.name()), binding: Binding::Comparison }
    }

    fn and(&self, x: Piece, y: Piece) -> Piece {
        let (x, y) = (self.wrap(x, Binding::And), self.wrap(y, Binding::Not));
        Piece { text: format!("{x} and {y}"), binding: Binding::And }
    }

    fn or(&self, x: Piece, y: Piece) -> Piece {
        let (x, y) = (self.wrap(x, Binding::Or), self.wrap(y, Binding::And));
        Piece { text: format!("{x} or {y}"), binding: Binding::Or }
    }

    fn not(&self, x: Piece) -> Piece {
        Piece { text: format!("not {}", self.wrap(x, Binding::Not)), binding: Binding::Not }
    }

    fn select(&self, c: Piece, x: Piece, y: Piece) -> Piece {
        let text = format!("if {} then {} else {}", c.text, x.text, y.text);
        Piece { text, binding: Binding::Condition }
    }
}
