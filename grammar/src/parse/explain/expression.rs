//! Mistakes inside an expression.

use super::super::parser::Rule;
use super::token::{Kind, Token};
use super::{Failure, Goal};
use crate::Diagnostic;
use crate::names::{BINARY_FUNCTIONS, KEYWORDS, UNARY_FUNCTIONS};

/// `if`, `then` and `else` that do not come together.
pub(super) fn explain_conditional(failure: &Failure<'_>) -> Option<Diagnostic> {
    let found = failure.found_text();
    for (rule, word) in [(Rule::then_word, "then"), (Rule::else_word, "else")] {
        if failure.expects(rule) {
            let finding = failure
                .error(format!("this `if` has no `{word}`"))
                .label(format!("expected an operator or `{word}`"))
                .help("write `if c then x else y`; the `else` is never left out");
            return Some(match last_if(failure) {
                Some(token) => finding.note(token.span(), "this `if`"),
                None => finding,
            });
        }
    }
    if matches!(found, "then" | "else") && failure.expects(Rule::infix) {
        return Some(
            failure
                .error(format!("this `{found}` belongs to no `if`"))
                .help("write `if c then x else y`"),
        );
    }
    None
}

/// The `if` that is still incomplete at the place of the failure.
fn last_if<'t>(failure: &Failure<'t>) -> Option<Token<'t>> {
    let mut open: Vec<Token<'t>> = Vec::new();
    for token in &failure.tokens[..failure.index] {
        match token.text {
            "if" => open.push(*token),
            "else" => drop(open.pop()),
            _ => {}
        }
    }
    open.pop()
}

/// Two values with nothing between them.
pub(super) fn explain_missing_operator(failure: &Failure<'_>) -> Option<Diagnostic> {
    let (before, found) = (failure.before()?, failure.found()?);
    let is_value = match found.kind {
        Kind::Word => !KEYWORDS.contains(&found.text),
        Kind::Number => true,
        Kind::Mark => found.text == "(",
        Kind::String => false,
    };
    if !failure.expects(Rule::infix) || !is_value {
        return None;
    }
    if found.kind == Kind::Number && found.start < failure.at {
        return Some(failure.error("this number has two decimal points"));
    }
    if is_function(before.text) && found.text != "(" {
        let whole = failure.after().is_none_or(|next| next.text == ")");
        let (function, argument) = (before.text, if whole { found.text } else { "..." });
        let message = format!("the argument of `{function}` stands in parentheses");
        return Some(failure.error(message).help(format!("write `{function}({argument})`")));
    }
    let finding =
        failure.error("there is no operator between these two").label("expected an operator");
    Some(match (before.text, found.text) {
        (left, "(") if before.kind == Kind::Number => {
            finding.help(format!("a product is written with `*`: `{left}*(...)`"))
        }
        (")", "(") => finding.help("a product is written with `*`: `(...)*(...)`"),
        (")", right) => finding.help(format!("a product is written with `*`: `(...)*{right}`")),
        (left, right) => finding.help(format!("a product is written with `*`: `{left}*{right}`")),
    })
}

fn is_function(name: &str) -> bool {
    UNARY_FUNCTIONS.contains(&name) || BINARY_FUNCTIONS.contains(&name)
}

/// No value where one is needed.
pub(super) fn explain_missing_operand(failure: &Failure<'_>) -> Option<Diagnostic> {
    if !failure.expects_operand() || failure.goal == Goal::Unit {
        return None;
    }
    let found = failure.found_text();
    if failure.found_kind() == Some(Kind::Word) {
        return failure.reserved();
    }
    if found == "+" {
        let finding = failure.error("there is no sign `+`").label("adds to nothing");
        return Some(finding.help("leave it out"));
    }
    let described = failure.described();
    let finding = match failure.before().map(|token| token.text) {
        None => failure.error(format!("expected a value, found {described}")),
        Some("(") if found == ")" => failure
            .error("there is nothing in these parentheses")
            .help("a name without arguments is written without parentheses"),
        Some(before) => {
            failure.error(format!("expected a value after `{before}`, found {described}"))
        }
    };
    let finding = finding.label("expected a value");
    Some(match (found, failure.found_kind()) {
        ("[", _) => finding.help("write parentheses `( )`"),
        (_, Some(Kind::String)) => finding.help("texts are no values"),
        (_, None) if failure.goal == Goal::Statement => {
            finding.help("a statement ends with its line, unless a parenthesis is open")
        }
        _ => finding,
    })
}

/// Parentheses and commas in the wrong place.
pub(super) fn explain_brackets(failure: &Failure<'_>) -> Option<Diagnostic> {
    if !failure.expects(Rule::infix) {
        return None;
    }
    match failure.found_text() {
        mark @ (")" | "]") if failure.expects(Rule::close) => Some(
            failure
                .error(format!("`(` is not closed by `{mark}`"))
                .label("expected `)`")
                .help("only the ends of a `domain` have square brackets"),
        ),
        mark @ (")" | "]") if !failure.expects(Rule::close_bound) => {
            Some(failure.error(format!("this `{mark}` closes nothing")).help("remove it"))
        }
        "[" => Some(failure.error("there are no indices").help("write parentheses `( )`")),
        "," if !failure.expects(Rule::comma) => Some(comma(failure)),
        _ => None,
    }
}

fn comma(failure: &Failure<'_>) -> Diagnostic {
    let finding = failure.error("a comma has no meaning here");
    match (failure.before(), failure.after()) {
        (Some(left), Some(right)) if left.kind == Kind::Number && right.kind == Kind::Number => {
            finding.help(format!("numbers have a decimal point: `{}.{}`", left.text, right.text))
        }
        _ => finding.help("commas stand between arguments: `min(x, y)`"),
    }
}
