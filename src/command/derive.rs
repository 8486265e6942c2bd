//! `piola derive`: derivatives as text, and every stage on the way to machine code.

use piola_compiler::jit::CompiledKernel;
use piola_compiler::{CompileError, Specialised, print};

use super::Exit;
use crate::cli::{Derive, Emit, Format};
use crate::potential::{self, Loaded};
use crate::render;

pub(super) fn execute(arguments: &Derive) -> Exit {
    let Some(loaded) = potential::load(&arguments.file, Format::Human) else { return Exit::Input };
    let defined: Vec<usize> = loaded.model.dimensions().collect();
    let dimension = arguments.dim.map_or(defined[defined.len() - 1], usize::from);
    match arguments.emit {
        Emit::Ast => {
            render::out(&format!("{:#?}\n", loaded.ast));
            return Exit::Done;
        }
        Emit::Model => {
            render::out(&print::model_listing(&loaded.model));
            return Exit::Done;
        }
        _ => {}
    }
    let specialised = match specialise(&loaded, dimension, arguments) {
        Some(Ok(specialised)) => specialised,
        Some(Err(error)) => {
            print_compile_error(&loaded, &error);
            return Exit::Input;
        }
        None => return Exit::Input,
    };
    for dropped in &specialised.dropped {
        eprintln!("note: {}", dropped.reason);
    }
    match emit(&loaded, &specialised, arguments.emit) {
        Ok(text) => {
            render::out(&text);
            Exit::Done
        }
        Err(error) => {
            print_compile_error(&loaded, &error);
            Exit::Input
        }
    }
}

/// With parameters as symbols where that can be printed and no value is given.
fn specialise(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Result<Specialised, CompileError>> {
    let mut settings = potential::settings(&arguments.inputs)?;
    let symbols_allowed = matches!(arguments.emit, Emit::Text | Emit::Latex | Emit::Graph);
    if symbols_allowed && settings.is_empty() && arguments.inputs.delta.is_none() {
        return Some(loaded.model.symbolic(dimension));
    }
    let filled = loaded.model.fill_with_one(dimension, &mut settings);
    if !filled.is_empty() {
        eprintln!("note: {} = 1, for want of a value", filled.join(" = "));
    }
    let delta = arguments.inputs.delta.or(Some(1.0));
    let values = potential::values(&loaded.model, dimension, &settings, delta)?;
    Some(loaded.model.specialise(&values))
}

fn emit(loaded: &Loaded, specialised: &Specialised, emit: Emit) -> Result<String, CompileError> {
    let model = &loaded.model;
    if emit == Emit::C {
        return Ok(print::c_source(model, &specialised.energies));
    }
    let mut parts = Vec::new();
    for energy in &specialised.energies {
        parts.push(match emit {
            Emit::Latex => print::latex(model, energy),
            Emit::Graph => {
                print::graph_listing(model, energy.measure, &energy.graph, &energy.roots)
            }
            Emit::Clif => CompiledKernel::listing(energy)?.clif,
            Emit::Asm => CompiledKernel::listing(energy)?.assembly,
            _ => print::text(model, energy),
        });
    }
    Ok(parts.join("\n"))
}

/// Prints an error of compilation at its place in the potential, if it has one.
pub(super) fn print_compile_error(loaded: &Loaded, error: &CompileError) {
    let (code, span, help) = match error {
        CompileError::TooLarge { span, .. } => {
            ("too-large", *span, "split the energy into several `psi` statements or simplify it")
        }
        CompileError::NoHorizon { span, .. } => {
            ("no-horizon", *span, "give the horizon: --delta 0.1")
        }
        CompileError::WrongDimension(_) | CompileError::Backend(_) => {
            render::error(&error.to_string(), None);
            return;
        }
    };
    let diagnostic = piola_grammar::Diagnostic::error(code, span, error.to_string()).help(help);
    let source = render::Source { name: &loaded.name, text: &loaded.text };
    render::print(source, &[diagnostic], Format::Human);
}
