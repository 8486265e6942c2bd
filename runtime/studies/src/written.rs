//! Fields of the tables and objects that studies write.

use serde_json::{Value, json};

/// JSON has no infinities and no NaN.
pub(crate) fn number(x: f64) -> Value {
    if x.is_finite() { json!(x) } else { Value::Null }
}

/// A field of a CSV file, in quotes where it must be.
pub(crate) fn field(text: &str) -> String {
    let line = text.replace(['\n', '\r'], " ");
    if line.contains([',', '"']) { format!("\"{}\"", line.replace('"', "\"\"")) } else { line }
}
