//! What an energy of a triangle or a tetrahedron is in other orders of its points.
//!
//! Points of an interaction have no order, and an energy is the mean over all orders. Most are the same
//! expression: sums and products are compared without regard to the order of their operands.

use rustc_hash::FxHashMap;

use crate::clique::orders;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;

/// The different expressions that a root becomes, itself first. Each stands for equally many orders.
pub(super) fn distinct(
    graph: &mut ExprGraph,
    root: NodeId,
    clique: Measure,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let (mut alike, mut known, mut found) = (Alike::default(), Vec::new(), Vec::new());
    for order in orders(clique) {
        let moved = reordered(graph, root, clique, &order)?;
        let class = alike.class(graph, moved);
        if !known.contains(&class) {
            known.push(class);
            found.push(moved);
        }
    }
    Ok(found)
}

/// The root with its parts in another order.
fn reordered(
    graph: &mut ExprGraph,
    root: NodeId,
    clique: Measure,
    order: &[u8],
) -> Result<NodeId, TooManyNodes> {
    let needed = graph.reachable(&[root]);
    let mut place: Vec<NodeId> = Vec::with_capacity(needed.len());
    for (index, needed) in needed.iter().enumerate().take(root.0 as usize + 1) {
        let id = NodeId(index as u32);
        let node = match graph[id] {
            _ if !needed => {
                place.push(id);
                continue;
            }
            Node::Input(Input::Part(part)) => {
                Node::Input(Input::Part(part.reordered(clique, order)))
            }
            Node::Input(Input::PartAtRest(part)) => {
                Node::Input(Input::PartAtRest(part.reordered(clique, order)))
            }
            node => node.map_operands(|x| place[x.0 as usize]),
        };
        place.push(graph.intern(node)?);
    }
    Ok(place[root.0 as usize])
}

/// Classes of nodes that differ in the order of operands alone.
#[derive(Default)]
struct Alike {
    classes: FxHashMap<Shape, u32>,
    /// Of classes that are the negative of each other.
    opposite: FxHashMap<u32, u32>,
}

/// A node over classes.
#[derive(PartialEq, Eq, Hash)]
enum Shape {
    /// Operands of a sum, a product, a smallest or a largest number, in ascending order.
    Row(Operator, Vec<u32>),
    Other(Node),
}

impl Alike {
    /// The class of a root.
    fn class(&mut self, graph: &ExprGraph, root: NodeId) -> u32 {
        let needed = graph.reachable(&[root]);
        let mut class = vec![0; root.0 as usize + 1];
        let mut rows: Vec<Option<(Operator, Vec<u32>)>> = vec![None; class.len()];
        for (id, node) in graph.nodes().take(class.len()) {
            let index = id.0 as usize;
            if !needed[index] {
                continue;
            }
            let own = |operator: Operator, operand: NodeId| match &rows[operand.0 as usize] {
                Some((same, own)) if *same == operator => own.clone(),
                _ => vec![class[operand.0 as usize]],
            };
            let negated = |alike: &mut Alike, operand: NodeId| -> Vec<u32> {
                let own = own(Operator::Add, operand);
                own.into_iter().map(|class| alike.negated(class)).collect()
            };
            let row = match node {
                Node::Binary(operator, x, y) if is_commutative(operator) => {
                    Some((operator, [own(operator, x), own(operator, y)].concat()))
                }
                Node::Binary(Operator::Subtract, x, y) => {
                    Some((Operator::Add, [own(Operator::Add, x), negated(self, y)].concat()))
                }
                Node::Unary(Function::Negate, x) => Some((Operator::Add, negated(self, x))),
                _ => None,
            };
            class[index] = match row {
                Some((_, row)) if row.len() == 1 => row[0],
                Some((operator, mut row)) => {
                    row.sort_unstable();
                    rows[index] = Some((operator, row.clone()));
                    self.known(Shape::Row(operator, row))
                }
                None => {
                    self.known(Shape::Other(node.map_operands(|x| NodeId(class[x.0 as usize]))))
                }
            };
        }
        class[root.0 as usize]
    }

    fn known(&mut self, shape: Shape) -> u32 {
        let next = self.classes.len() as u32;
        *self.classes.entry(shape).or_insert(next)
    }

    /// The class of what is negative to a class.
    fn negated(&mut self, class: u32) -> u32 {
        if let Some(known) = self.opposite.get(&class) {
            return *known;
        }
        let own = self.known(Shape::Other(Node::Unary(Function::Negate, NodeId(class))));
        self.opposite.extend([(class, own), (own, class)]);
        own
    }
}

fn is_commutative(operator: Operator) -> bool {
    matches!(operator, Operator::Add | Operator::Multiply | Operator::Min | Operator::Max)
}

#[cfg(test)]
mod tests {
    use crate::check::check_text;

    /// In how many orders an energy is another expression.
    fn n_orders(energy: &str) -> usize {
        let text = format!("potential p\nf(x) = x^2 + 1/x\n{energy}\n");
        let (_, model) = check_text(&text).unwrap();
        model.variant(3).unwrap().coupled_energies[0].orders.len()
    }

    #[test]
    fn what_is_the_same_in_every_order_stands_once() {
        for (energy, n) in [
            ("psi(a, l1, l2, l3) = a*(f(l1) + f(l2) + f(l3))", 1),
            ("psi(a, l1, l2, l3) = a^2/(l1*l2*l3)", 1),
            ("psi(angle) = f(angle)", 3),
            ("psi(angle, l1, l2) = f(angle)*f(l1)*f(l2)", 3),
            ("psi(angle, l1, l2) = f(angle)*exp(2 - l1/L1 - l2/L2)", 3),
            ("psi(angle, l1, l2) = f(angle)*exp(-(l1/L1 - 1) - (l2/L2 - 1))", 3),
            ("psi(l1, l2) = (l1 - l2)*exp(l1 + l2)", 6),
            ("psi(a, l1) = a*l1", 3),
            ("psi(l1, l2) = l1*l2", 3),
            ("psi(a, l1, l2) = a*l1^2/l2", 6),
            ("psi(v, a1, a2, a3, a4) = v*(a1*a2*a3*a4)", 1),
            ("psi(v, a1) = v*a1", 4),
            ("psi(v, l1, l2, l3) = v*l1*l2*l3", 4),
            ("psi(l1, l6) = l1*l6", 3),
            ("psi(a1, a2) = a1*a2", 6),
        ] {
            assert_eq!(n_orders(energy), n, "{energy}");
        }
    }
}
