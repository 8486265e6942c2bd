//! Every name is known, used as what it is, and defined before its use.

use std::collections::{HashMap, HashSet};

use piola_grammar::ast::{Arena, Ast, ExprId, ExprKind, Ident, Statement};
use piola_grammar::{Diagnostic, Span, suggest};

use crate::expression::Function;
use crate::measure::Measure;

/// What a name outside a function's formal parameters stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Symbol {
    /// Current measure.
    Current(Measure),
    /// Reference measure.
    Reference(Measure),
    /// `delta`
    Horizon,
    /// `d`
    Dimension,
    /// `pi`
    Pi,
    /// A parameter, by number.
    Parameter(usize),
    /// A definition without parameters, by number of its statement.
    Value(usize),
    /// A user's function, by number of its statement.
    Function(usize),
}

/// The names of a file, and which expressions each body consists of.
pub(crate) struct Symbols<'a> {
    names: HashMap<&'a str, Symbol>,
    /// Statements with a name that is wrong: reported already, not looked at again.
    wrong: HashSet<usize>,
    /// How many parameters there are so far.
    n_parameters: usize,
}

/// Names that no potential may redefine.
const RESERVED: &[(&str, &str)] = &[
    ("l", "the length of a bond"),
    ("L", "the reference length of a bond"),
    ("a", "the area measure of a triangle"),
    ("A", "the reference area measure of a triangle"),
    ("v", "the volume measure of a tetrahedron"),
    ("V", "the reference volume measure of a tetrahedron"),
    ("F", "the deformation gradient"),
    ("d", "the number of dimensions"),
    ("delta", "the horizon"),
    ("pi", "the number 3.14159.."),
    ("t", "the load parameter of a scene"),
    ("X", "a coordinate in scenes"),
    ("Y", "a coordinate in scenes"),
    ("Z", "a coordinate in scenes"),
    ("psi", "an energy"),
    ("inf", "infinity, the end of a domain"),
];

/// What a name may refer to at some place.
pub(crate) struct Scope<'a> {
    /// Names and what they are; formal parameters of a function hide them.
    pub(crate) symbols: &'a Symbols<'a>,
    /// Formal parameters of the function whose body is looked at.
    pub(crate) formals: &'a [Ident],
}

impl<'a> Symbols<'a> {
    /// Only what every formula knows: no measures, no user's names.
    pub(crate) fn empty() -> Symbols<'static> {
        Symbols { names: HashMap::new(), wrong: HashSet::new(), n_parameters: 0 }
    }

    /// Declares variables, which count as parameters.
    pub(crate) fn with_variables(variables: &[&'a str]) -> Symbols<'a> {
        let mut symbols = Symbols { names: HashMap::new(), wrong: HashSet::new(), n_parameters: 0 };
        for (number, name) in variables.iter().enumerate() {
            symbols.names.insert(name, Symbol::Parameter(number));
        }
        symbols.names.insert("pi", Symbol::Pi);
        symbols
    }

    fn with_measures() -> Symbols<'a> {
        let mut symbols = Symbols::empty();
        for measure in Measure::ALL {
            symbols.names.insert(measure.symbol(), Symbol::Current(measure));
            symbols.names.insert(measure.reference_symbol(), Symbol::Reference(measure));
        }
        symbols.names.insert("delta", Symbol::Horizon);
        symbols.names.insert("d", Symbol::Dimension);
        symbols.names.insert("pi", Symbol::Pi);
        symbols
    }

    /// Whether a statement's names were all right.
    pub(crate) fn is_sound(&self, statement: usize) -> bool {
        !self.wrong.contains(&statement)
    }

    /// What a name stands for, formal parameters aside.
    pub(crate) fn get(&self, name: &str) -> Option<Symbol> {
        self.names.get(name).copied()
    }
}

/// Resolves the names of a file. Statements with errors are marked, so that the rest can be checked.
pub(crate) fn resolve(ast: &Ast) -> (Symbols<'_>, Vec<Diagnostic>) {
    let mut symbols = Symbols::with_measures();
    let mut places: HashMap<&str, Span> = HashMap::new();
    let mut errors = Vec::new();
    for (number, statement) in ast.statements.iter().enumerate() {
        let before = errors.len();
        statement_names(ast, statement, number, &mut symbols, &mut places, &mut errors);
        if errors.len() > before {
            symbols.wrong.insert(number);
        }
    }
    (symbols, errors)
}

fn statement_names<'a>(
    ast: &'a Ast,
    statement: &'a Statement,
    number: usize,
    symbols: &mut Symbols<'a>,
    places: &mut HashMap<&'a str, Span>,
    errors: &mut Vec<Diagnostic>,
) {
    let arena = &ast.arena;
    match statement {
        Statement::Parameter(p) => {
            if let Some(default) = p.default {
                check_body(arena, default, symbols, &[], ast, errors);
            }
            if define(&p.name, places, errors) {
                symbols.names.insert(&p.name.name, Symbol::Parameter(symbols.n_parameters));
            }
            symbols.n_parameters += 1;
            let exponents = p.unit.iter().flat_map(|u| &u.factors).filter_map(|f| f.exponent);
            for id in p.constraints.iter().copied().chain(exponents) {
                check_body(arena, id, symbols, &[], ast, errors);
            }
        }
        Statement::Definition(definition) => {
            let formals = definition.parameters.as_deref().unwrap_or(&[]);
            check_formals(formals, errors);
            check_body(arena, definition.body, symbols, formals, ast, errors);
            if define(&definition.name, places, errors) {
                let symbol = match definition.parameters {
                    Some(_) => Symbol::Function(number),
                    None => Symbol::Value(number),
                };
                symbols.names.insert(&definition.name.name, symbol);
            }
        }
        Statement::Energy(energy) => check_body(arena, energy.body, symbols, &[], ast, errors),
        Statement::Domain(domain) => check_body(arena, domain.quantity, symbols, &[], ast, errors),
        Statement::Source(_) | Statement::Dimensions(_) => {}
    }
}

/// Checks the names of a lone expression.
pub(crate) fn check_formula(
    arena: &Arena,
    root: ExprId,
    symbols: &Symbols<'_>,
) -> Result<(), Vec<Diagnostic>> {
    let mut errors = Vec::new();
    Checker { arena, scope: Scope { symbols, formals: &[] }, ast: None, errors: &mut errors }
        .body(root);
    if errors.is_empty() { Ok(()) } else { Err(errors) }
}

/// Whether the name is free; reports it if not.
fn define<'a>(
    name: &'a Ident,
    places: &mut HashMap<&'a str, Span>,
    errors: &mut Vec<Diagnostic>,
) -> bool {
    if !may_be_named(name, errors) {
        return false;
    }
    if let Some(&first) = places.get(name.name.as_str()) {
        errors.push(
            Diagnostic::error(
                "duplicate-name",
                name.span,
                format!("`{}` is defined a second time", name.name),
            )
            .label("defined again here")
            .note(first, "first defined here")
            .help("give one of them another name"),
        );
        return false;
    }
    places.insert(&name.name, name.span);
    true
}

fn may_be_named(name: &Ident, errors: &mut Vec<Diagnostic>) -> bool {
    let builtin = Function::named(&name.name).is_some() || matches!(&*name.name, "min" | "max");
    let meaning = if builtin {
        Some("a built-in function")
    } else {
        RESERVED.iter().find(|(reserved, _)| *reserved == name.name).map(|(_, meaning)| *meaning)
    };
    let Some(meaning) = meaning else { return true };
    errors.push(
        Diagnostic::error(
            "reserved-name",
            name.span,
            format!("`{}` is reserved: it is {meaning}", name.name),
        )
        .label("cannot be defined here")
        .help(format!("choose another name, for instance `{}_1`", name.name)),
    );
    false
}

fn check_formals(formals: &[Ident], errors: &mut Vec<Diagnostic>) {
    for (i, formal) in formals.iter().enumerate() {
        if may_be_named(formal, errors)
            && let Some(first) = formals[..i].iter().find(|f| f.name == formal.name)
        {
            errors.push(
                Diagnostic::error(
                    "duplicate-name",
                    formal.span,
                    format!("two parameters of this function are called `{}`", formal.name),
                )
                .note(first.span, "the first is here"),
            );
        }
    }
}

fn check_body(
    arena: &Arena,
    root: ExprId,
    symbols: &Symbols<'_>,
    formals: &[Ident],
    ast: &Ast,
    errors: &mut Vec<Diagnostic>,
) {
    Checker { arena, scope: Scope { symbols, formals }, ast: Some(ast), errors }.body(root);
}

struct Checker<'a> {
    arena: &'a Arena,
    scope: Scope<'a>,
    /// The file, for what is defined later in it.
    ast: Option<&'a Ast>,
    errors: &'a mut Vec<Diagnostic>,
}

impl Checker<'_> {
    fn body(&mut self, root: ExprId) {
        for id in parts(self.arena, root) {
            let span = self.arena[id].span;
            match &self.arena[id].kind {
                ExprKind::Name(name) => self.name(name, span),
                ExprKind::Call { function, arguments } => {
                    self.call(function, arguments.len(), span)
                }
                _ => {}
            }
        }
    }

    fn name(&mut self, name: &str, span: Span) {
        if self.scope.formals.iter().any(|f| f.name == name) {
            return;
        }
        match self.scope.symbols.get(name) {
            Some(Symbol::Function(number)) => {
                let arity = self.arity(number);
                self.errors.push(not_called(name, arity, span));
            }
            Some(_) => {}
            None if is_builtin(name) => {
                self.errors.push(not_called(name, builtin_arity(name), span));
            }
            None => {
                let error = self.unknown(name, span, "name");
                self.errors.push(error);
            }
        }
    }

    fn call(&mut self, function: &Ident, given: usize, span: Span) {
        let name = function.name.as_str();
        if self.scope.formals.iter().any(|f| f.name == name) {
            self.errors.push(not_a_function(function));
            return;
        }
        let arity = match self.scope.symbols.get(name) {
            Some(Symbol::Function(number)) => Some(self.arity(number)),
            Some(_) => {
                self.errors.push(not_a_function(function));
                return;
            }
            None if matches!(name, "min" | "max") => {
                if given < 2 {
                    let message = format!("`{name}` needs at least two numbers");
                    self.errors.push(
                        Diagnostic::error("wrong-number-of-arguments", span, message)
                            .label(format!("{given} given"))
                            .help(format!("write `{name}(x, y)`")),
                    );
                }
                return;
            }
            None if is_builtin(name) => Some(1),
            None => None,
        };
        match arity {
            None => {
                let error = self.unknown(name, function.span, "function");
                self.errors.push(error);
            }
            Some(arity) if arity != given => self.errors.push(
                Diagnostic::error(
                    "wrong-number-of-arguments",
                    span,
                    format!("`{name}` takes {}, not {given}", counted(arity, "argument")),
                )
                .label(format!("{given} given")),
            ),
            Some(_) => {}
        }
    }

    fn arity(&self, number: usize) -> usize {
        match self.ast.map(|ast| &ast.statements[number]) {
            Some(Statement::Definition(d)) => d.parameters.as_ref().map_or(0, Vec::len),
            _ => 0,
        }
    }

    fn unknown(&self, name: &str, span: Span, what: &str) -> Diagnostic {
        let error = Diagnostic::error("unknown-name", span, format!("unknown {what} `{name}`"))
            .label("not known here");
        if let Some(later) = self.defined_later(name) {
            return error
                .note(later, "it is defined here, after its use")
                .help("move the definition above the line that uses it");
        }
        let known = self.scope.formals.iter().map(|f| f.name.as_str());
        let known = known.chain(self.scope.symbols.names.keys().copied());
        let known = known.chain(Function::NAMED.iter().map(|f| f.name())).chain(["min", "max"]);
        let mut known: Vec<&str> = known.collect();
        known.sort_unstable();
        if let Some((_, instead)) = FOREIGN.iter().find(|(foreign, _)| *foreign == name) {
            error.help(instead.to_string())
        } else if let Some(near) = suggest(name, known.iter().copied()) {
            error.help(format!("did you mean `{near}`?"))
        } else if what == "name" && self.ast.is_some() {
            error.help(format!("declare it: `parameter {name}`, or define it: `{name} = ..`"))
        } else {
            error.help(format!("known names: {}", known.join(", ")))
        }
    }

    fn defined_later(&self, name: &str) -> Option<Span> {
        self.ast?.statements.iter().find_map(|statement| match statement {
            Statement::Parameter(p) if p.name.name == name => Some(p.name.span),
            Statement::Definition(d) if d.name.name == name => Some(d.name.span),
            _ => None,
        })
    }
}

/// Names from other languages and what they are called here.
const FOREIGN: &[(&str, &str)] = &[
    ("log", "the natural logarithm is `ln`; a logarithm to base 10 is `ln(x)/ln(10)`"),
    ("log10", "write `ln(x)/ln(10)`"),
    ("log2", "write `ln(x)/ln(2)`"),
    ("pow", "write `x^y`"),
    ("fabs", "the absolute value is `abs`"),
    ("norm", "measures are scalars; the absolute value is `abs`"),
    ("sgn", "the sign is `sign`"),
    ("arcsin", "the inverse sine is `asin`"),
    ("arccos", "the inverse cosine is `acos`"),
    ("arctan", "the inverse tangent is `atan`"),
    ("PI", "write `pi`"),
    ("e", "the base of the natural logarithm is `exp(1)`; the strain of a bond is `l/L - 1`"),
    ("r", "the current length of a bond is `l`, its reference length `L`"),
    ("s", "the stretch of a bond is `l/L - 1`"),
    ("true", "write a comparison that holds, for instance `0 < 1`"),
    ("false", "write a comparison that does not hold, for instance `1 < 0`"),
];

fn is_builtin(name: &str) -> bool {
    Function::named(name).is_some() || matches!(name, "min" | "max")
}

fn builtin_arity(name: &str) -> usize {
    if matches!(name, "min" | "max") { 2 } else { 1 }
}

fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

fn not_called(name: &str, arity: usize, span: Span) -> Diagnostic {
    let arguments: Vec<String> = (0..arity).map(|i| ["x", "y", "z"][i.min(2)].into()).collect();
    Diagnostic::error("function-without-arguments", span, format!("`{name}` is a function"))
        .label("used as a number")
        .help(format!("write `{name}({})`", arguments.join(", ")))
}

fn not_a_function(function: &Ident) -> Diagnostic {
    let name = &function.name;
    Diagnostic::error("not-a-function", function.span, format!("`{name}` is not a function"))
        .label("called like one")
        .help(format!("to multiply write `{name}*(..)`"))
}

/// The expressions that a root consists of, operands before users.
pub(crate) fn parts(arena: &Arena, root: ExprId) -> Vec<ExprId> {
    let n = root.0 as usize + 1;
    // Trees are written out as they are parsed: a root's parts stand right before it.
    let mut parts = Vec::new();
    let mut wanted = std::collections::BTreeSet::from([root]);
    while let Some(id) = wanted.pop_last() {
        debug_assert!((id.0 as usize) < n);
        parts.push(id);
        wanted.extend(children(&arena[id].kind));
    }
    parts.reverse();
    parts
}

/// The operands of an expression.
pub(crate) fn children(kind: &ExprKind) -> Vec<ExprId> {
    match kind {
        ExprKind::Number(_) | ExprKind::Name(_) => Vec::new(),
        ExprKind::Call { arguments, .. } => arguments.clone(),
        ExprKind::Unary { operand, .. } => vec![*operand],
        ExprKind::Binary { left, right, .. } => vec![*left, *right],
        ExprKind::If { condition, then, otherwise } => vec![*condition, *then, *otherwise],
    }
}
