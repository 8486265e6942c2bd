//! The choices of `[solver]`, as they show in what a run leaves.

use serde_json::Value;

use crate::scenes::{strip, strip_with};
use crate::support::{SceneFolder, number, piola};

/// Total energy at the end, and what the summary says of the solver.
fn solved(folder: &SceneFolder, choices: &[&str]) -> (f64, Value, Value) {
    let mut arguments = vec!["--force"];
    for choice in choices {
        arguments.extend(["--set", choice]);
    }
    folder.run(&arguments).expect(0);
    let summary = folder.summary();
    let last = summary["steps"].as_array().unwrap().last().unwrap().clone();
    (number(&last["energy"]), last, summary)
}

#[test]
fn relaxation_finds_the_same_equilibria() {
    let folder = strip();
    let (expected, _, _) = solved(&folder, &[]);
    let (energy, last, summary) = solved(&folder, &["steps.find=relaxation"]);
    assert!((energy / expected - 1.0).abs() < 1e-9, "{energy} {expected}");
    assert_eq!(last["positive_definite"], Value::Null);
    assert!(
        number(&last["iterations"]) > 10.0 && number(&last["residual_over_reaction"][0]) > 1e-9
    );
    assert_eq!(summary["solver"]["linear"], "none");
    assert_eq!(summary["solver"]["linear_solves"], 0);
    let svg = std::fs::read_to_string(folder.out().join("picture.svg")).unwrap();
    assert!(svg.contains("hundreds of steps") && !svg.contains("Newton"));
    let beyond = ["--force", "--set", "steps.find=relaxation", "--set", "solver.tolerance=1e-18"];
    folder.run(&beyond).expect(3).says(&["rounding floor"]);
}

/// Along rows, by fours or in batches: of interactions, gathered values and gradients. A bench says which way it was.
#[test]
fn passes_go_as_the_scene_says() {
    let folder = strip_with("spacing = 0.1", "spacing = 0.04");
    for (potential, parameters, ways, in_batches) in [
        ("javili2020", "{C1=1,C2=0}", &["rows"][..], &["compiled batches"][..]),
        (
            "linear_peridynamic_solid",
            "{K=2,G=1}",
            &["compiled families", "rows"],
            &["compiled families"],
        ),
        ("neo_hooke", "{lambda=1,mu=1}", &["compiled families", "rows"], &["compiled families"]),
    ] {
        let potential = format!("material.potential={potential}");
        let parameters = format!("material.parameters={parameters}");
        let energy = |passes: &str, expected: &[&str]| {
            let choices = [&potential, &parameters, passes];
            let scene = folder.scene();
            let mut bench = vec!["bench", &scene, "--format", "json"];
            bench.extend(choices.iter().flat_map(|choice| ["--set", choice]));
            let bench = piola(&bench).expect(0).json();
            assert_eq!(bench["ways"], serde_json::json!(expected), "{choices:?}");
            solved(&folder, &choices).0
        };
        let shortest = energy("solver.passes=auto", ways);
        let batches = energy("solver.passes=batches", in_batches);
        assert!((shortest / batches - 1.0).abs() < 1e-9, "{potential}: {shortest} {batches}");
    }
}

#[test]
fn every_choice_leads_to_the_same_equilibria() {
    let folder = strip();
    let (expected, direct, summary) = solved(&folder, &[]);
    assert_eq!(summary["solver"]["linear"], "Cholesky");
    let reason = summary["solver"]["linear_reason"].as_str().unwrap();
    assert!(reason.contains("in two dimensions"), "{reason}");
    assert_eq!(summary["solver"]["linear_iterations"], 0);
    let condition = number(&direct["condition"]);
    for linear in ["cholesky", "ldlt", "lu", "cg", "matrix-free"] {
        for newton in ["full", "inexact", "modified"] {
            let choices = [
                format!("solver.linear={linear}"),
                format!("solver.newton={newton}"),
                "solver.max_iterations=60".to_string(),
            ];
            let choices: Vec<&str> = choices.iter().map(String::as_str).collect();
            let (energy, last, summary) = solved(&folder, &choices);
            assert!((energy / expected - 1.0).abs() < 1e-9, "{choices:?}: {energy} {expected}");
            assert_eq!(last["positive_definite"], true, "{choices:?}");
            let by = last["positive_definite_by"].as_str().unwrap();
            let iterates = linear == "cg" || linear == "matrix-free";
            assert_eq!(by.starts_with("conjugate gradients: "), iterates, "{choices:?}: {by}");
            assert_eq!(number(&summary["solver"]["linear_iterations"]) > 0.0, iterates);
            assert_eq!(summary["solver"]["preconditioner"].is_null(), !iterates);
            assert_eq!(number(&summary["solver"]["gradients"]) > 0.0, newton == "modified");
            let ratio = number(&last["condition"]) / condition;
            assert!((0.2..1.2).contains(&ratio), "{choices:?}: {ratio}");
            let warned = summary["warnings"].to_string().contains("makes no difference");
            assert_eq!(warned, newton == "inexact" && !iterates, "{choices:?}");
        }
    }
}

#[test]
fn gmres_and_differences_lead_to_the_same_equilibria_and_see_no_signs() {
    let folder = strip();
    let (expected, _, _) = solved(&folder, &[]);
    for (choices, method) in [
        (&["solver.linear=gmres"][..], "GMRES"),
        (&["solver.linear=gmres", "solver.newton=modified"], "GMRES"),
        (&["solver.products=finite-difference"], "GMRES"),
        (&["solver.products=central-difference", "solver.newton=inexact"], "GMRES"),
        (
            &["solver.products=finite-difference", "solver.linear=matrix-free"],
            "matrix-free conjugate gradients",
        ),
    ] {
        let (energy, last, summary) =
            solved(&folder, &[choices, &["solver.max_iterations=60"]].concat());
        assert!((energy / expected - 1.0).abs() < 1e-9, "{choices:?}: {energy} {expected}");
        assert_eq!(summary["solver"]["linear"], method, "{choices:?}");
        assert!(number(&summary["solver"]["linear_iterations"]) > 0.0);
        assert!(!summary["warnings"].to_string().contains("makes no difference"));
        let by = last["positive_definite_by"].as_str().unwrap();
        if method == "GMRES" {
            assert!(last["positive_definite"].is_null() && last["condition"].is_null());
            assert_eq!(by, "GMRES: signs unknown");
        } else {
            assert_eq!(last["positive_definite"], true);
            assert!(by.starts_with("conjugate gradients: "), "{by}");
        }
    }
    let refused =
        ["--force", "--set", "solver.products=finite-difference", "--set", "solver.linear=cg"];
    let message = folder.run(&refused).expect(2).stderr;
    assert!(
        message.contains("conflicting-keys") && message.contains("\"matrix-free\""),
        "{message}"
    );
}

#[test]
fn preconditioners_are_named() {
    let folder = strip();
    let named = |choices: &[&str]| {
        let (_, _, summary) = solved(&folder, choices);
        summary["solver"]["preconditioner"].as_str().unwrap().to_string()
    };
    let two_level = named(&["solver.linear=cg"]);
    assert!(two_level.contains("coarse system of"), "{two_level}");
    assert_eq!(named(&["solver.linear=cg", "solver.preconditioner=two-level"]), two_level);
    let jacobi = named(&["solver.linear=cg", "solver.preconditioner=block-jacobi"]);
    assert_eq!(jacobi, "block Jacobi");
    let choices = ["solver.linear=matrix-free", "solver.preconditioner=two-level"];
    assert_eq!(named(&choices), "block Jacobi");
    let warnings = folder.summary()["warnings"].to_string();
    assert!(warnings.contains("needs a stored tangent"), "{warnings}");
}
