//! Numbers modulo a large prime: what rational functions of a few variables are told apart by.

use std::ops::{Add, Mul, Neg};

/// `2^61 - 1`, a Mersenne prime: powers of two are shifts.
const PRIME: u64 = (1 << 61) - 1;

/// At how many random places functions are compared. Two of degree n that differ agree at one with odds
/// of n in 2^61.
pub(super) const PLACES: usize = 3;

/// A number below the prime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Modular(u64);

impl Modular {
    pub(super) const ONE: Modular = Modular(1);

    /// A double is a whole number times a power of two; `None` for what is not finite.
    pub(super) fn of(value: f64) -> Option<Modular> {
        if !value.is_finite() {
            return None;
        }
        let (part, exponent) = libm::frexp(value.abs());
        // 53 bits before the point.
        let whole = Modular((part * 9_007_199_254_740_992.0) as u64);
        let shift = (exponent - 53).rem_euclid(61);
        let number = whole * Modular(1 << shift);
        Some(if value < 0.0 { -number } else { number })
    }

    /// A small whole number.
    pub(super) fn whole(value: i8) -> Modular {
        let size = Modular(u64::from(value.unsigned_abs()));
        if value < 0 { -size } else { size }
    }

    /// A variable at each of the places.
    pub(super) fn places(variable: usize) -> [Modular; PLACES] {
        std::array::from_fn(|place| Modular::random(PLACES * variable + place))
    }

    /// A number that stands for a constant: other constants have others.
    pub(super) fn symbol(constant: usize) -> Modular {
        Modular::random(constant + (1 << 32))
    }

    /// The numbers of splitmix64, which look random.
    fn random(n: usize) -> Modular {
        let mut x = (1 + n as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Modular((x ^ (x >> 31)) % PRIME)
    }

    pub(super) fn number(self) -> u64 {
        self.0
    }

    /// By Fermat's little theorem; 0 has none.
    pub(super) fn reciprocal(self) -> Option<Modular> {
        let (mut power, mut base, mut exponent) = (Modular::ONE, self, PRIME - 2);
        while exponent > 0 {
            if exponent % 2 == 1 {
                power = power * base;
            }
            base = base * base;
            exponent /= 2;
        }
        (self.0 != 0).then_some(power)
    }
}

impl Add for Modular {
    type Output = Modular;
    fn add(self, other: Modular) -> Modular {
        Modular((self.0 + other.0) % PRIME)
    }
}

impl Mul for Modular {
    type Output = Modular;
    fn mul(self, other: Modular) -> Modular {
        let product = u128::from(self.0) * u128::from(other.0);
        // 2^61 is 1.
        let sum = (product as u64 & PRIME) + (product >> 61) as u64;
        Modular(if sum >= PRIME { sum - PRIME } else { sum })
    }
}

impl Neg for Modular {
    type Output = Modular;
    fn neg(self) -> Modular {
        Modular((PRIME - self.0) % PRIME)
    }
}
