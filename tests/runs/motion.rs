//! Bodies that move, from outside: what a run leaves, what it refuses, what it says where it ends early.

use std::fs;

use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{SceneFolder, json_file, number, piola, table};

/// A strip of rubber that is thrown, with one side on its way.
pub(crate) const THROWN: &str = r#"
[body]
box = [[0, 0], [1, 0.5]]
spacing = 0.125
[horizon]
spacings = 2
[material]
potential = "javili2020"
density = "1 g/cm^3"
parameters = { C1 = 1e9, C2 = 0 }
[sets]
all = "X > -1"
left = "X < 0.125"
right = "X > 0.875"
[[initial]]
set = "all"
v = ["0.1*X", "-0.2*X"]
[[prescribe]]
set = "left"
v = ["0.05*min(t/0.01, 1)", 0]
[[load]]
set = "all"
acceleration = [0, -9.81]
[[load]]
set = "right"
force = ["0.1*X*t", 0]
[[probe]]
name = "tip"
at = [1.0, 0.25]
[motion]
end = 0.5
damping = 0.1
[output]
frames = 5
rows = 50
"#;

#[test]
fn a_run_leaves_its_account_its_frames_and_its_summary() {
    let folder = SceneFolder::new(THROWN);
    let outcome = folder.run(&[]).expect(0);
    assert!(outcome.stderr.contains("motion.csv"), "{}", outcome.stderr);
    let out = folder.out();
    let (header, motion) = table(&out.join("motion.csv"));
    let columns = [
        "step",
        "t",
        "kinetic",
        "kinetic_leapfrog",
        "stored",
        "psi(l)",
        "damping",
        "external",
        "prescribed",
        "quadrature",
        "rounding",
        "momentum_x",
        "momentum_y",
        "angular_momentum_z",
    ];
    assert!(columns.iter().all(|column| header.iter().any(|x| x == column)), "{header:?}");
    let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
    assert_eq!(motion.len(), 51);
    let sum = |row: &[f64]| {
        let of = |name: &str| row[column(name)];
        of("kinetic_leapfrog") + of("stored") - of("quadrature") + of("damping")
            - of("external")
            - of("prescribed")
    };
    let (start, end) = (&motion[0], &motion[50]);
    let largest = motion.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    for row in &motion {
        let left = sum(row) - sum(start);
        assert!(left.abs() <= 1e-13 * largest, "{left:e} of {largest:e}");
        assert!(row[column("rounding")].abs() <= 1e-13 * largest);
    }
    assert_eq!(end[column("t")], 0.5);
    for name in ["damping", "external", "prescribed", "quadrature"] {
        assert!(end[column(name)] != 0.0, "{name}");
    }
    let summary = folder.summary();
    assert_eq!(summary["exit_reason"], "completed");
    assert!(summary.get("solver").is_none(), "nothing was solved");
    let told = &summary["motion"];
    assert_eq!(number(&told["steps"]), end[0]);
    assert_eq!(number(&told["steps_made"]), end[0]);
    assert!((number(&told["mass"]) - 500.0).abs() < 1e-9, "{told}");
    let part = number(&told["step_seconds"]) / number(&told["critical_step_seconds"]);
    assert!(part <= 0.9 && part > 0.8, "{part}");
    assert_eq!(number(&told["energies"]["kinetic"]), end[column("kinetic")]);
    let frames = read_pvd(&fs::read_to_string(out.join("run.pvd")).unwrap()).unwrap();
    assert_eq!(frames.len(), 6);
    assert_eq!((frames[0].0, frames[5].0), (0.0, 0.5));
    let last = read_vtu(&out.join(&frames[5].1)).unwrap();
    let velocity = &last.array("velocity").unwrap().values;
    // The left column of points moves as it was told.
    assert!((velocity[0] - 0.05).abs() < 1e-15 && velocity[1] == 0.0, "{velocity:?}");
    let (_, probes) = table(&out.join("probes.csv"));
    assert_eq!((probes.len(), table(&out.join("reactions.csv")).1.len()), (51, 51));
    let begins = fs::read_to_string(out.join("scene.resolved.toml")).unwrap();
    assert!(begins.contains("[motion]") && !begins.contains("[steps]"), "{begins}");
    // The resolved scene is the same run.
    let again = SceneFolder::new(&begins);
    again.run(&["--threads", "1"]).expect(0);
    for file in ["motion.csv", "probes.csv", "reactions.csv", "displacement.csv"] {
        assert_eq!(fs::read(out.join(file)).unwrap(), fs::read(again.out().join(file)).unwrap());
    }
}

/// Steps beyond the critical one.
#[test]
fn the_midpoint_rule_takes_long_steps() {
    let folder = SceneFolder::new(THROWN);
    let long = ["--set", "motion.method=midpoint", "--set", "motion.step=\"3 ms\""];
    folder.run(&long).expect(0);
    let summary = folder.summary();
    let told = &summary["motion"];
    assert_eq!((number(&told["steps"]), told["method"].as_str()), (167.0, Some("midpoint")));
    assert!(number(&told["step_seconds"]) > 1.3 * number(&told["critical_step_seconds"]), "{told}");
    assert!(number(&told["rounding"]) < 1e-12, "{told}");
    assert!(!summary["warnings"].to_string().contains("account"), "{summary}");
    let tip = |folder: &SceneFolder| table(&folder.out().join("probes.csv")).1.last().unwrap()[2];
    let by_long = tip(&folder);
    let explicit = SceneFolder::new(THROWN);
    explicit.run(&["--threads", "2"]).expect(0);
    assert!((by_long / tip(&explicit) - 1.0).abs() < 0.04, "{by_long} {}", tip(&explicit));
    folder.run(&["--force", "--set", "motion.method=verlet", long[2], long[3]]).expect(2);
}

#[test]
fn a_free_body_falls_as_galileo_says() {
    let falls =
        THROWN.replace("[[prescribe]]\nset = \"left\"\nv = [\"0.05*min(t/0.01, 1)\", 0]\n", "");
    let falls = falls.replace("force = [\"0.1*X*t\", 0]", "force = [0, 0]");
    let falls = falls
        .replace("damping = 0.1", "damping = 0.0")
        .replace("v = [\"0.1*X\", \"-0.2*X\"]", "v = [0.5, 2.0]");
    let folder = SceneFolder::new(&falls.replace("frames = 5", "every = 0.1"));
    folder.run(&[]).expect(0);
    let frames = read_pvd(&fs::read_to_string(folder.out().join("run.pvd")).unwrap()).unwrap();
    let times: Vec<f64> = frames.iter().map(|frame| frame.0).collect();
    assert_eq!(times.len(), 6);
    // At the first rows behind the times that were asked for.
    assert!(times.iter().enumerate().all(|(k, t)| (0.0..0.02).contains(&(t - 0.1 * k as f64))));
    for row in table(&folder.out().join("probes.csv")).1 {
        let (t, u, v) = (row[0], row[1], row[2]);
        assert!((u - 0.5 * t).abs() < 1e-13, "{row:?}");
        assert!((v - (2.0 * t - 0.5 * 9.81 * t * t)).abs() < 1e-13, "{row:?}");
    }
}

#[test]
fn steps_that_are_too_long_are_refused_and_forced_end_where_a_point_flies_off() {
    let folder = SceneFolder::new(THROWN);
    folder.run(&[]).expect(0);
    let critical = number(&folder.summary()["motion"]["critical_step_seconds"]);
    let step = format!("motion.step={}", 1.05 * critical);
    let end = format!("motion.end={}", 1000.0 * critical);
    let refused = folder.run(&["--force", "--set", &step, "--set", &end]).expect(2);
    assert!(refused.stderr.contains("beyond the critical one"), "{}", refused.stderr);
    let settings = ["--force", "--set", &step, "--set", &end, "--set", "motion.unstable=true"];
    let outcome = folder.run(&settings).expect(3);
    assert!(outcome.stderr.contains("unstable"), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("flies off"), "{}", outcome.stderr);
    let summary = json_file(&folder.out().join("summary.json"));
    assert_eq!(summary["exit_reason"], "failed");
    assert!(number(&summary["motion"]["steps_made"]) < 1000.0, "rows up to there are kept");
}

#[test]
fn conditions_and_energies_that_are_not_finite_are_named() {
    let wrong = THROWN.replace("0.05*min(t/0.01, 1)", "sqrt(0.2 - t)");
    let outcome = SceneFolder::new(&wrong).run(&[]).expect(3);
    assert!(outcome.stderr.contains("velocity along X of `left`"), "{}", outcome.stderr);
    let wrong = THROWN.replace("v = [\"0.1*X\", \"-0.2*X\"]", "v = [\"1/(X - X)\", 0]");
    let outcome = SceneFolder::new(&wrong).run(&[]).expect(2);
    assert!(outcome.stderr.contains("initial velocity along X"), "{}", outcome.stderr);
}

#[test]
fn plans_and_trades_of_motions_look_for_no_equilibria() {
    let folder = SceneFolder::new(&THROWN.replace("damping", "step = 1e-4\ndamping"));
    let plan = piola(&["plan", &folder.scene()]).expect(0).stdout;
    assert!(plan.contains("run of 5000 steps") && !plan.contains("Cholesky"), "{plan}");
    let listed = piola(&["trade", &folder.scene(), "--list"]).expect(0).stdout;
    assert!(listed.contains("motion.safety=0.1") && !listed.contains("newton"), "{listed}");
}

/// A body whose every point is accelerated alike goes where Galileo says, without a force inside; one whose
/// base alone is shaken follows it.
#[test]
fn a_shaken_base_takes_the_body_along() {
    let scene = THROWN.replace("v = [\"0.05*min(t/0.01, 1)\", 0]", "a = [\"0.2*t\", 0]");
    let all = scene.replace("set = \"left\"\na", "set = \"all\"\na").replace("damping = 0.1", "");
    let all = all.replace("v = [\"0.1*X\", \"-0.2*X\"]", "v = [0.1, 0]");
    let folder = SceneFolder::new(&all);
    folder.run(&["--set", "motion.step=1e-4"]).expect(0);
    let (_, probes) = table(&folder.out().join("probes.csv"));
    let (_, motion) = table(&folder.out().join("motion.csv"));
    let (last, row) = (probes.last().unwrap(), motion.last().unwrap());
    // u = 0.1 t + 0.2 t^3/6 at t = 0.5, up to the square of the step.
    assert!((last[1] - (0.05 + 0.2 * 0.125 / 6.0)).abs() < 1e-9, "{last:?}");
    assert!(row[4].abs() < 1e-9 * row[2], "{row:?}");
    let shaken = scene.replace("v = [\"0.1*X\", \"-0.2*X\"]", "v = [0, 0]");
    let folder = SceneFolder::new(&shaken.replace("end = 0.5", "end = 3"));
    folder.run(&[]).expect(0);
    let (_, probes) = table(&folder.out().join("probes.csv"));
    let follows = probes.last().unwrap()[1] / (0.2 * 27.0 / 6.0);
    assert!((follows - 1.0).abs() < 0.01, "{follows}");
    assert!(folder.summary()["motion"]["energies"]["prescribed"].as_f64().unwrap() > 0.0);
}

/// Bonds that get stiffer when they are stretched: a step that was small enough at rest is not at the end,
/// and the run says so; frames are refused that nobody could keep.
#[test]
fn a_body_that_gets_stiffer_is_warned_of() {
    let scene = "[body]\nbox = [[0, 0], [1, 0.5]]\nspacing = 0.125\n[horizon]\nspacings = 2\n\
                 [material]\npotential = \"stiffening.piola\"\ndensity = 1000\n\
                 [sets]\nleft = \"X < 0.125\"\nright = \"X > 0.875\"\n\
                 [[prescribe]]\nset = \"left\"\nv = [0, 0]\n\
                 [[prescribe]]\nset = \"right\"\nv = [\"1e-3*SPEED\", 0]\n\
                 [motion]\nend = 1\nsafety = 0.99\n[output]\nrows = 10\n";
    let warned = |speed: &str| {
        let folder = SceneFolder::new(&scene.replace("SPEED", speed));
        let law = "potential stiffening\npsi(l) = 1/2*1e5*L*((l/L - 1)^2 + 5e5*(l/L - 1)^4)\n";
        folder.file("stiffening.piola", law);
        folder.run(&[]).expect(0).stderr.contains("stiffer")
    };
    assert!(warned("0.45") && !warned("0.001"));
    let many = scene.replace("rows = 10", "every = 1e-12").replace("SPEED", "1");
    let folder = SceneFolder::new(&many);
    folder.file("stiffening.piola", "potential p\npsi(l) = l^2");
    folder.run(&[]).expect(2).says(&["1.0e12 frames", "out-of-range"]);
    let both = scene.replace("rows = 10", "every = 0.1\nframes = 3").replace("SPEED", "1");
    let folder = SceneFolder::new(&both);
    folder.file("stiffening.piola", "potential p\npsi(l) = l^2");
    folder.run(&[]).expect(2).says(&["conflicting-keys", "both say which frames"]);
}
