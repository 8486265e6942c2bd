//! Bodies that break by what points gather: every list against a loop over what is left, and the account of
//! energy.

use std::collections::BTreeSet;
use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::Criteria;
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture, Inspection};
use piola_runtime::kernel::{Law, VariablesLaw};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings};
use piola_runtime::states::{GatheredCriterion, StateEnergy, StateLaws};

use crate::Conditions;
use crate::bonds::{Random, cloud, norm};
use crate::reference::go;

/// Above these break all bonds of a point, by its dilatation, and a bond, by its stretch beyond that of an end.
const LIMITS: [f64; 2] = [0.35, 0.2];

const STEPS: usize = 90;

/// An ordinary state-based body; nothing breaks with one of the points that are kept.
fn breaking((body, horizon): &(Arc<Body>, f64), level: Level, kept: &[usize]) -> Breaking {
    let d = body.dimension();
    let [volume, beyond] = LIMITS;
    let text = format!(
        "potential p\nm = integral(L^2)\ntheta = {d}/m*integral(L*(l - L))\npsi(theta) = 60*theta^2\n\
         psi(l, m) = 300/m*(l - L)^2\nbreak when theta > {volume}\n\
         break when l/L - 1 - theta/{d} > {beyond} and l > L\n"
    );
    let (_, model) = check_text(&text).unwrap();
    let values = model.values(d, &[], Some(*horizon)).unwrap();
    let mode = Mode::Jit(level);
    let kernels = model.compile(&values, mode, Form::Accurate).unwrap().gathered.unwrap();
    let laws = StateLaws {
        of_law: Vec::new(),
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        points: kernels.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        bonds: kernels.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        arguments: ["theta", "l, m"].map(String::from),
    };
    let found = model.gathered_criteria(&values, mode, Form::Accurate).unwrap();
    let criterion = |(number, one): (usize, piola_compiler::GatheredCriterion)| {
        let (of_bonds, holds_at_zero) = (one.margin.of_bonds(), one.holds_at_zero);
        let margin = Box::new(one.margin);
        GatheredCriterion { layer: 0, law: 0, number, of_bonds, margin, holds_at_zero }
    };
    let criteria = found.into_iter().enumerate().map(criterion).collect();
    let energy = StateEnergy::new(Arc::clone(body), *horizon, laws).unwrap();
    let energy = energy.with_criteria(criteria);
    let neighborhood = Arc::new(Neighborhood::new(body, *horizon).unwrap());
    let is_kept = (0..body.n_points()).map(|point| kept.contains(&point)).collect();
    let nothing = (Criteria::new((body, &neighborhood), Vec::new(), is_kept), Memory::default());
    let names = Arc::clone(energy.parts());
    Breaking::new((Arc::clone(body), neighborhood), vec![Box::new(energy)], names, nothing, vec![])
}

/// What of a body is left, judged by loops.
struct Judge<'a> {
    body: &'a Body,
    bonds: Vec<[usize; 2]>,
    broken: BTreeSet<usize>,
    kept: &'a [usize],
}

impl<'a> Judge<'a> {
    fn new((body, horizon): &'a (Arc<Body>, f64), kept: &'a [usize]) -> Judge<'a> {
        let n = body.n_points();
        let pairs = (0..n).flat_map(|p| (p + 1..n).map(move |q| [p, q]));
        let mut judge = Judge { body, bonds: Vec::new(), broken: BTreeSet::new(), kept };
        let rest = vec![0.0; body.positions().len()];
        let near = |ends: &[usize; 2]| judge.length(&rest, *ends) <= horizon * (1.0 + 1e-9);
        judge.bonds = pairs.filter(near).collect();
        judge
    }

    fn length(&self, u: &[f64], [p, q]: [usize; 2]) -> f64 {
        let d = self.body.dimension();
        let x = |point: usize, axis: usize| self.body.position(point)[axis] + u[point * d + axis];
        norm(&(0..d).map(|axis| x(q, axis) - x(p, axis)).collect::<Vec<f64>>())
    }

    fn dilatation(&self, u: &[f64], point: usize) -> f64 {
        let (mut m, mut sum, rest) = (0.0, 0.0, vec![0.0; u.len()]);
        for (bond, ends) in self.bonds.iter().enumerate() {
            if ends.contains(&point) && !self.broken.contains(&bond) {
                let other = if ends[0] == point { ends[1] } else { ends[0] };
                let (now, before) = (self.length(u, *ends), self.length(&rest, *ends));
                m += self.body.volumes()[other] * before * before;
                sum += self.body.volumes()[other] * before * (now - before);
            }
        }
        if m > 0.0 { self.body.dimension() as f64 / m * sum } else { 0.0 }
    }

    /// What is left, with the largest margin over its amount at rest that judges each bond.
    fn margins(&self, u: &[f64]) -> Vec<(usize, f64)> {
        let theta: Vec<f64> = (0..self.body.n_points()).map(|p| self.dilatation(u, p)).collect();
        let (d, rest) = (self.body.dimension() as f64, vec![0.0; u.len()]);
        let margin = |ends: [usize; 2]| {
            let (now, before) = (self.length(u, ends), self.length(&rest, ends));
            let of = |end: usize| {
                let volume = theta[end] / LIMITS[0] - 1.0;
                let beyond = now / before - 1.0 - theta[end] / d - LIMITS[1];
                volume.max(beyond.min(now - before) / LIMITS[1])
            };
            of(ends[0]).max(of(ends[1]))
        };
        let left = self.bonds.iter().enumerate().filter(|(bond, ends)| {
            !self.broken.contains(bond) && !ends.iter().any(|p| self.kept.contains(p))
        });
        left.map(|(bond, ends)| (bond, margin(*ends))).collect()
    }
}

fn bodies() -> [(Arc<Body>, f64); 2] {
    [(cloud(&[9, 6], 0.1, 5), 0.25), (cloud(&[5, 4, 3], 0.1, 6), 0.2)]
}

#[test]
fn bonds_break_by_what_points_gather_as_loops_say() {
    let kept = [3, 4];
    for (number, case) in bodies().iter().enumerate() {
        let body = &case.0;
        let run = |threads: usize, level: Level| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = breaking(case, level, &kept);
                let mut judge = Judge::new(case, &kept);
                let loads = vec![0.0; body.positions().len()];
                let drive = Conditions { loads, ..Conditions::default() };
                let mut random = Random(9);
                let velocity = |x: &f64| 8.0 * x + 2.0 * random.next();
                let velocities = body.positions().iter().map(velocity).collect();
                let displacements = vec![0.0; body.positions().len()];
                let start = Initial { displacements, velocities };
                let dt = 1e-3;
                let settings = MotionSettings {
                    end: dt * STEPS as f64,
                    step: Some(dt),
                    rows: STEPS,
                    ..MotionSettings::default()
                };
                let watch = Watch::default();
                let made = Motion::new(&energy, body.volumes(), start, &drive, &settings, &watch);
                let mut motion = made.unwrap();
                let (mut worst, mut n_steps, mut rows) = (0.0_f64, 0, Vec::new());
                for step in 0..=STEPS {
                    let row = go(&mut motion, step);
                    let margins = judge.margins(motion.state().displacements);
                    let new = margins.iter().filter(|(_, margin)| *margin > 0.0).map(|one| one.0);
                    let new: Vec<usize> = new.collect();
                    n_steps += usize::from(!new.is_empty());
                    judge.broken.extend(new);
                    assert!(energy.broken().iter().eq(&judge.broken), "body {number}, step {step}");
                    let largest = row.kinetic.max(row.energy.total()).max(row.released.abs());
                    worst = worst.max(row.rounding.abs() / largest);
                    rows.push(row);
                }
                let (broken, all) = (judge.broken.len(), judge.bonds.len());
                println!("body {number}: {broken} of {all} in {n_steps} steps, {worst:e}");
                assert!(worst < 1e-12 && broken > 20 && broken < all && n_steps > 3);
                rows
            })
        };
        assert_eq!(run(1, Level::Fast), run(2, Level::Fast));
        run(1, Level::Strict);
    }
}

#[test]
fn the_foremost_of_what_is_gathered_goes_first() {
    for case in &bodies() {
        let kept = [3, 4];
        let energy = breaking(case, Level::Strict, &kept);
        let mut judge = Judge::new(case, &kept);
        let mut random = Random(21);
        let x = case.0.positions().iter();
        let u: Vec<f64> = x.map(|x| 0.05 * x + 0.01 * random.next()).collect();
        let tie = 1e-6;
        for round in 0..6 {
            let found = energy.foremost(&u, tie).unwrap().unwrap();
            let margins = judge.margins(&u);
            let most = margins.iter().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max);
            assert!((found.margin - most).abs() < 1e-10 * (1.0 + most.abs()), "{most}");
            let least = most - tie * (1.0 + most).abs();
            let first = margins.iter().filter(|(_, own)| *own >= least).map(|one| one.0);
            let first: Vec<usize> = first.collect();
            assert_eq!(found.which.bonds, first, "round {round}");
            energy.break_at(&u, &found.which).unwrap();
            judge.broken.extend(first);
        }
        // Of either end: its dilatation, and the stretch beyond it.
        assert_eq!(energy.look_at(0, &u).unwrap().margins.len(), 4);
    }
}
