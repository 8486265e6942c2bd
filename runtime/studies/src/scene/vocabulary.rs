//! Every table and key of scenes, with what their values may be: for schemas and for editors.

use piola_mechanics::deformation::{Discretisation, OperatorOrder, Stabilisation};
use piola_mechanics::lattice::Nodes;
use piola_mechanics::surface::{Surface, Volumes};
use piola_mechanics::weights::Weights;
use piola_mechanics::words::Words;
use piola_solvers::singular::Singular;
use piola_solvers::steps::Loose;

use super::fracture::TrackAxis;
use super::keys::{Row, Slot};
use super::read::{MOTION_KEYS, OUTPUT_KEYS, SOLVER_KEYS, STEPS_KEYS, schemas};
use super::{ColourBy, FrameField, NamedInfluence, Plane};

/// A table of scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct TableWords {
    /// Its name, `body` or `material.plus`.
    pub name: &'static str,
    /// Whether there may be several, in double brackets; a `[material]` may stand in either.
    pub repeats: bool,
    /// Its keys; `*` for those that the user chooses.
    pub keys: Vec<KeyWords>,
}

/// A key of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyWords {
    /// The key.
    pub name: &'static str,
    /// An example of its value, as TOML.
    pub example: &'static str,
    /// What the value may be.
    pub value: ValueWords,
}

/// What the value of a key may be.
#[derive(Clone, Debug, PartialEq)]
pub enum ValueWords {
    /// One of these words.
    Word(Vec<&'static str>),
    /// One of these words, or another text.
    WordOrText(Vec<&'static str>),
    /// An array of some of these words, each once.
    Words(Vec<&'static str>),
    /// A finite number greater than 0.
    Positive,
    /// A number greater than 0 and less than 1.
    Fraction,
    /// A finite number not less than 0.
    NotNegative,
    /// `true` or `false`.
    Switch,
    /// A time greater than 0, a number in s or a text with a unit; or the word.
    Seconds(Option<&'static str>),
    /// A whole number, not less than this one.
    Count(i64),
    /// A text.
    Text,
    /// What no rule of this kind describes: expressions, sets, coordinates; the example shows one.
    Other,
}

/// Every table of scenes with its keys, those that stand once first.
pub fn vocabulary() -> Vec<TableWords> {
    schemas().into_iter().map(|(title, keys)| table(title, keys)).collect()
}

fn table(title: &'static str, keys: &[(&'static str, &'static str)]) -> TableWords {
    let name = title.trim_matches(['[', ']']);
    let key = |(key, example): &(&'static str, &'static str)| KeyWords {
        name: key,
        example,
        value: value(name, key),
    };
    TableWords { name, repeats: title.starts_with("[["), keys: keys.iter().map(key).collect() }
}

fn value(table: &str, key: &str) -> ValueWords {
    use ValueWords::{Fraction, Positive, Switch, Text, Word, WordOrText};
    let rows = match table {
        "steps" => of_rows(&STEPS_KEYS, key),
        "motion" => of_rows(&MOTION_KEYS, key),
        "solver" => of_rows(&SOLVER_KEYS, key),
        "output" => of_rows(&OUTPUT_KEYS, key),
        _ => None,
    };
    rows.unwrap_or_else(|| match (table, key) {
        ("body", "nodes") => Word(Nodes::words()),
        ("body", "points" | "mesh") => Text,
        ("body" | "horizon", "spacing" | "thickness" | "spacings" | "radius") => Positive,
        ("horizon", "weights") => Word(Weights::words()),
        ("horizon", "surface") => Word(Surface::words()),
        ("horizon", "volumes") => Word(Volumes::words()),
        ("correspondence", "discretisation") => Word(Discretisation::words()),
        ("correspondence", "stabilisation") => Word(Stabilisation::words()),
        ("correspondence", "stiffness") => Positive,
        ("correspondence", "order") => Word(OperatorOrder::words()),
        ("correspondence", "influence") => WordOrText(NamedInfluence::words()),
        ("correspondence", "plane") => Word(Plane::words()),
        ("fracture", "loose") => Word(Loose::words()),
        ("fracture", "singular") => Word(Singular::words()),
        ("track", "axis") => Word(TrackAxis::words()),
        ("track", "threshold") => Fraction,
        ("track", "thickness") => Positive,
        ("crack", "damaged") => Switch,
        (_, "set" | "name" | "potential" | "rule" | "as") => Text,
        _ => ValueWords::Other,
    })
}

/// What a key of these rows may be.
fn of_rows<S: Default>(rows: &[Row<S>], key: &str) -> Option<ValueWords> {
    let (_, _, slot) = rows.iter().find(|(name, ..)| *name == key)?;
    Some(match slot(&mut S::default()) {
        Slot::Word(choice) => ValueWords::Word(choice.words()),
        Slot::Colour(_) => ValueWords::WordOrText(ColourBy::words()),
        Slot::Fields(_) => ValueWords::Words(FrameField::words()),
        Slot::Positive(_) => ValueWords::Positive,
        Slot::Fraction(_) => ValueWords::Fraction,
        Slot::NotNegative(_) => ValueWords::NotNegative,
        Slot::Switch(_) => ValueWords::Switch,
        Slot::Seconds(_) => ValueWords::Seconds(None),
        Slot::SecondsOr(_, word) => ValueWords::Seconds(Some(word)),
        Slot::Count(_, least) => ValueWords::Count(least),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    /// Lines without which a table is not read to its end.
    fn needed(table: &str, key: &str) -> &'static str {
        match (table, key) {
            ("body", "points" | "mesh") => "dimension = 2",
            ("body", _) => "box = [[0, 0], [1, 1]]\nspacing = 0.1",
            ("horizon", "radius") => "",
            ("horizon", _) => "spacings = 3",
            ("correspondence", "stiffness") => {
                "discretisation = \"stabilised\"\nstabilisation = \"silling\""
            }
            ("track", _) => "name = \"tip\"\naxis = \"X\"",
            ("motion", _) => "end = 1",
            ("crack", _) => "segment = [[0, 0], [1, 1]]",
            ("probe", _) => "name = \"tip\"\nat = [0, 0]",
            ("interface", _) => "between = [\"steel\", \"rest\"]",
            ("material" | "material.plus", _) => "potential = \"javili2020\"",
            _ => "",
        }
    }

    /// What is said of a table with a key of this value, at that value.
    fn said(table: &TableWords, key: &str, value: &str) -> Vec<String> {
        let of_several =
            table.repeats || (table.name == "material" && matches!(key, "set" | "name"));
        let [open, close] = if of_several { ["[[", "]]"] } else { ["[", "]"] };
        let mut text = format!("{open}{}{close}\n", table.name);
        let mut needed: Vec<&str> = needed(table.name, key).lines().collect();
        needed.retain(|line| !line.starts_with(&format!("{key} ")));
        text += &needed.join("\n");
        let start = text.len();
        text += &format!("\n{key} = {value}\n");
        if table.name != "body" {
            text += "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n";
        }
        if table.name != "horizon" {
            text += "[horizon]\nspacings = 3\n";
        }
        if table.name == "interface" {
            text += "[sets]\nleft = \"X < 0.5\"\n[[material]]\npotential = \"javili2020\"\n\
                     [[material]]\nname = \"steel\"\nset = \"left\"\npotential = \"javili2020\"\n";
        } else if !table.name.starts_with("material") {
            text += "[material]\npotential = \"javili2020\"\n";
        }
        let end = text[start + 1..].find('\n').unwrap() + start + 1;
        let Err(report) = Scene::read(&text, "scene.toml", &[]) else { return Vec::new() };
        let here = report.findings.iter().map(|found| &found.diagnostic);
        let here = here.filter(|d| (start..end).contains(&(d.span.start as usize)));
        here.map(|d| format!("{}: {}", d.code, d.helps.join(" "))).collect()
    }

    #[test]
    fn values_are_what_the_reader_takes() {
        let mut n_words = 0;
        for table in vocabulary() {
            for key in &table.keys {
                let of = |value: &str| said(&table, key.name, value).join("; ");
                let wrong = |value: &str, code: &str| {
                    let said = of(value);
                    assert!(said.contains(code), "{}.{} = {value}: {said}", table.name, key.name);
                };
                match &key.value {
                    ValueWords::Word(words) => {
                        let said = of("\"nonsense\"");
                        for word in words {
                            assert!(said.contains(&format!("\"{word}\"")), "{key:?}: {said}");
                        }
                        assert!(said.starts_with("unknown-choice"), "{key:?}: {said}");
                        n_words += 1;
                    }
                    ValueWords::WordOrText(words) => {
                        for word in words {
                            let said = of(&format!("\"{word}\""));
                            assert!(!said.contains("unknown"), "{key:?}: {said}");
                        }
                    }
                    ValueWords::Words(_) => wrong("[\"nonsense\"]", "unknown-choice"),
                    ValueWords::Positive => wrong("0", "out-of-range"),
                    ValueWords::Fraction => wrong("1.5", "out-of-range"),
                    ValueWords::NotNegative => wrong("-1", "out-of-range"),
                    ValueWords::Switch => wrong("1.5", "wrong-type"),
                    ValueWords::Seconds(_) => wrong("\"1 kg\"", "unit"),
                    ValueWords::Count(least) => wrong(&(least - 1).to_string(), "out-of-range"),
                    ValueWords::Text => wrong("1.5", "wrong-type"),
                    ValueWords::Other => {}
                }
            }
        }
        assert!(n_words > 15, "{n_words}");
    }
}
