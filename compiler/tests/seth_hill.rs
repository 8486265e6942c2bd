//! Extreme E1: the Seth-Hill family keeps its digits from strains of 1e-15 to stretches of 1e8, for
//! every exponent: at most `(16 + 2 abs(n)) u` in psi, psi' and psi''.

use piola_compiler::audit::{Settings, audit};
use piola_compiler::{Form, Measure, Model, Setting, check_text};

/// The exponents of the extreme.
const EXPONENTS: [f64; 17] = [
    -2.0,
    -1.0,
    -0.5,
    0.0,
    1e-12,
    1e-8,
    1e-3,
    0.5,
    1.0,
    2.0,
    4.0,
    10.0,
    30.0,
    100.0,
    1.0 / 3.0,
    1e-300,
    -10.0,
];

fn seth_hill() -> Model {
    let text = std::fs::read_to_string(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../potentials/firooz2023.piola"
    ));
    check_text(&text.unwrap()).unwrap().1
}

/// Largest errors of psi, psi', psi'' over all regimes, in u.
fn worst(model: &Model, n: f64, form: Form, bar: f64, print: bool) -> [f64; 3] {
    let set = |name: &str, value| (name.to_string(), Setting::Number(value));
    let settings = [set("C1", 1.7), set("C2", 0.0), set("C3", 0.0), set("n", n)];
    let values = model.values(3, &settings, None).unwrap();
    let (audits, _) = audit(model, &values, &Settings { form, points: 8, bar }).unwrap();
    let length = audits.iter().find(|audit| audit.measure == Measure::Length).unwrap();
    if print {
        for regime in &length.regimes {
            if regime.worst.iter().any(|e| *e > bar) {
                println!("n = {n}: {}: {:.0?} at {:?}", regime.name, regime.worst, regime.at);
            }
        }
    }
    length.worst()
}

#[test]
fn e01_seth_hill_keeps_its_digits() {
    let model = seth_hill();
    let mut missed = Vec::new();
    for n in EXPONENTS {
        let bar = 16.0 + 2.0 * n.abs();
        let found = worst(&model, n, Form::Accurate, bar, true);
        println!(
            "n = {n:e}: psi {:.1} psi' {:.1} psi'' {:.1} u, bar {bar}",
            found[0], found[1], found[2]
        );
        if found.iter().any(|error| *error > bar) {
            missed.push(n);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}
