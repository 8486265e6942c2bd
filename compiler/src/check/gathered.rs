//! Integrals over families, and energies of what they gather.

use std::iter::once;

use piola_grammar::ast::{Definition, Energy as EnergyAst, ExprId, Ident, Statement};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::names::NEIGHBOUR;
use super::statement::Builder;
use super::symbols::{BOND_NOW, Symbol, is_of_vector};
use super::value::{GRADIENT, INTEGRAL, Kind, PART, Quantity, RATE, Value};
use crate::clique::Part;
use crate::expression::{Input, Node, NodeId};
use crate::measure::Measure;
use crate::model::{GatheredEnergy, Integral};

/// Most numbers that the points of a potential gather.
pub(crate) const MAX_INTEGRALS: usize = 48;

const LENGTH: u8 = 1 << (Measure::Length as u8);

/// What no integrand may hold, and why.
const FOREIGN: [(u8, &str); 5] = [
    (INTEGRAL, "another integral: integrals do not nest"),
    (GRADIENT, "the deformation gradient"),
    (1 << (Measure::Area as u8), "a measure of triangles"),
    (1 << (Measure::Volume as u8), "a measure of tetrahedra"),
    (RATE, "how fast bonds change"),
];

/// A number that points gather.
#[derive(Clone, Debug)]
pub(super) struct Gathered {
    /// The integrand, or the definition of the function.
    at: ExprId,
    /// Which component of it, counting from 1, where it is a vector or a tensor.
    component: Option<String>,
    root: NodeId,
    /// Of others, and what is defined so.
    function: Option<String>,
}

impl Elaborator<'_> {
    /// `integral(g)`: the sum of `V_j g` over the family of a point; of a vector or a tensor that of each
    /// component.
    pub(super) fn integral(&mut self, value: Value, at: ExprId, span: Span) -> Option<Value> {
        let tensor = self.known_tensor(value);
        let quantity = match &tensor {
            Some(tensor) => tensor.quantity,
            None => self.number(value, at)?,
        };
        let bits = FOREIGN.iter().find(|(bit, _)| value.uses & bit != 0).map(|(_, what)| *what);
        let roots: Vec<NodeId> = match &tensor {
            Some(tensor) => tensor.components.iter().flatten().copied().collect(),
            None => vec![value.node],
        };
        let of_parts = "a part of a triangle or a tetrahedron";
        if let Some(what) = bits.or(self.holds_parts(&roots).then_some(of_parts)) {
            let message = format!("an integrand cannot hold {what}");
            self.report(
                Diagnostic::error("wrong-measure", self.arena[at].span, message)
                    .label("summed up over the bonds of a point")
                    .help(
                        "an integrand is a function of `l`, `L`, `xi`, `Xi`, `delta` and parameters: \
                         `integral(w*L^2)`, `integral(w*dyad(Xi, Xi))`",
                    ),
            );
            return None;
        }
        let volume = Dimension::of(0, self.dimension as i64, 0, 0);
        let quantity = match quantity {
            Quantity::Known(dimension) => Quantity::Known(dimension.times(volume)),
            Quantity::Any => Quantity::Any,
        };
        let Some(mut tensor) = tensor else {
            let gathered = Gathered { at, component: None, root: value.node, function: None };
            let node = self.gather(gathered, span)?;
            return self.make(node, Kind::Number(quantity), INTEGRAL, span);
        };
        for (place, component) in tensor.components.clone().into_iter().enumerate() {
            let Some(root) = component else { continue };
            let name = component_name(place, tensor.components.len(), self.dimension);
            let gathered = Gathered { at, component: Some(name), root, function: None };
            let node = self.gather(gathered, span)?;
            tensor.components[place] = Some(self.operation(node, span)?);
        }
        (tensor.quantity, tensor.uses) = (quantity, INTEGRAL);
        Some(self.tensor(tensor))
    }

    /// The input for something gathered, the same for the same.
    fn gather(&mut self, gathered: Gathered, span: Span) -> Option<Node> {
        let is_it = |own: &Gathered| {
            own.root == gathered.root && own.function.is_some() == gathered.function.is_some()
        };
        let known = self.integrals.iter().position(is_it);
        let number = known.unwrap_or(self.integrals.len());
        if number >= MAX_INTEGRALS {
            let message = format!(
                "a potential gathers at most {MAX_INTEGRALS} different numbers: each component of a tensor is one"
            );
            self.report(Diagnostic::error("too-large", span, message));
            return None;
        }
        if known.is_none() {
            self.integrals.push(gathered);
        }
        Some(Node::Input(Input::Integral(number as u8)))
    }

    /// Whether some roots hold a part of a triangle or a tetrahedron.
    pub(super) fn holds_parts(&self, roots: &[NodeId]) -> bool {
        self.holds(roots, |input| match input {
            Input::Part(part) => !matches!(part, Part::Moved(_)),
            Input::PartAtRest(_) => true,
            _ => false,
        })
    }

    /// Whether some roots hold an input of a kind.
    pub(super) fn holds(&self, roots: &[NodeId], is_it: impl Fn(Input) -> bool) -> bool {
        let needed = self.graph.reachable(roots);
        self.graph.nodes().any(|(id, node)| {
            needed[id.0 as usize] && matches!(node, Node::Input(input) if is_it(input))
        })
    }

    /// A tensor of gathered values that a head names: its components count as gathered themselves, so that
    /// each point works them out once.
    pub(super) fn gathered_value(&mut self, value: Value, of: &Definition) -> Option<Value> {
        let heads = self.ast.iter().flat_map(|ast| &ast.statements).filter_map(|one| match one {
            Statement::Energy(energy) => Some(energy),
            _ => None,
        });
        let mut names = heads.flat_map(|energy| once(&energy.measure).chain(&energy.gathered));
        let is_named = names.any(|name| name.name == of.name.name);
        let Some(mut tensor) = self.known_tensor(value) else { return Some(value) };
        if value.uses != INTEGRAL || !is_named {
            return Some(value);
        }
        let span = self.arena[of.body].span;
        for (place, component) in tensor.components.clone().into_iter().enumerate() {
            let Some(root) = component else { continue };
            let is_known = matches!(self.graph[root], Node::Input(Input::Integral(_)));
            if is_known || !self.holds(&[root], |input| matches!(input, Input::Integral(_))) {
                continue;
            }
            let name = component_name(place, tensor.components.len(), self.dimension);
            let function = Some(of.name.name.clone());
            let gathered = Gathered { at: of.body, component: Some(name), root, function };
            let node = self.gather(gathered, span)?;
            tensor.components[place] = Some(self.operation(node, span)?);
        }
        Some(self.tensor(tensor))
    }

    /// `neighbour(x)`: what the other end of a bond gathers as `x`.
    pub(super) fn neighbour(&mut self, value: Value, at: ExprId, span: Span) -> Option<Value> {
        let is_shape = matches!(value.kind, Kind::Number(_) | Kind::Tensor(..));
        if value.uses != INTEGRAL || !is_shape {
            let message = format!("`{NEIGHBOUR}` is of what points gather");
            let (what, help) = match value.uses & INTEGRAL {
                0 => (
                    "nothing gathered",
                    format!(
                        "it stands around integrals and what is made of them: `theta = integral(..)`, then \
                         `{NEIGHBOUR}(theta)` in an energy of bonds, `psi(l, theta)`"
                    ),
                ),
                _ => (
                    "differs from bond to bond",
                    format!("take it of the gathered value alone: `{NEIGHBOUR}(H)*xi`"),
                ),
            };
            let error = Diagnostic::error("wrong-measure", self.arena[at].span, message);
            self.report(error.label(what).help(help));
            return None;
        }
        // Seen from a bond: it is another from bond to bond.
        let uses = INTEGRAL | LENGTH;
        if let Some(mut tensor) = self.known_tensor(value) {
            for component in tensor.components.iter_mut().flatten() {
                *component = self.of_neighbour(*component, span)?;
            }
            tensor.uses = uses;
            return Some(self.tensor(tensor));
        }
        let node = self.of_neighbour(value.node, span)?;
        Some(Value { node, uses, constant: None, ..value })
    }

    /// The same with what the other end gathers in the place of what this one does.
    fn of_neighbour(&mut self, root: NodeId, span: Span) -> Option<NodeId> {
        let needed = self.graph.reachable(&[root]);
        let mut place = vec![NodeId(0); needed.len()];
        for index in (0..needed.len()).filter(|index| needed[*index]) {
            let node = match self.graph[NodeId(index as u32)] {
                Node::Input(Input::Integral(k)) => Node::Input(Input::Neighbour(k)),
                node => node.map_operands(|x| place[x.0 as usize]),
            };
            place[index] = self.operation(node, span)?;
        }
        Some(place[root.0 as usize])
    }
}

/// `(2)`, `(1, 2)`: the component at a place of a vector or a tensor.
fn component_name(place: usize, n: usize, d: usize) -> String {
    match n == d {
        true => format!("({})", place + 1),
        false => format!("({}, {})", place / d + 1, place % d + 1),
    }
}

impl Builder<'_> {
    /// The integrals that the energies of the variant may hold.
    pub(super) fn integrals(&self) -> Vec<Integral> {
        let arena = &self.ast.arena;
        let integral = |own: &Gathered| {
            let component = own.component.as_deref().unwrap_or_default();
            let text = match &own.function {
                Some(name) => format!("{name}{component}"),
                None if component.is_empty() => print_expression(arena, own.at),
                None => format!("({}){component}", print_expression(arena, own.at)),
            };
            let (span, is_function) = (arena[own.at].span, own.function.is_some());
            Integral { root: own.root, is_function, span, text }
        };
        self.elaborator.integrals.iter().map(integral).collect()
    }

    /// `psi(l, theta) = ..` or `psi(theta) = ..`.
    pub(super) fn gathered_energy(&mut self, energy: &EnergyAst) {
        let of_vector = is_of_vector(self.ast, energy);
        let of_bonds = energy.measure.name == "l" || of_vector;
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
            .then_some(energy.measure.name.as_str())
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
            Some(value)
                if value.uses == INTEGRAL
                    && matches!(value.kind, Kind::Number(_) | Kind::Tensor(..)) =>
            {
                true
            }
            Some(value) if value.uses & INTEGRAL != 0 => {
                let message = format!("`{}` is no number that a point gathers", name.name);
                self.elaborator.report(
                    Diagnostic::error("wrong-measure", name.span, message)
                        .label("it differs from bond to bond")
                        .help("name the integrals that it holds, and use it in the energy"),
                );
                false
            }
            None if matches!(
                symbols.get(&name.name),
                Some(Symbol::BondNow(_) | Symbol::Current(_))
            ) =>
            {
                let message = format!("`{}` is not gathered over a family", name.name);
                let error = Diagnostic::error("wrong-measure", name.span, message);
                self.elaborator.report(error.label("what a bond is, and no point").help(format!(
                    "it stands first in the head of an energy of bonds: `psi({}, ..) = ..`",
                    name.name
                )));
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

    /// Whether the file knows the vector of a bond as it is now.
    fn variant_moves(&self) -> bool {
        matches!(self.elaborator.symbols.get(BOND_NOW), Some(Symbol::BondNow(_)))
    }

    fn holds_what_is_gathered(
        &mut self,
        of_bonds: bool,
        value: Value,
        energy: &EnergyAst,
        names: &[&Ident],
    ) -> bool {
        let own = INTEGRAL | if of_bonds { LENGTH | PART } else { 0 };
        let holds_parts = self.elaborator.holds_parts(&[value.node]);
        if value.uses & !own == 0 && !holds_parts {
            return true;
        }
        let is_neighbour = |input: Input| matches!(input, Input::Neighbour(_));
        let holds_neighbour = self.elaborator.holds(&[value.node], is_neighbour);
        let span = self.ast.arena[energy.body].span;
        let named: Vec<&str> = names.iter().map(|name| name.name.as_str()).collect();
        let (message, help) = if holds_neighbour && !of_bonds {
            (
                "an energy of points cannot depend on what a neighbour gathers".to_string(),
                format!("write `psi({BOND_NOW}, {}) = ..`: an energy of bonds", named.join(", ")),
            )
        } else if value.uses & LENGTH != 0 && !of_bonds && !holds_parts {
            (
                "an energy of points cannot depend on the length or the vector of a bond"
                    .to_string(),
                format!(
                    "write `psi({}, {}) = ..`: an energy of bonds",
                    if self.variant_moves() { BOND_NOW } else { "l" },
                    named.join(", ")
                ),
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
