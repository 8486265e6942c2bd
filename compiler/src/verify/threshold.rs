//! Where a condition changes, and whether compiled margins are on the side that it says.

use super::{Miss, Verification};

/// How far from a threshold on a way between two places is tried, in units in the last place: beyond what may be
/// misjudged, or nothing would be found wrong.
const AROUND: i32 = 24;

/// How far from a threshold on a way a place may be misjudged, in such units.
pub(super) const BAR: f64 = 16.0;

const _: () = assert!(BAR < AROUND as f64, "what is beyond the bar is tried");

/// The last number on either side of where a condition changes between two.
pub(super) fn between(holds: impl Fn(f64) -> Option<bool>, [from, to]: [f64; 2]) -> [f64; 2] {
    let start = holds(from);
    let (mut low, mut high) = (from, to);
    loop {
        let middle = low + 0.5 * (high - low);
        if middle == low || middle == high {
            return [low, high];
        }
        if holds(middle) == start { low = middle } else { high = middle }
    }
}

/// Places around the threshold on a way `at(t)` from 0 to 1 of this length, with how far they are from it in
/// units in the last place of their `size`.
pub(super) fn on_a_way<P>(
    at: impl Fn(f64) -> P,
    holds: impl Fn(&P) -> Option<bool>,
    (length, size): (f64, impl Fn(&P) -> f64),
) -> Vec<(P, f64)> {
    let [low, _] = between(|t| holds(&at(t)), [0.0, 1.0]);
    let unit = (f64::EPSILON * size(&at(low)) / length).max(f64::EPSILON * low);
    let place = |k: i32| (at(low + f64::from(k) * unit), f64::from(k.abs()));
    (-AROUND..=AROUND).map(place).collect()
}

/// Judges margins at the strict level, at the fast one, and of the interpreter at places, which are so far from
/// a threshold: infinitely where they may not be misjudged. `numbers` are what a place is told by.
pub(super) fn judge<P>(
    found: &mut Verification,
    places: &[(P, f64)],
    [strict, fast, interpreted]: [&[f64]; 3],
    truth: impl Fn(&P) -> Option<f64>,
    numbers: impl Fn(&P) -> Vec<f64>,
) {
    for (k, (place, distance)) in places.iter().enumerate() {
        found.count(&[strict[k]], &[interpreted[k]]);
        let Some(truth) = truth(place) else { continue };
        for margin in [strict[k], fast[k]] {
            // A margin of exactly 0 is on neither side.
            let is_right = (margin > 0.0) == (truth > 0.0) || truth == 0.0;
            let error = if is_right { 0.0 } else { *distance };
            found.see(0, 0, error, |_| Miss {
                place: numbers(place),
                order: 0,
                compiled: vec![margin],
                expected: vec![truth],
                tolerance: 0.0,
                is_wrong: true,
            });
        }
    }
}
