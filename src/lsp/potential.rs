//! Names of a potential: what they are, where they come from, which could stand at a place.

use lsp_types::{
    CompletionItem, CompletionItemKind, DocumentSymbol, Hover, HoverContents, Location,
    MarkupContent, MarkupKind, SymbolKind,
};
use piola_compiler::{LINTS, Measure, Model, check_text_with, print, reserved_names};
use piola_grammar::ast::{Ast, Statement};
use piola_grammar::{Reading, Span, Token, TokenKind, names as words, read, spell_out, tokens};
use piola_runtime::scene::files_below;

use super::text::{Document, uri_of};
use crate::codes;
use crate::pages::{LANGUAGE, meaning};

/// Lines of derivatives that a hover shows at most.
const MOST_LINES: usize = 60;

/// A name of the file.
struct Declared {
    name: String,
    /// Of the name where it is declared.
    span: Span,
    kind: SymbolKind,
    /// Of a function.
    formals: Vec<String>,
}

fn declared(ast: &Ast) -> Vec<Declared> {
    let of = |statement: &Statement| {
        let (name, kind, formals) = match statement {
            Statement::Parameter(one) if one.is_state => (&one.name, SymbolKind::VARIABLE, &None),
            Statement::Parameter(one) => (&one.name, SymbolKind::FIELD, &None),
            Statement::Definition(one) if one.parameters.is_some() => {
                (&one.name, SymbolKind::FUNCTION, &one.parameters)
            }
            Statement::Definition(one) => (&one.name, SymbolKind::CONSTANT, &None),
            _ => return None,
        };
        let formals = formals.iter().flatten().map(|formal| formal.name.clone()).collect();
        Some(Declared { name: name.name.clone(), span: name.span, kind, formals })
    };
    ast.statements.iter().filter_map(of).collect()
}

/// The token at a place, or that ends there.
fn token_at(all: &[Token], at: usize) -> Option<Token> {
    let at = at as u32;
    let inside = |token: &&Token| token.span.start <= at && at <= token.span.end;
    let mut found = all.iter().filter(inside).filter(|token| token.kind != TokenKind::Newline);
    let first = found.next()?;
    // Of two that meet the name, or the later.
    Some(*found.next().filter(|_| first.kind != TokenKind::Name).unwrap_or(first))
}

/// The places of the statements of a text, in its order.
struct Statements(Vec<Span>);

impl Statements {
    fn of(text: &str, all: &[Token]) -> Statements {
        let lines = piola_grammar::statements(text, all);
        let span = |line: &[Token]| Some(Span { end: line.last()?.span.end, ..line.first()?.span });
        Statements(lines.into_iter().filter_map(span).collect())
    }

    /// The one that holds a place, or begins behind it.
    fn at(&self, at: usize) -> Span {
        let number = self.0.partition_point(|span| span.end < at as u32);
        self.0.get(number).copied().unwrap_or(Span::new(at, at))
    }
}

/// What a name is; of an energy its derivatives, too, and what it costs and keeps, if that is `measured`.
pub(super) fn hover(
    document: &Document,
    at: usize,
    measured: &dyn Fn() -> Option<String>,
) -> Option<Hover> {
    let text = &document.text;
    let all = tokens(text);
    let token = token_at(&all, at)?;
    let name = spell_out(token.text(text));
    let statements = Statements::of(text, &all);
    let line = statements.at(token.span.start as usize);
    let Reading { ast, .. } = read(text);
    let declared = declared(&ast);
    let of_line =
        declared.iter().find(|one| line.start <= one.span.start && one.span.end <= line.end);
    let value = match token.kind {
        TokenKind::Name | TokenKind::Keyword => {
            if let Some(function) = of_line.filter(|one| one.formals.contains(&name)) {
                format!("an argument of `{}`", function.name)
            } else if name == "psi" && token.span.start == line.start {
                let measured = || match measured() {
                    Some(measured) => measured,
                    None => "time and digits are being measured: look again".to_string(),
                };
                let derivatives = derivatives(document);
                let both = derivatives.map(|text| format!("{text}\n\n{}", measured()));
                both.or_else(|| builtin(&name))?
            } else if let Some(one) = declared.iter().find(|one| one.name == name) {
                let of = statements.at(one.span.start as usize);
                format!("```piola\n{}\n```", &text[of.range()])
            } else {
                builtin(&name)?
            }
        }
        _ => return None,
    };
    let contents = HoverContents::Markup(MarkupContent { kind: MarkupKind::Markdown, value });
    Some(Hover { contents, range: Some(document.range(token.span)) })
}

/// What the language says of a word of its own.
fn builtin(name: &str) -> Option<String> {
    let reserved = reserved_names().iter().find(|(reserved, _)| *reserved == name);
    let reserved = reserved.map(|(name, meaning)| format!("`{name}`: {meaning}"));
    reserved.or_else(|| meaning(LANGUAGE, name).map(|(names, text)| format!("{names}: {text}")))
}

/// psi, psi' and psi'' of every energy, as `piola derive` has them.
fn derivatives(document: &Document) -> Option<String> {
    let (_, model) = check_text_with(&document.text, &files_below(document.folder())).ok()?;
    let dimension = model.dimensions().last()?;
    let energies = model.symbolic(dimension).ok()?.energies;
    let mut parts: Vec<String> =
        energies.iter().map(|energy| print::text(&model, energy)).collect();
    if let Ok(Some(forms)) = model.symbolic_gradient(dimension) {
        parts.push(print::gradient_text(&model, &forms));
    }
    let all = parts.join("\n");
    let mut lines: Vec<&str> = all.lines().take(MOST_LINES).collect();
    if lines.is_empty() {
        return None;
    }
    if all.lines().count() > lines.len() {
        lines.push("..");
    }
    Some(format!(
        "in {dimension} dimensions\n```\n{}\n```\n{}",
        lines.join("\n"),
        units(&model, dimension)
    ))
}

fn units(model: &Model, dimension: usize) -> String {
    let unit = |measure: Measure| {
        format!("psi({}) in {}", measure.symbol(), Model::energy_unit(measure, dimension))
    };
    let all: Vec<String> = model.measures().into_iter().map(unit).collect();
    if model.has_units() { all.join(", ") } else { "no units are stated".to_string() }
}

pub(super) fn completion(document: &Document, at: usize) -> Vec<CompletionItem> {
    let before = document.line_before(at);
    let inside_text = before.matches('"').count() % 2 == 1;
    let written = before.trim_end_matches(|c: char| c.is_alphanumeric() || c == '_');
    let last = tokens(written).last().map(|token| token.text(written).to_string());
    if inside_text {
        let is_code = before.trim_start().starts_with("allow") && before.matches('"').count() == 1;
        let lints = LINTS.iter().filter(|_| is_code);
        return lints
            .map(|lint| item(lint.code, CompletionItemKind::ENUM_MEMBER, codes::summary(lint.code)))
            .collect();
    }
    if last.as_deref() == Some("in") && !written.trim_start().starts_with("domain") {
        let units = piola_compiler::unit_names();
        return units.map(|unit| item(unit, CompletionItemKind::UNIT, "")).collect();
    }
    if written.trim().is_empty() {
        let statements = words::STATEMENT_KEYWORDS.iter().chain(&["psi", "dissipation"]);
        let said = |word: &&str| meaning(LANGUAGE, word).map_or(String::new(), |(_, text)| text);
        return statements
            .map(|word| item(word, CompletionItemKind::KEYWORD, &said(word)))
            .collect();
    }
    let all = tokens(&document.text);
    let inside = |token: &&Token| (token.span.start..=token.span.end).contains(&(at as u32));
    if all.iter().filter(inside).any(|token| token.kind == TokenKind::Comment) {
        return Vec::new();
    }
    let statements = Statements::of(&document.text, &all);
    let mut items = Vec::new();
    for one in declared(&read(&document.text).ast) {
        let kind = match one.kind {
            SymbolKind::FUNCTION => CompletionItemKind::FUNCTION,
            SymbolKind::CONSTANT => CompletionItemKind::CONSTANT,
            SymbolKind::VARIABLE => CompletionItemKind::VARIABLE,
            _ => CompletionItemKind::FIELD,
        };
        let of = statements.at(one.span.start as usize);
        items.push(item(&one.name, kind, &document.text[of.range()]));
    }
    let functions = words::UNARY_FUNCTIONS.iter().chain(&words::BINARY_FUNCTIONS);
    for name in functions {
        let said = meaning(LANGUAGE, name).map_or(String::new(), |(_, text)| text);
        items.push(item(name, CompletionItemKind::FUNCTION, &said));
    }
    items.extend(
        reserved_names()
            .iter()
            .map(|(name, meaning)| item(name, CompletionItemKind::CONSTANT, meaning)),
    );
    let inner = words::KEYWORDS.iter().filter(|word| !words::STATEMENT_KEYWORDS.contains(word));
    items.extend(inner.map(|word| item(word, CompletionItemKind::KEYWORD, "")));
    items
}

fn item(label: &str, kind: CompletionItemKind, detail: &str) -> CompletionItem {
    let detail = (!detail.is_empty()).then(|| detail.to_string());
    CompletionItem {
        label: label.to_string(),
        kind: Some(kind),
        detail,
        ..CompletionItem::default()
    }
}

pub(super) fn definition(document: &Document, at: usize) -> Option<Location> {
    let text = &document.text;
    let token = token_at(&tokens(text), at)?;
    if token.kind == TokenKind::Text {
        // A file that is imported, or read as a table.
        let path = document.folder().join(token.text(text).trim_matches('"'));
        return path.is_file().then(|| Some(Location::new(uri_of(&path)?, Default::default())))?;
    }
    let all = places(document, at)?;
    let declared = declared(&read(text).ast);
    let here = declared.iter().map(|one| one.span).find(|span| all.contains(span));
    // A formal argument is declared where it stands first.
    Some(Location::new(document.uri.clone(), document.range(here.or(all.first().copied())?)))
}

/// Every place of the name at a place, if it is one that the file declares.
pub(super) fn places(document: &Document, at: usize) -> Option<Vec<Span>> {
    let text = &document.text;
    let all = tokens(text);
    let token = token_at(&all, at).filter(|token| token.kind == TokenKind::Name)?;
    let name = spell_out(token.text(text));
    let declared = declared(&read(text).ast);
    let statements = Statements::of(text, &all);
    let lines = |one: &Declared| statements.at(one.span.start as usize);
    let hiding: Vec<Span> =
        declared.iter().filter(|one| one.formals.contains(&name)).map(lines).collect();
    let inside = |line: &&Span, span: Span| line.start <= span.start && span.end <= line.end;
    let own = hiding.iter().find(|line| inside(line, token.span)).copied();
    if own.is_none() && !declared.iter().any(|one| one.name == name) {
        return None;
    }
    let is_it = |other: &&Token| {
        let hidden = hiding.iter().find(|line| inside(line, other.span)).copied();
        other.kind == TokenKind::Name && hidden == own && spell_out(other.text(text)) == name
    };
    Some(all.iter().filter(is_it).map(|token| token.span).collect())
}

/// Whether a name may be given to what is called another.
pub(super) fn check_name(document: &Document, old: &str, name: &str) -> Result<(), String> {
    let is_name = matches!(tokens(name)[..], [token] if token.kind == TokenKind::Name && token.text(name) == name);
    if !is_name {
        return Err(format!(
            "`{name}` is no name: letters, digits and `_`, and no word of the language"
        ));
    }
    let spelled = spell_out(name);
    // `mu` for `μ` is the same name, spelled otherwise.
    let is_new = spell_out(old) != spelled;
    let taken = |one: &Declared| is_new && (one.name == spelled || one.formals.contains(&spelled));
    match declared(&read(&document.text).ast).iter().any(taken) {
        true => Err(format!("`{name}` is there already")),
        false => Ok(()),
    }
}

/// The outline: names and energies.
#[allow(deprecated)] // A field that the type still has.
pub(super) fn symbols(document: &Document) -> Vec<DocumentSymbol> {
    let text = &document.text;
    let statements = Statements::of(text, &tokens(text));
    let Reading { ast, .. } = read(text);
    let symbol = |name: String, kind, span: Span| {
        let line = statements.at(span.start as usize);
        DocumentSymbol {
            name,
            detail: None,
            kind,
            tags: None,
            deprecated: None,
            range: document.range(line),
            selection_range: document.range(span),
            children: None,
        }
    };
    let mut symbols: Vec<DocumentSymbol> =
        declared(&ast).into_iter().map(|one| symbol(one.name, one.kind, one.span)).collect();
    for statement in &ast.statements {
        if let Statement::Energy(energy) | Statement::Dissipation(energy) = statement {
            let head = text[energy.head.range()].to_string();
            symbols.push(symbol(head, SymbolKind::OPERATOR, energy.head));
        }
    }
    symbols.sort_by_key(|symbol| symbol.selection_range.start);
    symbols
}
