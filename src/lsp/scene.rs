//! Tables, keys, words and sets of a scene: what they mean, which could stand at a place.

use lsp_types::{
    CompletionItem, CompletionItemKind, Hover, HoverContents, Location, MarkupContent, MarkupKind,
};
use piola_compiler::check_text_with;
use piola_grammar::Span;
use piola_runtime::scene::{KeyWords, TableWords, ValueWords, files_below, vocabulary};

use super::text::{Document, uri_of};
use crate::library;
use crate::pages::{self, SCENES, plain};

/// Keys whose values are names of sets, alone or in an array.
const OF_SETS: [&str; 3] = ["set", "between", "unbreakable"];

/// Where a place is.
struct Place<'d> {
    /// The table, `body` or `material.plus`; empty before the first.
    table: &'d str,
    /// The key before `=`; empty where there is none yet.
    key: &'d str,
    /// The key of the braces that are open, `parameters = {`.
    inner: Option<&'d str>,
    /// Whether it is inside quotes.
    in_quotes: bool,
}

impl<'d> Place<'d> {
    fn of(document: &'d Document, at: usize) -> Place<'d> {
        let line = document.line_before(at);
        let above = &document.text[..at - line.len()];
        let table = above.lines().rev().find_map(head_of).unwrap_or("");
        let in_quotes = line.matches('"').count() % 2 == 1;
        match line.rfind('{').filter(|open| !line[*open..].contains('}')) {
            Some(open) => {
                let last = line[open + 1..].rsplit(',').next().unwrap_or("");
                Place { table, key: key_of(last), inner: Some(key_of(&line[..open])), in_quotes }
            }
            None => Place { table, key: key_of(line), inner: None, in_quotes },
        }
    }

    fn words(&self) -> Option<KeyWords> {
        let table = table_words(self.table)?;
        table.keys.into_iter().find(|key| key.name == self.key && self.inner.is_none())
    }
}

/// The table that a line begins, without blanks and comments.
pub(super) fn head_of(line: &str) -> Option<&str> {
    let line = line.split('#').next()?.trim();
    let inner = line.strip_prefix('[')?.strip_suffix(']')?;
    let name =
        inner.strip_prefix('[').and_then(|inner| inner.strip_suffix(']')).unwrap_or(inner).trim();
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    let is_name = name.starts_with(|c: char| c.is_ascii_alphabetic()) && name.chars().all(is_part);
    is_name.then_some(name)
}

/// The bytes of the table that a place is in, its head among them.
fn table_around(text: &str, at: usize) -> std::ops::Range<usize> {
    let (mut start, mut found) = (0, 0..text.len());
    for line in text.split_inclusive('\n') {
        if head_of(line).is_some() {
            if start > at {
                found.end = start;
                break;
            }
            found.start = start;
        }
        start += line.len();
    }
    found
}

fn key_of(part: &str) -> &str {
    part.split_once('=').map_or("", |(key, _)| key.trim())
}

fn table_words(name: &str) -> Option<TableWords> {
    vocabulary().into_iter().find(|table| table.name == name)
}

/// What the page of scenes says of a key.
fn meaning(table: &str, key: &str) -> Option<String> {
    let sections = pages::sections(SCENES);
    let own = sections.iter().filter(|section| section.table() == Some(table));
    let row = own.flat_map(|section| section.rows("key")).find(|row| row.name == key)?;
    let default = row.default().map_or(String::new(), |default| format!(" (default `{default}`)"));
    Some(plain(row.meaning) + &default)
}

fn summary(table: &str) -> String {
    let sections = pages::sections(SCENES);
    let own = sections.iter().find(|section| section.table() == Some(table));
    own.map_or(String::new(), |section| section.summary().to_string())
}

pub(super) fn hover(document: &Document, at: usize) -> Option<Hover> {
    let span = word_at(&document.text, at);
    let word = &document.text[span.range()];
    let place = Place::of(document, at);
    let before = document.line_before(span.start as usize);
    let line = &document.text[at - document.line_before(at).len()..];
    let line = line.lines().next().unwrap_or("");
    let value = if let Some(table) = head_of(line) {
        format!("`[{table}]`: {}", summary(table))
    } else if place.in_quotes && place.key == "potential" {
        of_potential(document, word)?
    } else if before.trim().is_empty() {
        format!("`{word}`: {}", meaning(place.table, word)?)
    } else if place.inner.is_some_and(|inner| inner == "parameters") {
        format!("```piola\n{}\n```", parameter(document, at, word)?)
    } else {
        let own = sets(document).into_iter().find(|(name, _)| name == word)?;
        let rest = document.text[own.1.start as usize..].lines().next()?;
        format!("```toml\n{rest}\n```")
    };
    let contents = HoverContents::Markup(MarkupContent { kind: MarkupKind::Markdown, value });
    Some(Hover { contents, range: Some(document.range(span)) })
}

/// The characters around a place that a name, a word or a file may have.
fn word_at(text: &str, at: usize) -> Span {
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | '/');
    let start = text[..at]
        .rfind(|c| !is_part(c))
        .map_or(0, |found| found + text[found..].chars().next().map_or(1, char::len_utf8));
    let end = text[at..].find(|c| !is_part(c)).map_or(text.len(), |found| at + found);
    Span::new(start, end)
}

/// The text of a potential of the library or of a file beside the scene.
fn text_of_potential(document: &Document, name: &str) -> Option<String> {
    match library::find(name) {
        Some(text) => Some(text.to_string()),
        None => files_below(document.folder())(name).ok(),
    }
}

fn of_potential(document: &Document, name: &str) -> Option<String> {
    Some(format!("```piola\n{}\n```", text_of_potential(document, name)?.trim_end()))
}

/// The potential of the table that a place is in.
fn potential_around(document: &Document, at: usize) -> Option<String> {
    let table = &document.text[table_around(&document.text, at)];
    let line = table.lines().find(|line| key_of(line) == "potential")?;
    text_of_potential(document, line.split('"').nth(1)?)
}

/// The declaration of a parameter of the potential around a place.
fn parameter(document: &Document, at: usize, name: &str) -> Option<String> {
    let text = potential_around(document, at)?;
    let is_it = |line: &&str| {
        let rest =
            line.strip_prefix("parameter ").and_then(|rest| rest.trim_start().strip_prefix(name));
        rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
    };
    text.lines().find(is_it).map(str::to_string)
}

pub(super) fn completion(document: &Document, at: usize) -> Vec<CompletionItem> {
    let place = Place::of(document, at);
    let line = document.line_before(at);
    if line.trim_start().starts_with('[') && !line.contains('=') {
        let tables = vocabulary().into_iter();
        return tables
            .map(|table| item(table.name, CompletionItemKind::MODULE, &summary(table.name), None))
            .collect();
    }
    if place.in_quotes {
        return words(document, &place);
    }
    if place.inner == Some("parameters") && place.key.is_empty() {
        let text = potential_around(document, at).unwrap_or_default();
        let Ok((_, model)) = check_text_with(&text, &files_below(document.folder())) else {
            return Vec::new();
        };
        let parameters = model.parameters().iter();
        return parameters
            .map(|one| {
                let said = one.description.clone().unwrap_or_default();
                item(&one.name, CompletionItemKind::FIELD, &said, Some(format!("{} = ", one.name)))
            })
            .collect();
    }
    if !line.contains('=') && place.inner.is_none() {
        return keys(document, &place, at);
    }
    // A value without its quotes.
    let quoted = words(document, &place).into_iter();
    quoted
        .map(|word| {
            let text = format!("\"{}\"", word.label);
            CompletionItem { insert_text: Some(text), ..word }
        })
        .collect()
}

/// Keys that the table has not yet.
fn keys(document: &Document, place: &Place<'_>, at: usize) -> Vec<CompletionItem> {
    let Some(table) = table_words(place.table) else { return Vec::new() };
    let around = &document.text[table_around(&document.text, at)];
    let given: Vec<&str> = around.lines().map(key_of).collect();
    let free = table.keys.iter().filter(|key| key.name != "*" && !given.contains(&key.name));
    free.map(|key| {
        let said = meaning(table.name, key.name).unwrap_or_default();
        let text = format!("{} = {}", key.name, key.example);
        item(key.name, CompletionItemKind::PROPERTY, &said, Some(text))
    })
    .collect()
}

/// Words that may be the value of a key.
fn words(document: &Document, place: &Place<'_>) -> Vec<CompletionItem> {
    let plain =
        |words: &[&str], kind| words.iter().map(|word| item(word, kind, "", None)).collect();
    if OF_SETS.contains(&place.key) {
        let sets = sets(document).into_iter();
        return sets.map(|(name, _)| item(&name, CompletionItemKind::VARIABLE, "", None)).collect();
    }
    if place.key == "potential" {
        let files = std::fs::read_dir(document.folder()).into_iter().flatten().flatten();
        let names = files.filter_map(|file| file.file_name().into_string().ok());
        let own = names.filter(|name| name.ends_with(".piola"));
        let mut all: Vec<CompletionItem> =
            own.map(|name| item(&name, CompletionItemKind::FILE, "", None)).collect();
        all.extend(
            library::LIBRARY.iter().map(|entry| {
                item(entry.name, CompletionItemKind::CLASS, &entry.kind.title(), None)
            }),
        );
        return all;
    }
    match place.words().map(|key| key.value) {
        Some(
            ValueWords::Word(words) | ValueWords::WordOrText(words) | ValueWords::Words(words),
        ) => plain(&words, CompletionItemKind::ENUM_MEMBER),
        Some(ValueWords::Seconds(Some(word))) => plain(&[word], CompletionItemKind::ENUM_MEMBER),
        _ => Vec::new(),
    }
}

fn item(
    label: &str,
    kind: CompletionItemKind,
    detail: &str,
    text: Option<String>,
) -> CompletionItem {
    CompletionItem {
        label: label.to_string(),
        kind: Some(kind),
        detail: (!detail.is_empty()).then(|| detail.to_string()),
        insert_text: text,
        ..CompletionItem::default()
    }
}

/// The sets that the scene defines, with the places of their names.
fn sets(document: &Document) -> Vec<(String, Span)> {
    let mut found = Vec::new();
    let (mut start, mut inside) = (0, false);
    for line in document.text.split_inclusive('\n') {
        if let Some(head) = head_of(line) {
            inside = head == "sets";
        } else if inside && !key_of(line).is_empty() && !line.trim_start().starts_with('#') {
            let name = key_of(line);
            let from = start + line.find(name).unwrap_or(0);
            found.push((name.to_string(), Span::new(from, from + name.len())));
        }
        start += line.len();
    }
    found
}

/// Every place of the set at a place.
pub(super) fn places(document: &Document, at: usize) -> Option<Vec<Span>> {
    let text = &document.text;
    let name = &text[word_at(text, at).range()];
    let (_, own) = sets(document).into_iter().find(|(set, _)| set == name)?;
    let mut found = vec![own];
    let quoted = format!("\"{name}\"");
    for (start, _) in text.match_indices(&quoted) {
        let line = document.line_before(start);
        let key = key_of(line.rsplit('{').next().unwrap_or(line));
        if OF_SETS.contains(&key) {
            found.push(Span::new(start + 1, start + 1 + name.len()));
        }
    }
    let here = |span: &Span| span.start as usize <= at && at <= span.end as usize;
    found.iter().any(here).then_some(found)
}

/// Whether a set may be called so.
pub(super) fn check_name(document: &Document, name: &str) -> Result<(), String> {
    let is_name = !name.is_empty()
        && name.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-'));
    if !is_name {
        return Err(format!("`{name}` is no name: letters, digits, `_` and `-`"));
    }
    match sets(document).iter().any(|(set, _)| set == name) {
        true => Err(format!("`{name}` is there already")),
        false => Ok(()),
    }
}

pub(super) fn definition(document: &Document, at: usize) -> Option<Location> {
    let place = Place::of(document, at);
    let word = &document.text[word_at(&document.text, at).range()];
    if matches!(place.key, "potential" | "points" | "mesh") {
        let path = document.folder().join(word);
        return path.is_file().then(|| Some(Location::new(uri_of(&path)?, Default::default())))?;
    }
    let span = *places(document, at)?.first()?;
    Some(Location::new(document.uri.clone(), document.range(span)))
}
