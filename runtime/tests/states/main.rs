//! Energies of gathered states: the ordinary state-based solid of the library against a reference, and
//! the laws of mechanics for an energy that uses all there is.

mod checkerboard;
#[allow(dead_code)]
#[path = "../correspondence/common.rs"]
mod common;
mod differences;
mod mechanics;
mod reference;
mod rows;
#[path = "../shared/differences.rs"]
mod shared;

use std::sync::Arc;

use piola_compiler::{Form, Kernel, Level, Mode, Model, Setting, Values, check_text};
use piola_runtime::body::Body;
use piola_runtime::kernel::{Law, Measure, VariablesLaw};
use piola_runtime::states::{StateEnergy, StateLaws};

/// A potential of the library.
pub(crate) fn library(name: &str) -> String {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../potentials");
    std::fs::read_to_string(format!("{folder}/{name}.piola")).unwrap()
}

/// The library's solid with this influence function.
pub(crate) fn solid(influence: &str) -> String {
    let text = library("linear_peridynamic_solid");
    assert!(text.contains("w(L) = (delta/L)^p"));
    text.replace("w(L) = (delta/L)^p", &format!("w(L) = {influence}"))
}

pub(crate) fn values(text: &str, parameters: &[(&str, f64)], d: usize, h: f64) -> (Model, Values) {
    let (_, model) = check_text(text).unwrap();
    let settings: Vec<(String, Setting)> =
        parameters.iter().map(|(name, x)| (name.to_string(), Setting::Number(*x))).collect();
    let values = model.values(d, &settings, Some(h)).unwrap();
    (model, values)
}

/// The energy of a text with these parameters.
pub(crate) fn energy(
    text: &str,
    parameters: &[(&str, f64)],
    body: &Arc<Body>,
    horizon: f64,
) -> StateEnergy {
    let laws = laws(text, parameters, body.dimension(), horizon);
    StateEnergy::new(Arc::clone(body), horizon, laws).unwrap()
}

/// What a text gathers, and its energies.
pub(crate) fn laws(
    text: &str,
    parameters: &[(&str, f64)],
    dimension: usize,
    horizon: f64,
) -> StateLaws {
    laws_at(Level::Strict, text, parameters, (dimension, horizon))
}

/// The same at a level.
pub(crate) fn laws_at(
    level: Level,
    text: &str,
    parameters: &[(&str, f64)],
    (dimension, horizon): (usize, f64),
) -> StateLaws {
    let (model, values) = values(text, parameters, dimension, horizon);
    let mode = Mode::Jit(level);
    let kernels = model.compile(&values, mode, Form::Accurate).unwrap().gathered.unwrap();
    StateLaws {
        of_law: Vec::new(),
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        points: kernels.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        bonds: kernels.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        arguments: ["theta", "l, m"].map(String::from),
    }
}

/// The energy of bonds that gathers nothing.
pub(crate) fn of_length(model: &Model, values: &Values) -> Option<Kernel> {
    let kernels = model.compile(values, Mode::Jit(Level::Strict), Form::Accurate).unwrap().kernels;
    kernels.into_iter().find(|kernel| kernel.measure() == Measure::Length)
}
