//! Bodies that break by what families give, in free flight: every list against a loop over what is left, the
//! account of energy, threads, and what has the largest margin.

use std::collections::BTreeSet;
use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::Criteria;
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings, Row};

use crate::Conditions;
use crate::bonds::{Random, norm};
use crate::reference::go;

/// A body and its horizon in m.
pub(crate) type Case = (Arc<Body>, f64);

/// Points whose bonds do not break.
const KEPT: [usize; 2] = [3, 4];

const STEPS: usize = 90;

/// A body that breaks by the conditions of this energy alone.
pub(crate) fn breaking((body, horizon): &Case, energy: impl Energy + 'static) -> Breaking {
    let neighborhood = Arc::new(Neighborhood::new(body, *horizon).unwrap());
    let is_kept = (0..body.n_points()).map(|point| KEPT.contains(&point)).collect();
    let nothing = (Criteria::new((body, &neighborhood), Vec::new(), is_kept), Memory::default());
    let names = Arc::clone(energy.parts());
    Breaking::new((Arc::clone(body), neighborhood), vec![Box::new(energy)], names, nothing, vec![])
}

/// The bonds of a body, found by a loop, and which of them are broken.
pub(crate) struct Left<'a> {
    pub(crate) body: &'a Body,
    pub(crate) all: Vec<[usize; 2]>,
    pub(crate) broken: BTreeSet<usize>,
}

impl<'a> Left<'a> {
    pub(crate) fn of((body, horizon): &'a Case) -> Left<'a> {
        let n = body.n_points();
        let pairs = (0..n).flat_map(|p| (p + 1..n).map(move |q| [p, q]));
        let rest = vec![0.0; body.positions().len()];
        let mut left = Left { body, all: Vec::new(), broken: BTreeSet::new() };
        let near = |ends: &[usize; 2]| left.length(&rest, *ends) <= horizon * (1.0 + 1e-9);
        left.all = pairs.filter(near).collect();
        left
    }

    /// From one point to another, with displacements or, of positions, without.
    pub(crate) fn along(&self, x: &[f64], [p, q]: [usize; 2]) -> Vec<f64> {
        let d = self.body.dimension();
        (0..d).map(|axis| x[q * d + axis] - x[p * d + axis]).collect()
    }

    pub(crate) fn length(&self, u: &[f64], ends: [usize; 2]) -> f64 {
        let (xi, eta) = (self.along(self.body.positions(), ends), self.along(u, ends));
        norm(&xi.iter().zip(eta).map(|(xi, eta)| xi + eta).collect::<Vec<f64>>())
    }

    /// The points that are bonded to one still.
    pub(crate) fn family(&self, point: usize) -> impl Iterator<Item = usize> + '_ {
        let left = self.all.iter().enumerate().filter(|(bond, _)| !self.broken.contains(bond));
        let own = left.filter(move |(_, ends)| ends.contains(&point));
        own.map(move |(_, ends)| if ends[0] == point { ends[1] } else { ends[0] })
    }

    /// Bonds that are there and may break, with their margins.
    fn judged(&self, margin: impl Fn([usize; 2]) -> f64) -> Vec<(usize, f64)> {
        let may_break = |(bond, ends): &(usize, &[usize; 2])| {
            !self.broken.contains(bond) && !ends.iter().any(|p| KEPT.contains(p))
        };
        let left = self.all.iter().enumerate().filter(may_break);
        left.map(|(bond, ends)| (bond, margin(*ends))).collect()
    }
}

/// The largest margin over its amount at rest that judges a bond, at given displacements.
pub(crate) trait Margins:
    Fn(&Left<'_>, &[f64]) -> Box<dyn Fn([usize; 2]) -> f64> + Sync
{
}

impl<M: Fn(&Left<'_>, &[f64]) -> Box<dyn Fn([usize; 2]) -> f64> + Sync> Margins for M {}

/// Lets a body fly apart, with as many threads: at every step the bonds break that the loop says.
pub(crate) fn flies_apart(
    case: &Case,
    threads: usize,
    make: impl Fn() -> Breaking + Sync,
    margins: &impl Margins,
) -> Vec<Row> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let (body, energy, mut left) = (&case.0, make(), Left::of(case));
        assert_eq!(energy.counts(), [left.all.len(), 0]);
        let n = body.positions().len();
        let mut random = Random(9);
        let velocity = |x: &f64| 8.0 * x + 2.0 * random.next();
        let velocities = body.positions().iter().map(velocity).collect();
        let start = Initial { displacements: vec![0.0; n], velocities };
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
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
            let all = left.judged(margins(&left, motion.state().displacements));
            let new: Vec<usize> = all.iter().filter(|one| one.1 > 0.0).map(|one| one.0).collect();
            n_steps += usize::from(!new.is_empty());
            left.broken.extend(new);
            assert!(energy.broken().iter().eq(&left.broken), "step {step}");
            let largest = row.kinetic.max(row.energy.total()).max(row.released.abs());
            worst = worst.max(row.rounding.abs() / largest);
            rows.push(row);
        }
        let (broken, all) = (left.broken.len(), left.all.len());
        println!("{broken} of {all} in {n_steps} steps, {worst:e}");
        assert!(worst < 1e-12 && broken > 20 && broken < all && n_steps > 3);
        rows
    })
}

/// At these displacements the largest margin goes first, and again of what is left; each releases what the
/// energy falls by.
pub(crate) fn the_foremost_goes_first(
    case: &Case,
    energy: &Breaking,
    u: &[f64],
    margins: &impl Margins,
) {
    let (mut left, tie) = (Left::of(case), 1e-6);
    for round in 0..6 {
        let found = energy.foremost(u, tie).unwrap().unwrap();
        let all = left.judged(margins(&left, u));
        let most = all.iter().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max);
        assert!((found.margin - most).abs() < 1e-10 * (1.0 + most.abs()), "{most}");
        let least = most - tie * (1.0 + most).abs();
        let first: Vec<usize> = all.iter().filter(|one| one.1 >= least).map(|one| one.0).collect();
        assert_eq!(found.which.bonds, first, "round {round}");
        let before = energy.energy(u).unwrap().total();
        let release = energy.break_at(u, &found.which).unwrap();
        let after = energy.energy(u).unwrap().total();
        assert!((before - after - release.energy).abs() < 1e-13 * before);
        left.broken.extend(first);
    }
}
