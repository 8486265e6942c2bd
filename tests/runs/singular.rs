//! Families that breaking leaves too small, and what `[fracture] singular` makes of a run then: the end of a bar
//! whose last points are pulled off.

use std::fs;

use serde_json::Value;

use crate::load_steps::Rows;
use crate::support::{SceneFolder, piola, table};

/// What leads through steps, or through time, with the `u` or `v` of the end that is pulled.
const STEPS: [&str; 2] = ["[steps]\nincrements = 4\n", "u = [\"0.1*t\""];
const MOTION: [&str; 2] = ["[motion]\nend = 0.2\n", "v = [1"];

/// A bar of points one apart; those of one plane are free, and the last plane is pulled off.
fn bar(d: usize, [way, pulled]: [&str; 2], fracture: &str) -> SceneFolder {
    let (across, zeros) = (", 2".repeat(d - 1), ", 0".repeat(d - 1));
    let density = if way == MOTION[0] { "density = 1000\n" } else { "" };
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [[0{zeros}], [6{across}]]\nspacing = 1\n[horizon]\nspacings = 1.5\n\
         [material]\npotential = \"solid.piola\"\n{density}[sets]\nleft = \"X < 4\"\nright = \"X > 5\"\n\
         [fracture]\nunbreakable = [\"left\"]\n{fracture}\n[[prescribe]]\nset = \"left\"\n\
         u = [0{zeros}]\n[[prescribe]]\nset = \"right\"\n{pulled}{zeros}]\n{way}[output]\nframes = 2\n"
    ));
    folder.file(
        "solid.piola",
        format!(
            "potential solid\npsi(F) = 1e9*(tr(F'*F) - {d} - 2*ln(J))\n\
             break when l/L - 1 > 0.02 \"critical stretch\"\n"
        ),
    );
    folder
}

/// A crack between the last plane and the rest.
fn crack(d: usize) -> &'static str {
    match d {
        2 => "[[crack]]\nsegment = [[5, -1], [5, 3]]",
        _ => "[[crack]]\npolygon = [[5, -1, -1], [5, 3, -1], [5, 3, 3], [5, -1, 3]]",
    }
}

/// The first point of the last plane, as it is named.
fn first(d: usize) -> &'static str {
    if d == 2 { "point 10 at (5.5, 0.5)" } else { "point 20 at (5.5, 0.5, 0.5)" }
}

fn reason(folder: &SceneFolder) -> Value {
    folder.summary()["exit_reason"].clone()
}

#[test]
fn load_steps_end_where_a_family_becomes_too_small() {
    for d in [2, 3] {
        let folder = bar(d, STEPS, "");
        folder.run(&[]).expect(0);
        let rows = Rows::of(&folder);
        rows.close();
        assert_eq!(rows.column("t"), [0.25, 0.5, 0.75, 1.0]);
        let broken = rows.column("broken_bonds");
        assert!(broken[1] == 0.0 && broken[2] > 0.0);
        for word in ["stop", "refuse"] {
            let folder = bar(d, STEPS, &format!("singular = \"{word}\""));
            let says = ["at t = 0.75 too few", first(d), "the last equilibrium is at t = 0.5"];
            folder.run(&[]).expect(3).says(&says);
            assert_eq!(reason(&folder), "singular");
            let rows = Rows::of(&folder);
            rows.close();
            assert_eq!((rows.column("t"), rows.last("broken_bonds")), (vec![0.25, 0.5], 0.0));
            for name in ["displacement.csv", "picture.png"] {
                assert!(folder.out().join(name).is_file(), "{name}");
            }
        }
    }
}

#[test]
fn motions_end_where_a_family_becomes_too_small() {
    for d in [2, 3] {
        let folder = bar(d, MOTION, "");
        folder.run(&[]).expect(0);
        for word in ["stop", "refuse"] {
            let folder = bar(d, MOTION, &format!("singular = \"{word}\""));
            folder.run(&[]).expect(3).says(&["after ", "steps, too few", first(d)]);
            assert_eq!(reason(&folder), "singular");
            let (header, rows) = table(&folder.out().join("motion.csv"));
            let of = |row: &[f64], name: &str| row[header.iter().position(|x| x == name).unwrap()];
            let [.., before, last] = &rows[..] else { panic!("two rows") };
            // The last row is that of the step at which it happened, and its account closes.
            assert!(of(last, "t") < 0.2 && of(last, "broken_bonds") > of(before, "broken_bonds"));
            let largest = last.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            assert!(of(last, "rounding").abs() < 1e-12 * largest);
            let frames = fs::read_to_string(folder.out().join("run.pvd")).unwrap();
            assert!(frames.contains(&format!("timestep=\"{}\"", of(last, "t"))), "{frames}");
        }
    }
}

/// A crack from the start may leave such families, unless the scene refuses them; what breaks later counts
/// alone.
#[test]
fn families_that_cracks_leave_are_refused_where_the_scene_says_so() {
    for (d, way) in [(2, STEPS), (3, STEPS), (2, MOTION), (3, MOTION)] {
        for word in ["release", "stop"] {
            let folder = bar(d, way, &format!("singular = \"{word}\"\n{}", crack(d)));
            folder.run(&[]).expect(0);
        }
        let folder = bar(d, way, &format!("singular = \"refuse\"\n{}", crack(d)));
        let says = ["conflicting-keys", "cut by cracks", first(d), "singular = \"release\""];
        folder.run(&[]).expect(2).says(&says);
        assert!(!folder.out().join("summary.json").exists());
        piola(&["check", &folder.scene()]).expect(1).says(&says);
        piola(&["plan", &folder.scene()]).expect(2).says(&says);
    }
    let folder = bar(2, STEPS, "singular = \"freeze\"");
    folder.run(&[]).expect(2).says(&["singular", "\"release\" or \"stop\" or \"refuse\""]);
}

/// A point that gathers is in the same case once it has no bond at all.
#[test]
fn gathering_points_without_bonds_end_a_run() {
    let scene = "[body]\nbox = [[0, 0], [6, 1]]\nspacing = 1\n[horizon]\nspacings = 1.5\n[material]\n\
                 potential = \"solid.piola\"\n[sets]\nall = \"X > 0\"\nleft = \"X < 4\"\nright = \"X > 5\"\n\
                 [fracture]\nunbreakable = [\"left\"]\nsingular = \"stop\"\n[[prescribe]]\nset = \"all\"\n\
                 u = [\"free\", 0]\n[[prescribe]]\nset = \"left\"\nu = [0, \"free\"]\n[[prescribe]]\n\
                 set = \"right\"\nu = [\"0.1*t\", \"free\"]\n[steps]\nincrements = 4\n";
    let folder = SceneFolder::new(scene);
    folder.file(
        "solid.piola",
        "potential solid\nm = integral(L^2)\npsi(l, m) = 1e9/m*(l - L)^2\nbreak when l/L - 1 > 0.02\n",
    );
    folder.run(&[]).expect(3).says(&["at t = 0.5 too few", "point 5 at (5.5, 0.5)"]);
    assert_eq!(reason(&folder), "singular");
}
