//! What the tests of the whole program share: the program itself, scenes in temporary folders,
//! reference data, small linear algebra.
#![allow(dead_code)] // Every test binary uses its own part of this.

pub(crate) mod frames;
#[path = "../../compiler/tests/support/machine.rs"]
pub(crate) mod machine;
pub(crate) mod pages;

use std::ffi::OsStr;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

/// Unit round-off.
pub(crate) const U: f64 = f64::EPSILON / 2.0;

/// The cube between these coordinates as a text STL.
pub(crate) fn stl_cube(low: f64, high: f64) -> String {
    let corner =
        |k: usize| [k & 1, k >> 1 & 1, k >> 2 & 1].map(|k| if k == 0 { low } else { high });
    let faces =
        [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]];
    let mut text = "solid cube\n".to_string();
    for triangle in faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]) {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle.map(corner) {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid cube\n"
}

/// What a command left behind.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Outcome {
    /// Fails the test unless the command ended with this code.
    #[track_caller]
    pub(crate) fn expect(self, code: i32) -> Outcome {
        assert_eq!(self.code, code, "stdout:\n{}\nstderr:\n{}", self.stdout, self.stderr);
        self
    }

    /// Fails the test unless stderr holds all of these.
    #[track_caller]
    pub(crate) fn says(self, parts: &[&str]) -> Outcome {
        for part in parts {
            assert!(self.stderr.contains(part), "no `{part}` in stderr:\n{}", self.stderr);
        }
        self
    }

    /// The standard output as JSON.
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).expect("stdout is JSON")
    }
}

/// The program with these arguments, ready to be started; what it knows of the machine stays in the
/// folder of the tests.
pub(crate) fn command<S: AsRef<OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_piola"));
    command.args(arguments).current_dir(env!("CARGO_MANIFEST_DIR"));
    command.env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
    command
}

/// Runs piola in the repository's root. No command may ever panic or die by a signal.
#[track_caller]
pub(crate) fn piola<S: AsRef<OsStr>>(arguments: &[S]) -> Outcome {
    piola_with_input(arguments, b"")
}

/// The same with something on the standard input.
#[track_caller]
pub(crate) fn piola_with_input<S: AsRef<OsStr>>(arguments: &[S], input: &[u8]) -> Outcome {
    run_to_end(command(arguments), input)
}

/// Runs a command of piola, with this on its standard input.
#[track_caller]
pub(crate) fn run_to_end(mut command: Command, input: &[u8]) -> Outcome {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("piola starts");
    let mut stdin = child.stdin.take().expect("stdin is piped");
    let output = std::thread::scope(|scope| {
        // A command that does not read its input closes the pipe early.
        scope.spawn(move || {
            let _ = stdin.write_all(input);
        });
        child.wait_with_output().expect("piola ends")
    });
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("piola writes UTF-8");
    let (stdout, stderr) = (text(output.stdout), text(output.stderr));
    assert!(!stderr.contains("panicked"), "{stderr}");
    let code = output.status.code().expect("piola is not killed by a signal");
    Outcome { code, stdout, stderr }
}

/// A folder with a scene in it, removed at the end of the test.
pub(crate) struct SceneFolder {
    folder: tempfile::TempDir,
}

impl SceneFolder {
    /// A folder with this `scene.toml`.
    pub(crate) fn new(scene: &str) -> SceneFolder {
        let folder = tempfile::tempdir().unwrap();
        let scenes = SceneFolder { folder };
        scenes.file("scene.toml", scene);
        scenes
    }

    /// Puts another file beside the scene.
    pub(crate) fn file(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        fs::write(self.folder.path().join(name), content).unwrap();
        self.path(name)
    }

    /// The path of something in the folder.
    pub(crate) fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// The path of the scene.
    pub(crate) fn scene(&self) -> String {
        self.path("scene.toml")
    }

    /// The folder for results.
    pub(crate) fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    /// `piola run` of the scene into [`SceneFolder::out`].
    #[track_caller]
    pub(crate) fn run(&self, more: &[&str]) -> Outcome {
        let (scene, out) = (self.scene(), self.path("out"));
        let mut arguments = vec!["run", &scene, "--out", &out];
        arguments.extend_from_slice(more);
        piola(&arguments)
    }

    /// `summary.json` of the run.
    pub(crate) fn summary(&self) -> Value {
        json_file(&self.out().join("summary.json"))
    }

    /// `piola energy` of the scene with this displacement table.
    #[track_caller]
    pub(crate) fn energy(&self, displacement: &str, more: &[&str]) -> Outcome {
        let (scene, table) = (self.scene(), self.file("u.csv", displacement));
        let mut arguments = vec!["energy", &scene, "--displacement", &table, "--tangent"];
        arguments.extend_from_slice(more);
        piola(&arguments).expect(0)
    }
}

/// A file of the repository.
pub(crate) fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A JSON file.
pub(crate) fn json_file(path: &Path) -> Value {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap()
}

/// Reference data, from tests/reference/.
pub(crate) fn reference(name: &str) -> Value {
    json_file(&repository("tests/reference").join(name))
}

/// A part of the energy that the program reports, `psi(l)`; 0 where there is none.
pub(crate) fn energy_part(result: &Value, name: &str) -> f64 {
    let part = &result["energy_parts"][name];
    if part.is_null() { 0.0 } else { number(part) }
}

/// The number in a JSON value; piola writes non-finite numbers as strings.
#[track_caller]
pub(crate) fn number(value: &Value) -> f64 {
    match value {
        Value::String(text) => text.parse().unwrap(),
        _ => value.as_f64().unwrap_or_else(|| panic!("{value} is not a number")),
    }
}

/// All numbers of a JSON array, or array of arrays, in order.
#[track_caller]
pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        _ => vec![number(value)],
    }
}

/// The entries of `piola energy --tangent` as a dense matrix, row by row.
pub(crate) fn dense_tangent(energy: &Value) -> Vec<f64> {
    let n = number(&energy["points"]) as usize * number(&energy["dimension"]) as usize;
    let tangent = &energy["tangent"];
    let (rows, columns) = (numbers(&tangent["rows"]), numbers(&tangent["cols"]));
    let mut dense = vec![0.0; n * n];
    for ((row, column), value) in rows.iter().zip(&columns).zip(numbers(&tangent["values"])) {
        dense[*row as usize * n + *column as usize] = value;
    }
    dense
}

/// A CSV file of numbers: its header and its rows.
pub(crate) fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let row = |record: Result<csv::StringRecord, csv::Error>| {
        record.unwrap().iter().map(|field| field.parse().unwrap()).collect()
    };
    (header, reader.records().map(row).collect())
}

/// Rows of numbers as CSV.
pub(crate) fn to_csv(header: &str, rows: &[f64]) -> String {
    let columns = header.split(',').count();
    let mut text = format!("{header}\n");
    for row in rows.chunks_exact(columns) {
        let fields: Vec<String> = row.iter().map(|x| format!("{x:?}")).collect();
        text.push_str(&fields.join(","));
        text.push('\n');
    }
    text
}

pub(crate) fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Norm of the difference over the norm of what is expected.
#[track_caller]
pub(crate) fn distance(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let difference: Vec<f64> = found.iter().zip(expected).map(|(f, e)| f - e).collect();
    norm(&difference) / norm(expected)
}

/// Reproducible pseudo-random numbers in -1..1 (Knuth's MMIX generator).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub(crate) fn vector(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.next()).collect()
    }
}
