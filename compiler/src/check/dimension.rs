//! Physical dimensions: products of powers of metre, kilogram, second and kelvin.

use std::fmt;

/// Exponents are multiples of 1/27720, which is divisible by everything up to 12: roots stay exact.
const DENOMINATOR: i64 = 27720;

/// Largest exponent a unit may have; far beyond any physical one, far below overflow.
const LARGEST_EXPONENT: f64 = 1e6;

/// A physical dimension.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Dimension {
    exponents: [i64; 4],
}

/// The base units in the order of the exponents.
const BASE: [&str; 4] = ["kg", "m", "s", "K"];

impl Dimension {
    /// A pure number.
    pub const NONE: Dimension = Dimension { exponents: [0; 4] };
    /// A length.
    pub const LENGTH: Dimension = Dimension::of(0, 1, 0, 0);
    /// An energy.
    pub const ENERGY: Dimension = Dimension::of(1, 2, -2, 0);

    /// kg^mass m^length s^time K^temperature.
    pub const fn of(mass: i64, length: i64, time: i64, temperature: i64) -> Dimension {
        let d = DENOMINATOR;
        Dimension { exponents: [mass * d, length * d, time * d, temperature * d] }
    }

    /// Whether it is a pure number.
    pub fn is_none(self) -> bool {
        self == Dimension::NONE
    }

    /// Dimension of a product.
    pub fn times(self, other: Dimension) -> Dimension {
        self.combine(other, |x, y| x + y)
    }

    /// Dimension of a quotient.
    pub fn over(self, other: Dimension) -> Dimension {
        self.combine(other, |x, y| x - y)
    }

    /// Dimension of a power; `None` if the exponent is too large or has no small denominator.
    pub fn power(self, exponent: f64) -> Option<Dimension> {
        if !exponent.is_finite() {
            return None;
        }
        let mut exponents = [0; 4];
        for (result, &own) in exponents.iter_mut().zip(&self.exponents) {
            let exact = own as f64 * exponent;
            let rounded = exact.round();
            if (exact - rounded).abs() > 1e-6
                || rounded.abs() > LARGEST_EXPONENT * DENOMINATOR as f64
            {
                return None;
            }
            *result = rounded as i64;
        }
        Some(Dimension { exponents })
    }

    /// The energy density of an interaction of `points` points in `d` dimensions: J/m^(points*d).
    pub fn energy_density(points: usize, d: usize) -> Dimension {
        Dimension::of(1, 2 - (points * d) as i64, -2, 0)
    }

    fn combine(self, other: Dimension, f: impl Fn(i64, i64) -> i64) -> Dimension {
        let mut exponents = [0; 4];
        for i in 0..4 {
            // Repeated squaring gets beyond any bound; sums of two that are bounded do not overflow.
            let exponent = f(self.exponents[i], other.exponents[i]);
            exponents[i] = exponent.clamp(-i64::MAX / 4, i64::MAX / 4);
        }
        Dimension { exponents }
    }

    /// The dimension in words, with an article: "a length".
    fn words(self) -> Option<&'static str> {
        const WORDS: &[(Dimension, &str)] = &[
            (Dimension::NONE, "a pure number"),
            (Dimension::LENGTH, "a length"),
            (Dimension::of(0, 2, 0, 0), "an area"),
            (Dimension::of(0, 3, 0, 0), "a volume"),
            (Dimension::of(0, -1, 0, 0), "an inverse length"),
            (Dimension::of(1, 0, 0, 0), "a mass"),
            (Dimension::of(0, 0, 1, 0), "a time"),
            (Dimension::of(0, 0, -1, 0), "a frequency"),
            (Dimension::of(0, 0, 0, 1), "a temperature"),
            (Dimension::of(0, 1, -1, 0), "a velocity"),
            (Dimension::of(0, 1, -2, 0), "an acceleration"),
            (Dimension::of(1, 1, -2, 0), "a force"),
            (Dimension::ENERGY, "an energy"),
            (Dimension::of(1, -1, -2, 0), "a stress or energy per volume"),
            (Dimension::of(1, 0, -2, 0), "an energy per area"),
            (Dimension::of(1, -3, 0, 0), "a mass density"),
            (Dimension::of(1, -2, -2, 0), "an energy per length^4"),
            (Dimension::of(1, -4, -2, 0), "an energy per length^6"),
            (Dimension::of(1, -6, -2, 0), "an energy per length^8"),
            (Dimension::of(1, -7, -2, 0), "an energy per length^9"),
            (Dimension::of(1, -10, -2, 0), "an energy per length^12"),
        ];
        WORDS.iter().find(|(d, _)| *d == self).map(|(_, words)| *words)
    }

    /// The unit in SI: `J/m^4`, `m^2`, `kg/(m*s)`; `1` for a pure number.
    pub fn unit(self) -> String {
        // Energies and forces read better in J and N.
        if self == Dimension::of(1, 1, -2, 0) {
            return "N".into();
        }
        for (name, derived) in [("J", Dimension::ENERGY), ("N", Dimension::of(1, 1, -2, 0))] {
            let rest = self.over(derived);
            if rest.exponents[0] == 0 && rest.exponents[2] == 0 && rest.exponents[3] == 0 {
                return join_factors(&[(name, DENOMINATOR), ("m", rest.exponents[1])]);
            }
        }
        let factors: Vec<(&str, i64)> = BASE.into_iter().zip(self.exponents).collect();
        join_factors(&factors)
    }

    /// In words and units: "a length (m)", or the unit alone: "kg^2/s".
    pub fn describe(self) -> String {
        match self.words() {
            Some(words) if self.is_none() => words.to_string(),
            Some(words) => format!("{words} ({})", self.unit()),
            None => format!("a quantity in {}", self.unit()),
        }
    }
}

fn join_factors(factors: &[(&str, i64)]) -> String {
    let side = |sign: i64| -> Vec<String> {
        let on_side = factors.iter().filter(|(_, e)| e.signum() == sign);
        on_side.map(|(name, e)| format!("{name}{}", exponent_text(e.abs()))).collect()
    };
    let (above, below) = (side(1), side(-1));
    let above = if above.is_empty() { "1".to_string() } else { above.join("*") };
    match below.len() {
        0 => above,
        1 => format!("{above}/{}", below[0]),
        _ => format!("{above}/({})", below.join("*")),
    }
}

fn exponent_text(exponent: i64) -> String {
    if exponent == DENOMINATOR {
        String::new()
    } else if exponent % DENOMINATOR == 0 {
        format!("^{}", exponent / DENOMINATOR)
    } else {
        let divisor = gcd(exponent, DENOMINATOR);
        format!("^({}/{})", exponent / divisor, DENOMINATOR / divisor)
    }
}

fn gcd(x: i64, y: i64) -> i64 {
    if y == 0 { x } else { gcd(y, x % y) }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.describe())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_read_as_people_write_them() {
        assert_eq!(Dimension::LENGTH.describe(), "a length (m)");
        assert_eq!(Dimension::energy_density(2, 2).unit(), "J/m^4");
        assert_eq!(Dimension::energy_density(4, 3).unit(), "J/m^12");
        assert_eq!(Dimension::of(1, 1, -2, 0).describe(), "a force (N)");
        assert_eq!(Dimension::of(1, 0, -1, 0).unit(), "kg/s");
        assert_eq!(Dimension::of(1, -1, -1, 0).unit(), "kg/(m*s)");
        assert_eq!(Dimension::NONE.describe(), "a pure number");
        assert_eq!(Dimension::of(0, -2, 0, 0).unit(), "1/m^2");
        assert_eq!(Dimension::LENGTH.power(0.5).unwrap().unit(), "m^(1/2)");
    }

    #[test]
    fn roots_are_exact_and_odd_exponents_refused() {
        let third = Dimension::LENGTH.power(1.0 / 3.0).unwrap();
        assert_eq!(third.power(3.0), Some(Dimension::LENGTH));
        assert_eq!(Dimension::LENGTH.power(0.123456789), None);
        assert_eq!(Dimension::LENGTH.power(1e300), None);
        assert_eq!(Dimension::LENGTH.power(f64::NAN), None);
        assert_eq!(Dimension::NONE.power(f64::INFINITY), None);
    }

    #[test]
    fn exponents_beyond_all_bounds_stay_printable() {
        let mut huge = Dimension::LENGTH;
        for _ in 0..80 {
            huge = huge.times(huge);
        }
        let tiny = Dimension::NONE.over(huge).over(huge);
        assert!(huge.describe().starts_with("a quantity in m^"), "{huge}");
        assert!(tiny.unit().starts_with("1/m^"), "{tiny}");
    }
}
