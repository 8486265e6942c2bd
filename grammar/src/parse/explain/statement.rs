//! Mistakes in the frame of a statement: its first word, its head, and what only it can hold.

use super::super::parser::Rule;
use super::token::{Kind, Token};
use super::{Failure, Goal};
use crate::Diagnostic;
use crate::names::{KEYWORDS, STATEMENT_KEYWORDS};
use crate::suggest;

/// First words of other languages, and how the same is said here.
const FOREIGN_HEADS: &[(&[&str], &str)] = &[
    (
        &["let", "def", "fn", "fun", "func", "function", "const", "var", "local", "set", "define"],
        "a definition needs no keyword: `k = ...` or `S(x) = ...`",
    ),
    (&["param", "params", "const", "material"], "write `parameter`"),
    (&["energy", "psi", "ψ", "phi", "w", "U"], "write `psi(l) = ...`"),
    (&["title", "name", "law", "model"], "write `potential NAME \"title\"`"),
    (&["ref", "reference", "paper", "cite"], "write `source \"...\"`"),
    (
        &["ignore", "silence", "suppress", "disable", "nolint", "expect"],
        "write `allow \"code\" \"why\"`, with the code of a lint",
    ),
    (&["dim", "dims"], "write `dimensions 2, 3`"),
    (&["unit", "units"], "units stand behind parameters: `parameter C in Pa`"),
    (
        &["fail", "failure", "rupture", "damage", "remove", "delete", "crack"],
        "write `break when l/L - 1 > s0`",
    ),
    (
        &["history", "memory", "internal", "statev", "variable"],
        "what a bond remembers is a state: `state k = 0`, and `update k = max(k, l/L - 1)`",
    ),
    (
        &["viscosity", "damping", "dashpot", "rayleigh", "viscous"],
        "what bonds dissipate has a potential: `dissipation(l) = 1/2*eta*rate(l)^2`",
    ),
    (&["range", "where", "for", "assume"], "write `domain l/L in (0, 10)`"),
    (
        &["include", "use", "using", "from", "require", "load"],
        "the names of another file come with `import \"strains.piola\"`",
    ),
    (&["return", "print"], "the energies `psi(..)` are the results of a file"),
];

pub(super) fn explain(failure: &Failure<'_>) -> Option<Diagnostic> {
    if failure.goal == Goal::Unit {
        return unit(failure);
    }
    if failure.goal != Goal::Statement {
        return None;
    }
    let head = failure.tokens.first()?;
    if failure.index == 0 {
        return Some(beginning(failure));
    }
    let explained = match head.text {
        "potential" => potential(failure),
        "source" => source(failure),
        "import" => import(failure),
        "allow" => allow(failure),
        "dimensions" => dimensions(failure),
        "weights" => weights(failure),
        "parameter" => parameter(failure),
        "domain" => domain(failure),
        "break" => breaking(failure),
        "state" => state(failure),
        "update" => update(failure),
        "psi" | "ψ" => energy(failure).or_else(|| definition(failure, *head)),
        "dissipation" => dissipation(failure).or_else(|| definition(failure, *head)),
        _ => definition(failure, *head),
    };
    explained.or_else(|| second_statement(failure))
}

/// The first token of the line already fits nothing.
fn beginning(failure: &Failure<'_>) -> Diagnostic {
    let named = failure.after().is_some_and(|next| next.text == "=");
    let reserved = if named { failure.reserved() } else { None };
    reserved.or_else(|| super::spelling::explain(failure)).unwrap_or_else(|| {
        let finding = failure
            .error(format!("a statement cannot begin with {}", failure.described()))
            .label("expected a statement");
        match failure.found_text() {
            "then" | "else" | "and" | "or" | "+" | "-" | "*" | "/" | "^" | "<" | ">" | "="
            | ")" => finding.help("a statement ends with its line, unless a parenthesis is open"),
            _ => {
                finding.help("an expression needs a name: `k = ...`, or a measure: `psi(l) = ...`")
            }
        }
    })
}

fn potential(failure: &Failure<'_>) -> Option<Diagnostic> {
    let example = "write `potential my_name \"what it is\"`";
    if failure.index == 1 {
        let finding = failure.reserved().unwrap_or_else(|| {
            failure.error("a potential has a name").label("expected a name, without quotes")
        });
        return Some(finding.help(example));
    }
    let (name, found) = (failure.before()?, failure.found()?);
    Some(match (found.text, failure.after()) {
        ("-", Some(next)) if next.start == found.end() && found.start == name.end() => failure
            .error("a name holds no `-`")
            .help(format!("write `{}_{}`", name.text, next.text)),
        _ => super::spelling::explain(failure).unwrap_or_else(|| {
            failure.error("the title stands in quotes").label("expected `\"`").help(example)
        }),
    })
}

fn source(failure: &Failure<'_>) -> Option<Diagnostic> {
    if failure.index > 1 {
        return None;
    }
    super::spelling::explain(failure).or_else(|| {
        let finding = failure.error("the source stands in quotes").label("expected `\"`");
        Some(finding.help("write `source \"author year, eq. (1)\"`"))
    })
}

fn import(failure: &Failure<'_>) -> Option<Diagnostic> {
    let help = "write `import \"strains.piola\"`: all names of it that are used come with it";
    if failure.index > 1 {
        let finding = failure.error("an import is a file and nothing else");
        return Some(finding.label("after the file").help(help));
    }
    super::spelling::explain(failure).or_else(|| {
        let finding = failure.error("the file that is imported stands in quotes");
        Some(finding.label("expected `\"`").help(help))
    })
}

fn allow(failure: &Failure<'_>) -> Option<Diagnostic> {
    let what = match failure.index {
        2.. if failure.found_text() == "," => {
            let finding = failure.error("a line allows one lint").label("only a reason may follow");
            return Some(finding.help("write a line with `allow` for each"));
        }
        1 => "the code of a lint stands in quotes",
        2 => "the reason stands in quotes",
        _ => return None,
    };
    super::spelling::explain(failure).or_else(|| {
        let finding = failure.error(what).label("expected `\"`");
        Some(finding.help("write `allow \"no-bond-energy\" \"why it is right\"`"))
    })
}

fn dimensions(failure: &Failure<'_>) -> Option<Diagnostic> {
    let finding = failure.error("dimensions are a list of 2 and 3");
    Some(finding.help("write `dimensions 2`, `dimensions 3` or `dimensions 2, 3`"))
}

fn weights(failure: &Failure<'_>) -> Option<Diagnostic> {
    if failure.index > 1 {
        return None;
    }
    let finding = failure.error("weights are named by a word").label("expected `volumes`");
    Some(finding.help("write `weights volumes`"))
}

fn domain(failure: &Failure<'_>) -> Option<Diagnostic> {
    let example = "write `domain l/L in (0, 10]`; `inf` and `-inf` are without end";
    let marks = matches!(failure.found_text(), "" | "=" | ";" | ":" | ".");
    if failure.expects(Rule::in_word) && marks {
        let finding = failure.error("a domain has an interval").label("expected `in (..., ...)`");
        return Some(finding.help(example));
    }
    if failure.expects(Rule::open_bound) {
        let finding = failure.error("an interval begins with `(` or `[`");
        return Some(finding.label("expected `(` or `[`").help(example));
    }
    let number = failure.found_kind() == Some(Kind::Number);
    let ended = number || marks || matches!(failure.found_text(), ")" | "]");
    if failure.expects(Rule::comma) && ended {
        let finding = failure.error("a comma stands between the ends of an interval");
        return Some(finding.label("expected a comma").help(example));
    }
    None
}

fn breaking(failure: &Failure<'_>) -> Option<Diagnostic> {
    if failure.index > 1 {
        return None;
    }
    let finding = failure.error("`break` is followed by `when` and a condition");
    Some(
        finding
            .label("expected `when`")
            .help("write `break when l/L - 1 > s0 \"critical stretch\"`"),
    )
}

fn state(failure: &Failure<'_>) -> Option<Diagnostic> {
    let example = "write `state k = 0 \"largest stretch so far\"`";
    let finding = match failure.index {
        1 => failure
            .reserved()
            .unwrap_or_else(|| failure.error("a state has a name").label("expected a name")),
        2 => failure
            .error("a state begins with a value, which every bond has at the start")
            .label("expected `=`"),
        _ if failure.found_text() == "," => {
            failure.error("a state has no conditions").label("parameters have")
        }
        _ => return unit(failure),
    };
    Some(finding.help(example))
}

fn update(failure: &Failure<'_>) -> Option<Diagnostic> {
    let finding = match failure.index {
        1 => failure.error("`update` is followed by the name of a state").label("expected a name"),
        2 => failure.error("an update says what a state becomes").label("expected `=`"),
        _ => return None,
    };
    Some(finding.help("write `update k = max(k, l/L - 1)`"))
}

fn parameter(failure: &Failure<'_>) -> Option<Diagnostic> {
    let example = "write `parameter C = 1 in Pa, C > 0 \"what it is\"`";
    if failure.index == 1 {
        let finding = failure
            .reserved()
            .unwrap_or_else(|| failure.error("a parameter has a name").label("expected a name"));
        return Some(finding.help(example));
    }
    if failure.before()?.kind == Kind::String {
        let finding = failure.error("the description is the last part of a parameter");
        return Some(finding.label("after the description").help(example));
    }
    if let Some(finding) = unit(failure) {
        return Some(finding);
    }
    if failure.expects(Rule::in_word) {
        return without_in(failure, failure.found()?);
    }
    None
}

/// Where a unit or the exponent of one should stand.
fn unit(failure: &Failure<'_>) -> Option<Diagnostic> {
    let wants = [Rule::unit, Rule::unit_factor, Rule::unit_one, Rule::exponent];
    let wants_name = failure.expects(Rule::name) && !failure.expects_operand();
    if !wants_name && !wants.iter().any(|&rule| failure.expects(rule)) {
        return in_unit(failure).then(|| after_unit(failure, failure.found()?)).flatten();
    }
    let finding = if failure.expects(Rule::exponent) {
        failure.error("an exponent is a number, a name or stands in parentheses")
    } else {
        failure.error(format!("expected a unit, found {}", failure.described()))
    };
    Some(match failure.found_text() {
        "[" => finding.help("write the unit without brackets: `in Pa`"),
        "(" => finding.help("write `N/m/s` for `N/(m*s)`"),
        _ => finding.help("a unit is a product of powers: `J/m^4`; a plain number has none or `1`"),
    })
}

/// Whether a unit has just been read.
fn in_unit(failure: &Failure<'_>) -> bool {
    failure.expects(Rule::unit_operator) || failure.expects(Rule::caret)
}

/// What stands behind a unit and does not belong there.
fn after_unit(failure: &Failure<'_>, found: Token<'_>) -> Option<Diagnostic> {
    let compares = |text: &str| matches!(text, "<" | ">" | "=" | "!");
    if let Some(finding) = super::spelling::explain(failure) {
        return Some(finding);
    }
    if failure.goal == Goal::Statement {
        if found.text == "=" {
            let finding = failure.error("the default value stands before the unit");
            return Some(finding.help("write `parameter C = 1 in Pa`"));
        }
        if compares(found.text) || failure.after().is_some_and(|next| compares(next.text)) {
            let finding = failure.error("a condition stands behind a comma");
            return Some(finding.help("write `parameter C in Pa, C > 0`"));
        }
    }
    let before = failure.before()?;
    if found.kind == Kind::Word && before.kind == Kind::Word && !KEYWORDS.contains(&found.text) {
        let finding = failure.error("there is nothing between these two units");
        return Some(finding.help(format!("write `{}*{}`", before.text, found.text)));
    }
    None
}

/// A unit, a condition or something else where `in` or a comma is missing.
fn without_in(failure: &Failure<'_>, found: Token<'_>) -> Option<Diagnostic> {
    let before = failure.before()?;
    let apart = before.end() < found.start;
    let directly_after_name = failure.index == 2;
    if matches!(found.text, "<" | ">" | "!") || failure.rest().starts_with("==") {
        let name = before.text;
        let finding = failure.error("a condition stands behind a comma").label("expected a comma");
        return Some(finding.help(format!("write `parameter {name}, {name} > 0`")));
    }
    if found.text == "[" || found.text == ":" {
        let finding = failure.error("a unit stands behind `in`").label("expected `in`");
        return Some(finding.help("write `parameter C in Pa`"));
    }
    let is_word = found.kind == Kind::Word && !KEYWORDS.contains(&found.text);
    if is_word && apart && (directly_after_name || before.kind == Kind::Number) {
        let finding = failure.error("a unit stands behind `in`").label("expected `in`");
        return Some(
            finding.help(format!("write `in {}`; a description stands in quotes", found.text)),
        );
    }
    None
}

/// The head of `psi(l) = ...`.
fn energy(failure: &Failure<'_>) -> Option<Diagnostic> {
    let before_body = !failure.tokens[..failure.index].iter().any(|token| token.text == "=");
    if !before_body || failure.expects(Rule::equals) && failure.index > 2 {
        return None;
    }
    let finding = failure.error("an energy names its one measure in parentheses");
    Some(finding.label("expected `psi(l)`, `psi(a)` or `psi(v)`").help(
        "write `psi(l) = ...`; the right side may hold `L`, parameters and definitions as well",
    ))
}

/// The head of `dissipation(l) = ...`.
fn dissipation(failure: &Failure<'_>) -> Option<Diagnostic> {
    let before_body = !failure.tokens[..failure.index].iter().any(|token| token.text == "=");
    if !before_body || failure.expects(Rule::equals) && failure.index > 2 {
        return None;
    }
    let finding = failure.error("a dissipation names the length of a bond in parentheses");
    Some(
        finding
            .label("expected `dissipation(l)`")
            .help("write `dissipation(l) = 1/2*eta*rate(l)^2`"),
    )
}

/// `S(x) = ...`, `k = ...`, or a line that is no statement at all.
fn definition(failure: &Failure<'_>, head: Token<'_>) -> Option<Diagnostic> {
    if failure.index == 1 && failure.expects(Rule::equals) {
        return Some(unknown_head(failure, head));
    }
    if failure.expects(Rule::equals) {
        return Some(no_equals(failure));
    }
    let before_body = !failure.tokens[..failure.index].iter().any(|token| token.text == "=");
    if before_body && failure.index >= 2 && !failure.expects(Rule::infix) {
        let finding = failure.reserved().unwrap_or_else(|| {
            failure.error("the parameters of a function are names").label("expected a name")
        });
        return Some(finding.help("write `S(x) = ...`"));
    }
    None
}

/// The head of a definition or energy is complete, and no `=` follows.
fn no_equals(failure: &Failure<'_>) -> Diagnostic {
    let finding = match failure.found_text() {
        "=" => failure.error("`==` compares and does not define"),
        _ => failure.error(format!("expected `=`, found {}", failure.described())),
    };
    let head = failure.text[..failure.at].trim();
    let head = if head.len() <= 30 { head } else { "name" };
    finding.label("expected `=`").help(format!("write `{head} = ...`"))
}

/// A line whose first word is a name and whose second token is neither `=` nor `(`.
fn unknown_head(failure: &Failure<'_>, head: Token<'_>) -> Diagnostic {
    if matches!(failure.found_text(), "=" | ":" | "<") {
        return no_equals(failure);
    }
    let message = format!("`{}` begins no statement", head.text);
    let finding = Diagnostic::error("syntax", head.span(), message).label("not a statement");
    if let Some(word) = suggest(head.text, STATEMENT_KEYWORDS) {
        return finding.help(format!("did you mean `{word}`?"));
    }
    let foreign = FOREIGN_HEADS.iter().find(|(heads, _)| heads.contains(&head.text));
    match foreign {
        Some((_, help)) if failure.found_kind() != Some(Kind::Mark) => finding.help(*help),
        _ => finding.help(format!("to define it, write `{} = ...`", head.text)).help(
            "a statement begins with `potential`, `source`, `import`, `allow`, `parameter`, `dimensions`, \
             `weights`, `domain`, `break when`, `state`, `update`, `psi(..) =`, `dissipation(l) =` or `name =`",
        ),
    }
}

/// A second statement on the same line.
fn second_statement(failure: &Failure<'_>) -> Option<Diagnostic> {
    if !STATEMENT_KEYWORDS.contains(&failure.found_text()) || failure.expects_operand() {
        return None;
    }
    let finding = failure.error("a statement ends with its line").label("begins a new statement");
    Some(finding.help("begin a new line here"))
}
