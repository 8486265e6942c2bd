//! Scenes over many processes, against the same scenes by one: with the feature `petsc` and `mpirun`.

mod moves;
#[path = "../../runtime/petsc/tests/support/mpirun.rs"]
mod mpirun;
mod resumed;
#[path = "../support/mod.rs"]
mod support;

use std::path::Path;
use std::process::{Child, Command};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use mpirun::mpirun;
use support::frames::{VtuFile, read_frame};
use support::{Outcome, SceneFolder, command, json_file, piola, repository, table};

/// One run at a time has the cores.
static TURN: Mutex<()> = Mutex::new(());

/// Longest time of a run: what goes wrong between processes stands still.
const LIMIT: Duration = Duration::from_secs(120);

/// Of the largest number: displacements and reactions, and energies.
const VECTORS: f64 = 1e-10;
const ENERGIES: f64 = 1e-12;

fn signal(name: &str, process: &str) {
    let _ = Command::new("kill").args([name, "--", process]).status();
}

/// `piola` with these words on so many ranks.
fn start(ranks: usize, words: &[&str]) -> Child {
    start_program(ranks, command(words).get_program().to_str().unwrap(), words)
}

fn start_program(ranks: usize, program: &str, words: &[&str]) -> Child {
    let mut command = mpirun(ranks, program);
    command.args(words).current_dir(env!("CARGO_MANIFEST_DIR"));
    command.spawn().expect("mpirun starts: apt-get install openmpi-bin petsc-dev")
}

/// What it left, once it has ended; it fails the test where that takes too long.
#[track_caller]
fn end(mut child: Child) -> Outcome {
    let since = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if since.elapsed() > LIMIT {
            signal("-KILL", &format!("-{}", child.id()));
            panic!("the run stood still: {:?}", child.wait_with_output());
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let output = child.wait_with_output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Outcome {
        code: output.status.code().unwrap_or(-1),
        stdout: text(&output.stdout),
        stderr: text(&output.stderr),
    }
}

#[track_caller]
fn on_ranks(ranks: usize, words: &[&str]) -> Outcome {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    end(start(ranks, words))
}

/// The largest difference of two tables over the largest number in the first of them, where points stand and `t`
/// apart.
#[track_caller]
fn difference(one: &Path, other: &Path, file: &str) -> f64 {
    let ((names, rows), (others, found)) = (table(&one.join(file)), table(&other.join(file)));
    assert_eq!((&names, rows.len()), (&others, found.len()), "{file}");
    let counts = |column: &usize| !["t", "X", "Y", "Z"].contains(&names[*column].as_str());
    let columns: Vec<usize> = (0..names.len()).filter(counts).collect();
    let numbers = |rows: &[Vec<f64>]| -> Vec<f64> {
        rows.iter().flat_map(|row| columns.iter().map(|column| row[*column])).collect()
    };
    let (one, other) = (numbers(&rows), numbers(&found));
    let largest = one.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    one.iter().zip(&other).fold(0.0_f64, |most, (x, y)| most.max((x - y).abs())) / largest
}

/// Runs a scene by one process and on 1 to 4 ranks.
#[track_caller]
fn check_alike(name: &str, scene: &str, more: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let run = |out: &Path, more: &[&str]| -> Vec<String> {
        let all = ["run", scene, "-o", out.to_str().unwrap(), "--set", "solver.tolerance=1e-12"];
        all.iter().chain(more).map(|word| (*word).to_owned()).collect()
    };
    let one = out("one");
    piola(&run(&one, more)).expect(0);
    for ranks in 1..=4 {
        let many = out(&ranks.to_string());
        let words = run(&many, &[more, &["--petsc"]].concat());
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        on_ranks(ranks, &words).expect(0).says(&[&format!("on {ranks} rank")]);
        let differences = [
            ("displacement.csv", VECTORS),
            ("reactions.csv", VECTORS),
            ("probes.csv", VECTORS),
            ("force_displacement.csv", VECTORS),
            ("energy.csv", ENERGIES),
        ];
        for (file, bar) in differences {
            if table(&one.join(file)).0.len() > 1 {
                let found = difference(&one, &many, file);
                assert!(found <= bar, "{name} on {ranks} ranks, {file}: {found:e}");
            }
        }
        let [own, other] = [&one, &many].map(|out| json_file(&out.join("summary.json")));
        let alike = ["points", "scene_hash", "exit_reason", "title", "interactions", "dropped"];
        for key in alike {
            assert_eq!(own[key], other[key], "{name}: {key}");
        }
        let dropped = |summary: &serde_json::Value| -> Vec<String> {
            let all = summary["warnings"].as_array().unwrap().iter();
            let told = all.map(|one| one.as_str().unwrap().to_owned());
            told.filter(|one| one.contains("is dropped")).collect()
        };
        assert_eq!(dropped(&own), dropped(&other), "{name}");
        assert_eq!(own["probes"], other["probes"], "{name}");
        assert!(many.join("picture.png").is_file() && many.join("run.pvd").is_file());
        // Each rank has made its points by itself: where they are, and how large, to the last bit.
        let [own, other] = [&one, &many].map(|out| read_frame(out, 0).unwrap());
        assert_eq!(own.positions, other.positions, "{name} on {ranks} ranks");
        let arrays =
            ["volume", "held", "material"].map(|array| (own.array(array), other.array(array)));
        for (own, other) in arrays {
            assert_eq!(own, other, "{name} on {ranks} ranks");
        }
    }
}

#[track_caller]
fn check_example(name: &str, more: &[&str]) {
    let scene = repository("examples").join(name).join("scene.toml");
    check_alike(name, scene.to_str().unwrap(), more);
}

#[test]
fn bonds_of_two_materials_that_warm_up() {
    check_example("bimetal", &[]);
}

#[test]
fn bonds_beside_deformation_gradients() {
    check_example("bonds_beside_F", &["--set", "steps.increments=2"]);
}

#[test]
fn angles_between_bonds() {
    check_example("cork", &["--set", "steps.increments=2"]);
}

#[test]
fn bonds_that_are_corrected_at_faces() {
    check_example("cantilever", &[]);
}

#[test]
fn tensors_that_points_gather() {
    check_example("correspondence_as_text", &[]);
}

#[test]
fn areas_and_volumes() {
    let more = ["--set", "steps.increments=2", "--set", "steps.end=0.2"];
    check_example("cube_C1_C3", &more);
    check_example("cube_C1_C2", &more);
}

/// A plate under a load whose clamp lets go of nothing; what differs are its energies.
fn plate(rest: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0], [1, 0.5]]\nspacing = 0.0625\n[horizon]\nspacings = 2.1\n{rest}\
         [sets]\nleft = \"X < 0.06\"\nright = \"X > 0.94\"\n[[prescribe]]\nset = \"left\"\nu = [0, 0]\n\
         [[load]]\nset = \"right\"\nforce = [\"1e-3*t\", \"-2e-4*t\"]\n\
         [[probe]]\nname = \"tip\"\nat = [1, 0.25]\n[steps]\nincrements = 2\n"
    ))
}

#[test]
fn deformation_gradients_in_every_discretisation() {
    for discretisation in ["nodal", "stabilised", "bond-quadrature"] {
        let scene = plate(&format!(
            "[material]\npotential = \"neo_hooke\"\nparameters = {{ mu = 1.0, lambda = 1.0 }}\n\
             [correspondence]\ndiscretisation = \"{discretisation}\"\n"
        ));
        check_alike(discretisation, &scene.scene(), &[]);
    }
}

#[test]
fn what_families_gather() {
    let scene = plate(
        "[material]\npotential = \"linear_peridynamic_solid\"\nparameters = { K = 1.0, G = 0.5 }\n",
    );
    check_alike("linear_peridynamic_solid", &scene.scene(), &[]);
}

/// A body of bonds of two materials that is longest along one of its axes; `body` says what is removed of it.
fn of_two_materials(sides: &[f64], body: &str, [load, set]: [&str; 2]) -> SceneFolder {
    let (zero, low) = if sides.len() == 3 { (", 0", "[0, 0, 0]") } else { ("", "[0, 0]") };
    SceneFolder::new(&format!(
        "[body]\nbox = [{low}, {sides:?}]\nspacing = 0.0625\n{body}[horizon]\nspacings = 2.1\n\
         [[material]]\nname = \"soft\"\npotential = \"javili2020\"\n\
         parameters = {{ C1 = 1.0, C2 = 0.0, C3 = 0.0 }}\n\
         [[material]]\nname = \"stiff\"\nset = \"corner\"\npotential = \"javili2020\"\n\
         parameters = {{ C1 = 3.0, C2 = 0.0, C3 = 0.0 }}\n\
         [[prescribe]]\nset = \"below\"\nu = [0, 0{zero}]\n\
         [[prescribe]]\nset = \"above\"\nu = [\"0.02*t\", \"0.01*t\"{zero}]\n\
         [[probe]]\nname = \"middle\"\nat = {middle:?}\n[steps]\nincrements = 1\n{load}\
         [sets]\n{set}below = \"Y < 0.06\"\nabove = \"Y > {above}\"\ncorner = \"X < 0.2 and Y < 0.3\"\n",
        above = sides[1] - 0.06,
        middle = sides.iter().map(|side| 0.6 * side).collect::<Vec<f64>>(),
    ))
}

#[test]
fn lattices_that_are_whole_nowhere() {
    let hole = "remove = [\"(X - 0.3)^2 + (Y - 0.25)^2 < 0.006\", \"X > 0.3 and Y < 0.1\"]\n";
    let cases: [(&str, &[f64], &str); 5] = [
        ("along x", &[1.0, 0.5], hole),
        ("along y", &[0.5, 1.0], hole),
        ("along y, whole", &[0.5, 1.0], ""),
        ("along z", &[0.375, 0.5, 0.75], hole),
        ("along z, whole", &[0.25, 0.5, 0.625], ""),
    ];
    for (name, sides, body) in cases {
        check_alike(name, &of_two_materials(sides, body, ["", ""]).scene(), &[]);
    }
}

/// What is wrong with points, and what to know of them, is told once, wherever the points are.
#[test]
fn what_is_found_on_one_rank_is_told_once() {
    let on_three = |body: &str, far: &str, code: i32| {
        let load = "[[load]]\nset = \"far\"\nforce = [1e-4, 0]\n";
        let far = if far.is_empty() { String::new() } else { format!("far = \"{far}\"\n") };
        let load = if far.is_empty() { "" } else { load };
        let folder = of_two_materials(&[1.0, 0.5], body, [load, &far]);
        let (file, out) = (folder.scene(), folder.path("many"));
        piola(&["run", &file, "-o", &folder.path("one")]).expect(code);
        on_ranks(3, &["run", &file, "-o", &out, "--petsc"]).expect(code)
    };
    let once = |found: Outcome, message: &str| {
        assert_eq!(found.stderr.matches(message).count(), 1, "{message}:\n{}", found.stderr);
    };
    // Points of the last rank are at the limit of a set, and held as well as loaded.
    once(on_three("", "X > 0.90625", 0), "runs through points");
    once(on_three("", "X > 0.9", 0), "acts on");
    // A set without points, a body of which nothing is left, a condition that removes nothing.
    once(on_three("", "X > 2", 2), "the set `far` has no points");
    once(on_three("remove = [\"X > -1\"]\n", "", 2), "every point of the body is removed");
    once(on_three("remove = [\"X > 0.9\", \"X > 3\"]\n", "", 0), "removes no point");
}

/// What frames show of points is what one process shows.
#[test]
fn fields_of_frames() {
    let scene = plate(
        "[material]\npotential = \"neo_hooke\"\nparameters = { mu = 1.0, lambda = 1.0 }\n[output]\n\
         fields = [\"energy_density\", \"strain\", \"stress\", \"von_mises\", \"neighbours\", \"sets\"]\n\
         colour = \"von_mises\"\n",
    );
    piola(&["run", &scene.scene(), "-o", &scene.path("one")]).expect(0);
    let (file, many) = (scene.scene(), scene.path("many"));
    on_ranks(3, &["run", &file, "-o", &many, "--petsc"]).expect(0);
    // What is made of results reads frames in pieces, too.
    let shown = ["one", "many"].map(|out| {
        let folder = scene.path(out);
        piola(&["picture", &folder, "--at", "0"]).expect(0);
        piola(&["report", &folder]).expect(0);
        std::fs::read(Path::new(&folder).join("body.png")).unwrap()
    });
    assert!(shown[0] == shown[1], "the body at rest is drawn alike");
    for frame in 0..3 {
        let [one, many] =
            ["one", "many"].map(|out| read_frame(Path::new(&scene.path(out)), frame).unwrap());
        assert_eq!(one.positions, many.positions);
        let names =
            |file: &VtuFile| file.arrays.iter().map(|one| one.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&one), names(&many));
        let names = [
            "energy_density",
            "strain",
            "stress",
            "von_mises",
            "neighbours",
            "set left",
            "residual",
        ];
        for name in names {
            let [one, many] = [&one, &many].map(|frame| &frame.array(name).unwrap().values);
            let largest = one.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            assert_eq!(one.len(), many.len());
            for (x, y) in one.iter().zip(many) {
                assert!((x - y).abs() <= 1e-9 * largest, "{name}: {x} {y}");
            }
        }
    }
}

/// Points that are no lattice, with a column that a parameter takes.
#[test]
fn a_cloud_with_columns() {
    let scene = SceneFolder::new(
        "[body]\ndimension = 2\npoints = \"points.csv\"\n[horizon]\nradius = 0.25\n\
         [material]\npotential = \"javili2020\"\nparameters = { C1 = \"stiff\" }\n\
         [sets]\nlow = \"Y < 0.15\"\nhigh = \"Y > 1.85\"\n[[prescribe]]\nset = \"low\"\nu = [0, 0]\n\
         [[prescribe]]\nset = \"high\"\nu = [\"0.02*t\", \"0.1*t\"]\n[steps]\nincrements = 2\n",
    );
    let mut random = support::Random(7);
    let mut points = "x,y,volume,stiff\n".to_owned();
    for k in 0..200 {
        let [dx, dy] = [random.next(), random.next()].map(|x| 0.02 * x);
        let (x, y) = (0.1 * f64::from(k % 10) + dx, 0.1 * f64::from(k / 10) + dy);
        points += &format!("{x},{y},{},{}\n", 0.01 * (1.0 + dx), 1.0 + y);
    }
    scene.file("points.csv", points);
    check_alike("cloud", &scene.scene(), &[]);
}

/// Rank 0 reads files, and the others have what it sends: a mesh with groups, and a lattice with a set that a file lists,
/// which is of a material of its own.
#[test]
fn bodies_from_files() {
    let ring = repository("examples/ring/scene.toml").to_str().unwrap().to_owned();
    let folder = tempfile::tempdir().unwrap();
    let [one, many] = ["one", "many"].map(|out| folder.path().join(out));
    let words = |out: &Path| ["run", &ring, "-o", out.to_str().unwrap()].map(str::to_owned);
    piola(&words(&one)).expect(0);
    for ranks in [1, 3] {
        let words = [&words(&many)[..], &["--petsc".to_owned(), "--force".to_owned()]].concat();
        on_ranks(ranks, &words.iter().map(String::as_str).collect::<Vec<_>>()).expect(0);
        let found = difference(&one, &many, "displacement.csv");
        assert!(found <= VECTORS, "ring on {ranks} ranks: {found:e}");
        let counts = |out: &Path| -> String {
            let bytes = std::fs::read(out.join("frames/frame_000001.vtu")).unwrap();
            let text = String::from_utf8_lossy(&bytes).into_owned();
            text.lines().find(|line| line.contains("NumberOfCells")).unwrap().to_owned()
        };
        assert_eq!(counts(&one), counts(&many), "all points and cells of the mesh");
    }
    let scene = SceneFolder::new(
        "[body]\nbox = [[0, 0], [2, 0.5]]\nspacing = 0.0625\nremove = [\"X > 1.8 and Y > 0.4\"]\n\
         [horizon]\nspacings = 2.1\n\
         [sets]\nsoft = { numbers = \"soft.txt\" }\nleft = \"X < 0.1\"\nright = \"X > 1.7\"\n\
         [[material]]\nset = \"soft\"\npotential = \"javili2020\"\nparameters = { C1 = \"1 + X\" }\n\
         [[material]]\nname = \"rest\"\npotential = \"javili2020\"\nparameters = { C1 = 10 }\n\
         [[prescribe]]\nset = \"left\"\nu = [0, 0]\n[[prescribe]]\nset = \"right\"\nu = [\"0.05*t\", 0]\n\
         [steps]\nincrements = 2\n",
    );
    let numbers = (1..=256).filter(|number| number % 3 == 0).map(|number| format!("{number}\n"));
    scene.file("soft.txt", numbers.collect::<String>());
    check_alike("numbers", &scene.scene(), &[]);
}

#[test]
fn what_cannot_be_run_so_is_told_once() {
    let said = |ranks: usize, scene: &SceneFolder, options: &[&str], code: i32| {
        let (file, out) = (scene.scene(), scene.path("out"));
        let words = [&["run", &file, "-o", &out, "--force", "--petsc"][..], options].concat();
        on_ranks(ranks, &words).expect(code).stderr
    };
    let once = |text: &str, words: &str| {
        assert_eq!(text.matches(words).count(), 1, "{words}: {text}");
    };
    let material = "[material]\npotential = \"javili2020\"\nparameters = { C1 = 1 }\n";
    let scene = plate(material);
    once(&said(2, &scene, &["--", "-ksp_tpye", "cg"], 0), "-ksp_tpye");
    let wrong = said(2, &scene, &["--", "-pc_type", "nonsense"], 2);
    assert!(wrong.contains("nonsense"), "{wrong}");
    let text = std::fs::read_to_string(scene.scene()).unwrap();
    let scene = |text: String| SceneFolder::new(&text);
    let typo = scene(text.replace("spacings", "spacngs"));
    once(&said(2, &typo, &[], 2), "[unknown-key]");
    let two = scene(
        text.replace("[[0, 0], [1, 0.5]]", "[[0, 0], [0.125, 0.0625]]")
            .replace("0.94", "0.07")
            .replace("at = [1, 0.25]", "at = [0.1, 0.03]"),
    );
    once(&said(3, &two, &[], 2), "the body has 2 points, too few for 3 ranks");
    assert!(!two.out().exists(), "nothing was begun");
    // Too far for any step.
    let far = scene(
        text.replace("1e-3*t", "1e9*t").replace("javili2020", "far.piola").replace("C1", "C"),
    );
    far.file(
        "far.piola",
        "potential far\nparameter C = 1, C > 0\npsi(l) = C*L*(ln(l/L)^2)*exp(-l/L)\n",
    );
    let text = said(2, &far, &["--", "-snes_max_it", "5"], 3);
    assert!(text.contains("no equilibrium at t = "), "{text}");
}

/// A machine that does not see the scene, or sees another.
#[test]
fn a_rank_that_reads_something_else_ends_the_run() {
    let scene = plate("[material]\npotential = \"javili2020\"\nparameters = { C1 = 1 }\n");
    let text = std::fs::read_to_string(scene.scene()).unwrap();
    scene.file("0.toml", &text);
    let run = |words: &str, code: i32| {
        let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let own = command(&["run"]);
        let program = own.get_program().to_str().unwrap().to_owned();
        let line = format!(
            "{program} run {}/$OMPI_COMM_WORLD_RANK.toml -o {} --petsc",
            scene.path(""),
            scene.path("out")
        );
        let outcome = end(start_program(2, "sh", &["-c", &line]));
        assert_eq!(outcome.code, code, "{}", outcome.stderr);
        assert_eq!(outcome.stderr.matches(words).count(), 1, "{words}: {}", outcome.stderr);
    };
    run("rank 1: ", 2);
    scene.file("1.toml", text.replace("spacings", "spacngs"));
    run("unknown-key", 2);
    scene.file("1.toml", text.replace("C1 = 1", "C1 = 2"));
    run("rank 1 reads another scene", 2);
    assert!(!scene.out().exists(), "nothing was begun");
    scene.file("1.toml", &text);
    run("converged on 2 ranks", 0);
}

/// Families that a halo cuts may determine nothing, and be of one point.
#[test]
fn sparse_clouds() {
    let scene = SceneFolder::new(
        "[body]\ndimension = 2\npoints = \"points.csv\"\n[horizon]\nradius = 0.15\n[material]\n\
         potential = \"neo_hooke\"\nparameters = { mu = 1.0, lambda = 1.0 }\n[sets]\nleft = \"X < 0.2\"\n\
         right = \"X > 3.8\"\n[[prescribe]]\nset = \"left\"\nu = [0, 0]\n[[prescribe]]\nset = \"right\"\n\
         u = [0.02, 0]\n[steps]\nincrements = 1\n",
    );
    let mut random = support::Random(11);
    let mut solved = 0;
    for _ in 0..6 {
        let mut points = "x,y,volume\n".to_owned();
        for k in 0..41 * 6 {
            let [dx, dy] = [random.next(), random.next()].map(|x| 0.035 * x);
            let (x, y) = (0.1 * f64::from(k % 41) + dx, 0.1 * f64::from(k / 41) + dy);
            points += &format!("{x},{y},0.01\n");
        }
        scene.file("points.csv", points);
        // What one process solves many do.
        if piola(&["run", &scene.scene(), "-o", &scene.path("one"), "--force"]).code == 0 {
            check_alike("sparse cloud", &scene.scene(), &[]);
            solved += 1;
        }
    }
    assert!(solved > 0, "one of the clouds holds together");
}

/// The others end with it, and nothing is half written.
#[test]
fn a_rank_that_is_killed_ends_the_run() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let scene = plate("[material]\npotential = \"javili2020\"\nparameters = { C1 = 1 }\n");
    let text = std::fs::read_to_string(scene.scene()).unwrap();
    scene.file("scene.toml", text.replace("increments = 2", "increments = 100000"));
    let child = start(3, &["run", &scene.scene(), "-o", &scene.path("out"), "--petsc"]);
    let since = Instant::now();
    while !scene.out().join("energy.csv").exists() {
        assert!(since.elapsed() < LIMIT, "it begins");
        std::thread::sleep(Duration::from_millis(20));
    }
    // One of the processes whose parent is mpirun.
    let listed = Command::new("pgrep").args(["-P", &child.id().to_string()]).output().unwrap();
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    let rank = listed.lines().last().expect("a rank runs");
    signal("-KILL", rank);
    let outcome = end(child);
    assert_ne!(outcome.code, 0, "{}", outcome.stderr);
    let (names, rows) = table(&scene.out().join("energy.csv"));
    assert!(!rows.is_empty() && rows.iter().all(|row| row.len() == names.len()));
    let partial = std::fs::read_dir(scene.out())
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().contains("partial"));
    assert!(partial.count() <= 1, "at most the file that was being written");
}
