//! Input that cannot be used: exit 2, a message that names what is wrong, and nothing written.

use crate::scenes::{STRIP, strip, strip_with};
use crate::support::{SceneFolder, piola};

fn refused(folder: &SceneFolder, parts: &[&str]) {
    folder.run(&[]).expect(2).says(parts);
    assert!(!folder.out().join("summary.json").exists());
}

#[test]
fn a_body_that_can_move_freely_names_the_motion() {
    let free = STRIP
        .replace("u = [0, 0]", "u = [0, \"free\"]")
        .replace("[\"0.2*t\", 0]", "[\"0.2*t\", \"free\"]");
    refused(&SceneFolder::new(&free), &["translation along y"]);
}

#[test]
fn wrong_scenes_name_what_is_wrong() {
    refused(&strip_with("X > 0.85", "X > 8"), &["`right` has no points"]);
    refused(&strip_with("set = \"right\"", "set = \"rigth\""), &["did you mean `right`"]);
    refused(&strip_with("X > 0.85", "X > 0.05"), &["prescribed twice", "`left`", "`right`"]);
    refused(&strip_with("spacings = 2", "spacings = 0.5"), &["neighbour"]);
    refused(&strip_with("spacing = 0.1\n", "spacing = 0.1\nsize = 3\n"), &["no key `size`"]);
    refused(&strip_with("0.2*t", "0.2/t^0*ln(0*t)"), &["-inf"]);
    refused(&strip_with("C2 = 5.0", "C2 = -5.0"), &["C2 >= 0"]);
    refused(&strip_with("javili2020", "javily2020"), &["did you mean `javili2020`"]);
}

#[test]
fn a_set_that_ends_at_points_is_a_warning() {
    let folder = strip_with("X < 0.15", "X < 0.1");
    folder.run(&[]).expect(0).says(&["warning", "`left`"]);
}

#[test]
fn a_body_beyond_the_memory_is_refused_at_once() {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0, 0], [1, 1, 1]]\nspacing = 1e-3\n[horizon]\nspacings = 3\n\
         [material]\npotential = \"javili2020\"\n[sets]\nall = \"X > -1\"\n",
    );
    let start = std::time::Instant::now();
    folder.run(&[]).expect(2).says(&["memory"]);
    assert!(start.elapsed().as_secs() < 20);
}

#[test]
fn files_that_are_none_are_refused() {
    let folder = strip();
    folder.file("binary.toml", [0xff, 0xfe, 0x00]);
    let binary = folder.path("binary.toml");
    for scene in ["nowhere.toml", ".", binary.as_str()] {
        piola(&["plan", scene]).expect(2).says(&["cannot read"]);
    }
    piola(&["check", "nowhere.piola"]).expect(2).says(&["cannot read"]);
    piola(&["check", "firoz2023"]).expect(2).says(&["did you mean `firooz2023`"]);
    folder.file("wrong.piola", "potential p\npsi(l) = k*l\n");
    let wrong = folder.path("wrong.piola");
    piola(&["check", wrong.as_str()]).expect(1).says(&["unknown name `k`"]);
    let json = piola(&["check", "--format", "json", wrong.as_str()]).expect(1).json();
    assert_eq!((&json["code"], &json["line"]), (&"unknown-name".into(), &2.into()));
    let (scene, table) = (folder.scene(), folder.file("u.csv", "u,v\n0,0\n"));
    piola(&["energy", &scene, "--displacement", &table]).expect(2).says(&["1 rows", "55 points"]);
}
