//! The history of one bond: how close it came to breaking, and why it broke or did not.
//!
//! The scene is run as ever, and nothing is written. Of a motion every step is looked at, of load steps every
//! equilibrium; the rows are those of the tables.

mod place;
mod text;

use std::ops::ControlFlow;
use std::time::Duration;

use piola_compiler::Measure;
use piola_mechanics::energy::{Energy as _, NonFinite};
use piola_mechanics::fracture::{Fracture, Judged, Look, over_rest};
use piola_output::summary::ExitReason;
use piola_solvers::Watch;
use piola_solvers::march::{Advance, March as _, State};
use piola_solvers::motion;
use piola_solvers::steps::{StepError, StepRecord, run_steps};
use serde::Serialize;

use super::motion::{Ready, refused, settings as motion_settings, stopped, with_ready};
use super::run::{SceneDrive, check_held, failed, settings};
use crate::case::{Case, CaseError, Compiled};
use crate::scene::Motion;
use crate::scene::boundary::BoundaryConditions;
use crate::scene::selection;
pub use place::{Place, points_of};

/// What a bond went through.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BondHistory {
    /// Its ends.
    pub points: [BondEnd; 2],
    /// Its length at rest in m.
    pub length_at_rest: f64,
    /// In m.
    pub horizon: f64,
    /// The conditions under which it breaks, any of them.
    pub conditions: Vec<BondCondition>,
    /// The names of what it remembers.
    pub states: Vec<String>,
    /// The set by which it is unbreakable, if it is.
    pub unbreakable: Option<String>,
    /// Whether `t` is a time in s.
    pub is_motion: bool,
    /// How it was at the rows of the tables.
    pub rows: Vec<BondRow>,
    /// When one of its margins came closest to 0, or went farthest beyond, as long as it was there; nothing
    /// without conditions.
    pub largest: Option<LargestMargin>,
    /// How it broke, if it did.
    pub broke: Option<BondBreak>,
    /// Why the run ended, and where it did not come to its end the reason in words.
    pub ended: (ExitReason, String),
}

/// A point of a bond.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BondEnd {
    /// In the user's order, from 0.
    pub number: usize,
    /// At rest, in m.
    pub position: Vec<f64>,
    /// Of a body of several.
    pub material: Option<String>,
}

/// A condition under which a bond breaks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BondCondition {
    /// As written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the potential.
    pub reason: Option<String>,
    /// Whose it is, of a body of several materials: a material, or an interface.
    pub of: Option<String>,
}

/// A bond at one time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BondRow {
    /// The time in s, or the load parameter.
    pub t: f64,
    /// In m.
    pub length: f64,
    /// The length over that at rest, less 1.
    pub stretch: f64,
    /// One for each condition: what the left of the comparison has more than the right.
    pub margins: Vec<f64>,
    /// One for each state, in SI units.
    pub states: Vec<f64>,
    /// What it holds by itself, in J: `psi(l)` times its weight.
    pub energy: f64,
    /// Whether it is broken.
    pub broken: bool,
}

/// The largest of all margins.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LargestMargin {
    /// When.
    pub t: f64,
    /// Which condition, from 0.
    pub condition: usize,
    /// There.
    pub margin: f64,
    /// Of the bond at rest, with what it remembered then.
    pub at_rest: f64,
    /// How much of the way from rest to the threshold it made: 1 at the threshold; nothing where the margin at
    /// rest is not negative.
    pub share: Option<f64>,
}

/// How a bond broke.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BondBreak {
    /// When.
    pub t: f64,
    /// Which conditions held, from 0; none of steps by events, where it broke at its threshold.
    pub conditions: Vec<usize>,
    /// How it was, before it was taken out.
    pub row: BondRow,
}

/// Runs a case and follows the bond between two of its points, in the body's order.
///
/// # Errors
/// A body in which nothing breaks, points that have no bond, or one that a crack has cut; what a case cannot
/// start with.
pub fn bond_history(
    case: &Case,
    ends: [usize; 2],
    watch: &Watch,
) -> Result<BondHistory, CaseError> {
    if !case.can_break() && case.n_states() == 0 {
        let message = "no bond of this scene can break: no potential has a `break when` or an `update`, \
                       and there is no [[crack]]";
        return Err(CaseError::Body { message: message.to_owned() });
    }
    case.check_rest()?;
    let compiled = case.compile()?;
    let conditions = conditions(&compiled);
    match &case.scene.motion {
        Some(scene) => with_ready(case, compiled, |ready| {
            let mut seen = Seen::new(case, ends, ready.energy.fracture(), &conditions)?;
            seen.follow_motion(scene, ready, watch)?;
            Ok(seen.history)
        })?,
        None => of_steps(case, ends, compiled, &conditions, watch),
    }
}

fn of_steps(
    case: &Case,
    ends: [usize; 2],
    compiled: Vec<Compiled>,
    conditions: &[Known],
    watch: &Watch,
) -> Result<BondHistory, CaseError> {
    let (energy, fields) = case.solved_energy(compiled)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    let mut seen = Seen::new(case, ends, energy.fracture(), conditions)?;
    check_held(case, energy.bonds(), &boundary)?;
    let drive = SceneDrive::new(&boundary, &fields);
    let mut problem = None;
    let mut observer = |record: &StepRecord, state: &State<'_>| match seen.note(
        record.t,
        state.displacements,
        true,
    ) {
        Ok(()) => ControlFlow::Continue(()),
        Err(found) => {
            problem = Some(found);
            ControlFlow::Break(())
        }
    };
    let ran = run_steps(&energy, &drive, &settings(&case.scene), watch, &mut observer);
    if let Some(found) = problem {
        return Err(not_finite(case, &found));
    }
    let mut history = seen.history;
    history.ended = match ran {
        Ok(outcome) if outcome.stopped => (ExitReason::Interrupted, "interrupted".to_owned()),
        Ok(_) => (ExitReason::Completed, String::new()),
        Err(StepError::NotConverged(failure)) => failed(case, &failure),
        Err(error) => return Err(drive.explain(case, error)),
    };
    Ok(history)
}

fn not_finite(case: &Case, found: &NonFinite) -> CaseError {
    CaseError::Body { message: case.describe(found) }
}

/// A condition, and where the body has it: whether it is one of gradients or gathered values, its layer, its law,
/// its number among those of its kind there.
struct Known {
    place: (bool, usize, usize, usize),
    text: String,
    reason: Option<String>,
}

/// The conditions of bonds of all potentials.
fn conditions(compiled: &[Compiled]) -> Vec<Known> {
    let of_one = |one: &Compiled| {
        let known =
            |of_gradient: bool, number: usize, text: &String, reason: &Option<String>| Known {
                place: (of_gradient, one.layer, one.law, number),
                text: text.clone(),
                reason: reason.clone(),
            };
        let lengths = one.criteria.iter().filter(|own| own.measure() == Measure::Length);
        let lengths = lengths.enumerate().map(|(k, own)| known(false, k, &own.text, &own.reason));
        let gradients = one.of_families.gradient_criteria.iter().enumerate();
        let gradients = gradients.map(|(k, own)| known(true, k, &own.text, &own.reason));
        let first = one.of_families.gradient_criteria.len();
        let gathered = one.of_families.gathered_criteria.iter().enumerate();
        let gathered = gathered.map(|(k, own)| known(true, first + k, &own.text, &own.reason));
        let vectors = one.of_families.vector_criteria.iter().enumerate();
        let vectors = vectors.map(|(k, own)| known(true, first + k, &own.text, &own.reason));
        lengths.chain(gradients).chain(gathered).chain(vectors).collect::<Vec<Known>>()
    };
    compiled.iter().flat_map(of_one).collect()
}

/// A bond on its way through a run.
struct Seen<'a> {
    case: &'a Case,
    fracture: &'a dyn Fracture,
    bond: usize,
    history: BondHistory,
}

impl<'a> Seen<'a> {
    fn new(
        case: &'a Case,
        ends: [usize; 2],
        fracture: Option<&'a dyn Fracture>,
        conditions: &[Known],
    ) -> Result<Seen<'a>, CaseError> {
        let points = ends.map(|end| BondEnd::of(case, end));
        let distance = distance(&points);
        let horizon = case.scene.horizon_radius();
        let found = fracture.and_then(|all| Some((all, all.bond_between(ends)?)));
        let Some((fracture, bond)) = found else {
            let message = format!(
                "{} and {} have no bond: they are {distance:e} m apart, and the horizon is {horizon:e} m",
                points[0], points[1]
            );
            return Err(CaseError::Body { message });
        };
        if fracture.broken().binary_search(&bond).is_ok() {
            let then = if fracture.is_absent(bond) { "has never been there" } else { "is broken" };
            let message = format!(
                "a [[crack]] cuts the bond of {} and {}: it {then} before anything moves",
                points[0], points[1]
            );
            return Err(CaseError::Body { message });
        }
        fracture.watch_bond(bond);
        let look = fracture.look_at(bond, &vec![0.0; case.body.positions().len()]);
        let look = look.map_err(|found| not_finite(case, &found))?;
        let place = |one: &Judged| (one.of.is_some(), one.layer, one.law, one.number);
        let of_either = |one: &Judged| {
            look.margins.iter().filter(|other| place(other) == place(one)).count() > 1
        };
        let condition = |one: &Judged| {
            let known = conditions.iter().find(|known| known.place == place(one));
            let of = (!case.scene.regions.is_empty()).then(|| case.scene.law_name(one.law));
            let text = known.map_or_else(String::new, |known| known.text.clone());
            BondCondition {
                text: match one.of {
                    // Of an end, not of the bond: either has one.
                    Some([i, j]) if i == j || of_either(one) => {
                        let end = usize::from(i != ends[0]);
                        format!("{text} at {}", points[end])
                    }
                    _ => text,
                },
                reason: known.and_then(|known| known.reason.clone()),
                of,
            }
        };
        let names = case.all_states().into_iter().zip(&look.states);
        let history = BondHistory {
            length_at_rest: look.reference,
            horizon,
            conditions: look.margins.iter().map(condition).collect(),
            states: names.filter(|one| one.1.is_some()).map(|one| one.0.to_owned()).collect(),
            unbreakable: unbreakable(case, ends),
            is_motion: case.scene.motion.is_some(),
            rows: Vec::new(),
            largest: None,
            broke: None,
            ended: (ExitReason::Completed, String::new()),
            points,
        };
        Ok(Seen { case, fracture, bond, history })
    }

    /// Takes in a time, with a row if there is one.
    fn note(&mut self, t: f64, u: &[f64], has_row: bool) -> Result<(), NonFinite> {
        if self.history.broke.is_none()
            && let Some(look) = self.fracture.seen_breaking()
        {
            self.raise(t, &look);
            let holds = (0..look.margins.len()).filter(|k| look.margins[*k].breaks).collect();
            self.history.broke = Some(BondBreak { t, conditions: holds, row: row(t, &look) });
        }
        let is_there = self.history.broke.is_none();
        if !is_there && !has_row {
            return Ok(());
        }
        let look = self.fracture.look_at(self.bond, u)?;
        if is_there {
            self.raise(t, &look);
        }
        if has_row {
            self.history.rows.push(row(t, &look));
        }
        Ok(())
    }

    /// Takes in margins of a bond that is there.
    fn raise(&mut self, t: f64, look: &Look) {
        for (condition, one) in look.margins.iter().enumerate() {
            let known = self.history.largest.as_ref();
            let own = over_rest(one.margin, one.at_rest);
            if known.is_none_or(|known| own > over_rest(known.margin, known.at_rest)) {
                let share = (one.at_rest < 0.0).then_some(1.0 + own);
                let (margin, at_rest) = (one.margin, one.at_rest);
                self.history.largest = Some(LargestMargin { t, condition, margin, at_rest, share });
            }
        }
    }

    fn follow_motion(
        &mut self,
        scene: &Motion,
        ready: Ready<'_>,
        watch: &Watch,
    ) -> Result<(), CaseError> {
        let Ready { energy, masses, drive, start, .. } = ready;
        let case = self.case;
        let settings = motion_settings(case, scene);
        let made = motion::Motion::new(energy, masses, start, drive, &settings, watch);
        let mut motion = made.map_err(|error| refused(case, drive, error))?;
        // Between rows, too, there is something to see.
        motion.pause_every(Duration::ZERO);
        let mut next = motion.advance_to(0);
        loop {
            let has_row = match next {
                Ok(Advance::Step(_)) => true,
                Ok(Advance::Pause) => false,
                Ok(Advance::End) => break,
                Ok(Advance::Interrupted) => {
                    self.history.ended = (ExitReason::Interrupted, "interrupted".to_owned());
                    break;
                }
                Err(error) => {
                    self.history.ended = stopped(case, drive, error);
                    break;
                }
            };
            let noted = self.note(motion.time_reached(), motion.state().displacements, has_row);
            noted.map_err(|found| not_finite(case, &found))?;
            next = motion.advance();
        }
        Ok(())
    }
}

fn row(t: f64, look: &Look) -> BondRow {
    BondRow {
        t,
        length: look.length,
        stretch: look.strain,
        margins: look.margins.iter().map(|one| one.margin).collect(),
        states: look.states.iter().flatten().copied().collect(),
        energy: look.energy,
        broken: look.is_broken,
    }
}

/// The first set of unbreakable points that has one of the ends.
fn unbreakable(case: &Case, ends: [usize; 2]) -> Option<String> {
    let scene = &case.scene;
    let has = |set: usize| ends.iter().any(|end| scene.sets[set].members.has(&case.body, *end));
    let set = scene.fracture.unbreakable.iter().find(|set| has(set.value))?;
    Some(scene.sets[set.value].name.value.clone())
}

impl BondEnd {
    fn of(case: &Case, point: usize) -> BondEnd {
        let material = case.materials.as_ref().map(|all| usize::from(all.of(point)));
        let region = material.and_then(|material| case.scene.regions.get(material));
        BondEnd {
            number: case.body.user_index()[point] as usize,
            position: case.body.position(point).to_vec(),
            material: region.map(|region| region.name.value.clone()),
        }
    }
}

impl std::fmt::Display for BondEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "point {} at {}", self.number, selection::coordinates(&self.position))
    }
}

fn distance(points: &[BondEnd; 2]) -> f64 {
    let [p, q] = points;
    p.position.iter().zip(&q.position).map(|(p, q)| (p - q) * (p - q)).sum::<f64>().sqrt()
}
