//! What is wrong, as an exception with findings.

use piola::embedded::finding;
use piola_grammar::Diagnostic;
use piola_runtime::case::CaseError;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use serde_json::{Value, json};

pyo3::create_exception!(
    piola,
    Error,
    PyException,
    "What is wrong with a potential or a scene, or how a run failed; `findings` has it part by part."
);

/// An exception with a message and findings as JSON, which `piola.Error.findings` reads.
pub(crate) fn raise(message: String, findings: Vec<Value>) -> PyErr {
    Error::new_err((message, Value::Array(findings).to_string()))
}

/// A mistake without a place.
pub(crate) fn plain(message: String) -> PyErr {
    let finding = json!({ "severity": "error", "message": message, "helps": [] });
    raise(message, vec![finding])
}

/// An equilibrium that was not found: `piola.NotConverged`.
pub(crate) fn not_converged(py: Python<'_>, message: String) -> PyErr {
    let made = py
        .import("piola")
        .and_then(|module| module.getattr("NotConverged"))
        .and_then(|kind| kind.call1((message.clone(), "[]")));
    made.map_or_else(|_| plain(message), PyErr::from_value)
}

/// Mistakes in a text.
pub(crate) fn in_text(name: &str, text: &str, diagnostics: &[Diagnostic]) -> PyErr {
    let findings: Vec<Value> = diagnostics.iter().map(|d| finding(name, text, d)).collect();
    let line = |f: &Value| {
        let (line, column, code) = (&f["line"], &f["column"], f["code"].as_str().unwrap_or(""));
        let helps = f["helps"].as_array().into_iter().flatten().filter_map(Value::as_str);
        let label = f["label"].as_str().filter(|label| !label.is_empty());
        let parts: Vec<&str> =
            f["message"].as_str().into_iter().chain(label).chain(helps).collect();
        format!("{name}:{line}:{column}: [{code}] {}", parts.join("; "))
    };
    let lines: Vec<String> = findings.iter().map(line).collect();
    raise(lines.join("\n"), findings)
}

/// A scene that cannot be used.
pub(crate) fn of_case(error: &CaseError) -> PyErr {
    match error {
        CaseError::Text { name, text, diagnostics } => in_text(name, text, diagnostics),
        CaseError::Scene(report) => {
            let findings = report.findings.iter().map(|found| {
                let source = &report.sources[found.source];
                finding(&source.name, &source.text, &found.diagnostic)
            });
            raise(report.to_string(), findings.collect())
        }
        other => plain(other.to_string()),
    }
}
