//! An editor: it starts `piola lsp` and speaks the protocol with it.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

use serde_json::{Value, json};

use crate::support::command;

pub(crate) struct Editor {
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
    last_id: i64,
    /// Of every file what was told of it last: version and diagnostics.
    told: std::collections::BTreeMap<String, (Option<i64>, Value)>,
}

impl Editor {
    pub(crate) fn start() -> Editor {
        let mut child = command(&["lsp"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the server starts");
        let (stdin, stdout) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let told = std::collections::BTreeMap::new();
        let mut editor = Editor { child, stdin, stdout: BufReader::new(stdout), last_id: 0, told };
        let offered = json!({ "general": { "positionEncodings": ["utf-8", "utf-16"] } });
        let answer = editor.ask(
            "initialize",
            &json!({ "processId": null, "rootUri": null, "capabilities": offered }),
        );
        assert_eq!(answer["capabilities"]["positionEncoding"], "utf-8");
        editor.say("initialized", &json!({}));
        editor
    }

    fn send(&mut self, mut message: Value) {
        message["jsonrpc"] = json!("2.0");
        let text = message.to_string();
        write!(self.stdin, "Content-Length: {}\r\n\r\n{text}", text.len()).unwrap();
        self.stdin.flush().unwrap();
    }

    pub(crate) fn say(&mut self, method: &str, params: &Value) {
        self.send(json!({ "method": method, "params": params }));
    }

    fn hear(&mut self) -> Value {
        let mut length = 0;
        loop {
            let mut line = String::new();
            assert!(self.stdout.read_line(&mut line).unwrap() > 0, "the server is gone");
            match line.trim_end().split_once(": ") {
                Some(("Content-Length", value)) => length = value.parse().unwrap(),
                Some(_) => {}
                None => break,
            }
        }
        let mut bytes = vec![0; length];
        self.stdout.read_exact(&mut bytes).unwrap();
        let message: Value = serde_json::from_slice(&bytes).unwrap();
        if message["method"] == "textDocument/publishDiagnostics" {
            let params = &message["params"];
            let uri = params["uri"].as_str().unwrap().to_string();
            self.told.insert(uri, (params["version"].as_i64(), params["diagnostics"].clone()));
        }
        message
    }

    /// The answer to a question, an error of the server's as `error`.
    pub(crate) fn ask(&mut self, method: &str, params: &Value) -> Value {
        self.last_id += 1;
        let id = self.last_id;
        self.send(json!({ "id": id, "method": method, "params": params }));
        loop {
            let message = self.hear();
            if message["id"] == id {
                return message.get("result").cloned().unwrap_or_else(|| message["error"].clone());
            }
        }
    }

    pub(crate) fn open(&mut self, uri: &str, text: &str) {
        let item = json!({ "uri": uri, "languageId": "piola", "version": 1, "text": text });
        self.say("textDocument/didOpen", &json!({ "textDocument": item }));
    }

    pub(crate) fn change(&mut self, uri: &str, version: i64, changes: &Value) {
        let document = json!({ "uri": uri, "version": version });
        let params = json!({ "textDocument": document, "contentChanges": changes });
        self.say("textDocument/didChange", &params);
    }

    /// The diagnostics of this version of a file.
    pub(crate) fn diagnostics(&mut self, uri: &str, version: i64) -> Vec<Value> {
        loop {
            if let Some((Some(of), found)) = self.told.get(uri)
                && *of == version
            {
                return found.as_array().unwrap().clone();
            }
            self.hear();
        }
    }

    /// Asks about a place in a file, the start of a word there.
    pub(crate) fn ask_at(&mut self, method: &str, uri: &str, place: Value, more: Value) -> Value {
        let mut params = json!({ "textDocument": { "uri": uri }, "position": place });
        for (key, value) in more.as_object().into_iter().flatten() {
            params[key] = value.clone();
        }
        self.ask(&format!("textDocument/{method}"), &params)
    }

    pub(crate) fn end(mut self) {
        assert_eq!(self.ask("shutdown", &Value::Null), Value::Null);
        self.say("exit", &Value::Null);
        drop(self.stdin);
        assert_eq!(self.child.wait().unwrap().code(), Some(0));
    }
}

/// The place of the n-th occurrence of a word, `shift` bytes behind its start, in bytes.
pub(crate) fn place_of(text: &str, word: &str, n: usize, shift: usize) -> Value {
    let at = text.match_indices(word).nth(n).unwrap_or_else(|| panic!("no {word}")).0 + shift;
    place_at(text, at)
}

/// The place of a byte.
pub(crate) fn place_at(text: &str, at: usize) -> Value {
    let before = &text[..at];
    let line = before.matches('\n').count();
    json!({ "line": line, "character": at - before.rfind('\n').map_or(0, |end| end + 1) })
}
