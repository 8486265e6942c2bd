//! An energy with values for everything it depends on, as lints look at it.

use crate::expression::Input;
use crate::expression::interpret::Interpreter;
use crate::measure::Measure;
use crate::model::{Model, Variant};
use crate::specialise::{Form, ScalarEnergy};
use crate::values::{Setting, Values};
use crate::verify::sample::{Point, contains};

/// The horizon in m, where values name none.
const HORIZON: f64 = 2.0;

/// Lengths at rest that are tried, over the horizon: with one of 1 m alone `ln(l)^2` would pass for
/// `ln(l/L)^2`, and at the horizon `1 - L/delta` makes an end of every bond.
const REFERENCES: [f64; 2] = [0.5, 0.15];

/// Values that are tried, in this order, for a parameter without a default.
const CANDIDATES: [f64; 8] = [1.0, 0.5, 2.0, 0.1, 10.0, 100.0, -1.0, -0.5];

/// Points of every decade of the measure.
const POINTS_PER_DECADE: i32 = 100;

/// The energies of one measure for some values and one measure at rest.
pub(super) struct Subject<'m> {
    model: &'m Model,
    variant: &'m Variant,
    values: Values,
    pub(super) energy: ScalarEnergy,
    pub(super) reference: f64,
    /// Stretches in the declared domain, ascending.
    pub(super) stretches: Vec<f64>,
}

impl<'m> Subject<'m> {
    /// The energies of every measure for some values; none if no values are found that satisfy the
    /// conditions.
    pub(super) fn examples(model: &'m Model, dimension: usize) -> Vec<Vec<Subject<'m>>> {
        example(model, dimension).map_or(Vec::new(), |values| Subject::all(model, &values))
    }

    /// The energies of every measure, each for several measures at rest; none if they are too large to
    /// be compiled.
    pub(super) fn all(model: &'m Model, values: &Values) -> Vec<Vec<Subject<'m>>> {
        let Some(variant) = model.variant(values.dimension) else { return Vec::new() };
        let Ok(specialised) = model.specialise_as(values, Form::Textbook) else {
            return Vec::new();
        };
        let horizon = if values.horizon.is_finite() { values.horizon } else { HORIZON };
        let subjects = specialised.energies.into_iter().map(|energy| {
            let of = |part: f64| {
                let length = part * horizon;
                let reference = match energy.measure {
                    Measure::Length => length,
                    Measure::Area => length * length,
                    Measure::Volume => length * length * length,
                };
                let (energy, values) = (energy.clone(), values.clone());
                let stretches = Vec::new();
                let mut subject = Subject { model, variant, values, energy, reference, stretches };
                subject.stretches = subject.declared_stretches();
                subject
            };
            REFERENCES.map(of).into()
        });
        subjects.collect()
    }

    pub(super) fn measure(&self) -> Measure {
        self.energy.measure
    }

    /// Whether the energy depends on the direction of a bond: it is looked at in one.
    pub(super) fn sees_direction(&self) -> bool {
        let directions = self.model.directions(self.dimension());
        self.energy.fields.iter().any(|(number, _)| directions.contains(number))
    }

    pub(super) fn dimension(&self) -> usize {
        self.variant.dimension
    }

    /// As written in `psi(..)`.
    pub(super) fn symbol(&self) -> &'static str {
        self.measure().symbol()
    }

    /// Whether this stretch lies in the declared domain.
    pub(super) fn declares(&self, stretch: f64) -> bool {
        let point = Point { measure: stretch * self.reference, reference: self.reference };
        contains(self.variant, self.measure(), &self.values, point)
    }

    /// Every node of the energy's graph at a value of the measure.
    pub(super) fn evaluate(&self, measure: f64) -> Interpreter<f64> {
        let mut interpreter = Interpreter::new();
        let change = (measure - self.reference) / self.reference;
        self.energy.run(&mut interpreter, &measure, &self.reference, &change);
        interpreter
    }

    /// psi, psi' and psi'' at a value of the measure.
    pub(super) fn derivatives(&self, measure: f64) -> [f64; 3] {
        let interpreter = self.evaluate(measure);
        self.energy.roots.map(|root| interpreter.number(root))
    }

    /// The same at a stretch, which is the measure over its value at rest.
    pub(super) fn at_stretch(&self, stretch: f64) -> [f64; 3] {
        self.derivatives(stretch * self.reference)
    }

    /// A place in words: `l/L = 1.1 (L = 1)`.
    pub(super) fn place(&self, stretch: f64) -> String {
        let rest = self.measure().reference_symbol();
        let (stretch, reference) = (short(stretch), short(self.reference));
        format!("{}/{rest} = {stretch} ({rest} = {reference})", self.symbol())
    }

    /// The values on which the energy depends: `with C1 = 1, n = 2`.
    pub(super) fn values_in_words(&self) -> String {
        let energies = self.variant.energies.iter().filter(|e| e.measure == self.measure());
        let roots: Vec<_> = energies.map(|e| e.root).collect();
        let uses = |input| self.variant.graph.depends_on(&roots, input);
        let mut words = Vec::new();
        let declared = self.values.parameters.iter().zip(&self.variant.units);
        for (i, (parameter, (value, unit))) in
            self.model.parameters().iter().zip(declared).enumerate()
        {
            if uses(Input::Parameter(i as u16)) {
                words.push(format!("{} = {}", parameter.name, short(value / unit.scale)));
            }
        }
        if uses(Input::Horizon) {
            words.push(format!("delta = {}", short(self.values.horizon)));
        }
        if words.is_empty() { String::new() } else { format!("with {}", words.join(", ")) }
    }

    /// Stretches in the declared domain: every decade, near rest on both sides, near its ends.
    fn declared_stretches(&self) -> Vec<f64> {
        let decades = -3 * POINTS_PER_DECADE..=POINTS_PER_DECADE;
        let mut tried: Vec<f64> = decades
            .map(|k| libm::pow(10.0, f64::from(k) / f64::from(POINTS_PER_DECADE)))
            .flat_map(|stretch| [stretch, -stretch])
            .collect();
        let near = (1..=12).map(|k| libm::pow(10.0, f64::from(-k)));
        tried.extend(near.flat_map(|strain| [1.0 - strain, 1.0 + strain]));
        tried.extend([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 5.0]);
        tried.sort_by(f64::total_cmp);
        let inside: Vec<bool> = tried.iter().map(|stretch| self.declares(*stretch)).collect();
        let mut stretches = Vec::new();
        for (i, &stretch) in tried.iter().enumerate() {
            if inside[i] {
                stretches.push(stretch);
            }
            if i > 0 && inside[i - 1] != inside[i] {
                let ends = (tried[i - 1], stretch);
                let end = bisect(ends, |s| self.declares(s) == inside[i - 1]);
                let (last, kept) = if inside[i] { (end.1, stretch) } else { (end.0, ends.0) };
                let towards =
                    |k: i32| kept + (last - kept) * (1.0 - libm::pow(10.0, f64::from(-k)));
                stretches.extend((1..=6).map(towards).filter(|s| self.declares(*s)));
            }
        }
        stretches.sort_by(f64::total_cmp);
        stretches.dedup();
        stretches
    }
}

/// Defaults; where a parameter has none, 1 or another number that satisfies its conditions; and
/// coefficients that are 0 by default switched on, so that no energy is left out.
pub(super) fn example(model: &Model, dimension: usize) -> Option<Values> {
    let horizon = Some(HORIZON);
    let mut settings: Vec<(String, Setting)> = Vec::new();
    let missing = model.fill_with_one(dimension, &mut settings);
    for i in 0..missing.len() {
        let breaks = |value: f64, settings: &mut Vec<(String, Setting)>| {
            settings[i].1 = Setting::Number(value);
            let errors = model.values(dimension, settings, horizon).err().unwrap_or_default();
            errors.iter().any(|error| error.parameter == missing[i])
        };
        let kept = CANDIDATES.into_iter().find(|value| !breaks(*value, &mut settings))?;
        settings[i].1 = Setting::Number(kept);
    }
    model.switch_on(dimension, &mut settings, horizon);
    model.values(dimension, &settings, horizon).ok()
}

/// The last number from the lower end for which `holds` is what it is there, and the first for which
/// it is not, next to each other as numbers or nearly so. It differs at the two ends.
pub(super) fn bisect((mut low, mut high): (f64, f64), holds: impl Fn(f64) -> bool) -> (f64, f64) {
    loop {
        let middle = low + (high - low) / 2.0;
        let apart = high - low > f64::EPSILON * f64::EPSILON;
        if !apart || middle <= low || middle >= high {
            return (low, high);
        }
        if holds(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// A number in three digits.
pub(super) fn short(value: f64) -> String {
    // Written and read back, so that no zeros are left at the end.
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    let plain = rounded == 0.0 || (1e-3..1e5).contains(&rounded.abs()) || !rounded.is_finite();
    if plain { format!("{rounded}") } else { format!("{rounded:e}") }
}
