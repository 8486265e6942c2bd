//! Lines of an input file: keywords with their parameters, lines of data below them.

use crate::error::MeshError;
use crate::scan::{Line, Scan, shown};

/// The lines of a file without comments.
pub(super) struct Cards<'a> {
    scan: Scan<'a>,
    /// The next line, if it was read too early.
    kept: Option<Line<'a>>,
}

/// `*Name, parameter=value, parameter`
pub(super) struct Keyword<'a> {
    /// In lower case, with single spaces.
    pub(super) name: String,
    /// Names in lower case.
    parameters: Vec<(String, String)>,
    pub(super) line: Line<'a>,
}

impl<'a> Cards<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Cards<'a> {
        Cards { scan: Scan::new(bytes), kept: None }
    }

    fn next_line(&mut self) -> Option<Line<'a>> {
        if let Some(line) = self.kept.take() {
            return Some(line);
        }
        loop {
            let line = self.scan.filled_line()?;
            if !line.text.starts_with(b"**") {
                return Some(line);
            }
        }
    }

    /// The next line of data; none before the next keyword.
    pub(super) fn next_data(&mut self) -> Option<Line<'a>> {
        let line = self.next_line()?;
        if line.text.starts_with(b"*") {
            self.kept = Some(line);
            return None;
        }
        Some(line)
    }

    /// The next keyword; lines of data before it are passed over.
    pub(super) fn next_keyword(&mut self) -> Result<Option<Keyword<'a>>, MeshError> {
        loop {
            let Some(line) = self.next_line() else { return Ok(None) };
            if line.text.starts_with(b"*") {
                return self.keyword(line).map(Some);
            }
            if self.is_at_start(&line) {
                let message = "the file does not begin with a keyword, `*Heading` or another";
                return Err(
                    MeshError::broken(line.range(), message).help("it is no input file of Abaqus")
                );
            }
        }
    }

    fn is_at_start(&self, line: &Line<'_>) -> bool {
        !self.scan.bytes[..line.start].contains(&b'*')
    }

    fn keyword(&mut self, line: Line<'a>) -> Result<Keyword<'a>, MeshError> {
        let mut text = text(&line)?.to_string();
        // A keyword's line that ends with a comma goes on.
        while text.ends_with(',') {
            match self.next_data() {
                Some(more) => text += self::text(&more)?,
                None => break,
            }
        }
        let mut parts = text[1..].split(',').map(str::trim);
        let name = parts.next().unwrap_or_default().to_lowercase();
        let name = name.split_whitespace().collect::<Vec<&str>>().join(" ");
        let parameter = |part: &str| {
            let (name, value) = part.split_once('=').unwrap_or((part, ""));
            let value = value.trim().trim_matches('"');
            (name.trim().to_lowercase().replace(' ', ""), value.to_string())
        };
        let parameters = parts.filter(|part| !part.is_empty()).map(parameter).collect();
        Ok(Keyword { name, parameters, line })
    }
}

/// A line as text.
pub(super) fn text<'a>(line: &Line<'a>) -> Result<&'a str, MeshError> {
    std::str::from_utf8(line.text)
        .map_err(|_| MeshError::broken(line.range(), "this line is no text").in_binary())
}

impl Keyword<'_> {
    /// The value of a parameter; empty where it has none.
    pub(super) fn value(&self, name: &str) -> Option<&str> {
        let found = self.parameters.iter().find(|(own, _)| own == name);
        found.map(|(_, value)| value.as_str())
    }

    /// The same of one that must be there.
    pub(super) fn required(&self, name: &str) -> Result<&str, MeshError> {
        self.value(name).filter(|value| !value.is_empty()).ok_or_else(|| {
            let message = format!("`*{}` has no `{name}=`", shown(&self.name));
            MeshError::broken(self.line.range(), message)
        })
    }
}
