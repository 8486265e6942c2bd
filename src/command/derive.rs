//! `piola derive`: derivatives as text, and every stage on the way to machine code.

use piola_compiler::audit::{self, Lost, Place};
use piola_compiler::coupled::CoupledForm;
use piola_compiler::expression::NodeId;
use piola_compiler::jit::CompiledKernel;
use piola_compiler::point::gradient_listing;
use piola_compiler::rewrite::{self, Explanation, Side};
use piola_compiler::simplify::Rule;
use piola_compiler::{
    Argument, BondFunction, BondFunctionKind, CompileError, Form, GatheredForms,
    GradientEnergyForms, GradientFunction, Measure, Model, OfFamily, Specialised, Values, print,
};

use piola_runtime::output::decimal;

use super::Exit;
use crate::cli::{Derive, Emit};
use crate::console;
use crate::potential::{self, Loaded};
use crate::render;

/// Points of each regime at which `--explain` looks for what is still lost.
const POINTS: usize = 6;

/// Largest error in u = 2^-53 that is not called lost.
const BAR: f64 = 64.0;

pub(super) fn execute(arguments: &Derive) -> Exit {
    let Some(loaded) = potential::load(&arguments.file) else { return Exit::Input };
    let defined: Vec<usize> = loaded.model.dimensions().collect();
    let dimension = arguments.dim.map_or(defined[defined.len() - 1], usize::from);
    match arguments.emit {
        Emit::Ast => {
            console::out(&format!("{:#?}\n", loaded.ast));
            return Exit::Done;
        }
        Emit::Model => {
            console::out(&print::model_listing(&loaded.model));
            return Exit::Done;
        }
        _ => {}
    }
    if arguments.explain {
        return explain(&loaded, dimension, arguments);
    }
    match text(&loaded, dimension, arguments) {
        Ok(text) => {
            console::out(&text);
            Exit::Done
        }
        Err(exit) => exit,
    }
}

/// What a potential is printed as; what is wrong is printed.
pub(super) fn text(loaded: &Loaded, dimension: usize, arguments: &Derive) -> Result<String, Exit> {
    fn made<T>(loaded: &Loaded, found: Option<Result<T, CompileError>>) -> Result<T, Exit> {
        found.ok_or(Exit::Input)?.map_err(|error| {
            print_compile_error(loaded, &error);
            Exit::Input
        })
    }
    let specialised = made(loaded, specialise(loaded, dimension, arguments))?;
    for dropped in &specialised.dropped {
        console::note(&dropped.reason);
    }
    let gradient = made(loaded, specialise_gradient(loaded, dimension, arguments))?;
    let coupled = made(loaded, coupled(loaded, dimension, arguments))?;
    let of_bonds = made(loaded, of_bonds(loaded, dimension, arguments))?;
    let gathered = made(loaded, gathered(loaded, dimension, arguments))?;
    for dropped in &gathered.dropped {
        console::note(&dropped.reason);
    }
    let functions = (&of_bonds.0[..], &of_bonds.1[..]);
    let others = Others { gradient: gradient.as_ref(), coupled: &coupled, functions, gathered };
    made(loaded, Some(emit(loaded, &specialised, others, arguments)))
}

/// Whether parameters are printed as symbols: where that can be and no value is given.
fn stays_symbolic(arguments: &Derive) -> Option<bool> {
    let settings = potential::settings(&arguments.inputs)?;
    let can_be = matches!(arguments.emit, Emit::Text | Emit::Latex | Emit::Graph);
    Some(can_be && settings.is_empty() && arguments.inputs.delta.is_none())
}

/// With parameters as symbols, or with values.
fn specialise(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Result<Specialised, CompileError>> {
    if stays_symbolic(arguments)? {
        return Some(loaded.model.symbolic(dimension));
    }
    let values = filled_values(loaded, dimension, arguments)?;
    Some(loaded.model.specialise(&values))
}

/// The same for the energy of the deformation gradient.
fn specialise_gradient(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Result<Option<GradientEnergyForms>, CompileError>> {
    if stays_symbolic(arguments)? {
        return Some(loaded.model.symbolic_gradient(dimension));
    }
    let values = filled_values(loaded, dimension, arguments)?;
    let found = loaded.model.specialise_gradient(&values, Form::Accurate);
    Some(found.map(|(forms, dropped)| {
        dropped.iter().for_each(|dropped| console::note(&dropped.reason));
        forms
    }))
}

/// The same for energies of several measures.
fn coupled(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Result<Vec<(Measure, CoupledForm)>, CompileError>> {
    let (model, mut found) = (&loaded.model, Vec::new());
    let values = values_unless_symbols(loaded, dimension, arguments)?;
    for clique in model.coupled() {
        let made = match &values {
            None => model.symbolic_coupled(dimension, clique),
            Some(values) => {
                let made = model.specialise_coupled(values, clique, Form::Accurate);
                made.map(|(form, dropped)| {
                    dropped.iter().for_each(|dropped| console::note(&dropped.reason));
                    form
                })
            }
        };
        match made {
            Ok(form) => found.extend(form.map(|form| (clique, form))),
            Err(error) => return Some(Err(error)),
        }
    }
    Some(Ok(found))
}

/// When bonds, triangles and tetrahedra break and what they remember; when bonds do by deformation gradients.
type OfBonds = (Vec<BondFunction>, Vec<GradientFunction>);

fn of_bonds(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Result<OfBonds, CompileError>> {
    let values = values_unless_symbols(loaded, dimension, arguments)?;
    let made = || {
        let functions = loaded.model.bond_functions(dimension, values.as_ref())?;
        Ok((functions, loaded.model.gradient_functions(dimension, values.as_ref())?))
    };
    Some(made())
}

/// What points gather, with all that depends on it.
fn gathered(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Result<GatheredForms, CompileError>> {
    let values = values_unless_symbols(loaded, dimension, arguments)?;
    Some(loaded.model.gathered_forms(dimension, values.as_ref()))
}

/// Values for every parameter; none where parameters can stay symbols and no value is given.
fn values_unless_symbols(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<Option<Values>> {
    if stays_symbolic(arguments)? {
        return Some(None);
    }
    Some(Some(all_values(loaded, dimension, arguments)?.0))
}

/// Values for every parameter: 1 for want of one, which is said.
fn filled_values(loaded: &Loaded, dimension: usize, arguments: &Derive) -> Option<Values> {
    let (values, filled) = all_values(loaded, dimension, arguments)?;
    if !filled.is_empty() {
        console::note(&format!("{} = 1, for want of a value", filled.join(" = ")));
    }
    Some(values)
}

/// The same, and the parameters for want of which 1 stands.
fn all_values(
    loaded: &Loaded,
    dimension: usize,
    arguments: &Derive,
) -> Option<(Values, Vec<String>)> {
    let mut settings = potential::settings(&arguments.inputs)?;
    let filled = loaded.model.fill_with_one(dimension, &mut settings);
    let delta = arguments.inputs.delta.or(Some(1.0));
    let values = potential::values(&loaded.model, dimension, &settings, delta)?;
    Some((values.with_states(&loaded.model), filled))
}

/// Prints what was rewritten, and what it gained.
fn explain(loaded: &Loaded, dimension: usize, arguments: &Derive) -> Exit {
    let Some(values) = filled_values(loaded, dimension, arguments) else { return Exit::Input };
    // With what is remembered at the start, and, of margins and updates, after some histories.
    let values = values.without_fields();
    let settings = audit::Settings {
        form: Form::Accurate,
        level: arguments.level.into(),
        points: POINTS,
        bar: BAR,
    };
    let found = rewrite::explain(&loaded.model, &values);
    let found = found.and_then(|found| {
        let (forms, _) = loaded.model.specialise_gradient(&values, Form::Accurate)?;
        let recognised = forms.map(|forms| forms.recognised).unwrap_or_default();
        Ok((found, recognised, audit::lost(&loaded.model, &values, &settings)?))
    });
    match found {
        Ok((found, recognised, lost)) => {
            let mut parts: Vec<String> = found.iter().map(explanation).collect();
            if loaded.model.has_gradient_energy() {
                parts.extend(recognised.iter().map(|rule| recognition(rule)));
                parts.push(
                    "near rest psi(F) is a function of F - I: `piola derive` with values prints it\n"
                        .into(),
                );
            }
            parts.push(left(loaded, found.is_empty() && recognised.is_empty(), &lost));
            console::out(&parts.join("\n"));
            Exit::Done
        }
        Err(error) => {
            print_compile_error(loaded, &error);
            Exit::Input
        }
    }
}

/// What is lost in the form that runs.
fn left(loaded: &Loaded, is_as_written: bool, lost: &[Lost]) -> String {
    if lost.is_empty() {
        let model = &loaded.model;
        let [energy, first, second] =
            match (model.measures().is_empty(), model.has_gradient_energy()) {
                (false, _) => ["psi", "psi'", "psi''"],
                (true, true) => Argument::Gradient.orders(),
                (true, false) => ["psi", "its gradient", "what that changes by"],
            };
        let subject =
            if is_as_written { "nothing is rewritten, and nothing" } else { "nothing else" };
        return format!(
            "{subject} is lost: {energy}, {first} and {second} keep their digits to {BAR} u, near rest \
             and far from it\n"
        );
    }
    let mut out = "what is left\n".to_string();
    for one in lost {
        let Lost { cause, at, error, .. } = one;
        let place = match at {
            Place::Interaction(at) => {
                format!("at a stretch of {}", decimal(at.measure / at.reference))
            }
            Place::Gradient { change, is_near: true, .. } => {
                format!("where F - I = {}", rows(change))
            }
            Place::Gradient { gradient, .. } => format!("where F = {}", rows(gradient)),
            Place::Several { .. } => {
                let one = |(name, x): (&str, f64)| format!("{name} = {}", short(x));
                format!("at {}", at.numbers().map(one).collect::<Vec<_>>().join(", "))
            }
        };
        out.push_str(&format!(
            "  {} is off by {} {place}\n    {}\n",
            one.subject(),
            units(*error),
            super::verify::advice(cause, &loaded.text)
        ));
    }
    out
}

/// A tensor to three digits: `(1, 0; 0, 1)`.
fn rows(components: &[f64]) -> String {
    let d = if components.len() == 4 { 2 } else { 3 };
    let row = |row: &[f64]| row.iter().map(|x| short(*x)).collect::<Vec<_>>().join(", ");
    format!("({})", components.chunks(d).map(row).collect::<Vec<_>>().join("; "))
}

/// A number to three digits.
fn short(x: f64) -> String {
    match x.abs() {
        size if size == 0.0 || (1e-2..1e4).contains(&size) => {
            format!("{}", (x * 1e3).round() / 1e3)
        }
        _ => format!("{x:.2e}"),
    }
}

fn units(error: f64) -> String {
    format!("{} u", super::audit::units(error))
}

/// An invariant that takes its own form.
fn recognition(rule: &Rule) -> String {
    let Rule { name, identity, condition } = rule;
    format!("psi(F): {name}\n  identity  {identity}\n  valid     {condition}\n")
}

fn explanation(e: &Explanation) -> String {
    let cost = |side: &Side| {
        format!("{} operations, {} calls, {:.1} ns", side.operations, side.calls, side.nanoseconds)
    };
    format!(
        "{}: {}\n  identity  {}\n  valid     {}\n  before    {}\n  after     {}\n\
         \x20 error     near rest {} -> {}, far from it {} -> {}\n  cost      {} -> {}\n",
        audit::title(Argument::Measure(e.measure), e.function.as_ref()),
        e.rule.name,
        e.rule.identity,
        e.rule.condition,
        e.before.text,
        e.after.text,
        units(e.before.near),
        units(e.after.near),
        units(e.before.far),
        units(e.after.far),
        cost(&e.before),
        cost(&e.after),
    )
}

/// What there is beside energies of one measure.
struct Others<'a> {
    gradient: Option<&'a GradientEnergyForms>,
    coupled: &'a [(Measure, CoupledForm)],
    functions: (&'a [BondFunction], &'a [GradientFunction]),
    gathered: GatheredForms,
}

fn emit(
    loaded: &Loaded,
    specialised: &Specialised,
    Others { gradient, coupled, functions: (of_bonds, conditions), gathered }: Others<'_>,
    arguments: &Derive,
) -> Result<String, CompileError> {
    let model = &loaded.model;
    let listing = |energy| CompiledKernel::listing(energy, arguments.level.into());
    if arguments.emit == Emit::C {
        let first = print::c_source(model, &specialised.energies, gradient);
        let several = coupled.iter().map(|(clique, form)| print::coupled_c(model, *clique, form));
        let all = std::iter::once(first).chain(several).collect::<Vec<_>>().join("\n");
        let of_bonds = print::c_of_bonds(model, of_bonds);
        let of_gradients = print::c_of_gradient_functions(model, conditions);
        return Ok(all + &of_bonds + &of_gradients + &print::gathered_c(model, &gathered));
    }
    let mut parts = Vec::new();
    for energy in &specialised.energies {
        parts.push(match arguments.emit {
            Emit::Latex => print::latex(model, energy),
            Emit::Graph => {
                print::graph_listing(model, energy.measure, &energy.graph, &energy.roots)
            }
            Emit::Clif => listing(energy)?.clif,
            Emit::Asm => listing(energy)?.assembly,
            _ => print::text(model, energy),
        });
    }
    let evolution = match arguments.emit {
        Emit::Text => {
            let is_of_gradients = |of: OfFamily| of == OfFamily::Gradient;
            let breaks = model.family_breaks().iter().filter(|one| is_of_gradients(one.of));
            let breaks = breaks.map(|one| format!("break when {}\n", one.text));
            let updates = model.family_updates().iter().filter(|one| is_of_gradients(one.of));
            let updates = updates.map(|one| {
                let name = &model.parameters()[one.state].name;
                format!("update {name} = {}\n", one.text)
            });
            let of_bonds = of_bonds.iter().map(|one| in_words(model, one));
            of_bonds.chain(breaks).chain(updates).collect()
        }
        Emit::Latex => {
            let gradients = print::latex_of_gradient_functions(model, conditions);
            print::latex_of_bonds(model, of_bonds) + &gradients
        }
        _ => String::new(),
    };
    parts.extend(Some(evolution).filter(|lines| !lines.is_empty()));
    if let Some(forms) = gradient {
        let listings = || gradient_listing(forms, arguments.level.into());
        match arguments.emit {
            Emit::Latex => parts.push(gradient_latex(loaded, forms, arguments)),
            Emit::Graph => parts.push(print::gradient_listing(model, forms)),
            Emit::Clif => parts.extend(listings()?.into_iter().map(|listing| listing.clif)),
            Emit::Asm => parts.extend(listings()?.into_iter().map(|listing| listing.assembly)),
            _ => parts.push(print::gradient_text(model, forms)),
        }
    }
    for (clique, form) in coupled {
        let listings = || form.density.listings(arguments.level.into());
        match arguments.emit {
            Emit::Latex => parts.push(print::coupled_latex(model, *clique, form)),
            Emit::Graph => parts.push(print::coupled_listing(model, *clique, form)),
            Emit::Clif => parts.extend(listings()?.into_iter().map(|listing| listing.clif)),
            Emit::Asm => parts.extend(listings()?.into_iter().map(|listing| listing.assembly)),
            _ => parts.push(print::coupled_text(model, *clique, form)),
        }
    }
    if !gathered.functions.is_empty() {
        parts.extend(gathered_parts(model, &gathered, arguments)?);
    }
    Ok(parts.join("\n"))
}

fn gathered_parts(
    model: &Model,
    gathered: &GatheredForms,
    arguments: &Derive,
) -> Result<Vec<String>, CompileError> {
    let level = arguments.level.into();
    let listings = || {
        let integrands = gathered.integrands.iter();
        let mut all = integrands
            .map(|energy| CompiledKernel::listing(energy, level))
            .collect::<Result<Vec<_>, _>>()?;
        for function in &gathered.functions {
            all.extend(function.form.listings(level)?);
        }
        Ok(all.into_iter())
    };
    Ok(match arguments.emit {
        Emit::Latex => vec![print::gathered_latex(model, gathered)],
        Emit::Graph => vec![print::gathered_listing(model, gathered)],
        Emit::Clif => listings()?.map(|listing| listing.clif).collect(),
        Emit::Asm => listings()?.map(|listing| listing.assembly).collect(),
        _ => vec![print::gathered_text(model, gathered)],
    })
}

/// A condition, or what a state becomes, as it is written; what is dissipated with its derivatives.
fn in_words(model: &Model, one: &BondFunction) -> String {
    match &one.kind {
        BondFunctionKind::Margin { .. } => format!("break when {}\n", one.text),
        BondFunctionKind::Next(state) => format!("update {state} = {}\n", one.text),
        BondFunctionKind::Dissipation => {
            let line = |(primes, root): (&str, &NodeId)| {
                let right = print::expression(model, &one.function.graph, *root);
                format!("dissipation{primes}(l) = {right}\n")
            };
            ["", "'", "''"].into_iter().zip(&one.function.roots).map(line).collect()
        }
    }
}

/// In tensors, or in components where it cannot be written so, which is said.
fn gradient_latex(loaded: &Loaded, forms: &GradientEnergyForms, arguments: &Derive) -> String {
    let model = &loaded.model;
    let is_symbolic = arguments.inputs.delta.is_none()
        && potential::settings(&arguments.inputs).is_some_and(|settings| settings.is_empty());
    let given = || all_values(loaded, forms.dimension, arguments).map(|(values, _)| values);
    let values = if is_symbolic { None } else { given() };
    match model.in_tensors(&loaded.ast, forms.dimension, values.as_ref()) {
        Ok(Some(form)) => print::tensor_latex(model, &form),
        Ok(None) => print::gradient_latex(model, forms),
        Err(reason) => {
            console::note(&format!("psi(F) is printed in components: {reason}"));
            print::gradient_latex(model, forms)
        }
    }
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
    render::findings(source, &[diagnostic]);
}
