//! What is known before any parameter has a value: numbers, `d`, `pi`, and conditions on them.

use piola_grammar::ast::{ExprId, ExprKind, UnaryOperator};
use rustc_hash::{FxHashMap, FxHashSet};

use super::elaborate::{Arguments, Elaborator, Meaning, meaning, taken_branch};
use super::symbols::Symbol;
use super::value::Constant;
use crate::expression::number::Number;

impl Elaborator<'_> {
    /// What is known of the parts before any parameter has a value.
    pub(super) fn constants(
        &mut self,
        parts: &[ExprId],
        arguments: Arguments<'_>,
    ) -> FxHashMap<ExprId, Constant> {
        let mut known = FxHashMap::default();
        for &id in parts {
            if let Some(constant) = self.constant_of(id, &known, arguments) {
                known.insert(id, constant);
            }
        }
        known
    }

    fn constant_of(
        &mut self,
        id: ExprId,
        known: &FxHashMap<ExprId, Constant>,
        arguments: Arguments<'_>,
    ) -> Option<Constant> {
        use Constant::{Number as Num, Truth};
        match &self.arena[id].kind {
            ExprKind::Number(x) => Some(Num(*x)),
            ExprKind::Name(name) => {
                if let Some((_, value)) = arguments.iter().find(|(formal, _)| formal.name == *name)
                {
                    return value.constant.map(|bits| Num(f64::from_bits(bits)));
                }
                match self.symbols.get(name)? {
                    Symbol::Dimension => Some(Num(self.dimension as f64)),
                    Symbol::Pi => Some(Num(std::f64::consts::PI)),
                    Symbol::Value(number) => {
                        let value = self.values.get(&number).copied().flatten()?;
                        value.constant.map(|bits| Num(f64::from_bits(bits)))
                    }
                    _ => None,
                }
            }
            ExprKind::Call { .. } | ExprKind::Table { .. } => None,
            ExprKind::Unary { operator, operand } => match (operator, known.get(operand)?) {
                (UnaryOperator::Negate, Num(x)) => Some(Num(-x)),
                (UnaryOperator::Not, Truth(c)) => Some(Truth(!c)),
                _ => None,
            },
            ExprKind::Binary { operator, left, right } => {
                match (known.get(left)?, known.get(right)?, meaning(*operator)) {
                    (Num(x), Num(y), Meaning::Number(o)) => Some(Num(f64::binary(o, *x, *y))),
                    (Num(x), Num(y), Meaning::Comparison(c)) => Some(Truth(c.holds(*x, *y))),
                    (Truth(x), Truth(y), Meaning::And) => Some(Truth(*x && *y)),
                    (Truth(x), Truth(y), Meaning::Or) => Some(Truth(*x || *y)),
                    _ => None,
                }
            }
            ExprKind::If { condition, then, otherwise } => match known.get(condition)? {
                Truth(true) => known.get(then).copied(),
                Truth(false) => known.get(otherwise).copied(),
                Num(_) => None,
            },
        }
    }

    /// The parts that no condition on `d` rules out.
    pub(super) fn active(
        &self,
        parts: &[ExprId],
        constants: &FxHashMap<ExprId, Constant>,
    ) -> FxHashSet<ExprId> {
        let mut active = FxHashSet::default();
        active.extend(parts.last());
        for &id in parts.iter().rev() {
            if !active.contains(&id) {
                continue;
            }
            match taken_branch(&self.arena[id].kind, constants) {
                Some(branch) => active.extend([branch]),
                None => active.extend(self.arena[id].kind.operands()),
            }
        }
        active
    }
}
