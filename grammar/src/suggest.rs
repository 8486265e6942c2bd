//! Did you mean ..? The nearest of some known names.

/// The candidate that `name` most likely stands for, if one is near enough.
///
/// Near means: at most a third of the longer word's letters have to be inserted, deleted, replaced
/// or swapped with their neighbour (a difference in case alone is always near). Of equally near
/// candidates the first wins.
pub fn suggest<'c>(name: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    let wanted: Vec<char> = name.chars().collect();
    // Nobody misspells a name this long; the distance costs the product of the lengths.
    if wanted.len() > 64 {
        return None;
    }
    let mut best: Option<(usize, &'c str)> = None;
    for candidate in candidates {
        let letters: Vec<char> = candidate.chars().collect();
        let longer = wanted.len().max(letters.len());
        if candidate == name || longer > 64 {
            continue;
        }
        let distance =
            if name.eq_ignore_ascii_case(candidate) { 0 } else { distance(&wanted, &letters) };
        if distance * 3 <= longer && best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// Edits that lead from one word to the other (Damerau-Levenshtein, adjacent swaps once).
fn distance(from: &[char], to: &[char]) -> usize {
    let width = to.len() + 1;
    let mut before_last: Vec<usize> = vec![0; width];
    let mut last: Vec<usize> = (0..width).collect();
    for (i, &letter) in from.iter().enumerate() {
        let mut row = vec![i + 1; width];
        for (j, &other) in to.iter().enumerate() {
            let replaced = last[j] + usize::from(letter != other);
            row[j + 1] = replaced.min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && letter == to[j - 1] && from[i - 1] == other {
                row[j + 1] = row[j + 1].min(before_last[j - 1] + 1);
            }
        }
        before_last = last;
        last = row;
    }
    last[to.len()]
}

/// So many of something, in words: `1 step`, `3 steps`.
pub fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edits(from: &str, to: &str) -> usize {
        distance(&from.chars().collect::<Vec<_>>(), &to.chars().collect::<Vec<_>>())
    }

    #[test]
    fn edits_are_counted() {
        assert_eq!(edits("", "abc"), 3);
        assert_eq!(edits("paramter", "parameter"), 1);
        assert_eq!(edits("sqtr", "sqrt"), 1, "a swap is one edit");
        assert_eq!(edits("kitten", "sitting"), 3);
        assert_eq!(edits("same", "same"), 0);
    }

    #[test]
    fn near_names_are_suggested_and_far_ones_are_not() {
        assert_eq!(suggest("paramter", ["potential", "parameter"]), Some("parameter"));
        assert_eq!(suggest("sqtr", ["sin", "sqrt"]), Some("sqrt"));
        assert_eq!(suggest("c1", ["C2", "C1"]), Some("C1"), "case alone is nearest");
        assert_eq!(suggest("lambda", ["mu", "kappa"]), None);
        assert_eq!(suggest("x", ["y"]), None, "one letter resembles nothing");
        assert_eq!(suggest("same", ["same"]), None, "a name is no advice for itself");
    }
}
