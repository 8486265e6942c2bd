//! A case of which each rank has its part: points, materials, sets.

use std::ops::Range;
use std::sync::Arc;

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::assembly::AssemblyError;
use piola_mechanics::body::Body;
use piola_mechanics::neighborhood::Neighborhood;
use piola_mechanics::weights::Weights;
use piola_output::summary::{Number, ProbeSummary};
use piola_petsc::Engine;

use super::lattice::Layers;
use super::scatter::{Received, scattered};
use super::share::Share;
use super::steps::agreed;
use crate::case::{Case, CaseError};
use crate::scene::boundary::BoundaryConditions;
use crate::scene::selection::{
    PointSet, ProbePoint, Selection, empty_set, nearest, probe_outside, set_of,
};
use crate::simulation::forecast::enough_points;
use crate::simulation::run::RunError;

/// A case of which each rank has its part.
pub struct Parts {
    /// Of what the rank holds.
    pub(super) case: Case,
    pub(super) share: Share,
    /// How many points the whole body has.
    pub(super) n_points: usize,
    /// The sets of what the rank holds, with volumes of whole sets; the points of probes by their number in the body.
    pub(super) selection: Selection,
    /// Where probes are.
    pub(super) probes: Vec<ProbeSummary>,
    /// Whether the points are of a mesh, whose cells rank 0 has.
    pub(super) is_mesh: bool,
    /// What to know before the run.
    warnings: Vec<Diagnostic>,
}

impl Parts {
    /// Reads the points of a case without points. Of a lattice each rank makes its part; of clouds and meshes, and of
    /// lattices whose sets stand in files, rank 0 reads the whole, and each rank gets its part. Collective.
    ///
    /// # Errors
    /// On all ranks what is wrong with points and sets; more ranks than points.
    pub fn read(outline: Case, engine: &Engine) -> Result<Parts, RunError> {
        let of = (engine.rank(), engine.ranks());
        let made = match outline.box_in_slabs() {
            Some(shape) => {
                let layers = agreed(engine, Layers::count(&outline.scene, shape, engine))?;
                let n_points = layers.n_points();
                agreed(engine, enough_points(n_points, engine.ranks()))?;
                let (share, held) = layers.share(outline.reach(), of);
                let slab = layers.slab(&share, held, outline.scene.horizon_radius());
                let (body, warnings) = agreed(engine, slab)?;
                let mut case = outline.clone();
                case.warnings.extend(warnings);
                Received { case, body, share, n_points }
            }
            None => scattered(outline, engine)?,
        };
        let Received { case, body, share, n_points } = made;
        let case = agreed(engine, case.with_slab(body, &|here| anywhere(engine, here)))?;
        let middle = |count, n_fields, value: &dyn Fn(usize) -> Option<Vec<f64>>| {
            in_the_middle(engine, count, n_fields, value)
        };
        let case = agreed(engine, case.with_fields_of(share.own_of_held(), &middle))?;
        Parts::select((case, share), n_points, engine)
    }

    /// Looks for sets and probes. Collective.
    fn select(
        (mut case, share): (Case, Share),
        n_points: usize,
        engine: &Engine,
    ) -> Result<Parts, RunError> {
        if case.scene.horizon.weights == Weights::Truncated {
            know_most_neighbors(&mut case, &share, engine)?;
        }
        let is_mesh = anywhere(engine, case.mesh.is_some());
        let mut warnings = std::mem::take(&mut case.warnings);
        let (scene, body, own) = (&case.scene, case.body.as_ref(), share.own_of_held());
        let (mut sets, mut errors) = (Vec::new(), Vec::new());
        let ends = ends(body, own.clone(), engine);
        for number in 0..scene.sets.len() {
            let (set, warning) = set_of(scene, body, number);
            warnings.extend(warning);
            let mine = || set.points.iter().filter(|point| own.contains(point));
            let volume = mine().fold(0.0, |sum, point| sum + body.volumes()[*point]);
            let mut sums = [mine().count() as f64, volume];
            engine.sum(&mut sums);
            if sums[0] == 0.0 {
                errors.push(empty_set(scene, number, &ends));
            }
            sets.push(PointSet { volume: sums[1], ..set });
        }
        let (mut probes, mut told) = (Vec::new(), Vec::new());
        for probe in &scene.probes {
            let (point, place) = nearest_of_all(&case, &share, &probe.at.value, engine);
            errors.extend(probe_outside(scene, probe, (&place, point.1)));
            probes.push(ProbePoint {
                name: probe.name.value.clone(),
                point: point.0,
                distance: point.1,
            });
            let numbers = |place: &[f64]| place.iter().copied().map(Number).collect();
            let (at, point) = (numbers(&probe.at.value), numbers(&place));
            told.push(ProbeSummary { name: probe.name.value.clone(), at, point });
        }
        let found = match errors.is_empty() {
            true => Ok(()),
            false => Err(CaseError::Scene(scene.report(errors))),
        };
        agreed(engine, found)?;
        let selection = Selection { sets, probes, warnings: Vec::new() };
        let conditions = BoundaryConditions::new(scene, body, &selection);
        let idle = agreed(engine, conditions.map(|one| one.warnings).map_err(CaseError::from))?;
        warnings.extend(idle);
        let warnings = of_all(engine, warnings);
        Ok(Parts { case, share, n_points, selection, probes: told, is_mesh, warnings })
    }

    /// The case of what this rank holds.
    pub fn case(&self) -> &Case {
        &self.case
    }

    /// What to know before the run; spans as in [`crate::scene::Scene::report`]. Counts of points are those of the first
    /// rank that has something to say.
    pub fn warnings(&self) -> &[Diagnostic] {
        &self.warnings
    }
}

/// So many numbers at the middle one of some points, of which this rank has `count`, in the order of the ranks; nothing
/// where there is none. Collective.
fn in_the_middle(
    engine: &Engine,
    count: usize,
    n: usize,
    value: &dyn Fn(usize) -> Option<Vec<f64>>,
) -> Option<Vec<f64>> {
    let counts = engine.all_gather(count as u64);
    let middle = counts.iter().sum::<u64>() / 2;
    let before = counts[..engine.rank()].iter().sum::<u64>();
    let own = (before..before + count as u64).contains(&middle).then_some(middle - before);
    let found = own.and_then(|number| value(number as usize));
    let mut numbers = found
        .as_ref()
        .map_or_else(|| vec![0.0; n + 1], |found| found.iter().copied().chain([1.0]).collect());
    engine.sum(&mut numbers);
    (numbers.pop() == Some(1.0)).then_some(numbers)
}

/// Whether something is so on any rank. Collective.
fn anywhere(engine: &Engine, here: bool) -> bool {
    engine.all_gather(u64::from(here)).contains(&1)
}

/// Where weights compare a point's family with the largest of the body, its part knows that. Collective.
fn know_most_neighbors(case: &mut Case, share: &Share, engine: &Engine) -> Result<(), RunError> {
    let found = Neighborhood::new(&case.body, case.scene.horizon_radius());
    let found = agreed(engine, found.map_err(AssemblyError::from).map_err(CaseError::from))?;
    let most = share.own_of_held().map(|point| found.row(point).len()).max();
    let most = engine.all_gather(most.unwrap_or(0) as u64).into_iter().max();
    let body = case.body.as_ref().clone();
    case.body = Arc::new(body.with_most_neighbors(most.unwrap_or(0) as usize));
    Ok(())
}

/// The lowest coordinates of all points of a body, and behind them the highest, in m; `own` are those of this rank.
/// Collective.
pub(super) fn ends(body: &Body, own: Range<usize>, engine: &Engine) -> Vec<f64> {
    let d = body.dimension();
    let mut ends = vec![f64::NEG_INFINITY; 2 * d];
    for point in own {
        for (axis, x) in body.position(point).iter().enumerate() {
            ends[axis] = ends[axis].max(-x);
            ends[d + axis] = ends[d + axis].max(*x);
        }
    }
    engine.max(&mut ends);
    ends[..d].iter_mut().for_each(|low| *low = -*low);
    ends
}

/// The point of the body that is next to a place: its number in the body, how far it is in m, and where; of several the
/// one that the user listed first. Collective.
fn nearest_of_all(
    case: &Case,
    share: &Share,
    place: &[f64],
    engine: &Engine,
) -> ((usize, f64), Vec<f64>) {
    // A point of the halo is its owner's, too, and found there.
    let (point, _) = nearest(&case.body, place);
    let user = u64::from(case.body.user_index()[point]);
    // Squares decide, as where all points are there; numbers that are not negative are in the order of their bits.
    let square: f64 =
        case.body.position(point).iter().zip(place).map(|(x, y)| (x - y) * (x - y)).sum();
    let all = engine.all_gather(square.to_bits());
    let (least, users) = (all.iter().min().copied(), engine.all_gather(user));
    let first = all.iter().zip(&users).filter(|(bits, _)| Some(**bits) == least);
    let first = first.map(|(_, user)| *user).min();
    let is_mine = Some(square.to_bits()) == least && Some(user) == first;
    let numbers =
        engine.all_gather(if is_mine { (share.held.start + point) as u64 } else { u64::MAX });
    let number = numbers.into_iter().min().unwrap_or(0) as usize;
    let mut found = vec![f64::NEG_INFINITY; case.body.dimension()];
    if is_mine {
        found.copy_from_slice(case.body.position(point));
    }
    engine.max(&mut found);
    ((number, f64::from_bits(least.unwrap_or(0)).sqrt()), found)
}

/// Warnings that some ranks may have and others not: of where points are.
const OF_PLACES: [&str; 2] = ["boundary-on-points", "load-on-prescribed"];

/// What to know of a body of whose parts these warnings are: what has no effect has none on any rank, and what is
/// found on any is so. On rank 0, where what others alone have found has no more than its message. Collective.
fn of_all(engine: &Engine, own: Vec<Diagnostic>) -> Vec<Diagnostic> {
    let place = |one: &Diagnostic| (one.code.to_owned(), one.span.start, one.span.end);
    let line = |one: &Diagnostic| {
        let (code, start, end) = place(one);
        format!("{code}\t{start}\t{end}\t{}\n", one.message)
    };
    let lines: String = own.iter().map(line).collect();
    let Some(all) = engine.gather(lines.as_bytes()) else { return Vec::new() };
    let parsed = |line: &str| -> Option<((String, u32, u32), String)> {
        let mut words = line.splitn(4, '\t');
        let code = words.next()?.to_owned();
        let (start, end) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
        Some(((code, start, end), words.next()?.to_owned()))
    };
    let found = |bytes: &Vec<u8>| -> Vec<_> {
        String::from_utf8_lossy(bytes).lines().filter_map(parsed).collect()
    };
    let all: Vec<Vec<_>> = all.iter().map(found).collect();
    let everywhere = |one: &Diagnostic| {
        all.iter().all(|found| found.iter().any(|(known, _)| *known == place(one)))
    };
    let mut warnings: Vec<Diagnostic> =
        own.into_iter().filter(|one| one.code != "idle-entry" || everywhere(one)).collect();
    for ((code, start, end), message) in all.iter().skip(1).flatten() {
        let is_known = warnings.iter().any(|one| place(one) == (code.clone(), *start, *end));
        if let Some(code) = OF_PLACES.iter().find(|known| *known == code).filter(|_| !is_known) {
            warnings.push(Diagnostic::warning(code, Span { start: *start, end: *end }, message));
        }
    }
    warnings
}
