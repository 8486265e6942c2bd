//! Rules about documents: what they list is what there is.

use std::collections::BTreeSet;
use std::path::Path;

use piola_compiler::expression::Function;

use crate::{between, files, read, root};

#[test]
fn links_lead_somewhere() {
    for path in files(".md") {
        let folder = path.parent().unwrap();
        for target in between(&read(&path), "](", ")") {
            let file = target.split('#').next().unwrap();
            if file.is_empty() || file.contains("://") || file.contains(' ') {
                continue;
            }
            assert!(root().join(folder).join(file).exists(), "{}: {target}", path.display());
        }
    }
}

/// Files are named there by their paths from the root, with `NAME` or `CODE` for what is to be chosen.
#[test]
fn checklists_and_words_name_files_that_are_there() {
    let page = read("CONTRIBUTING.md");
    // Fences hold commands.
    let prose: String = page.split("\n```").step_by(2).collect();
    let named = prose.split('`').skip(1).step_by(2).filter(|word| word.contains('/'));
    let to_choose = |word: &&str| ["NAME", "CODE", " "].iter().any(|part| word.contains(part));
    let paths: BTreeSet<&str> = named.filter(|word| !to_choose(word)).collect();
    for path in &paths {
        assert!(root().join(path).exists(), "CONTRIBUTING.md: {path}");
    }
    assert!(paths.len() > 50, "{}", paths.len());
}

#[test]
fn the_library_is_documented_as_it_is() {
    let page = read("docs/library.md");
    let library = read("src/library.rs");
    let mut shown = BTreeSet::new();
    let mut potentials = 0;
    for path in files(".piola").iter().filter(|path| path.starts_with("potentials")) {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let text = read(path);
        potentials += 1;
        assert!(library.contains(&format!("\"{name}\"")), "src/library.rs misses {name}");
        let section = format!("## {name}\n\n");
        assert!(page.contains(&section), "docs/library.md has no section {name}");
        assert!(
            page.contains(&format!("```piola\n{text}```")),
            "docs/library.md does not show {name} as it is"
        );
        let ast = piola_grammar::parse(&text).unwrap();
        assert_eq!(ast.name.name, name, "the potential is called as its file");
        shown.insert(name.to_string());
    }
    assert!(potentials >= 5, "{potentials}");
    let sections: BTreeSet<String> =
        between(&page, "\n## ", "\n").into_iter().map(str::to_string).collect();
    assert_eq!(sections, shown);
}

#[test]
fn potentials_are_formatted() {
    let all = files(".piola");
    let own = all.iter().filter(|path| {
        ["potentials", "examples", "src/templates"].iter().any(|folder| path.starts_with(folder))
    });
    let mut n = 0;
    for path in own {
        let text = read(path);
        let formatted = piola_grammar::format(&text).unwrap();
        assert_eq!(text, formatted, "`piola fmt {}`", path.display());
        n += 1;
    }
    assert!(n > 50, "{n}");
}

#[test]
fn every_example_is_listed_and_timed() {
    let page = read("examples/README.md");
    for entry in std::fs::read_dir(root().join("examples")).unwrap() {
        let folder = entry.unwrap().path();
        if !folder.is_dir() {
            continue;
        }
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        // A scene, a program, or a program with a page of its own.
        let files = ["scene.toml", "main.rs", "README.md"];
        let file = files.into_iter().find(|file| folder.join(file).exists());
        let file = file.unwrap_or_else(|| panic!("{name} has none of {files:?}"));
        assert!(page.contains(&format!("]({name}/{file})")), "{name} is not listed");
        assert!(page.contains(&format!("\n| {name} | ")), "{name} has no times");
    }
}

#[test]
fn the_language_reference_knows_every_function() {
    let page = read("grammar/LANGUAGE.md");
    for function in Function::all_named() {
        let name = function.name();
        assert!(page.contains(&format!("`{name}(x")), "LANGUAGE.md does not mention {name}");
    }
}

/// The keys of the scene reader's tables stand as `("key", "example")`, those of settings with their
/// field behind.
#[test]
fn the_scene_reference_knows_every_key_and_code() {
    let page = read("docs/scenes.md");
    let mut keys = 0;
    for path in
        files(".rs").iter().filter(|path| path.starts_with("runtime/studies/src/scene/read"))
    {
        let text = read(path);
        let settings = between(&text, "_KEYS: [Row<", "];\n");
        for schema in between(&text, "keys: &[", "};").into_iter().chain(settings) {
            for key in between(schema, "(\"", "\"").into_iter().filter(|key| *key != "*") {
                keys += 1;
                let named = page.contains(&format!("`{key}`"))
                    || page.contains(&format!("## `[{key}]`"))
                    || page.contains(&format!("## `[[{key}]]`"));
                assert!(named, "docs/scenes.md does not explain `{key}`");
            }
        }
    }
    assert!(keys > 40, "{keys}");
    for path in files(".rs") {
        let scene =
            path.starts_with("runtime/studies/src/scene") && !path.ends_with("expression.rs");
        if !(scene || path == Path::new("runtime/output/src/read.rs")) {
            continue;
        }
        let text = read(&path);
        let code = text.split("#[cfg(test)]").next().unwrap();
        for kind in ["error(\"", "warning(\""] {
            for code in between(code, kind, "\"") {
                assert!(page.contains(&format!("`{code}`")), "docs/scenes.md misses `{code}`");
            }
        }
    }
}

/// Codes of scenes stand in the tables of `docs/scenes.md`, which the test above holds complete.
#[test]
fn every_code_is_explained_on_its_page() {
    let page = read("docs/codes.md");
    let explained: Vec<&str> = between(&page, "\n### `", "`\n");
    let mut codes: BTreeSet<&str> = piola_grammar::CODES.into_iter().collect();
    codes.extend(piola_compiler::CODES);
    codes.extend(piola_compiler::LINTS.map(|lint| lint.code));
    let scenes = read("docs/scenes.md");
    let messages = scenes.split_once("\n## Messages\n").unwrap().1;
    let quoted = messages.split('`').skip(1).step_by(2);
    codes.extend(quoted.filter(|code| code.contains('-')));
    let listed: BTreeSet<&str> = explained.iter().copied().collect();
    assert_eq!(listed.len(), explained.len(), "a code is explained twice");
    assert_eq!(listed, codes);
}

#[test]
fn the_output_reference_knows_every_field() {
    let page = read("docs/output.md");
    let files: [(&str, &[&str]); 3] = [
        (
            "runtime/output/src/summary.rs",
            &["Summary", "StepSummary", "Phase", "InteractionCounts"],
        ),
        ("runtime/studies/src/simulation/cost.rs", &["SceneCost", "PassCost", "LinearCost"]),
        ("runtime/studies/src/machine.rs", &["Rates"]),
    ];
    for (file, structures) in files {
        let source = read(file);
        for structure in structures {
            let body = between(&source, &format!("pub struct {structure} {{\n"), "\n}")[0];
            for field in between(body, "pub ", ":") {
                assert!(page.contains(&format!("`{field}`")), "docs/output.md misses {field}");
            }
        }
    }
    let names = read("runtime/output/src/folder.rs");
    let names = between(&names, "pub fn name(self)", "\n    }\n")[0];
    for file in between(names, "\"", "\"") {
        if file.contains('.') && !file.contains('{') && !file.contains('\n') {
            assert!(page.contains(&format!("`{file}`")), "docs/output.md misses {file}");
        }
    }
}

#[test]
fn the_readme_shows_the_law_of_its_run() {
    let page = read("README.md");
    let law = read("examples/first/law.piola");
    assert!(page.contains(&format!("```piola\n{law}```")), "README.md shows another law");
}

#[test]
fn pictures_are_small() {
    for path in files(".png") {
        let size = std::fs::metadata(root().join(&path)).unwrap().len();
        assert!(size <= 200 * 1024, "{} has {size} bytes", path.display());
    }
}

#[test]
fn every_code_of_the_compiler_is_listed() {
    let mut n_codes = 0;
    for path in files(".rs").iter().filter(|path| path.starts_with("compiler/src")) {
        let text = read(path);
        let text = text.split("#[cfg(test)]").next().unwrap();
        let flat: String = text.split_whitespace().collect();
        for before in ["Diagnostic::error(\"", "code:\"", "error(\"", "=>(\""] {
            for code in between(&flat, before, "\"") {
                let is_code = !code.is_empty()
                    && code.contains('-')
                    && code.chars().all(|c| c.is_ascii_lowercase() || c == '-');
                if is_code {
                    n_codes += 1;
                    assert!(piola_compiler::CODES.contains(&code), "{}: {code}", path.display());
                }
            }
        }
    }
    assert!(n_codes > 30, "{n_codes}");
}

#[test]
fn every_rewrite_is_documented() {
    let page = read("docs/measured/accuracy.md");
    let rewrites = piola_compiler::rewrite::REWRITES.iter();
    for rule in rewrites.chain(piola_compiler::point::INVARIANTS) {
        let row = format!("| {} | `{}` | {} |", rule.name, rule.identity, rule.condition);
        assert!(page.contains(&row), "docs/measured/accuracy.md misses {row}");
    }
}
