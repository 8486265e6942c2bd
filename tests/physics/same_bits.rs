//! The same run in other ways: any number of threads, other sources of derivatives.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{distance, json_file, number, piola, table};

/// A run of an example with overrides; where its files are.
fn run(example: &str, overrides: &[&str], threads: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = format!("examples/{example}/scene.toml");
    let threads = threads.to_string();
    let out = folder.path().to_str().unwrap();
    let mut arguments = vec!["run", &scene, "--out", out, "--threads", &threads];
    for setting in overrides {
        arguments.extend(["--set", setting]);
    }
    piola(&arguments).expect(0);
    folder
}

/// All files of a folder with their content.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let inner = files(&path).into_iter();
            found.extend(inner.map(|(file, content)| (format!("{name}/{file}"), content)));
        } else {
            found.insert(name, fs::read(path).unwrap());
        }
    }
    found
}

/// The summary without what depends on the machine and its load.
fn summary(folder: &Path) -> Value {
    let mut summary = json_file(&folder.join("summary.json"));
    let fields = summary.as_object_mut().unwrap();
    for measured in ["threads", "wall_seconds", "phases", "peak_memory_bytes"] {
        assert!(fields.shift_remove(measured).is_some(), "{measured}");
    }
    summary
}

/// Fails unless two runs left the same files with the same bytes, the named ones left out.
fn assert_same_files(a: &Path, b: &Path, different: &[&str]) {
    let (mut a, mut b) = (files(a), files(b));
    for name in different {
        assert!(a.remove(*name).is_some() && b.remove(*name).is_some(), "{name}");
    }
    let names: Vec<&String> = a.keys().collect();
    assert_eq!(names, b.keys().collect::<Vec<_>>());
    assert!(names.iter().any(|name| name.ends_with(".vtu")));
    assert!(names.iter().any(|name| name.ends_with(".png")));
    for (name, content) in &a {
        assert!(*content == b[name], "{name} differs");
    }
}

/// A coarse version of the first example that still has a hole, triangles and some load steps.
const FIRST: [&str; 3] =
    ["body.spacing=0.03333333333333333", "steps.end=0.3", "steps.increments=3"];
/// A small cube with bonds and tetrahedra.
const CUBE: [&str; 3] = ["body.spacing=0.125", "steps.end=0.12", "steps.increments=3"];

fn compare_thread_counts(example: &str, overrides: &[&str]) {
    let one = run(example, overrides, 1);
    for threads in [2, 4] {
        let more = run(example, overrides, threads);
        assert_same_files(one.path(), more.path(), &["summary.json"]);
        assert_eq!(summary(one.path()), summary(more.path()), "{threads} threads");
    }
}

#[test]
fn threads_do_not_change_a_sheet() {
    compare_thread_counts("first", &FIRST);
}

#[test]
fn threads_do_not_change_a_cube_with_a_factorisation() {
    compare_thread_counts("cube_C1_C3", &[&CUBE[..], &["solver.linear=cholesky"]].concat());
}

#[test]
fn threads_do_not_change_a_cube_with_conjugate_gradients() {
    compare_thread_counts("cube_C1_C3", &[&CUBE[..], &["solver.linear=cg"]].concat());
}

#[test]
fn the_interpreter_runs_as_machine_code_does() {
    let source = |source: &str| {
        let setting = format!("solver.derivatives={source}");
        run("first", &[&FIRST[..], &["solver.level=strict", &setting]].concat(), 2)
    };
    let (compiled, interpreted) = (source("jit"), source("interpreter"));
    // These name the source.
    let different = ["summary.json", "scene.resolved.toml"];
    assert_same_files(compiled.path(), interpreted.path(), &different);
    let [a, b] = [&compiled, &interpreted].map(|run| summary(run.path())["steps"].clone());
    assert_eq!(a, b);
    assert_eq!(a.as_array().unwrap().len(), 3);
}

#[test]
fn hyper_dual_numbers_run_to_the_same_equilibria() {
    // The tolerance of the residual is 1e-10, reached quadratically: what is left is rounding.
    const DISPLACEMENTS: f64 = 1e-12;
    const ENERGIES: f64 = 1e-13;
    let compiled = run("first", &FIRST, 2);
    for source in ["hyperdual", "hyperdual-coordinates"] {
        let setting = format!("solver.derivatives={source}");
        let dual = run("first", &[&FIRST[..], &[&setting]].concat(), 2);
        let displacement = |run: &tempfile::TempDir| {
            let (header, rows) = table(&run.path().join("displacement.csv"));
            assert_eq!(header, ["X", "Y", "u", "v"]);
            rows.iter().flat_map(|row| row[2..].to_vec()).collect::<Vec<f64>>()
        };
        let error = distance(&displacement(&dual), &displacement(&compiled));
        println!("{source}: displacements {error:.1e}");
        assert!(error <= DISPLACEMENTS, "{source}: {error:e}");
        let [a, b] = [&dual, &compiled].map(|run| summary(run.path())["steps"].clone());
        for (a, b) in a.as_array().unwrap().iter().zip(b.as_array().unwrap()) {
            assert_eq!(a["iterations"], b["iterations"]);
            let error = (number(&a["energy"]) / number(&b["energy"]) - 1.0).abs();
            assert!(error <= ENERGIES, "{source}: energy {error:e}");
        }
    }
}
