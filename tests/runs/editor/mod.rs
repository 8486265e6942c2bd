//! What an editor is told by `piola lsp`, and what `piola fmt` writes.

mod client;

use serde_json::{Value, json};

use crate::support::{Random, SceneFolder, piola, piola_with_input};
use client::{Editor, place_at, place_of};

const LAW: &str = "potential law\ndimensions 2, 3\nparameter C1 in J/m^(2*d), C1 > 0  \"stiffness\"\n\
    parameter n = 2\n\nS(x, n) = if n == 0 then ln(x) else (x^n - 1)/n\n\
    psi(l) = 1/2*C1*S(l/L, n)^2\n";

const SCENE: &str = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n\n[horizon]\nspacings = 3\n\n[material]\n\
    potential = \"javili2020\"\nparameters = { C1 = 1 }\n\n[sets]\nleft = \"X < 0.1\"\nright = \"X > 0.9\"\n\n\
    [[prescribe]]\nset = \"left\"\nu = [0, 0]\n\n[[prescribe]]\nset = \"right\"\nu = [\"0.1*t\", 0]\n\n\
    [solver]\nlinear = \"auto\"\n";

fn codes(found: &[Value]) -> Vec<&str> {
    found.iter().map(|one| one["code"].as_str().unwrap()).collect()
}

/// Texts of edits applied to a text, from its end to its beginning.
fn applied(text: &str, edits: &Value) -> String {
    let offset = |place: &Value| {
        let line = place["line"].as_u64().unwrap() as usize;
        let start: usize = text.split_inclusive('\n').take(line).map(str::len).sum();
        start + place["character"].as_u64().unwrap() as usize
    };
    let mut all: Vec<(usize, usize, &str)> = edits
        .as_array()
        .unwrap()
        .iter()
        .map(|edit| {
            let range = &edit["range"];
            (offset(&range["start"]), offset(&range["end"]), edit["newText"].as_str().unwrap())
        })
        .collect();
    all.sort_unstable();
    let mut text = text.to_string();
    for (start, end, new) in all.into_iter().rev() {
        text.replace_range(start..end, new);
    }
    text
}

fn labels(items: &Value) -> Vec<&str> {
    items.as_array().unwrap().iter().map(|item| item["label"].as_str().unwrap()).collect()
}

fn replaced(text: &str) -> Value {
    json!([{ "text": text }])
}

#[test]
fn a_potential_is_checked_while_it_is_typed_and_repaired() {
    let folder = SceneFolder::new("");
    let uri = format!("file://{}", folder.path("law.piola"));
    let mut editor = Editor::start();
    editor.open(&uri, LAW);
    assert_eq!(editor.diagnostics(&uri, 1), [] as [Value; 0]);
    // A name that is misspelt, and the repair that its help names.
    let wrong = LAW.replace("dimensions", "dimensons");
    editor.change(&uri, 2, &replaced(&wrong));
    let found = editor.diagnostics(&uri, 2);
    assert_eq!(codes(&found), ["syntax"]);
    assert_eq!(found[0]["range"]["start"], place_of(&wrong, "dimensons", 0, 0));
    let actions = editor.ask(
        "textDocument/codeAction",
        &json!({ "textDocument": { "uri": uri }, "range": found[0]["range"], "context": { "diagnostics": [] } }),
    );
    assert_eq!(actions[0]["title"], "write `dimensions`");
    assert_eq!(applied(&wrong, &actions[0]["edit"]["changes"][&uri]), LAW);
    // A lint, and what allows it.
    let odd = LAW.replace("S(l/L, n)^2", "(l/L)^2");
    editor.change(&uri, 3, &replaced(&odd));
    let found = editor.diagnostics(&uri, 3);
    assert!(!found.is_empty() && found[0]["severity"] == 2, "{found:?}");
    let actions = editor.ask(
        "textDocument/codeAction",
        &json!({ "textDocument": { "uri": uri }, "range": found[0]["range"], "context": { "diagnostics": [] } }),
    );
    let allow = actions
        .as_array()
        .unwrap()
        .iter()
        .find(|one| one["title"].as_str().unwrap().starts_with("allow"));
    let allowed = applied(&odd, &allow.unwrap()["edit"]["changes"][&uri]);
    editor.change(&uri, 4, &replaced(&allowed));
    assert_eq!(editor.diagnostics(&uri, 4).len(), found.len() - 1);
    editor.end();
}

#[test]
fn names_of_a_potential_are_known() {
    let folder = SceneFolder::new("");
    let uri = format!("file://{}", folder.path("law.piola"));
    let mut editor = Editor::start();
    editor.open(&uri, LAW);
    let hover = |editor: &mut Editor, place: Value| {
        let said = editor.ask_at("hover", &uri, place, json!({}));
        said["contents"]["value"].as_str().unwrap_or("").to_string()
    };
    let mut says = |word: &str, n: usize, part: &str| {
        let said = hover(&mut editor, place_of(LAW, word, n, 0));
        assert!(said.contains(part), "{word}: {said}");
    };
    says("C1", 2, "parameter C1 in J/m^(2*d), C1 > 0  \"stiffness\"");
    says("S(l", 0, "S(x, n) = if n == 0");
    says("n == 0", 0, "an argument of `S`");
    says("ln(x)", 0, "natural logarithm");
    says("L, n", 0, "the reference length of a bond");
    says("dimensions", 0, "where it is defined");
    says("psi(l)", 0, "psi''(l) =");
    says("psi(l)", 0, "psi(l) in J/m^6");
    // What it costs and keeps comes when it is known.
    let place = place_of(LAW, "psi(l)", 0, 0);
    let shown = (0..50).map(|_| hover(&mut editor, place.clone()));
    let measured = shown.into_iter().find(|said| !said.contains("being measured")).unwrap();
    assert!(measured.contains(" ns, ") && measured.contains(" of psi''"), "{measured}");
    assert!(measured.contains("with C1 = 1"), "{measured}");
    // Another text at the same place, with the same version, is measured anew.
    editor.say("textDocument/didClose", &json!({ "textDocument": { "uri": uri } }));
    let other = LAW.replace("psi(l) = 1/2*C1*S(l/L, n)^2", "psi(a) = 1/2*C1*S(a/A, n)^2");
    editor.open(&uri, &other.replace("2*d", "3*d"));
    let place = place_of(&other, "psi(a)", 0, 0);
    let shown = (0..50).map(|_| hover(&mut editor, place.clone()));
    let measured = shown.into_iter().find(|said| !said.contains("being measured")).unwrap();
    assert!(measured.contains("psi(a): "), "{measured}");
    editor.say("textDocument/didClose", &json!({ "textDocument": { "uri": uri } }));
    editor.open(&uri, LAW);
    // The parameter n is not the argument n.
    let spans = editor.ask_at(
        "references",
        &uri,
        place_of(LAW, "n = 2", 0, 0),
        json!({ "context": { "includeDeclaration": true } }),
    );
    assert_eq!(spans.as_array().unwrap().len(), 2, "{spans}");
    let renamed =
        editor.ask_at("rename", &uri, place_of(LAW, "n == 0", 0, 0), json!({ "newName": "m" }));
    let text = applied(LAW, &renamed["changes"][&uri]);
    assert_eq!(
        text,
        LAW.replace(
            "S(x, n) = if n == 0 then ln(x) else (x^n - 1)/n",
            "S(x, m) = if m == 0 then ln(x) else (x^m - 1)/m"
        )
    );
    for name in ["C1", "sqrt", "2x", "if", "L", ""] {
        let refused =
            editor.ask_at("rename", &uri, place_of(LAW, "n = 2", 0, 0), json!({ "newName": name }));
        assert!(refused["message"].is_string(), "{name}: {refused}");
    }
    let definition = editor.ask_at("definition", &uri, place_of(LAW, "S(l", 0, 0), json!({}));
    assert_eq!(definition["range"]["start"], place_of(LAW, "S(x", 0, 0));
    let outline =
        editor.ask("textDocument/documentSymbol", &json!({ "textDocument": { "uri": uri } }));
    let names: Vec<&str> =
        outline.as_array().unwrap().iter().map(|one| one["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["C1", "n", "S", "psi(l)"]);
    // What could stand at a place.
    let mut completes = |text: &str, version: i64, wanted: &[&str]| {
        editor.change(&uri, version, &replaced(text));
        let items = editor.ask_at("completion", &uri, place_at(text, text.len()), json!({}));
        let labels = labels(&items);
        for word in wanted {
            assert!(labels.contains(word), "{text}: no {word} in {labels:?}");
        }
    };
    completes(&format!("{LAW}psi(a) = C1*"), 2, &["C1", "S", "n", "sqrt", "a", "A", "if"]);
    completes(&format!("{LAW}par"), 3, &["parameter", "psi", "domain"]);
    completes(&format!("{LAW}parameter q in "), 4, &["Pa", "GPa", "m"]);
    completes(&format!("{LAW}allow \""), 5, &["not-stress-free"]);
    // The layout.
    let loose = LAW.replace("1/2*C1*S", "1/2 * C1 *S");
    editor.change(&uri, 6, &replaced(&loose));
    let options = json!({ "tabSize": 4, "insertSpaces": true });
    let edits = editor.ask(
        "textDocument/formatting",
        &json!({ "textDocument": { "uri": uri }, "options": options }),
    );
    let formatted = piola_with_input(&["fmt", "-"], LAW.as_bytes()).expect(0).stdout;
    assert_eq!(applied(&loose, &edits), formatted);
    editor.end();
}

#[test]
fn a_scene_is_checked_and_its_words_are_known() {
    let folder = SceneFolder::new(SCENE);
    folder.file("own.piola", LAW);
    let uri = format!("file://{}", folder.scene());
    let mut editor = Editor::start();
    editor.open(&uri, SCENE);
    assert_eq!(editor.diagnostics(&uri, 1), [] as [Value; 0]);
    let mut version = 1;
    let mut repaired = |from: &str, to: &str, code: &str| {
        version += 1;
        let wrong = SCENE.replacen(from, to, 1);
        editor.change(&uri, version, &replaced(&wrong));
        let found = editor.diagnostics(&uri, version);
        let one =
            found.iter().find(|one| one["code"] == code).unwrap_or_else(|| panic!("{found:?}"));
        let actions = editor.ask(
            "textDocument/codeAction",
            &json!({ "textDocument": { "uri": uri }, "range": one["range"], "context": { "diagnostics": [] } }),
        );
        assert_eq!(applied(&wrong, &actions[0]["edit"]["changes"][&uri]), SCENE, "{actions}");
    };
    repaired("spacing = ", "spacin = ", "unknown-key");
    repaired("set = \"right\"", "set = \"rigth\"", "unknown-set");
    repaired("\"auto\"", "\"auot\"", "unknown-choice");
    repaired("\"javili2020\"", "\"javili2002\"", "unknown-potential");
    let mut completes = |version: i64, text: &str, at: usize, wanted: &[&str]| {
        editor.change(&uri, version, &replaced(text));
        let items = editor.ask_at("completion", &uri, place_at(text, at), json!({}));
        let labels = labels(&items);
        for word in wanted {
            assert!(labels.contains(word), "{text}: no {word} in {labels:?}");
        }
        labels.iter().map(|label| label.to_string()).collect::<Vec<String>>()
    };
    let at = |text: &str, word: &str| text.find(word).unwrap() + word.len();
    completes(20, SCENE, at(SCENE, "linear = \""), &["cholesky", "cg"]);
    completes(21, SCENE, at(SCENE, "set = \""), &["left", "right"]);
    completes(22, SCENE, at(SCENE, "potential = \""), &["gent", "own.piola"]);
    let more = SCENE.replace("linear = \"auto\"\n", "linear = \"auto\"\nnew");
    let keys = completes(23, &more, more.len(), &["newton", "tolerance", "level"]);
    assert!(!keys.contains(&"linear".to_string()), "{keys:?}");
    let more = SCENE.replace("C1 = 1 }", "C1 = 1, ");
    completes(24, &more, at(&more, "C1 = 1, "), &["C2"]);
    let more = format!("{SCENE}\n[");
    completes(25, &more, more.len(), &["motion", "output", "crack"]);
    editor.change(&uri, 26, &replaced(SCENE));
    let said = editor.ask_at("hover", &uri, place_of(SCENE, "linear", 0, 2), json!({}));
    let said = said["contents"]["value"].as_str().unwrap();
    assert!(said.contains("default `\"auto\"`"), "{said}");
    let said = editor.ask_at("hover", &uri, place_of(SCENE, "javili2020", 0, 2), json!({}));
    assert!(said["contents"]["value"].as_str().unwrap().contains("psi(l) ="), "{said}");
    let said = editor.ask_at("hover", &uri, place_of(SCENE, "C1", 0, 1), json!({}));
    assert!(said["contents"]["value"].as_str().unwrap().contains("parameter C1"), "{said}");
    let place = place_of(SCENE, "\"right\"", 0, 3);
    let definition = editor.ask_at("definition", &uri, place.clone(), json!({}));
    assert_eq!(definition["range"]["start"], place_of(SCENE, "right", 0, 0));
    let renamed = editor.ask_at("rename", &uri, place, json!({ "newName": "end" }));
    let text = applied(SCENE, &renamed["changes"][&uri]);
    assert_eq!(text, SCENE.replace("right", "end"));
    // Other TOML files are no business of ours.
    let other = format!("file://{}", folder.path("Cargo.toml"));
    editor.open(&other, "[package]\nname = \"x\"\n");
    assert_eq!(editor.diagnostics(&other, 1), [] as [Value; 0]);
    editor.end();
}

/// A piece of text that someone might type.
fn piece(random: &mut Random) -> &'static str {
    const PIECES: [&str; 24] = [
        "psi(l) = ",
        "C1",
        "(",
        ")",
        "\n",
        "*",
        "^",
        " ",
        "parameter x = 1\n",
        "λ",
        "\"",
        "#",
        "1e-3",
        "if ",
        "then ",
        "else ",
        "[",
        "in Pa",
        "𝛼",
        "\t",
        "=",
        "[body]\n",
        "set = \"left\"",
        "domain l/L in (0, 2)\n",
    ];
    PIECES[((random.next() + 1.0) * 12.0) as usize % PIECES.len()]
}

#[test]
fn a_thousand_random_edits_leave_no_stale_message() {
    let folder = SceneFolder::new("");
    let mut editor = Editor::start();
    for (file, start) in [("law.piola", LAW), ("scene.toml", SCENE)] {
        let uri = format!("file://{}", folder.path(file));
        let mut text = start.to_string();
        editor.open(&uri, &text);
        let mut random = Random(7);
        for version in 2..=501 {
            let mut at = |most: usize| ((random.next() + 1.0) / 2.0 * most as f64) as usize;
            let (start, length) = (text.floor_char_boundary(at(text.len())), at(6));
            let end = text.ceil_char_boundary((start + length).min(text.len()));
            let new = piece(&mut random);
            // Every so often all is right again.
            let change = match version % 50 {
                0 => {
                    text = [LAW, SCENE][usize::from(file == "scene.toml")].to_string();
                    json!({ "text": text })
                }
                _ => {
                    let range =
                        json!({ "start": place_at(&text, start), "end": place_at(&text, end) });
                    text.replace_range(start..end, new);
                    json!({ "range": range, "text": new })
                }
            };
            editor.change(&uri, version, &json!([change]));
            if version % 7 == 0 {
                let place = place_at(&text, text.floor_char_boundary(text.len() / 2));
                for method in ["hover", "completion", "definition"] {
                    editor.ask_at(method, &uri, place.clone(), json!({}));
                }
                let whole =
                    json!({ "start": place_at(&text, 0), "end": place_at(&text, text.len()) });
                let params = json!({ "textDocument": { "uri": uri }, "range": whole, "context": { "diagnostics": [] } });
                if version % 35 == 0 {
                    editor.ask("textDocument/codeAction", &params);
                }
            }
            if version % 25 == 0 {
                let found = editor.diagnostics(&uri, version);
                let told: Vec<String> = found
                    .iter()
                    .map(|one| format!("{}:{}", one["range"]["start"]["line"], one["code"]))
                    .collect();
                let path = folder.file(file, &text);
                let lines = piola(&["check", &path, "--format", "json"]).stdout;
                let expected: Vec<String> = lines
                    .lines()
                    .map(|line| serde_json::from_str::<Value>(line).unwrap())
                    .map(|one| format!("{}:{}", one["line"].as_u64().unwrap() - 1, one["code"]))
                    .collect();
                if file == "law.piola" || !told.is_empty() {
                    assert_eq!(told, expected, "version {version}:\n{text}");
                }
            }
        }
    }
    editor.end();
}

#[test]
fn fmt_writes_files_or_says_which_it_would_write() {
    let folder = SceneFolder::new("");
    let good = folder.file("good.piola", "potential good\npsi(l) = (l - L)^2\n");
    let loose = folder.file("loose.piola", "potential loose\npsi( l )=(l - L)^2 # said\n");
    let wrong = folder.file("wrong.piola", "potential wrong\npsi(l) = (l\n");
    piola(&["fmt", "--check", &good]).expect(0);
    piola(&["fmt", "--check", &good, &loose]).expect(1).says(&["loose.piola", "1 to be formatted"]);
    piola(&["fmt", &good, &loose, &wrong]).expect(1).says(&["unclosed"]);
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    assert_eq!(read(&loose), "potential loose\npsi(l) = (l - L)^2  # said\n");
    assert_eq!(read(&wrong), "potential wrong\npsi(l) = (l\n");
    piola(&["fmt", "--check", &good, &loose]).expect(0);
    piola(&["fmt", &folder.path("nothing.piola")]).expect(2).says(&["cannot read"]);
}

#[cfg(unix)]
#[test]
fn fmt_writes_the_file_behind_a_link_and_keeps_its_permissions() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = SceneFolder::new("");
    let real = folder.file("real.piola", "potential real\npsi( l ) = (l - L)^2\n");
    let link = folder.path("link.piola");
    std::os::unix::fs::symlink(&real, &link).unwrap();
    let mode =
        |mode| std::fs::set_permissions(&real, std::fs::Permissions::from_mode(mode)).unwrap();
    mode(0o640);
    piola(&["fmt", &link]).expect(0);
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
    let text = std::fs::read_to_string(&real).unwrap();
    assert_eq!(text, "potential real\npsi(l) = (l - L)^2\n");
    assert_eq!(std::fs::metadata(&real).unwrap().permissions().mode() & 0o777, 0o640);
    std::fs::write(&real, "potential real\npsi( l ) = (l - L)^2\n").unwrap();
    mode(0o440);
    piola(&["fmt", &real]).expect(2).says(&["it may only be read"]);
}

#[test]
fn messages_that_cannot_be_read_and_odd_scenes_end_nothing() {
    let mut editor = Editor::start();
    for uri in ["file:///a b.piola", "file:///x%zz.piola"] {
        editor.open(uri, "potential p\n");
    }
    let uri = "file:///odd.toml";
    let text = "\u{feff}[material] # what it is of\npotential = \"javili2020\"\nparameters = { \n[[ prescribe ]]\n\n\
                [body]\nbox = [\n    [0, 0],\n    [1, 1]\n]\n\n[horizon]  # who interacts\n\n";
    editor.open(uri, text);
    editor.diagnostics(uri, 1);
    let mut completes = |line: u32, character: u32, word: &str| {
        let place = json!({ "line": line, "character": character });
        let items = editor.ask_at("completion", uri, place, json!({}));
        assert!(labels(&items).contains(&word), "{line}: {items}");
    };
    completes(2, 15, "C1");
    completes(4, 0, "set");
    completes(10, 0, "spacing");
    completes(12, 0, "radius");
    editor.end();
}

#[test]
fn new_folders_run() {
    let folder = SceneFolder::new("");
    for template in ["plate", "bar", "crack", "fibre"] {
        let own = folder.path(&format!("my {template}"));
        piola(&["new", &own, "--template", template]).expect(0).says(&["scene.toml", "piola run"]);
        let [law, scene, out] =
            ["law.piola", "scene.toml", "out"].map(|file| format!("{own}/{file}"));
        let checked = piola(&["check", &law, &scene]).expect(0);
        assert!(!checked.stderr.contains("warning"), "{}", checked.stderr);
        assert!(
            std::fs::read_to_string(&law)
                .unwrap()
                .starts_with(&format!("potential my_{template} "))
        );
        piola(&["fmt", "--check", &law]).expect(0);
        let ran = piola(&["run", &scene, "--out", &out]).expect(0);
        assert!(!ran.stderr.contains("warning"), "{}", ran.stderr);
        assert!(std::path::Path::new(&out).join("picture.png").exists());
        if template == "crack" {
            let table = std::fs::read_to_string(format!("{out}/fracture.csv")).unwrap();
            let tip: f64 =
                table.lines().last().unwrap().split(',').nth(4).unwrap().parse().unwrap();
            assert!(tip > 0.09, "the tip is at {tip} m");
        }
        piola(&["new", &own, "--template", template]).expect(2).says(&["is there already"]);
    }
    let law = folder.path("2 laws");
    piola(&["new", &law, "--template", "law"]).expect(0);
    let law = format!("{law}/law.piola");
    assert!(std::fs::read_to_string(&law).unwrap().starts_with("potential law_2_laws "));
    let checked = piola(&["check", &law]).expect(0);
    assert!(!checked.stderr.contains("warning"), "{}", checked.stderr);
    piola(&["verify", &law, "--set", "C=1"]).expect(0);
}
