//! What points gather, and energies, conditions and next states of it, with their derivatives: as text, LaTeX,
//! listings, C.

use std::fmt::Write as _;

use super::c::{self, statements};
use super::latex::{self, Latex};
use super::text::Text;
use super::{Names, lines};
use crate::clique::Part;
use crate::expression::{ExprGraph, Input, Node, NodeId};
use crate::gathered::{GatheredForms, GatheredFunction, GatheredFunctionKind as Kind};
use crate::model::Model;

/// Named roots of a graph.
type Roots = Vec<(String, NodeId)>;

/// How a notation names things.
struct Words {
    /// `f1(l)`, with so many primes.
    integrand: fn(usize, &str) -> String,
    /// `f1`: the integrand, or the value, that a multiplier stands before.
    multiplied: fn(&Kind, u8) -> String,
    /// An energy by its head.
    energy: fn(&str) -> String,
    /// A derivative by a variable: of an energy, of a sum with multipliers.
    derivative: fn(&str, Input) -> String,
    margin: fn(usize) -> String,
    next: fn(&str) -> String,
}

/// What there is to print of a function, without derivatives that are 0 everywhere.
fn roots(function: &GatheredFunction, words: &Words) -> Roots {
    let form = &function.form;
    let is_nothing = |root: NodeId| form.graph[root] == Node::Number(0);
    let derivatives = function.variables.iter().copied().zip(form.gradient.iter().copied());
    let (symbol, value) = match &function.kind {
        Kind::Integrands => ("f", None),
        Kind::Functions => ("s", None),
        Kind::Energy { .. } => ("psi", Some((words.energy)(&head(function)))),
        Kind::Margin { number, .. } => return vec![((words.margin)(*number), form.psi)],
        Kind::Next(state) => return vec![((words.next)(state), form.psi)],
    };
    let mut found: Roots = value.into_iter().map(|name| (name, form.psi)).collect();
    let mut others = Roots::new();
    for (variable, root) in derivatives {
        match variable {
            Input::Multiplier(k) => found.push(((words.multiplied)(&function.kind, k), root)),
            _ if is_nothing(root) => {}
            _ => others.push(((words.derivative)(symbol, variable), root)),
        }
    }
    found.extend(others);
    found
}

/// `l, m`; where there are several energies, `theta) + psi(m`.
fn head(function: &GatheredFunction) -> String {
    function.text.replace("), psi(", ") + psi(")
}

/// What the letters of a function mean.
fn legend(function: &GatheredFunction) -> Option<String> {
    let sum = |symbol: &str| {
        let term = |input: &Input| match input {
            Input::Multiplier(k) => Some(format!("A{0}*{symbol}{0}", k + 1)),
            _ => None,
        };
        function.variables.iter().filter_map(term).collect::<Vec<_>>().join(" + ")
    };
    let neighbour = |input: &Input| matches!(input, Input::Neighbour(_));
    match function.kind {
        Kind::Integrands => {
            Some(format!("f = {}: what a bond holds where A1 is dpsi/dI1, and so on", sum("f")))
        }
        Kind::Functions => {
            Some(format!("s = {}: the same of what points work out of integrals", sum("I")))
        }
        _ if function.variables.iter().any(neighbour) => {
            Some("neighbour(I1) is what the other end of the bond gathers".to_string())
        }
        _ => None,
    }
}

/// What stands before a margin or a next state: the condition, or the next value, as written.
fn written(function: &GatheredFunction) -> Option<String> {
    match &function.kind {
        Kind::Margin { .. } => Some(format!("break when {}", function.text)),
        Kind::Next(state) => Some(format!("update {state} = {}", function.text)),
        _ => None,
    }
}

fn variable(input: Input) -> String {
    match input {
        Input::Part(Part::Moved(axis)) => format!("xi({})", axis + 1),
        Input::Neighbour(k) => format!("neighbour(I{})", k + 1),
        Input::Integral(k) => format!("I{}", k + 1),
        _ => "l".to_string(),
    }
}

const IN_TEXT: Words = Words {
    integrand: |k, primes| format!("f{k}{primes}(l)"),
    multiplied: |kind, k| format!("{}{}", if *kind == Kind::Integrands { 'f' } else { 'I' }, k + 1),
    energy: |head| format!("psi({head})"),
    derivative: |of, input| format!("d{of}/d{}", variable(input)),
    margin: |number| format!("margin {number}"),
    next: |state| format!("next {state}"),
};

/// What is gathered, then integrands with two derivatives, energies with their gradients, and conditions and next
/// states as they are written; named parts first.
pub fn gathered_text(model: &Model, forms: &GatheredForms) -> String {
    let notation = Text { names: Names { model } };
    let mut out = String::new();
    for (k, text) in forms.gathered.iter().enumerate() {
        let _ = writeln!(out, "# I{} = {text}", k + 1);
    }
    let write = |out: &mut String, graph: &ExprGraph, roots: &Roots| {
        for (name, text) in lines(graph, roots, &notation) {
            let _ = writeln!(out, "{name} = {text}");
        }
    };
    for (k, energy) in forms.integrands.iter().enumerate() {
        write(&mut out, &energy.graph, &integrand(k, &IN_TEXT, &energy.roots));
    }
    for function in &forms.functions {
        if let Some(written) = written(function) {
            let _ = writeln!(out, "\n{written}");
            continue;
        }
        out.push('\n');
        out.extend(legend(function).map(|legend| format!("# {legend}\n")));
        write(&mut out, &function.form.graph, &roots(function, &IN_TEXT));
    }
    out
}

fn integrand(k: usize, words: &Words, roots: &[NodeId; 3]) -> Roots {
    let named = |(primes, root): (&str, &NodeId)| ((words.integrand)(k + 1, primes), *root);
    ["", "'", "''"].into_iter().zip(roots).map(named).collect()
}

const IN_LATEX: Words = Words {
    integrand: |k, primes| format!("f_{{{k}}}{primes}(l)"),
    multiplied: |kind, k| {
        format!("{}_{{{}}}", if *kind == Kind::Integrands { 'f' } else { 'I' }, k + 1)
    },
    energy: |_| r"\psi".to_string(),
    derivative: |of, input| {
        let of = if of == "psi" { r"\psi" } else { of };
        let by = match input {
            Input::Part(Part::Moved(axis)) => format!(r"\xi_{{{}}}", axis + 1),
            Input::Neighbour(k) => Latex::neighbour(k),
            Input::Integral(k) => format!("I_{{{}}}", k + 1),
            _ => "l".to_string(),
        };
        format!(r"\partial {of}/\partial {by}")
    },
    margin: |number| format!("g_{{{number}}}"),
    next: latex::next,
};

/// The same as `align*` environments, one for what is gathered and one for each function.
pub fn gathered_latex(model: &Model, forms: &GatheredForms) -> String {
    let notation = Latex { names: Names { model } };
    let rows = |graph: &ExprGraph, roots: &Roots| -> Vec<String> {
        let all = lines(graph, roots, &notation).into_iter();
        all.map(|(name, text)| format!("  {name} &= {text}")).collect()
    };
    let environment =
        |rows: &[String]| format!("\\begin{{align*}}\n{}\n\\end{{align*}}\n", rows.join(" \\\\\n"));
    let mut gathered = Vec::new();
    let mut out = String::new();
    for (k, text) in forms.gathered.iter().enumerate() {
        let number = k + 1;
        let _ = writeln!(out, "% I{number} = {text}");
        if let Some(energy) = forms.integrands.get(k) {
            gathered.push(format!(r"  I_{{{number}}} &= \sum_j V_j\, f_{{{number}}}(l_j)"));
            gathered.extend(rows(&energy.graph, &integrand(k, &IN_LATEX, &energy.roots)));
        }
    }
    if !gathered.is_empty() {
        out.push_str(&environment(&gathered));
    }
    for function in &forms.functions {
        out.extend(legend(function).map(|legend| format!("% {legend}\n")));
        let mut own = rows(&function.form.graph, &roots(function, &IN_LATEX));
        if let Kind::Margin { number, holds_at_zero } = function.kind {
            let sign = if holds_at_zero { r"\ge" } else { ">" };
            own.push(format!(r"  &\text{{bonds break where }} g_{{{number}}} {sign} 0"));
        }
        out.push_str(&environment(&own));
    }
    out
}

/// Every node of every function with its number, then the roots.
pub fn gathered_listing(model: &Model, forms: &GatheredForms) -> String {
    let mut out = String::new();
    let mut write = |graph: &ExprGraph, roots: Roots| {
        super::listing::nodes(&mut out, model, graph);
        for (name, root) in roots {
            let _ = writeln!(out, "{name} = %{}", root.0);
        }
    };
    for (k, energy) in forms.integrands.iter().enumerate() {
        write(&energy.graph, integrand(k, &IN_TEXT, &energy.roots));
    }
    for function in &forms.functions {
        write(&function.form.graph, roots(function, &IN_TEXT));
    }
    out
}

/// C functions to follow those of [`super::c_source`]. Of numbers that points gather the integrands,
/// `void NAME_integrand_1(size_t n, const double *measure, const double *reference, const double *change,
/// double *f, double *df, double *d2f)`; of all that is gathered
/// `void NAME_points(size_t n, const double *variables, double *psi, double *gradient)`,
/// `void NAME_bonds(size_t n, const double *variables, const double *given, double *psi, double *gradient)`, of
/// vectors `NAME_integrands` and `NAME_functions`, and of each `NAME_.._product(size_t n, .., const double *direction,
/// double *product)`; `NAME_margin_1` and `NAME_next_k` give `double *margin` and `double *next`.
/// Arrays hold entry after entry of `n` places, in the order that a comment gives. What is remembered, the direction
/// of bonds and the time step are arguments of their own where a function holds them.
pub fn gathered_c(model: &Model, forms: &GatheredForms) -> String {
    let mut out = String::new();
    for (k, energy) in forms.integrands.iter().enumerate() {
        let _ = write!(out, "\n/* I{0} is the sum of V_j f: {1} */", k + 1, forms.gathered[k]);
        let names = ["f", "df", "d2f"].into_iter().zip(energy.roots);
        let results: Vec<(&str, NodeId)> = names.collect();
        c::array_function(&mut out, model, &format!("integrand_{}", k + 1), energy, &results);
    }
    for function in &forms.functions {
        let (name, value, meaning) = match &function.kind {
            Kind::Integrands => ("integrands".to_string(), "psi", "integrands times A_k"),
            Kind::Functions => ("functions".to_string(), "psi", "functions of integrals times A_k"),
            Kind::Energy { of_bonds: true } => ("bonds".to_string(), "psi", "energy of bonds"),
            Kind::Energy { of_bonds: false } => ("points".to_string(), "psi", "energy of points"),
            Kind::Margin { number, holds_at_zero: true } => {
                (format!("margin_{number}"), "margin", "bonds break where this is >= 0")
            }
            Kind::Margin { number, .. } => {
                (format!("margin_{number}"), "margin", "bonds break where this is > 0")
            }
            Kind::Next(state) => (format!("next_{state}"), "next", "what is remembered next"),
        };
        let texts = |inputs: &[Input]| {
            let names = Names { model };
            inputs.iter().map(|input| names.input(*input)).collect::<Vec<_>>().join(", ")
        };
        let given = match &function.given[..] {
            [] => String::new(),
            given => format!("; given: {}", texts(given)),
        };
        let _ = write!(
            out,
            "\n/* {meaning}: {}\n",
            written(function).unwrap_or_else(|| head(function))
        );
        let _ = write!(out, " * variables: {}{given} */", texts(&function.variables));
        let has_derivatives = value == "psi";
        gathered_function(
            &mut out,
            model,
            function,
            (&name, value),
            Gives::Value { has_derivatives },
        );
        if has_derivatives {
            gathered_function(&mut out, model, function, (&name, value), Gives::Product);
        }
    }
    out
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Gives {
    Value { has_derivatives: bool },
    Product,
}

fn gathered_function(
    out: &mut String,
    model: &Model,
    function: &GatheredFunction,
    (name, value): (&str, &str),
    gives: Gives,
) {
    let form = &function.form;
    let entry = |array: &str, k: usize| format!("{array}[{k} * n + i]");
    let entries = |array: &'static str, roots: &[NodeId]| -> Roots {
        roots.iter().enumerate().map(|(k, root)| (entry(array, k), *root)).collect()
    };
    let mut wanted = match gives {
        Gives::Value { .. } => vec![(format!("{value}[i]"), form.psi)],
        Gives::Product => entries("product", &form.product),
    };
    let arrays = match gives {
        Gives::Value { has_derivatives: true } => {
            wanted.extend(entries("gradient", &form.gradient));
            format!("double *{value}, double *gradient")
        }
        Gives::Value { .. } => format!("double *{value}"),
        Gives::Product => "const double *direction, double *product".to_string(),
    };
    let input = |input| {
        let place = |own: &[Input]| own.iter().position(|one| *one == input);
        match (place(&function.variables), place(&function.given), input) {
            (Some(k), _, _) => entry("variables", k),
            (_, Some(k), _) => entry("given", k),
            (_, _, Input::Direction(k)) => entry("direction", usize::from(k)),
            (_, _, Input::Parameter(dt)) if model.number_of_time_step() == Some(dt) => "dt".into(),
            (_, _, Input::Parameter(number)) => format!("{}[i]", c::state(model, number)),
            // Specialisation has put numbers in the place of all others.
            _ => "NAN".into(),
        }
    };
    let held = |number: &u16| {
        let input = Node::Input(Input::Parameter(*number));
        form.graph.nodes().any(|(_, node)| node == input)
    };
    let last = model.number_of_length();
    let own: String = (0..last)
        .filter(held)
        .map(|number| match model.number_of_time_step() == Some(number) {
            true => "double dt, ".to_string(),
            false => format!("const double *{}, ", c::state(model, number)),
        })
        .collect();
    let given = if function.given.is_empty() { "" } else { ", const double *given" };
    let ending = if gives == Gives::Product { "_product" } else { "" };
    let _ = write!(
        out,
        "\nvoid {}_{name}{ending}(size_t n, const double *variables{given},\n\
         \x20   {own}{arrays}) {{\n\
         \x20 for (size_t i = 0; i < n; i++) {{\n",
        model.name()
    );
    let (targets, roots): (Vec<String>, Vec<NodeId>) = wanted.into_iter().unzip();
    let (graph, roots) = form.graph.extract(&roots);
    statements(out, &graph, &input, targets.into_iter().zip(roots));
    out.push_str("  }\n}\n");
}
