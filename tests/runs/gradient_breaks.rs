//! Bodies that break by deformation gradients, through the program: motions, events, histories of bonds, and what
//! is refused.

use crate::support::{SceneFolder, number, numbers, piola, repository, table};

/// The plate of an example on a lattice half as fine, with keys of `[correspondence]`, and what drives it.
fn plate(keys: &str, driven: &str) -> SceneFolder {
    let folder = repository("examples/gradients_that_fail");
    let scene = std::fs::read_to_string(folder.join("scene.toml")).unwrap();
    let start = scene.find("[[load]]").unwrap();
    let mut scene = scene[..start].to_owned() + driven;
    for (from, to) in [
        ("spacing = 1e-3", "spacing = 2e-3"),
        ("Y < 1e-3", "Y < 2e-3"),
        ("Y > 0.039", "Y > 0.038"),
        ("influence = \"constant\"", keys),
    ] {
        assert!(scene.contains(from), "{from}");
        scene = scene.replace(from, to);
    }
    let made = SceneFolder::new(&scene);
    made.file("law.piola", std::fs::read_to_string(folder.join("law.piola")).unwrap());
    made
}

const PULLED: &str = "[[load]]\nset = \"lower\"\ndensity = [0, -1e9]\n[[load]]\nset = \"upper\"\n\
                      density = [0, 1e9]\n[motion]\nend = \"30 us\"\n[output]\nframes = 1\nrows = 60\n";

/// The plate comes apart wherever its energy is, and the account closes.
#[test]
fn plates_tear_by_their_gradients() {
    for discretisation in ["bond-quadrature", "stabilised"] {
        let keys = format!("discretisation = \"{discretisation}\"\ninfluence = \"constant\"");
        let folder = plate(&keys, PULLED);
        folder.run(&[]).expect(0);
        let (header, rows) = table(&folder.out().join("motion.csv"));
        let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
        let (first, last) = (&rows[0], rows.last().unwrap());
        let broken = |row: &[f64]| row[column("broken_bonds")];
        assert!(broken(last) > broken(first) + 150.0, "{discretisation}: {}", broken(last));
        let largest = rows.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        for row in &rows {
            assert!(row[column("rounding")].abs() <= 1e-12 * largest, "{discretisation}");
        }
    }
}

/// Slowly, event by event: at each the margin that decides is 0.
#[test]
fn events_are_found_where_margins_of_gradients_vanish() {
    let steps = "[[prescribe]]\nset = \"lower\"\nu = [0, 0]\n[[prescribe]]\nset = \"upper\"\n\
                 u = [0, \"2e-5*t\"]\n[steps]\ncontrol = \"event\"\nincrements = 1\nevents = 6\n";
    let folder = plate("influence = \"constant\"", steps);
    folder.run(&[]).expect(0);
    let (header, rows) = table(&folder.out().join("energy.csv"));
    let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
    let broken: Vec<f64> = rows.iter().map(|row| row[column("broken_bonds")]).collect();
    assert!(broken.windows(2).filter(|pair| pair[1] > pair[0]).count() >= 5, "{broken:?}");
    let of = |row: &[f64], name: &str| row[column(name)];
    for row in &rows {
        let found = of(row, "total") + of(row, "released") + of(row, "relaxed")
            - of(row, "external")
            - of(row, "prescribed")
            - of(row, "quadrature");
        assert!(found.abs() <= 1e-10 * of(row, "prescribed").max(1e-3), "{found:e}");
    }
}

/// A bond is told of the gradients that judge it: its own, or those of its two ends.
#[test]
fn a_bond_is_told_of_the_gradients_that_judge_it() {
    for (discretisation, n) in [("bond-quadrature", 1), ("nodal", 2)] {
        let keys = format!("discretisation = \"{discretisation}\"\ninfluence = \"constant\"");
        let folder = plate(&keys, &PULLED.replace("30 us", "20 us"));
        let scene = folder.scene();
        let at = ["--at", "0.051,0.019", "0.051,0.021", "--format", "json"];
        let found = piola(&[&["explain-bond", &scene], &at[..]].concat()).expect(0).json();
        let conditions = found["conditions"].as_array().unwrap();
        assert_eq!(conditions.len(), n);
        let text = conditions[0]["text"].as_str().unwrap();
        assert!(text.starts_with("w > w0 and J > 1"), "{text}");
        assert_eq!(text.contains("0.051"), n == 2, "{text}");
        assert_eq!(conditions[0]["reason"], "critical energy density");
        let margins = numbers(&found["rows"][0]["margins"]);
        assert!(margins.iter().all(|margin| *margin == -600.0), "{margins:?}");
        let broke = &found["broke"];
        let k = numbers(&broke["conditions"])[0] as usize;
        assert!(numbers(&broke["row"]["margins"])[k] > 0.0);
        assert!(number(&broke["t"]) > 0.0);
    }
}

#[test]
fn sheets_do_not_break_by_gradients() {
    let folder = plate("plane = \"stress\"", PULLED);
    let scene = folder.scene();
    piola(&["check", &scene]).expect(1).says(&["plane stress", "plane = \"strain\""]);
}
