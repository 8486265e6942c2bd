//! One potential through every stage: `stages/`.

use crate::support::piola;
use crate::{compare, folder};

/// The stages that say the same on every computer (`asm` does not), and the values each is given.
const STAGES: [(&str, &[&str]); 7] = [
    ("ast", &[]),
    ("model", &[]),
    ("graph", &[]),
    ("text", &[]),
    ("latex", &[]),
    ("c", &["C1=2", "C2=40", "C3=0", "n=2"]),
    ("clif", &["C1=2", "C2=40", "C3=0", "n=2"]),
];

#[test]
fn every_stage_is_as_recorded() {
    let folder = folder("stages");
    let file = folder.join("seth_hill.piola");
    for (stage, settings) in STAGES {
        let mut arguments = vec!["derive", file.to_str().unwrap(), "--dim", "2", "--emit", stage];
        for setting in settings {
            arguments.extend(["--set", setting]);
        }
        let outcome = piola(&arguments).expect(0);
        compare(&folder.join(format!("seth_hill.{stage}")), &outcome.stdout);
    }
}

/// With values that drop an energy or leave no power, less is generated.
#[test]
fn values_shorten_the_code() {
    let file = folder("stages").join("seth_hill.piola");
    let graph = |settings: &[&str]| {
        let mut arguments = vec!["derive", file.to_str().unwrap(), "--emit", "graph"];
        settings.iter().for_each(|setting| arguments.extend(["--set", setting]));
        piola(&arguments).expect(0).stdout
    };
    let all = graph(&["n=2.5", "C1=2", "C2=40", "C3=3"]);
    assert!(all.contains("^ 2.5") && all.contains("psi(v)"), "{all}");
    // With n = 1 no power is left but the square of the strain.
    let bonds = graph(&["n=1", "C1=2", "C2=0", "C3=0"]);
    assert!(bonds.matches('^').count() == 1 && !bonds.contains("psi(a)"), "{bonds}");
}
