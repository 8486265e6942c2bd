//! Every name is known, used as what it is, and defined before its use.

use std::collections::HashMap;

use piola_grammar::ast::{Arena, Ast, ExprId, ExprKind, Ident, Statement, Unit};
use piola_grammar::names::{BINARY_FUNCTIONS, UNARY_FUNCTIONS};
use piola_grammar::{Diagnostic, Span, counted, suggest};

use super::MAX_FINDINGS;
use super::dissipation;
use super::foreign::{self, Place};
use super::symbols::{BOND_NOW, Symbol, Symbols, TensorFunction};
use crate::expression::{Function, Operator};

/// Most parameters a function may have; every call names them all in its messages.
const MAX_FORMALS: usize = 100;

/// What gathers over the family of a point.
pub(super) const INTEGRAL: &str = "integral";

/// What the other end of a bond gathers.
pub(super) const NEIGHBOUR: &str = "neighbour";

/// Among more names than this none is looked for that may have been meant.
const MAX_CANDIDATES: usize = 2000;

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
    ("dissipation", "a potential of rates"),
    ("inf", "infinity, the end of a domain"),
];

/// Names that mean the same in every file, with what they are.
pub fn reserved_names() -> &'static [(&'static str, &'static str)] {
    RESERVED
}

/// What a name may refer to at some place.
pub(crate) struct Scope<'a> {
    /// Names and what they are; formal parameters of a function hide them.
    pub(crate) symbols: &'a Symbols<'a>,
    /// Formal parameters of the function whose body is looked at.
    pub(crate) formals: &'a [Ident],
}

/// Resolves the names of a file; the second part says which of them are wrong.
pub(crate) fn resolve(ast: &Ast) -> (Symbols<'_>, Vec<Diagnostic>) {
    let mut resolver = Resolver {
        ast,
        symbols: Symbols::of_potentials(ast),
        n_parameters: 0,
        places: HashMap::new(),
        errors: Vec::new(),
    };
    for (number, statement) in ast.statements.iter().enumerate() {
        resolver.statement(number, statement);
        if resolver.errors.len() >= MAX_FINDINGS {
            break;
        }
    }
    (resolver.symbols, resolver.errors)
}

/// Goes through a file from top to bottom.
struct Resolver<'a> {
    ast: &'a Ast,
    symbols: Symbols<'a>,
    n_parameters: usize,
    /// Where each name is defined.
    places: HashMap<&'a str, Span>,
    errors: Vec<Diagnostic>,
}

impl<'a> Resolver<'a> {
    fn statement(&mut self, number: usize, statement: &'a Statement) {
        match statement {
            Statement::Parameter(p) => {
                for &default in &p.defaults {
                    self.body(default, &[]);
                }
                if self.define(&p.name) {
                    self.symbols.names.insert(&p.name.name, Symbol::Parameter(self.n_parameters));
                    self.symbols.states.extend(p.is_state.then_some(self.n_parameters));
                }
                self.n_parameters += 1;
                for &id in &p.constraints {
                    self.body(id, &[]);
                }
                self.unit(&p.unit);
            }
            Statement::Definition(definition) => {
                let formals = definition.parameters.as_deref().unwrap_or(&[]);
                let before = self.errors.len();
                check_formals(formals, &mut self.errors);
                if self.errors.len() > before {
                    self.symbols.unresolved.insert(definition.body);
                } else {
                    self.body(definition.body, formals);
                }
                self.unit(&definition.unit);
                if self.define(&definition.name) {
                    let symbol = match definition.parameters {
                        Some(_) => Symbol::Function(number),
                        None => Symbol::Value(number),
                    };
                    self.symbols.names.insert(&definition.name.name, symbol);
                }
            }
            Statement::Energy(energy) | Statement::Dissipation(energy) => {
                self.body(energy.body, &[]);
            }
            Statement::Domain(domain) => self.body(domain.quantity, &[]),
            Statement::Break(breaking) => self.body(breaking.condition, &[]),
            Statement::Update(update) => {
                self.body(update.body, &[]);
                self.state(&update.state);
            }
            Statement::Source(_)
            | Statement::Import(..)
            | Statement::Allow(_)
            | Statement::Dimensions(_)
            | Statement::Weights(_) => {}
        }
    }

    fn unit(&mut self, unit: &Option<Unit>) {
        for exponent in unit.iter().flat_map(|u| &u.factors).filter_map(|f| f.exponent) {
            self.body(exponent, &[]);
        }
    }

    fn body(&mut self, root: ExprId, formals: &[Ident]) {
        let scope = Scope { symbols: &self.symbols, formals };
        let mut checker = Checker {
            arena: &self.ast.arena,
            scope,
            ast: Some(self.ast),
            errors: &mut self.errors,
        };
        if !checker.body(root) {
            self.symbols.unresolved.insert(root);
        }
    }

    /// Reports what is updated and no state.
    fn state(&mut self, name: &Ident) {
        let number = match self.symbols.get(&name.name) {
            Some(Symbol::Parameter(number)) => Some(number),
            _ => None,
        };
        if number.is_some_and(|number| self.symbols.states.contains(&number)) {
            return;
        }
        let later = self.ast.statements.iter().any(
            |s| matches!(s, Statement::Parameter(p) if p.is_state && p.name.name == name.name),
        );
        let message = format!("`{}` is no state", name.name);
        let error = Diagnostic::error("not-a-state", name.span, message);
        let help = match (later, self.places.get(name.name.as_str())) {
            (true, _) => "a state is declared above the line that updates it".to_string(),
            (_, Some(_)) => format!(
                "what changes is declared so: `state {} = 0`, with the value that bonds begin with",
                name.name
            ),
            _ => format!(
                "declare it above, with the value that bonds begin with: `state {} = 0`",
                name.name
            ),
        };
        self.errors.push(error.label("nothing that an interaction remembers").help(help));
    }

    /// Whether the name is free; reports it if not.
    fn define(&mut self, name: &'a Ident) -> bool {
        if !may_be_named(name, &mut self.errors) {
            return false;
        }
        if let Some(&first) = self.places.get(name.name.as_str()) {
            let message = format!("`{}` is defined a second time", name.name);
            self.errors.push(
                Diagnostic::error("duplicate-name", name.span, message)
                    .label("defined again here")
                    .note(first, "first defined here")
                    .help("give one of them another name"),
            );
            return false;
        }
        self.places.insert(&name.name, name.span);
        true
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

/// Whether the language has a function of this name, in some files.
pub(super) fn is_function(name: &str) -> bool {
    Function::named(name).is_some()
        || Operator::named(name).is_some()
        || TensorFunction::named(name).is_some()
        || matches!(name, INTEGRAL | NEIGHBOUR | dissipation::NAME)
}

/// Whether a name is free for what a file defines; reports it if not.
pub(super) fn may_be_named(name: &Ident, errors: &mut Vec<Diagnostic>) -> bool {
    let builtin = Function::named(&name.name).is_some() || Operator::named(&name.name).is_some();
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
    if let Some(first) = formals.get(MAX_FORMALS) {
        let message = format!("a function has at most {MAX_FORMALS} parameters");
        errors.push(Diagnostic::error("too-large", first.span, message));
        return;
    }
    for (i, formal) in formals.iter().enumerate() {
        // `w(L) = ..` is a function of the length at rest.
        let of_rest = formals.len() == 1 && formal.name == "L";
        if (of_rest || may_be_named(formal, errors))
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

struct Checker<'a> {
    arena: &'a Arena,
    scope: Scope<'a>,
    /// The file, for what is defined later in it.
    ast: Option<&'a Ast>,
    errors: &'a mut Vec<Diagnostic>,
}

impl Checker<'_> {
    /// Whether nothing was found.
    fn body(&mut self, root: ExprId) -> bool {
        let before = self.errors.len();
        for id in parts(self.arena, root) {
            if self.errors.len() >= MAX_FINDINGS {
                break;
            }
            let span = self.arena[id].span;
            match &self.arena[id].kind {
                ExprKind::Name(name) => self.name(name, span),
                ExprKind::Call { function, arguments } => {
                    self.call(function, arguments.len(), span)
                }
                _ => {}
            }
        }
        self.errors.len() == before
    }

    fn name(&mut self, name: &str, span: Span) {
        if self.scope.formals.iter().any(|f| f.name == name) {
            return;
        }
        match self.scope.symbols.get(name) {
            Some(Symbol::Function(number)) if self.is_of_rest(number) => {}
            Some(Symbol::Function(number)) => {
                let arity = self.arity(number);
                self.errors.push(not_called(name, arity, span));
            }
            Some(_) => {}
            None if self.is_builtin(name) => {
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
            // Of a tensor `F(1, 2)` is a component; of which values are tensors the check knows.
            Some(
                Symbol::Kinematic(_) | Symbol::Value(_) | Symbol::Bond(_) | Symbol::BondNow(_),
            ) if self.scope.symbols.tensors && matches!(given, 1..=3) => {
                return;
            }
            Some(_) if name == dissipation::NAME => {
                self.errors.push(not_a_function(function).help(
                    "`rate(l)` is how fast a bond's length changes where nothing else is called `rate`: \
                     give that another name",
                ));
                return;
            }
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
            // Its components are counted once the dimension is known.
            None if self.is_builtin(name)
                && TensorFunction::named(name).is_some_and(TensorFunction::takes_components) =>
            {
                return;
            }
            None if self.is_builtin(name) => Some(builtin_arity(name)),
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

    fn is_builtin(&self, name: &str) -> bool {
        let tensors = self.scope.symbols.tensors && TensorFunction::named(name).is_some();
        let of_bonds =
            matches!(name, INTEGRAL | NEIGHBOUR | dissipation::NAME) && self.ast.is_some();
        let function = Function::named(name).is_some() || Operator::named(name).is_some();
        tensors || of_bonds || function
    }

    /// Whether a function is one of `L` alone: without arguments it is taken at `L`.
    fn is_of_rest(&self, number: usize) -> bool {
        self.ast.is_some_and(|ast| is_of_rest(&ast.statements[number]))
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
        let has_gradient = self.scope.symbols.get("F").is_some();
        let has_bond = self.scope.symbols.get(BOND_NOW).is_some();
        if has_bond && !has_gradient && matches!(name, "F" | "J") {
            return error.help(
                "gradients are known in files with `psi(F)`; those that points gather are defined: \
                 `H = integral(w*dyad(xi - Xi, Xi))*inv(K)`, `G = I + H`",
            );
        }
        let knows_tensors = has_gradient || has_bond && what == "function";
        let place = match (self.ast.is_some(), knows_tensors) {
            (true, true) => Place::EnergyOfGradient,
            (true, false) => Place::Energy,
            (false, _) => Place::Scene,
        };
        if let Some(instead) = foreign::instead(name, place) {
            return error.help(instead);
        }
        if has_gradient && let Some(component) = foreign::component(name) {
            return error.help(format!(
                "a component is `{component}`; to have it as a name, define it: `{name} = {component}`"
            ));
        }
        let reserved = RESERVED.iter().find(|(reserved, _)| *reserved == name);
        if let (Some((_, meaning)), true) = (reserved, self.ast.is_some()) {
            return error.help(format!("`{name}` is {meaning} and cannot be used here"));
        }
        let known = self.known_names();
        let of_families =
            if what == "function" && self.ast.is_some() { &[INTEGRAL, NEIGHBOUR][..] } else { &[] };
        if let Some(near) = suggest(name, known.iter().chain(of_families).copied()) {
            error.help(format!("did you mean `{near}`?"))
        } else if self.ast.is_some() && name == "J" {
            // Other names of gradients are those of parameters more often.
            error.help(
                "`J` is known in potentials that have an energy `psi(F)`; here declare it: `parameter J`, or \
                 define it: `J = ..`",
            )
        } else if what == "name" && self.ast.is_some() {
            error.help(format!("declare it: `parameter {name}`, or define it: `{name} = ..`"))
        } else if known.is_empty() {
            error
        } else {
            error.help(format!("known names: {}", known.join(", ")))
        }
    }

    /// What may be used here, in alphabetical order; nothing if it is too much to look through.
    fn known_names(&self) -> Vec<&str> {
        let names = &self.scope.symbols.names;
        if names.len() > MAX_CANDIDATES {
            return Vec::new();
        }
        let known = self.scope.formals.iter().map(|f| f.name.as_str());
        let known = known.chain(names.keys().copied());
        let known = known.chain(UNARY_FUNCTIONS).chain(BINARY_FUNCTIONS);
        let tensors = if self.scope.symbols.tensors { &TensorFunction::NAMES[..] } else { &[] };
        let known = known.chain(tensors.iter().copied());
        let mut known: Vec<&str> = known.collect();
        known.sort_unstable();
        known
    }

    fn defined_later(&self, name: &str) -> Option<Span> {
        self.ast?.statements.iter().find_map(|statement| match statement {
            Statement::Parameter(p) if p.name.name == name => Some(p.name.span),
            Statement::Definition(d) if d.name.name == name => Some(d.name.span),
            _ => None,
        })
    }
}

fn builtin_arity(name: &str) -> usize {
    if Operator::named(name).is_some() { 2 } else { 1 }
}

fn not_called(name: &str, arity: usize, span: Span) -> Diagnostic {
    let names = if name == "atan2" { ["y", "x", "z"] } else { ["x", "y", "z"] };
    let arguments: Vec<&str> = (0..arity).map(|i| names[i.min(2)]).collect();
    Diagnostic::error("function-without-arguments", span, format!("`{name}` is a function"))
        .label("used as a number")
        .help(format!("write `{name}({})`", arguments.join(", ")))
}

pub(super) fn not_a_function(function: &Ident) -> Diagnostic {
    let name = &function.name;
    Diagnostic::error("not-a-function", function.span, format!("`{name}` is not a function"))
        .label("called like one")
        .help(format!("to multiply write `{name}*(..)`"))
}

/// Whether a statement defines a function of `L` alone, such as `w(L) = 1/L`.
pub(crate) fn is_of_rest(statement: &Statement) -> bool {
    let Statement::Definition(definition) = statement else { return false };
    matches!(definition.parameters.as_deref(), Some([only]) if only.name == "L")
}

/// The expressions that a root consists of, operands before users.
pub(crate) fn parts(arena: &Arena, root: ExprId) -> Vec<ExprId> {
    let mut parts = Vec::new();
    let mut wanted = vec![root];
    while let Some(id) = wanted.pop() {
        parts.push(id);
        wanted.extend(arena[id].kind.operands());
    }
    // A tree is written to the arena as it is parsed, operands first.
    parts.sort_unstable();
    parts
}
