//! Bodies in motion against other programs (motion_small.json): trajectories of small clouds of all
//! kinds of energies, relaxation, critical steps, a wave in a row of points.

mod balance;
#[allow(dead_code)]
#[path = "../mechanics/common.rs"]
mod bonds;
mod clique_states;
mod cliques;
mod damage;
mod directions;
mod dissipation;
mod extremes;
#[allow(dead_code)]
#[path = "../correspondence/common.rs"]
mod families;
mod families_break;
mod family_states;
mod following;
mod gathered;
mod gradients;
mod parts;
mod reference;
mod states;

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Model, Setting, Values, check_text};
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Law, VariablesLaw};
use piola_runtime::solve::motion::MotionDrive;
use piola_runtime::states::{StateEnergy, StateLaws};
use piola_runtime::weights::Weights;
use serde_json::Value;

use families::numbers;

/// A body of the reference file, and its horizon.
pub(crate) fn cloud(file: &Value, name: &Value) -> (Arc<Body>, f64) {
    let cloud = &file["clouds"][name.as_str().unwrap()];
    let d = cloud["dim"].as_u64().unwrap() as usize;
    let body = Body::new(d, &numbers(&cloud["X"]), &numbers(&cloud["V"]), None);
    (Arc::new(body), cloud["delta"].as_f64().unwrap())
}

/// The energy of a model of the reference file.
pub(crate) fn energy(model: &Value, body: &Arc<Body>, horizon: f64) -> Box<dyn Energy> {
    let number = |key: &str| model[key].as_f64().unwrap_or(0.0);
    let word = |key: &str| model[key].as_str().unwrap_or_default();
    let of_bonds = |c: [f64; 3], n: i32| -> Box<dyn Energy> {
        let laws = bonds::laws(c, n);
        let body = Arc::clone(body);
        Box::new(DiscreteEnergy::new(body, horizon, Weights::Volumes, laws).unwrap())
    };
    let of_gradients = |kind: Discretisation| -> Box<dyn Energy> {
        Box::new(families::energy(body, horizon, OperatorOrder::First, kind, word("influence")))
    };
    match word("model") {
        "BB" if word("stretch") == "sbar_fast" => of_bonds([number("c"), 0.0, 0.0], 2),
        "BB" => of_bonds([number("c"), 0.0, 0.0], 1),
        "CPD" => of_bonds(
            [number("C1"), number("C2"), number("C3")],
            model["n"].as_i64().unwrap() as i32,
        ),
        "LPS" => Box::new(solid(word("influence"), [number("K"), number("G")], body, horizon)),
        "CC" => of_gradients(Discretisation::Nodal),
        "CW" => of_gradients(Discretisation::Stabilised(Stabilisation::Wan)),
        "BAQP" => of_gradients(Discretisation::BondQuadrature),
        other => panic!("no model {other}"),
    }
}

/// The library's solid with an influence function and moduli.
fn solid(influence: &str, moduli: [f64; 2], body: &Arc<Body>, horizon: f64) -> StateEnergy {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../potentials");
    let text = std::fs::read_to_string(format!("{folder}/linear_peridynamic_solid.piola")).unwrap();
    let influence = match influence {
        "one" => "1",
        "inv" => "1/L",
        _ => "if L/delta < 1/2 then 1 - 6*(L/delta)^2 + 6*(L/delta)^3 else 2*(1 - L/delta)^3",
    };
    assert!(text.contains("w(L) = (delta/L)^p"));
    let text = text.replace("w(L) = (delta/L)^p", &format!("w(L) = {influence}"));
    let (_, model) = check_text(&text).unwrap();
    let settings = ["K", "G"].map(str::to_string).into_iter().zip(moduli.map(Setting::Number));
    let settings: Vec<_> = settings.collect();
    let values = model.values(body.dimension(), &settings, Some(horizon)).unwrap();
    gathering((&model, &values), Level::Strict, body, horizon)
}

/// The energy of a model whose points gather theta, and whose bonds know m.
pub(crate) fn gathering(
    (model, values): (&Model, &Values),
    level: Level,
    body: &Arc<Body>,
    horizon: f64,
) -> StateEnergy {
    let kernels = model.compile(values, Mode::Jit(level), Form::Accurate).unwrap();
    let kernels = kernels.gathered.unwrap();
    let laws = StateLaws {
        of_law: Vec::new(),
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        points: kernels.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        bonds: kernels.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        arguments: ["theta", "l, m"].map(String::from),
    };
    StateEnergy::new(Arc::clone(body), horizon, laws).unwrap()
}

/// What drives a body, as lists of degrees of freedom with functions of t; in the body's order.
#[derive(Default)]
pub(crate) struct Conditions {
    pub(crate) displaced: Vec<usize>,
    /// At full load, in m.
    pub(crate) displacements: Vec<f64>,
    pub(crate) driven: Vec<usize>,
    /// `a + b t` in m/s.
    pub(crate) velocities: Vec<[f64; 2]>,
    /// At full load, in N, of every degree of freedom.
    pub(crate) loads: Vec<f64>,
    /// The time at which loads and displacements are whole; 0: at once.
    pub(crate) ramp: f64,
}

impl Conditions {
    fn part(&self, t: f64) -> f64 {
        if self.ramp > 0.0 { (t / self.ramp).min(1.0) } else { 1.0 }
    }
}

impl MotionDrive for Conditions {
    fn displaced(&self) -> &[usize] {
        &self.displaced
    }

    fn displacements(&self, t: f64, values: &mut [f64]) {
        values.iter_mut().zip(&self.displacements).for_each(|(x, u)| *x = self.part(t) * u);
    }

    fn driven(&self) -> &[usize] {
        &self.driven
    }

    fn velocities(&self, t: f64, values: &mut [f64]) {
        values.iter_mut().zip(&self.velocities).for_each(|(x, [a, b])| *x = a + b * t);
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        loads.iter_mut().zip(&self.loads).for_each(|(x, load)| *x = self.part(t) * load);
    }
}
