//! `import "strains.piola"`: what a file uses of the names of others.
//!
//! Parameters, states with what they become, and definitions come along, those that are used and what these
//! use; energies, conditions and all else of the other file stay there. What comes along stands where the
//! import stood, before names are looked up. Its places are places behind the end of the text, until what is
//! wrong with it has been told: by file, line and column.

use std::borrow::Cow;

use rustc_hash::{FxHashMap, FxHashSet};

use piola_grammar::ast::{
    Arena, Ast, Definition, ExprId, ExprKind, Ident, Parameter, Statement, Text, Unit, Update,
};
use piola_grammar::names::entry;
use piola_grammar::{Diagnostic, Reading, Span, read, shortened};

use super::entries::SUM;
use super::names::parts;
use super::{Files, MAX_FINDINGS};

/// The code of an import that brings nothing.
const CODE: &str = "wrong-import";

/// Most files that a potential may import, those of its imports included.
const MAX_FILES: usize = 32;

/// So many of the mistakes of an imported file are told.
const MAX_TOLD: usize = 3;

/// The files that a potential imports, in the order of the text, those that one imports before itself.
#[derive(Default)]
pub(super) struct Imports {
    files: Vec<Import>,
    /// Whether a file could not be read.
    lost: bool,
}

/// A file that is imported.
struct Import {
    /// Its path from the folder of the potential.
    path: String,
    text: String,
    ast: Ast,
    /// Where its text begins, behind all texts before it.
    base: usize,
    /// The statement of the potential that led to it.
    at: Span,
    /// The files that its own imports bring, in the order of its statements.
    brings: Vec<Option<usize>>,
    /// Which of its statements are used.
    used: FxHashSet<usize>,
}

impl Imports {
    /// Reads what a file imports; `length` is that of its text.
    pub(super) fn read(
        ast: &Ast,
        length: usize,
        files: Files<'_>,
        errors: &mut Vec<Diagnostic>,
    ) -> Imports {
        let mut reader = Reader { files, imports: Imports::default(), length, errors };
        for statement in &ast.statements {
            if let Statement::Import(file, at) = statement {
                reader.import(&file.text, "", file.span, *at, &mut Vec::new());
            }
        }
        let lost = reader.errors.iter().any(|error| error.code == CODE);
        let mut imports = Imports { lost, ..reader.imports };
        imports.find_used(ast);
        imports
    }

    /// The number of the file with this path.
    fn of(&self, path: &str) -> Option<usize> {
        self.files.iter().position(|import| import.path == path)
    }

    /// Finds which statements of the files are used, from what the potential names.
    fn find_used(&mut self, ast: &Ast) {
        if self.files.is_empty() {
            return;
        }
        let mut names = FxHashSet::default();
        for statement in &ast.statements {
            names.extend(free_names(&ast.arena, statement));
            match statement {
                Statement::Energy(energy) => {
                    names
                        .extend([&energy.measure].into_iter().chain(&energy.gathered).map(name_of));
                }
                Statement::Update(update) => names.extend([name_of(&update.state)]),
                _ => {}
            }
        }
        // What is used names more; every round finds more or is the last.
        loop {
            let before = names.len();
            for import in &mut self.files {
                import.use_names(&mut names);
            }
            if names.len() == before {
                return;
            }
        }
    }

    /// The tree with what is imported in the place of the imports. Places of what is imported are those behind
    /// the text, or with `at_import` that of the import.
    pub(super) fn merged<'a>(&self, ast: &'a Ast, at_import: bool) -> Cow<'a, Ast> {
        if !ast.statements.iter().any(|s| matches!(s, Statement::Import(..))) {
            return Cow::Borrowed(ast);
        }
        let mut merged = Merged {
            imports: self,
            at_import,
            arena: ast.arena.clone(),
            statements: Vec::new(),
            done: FxHashSet::default(),
        };
        for statement in &ast.statements {
            match statement {
                Statement::Import(file, _) => {
                    if let Some(number) = self.of(&file.text) {
                        merged.file(number);
                    }
                }
                other => merged.statements.push(other.clone()),
            }
        }
        let Merged { arena, statements, .. } = merged;
        Cow::Owned(Ast { statements, arena, name: ast.name.clone(), title: ast.title.clone() })
    }

    /// The same findings at places of the potential's own text.
    pub(super) fn at_home(&self, mut findings: Vec<Diagnostic>) -> Vec<Diagnostic> {
        // A name that nothing defines may be one of a file that is lost.
        findings.retain(|finding| !(self.lost && finding.code == "unknown-name"));
        for finding in &mut findings {
            if let Some(import) = self.holds(finding.span) {
                let message = format!("{}: {}", import.place(finding.span), finding.message);
                finding.message = shortened(&message);
                finding.span = import.at;
                finding.label = "imported here".into();
            }
            for note in &mut finding.notes {
                if let Some(import) = self.holds(note.span) {
                    note.label = format!("{}: {}", import.place(note.span), note.label);
                    note.span = import.at;
                }
            }
        }
        findings.sort_by_key(|finding| finding.span);
        findings
    }

    /// The file that a place is in, if it is none of the potential's own text.
    fn holds(&self, span: Span) -> Option<&Import> {
        let holds = |import: &&Import| {
            (import.base..=import.base + import.text.len()).contains(&(span.start as usize))
        };
        self.files.iter().find(holds)
    }
}

/// The names that a statement uses, without the parameters of its function and what counts in its sums.
fn free_names(arena: &Arena, statement: &Statement) -> FxHashSet<String> {
    let (mut names, mut bound) = (FxHashSet::default(), Vec::new());
    match statement {
        Statement::Definition(Definition { parameters: Some(formals), .. }) => {
            bound.extend(formals.iter().map(name_of));
        }
        Statement::Update(Update { index: Some(index), .. }) => bound.push(name_of(index)),
        _ => {}
    }
    for id in statement.expressions().into_iter().flat_map(|root| parts(arena, root)) {
        match &arena[id].kind {
            ExprKind::Name(name) => drop(names.insert(name.clone())),
            ExprKind::Call { function, arguments } => {
                names.insert(name_of(function));
                if let (SUM, Some(ExprKind::Name(index))) =
                    (function.name.as_str(), arguments.first().map(|first| &arena[*first].kind))
                {
                    bound.push(index.clone());
                }
            }
            _ => {}
        }
    }
    names.retain(|name| !bound.contains(name));
    names
}

fn name_of(name: &Ident) -> String {
    name.name.clone()
}

struct Reader<'f, 'e> {
    files: Files<'f>,
    imports: Imports,
    /// The length of all texts so far, with a gap behind each.
    length: usize,
    errors: &'e mut Vec<Diagnostic>,
}

impl Reader<'_, '_> {
    /// Reads a file named in one of the folder `folder`; gives its number among all.
    fn import(
        &mut self,
        name: &str,
        folder: &str,
        span: Span,
        at: Span,
        open: &mut Vec<String>,
    ) -> Option<usize> {
        let path = beside(folder, name);
        if let Some(first) = open.iter().position(|other| *other == path) {
            let circle: Vec<&str> = open[first..].iter().map(String::as_str).collect();
            let circle = format!("{} -> {path}", circle.join(" -> "));
            let message = format!("files import each other in a circle: {circle}");
            self.report(message, span, at, "put what both need into a file of its own");
            return None;
        }
        if let Some(known) = self.imports.of(&path) {
            return Some(known);
        }
        if self.imports.files.len() + open.len() >= MAX_FILES {
            let message = format!("a potential imports at most {MAX_FILES} files");
            self.report(message, span, at, "put what belongs together into one file");
            return None;
        }
        let text = match (self.files)(&path) {
            Ok(text) => text,
            Err(reason) => {
                let help = "a file that is imported lies at or below the folder of the one that imports it";
                self.report(format!("cannot read {path}: {reason}"), span, at, help);
                return None;
            }
        };
        let base = self.length + 1;
        self.length = base + text.len();
        let Reading { ast, findings, .. } = read(&text);
        for finding in findings.iter().take(MAX_TOLD) {
            let place = place(&path, &text, finding.span.start as usize);
            let help = finding.helps.join("; ");
            self.report(format!("{place}: {}", finding.message), span, at, &help);
        }
        if !findings.is_empty() {
            return None;
        }
        open.push(path.clone());
        let mut brings = Vec::new();
        for statement in &ast.statements {
            if let Statement::Import(file, own) = statement {
                let own = own.shifted(base);
                brings.push(self.import(&file.text, folder_of(&path), own, at, open));
            }
        }
        open.pop();
        let import = Import { path, text, ast, base, at, brings, used: FxHashSet::default() };
        self.imports.files.push(import);
        Some(self.imports.files.len() - 1)
    }

    /// Reports what is wrong with an import, at `span` of the potential or else at the statement that led there.
    fn report(&mut self, message: String, span: Span, at: Span, help: &str) {
        let is_own = at.start <= span.start && span.end <= at.end;
        let error = Diagnostic::error(CODE, if is_own { span } else { at }, message);
        if self.errors.len() < MAX_FINDINGS {
            self.errors.push(if help.is_empty() { error } else { error.help(help) });
        }
    }
}

/// The path of a file that one in a folder names.
fn beside(folder: &str, name: &str) -> String {
    if folder.is_empty() { name.to_string() } else { format!("{folder}/{name}") }
}

/// The folder of a file.
fn folder_of(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// `strains.piola:3:5`
fn place(path: &str, text: &str, offset: usize) -> String {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.rsplit('\n').next().unwrap_or("");
    format!("{path}:{}:{}", before.matches('\n').count() + 1, line.chars().count() + 1)
}

impl Import {
    /// Where something stands in it.
    fn place(&self, span: Span) -> String {
        place(&self.path, &self.text, span.start as usize - self.base)
    }

    /// Takes the statements that define these names, and adds the names that they use.
    fn use_names(&mut self, names: &mut FxHashSet<String>) {
        for (number, statement) in self.ast.statements.iter().enumerate() {
            let is_used = match statement {
                Statement::Parameter(parameter) => is_one_of(parameter, names),
                Statement::Definition(definition) => names.contains(&definition.name.name),
                Statement::Update(update) => names.contains(&update.state.name),
                _ => false,
            };
            if is_used && self.used.insert(number) {
                names.extend(free_names(&self.ast.arena, statement));
                // An update comes with its state, by whichever name of an entry that is used.
                if let Statement::Parameter(parameter) = statement {
                    names.insert(parameter.name.name.clone());
                }
            }
        }
    }
}

/// Whether a parameter, or an entry of a vector of them, has one of these names.
fn is_one_of(parameter: &Parameter, names: &FxHashSet<String>) -> bool {
    let name = &parameter.name.name;
    let n_entries = parameter.size.map_or(0, |(size, _)| size);
    names.contains(name) || (1..=n_entries).any(|k| names.contains(&entry(name, k)))
}

/// A tree that grows by what is imported.
struct Merged<'i> {
    imports: &'i Imports,
    at_import: bool,
    arena: Arena,
    statements: Vec<Statement>,
    done: FxHashSet<usize>,
}

impl Merged<'_> {
    /// Adds what is used of a file and of the files that it imports, each file once.
    fn file(&mut self, number: usize) {
        if !self.done.insert(number) {
            return;
        }
        let import = &self.imports.files[number];
        let mut brings = import.brings.iter();
        for (number, statement) in import.ast.statements.iter().enumerate() {
            if let Statement::Import(..) = statement {
                if let Some(Some(other)) = brings.next() {
                    self.file(*other);
                }
            } else if import.used.contains(&number) {
                let statement = self.statement(import, statement.clone());
                self.statements.push(statement);
            }
        }
    }

    fn place(&self, import: &Import, span: Span) -> Span {
        if self.at_import { import.at } else { span.shifted(import.base) }
    }

    fn statement(&mut self, import: &Import, mut statement: Statement) -> Statement {
        for root in statement.expressions_mut() {
            *root = self.expression(import, *root);
        }
        let mut spans: Vec<&mut Span> = Vec::new();
        let unit = match &mut statement {
            Statement::Parameter(Parameter { name, size, unit, description, .. }) => {
                spans.push(&mut name.span);
                spans.extend(size.as_mut().map(|(_, span)| span));
                spans.extend(description.as_mut().map(|text| &mut text.span));
                unit.as_mut()
            }
            Statement::Definition(Definition { name, parameters, unit, .. }) => {
                spans.push(&mut name.span);
                spans.extend(parameters.iter_mut().flatten().map(|formal| &mut formal.span));
                unit.as_mut()
            }
            Statement::Update(Update { state, index, span, .. }) => {
                spans.extend([&mut state.span, span]);
                spans.extend(index.as_mut().map(|index| &mut index.span));
                None
            }
            _ => None,
        };
        if let Some(Unit { factors, span }) = unit {
            spans.push(span);
            spans.extend(factors.iter_mut().map(|factor| &mut factor.name.span));
        }
        for span in spans {
            *span = self.place(import, *span);
        }
        statement
    }

    /// Adds an expression with all its parts.
    fn expression(&mut self, import: &Import, root: ExprId) -> ExprId {
        let mut moved = FxHashMap::default();
        for id in parts(&import.ast.arena, root) {
            let expression = &import.ast.arena[id];
            let mut kind = expression.kind.clone();
            kind.operands_mut().into_iter().for_each(|operand| *operand = moved[operand]);
            match &mut kind {
                ExprKind::Call { function, .. } => {
                    function.span = self.place(import, function.span)
                }
                ExprKind::Table { file: Text { text, span }, .. } => {
                    *text = beside(folder_of(&import.path), text);
                    *span = self.place(import, *span);
                }
                _ => {}
            }
            let span = self.place(import, expression.span);
            moved.insert(id, self.arena.push(kind, span));
        }
        moved[&root]
    }
}
