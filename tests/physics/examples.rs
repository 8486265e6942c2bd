//! The runs of the examples, each made once however many tests look at it.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, Mutex, OnceLock};

use serde_json::Value;

use crate::support::{json_file, piola, repository};

/// The output folder of a finished run.
pub(crate) struct Finished {
    folder: tempfile::TempDir,
    pub(crate) summary: Value,
}

impl Finished {
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn steps(&self) -> &[Value] {
        self.summary["steps"].as_array().unwrap()
    }
}

/// The scenes of examples/ that look for equilibria of bodies that stay whole, by folder.
pub(crate) fn all() -> Vec<String> {
    let entries = fs::read_dir(repository("examples")).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| {
            let scene = fs::read_to_string(path.join("scene.toml"));
            let is_other =
                |scene: &str| scene.contains("\n[motion]") || scene.contains("\ncontrol = \"");
            scene.is_ok_and(|scene| !is_other(&scene))
        })
        .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    names
}

type Cache = Mutex<HashMap<Vec<String>, Arc<OnceLock<Arc<Finished>>>>>;

/// Runs an example with overrides (`key=value`), or gives back the run that was made before.
pub(crate) fn run(example: &str, overrides: &[&str]) -> Arc<Finished> {
    static DONE: LazyLock<Cache> = LazyLock::new(Mutex::default);
    let key = [&[example], overrides].concat().into_iter().map(str::to_owned).collect();
    let place = Arc::clone(DONE.lock().unwrap().entry(key).or_default());
    Arc::clone(place.get_or_init(|| Arc::new(fresh(example, overrides))))
}

fn fresh(example: &str, overrides: &[&str]) -> Finished {
    let folder = tempfile::tempdir().unwrap();
    let scene: PathBuf = ["examples", example, "scene.toml"].iter().collect();
    let mut arguments = vec!["run", scene.to_str().unwrap(), "--out"];
    arguments.push(folder.path().to_str().unwrap());
    for setting in overrides {
        arguments.extend(["--set", setting]);
    }
    piola(&arguments).expect(0);
    let summary = json_file(&folder.path().join("summary.json"));
    assert_eq!(summary["exit_reason"], "completed");
    Finished { folder, summary }
}
