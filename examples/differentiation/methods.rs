//! Ways to the first and second derivative of an energy, one function each.

use num_dual::HyperDual64;
use piola_compiler::expression::Input;
use piola_compiler::expression::interpret::Interpreter;
use piola_compiler::expression::number::Number;
use piola_compiler::verify::sample::Point;
use piola_compiler::{
    Batch, Form, Kernel, Level, Measure, Mode, ScalarEnergy, Setting, WrittenEnergy, check_text,
};

use crate::numbers::{Complex, Double, HyperComplex};

/// psi(l) of a file, as written and as piola derives it.
pub(crate) struct Energy {
    /// As written, over any number type.
    pub(crate) written: WrittenEnergy,
    derived: ScalarEnergy,
    accurate: Kernel,
    textbook: Kernel,
}

impl Energy {
    /// The energy of bonds in the text of a file, with values for parameters without default.
    ///
    /// # Errors
    /// A text that is no potential with such an energy and such parameters.
    pub(crate) fn new(text: &str, settings: &[(&str, f64)]) -> Result<Energy, String> {
        let (_, model) = check_text(text).map_err(|findings| format!("{findings:?}"))?;
        let settings: Vec<(String, Setting)> =
            settings.iter().map(|&(name, x)| (name.to_string(), Setting::Number(x))).collect();
        let values = model.values(3, &settings, None).map_err(|errors| format!("{errors:?}"))?;
        let kernel = |form| {
            let compiled = model
                .compile(&values, Mode::Jit(Level::Strict), form)
                .map_err(|e| e.to_string())?;
            let mut bonds = compiled.kernels.into_iter();
            bonds.find(|kernel| kernel.measure() == Measure::Length).ok_or("no psi(l)".to_string())
        };
        let specialised =
            model.specialise_as(&values, Form::Textbook).map_err(|e| e.to_string())?;
        let mut energies = specialised.energies.into_iter();
        Ok(Energy {
            written: model.written(&values, Measure::Length),
            derived: energies.find(|e| e.measure == Measure::Length).ok_or("no psi(l)")?,
            accurate: kernel(Form::Accurate)?,
            textbook: kernel(Form::Textbook)?,
        })
    }

    /// psi over any number type.
    fn psi<N: Number>(&self, l: N, bond: Point) -> N {
        self.written.evaluate(l, N::constant(bond.reference))
    }

    /// psi' as piola derives it, over any number type.
    fn dpsi<N: Number>(&self, l: N, bond: Point) -> N {
        let mut interpreter = Interpreter::new();
        interpreter.run(&self.derived.graph, |input| match input {
            Input::Current(_) => l.clone(),
            Input::Reference(_) => N::constant(bond.reference),
            // The textbook form knows no other input.
            _ => N::constant(f64::NAN),
        });
        interpreter.number(self.derived.roots[1])
    }
}

/// psi' and psi'' of a bond; not a number where a method has none. All but the symbolic
/// derivatives depend on a step.
pub(crate) type Method = fn(&Energy, Point, f64) -> [f64; 2];

/// eq. (A.4)
pub(crate) fn forward(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let l = at.measure;
    let [f0, f1, f2] = [l, l + h, l + 2.0 * h].map(|l| energy.psi(l, at));
    [(f1 - f0) / h, (f2 - 2.0 * f1 + f0) / (h * h)]
}

/// eq. (A.5)
pub(crate) fn central(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let l = at.measure;
    let [left, here, right] = [l - h, l, l + h].map(|l| energy.psi(l, at));
    [(right - left) / (2.0 * h), (right - 2.0 * here + left) / (h * h)]
}

/// eq. (A.8)
pub(crate) fn complex(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let [here, aside] = [0.0, h].map(|h| energy.psi(Complex { re: at.measure, im: h }, at));
    [aside.im / h, 2.0 * (here.re - aside.re) / (h * h)]
}

/// eq. (A.13)
pub(crate) fn hyper_complex(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let re = Complex { re: at.measure, im: h };
    let psi: HyperComplex = energy.psi(Complex { re, im: Complex::constant(h) }, at);
    [psi.re.im / h, psi.im.im / (h * h)]
}

/// eq. (A.13) through two complex numbers: with `i1*i2` a root of 1, `l + h*i1 + h*i2` is the pair
/// `l` and `l + 2*h*i`, a function of it the pair of functions, and its part before `i1*i2` half of
/// what the real parts differ by.
pub(crate) fn hyper_complex_split(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let [here, aside] = [0.0, 2.0 * h].map(|h| energy.psi(Complex { re: at.measure, im: h }, at));
    [(here.im + aside.im) / (2.0 * h), (here.re - aside.re) / (2.0 * h * h)]
}

/// eq. (A.16)
pub(crate) fn double(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let [here, aside] = [0.0, h].map(|h| energy.psi(Double { re: at.measure, un: h }, at));
    [aside.un / h, 2.0 * (aside.re - here.re) / (h * h)]
}

/// eq. (A.28)
pub(crate) fn hyper_dual(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let psi = energy.psi(HyperDual64::new(at.measure, h, h, 0.0), at);
    [psi.eps1 / h, psi.eps1eps2 / (h * h)]
}

/// Central differences of psi', as Newton's method without a tangent takes them.
pub(crate) fn central_of_gradient(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    let dpsi = |l: f64| energy.dpsi(l, at);
    [f64::NAN, (dpsi(at.measure + h) - dpsi(at.measure - h)) / (2.0 * h)]
}

/// The complex step of psi'.
pub(crate) fn complex_of_gradient(energy: &Energy, at: Point, h: f64) -> [f64; 2] {
    [f64::NAN, energy.dpsi(Complex { re: at.measure, im: h }, at).im / h]
}

/// Machine code of the symbolic derivatives.
pub(crate) fn symbolic(energy: &Energy, at: Point, _: f64) -> [f64; 2] {
    run(&energy.accurate, at)
}

/// The same without a rewrite.
pub(crate) fn symbolic_textbook(energy: &Energy, at: Point, _: f64) -> [f64; 2] {
    run(&energy.textbook, at)
}

fn run(kernel: &Kernel, at: Point) -> [f64; 2] {
    let batch = Batch {
        measure: &[at.measure],
        reference: &[at.reference],
        change: &[at.change()],
        fields: &[],
    };
    let out = kernel.derivatives(batch);
    [out.dpsi[0], out.d2psi[0]]
}
