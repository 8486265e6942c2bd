//! The tensor form, evaluated, against psi, P and dP with 256 binary digits.

use std::fs;
use std::path::Path;

use num_dual::Dual2_64;

use super::algebra::{Factor, Invariant, Tensor};
use super::{NotInTensors, TensorForm};
use crate::expression::interpret::Interpreter;
use crate::expression::{Input, NodeId};
use crate::point::sample::{Sample, far, plus_identity, times};
use crate::point::truth::{norm, parts, truth};
use crate::test_support::values;
use crate::verify::sample::Random;
use crate::{Model, Values, check_text};

/// Largest errors of psi, P and A : H in the units of [`errors`]; they are 62, 149 and 110.
const MOST: [f64; 3] = [250.0, 500.0, 500.0];

/// A symmetric tensor as eigenvalues and axes, by Jacobi's rotations.
fn axes(symmetric: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let d = if symmetric.len() == 4 { 2 } else { 3 };
    let (mut a, mut axes) = (symmetric.to_vec(), plus_identity(&vec![0.0; d * d], 1.0));
    for _ in 0..30 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().filter(|(_, q)| *q < d) {
            let angle = 0.5 * libm::atan2(2.0 * a[p * d + q], a[q * d + q] - a[p * d + p]);
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            let mut turn = plus_identity(&vec![0.0; d * d], 1.0);
            (turn[p * d + p], turn[q * d + q]) = (cos, cos);
            (turn[p * d + q], turn[q * d + p]) = (sin, -sin);
            a = times(&times(&transpose(&turn), &a), &turn);
            axes = times(&axes, &turn);
        }
    }
    ((0..d).map(|k| a[k * d + k]).collect(), axes)
}

fn transpose(x: &[f64]) -> Vec<f64> {
    let d = if x.len() == 4 { 2 } else { 3 };
    (0..d * d).map(|k| x[k % d * d + k / d]).collect()
}

fn determinant(x: &[f64]) -> f64 {
    match x {
        [a, b, c, d] => a * d - b * c,
        [a, b, c, d, e, f, g, h, i] => {
            a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        }
        _ => panic!("{} components", x.len()),
    }
}

/// By Cramer's rule.
fn inverse(x: &[f64]) -> Vec<f64> {
    let d = if x.len() == 4 { 2 } else { 3 };
    let component = |k: usize| {
        let mut replaced = x.to_vec();
        (0..d).for_each(|row| replaced[row * d + k / d] = f64::from(u8::from(row == k % d)));
        determinant(&replaced) / determinant(x)
    };
    (0..d * d).map(component).collect()
}

fn trace(x: &[f64]) -> f64 {
    let d = if x.len() == 4 { 2 } else { 3 };
    (0..d).map(|k| x[k * d + k]).sum()
}

fn added(x: &[f64], y: &[f64], factor: f64) -> Vec<f64> {
    x.iter().zip(y).map(|(x, y)| x + factor * y).collect()
}

/// The numbers and tensors of a form at one place.
pub(crate) struct Place<'a> {
    pub(crate) form: &'a TensorForm,
    values: &'a Values,
    gradient: &'a [f64],
    direction: &'a [f64],
    invariants: Vec<f64>,
}

impl<'a> Place<'a> {
    pub(crate) fn new(
        form: &'a TensorForm,
        values: &'a Values,
        gradient: &'a [f64],
        direction: &'a [f64],
    ) -> Place<'a> {
        let mut place = Place { form, values, gradient, direction, invariants: Vec::new() };
        for invariant in &form.algebra.invariants {
            let value = match invariant {
                Invariant::Jacobian => determinant(gradient),
                Invariant::JacobianRate => {
                    determinant(gradient) * trace(&times(&inverse(gradient), direction))
                }
                Invariant::Trace(word) => trace(&place.word(word)),
                Invariant::Determinant(tensor) => determinant(&place.tensor(tensor)),
                Invariant::OfStretch(function) => {
                    let (squares, _) = axes(&times(&transpose(gradient), gradient));
                    squares.iter().map(|s| place.at(*function, s.sqrt())).sum()
                }
            };
            place.invariants.push(value);
        }
        place
    }

    pub(crate) fn number(&self, node: NodeId) -> f64 {
        self.at(node, f64::NAN)
    }

    fn at(&self, node: NodeId, stretch: f64) -> f64 {
        self.slope_at(node, stretch).0
    }

    /// A number and its derivative by the principal stretch.
    fn slope_at(&self, node: NodeId, stretch: f64) -> (f64, f64) {
        let mut interpreter = Interpreter::<Dual2_64>::new();
        let number = Dual2_64::from_re;
        interpreter.run(self.form.algebra.graph.graph(), |input| match input {
            Input::Variable(k) => {
                number(self.invariants.get(usize::from(k)).copied().unwrap_or(f64::NAN))
            }
            Input::Parameter(i) => number(self.values.parameters[usize::from(i)]),
            Input::Stretch(_) => number(stretch).derivative(),
            Input::Horizon => number(self.values.horizon),
            _ => number(f64::NAN),
        });
        let found = interpreter.number(node);
        (found.re, found.v1)
    }

    fn tensor(&self, tensor: &Tensor) -> Vec<f64> {
        let mut sum = vec![0.0; self.gradient.len()];
        for term in tensor {
            sum = added(&sum, &self.word(&term.word), self.number(term.coefficient));
        }
        sum
    }

    fn word(&self, word: &[Factor]) -> Vec<f64> {
        let unit = plus_identity(&vec![0.0; self.gradient.len()], 1.0);
        word.iter().fold(unit, |product, factor| times(&product, &self.factor(factor)))
    }

    fn factor(&self, factor: &Factor) -> Vec<f64> {
        let (f, h) = (self.gradient, self.direction);
        let rate = || {
            let half = times(&transpose(f), h);
            added(&half, &transpose(&half), 1.0)
        };
        match factor {
            Factor::Gradient => f.to_vec(),
            Factor::GradientTransposed => transpose(f),
            Factor::CauchyGreen => times(&transpose(f), f),
            Factor::Strain => {
                plus_identity(&times(&transpose(f), f), -1.0).iter().map(|x| x / 2.0).collect()
            }
            Factor::Direction => h.to_vec(),
            Factor::DirectionTransposed => transpose(h),
            Factor::CauchyGreenRate => rate(),
            Factor::StrainRate => rate().iter().map(|x| x / 2.0).collect(),
            Factor::Dyad(number) => {
                let vector = &self.form.algebra.vectors[*number];
                let n: Vec<f64> = vector.iter().map(|x| self.number(*x)).collect();
                (0..f.len()).map(|k| n[k / n.len()] * n[k % n.len()]).collect()
            }
            Factor::Inverse(tensor) => inverse(&self.tensor(tensor)),
            Factor::Deviator(word) => {
                let x = self.word(word);
                plus_identity(&x, -trace(&x) / if x.len() == 4 { 2.0 } else { 3.0 })
            }
            Factor::OfStretch(function) => {
                let (squares, axes) = axes(&times(&transpose(f), f));
                let d = squares.len();
                let mut diagonal = vec![0.0; d * d];
                (0..d).for_each(|k| diagonal[k * d + k] = self.at(*function, squares[k].sqrt()));
                times(&times(&axes, &diagonal), &transpose(&axes))
            }
            Factor::OfStretchRate(function) => {
                let (squares, axes) = axes(&times(&transpose(f), f));
                let d = squares.len();
                let at = |k: usize| self.at(*function, squares[k].sqrt());
                let mut inside = times(&times(&transpose(&axes), &rate()), &axes);
                for k in 0..d * d {
                    let (i, j) = (k / d, k % d);
                    inside[k] *= if i == j {
                        let s = squares[i].sqrt();
                        self.slope_at(*function, s).1 / (2.0 * s)
                    } else {
                        (at(i) - at(j)) / (squares[i] - squares[j])
                    };
                }
                times(&times(&axes, &inside), &transpose(&axes))
            }
        }
    }
}

/// The names and texts of the energies of `F` of the library and of the collection.
pub(crate) fn potentials() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in ["../potentials", "tests/laws/gradients"] {
        let entries = fs::read_dir(root.join(folder)).unwrap();
        files.extend(entries.map(|entry| entry.unwrap().path()));
    }
    files.sort();
    let piola = files.iter().filter(|path| path.extension().is_some_and(|end| end == "piola"));
    let text = |path: &std::path::PathBuf| {
        (path.file_stem().unwrap().display().to_string(), fs::read_to_string(path).unwrap())
    };
    piola.map(text).filter(|(_, text)| text.contains("psi(F)")).collect()
}

pub(crate) fn some_values(model: &Model, dimension: usize) -> Values {
    let defaults = &model.variant(dimension).unwrap().defaults;
    let missing = model.parameters().iter().zip(defaults).filter(|(_, value)| value.is_none());
    let given: Vec<(&str, f64)> =
        missing.enumerate().map(|(k, (p, _))| (&*p.name, 1.1 + 0.3 * k as f64)).collect();
    values(model, dimension, &given)
}

/// The largest errors of psi, P and A : H at random places, in [`f64::EPSILON`] of their norms; of psi,
/// which is a small difference of large numbers near rest, in that of P if it is larger.
fn errors(text: &str, dimension: usize) -> Result<[f64; 3], NotInTensors> {
    let (ast, model) = check_text(text).unwrap_or_else(|e| panic!("{e:#?}"));
    let form = model.in_tensors(&ast, dimension, None)?.unwrap();
    let values = some_values(&model, dimension);
    let written = model.written_gradient(&values);
    let mut random = Random::new(7);
    let (mut worst, mut n_places) = ([0.0_f64; 3], 0);
    for _ in 0..40 {
        let sample = Sample::of_gradient(far(dimension, 0.12, &mut random), &mut random);
        let Some(truth) = truth(&written, &sample) else { continue };
        let mut exact = sample.clone();
        if sample.is_near() {
            exact.gradient = plus_identity(&sample.change, 1.0);
        }
        let place = Place::new(&form, &values, &exact.gradient, &exact.direction);
        let psi = vec![place.number(form.psi)];
        let all = [psi, place.tensor(&form.stress), place.tensor(&form.product)].concat();
        n_places += 1;
        let size = |part: &std::ops::Range<usize>| norm(truth[part.clone()].iter().copied());
        let ranges = parts(dimension * dimension);
        let sizes = [size(&ranges[0]).max(size(&ranges[1])), size(&ranges[1]), size(&ranges[2])];
        for ((part, size), worst) in ranges.into_iter().zip(sizes).zip(&mut worst) {
            let difference = added(&all[part.clone()], &truth[part], -1.0);
            let error = norm(difference) / size / f64::EPSILON;
            *worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
        }
    }
    assert!(n_places >= 20, "{n_places}");
    Ok(worst)
}

#[test]
fn the_tensor_form_is_the_energy() {
    let potentials = potentials();
    let mut n_forms = 0;
    for (name, text) in &potentials {
        let (_, model) = check_text(text).unwrap_or_else(|e| panic!("{e:#?}"));
        for dimension in model.dimensions() {
            match errors(text, dimension) {
                Ok(errors) => {
                    println!("{name} {dimension}D: {errors:.0?}");
                    let kept = errors.iter().zip(MOST).all(|(error, most)| *error < most);
                    assert!(kept, "{name} {dimension}D: {errors:?}");
                    n_forms += 1;
                }
                Err(reason) => panic!("{name} {dimension}D: {reason}"),
            }
        }
    }
    assert!(n_forms >= potentials.len() && potentials.len() >= 50, "{n_forms}");
}
