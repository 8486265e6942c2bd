//! What the commands that take a scene share.

use piola_grammar::Diagnostic;
use piola_runtime::case::{Case, CaseError, Library};
use piola_runtime::scene::SceneReport;
use piola_runtime::scene::boundary::BoundaryConditions;

use super::Exit;
use crate::cli::Format;
use crate::library;
use crate::potential::with_meant;
use crate::render::{self, Printer, Source};

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
    outline(path, overrides)?.with_points()
}

/// The same without its points.
pub(super) fn outline(path: &std::path::Path, overrides: &[String]) -> Result<Case, CaseError> {
    let name = path.display().to_string();
    if name.ends_with(".piola") || (library::find(&name).is_some() && !path.exists()) {
        let message = format!(
            "`{name}` is a potential, and a scene is needed: a file that names the potential \
             (`potential = \"{name}\"` in [material]) and says what body is made of it; \
             `piola check {name}` checks the potential"
        );
        return Err(CaseError::Body { message });
    }
    let names = library::names();
    let library = Library { find: &library::find, names: &names };
    Case::outline(path, overrides, &library)
}

/// A scene with its points, unless these are more than a plan needs.
pub(super) fn read_for_plan(path: &std::path::Path, overrides: &[String]) -> Option<Case> {
    let read = outline(path, overrides)
        .and_then(|case| if case.large_box().is_some() { Ok(case) } else { case.with_points() });
    read.map_err(|error| print_error(&error)).ok()
}

/// Every warning about a scene: its text, its sets, its boundary conditions.
pub(super) fn warnings(case: &Case) -> Result<Vec<Diagnostic>, CaseError> {
    if case.large_box().is_some() {
        return Ok(case.warnings.clone());
    }
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    let mut warnings = case.warnings.clone();
    warnings.extend(selection.warnings.iter().cloned());
    warnings.extend(boundary.warnings.iter().cloned());
    Ok(warnings)
}

/// Checks a scene as far as that is possible without a run: the text and all it names, its points,
/// sets and conditions, and motions that nothing holds. Prints what is found.
pub(super) fn check(
    path: &std::path::Path,
    overrides: &[String],
    printer: &mut Printer,
) -> Result<Case, Exit> {
    let mut checked = || -> Result<Case, CaseError> {
        let mut case = outline(path, overrides)?;
        if case.large_box().is_none() {
            case = case.with_points()?;
        }
        print_findings(&case.scene.report(warnings(&case)?), printer);
        case.plan(1)?;
        Ok(case)
    };
    checked().map_err(|error| {
        print_case_error(&error, path, printer);
        match error {
            CaseError::Unreadable { .. } => Exit::Input,
            _ => Exit::Findings,
        }
    })
}

/// Prints an error at its place.
pub(super) fn print_error(error: &CaseError) {
    print_case_error(error, std::path::Path::new(""), &mut Printer::new(Format::Human));
}

/// `path` is the scene's, for errors that have no place in a text.
fn print_case_error(error: &CaseError, path: &std::path::Path, printer: &mut Printer) {
    match error {
        CaseError::Scene(report) => print_findings(report, printer),
        CaseError::Text { name, text, diagnostics } => {
            printer.print(Source { name, text }, diagnostics);
        }
        CaseError::Unreadable { path: file, .. } => {
            let found = with_meant(error.unplaced(), std::path::Path::new(file));
            printer.unplaced(&path.display().to_string(), &found);
        }
        _ => printer.unplaced(&path.display().to_string(), &error.unplaced()),
    }
}

/// Prints warnings about a scene and gives them back as sentences.
pub(super) fn print_warnings(case: &Case, warnings: Vec<Diagnostic>) -> Vec<String> {
    let report = case.scene.report(warnings);
    print_findings(&report, &mut Printer::new(Format::Human));
    report.findings.iter().map(|finding| finding.diagnostic.message.clone()).collect()
}

fn print_findings(report: &SceneReport, printer: &mut Printer) {
    for finding in &report.findings {
        let source = &report.sources[finding.source];
        let source = Source { name: &source.name, text: &source.text };
        printer.print(source, std::slice::from_ref(&finding.diagnostic));
    }
}

/// A material's name, and the body of it alone; a scene with one material has no names.
type OfMaterial<'a> = (Option<&'a str>, Case);

/// The body of each of its materials alone, or of the one of this name; prints that there is none.
pub(super) fn of_materials<'a>(
    case: &'a Case,
    name: Option<&'a str>,
) -> Option<Vec<OfMaterial<'a>>> {
    let Some(name) = name else { return Some(case.of_each_material()) };
    let found = case.of_material(name).map(|case| vec![(Some(name), case)]);
    if found.is_none() {
        let regions = case.scene.regions.iter();
        let names: Vec<&str> = regions.map(|region| region.name.value.as_str()).collect();
        let help = match names.is_empty() {
            true => "the scene has one [material]: leave --material out".to_string(),
            false => format!("the materials are {}", names.join(", ")),
        };
        render::error(&format!("there is no material `{name}`"), Some(help.as_str()));
    }
    found
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
