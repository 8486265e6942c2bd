//! Tiny strains, far offsets, vanishing measures, uneven volumes.

use std::sync::Arc;

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::interaction::Inverted;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{U, displacements, distance, lattice, laws, norm};

fn gradient(energy: &DiscreteEnergy, u: &[f64]) -> Vec<f64> {
    let mut gradient = vec![0.0; u.len()];
    energy.forces(u, &mut gradient).unwrap();
    gradient
}

/// The forces at 2^20 m from the origin have the bits of those at the origin.
#[test]
fn e18_an_offset_changes_no_bit_when_differences_are_exact() {
    // Spacing 2^-6: coordinates near 2^20 are exact.
    for (dimension, cells) in [(2, vec![8, 6]), (3, vec![5, 4, 4])] {
        let at = |offset: f64| {
            let body = lattice(&vec![offset; dimension], &cells, 1.0 / 64.0);
            let home = lattice(&vec![0.0; dimension], &cells, 1.0 / 64.0);
            let u = displacements(&home, 1e-9, 2);
            let laws = laws([1.0, 10.0, if dimension == 3 { 1e3 } else { 0.0 }], 1);
            let energy = DiscreteEnergy::new(body, 2.0 / 64.0, Weights::Uniform, laws).unwrap();
            gradient(&energy, &u)
        };
        assert_eq!(at(0.0), at(1048576.0));
    }
}

#[test]
fn e05_forces_are_linear_down_to_the_smallest_strains() {
    for (dimension, cells) in [(2, vec![8, 6]), (3, vec![5, 4, 4])] {
        let body = lattice(&vec![0.0; dimension], &cells, 0.1);
        let laws = laws([1.0, 100.0, if dimension == 3 { 1e6 } else { 0.0 }], 0);
        let energy = DiscreteEnergy::new(Arc::clone(&body), 0.2, Weights::Truncated, laws).unwrap();
        let unit = displacements(&body, 1.0, 9);
        let at = |strain: f64| -> Vec<f64> {
            let u: Vec<f64> = unit.iter().map(|x| x * strain).collect();
            gradient(&energy, &u).iter().map(|g| g / strain).collect()
        };
        let expected = at(1e-14);
        for strain in [1e-10, 1e-13, 1e-20, 1e-100] {
            let error = distance(&at(strain), &expected);
            // Measured are 1.9 strain + 1.8e-14.
            assert!(error <= 8.0 * strain + 8e-14, "strain {strain:e}: {error:e}");
        }
    }
}

#[test]
fn e07_e08_smooth_energies_survive_vanishing_measures() {
    // Two points meet and a triangle collapses: n = 2 is a function of l^2 and a^2.
    let body = Arc::new(Body::new(3, &[0., 0., 0., 1., 0., 0., 0., 1., 0.], &[1.0; 3], None));
    let energy = DiscreteEnergy::new(body, 2.0, Weights::Unit, laws([1.0, 1.0, 0.0], 2)).unwrap();
    let mut gradient = vec![0.0; 9];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    // Sorted along x, the user's point 1 comes last; it meets point 0 at the origin.
    let u = [0., 0., 0., 0., 0., 0., -1., 0., 0.];
    let parts = energy.tangent(&u, &mut gradient, &mut tangent).unwrap();
    assert!(parts.of("psi(l)") > 0.0 && parts.of("psi(a)") > 0.0);
    assert!(gradient.iter().chain(&tangent.values).all(|x| x.is_finite()));
    // The limit from nearby states.
    let mut near = BlockMatrix::zeros(energy.pattern());
    let u = [0., 0., 0., 0., 0., 0., -1.0 + 1e-9, 2e-9, 1e-9];
    energy.tangent(&u, &mut gradient, &mut near).unwrap();
    assert!(distance(&tangent.values, &near.values) < 1e-8);
}

#[test]
fn e07_a_kink_is_refused_with_its_points() {
    let body = Arc::new(Body::new(2, &[0., 0., 1., 0., 0., 1.], &[1.0; 3], None));
    let energy = DiscreteEnergy::new(body, 2.0, Weights::Unit, laws([1.0, 0.0, 0.0], 1)).unwrap();
    // Sorted along x: user points 0 and 2 at x = 0 come first, user point 1 is last.
    let u = [0., 0., 0., 0., -1., 0.];
    assert!(energy.energy(&u).is_ok(), "the energy itself is finite");
    let error = energy.forces(&u, &mut [0.0; 6]).unwrap_err();
    assert_eq!((error.points, error.value, error.reference), (vec![0, 2], 0.0, 1.0));
}

#[test]
fn the_lowest_refused_interaction_is_named_for_any_number_of_threads() {
    let body = lattice(&[0.0, 0.0, 0.0], &[12, 3, 3], 1.0);
    let energy =
        DiscreteEnergy::new(Arc::clone(&body), 1.8, Weights::Uniform, laws([1.0, 1.0, 1.0], 0))
            .unwrap();
    // Mirroring the far half inverts tetrahedra there; a NaN spoils bonds at the end.
    let mut u = vec![0.0; body.positions().len()];
    for point in 0..body.n_points() {
        if body.position(point)[0] > 6.0 {
            u[3 * point + 1] = -2.0 * body.position(point)[1];
        }
    }
    let name = |u: &[f64], threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| energy.energy(u)).unwrap_err()
    };
    let inverted = name(&u, 1);
    assert!(inverted.value < 0.0 && inverted.points.len() == 4, "{inverted}");
    assert_eq!(inverted, name(&u, 2));
    let last = body.n_points() - 1;
    u[3 * last] = f64::NAN;
    let bond = name(&u, 1);
    assert_eq!((bond.points.len(), bond.points[1]), (2, last), "bonds come first: {bond}");
    assert_eq!(bond.points, name(&u, 4).points);
}

#[test]
fn e10_inverted_cliques_are_counted() {
    let plane = lattice(&[0.0, 0.0], &[4, 4], 1.0);
    let laws_2d = laws([0.0, 1.0, 0.0], 1);
    let energy = DiscreteEnergy::new(Arc::clone(&plane), 1.5, Weights::Uniform, laws_2d).unwrap();
    let mut u = vec![0.0; 50];
    assert_eq!(energy.inverted(&u), Inverted::default());
    let mirror = |body: &Body, u: &mut [f64]| {
        for point in 0..body.n_points() {
            u[point * body.dimension()] = -2.0 * body.position(point)[0];
        }
    };
    mirror(&plane, &mut u);
    let triangles = energy.report().triangles;
    assert_eq!(energy.inverted(&u), Inverted { triangles, tetrahedra: 0 });
    let solid = lattice(&[0.0, 0.0, 0.0], &[3, 3, 3], 1.0);
    let laws_3d = laws([0.0, 1.0, 1.0], 1);
    let energy = DiscreteEnergy::new(Arc::clone(&solid), 1.5, Weights::Uniform, laws_3d).unwrap();
    let mut u = vec![0.0; 192];
    assert_eq!(energy.inverted(&u), Inverted::default());
    mirror(&solid, &mut u);
    let tetrahedra = energy.report().tetrahedra;
    assert_eq!(energy.inverted(&u), Inverted { triangles: 0, tetrahedra });
    assert!(tetrahedra > 100);
}

/// Volumes of 1 to 1e6: neither forces nor torques have a resultant beyond 0.3u of the sum of
/// their norms. Points without neighbours are named in the module `refusals`.
#[test]
fn e16_uneven_volumes_keep_the_balance_of_forces_and_torques() {
    let regular = lattice(&[0.0, 0.0, 0.0], &[4, 4, 4], 0.1);
    let volumes: Vec<f64> = (0..125).map(|k| if k % 3 == 0 { 1e-9 } else { 1e-3 }).collect();
    let body = Arc::new(Body::new(3, regular.positions(), &volumes, None));
    let u = displacements(&body, 0.02, 1);
    let energy =
        DiscreteEnergy::new(body, 0.2, Weights::Volumes, laws([1.0, 1e2, 1e5], 1)).unwrap();
    let forces = gradient(&energy, &u);
    let scale: f64 = forces.chunks_exact(3).map(norm).sum();
    let (mut force, mut torque, mut lever) = ([0.0; 3], [0.0; 3], 0.0f64);
    let rows = regular.positions().chunks_exact(3).zip(u.chunks_exact(3));
    for ((x, u), f) in rows.zip(forces.chunks_exact(3)) {
        let x: Vec<f64> = x.iter().zip(u).map(|(x, u)| x + u).collect();
        lever = lever.max(norm(&x));
        for axis in 0..3 {
            let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
            force[axis] += f[axis];
            torque[axis] += x[p] * f[q] - x[q] * f[p];
        }
    }
    let (force, torque) = (norm(&force) / scale, norm(&torque) / (lever * scale));
    println!("e16 force {} u torque {} u", force / U, torque / U);
    assert!(force <= U && torque <= U, "{force:e} {torque:e}");
}

/// Where the energy underflows to 0 the forces keep their digits: at displacements of 1e-160 and
/// 1e-200 they differ from those at 1e-30, scaled, by at most 3.8e-16.
#[test]
fn e12_forces_keep_their_digits_where_the_energy_underflows() {
    let mut worst: f64 = 0.0;
    for (dimension, c3) in [(2, 0.0), (3, 1.0)] {
        let body = lattice(&vec![0.0; dimension], &vec![3; dimension], 1.0);
        let laws = laws([1.0, 1.0, c3], 1);
        let energy = DiscreteEnergy::new(Arc::clone(&body), 1.5, Weights::Unit, laws).unwrap();
        let unit = displacements(&body, 1.0, 3);
        let at = |size: f64| -> Vec<f64> {
            let u: Vec<f64> = unit.iter().map(|x| x * size).collect();
            gradient(&energy, &u).iter().map(|g| g / size).collect()
        };
        let expected = at(1e-30);
        for size in [1e-160, 1e-200] {
            worst = worst.max(distance(&at(size), &expected));
        }
    }
    println!("e12 {worst:e}");
    assert!(worst <= 16.0 * U, "{worst:e}");
}

/// Bodies of 2^-40 m and of 2^40 m, and with unit weights of 2^-80 m and 2^80 m, have the forces of
/// one of 1 m, scaled by the power of two that the units say: bit for bit.
#[test]
fn e12_bodies_of_any_size_have_the_same_forces_scaled() {
    for (d, measure, c) in [
        (2, 1, [1.0, 0.0, 0.0]),
        (3, 1, [1.0, 0.0, 0.0]),
        (2, 2, [0.0, 1.0, 0.0]),
        (3, 2, [0.0, 1.0, 0.0]),
        (3, 3, [0.0, 0.0, 1.0]),
    ] {
        for (weights, steps, volumes) in [
            (Weights::Unit, 80, 0),
            (Weights::Uniform, 40, measure + 1),
            (Weights::Truncated, 40, measure + 1),
            (Weights::Volumes, 40, measure + 1),
        ] {
            let at = |exponent: i32| {
                let size = libm::ldexp(1.0, exponent);
                let body = lattice(&vec![0.0; d], &vec![4; d], size);
                let u = displacements(&body, 0.01, 5);
                let energy = DiscreteEnergy::new(body, 2.0 * size, weights, laws(c, 1)).unwrap();
                // The energy is a measure times as many volumes, a force that over a length.
                let powers = measure + d as i32 * volumes - 1;
                let forces = gradient(&energy, &u);
                forces.into_iter().map(|f| libm::ldexp(f, -powers * exponent)).collect::<Vec<_>>()
            };
            let expected = at(0);
            assert!(norm(&expected) > 0.0);
            assert_eq!(at(-steps), expected, "{d} {measure} {weights:?}");
            assert_eq!(at(steps), expected, "{d} {measure} {weights:?}");
        }
    }
}

/// The corners of one interaction of each kind, in 2 or 3 dimensions.
const SINGLE: [(usize, &[f64], [f64; 3]); 5] = [
    (2, &[0.0, 0.0, 1.3, 0.4], [1.0, 0.0, 0.0]),
    (2, &[0.0, 0.0, 1.3, 0.4, 0.2, 0.9], [0.0, 1.0, 0.0]),
    (3, &[0.0, 0.0, 0.0, 1.3, 0.4, -0.2], [1.0, 0.0, 0.0]),
    (3, &[0.0, 0.0, 0.0, 1.3, 0.4, -0.2, 0.2, 0.9, 0.3], [0.0, 1.0, 0.0]),
    (3, &[0.0, 0.0, 0.0, 1.3, 0.4, -0.2, 0.2, 0.9, 0.3, -0.1, 0.5, 1.1], [0.0, 0.0, 1.0]),
];

/// Rigid rotations by 1 to 180 degrees about the third axis, each kind of interaction alone: its
/// force is at most 1.8u of its force at a strain of 1.
#[test]
fn e17_rigid_rotations_leave_forces_at_rounding() {
    let mut worst: f64 = 0.0;
    for (dimension, corners, c) in SINGLE {
        let n = corners.len() / dimension;
        let body = Arc::new(Body::new(dimension, corners, &vec![1.0; n], None));
        let energy =
            DiscreteEnergy::new(Arc::clone(&body), 4.0, Weights::Unit, laws(c, 1)).unwrap();
        let displaced = |to: &dyn Fn(&[f64]) -> Vec<f64>| -> Vec<f64> {
            let rows = body.positions().chunks_exact(dimension);
            rows.flat_map(|x| to(x).into_iter().zip(x).map(|(to, x)| to - x).collect::<Vec<_>>())
                .collect()
        };
        let doubled = displaced(&|x| x.iter().map(|x| 2.0 * x).collect());
        let scale = norm(&gradient(&energy, &doubled));
        for degrees in [1.0, 10.0, 30.0, 45.0, 90.0, 120.0, 179.0, 180.0] {
            let (sin, cos) = libm::sincos(f64::to_radians(degrees));
            let turned = displaced(&|x| {
                let mut y = x.to_vec();
                (y[0], y[1]) = (cos * x[0] - sin * x[1], sin * x[0] + cos * x[1]);
                y
            });
            worst = worst.max(norm(&gradient(&energy, &turned)) / scale);
        }
    }
    println!("e17 {worst:e} = {} u", worst / U);
    assert!(worst <= 8.0 * U, "{worst:e}");
}

/// Energy, forces and stiffness of 1.2e6 interactions have the same bits for 1 to 16 threads, and
/// the sum of all forces is at most 0.3u of the sum of their norms.
#[test]
fn e21_sums_of_a_million_terms_do_not_depend_on_the_threads() {
    let body = lattice(&[0.0; 3], &[20, 19, 18], 1.0);
    let energy =
        DiscreteEnergy::new(Arc::clone(&body), 2.0, Weights::Uniform, laws([1.0, 1.0, 1.0], 1))
            .unwrap();
    let report = energy.report();
    let interactions = report.bonds + report.triangles + report.tetrahedra;
    assert!(interactions > 1_000_000, "{interactions}");
    let u = displacements(&body, 0.01, 4);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut forces = vec![0.0; u.len()];
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            let parts = energy.tangent(&u, &mut forces, &mut tangent).unwrap();
            (parts, forces, tangent.values)
        })
    };
    let one = run(1);
    for threads in [2, 3, 4, 8, 16] {
        assert!(run(threads) == one, "{threads} threads");
    }
    let scale: f64 = one.1.chunks_exact(3).map(norm).sum();
    let sums: Vec<f64> = (0..3).map(|axis| one.1.iter().skip(axis).step_by(3).sum()).collect();
    println!(
        "e21 {interactions} interactions, {:e} = {} u",
        norm(&sums) / scale,
        norm(&sums) / scale / U
    );
    assert!(norm(&sums) <= 1.5 * U * scale);
}
