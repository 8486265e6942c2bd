//! `piola sweep`: one scene for many values.

use crate::support::{SceneFolder, command, json_file, piola, repository};

const PLATE: &str = "[body]\nbox = [[0.0, 0.0], [1.0, 0.5]]\nspacing = 0.1\n[horizon]\nspacings = 3\n\
    [material]\npotential = \"javili2020\"\nparameters = { C1 = 1.0, C2 = 0.0 }\n\
    [sets]\nleft = \"X < 0.1\"\nright = \"X > 0.9\"\n[[prescribe]]\nset = \"left\"\nu = [0, 0]\n\
    [[prescribe]]\nset = \"right\"\nu = [\"0.1*t\", 0]\n[[probe]]\nname = \"middle\"\n\
    at = [0.55, 0.45]\n[steps]\nincrements = 2\n";

fn sweep(folder: &SceneFolder, more: &[&str]) -> crate::support::Outcome {
    let scene = folder.scene();
    piola(&[&["sweep", scene.as_str()], more].concat())
}

/// The columns of a table in CSV, without those of time.
fn numbers(text: &str) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let heads = reader.headers().unwrap().clone();
    let rows = reader.records().map(|row| {
        let row = row.unwrap();
        let fields = row.iter().zip(heads.iter()).filter(|(_, head)| *head != "seconds");
        fields.map(|(field, _)| field.to_string()).collect()
    });
    rows.collect()
}

#[test]
fn every_value_is_the_run_that_it_would_be_alone() {
    let folder = SceneFolder::new(PLATE);
    let csv = |threads: &str| {
        let more = ["--vary", "C1=1:3:5", "--format", "csv", "--threads", threads];
        sweep(&folder, &more).expect(0).stdout
    };
    let (one, two) = (csv("1"), csv("2"));
    assert_eq!(numbers(&one), numbers(&two));
    assert!(
        one.starts_with("material.parameters.C1,energy,left_x,left_y,right_x,right_y,"),
        "{one}"
    );
    let rows = numbers(&one);
    let values: Vec<&str> = rows.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(values, ["1", "1.5", "2", "2.5", "3"]);
    for row in &rows {
        folder.run(&["--force", "--set", &format!("material.parameters.C1={}", row[0])]).expect(0);
        let (heads, table) = crate::support::table(&folder.out().join("reactions.csv"));
        let place = heads.iter().position(|head| head == "right_x").unwrap();
        assert_eq!(row[4].parse::<f64>().unwrap(), table.last().unwrap()[place]);
    }
}

#[test]
fn a_study_leaves_a_table_a_summary_and_a_picture() {
    let folder = SceneFolder::new(PLATE);
    let out = folder.path("study");
    let vary = ["--vary", "body.spacing=0.1,0.05", "--vary", "C1=1,2"];
    let found = sweep(&folder, &[&vary[..], &["--out", &out]].concat()).expect(0);
    assert!(found.stdout.contains("4 of 4 runs reached their end"), "{}", found.stdout);
    assert!(found.stderr.contains("sweep.png"), "{}", found.stderr);
    let study = json_file(&std::path::Path::new(&out).join("sweep.json"));
    assert_eq!(study["rows"].as_array().unwrap().len(), 4);
    assert_eq!(study["rows"][1]["values"]["body.spacing"], "0.1");
    assert_eq!(study["units"]["middle_v"], "m");
    assert!(study["rows"][3]["found"]["energy"].as_f64().unwrap() > 0.0);
    let svg = std::fs::read_to_string(std::path::Path::new(&out).join("sweep.svg")).unwrap();
    assert!(svg.contains("C1 2") && svg.contains("reaction right_x"));
    // What is there stays, unless it is replaced.
    sweep(&folder, &[&vary[..], &["--out", &out]].concat()).expect(2);
    sweep(&folder, &[&vary[..], &["--out", &out, "--force", "-q"]].concat()).expect(0);
}

#[test]
fn values_that_lead_nowhere_are_rows() {
    let folder = SceneFolder::new(PLATE);
    let found = sweep(&folder, &["--vary", "C1=1,-1", "--format", "json"]).expect(2).json();
    assert_eq!(found["rows"][0]["state"], "reached");
    assert_eq!(found["rows"][1]["state"], "refused");
    assert!(found["rows"][1]["message"].as_str().unwrap().contains("C1"));
    let few = ["--set", "solver.max_iterations=4"];
    let found = sweep(&folder, &[&["--vary", "solver.tolerance=1e-3,1e-19"], &few[..]].concat());
    let found = found.expect(3);
    assert!(found.stdout.contains("not converged"), "{}", found.stdout);
    sweep(&folder, &["--vary", "C7=1,2"]).expect(2).says(&["no parameter `C7`"]);
    sweep(&folder, &["--vary", "C1"]).expect(2).says(&["`C1` varies nothing", "C2=0:200:10"]);
    sweep(&folder, &["--vary", "C1=0:1:2000", "--vary", "C2=0:1:2000"])
        .expect(2)
        .says(&["4000000 runs", "fewer values"]);
    sweep(&folder, &[]).expect(2).says(&["--vary"]);
}

/// Motions have their peaks, and what broke.
#[test]
fn bodies_that_break_say_how() {
    let scene = repository("examples/areas_that_fail/scene.toml");
    let scene = scene.to_str().unwrap();
    let short = ["--set", "motion.end=2e-5", "--vary", "material.density=2000,2440"];
    let found = piola(&[&["sweep", scene, "--format", "csv"], &short[..]].concat()).expect(0);
    let heads = found.stdout.lines().next().unwrap();
    for column in ["kinetic", "broken_bonds", "released", "peak_"] {
        assert!(heads.contains(column), "{heads}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_study_keeps_what_has_ended() {
    use std::process::Stdio;
    let folder = SceneFolder::new(&PLATE.replace("spacing = 0.1", "spacing = 0.01"));
    let out = folder.path("study");
    let scene = folder.scene();
    let arguments =
        ["sweep", &scene, "--vary", "steps.increments=1,400,401", "--out", &out, "--threads", "1"];
    let mut child = command(&arguments);
    let child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let table = std::path::Path::new(&out).join("sweep.csv");
    let patience = std::time::Instant::now();
    while !table.exists() && patience.elapsed().as_secs() < 120 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let killed = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    let rows = numbers(&std::fs::read_to_string(&table).unwrap());
    let states: Vec<&str> = rows.iter().map(|row| row[row.len() - 2].as_str()).collect();
    assert_eq!(states[0], "reached");
    assert_eq!(states[2], "interrupted");
}
