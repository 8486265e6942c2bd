//! Tips of cracks: `[[track]]` and `fracture.csv`, against damage in frames and other tables; what frames show of
//! areas, volumes and states; bonds at their threshold but for rounding.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::fracture::{BRITTLE, TORN};
use crate::support::frames::{VtuFile, read_pvd, read_vtu};
use crate::support::{SceneFolder, number, piola, table};

/// Columns of a table by their names.
fn columns(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let (header, rows) = table(path);
    let column = |k: usize| rows.iter().map(|row| row[k]).collect();
    header.iter().cloned().zip((0..header.len()).map(column)).collect()
}

/// The frames of a run with their times.
fn frames(out: &Path) -> Vec<(f64, VtuFile)> {
    let list = read_pvd(&fs::read_to_string(out.join("run.pvd")).unwrap()).unwrap();
    list.iter().map(|(t, name)| (*t, read_vtu(&out.join(name)).unwrap())).collect()
}

fn torn(change: impl Fn(&str) -> String) -> SceneFolder {
    let folder = SceneFolder::new(&change(TORN));
    folder.file("brittle.piola", BRITTLE);
    folder
}

/// The farthest damaged point of the plate of `TORN` that hangs together with those that were damaged at the
/// start, from cell to cell, corners included; of points whose column and row are `in_set`.
fn tip(start: &[f64], now: &[f64], in_set: impl Fn(usize, usize) -> bool, sign: f64) -> f64 {
    let (nx, ny, h) = (20, 12, 0.05);
    let is_damaged =
        |damage: &[f64], x: usize, y: usize| damage[x * ny + y] >= 0.35 && in_set(x, y);
    let cells = || (0..nx).flat_map(|x| (0..ny).map(move |y| (x, y)));
    let mut reached: Vec<(usize, usize)> =
        cells().filter(|(x, y)| is_damaged(start, *x, *y)).collect();
    let mut next = 0;
    while next < reached.len() {
        let (x, y) = reached[next];
        for (p, q) in cells().filter(|(p, q)| p.abs_diff(x) <= 1 && q.abs_diff(y) <= 1) {
            if is_damaged(now, p, q) && !reached.contains(&(p, q)) {
                reached.push((p, q));
            }
        }
        next += 1;
    }
    let places = reached.iter().map(|(x, _)| sign * h * (*x as f64 + 0.5));
    sign * places.fold(f64::NEG_INFINITY, f64::max)
}

/// A plate whose crack is followed to the right, in its upper half alone, and from the right.
#[test]
fn tips_are_where_damage_that_hangs_together_ends() {
    let more = "[[track]]\nname = \"top\"\naxis = \"X\"\nset = \"above\"\n[[track]]\nname = \"back\"\n\
                axis = \"-X\"\nthickness = 0.5\n[[prescribe]]\nset = \"low\"";
    let folder = torn(|scene| {
        let scene = scene.replacen("[[prescribe]]\nset = \"low\"", more, 1);
        let scene = scene.replace("frames = 4", "frames = 40").replace("rows = 40", "rows = 800");
        scene.replace("[sets]", "[sets]\nabove = \"Y > 0.3\"")
    });
    let ran = folder.run(&[]).expect(0);
    assert!(!ran.stderr.contains("on-threshold"), "{}", ran.stderr);
    let out = folder.out();
    let (broke, motion) = (columns(&out.join("fracture.csv")), columns(&out.join("motion.csv")));
    for same in ["t", "broken_bonds", "released"] {
        assert_eq!(broke[same], motion[same], "{same}");
    }
    assert!(!broke.contains_key("new_areas"));
    let new = &broke["new_bonds"];
    for k in 1..new.len() {
        assert_eq!(new[k], broke["broken_bonds"][k] - broke["broken_bonds"][k - 1]);
    }
    assert_eq!(new[0], 0.0, "what the crack has cut is not new");
    // Where the tip is: from the damage of frames.
    let frames = frames(&out);
    let damage = |k: usize| &frames[k].1.array("damage").unwrap().values;
    let mut ways = 0;
    for (k, (t, _)) in frames.iter().enumerate() {
        let row = broke["t"].iter().position(|own| own == t).unwrap();
        let found = |name: &str| broke[name][row];
        let anywhere = tip(damage(0), damage(k), |_, _| true, 1.0);
        assert!((found("tip_tip") - anywhere).abs() < 1e-12, "{t}: {}", found("tip_tip"));
        let above = tip(damage(0), damage(k), |_, y| y >= 6, 1.0);
        assert!((found("top_tip") - above).abs() < 1e-12, "{t}");
        let back = tip(damage(0), damage(k), |_, _| true, -1.0);
        assert!((found("back_tip") - back).abs() < 1e-12, "{t}");
        ways += usize::from(found("tip_tip") > broke["tip_tip"][0]);
    }
    assert!(ways > 5, "the crack runs: {ways}");
    assert!(broke["back_tip"].iter().all(|x| *x == 0.025), "behind it there is nothing to run to");
    assert!(broke["back_speed"].iter().all(|x| *x == 0.0));
    // Speeds over the last horizon, and what was released by it.
    let (x, t, released) = (&broke["tip_tip"], &broke["t"], &broke["released"]);
    let mut n_speeds = 0;
    for row in 0..x.len() {
        let came = |place: f64| match place == x[0] {
            true => x.iter().rposition(|own| *own == place).unwrap(),
            false => x.iter().position(|own| *own == place).unwrap(),
        };
        let then = (0..row).rev().find(|k| x[row] - x[*k] >= 3.015 * 0.05 * (1.0 - 1e-5));
        let window = then.map(|k| [came(x[k]), came(x[row])]);
        let speed = |[then, now]: [usize; 2]| match t[row] - t[now] > t[now] - t[then] {
            true => 0.0,
            false => (x[now] - x[then]) / (t[now] - t[then]),
        };
        let expected = window.map_or(0.0, speed);
        let speed = broke["tip_speed"][row];
        assert!((speed - expected).abs() <= 1e-12 * expected, "{row}: {speed} {expected}");
        let gained =
            |[then, now]: [usize; 2]| (released[now] - released[then]) / (x[now] - x[then]);
        let gained = window.map_or(f64::NAN, gained);
        let found = broke["tip_released_per_area"][row];
        assert!(gained.is_nan() && found.is_nan() || (found - gained).abs() <= 1e-12 * gained);
        n_speeds += usize::from(expected > 0.0);
    }
    assert!(n_speeds > 10);
    // The speed of Rayleigh waves, of a plate whose E and nu `piola moduli` knows.
    let moduli = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
    let voigt = |r: usize, c: usize| number(&moduli["voigt"][r][c]);
    // As if isotropic: a plane with c11 and c66 has this Poisson's ratio in plane strain.
    let (c11, c66) = (voigt(0, 0), voigt(2, 2));
    let nu = (c11 - 2.0 * c66) / (2.0 * (c11 - c66));
    let rayleigh = (c66 / 1000.0).sqrt() * (0.862 + 1.14 * nu) / (1.0 + nu);
    for (speed, share) in broke["tip_speed"].iter().zip(&broke["tip_speed_over_c_R"]) {
        assert!((speed / rayleigh - share).abs() <= 0.02 * share, "{speed} {share} {rayleigh}");
    }
}

#[test]
fn wrong_tracks_are_refused_with_their_place() {
    for (from, to, says) in [
        ("axis = \"X\"", "axis = \"Z\"", "no Z in two dimensions"),
        ("axis = \"X\"", "axis = \"x\"", "\"X\""),
        ("axis = \"X\"", "", "has no `axis`"),
        ("axis = \"X\"", "axis = \"X\"\nthreshold = 1.5", "less than 1"),
        ("axis = \"X\"", "axis = \"X\"\nset = \"hi\"", "there is no set `hi`"),
        ("axis = \"X\"", "axis = \"X\"\nthickness = 0", "greater than 0"),
        ("axis = \"X\"", "axis = \"X\"\n[[track]]\nname = \"tip\"\naxis = \"Y\"", "two tracks"),
        ("name = \"tip\"", "name = \"a b\"", "a track cannot be called"),
    ] {
        assert!(TORN.contains(from));
        torn(|scene| scene.replacen(from, to, 1)).run(&[]).expect(2).says(&[says]);
    }
    let whole = BRITTLE.split("break").next().unwrap();
    let folder =
        torn(|scene| scene.replace("[[crack]]\nsegment = [[-0.1, 0.3], [0.4, 0.3]]\n", ""));
    folder.file("brittle.piola", whole);
    piola(&["check", &folder.scene()]).expect(0).says(&["idle-entry", "nothing to follow"]);
}

/// Load steps have the table, too, without speeds: a strip between two rows of points is torn.
#[test]
fn load_steps_tell_what_broke_and_where_the_tip_is() {
    let folder = torn(|scene| {
        let (before, _) = scene.split_once("[motion]").unwrap();
        let pulled = before.replace("v = [0, -0.5]", "u = [0, \"-0.008*t\"]");
        let pulled = pulled.replace("v = [0, 0.5]", "u = [0, \"0.008*t\"]");
        pulled + "[steps]\ncontrol = \"event\"\ntie = 1e-6\n[output]\nframes = 1\n"
    });
    folder.run(&[]).expect(0);
    let out = folder.out();
    let (broke, energy) = (columns(&out.join("fracture.csv")), columns(&out.join("energy.csv")));
    for same in ["t", "broken_bonds", "released"] {
        assert_eq!(broke[same], energy[same], "{same}");
    }
    assert!(!broke.keys().any(|name| name.contains("speed")));
    let (new, all) = (&broke["new_bonds"], &broke["broken_bonds"]);
    assert_eq!(new.iter().sum::<f64>(), all.last().unwrap() - all[0] + new[0]);
    let tips = &broke["tip_tip"];
    assert!(tips.windows(2).all(|pair| pair[1] >= pair[0]) && tips.last().unwrap() > &0.9);
    // Columns of bonds break at their thresholds: what that takes on an area is the fracture energy of the
    // lattice, but for what breaks beside the plane.
    let moduli = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
    let gc = number(&moduli["fracture"]["planes"][0][1]);
    let half = tips.iter().position(|x| *x > 0.7).unwrap();
    let found = broke["tip_released_per_area"][half];
    assert!((found / gc - 1.0).abs() < 0.15, "{found} {gc}");
}

/// The mean of what bonds begin to remember, and `damage_a` beside `damage`.
#[test]
fn frames_show_states_and_damage_of_areas() {
    let soft = "potential soft\nparameter s0 = 0.01\nstate k = 0\nupdate k = max(k, l/L - 1)\n\
                psi(l) = 1/2*1e13*L*(l/L - 1)^2/(1 + k)\npsi(a) = 1e14*A*(a/A - 1)^2\n\
                break when l/L - 1 > s0\nbreak when a/A - 1 > 0.015\n";
    let folder = torn(|scene| {
        let scene =
            scene.replace("density = 1000", "density = 1000\nparameters = { k = \"0.001*X\" }");
        let scene = scene.replace(
            "colour = \"damage\"",
            "colour = \"state k\"\nfields = [\"states\", \"damage_a\", \"damage_v\"]",
        );
        scene.replace("end = 0.02", "end = 0.008")
    });
    folder.file("brittle.piola", soft);
    folder.run(&[]).expect(0);
    let frames = frames(&folder.out());
    let of = |k: usize, name: &str| frames[k].1.array(name).unwrap().values.clone();
    let last = frames.len() - 1;
    // Inside, and away from the slit, neighbours lie evenly about a point.
    for (point, k) in of(0, "state k").iter().enumerate() {
        let (x, y) = (point / 12, point % 12);
        if (4..16).contains(&x) && y == 3 && x > 11 {
            assert!((k - 0.001 * 0.05 * (x as f64 + 0.5)).abs() < 1e-15, "{x} {k}");
        }
    }
    let (first, end) = (of(0, "state k"), of(last, "state k"));
    assert!(first.iter().zip(&end).all(|(before, now)| now.is_nan() || now >= before));
    assert!(end.iter().any(|k| *k > 0.002));
    let (bonds, areas) = (of(0, "damage"), of(0, "damage_a"));
    // A triangle has three edges, so that more of them are gone than of bonds.
    for (bonds, areas) in bonds.iter().zip(&areas) {
        assert!((*bonds == 0.0 || areas > bonds) && (0.0..=1.0).contains(areas), "{bonds} {areas}");
    }
    assert!(areas.contains(&0.0) && areas.iter().any(|d| *d > 0.5));
    assert!(of(last, "damage_a").iter().zip(&areas).any(|(now, before)| now > before));
    assert!(of(last, "damage_v").iter().all(|d| *d == 0.0), "there are no tetrahedra in the plane");
    let picture = fs::read_to_string(folder.out().join("picture.svg")).unwrap();
    assert!(picture.contains("state k"));
    for (colour, says) in [("state q", "colour = \"state k\""), ("states", "unknown-choice")] {
        let changed = fs::read_to_string(folder.scene()).unwrap();
        let changed = changed.replace("colour = \"state k\"", &format!("colour = \"{colour}\""));
        let other = SceneFolder::new(&changed);
        other.file("brittle.piola", soft);
        other.run(&[]).expect(2).says(&[says]);
    }
}

/// All bonds along X are at exactly their threshold: the run says so once, with how many they are and where.
/// Coordinates are exact, so which of them break is the same in the mirror, to the bit.
#[test]
fn a_class_of_bonds_at_its_threshold_is_told() {
    for compare in [">", ">="] {
        let text = "[body]\nbox = [[-0.5, -0.25], [0.5, 0.25]]\nspacing = 0.0625\n[horizon]\nspacings = 3.015\n\
                    [material]\npotential = \"brittle.piola\"\ndensity = 1000\n[sets]\nall = \"X > -1\"\n\
                    [[initial]]\nset = \"all\"\nu = [\"0.01*X\", 0]\n[motion]\nend = 1e-4\n[output]\nframes = 1\n\
                    rows = 2\n";
        let folder = SceneFolder::new(text);
        folder.file("brittle.piola", BRITTLE.replace("> s0", &format!("{compare} s0")));
        let ran = folder.run(&[]).expect(0);
        // Of one, two and three spacings in each of the eight rows.
        let told = "336 bonds are at their threshold but for rounding";
        ran.says(&["on-threshold", told, "at t = 0e0 s"]);
        let warnings = folder.summary()["warnings"].as_array().unwrap().clone();
        let n_told = warnings.iter().filter(|one| one.as_str().unwrap().contains("on-threshold"));
        assert_eq!(n_told.count(), 1);
        // Behind the start forces, which are not rounded alike, move what is still at its threshold.
        let (_, frame) = &frames(&folder.out())[0];
        let damage = &frame.array("damage").unwrap().values;
        assert!(damage.iter().any(|d| *d > 0.0) || compare == ">");
        for (x, y) in (0..16).flat_map(|x| (0..8).map(move |y| (x, y))) {
            let at = |x: usize, y: usize| damage[x * 8 + y].to_bits();
            assert_eq!(at(x, y), at(15 - x, y));
            assert_eq!(at(x, y), at(x, 7 - y));
        }
        // A millionth of the threshold away from it nothing is left to rounding.
        let away = SceneFolder::new(&text.replace("0.01*X", "0.01000001*X"));
        away.file("brittle.piola", BRITTLE.replace("> s0", &format!("{compare} s0")));
        let ran = away.run(&[]).expect(0);
        assert!(!ran.stderr.contains("on-threshold"), "{}", ran.stderr);
    }
}
