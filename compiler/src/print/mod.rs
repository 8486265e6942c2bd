//! Graphs as text: the piola language, LaTeX, C, and a plain listing of nodes.
//!
//! Expressions are printed once each: a part that is used more than once, or that grows too long for
//! a line, gets a name of its own (`t1 = ..`), so the text is never larger than the graph.

mod c;
mod coupled;
mod gathered;
#[cfg(test)]
mod gathered_tests;
mod gradient;
mod latex;
mod listing;
mod number;
mod tensor;
#[cfg(test)]
mod tensor_tests;
#[cfg(test)]
mod tests;
mod text;

pub use c::{c_of_bonds, c_of_gradient_functions, c_source};
pub use coupled::{coupled_c, coupled_latex, coupled_listing, coupled_text};
pub use gathered::{gathered_c, gathered_latex, gathered_listing, gathered_text};
pub use gradient::{gradient_latex, gradient_listing, gradient_text, latex_of_gradient_functions};
pub use latex::{latex, latex_of_bonds};
pub use listing::{graph_listing, model_listing};
pub use tensor::tensor_latex;
pub use text::{expression, quoted, text};

use crate::expression::{Comparison, ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::measure::Measure;
use crate::model::{DIRECTIONS, Model};

/// Longest piece that is written in place where it is used more than once.
const LONGEST_REPEATED: usize = 16;
/// Longest piece that is written in place at all: what is densest, `l^-l^-l`, nests two levels in
/// three characters and must stay below [`piola_grammar::MAX_NESTING`].
const LONGEST_PIECE: usize = 300;

/// How tightly the outermost operation of a piece binds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Condition,
    Or,
    And,
    Not,
    Comparison,
    Sum,
    Product,
    Negation,
    Power,
    Atom,
}

/// A printed part of an expression.
#[derive(Clone, Debug)]
struct Piece {
    text: String,
    binding: Binding,
}

impl Piece {
    fn atom(text: impl Into<String>) -> Piece {
        Piece { text: text.into(), binding: Binding::Atom }
    }
}

/// How operations are written.
trait Notation {
    fn number(&self, value: f64) -> Piece;
    fn input(&self, input: Input) -> Piece;
    fn temporary(&self, number: usize) -> Piece;
    fn unary(&self, function: Function, x: Piece) -> Piece;
    fn power(&self, x: Piece, y: Piece) -> Piece;
    fn binary(&self, operator: Operator, x: Piece, y: Piece) -> Piece;
    fn compare(&self, comparison: Comparison, x: Piece, y: Piece) -> Piece;
    fn and(&self, x: Piece, y: Piece) -> Piece;
    fn or(&self, x: Piece, y: Piece) -> Piece;
    fn not(&self, x: Piece) -> Piece;
    fn select(&self, c: Piece, x: Piece, y: Piece) -> Piece;
}

/// Lines `(name, expression)`: temporaries in order, then one line per root.
fn lines(
    graph: &ExprGraph,
    roots: &[(String, NodeId)],
    notation: &impl Notation,
) -> Vec<(String, String)> {
    lines_within(graph, roots, notation, LONGEST_REPEATED)
}

/// The same where pieces of this length are still written in place where they are used more than once.
fn lines_within(
    graph: &ExprGraph,
    roots: &[(String, NodeId)],
    notation: &impl Notation,
    longest_repeated: usize,
) -> Vec<(String, String)> {
    let needed = graph.reachable(&roots.iter().map(|r| r.1).collect::<Vec<_>>());
    let mut uses = vec![0_usize; graph.len()];
    for (id, node) in graph.nodes() {
        if needed[id.0 as usize] {
            node.operands().for_each(|x| uses[x.0 as usize] += 1);
        }
    }
    for (_, root) in roots {
        uses[root.0 as usize] += 1;
    }
    let mut lines = Vec::new();
    let mut pieces: Vec<Option<Piece>> = vec![None; graph.len()];
    for (id, node) in graph.nodes() {
        if !needed[id.0 as usize] {
            continue;
        }
        let mut piece = print_node(node, &mut pieces, &uses, notation);
        let length = piece.text.chars().count();
        let repeated = uses[id.0 as usize] > 1 && length > longest_repeated;
        if repeated || length > LONGEST_PIECE {
            let name = notation.temporary(lines.len() + 1);
            lines.push((name.text.clone(), std::mem::replace(&mut piece, name).text));
        }
        pieces[id.0 as usize] = Some(piece);
    }
    for (name, root) in roots {
        let piece = pieces[root.0 as usize].clone().expect("roots are needed");
        lines.push((name.clone(), piece.text));
    }
    lines
}

fn print_node(
    node: Node,
    pieces: &mut [Option<Piece>],
    uses: &[usize],
    notation: &impl Notation,
) -> Piece {
    // The last reader of a piece takes it: long chains are not copied.
    let mut take = |x: NodeId| {
        let slot = &mut pieces[x.0 as usize];
        let piece = if uses[x.0 as usize] == 1 { slot.take() } else { slot.clone() };
        piece.expect("operands come first")
    };
    match node {
        Node::Number(bits) => notation.number(f64::from_bits(bits)),
        Node::Truth(true) => notation.compare(Comparison::Less, number("0"), number("1")),
        Node::Truth(false) => notation.compare(Comparison::Less, number("1"), number("0")),
        Node::Input(input) => notation.input(input),
        Node::Unary(function, x) => notation.unary(function, take(x)),
        Node::PowerConstant(x, bits) => {
            let base = take(x);
            notation.power(base, notation.number(f64::from_bits(bits)))
        }
        Node::Strain(x, bits) if f64::from_bits(bits) == 0.0 => {
            notation.unary(Function::Ln, take(x))
        }
        Node::Strain(x, bits) => {
            let order = || notation.number(f64::from_bits(bits));
            let power = notation.power(take(x), order());
            let difference = notation.binary(Operator::Subtract, power, number("1"));
            notation.binary(Operator::Divide, difference, order())
        }
        Node::Binary(operator, x, y) => {
            let (x, y) = take_both(&mut take, x, y);
            match operator {
                Operator::Power => notation.power(x, y),
                _ => notation.binary(operator, x, y),
            }
        }
        Node::Compare(comparison, x, y) => {
            let (x, y) = take_both(&mut take, x, y);
            notation.compare(comparison, x, y)
        }
        Node::And(x, y) => {
            let (x, y) = take_both(&mut take, x, y);
            notation.and(x, y)
        }
        Node::Or(x, y) => {
            let (x, y) = take_both(&mut take, x, y);
            notation.or(x, y)
        }
        Node::Not(x) => notation.not(take(x)),
        Node::Select(c, x, y) => {
            let (x, y) = take_both(&mut take, x, y);
            notation.select(take(c), x, y)
        }
    }
}

fn take_both(take: &mut impl FnMut(NodeId) -> Piece, x: NodeId, y: NodeId) -> (Piece, Piece) {
    let first = take(x);
    let second = take(y);
    (first, second)
}

fn number(text: &str) -> Piece {
    Piece::atom(text)
}

/// The names of a potential's inputs.
struct Names<'a> {
    model: &'a Model,
}

impl Names<'_> {
    fn input(&self, input: Input) -> String {
        match input {
            Input::Current(m) => m.symbol().to_string(),
            Input::Reference(m) => m.reference_symbol().to_string(),
            Input::Change(m) => format!("({}/{} - 1)", m.symbol(), m.reference_symbol()),
            Input::Part(part) => part.symbol().to_string(),
            Input::PartAtRest(part) => part.reference_symbol().to_string(),
            Input::PartChange(part) => {
                format!("({}/{} - 1)", part.symbol(), part.reference_symbol())
            }
            Input::Rate => "rate(l)".to_string(),
            Input::Horizon => "delta".to_string(),
            Input::Variable(k) => component("F", k),
            Input::VariableChange(k) => component("H", k),
            Input::Trace(k) => format!("T{}", k + 1),
            Input::Stretch(k) => format!("s{}", k + 1),
            Input::StretchChange(k) => format!("e{}", k + 1),
            Input::LeftAxis(k) => component("n", k),
            Input::RightAxis(k) => component("N", k),
            Input::Integral(k) => format!("I{}", k + 1),
            Input::Neighbour(k) => format!("neighbour(I{})", k + 1),
            Input::Multiplier(k) => format!("A{}", k + 1),
            Input::Direction(k) => component("dF", k),
            Input::Parameter(i) => self.model.input_name(usize::from(i)).to_string(),
        }
    }

    /// Which component of the direction of a bond an input is, from 1.
    fn axis(&self, number: u16) -> Option<usize> {
        self.model.directions(DIRECTIONS).position(|own| own == number).map(|axis| axis + 1)
    }

    /// The name of a part: `t1`, or `tt1` where a parameter is called `t1` or `t_1`, and so on.
    fn temporary(&self, number: usize) -> String {
        let mut stem = "t".to_string();
        let parameters = self.model.parameters();
        while parameters.iter().any(|p| is_numbered(&p.name, &stem)) {
            stem.push('t');
        }
        format!("{stem}{number}")
    }
}

/// `F12`
fn component(tensor: &str, k: u8) -> String {
    format!("{tensor}{}{}", k / 3 + 1, k % 3 + 1)
}

/// Whether a name is this stem with a number behind it.
fn is_numbered(name: &str, stem: &str) -> bool {
    let rest = name.strip_prefix(stem).map(|rest| rest.trim_start_matches('_'));
    rest.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit()))
}

/// `psi(l)`, `psi'(l)`, `psi''(l)`.
fn root_names(measure: Measure) -> [String; 3] {
    ["", "'", "''"].map(|primes| format!("psi{primes}({})", measure.symbol()))
}
