//! Gathered states along the rows of a lattice: those of the same points as a cloud.

use std::sync::Arc;

use piola_compiler::Level;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::states::StateEnergy;
use rayon::ThreadPoolBuilder;

use crate::common::Random;
use crate::{laws_at, solid};

const SPACING: f64 = 0.1;

/// Two integrals that change, one of them bent, and bonds that pull at rest.
const STRESSED: &str = "potential stressed
w(L) = exp(-L/delta)
m = integral(w*L^2)
s = integral(w*(l - L)*L)/m
q = integral(w*(l - L)^2 + L*l)/m
psi(s, q) = s^2 + exp(s)*q^2/(1 + q)
psi(l, m) = (l - L)^2/m + 0.3*l*L/m + 0.2*L
";

/// A name, a text, and parameters.
type Material = (&'static str, String, Vec<(&'static str, f64)>);

fn materials() -> Vec<Material> {
    let moduli = vec![("K", 2.0), ("G", 0.7)];
    vec![
        ("constant influence", solid("1"), moduli.clone()),
        ("another influence", solid("1/L"), moduli),
        // Nothing of the dilatation is left, in space at least.
        ("bonds alone", solid("1"), vec![("K", 5.0), ("G", 3.0)]),
        ("stressed", STRESSED.into(), Vec::new()),
    ]
}

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

fn energy(text: &str, parameters: &[(&str, f64)], body: &Arc<Body>) -> StateEnergy {
    let horizon = 2.2 * SPACING;
    let laws = laws_at(Level::Fast, text, parameters, (body.dimension(), horizon));
    StateEnergy::new(Arc::clone(body), horizon, laws).unwrap()
}

/// The parts of the energy, alone and with forces; the forces; a product.
fn state(energy: &dyn Energy, u: &[f64]) -> [Vec<f64>; 4] {
    let (mut forces, mut product) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    let with_forces = energy.forces(u, &mut forces).unwrap();
    let p: Vec<f64> = u.iter().rev().copied().collect();
    energy.hessian(u).unwrap().multiply(&p, &mut product);
    let alone = energy.energy(u).unwrap();
    let values = [alone, with_forces].map(|parts| parts.iter().map(|part| part.1).collect());
    let [alone, with_forces] = values;
    [alone, with_forces, forces, product]
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
        for (name, text, parameters) in materials() {
            let energies = [&lattice, &cloud].map(|body| energy(&text, &parameters, body));
            let ways = [0, 1].map(|k| energies[k].report().ways);
            assert_eq!(ways, [vec!["families", "rows"], vec!["families"]], "{name}");
            let u = displacements(&lattice, 3);
            let [found, expected] = [0, 1].map(|k| state(&energies[k], &u));
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!(found.len(), expected.len());
                let error = distance(found, expected);
                assert!(error < 1e-13, "{counts:?}, {name}: {error:e}");
            }
            let names = [0, 1].map(|k| energies[k].parts().to_vec());
            assert_eq!(names[0], names[1]);
        }
    }
}

/// Bonds that are lost leave gaps in rows: what is left is what clouds have left, and what comes back never went.
#[test]
fn rows_with_gaps_give_what_clouds_give() {
    let shapes: [(&[usize], Nodes); 2] =
        [(&[31, 23], Nodes::Cells), (&[14, 9, 13], Nodes::Corners)];
    for (counts, nodes) in shapes {
        let [lattice, cloud] = bodies(counts, nodes);
        let u = displacements(&lattice, 3);
        for (name, text, parameters) in materials() {
            let new = |body: &Arc<Body>| energy(&text, &parameters, body);
            let [mut gaps, mut other] = [&lattice, &cloud].map(new);
            let whole = Neighborhood::new(&lattice, 2.2 * SPACING).unwrap();
            // Those across a plane, some anywhere, and all of a point.
            let beyond = |point: usize| lattice.position(point)[0] > 4.3;
            let crosses = |ends: [usize; 2]| beyond(ends[0]) != beyond(ends[1]);
            let (n, alone) = (whole.n_bonds(), lattice.n_points() / 3);
            let sets = [
                (0..n).filter(|bond| crosses(whole.ends(*bond))).collect::<Vec<usize>>(),
                (0..n).filter(|bond| bond % 37 == 5).collect(),
                (0..n).filter(|bond| whole.ends(*bond).contains(&alone)).collect(),
            ];
            let before = state(&gaps, &u);
            for bonds in &sets {
                gaps.lose(bonds);
                other.lose(bonds);
                let has_rows = gaps.report().ways == ["families", "rows"];
                assert_eq!(has_rows, name != "stressed", "{name}");
                let [found, expected] = [&gaps, &other].map(|energy| state(energy, &u));
                for (found, expected) in found.iter().zip(&expected) {
                    let error = distance(found, expected);
                    assert!(error < 1e-13, "{counts:?}, {name}: {error:e}");
                }
            }
            if name == "stressed" {
                continue;
            }
            gaps.regain(&sets[1]);
            let mut fresh = new(&lattice);
            fresh.lose(&sets[2]);
            fresh.lose(&sets[0]);
            // Bonds that are in two sets came back with the second.
            let both = |bond: &&usize| sets[1].contains(bond);
            let again: Vec<usize> = sets[0].iter().chain(&sets[2]).filter(both).copied().collect();
            fresh.regain(&again);
            assert!(state(&gaps, &u) == state(&fresh, &u), "{name}");
            gaps.regain(&sets.concat());
            assert!(state(&gaps, &u) == before, "{name}");
        }
    }
}

/// Near rest forces are as exact as displacements.
#[test]
fn tiny_strains_keep_their_digits() {
    let [lattice, cloud] = bodies(&[31, 23], Nodes::Cells);
    let (_, text, parameters) = &materials()[1];
    let u: Vec<f64> = displacements(&lattice, 5).iter().map(|u| 1e-12 * u).collect();
    let [found, expected] =
        [&lattice, &cloud].map(|body| state(&energy(text, parameters, body), &u));
    for (found, expected) in found.iter().zip(&expected) {
        let error = distance(found, expected);
        assert!(error < 1e-13, "{error:e}");
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let [lattice, _] = bodies(&[14, 9, 13], Nodes::Corners);
    for (name, text, parameters) in materials() {
        let u = displacements(&lattice, 4);
        let [one, three] = [1, 3].map(|threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| state(&energy(&text, &parameters, &lattice), &u))
        });
        assert!(one == three, "{name}");
    }
}

/// Where two points meet there is an energy and no force: both ways say the same.
#[test]
fn points_that_meet_are_named_as_on_clouds() {
    // Distances are exact here, so that points do meet.
    let (lower, upper) = (vec![0.0; 2], vec![2.5; 2]);
    let points = Lattice { lower, upper, spacing: 0.125, nodes: Nodes::Corners }.points().unwrap();
    let bodies = [Some(0.125), None]
        .map(|spacing| Arc::new(Body::new(2, &points.positions, &points.volumes, spacing)));
    let (_, text, parameters) = &materials()[0];
    let mut u = vec![0.0; 2 * bodies[0].n_points()];
    let [from, to] = [0, 1].map(|k| bodies[0].position(150 + k).to_vec());
    (0..2).for_each(|axis| u[300 + axis] = to[axis] - from[axis]);
    let found = bodies.map(|body| {
        let energy = energy(text, parameters, &body);
        let mut forces = vec![0.0; u.len()];
        let refused = energy.forces(&u, &mut forces).unwrap_err();
        assert!(energy.hessian(&u).is_err());
        (energy.energy(&u).unwrap().total(), refused.points)
    });
    assert!((found[0].0 / found[1].0 - 1.0).abs() < 1e-13);
    assert_eq!(found[0].1, found[1].1);
}

/// Bonds of other laws have kernels, and the strict level follows them to the bit.
#[test]
fn only_affine_laws_of_the_fast_level_have_rows() {
    let [lattice, _] = bodies(&[20, 20], Nodes::Cells);
    let strict = crate::energy(&solid("1"), &[("K", 2.0), ("G", 0.7)], &lattice, 2.2 * SPACING);
    assert_eq!(strict.report().ways, ["families"]);
    let changes = [
        ("0.3*l*L/m", "0.3*l*L*s/m"),
        ("0.3*l*L/m", "0.3*l^3/m"),
        ("w*(l - L)*L", "w*ln(l/L)*L^2"),
    ];
    for (from, to) in changes {
        assert!(STRESSED.contains(from));
        let text = STRESSED.replace(from, to).replace("psi(l, m)", "psi(l, s, m)");
        assert_eq!(energy(&text, &[], &lattice).report().ways, ["families"], "{to}");
    }
}
