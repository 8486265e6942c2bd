//! Bodies, and their energies with all derivatives: peridynamics without scenes, solvers or files.
//!
//! | part | modules |
//! |---|---|
//! | bodies and who interacts | [`body`], [`lattice`], [`neighborhood`], [`interaction`], [`weights`], [`surface`] |
//! | bonds that break, bonds that dissipate | [`fracture`], [`dissipation`] |
//! | energy densities | [`kernel`], on the measures of [`geometry`] by [`element`]; [`sheet`] |
//! | energies of a body | [`assembly`] of interactions, [`deformation`] of deformation gradients, [`states`] of what points gather; all are an [`energy::Energy`] |
//! | what they are made of | [`matrix`], [`vector`] |
//! | options by their words | [`words`] |
//!
//! An energy density may come from the compiler or be a closure. Here a bar of springs is stretched,
//! and goes downhill until it is in equilibrium:
//!
//! ```
//! use std::sync::Arc;
//!
//! use piola_mechanics::assembly::{DiscreteEnergy, Laws};
//! use piola_mechanics::body::Body;
//! use piola_mechanics::energy::Energy;
//! use piola_mechanics::kernel::{Batch, Order, Outputs};
//! use piola_mechanics::lattice::{Lattice, Nodes};
//! use piola_mechanics::weights::Weights;
//!
//! // psi = 1/2 L e^2 of the strain e = (l - L)/L, and its derivatives by l, of bonds side by side.
//! let spring = |bonds: Batch<'_>, order: Order, out: Outputs<'_>| {
//!     for (k, (rest, e)) in bonds.reference.iter().zip(bonds.change).enumerate() {
//!         out.psi[k] = 0.5 * rest * e * e;
//!         if order != Order::Energy {
//!             out.dpsi[k] = *e;
//!         }
//!         if order == Order::Tangent {
//!             out.d2psi[k] = 1.0 / rest;
//!         }
//!     }
//! };
//!
//! let (lower, upper) = (vec![0.0, 0.0], vec![8.0, 2.0]);
//! let points = Lattice { lower, upper, spacing: 1.0, nodes: Nodes::Cells }.points()?;
//! let body = Arc::new(Body::new(2, &points.positions, &points.volumes, Some(1.0)));
//! let laws = Laws { bond: Some(Box::new(spring)), ..Laws::default() };
//! let energy = DiscreteEnergy::new(Arc::clone(&body), 1.5, Weights::Volumes, laws)?;
//!
//! // The last points at both ends are held, those on the right half a spacing further out.
//! let x = |k: usize| body.position(k / 2)[0];
//! let is_free = |k: usize| x(k) > 1.0 && x(k) < 7.0;
//! let n = 2 * body.n_points();
//! let mut u: Vec<f64> = (0..n).map(|k| if x(k) > 7.0 && k % 2 == 0 { 0.5 } else { 0.0 }).collect();
//! let mut forces = vec![0.0; n];
//! for _ in 0..2000 {
//!     energy.forces(&u, &mut forces)?;
//!     (0..n).filter(|k| is_free(*k)).for_each(|k| u[k] -= 0.2 * forces[k]);
//! }
//!
//! // Nothing pulls at free points, and what holds one end holds the other.
//! energy.forces(&u, &mut forces)?;
//! assert!((0..n).filter(|k| is_free(*k)).all(|k| forces[k].abs() < 1e-12));
//! let pull = |end: fn(f64) -> bool| -> f64 {
//!     (0..n).step_by(2).filter(|k| end(x(*k))).map(|k| forces[k]).sum()
//! };
//! let (left, right) = (pull(|x| x < 1.0), pull(|x| x > 7.0));
//! assert!(right > 0.0 && (left + right).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Per-point arrays are in the body's order, `n x d` row by row, in SI units.

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod assembly;
pub mod body;
pub mod dissipation;
pub mod element;
pub mod energy;
mod fields;
pub mod fracture;
pub mod geometry;
pub mod interaction;
pub mod kernel;
pub mod lattice;
pub mod materials;
pub mod matrix;
pub mod neighborhood;
pub mod pace;
mod pool;
pub mod sheet;
pub mod surface;
#[doc(hidden)]
pub mod testing;
pub mod vector;
pub mod weights;
pub mod words;

pub use fields::{deformation, least_squares, states, vectors};
