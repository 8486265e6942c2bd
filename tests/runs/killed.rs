//! A run that is killed leaves whole files only.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::scenes::STRIP;
use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{Random, SceneFolder, command, json_file, table};

const KILLS: usize = 20;

/// A strip with so many small steps and frames that a run writes most of the time.
pub(crate) fn many_frames() -> SceneFolder {
    let scene =
        STRIP.replace("increments = 4", "increments = 60").replace("frames = 4", "frames = 60");
    SceneFolder::new(&scene)
}

fn start(folder: &SceneFolder) -> Child {
    let (scene, out) = (folder.scene(), folder.path("out"));
    let mut command = command(&["run", &scene, "--out", &out, "--force"]);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().unwrap()
}

/// Reads everything that is there; gives back how many frames are listed.
fn check(out: &Path) -> usize {
    let Ok(list) = fs::read_to_string(out.join("run.pvd")) else { return 0 };
    let frames = read_pvd(&list).expect("a whole list of frames");
    for (index, (t, file)) in frames.iter().enumerate() {
        let frame = read_vtu(&out.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert_eq!(frame.t, *t, "{file}");
        assert!((t - index as f64 / 60.0).abs() < 1e-12, "{file} at {t}");
        assert_eq!(frame.positions.len(), 3 * 55);
        assert!(frame.arrays.len() >= 2);
        for array in &frame.arrays {
            assert_eq!(array.values.len(), 55 * array.components, "{file}: {}", array.name);
            assert!(array.values.iter().all(|x| x.is_finite()), "{file}: {}", array.name);
        }
    }
    for name in ["reactions.csv", "energy.csv", "probes.csv", "displacement.csv"] {
        if let Ok(text) = fs::read_to_string(out.join(name)) {
            assert!(text.ends_with('\n'), "{name}");
            // Reading refuses rows of unequal length.
            let (_, rows) = table(&out.join(name));
            // A table is replaced after every step, before or after the step's frame is listed.
            let steps = rows.len();
            if name == "displacement.csv" {
                assert_eq!(steps, 55);
            } else {
                assert!(steps + 1 == frames.len() || steps + 2 == frames.len(), "{name}: {steps}");
            }
        }
    }
    if out.join("summary.json").exists() {
        json_file(&out.join("summary.json"));
    }
    frames.len()
}

#[test]
fn every_listed_frame_can_be_read_after_a_kill() {
    let folder = many_frames();
    let out = folder.out();
    let begin = Instant::now();
    assert!(start(&folder).wait().unwrap().success());
    let mut whole = begin.elapsed();
    assert_eq!(check(&out), 61);
    let mut random = Random(20);
    let mut lengths = Vec::new();
    for kill in 0..KILLS {
        // Spread over the run, at random within each part.
        let part = (kill as f64 + 0.5 + 0.5 * random.next()) / KILLS as f64;
        let mut child = start(&folder);
        let wait = Duration::from_secs_f64(part * whole.as_secs_f64());
        std::thread::sleep(wait);
        // SIGKILL on Unix; a run that is done already is no failure of the test.
        child.kill().unwrap();
        child.wait().unwrap();
        lengths.push(check(&out));
        if lengths.last() == Some(&61) {
            // The first run was slow because other tests had begun with it.
            whole = whole.min(wait);
        }
    }
    println!("a whole run takes {whole:.1?}; frames after each kill: {lengths:?}");
    let cut_short = lengths.iter().filter(|n| (1..61).contains(*n)).count();
    assert!(cut_short >= KILLS / 2, "most kills fall into the run: {lengths:?}");
    // The folder can be used again, and nothing of the killed runs is left.
    assert!(start(&folder).wait().unwrap().success());
    assert_eq!(check(&out), 61);
    let left = fs::read_dir(&out).unwrap().chain(fs::read_dir(out.join("frames")).unwrap());
    for entry in left {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(!name.contains("partial"), "{name}");
    }
}
