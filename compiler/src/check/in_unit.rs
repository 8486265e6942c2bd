//! Units as files state them, and values in them.

use piola_grammar::ast::{ExprId, Unit, UnitFactor};
use piola_grammar::{Diagnostic, Span, suggest};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::unit::{UnitValue, base_units, named_unit, prefixes, unit_names};
use super::value::{IN_UNIT, Kind, Quantity, Value};
use crate::expression::{Node, Operator};

impl Elaborator<'_> {
    /// The value of `k = .. in UNIT`: the pure number on the right, in SI units.
    pub(super) fn in_unit(&mut self, value: Value, at: ExprId, unit: &Unit) -> Option<Value> {
        let quantity = self.number(value, at)?;
        let UnitValue { dimension, scale } = self.unit(unit)?;
        if let Some(own) = quantity.with_unit() {
            let message = format!("this is {own} already: it cannot be stated in another unit");
            let error = Diagnostic::error("dimension-mismatch", self.arena[at].span, message);
            self.report(
                error
                    .label("this has a unit")
                    .note(unit.span, "and is stated in this one")
                    .help("leave out the unit behind `in`, or make it a pure number"),
            );
            return None;
        }
        let quantity = if self.checked { Quantity::Known(dimension) } else { Quantity::Any };
        let span = self.arena[at].span;
        let node = match value.constant {
            Some(bits) => Node::number(f64::from_bits(bits) * scale),
            None => {
                let scale = self.make(Node::number(scale), value.kind, 0, span)?;
                Node::Binary(Operator::Multiply, value.node, scale.node)
            }
        };
        let uses = value.uses | if self.checked { 0 } else { IN_UNIT };
        self.make(node, Kind::Number(quantity), uses, span)
    }

    /// What a unit means; `None` if some of it is not understood, which is reported.
    pub(crate) fn unit(&mut self, unit: &Unit) -> Option<UnitValue> {
        let mut product = Some(UnitValue { dimension: Dimension::NONE, scale: 1.0 });
        for factor in &unit.factors {
            let power = self.unit_factor(factor);
            product = product.zip(power).map(|(x, y)| UnitValue {
                dimension: x.dimension.times(y.dimension),
                scale: x.scale * y.scale,
            });
        }
        let product = product?;
        if product.scale.is_normal() {
            return Some(product);
        }
        let message = format!("this unit is {} SI units: too much to count in", product.scale);
        self.report(Diagnostic::error("unknown-unit", unit.span, message));
        None
    }

    fn unit_factor(&mut self, factor: &UnitFactor) -> Option<UnitValue> {
        let name = &factor.name;
        let Some(base) = named_unit(&name.name) else {
            let error = unknown_unit(&name.name, name.span);
            self.report(error);
            return None;
        };
        let exponent = match factor.exponent {
            Some(exponent) => self.constant(exponent)?,
            None => 1.0,
        };
        let exponent = if factor.divided { -exponent } else { exponent };
        let Some(dimension) = base.dimension.power(exponent) else {
            let message = format!("{} to the power {exponent} has no sensible unit", name.name);
            self.report(Diagnostic::error("unknown-unit", name.span, message));
            return None;
        };
        Some(UnitValue { dimension, scale: libm::pow(base.scale, exponent) })
    }
}

/// The unit after the number in "200 GPa", or why it is none.
pub(crate) fn unknown_unit(name: &str, span: Span) -> Diagnostic {
    let error = Diagnostic::error("unknown-unit", span, format!("unknown unit `{name}`"))
        .label("not a unit");
    error.help(help_of(name))
}

/// What may be meant by a unit that is not understood, of the first of its names that is none.
pub(crate) fn unit_help(unit: &str) -> String {
    let mut names =
        unit.split(|c: char| !c.is_alphabetic() && c != '\'').filter(|name| !name.is_empty());
    help_of(names.find(|name| named_unit(name).is_none()).unwrap_or(unit))
}

fn help_of(name: &str) -> String {
    if let Some((first, second)) = product_of_units(name) {
        return format!("a product is written with `*`: `{first}*{second}`");
    }
    match suggest(name, unit_names()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!(
            "units are products of powers of {}, each with a prefix out of {}",
            base_units().join(", "),
            prefixes().join(" ")
        ),
    }
}

/// The two units that a name such as `Nm` runs together.
fn product_of_units(name: &str) -> Option<(&str, &str)> {
    let cuts = name.char_indices().skip(1).map(|(at, _)| name.split_at(at));
    let mut products =
        cuts.filter(|(first, second)| named_unit(first).is_some() && named_unit(second).is_some());
    products.next()
}
