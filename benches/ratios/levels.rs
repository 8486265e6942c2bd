//! What the two levels of machine code cost: the Seth-Hill bond by exponent and order.

use std::hint::black_box;

use piola_compiler::jit::CompiledKernel;
use piola_compiler::{Batch, Derivatives, Form, Level, Measure, Order, ScalarEnergy};

use crate::clock::{Clock, in_turn};
use crate::ours::SethHill;
use crate::record::{Bar, Division, Statistic, Table};

const EXPONENTS: [(&str, f64); 5] =
    [("1", 1.0), ("2", 2.0), ("2.7", 2.7), ("1/3", 1.0 / 3.0), ("ln", 0.0)];

const ROUNDS: usize = 301;
/// Interactions per measurement, and in a batch of them.
const TOTAL: usize = 2048;
const BATCH: usize = 512;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "levels",
        format!(
            "Energies of the Seth-Hill bond alone, without geometry, in ns per interaction at strains up to 10 %, in \
             batches of {BATCH}; runs in turn."
        ),
        ["fast, ns", "strict, ns"],
        Division::TheirsByOurs,
    );
    for (name, n) in EXPONENTS {
        let energy = energy(n);
        let [strict, fast] =
            Level::ALL.map(|level| CompiledKernel::new(&energy, level).expect("it compiles"));
        for order in Order::ALL {
            let times = times([&fast, &strict], order);
            let order = match order {
                Order::Energy => "psi",
                Order::Force => "psi'",
                Order::Gradient => "psi, psi'",
                Order::Tangent => "psi, psi', psi''",
            };
            table.ratio(format!("{name}: {order}"), times, Statistic::Least(ROUNDS), Bar::None);
        }
    }
    vec![table]
}

fn energy(n: f64) -> ScalarEnergy {
    let SethHill { model, values } = SethHill::with_stiffness(n, [1.0, 0.0, 0.0]);
    let energies = model.specialise_as(&values, Form::Accurate).expect("it compiles").energies;
    energies.into_iter().find(|energy| energy.measure == Measure::Length).expect("C1 is not 0")
}

/// Least time of an interaction in ns, for each kernel.
fn times(kernels: [&CompiledKernel; 2], order: Order) -> [f64; 2] {
    let part = |k: usize| (k * 7919 % TOTAL) as f64 / TOTAL as f64;
    let change: Vec<f64> = (0..TOTAL).map(|k| 0.2 * part(k) - 0.1).collect();
    let reference: Vec<f64> = (0..TOTAL).map(|k| 0.5 + part(k + 1)).collect();
    let measure: Vec<f64> = change.iter().zip(&reference).map(|(e, l)| l * (1.0 + e)).collect();
    let evaluate = |kernel: &CompiledKernel, out: &mut Derivatives| {
        for first in (0..TOTAL).step_by(BATCH) {
            let range = first..first + BATCH;
            let batch = Batch {
                measure: &measure[range.clone()],
                reference: &reference[range.clone()],
                change: &change[range],
                fields: &[],
            };
            kernel.evaluate(black_box(batch), order, out.outputs());
            black_box(&mut *out);
        }
    };
    let mut outs = [Derivatives::zeros(BATCH), Derivatives::zeros(BATCH)];
    let [first, second] = &mut outs;
    let times = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || evaluate(kernels[0], first), &mut || evaluate(kernels[1], second)],
    );
    times.map(|times| times.least() * 1e9 / TOTAL as f64)
}
