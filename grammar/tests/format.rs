//! Formatted files mean what they meant, keep their comments, and are formatted.

use piola_grammar::{TokenKind, format, generate, parse, same_tree, tokens};
use proptest::prelude::*;

/// All parts of a text but ends of lines.
fn parts(text: &str) -> Vec<(TokenKind, String)> {
    let all = tokens(text).into_iter().filter(|token| token.kind != TokenKind::Newline);
    all.map(|token| (token.kind, token.text(text).trim_end().to_string())).collect()
}

fn check(text: &str) -> String {
    let formatted = format(text).unwrap();
    assert!(same_tree(&parse(text).unwrap(), &parse(&formatted).unwrap()), "{text}\n{formatted}");
    assert_eq!(parts(text), parts(&formatted));
    assert_eq!(format(&formatted).unwrap(), formatted);
    formatted
}

#[test]
fn the_layout_is_that_of_the_library() {
    let text = "\n\npotential  law \"title\"\r\n# a comment \n\n\nparameter C=1 in J / m^( 2*d+1 ),C>0 \"what\"\n\
                parameter   mu in Pa\nparameter n =- 2 , n<0 \"exponent\" # more\n\n\
                S( x ) = if x==0 then -ln (x) else ( x ^ n-1 )/n# seth-hill\n\
                y=F' : F + 2 -x  # two\n\
                psi( l ) = 1/2 * C* (  # first\n  S(l/L)^2\n\t\t+ (- 1)\n)\ndomain l/L in( 0,inf )\n\
                break when not( l>2 )and l<3 \"reason\"";
    let expected = "potential law  \"title\"\n# a comment\n\n\
                    parameter C = 1 in J/m^(2*d+1), C > 0  \"what\"\n\
                    parameter mu    in Pa\n\
                    parameter n = -2, n < 0                \"exponent\"  # more\n\n\
                    S(x) = if x == 0 then -ln(x) else (x^n-1)/n  # seth-hill\n\
                    y = F' : F + 2 - x                           # two\n\
                    psi(l) = 1/2*C*(  # first\n    S(l/L)^2\n        + (-1)\n    )\n\
                    domain l/L in (0, inf)\n\
                    break when not (l > 2) and l < 3  \"reason\"\n";
    assert_eq!(check(text), expected);
}

#[test]
fn what_cannot_be_read_is_not_formatted() {
    assert!(format("potential p\npsi(l) = (l\n").is_err());
}

/// A text with other blanks, and comments where lines may end.
fn respaced(text: &str, choices: &[u8]) -> String {
    let mut out = String::new();
    let mut depth = 0;
    let all = tokens(text);
    for (number, token) in all.iter().enumerate() {
        let choice = choices[number % choices.len()];
        let word = token.text(text);
        depth += i32::from(matches!(word, "(" | "[")) - i32::from(matches!(word, ")" | "]"));
        if token.kind == TokenKind::Newline && choice & 1 == 1 {
            out.push_str(" # said\n");
        }
        out.push_str(word);
        let is_word =
            |kind| matches!(kind, TokenKind::Name | TokenKind::Keyword | TokenKind::Number);
        let next = all.get(number + 1).map(|next| next.kind);
        let must = is_word(token.kind) && next.is_some_and(is_word);
        match choice >> 1 & 3 {
            0 if !must => {}
            1 if depth > 0 => out.push_str(" # inside\n  "),
            2 => out.push_str("  \t"),
            _ => out.push(' '),
        }
    }
    out
}

proptest! {
    #[test]
    fn any_program_with_any_blanks_means_the_same(
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        choices in prop::collection::vec(any::<u8>(), 1..40),
    ) {
        let text = generate::potential_text(&bytes);
        check(&text);
        let other = respaced(&text, &choices);
        prop_assert!(same_tree(&parse(&text).unwrap(), &parse(&other).unwrap()), "{other}");
        check(&other);
    }
}

#[test]
fn lines_end_as_they_did() {
    let text = "potential p\r\nparameter   C1\r\npsi(l)=C1*(l - L)^2";
    let formatted = format(text).unwrap();
    assert!(formatted.ends_with("\r\n") && !formatted.replace("\r\n", "").contains('\n'));
    assert_eq!(formatted.replace("\r\n", "\n"), format(&text.replace("\r\n", "\n")).unwrap());
    assert_eq!(format(&formatted).unwrap(), formatted);
}
