//! Findings of `piola check` for editors, runners and other programs.

use serde_json::Value;

use crate::support::{SceneFolder, piola};

fn check(format: &str) -> String {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n[material]\n\
         potential = \"law.piola\"\n[sets]\nleft = \"X < 0.1, Y\"\n",
    );
    let law = folder.file("law.piola", "potential law\nparameter C1\npsi(l) = C1*C2*(l/L - 1)^2\n");
    let found = piola(&["check", &law, &folder.scene(), "--format", format]).expect(1);
    assert!(found.stderr.is_empty(), "{}", found.stderr);
    found.stdout.replace(&folder.path(""), "")
}

#[test]
fn a_finding_is_a_line_for_editors_and_for_runners() {
    let short = check("short");
    let lines: Vec<&str> = short.lines().collect();
    assert!(
        lines[0].starts_with("law.piola:3:13: error[unknown-name]: unknown name `C2`"),
        "{short}"
    );
    assert!(lines[1].starts_with("scene.toml:9:"), "{short}");
    let github = check("github");
    let start =
        "::error file=law.piola,line=3,col=13,endLine=3,endColumn=15,title=unknown-name::unknown";
    assert!(github.starts_with(start), "{github}");
}

#[test]
fn what_cannot_be_read_is_a_finding_of_its_file_and_the_others_are_still_checked() {
    let files = ["no such.piola", "no such.toml", "javili2020"];
    let with = |format| piola(&[&["check"], &files[..], &["--format", format]].concat()).expect(2);
    let short = with("short").stdout;
    let place = |file: &str| format!("{file}:1:1: error[unreadable-file]: cannot read {file}: ");
    assert!(short.lines().zip(files).all(|(line, file)| line.starts_with(&place(file))), "{short}");
    assert_eq!(short.lines().count(), 2);
    for line in with("json").stdout.lines() {
        assert_eq!(serde_json::from_str::<Value>(line).unwrap()["code"], "unreadable-file");
    }
    let log: Value = with("sarif").json();
    let run = &log["runs"][0];
    let uri = &run["results"][0]["locations"][0]["physicalLocation"]["artifactLocation"]["uri"];
    assert_eq!(uri, "no%20such.piola");
    let rule = &run["tool"]["driver"]["rules"][0]["shortDescription"]["text"];
    assert!(rule.as_str().unwrap().starts_with("A file that the scene"), "{rule}");
}

#[test]
fn a_log_of_sarif_has_rules_results_and_places() {
    let log: Value = serde_json::from_str(&check("sarif")).unwrap();
    assert_eq!(log["version"], "2.1.0");
    let run = &log["runs"][0];
    let rules = run["tool"]["driver"]["rules"].as_array().unwrap();
    let results = run["results"].as_array().unwrap();
    assert_eq!(results.len(), 2);
    for result in results {
        let id = &result["ruleId"];
        let rule = rules.iter().find(|rule| rule["id"] == *id).unwrap();
        assert!(!rule["shortDescription"]["text"].as_str().unwrap().is_empty());
        let region = &result["locations"][0]["physicalLocation"]["region"];
        for key in ["startLine", "startColumn", "endLine", "endColumn"] {
            assert!(region[key].as_u64().unwrap() >= 1, "{result}");
        }
    }
    // A file without findings is a log without results.
    let empty = piola(&["check", "javili2020", "--format", "sarif"]).expect(0).json();
    assert_eq!(empty["runs"][0]["results"].as_array().unwrap().len(), 0);
}

#[test]
fn a_log_has_what_was_said_and_what_quiet_leaves_out() {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n[material]\n\
         potential = \"javili2020\"\nparameters = { C1 = 1 }\n[sets]\nleft = \"X < 0.1\"\n\
         right = \"X > 0.9\"\n[[prescribe]]\nset = \"left\"\nu = [0, 0]\n[[prescribe]]\n\
         set = \"right\"\nu = [\"0.1*t\", 0]\n[steps]\nincrements = 2\n",
    );
    let log = folder.path("run.log");
    let quiet = folder.run(&["-q", "--log", &log]).expect(0);
    assert!(quiet.stderr.is_empty(), "{}", quiet.stderr);
    let colours = ["--force", "--log", &log, "--color", "always", "--set", "body.spacing=0.3"];
    let wrong = folder.run(&colours).expect(2);
    assert!(wrong.stderr.contains('\u{1b}'));
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.contains("2 steps converged") && text.contains("extent-not-a-multiple"), "{text}");
    assert!(!text.contains('\u{1b}'));
    folder.run(&["--log", &folder.path("no/such.log")]).expect(2).says(&["cannot write"]);
}

#[test]
fn scenes_are_checked_with_overrides() {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n[material]\n\
         potential = \"javili2020\"\nparameters = { C1 = 1 }\n",
    );
    let scene = folder.scene();
    let found = piola(&["check", &scene, "--set", "body.spacing=0.3"]).expect(1);
    found.says(&["extent-not-a-multiple"]);
}

#[test]
fn a_scene_and_its_potentials_are_told_at_once() {
    let scene = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n[material]\n\
        potential = \"law.piola\"\nparameters = { C = 1 }\n[steps]\nincrement = 4\n";
    let folder = SceneFolder::new(scene);
    let law = "potential law\nparameter C1\npsi(l) = C1*(l - L)^2\n";
    for (law, expected) in [
        (law.to_string(), &["unknown-key", "unknown-parameter"][..]),
        (law.replace("psi(l) = C1", "psi(l) = C2"), &["unknown-key", "unknown-name"]),
    ] {
        folder.file("law.piola", law);
        let lines = piola(&["check", &folder.scene(), "--format", "json"]).expect(1).stdout;
        let found: Vec<Value> =
            lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let mut codes: Vec<&str> = found.iter().map(|one| one["code"].as_str().unwrap()).collect();
        codes.sort_unstable();
        assert_eq!(codes, expected, "{lines}");
    }
}
