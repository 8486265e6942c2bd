//! Bodies in motion over many processes, against the same by one.

use std::path::Path;

use super::support::frames::read_frame;
use super::support::{SceneFolder, json_file, piola, repository, table};
use super::{VECTORS, difference, on_ranks};

/// Of the largest number: displacements at the end of a motion, and energies on its way.
const MOVED: f64 = 1e-12;

/// The largest difference of what columns of two tables say whose names `count`, over the largest of these numbers.
#[track_caller]
fn of_columns(one: &Path, other: &Path, file: &str, counts: impl Fn(&str) -> bool) -> f64 {
    let ((names, rows), (others, found)) = (table(&one.join(file)), table(&other.join(file)));
    assert_eq!((&names, rows.len()), (&others, found.len()), "{file}");
    let columns: Vec<usize> = (0..names.len()).filter(|k| counts(&names[*k])).collect();
    assert!(!columns.is_empty(), "{names:?}");
    let (mut largest, mut most) = (0.0_f64, 0.0_f64);
    for (row, found) in rows.iter().zip(&found) {
        for column in &columns {
            largest = largest.max(row[*column].abs());
            most = most.max((row[*column] - found[*column]).abs());
        }
    }
    if most == 0.0 { 0.0 } else { most / largest }
}

/// The same break at the same steps, and tips are at the same places: whether that is so where it is 0.
#[track_caller]
pub(super) fn counts_of_fracture(one: &Path, other: &Path) -> f64 {
    let is_count = |column: &str| {
        column.starts_with("new_") || column.starts_with("broken_") || column == "front_tip"
    };
    of_columns(one, other, "fracture.csv", is_count)
}

/// Runs a motion by one process and on 1 to 4 ranks.
#[track_caller]
fn check_moves(name: &str, scene: &str, more: &[&str]) {
    check_moves_on(&[1, 2, 3, 4], name, scene, more);
}

/// The same on these numbers of ranks, 3 among them.
#[track_caller]
fn check_moves_on(ranks: &[usize], name: &str, scene: &str, more: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let one = out("one");
    piola(&[&["run", scene, "-o", one.to_str().unwrap()], more].concat()).expect(0);
    let own = json_file(&one.join("summary.json"));
    for &ranks in ranks {
        let many = out(&ranks.to_string());
        let words = [&["run", scene, "-o", many.to_str().unwrap(), "--petsc"], more].concat();
        on_ranks(ranks, &words).expect(0).says(&[&format!("on {ranks} rank")]);
        let told = format!("{name} on {ranks} ranks");
        let found = difference(&one, &many, "displacement.csv");
        assert!(found <= MOVED, "{told}: displacements {found:e}");
        for file in ["reactions.csv", "probes.csv"] {
            if table(&one.join(file)).0.len() > 1 {
                let found = difference(&one, &many, file);
                assert!(found <= VECTORS, "{told}, {file}: {found:e}");
            }
        }
        let is_energy = |column: &str| {
            let others = ["step", "t", "broken", "momentum", "angular"];
            !others.iter().any(|other| column == *other || column.starts_with(&format!("{other}_")))
        };
        let found = of_columns(&one, &many, "motion.csv", is_energy);
        assert!(found <= MOVED, "{told}: energies {found:e}");
        if one.join("fracture.csv").is_file() {
            assert_eq!(counts_of_fracture(&one, &many), 0.0, "{told}");
        }
        let other = json_file(&many.join("summary.json"));
        let alike = ["points", "scene_hash", "exit_reason", "title", "interactions", "dropped"];
        for key in alike {
            assert_eq!(own[key], other[key], "{told}: {key}");
        }
        for key in ["method", "step_seconds", "steps"] {
            assert_eq!(own["motion"][key], other["motion"][key], "{told}: {key}");
        }
        let mass = [&own, &other].map(|summary| summary["motion"]["mass"].as_f64().unwrap());
        assert!((mass[0] - mass[1]).abs() <= VECTORS * mass[0], "{told}: {mass:?}");
        assert!(many.join("picture.png").is_file() && many.join("run.pvd").is_file());
    }
    let [one, many] = [&one, &out("3")].map(|out| read_frame(out, 2).unwrap());
    for array in ["displacement", "velocity"] {
        let [one, many] = [&one, &many].map(|frame| &frame.array(array).unwrap().values);
        let largest = one.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        assert_eq!(one.len(), many.len());
        let most = one.iter().zip(many).fold(0.0_f64, |most, (x, y)| most.max((x - y).abs()));
        assert!(most <= VECTORS * largest, "{name}, {array}: {most:e} of {largest:e}");
    }
}

/// A plate with a crack from its left edge to its middle, torn apart along its longer sides.
pub(super) fn torn(material: &str, end: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [0.04, 0.02, 0.004]]\nspacing = 1e-3\n[horizon]\nspacings = 3.015\n\
         [material]\ndensity = 8000\n{material}\
         [sets]\nlower = \"Y < 1e-3\"\nupper = \"Y > 0.019\"\n\
         [[crack]]\npolygon = [[-0.01, 0.01, -0.01], [0.02, 0.01, -0.01], [0.02, 0.01, 0.02], [-0.01, 0.01, 0.02]]\n\
         [[prescribe]]\nset = \"lower\"\nv = [0, -5, 0]\n[[prescribe]]\nset = \"upper\"\nv = [0, 5, 0]\n\
         [fracture]\nunbreakable = [\"lower\", \"upper\"]\n\
         [[track]]\nname = \"front\"\naxis = \"X\"\nthreshold = 0.3\n\
         [[probe]]\nname = \"ahead\"\nat = [0.03, 0.012, 0.002]\n\
         [motion]\nend = \"{end}\"\n[output]\nframes = 4\nrows = 40\n"
    ))
}

#[test]
fn a_crack_that_grows() {
    let material = "potential = \"prototype_microelastic_brittle\"\n\
                    parameters = { K = \"140 GPa\", Gc = \"2700 J/m^2\" }\n";
    let scene = torn(material, "16 us");
    check_moves("crack", &scene.scene(), &[]);
    let one = scene.path("one");
    piola(&["run", &scene.scene(), "-o", &one]).expect(0);
    let (names, rows) = table(&Path::new(&one).join("fracture.csv"));
    let broken = names.iter().position(|name| name == "broken_bonds").unwrap();
    let [first, last] = [rows[0][broken], rows[rows.len() - 1][broken]];
    assert!(first > 0.0 && last > 2.0 * first, "the crack has grown from {first} to {last} bonds");
    let tip = names.iter().position(|name| name == "front_tip").unwrap();
    let mut tips: Vec<f64> = rows.iter().map(|row| row[tip]).collect();
    tips.dedup();
    assert!(tips.len() > 4 && tips.is_sorted(), "it runs: {tips:?}");
    // What is damaged, and how much, is the same to the last bit.
    let many = scene.path("many");
    on_ranks(3, &["run", &scene.scene(), "-o", &many, "--petsc"]).expect(0);
    for frame in [0, 4] {
        let frames = [&one, &many].map(|out| read_frame(Path::new(out), frame).unwrap());
        let [own, other] = frames.each_ref().map(|frame| &frame.array("damage").unwrap().values);
        assert!(own == other && own.iter().any(|damage| *damage > 0.0), "{frame}");
    }
}

#[test]
fn bonds_that_remember() {
    let material = "potential = \"bilinear_softening\"\n\
                    parameters = { K = \"140 GPa\", Gc = \"2700 J/m^2\", s0 = 1e-3 }\n";
    check_moves("softening", &torn(material, "10 us").scene(), &[]);
}

#[test]
fn families_that_lose_bonds() {
    let material = "potential = \"linear_peridynamic_solid_brittle\"\n\
                    parameters = { K = \"140 GPa\", G = \"80 GPa\", Gc = \"2700 J/m^2\" }\n";
    check_moves("families", &torn(material, "8 us").scene(), &[]);
}

#[test]
fn triangles_that_fail_by_themselves() {
    let scene = repository("examples/areas_that_fail/scene.toml");
    check_moves("areas", scene.to_str().unwrap(), &["--set", "motion.end=3e-5"]);
}

/// Viscous bonds, whose stiffness changes in place and time, under a load and damping.
pub(super) fn viscous(motion: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [0.02, 0.006, 0.006]]\nspacing = 1e-3\n[horizon]\nspacings = 3.015\n\
         [material]\npotential = \"kelvin_voigt\"\ndensity = 2000\n\
         parameters = {{ K = \"1e9*(1 + 20*X)*(1 + 1e4*t)\", tau = 1e-7 }}\n\
         [sets]\nleft = \"X < 2e-3\"\nright = \"X > 0.018\"\n\
         [[prescribe]]\nset = \"left\"\nu = [\"1e-6*sin(1e5*t)\", 0, 0]\n\
         [[load]]\nset = \"right\"\nforce = [\"1e3*t/1e-5\", 10, 0]\n\
         [[probe]]\nname = \"end\"\nat = [0.02, 0.003, 0.003]\n\
         {motion}\n[output]\nframes = 4\nrows = 20\n"
    ))
}

#[test]
fn what_is_dissipated_and_what_changes_with_time() {
    let scene = viscous("[motion]\nend = \"30 us\"\ndamping = 1e3");
    check_moves("viscous", &scene.scene(), &[]);
    // What is pushed has momentum.
    let [one, many] = ["one", "many"].map(|name| scene.path(name));
    piola(&["run", &scene.scene(), "-o", &one]).expect(0);
    on_ranks(3, &["run", &scene.scene(), "-o", &many, "--petsc"]).expect(0);
    let is_momentum = |column: &str| column.contains("momentum");
    let found = of_columns(Path::new(&one), Path::new(&many), "motion.csv", is_momentum);
    assert!(found <= VECTORS, "momenta {found:e}");
}

/// The reason is the same as by one process, and told once.
#[test]
fn a_motion_that_ends_early_says_why() {
    let scene = viscous("[motion]\nend = \"1 ms\"\nstep = 5e-6\nunstable = true");
    let (file, one, many) = (scene.scene(), scene.path("one"), scene.path("many"));
    let own = piola(&["run", &file, "-o", &one]);
    assert_ne!(own.code, 0, "it is far too fast");
    let found = on_ranks(3, &["run", &file, "-o", &many, "--petsc"]);
    assert_eq!(found.code, own.code, "{}", found.stderr);
    let [own, other] = [one, many].map(|out| json_file(&Path::new(&out).join("summary.json")));
    assert_eq!(own["exit_reason"], other["exit_reason"]);
    let message =
        |summary: &serde_json::Value| summary["exit_message"].as_str().unwrap().to_owned();
    let place = |text: &str| text.split(": it would go").next().unwrap_or_default().to_owned();
    let own = place(&message(&own));
    assert!(message(&other).starts_with(&own), "{own}: {}", message(&other));
    assert_eq!(found.stderr.matches(&own).count(), 1, "{}", found.stderr);
}

#[test]
fn what_moves_in_one_process_alone_is_refused() {
    let refused = |scene: &str, more: &[&str], words: &str| {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out").to_str().unwrap().to_owned();
        let all = [&["run", scene, "-o", &out, "--petsc"], more].concat();
        let told = on_ranks(2, &all).expect(2).stderr;
        assert_eq!(told.matches(words).count(), 1, "{words}: {told}");
        assert!(!Path::new(&out).exists(), "nothing was begun");
    };
    let example = |name: &str| repository("examples").join(name).to_str().unwrap().to_owned();
    let midpoint = ["--set", "motion.method=\"midpoint\""];
    refused(&example("wave/scene.toml"), &midpoint, "take an explicit method");
}

/// Conditions and states of deformation gradients, of bonds and of points: whoever owns a family judges it.
#[test]
fn gradients_that_break_and_remember() {
    for scene in ["scene", "softening"] {
        let file = repository("examples/gradients_that_fail").join(format!("{scene}.toml"));
        let short = ["--set", "motion.end=3e-5"];
        check_moves_on(&[2, 3], "families", file.to_str().unwrap(), &short);
    }
    let file = repository("examples/gradients_that_fail/softening.toml");
    let nodal = ["--set", "correspondence.discretisation=\"nodal\"", "--set", "motion.end=2e-5"];
    check_moves_on(&[3], "families", file.to_str().unwrap(), &nodal);
}

/// A plate that is torn by what its points gather, and remember.
pub(super) fn gathering() -> SceneFolder {
    let scene = SceneFolder::new(
        "[body]\nbox = [[0, 0], [0.04, 0.02]]\nspacing = 1e-3\n[horizon]\nspacings = 3.015\n\
         [material]\npotential = \"law.piola\"\ndensity = 2000\n\
         [sets]\nlower = \"Y < 1e-3\"\nupper = \"Y > 0.019\"\n\
         [[crack]]\nsegment = [[-0.01, 0.01], [0.02, 0.01]]\n[fracture]\nunbreakable = [\"lower\", \"upper\"]\n\
         [[prescribe]]\nset = \"lower\"\nv = [1, -5]\n[[prescribe]]\nset = \"upper\"\nv = [0, 5]\n\
         [motion]\nend = \"30 us\"\n[output]\nframes = 4\nrows = 20\n",
    );
    scene.file(
        "law.piola",
        "potential p\nm = integral(L^2)\ntheta = 2/m*integral(L*(l - L))\nstate p = 0\n\
         update p = if abs(theta - p) > 5e-4 then theta - sign(theta - p)*5e-4 else p\n\
         psi(theta) = 1e9*(theta - p)^2\npsi(l, m) = 1e9/m*(l - L)^2\n\
         break when theta > 4e-3 and p > 2e-3\nbreak when l/L - 1 > 4e-3 + theta/3\n",
    );
    scene
}

#[test]
fn what_points_gather_breaks_and_is_remembered() {
    let scene = gathering();
    check_moves_on(&[2, 3], "families", &scene.scene(), &[]);
    let one = scene.path("one");
    piola(&["run", &scene.scene(), "-o", &one]).expect(0);
    let (names, rows) = table(&Path::new(&one).join("motion.csv"));
    for column in ["released", "dissipated"] {
        let column = names.iter().position(|name| name == column).unwrap();
        // Families that lose bonds may create energy.
        assert!(rows[rows.len() - 1][column] != 0.0, "{names:?}");
    }
}
