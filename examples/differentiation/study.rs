//! What the methods are measured with: points, true derivatives, median errors.

use piola_compiler::expression::Operator;
use piola_compiler::expression::number::Number;
use piola_compiler::expression::precise::Precise;
use piola_compiler::verify::sample::Point;
use piola_compiler::verify::truth::truth;

use crate::methods::{
    Energy, Method, central, central_of_gradient, complex, complex_of_gradient, double, forward,
    hyper_complex, hyper_complex_split, hyper_dual, symbolic, symbolic_textbook,
};

/// Digits of a true derivative: errors below the rounding of the truth count too.
type Exact = Precise<512>;

/// Bonds per median.
const N_POINTS: usize = 41;

/// An order of derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// psi'
    First,
    /// psi''
    Second,
}

/// The median relative error of a method, by step or by strain.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    /// The method, and the energy where there is a choice.
    pub(crate) name: &'static str,
    /// Step or strain, and error; infinite where most errors are no number.
    pub(crate) errors: Vec<(f64, f64)>,
}

impl Line {
    /// The least error and the largest step that comes within a half of it.
    pub(crate) fn best(&self) -> (f64, f64) {
        let least = self.errors.iter().map(|(_, error)| *error).fold(f64::INFINITY, f64::min);
        let near = self.errors.iter().filter(|(_, error)| *error <= 1.5 * least);
        (least, near.map(|(h, _)| *h).fold(0.0, f64::max))
    }
}

/// A bond for which an energy is differentiated, with the truth.
struct Sample {
    at: Point,
    psi: Exact,
    truth: [f64; 3],
}

impl Sample {
    /// Of bonds that numbers evenly spread from 0.6 to 3 are made into.
    fn all(energy: &Energy, bond: impl Fn(f64) -> Point) -> Vec<Sample> {
        let lengths = (0..N_POINTS).map(|k| 0.6 + 2.4 * k as f64 / (N_POINTS - 1) as f64);
        lengths.filter_map(|length| Sample::new(energy, bond(length))).collect()
    }

    fn new(energy: &Energy, at: Point) -> Option<Sample> {
        let l = Exact::variable(at.measure);
        let psi = energy.written.evaluate(l, Exact::constant(at.reference));
        Some(Sample { at, psi, truth: truth(&energy.written, at)? })
    }

    /// The relative error of a derivative.
    ///
    /// The truth is rounded, and what is found may be as near to it as that: so they are subtracted
    /// before anything is rounded, as the energy less a parabola that has the derivative found.
    fn error(&self, order: Order, found: f64) -> f64 {
        let times = |x, y| Exact::binary(Operator::Multiply, x, y);
        let minus = |x, y| Exact::binary(Operator::Subtract, x, y);
        let away = minus(Exact::variable(self.at.measure), Exact::constant(self.at.measure));
        let found = times(Exact::constant(found), away.clone());
        let (parabola, order) = match order {
            Order::First => (found, 1),
            Order::Second => (times(Exact::constant(0.5), times(found, away)), 2),
        };
        let difference = minus(self.psi.clone(), parabola).rounded()[order];
        let error = (difference / self.truth[order]).abs();
        // What is no number has no right digit either.
        if error.is_nan() { f64::INFINITY } else { error }
    }
}

/// The median relative error of a method for these bonds.
fn median_error(energy: &Energy, samples: &[Sample], method: Method, h: f64, order: Order) -> f64 {
    let mut errors: Vec<f64> = samples
        .iter()
        .map(|sample| sample.error(order, method(energy, sample.at, h)[order as usize]))
        .collect();
    errors.sort_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Four steps a decade from 1e-1 to 1e-20, where differences have long been lost, then one in five
/// decades to 1e-170, where even the square of the step is lost.
fn steps() -> Vec<f64> {
    let quarters = (4..=80).map(|k| -f64::from(k) / 4.0);
    let far = (5..=34).map(|k| -5.0 * f64::from(k));
    quarters.chain(far).map(|exponent| libm::pow(10.0, exponent)).collect()
}

/// What is drawn in one chart.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    /// `psi'` or `psi''`, and of what.
    pub(crate) title: &'static str,
    /// What errors are against.
    pub(crate) x: &'static str,
    /// One per method.
    pub(crate) lines: Vec<Line>,
}

type Named = (&'static str, Method);

const FIRST: [Named; 7] = [
    ("forward differences", forward),
    ("central differences", central),
    ("complex step", complex),
    ("double numbers", double),
    ("hyper-complex", hyper_complex),
    ("hyper-dual", hyper_dual),
    ("symbolic, no step", symbolic),
];

const SECOND: [Named; 7] = [
    ("forward differences", forward),
    ("central differences", central),
    ("complex step", complex),
    ("double numbers", double),
    ("hyper-complex", hyper_complex),
    ("hyper-complex, split", hyper_complex_split),
    ("hyper-dual", hyper_dual),
];

const SECOND_OF_GRADIENT: [Named; 3] = [
    ("central differences", central_of_gradient),
    ("complex step", complex_of_gradient),
    ("symbolic, no step", symbolic),
];

/// The errors of Fig. 12 of firooz2023 in three panels, and those near rest in a fourth.
///
/// # Errors
/// Files of energies that are none.
pub(crate) fn panels() -> Result<[Panel; 4], String> {
    let energy = Energy::new(include_str!("logarithm.piola"), &[])?;
    let against_step = |title, order, methods: &[Named]| Panel {
        title,
        x: "step",
        lines: against_step(&energy, order, methods),
    };
    Ok([
        against_step("psi' from psi", Order::First, &FIRST),
        against_step("psi'' from psi", Order::Second, &SECOND),
        against_step("psi'' from psi'", Order::Second, &SECOND_OF_GRADIENT),
        Panel { title: "psi' near rest", x: "strain", lines: against_strain()? },
    ])
}

/// Medians over 41 lengths from 0.6 to 3 of a bond of length 1 at rest.
fn against_step(energy: &Energy, order: Order, methods: &[Named]) -> Vec<Line> {
    let samples = Sample::all(energy, |l| Point { measure: l, reference: 1.0 });
    let line = |&(name, method): &Named| {
        let error = |h| median_error(energy, &samples, method, h, order);
        Line { name, errors: steps().into_iter().map(|h| (h, error(h))).collect() }
    };
    methods.iter().map(line).collect()
}

/// Seth-Hill strains with n = -1/2, as the library writes them and rewritten by hand: medians over 41
/// bonds of lengths from 0.6 to 3 at rest, all elongated alike, those of the middle length 1.8 by the
/// strain stated. Of bonds of one length, or one strain, all might happen to be rounded the same way.
fn against_strain() -> Result<Vec<Line>, String> {
    let library = include_str!("../../potentials/firooz2023.piola");
    let textbook = Energy::new(library, &[("C1", 1.0), ("n", -0.5)])?;
    let rewritten = Energy::new(include_str!("rewritten.piola"), &[])?;
    // Serves differences of the logarithm best; the others depend on none.
    let step = libm::pow(10.0, -5.5);
    let lines: [(&str, &Energy, Method); 6] = [
        ("central, textbook psi", &textbook, central),
        ("central, rewritten psi", &rewritten, central),
        ("hyper-dual, textbook psi", &textbook, hyper_dual),
        ("hyper-dual, rewritten psi", &rewritten, hyper_dual),
        ("symbolic, textbook form", &textbook, symbolic_textbook),
        ("symbolic, accurate form", &textbook, symbolic),
    ];
    let line = |(name, energy, method): (&'static str, &Energy, Method)| {
        let error = |strain: f64| {
            let elongation = 1.8 * strain;
            let bond = |rest| Point { measure: rest + elongation, reference: rest };
            let samples = Sample::all(energy, bond);
            median_error(energy, &samples, method, step, Order::First)
        };
        let strains = (2..=28).map(|k| libm::pow(10.0, -f64::from(k) / 2.0));
        Line { name, errors: strains.map(|strain| (strain, error(strain))).collect() }
    };
    Ok(lines.into_iter().map(line).collect())
}
