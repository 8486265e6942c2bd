//! The TOML tree of a scene: owned, with a place on every key and value, open to overrides.

use piola_grammar::{Diagnostic, Span};
use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};

/// A value and its place.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) span: Span,
    pub(super) kind: Kind,
}

/// The kinds of value that TOML knows.
#[derive(Clone, Debug)]
pub(super) enum Kind {
    Text(Text),
    /// `whole` is set if it was written as an integer and fits 64 bits.
    Number {
        value: f64,
        whole: Option<i64>,
    },
    Boolean(bool),
    Date,
    Array(Vec<Node>),
    Table(Vec<Entry>),
}

/// A string without its quotes.
#[derive(Clone, Debug)]
pub(super) struct Text {
    pub(super) value: String,
    /// Place of what stands between the quotes.
    pub(super) content: Span,
    /// Whether the bytes between the quotes are those of `value`: no escapes.
    pub(super) verbatim: bool,
}

/// A key with its value.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) key_span: Span,
    pub(super) node: Node,
}

impl Node {
    /// What it is, with its article, for messages.
    pub(super) fn kind_name(&self) -> &'static str {
        match &self.kind {
            Kind::Text(_) => "a string",
            Kind::Number { .. } => "a number",
            Kind::Boolean(_) => "a boolean",
            Kind::Date => "a date",
            Kind::Array(_) => "an array",
            Kind::Table(_) => "a table",
        }
    }
}

/// A string that stands unquoted at `content`.
pub(super) fn bare_text(value: &str, content: Span) -> Node {
    let text = Text { value: value.into(), content, verbatim: true };
    Node { span: content, kind: Kind::Text(text) }
}

/// More parts in one dotted key would nest deeper than the parser's recursion may go.
const MAX_KEY_PARTS: usize = 256;

/// Nobody reads more mistakes of syntax than these.
const MAX_SYNTAX_ERRORS: usize = 100;

/// Parses a document; the mistakes of syntax are reported, one per line.
pub(super) fn parse_document(text: &str) -> Result<Vec<Entry>, Vec<Diagnostic>> {
    if let Some(diagnostic) = endless_key(text) {
        return Err(vec![diagnostic]);
    }
    let (table, errors) = DeTable::parse_recoverable(text);
    if !errors.is_empty() {
        return Err(first_per_line(text, errors));
    }
    Ok(entries(table.get_ref(), text, 0))
}

/// Parses one value that begins at `base` of the scene's spans.
pub(super) fn parse_value(text: &str, base: usize) -> Result<Node, Box<Diagnostic>> {
    if let Some(diagnostic) = endless_key(text) {
        return Err(Box::new(diagnostic.shifted(base)));
    }
    let (value, errors) = DeValue::parse_recoverable(text);
    match errors.first() {
        Some(error) => Err(Box::new(syntax_error(error, text).shifted(base))),
        None => Ok(node(&value, text, base)),
    }
}

/// Finds a chain of [`MAX_KEY_PARTS`] dots without a separator.
fn endless_key(text: &str) -> Option<Diagnostic> {
    let (mut start, mut dots) = (0, 0);
    for (i, byte) in text.bytes().enumerate() {
        match byte {
            b'.' => dots += 1,
            b',' | b'=' | b'[' | b']' | b'{' | b'}' | b'#' | b'\n' => (start, dots) = (i + 1, 0),
            _ => {}
        }
        if dots >= MAX_KEY_PARTS {
            let span = Span::new(start, i + 1);
            let message = "this key has far too many parts";
            let diagnostic = Diagnostic::error("toml-syntax", span, message);
            return Some(diagnostic.help("a scene nests three levels deep"));
        }
    }
    None
}

/// One mistake often brings others on its line: only the first is worth reading.
fn first_per_line(text: &str, mut errors: Vec<Error>) -> Vec<Diagnostic> {
    errors.sort_by_key(|error| error.span().map_or(text.len(), |span| span.start));
    let mut line_end = 0;
    let mut found: Vec<Diagnostic> = Vec::new();
    for error in &errors {
        let diagnostic = syntax_error(error, text);
        let start = diagnostic.span.start as usize;
        if !found.is_empty() && start < line_end {
            continue;
        }
        line_end = text[start..].find('\n').map_or(text.len(), |newline| start + newline) + 1;
        found.push(diagnostic);
        if found.len() == MAX_SYNTAX_ERRORS {
            break;
        }
    }
    found
}

fn syntax_error(error: &Error, text: &str) -> Diagnostic {
    let range = error.span().unwrap_or(text.len()..text.len());
    let start = text.floor_char_boundary(range.start);
    let end = text.ceil_char_boundary(range.end).max(start);
    let span = Span::new(start, end);
    let message = error.message();
    if message.contains("duplicate key") {
        return Diagnostic::error(
            "duplicate-key",
            span,
            "this key stands here for the second time",
        )
        .help("keep one of the two; point sets need different names");
    }
    let line_start = text[..start].rfind('\n').map_or(0, |newline| newline + 1);
    let line_end = text[start..].find('\n').map_or(text.len(), |newline| start + newline);
    let diagnostic = Diagnostic::error("toml-syntax", span, message);
    if text[start..].starts_with(':') && !text[line_start..start].contains('"') {
        let key = text[line_start..start].split(['{', ',']).next_back().unwrap_or_default().trim();
        return diagnostic.help(format!("a key and its value are joined by `=`: {key} = .."));
    }
    match text[line_start..line_end].split_once('=') {
        Some((_, value)) if value.trim_start().starts_with(|c: char| c.is_ascii_digit()) => {
            diagnostic.help("a number stands alone, without a unit: lengths are in m, forces in N")
        }
        Some((_, value)) if value.contains(char::is_alphabetic) => {
            diagnostic.help("names and expressions stand in quotes: u = [\"0.1*t\", 0]")
        }
        _ => diagnostic,
    }
}

fn entries(table: &DeTable<'_>, text: &str, base: usize) -> Vec<Entry> {
    let mut entries: Vec<Entry> = table
        .iter()
        .map(|(key, value)| Entry {
            key: key.get_ref().to_string(),
            key_span: Span::new(key.span().start, key.span().end).shifted(base),
            node: node(value, text, base),
        })
        .collect();
    // The parser sorts by name; point sets are reported in the order of the file.
    entries.sort_by_key(|entry| entry.key_span);
    entries
}

fn node(value: &Spanned<DeValue<'_>>, text: &str, base: usize) -> Node {
    let range = value.span();
    let kind = match value.get_ref() {
        DeValue::String(string) => Kind::Text(unquote(string, text, range.clone(), base)),
        DeValue::Integer(integer) => {
            let whole = i64::from_str_radix(integer.as_str(), integer.radix()).ok();
            let value = whole.map_or_else(
                || integer.as_str().parse().unwrap_or(f64::INFINITY),
                |whole| whole as f64,
            );
            Kind::Number { value, whole }
        }
        DeValue::Float(float) => {
            Kind::Number { value: float.as_str().parse().unwrap_or(f64::NAN), whole: None }
        }
        DeValue::Boolean(value) => Kind::Boolean(*value),
        DeValue::Datetime(_) => Kind::Date,
        DeValue::Array(array) => {
            Kind::Array(array.iter().map(|item| node(item, text, base)).collect())
        }
        DeValue::Table(table) => Kind::Table(entries(table, text, base)),
    };
    Node { span: Span::new(range.start, range.end).shifted(base), kind }
}

/// Finds the content between the quotes of the string that stands at `range` of `text`.
fn unquote(value: &str, text: &str, range: std::ops::Range<usize>, base: usize) -> Text {
    let raw = text.get(range.clone()).unwrap_or("");
    let quotes = if raw.starts_with("\"\"\"") || raw.starts_with("'''") { 3 } else { 1 };
    let mut inside = raw.get(quotes..raw.len().saturating_sub(quotes)).unwrap_or("");
    let mut start = range.start + quotes;
    if quotes == 3 {
        // The newline right after three quotes is not part of the string.
        let after = inside.strip_prefix("\r\n").or(inside.strip_prefix('\n')).unwrap_or(inside);
        start += inside.len() - after.len();
        inside = after;
    }
    Text {
        value: value.into(),
        content: Span::new(start, start + inside.len()).shifted(base),
        verbatim: inside == value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn only_text(document: &str) -> Text {
        match parse_document(document).unwrap().remove(0).node.kind {
            Kind::Text(text) => text,
            other => panic!("{other:?} is not a string"),
        }
    }

    #[test]
    fn the_content_of_every_kind_of_string_is_found() {
        for document in [
            "a = \"X < 1\"",
            "a = 'X < 1'",
            "a = \"\"\"X < 1\"\"\"",
            "a = \"\"\"\nX < 1\"\"\"",
            "a = '''\r\nX < 1'''",
        ] {
            let text = only_text(document);
            assert_eq!(&document[text.content.range()], "X < 1", "{document}");
            assert!(text.verbatim, "{document}");
        }
        assert!(!only_text("a = \"X \\u003C 1\"").verbatim);
    }

    #[test]
    fn numbers_keep_whether_they_were_whole() {
        let entries = parse_document("a = 1_000\nb = 1e3\nc = 99999999999999999999\nd = 0x10");
        let numbers: Vec<(f64, Option<i64>)> = entries
            .unwrap()
            .iter()
            .map(|entry| match entry.node.kind {
                Kind::Number { value, whole } => (value, whole),
                _ => panic!("{} is not a number", entry.key),
            })
            .collect();
        let expected = [(1000.0, Some(1000)), (1000.0, None), (1e20, None), (16.0, Some(16))];
        assert_eq!(numbers, expected);
    }

    #[test]
    fn keys_keep_the_order_of_the_file() {
        let entries = parse_document("z = 1\na = 2\nm = 3").unwrap();
        let keys: Vec<&str> = entries.iter().map(|entry| entry.key.as_str()).collect();
        assert_eq!(keys, ["z", "a", "m"]);
    }

    #[test]
    fn every_line_with_a_mistake_is_reported_once() {
        let found = parse_document("a = [0, 0.1*t]\nb = 1\nc = uniform\n").unwrap_err();
        let lines: Vec<u32> = found.iter().map(|diagnostic| diagnostic.span.start).collect();
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(lines[0] < 15 && lines[1] > 20, "{found:?}");
        assert!(found.iter().all(|diagnostic| !diagnostic.helps.is_empty()));
    }

    #[test]
    fn a_megabyte_of_mistakes_is_cut_short() {
        let found = parse_document(&"= 1\n".repeat(250_000)).unwrap_err();
        assert_eq!(found.len(), MAX_SYNTAX_ERRORS);
    }

    #[test]
    fn endless_nesting_is_refused_without_recursion() {
        let keys = format!("{} = 1", vec!["a"; 100_000].join("."));
        assert_eq!(parse_document(&keys).unwrap_err()[0].code, "toml-syntax");
        let header = format!("[{}]\nb = 1", vec!["a"; 100_000].join(" . "));
        assert_eq!(parse_document(&header).unwrap_err()[0].code, "toml-syntax");
        let key = vec!["a"; 100_000].join(".");
        assert_eq!(parse_value(&format!("{{{key} = 1}}"), 0).unwrap_err().code, "toml-syntax");
        let arrays = format!("a = {}{}", "[".repeat(100_000), "]".repeat(100_000));
        assert_eq!(parse_document(&arrays).unwrap_err()[0].code, "toml-syntax");
    }
}
