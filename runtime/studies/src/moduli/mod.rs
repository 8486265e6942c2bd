//! Elastic moduli of the discrete body: `piola moduli`, `piola calibrate`.
//!
//! | module | does |
//! |---|---|
//! | [`affine`] | second derivatives of the energy density by homogeneous displacement gradients |
//! | `inside` | a point inside an endless lattice: its cliques by their measure, what they sum up to |
//! | `cubic` | the form that sums over a lattice have, for each kind of measure |
//! | `cliques` | energies of several measures there, clique by clique |
//! | `directed` | energies of bonds by their direction there, vector by vector |
//! | `states` | energies of gathered states there |
//! | `vectors` | energies of what points gather of vectors there |
//! | [`stiffness`] | the elasticity tensor and the numbers that are read off it, with derivatives |
//! | `rayleigh` | the speed of Rayleigh waves |
//! | `fracture` | what breaking a plane through a lattice releases |
//! | [`time_step`] | the largest stable step of central differences |
//! | [`mod@calibrate`] | parameters of a potential for which the body has given moduli |
//! | `text` | tables for people |
//!
//! Around a point of an endless lattice with one point per cell everything is symmetric under
//! inversion, so that a homogeneous strain leaves no force on any point and nothing relaxes: the
//! energy of affine displacements is the energy of the strain, exactly. Interactions of one measure
//! have one energy and one stiffness against it; how many there are and which way they lie is known in
//! integers ([`piola_mechanics::lattice`]). So a sum over some thousand measures, in twice the digits, is all,
//! and no digit depends on the horizon. In a cloud points do relax, and the energy of affine
//! displacements is an upper bound.

pub mod affine;
pub mod calibrate;
mod cliques;
mod cubic;
mod directed;
mod fracture;
mod inside;
mod rayleigh;
mod rest;
mod states;
pub mod stiffness;
mod text;
pub mod time_step;
mod vectors;

use serde::Serialize;

pub use affine::Affine;
pub use calibrate::{CalibrateError, Calibrated, FractureTarget, Target, Wanted, calibrate};
pub use fracture::{FractureEnergy, NoFractureEnergy, name_of_plane};
use inside::Inside;
pub use rayleigh::rayleigh_speeds;
pub use stiffness::{Modulus, Stiffness};
pub use time_step::TimeStep;

use crate::case::{Case, CaseError};

/// Whose moduli they are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// A point inside an endless lattice.
    Lattice,
    /// A whole cloud with its surface, displaced linearly: upper bounds.
    Cloud,
}

/// Phase speeds of waves along the first axis that are long against the horizon, in m/s; nothing
/// where the stiffness is negative.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Waves {
    /// In kg/m^3.
    pub density: f64,
    /// Displacements along the first axis.
    pub longitudinal: Option<f64>,
    /// Displacements along the second axis.
    pub shear: Option<f64>,
}

/// Elastic moduli of the discrete body at rest, in Pa.
#[derive(Clone, Debug, PartialEq)]
pub struct Moduli {
    /// Whose moduli they are.
    pub basis: Basis,
    /// The horizon in m.
    pub horizon: f64,
    /// The lattice spacing in m.
    pub spacing: Option<f64>,
    /// The elasticity tensor.
    pub stiffness: Stiffness,
    /// Stress at rest, d x d row by row. Moduli of a body under stress are those of the energy,
    /// without the geometric part that waves see.
    pub stress: Vec<f64>,
    /// Waves, where a density is known.
    pub waves: Option<Waves>,
    /// The largest step of central differences, where a density is known.
    pub time_step: Option<TimeStep>,
    /// What breaking releases, on a lattice; else why that is not known.
    pub fracture: Result<FractureEnergy, NoFractureEnergy>,
}

/// Reads the moduli off a scene. With a density in kg/m^3 (of the solid, also in two dimensions:
/// the thickness is the scene's, or 1 m) waves and the time step are added; the latter takes the whole body.
///
/// # Errors
/// Energies that cannot be compiled or assembled, or are not finite at rest.
pub fn moduli(case: &Case, density: Option<f64>) -> Result<Moduli, CaseError> {
    moduli_with(case, density, &Inside::new(case))
}

fn moduli_with(case: &Case, density: Option<f64>, inside: &Inside) -> Result<Moduli, CaseError> {
    let case = &case.without_fields();
    let affine = Affine::with(case, inside)?;
    let d = case.scene.body.dimension;
    let spacing = case.scene.body.points.spacing();
    let basis = if spacing.is_some() { Basis::Lattice } else { Basis::Cloud };
    let waves = density.map(|density| {
        let speed = |number: usize| {
            let square = affine.tangent(number, number) / density;
            (square >= 0.0).then(|| square.sqrt())
        };
        Waves { density, longitudinal: speed(0), shear: speed(d) }
    });
    let time_step = match density {
        Some(density) => time_step(case, density)?,
        None => None,
    };
    Ok(Moduli {
        basis,
        horizon: case.scene.horizon_radius(),
        spacing,
        stiffness: Stiffness::new(&affine),
        stress: affine.stress,
        waves,
        time_step,
        fracture: FractureEnergy::new(case, inside)?,
    })
}

fn time_step(case: &Case, density: f64) -> Result<Option<TimeStep>, CaseError> {
    let energy = case.energy(case.compile()?)?;
    let masses: Vec<f64> =
        case.body.volumes().iter().map(|volume| density * case.thickness() * volume).collect();
    TimeStep::new(&energy, &masses)
        .map_err(|found| CaseError::Body { message: case.describe(&found) })
}

impl Moduli {
    /// All of it for programs: plain numbers in SI units, `null` for what does not exist.
    pub fn json(&self) -> serde_json::Value {
        let voigt = self.stiffness.voigt();
        let row = |r: usize| -> Vec<f64> { voigt.row(r).iter().copied().collect() };
        let d = self.stiffness.dimension();
        let mut json = serde_json::json!({
            "dimension": d,
            "basis": self.basis,
            "spacing": self.spacing,
            "horizon": self.horizon,
            "voigt": (0..voigt.nrows()).map(row).collect::<Vec<_>>(),
        });
        for modulus in Modulus::ALL.into_iter().filter(|modulus| modulus.exists(d)) {
            json[modulus.name()] = serde_json::json!(self.stiffness.modulus(modulus));
        }
        json["zener"] = serde_json::json!(self.stiffness.zener());
        json["kelvin"] = serde_json::json!(self.stiffness.kelvin());
        json["stable"] = serde_json::json!(self.stiffness.is_stable());
        json["stress"] = self.stress.chunks_exact(d).map(<[f64]>::to_vec).collect();
        json["waves"] = serde_json::json!(self.waves);
        json["time_step"] = serde_json::json!(self.time_step);
        json["fracture"] = serde_json::json!(self.fracture.as_ref().ok());
        let is_told = |why: &&NoFractureEnergy| **why != NoFractureEnergy::NothingBreaks;
        if let Some(why) = self.fracture.as_ref().err().filter(is_told) {
            json["no_fracture"] = serde_json::json!(why.to_string());
        }
        json
    }
}
