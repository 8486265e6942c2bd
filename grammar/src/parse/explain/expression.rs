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
    let coordinate = matches!(found.text, "X" | "Y" | "Z" | "t" | "pi" | "(");
    if failure.goal == Goal::Expression && before.kind == Kind::Number && !coordinate {
        return Some(finding.help(format!(
            "numbers have no unit here: lengths are in m, forces in N; a product is written with \
             `*`: `{}*{}`",
            before.text, found.text
        )));
    }
    let is_named = failure.tokens.first().is_some_and(|first| first.text != "psi");
    let may_be_unit = before.kind == Kind::Number && found.text.len() > 1 && is_named;
    if failure.goal != Goal::Expression && may_be_unit && found.kind == Kind::Word {
        let (number, word) = (before.text, found.text);
        return Some(finding.help(format!(
            "a product is written with `*`: `{number}*{word}`; a unit stands behind `in`, at the end \
             of the line: `{number} in {word}`"
        )));
    }
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
        ("[", _) if failure.rest().contains(',') => return Some(no_vectors(failure)),
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
        "[" => Some(index(failure)),
        "," if !failure.expects(Rule::comma) => Some(comma(failure)),
        _ => None,
    }
}

/// `F[1,1]`, `mu[3]`, `X[0]`.
fn index(failure: &Failure<'_>) -> Diagnostic {
    let finding = failure.error("there are no indices");
    if failure.goal == Goal::Expression {
        return finding.help("the coordinates of a point are `X`, `Y` and `Z`");
    }
    let name = failure.before().map_or("", |before| before.text);
    let single = failure.after().filter(|number| {
        let closing = failure.tokens.get(failure.index + 2);
        number.kind == Kind::Number && closing.is_some_and(|mark| mark.text == "]")
    });
    match single {
        Some(number) if failure.before().is_some_and(|before| before.kind == Kind::Word) => {
            finding.help(format!("give each value a name of its own: `{name}{}`", number.text))
        }
        _ => finding.help(
            "components of tensors and vectors stand in round brackets and count from 1: `F(1, 2)`; \
             invariants are `tr(C)`, `det(C)`, `C : C`",
        ),
    }
}

/// `n = (1, 0, 0)`, `n = [1, 0, 0]`.
fn no_vectors(failure: &Failure<'_>) -> Diagnostic {
    let message = "there are no lists, and vectors have a name";
    let finding = failure.error(message).label("expected one number");
    if failure.goal == Goal::Expression {
        return finding.help("each component is an expression of its own: `u = [\"0.1*t\", 0]`");
    }
    finding
        .help("in a file with `psi(F)` the vector n = (x, y, z) is `vector(x, y, z)`, and n n is `dyad(n)`")
        .help("give each number of a list a name of its own: `mu1`, `mu2`")
}

fn comma(failure: &Failure<'_>) -> Diagnostic {
    let commas = failure.tokens.iter().filter(|token| token.text == ",").count();
    let in_group = failure.tokens[..failure.index].iter().any(|token| token.text == "(");
    if commas > 1 && in_group {
        return no_vectors(failure);
    }
    let finding = failure.error("a comma has no meaning here");
    match (failure.before(), failure.after()) {
        (Some(left), Some(right)) if left.kind == Kind::Number && right.kind == Kind::Number => {
            finding.help(format!("numbers have a decimal point: `{}.{}`", left.text, right.text))
        }
        _ => finding.help("commas stand between arguments: `min(x, y)`"),
    }
}
