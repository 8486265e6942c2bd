//! The papers' way, as fast as the compiler can make it: textbook energies over hyper-dual numbers,
//! one pass per entry of the compact tangent.

use num_dual::{DualNum, HyperDual64};

/// A strain as a function of the stretch.
pub(crate) trait Strain {
    /// Its exponent; 0 is the logarithm.
    const N: f64;
    /// `S(x)`.
    fn of(x: HyperDual64) -> HyperDual64;
}

macro_rules! strain {
    ($name:ident, $n:literal, $x:ident => $formula:expr) => {
        pub(crate) struct $name;
        impl Strain for $name {
            const N: f64 = $n;
            #[inline(always)]
            fn of($x: HyperDual64) -> HyperDual64 {
                $formula
            }
        }
    };
}
strain!(Linear, 1.0, x => x - 1.0);
strain!(Quadratic, 2.0, x => (x * x - 1.0) / 2.0);
strain!(Power, 2.7, x => (DualNum::powf(&x, 2.7) - 1.0) / 2.7);
strain!(Logarithm, 0.0, x => DualNum::ln(&x));

/// Energy with compact gradient and tangent.
pub(crate) struct Result<const C: usize> {
    pub(crate) energy: f64,
    pub(crate) gradient: [f64; C],
    /// Entries `[row][column]` with `column <= row`.
    pub(crate) tangent: [[f64; C]; C],
}

/// `weight/2 M S(m/M)^2` and its derivatives in the `C` components of the relative vectors.
#[inline(never)]
pub(crate) fn evaluate<S: Strain, const C: usize>(
    x: &[f64; C],
    reference: f64,
    weight: f64,
    out: &mut Result<C>,
) {
    let (inverse, scale) = (1.0 / reference, 0.5 * weight * reference.abs());
    let mut dual = [HyperDual64::from_re(0.0); C];
    for c in 0..C {
        dual[c].re = x[c];
    }
    for row in 0..C {
        dual[row].eps1 = 1.0;
        for column in 0..=row {
            dual[column].eps2 = 1.0;
            let strain = S::of(measure(&dual) * inverse);
            dual[column].eps2 = 0.0;
            let energy = strain * strain * scale;
            out.tangent[row][column] = energy.eps1eps2;
            if row == column {
                out.gradient[row] = energy.eps1;
                out.energy = energy.re;
            }
        }
        dual[row].eps1 = 0.0;
    }
}

/// `|xi|`, `|xi1 x xi2|` or `xi1.(xi2 x xi3)` (javili2020, Eq. (20)).
#[inline(always)]
pub(crate) fn measure<const C: usize>(x: &[HyperDual64; C]) -> HyperDual64 {
    match C {
        3 => (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt(),
        6 => {
            let c = cross(x, 0, 3);
            (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt()
        }
        _ => {
            let c = cross(x, 3, 6);
            x[0] * c[0] + x[1] * c[1] + x[2] * c[2]
        }
    }
}

#[inline(always)]
fn cross(x: &[HyperDual64], p: usize, q: usize) -> [HyperDual64; 3] {
    [
        x[p + 1] * x[q + 2] - x[p + 2] * x[q + 1],
        x[p + 2] * x[q] - x[p] * x[q + 2],
        x[p] * x[q + 1] - x[p + 1] * x[q],
    ]
}
