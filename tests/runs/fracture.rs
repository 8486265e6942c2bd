//! Bodies that break, through the program: what a run leaves, what is refused, and runs that are ended in the
//! middle of a crack.

use std::fs;

use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{SceneFolder, number, piola, table};

/// A bond of unit constant that breaks at a stretch of 1 %.
pub(crate) const BRITTLE: &str = "potential brittle\nparameter C = 1e13\nparameter s0 = 0.01\n\
                       psi(l) = 1/2*C*L*(l/L - 1)^2\nbreak when l/L - 1 > s0 \"critical stretch\"\n";

/// A plate with a slit that is torn apart.
pub(crate) const TORN: &str = r#"
[body]
box = [[0, 0], [1, 0.6]]
spacing = 0.05
[horizon]
spacings = 3.015
[material]
potential = "brittle.piola"
density = 1000
[sets]
upper = "Y > 0.4"
low = "Y < 0.05"
high = "Y > 0.55"
[[crack]]
segment = [[-0.1, 0.3], [0.4, 0.3]]
[fracture]
unbreakable = ["low", "high"]
[[track]]
name = "tip"
axis = "X"
[[prescribe]]
set = "low"
v = [0, -0.5]
[[prescribe]]
set = "high"
v = [0, 0.5]
[motion]
end = 0.02
[output]
frames = 4
rows = 40
colour = "damage"
"#;

/// The damage of the first frame and of the last, of every point.
fn damage(folder: &SceneFolder) -> [Vec<f64>; 2] {
    let out = folder.out();
    let frames = read_pvd(&fs::read_to_string(out.join("run.pvd")).unwrap()).unwrap();
    [0, frames.len() - 1].map(|k| {
        let frame = read_vtu(&out.join(&frames[k].1)).unwrap();
        frame.array("damage").unwrap().values.clone()
    })
}

fn torn(change: impl Fn(&str) -> String) -> SceneFolder {
    let folder = SceneFolder::new(&change(TORN));
    folder.file("brittle.piola", BRITTLE);
    folder
}

#[test]
fn a_plate_is_torn_and_its_account_closes() {
    let folder = torn(str::to_owned);
    folder.run(&[]).expect(0);
    let out = folder.out();
    let (header, rows) = table(&out.join("motion.csv"));
    let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
    let of = |row: &[f64], name: &str| row[column(name)];
    // The slit cuts 8 columns of points: rational arithmetic is tried elsewhere.
    let (first, last) = (&rows[0], rows.last().unwrap());
    assert!(of(first, "broken_bonds") > 100.0 && of(first, "released") == 0.0);
    assert!(of(last, "broken_bonds") > of(first, "broken_bonds") + 200.0);
    let largest = rows.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    for pair in rows.windows(2) {
        assert!(of(&pair[1], "broken_bonds") >= of(&pair[0], "broken_bonds"));
        assert!(of(&pair[1], "released") >= of(&pair[0], "released"));
    }
    let sum = |row: &[f64]| {
        let of = |name: &str| of(row, name);
        of("kinetic_leapfrog") + of("stored") - of("quadrature") + of("released")
            - of("timing")
            - of("prescribed")
    };
    for row in &rows {
        assert!((sum(row) - sum(first)).abs() < 1e-12 * largest);
        assert!(of(row, "rounding").abs() < 1e-12 * largest);
    }
    let summary = folder.summary();
    let motion = &summary["motion"];
    assert_eq!(number(&motion["energies"]["broken_bonds"]), of(last, "broken_bonds"));
    assert_eq!(number(&motion["energies"]["released"]), of(last, "released"));
    let [start, end] = damage(&folder);
    assert!(start.iter().chain(&end).all(|d| (0.0..=1.0).contains(d)));
    assert!(start.iter().zip(&end).all(|(before, after)| after >= before));
    assert!(start.iter().any(|d| *d > 0.3) && end.iter().filter(|d| **d > 0.3).count() > 30);
    let picture = fs::read_to_string(out.join("picture.svg")).unwrap();
    assert!(picture.contains("damage") && picture.contains("released"));
}

/// The same bits for any number of threads, and the same picture above as below, as long as the crack
/// runs straight.
#[test]
fn threads_change_nothing_and_the_plate_is_torn_as_its_mirror_image() {
    let [one, two] = ["1", "2"].map(|threads| {
        let folder = torn(str::to_owned);
        folder.run(&["--threads", threads]).expect(0);
        fs::read(folder.out().join("motion.csv")).unwrap()
    });
    assert_eq!(one, two);
    let folder = torn(|scene| scene.replace("end = 0.02", "end = 0.012"));
    folder.run(&[]).expect(0);
    let [_, damage] = damage(&folder);
    // Columns of 12 points: the last coordinate goes fastest.
    for column in damage.chunks(12) {
        for k in 0..6 {
            assert!((column[k] - column[11 - k]).abs() < 1e-12, "{column:?}");
        }
    }
}

/// A slit is no damage, and a crack in a body at rest makes it softer.
#[test]
fn slits_and_cracks_at_rest() {
    let folder = torn(|scene| {
        scene.replace("segment", "damaged = false\nsegment").replace("end = 0.02", "end = 1e-3")
    });
    folder.run(&[]).expect(0);
    let (header, rows) = table(&folder.out().join("motion.csv"));
    let broken = header.iter().position(|x| x == "broken_bonds").unwrap();
    assert_eq!(rows[0][broken], 0.0);
    assert!(damage(&folder)[0].iter().all(|d| *d == 0.0));

    let pull = |crack: &str| {
        let text = format!(
            "[body]\nbox = [[0, 0], [1, 0.6]]\nspacing = 0.05\n[horizon]\nspacings = 3.015\n\
             [material]\npotential = \"javili2020\"\nparameters = {{ C1 = 1.0 }}\n[sets]\n\
             low = \"Y < 0.05\"\nhigh = \"Y > 0.55\"\n{crack}\n[[prescribe]]\nset = \"low\"\n\
             u = [0, 0]\n[[prescribe]]\nset = \"high\"\nu = [0, \"1e-3*t\"]\n[steps]\n\
             increments = 1\n"
        );
        let folder = SceneFolder::new(&text);
        folder.run(&[]).expect(0);
        let (header, rows) = table(&folder.out().join("reactions.csv"));
        rows.last().unwrap()[header.iter().position(|x| x == "high_y").unwrap()]
    };
    let crack = "[[crack]]\nsegment = [[-1, 0.3], [0.4, 0.3]]";
    let (whole, cracked) = (pull(""), pull(crack));
    assert!(cracked > 0.3 * whole && cracked < 0.9 * whole, "{cracked} {whole}");
    let through = pull("[[crack]]\nsegment = [[-1, 0.3], [2, 0.3]]\ndamaged = false");
    assert!(through.abs() < 1e-9 * whole, "{through}");
}

#[test]
fn what_cannot_break_is_refused_with_its_place() {
    let of = |scene: &str, potential: &str| {
        let folder = SceneFolder::new(scene);
        folder.file("brittle.piola", potential);
        piola(&["run", &folder.scene(), "--out", &folder.path("out")])
    };
    let states = format!("{BRITTLE}theta = integral(l/L - 1)\npsi(theta) = theta^2\n");
    let implicit = TORN.replace("[motion]", "[motion]\nmethod = \"midpoint\"");
    of(&implicit, &states).expect(2).says(&["conflicting-keys", "psi(theta)", "explicit"]);
    let whole = BRITTLE.replace("break", "#");
    let gradients = format!("{whole}psi(F) = 1e9*(tr(F'*F) - 2 - 2*ln(J))\n");
    of(&implicit, &gradients).expect(2).says(&["psi(F)", "explicit motions"]);
    for (from, to, says) in [
        ("segment = [[-0.1, 0.3], [0.4, 0.3]]", "segment = [[0, 0]]", "two points"),
        ("segment = [[-0.1, 0.3], [0.4, 0.3]]", "segment = [[1, 1], [1, 1]]", "extent"),
        ("segment = [[-0.1, 0.3], [0.4, 0.3]]", "segment = [[0, 0, 0], [1, 1, 1]]", "components"),
        ("segment", "polygon", "a crack in 3 dimensions"),
        ("segment = [[-0.1, 0.3], [0.4, 0.3]]", "", "neither `segment`, `polygon` nor `between`"),
        ("segment", "between = [\"low\", \"high\"]\nsegment", "both `between` and `segment`"),
        ("segment = [[-0.1, 0.3], [0.4, 0.3]]", "between = [\"low\"]", "two names of sets"),
        ("segment = [[-0.1, 0.3], [0.4, 0.3]]", "between = [\"low\", \"hihg\"]", "mean `high`"),
        ("unbreakable = [\"low\", \"high\"]", "unbreakable = [\"lo\"]", "did you mean `low`"),
        ("unbreakable = [\"low\", \"high\"]", "unbreakable = \"low\"", "expected an array"),
        ("[fracture]\nunbreakable", "[fracture]\nunbreakabel", "did you mean `unbreakable`"),
    ] {
        assert!(TORN.contains(from));
        of(&TORN.replacen(from, to, 1), BRITTLE).expect(2).says(&[says]);
    }
    // What runs through points is told, and what misses the body.
    let folder =
        torn(|scene| scene.replace("[-0.1, 0.3], [0.4, 0.3]", "[-0.1, 0.325], [0.4, 0.325]"));
    piola(&["check", &folder.scene()]).expect(0).says(&["boundary-on-points", "half a spacing"]);
    let folder = torn(|scene| scene.replace("[-0.1, 0.3], [0.4, 0.3]", "[-0.1, 3], [0.4, 3]"));
    piola(&["check", &folder.scene()]).expect(0).says(&["idle-entry", "cuts no bond"]);
    let between = "between = [\"low\", \"high\"]";
    let folder = torn(|scene| scene.replace("segment = [[-0.1, 0.3], [0.4, 0.3]]", between));
    piola(&["check", &folder.scene()]).expect(0).says(&["idle-entry", "within the horizon"]);
    let planned = piola(&["plan", &torn(str::to_owned).scene()]).expect(0).stdout;
    assert!(planned.contains("status of bonds"), "{planned}");
}

/// A crack between two sets cuts the bonds between them and no others, and the scene that a run leaves says so;
/// bonds that never were there are not broken ones.
#[test]
fn a_crack_between_two_sets_cuts_their_bonds() {
    let line = "segment = [[-0.1, 0.3], [0.4, 0.3]]";
    let sets = "[sets]\nbelow = \"X < 0.4 and Y < 0.3\"\nabove = \"X < 0.4 and Y > 0.3\"\n";
    let run = |crack: &str| {
        let folder = torn(|scene| scene.replace(line, crack).replace("[sets]\n", sets));
        folder.run(&[]).expect(0);
        let motion = fs::read(folder.out().join("motion.csv")).unwrap();
        let (header, rows) = table(&folder.out().join("motion.csv"));
        let cut = rows[0][header.iter().position(|x| x == "broken_bonds").unwrap()];
        (motion, cut, fs::read_to_string(folder.out().join("scene.resolved.toml")).unwrap())
    };
    let (forwards, cut, resolved) = run("between = [\"below\", \"above\"]");
    assert!(resolved.contains("between = [\"below\", \"above\"]"), "{resolved}");
    let (backwards, _, _) = run("between = [\"above\", \"below\"]");
    assert!(forwards == backwards, "the order of the sets means nothing");
    // Eight columns of points on either side.
    assert_eq!(cut, crossing_bonds(8) as f64);
    let (whole, none, _) = run("between = [\"below\", \"above\"]\ndamaged = false");
    assert_eq!(none, 0.0);
    assert!(whole != forwards, "they are not counted");
}

/// Bonds of a horizon of 3.015 spacings that cross a row between `n` columns of points, all of them there.
fn crossing_bonds(n: i64) -> usize {
    let mut count = 0;
    for (below, above) in (1..=3).flat_map(|below| (1..=3).map(move |above| (below, above))) {
        let dy = below + above - 1;
        for (one, other) in (0..n).flat_map(|one| (0..n).map(move |other| (one, other))) {
            let dx = one - other;
            count += usize::from(((dx * dx + dy * dy) as f64).sqrt() <= 3.015);
        }
    }
    count
}

/// Bonds that soften before they break: what they lose by it has a column, the account closes, states that
/// the scene gives count, and a run that was interrupted goes on with the same bits.
#[test]
fn bonds_that_remember_leave_an_account() {
    let soft = "potential soft\nparameter s0 = 0.01\nparameter s1 = 0.03\nstate k = 0\ns = l/L - 1\n\
                update k = if s > s0 then max(k, s) else k\n\
                D = if k <= s0 then 0 else (if k >= s1 then 1 else s1*(k - s0)/(k*(s1 - s0)))\n\
                psi(l) = (if s > 0 then 1 - D else 1)*1e9*L*s^2\nbreak when s > s1\n";
    let run = |scene: &str, threads: &str| {
        let folder = SceneFolder::new(scene);
        folder.file("brittle.piola", soft);
        folder.run(&["--threads", threads]).expect(0);
        let bytes = fs::read(folder.out().join("motion.csv")).unwrap();
        let rounding = number(&folder.summary()["motion"]["rounding"]);
        assert!(rounding < 1e-12, "{rounding:e}");
        let (header, rows) = table(&folder.out().join("motion.csv"));
        let last = |name: &str| {
            let column = header.iter().position(|x| x == name).unwrap();
            rows.last().unwrap()[column]
        };
        (bytes, ["dissipated", "released", "broken_bonds"].map(last))
    };
    let scene = TORN.replace("end = 0.02", "end = 0.01");
    let (one, [dissipated, released, broken]) = run(&scene, "1");
    let (two, _) = run(&scene, "2");
    assert_eq!(one, two, "any number of threads");
    // What softens is nearly gone when it breaks.
    assert!(dissipated > 10.0 * released && released >= 0.0 && broken > 20.0);
    let begun = scene.replace("density = 1000", "density = 1000\nparameters = { k = \"0.02*X\" }");
    let (_, [less, _, _]) = run(&begun, "1");
    assert!(less < 0.95 * dissipated, "bonds that begin softer lose less: {less} of {dissipated}");
    let in_time = scene.replace("density = 1000", "density = 1000\nparameters = { k = \"t\" }");
    let folder = SceneFolder::new(&in_time);
    folder.file("brittle.piola", soft);
    folder.run(&[]).expect(2).says(&["knows no t", "as the potential says"]);
}

/// Bonds that are beyond their threshold at the start break there, and the account begins behind that.
#[test]
fn what_is_torn_at_the_start_breaks_there() {
    let folder = torn(|scene| {
        scene.replace(
            "[[prescribe]]\nset = \"low\"",
            "[[initial]]\nset = \"upper\"\nu = [0, 0.02]\n[[prescribe]]\nset = \"low\"",
        )
    });
    folder.run(&[]).expect(0).says(&["bonds break before the first step"]);
    let (header, rows) = table(&folder.out().join("motion.csv"));
    let of = |name: &str| rows[0][header.iter().position(|x| x == name).unwrap()];
    assert!(of("released") == 0.0 && of("broken_bonds") > 0.0);
}

/// What the bonds across a plane hold, against a count of the bonds that cross the middle of a block.
#[test]
fn the_fracture_energy_of_a_lattice_is_that_of_the_bonds_across_a_plane() {
    let (h, ratio, k, gc) = (0.5, 3.0, 7.0, 0.03);
    let text = format!(
        "[body]\nbox = [[0, 0, 0], [3, 3, 3]]\nspacing = {h}\n[horizon]\nspacings = {ratio}\n[material]\n\
         potential = \"prototype_microelastic_brittle\"\nparameters = {{ K = {k}, Gc = {gc} }}\n"
    );
    let folder = SceneFolder::new(&text);
    let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
    let planes = found["fracture"]["planes"].as_array().unwrap();
    let delta: f64 = ratio * h;
    let s0 = (5.0 * gc / (9.0 * k * delta)).sqrt();
    for (number, stretch) in [0, 1].map(|k| (k, number(&found["fracture"]["critical_stretch"][k])))
    {
        assert!((stretch / s0 - 1.0).abs() < 1e-12, "{number}");
    }
    let c = 18.0 * k / (std::f64::consts::PI * delta * delta * delta * delta);
    // Points of a cell of the plane at all depths below it, and all points above.
    let reach = 3_i32;
    let mut sum = 0.0;
    for depth in 0..reach {
        for (dx, dy, dz) in (-reach..=reach).flat_map(|x| {
            (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |z| (x, y, z)))
        }) {
            let squared = dx * dx + dy * dy + dz * dz;
            if squared <= 9 && dx > depth {
                let length = h * f64::from(squared).sqrt();
                sum += (h * h * h) * (h * h * h) * 0.5 * c * length * s0 * s0;
            }
        }
    }
    let expected = sum / (h * h);
    let of_plane = number(&planes[0][1]);
    assert!((of_plane / expected - 1.0).abs() < 1e-12, "{of_plane:e} {expected:e}");
    // Bonds that soften take the same work on a longer way.
    let soft = text.replace("prototype_microelastic_brittle", "bilinear_softening");
    let soft = SceneFolder::new(&soft.replace("Gc = 0.03", "Gc = 0.03, s0 = 0.02"));
    let found = piola(&["moduli", &soft.scene(), "--format", "json"]).expect(0).json();
    let softened = number(&found["fracture"]["planes"][0][1]);
    assert!((softened / expected - 1.0).abs() < 1e-7, "{softened:e} {expected:e}");
    let elastic = text.replace("prototype_microelastic_brittle", "silling2000");
    let elastic = SceneFolder::new(&elastic.replace(", Gc = 0.03", ""));
    let found = piola(&["moduli", &elastic.scene(), "--format", "json"]).expect(0).json();
    assert!(found["fracture"].is_null());
}

/// Strains of bonds near a crack that stands open are those of what is left: a body in two halves that fly
/// apart has none.
#[test]
fn strains_look_at_bonds_that_are_left() {
    let folder = torn(|scene| {
        let halves = "[[initial]]\nset = \"upper\"\nv = [0, 10]\n";
        let scene = scene.replace("[-0.1, 0.3], [0.4, 0.3]", "[-1, 0.4], [2, 0.4]");
        let start = scene.find("[[prescribe]]").unwrap();
        let end = scene.find("[motion]").unwrap();
        let scene = format!("{}{halves}{}", &scene[..start], &scene[end..]);
        scene.replace("[output]", "[output]\nfields = [\"strain\"]")
    });
    folder.run(&[]).expect(0);
    let out = folder.out();
    let frames = read_pvd(&fs::read_to_string(out.join("run.pvd")).unwrap()).unwrap();
    let last = read_vtu(&out.join(&frames[frames.len() - 1].1)).unwrap();
    assert!(last.array("displacement").unwrap().values.iter().any(|u| *u > 0.19));
    assert!(last.array("strain").unwrap().values.iter().all(|e| e.abs() < 1e-9));
}

/// There are no tetrahedra in the plane, whatever conditions a potential has for them, and triangles without an energy
/// have nothing to lose.
#[test]
fn conditions_of_what_has_no_energy_mean_nothing() {
    for (c2, counted) in [(0.0, false), (1e14, true)] {
        let law = "potential = \"javili2020_brittle\"";
        let parameters =
            format!("parameters = {{ C1 = 1e13, C2 = {c2:e}, s0 = 0.01, g0 = 0.005 }}");
        let folder = torn(|scene| {
            let scene = scene.replace("potential = \"brittle.piola\"", law);
            scene.replace(law, &format!("{law}\n{parameters}"))
        });
        folder.run(&[]).expect(0);
        let (header, rows) = table(&folder.out().join("motion.csv"));
        let has = |name: &str| header.iter().any(|own| own == name);
        assert_eq!([has("broken_areas"), has("broken_volumes")], [counted, false], "{header:?}");
        let place = header.iter().position(|own| own == "broken_bonds").unwrap();
        assert!(rows[rows.len() - 1][place] > rows[0][place]);
        let plan = piola(&["plan", &folder.scene()]).expect(0);
        assert_eq!(plan.stdout.contains("status of cliques"), counted, "{}", plan.stdout);
    }
}
