//! Potentials from files and from the library, and values for their parameters.

use std::io::Read as _;
use std::path::Path;

use piola_compiler::{Model, Setting, ValueError, Values, check_text_with};
use piola_grammar::names::entry;
use piola_grammar::{Ast, Diagnostic, Span, suggest};
use piola_runtime::case::UNREADABLE;
use piola_runtime::scene::files_below;

use crate::cli::{Format, Inputs};
use crate::console;
use crate::library;
use crate::render::{self, Printer, Source};

/// A potential that passed the checks.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) name: String,
    pub(crate) text: String,
    pub(crate) ast: Ast,
    pub(crate) model: Model,
}

/// Reads and checks a potential; what is wrong is printed. `None` if it cannot be used.
pub(crate) fn load(name: &str) -> Option<Loaded> {
    load_text(name, read(name)?, &mut Printer::new(Format::Human))
}

/// Checks the text of a potential; what is wrong is printed. `None` if it cannot be used.
pub(crate) fn load_text(name: &str, text: String, printer: &mut Printer) -> Option<Loaded> {
    let source = Source { name, text: &text };
    let folder = Path::new(name).parent().unwrap_or(Path::new("."));
    match check_text_with(&text, &files_below(folder)) {
        Ok((ast, model)) => Some(Loaded { name: name.to_string(), text, ast, model }),
        Err(diagnostics) => {
            printer.print(source, &diagnostics);
            None
        }
    }
}

/// The text of a file, or of a potential of the library if the name has no ending; prints why not.
pub(crate) fn read(name: &str) -> Option<String> {
    printed(try_read(name))
}

/// The same, or a finding that says why not.
pub(crate) fn try_read(name: &str) -> Result<String, Box<Diagnostic>> {
    if !name.contains(['.', '/', '\\']) {
        let found = library::find(name).map(str::to_owned);
        return found.ok_or_else(|| {
            let near =
                suggest(name, library::names()).map(|near| format!("did you mean `{near}`?"));
            let all = || format!("the library has {}", library::names().join(", "));
            let found = unreadable(format!("the library has no potential `{name}`"));
            Box::new(found.help(near.unwrap_or_else(all)))
        });
    }
    if name.ends_with(".toml") {
        let message = format!("`{name}` is a scene, and a potential is needed");
        let help = "name the potential: the one of the scene stands in its [material]";
        return Err(Box::new(unreadable(message).help(help)));
    }
    try_read_limited(Path::new(name), piola_grammar::MAX_BYTES)
}

/// A whole text file of at most `limit` bytes; prints why not.
pub(crate) fn read_limited(path: &Path, limit: usize) -> Option<String> {
    printed(try_read_limited(path, limit))
}

fn try_read_limited(path: &Path, limit: usize) -> Result<String, Box<Diagnostic>> {
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path)
        .and_then(|file| file.take(limit as u64 + 1).read_to_end(&mut bytes));
    let problem = match read {
        Err(error) => error.to_string(),
        Ok(_) if bytes.len() > limit => format!("it has more than {limit} bytes"),
        Ok(_) => match String::from_utf8(bytes) {
            Ok(text) => return Ok(text),
            Err(_) => "it is not UTF-8 text".to_string(),
        },
    };
    let found = unreadable(format!("cannot read {}: {problem}", path.display()));
    Err(Box::new(with_meant(found, path)))
}

/// What says that there is no file at a path, with what may be meant.
pub(crate) fn with_meant(found: Diagnostic, path: &Path) -> Diagnostic {
    match piola_runtime::scene::meant(path) {
        Some(help) => found.help(help),
        None => found,
    }
}

fn unreadable(message: String) -> Diagnostic {
    Diagnostic::error(UNREADABLE, Span::new(0, 0), message)
}

fn printed(read: Result<String, Box<Diagnostic>>) -> Option<String> {
    read.map_err(|found| Printer::new(Format::Human).unplaced("", &found)).ok()
}

/// `NAME=VALUE` pairs, `NAME=VALUE,VALUE` for the entries of a vector; prints what is not one.
pub(crate) fn settings(inputs: &Inputs) -> Option<Vec<(String, Setting)>> {
    if let Some(delta) = inputs.delta
        && !(delta.is_finite() && delta > 0.0)
    {
        render::error(&format!("--delta {delta}: the horizon must be a positive number"), None);
        return None;
    }
    let mut settings = Vec::new();
    for setting in &inputs.settings {
        let Some((name, values)) = setting.split_once('=') else {
            let message = format!("--set {setting}: this is not NAME=VALUE");
            render::error(&message, Some("write for instance --set n=2"));
            return None;
        };
        let name = name.trim();
        let values: Vec<&str> = values.split(',').collect();
        for (k, value) in values.iter().enumerate() {
            let value = match value.trim().parse::<f64>() {
                Ok(number) => Setting::Number(number),
                Err(_) => Setting::Text(value.trim().trim_matches('"').to_string()),
            };
            let name = if values.len() == 1 { name.to_string() } else { entry(name, k as u32 + 1) };
            settings.push((name, value));
        }
    }
    Some(settings)
}

/// Values for a potential; prints what is wrong with them.
pub(crate) fn values(
    model: &Model,
    dimension: usize,
    settings: &[(String, Setting)],
    delta: Option<f64>,
) -> Option<Values> {
    match model.values(dimension, settings, delta) {
        Ok(values) => Some(values),
        Err(errors) => {
            print_value_errors(&errors);
            None
        }
    }
}

/// Values with which every energy of a potential is modelled, in the given dimension or the largest:
/// parameters without a value, and those whose 0 drops an energy, are 1; a note says which, `so that
/// every energy can be` what `purpose` says. Prints what is wrong.
pub(crate) fn every_energy(
    model: &Model,
    dimension: Option<u8>,
    inputs: &Inputs,
    purpose: &str,
) -> Option<Values> {
    let mut settings = settings(inputs)?;
    let dimension = dimension.map(usize::from).or(model.dimensions().max())?;
    let delta = inputs.delta.or(Some(1.0));
    let mut chosen = model.fill_with_one(dimension, &mut settings);
    chosen.extend(model.switch_on(dimension, &mut settings, delta));
    if !chosen.is_empty() {
        console::note(&format!(
            "{} = 1, so that every energy can be {purpose}",
            chosen.join(" = ")
        ));
    }
    values(model, dimension, &settings, delta)
}

fn print_value_errors(errors: &[ValueError]) {
    for error in errors {
        let help = match error.code {
            "missing-parameter" => format!("give it a value: --set {}=1", error.parameter),
            _ => error.help.clone(),
        };
        render::error(&format!("[{}] {}", error.code, error.message), Some(help.as_str()));
    }
}
