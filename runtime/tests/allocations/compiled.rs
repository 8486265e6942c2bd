//! Energies of the library as users run them: compiled.

use std::sync::Arc;

use piola_compiler::{Compiled, Form, Level, Mode, Setting, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Elements};
use piola_runtime::body::Body;
use piola_runtime::deformation::{DeformationEnergy, Formulation, OperatorOrder};
use piola_runtime::element::{CoupledElement, Element, MeasureElement, SumElement};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Coupled, Law, VariablesLaw};
use piola_runtime::states::{StateEnergy, StateLaws};
use piola_runtime::weights::Weights;

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
    energies.push(("compiled sides, areas and volumes".into(), of_cliques(body, horizon)));
    energies
}

/// Energies of several measures beside those of one, of triangles or, in space, of tetrahedra.
fn of_cliques(body: &Arc<Body>, horizon: f64) -> Box<dyn Energy> {
    let d = body.dimension();
    let text = match d {
        2 => "potential p\npsi(a) = (a/A - 1)^2\npsi(a, l1) = (a/A - 1)^2*l1/L1",
        _ => "potential p\npsi(v) = (v/V - 1)^2\npsi(v, a1, l1) = (v/V - 1)^2*a1/A1*l1/L1",
    };
    let (_, model) = check_text(text).unwrap();
    let values = model.values(d, &[], Some(horizon)).unwrap();
    let mode = Mode::Jit(Level::default());
    let Compiled { kernels, coupled, .. } = model.compile(&values, mode, Form::Accurate).unwrap();
    let [kernel] = kernels.try_into().unwrap();
    let alone = MeasureElement::new(kernel.measure(), d, Box::new(kernel));
    let several = coupled
        .into_iter()
        .map(|kernel| CoupledElement::new(kernel.clique(), d, Box::new(Coupled::new(kernel))));
    let sum: Box<dyn Element> = several
        .fold(Box::new(alone), |sum, element| Box::new(SumElement::new(sum, Box::new(element))));
    let elements = match d {
        2 => Elements { triangle: Some(sum), ..Elements::default() },
        _ => Elements { tetrahedron: Some(sum), ..Elements::default() },
    };
    let weights = Weights::Truncated;
    Box::new(DiscreteEnergy::with_elements(Arc::clone(body), horizon, weights, elements).unwrap())
}
