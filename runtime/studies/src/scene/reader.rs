//! Walks the tree of a scene and notes every mistake on the way.
//!
//! A reading function returns `None` when it has noted a mistake; its caller goes on with the next
//! key, so that one run shows all mistakes of a file. Each key stands once, in a [`Schema`], with
//! an example that the messages quote.

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::words::Words;

use super::ColourBy;
use super::tree::{Entry, Kind, Node, Text};
use piola_grammar::suggest;

/// The keys of one kind of table.
pub(super) struct Schema {
    /// How messages call the table, e.g. `[body]`.
    pub(super) title: &'static str,
    /// Key and an example of its value; `*` stands for keys that the user chooses.
    pub(super) keys: &'static [(&'static str, &'static str)],
}

impl Schema {
    /// The line that a message offers for a key.
    fn line(&self, key: &str) -> String {
        let example = self.keys.iter().find(|(name, _)| *name == key || *name == "*");
        let example = example.map_or("..", |(_, example)| example);
        format!("{key} = {example}")
    }
}

/// A table of the scene, checked for unknown keys.
pub(super) struct Table<'t> {
    pub(super) schema: &'static Schema,
    pub(super) span: Span,
    entries: &'t [Entry],
}

impl<'t> Table<'t> {
    /// The entry of a key.
    pub(super) fn get(&self, key: &str) -> Option<&'t Entry> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    /// A key's entry as a field that can be read.
    pub(super) fn field(&self, key: &str) -> Option<Field<'t>> {
        self.get(key).map(|entry| Field { schema: self.schema, key: &entry.key, node: &entry.node })
    }
}

/// A value, and the key that says what it should be.
#[derive(Clone, Copy)]
pub(super) struct Field<'t> {
    pub(super) schema: &'static Schema,
    pub(super) key: &'t str,
    pub(super) node: &'t Node,
}

impl<'t> Field<'t> {
    /// An item of an array, read under the array's key.
    pub(super) fn item(self, node: &'t Node) -> Field<'t> {
        Field { node, ..self }
    }
}

/// Nobody reads more mistakes than these; a file of nothing else must not take minutes.
const MAX_FINDINGS: usize = 500;

/// Notes mistakes.
#[derive(Default)]
pub(super) struct Reader {
    pub(super) found: Vec<Diagnostic>,
}

impl Reader {
    /// Notes an error.
    pub(super) fn error(&mut self, diagnostic: Diagnostic) {
        if self.found.len() < MAX_FINDINGS {
            self.found.push(diagnostic);
        }
    }

    /// A table with the keys of its schema.
    pub(super) fn table<'t>(
        &mut self,
        schema: &'static Schema,
        node: &'t Node,
    ) -> Option<Table<'t>> {
        let Kind::Table(entries) = &node.kind else {
            let message =
                format!("expected the table {}, found {}", schema.title, node.kind_name());
            self.error(Diagnostic::error("wrong-type", node.span, message));
            return None;
        };
        self.unknown_keys(schema, entries);
        Some(Table { schema, span: node.span, entries })
    }

    fn unknown_keys(&mut self, schema: &Schema, entries: &[Entry]) {
        let known: Vec<&str> = schema.keys.iter().map(|(key, _)| *key).collect();
        for entry in entries.iter().filter(|entry| !known.contains(&entry.key.as_str())) {
            let message = format!("{} has no key `{}`", schema.title, entry.key);
            let diagnostic = Diagnostic::error("unknown-key", entry.key_span, message);
            self.error(match suggest(&entry.key, known.iter().copied()) {
                Some(near) => diagnostic.label(format!("did you mean `{near}`?")),
                None => diagnostic.help(format!("its keys are {}", known.join(", "))),
            });
        }
    }

    /// The tables of `[[name]]`.
    pub(super) fn tables<'t>(
        &mut self,
        schema: &'static Schema,
        node: Option<&'t Node>,
    ) -> Vec<Table<'t>> {
        match node.map(|node| (&node.kind, node)) {
            None => Vec::new(),
            Some((Kind::Array(items), _)) => {
                items.iter().filter_map(|item| self.table(schema, item)).collect()
            }
            Some((_, node)) => {
                let message =
                    format!("expected {} tables, found {}", schema.title, node.kind_name());
                let diagnostic = Diagnostic::error("wrong-type", node.span, message);
                self.error(diagnostic.help(format!("write {} with two brackets", schema.title)));
                Vec::new()
            }
        }
    }

    /// The field of a key that must be there.
    pub(super) fn required<'t>(
        &mut self,
        table: &Table<'t>,
        key: &'static str,
    ) -> Option<Field<'t>> {
        let field = table.field(key);
        if field.is_none() {
            let message = format!("{} has no `{key}`", table.schema.title);
            let diagnostic = Diagnostic::error("missing-key", table.span, message);
            self.error(diagnostic.help(format!("write {}", table.schema.line(key))));
        }
        field
    }

    /// Notes that a value is of the wrong type; `expected` is said with its article.
    pub(super) fn wrong_type(&mut self, field: Field<'_>, expected: &str) {
        let message = format!("expected {expected}, found {}", field.node.kind_name());
        let diagnostic = Diagnostic::error("wrong-type", field.node.span, message);
        // "0.05" in quotes most likely means 0.05.
        let line = match &field.node.kind {
            Kind::Text(text)
                if expected.starts_with("a number") && text.value.parse::<f64>().is_ok() =>
            {
                format!("{} = {}", field.key, text.value)
            }
            _ => field.schema.line(field.key),
        };
        let diagnostic = diagnostic.help(format!("write {line}"));
        let with_unit = matches!(&field.node.kind, Kind::Text(text)
            if text.value.starts_with(|c: char| c.is_ascii_digit() || c == '.')
                && text.value.contains(char::is_alphabetic));
        self.error(match with_unit && expected.starts_with("a number") {
            true => diagnostic.help("numbers have no unit here: lengths are in m, forces in N"),
            false => diagnostic,
        });
    }

    /// Notes that a value cannot be used; `wanted` says what it must be.
    pub(super) fn out_of_range(&mut self, field: Field<'_>, wanted: &str) {
        let message = format!("`{}` must be {wanted}", field.key);
        let diagnostic = Diagnostic::error("out-of-range", field.node.span, message);
        self.error(diagnostic.help(format!("for example {}", field.schema.line(field.key))));
    }

    /// A finite number.
    pub(super) fn number(&mut self, field: Field<'_>) -> Option<f64> {
        let Kind::Number { value, .. } = field.node.kind else {
            self.wrong_type(field, "a number");
            return None;
        };
        if value.is_finite() {
            return Some(value);
        }
        let message = format!("`{}` must be a finite number", field.key);
        self.error(Diagnostic::error("not-finite", field.node.span, message));
        None
    }

    /// A finite number greater than 0.
    pub(super) fn positive(&mut self, field: Field<'_>) -> Option<f64> {
        let number = self.number(field)?;
        if number > 0.0 {
            return Some(number);
        }
        self.out_of_range(field, "greater than 0");
        None
    }

    /// A whole number from `least` to 1 000 000.
    pub(super) fn count(&mut self, field: Field<'_>, least: i64) -> Option<usize> {
        const MOST: i64 = 1_000_000;
        let Kind::Number { whole, .. } = field.node.kind else {
            self.wrong_type(field, "a whole number");
            return None;
        };
        match whole {
            Some(whole) if (least..=MOST).contains(&whole) => usize::try_from(whole).ok(),
            _ => {
                self.out_of_range(field, &format!("a whole number from {least} to {MOST}"));
                None
            }
        }
    }

    /// A string.
    pub(super) fn text<'t>(&mut self, field: Field<'t>) -> Option<&'t Text> {
        if let Kind::Text(text) = &field.node.kind {
            return Some(text);
        }
        self.wrong_type(field, "a string");
        None
    }

    /// A number greater than 0 and less than 1.
    pub(super) fn fraction(&mut self, field: Field<'_>) -> Option<f64> {
        let number = self.positive(field)?;
        if number < 1.0 {
            return Some(number);
        }
        self.out_of_range(field, "less than 1");
        None
    }

    /// A finite number not less than 0.
    pub(super) fn not_negative(&mut self, field: Field<'_>) -> Option<f64> {
        let number = self.number(field)?;
        if number >= 0.0 {
            return Some(number);
        }
        self.out_of_range(field, "at least 0");
        None
    }

    /// A time greater than 0: a number in s, or a text with a unit.
    pub(super) fn seconds(&mut self, field: Field<'_>) -> Option<f64> {
        let Kind::Text(text) = &field.node.kind else { return self.positive(field) };
        match piola_compiler::quantity(field.key, &text.value, "s") {
            Ok(value) if value > 0.0 && value.is_finite() => Some(value),
            Ok(_) => {
                self.out_of_range(field, "greater than 0");
                None
            }
            Err(error) => {
                let found = Diagnostic::error(error.code, text.content, error.message);
                self.error(found.help("write a number in s, or a text with a unit: \"60 us\""));
                None
            }
        }
    }

    /// The same, or a word for none.
    pub(super) fn seconds_or(&mut self, field: Field<'_>, word: &str) -> Option<Option<f64>> {
        match &field.node.kind {
            Kind::Text(text) if text.value == word => Some(None),
            _ => self.seconds(field).map(Some),
        }
    }

    /// `true` or `false`.
    pub(super) fn switch(&mut self, field: Field<'_>) -> Option<bool> {
        if let Kind::Boolean(value) = field.node.kind {
            return Some(value);
        }
        self.wrong_type(field, "true or false");
        None
    }

    /// One of the words of an option.
    pub(super) fn choice<T: Words>(&mut self, field: Field<'_>) -> Option<T> {
        self.word(field, [""; 2])
    }

    /// What colours show.
    pub(super) fn colour(&mut self, field: Field<'_>) -> Option<ColourBy> {
        self.one_of_words(field, [""; 2], (ColourBy::of_word, &ColourBy::words()))
    }

    /// The same; what stands around it where it is written.
    fn word<T: Words>(&mut self, field: Field<'_>, around: [&str; 2]) -> Option<T> {
        self.one_of_words(field, around, (T::of_word, &T::words()))
    }

    fn one_of_words<T>(
        &mut self,
        field: Field<'_>,
        [open, close]: [&str; 2],
        (of_word, words): (impl Fn(&str) -> Option<T>, &[&str]),
    ) -> Option<T> {
        let text = self.text(field)?;
        let choice = of_word(&text.value);
        if choice.is_none() {
            let message = format!("`{}` cannot be \"{}\"", field.key, text.value);
            let diagnostic = Diagnostic::error("unknown-choice", field.node.span, message)
                .help(format!("write {} = {open}\"{}\"{close}", field.key, words.join("\" or \"")));
            self.error(match suggest(&text.value, words.iter().copied()) {
                Some(near) => diagnostic.label(format!("did you mean \"{near}\"?")),
                None => diagnostic,
            });
        }
        choice
    }

    /// Some of the words of an option, each at most once.
    pub(super) fn choices<T: Words>(&mut self, field: Field<'_>) -> Option<Vec<T>> {
        let items = self.array(field)?;
        let read: Vec<Option<T>> =
            items.iter().map(|item| self.word(field.item(item), ["[", ", ..]"])).collect();
        let all = read.into_iter().collect::<Option<Vec<T>>>()?;
        let again =
            (0..all.len()).find(|&k| all[..k].iter().any(|one| one.word() == all[k].word()));
        if let Some(again) = again {
            let message = format!("\"{}\" stands here twice", all[again].word());
            self.error(Diagnostic::error("conflicting-keys", items[again].span, message));
            return None;
        }
        Some(all)
    }

    /// A key with one of the words of an option; without it the first of them.
    pub(super) fn option<T: Words>(&mut self, table: &Table<'_>, key: &'static str) -> Option<T> {
        self.or(Some(table), key, T::WORDS[0].1, Reader::choice)
    }

    /// An array.
    pub(super) fn array<'t>(&mut self, field: Field<'t>) -> Option<&'t [Node]> {
        if let Kind::Array(items) = &field.node.kind {
            return Some(items);
        }
        self.wrong_type(field, "an array");
        None
    }

    /// An array with one item per dimension (any number while the dimension is unknown).
    pub(super) fn components<'t>(
        &mut self,
        field: Field<'t>,
        dimension: Option<usize>,
    ) -> Option<&'t [Node]> {
        let items = self.array(field)?;
        match dimension {
            Some(dimension) if items.len() != dimension => {
                let message = format!(
                    "`{}` has {} components in {dimension} dimensions",
                    field.key,
                    items.len()
                );
                self.error(Diagnostic::error("component-count", field.node.span, message));
                None
            }
            _ => Some(items),
        }
    }

    /// An array of finite numbers, one per dimension.
    pub(super) fn vector(
        &mut self,
        field: Field<'_>,
        dimension: Option<usize>,
    ) -> Option<Vec<f64>> {
        let items = self.components(field, dimension)?;
        let numbers: Vec<Option<f64>> =
            items.iter().map(|item| self.number(field.item(item))).collect();
        numbers.into_iter().collect()
    }

    /// A key with a default.
    pub(super) fn or<'t, T>(
        &mut self,
        table: Option<&Table<'t>>,
        key: &'static str,
        default: T,
        read: impl FnOnce(&mut Reader, Field<'t>) -> Option<T>,
    ) -> Option<T> {
        match table.and_then(|table| table.field(key)) {
            Some(field) => read(self, field),
            None => Some(default),
        }
    }
}
