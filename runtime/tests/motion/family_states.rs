//! Bodies whose deformation gradients remember, or whose points do with what they gather, against loops over what
//! is left: states, breaks by them, energies and what is dissipated.

use std::sync::Arc;

use nalgebra::DMatrix;
use piola_compiler::{Form, Level, Mode, Of, Values, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::influence::Constant;
use piola_runtime::deformation::{
    DeformationEnergy, Discretisation, Formulation, OperatorOrder, Stabilisation,
};
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::Criteria;
use piola_runtime::fracture::memory::{self, Memory};
use piola_runtime::fracture::{Breaking, FamilyCriterion, FamilyNextState, Fracture, Inspection};
use piola_runtime::kernel::{Law, Measure, VariablesLaw};
use piola_runtime::materials::{Fields, Materials, StateOf};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings, Row, Snapshot};
use piola_runtime::states::{StateEnergy, StateLaws};

use crate::Conditions;
use crate::bonds::{Random, cloud, lattice};
use crate::families::largest;
use crate::families_break::{Case, Left};
use crate::gradients::of_point;
use crate::reference::{go, off};

const STEPS: usize = 80;

const DT: f64 = 1e-3;

/// A strain and a life that break bonds.
const LIMITS: [f64; 2] = [0.12, 0.985];

/// How far a dilatation gives way, and a remembered one that breaks.
const YIELDS: [f64; 2] = [0.03, 0.35];

fn text(kind: Option<Discretisation>, d: usize) -> String {
    let ([k, life], [y, q]) = (LIMITS, YIELDS);
    match kind {
        Some(_) => format!(
            "potential p\nstate k = 0\nstate life = 1\ng = E : E\nupdate k = max(k, sqrt(g))\n\
             update life = life - 9*max(0, J - 1 - k)*dt\n\
             psi(F) = life/(1 + 4*k)*(60*tr(E)^2 + 160*g)\n\
             break when k > {k} and J > 1\nbreak when life < {life}\n"
        ),
        None => format!(
            "potential p\nm = integral(L^2)\ntheta = {d}/m*integral(L*(l - L))\nstate p = 0\nstate q = 0\n\
             update p = if abs(theta - p) > {y} then theta - sign(theta - p)*{y} else p\n\
             update q = max(q, abs(theta)) + abs(p)*dt\npsi(theta) = 60*(theta - p)^2\n\
             psi(l, m) = 300/m/(1 + q)*(l - L)^2\nbreak when q > {q}\n\
             break when l/L - 1 > 0.3 + q/2\n"
        ),
    }
}

/// A body with gradients of this kind, or one that gathers.
fn body((body, horizon): &Case, kind: Option<Discretisation>, level: Level) -> Breaking {
    let d = body.dimension();
    let (_, model) = check_text(&text(kind, d)).unwrap();
    let values = model.values(d, &[], Some(*horizon)).unwrap();
    let values = values.with_states(&model).following_states(&model);
    let mode = Mode::Jit(level);
    let stored_at = |kind_of: Of| match (kind_of, kind) {
        (Of::Measure(measure), _) => StateOf::Interactions(measure),
        (_, Some(Discretisation::BondQuadrature)) => StateOf::Interactions(Measure::Length),
        _ => StateOf::Points,
    };
    let kinds = values.fields.iter().map(|k| model.kind_of_state(usize::from(*k)).map(stored_at));
    let materials = materials(body, &values, kinds.collect());
    let neighborhood = Arc::new(Neighborhood::new(body, *horizon).unwrap());
    let form = Form::Accurate;
    let compiled = model.compile(&values, mode, form).unwrap();
    let found = (Arc::clone(body), Arc::clone(&neighborhood), Some(Arc::clone(&materials)));
    let energy: Box<dyn Energy> = match kind {
        Some(discretisation) => {
            let order = OperatorOrder::First;
            let formulation =
                Formulation { horizon: *horizon, order, discretisation, influence: &Constant };
            let criteria = model.gradient_criteria(&values, mode, form).unwrap();
            let criteria = criteria.into_iter().map(|one| (boxed(one.margin), one.holds_at_zero));
            let next = model.gradient_next_states(&values, mode, form).unwrap();
            let next = next.into_iter().map(|one| (one.field, boxed(one.next)));
            let law = boxed(compiled.gradient.unwrap());
            let (body, neighborhood, materials) = found;
            let energy =
                DeformationEnergy::of_materials(body, neighborhood, formulation, materials, law);
            let energy = energy.unwrap().with_criteria(self::criteria(criteria));
            Box::new(energy.with_next_states(next_states(next)))
        }
        None => {
            let kernels = compiled.gathered.unwrap();
            let laws = StateLaws {
                of_law: Vec::new(),
                integrals: kernels
                    .integrals
                    .into_iter()
                    .map(|g| Box::new(g) as Box<dyn Law>)
                    .collect(),
                points: kernels.points.map(boxed),
                bonds: kernels.bonds.map(boxed),
                arguments: ["theta", "l, m"].map(String::from),
            };
            let criteria = model.gathered_criteria(&values, mode, form).unwrap();
            let criteria = criteria.into_iter().map(|one| (boxed(one.margin), one.holds_at_zero));
            let next = model.gathered_next_states(&values, mode, form).unwrap();
            let next = next.into_iter().map(|one| (one.field, boxed(one.next)));
            let (body, neighborhood, materials) = found;
            let energy = StateEnergy::of_materials(body, neighborhood, materials, laws).unwrap();
            let energy = energy.with_criteria(self::criteria(criteria));
            Box::new(energy.with_next_states(next_states(next)))
        }
    };
    let layer = memory::Layer { of_law: vec![Vec::new()], materials };
    let around = (&**body, &*neighborhood);
    let never = vec![false; body.n_points()];
    let status = (Criteria::new(around, Vec::new(), never), Memory::new(around, vec![layer]));
    let names = Arc::clone(energy.parts());
    Breaking::new((Arc::clone(body), neighborhood), vec![energy], names, status, Vec::new())
}

fn boxed(law: impl VariablesLaw + 'static) -> Box<dyn VariablesLaw> {
    Box::new(law)
}

fn criteria(all: impl Iterator<Item = (Box<dyn VariablesLaw>, bool)>) -> Vec<FamilyCriterion> {
    let criterion = |(number, (margin, holds_at_zero))| FamilyCriterion {
        layer: 0,
        law: 0,
        number,
        margin,
        holds_at_zero,
    };
    all.enumerate().map(criterion).collect()
}

fn next_states(all: impl Iterator<Item = (usize, Box<dyn VariablesLaw>)>) -> Vec<FamilyNextState> {
    all.map(|(field, next)| FamilyNextState { law: 0, field, next }).collect()
}

/// One material whose states begin everywhere with the same; the last field is the time step.
fn materials(body: &Body, values: &Values, kinds: Vec<Option<StateOf>>) -> Arc<Materials> {
    let typical: Vec<f64> =
        values.fields.iter().map(|field| values.parameters[usize::from(*field)]).collect();
    let fields = Fields::new(body.n_points(), std::slice::from_ref(&typical), true);
    let fields = fields.with_states(kinds).with_time_steps(vec![typical.len() - 1]);
    for (field, value) in typical.iter().enumerate() {
        (0..body.n_points()).for_each(|point| fields.set(field, point, *value));
    }
    let materials = Materials::new(vec![0; body.n_points()], Vec::new());
    Arc::new(materials.with_fields(Arc::new(fields)))
}

/// What loops know of a body.
struct Loops<'a> {
    kind: Option<Discretisation>,
    left: Left<'a>,
    /// Both states of each point, or of each bond by its ends.
    states: Vec<[f64; 2]>,
    dissipated: f64,
}

impl<'a> Loops<'a> {
    fn new(case: &'a Case, kind: Option<Discretisation>) -> Loops<'a> {
        let left = Left::of(case);
        let n = if kind == Some(Discretisation::BondQuadrature) {
            left.all.len()
        } else {
            case.0.n_points()
        };
        let begin = if kind.is_some() { [0.0, 1.0] } else { [0.0, 0.0] };
        Loops { kind, left, states: vec![begin; n], dissipated: 0.0 }
    }

    /// The gradients of places: of points, or of bonds; nothing of those that have none.
    fn gradients(&self, u: &[f64]) -> Vec<Option<DMatrix<f64>>> {
        let (n, d) = (self.left.body.n_points(), self.left.body.dimension());
        let points: Vec<_> = (0..n).map(|point| of_point(&self.left, u, point)).collect();
        if self.kind != Some(Discretisation::BondQuadrature) {
            return points;
        }
        let of = |end: usize| points[end].clone().unwrap_or_else(|| DMatrix::zeros(d, d));
        let bond = |(number, &ends): (usize, &[usize; 2])| {
            if self.left.broken.contains(&number) {
                return None;
            }
            let mean = 0.5 * (of(ends[0]) + of(ends[1]));
            let along = |x: &[f64]| DMatrix::from_vec(d, 1, self.left.along(x, ends));
            let (dx, eta) = (along(self.left.body.positions()), along(u));
            let missing = eta - &mean * &dx;
            Some(mean + missing * dx.transpose() / dx.norm_squared())
        };
        self.left.all.iter().enumerate().map(bond).collect()
    }

    /// The trace of the strain, its norm and the change of volume.
    fn strains(h: &DMatrix<f64>) -> [f64; 3] {
        let one = DMatrix::identity(h.nrows(), h.nrows());
        let f = &one + h;
        let e = 0.5 * (f.transpose() * &f - one);
        [e.trace(), e.norm(), f.determinant() - 1.0]
    }

    /// The sum of weights, the dilatation of a point, and the sum of the squares of changes of length.
    fn gathered(&self, u: &[f64], point: usize) -> [f64; 3] {
        let (d, rest) = (self.left.body.dimension() as f64, vec![0.0; u.len()]);
        let (mut m, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for other in self.left.family(point) {
            let [now, before] = [u, &rest].map(|u| self.left.length(u, [point, other]));
            let volume = self.left.body.volumes()[other];
            m += volume * before * before;
            sum += volume * before * (now - before);
            squares += volume * (now - before) * (now - before);
        }
        [m, if m > 0.0 { d / m * sum } else { 0.0 }, squares]
    }

    /// The energy of what is left, at states of points.
    fn stored(&self, u: &[f64], states: &[[f64; 2]]) -> f64 {
        let of_gradient = |h: &DMatrix<f64>, [k, life]: [f64; 2]| {
            let [trace, norm, _] = Loops::strains(h);
            life / (1.0 + 4.0 * k) * (60.0 * trace * trace + 160.0 * norm * norm)
        };
        let of_gathered = |point: usize, [p, q]: [f64; 2]| {
            let [m, theta, squares] = self.gathered(u, point);
            if m == 0.0 {
                // Alone, and as at rest.
                return 60.0 * p * p;
            }
            60.0 * (theta - p) * (theta - p) + 0.5 * 300.0 / m / (1.0 + q) * squares
        };
        let gradients = self.kind.map(|_| self.gradients(u));
        let density = |point: usize| match &gradients {
            Some(all) => all[point].as_ref().map_or(0.0, |h| of_gradient(h, states[point])),
            None => of_gathered(point, states[point]),
        };
        let volumes = self.left.body.volumes().iter().enumerate();
        volumes.map(|(point, volume)| volume * density(point)).sum()
    }

    /// Judges all bonds by states as they are, changes these, and takes out what breaks.
    fn step(&mut self, u: &[f64], dt: f64) {
        let places: Vec<Option<(bool, [f64; 2])>> = match self.kind {
            Some(_) => {
                let place = |(h, &[k, life]): (&Option<DMatrix<f64>>, &[f64; 2])| {
                    let [_, norm, grown] = Loops::strains(h.as_ref()?);
                    let breaks = k > LIMITS[0] && grown > 0.0 || life < LIMITS[1];
                    Some((breaks, [k.max(norm), life - 9.0 * (grown - k).max(0.0) * dt]))
                };
                self.gradients(u).iter().zip(&self.states).map(place).collect()
            }
            None => {
                let place = |(point, &[p, q]): (usize, &[f64; 2])| {
                    let [m, theta, _] = self.gathered(u, point);
                    let over = theta - p;
                    let next =
                        if over.abs() > YIELDS[0] { theta - over.signum() * YIELDS[0] } else { p };
                    (m > 0.0).then(|| (q > YIELDS[1], [next, q.max(theta.abs()) + p.abs() * dt]))
                };
                self.states.iter().enumerate().map(place).collect()
            }
        };
        let rest = vec![0.0; u.len()];
        let breaks = |(number, ends): (usize, &[usize; 2])| {
            let by = |place: usize| places[place].is_some_and(|place| place.0);
            let goes = match self.kind {
                Some(Discretisation::BondQuadrature) => by(number),
                Some(_) => ends.iter().any(|end| by(*end)),
                None => {
                    let stretch = self.left.length(u, *ends) / self.left.length(&rest, *ends) - 1.0;
                    let beyond = |end: &usize| stretch > 0.3 + self.states[*end][1] / 2.0;
                    ends.iter().any(|end| by(*end) || beyond(end))
                }
            };
            (goes && !self.left.broken.contains(&number)).then_some(number)
        };
        let broken: Vec<usize> = self.left.all.iter().enumerate().filter_map(breaks).collect();
        let mut states = self.states.clone();
        for (number, place) in places.iter().enumerate() {
            let goes =
                self.kind == Some(Discretisation::BondQuadrature) && broken.contains(&number);
            if let Some((_, next)) = place.filter(|_| !goes) {
                states[number] = next;
            }
        }
        if self.kind != Some(Discretisation::BondQuadrature) {
            self.dissipated += self.stored(u, &self.states) - self.stored(u, &states);
        }
        self.states = states;
        self.left.broken.extend(broken);
    }
}

/// Lets a body fly apart, with as many threads, taken up again halfway.
fn flies_apart(
    case: &Case,
    threads: usize,
    kind: Option<Discretisation>,
    level: Level,
) -> Vec<Row> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let (body, n) = (&case.0, case.0.positions().len());
        let (energy, again) = (self::body(case, kind, level), self::body(case, kind, level));
        let mut loops = Loops::new(case, kind);
        let mut random = Random(9);
        let velocity = |x: &f64| 8.0 * x + 2.0 * random.next();
        let velocities = body.positions().iter().map(velocity).collect();
        let start = Initial { displacements: vec![0.0; n], velocities };
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let settings = MotionSettings {
            end: DT * STEPS as f64,
            step: Some(DT),
            rows: STEPS,
            ..MotionSettings::default()
        };
        let watch = Watch::default();
        let made = Motion::new(&energy, body.volumes(), start, &drive, &settings, &watch);
        let (mut motion, mut resumed) = (made.unwrap(), None::<Motion<'_>>);
        let (mut worst, mut rows) = ([0.0_f64; 4], Vec::<Row>::new());
        for step in 0..=STEPS {
            let row = go(&mut motion, step);
            let u = motion.state().displacements;
            loops.step(u, if step == 0 { 0.0 } else { DT });
            assert!(energy.broken().iter().eq(&loops.left.broken), "step {step}");
            let expected: Vec<f64> =
                (0..2).flat_map(|k| loops.states.iter().map(move |own| own[k])).collect();
            worst[0] = worst[0].max(off(&energy.states(), &expected, largest(&expected).max(1e-3)));
            let most = row.kinetic.max(row.energy.total()).max(row.dissipated.abs());
            worst[1] = worst[1].max(row.rounding.abs() / most);
            if kind != Some(Discretisation::BondQuadrature) {
                worst[2] = worst[2].max((row.dissipated - loops.dissipated).abs() / most);
                if !matches!(kind, Some(Discretisation::Stabilised(_))) {
                    let stored = loops.stored(u, &loops.states);
                    worst[3] = worst[3].max((row.energy.total() - stored).abs() / most);
                }
            }
            if step == STEPS / 2 {
                let Snapshot { arrays, notes } = motion.snapshot();
                let arrays = arrays.map(|array| array.into_owned().into());
                let snapshot = Snapshot { arrays, notes: notes.into_owned().into() };
                let masses = body.volumes();
                let made = Motion::resume(&again, masses, &drive, &settings, &watch, snapshot);
                resumed = Some(made.unwrap());
            } else if let Some(resumed) = &mut resumed {
                assert_eq!(go(resumed, step), row, "a motion that was taken up");
                assert_eq!(again.states(), energy.states());
            }
            rows.push(row);
        }
        let (broken, all) = (loops.left.broken.len(), loops.left.all.len());
        println!("{kind:?}: {broken} of {all}; states, account, dissipated, stored {worst:?}");
        assert!(broken > 10 && broken < all && rows[STEPS].dissipated > 0.0);
        assert!(worst[1] < 1e-12 && worst.iter().all(|error| *error < 1e-11), "{worst:?}");
        rows
    })
}

const KINDS: [Option<Discretisation>; 4] = [
    Some(Discretisation::Nodal),
    Some(Discretisation::Stabilised(Stabilisation::Wan)),
    Some(Discretisation::BondQuadrature),
    None,
];

fn bodies() -> [Case; 3] {
    [
        (cloud(&[9, 6], 0.1, 5), 0.25),
        (cloud(&[5, 4, 3], 0.1, 6), 0.2),
        (lattice(&[0.0, 0.0], &[11, 6], 0.1), 0.25),
    ]
}

#[test]
fn families_remember_as_loops_say_and_the_account_closes() {
    for (case, kind) in bodies().iter().flat_map(|case| KINDS.map(|kind| (case, kind))) {
        let run = |threads| flies_apart(case, threads, kind, Level::Fast);
        assert_eq!(run(1), run(2));
    }
    flies_apart(&bodies()[0], 1, KINDS[2], Level::Strict);
    flies_apart(&bodies()[0], 1, KINDS[3], Level::Strict);
}

/// Forces are derivatives of the energy at what is remembered, the tangent is theirs, stored as well as
/// multiplied with, and symmetric.
#[test]
fn there_is_one_energy_at_what_is_remembered() {
    for (case, kind) in bodies().iter().flat_map(|case| KINDS.map(|kind| (case, kind))) {
        let energy = body(case, kind, Level::Fast);
        let (d, mut random) = (case.0.dimension(), Random(21));
        let x = case.0.positions().iter().enumerate();
        let strain = [0.1, -0.02, 0.04];
        let u: Vec<f64> = x.map(|(k, x)| strain[k % d] * x + 0.004 * random.next()).collect();
        let before = energy.energy(&u).unwrap().total();
        let release = energy.advance(&u, 1e-3, (0.0, &u)).unwrap();
        assert!(release.changed > 20, "{release:?}");
        let after = energy.energy(&u).unwrap().total();
        assert!((before - after - release.dissipated - release.energy).abs() < 1e-13 * before);
        let moved =
            |p: &[f64], h: f64| -> Vec<f64> { u.iter().zip(p).map(|(u, p)| u + h * p).collect() };
        let mut random = || -> Vec<f64> { u.iter().map(|_| random.next()).collect() };
        let (p, q) = (random(), random());
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let mut forces = vec![0.0; u.len()];
        energy.tangent(&u, &mut forces, &mut tangent).unwrap();
        let h = 1e-6;
        let at = |h: f64| energy.energy(&moved(&p, h)).unwrap().total();
        let power = (at(h) - at(-h)) / (2.0 * h);
        let scale = largest(&forces) * u.len() as f64;
        assert!((power - dot(&forces, &p)).abs() < 1e-7 * scale, "{kind:?}");
        let at = |h: f64| {
            let mut forces = vec![0.0; u.len()];
            energy.forces(&moved(&p, h), &mut forces).unwrap();
            forces
        };
        let [plus, minus] = [at(h), at(-h)];
        let by_differences: Vec<f64> =
            plus.iter().zip(&minus).map(|(a, b)| (a - b) / (2.0 * h)).collect();
        let mut product = vec![0.0; u.len()];
        energy.hessian(&u).unwrap().multiply(&p, &mut product);
        let scale = largest(&product);
        assert!(off(&product, &by_differences, scale) < 1e-6, "{kind:?}");
        assert!(off(&product, &tangent.multiply(&p), scale) < 1e-12, "{kind:?}");
        let skew = (dot(&tangent.multiply(&p), &q) - dot(&tangent.multiply(&q), &p)).abs();
        assert!(skew < 1e-12 * scale * u.len() as f64, "{kind:?}");
    }
}

/// What is seen of states is what points remember, or the mean over their bonds; a bond shows its own, or the
/// mean of its ends'.
#[test]
fn states_are_seen() {
    for kind in KINDS {
        let case = &bodies()[0];
        let energy = body(case, kind, Level::Fast);
        let u: Vec<f64> = case.0.positions().iter().map(|x| 0.1 * x).collect();
        energy.advance(&u, 0.0, (0.0, &u)).unwrap();
        let all = energy.states();
        let first = &all[..all.len() / 2];
        let means = energy.mean_states(&[0]);
        // All stretch alike.
        assert!(first[0] > 0.05 && off(first, &vec![first[0]; first.len()], 1.0) < 1e-12);
        assert!(off(&means, &vec![first[0]; means.len()], 1.0) < 1e-12, "{kind:?}");
        let shown = energy.look_at(0, &u).unwrap().states;
        assert!(shown.len() == 2 && (shown[0].unwrap() - first[0]).abs() < 1e-12, "{kind:?}");
    }
}
