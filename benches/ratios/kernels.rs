//! Kernels: compact gradient and tangent of one interaction, against hyper-dual numbers and against
//! the same formulas in C and Rust.

use std::hint::black_box;

use piola_compiler::Measure;
use piola_runtime::element::{CAPACITY, Contributions, Element, InteractionBatch, Order};
use pulp::Arch;

use crate::clock::{Clock, in_turn};
use crate::foreign::{self, Program};
use crate::hyperdual::{self, Block, LANES, Linear, Logarithm, Power, Quadratic, Results, Strain};
use crate::ours::SethHill;
use crate::record::{Bar, Division, Statistic, Table};
use crate::samples::{COUNT, Samples, measure};

const ROUNDS: usize = 101;
/// An interpreted pass takes some thousand times as long.
const FEW_ROUNDS: usize = 5;
/// Runs of each foreign program, in turn with ours.
const TURNS: usize = 9;
/// As many as a foreign program takes of each kernel.
const FOREIGN_ROUNDS: usize = 61;

/// One kernel of ours with its interactions.
struct Case {
    name: String,
    element: Box<dyn Element>,
    batches: Vec<InteractionBatch>,
    out: Contributions,
}

impl Case {
    fn new<S: Strain, const C: usize, const K: usize>() -> Case {
        let kind = Measure::ALL[K - 1];
        Case {
            name: format!("{} {}", kind.interaction(), exponent(S::N)),
            element: SethHill::new(S::N).element(kind),
            batches: Samples::<C>::new().batches::<K>(),
            out: Contributions::new(kind, 3),
        }
    }

    fn run(&mut self) {
        for batch in &self.batches {
            self.element.evaluate(black_box(batch), Order::Tangent, &mut self.out).expect("finite");
            black_box(&self.out);
        }
    }

    /// Sums of squares of energies, gradients and upper triangles of the tangents.
    fn sums(&mut self) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for batch in &self.batches {
            self.element.evaluate(batch, Order::Tangent, &mut self.out).expect("finite");
            let n = batch.len();
            let square = |x: &[f64]| x[..n].iter().map(|x| x * x).sum::<f64>();
            sums[0] += square(&self.out.energy);
            sums[1] += self.out.gradient.iter().map(|x| square(x)).sum::<f64>();
            sums[2] += self.out.hessian.iter().map(|x| square(x)).sum::<f64>();
        }
        sums
    }
}

fn exponent(n: f64) -> String {
    if n == 0.0 { "ln".to_string() } else { format!("{n}") }
}

/// In ns per interaction.
fn each(seconds: f64) -> f64 {
    seconds / COUNT as f64 * 1e9
}

/// Against hyper-dual numbers.
pub(crate) fn against_hyper_dual() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "kernels",
        "Energy, compact gradient and tangent of one interaction in space. Theirs: num-dual's `HyperDual64`, \
         compiled for each energy, on relative vectors, one pass per entry of the tangent (6, 21, 45), \
         eight interactions side by side in the same registers as ours (`benches/ratios/hyperdual.rs`, with what \
         was slower). Runs in turn, all with warm caches.",
        ["ours, ns", "hyper-dual, ns"],
        Division::TheirsByOurs,
    );
    // Again and again: the clock of a processor wanders for longer than one kernel is measured.
    for _ in 0..TURNS {
        by_strain::<3, 1>(&mut table, Bar::AtLeast(4.0, 8.0));
        by_strain::<6, 2>(&mut table, Bar::AtLeast(15.0, 30.0));
        by_strain::<9, 3>(&mut table, Bar::AtLeast(30.0, 60.0));
    }
    let mut by_interpreter = Table::of_ratios(
        "interpreted",
        "The same; theirs: `derivatives = \"hyperdual-coordinates\"`, the energy as written, interpreted on the \
         coordinates of all corners (21, 45, 78 passes): what checks our derivatives, no rival.",
        ["ours, ns", "interpreted, ns"],
        Division::TheirsByOurs,
    );
    interpreted::<3, 1>(&mut by_interpreter);
    interpreted::<6, 2>(&mut by_interpreter);
    interpreted::<9, 3>(&mut by_interpreter);
    vec![table, by_interpreter]
}

fn by_strain<const C: usize, const K: usize>(table: &mut Table, bar: Bar) {
    compiled::<Linear, C, K>(table, bar);
    compiled::<Quadratic, C, K>(table, bar);
    compiled::<Power, C, K>(table, bar);
    compiled::<Logarithm, C, K>(table, bar);
}

fn compiled<S: Strain, const C: usize, const K: usize>(table: &mut Table, bar: Bar) {
    let mut case = Case::new::<S, C, K>();
    let samples = Samples::<C>::new();
    let mut blocks = [Block::<C>::EMPTY; COUNT / LANES];
    for sample in 0..COUNT {
        let (at_rest, u) = (&samples.reference[sample], &samples.displacement[sample]);
        let now = std::array::from_fn(|c| at_rest[c] + u[c]);
        let block = &mut blocks[sample / LANES];
        block.set(sample % LANES, &now, measure(at_rest), samples.weight[sample]);
    }
    let arch = Arch::new();
    // As many as one of our batches has.
    let mut out = [Results::<C>::ZERO; CAPACITY / LANES];
    let mut theirs = || {
        for blocks in blocks.chunks(out.len()) {
            hyperdual::evaluate::<S, C>(arch, black_box(blocks), &mut out);
            black_box(&out);
        }
    };
    let [ours, theirs] = in_turn(ROUNDS, Clock::Wall, [&mut || case.run(), &mut theirs]);
    let mut sums = [0.0; 3];
    for blocks in blocks.chunks(out.len()) {
        hyperdual::evaluate::<S, C>(arch, blocks, &mut out);
        for out in &out[..blocks.len()] {
            let square = |x: &[f64; LANES]| x.iter().map(|x| x * x).sum::<f64>();
            sums[0] += square(&out.energy);
            sums[1] += out.gradient.iter().map(square).sum::<f64>();
            sums[2] += out.tangent.iter().flatten().map(square).sum::<f64>();
        }
    }
    let found = case.sums();
    assert_same(&case.name, found, sums);
    let times = [each(ours.least()), each(theirs.least())];
    table.more_runs(case.name, times, ROUNDS, bar);
}

fn interpreted<const C: usize, const K: usize>(table: &mut Table) {
    let kind = Measure::ALL[K - 1];
    let mut case = Case::new::<Linear, C, K>();
    let element = SethHill::new(1.0).coordinate_element(kind);
    let batches = Samples::<C>::new().batches::<K>();
    let mut out = Contributions::new(kind, 3);
    let mut theirs = || {
        for batch in &batches {
            element.evaluate(black_box(batch), Order::Tangent, &mut out).expect("finite");
        }
    };
    let [ours, theirs] = in_turn(FEW_ROUNDS, Clock::Wall, [&mut || case.run(), &mut theirs]);
    let times = [each(ours.least()), each(theirs.least())];
    table.ratio(case.name, times, Statistic::Least(FEW_ROUNDS), Bar::None);
}

/// Both computed the same, to rounding.
fn assert_same(name: &str, found: [f64; 3], expected: [f64; 3]) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 1e-11, "{name}: {found} is not {expected}");
    }
}

/// Against the same formulas in C and Rust.
pub(crate) fn against_foreign() -> Vec<Table> {
    let programs = foreign::compile();
    let mut cases = all_cases();
    let (ours, theirs) = in_turn_with(&programs, &mut cases);
    let how = format!(
        "Energy, compact gradient and tangent; the same formulas written by hand without guards \
         (`benches/ratios/foreign`), ns per interaction. Both write to a ring of as many results as one of our batches \
         has. Each is a program of its own, run {TURNS} times in turn with ours."
    );
    let of_kind = |is_fast: bool| -> Vec<(&Program, &Vec<f64>)> {
        programs.iter().zip(&theirs).filter(|(program, _)| program.is_fast == is_fast).collect()
    };
    let of = Statistic::Least(TURNS * FOREIGN_ROUNDS);
    let table = |name: &str, how: String| {
        Table::of_ratios(name, how, ["ours, ns", "theirs, ns"], Division::OursByTheirs)
    };
    let (fast, strict) = (of_kind(true), of_kind(false));
    let names: Vec<&str> = fast.iter().map(|(program, _)| program.name.as_str()).collect();
    let of_all = format!("{how} For each kernel the best of {}.", names.join(", "));
    let mut best_of_all = table("foreign", of_all);
    for (number, case) in cases.iter().enumerate() {
        let best = fast.iter().min_by(|p, q| p.1[number].total_cmp(&q.1[number]));
        if let Some((program, theirs)) = best {
            let name = format!("{}, {}", case.name, program.name);
            best_of_all.ratio(name, [ours[number], theirs[number]], of, Bar::AtMost(1.2, 1.0));
        }
    }
    let how = format!(
        "{how} Without leave to compute as if numbers were real, n = 1. Square roots that may set `errno` are not \
         vectorised."
    );
    let mut exact = table("foreign-exact", how);
    // The first of each measure.
    for (number, case) in cases.iter().enumerate().step_by(4) {
        for (program, theirs) in &strict {
            let name = format!("{}, {}", case.name, program.name);
            exact.ratio(name, [ours[number], theirs[number]], of, Bar::None);
        }
    }
    vec![best_of_all, exact]
}

/// In ns per interaction: ours for each case, theirs for each program and case.
fn in_turn_with(programs: &[Program], cases: &mut [Case]) -> (Vec<f64>, Vec<Vec<f64>>) {
    let mut ours = vec![f64::INFINITY; cases.len()];
    let mut theirs = vec![ours.clone(); programs.len()];
    let input = foreign::write_inputs();
    for _ in 0..TURNS {
        for (case, least) in cases.iter_mut().zip(&mut ours) {
            let [times] = in_turn(FOREIGN_ROUNDS, Clock::Wall, [&mut || case.run()]);
            *least = least.min(each(times.least()));
        }
        for (program, theirs) in programs.iter().zip(&mut theirs) {
            for found in program.run(&input) {
                let number = cases.iter().position(|case| case.name == found.name);
                let number = number.expect("a kernel of ours");
                assert_same(&found.name, cases[number].sums(), found.sums);
                theirs[number] = theirs[number].min(found.least);
            }
        }
    }
    (ours, theirs)
}

fn all_cases() -> Vec<Case> {
    vec![
        Case::new::<Linear, 3, 1>(),
        Case::new::<Quadratic, 3, 1>(),
        Case::new::<Power, 3, 1>(),
        Case::new::<Logarithm, 3, 1>(),
        Case::new::<Linear, 6, 2>(),
        Case::new::<Quadratic, 6, 2>(),
        Case::new::<Power, 6, 2>(),
        Case::new::<Logarithm, 6, 2>(),
        Case::new::<Linear, 9, 3>(),
        Case::new::<Quadratic, 9, 3>(),
        Case::new::<Power, 9, 3>(),
        Case::new::<Logarithm, 9, 3>(),
    ]
}
