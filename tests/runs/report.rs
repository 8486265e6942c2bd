//! `piola report`: one page that needs nothing else, and shows what was run.

use std::process::Command;

use serde_json::Value;

use crate::support::frames::read_vtu;
use crate::support::{SceneFolder, command, piola};

/// A cube that is sheared, with a name of a set that HTML would misread.
const CUBE: &str = "[body]\nbox = [[0, 0, 0], [1, 1, 1]]\nspacing = 0.25\n[horizon]\nspacings = 2\n[material]\n\
    potential = \"javili2020\"\nparameters = { C1 = 1 }\n[sets]\nheld = \"X < 0.25\"\n\"moved\" = \"X > 0.75\"\n\
    [[prescribe]]\nset = \"held\"\nu = [0, 0, 0]\n[[prescribe]]\nset = \"moved\"\nu = [0, \"0.3*t\", 0]\n\
    [steps]\nincrements = 4\n[output]\nframes = 4\n";

fn page_of(folder: &SceneFolder) -> (String, Value) {
    let out = folder.path("out");
    piola(&["report", &out]).expect(0).says(&["report.html"]);
    let page = std::fs::read_to_string(format!("{out}/report.html")).unwrap();
    let (_, rest) = page.split_once("<script id=\"data\" type=\"application/json\">").unwrap();
    let data = serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap();
    (page, data)
}

/// Bytes of a text in base64 (RFC 4648).
fn bytes_of(text: &Value) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = Vec::new();
    for four in text.as_str().unwrap().as_bytes().chunks(4) {
        let digits: Vec<usize> =
            four.iter().filter_map(|c| DIGITS.iter().position(|digit| digit == c)).collect();
        let number =
            digits.iter().enumerate().map(|(k, digit)| digit << (18 - 6 * k)).sum::<usize>();
        out.extend(&number.to_be_bytes()[5..][..digits.len() - 1]);
    }
    out
}

/// The numbers of a quantity in a frame.
fn numbers_of(values: &Value, frame: usize) -> Vec<f64> {
    let (low, high) = (values["low"].as_f64().unwrap(), values["high"].as_f64().unwrap());
    let steps = bytes_of(&values["frames"][frame]);
    let steps = steps.chunks_exact(2).map(|two| u16::from_le_bytes(two.try_into().unwrap()));
    steps.map(|step| low + f64::from(step) * (high - low) / 65_534.0).collect()
}

#[test]
fn a_page_has_the_body_at_all_times_and_needs_nothing_else() {
    let folder = SceneFolder::new(CUBE);
    folder.run(&[]).expect(0);
    let (page, data) = page_of(&folder);
    for (start, _) in page.match_indices("http") {
        assert!(
            page[start..].starts_with("http://www.w3.org/2000/svg"),
            "{}",
            &page[start..start + 60]
        );
    }
    assert!(!page.contains("src=\"") && !page.contains("<link"));
    assert_eq!(data["summary"], folder.summary());
    let tables: Vec<&str> = data["tables"]
        .as_array()
        .unwrap()
        .iter()
        .map(|table| table["name"].as_str().unwrap())
        .collect();
    assert_eq!(tables, ["reactions", "energy"]);
    let body = &data["body"];
    assert_eq!(body["times"], serde_json::json!([0.0, 0.25, 0.5, 0.75, 1.0]));
    // 4 points a side: 3 x 3 faces on each of six sides.
    assert_eq!(bytes_of(&body["faces"]).len(), 4 * 4 * 54);
    for frame in 0..5 {
        let read = read_vtu(&folder.out().join(format!("frames/frame_{frame:06}.vtu"))).unwrap();
        let shown = numbers_of(&body["moved"], frame);
        let moved = &read.array("displacement").unwrap().values;
        let step = 0.3 / 65_534.0;
        assert!(shown.iter().zip(moved).all(|(shown, u)| (shown - u).abs() <= step), "{frame}");
        let sizes = numbers_of(&body["fields"][0]["values"], frame);
        let size = |u: &[f64]| u.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!(
            sizes.iter().zip(moved.chunks(3)).all(|(shown, u)| (shown - size(u)).abs() <= step)
        );
        let rest = bytes_of(&body["positions"]);
        let rest = rest.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap()));
        assert!(rest.zip(&read.positions).all(|(shown, x)| shown == *x as f32));
    }
    let names: Vec<&str> = body["fields"]
        .as_array()
        .unwrap()
        .iter()
        .map(|field| field["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["displacement", "residual", "volume", "held"]);
}

#[test]
fn a_large_body_is_thinned_and_said_to_be() {
    let large = CUBE
        .replace("spacing = 0.25", "spacing = 0.03125")
        .replace("increments = 4", "increments = 1");
    let folder = SceneFolder::new(&large.replace("frames = 4", "frames = 1"));
    folder.run(&["--set", "solver.tolerance=1e-2"]).expect(0);
    let (page, data) = page_of(&folder);
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    assert_eq!(data["body"]["points"], 32 * 32 * 32);
    // Evenly: no layer of either axis is without points.
    let shown = data["body"]["shown"].as_u64().unwrap();
    assert!((8_000..=20_000).contains(&shown), "{shown}");
    let rest = bytes_of(&data["body"]["positions"]);
    let rest: Vec<f32> =
        rest.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
    for axis in 0..3 {
        let places: std::collections::BTreeSet<u32> =
            rest.chunks(3).map(|row| (row[axis] * 32.0) as u32).collect();
        assert!(places.len() >= 20, "axis {axis}: {} of 32 layers", places.len());
    }
    assert_eq!(bytes_of(&data["body"]["faces"]).len(), 0);
}

#[test]
fn a_folder_without_a_run_and_a_frame_that_was_cut_are_named() {
    let folder = SceneFolder::new(CUBE);
    piola(&["report", &folder.path("nothing")]).expect(2).says(&["holds no run", "summary.json"]);
    folder.run(&[]).expect(0);
    let out = folder.path("out");
    // What the page is made of is not looked for in what is put into it.
    let named = folder.path("DATA TITLE");
    folder_copy(&out, &named);
    piola(&["report", &named]).expect(0);
    let text = std::fs::read_to_string(format!("{named}/report.html")).unwrap();
    assert!(text.contains("DATA TITLE</title>") && text.contains("{\"title\":"));
    let page = folder.path("page.html");
    piola(&["report", &out, "--out", &page]).expect(0);
    assert!(!std::path::Path::new(&format!("{out}/report.html")).exists());
    let frame = folder.out().join("frames/frame_000002.vtu");
    let bytes = std::fs::read(&frame).unwrap();
    std::fs::write(&frame, &bytes[..bytes.len() / 2]).unwrap();
    piola(&["report", &out]).expect(2).says(&["frame_000002.vtu", "was cut or changed"]);
    // A run that is made anew takes the page of the old one away.
    std::fs::write(&frame, &bytes).unwrap();
    piola(&["report", &out]).expect(0);
    folder.run(&["--force"]).expect(0);
    assert!(!std::path::Path::new(&format!("{out}/report.html")).exists());
}

fn folder_copy(from: &str, to: &str) {
    std::fs::create_dir_all(format!("{to}/frames")).unwrap();
    for below in ["", "frames/"] {
        for entry in std::fs::read_dir(format!("{from}/{below}")).unwrap() {
            let path = entry.unwrap().path();
            if path.is_file() {
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                std::fs::copy(&path, format!("{to}/{below}{name}")).unwrap();
            }
        }
    }
}

/// Without a browser there is nothing to see; where no test may skip, that is an error.
fn browser() -> Option<&'static str> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.into_iter().find(|name| Command::new(name).arg("--version").output().is_ok());
    let must_run = std::env::var_os("PIOLA_TESTS_MUST_RUN").is_some();
    assert!(found.is_some() || !must_run, "no browser: install chromium");
    found
}

#[test]
fn a_browser_shows_the_field() {
    let Some(browser) = browser() else { return };
    let folder = SceneFolder::new(CUBE);
    folder.run(&[]).expect(0);
    page_of(&folder);
    let address = format!("file://{}/report.html", folder.path("out"));
    let opened = |more: &[&str]| {
        let own = format!("--user-data-dir={}", folder.path("profile"));
        let common = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", &own];
        let size = "--window-size=1200,1000";
        let output = Command::new(browser).args(common).arg(size).args(more).arg(&address).output();
        output.expect("the browser ran")
    };
    let page = String::from_utf8(opened(&["--dump-dom"]).stdout).unwrap();
    assert!(page.contains("reached its end") && page.contains("<section id=\"body\">"), "{page}");
    assert_eq!(page.matches("<figure>").count(), 2);
    let shot = folder.path("shot.png");
    opened(&[&format!("--screenshot={shot}")]);
    let file = std::io::BufReader::new(std::fs::File::open(&shot).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let width = info.color_type.samples();
    // Where the body is, to the left of the scale of colours: cells of the least and the greatest field, and
    // of many between.
    let row = |y: usize| &pixels[y * info.line_size..][..info.line_size];
    let colours: std::collections::BTreeSet<[u8; 3]> = (200..640)
        .flat_map(|y| row(y).chunks_exact(width).skip(80).take(900))
        .map(|pixel| [pixel[0], pixel[1], pixel[2]])
        .filter(|[r, g, b]| r.abs_diff(*g) > 12 || g.abs_diff(*b) > 12)
        .collect();
    let is_dark = |[r, g, b]: &[u8; 3]| *r < 80 && *g < 90 && *b > 80;
    assert!(colours.iter().any(is_dark), "no cell near rest");
    let is_bright = |[r, g, b]: &[u8; 3]| *r > 240 && *g > 220 && *b < 60;
    assert!(colours.iter().any(is_bright), "no cell that moved");
    assert!(colours.len() > 15, "{} colours", colours.len());
}

/// A process that does not outlive a test that fails.
#[cfg(unix)]
struct Ended(std::process::Child);

#[cfg(unix)]
impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
    }
}

#[cfg(unix)]
#[test]
fn a_scene_that_is_watched_is_run_anew() {
    use std::time::{Duration, Instant};
    let folder = SceneFolder::new(CUBE.replace("\"javili2020\"", "\"law.piola\"").as_str());
    let law =
        |factor: u32| format!("potential law\nparameter C1\npsi(l) = {factor}*C1*L*(l/L - 1)^2\n");
    folder.file("law.piola", law(1));
    let (scene, out) = (folder.scene(), folder.path("out"));
    let mut watch = command(&["watch", &scene, "--out", &out, "--threads", "1"]);
    watch.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
    let mut child = Ended(watch.spawn().unwrap());
    let hash = || {
        let text = std::fs::read_to_string(format!("{out}/summary.json")).ok()?;
        let summary: Value = serde_json::from_str(&text).ok()?;
        let has_page = std::path::Path::new(&format!("{out}/report.html")).exists();
        has_page.then(|| summary["scene_hash"].to_string())
    };
    let wait_for = |is_there: &dyn Fn() -> bool, what: &str| {
        let start = Instant::now();
        while !is_there() {
            assert!(start.elapsed() < Duration::from_secs(60), "{what}");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait_for(&|| hash().is_some(), "no first run");
    let first = hash().unwrap();
    // A law that is wrong for a moment ends nothing.
    folder.file("law.piola", "potential law\npsi(l) = C9\n");
    std::thread::sleep(Duration::from_millis(600));
    folder.file("law.piola", law(2));
    wait_for(&|| hash().is_some_and(|hash| hash != first), "no second run");
    let killed = Command::new("kill").args(["-INT", &child.0.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert_eq!(child.0.wait().unwrap().code(), Some(130));
}
