//! Equality of trees, places left aside.

use crate::ExpressionAst;
use crate::ast::{
    Arena, Ast, Definition, Domain, Energy, ExprId, ExprKind, Ident, Parameter, Statement, Text,
    Unit,
};

/// Whether two files have the same tree: the same statements with the same names, texts, numbers
/// (bit for bit) and expressions in the same order, wherever they stand.
pub fn same_tree(left: &Ast, right: &Ast) -> bool {
    let pair = Pair { left: &left.arena, right: &right.arena };
    left.name.name == right.name.name
        && same_text(&left.title, &right.title)
        && left.statements.len() == right.statements.len()
        && left.statements.iter().zip(&right.statements).all(|(a, b)| pair.statements(a, b))
}

/// Whether two lone expressions have the same tree.
pub fn same_expression(left: &ExpressionAst, right: &ExpressionAst) -> bool {
    Pair { left: &left.arena, right: &right.arena }.expressions(left.root, right.root)
}

/// The arenas two trees live in.
struct Pair<'a> {
    left: &'a Arena,
    right: &'a Arena,
}

impl Pair<'_> {
    fn statements(&self, left: &Statement, right: &Statement) -> bool {
        use Statement as S;
        match (left, right) {
            (S::Source(a), S::Source(b)) => a.text == b.text,
            (S::Import(a, _), S::Import(b, _)) => a.text == b.text,
            (S::Allow(a), S::Allow(b)) => {
                a.code.text == b.code.text && same_text(&a.reason, &b.reason)
            }
            (S::Dimensions(a), S::Dimensions(b)) => {
                a.iter().map(|(d, _)| d).eq(b.iter().map(|(d, _)| d))
            }
            (S::Weights(_), S::Weights(_)) => true,
            (S::Parameter(a), S::Parameter(b)) => self.parameters(a, b),
            (S::Definition(a), S::Definition(b)) => self.definitions(a, b),
            (S::Energy(a), S::Energy(b)) | (S::Dissipation(a), S::Dissipation(b)) => {
                self.energies(a, b)
            }
            (S::Domain(a), S::Domain(b)) => self.domains(a, b),
            (S::Update(a), S::Update(b)) => {
                a.state.name == b.state.name
                    && a.index.as_ref().map(|k| &k.name) == b.index.as_ref().map(|k| &k.name)
                    && self.expressions(a.body, b.body)
            }
            (S::Break(a), S::Break(b)) => {
                self.expressions(a.condition, b.condition) && same_text(&a.reason, &b.reason)
            }
            _ => false,
        }
    }

    fn parameters(&self, a: &Parameter, b: &Parameter) -> bool {
        a.name.name == b.name.name
            && a.is_state == b.is_state
            && a.size.map(|(size, _)| size) == b.size.map(|(size, _)| size)
            && self.all(&a.defaults, &b.defaults)
            && self.optional_units(&a.unit, &b.unit)
            && self.all(&a.constraints, &b.constraints)
            && same_text(&a.description, &b.description)
    }

    fn definitions(&self, a: &Definition, b: &Definition) -> bool {
        a.name.name == b.name.name
            && match (&a.parameters, &b.parameters) {
                (None, None) => true,
                (Some(a), Some(b)) => same_names(a, b),
                _ => false,
            }
            && self.expressions(a.body, b.body)
            && self.optional_units(&a.unit, &b.unit)
    }

    fn optional_units(&self, a: &Option<Unit>, b: &Option<Unit>) -> bool {
        match (a, b) {
            (None, None) => true,
            (Some(a), Some(b)) => self.units(a, b),
            _ => false,
        }
    }

    fn energies(&self, a: &Energy, b: &Energy) -> bool {
        let (left, right) = (a.gathered.iter(), b.gathered.iter());
        a.measure.name == b.measure.name
            && left.map(|name| &name.name).eq(right.map(|name| &name.name))
            && self.expressions(a.body, b.body)
    }

    fn domains(&self, a: &Domain, b: &Domain) -> bool {
        self.expressions(a.quantity, b.quantity)
            && a.lower.inclusive == b.lower.inclusive
            && self.expressions(a.lower.value, b.lower.value)
            && a.upper.inclusive == b.upper.inclusive
            && self.expressions(a.upper.value, b.upper.value)
    }

    fn units(&self, a: &Unit, b: &Unit) -> bool {
        a.factors.len() == b.factors.len()
            && a.factors.iter().zip(&b.factors).all(|(a, b)| {
                a.name.name == b.name.name
                    && a.divided == b.divided
                    && self.optional(a.exponent, b.exponent)
            })
    }

    fn optional(&self, left: Option<ExprId>, right: Option<ExprId>) -> bool {
        match (left, right) {
            (None, None) => true,
            (Some(left), Some(right)) => self.expressions(left, right),
            _ => false,
        }
    }

    fn all(&self, left: &[ExprId], right: &[ExprId]) -> bool {
        let mut pairs = left.iter().zip(right);
        left.len() == right.len() && pairs.all(|(left, right)| self.expressions(*left, *right))
    }

    fn expressions(&self, left: ExprId, right: ExprId) -> bool {
        let mut open = vec![(left, right)];
        while let Some((left, right)) = open.pop() {
            if !same_node(&self.left[left].kind, &self.right[right].kind, &mut open) {
                return false;
            }
        }
        true
    }
}

/// Compares two nodes and leaves their children to be compared.
fn same_node(left: &ExprKind, right: &ExprKind, open: &mut Vec<(ExprId, ExprId)>) -> bool {
    use ExprKind as E;
    match (left, right) {
        (E::Number(a), E::Number(b)) => a.to_bits() == b.to_bits(),
        (E::Name(a), E::Name(b)) => a == b,
        (E::Call { function: f, arguments: a }, E::Call { function: g, arguments: b }) => {
            open.extend(a.iter().copied().zip(b.iter().copied()));
            f.name == g.name && a.len() == b.len()
        }
        (E::Table { file: f, argument: a }, E::Table { file: g, argument: b }) => {
            open.push((*a, *b));
            f.text == g.text
        }
        (E::Unary { operator: f, operand: a }, E::Unary { operator: g, operand: b }) => {
            open.push((*a, *b));
            f == g
        }
        (
            E::Binary { operator: f, left: a, right: b },
            E::Binary { operator: g, left: c, right: d },
        ) => {
            open.extend([(*a, *c), (*b, *d)]);
            f == g
        }
        (
            E::If { condition: a, then: b, otherwise: c },
            E::If { condition: d, then: e, otherwise: f },
        ) => {
            open.extend([(*a, *d), (*b, *e), (*c, *f)]);
            true
        }
        _ => false,
    }
}

fn same_text(left: &Option<Text>, right: &Option<Text>) -> bool {
    left.as_ref().map(|text| &text.text) == right.as_ref().map(|text| &text.text)
}

fn same_names(left: &[Ident], right: &[Ident]) -> bool {
    left.iter().map(|ident| &ident.name).eq(right.iter().map(|ident| &ident.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse;

    #[test]
    fn places_do_not_count_and_all_else_does() {
        let base = "potential p \"t\"\nparameter C = 1 in N/m^2, C > 0 \"c\"\nS(x) = -x\n\
                    psi(l) = if C > 1 then C*S(l) else 2\ndomain l in (0, 1]\nallow \"x\" \"y\"";
        let ast = parse(base).unwrap();
        let respaced =
            base.replace(' ', "  ").replace("(l)", "((l))").replace("psi((l))", "psi(l)");
        assert!(same_tree(&ast, &parse(&respaced).unwrap()));
        for (old, new) in [
            ("potential p", "potential q"),
            ("\"t\"", "\"u\""),
            ("= 1 in", "= 2 in"),
            ("N/m", "N*m"),
            ("^2", "^3"),
            ("C > 0", "C >= 0"),
            ("C = 1", "C(2) = 1"),
            ("C = 1", "C = (1, 2)"),
            ("\"c\"", ""),
            ("S(x) = -x", "S(x) = x"),
            ("S(x) = -x", "S(y) = -x"),
            ("psi(l)", "psi(a)"),
            ("C*S(l)", "C/S(l)"),
            ("S(l)", "S(l, l)"),
            ("else 2", "else l"),
            ("(0, 1]", "[0, 1]"),
            ("\"x\"", "\"z\""),
            ("\"y\"", "\"z\""),
            (" \"y\"", ""),
            ("\nS(x) = -x", ""),
        ] {
            let other = base.replacen(old, new, 1);
            assert_ne!(other, base);
            assert!(!same_tree(&ast, &parse(&other).unwrap()), "{old} -> {new}");
        }
    }
}
