//! What a kernel costs: the Seth-Hill bond by exponent, level, order and batch size, and its compilation.
//!
//! `cargo bench -p piola-compiler --bench kernels` prints tables. All kernels of a row run in turn in one
//! process, so that ratios hold on a busy machine too; the fastest and the median of the runs are shown.

use std::hint::black_box;
use std::time::Instant;

use piola_compiler::jit::CompiledKernel;
use piola_compiler::{
    Batch, Derivatives, Form, Level, Measure, Model, Order, ScalarEnergy, Setting, check_text,
};

/// `None` is the logarithm.
const EXPONENTS: [(&str, f64); 5] =
    [("1", 1.0), ("2", 2.0), ("2.7", 2.7), ("1/3", 1.0 / 3.0), ("ln", 0.0)];

const BATCHES: [usize; 5] = [8, 16, 64, 128, 512];
const RUNS: usize = 301;

/// Interactions per measurement, however they are cut into batches.
const TOTAL: usize = 2048;

fn main() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../potentials/firooz2023.piola");
    let text = std::fs::read_to_string(path).expect("the library is beside the compiler");
    let (_, model) = check_text(&text).expect("the library is right");
    tables(&model);
    compilation(&model);
}

/// ns per interaction, strict and fast.
fn tables(model: &Model) {
    println!("ns per interaction: fastest (median) of {RUNS}");
    println!("| n | batch | order | strict | fast | ratio |");
    println!("|---|---|---|---|---|---|");
    for (name, n) in EXPONENTS {
        let energy = energy(model, n);
        let kernels = Level::ALL.map(|level| CompiledKernel::new(&energy, level).unwrap());
        for batch in BATCHES {
            for order in Order::ALL {
                if order != Order::Tangent && batch != 128 {
                    continue;
                }
                let [strict, fast] = times(&kernels, batch, order);
                println!(
                    "| {name} | {batch} | {order:?} | {:.2} ({:.2}) | {:.2} ({:.2}) | {:.2} |",
                    strict[0],
                    strict[1],
                    fast[0],
                    fast[1],
                    strict[0] / fast[0]
                );
            }
        }
    }
}

/// ms per compiled kernel: code generator, memory and all three orders.
fn compilation(model: &Model) {
    println!("\nms per compiled kernel: fastest (median) of 21");
    println!("| n | operations | strict | fast |");
    println!("|---|---|---|---|");
    for (name, n) in EXPONENTS {
        let energy = energy(model, n);
        let mut found = [Vec::new(), Vec::new()];
        for _ in 0..21 {
            for (level, found) in Level::ALL.into_iter().zip(&mut found) {
                let start = Instant::now();
                black_box(CompiledKernel::new(&energy, level).unwrap());
                found.push(start.elapsed().as_secs_f64() * 1e3);
            }
        }
        let [strict, fast] = found.map(fastest_and_median);
        println!(
            "| {name} | {} | {:.2} ({:.2}) | {:.2} ({:.2}) |",
            energy.graph.operations(),
            strict[0],
            strict[1],
            fast[0],
            fast[1]
        );
    }
}

fn energy(model: &Model, n: f64) -> ScalarEnergy {
    let settings = [("C1", 1.0), ("C2", 0.0), ("C3", 0.0), ("n", n)]
        .map(|(name, value)| (name.to_string(), Setting::Number(value)));
    let values = model.values(3, &settings, None).expect("these values are allowed");
    let energies = model.specialise_as(&values, Form::Accurate).expect("it compiles").energies;
    energies.into_iter().find(|energy| energy.measure == Measure::Length).expect("C1 is not 0")
}

/// Fastest and median time of an interaction in ns, for each kernel.
fn times(kernels: &[CompiledKernel; 2], batch: usize, order: Order) -> [[f64; 2]; 2] {
    // Strains of up to 10 %.
    let part = |k: usize| (k * 7919 % TOTAL) as f64 / TOTAL as f64;
    let change: Vec<f64> = (0..TOTAL).map(|k| 0.2 * part(k) - 0.1).collect();
    let reference: Vec<f64> = (0..TOTAL).map(|k| 0.5 + part(k + 1)).collect();
    let measure: Vec<f64> = change.iter().zip(&reference).map(|(e, l)| l * (1.0 + e)).collect();
    let mut out = Derivatives::zeros(batch);
    let mut found = [Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        for (kernel, found) in kernels.iter().zip(&mut found) {
            let start = Instant::now();
            for first in (0..TOTAL).step_by(batch) {
                let range = first..first + batch;
                let batch = Batch {
                    measure: &measure[range.clone()],
                    reference: &reference[range.clone()],
                    change: &change[range],
                };
                kernel.evaluate(black_box(batch), order, out.outputs());
                black_box(&out);
            }
            found.push(start.elapsed().as_secs_f64() * 1e9 / TOTAL as f64);
        }
    }
    found.map(fastest_and_median)
}

fn fastest_and_median(mut times: Vec<f64>) -> [f64; 2] {
    times.sort_by(f64::total_cmp);
    [times[0], times[times.len() / 2]]
}
