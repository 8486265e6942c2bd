//! Streams that are closed, full or no terminal.

use std::fs::{self, File};
use std::process::{Output, Stdio};

use crate::scenes::strip;
use crate::support::{command, json_file, piola};

/// What `/dev/full` answers to every write.
const FULL: &str = "No space left on device";

fn full() -> Stdio {
    File::options().write(true).open("/dev/full").expect("Linux has /dev/full").into()
}

/// A pipe whose reader has gone.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

#[test]
fn a_run_does_not_care_where_its_messages_go() {
    for stream in [closed, full] {
        let folder = strip();
        let (scene, out) = (folder.scene(), folder.path("out"));
        let mut command = command(&["run", &scene, "-o", &out, "-v"]);
        let status = command.stdout(stream()).stderr(stream()).status().unwrap();
        assert_eq!(status.code(), Some(0));
        let summary = json_file(&folder.out().join("summary.json"));
        assert_eq!(summary["exit_reason"], "completed");
        assert_eq!(summary["steps"].as_array().unwrap().len(), 4);
        assert!(folder.out().join("picture.png").exists());
    }
}

#[test]
fn data_on_a_full_disk_are_an_error_and_a_reader_that_has_enough_is_none() {
    let folder = strip();
    let scene = folder.scene();
    let points = folder.file("points.csv", "l,L\n1.1,1\n");
    let wrong = folder.file("wrong.piola", "potential p\nenergy psi(l) = l +\n");
    let commands: [&[&str]; 14] = [
        &["energy", &scene],
        &["eval", "firooz2023", "--measure", "l", "--set", "C1=1", "--points", &points],
        &["derive", "firooz2023"],
        &["moduli", &scene],
        &["audit", "firooz2023", "--points", "2"],
        &["check", "--format", "json", &wrong],
        &["verify", "javili2020", "--points", "20"],
        &["plan", &scene],
        &["info"],
        &["explain"],
        &["completions", "bash"],
        &["trade", "--list", &scene],
        &["calibrate", &scene, "--target", "E=1", "--vary", "C1"],
        &["--help"],
    ];
    for arguments in commands {
        let run = |stdout: Stdio| -> Output {
            command(arguments).stdout(stdout).stderr(Stdio::piped()).output().unwrap()
        };
        let usual = run(Stdio::piped());
        assert!(!usual.stdout.is_empty(), "{arguments:?} writes data");
        let gone = run(closed());
        assert_eq!(gone.status.code(), usual.status.code(), "{arguments:?}");
        let cut = run(full());
        let message = String::from_utf8(cut.stderr).unwrap();
        assert_eq!(cut.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(FULL), "{arguments:?}: {message}");
    }
}

#[test]
fn a_run_says_as_much_as_it_is_asked_to() {
    let folder = strip();
    let lines = |more: &[&str]| -> Vec<String> {
        let outcome = folder.run(&[&["--force"], more].concat()).expect(0);
        assert!(!outcome.stderr.contains('\u{1b}'), "no colours in a pipe: {}", outcome.stderr);
        let lines = outcome.stderr.lines().filter(|line| !line.starts_with("note: "));
        lines.map(str::to_owned).collect()
    };
    assert_eq!(lines(&["-q"]), Vec::<String>::new());
    let usual = lines(&[]);
    assert_eq!(usual.len(), 5, "a line per step and one at the end: {usual:?}");
    let verbose = lines(&["--verbose"]);
    let iterations = verbose.iter().filter(|line| line.contains(": iteration ")).count();
    let steps = folder.summary()["steps"].clone();
    let expected: usize = steps
        .as_array()
        .unwrap()
        .iter()
        .map(|step| step["residual"].as_array().unwrap().len())
        .sum();
    assert_eq!(iterations, expected, "{verbose:?}");
    assert_eq!(verbose.len(), usual.len() + iterations);
    piola(&["run", "-q", "-v", &folder.scene(), "-o", &folder.path("out")]).expect(2);
}

#[test]
fn colours_are_there_when_asked_for() {
    let folder = strip();
    let wrong = folder.file("wrong.piola", "potential p\nenergy psi(l) = l +\n");
    let colours = |more: &[&str]| {
        let arguments = [&["check", &wrong], more].concat();
        piola(&arguments).expect(1).stderr.contains('\u{1b}')
    };
    assert!(!colours(&[]));
    assert!(colours(&["--color", "always"]));
    assert!(!colours(&["--color", "never"]));
}

#[test]
fn cut_backs_are_told_with_their_reason() {
    let folder = strip();
    let outcome =
        folder.run(&["--set", "steps.increments=1", "--set", "solver.max_iterations=2"]).expect(0);
    let told = outcome.stderr.lines().find(|line| line.contains("half the increment is tried"));
    let told = told.unwrap_or_else(|| panic!("no cut-back is told:\n{}", outcome.stderr));
    assert!(told.starts_with("t = 1.000000: no convergence in 2 iterations"), "{told}");
    fs::metadata(folder.out().join("summary.json")).unwrap();
}
