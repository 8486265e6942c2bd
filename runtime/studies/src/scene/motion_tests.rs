//! Scenes of bodies that move: what is read, what is refused, and the way back to text.

use piola_solvers::motion::Method;

use super::*;

/// Every key of a motion.
const FULL: &str = r#"[body]
box = [[0.0, 0.0], [1.0, 1.0]]
spacing = 0.05
[horizon]
spacings = 3
[material]
potential = "law.piola"
density = "7.8 g/cm^3"
[sets]
left = "X < 0.1"
right = "X > 0.9"
[[initial]]
set = "left"
u = ["0.01*X", 0]
v = [0, "-32*X"]
[[prescribe]]
set = "left"
v = ["0.05*min(t/1e-5, 1)", "free"]
[[load]]
set = "right"
acceleration = [0, -9.81]
[[track]]
name = "tip"
axis = "-Y"
threshold = 0.4
set = "right"
thickness = 2
[motion]
method = "leap-frog"
end = 6e-5
step = 1e-8
safety = 0.8
damping = 12.5
unstable = true
[output]
every = 1e-6
rows = 300
colour = "state k"
fields = ["states", "damage_a", "damage_v"]
"#;

fn read(text: &str) -> Scene {
    Scene::read(text, "scene.toml", &[]).unwrap_or_else(|report| panic!("{report}"))
}

#[test]
fn every_key_of_a_motion_is_read_and_written() {
    let scene = read(FULL);
    let motion = Motion {
        method: Method::LeapFrog,
        end: 6e-5,
        step: Some(1e-8),
        safety: 0.8,
        damping: 12.5,
        unstable: true,
        ..Motion::default()
    };
    assert_eq!(scene.motion, Some(motion));
    assert!((scene.material().density.unwrap().value - 7800.0).abs() < 1e-9);
    let [initial] = &scene.initial[..] else { panic!("one") };
    let [u, v] = [&initial.displacements, &initial.velocities].map(|x| x.as_ref().unwrap());
    assert_eq!((u.value[1].is_zero(), v.value[1].value(&[2.0, 0.0], 0.0)), (true, -64.0));
    assert_eq!(scene.prescriptions[0].given, Given::Velocity);
    assert_eq!(scene.loads[0].kind, LoadKind::Acceleration);
    let fields = vec![FrameField::States, FrameField::DamageOfAreas, FrameField::DamageOfVolumes];
    let colour = ColourBy::State("k".to_owned());
    let every = Some(1e-6);
    let expected = OutputSettings { every, rows: 300, fields, colour, ..OutputSettings::default() };
    assert_eq!(scene.output, expected);
    let [track] = &scene.tracks[..] else { panic!("one") };
    assert_eq!((track.axis, track.threshold), (TrackAxis::MinusY, 0.4));
    assert_eq!((track.set.unwrap().value, track.thickness), (1, Some(2.0)));
    let again = read(&scene.resolved_toml());
    assert_eq!(again, scene, "{}", scene.resolved_toml());
    let shaken = read(&FULL.replace("v = [\"0.05", "a = [\"0.05"));
    assert_eq!(shaken.prescriptions[0].given, Given::Acceleration);
    assert_eq!(read(&shaken.resolved_toml()), shaken);
    let automatic = read(&FULL.replace("step = 1e-8", "step = \"auto\""));
    assert_eq!(automatic.motion.as_ref().unwrap().step, None);
    assert_eq!(read(&automatic.resolved_toml()), automatic);
}

/// Without the quote that a string begins with.
fn bare(text: &str) -> &str {
    text.trim_start_matches('"')
}

#[test]
fn times_may_have_units() {
    let text = FULL.replace("end = 6e-5", "end = \"60 us\"");
    let text = text
        .replace("step = 1e-8", "step = \"10 ns\"")
        .replace("rows = 300", "checkpoint = \"1 ks\"");
    let scene = read(&text);
    let motion = scene.motion.as_ref().unwrap();
    assert!((motion.end - 6e-5).abs() < 1e-19 && (motion.step.unwrap() - 1e-8).abs() < 1e-22);
    assert_eq!(scene.output.checkpoint, 1000.0);
    assert_eq!(read(&scene.resolved_toml()), scene);
}

#[test]
fn what_does_not_fit_a_motion_is_refused_where_it_stands() {
    for (old, new, code, place) in [
        ("density = \"7.8 g/cm^3\"\n", "", "missing-key", "law.piola"),
        ("7.8 g/cm^3", "7.8 g/cm^2", "dimension-mismatch", "7.8 g/cm^2"),
        ("7.8 g/cm^3", "heavy", "not-a-number", "heavy"),
        ("\"7.8 g/cm^3\"", "0.0", "out-of-range", "0.0"),
        ("[0, \"-32*X\"]", "[0, \"-32*t\"]", "time-in-condition", "t"),
        ("u = [\"0.01*X\", 0]\nv = [0, \"-32*X\"]", "", "missing-key", "[[initial]]"),
        ("end = 6e-5\n", "", "missing-key", "[motion]"),
        ("end = 6e-5", "end = -1.0", "out-of-range", "-1.0"),
        ("damping = 12.5", "damping = -1.0", "out-of-range", "-1.0"),
        ("unstable = true", "unstable = \"yes\"", "wrong-type", "\"yes\""),
        ("step = 1e-8", "step = \"short\"", "not-a-number", "short"),
        ("step = 1e-8", "step = \"1 mm\"", "dimension-mismatch", "1 mm"),
        ("step = 1e-8", "step = \"0 s\"", "out-of-range", "\"0 s\""),
        ("leap-frog", "euler", "unknown-choice", "\"euler\""),
        ("[output]", "[steps]\nend = 1.0\n[output]", "conflicting-keys", "steps"),
        ("[output]", "[fracture]\nloose = \"stop\"\n[output]", "conflicting-keys", "loose"),
        ("v = [\"0.05", "u = [0, 0]\nv = [\"0.05", "conflicting-keys", "v"),
        ("v = [\"0.05", "a = [0, 0]\nv = [\"0.05", "conflicting-keys", "v"),
        (
            "acceleration = [0",
            "force = [0, 0]\nacceleration = [0",
            "conflicting-keys",
            "acceleration",
        ),
    ] {
        assert_eq!(FULL.matches(old).count(), 1, "{old}");
        let text = FULL.replace(old, new);
        let report = Scene::read(&text, "scene.toml", &[]).unwrap_err();
        let found = report.findings.iter().map(|finding| &finding.diagnostic);
        let found: Vec<_> = found.map(|d| (d.code, &text[d.span.range()])).collect();
        assert!(
            found.iter().any(|(c, p)| *c == code && bare(p).starts_with(bare(place))),
            "{new}: {found:?}"
        );
    }
}

#[test]
fn only_bodies_that_move_have_velocities() {
    let still = FULL.split("[motion]").next().unwrap();
    let report = Scene::read(still, "scene.toml", &[]).unwrap_err();
    let messages: Vec<&str> =
        report.findings.iter().map(|finding| finding.diagnostic.message.as_str()).collect();
    assert_eq!(messages.len(), 3, "{messages:?}");
    assert!(messages.iter().all(|message| message.contains("the scene has no [motion]")));
    let rows = "[steps]\nend = 1.0\n[output]\nrows = 10\n";
    let start = &FULL[..FULL.find("[[initial]]").unwrap()];
    let report = Scene::read(&format!("{start}{rows}"), "scene.toml", &[]).unwrap_err();
    assert_eq!(report.findings.len(), 1);
}
