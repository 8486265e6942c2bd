//! What accuracy costs: kernels of the Seth-Hill bond in the accurate form against the textbook form.
//!
//! `cargo bench -p piola-compiler --bench forms` prints a table. Both forms run in turn in one process, so
//! that the ratio holds on a busy machine too; the fastest and the median of the runs are shown.

use std::hint::black_box;
use std::time::Instant;

use piola_compiler::{
    Batch, Derivatives, Form, Kernel, Level, Measure, Mode, Model, Order, ScalarEnergy, Setting,
    check_text,
};

const EXPONENTS: [f64; 12] =
    [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 10.0, 30.0, 1.0 / 3.0, 1e-3];

/// Interactions per run, as many as stay in the first-level cache with their results.
const BATCH: usize = 512;
const RUNS: usize = 401;

fn main() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../potentials/firooz2023.piola");
    let text = std::fs::read_to_string(path).expect("the library is beside the compiler");
    let (_, model) = check_text(&text).expect("the library is right");
    println!("| n | textbook: operations, calls, ns | accurate: operations, calls, ns | ratio |");
    println!("|---|---|---|---|");
    for n in EXPONENTS {
        let forms = [Form::Textbook, Form::Accurate].map(|form| of(&model, n, form));
        let [textbook, accurate] = times([&forms[0].0, &forms[1].0]);
        let cost = |energy: &ScalarEnergy| {
            format!("{}, {}", energy.graph.operations(), energy.graph.calls())
        };
        println!(
            "| {n:.3} | {}, {:.1} ({:.1}) | {}, {:.1} ({:.1}) | {:.2} |",
            cost(&forms[0].1),
            textbook[0],
            textbook[1],
            cost(&forms[1].1),
            accurate[0],
            accurate[1],
            accurate[0] / textbook[0]
        );
    }
}

/// The kernel of the bonds, and its energy.
fn of(model: &Model, n: f64, form: Form) -> (Kernel, ScalarEnergy) {
    let settings = [("C1", 1.0), ("C2", 0.0), ("C3", 0.0), ("n", n)]
        .map(|(name, value)| (name.to_string(), Setting::Number(value)));
    let values = model.values(3, &settings, None).expect("these values are allowed");
    let kernels =
        model.compile_as(&values, Mode::Jit(Level::default()), form).expect("it compiles").kernels;
    let energies = model.specialise_as(&values, form).expect("it compiles").energies;
    let kernel = kernels.into_iter().find(|kernel| kernel.measure() == Measure::Length);
    let energy = energies.into_iter().find(|energy| energy.measure == Measure::Length);
    kernel.zip(energy).expect("C1 is not 0")
}

/// Fastest and median time of an interaction in ns, for each kernel.
fn times(kernels: [&Kernel; 2]) -> [[f64; 2]; 2] {
    let change: Vec<f64> = (0..BATCH).map(|k| k as f64 / BATCH as f64 - 0.4).collect();
    let reference: Vec<f64> = (0..BATCH).map(|k| 0.5 + k as f64 / BATCH as f64).collect();
    let measure: Vec<f64> = change.iter().zip(&reference).map(|(e, l)| l * (1.0 + e)).collect();
    let batch = Batch { measure: &measure, reference: &reference, change: &change };
    let mut out = Derivatives::zeros(BATCH);
    let mut found = [Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        for (kernel, found) in kernels.iter().zip(&mut found) {
            let start = Instant::now();
            kernel.evaluate(black_box(batch), Order::Tangent, out.outputs());
            black_box(&out);
            found.push(start.elapsed().as_secs_f64() * 1e9 / BATCH as f64);
        }
    }
    found.map(|mut times| {
        times.sort_by(f64::total_cmp);
        [times[0], times[RUNS / 2]]
    })
}
