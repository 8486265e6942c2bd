//! What accuracy costs: kernels of the Seth-Hill bond in the accurate form against the textbook form.

use std::hint::black_box;

use piola_compiler::{Batch, Derivatives, Form, Kernel, Level, Measure, Mode, Order, ScalarEnergy};

use crate::clock::{Clock, in_turn};
use crate::ours::SethHill;
use crate::record::Table;

const EXPONENTS: [(&str, f64); 12] = [
    ("-2", -2.0),
    ("-1", -1.0),
    ("-1/2", -0.5),
    ("ln", 0.0),
    ("1/2", 0.5),
    ("1", 1.0),
    ("2", 2.0),
    ("4", 4.0),
    ("10", 10.0),
    ("30", 30.0),
    ("1/3", 1.0 / 3.0),
    ("1e-3", 1e-3),
];

/// Interactions per run, as many as stay in the first-level cache with their results.
const BATCH: usize = 512;
const ROUNDS: usize = 401;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::plain(
        "forms",
        format!(
            "Kernels of the Seth-Hill bond with psi, psi' and psi'': operations and calls of elementary functions in \
             the expression, and ns for an interaction, least of {ROUNDS} runs in turn, in batches of {BATCH}."
        ),
        &[
            "n",
            "operations, calls: textbook",
            "accurate",
            "textbook, ns",
            "accurate, ns",
            "accurate / textbook",
        ],
    );
    for (name, n) in EXPONENTS {
        let forms = [Form::Textbook, Form::Accurate].map(|form| of(n, form));
        let [textbook, accurate] = times([&forms[0].0, &forms[1].0]);
        let cost = |energy: &ScalarEnergy| {
            format!("{}, {}", energy.graph.operations(), energy.graph.calls())
        };
        table.row([
            name.into(),
            cost(&forms[0].1).into(),
            cost(&forms[1].1).into(),
            textbook.into(),
            accurate.into(),
            (accurate / textbook).into(),
        ]);
    }
    vec![table]
}

/// The kernel of the bonds, and its energy.
fn of(n: f64, form: Form) -> (Kernel, ScalarEnergy) {
    let SethHill { model, values } = SethHill::with_stiffness(n, [1.0, 0.0, 0.0]);
    let kernels =
        model.compile(&values, Mode::Jit(Level::default()), form).expect("it compiles").kernels;
    let energies = model.specialise_as(&values, form).expect("it compiles").energies;
    let kernel = kernels.into_iter().find(|kernel| kernel.measure() == Measure::Length);
    let energy = energies.into_iter().find(|energy| energy.measure == Measure::Length);
    kernel.zip(energy).expect("C1 is not 0")
}

/// Least time of an interaction in ns, for each kernel.
fn times(kernels: [&Kernel; 2]) -> [f64; 2] {
    let change: Vec<f64> = (0..BATCH).map(|k| k as f64 / BATCH as f64 - 0.4).collect();
    let reference: Vec<f64> = (0..BATCH).map(|k| 0.5 + k as f64 / BATCH as f64).collect();
    let measure: Vec<f64> = change.iter().zip(&reference).map(|(e, l)| l * (1.0 + e)).collect();
    let batch = Batch { measure: &measure, reference: &reference, change: &change, fields: &[] };
    let mut outs = [Derivatives::zeros(BATCH), Derivatives::zeros(BATCH)];
    let [textbook, accurate] = &mut outs;
    let evaluate = |kernel: &Kernel, out: &mut Derivatives| {
        kernel.evaluate(black_box(batch), Order::Tangent, out.outputs());
        black_box(out);
    };
    let times = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || evaluate(kernels[0], textbook), &mut || evaluate(kernels[1], accurate)],
    );
    times.map(|times| times.least() * 1e9 / BATCH as f64)
}
