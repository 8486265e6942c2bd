//! Assembly of bonds against the time that the memory takes for the matrix alone.

use piola_compiler::Measure;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use rayon::prelude::*;

use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 9;
/// Numbers in each array of the triad: 64 MB, more than the caches hold.
const TRIAD: usize = 1 << 23;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "bonds",
        "Gradient and tangent of bonds, n = 1, 30^3 points, horizon 3, against the bytes of the matrix over the \
         bandwidth of a triad `a = b + s*c` (24 bytes an entry) on as many threads; time on the wall, \
         runs in turn.",
        ["ours, ms", "memory, ms"],
        Division::OursByTheirs,
    );
    for threads in [1, 2] {
        with_threads(threads, || compare(&mut table, threads));
    }
    vec![table]
}

fn compare(table: &mut Table, threads: usize) {
    let body = cube(30);
    let u = displacement(&body);
    let energy = SethHill::new(1.0).energy(&body, 3.0, &[Measure::Length]);
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let bytes = size_of_val(tangent.values.as_slice()) as f64;
    let mut ours = || {
        energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    };
    let mut arrays = [vec![0.0; TRIAD], vec![1.0; TRIAD], vec![2.0; TRIAD]];
    let mut theirs = || triad(&mut arrays, threads);
    let [ours, theirs] = in_turn(ROUNDS, Clock::Wall, [&mut ours, &mut theirs]);
    let bandwidth = 24.0 * TRIAD as f64 / theirs.least();
    let (ours, bound) = (ours.least() * 1e3, bytes / bandwidth * 1e3);
    let what = format!("{threads} thread(s), {:.1} GB/s", bandwidth * 1e-9);
    let bar = if threads == 1 { Bar::AtMost(3.5, 2.5) } else { Bar::AtMost(3.0, 2.0) };
    table.ratio(what, [ours, bound], Statistic::Least(ROUNDS), bar);
}

fn triad([a, b, c]: &mut [Vec<f64>; 3], threads: usize) {
    let size = TRIAD / threads;
    let parts = a.par_chunks_mut(size).zip(b.par_chunks(size)).zip(c.par_chunks(size));
    parts.for_each(|((a, b), c)| {
        for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
            *a = b + 3.0 * c;
        }
    });
}
