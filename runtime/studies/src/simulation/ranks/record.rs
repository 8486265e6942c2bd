//! What load steps over ranks leave: sums over all ranks, which rank 0 writes.

use piola_mechanics::body::Body;
use piola_mechanics::energy::{Energy as _, EnergyParts, Total};
use piola_mechanics::interaction::Inverted;
use piola_output::picture::{Charts, Colour, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::summary::{InteractionCounts, PhaseClock, SolverSummary, step_summaries};
use piola_output::{
    Definiteness, Frame, History, OutputError, OutputFile, OutputFolder, PointField, Points,
    SetsAtRest, table,
};
use piola_petsc::Engine;

use super::share::Share;
use super::slab::Slab;
use super::steps::Found;
use crate::case::Case;
use crate::scene::selection::{PointSet, Selection};
use crate::simulation::point_fields::{PointFields, named_sets};
use crate::simulation::run::{Ending, RunOptions, frame, history, summary};

/// What every rank sums up of an equilibrium: for all of the body, on all ranks the same.
pub(super) struct Sums {
    /// In J, part by part.
    parts: Vec<f64>,
    /// Of each set `d` numbers: `dE/du` less loads, `dE/du`, in N; the mean displacement in m.
    sets: [Vec<Vec<f64>>; 3],
    /// Of each probe its displacement in m.
    probes: Vec<Vec<f64>>,
}

impl Sums {
    /// Those of the last evaluation; an energy that is not finite is NaN. Collective.
    pub(super) fn of(
        engine: &Engine,
        energy: &Total<'_>,
        (slab, share): (&Slab<'_>, &Share),
        (case, selection): (&Case, &Selection),
    ) -> Sums {
        let (d, own) = (case.body.dimension(), &share.own);
        let at = |point: usize| (point - own.start) * d;
        let (forces, loads) = (slab.own_forces(), slab.loads());
        let inner = share.own_of_held();
        let u = &slab.local()[inner.start * d..inner.end * d];
        let mut numbers = vec![0.0; energy.parts().len()];
        if energy.counted_energy(slab.local(), None, &mut numbers).is_err() {
            numbers.fill(f64::NAN);
        }
        let volumes = case.body.volumes();
        type OfPoint<'f> = &'f dyn Fn(usize, usize, &PointSet) -> f64;
        let of_point: [OfPoint<'_>; 3] = [
            &|point, axis, _| forces[at(point) + axis] - loads[at(point) + axis],
            &|point, axis, _| forces[at(point) + axis],
            &|point, axis, set| volumes[point] * u[at(point) + axis] / set.volume,
        ];
        for of_point in of_point {
            for set in &selection.sets {
                let mine = || set.points.iter().filter(|point| own.contains(point));
                numbers.extend(
                    (0..d).map(|axis| {
                        mine().fold(0.0, |sum, point| sum + of_point(*point, axis, set))
                    }),
                );
            }
        }
        for probe in &selection.probes {
            let is_mine = own.contains(&probe.point);
            numbers
                .extend((0..d).map(|axis| if is_mine { u[at(probe.point) + axis] } else { 0.0 }));
        }
        engine.sum(&mut numbers);
        let mut rest = numbers.into_iter();
        let parts = rest.by_ref().take(energy.parts().len()).collect();
        let mut rows = |n: usize| -> Vec<Vec<f64>> {
            (0..n).map(|_| rest.by_ref().take(d).collect()).collect()
        };
        let sets = [(); 3].map(|()| rows(selection.sets.len()));
        Sums { parts, sets, probes: rows(selection.probes.len()) }
    }
}

/// Own numbers of all ranks, one behind the other, on rank 0: a vector in the body's order. Collective.
pub(super) fn gathered(engine: &Engine, own: &[f64]) -> Option<Vec<f64>> {
    let bytes: Vec<u8> = own.iter().flat_map(|x| x.to_le_bytes()).collect();
    let all = engine.gather(&bytes)?;
    let numbers = |bytes: &Vec<u8>| -> Vec<f64> {
        let eights = bytes.chunks_exact(8);
        eights.filter_map(|eight| Some(f64::from_le_bytes(eight.try_into().ok()?))).collect()
    };
    Some(all.iter().flat_map(numbers).collect())
}

/// What a frame shows of points beside displacements and residuals, on rank 0 of the whole body.
#[derive(Default)]
pub(super) struct Shown {
    fields: Vec<PointField>,
    colour: Option<Colour>,
}

impl Shown {
    /// Those that `here` works out of `now`, a frame of what a rank holds; `body` is the whole one. Collective.
    pub(super) fn of(
        engine: &Engine,
        (here, body): (PointFields<'_>, &Body),
        share: &Share,
        mut now: Frame,
    ) -> Shown {
        let (held, own) = (&here.case.body, share.own_of_held());
        here.fill(&mut now);
        let whole = |values: &[f64], components: usize| -> Vec<f64> {
            let all = held.from_user_order(values, components);
            let mine = &all[own.start * components..own.end * components];
            let all = gathered(engine, mine);
            all.map_or_else(Vec::new, |all| body.to_user_order(&all, components))
        };
        let colour = here.colour(&now).map(|colour| {
            let values = whole(&colour.values, 1);
            Colour { values, ..colour }
        });
        let fields = now.fields.into_iter().map(|field| {
            let values = whole(&field.values, field.components);
            PointField { values, ..field }
        });
        Shown { fields: fields.collect(), colour }
    }
}

impl Shown {
    /// Fields, and what the colours show.
    pub(super) fn into_parts(self) -> (Vec<PointField>, Option<Colour>) {
        (self.fields, self.colour)
    }
}

/// Writes what the steps bring: on rank 0.
pub(super) struct Recorder<'a> {
    case: &'a Case,
    selection: &'a Selection,
    folder: &'a OutputFolder,
    points: &'a Points,
    frames: FrameSeries<'a>,
    history: History,
    framed: usize,
    last: Option<(Frame, Option<Colour>)>,
}

impl<'a> Recorder<'a> {
    /// Without frames and steps.
    pub(super) fn new(
        (case, selection): (&'a Case, &'a Selection),
        parts: &[String],
        folder: &'a OutputFolder,
        points: &'a Points,
    ) -> Result<Recorder<'a>, OutputError> {
        let frames = FrameSeries::new(folder, points)?;
        let history = history(case, selection, parts);
        let (framed, last) = (0, None);
        Ok(Recorder { case, selection, folder, points, frames, history, framed, last })
    }

    /// The body at rest, as the first frame, with residuals in N of the whole body; without sums where its forces are
    /// not known.
    pub(super) fn begin(
        &mut self,
        sums: Option<Sums>,
        (residual, shown): (&[f64], Shown),
    ) -> Result<(), OutputError> {
        self.history.at_rest = sums.map(|sums| {
            let [reactions, forces, _] = sums.sets;
            SetsAtRest { reactions, forces }
        });
        let zero = vec![0.0; self.points.positions.len()];
        let mut now = frame(self.case, 0.0, &zero, residual);
        now.fields.extend(shown.fields);
        self.frames.push(&now)
    }

    /// An equilibrium, with displacements in m and residuals in N of the whole body.
    pub(super) fn record(
        &mut self,
        (found, is_due): (&Found, bool),
        sums: Sums,
        residuals: &[[f64; 2]],
        names: &std::sync::Arc<[String]>,
        (u, residual, shown): (&[f64], &[f64], Shown),
    ) -> Result<(), OutputError> {
        let Sums { parts, sets: [reactions, forces, moved], probes } = sums;
        self.history.push(piola_output::StepRecord {
            t: found.t,
            iterations: found.iterations,
            residual: residuals.iter().map(|one| one[0]).collect(),
            residual_over_reaction: residuals.iter().map(|one| one[1]).collect(),
            energy_parts: EnergyParts::new(names, parts),
            reactions,
            forces,
            moved,
            probes,
            definiteness: Definiteness {
                positive_definite: None,
                method: "not asked: tangents are in parts".to_owned(),
            },
            condition: None,
            inverted: Inverted::default(),
            broken: None,
        });
        let mut now = frame(self.case, found.t, u, residual);
        now.fields.extend(shown.fields);
        self.last = Some((now, shown.colour));
        if is_due {
            self.push_frame()?;
        }
        table::write_history(self.folder, &self.history)
    }

    fn push_frame(&mut self) -> Result<(), OutputError> {
        self.framed = self.history.steps.len();
        self.last.as_ref().map_or(Ok(()), |last| self.frames.push(&last.0))
    }

    /// What is shown of the points at the last equilibrium.
    pub(super) fn show(&mut self, shown: Shown) {
        if let Some((now, colour)) = &mut self.last {
            now.fields.extend(shown.fields);
            *colour = shown.colour;
        }
    }

    /// How many equilibria there are.
    pub(super) fn steps(&self) -> usize {
        self.history.steps.len()
    }

    /// The last frame, displacements, summary and picture.
    pub(super) fn finish(
        mut self,
        energy: &Total<'_>,
        (ending, options): (&Ending, RunOptions<'_>),
        (solver, bonds): (SolverSummary, usize),
        (resolved, mut clock): (&str, PhaseClock),
    ) -> Result<(), OutputError> {
        if self.framed < self.steps() && self.case.scene.output.frames > 0 {
            self.push_frame()?;
        }
        if self.history.steps.is_empty() {
            table::write_history(self.folder, &self.history)?;
        }
        let zero = vec![0.0; self.points.positions.len()];
        let at_rest = || (frame(self.case, 0.0, &zero, &zero), None);
        let (last, colour) = self.last.take().unwrap_or_else(at_rest);
        table::write_displacement(self.folder, self.points, &last.displacement)?;
        let title = options.title;
        let mut summary = summary(self.case, energy, (ending, options), resolved, &mut clock);
        // Those that rank 0 holds are not all of them.
        summary.interactions = InteractionCounts { bonds, ..InteractionCounts::default() };
        summary.dropped = InteractionCounts::default();
        summary.solver = Some(solver);
        summary.steps = step_summaries(&self.history);
        summary.write(self.folder)?;
        let sets = named_sets(self.case, self.selection);
        let title = &self.case.headline(title, energy.parts());
        let picture = Picture {
            title,
            points: self.points,
            frame: &last,
            sets: &sets,
            colour: colour.as_ref(),
            charts: Charts::Steps(
                &self.history,
                self.case.scene.solver.tolerance,
                "Newton iteration",
            ),
        };
        picture.write(self.folder)
    }

    /// Keeps the scene as it is run.
    pub(super) fn keep_scene(&self, resolved: &str) -> Result<(), OutputError> {
        self.folder.write(OutputFile::ResolvedScene, resolved.as_bytes())
    }
}
