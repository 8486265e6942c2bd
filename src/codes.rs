//! What the codes of messages mean: `docs/codes.md`, part of the program.
//!
//! The page has a `##` for each part and below it a `###` for each code: a sentence, an explanation,
//! a wrong example and a right one.

const PAGE: &str = include_str!("../docs/codes.md");

/// What the page says about a code.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Section {
    /// The part of the page it stands in.
    pub(crate) part: &'static str,
    pub(crate) code: &'static str,
    /// The first paragraph.
    pub(crate) summary: &'static str,
    /// All that follows, in Markdown.
    pub(crate) text: &'static str,
}

/// Every section, in the order of the page.
pub(crate) fn sections() -> Vec<Section> {
    let parts = PAGE.split("\n## ").skip(1);
    parts.flat_map(|part| part.split("\n### `").skip(1).filter_map(|s| section(part, s))).collect()
}

/// What the page says of a code in a sentence; empty for one that it does not know.
pub(crate) fn summary(code: &str) -> &'static str {
    sections().into_iter().find(|section| section.code == code).map_or("", |one| one.summary)
}

fn section(part: &'static str, section: &'static str) -> Option<Section> {
    let (code, rest) = section.split_once("`\n\n")?;
    let (summary, text) = rest.split_once("\n\n")?;
    Some(Section { part: part.lines().next()?, code, summary, text })
}

impl Section {
    /// The section for a terminal: examples are indented in place of their fences.
    pub(crate) fn plain(&self) -> String {
        let mut out = format!("{}: {}\n\n", self.code, self.summary);
        let mut inside = false;
        for line in self.text.trim_end().lines() {
            if line.starts_with("```") {
                inside = !inside;
                continue;
            }
            out.push_str(if inside && !line.is_empty() { "    " } else { "" });
            out.push_str(line);
            out.push('\n');
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::sections;

    #[test]
    fn every_section_is_read() {
        let sections = sections();
        assert_eq!(sections.len(), super::PAGE.matches("\n### ").count());
        for section in sections {
            assert!(section.summary.ends_with('.'), "{}", section.code);
            assert!(!section.summary.contains('\n'), "{}", section.code);
            for part in ["Wrong:\n\n    ", "Right:\n\n    "] {
                assert!(section.plain().contains(part), "{} has no `{part}`", section.code);
            }
        }
    }
}
