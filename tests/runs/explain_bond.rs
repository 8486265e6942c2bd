//! `piola explain-bond`: the history of a bond against the tables of the same run.

use serde_json::Value;

use crate::fracture::{BRITTLE, TORN};
use crate::support::{Outcome, SceneFolder, number, numbers, piola, table};

fn torn(change: impl Fn(&str) -> String) -> SceneFolder {
    let folder = SceneFolder::new(&change(TORN));
    folder.file("brittle.piola", BRITTLE);
    folder
}

fn explain(folder: &SceneFolder, [p, q]: [&str; 2], more: &[&str]) -> Outcome {
    let scene = folder.scene();
    piola(&[&["explain-bond", &scene, "--at", p, q], more].concat())
}

fn history(folder: &SceneFolder, ends: [&str; 2]) -> Value {
    explain(folder, ends, &["--format", "json"]).expect(0).json()
}

/// A bond across the path of a crack: its rows are those of the run, and it breaks when the run says that bonds
/// break, by its one condition.
#[test]
fn a_bond_in_the_way_of_a_crack_breaks() {
    let folder =
        torn(|scene| scene.replace("spacings = 3.015", "spacings = 3.015\nweights = \"volumes\""));
    let ends = ["0.425,0.275", "0.425,0.325"];
    let found = history(&folder, ends);
    folder.run(&[]).expect(0);
    let (header, rows) = table(&folder.out().join("motion.csv"));
    let column = |name: &str| header.iter().position(|x| x == name).unwrap();
    let own = found["rows"].as_array().unwrap();
    let times: Vec<f64> = own.iter().map(|row| number(&row["t"])).collect();
    assert_eq!(times, rows.iter().map(|row| row[column("t")]).collect::<Vec<f64>>());
    // The point of the lattice, last axis fastest.
    assert_eq!(number(&found["points"][0]["number"]), 8.0 * 12.0 + 5.0);
    assert_eq!(found["conditions"][0]["text"], "l/L - 1 > s0");
    assert_eq!(found["conditions"][0]["reason"], "critical stretch");
    for row in own {
        let [length, stretch] = ["length", "stretch"].map(|key| number(&row[key]));
        assert!((length / 0.05 - 1.0 - stretch).abs() < 1e-14);
        assert!((numbers(&row["margins"])[0] - (stretch - 0.01)).abs() < 1e-16);
        // Its weight is the product of the areas of its points.
        let weight = 0.0025 * 0.0025;
        let energy = 0.5 * 1e13 * 0.05 * stretch * stretch * weight;
        let is_broken = row["broken"].as_bool().unwrap();
        let expected = if is_broken { 0.0 } else { energy };
        assert!((number(&row["energy"]) - expected).abs() <= 1e-12 * energy, "{row}");
    }
    let broke = &found["broke"];
    let at = number(&broke["t"]);
    assert!(numbers(&broke["conditions"]) == [0.0] && number(&broke["row"]["margins"][0]) > 0.0);
    assert_eq!(found["largest"]["t"], broke["t"]);
    let first = own.iter().position(|row| row["broken"] == true).unwrap();
    assert!(times[first - 1] < at && at <= times[first], "{at} {times:?}");
    // In between more bonds are broken than before.
    let broken = |row: usize| rows[row][column("broken_bonds")];
    assert!(broken(first) > broken(first - 1));
    let text = explain(&folder, ends, &[]).expect(0).stdout;
    for part in
        ["point 101 at (0.425, 0.275)", "It broke at t = ", "by `l/L - 1 > s0` (critical stretch)"]
    {
        assert!(text.contains(part), "{text}");
    }
    // By their numbers it is the same, in any order.
    let other = history(&folder, ["102", "101"]);
    assert_eq!(other["broke"]["t"], broke["t"]);
}

/// A bond that stays: how far it came, and the largest margin is that of all steps, not of rows alone.
#[test]
fn a_bond_that_stays_tells_how_far_it_came() {
    let of = |rows: &str| {
        let folder =
            torn(|scene| scene.replace("rows = 40", rows).replace("end = 0.02", "end = 0.004"));
        history(&folder, ["0.825,0.275", "0.825,0.325"])
    };
    let (few, many) = (of("rows = 4"), of("rows = 400"));
    assert!(few["broke"].is_null());
    assert_eq!(few["largest"], many["largest"]);
    let largest = &few["largest"];
    let margin = number(&largest["margin"]);
    assert!(margin < 0.0 && number(&largest["at_rest"]) == -0.01);
    assert!((number(&largest["share"]) - (1.0 + margin / 0.01)).abs() < 1e-12);
    let in_rows = many["rows"].as_array().unwrap().iter().map(|row| number(&row["margins"][0]));
    assert!(in_rows.fold(f64::NEG_INFINITY, f64::max) <= margin);
    let verdict = few["verdict"].as_str().unwrap();
    assert!(verdict.contains("It did not break.") && verdict.contains("of the way"), "{verdict}");
    let folder = torn(|scene| scene.replace("end = 0.02", "end = 0.001"));
    let held = explain(&folder, ["0.5,0.025", "0.5,0.075"], &[]).expect(0).stdout;
    assert!(held.contains("of the set `low`, which is unbreakable"), "{held}");
}

#[test]
fn what_is_no_bond_is_refused() {
    let folder = torn(str::to_owned);
    for (ends, says) in [
        (["0.425,0.275", "0.825,0.275"], "have no bond: they are 4e-1 m apart, and the horizon is"),
        (["0.425,0.275", "7,7"], "there is no point at (7, 7): the nearest is point 239 at"),
        (["0.425,0.275", "240"], "there is no point 240: the 240 points are counted from 0"),
        (["0.425,0.275", "0.43,0.28"], "both ends are point 101"),
        (["0.425,0.275", "0.4,0.3,0.2"], "3 coordinates"),
        (["0.225,0.275", "0.225,0.325"], "a [[crack]] cuts the bond"),
        (["0.425,0.275", "here"], "a point is its number"),
    ] {
        explain(&folder, ends, &[]).expect(2).says(&[says]);
    }
    let slit = torn(|scene| scene.replace("segment", "damaged = false\nsegment"));
    explain(&slit, ["0.225,0.275", "0.225,0.325"], &[]).expect(2).says(&["has never been there"]);
    let elastic =
        torn(|scene| scene.replace("[[crack]]\nsegment = [[-0.1, 0.3], [0.4, 0.3]]\n", ""));
    elastic.file("brittle.piola", BRITTLE.split("break").next().unwrap());
    explain(&elastic, ["101", "102"], &[]).expect(2).says(&["no bond of this scene can break"]);
}

/// Load steps: at an event the bond that breaks is at its threshold.
#[test]
fn load_steps_tell_the_same() {
    let steps = |control: &str| {
        torn(|scene| {
            let (before, _) = scene.split_once("[motion]").unwrap();
            let pulled = before.replace("v = [0, -0.5]", "u = [0, \"-0.008*t\"]");
            let pulled = pulled.replace("v = [0, 0.5]", "u = [0, \"0.008*t\"]");
            format!("{pulled}[steps]\nincrements = 8\ncontrol = \"{control}\"\n")
        })
    };
    let ends = ["0.425,0.275", "0.425,0.325"];
    let by_load = history(&steps("load"), ends);
    let by_event = history(&steps("event"), ends);
    let margin = |found: &Value| number(&found["broke"]["row"]["margins"][0]);
    assert!(margin(&by_load) > 0.0 && margin(&by_event).abs() <= 2e-9 * 0.01);
    let first = |found: &Value| {
        let rows = found["rows"].as_array().unwrap();
        number(&rows.iter().find(|row| row["broken"] == true).unwrap()["t"])
    };
    assert_eq!(first(&by_load), number(&by_load["broke"]["t"]));
    assert!(first(&by_event) <= first(&by_load), "found at the load, not behind it");
}

/// A bond of two materials breaks by the conditions of either; states stand beside them.
#[test]
fn materials_and_states_have_their_names() {
    let folder = torn(|scene| {
        let two = "[[material]]\nname = \"soft\"\npotential = \"soft.piola\"\ndensity = 1000\nset = \"right\"\n\
                   [[material]]\nname = \"hard\"\npotential = \"brittle.piola\"\ndensity = 1000\n";
        let scene =
            scene.replace("[material]\npotential = \"brittle.piola\"\ndensity = 1000\n", two);
        let scene = scene.replace("[sets]", "[sets]\nright = \"X > 0.5\"");
        scene.replace("end = 0.02", "end = 0.004")
    });
    let soft = "potential soft\nparameter s1 = 0.02\nstate k = 0\nupdate k = max(k, l/L - 1)\n\
                psi(l) = 1e13*L*(l/L - 1)^2/(1 + k)\nbreak when k >= s1 \"softened\"\n";
    folder.file("soft.piola", soft);
    let across = history(&folder, ["0.475,0.425", "0.525,0.425"]);
    let of: Vec<&str> = across["conditions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["of"].as_str().unwrap())
        .collect();
    assert_eq!(of, ["soft", "hard"]);
    assert_eq!(across["states"][0], "k");
    for pair in across["rows"].as_array().unwrap().windows(2) {
        let [before, now] = [0, 1].map(|k| number(&pair[k]["states"][0]));
        assert!(now >= before && now >= number(&pair[1]["stretch"]) - 1e-15);
    }
    let text = explain(&folder, ["0.475,0.425", "0.525,0.425"], &[]).expect(0).stdout;
    assert!(
        text.contains("its points are of hard and soft; it takes the conditions of soft and hard"),
        "{text}"
    );
    let inside = explain(&folder, ["0.425,0.425", "0.475,0.425"], &[]).expect(0).stdout;
    assert!(inside.contains("its points are of hard; it takes the conditions of hard"), "{inside}");
}
