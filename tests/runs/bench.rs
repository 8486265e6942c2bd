//! `piola bench`: everything it promises is there; how fast anything is, no test says.

use serde_json::Value;

use crate::motion::THROWN;
use crate::scenes::{STRIP, strip, strip_with};
use crate::support::{SceneFolder, number, numbers, piola};

fn bench(subject: &str, more: &[&str]) -> Value {
    let arguments = [&["bench", subject, "--format", "json"], more].concat();
    piola(&arguments).expect(0).json()
}

fn list(value: &Value) -> &Vec<Value> {
    value.as_array().unwrap_or_else(|| panic!("{value} is no array"))
}

#[test]
fn an_energy_is_timed_in_every_way() {
    let found = bench("firooz2023", &["--dim", "2", "--set", "n=2.7"]);
    assert_eq!((&found["potential"], &found["dimension"]), (&"firooz2023".into(), &2.into()));
    let ways: Vec<&str> =
        list(&found["ways"]).iter().map(|way| way["way"].as_str().unwrap()).collect();
    for way in ["fast", "strict", "interpreter", "hyper-dual", "hyper-dual coordinates"] {
        assert!(ways.contains(&way), "{ways:?}");
    }
    for way in list(&found["ways"]) {
        assert!(number(&way["compile_seconds"]) > 0.0);
        let measures: Vec<&Value> = list(&way["energies"]).iter().map(|e| &e["measure"]).collect();
        assert_eq!(measures, ["l", "a"], "bonds and triangles");
        for energy in list(&way["energies"]) {
            for order in ["energy", "gradient", "tangent"] {
                assert!(number(&energy["nanoseconds"][order]) > 0.0);
            }
            assert_eq!(energy["of_square"], false, "n = 2.7");
            let errors = &energy["errors"];
            if way["way"] == "fast" || way["way"] == "strict" {
                let errors = numbers(errors);
                assert!(errors.len() == 3 && errors.iter().all(|e| *e <= 64.0), "{errors:?}");
            } else {
                assert!(errors.is_null(), "only levels are audited: {way}");
            }
        }
    }
}

#[test]
fn energies_of_the_deformation_gradient_are_timed_with_their_errors() {
    let arguments = ["--dim", "2", "--set", "lambda=100", "--set", "mu=1"];
    let found = bench("st_venant_kirchhoff", &arguments);
    for way in list(&found["ways"]) {
        let energies = list(&way["energies"]);
        if way["way"] == "hyper-dual coordinates" {
            assert!(energies.is_empty(), "{way}");
            continue;
        }
        assert_eq!((energies.len(), &energies[0]["measure"]), (1, &"F".into()));
        for order in ["energy", "gradient", "product"] {
            assert!(number(&energies[0]["nanoseconds"][order]) > 0.0);
        }
        let errors = &energies[0]["errors"];
        if way["way"] == "fast" || way["way"] == "strict" {
            assert!(numbers(errors).iter().all(|e| *e > 0.0 && *e <= 64.0), "{errors:?}");
        } else {
            assert!(errors.is_null(), "{way}");
        }
    }
    let text = piola(&[&["bench", "st_venant_kirchhoff"], &arguments[..]].concat()).expect(0);
    for part in ["psi(F)", "ns per place", "hyper-dual  "] {
        assert!(text.stdout.contains(part), "no `{part}` in\n{}", text.stdout);
    }
}

#[test]
fn what_is_a_function_of_squares_is_told() {
    let arguments = ["bench", "firooz2023", "--dim", "3", "--set", "n=2"];
    let text = piola(&arguments).expect(0).stdout;
    for part in ["psi(l) is a function of l^2", "psi(a) is a function of a^2"] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    assert!(!text.contains("of v^2"), "{text}");
}

#[test]
fn people_read_a_table() {
    let text = piola(&["bench", "silling2000"]).expect(0).stdout;
    for part in ["silling2000 in ", "psi(l)", "strict", "hyper-dual coordinates", "compiling"] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    let text = piola(&["bench", &strip().scene(), "--threads", "1"]).expect(0).stdout;
    for part in ["threads: 1", "interactions", "tangent", "matrix", "peak", "Cholesky"] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
}

#[test]
fn a_scene_is_timed_phase_by_phase() {
    let folder = strip();
    let found = bench(&folder.scene(), &["--threads", "2"]);
    let energy = piola(&["energy", &folder.scene(), "--tangent"]).expect(0).json();
    let kinds =
        ["bonds", "triangles", "tetrahedra"].map(|kind| number(&energy["interactions"][kind]));
    assert_eq!(numbers(&found["interactions"]), kinds);
    assert_eq!(found["points"], energy["points"]);
    let names: Vec<&str> =
        list(&found["phases"]).iter().map(|phase| phase["name"].as_str().unwrap()).collect();
    let expected = [
        "read",
        "compile",
        "interactions",
        "conditions",
        "linear system: set up",
        "tangent at rest",
        "linear system: prepare",
        "linear system: solve",
    ];
    assert_eq!(names, expected);
    for phase in list(&found["phases"]) {
        assert!(number(&phase["wall_seconds"]) > 0.0, "{phase}");
    }
    let passes: Vec<&Value> = list(&found["passes"]).iter().map(|pass| &pass["name"]).collect();
    assert_eq!(passes, ["energy", "gradient", "tangent"]);
    for pass in list(&found["passes"]) {
        let each = number(&pass["seconds"]) / kinds.iter().sum::<f64>() * 1e9;
        assert!(each > 0.0);
        assert!((number(&pass["nanoseconds_per_interaction"]) / each - 1.0).abs() < 1e-9);
    }
    // Blocks of the diagonal and of every bond, four numbers each.
    let blocks = number(&found["points"]) + kinds[0];
    assert_eq!(number(&found["matrix_bytes"]), 32.0 * blocks);
    assert_eq!(found["linear"]["method"], "Cholesky");
    assert!(number(&found["linear"]["factor_bytes"]) > 0.0);
    assert!(number(&found["linear"]["relative_residual"]) < 1e-10);
    assert!(list(&found["notes"]).is_empty(), "{}", found["notes"]);
}

#[test]
fn a_motion_is_timed_by_step() {
    let folder = SceneFolder::new(THROWN);
    let found = bench(&folder.scene(), &["--threads", "1"]);
    let passes: Vec<&str> =
        list(&found["passes"]).iter().map(|pass| pass["name"].as_str().unwrap()).collect();
    assert_eq!(passes, ["forces", "loads", "step", "row"]);
    for pass in list(&found["passes"]) {
        assert!(number(&pass["seconds"]) > 0.0, "{pass}");
    }
    let motion = &found["motion"];
    assert_eq!((&motion["method"], &found["linear"]), (&"verlet".into(), &Value::Null));
    let (step, critical) =
        (number(&motion["step_seconds"]), number(&motion["critical_step_seconds"]));
    assert!(step < critical && number(&motion["steps"]) * step > 0.49, "{motion}");
    assert!(number(&motion["wall_seconds"]) > 0.0);
    let text = piola(&["bench", &folder.scene()]).expect(0).stdout;
    assert!(text.contains("critical step") && text.contains("steps of"), "{text}");
}

#[test]
fn values_of_a_scene_can_be_overridden() {
    let folder = strip();
    let points = |more: &[&str]| number(&bench(&folder.scene(), more)["points"]);
    assert!(points(&["--set", "body.spacing=0.05"]) > 3.0 * points(&[]));
    let by_cg = bench(&folder.scene(), &["--set", "solver.linear=\"cg\""]);
    assert!(number(&by_cg["linear"]["iterations"]) > 0.0, "{by_cg}");
}

#[test]
fn a_body_that_can_move_freely_has_no_linear_system() {
    let free = STRIP
        .replace("u = [0, 0]", "u = [0, \"free\"]")
        .replace("[\"0.2*t\", 0]", "[\"0.2*t\", \"free\"]");
    let found = bench(&SceneFolder::new(&free).scene(), &[]);
    assert!(found["linear"].is_null());
    let notes = found["notes"].to_string();
    for part in ["no linear system was solved", "translation along y", "the passes are at rest"] {
        assert!(notes.contains(part), "no `{part}` in {notes}");
    }
    assert!(number(&found["passes"][2]["seconds"]) > 0.0);
}

#[test]
fn what_cannot_be_timed_is_refused() {
    piola(&["bench", "no_such_law"]).expect(2).says(&["no potential `no_such_law`"]);
    piola(&["bench", "missing.toml"]).expect(2).says(&["cannot read missing.toml"]);
    piola(&["bench", &strip().scene(), "--dim", "2"]).expect(2).says(&["--dim"]);
    let wrong = strip_with("X > 0.85", "X > 8");
    piola(&["bench", &wrong.scene()]).expect(2).says(&["`right` has no points"]);
    let folder = SceneFolder::new("");
    let file = folder.file("p.piola", "potential p\npsi(l) = ln(0*l)\n");
    piola(&["bench", &file]).expect(2).says(&["psi(l) is not finite"]);
}
