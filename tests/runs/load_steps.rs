//! Load steps of bodies whose bonds break: events that are known in closed form, the account of energy, parts
//! that come loose, what is refused.

use std::collections::BTreeSet;
use std::fs;

use crate::fracture::BRITTLE;
use crate::support::{SceneFolder, json_file, number, piola, table};

/// A plate with two notches.
pub(crate) const NOTCHED: &str = r#"
[body]
box = [[0, 0], [1, 0.6]]
spacing = 0.05
[horizon]
spacings = 3.015
[material]
potential = "brittle.piola"
[sets]
low = "Y < 0.1"
high = "Y > 0.5"
[[crack]]
segment = [[-0.1, 0.3], [0.3, 0.3]]
[[crack]]
segment = [[0.7, 0.3], [1.1, 0.3]]
[fracture]
unbreakable = ["low", "high"]
[[prescribe]]
set = "low"
u = [0, 0]
[[prescribe]]
set = "high"
u = [0, "0.02*t"]
[steps]
increments = 10
[output]
frames = 2
"#;

/// A chain of points one apart, pulled at its ends.
fn chain(points: usize, spacings: f64, s0: &str, steps: &str) -> SceneFolder {
    let (last, pulled) = (points - 1, 0.05 * points as f64);
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0], [{points}, 1]]\nspacing = 1\n[horizon]\nspacings = {spacings}\nweights = \"volumes\"\n\
         [material]\npotential = \"brittle.piola\"\nparameters = {{ C = 1, s0 = {s0} }}\n[sets]\n\
         all = \"X > 0\"\nleft = \"X < 1\"\nright = \"X > {last}\"\n[[prescribe]]\nset = \"all\"\n\
         u = [\"free\", 0]\n[[prescribe]]\nset = \"left\"\nu = [0, \"free\"]\n[[prescribe]]\n\
         set = \"right\"\nu = [\"{pulled}*t\", \"free\"]\n[steps]\nincrements = 4\n{steps}"
    ));
    folder.file("brittle.piola", BRITTLE);
    folder
}

fn notched(change: impl Fn(&str) -> String) -> SceneFolder {
    let folder = SceneFolder::new(&change(NOTCHED));
    folder.file("brittle.piola", BRITTLE);
    folder
}

/// The columns of a run's `energy.csv` by name, row by row.
pub(crate) struct Rows {
    header: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Rows {
    pub(crate) fn of(folder: &SceneFolder) -> Rows {
        let (header, rows) = table(&folder.out().join("energy.csv"));
        Rows { header, rows }
    }

    pub(crate) fn column(&self, name: &str) -> Vec<f64> {
        let at = self.header.iter().position(|x| x == name).unwrap();
        self.rows.iter().map(|row| row[at]).collect()
    }

    pub(crate) fn last(&self, name: &str) -> f64 {
        *self.column(name).last().unwrap()
    }

    /// `t` and the number of broken bonds where some broke.
    fn events(&self) -> Vec<(f64, usize)> {
        let mut before = 0.0;
        let all = self.column("t").into_iter().zip(self.column("broken_bonds"));
        let new = all.filter(|(_, broken)| std::mem::replace(&mut before, *broken) != *broken);
        new.map(|(t, broken)| (t, broken as usize)).collect()
    }

    /// The account closes to 1e-12 of its largest column at every step.
    pub(crate) fn close(&self) {
        let terms = [
            ("total", 1.0),
            ("released", 1.0),
            ("dissipated", 1.0),
            ("relaxed", 1.0),
            ("external", -1.0),
            ("prescribed", -1.0),
            ("quadrature", -1.0),
        ];
        let mut sums = vec![0.0; self.rows.len()];
        let mut largest = 0.0_f64;
        for (name, sign) in terms {
            for (sum, value) in sums.iter_mut().zip(self.column(name)) {
                *sum += sign * value;
                largest = largest.max(value.abs());
            }
        }
        assert!(largest > 0.0);
        assert!(sums.iter().all(|sum| sum.abs() < 1e-12 * largest), "{sums:?} {largest}");
    }
}

/// The events of a chain with bonds over one and two spacings, by linear algebra: at each the bond breaks that
/// has least to go, where all stretches are in proportion to `t`.
fn expected(points: usize, s0: impl Fn(f64) -> f64) -> Vec<f64> {
    let place = |k: usize| k as f64 + 0.5;
    let mut bonds: Vec<(usize, usize)> =
        [1, 2].iter().flat_map(|far| (0..points - far).map(move |k| (k, k + far))).collect();
    let pulled = 0.05 * points as f64;
    let mut times = Vec::new();
    loop {
        let n = points;
        // Rows of K u = 0 with the ends prescribed, at t = 1.
        let mut rows = vec![vec![0.0; n + 1]; n];
        for &(i, j) in &bonds {
            let stiffness = 1.0 / (j - i) as f64;
            for (own, other) in [(i, j), (j, i)] {
                rows[own][own] += stiffness;
                rows[own][other] -= stiffness;
            }
        }
        for (end, value) in [(0, 0.0), (n - 1, pulled)] {
            rows[end] = vec![0.0; n + 1];
            (rows[end][end], rows[end][n]) = (1.0, value);
        }
        let Some(u) = solved(rows) else { return times };
        let share = |&(i, j): &(usize, usize)| {
            let stretch = (u[j] - u[i]) / (j - i) as f64;
            0.5 * (s0(place(i)) + s0(place(j))) / stretch
        };
        let all = bonds.iter().map(share).enumerate().filter(|(_, t)| *t > 0.0);
        let Some((first, t)) = all.min_by(|p, q| p.1.total_cmp(&q.1)).filter(|e| e.1 < 1e6) else {
            return times;
        };
        times.push(t);
        bonds.remove(first);
    }
}

/// The solution of a linear system by elimination; nothing where it is singular.
pub(crate) fn solved(mut rows: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let n = rows.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|p, q| rows[*p][k].abs().total_cmp(&rows[*q][k].abs()))?;
        rows.swap(k, pivot);
        if rows[k][k].abs() < 1e-9 {
            return None;
        }
        let own = rows[k].clone();
        for (number, row) in rows.iter_mut().enumerate().filter(|(number, _)| *number != k) {
            let factor = row[k] / own[k];
            assert!(number < n);
            row.iter_mut().zip(&own).for_each(|(x, y)| *x -= factor * y);
        }
    }
    Some((0..n).map(|k| rows[k][n] / rows[k][k]).collect())
}

/// A bond breaks where its stretch is that of its criterion, and everything that it held is released.
#[test]
fn a_bond_breaks_at_its_threshold() {
    let folder = chain(2, 1.01, "0.01", "control = \"event\"\n");
    folder.run(&[]).expect(0);
    let rows = Rows::of(&folder);
    let events = rows.events();
    assert_eq!(events.len(), 1);
    // 0.1 t is the change of a length of 1.
    assert!((events[0].0 - 0.1).abs() < 1e-9, "{events:?}");
    assert!((rows.last("released") / 0.5e-4 - 1.0).abs() < 1e-8);
    assert!((rows.last("prescribed") / 0.5e-4 - 1.0).abs() < 1e-8);
    assert_eq!(rows.last("total"), 0.0);
    rows.close();
}

/// A chain whose bonds have thresholds of their own snaps back, event by event.
#[test]
fn a_chain_snaps_back_where_linear_algebra_has_it() {
    let s0 = |x: f64| 0.01 * (1.0 + 0.4 * libm::sin(7.0 * x));
    let folder = chain(12, 2.01, "\"0.01*(1 + 0.4*sin(7*X))\"", "control = \"event\"\n");
    folder.run(&[]).expect(0);
    let rows = Rows::of(&folder);
    let (found, expected) = (rows.events(), expected(12, s0));
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    for ((t, _), expected) in found.iter().zip(&expected) {
        assert!((t / expected - 1.0).abs() < 1e-8, "{found:?} {expected:?}");
    }
    assert!(expected.windows(2).any(|pair| pair[1] < 0.9 * pair[0]), "{expected:?}");
    assert!(rows.last("total") < 1e-12 * rows.last("released"));
    rows.close();
}

/// All bonds of a chain break at once, and its points are held where they are; or the run ends.
#[test]
fn points_that_come_loose_are_held() {
    let folder = chain(5, 1.01, "0.01", "");
    folder.run(&[]).expect(0).says(&["came loose", "translation along x"]);
    let rows = Rows::of(&folder);
    assert_eq!(rows.last("broken_bonds"), 4.0);
    assert_eq!(rows.last("total"), 0.0);
    rows.close();
    let step = &folder.summary()["steps"][0];
    assert_eq!((number(&step["bonds_broke"]), number(&step["rounds"])), (4.0, 1.0));
}

/// With `loose = "stop"` a run ends in the last equilibrium before, with all of it written and nothing of the
/// attempt that failed.
#[test]
fn a_run_ends_where_parts_come_loose() {
    for (steps, t) in [("", "at t = 0.2"), ("control = \"event\"\n", "at t = 0.1")] {
        let folder = chain(5, 1.01, "0.01", &format!("{steps}[fracture]\nloose = \"stop\"\n"));
        let scene = fs::read_to_string(folder.scene()).unwrap();
        fs::write(folder.scene(), scene.replace("increments = 4", "increments = 10")).unwrap();
        // The events come at 0.16, but for rounding.
        let says = [t, "have come loose", "(1.5, 0.5)", "the last equilibrium is at t = 0.1"];
        folder.run(&[]).expect(3).says(&says);
        assert_eq!(folder.summary()["exit_reason"], "came_loose");
        let rows = Rows::of(&folder);
        rows.close();
        // Bonds of length 1 grow by 0.0625 t.
        assert_eq!(rows.column("t"), [0.1]);
        assert_eq!((rows.last("broken_bonds"), rows.last("released")), (0.0, 0.0));
        let expected = 4.0 * 0.5 * 0.00625 * 0.00625;
        assert!((rows.last("total") / expected - 1.0).abs() < 1e-9);
        let frames = fs::read_to_string(folder.out().join("run.pvd")).unwrap();
        assert!(frames.contains("timestep=\"0.1\""), "{frames}");
        for name in ["displacement.csv", "picture.png"] {
            assert!(folder.out().join(name).is_file(), "{name}");
        }
    }
}

/// Events come in mirror images, give the same bits for any number of threads, and close their account.
#[test]
fn a_plate_with_notches_fails_event_by_event() {
    let [one, two] = ["1", "2"].map(|threads| {
        let folder = notched(|scene| scene.replace("[steps]", "[steps]\ncontrol = \"event\""));
        folder.run(&["--threads", threads]).expect(0);
        let text = fs::read(folder.out().join("energy.csv")).unwrap();
        (folder, text)
    });
    assert_eq!(one.1, two.1);
    let rows = Rows::of(&one.0);
    rows.close();
    let events = rows.events();
    assert!(events.len() > 40, "{events:?}");
    let sizes = events.windows(2).map(|pair| pair[1].1 - pair[0].1);
    // Bonds that cross a line of symmetry at its middle have one image, others three.
    assert_eq!(sizes.collect::<BTreeSet<usize>>(), BTreeSet::from([2, 4]));
    assert!(events.windows(2).any(|pair| pair[1].0 < pair[0].0));
}

/// By loads and by events a plate gives up the same in the end but for what bonds hold beyond their
/// thresholds; one by one there are more rounds.
#[test]
fn load_steps_break_bonds_in_rounds() {
    let [all, largest] = ["all", "largest"].map(|which| {
        let folder =
            notched(|scene| scene.replace("[steps]", &format!("[steps]\nbreaking = \"{which}\"")));
        folder.run(&[]).expect(0);
        let rows = Rows::of(&folder);
        rows.close();
        let steps = folder.summary()["steps"].as_array().unwrap().clone();
        (rows, steps.iter().map(|step| number(&step["rounds"])).sum::<f64>())
    });
    assert!(all.1 < largest.1, "{} {}", all.1, largest.1);
    for (rows, _) in [&all, &largest] {
        assert!(rows.last("total") < 1e-2 * rows.last("released"));
        assert!(rows.last("relaxed") > 0.0);
    }
}

/// Bonds that broke on the way to an equilibrium that was not found come back: the first attempt at t = 0.2
/// breaks more than a hundred, two iterations are too few for what is left, and at half the step none breaks.
#[test]
fn what_breaks_in_a_failed_attempt_comes_back() {
    let folder = notched(|scene| scene.to_owned() + "[solver]\nmax_iterations = 2\n");
    folder.run(&[]).expect(3).says(&["half the increment is tried", "no equilibrium"]);
    let rows = Rows::of(&folder);
    let (t, broken) = (rows.column("t"), rows.column("broken_bonds"));
    assert!((t[1] - 0.15).abs() < 1e-12, "{t:?}");
    assert_eq!(broken[0], broken[1], "{broken:?}");
    assert!(rows.last("broken_bonds") < broken[0] + 50.0, "{broken:?}");
    rows.close();
}

/// The plate of the examples, on a lattice a fifth as fine: nothing is released but by bonds across the plane,
/// at their thresholds, and where the last ones go at once.
#[test]
fn a_double_notched_plate_releases_the_fracture_energy_of_its_crack() {
    let scene = "examples/double_notch/scene.toml";
    let coarse = ["--set", "body.spacing=0.005"];
    let folder = SceneFolder::new("");
    let out = folder.path("out");
    piola(&[&["run", scene, "--out", &out], &coarse[..]].concat()).expect(0);
    let moduli = [&["moduli", scene, "--format", "json"], &coarse[..]].concat();
    let found = piola(&moduli).expect(0).json();
    let gc = number(&found["fracture"]["planes"][0][1]);
    let (header, rows) = table(&std::path::Path::new(&out).join("energy.csv"));
    let rows = Rows { header, rows };
    rows.close();
    let ratio = rows.last("released") / (gc * 0.1);
    assert!(1.0 < ratio && ratio < 1.3, "{ratio}");
    assert!(rows.last("total") < 1e-3 * rows.last("released"));
}

/// Modified Newton goes on with its factors where a bond has broken, if they are dear: two factorisations an event in
/// place of the three of one that makes them anew behind breaks and the five of full Newton, and the same events.
#[test]
fn dear_factors_serve_behind_events() {
    let scene = "examples/double_notch/scene.toml";
    let [full, modified] = ["full", "modified"].map(|newton| {
        let folder = SceneFolder::new("");
        let (out, newton) = (folder.path("out"), format!("solver.newton={newton}"));
        let settings = ["--set", "steps.events=8", "--set", &newton];
        piola(&[&["run", scene, "--out", &out], &settings[..]].concat()).expect(0);
        let (header, rows) = table(&std::path::Path::new(&out).join("energy.csv"));
        let rows = Rows { header, rows };
        rows.close();
        let summary = json_file(&std::path::Path::new(&out).join("summary.json"));
        (rows, number(&summary["solver"]["factorizations"]))
    });
    let [t, broken] =
        ["t", "broken_bonds"].map(|name| [&full.0, &modified.0].map(|rows| rows.column(name)));
    assert_eq!(broken[0], broken[1]);
    assert!(t[0].iter().zip(&t[1]).all(|(one, other)| (one / other - 1.0).abs() < 1e-8), "{t:?}");
    println!("{} and {} factorisations", full.1, modified.1);
    assert!(full.1 > 4.0 * 8.0 && modified.1 < 2.8 * 8.0);
}

/// Families lose bonds in load steps, too.
#[test]
fn families_break_at_equilibria() {
    let states = "potential brittle\nparameter C = 1e9\nparameter s0 = 0.01\n\
                  m = integral(L^2)\ntheta = 2/m*integral(L*(l - L))\npsi(theta) = 1/2*C*theta^2\n\
                  psi(l, m) = C/m*(l - L)^2\nbreak when l/L - 1 > s0\n";
    for control in ["load", "event\"\nevents = 6 # \""] {
        let folder = SceneFolder::new(
            &NOTCHED.replace("[steps]", &format!("[steps]\ncontrol = \"{control}\"")),
        );
        folder.file("brittle.piola", states);
        folder.run(&[]).expect(0);
        let rows = Rows::of(&folder);
        rows.close();
        assert!(rows.last("released") > 0.0 && rows.events().len() > 1);
    }
}

#[test]
fn keys_of_load_steps_that_break_are_checked() {
    let of = |from: &str, to: &str, says: &[&str]| {
        assert!(NOTCHED.contains(from));
        let folder = notched(|scene| scene.replace(from, to));
        piola(&["run", &folder.scene(), "--out", &folder.path("out")]).expect(2).says(says);
    };
    let steps = |keys: &str, says: &[&str]| of("[steps]", &format!("[steps]\n{keys}"), says);
    steps("control = \"arc\"", &["unknown-choice", "\"load\" or \"event\" or \"arc-length\""]);
    steps("arcs = 7", &["conflicting-keys", "control = \"arc-length\""]);
    steps("control = \"arc-length\"\nevents = 7", &["conflicting-keys", "control = \"event\""]);
    steps("control = \"arc-length\"\nfind = \"relaxation\"", &["conflicting-keys", "Newton"]);
    steps("tie = 0.1", &["conflicting-keys", "only steps by events"]);
    steps("control = \"event\"\ntie = 1", &["out-of-range", "tie"]);
    steps("control = \"event\"\nbreaking = \"all\"", &["conflicting-keys", "breaking"]);
    steps("control = \"event\"\nfind = \"relaxation\"", &["conflicting-keys", "Newton"]);
    of("[fracture]", "[fracture]\nloose = \"keep\"", &["loose", "\"freeze\" or \"stop\""]);
    let folder = notched(|scene| scene.replace("[steps]", "[steps]\ncontrol = \"event\""));
    folder.file("brittle.piola", BRITTLE.split("break").next().unwrap());
    let run = piola(&["run", &folder.scene(), "--out", &folder.path("out")]);
    run.expect(2).says(&["conflicting-keys", "nothing breaks", "control = \"load\""]);
}

/// A chain whose bonds remember, with parameters of its own and what its end does.
fn remembering(points: usize, potential: &str, pulled: &str, steps: &str) -> SceneFolder {
    let last = points - 1;
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0], [{points}, 1]]\nspacing = 1\n[horizon]\nspacings = 1.01\nweights = \"volumes\"\n\
         [material]\npotential = \"law.piola\"\n[sets]\n\
         all = \"X > 0\"\nleft = \"X < 1\"\nright = \"X > {last}\"\n[[prescribe]]\nset = \"all\"\n\
         u = [\"free\", 0]\n[[prescribe]]\nset = \"left\"\nu = [0, \"free\"]\n[[prescribe]]\n\
         set = \"right\"\nu = [\"{pulled}\", \"free\"]\n[steps]\n{steps}"
    ));
    folder.file("law.piola", potential);
    folder
}

/// The reaction of a set along x, step by step.
fn reactions(folder: &SceneFolder) -> Vec<f64> {
    let (header, rows) = table(&folder.out().join("reactions.csv"));
    let at = header.iter().position(|name| name == "right_x").unwrap();
    rows.iter().map(|row| row[at]).collect()
}

/// Bonds in a row harden after they yield: stretched, let go and pushed they follow the closed form, with as
/// many increments as one likes, and dissipate the work on the permanent stretch.
#[test]
fn bonds_yield_in_load_steps() {
    // Elastic up to sY, then the tangent is h/(1 + h): p grows by (s - p - sY - h p)/(1 + h).
    let law = "potential hardening\nparameter sY = 0.01\nparameter h = 0.25\nstate p = 0\ns = l/L - 1\n\
               over = abs(s - p - h*p) - sY\n\
               update p = if over > 0 then p + sign(s - p - h*p)*over/(1 + h) else p\n\
               psi(l) = 1/2*L*(s - p)^2 + 1/2*h*L*p^2\n";
    let stretch = |t: f64| 0.04 * t.min(2.0 - t);
    for increments in [2, 8, 50] {
        let steps = format!("end = 2\nincrements = {increments}\n");
        let folder = remembering(4, law, "3*0.04*min(t, 2 - t)", &steps);
        folder.run(&[]).expect(0);
        let rows = Rows::of(&folder);
        rows.close();
        let mut p = 0.0;
        let (mut dissipated, mut before) = (0.0, 0.0);
        for (t, force) in rows.column("t").into_iter().zip(reactions(&folder)) {
            // Exact for any step: the way is straight.
            let s = stretch(t);
            let over = (s - p - 0.25 * p).abs() - 0.01;
            if over > 0.0 {
                let change = (s - 1.25 * p).signum() * over / 1.25;
                // The mean of the driving stretch s - p - h p at both ends, at the mean of p.
                let mean = p + 0.5 * change;
                dissipated += 3.0 * change * (0.5 * (s + before) - 1.25 * mean);
                p += change;
            }
            before = s;
            assert!((force - (s - p)).abs() < 1e-12, "{increments}: {t} {force} {}", s - p);
        }
        assert!((rows.last("dissipated") - dissipated).abs() < 1e-10 * dissipated);
        let iterations = folder.summary()["steps"].as_array().unwrap().clone();
        assert!(iterations.iter().all(|step| number(&step["iterations"]) <= 3.0));
    }
}

/// Eight bonds in a row that soften from 0.01 to 0.05, the fourth from 0.0095 on, stretched by 0.24 t; with the bytes
/// of the table of energies.
fn softened(steps: &str, threads: &str) -> (SceneFolder, Vec<u8>) {
    let law = "potential softening\nparameter s0 = 0.01\nparameter sc = 0.05\nparameter C = 1\nstate k = 0\n\
               s = l/L - 1\nupdate k = max(k, s)\n\
               D = if k <= s0 then 0 else (if k >= sc then 1 else sc*(k - s0)/(k*(sc - s0)))\n\
               psi(l) = (1 - D)*1/2*C*L*s^2\nbreak when k >= sc\n";
    let folder = remembering(9, law, "8*0.03*t", steps);
    let weak = "s0 = \"if abs(X - 4) < 0.6 then 0.0095 else 0.01\"";
    let scene = fs::read_to_string(folder.scene()).unwrap();
    let scene = scene.replace("[sets]", &format!("parameters = {{ {weak} }}\n[sets]"));
    folder.file("scene.toml", &scene);
    folder.run(&["--threads", threads]).expect(0);
    let bytes = fs::read(folder.out().join("energy.csv")).unwrap();
    (folder, bytes)
}

/// Along its way the same chain snaps back: while the weakest bond softens the others shrink, and the end with
/// them. Nothing springs anywhere, and all that the weak bond can take up is dissipated.
#[test]
fn a_chain_that_softens_is_followed_along_its_way() {
    let steps = "increments = 30\ncontrol = \"arc-length\"\n[solver]\nunstable = \"accept\"\n";
    let [(folder, one), (_, two)] = ["1", "2"].map(|threads| softened(steps, threads));
    assert_eq!(one, two);
    let rows = Rows::of(&folder);
    rows.close();
    let (weak, most) = (0.0095, 0.05);
    let (mut last, mut falls) = (0.0, 0);
    for ((t, force), lost) in
        rows.column("t").into_iter().zip(reactions(&folder)).zip(rows.column("dissipated"))
    {
        if force.abs() < 1e-12 {
            // The bond is gone, and the end anywhere beyond its last stretch.
            assert!(0.24 * t >= most);
            continue;
        }
        // The strain of the weak bond is that of the others, or so much that it carries the force.
        let strain = if lost > 0.0 { most - force * (most - weak) / weak } else { force };
        let missed = 0.24 * t - (strain + 7.0 * force);
        assert!(missed.abs() < 1e-9, "{t} {force} {missed:e}");
        falls += usize::from(t < last);
        last = t;
    }
    assert!(falls > 5, "{falls}");
    let area = 0.5 * weak * most;
    // The last step goes beyond the end of the line on which the bond softens: an error of second order.
    assert!((rows.last("dissipated") + rows.last("released") - area).abs() < 0.02 * area);
    assert!(rows.column("relaxed").iter().all(|relaxed| relaxed.abs() < 1e-9 * area));
    assert!(rows.last("total") < 1e-12 * area);
    // Cut short, it says so.
    let short = folder.run(&["--force", "--set", "steps.arcs=12"]);
    short.expect(0).says(&["12 steps along the way", "`arcs`", "to come to t = 1"]);
}

/// Of bonds in a row that soften the weakest goes alone, and the others come back to rest: too stiff to be
/// followed, so bonds take turns.
#[test]
fn the_weakest_bond_softens_alone() {
    let [(folder, one), (_, two)] =
        ["1", "2"].map(|threads| softened("increments = 30\n", threads));
    assert_eq!(one, two);
    let rows = Rows::of(&folder);
    rows.close();
    assert_eq!(rows.last("broken_bonds"), 1.0);
    assert!(rows.last("total") < 1e-12 * rows.last("dissipated"));
    assert!(reactions(&folder).last().unwrap().abs() < 1e-12);
    assert!(rows.last("relaxed") > 0.0);
    // All that the weak bond can take up, and not what another would.
    let area = 0.5 * 0.00975 * 0.05;
    assert!(rows.last("dissipated") + rows.last("released") > 0.9 * area);
}

/// t counts cycles, and life shrinks by a step's share of it: bonds break at the first step at which none is left.
#[test]
fn bonds_tire_in_load_steps() {
    let law = "potential tiring\nparameter rate = 2\nstate life = 1\ns = l/L - 1\n\
               update life = life - rate*max(0, s - 0.01)*dt\npsi(l) = 1/2*L*s^2\n\
               break when life <= 0 \"fatigue\"\n";
    // Each cycle takes 2*(0.03 - 0.01): 25 cycles are a life.
    let folder = remembering(4, law, "3*0.03*min(t, 1)", "end = 40\nincrements = 40\n");
    folder.run(&[]).expect(0).says(&["came loose"]);
    let rows = Rows::of(&folder);
    rows.close();
    assert_eq!(rows.events(), [(25.0, 3)]);
    assert_eq!(rows.last("dissipated"), 0.0);
}

/// A block is held: what its bonds add at once decays at every step, the rest stays.
#[test]
fn bonds_relax_in_load_steps() {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0, 0], [4, 4, 4]]\nspacing = 1\n[horizon]\nspacings = 1.5\n[material]\n\
         potential = \"standard_linear_solid\"\nparameters = { K = 2, K1 = 3, tau = 10 }\n[sets]\nall = \"X > 0\"\n\
         right = \"X > 2\"\n[[prescribe]]\nset = \"all\"\nu = [\"1e-3*X\", 0, 0]\n[steps]\nend = 40\nincrements = 8\n",
    );
    folder.run(&[]).expect(0);
    Rows::of(&folder).close();
    let forces = reactions(&folder);
    for (k, force) in forces.iter().enumerate() {
        let left = |k: i32| 2.0 + 3.0 * libm::pow(1.5, f64::from(-k));
        let expected = left(k as i32 + 1) / left(1) * forces[0];
        assert!((force - expected).abs() < 1e-12 * expected.abs(), "{k} {force} {expected}");
    }
    assert!(forces[0] > 0.0);
}

#[test]
fn what_load_steps_cannot_remember_is_refused() {
    let law = "potential softening\nstate k = 0\nupdate k = max(k, l/L - 1)\n\
               psi(l) = (if k > 0.1 then 0 else 1/2)*L*(l/L - 1)^2\nbreak when k > 0.2\n";
    let refused = |steps: &str, more: &[&str], says: &[&str]| {
        let folder = remembering(3, law, "0.02*t", steps);
        let run = ["run", &folder.scene(), "--out", &folder.path("out")];
        piola(&[&run[..], more].concat()).expect(2).says(says);
    };
    refused("control = \"event\"\n", &[], &["conflicting-keys", "remember", "control = \"load\""]);
    refused("", &["--set", "solver.derivatives=\"hyperdual\""], &["symbolic derivatives"]);
    let tiring = "potential tiring\nstate life = 1\nupdate life = life - max(0, l/L - 1)*dt\n\
                  psi(l) = 1/2*L*(l/L - 1)^2\nbreak when life <= 0\n";
    let folder = remembering(3, tiring, "0.02*t", "control = \"arc-length\"\n");
    let run = piola(&["run", &folder.scene(), "--out", &folder.path("out")]);
    run.expect(2).says(&["conflicting-keys", "remembers the time that passes"]);
    folder.file("law.piola", "potential warm\nparameter c = 1\npsi(l) = 1/2*c*L*(l/L - 1)^2\n");
    let set = ["--set", "material.parameters.c=\"1 + t\""];
    let run = piola(&[&["run", &folder.scene(), "--out", &folder.path("out")], &set[..]].concat());
    run.expect(2).says(&["conflicting-keys", "parameters that vary with t"]);
}
