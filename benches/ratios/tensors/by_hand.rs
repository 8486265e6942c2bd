//! Derivatives by hand, in F as in a book.

use super::{Channel, LAMBDA, LANES, MU, Material, NO_TENSORS, Tensor, Tensors, lane_of, set_lane};

pub(crate) struct StVenantKirchhoff;

impl Material for StVenantKirchhoff {
    #[inline(always)]
    fn stress(f: &Tensors) -> (Channel, Tensors) {
        stresses(f, svk)
    }

    #[inline(always)]
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors {
        changes(f, df, svk_product)
    }
}

pub(crate) struct NeoHooke;

impl Material for NeoHooke {
    #[inline(always)]
    fn stress(f: &Tensors) -> (Channel, Tensors) {
        stresses(f, neo_hooke)
    }

    #[inline(always)]
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors {
        changes(f, df, neo_hooke_product)
    }
}

/// Lane by lane.
#[inline(always)]
fn stresses(f: &Tensors, stress: impl Fn(&Tensor) -> (f64, Tensor)) -> (Channel, Tensors) {
    let (mut psi, mut out) = ([0.0; LANES], NO_TENSORS);
    for lane in 0..LANES {
        let (energy, stress) = stress(&lane_of(f, lane));
        psi[lane] = energy;
        set_lane(&mut out, lane, &stress);
    }
    (psi, out)
}

/// Lane by lane.
#[inline(always)]
fn changes(f: &Tensors, df: &Tensors, change: impl Fn(&Tensor, &Tensor) -> Tensor) -> Tensors {
    let mut out = NO_TENSORS;
    for lane in 0..LANES {
        set_lane(&mut out, lane, &change(&lane_of(f, lane), &lane_of(df, lane)));
    }
    out
}

#[inline(always)]
fn each(f: impl Fn(usize, usize) -> f64) -> Tensor {
    let mut tensor = [[0.0; 3]; 3];
    for (r, row) in tensor.iter_mut().enumerate() {
        for (c, x) in row.iter_mut().enumerate() {
            *x = f(r, c);
        }
    }
    tensor
}

#[inline(always)]
fn times(a: &Tensor, b: &Tensor) -> Tensor {
    each(|r, c| a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c])
}

#[inline(always)]
fn transposed(a: &Tensor) -> Tensor {
    each(|r, c| a[c][r])
}

#[inline(always)]
fn trace(a: &Tensor) -> f64 {
    a[0][0] + a[1][1] + a[2][2]
}

#[inline(always)]
fn dot(a: &Tensor, b: &Tensor) -> f64 {
    (0..9).map(|k| a[k / 3][k % 3] * b[k / 3][k % 3]).sum()
}

#[inline(always)]
fn unit(r: usize, c: usize) -> f64 {
    if r == c { 1.0 } else { 0.0 }
}

#[inline(always)]
fn second_stress(e: &Tensor) -> Tensor {
    let trace = trace(e);
    each(|r, c| LAMBDA * trace * unit(r, c) + 2.0 * MU * e[r][c])
}

#[inline(always)]
fn svk(f: &Tensor) -> (f64, Tensor) {
    let c = times(&transposed(f), f);
    let e = each(|r, k| 0.5 * (c[r][k] - unit(r, k)));
    let energy = 0.5 * LAMBDA * trace(&e) * trace(&e) + MU * dot(&e, &e);
    (energy, times(f, &second_stress(&e)))
}

#[inline(always)]
fn svk_product(f: &Tensor, df: &Tensor) -> Tensor {
    let c = times(&transposed(f), f);
    let e = each(|r, k| 0.5 * (c[r][k] - unit(r, k)));
    let mixed = times(&transposed(f), df);
    let de = each(|r, k| 0.5 * (mixed[r][k] + mixed[k][r]));
    let (first, second) = (times(df, &second_stress(&e)), times(f, &second_stress(&de)));
    each(|r, k| first[r][k] + second[r][k])
}

/// `F^-T` and the determinant.
#[inline(always)]
fn inverse_transposed(f: &Tensor) -> (Tensor, f64) {
    let cofactor = each(|r, c| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        f[r1][c1] * f[r2][c2] - f[r1][c2] * f[r2][c1]
    });
    let j = f[0][0] * cofactor[0][0] + f[0][1] * cofactor[0][1] + f[0][2] * cofactor[0][2];
    (each(|r, c| cofactor[r][c] / j), j)
}

#[inline(always)]
fn neo_hooke(f: &Tensor) -> (f64, Tensor) {
    let (g, j) = inverse_transposed(f);
    let ln = libm::log(j);
    let energy = 0.5 * MU * (dot(f, f) - 3.0 - 2.0 * ln) + 0.5 * LAMBDA * ln * ln;
    (energy, each(|r, c| MU * f[r][c] + (LAMBDA * ln - MU) * g[r][c]))
}

#[inline(always)]
fn neo_hooke_product(f: &Tensor, df: &Tensor) -> Tensor {
    let (g, j) = inverse_transposed(f);
    let ln = libm::log(j);
    let along = dot(&g, df);
    let turned = times(&times(&g, &transposed(df)), &g);
    let a = LAMBDA * ln - MU;
    each(|r, c| MU * df[r][c] + LAMBDA * along * g[r][c] - a * turned[r][c])
}
