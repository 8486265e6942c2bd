//! What an energy of the deformation gradient costs: psi with its stress, and a product with the tangent,
//! near rest and far from it, against hyper-dual numbers and the same energy written in Rust.
//!
//! `cargo bench -p piola-compiler --bench gradients` prints a table. All ways of a row run in turn in one
//! process, so that ratios hold on a busy machine too; the fastest of the runs is shown.

use std::hint::black_box;
use std::time::Instant;

use piola_compiler::{
    Form, GradientBatch, GradientKernel, Level, Mode, Model, Setting, Values, check_text,
};

/// Places per measurement.
const PLACES: usize = 1024;
const RUNS: usize = 101;

/// The energy that is not written in Rust here: it needs principal stretches.
const BY_STRETCHES: &str = "hencky";

const LAMBDA: f64 = 3.0;
const MU: f64 = 1.0;

/// Gradients component by component.
struct Places {
    gradient: Vec<f64>,
    change: Vec<f64>,
    direction: Vec<f64>,
}

fn places(size: f64) -> Places {
    let number = |k: usize| size * (2.0 * (k as f64 * 0.618_033_988_749_894_9).fract() - 1.0);
    let change: Vec<f64> = (0..9 * PLACES).map(number).collect();
    let rest = |k: usize| if (k / PLACES).is_multiple_of(4) { 1.0 } else { 0.0 };
    let gradient = change.iter().enumerate().map(|(k, h)| rest(k) + h).collect();
    let direction = (0..9 * PLACES).map(|k| number(k + 7)).collect();
    Places { gradient, change, direction }
}

fn main() {
    println!("ns per place in three dimensions, fastest of {RUNS}; all components of P and dP");
    println!(
        "| energy | where | of | fast | strict | textbook | Rust | hyper-dual | interpreter |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for name in ["st_venant_kirchhoff", "neo_hooke", "hencky"] {
        let path = format!("{}/../potentials/{name}.piola", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).expect("the library is beside the compiler");
        let (_, model) = check_text(&text).expect("the library is right");
        let settings = [("lambda", LAMBDA), ("mu", MU)]
            .map(|(name, value)| (name.to_string(), Setting::Number(value)));
        let values = model.values(3, &settings, None).expect("two parameters");
        // max |F - I| < 0.25, and a third of the places beyond it.
        for (place, size) in [("near rest", 0.2), ("some far", 0.3)] {
            rows(name, place, &model, &values, &places(size));
        }
    }
}

fn rows(name: &str, place: &str, model: &Model, values: &Values, places: &Places) {
    let kernel = |mode, form| -> GradientKernel {
        model.compile_gradient(values, mode, form).unwrap().0.expect("it has an energy")
    };
    let kernels = [
        kernel(Mode::Jit(Level::Fast), Form::Accurate),
        kernel(Mode::Jit(Level::Strict), Form::Accurate),
        kernel(Mode::Jit(Level::Fast), Form::Textbook),
        kernel(Mode::HyperDual, Form::Textbook),
        kernel(Mode::Interpreter, Form::Accurate),
    ];
    for product in [false, true] {
        let mut least = [f64::INFINITY; 6];
        let (mut psi, mut out) = (vec![0.0; PLACES], vec![0.0; 9 * PLACES]);
        for round in 0..RUNS {
            for (way, least) in least.iter_mut().enumerate() {
                // Interpreters take long enough to be timed by a few runs.
                if way >= 4 && round >= 5 || way == 3 && name == BY_STRETCHES {
                    continue;
                }
                let start = Instant::now();
                if way == 3 {
                    written(name, product, black_box(places), &mut psi, &mut out);
                } else {
                    let kernel = &kernels[if way < 3 { way } else { way - 1 }];
                    let at = GradientBatch {
                        n: PLACES,
                        gradient: black_box(&places.gradient),
                        change: &places.change,
                    };
                    if product {
                        kernel.product(at, &places.direction, &mut out);
                    } else {
                        kernel.evaluate(at, &mut psi, &mut out);
                    }
                }
                black_box((&psi, &out));
                *least = least.min(start.elapsed().as_secs_f64() * 1e9 / PLACES as f64);
            }
        }
        let what = if product { "dP" } else { "psi, P" };
        let [fast, strict, textbook, rust, dual, interpreter] = least;
        let rust = if rust.is_finite() { format!("{rust:.1}") } else { String::new() };
        println!(
            "| {name} | {place} | {what} | {fast:.1} | {strict:.1} | {textbook:.1} | {rust} | \
             {dual:.0} | {interpreter:.0} |"
        );
    }
}

type Tensor = [[f64; 3]; 3];

/// The energies by hand, place by place, in F as in a book.
fn written(name: &str, product: bool, places: &Places, psi: &mut [f64], out: &mut [f64]) {
    let tensor = |array: &[f64], p: usize| -> Tensor {
        std::array::from_fn(|r| std::array::from_fn(|c| array[(3 * r + c) * PLACES + p]))
    };
    for p in 0..PLACES {
        let f = tensor(&places.gradient, p);
        let result = if product {
            let df = tensor(&places.direction, p);
            if name == "neo_hooke" { neo_hooke_product(&f, &df) } else { svk_product(&f, &df) }
        } else {
            let (energy, stress) = if name == "neo_hooke" { neo_hooke(&f) } else { svk(&f) };
            psi[p] = energy;
            stress
        };
        for k in 0..9 {
            out[k * PLACES + p] = result[k / 3][k % 3];
        }
    }
}

fn each(f: impl Fn(usize, usize) -> f64) -> Tensor {
    let mut tensor = [[0.0; 3]; 3];
    for (r, row) in tensor.iter_mut().enumerate() {
        for (c, x) in row.iter_mut().enumerate() {
            *x = f(r, c);
        }
    }
    tensor
}

fn times(a: &Tensor, b: &Tensor) -> Tensor {
    each(|r, c| a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c])
}

fn transposed(a: &Tensor) -> Tensor {
    each(|r, c| a[c][r])
}

fn trace(a: &Tensor) -> f64 {
    a[0][0] + a[1][1] + a[2][2]
}

fn dot(a: &Tensor, b: &Tensor) -> f64 {
    (0..9).map(|k| a[k / 3][k % 3] * b[k / 3][k % 3]).sum()
}

fn unit(r: usize, c: usize) -> f64 {
    if r == c { 1.0 } else { 0.0 }
}

fn second_stress(e: &Tensor) -> Tensor {
    let trace = trace(e);
    each(|r, c| LAMBDA * trace * unit(r, c) + 2.0 * MU * e[r][c])
}

fn svk(f: &Tensor) -> (f64, Tensor) {
    let c = times(&transposed(f), f);
    let e = each(|r, k| 0.5 * (c[r][k] - unit(r, k)));
    let energy = 0.5 * LAMBDA * trace(&e) * trace(&e) + MU * dot(&e, &e);
    (energy, times(f, &second_stress(&e)))
}

fn svk_product(f: &Tensor, df: &Tensor) -> Tensor {
    let c = times(&transposed(f), f);
    let e = each(|r, k| 0.5 * (c[r][k] - unit(r, k)));
    let mixed = times(&transposed(f), df);
    let de = each(|r, k| 0.5 * (mixed[r][k] + mixed[k][r]));
    let (first, second) = (times(df, &second_stress(&e)), times(f, &second_stress(&de)));
    each(|r, k| first[r][k] + second[r][k])
}

/// `F^-T` and the determinant.
fn inverse_transposed(f: &Tensor) -> (Tensor, f64) {
    let cofactor = each(|r, c| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        f[r1][c1] * f[r2][c2] - f[r1][c2] * f[r2][c1]
    });
    let j = f[0][0] * cofactor[0][0] + f[0][1] * cofactor[0][1] + f[0][2] * cofactor[0][2];
    (each(|r, c| cofactor[r][c] / j), j)
}

fn neo_hooke(f: &Tensor) -> (f64, Tensor) {
    let (g, j) = inverse_transposed(f);
    let ln = libm::log(j);
    let energy = 0.5 * MU * (dot(f, f) - 3.0 - 2.0 * ln) + 0.5 * LAMBDA * ln * ln;
    (energy, each(|r, c| MU * f[r][c] + (LAMBDA * ln - MU) * g[r][c]))
}

fn neo_hooke_product(f: &Tensor, df: &Tensor) -> Tensor {
    let (g, j) = inverse_transposed(f);
    let ln = libm::log(j);
    let along = dot(&g, df);
    let turned = times(&times(&g, &transposed(df)), &g);
    let a = LAMBDA * ln - MU;
    each(|r, c| MU * df[r][c] + LAMBDA * along * g[r][c] - a * turned[r][c])
}
