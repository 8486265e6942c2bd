//! Integrals over families, and energies of what they gather.

use piola_grammar::ast::{Energy as EnergyAst, ExprId, Ident};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::statement::Builder;
use super::symbols::Symbol;
use super::value::{GRADIENT, INTEGRAL, Kind, PART, Quantity, RATE, Value};
use crate::expression::{Input, Node};
use crate::measure::Measure;
use crate::model::{GatheredEnergy, Integral};

/// Most integrals of a potential.
pub(crate) const MAX_INTEGRALS: usize = 8;

const LENGTH: u8 = 1 << (Measure::Length as u8);

/// What no integrand may hold, and why.
const FOREIGN: [(u8, &str); 6] = [
    (INTEGRAL, "another integral: integrals do not nest"),
    (GRADIENT, "the deformation gradient"),
    (1 << (Measure::Area as u8), "a measure of triangles"),
    (1 << (Measure::Volume as u8), "a measure of tetrahedra"),
    (PART, "a part of a triangle or a tetrahedron, or the vector `xi` of a bond"),
    (RATE, "how fast bonds change"),
];

impl Elaborator<'_> {
    /// `integral(g)`: the sum of `V_j g` over the family of a point.
    pub(super) fn integral(&mut self, value: Value, at: ExprId, span: Span) -> Option<Value> {
        let quantity = self.number(value, at)?;
        if let Some((_, what)) = FOREIGN.iter().find(|(bit, _)| value.uses & bit != 0) {
            let message = format!("an integrand cannot hold {what}");
            self.report(
                Diagnostic::error("wrong-measure", self.arena[at].span, message)
                    .label("summed up over the bonds of a point")
                    .help(
                        "an integrand is a function of `l`, `L`, `delta` and parameters: \
                         `integral(w*L^2)`",
                    ),
            );
            return None;
        }
        let known = self.integrals.iter().position(|(_, root)| *root == value.node);
        let number = known.unwrap_or(self.integrals.len());
        if number >= MAX_INTEGRALS {
            let message = format!("a potential has at most {MAX_INTEGRALS} different integrals");
            self.report(Diagnostic::error("too-large", span, message));
            return None;
        }
        if known.is_none() {
            self.integrals.push((at, value.node));
        }
        let volume = Dimension::of(0, self.dimension as i64, 0, 0);
        let quantity = match quantity {
            Quantity::Known(dimension) => Quantity::Known(dimension.times(volume)),
            Quantity::Any => Quantity::Any,
        };
        let node = Node::Input(Input::Integral(number as u8));
        self.make(node, Kind::Number(quantity), INTEGRAL, span)
    }
}

impl Builder<'_> {
    /// The integrals that the energies of the variant may hold.
    pub(super) fn integrals(&self) -> Vec<Integral> {
        let arena = &self.ast.arena;
        let integral = |&(at, root): &(ExprId, _)| Integral {
            root,
            span: arena[at].span,
            text: print_expression(arena, at),
        };
        self.elaborator.integrals.iter().map(integral).collect()
    }

    /// `psi(l, theta) = ..` or `psi(theta) = ..`.
    pub(super) fn gathered_energy(&mut self, energy: &EnergyAst) {
        let of_bonds = energy.measure.name == "l";
        let first = (!of_bonds).then_some(&energy.measure);
        let names: Vec<&Ident> = first.into_iter().chain(&energy.gathered).collect();
        let mut good = true;
        for name in &names {
            good &= self.is_gathered(name);
        }
        let Some(value) = self.elaborator.expression(energy.body) else { return };
        let Some(quantity) = self.elaborator.number(value, energy.body) else { return };
        if !good || !self.holds_what_is_gathered(of_bonds, value, energy, &names) {
            return;
        }
        let span = self.ast.arena[energy.body].span;
        let head: Vec<&str> = of_bonds
            .then_some("l")
            .into_iter()
            .chain(names.iter().map(|name| name.name.as_str()))
            .collect();
        let head = head.join(", ");
        let wanted = if of_bonds {
            // Per volume of the point, as energies of points are, and per m^d of the neighbour.
            Dimension::of(1, -1 - self.variant.dimension as i64, -2, 0)
        } else {
            Dimension::of(1, -1, -2, 0)
        };
        if self.has_units && Quantity::Known(wanted).unify(quantity).is_none() {
            let what = if of_bonds { "energy density of bonds" } else { "energy per volume" };
            let message = format!(
                "psi({head}) must be an {what} in {}, not {}",
                wanted.unit(),
                quantity.describe()
            );
            self.elaborator.report(
                Diagnostic::error("dimension-mismatch", span, message).label(quantity.describe()),
            );
            return;
        }
        let text = print_expression(&self.ast.arena, energy.body);
        let energy = GatheredEnergy { head, of_bonds, root: value.node, span, text };
        self.variant.gathered_energies.push(energy);
    }

    /// Whether a name in the head of an energy is a gathered value; reports it if not.
    fn is_gathered(&mut self, name: &Ident) -> bool {
        let symbols = self.elaborator.symbols;
        let value = match symbols.get(&name.name) {
            Some(Symbol::Value(number)) => match self.elaborator.values.get(&number) {
                Some(Some(value)) => Some(*value),
                // What is wrong with its definition is reported there; one that follows is not known.
                Some(None) => return false,
                None => None,
            },
            _ => None,
        };
        match value {
            Some(value) if value.uses == INTEGRAL && matches!(value.kind, Kind::Number(_)) => true,
            Some(value) if value.uses & INTEGRAL != 0 => {
                let message = format!("`{}` is no number that a point gathers", name.name);
                self.elaborator.report(
                    Diagnostic::error("wrong-measure", name.span, message)
                        .label("it differs from bond to bond")
                        .help("name the integrals that it holds, and use it in the energy"),
                );
                false
            }
            _ => {
                let message = format!("`{}` is not gathered over a family", name.name);
                self.elaborator.report(
                    Diagnostic::error("wrong-measure", name.span, message)
                        .label("holds no `integral(..)`")
                        .help(format!(
                            "define it above: `{} = integral(..)`, or leave it out of the head",
                            name.name
                        )),
                );
                false
            }
        }
    }

    fn holds_what_is_gathered(
        &mut self,
        of_bonds: bool,
        value: Value,
        energy: &EnergyAst,
        names: &[&Ident],
    ) -> bool {
        let own = INTEGRAL | if of_bonds { LENGTH } else { 0 };
        if value.uses & !own == 0 {
            return true;
        }
        let span = self.ast.arena[energy.body].span;
        let named: Vec<&str> = names.iter().map(|name| name.name.as_str()).collect();
        let (message, help) = if value.uses & LENGTH != 0 && !of_bonds {
            (
                "an energy of points cannot depend on the length of a bond".to_string(),
                format!("write `psi(l, {}) = ..`: an energy of bonds", named.join(", ")),
            )
        } else {
            (
                "an energy of gathered values cannot depend on `a`, `v` or `F`".to_string(),
                "write this part as an energy of its own".to_string(),
            )
        };
        self.elaborator.report(
            Diagnostic::error("wrong-measure", span, message)
                .note(energy.head, "the energy of what stands here")
                .help(help),
        );
        false
    }

    /// Reports integrals in an energy that names none.
    pub(super) fn refuse_integrals(&mut self, energy: &EnergyAst, value: Value) -> bool {
        if value.uses & INTEGRAL == 0 {
            return false;
        }
        let measure = &energy.measure.name;
        let message = format!("psi({measure}) cannot hold an integral over a family");
        let error = Diagnostic::error("wrong-measure", self.ast.arena[energy.body].span, message)
            .note(energy.head, format!("an energy of `{measure}` alone"));
        let help = match measure.as_str() {
            "l" => "name what is gathered: `theta = integral(..)`, then `psi(l, theta) = ..`",
            _ => "only bonds and points have gathered values: `psi(l, theta)`, `psi(theta)`",
        };
        self.elaborator.report(error.help(help));
        true
    }
}
