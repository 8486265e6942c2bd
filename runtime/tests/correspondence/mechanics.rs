//! Momentum, angular momentum, frame indifference.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::Energy;

use crate::common::{DISCRETISATIONS, ORDERS, cloud, displacements, energy, error, h_of, largest};

const WAN: Discretisation = Discretisation::Stabilised(Stabilisation::Wan);

/// A rotation: about the z axis, then, in space, about the x axis.
fn rotation(d: usize) -> Vec<f64> {
    let (s, c) = (libm::sin(0.7), libm::cos(0.7));
    if d == 2 {
        return vec![c, -s, s, c];
    }
    let (t, e) = (libm::sin(-1.1), libm::cos(-1.1));
    vec![c, -s, 0.0, s * e, c * e, -t, s * t, c * t, e]
}

fn rotated(d: usize, x: &[f64]) -> Vec<f64> {
    let q = rotation(d);
    let row = |x: &[f64], r: usize| (0..d).map(|c| q[r * d + c] * x[c]).sum::<f64>();
    x.chunks_exact(d).flat_map(|x| (0..d).map(|r| row(x, r)).collect::<Vec<f64>>()).collect()
}

#[test]
fn forces_sum_to_zero_and_turn_nothing() {
    for counts in [&[7, 6][..], &[5, 4, 4]] {
        let d = counts.len();
        let body = cloud(counts, 3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        for order in ORDERS {
            for discretisation in DISCRETISATIONS {
                let energy = energy(&body, 3.0, order, discretisation, "cubic");
                let mut f = vec![0.0; u.len()];
                energy.forces(&u, &mut f).unwrap();
                let x: Vec<f64> = u.iter().zip(body.positions()).map(|(u, x)| x + u).collect();
                let sum: Vec<f64> =
                    (0..d).map(|r| f.iter().skip(r).step_by(d).sum::<f64>()).collect();
                assert!(largest(&sum) < 1.2e-14 * largest(&f), "{order:?} {discretisation:?}");
                let turn = |r: usize, s: usize| -> f64 {
                    let points = x.chunks_exact(d).zip(f.chunks_exact(d));
                    points.map(|(x, f)| x[r] * f[s] - x[s] * f[r]).sum()
                };
                let turns: Vec<f64> = (0..d)
                    .flat_map(|r| (0..r).map(move |s| (r, s)))
                    .map(|(r, s)| turn(r, s))
                    .collect();
                let scale = largest(&f) * largest(&x);
                let part = largest(&turns) / scale;
                // Wan's stiffness does not rotate with the body.
                if discretisation == WAN {
                    assert!(part > 1e-6, "{order:?}: {part:e}");
                } else {
                    assert!(part < 8e-15, "{order:?} {discretisation:?}: {part:e}");
                }
            }
        }
    }
}

#[test]
fn energies_do_not_see_rotations_but_for_wans_stabilisation() {
    for counts in [&[7, 6][..], &[5, 4, 4]] {
        let d = counts.len();
        let body = cloud(counts, 3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        let x: Vec<f64> = u.iter().zip(body.positions()).map(|(u, x)| x + u).collect();
        let turned: Vec<f64> =
            rotated(d, &x).iter().zip(body.positions()).map(|(x, rest)| x - rest).collect();
        for order in ORDERS {
            for discretisation in DISCRETISATIONS {
                let energy = energy(&body, 3.0, order, discretisation, "cubic");
                let (mut f, mut g) = (vec![0.0; u.len()], vec![0.0; u.len()]);
                let before = energy.forces(&u, &mut f).unwrap();
                let after = energy.forces(&turned, &mut g).unwrap();
                let change = (after.total() / before.total() - 1.0).abs();
                let forces = error(&g, &rotated(d, &f));
                if discretisation == WAN {
                    let part = after.of("stabilisation") / before.of("stabilisation") - 1.0;
                    println!("{d} {order:?}: energy {part:+.1e}, forces {forces:.1e}");
                    assert!(change > 1e-6 && forces > 1e-4, "{order:?}: {change:e} {forces:e}");
                } else {
                    assert!(
                        change < 1.5e-14 && forces < 6e-14,
                        "{discretisation:?}: {change:e} {forces:e}"
                    );
                }
            }
        }
    }
}

/// Issue of clouds with very different points: forces of volumes over six decades.
#[test]
fn volumes_over_six_decades_keep_the_balance_of_forces() {
    let lattice = cloud(&[5, 5, 5], 9);
    let volumes: Vec<f64> =
        (0..lattice.n_points()).map(|k| if k % 7 == 0 { 1e-6 } else { 1.0 }).collect();
    let body = Arc::new(Body::new(3, lattice.positions(), &volumes, None));
    let u = displacements(&body, &h_of(3), 0.05, 5);
    for discretisation in DISCRETISATIONS {
        let energy = energy(&body, 2.8, OperatorOrder::First, discretisation, "cubic");
        let mut f = vec![0.0; u.len()];
        energy.forces(&u, &mut f).unwrap();
        for r in 0..3 {
            let component = || f.iter().skip(r).step_by(3);
            let (sum, size): (f64, f64) = (component().sum(), component().map(|f| f.abs()).sum());
            assert!(sum.abs() <= 8.0 * f64::EPSILON / 2.0 * size, "{discretisation:?} {sum:e}");
        }
    }
}
