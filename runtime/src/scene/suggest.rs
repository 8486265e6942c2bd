//! Did you mean ...?

/// The candidate that a misspelt name most likely stands for, if any is near enough.
///
/// Near is at most a third of the name's letters wrong, in the sense of Levenshtein.
pub(super) fn suggest<'a>(name: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let allowed = (name.chars().count() / 3).max(1);
    // Enough for every table of keys; keeps a file with thousands of sets readable in no time.
    let distances =
        candidates.iter().take(256).map(|candidate| (distance(name, candidate), *candidate));
    let (least, best) = distances.min_by_key(|(distance, _)| *distance)?;
    (least <= allowed).then_some(best)
}

/// Levenshtein distance; case does not count.
fn distance(a: &str, b: &str) -> usize {
    let a: Vec<char> = a.to_lowercase().chars().collect();
    let b: Vec<char> = b.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for i in 0..a.len() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for j in 0..b.len() {
            let replaced = diagonal + usize::from(a[i] != b[j]);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_suggested_and_far_ones_are_not() {
        let keys = ["spacing", "spacings", "radius", "weights"];
        assert_eq!(suggest("spaceing", &keys), Some("spacing"));
        assert_eq!(suggest("Radius", &keys), Some("radius"));
        assert_eq!(suggest("wieghts", &keys), Some("weights"));
        assert_eq!(suggest("potential", &keys), None);
        assert_eq!(suggest("x", &[]), None);
    }
}
