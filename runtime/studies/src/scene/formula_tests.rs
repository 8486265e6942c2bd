//! Tests that evaluate the expressions of scenes: they need the compiler's formulas.

use piola_mechanics::body::Body;

use super::boundary::BoundaryConditions;
use super::selection::{Selection, kept, select};
use super::*;

/// A square of 5 x 5 points with spacing 0.25, faces included.
const SQUARE: &str = r#"[body]
box = [[0, 0], [1, 1]]
spacing = 0.25
nodes = "corners-full"
[horizon]
spacings = 2
[material]
potential = "p"
[sets]
left = "X < 0.1"
bottom = "Y < 0.1"
right = "X > 0.9"
"#;

fn read(text: &str) -> Scene {
    Scene::read(text, "scene.toml", &[]).unwrap_or_else(|report| panic!("{report}"))
}

/// The points of [`SQUARE`] in the user's order, last axis fastest.
fn square_positions() -> Vec<f64> {
    (0..25).flat_map(|p| [(p / 5) as f64 * 0.25, (p % 5) as f64 * 0.25]).collect()
}

fn square() -> Body {
    Body::new(2, &square_positions(), &[0.0625; 25], Some(0.25))
}

fn square_with(entries: &str) -> (Scene, Body, Selection) {
    let scene = read(&format!("{SQUARE}{entries}"));
    let body = square();
    let selection = select(&scene, &body).unwrap_or_else(|report| panic!("{report}"));
    (scene, body, selection)
}

fn found(text: &str, report: &SceneReport) -> Vec<String> {
    let place = |finding: &Finding| &text[finding.diagnostic.span.range()];
    report.findings.iter().map(|f| format!("{} at {}", f.diagnostic.code, place(f))).collect()
}

#[test]
fn wrong_expressions_are_reported_at_their_place() {
    let cases = [
        ("X < 0.1", "X < 0.1 + radius", "radius"),
        ("X < 0.1", "abs(X) <", ""),
        ("X < 0.1", "X + 0.1", ""),
        ("X < 0.1", "Y < 0.1 and speed < X", "speed"),
    ];
    for (from, to, name) in cases {
        let text = SQUARE.replacen(from, to, 1);
        let report = Scene::read(&text, "scene.toml", &[]).expect_err(to);
        let diagnostic = &report.findings[0].diagnostic;
        let start = text.find(to).unwrap();
        let span = diagnostic.span.range();
        assert!(start <= span.start && span.end <= start + to.len(), "{to}: {span:?}");
        assert!(name.is_empty() || &text[span] == name, "{to}");
    }
}

#[test]
fn wrong_expressions_in_other_strings_are_reported_near() {
    for (string, place) in [
        ("'X < speed'", "speed"),
        ("\"\"\"\nX < speed\"\"\"", "speed"),
        ("\"X \\u003C speed\"", "X \\u003C speed"),
    ] {
        let text = SQUARE.replacen("\"X < 0.1\"", string, 1);
        let report = Scene::read(&text, "scene.toml", &[]).expect_err(string);
        assert_eq!(&text[report.findings[0].diagnostic.span.range()], place, "{string}");
    }
}

#[test]
fn wrong_expressions_in_overrides_are_reported_there() {
    let overrides = ["sets.left=X < speed".to_string()];
    let report = Scene::read(SQUARE, "scene.toml", &overrides).unwrap_err();
    let finding = &report.findings[0];
    let place = &report.sources[finding.source].text[finding.diagnostic.span.range()];
    assert_eq!((finding.source, place), (1, "speed"));
}

#[test]
fn sets_hold_the_points_where_their_condition_is_true() {
    let (_, body, selection) = square_with("corner = \"X < 0.1 and Y < 0.1\"\n");
    let at = |name: &str| &selection.sets.iter().find(|set| set.name == name).unwrap().points;
    for set in &selection.sets {
        assert!(set.points.windows(2).all(|pair| pair[0] < pair[1]), "{} is sorted", set.name);
        assert!((set.volume - 0.0625 * set.points.len() as f64).abs() < 1e-15);
    }
    assert_eq!((at("left").len(), at("bottom").len(), at("corner").len()), (5, 5, 1));
    assert_eq!(body.position(at("corner")[0]), [0.0, 0.0]);
    assert!(at("right").iter().all(|&point| body.position(point)[0] == 1.0));
    assert_eq!(selection.warnings, []);
}

#[test]
fn sets_of_a_body_that_is_sorted_by_another_axis_are_the_same_points() {
    let text = SQUARE.replace("[1, 1]", "[1, 2]").replace("right = \"X > 0.9\"\n", "");
    let positions: Vec<f64> =
        (0..45).flat_map(|p| [(p / 9) as f64 * 0.25, (p % 9) as f64 * 0.25]).collect();
    let body = Body::new(2, &positions, &[0.0625; 45], Some(0.25));
    assert_eq!(body.sorted_axis(), 1);
    let selection = select(&read(&text), &body).unwrap();
    let mut left: Vec<u32> =
        selection.sets[0].points.iter().map(|&point| body.user_index()[point]).collect();
    left.sort_unstable();
    assert_eq!(left, (0..9).collect::<Vec<u32>>());
}

#[test]
fn empty_sets_are_errors_that_say_where_the_points_are() {
    let text = SQUARE.replace("X > 0.9", "X > 1.5").replace("Y < 0.1", "Y < -1");
    let report = select(&read(&text), &square()).unwrap_err();
    assert_eq!(found(&text, &report), ["empty-set at Y < -1", "empty-set at X > 1.5"]);
    let diagnostic = &report.findings[1].diagnostic;
    assert_eq!(diagnostic.message, "the set `right` has no points");
    assert_eq!(diagnostic.helps, ["the points have X from 0 to 1, Y from 0 to 1"]);
}

#[test]
fn boundaries_on_points_are_warned_of() {
    for (condition, count) in [
        ("X <= 0.25", 5),
        ("X < 0.25 + 1e-8", 5),
        ("X < 0.25 - 1e-8", 5),
        ("max(X, Y) <= 0.5", 5),
        ("X*X + Y*Y <= 0.0625", 2),
        ("X < 0.25 + 1e-5", 0),
        ("X < 0.375", 0),
        ("X < 0.1 and Y > -1", 0),
    ] {
        let text = SQUARE.replace("X < 0.1", condition);
        let selection = select(&read(&text), &square()).unwrap();
        match &selection.warnings[..] {
            [] => assert_eq!(count, 0, "{condition}"),
            [warning] => {
                assert_eq!(&text[warning.span.range()], condition);
                assert_eq!(warning.code, "boundary-on-points");
                assert!(warning.message.contains("`left`"), "{}", warning.message);
                let label = format!("{count} points are within 1e-6 spacings of it");
                assert!(warning.label.starts_with(&label), "{condition}: {}", warning.label);
                assert!(warning.helps[0].contains("half a spacing, 0.125"), "{:?}", warning.helps);
            }
            more => panic!("{condition}: {more:?}"),
        }
    }
}

#[test]
fn a_boundary_warning_names_a_point_and_the_axis() {
    let text = SQUARE.replace("Y < 0.1", "Y < 0.75");
    let selection = select(&read(&text), &square()).unwrap();
    let warning = &selection.warnings[0];
    assert!(warning.label.ends_with("for example (0, 0.75)"), "{}", warning.label);
    assert_eq!(warning.helps, ["move the limit along Y by half a spacing, 0.125"]);
}

#[test]
fn removed_points_are_those_of_any_condition() {
    let text = SQUARE.replace(
        "spacing = 0.25",
        "spacing = 0.25\nremove = [\"X > 0.9\", \"max(abs(X-0.5), abs(Y-0.5)) < 0.3\", \"X > 3\"]",
    );
    let scene = read(&text);
    let result = kept(&scene, &square_positions(), &[0.0625; 25], Some(0.25)).unwrap();
    // 5 points of the right face and the 3 x 3 around the centre go.
    assert_eq!(result.keep.iter().filter(|keep| **keep).count(), 25 - 5 - 9);
    assert!(result.keep[0] && !result.keep[12] && !result.keep[20]);
    let codes: Vec<&str> = result.warnings.iter().map(|warning| warning.code).collect();
    assert_eq!(codes, ["idle-entry"]);
    assert_eq!(&text[result.warnings[0].span.range()], "X > 3");
}

#[test]
fn removals_through_points_are_warned_of_and_nothing_left_is_an_error() {
    let with = |condition: &str| {
        let replacement = format!("spacing = 0.25\nremove = [\"{condition}\"]");
        let scene = read(&SQUARE.replace("spacing = 0.25", &replacement));
        kept(&scene, &square_positions(), &[0.0625; 25], Some(0.25))
    };
    let warnings = with("max(abs(X-0.5), abs(Y-0.5)) < 0.25 - 1e-9").unwrap().warnings;
    assert!(warnings[0].label.starts_with("8 points"), "{}", warnings[0].label);
    let report = with("X > -1").unwrap_err();
    assert_eq!(report.findings[0].diagnostic.code, "nothing-left");
}

#[test]
fn fixed_components_are_sorted_and_follow_their_expressions() {
    let (scene, body, selection) = square_with(
        "[[prescribe]]\nset = \"right\"\nu = [\"0.1*t + Y\", \"free\"]\n\
         [[prescribe]]\nset = \"left\"\nu = [0, -0.5]\n",
    );
    let conditions = BoundaryConditions::new(&scene, &body, &selection).unwrap();
    let dofs = conditions.fixed_dofs();
    assert_eq!(dofs.len(), 5 + 2 * 5);
    assert!(dofs.windows(2).all(|pair| pair[0] < pair[1]));
    for t in [0.0, 0.7] {
        let values = conditions.prescribed(t).unwrap();
        assert_eq!(values.len(), dofs.len());
        for (dof, value) in dofs.iter().zip(values) {
            let (position, axis) = (body.position(dof / 2), dof % 2);
            let expected = match (position[0] == 0.0, axis) {
                (true, 0) => 0.0,
                (true, _) => -0.5,
                _ => 0.1 * t + position[1],
            };
            assert!((value - expected).abs() < 1e-15, "{position:?} {axis}: {value}");
        }
    }
    assert_eq!(conditions.warnings, []);
}

#[test]
fn components_prescribed_twice_name_both_entries_and_a_point() {
    let entries = "[[prescribe]]\nset = \"left\"\nu = [0, 0]\n\
                   [[prescribe]]\nset = \"bottom\"\nu = [\"free\", \"1*t\"]\n";
    let (scene, body, selection) = square_with(entries);
    let report = BoundaryConditions::new(&scene, &body, &selection).unwrap_err();
    let text = format!("{SQUARE}{entries}");
    assert_eq!(found(&text, &report), ["prescribed-twice at \"1*t\""]);
    let diagnostic = &report.findings[0].diagnostic;
    let message = "the Y component of 1 point is prescribed twice, by `left` and by `bottom`";
    assert_eq!(diagnostic.message, message);
    assert!(diagnostic.label.contains("(0, 0)"), "{}", diagnostic.label);
    assert_eq!(text[diagnostic.notes[0].span.range()], text[text.find("0]\n[[").unwrap()..][..1]);
}

#[test]
fn sets_may_share_points_whose_components_differ() {
    let (scene, body, selection) = square_with(
        "[[prescribe]]\nset = \"left\"\nu = [0, \"free\"]\n\
         [[prescribe]]\nset = \"bottom\"\nu = [\"free\", 0]\n",
    );
    let conditions = BoundaryConditions::new(&scene, &body, &selection).unwrap();
    assert_eq!(conditions.fixed_dofs().len(), 10);
}

#[test]
fn forces_are_shared_by_volume_and_densities_act_on_volumes() {
    let entries = "[[load]]\nset = \"right\"\nforce = [\"2*t\", 0]\n\
                   [[load]]\nset = \"right\"\ndensity = [0, \"-9*Y\"]\n";
    let scene = read(&format!("{SQUARE}{entries}"));
    let positions = square_positions();
    let volumes: Vec<f64> = (0..25).map(|p| 0.01 * (1 + p) as f64).collect();
    let body = Body::new(2, &positions, &volumes, Some(0.25));
    let selection = select(&scene, &body).unwrap();
    let conditions = BoundaryConditions::new(&scene, &body, &selection).unwrap();
    let forces = body.to_user_order(&conditions.loads(0.5).unwrap(), 2);
    let right: f64 = volumes[20..].iter().sum();
    for p in 0..25 {
        let on_right = if p >= 20 { 1.0 } else { 0.0 };
        let expected =
            [on_right * volumes[p] / right, on_right * -9.0 * positions[2 * p + 1] * volumes[p]];
        for axis in 0..2 {
            assert!((forces[2 * p + axis] - expected[axis]).abs() < 1e-15, "point {p}");
        }
    }
    let total: f64 = forces.iter().step_by(2).sum();
    assert!((total - 1.0).abs() < 1e-14, "{total}");
}

#[test]
fn loads_on_prescribed_components_are_warned_of() {
    let entries = "[[prescribe]]\nset = \"left\"\nu = [0, \"free\"]\n\
                   [[load]]\nset = \"bottom\"\nforce = [\"1*t\", 1]\n\
                   [[load]]\nset = \"left\"\nforce = [0, 1]\n\
                   [[load]]\nset = \"left\"\ndensity = [2, 1]\n";
    let (scene, body, selection) = square_with(entries);
    let conditions = BoundaryConditions::new(&scene, &body, &selection).unwrap();
    let messages: Vec<&str> =
        conditions.warnings.iter().map(|warning| warning.message.as_str()).collect();
    let expected = [
        "the load along X acts on 1 point of `bottom` whose X component is prescribed",
        "the load along X acts on all points of `left` whose X component is prescribed",
    ];
    assert_eq!(messages, expected);
}

#[test]
fn non_finite_conditions_name_the_point_and_the_expression() {
    let (scene, body, selection) = square_with(
        "[[prescribe]]\nset = \"right\"\nu = [\"t/(Y - 0.5)\", \"free\"]\n\
         [[load]]\nset = \"left\"\nforce = [0, \"sqrt(0.4 - t)\"]\n",
    );
    let conditions = BoundaryConditions::new(&scene, &body, &selection).unwrap();
    let error = conditions.prescribed(1.0).unwrap_err();
    assert_eq!((error.quantity, error.axis, error.set.as_str()), ("displacement", 0, "right"));
    assert_eq!((error.point, &error.position[..], error.t), (22, &[1.0, 0.5][..], 1.0));
    assert_eq!(error.value, f64::INFINITY);
    assert_eq!(
        error.to_string(),
        "the displacement along X of `right` is inf at point 22 (1, 0.5) and t = 1: t/(Y - 0.5)"
    );
    assert!(conditions.loads(0.3).is_ok());
    let error = conditions.loads(0.5).unwrap_err();
    assert_eq!((error.quantity, error.axis), ("force", 1));
    assert!(error.value.is_nan());
}

#[test]
fn probes_sit_at_the_nearest_point() {
    let (_, body, selection) = square_with(
        "[[probe]]\nname = \"tip\"\nat = [1.0, 0.45]\n\
         [[probe]]\nname = \"middle\"\nat = [0.125, 0.5]\n\
         [[probe]]\nname = \"beside\"\nat = [1.25, 0.5]\n",
    );
    let at: Vec<&[f64]> = selection.probes.iter().map(|probe| body.position(probe.point)).collect();
    assert_eq!(at, [[1.0, 0.5], [0.0, 0.5], [1.0, 0.5]]);
    assert!((selection.probes[0].distance - 0.05).abs() < 1e-15);
}

#[test]
fn probes_outside_the_body_are_errors() {
    let text = format!("{SQUARE}[[probe]]\nname = \"tip\"\nat = [1.3, 0.5]\n");
    let report = select(&read(&text), &square()).unwrap_err();
    assert_eq!(found(&text, &report), ["probe-outside at [1.3, 0.5]"]);
    assert_eq!(report.findings[0].diagnostic.helps, ["the nearest point is (1, 0.5), 0.3 m away"]);
}

#[test]
fn probes_in_a_cloud_may_be_a_horizon_away() {
    let text = "[body]\ndimension = 2\npoints = \"c.csv\"\n[horizon]\nradius = 0.5\n\
                [material]\npotential = \"p\"\n[[probe]]\nname = \"tip\"\nat = [1.4, 0]\n";
    let body = Body::new(2, &[0.0, 0.0, 1.0, 0.0], &[1.0, 1.0], None);
    assert_eq!(select(&read(text), &body).unwrap().probes[0].point, 1);
    let report = select(&read(&text.replace("1.4", "1.6")), &body).unwrap_err();
    assert_eq!(report.findings[0].diagnostic.code, "probe-outside");
}
