//! How many digits of an energy and its derivatives are right: compiled energies against numbers of
//! any precision, regime by regime over the declared domain.
//!
//! An error counts in `u = 2^-53` of the true value, raw; of tensors, P and dP of energies of the
//! deformation gradient, in `u` of their norm. Where it is large because the value passes through zero,
//! what is left of it counts in what rounding the inputs changes the value by: no formula can do better
//! for an argument that is rounded. For measures `condition` says which input that is and where; for
//! energies of the deformation gradient `tensor` does.
//!
//! Conditions under which something breaks, and what bonds remember, are held to the same by [`functions`],
//! but for derivatives, which nobody takes of them; what bonds dissipate with its derivatives by the rate.

mod condition;
mod dissipation;
mod functions;
mod gradient;
mod lost;
mod measure;
mod places;
mod several;
mod tensor;

pub use functions::functions;
pub use lost::{Lost, lost};
pub use several::several;

use crate::compile::Kind;
use crate::kernel::{Kernel, Level, Mode, WrittenEnergy};
use crate::measure::Argument;
use crate::model::Model;
use crate::specialise::{CompileError, Dropped, Form, ScalarEnergy};
use crate::values::Values;
use crate::verify::sample::Point;
use crate::verify::{Subject, UNIT_ROUNDOFF};

/// Below this a true value may be lost to underflow.
const SMALLEST: f64 = 1e-290;

/// An energy and its derivatives, as names of regimes have them.
const PSI: &[&str] = &["psi", "psi'", "psi''"];

/// What an audit looks at.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The form of the energies.
    pub form: Form,
    /// The level of their code.
    pub level: Level,
    /// Points per regime.
    pub points: usize,
    /// Largest error in `u` that passes; smaller raw errors are not looked at more closely.
    pub bar: f64,
}

/// An input of an energy.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// Of an energy of a measure.
    Interaction(Point),
    /// Of an energy of the deformation gradient.
    Gradient {
        /// `F`, row by row.
        gradient: Vec<f64>,
        /// `F - I`
        change: Vec<f64>,
        /// The direction `dF` of dP.
        direction: Vec<f64>,
        /// Whether it is `F - I` that is given, and `F` is rounded.
        is_near: bool,
    },
    /// Of a function of several numbers.
    Several {
        /// What these are called, but for those of a direction.
        names: Vec<String>,
        /// What they are, those of the direction last.
        given: Vec<f64>,
    },
}

impl Place {
    /// The numbers of a function of several, with their names, without those of a direction.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, f64)> {
        let (names, given) = match self {
            Place::Several { names, given } => (&names[..], &given[..]),
            _ => (&[][..], &[][..]),
        };
        names.iter().map(String::as_str).zip(given.iter().copied())
    }
}

/// Errors in one regime.
#[derive(Clone, Debug)]
pub struct Regime {
    /// What its points have in common: `strain 1e-8`, `stretch 1e3`, ..
    pub name: String,
    /// The decade of the strain, where the regime is one near rest.
    pub strain: Option<f64>,
    /// How many points lie in the domain and have true values.
    pub n_points: usize,
    /// Largest error of psi and its derivatives in units of [`UNIT_ROUNDOFF`] of the value.
    pub raw: [f64; 3],
    /// The largest that is left where rounded inputs excuse those above the bar.
    pub worst: [f64; 3],
    /// Where that occurred, if there is one.
    pub at: [Option<Place>; 3],
}

impl Regime {
    fn new(name: String, strain: Option<f64>) -> Regime {
        let none = [0.0; 3];
        Regime { name, strain, n_points: 0, raw: none, worst: none, at: [None, None, None] }
    }

    /// Takes in what was found at other states.
    fn join(&mut self, other: Regime) {
        self.n_points += other.n_points;
        for (order, at) in other.at.into_iter().enumerate() {
            self.raw[order] = self.raw[order].max(other.raw[order]);
            if other.worst[order] > self.worst[order] {
                self.worst[order] = other.worst[order];
                self.at[order] = at;
            }
        }
    }

    /// An error, raw and what is left of it.
    fn see(&mut self, order: usize, [raw, left]: [f64; 2], place: impl FnOnce() -> Place) {
        self.raw[order] = self.raw[order].max(raw);
        if left > self.worst[order] {
            self.worst[order] = left;
            self.at[order] = Some(place());
        }
    }
}

/// Errors of one energy, margin or next state.
#[derive(Clone, Debug)]
pub struct Audit {
    /// What it is a function of; nothing of what holds several measures or what points gather.
    pub argument: Option<Argument>,
    /// What it is, if it is no energy of one argument.
    pub function: Option<Subject>,
    /// Regimes with points in the domain.
    pub regimes: Vec<Regime>,
}

impl Audit {
    fn new(argument: Argument, mut regimes: Vec<Regime>) -> Audit {
        regimes.retain(|regime| regime.n_points > 0);
        Audit { argument: Some(argument), function: None, regimes }
    }

    /// The same of what is no energy of one argument.
    fn of(function: Subject, argument: Option<Argument>, mut regimes: Vec<Regime>) -> Audit {
        regimes.retain(|regime| regime.n_points > 0);
        Audit { argument, function: Some(function), regimes }
    }

    /// How many of a value and its derivatives are judged.
    pub fn n_orders(&self) -> usize {
        match self.function {
            Some(Subject::Margin(..) | Subject::NextState(..)) => 1,
            _ => 3,
        }
    }

    /// As they are named.
    pub fn orders(&self) -> [&'static str; 3] {
        let of_argument = || self.argument.map_or(Argument::Gradient.orders(), Argument::orders);
        self.function.as_ref().map_or_else(of_argument, Subject::orders)
    }

    /// What stands in the head of its energy: `l`, `F`, `l, theta`; for what is no energy as written.
    pub fn symbol(&self) -> &str {
        match self.argument {
            Some(argument) => argument.symbol(),
            None => self.function.as_ref().map_or("", Subject::symbol),
        }
    }

    /// What is judged, as written: `psi(l)`, `break when l/L - 1 > s0`, `update k = max(k, s)`.
    pub fn title(&self) -> String {
        match self.argument {
            Some(argument) => title(argument, self.function.as_ref()),
            None => self.function.as_ref().map_or(String::new(), title_of),
        }
    }

    /// Takes in what was found of the same function at other states.
    fn join(&mut self, other: Audit) {
        for regime in other.regimes {
            match self.regimes.iter_mut().find(|own| own.name == regime.name) {
                Some(own) => own.join(regime),
                None => self.regimes.push(regime),
            }
        }
    }

    /// Largest error of psi and its derivatives that is left, in units of [`UNIT_ROUNDOFF`].
    pub fn worst(&self) -> [f64; 3] {
        let mut worst = [0.0_f64; 3];
        for regime in &self.regimes {
            for order in 0..3 {
                worst[order] = worst[order].max(regime.worst[order]);
            }
        }
        worst
    }
}

/// What is judged, as written: an energy of an argument, or a function that is none.
pub fn title(argument: Argument, function: Option<&Subject>) -> String {
    function.map_or_else(|| format!("psi({})", argument.symbol()), title_of)
}

fn title_of(function: &Subject) -> String {
    match function {
        Subject::NextState(_, text) => format!("update {text}"),
        Subject::Dissipation(text) => format!("dissipation(l) = {text}"),
        Subject::Gathering(text) => text.clone(),
        Subject::Margin(_, text) => format!("break when {text}"),
        energy => format!("psi({})", energy.symbol().replace("), psi(", ") + psi(")),
    }
}

/// Audits every energy of a measure or of the deformation gradient for these values; where an energy
/// runs as a function of the squared measure, that form as well.
///
/// # Errors
/// Energies that cannot be compiled.
pub fn audit(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<(Vec<Audit>, Vec<Dropped>), CompileError> {
    // With a typical direction of bonds.
    let values = &values.without_fields();
    let mode = Mode::Jit(settings.level);
    let kinds = [Kind::Measures, Kind::Gradient];
    let compiled = model.compile_only(&kinds, values, mode, settings.form)?;
    let specialised = model.specialise_as(values, settings.form)?;
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let mut audits = Vec::new();
    for (kernel, energy) in compiled.kernels.iter().zip(&specialised.energies) {
        let measure = kernel.measure();
        let written = model.written(values, measure);
        let mut look_at = |argument, of: (&Kernel, &ScalarEnergy, &WrittenEnergy)| {
            let regimes = measure::regimes(variant, values, argument, of, (settings, PSI));
            audits.push(Audit::new(argument, regimes));
        };
        look_at(Argument::Measure(measure), (kernel, energy, &written));
        if let Some((kernel, energy)) = kernel.squared().zip(model.squared(values, measure)) {
            look_at(Argument::Square(measure), (kernel, &energy, &written.of_square()));
        }
    }
    if let Some(kernel) = compiled.gradient {
        let regimes = gradient::regimes(&kernel, &model.written_gradient(values), (settings, 3));
        audits.push(Audit::new(Argument::Gradient, regimes));
    }
    Ok((audits, compiled.dropped))
}

/// The size of a difference in `u` of a scale.
fn in_units(found: f64, expected: f64, scale: f64) -> f64 {
    if found == expected || (expected.is_infinite() && !found.is_finite()) {
        return 0.0;
    }
    if !found.is_finite() {
        return f64::INFINITY;
    }
    if scale < SMALLEST {
        return if found.abs() < 2.0 * SMALLEST { 0.0 } else { f64::INFINITY };
    }
    (found - expected).abs() / scale / UNIT_ROUNDOFF
}
