//! Graphs in LaTeX.

use super::{Binding, Names, Notation, Piece, lines};
use crate::breaking::{BondFunction, BondFunctionKind};
use crate::clique::Part;
use crate::expression::{Comparison, Function, Input, Operator};
use crate::model::Model;
use crate::specialise::ScalarEnergy;

/// psi, psi' and psi'' as an `align*` environment.
pub fn latex(model: &Model, energy: &ScalarEnergy) -> String {
    let symbol = energy.measure.symbol();
    let names = ["", "'", "''"].map(|primes| format!(r"\psi{primes}({symbol})"));
    let roots: Vec<_> = names.into_iter().zip(energy.roots).collect();
    let rows: Vec<String> = lines(&energy.graph, &roots, &Latex { names: Names { model } })
        .into_iter()
        .map(|(name, expression)| format!("  {name} &= {expression}"))
        .collect();
    format!("\\begin{{align*}}\n{}\n\\end{{align*}}\n", rows.join(" \\\\\n"))
}

/// When bonds, triangles and tetrahedra break and what they remember, in one `align*` environment; nothing where they do neither.
pub fn latex_of_bonds(model: &Model, functions: &[BondFunction]) -> String {
    let mut rows = Vec::new();
    for BondFunction { kind, function, .. } in functions {
        let name = match kind {
            BondFunctionKind::Margin { number, .. } => format!("g_{{{number}}}"),
            BondFunctionKind::Next(state) => next(state),
            BondFunctionKind::Dissipation => r"R(\dot{l})".to_string(),
        };
        let mut roots = vec![(name, function.roots[0])];
        if *kind == BondFunctionKind::Dissipation {
            roots.extend(
                ["'", "''"]
                    .map(|primes| format!(r"R{primes}(\dot{{l}})"))
                    .into_iter()
                    .zip(function.roots[1..].iter().copied()),
            );
        }
        for (name, expression) in lines(&function.graph, &roots, &Latex { names: Names { model } })
        {
            rows.push(format!("  {name} &= {expression}"));
        }
        if let BondFunctionKind::Margin { number, holds_at_zero } = kind {
            let sign = if *holds_at_zero { r"\ge" } else { ">" };
            let what = function.measure.interaction();
            rows.push(format!(r"  &\text{{a {what} breaks where }} g_{{{number}}} {sign} 0"));
        }
    }
    match rows.is_empty() {
        true => String::new(),
        false => format!("\\begin{{align*}}\n{}\n\\end{{align*}}\n", rows.join(" \\\\\n")),
    }
}

pub(super) struct Latex<'a> {
    pub(super) names: Names<'a>,
}

const GREEK: &[&str] = &[
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa",
    "lambda", "mu", "nu", "xi", "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi",
    "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Phi", "Psi", "Omega",
];

impl Latex<'_> {
    fn wrap(&self, piece: Piece, least: Binding) -> String {
        if piece.binding < least { format!(r"\left({}\right)", piece.text) } else { piece.text }
    }

    /// `C1` as `C_{1}`, `lambda` as `\lambda`.
    pub(super) fn symbol(name: &str) -> String {
        let end = name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        let (stem, digits) = name.split_at(end);
        let (stem, rest) = match stem.split_once('_') {
            Some((stem, rest)) => (stem, format!("{rest}{digits}")),
            None => (stem, digits.to_string()),
        };
        let stem = if GREEK.contains(&stem) {
            format!(r"\{stem}")
        } else if stem.chars().count() == 1 {
            stem.to_string()
        } else {
            format!(r"\mathrm{{{stem}}}")
        };
        let rest = rest.replace('_', ",");
        if rest.is_empty() { stem } else { format!("{stem}_{{{rest}}}") }
    }
}

impl Latex<'_> {
    /// What the other end of a bond gathers.
    pub(super) fn neighbour(k: u8) -> String {
        format!("I'_{{{}}}", k + 1)
    }

    /// A measure of an interaction, or a component of `xi - Xi`.
    pub(super) fn part(part: Part) -> String {
        match part {
            Part::Moved(k) => format!(r"(\xi_{{{0}}} - \Xi_{{{0}}})", k + 1),
            part => Self::symbol(part.symbol()),
        }
    }
}

impl Notation for Latex<'_> {
    fn number(&self, value: f64) -> Piece {
        let text = match value.abs() {
            v if v.is_nan() => r"\mathrm{NaN}".to_string(),
            v if v.is_infinite() => r"\infty".to_string(),
            v if v == 0.0 || (1e-4..1e7).contains(&v) => format!("{v}"),
            v => {
                let text = format!("{v:e}");
                let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
                format!(r"{mantissa} \cdot 10^{{{exponent}}}")
            }
        };
        let binding = if text.contains("cdot") { Binding::Product } else { Binding::Atom };
        if value < 0.0 {
            Piece { text: format!("-{text}"), binding: Binding::Negation }
        } else {
            Piece { text, binding }
        }
    }

    fn input(&self, input: Input) -> Piece {
        match input {
            Input::Change(m) => Piece {
                text: format!(r"\frac{{{}}}{{{}}} - 1", m.symbol(), m.reference_symbol()),
                binding: Binding::Sum,
            },
            Input::Rate => Piece::atom(r"\dot{l}".to_string()),
            Input::Parameter(number) if let Some(axis) = self.names.axis(number) => {
                Piece::atom(format!(r"(\Xi_{{{axis}}}/L)"))
            }
            Input::Part(part @ Part::Moved(_)) => Piece::atom(Self::part(part)),
            Input::Neighbour(k) => Piece::atom(Self::neighbour(k)),
            other => Piece::atom(Self::symbol(&self.names.input(other))),
        }
    }

    fn temporary(&self, number: usize) -> Piece {
        Piece::atom(Self::symbol(&self.names.temporary(number)))
    }

    fn unary(&self, function: Function, x: Piece) -> Piece {
        let name = match function {
            Function::Negate => {
                let text = format!("-{}", self.wrap(x, Binding::Power));
                return Piece { text, binding: Binding::Negation };
            }
            Function::Sqrt => return Piece::atom(format!(r"\sqrt{{{}}}", x.text)),
            Function::Abs => return Piece::atom(format!(r"\left|{}\right|", x.text)),
            Function::Sign
            | Function::Log1p
            | Function::Expm1
            | Function::Log1pmx
            | Function::Erf => {
                format!(r"\operatorname{{{}}}", function.name())
            }
            Function::Asin | Function::Acos | Function::Atan => {
                format!(r"\arc{}", &function.name()[1..])
            }
            other => format!(r"\{}", other.name()),
        };
        Piece::atom(format!(r"{name}\left({}\right)", x.text))
    }

    fn power(&self, x: Piece, y: Piece) -> Piece {
        let text = format!("{}^{{{}}}", self.wrap(x, Binding::Atom), y.text);
        Piece { text, binding: Binding::Power }
    }

    fn binary(&self, operator: Operator, x: Piece, y: Piece) -> Piece {
        use Binding::{Negation, Product, Sum};
        let (text, binding) = match operator {
            Operator::Add => (format!("{} + {}", self.wrap(x, Sum), self.wrap(y, Product)), Sum),
            Operator::Subtract => {
                (format!("{} - {}", self.wrap(x, Sum), self.wrap(y, Product)), Sum)
            }
            Operator::Multiply => {
                let (x, y) = (self.wrap(x, Product), self.wrap(y, Negation));
                // Two numbers side by side would read as one.
                let digit = |text: &str| text.starts_with(|c: char| c.is_ascii_digit());
                let dot = if digit(&y) || y.starts_with('-') { r" \cdot " } else { r" \, " };
                (format!("{x}{dot}{y}"), Product)
            }
            Operator::Divide => {
                return Piece {
                    text: format!(r"\frac{{{}}}{{{}}}", x.text, y.text),
                    binding: Product,
                };
            }
            Operator::Power => return self.power(x, y),
            Operator::Min | Operator::Max => {
                let text = format!(r"\{}\left({}, {}\right)", operator.name(), x.text, y.text);
                return Piece::atom(text);
            }
            Operator::Atan2 => {
                let text = format!(r"\operatorname{{atan2}}\left({}, {}\right)", x.text, y.text);
                return Piece::atom(text);
            }
        };
        Piece { text, binding }
    }

    fn compare(&self, comparison: Comparison, x: Piece, y: Piece) -> Piece {
        let sign = match comparison {
            Comparison::Equal => "=",
            Comparison::NotEqual => r"\ne",
            Comparison::Less => "<",
            Comparison::LessEqual => r"\le",
            Comparison::Greater => ">",
            Comparison::GreaterEqual => r"\ge",
        };
        Piece { text: format!("{} {sign} {}", x.text, y.text), binding: Binding::Comparison }
    }

    fn and(&self, x: Piece, y: Piece) -> Piece {
        let (x, y) = (self.wrap(x, Binding::And), self.wrap(y, Binding::And));
        Piece { text: format!(r"{x} \wedge {y}"), binding: Binding::And }
    }

    fn or(&self, x: Piece, y: Piece) -> Piece {
        let (x, y) = (self.wrap(x, Binding::Or), self.wrap(y, Binding::Or));
        Piece { text: format!(r"{x} \vee {y}"), binding: Binding::Or }
    }

    fn not(&self, x: Piece) -> Piece {
        Piece { text: format!(r"\neg {}", self.wrap(x, Binding::Atom)), binding: Binding::Not }
    }

    fn select(&self, c: Piece, x: Piece, y: Piece) -> Piece {
        Piece::atom(format!(
            r"\begin{{cases}} {} & {} \\ {} & \text{{otherwise}} \end{{cases}}",
            x.text, c.text, y.text
        ))
    }
}

/// What a state becomes.
pub(super) fn next(state: &str) -> String {
    format!(r"{}^{{\text{{next}}}}", Latex::symbol(state))
}
