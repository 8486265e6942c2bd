//! What load steps over ranks leave: sums over all ranks, which rank 0 writes.

use piola_mechanics::energy::{Energy as _, EnergyParts, Total};
use piola_mechanics::interaction::Inverted;
use piola_output::picture::{Charts, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::summary::{PhaseClock, SolverSummary, step_summaries};
use piola_output::{
    Definiteness, History, OutputError, OutputFile, OutputFolder, SetsAtRest, table,
};
use piola_petsc::Engine;

use super::share::Share;
use super::slab::Slab;
use super::steps::Found;
use super::view::{Look, Shown, Sketch, View};
use super::{Begun, Counts};
use crate::case::Case;
use crate::scene::selection::{PointSet, Selection};
use crate::simulation::run::{Ending, RunOptions, history, summary};

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
        let (d, own) = (case.body.dimension(), share.own_of_held());
        let at = |point: usize| (point - own.start) * d;
        let (forces, loads) = (slab.own_forces(), slab.loads());
        let u = &slab.local()[own.start * d..own.end * d];
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
            let mine =
                share.own.contains(&probe.point).then(|| (probe.point - share.own.start) * d);
            numbers.extend((0..d).map(|axis| mine.map_or(0.0, |at| u[at + axis])));
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

/// Writes what the steps bring: on rank 0.
pub(super) struct Recorder<'a> {
    case: &'a Case,
    folder: &'a OutputFolder,
    sketch: &'a Sketch,
    /// Of the whole body.
    n_points: usize,
    frames: FrameSeries<'a>,
    history: History,
    last: Option<Look>,
}

impl<'a> Recorder<'a> {
    /// Without frames and steps.
    pub(super) fn new(
        (case, selection): (&'a Case, &'a Selection),
        parts: &[String],
        folder: &'a OutputFolder,
        (view, sketch): (&'a View<'_>, &'a Sketch),
    ) -> Result<Recorder<'a>, OutputError> {
        let frames = view.series(folder, sketch)?;
        let history = history(case, selection, parts);
        let n_points = view.n_points();
        Ok(Recorder { case, folder, sketch, n_points, frames, history, last: None })
    }

    /// The body at rest; without sums where its forces are not known.
    pub(super) fn begin(
        &mut self,
        sums: Option<Sums>,
        shown: Option<Shown>,
    ) -> Result<(), OutputError> {
        self.history.at_rest = sums.map(|sums| {
            let [reactions, forces, _] = sums.sets;
            SetsAtRest { reactions, forces }
        });
        self.show(shown)
    }

    /// What is shown of the last equilibrium.
    pub(super) fn show(&mut self, shown: Option<Shown>) -> Result<(), OutputError> {
        let Some(Shown { look, listed }) = shown else { return Ok(()) };
        self.last = Some(look);
        listed.map_or(Ok(()), |frame| self.frames.push(&frame))
    }

    /// An equilibrium.
    pub(super) fn record(
        &mut self,
        found: &Found,
        sums: Sums,
        residuals: &[[f64; 2]],
        names: &std::sync::Arc<[String]>,
        shown: Option<Shown>,
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
        self.show(shown)?;
        table::write_history(self.folder, &self.history)
    }

    /// How many equilibria there are.
    pub(super) fn steps(&self) -> usize {
        self.history.steps.len()
    }

    /// Summary and picture.
    pub(super) fn finish(
        self,
        begun: &Begun<'_>,
        (ending, options): (&Ending, RunOptions<'_>),
        (solver, counts): (SolverSummary, Counts),
        (resolved, mut clock): (&str, PhaseClock),
    ) -> Result<(), OutputError> {
        if self.history.steps.is_empty() {
            table::write_history(self.folder, &self.history)?;
        }
        let (title, energy) = (options.title, begun.energy);
        let summary = summary(self.case, energy, (ending, options), resolved, &mut clock);
        let mut summary = begun.of_whole(summary, counts);
        summary.solver = Some(solver);
        summary.steps = step_summaries(&self.history);
        summary.write(self.folder)?;
        let Some(Look { frame, colour }) = &self.last else { return Ok(()) };
        let picture = Picture {
            title: &self.case.headline(title, energy.parts()),
            points: &self.sketch.points,
            n_points: self.n_points,
            frame,
            sets: &self.sketch.sets,
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
