//! Clouds of points as PeriLab and Peridigm write them: columns between white space, a header that names
//! them, and files of point numbers for sets.
//!
//! PeriLab begins with `header: x y z block_id volume`, Peridigm with a comment, `# x y z block_id
//! volume`; comments begin with `#`.

use crate::error::MeshError;

/// Whether a text is a table between commas, and not one of these clouds.
pub fn is_comma_separated(text: &str) -> bool {
    let first = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
    first.is_none_or(|line| line.contains(','))
}

/// The cloud as a table between commas with a header, each number where it stood in the file, so that
/// places in the one are places in the other.
///
/// # Errors
/// No line names the columns.
pub fn as_table(text: &str) -> Result<String, MeshError> {
    let mut table = String::with_capacity(text.len());
    let mut has_header = false;
    for line in text.split_inclusive('\n') {
        let trimmed = line.trim_start();
        let header = trimmed.strip_prefix("header:").or_else(|| {
            let comment = trimmed.strip_prefix('#')?;
            let words: Vec<&str> = comment.split_whitespace().collect();
            (words.contains(&"x") && words.contains(&"volume")).then_some(comment)
        });
        if let (false, Some(names)) = (has_header, header) {
            has_header = true;
            push_blank(&mut table, &line[..line.len() - names.len()]);
            push_separated(&mut table, names);
        } else if trimmed.starts_with('#') {
            push_blank(&mut table, line);
        } else if !trimmed.is_empty() && !has_header {
            let start = table.len() + line.len() - trimmed.len();
            let message = "no line before this one names the columns";
            let range = (start, start + trimmed.trim_end().len());
            return Err(MeshError::broken(range, message).help(
                "write `header: x y z block_id volume` above it, with the columns that are there",
            ));
        } else {
            push_separated(&mut table, line);
        }
    }
    Ok(table)
}

/// The same bytes of white space; ends of lines stay.
fn push_blank(out: &mut String, text: &str) {
    out.extend(
        text.bytes().map(|byte| if byte == b'\n' || byte == b'\r' { byte as char } else { ' ' }),
    );
}

/// The words of a line with a comma behind each but the last, in place of the white space there.
fn push_separated(out: &mut String, line: &str) {
    let content = line.trim_end();
    let mut in_word = false;
    for c in content.chars() {
        let separates = c.is_whitespace() && in_word;
        in_word = !c.is_whitespace();
        match separates {
            true => {
                out.push(',');
                (1..c.len_utf8()).for_each(|_| out.push(' '));
            }
            false => out.push(c),
        }
    }
    out.push_str(&line[content.len()..]);
}

/// The numbers of points, from 1, that a file lists, as indices from 0.
///
/// # Errors
/// Anything that is no number of a point.
pub fn read_numbers(text: &str, n_points: usize) -> Result<Vec<usize>, MeshError> {
    let mut numbers = Vec::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let trimmed = line.trim_start();
        let is_note = trimmed.starts_with('#') || trimmed.starts_with("header:");
        if !is_note {
            let mut rest = line;
            while let Some(first) = rest.find(|c: char| !c.is_whitespace() && c != ',') {
                let word = &rest[first..];
                let length = word.find(|c: char| c.is_whitespace() || c == ',');
                let word = &word[..length.unwrap_or(word.len())];
                let at = start + line.len() - rest.len() + first;
                let number = word.parse::<usize>().ok().filter(|n| (1..=n_points).contains(n));
                let number = number.ok_or_else(|| {
                    let word = crate::scan::shown(word);
                    let message = format!("`{word}` is no number of a point from 1 to {n_points}");
                    MeshError::broken((at, at + word.len()), message)
                })?;
                numbers.push(number - 1);
                rest = &rest[first + word.len()..];
            }
        }
        start += line.len();
    }
    Ok(numbers)
}
