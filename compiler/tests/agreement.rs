//! Every potential of the library at random points of its domain: machine code gives the
//! interpreter's bits, and both agree with two kinds of dual numbers of the energy as written.

#[path = "support/library.rs"]
mod library;

use library::cases;
use num_dual::Dual2_64;
use piola_compiler::verify::{Columns, Subject, sample, verify};
use piola_compiler::{Batch, Derivatives, Form, Level, Mode, Order};

/// Half the distance from 1 to the next number.
const U: f64 = f64::EPSILON / 2.0;

/// Points far from rest, and as many near it, for each energy.
const POINTS: usize = 500;

#[test]
fn every_energy_agrees_with_hyperdual_numbers_of_what_was_written() {
    let (mut n_energies, mut n_points, mut worst) = (0, 0, 0.0_f64);
    for case in cases() {
        let (found, _) = verify(&case.model, &case.values, POINTS).unwrap();
        assert!(!found.is_empty(), "{}: nothing is modelled", case.name);
        for energy in found {
            // True values of several measures take long: there are fewer. Of dissipations rates go by decades.
            let has_few = matches!(energy.subject, Subject::Coupled(..) | Subject::Dissipation(_));
            let least = if has_few { POINTS / 4 } else { POINTS / 2 };
            assert!(energy.n_places > least, "{}: {} points", case.name, energy.n_places);
            assert!(energy.different_bits == 0, "{}: {:?}", case.name, energy.different_bits);
            let misses = &energy.misses[..energy.misses.len().min(3)];
            let ratio = energy.over_tolerance().into_iter().fold(0.0, f64::max);
            assert!(misses.is_empty(), "{}: {:?} {misses:#?}", case.name, energy.errors);
            worst = worst.max(ratio);
            n_energies += 1;
            n_points += energy.n_places;
        }
    }
    println!("{n_energies} energies at {n_points} points; largest error over tolerance {worst:.2}");
    assert!(n_energies > 100, "{n_energies}");
}

/// What is asked for has the same bits whatever else is; what is not asked for is left alone.
#[test]
fn every_order_gives_the_same_bits() {
    for case in cases() {
        let variant = case.model.variant(case.values.dimension).unwrap();
        for kernel in case
            .model
            .compile(&case.values, Mode::Jit(Level::Strict), Form::Accurate)
            .unwrap()
            .kernels
        {
            let points = sample::points(variant, kernel.measure(), &case.values, 20);
            let columns = Columns::new(&points);
            let all = kernel.derivatives(columns.batch());
            let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            for order in Order::ALL {
                let mut out = Derivatives::zeros(points.len());
                kernel.evaluate(columns.batch(), order, out.outputs());
                let [psi, dpsi, d2psi] = [&out.psi, &out.dpsi, &out.d2psi].map(|x| bits(x));
                let none = vec![0; points.len()];
                let asked = |which, values: &[f64]| {
                    if order.wanted().contains(&which) { bits(values) } else { none.clone() }
                };
                assert_eq!(psi, asked(0, &all.psi), "{}, {order:?}", case.name);
                assert_eq!(dpsi, asked(1, &all.dpsi), "{}, {order:?}", case.name);
                assert_eq!(d2psi, asked(2, &all.d2psi), "{}, {order:?}", case.name);
            }
        }
    }
}

/// `Dual2_64` carries value, first and second derivative by rules of their own.
#[test]
fn second_order_duals_agree_too() {
    let mut worst = (0.0_f64, String::new());
    for case in cases() {
        let compiled =
            case.model.compile(&case.values, Mode::Jit(Level::Strict), Form::Accurate).unwrap();
        let variant = case.model.variant(case.values.dimension).unwrap();
        for kernel in &compiled.kernels {
            let measure = kernel.measure();
            let points = sample::points(variant, measure, &case.values, POINTS);
            let out = kernel.derivatives(Columns::new(&points).batch());
            let written = case.model.written(&case.values, measure);
            for (i, point) in points.iter().enumerate() {
                let varied = Dual2_64::new(point.measure, 1.0, 0.0);
                let dual = written.evaluate(varied, Dual2_64::from_re(point.reference));
                let expected = [dual.re, dual.v1, dual.v2];
                let found = [out.psi[i], out.dpsi[i], out.d2psi[i]];
                let m = point.measure.abs();
                let size = |order: usize| expected[order].abs().max(found[order].abs());
                let scales = [size(0), size(1) + size(0) / m, size(2) + size(1) / m];
                let relative = tolerance(point.change());
                for order in 0..3 {
                    if !expected[order].is_finite() && !found[order].is_finite() {
                        continue;
                    }
                    let allowed = relative * scales[order] + f64::MIN_POSITIVE;
                    let error = (found[order] - expected[order]).abs();
                    let ratio = if relative.is_infinite() { 0.0 } else { error / allowed };
                    assert!(
                        ratio <= 1.0,
                        "{}: {point:?}, order {order}: {} {}",
                        case.name,
                        found[order],
                        expected[order]
                    );
                    if ratio > worst.0 {
                        worst = (ratio, case.name.clone());
                    }
                }
            }
        }
    }
    println!("largest error over tolerance {:.2} ({})", worst.0, worst.1);
    // Had they been computed alike, nothing would have been compared.
    assert!(worst.0 > 1e-3, "{worst:?}");
}

/// `1e-14` and what `(l/L)^n - 1` as written loses near rest; for even `n` it loses as much where a
/// tetrahedron is turned inside out, at `v = -V`.
fn tolerance(change: f64) -> f64 {
    1e-14 + 8.0 * U / change.abs() + 8.0 * U / (change + 2.0).abs()
}

/// Kernels work on two entries at a time; what they give does not depend on how many there are, and
/// nothing is written beyond them.
#[test]
fn batches_of_every_length_give_the_same_bits() {
    const ROOM: usize = 12;
    for case in cases().into_iter().step_by(5) {
        let variant = case.model.variant(case.values.dimension).unwrap();
        for level in Level::ALL {
            for kernel in
                case.model.compile(&case.values, Mode::Jit(level), Form::Accurate).unwrap().kernels
            {
                let points = sample::points(variant, kernel.measure(), &case.values, ROOM);
                let columns = Columns::new(&points);
                let all = columns.batch();
                let expected = kernel.derivatives(all);
                for length in 0..points.len().min(ROOM) {
                    for order in Order::ALL {
                        let batch = Batch {
                            measure: &all.measure[..length],
                            reference: &all.reference[..length],
                            change: &all.change[..length],
                            fields: &[],
                        };
                        let mut out = Derivatives::zeros(ROOM);
                        kernel.evaluate(batch, order, out.outputs());
                        let columns = [&out.psi, &out.dpsi, &out.d2psi];
                        let expected = [&expected.psi, &expected.dpsi, &expected.d2psi];
                        for (k, (found, expected)) in columns.into_iter().zip(expected).enumerate()
                        {
                            let asked = if order.wanted().contains(&k) { length } else { 0 };
                            let bits =
                                |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                            assert_eq!(bits(&found[..asked]), bits(&expected[..asked]));
                            assert!(found[asked..].iter().all(|x| *x == 0.0), "{}", case.name);
                        }
                    }
                }
            }
        }
    }
}
