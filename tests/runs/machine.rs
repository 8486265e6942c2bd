//! What the program knows of the machine that it runs on, and where it keeps it.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::scenes::strip;
use crate::support::{Outcome, command, number, numbers, piola, run_to_end};

/// `piola info --machine` with this folder for caches.
fn info(caches: &Path, more: &[&str]) -> Command {
    let mut command = command(&[&["info", "--machine"], more].concat());
    command.env("XDG_CACHE_HOME", caches);
    command
}

fn shown(command: Command) -> Outcome {
    let shown = run_to_end(command, b"").expect(0);
    for part in ["memory", "GB/s", "arithmetic", "multiply-adds per s", "factorising", "1 thread"] {
        assert!(shown.stdout.contains(part), "no `{part}` in\n{}", shown.stdout);
    }
    shown
}

fn read(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

#[test]
fn a_machine_is_measured_once_and_when_told() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("piola/machine.json");
    assert!(shown(info(folder.path(), &[])).stdout.contains("measured now, and kept in"));
    let mut machine = read(&file);
    // A rate that no machine has shows that the file is believed.
    machine["one"]["bandwidth"] = 123456.7e9.into();
    std::fs::write(&file, machine.to_string()).unwrap();
    let kept = shown(info(folder.path(), &[])).stdout;
    assert!(kept.contains("123456.7") && !kept.contains("measured now"), "{kept}");
    assert_eq!(read(&file), machine);
    assert!(!shown(info(folder.path(), &["--renew"])).stdout.contains("123456.7"));
    assert!(number(&read(&file)["one"]["bandwidth"]) < 1e14);
    // Of another processor: measured again without being told.
    machine["processor"] = "abacus".into();
    std::fs::write(&file, machine.to_string()).unwrap();
    assert!(shown(info(folder.path(), &[])).stdout.contains("measured now"));
    assert_ne!(read(&file)["processor"], "abacus");
}

#[test]
fn two_processes_measure_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let both = std::thread::scope(|scope| {
        let one = || shown(info(folder.path(), &["--renew"])).stdout;
        [scope.spawn(one), scope.spawn(one)].map(|thread| thread.join().unwrap())
    });
    assert!(both.iter().all(|text| text.contains("and kept in")), "{both:?}");
    let names = std::fs::read_dir(folder.path().join("piola")).unwrap();
    let names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["machine.json"]);
    assert!(shown(info(folder.path(), &[])).stdout.contains("\nkept in"));
}

#[test]
fn without_a_place_nothing_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "no folder").unwrap();
    assert!(shown(info(&file, &[])).stdout.contains("measured now, and not kept: cannot write"));
    let mut homeless = info(Path::new("relative"), &[]);
    homeless.env_remove("HOME");
    assert!(shown(homeless).stdout.contains("neither XDG_CACHE_HOME nor HOME"));
    let mut at_home = info(Path::new(""), &[]);
    at_home.env("HOME", folder.path());
    assert!(shown(at_home).stdout.contains(".cache"));
    assert!(folder.path().join(".cache/piola/machine.json").exists());
}

#[test]
fn what_means_nothing_is_refused() {
    piola(&["info", "--renew"]).expect(2).says(&["--machine"]);
    piola(&["info", "--machine", "firooz2023"]).expect(2).says(&["cannot be used with"]);
}

/// The file of the tests may be of a busy machine, and the passes of an idle one.
#[test]
fn shares_are_what_passes_do_over_what_the_machine_could() {
    let folder = strip();
    let scene = folder.scene();
    for settings in [&[][..], &["--set", "solver.linear=\"matrix-free\""]] {
        let arguments = [&["bench", &scene, "--format", "json"], settings].concat();
        let found = piola(&arguments).expect(0).json();
        let (rates, passes) = (&found["rates"], found["passes"].as_array().unwrap());
        assert_eq!(found["ways"], serde_json::json!(["compiled batches", "fours"]));
        for pass in passes {
            let could = |rate: &str| number(&rates[rate]) * number(&pass["seconds"]);
            for (work, share, rate) in [
                ("bytes", "share_of_bandwidth", "bandwidth"),
                ("multiply_adds", "share_of_arithmetic", "arithmetic"),
            ] {
                let share = number(&pass[share]);
                assert!((share * could(rate) / number(&pass[work]) - 1.0).abs() < 1e-9, "{pass}");
                assert!(share > 0.0 && share < 50.0, "{pass}");
            }
        }
        // Nothing of the tangent is read twice, nor anything left out.
        let bytes = |pass: usize| number(&passes[pass]["bytes"]);
        let vector = 16.0 * number(&found["points"]);
        assert_eq!(bytes(1) - bytes(0), vector);
        if settings.is_empty() {
            assert_eq!(bytes(2) - bytes(1), number(&found["matrix_bytes"]));
        } else {
            assert_eq!(bytes(3) - bytes(1), vector);
        }
        let [bonds, triangles, _] = numbers(&found["interactions"])[..] else { panic!("{found}") };
        // In the plane a triangle's area and its change take eleven products, a bond's length ten.
        assert_eq!(number(&passes[0]["multiply_adds"]), 11.0 * triangles + 10.0 * bonds);
    }
}

#[test]
fn the_way_is_that_of_the_scene() {
    let folder = strip();
    let arguments = ["bench", &folder.scene(), "--set", "solver.derivatives=interpreter"];
    let text = piola(&arguments).expect(0).stdout;
    assert!(text.contains("\nby interpreter batches; at least"), "{text}");
}
