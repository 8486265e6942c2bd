//! What energies of deformation gradients cost: passes, and the traction bar of partmann2026.
//!
//! `cargo bench -p piola-runtime --bench correspondence` prints two tables. Passes are those of a cube
//! of 20^3 points with a horizon of 3.015 spacings, the constant influence function and St
//! Venant-Kirchhoff material written in Rust; the fastest of several is shown, on all threads. The bar
//! is solved from rest in one step, without a stored tangent, to a residual of 1e-10.

use std::sync::Arc;
use std::time::Instant;

use piola_runtime::body::Body;
use piola_runtime::correspondence::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::TotalEnergy;
use piola_runtime::solve::linear::{LinearOptions, PreconditionerChoice};

#[allow(dead_code)] // Shared with the tests, which use all of it.
#[path = "../tests/correspondence/common.rs"]
mod common;
#[allow(dead_code)]
#[path = "../tests/correspondence/traction_bar.rs"]
mod traction_bar;

const RUNS: usize = 9;

const WAN: Discretisation = Discretisation::Stabilised(Stabilisation::Wan);

fn main() {
    println!("| energy | bonds | gradient, ns per bond | product, ns per bond |");
    println!("|---|---|---|---|");
    passes("nodal", Discretisation::Nodal);
    passes("stabilised (Wan)", WAN);
    passes("bond quadrature", Discretisation::BondQuadrature);
    println!();
    println!(
        "| bar | points | against (5.4) | preconditioner | iterations of conjugate gradients | seconds |"
    );
    println!("|---|---|---|---|---|---|");
    let bar = Discretisation::BondQuadrature;
    for (across, horizon) in [(5, 2), (5, 3), (5, 4), (5, 7), (10, 3)] {
        traction("BAQP", across, horizon, bar, PreconditionerChoice::Auto);
    }
    for horizon in [2, 3, 4] {
        traction("CW", 5, horizon, WAN, PreconditionerChoice::Auto);
    }
    for preconditioner in [PreconditionerChoice::TwoLevel, PreconditionerChoice::BlockJacobi] {
        traction("BAQP", 5, 3, bar, preconditioner);
        traction("BAQP", 10, 3, bar, preconditioner);
    }
}

fn passes(name: &str, discretisation: Discretisation) {
    let positions: Vec<f64> =
        (0..8000).flat_map(|k| [k / 400, k / 20 % 20, k % 20]).map(f64::from).collect();
    let body = Arc::new(Body::new(3, &positions, &[1.0; 8000], Some(1.0)));
    let energy = common::energy(&body, 3.015, OperatorOrder::First, discretisation, "one");
    let u = common::displacements(&body, &common::H, 0.01, 3);
    let mut out = vec![0.0; u.len()];
    let bonds = energy.neighborhood().n_bonds();
    let [gradient, product] = [false, true].map(|is_product| {
        let mut fastest = f64::INFINITY;
        for _ in 0..RUNS {
            let start = Instant::now();
            if is_product {
                energy.tangent_product(&u, &u, &mut out).expect("the state is finite");
            } else {
                energy.gradient(&u, &mut out).expect("the state is finite");
            }
            fastest = fastest.min(start.elapsed().as_secs_f64());
        }
        fastest / bonds as f64 * 1e9
    });
    println!("| {name} | {bonds} | {gradient:.1} | {product:.1} |");
}

fn traction(
    name: &str,
    across: usize,
    horizon: usize,
    discretisation: Discretisation,
    preconditioner: PreconditionerChoice,
) {
    let bar = traction_bar::Bar::new(across, horizon, discretisation);
    let solved = bar.solve(LinearOptions { preconditioner, ..LinearOptions::default() });
    println!(
        "| {name} N = {across}, m = {horizon} | {} | {:+.4} % | {} | {:?} | {:.2} |",
        solved.u.len() / 3,
        100.0 * solved.error,
        solved.preconditioner,
        solved.linear_iterations,
        solved.seconds
    );
}
