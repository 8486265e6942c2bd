//! Bodies that break by what points gather.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Model, Values, check_text};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::{Breaking, FamilyCriterion, Fracture, Inspection};
use piola_runtime::kernel::{Measure, VariablesLaw};
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::March;
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings};
use piola_runtime::states::StateEnergy;

use crate::bonds::{Random, cloud, lattice};
use crate::families_break::{Case, Left, breaking, flies_apart, the_foremost_goes_first};
use crate::reference::go;
use crate::{Conditions, damage, gathering};

/// Above these break all bonds of a point, by its dilatation, and a bond, by its stretch beyond that of an end.
const LIMITS: [f64; 2] = [0.35, 0.2];

/// The energy of a text whose points gather theta, and with it what it was made of.
fn solid(
    (body, horizon): (&Arc<Body>, f64),
    text: &str,
    level: Level,
) -> (Model, Values, StateEnergy) {
    let (_, model) = check_text(text).unwrap();
    let values = model.values(body.dimension(), &[], Some(horizon)).unwrap();
    let energy = gathering((&model, &values), level, body, horizon);
    (model, values, energy)
}

/// An ordinary state-based body.
fn body((body, horizon): &Case, level: Level) -> Breaking {
    let d = body.dimension();
    let [volume, beyond] = LIMITS;
    let text = format!(
        "potential p\nm = integral(L^2)\ntheta = {d}/m*integral(L*(l - L))\npsi(theta) = 60*theta^2\n\
         psi(l, m) = 300/m*(l - L)^2\nbreak when theta > {volume}\n\
         break when l/L - 1 - theta/{d} > {beyond} and l > L\n"
    );
    let (model, values, energy) = solid((body, *horizon), &text, level);
    let found = model.gathered_criteria(&values, Mode::Jit(level), Form::Accurate).unwrap();
    let criterion = |(number, one): (usize, piola_compiler::GatheredCriterion)| {
        let (margin, holds_at_zero) = (Box::new(one.margin), one.holds_at_zero);
        FamilyCriterion::<Box<dyn VariablesLaw>> { layer: 0, law: 0, number, margin, holds_at_zero }
    };
    let criteria = found.into_iter().enumerate().map(criterion).collect();
    breaking(&(Arc::clone(body), *horizon), energy.with_criteria(criteria))
}

/// The larger of both margins at the ends of a bond.
fn margins(left: &Left<'_>, u: &[f64]) -> Box<dyn Fn([usize; 2]) -> f64> {
    let (d, rest) = (left.body.dimension() as f64, vec![0.0; u.len()]);
    let dilatation = |point: usize| {
        let (mut m, mut sum) = (0.0, 0.0);
        for other in left.family(point) {
            let [now, before] = [u, &rest].map(|u| left.length(u, [point, other]));
            m += left.body.volumes()[other] * before * before;
            sum += left.body.volumes()[other] * before * (now - before);
        }
        if m > 0.0 { d / m * sum } else { 0.0 }
    };
    let theta: Vec<f64> = (0..left.body.n_points()).map(dilatation).collect();
    let n = left.body.n_points();
    let lengths =
        |u: &[f64]| -> Vec<f64> { (0..n * n).map(|k| left.length(u, [k / n, k % n])).collect() };
    let (now, before) = (lengths(u), lengths(&rest));
    Box::new(move |[p, q]| {
        let (now, before) = (now[p * n + q], before[p * n + q]);
        let of = |end: usize| {
            let beyond = now / before - 1.0 - theta[end] / d - LIMITS[1];
            (theta[end] / LIMITS[0] - 1.0).max(beyond.min(now - before) / LIMITS[1])
        };
        of(p).max(of(q))
    })
}

fn bodies() -> [Case; 2] {
    [(cloud(&[9, 6], 0.1, 5), 0.25), (cloud(&[5, 4, 3], 0.1, 6), 0.2)]
}

#[test]
fn bonds_break_by_what_points_gather_as_loops_say() {
    for case in &bodies() {
        let run = |threads, level| flies_apart(case, threads, || body(case, level), &margins);
        assert_eq!(run(1, Level::Fast), run(2, Level::Fast));
        run(1, Level::Strict);
    }
}

#[test]
fn the_foremost_of_what_is_gathered_goes_first() {
    for case in &bodies() {
        let energy = body(case, Level::Strict);
        let mut random = Random(21);
        let x = case.0.positions().iter();
        let u: Vec<f64> = x.map(|x| 0.05 * x + 0.01 * random.next()).collect();
        the_foremost_goes_first(case, &energy, &u, &margins);
        // Of either end: its dilatation, and the stretch beyond it.
        assert_eq!(energy.look_at(0, &u).unwrap().margins.len(), 4);
    }
}

/// Forces along the rows of a lattice say which bonds may break, also where rows have gaps and what broke comes back:
/// what breaks is what breaks where all bonds are judged.
#[test]
fn what_rows_watch_breaks_as_what_is_judged() {
    let bodies = [
        (lattice(&[0.0, 0.0], &[30, 16], 0.1), 0.25),
        (lattice(&[0.0, 0.0, 0.0], &[14, 4, 9], 0.1), 0.21),
    ];
    for case in &bodies {
        let (body, horizon) = case;
        let d = body.dimension();
        let text = format!(
            "potential p\nm = integral(L^2)\ntheta = {d}/m*integral(L*(l - L))\npsi(theta) = 60*theta^2\n\
             psi(l, m) = 300/m*(l - L)^2\n"
        );
        let made = |along_rows: bool| {
            let (_, _, energy) = solid((body, *horizon), &text, Level::Fast);
            assert_eq!(energy.report().ways, ["families", "rows"]);
            let energy = if along_rows { energy } else { energy.in_batches() };
            let criterion = ("l/L - 1 > s0", 0.12, Level::Fast);
            damage::breaking((body, *horizon), Box::new(energy), criterion, &[3, 4])
        };
        let (_, _, mut energy) = solid((body, *horizon), &text, Level::Fast);
        let n_bonds = made(true).n_bonds();
        assert!(energy.watch(&vec![1e-3; n_bonds]));
        energy
            .forces(&vec![0.0; body.positions().len()], &mut vec![0.0; body.positions().len()])
            .unwrap();
        assert_eq!(
            energy.exceeding(Measure::Length),
            Some(Vec::new()),
            "nothing is judged at rest"
        );
        let (watched, judged) = (made(true), made(false));
        let n = body.positions().len();
        let mut random = Random(9);
        let x = |dof: usize| body.positions()[dof - dof % d];
        // One end flies apart, and waves run to the other.
        let velocity = |dof: usize| match x(dof) < 0.5 {
            true => 6.0 * body.positions()[dof] + 2.0 * random.next(),
            false => 0.0,
        };
        let velocities: Vec<f64> = (0..n).map(velocity).collect();
        let start = Initial { displacements: vec![0.0; n], velocities };
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let settings =
            MotionSettings { end: 0.1, step: Some(1e-3), rows: 100, ..MotionSettings::default() };
        let watch = Watch::default();
        let made = Motion::new(&watched, body.volumes(), start, &drive, &settings, &watch);
        let mut motion = made.unwrap();
        let still = vec![0.0; n];
        let mut early = None;
        for step in 0..=100 {
            go(&mut motion, step);
            let u = motion.state().displacements;
            judged.advance(u, 0.0, (0.0, &still)).unwrap();
            assert_eq!(watched.broken(), judged.broken(), "step {step}");
            if step == 40 {
                early = Some((watched.gone(), u.to_vec()));
            }
        }
        let (last, (gone, u)) = (motion.state().displacements.to_vec(), early.unwrap());
        let n_broken = watched.broken().len();
        println!("{n_broken} of {} bonds", watched.n_bonds());
        assert!(gone.bonds.len() > 10 && n_broken > gone.bonds.len());
        drop(motion);
        for u in [&u, &last] {
            for energy in [&watched, &judged] {
                energy.restore(&gone);
                energy.forces(u, &mut still.clone()).unwrap();
                energy.advance_behind_forces(u, (0.0, &still)).unwrap();
            }
            assert_eq!(watched.broken(), judged.broken());
            let is_later = u == &last;
            assert_eq!(watched.broken().len() > gone.bonds.len(), is_later);
        }
    }
}
