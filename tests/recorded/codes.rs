//! The examples of `docs/codes.md`: what is called wrong is answered with the code of its section,
//! what is called right without it.

use crate::support::pages::{Block, blocks, with_tables};
use crate::support::{SceneFolder, piola, repository, stl_cube};

/// A cloud for the examples of tables, in place of the body of the page's scene.
const CLOUD: &str = "[body]\ndimension = 2\npoints = \"points.csv\"\n\n[horizon]\nradius = 1.5\n";

const POINTS: &str = "x,y,volume\n0,0,1\n1,0,1\n0,1,1\n1,1,1\n";

/// A mesh for the examples of meshes, in place of the body of the page's scene.
const MESH: &str =
    "[body]\ndimension = 2\nmesh = \"sheet.msh\"\nnodes = \"corners\"\n\n[horizon]\nradius = 1.5\n";

const SHEET: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n\
    $EndNodes\n$Elements\n2\n1 2 2 0 1 1 2 3\n2 2 2 0 1 1 3 4\n$EndElements\n";

/// What only a run finds out, not a plan.
const FOUND_BY_RUNS: [&str; 3] = ["free-motion", "on-threshold", "unusable-scene"];

/// Everything piola says to an example of a code; `None` where nothing can be run.
fn said((language, text): Block<'_>, scene: &str, code: &str) -> Option<String> {
    let outcome = match language {
        "piola" => {
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join("law.piola");
            std::fs::write(&file, text).unwrap();
            piola(&["check", "--pedantic", file.to_str().unwrap()])
        }
        "toml" | "csv" | "msh" => {
            let (tables, points, mesh) = match language {
                "toml" => (text, POINTS, SHEET),
                "csv" => (CLOUD, text, SHEET),
                _ => (MESH, POINTS, text),
            };
            let folder = SceneFolder::new(&with_tables(scene, tables));
            folder.file("points.csv", points);
            folder.file("sheet.msh", mesh);
            folder.file("cube.stl", stl_cube(0.0, 1.0));
            match FOUND_BY_RUNS.contains(&code) {
                true => folder.run(&["--set", "steps.increments=1"]),
                false => piola(&["plan", &folder.scene()]),
            }
        }
        _ => return None,
    };
    Some(outcome.stderr)
}

#[test]
fn examples_are_as_right_and_as_wrong_as_the_page_says() {
    let page = std::fs::read_to_string(repository("docs/codes.md")).unwrap();
    let scenes = page.split_once("\n## Scenes\n").unwrap().1;
    let scene = blocks(scenes)[0].1;
    let mut n_sections = 0;
    for section in page.split("\n### `").skip(1) {
        let section = section.split("\n## ").next().unwrap();
        let code = section.split('`').next().unwrap();
        let [wrong, right] = blocks(section)[..] else { panic!("{code} has not two examples") };
        let (Some(wrong), Some(right)) = (said(wrong, scene, code), said(right, scene, code))
        else {
            continue;
        };
        assert!(wrong.contains(&format!("[{code}]")), "{code}, wrong:\n{wrong}");
        assert!(!right.contains(&format!("[{code}]")), "{code}, right:\n{right}");
        assert!(!right.contains("error"), "{code}, right:\n{right}");
        n_sections += 1;
    }
    assert!(n_sections > 70, "{n_sections}");
}

#[test]
fn explain_prints_the_page() {
    let list = piola(&["explain"]).expect(0).stdout;
    for code in ["syntax", "unknown-lint", "no-bond-energy", "points-coincide"] {
        assert!(list.contains(&format!("\n  {code} ")), "{list}");
    }
    let found = piola(&["explain", "not-stress-free"]).expect(0);
    assert!(found.stderr.is_empty());
    assert!(found.stdout.contains("\nWrong:\n\n    potential spring\n    psi(l) = (l/L)^2\n"));
    piola(&["explain", "not-stres-free"]).expect(2).says(&["did you mean `not-stress-free`?"]);
}
