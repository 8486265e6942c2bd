//! What an energy of the deformation gradient costs: psi with its stress, and a product with the tangent,
//! near rest and far from it, against hyper-dual numbers and the same energy written in Rust.

use std::hint::black_box;

use piola_compiler::{
    Form, GradientBatch, GradientKernel, Level, Mode, Model, Setting, Values, check_text,
};

use crate::clock::{Clock, Times, in_turn};
use crate::record::{Cell, Table};

/// Places per measurement.
const PLACES: usize = 1024;
const ROUNDS: usize = 101;
/// Interpreters take long enough to be timed by a few runs.
const FEW_ROUNDS: usize = 3;

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

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::plain(
        "gradients",
        format!(
            "One place (point or bond) in three dimensions, all components of P or dP, ns, in batches of {PLACES}; least of \
             {ROUNDS} runs in turn, for the last two columns of {FEW_ROUNDS}. *Near rest*: max|F - I| < 0.25 everywhere; *some \
             far*: a third of the places beyond it. *Rust* is the same energy by hand in F as in a book, compiled by rustc; \
             the last two columns are ours without machine code, walking the graph of the energy."
        ),
        &[
            "energy",
            "where",
            "of",
            "ours",
            "ours, strict",
            "ours, textbook form",
            "Rust",
            "hyper-dual numbers, interpreted",
            "our derivatives, interpreted",
        ],
    );
    for name in ["st_venant_kirchhoff", "neo_hooke", "hencky"] {
        let path = format!("{}/potentials/{name}.piola", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).expect("the library is there");
        let (_, model) = check_text(&text).expect("the library is right");
        let settings = [("lambda", LAMBDA), ("mu", MU)]
            .map(|(name, value)| (name.to_string(), Setting::Number(value)));
        let values = model.values(3, &settings, None).expect("two parameters");
        // max |F - I| < 0.25, and a third of the places beyond it.
        for (place, size) in [("near rest", 0.2), ("some far", 0.3)] {
            rows(&mut table, [name, place], &model, &values, &places(size));
        }
    }
    vec![table]
}

fn rows(
    table: &mut Table,
    [name, place]: [&str; 2],
    model: &Model,
    values: &Values,
    places: &Places,
) {
    let kernel = |mode, form| -> GradientKernel {
        model
            .compile_gradient(values, mode, form)
            .expect("it compiles")
            .0
            .expect("it has an energy")
    };
    let compiled = [
        kernel(Mode::Jit(Level::Fast), Form::Accurate),
        kernel(Mode::Jit(Level::Strict), Form::Accurate),
        kernel(Mode::Jit(Level::Fast), Form::Textbook),
    ];
    let interpreted =
        [kernel(Mode::HyperDual, Form::Textbook), kernel(Mode::Interpreter, Form::Accurate)];
    for product in [false, true] {
        let ours = |kernel: &GradientKernel| evaluate(kernel, product, places);
        let [fast, strict, textbook, rust] = in_turn(
            ROUNDS,
            Clock::Wall,
            [
                &mut || ours(&compiled[0]),
                &mut || ours(&compiled[1]),
                &mut || ours(&compiled[2]),
                &mut || written(name, product, places),
            ],
        );
        let [dual, interpreter] = in_turn(
            FEW_ROUNDS,
            Clock::Wall,
            [&mut || ours(&interpreted[0]), &mut || ours(&interpreted[1])],
        );
        let each = |times: &Times| Cell::Number(times.least() * 1e9 / PLACES as f64);
        let rust = if name == BY_STRETCHES { "".into() } else { each(&rust) };
        let what = if product { "dP" } else { "psi, P" };
        let name = format!("`{name}`");
        table.row([
            name.into(),
            place.into(),
            what.into(),
            each(&fast),
            each(&strict),
            each(&textbook),
            rust,
            each(&dual),
            each(&interpreter),
        ]);
    }
}

/// All places by a kernel.
fn evaluate(kernel: &GradientKernel, product: bool, places: &Places) {
    let (mut psi, mut out) = ([0.0; PLACES], [0.0; 9 * PLACES]);
    let at =
        GradientBatch { n: PLACES, gradient: black_box(&places.gradient), change: &places.change };
    if product {
        kernel.product(at, &places.direction, &mut out);
    } else {
        kernel.evaluate(at, &mut psi, &mut out);
    }
    black_box((&psi, &out));
}

type Tensor = [[f64; 3]; 3];

/// The energies by hand, place by place, in F as in a book.
fn written(name: &str, product: bool, places: &Places) {
    if name == BY_STRETCHES {
        return;
    }
    let (mut psi, mut out) = ([0.0; PLACES], [0.0; 9 * PLACES]);
    let places = black_box(places);
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
    black_box((&psi, &out));
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
