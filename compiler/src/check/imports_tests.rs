//! What imports bring, and what is said of those that are wrong.

use crate::Model;
use crate::check::check_text_with;

/// The files of a folder, by their paths.
type Folder = &'static [(&'static str, &'static str)];

const FOLDER: Folder = &[
    (
        "strains.piola",
        "potential strains\nimport \"sub/powers.piola\"\nparameter n = 2, n != 0 \"exponent\"\n\
         parameter mu(2) = (1, 2) in J/m^(2*d+1), mu > 0\nunused = 3 + zz\nS(x) = power(x, n)/n\n\
         wrong(x) = x + 3*l\nstate q(2) = 0\nupdate q(k) = max(q(k), S(l/L)*n)\npsi(l) = 1\n",
    ),
    (
        "sub/powers.piola",
        "potential powers\nimport \"common.piola\"\npower(x, e) = x^e - one\n\
         curve(x) = table(\"t.csv\", x)\n",
    ),
    ("sub/common.piola", "potential common\none = 1\n"),
    ("sub/t.csv", "0, 1\n1, 2\n2, 4\n"),
    ("broken.piola", "potential broken\nS(x) = 2*\nparameter C Pa\n"),
    ("nameless.piola", "S(x) = x\n"),
    ("self.piola", "potential self\nimport \"self.piola\"\none = 1\n"),
    ("round.piola", "potential round\nimport \"trip.piola\"\n"),
    ("trip.piola", "potential trip\nimport \"round.piola\"\n"),
];

/// The code of a finding, its message, and the text at its place.
type Told = (&'static str, String, String);

fn check(text: &str) -> Result<(String, Model), Vec<Told>> {
    let read = |name: &str| {
        let found = FOLDER.iter().find(|(path, _)| *path == name);
        found.map(|(_, text)| text.to_string()).ok_or_else(|| "no such file".to_string())
    };
    let text = format!("potential p\n{text}\n");
    let checked = check_text_with(&text, &read);
    checked.map(|(ast, model)| (piola_grammar::print(&ast), model)).map_err(|found| {
        let told = |f: piola_grammar::Diagnostic| {
            assert!(f.notes.iter().all(|note| text.get(note.span.range()).is_some()), "{f:?}");
            (f.code, f.message, text[f.span.range()].to_string())
        };
        found.into_iter().map(told).collect()
    })
}

#[test]
fn what_is_used_comes_along_and_nothing_else() {
    for (short, long) in [
        (
            "import \"strains.piola\"\npsi(l) = sum(k, mu(k)*L*(S(l/L) - q(k))^2)",
            "one = 1\npower(x, e) = x^e - one\nparameter n = 2, n != 0 \"exponent\"\n\
             parameter mu1 = 1 in J/m^(2*d + 1), mu1 > 0\nparameter mu2 = 2 in J/m^(2*d + 1), mu2 > 0\n\
             S(x) = power(x, n)/n\nstate q1 = 0\nstate q2 = 0\nupdate q1 = max(q1, S(l/L)*n)\n\
             update q2 = max(q2, S(l/L)*n)\n\
             psi(l) = mu1*L*(S(l/L) - q1)^2 + mu2*L*(S(l/L) - q2)^2",
        ),
        // A file that is imported twice counts once; what a function takes comes from nowhere.
        (
            "import \"sub/common.piola\"\nimport \"sub/powers.piola\"\nf(n) = n*one\npsi(l) = power(f(l), 2)",
            "one = 1\npower(x, e) = x^e - one\nf(n) = n*one\npsi(l) = power(f(l), 2)",
        ),
        ("import \"strains.piola\"\npsi(l) = L*(l/L - 1)^2", "psi(l) = L*(l/L - 1)^2"),
        (
            "import \"sub/powers.piola\"\npsi(l) = curve(l)",
            "curve(x) = table(\"sub/t.csv\", x)\npsi(l) = curve(l)",
        ),
    ] {
        let (text, model) = check(short).unwrap();
        let (written, other) = check(long).unwrap();
        assert_eq!(text, written);
        let listing = crate::print::model_listing;
        assert_eq!(listing(&model), listing(&other));
        // Places are those of the text that imports.
        let length = short.len() as u32 + 12;
        assert!(model.parameters().iter().all(|parameter| parameter.span.end <= length));
    }
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    for (text, code, message, place) in [
        (
            "import \"nowhere.piola\"\npsi(l) = l",
            "wrong-import",
            "cannot read nowhere.piola",
            "\"nowhere.piola\"",
        ),
        (
            "import \"broken.piola\"\npsi(l) = l",
            "wrong-import",
            "broken.piola:2:10: ",
            "\"broken.piola\"",
        ),
        (
            "import \"broken.piola\"\npsi(l) = l",
            "wrong-import",
            "broken.piola:3:13: ",
            "\"broken.piola\"",
        ),
        (
            "import \"nameless.piola\"\npsi(l) = l",
            "wrong-import",
            "nameless.piola:1:1: ",
            "\"nameless.piola\"",
        ),
        (
            "import \"self.piola\"\npsi(l) = l",
            "wrong-import",
            "self.piola -> self.piola",
            "import \"self.piola\"",
        ),
        (
            "import \"round.piola\"\npsi(l) = l",
            "wrong-import",
            "round.piola -> trip.piola -> round.piola",
            "import \"round.piola\"",
        ),
        (
            "import \"strains.piola\"\npsi(l) = mu(1)*wrong(l/L)",
            "dimension-mismatch",
            "strains.piola:7:12: ",
            "import \"strains.piola\"",
        ),
        (
            "import \"strains.piola\"\npsi(l) = unused*l",
            "unknown-name",
            "strains.piola:5:14: unknown name `zz`",
            "import \"strains.piola\"",
        ),
        (
            "import \"strains.piola\"\nS(x) = x\npsi(l) = S(l)",
            "duplicate-name",
            "`S` is defined a second time",
            "S",
        ),
        ("psi(l) = S(l)\nimport \"strains.piola\"", "unknown-name", "unknown function `S`", "S"),
        ("import strains\npsi(l) = S(l)", "syntax", "stands in quotes", "strains"),
        ("import \"strains.piola\"\npsi(l) = T(l)", "unknown-name", "unknown function `T`", "T"),
    ] {
        let found = check(text).expect_err(text);
        let is_told = found.iter().any(|(c, m, p)| *c == code && m.contains(message) && p == place);
        assert!(is_told, "{text}: {found:?}");
        assert!(found.len() <= 2, "{text}: {found:?}");
    }
}

#[test]
fn a_text_in_no_folder_imports_nothing() {
    let found = crate::check_text("potential p\nimport \"a.piola\"\npsi(l) = l\n").unwrap_err();
    assert_eq!((found.len(), found[0].code), (1, "wrong-import"));
}
