//! Words the language knows by itself, and Greek letters spelled out.

/// Words with a meaning in the grammar; they cannot name anything.
pub const KEYWORDS: [&str; 19] = [
    "potential",
    "source",
    "import",
    "allow",
    "parameter",
    "dimensions",
    "weights",
    "domain",
    "break",
    "when",
    "state",
    "update",
    "in",
    "if",
    "then",
    "else",
    "and",
    "or",
    "not",
];

/// Keywords a statement begins with.
pub const STATEMENT_KEYWORDS: [&str; 11] = [
    "potential",
    "source",
    "import",
    "allow",
    "parameter",
    "dimensions",
    "weights",
    "domain",
    "break",
    "state",
    "update",
];

/// Functions of one number.
pub const UNARY_FUNCTIONS: [&str; 18] = [
    "sqrt", "exp", "ln", "log1p", "expm1", "log1pmx", "sin", "cos", "tan", "asin", "acos", "atan",
    "sinh", "cosh", "tanh", "erf", "abs", "sign",
];

/// Functions of two numbers.
pub const BINARY_FUNCTIONS: [&str; 3] = ["min", "max", "atan2"];

/// The name of an entry of a vector of parameters: `mu2` of `mu`, `C1_2` of `C1`; entries count from 1.
pub fn entry(vector: &str, number: u32) -> String {
    let mark = if vector.ends_with(|c: char| c.is_ascii_digit()) { "_" } else { "" };
    format!("{vector}{mark}{number}")
}

/// Whether a character may begin a name: a letter, `_` or a Greek letter.
pub(crate) fn begins_name(c: char) -> bool {
    c.is_ascii_alphabetic() || c == '_' || greek(c).is_some()
}

/// Whether a character may stand inside a name.
pub(crate) fn continues_name(c: char) -> bool {
    begins_name(c) || c.is_ascii_digit()
}

/// The length in bytes of the name at the start of `text`, 0 if there is none.
pub(crate) fn name_length(text: &str) -> usize {
    match text.chars().next() {
        Some(c) if begins_name(c) => text.find(|c: char| !continues_name(c)).unwrap_or(text.len()),
        _ => 0,
    }
}

/// The name with every Greek letter spelled out: `λ1` is `lambda1`.
pub fn spell_out(name: &str) -> String {
    let mut spelled = String::with_capacity(name.len());
    for c in name.chars() {
        match greek(c) {
            Some(letter) => spelled.push_str(letter),
            None => spelled.push(c),
        }
    }
    spelled
}

/// The English name of a Greek letter, capitalised for a capital letter.
fn greek(c: char) -> Option<&'static str> {
    Some(match c {
        'α' => "alpha",
        'β' => "beta",
        'γ' => "gamma",
        'δ' => "delta",
        'ε' | '\u{03F5}' => "epsilon",
        'ζ' => "zeta",
        'η' => "eta",
        'θ' | '\u{03D1}' => "theta",
        'ι' => "iota",
        'κ' | '\u{03F0}' => "kappa",
        'λ' => "lambda",
        'μ' | '\u{00B5}' => "mu",
        'ν' => "nu",
        'ξ' => "xi",
        'ο' => "omicron",
        'π' | '\u{03D6}' => "pi",
        'ρ' | '\u{03F1}' => "rho",
        'σ' | 'ς' => "sigma",
        'τ' => "tau",
        'υ' => "upsilon",
        'φ' | '\u{03D5}' => "phi",
        'χ' => "chi",
        'ψ' => "psi",
        'ω' => "omega",
        'Α' => "Alpha",
        'Β' => "Beta",
        'Γ' => "Gamma",
        'Δ' => "Delta",
        'Ε' => "Epsilon",
        'Ζ' => "Zeta",
        'Η' => "Eta",
        'Θ' => "Theta",
        'Ι' => "Iota",
        'Κ' => "Kappa",
        'Λ' => "Lambda",
        'Μ' => "Mu",
        'Ν' => "Nu",
        'Ξ' => "Xi",
        'Ο' => "Omicron",
        'Π' => "Pi",
        'Ρ' => "Rho",
        'Σ' => "Sigma",
        'Τ' => "Tau",
        'Υ' => "Upsilon",
        'Φ' => "Phi",
        'Χ' => "Chi",
        'Ψ' => "Psi",
        'Ω' => "Omega",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ast::ExprKind;

    fn parses_as_name(text: &str) -> Option<String> {
        let ast = crate::parse_expression(text).ok()?;
        match &ast.arena[ast.root].kind {
            ExprKind::Name(name) => Some(name.clone()),
            _ => None,
        }
    }

    #[test]
    fn the_grammar_and_these_tables_know_the_same_words() {
        for word in KEYWORDS {
            assert_eq!(parses_as_name(word), None, "{word}");
            assert_eq!(parses_as_name(&format!("{word}s")), Some(format!("{word}s")));
        }
        for word in ["psi", "inf", "sources", "iff", "_x", "x_1"] {
            assert_eq!(parses_as_name(word).as_deref(), Some(word));
        }
    }

    #[test]
    fn every_character_of_a_name_is_one_for_the_grammar_too() {
        for c in (0..=0x10FFFFu32).filter_map(char::from_u32) {
            let text = c.to_string();
            if greek(c).is_some() {
                assert_eq!(parses_as_name(&text), Some(spell_out(&text)), "{c}");
            } else if c as u32 >= 0x80 && (c as u32) < 0x3000 {
                assert_eq!(parses_as_name(&text), None, "{c:?}");
            }
        }
        assert_eq!(parses_as_name("λ1").as_deref(), Some("lambda1"));
        assert_eq!(parses_as_name("Δμ_0").as_deref(), Some("Deltamu_0"));
    }
}
