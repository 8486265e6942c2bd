//! Bodies that have lost bonds: every way through what is left against a sum over its bonds one by one.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::Release;
use piola_runtime::kernel::Law;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::surface::{Surface, Volumes, Weighting};
use piola_runtime::weights::Weights;

use crate::common::{Random, cloud, dense, displacements, distance, lattice, norm};

/// Affine in the length, in its square, and not; with psi and psi' over C by hand.
type Psi = fn(f64, f64) -> [f64; 2];
const LAWS: [(&str, Psi); 3] = [
    ("1/2*L*(l/L - 1)^2", |l, rest| {
        let s = l / rest - 1.0;
        [0.5 * rest * s * s, s]
    }),
    ("1/8*L*((l/L)^2 - 1)^2", |l, rest| {
        let x = l / rest;
        let s = x * x - 1.0;
        [0.125 * rest * s * s, 0.5 * s * x]
    }),
    ("1/2*L*ln(l/L)^2", |l, rest| {
        let s = libm::log(l / rest);
        [0.5 * rest * s * s, s * rest / l]
    }),
];

fn energy(body: &Arc<Body>, horizon: f64, psi: &str, level: Level) -> DiscreteEnergy {
    let d = body.dimension();
    let (_, model) = check_text(&format!("potential p\npsi(l) = {psi}")).unwrap();
    let values = model.values(d, &[], None).unwrap();
    let mut kernels = model.compile(&values, Mode::Jit(level), Form::Accurate).unwrap().kernels;
    let bond = Some(Box::new(kernels.remove(0)) as Box<dyn Law>);
    let laws = Laws { bond, ..Laws::default() };
    DiscreteEnergy::new(Arc::clone(body), horizon, Weights::Volumes, laws).unwrap()
}

/// Energy and forces of the bonds that are not broken, one by one.
fn by_hand(body: &Body, horizon: f64, psi: Psi, is_broken: &[bool], u: &[f64]) -> (f64, Vec<f64>) {
    let (d, volumes) = (body.dimension(), body.volumes());
    let neighborhood = Neighborhood::new(body, horizon).unwrap();
    let (mut energy, mut forces) = (0.0, vec![0.0; u.len()]);
    for bond in (0..neighborhood.n_bonds()).filter(|bond| !is_broken[*bond]) {
        let [i, j] = neighborhood.ends(bond);
        let xi = |axis: usize| body.position(j)[axis] - body.position(i)[axis];
        let x: Vec<f64> = (0..d).map(|axis| xi(axis) + u[j * d + axis] - u[i * d + axis]).collect();
        let rest = norm(&(0..d).map(xi).collect::<Vec<f64>>());
        let length = norm(&x);
        let [value, slope] = psi(length, rest);
        let weight = volumes[i] * volumes[j];
        energy += weight * value;
        for axis in 0..d {
            let part = weight * slope * x[axis] / length;
            forces[j * d + axis] += part;
            forces[i * d + axis] -= part;
        }
    }
    (energy, forces)
}

fn bodies() -> [(Arc<Body>, f64); 4] {
    [
        (lattice(&[0.0, 0.0], &[24, 11], 0.1), 0.31),
        (lattice(&[0.0, 0.0, 0.0], &[14, 5, 6], 0.1), 0.21),
        (cloud(&[18, 9], 0.1, 5), 0.29),
        (cloud(&[9, 6, 5], 0.1, 6), 0.21),
    ]
}

#[test]
fn what_is_left_is_the_sum_over_bonds_that_are_left() {
    let mut ways = Vec::new();
    for (body, horizon) in bodies() {
        let n = Neighborhood::new(&body, horizon).unwrap().n_bonds();
        for ((text, psi), level) in
            LAWS.iter().flat_map(|law| [(law, Level::Fast), (law, Level::Strict)])
        {
            let mut energy = energy(&body, horizon, text, level);
            ways.extend(energy.report().ways);
            assert!(energy.can_lose_bonds());
            let u = displacements(&body, 0.08, 3);
            let mut random = Random(7);
            let mut is_broken = vec![false; n];
            // Nothing, some, more, all.
            for share in [-1.0, -0.6, 0.0, 1.0] {
                let new: Vec<usize> =
                    (0..n).filter(|k| random.next() < share && !is_broken[*k]).collect();
                let way = Random(11).vector(u.len());
                let before = energy.energy(&u).unwrap().total();
                let mut old = vec![0.0; u.len()];
                energy.forces(&u, &mut old).unwrap();
                let release = energy.break_bonds(&u, (0.5, &way), &new).unwrap();
                // What was taken out in an attempt that failed comes back to the bit.
                energy.regain(&new);
                let mut again = vec![0.0; u.len()];
                assert_eq!(energy.forces(&u, &mut again).unwrap().total(), before);
                assert_eq!(again, old, "{text} {share}");
                energy.lose(&new);
                new.iter().for_each(|bond| is_broken[*bond] = true);
                let (expected, expected_forces) = by_hand(&body, horizon, *psi, &is_broken, &u);
                let mut forces = vec![0.0; u.len()];
                let found = energy.forces(&u, &mut forces).unwrap().total();
                let scale = norm(&old).max(norm(&expected_forces)).max(1e-6);
                let error = |one: &[f64], other: &[f64]| {
                    let difference: Vec<f64> = one.iter().zip(other).map(|(x, y)| x - y).collect();
                    norm(&difference) / scale
                };
                assert!(error(&forces, &expected_forces) < 1e-13, "{text} {share}");
                assert!((found - expected).abs() <= 1e-13 * before.max(1e-9), "{text} {share}");
                // What is released is what is missing, and so is the power of its forces.
                let missing = before - found;
                assert!((release.energy - missing).abs() <= 1e-13 * before.max(1e-9));
                let power: f64 = (0..u.len()).map(|k| (old[k] - forces[k]) * way[k]).sum();
                let size: f64 = (0..u.len()).map(|k| (old[k] * way[k]).abs()).sum();
                assert!((release.timing - 0.25 * power).abs() <= 1e-13 * size.max(1e-9));
                // Tangent and products know of it, too.
                let mut tangent = BlockMatrix::zeros(energy.pattern());
                energy.tangent(&u, &mut vec![0.0; u.len()], &mut tangent).unwrap();
                let matrix = dense(&tangent);
                let p = Random(13).vector(u.len());
                let mut product = vec![0.0; u.len()];
                energy.hessian(&u).unwrap().multiply(&p, &mut product);
                let row = |r: usize| -> f64 {
                    (0..p.len()).map(|c| matrix[r * p.len() + c] * p[c]).sum()
                };
                let stored: Vec<f64> = (0..p.len()).map(row).collect();
                if share < 1.0 {
                    assert!(distance(&product, &stored) < 1e-12, "{text} {share}");
                } else {
                    assert!(norm(&product) == 0.0 && norm(&stored) == 0.0 && found == 0.0);
                }
            }
        }
    }
    ways.sort_unstable();
    ways.dedup();
    assert_eq!(ways, ["batches", "fours", "rows"]);
}

/// A broken bond may be as long as it likes, or as short.
#[test]
fn broken_bonds_may_be_anywhere() {
    for (body, horizon) in bodies() {
        let neighborhood = Neighborhood::new(&body, horizon).unwrap();
        let d = body.dimension();
        for ((text, _), level) in
            LAWS.iter().flat_map(|law| [(law, Level::Fast), (law, Level::Strict)])
        {
            let mut energy = energy(&body, horizon, text, level);
            // A point without bonds flies off, or ends on top of a neighbour.
            let point = body.n_points() / 2;
            let own = |bond: &usize| neighborhood.ends(*bond).contains(&point);
            let lost: Vec<usize> = (0..neighborhood.n_bonds()).filter(own).collect();
            energy.lose(&lost);
            let other = neighborhood.row(point).at(0) as usize;
            for onto in [true, false] {
                let mut u = displacements(&body, 0.01, 4);
                for axis in 0..d {
                    u[point * d + axis] = match onto {
                        true => {
                            body.position(other)[axis] - body.position(point)[axis]
                                + u[other * d + axis]
                        }
                        false => 1e12,
                    };
                }
                let mut forces = vec![0.0; u.len()];
                let energy = energy.forces(&u, &mut forces).unwrap().total();
                assert!(energy.is_finite() && forces.iter().all(|x| x.is_finite()), "{text}");
                assert!(forces[point * d..(point + 1) * d].iter().all(|x| *x == 0.0), "{text}");
            }
        }
    }
}

/// Corrected bonds keep their factors.
#[test]
fn corrections_stay() {
    let (body, horizon) = (lattice(&[0.0, 0.0], &[14, 9], 0.1), 0.31);
    let with = |surface: Surface| {
        let (_, model) = check_text("potential p\npsi(l) = 1/2*L*(l/L - 1)^2").unwrap();
        let values = model.values(2, &[], None).unwrap();
        let mode = Mode::Jit(Level::Fast);
        let mut kernels = model.compile(&values, mode, Form::Accurate).unwrap().kernels;
        let bond = Some(Box::new(kernels.remove(0)) as Box<dyn Law>);
        let laws = Laws { bond, ..Laws::default() };
        let weighting = Weighting { weights: Weights::Volumes, surface, volumes: Volumes::Whole };
        DiscreteEnergy::new(Arc::clone(&body), horizon, weighting, laws).unwrap()
    };
    let u = displacements(&body, 0.02, 8);
    let mut corrected = with(Surface::Directional);
    let all = corrected.energy(&u).unwrap().total();
    let lost = [5, 40, 41, 200];
    let Release { energy, .. } = corrected.break_bonds(&u, (0.0, &u), &lost).unwrap();
    let mut whole = with(Surface::None);
    let Release { energy: plain, .. } = whole.break_bonds(&u, (0.0, &u), &lost).unwrap();
    assert!((energy / plain - 1.0).abs() > 1e-3, "corrections count");
    let left = corrected.energy(&u).unwrap().total();
    assert!((all - left - energy).abs() < 1e-13 * all);
    corrected.regain(&lost);
    assert_eq!(corrected.energy(&u).unwrap().total(), all);
}
