//! Energies of the library as users run them: compiled.

use std::sync::Arc;

use piola_compiler::{Compiled, Form, Level, Mode, Setting, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::{DeformationEnergy, Formulation, OperatorOrder};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Law, VariablesLaw};
use piola_runtime::states::{StateEnergy, StateLaws};

use crate::families;

/// A potential of the library in the dimension of a body.
fn library(name: &str, parameters: &[(&str, f64)], d: usize, horizon: f64) -> Compiled {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../potentials");
    let text = std::fs::read_to_string(format!("{folder}/{name}.piola")).unwrap();
    let (_, model) = check_text(&text).unwrap();
    let setting = |(name, x): &(&str, f64)| (name.to_string(), Setting::Number(*x));
    let settings: Vec<(String, Setting)> = parameters.iter().map(setting).collect();
    let values = model.values(d, &settings, Some(horizon)).unwrap();
    model.compile(&values, Mode::Jit(Level::default()), Form::Accurate).unwrap()
}

/// Gathered states, and deformation gradients at points and at bonds, with and without principal axes.
pub(crate) fn energies(body: &Arc<Body>, horizon: f64) -> Vec<(String, Box<dyn Energy>)> {
    let d = body.dimension();
    let solid = library("linear_peridynamic_solid", &[("K", 2.0), ("G", 0.5)], d, horizon);
    let kernels = solid.gathered.unwrap();
    let laws = StateLaws {
        of_law: Vec::new(),
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        points: kernels.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        bonds: kernels.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        arguments: ["theta", "l, m"].map(String::from),
    };
    let solid = StateEnergy::new(Arc::clone(body), horizon, laws).unwrap();
    let mut energies: Vec<(String, Box<dyn Energy>)> =
        vec![("compiled linear_peridynamic_solid".into(), Box::new(solid))];
    for name in ["neo_hooke", "hencky"] {
        for discretisation in families::DISCRETISATIONS {
            let law = library(name, &[("lambda", 2.0), ("mu", 0.5)], d, horizon).gradient.unwrap();
            let influence = &*families::influence("cubic", d, horizon);
            let order = OperatorOrder::First;
            let formulation = Formulation { horizon, order, discretisation, influence };
            let energy =
                DeformationEnergy::new(Arc::clone(body), formulation, Box::new(law)).unwrap();
            energies.push((format!("compiled {name}, {discretisation:?}"), Box::new(energy)));
        }
    }
    energies
}
