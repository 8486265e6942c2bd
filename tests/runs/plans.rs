//! What is wrong is said before it costs: `plan`, `check` of scenes, and what runs refuse.

use std::time::Instant;

use crate::scenes::{STRIP, strip, strip_with};
use crate::support::{SceneFolder, number, piola};

/// A cube of 1 m^3 with bonds alone.
fn cube(spacing: f64) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [1, 1, 1]]\nspacing = {spacing}\nnodes = \"cells\"\n\
         [horizon]\nspacings = 3\n[material]\npotential = \"javili2020\"\nparameters = {{ C1 = 1.0 }}\n\
         [sets]\nleft = \"X < 0.1\"\n[[prescribe]]\nset = \"left\"\nu = [0, 0, 0]\n"
    ))
}

/// Points that nobody should make, let alone search: seconds are ample, minutes are not.
const PATIENCE: u64 = 60;

#[test]
fn a_mistyped_spacing_is_refused_before_a_point_is_made() {
    let folder = cube(0.002);
    let begin = Instant::now();
    let plan = piola(&["plan", &folder.scene(), "--format", "json"]).expect(0);
    plan.says(&["this needs about", "refuse"]);
    folder.run(&[]).expect(2).says(&["this needs about", "are available", "--yes"]);
    assert!(!folder.out().exists());
    assert!(begin.elapsed().as_secs() < PATIENCE, "{:?}", begin.elapsed());
}

/// A box that is not filled is counted as one that is.
#[test]
fn a_box_is_counted_without_its_points() {
    let folder = cube(0.005);
    let begin = Instant::now();
    let plan = piola(&["plan", &folder.scene(), "--format", "json"]).expect(0).json();
    assert!(begin.elapsed().as_secs() < PATIENCE, "{:?}", begin.elapsed());
    assert_eq!(number(&plan["points"]), 8e6);
    // Differences of length up to 3 in the lattice: six faces and so on, each as often as it fits.
    let fits = |step: [f64; 3]| step.iter().map(|s| 200.0 - s).product::<f64>();
    let kinds: [([f64; 3], f64); 9] = [
        ([0.0, 0.0, 1.0], 6.0),
        ([0.0, 1.0, 1.0], 12.0),
        ([1.0, 1.0, 1.0], 8.0),
        ([0.0, 0.0, 2.0], 6.0),
        ([0.0, 1.0, 2.0], 24.0),
        ([1.0, 1.0, 2.0], 24.0),
        ([0.0, 2.0, 2.0], 12.0),
        ([1.0, 2.0, 2.0], 24.0),
        ([0.0, 0.0, 3.0], 6.0),
    ];
    let bonds: f64 = kinds.iter().map(|(step, times)| times * fits(*step) / 2.0).sum();
    assert_eq!(number(&plan["interactions"]["bonds"]), bonds);
    assert!(plan["notes"][0].as_str().unwrap().contains("too many points"), "{}", plan["notes"]);
}

#[test]
fn extents_that_no_number_holds_are_refused_where_they_are_read() {
    let cloud = SceneFolder::new(
        "[body]\ndimension = 2\npoints = \"p.csv\"\n[horizon]\nradius = 1.5\n\
         [material]\npotential = \"javili2020\"\nparameters = { C1 = 2.0 }\n",
    );
    cloud.file("p.csv", "x,y,volume\n0,0,1\n1,0,1\n1.7e308,0,1\n-1.7e308,0,1\n");
    let whole = "box = [[0.0, 0.0], [1.0, 0.4]]\nspacing = 0.1";
    let lattice = strip_with(whole, "box = [[-1.7e308, 0.0], [1.7e308, 1e307]]\nspacing = 1e307");
    for folder in [cloud, lattice] {
        for command in ["plan", "energy"] {
            piola(&[command, &folder.scene()]).expect(2).says(&["e308"]);
        }
        folder.run(&[]).expect(2);
    }
}

/// The strip with an energy of its own.
fn strip_of(energy: &str) -> SceneFolder {
    let old = "potential = \"javili2020\"\nparameters = { C1 = 1.0, C2 = 5.0 }";
    let folder = strip_with(old, "potential = \"own.piola\"");
    folder.file("own.piola", format!("potential own\nparameter C = 1\n{energy}\n"));
    folder
}

#[test]
fn energies_that_move_or_give_way_at_rest_are_refused_at_the_values_of_the_scene() {
    // Fine with the default of C, and not with the scene's.
    let cases = [
        ("psi(l) = (l/L - C)^2", "not-stress-free", "material.parameters.C=0.9"),
        ("psi(l) = C*(l/L - 1)^2", "not-stiff-at-rest", "material.parameters.C=-1"),
        (
            "psi(l) = C*(l/L - 1)^2\npsi(a) = (a/A - 1)^2",
            "no-bond-energy",
            "material.parameters.C=0",
        ),
    ];
    for (energy, code, setting) in cases {
        let folder = strip_of(energy);
        piola(&["plan", &folder.scene()]).expect(0);
        let allowed = format!("allow \"{code}\" \"as it is meant\"\n{energy}");
        let lenient = strip_of(&allowed);
        for command in ["plan", "energy"] {
            let outcome = piola(&[command, &folder.scene(), "--set", setting]).expect(2);
            outcome.says(&[&format!("error[{code}]"), "own.piola:", &format!("allow \"{code}\"")]);
            piola(&[command, &lenient.scene(), "--set", setting]).expect(0);
        }
        folder.run(&["--set", setting]).expect(2).says(&[code]);
        assert!(!folder.out().exists());
    }
    // Energies of F, and of gathered values.
    let cases = [
        ("psi(F) = C*tr(F' * F) + 1/2*(det(F) - 1)^2", "not-stress-free"),
        ("psi(F) = -C*(E : E)", "not-stiff-at-rest"),
        ("theta = integral(l - L)\npsi(theta) = C*theta^2", "not-stiff-at-rest"),
    ];
    for (energy, code) in cases {
        let folder = strip_of(energy);
        let plan = piola(&["plan", &folder.scene()]).expect(2);
        plan.says(&[&format!("error[{code}]"), "own.piola:"]);
        let allowed = strip_of(&format!("allow \"{code}\" \"as it is meant\"\n{energy}"));
        piola(&["plan", &allowed.scene()]).expect(0);
    }
    // Negative coefficients of triangles lower Poisson's ratio, and bonds outweigh them.
    let lower = strip_of("psi(l) = C*(l/L - 1)^2\npsi(a) = -0.001*C*(a/A - 1)^2");
    piola(&["plan", &lower.scene()]).expect(0);
}

#[test]
fn an_end_state_that_is_not_stable_is_a_failure_unless_the_scene_accepts_it() {
    let folder = strip_with("u = [\"0.2*t\", 0]", "u = [\"-1.5*t\", 0]");
    let failed = folder.run(&["--set", "steps.increments=1"]).expect(1);
    failed.says(&["the end state is not stable", "unstable = \"accept\""]);
    assert_eq!(folder.summary()["exit_reason"], "completed");
    assert!(folder.out().join("picture.png").exists());
    let accepting =
        ["--force", "--set", "steps.increments=1", "--set", "solver.unstable=\"accept\""];
    folder.run(&accepting).expect(0).says(&["not stable"]);
}

#[test]
fn scenes_can_be_checked() {
    let folder = strip();
    piola(&["check", &folder.scene()]).expect(0).says(&["55 points"]);
    let free = SceneFolder::new(
        &STRIP
            .replace("u = [0, 0]", "u = [\"free\", 0]")
            .replace("u = [\"0.2*t\", 0]", "u = [\"free\", 0]"),
    );
    piola(&["plan", &free.scene()]).expect(2).says(&["free to move"]);
    piola(&["check", &free.scene()]).expect(1).says(&["free to move"]);
    let wrong = strip_with("spacings = 2", "spacings = -2");
    let outcome = piola(&["check", "--format", "json", &wrong.scene()]).expect(1);
    let finding: serde_json::Value = serde_json::from_str(outcome.stdout.trim()).unwrap();
    assert_eq!(finding["line"], 8, "{finding}");
}

#[test]
fn commands_say_what_they_got() {
    let folder = strip();
    let scene = folder.scene();
    piola(&["run", "firooz2023", "-o", "/nonexistent/out"]).expect(2).says(&["is a potential"]);
    let file = folder.file("law.piola", "potential law\npsi(l) = (l/L - 1)^2\n");
    piola(&["plan", &file]).expect(2).says(&["is a potential", "[material]"]);
    piola(&["derive", &scene]).expect(2).says(&["is a scene"]);
    piola(&["run", &scene]).expect(2).says(&["-o out/"]);
}

#[test]
fn counts_and_bounds_of_the_command_line_are_limited() {
    let wrong: [&[&str]; 8] = [
        &["audit", "javili2020", "--points", "0"],
        &["audit", "javili2020", "--points", "18446744073709551615"],
        &["audit", "javili2020", "--bar", "nan"],
        &["audit", "javili2020", "--bar", "0"],
        &["verify", "javili2020", "--points", "100000000000"],
        &["bench", "--threads", "0"],
        &["plan", "x.toml", "--threads", "1000000"],
        &["run", "x.toml", "--threads", "-1"],
    ];
    for arguments in wrong {
        let outcome = piola(arguments).expect(2);
        let told = outcome.stderr.contains("from 1 to") || outcome.stderr.contains("positive");
        assert!(told || arguments.contains(&"-1"), "{arguments:?}: {}", outcome.stderr);
    }
}

#[test]
fn messages_are_short_and_no_text_commands_the_terminal() {
    let folder = strip();
    let long = "x".repeat(5000);
    let file = folder.file("long.piola", format!("potential long\npsi(l) = {long}*(l/L - 1)^2\n"));
    let outcome = piola(&["check", &file]).expect(1);
    let first = outcome.stderr.lines().next().unwrap();
    assert!(first.starts_with("error") && first.contains("xx..xx") && first.len() < 200, "{first}");
    let title = "potential sly \"\u{1b}[2J gone\"\n# \u{1b}]0;title\u{7}\npsi(l) = (l/L - 1)^2\n";
    let file = folder.file("sly.piola", title);
    let outcome = piola(&["info", &file]);
    assert!(
        !outcome.stdout.contains('\u{1b}') && !outcome.stderr.contains('\u{1b}'),
        "{outcome:?}"
    );
    assert!(outcome.code == 0 || outcome.stderr.contains("error"), "{outcome:?}");
}

/// Triangles of a lattice with an affine law go along its rows, with tables; at the strict level and where batches are
/// asked for nothing does, and bonds alone have none.
#[test]
fn a_plan_knows_what_goes_along_rows() {
    let [both, bonds] = ["cube_C1_C2", "cube_C1"];
    for (scene, setting, has_tables) in [
        (both, "solver.level=fast", true),
        (both, "solver.level=strict", false),
        (both, "solver.passes=batches", false),
        (bonds, "solver.level=fast", false),
    ] {
        let scene = format!("examples/{scene}/scene.toml");
        let arguments = ["plan", &scene, "--format", "json", "--set", setting];
        let plan = piola(&arguments).expect(0).json();
        let items = plan["memory"].as_array().unwrap();
        let is_there = items.iter().any(|item| item["item"] == "tables of cliques");
        assert_eq!(is_there, has_tables, "{plan}");
    }
}

/// What a plan counts in the first increment is what the run then does.
#[test]
fn a_plan_counts_line_searches_and_cut_backs() {
    let free = ["--set", "solver.linear=matrix-free"];
    let few = ["--set", "steps.increments=1", "--set", "solver.max_iterations=2"];
    for settings in [&[][..], &free, &few] {
        let folder = strip();
        let plan = piola(&[&["plan", &folder.scene(), "--format", "json"], settings].concat());
        let plan = plan.expect(0).json();
        let first = &plan["first"];
        let told = folder.run(settings).expect(0).stderr;
        let steps = folder.summary()["steps"].clone();
        let step = &steps[0];
        let (before, _) = told.split_once("residual/reaction").unwrap();
        let cut_backs = before.matches("half the increment is tried").count();
        assert_eq!(first["cut_backs"], cut_backs, "{first} {told}");
        let increments = if settings == few { 1.0 } else { 4.0 };
        assert_eq!(number(&first["solved"]), number(&step["t"]) * increments, "{first} {step}");
        if settings == few {
            assert!(number(&first["cut_backs"]) > 0.0 && number(&first["solved"]) < 1.0, "{first}");
        } else {
            assert_eq!(first["iterations"], step["iterations"], "{first} {step}");
        }
        let products = number(&first["products"]);
        assert_eq!(products > 0.0, settings == free, "{first}");
        let time = &plan["time"];
        assert_eq!(time["basis"], "increment");
        let whole = ["assembly", "linear", "line_search"].map(|part| number(&first[part]));
        let increment = whole.iter().sum::<f64>() / number(&first["solved"]);
        assert!((number(&time["increment"]) / increment - 1.0).abs() < 1e-12, "{plan}");
        let total = number(&time["setup"]) + increments * increment;
        assert!((number(&time["total"]) / total - 1.0).abs() < 1e-12, "{plan}");
    }
}

/// A sheet whose energy at the points does not see what alternates: products take long, until bonds beside
/// it do.
fn sheet(discretisation: &str) -> SceneFolder {
    let scene = STRIP
        .replace("spacing = 0.1\nnodes = \"corners-full\"", "spacing = 0.04")
        .replace("javili2020", "neo_hooke")
        .replace("C1 = 1.0, C2 = 5.0", "lambda = \"2 MPa\", mu = \"1 MPa\"");
    SceneFolder::new(&format!(
        "{scene}[correspondence]\ndiscretisation = \"{discretisation}\"\n\
         [[material.plus]]\npotential = \"javili2020\"\nparameters = {{ C1 = 1e7 }}\n"
    ))
}

/// A plan sees that the run goes over to a stored tangent, and why.
#[test]
fn a_plan_tells_of_the_stored_tangent_that_takes_over() {
    for (discretisation, goes_over) in [("nodal", true), ("bond-quadrature", false)] {
        let folder = sheet(discretisation);
        let plan = piola(&["plan", &folder.scene(), "--format", "json"]).expect(0).json();
        folder.run(&[]).expect(0);
        let solver = &folder.summary()["solver"];
        assert_eq!(solver["linear"] == "Cholesky", goes_over, "{solver}");
        assert_eq!(plan["linear"], "matrix-free");
        let (stored, first) = (&plan["stored"], &plan["first"]);
        assert!(number(&stored["products"]) >= 30.0, "{stored}");
        assert_eq!(first["stored"].is_object(), goes_over, "{first}");
        assert_eq!(plan["memory"] == stored["memory"], goes_over, "{plan}");
        let text = piola(&["plan", &folder.scene()]).expect(0).stdout;
        assert_eq!(text.contains("then by Cholesky"), goes_over, "{text}");
        assert_eq!(text.contains("where one takes over"), !goes_over, "{text}");
        if goes_over {
            assert_eq!(first["stored"]["reason"], solver["linear_reason"]);
            let before = number(&first["stored"]["seconds"]);
            assert!(number(&plan["time"]["setup"]) > before && before > 0.0, "{plan}");
        }
    }
}

#[test]
fn a_plan_says_that_the_first_increment_fails() {
    // A single iteration is too few for any increment whose clamp jumps.
    let folder = strip();
    let settings = ["steps.increments=1", "solver.max_iterations=1", "solver.start=last"];
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
    let plan = piola(&[&["plan", &folder.scene()][..], &settings].concat()).expect(0);
    assert!(plan.stdout.contains("the first increment fails after"), "{}", plan.stdout);
    plan.says(&["the first increment fails: no equilibrium at t = ", "no convergence in 1 iter"]);
    folder.run(&settings).expect(3);
}

/// What each of many processes takes is said without a point, and without a word about this machine.
#[test]
fn a_plan_for_many_ranks_is_of_the_largest() {
    let folder = cube(0.002);
    let of = |ranks: &str, format: &str| {
        let words = ["plan", &folder.scene(), "--ranks", ranks, "--format", format];
        piola(&words).expect(0)
    };
    let plan = of("50", "json");
    assert!(!plan.stderr.contains("refuse"), "{}", plan.stderr);
    let ranks = &plan.json()["ranks"];
    // Ten layers of 500 x 500 points; three before and behind, and what is left of two layers that are cut.
    assert_eq!(number(&ranks["own"]), 10.0 * 250_000.0);
    assert_eq!(number(&ranks["halo"]), 7.0 * 250_000.0);
    assert_eq!(number(&ranks["received"]), 24.0 * number(&ranks["halo"]));
    assert_eq!((number(&ranks["messages"]), number(&ranks["room"])), (2.0, 71.0));
    let items = ranks["memory"].as_array().unwrap().iter();
    let sum = items.fold(0.0, |sum, item| sum + number(&item["bytes"]));
    assert_eq!(sum, number(&ranks["memory_total"]));
    let text = of("100", "human").stdout;
    for said in ["each of 100 ranks", "matrix of PETSc", "more than 71 own less than they hold"] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let few = cube(0.125);
    let words = ["plan", &few.scene(), "--ranks", "1000"];
    piola(&words).expect(2).says(&["512 points", "too few for 1000 ranks"]);
}
