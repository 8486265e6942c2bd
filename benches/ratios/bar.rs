//! The traction bar of partmann2026: what it costs with energies of deformation gradients, exact products
//! with the Hessian against differences of forces, and the errors of differences in metres and in nanometres.

#[allow(dead_code)] // Shared with the tests, which use all of it.
#[path = "../../runtime/tests/correspondence/common.rs"]
mod common;
mod counted;
#[allow(dead_code)]
#[path = "../../runtime/tests/correspondence/traction_bar.rs"]
mod traction_bar;

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::{Energy, Products, Total};
use piola_runtime::solve::linear::{LinearMethod, LinearOptions, PreconditionerChoice};
use piola_runtime::solve::newton::{NewtonError, NewtonSettings};

use crate::ours::with_threads;
use crate::record::{Cell, Table};
use counted::Counted;
use traction_bar::{Bar, Solved};

const AT_BONDS: Discretisation = Discretisation::BondQuadrature;
const WAN: Discretisation = Discretisation::Stabilised(Stabilisation::Wan);

/// Products and who asks for them.
const WAYS: [(&str, Products, LinearMethod); 6] = [
    ("exact, conjugate gradients", Products::Exact, LinearMethod::MatrixFree),
    ("exact, GMRES", Products::Exact, LinearMethod::Gmres),
    ("`finite-difference`, GMRES", Products::OneSided, LinearMethod::Gmres),
    ("`finite-difference`, conjugate gradients", Products::OneSided, LinearMethod::MatrixFree),
    ("`central-difference`, GMRES", Products::Central, LinearMethod::Gmres),
    ("`central-difference`, conjugate gradients", Products::Central, LinearMethod::MatrixFree),
];

pub(crate) fn run() -> Vec<Table> {
    with_threads(2, || vec![traction(), products(), differences()])
}

/// Elongations and costs by discretisation, horizon and preconditioner.
fn traction() -> Table {
    let mut table = Table::plain(
        "traction",
        "N points over the width, a horizon of m spacings, cubic spline, first order; from rest in one step to a \
         residual of 1e-10, without a stored tangent, on two threads, each once. The elongation stands against the \
         local theory (5.4).",
        &[
            "",
            "N",
            "m",
            "points",
            "elongation",
            "preconditioner",
            "conjugate gradients per Newton step",
            "s",
        ],
    );
    let mut row = |name: &str, across: usize, horizon: usize, way, preconditioner| {
        let bar = Bar::new(across, horizon, way);
        let solved = bar.solve(LinearOptions { preconditioner, ..LinearOptions::default() });
        table.row([
            name.into(),
            across.to_string().into(),
            horizon.to_string().into(),
            (solved.u.len() / 3).to_string().into(),
            format!("{:+.4} %", 100.0 * solved.error).into(),
            solved.preconditioner.clone().into(),
            iterations(&solved).into(),
            solved.seconds.into(),
        ]);
    };
    for (across, horizon) in [(5, 2), (5, 3), (5, 4), (5, 7), (10, 3)] {
        row("`bond-quadrature`", across, horizon, AT_BONDS, PreconditionerChoice::Auto);
    }
    for (across, preconditioner) in [
        (5, PreconditionerChoice::TwoLevel),
        (5, PreconditionerChoice::BlockJacobi),
        (10, PreconditionerChoice::BlockJacobi),
    ] {
        row("`bond-quadrature`", across, 3, AT_BONDS, preconditioner);
    }
    for horizon in [2, 3, 4] {
        row("`stabilised`, `wan`", 5, horizon, WAN, PreconditionerChoice::Auto);
    }
    table
}

fn iterations(solved: &Solved) -> String {
    let counts: Vec<String> = solved.linear_iterations.iter().map(usize::to_string).collect();
    counts.join(", ")
}

/// Exact products and differences.
fn products() -> Table {
    let mut table = Table::plain(
        "products",
        "The same bar at bonds, to a residual of 1e-10 from rest in one step, on two threads. Evaluations are products \
         and forces, those that Newton's method takes included; the floor is the residual at rest when 1e-17 is asked \
         for. Times are the least of three runs in turn for N = 5 and of one for N = 10.",
        &[
            "products",
            "N, m",
            "Newton",
            "Krylov iterations",
            "products",
            "forces",
            "s",
            "residual",
            "floor",
            "elongation",
        ],
    );
    for (across, rounds) in [(5, 3), (10, 1)] {
        ways(&mut table, across, rounds);
    }
    table
}

fn ways(table: &mut Table, across: usize, rounds: usize) {
    let bar = Bar::new(across, 3, AT_BONDS);
    let mut least = [f64::INFINITY; WAYS.len()];
    let mut rows: Vec<Option<(Solved, Counted<'_>)>> = WAYS.map(|_| None).into();
    for _ in 0..rounds {
        for (k, (_, products, method)) in WAYS.into_iter().enumerate() {
            let counted = Counted::new(&bar.energy);
            let solved = solve(&bar, &counted, products, method, 1e-10).expect("it converges");
            least[k] = least[k].min(solved.seconds);
            rows[k] = Some((solved, counted));
        }
    }
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
        table.row([
            name.into(),
            format!("{across}, 3").into(),
            solved.newton_iterations.to_string().into(),
            iterations(solved).into(),
            counted.products().to_string().into(),
            counted.gradients().to_string().into(),
            seconds.into(),
            format!("{:.1e}", solved.residual).into(),
            format!("{floor:.1e}").into(),
            format!("{:+.6} %", 100.0 * solved.error).into(),
        ]);
    }
}

/// A product with the Hessian of an energy at `u` along `p`.
type Product<'a> = dyn Fn(&dyn Energy, &[f64], &[f64]) -> Vec<f64> + 'a;

/// Errors of differences of forces.
fn differences() -> Table {
    let mut table = Table::plain(
        "differences",
        "Errors of products at random displacements and directions in a cube of 12^3 points, relative to the exact \
         product, by spacing.",
        &["", "2 mm", "2 nm"],
    );
    let mut row = |name: &str, way: &Product<'_>| {
        let cell = |spacing| Cell::Text(format!("{:.1e}", error(spacing, way)));
        table.row([name.into(), cell(2e-3), cell(2e-9)]);
    };
    row("central, step of partmann2026 (3.74)", &papers);
    row("`finite-difference`", &|energy, u, p| own(energy, Products::OneSided, u, p));
    row("`central-difference`", &|energy, u, p| own(energy, Products::Central, u, p));
    table
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
    let differences = Total::of(counted as &dyn Energy).with_products(products);
    bar.solve_by(&differences, settings, options)
}

/// The relative error of a product in a cube of 12^3 points with this spacing in m.
fn error(spacing: f64, product: &Product<'_>) -> f64 {
    let positions: Vec<f64> = (0..1728)
        .flat_map(|k| [k / 144, k / 12 % 12, k % 12])
        .map(|k| spacing * f64::from(k))
        .collect();
    let volumes = vec![spacing * spacing * spacing; 1728];
    let body = Arc::new(Body::new(3, &positions, &volumes, Some(spacing)));
    let energy = common::energy(&body, 3.015 * spacing, OperatorOrder::First, AT_BONDS, "cubic");
    let u = common::displacements(&body, &common::H, 0.01 * spacing, 3);
    let p = common::Random(7).vector(u.len());
    let mut exact = vec![0.0; u.len()];
    energy.hessian(&u).expect("the state is finite").multiply(&p, &mut exact);
    let found = product(&energy, &u, &p);
    let error: Vec<f64> = found.iter().zip(&exact).map(|(f, e)| f - e).collect();
    common::norm(&error) / common::norm(&exact)
}

fn own(energy: &dyn Energy, products: Products, u: &[f64], p: &[f64]) -> Vec<f64> {
    let mut found = vec![0.0; u.len()];
    let differences = Total::of(energy).with_products(products);
    differences.hessian(u).expect("the state is finite").multiply(p, &mut found);
    found
}

/// Central differences with the step (3.74) of partmann2026, the machine precision being 2^-52.
fn papers(energy: &dyn Energy, u: &[f64], p: &[f64]) -> Vec<f64> {
    let step = libm::cbrt(f64::EPSILON) * (common::norm(u) + 1.0) / common::norm(p);
    let forces = |way: f64| {
        let at: Vec<f64> = u.iter().zip(p).map(|(u, p)| u + way * step * p).collect();
        let mut forces = vec![0.0; u.len()];
        energy.forces(&at, &mut forces).expect("the state is finite");
        forces
    };
    let (ahead, behind) = (forces(1.0), forces(-1.0));
    ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * step)).collect()
}
