//! Bodies of bonds, triangles and tetrahedra in free flight that break by criteria of all three: every list
//! against a loop over what is left, the account of energy, threads, and motions that are taken up again.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::{Criteria, Criterion, Layer};
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture, Inspection, Interactions};
use piola_runtime::kernel::{Law, Measure};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings, Row, Snapshot};
use piola_runtime::weights::Weights;

use crate::Conditions;
use crate::bonds::{Random, cloud, lattice, norm};
use crate::reference::go;

/// Thresholds of bonds, triangles and tetrahedra: these also fail where they shrink.
const LIMITS: [f64; 3] = [0.16, 0.2, 0.22];

pub(crate) fn breaking(body: &Arc<Body>, horizon: f64, kept: &[usize]) -> Breaking {
    breaking_from((body, horizon), kept, 0.0)
}

/// The same with triangles whose energy at rest is below nothing by a part: forces are the same, but one that breaks
/// before it has gained that part leaves more energy behind than there was.
pub(crate) fn breaking_from(
    (body, horizon): (&Arc<Body>, f64),
    kept: &[usize],
    below: f64,
) -> Breaking {
    let d = body.dimension();
    let [s0, g0, h0] = LIMITS;
    let mut text = format!(
        "potential p\npsi(l) = 3e4*L*(l/L - 1)^2\nbreak when l/L - 1 > {s0}\n\
         psi(a) = 4e5*A*((a/A - 1)^2 - {below})\nbreak when a/A - 1 > {g0}\n"
    );
    if d == 3 {
        text.push_str(&format!("psi(v) = 4e7*V*(v/V - 1)^2\nbreak when abs(v/V - 1) > {h0}\n"));
    }
    breaking_by((body, horizon), kept, &text)
}

/// A body with the energies and the conditions of a text.
fn breaking_by((body, horizon): (&Arc<Body>, f64), kept: &[usize], text: &str) -> Breaking {
    let d = body.dimension();
    let (_, model) = check_text(text).unwrap();
    let values = model.values(d, &[], Some(horizon)).unwrap();
    let mode = Mode::Jit(Level::Fast);
    let mut laws = Laws::default();
    for kernel in model.compile(&values, mode, Form::Accurate).unwrap().kernels {
        let place = match kernel.measure() {
            Measure::Length => &mut laws.bond,
            Measure::Area => &mut laws.triangle,
            Measure::Volume => &mut laws.tetrahedron,
        };
        *place = Some(Box::new(kernel) as Box<dyn Law>);
    }
    let energy = DiscreteEnergy::new(Arc::clone(body), horizon, Weights::Volumes, laws).unwrap();
    let criterion = |one: piola_compiler::Criterion| Criterion {
        measure: one.measure(),
        holds_at_zero: one.holds_at_zero,
        margin: Box::new(one.margin),
    };
    let found = model.criteria(&values, mode, Form::Accurate).unwrap();
    let of_law = vec![found.into_iter().map(criterion).collect()];
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).unwrap());
    let is_kept = (0..body.n_points()).map(|point| kept.contains(&point)).collect();
    let layers = vec![Layer { of_law, materials: None }];
    let criteria = Criteria::new((body, &neighborhood), layers, is_kept);
    let names = Arc::clone(energy.parts());
    let terms: Vec<Box<dyn Energy>> = vec![Box::new(energy)];
    let around = (Arc::clone(body), neighborhood);
    Breaking::new(around, terms, names, (criteria, Memory::default()), Vec::new())
}

/// What of a body is left, kind by kind, judged by loops.
pub(crate) struct Judge<'a> {
    body: &'a Body,
    /// Bonds, triangles and tetrahedra by their points, in lexicographic order.
    pub(crate) all: [Vec<Vec<usize>>; 3],
    broken: [BTreeSet<usize>; 3],
    kept: &'a [usize],
}

impl<'a> Judge<'a> {
    pub(crate) fn new(body: &'a Body, horizon: f64, kept: &'a [usize]) -> Judge<'a> {
        let n = body.n_points();
        let near = |p: usize, q: usize| {
            let x = |axis: usize| body.position(q)[axis] - body.position(p)[axis];
            norm(&(0..body.dimension()).map(x).collect::<Vec<f64>>()) <= horizon * (1.0 + 1e-9)
        };
        let longer = |all: &[Vec<usize>]| -> Vec<Vec<usize>> {
            let of = |clique: &Vec<usize>| {
                let from = clique[clique.len() - 1] + 1;
                let next = (from..n).filter(|q| clique.iter().all(|p| near(*p, *q)));
                next.map(|q| [&clique[..], &[q]].concat()).collect::<Vec<_>>()
            };
            all.iter().flat_map(of).collect()
        };
        let bonds = longer(&(0..n).map(|point| vec![point]).collect::<Vec<_>>());
        let (triangles, rest) = (longer(&bonds), vec![0.0; body.positions().len()]);
        let tetrahedra = if body.dimension() == 3 { longer(&triangles) } else { Vec::new() };
        let mut all = [bonds, triangles, tetrahedra];
        for (kind, own) in all.iter_mut().enumerate() {
            let floor = 1e-8 * libm::pow(horizon, (kind + 1) as f64);
            own.retain(|clique| size(body, &rest, clique).abs() > floor);
        }
        Judge { body, all, broken: Default::default(), kept }
    }

    /// Whether something with these points has an edge that is broken.
    fn has_broken_edge(&self, clique: &[usize]) -> bool {
        self.broken[0].iter().any(|bond| self.all[0][*bond].iter().all(|p| clique.contains(p)))
    }

    /// Breaks what does at some displacements, all at once.
    fn step(&mut self, u: &[f64]) {
        let rest = vec![0.0; u.len()];
        let new = [0, 1, 2].map(|kind| {
            let breaks = |clique: &[usize]| {
                let strain = size(self.body, u, clique) / size(self.body, &rest, clique) - 1.0;
                if kind == 2 { strain.abs() > LIMITS[2] } else { strain > LIMITS[kind] }
            };
            let own = self.all[kind].iter().enumerate().filter(|(number, clique)| {
                !self.broken[kind].contains(number)
                    && !clique.iter().any(|p| self.kept.contains(p))
                    && breaks(clique)
                    && (kind == 0 || !self.has_broken_edge(clique))
            });
            own.map(|(number, _)| number).collect::<Vec<usize>>()
        });
        self.broken.iter_mut().zip(new).for_each(|(all, new)| all.extend(new));
    }

    /// The largest margin over its amount at rest among what is left, and what is within `tie` of it.
    fn foremost(&self, u: &[f64], tie: f64) -> (f64, Interactions) {
        let rest = vec![0.0; u.len()];
        let margins = [0, 1, 2].map(|kind| {
            let margin = |clique: &[usize]| {
                let strain = size(self.body, u, clique) / size(self.body, &rest, clique) - 1.0;
                (if kind == 2 { strain.abs() } else { strain }) / LIMITS[kind] - 1.0
            };
            let left = self.all[kind].iter().enumerate().filter(|(number, clique)| {
                !self.broken[kind].contains(number)
                    && !clique.iter().any(|p| self.kept.contains(p))
                    && (kind == 0 || !self.has_broken_edge(clique))
            });
            left.map(|(number, clique)| (number, margin(clique))).collect::<Vec<_>>()
        });
        let most = margins.iter().flatten().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max);
        let least = most - tie * (1.0 + most).abs();
        let [bonds, areas, volumes] = margins.map(|all| {
            all.into_iter().filter(|(_, own)| *own >= least).map(|(number, _)| number).collect()
        });
        (most, Interactions { bonds, cliques: [areas, volumes] })
    }
}

/// Energy, forces, tangent, and a product with the Hessian, at some displacements.
fn all_of(energy: &Breaking, u: &[f64]) -> [Vec<f64>; 4] {
    let (mut forces, mut product) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let parts = energy.tangent(u, &mut forces, &mut tangent).unwrap();
    energy.hessian(u).unwrap().multiply(&Random(5).vector(u.len()), &mut product);
    [vec![parts.total()], forces, tangent.values, product]
}

impl Judge<'_> {
    /// The share of what is broken at each point: of bonds by the volumes of neighbours, of triangles and
    /// tetrahedra by their measures at rest.
    fn damage(&self, kind: usize) -> Vec<f64> {
        let rest = vec![0.0; self.body.positions().len()];
        let n = self.body.n_points();
        let (mut all, mut gone) = (vec![0.0; n], vec![0.0; n]);
        for (number, clique) in self.all[kind].iter().enumerate() {
            let is_gone =
                self.broken[kind].contains(&number) || kind > 0 && self.has_broken_edge(clique);
            let measure = size(self.body, &rest, clique).abs();
            for &point in clique {
                let others = clique.iter().filter(|other| **other != point);
                let volume: f64 = others.map(|other| self.body.volumes()[*other]).sum();
                let part = if kind == 0 { volume } else { measure };
                all[point] += part;
                gone[point] += if is_gone { part } else { 0.0 };
            }
        }
        gone.iter().zip(&all).map(|(gone, all)| if *all > 0.0 { gone / all } else { 0.0 }).collect()
    }
}

/// Length, area or volume, with a sign where it has one.
pub(crate) fn size(body: &Body, u: &[f64], clique: &[usize]) -> f64 {
    let d = body.dimension();
    let place = |point: usize| -> [f64; 3] {
        std::array::from_fn(|axis| match axis < d {
            true => body.position(point)[axis] + u[point * d + axis],
            false => 0.0,
        })
    };
    let first = place(clique[0]);
    let edge = |point: &usize| -> [f64; 3] {
        let there = place(*point);
        std::array::from_fn(|axis| there[axis] - first[axis])
    };
    let x: Vec<[f64; 3]> = clique[1..].iter().map(edge).collect();
    let cross = |p: &[f64; 3], q: &[f64; 3]| {
        let at = |a: usize, b: usize| p[a] * q[b] - p[b] * q[a];
        [at(1, 2), at(2, 0), at(0, 1)]
    };
    match x.len() {
        1 => norm(&x[0]),
        2 if d == 2 => cross(&x[0], &x[1])[2],
        2 => norm(&cross(&x[0], &x[1])),
        _ => {
            let normal = cross(&x[1], &x[2]);
            (0..3).map(|axis| x[0][axis] * normal[axis]).sum()
        }
    }
}

/// A start from which points part, and turn about, so that edges break and areas and volumes fail.
pub(crate) fn start(body: &Body, seed: u64) -> Initial {
    let mut random = Random(seed);
    let velocity = |x: &f64| 4.0 * x + 0.6 * random.next();
    let velocities = body.positions().iter().map(velocity).collect();
    Initial { displacements: vec![0.0; body.positions().len()], velocities }
}

const STEPS: usize = 120;

pub(crate) fn settings() -> MotionSettings {
    let dt = 1.5e-3;
    MotionSettings {
        end: dt * STEPS as f64,
        step: Some(dt),
        rows: STEPS,
        ..MotionSettings::default()
    }
}

fn largest(row: &Row) -> f64 {
    row.kinetic.max(row.energy.total()).max(row.released)
}

pub(crate) fn bodies() -> [(Arc<Body>, f64); 3] {
    [
        (cloud(&[10, 7], 0.1, 5), 0.25),
        (cloud(&[5, 4, 3], 0.1, 6), 0.2),
        (lattice(&[0.0, 0.0], &[17, 6], 0.1), 0.25),
    ]
}

#[test]
fn all_kinds_break_as_loops_say_and_the_account_closes() {
    for (number, (body, horizon)) in bodies().iter().enumerate() {
        let (d, kept) = (body.dimension(), [3, 4]);
        let energy = breaking(body, *horizon, &kept);
        let mut judge = Judge::new(body, *horizon, &kept);
        let counts = [Measure::Area, Measure::Volume].map(|m| energy.counts_of(m).map(|n| n[0]));
        assert_eq!(counts[0], Some(judge.all[1].len()));
        assert_eq!(counts[1], (d == 3).then_some(judge.all[2].len()));
        let masses: Vec<f64> = body.volumes().iter().map(|v| 1e3 * v).collect();
        let drive = Conditions { loads: vec![0.0; d * body.n_points()], ..Conditions::default() };
        let (watch, settings) = (Watch::default(), settings());
        let mut motion =
            Motion::new(&energy, &masses, start(body, 9), &drive, &settings, &watch).unwrap();
        let again = breaking(body, *horizon, &kept);
        let mut resumed: Option<Motion<'_>> = None;
        let mut worst = 0.0_f64;
        for step in 0..=STEPS {
            let row = go(&mut motion, step);
            judge.step(motion.state().displacements);
            let found = [
                energy.broken(),
                energy.broken_cliques(Measure::Area),
                energy.broken_cliques(Measure::Volume),
            ];
            for (found, expected) in found.iter().zip(&judge.broken) {
                assert!(found.iter().eq(expected), "body {number} at step {step}");
            }
            if step % 15 == 0 {
                let kinds = [Measure::Length, Measure::Area, Measure::Volume];
                for (kind, measure) in kinds.into_iter().enumerate() {
                    let (damage, expected) = (energy.damage_of(measure), judge.damage(kind));
                    let error = |(x, y): (&f64, &f64)| (x - y).abs();
                    let worst = damage.iter().zip(&expected).map(error).fold(0.0, f64::max);
                    assert!(worst < 1e-13, "body {number} at step {step}: {worst:e}");
                    assert!(step == 0 || kind == d || damage.iter().any(|x| *x > 0.0));
                }
            }
            assert_eq!(row.broken, Some(found[0].len()));
            assert_eq!(row.created, 0.0, "energies are never negative");
            let volumes = (d == 3).then_some(found[2].len());
            assert_eq!(row.broken_cliques, [Some(found[1].len()), volumes]);
            worst = worst.max(row.rounding.abs() / largest(&row));
            // What breaking releases is no error of the integrator.
            assert!(row.quadrature.abs() < 0.05 * largest(&row), "{}", row.quadrature);
            if step == STEPS / 2 {
                let Snapshot { arrays, notes } = motion.snapshot();
                let arrays = arrays.map(|array| Cow::Owned(array.into_owned()));
                let snapshot = Snapshot { arrays, notes: notes.into_owned().into() };
                let taken_up = Motion::resume(&again, &masses, &drive, &settings, &watch, snapshot);
                resumed = Some(taken_up.unwrap());
            } else if let Some(resumed) = &mut resumed {
                assert_eq!(go(resumed, step), row, "a motion that was taken up");
                assert_eq!(resumed.state().displacements, motion.state().displacements);
            }
        }
        let all: Vec<(usize, usize)> =
            judge.broken.iter().zip(&judge.all).map(|(b, all)| (b.len(), all.len())).collect();
        println!("body {number}: account {worst:e}, broken of all {all:?}");
        assert!(worst < 1e-12, "body {number}: {worst}");
        assert!(all[..d].iter().all(|(broken, all)| *broken > 10 && broken < all), "{all:?}");
    }
}

/// Lattices with rows long enough to go along them.
fn with_rows() -> [(Arc<Body>, f64); 2] {
    [
        (lattice(&[0.0, 0.0], &[30, 16], 0.1), 0.25),
        (lattice(&[0.0, 0.0, 0.0], &[20, 3, 9], 0.1), 0.181),
    ]
}

/// Forces along rows say of which owners triangles and tetrahedra may have failed, and the others are not judged: what
/// breaks is what breaks where all are judged, whatever conditions are by.
#[test]
fn what_is_watched_breaks_as_what_is_judged() {
    let bonds = "potential p\npsi(l) = 3e4*L*(l/L - 1)^2\nbreak when l/L - 1 > 0.2\n";
    let areas = "psi(a) = 4e5*A*(a/A - 1)^2\n";
    let volumes = "psi(v) = 4e7*V*(v/V - 1)^2\n";
    let plane = [
        "break when a/A - 1 > 0.12\n",
        "break when a/A < 0.85\n",
        "break when (a/A)^2 > 1.2\n",
        "break when (a/A)^2 < 0.8\nbreak when a > 1.15*A\n",
    ];
    let space = ["break when v/V > 1.2\n", "break when v/V < 0.7\n", "break when (v/V)^2 > 1.5\n"];
    let [flat, solid] = with_rows();
    let in_plane = plane.map(|when| (&flat, format!("{bonds}{areas}{when}")));
    let of_areas = plane.map(|when| (&solid, format!("{bonds}{areas}{when}")));
    let of_volumes = space.map(|when| (&solid, format!("{bonds}{volumes}{when}")));
    for ((body, horizon), text) in in_plane.into_iter().chain(of_areas).chain(of_volumes) {
        let [watched, judged] = [(); 2].map(|()| breaking_by((body, *horizon), &[3], &text));
        let masses: Vec<f64> = body.volumes().iter().map(|v| 1e3 * v).collect();
        let n = body.positions().len();
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let (watch, settings) = (Watch::default(), settings());
        // One end turns about itself, and stretches, and waves run to the other.
        let mut begun = start(body, 9);
        let x = |dof: usize| body.positions()[dof - dof % body.dimension()];
        begun.velocities.iter_mut().enumerate().for_each(|(dof, v)| {
            *v *= if x(dof) < 0.6 { 1.5 } else { 0.0 };
        });
        let mut motion = Motion::new(&watched, &masses, begun, &drive, &settings, &watch).unwrap();
        for step in 0..=STEPS {
            go(&mut motion, step);
            judged.advance(motion.state().displacements, 0.0, (0.0, &vec![0.0; n])).unwrap();
            assert_eq!(watched.gone(), judged.gone(), "{text} at step {step}");
        }
        let Interactions { cliques: [areas, volumes], .. } = watched.gone();
        println!("{} {} of {text}", areas.len(), volumes.len());
        assert!(areas.len() + volumes.len() > 10, "{text}");
    }
}

/// Where nothing has moved nothing is judged, and where one end is stretched no more than what is near it.
#[test]
fn few_owners_are_judged() {
    let [flat, solid] = &with_rows();
    for ((body, horizon), measure) in
        [(flat, Measure::Area), (solid, Measure::Area), (solid, Measure::Volume)]
    {
        let d = body.dimension();
        let text = "potential p\npsi(a) = 4e5*A*(a/A - 1)^2\npsi(v) = 4e7*V*(v/V - 1)^2\n";
        let (_, model) = check_text(text).unwrap();
        let values = model.values(d, &[], Some(*horizon)).unwrap();
        let mut laws = Laws::default();
        for kernel in
            model.compile(&values, Mode::Jit(Level::Fast), Form::Accurate).unwrap().kernels
        {
            match (kernel.measure(), measure) {
                (Measure::Area, Measure::Area) => laws.triangle = Some(Box::new(kernel)),
                (Measure::Volume, Measure::Volume) => laws.tetrahedron = Some(Box::new(kernel)),
                _ => {}
            }
        }
        let mut energy =
            DiscreteEnergy::new(Arc::clone(body), *horizon, Weights::Volumes, laws).unwrap();
        assert!(!energy.watch_cliques(measure, &|_| None), "nobody knows the limits");
        assert_eq!(energy.exceeding(measure), None);
        assert!(energy.watch_cliques(measure, &|size| Some([-0.3 * size, 0.1 * size])));
        let judged = |energy: &DiscreteEnergy, u: &[f64]| {
            energy.forces(u, &mut vec![0.0; u.len()]).unwrap();
            let owners = energy.exceeding(measure).unwrap();
            owners.into_iter().map(|owners| owners.len()).sum::<usize>()
        };
        let turned = |by: f64| -> Vec<f64> {
            let turn = |dof: usize| {
                let (axis, x) = (dof % d, &body.positions()[dof - dof % d..]);
                let (sin, cos) = (libm::sin(by), libm::cos(by));
                match axis {
                    0 => cos * x[0] - sin * x[1] - x[0],
                    1 => sin * x[0] + cos * x[1] - x[1],
                    _ => 0.0,
                }
            };
            (0..body.positions().len()).map(turn).collect()
        };
        assert_eq!(judged(&energy, &turned(0.0)), 0);
        assert_eq!(judged(&energy, &turned(2.0)), 0, "a turn stretches nothing");
        for grows in [0.2, -0.35] {
            let mut u = turned(0.0);
            let end = 0.75 * body.positions()[u.len() - d];
            let far = |dof: usize| body.positions()[dof] - end;
            (0..u.len()).step_by(d).for_each(|dof| u[dof] = grows * far(dof).max(0.0));
            let n = judged(&energy, &u);
            assert!(n > 0 && n < body.n_points() / 2, "{n} of {}", body.n_points());
        }
    }
}

/// With a row at every step: what `released` falls by in some steps, and does not rise by in others.
#[test]
fn what_breaking_creates_is_what_released_falls_by() {
    for (number, (body, horizon)) in bodies().iter().enumerate() {
        let energy = breaking_from((body, *horizon), &[3, 4], 0.2);
        let masses: Vec<f64> = body.volumes().iter().map(|v| 1e3 * v).collect();
        let n = body.positions().len();
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let (watch, settings) = (Watch::default(), settings());
        let mut motion =
            Motion::new(&energy, &masses, start(body, 9), &drive, &settings, &watch).unwrap();
        let (mut falls, mut released, mut n_falls) = (0.0, 0.0, 0);
        for step in 0..=STEPS {
            let row = go(&mut motion, step);
            let fall = f64::max(released - row.released, 0.0);
            (falls, released) = (falls + fall, row.released);
            n_falls += usize::from(fall > 0.0);
            let error = (row.created - falls).abs();
            assert!(error <= 1e-13 * (falls + released.abs()), "{} {falls}", row.created);
        }
        assert!(n_falls > 1, "body {number}: {n_falls}");
        assert!(motion.notes().iter().any(|note| note.contains("breaking creates energy")));
    }
}

#[test]
fn threads_do_not_matter() {
    for (body, horizon) in bodies() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = breaking(&body, horizon, &[]);
                let masses: Vec<f64> = body.volumes().iter().map(|v| 1e3 * v).collect();
                let n = body.positions().len();
                let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
                let (watch, settings) = (Watch::default(), settings());
                let start = start(&body, 9);
                let mut motion =
                    Motion::new(&energy, &masses, start, &drive, &settings, &watch).unwrap();
                let row = go(&mut motion, STEPS);
                (row, motion.state().displacements.to_vec())
            })
        };
        assert_eq!(run(1), run(2));
    }
}

/// At given displacements what has the largest margin over its amount at rest goes first, of all kinds together,
/// and comes back with the same bits: to any state before, and in a body that never was in that.
#[test]
fn the_foremost_of_all_kinds_go_first_and_come_back() {
    for (number, (body, horizon)) in bodies().iter().enumerate() {
        let (energy, kept) = (breaking(body, *horizon, &[3, 4]), [3, 4]);
        let mut judge = Judge::new(body, *horizon, &kept);
        let mut random = Random(21);
        // Stretched along one axis bonds are first, compressed volumes, and grown in the plane areas.
        let ways = [[0.1, 0.1, -0.15], [0.3, -0.2, -0.2], [-0.1, -0.1, -0.1]].map(|strain| {
            let d = body.dimension();
            let x = body.positions().iter().enumerate();
            let all = x.map(|(dof, x)| strain[dof % d] * x + 0.002 * random.next());
            all.collect::<Vec<f64>>()
        });
        let u = ways[1].clone();
        let (whole, tie) = (all_of(&energy, &u), 1e-3);
        let mut halfway = None;
        let mut kinds = [0; 3];
        for round in 0..90 {
            let u = &ways[round % 3];
            let found = energy.foremost(u, tie).unwrap().unwrap();
            let (margin, which) = judge.foremost(u, tie);
            assert!((found.margin - margin).abs() < 1e-12 * (1.0 + margin.abs()));
            assert_eq!(found.which, which, "body {number}, round {round}");
            let [before, ..] = all_of(&energy, u);
            let release = energy.break_at(u, &which).unwrap();
            let [after, ..] = all_of(&energy, u);
            assert!((before[0] - after[0] - release.energy).abs() < 1e-13 * before[0]);
            let Interactions { bonds, cliques: [areas, volumes] } = which;
            assert_eq!(
                (release.bonds, release.cliques),
                (bonds.len(), [areas.len(), volumes.len()])
            );
            for (kind, new) in [bonds, areas, volumes].into_iter().enumerate() {
                kinds[kind] += new.len();
                judge.broken[kind].extend(new);
            }
            if round == 30 {
                halfway = Some((energy.gone(), all_of(&energy, &ways[1])));
            }
        }
        println!("body {number}: {kinds:?}");
        assert!(kinds[..body.dimension()].iter().all(|n| *n > 0), "body {number}: {kinds:?}");
        let (last, at_last) = (energy.gone(), all_of(&energy, &u));
        let (gone, at_halfway) = halfway.unwrap();
        let other = breaking(body, *horizon, &kept);
        let nothing = Interactions::default();
        let states =
            [(&gone, &at_halfway), (&nothing, &whole), (&last, &at_last), (&gone, &at_halfway)];
        for (gone, expected) in states {
            for energy in [&energy, &other] {
                energy.restore(gone);
                assert_eq!(&energy.gone(), gone);
                assert_eq!(&all_of(energy, &u), expected, "body {number}");
            }
            let counts = [gone.bonds.len(), gone.cliques[0].len()];
            let found = [energy.counts()[1], energy.counts_of(Measure::Area).unwrap()[1]];
            assert_eq!(counts, found);
        }
        // What is judged is what is left then.
        energy.restore(&nothing);
        let mut fresh = Judge::new(body, *horizon, &kept);
        fresh.step(&u);
        energy.advance(&u, 0.0, (0.0, &vec![0.0; u.len()])).unwrap();
        let found = energy.gone();
        let [areas, volumes] = &found.cliques;
        for (found, expected) in [&found.bonds, areas, volumes].into_iter().zip(&fresh.broken) {
            assert!(found.iter().eq(expected), "body {number}");
        }
    }
}
