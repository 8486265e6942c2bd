//! Bonds that follow what they come to remember, as load steps ask: against the same bodies whose bonds hold
//! what they remember, and against differences of forces.

use piola_compiler::Level;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::Fracture;

use crate::cloud;
use crate::families::{largest, reference};
use crate::states::{BILINEAR, EXPONENTIAL, MICRO_PLASTIC, remembering, remembering_as};

/// Forgets with time: what bonds remember depends on the step.
const RELAXING: &str = "potential relaxing
parameter c
parameter tau
state p = 0
s = l/L - 1
update p = (p + dt/tau*s)/(1 + dt/tau)
psi(l) = 1/2*c*L*(s - p)^2";

/// A displacement that stretches some bonds beyond 0.01 and some not.
fn displacements(n: usize, scale: f64) -> Vec<f64> {
    (0..n).map(|k| scale * libm::sin(1.7 * k as f64 + 0.3)).collect()
}

fn forces(energy: &dyn Energy, u: &[f64]) -> Vec<f64> {
    let mut forces = vec![0.0; u.len()];
    energy.forces(u, &mut forces).unwrap();
    forces
}

fn off(found: &[f64], expected: &[f64]) -> f64 {
    let differences: Vec<f64> = found.iter().zip(expected).map(|(x, y)| x - y).collect();
    largest(&differences) / largest(expected)
}

#[test]
fn forces_and_tangents_are_those_of_what_bonds_come_to_remember() {
    let file = reference("damage_small.json");
    let names = [&file["micro_plastic_cloud"][0]["cloud"], &file["softening_cloud"][0]["cloud"]];
    let laws = [
        (MICRO_PLASTIC, [("c", 3.0), ("sY", 0.01)].to_vec(), 0),
        (BILINEAR, vec![("c", 3.0), ("s0", 0.01), ("sc", 0.08)], 1),
        (EXPONENTIAL, vec![("c", 3.0), ("s0", 0.01), ("sf", 0.03)], 1),
        (RELAXING, vec![("c", 3.0), ("tau", 2.0)], 0),
    ];
    for (text, parameters, place) in laws {
        let (body, horizon) = cloud(&file, names[place]);
        let n = body.positions().len();
        let spacing = horizon / 3.0;
        for level in [Level::Fast, Level::Strict] {
            let of =
                |follows| remembering_as((&body, horizon), text, &parameters, (level, follows));
            let (steps, held) = (of(true), remembering((&body, horizon), text, &parameters, level));
            let (first, second) =
                (displacements(n, 0.02 * spacing), displacements(n, 0.035 * spacing));
            for energy in [&steps, &held] {
                energy.advance(&first, 0.5, (0.0, &first)).unwrap();
            }
            // Held they are one energy, to the last bit.
            assert_eq!(forces(&steps, &second), forces(&held, &second), "{text}");
            steps.follow(Some(0.25));
            let (states, following) = (steps.states(), forces(&steps, &second));
            assert!(off(&following, &forces(&held, &second)) > 1e-3, "{text}");
            held.advance(&second, 0.25, (0.0, &second)).unwrap();
            let error = off(&following, &forces(&held, &second));
            assert!(error < 1e-13, "{text} {error:e}");
            tangents_are_derivatives(&steps, &second, spacing, text);
            let release = steps.evolve([&first, &second], 0.25).unwrap();
            assert!(release.changed > 0 && release.dissipated > 0.0, "{text} {release:?}");
            assert_eq!(forces(&steps, &second), forces(&held, &second), "{text}");
            let bits = |states: Vec<f64>| states.into_iter().map(f64::to_bits).collect::<Vec<_>>();
            assert_eq!(bits(steps.states()), bits(held.states()), "{text}");
            steps.remember(&states);
            steps.follow(Some(0.25));
            assert_eq!(forces(&steps, &second), following, "{text}");
        }
    }
}

/// Products with two directions are symmetric, and the differences of forces along them.
pub(crate) fn tangents_are_derivatives(energy: &dyn Energy, u: &[f64], spacing: f64, text: &str) {
    let n = u.len();
    let [p, q] = [0.7, 2.9].map(|w| (0..n).map(|k| libm::cos(w * k as f64)).collect::<Vec<_>>());
    let hessian = energy.hessian(u).unwrap();
    let [mut of_p, mut of_q] = [(); 2].map(|()| vec![0.0; n]);
    hessian.multiply(&p, &mut of_p);
    hessian.multiply(&q, &mut of_q);
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let scale = largest(&of_p) * n as f64;
    assert!((dot(&q, &of_p) - dot(&p, &of_q)).abs() < 1e-13 * scale, "{text}");
    let h = 1e-7 * spacing;
    let at = |sign: f64| -> Vec<f64> {
        let u: Vec<f64> = u.iter().zip(&p).map(|(u, p)| u + sign * h * p).collect();
        forces(energy, &u)
    };
    let (after, before) = (at(1.0), at(-1.0));
    let difference: Vec<f64> =
        after.iter().zip(&before).map(|(x, y)| (x - y) / (2.0 * h)).collect();
    let error = off(&difference, &of_p);
    assert!(error < 1e-6, "{text} {error:e}");
}
