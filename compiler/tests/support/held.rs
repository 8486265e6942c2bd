//! Compiled energies held against the energy as written, over numbers that carry derivatives.
//!
//! Hyper-dual numbers of the energy as written know nothing of simplification, rewriting and symbolic
//! derivatives, so a wrong rule shows. Both sides round. What rounding does is measured, not guessed:
//! both are evaluated again with operations that round at random (`noise`), and `FACTOR` times the
//! scatter is what they may differ by. Where that is more than `SHARE` of the value, numbers of any
//! precision may still confirm it; else the value is lost, which is counted, so that a test can bound
//! how often it happens. What is not a number as written must not be one when compiled.

use num_dual::HyperDual64;
use piola_compiler::expression::graph::components;
use piola_compiler::expression::interpret::Interpreter;
use piola_compiler::expression::number::Number;
use piola_compiler::expression::precise::Precise;
use piola_compiler::expression::{Input, NodeId, Operator};
use piola_compiler::point::WrittenGradientEnergy;
use piola_compiler::verify::sample::Point;
use piola_compiler::verify::truth::truth;
use piola_compiler::{
    DensityForm, GradientBatch, GradientKernel, ScalarEnergy, Values, Variant, WrittenEnergy,
};

use super::noise::{Noisy, begin, disturbed};

/// Relative difference that needs no excuse: some hundred operations, each rounded by `1.1e-16`.
const PLAIN: f64 = 1e-13;

/// Derivatives of this share of psi are nothing: squares of numbers beyond 1e154, by which that of `atan2`
/// divides, are infinite.
const NOTHING: f64 = 1e-150;

/// Evaluations whose scatter is looked at. Each result depends on many roundings, of which the
/// largest few decide; that all eight times these nearly cancel is rare.
const EVALUATIONS: u64 = 8;

/// Differences allowed, in units of the scatter: for functions that round worse than by a unit in the
/// last place, and for the luck of eight evaluations.
const FACTOR: f64 = 32.0;

/// Values known to this share of themselves are told from wrong ones.
const SHARE: f64 = 1e-3;

/// What came of comparisons, by order of the derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Held {
    /// Values that are right, and would have been told from ones that are wrong.
    pub(crate) told: [usize; 3],
    /// Values that are zero, or nothing beside the order below, on both sides.
    pub(crate) nothing: [usize; 3],
    /// Values that rounding has taken all digits of.
    pub(crate) lost: [usize; 3],
    /// No finite numbers as written.
    pub(crate) no_number: [usize; 3],
    /// Derivatives that are numbers as written, but not compiled: rules take the logarithm of a negative
    /// base where an exponent varies, if only in name.
    pub(crate) narrowed: usize,
    /// Places where psi is no number as written, nor compiled.
    pub(crate) outside: usize,
    /// Values of margins and next states that are told, and that are lost.
    pub(crate) functions: [usize; 2],
}

impl Held {
    /// Adds what came of others.
    pub(crate) fn add(&mut self, other: Held) {
        for order in 0..3 {
            self.told[order] += other.told[order];
            self.nothing[order] += other.nothing[order];
            self.lost[order] += other.lost[order];
            self.no_number[order] += other.no_number[order];
        }
        self.narrowed += other.narrowed;
        self.outside += other.outside;
        self.functions = [0, 1].map(|k| self.functions[k] + other.functions[k]);
    }

    /// What came of functions that are no energies, counted apart.
    pub(crate) fn as_functions(self) -> Held {
        let count = |counts: [usize; 3]| counts.iter().sum();
        Held { functions: [count(self.told), count(self.lost)], ..Held::default() }
    }

    /// Which share of the values that are numbers, and not zero, is lost.
    pub(crate) fn share_lost(&self) -> f64 {
        let [told, lost] = [self.told, self.lost].map(|counts| counts.iter().sum::<usize>() as f64);
        lost / (told + lost).max(1.0)
    }
}

/// psi, psi' and psi'' at one place, in every way but the compiled one.
pub(crate) trait Witness {
    /// What psi' is multiplied by to be like psi: a measure at rest.
    fn size(&self) -> f64;
    /// Whether psi is a number over plain floats, as written.
    fn is_number(&self) -> bool;
    /// Over hyper-dual numbers, as written.
    fn dual(&self) -> [f64; 3];
    /// The same with random roundings.
    fn noisy_dual(&self) -> [f64; 3];
    /// What is compiled, with random roundings.
    fn noisy_compiled(&self) -> [f64; 3];
    /// Over hyper-dual numbers, a little to either side.
    fn sides(&self) -> [[f64; 3]; 2];
    /// True values, as written; nothing where one is no finite number.
    fn truth(&self) -> Option<[f64; 3]>;
}

/// Holds compiled values against what was written; `whole` says that no term was left out.
///
/// # Errors
/// What is wrong, in words.
pub(crate) fn hold(witness: &impl Witness, found: [f64; 3], whole: bool) -> Result<Held, String> {
    let mut held = Held::default();
    let dual = witness.dual();
    let mut truth = Lazy::new(|| witness.truth());
    let mut scatter = Lazy::new(|| scatters(witness, dual));
    if !witness.is_number() && truth.get().is_none() {
        let is_given = decided_by_signs(witness) || is_limit(witness.sides(), found[0]);
        let is_given = is_given || written_by_rounding(witness);
        if whole && found[0].is_finite() && !is_given {
            return Err(format!("psi is {:e}, and no number as written", found[0]));
        }
        // Its derivatives may be numbers, but nobody asks for them.
        held.outside += 1;
        return Ok(held);
    }
    let magnitude = |order: usize| found[order].abs().max(dual[order].abs());
    for order in 0..3 {
        let (x, y) = (found[order], dual[order]);
        if !(x.is_finite() && y.is_finite()) {
            let Some(truth) = truth.get() else {
                held.no_number[order] += 1;
                continue;
            };
            if confirmed(x, truth[order]) {
                held.told[order] += 1;
                continue;
            }
            if y.is_finite() && !decided_by_rounding(witness, order) {
                if order == 0 {
                    return Err(format!("psi is {x:e}, written {y:e}, true {:e}", truth[0]));
                }
                held.narrowed += 1;
                continue;
            }
            held.lost[order] += 1;
            continue;
        }
        let below = if order == 0 { 0.0 } else { magnitude(order - 1) / witness.size() };
        let nothing = (0..order).fold(NOTHING * magnitude(0), |part, _| part / witness.size());
        let plain = PLAIN * (magnitude(order) + below) + nothing + f64::MIN_POSITIVE;
        let error = (x - y).abs();
        if error <= plain {
            let told = plain <= SHARE * magnitude(order);
            let counts = if told { &mut held.told } else { &mut held.nothing };
            counts[order] += 1;
            continue;
        }
        let tolerance = plain + FACTOR * scatter.get()[order];
        if error <= tolerance && tolerance <= SHARE * magnitude(order) {
            held.told[order] += 1;
            continue;
        }
        if truth.get().is_some_and(|truth| confirmed(x, truth[order])) {
            held.told[order] += 1;
            continue;
        }
        // A scatter that is no number: some evaluation left the domain.
        if error > tolerance && !kink(witness.sides(), order) {
            return Err(format!(
                "order {order}: {x:e}, written {y:e} +- {tolerance:e}, true {:?}",
                truth.get().map(|truth| truth[order])
            ));
        }
        held.lost[order] += 1;
    }
    Ok(held)
}

/// Whether a value is what psi tends to from either side, where it is 0/0 as written: what cancels at rest
/// may leave a number there.
fn is_limit(sides: [[f64; 3]; 2], found: f64) -> bool {
    let [left, right] = sides.map(|side| side[0]);
    (found - 0.5 * (left + right)).abs() <= left.abs() + right.abs()
}

/// Whether a derivative jumps here: where `min(l, L)` is at rest, it is either one.
fn kink(sides: [[f64; 3]; 2], order: usize) -> bool {
    let [left, right] = sides.map(|side| side[order]);
    order > 0 && (left - right).abs() > 1e-6 * (left.abs() + right.abs())
}

/// How far to either side is looked for a jump, relative to the measure at rest.
const ASIDE: f64 = 1e-9;

/// Whether a value is the true one to half its digits.
fn confirmed(x: f64, truth: f64) -> bool {
    (x - truth).abs() <= 1e-8 * truth.abs()
}

/// How far the values lie from those of noisy evaluations, of what was written and of what is compiled.
fn scatters(witness: &impl Witness, dual: [f64; 3]) -> [f64; 3] {
    begin(1, true);
    let mut scatter = [0.0_f64; 3];
    let mut first = None;
    for _ in 0..EVALUATIONS {
        let (written, compiled) = (witness.noisy_dual(), witness.noisy_compiled());
        let first = *first.get_or_insert(compiled);
        for order in 0..3 {
            let off = (written[order] - dual[order]).abs() + (compiled[order] - first[order]).abs();
            scatter[order] = if off.is_nan() { f64::INFINITY } else { scatter[order].max(off) };
        }
    }
    scatter
}

/// Whether what is compiled is a number for some random roundings: then its digits are lost.
fn decided_by_rounding(witness: &impl Witness, order: usize) -> bool {
    begin(2, true);
    (0..EVALUATIONS).any(|_| witness.noisy_compiled()[order].is_finite())
}

/// Whether psi as written is a number for some signs of the zeros on the way: rules do not keep them,
/// and 1/0 is either infinity.
fn decided_by_signs(witness: &impl Witness) -> bool {
    begin(3, false);
    (0..EVALUATIONS).any(|_| witness.noisy_dual()[0].is_finite())
}

/// The same for some random roundings: the square root of `tr(dev(F))`, which is 0, as written is one of
/// rounding.
fn written_by_rounding(witness: &impl Witness) -> bool {
    begin(4, true);
    (0..EVALUATIONS).any(|_| witness.noisy_dual()[0].is_finite())
}

/// A value that is computed when it is asked for first.
struct Lazy<T, F> {
    value: Option<T>,
    make: F,
}

impl<T, F: Fn() -> T> Lazy<T, F> {
    fn new(make: F) -> Self {
        Lazy { value: None, make }
    }

    fn get(&mut self) -> &T {
        self.value.get_or_insert_with(&self.make)
    }
}

/// An energy of a measure, or of its square.
pub(crate) struct OfMeasure<'a> {
    /// What is compiled.
    pub(crate) energy: &'a ScalarEnergy,
    /// What was written.
    pub(crate) written: &'a WrittenEnergy,
    /// Where.
    pub(crate) point: Point,
}

impl Witness for OfMeasure<'_> {
    fn size(&self) -> f64 {
        self.point.reference
    }

    fn is_number(&self) -> bool {
        self.written.evaluate(self.point.measure, self.point.reference).is_finite()
    }

    fn dual(&self) -> [f64; 3] {
        self.written.derivatives(self.point.measure, self.point.reference).into()
    }

    fn noisy_dual(&self) -> [f64; 3] {
        let varied = HyperDual64::new(self.point.measure, 1.0, 1.0, 0.0);
        let reference = HyperDual64::from_re(self.point.reference);
        let psi = self.written.evaluate(Noisy(varied), Noisy(reference)).0;
        [psi.re, psi.eps1, psi.eps1eps2]
    }

    fn noisy_compiled(&self) -> [f64; 3] {
        let mut interpreter = Interpreter::<Noisy<f64>>::new();
        let change = Noisy(disturbed(self.point.change(), 1.0));
        let [measure, reference] = [self.point.measure, self.point.reference].map(Noisy);
        self.energy.run(&mut interpreter, &measure, &reference, &change);
        self.energy.roots.map(|root| interpreter.number(root).0)
    }

    fn sides(&self) -> [[f64; 3]; 2] {
        let Point { measure, reference } = self.point;
        let at = |step: f64| self.written.derivatives(measure + step * reference, reference).into();
        [at(-ASIDE), at(ASIDE)]
    }

    fn truth(&self) -> Option<[f64; 3]> {
        truth(self.written, self.point)
    }
}

/// An energy of the deformation gradient along a line `F + t D`.
pub(crate) struct OfGradient<'a> {
    /// What it is an energy of.
    pub(crate) variant: &'a Variant,
    /// Values of its parameters.
    pub(crate) values: &'a Values,
    /// What is compiled.
    pub(crate) kernel: &'a GradientKernel,
    /// The form that is evaluated here.
    pub(crate) form: &'a DensityForm,
    /// What was written.
    pub(crate) written: &'a WrittenGradientEnergy,
    /// `F - I`, such that `F` is exact.
    pub(crate) change: &'a [f64],
    /// `D`
    pub(crate) direction: &'a [f64],
}

impl OfGradient<'_> {
    /// `F`, row by row.
    fn gradient(&self) -> Vec<f64> {
        let d = self.variant.dimension;
        let identity = |k: usize| if k / d == k % d { 1.0 } else { 0.0 };
        self.change.iter().enumerate().map(|(k, h)| identity(k) + h).collect()
    }

    /// psi, P : D and D : A : D of the kernel.
    pub(crate) fn compiled(&self) -> [f64; 3] {
        along(self.kernel, &self.gradient(), self.change, self.direction)
    }

    /// The place of a component in arrays.
    fn place(&self, component: u8) -> usize {
        let components = components(self.variant.dimension);
        components.iter().position(|known| *known == component).unwrap_or(0)
    }

    /// The energy as written, where it holds no functions of `U`.
    fn graph<N: Number>(&self, of: impl Fn(u8) -> N) -> N {
        let mut interpreter = Interpreter::<N>::new();
        interpreter.run(&self.variant.graph, |input| match input {
            Input::Variable(k) => of(k),
            Input::Parameter(i) => N::constant(self.values.parameters[usize::from(i)]),
            Input::Horizon => N::constant(self.values.horizon),
            _ => N::constant(f64::NAN),
        });
        let energies = self.variant.gradient_energies.iter();
        let terms = energies.map(|energy| interpreter.number(energy.root));
        terms.reduce(|sum, term| N::binary(Operator::Add, sum, term)).unwrap_or(N::constant(0.0))
    }

    fn varied(&self, component: u8) -> HyperDual64 {
        let place = self.place(component);
        let slope = self.direction[place];
        HyperDual64::new(self.gradient()[place], slope, slope, 0.0)
    }
}

/// psi, P : D and D : A : D of a kernel.
fn along(kernel: &GradientKernel, gradient: &[f64], change: &[f64], direction: &[f64]) -> [f64; 3] {
    let at = GradientBatch { n: 1, gradient, change, fields: &[] };
    let mut psi = [0.0];
    let [mut stress, mut product] = [vec![0.0; change.len()], vec![0.0; change.len()]];
    kernel.evaluate(at, &mut psi, &mut stress);
    kernel.product(at, direction, &mut product);
    let contracted = |tensor: &[f64]| tensor.iter().zip(direction).map(|(x, d)| x * d).sum();
    [psi[0], contracted(&stress), contracted(&product)]
}

impl Witness for OfGradient<'_> {
    fn size(&self) -> f64 {
        1.0
    }

    /// Traces of functions of `U` are known over numbers with derivatives alone.
    fn is_number(&self) -> bool {
        let gradient = self.gradient();
        let psi = self.graph(|c| gradient[self.place(c)]);
        !self.variant.traces.is_empty() || psi.is_finite()
    }

    fn dual(&self) -> [f64; 3] {
        let psi = self.written.psi(|c| self.varied(c));
        [psi.re, psi.eps1, psi.eps1eps2]
    }

    fn noisy_dual(&self) -> [f64; 3] {
        let psi = if self.variant.traces.is_empty() {
            self.graph(|c| Noisy(self.varied(c))).0
        } else {
            self.written.psi(|c| disturbed(self.varied(c), 8.0))
        };
        [psi.re, psi.eps1, psi.eps1eps2]
    }

    fn noisy_compiled(&self) -> [f64; 3] {
        if self.form.has_axes() {
            let off = |x: &[f64]| x.iter().map(|x| disturbed(*x, 8.0)).collect::<Vec<f64>>();
            return along(self.kernel, &off(&self.gradient()), &off(self.change), self.direction);
        }
        let gradient = self.gradient();
        let mut interpreter = Interpreter::<Noisy<f64>>::new();
        interpreter.run(&self.form.graph, |input| match input {
            Input::Variable(k) => Noisy(gradient[self.place(k)]),
            Input::VariableChange(k) => Noisy(self.change[self.place(k)]),
            Input::Direction(k) => Noisy(self.direction[self.place(k)]),
            _ => Noisy(f64::NAN),
        });
        let contracted = |roots: &[NodeId]| {
            let terms = roots.iter().zip(self.direction);
            terms.map(|(root, d)| interpreter.number(*root).0 * d).sum()
        };
        let psi = interpreter.number(self.form.psi).0;
        [psi, contracted(&self.form.gradient), contracted(&self.form.product)]
    }

    fn sides(&self) -> [[f64; 3]; 2] {
        let at = |step: f64| {
            let psi = self.written.psi(|c| {
                let at = self.varied(c);
                HyperDual64::new(at.re + step * at.eps1, at.eps1, at.eps2, 0.0)
            });
            [psi.re, psi.eps1, psi.eps1eps2]
        };
        [at(-ASIDE), at(ASIDE)]
    }

    fn truth(&self) -> Option<[f64; 3]> {
        fn at<const BITS: usize>(of: &OfGradient<'_>) -> Precise<BITS> {
            let gradient = of.gradient();
            of.written.psi(|c| {
                let place = of.place(c);
                Precise::line(gradient[place], of.direction[place], 0.0)
            })
        }
        let psi = at::<256>(self);
        let (parts, rounded) = if psi.doubtful() {
            let psi = at::<1408>(self);
            (psi.parts().is_some(), psi.rounded())
        } else {
            (psi.parts().is_some(), psi.rounded())
        };
        parts.then_some(rounded)
    }
}
