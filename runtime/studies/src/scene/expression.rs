//! Expressions in the strings of a scene: X, Y, Z and t, each with its place.

use piola_compiler::{CompiledFormula, Formula};
use piola_grammar::{Diagnostic, Span};

use super::tree::Text;

/// What an expression of a scene may name.
const VARIABLES: [&str; 4] = ["X", "Y", "Z", "t"];

/// What an influence function may name.
const LENGTHS: [&str; 2] = ["L", "delta"];

/// A compiled expression of X, Y, Z, t and where it stands. Equal if the texts are.
#[derive(Clone, Debug)]
pub struct Expression {
    /// As written.
    pub text: String,
    /// Place of the text between the quotes.
    pub span: Span,
    formula: Formula,
}

impl PartialEq for Expression {
    fn eq(&self, other: &Expression) -> bool {
        self.text == other.text
    }
}

/// What an expression is for.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Role {
    /// A truth value of X, Y, Z.
    Condition,
    /// A number of X, Y, Z, t.
    Number,
    /// A number of X, Y, Z: at the start.
    Start,
    /// A number of L, delta.
    Influence,
}

impl Expression {
    /// Compiles a string of a scene; `dimension` is unknown if the body could not be read.
    pub(super) fn compile(
        text: &Text,
        role: Role,
        dimension: Option<usize>,
    ) -> Result<Expression, Vec<Diagnostic>> {
        let mut found: Vec<Diagnostic> = Vec::new();
        if dimension == Some(2) && role != Role::Influence {
            found.extend(names(&text.value, "Z").map(|span| {
                Diagnostic::error("no-third-dimension", span, "there is no Z in two dimensions")
                    .help("use X and Y, or write dimension = 3")
            }));
        }
        if role == Role::Condition {
            found.extend(names(&text.value, "t").map(|span| {
                Diagnostic::error("time-in-condition", span, "a set of points cannot change with t")
                    .help("use t in the components of [[prescribe]] or [[load]]")
            }));
        }
        if role == Role::Start {
            found.extend(names(&text.value, "t").map(|span| {
                Diagnostic::error(
                    "time-in-condition",
                    span,
                    "there is no t: this is the state at t = 0",
                )
                .help("use t in the components of [[prescribe]] or [[load]]")
            }));
        }
        let compiled = match role {
            Role::Condition => Formula::condition(&text.value, &VARIABLES),
            Role::Number | Role::Start => Formula::number(&text.value, &VARIABLES),
            Role::Influence => Formula::number(&text.value, &LENGTHS),
        };
        match compiled {
            Ok(formula) if found.is_empty() => {
                return Ok(Expression { text: text.value.clone(), span: text.content, formula });
            }
            Ok(_) => {}
            Err(more) => found.extend(more),
        }
        Err(found.into_iter().map(|diagnostic| place(diagnostic, text)).collect())
    }

    /// Its number at a reference position (2 or 3 coordinates, in m) and a time.
    pub fn value(&self, position: &[f64], t: f64) -> f64 {
        self.formula.value(&arguments(position, t))
    }

    /// Machine code of the same bits as [`Expression::value`] for arrays of X, Y, Z and t; nothing where it
    /// cannot be compiled.
    pub(crate) fn compiled(&self) -> Option<CompiledFormula> {
        self.formula.compiled(VARIABLES.len() as u8).ok()
    }

    /// Its number for the length of a bond at rest and the horizon, both in m; for influence functions.
    pub fn influence(&self, length: f64, horizon: f64) -> f64 {
        self.formula.value(&[length, horizon])
    }

    /// Whether this name stands in it as a word of its own.
    pub(crate) fn names(&self, name: &str) -> bool {
        names(&self.text, name).next().is_some()
    }

    /// Its truth at a reference position (2 or 3 coordinates, in m).
    pub fn holds(&self, position: &[f64]) -> bool {
        self.formula.holds(&arguments(position, 0.0))
    }
}

/// The values of [`VARIABLES`]; Z is 0 in two dimensions, where no expression can name it.
fn arguments(position: &[f64], t: f64) -> [f64; 4] {
    [position[0], position[1], position.get(2).copied().unwrap_or(0.0), t]
}

/// The same for the text of a parameter, which stands at a span of the scene.
pub(crate) fn placed(diagnostic: Diagnostic, text: &str, span: Span) -> Diagnostic {
    let verbatim = (span.end - span.start) as usize == text.len();
    place(diagnostic, &Text { value: text.to_string(), content: span, verbatim })
}

/// Moves a finding about an expression to the expression's place in the scene.
fn place(diagnostic: Diagnostic, text: &Text) -> Diagnostic {
    if text.verbatim {
        return diagnostic.shifted(text.content.start as usize);
    }
    // Behind an escape bytes no longer correspond: the whole string is the honest place.
    Diagnostic { span: text.content, notes: Vec::new(), ..diagnostic }
}

/// The places where `name` stands as a word of its own.
pub(crate) fn names<'a>(text: &'a str, name: &'a str) -> impl Iterator<Item = Span> + 'a {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(name).filter_map(move |(start, _)| {
        let end = start + name.len();
        let alone = !text[..start].ends_with(is_word) && !text[end..].starts_with(is_word);
        alone.then_some(Span::new(start, end))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_whole_words() {
        let found: Vec<Span> = names("Z + Zeta*aZ - (Z)", "Z").collect();
        assert_eq!(found, [Span::new(0, 1), Span::new(15, 16)]);
        assert_eq!(names("tan(X) + t_0 + 2*t", "t").collect::<Vec<_>>(), [Span::new(17, 18)]);
    }

    #[test]
    fn behind_escapes_the_whole_string_is_the_place() {
        let text = Text { value: "X < 1".into(), content: Span::new(10, 20), verbatim: false };
        let inner = Diagnostic::error("e", Span::new(4, 5), "").note(Span::new(0, 1), "");
        let moved = place(inner.clone(), &text);
        assert_eq!((moved.span, moved.notes.len()), (Span::new(10, 20), 0));
        let moved = place(inner, &Text { verbatim: true, ..text });
        assert_eq!((moved.span, moved.notes[0].span), (Span::new(14, 15), Span::new(10, 11)));
    }
}
