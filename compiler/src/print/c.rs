//! Kernels as C: one statement per operation, in the kernel's order.
//!
//! Compiled without contraction (`-ffp-contract=off`) it differs from the strict level only by the
//! C library's elementary functions.

use std::fmt::Write as _;

use crate::expression::power::{PowerOps, PowerPlan};
use crate::expression::{Function, Input, Node, NodeId, Operator};
use crate::model::Model;
use crate::specialise::ScalarEnergy;

/// A C99 file with one function per energy:
/// `void NAME_l(size_t n, const double *measure, const double *reference, const double *change,
/// double *psi, double *dpsi, double *d2psi)`.
pub fn c_source(model: &Model, energies: &[ScalarEnergy]) -> String {
    let mut out = format!(
        "/* {}: psi, psi' and psi'' over arrays. Compile without contraction of a*b + c. */\n",
        model.name()
    );
    out.push_str("#include <math.h>\n#include <stddef.h>\n");
    out.push_str(HELPERS);
    for energy in energies {
        function(&mut out, model, energy);
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

fn function(out: &mut String, model: &Model, energy: &ScalarEnergy) {
    let _ = write!(
        out,
        "\nvoid {}_{}(size_t n, const double *measure, const double *reference,\n\
         \x20   const double *change, double *psi, double *dpsi, double *d2psi) {{\n\
         \x20 for (size_t i = 0; i < n; i++) {{\n",
        model.name(),
        energy.measure.symbol()
    );
    let mut writer = Writer { out, next: 0, names: Vec::new() };
    for (_, node) in energy.graph.nodes() {
        let name = writer.node(node);
        writer.names.push(name);
    }
    let names = writer.names;
    for (output, root) in ["psi", "dpsi", "d2psi"].into_iter().zip(energy.roots) {
        let _ = writeln!(out, "    {output}[i] = t{};", names[root.0 as usize]);
    }
    out.push_str("  }\n}\n");
}

struct Writer<'a> {
    out: &'a mut String,
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
            Node::Input(Input::Current(_)) => "measure[i]".into(),
            Node::Input(Input::Reference(_)) => "reference[i]".into(),
            Node::Input(Input::Change(_)) => "change[i]".into(),
            // Specialisation has put numbers, and accurate forms, in their place.
            Node::Input(_) | Node::Strain(..) => "NAN".into(),
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
