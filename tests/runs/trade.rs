//! `piola trade`: what it writes, what it says, and that the parts agree.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::scenes::{STRIP, strip, strip_with};
use crate::support::{Outcome, SceneFolder, json_file, number, piola};

/// `piola trade` of a scene into its output folder, quickly.
#[track_caller]
fn trade(scene: &SceneFolder, more: &[&str]) -> Outcome {
    let (path, out) = (scene.scene(), scene.path("out"));
    let mut arguments = vec!["trade", &path, "--out", &out, "--repeats", "3"];
    arguments.extend_from_slice(more);
    piola(&arguments)
}

fn settings(summary: &Value) -> BTreeMap<String, Value> {
    let settings = summary["settings"].as_array().unwrap().iter();
    settings.map(|s| (s["name"].as_str().unwrap().to_owned(), s.clone())).collect()
}

#[test]
fn files_table_and_verdict_agree() {
    let scene = strip();
    let table = trade(&scene, &[]).expect(0).stdout;
    let summary = json_file(&scene.out().join("trade.json"));
    let settings = settings(&summary);
    assert!(settings.len() > 15, "{:?}", settings.keys());

    // The CSV has a row for each setting, with the numbers of the JSON.
    let mut csv = csv::Reader::from_path(scene.out().join("trade.csv")).unwrap();
    let header: Vec<String> = csv.headers().unwrap().iter().map(str::to_owned).collect();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let rows: Vec<csv::StringRecord> = csv.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), settings.len());
    for row in &rows {
        let setting = &settings[&row[0]];
        assert!(table.contains(&row[0]), "{} is not in the table", &row[0]);
        if setting.get("failed").is_some() {
            assert_eq!(&row[column("standing")], "failed");
            assert!(!row[column("reason")].is_empty());
            continue;
        }
        for (name, key) in [("median_s", "median_seconds"), ("worst", "worst"), ("runs", "runs")] {
            assert_eq!(row[column(name)].parse::<f64>().unwrap(), number(&setting[key]), "{name}");
        }
        let times = ["min_seconds", "median_seconds", "max_seconds"].map(|k| number(&setting[k]));
        assert!(0.0 < times[0] && times[0] <= times[1] && times[1] <= times[2], "{times:?}");
        // The worst error is that of the worst quantity, the residual left out.
        let errors = setting["errors"].as_object().unwrap();
        let quantities = ["energy", "reaction:left", "reaction:right", "probe:middle", "residual"];
        assert!(errors.keys().eq(quantities), "{errors:?}");
        let worst = quantities[..4].iter().map(|q| number(&errors[*q])).fold(0.0, f64::max);
        assert_eq!(worst, number(&setting["worst"]));
    }
    check_standings(&settings, number(&summary["reference"]["rounding_level"]));
    check_verdict(&summary, &settings, &table);

    for name in ["trade.svg", "trade.png"] {
        let bytes = std::fs::read(scene.out().join(name)).unwrap();
        assert!(bytes.len() > 1000, "{name}");
    }
    let svg = std::fs::read_to_string(scene.out().join("trade.svg")).unwrap();
    for (name, setting) in &settings {
        if setting["standing"] == "front" {
            assert!(svg.contains(name.as_str()), "{name} is not named in the picture");
        }
    }
    assert!(svg.contains("discretisation"));
    let mut names: Vec<_> = std::fs::read_dir(scene.out()).unwrap().collect();
    assert_eq!(names.drain(..).count(), 4);
}

/// Who is called dominated is, by a setting that is faster in all runs; the front is not.
fn check_standings(settings: &BTreeMap<String, Value>, level: f64) {
    let error = |s: &Value| number(&s["worst"]).max(level);
    let time = |s: &Value| number(&s["median_seconds"]);
    let done = || settings.values().filter(|s| s.get("failed").is_none());
    let mut front = 0;
    for setting in done() {
        match setting["standing"].as_str().unwrap() {
            "dominated" => {
                let by = &settings[setting["dominated_by"].as_str().unwrap()];
                assert!(number(&by["max_seconds"]) < number(&setting["min_seconds"]));
                assert!(error(by) <= error(setting));
            }
            "front" => {
                front += 1;
                for other in done() {
                    let ahead = time(other) < time(setting) && error(other) < error(setting);
                    assert!(!ahead, "{} is ahead of {}", other["name"], setting["name"]);
                }
            }
            standing => assert_eq!(standing, "near"),
        }
    }
    assert!(front >= 1);
}

/// The recommended setting meets the demand, nothing cheaper does, and its table can be used.
fn check_verdict(summary: &Value, settings: &BTreeMap<String, Value>, table: &str) {
    let limits = summary["discretisation"]["errors"].as_object().unwrap();
    let is_hidden = |setting: &Value| {
        let known = limits.iter().filter(|(_, limit)| !limit.is_null());
        known
            .into_iter()
            .all(|(name, limit)| number(&setting["errors"][name]) <= 0.1 * number(limit))
    };
    let verdict = &summary["verdict"];
    let cheapest = &settings[verdict["cheapest"].as_str().unwrap()];
    assert!(is_hidden(cheapest));
    for setting in settings.values().filter(|s| s.get("failed").is_none()) {
        if number(&setting["median_seconds"]) < number(&cheapest["median_seconds"]) {
            assert!(!is_hidden(setting), "{} is cheaper", setting["name"]);
        }
    }
    let toml = verdict["solver"].as_str().unwrap();
    assert!(toml.starts_with("[solver]\n") && table.contains(toml), "{toml}");
    SceneFolder::new(&format!("{STRIP}{toml}")).run(&[]).expect(0);
}

#[test]
fn the_reference_setting_itself_has_no_error() {
    // The scene set to the reference's words; its tolerance is found by a first study.
    let first = strip();
    trade(&first, &["--axes", "start"]).expect(0);
    let reference = json_file(&first.out().join("trade.json"))["reference"]["overrides"].clone();
    let scene = strip();
    let mut more = vec!["--axes", "tolerance"];
    for setting in reference.as_array().unwrap() {
        more.extend(["--set", setting.as_str().unwrap()]);
    }
    trade(&scene, &more).expect(0);
    let settings = settings(&json_file(&scene.out().join("trade.json")));
    assert_eq!(number(&settings["scene"]["worst"]), 0.0);
    assert!(number(&settings["tolerance=1e-2"]["worst"]) > 1e-9);
}

#[test]
fn quantities_axes_and_formats_are_chosen() {
    let scene = strip();
    let path = scene.scene();
    let arguments = ["trade", &path, "--quantity", "probe,residual", "--axes", "start,tolerance"];
    let few = ["--repeats", "1", "--format", "json"];
    let summary = piola(&[&arguments[..], &few].concat()).expect(0).json();
    assert_eq!(summary["quantities"], serde_json::json!(["probe:middle", "residual"]));
    // 6 tolerances, the scene's among them, by 3 starts.
    assert_eq!(summary["settings"].as_array().unwrap().len(), 18);
    assert!(!scene.out().exists());

    let listed = piola(&["trade", &path, "--axes", "start,form", "--list"]).expect(0).stdout;
    assert_eq!(listed.lines().count(), 6, "{listed}");
    assert!(listed.contains("solver.start=last solver.form=textbook"), "{listed}");
    let axes = piola(&["trade", "--list"]).expect(0).stdout;
    assert!(axes.contains("solver.tolerance") && axes.contains("positions"), "{axes}");

    let arguments = ["trade", &path, "--axes", "tolerance", "--repeats", "1", "--format", "csv"];
    let csv = piola(&[&arguments[..], &["--accuracy", "1e-5"]].concat()).expect(0).stdout;
    assert!(csv.starts_with("setting,changes,standing,median_s"), "{csv}");
}

#[test]
fn other_bodies_are_not_on_the_front() {
    let scene = strip_with("spacings = 2", "spacings = 3");
    trade(&scene, &["--axes", "horizon"]).expect(0);
    let settings = settings(&json_file(&scene.out().join("trade.json")));
    let other = &settings["horizon=2"];
    assert_eq!(other["changes"], "question");
    assert_eq!(other["standing"], "other");
    assert!(number(&other["worst"]) > 1e-2, "{other}");
    assert_eq!(settings["scene"]["standing"], "front");
}

#[test]
fn a_cloud_has_no_other_lattice_and_says_so() {
    let scene = SceneFolder::new(
        "[body]\ndimension = 2\npoints = \"p.csv\"\n[horizon]\nradius = 1.5\n[material]\n\
         potential = \"javili2020\"\nparameters = { C1 = 2.0 }\n[sets]\nleft = \"X < 0.5\"\n\
         right = \"X > 1.5\"\n[[prescribe]]\nset = \"left\"\nu = [0, 0]\n[[prescribe]]\n\
         set = \"right\"\nu = [\"0.1*t\", 0]\n[steps]\nincrements = 2\n",
    );
    scene.file("p.csv", "x,y,volume\n0,0,1\n0,1,1\n1,0,1\n1,1,1\n2,0,1\n2,1,1\n");
    let table = trade(&scene, &["--axes", "tolerance"]).expect(0).stdout;
    assert!(table.contains("the points of a file have no other spacing"), "{table}");
    assert!(table.contains("ten times the least"), "{table}");
}

#[test]
fn wrong_requests_are_refused() {
    let scene = strip();
    let refused = |more: &[&str], parts: &[&str]| {
        trade(&scene, more).expect(2).says(parts);
        assert!(!scene.out().exists(), "{more:?} left a folder");
    };
    refused(&["--axes", "speed"], &["no axis `speed`", "tolerance", "start"]);
    refused(&["--quantity", "heat"], &["no quantity `heat`", "probe:middle"]);
    refused(&["--budget", "0"], &["--budget"]);
    refused(&["--budget", "nan"], &["--budget"]);
    refused(&["--accuracy=-1"], &["--accuracy"]);
    piola(&["trade", &scene.scene(), "--repeats", "0"]).expect(2).says(&["--repeats"]);
    refused(&["--set", "solver.linear=quick"], &["quick"]);
    refused(&["--axes", "tolerance,linear,derivatives,form,strain"], &["more than 200"]);
    trade(&scene, &["--budget", "1e-9"]).expect(3).says(&["no reference run", "--budget"]);
    assert!(!scene.out().exists());
    piola(&["trade"]).expect(2);
    // A folder with something in it.
    std::fs::create_dir(scene.out()).unwrap();
    std::fs::write(scene.out().join("mine.txt"), "x").unwrap();
    trade(&scene, &[]).expect(2).says(&["not empty", "--force"]);
    assert!(scene.out().join("mine.txt").exists());
}
