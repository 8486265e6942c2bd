//! Motions over ranks that are ended, however that may be, and taken up on as many ranks, and on others.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::PoisonError;
use std::time::{Duration, Instant};

use super::moves::{counts_of_fracture, gathering, torn, viscous};
use super::support::{SceneFolder, piola, repository};
use super::{LIMIT, TURN, VECTORS, difference, end, on_ranks, signal, start};

/// In many small steps, with a checkpoint every few milliseconds.
fn often(scene: &SceneFolder) {
    slowly(scene, "checkpoint = 5e-3\n");
}

/// In many small steps, with more in `[output]`.
fn slowly(scene: &SceneFolder, output: &str) {
    let text = fs::read_to_string(scene.scene()).unwrap();
    let text = text.replace("rows = ", &format!("{output}rows = "));
    scene.file("scene.toml", text.replace("[motion]\n", "[motion]\nsafety = 0.1\n"));
}

/// Starts a scene on two ranks, and kills all of them once there is a checkpoint.
#[track_caller]
fn ended(scene: &SceneFolder, out: &str) {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let mut child = start(2, &["run", &scene.scene(), "-o", out, "--petsc"]);
    let since = Instant::now();
    while !Path::new(out).join("checkpoint.bin").exists() {
        assert!(since.elapsed() < LIMIT, "it begins");
        assert!(child.try_wait().unwrap().is_none(), "the run ended without a checkpoint");
        std::thread::sleep(Duration::from_millis(2));
    }
    // Ranks have process groups of their own.
    let of_run = |program: &str, more: &[&str]| {
        let words = format!("o {out} --petsc");
        Command::new(program).args(more).args(["-f", "--", &words]).status().unwrap().success()
    };
    of_run("pkill", &["-KILL"]);
    let outcome = end(child);
    assert_ne!(outcome.code, 0, "{}", outcome.stderr);
    while of_run("pgrep", &[]) {
        assert!(since.elapsed() < LIMIT, "all ranks end");
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Path::new(out).join("checkpoint.bin").exists(), "it is not over");
}

/// Starts a scene without checkpoints on two ranks, and interrupts one of them once there are rows: all end, and leave one.
#[track_caller]
fn interrupted(scene: &SceneFolder, out: &str) {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let child = start(2, &["run", &scene.scene(), "-o", out, "--petsc"]);
    let since = Instant::now();
    let rows = || fs::read_to_string(Path::new(out).join("motion.csv")).unwrap_or_default();
    while rows().lines().count() < 4 {
        assert!(since.elapsed() < LIMIT, "it begins");
        std::thread::sleep(Duration::from_millis(2));
    }
    let listed = Command::new("pgrep").args(["-P", &child.id().to_string()]).output().unwrap();
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    signal("-TERM", listed.lines().last().expect("a rank runs"));
    let outcome = end(child).says(&["interrupted; the motion has come to t = "]);
    assert_eq!(outcome.code, 143, "{}", outcome.stderr);
    assert!(Path::new(out).join("checkpoint.bin").exists());
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let (path, name) = (entry.as_ref().unwrap().path(), entry.unwrap().file_name());
        match path.is_dir() {
            true => copy(&path, &to.join(name)),
            false => drop(fs::copy(&path, to.join(name)).unwrap()),
        }
    }
}

fn names(folder: &Path) -> Vec<String> {
    let all = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        all.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Everything that both folders hold, but what tells of the run and not of the body.
#[track_caller]
fn are_the_same(one: &Path, other: &Path) {
    for folder in ["", "frames"] {
        let [one, other] = [one, other].map(|out| out.join(folder));
        assert_eq!(names(&one), names(&other));
        for name in names(&one).iter().filter(|name| *name != "summary.json") {
            let [own, found] = [&one, &other].map(|out| out.join(name));
            let same = !own.is_file() || fs::read(own).unwrap() == fs::read(found).unwrap();
            assert!(same, "{folder}/{name}");
        }
    }
}

#[track_caller]
fn resume(ranks: usize, out: &str) {
    on_ranks(ranks, &["run", "--petsc", "--resume", out])
        .expect(0)
        .says(&[&format!("on {ranks} rank")]);
}

/// Kills a run, or interrupts it between two rows, and takes it up on two ranks, to the same bits, and on others.
#[track_caller]
fn check_resumed(scene: &SceneFolder, is_killed: bool, others: &[usize]) {
    if is_killed {
        often(scene)
    } else {
        slowly(scene, "")
    }
    let [whole, out] = ["whole", "out"].map(|out| scene.path(out));
    on_ranks(2, &["run", &scene.scene(), "-o", &whole, "--petsc"]).expect(0);
    if is_killed {
        ended(scene, &out)
    } else {
        interrupted(scene, &out)
    }
    for ranks in others {
        copy(Path::new(&out), Path::new(&scene.path(&ranks.to_string())));
    }
    resume(2, &out);
    let whole = Path::new(&whole);
    are_the_same(whole, Path::new(&out));
    for &ranks in others {
        let other = scene.path(&ranks.to_string());
        resume(ranks, &other);
        let other = Path::new(&other);
        for file in ["displacement.csv", "motion.csv"] {
            let found = difference(whole, other, file);
            assert!(found <= VECTORS, "{ranks} ranks, {file}: {found:e}");
        }
        if whole.join("fracture.csv").is_file() {
            assert_eq!(counts_of_fracture(whole, other), 0.0, "{ranks} ranks");
        }
        assert!(names(other).iter().all(|name| !name.starts_with("checkpoint")), "it is over");
    }
}

#[test]
fn a_crack_goes_on() {
    let material = "potential = \"bilinear_softening\"\n\
                    parameters = { K = \"140 GPa\", Gc = \"2700 J/m^2\", s0 = 1e-3 }\n";
    let scene = torn(material, "12 us");
    check_resumed(&scene, true, &[1, 3]);
    // Who takes it up alone is told how.
    let out = scene.path("again");
    ended(&scene, &out);
    piola(&["run", "--resume", &out]).expect(2).says(&["run over 2 ranks", "--petsc --resume"]);
    // Load steps are not taken up, and leave what is there.
    let steps = repository("examples/first/scene.toml");
    let words = ["run", steps.to_str().unwrap(), "--petsc", "--resume", &out];
    on_ranks(2, &words).expect(2).says(&["holds no checkpoint"]);
    // A part that is cut is no part.
    let part = names(Path::new(&out)).into_iter().rfind(|name| name.ends_with("_0001.bin"));
    let part = Path::new(&out).join(part.expect("parts"));
    for part in ["checkpoint_0_0001.bin", "checkpoint_1_0001.bin"] {
        let part = Path::new(&out).join(part);
        if part.is_file() {
            let bytes = fs::read(&part).unwrap();
            fs::write(&part, &bytes[..bytes.len() / 2]).unwrap();
        }
    }
    let told = on_ranks(2, &["run", "--petsc", "--resume", &out]).expect(2).stderr;
    assert_eq!(told.matches("is damaged").count(), 1, "{told}");
    assert!(part.is_file(), "nothing is lost");
    on_ranks(2, &["run", &scene.scene(), "-o", &out, "--petsc", "--force"]).expect(0);
    assert!(!part.is_file(), "all of the earlier run is gone");
}

/// Bonds, triangles and tetrahedra that remember and break by themselves.
#[test]
fn cliques_go_on_with_what_they_remember() {
    let scene = SceneFolder::new(
        "[body]\nbox = [[0, 0, 0], [0.012, 0.005, 0.004]]\nspacing = 1e-3\n[horizon]\nspacings = 1.8\n\
         [material]\npotential = \"law.piola\"\ndensity = 2000\n\
         [sets]\nleft = \"X < 1e-3\"\nright = \"X > 0.011\"\n\
         [[prescribe]]\nset = \"left\"\nv = [-20, 0, 3]\n[[prescribe]]\nset = \"right\"\nv = [20, 5, 0]\n\
         [motion]\nend = \"40 us\"\n[output]\nframes = 4\nrows = 20\nfields = [\"states\"]\n",
    );
    scene.file(
        "law.piola",
        "potential p\nstate k = 0\nstate q = 0\nparameter c = 1e14\ng = a/A - 1\nupdate k = max(k, g)\n\
         left = if k > 0.01 then exp(-(k - 0.01)/0.05) else 1\n\
         psi(l) = c*1e4*L*(l/L - 1)^2\nbreak when l/L - 1 > 0.2\n\
         psi(a) = c*1e10*A*left*g^2\nbreak when k > 0.12\nh = v/V - 1\n\
         update q = if abs(h - q) > 0.02 then h - sign(h - q)*0.02 else q\n\
         psi(v) = c*1e16*V*(h - q)^2\nbreak when abs(h) > 0.2\n",
    );
    check_resumed(&scene, true, &[3]);
}

#[test]
fn viscous_bonds_go_on_after_an_interruption() {
    let scene = viscous("[motion]\nend = \"30 us\"\ndamping = 1e3");
    check_resumed(&scene, false, &[1]);
}

#[test]
fn points_that_remember_go_on() {
    check_resumed(&gathering(), true, &[3]);
}
