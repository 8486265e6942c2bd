//! Bodies in motion over ranks: each moves its own points, and rank 0 writes.

use std::time::Duration;

use piola_grammar::counted;
use piola_mechanics::energy::Energy as _;
use piola_mechanics::interaction::Inverted;
use piola_output::checkpoint::Parts;
use piola_output::summary::{ExitReason, PhaseClock, Summary};
use piola_output::{OutputError, OutputFile};
use piola_petsc::Engine;
use piola_solvers::march::{Advance, March as _, State};
use piola_solvers::motion::{self, MotionDrive as _, MotionError, Row};

use super::checkpoint::Store;
use super::exchange::Exchange;
use super::parts::ends;
use super::recorder::{Recorder, STEP};
use super::steps::{agreed, lost};
use super::view::{Shown, View, gathered};
use super::{Begun, own_of};
use crate::case::CaseError;
use crate::scene::Motion;
use crate::scene::boundary::BoundaryConditions;
use crate::scene::drive::{MotionConditions, initial};
use crate::scene::selection::{Selection, edge_of};
use crate::simulation::motion::driven::Driven;
use crate::simulation::motion::told::{self, Seen};
use crate::simulation::motion::{Mark, earlier, header, refused, settings, stopped};
use crate::simulation::point_fields::PointFields;
use crate::simulation::run::{Ending, RunError, enter, frame, hash, summary};
use crate::simulation::tracks::{self, Damaged, Lookout};

/// Why a motion ended that did not come to its end, in the order of what ranks tell each other.
const REASONS: [ExitReason; 3] = [ExitReason::NonFinite, ExitReason::Singular, ExitReason::Failed];

/// Moves a body from its start to its end, or from where an earlier run left it. Collective.
pub(super) fn run(
    begun: &Begun<'_>,
    scene: &Motion,
    clock: PhaseClock,
) -> Result<Ending, RunError> {
    let Begun { engine, case, share, selection, energy, .. } = *begun;
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
    let extents = Extents::of(begun);
    let lookout = Lookout::new(case, energy, selection, (extents.spacing, share.held.start));
    let fields = PointFields { case, energy, selection, masses: Some(&masses) };
    let view = View::new(begun, &fixed)?;
    let store = Store::new(begun);
    let sight = Sight { begun, fields, own: &own, lookout, extents, view: &view };
    let before = sight.cracks();
    let earlier = match begun.options.resumes {
        true => Some(agreed(engine, left(begun))?),
        false => None,
    };
    let (settings, watch) = (settings(case, scene), begun.watch);
    let made = match &earlier {
        Some(Earlier { parts, step, .. }) => {
            let from = agreed(engine, store.read(*parts, *step).map_err(RunError::from))?;
            let from = store.with_all_notes(from, *parts);
            let (masses, drive) = (&masses[..], &drive);
            let others = &exchange;
            motion::Motion::resume_among(others, energy, masses, drive, &settings, watch, from)
        }
        None => motion::Motion::among(&exchange, energy, &masses, start, &drive, &settings, watch),
    };
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
    if let Ok(interval) = Duration::try_from_secs_f64(case.scene.output.checkpoint) {
        motion.pause_every(interval);
    }
    let of = Of { sight: &sight, drive: &drive, exchange: &exchange, store: &store };
    moved(&of, scene, &mut motion, (before, earlier), clock)
}

/// What a motion is followed with.
struct Of<'a> {
    sight: &'a Sight<'a>,
    drive: &'a Driven<'a>,
    exchange: &'a Exchange<'a>,
    store: &'a Store<'a>,
}

/// The same from there on, with what is seen of cracks before anything moves and what an earlier run left.
fn moved(
    of: &Of<'_>,
    scene: &Motion,
    motion: &mut motion::Motion<'_, Exchange<'_>>,
    (before, mut earlier): (Option<tracks::Seen>, Option<Earlier>),
    mut clock: PhaseClock,
) -> Result<Ending, RunError> {
    let sight = of.sight;
    let Begun { engine, case, folder, energy, share, .. } = *sight.begun;
    let masses = sight.fields.masses.unwrap_or_default();
    enter(&mut clock, sight.begun.watch, "move");
    let resolved = case.scene.resolved_toml();
    let output = earlier.as_mut().and_then(|earlier| earlier.output.take());
    let made = match (folder, &sight.view.sketch) {
        (Some(folder), Some(sketch)) => {
            let kept = folder.write(OutputFile::ResolvedScene, resolved.as_bytes());
            let known = header(sight.begun.options.origin, &of.store.hash);
            let place = (sight, folder, sketch);
            kept.and_then(|()| Recorder::new(place, known, before, output).map(Some))
        }
        _ => Ok(None),
    };
    let mut recorder = agreed(engine, made.map_err(RunError::from))?;
    let resumed = earlier.as_ref().map(|_| motion.step_reached());
    let gone = go(of, motion, &mut recorder, earlier)?;
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
    let steps = last.as_ref().map_or(resumed.unwrap_or(0), |last| last.row.step);
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
    let counts = super::counts(engine, energy);
    let written = match (recorder, folder) {
        (Some(recorder), Some(folder)) => {
            let options = sight.begun.options.clone();
            let title = options.title;
            let told = last.as_ref().map(|last| {
                let told = (&last.row, recorder.worst.share(), resumed);
                told::summary((scene, motion), told, energy, mass[0])
            });
            let summary = summary(case, energy, (&ending, options), &resolved, &mut clock);
            let summary = Summary { motion: told, ..sight.begun.of_whole(summary, counts) };
            let written = summary.write(folder).and_then(|()| recorder.finish(title));
            written.and_then(|()| match reason {
                ExitReason::Completed => folder.remove_checkpoint(),
                _ => Ok(()),
            })
        }
        _ => Ok(()),
    };
    agreed(engine, written.map_err(RunError::from))?;
    Ok(ending)
}

/// Where an earlier run stood.
struct Earlier {
    parts: Parts,
    step: f64,
    /// How many frames there are.
    frames: usize,
    /// On rank 0 how far the output was, with the times of frames in s.
    output: Option<(Mark, Vec<f64>)>,
}

/// What an earlier run left of this scene. Collective; an error is one of rank 0.
fn left(begun: &Begun<'_>) -> Result<Earlier, RunError> {
    let found = begun.folder.map(|folder| {
        let (case, path) = (begun.case, folder.path_of(OutputFile::Checkpoint));
        let head = earlier(folder, &hash(case, &case.scene.resolved_toml()))?;
        let by_one = format!(
            "the checkpoint in `{}` is of a run by one process: leave --petsc out",
            folder.path().display()
        );
        let parts = head.header.parts.ok_or(CaseError::Body { message: by_one })?;
        let breaks = begun.energy.fracture().is_some();
        let output = Mark::of(&head, (case, begun.parts.n_points, breaks));
        let step = head.array(STEP).and_then(|step| step.first()).copied();
        let found = step.zip(output).ok_or(OutputError::Checkpoint { path })?;
        Ok::<_, RunError>((parts, found))
    });
    let mut numbers = [0; 4];
    if let Some(Ok((Parts { n, turn }, (step, (mark, _))))) = &found {
        numbers = [*n as u64, *turn as u64, step.to_bits(), mark.frames as u64];
    }
    let mut bytes = numbers.map(u64::to_le_bytes).concat();
    begun.engine.broadcast(&mut bytes);
    let mut numbers = bytes.as_chunks::<8>().0.iter().map(|eight| u64::from_le_bytes(*eight));
    let mut next = || numbers.next().unwrap_or_default();
    Ok(Earlier {
        parts: Parts { n: next() as usize, turn: next() as usize },
        step: f64::from_bits(next()),
        frames: next() as usize,
        output: found.transpose()?.map(|(_, (_, output))| output),
    })
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

/// Goes to the end, or to where the motion stops, with what rows bring, and a checkpoint now and then. Collective.
fn go(
    of: &Of<'_>,
    motion: &mut motion::Motion<'_, Exchange<'_>>,
    recorder: &mut Option<Recorder<'_>>,
    earlier: Option<Earlier>,
) -> Result<Gone, RunError> {
    let Begun { engine, case, .. } = *of.sight.begun;
    let (mut n_frames, mut last) = (earlier.as_ref().map_or(0, |earlier| earlier.frames), None);
    let mut turn = earlier.as_ref().map_or(0, |earlier| 1 - earlier.parts.turn.min(1));
    // The row that it starts from stands in the tables of a run that is taken up.
    let mut next = if earlier.is_some() { motion.advance() } else { motion.advance_to(0) };
    let (reason, message) = loop {
        match next {
            Ok(Advance::Step(row)) => {
                let is_due = told::is_due(case, n_frames, row.t);
                last = Some(see(of.sight, recorder, (row, motion), is_due.then_some(n_frames))?);
                n_frames += usize::from(is_due);
            }
            Ok(Advance::Pause) => save(of, motion, recorder, &mut turn)?,
            Ok(Advance::End) => break (ExitReason::Completed, String::new()),
            Ok(Advance::Interrupted) => {
                save(of, motion, recorder, &mut turn)?;
                let t = motion.time_reached();
                let message = format!(
                    "interrupted; the motion has come to t = {t:e} s, `piola run --petsc --resume {}` on any \
                     number of ranks goes on",
                    of.store.folder.display()
                );
                break (ExitReason::Interrupted, message);
            }
            Err(error) => {
                let told = |own| stopped(case, of.drive, own);
                let (reason, message) = ended(engine, error, told, of.exchange);
                let behind = match (&last, &earlier) {
                    (Some(Last { row, .. }), _) => {
                        format!("; the last row is that of t = {:e} s", row.t)
                    }
                    (None, Some(_)) => "; no row was written since the checkpoint".to_owned(),
                    (None, None) => String::new(),
                };
                break (reason, message + &behind);
            }
        }
        next = motion.advance();
    };
    Ok(Gone { reason, message, last, frames: n_frames })
}

/// Records a row, with the frame of this number if one is due. Collective.
fn see(
    sight: &Sight<'_>,
    recorder: &mut Option<Recorder<'_>>,
    (row, motion): (Row, &motion::Motion<'_, Exchange<'_>>),
    frame: Option<usize>,
) -> Result<Last, RunError> {
    let moment = Moment::of(row.t, &motion.state());
    let (seen, cracks) = (sight.seen(&moment), sight.cracks());
    let shown = frame.map_or(Ok(None), |number| sight.show(&moment, number))?;
    let written = match recorder {
        Some(recorder) => recorder.record(&row, seen, cracks, shown),
        None => Ok(()),
    };
    agreed(sight.begun.engine, written.map_err(RunError::from))?;
    // Of a row that is a frame nothing but displacements is asked any more.
    let is_shown = frame.is_some();
    let seen = if is_shown { moment.without_forces() } else { moment };
    Ok(Last { row, seen, is_shown })
}

/// Leaves a checkpoint: first the parts, of this turn, then what names them. Collective.
fn save(
    of: &Of<'_>,
    motion: &motion::Motion<'_, Exchange<'_>>,
    recorder: &mut Option<Recorder<'_>>,
    turn: &mut usize,
) -> Result<(), RunError> {
    let engine = of.sight.begun.engine;
    of.store.write(motion, *turn)?;
    let parts = Parts { n: engine.ranks(), turn: *turn };
    let written = recorder.as_mut().map_or(Ok(()), |recorder| recorder.save(motion, parts));
    agreed(engine, written.map_err(RunError::from))?;
    *turn = 1 - *turn;
    Ok(())
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
pub(super) struct Sight<'a> {
    pub(super) begun: &'a Begun<'a>,
    /// Of what it holds.
    fields: PointFields<'a>,
    /// What of sets it owns.
    own: &'a Selection,
    lookout: Option<Lookout<'a>>,
    pub(super) extents: Extents,
    pub(super) view: &'a View<'a>,
}

/// How large the body is, in m.
pub(super) struct Extents {
    /// Between points that are typical neighbours.
    spacing: f64,
    /// Along each axis.
    pub(super) sides: Vec<f64>,
}

impl Extents {
    /// Collective.
    fn of(begun: &Begun<'_>) -> Extents {
        let Begun { engine, case, share, .. } = *begun;
        let (body, own) = (case.body.as_ref(), share.own_of_held());
        let d = body.dimension();
        let volume = body.volumes()[own.clone()].iter().fold(0.0, |sum, volume| sum + volume);
        let mut sums = [volume, own.len() as f64];
        engine.sum(&mut sums);
        let edge = edge_of(d, sums[0] / sums[1]);
        let ends = ends(body, own, engine);
        let side =
            |axis: usize| tracks::side(&case.scene, axis, || edge + ends[d + axis] - ends[axis]);
        Extents { spacing: body.spacing().unwrap_or(edge), sides: (0..d).map(side).collect() }
    }
}

impl Sight<'_> {
    /// What there is to see of cracks in the whole body: on rank 0, and nothing where nothing can break. Collective.
    fn cracks(&self) -> Option<tracks::Seen> {
        let (engine, lookout) = (self.begun.engine, self.lookout.as_ref()?);
        let own = lookout.seen();
        let mut counts = own.broken.map(|count| count.unwrap_or(0) as f64);
        engine.sum(&mut counts);
        let whole = |kind: usize| own.broken[kind].map(|_| counts[kind] as usize);
        let mut numbers = Vec::new();
        own.damaged.iter().for_each(|damaged| damaged.add_to(&mut numbers));
        let mut all = gathered(engine, &numbers)?.into_iter();
        let mut damaged = vec![Damaged::default(); own.damaged.len()];
        for _ in 0..engine.ranks() {
            damaged.iter_mut().for_each(|damaged| damaged.extend(&mut all));
        }
        Some(tracks::Seen { broken: [0, 1, 2].map(whole), damaged })
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
