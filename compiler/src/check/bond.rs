//! `Xi`, the vector of a bond at rest: its length `L` times its direction, a unit vector. `xi`, the same now:
//! `Xi` and how far the ends have moved against each other.
//!
//! The components of the direction are inputs behind all parameters, so that any `L` goes with any of them. A
//! bond has no first end: what is written of it must be the same for `Xi` and `-Xi`.

use piola_grammar::ast::Energy as EnergyAst;
use piola_grammar::{Diagnostic, Span, print_expression};
use rustc_hash::FxHashMap;

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::statement::Builder;
use super::symbols::{BOND, BOND_NOW, Symbol};
use super::tensor::Tensor;
use super::value::{INTEGRAL, Kind, PART, Quantity, Value};
use crate::clique::Part;
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number as _;
use crate::expression::precise::Precise;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::measure::Measure;
use crate::model::{CoupledEnergy, OfFamily};
use crate::verify::sample::Random;

/// At how many places two expressions are held against each other.
const PLACES: u64 = 12;

/// Values of 256 bits that are the same.
const SAME: f64 = 1e-40;

const LENGTH: Node = Node::Input(Input::Reference(Measure::Length));

impl Elaborator<'_> {
    /// `Xi`; `first` is the number of the first component of its direction.
    pub(super) fn bond(&mut self, first: usize, span: Span) -> Option<Value> {
        let mut components = Vec::with_capacity(self.dimension);
        for axis in 0..self.dimension {
            let component = Node::Input(Input::Parameter((first + axis) as u16));
            components.push(Some(self.operation(component, span)?));
        }
        let length = self.name("L", span, &[])?;
        let Kind::Number(quantity) = length.kind else { return None };
        for component in &mut components {
            *component = self.component(Operator::Multiply, *component, Some(length.node), span)?;
        }
        Some(self.tensor(Tensor { components, quantity, uses: length.uses }))
    }

    /// `xi`; its length is `l`.
    pub(super) fn bond_now(&mut self, first: usize, span: Span) -> Option<Value> {
        let rest = self.bond(first, span)?;
        let rest = self.known_tensor(rest)?;
        let mut components = Vec::with_capacity(self.dimension);
        for (axis, rest) in rest.components.iter().enumerate() {
            let moved = Node::Input(Input::Part(Part::Moved(axis as u8)));
            let moved = Some(self.operation(moved, span)?);
            components.push(self.component(Operator::Add, *rest, moved, span)?);
        }
        Some(self.tensor(Tensor { components, uses: rest.uses | PART, ..rest }))
    }

    /// The components of `xi - Xi`, where a tensor is `xi` itself.
    fn moved_in(&self, x: &Tensor) -> Option<Tensor> {
        let (mut rest, mut moved) = (Vec::new(), Vec::new());
        for (axis, component) in x.components.iter().enumerate() {
            let Node::Binary(Operator::Add, p, q) = self.graph[(*component)?] else { return None };
            if self.graph[q] != Node::Input(Input::Part(Part::Moved(axis as u8))) {
                return None;
            }
            rest.push(Some(p));
            moved.push(Some(q));
        }
        self.direction_in(&Tensor { components: rest, ..x.clone() })?;
        Some(Tensor { components: moved, quantity: x.quantity, uses: PART })
    }

    /// `xi - Xi`, without the digits that the difference would lose.
    pub(super) fn moved(&self, x: &Tensor, y: &Tensor) -> Option<Tensor> {
        self.direction_in(y)?;
        self.moved_in(x)
    }

    /// The same of one component: `xi(1) - Xi(1)`.
    pub(super) fn moved_component(&self, x: NodeId, y: NodeId) -> Option<NodeId> {
        let Node::Binary(Operator::Add, rest, moved) = self.graph[x] else { return None };
        let is_moved = matches!(self.graph[moved], Node::Input(Input::Part(Part::Moved(_))));
        (is_moved && rest == y).then_some(moved)
    }

    /// The length of a tensor that is `Xi` or `xi` itself.
    pub(super) fn length_of_bond(&mut self, x: &Tensor, span: Span) -> Option<Value> {
        let name = match (self.direction_in(x).is_some(), self.moved_in(x).is_some()) {
            (true, _) => "L",
            (_, true) => "l",
            _ => return None,
        };
        self.name(name, span, &[])
    }

    /// The square of a number.
    pub(super) fn square(&mut self, x: Value, span: Span) -> Option<Value> {
        let Kind::Number(quantity) = x.kind else { return None };
        let quantity = quantity.combine(quantity, |p, q| p.times(q));
        let node = Node::Binary(Operator::Multiply, x.node, x.node);
        self.make(node, Kind::Number(quantity), x.uses, span)
    }

    /// Whether a node is `L`.
    pub(super) fn is_length(&self, node: NodeId) -> bool {
        self.graph[node] == LENGTH
    }

    /// The components of the direction, where a tensor is `Xi` itself.
    pub(super) fn direction_in(&self, x: &Tensor) -> Option<Vec<NodeId>> {
        let Some(Symbol::Bond(first)) = self.symbols.get(BOND) else { return None };
        let direction = |(axis, component): (usize, &Option<NodeId>)| {
            let Node::Binary(Operator::Multiply, own, length) = self.graph[(*component)?] else {
                return None;
            };
            let is_own = self.graph[own] == Node::Input(Input::Parameter((first + axis) as u16));
            (is_own && self.is_length(length)).then_some(own)
        };
        x.components.iter().enumerate().map(direction).collect()
    }

    /// `Xi/L`, of a tensor that is `Xi` itself.
    pub(super) fn direction(&self, x: &Tensor) -> Option<Tensor> {
        let components = self.direction_in(x)?.into_iter().map(Some).collect();
        Some(Tensor { components, quantity: self.number_quantity(), uses: x.uses })
    }

    /// `n*Xi`: the length is a factor of the whole. Nothing where none or both are `Xi` itself.
    pub(super) fn dot_with_bond(&mut self, x: &Tensor, y: &Tensor, span: Span) -> Option<Value> {
        let (bond, other) = match [x, y].map(|one| self.direction_in(one).is_some()) {
            [true, false] => (x, y),
            [false, true] => (y, x),
            _ => return None,
        };
        let direction = self.direction(bond)?;
        let cosine = self.dot(&direction, other, span)?;
        let length = self.name("L", span, &[])?;
        let node = Node::Binary(Operator::Multiply, cosine.node, length.node);
        let Kind::Number(quantity) = cosine.kind else { return None };
        let quantity = quantity.combine(bond.quantity, |p, q| p.times(q));
        let uses = cosine.uses | length.uses;
        self.make(node, Kind::Number(quantity), uses, span)
    }
}

/// What becomes of a value where a bond is seen from its other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Parity {
    /// Nothing.
    Even,
    /// It changes its sign.
    Odd,
    /// Something else, or nobody knows.
    Neither,
}

/// Of each node, with the direction among these inputs.
fn parities(graph: &ExprGraph, is_direction: impl Fn(Input) -> bool) -> Vec<Parity> {
    use Parity::{Even, Neither, Odd};
    let mut parities: Vec<Parity> = Vec::with_capacity(graph.len());
    for (_, node) in graph.nodes() {
        let of = |x: NodeId| parities[x.0 as usize];
        let all_even = || if node.operands().all(|x| of(x) == Even) { Even } else { Neither };
        let parity = match node {
            Node::Input(input) if is_direction(input) => Odd,
            Node::Unary(Function::Negate, x) => of(x),
            Node::Unary(function, x) if of(x) == Odd => match function {
                Function::Abs | Function::Cos | Function::Cosh => Even,
                Function::Sign
                | Function::Sin
                | Function::Tan
                | Function::Sinh
                | Function::Tanh
                | Function::Asin
                | Function::Atan
                | Function::Erf => Odd,
                _ => Neither,
            },
            Node::Binary(Operator::Add | Operator::Subtract, x, y) => match (of(x), of(y)) {
                (x, y) if x == y => x,
                _ => Neither,
            },
            Node::Binary(Operator::Multiply | Operator::Divide, x, y) => match (of(x), of(y)) {
                (Neither, _) | (_, Neither) => Neither,
                (x, y) if x == y => Even,
                _ => Odd,
            },
            Node::Binary(Operator::Power, x, y) if of(x) == Odd => {
                graph.as_number(y).map_or(Neither, power_of_odd)
            }
            Node::PowerConstant(x, power) if of(x) == Odd => power_of_odd(f64::from_bits(power)),
            Node::Select(c, x, y) if of(c) == Even && of(x) == of(y) => of(x),
            _ => all_even(),
        };
        parities.push(parity);
    }
    parities
}

/// Whether a root holds a choice that is another for both signs of the direction: places tell nothing of the
/// branches that they do not take.
fn has_odd_choice(graph: &ExprGraph, root: NodeId, parities: &[Parity]) -> bool {
    let needed = graph.reachable(&[root]);
    let is_choice = |node: Node| match node {
        Node::Select(..) | Node::Compare(..) => true,
        Node::Unary(function, _) => matches!(function, Function::Abs | Function::Sign),
        Node::Binary(operator, ..) => matches!(operator, Operator::Min | Operator::Max),
        _ => false,
    };
    let is_odd = |id: NodeId| parities[id.0 as usize] == Parity::Neither;
    graph.nodes().any(|(id, node)| needed[id.0 as usize] && is_choice(node) && is_odd(id))
}

/// Whether a root has the same values for both signs of the direction, as far as some places tell: products such
/// as `(1 - c)*(1 + c)` do not show it. Not where it is no number at any of them.
fn looks_even(graph: &ExprGraph, root: NodeId, is_direction: impl Fn(Input) -> bool) -> bool {
    let (graph, roots) = graph.extract(&[root]);
    let value = |seed: u64, sign: f64| {
        let mut random = Random::new(seed);
        let given = graph.nodes().filter_map(|(_, node)| match node {
            Node::Input(input) if is_direction(input) => {
                Some((input, sign * random.uniform(-1.0, 1.0)))
            }
            Node::Input(input) => Some((input, random.uniform(0.5, 2.0))),
            _ => None,
        });
        let given: FxHashMap<Input, f64> = given.collect();
        let mut interpreter = Interpreter::<Precise<256>>::new();
        interpreter.run(&graph, |input| Precise::constant(given[&input]));
        interpreter.number(roots[0])
    };
    let mut is_number = false;
    for seed in 0..PLACES {
        let (one, other) = (value(seed, 1.0), value(seed, -1.0));
        if one.parts().is_none() && other.parts().is_none() {
            continue;
        }
        is_number = true;
        let size = one.rounded()[0].abs();
        let off = Precise::binary(Operator::Subtract, one, other).rounded()[0].abs();
        let is_same = off <= SAME * size;
        if !is_same {
            return false;
        }
    }
    is_number
}

fn power_of_odd(power: f64) -> Parity {
    match power % 2.0 {
        0.0 => Parity::Even,
        1.0 | -1.0 => Parity::Odd,
        _ => Parity::Neither,
    }
}

impl Builder<'_> {
    /// `psi(xi) = ..`
    pub(super) fn vector_energy(&mut self, energy: &EnergyAst) {
        if !matches!(self.elaborator.symbols.get(BOND), Some(Symbol::Bond(_))) {
            let message =
                format!("`{BOND}` is the vector of a bond at rest in a file with psi({BOND_NOW})");
            let error = Diagnostic::error("reserved-name", energy.measure.span, message);
            let help = format!("give what this file calls `{BOND}` another name");
            self.elaborator.report(error.label("this energy is one of the vector").help(help));
            return;
        }
        let Some(value) = self.elaborator.expression(energy.body) else { return };
        let Some(quantity) = self.elaborator.number(value, energy.body) else { return };
        let span = self.ast.arena[energy.body].span;
        let graph = &self.elaborator.graph;
        let needed = graph.reachable(&[value.node]);
        let is_own = |input: Input| match input {
            Input::Current(measure) | Input::Reference(measure) => measure == Measure::Length,
            Input::Part(Part::Moved(_)) | Input::Parameter(_) | Input::Horizon => true,
            _ => false,
        };
        let is_foreign = |(id, node): (NodeId, Node)| {
            needed[id.0 as usize] && matches!(node, Node::Input(input) if !is_own(input))
        };
        let holds_foreign = graph.nodes().any(is_foreign);
        if holds_foreign {
            let message =
                format!("psi({BOND_NOW}) is the energy of a bond and holds something else");
            let gathers = value.uses & INTEGRAL != 0;
            let help = match gathers {
                true => "name what is gathered in the head: `psi(xi, H) = ..`",
                false => {
                    "it may hold `xi`, `Xi`, `l`, `L`, `delta`, parameters and definitions of these"
                }
            };
            let error = Diagnostic::error("wrong-measure", span, message)
                .label("holds what no bond has, or an integral")
                .help(help);
            self.elaborator.report(error);
            return;
        }
        let measure = Measure::Length;
        let wanted = Dimension::energy_density(measure.points(), self.variant.dimension);
        if self.has_units && Quantity::Known(wanted).unify(quantity).is_none() {
            self.wrong_energy_unit(energy, measure, quantity, wanted);
            return;
        }
        let (root, text) = (value.node, print_expression(&self.ast.arena, energy.body));
        let (head, clique, orders) = (BOND_NOW.to_string(), measure, vec![root]);
        self.variant.coupled_energies.push(CoupledEnergy {
            head,
            clique,
            root,
            orders,
            span,
            text,
        });
    }

    /// Whether a value holds what a bond has beside what a point gathers and beside its length: its vector, now or at
    /// rest, or what its other end gathers.
    pub(super) fn sees_bond(&self, root: NodeId) -> bool {
        let numbers = self.directions();
        let is_seen = |input| is_of_bond(&numbers, input) || matches!(input, Input::Neighbour(_));
        self.elaborator.holds(&[root], is_seen)
    }

    /// The numbers that stand for the components of the direction of a bond at rest.
    fn directions(&self) -> std::ops::Range<usize> {
        match self.elaborator.symbols.get(BOND) {
            Some(Symbol::Bond(first)) => first..first + self.variant.dimension,
            _ => 0..0,
        }
    }

    /// Finds out whether anything depends on the direction of a bond, and refuses what is another from its
    /// other end.
    pub(super) fn check_directions(&mut self) {
        let numbers = self.directions();
        if numbers.is_empty() {
            return;
        }
        let graph = &self.elaborator.graph;
        let is_direction = |input: Input| is_of_bond(&numbers, input);
        let seen = |root: NodeId| {
            let needed = graph.reachable(&[root]);
            let inputs = graph.nodes().filter(|(id, _)| needed[id.0 as usize]);
            let inputs = inputs.filter_map(|(_, node)| match node {
                Node::Input(input) if is_direction(input) => Some(input),
                _ => None,
            });
            inputs.collect::<Vec<Input>>()
        };
        let places = self.places();
        let parities = parities(graph, is_direction);
        let by_ends = self.seen_from_ends();
        let mut errors = Vec::new();
        for place in &places {
            let held = seen(place.root);
            if held.is_empty() {
                continue;
            }
            let is_at_rest = |input: &Input| matches!(input, Input::Parameter(_));
            self.variant.sees_directions |= held.iter().any(is_at_rest);
            let moves = !held.iter().all(is_at_rest);
            let is_by_ends = by_ends.contains(&(place.root, place.span));
            if is_by_ends && moves {
                self.variant.gathers_vectors = true;
                continue;
            }
            let parity = parities[place.root.0 as usize];
            let is_even = match parity {
                Parity::Even => true,
                Parity::Odd => false,
                Parity::Neither => {
                    !has_odd_choice(graph, place.root, &parities)
                        && looks_even(graph, place.root, is_direction)
                }
            };
            if is_even {
                continue;
            }
            if is_by_ends {
                self.variant.gathers_vectors = true;
                continue;
            }
            let what = &place.what;
            let message = match parity {
                Parity::Odd => format!("{what} changes its sign where `{BOND}` does"),
                _ => format!("{what} may be another where `{BOND}` changes its sign"),
            };
            let error = Diagnostic::error("wrong-measure", place.span, message)
                .label("a bond has no first end: both of its ends see it alike")
                .help(format!(
                    "hold even powers of `{BOND}` or `abs`: `(n*{BOND}/L)^2`, `abs(n*{BOND})`"
                ));
            errors.push(error);
        }
        errors.into_iter().for_each(|error| self.elaborator.report(error));
    }

    /// What both ends of a bond see apart, by its root and its place: integrands, and energies and conditions of bonds
    /// with what their point gathers.
    fn seen_from_ends(&self) -> Vec<(NodeId, Span)> {
        let integrals = self.variant.integrals.iter().filter(|one| !one.is_function);
        let energies = self.variant.gathered_energies.iter().filter(|one| one.of_bonds);
        let integrals = integrals.map(|one| (one.root, one.span));
        let breaks = self.variant.family_breaks.iter().filter(|one| one.of == OfFamily::Bonds);
        let breaks = breaks.map(|one| (one.root, one.span));
        integrals.chain(energies.map(|one| (one.root, one.span))).chain(breaks).collect()
    }

    /// Finds out whether points gather vectors and tensors.
    pub(super) fn check_vectors(&mut self) {
        let variant = &self.variant;
        let energies = variant.gathered_energies.iter().map(|one| one.root);
        let breaks = variant.family_breaks.iter().filter(|one| one.of == OfFamily::Bonds);
        let by_ends: Vec<NodeId> = energies.chain(breaks.map(|one| one.root)).collect();
        let is_neighbour = |input: Input| matches!(input, Input::Neighbour(_));
        let holds_neighbour = self.elaborator.holds(&by_ends, is_neighbour);
        let has_functions = variant.integrals.iter().any(|one| one.is_function);
        self.variant.gathers_vectors |= holds_neighbour || has_functions;
        self.variant.sees_directions |= self.variant.gathers_vectors;
    }
}

/// Whether an input is of the vector of a bond: of its direction at rest, which has these numbers, or of what its end
/// has moved by.
fn is_of_bond(directions: &std::ops::Range<usize>, input: Input) -> bool {
    match input {
        Input::Parameter(number) => directions.contains(&usize::from(number)),
        Input::Part(part) => matches!(part, Part::Moved(_)),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use crate::check::check_text;

    fn found(lines: &str) -> Vec<&'static str> {
        let text = format!("potential p\ndimensions 3\nn = vector(1, 2, 3)\n{lines}\n");
        match check_text(&text) {
            Ok(_) => Vec::new(),
            Err(found) => found.into_iter().map(|one| one.code).collect(),
        }
    }

    #[test]
    fn what_is_the_same_from_both_ends_is_taken() {
        for even in [
            "(n*Xi/L)^2",
            "abs(n*Xi)",
            "(n*Xi)*(Xi*vector(0, 0, 1))",
            "Xi*Xi",
            "norm(Xi)",
            "cos(n*Xi/L)",
            "if abs(Xi(1)) > L/2 then 1 else 2",
            "Xi*dyad(n)*Xi",
            "Xi(1)^2 - Xi(2)^2",
            "(1 - n*Xi/L)*(1 + n*Xi/L)",
            "if norm(Xi) > 1 then (n*Xi)^2 else abs(n*Xi)^3",
        ] {
            assert_eq!(found(&format!("psi(l) = (l - L)^2*({even})")), [""; 0], "{even}");
        }
    }

    #[test]
    fn what_is_another_from_the_other_end_is_refused() {
        // Branches that few directions take, or few values of parameters.
        for other in [
            "if n*Xi/L > 0.99 then 4 else 1",
            "if norm(n) > 100 then 1 + Xi(1)/L else 1",
            "1 + max(n*Xi/L - 3.7, 0)",
        ] {
            assert_eq!(
                found(&format!("psi(l) = (l - L)^2*({other})")),
                ["wrong-measure"],
                "{other}"
            );
        }
        for other in ["n*Xi", "max(n*Xi, 0)", "(n*Xi)^3", "1 + n*Xi", "exp(n*Xi/L)", "(n*Xi/L)^0.5"]
        {
            assert_eq!(
                found(&format!("psi(l) = (l - L)^2*({other})")),
                ["wrong-measure"],
                "{other}"
            );
        }
        for line in ["break when n*Xi > L/2", "update k = max(k, n*Xi)"] {
            let lines = format!("state k = 0\n{line}\npsi(l) = k*(l - L)^2");
            assert_eq!(found(&lines), ["wrong-measure"], "{line}");
        }
    }
}
