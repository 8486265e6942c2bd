//! What the tests of the three measures share.

use num_dual::{DualNum, HyperDual64};

use super::{Geometry, packed};

/// Reproducible pseudo-random integers in -99..=99 whose vectors are far from flat.
pub(crate) fn int_vectors<const C: usize>(count: usize) -> Vec<[f64; C]> {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) % 199) as f64 - 99.0
    };
    let mut all = Vec::new();
    while all.len() < count {
        let vectors: [f64; C] = std::array::from_fn(|_| next());
        if is_solid(&vectors) {
            all.push(vectors);
        }
    }
    all
}

/// Whether a clique with these vectors is worth a test: not degenerate.
fn is_solid(x: &[f64]) -> bool {
    match x.len() {
        4 => (x[0] * x[3] - x[1] * x[2]).abs() > 10.0,
        9 => {
            let c0 = x[4] * x[8] - x[5] * x[7];
            let c1 = x[5] * x[6] - x[3] * x[8];
            let c2 = x[3] * x[7] - x[4] * x[6];
            (x[0] * c0 + x[1] * c1 + x[2] * c2).abs() > 1e4
        }
        6 => {
            let c0 = x[1] * x[5] - x[2] * x[4];
            let c1 = x[2] * x[3] - x[0] * x[5];
            c0 * c0 + c1 * c1 > 1e4
        }
        _ => x.iter().any(|x| *x != 0.0),
    }
}

/// Compares measure, gradient and Hessian with hyper-dual derivatives of the plain formula, which
/// receives the current vectors and `dm/ds` where that is constant.
pub(crate) fn check_derivatives<G: Geometry<C>, const C: usize>(
    plain: impl Fn(&[HyperDual64; C], f64) -> HyperDual64,
) {
    let all = int_vectors::<C>(80);
    for pair in all.chunks_exact(2) {
        let reference = pair[0];
        let displacement = pair[1].map(|x| 0.003 * x);
        let current: [f64; C] = std::array::from_fn(|k| reference[k] + displacement[k]);
        let found = G::change(&reference, &displacement);
        // psi = m and psi = m^2/2 tell gradient and Hessian apart.
        for (first, second) in [(1.0, 0.0), (found.measure, 1.0)] {
            let energy = |x: &[HyperDual64; C]| {
                let measure = plain(x, found.slope);
                if second == 0.0 { measure } else { measure.powi(2) * 0.5 }
            };
            let (ds, d2s) = G::VARIABLE.slopes(found.measure, found.slope, first, second);
            let gradient = G::gradient(&current);
            let mut hessian = vec![f64::NAN; packed(C, C - 1, C - 1) + 1];
            G::hessian(&current, &gradient, ds, d2s, |k, x| hessian[k] = x);
            compare(&current, &energy, |row| ds * gradient[row], &hessian);
        }
        assert!(
            relative(found.measure, plain(&current.map(HyperDual64::from_re), found.slope).re)
                < 1e-13
        );
        let rest = plain(&reference.map(HyperDual64::from_re), found.slope).re;
        assert!(rest > 0.0 && relative(found.reference, rest) < 1e-13);
        assert!((found.change - (found.measure - rest) / rest).abs() < 1e-11);
    }
}

fn compare<const C: usize>(
    current: &[f64; C],
    energy: &dyn Fn(&[HyperDual64; C]) -> HyperDual64,
    gradient: impl Fn(usize) -> f64,
    hessian: &[f64],
) {
    let mut pairs = Vec::new();
    for row in 0..C {
        for column in row..C {
            let mut x = current.map(HyperDual64::from_re);
            x[row] = x[row].derivative1();
            x[column] = x[column].derivative2();
            let value = energy(&x);
            pairs.push((hessian[packed(C, row, column)], value.eps1eps2));
            if row == column {
                assert!(relative(gradient(row), value.eps1) < 1e-9, "gradient {row}");
            }
        }
    }
    let norm = pairs.iter().map(|(_, exact)| exact * exact).sum::<f64>().sqrt();
    for (found, exact) in pairs {
        assert!((found - exact).abs() <= 1e-12 * norm, "{found} {exact}");
    }
}

fn relative(found: f64, exact: f64) -> f64 {
    (found - exact).abs() / exact.abs().max(1e-3)
}
