//! Kernels as C: one statement per operation, in the kernel's order.
//!
//! Compiled without contraction (`-ffp-contract=off`) it differs from the strict level only by the
//! C library's elementary functions.

use std::fmt::Write as _;

use crate::breaking::{BondFunction, BondFunctionKind};
use crate::density::DensityForm;
use crate::expression::graph::components;
use crate::expression::power::{PowerOps, PowerPlan};
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::measure::Measure;
use crate::model::{DIRECTIONS, Model, Of, OfFamily};
use crate::point::{GradientEnergyForms, GradientFunction, GradientFunctionKind, axes};
use crate::specialise::ScalarEnergy;

/// A C99 file with one function per energy of a measure:
/// `void NAME_l(size_t n, const double *measure, const double *reference, const double *change,
/// double *psi, double *dpsi, double *d2psi)`, with an array for each state of its kind before `psi`,
/// and two for the energy of the deformation gradient, whose arrays hold component after component,
/// row by row, of `n` places (`change` is `F - I`):
/// `void NAME_F(size_t n, const double *gradient, const double *change, double *psi,
/// double *stress)` and
/// `void NAME_F_product(size_t n, const double *gradient, const double *change,
/// const double *direction, double *product)`.
pub fn c_source(
    model: &Model,
    energies: &[ScalarEnergy],
    gradient: Option<&GradientEnergyForms>,
) -> String {
    let mut out = format!(
        "/* {}: energies and their derivatives over arrays. Compile without contraction of a*b + c. */\n",
        model.name()
    );
    out.push_str("#include <math.h>\n#include <stddef.h>\n");
    out.push_str(HELPERS);
    for energy in energies {
        function(&mut out, model, energy);
    }
    if let Some(forms) = gradient {
        if forms.far.has_axes() {
            out.push_str(AXES);
        }
        let both = [("F", Gives::Psi), ("F_product", Gives::Product)];
        gradient_functions(&mut out, model, forms, &both);
    }
    out
}

/// min, max, sign and log1pmx as the language defines them.
const HELPERS: &str = "
static inline double piola_min(double x, double y) {
  if (isnan(x) || isnan(y)) return NAN;
  return x < y || (x == y && signbit(x)) ? x : y;
}
static inline double piola_max(double x, double y) {
  if (isnan(x) || isnan(y)) return NAN;
  return x > y || (x == y && signbit(y)) ? x : y;
}
static inline double piola_sign(double x) { return x > 0 ? 1.0 : x < 0 ? -1.0 : x; }
static inline double piola_log1pmx(double x) {
  if (fabs(x) >= 0.3 || isnan(x)) return log1p(x) - x;
  const double r = x / (2.0 + x), square = r * r;
  double sum = 0.0;
  for (int k = 11; k >= 1; k--) sum = square * (sum + 1.0 / (2 * k + 1));
  return r * (2.0 * sum - x);
}
";

/// What kernels find before they run, in the same steps.
const AXES: &str = include_str!("axes.c");

fn function(out: &mut String, model: &Model, energy: &ScalarEnergy) {
    let name = energy.measure.symbol();
    let targets = [("psi", 0), ("dpsi", 1), ("d2psi", 2)];
    array_function(out, model, name, energy, &targets.map(|(name, k)| (name, energy.roots[k])));
}

/// A function over arrays of bonds, or of other interactions, with one array for each result. States are
/// arrays, too, all of their kind that the values have if the function takes any, and the time step is a
/// number.
pub(super) fn array_function(
    out: &mut String,
    model: &Model,
    name: &str,
    energy: &ScalarEnergy,
    results: &[(&str, NodeId)],
) {
    let is_own = |number: u16| {
        let kind = model.kind_of_state(usize::from(number));
        model.time_step() == Some(number)
            || kind.unwrap_or(Of::Measure(Measure::Length)) == Of::Measure(energy.measure)
    };
    let own = energy.fields.iter().filter(|(number, _)| is_own(*number));
    let given = own.map(|(number, _)| match model.time_step() {
        Some(dt) if dt == *number => "double dt, ".to_string(),
        _ => format!("const double *{}, ", state(model, *number)),
    });
    let given: String = given.collect();
    let has_rate = energy.graph.depends_on(&energy.roots, Input::Rate);
    let rate = if has_rate { "const double *rate, " } else { "" };
    let arrays: Vec<String> = results.iter().map(|(name, _)| format!("double *{name}")).collect();
    let _ = write!(
        out,
        "\nvoid {}_{name}(size_t n, const double *measure, const double *reference,\n\
         \x20   const double *change, {rate}{given}{}) {{\n\
         \x20 for (size_t i = 0; i < n; i++) {{\n",
        model.name(),
        arrays.join(", ")
    );
    let input = |input| match input {
        Input::Current(_) => "measure[i]".into(),
        Input::Reference(_) => "reference[i]".into(),
        Input::Change(_) => "change[i]".into(),
        Input::Rate => "rate[i]".into(),
        Input::Parameter(number) if model.time_step() == Some(number) => "dt".into(),
        Input::Parameter(number) => format!("{}[i]", state(model, number)),
        // Specialisation has put numbers in their place.
        _ => "NAN".into(),
    };
    let targets = results.iter().map(|(name, root)| (format!("{name}[i]"), *root));
    statements(out, &energy.graph, &input, targets);
    out.push_str("  }\n}\n");
}

/// What C calls a state, or a component of the direction of a bond.
pub(super) fn state(model: &Model, number: u16) -> String {
    match model.directions(DIRECTIONS).position(|own| own == number) {
        Some(axis) => format!("direction_{}", axis + 1),
        None => format!("state_{}", model.input_name(usize::from(number))),
    }
}

/// C99 functions for when bonds, triangles and tetrahedra break and what they remember, beside those of [`c_source`]:
/// `void NAME_margin_1(size_t n, const double *measure, const double *reference, const double *change,
/// const double *state_k, double *margin)`, and `NAME_next_k` with `double dt` where it depends on the time
/// step; `NAME_dissipation` takes `const double *rate` behind `change`, and gives `R`, `dR` and `d2R`.
pub fn c_of_bonds(model: &Model, functions: &[BondFunction]) -> String {
    let mut out = String::new();
    for BondFunction { kind, text, function } in functions {
        let (name, result, meaning) = match kind {
            BondFunctionKind::Margin { number, holds_at_zero } => {
                let sign = if *holds_at_zero { ">=" } else { ">" };
                let meaning = format!(
                    "A {} breaks where this is {sign} 0: {text}",
                    function.measure.interaction()
                );
                (format!("margin_{number}"), "margin", meaning)
            }
            BondFunctionKind::Next(state) => (
                format!("next_{state}"),
                "next",
                format!(
                    "What a {} remembers next: {state} = {text}",
                    function.measure.interaction()
                ),
            ),
            BondFunctionKind::Dissipation => {
                let _ = write!(
                    out,
                    "\n/* What a bond dissipates, with derivatives by its rate: {text} */"
                );
                let names = ["R", "dR", "d2R"].into_iter().zip(function.roots);
                let results: Vec<(&str, NodeId)> = names.collect();
                array_function(&mut out, model, "dissipation", function, &results);
                continue;
            }
        };
        let _ = write!(out, "\n/* {meaning} */");
        let (graph, roots) = function.graph.extract(&function.roots[..1]);
        let alone = ScalarEnergy { graph, roots: [roots[0]; 3], ..function.clone() };
        array_function(&mut out, model, &name, &alone, &[(result, roots[0])]);
    }
    out
}

/// C99 functions for conditions of the deformation gradient and for what is remembered with it, beside those of
/// [`c_source`]: `void NAME_F_margin_1(size_t n, const double *gradient, const double *change,
/// const double *state_k, double *margin)`, and `NAME_F_next_k` with `double dt` where it depends on the time
/// step.
pub fn c_of_gradient_functions(model: &Model, functions: &[GradientFunction]) -> String {
    let mut out = String::new();
    for GradientFunction { kind, text, forms } in functions {
        if forms.far.has_axes() {
            out.push_str(AXES);
        }
        let (name, what, meaning) = match kind {
            GradientFunctionKind::Margin { number, holds_at_zero } => {
                let sign = if *holds_at_zero { ">=" } else { ">" };
                let meaning = format!("Bonds break where this is {sign} 0: {text}");
                (format!("F_margin_{number}"), Gives::Margin, meaning)
            }
            GradientFunctionKind::Next(state) => (
                format!("F_next_{state}"),
                Gives::Next,
                format!("What is remembered next: {state} = {text}"),
            ),
        };
        let _ = write!(out, "\n/* {meaning} */");
        gradient_functions(&mut out, model, forms, &[(&name, what)]);
    }
    out
}

/// What a function of gradients gives.
#[derive(Clone, Copy)]
enum Gives {
    Psi,
    Product,
    Margin,
    Next,
}

/// Functions by name: near rest by the form in `F - I`, as our kernels choose.
fn gradient_functions(
    out: &mut String,
    model: &Model,
    forms: &GradientEnergyForms,
    functions: &[(&str, Gives)],
) {
    let order = components(forms.dimension);
    let entry = |array: &str, k: usize| format!("{array}[{k} * n + i]");
    let of = |array: &str, c: u8| entry(array, order.iter().position(|x| *x == c).unwrap_or(0));
    let axes: Vec<Input> = axes::inputs(forms.dimension).collect();
    let input = |input| match input {
        Input::Variable(c) => of("gradient", c),
        Input::VariableChange(c) => of("change", c),
        Input::Direction(c) => of("direction", c),
        Input::Parameter(number) if model.number_of_time_step() == Some(number) => "dt".into(),
        Input::Parameter(number) => format!("{}[i]", state(model, number)),
        // Specialisation has put numbers in the place of all others.
        _ => match axes.iter().position(|known| *known == input) {
            Some(k) => format!("axes[{k}]"),
            None => "NAN".into(),
        },
    };
    let write = |out: &mut String, form: &DensityForm, what: Gives| {
        let tensor = match what {
            Gives::Psi => ("stress", &form.gradient[..]),
            Gives::Product => ("product", &form.product[..]),
            Gives::Margin | Gives::Next => ("", &[][..]),
        };
        let scalar = match what {
            Gives::Psi => Some(("psi[i]".to_string(), form.psi)),
            Gives::Product => None,
            Gives::Margin => Some(("margin[i]".to_string(), form.psi)),
            Gives::Next => Some(("next[i]".to_string(), form.psi)),
        };
        let all = tensor.1.iter().enumerate().map(|(k, root)| (entry(tensor.0, k), *root));
        let (targets, roots): (Vec<String>, Vec<NodeId>) = scalar.into_iter().chain(all).unzip();
        let (graph, roots) = form.graph.extract(&roots);
        if form.has_axes() {
            let near = forms.near.as_ref().is_some_and(|near| std::ptr::eq(near, form));
            let _ = writeln!(
                out,
                "    double axes[{}];\n    piola_axes({}, {}, {} + i, n, axes);",
                axes.len(),
                forms.dimension,
                u8::from(near),
                if near { "change" } else { "gradient" }
            );
        }
        statements(out, &graph, &input, targets.into_iter().zip(roots));
    };
    let given = remembered(model, forms);
    for (name, what) in functions {
        let arrays = match what {
            Gives::Psi => "double *psi, double *stress",
            Gives::Product => "const double *direction, double *product",
            Gives::Margin => "double *margin",
            Gives::Next => "double *next",
        };
        let _ = write!(
            out,
            "\nvoid {}_{name}(size_t n, const double *gradient, const double *change,\n\
             \x20   {given}{arrays}) {{\n\
             \x20 for (size_t i = 0; i < n; i++) {{\n",
            model.name()
        );
        if let Some(near) = &forms.near {
            out.push_str("    int near = 1;\n");
            let _ = writeln!(
                out,
                "    for (int k = 0; k < {}; k++) near = near && fabs(change[k * n + i]) < {:?};\n\
                 \x20   if (near) {{",
                order.len(),
                forms.reach
            );
            write(out, near, *what);
            out.push_str("    continue;\n    }\n");
        }
        write(out, &forms.far, *what);
        out.push_str("  }\n}\n");
    }
}

/// The states of deformation gradients, and the time step, as arguments of a function that takes any.
fn remembered(model: &Model, forms: &GradientEnergyForms) -> String {
    if forms.far.n_fields() == 0 {
        return String::new();
    }
    let kind = Some(Of::Family(OfFamily::Gradient));
    let own = model.states().filter(|state| model.kind_of_state(*state) == kind);
    let states: String =
        own.map(|number| format!("const double *{}, ", state(model, number as u16))).collect();
    let has_time = model.number_of_time_step().is_some_and(|dt| {
        let holds = |form: &DensityForm| {
            form.graph.nodes().any(|(_, node)| node == Node::Input(Input::Parameter(dt)))
        };
        holds(&forms.far)
    });
    states + if has_time { "double dt, " } else { "" }
}

/// Every operation of a graph, then what is wanted of them.
pub(super) fn statements(
    out: &mut String,
    graph: &ExprGraph,
    input: &dyn Fn(Input) -> String,
    roots: impl Iterator<Item = (String, NodeId)>,
) {
    let mut writer = Writer { out, input, next: 0, names: Vec::new() };
    for (_, node) in graph.nodes() {
        let name = writer.node(node);
        writer.names.push(name);
    }
    for (target, root) in roots {
        let _ = writeln!(writer.out, "    {target} = t{};", writer.names[root.0 as usize]);
    }
}

struct Writer<'a> {
    out: &'a mut String,
    /// Where an input is read.
    input: &'a dyn Fn(Input) -> String,
    next: usize,
    /// Number of each node's variable.
    names: Vec<usize>,
}

impl Writer<'_> {
    fn assign(&mut self, kind: &str, value: &str) -> usize {
        let name = self.next;
        self.next += 1;
        let _ = writeln!(self.out, "    const {kind} t{name} = {value};");
        name
    }

    fn node(&mut self, node: Node) -> usize {
        let of = |x: NodeId| self.names[x.0 as usize];
        let value = match node {
            Node::Number(bits) => number(f64::from_bits(bits)),
            Node::Truth(holds) => return self.assign("int", if holds { "1" } else { "0" }),
            Node::Input(input) => (self.input)(input),
            // Specialisation has put accurate forms in its place.
            Node::Strain(..) => "NAN".into(),
            Node::Unary(Function::Negate, x) => format!("-t{}", of(x)),
            Node::Unary(function, x) => format!("{}(t{})", c_name(function), of(x)),
            Node::PowerConstant(x, bits) => {
                let x = of(x);
                return PowerPlan::new(f64::from_bits(bits)).apply(self, x);
            }
            Node::Binary(operator, x, y) => match operator {
                Operator::Min => format!("piola_min(t{}, t{})", of(x), of(y)),
                Operator::Max => format!("piola_max(t{}, t{})", of(x), of(y)),
                Operator::Power => format!("pow(t{}, t{})", of(x), of(y)),
                Operator::Atan2 => format!("atan2(t{}, t{})", of(x), of(y)),
                arithmetic => format!("t{} {} t{}", of(x), arithmetic.name(), of(y)),
            },
            Node::Compare(comparison, x, y) => {
                let condition = format!("t{} {} t{}", of(x), comparison.name(), of(y));
                return self.assign("int", &condition);
            }
            Node::And(x, y) => {
                let condition = format!("t{} && t{}", of(x), of(y));
                return self.assign("int", &condition);
            }
            Node::Or(x, y) => {
                let condition = format!("t{} || t{}", of(x), of(y));
                return self.assign("int", &condition);
            }
            Node::Not(x) => {
                let condition = format!("!t{}", of(x));
                return self.assign("int", &condition);
            }
            Node::Select(c, x, y) => format!("t{} ? t{} : t{}", of(c), of(x), of(y)),
        };
        self.assign("double", &value)
    }
}

impl PowerOps for Writer<'_> {
    type Value = usize;
    fn one(&mut self) -> usize {
        self.assign("double", "1.0")
    }
    fn multiply(&mut self, x: usize, y: usize) -> usize {
        self.assign("double", &format!("t{x} * t{y}"))
    }
    fn reciprocal(&mut self, x: usize) -> usize {
        self.assign("double", &format!("1.0 / t{x}"))
    }
    fn sqrt(&mut self, x: usize) -> usize {
        self.assign("double", &format!("sqrt(t{x})"))
    }
    fn pow(&mut self, x: usize, c: f64) -> usize {
        self.assign("double", &format!("pow(t{x}, {})", number(c)))
    }
}

fn number(value: f64) -> String {
    match value {
        v if v.is_nan() => "NAN".into(),
        v if v == f64::INFINITY => "INFINITY".into(),
        v if v == f64::NEG_INFINITY => "-INFINITY".into(),
        // Shortest digits that read back to the same number, always with a point or exponent.
        v => format!("{v:?}"),
    }
}

fn c_name(function: Function) -> &'static str {
    match function {
        Function::Abs => "fabs",
        Function::Ln => "log",
        Function::Sign => "piola_sign",
        Function::Log1pmx => "piola_log1pmx",
        other => other.name(),
    }
}
