//! A wave packet in a bar against the dispersion relation of its lattice.

use std::f64::consts::PI;

use crate::examples;
use crate::support::table;

/// Times at which the first displacement of a table changes its sign.
fn crossings(rows: &[Vec<f64>]) -> Vec<f64> {
    let pairs = rows.windows(2).filter(|pair| pair[0][1] * pair[1][1] < 0.0);
    let between = |pair: &[Vec<f64>]| {
        let ((t, u), (later, next)) = ((pair[0][0], pair[0][1]), (pair[1][0], pair[1][1]));
        t + (later - t) * u / (u - next)
    };
    pairs.map(between).collect()
}

/// The points under the middle of the packet swing with the frequency of its wave number: of the
/// lattice, and as the step has it, `sin(omega' dt/2) = omega dt/2`.
#[test]
fn a_packet_swings_with_the_frequency_of_its_lattice() {
    let (modulus, density, h, delta) = (210e9_f64, 7800.0, 1e-3, 3e-3);
    let (k, mut sum) = (1.0, 0.0);
    for p in 1..=3 {
        sum += (1.0 - libm::cos(k * f64::from(p))) / f64::from(p);
    }
    let omega = (4.0 * modulus / (density * delta * delta) * sum).sqrt();
    let local = k / h * (modulus / density).sqrt();
    assert!((omega / local - 0.9021214367).abs() < 1e-9, "the phase speed of the reference");
    for (step, bar) in [(2e-8, 5e-4), (2e-7, 2e-3)] {
        let run = examples::run("wave", &[&format!("motion.step={step}")]);
        let found = crossings(&table(&run.path().join("probes.csv")).1);
        assert!(found.len() > 10, "{found:?}");
        let measured = PI * (found.len() - 1) as f64 / (found[found.len() - 1] - found[0]);
        let expected = 2.0 / step * libm::asin(0.5 * omega * step);
        println!("step {step}: {:e}", measured / expected - 1.0);
        assert!((measured / expected - 1.0).abs() < bar, "{measured:e} {expected:e}");
        assert!((measured / local - 1.0).abs() > 0.02, "a local bar is faster");
    }
}
