//! The picture of a run shows something.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::BufReader;

use crate::scenes::strip;
use crate::support::{SceneFolder, piola, repository, table};

#[test]
fn the_picture_is_not_blank_and_says_what_it_shows() {
    let folder = strip();
    folder.run(&[]).expect(0);
    let png = BufReader::new(File::open(folder.out().join("picture.png")).unwrap());
    let mut reader = png::Decoder::new(png).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert!(info.width >= 600 && info.height >= 300, "{} x {}", info.width, info.height);
    assert_eq!(info.bit_depth, png::BitDepth::Eight);
    let samples = info.color_type.samples();
    let all: Vec<&[u8]> =
        pixels[..info.buffer_size()].chunks_exact(samples).map(|pixel| &pixel[..3]).collect();
    let colors: HashSet<&[u8]> = all.iter().copied().collect();
    // The body is coloured by its displacement: points of many different colours.
    let vivid = |c: &&&[u8]| c.iter().max().unwrap() - c.iter().min().unwrap() > 60;
    assert!(colors.iter().filter(vivid).count() > 30, "{} colours", colors.len());
    let inked = all.iter().filter(|pixel| pixel.iter().any(|c| *c < 200)).count();
    assert!(inked * 20 > all.len(), "{inked} of {} pixels are inked", all.len());
    let svg = fs::read_to_string(folder.out().join("picture.svg")).unwrap();
    for label in
        ["<svg", "</svg>", "reaction", "load parameter t", "Newton iteration", "displacement"]
    {
        assert!(svg.contains(label), "`{label}`");
    }
}

/// A bar that is loaded at its end, held at the other.
const BAR: &str = "[body]\nbox = [[0, 0], [1, 0.3]]\nspacing = 0.05\n[horizon]\nspacings = 3\n[material]\n\
    potential = \"javili2020\"\nparameters = { C1 = 1e3 }\n[sets]\nheld = \"X < 0.1\"\nend = \"X > 0.9\"\n\
    [[prescribe]]\nset = \"held\"\nu = [0, 0]\n[[load]]\nset = \"end\"\nforce = [\"2*t\", 0]\n\
    [[probe]]\nname = \"tip\"\nat = [1, 0.15]\n[steps]\nincrements = 4\n[output]\nframes = 4\n\
    fields = [\"stress\", \"von_mises\"]\n";

#[test]
fn a_film_has_all_frames_and_only_the_body_moves() {
    let folder = SceneFolder::new(BAR);
    folder.run(&[]).expect(0);
    let out = folder.path("out");
    piola(&["picture", &out, "--film", "--seconds", "2"]).expect(0).says(&["film.png"]);
    let file = File::open(folder.out().join("film.png")).unwrap();
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().unwrap();
    // The body at rest, and four steps.
    assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
    let (width, height) = (reader.info().width, reader.info().height);
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let mut delays = Vec::new();
    for picture in 0..5 {
        let info = reader.next_frame(&mut pixels).unwrap();
        let control = *reader.info().frame_control().unwrap();
        delays.push(f64::from(control.delay_num) / f64::from(control.delay_den));
        assert_eq!((info.width, info.height), (control.width, control.height));
        if picture == 0 {
            assert_eq!((info.width, info.height), (width, height));
        } else {
            // Below the axes and in the colour bar nothing changes.
            assert!(control.y_offset + control.height < height - 60, "{control:?}");
            let title = control.y_offset < 60;
            assert!(title, "the time is told anew: {control:?}");
        }
    }
    assert!(delays[..4].iter().all(|delay| (delay - 0.4).abs() < 1e-3), "{delays:?}");
    assert!((delays[4] - 1.4).abs() < 1e-3, "{delays:?}");
}

#[test]
fn the_body_is_drawn_at_any_time_by_any_field() {
    let folder = SceneFolder::new(BAR);
    folder.run(&[]).expect(0);
    let (out, svg) = (folder.path("out"), folder.path("p.svg"));
    let drawn = |arguments: &[&str]| {
        let all = [&["picture", &out, "--out", &svg], arguments].concat();
        piola(&all).expect(0).says(&["p.svg"]);
        fs::read_to_string(&svg).unwrap()
    };
    for (arguments, labels) in [
        (&["--at", "0.45"][..], ["t = 0.5", "displacement |u|", ": psi(l) of javili2020"]),
        (&["--field", "stress_xx"], ["t = 1", "stress_xx", "Pa)"]),
        (&["--field", "stress"], ["t = 1", "|stress|", "Pa)"]),
        (&["--field", "von_mises", "--at", "-1"], ["t = 0", "von_mises", "Pa)"]),
        (&["--field", "residual_y"], ["residual_y", "N)", "120 points"]),
    ] {
        let svg = drawn(arguments);
        for label in labels {
            assert!(svg.contains(label), "{arguments:?}: `{label}`");
        }
    }
    piola(&["picture", &out, "--field", "stress_xz_y"]).expect(2).says(&[
        "no field `stress_xz_y`",
        "stress, von_mises",
        "[output] fields",
    ]);
    piola(&["picture", &out, "--out", "p.jpg"]).expect(2).says(&["p.jpg", ".png or .svg"]);
    piola(&["picture", &out, "--film", "--out", "p.svg"]).expect(2).says(&["animated PNG"]);
    piola(&["picture", &folder.path("")]).expect(2).says(&["holds no run", "summary.json"]);
    let frame = folder.out().join("frames/frame_000004.vtu");
    let bytes = fs::read(&frame).unwrap();
    fs::write(&frame, &bytes[..bytes.len() / 2]).unwrap();
    piola(&["picture", &out]).expect(2).says(&["frame_000004.vtu", "cut or changed"]);
    folder.run(&["--set", "output.frames=0", "--force"]).expect(0);
    // The body at rest is always there.
    assert!(drawn(&[]).contains("t = 0"));
}

#[test]
fn force_against_displacement_begins_at_rest_and_knows_loads() {
    let folder = SceneFolder::new(BAR);
    folder.run(&[]).expect(0);
    let out = folder.path("out");
    let (names, rows) = table(&folder.out().join("force_displacement.csv"));
    let column = |name: &str| -> Vec<f64> {
        let place =
            names.iter().position(|other| other == name).unwrap_or_else(|| panic!("{name}"));
        rows.iter().map(|row| row[place]).collect()
    };
    // In equilibrium the load on the end is the force there, and the support takes it; at rest there is none.
    assert_eq!(rows.len(), 5);
    assert!(rows[0].iter().all(|number| *number == 0.0), "{rows:?}");
    for (k, (end, held)) in column("end_x").iter().zip(column("held_x")).enumerate().skip(1) {
        let load = 0.5 * k as f64;
        assert!(
            (end - load).abs() < 1e-9 * load && (held + load).abs() < 1e-9 * load,
            "{end} {held}"
        );
    }
    assert!(column("held_u").iter().all(|u| *u == 0.0));
    let (names, probes) = table(&folder.out().join("probes.csv"));
    assert_eq!(names[1], "tip_u");
    let moved = column("end_u");
    assert!(moved.windows(2).all(|two| two[0] < two[1]));
    // The mean of the last points, and the outermost of them.
    assert!(
        probes.iter().zip(&moved[1..]).all(|(tip, mean)| tip[1] > *mean && tip[1] < 1.2 * mean)
    );
    for (against, label) in
        [("end", "displacement of end along x"), ("tip", "displacement of tip along x")]
    {
        let svg = folder.path("force.svg");
        piola(&["picture", &out, "--force", "end", "--against", against, "--out", &svg]).expect(0);
        let svg = fs::read_to_string(svg).unwrap();
        assert!(svg.contains(label) && svg.contains("force on end along x"), "{label}");
        // The body at rest and four steps are dots.
        assert_eq!(svg.matches("<circle").count(), 5);
    }
    piola(&["picture", &out, "--force", "end"]).expect(0).says(&["force.png"]);
    piola(&["picture", &out, "--force", "nobody"]).expect(2).says(&["`nobody`", "held_u"]);
    piola(&["picture", &out, "--force", "end", "--against", "nobody"])
        .expect(2)
        .says(&["`nobody`"]);
}

#[test]
fn cells_that_belong_to_another_body_are_refused() {
    let folder = SceneFolder::new("");
    let out = folder.path("out");
    let ring = repository("examples/ring/scene.toml").display().to_string();
    piola(&["run", &ring, "--out", &out, "--set", "body.nodes=\"cells\""]).expect(0);
    piola(&["picture", &out]).expect(0);
    let frames = folder.out().join("frames");
    fs::copy(frames.join("frame_000002.vtu"), frames.join("cells_000002.vtu")).unwrap();
    piola(&["picture", &out]).expect(2).says(&["cells_000002.vtu", "cut or changed"]);
}
