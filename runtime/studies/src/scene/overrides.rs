//! Overrides from the command line: `--set solver.tolerance=1e-8`.
//!
//! A key is dotted; entries of arrays are counted from 0, as in `prescribe.0.u`. A value is TOML; a
//! bare word or expression that is not TOML is taken as a string, so that shells need no quotes.

use piola_grammar::{Diagnostic, Span};

use super::source::Sources;
use super::tree::{self, Entry, Kind, Node};

/// Of these keys an override of one replaces the other.
const ALTERNATIVES: [[&str; 2]; 2] = [["spacings", "radius"], ["force", "density"]];

/// Applies one override to the tree of a scene and adds its text to the sources.
pub(super) fn apply(
    text: &str,
    root: &mut Vec<Entry>,
    sources: &mut Sources,
) -> Result<(), Box<Diagnostic>> {
    let base = sources.push(&format!("--set {text}"), text);
    let whole = Span::new(base, base + text.len());
    let Some(equals) = text.find('=') else {
        return Err(bad(whole, "an override is KEY=VALUE"));
    };
    let path = path(&text[..equals], base)?;
    let value = value(text, equals + 1, base)?;
    // Arrays are counted from the top, so the top is walked as if it were a table.
    let mut top = Node { span: whole, kind: Kind::Table(std::mem::take(root)) };
    let result = insert(&mut top, &path, value, sources);
    if let Kind::Table(entries) = top.kind {
        *root = entries;
    }
    result
}

/// A part of a dotted key and its place.
struct Part<'a> {
    name: &'a str,
    span: Span,
}

fn bad(span: Span, message: impl Into<String>) -> Box<Diagnostic> {
    let diagnostic = Diagnostic::error("bad-override", span, message);
    Box::new(diagnostic.help("overrides are like solver.tolerance=1e-8 or prescribe.0.u.1=free"))
}

fn path(key: &str, base: usize) -> Result<Vec<Part<'_>>, Box<Diagnostic>> {
    let mut start = base;
    let mut parts = Vec::new();
    for raw in key.split('.') {
        let leading = raw.len() - raw.trim_start().len();
        let name = raw.trim();
        let span = Span::new(start + leading, start + leading + name.len());
        start += raw.len() + 1;
        if name.is_empty() {
            return Err(bad(span, "a key has no empty parts"));
        }
        let unquoted = name.strip_prefix('"').and_then(|name| name.strip_suffix('"'));
        parts.push(Part { name: unquoted.unwrap_or(name), span });
    }
    if parts.len() > 8 {
        let span = parts[0].span.to(parts[parts.len() - 1].span);
        return Err(bad(span, "this key has too many parts"));
    }
    Ok(parts)
}

fn value(text: &str, start: usize, base: usize) -> Result<Node, Box<Diagnostic>> {
    let raw = &text[start..];
    let value = raw.trim();
    let from = base + start + (raw.len() - raw.trim_start().len());
    let span = Span::new(from, from + value.len());
    if value.is_empty() {
        return Err(bad(span, "the override has no value"));
    }
    match tree::parse_value(value, from) {
        Ok(node) => Ok(node),
        Err(diagnostic) if value.starts_with(['[', '{', '"', '\'']) => Err(diagnostic),
        Err(_) => Ok(tree::bare_text(value, span)),
    }
}

/// Puts a value at a path, making tables on the way.
fn insert(
    node: &mut Node,
    path: &[Part<'_>],
    value: Node,
    sources: &Sources,
) -> Result<(), Box<Diagnostic>> {
    let Some((part, rest)) = path.split_first() else {
        *node = value;
        return Ok(());
    };
    let kind = node.kind_name();
    match &mut node.kind {
        Kind::Table(entries) => insert(entry(entries, part, rest, sources), rest, value, sources),
        Kind::Array(items) => {
            let count = items.len();
            match part.name.parse::<usize>() {
                Ok(index) if index < count => insert(&mut items[index], rest, value, sources),
                Ok(index) if index == count => {
                    items.push(empty(part.span, rest));
                    insert(&mut items[index], rest, value, sources)
                }
                _ => {
                    Err(bad(part.span, format!("entries are counted from 0; {count} appends one")))
                }
            }
        }
        _ => {
            let message = format!("there is no `{}` in {kind}", part.name);
            Err(bad(part.span, message))
        }
    }
}

/// The value of a key, made if it is not there.
fn entry<'e>(
    entries: &'e mut Vec<Entry>,
    part: &Part<'_>,
    rest: &[Part<'_>],
    sources: &Sources,
) -> &'e mut Node {
    for pair in ALTERNATIVES.iter().filter(|pair| pair.contains(&part.name)) {
        let replaced = |e: &Entry| {
            e.key != part.name && pair.contains(&e.key.as_str()) && sources.is_in_file(e.key_span)
        };
        entries.retain(|entry| !replaced(entry));
    }
    let index = entries.iter().position(|entry| entry.key == part.name).unwrap_or_else(|| {
        let node = empty(part.span, rest);
        entries.push(Entry { key: part.name.into(), key_span: part.span, node });
        entries.len() - 1
    });
    &mut entries[index].node
}

/// What a new key or entry starts as: an array if the key goes on with a number, else a table.
fn empty(span: Span, rest: &[Part<'_>]) -> Node {
    let counts = rest.first().is_some_and(|part| part.name.parse::<usize>().is_ok());
    Node { span, kind: if counts { Kind::Array(Vec::new()) } else { Kind::Table(Vec::new()) } }
}
