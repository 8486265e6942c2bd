//! Forces of bonds, triangles and tetrahedra alone, against loops by hand; products with the Hessian that is not
//! stored, against those with the stored one.

mod cliques;

use std::sync::Arc;

use piola_compiler::{Level, Measure};
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::element::MeasureElement;
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::weights::Weights;

use crate::assembly::assert_close;
use crate::clock::{Clock, in_turn};
use crate::motion::shaken;
use crate::ours::{SethHill, cube, discrete, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 15;
pub(crate) const HORIZON: f64 = 3.0;

pub(crate) fn run() -> Vec<Table> {
    let mut forces = Table::of_ratios(
        "forces",
        "Forces of bonds alone, from displacements, per bond (each once), horizon 3, one thread; runs in turn. In runs: \
         bonds that repeat from point to point, the law in registers. In fours: those of a cloud, the points of the \
         lattice moved by up to a thousandth of a spacing. In batches: compiled kernels. Theirs: a scalar \
         loop by hand for this one law over each owner's later neighbours, with lengths at rest that it keeps.",
        ["ours, ns", "by hand, ns"],
        Division::OursByTheirs,
    );
    let mut products = Table::of_ratios(
        "products-not-stored",
        "Products with the Hessian that is not stored, of bonds and triangles of 20^3 points, per one of them, and of \
         tetrahedra of 12^3 points; horizon 3, one thread; runs in turn. Theirs: products with the stored one.",
        ["ours, ns", "stored, ns"],
        Division::OursByTheirs,
    );
    with_threads(1, || {
        for points in [14, 40] {
            let [true_bar, modified_bar] = match points {
                40 => [Bar::AtMost(0.5, 0.3), Bar::AtMost(0.6, 0.4)],
                _ => [Bar::AtMost(0.8, 0.55); 2],
            };
            let laws = [
                (SethHill::new(1.0), "true stretch", true_bar, by_length as Loop),
                (SethHill::new(2.0), "modified stretch", modified_bar, by_square),
            ];
            for (law, name, bar, by_hand) in laws {
                compare(&mut forces, &cube(points), (name, "runs", bar), &law, by_hand);
                let (body, bar) = (shaken(points), Bar::AtMost(0.8, 0.55));
                let name = format!("{name}, cloud");
                compare(&mut forces, &body, (&name, "fours", bar), &law, by_hand);
            }
        }
        for (name, points, n, measure) in [
            ("bonds, true stretch", 20, 1.0, Measure::Length),
            ("bonds, modified stretch", 20, 2.0, Measure::Length),
            ("triangles", 20, 1.0, Measure::Area),
            ("triangles, by the square", 20, 2.0, Measure::Area),
            ("tetrahedra", 12, 1.0, Measure::Volume),
        ] {
            multiply(&mut products, name, points, (&SethHill::new(n), measure));
        }
    });
    let [of_triangles, of_tetrahedra] = with_threads(1, cliques::run);
    vec![forces, of_triangles, of_tetrahedra, products]
}

/// In runs, and in batches of the same kernels.
fn both_ways(law: &SethHill, body: &Arc<Body>, measure: Measure) -> [DiscreteEnergy; 2] {
    [Level::Fast, Level::Strict].map(|level| {
        discrete(body, HORIZON, Weights::Unit, &[measure], |measure| {
            Box::new(MeasureElement::new(measure, 3, Box::new(law.kernel_at(level, measure))))
        })
    })
}

/// Bonds with their lengths at rest.
pub(crate) struct ByHand {
    positions: Vec<[f64; 3]>,
    start: Vec<usize>,
    pub(crate) others: Vec<u32>,
    lengths: Vec<f64>,
}

impl ByHand {
    pub(crate) fn new(body: &Body) -> ByHand {
        let lists = Neighborhood::new(body, HORIZON).expect("a cube has neighbours");
        let positions = body.positions().as_chunks::<3>().0.to_vec();
        let mut all = ByHand { positions, start: vec![0], others: Vec::new(), lengths: Vec::new() };
        for i in 0..body.n_points() {
            for j in lists.upper(i) {
                let (x, y) = (all.positions[i], all.positions[j as usize]);
                let square: f64 =
                    (0..3).map(|axis| (y[axis] - x[axis]) * (y[axis] - x[axis])).sum();
                all.lengths.push(square.sqrt());
                all.others.push(j);
            }
            all.start.push(all.others.len());
        }
        all
    }

    /// `pull` is the force over the current vector, from `l^2 - L^2`, `l^2` and `L`.
    #[inline(always)]
    fn forces(&self, u: &[[f64; 3]], out: &mut [[f64; 3]], pull: impl Fn(f64, f64, f64) -> f64) {
        out.fill([0.0; 3]);
        for i in 0..self.positions.len() {
            let (at_rest, moved) = (self.positions[i], u[i]);
            let mut sum = [0.0; 3];
            for bond in self.start[i]..self.start[i + 1] {
                let j = self.others[bond] as usize;
                let (other, its) = (&self.positions[j], &u[j]);
                let (mut x, mut grown, mut square) = ([0.0; 3], 0.0, 0.0);
                for axis in 0..3 {
                    let (xi, eta) = (other[axis] - at_rest[axis], its[axis] - moved[axis]);
                    x[axis] = xi + eta;
                    grown += eta * (xi + x[axis]);
                    square += x[axis] * x[axis];
                }
                let pull = pull(grown, square, self.lengths[bond]);
                for axis in 0..3 {
                    let part = pull * x[axis];
                    out[j][axis] += part;
                    sum[axis] += part;
                }
            }
            for axis in 0..3 {
                out[i][axis] -= sum[axis];
            }
        }
    }
}

/// `psi = 1/2 L (l/L - 1)^2`.
pub(crate) fn by_length(bonds: &ByHand, u: &[[f64; 3]], out: &mut [[f64; 3]]) {
    bonds.forces(u, out, |grown, square, at_rest| {
        let length = square.sqrt();
        grown / (at_rest * (length + at_rest) * length)
    });
}

/// `psi = 1/2 L ((l^2/L^2 - 1)/2)^2`.
pub(crate) fn by_square(bonds: &ByHand, u: &[[f64; 3]], out: &mut [[f64; 3]]) {
    bonds.forces(u, out, |grown, _, at_rest| 0.5 * grown / (at_rest * at_rest * at_rest));
}

pub(crate) type Loop = fn(&ByHand, &[[f64; 3]], &mut [[f64; 3]]);

fn compare(
    table: &mut Table,
    body: &Arc<Body>,
    (name, way, bar): (&str, &str, Bar),
    law: &SethHill,
    by_hand: Loop,
) {
    let [in_runs, in_batches] = both_ways(law, body, Measure::Length);
    assert_eq!(in_runs.report().ways, [if way == "runs" { "rows" } else { way }], "the way");
    let u = displacement(body);
    let rows = u.as_chunks::<3>().0;
    let bonds = ByHand::new(body);
    let times = in_three_ways([&in_runs, &in_batches], &u, |out| by_hand(&bonds, rows, out));
    let count = bonds.others.len() as f64;
    let [runs, batches, theirs] = times.map(|seconds| seconds / count * 1e9);
    let thousands = (count / 1e3).round();
    let of = Statistic::Least(ROUNDS);
    let what = |way: &str| format!("{name}, {thousands} thousand bonds, in {way}");
    table.ratio(what(way), [runs, theirs], of, bar);
    table.ratio(what("batches"), [batches, theirs], of, Bar::None);
}

/// The forces of both energies and of a loop by hand, which are the same to rounding; s each takes at least.
fn in_three_ways(
    energies: [&DiscreteEnergy; 2],
    u: &[f64],
    mut by_hand: impl FnMut(&mut [[f64; 3]]),
) -> [f64; 3] {
    let mut theirs = vec![[0.0; 3]; u.len() / 3];
    let mut ours = [vec![0.0; u.len()], vec![0.0; u.len()]];
    let [first, second] = &mut ours;
    let forces = |energy: &DiscreteEnergy, out: &mut [f64]| {
        energy.evaluate(u, Wanted::Forces(out), &mut []).expect("all is finite");
    };
    let times = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || forces(energies[0], first), &mut || forces(energies[1], second), &mut || {
            by_hand(&mut theirs)
        }],
    );
    for ours in &ours {
        assert_close("forces", ours, theirs.as_flattened());
    }
    times.map(|times| times.least())
}

fn multiply(table: &mut Table, name: &str, points: usize, (law, measure): (&SethHill, Measure)) {
    let body = cube(points);
    let [in_runs, in_batches] = both_ways(law, &body, measure);
    let u = displacement(&body);
    let p: Vec<f64> = u.iter().rev().copied().collect();
    let (mut gradient, mut tangent) = (vec![0.0; u.len()], BlockMatrix::zeros(in_runs.pattern()));
    in_runs.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    let hessians = [&in_runs, &in_batches].map(|energy| energy.hessian(&u).expect("it is finite"));
    let mut ours = [vec![0.0; u.len()], vec![0.0; u.len()]];
    let [first, second] = &mut ours;
    let mut theirs = vec![0.0; u.len()];
    let slabs = tangent.pattern.slabs();
    let times = in_turn(
        ROUNDS,
        Clock::Wall,
        [
            &mut || hessians[0].multiply(&p, first),
            &mut || hessians[1].multiply(&p, second),
            &mut || tangent.multiply_into(&slabs, &p, &mut theirs),
        ],
    );
    for ours in &ours {
        assert_close(name, ours, &theirs);
    }
    let counts = in_runs.report();
    let count = match measure {
        Measure::Length => counts.bonds,
        Measure::Area => counts.triangles,
        Measure::Volume => counts.tetrahedra,
    } as f64;
    let [runs, batches, theirs] = times.map(|times| times.least() / count * 1e9);
    let of = Statistic::Least(ROUNDS);
    table.ratio(format!("{name}, in runs"), [runs, theirs], of, Bar::None);
    table.ratio(format!("{name}, in batches"), [batches, theirs], of, Bar::None);
}
