//! Bodies in motion over ranks: each moves its own points, and rank 0 writes.

use piola_grammar::counted;
use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::interaction::Inverted;
use piola_mechanics::kernel::Measure;
use piola_output::fracture::{FractureColumns, FractureRow};
use piola_output::motion::{MotionColumns, MotionTables};
use piola_output::picture::{Charts, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::summary::{ExitReason, PhaseClock, Summary};
use piola_output::{OutputError, OutputFile, OutputFolder};
use piola_petsc::Engine;
use piola_solvers::march::{Advance, March as _, State};
use piola_solvers::motion::{self, MotionDrive as _, MotionError, Row};

use super::exchange::Exchange;
use super::steps::{agreed, lost};
use super::view::{Look, Shown, Sketch, View};
use super::{Begun, own_of};
use crate::case::CaseError;
use crate::scene::Motion;
use crate::scene::boundary::BoundaryConditions;
use crate::scene::drive::{MotionConditions, initial};
use crate::scene::selection::Selection;
use crate::simulation::motion::course::Unclosed;
use crate::simulation::motion::driven::Driven;
use crate::simulation::motion::told::{self, Seen};
use crate::simulation::motion::{refused, settings, stopped};
use crate::simulation::point_fields::PointFields;
use crate::simulation::run::{Ending, RunError, enter, frame, summary};

/// Why a motion ended that did not come to its end, in the order of what ranks tell each other.
const REASONS: [ExitReason; 3] = [ExitReason::NonFinite, ExitReason::Singular, ExitReason::Failed];

/// Moves a body from its start to its end. Collective.
pub(super) fn run(
    begun: &Begun<'_>,
    scene: &Motion,
    clock: PhaseClock,
) -> Result<Ending, RunError> {
    let Begun { engine, case, share, selection, .. } = *begun;
    let broken = broken(engine, begun.energy);
    // What ranks own is driven; of the halo's points their owners know.
    let own = own_of(selection, share);
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &own);
    let boundary = agreed(engine, boundary.map_err(CaseError::from))?;
    // That all materials have a density was asked when the scene was read.
    let masses = case.masses().unwrap_or_default();
    let conditions = MotionConditions::new(&boundary, &masses).map_err(CaseError::from);
    let conditions = agreed(engine, conditions)?;
    let fixed = conditions.fixed();
    let drive = Driven::new(conditions, begun.fields);
    let start = agreed(engine, initial(&boundary).map_err(CaseError::from))?;
    let exchange = Exchange::new(engine, share, case.body.dimension()).map_err(lost)?;
    let settings = settings(case, scene);
    let (energy, watch) = (begun.energy, begun.watch);
    let made = motion::Motion::among(&exchange, energy, &masses, start, &drive, &settings, watch);
    let mut motion = match made {
        Ok(motion) => motion,
        Err(error) => {
            let own = match error {
                MotionError::Elsewhere => Ok(()),
                own => Err(refused(case, &drive, own)),
            };
            return Err(agreed(engine, own).err().unwrap_or_else(|| nothing_said().into()));
        }
    };
    let fields = PointFields { case, energy, selection, masses: Some(&masses) };
    let view = View::new((engine, share), begun.parts, &fixed, begun.folder)?;
    let sight = Sight { begun, fields, own: &own, broken, view: &view };
    moved(&sight, scene, &mut motion, (&drive, &exchange), clock)
}

/// The same from there on.
fn moved(
    sight: &Sight<'_>,
    scene: &Motion,
    motion: &mut motion::Motion<'_, Exchange<'_>>,
    (drive, exchange): (&Driven<'_>, &Exchange<'_>),
    mut clock: PhaseClock,
) -> Result<Ending, RunError> {
    let Begun { engine, case, folder, energy, share, .. } = *sight.begun;
    let masses = sight.fields.masses.unwrap_or_default();
    enter(&mut clock, sight.begun.watch, "move");
    let resolved = case.scene.resolved_toml();
    let begun = match (folder, &sight.view.sketch) {
        (Some(folder), Some(sketch)) => {
            let kept = folder.write(OutputFile::ResolvedScene, resolved.as_bytes());
            kept.and_then(|()| Recorder::new(sight, folder, sketch).map(Some))
        }
        _ => Ok(None),
    };
    let mut recorder = agreed(engine, begun.map_err(RunError::from))?;
    let gone = go(sight, motion, &mut recorder, (drive, exchange))?;
    enter(&mut clock, sight.begun.watch, "output");
    let Gone { reason, message, last, frames } = gone;
    if let Some(last) = &last {
        // The frame of the last row, which may not have been due.
        let shown = if last.is_shown { None } else { sight.show(&last.seen, frames)? };
        let written = recorder.as_mut().map_or(Ok(()), |recorder| recorder.show(shown));
        agreed(engine, written.map_err(RunError::from))?;
        let (d, own) = (case.body.dimension(), share.own_of_held());
        let u = &last.seen.displacements[own.start * d..own.end * d];
        let written = sight.view.write_displacement(folder, u);
        agreed(engine, written.map_err(RunError::from))?;
    }
    let mut mass = [masses[share.own_of_held()].iter().fold(0.0, |sum, one| sum + one)];
    engine.sum(&mut mass);
    let steps = last.as_ref().map_or(0, |last| last.row.step);
    let mut warnings = notes(engine, motion.notes());
    warnings.extend(told::unstable(scene, motion));
    let ending = Ending {
        reason,
        message,
        helps: Vec::new(),
        done: format!(
            "{} of {:.6e} s on {}",
            counted(steps, "step"),
            motion.step(),
            counted(engine.ranks(), "rank")
        ),
        steps,
        indefinite: 0,
        fails: false,
        inverted: Inverted::default(),
        warnings,
    };
    let bonds = super::bonds(engine, energy, share);
    let written = match (recorder, folder) {
        (Some(recorder), Some(folder)) => {
            let options = sight.begun.options.clone();
            let title = options.title;
            let told = last.as_ref().map(|last| {
                let told = (&last.row, recorder.worst.share(), None);
                told::summary((scene, motion), told, energy, mass[0])
            });
            let summary = summary(case, energy, (&ending, options), &resolved, &mut clock);
            let summary = Summary { motion: told, ..sight.begun.of_whole(summary, bonds) };
            summary.write(folder).and_then(|()| recorder.finish(title))
        }
        _ => Ok(()),
    };
    agreed(engine, written.map_err(RunError::from))?;
    Ok(ending)
}

/// How a motion has ended.
struct Gone {
    reason: ExitReason,
    message: String,
    last: Option<Last>,
    /// How many frames there are.
    frames: usize,
}

/// The last row, and what the rank saw there.
struct Last {
    row: Row,
    seen: Moment,
    /// Whether it is a frame already.
    is_shown: bool,
}

/// Goes to the end, or to where the motion stops, with what rows bring. Collective.
fn go(
    sight: &Sight<'_>,
    motion: &mut motion::Motion<'_, Exchange<'_>>,
    recorder: &mut Option<Recorder<'_>>,
    (drive, exchange): (&Driven<'_>, &Exchange<'_>),
) -> Result<Gone, RunError> {
    let Begun { engine, case, .. } = *sight.begun;
    let (mut n_frames, mut last) = (0, None);
    let mut next = motion.advance_to(0);
    let (reason, message) = loop {
        match next {
            Ok(Advance::Step(row)) => {
                let is_due = told::is_due(case, n_frames, row.t);
                let moment = Moment::of(row.t, &motion.state());
                let seen = sight.seen(&moment);
                let shown = if is_due { sight.show(&moment, n_frames)? } else { None };
                n_frames += usize::from(is_due);
                let written = match recorder {
                    Some(recorder) => recorder.record(&row, seen, shown),
                    None => Ok(()),
                };
                agreed(engine, written.map_err(RunError::from))?;
                // Of a row that is a frame nothing but displacements is asked any more.
                let moment = if is_due { moment.without_forces() } else { moment };
                last = Some(Last { row, seen: moment, is_shown: is_due });
            }
            Ok(Advance::Pause) => {}
            Ok(Advance::End) => break (ExitReason::Completed, String::new()),
            Ok(Advance::Interrupted) => {
                let t = motion.time_reached();
                break (ExitReason::Interrupted, format!("interrupted at t = {t:e} s"));
            }
            Err(error) => {
                let told = |own| stopped(case, drive, own);
                let (reason, message) = ended(engine, error, told, exchange);
                let behind = last.as_ref().map_or_else(String::new, |last: &Last| {
                    format!("; the last row is that of t = {:e} s", last.row.t)
                });
                break (reason, message + &behind);
            }
        }
        next = motion.advance();
    };
    Ok(Gone { reason, message, last, frames: n_frames })
}

/// Bonds, triangles and tetrahedra that are broken in all of the body. Collective.
fn broken(engine: &Engine, energy: &Total<'_>) -> [usize; 3] {
    let own = energy.fracture().map_or([0; 3], |fracture| fracture.n_broken());
    let mut counts = own.map(|count| count as f64);
    engine.sum(&mut counts);
    counts.map(|count| count as usize)
}

fn nothing_said() -> CaseError {
    CaseError::Body { message: "a rank cannot start, and does not say why".to_owned() }
}

/// Why a motion ended, in the words of the first rank that found it. Collective.
fn ended(
    engine: &Engine,
    error: MotionError,
    told: impl FnOnce(MotionError) -> (ExitReason, String),
    exchange: &Exchange<'_>,
) -> (ExitReason, String) {
    let own = match (error, exchange.failure()) {
        (_, Some(failure)) => Some((ExitReason::Failed, failure.message)),
        (MotionError::Elsewhere, None) => None,
        (own, None) => Some(told(own)),
    };
    let place = |reason| REASONS.iter().position(|one| *one == reason).map_or(0, |k| k + 1);
    let code = own.as_ref().map_or(0, |(reason, _)| place(*reason)) as u64;
    let first = engine.all_gather(code).into_iter().find(|code| *code > 0).unwrap_or(0);
    let message = engine.agree(own.map_or(Ok(()), |(_, message)| Err(message)));
    let reason = (first as usize).checked_sub(1).and_then(|k| REASONS.get(k));
    let message = message.err().map_or_else(String::new, |failure| failure.message);
    (reason.copied().unwrap_or(ExitReason::Failed), message)
}

/// What any rank has noted, each once, in the order of the ranks: on rank 0. Collective.
fn notes(engine: &Engine, own: &[String]) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for bytes in engine.gather(own.join("\n").as_bytes()).unwrap_or_default() {
        for note in String::from_utf8_lossy(&bytes).lines() {
            if !all.iter().any(|known| known == note) {
                all.push(note.to_owned());
            }
        }
    }
    all
}

/// What a rank sees of its part.
struct Sight<'a> {
    begun: &'a Begun<'a>,
    /// Of what it holds.
    fields: PointFields<'a>,
    /// What of sets it owns.
    own: &'a Selection,
    /// Bonds, triangles and tetrahedra of the body that were broken before anything moved.
    broken: [usize; 3],
    view: &'a View<'a>,
}

impl Sight<'_> {
    /// What the tables have columns for.
    fn columns(&self) -> MotionColumns {
        let Begun { case, energy, selection, .. } = *self.begun;
        let fracture = energy.fracture().map(|fracture| FractureColumns {
            cliques: [Measure::Area, Measure::Volume]
                .map(|measure| fracture.counts_of(measure).is_some()),
            tracks: Vec::new(),
        });
        told::columns(case, energy, selection, fracture)
    }

    /// What tables tell of sets and probes of the whole body. Collective.
    fn seen(&self, now: &Moment) -> Seen {
        let Begun { engine, share, selection, case, .. } = *self.begun;
        let d = case.body.dimension();
        let mut numbers = self.own.reactions(&now.residual, d).concat();
        for probe in &selection.probes {
            let own =
                share.own.contains(&probe.point).then(|| (probe.point - share.held.start) * d);
            numbers.extend((0..d).map(|axis| own.map_or(0.0, |at| now.displacements[at + axis])));
        }
        engine.sum(&mut numbers);
        let rows: Vec<Vec<f64>> = numbers.chunks(d).map(<[f64]>::to_vec).collect();
        let (reactions, probes) = rows.split_at(selection.sets.len());
        Seen { reactions: reactions.to_vec(), probes: probes.to_vec(), fracture: None }
    }

    /// Writes the frame with this number; what rank 0 has of it. Collective.
    fn show(&self, now: &Moment, number: usize) -> Result<Option<Shown>, RunError> {
        let case = self.begun.case;
        let mut frame = frame(case, now.t, &now.displacements, &now.residual);
        frame.velocity = case.body.to_user_order(&now.velocities, case.body.dimension());
        self.fields.fill(&mut frame);
        let colour = self.fields.colour(&frame);
        self.view.show(Some(number), (frame, colour))
    }
}

/// What a rank holds of a body at one time in s, `n x d` each.
struct Moment {
    t: f64,
    /// In m.
    displacements: Vec<f64>,
    /// In m/s.
    velocities: Vec<f64>,
    /// `dE/du` less loads in N.
    residual: Vec<f64>,
}

impl Moment {
    /// Displacements alone.
    fn without_forces(self) -> Moment {
        Moment { velocities: Vec::new(), residual: Vec::new(), ..self }
    }

    fn of(t: f64, state: &State<'_>) -> Moment {
        let residual = state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f);
        Moment {
            t,
            displacements: state.displacements.to_vec(),
            velocities: state.velocities.to_vec(),
            residual: residual.collect(),
        }
    }
}

/// Writes what the rows bring: on rank 0.
struct Recorder<'a> {
    sight: &'a Sight<'a>,
    folder: &'a OutputFolder,
    sketch: &'a Sketch,
    frames: FrameSeries<'a>,
    tables: MotionTables,
    /// Bonds, triangles and tetrahedra that were broken at the last row.
    broken: [usize; 3],
    worst: Unclosed,
    last: Option<Look>,
}

impl<'a> Recorder<'a> {
    fn new(
        sight: &'a Sight<'a>,
        folder: &'a OutputFolder,
        sketch: &'a Sketch,
    ) -> Result<Recorder<'a>, OutputError> {
        let tables = MotionTables::new(folder, &sight.columns())?;
        let frames = sight.view.series(folder, sketch)?;
        let worst = Unclosed::default();
        let broken = sight.broken;
        Ok(Recorder { sight, folder, sketch, frames, tables, broken, worst, last: None })
    }

    fn record(
        &mut self,
        row: &Row,
        mut seen: Seen,
        shown: Option<Shown>,
    ) -> Result<(), OutputError> {
        self.worst.note(row);
        seen.fracture = row.broken.map(|bonds| self.fracture_row(row, bonds));
        self.tables.push(&told::row(row, self.sight.begun.energy, seen))?;
        self.show(shown)
    }

    fn show(&mut self, shown: Option<Shown>) -> Result<(), OutputError> {
        let Some(Shown { look, listed }) = shown else { return Ok(()) };
        self.last = Some(look);
        listed.map_or(Ok(()), |frame| self.frames.push(&frame))
    }

    /// What is broken, and how much of it since the row before.
    fn fracture_row(&mut self, row: &Row, bonds: usize) -> FractureRow {
        let [areas, volumes] = row.broken_cliques;
        let now = [Some(bonds), areas, volumes];
        let before = self.broken;
        let counts = |kind: usize| now[kind].map(|count: usize| [count - before[kind], count]);
        self.broken = now.map(Option::unwrap_or_default);
        FractureRow {
            t: row.t,
            bonds: [bonds - before[0], bonds],
            cliques: [counts(1), counts(2)],
            released: row.released,
            tracks: Vec::new(),
        }
    }

    /// The picture of the last row.
    fn finish(self, title: &str) -> Result<(), OutputError> {
        let Begun { case, energy, .. } = *self.sight.begun;
        let Some(Look { frame, colour }) = &self.last else { return Ok(()) };
        let [energies, probes] = MotionTables::series(self.folder, &self.sight.columns())?;
        let picture = Picture {
            title: &case.headline(title, energy.parts()),
            points: &self.sketch.points,
            n_points: self.sight.view.n_points(),
            frame,
            sets: &self.sketch.sets,
            colour: colour.as_ref(),
            charts: Charts::Times { energies: &energies, probes: &probes },
        };
        picture.write(self.folder)
    }
}
