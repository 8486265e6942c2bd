//! Kernels that are functions of the squared measure against kernels of the measure, of one energy.

use std::hint::black_box;

use piola_compiler::Measure;
use piola_runtime::element::{Contributions, Element, InteractionBatch, Order};
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, discrete, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};
use crate::samples::{COUNT, Samples};

const ROUNDS: usize = 4001;
const FEW_ROUNDS: usize = 101;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "squares",
        "Even energies as functions of the squared measure, against the same energies as functions of the \
         measure: energy, compact gradient and tangent of one interaction in space, and bonds assembled on \
         one thread; runs in turn.",
        ["squares, ns", "measures, ns"],
        Division::OursByTheirs,
    );
    for n in [2.0, -2.0, 4.0] {
        kernels::<3, 1>(&mut table, n);
    }
    for n in [2.0, -2.0, 4.0] {
        kernels::<6, 2>(&mut table, n);
    }
    with_threads(1, || assembled(&mut table));
    vec![table]
}

fn kernels<const C: usize, const K: usize>(table: &mut Table, n: f64) {
    let kind = Measure::ALL[K - 1];
    let energy = SethHill::new(n);
    let batches = Samples::<C>::new().batches::<K>();
    let evaluate = |element: &dyn Element, out: &mut Contributions| {
        for batch in &batches {
            let batch: &InteractionBatch = black_box(batch);
            element.evaluate(batch, Order::Tangent, out).expect("finite");
            black_box(&*out);
        }
    };
    let (squares, measures) = (energy.element(kind), energy.element_of_measure(kind));
    let (mut out, mut other) = (Contributions::new(kind, 3), Contributions::new(kind, 3));
    let [squares, measures] = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || evaluate(&*squares, &mut out), &mut || evaluate(&*measures, &mut other)],
    );
    let [squares, measures] = [squares, measures].map(|x| x.least() / COUNT as f64 * 1e9);
    let name = format!("{} {n}", kind.interaction());
    table.ratio(name, [squares, measures], Statistic::Least(ROUNDS), Bar::None);
}

fn assembled(table: &mut Table) {
    let body = cube(20);
    let u = displacement(&body);
    let energy = SethHill::new(2.0);
    let of = |element: &dyn Fn(Measure) -> Box<dyn Element>| {
        discrete(&body, 3.0, Weights::Unit, &[Measure::Length], element)
    };
    let squares = of(&|measure| energy.element(measure));
    let measures = of(&|measure| energy.element_of_measure(measure));
    let n_bonds = squares.neighborhood().n_bonds() as f64;
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(squares.pattern());
    let (mut other_gradient, mut other) = (gradient.clone(), tangent.clone());
    let [squares, measures] = in_turn(
        FEW_ROUNDS,
        Clock::Wall,
        [
            &mut || {
                squares.tangent(&u, &mut gradient, &mut tangent).expect("finite");
            },
            &mut || {
                measures.tangent(&u, &mut other_gradient, &mut other).expect("finite");
            },
        ],
    );
    let difference = tangent.values.iter().zip(&other.values).map(|(x, y)| (x - y) * (x - y));
    let norm = other.values.iter().map(|x| x * x).sum::<f64>();
    assert!(difference.sum::<f64>() < 1e-24 * norm, "both assemble the same");
    let [squares, measures] = [squares, measures].map(|x| x.least() / n_bonds * 1e9);
    let of = Statistic::Least(FEW_ROUNDS);
    table.ratio("bonds assembled, 20^3 points, 2", [squares, measures], of, Bar::None);
}
