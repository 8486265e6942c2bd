//! Round numbers on axes and how they are written.

/// The ticks of a linear axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ticks {
    /// Where they stand.
    pub(super) values: Vec<f64>,
    /// What is written there: the value over `10^exponent`.
    pub(super) labels: Vec<String>,
    /// The common power of ten; it belongs to the axis label.
    pub(super) exponent: i32,
    /// Digits behind the points of the labels.
    decimals: usize,
}

impl Ticks {
    /// Another number as it would stand among the labels, with a digit more.
    pub(super) fn between(&self, value: f64) -> String {
        written(value / libm::pow(10.0, f64::from(self.exponent)), self.decimals + 1)
    }
}

fn written(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.trim_start_matches('-').bytes().all(|b| b == b'0' || b == b'.') {
        "0".to_owned()
    } else {
        text.replace('-', "\u{2212}")
    }
}

/// About `wanted` round numbers between `low` and `high`.
pub(super) fn linear(low: f64, high: f64, wanted: usize) -> Ticks {
    let step = round_step((high - low) / wanted.max(1) as f64);
    let first = (low / step - 1e-9).ceil();
    let count = ((high / step + 1e-9).floor() - first).max(0.0) as usize + 1;
    let values: Vec<f64> = (0..count.min(50)).map(|i| (first + i as f64) * step).collect();
    let largest = low.abs().max(high.abs());
    let magnitude = floor_log10(largest);
    // Plain numbers from 0.001 to 9999; else a power of ten that is a multiple of three.
    let exponent = if (-3..4).contains(&magnitude) { 0 } else { 3 * magnitude.div_euclid(3) };
    let unit = libm::pow(10.0, f64::from(exponent));
    let decimals = (exponent - floor_log10(step)).max(0) as usize;
    let label = |value: &f64| written(value / unit, decimals);
    Ticks { labels: values.iter().map(label).collect(), values, exponent, decimals }
}

/// Decades between the powers of ten `low` and `high`, at most about `most` of them.
pub(super) fn decades(low: i32, high: i32, most: i32) -> Vec<i32> {
    let span = (high - low).max(1);
    let step = [1, 2, 3, 4, 5, 10, 20, 50].into_iter().find(|s| span / s <= most).unwrap_or(100);
    (low..=high).filter(|decade| decade.rem_euclid(step) == 0).collect()
}

/// Numbers between `10^low` and `10^high`: 1, 2 and 5 times powers of ten, or these powers alone if
/// there were more than `most`.
pub(super) fn one_two_five(low: f64, high: f64, most: usize) -> Vec<f64> {
    let powers = low.floor() as i32..=high.ceil() as i32;
    let inside = |x: &f64| (low - 1e-9..=high + 1e-9).contains(&libm::log10(*x));
    let times = |factors: &'static [f64]| {
        let power = |exponent: i32| {
            let power = libm::pow(10.0, f64::from(exponent));
            factors.iter().map(move |factor| factor * power)
        };
        powers.clone().flat_map(power).filter(inside).collect::<Vec<f64>>()
    };
    let all = times(&[1.0, 2.0, 5.0]);
    if all.len() <= most { all } else { times(&[1.0]) }
}

/// 1, 2 or 5 times a power of ten, at least `raw`.
pub(super) fn round_step(raw: f64) -> f64 {
    if !(raw.is_finite() && raw > 0.0) {
        return 1.0;
    }
    let power = libm::pow(10.0, f64::from(floor_log10(raw)));
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| f * power >= raw * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

/// The power of ten below a positive number; 0 for zero.
fn floor_log10(x: f64) -> i32 {
    if x > 0.0 && x.is_finite() { (libm::log10(x) + 1e-9).floor() as i32 } else { 0 }
}

/// `10` to this power, with raised digits.
pub(super) fn power_of_ten(exponent: i32) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4' => '⁴',
        '5' => '⁵',
        '6' => '⁶',
        '7' => '⁷',
        '8' => '⁸',
        '9' => '⁹',
        _ => '⁰',
    };
    format!("10{}", exponent.to_string().chars().map(raised).collect::<String>())
}

/// A name with its unit: `reaction (N)`, or `reaction (10⁶ N)`.
pub(super) fn with_unit(name: &str, unit: &str, exponent: i32) -> String {
    match (unit, exponent) {
        ("", 0) => name.to_owned(),
        ("", _) => format!("{name} ({})", power_of_ten(exponent)),
        (_, 0) => format!("{name} ({unit})"),
        _ => format!("{name} ({} {unit})", power_of_ten(exponent)),
    }
}

/// A number for the reader's eye: four significant digits, no trailing zeros.
pub(super) fn short(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return super::super::decimal(x);
    }
    let magnitude = floor_log10(x.abs());
    if !(-4..6).contains(&magnitude) {
        let text = format!("{x:.3e}");
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{exponent}", without_zeros(mantissa));
    }
    without_zeros(&format!("{x:.*}", (3 - magnitude).max(0) as usize)).to_owned()
}

fn without_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, wanted: usize) -> (Vec<String>, i32) {
        let ticks = linear(low, high, wanted);
        (ticks.labels, ticks.exponent)
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let (text, exponent) = labels(0.0, 1.0, 5);
        assert_eq!((text.join(" ").as_str(), exponent), ("0 0.2 0.4 0.6 0.8 1.0", 0));
        let (text, exponent) = labels(-1.3e6, 2.1e6, 4);
        assert_eq!((text.join(" ").as_str(), exponent), ("−1 0 1 2", 6));
        let (text, exponent) = labels(0.0, 3.1e-8, 4);
        assert_eq!((text.join(" ").as_str(), exponent), ("0 10 20 30", -9));
        for (low, high) in [(0.0, 7.7), (-3.0, 1e9), (1e-12, 2e-12), (5.0, 5.1), (-2.0, -1.0)] {
            let ticks = linear(low, high, 5);
            assert!((2..=11).contains(&ticks.values.len()), "{ticks:?}");
            let slack = (high - low) * 1e-8;
            assert!(ticks.values.iter().all(|v| (low - slack..=high + slack).contains(v)));
            let mut unique = ticks.labels.clone();
            unique.dedup();
            assert_eq!(unique, ticks.labels, "labels differ from each other");
        }
    }

    #[test]
    fn decades_are_thinned() {
        assert_eq!(decades(-2, 1, 6), [-2, -1, 0, 1]);
        assert_eq!(decades(-14, 0, 6), [-12, -9, -6, -3, 0]);
        assert!(decades(-320, 300, 6).len() < 10);
    }

    #[test]
    fn few_powers_of_ten_have_ticks_between() {
        assert_eq!(one_two_five(-1.0, 0.1, 7), [0.1, 0.2, 0.5, 1.0]);
        assert_eq!(one_two_five(0.31, 0.7, 7), [5.0]);
        assert_eq!(one_two_five(-2.0, 2.0, 7), [0.01, 0.1, 1.0, 10.0, 100.0]);
    }

    #[test]
    fn numbers_are_short() {
        let all: Vec<String> =
            [0.0, 1.0, 0.04, 0.30000000000000004, 123456.0, 1e-10, -2.5e7, 1.0 / 3.0]
                .into_iter()
                .map(short)
                .collect();
        assert_eq!(all, ["0", "1", "0.04", "0.3", "123456", "1e-10", "-2.5e7", "0.3333"]);
        assert_eq!(power_of_ten(-12), "10⁻¹²");
        assert_eq!(with_unit("reaction", "N", 3), "reaction (10³ N)");
        assert_eq!(with_unit("iteration", "", 0), "iteration");
        assert_eq!(round_step(0.3), 0.5);
        assert_eq!(round_step(f64::NAN), 1.0);
    }
}
