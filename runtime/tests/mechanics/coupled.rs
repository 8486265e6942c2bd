//! Energies of several measures of a triangle or a tetrahedron, from texts: against energies of one measure,
//! against geometry by hand, against differences of themselves.

use std::sync::Arc;

use piola_compiler::{Form, Kernel, Level, Mode, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Elements};
use piola_runtime::body::Body;
use piola_runtime::element::{CoupledElement, Element, MeasureElement, SumElement};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Coupled, Measure};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{U, cloud, dense, displacements, distance, norm};

/// All that a triangle and a tetrahedron have.
const RICH: &str = "potential rich
psi(angle, l1, l2) = exp(-l1/L1 - l2/L2)*(angle - Angle)^2 + l1/L1*angle
psi(a, l1, l2, l3) = (a/A - 1)^2*(l1/L1 + l2/L2 + l3/L3)
psi(a) = (a/A - 1)^2
psi(v, a1, a2, a3, a4) = 1e-3*(v/V - 1)*(a1/A1 + a2/A2 + a3/A3 + a4/A4 - 4) + (v/V - 1)^2
psi(v, l1, l6) = (l1/L1 - l6/L6)^2*v/V
";

fn elements(text: &str, d: usize) -> Elements {
    let (_, model) = check_text(text).unwrap();
    let values = model.values(d, &[], Some(0.21)).unwrap();
    let mode = Mode::Jit(Level::Fast);
    let compiled = model.compile(&values, mode, Form::Accurate).unwrap();
    let alone = |kernel: Kernel| -> Box<dyn Element> {
        Box::new(MeasureElement::new(kernel.measure(), d, Box::new(kernel)))
    };
    let several = compiled.coupled.into_iter().map(|kernel| -> Box<dyn Element> {
        Box::new(CoupledElement::new(kernel.clique(), d, Box::new(Coupled::new(kernel))))
    });
    let mut elements = Elements::default();
    for element in compiled.kernels.into_iter().map(alone).chain(several) {
        let place = match element.measure() {
            Measure::Length => &mut elements.bond,
            Measure::Area => &mut elements.triangle,
            Measure::Volume => &mut elements.tetrahedron,
        };
        *place = Some(match place.take() {
            Some(first) => Box::new(SumElement::new(first, element)),
            None => element,
        });
    }
    elements
}

fn energy(text: &str, body: &Arc<Body>) -> DiscreteEnergy {
    let elements = elements(text, body.dimension());
    DiscreteEnergy::with_elements(Arc::clone(body), 0.21, Weights::Truncated, elements).unwrap()
}

fn body(d: usize) -> Arc<Body> {
    cloud(if d == 2 { &[5, 4] } else { &[3, 3, 3] }, 0.1, 7)
}

/// Energy, forces and tangent.
fn all(energy: &DiscreteEnergy, u: &[f64]) -> (f64, Vec<f64>, Vec<f64>) {
    let (mut forces, mut tangent) = (vec![0.0; u.len()], BlockMatrix::zeros(energy.pattern()));
    let parts = energy.tangent(u, &mut forces, &mut tangent).unwrap();
    (parts.total(), forces, dense(&tangent))
}

#[test]
fn an_energy_of_the_whole_alone_is_that_energy() {
    for (d, alone, several) in [
        (2, "psi(a) = ln(a/A)^2", "psi(a, l1) = ln(a/A)^2"),
        (2, "psi(a) = (a/A - 1)^2", "psi(a, l1) = (a/A - 1)^2"),
        (3, "psi(a) = A*(a/A - 1)^2", "psi(a, l1) = A*(a/A - 1)^2"),
        (3, "psi(v) = V*ln(v/V)^2", "psi(v, a1, l2) = V*ln(v/V)^2"),
        (3, "psi(v) = (v/V - 1)^2", "psi(v, l6) = (v/V - 1)^2"),
    ] {
        let body = body(d);
        for strain in [0.05, 1e-9] {
            let u = displacements(&body, strain, 11);
            let of = |text: &str| all(&energy(&format!("potential p\n{text}"), &body), &u);
            let (expected, found) = (of(alone), of(several));
            assert!((found.0 - expected.0).abs() <= 64.0 * U * expected.0, "{several} {strain}");
            let errors = [distance(&found.1, &expected.1), distance(&found.2, &expected.2)];
            // Measured are 3e-15.
            assert!(errors.iter().all(|x| *x < 1e-13), "{several} at {strain}: {errors:?}");
        }
    }
}

/// A force is the slope of the energy, a column of the tangent that of the forces.
#[test]
fn forces_and_tangent_are_derivatives() {
    for d in [2, 3] {
        let body = body(d);
        let energy = energy(RICH, &body);
        assert_eq!(energy.parts().len(), if d == 2 { 1 } else { 2 }, "{:?}", energy.parts());
        let u = displacements(&body, 0.05, 11);
        let (_, forces, tangent) = all(&energy, &u);
        let n = u.len();
        let scale = forces.iter().fold(0.0f64, |size, x| size.max(x.abs()));
        let stiffest = tangent.iter().fold(0.0f64, |size, x| size.max(x.abs()));
        let step = 1e-4 * 0.1;
        for k in (0..n).step_by(7) {
            let at = |sign: f64| {
                let mut moved = u.clone();
                moved[k] += sign * step;
                let (psi, forces, _) = all(&energy, &moved);
                [vec![psi], forces].concat()
            };
            let (far, near) = ([at(-2.0), at(2.0)], [at(-1.0), at(1.0)]);
            let slope = |row: usize| {
                let difference = |pair: &[Vec<f64>; 2]| pair[1][row] - pair[0][row];
                (8.0 * difference(&near) - difference(&far)) / (12.0 * step)
            };
            assert!((slope(0) - forces[k]).abs() < 1e-8 * scale, "force {k} in {d} dimensions");
            for row in 0..n {
                let error = (slope(1 + row) - tangent[row * n + k]).abs();
                assert!(error < 1e-8 * stiffest, "{row} {k} in {d} dimensions: {error:e}");
            }
        }
    }
}

#[test]
fn forces_and_moments_sum_to_zero() {
    for d in [2, 3] {
        let body = body(d);
        let u = displacements(&body, 0.05, 11);
        let (_, forces, _) = all(&energy(RICH, &body), &u);
        let (mut force, mut moment, mut scale) = ([0.0; 3], [0.0; 3], 0.0);
        for point in 0..body.n_points() {
            let (mut x, mut f) = ([0.0; 3], [0.0; 3]);
            for axis in 0..d {
                f[axis] = forces[point * d + axis];
                x[axis] = body.position(point)[axis] + u[point * d + axis];
                force[axis] += f[axis];
            }
            for axis in 0..3 {
                let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
                moment[axis] += x[p] * f[q] - x[q] * f[p];
            }
            scale += norm(&f);
        }
        assert!(norm(&force) < 64.0 * U * scale && norm(&moment) < 64.0 * U * scale);
    }
}

/// Turns by angles about an axis: the energy stays, forces turn with the body, products are those of the
/// stored tangent.
#[test]
fn a_rotation_turns_the_forces_and_keeps_the_energy() {
    for d in [2, 3] {
        let body = body(d);
        let energy = energy(RICH, &body);
        let u = displacements(&body, 0.05, 11);
        let (psi, forces, tangent) = all(&energy, &u);
        let mut product = vec![0.0; u.len()];
        energy.hessian(&u).unwrap().multiply(&u, &mut product);
        let rows = tangent.chunks_exact(u.len());
        let expected: Vec<f64> =
            rows.map(|row| row.iter().zip(&u).map(|(k, x)| k * x).sum()).collect();
        assert!(distance(&product, &expected) < 1e-13, "{:e}", distance(&product, &expected));
        for angle in [0.02, 1.0, 3.1] {
            let (s, c) = (libm::sin(angle), libm::cos(angle));
            let turn = |rows: &[f64]| -> Vec<f64> {
                let turned = rows.chunks_exact(d).flat_map(|x| {
                    let plane = [c * x[0] - s * x[1], s * x[0] + c * x[1]];
                    plane.into_iter().chain(x[2..].iter().copied()).collect::<Vec<f64>>()
                });
                turned.collect()
            };
            let rest = body.positions();
            let now: Vec<f64> = rest.iter().zip(&u).map(|(x, u)| x + u).collect();
            let turned: Vec<f64> = turn(&now).iter().zip(rest).map(|(now, x)| now - x).collect();
            let (turned_psi, turned_forces, _) = all(&energy, &turned);
            // Rounded positions strain a bond of 0.1 by u*0.4/0.1, a part u*4/0.05 of its strain.
            let rounding = U * 4.0 / 0.05;
            assert!((turned_psi - psi).abs() <= 8.0 * rounding * psi, "{angle} in {d} dimensions");
            let error = distance(&turned_forces, &turn(&forces));
            assert!(error <= 16.0 * rounding, "{angle} in {d} dimensions: {error:e}");
        }
    }
}

/// A triangle by hand: the mean over all orders of its points, in whatever order these stand.
#[test]
fn an_angle_belongs_to_each_corner_in_turn() {
    let x = [[0.0, 0.0], [0.1, 0.02], [0.03, 0.09]];
    let moved = [[0.01, 0.0], [0.11, 0.05], [0.02, 0.1]];
    let side = |at: &[[f64; 2]; 3], from: usize, to: usize| -> [f64; 2] {
        [at[to][0] - at[from][0], at[to][1] - at[from][1]]
    };
    let length = |p: [f64; 2]| libm::hypot(p[0], p[1]);
    let angle = |at: &[[f64; 2]; 3], [corner, first, second]: [usize; 3]| {
        let (p, q) = (side(at, corner, first), side(at, corner, second));
        libm::acos((p[0] * q[0] + p[1] * q[1]) / (length(p) * length(q)))
    };
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let mean = |psi: &dyn Fn([usize; 3]) -> f64| orders.map(psi).iter().sum::<f64>() / 6.0;
    let changed = |order| angle(&moved, order) - angle(&x, order);
    let stretch =
        |from: usize, to: usize| length(side(&moved, from, to)) / length(side(&x, from, to));
    let alone = mean(&|order| changed(order) * changed(order));
    let with_sides = mean(&|order @ [corner, first, second]| {
        let (p, q) = (stretch(corner, first), stretch(corner, second));
        p * q * q * changed(order) * changed(order)
    });
    let cases = [
        ("psi(angle) = (angle - Angle)^2", alone),
        ("psi(angle, l1, l2) = l1/L1*(l2/L2)^2*(angle - Angle)^2", with_sides),
    ];
    let both = cases.into_iter().flat_map(|case| orders.map(|order| (case, order)));
    for ((text, expected), order) in both {
        let positions: Vec<f64> = order.iter().flat_map(|k| x[*k]).collect();
        let body = Arc::new(Body::new(2, &positions, &[1.0; 3], None));
        let elements = elements(&format!("potential p\n{text}"), 2);
        let weights = Weights::Unit;
        let energy =
            DiscreteEnergy::with_elements(Arc::clone(&body), 0.21, weights, elements).unwrap();
        let mut u = vec![0.0; 6];
        for point in 0..3 {
            let k = order[body.user_index()[point] as usize];
            for axis in 0..2 {
                u[point * 2 + axis] = moved[k][axis] - x[k][axis];
            }
        }
        let found = energy.energy(&u).unwrap().total();
        assert!((found - expected).abs() < 1e-14 * expected, "{text}: {found} {expected}");
    }
}
