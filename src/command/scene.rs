//! What the commands that take a scene share.

use piola_grammar::Diagnostic;
use piola_runtime::scene::SceneReport;
use piola_runtime::scene::boundary::BoundaryConditions;
use piola_runtime::simulation::{Case, CaseError, Library};

use crate::library;
use crate::render::{self, Source};

/// Reads a scene and prints what is wrong with it, or what its user should know.
pub(super) fn read(path: &std::path::Path, overrides: &[String]) -> Option<Case> {
    match try_read(path, overrides) {
        Ok(case) => Some(case),
        Err(error) => {
            print_error(&error);
            None
        }
    }
}

/// Reads a scene.
pub(super) fn try_read(path: &std::path::Path, overrides: &[String]) -> Result<Case, CaseError> {
    let names = library::names();
    let library = Library { find: &library::find, names: &names };
    Case::read(path, overrides, &library)
}

/// Every warning about a scene: its text, its sets, its boundary conditions.
pub(super) fn warnings(case: &Case) -> Result<Vec<Diagnostic>, CaseError> {
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    let mut warnings = case.warnings.clone();
    warnings.extend(selection.warnings.iter().cloned());
    warnings.extend(boundary.warnings.iter().cloned());
    Ok(warnings)
}

/// Prints an error at its place.
pub(super) fn print_error(error: &CaseError) {
    match error {
        CaseError::Scene(report) => print_report(report),
        CaseError::Text { name, text, diagnostics } => {
            render::findings(Source { name, text }, diagnostics);
        }
        CaseError::Unreadable { .. } | CaseError::Body { .. } => {
            render::error(&error.to_string(), None);
        }
    }
}

/// Prints warnings about a scene and gives them back as sentences.
pub(super) fn print_warnings(case: &Case, warnings: Vec<Diagnostic>) -> Vec<String> {
    let report = case.scene.report(warnings);
    print_report(&report);
    report.findings.iter().map(|finding| finding.diagnostic.message.clone()).collect()
}

fn print_report(report: &SceneReport) {
    for finding in &report.findings {
        let source = &report.sources[finding.source];
        let source = Source { name: &source.name, text: &source.text };
        render::findings(source, std::slice::from_ref(&finding.diagnostic));
    }
}

/// Runs `work` on this many threads, or on all processors; `None` if that is not possible.
pub(super) fn with_threads<T: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> T + Send,
) -> Option<T> {
    match rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build() {
        Ok(pool) => Some(pool.install(work)),
        Err(error) => {
            render::error(&format!("cannot start the threads: {error}"), None);
            None
        }
    }
}
