//! Two threads against one.

use piola_compiler::Measure;
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use rayon::ThreadPool;

use crate::clock::{Clock, in_turn, thread_time};
use crate::ours::{SethHill, cube, displacement};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 9;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "threads",
        "Assembled gradient and tangent, horizon 3; runs in turn. The second row of a body counts \
         processor time, of the one thread and of the busier of the two: what the balance of the load allows, \
         however busy the machine is.",
        ["2 threads, s", "1 thread, s"],
        Division::TheirsByOurs,
    );
    measure(&mut table, "triangles, 30^3 points", 30, Measure::Area);
    measure(&mut table, "tetrahedra, 16^3 points", 16, Measure::Volume);
    vec![table]
}

fn measure(table: &mut Table, what: &str, points: usize, measure: Measure) {
    let body = cube(points);
    let u = displacement(&body);
    let energy = SethHill::new(1.0).energy(&body, 3.0, &[measure]);
    let mut runs = [1, 2].map(|threads| Run::new(threads, &energy, &u));
    let [one, two] = &mut runs;
    let [alone, both] =
        in_turn(ROUNDS, Clock::Wall, [&mut || one.tangent(), &mut || two.tangent()]);
    assert!(one.tangent.values == two.tangent.values, "the same bits for any number of threads");
    let bar = Bar::AtLeast(1.8, 1.95);
    let (alone, both) = (alone.least(), both.least());
    let of = Statistic::Least(ROUNDS);
    table.ratio(what, [both, alone], of, bar);
    if let (Some(alone), Some(both)) = (one.busiest(), two.busiest()) {
        table.ratio(format!("{what}, processor time"), [both, alone], of, Bar::None);
    }
}

/// Assembly by a number of threads.
struct Run<'a> {
    pool: ThreadPool,
    energy: &'a DiscreteEnergy,
    u: &'a [f64],
    gradient: Vec<f64>,
    tangent: BlockMatrix,
    /// Processor time of the busiest thread in each run, in s.
    busiest: Vec<f64>,
}

impl<'a> Run<'a> {
    fn new(threads: usize, energy: &'a DiscreteEnergy, u: &'a [f64]) -> Run<'a> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        Run {
            pool: pool.expect("threads can be started"),
            energy,
            u,
            gradient: vec![0.0; u.len()],
            tangent: BlockMatrix::zeros(energy.pattern()),
            busiest: Vec::new(),
        }
    }

    fn tangent(&mut self) {
        let before = self.pool.broadcast(|_| thread_time());
        let (u, energy) = (self.u, self.energy);
        let (gradient, tangent) = (&mut self.gradient, &mut self.tangent);
        self.pool.install(|| energy.tangent(u, gradient, tangent)).expect("all is finite");
        let after = self.pool.broadcast(|_| thread_time());
        let taken =
            before.iter().zip(&after).filter_map(|(before, after)| Some((*after)? - (*before)?));
        self.busiest.push(taken.fold(0.0, f64::max));
    }

    /// The least of the busiest threads' times, where the system tells.
    fn busiest(&self) -> Option<f64> {
        let least = self.busiest.iter().copied().fold(f64::INFINITY, f64::min);
        (least > 0.0 && least.is_finite()).then_some(least)
    }
}
