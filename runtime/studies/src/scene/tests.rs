//! Wrong scenes with their messages, defaults, overrides, and the way back to text.
//!
//! These tests read scenes and never evaluate an expression; those that do are in
//! `formula_tests.rs`.

use super::*;
use piola_compiler::Form;
use piola_mechanics::energy::Products;
use piola_mechanics::kernel::Level;
use piola_solvers::linear::{LinearMethod, PreconditionerChoice};
use piola_solvers::newton::NewtonVariant;
use piola_solvers::steps::Start;

/// Every key of the format.
const FULL: &str = r#"[body]
dimension = 2
box = [[1.0, 1.0], [0.0, 0.0]]
spacing = 0.05
nodes = "cells"
remove = ["max(abs(X-0.5), abs(Y-0.5)) < 0.2 - 1e-9"]
[horizon]
radius = 0.15
weights = "volumes"
[material]
potential = "law.piola"
parameters = { C1 = 1.0, C2 = "200 GPa", n = 1, "λ" = 2e9 }
[sets]
right = "X > 0.875"
left = "X < 0.125"
[[prescribe]]
set = "left"
u = [0, "free"]
[[prescribe]]
set = "right"
u = ["0.1*t", -0.5]
[[load]]
set = "right"
force = ["0.1*t", 0]
[[load]]
set = "left"
density = [0, "-9.81*Y"]
[[probe]]
name = "tip"
at = [1.0, 0.5]
[steps]
end = 2.0
increments = 40
[solver]
tolerance = 1e-9
start = "extrapolate"
newton = "inexact"
linear = "matrix-free"
preconditioner = "block-jacobi"
products = "central-difference"
derivatives = "hyperdual-coordinates"
level = "strict"
form = "textbook"
strain = "positions"
passes = "batches"
unstable = "accept"
max_iterations = 7
[output]
frames = 0
"#;

/// The least that is a scene.
const LEAST: &str = r#"[body]
box = [[0, 0], [1, 1]]
spacing = 0.05
[horizon]
spacings = 3
[material]
potential = "javili2020"
"#;

fn read(text: &str) -> Scene {
    Scene::read(text, "scene.toml", &[]).unwrap_or_else(|report| panic!("{report}"))
}

fn read_with(text: &str, overrides: &[&str]) -> Result<Scene, SceneReport> {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    Scene::read(text, "scene.toml", &overrides)
}

/// Each finding of a wrong scene as `code at what stands there`.
fn findings(text: &str) -> Vec<String> {
    let report = Scene::read(text, "scene.toml", &[]).expect_err(text);
    report.findings.iter().map(|finding| summary(&report, finding)).collect()
}

fn summary(report: &SceneReport, finding: &Finding) -> String {
    let place = &report.sources[finding.source].text[finding.diagnostic.span.range()];
    format!("{} at {place}", finding.diagnostic.code)
}

#[test]
fn every_key_is_read() {
    let scene = read(FULL);
    let Points::Lattice(lattice) = &scene.body.points else { panic!("not a lattice") };
    assert_eq!((&lattice.low, &lattice.high), (&vec![0.0, 0.0], &vec![1.0, 1.0]));
    assert_eq!((lattice.spacing, lattice.nodes), (0.05, Nodes::Cells));
    assert_eq!(lattice.counts(), [20, 20]);
    assert_eq!(scene.body.dimension, 2);
    assert_eq!(scene.body.remove[0].text, "max(abs(X-0.5), abs(Y-0.5)) < 0.2 - 1e-9");
    assert_eq!(scene.horizon.extent, HorizonExtent::Radius(0.15));
    assert_eq!(scene.horizon.weights, Weights::Volumes);
    assert_eq!(scene.horizon_radius(), 0.15);
    assert_eq!(scene.material().potential.value, "law.piola");
    let parameters: Vec<(&str, &ParameterText)> = scene
        .material()
        .parameters
        .iter()
        .map(|parameter| (parameter.name.value.as_str(), &parameter.value.value))
        .collect();
    let expected = [
        ("C1", &ParameterText::Number(1.0)),
        ("C2", &ParameterText::Quantity("200 GPa".into())),
        ("n", &ParameterText::Number(1.0)),
        ("λ", &ParameterText::Number(2e9)),
    ];
    assert_eq!(parameters, expected);
    let quantity = scene.material().parameters[1].value.span;
    assert_eq!(&FULL[quantity.range()], "200 GPa");
    let sets: Vec<&str> = scene.sets.iter().map(|set| set.name.value.as_str()).collect();
    assert_eq!(sets, ["right", "left"]);
    let [left, right] = &scene.prescriptions[..] else { panic!("two prescriptions") };
    assert_eq!((left.set.value, right.set.value), (1, 0));
    assert_eq!(left.components[0].value, Some(Quantity::Number(0.0)));
    assert_eq!(left.components[1].value, None);
    assert!(matches!(&right.components[0].value,
        Some(Quantity::Expression(expression)) if expression.text == "0.1*t"));
    assert_eq!(scene.loads[0].kind, LoadKind::Force);
    assert_eq!(scene.loads[1].kind, LoadKind::Density);
    assert!(scene.loads[0].components[1].value.is_zero());
    assert_eq!(
        (scene.probes[0].name.value.as_str(), &scene.probes[0].at.value[..]),
        ("tip", &[1.0, 0.5][..])
    );
    assert_eq!(scene.steps, Steps { end: 2.0, increments: 40, ..Steps::default() });
    let solver = SolverSettings {
        tolerance: 1e-9,
        start: Start::Extrapolate,
        newton: NewtonVariant::Inexact,
        linear: LinearMethod::MatrixFree,
        preconditioner: PreconditionerChoice::BlockJacobi,
        products: Products::Central,
        derivatives: DerivativeSource::HyperdualCoordinates,
        level: Level::Strict,
        form: Form::Textbook,
        strain: StrainSource::Positions,
        passes: Passes::Batches,
        unstable: Unstable::Accept,
        max_iterations: 7,
    };
    assert_eq!(scene.solver, solver);
    assert_eq!(scene.output.frames, 0);
    assert_eq!(scene.warnings, []);
}

#[test]
fn every_default_is_filled_in() {
    let scene = read(LEAST);
    let Points::Lattice(lattice) = &scene.body.points else { panic!("not a lattice") };
    assert_eq!(lattice.nodes, Nodes::Cells);
    assert_eq!(lattice.counts(), [20, 20]);
    assert_eq!(scene.body.dimension, 2);
    assert_eq!(scene.body.remove, []);
    assert_eq!(scene.horizon.weights, Weights::Uniform);
    assert_eq!(scene.horizon_radius(), 3.0 * 0.05);
    assert_eq!(scene.material().parameters, []);
    assert_eq!((scene.sets.len(), scene.prescriptions.len()), (0, 0));
    assert_eq!((scene.loads.len(), scene.probes.len()), (0, 0));
    assert_eq!(scene.steps, Steps { end: 1.0, increments: 25, ..Steps::default() });
    let solver = SolverSettings {
        tolerance: 1e-10,
        start: Start::Tangent,
        newton: NewtonVariant::Full,
        linear: LinearMethod::Auto,
        preconditioner: PreconditionerChoice::Auto,
        products: Products::Exact,
        derivatives: DerivativeSource::Jit,
        level: Level::default(),
        form: Form::Accurate,
        strain: StrainSource::Displacements,
        passes: Passes::Auto,
        unstable: Unstable::Fail,
        max_iterations: 25,
    };
    assert_eq!(scene.solver, solver);
    assert_eq!(scene.output, OutputSettings::default());
    assert_eq!((scene.output.frames, scene.output.rows), (25, 1000));
}

const CLOUD: &str = "[body]\ndimension = 3\npoints = \"cloud.csv\"\n[horizon]\nradius = 0.2\n\
                     [material]\npotential = \"p\"\n";

#[test]
fn clouds_are_truncated_by_default() {
    let scene = read(CLOUD);
    assert_eq!(scene.horizon.weights, Weights::Truncated);
    assert_eq!(scene.body.points.spacing(), None);
}

#[test]
fn a_resolved_scene_reads_back_to_an_equal_one() {
    let odd = LEAST.replace("\"javili2020\"", "\"a\\\"\\\\\\u0007\\nb.piola\"");
    for text in [FULL, LEAST, CLOUD, &odd] {
        let scene = read(text);
        let resolved = scene.resolved_toml();
        let again = read(&resolved);
        assert_eq!(again, scene, "{resolved}");
        assert_eq!(again.resolved_toml(), resolved);
    }
}

#[test]
fn a_resolved_scene_holds_every_key() {
    let text =
        read(FULL).resolved_toml() + &read(CLOUD).resolved_toml() + &read(LEAST).resolved_toml();
    for key in [
        "dimension",
        "box",
        "spacing",
        "nodes",
        "remove",
        "points",
        "spacings",
        "radius",
        "weights",
        "potential",
        "\"λ\"",
        "left",
        "set",
        "u",
        "force",
        "density",
        "name",
        "at",
        "end",
        "increments",
        "tolerance",
        "start",
        "linear",
        "derivatives",
        "level",
        "form",
        "strain",
        "passes",
        "unstable",
        "max_iterations",
        "frames",
    ] {
        assert!(text.contains(&format!("\n{key} = ")), "{key} is missing in\n{text}");
    }
}

#[test]
fn scenes_differ_if_any_value_differs() {
    let scene = read(FULL);
    for (from, to) in [
        ("spacing = 0.05", "spacing = 0.1"),
        ("\"cells\"", "\"corners\""),
        ("< 0.2", "< 0.3"),
        ("0.15", "0.2"),
        ("\"volumes\"", "\"unit\""),
        ("law.piola", "other.piola"),
        ("C1 = 1.0", "C1 = 2.0"),
        ("X > 0.875", "X > 0.9"),
        ("\"free\"", "0"),
        ("force =", "density ="),
        ("[1.0, 0.5]", "[1.0, 0.6]"),
        ("end = 2.0", "end = 3.0"),
        ("1e-9\nstart", "1e-8\nstart"),
        ("level = \"strict\"", "level = \"fast\""),
        ("frames = 0", "frames = 1"),
    ] {
        let changed = FULL.replacen(from, to, 1);
        assert_ne!(changed, FULL, "{from} is not in the scene");
        assert_ne!(read(&changed), scene, "{from} -> {to}");
    }
}

/// A change of [`FULL`] and what is found then.
const WRONG: &[(&str, &str, &[&str])] = &[
    ("spacing = 0.05", "spaceing = 0.05", &["missing-key at [body]", "unknown-key at spaceing"]),
    ("[steps]", "[step]", &["unknown-key at step"]),
    ("frames = 0", "frame = 0", &["unknown-key at frame"]),
    ("dimension = 2", "dimension = 4", &["out-of-range at 4"]),
    ("dimension = 2", "dimension = \"2\"", &["wrong-type at \"2\""]),
    (
        "dimension = 2",
        "dimension = 3",
        &[
            "component-count at [[1.0, 1.0], [0.0, 0.0]]",
            "component-count at [0, \"free\"]",
            "component-count at [\"0.1*t\", -0.5]",
            "component-count at [\"0.1*t\", 0]",
            "component-count at [0, \"-9.81*Y\"]",
            "component-count at [1.0, 0.5]",
        ],
    ),
    ("[[1.0, 1.0], [0.0, 0.0]]", "[[1.0, 1.0]]", &["box-corners at [[1.0, 1.0]]"]),
    ("[0.0, 0.0]]", "[0.0, 1.0]]", &["box-corners at [[1.0, 1.0], [0.0, 1.0]]"]),
    ("[0.0, 0.0]]", "[0.0]]", &["box-corners at [[1.0, 1.0], [0.0]]"]),
    ("spacing = 0.05", "spacing = \"0.05\"", &["wrong-type at \"0.05\""]),
    ("spacing = 0.05", "spacing = 0", &["out-of-range at 0"]),
    ("spacing = 0.05", "spacing = inf", &["not-finite at inf"]),
    ("spacing = 0.05", "spacing = 0.07", &["extent-not-a-multiple at 0.07"]),
    ("spacing = 0.05", "spacing = 1e-6", &["too-many-points at 1e-6"]),
    ("spacing = 0.05", "spacing = 0.2", &["horizon-too-small at 0.15"]),
    ("\"cells\"", "\"cell\"", &["unknown-choice at \"cell\""]),
    ("remove = [", "remove = [1, ", &["wrong-type at 1"]),
    ("X-0.5), abs(Y-0.5)", "X-0.5), abs(Z-0.5)", &["no-third-dimension at Z"]),
    ("radius = 0.15", "radius = 0.15\nspacings = 3", &["conflicting-keys at spacings"]),
    ("radius = 0.15\n", "", &["missing-key at [horizon]"]),
    ("radius = 0.15", "radius = -1", &["out-of-range at -1"]),
    ("radius = 0.15", "radius = [0.15]", &["wrong-type at [0.15]"]),
    ("\"volumes\"", "\"volume\"", &["unknown-choice at \"volume\""]),
    ("C1 = 1.0", "C1 = true", &["wrong-type at true"]),
    ("C1 = 1.0", "C1 = nan", &["not-finite at nan"]),
    ("potential = \"law.piola\"", "potential = \" \"", &["out-of-range at \" \""]),
    (
        "[sets]\nright",
        "[sets]\nX",
        &["bad-name at X", "unknown-set at \"right\"", "unknown-set at \"right\""],
    ),
    (
        "[sets]\nright",
        "[sets]\n\"at the right\" = \"X > 0\"\nright",
        &["bad-name at \"at the right\""],
    ),
    ("\"X > 0.875\"", "0.875", &["wrong-type at 0.875"]),
    ("\"X > 0.875\"", "\"X > 0.875*t\"", &["time-in-condition at t"]),
    ("left = \"X < 0.125\"", "right = \"X < 0.125\"", &["duplicate-key at right"]),
    ("set = \"left\"\nu", "set = \"lefft\"\nu", &["unknown-set at \"lefft\""]),
    ("[0, \"free\"]", "[0, \"free\", 0]", &["component-count at [0, \"free\", 0]"]),
    ("[0, \"free\"]", "[0, true]", &["wrong-type at true"]),
    ("[0, \"free\"]", "0", &["wrong-type at 0"]),
    ("u = [0, \"free\"]", "", &["missing-key at [[prescribe]]"]),
    ("force = [\"0.1*t\", 0]", "force = [\"free\", 0]", &["free-load at \"free\""]),
    ("force = [\"0.1*t\", 0]", "force = [\"0.1*Z\", 0]", &["no-third-dimension at Z"]),
    (
        "force = [\"0.1*t\", 0]",
        "force = [0, 0]\ndensity = [0, 0]",
        &["conflicting-keys at density"],
    ),
    ("force = [\"0.1*t\", 0]", "", &["missing-key at [[load]]"]),
    ("at = [1.0, 0.5]", "at = [1.0]", &["component-count at [1.0]"]),
    ("at = [1.0, 0.5]", "at = [1.0, \"Y\"]", &["wrong-type at \"Y\""]),
    ("[steps]", "[[probe]]\nname = \"tip\"\nat = [0, 0]\n[steps]", &["duplicate-probe at \"tip\""]),
    ("end = 2.0", "end = 0", &["out-of-range at 0"]),
    ("increments = 40", "increments = 2.5", &["out-of-range at 2.5"]),
    ("increments = 40", "increments = 0", &["out-of-range at 0"]),
    ("tolerance = 1e-9", "tolerance = 1.0", &["out-of-range at 1.0"]),
    ("\"central-difference\"", "\"forward\"", &["unknown-choice at \"forward\""]),
    ("\"matrix-free\"", "\"cg\"", &["conflicting-keys at products"]),
    ("\"matrix-free\"", "\"ldlt\"", &["conflicting-keys at products"]),
    ("\"extrapolate\"", "\"extrapolated\"", &["unknown-choice at \"extrapolated\""]),
    ("frames = 0", "frames = -1", &["out-of-range at -1"]),
    ("[[probe]]", "[probe]", &["wrong-type at [probe]"]),
    ("u = [0, \"free\"]", "u = [0, free]", &["toml-syntax at free"]),
    ("[horizon]\nradius = 0.15\nweights = \"volumes\"\n", "", &["missing-table at "]),
];

#[test]
fn wrong_scenes_are_reported_at_their_place() {
    for (from, to, expected) in WRONG {
        let text = FULL.replacen(from, to, 1);
        assert_ne!(text, FULL, "{from} is not in the scene");
        assert_eq!(findings(&text), *expected, "{from} -> {to}");
    }
}

#[test]
fn clouds_refuse_what_belongs_to_lattices() {
    let cases = [
        ("radius = 0.2", "radius = 0.2\nweights = \"uniform\"", "uniform-on-cloud at \"uniform\""),
        ("dimension = 3\n", "", "missing-key at [body]"),
        ("dimension = 3", "dimension = 3\nspacing = 0.1", "conflicting-keys at spacing"),
        ("points =", "box = [[0,0,0],[1,1,1]]\npoints =", "conflicting-keys at points"),
    ];
    for (from, to, expected) in cases {
        assert_eq!(findings(&CLOUD.replace(from, to)), [expected], "{to}");
    }
}

#[test]
fn the_plane_and_its_thickness_are_read() {
    let plane = "[correspondence]\nplane = \"stress\"\n";
    let text = LEAST.replace("spacing = 0.05", "spacing = 0.05\nthickness = 0.01") + plane;
    let scene = read(&text);
    assert_eq!(scene.body.thickness.map(|t| t.value), Some(0.01));
    assert_eq!(scene.correspondence.as_ref().map(|c| c.plane), Some(Plane::Stress));
    assert_ne!(read(&(LEAST.to_string() + plane)), scene);
    assert_ne!(read(&text.replace("\"stress\"", "\"strain\"")), scene);
    let resolved = scene.resolved_toml();
    assert_eq!(read(&resolved), scene, "{resolved}");
    assert_eq!(findings(&text.replace("0.01", "0")), ["out-of-range at 0"]);
    let solid = text.replace("[[0, 0], [1, 1]]", "[[0, 0, 0], [1, 1, 1]]");
    let expected = ["conflicting-keys at 0.01", "conflicting-keys at plane"];
    assert_eq!(findings(&solid), expected);
}

#[test]
fn all_mistakes_are_reported_in_one_run() {
    let text = "[body]\nbox = [[0, 0], [1, 1]]\nspaceing = 0.1\n[horizon]\nspacings = \"3\"\n\
                [sets]\nleft = 1\n[[prescribe]]\nset = \"left\"\nu = [0]\n[solver]\nlinear = \"mumps\"\n";
    let expected = [
        "missing-key at [body]",
        "missing-table at ",
        "unknown-key at spaceing",
        "wrong-type at \"3\"",
        "wrong-type at 1",
        "component-count at [0]",
        "unknown-choice at \"mumps\"",
    ];
    assert_eq!(findings(text), expected);
}

#[test]
fn messages_say_what_to_write_instead() {
    let helps = |from: &str, to: &str| {
        let text = FULL.replacen(from, to, 1);
        let report = Scene::read(&text, "scene.toml", &[]).unwrap_err();
        let diagnostic = &report.findings[0].diagnostic;
        format!("{} | {}", diagnostic.label, diagnostic.helps.join(" | "))
    };
    assert_eq!(helps("spacing = 0.05", "spacing = \"0.1\""), " | write spacing = 0.1");
    assert_eq!(helps("spacing = 0.05", "spacing = \"fine\""), " | write spacing = 0.05");
    assert_eq!(helps("frames = 0", "frame = 0"), "did you mean `frames`? | ");
    assert_eq!(helps("set = \"left\"\nu", "set = \"lift\"\nu"), "did you mean `left`? | ");
    assert_eq!(helps("set = \"left\"\nu", "set = \"bottom\"\nu"), " | the sets are right, left");
    assert!(helps("0.05", "0.07").contains("spacing = 0.07142857142857142"));
    assert!(helps("\"matrix-free\"", "\"matrix free\"").contains("did you mean \"matrix-free\"?"));
    assert_eq!(helps("\"X > 0.875\"", "0.875"), " | write right = \"X < 0.1\"");
    assert!(helps("[0, \"free\"]", "[0, free]").contains("in quotes"));
}

#[test]
fn entries_without_effect_are_warned_of() {
    let text = FULL.replacen("[0, \"free\"]", "[\"free\", \"free\"]", 1);
    let warnings = read(&text.replace("[\"0.1*t\", 0]", "[0, 0.0]")).warnings;
    let codes: Vec<&str> = warnings.iter().map(|warning| warning.code).collect();
    assert_eq!(codes, ["idle-entry", "idle-entry"]);
    assert_eq!(&text[warnings[0].span.range()], "\"left\"");
}

#[test]
fn overrides_replace_and_add() {
    let overrides = [
        "body.spacing=0.1",
        "prescribe.0.u=[0, 0]",
        "prescribe.1.u.0 = 0.2*t",
        "solver.linear=cg",
        "solver.max_iterations = 9",
        "material.potential=law.piola",
        "material.parameters.C2=200 GPa",
        "sets.bottom=Y < 0.1",
        "probe.0.name=corner",
        "probe.0.at=[0, 0]",
    ];
    let text = LEAST.to_owned()
        + "[sets]\nleft = \"X < 0.1\"\n[[prescribe]]\nset = \"left\"\nu = [1, 1]\n\
           [[prescribe]]\nset = \"left\"\nu = [1, \"free\"]\n";
    let scene = read_with(&text, &overrides).unwrap_or_else(|report| panic!("{report}"));
    assert!((scene.horizon_radius() - 0.3).abs() < 1e-15);
    assert_eq!(scene.prescriptions[0].components[0].value, Some(Quantity::Number(0.0)));
    assert!(matches!(&scene.prescriptions[1].components[0].value,
        Some(Quantity::Expression(expression)) if expression.text == "0.2*t"));
    assert_eq!(scene.solver.linear, LinearMethod::Cg);
    assert_eq!(scene.solver.max_iterations, 9);
    assert_eq!(scene.material().potential.value, "law.piola");
    let quantity = ParameterText::Quantity("200 GPa".into());
    assert_eq!(scene.material().parameters[0].value.value, quantity);
    assert_eq!(scene.sets[1].name.value, "bottom");
    assert_eq!(scene.probes[0].at.value, [0.0, 0.0]);
    assert_eq!(read(&scene.resolved_toml()), scene);
}

#[test]
fn an_override_replaces_the_alternative_of_the_file() {
    let scene = read_with(LEAST, &["horizon.radius=0.2"]).unwrap();
    assert_eq!(scene.horizon.extent, HorizonExtent::Radius(0.2));
    let scene = read_with(FULL, &["load.0.density=[1, 2]"]).unwrap();
    assert_eq!(scene.loads[0].kind, LoadKind::Density);
    let report = read_with(LEAST, &["horizon.radius=0.2", "horizon.spacings=3"]).unwrap_err();
    assert_eq!(report.findings[0].diagnostic.code, "conflicting-keys");
}

#[test]
fn mistakes_in_overrides_are_reported_in_the_override() {
    let cases = [
        ("body.spacing=-0.1", "out-of-range at -0.1"),
        ("body.spacing=fine", "wrong-type at fine"),
        ("body.spaceing=0.1", "unknown-key at spaceing"),
        ("solver.linear=mumps", "unknown-choice at mumps"),
        ("prescribe.1.u=[0, 0]", "bad-override at 1"),
        ("prescribe.left.u=[0, 0]", "wrong-type at prescribe"),
        ("body.spacing.x=1", "bad-override at x"),
        ("body.spacing", "bad-override at body.spacing"),
        ("body..spacing=1", "bad-override at "),
        ("body.spacing=", "bad-override at "),
        ("body.box=[[0, 0], [1, 1]", "toml-syntax at "),
        ("sets.left=X < t", "time-in-condition at t"),
        ("steps=3", "wrong-type at 3"),
    ];
    for (text, expected) in cases {
        let report = read_with(LEAST, &["output.frames=3", text]).expect_err(text);
        let finding = &report.findings[0];
        assert_eq!(report.sources[finding.source].name, format!("--set {text}"));
        assert_eq!(summary(&report, finding), expected, "{text}");
    }
}

#[test]
fn entries_of_arrays_are_counted() {
    for (text, expected) in
        [("load.2.set=left", None), ("load.3.set=left", Some("bad-override at 3"))]
    {
        let report = read_with(FULL, &[text, "load.2.force=[1, 0]"]).err();
        let found = report.as_ref().map(|report| summary(report, &report.findings[0]));
        assert_eq!(found.as_deref(), expected);
    }
    let report = read_with(FULL, &["load.last.set=left"]).unwrap_err();
    assert_eq!(summary(&report, &report.findings[0]), "bad-override at last");
}

#[test]
fn findings_of_the_file_and_of_overrides_come_together() {
    let text = LEAST.replace("spacings = 3", "spacings = 0");
    let report = read_with(&text, &["steps.end=0"]).unwrap_err();
    let sources: Vec<usize> = report.findings.iter().map(|finding| finding.source).collect();
    assert_eq!(sources, [0, 1]);
}

#[test]
fn a_file_of_nothing_but_mistakes_is_cut_short() {
    let keys: String = (0..100_000).map(|i| format!("k{i}=1\n")).collect();
    assert_eq!(findings(&keys).len(), 500);
}

#[test]
fn a_huge_file_is_refused() {
    let text = format!("{LEAST}# {}", "x".repeat(MAX_SCENE_BYTES));
    assert_eq!(findings(&text)[0].split(' ').next(), Some("scene-too-large"));
}

#[test]
fn the_potential_is_found_beside_the_scene_or_in_the_library() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("law.piola"), "potential law").unwrap();
    let library = |name: &str| (name == "javili2020").then_some("potential javili2020");
    let names = ["javili2020"];
    let find = |scene: &Scene| scene.potential(scene.material(), folder.path(), &library, &names);

    let found = find(&read(LEAST)).unwrap();
    assert_eq!((found.path, found.text.as_str()), (None, "potential javili2020"));

    let scene = read(&LEAST.replace("javili2020", "law.piola"));
    let found = find(&scene).unwrap();
    assert_eq!(found.path, Some(folder.path().join("law.piola")));
    assert_eq!(found.text, "potential law");

    let text = LEAST.replace("javili2020", "javilli2020");
    let report = find(&read(&text)).unwrap_err();
    assert_eq!(summary(&report, &report.findings[0]), "unknown-potential at \"javilli2020\"");
    assert_eq!(report.findings[0].diagnostic.label, "did you mean `javili2020`?");

    let text = LEAST.replace("javili2020", "none.piola");
    let report = find(&read(&text)).unwrap_err();
    assert_eq!(summary(&report, &report.findings[0]), "unreadable-file at \"none.piola\"");

    std::fs::write(folder.path().join("law.piola"), vec![b'x'; (1 << 20) + 1]).unwrap();
    let report = find(&scene).unwrap_err();
    assert!(report.to_string().contains("bytes"), "{report}");
}

proptest::proptest! {
    /// Whatever a user types, the answer is a scene or a report whose places exist.
    #[test]
    fn no_text_panics(cut in 0..FULL.len(), noise in ".{0,12}", len in 0_usize..12) {
        let start = FULL.floor_char_boundary(cut);
        let end = FULL.floor_char_boundary((cut + len).min(FULL.len())).max(start);
        let text = format!("{}{noise}{}", &FULL[..start], &FULL[end..]);
        for report in [Scene::read(&text, "s", &[]).err(), Scene::read(FULL, "s", &[noise]).err()] {
            for finding in report.iter().flat_map(|report| &report.findings) {
                let source = &report.as_ref().unwrap().sources[finding.source].text;
                proptest::prop_assert!(source.get(finding.diagnostic.span.range()).is_some());
            }
        }
    }
}
