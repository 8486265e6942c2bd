//! Words, numbers and lines of a file, as text or binary.

use crate::error::MeshError;

/// A file and how far it is read.
pub(crate) struct Scan<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) at: usize,
    /// Whether numbers are binary, little endian.
    pub(crate) binary: bool,
    /// Whether the words of text that follow stand in the line that is reached.
    pub(crate) in_row: bool,
}

/// A line without its end, and where it begins.
#[derive(Clone, Copy)]
pub(crate) struct Line<'a> {
    pub(crate) text: &'a [u8],
    pub(crate) start: usize,
}

impl Line<'_> {
    pub(crate) fn range(&self) -> (usize, usize) {
        (self.start, self.start + self.text.len())
    }
}

impl<'a> Scan<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Scan<'a> {
        Scan { bytes, at: 0, binary: false, in_row: false }
    }

    /// The rest of the line that is being read, without white space around it.
    pub(crate) fn line(&mut self) -> Option<Line<'a>> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        let length = rest.iter().position(|byte| *byte == b'\n');
        let text = &rest[..length.unwrap_or(rest.len())];
        let start = self.at + text.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        self.at += length.map_or(rest.len(), |length| length + 1);
        Some(Line { text: text.trim_ascii(), start })
    }

    /// The next line that is not blank.
    pub(crate) fn filled_line(&mut self) -> Option<Line<'a>> {
        loop {
            let line = self.line()?;
            if !line.text.is_empty() {
                return Some(line);
            }
        }
    }

    /// The first byte from `start` that is no white space of text.
    pub(crate) fn trimmed(&self, start: usize) -> usize {
        let is_space = |byte: &&u8| !self.binary && byte.is_ascii_whitespace();
        start + self.bytes[start..].iter().take_while(is_space).count()
    }

    /// An error at the place that is reached.
    pub(crate) fn error(&self, message: impl Into<String>) -> MeshError {
        let at = self.at.min(self.bytes.len());
        self.marked(MeshError::broken((at, at), message))
    }

    fn marked(&self, error: MeshError) -> MeshError {
        if self.binary { error.in_binary() } else { error }
    }

    fn ended(&self, what: &str) -> MeshError {
        let end = self.bytes.len();
        let message = format!("the file ends where {what} should stand");
        self.marked(MeshError::broken((end, end), message))
            .help("it was cut: write or copy it again")
    }

    /// So many bytes.
    fn take(&mut self, length: usize, what: &str) -> Result<&'a [u8], MeshError> {
        let bytes = self.bytes.get(self.at..).and_then(|rest| rest.get(..length));
        let bytes = bytes.ok_or_else(|| self.ended(what))?;
        self.at += length;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], MeshError> {
        let bytes = self.take(N, what)?;
        let mut array = [0; N];
        array.copy_from_slice(bytes);
        Ok(array)
    }

    /// The next word of text and where it stands.
    pub(crate) fn word(&mut self, what: &str) -> Result<(&'a str, (usize, usize)), MeshError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let skipped = rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        if let Some(end) = rest[..skipped].iter().position(|byte| self.in_row && *byte == b'\n') {
            let message = format!("the line ends where {what} should stand");
            return Err(MeshError::broken((self.at + end, self.at + end), message));
        }
        let word = &rest[skipped..];
        let length = word.iter().take_while(|byte| !byte.is_ascii_whitespace()).count();
        if length == 0 {
            return Err(self.ended(what));
        }
        let range = (self.at + skipped, self.at + skipped + length);
        let Ok(word) = std::str::from_utf8(&word[..length]) else {
            let message = format!("{what} should stand here, not bytes that are no text");
            return Err(MeshError::broken(range, message).in_binary());
        };
        self.at = range.1;
        Ok((word, range))
    }

    fn parsed<T: std::str::FromStr>(&mut self, what: &str, kind: &str) -> Result<T, MeshError> {
        let (word, range) = self.word(what)?;
        word.parse().map_err(|_| {
            let message = format!("{what} should stand here, {kind}, not `{}`", shown(word));
            MeshError::broken(range, message)
        })
    }

    /// A finite number; 8 bytes.
    pub(crate) fn float(&mut self, what: &str) -> Result<f64, MeshError> {
        let start = self.at;
        let value: f64 = match self.binary {
            true => f64::from_le_bytes(self.array(what)?),
            false => self.parsed(what, "a number")?,
        };
        if value.is_finite() {
            return Ok(value);
        }
        let message = format!("{what} is {value}: it must be a finite number");
        Err(self.marked(MeshError::broken((start, self.at), message)))
    }

    /// A whole number; 4 bytes.
    pub(crate) fn int(&mut self, what: &str) -> Result<i64, MeshError> {
        match self.binary {
            true => Ok(i64::from(i32::from_le_bytes(self.array(what)?))),
            false => self.parsed(what, "a whole number"),
        }
    }

    /// A count or a tag; 8 bytes.
    pub(crate) fn size(&mut self, what: &str) -> Result<u64, MeshError> {
        match self.binary {
            true => Ok(u64::from_le_bytes(self.array(what)?)),
            false => self.parsed(what, "a whole number that is not negative"),
        }
    }

    /// How many things follow, of so many bytes each at least.
    pub(crate) fn count(&self, count: u64, bytes: usize, what: &str) -> Result<usize, MeshError> {
        let left = self.bytes.len().saturating_sub(self.at);
        let fits = usize::try_from(count).ok().filter(|count| *count <= left / bytes.max(1));
        fits.ok_or_else(|| {
            let message =
                format!("{count} {what} are announced, and {left} bytes are left for them");
            self.error(message).help("the file was cut, or the count is wrong")
        })
    }

    /// Leaves `bytes` out.
    pub(crate) fn skip(&mut self, count: u64, bytes: usize, what: &str) -> Result<(), MeshError> {
        if self.binary {
            let count = self.count(count, bytes, what)?;
            self.at += count * bytes;
            return Ok(());
        }
        let count = self.count(count, 2, what)?;
        for _ in 0..count {
            self.word(what)?;
        }
        Ok(())
    }
}

/// The start of a word of a file.
pub(crate) fn shown(word: &str) -> String {
    let short: String = word.chars().take(40).filter(|c| !c.is_control()).collect();
    if short.len() < word.len() { short + ".." } else { short }
}
