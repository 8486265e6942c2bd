//! Deformation gradients along the rows of a lattice: those of the same points as a cloud.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, OperatorOrder};
use piola_runtime::energy::Energy;
use piola_runtime::lattice::{Lattice, Nodes};
use rayon::ThreadPoolBuilder;

use crate::common::{Random, energy};

const SPACING: f64 = 0.1;

/// A box with a hole, as a lattice and as a cloud.
fn bodies(counts: &[usize], nodes: Nodes) -> [Arc<Body>; 2] {
    let lower = vec![3.7; counts.len()];
    let upper = counts.iter().map(|n| 3.7 + SPACING * *n as f64).collect();
    let points = Lattice { lower, upper, spacing: SPACING, nodes }.points().unwrap();
    let d = counts.len();
    let away = |x: &[f64]| libm::hypot(x[0] - 4.5, x[1] - 4.4) > 0.31;
    let kept = points.positions.chunks(d).zip(&points.volumes).filter(|(x, _)| away(x));
    let (positions, volumes): (Vec<&[f64]>, Vec<f64>) = kept.unzip();
    let positions = positions.concat();
    [Some(SPACING), None].map(|spacing| Arc::new(Body::new(d, &positions, &volumes, spacing)))
}

fn displacements(body: &Body, seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    let x = body.positions();
    x.iter().rev().map(|x| 0.05 * libm::sin(2.0 * x) + 0.1 * SPACING * random.next()).collect()
}

/// The gradients, the energy, forces and a product.
fn state(energy: &dyn Energy, u: &[f64]) -> [Vec<f64>; 3] {
    let (mut forces, mut product) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    let parts = energy.forces(u, &mut forces).unwrap();
    let p: Vec<f64> = u.iter().rev().copied().collect();
    energy.hessian(u).unwrap().multiply(&p, &mut product);
    [vec![parts.total()], forces, product]
}

fn distance(found: &[f64], expected: &[f64]) -> f64 {
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let apart = norm(&mut found.iter().zip(expected).map(|(f, e)| f - e));
    apart / norm(&mut expected.iter().copied())
}

#[test]
fn lattices_give_what_clouds_of_the_same_points_give() {
    let shapes: [(&[usize], Nodes); 3] =
        [(&[31, 23], Nodes::Cells), (&[26, 21], Nodes::Corners), (&[14, 9, 13], Nodes::Corners)];
    for (counts, nodes) in shapes {
        let [lattice, cloud] = bodies(counts, nodes);
        for kernel in ["one", "cubic"] {
            for discretisation in [Discretisation::Nodal, Discretisation::BondQuadrature] {
                let energies = [&lattice, &cloud].map(|body| {
                    energy(body, 2.2 * SPACING, OperatorOrder::First, discretisation, kernel)
                });
                let ways = [0, 1].map(|k| energies[k].report().ways);
                assert_eq!(ways, [vec!["families", "rows"], vec!["families"]]);
                let u = displacements(&lattice, 3);
                let gradients = [0, 1].map(|k| energies[k].displacement_gradients(&u));
                let error = distance(&gradients[0], &gradients[1]);
                assert!(error < 1e-13, "{counts:?}, {kernel}: gradients {error:e}");
                let [found, expected] = [0, 1].map(|k| state(&energies[k], &u));
                for (found, expected) in found.iter().zip(&expected) {
                    let error = distance(found, expected);
                    assert!(error < 1e-12, "{counts:?}, {kernel}, {discretisation:?}: {error:e}");
                }
            }
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let [lattice, _] = bodies(&[14, 9, 13], Nodes::Corners);
    let horizon = 2.2 * SPACING;
    let energy = energy(&lattice, horizon, OperatorOrder::First, Discretisation::Nodal, "cubic");
    let u = displacements(&lattice, 4);
    let [one, three] = [1, 3].map(|threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| state(&energy, &u))
    });
    assert!(one == three);
}

/// Operators beyond first order weight every neighbour for itself, as on clouds.
#[test]
fn operators_beyond_first_order_have_no_rows() {
    let [lattice, _] = bodies(&[20, 20], Nodes::Cells);
    for order in [OperatorOrder::FirstWithConstant, OperatorOrder::Second] {
        let energy = energy(&lattice, 3.2 * SPACING, order, Discretisation::Nodal, "one");
        assert_eq!(energy.report().ways, ["families"]);
    }
}
