//! Bonds that yield and break by their direction at rest, against loops over all of them.

use piola_compiler::Level;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::Fracture;
use piola_runtime::neighborhood::Neighborhood;

use crate::cliques::bodies;
use crate::families::largest;
use crate::following::tangents_are_derivatives;
use crate::reference::off;
use crate::states::{remembering, remembering_as};

const YIELD: f64 = 0.02;
const BREAK: f64 = 0.09;

fn text(d: usize) -> String {
    let n = ["0.6, 0.8", "0.48, 0.6, 0.64"][d - 2];
    format!(
        "potential p\ndimensions {d}\nstate p = 0\nn = vector({n})\nc = (n*Xi/L)^2\ns = l/L - 1\n\
         sY = {YIELD}*(1 + 3*c)\n\
         update p = if abs(s - p) > sY then s - sign(s - p)*sY else p\n\
         psi(l) = 1/2*(1 + 4*c^2)*L*(s - p)^2\nbreak when s > {BREAK}*(2 - c) \"across the fibre\""
    )
}

/// `(n*e)^2` and the stretch less 1 of a bond.
fn of_bond(body: &Body, [i, j]: [usize; 2], u: &[f64]) -> [f64; 2] {
    let d = body.dimension();
    let n = [&[0.6, 0.8][..], &[0.48, 0.6, 0.64]][d - 2];
    let (p, q) = (body.position(i), body.position(j));
    let xi: Vec<f64> = p.iter().zip(q).map(|(p, q)| q - p).collect();
    let now: Vec<f64> = (0..d).map(|c| xi[c] + u[j * d + c] - u[i * d + c]).collect();
    let norm = |x: &[f64]| x.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
    let along: f64 = n.iter().zip(&xi).map(|(n, x)| n * x).sum::<f64>() / norm(&xi);
    [along * along, norm(&now) / norm(&xi) - 1.0]
}

/// A displacement that pulls along x, more from time to time, with a wave across.
fn pulled(body: &Body, size: f64) -> Vec<f64> {
    let d = body.dimension();
    let place = |point: usize| body.position(point).to_vec();
    let all = (0..body.n_points()).flat_map(|point| {
        let x = place(point);
        let wave = 0.2 * libm::sin(3.0 * x[1] + x[0]);
        (0..d).map(move |axis| size * if axis == 0 { x[0] } else { wave - 0.3 * x[axis] })
    });
    all.collect()
}

#[test]
fn bonds_yield_and_break_by_their_direction() {
    for (body, horizon) in bodies() {
        let d = body.dimension();
        let neighborhood = Neighborhood::new(&body, horizon).unwrap();
        let ends: Vec<[usize; 2]> =
            (0..neighborhood.n_bonds()).map(|bond| neighborhood.ends(bond)).collect();
        for level in [Level::Fast, Level::Strict] {
            let energy = remembering((&body, horizon), &text(d), &[], level);
            let (mut states, mut broken) = (vec![0.0; ends.len()], vec![false; ends.len()]);
            for size in [0.01, 0.06, 0.03, 0.11, -0.04, 0.18] {
                let u = pulled(&body, size);
                energy.advance(&u, 0.0, (0.0, &u)).unwrap();
                for (bond, ends) in ends.iter().enumerate() {
                    let [c, s] = of_bond(&body, *ends, &u);
                    let (p, limit) = (states[bond], YIELD * (1.0 + 3.0 * c));
                    broken[bond] |= s > BREAK * (2.0 - c);
                    if (s - p).abs() > limit {
                        states[bond] = s - (s - p).signum() * limit;
                    }
                }
                let found: Vec<usize> = energy.broken();
                let expected: Vec<usize> = (0..ends.len()).filter(|bond| broken[*bond]).collect();
                assert_eq!(found, expected, "{d} {size}");
                let own = energy.states();
                let whole = (0..ends.len()).filter(|bond| !broken[*bond]);
                let error = whole.map(|bond| (own[bond] - states[bond]).abs()).fold(0.0, f64::max);
                assert!(error < 1e-14, "{d} {size} {error:e}");
                let mut forces = vec![0.0; u.len()];
                energy.forces(&u, &mut forces).unwrap();
                let expected = by_hand(&body, &ends, &u, (&states, &broken));
                let error = off(&forces, &expected, largest(&expected));
                assert!(error < 1e-11, "{d} {size} {error:e}");
            }
            let n_broken = broken.iter().filter(|is_broken| **is_broken).count();
            assert!(n_broken > 0 && n_broken < ends.len() / 2, "{n_broken} of {}", ends.len());
        }
    }
}

/// Forces at these states of the bonds that are left.
fn by_hand(
    body: &Body,
    ends: &[[usize; 2]],
    u: &[f64],
    (states, broken): (&[f64], &[bool]),
) -> Vec<f64> {
    let d = body.dimension();
    let mut forces = vec![0.0; u.len()];
    for (bond, &[i, j]) in ends.iter().enumerate().filter(|(bond, _)| !broken[*bond]) {
        let [c, s] = of_bond(body, [i, j], u);
        let weight = body.volumes()[i] * body.volumes()[j];
        let pull = weight * (1.0 + 4.0 * c * c) * (s - states[bond]);
        let (p, q) = (body.position(i), body.position(j));
        let now: Vec<f64> = (0..d).map(|c| q[c] - p[c] + u[j * d + c] - u[i * d + c]).collect();
        let length = now.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        for axis in 0..d {
            forces[j * d + axis] += pull * now[axis] / length;
            forces[i * d + axis] -= pull * now[axis] / length;
        }
    }
    forces
}

/// At load steps energies follow what comes to be remembered: their tangents are symmetric, and derivatives.
#[test]
fn tangents_at_load_steps_are_derivatives() {
    for (body, horizon) in bodies() {
        let text = text(body.dimension());
        let energy = remembering_as((&body, horizon), &text, &[], (Level::Fast, true));
        let u = pulled(&body, 0.05);
        energy.follow(Some(1.0));
        tangents_are_derivatives(&energy, &u, 0.5 * horizon, "directed");
    }
}
