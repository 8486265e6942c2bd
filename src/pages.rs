//! The pages of the project that the program has inside, by their headings and tables.

pub(crate) const LANGUAGE: &str = include_str!("../grammar/LANGUAGE.md");
pub(crate) const SCENES: &str = include_str!("../docs/scenes.md");
pub(crate) const OUTPUT: &str = include_str!("../docs/output.md");

/// A part of a page under one heading.
pub(crate) struct Section {
    heading: &'static str,
    text: &'static str,
}

/// A row of a table of keys or fields.
pub(crate) struct Row {
    pub(crate) name: &'static str,
    default: &'static str,
    pub(crate) meaning: &'static str,
}

/// The parts of a page.
pub(crate) fn sections(page: &'static str) -> Vec<Section> {
    let mut all = Vec::new();
    for part in page.split("\n## ").skip(1) {
        for part in part.split("\n### ") {
            let (heading, text) = part.split_once('\n').unwrap_or((part, ""));
            all.push(Section { heading, text });
        }
    }
    all
}

/// The cells of a row; a meaning, the last of `n`, may have bars of its own.
fn cells(line: &str, n: usize) -> Vec<&str> {
    let inner = line.strip_prefix('|').and_then(|line| line.trim_end().strip_suffix('|'));
    inner.map_or(Vec::new(), |inner| inner.splitn(n, '|').map(str::trim).collect())
}

/// What stands between backquotes.
fn quoted(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

/// What the tables of a page say of a word: the first row whose first cell begins one of its names so.
pub(crate) fn meaning(page: &'static str, word: &str) -> Option<(String, String)> {
    let names = |code: &str| {
        let rest = code.strip_prefix(word)?;
        (!rest.starts_with(|c: char| c.is_alphanumeric() || c == '_')).then_some(())
    };
    let rows = page.lines().filter(|line| line.starts_with("| `"));
    let found = rows
        .map(|line| cells(line, usize::MAX))
        .find(|cells| quoted(cells[0]).any(|code| names(code).is_some()));
    found.map(|cells| (cells[0].to_string(), plain(&cells[1..].join("; "))))
}

/// A sentence without its links, whose targets are no places for who reads it elsewhere.
pub(crate) fn plain(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(start) = rest.find("](") {
        let (before, after) = (&rest[..start], &rest[start + 2..]);
        match (before.rfind('['), after.find(')')) {
            (Some(open), Some(end)) => {
                out.push_str(&before[..open]);
                out.push_str(&before[open + 1..]);
                rest = &after[end + 1..];
            }
            _ => {
                out.push_str(&rest[..start + 2]);
                rest = after;
            }
        }
    }
    out + rest
}

impl Section {
    /// The table of a scene that it is about.
    pub(crate) fn table(&self) -> Option<&'static str> {
        let code = self.heading.strip_prefix('`')?.split('`').next()?;
        let name = code.trim_matches(['[', ']']);
        (code.starts_with('[') && !name.is_empty()).then_some(name)
    }

    /// What the heading says of it.
    pub(crate) fn summary(&self) -> &'static str {
        self.heading.split_once(": ").map_or("", |(_, summary)| summary)
    }

    /// Rows of its tables whose first column has this head; a row may have several names.
    pub(crate) fn rows(&self, head: &str) -> Vec<Row> {
        let mut rows = Vec::new();
        let mut inside = false;
        for line in self.text.lines() {
            let cells = cells(line, if head == "key" { 3 } else { 2 });
            if cells.is_empty() {
                inside = false;
            } else if cells[0] == head {
                inside = true;
            } else if inside && !line.starts_with("|---") {
                let default = if cells.len() > 2 { cells[1] } else { "" };
                let meaning = cells.last().copied().unwrap_or("");
                rows.extend(quoted(cells[0]).map(|name| Row { name, default, meaning }));
            }
        }
        rows
    }
}

impl Row {
    /// The default where it is a value.
    pub(crate) fn default(&self) -> Option<serde_json::Value> {
        let code = self.default.strip_prefix('`')?.strip_suffix('`')?;
        serde_json::from_str(code).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_language_have_their_meaning() {
        for (word, part) in [
            ("log1p", "of 1 + x without loss"),
            ("parameter", "a value that a scene chooses"),
            ("l1", "of a triangle the sides"),
            ("dev", "tr(A)/d"),
            ("weights", "interactions weigh the product of the volumes"),
        ] {
            let (names, text) = meaning(LANGUAGE, word).unwrap();
            assert!(names.contains(word) && text.contains(part), "{word}: {names}: {text}");
            assert!(!text.contains("]("), "{text}");
        }
        assert!(meaning(LANGUAGE, "log").is_none());
        assert_eq!(plain("a [b](c#d) e [f] (g)"), "a b e [f] (g)");
    }
}
