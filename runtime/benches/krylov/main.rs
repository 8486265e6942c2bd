//! Exact products with the Hessian against differences of forces, on the traction bar of
//! partmann2026, and the errors of differences in metres and in nanometres.
//!
//! `cargo bench -p piola-runtime --bench krylov` prints two tables. The bar is solved from rest in one
//! step to a residual of 1e-10; the ways take turns, and of three times the least is shown, on all
//! threads. The floor is where residuals come to rest when a tolerance of 1e-17 is asked for.

#[allow(dead_code)] // Shared with the tests, which use all of it.
#[path = "../../tests/correspondence/common.rs"]
mod common;
mod counted;
#[allow(dead_code)]
#[path = "../../tests/correspondence/traction_bar.rs"]
mod traction_bar;

use std::sync::Arc;

use counted::Counted;
use piola_runtime::body::Body;
use piola_runtime::correspondence::{Discretisation, OperatorOrder};
use piola_runtime::energy::{FiniteDifferences, Products, TotalEnergy};
use piola_runtime::solve::linear::{LinearMethod, LinearOptions};
use piola_runtime::solve::newton::{NewtonError, NewtonSettings};
use traction_bar::{Bar, Solved};

const RUNS: usize = 3;

/// Products and who asks for them.
const WAYS: [(&str, Products, LinearMethod); 6] = [
    ("exact, conjugate gradients", Products::Exact, LinearMethod::MatrixFree),
    ("exact, GMRES", Products::Exact, LinearMethod::Gmres),
    ("one-sided differences, GMRES", Products::OneSided, LinearMethod::Gmres),
    ("one-sided differences, conjugate gradients", Products::OneSided, LinearMethod::MatrixFree),
    ("central differences, GMRES", Products::Central, LinearMethod::Gmres),
    ("central differences, conjugate gradients", Products::Central, LinearMethod::MatrixFree),
];

fn main() {
    println!("| products | step of (3.74): m | nm | `one-sided`: m | nm | `central`: m | nm |");
    println!("|---|---|---|---|---|---|---|");
    let of = |way: &dyn Fn(f64) -> f64| format!("{:.1e} | {:.1e}", way(2e-3), way(2e-9));
    let [one_sided, central] = [Products::OneSided, Products::Central]
        .map(|products| of(&|spacing| error(spacing, |energy, u, p| own(energy, products, u, p))));
    println!("| error | {} | {one_sided} | {central} |", of(&|spacing| error(spacing, papers)));
    println!();
    for across in [5, 10] {
        bar(across);
    }
}

fn bar(across: usize) {
    let bar = Bar::new(across, 3, Discretisation::BondQuadrature);
    let mut least = [f64::INFINITY; WAYS.len()];
    let mut rows: Vec<Option<(Solved, Counted<'_>)>> = WAYS.map(|_| None).into();
    for _ in 0..RUNS {
        for (k, (_, products, method)) in WAYS.into_iter().enumerate() {
            let counted = Counted::new(&bar.energy);
            let solved = solve(&bar, &counted, products, method, 1e-10).expect("it converges");
            least[k] = least[k].min(solved.seconds);
            rows[k] = Some((solved, counted));
        }
    }
    println!(
        "| N = {across}, m = 3 | Newton | Krylov | products | forces | s | residual | floor | elongation |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for ((row, seconds), (name, products, method)) in rows.iter().flatten().zip(least).zip(WAYS) {
        let (solved, counted) = row;
        let asked = solve(&bar, &Counted::new(&bar.energy), products, method, 1e-17);
        let floor = match asked {
            Ok(solved) => solved.residual,
            Err(error) => error
                .history
                .residual_over_reaction
                .iter()
                .fold(f64::INFINITY, |least, x| least.min(*x)),
        };
        println!(
            "| {name} | {} | {:?} | {} | {} | {seconds:.2} | {:.1e} | {floor:.1e} | {:+.6} % |",
            solved.newton_iterations,
            solved.linear_iterations,
            counted.products(),
            counted.gradients(),
            solved.residual,
            100.0 * solved.error,
        );
    }
    println!();
}

fn solve(
    bar: &Bar,
    counted: &Counted<'_>,
    products: Products,
    method: LinearMethod,
    tolerance: f64,
) -> Result<Solved, NewtonError> {
    let options = LinearOptions { method, ..LinearOptions::default() };
    let settings = NewtonSettings { tolerance, ..NewtonSettings::default() };
    let differences = FiniteDifferences::new(counted, products);
    bar.solve_by(&differences, settings, options)
}

/// The relative error of a product in a cube of 12^3 points with this spacing in m.
fn error(spacing: f64, product: impl Fn(&dyn TotalEnergy, &[f64], &[f64]) -> Vec<f64>) -> f64 {
    let positions: Vec<f64> = (0..1728)
        .flat_map(|k| [k / 144, k / 12 % 12, k % 12])
        .map(|k| spacing * f64::from(k))
        .collect();
    let volumes = vec![spacing * spacing * spacing; 1728];
    let body = Arc::new(Body::new(3, &positions, &volumes, Some(spacing)));
    let discretisation = Discretisation::BondQuadrature;
    let energy =
        common::energy(&body, 3.015 * spacing, OperatorOrder::First, discretisation, "cubic");
    let u = common::displacements(&body, &common::H, 0.01 * spacing, 3);
    let p = common::Random(7).vector(u.len());
    let mut exact = vec![0.0; u.len()];
    energy.tangent_product(&u, &p, &mut exact).expect("the state is finite");
    let found = product(&energy, &u, &p);
    let error: Vec<f64> = found.iter().zip(&exact).map(|(f, e)| f - e).collect();
    common::norm(&error) / common::norm(&exact)
}

fn own(energy: &dyn TotalEnergy, products: Products, u: &[f64], p: &[f64]) -> Vec<f64> {
    let mut found = vec![0.0; u.len()];
    let differences = FiniteDifferences::new(energy, products);
    differences.tangent_product(u, p, &mut found).expect("the state is finite");
    found
}

/// Central differences with the step (3.74) of partmann2026, the machine precision being 2^-52.
fn papers(energy: &dyn TotalEnergy, u: &[f64], p: &[f64]) -> Vec<f64> {
    let step = libm::cbrt(f64::EPSILON) * (common::norm(u) + 1.0) / common::norm(p);
    let forces = |way: f64| {
        let at: Vec<f64> = u.iter().zip(p).map(|(u, p)| u + way * step * p).collect();
        let mut forces = vec![0.0; u.len()];
        energy.gradient(&at, &mut forces).expect("the state is finite");
        forces
    };
    let (ahead, behind) = (forces(1.0), forces(-1.0));
    ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * step)).collect()
}
