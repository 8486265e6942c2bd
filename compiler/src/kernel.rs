//! Kernels: what goes in, what comes out, and the ways to evaluate an energy.

use std::ops::Range;

use num_dual::HyperDual64;

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Function, Input, NodeId, Operator};
use crate::jit::CompiledKernel;
use crate::measure::Measure;
use crate::model::Model;
use crate::specialise::{CompileError, Dropped, Form, ScalarEnergy, roots_of};
use crate::values::Values;
use crate::written::Written;

/// Inputs of a kernel, one entry per interaction; the first three slices have one length.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Current measures l, a or v in m, m^2, m^3.
    pub measure: &'a [f64],
    /// Reference measures L, A or V > 0.
    pub reference: &'a [f64],
    /// Relative changes `(l - L)/L`, computed from displacements.
    pub change: &'a [f64],
    /// Parameters that are fields, one after the other ([`Kernel::fields`]): entry `k*n + p` is field `k`
    /// at interaction `p` of `n`, in SI units. Nothing where the kernel takes none.
    pub fields: &'a [f64],
}

impl Batch<'_> {
    /// Whether the slices have one length.
    pub(crate) fn is_even(&self) -> bool {
        self.reference.len() == self.measure.len() && self.change.len() == self.measure.len()
    }

    /// The value of a field at an interaction.
    fn field(&self, field: usize, i: usize) -> f64 {
        self.fields[field * self.measure.len() + i]
    }
}

/// How many derivatives are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Order {
    /// The energy.
    Energy,
    /// The first derivative alone: forces without energies.
    Force,
    /// The energy and the first derivative.
    Gradient,
    /// And the second derivative.
    Tangent,
}

impl Order {
    /// All orders, ascending.
    pub const ALL: [Order; 4] = [Order::Energy, Order::Force, Order::Gradient, Order::Tangent];

    /// Whether it asks for the energy.
    pub fn has_energy(self) -> bool {
        self != Order::Force
    }

    /// Which of psi, psi' and psi'' it asks for.
    pub fn wanted(self) -> Range<usize> {
        match self {
            Order::Energy => 0..1,
            Order::Force => 1..2,
            Order::Gradient => 0..2,
            Order::Tangent => 0..3,
        }
    }
}

/// Where a kernel writes. What an order asks for has room for every entry of the batch; the rest is
/// left alone and may be empty.
#[derive(Debug)]
pub struct Outputs<'a> {
    /// The energy density, but for [`Order::Force`].
    pub psi: &'a mut [f64],
    /// Its derivative with respect to the measure, from [`Order::Force`].
    pub dpsi: &'a mut [f64],
    /// Its second derivative with respect to the measure, at [`Order::Tangent`].
    pub d2psi: &'a mut [f64],
}

impl Outputs<'_> {
    /// Whether `n` entries of this order fit.
    pub(crate) fn hold(&self, n: usize, order: Order) -> bool {
        let lengths = [self.psi.len(), self.dpsi.len(), self.d2psi.len()];
        lengths[order.wanted()].iter().all(|&length| length >= n)
    }
}

/// Outputs of a kernel, one entry per interaction.
#[derive(Clone, Debug, Default)]
pub struct Derivatives {
    /// The energy density.
    pub psi: Vec<f64>,
    /// Its derivative with respect to the measure.
    pub dpsi: Vec<f64>,
    /// Its second derivative with respect to the measure.
    pub d2psi: Vec<f64>,
}

impl Derivatives {
    /// Zeros for `n` interactions.
    pub fn zeros(n: usize) -> Derivatives {
        Derivatives { psi: vec![0.0; n], dpsi: vec![0.0; n], d2psi: vec![0.0; n] }
    }

    /// All of them, for a kernel to fill.
    pub fn outputs(&mut self) -> Outputs<'_> {
        Outputs { psi: &mut self.psi, dpsi: &mut self.dpsi, d2psi: &mut self.d2psi }
    }
}

/// How exactly machine code follows the interpreter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Level {
    /// To the last bit: elementary functions are those of `libm`, called for one entry after the other.
    Strict,
    /// exp, ln, expm1, log1p, log1pmx and powers with general exponents are inlined, each within 2
    /// units in the last place; all else is the same, and so are the bits of an energy without them.
    #[default]
    Fast,
}

impl Level {
    /// All levels, the exact one first.
    pub const ALL: [Level; 2] = [Level::Strict, Level::Fast];

    /// As written in a scene.
    pub fn name(self) -> &'static str {
        match self {
            Level::Strict => "strict",
            Level::Fast => "fast",
        }
    }
}

/// How psi, psi' and psi'' are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Machine code of the symbolic derivatives.
    Jit(Level),
    /// The same graph, interpreted; the same bits as machine code at [`Level::Strict`].
    Interpreter,
    /// The energy as written, over hyper-dual numbers of the measure.
    HyperDual,
}

/// An energy of one measure, ready to be evaluated over arrays.
#[derive(Debug)]
pub struct Kernel {
    measure: Measure,
    body: Body,
    is_constant: bool,
    is_affine: bool,
    squared: Option<Box<Kernel>>,
    /// Typical values.
    fields: Vec<f64>,
    is_multiple: bool,
}

/// The calling convention of each mode; [`Kernel::evaluate`] hides it.
#[derive(Debug)]
enum Body {
    Code(Box<CompiledKernel>),
    Graph(ScalarEnergy),
    Dual(WrittenEnergy),
}

impl Kernel {
    /// An energy with its derivatives, or as `written` for hyper-dual numbers.
    pub(crate) fn new(
        energy: ScalarEnergy,
        (mode, form): (Mode, Form),
        written: impl FnOnce() -> WrittenEnergy,
    ) -> Result<Kernel, CompileError> {
        let measure = energy.measure;
        let is_affine =
            mode == Mode::Jit(Level::Fast) && form == Form::Accurate && energy.is_affine();
        let is_constant = energy.graph.as_number(energy.roots[1]) == Some(0.0);
        let fields: Vec<f64> = energy.fields.iter().map(|(_, value)| *value).collect();
        let is_multiple = is_affine && energy.is_multiple_of_field();
        let body = match mode {
            Mode::Jit(level) => Body::Code(Box::new(CompiledKernel::new(&energy, level)?)),
            Mode::Interpreter => Body::Graph(energy),
            Mode::HyperDual => Body::Dual(written()),
        };
        Ok(Kernel { measure, body, is_constant, is_affine, squared: None, fields, is_multiple })
    }

    /// The same with its form as a function of the square.
    pub(crate) fn with_squared(self, squared: Kernel) -> Kernel {
        Kernel { squared: Some(Box::new(squared)), ..self }
    }

    /// Typical values of the parameters that are fields, in the order of [`Values::fields`]: the kernel
    /// takes the values of each at every interaction. Nothing where it depends on none.
    pub fn fields(&self) -> &[f64] {
        &self.fields
    }

    /// Whether it is a multiple of its only field, and [`Self::is_affine`].
    pub fn is_multiple_of_field(&self) -> bool {
        self.is_multiple
    }

    /// What it is a function of.
    pub fn measure(&self) -> Measure {
        self.measure
    }

    /// Whether it depends on the measure at rest alone: its derivative is 0 as it stands.
    pub fn is_constant(&self) -> bool {
        self.is_constant
    }

    /// Whether its derivative is affine in the measure, and passes may work it out without the kernel,
    /// from psi, psi' and psi'' at rest. At [`Level::Strict`], interpreted, over hyper-dual numbers and
    /// in [`Form::Textbook`] every evaluation is the kernel's own.
    pub fn is_affine(&self) -> bool {
        self.is_affine
    }

    /// The same energy as a function of `q = m^2/M`, where it is one: it takes `q`, `M` and
    /// `(q - M)/M`, and its derivatives are those by `q`. See [`Model::squared`]; only symbolic
    /// derivatives of the accurate form have one.
    pub fn squared(&self) -> Option<&Kernel> {
        self.squared.as_deref()
    }

    /// psi and the derivatives that the order asks for, for every entry of the batch.
    ///
    /// # Panics
    /// If the slices of the batch differ in length or an output is too short.
    pub fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        let n_values = self.fields.len() * batch.measure.len();
        assert!(batch.fields.len() == n_values, "fields at each interaction");
        match &self.body {
            Body::Code(code) => code.evaluate(batch, order, out),
            Body::Graph(energy) => {
                let mut interpreter = Interpreter::<f64>::new();
                fill(batch, order, out, |i, at| {
                    let field = |number: u16| {
                        let place = energy.fields.iter().position(|(own, _)| *own == number);
                        place.map_or(f64::NAN, |k| batch.field(k, i))
                    };
                    energy.run_with(&mut interpreter, at.each_ref(), field);
                    energy.roots.map(|root| interpreter.number(root))
                });
            }
            Body::Dual(energy) => fill(batch, order, out, |i, [measure, reference, _]| {
                // Terms that are left out may hold fields of which the kernel takes none.
                let field = (!batch.fields.is_empty()).then_some(|k| batch.field(k, i));
                energy.hyper_dual(measure, reference, field).into()
            }),
        }
    }

    /// psi, psi' and psi'' for every entry of the batch.
    ///
    /// # Panics
    /// If the slices of the batch differ in length.
    pub fn derivatives(&self, batch: Batch<'_>) -> Derivatives {
        let mut out = Derivatives::zeros(batch.measure.len());
        self.evaluate(batch, Order::Tangent, out.outputs());
        out
    }
}

/// Writes what the order asks for of psi, psi', psi'' entry by entry.
fn fill(
    batch: Batch<'_>,
    order: Order,
    out: Outputs<'_>,
    mut at: impl FnMut(usize, [f64; 3]) -> [f64; 3],
) {
    assert!(batch.is_even() && out.hold(batch.measure.len(), order), "one entry per interaction");
    for i in 0..batch.measure.len() {
        let known = [batch.measure[i], batch.reference[i], batch.change[i]];
        let [psi, dpsi, d2psi] = at(i, known);
        if order.has_energy() {
            out.psi[i] = psi;
        }
        if order >= Order::Force {
            out.dpsi[i] = dpsi;
        }
        if order == Order::Tangent {
            out.d2psi[i] = d2psi;
        }
    }
}

/// The energy of a measure exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenEnergy {
    energy: Written,
    of_square: bool,
}

impl WrittenEnergy {
    /// One root of a variant's graph.
    pub(crate) fn of_root(graph: &ExprGraph, root: NodeId, values: &Values) -> WrittenEnergy {
        WrittenEnergy { energy: Written::new(graph, &[root], values), of_square: false }
    }

    /// The same energy as a function of `q = m^2/M` and `M`, by `m = sqrt(q*M)`.
    pub fn of_square(self) -> WrittenEnergy {
        WrittenEnergy { of_square: true, ..self }
    }

    /// The energy over any number type, as a function of the measure and its reference.
    pub fn evaluate<N: Number>(&self, measure: N, reference: N) -> N {
        self.evaluate_with(measure, reference, None::<fn(usize) -> f64>)
    }

    /// The same with some parameters, by their numbers, that vary.
    pub(crate) fn evaluate_at_states<N: Number>(
        &self,
        measure: N,
        reference: N,
        state: impl Fn(u16) -> Option<N>,
    ) -> N {
        self.energy.sum(|input| match input {
            Input::Current(_) => measure.clone(),
            Input::Reference(_) => reference.clone(),
            Input::Parameter(number) if let Some(own) = state(number) => own,
            _ => self.energy.known(input, None::<&fn(usize) -> f64>),
        })
    }

    /// The same with the values of fields, by their places among them; else they have typical ones.
    fn evaluate_with<N: Number>(
        &self,
        measure: N,
        reference: N,
        field: Option<impl Fn(usize) -> f64>,
    ) -> N {
        let measure = if self.of_square {
            N::unary(Function::Sqrt, N::binary(Operator::Multiply, measure, reference.clone()))
        } else {
            measure
        };
        self.energy.sum(|input| match input {
            Input::Current(_) => measure.clone(),
            Input::Reference(_) => reference.clone(),
            _ => self.energy.known(input, field.as_ref()),
        })
    }

    /// psi, psi' and psi'' by one evaluation over hyper-dual numbers (firooz2023, eq. (27)).
    pub fn derivatives(&self, measure: f64, reference: f64) -> (f64, f64, f64) {
        self.hyper_dual(measure, reference, None::<fn(usize) -> f64>)
    }

    /// The same with the values of fields, by their places among them; else they have typical ones.
    fn hyper_dual(
        &self,
        measure: f64,
        reference: f64,
        field: Option<impl Fn(usize) -> f64>,
    ) -> (f64, f64, f64) {
        let varied = HyperDual64::new(measure, 1.0, 1.0, 0.0);
        let psi = self.evaluate_with(varied, HyperDual64::from_re(reference), field);
        (psi.re, psi.eps1, psi.eps1eps2)
    }
}

impl Model {
    /// Compiles the energies of measures; gives back what is left out.
    pub(crate) fn compile_measures(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
        kernels: &mut Vec<Kernel>,
    ) -> Result<Vec<Dropped>, CompileError> {
        let specialised = self.specialise_as(values, form)?;
        for mut energy in specialised.energies {
            let measure = energy.measure;
            let follows = values.follow_states(self) && self.remembers(measure);
            if follows {
                energy = self.consistent(&energy, values, form)?;
            }
            let written = || self.written(values, measure);
            let mut kernel = Kernel::new(energy, (mode, form), written)?;
            if !follows
                && form == Form::Accurate
                && mode != Mode::HyperDual
                && let Some(energy) = self.squared(values, measure)
            {
                kernel.squared = Some(Box::new(Kernel::new(energy, (mode, form), written)?));
            }
            kernels.push(kernel);
        }
        Ok(specialised.dropped)
    }

    /// The energy of a measure as written, for these values; 0 where there is none.
    pub fn written(&self, values: &Values, measure: Measure) -> WrittenEnergy {
        let energy = match self.variant(values.dimension) {
            Some(variant) => Written::new(&variant.graph, &roots_of(variant, measure), values),
            None => Written::nothing(values),
        };
        WrittenEnergy { energy, of_square: false }
    }
}
