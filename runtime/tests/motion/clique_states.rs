//! Triangles and tetrahedra that remember, against loops over what is left: areas that soften, volumes that
//! yield, beside bonds that break and take both with them.

use std::borrow::Cow;
use std::sync::Arc;

use piola_compiler::Level;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::{Breaking, Fracture, Inspection};
use piola_runtime::kernel::Measure;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Motion, MotionSettings, Row, Snapshot};

use crate::Conditions;
use crate::bonds::Random;
use crate::cliques::{Judge, bodies, size, start};
use crate::families::largest;
use crate::following::tangents_are_derivatives;
use crate::reference::{go, off};
use crate::states::{remembering, remembering_as};

/// Thresholds of bonds, areas and volumes.
const LIMITS: [f64; 3] = [0.2, 0.3, 0.35];

/// From where areas soften, how fast, and how far volumes give way.
const SOFT: f64 = 0.03;
const TAIL: f64 = 0.2;
const YIELD: f64 = 0.04;

const STIFFNESS: [f64; 3] = [6e4, 8e5, 8e7];

const STEPS: usize = 100;

fn text(d: usize) -> String {
    let [[s0, g0, h0], [c1, c2, c3]] = [LIMITS, STIFFNESS];
    let mut text = format!(
        "potential p\nstate k = 0\nstate q = 0\ng = a/A - 1\nupdate k = max(k, g)\n\
         left = if k > {SOFT} then exp(-(k - {SOFT})/{TAIL}) else 1\n\
         psi(l) = 1/2*{c1}*L*(l/L - 1)^2\nbreak when l/L - 1 > {s0}\n\
         psi(a) = 1/2*{c2}*A*left*g^2\nbreak when k > {g0}\n"
    );
    text.push_str(&match d {
        2 => "update q = max(q, l/L - 1)".to_string(),
        _ => format!(
            "h = v/V - 1\nupdate q = if abs(h - q) > {YIELD} then h - sign(h - q)*{YIELD} else q\n\
             psi(v) = 1/2*{c3}*V*(h - q)^2\nbreak when abs(h) > {h0}\n"
        ),
    });
    text
}

fn energy(body: &Arc<Body>, horizon: f64) -> Breaking {
    remembering((body, horizon), &text(body.dimension()), &[], Level::Fast)
}

/// What the loops know of a body.
struct Loops<'a> {
    body: &'a Body,
    /// Bonds, triangles and tetrahedra by their points, in lexicographic order.
    all: [Vec<Vec<usize>>; 3],
    gone: [Vec<bool>; 3],
    states: [Vec<f64>; 3],
    dissipated: f64,
    released: f64,
    broken: [usize; 3],
    never_breaks: bool,
}

impl<'a> Loops<'a> {
    fn new(body: &'a Body, horizon: f64) -> Loops<'a> {
        let all = Judge::new(body, horizon, &[]).all;
        let gone = all.each_ref().map(|all| vec![false; all.len()]);
        let states = all.each_ref().map(|all| vec![0.0; all.len()]);
        let (dissipated, released, broken) = (0.0, 0.0, [0; 3]);
        Loops { body, all, gone, states, dissipated, released, broken, never_breaks: false }
    }

    /// The change of a measure, in parts of that at rest.
    fn strain(&self, u: &[f64], points: &[usize]) -> f64 {
        size(self.body, u, points) / size(self.body, &vec![0.0; u.len()], points) - 1.0
    }

    /// psi of one, and its derivative by the strain, over the measure at rest.
    fn psi(&self, kind: usize, strain: f64, state: f64) -> [f64; 2] {
        let c = STIFFNESS[kind];
        match kind {
            0 => [0.5 * c * strain * strain, c * strain],
            1 => {
                let left = if state > SOFT { libm::exp(-(state - SOFT) / TAIL) } else { 1.0 };
                [0.5 * c * left * strain * strain, c * left * strain]
            }
            _ => [0.5 * c * (strain - state) * (strain - state), c * (strain - state)],
        }
    }

    /// The product of the volumes, for each order of the others.
    fn weight(&self, points: &[usize]) -> f64 {
        let orders = [1.0, 2.0, 6.0][points.len() - 2];
        orders * points.iter().map(|point| self.body.volumes()[*point]).product::<f64>()
    }

    fn held(&self, u: &[f64], kind: usize, number: usize) -> f64 {
        let points = &self.all[kind][number];
        let rest = size(self.body, &vec![0.0; u.len()], points).abs();
        let [psi, _] = self.psi(kind, self.strain(u, points), self.states[kind][number]);
        self.weight(points) * rest * psi
    }

    /// Judges all, changes what stays, and takes out what breaks.
    fn step(&mut self, u: &[f64]) {
        let strain = |kind: usize| -> Vec<f64> {
            self.all[kind].iter().map(|points| self.strain(u, points)).collect()
        };
        let strains = [0, 1, 2].map(strain);
        let breaks: [Vec<bool>; 3] = [0, 1, 2].map(|kind| {
            let holds = |number: usize| match kind {
                0 => strains[0][number] > LIMITS[0],
                1 => self.states[1][number] > LIMITS[1],
                _ => strains[2][number].abs() > LIMITS[2],
            };
            let breaks = |k: usize| !self.never_breaks && !self.gone[kind][k] && holds(k);
            (0..self.all[kind].len()).map(breaks).collect()
        });
        let edges: Vec<&Vec<usize>> =
            (0..self.all[0].len()).filter(|k| breaks[0][*k]).map(|k| &self.all[0][k]).collect();
        let loses_edge = |points: &Vec<usize>| {
            edges.iter().any(|bond| bond.iter().all(|point| points.contains(point)))
        };
        let goes: [Vec<bool>; 3] = [0, 1, 2].map(|kind| {
            let goes = |k: usize| {
                let loses = kind > 0 && loses_edge(&self.all[kind][k]);
                breaks[kind][k] || loses && !self.gone[kind][k]
            };
            (0..self.all[kind].len()).map(goes).collect()
        });
        for kind in 0..3 {
            for number in 0..self.all[kind].len() {
                if self.gone[kind][number] {
                    continue;
                }
                let before = self.held(u, kind, number);
                if goes[kind][number] {
                    self.gone[kind][number] = true;
                    self.released += before;
                    self.broken[kind] += usize::from(breaks[kind][number]);
                    continue;
                }
                let (strain, state) = (strains[kind][number], self.states[kind][number]);
                self.states[kind][number] = match kind {
                    // Bonds remember in the plane alone.
                    0 => state.max(strain),
                    1 => state.max(strain),
                    _ if (strain - state).abs() > YIELD => {
                        strain - (strain - state).signum() * YIELD
                    }
                    _ => state,
                };
                self.dissipated += before - self.held(u, kind, number);
            }
        }
    }

    /// The energy, and its derivatives by displacements.
    fn forces(&self, u: &[f64]) -> (f64, Vec<f64>) {
        let (d, rest) = (self.body.dimension(), vec![0.0; u.len()]);
        let (mut energy, mut forces) = (0.0, vec![0.0; u.len()]);
        for kind in 0..3 {
            for number in (0..self.all[kind].len()).filter(|k| !self.gone[kind][*k]) {
                let points = &self.all[kind][number];
                energy += self.held(u, kind, number);
                let state = self.states[kind][number];
                let [_, slope] = self.psi(kind, self.strain(u, points), state);
                let at_rest = size(self.body, &rest, points);
                let pull = self.weight(points) * slope * at_rest.signum();
                for (corner, by_place) in gradients(self.body, u, points).iter().enumerate() {
                    for axis in 0..d {
                        forces[points[corner] * d + axis] += pull * by_place[axis];
                    }
                }
            }
        }
        (energy, forces)
    }

    /// The states that the body has, in its order.
    fn remembered(&self) -> Vec<f64> {
        match self.body.dimension() {
            2 => [&self.states[1][..], &self.states[0]].concat(),
            _ => [&self.states[1][..], &self.states[2]].concat(),
        }
    }

    /// Means over what is left at each point, each with its measure at rest.
    fn means(&self, kind: usize) -> Vec<f64> {
        let rest = vec![0.0; self.body.positions().len()];
        let n = self.body.n_points();
        let (mut sums, mut weights) = (vec![0.0; n], vec![0.0; n]);
        for number in (0..self.all[kind].len()).filter(|k| !self.gone[kind][*k]) {
            let points = &self.all[kind][number];
            let weight = size(self.body, &rest, points).abs();
            for &point in points {
                sums[point] += weight * self.states[kind][number];
                weights[point] += weight;
            }
        }
        sums.iter().zip(weights).map(|(sum, weight)| sum / weight).collect()
    }
}

/// Derivatives of a length, an area or a volume by the places of its points.
fn gradients(body: &Body, u: &[f64], points: &[usize]) -> Vec<[f64; 3]> {
    let d = body.dimension();
    let place = |point: usize| -> [f64; 3] {
        std::array::from_fn(|axis| match axis < d {
            true => body.position(point)[axis] + u[point * d + axis],
            false => 0.0,
        })
    };
    let first = place(points[0]);
    let x: Vec<[f64; 3]> = points[1..]
        .iter()
        .map(|point| {
            let there = place(*point);
            std::array::from_fn(|axis| there[axis] - first[axis])
        })
        .collect();
    let cross = |p: &[f64; 3], q: &[f64; 3]| {
        let at = |a: usize, b: usize| p[a] * q[b] - p[b] * q[a];
        [at(1, 2), at(2, 0), at(0, 1)]
    };
    let over = |p: [f64; 3], size: f64| p.map(|x| x / size);
    let others: Vec<[f64; 3]> = match &x[..] {
        [p] => vec![over(*p, size(body, u, points))],
        [p, q] => {
            // In the plane the normal is the third axis, whichever way the triangle turns.
            let normal = over(cross(p, q), size(body, u, points));
            vec![cross(q, &normal), cross(&normal, p)]
        }
        [p, q, r] => vec![cross(q, r), cross(r, p), cross(p, q)],
        _ => unreachable!("at most four points"),
    };
    let sum = others.iter().fold([0.0; 3], |sum, one| std::array::from_fn(|k| sum[k] - one[k]));
    std::iter::once(sum).chain(others).collect()
}

fn settings() -> MotionSettings {
    let dt = 1.5e-3;
    MotionSettings {
        end: dt * STEPS as f64,
        step: Some(dt),
        rows: STEPS,
        ..MotionSettings::default()
    }
}

fn masses(body: &Body) -> Vec<f64> {
    body.volumes().iter().map(|volume| 1e3 * volume).collect()
}

fn most(row: &Row) -> f64 {
    row.kinetic.max(row.energy.total()).max(row.released).max(row.dissipated.abs())
}

#[test]
fn states_forces_and_what_is_dissipated_are_those_of_loops() {
    for (number, (body, horizon)) in bodies().iter().enumerate() {
        let (d, n) = (body.dimension(), body.positions().len());
        let (energy, again) = (energy(body, *horizon), energy(body, *horizon));
        let mut loops = Loops::new(body, *horizon);
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let (masses, watch, settings) = (masses(body), Watch::default(), settings());
        let mut motion =
            Motion::new(&energy, &masses, start(body, 9), &drive, &settings, &watch).unwrap();
        let mut resumed: Option<Motion<'_>> = None;
        let mut worst = [0.0_f64; 4];
        for step in 0..=STEPS {
            let row = go(&mut motion, step);
            let u = motion.state().displacements.to_vec();
            loops.step(&u);
            let gone = [
                energy.broken().len(),
                energy.broken_cliques(Measure::Area).len(),
                energy.broken_cliques(Measure::Volume).len(),
            ];
            assert_eq!(gone, loops.broken, "body {number} at step {step}");
            let (stored, forces) = loops.forces(&u);
            let mut found = vec![0.0; n];
            energy.forces(&u, &mut found).unwrap();
            let scale = most(&row);
            let of_energies = stored.max(row.released).max(row.dissipated).max(f64::MIN_POSITIVE);
            let errors = [
                off(&energy.states(), &loops.remembered(), 1.0),
                off(&found, &forces, largest(&forces).max(f64::MIN_POSITIVE)),
                (row.dissipated - loops.dissipated)
                    .abs()
                    .max((row.released - loops.released).abs())
                    .max((row.energy.total() - stored).abs())
                    / of_energies,
                row.rounding.abs() / scale,
            ];
            worst.iter_mut().zip(errors).for_each(|(worst, error)| *worst = worst.max(error));
            if step % 20 == 0 {
                let kinds: &[(usize, usize)] = if d == 2 { &[(0, 1)] } else { &[(0, 1), (1, 2)] };
                for (state, kind) in kinds {
                    let (found, expected) = (energy.mean_states(&[*state]), loops.means(*kind));
                    assert!(off(&found, &expected, 1.0) < 1e-12, "body {number} at {step}");
                }
            }
            if step == STEPS / 2 {
                let Snapshot { arrays, notes } = motion.snapshot();
                let arrays = arrays.map(|array| Cow::Owned(array.into_owned()));
                let snapshot = Snapshot { arrays, notes: notes.into_owned().into() };
                let taken_up = Motion::resume(&again, &masses, &drive, &settings, &watch, snapshot);
                resumed = Some(taken_up.unwrap());
            } else if let Some(resumed) = &mut resumed {
                assert_eq!(go(resumed, step), row, "a motion that was taken up");
                assert_eq!(again.states(), energy.states());
            }
        }
        println!("body {number}: {worst:?}, broken {:?}, {}", loops.broken, loops.dissipated);
        let [states, forces, energies, account] = worst;
        assert!(states < 1e-13, "body {number}: {states:e}");
        assert!(forces < 1e-11 && energies < 1e-12, "body {number}: {forces:e} {energies:e}");
        assert!(account < 1e-12, "body {number}: {account:e}");
        assert!(loops.dissipated > 0.0 && loops.released > 0.0);
        assert!(loops.broken[..d].iter().all(|broken| *broken > 3), "{:?}", loops.broken);
    }
}

#[test]
fn threads_do_not_matter() {
    for (body, horizon) in bodies() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = energy(&body, horizon);
                let n = body.positions().len();
                let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
                let (masses, watch, settings) = (masses(&body), Watch::default(), settings());
                let start = start(&body, 9);
                let mut motion =
                    Motion::new(&energy, &masses, start, &drive, &settings, &watch).unwrap();
                let row = go(&mut motion, STEPS);
                let u = motion.state().displacements.to_vec();
                let bits = |all: Vec<f64>| all.into_iter().map(f64::to_bits).collect::<Vec<u64>>();
                (row, u, bits(energy.states()), bits(energy.mean_states(&[0])))
            })
        };
        let alone = run(1);
        assert!([2, 3].into_iter().all(|threads| run(threads) == alone));
    }
}

/// A displacement field that strains areas by some parts of themselves.
fn displacements(n: usize, scale: f64) -> Vec<f64> {
    let mut random = Random(11);
    (0..n).map(|_| scale * random.next()).collect()
}

#[test]
fn load_steps_follow_what_triangles_and_tetrahedra_come_to_remember() {
    for (number, (body, horizon)) in bodies().iter().enumerate() {
        let (d, n) = (body.dimension(), body.positions().len());
        for level in [Level::Fast, Level::Strict] {
            // Nothing breaks.
            let lines = text(d);
            let lines = lines.lines().filter(|line| !line.starts_with("break"));
            let text = lines.collect::<Vec<&str>>().join("\n");
            let of = |follows| remembering_as((body, *horizon), &text, &[], (level, follows));
            let (steps, held) = (of(true), of(false));
            let (first, second) = (displacements(n, 0.008), displacements(n, 0.012));
            for energy in [&steps, &held] {
                energy.advance(&first, 0.5, (0.0, &first)).unwrap();
            }
            let forces = |energy: &Breaking| {
                let mut forces = vec![0.0; n];
                energy.forces(&second, &mut forces).unwrap();
                forces
            };
            // Held they are one energy, to the last bit.
            assert_eq!(forces(&steps), forces(&held), "body {number}");
            steps.follow(Some(0.25));
            let (states, following) = (steps.states(), forces(&steps));
            let scale = largest(&following);
            assert!(off(&following, &forces(&held), scale) > 1e-3, "body {number}");
            let mut loops = Loops::new(body, *horizon);
            loops.never_breaks = true;
            loops.step(&first);
            loops.step(&second);
            let error = off(&following, &loops.forces(&second).1, scale);
            assert!(error < 1e-12, "body {number}: {error:e}");
            tangents_are_derivatives(&steps, &second, 0.1, &text);
            let release = steps.evolve([&first, &second], 0.25).unwrap();
            assert!(release.changed > 0 && release.dissipated > 0.0, "{release:?}");
            assert!(off(&steps.states(), &loops.remembered(), 1.0) < 1e-13, "body {number}");
            steps.remember(&states);
            steps.follow(Some(0.25));
            assert_eq!(forces(&steps), following, "body {number}");
        }
    }
}
