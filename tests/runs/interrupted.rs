//! Signals, and two runs in one folder.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use crate::scenes::STRIP;
use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{SceneFolder, command, json_file, number, table};

/// A strip with more steps than any test waits for.
fn endless() -> SceneFolder {
    SceneFolder::new(
        &STRIP
            .replace("increments = 4", "increments = 1000000")
            .replace("frames = 4", "frames = 1000"),
    )
}

/// A cube whose first iteration takes longer than any test waits for.
fn laborious() -> SceneFolder {
    SceneFolder::new(
        r#"
[body]
dimension = 3
box = [[0, 0, 0], [8, 1, 1]]
spacing = 0.05
[horizon]
spacings = 3
[material]
potential = "javili2020"
parameters = { C1 = 1.0 }
[sets]
left = "X < 0.15"
right = "X > 7.85"
[[prescribe]]
set = "left"
u = [0, 0, 0]
[[prescribe]]
set = "right"
u = ["t", 0, 0]
[solver]
linear = "matrix-free"
tolerance = 1e-13
"#,
    )
}

fn start(folder: &SceneFolder, more: &[&str]) -> Child {
    let (scene, out) = (folder.scene(), folder.path("out"));
    let arguments = [&["run", &scene, "--out", &out], more].concat();
    let mut command = command(&arguments);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args([name, &child.id().to_string()]).status().unwrap();
    assert!(status.success());
}

/// Waits until the run says something like this, and gives back where it goes on speaking.
fn wait_for(child: &mut Child, part: &str) -> BufReader<std::process::ChildStderr> {
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut said = String::new();
    while !said.contains(part) {
        let before = said.len();
        stderr.read_line(&mut said).unwrap();
        assert!(said.len() > before, "the run ended without `{part}`:\n{said}");
    }
    stderr
}

fn no_leftovers(out: &Path) {
    let below = |folder: &Path| fs::read_dir(folder).unwrap();
    for entry in below(out).chain(below(&out.join("frames"))) {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(!name.starts_with('.'), "{name}");
    }
}

#[test]
fn a_signal_ends_a_run_in_good_order() {
    for (name, code) in [("-INT", 130), ("-TERM", 143)] {
        let folder = endless();
        let mut child = start(&folder, &[]);
        let mut rest = wait_for(&mut child, "t = 0.000005");
        signal(&child, name);
        let mut said = String::new();
        rest.read_to_string(&mut said).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(code), "{said}");
        assert!(said.contains("interrupted") && said.contains("are in"), "{said}");
        let out = folder.out();
        let summary = json_file(&out.join("summary.json"));
        assert_eq!(summary["exit_reason"], "interrupted");
        let steps = summary["steps"].as_array().unwrap();
        assert!(steps.len() >= 5, "{}", steps.len());
        let last = number(&steps.last().unwrap()["t"]);
        assert!((last - 1e-6 * steps.len() as f64).abs() < 1e-12);
        assert!(summary["exit_message"].as_str().unwrap().contains(&last.to_string()));
        assert_eq!(table(&out.join("energy.csv")).1.len(), steps.len());
        assert_eq!(table(&out.join("displacement.csv")).1.len(), 55);
        for (_, file) in read_pvd(&fs::read_to_string(out.join("run.pvd")).unwrap()).unwrap() {
            read_vtu(&out.join(file)).unwrap();
        }
        assert!(out.join("picture.png").exists() && out.join("picture.svg").exists());
        no_leftovers(&out);
    }
}

/// Neither the first step nor its first linear system are done when the signal comes, and the run
/// has spoken already.
#[test]
fn a_signal_ends_a_step() {
    let folder = laborious();
    let mut child = start(&folder, &[]);
    let mut rest = wait_for(&mut child, " products");
    let begin = Instant::now();
    signal(&child, "-INT");
    let mut said = String::new();
    rest.read_to_string(&mut said).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
    let summary = json_file(&folder.out().join("summary.json"));
    assert_eq!(summary["exit_reason"], "interrupted");
    assert_eq!(summary["steps"].as_array().unwrap().len(), 0, "{:?}", begin.elapsed());
    no_leftovers(&folder.out());
}

#[test]
fn a_second_signal_ends_a_run_at_once() {
    let folder = endless();
    let mut child = start(&folder, &[]);
    let rest = wait_for(&mut child, "t = 0.000005");
    signal(&child, "-INT");
    // The first is heard when it is answered; until then both may be taken for one.
    let mut lines = rest.lines();
    while !lines.next().unwrap().unwrap().starts_with("interrupted: ") {}
    signal(&child, "-TERM");
    let code = child.wait().unwrap().code();
    // The run may have been done with writing.
    assert!(code == Some(143) || code == Some(130), "{code:?}");
    no_leftovers(&folder.out());
}

#[test]
fn one_run_at_a_time_writes_into_a_folder() {
    let folder = endless();
    let mut first = start(&folder, &[]);
    let mut rest = wait_for(&mut first, "t = 0.000003");
    for more in [&["--force"][..], &[]] {
        folder.run(more).expect(2).says(&["another run", "another folder"]);
    }
    signal(&first, "-INT");
    let mut said = String::new();
    rest.read_to_string(&mut said).unwrap();
    assert_eq!(first.wait().unwrap().code(), Some(130));
    folder.run(&[]).expect(2).says(&["not empty"]);
    assert_eq!(folder.summary()["exit_reason"], "interrupted");
}

/// Without `--force` one of two runs that begin at once gets the folder.
#[test]
fn of_runs_that_begin_together_one_goes_on() {
    let folder = SceneFolder::new(STRIP);
    let mut runs: Vec<Child> = (0..6).map(|_| start(&folder, &[])).collect();
    let codes: Vec<Option<i32>> = runs.iter_mut().map(|run| run.wait().unwrap().code()).collect();
    let done = codes.iter().filter(|code| **code == Some(0)).count();
    let refused = codes.iter().filter(|code| **code == Some(2)).count();
    assert_eq!((done, refused), (1, 5), "{codes:?}");
    assert_eq!(folder.summary()["exit_reason"], "completed");
    no_leftovers(&folder.out());
}
