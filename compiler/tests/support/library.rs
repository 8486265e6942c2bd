//! Every potential of the library, in every dimension, for many parameter values.

use std::path::Path;

use piola_compiler::{Model, Setting, Values, check};
use piola_grammar::parse;

/// A potential with values.
pub(crate) struct Case {
    /// Which, for messages.
    pub(crate) name: String,
    /// What was checked.
    pub(crate) model: Model,
    /// For what it is compiled.
    pub(crate) values: Values,
}

/// The files of `potentials/`: name and text.
pub(crate) fn files() -> Vec<(String, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../potentials");
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "piola") {
            let name = path.file_stem().unwrap().to_str().unwrap().to_string();
            files.push((name, std::fs::read_to_string(&path).unwrap()));
        }
    }
    files.sort();
    assert!(files.len() >= 5, "{} potentials", files.len());
    files
}

/// Values to try for a parameter, and the value it has otherwise.
fn tried(potential: &str, parameter: &str) -> (Vec<f64>, f64) {
    match (potential, parameter) {
        ("firooz2023", "n") => (
            vec![-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.7, 3.0, 4.0, 7.5, 10.0, 16.5, 30.0],
            1.0,
        ),
        (_, "C1") => (vec![2e-3, 1.0], 1.5),
        (_, "C2" | "C3") => (vec![0.0, 1e6], 40.0),
        (_, "K") => (vec![1.0, 1e9], 2.5e10),
        // Below what the fracture energy lets bonds take at once.
        (_, "s0") => (vec![1e-5, 3e-5], 2e-5),
        (_, "k") => (vec![0.0, 3e-5], 0.0),
        // Another permanent stretch is another rest, where the energy as written loses digits.
        (_, "p") if ["micro_plastic", "standard_linear_solid"].contains(&potential) => {
            (vec![0.0], 0.0)
        }
        _ => (vec![0.3, 3.0], 1.0),
    }
}

/// All cases: each parameter takes each of its values while the others keep theirs.
pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, text) in files() {
        let model = check(&parse(&text).unwrap()).unwrap_or_else(|e| panic!("{name}: {e:#?}"));
        // Energies of F and of gathered values are verified in other ways.
        if model.measures().is_empty() {
            continue;
        }
        let names: Vec<String> = model.parameters().iter().map(|p| p.name.clone()).collect();
        for dimension in model.dimensions().collect::<Vec<_>>() {
            for varied in &names {
                for value in tried(&name, varied).0 {
                    let of = |p: &String| if p == varied { value } else { tried(&name, p).1 };
                    let settings: Vec<_> =
                        names.iter().map(|p| (p.clone(), Setting::Number(of(p)))).collect();
                    // Conditions rule some of the values out.
                    let Ok(values) = model.values(dimension, &settings, Some(0.015)) else {
                        continue;
                    };
                    // With a typical direction of bonds: `directions` tries many.
                    let values = values.without_fields();
                    let name = format!("{name} in {dimension}D, {varied} = {value}");
                    cases.push(Case { name, model: model.clone(), values });
                }
            }
        }
    }
    cases
}
