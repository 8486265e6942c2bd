//! Two threads against one.

use piola_compiler::Measure;
use piola_runtime::deformation::Discretisation;
use piola_runtime::energy::{Energy, Hessian, Wanted};
use piola_runtime::matrix::BlockMatrix;
use rayon::ThreadPool;

use crate::clock::{Clock, in_turn, thread_time};
use crate::families::correspondence;
use crate::ours::{SethHill, cube, displacement_at};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 9;

/// What two threads are held to.
const BAR: Bar = Bar::AtLeast(1.75, 1.9);

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "threads",
        "Passes over bodies of n = 1, horizon 3, and over St Venant-Kirchhoff material at bonds (BAQP); tangents with \
         their gradients, forces alone, products with a Hessian that is not stored; runs in turn. The second row of \
         each counts processor time, of the one thread and of the busier of the two: what the balance of the load \
         allows, however busy the machine is.",
        ["2 threads, s", "1 thread, s"],
        Division::TheirsByOurs,
    );
    let cliques =
        |points: usize, measure: Measure| SethHill::new(1.0).energy(&cube(points), 3.0, &[measure]);
    let tangent = |table: &mut Table, what: &str, energy: &dyn Energy| {
        measure(table, what, energy, Pass::Tangent);
    };
    tangent(&mut table, "tangent of bonds, 30^3 points", &cliques(30, Measure::Length));
    let triangles = cliques(30, Measure::Area);
    tangent(&mut table, "tangent of triangles, 30^3 points", &triangles);
    measure(&mut table, "forces of triangles, 30^3 points", &triangles, Pass::Forces);
    measure(&mut table, "product of triangles, 30^3 points", &triangles, Pass::Product);
    let tetrahedra = cliques(16, Measure::Volume);
    tangent(&mut table, "tangent of tetrahedra, 16^3 points", &tetrahedra);
    measure(&mut table, "forces of tetrahedra, 16^3 points", &tetrahedra, Pass::Forces);
    let bonds = cliques(40, Measure::Length);
    measure(&mut table, "forces of bonds, 40^3 points", &bonds, Pass::Forces);
    measure(&mut table, "product of bonds, 40^3 points", &bonds, Pass::Product);
    let at_bonds = correspondence(&cube(20), Discretisation::BondQuadrature);
    measure(&mut table, "forces of BAQP, 20^3 points", &at_bonds, Pass::Forces);
    measure(&mut table, "product of BAQP, 20^3 points", &at_bonds, Pass::Product);
    vec![table]
}

/// What is asked of an energy.
#[derive(Clone, Copy)]
enum Pass {
    Forces,
    Product,
    Tangent,
}

fn measure(table: &mut Table, what: &str, energy: &dyn Energy, pass: Pass) {
    let u = displacement_at(energy.positions());
    let mut runs = [1, 2].map(|threads| Run::new(threads, energy, &u, pass));
    let [one, two] = &mut runs;
    let [alone, both] = in_turn(ROUNDS, Clock::Wall, [&mut || one.go(), &mut || two.go()]);
    assert!(one.found() == two.found(), "the same bits for any number of threads");
    let (alone, both) = (alone.least(), both.least());
    let of = Statistic::Least(ROUNDS);
    table.ratio(what, [both, alone], of, BAR);
    if let (Some(alone), Some(both)) = (one.busiest(), two.busiest()) {
        table.ratio(format!("{what}, processor time"), [both, alone], of, Bar::None);
    }
}

/// A pass by a number of threads.
struct Run<'a> {
    pool: ThreadPool,
    energy: &'a dyn Energy,
    hessian: Option<Box<dyn Hessian + 'a>>,
    u: &'a [f64],
    vector: Vec<f64>,
    tangent: Option<BlockMatrix>,
    /// Processor time of the busiest thread in each run, in s.
    busiest: Vec<f64>,
}

impl<'a> Run<'a> {
    fn new(threads: usize, energy: &'a dyn Energy, u: &'a [f64], pass: Pass) -> Run<'a> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let hessian = matches!(pass, Pass::Product)
            .then(|| energy.hessian(u).expect("second derivatives are finite"));
        let tangent = matches!(pass, Pass::Tangent).then(|| BlockMatrix::zeros(energy.pattern()));
        Run {
            pool: pool.expect("threads can be started"),
            energy,
            hessian,
            u,
            vector: vec![0.0; u.len()],
            tangent,
            busiest: Vec::new(),
        }
    }

    fn go(&mut self) {
        let before = self.pool.broadcast(|_| thread_time());
        let Run { pool, energy, hessian, u, vector, tangent, .. } = self;
        let hessian = hessian.as_deref();
        pool.install(|| match (hessian, tangent) {
            (Some(hessian), _) => hessian.multiply(u, vector),
            (None, Some(tangent)) => {
                energy.tangent(u, vector, tangent).expect("all is finite");
            }
            (None, None) => {
                energy.evaluate(u, Wanted::Forces(vector), &mut []).expect("all is finite");
            }
        });
        let after = self.pool.broadcast(|_| thread_time());
        let taken =
            before.iter().zip(&after).filter_map(|(before, after)| Some((*after)? - (*before)?));
        self.busiest.push(taken.fold(0.0, f64::max));
    }

    fn found(&self) -> (&[f64], Option<&[f64]>) {
        (&self.vector, self.tangent.as_ref().map(|tangent| &tangent.values[..]))
    }

    /// The least of the busiest threads' times, where the system tells.
    fn busiest(&self) -> Option<f64> {
        let least = self.busiest.iter().copied().fold(f64::INFINITY, f64::min);
        (least > 0.0 && least.is_finite()).then_some(least)
    }
}
