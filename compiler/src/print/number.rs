//! Numbers of a tensor form in LaTeX: invariants, parameters and functions of the right stretch tensor.

use super::latex::Latex;
use super::tensor::word;
use super::{Binding, Notation, Piece};
use crate::expression::{Function, Input, Node, NodeId, Operator};
use crate::tensors::monomial::{Exponent, Monomial, Ratio, Sums};
use crate::tensors::{Factor, Invariant, TensorForm};

/// Sets the numbers of a form.
pub(super) struct Numbers<'a> {
    pub(super) form: &'a TensorForm,
    pub(super) latex: Latex<'a>,
    /// Nodes that are written as a symbol, and that symbol in LaTeX.
    pub(super) symbols: Vec<(NodeId, String)>,
}

impl Numbers<'_> {
    /// The terms of a node with their signs; of one that has a symbol, what that stands for.
    pub(super) fn definition(&self, node: NodeId) -> Vec<(bool, Piece)> {
        let is_named = |node| self.symbols.iter().any(|(known, _)| *known == node);
        let algebra = &self.form.algebra;
        let sums = Sums {
            graph: algebra.graph.graph(),
            is_named: &is_named,
            is_multiplied_out: &|node| algebra.is_jacobian(node),
            are_numbers_multiplied_out: false,
        };
        let terms = sums.terms_of(node);
        if let [only] = &terms[..]
            && only.factors[..] == [(node, Exponent::ONE)]
            && only.coefficient == Ratio::ONE
        {
            return vec![(false, self.meaning(node))];
        }
        let tensor = terms.iter().any(|term| self.is_tensor(term));
        terms.iter().map(|term| self.monomial(term, tensor)).collect()
    }

    /// A node as one piece.
    pub(super) fn piece(&self, node: NodeId) -> Piece {
        if let Some((_, symbol)) = self.symbols.iter().find(|(known, _)| *known == node) {
            return Piece::atom(symbol.clone());
        }
        joined(self.definition(node))
    }

    /// Whether it is a function of `U` and no number.
    fn is_tensor(&self, term: &Monomial) -> bool {
        let graph = self.form.algebra.graph.graph();
        term.factors.iter().any(|(base, _)| {
            let needed = graph.reachable(&[*base]);
            graph
                .nodes()
                .any(|(id, node)| needed[id.0 as usize] && node == Node::Input(Input::Stretch(0)))
        })
    }

    /// A term and whether it is subtracted; in a sum of tensors a number is that many unit tensors.
    fn monomial(&self, term: &Monomial, tensor: bool) -> (bool, Piece) {
        let coefficient = term.coefficient;
        let is_negative = coefficient.numerator < 0.0;
        let (mut above, mut below, mut behind) = (Vec::new(), Vec::new(), Vec::new());
        for (base, exponent) in &term.factors {
            let alone = Monomial { coefficient: Ratio::ONE, factors: vec![(*base, *exponent)] };
            let divides = exponent.symbol.is_none()
                && exponent.number.is_whole()
                && exponent.number.numerator < 0.0
                && !self.is_tensor(&alone);
            if divides {
                let number = Ratio { numerator: -exponent.number.numerator, denominator: 1.0 };
                below.push(self.power(*base, Exponent { number, ..*exponent }));
            } else if self.rank(*base) == 0 {
                above.push(self.power(*base, *exponent));
            } else {
                behind.push((self.rank(*base), self.power(*base, *exponent)));
            }
        }
        behind.sort_by_key(|(rank, _)| *rank);
        let mut behind: Vec<Piece> = behind.into_iter().map(|(_, piece)| piece).collect();
        if tensor && !self.is_tensor(term) {
            behind.push(Piece::atom(r"\boldsymbol{I}"));
        }
        let numerator = coefficient.numerator.abs();
        let is_fraction = !below.is_empty() || coefficient.denominator != 1.0;
        if is_fraction && above.is_empty() && numerator == 1.0 && behind.len() == 1 && !tensor {
            above.append(&mut behind);
        }
        let count = |x: f64| (x != 1.0).then(|| self.latex.number(x));
        let mut all: Vec<Piece> = Vec::new();
        if is_fraction {
            let above = product(count(numerator).into_iter().chain(above).collect());
            let below = product(count(coefficient.denominator).into_iter().chain(below).collect());
            all.push(Piece {
                text: format!(r"\frac{{{}}}{{{}}}", above.text, below.text),
                binding: Binding::Product,
            });
        } else {
            all.extend(count(numerator).into_iter().chain(above));
        }
        all.append(&mut behind);
        (is_negative, product(all))
    }

    /// Parameters and symbols stand first, sums last.
    fn rank(&self, node: NodeId) -> u8 {
        if self.symbols.iter().any(|(known, _)| *known == node) {
            return 1;
        }
        match self.form.algebra.graph.graph()[node] {
            Node::Number(_) | Node::Input(Input::Parameter(_) | Input::Horizon) => 0,
            Node::Input(_) => 1,
            Node::Binary(Operator::Add | Operator::Subtract, ..) => 3,
            _ => 2,
        }
    }

    fn power(&self, base: NodeId, exponent: Exponent) -> Piece {
        let base = self.base(base);
        if exponent == Exponent::ONE {
            return base;
        }
        let text = match base.binding {
            Binding::Atom => base.text,
            _ => format!(r"\left({}\right)", base.text),
        };
        let text = format!("{text}^{{{}}}", self.exponent(exponent));
        Piece { text, binding: Binding::Power }
    }

    /// `\alpha/3 - 2`
    fn exponent(&self, exponent: Exponent) -> String {
        let inline = |ratio: Ratio| match ratio.denominator {
            1.0 => self.latex.number(ratio.numerator).text,
            q => format!("{}/{q}", ratio.numerator),
        };
        let Some((factor, node)) = exponent.symbol else { return inline(exponent.number) };
        let sign = if factor.numerator < 0.0 { "-" } else { "" };
        let count = match factor.numerator.abs() {
            1.0 => String::new(),
            p => format!("{} ", self.latex.number(p).text),
        };
        let over = match factor.denominator {
            1.0 => String::new(),
            q => format!("/{q}"),
        };
        let piece = self.piece(node);
        let is_alone = sign.is_empty() && count.is_empty() && over.is_empty();
        let text = match is_alone || piece.binding > Binding::Sum {
            true => piece.text,
            false => format!(r"\left({}\right)", piece.text),
        };
        let number = match exponent.number {
            number if number.is_zero() => String::new(),
            number if number.numerator < 0.0 => {
                let size = Ratio { numerator: -number.numerator, ..number };
                format!(" - {}", inline(size))
            }
            number => format!(" + {}", inline(number)),
        };
        format!("{sign}{count}{text}{over}{number}")
    }

    /// What no product is: a symbol, a function, a sum.
    fn base(&self, node: NodeId) -> Piece {
        if let Some((_, symbol)) = self.symbols.iter().find(|(known, _)| *known == node) {
            return Piece::atom(symbol.clone());
        }
        self.meaning(node)
    }

    /// The same, whether or not it has a symbol.
    fn meaning(&self, node: NodeId) -> Piece {
        let piece = |x| self.piece(x);
        match self.form.algebra.graph.graph()[node] {
            Node::Input(Input::Variable(k)) => self.invariant(usize::from(k)),
            Node::Input(Input::Stretch(_)) => Piece::atom(r"\boldsymbol{U}"),
            Node::Input(input) => self.latex.input(input),
            Node::Number(bits) => self.latex.number(f64::from_bits(bits)),
            Node::Unary(Function::Negate, _) => self.piece(node),
            Node::Unary(function, x) => self.latex.unary(function, piece(x)),
            Node::Binary(operator @ (Operator::Min | Operator::Max | Operator::Atan2), x, y) => {
                self.latex.binary(operator, piece(x), piece(y))
            }
            Node::Compare(comparison, x, y) => self.latex.compare(comparison, piece(x), piece(y)),
            Node::And(x, y) => self.latex.and(self.base(x), self.base(y)),
            Node::Or(x, y) => self.latex.or(self.base(x), self.base(y)),
            Node::Not(x) => self.latex.not(self.base(x)),
            Node::Select(c, x, y) => self.latex.select(self.base(c), piece(x), piece(y)),
            Node::Truth(holds) => Piece::atom(if holds { r"\top" } else { r"\bot" }),
            Node::Strain(..) | Node::PowerConstant(..) | Node::Binary(..) => self.piece(node),
        }
    }

    fn invariant(&self, number: usize) -> Piece {
        match &self.form.algebra.invariants[number] {
            Invariant::Jacobian => Piece::atom("J"),
            Invariant::JacobianRate => Piece::atom(r"\dot{J}"),
            Invariant::Trace(letters) => {
                let dyad = letters.iter().position(|x| matches!(x, Factor::Dyad(_)));
                match dyad {
                    Some(k) if letters.len() > 1 => {
                        let rest = [&letters[k + 1..], &letters[..k]].concat();
                        let text =
                            format!("{} : {}", word(self, &rest), word(self, &letters[k..=k]));
                        Piece { text, binding: Binding::Sum }
                    }
                    _ => Piece::atom(format!(
                        r"\operatorname{{tr}}\left({}\right)",
                        word(self, letters)
                    )),
                }
            }
            Invariant::Determinant(tensor) => Piece::atom(format!(
                r"\det\left({}\right)",
                super::tensor::terms(self, tensor).join(" ")
            )),
            Invariant::OfStretch(function) => Piece::atom(format!(
                r"\operatorname{{tr}}\left({}\right)",
                self.piece(*function).text
            )),
        }
    }
}

/// Factors side by side.
pub(super) fn product(factors: Vec<Piece>) -> Piece {
    let n = factors.len();
    let mut factors = factors.into_iter();
    let Some(first) = factors.next() else { return Piece::atom("1") };
    if n == 1 {
        return first;
    }
    let wrap = |piece: Piece| match piece.binding < Binding::Product {
        true => format!(r"\left({}\right)", piece.text),
        false => piece.text,
    };
    let mut text = wrap(first);
    for factor in factors {
        let factor = wrap(factor);
        // Two numbers side by side would read as one.
        let dot =
            if factor.starts_with(|c: char| c.is_ascii_digit()) { r" \cdot " } else { r" \, " };
        text.push_str(dot);
        text.push_str(&factor);
    }
    Piece { text, binding: Binding::Product }
}

/// A sum of terms of which some are subtracted.
pub(super) fn joined(terms: Vec<(bool, Piece)>) -> Piece {
    if terms.is_empty() {
        return Piece::atom("0");
    }
    if let [(is_negative, piece)] = &terms[..] {
        return match is_negative {
            true => Piece { text: format!("-{}", piece.text), binding: Binding::Sum },
            false => piece.clone(),
        };
    }
    Piece { text: signed(terms).join(" "), binding: Binding::Sum }
}

/// Terms with their signs in front, but for a plus in front of the first.
pub(super) fn signed(terms: Vec<(bool, Piece)>) -> Vec<String> {
    let term = |(k, (is_negative, piece)): (usize, (bool, Piece))| match (k, is_negative) {
        (0, false) => piece.text,
        (0, true) => format!("-{}", piece.text),
        (_, false) => format!("+ {}", piece.text),
        (_, true) => format!("- {}", piece.text),
    };
    terms.into_iter().enumerate().map(term).collect()
}
