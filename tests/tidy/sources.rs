//! Rules about code and manifests.

use crate::{between, files, read};

/// A file of code has at most this many lines.
const MOST_LINES: usize = 600;

/// Where machine code is called, and where C is.
const UNSAFE: [&str; 2] = ["compiler/src/jit", "runtime/petsc/src/ffi.rs"];

/// Every crate and the crates of the workspace that it may know.
const ARROWS: [(&str, &[&str]); 11] = [
    ("grammar/Cargo.toml", &[]),
    ("compiler/Cargo.toml", &["piola-grammar"]),
    ("runtime/mechanics/Cargo.toml", &["piola-compiler"]),
    ("runtime/meshes/Cargo.toml", &["piola-grammar"]),
    ("runtime/solvers/Cargo.toml", &["piola-mechanics"]),
    ("runtime/output/Cargo.toml", &["piola-grammar", "piola-mechanics", "piola-meshes"]),
    ("runtime/petsc/Cargo.toml", &[]),
    (
        "runtime/studies/Cargo.toml",
        &[
            "piola-grammar",
            "piola-compiler",
            "piola-mechanics",
            "piola-meshes",
            "piola-solvers",
            "piola-output",
            "piola-petsc",
        ],
    ),
    (
        "runtime/Cargo.toml",
        &["piola-compiler", "piola-mechanics", "piola-solvers", "piola-output", "piola-studies"],
    ),
    ("Cargo.toml", &["piola-grammar", "piola-compiler", "piola-runtime"]),
    ("python/Cargo.toml", &["piola", "piola-grammar", "piola-compiler", "piola-runtime"]),
];

/// The lines of one table of a manifest.
fn table(manifest: &str, name: &str) -> Vec<String> {
    let lines = manifest.lines().map(str::trim).skip_while(|line| *line != format!("[{name}]"));
    lines.skip(1).take_while(|line| !line.starts_with('[')).map(str::to_string).collect()
}

#[test]
fn arrows_between_crates_point_one_way() {
    for (manifest, allowed) in ARROWS {
        let text = read(manifest);
        for section in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for line in table(&text, section) {
                let name = line.split(['.', ' ', '=']).next().unwrap();
                if name.starts_with("piola") {
                    assert!(allowed.contains(&name), "{manifest} depends on {name}");
                }
            }
        }
    }
}

#[test]
fn every_dependency_has_a_reason_and_one_version() {
    let mut reason = false;
    let mut dependencies = 0;
    for line in table(&read("Cargo.toml"), "workspace.dependencies") {
        let own = line.contains("path =");
        reason = line.starts_with('#') || (reason && !line.is_empty());
        if !line.is_empty() && !line.starts_with('#') && !own {
            assert!(reason, "no comment says why there is `{line}`");
            dependencies += 1;
        }
    }
    assert!(dependencies > 20, "{dependencies}");
    for (manifest, _) in ARROWS {
        for section in ["dependencies", "dev-dependencies"] {
            for line in table(&read(manifest), section).iter().filter(|line| line.contains('=')) {
                let shared = line.contains("workspace = true");
                assert!(shared, "{manifest}: `{line}` belongs into [workspace.dependencies]");
            }
        }
    }
}

#[test]
fn crates_that_must_agree_have_one_version() {
    let lock = read("Cargo.lock");
    let versions = |wanted: &str| -> Vec<String> {
        between_packages(&lock)
            .filter(|(name, _)| name == wanted)
            .map(|(_, version)| version)
            .collect()
    };
    // num-dual's numbers are nalgebra's scalars; Cranelift's parts share types.
    assert_eq!(versions("nalgebra").len(), 1);
    let cranelift = versions("cranelift-codegen");
    for part in ["cranelift-frontend", "cranelift-jit", "cranelift-module", "cranelift-native"] {
        assert_eq!(versions(part), cranelift, "{part}");
    }
}

/// Name and version of every package of a lock file.
fn between_packages(lock: &str) -> impl Iterator<Item = (String, String)> {
    lock.split("[[package]]").skip(1).map(|package| {
        let value = |key: &str| {
            let line = package.lines().find_map(|line| line.strip_prefix(key)).unwrap();
            line.trim_matches('"').to_string()
        };
        (value("name = "), value("version = "))
    })
}

#[test]
fn code_is_without_leftovers() {
    // Put together here, so that this file does not find itself.
    let leftovers = ["todo", "unimplemented", "dbg"].map(|name| format!("{name}!("));
    for path in files(".rs") {
        let text = read(&path);
        for leftover in &leftovers {
            assert!(!text.contains(leftover.as_str()), "{}: {leftover}..)", path.display());
        }
    }
}

/// What skips by hand fails in the gate: one helper decides, and the gate sets its variable.
#[test]
fn tests_skip_in_one_place_only() {
    let helper = "compiler/tests/support/machine.rs";
    // Put together here, so that this file does not find itself.
    let said = ["\"sk", "ip"].concat();
    for path in files(".rs") {
        let found = read(&path).contains(&said);
        assert_eq!(found, path.ends_with(helper), "{} skips, {helper} should", path.display());
    }
    let text = read(helper);
    let variable = between(&text, "MUST_RUN: &str = \"", "\"")[0];
    assert!(read(".ci/run").contains(&format!("\nexport {variable}=1\n")), "{variable}");
}

#[test]
fn unsafe_code_stays_in_its_places() {
    let keyword = ["un", "safe"].concat();
    let lifted = format!("allow({keyword}_code)");
    for path in files(".rs") {
        let inside = UNSAFE.iter().any(|place| path.starts_with(place));
        let text = read(&path);
        if inside {
            let blocks = text.matches(&format!("{keyword} {{")).count()
                + text.matches(&format!("{keyword} impl")).count()
                + text.matches(&format!("{keyword} extern \"C\" {{")).count();
            let reasons = text.matches("SAFETY:").count();
            assert!(reasons >= blocks, "{}: {blocks} blocks, {reasons} reasons", path.display());
            continue;
        }
        assert!(!text.contains(&lifted), "{} allows {keyword} code", path.display());
        for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
            let used = [" {", " fn", " impl", " extern"].map(|after| format!("{keyword}{after}"));
            let found = used.iter().any(|form| line.contains(form.as_str()));
            assert!(!found, "{}: {line}", path.display());
        }
    }
    assert!(read("Cargo.toml").contains(&format!("{keyword}_code = \"deny\"")));
    for (manifest, _) in ARROWS {
        assert!(read(manifest).contains("[lints]\nworkspace = true"), "{manifest} has no lints");
    }
}

#[test]
fn files_are_of_a_length_that_one_reads() {
    for path in files(".rs") {
        let lines = read(&path).lines().count();
        assert!(lines <= MOST_LINES, "{} has {lines} lines", path.display());
    }
}

#[test]
fn no_file_knows_the_machine_it_was_written_on() {
    let places = ["/home", "/root", "/tmp", "/work", "/Users"].map(|place| format!("{place}/"));
    for ending in [".rs", ".toml", ".md", ".piola", ".pest", ".json", ".txt", "run"] {
        for path in files(ending) {
            let text = read(&path);
            for place in &places {
                assert!(!text.contains(place.as_str()), "{}: {place}", path.display());
            }
        }
    }
}
