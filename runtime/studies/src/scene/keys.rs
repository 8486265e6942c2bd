//! Keys whose values go straight into a field: one row each, for reading, writing and messages.

use std::fmt::Write as _;

use piola_mechanics::words::Words;

use super::reader::{Field, Reader, Table};
use super::{ColourBy, FrameField};

/// A key, an example of its value that messages quote, and its field.
pub(super) type Row<S> = (&'static str, &'static str, fn(&mut S) -> Slot<'_>);

/// Keys and examples of some rows.
pub(super) const fn named<S, const N: usize>(
    rows: &[Row<S>; N],
) -> [(&'static str, &'static str); N] {
    let mut keys = [("", ""); N];
    let mut i = 0;
    while i < N {
        keys[i] = (rows[i].0, rows[i].1);
        i += 1;
    }
    keys
}

/// A field, by what its value may be.
pub(super) enum Slot<'a> {
    /// One of several words.
    Word(&'a mut dyn Choice),
    /// What colours show.
    Colour(&'a mut ColourBy),
    /// An array of words, each once.
    Fields(&'a mut Vec<FrameField>),
    /// Greater than 0.
    Positive(&'a mut f64),
    /// Greater than 0 and less than 1.
    Fraction(&'a mut f64),
    /// Not less than 0.
    NotNegative(&'a mut f64),
    /// `true` or `false`.
    Switch(&'a mut bool),
    /// A time in s greater than 0; or a text with a unit.
    Seconds(&'a mut f64),
    /// The same, or the word.
    SecondsOr(&'a mut Option<f64>, &'static str),
    /// A whole number, not less than the one beside it.
    Count(&'a mut usize, i64),
}

/// An option of any type.
pub(super) trait Choice {
    /// Reads its value, if that can be read.
    fn read(&mut self, reader: &mut Reader, field: Field<'_>);

    /// The word of its value.
    fn word(&self) -> &'static str;

    /// All its words.
    fn words(&self) -> Vec<&'static str>;
}

fn take<T>(field: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *field = value;
    }
}

impl<T: Words> Choice for T {
    fn read(&mut self, reader: &mut Reader, field: Field<'_>) {
        take(self, reader.choice(field));
    }

    fn word(&self) -> &'static str {
        Words::word(*self)
    }

    fn words(&self) -> Vec<&'static str> {
        T::words()
    }
}

impl Slot<'_> {
    fn read(self, reader: &mut Reader, field: Field<'_>) {
        match self {
            Slot::Word(choice) => choice.read(reader, field),
            Slot::Colour(colour) => take(colour, reader.colour(field)),
            Slot::Fields(fields) => take(fields, reader.choices(field)),
            Slot::Positive(value) => take(value, reader.positive(field)),
            Slot::Fraction(value) => take(value, reader.fraction(field)),
            Slot::NotNegative(value) => take(value, reader.not_negative(field)),
            Slot::Switch(value) => take(value, reader.switch(field)),
            Slot::Seconds(value) => take(value, reader.seconds(field)),
            Slot::SecondsOr(value, word) => take(value, reader.seconds_or(field, word)),
            Slot::Count(value, least) => take(value, reader.count(field, least)),
        }
    }

    fn text(self) -> String {
        match self {
            Slot::Word(choice) => string(choice.word()),
            Slot::Colour(colour) => string(&colour.word()),
            Slot::Fields(fields) => {
                let words: Vec<String> = fields.iter().map(|one| string(one.word())).collect();
                format!("[{}]", words.join(", "))
            }
            Slot::Positive(value)
            | Slot::Fraction(value)
            | Slot::NotNegative(value)
            | Slot::Seconds(value) => number(*value),
            Slot::Switch(value) => value.to_string(),
            Slot::SecondsOr(value, word) => value.map_or_else(|| string(word), number),
            Slot::Count(value, _) => value.to_string(),
        }
    }
}

impl Reader {
    /// The settings of a table; a value that cannot be read is noted and keeps its default.
    pub(super) fn settings<S: Default>(&mut self, table: Option<&Table<'_>>, rows: &[Row<S>]) -> S {
        let mut settings = S::default();
        for (key, _, slot) in rows {
            if let Some(field) = table.and_then(|table| table.field(key)) {
                slot(&mut settings).read(self, field);
            }
        }
        settings
    }
}

/// The keys of settings with their values as TOML.
pub(super) fn texts<S: Clone>(settings: &S, rows: &[Row<S>]) -> Vec<(&'static str, String)> {
    let mut settings = settings.clone();
    rows.iter().map(|(key, _, slot)| (*key, slot(&mut settings).text())).collect()
}

/// Shortest decimals that read back to the same bits, as a TOML float.
pub(super) fn number(value: f64) -> String {
    format!("{value:?}")
}

/// A TOML basic string.
pub(super) fn string(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", c as u32);
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}
