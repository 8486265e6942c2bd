//! Points at which an energy is tried: near rest by decades, far away, at the ends of its domain.

use crate::expression::Input;
use crate::expression::interpret::Interpreter;
use crate::measure::{Argument, Measure};
use crate::model::Variant;
use crate::values::Values;

/// A measure and its value at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// l, a or v.
    pub measure: f64,
    /// L, A or V > 0.
    pub reference: f64,
}

impl Point {
    /// `(l - L)/L`
    pub fn change(self) -> f64 {
        (self.measure - self.reference) / self.reference
    }

    /// The same interaction with `q = m^2/M` in the place of its measure `m`.
    pub fn squared(self) -> Point {
        let stretch = self.measure / self.reference;
        Point { measure: stretch * stretch * self.reference, ..self }
    }

    /// The same with `m = sqrt(q*M)` in the place of `q`.
    pub fn root(self) -> Point {
        Point { measure: libm::sqrt(self.measure * self.reference), ..self }
    }
}

/// SplitMix64: a few lines, the same numbers everywhere (Steele, Lea, Flood 2014, fig. 16).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A sequence that depends on the seed alone.
    pub fn new(seed: u64) -> Random {
        Random(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// Points of the declared domain: `n` far from rest, and as many near it; fewer if the domain is
/// narrow. The default domain is l, a > 0 and all v.
pub fn points(variant: &Variant, measure: Measure, values: &Values, n: usize) -> Vec<Point> {
    let mut random = Random::new(0x0070_696f_6c61 ^ measure as u64);
    let mut stretches = vec![1.0];
    for k in 0..n {
        // Near rest: every decade of the strain from 1e-1 to 1e-13 in turn, both signs.
        let decade = -((k / 2 % 13) as f64 + random.uniform(0.0, 1.0));
        let strain = libm::pow(10.0, decade);
        stretches.push(if k % 2 == 0 { 1.0 + strain } else { 1.0 - strain });
        stretches.push(libm::pow(10.0, random.uniform(-3.0, 3.0)));
    }
    stretches.extend([1e-8, 1e8, 1.0 + f64::EPSILON, 1.0 - f64::EPSILON / 2.0]);
    if measure == Measure::Volume {
        stretches.extend((0..n / 4).map(|_| -libm::pow(10.0, random.uniform(-3.0, 3.0))));
    }
    let mut found = Vec::new();
    for stretch in stretches {
        let reference = libm::pow(10.0, random.uniform(-3.0, 1.0));
        let point = Point { measure: stretch * reference, reference };
        if contains(variant, measure, values, point) {
            found.push(point);
        }
    }
    found
}

/// Whether a point lies in the declared domain.
pub fn contains(variant: &Variant, measure: Measure, values: &Values, point: Point) -> bool {
    let mut declared =
        variant.domains.iter().filter(|d| d.argument == Argument::Measure(measure)).peekable();
    if declared.peek().is_none() {
        return measure == Measure::Volume || point.measure > 0.0;
    }
    let mut interpreter = Interpreter::<f64>::new();
    interpreter.run(&variant.graph, |input| match input {
        Input::Current(m) if m == measure => point.measure,
        Input::Reference(m) if m == measure => point.reference,
        Input::Parameter(i) => values.parameter(i).unwrap_or(f64::NAN),
        Input::Horizon => values.horizon,
        _ => f64::NAN,
    });
    declared.all(|domain| domain.contains(interpreter.number(domain.root)))
}
