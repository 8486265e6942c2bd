//! What an energy of the deformation gradient costs: psi with its stress, and a product with the tangent,
//! near rest and far from it, against hyper-dual numbers and the same energy written in Rust.

use std::hint::black_box;
use std::marker::PhantomData;

use piola_compiler::{
    Form, GradientBatch, GradientKernel, Level, Mode, Model, Setting, Values, check_text,
};
use pulp::{Arch, Simd, WithSimd};

use crate::assembly::assert_close;
use crate::clock::{Clock, Times, in_turn};
use crate::record::{Cell, Table};
use crate::tensors::numbers::ByNumbers;
use crate::tensors::{LAMBDA, LANES, MU, Material, NO_TENSORS, Tensors, by_hand, numbers};

/// Places per measurement.
const PLACES: usize = 1024;
const ROUNDS: usize = 101;
/// Interpreters take long enough to be timed by a few runs.
const FEW_ROUNDS: usize = 3;

/// All places by a material, in the widest registers of the machine.
struct Pass<'a, M> {
    is_product: bool,
    places: &'a Places,
    out: &'a mut Out,
    material: PhantomData<M>,
}

impl<M: Material> WithSimd for Pass<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Pass { is_product, places, out, .. } = self;
        for first in (0..PLACES).step_by(LANES) {
            let f = tensors(&places.gradient, first);
            let result = if is_product {
                M::stress_change(&f, &tensors(&places.direction, first))
            } else {
                let (psi, stress) = M::stress(&f);
                out.psi[first..first + LANES].copy_from_slice(&psi);
                stress
            };
            for k in 0..9 {
                let place = k * PLACES + first;
                out.tensor[place..place + LANES].copy_from_slice(&result[k / 3][k % 3]);
            }
        }
    }
}

#[inline(always)]
fn tensors(array: &[f64], first: usize) -> Tensors {
    let mut tensors = NO_TENSORS;
    for k in 0..9 {
        let place = k * PLACES + first;
        tensors[k / 3][k % 3].copy_from_slice(&array[place..place + LANES]);
    }
    tensors
}

fn pass<M: Material>(is_product: bool, places: &Places, out: &mut Out) {
    Arch::new().dispatch(Pass::<M> { is_product, places, out, material: PhantomData });
}

/// All places by a material: P or its change along the directions.
type Way = fn(bool, &Places, &mut Out);

/// By hand, and over dual numbers; `hencky` needs principal stretches.
fn ways(name: &str) -> Option<[Way; 2]> {
    match name {
        "st_venant_kirchhoff" => Some([
            pass::<by_hand::StVenantKirchhoff>,
            pass::<ByNumbers<numbers::StVenantKirchhoff>>,
        ]),
        "neo_hooke" => Some([pass::<by_hand::NeoHooke>, pass::<ByNumbers<numbers::NeoHooke>>]),
        _ => None,
    }
}

/// Room for the results at all places, component by component.
struct Out {
    psi: Vec<f64>,
    tensor: Vec<f64>,
}

impl Out {
    fn new() -> Out {
        Out { psi: vec![0.0; PLACES], tensor: vec![0.0; 9 * PLACES] }
    }
}

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
             far*: a third of the places beyond it. *Rust* is the same energy by hand in F, *dual numbers* the \
             energy over num-dual's `Dual64` and `HyperDual64`, one pass for each component of P or dP, both eight places side by side and \
             compiled by rustc; the last two columns are ours without machine code, walking the graph of the energy."
        ),
        &[
            "energy",
            "where",
            "of",
            "ours",
            "ours, strict",
            "ours, textbook form",
            "Rust",
            "dual numbers",
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
        model.compile(values, mode, form).expect("it compiles").gradient.expect("it has an energy")
    };
    let compiled = [
        kernel(Mode::Jit(Level::Fast), Form::Accurate),
        kernel(Mode::Jit(Level::Strict), Form::Accurate),
        kernel(Mode::Jit(Level::Fast), Form::Textbook),
    ];
    let interpreted =
        [kernel(Mode::HyperDual, Form::Textbook), kernel(Mode::Interpreter, Form::Accurate)];
    let theirs = ways(name);
    for product in [false, true] {
        let mut outs: [Out; 7] = std::array::from_fn(|_| Out::new());
        let [out_fast, out_strict, out_textbook, out_hand, out_numbers, out_dual, out_graph] =
            &mut outs;
        let ours = |kernel, out: &mut Out| evaluate(kernel, product, places, out);
        let other = |which: usize, out: &mut Out| {
            if let Some(ways) = theirs {
                ways[which](product, black_box(places), out);
                black_box(out);
            }
        };
        let [fast, strict, textbook, by_hand, numbers] = in_turn(
            ROUNDS,
            Clock::Wall,
            [
                &mut || ours(&compiled[0], out_fast),
                &mut || ours(&compiled[1], out_strict),
                &mut || ours(&compiled[2], out_textbook),
                &mut || other(0, out_hand),
                &mut || other(1, out_numbers),
            ],
        );
        let [dual, interpreter] = in_turn(
            FEW_ROUNDS,
            Clock::Wall,
            [&mut || ours(&interpreted[0], out_dual), &mut || ours(&interpreted[1], out_graph)],
        );
        let what = if product { "dP" } else { "psi, P" };
        for (number, out) in outs.iter().enumerate() {
            if theirs.is_some() || ![3, 4].contains(&number) {
                assert_close(
                    &format!("{name}, {what}, way {number}"),
                    &out.tensor,
                    &outs[6].tensor,
                );
            }
        }
        let each = |times: &Times| Cell::Number(times.least() * 1e9 / PLACES as f64);
        let written = |times: &Times| if theirs.is_some() { each(times) } else { "".into() };
        table.row([
            format!("`{name}`").into(),
            place.into(),
            what.into(),
            each(&fast),
            each(&strict),
            each(&textbook),
            written(&by_hand),
            written(&numbers),
            each(&dual),
            each(&interpreter),
        ]);
    }
}

/// All places by a kernel.
fn evaluate(kernel: &GradientKernel, product: bool, places: &Places, out: &mut Out) {
    let at = GradientBatch {
        n: PLACES,
        gradient: black_box(&places.gradient),
        change: &places.change,
        fields: &[],
    };
    if product {
        kernel.product(at, &places.direction, &mut out.tensor);
    } else {
        kernel.evaluate(at, &mut out.psi, &mut out.tensor);
    }
    black_box(out);
}
