//! What a run leaves behind, and the tables it reads.
//!
//! | file | written by | content |
//! |---|---|---|
//! | `run.pvd`, `frames/*.vtu` | [`pvd::FrameSeries`] | the body at chosen times, for ParaView; of a mesh its cells, too |
//! | `frames/*.pvtu` | [`pvd::FrameSeries`], [`pieces`] | the same of a body that many processes share |
//! | `displacement.csv`, `reactions.csv`, `energy.csv`, `probes.csv` | [`table`] | numbers, one row per point or step |
//! | `motion.csv` | [`motion`] | the account of energy of a body in motion, and its momenta |
//! | `fracture.csv` | [`fracture`], by [`motion`] or [`table`] | what broke, and where the tips of cracks are |
//! | `checkpoint.bin` | [`checkpoint`] | where a motion stands, until it is done |
//! | `picture.svg`, `picture.png` | [`picture`] | deformed body, reactions, Newton residuals |
//! | `summary.json` | [`summary`] | everything about the run that fits a page |
//! | `scene.resolved.toml` | the caller, through [`OutputFolder::write`] | the scene with all defaults |
//!
//! Every file goes through an [`OutputFolder`]: it appears whole or not at all, and one run at a time
//! holds the folder.
//! The types of this module ([`Points`], [`Frame`], [`History`]) are plain data in the user's
//! order of points; nothing here knows about kernels, energies or solvers.
//! [`read`] holds the readers of what users bring: displacement tables and point clouds.

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod atomic;
pub mod cells;
pub mod checkpoint;
pub mod folder;
pub mod fracture;
#[cfg(test)]
#[path = "../../../tests/support/frames.rs"]
mod frames;
pub mod history;
pub mod mesh;
pub mod motion;
pub mod picture;
pub mod pieces;
pub mod pvd;
pub mod read;
pub mod report;
pub mod results;
pub mod summary;
pub mod table;
pub mod vtu;

use std::sync::Arc;

use piola_mechanics::body::Body;

pub use atomic::OutputError;
pub use folder::{OutputFile, OutputFolder};
pub use history::{Broken, Definiteness, History, SetsAtRest, StepRecord};

/// The points of a body in the user's order; they do not change during a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    /// 2 or 3.
    pub dimension: usize,
    /// Reference positions, `n x d` row by row, in m.
    pub positions: Vec<f64>,
    /// Point volumes in m^d.
    pub volumes: Vec<f64>,
    /// Lattice spacing in m, if the points are a lattice.
    pub spacing: Option<f64>,
    /// The mesh that the body was made of, if it was.
    pub mesh: Option<Arc<mesh::Mesh>>,
    /// Whether all of a point's displacement is prescribed; empty where nobody said so.
    pub held: Vec<bool>,
}

impl Points {
    /// The points of `body`, back in the user's order.
    pub fn of(body: &Body) -> Points {
        let dimension = body.dimension();
        let positions = body.to_user_order(body.positions(), dimension);
        let volumes = body.to_user_order(body.volumes(), 1);
        let (spacing, held) = (body.spacing(), Vec::new());
        Points { dimension, positions, volumes, spacing, mesh: None, held }
    }

    /// The same with the mesh that the body was made of.
    pub fn with_mesh(self, mesh: Option<Arc<mesh::Mesh>>) -> Points {
        Points { mesh, ..self }
    }

    /// The same with the displacements that are prescribed: `dofs` are numbers of components, `d` of each point,
    /// in the order of `body`.
    pub fn with_held(self, body: &Body, dofs: &[usize]) -> Points {
        let mut n_prescribed = vec![0.0; body.n_points()];
        dofs.iter().for_each(|dof| n_prescribed[dof / self.dimension] += 1.0);
        let all = self.dimension as f64;
        let held = body.to_user_order(&n_prescribed, 1).iter().map(|n| *n == all).collect();
        Points { held, ..self }
    }

    /// How many points there are.
    pub fn n_points(&self) -> usize {
        self.volumes.len()
    }

    /// Reference position of a point, `d` numbers in m.
    pub fn position(&self, point: usize) -> &[f64] {
        &self.positions[point * self.dimension..(point + 1) * self.dimension]
    }
}

/// The state of a body at one time, in the user's order of points.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Load parameter, or time in s.
    pub t: f64,
    /// Displacements, `n x d` row by row, in m.
    pub displacement: Vec<f64>,
    /// `dE/du` minus the applied loads, `n x d`, in N: the residual where a component is free, the
    /// reaction where it is prescribed.
    pub residual: Vec<f64>,
    /// Velocities of a body in motion, `n x d`, in m/s; else none.
    pub velocity: Vec<f64>,
    /// What else is known of every point.
    pub fields: Vec<PointField>,
}

/// Numbers of every point, in the user's order.
#[derive(Clone, Debug, PartialEq)]
pub struct PointField {
    /// Its name in ParaView.
    pub name: String,
    /// How many numbers a point has: 1, of a vector `d`, of a tensor 9, row by row.
    pub components: usize,
    /// Point by point.
    pub values: Vec<f64>,
}

impl Frame {
    /// A frame from displacements and residuals (`n x d` each) in the body's order.
    pub fn of(body: &Body, t: f64, displacement: &[f64], residual: &[f64]) -> Frame {
        Frame {
            t,
            displacement: body.to_user_order(displacement, body.dimension()),
            residual: body.to_user_order(residual, body.dimension()),
            velocity: Vec::new(),
            fields: Vec::new(),
        }
    }

    /// The same frame with one more number per point, given in the body's order.
    pub fn with_scalar(mut self, body: &Body, name: &str, values: &[f64]) -> Frame {
        let (name, values) = (name.to_owned(), body.to_user_order(values, 1));
        self.fields.push(PointField { name, components: 1, values });
        self
    }
}

/// The shortest decimal that reads back as `x`; `inf`, `-inf` and `nan` for the rest.
///
/// Very small and very large numbers take an exponent (`1e-7`) instead of a row of zeros.
pub fn decimal(x: f64) -> String {
    let magnitude = x.abs();
    if x.is_nan() {
        "nan".to_owned()
    } else if x.is_infinite() || x == 0.0 || (1e-5..1e16).contains(&magnitude) {
        format!("{x}")
    } else {
        format!("{x:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_read_back_and_stay_short() {
        let numbers =
            [1.0, 0.1, -0.1 - 0.2, 1e-5, 9.99e-6, 1e-300, 5e-324, 1e15, 1e16, -f64::MAX, 0.0];
        for x in numbers {
            let text = decimal(x);
            assert_eq!(text.parse::<f64>().unwrap().to_bits(), x.to_bits(), "{text}");
            assert!(text.len() <= 24, "{text}");
        }
        assert_eq!(decimal(1e-7), "1e-7");
        assert_eq!(decimal(0.25), "0.25");
        assert_eq!(decimal(3.0), "3");
        assert_eq!(decimal(-0.0), "-0");
        assert_eq!(decimal(f64::INFINITY), "inf");
        assert_eq!(decimal(f64::NEG_INFINITY), "-inf");
        assert_eq!(decimal(-f64::NAN), "nan");
    }

    #[test]
    fn points_and_frames_come_back_in_the_users_order() {
        // Three points whose order along x is 2, 0, 1.
        let body = Body::new(2, &[0.5, 0.0, 0.9, 0.7, 0.1, 0.5], &[5.0, 9.0, 1.0], None);
        assert_eq!(body.user_index(), [2, 0, 1]);
        let points = Points::of(&body);
        assert_eq!(points.positions, [0.5, 0.0, 0.9, 0.7, 0.1, 0.5]);
        assert_eq!(points.volumes, [5.0, 9.0, 1.0]);
        let u = [2.0, 2.1, 0.0, 0.1, 1.0, 1.1]; // body order: points 2, 0, 1
        let frame =
            Frame::of(&body, 0.5, &u, &[0.0; 6]).with_scalar(&body, "damage", &[2.0, 0.0, 1.0]);
        assert_eq!(frame.displacement, [0.0, 0.1, 1.0, 1.1, 2.0, 2.1]);
        assert_eq!(frame.fields[0].name, "damage");
        assert_eq!(frame.fields[0].values, [0.0, 1.0, 2.0]);
    }
}
