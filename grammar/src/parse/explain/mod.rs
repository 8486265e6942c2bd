//! What is wrong with a line the grammar refuses, in the user's words.
//!
//! Before: one logical line, the place where the grammar gave up and the rules it would have
//! accepted there. After: one finding. The explanations are asked in order and the first that knows
//! the mistake answers; the last one only lists what was expected.

mod expression;
mod spelling;
mod statement;
mod token;

use pest::error::{Error, ErrorVariant, InputLocation};

use super::parser::Rule;
use crate::names::KEYWORDS;
use crate::{Diagnostic, Span};
use token::{Kind, Token};

/// What a text was read as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Goal {
    Statement,
    Expression,
    Unit,
}

/// A line the grammar refuses.
pub(super) struct Failure<'t> {
    /// The line without its comment.
    text: &'t str,
    goal: Goal,
    /// Where the grammar gave up: the start of a token, or the end of the text.
    at: usize,
    /// What it would have accepted there.
    expected: Vec<Rule>,
    tokens: Vec<Token<'t>>,
    /// Which token stands at `at`; the number of tokens at the end of the text.
    index: usize,
}

/// Names the mistake.
pub(super) fn explain(failure: &Failure<'_>) -> Diagnostic {
    let explanations: [fn(&Failure<'_>) -> Option<Diagnostic>; 6] = [
        statement::explain,
        spelling::explain,
        expression::explain_conditional,
        expression::explain_missing_operator,
        expression::explain_missing_operand,
        expression::explain_brackets,
    ];
    let known = explanations.iter().find_map(|explanation| explanation(failure));
    known.unwrap_or_else(|| failure.unexpected())
}

impl<'t> Failure<'t> {
    pub(super) fn new(text: &'t str, goal: Goal, error: &Error<Rule>) -> Self {
        let place = match error.location {
            InputLocation::Pos(at) | InputLocation::Span((at, _)) => at,
        };
        let expected = match &error.variant {
            ErrorVariant::ParsingError { positives, .. } => positives.clone(),
            ErrorVariant::CustomError { .. } => Vec::new(),
        };
        let tokens = token::tokens(text);
        let end = tokens.last().map_or(0, Token::end);
        let index = tokens.partition_point(|token| token.end() <= place);
        let at = tokens.get(index).map_or(end, |token| token.start.max(place));
        Failure { text: &text[..end], goal, at, expected, tokens, index }
    }

    /// The token at which the grammar gave up.
    fn found(&self) -> Option<Token<'t>> {
        self.tokens.get(self.index).copied()
    }

    /// The text of that token, empty at the end.
    fn found_text(&self) -> &'t str {
        self.found().map_or("", |token| token.text)
    }

    fn found_kind(&self) -> Option<Kind> {
        self.found().map(|token| token.kind)
    }

    /// The token before it.
    fn before(&self) -> Option<Token<'t>> {
        self.tokens.get(self.index.checked_sub(1)?).copied()
    }

    /// The token after it.
    fn after(&self) -> Option<Token<'t>> {
        self.tokens.get(self.index + 1).copied()
    }

    fn rest(&self) -> &'t str {
        &self.text[self.at..]
    }

    fn expects(&self, rule: Rule) -> bool {
        self.expected.contains(&rule)
    }

    /// Whether a value could have stood here.
    fn expects_operand(&self) -> bool {
        use Rule as R;
        let operands = [R::expression, R::prefix, R::number, R::group, R::call, R::conditional];
        operands.iter().any(|&rule| self.expects(rule))
    }

    fn place(&self) -> Span {
        self.found().map_or(Span::new(self.at, self.at), |token| token.span())
    }

    /// A syntax error at the place of the failure.
    fn error(&self, message: impl Into<String>) -> Diagnostic {
        Diagnostic::error("syntax", self.place(), message)
    }

    /// What stands at the place of the failure, for a message.
    fn described(&self) -> String {
        match self.found() {
            None if self.goal == Goal::Statement => "the end of the line".into(),
            None => "the end".into(),
            Some(token) => describe(token),
        }
    }

    /// The last resort.
    fn unexpected(&self) -> Diagnostic {
        let mut wanted: Vec<&str> = Vec::new();
        for &rule in &self.expected {
            // A name could also have been a call: true, but no help.
            if self.expects(Rule::infix)
                && matches!(rule, Rule::open | Rule::caret | Rule::transpose)
            {
                continue;
            }
            let words = match rule {
                Rule::EOI if self.goal != Goal::Statement => "the end",
                _ => in_words(rule),
            };
            if !wanted.contains(&words) {
                wanted.push(words);
            }
        }
        let found = self.described();
        match wanted.as_slice() {
            [] => self.error(format!("unexpected {found}")),
            [one] => self
                .error(format!("expected {one}, found {found}"))
                .label(format!("expected {one}")),
            [all @ .., last] => {
                let list = format!("{} or {last}", all.join(", "));
                self.error(format!("unexpected {found}")).label(format!("expected {list}"))
            }
        }
    }

    /// A finding about a keyword that stands where a name or a value should.
    fn reserved(&self) -> Option<Diagnostic> {
        let word = self.found_text();
        KEYWORDS.contains(&word).then(|| {
            let message = format!("`{word}` is a word of the language and no name");
            Diagnostic::error("reserved-word", self.place(), message)
                .label("expected a name or a value")
                .help(format!("choose another name, e.g. `{word}_0`"))
        })
    }
}

fn describe(token: Token<'_>) -> String {
    match token.kind {
        Kind::String => "text in quotes".into(),
        Kind::Mark => spelling::quoted(token.text),
        _ if token.text.len() > 40 => "this".into(),
        _ => format!("`{}`", token.text),
    }
}

/// What a rule is called in messages.
fn in_words(rule: Rule) -> &'static str {
    use Rule as R;
    match rule {
        R::EOI => "the end of the line",
        R::infix | R::transpose => "an operator",
        R::equals => "`=`",
        R::comma => "a comma",
        R::open => "`(`",
        R::close => "`)`",
        R::open_bound => "`(` or `[`",
        R::close_bound => "`)` or `]`",
        R::in_word => "`in`",
        R::then_word => "`then`",
        R::else_word => "`else`",
        R::string => "a text in quotes",
        R::name | R::psi_word => "a name",
        R::formals | R::size | R::index | R::entries => "`(`",
        R::whole => "a whole number",
        R::dimension => "2 or 3",
        R::unit | R::unit_factor | R::unit_one => "a unit",
        R::unit_operator => "`*` or `/`",
        R::caret => "`^`",
        R::exponent => "an exponent",
        R::expression | R::prefix | R::number | R::group | R::call | R::conditional => "a value",
        _ => "a statement",
    }
}
