//! Invariants of the deformation by their names, written out in tensors.

use piola_grammar::Span;
use piola_grammar::ast::{Arena, BinaryOperator, ExprId, ExprKind, Ident};

/// The words with which they are written; a file that gives one of them another meaning knows no invariants.
pub(super) const WORDS: [&str; 3] = ["C", "J", "tr"];

/// Whether a name is that of an invariant of the right Cauchy-Green tensor.
pub(super) fn is_of_strain(name: &str) -> bool {
    matches!(name, "I1" | "I2" | "I3")
}

/// Whether a name is that of an invariant of this tensor and a direction.
pub(super) fn is_of_fibre(name: &str) -> bool {
    matches!(name, "I4" | "I5")
}

/// `I1 = tr(C)`, `I2 = (tr(C)^2 - C : C)/2`, `I3 = J^2`; nothing of another name. All but the outermost part is
/// added to the arena.
pub(super) fn of_strain(arena: &mut Arena, name: &str, span: Span) -> Option<ExprKind> {
    let mut writer = Writer { arena, span };
    match name {
        "I1" => Some(writer.trace()),
        "I2" => {
            let (trace, two) = (writer.trace(), ExprKind::Number(2.0));
            let square = writer.join(BinaryOperator::Power, trace, two.clone());
            let contraction = writer.join(BinaryOperator::Contract, word("C"), word("C"));
            let difference = writer.join(BinaryOperator::Subtract, square, contraction);
            Some(writer.join(BinaryOperator::Divide, difference, two))
        }
        "I3" => Some(writer.join(BinaryOperator::Power, word("J"), ExprKind::Number(2.0))),
        _ => None,
    }
}

/// `I4(n) = n*C*n`, or `I5(n) = n*C*C*n`, likewise.
pub(super) fn of_fibre(arena: &mut Arena, name: &str, n: ExprId, span: Span) -> ExprKind {
    let product =
        |left, right| ExprKind::Binary { operator: BinaryOperator::Multiply, left, right };
    let c = arena.push(word("C"), span);
    let mut left = arena.push(product(n, c), span);
    if name == "I5" {
        left = arena.push(product(left, c), span);
    }
    product(left, n)
}

fn word(name: &str) -> ExprKind {
    ExprKind::Name(name.into())
}

/// Adds expressions of one place.
struct Writer<'a> {
    arena: &'a mut Arena,
    span: Span,
}

impl Writer<'_> {
    fn trace(&mut self) -> ExprKind {
        let function = Ident { name: "tr".into(), span: self.span };
        let c = self.arena.push(word("C"), self.span);
        ExprKind::Call { function, arguments: vec![c] }
    }

    fn join(&mut self, operator: BinaryOperator, left: ExprKind, right: ExprKind) -> ExprKind {
        let left = self.arena.push(left, self.span);
        let right = self.arena.push(right, self.span);
        ExprKind::Binary { operator, left, right }
    }
}
