//! Wrong and doubtful programs and what piola says to them: `diagnostics/`, named after the code of
//! the error or the lint.
//!
//! The first line of a program is the command it is given to, without the name of the file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use piola_compiler::LINTS;

use crate::support::{Outcome, command, run_to_end};
use crate::{compare, folder};

fn programs() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder("diagnostics")).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut programs: Vec<PathBuf> =
        paths.filter(|path| path.extension().is_some_and(|e| e == "piola")).collect();
    programs.sort();
    programs
}

/// The code a program is about; what follows `--` tells programs of one code apart.
fn code(program: &Path) -> String {
    let name = program.file_stem().unwrap().to_str().unwrap();
    name.split("--").next().unwrap().to_string()
}

/// Runs the command of the program's first line in its folder.
fn run(program: &Path) -> Outcome {
    let text = std::fs::read_to_string(program).unwrap();
    let line = text.lines().next().and_then(|line| line.strip_prefix("# piola "));
    let line = line.unwrap_or_else(|| panic!("{} names no command", program.display()));
    let mut arguments = words(line);
    arguments.insert(1, program.file_name().unwrap().to_str().unwrap());
    let mut command = command(&arguments);
    command.current_dir(program.parent().unwrap());
    run_to_end(command, b"")
}

/// The words of a line; what stands in quotes is one.
fn words(line: &str) -> Vec<&str> {
    let mut words = Vec::new();
    for (i, part) in line.split('"').enumerate() {
        if i % 2 == 1 {
            words.push(part);
        } else {
            words.extend(part.split_whitespace());
        }
    }
    words
}

#[test]
fn wrong_programs_are_answered_as_recorded() {
    for program in programs() {
        let outcome = run(&program);
        let code = code(&program);
        // What is only probably a mistake stops nobody.
        let lint = LINTS.iter().any(|lint| lint.code == code);
        let expected: &[i32] = if lint { &[0] } else { &[1, 2] };
        assert!(expected.contains(&outcome.code), "{}: {outcome:?}", program.display());
        let said = outcome.stdout + &outcome.stderr;
        assert!(
            said.contains(&format!("[{code}]")) || said.contains(&format!("\"code\":\"{code}\"")),
            "{} is about {code}, but piola says\n{said}",
            program.display()
        );
        compare(&program.with_extension("txt"), &said);
    }
}

/// Codes that need a text too long to keep; `limits.rs` of the grammar tests them.
const BEYOND_A_FILE: [&str; 2] = ["file-too-large", "nesting-too-deep"];

#[test]
fn every_code_of_a_potential_has_a_program() {
    let programs: BTreeSet<String> = programs().iter().map(|path| code(path)).collect();
    let mut codes: BTreeSet<String> = piola_grammar::CODES.iter().map(|c| c.to_string()).collect();
    codes.extend(piola_compiler::CODES.iter().map(|code| code.to_string()));
    codes.extend(LINTS.map(|lint| lint.code.to_string()));
    for code in BEYOND_A_FILE {
        assert!(codes.remove(code), "{code} is no code");
    }
    assert_eq!(programs, codes);
}
