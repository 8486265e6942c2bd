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
        (3, "psi(a) = A*(a/A - 1)^2", "psi(a, l1) = A*(a/A - 1)^2"),
        (3, "psi(v) = V*ln(v/V)^2", "psi(v, a1, l2) = V*ln(v/V)^2"),
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

/// A triangle by hand: the mean over its corners, in whatever order its points stand.
#[test]
fn an_angle_belongs_to_each_corner_in_turn() {
    let x = [[0.0, 0.0], [0.1, 0.02], [0.03, 0.09]];
    let moved = [[0.01, 0.0], [0.11, 0.05], [0.02, 0.1]];
    let angle = |at: &[[f64; 2]; 3], corner: usize| {
        let side = |k: usize| {
            let to = at[(corner + k) % 3];
            [to[0] - at[corner][0], to[1] - at[corner][1]]
        };
        let (p, q) = (side(1), side(2));
        let length = |p: [f64; 2]| libm::hypot(p[0], p[1]);
        libm::acos((p[0] * q[0] + p[1] * q[1]) / (length(p) * length(q)))
    };
    let changed = |corner: usize| angle(&moved, corner) - angle(&x, corner);
    let expected = (0..3).map(|corner| changed(corner) * changed(corner)).sum::<f64>() / 3.0;
    for order in [[0, 1, 2], [2, 0, 1], [1, 0, 2]] {
        let positions: Vec<f64> = order.iter().flat_map(|k| x[*k]).collect();
        let body = Arc::new(Body::new(2, &positions, &[1.0; 3], None));
        let elements = elements("potential p\npsi(angle) = (angle - Angle)^2", 2);
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
        assert!((found - expected).abs() < 1e-14 * expected, "{found} {expected}");
    }
}
