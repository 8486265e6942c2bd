//! Steps in time against steps by hand, against the forces in them, and two threads against one.

use std::sync::Arc;
use std::time::Duration;

use piola_compiler::Measure;
use piola_runtime::body::Body;
use piola_runtime::deformation::Discretisation;
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::Advance;
use piola_runtime::solve::motion::{Initial, Motion, MotionDrive, MotionSettings};

use crate::assembly::assert_close;
use crate::clock::{Clock, in_turn};
use crate::families::{correspondence, solid};
use crate::forces::{ByHand, HORIZON, Loop, by_length, by_square};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 15;

/// Steps so short that no energy changes its cost on the way.
const STEP: f64 = 1e-4;

/// More steps than are made.
const STEPS: usize = 1_000_000;

pub(crate) fn run() -> Vec<Table> {
    let mut steps = Table::of_ratios(
        "steps",
        "A step of velocity Verlet per bond (each once): forces from displacements, velocities, displacements and the \
         account of energy in compensated sums, 40^3 points, horizon 3, one thread; runs in turn. Lattice: bonds that \
         repeat from point to point. Cloud: the same points moved by up to a thousandth of a spacing. Theirs: the \
         rule by hand on the scalar loop of the table of forces, without account and compensation.",
        ["ours, ns", "by hand, ns"],
        Division::OursByTheirs,
    );
    let mut over = Table::of_ratios(
        "steps-over-forces",
        "A step of velocity Verlet against one evaluation of its forces, 40^3 points for bonds, 20^3 for the others, \
         horizon 3 (3.015), one thread; runs in turn.",
        ["step, ms", "forces, ms"],
        Division::OursByTheirs,
    );
    let mut threads = Table::of_ratios(
        "steps-threads",
        "A step of velocity Verlet by two threads and by one, 40^3 points, horizon 3; runs in turn.",
        ["2 threads, ms", "1 thread, ms"],
        Division::TheirsByOurs,
    );
    let (lattice, cloud) = (cube(40), shaken(40));
    let laws = [("true stretch", 1.0, by_length as Loop), ("modified stretch", 2.0, by_square)];
    with_threads(1, || {
        for (name, n, by_hand) in laws {
            let law = SethHill::new(n);
            let bar = if n == 1.0 { Bar::AtMost(0.5, 0.3) } else { Bar::AtMost(0.6, 0.4) };
            let what = format!("{name}, lattice");
            by_rule(&mut steps, &mut over, (&what, bar), &lattice, &law, by_hand);
            let bar = if n == 1.0 { Bar::AtMost(0.8, 0.55) } else { Bar::AtMost(0.8, 0.5) };
            let what = format!("{name}, cloud");
            by_rule(&mut steps, &mut over, (&what, bar), &cloud, &law, by_hand);
        }
        let body = cube(20);
        let nodal = correspondence(&body, Discretisation::Nodal);
        let at_bonds = correspondence(&body, Discretisation::BondQuadrature);
        let lps = solid(&body);
        let families: [(&str, &dyn Energy); 3] =
            [("CC", &nodal), ("BAQP", &at_bonds), ("LPS", &lps)];
        for (name, energy) in families {
            over_forces(&mut over, name, energy);
        }
    });
    for (name, n, _) in laws {
        for (kind, body) in [("lattice", &lattice), ("cloud", &cloud)] {
            by_threads(&mut threads, &format!("{name}, {kind}"), body, &SethHill::new(n));
        }
    }
    vec![steps, over, threads]
}

/// A cube whose points are moved a little, so that no two bonds are alike.
pub(crate) fn shaken(n: usize) -> Arc<Body> {
    let body = cube(n);
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let positions: Vec<f64> = body.positions().iter().map(|x| x + 1e-3 * next()).collect();
    Arc::new(Body::new(3, &positions, body.volumes(), None))
}

/// Nothing is held and nothing pulls.
struct Free;

impl MotionDrive for Free {
    fn displaced(&self) -> &[usize] {
        &[]
    }

    fn displacements(&self, _: f64, _: &mut [f64]) {}

    fn driven(&self) -> &[usize] {
        &[]
    }

    fn velocities(&self, _: f64, _: &mut [f64]) {}

    fn loads(&self, _: f64, loads: &mut [f64]) {
        loads.fill(0.0);
    }

    fn loads_change(&self) -> bool {
        false
    }
}

/// A motion from some strain, that comes back after every step.
pub(crate) fn motion<'a>(energy: &'a dyn Energy, u: &[f64]) -> Motion<'a> {
    let settings = MotionSettings {
        end: STEP * STEPS as f64,
        step: Some(STEP),
        rows: 1,
        ..MotionSettings::default()
    };
    let start = Initial { displacements: u.to_vec(), velocities: vec![0.0; u.len()] };
    let masses = vec![1.0; u.len() / 3];
    let made = Motion::new(energy, &masses, start, &Free, &settings, &Watch::default());
    let mut motion = made.expect("a motion of small steps can start");
    motion.pause_every(Duration::ZERO);
    assert!(matches!(motion.advance_to(0), Ok(Advance::Step(_))), "the row of the start");
    step(&mut motion);
    motion
}

pub(crate) fn step(motion: &mut Motion<'_>) {
    let before = motion.step_reached();
    assert!(matches!(motion.advance_to(STEPS), Ok(Advance::Pause)), "it goes on");
    assert_eq!(motion.step_reached(), before + 1, "one step");
}

/// The rule by hand, with masses of 1.
struct Verlet<'a> {
    bonds: &'a ByHand,
    forces: Loop,
    u: Vec<[f64; 3]>,
    v: Vec<[f64; 3]>,
    gradient: Vec<[f64; 3]>,
}

impl<'a> Verlet<'a> {
    fn new(bonds: &'a ByHand, forces: Loop, u: &[f64]) -> Verlet<'a> {
        let u = u.as_chunks::<3>().0.to_vec();
        let (v, gradient) = (vec![[0.0; 3]; u.len()], vec![[0.0; 3]; u.len()]);
        let mut all = Verlet { bonds, forces, u, v, gradient };
        forces(bonds, &all.u, &mut all.gradient);
        all.kick(0.5);
        all
    }

    fn kick(&mut self, part: f64) {
        for (v, gradient) in self.v.as_flattened_mut().iter_mut().zip(self.gradient.as_flattened())
        {
            *v -= part * STEP * gradient;
        }
    }

    fn step(&mut self) {
        for (u, v) in self.u.as_flattened_mut().iter_mut().zip(self.v.as_flattened()) {
            *u += STEP * v;
        }
        (self.forces)(self.bonds, &self.u, &mut self.gradient);
        self.kick(1.0);
    }
}

fn by_rule(
    steps: &mut Table,
    over: &mut Table,
    (what, bar): (&str, Bar),
    body: &Arc<Body>,
    law: &SethHill,
    by_hand: Loop,
) {
    let energy = law.energy(body, HORIZON, &[Measure::Length]);
    let bonds = ByHand::new(body);
    let u = displacement(body);
    let mut ours = motion(&energy, &u);
    let mut theirs = Verlet::new(&bonds, by_hand, &u);
    theirs.step();
    let [ours_taken, theirs_taken] =
        in_turn(ROUNDS, Clock::Wall, [&mut || step(&mut ours), &mut || theirs.step()]);
    assert_close(what, displacements(&ours), theirs.u.as_flattened());
    let count = bonds.others.len() as f64;
    let [one, other] = [ours_taken, theirs_taken].map(|times| times.least() / count * 1e9);
    let of = Statistic::Least(ROUNDS);
    let thousands = (count / 1e3).round();
    steps.ratio(format!("{what}, {thousands} thousand bonds"), [one, other], of, bar);
    over_forces(over, what, &energy);
}

fn displacements<'m>(motion: &'m Motion<'_>) -> &'m [f64] {
    piola_runtime::solve::march::March::state(motion).displacements
}

fn over_forces(table: &mut Table, what: &str, energy: &dyn Energy) {
    let u: Vec<f64> = energy.positions().iter().map(|x| 0.01 * x).collect();
    let mut moving = motion(energy, &u);
    let mut forces = vec![0.0; u.len()];
    let mut evaluate =
        || energy.evaluate(&u, Wanted::Forces(&mut forces), &mut []).expect("all is finite");
    let times = in_turn(ROUNDS, Clock::Wall, [&mut || step(&mut moving), &mut evaluate]);
    let [ours, theirs] = times.map(|times| times.least() * 1e3);
    table.ratio(what, [ours, theirs], Statistic::Least(ROUNDS), Bar::AtMost(1.15, 1.05));
}

fn by_threads(table: &mut Table, what: &str, body: &Arc<Body>, law: &SethHill) {
    let energy = law.energy(body, HORIZON, &[Measure::Length]);
    let u = displacement(body);
    let pools = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads can be started")
    });
    let [mut one, mut two] = [0, 1].map(|k| pools[k].install(|| motion(&energy, &u)));
    let [alone, both] = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || pools[0].install(|| step(&mut one)), &mut || pools[1].install(|| step(&mut two))],
    );
    assert!(displacements(&one) == displacements(&two), "the same bits for any number of threads");
    let [both, alone] = [both, alone].map(|times| times.least() * 1e3);
    table.ratio(what, [both, alone], Statistic::Least(ROUNDS), Bar::AtLeast(1.7, 1.85));
}
