//! Which form of a root is used near rest, and which far from it.
//!
//! There are three: by the rules, as it was written, and by remainders at rest. All are evaluated at
//! strains near rest and far from it. Where they agree none has lost digits: they have little in common
//! but the energy. Where none agrees with another numbers of 256 bits decide.

use super::{NearRest, near_rest};
use crate::differentiate::{differentiate, differentiate_exactly};
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::{
    Comparison, ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes,
};
use crate::measure::Measure;
use crate::rewrite::{Applied, named};
use crate::simplify::Simplifier;
use crate::specialise::ScalarEnergy;
use crate::verify::UNIT_ROUNDOFF;

/// Up to this strain a form near rest serves: there `ln(x)` and `log1p(e)` are equally good.
const REACH: f64 = 0.5;
/// Forms agree up to this many units in the last place: what some roundings make.
const FINE: f64 = 16.0;
/// A form has lost digits if its error is above this, and so many times that of another.
const LOST: (f64, f64) = (48.0, 4.0);

/// Strains at which forms are compared, on both sides of rest.
const STRAINS: [f64; 13] =
    [0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 5e-3, 0.02, 0.06, 0.15, 0.3, 0.48];
/// A strain beside 0.
const TINY: f64 = 1e-30;
/// A step of an argument, as a share of it, over which a value changes little.
const STEP: f64 = 1e-3;
/// Strains up to this are near rest whatever the energy is; what is right beyond is found out.
const SMALL: f64 = 0.01;
/// Stretches far from rest.
const STRETCHES: [f64; 13] =
    [1e-8, 1e-6, 1e-4, 1e-2, 0.1, 0.3, 1.8, 3.0, 10.0, 100.0, 1e4, 1e6, 1e8];

/// Larger graphs are left as the rules made them: nobody waits for the coefficients of so many nodes.
const LARGEST: usize = 2000;

/// psi, psi' and psi'' as one energy: written with all digits of its numbers, at a typical reference
/// measure of few digits, but no power of two, which would hide what rounding does.
#[derive(Clone)]
pub(crate) struct Energy {
    graph: Simplifier,
    /// psi, psi' and psi''.
    roots: [NodeId; 3],
    measure: Measure,
    reference: f64,
    /// Fields with typical values.
    fields: Vec<(u16, f64)>,
}

impl Energy {
    /// The energy `psi` of a graph with all digits of its numbers; fields have typical values.
    pub(crate) fn new(
        mut graph: Simplifier,
        psi: NodeId,
        (measure, reference): (Measure, f64),
        fields: &[(u16, f64)],
    ) -> Result<Energy, TooManyNodes> {
        let dpsi = differentiate_exactly(&mut graph, psi, measure)?;
        let d2psi = differentiate_exactly(&mut graph, dpsi, measure)?;
        let (roots, fields) = ([psi, dpsi, d2psi], fields.to_vec());
        Ok(Energy { graph, roots, measure, reference, fields })
    }

    /// The typical value of a field; other inputs have none.
    fn field(&self, input: Input) -> f64 {
        let known = self.fields.iter().find(|(field, _)| Input::Parameter(*field) == input);
        known.map_or(f64::NAN, |(_, value)| *value)
    }

    /// The derivative of an order alone, in the place of psi and its derivatives.
    pub(crate) fn lone(&self, order: usize) -> ScalarEnergy {
        let (graph, roots) = self.graph.graph().extract(&[self.roots[order]; 3]);
        let (measure, fields) = (self.measure, Vec::new());
        ScalarEnergy { measure, graph, roots: [roots[0], roots[1], roots[2]], fields }
    }
}

/// psi, psi' and psi'' in the forms that keep their digits: `ruled` are those by the rules, `psi` is the
/// energy as it was written, both in `graph`.
pub(crate) fn kept(
    graph: &mut Simplifier,
    ruled: [NodeId; 3],
    psi: NodeId,
    exact: &Energy,
    applied: &mut Vec<Applied>,
) -> Result<[NodeId; 3], TooManyNodes> {
    if exact.graph.graph().len() > LARGEST {
        return Ok(ruled);
    }
    let measure = exact.measure;
    let dpsi = differentiate(graph, psi, measure)?;
    let plain = [psi, dpsi, differentiate(graph, dpsi, measure)?];
    let forms = near_rest(exact.graph.graph(), &exact.roots, measure, graph)?;
    let mut kept = ruled;
    let mut samples = Samples::new(exact);
    for (order, form) in forms.iter().enumerate() {
        let at_rest = samples.side_at_rest(graph.graph(), plain[order], form);
        let joined = joined(graph, form, measure, at_rest)?;
        let near = joined.as_ref().map(|joined| joined.value);
        let is_guarded = joined.as_ref().is_none_or(|joined| joined.holds.is_some());
        let candidates = Candidates { ruled: ruled[order], plain: plain[order], near, is_guarded };
        let choice = samples.choice(graph.graph(), order, &candidates);
        let mut made = choice.far;
        if let Some((value, reach)) = choice.near {
            let change = graph.input(Input::Change(measure))?;
            let size = graph.unary(Function::Abs, change)?;
            let limit = graph.number(reach)?;
            let mut condition = graph.make(Node::Compare(Comparison::Less, size, limit))?;
            if let Some(Joined { value: near, holds: Some(holds) }) = joined
                && near == value
            {
                condition = graph.make(Node::And(condition, holds))?;
            }
            made = graph.make(Node::Select(condition, value, choice.far))?;
        }
        if made != ruled[order] {
            applied.push(Applied {
                rule: named("remainder_at_rest"),
                before: ruled[order],
                after: made,
            });
        }
        kept[order] = made;
    }
    Ok(kept)
}

/// A root near rest, and where it holds.
struct Joined {
    value: NodeId,
    holds: Option<NodeId>,
}

/// Both sides in one; where a side has no form the condition says so. The left side is where `e` compares
/// with 0 as `at_rest` does.
fn joined(
    graph: &mut Simplifier,
    form: &NearRest,
    measure: Measure,
    at_rest: Comparison,
) -> Result<Option<Joined>, TooManyNodes> {
    let change = graph.input(Input::Change(measure))?;
    let zero = graph.number(0.0)?;
    let left = graph.make(Node::Compare(at_rest, change, zero))?;
    let mut holds = [None, None];
    for (side, holds) in form.sides.iter().zip(&mut holds) {
        for guard in side.iter().flat_map(|side| &side.guards) {
            *holds = Some(match *holds {
                None => *guard,
                Some(known) => graph.make(Node::And(known, *guard))?,
            });
        }
    }
    Ok(match &form.sides {
        [None, None] => None,
        [Some(right), Some(below)] => {
            let value = graph.make(Node::Select(left, below.root, right.root))?;
            let holds = match holds {
                [None, None] => None,
                [right, below] if right == below => right,
                [right, below] => {
                    let always = graph.make(Node::Truth(true))?;
                    let [right, below] = [right, below].map(|side| side.unwrap_or(always));
                    let there = graph.make(Node::Not(left))?;
                    let right = graph.make(Node::And(there, right))?;
                    let below = graph.make(Node::And(left, below))?;
                    Some(graph.make(Node::Or(right, below))?)
                }
            };
            Some(Joined { value, holds })
        }
        [Some(side), None] | [None, Some(side)] => {
            let is_left = form.sides[0].is_none();
            let there = if is_left { left } else { graph.make(Node::Not(left))? };
            let holds = match holds[usize::from(is_left)] {
                Some(guards) => graph.make(Node::And(there, guards))?,
                None => there,
            };
            Some(Joined { value: side.root, holds: Some(holds) })
        }
    })
}

/// The forms of a root.
struct Candidates {
    ruled: NodeId,
    plain: NodeId,
    near: Option<NodeId>,
    /// Whether the last one holds in part.
    is_guarded: bool,
}

/// What is evaluated far from rest, and what up to a strain.
struct Choice {
    far: NodeId,
    near: Option<(NodeId, f64)>,
}

/// A measure and its change, as a kernel gets them, and the true measure as a sum.
struct Sample {
    measure: f64,
    change: f64,
    exact: [f64; 2],
}

impl Sample {
    /// The change tells more than the measure does.
    fn near(reference: f64, strain: f64) -> Sample {
        // So few digits that their product with the reference is exact.
        let change = f64::from_bits(strain.to_bits() & !7);
        let more = reference * change;
        Sample { measure: reference + more, change, exact: [reference, more] }
    }

    fn far(reference: f64, stretch: f64) -> Sample {
        let measure = reference * stretch;
        Sample { measure, change: (measure - reference) / reference, exact: [measure, 0.0] }
    }

    /// A strain near rest, or a stretch far from it, that is larger by a share of itself.
    fn moved(&self, reference: f64, by: f64) -> Sample {
        if self.change.abs() < REACH {
            Sample::near(reference, self.change * (1.0 + by))
        } else {
            Sample::far(reference, self.measure / reference * (1.0 + by))
        }
    }
}

/// What forms say at a place.
struct Seen {
    values: Vec<f64>,
    /// What they change by with the logarithm of the argument.
    slopes: Vec<f64>,
    /// The value of two that agree.
    known: Option<f64>,
}

/// Where forms are compared, with true values that are found where they are asked for.
struct Samples<'a> {
    exact: &'a Energy,
    samples: Vec<Sample>,
    truths: Vec<Option<Option<[f64; 3]>>>,
}

impl<'a> Samples<'a> {
    fn new(exact: &'a Energy) -> Samples<'a> {
        let reference = exact.reference;
        let near = STRAINS.iter().flat_map(|strain| [*strain, -strain]);
        let near = near.map(|strain| Sample::near(reference, strain));
        let far = STRETCHES.iter().map(|stretch| Sample::far(reference, *stretch));
        let samples: Vec<Sample> = near.chain(far).collect();
        let truths = vec![None; samples.len()];
        Samples { exact, samples, truths }
    }

    fn strain(&self, i: usize) -> f64 {
        self.samples[i].change
    }

    /// What the left side is: at a jump the value at rest is the one that was written.
    fn side_at_rest(&self, graph: &ExprGraph, plain: NodeId, form: &NearRest) -> Comparison {
        let [Some(right), Some(left)] = &form.sides else { return Comparison::Less };
        if left.root == right.root {
            return Comparison::Less;
        }
        let (small, roots) = graph.extract(&[plain, left.root, right.root]);
        let reference = self.exact.reference;
        let mut interpreter = Interpreter::<f64>::new();
        interpreter.run(&small, |input| match input {
            Input::Current(_) | Input::Reference(_) => reference,
            Input::Change(_) => 0.0,
            other => self.exact.field(other),
        });
        let [plain, left, right] = [0, 1, 2].map(|k| interpreter.number(roots[k]));
        let is_left = (plain - left).abs() < (plain - right).abs();
        if is_left { Comparison::LessEqual } else { Comparison::Less }
    }

    /// The forms that serve.
    fn choice(&mut self, graph: &ExprGraph, order: usize, candidates: &Candidates) -> Choice {
        let Candidates { ruled, plain, near, is_guarded } = *candidates;
        let mut forms = vec![ruled, plain];
        forms.extend(near);
        let lost = self.lost(graph, order, &forms);
        let is_near = |i: usize| self.strain(i).abs() < REACH;
        let is_small = |i: usize| self.strain(i).abs() < SMALL;
        let all = 0..self.samples.len();
        let loses = |k: usize, part: &dyn Fn(usize) -> bool| {
            all.clone().filter(|i| part(*i) && lost[*i][k]).count()
        };
        let fewest = |usable: usize, part: &dyn Fn(usize) -> bool| {
            (0..usable).min_by_key(|k| loses(*k, part)).expect("at least two forms")
        };
        let everywhere = forms.len() - usize::from(near.is_some() && is_guarded);
        if let Some(k) = (0..everywhere).find(|k| loses(*k, &|_| true) == 0) {
            return Choice { far: forms[k], near: None };
        }
        let far = fewest(everywhere, &|i| !is_near(i));
        let close = fewest(forms.len(), &is_small);
        let only = Choice { far: forms[far], near: None };
        if close == far || loses(close, &is_small) >= loses(far, &is_small) {
            return only;
        }
        let beyond = all.clone().filter(|i| is_near(*i) && lost[*i][close] && !lost[*i][far]);
        let reach = beyond.map(|i| 0.99 * self.strain(i).abs()).fold(REACH, f64::min);
        if reach < SMALL {
            return only;
        }
        Choice { far: forms[far], near: Some((forms[close], reach)) }
    }

    /// Which forms have lost digits, place by place.
    fn lost(&mut self, graph: &ExprGraph, order: usize, forms: &[NodeId]) -> Vec<Vec<bool>> {
        let seen = self.seen(graph, forms);
        let has_near = forms.len() > 2;
        let trusted = if has_near { self.trusted(order, &seen) } else { Vec::new() };
        // Where no rule applied two forms are one, and agree whatever it loses. It matters where the form by
        // remainders may take its place everywhere, as far as to strong compression.
        let first_far = 2 * STRAINS.len();
        let is_one = has_near && forms[0] == forms[1] && self.is_right(order, &seen, first_far);
        let mut lost = vec![vec![false; forms.len()]; seen.len()];
        for (i, seen) in seen.iter().enumerate() {
            let Some(seen) = seen else { continue };
            let known = match seen.known {
                Some(value) if !(is_one && i >= first_far) => Some(value),
                None if trusted.contains(&i) => seen.values.last().copied(),
                _ => self.truth(i).map(|truth| truth[order]),
            };
            lost[i] = match known {
                Some(known) if known.is_finite() => compared(&seen.values, &seen.slopes, known),
                Some(_) => continue,
                // No form has a value where the energy as written has none, and each has where it has one: what
                // is too large for 256 bits on the way to it may be 0 in doubles.
                None => {
                    let has_value = seen.values[1].is_finite();
                    let is_lost = |x: &f64| x.is_finite() != has_value && self.strain(i) != 0.0;
                    seen.values.iter().map(is_lost).collect()
                }
            };
        }
        lost
    }

    /// Whether the form by remainders, the last one, has lost no digits at a place.
    fn is_right(&mut self, order: usize, seen: &[Option<Seen>], i: usize) -> bool {
        let Some(seen) = &seen[i] else { return true };
        let Some(truth) = self.truth(i).map(|truth| truth[order]) else { return false };
        // Where 256 bits leave nothing of a difference, as of `(x^1e-300 - 1)/1e-300`, no form is known to be.
        let is_known = truth.is_finite() && truth != 0.0;
        is_known && compared(&seen.values, &seen.slopes, truth).last() == Some(&false)
    }

    /// What forms say, place by place; nothing where they agree, or at a jump, where either value is right.
    fn seen(&self, graph: &ExprGraph, forms: &[NodeId]) -> Vec<Option<Seen>> {
        let (small, roots) = graph.extract(forms);
        let reference = self.exact.reference;
        let mut interpreter = Interpreter::<f64>::new();
        let mut at = |sample: &Sample| -> Vec<f64> {
            interpreter.run(&small, |input| match input {
                Input::Current(_) => sample.measure,
                Input::Reference(_) => reference,
                Input::Change(_) => sample.change,
                other => self.exact.field(other),
            });
            roots.iter().map(|root| interpreter.number(*root)).collect()
        };
        let mut seen = |sample: &Sample| {
            let values = at(sample);
            let mut beside = |strain: f64| at(&Sample::near(reference, strain)).last().copied();
            let is_jump = sample.change == 0.0
                && [TINY, -TINY].map(&mut beside) != [values.last().copied(); 2];
            if is_jump || values.iter().all(|x| agree(*x, values[0])) {
                return None;
            }
            let [less, more] = [-STEP, STEP].map(|step| at(&sample.moved(reference, step)));
            let slopes = less.iter().zip(more).map(|(x, y)| (x - y).abs() / (2.0 * STEP)).collect();
            let known = agreed(&values, sample.change.abs() < REACH);
            Some(Seen { values, slopes, known })
        };
        self.samples.iter().map(&mut seen).collect()
    }

    /// Where the form by remainders stands for the truth: at strains between a smaller and a larger one of
    /// the same sign at which it is right. What it loses it loses from some strain on, so this saves most
    /// of the true values, which take longer than all else.
    fn trusted(&mut self, order: usize, seen: &[Option<Seen>]) -> Vec<usize> {
        let mut trusted = Vec::new();
        for side in [0, 1] {
            let strains = (1..STRAINS.len()).map(|k| 2 * k + side);
            let unknown: Vec<usize> = strains
                .filter(|i| seen[*i].as_ref().is_some_and(|seen| seen.known.is_none()))
                .collect();
            let mut is_right = |i: &usize| self.is_right(order, seen, *i);
            let Some(last) = unknown.iter().rposition(&mut is_right) else { continue };
            if last > 1 && is_right(&unknown[0]) {
                trusted.extend(&unknown[1..last]);
            }
        }
        trusted
    }

    fn truth(&mut self, i: usize) -> Option<[f64; 3]> {
        if let Some(known) = self.truths[i] {
            return known;
        }
        let Energy { graph, roots: [psi, ..], measure, reference, .. } = self.exact;
        let mut interpreter = Interpreter::<Precise<256>>::new();
        let [measure_at, more] = self.samples[i].exact;
        let current = Precise::line(measure_at, 1.0, more);
        let at_rest = Precise::line(*reference, 0.0, 0.0);
        let change = Precise::binary(
            Operator::Divide,
            Precise::line(measure_at, 1.0, more),
            at_rest.clone(),
        );
        let change = Precise::binary(Operator::Subtract, change, Precise::constant(1.0));
        interpreter.run(graph.graph(), |input| match input {
            Input::Current(m) if m == *measure => current.clone(),
            Input::Reference(m) if m == *measure => at_rest.clone(),
            Input::Change(m) if m == *measure => change.clone(),
            other => Precise::line(self.exact.field(other), 0.0, 0.0),
        });
        let found = interpreter.number(*psi);
        let truth = found.parts().map(|_| found.rounded());
        self.truths[i] = Some(truth);
        truth
    }
}

fn agree(x: f64, y: f64) -> bool {
    (x - y).abs() <= FINE * UNIT_ROUNDOFF * x.abs().min(y.abs())
}

/// The value of two forms that agree. Near rest those by the rules and as written may cancel alike, so
/// that it takes the form by remainders for a witness, which is the last of three; far from rest that one
/// and the one as written may both take a change that has lost its digits in compression.
fn agreed(values: &[f64], is_near: bool) -> Option<f64> {
    let (ruled, plain) = (values[0], values[1]);
    match values.get(2) {
        Some(&near) if agree(ruled, near) || (is_near && agree(plain, near)) => Some(near),
        _ if agree(ruled, plain) && !is_near => Some(ruled),
        _ => None,
    }
}

/// Which values are further from the truth than rounding them and their argument explains, and than
/// others are; `slopes` are what the values change by with the logarithm of the argument.
fn compared(values: &[f64], slopes: &[f64], truth: f64) -> Vec<bool> {
    let finite = |x: f64| if x.is_nan() { f64::INFINITY } else { x };
    let off = |x: &f64| finite((x - truth).abs());
    let best = (0..values.len()).min_by(|i, j| off(&values[*i]).total_cmp(&off(&values[*j])));
    // The one that is right tells what an argument that is rounded makes of it.
    let slope = best.map_or(0.0, |best| slopes[best]);
    let scale = UNIT_ROUNDOFF * truth.abs().max(if slope.is_finite() { slope } else { 0.0 });
    let errors: Vec<f64> = values.iter().map(|x| finite(off(x) / scale)).collect();
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    errors.iter().map(|&error| error > LOST.0 && error > LOST.1 * least).collect()
}
