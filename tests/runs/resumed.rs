//! Motions that are ended, however that may be, and taken up again.

use std::fs;
use std::io::Read as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::fracture::TORN;
use crate::motion::THROWN;
use crate::scenes::STRIP;
use crate::support::{Outcome, Random, SceneFolder, command, number, piola};

/// How often runs are killed, in all.
const KILLS: usize = 50;

/// With a checkpoint every few milliseconds, for as many seconds of the body as make some of the wall.
fn scene() -> SceneFolder {
    let text = THROWN.replace("end = 0.5", "end = 40.0").replace("frames = 5", "frames = 20");
    SceneFolder::new(&text.replace("rows = 50", "rows = 300\ncheckpoint = 2e-3"))
}

fn start(arguments: &[&str]) -> Child {
    let mut command = command(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args([name, &child.id().to_string()]).status().unwrap();
    assert!(status.success());
}

fn resume(out: &Path, more: &[&str]) -> Outcome {
    piola(&[&["run", "--resume", out.to_str().unwrap()], more].concat())
}

/// Everything that both folders hold, but what tells of the run and not of the body.
fn are_the_same(one: &Path, other: &Path) {
    let names = |folder: &Path| {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            // Whoever is killed behind the last file leaves it, and the next run takes it over.
            .filter(|name| name != ".piola.lock")
            .collect();
        names.sort();
        names
    };
    assert_eq!(names(one), names(other));
    for folder in ["", "frames"] {
        let [one, other] = [one, other].map(|out| out.join(folder));
        assert_eq!(names(&one), names(&other));
        for name in names(&one) {
            // A picture has the name of the scene's folder in its title.
            let is_of_body = name != "summary.json" && !name.starts_with("picture");
            if is_of_body && one.join(&name).is_file() {
                let same =
                    fs::read(one.join(&name)).unwrap() == fs::read(other.join(&name)).unwrap();
                assert!(same, "{folder}/{name}");
            }
        }
    }
}

/// A run that nobody interrupts, and how long it takes.
fn whole() -> (SceneFolder, Duration) {
    let folder = scene();
    let begin = Instant::now();
    folder.run(&[]).expect(0);
    assert!(!folder.out().join("checkpoint.bin").exists(), "there is nothing to go on with");
    (folder, begin.elapsed())
}

/// Waits until a run has a checkpoint to go on from.
fn wait_for_checkpoint(child: &mut Child, out: &Path) {
    while !out.join("checkpoint.bin").exists() {
        assert!(child.try_wait().unwrap().is_none(), "the run ended without a checkpoint");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_run_that_is_killed_goes_on_with_the_same_bits() {
    let (whole, time) = whole();
    let mut random = Random(41);
    let mut kills = 0;
    while kills < KILLS {
        let folder = scene();
        let out = folder.out();
        let (scene, out_name) = (folder.scene(), folder.path("out"));
        let mut child = start(&["run", &scene, "--out", &out_name]);
        wait_for_checkpoint(&mut child, &out);
        loop {
            std::thread::sleep(time.mul_f64(0.5 * random.next().abs()));
            signal(&child, "-KILL");
            if child.wait().unwrap().success() {
                break;
            }
            kills += 1;
            // Killed between the last step and the end of the program; or often enough: where starting takes
            // longer than it is let run, a run would never end.
            if !out.join("checkpoint.bin").exists() || kills >= KILLS {
                break;
            }
            child = start(&["run", "--resume", &out_name]);
        }
        if out.join("checkpoint.bin").exists() {
            resume(&out, &[]).expect(0);
        }
        are_the_same(&whole.out(), &out);
    }
}

#[test]
fn a_run_that_is_interrupted_goes_on_with_the_same_bits() {
    let (whole, _) = whole();
    for (name, code) in [("-INT", 130), ("-TERM", 143)] {
        let folder = scene();
        let (scene, out) = (folder.scene(), folder.out());
        let mut child = start(&["run", &scene, "--out", &folder.path("out")]);
        wait_for_checkpoint(&mut child, &out);
        signal(&child, name);
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(code), "{said}");
        assert!(said.contains("piola run --resume"), "{said}");
        let stopped = folder.summary();
        assert_eq!(stopped["exit_reason"], "interrupted");
        resume(&out, &["--threads", "1"]).expect(0);
        are_the_same(&whole.out(), &out);
        let summary = folder.summary();
        assert_eq!(summary["exit_reason"], "completed");
        assert_eq!(summary["motion"]["resumed_at_step"], stopped["motion"]["steps_made"]);
        assert_eq!(summary["scene_hash"], whole.summary()["scene_hash"]);
        assert_eq!(
            number(&summary["motion"]["rounding"]),
            number(&whole.summary()["motion"]["rounding"])
        );
        resume(&out, &[]).expect(2).says(&["no checkpoint", "[motion]"]);
    }
}

#[test]
fn files_of_points_and_of_sets_are_part_of_what_is_run() {
    let folder = SceneFolder::new(
        "[body]\ndimension = 2\npoints = \"points.csv\"\n[horizon]\nradius = 1.5\n[material]\n\
         potential = \"javili2020\"\nparameters = { C1 = 1 }\n[sets]\nheld = { numbers = \"held.txt\" }\n\
         [[prescribe]]\nset = \"held\"\nu = [0, 0]\n[steps]\nincrements = 1\n",
    );
    let mut hashes = std::collections::BTreeSet::new();
    let points = ["0,0,1\n1,0,1\n0,1,1\n", "0,0,1\n1,0,1\n0,1,1.5\n"];
    for (rows, held) in
        [(points[0], "1 2"), (points[1], "1 2"), (points[0], "1 3"), (points[0], "1 2")]
    {
        folder.file("points.csv", format!("x,y,volume\n{rows}"));
        folder.file("held.txt", held);
        folder.run(&["--force"]).expect(0);
        hashes.insert(folder.summary()["scene_hash"].to_string());
    }
    assert_eq!(hashes.len(), 3, "{hashes:?}");
}

/// A run that was ended at its first checkpoint.
fn interrupted() -> SceneFolder {
    let folder = scene();
    let mut child = start(&["run", &folder.scene(), "--out", &folder.path("out")]);
    wait_for_checkpoint(&mut child, &folder.out());
    signal(&child, "-INT");
    assert_eq!(child.wait().unwrap().code(), Some(130));
    folder
}

#[test]
fn what_is_no_longer_the_same_run_is_refused_and_nothing_is_touched() {
    let folder = interrupted();
    let out = folder.out();
    folder.run(&[]).expect(2).says(&["not empty", "--resume"]);
    let rows = fs::read(out.join("motion.csv")).unwrap();
    let text = fs::read_to_string(folder.scene()).unwrap();
    fs::write(folder.scene(), text.replace("C1 = 1e9", "C1 = 2e9")).unwrap();
    resume(&out, &[]).expect(2).says(&["has changed", "--force"]);
    // The scene may stand elsewhere now.
    let moved = folder.file("moved.toml", &text);
    fs::remove_file(folder.scene()).unwrap();
    resume(&out, &[]).expect(2).says(&["scene.toml"]);
    assert_eq!(fs::read(out.join("motion.csv")).unwrap(), rows);
    for options in [["--out", "elsewhere"], ["--set", "motion.end=1"]] {
        resume(&out, &options).expect(2).says(&["cannot be used with"]);
    }
    // A table that was cut, and a checkpoint that was.
    fs::write(out.join("motion.csv"), &rows[..40]).unwrap();
    resume(&out, &[&moved]).expect(2).says(&["motion.csv", "changed since"]);
    fs::write(out.join("motion.csv"), &rows).unwrap();
    let checkpoint = fs::read(out.join("checkpoint.bin")).unwrap();
    fs::write(out.join("checkpoint.bin"), &checkpoint[..checkpoint.len() - 1]).unwrap();
    resume(&out, &[&moved]).expect(2).says(&["checkpoint.bin", "damaged"]);
    fs::write(out.join("checkpoint.bin"), &checkpoint).unwrap();
    #[cfg(unix)]
    {
        let (frames, kept) = (out.join("frames"), out.join("kept"));
        fs::rename(&frames, &kept).unwrap();
        std::os::unix::fs::symlink(&kept, &frames).unwrap();
        resume(&out, &[&moved]).expect(2).says(&["frames", "not a folder"]);
        fs::remove_file(&frames).unwrap();
        fs::rename(&kept, &frames).unwrap();
    }
    resume(&out, &[&moved]).expect(0);
}

#[test]
fn there_must_be_something_to_go_on_from() {
    let folder = SceneFolder::new(STRIP);
    resume(&folder.out(), &[]).expect(2).says(&["out"]);
    folder.run(&[]).expect(0);
    resume(&folder.out(), &[]).expect(2).says(&["no checkpoint"]);
    piola(&["run"]).expect(2).says(&["SCENE"]);
}

/// Interrupts a run of this scene at its first checkpoint and takes it up.
fn interrupt_once(text: &str) {
    let whole = SceneFolder::new(text);
    whole.run(&[]).expect(0);
    let folder = SceneFolder::new(text);
    let mut child = start(&["run", &folder.scene(), "--out", &folder.path("out")]);
    wait_for_checkpoint(&mut child, &folder.out());
    signal(&child, "-INT");
    assert_eq!(child.wait().unwrap().code(), Some(130));
    resume(&folder.out(), &[]).expect(0);
    are_the_same(&whole.out(), &folder.out());
}

/// Steps of the implicit rule are long: one that is under way is given up. Parameters may change with time.
#[test]
fn an_implicit_run_that_is_interrupted_goes_on_with_the_same_bits() {
    let text = THROWN.replace("[motion]", "[motion]\nmethod = \"midpoint\"");
    let text = text.replace("end = 0.5", "end = 4.0").replace("rows = 50", "rows = 7");
    let text = text.replace("frames = 5", "frames = 3\ncheckpoint = 2e-3");
    interrupt_once(&text);
    interrupt_once(&text.replace("C1 = 1e9", "C1 = \"1e9*(1 + t)\""));
}

#[test]
fn a_run_whose_parameters_change_goes_on_with_the_same_bits() {
    let text =
        THROWN.replace("end = 0.5", "end = 4.0").replace("C1 = 1e9", "C1 = \"1e9*(2 - t/8)\"");
    interrupt_once(&text.replace("rows = 50", "rows = 300\ncheckpoint = 2e-3"));
}

/// In the middle of a crack: which bonds are broken is part of where a motion stands.
#[test]
fn a_crack_that_is_interrupted_goes_on_with_the_same_bits() {
    let scene = || {
        let text = TORN.replace("spacing = 0.05", "spacing = 0.02").replace("0.05\"", "0.02\"");
        let folder = SceneFolder::new(&text.replace("rows = 40", "rows = 40\ncheckpoint = 2e-3"));
        folder.file("brittle.piola", crate::fracture::BRITTLE);
        folder
    };
    let whole = scene();
    let begin = Instant::now();
    whole.run(&[]).expect(0);
    let time = begin.elapsed();
    for part in [0.3, 0.5, 0.6, 0.7, 0.8] {
        let folder = scene();
        let mut child = start(&["run", &folder.scene(), "--out", &folder.path("out")]);
        wait_for_checkpoint(&mut child, &folder.out());
        std::thread::sleep(time.mul_f64(part));
        signal(&child, "-KILL");
        child.wait().unwrap();
        if folder.out().join("checkpoint.bin").exists() {
            resume(&folder.out(), &[]).expect(0);
        }
        are_the_same(&whole.out(), &folder.out());
    }
}
