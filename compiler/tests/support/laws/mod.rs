//! The collection of energies, and how many digits each of them keeps.

mod collection;
mod gathered;
mod gradient;
mod measure;

use piola_compiler::audit::{Settings, audit};
use piola_compiler::expression::number::Number;
use piola_compiler::expression::precise::Precise;
use piola_compiler::expression::{Function, Operator};
use piola_compiler::{Form, Level, Model, Setting, Values, check_text};

pub(crate) use collection::{Kind, Law, collection};

/// Half the distance from 1 to the next number.
const U: f64 = f64::EPSILON / 2.0;

/// The horizon, larger than the lengths at rest that are tried.
const HORIZON: f64 = 6.0;

/// Largest error in u of a law that keeps its digits.
pub(crate) const BAR: f64 = 64.0;

/// The largest error of psi or one of its derivatives, and where it is.
#[derive(Clone, Debug, Default)]
pub(crate) struct Worst {
    pub(crate) error: f64,
    pub(crate) at: String,
}

impl Worst {
    fn see(&mut self, error: f64, at: impl FnOnce() -> String) {
        let error = if error.is_nan() { f64::INFINITY } else { error };
        if error > self.error {
            *self = Worst { error, at: at() };
        }
    }
}

/// What was found for a law, over all its values, at both levels.
#[derive(Clone, Debug, Default)]
pub(crate) struct Found {
    /// At strains up to a quarter.
    pub(crate) near: [Worst; 3],
    /// Everywhere else in its domain.
    pub(crate) far: [Worst; 3],
    /// At how many places it was tried.
    pub(crate) n_places: usize,
}

impl Found {
    fn see(&mut self, is_near: bool, order: usize, error: f64, at: impl FnOnce() -> String) {
        let worst = if is_near { &mut self.near } else { &mut self.far };
        worst[order].see(error, at);
    }

    pub(crate) fn is_kept_near_rest(&self) -> bool {
        self.near.iter().all(|worst| worst.error <= BAR)
    }

    pub(crate) fn is_kept(&self) -> bool {
        self.is_kept_near_rest() && self.far.iter().all(|worst| worst.error <= BAR)
    }

    /// What a law misses its bar in, in the order in which it is looked at: `psi near, psi'' far`.
    pub(crate) fn missed(&self) -> String {
        let of = |(where_, worst): (&str, &[Worst; 3])| {
            let names = ["psi", "psi'", "psi''"].into_iter().zip(worst.clone());
            let missed = names.filter(|(_, worst)| worst.error > BAR);
            missed.map(|(name, _)| format!("{name} {where_}")).collect::<Vec<_>>()
        };
        [("near", &self.near), ("far", &self.far)]
            .into_iter()
            .flat_map(of)
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// A law with one set of its values.
struct Case<'a> {
    model: &'a Model,
    values: Values,
    /// The values that are not the defaults, as text.
    with: &'a str,
}

/// Looks at a law with all its values.
///
/// # Panics
/// If it is not a potential that compiles, or its values are not ones of it.
pub(crate) fn look_at(law: &Law) -> Found {
    let (_, model) = check_text(&law.text).unwrap_or_else(|e| panic!("{}: {e:?}", law.name));
    let dimension = model.dimensions().last().unwrap();
    let mut found = Found::default();
    for (with, settings) in &law.values {
        let settings: Vec<(String, Setting)> =
            settings.iter().map(|(name, x)| (name.clone(), Setting::Number(*x))).collect();
        let values = model.values(dimension, &settings, Some(HORIZON));
        let values = values.unwrap_or_else(|e| panic!("{} with {with}: {e:?}", law.name));
        let case = Case { model: &model, values, with };
        match law.kind {
            Kind::Bonds | Kind::Areas | Kind::Volumes => measure::look_at(&case, &mut found),
            Kind::Gradients => gradient::look_at(&case, &mut found),
            Kind::Gathered => gathered::look_at(&case, &law.text, &mut found),
        }
    }
    found
}

/// The regimes in which `piola audit` finds an error above the bar, as `P in strain 1e-8`.
pub(crate) fn regimes_missed(law: &Law) -> Vec<String> {
    let (_, model) = check_text(&law.text).unwrap();
    let dimension = model.dimensions().last().unwrap();
    let values = model.values(dimension, &[], Some(HORIZON)).unwrap();
    let settings = Settings { form: FORM, level: Level::Fast, points: 1, bar: BAR };
    let (audits, _) = audit(&model, &values, &settings).unwrap();
    let mut missed = Vec::new();
    for audit in &audits {
        for regime in &audit.regimes {
            for (order, name) in audit.orders().into_iter().enumerate() {
                if regime.worst[order] > BAR {
                    missed.push(format!("{name} in {}", regime.name));
                }
            }
        }
    }
    missed
}

/// Numbers of so many digits.
type Exact = Precise<256>;

/// psi, its gradient and what this changes by in a direction, for an energy of several variables, each
/// rounded once; nothing where one is no finite number. From psi on lines along `D + e` and `D - e` for
/// each unit direction: `g.e = (g.(D + e) - g.(D - e))/2`, `e.A.D = ((D + e).A.(D + e) - (D - e).A.(D - e))/4`.
fn truth(given: &[f64], direction: &[f64], psi: impl Fn(&[Exact]) -> Exact) -> Option<Truth> {
    let n = given.len();
    let mut truth = Truth { psi: 0.0, gradient: Vec::new(), product: Vec::new() };
    for k in 0..n {
        let along = |sign: f64| {
            let unit = |j: usize| if j == k { sign } else { 0.0 };
            let line = |j: usize| Exact::line(given[j], direction[j] + unit(j), 0.0);
            psi(&(0..n).map(line).collect::<Vec<Exact>>())
        };
        let (plus, minus) = (along(1.0), along(-1.0));
        truth.psi = plus.rounded()[0];
        let minus = Exact::unary(Function::Negate, minus);
        let [_, first, second] = Exact::binary(Operator::Add, plus, minus).rounded();
        truth.gradient.push(first / 2.0);
        truth.product.push(second / 4.0);
    }
    let mut all = std::iter::once(&truth.psi).chain(&truth.gradient).chain(&truth.product);
    all.all(|x| x.is_finite()).then_some(truth)
}

struct Truth {
    psi: f64,
    gradient: Vec<f64>,
    product: Vec<f64>,
}

/// The root of the sum of squares.
fn norm(numbers: impl IntoIterator<Item = f64>) -> f64 {
    numbers.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The size of a difference in u of a scale.
fn in_units(difference: f64, scale: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference.abs() / scale / U }
}

const LEVELS: [Level; 2] = Level::ALL;
const FORM: Form = Form::Accurate;

/// Strains that energies of several variables are tried at, as powers of ten.
const DECADES: [i32; 11] = [1, 2, 3, 4, 6, 8, 10, 12, 13, 14, 15];
