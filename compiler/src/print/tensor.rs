//! Energies of the deformation gradient in tensors, in LaTeX.

use super::latex::Latex;
use super::number::{Numbers, joined, product, signed};
use super::{Binding, Names, Piece, is_numbered};
use crate::expression::{Input, Node, NodeId};
use crate::model::Model;
use crate::tensors::algebra::{inverted, transposed_word};
use crate::tensors::{Factor, Invariant, Tensor, TensorForm, Term};

/// Longer numbers in front of tensors get a symbol.
const LONGEST_COEFFICIENT: usize = 40;

/// Longer sums go on in the next row.
const LONGEST_ROW: usize = 280;

/// psi, `P = dpsi/dF` and `A : H`, what P changes by where F changes by H, as an `align*` environment
/// (package `amsmath`), and what their symbols mean.
pub fn tensor_latex(model: &Model, form: &TensorForm) -> String {
    let names = Names { model };
    let mut numbers = Numbers { form, latex: Latex { names }, symbols: Vec::new() };
    let written = form.named.iter().filter(|(node, _)| *node != form.psi);
    numbers.symbols = written.map(|(node, name)| (*node, Latex::symbol(name))).collect();
    for (node, name) in &form.rates {
        let symbol = Latex::symbol(name);
        let (stem, index) = symbol.split_at(symbol.find("_{").unwrap_or(symbol.len()));
        if numbers.symbols.iter().all(|(known, _)| known != node) {
            numbers.symbols.push((*node, format!(r"\dot{{{stem}}}{index}")));
        }
    }
    let n_written = numbers.symbols.len();
    let stem = stem(model, form);
    let mut number = 0;
    for term in &form.stress {
        let rate = form.product.iter().find(|known| known.word == term.word);
        let long = [Some(term), rate].map(|term| {
            term.map(|term| term.coefficient).filter(|node| {
                let is_known = numbers.symbols.iter().any(|(known, _)| known == node);
                !is_known && numbers.piece(*node).text.len() > LONGEST_COEFFICIENT
            })
        });
        number += u32::from(long != [None, None]);
        let symbols = [format!("{stem}_{{{number}}}"), format!(r"\dot{{{stem}}}_{{{number}}}")];
        for (node, symbol) in long.into_iter().zip(symbols) {
            numbers.symbols.extend(node.map(|node| (node, symbol)));
        }
    }
    let mut rows = vec![
        row(r"\psi", signed(numbers.definition(form.psi))),
        row(r"\boldsymbol{P}", terms(&numbers, &form.stress)),
        row(r"\mathbb{A} : \boldsymbol{H}", terms(&numbers, &form.product)),
    ];
    let roots = roots(form);
    let needed = form.algebra.graph.graph().reachable(&roots);
    for (k, (node, symbol)) in numbers.symbols.iter().enumerate() {
        if k >= n_written || needed[node.0 as usize] {
            rows.push(row(symbol, signed(numbers.definition(*node))));
        }
    }
    rows.extend(kinematics(&numbers, &needed));
    let (head, rest) = rows.split_at(3);
    let mut out = format!("\\begin{{align*}}\n{}", head.join(" \\\\\n"));
    if !rest.is_empty() {
        out.push_str(&format!("\n\\intertext{{where}}\n{}", rest.join(" \\\\\n")));
    }
    out.push_str("\n\\end{align*}\n");
    out
}

fn roots(form: &TensorForm) -> Vec<NodeId> {
    let coefficients = form.stress.iter().chain(&form.product).map(|term| term.coefficient);
    [form.psi].into_iter().chain(coefficients).collect()
}

/// `f`, or `ff` where something else is called `f_1`, and so on.
fn stem(model: &Model, form: &TensorForm) -> String {
    let mut stem = "f".to_string();
    let parameters = model.parameters().iter().map(|p| &p.name);
    let names: Vec<&String> = parameters.chain(form.named.iter().map(|(_, name)| name)).collect();
    while names.iter().any(|name| is_numbered(name, &stem)) {
        stem.push('f');
    }
    stem
}

/// `  name &= terms`, over several rows where they are long.
fn row(name: &str, terms: Vec<String>) -> String {
    let mut text = format!("  {name} &=");
    let mut length = 0;
    for term in terms {
        if length > 0 && length + term.len() > LONGEST_ROW {
            text.push_str(" \\\\\n  &\\quad");
            length = 0;
        }
        length += term.len();
        text.push(' ');
        text.push_str(&term);
    }
    text
}

/// What the letters mean that stand in the rows.
fn kinematics(numbers: &Numbers<'_>, needed: &[bool]) -> Vec<String> {
    let form = numbers.form;
    let mut letters: Vec<Factor> = Vec::new();
    let mut has_rate = false;
    for term in form.stress.iter().chain(&form.product) {
        collect(&term.word, &mut letters);
    }
    for (k, invariant) in form.algebra.invariants.iter().enumerate() {
        let is_needed = form.algebra.graph.graph().nodes().any(|(id, node)| {
            node == Node::Input(Input::Variable(k as u8))
                && needed.get(id.0 as usize) == Some(&true)
        });
        match invariant {
            Invariant::Trace(word) if is_needed => collect(word, &mut letters),
            Invariant::Determinant(tensor) if is_needed => {
                tensor.iter().for_each(|term| collect(&term.word, &mut letters));
            }
            Invariant::JacobianRate => has_rate |= is_needed,
            _ => {}
        }
    }
    let mut rows = Vec::new();
    let mut say = |name: &str, meaning: &str| rows.push(format!("  {name} &= {meaning}"));
    if has_rate {
        say(r"\dot{J}", &format!(r"J \, \operatorname{{tr}}\left({F}^{{-1}} {H}\right)"));
    }
    let rate = format!(r"{F}^{{\mathsf{{T}}}} {H} + {H}^{{\mathsf{{T}}}} {F}");
    let of_stretch = letters.iter().any(|x| matches!(x, Factor::OfStretchRate(_)));
    if letters.contains(&Factor::CauchyGreenRate) || of_stretch {
        say(r"\dot{\boldsymbol{C}}", &rate);
    }
    if letters.contains(&Factor::StrainRate) {
        say(r"\dot{\boldsymbol{E}}", &format!(r"\frac{{1}}{{2}} \left({rate}\right)"));
    }
    if of_stretch {
        say(
            r"\mathrm{D}\left[g(\boldsymbol{U})\right]",
            concat!(
                r"\sum_{i,j} \frac{g(s_i) - g(s_j)}{s_i^2 - s_j^2} \left(\boldsymbol{N}_i \cdot ",
                r"\dot{\boldsymbol{C}} \boldsymbol{N}_j\right) \boldsymbol{N}_i \otimes ",
                r"\boldsymbol{N}_j, \quad \boldsymbol{U} = \sum_i s_i \boldsymbol{N}_i \otimes ",
                r"\boldsymbol{N}_i, \quad \text{with } \frac{g'(s_i)}{2 s_i} \text{ where } s_i = s_j"
            ),
        );
    }
    for (k, vector) in form.algebra.vectors.iter().enumerate() {
        if letters.contains(&Factor::Dyad(k)) {
            let parts: Vec<String> = vector.iter().map(|x| numbers.piece(*x).text).collect();
            let (name, index) = (
                dyad(form, k),
                if form.algebra.vectors.len() > 1 {
                    format!("_{{{}}}", k + 1)
                } else {
                    String::new()
                },
            );
            let n = format!(r"\boldsymbol{{n}}{index}");
            say(&name, &format!(r"{n} \otimes {n}, \quad {n} = \left({}\right)", parts.join(", ")));
        }
    }
    rows
}

const F: &str = r"\boldsymbol{F}";
const H: &str = r"\boldsymbol{H}";

/// The letters of a product and of those within it.
fn collect(word: &[Factor], into: &mut Vec<Factor>) {
    for factor in word {
        match factor {
            Factor::Inverse(inner) => inner.iter().for_each(|term| collect(&term.word, into)),
            Factor::Deviator(inner) => collect(inner, into),
            _ => {}
        }
        into.push(factor.clone());
    }
}

fn dyad(form: &TensorForm, number: usize) -> String {
    match form.algebra.vectors.len() {
        1 => r"\boldsymbol{M}".to_string(),
        _ => format!(r"\boldsymbol{{M}}_{{{}}}", number + 1),
    }
}

/// The terms of a tensor with their signs.
pub(super) fn terms(numbers: &Numbers<'_>, tensor: &Tensor) -> Vec<String> {
    if tensor.is_empty() {
        return vec![r"\boldsymbol{0}".to_string()];
    }
    let term = |Term { coefficient, word: letters }: &Term| {
        let is_symbol = numbers.symbols.iter().any(|(known, _)| known == coefficient);
        let tensor = Piece::atom(word(numbers, letters));
        let parts = match is_symbol {
            true => vec![(false, numbers.piece(*coefficient))],
            false => numbers.definition(*coefficient),
        };
        match &parts[..] {
            [(is_negative, piece)] if piece.text == "1" => (*is_negative, tensor),
            [(is_negative, piece)] => (*is_negative, product(vec![piece.clone(), tensor])),
            _ => (false, product(vec![joined(parts), tensor])),
        }
    };
    signed(tensor.iter().map(term).collect())
}

/// A product of letters, equal ones beside each other as powers.
pub(super) fn word(numbers: &Numbers<'_>, letters: &[Factor]) -> String {
    if letters.is_empty() {
        return r"\boldsymbol{I}".to_string();
    }
    let mut texts = Vec::new();
    let mut rest = letters;
    while let Some(first) = rest.first() {
        let n = rest.iter().take_while(|next| *next == first).count();
        rest = &rest[n..];
        texts.push(power(numbers, first, n));
    }
    texts.join(r" \, ")
}

fn power(numbers: &Numbers<'_>, factor: &Factor, n: usize) -> String {
    let (letter, sign) = match inverted(factor) {
        Some(inner) => (inner, "-"),
        None => (factor, ""),
    };
    let is_transposed = matches!(letter, Factor::GradientTransposed | Factor::DirectionTransposed);
    let plain = match is_transposed {
        true => letter_text(numbers, &transposed_word(std::slice::from_ref(letter))[0]),
        false => letter_text(numbers, letter),
    };
    let exponent = match (sign, is_transposed, n) {
        ("", false, 1) => return plain,
        (_, true, 1) => format!(r"{sign}\mathsf{{T}}"),
        (_, true, n) => return vec![power(numbers, factor, 1); n].join(r" \, "),
        (_, false, n) => format!("{sign}{n}"),
    };
    let is_symbol = plain.starts_with(r"\boldsymbol") || plain.starts_with(r"\dot");
    match is_symbol && !plain.contains(['^', ' ']) {
        true => format!("{plain}^{{{exponent}}}"),
        false => format!(r"\left({plain}\right)^{{{exponent}}}"),
    }
}

fn letter_text(numbers: &Numbers<'_>, factor: &Factor) -> String {
    match factor {
        Factor::Gradient | Factor::GradientTransposed => F.to_string(),
        Factor::Direction | Factor::DirectionTransposed => H.to_string(),
        Factor::CauchyGreen => r"\boldsymbol{C}".to_string(),
        Factor::Strain => r"\boldsymbol{E}".to_string(),
        Factor::CauchyGreenRate => r"\dot{\boldsymbol{C}}".to_string(),
        Factor::StrainRate => r"\dot{\boldsymbol{E}}".to_string(),
        Factor::Dyad(number) => dyad(numbers.form, *number),
        Factor::OfStretch(function) => {
            let piece = numbers.piece(*function);
            match piece.binding < Binding::Product {
                true => format!(r"\left({}\right)", piece.text),
                false => piece.text,
            }
        }
        Factor::OfStretchRate(function) => {
            format!(r"\mathrm{{D}}\left[{}\right]", numbers.piece(*function).text)
        }
        Factor::Inverse(tensor) => {
            format!(r"\left({}\right)^{{-1}}", terms(numbers, tensor).join(" "))
        }
        Factor::Deviator(letters) => {
            format!(r"\operatorname{{dev}}\left({}\right)", word(numbers, letters))
        }
    }
}
