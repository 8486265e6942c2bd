//! Physics that must hold whatever the energy: momentum, objectivity, exact derivatives, units,
//! and the same bits for any number of threads.

use std::sync::Arc;

use num_dual::{DualNum, HyperDual64};
use piola_runtime::assembly::{DiscreteEnergy, Elements, Laws};
use piola_runtime::body::Body;
use piola_runtime::element::{CoordinateElement, Element};
use piola_runtime::energy::{Energy, EnergyParts};
use piola_runtime::kernel::Measure;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{U, cloud, dense, displacements, distance, lattice, laws, norm, seth_hill};

/// A cloud in the plane or in space with energies of all its measures, and a strained state.
struct Strained {
    energy: DiscreteEnergy,
    u: Vec<f64>,
}

/// Strain of that state, extent of its body and length of a typical bond in m.
const STRAIN: f64 = 0.05;
const SIZE: f64 = 0.8;
const BOND: f64 = 0.1;

/// Exponents of bonds, triangles and tetrahedra: none of the measures is treated alike.
const EXPONENTS: [i32; 3] = [0, 2, -1];

fn strained(dimension: usize, weights: Weights) -> Strained {
    let counts: &[usize] = if dimension == 2 { &[9, 6] } else { &[6, 4, 4] };
    let body = cloud(counts, 0.1, 7);
    let u = displacements(&body, STRAIN, 11);
    let energy = DiscreteEnergy::new(body, 0.21, weights, mixed_laws(dimension)).unwrap();
    Strained { energy, u }
}

fn mixed_laws(dimension: usize) -> Laws {
    Laws {
        bond: Some(seth_hill(1.0, EXPONENTS[0])),
        triangle: Some(seth_hill(300.0, EXPONENTS[1])),
        tetrahedron: (dimension == 3).then(|| seth_hill(1e6, EXPONENTS[2])),
    }
}

fn gradient(energy: &DiscreteEnergy, u: &[f64]) -> (EnergyParts, Vec<f64>) {
    let mut gradient = vec![0.0; u.len()];
    let parts = energy.forces(u, &mut gradient).unwrap();
    (parts, gradient)
}

fn tangent(energy: &DiscreteEnergy, u: &[f64]) -> (EnergyParts, Vec<f64>, BlockMatrix) {
    let (mut gradient, mut tangent) = (vec![0.0; u.len()], BlockMatrix::zeros(energy.pattern()));
    let parts = energy.tangent(u, &mut gradient, &mut tangent).unwrap();
    (parts, gradient, tangent)
}

#[test]
fn every_kind_of_interaction_takes_part() {
    for dimension in [2, 3] {
        let Strained { energy, u } = strained(dimension, Weights::Truncated);
        let parts = energy.energy(&u).unwrap();
        let smallest = 1e-3 * parts.total();
        assert!(parts.of("psi(l)") > smallest && parts.of("psi(a)") > smallest, "{parts:?}");
        assert_eq!(parts.of("psi(v)") > smallest, dimension == 3, "{parts:?}");
    }
}

#[test]
fn what_the_tangent_held_before_does_not_matter() {
    for (dimension, counts) in [(2, &[9, 6][..]), (3, &[6, 4, 4])] {
        let body = cloud(counts, 0.1, 7);
        let u = displacements(&body, STRAIN, 11);
        let all = mixed_laws(dimension);
        let bonds = Laws { bond: Some(seth_hill(1.0, 0)), ..Laws::default() };
        let others = Laws { bond: None, ..mixed_laws(dimension) };
        for laws in [bonds, others, all] {
            let energy =
                DiscreteEnergy::new(Arc::clone(&body), 0.21, Weights::Truncated, laws).unwrap();
            let (_, _, clean) = tangent(&energy, &u);
            let mut used = BlockMatrix::zeros(energy.pattern());
            used.values.fill(f64::NAN);
            energy.tangent(&u, &mut vec![f64::NAN; u.len()], &mut used).unwrap();
            assert_eq!(clean.values, used.values);
            let n = u.len();
            let k = dense(&clean);
            assert!((0..n * n).all(|at| k[at] == k[at % n * n + at / n]), "symmetric");
        }
    }
}

#[test]
fn forces_and_moments_sum_to_zero() {
    for (dimension, weights) in [
        (2, Weights::Truncated),
        (3, Weights::Truncated),
        (3, Weights::Volumes),
        (2, Weights::Unit),
    ] {
        let Strained { energy, u } = strained(dimension, weights);
        let (_, forces) = gradient(&energy, &u);
        let body = energy.body();
        let (mut force, mut moment) = ([0.0; 3], [0.0; 3]);
        let (mut force_scale, mut moment_scale) = (0.0, 0.0);
        for point in 0..body.n_points() {
            let mut x = [0.0; 3];
            let mut f = [0.0; 3];
            for axis in 0..dimension {
                f[axis] = forces[point * dimension + axis];
                x[axis] = body.position(point)[axis] + u[point * dimension + axis];
                force[axis] += f[axis];
            }
            for axis in 0..3 {
                let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
                moment[axis] += x[p] * f[q] - x[q] * f[p];
            }
            force_scale += norm(&f);
            moment_scale += norm(&f) * norm(&x);
        }
        assert!(force_scale > 0.0);
        assert!(norm(&force) <= 3.0 * U * force_scale, "{:e}", norm(&force) / force_scale);
        assert!(norm(&moment) <= 3.0 * U * moment_scale, "{:e}", norm(&moment) / moment_scale);
    }
}

/// Rotation by an angle about a fixed skew axis, or in the plane.
fn rotation(dimension: usize, angle: f64) -> Vec<f64> {
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    if dimension == 2 {
        return vec![c, -s, s, c];
    }
    let a = [2.0 / 7.0, 3.0 / 7.0, 6.0 / 7.0];
    let skew = [0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0];
    let entry = |k: usize| {
        let unit = if k / 3 == k % 3 { c } else { 0.0 };
        unit + s * skew[k] + (1.0 - c) * a[k / 3] * a[k % 3]
    };
    (0..9).map(entry).collect()
}

fn rotate(matrix: &[f64], rows: &[f64], dimension: usize) -> Vec<f64> {
    let turn = |x: &[f64]| -> Vec<f64> {
        (0..dimension)
            .map(|r| (0..dimension).map(|c| matrix[r * dimension + c] * x[c]).sum())
            .collect()
    };
    rows.chunks_exact(dimension).flat_map(turn).collect()
}

#[test]
fn a_rotation_turns_the_forces_and_keeps_the_energy() {
    for dimension in [2, 3] {
        let Strained { energy, u } = strained(dimension, Weights::Truncated);
        let (parts, forces) = gradient(&energy, &u);
        for angle in [0.02, 1.0, 2.5, 3.1] {
            let matrix = rotation(dimension, angle);
            let rest = energy.body().positions();
            let current: Vec<f64> = rest.iter().zip(&u).map(|(x, u)| x + u).collect();
            let turned: Vec<f64> = rotate(&matrix, &current, dimension)
                .iter()
                .zip(rest)
                .map(|(now, rest)| now - rest)
                .collect();
            let (turned_parts, turned_forces) = gradient(&energy, &turned);
            // Rounding the turned positions strains each bond by u*size/bond.
            // Measured are 0.6 u of that for the energy and 2.9 u for the forces.
            let rounding = U * (SIZE / BOND) / STRAIN;
            let error = (turned_parts.total() - parts.total()).abs() / parts.total();
            assert!(error <= 3.0 * rounding, "energy {error:e}");
            let error = distance(&turned_forces, &rotate(&matrix, &forces, dimension));
            assert!(error <= 12.0 * rounding, "forces {error:e}");
        }
    }
}

#[test]
fn a_rotation_of_the_body_at_rest_costs_nothing() {
    for dimension in [2, 3] {
        let body = strained(dimension, Weights::Truncated).energy.body().clone();
        // Linear in every strain, so that forces at strain 1 are a scale.
        let laws = laws([1.0, 300.0, if dimension == 3 { 1e6 } else { 0.0 }], 1);
        let energy =
            DiscreteEnergy::new(Arc::clone(&body), 0.21, Weights::Truncated, laws).unwrap();
        let largest = |forces: &[f64]| forces.chunks_exact(dimension).map(norm).fold(0.0, f64::max);
        let rest = body.positions();
        let scale = largest(&gradient(&energy, rest).1);
        for degrees in [1.0, 30.0, 90.0, 135.0, 180.0] {
            let matrix = rotation(dimension, degrees * std::f64::consts::PI / 180.0);
            let turned = rotate(&matrix, rest, dimension);
            let u: Vec<f64> = turned.iter().zip(rest).map(|(now, rest)| now - rest).collect();
            let (_, forces) = gradient(&energy, &u);
            assert!(largest(&forces) <= 16.0 * U * scale, "{:e}", largest(&forces) / scale);
        }
    }
}

/// Derivative of a vector function at 0 by differences of fourth order.
fn derivative(h: f64, at: impl Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let (near, far) = ([at(-h), at(h)], [at(-2.0 * h), at(2.0 * h)]);
    let slope = |k: usize| (8.0 * (near[1][k] - near[0][k]) - (far[1][k] - far[0][k])) / (12.0 * h);
    (0..near[0].len()).map(slope).collect()
}

/// The state with one displacement component moved.
fn moved(u: &[f64], index: usize, step: f64) -> Vec<f64> {
    let mut moved = u.to_vec();
    moved[index] += step;
    moved
}

#[test]
fn the_tangent_is_the_derivative_of_the_gradient() {
    for dimension in [2, 3] {
        let Strained { energy, u } = strained(dimension, Weights::Truncated);
        let whole = dense(&tangent(&energy, &u).2);
        let column = |index: usize| derivative(1e-5, |h| gradient(&energy, &moved(&u, index, h)).1);
        // The tangent is symmetric as stored: its rows are its columns.
        let differences: Vec<f64> = (0..u.len()).flat_map(column).collect();
        let error = distance(&whole, &differences);
        // `u h'/h` with lengths h' of 0.1 and the step h, over strains: measured are 3.4e-13.
        assert!(error <= 1.5e-12, "{error:e}");
    }
}

#[test]
fn the_gradient_is_the_derivative_of_the_energy() {
    for dimension in [2, 3] {
        let Strained { energy, u } = strained(dimension, Weights::Volumes);
        let (_, forces) = gradient(&energy, &u);
        let total = |u: &[f64]| vec![energy.energy(u).unwrap().total()];
        let slope = |index: usize| derivative(1e-5, |h| total(&moved(&u, index, h)))[0];
        let differences: Vec<f64> = (0..u.len()).map(slope).collect();
        let error = distance(&forces, &differences);
        // Measured are 3.2e-12: the energy of the whole body is rounded, forces are of one point.
        assert!(error <= 1.5e-11, "{error:e}");
    }
}

/// The textbook Seth-Hill energy on hyper-dual numbers.
fn textbook(c: f64, n: i32) -> impl Fn(HyperDual64, f64) -> HyperDual64 + Send + Sync {
    move |measure, reference| {
        let ratio = measure / reference;
        let strain = if n == 0 { ratio.ln() } else { (ratio.powi(n) - 1.0) / f64::from(n) };
        strain * strain * (0.5 * c * reference)
    }
}

fn coordinate_elements(dimension: usize) -> Elements {
    let element = |measure: Measure, c: f64, n: i32| {
        let element = CoordinateElement::new(measure, dimension, textbook(c, n));
        Some(Box::new(element) as Box<dyn Element>)
    };
    Elements {
        bond: element(Measure::Length, 1.0, EXPONENTS[0]),
        triangle: element(Measure::Area, 300.0, EXPONENTS[1]),
        tetrahedron: if dimension == 3 {
            element(Measure::Volume, 1e6, EXPONENTS[2])
        } else {
            None
        },
    }
}

#[test]
fn hyper_dual_coordinates_give_the_same_derivatives() {
    for dimension in [2, 3] {
        let Strained { energy, u } = strained(dimension, Weights::Truncated);
        let elements = coordinate_elements(dimension);
        let body = Arc::clone(energy.body());
        let dual = DiscreteEnergy::with_elements(body, 0.21, Weights::Truncated, elements).unwrap();
        let (parts, forces, stiffness) = tangent(&energy, &u);
        let (dual_parts, dual_forces, dual_stiffness) = tangent(&dual, &u);
        assert!((parts.total() - dual_parts.total()).abs() <= 1.5e-15 * parts.total());
        assert!(distance(&forces, &dual_forces) <= 1e-14);
        let error = distance(&stiffness.values, &dual_stiffness.values);
        assert!(error <= 8e-16, "{error:e}");
        assert_eq!(gradient(&dual, &u), (dual_parts.clone(), dual_forces));
        assert_eq!(dual.energy(&u).unwrap(), dual_parts);
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    for (dimension, cells) in [(2, vec![30, 12]), (3, vec![14, 4, 5])] {
        let body = lattice(&vec![-0.3; dimension], &cells, 0.1);
        let u = displacements(&body, 0.03, 5);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = DiscreteEnergy::new(
                    Arc::clone(&body),
                    0.2,
                    Weights::Truncated,
                    mixed_laws(dimension),
                )
                .unwrap();
                let (parts, forces, stiffness) = tangent(&energy, &u);
                assert_eq!(energy.energy(&u).unwrap(), parts);
                assert_eq!(gradient(&energy, &u), (parts.clone(), forces.clone()));
                let numbers = [parts.of("psi(l)"), parts.of("psi(a)"), parts.of("psi(v)")];
                let all = numbers.iter().chain(&forces).chain(&stiffness.values);
                (energy.report().clone(), all.map(|x| x.to_bits()).collect::<Vec<u64>>())
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(4));
    }
}

/// A body in a unit of length that is `1/scale` of the metre: coordinates grow by `scale`,
/// coefficients in `J/m^k` shrink by `scale^k`, energies in J stay.
fn in_other_units(metres: &Body, scale: f64) -> (EnergyParts, Vec<f64>, Vec<f64>) {
    let u = displacements(metres, STRAIN, 4);
    let times = |x: &[f64], factor: f64| -> Vec<f64> { x.iter().map(|x| x * factor).collect() };
    let dimension = metres.dimension();
    let power = |k: usize| (0..k).fold(1.0, |power, _| power * scale);
    let volumes = times(metres.volumes(), power(dimension));
    let body = Body::new(dimension, &times(metres.positions(), scale), &volumes, None);
    let laws = Laws {
        bond: Some(seth_hill(1.0 / power(2 * dimension + 1), 0)),
        triangle: Some(seth_hill(300.0 / power(3 * dimension + 2), 2)),
        tetrahedron: (dimension == 3).then(|| seth_hill(1e6 / power(4 * dimension + 3), 1)),
    };
    let energy =
        DiscreteEnergy::new(Arc::new(body), 0.21 * scale, Weights::Truncated, laws).unwrap();
    let (parts, forces, stiffness) = tangent(&energy, &times(&u, scale));
    (parts, times(&forces, scale), times(&stiffness.values, scale * scale))
}

fn compare_units(metres: &Body, scale: f64) {
    let (parts, forces, stiffness) = in_other_units(metres, 1.0);
    let other = in_other_units(metres, scale);
    let error = (other.0.total() - parts.total()).abs() / parts.total();
    assert!(error <= 2e-15, "scale {scale:e} energy {error:e}");
    let errors = [distance(&other.1, &forces), distance(&other.2, &stiffness)];
    assert!(errors.iter().all(|&error| error <= 4e-15), "scale {scale:e} {errors:?}");
}

#[test]
fn results_do_not_depend_on_the_unit_of_length() {
    for counts in [vec![7, 5], vec![5, 4, 4]] {
        let body = cloud(&counts, 0.1, 3);
        // Millimetres, nanometres, kilometres, and units that round nothing.
        for scale in [1e3, 1e9, 1e-3, 1024.0, 1.0 / 1048576.0] {
            compare_units(&body, scale);
        }
    }
}

#[test]
fn a_bond_body_ignores_cliques() {
    let body = lattice(&[0.0, 0.0, 0.0], &[4, 4, 4], 1.0);
    let energy =
        DiscreteEnergy::new(body, 3.0, Weights::Uniform, laws([1.0, 0.0, 0.0], 1)).unwrap();
    let report = energy.report();
    assert_eq!((report.triangles, report.tetrahedra, report.dropped_triangles), (0, 0, 0));
    assert_eq!(report.pattern_blocks as u64, 125 + report.bonds);
}

#[test]
fn the_magnitude_of_an_energy_is_that_of_its_parts() {
    let names: Arc<[String]> = ["psi(l)", "psi(F)", "stabilisation"].map(String::from).into();
    let parts = EnergyParts::new(&names, vec![1.0, -8.0, 16.0]);
    assert_eq!((parts.total(), parts.magnitude()), (9.0, 25.0));
    assert_eq!((parts.of("psi(F)"), parts.of("psi(a)")), (-8.0, 0.0));
    assert_eq!(EnergyParts::default().magnitude(), 0.0);
}
