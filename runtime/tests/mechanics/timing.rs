//! How long the assembly takes; run with `--ignored --nocapture`.

use std::sync::Arc;
use std::time::Instant;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::energy::TotalEnergy;
use piola_runtime::kernel::{Batch, Law, Order, Outputs};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{displacements, lattice};

/// Seth-Hill with n = 1, as plain as a compiled kernel.
fn linear(c: f64) -> Option<Box<dyn Law>> {
    Some(Box::new(move |batch: Batch<'_>, order: Order, out: Outputs<'_>| {
        let n = batch.change.len();
        for p in 0..n {
            out.psi[p] = 0.5 * c * batch.reference[p] * batch.change[p] * batch.change[p];
        }
        if order >= Order::Gradient {
            for p in 0..n {
                out.dpsi[p] = c * batch.change[p];
            }
        }
        if order == Order::Tangent {
            for p in 0..n {
                out.d2psi[p] = c / batch.reference[p];
            }
        }
    }))
}

fn measure(name: &str, points: usize, laws: fn() -> Laws) {
    let body = lattice(&[0.0; 3], &[points - 1; 3], 1.0);
    let u = displacements(&body, 0.001, 1);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let start = Instant::now();
            let energy =
                DiscreteEnergy::new(Arc::clone(&body), 3.0, Weights::Uniform, laws()).unwrap();
            let built = start.elapsed().as_secs_f64();
            let mut gradient = vec![0.0; u.len()];
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            let mut best = [f64::INFINITY; 3];
            for _ in 0..7 {
                let start = Instant::now();
                energy.energy(&u).unwrap();
                best[0] = best[0].min(start.elapsed().as_secs_f64());
                let start = Instant::now();
                energy.gradient(&u, &mut gradient).unwrap();
                best[1] = best[1].min(start.elapsed().as_secs_f64());
                let start = Instant::now();
                energy.tangent(&u, &mut gradient, &mut tangent).unwrap();
                best[2] = best[2].min(start.elapsed().as_secs_f64());
            }
            println!("{name} {threads} threads: build {built:.3} s, best of 7 {best:.3?} s");
            println!("  (energy, gradient, tangent) {:?}", energy.report());
        });
    }
}

#[test]
#[ignore = "a measurement"]
fn bonds() {
    measure("bonds 20^3", 20, || Laws { bond: linear(1.0), ..Laws::default() });
}

#[test]
#[ignore = "a measurement"]
fn triangles() {
    measure("triangles 20^3", 20, || Laws { triangle: linear(1.0), ..Laws::default() });
}

#[test]
#[ignore = "a measurement"]
fn tetrahedra() {
    measure("tetrahedra 12^3", 12, || Laws { tetrahedron: linear(1.0), ..Laws::default() });
}
