//! Derivatives by dual numbers, compiled for each energy.
//!
//! Of what num-dual offers, one pass of `Dual64` or `HyperDual64` per component over eight tensors was
//! the fastest: for St Venant-Kirchhoff material 22 ns for a stress and 59 ns for its change. One tensor
//! after the other takes 88 and 208 ns, all components in one pass of vector duals 263 ns
//! (`DualSVec64<9>`) and 914 ns (`HyperDualSVec64<9, 1>`; `DualSVec<Dual64, 9>` 1109 ns): these ask at
//! every operation whether they carry any derivatives.

use std::marker::PhantomData;

use num_dual::{Dual64, DualNum, HyperDual64};

use super::{Channel, LAMBDA, LANES, MU, Material, NO_TENSORS, Tensors};

/// An energy of `F` over any numbers.
pub(crate) trait Energy {
    fn psi<T: DualNum<Primitive = f64> + Copy>(f: &[[T; 3]; 3]) -> T;
}

pub(crate) struct StVenantKirchhoff;

/// `lambda/2 tr(E)^2 + mu E:E`. Written out for the six components: as a loop over nine no compiler
/// takes eight lanes at once.
impl Energy for StVenantKirchhoff {
    #[inline(always)]
    fn psi<T: DualNum<Primitive = f64> + Copy>([p, q, r]: &[[T; 3]; 3]) -> T {
        let xx = (p[0] * p[0] + q[0] * q[0] + r[0] * r[0] - 1.0) * 0.5;
        let yy = (p[1] * p[1] + q[1] * q[1] + r[1] * r[1] - 1.0) * 0.5;
        let zz = (p[2] * p[2] + q[2] * q[2] + r[2] * r[2] - 1.0) * 0.5;
        // Twice the strains.
        let xy = p[0] * p[1] + q[0] * q[1] + r[0] * r[1];
        let xz = p[0] * p[2] + q[0] * q[2] + r[0] * r[2];
        let yz = p[1] * p[2] + q[1] * q[2] + r[1] * r[2];
        let (trace, mixed) = (xx + yy + zz, (xy * xy + xz * xz + yz * yz) * 0.5);
        trace * trace * (0.5 * LAMBDA) + (xx * xx + yy * yy + zz * zz + mixed) * MU
    }
}

pub(crate) struct NeoHooke;

/// `mu/2 (tr(C) - 3 - 2 ln J) + lambda/2 (ln J)^2`.
impl Energy for NeoHooke {
    #[inline(always)]
    fn psi<T: DualNum<Primitive = f64> + Copy>([p, q, r]: &[[T; 3]; 3]) -> T {
        let x = q[1] * r[2] - q[2] * r[1];
        let y = q[2] * r[0] - q[0] * r[2];
        let z = q[0] * r[1] - q[1] * r[0];
        let ln = (p[0] * x + p[1] * y + p[2] * z).ln();
        let [pp, qq, rr] = [p, q, r].map(|row| row[0] * row[0] + row[1] * row[1] + row[2] * row[2]);
        (pp + qq + rr - 3.0 - ln * 2.0) * (0.5 * MU) + ln * ln * (0.5 * LAMBDA)
    }
}

/// The material of an energy.
pub(crate) struct ByNumbers<E>(PhantomData<E>);

impl<E: Energy> Material for ByNumbers<E> {
    #[inline(always)]
    fn stress(f: &Tensors) -> (Channel, Tensors) {
        let (mut psi, mut out) = ([0.0; LANES], NO_TENSORS);
        for place in 0..9 {
            let (mut seed, f) = ([[0.0; 3]; 3], *f);
            seed[place / 3][place % 3] = 1.0;
            let (mut value, mut passed) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                let mut dual = [[Dual64::from_re(0.0); 3]; 3];
                for r in 0..3 {
                    for c in 0..3 {
                        dual[r][c] = Dual64::new(f[r][c][lane], seed[r][c]);
                    }
                }
                let energy = E::psi(&dual);
                value[lane] = energy.re;
                passed[lane] = energy.eps;
            }
            psi = value;
            out[place / 3][place % 3] = passed;
        }
        (psi, out)
    }

    #[inline(always)]
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors {
        let mut out = NO_TENSORS;
        for place in 0..9 {
            let (mut seed, f, df) = ([[0.0; 3]; 3], *f, *df);
            seed[place / 3][place % 3] = 1.0;
            let mut passed = [0.0; LANES];
            for lane in 0..LANES {
                let mut dual = [[HyperDual64::from_re(0.0); 3]; 3];
                for r in 0..3 {
                    for c in 0..3 {
                        let (f, df) = (f[r][c][lane], df[r][c][lane]);
                        dual[r][c] = HyperDual64::new(f, seed[r][c], df, 0.0);
                    }
                }
                passed[lane] = E::psi(&dual).eps1eps2;
            }
            out[place / 3][place % 3] = passed;
        }
        out
    }
}
