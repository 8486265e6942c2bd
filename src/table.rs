//! Tables of numbers that commands read.

/// So many mistakes of a table are told at once.
const TOLD: usize = 20;

/// The numbers of the named columns, row by row; or the mistakes, each with its line, at most 20.
/// `refusal` says what is wrong with a row of numbers, and in which of the columns.
pub(crate) fn rows(
    text: &str,
    names: &[String],
    refusal: impl Fn(&[f64]) -> Option<(usize, String)>,
) -> Result<Vec<Vec<f64>>, Vec<String>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| vec![error.to_string()])?.clone();
    let missing = |name: &&String| !header.iter().any(|h| h == name.as_str());
    if let Some(name) = names.iter().find(missing) {
        let (found, first): (Vec<&str>, String) = (header.iter().collect(), names.join(","));
        let found = found.join(",");
        return Err(vec![format!(
            "there is no column `{name}` (found {found}); the first line must be `{first}`"
        )]);
    }
    let place = |name: &String| header.iter().position(|h| h == name.as_str()).unwrap_or(0);
    let places: Vec<usize> = names.iter().map(place).collect();
    let (mut rows, mut mistakes) = (Vec::new(), Vec::new());
    for record in reader.records() {
        if mistakes.len() >= TOLD {
            break;
        }
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                mistakes.push(error.to_string());
                continue;
            }
        };
        let line = record.position().map_or(0, csv::Position::line);
        let mut row = Vec::with_capacity(names.len());
        for (name, place) in names.iter().zip(&places) {
            let text = record.get(*place).unwrap_or("");
            match text.parse::<f64>() {
                Ok(number) => row.push(number),
                Err(_) => {
                    mistakes.push(format!("line {line}, column {name}: `{text}` is not a number"));
                }
            }
        }
        if row.len() < names.len() {
            continue;
        }
        match refusal(&row) {
            Some((k, what)) => mistakes.push(format!("line {line}, column {}: {what}", names[k])),
            None => rows.push(row),
        }
    }
    if mistakes.is_empty() { Ok(rows) } else { Err(mistakes) }
}
