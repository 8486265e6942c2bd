//! Energies of several measures of a triangle or a tetrahedron: its area or volume, its sides, faces
//! and angles.

use std::iter::once;

use piola_grammar::ast::{Energy as EnergyAst, ExprKind, Ident};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::names::parts;
use super::orders::distinct;
use super::statement::Builder;
use super::value::{Kind, PART, Quantity, Value};
use crate::clique::Part;
use crate::expression::{Input, Node, NodeId, Operator};
use crate::measure::Measure;
use crate::model::CoupledEnergy;

/// What a name in the head of such an energy is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Named {
    Whole(Measure),
    Part(Part),
}

impl Named {
    fn symbol(self) -> &'static str {
        match self {
            Named::Whole(measure) => measure.symbol(),
            Named::Part(part) => part.symbol(),
        }
    }

    /// What an input is a measure of; nothing of those that no triangle or tetrahedron has.
    fn of(input: Input) -> Option<Named> {
        match input {
            Input::Current(m) | Input::Reference(m) if m != Measure::Length => {
                Some(Named::Whole(m))
            }
            Input::Part(part) | Input::PartAtRest(part) => Some(Named::Part(part)),
            _ => None,
        }
    }
}

impl Elaborator<'_> {
    /// A measure of a part, now or at rest.
    pub(super) fn part(&mut self, part: Part, input: Input, span: Span) -> Option<Value> {
        let quantity = match part.length_exponent() {
            0 => self.number_quantity(),
            _ if !self.checked => Quantity::Any,
            exponent => Quantity::Known(Dimension::of(0, exponent, 0, 0)),
        };
        self.make(Node::Input(input), Kind::Number(quantity), PART, span)
    }
}

impl Builder<'_> {
    /// `psi(a, l1, l2) = ..` or `psi(angle) = ..`.
    pub(super) fn coupled_energy(&mut self, energy: &EnergyAst) {
        let names: Vec<&Ident> = once(&energy.measure).chain(&energy.gathered).collect();
        let clique = clique(&names);
        let mut named = Vec::new();
        for (place, name) in names.iter().enumerate() {
            match self.in_head(clique, name, &names[..place]) {
                Ok(one) => named.push(one),
                Err(error) => return self.elaborator.report(*error),
            }
        }
        let Some(value) = self.elaborator.expression(energy.body) else { return };
        let Some(quantity) = self.elaborator.number(value, energy.body) else { return };
        let head: Vec<&str> = named.iter().map(|one| one.symbol()).collect();
        let head = head.join(", ");
        if !self.holds_its_head(energy, value, clique, (&head, &named)) {
            return;
        }
        let span = self.ast.arena[energy.body].span;
        let wanted = Dimension::energy_density(clique.points(), self.variant.dimension);
        if self.has_units && Quantity::Known(wanted).unify(quantity).is_none() {
            let message = format!(
                "psi({head}) must be an energy density in {} (d = {}), not {}",
                wanted.unit(),
                self.variant.dimension,
                quantity.describe()
            );
            let unit = format!("J/m^({}*d)", clique.points());
            self.elaborator.report(
                Diagnostic::error("dimension-mismatch", span, message)
                    .label(quantity.describe())
                    .help(format!(
                        "weights of {}s are products of {} volumes, so psi({head}) is in {unit}",
                        clique.interaction(),
                        clique.points()
                    )),
            );
            return;
        }
        let text = print_expression(&self.ast.arena, energy.body);
        match self.orders(value.node, clique) {
            Some((orders, root)) => {
                let energy = CoupledEnergy { head, clique, root, orders, span, text };
                self.variant.coupled_energies.push(energy);
            }
            None => {
                let message = format!("psi({head}) is too large in all orders of the points");
                self.elaborator.report(Diagnostic::error("too-large", span, message).help(
                    "an energy that is the same in every order is written once: `f(l1) + f(l2) + f(l3)`",
                ));
            }
        }
    }

    /// What is written in the orders of the points in which it differs, and the mean of these.
    fn orders(&mut self, root: NodeId, clique: Measure) -> Option<(Vec<NodeId>, NodeId)> {
        let graph = &mut self.elaborator.graph;
        let orders = distinct(graph, root, clique).ok()?;
        let mut sum = root;
        for order in &orders[1..] {
            sum = graph.intern(Node::Binary(Operator::Add, sum, *order)).ok()?;
        }
        if orders.len() > 1 {
            let n = graph.intern(Node::number(orders.len() as f64)).ok()?;
            sum = graph.intern(Node::Binary(Operator::Divide, sum, n)).ok()?;
        }
        Some((orders, sum))
    }

    /// What a name in the head is of a triangle or a tetrahedron.
    fn in_head(
        &self,
        clique: Measure,
        name: &Ident,
        before: &[&Ident],
    ) -> Result<Named, Box<Diagnostic>> {
        let wrong = |label: &str, help: String| {
            let message = format!("`{}` is no measure of a {}", name.name, clique.interaction());
            let error = Diagnostic::error("wrong-measure", name.span, message).label(label);
            Err(Box::new(error.help(help)))
        };
        if let Some(first) = before.iter().find(|first| first.name == name.name) {
            let message = format!("`{}` stands twice in the head", name.name);
            let error = Diagnostic::error("duplicate-name", name.span, message);
            return Err(Box::new(error.note(first.span, "the first is here")));
        }
        let defined = self.elaborator.symbols.get(&name.name);
        let parts = parts_of(clique);
        match (name.name.as_str(), Part::from_symbol(&name.name), defined) {
            (symbol, _, _) if symbol == clique.symbol() => Ok(Named::Whole(clique)),
            (_, Some(part), Some(super::symbols::Symbol::Part(_))) if part.is_of(clique) => {
                Ok(Named::Part(part))
            }
            (_, Some(part), Some(_)) if part.is_of(clique) => wrong(
                "defined in this file",
                format!("give it another name there, so that `{}` is what the {} has",
                    name.name, clique.interaction()),
            ),
            (_, Some(Part::Angle(_)), _) => wrong(
                "an angle between two sides of a triangle",
                "write an energy of triangles of its own: `psi(angle) = ..`".to_string(),
            ),
            (symbol, None, _) if Part::at_rest(symbol).is_some() => wrong(
                "a value at rest",
                format!(
                    "name what it is now, `{}`: the energy may hold both",
                    symbol.to_lowercase()
                ),
            ),
            ("a", ..) => wrong(
                "the measure of a triangle",
                "the faces of a tetrahedron are `a1`, `a2`, `a3`, `a4`: `psi(v, a1, a2, a3, a4) = ..`"
                    .to_string(),
            ),
            ("l", ..) => wrong(
                "the length of a bond",
                format!(
                    "its sides are {}: `psi({}, {}) = ..`; energies that add up are lines of their \
                     own: `psi({}) = ..` and `psi(l) = ..`",
                    sides(clique, "`"),
                    clique.symbol(),
                    sides(clique, ""),
                    clique.symbol()
                ),
            ),
            (symbol, _, Some(_)) if Measure::from_symbol(symbol).is_none() => wrong(
                "defined in this file",
                format!(
                    "gathered values stand alone or behind `l`: `psi(l, {symbol}) = ..`; a {} has {parts}",
                    clique.interaction()
                ),
            ),
            _ => wrong("not known of it", format!("a {} has {parts}", clique.interaction())),
        }
    }

    /// Whether an energy depends on what its head names, and on nothing else; reports what else.
    fn holds_its_head(
        &mut self,
        energy: &EnergyAst,
        value: Value,
        clique: Measure,
        (head, named): (&str, &[Named]),
    ) -> bool {
        let graph = &self.elaborator.graph;
        let needed = graph.reachable(&[value.node]);
        let inputs = graph.nodes().filter(|(id, _)| needed[id.0 as usize]);
        let foreign = inputs.into_iter().find_map(|(_, node)| match node {
            Node::Input(Input::Parameter(_) | Input::Horizon) => None,
            Node::Input(input) => match Named::of(input) {
                Some(one) if named.contains(&one) => None,
                other => Some((other, input)),
            },
            _ => None,
        });
        let Some((foreign, input)) = foreign else { return true };
        let arena = &self.ast.arena;
        let own = [Measure::from_symbol("l"), None];
        let (what, help) = match (foreign, input) {
            (Some(Named::Part(part)), _) if part.is_of(clique) => (
                format!("`{}`, which its head does not name", part.symbol()),
                format!("write `psi({head}, {}) = ..`", part.symbol()),
            ),
            (Some(Named::Whole(measure)), _) if measure == clique => (
                format!("`{}`, which its head does not name", measure.symbol()),
                format!("write `psi({}, {head}) = ..`", measure.symbol()),
            ),
            (Some(other), _) => (
                format!("`{}`", other.symbol()),
                format!("a {} has {}", clique.interaction(), parts_of(clique)),
            ),
            (None, Input::Current(_) | Input::Reference(_)) => (
                "the length of a bond, `l`".to_string(),
                format!("the sides of a {} are {}", clique.interaction(), sides(clique, "`")),
            ),
            (None, Input::Integral(_)) => (
                "an integral over a family".to_string(),
                "only bonds and points have gathered values: `psi(l, theta)`, `psi(theta)`"
                    .to_string(),
            ),
            (None, _) => (
                "the deformation gradient".to_string(),
                "write this part as an energy of its own: `psi(F) = ..`".to_string(),
            ),
        };
        let symbols: Vec<&str> = match foreign {
            Some(Named::Part(part)) => vec![part.symbol(), part.reference_symbol()],
            Some(Named::Whole(m)) => vec![m.symbol(), m.reference_symbol()],
            None => {
                own.into_iter().flatten().flat_map(|m| [m.symbol(), m.reference_symbol()]).collect()
            }
        };
        let place = parts(arena, energy.body).into_iter().find(
            |id| matches!(&arena[*id].kind, ExprKind::Name(name) if symbols.contains(&&**name)),
        );
        let span = arena[place.unwrap_or(energy.body)].span;
        let message = format!("psi({head}) cannot depend on {what}");
        self.elaborator.report(
            Diagnostic::error("wrong-measure", span, message)
                .note(energy.head, format!("an energy of a {}", clique.interaction()))
                .help(help),
        );
        false
    }
}

/// Whose measures stand in a head: those of a tetrahedron if one of them is.
fn clique(names: &[&Ident]) -> Measure {
    let of_tetrahedra = |name: &&Ident| {
        let part = Part::from_symbol(&name.name);
        name.name == "v" || part.is_some_and(|part| !part.is_of(Measure::Area))
    };
    if names.iter().any(of_tetrahedra) { Measure::Volume } else { Measure::Area }
}

fn sides(clique: Measure, quote: &str) -> String {
    let edges = Part::named().filter(|part| matches!(part, Part::Edge(_)) && part.is_of(clique));
    let edges: Vec<String> = edges.map(|edge| format!("{quote}{}{quote}", edge.symbol())).collect();
    edges.join(", ")
}

/// All that a triangle or a tetrahedron has, in words.
fn parts_of(clique: Measure) -> &'static str {
    match clique {
        Measure::Volume => "its volume `v`, its faces `a1` .. `a4` and its edges `l1` .. `l6`",
        _ => "its area `a`, its sides `l1`, `l2`, `l3` and the `angle` between `l1` and `l2`",
    }
}
