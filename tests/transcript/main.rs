//! The pages that show commands and what they print: the commands are run, the output compared.
//!
//! `TRYCMD=overwrite cargo test --release --test transcript` writes what is printed now.

use std::path::{Path, PathBuf};

/// The pages, and how many files each shows at least.
const PAGES: [(&str, usize); 3] =
    [("docs/tutorial.md", 3), ("docs/new-potential.md", 6), ("docs/materials.md", 6)];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn commands_print_what_the_pages_say() {
    let cases = trycmd::TestCases::new();
    cases
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .register_bin("piola", Path::new(env!("CARGO_BIN_EXE_piola")))
        .register_bin("tail", program("tail").as_path());
    for (page, _) in PAGES {
        cases.case(page);
    }
}

/// Where a program of the system is.
fn program(name: &str) -> PathBuf {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let places = std::env::split_paths(&path).map(|folder| folder.join(name));
    places.into_iter().find(|place| place.is_file()).unwrap_or_else(|| panic!("there is no {name}"))
}

#[test]
fn the_files_of_the_pages_are_those_they_show() {
    for (page, least) in PAGES {
        let text = std::fs::read_to_string(root().join(page)).unwrap();
        let shown = blocks_with_files(&text);
        assert!(shown.len() >= least, "{page}: {} files are shown", shown.len());
        let folder = root().join(page).with_extension("in");
        for (file, text) in shown {
            let path = folder.join(file);
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text, "{}", path.display());
        }
    }
}

/// The fenced blocks that name a file: `file=NAME` behind the language.
fn blocks_with_files(page: &str) -> Vec<(&str, String)> {
    let mut found = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        let Some((_, file)) = line.split_once(" file=").filter(|_| line.starts_with("```")) else {
            continue;
        };
        let block: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
        found.push((file, block.join("\n") + "\n"));
    }
    found
}
