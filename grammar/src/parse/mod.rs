//! From a text to a syntax tree.
//!
//! | step | file |
//! |---|---|
//! | cut into logical lines, bound nesting and size | `scan.rs` |
//! | recognise each line | `piola.pest`, the one grammar |
//! | build the tree: statements, then expressions by precedence | `statement.rs`, `expression.rs` |
//! | say what is wrong with a line the grammar refuses | `explain/` |
//!
//! A statement ends with its line, so a bad line costs one finding and hides nothing else.

mod explain;
mod expression;
mod scan;
pub(crate) use scan::number_length;
mod statement;

use pest::Parser as _;
use pest::iterators::Pair;

use crate::ast::{Arena, Ident, Unit};
use crate::names;
use crate::{Ast, Diagnostic, ExpressionAst, Span};
use explain::{Failure, Goal};
use parser::{PiolaParser, Rule};
use scan::{Layout, scan};

pub use scan::{MAX_BYTES, MAX_NESTING};

/// After so many findings a text is not one of ours; the rest of it is not reported.
const MAX_FINDINGS: usize = 100;

/// The codes of all findings of this crate.
pub const CODES: [&str; 8] = [
    "chained-comparison",
    "file-too-large",
    "missing-potential",
    "nesting-too-deep",
    "number-out-of-range",
    "reserved-word",
    "syntax",
    "unclosed-parenthesis",
];

/// What pest makes of `piola.pest`.
mod parser {
    // The derived enum has one variant for each rule; the grammar file is their documentation.
    #![allow(missing_docs)]

    #[derive(pest_derive::Parser)]
    #[grammar = "piola.pest"]
    pub(super) struct PiolaParser;
}

/// What could be read of a file.
#[derive(Clone, Debug)]
pub struct Reading {
    /// The statements that could be read; without a `potential` line the name is empty.
    pub ast: Ast,
    /// Every mistake, in the order of the text. If there is none, the tree is that of the file.
    pub findings: Vec<Diagnostic>,
    /// The lines that could not be read.
    pub unread: Vec<Span>,
}

/// Reads a potential file.
///
/// The error holds every mistake in the text, in the order of the text.
pub fn parse(text: &str) -> Result<Ast, Vec<Diagnostic>> {
    let reading = read(text);
    if reading.findings.is_empty() { Ok(reading.ast) } else { Err(reading.findings) }
}

/// Reads as much of a potential file as can be read, so that its other lines can be checked too.
pub fn read(text: &str) -> Reading {
    let scan = match scan(text, Layout::Statements) {
        Ok(scan) => scan,
        Err(findings) => {
            return Reading {
                findings,
                unread: vec![Span::new(0, text.len())],
                ..File::default().finish(Builder::default())
            };
        }
    };
    let mut builder = Builder { findings: scan.findings, ..Builder::default() };
    let mut file = File::default();
    for line in &scan.lines {
        if builder.findings.len() >= MAX_FINDINGS {
            break;
        }
        let bare = &scan.text[line.start..line.end];
        let parsed = if line.sound { builder.line(bare, line.start) } else { None };
        file.add(parsed, Span::new(line.start, line.end), bare, &mut builder.findings);
    }
    file.finish(builder)
}

/// Reads an expression, e.g. of a string in a scene file; newlines in it are blanks.
pub fn parse_expression(text: &str) -> Result<ExpressionAst, Vec<Diagnostic>> {
    let (root, builder) = lone(text, Rule::lone_expression, |builder, pair| {
        builder.expression(pair).map(|operand| operand.id)
    })?;
    Ok(ExpressionAst { root, arena: builder.arena })
}

/// Reads a unit, e.g. the `J/m^4` of a scene's `"2 J/m^4"`; exponents are in the arena.
pub fn parse_unit(text: &str) -> Result<(Unit, Arena), Vec<Diagnostic>> {
    let (unit, builder) = lone(text, Rule::lone_unit, Builder::unit)?;
    Ok((unit, builder.arena))
}

/// Reads a text that is one thing and no file.
fn lone<T>(
    text: &str,
    rule: Rule,
    build: impl FnOnce(&mut Builder, Pair<'_, Rule>) -> Option<T>,
) -> Result<(T, Builder), Vec<Diagnostic>> {
    let scan = scan(text, Layout::Lone)?;
    let mut builder = Builder { findings: scan.findings, ..Builder::default() };
    if builder.findings.is_empty() {
        let goal = if rule == Rule::lone_unit { Goal::Unit } else { Goal::Expression };
        if let Some(pair) = builder.recognise(rule, goal, &scan.text)
            && let Some(built) = build(&mut builder, pair)
            && builder.findings.is_empty()
        {
            return Ok((built, builder));
        }
    }
    builder.findings.truncate(MAX_FINDINGS);
    Err(builder.findings)
}

/// What the lines read so far add up to.
#[derive(Default)]
struct File {
    potential: Option<(Ident, Option<crate::ast::Text>)>,
    /// Where the first `potential` stands.
    declared: Option<Span>,
    /// Whether a bad line may have been meant as the `potential` line.
    doubtful: bool,
    first: Option<Span>,
    statements: Vec<crate::ast::Statement>,
    unread: Vec<Span>,
}

impl File {
    fn add(
        &mut self,
        line: Option<statement::Line>,
        place: Span,
        text: &str,
        findings: &mut Vec<Diagnostic>,
    ) {
        let is_first = self.first.is_none();
        let lead = text.len() - text.trim_start().len();
        let place = Span { start: place.start + lead as u32, end: place.end };
        self.first.get_or_insert(place);
        match line {
            None => {
                self.doubtful |= is_first || text.trim_start().starts_with("potential");
                self.unread.push(place);
            }
            Some(statement::Line::Statement(statement)) => self.statements.push(statement),
            Some(statement::Line::Potential { name, title, span }) => {
                let span = Span { start: span.start, end: name.span.end };
                if let Some(declared) = self.declared {
                    findings.push(
                        Diagnostic::error("syntax", span, "a file holds one potential")
                            .label("second potential")
                            .note(declared, "first potential")
                            .help("put it into a file of its own"),
                    );
                } else if !is_first {
                    findings.push(
                        Diagnostic::error("syntax", span, "`potential` stands first in a file")
                            .label("comes after other statements")
                            .help("move this line to the top"),
                    );
                }
                self.declared.get_or_insert(span);
                self.potential.get_or_insert((name, title));
            }
        }
    }

    fn finish(self, builder: Builder) -> Reading {
        let mut findings = builder.findings;
        if self.potential.is_none() && !self.doubtful {
            let label =
                if self.first.is_some() { "the first statement is not `potential`" } else { "" };
            findings.push(
                Diagnostic::error(
                    "missing-potential",
                    self.first.unwrap_or_default(),
                    "this file names no potential",
                )
                .label(label)
                .help("begin the file with `potential my_name \"what it is\"`"),
            );
        }
        findings.sort_by_key(|finding| finding.span);
        findings.truncate(MAX_FINDINGS);
        let nameless = || (Ident { name: String::new(), span: Span::default() }, None);
        let (name, title) = self.potential.unwrap_or_else(nameless);
        let ast = Ast { name, title, statements: self.statements, arena: builder.arena };
        Reading { ast, findings, unread: self.unread }
    }
}

/// Builds one tree and collects what is wrong on the way.
#[derive(Default)]
struct Builder {
    arena: Arena,
    findings: Vec<Diagnostic>,
    /// Where the line that is being built starts in the text.
    offset: usize,
}

impl Builder {
    /// Recognises and builds the line at `offset`; `None` after a finding.
    fn line(&mut self, text: &str, offset: usize) -> Option<statement::Line> {
        self.offset = offset;
        let before = self.findings.len();
        let pair = self.recognise(Rule::line, Goal::Statement, text)?;
        let line = self.statement(pair);
        if self.findings.len() == before { line } else { None }
    }

    /// Runs the grammar; a failure becomes a finding in the user's words.
    fn recognise<'t>(&mut self, rule: Rule, goal: Goal, text: &'t str) -> Option<Pair<'t, Rule>> {
        match PiolaParser::parse(rule, text) {
            Ok(mut pairs) => pairs.next(),
            Err(error) => {
                let finding = explain::explain(&Failure::new(text, goal, &error));
                self.findings.push(finding.shifted(self.offset));
                None
            }
        }
    }

    /// Where a pair stands in the whole text.
    fn span(&self, pair: &Pair<'_, Rule>) -> Span {
        let span = pair.as_span();
        Span::new(span.start(), span.end()).shifted(self.offset)
    }

    fn ident(&self, pair: &Pair<'_, Rule>) -> Ident {
        Ident { name: names::spell_out(pair.as_str()), span: self.span(pair) }
    }
}
