//! Vectors of parameters, sums over their entries and invariants by their names, written out before anything else
//! looks at a file.
//!
//! `parameter mu(3)` declares `mu1`, `mu2` and `mu3`; `mu(2)` is `mu2`, and `sum(k, mu(k)*x^k)` is
//! `mu1*x^1 + mu2*x^2 + mu3*x^3`; `I1` is `tr(C)`. All that follows knows parameters, sums of terms and tensors only.

use std::borrow::Cow;
use std::collections::HashMap;

use rustc_hash::FxHashMap;

use piola_grammar::ast::{
    Arena, Ast, BinaryOperator, Definition, ExprId, ExprKind, Ident, Parameter, Statement,
    UnaryOperator, Update,
};
use piola_grammar::names::entry;
use piola_grammar::{Diagnostic, Span};

use super::MAX_FINDINGS;
use super::invariants;
use super::names::{is_function, may_be_named, parts};
use super::symbols::{Symbol, Symbols};

/// What sums up over entries.
pub(super) const SUM: &str = "sum";

/// Most expressions that a file may have once its sums are written out.
const MAX_EXPRESSIONS: usize = 200_000;

/// The same file without vectors of parameters, sums over them and names of invariants.
pub(super) fn written_out<'a>(ast: &'a Ast, errors: &mut Vec<Diagnostic>) -> Cow<'a, Ast> {
    let has_entries = ast.statements.iter().any(|statement| match statement {
        Statement::Parameter(parameter) => parameter.size.is_some() || parameter.defaults.len() > 1,
        Statement::Update(update) => update.index.is_some(),
        _ => false,
    });
    let is_written_out = |kind: &ExprKind| match kind {
        ExprKind::Name(name) => invariants::is_of_strain(name),
        ExprKind::Call { function, .. } => {
            function.name == SUM || invariants::is_of_fibre(&function.name)
        }
        _ => false,
    };
    if !has_entries && !ast.arena.iter().any(|(_, expression)| is_written_out(&expression.kind)) {
        return Cow::Borrowed(ast);
    }
    let mut writer = Writer::new(ast, errors);
    let mut statements = Vec::new();
    for statement in &ast.statements {
        writer.statement(statement, &mut statements);
    }
    let (name, title) = (ast.name.clone(), ast.title.clone());
    Cow::Owned(Ast { name, title, statements, arena: writer.arena })
}

/// What names stand for where an expression is copied.
#[derive(Clone, Default)]
struct Scope<'a> {
    /// The formal parameters of a function, which hide vectors.
    formals: &'a [Ident],
    /// What counts entries, and the entry that it stands for.
    indices: Vec<(&'a str, u32)>,
    /// The entry that a vector's own name stands for: in conditions on parameters.
    own: Option<u32>,
}

impl<'a> Scope<'a> {
    fn index(&self, name: &str) -> Option<u32> {
        self.indices.iter().rev().find(|(index, _)| *index == name).map(|(_, entry)| *entry)
    }

    fn hides(&self, name: &str) -> bool {
        self.formals.iter().any(|formal| formal.name == name)
    }

    fn with(&self, index: &'a str, entry: u32) -> Scope<'a> {
        let mut scope = self.clone();
        scope.indices.push((index, entry));
        scope
    }
}

struct Writer<'a, 'e> {
    old: &'a Ast,
    arena: Arena,
    /// How many entries each vector has.
    vectors: HashMap<&'a str, u32>,
    /// What else the file defines, with its place.
    defined: HashMap<&'a str, Span>,
    errors: &'e mut Vec<Diagnostic>,
    /// Whether the file knows vectors of space.
    knows_vectors: bool,
    /// Whether the file knows the tensors that invariants are of.
    knows_invariants: bool,
    is_full: bool,
}

impl<'a, 'e> Writer<'a, 'e> {
    fn new(old: &'a Ast, errors: &'e mut Vec<Diagnostic>) -> Self {
        let (mut vectors, mut defined) = (HashMap::new(), HashMap::new());
        for statement in &old.statements {
            match statement {
                Statement::Parameter(Parameter { name, size: Some((size, _)), .. }) => {
                    vectors.entry(name.name.as_str()).or_insert(*size);
                }
                Statement::Parameter(Parameter { name, .. })
                | Statement::Definition(Definition { name, .. }) => {
                    defined.entry(name.name.as_str()).or_insert(name.span);
                }
                _ => {}
            }
        }
        let arena = Arena::default();
        let symbols = Symbols::of_potentials(old);
        let is_defined = |word: &str| defined.contains_key(word) || vectors.contains_key(word);
        let knows_invariants = matches!(symbols.get("C"), Some(Symbol::Kinematic(_)))
            && !invariants::WORDS.iter().any(|word| is_defined(word));
        let knows_vectors = symbols.tensors;
        Writer {
            old,
            arena,
            vectors,
            defined,
            errors,
            knows_vectors,
            knows_invariants,
            is_full: false,
        }
    }

    fn report(&mut self, error: Diagnostic) {
        if self.errors.len() < MAX_FINDINGS {
            self.errors.push(error);
        }
    }

    /// Copies a statement; a vector's declaration and update become one for each entry.
    fn statement(&mut self, statement: &'a Statement, out: &mut Vec<Statement>) {
        match statement {
            Statement::Parameter(parameter) => self.parameter(parameter, out),
            Statement::Update(update) => self.update(update, out),
            Statement::Definition(Definition { parameters: Some(formals), .. }) => {
                let scope = Scope { formals, ..Scope::default() };
                out.push(self.with_expressions(statement.clone(), &scope));
            }
            other => out.push(self.with_expressions(other.clone(), &Scope::default())),
        }
    }

    /// A statement whose expressions are copied.
    fn with_expressions(&mut self, mut statement: Statement, scope: &Scope<'a>) -> Statement {
        for expression in statement.expressions_mut() {
            *expression = self.copy(*expression, scope);
        }
        statement
    }

    fn parameter(&mut self, parameter: &'a Parameter, out: &mut Vec<Statement>) {
        let Parameter { name, size, defaults, .. } = parameter;
        let n = size.map_or(1, |(size, _)| size);
        if size.is_some() && may_be_named(name, self.errors) {
            self.refuse_second(name);
        }
        if defaults.len() > 1 && defaults.len() != n as usize {
            let span = self.old.arena[defaults[0]].span;
            let span = span.to(self.old.arena[defaults[defaults.len() - 1]].span);
            let (given, is_vector) = (defaults.len(), size.is_some());
            let message = if is_vector {
                format!("`{}` has {n} entries, and {given} values stand here", name.name)
            } else {
                format!("`{}` is one number, and {given} stand here", name.name)
            };
            let word = if parameter.is_state { "state" } else { "parameter" };
            let vector = format!("`{word} {}({given}) = (..)` is a vector of {given}", name.name);
            let help = match n {
                1 => vector,
                _ => format!("write {n} values, or one for all entries; {vector}"),
            };
            self.report(Diagnostic::error("wrong-shape", span, message).help(help));
        }
        for k in 1..=n {
            let own = size.map(|_| k);
            let default = defaults.get(k as usize - 1).or(defaults.first());
            let mut entry_of = parameter.clone();
            entry_of.size = None;
            entry_of.defaults = default.copied().into_iter().collect();
            if let Some(k) = own {
                entry_of.name.name = entry(&name.name, k);
            }
            let scope = Scope { own, ..Scope::default() };
            out.push(self.with_expressions(Statement::Parameter(entry_of), &scope));
        }
    }

    /// Reports a vector whose name something else has, above or below it.
    fn refuse_second(&mut self, name: &'a Ident) {
        let first = match self.defined.insert(&name.name, name.span) {
            Some(first) => first,
            None => return,
        };
        let message = format!("`{}` is defined a second time", name.name);
        self.report(
            Diagnostic::error("duplicate-name", first.max(name.span), message)
                .note(first.min(name.span), "first defined here")
                .help("give one of them another name"),
        );
    }

    fn update(&mut self, update: &'a Update, out: &mut Vec<Statement>) {
        let Update { state, index, body, span } = update;
        let size = self.vectors.get(state.name.as_str()).copied();
        let (Some(index), Some(n)) = (index, size) else {
            match (index, size) {
                (Some(index), None) if self.defined.contains_key(state.name.as_str()) => {
                    let message = format!("`{}` has no entries", state.name);
                    let error = Diagnostic::error("wrong-shape", index.span, message);
                    self.report(error.help(format!("write `update {} = ..`", state.name)));
                }
                (None, Some(n)) => {
                    let message = format!("`{}` has {n} entries", state.name);
                    let error = Diagnostic::error("wrong-shape", state.span, message);
                    self.report(error.help(format!(
                        "write `update {0}(k) = ..`, with `{0}(k)` for the entry that is updated",
                        state.name
                    )));
                    return;
                }
                _ => {}
            }
            let body = self.copy(*body, &Scope::default());
            let update = Update { state: state.clone(), index: None, body, span: *span };
            out.push(Statement::Update(update));
            return;
        };
        self.check_index(index, &Scope::default());
        for k in 1..=n {
            let body = self.copy(*body, &Scope::default().with(&index.name, k));
            let state = Ident { name: entry(&state.name, k), span: state.span };
            out.push(Statement::Update(Update { state, index: None, body, span: *span }));
        }
    }

    /// Copies an expression; entries become names, sums become terms.
    fn copy(&mut self, root: ExprId, scope: &Scope<'a>) -> ExprId {
        let (mut order, mut wanted) = (Vec::new(), vec![root]);
        while let Some(id) = wanted.pop() {
            order.push(id);
            if !self.is_own(&self.old.arena[id].kind, scope) {
                wanted.extend(self.old.arena[id].kind.operands());
            }
        }
        // A tree is written to the arena as it is parsed, operands first.
        order.sort_unstable();
        let mut copies = FxHashMap::default();
        for id in order {
            if self.arena.len() >= MAX_EXPRESSIONS {
                self.out_of_room(self.old.arena[id].span);
                break;
            }
            let copy = self.node(id, &copies, scope);
            copies.insert(id, copy);
        }
        let nothing = || self.arena.push(ExprKind::Number(0.0), self.old.arena[root].span);
        copies.get(&root).copied().unwrap_or_else(nothing)
    }

    fn out_of_room(&mut self, span: Span) {
        if !std::mem::replace(&mut self.is_full, true) {
            let message = format!("the sums of the file have more than {MAX_EXPRESSIONS} parts");
            self.report(
                Diagnostic::error("too-large", span, message).label("the limit is passed here"),
            );
        }
    }

    /// Whether the operands of an expression are not copied as they stand.
    fn is_own(&self, kind: &ExprKind, scope: &Scope<'_>) -> bool {
        let ExprKind::Call { function, .. } = kind else { return false };
        let name = function.name.as_str();
        !scope.hides(name) && (self.vectors.contains_key(name) || self.is_sum(name))
    }

    fn is_sum(&self, name: &str) -> bool {
        name == SUM && !self.defined.contains_key(SUM)
    }

    fn node(
        &mut self,
        id: ExprId,
        copies: &FxHashMap<ExprId, ExprId>,
        scope: &Scope<'a>,
    ) -> ExprId {
        let old: &'a Ast = self.old;
        let (mut kind, span) = (old.arena[id].kind.clone(), old.arena[id].span);
        let of = |id: &mut ExprId| *id = copies[id];
        match &mut kind {
            ExprKind::Name(name) => match scope.index(name) {
                Some(entry) => kind = ExprKind::Number(f64::from(entry)),
                None if scope.hides(name) => {}
                None => {
                    if let Some(&size) = self.vectors.get(name.as_str()) {
                        kind = self.whole_vector(name, size, scope, span);
                    } else if self.is_free(name, scope) {
                        kind = invariants::of_strain(&mut self.arena, name, span).unwrap_or(kind);
                    }
                }
            },
            ExprKind::Call { .. } if self.is_own(&old.arena[id].kind, scope) => {
                let ExprKind::Call { function, arguments } = &old.arena[id].kind else {
                    return self.arena.push(kind, span);
                };
                if self.vectors.contains_key(function.name.as_str()) {
                    kind = self.entry(function, arguments, scope);
                } else {
                    return self.sum(arguments, scope, span);
                }
            }
            ExprKind::Call { function, arguments }
                if invariants::is_of_fibre(&function.name)
                    && arguments.len() == 1
                    && self.is_free(&function.name, scope) =>
            {
                let n = copies[&arguments[0]];
                kind = invariants::of_fibre(&mut self.arena, &function.name, n, span);
            }
            others => others.operands_mut().into_iter().for_each(of),
        }
        self.arena.push(kind, span)
    }

    /// Whether a file may mean an invariant by a name.
    fn is_free(&self, name: &str, scope: &Scope<'_>) -> bool {
        self.knows_invariants && !self.defined.contains_key(name) && !scope.hides(name)
    }

    /// A vector's name without an entry: the entry of a condition, or all of them as a vector of space.
    fn whole_vector(&mut self, name: &str, n: u32, scope: &Scope<'_>, span: Span) -> ExprKind {
        if let Some(own) = scope.own.filter(|own| *own <= n) {
            return ExprKind::Name(entry(name, own));
        }
        if !matches!(n, 2 | 3) || !self.knows_vectors {
            let message = format!("`{name}` has {n} entries, and a number is expected here");
            let help = format!(
                "write an entry, `{name}(1)`, or a sum over all of them, `sum(k, {name}(k)*..)`"
            );
            self.report(Diagnostic::error("wrong-shape", span, message).help(help));
            return ExprKind::Number(0.0);
        }
        let name = |k| self.arena.push(ExprKind::Name(entry(name, k)), span);
        let arguments = (1..=n).map(name).collect();
        ExprKind::Call { function: Ident { name: "vector".into(), span }, arguments }
    }

    /// `mu(k)`, of a `k` that is known.
    fn entry(&mut self, vector: &Ident, given: &[ExprId], scope: &Scope<'_>) -> ExprKind {
        let (name, n) = (&vector.name, self.vectors[vector.name.as_str()]);
        let number = match given {
            [only] => self.whole(*only, scope, 0),
            _ => None,
        };
        match number.and_then(|number| u32::try_from(number).ok()) {
            Some(number) if (1..=n).contains(&number) => ExprKind::Name(entry(name, number)),
            _ => {
                let span = given.first().map_or(vector.span, |given| self.old.arena[*given].span);
                let found = number.map(|number| format!(", not {number}")).unwrap_or_default();
                let message = format!("entries of `{name}` count from 1 to {n}{found}");
                self.report(Diagnostic::error("wrong-shape", span, message).help(format!(
                    "write a whole number, or what counts in a sum: `sum(k, {name}(k)*..)`; a function \
                     takes the entry itself, `f({name}(1))`"
                )));
                ExprKind::Number(0.0)
            }
        }
    }

    /// A whole number made of numbers and of what counts entries.
    fn whole(&self, id: ExprId, scope: &Scope<'_>, depth: usize) -> Option<i64> {
        let of = |id: ExprId| if depth < 20 { self.whole(id, scope, depth + 1) } else { None };
        match &self.old.arena[id].kind {
            ExprKind::Number(x) if x.fract() == 0.0 && *x < 1e9 => Some(*x as i64),
            ExprKind::Name(name) => scope.index(name).map(i64::from),
            ExprKind::Unary { operator: UnaryOperator::Negate, operand } => {
                of(*operand).map(|x| -x)
            }
            ExprKind::Binary { operator, left, right } => {
                let (x, y) = (of(*left)?, of(*right)?);
                match operator {
                    BinaryOperator::Add => x.checked_add(y),
                    BinaryOperator::Subtract => x.checked_sub(y),
                    BinaryOperator::Multiply => x.checked_mul(y),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// `sum(k, ..)` over the entries of the vectors that `k` counts, or `sum(k, 1, 5, ..)`.
    fn sum(&mut self, given: &[ExprId], scope: &Scope<'a>, span: Span) -> ExprId {
        let terms = self.terms(given, scope, span);
        let (Some((index, first, last)), Some(body)) = (terms, given.last()) else {
            return self.arena.push(ExprKind::Number(0.0), span);
        };
        let mut sum = None;
        for k in first..=last {
            let term = self.copy(*body, &scope.with(index, k));
            let add = |left| ExprKind::Binary { operator: BinaryOperator::Add, left, right: term };
            sum = Some(sum.map_or(term, |left| self.arena.push(add(left), span)));
            if self.is_full {
                break;
            }
        }
        sum.unwrap_or_else(|| self.arena.push(ExprKind::Number(0.0), span))
    }

    /// What counts the terms of a sum, and from where to where.
    fn terms(
        &mut self,
        given: &[ExprId],
        scope: &Scope<'a>,
        span: Span,
    ) -> Option<(&'a str, u32, u32)> {
        let old: &'a Ast = self.old;
        let example = "write `sum(k, mu(k)*x^k)` for all entries of `mu`, or `sum(k, 1, 5, x^k)`";
        let index = given.first().map(|first| &old.arena[*first]);
        let index = index.and_then(|index| match &index.kind {
            ExprKind::Name(name) => Some(Ident { name: name.clone(), span: index.span }),
            _ => None,
        });
        let (Some(index), 2 | 4) = (index, given.len()) else {
            let message = "`sum` takes what counts, and what is summed up";
            let error = Diagnostic::error("wrong-number-of-arguments", span, message);
            self.report(error.help(example));
            return None;
        };
        self.check_index(&index, scope).then_some(())?;
        let ExprKind::Name(name) = &old.arena[given[0]].kind else { return None };
        if let [_, first, last, _] = given {
            let mut end = |id: ExprId| {
                let end = self.whole(id, scope, 0).filter(|end| (0..=10_000).contains(end));
                if end.is_none() {
                    let span = old.arena[id].span;
                    let message = "a sum counts from one whole number to another, at most 10000";
                    self.report(Diagnostic::error("wrong-shape", span, message).help(example));
                }
                end.map(|end| end as u32)
            };
            let (first, last) = (end(*first), end(*last));
            return Some((name, first?, last?));
        }
        let n = self.entries_counted(name, given[1], scope, index.span)?;
        Some((name, 1, n))
    }

    /// How many entries the vectors have of which `index` is the entry in this expression.
    fn entries_counted(
        &mut self,
        index: &str,
        body: ExprId,
        scope: &Scope<'_>,
        span: Span,
    ) -> Option<u32> {
        let arena = &self.old.arena;
        let mut counted: Vec<(&Ident, Option<u32>)> = Vec::new();
        for id in parts(arena, body) {
            if let ExprKind::Call { function, arguments } = &arena[id].kind
                && let [only] = arguments.as_slice()
                && matches!(&arena[*only].kind, ExprKind::Name(name) if name == index)
                && !scope.hides(&function.name)
            {
                let size = self.vectors.get(function.name.as_str()).copied();
                let is_lost = !self.defined.contains_key(function.name.as_str());
                if size.is_some() || is_lost && !is_function(&function.name) {
                    counted.push((function, size));
                }
            }
        }
        let Some((first, n)) = counted.iter().find_map(|(vector, size)| Some((*vector, (*size)?)))
        else {
            // A name that is not known is told as such.
            if !counted.is_empty() {
                return Some(1);
            }
            let message = format!("`{index}` counts the entries of no vector");
            let error = Diagnostic::error("wrong-shape", span, message);
            self.report(error.help(format!(
                "declare one, `parameter mu(3)`, and write `mu({index})`; or say from where to where: \
                 `sum({index}, 1, 5, ..)`"
            )));
            return None;
        };
        let other = counted.iter().find(|(_, size)| size.is_some_and(|size| size != n));
        if let Some((other, size)) = other {
            let (a, b, m) = (&first.name, &other.name, size.unwrap_or(0));
            let message = format!("`{a}` has {n} entries and `{b}` has {m}");
            let error = Diagnostic::error("wrong-shape", other.span, message);
            let error = error.note(first.span, "the sum counts the entries of this one");
            self.report(error.help(format!(
                "sums count vectors of one size; or say from where to where: `sum({index}, 1, {}, ..)`",
                n.min(m)
            )));
            return None;
        }
        Some(n)
    }

    /// Whether a name is free to count entries.
    fn check_index(&mut self, index: &Ident, scope: &Scope<'_>) -> bool {
        let name = index.name.as_str();
        if !may_be_named(index, self.errors) {
            return false;
        }
        let first = self.defined.get(name).copied();
        let formal = scope.formals.iter().find(|formal| formal.name == name);
        let counts = scope.index(name).is_some() || self.vectors.contains_key(name);
        if first.is_none() && formal.is_none() && !counts {
            return true;
        }
        let message = format!("`{name}` is something else already and cannot count entries");
        let error = Diagnostic::error("duplicate-name", index.span, message);
        let place = first.or(formal.map(|formal| formal.span));
        let error = match place {
            Some(place) => error.note(place, "defined here"),
            None => error,
        };
        self.report(error.help("count with another name"));
        false
    }
}
