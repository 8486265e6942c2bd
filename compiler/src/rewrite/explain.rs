//! What was rewritten, and what it gained: before, after, errors and cost, all measured.

use std::hint::black_box;
use std::time::Instant;

use super::{Applied, expand};
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::{ExprGraph, Function, Node, NodeId, Operator, TooManyNodes};
use crate::jit::CompiledKernel;
use crate::kernel::{Batch, Derivatives, Level, Order};
use crate::measure::Measure;
use crate::model::Model;
use crate::print;
use crate::simplify::{Rule, Simplifier};
use crate::specialise::{CompileError, Form, ScalarEnergy};
use crate::values::Values;
use crate::verify::sample::Point;
use crate::verify::{Subject, UNIT_ROUNDOFF};

/// Precision of the true values, in binary digits.
const BITS: usize = 256;
/// More of them, for `x^1e-300 - 1`.
const MORE_BITS: usize = 1408;
/// Evaluations per timed run.
const BATCH: usize = 2000;
/// Timed runs of each form, in turn; the fastest counts.
const RUNS: usize = 15;

/// One use of a rule, with what it gained.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The energy it belongs to.
    pub measure: Measure,
    /// What it belongs to, if that is no energy.
    pub function: Option<Subject>,
    /// Which rule.
    pub rule: &'static Rule,
    /// What was there.
    pub before: Side,
    /// What took its place.
    pub after: Side,
}

/// An expression with its errors and its cost.
#[derive(Clone, Debug)]
pub struct Side {
    /// In the piola language.
    pub text: String,
    /// Largest error in `u = 2^-53` at strains from 1e-1 to 1e-14.
    pub near: f64,
    /// Largest error in `u` at stretches from 1e-6 to 1e6.
    pub far: f64,
    /// Operations, calls included.
    pub operations: usize,
    /// Calls of elementary functions.
    pub calls: usize,
    /// Time of one evaluation in ns on this machine.
    pub nanoseconds: f64,
}

/// Every rewrite of the energies for these values, then of conditions and of what bonds remember, each pair of
/// expressions once.
///
/// # Errors
/// As for [`Model::specialise`].
pub fn explain(model: &Model, values: &Values) -> Result<Vec<Explanation>, CompileError> {
    let mut all = Vec::new();
    model.derive(values, Form::Accurate, |derived, _| all.push((None, derived)))?;
    model.derive_functions(values, Form::Accurate, |subject, derived, _| {
        all.push((Some(subject), derived));
        Ok(())
    })?;
    let mut explanations: Vec<Explanation> = Vec::new();
    for (function, derived) in all {
        let mut graph = derived.graph;
        for Applied { rule, before, after } in derived.applied {
            // Numbers that were worked out have lost what makes them cancel.
            let order = derived.roots.iter().position(|root| *root == after);
            let exact = derived.exact.as_ref().zip(order).map(|(exact, order)| exact.lone(order));
            let pair = pair(&mut graph, before, after, derived.measure);
            let Ok((before, after)) = pair else { continue };
            let (before, after) =
                sides(model, graph.graph(), (before, after), derived.measure, exact)?;
            let known =
                |e: &Explanation| e.before.text == before.text && e.after.text == after.text;
            if before.text != after.text && !explanations.iter().any(known) {
                let (measure, function) = (derived.measure, function.clone());
                explanations.push(Explanation { measure, function, rule, before, after });
            }
        }
    }
    Ok(explanations)
}

/// The two forms without strains: by definition, and accurate.
fn pair(
    graph: &mut Simplifier,
    before: NodeId,
    after: NodeId,
    measure: Measure,
) -> Result<(NodeId, NodeId), TooManyNodes> {
    let before = by_definition(graph, before)?;
    let after = expand(graph, &[after], measure, &mut Vec::new())?[0];
    Ok((before, after))
}

/// The same root with every strain as `(x^n - 1)/n`.
fn by_definition(graph: &mut Simplifier, root: NodeId) -> Result<NodeId, TooManyNodes> {
    let needed = graph.graph().reachable(&[root]);
    let mut place: Vec<NodeId> = Vec::with_capacity(needed.len());
    for index in 0..=root.0 as usize {
        let id = NodeId(index as u32);
        let made = match graph.graph()[id] {
            _ if !needed[index] => id,
            Node::Strain(x, bits) if f64::from_bits(bits) == 0.0 => {
                graph.unary(Function::Ln, place[x.0 as usize])?
            }
            Node::Strain(x, bits) => {
                let order = graph.number(f64::from_bits(bits))?;
                let one = graph.number(1.0)?;
                let power = graph.power(place[x.0 as usize], f64::from_bits(bits))?;
                let difference = graph.subtract(power, one)?;
                graph.divide(difference, order)?
            }
            node => graph.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
        place.push(made);
    }
    Ok(place[root.0 as usize])
}

fn sides(
    model: &Model,
    graph: &ExprGraph,
    (before, after): (NodeId, NodeId),
    measure: Measure,
    exact: Option<ScalarEnergy>,
) -> Result<(Side, Side), CompileError> {
    let forms = [form(graph, before, measure), form(graph, after, measure)];
    let times = times([&forms[0], &forms[1]])?;
    let side = |k: usize| {
        let (near, far) = errors(&forms[k], exact.as_ref().unwrap_or(&forms[0]));
        let (operations, calls) = (forms[k].graph.operations(), forms[k].graph.calls());
        let text = print::expression(model, &forms[k].graph, forms[k].roots[0]);
        Side { text, near, far, operations, calls, nanoseconds: times[k] }
    };
    Ok((side(0), side(1)))
}

/// A lone expression in the shape of an energy.
fn form(graph: &ExprGraph, root: NodeId, measure: Measure) -> ScalarEnergy {
    let (graph, roots) = graph.extract(&[root; 3]);
    ScalarEnergy { measure, graph, roots: [roots[0], roots[1], roots[2]], fields: Vec::new() }
}

fn evaluate<N: Number>(form: &ScalarEnergy, point: Point, change: N) -> N {
    let mut interpreter = Interpreter::<N>::new();
    let [measure, reference] = [point.measure, point.reference].map(N::constant);
    form.run(&mut interpreter, &measure, &reference, &change);
    interpreter.number(form.roots[0])
}

/// The true value of a form; nothing where the precision may not be enough.
fn precise<const N: usize>(form: &ScalarEnergy, point: Point) -> Option<f64> {
    let [measure, reference] = [point.measure, point.reference].map(Precise::<N>::constant);
    let difference = Precise::binary(Operator::Subtract, measure, reference.clone());
    let change = Precise::binary(Operator::Divide, difference, reference);
    let value = evaluate(form, point, change);
    (!value.doubtful()).then(|| value.rounded()[0])
}

/// Largest errors near rest and far from it, against the true values of another form.
fn errors(form: &ScalarEnergy, truth: &ScalarEnergy) -> (f64, f64) {
    let largest = |stretches: Vec<f64>| {
        // A reference that is no power of two: the stretch is rounded, as it is in a body.
        let error = |stretch: f64| {
            let point = Point { measure: stretch * 0.037, reference: 0.037 };
            let expected = precise::<BITS>(truth, point)
                .unwrap_or_else(|| precise::<MORE_BITS>(truth, point).unwrap_or(f64::NAN));
            let found = evaluate(form, point, point.change());
            let relative = (found - expected).abs() / expected.abs() / UNIT_ROUNDOFF;
            // Outside the domain of both there is nothing to compare.
            if relative.is_nan() { 0.0 } else { relative }
        };
        stretches.into_iter().map(error).fold(0.0, f64::max)
    };
    let strains =
        (1..=14).flat_map(|k| [1.1, 2.3, 5.7].map(|x| x * libm::pow(10.0, f64::from(-k - 1))));
    let near = strains.flat_map(|strain| [1.0 + strain, 1.0 - strain]).collect();
    let far = (-60..=60).map(|k| libm::pow(10.0, f64::from(k) / 10.0)).collect();
    (largest(near), largest(far))
}

/// Time of one evaluation of each form in ns: runs in turn, the fastest of each.
fn times(forms: [&ScalarEnergy; 2]) -> Result<[f64; 2], CompileError> {
    let kernels = [
        CompiledKernel::new(forms[0], Level::default())?,
        CompiledKernel::new(forms[1], Level::default())?,
    ];
    let measure: Vec<f64> = (0..BATCH).map(|k| 0.5 + k as f64 / BATCH as f64).collect();
    let reference = vec![1.0; BATCH];
    let change: Vec<f64> = measure.iter().map(|l| l - 1.0).collect();
    let batch = Batch { measure: &measure, reference: &reference, change: &change, fields: &[] };
    let mut out = Derivatives::zeros(BATCH);
    let mut fastest = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for (kernel, fastest) in kernels.iter().zip(&mut fastest) {
            let start = Instant::now();
            kernel.evaluate(black_box(batch), Order::Tangent, out.outputs());
            black_box(&out);
            *fastest = fastest.min(start.elapsed().as_secs_f64() * 1e9 / BATCH as f64);
        }
    }
    Ok(fastest)
}
