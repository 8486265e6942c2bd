//! The texts that an editor has open, and places in them as the protocol counts.

use std::path::{Path, PathBuf};

use lsp_types::{Position, PositionEncodingKind, Range, TextDocumentContentChangeEvent, Uri};
use piola_grammar::Span;

use crate::render;

/// In what the columns of an editor are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Utf8,
    Utf16,
}

impl Encoding {
    /// Bytes where the editor knows them, else what every editor knows.
    pub(super) fn of(offered: &[PositionEncodingKind]) -> Encoding {
        if offered.contains(&PositionEncodingKind::UTF8) { Encoding::Utf8 } else { Encoding::Utf16 }
    }

    pub(super) fn kind(self) -> PositionEncodingKind {
        match self {
            Encoding::Utf8 => PositionEncodingKind::UTF8,
            Encoding::Utf16 => PositionEncodingKind::UTF16,
        }
    }

    fn width(self, c: char) -> usize {
        match self {
            Encoding::Utf8 => c.len_utf8(),
            Encoding::Utf16 => c.len_utf16(),
        }
    }
}

/// What an open text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Potential,
    /// A TOML file with the tables of a scene.
    Scene,
    /// Nothing of piola.
    Other,
}

/// An open text.
#[derive(Clone, Debug)]
pub(super) struct Document {
    pub(super) uri: Uri,
    /// Where it is, or would be.
    pub(super) path: PathBuf,
    pub(super) text: String,
    pub(super) version: i32,
    /// Whether looking for lints took long.
    pub(super) lints_slowly: bool,
    encoding: Encoding,
    /// The bytes at which its lines begin.
    lines: Vec<usize>,
}

impl Document {
    pub(super) fn new(uri: Uri, text: String, version: i32, encoding: Encoding) -> Document {
        let lines = line_starts(&text);
        Document { path: path_of(&uri), uri, text, version, lints_slowly: false, encoding, lines }
    }

    /// The name that messages call it.
    pub(super) fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// Where files that it names stand.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }

    /// A scene is told by its tables: other TOML files are no business of ours.
    pub(super) fn kind(&self) -> Kind {
        let is_table = |line: &str| {
            super::scene::head_of(line)
                .is_some_and(|name| ["body", "horizon", "material"].contains(&name))
        };
        match self.path.extension().and_then(|end| end.to_str()) {
            Some("toml") if self.text.lines().any(is_table) => Kind::Scene,
            Some("toml") => Kind::Other,
            _ => Kind::Potential,
        }
    }

    /// Takes over what was typed.
    pub(super) fn change(&mut self, change: TextDocumentContentChangeEvent) {
        match change.range {
            None => self.text = change.text,
            Some(range) => {
                let (start, end) = (self.offset(range.start), self.offset(range.end));
                self.text.replace_range(start.min(end)..end.max(start), &change.text);
            }
        }
        self.lines = line_starts(&self.text);
    }

    /// The byte of a place; one behind its line or the text is at their end.
    pub(super) fn offset(&self, position: Position) -> usize {
        let number = position.line as usize;
        let Some(start) = self.lines.get(number).copied() else { return self.text.len() };
        let end = self.lines.get(number + 1).copied().unwrap_or(self.text.len());
        let mut column = 0;
        for (at, c) in self.text[start..end].char_indices() {
            if column >= position.character as usize || matches!(c, '\n' | '\r') {
                return start + at;
            }
            column += self.encoding.width(c);
        }
        end
    }

    /// The place of a byte.
    pub(super) fn position(&self, offset: usize) -> Position {
        let offset = self.text.floor_char_boundary(offset.min(self.text.len()));
        let line = self.lines.partition_point(|start| *start <= offset) - 1;
        let before = self.text[self.lines[line]..offset].chars();
        let column: usize = before.map(|c| self.encoding.width(c)).sum();
        Position::new(line as u32, column as u32)
    }

    pub(super) fn range(&self, span: Span) -> Range {
        Range::new(self.position(span.start as usize), self.position(span.end as usize))
    }

    /// All of it.
    pub(super) fn whole(&self) -> Range {
        self.range(Span::new(0, self.text.len()))
    }

    /// The line of a byte, up to there.
    pub(super) fn line_before(&self, offset: usize) -> &str {
        let start = self.text[..offset].rfind('\n').map_or(0, |at| at + 1);
        &self.text[start..offset]
    }
}

fn line_starts(text: &str) -> Vec<usize> {
    let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
    std::iter::once(0).chain(ends.map(|(at, _)| at + 1)).collect()
}

/// The file of an address; of one that is no file's, what follows its scheme.
fn path_of(uri: &Uri) -> PathBuf {
    let text = uri.as_str();
    let path =
        text.strip_prefix("file://").or(text.split_once(':').map(|(_, rest)| rest)).unwrap_or(text);
    let mut bytes = Vec::with_capacity(path.len());
    let mut rest = path.as_bytes();
    while let [first, more @ ..] = rest {
        let code = more.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()).filter(|_| *first == b'%') {
            Some(byte) => {
                bytes.push(byte);
                rest = &more[2..];
            }
            None => {
                bytes.push(*first);
                rest = more;
            }
        }
    }
    let path = String::from_utf8_lossy(&bytes).into_owned();
    // `/c:/folder` of Windows.
    let has_drive = path.as_bytes().get(2) == Some(&b':') && path.starts_with('/');
    PathBuf::from(if has_drive { &path[1..] } else { &path })
}

/// The address of a file.
pub(super) fn uri_of(path: &Path) -> Option<Uri> {
    let path = std::path::absolute(path).ok()?;
    let name = render::uri(&path.display().to_string());
    let slash = if name.starts_with('/') { "" } else { "/" };
    format!("file://{slash}{name}").parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(text: &str, encoding: Encoding) -> Document {
        Document::new("file:///a%20b/law.piola".parse().unwrap(), text.to_string(), 1, encoding)
    }

    #[test]
    fn places_go_there_and_back_in_both_encodings() {
        let text = "λ = 1\r\n𝛼 = \"ß\"\n";
        for encoding in [Encoding::Utf8, Encoding::Utf16] {
            let document = document(text, encoding);
            assert_eq!(document.path, Path::new("/a b/law.piola"));
            for (offset, _) in text.char_indices().filter(|(_, c)| !matches!(c, '\n' | '\r')) {
                assert_eq!(document.offset(document.position(offset)), offset, "{offset}");
            }
            let column = if encoding == Encoding::Utf8 { 4 } else { 2 };
            assert_eq!(document.position(text.find(" = \"").unwrap()), Position::new(1, column));
            assert_eq!(document.offset(Position::new(0, 99)), "λ = 1".len());
            assert_eq!(document.offset(Position::new(9, 0)), text.len());
        }
        assert_eq!(
            uri_of(Path::new("/a b/law.piola")).unwrap().as_str(),
            "file:///a%20b/law.piola"
        );
    }

    #[test]
    fn changes_are_taken_over() {
        let mut one = document("psi(l) = 1\n", Encoding::Utf16);
        let at = |line, column| Position::new(line, column);
        let mut change = |from, to, text: &str| {
            one.change(TextDocumentContentChangeEvent {
                range: Some(Range::new(from, to)),
                range_length: None,
                text: text.to_string(),
            });
            one.text.clone()
        };
        assert_eq!(change(at(0, 9), at(0, 10), "λ\n+"), "psi(l) = λ\n+\n");
        assert_eq!(change(at(1, 0), at(1, 1), ""), "psi(l) = λ\n\n");
        assert_eq!(change(at(0, 0), at(2, 0), "x"), "x");
    }
}
