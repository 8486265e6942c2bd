//! Generated potentials, from text to machine code: what the fuzz target looks for with more time.

#[path = "support/property.rs"]
mod property;

use piola_grammar::generate::potential_text;
use property::{Outcome, follow};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn generated_potentials_go_all_the_way(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let text = potential_text(&bytes);
        let outcome = follow(&text);
        prop_assert!(
            matches!(outcome, Outcome::Compiled | Outcome::NotCompiled | Outcome::Refused),
            "{outcome:?}\n{text}"
        );
    }

    /// A potential with one character changed: mostly wrong, never a panic.
    #[test]
    fn damaged_potentials_are_refused_or_work(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        place in any::<prop::sample::Index>(),
        character in prop::sample::select("+-*/^()=<>,lLaAvVdx01.e#\"\n _&".chars().collect::<Vec<_>>()),
    ) {
        let text = potential_text(&bytes);
        let mut characters: Vec<char> = text.chars().collect();
        let place = place.index(characters.len());
        characters[place] = character;
        follow(&characters.into_iter().collect::<String>());
    }
}
