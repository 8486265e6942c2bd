//! Tables that users bring: displacements, point clouds and rows of numbers as CSV.
//!
//! Before: text of unknown quality. After: numbers in the order of the rows; of a body finite ones,
//! exactly as many as there are points, volumes positive. Every mistake is reported with its line, its column,
//! its span and what to write instead; after [`MAX_MISTAKES`] of them the rest is not read.

// A file has few mistakes that are kept: their size does not matter.
#![allow(clippy::result_large_err)]

use std::collections::HashMap;
use std::fmt;

use piola_grammar::{Diagnostic, Span};

use super::table::COMPONENTS;

/// Names of the coordinates in a point cloud.
const COORDINATES: [&str; 3] = ["x", "y", "z"];

/// So many mistakes of one table are reported.
pub const MAX_MISTAKES: usize = 20;

/// A mistake in a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableError {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// The mistake, its span in the text, and the way out.
    pub diagnostic: Diagnostic,
}

impl std::error::Error for TableError {}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}: {}", self.line, self.column, self.diagnostic.message)?;
        for help in &self.diagnostic.helps {
            write!(f, "; {help}")?;
        }
        Ok(())
    }
}

/// Points and volumes of a cloud, in the order of its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// Reference positions, `n x d` row by row, in m.
    pub positions: Vec<f64>,
    /// Point volumes in m^d, all positive.
    pub volumes: Vec<f64>,
}

/// Displacements (`n x d`, m) from a table with columns `u,v[,w]`, one row per point in the user's
/// order; other columns are ignored.
pub fn read_displacement(
    text: &str,
    dimension: usize,
    n_points: usize,
) -> Result<Vec<f64>, Vec<TableError>> {
    let table = Table::open(text, &COMPONENTS[..dimension], true)?;
    let mut displacement = Vec::with_capacity(n_points * dimension);
    let (n_rows, mut errors) = table.rows(|_, values| {
        displacement.extend_from_slice(values);
        Vec::new()
    });
    if n_rows != n_points && errors.len() < MAX_MISTAKES {
        let message = format!("the table has {n_rows} rows, but the body has {n_points} points");
        let end = Span::new(text.trim_end().len(), text.trim_end().len());
        let error = Diagnostic::error("wrong-row-count", end, message)
            .help("write one row per point, in the order of the body's points");
        errors.push(located(text, error));
    }
    if errors.is_empty() { Ok(displacement) } else { Err(errors) }
}

/// Points and volumes from a table with columns `x,y[,z],volume`; other columns are ignored.
///
/// Refuses an empty cloud, volumes that are not positive, two points at one place, and in two dimensions
/// points of different z.
pub fn read_cloud(text: &str, dimension: usize) -> Result<Cloud, Vec<TableError>> {
    let mut names: Vec<&str> = COORDINATES[..dimension].iter().copied().chain(["volume"]).collect();
    if dimension == 2 && column_names(text).iter().any(|name| name == "z") {
        names.push("z");
    }
    let table = Table::open(text, &names, true)?;
    let mut cloud = Cloud { positions: Vec::new(), volumes: Vec::new() };
    let (mut plane, mut told) = (None, false);
    let mut seen: HashMap<Vec<u64>, usize> = HashMap::new();
    let (n_rows, mut errors) = table.rows(|row, values| {
        let (position, volume) = (&values[..dimension], values[dimension]);
        let mut wrong = Vec::new();
        if volume <= 0.0 {
            let message = format!("the volume of a point must be positive, not {volume}");
            let error = Diagnostic::error("volume-not-positive", row.field(dimension), message);
            wrong.push(
                error.help("write the volume in m^d (an area in two dimensions) or remove the row"),
            );
        }
        // Adding zero makes one of the two zeros.
        let key = position.iter().map(|x| (x + 0.0).to_bits()).collect();
        if let Some(earlier) = seen.insert(key, row.line) {
            let message = format!("this point stands where the point of line {earlier} stands");
            let error = Diagnostic::error("points-coincide", row.field(0), message);
            wrong.push(error.help("remove one of them; a bond between them would have no length"));
        }
        if let Some(&z) = values.get(dimension + 1) {
            let (first, line) = *plane.get_or_insert((z, row.line));
            // It is told once: where one point has another z, most have.
            if z != first && !std::mem::replace(&mut told, true) {
                let message = format!(
                    "z is {z} here and {first} on line {line}, but the body has two dimensions"
                );
                let error = Diagnostic::error("not-in-a-plane", row.field(dimension + 1), message);
                wrong.push(error.help("write `dimension = 3` in [body], or give a column that is no place another name"));
            }
        }
        cloud.positions.extend_from_slice(position);
        cloud.volumes.push(volume);
        wrong
    });
    for (axis, name) in names[..dimension].iter().enumerate() {
        let column = || cloud.positions.iter().skip(axis).step_by(dimension).copied();
        let least = column().fold(f64::INFINITY, f64::min);
        let most = column().fold(f64::NEG_INFINITY, f64::max);
        if !cloud.volumes.is_empty() && (most - least).is_infinite() {
            let message = format!(
                "the points reach from {name} = {least:e} to {most:e} m: no number holds that distance"
            );
            let error = Diagnostic::error("infinite-extent", Span::new(0, 0), message)
                .help("write coordinates in m, less than 1e300 apart");
            errors.push(located(text, error));
        }
    }
    if n_rows == 0 {
        let end = Span::new(text.len(), text.len());
        let error = Diagnostic::error("empty-table", end, "the cloud has no points")
            .help(format!("write one line `{}` per point", names.join(",")));
        errors.push(located(text, error));
    }
    if errors.is_empty() { Ok(cloud) } else { Err(errors) }
}

/// Rows of the numbers in the named columns, infinite ones and NaN among them; other columns are
/// ignored. `refusal` says what is wrong with a row, and in which of the columns.
pub fn read_numbers(
    text: &str,
    names: &[&str],
    refusal: impl Fn(&[f64]) -> Option<(usize, String)>,
) -> Result<Vec<Vec<f64>>, Vec<TableError>> {
    let table = Table::open(text, names, false)?;
    let mut rows = Vec::new();
    let (_, errors) = table.rows(|row, values| {
        rows.push(values.to_vec());
        let refused = refusal(values).into_iter();
        refused.map(|(k, what)| Diagnostic::error("out-of-range", row.field(k), what)).collect()
    });
    if errors.is_empty() { Ok(rows) } else { Err(errors) }
}

/// The names of the columns of a table that can be names of variables, in their order; none where the
/// header cannot be read.
pub fn column_names(text: &str) -> Vec<String> {
    let first = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
    let Some((header, _)) = lines(text, first, 1).next() else { return Vec::new() };
    let is_name = |name: &&str| {
        name.starts_with(|c: char| c.is_alphabetic())
            && name.chars().all(|c| c.is_alphanumeric() || c == '_')
    };
    let fields = split(text, header).unwrap_or_default();
    let names = fields.iter().map(|&field| content(text, field));
    names.filter(is_name).map(String::from).collect()
}

/// A table whose header is understood.
struct Table<'a> {
    text: &'a str,
    /// What is wanted, in order, with the place of each in a row.
    wanted: Vec<(&'a str, usize)>,
    n_columns: usize,
    /// Whether all numbers must be finite.
    finite: bool,
    /// Where the rows start: byte and line.
    start: (usize, usize),
}

/// One row: where its wanted fields stand.
struct Row {
    line: usize,
    fields: Vec<Span>,
}

impl Row {
    /// The span of the `index`-th wanted field.
    fn field(&self, index: usize) -> Span {
        self.fields[index]
    }
}

impl<'a> Table<'a> {
    /// Reads the header and finds the wanted columns by name.
    fn open(text: &'a str, wanted: &[&'a str], finite: bool) -> Result<Table<'a>, Vec<TableError>> {
        // Spreadsheets put a byte order mark in front.
        let first = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
        let expected = format!("the first line must name the columns: `{}`", wanted.join(","));
        let Some((header, line)) = lines(text, first, 1).next() else {
            let error = Diagnostic::error("empty-table", Span::new(0, 0), "the table is empty")
                .help(expected);
            return Err(vec![located(text, error)]);
        };
        let fields = split(text, header).map_err(|error| vec![located(text, error)])?;
        let names: Vec<&str> = fields.iter().map(|&field| content(text, field)).collect();
        let find = |name: &&'a str| {
            let places: Vec<usize> = (0..names.len()).filter(|&i| names[i] == *name).collect();
            match places[..] {
                [place] => Ok((*name, place)),
                [_, again, ..] => {
                    let message = format!("there are two columns named `{name}`");
                    Err(Diagnostic::error("duplicate-column", fields[again], message)
                        .help("rename or remove one of them"))
                }
                [] => Err(missing(text, header, name, &names).help(expected.clone())),
            }
        };
        let (mut places, mut errors) = (Vec::new(), Vec::new());
        for name in wanted {
            match find(name) {
                Ok(place) => places.push(place),
                Err(error) => errors.push(located(text, error)),
            }
        }
        if !errors.is_empty() {
            return Err(errors);
        }
        let start = (header.range().end, line + 1);
        Ok(Table { text, wanted: places, n_columns: names.len(), finite, start })
    }

    /// Hands every row's wanted numbers to `take`, in order. How many rows there are, and what is
    /// wrong with any of them.
    fn rows(
        &self,
        mut take: impl FnMut(&Row, &[f64]) -> Vec<Diagnostic>,
    ) -> (usize, Vec<TableError>) {
        let (mut n_rows, mut errors) = (0, Vec::new());
        let after_header = self.text[self.start.0..].find('\n').map(|at| self.start.0 + at + 1);
        let start = after_header.unwrap_or(self.text.len());
        let mut values = Vec::with_capacity(self.wanted.len());
        for (span, line) in lines(self.text, start, self.start.1) {
            n_rows += 1;
            values.clear();
            let wrong = match self.row(span, line, &mut values) {
                Ok(row) => take(&row, &values),
                Err(wrong) => wrong,
            };
            errors.extend(wrong.into_iter().map(|error| located(self.text, error)));
            if errors.len() >= MAX_MISTAKES {
                errors.truncate(MAX_MISTAKES);
                let rest = format!("after {MAX_MISTAKES} mistakes the rest of a table is not read");
                errors.last_mut().into_iter().for_each(|e| e.diagnostic.helps.push(rest.clone()));
                break;
            }
        }
        (n_rows, errors)
    }

    fn row(&self, span: Span, line: usize, values: &mut Vec<f64>) -> Result<Row, Vec<Diagnostic>> {
        let all = split(self.text, span).map_err(|error| vec![error])?;
        if all.len() != self.n_columns {
            let message = format!(
                "this line has {} fields, but the header names {} columns",
                all.len(),
                self.n_columns
            );
            return Err(vec![Diagnostic::error("wrong-field-count", span, message).help(
                "separate fields with commas and write decimals with a point, as in `0.5`",
            )]);
        }
        let mut fields = Vec::with_capacity(self.wanted.len());
        let mut wrong = Vec::new();
        for &(name, place) in &self.wanted {
            match number(self.text, all[place], name, self.finite) {
                Ok(value) => values.push(value),
                Err(error) => wrong.push(error),
            }
            fields.push(all[place]);
        }
        if wrong.is_empty() { Ok(Row { line, fields }) } else { Err(wrong) }
    }
}

/// The lines that are not blank from byte `start` (which is on line `first_line`), without their
/// ends, with their numbers.
fn lines(text: &str, start: usize, first_line: usize) -> impl Iterator<Item = (Span, usize)> + '_ {
    let mut at = start;
    text[start..]
        .split_inclusive('\n')
        .zip(first_line..)
        .map(move |(line, number)| {
            let span = Span::new(at, at + line.trim_end_matches(['\n', '\r']).len());
            at += line.len();
            (span, number)
        })
        .filter(|(span, _)| !text[span.range()].trim().is_empty())
}

/// The fields of a line: split at commas outside quotes, without the white space around them.
fn split(text: &str, line: Span) -> Result<Vec<Span>, Diagnostic> {
    let Span { start, end } = line;
    let mut fields = Vec::new();
    let mut quoted = false;
    let mut field_start = start as usize;
    for (at, byte) in text.as_bytes()[line.range()].iter().enumerate() {
        match byte {
            b'"' => quoted = !quoted,
            b',' if !quoted => {
                fields.push(trimmed(text, field_start, start as usize + at));
                field_start = start as usize + at + 1;
            }
            _ => {}
        }
    }
    if quoted {
        let span = Span::new(field_start, end as usize);
        return Err(Diagnostic::error("unclosed-quote", span, "this quote is not closed")
            .help("close it on the same line"));
    }
    fields.push(trimmed(text, field_start, end as usize));
    Ok(fields)
}

fn trimmed(text: &str, start: usize, end: usize) -> Span {
    let field = &text[start..end];
    let start = start + field.len() - field.trim_start().len();
    Span::new(start, start + field.trim().len())
}

/// A field without the quotes around it.
fn content(text: &str, field: Span) -> &str {
    let field = &text[field.range()];
    let inside = field.strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
    inside.unwrap_or(field).trim()
}

/// A number, a finite one if it must be, or what to write instead.
fn number(text: &str, field: Span, name: &str, must_be_finite: bool) -> Result<f64, Diagnostic> {
    let written = content(text, field);
    let error = |message: String, help: &str| {
        Err(Diagnostic::error("not-a-number", field, message).help(help))
    };
    if written.is_empty() {
        return error(format!("`{name}` is empty"), "write a number, 0 where there is none");
    }
    match written.parse::<f64>() {
        Ok(value) if value.is_finite() || !must_be_finite => Ok(value),
        Ok(_) if written.bytes().any(|byte| byte.is_ascii_digit()) => error(
            format!("`{name}` = {written} is too large for a 64-bit number"),
            "write a number below 1.8e308",
        ),
        Ok(_) => error(
            format!("`{name}` must be a finite number, not {written}"),
            "write a finite number or remove the row",
        ),
        Err(_) => error(
            format!("`{name}` is not a number: `{written}`"),
            "write a decimal number such as `-0.5` or `1e-3`, without a unit",
        ),
    }
}

fn missing(text: &str, header: Span, name: &str, found: &[&str]) -> Diagnostic {
    let message = format!("there is no column `{name}`");
    let error = Diagnostic::error("missing-column", header, message);
    if let Some(similar) = found.iter().find(|other| other.eq_ignore_ascii_case(name)) {
        return error.help(format!("write `{name}` for `{similar}`: case matters in names"));
    }
    if found.len() == 1 && text[header.range()].contains([';', '\t']) {
        return error.help("separate the columns with commas");
    }
    error.help(format!("the columns here are `{}`", found.join("`, `")))
}

/// Adds line and column of the diagnostic's span.
fn located(text: &str, diagnostic: Diagnostic) -> TableError {
    let before = &text[..diagnostic.span.range().start];
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    TableError {
        line: before.matches('\n').count() + 1,
        column: before[line_start..].chars().count() + 1,
        diagnostic,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_are_found_by_name_and_keep_their_order() {
        let text =
            "\u{feff}X , v,label,u\r\n0, 2 ,\"a, b\",1\r\n\r\n0,-4e-3,c,\"3.5\"\r\n0, .5,,+5.\r\n";
        let read = read_displacement(text, 2, 3).unwrap();
        assert_eq!(read, [1.0, 2.0, 3.5, -4e-3, 5.0, 0.5]);
        let read = read_displacement("u,v,w\n1,2,3", 3, 1).unwrap();
        assert_eq!(read, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn clouds_are_read() {
        let cloud = read_cloud("x,y,z,volume\n0,0,0,1\n0.5,0,-0,2e-3\n", 3).unwrap();
        assert_eq!(cloud.positions, [0.0, 0.0, 0.0, 0.5, 0.0, 0.0]);
        assert_eq!(cloud.volumes, [1.0, 2e-3]);
    }

    /// The error of a cloud in two dimensions: line, column, code, what the span covers.
    fn check_cloud(text: &str, line: usize, column: usize, code: &str, covers: &str, help: &str) {
        let errors = read_cloud(text, 2).unwrap_err();
        let [error] = &errors[..] else { panic!("{errors:?}") };
        assert_eq!((error.line, error.column), (line, column), "{error}");
        assert_eq!(error.diagnostic.code, code, "{error}");
        assert_eq!(&text[error.diagnostic.span.range()], covers, "{error}");
        assert!(error.to_string().contains(help), "{error}");
    }

    #[test]
    fn mistakes_in_clouds_are_named_at_their_place() {
        check_cloud("", 1, 1, "empty-table", "", "`x,y,volume`");
        check_cloud("\n \nx,y,volume\n", 4, 1, "empty-table", "", "one line `x,y,volume`");
        check_cloud("x,y\n0,0\n", 1, 1, "missing-column", "x,y", "no column `volume`");
        check_cloud("X,y,volume\n", 1, 1, "missing-column", "X,y,volume", "`x` for `X`");
        check_cloud("x,y,volume,y\n", 1, 12, "duplicate-column", "y", "two columns");
        check_cloud("x,y,volume\n1,2,3\n0,0\n", 3, 1, "wrong-field-count", "0,0", "2 fields");
        check_cloud("x,y,volume\n1,5,0,3\n", 2, 1, "wrong-field-count", "1,5,0,3", "a point");
        check_cloud("x,y,volume\n0, nan,1\n", 2, 4, "not-a-number", "nan", "finite");
        check_cloud("x,y,volume\n0,-inf,1\n", 2, 3, "not-a-number", "-inf", "finite");
        check_cloud("x,y,volume\n0,1e999,1\n", 2, 3, "not-a-number", "1e999", "too large");
        check_cloud("x,y,volume\n0,,1\n", 2, 3, "not-a-number", "", "empty");
        check_cloud("x,y,volume\n0,1 mm,1\n", 2, 3, "not-a-number", "1 mm", "without a unit");
        check_cloud("x,y,volume\n0,1,0\n", 2, 5, "volume-not-positive", "0", "positive");
        check_cloud("x,y,volume\n0,1,-2\n", 2, 5, "volume-not-positive", "-2", "m^d");
        check_cloud("x,y,volume\n0,1,1\n2,2,1\n-0,1,1\n", 4, 1, "points-coincide", "-0", "line 2");
        let deep = "x,y,z,volume\n0,0,1,1\n1,0,2,1\n0,1,3,1\n";
        check_cloud(deep, 3, 5, "not-in-a-plane", "2", "1 on line 2");
        check_cloud("x,y,volume\n0,\"1,1\n", 2, 3, "unclosed-quote", "\"1,1", "same line");
        check_cloud("é,x,y,volume\né,a,1,1\n", 2, 3, "not-a-number", "a", "`x` is not a number");
    }

    #[test]
    fn all_mistakes_of_a_table_come_in_one_run() {
        let places = |errors: Vec<TableError>| -> Vec<(usize, usize, &str)> {
            errors.iter().map(|e| (e.line, e.column, e.diagnostic.code)).collect()
        };
        let errors = read_cloud("x;y;volume\n", 2).unwrap_err();
        assert!(errors.iter().all(|e| e.to_string().contains("with commas")), "{errors:?}");
        assert_eq!(places(errors), [(1, 1, "missing-column"); 3]);
        let text = "x,y,volume\n0,0,0\n1,1\n0,0,-1\na,b,1\n2,2,1\n";
        let expected = [
            (2, 5, "volume-not-positive"),
            (3, 1, "wrong-field-count"),
            (4, 5, "volume-not-positive"),
            (4, 1, "points-coincide"),
            (5, 1, "not-a-number"),
            (5, 3, "not-a-number"),
        ];
        assert_eq!(places(read_cloud(text, 2).unwrap_err()), expected);
        let errors = read_displacement("u,v\n1,x\n", 2, 2).unwrap_err();
        assert_eq!(places(errors), [(2, 3, "not-a-number"), (2, 4, "wrong-row-count")]);
        let many = "x,y,volume\n".to_string() + &"a,b,c\n".repeat(1000);
        let errors = read_cloud(&many, 2).unwrap_err();
        assert_eq!(errors.len(), MAX_MISTAKES);
        assert!(errors[MAX_MISTAKES - 1].to_string().contains("the rest of a table is not read"));
        assert!(!errors[MAX_MISTAKES - 2].to_string().contains("rest"));
    }

    #[test]
    fn displacements_must_match_the_body() {
        let read_displacement = |text: &str, dimension, n_points| {
            read_displacement(text, dimension, n_points).map_err(|mut errors| errors.remove(0))
        };
        let error = read_displacement("u,v\n1,2\n3,4\n\n", 2, 3).unwrap_err();
        assert_eq!((error.line, error.diagnostic.code), (3, "wrong-row-count"));
        assert!(error.to_string().contains("2 rows, but the body has 3 points"), "{error}");
        let error = read_displacement("u,v\n1,2\n", 3, 1).unwrap_err();
        assert!(error.to_string().contains("no column `w`"), "{error}");
        let error = read_displacement("u,v\n1,NaN\n", 2, 1).unwrap_err();
        assert_eq!((error.line, error.column), (2, 3));
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_the_readers_panic(text in "(x|y|u|v|volume|[0-9.,\"\n\r é-]){0,60}") {
            let _ = read_cloud(&text, 2);
            let _ = read_displacement(&text, 2, 2);
        }
    }
}
