//! Words for the values of an option: one table for reading, writing, messages and studies.

use piola_compiler::Form;

use crate::energy::Products;
use crate::kernel::Level;

/// An option whose values have words.
pub trait Words: Copy + 'static {
    /// The words and what they stand for. The first is the default, unless the reader of its key
    /// says otherwise. Of a value with parts of its own there is one, whatever the parts.
    const WORDS: &'static [(&'static str, Self)];

    /// The word of this value; empty for one that nobody can ask for.
    fn word(self) -> &'static str {
        let kind = std::mem::discriminant(&self);
        let mut rows = Self::WORDS.iter();
        rows.find(|(_, value)| std::mem::discriminant(value) == kind).map_or("", |(word, _)| word)
    }

    /// The value of a word.
    fn of_word(word: &str) -> Option<Self> {
        Self::WORDS.iter().find(|(known, _)| *known == word).map(|(_, value)| *value)
    }

    /// All words, in the order of the table.
    fn words() -> Vec<&'static str> {
        Self::WORDS.iter().map(|(word, _)| *word).collect()
    }
}

impl Words for Level {
    const WORDS: &'static [(&'static str, Level)] =
        &[("strict", Level::Strict), ("fast", Level::Fast)];
}

impl Words for Form {
    const WORDS: &'static [(&'static str, Form)] =
        &[("accurate", Form::Accurate), ("textbook", Form::Textbook)];
}

impl Words for Products {
    const WORDS: &'static [(&'static str, Products)] = &[
        ("exact", Products::Exact),
        ("finite-difference", Products::OneSided),
        ("central-difference", Products::Central),
    ];
}
