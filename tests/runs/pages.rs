//! What pages show and no other test runs: their laws are checked, their parts of scenes are put into a scene
//! and checked, and of their commands, which may take minutes, the options and the scene are.

use std::path::{Path, PathBuf};

use crate::recipes::words;
use crate::support::pages::{blocks, with_tables};
use crate::support::{SceneFolder, command, repository, run_to_end};

/// Pages that have tests of their own.
const TESTED: [&str; 6] =
    ["recipes.md", "tutorial.md", "new-potential.md", "materials.md", "codes.md", "library.md"];

/// Scenes that a part may belong to: one whose bonds break as it moves, and one of deformation gradients.
const BASES: [&str; 2] = [
    "[body]\nbox = [[0, 0, 0], [0.1, 0.04, 0.01]]\nspacing = 0.005\n[horizon]\nspacings = 3\n[material]\n\
     potential = \"prototype_microelastic_brittle\"\nparameters = { K = \"140 GPa\", Gc = 2700 }\n\
     density = 7800\n[motion]\nend = 1e-6\n[sets]\nall = \"X > -1\"\nlower = \"Y < 0.01\"\nupper = \"Y > 0.03\"\n\
     [[prescribe]]\nset = \"lower\"\nu = [0, 0, 0]\n",
    "[body]\nbox = [[0, 0, 0], [0.1, 0.04, 0.01]]\nspacing = 0.005\n[horizon]\nspacings = 2\n[material]\n\
     potential = \"neo_hooke\"\nparameters = { mu = 1, lambda = 1 }\n[sets]\nlower = \"Y < 0.01\"\n\
     inclusion = \"Y > 0.03\"\n[[prescribe]]\nset = \"lower\"\nu = [0, 0, 0]\n",
];

fn pages() -> Vec<PathBuf> {
    let folders =
        ["docs", "docs/measured"].map(|folder| std::fs::read_dir(repository(folder)).unwrap());
    let all = folders.into_iter().flatten().map(|entry| entry.unwrap().path());
    let is_own = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy();
        name.ends_with(".md") && !TESTED.contains(&name.as_ref())
    };
    let mut pages: Vec<PathBuf> = all.filter(is_own).collect();
    pages.extend(["README.md", "examples/README.md"].map(repository));
    pages.sort();
    pages
}

#[track_caller]
fn passes(arguments: &[&str], folder: &Path, said: &str) {
    let mut piola = command(arguments);
    piola.current_dir(folder);
    let ran = run_to_end(piola, b"");
    assert_eq!(ran.code, 0, "{said}: piola {}\n{}{}", arguments.join(" "), ran.stdout, ran.stderr);
}

#[test]
fn laws_and_parts_of_scenes_of_pages_are_right() {
    let (mut n_laws, mut n_parts) = (0, 0);
    for path in pages() {
        let page = std::fs::read_to_string(&path).unwrap();
        for (language, text) in blocks(&page) {
            let folder = SceneFolder::new("");
            let said = format!("{}:\n{text}", path.display());
            match language {
                "piola" => {
                    let law = folder.file("law.piola", format!("{text}\n"));
                    passes(&["check", &law], Path::new("."), &said);
                    n_laws += 1;
                }
                "toml" => {
                    folder.file(
                        "fibres.piola",
                        "potential fibres\ndimensions 3\nparameter C in Pa\npsi(l) = C/delta^3*(l/L - 1)^2\n",
                    );
                    folder.file(
                        "warm.piola",
                        "potential warm\ndimensions 3\nparameter C in GPa*m^-4\nparameter alpha\nparameter dT\n\
                         psi(l) = 1/2*C*L*(l/L - 1 - alpha*dT)^2\n",
                    );
                    let fits = |base: &&str| {
                        std::fs::write(folder.scene(), with_tables(base, text)).unwrap();
                        run_to_end(command(&["check", &folder.scene()]), b"").code == 0
                    };
                    if !BASES.iter().any(fits) {
                        std::fs::write(folder.scene(), with_tables(BASES[0], text)).unwrap();
                        passes(&["check", &folder.scene()], Path::new("."), &said);
                    }
                    n_parts += 1;
                }
                _ => {}
            }
        }
    }
    assert!(n_laws > 3 && n_parts > 6, "{n_laws} laws, {n_parts} parts of scenes");
}

#[test]
fn commands_of_pages_have_options_and_scenes_that_are_there() {
    let mut n_commands = 0;
    for path in pages() {
        let page = std::fs::read_to_string(&path).unwrap();
        let shells =
            blocks(&page).into_iter().filter(|(language, _)| ["sh", "console"].contains(language));
        for line in shells.flat_map(|(_, text)| text.lines()) {
            let line = line.split("  #").next().unwrap().trim_start_matches("$ ");
            let line = line.replace("cargo run --release -- ", "piola ");
            let Some(rest) = line.strip_prefix("piola ") else { continue };
            // What is not to be taken literally stands in brackets.
            let words = words(&rest.replace(['[', ']'], ""));
            let words: Vec<&str> = words.iter().map(String::as_str).collect();
            let said = path.display().to_string();
            passes(&[&words[..], &["--help"]].concat(), &repository(""), &said);
            if let Some(scene) = words.iter().find(|word| word.ends_with(".toml")) {
                let mut check = vec!["check", scene];
                for pair in words.windows(2).filter(|pair| pair[0] == "--set") {
                    check.extend(pair);
                }
                passes(&check, &repository(""), &said);
            }
            n_commands += 1;
        }
    }
    assert!(n_commands > 20, "{n_commands}");
}
