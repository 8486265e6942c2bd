//! Named units: what `in GPa` or "200 GPa" means.

use super::dimension::Dimension;

/// A unit: its dimension and how many SI units it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitValue {
    /// What it measures.
    pub dimension: Dimension,
    /// 1 of this unit in SI base units.
    pub scale: f64,
}

/// Units that take prefixes: name, dimension, scale in SI base units.
const NAMED: &[(&str, Dimension, f64)] = &[
    ("m", Dimension::LENGTH, 1.0),
    ("g", Dimension::of(1, 0, 0, 0), 1e-3),
    ("s", Dimension::of(0, 0, 1, 0), 1.0),
    ("K", Dimension::of(0, 0, 0, 1), 1.0),
    ("N", Dimension::of(1, 1, -2, 0), 1.0),
    ("J", Dimension::ENERGY, 1.0),
    ("Pa", Dimension::of(1, -1, -2, 0), 1.0),
    ("W", Dimension::of(1, 2, -3, 0), 1.0),
    ("Hz", Dimension::of(0, 0, -1, 0), 1.0),
    ("rad", Dimension::NONE, 1.0),
];

/// Decimal prefixes.
const PREFIXES: &[(&str, f64)] = &[
    ("f", 1e-15),
    ("p", 1e-12),
    ("n", 1e-9),
    ("u", 1e-6),
    ("µ", 1e-6),
    ("mu", 1e-6),
    ("m", 1e-3),
    ("c", 1e-2),
    ("k", 1e3),
    ("M", 1e6),
    ("G", 1e9),
    ("T", 1e12),
];

/// The unit with this name, prefix included.
pub fn named_unit(name: &str) -> Option<UnitValue> {
    if name == "1" {
        return Some(UnitValue { dimension: Dimension::NONE, scale: 1.0 });
    }
    let whole = |text: &str| NAMED.iter().find(|(unit, ..)| *unit == text);
    if let Some(&(_, dimension, scale)) = whole(name) {
        return Some(UnitValue { dimension, scale });
    }
    PREFIXES.iter().find_map(|(prefix, factor)| {
        let &(_, dimension, scale) = whole(name.strip_prefix(prefix)?)?;
        // 1 kg is exactly 1: 1e3 * 1e-3 rounds to it.
        Some(UnitValue { dimension, scale: factor * scale })
    })
}

/// The names that take prefixes.
pub fn base_units() -> Vec<&'static str> {
    NAMED.iter().map(|(name, ..)| *name).collect()
}

/// The prefixes, each in its shortest spelling.
pub fn prefixes() -> Vec<&'static str> {
    let short = |prefix: &&str| prefix.len() == 1;
    PREFIXES.iter().map(|(prefix, _)| *prefix).filter(short).collect()
}

/// Names a misspelt unit may have meant.
pub fn unit_names() -> impl Iterator<Item = &'static str> {
    const COMMON: &[&str] = &["mm", "nm", "um", "km", "kg", "ms", "kN", "kJ", "kPa", "MPa", "GPa"];
    NAMED.iter().map(|(name, ..)| *name).chain(COMMON.iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_scale() {
        let scale = |name: &str| named_unit(name).unwrap().scale;
        assert_eq!(scale("GPa"), 1e9);
        assert_eq!(scale("kg"), 1.0);
        assert_eq!(scale("mm"), 1e-3);
        assert_eq!(scale("m"), 1.0);
        assert_eq!(scale("nm"), 1e-9);
        assert_eq!(named_unit("GPa").unwrap().dimension, Dimension::of(1, -1, -2, 0));
        assert!(named_unit("ft").is_none());
        assert!(named_unit("kk").is_none());
    }
}
