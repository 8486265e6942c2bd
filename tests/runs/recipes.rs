//! `docs/recipes.md`: every scene of it runs, and every command.

use crate::support::pages::{blocks, with_tables};
use crate::support::{SceneFolder, command, repository, run_to_end};

/// The words of a command; those in quotes are one.
pub(crate) fn words(line: &str) -> Vec<String> {
    let parts = line.split('"').enumerate();
    let of = |(k, part): (usize, &str)| -> Vec<String> {
        match k % 2 {
            1 => vec![part.to_string()],
            _ => part.split_whitespace().map(str::to_string).collect(),
        }
    };
    parts.flat_map(of).collect()
}

#[test]
fn every_scene_and_every_command_of_the_recipes_runs() {
    let page = std::fs::read_to_string(repository("docs/recipes.md")).unwrap();
    let (head, rest) = page.split_once("\n## ").unwrap();
    let base = blocks(head)[0].1;
    let (mut n_scenes, mut n_commands) = (0, 0);
    for recipe in rest.split("\n## ") {
        let title = recipe.lines().next().unwrap();
        let folder = SceneFolder::new(base);
        for (language, text) in blocks(recipe) {
            if language == "toml" {
                std::fs::write(folder.scene(), with_tables(base, text)).unwrap();
                let ran = folder.run(&["--force"]);
                assert_eq!(ran.code, 0, "{title}:\n{}", ran.stderr);
                n_scenes += 1;
                continue;
            }
            assert_eq!(language, "sh", "{title}");
            // Commands are of the page's own scene.
            std::fs::write(folder.scene(), base).unwrap();
            let _ = std::fs::remove_dir_all(folder.out());
            for line in text.lines() {
                let words = words(line);
                assert_eq!(words[0], "piola", "{title}");
                let mut piola = command(&words[1..]);
                piola.current_dir(folder.path(""));
                let ran = run_to_end(piola, b"");
                assert_eq!(ran.code, 0, "{title}: {line}\n{}", ran.stderr);
                n_commands += 1;
            }
        }
    }
    assert!(n_scenes > 8 && n_commands > 12, "{n_scenes} scenes, {n_commands} commands");
}

/// The files that such a page shows stand together in a folder, and its commands run there.
#[test]
fn pages_for_those_who_come_from_other_programs_run() {
    let (mut n_pages, mut n_commands) = (0, 0);
    for page in std::fs::read_dir(repository("docs/from")).unwrap() {
        let path = page.unwrap().path();
        let page = std::fs::read_to_string(&path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        n_pages += 1;
        for (head, text) in blocks(&page) {
            if let Some((_, file)) = head.split_once(" file=") {
                std::fs::write(folder.path().join(file), format!("{text}\n")).unwrap();
            }
        }
        for (_, text) in blocks(&page).into_iter().filter(|(language, _)| *language == "sh") {
            for line in text.lines() {
                let words = words(line);
                assert_eq!(words[0], "piola", "{}", path.display());
                let mut piola = command(&words[1..]);
                piola.current_dir(folder.path());
                let ran = run_to_end(piola, b"");
                assert_eq!(ran.code, 0, "{}: {line}\n{}", path.display(), ran.stderr);
                n_commands += 1;
            }
        }
    }
    assert!(n_pages > 5 && n_commands > 8, "{n_pages} pages, {n_commands} commands");
}

/// What strangers ask first: the first page leads to the answers.
const QUESTIONS: [&str; 12] = [
    "What is this, and what is it for?",
    "What are the units?",
    "Which weights do I take?",
    "How do I give a material Young's modulus and Poisson's ratio?",
    "Which model for rubber, metal, tissue?",
    "It does not converge. What now?",
    "How do I pull with a force, or let weight act?",
    "How do I take a mesh?",
    "How do I see stresses?",
    "How do I make it move, or break?",
    "How do I use a law in my own program?",
    "How do I cite it?",
];

#[test]
fn questions_of_strangers_are_answered_one_link_from_the_first_page() {
    let read = |file: &str| std::fs::read_to_string(repository(file)).unwrap();
    assert!(read("README.md").contains("](docs/recipes.md)"));
    let page = read("docs/recipes.md");
    for question in QUESTIONS {
        let (_, answer) =
            page.split_once(&format!("\n## {question}\n")).unwrap_or_else(|| panic!("{question}"));
        assert!(answer.split("\n## ").next().unwrap().len() > 80, "{question}");
    }
}
