//! Bodies that break by deformation gradients, those of bonds or those of points: every list against a loop over
//! what is left, the account of energy, threads, and attempts that are taken back.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::DMatrix;
use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, GradientCriterion, OperatorOrder, Stabilisation};
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::Criteria;
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture, Inspection, Interactions};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings};

use crate::Conditions;
use crate::bonds::{Random, cloud, lattice, norm};
use crate::families;
use crate::reference::go;

/// Above these `J - 1` and `E : E` break bonds.
const LIMITS: [f64; 2] = [0.15, 0.02];

const KINDS: [Discretisation; 3] = [
    Discretisation::Nodal,
    Discretisation::Stabilised(Stabilisation::Wan),
    Discretisation::BondQuadrature,
];

const STEPS: usize = 90;

/// What breaks by gradients of a kind; nothing with one of the points that are kept.
fn breaking(
    (body, horizon): &(Arc<Body>, f64),
    kind: Discretisation,
    level: Level,
    kept: &[usize],
) -> Breaking {
    let [volume, strain] = LIMITS;
    let text = format!(
        "potential p\npsi(F) = tr(E)^2\nbreak when J - 1 > {volume}\nbreak when E : E > {strain}"
    );
    let (_, model) = check_text(&text).unwrap();
    let values = model.values(body.dimension(), &[], Some(*horizon)).unwrap();
    let found = model.gradient_criteria(&values, Mode::Jit(level), Form::Accurate).unwrap();
    let criterion = |(number, one): (usize, piola_compiler::GradientCriterion)| {
        let (margin, holds_at_zero) = (Box::new(one.margin), one.holds_at_zero);
        GradientCriterion { layer: 0, law: 0, number, margin, holds_at_zero }
    };
    let criteria = found.into_iter().enumerate().map(criterion).collect();
    let energy = families::energy(body, *horizon, OperatorOrder::First, kind, "one");
    let energy = energy.with_criteria(criteria);
    let neighborhood = Arc::new(Neighborhood::new(body, *horizon).unwrap());
    let is_kept = (0..body.n_points()).map(|point| kept.contains(&point)).collect();
    let nothing = (Criteria::new((body, &neighborhood), Vec::new(), is_kept), Memory::default());
    let names = Arc::clone(energy.parts());
    Breaking::new((Arc::clone(body), neighborhood), vec![Box::new(energy)], names, nothing, vec![])
}

/// What of a body is left, judged by loops over dense matrices.
struct Judge<'a> {
    body: &'a Body,
    at_bonds: bool,
    bonds: Vec<[usize; 2]>,
    broken: BTreeSet<usize>,
    kept: &'a [usize],
}

impl<'a> Judge<'a> {
    fn new((body, horizon): &'a (Arc<Body>, f64), at_bonds: bool, kept: &'a [usize]) -> Judge<'a> {
        let n = body.n_points();
        let pairs = (0..n).flat_map(|p| (p + 1..n).map(move |q| [p, q]));
        let near = |[p, q]: &[usize; 2]| {
            let x = |axis: usize| body.position(*q)[axis] - body.position(*p)[axis];
            norm(&(0..body.dimension()).map(x).collect::<Vec<f64>>()) <= horizon * (1.0 + 1e-9)
        };
        let bonds = pairs.filter(near).collect();
        Judge { body, at_bonds, bonds, broken: BTreeSet::new(), kept }
    }

    fn along(&self, x: &[f64], [p, q]: [usize; 2]) -> DMatrix<f64> {
        let d = self.body.dimension();
        DMatrix::from_fn(d, 1, |axis, _| x[q * d + axis] - x[p * d + axis])
    }

    /// `F - I` of a point by what is left of its family; nothing where that determines none.
    fn of_point(&self, u: &[f64], point: usize) -> Option<DMatrix<f64>> {
        let d = self.body.dimension();
        let (mut shape, mut moved) = (DMatrix::zeros(d, d), DMatrix::zeros(d, d));
        for (bond, ends) in self.bonds.iter().enumerate() {
            if ends.contains(&point) && !self.broken.contains(&bond) {
                let other = if ends[0] == point { ends[1] } else { ends[0] };
                let of = |x: &[f64]| self.along(x, [point, other]);
                let (dx, volume) = (of(self.body.positions()), self.body.volumes()[other]);
                shape += volume * (&dx * dx.transpose());
                moved += volume * (of(u) * dx.transpose());
            }
        }
        let values = shape.clone().symmetric_eigenvalues();
        (values.min() > 1e-10 * values.max()).then(|| moved * shape.try_inverse().unwrap())
    }

    /// The largest margin of a gradient over its amount at rest.
    fn margin(&self, h: &DMatrix<f64>) -> f64 {
        let f = DMatrix::identity(h.nrows(), h.nrows()) + h;
        let e = 0.5 * (f.transpose() * &f - DMatrix::identity(h.nrows(), h.nrows()));
        let margins = [f.determinant() - 1.0, e.dot(&e)].into_iter().zip(LIMITS);
        margins.map(|(x, limit)| x / limit - 1.0).fold(f64::NEG_INFINITY, f64::max)
    }

    /// What is left, with the largest margin that judges each bond.
    fn margins(&self, u: &[f64]) -> Vec<(usize, f64)> {
        let points: Vec<_> = (0..self.body.n_points()).map(|p| self.of_point(u, p)).collect();
        let margin = |ends: [usize; 2]| -> f64 {
            if !self.at_bonds {
                let of = |end: &usize| points[*end].as_ref().map(|h| self.margin(h));
                return ends.iter().filter_map(of).fold(f64::NEG_INFINITY, f64::max);
            }
            let rest = || DMatrix::zeros(self.body.dimension(), self.body.dimension());
            let of = |end: usize| points[end].clone().unwrap_or_else(rest);
            let mean = 0.5 * (of(ends[0]) + of(ends[1]));
            let (dx, eta) = (self.along(self.body.positions(), ends), self.along(u, ends));
            let missing = eta - &mean * &dx;
            self.margin(&(mean + missing * dx.transpose() / dx.norm_squared()))
        };
        let left = self.bonds.iter().enumerate().filter(|(bond, ends)| {
            !self.broken.contains(bond) && !ends.iter().any(|p| self.kept.contains(p))
        });
        left.map(|(bond, ends)| (bond, margin(*ends))).collect()
    }
}

fn bodies() -> [(Arc<Body>, f64); 3] {
    [
        (cloud(&[9, 6], 0.1, 5), 0.25),
        (cloud(&[5, 4, 3], 0.1, 6), 0.2),
        (lattice(&[0.0, 0.0], &[11, 6], 0.1), 0.25),
    ]
}

/// From the middle outwards and about.
fn start(body: &Body) -> Initial {
    let mut random = Random(9);
    let velocity = |x: &f64| 8.0 * x + 2.0 * random.next();
    let velocities = body.positions().iter().map(velocity).collect();
    Initial { displacements: vec![0.0; body.positions().len()], velocities }
}

fn settings() -> MotionSettings {
    let dt = 1e-3;
    MotionSettings {
        end: dt * STEPS as f64,
        step: Some(dt),
        rows: STEPS,
        ..MotionSettings::default()
    }
}

#[test]
fn bonds_break_by_gradients_as_loops_say_and_the_account_closes() {
    let kept = [3, 4];
    for (number, case) in bodies().iter().enumerate() {
        for kind in KINDS {
            let (body, at_bonds) = (&case.0, kind == Discretisation::BondQuadrature);
            let energy = breaking(case, kind, Level::Fast, &kept);
            let mut judge = Judge::new(case, at_bonds, &kept);
            assert_eq!(energy.counts(), [judge.bonds.len(), 0]);
            let masses: Vec<f64> = body.volumes().to_vec();
            let loads = vec![0.0; body.positions().len()];
            let drive = Conditions { loads, ..Conditions::default() };
            let (watch, settings) = (Watch::default(), settings());
            let mut motion =
                Motion::new(&energy, &masses, start(body), &drive, &settings, &watch).unwrap();
            let (mut worst, mut n_steps) = (0.0_f64, 0);
            for step in 0..=STEPS {
                let row = go(&mut motion, step);
                let margins = judge.margins(motion.state().displacements);
                let new = margins.iter().filter(|(_, margin)| *margin > 0.0).map(|one| one.0);
                let new: Vec<usize> = new.collect();
                n_steps += usize::from(!new.is_empty());
                judge.broken.extend(new);
                let found = energy.broken();
                assert!(found.iter().eq(&judge.broken), "{kind:?}, body {number} at step {step}");
                let largest = row.kinetic.max(row.energy.total()).max(row.released.abs());
                worst = worst.max(row.rounding.abs() / largest);
            }
            let (broken, all) = (judge.broken.len(), judge.bonds.len());
            println!("{kind:?}, body {number}: {broken} of {all} in {n_steps} steps, {worst:e}");
            assert!(worst < 1e-12 && broken > 20 && broken < all && n_steps > 3);
        }
    }
}

/// The largest margin goes first; what broke in an attempt comes back.
#[test]
fn the_foremost_gradients_go_first_and_come_back() {
    for case in &bodies() {
        for kind in KINDS {
            let at_bonds = kind == Discretisation::BondQuadrature;
            let energy = breaking(case, kind, Level::Strict, &[3, 4]);
            let kept = [3, 4];
            let mut judge = Judge::new(case, at_bonds, &kept);
            let mut random = Random(21);
            let d = case.0.dimension();
            let x = case.0.positions().iter().enumerate();
            let strain = [0.1, -0.02, 0.04];
            let u: Vec<f64> = x.map(|(k, x)| strain[k % d] * x + 0.004 * random.next()).collect();
            let tie = 1e-6;
            for round in 0..6 {
                let found = energy.foremost(&u, tie).unwrap().unwrap();
                let margins = judge.margins(&u);
                let most = margins.iter().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max);
                assert!((found.margin - most).abs() < 1e-10 * (1.0 + most.abs()), "{most}");
                let least = most - tie * (1.0 + most).abs();
                let first = margins.iter().filter(|(_, own)| *own >= least).map(|one| one.0);
                let first: Vec<usize> = first.collect();
                assert_eq!(found.which.bonds, first, "{kind:?}, round {round}");
                let before = energy.energy(&u).unwrap().total();
                let release = energy.break_at(&u, &found.which).unwrap();
                let after = energy.energy(&u).unwrap().total();
                assert!((before - after - release.energy).abs() < 1e-13 * before);
                judge.broken.extend(first);
            }
            let look = energy.look_at(0, &u).unwrap();
            let places = if at_bonds { 1 } else { 2 };
            assert_eq!(look.margins.len(), 2 * places);
            energy.restore(&Interactions::default());
            let fresh = breaking(case, kind, Level::Strict, &[3, 4]);
            let judged = [&energy, &fresh].map(|energy| energy.foremost(&u, tie).unwrap());
            assert_eq!(judged[0], judged[1]);
        }
    }
}

#[test]
fn threads_do_not_matter() {
    for (case, kind) in bodies().iter().flat_map(|case| KINDS.map(|kind| (case, kind))) {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = breaking(case, kind, Level::Fast, &[]);
                let body = &case.0;
                let loads = vec![0.0; body.positions().len()];
                let drive = Conditions { loads, ..Conditions::default() };
                let (watch, settings) = (Watch::default(), settings());
                let made =
                    Motion::new(&energy, body.volumes(), start(body), &drive, &settings, &watch);
                let mut motion = made.unwrap();
                (go(&mut motion, STEPS), motion.state().displacements.to_vec())
            })
        };
        assert_eq!(run(1), run(2));
    }
}
