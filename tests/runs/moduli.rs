//! `piola moduli` and `piola calibrate`: what they refuse, and what they say then.

use crate::scenes::strip;
use crate::support::{SceneFolder, number, numbers, piola};

fn square(material: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0.0, 0.0], [1.0, 1.0]]\nspacing = 0.1\n[horizon]\nspacings = 3\n\
         [material]\n{material}\n"
    ))
}

fn calibrate(folder: &SceneFolder, target: &str, vary: &str) -> crate::support::Outcome {
    piola(&["calibrate", &folder.scene(), "--target", target, "--vary", vary])
}

#[test]
fn people_read_a_table() {
    let text = piola(&["moduli", &strip().scene(), "--density", "7800"]).expect(0).stdout;
    for part in ["endless lattice", "C11", "nu_strain", "Zener", "stable", "c_L", "dt", "Lanczos"] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    piola(&["moduli", &strip().scene(), "--density=-1"]).expect(2).says(&["--density"]);
}

#[test]
fn bodies_under_stress_are_told() {
    // Constant tension in all bonds.
    let folder = SceneFolder::new(
        "[body]\nbox = [[0.0, 0.0], [5.0, 5.0]]\nspacing = 1.0\n[horizon]\nspacings = 1\n\
         weights = \"unit\"\n[material]\npotential = \"tension.piola\"\n",
    );
    folder.file("tension.piola", "potential tension\npsi(l) = 3*l + (l - L)^2\n");
    let arguments = ["moduli", &folder.scene()];
    let found = piola(&[&arguments[..], &["--format", "json"]].concat()).expect(0).json();
    assert_eq!(numbers(&found["stress"]), [3.0, 0.0, 0.0, 3.0]);
    assert_eq!(number(&found["C11"]), 2.0);
    let text = piola(&arguments).expect(0).stdout;
    assert!(text.contains("NOT STRESS-FREE"), "{text}");
}

#[test]
fn targets_out_of_reach_say_what_stands_in_the_way() {
    let folder = square("potential = \"javili2020\"");
    calibrate(&folder, "E=1,nu=0.4", "C1").expect(1).says(&[
        "nu = 0.400000 cannot be reached by varying C1",
        "nu is 0.318248 whatever C1 is: vary another parameter",
        "not varied: C2, C3",
    ]);
    calibrate(&folder, "E=1,nu=-0.3", "C1,C2").expect(1).says(&[
        "closest is",
        "nu reaches from about 0.3182 to",
        "it would take C1 = ",
        "breaks `C2 >= 0`",
    ]);
}

#[test]
fn requests_that_make_no_sense_are_refused() {
    let folder = square("potential = \"javili2020\"");
    for (target, vary, parts) in [
        ("E=1", "C9", &["no parameter `C9`", "C1, C2, C3"][..]),
        ("E=1", "C3", &["do not depend on `C3`"]),
        ("E=1", "C1,C2", &["2 parameters are varied for 1 targets"]),
        ("E=1,nu=0.4", "C1,C1", &["`C1` is named twice"]),
        ("E=1,E=2", "C1,C2", &["`E` has two targets"]),
        ("E=-1", "C1", &["no modulus of a stable body"]),
        ("E", "C1", &["not NAME=VALUE"]),
        ("G=1", "C1", &["no modulus `G`", "nu_strain"]),
        ("E=stiff", "C1", &["`stiff` is not a number"]),
    ] {
        calibrate(&folder, target, vary).expect(2).says(parts);
    }
    let solid = SceneFolder::new(
        "[body]\nbox = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\nspacing = 0.25\n[horizon]\nspacings = 2\n\
         [material]\npotential = \"javili2020\"\n",
    );
    calibrate(&solid, "nu_strain=0.3", "C1").expect(2).says(&["plane bodies"]);
}

#[test]
fn what_is_not_varied_stays_as_it_was_written() {
    let folder = square("potential = \"neo_hooke\"\nparameters = { lambda = \"5 GPa\", mu = 1.0 }");
    let text = calibrate(&folder, "C44=2 MPa", "mu").expect(0).stdout;
    assert!(text.contains("lambda = \"5 GPa\"\n"), "{text}");
    let line = text.lines().find(|line| line.starts_with("mu = ")).unwrap();
    let mu: f64 = line["mu = ".len()..].parse().unwrap();
    assert!((mu - 2e6).abs() < 1e-6 * 2e6, "{text}");
    let more = ["--format", "json"];
    let path = folder.scene();
    let arguments = ["calibrate", &path, "--target", "C44=2e6", "--vary", "mu"];
    let json = piola(&[&arguments[..], &more[..]].concat()).expect(0).json();
    assert_eq!(json["linear"], true);
    assert!((json["moduli"]["C44"].as_f64().unwrap() - 2e6).abs() < 1e-3);
}
