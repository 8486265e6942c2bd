//! A scene run by many processes: each owns a slab of the body, and holds what its forces depend on beside it.
//!
//! | module | does |
//! |---|---|
//! | `exchange` | numbers of the halo's points from their owners |
//! | `share` | which points are whose, and how far a halo reaches |
//! | `parts` | a case of which each rank has its part: points, materials, sets |
//! | `lattice` | the layers of a lattice that a rank holds, without the rest |
//! | `scatter` | bodies from files, which rank 0 reads |
//! | `rows` | whole rows of the tangent of own points |
//! | `slab` | forces and tangent of own points, as PETSc asks for them |
//! | `steps` | load steps |
//! | `moves` | bodies in motion |
//! | `checkpoint` | where a motion stands, in parts |
//! | `record`, `recorder` | what rank 0 writes: of load steps, with sums over all ranks; of motions |
//! | `view` | frames in pieces, and what rank 0 sees of a body for its picture |
//!
//! Energies, kernels and neighbourhoods are those of a run by one process, of the part of the body that a rank holds:
//! forces on its own points are whole there, and rows of the tangent, too. What a rank holds beyond is the halo, of
//! whose points the displacements come from their owners. Newton's method, Krylov methods and multigrid are PETSc's.
//! All ranks read the scene. Of a lattice each makes its part; clouds and meshes rank 0 reads, and sends each its part.

mod checkpoint;
mod exchange;
mod lattice;
mod moves;
mod parts;
mod record;
mod recorder;
mod rows;
mod scatter;
mod share;
mod slab;
mod steps;
mod view;

use std::path::{Path, PathBuf};

use piola_compiler::jit::target;
use piola_grammar::counted;
use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::interaction::{Inverted, Report};
use piola_output::summary::{
    ExitReason, FNV1A64_OF_NOTHING, InteractionCounts, PhaseClock, SolverSummary, Summary, fnv1a64,
};
use piola_output::{OutputError, OutputFolder};
pub use piola_petsc::Engine;
use piola_solvers::Watch;
use piola_solvers::motion::Method;
use piola_solvers::steps::{Control, Find};

use super::point_fields::PointFields;
use super::run::frames::is_due;
use super::run::{Ending, RunError, RunOptions, enter};
use crate::case::{Case, CaseError, FieldsInTime};
use crate::scene::boundary::BoundaryConditions;
use crate::scene::selection::{PointSet, Selection};
use crate::scene::{Scene, SolverSettings};
pub use parts::Parts;
use record::{Recorder, Sums};
use share::Share;
use slab::Slab;
use steps::{Found, LoadSteps, Solves, agreed, lost};
use view::View;

/// Runs a case over all ranks of an engine: its load steps or its motion. Rank 0 has the folder, and alone writes tables.
/// Collective.
///
/// # Errors
/// On all ranks: a case that cannot be run so, or cannot start; what PETSc reports; a file that cannot be written.
pub fn run(
    parts: &Parts,
    engine: &Engine,
    folder: Option<&OutputFolder>,
    options: RunOptions<'_>,
    watch: &Watch,
) -> Result<Ending, RunError> {
    let case = &parts.case;
    // Load steps have none.
    let nothing = folder.filter(|_| options.resumes && case.scene.motion.is_none());
    let none = nothing.map(|folder| OutputError::NoCheckpoint { path: folder.path().to_owned() });
    agreed(engine, none.map_or(Ok(()), Err))?;
    // What all ranks find alike is agreed on all the same: files may differ from machine to machine.
    agreed(engine, refuse(case).and_then(|()| case.check_rest()))?;
    let mut clock = PhaseClock::new();
    enter(&mut clock, watch, "compile");
    let compiled = agreed(engine, case.compile())?;
    check_kernels(case, engine)?;
    enter(&mut clock, watch, "interactions");
    let (energy, fields) = agreed(engine, case.solved_energy(compiled))?;
    let path = path_of_all(engine, folder.map(OutputFolder::path));
    let begun = Begun {
        engine,
        parts,
        case,
        folder,
        path: &path,
        options,
        watch,
        share: &parts.share,
        selection: &parts.selection,
        energy: &energy,
        fields: &fields,
    };
    match &case.scene.motion {
        Some(scene) => moves::run(&begun, scene, clock),
        None => load_steps(&begun, clock),
    }
}

/// The folder of the run as all ranks see it. Collective.
fn path_of_all(engine: &Engine, folder: Option<&Path>) -> PathBuf {
    let mut path = folder.map_or_else(Vec::new, |folder| {
        let path = std::path::absolute(folder);
        path.as_deref().unwrap_or(folder).to_string_lossy().into_owned().into_bytes()
    });
    engine.broadcast(&mut path);
    PathBuf::from(String::from_utf8_lossy(&path).as_ref())
}

/// A case that is made ready on a rank.
struct Begun<'a> {
    engine: &'a Engine,
    parts: &'a Parts,
    /// Of what the rank holds, and its energy.
    case: &'a Case,
    energy: &'a Total<'a>,
    fields: &'a FieldsInTime<'a>,
    /// On rank 0.
    folder: Option<&'a OutputFolder>,
    /// Of the run, as rank 0 names it.
    path: &'a Path,
    options: RunOptions<'a>,
    watch: &'a Watch,
    share: &'a Share,
    /// What the rank holds of sets, with volumes of whole ones; probes by their points in the body.
    selection: &'a Selection,
}

impl Begun<'_> {
    /// A summary of one's own case as that of the whole body, which has these interactions and lacks those.
    fn of_whole(&self, summary: Summary, [there, dropped]: Counts) -> Summary {
        Summary {
            points: self.parts.n_points,
            probes: self.parts.probes.clone(),
            interactions: there,
            dropped,
            ..summary
        }
    }
}

/// Solves the load steps. Collective.
fn load_steps(begun: &Begun<'_>, mut clock: PhaseClock) -> Result<Ending, RunError> {
    let Begun { engine, case, folder, watch, share, selection, energy, fields, .. } = *begun;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, selection);
    let boundary = agreed(engine, boundary.map_err(CaseError::from))?;
    let tolerance = case.scene.solver.tolerance;
    let mut slab =
        Slab::new((engine, share), energy, boundary.fixed_dofs(), tolerance).map_err(lost)?;
    let newton = slab.solver(share).map_err(lost)?;
    let fixed = boundary.fixed_dofs();
    let view = View::new(begun, fixed)?;
    let resolved = case.scene.resolved_toml();
    let made = match (folder, &view.sketch) {
        (Some(folder), Some(sketch)) => {
            let seen = (&view, sketch);
            let recorder = Recorder::new((case, selection), energy.parts(), folder, seen);
            recorder.and_then(|one| one.keep_scene(&resolved).map(|()| Some(one)))
        }
        _ => Ok(None),
    };
    let mut recorder = agreed(engine, made.map_err(RunError::from))?;
    enter(&mut clock, watch, "solve");
    let n = share.own.len() * case.body.dimension();
    let given = vec![0.0; case.body.positions().len()];
    let mut steps = LoadSteps {
        engine,
        case,
        slab: &mut slab,
        newton,
        boundary: &boundary,
        fields,
        u: vec![0.0; n],
        given,
        t: 0.0,
        solves: Solves::default(),
    };
    let here = PointFields { case, energy, selection, masses: None };
    let shown = |slab: &Slab<'_>, t: f64, number: Option<usize>| {
        let mut now = slab.frame(case, t);
        here.fill(&mut now);
        let colour = here.colour(&now);
        view.show(number, (now, colour))
    };
    let sums = |slab: &Slab<'_>| Sums::of(engine, energy, (slab, share), (case, selection));
    let is_known = steps.rest()?;
    let at_rest = is_known.then(|| sums(steps.slab));
    let rest = shown(steps.slab, 0.0, Some(0))?;
    let begun_with = recorder.as_mut().map_or(Ok(()), |recorder| recorder.begin(at_rest, rest));
    agreed(engine, begun_with.map_err(RunError::from))?;
    // Ends of increments so far, frames, and whether the last equilibrium is one.
    let (mut nominal, mut frames, mut framed) = (0, 1, false);
    let mut see = |steps: &mut LoadSteps<'_, '_>, found: Found| {
        nominal += usize::from(found.nominal);
        framed = found.nominal && is_due(&case.scene, nominal);
        let sums = sums(steps.slab);
        let now = if framed { shown(steps.slab, found.t, Some(frames))? } else { None };
        frames += usize::from(framed);
        let written = recorder.as_mut().map_or(Ok(()), |recorder| {
            recorder.record(&found, sums, &steps.slab.residuals, energy.parts(), now)
        });
        agreed(engine, written.map_err(RunError::from))
    };
    let (end, increments) = (case.scene.steps.end, case.scene.steps.increments);
    let mut failed = None;
    for k in 1..=increments {
        let t = if k == increments { end } else { end * (k as f64 / increments as f64) };
        if let Err(not_found) = steps.go_to(t, &mut see)? {
            failed = Some(not_found);
            break;
        }
    }
    if !framed && steps.t > 0.0 {
        steps.return_to_last()?;
        let number = (case.scene.output.frames > 0).then_some(frames);
        let last = shown(steps.slab, steps.t, number)?;
        let written = recorder.as_mut().map_or(Ok(()), |recorder| recorder.show(last));
        agreed(engine, written.map_err(RunError::from))?;
    }
    enter(&mut clock, watch, "output");
    let (t, solves) = (steps.t, steps.solves);
    let written = view.write_displacement(folder, &steps.u);
    agreed(engine, written.map_err(RunError::from))?;
    let counts = counts(engine, energy);
    let unused = engine.unused_options().map_err(lost)?;
    let done = recorder.as_ref().map_or(0, Recorder::steps);
    let ending = Ending {
        reason: if failed.is_some() { ExitReason::NotConverged } else { ExitReason::Completed },
        message: failed.map_or_else(String::new, |failed| {
            format!("no equilibrium at t = {}, the last is at t = {t}: {}", failed.t, failed.reason)
        }),
        helps: Vec::new(),
        done: format!("{} converged on {}", counted(done, "step"), counted(engine.ranks(), "rank")),
        steps: done,
        indefinite: 0,
        fails: false,
        inverted: Inverted::default(),
        warnings: warnings(&case.scene, &unused),
    };
    let written = match recorder {
        Some(recorder) => {
            let solver = solver_summary(solves);
            let told = (&ending, begun.options.clone());
            recorder.finish(begun, told, (solver, counts), (&resolved, clock))
        }
        None => Ok(()),
    };
    agreed(engine, written.map_err(RunError::from))?;
    Ok(ending)
}

/// A number by which ranks see that they read the same scene, potentials and tables.
pub fn hash(case: &Case) -> u64 {
    let name = super::run::hash(case, &case.scene.resolved_toml());
    fnv1a64(FNV1A64_OF_NOTHING, name.as_bytes())
}

/// Refuses processors of several kinds where ranks rely on it that what they judge alike is alike to the last bit.
/// Collective.
fn check_kernels(case: &Case, engine: &Engine) -> Result<(), RunError> {
    if !case.can_break() && case.n_states() == 0 {
        return Ok(());
    }
    let target =
        agreed(engine, target().map_err(|error| CaseError::Body { message: error.to_string() }))?;
    let all = engine.all_gather(fnv1a64(FNV1A64_OF_NOTHING, target.as_bytes()));
    let other = all.iter().position(|one| *one != all[0]);
    let told = other.map_or(Ok(()), |rank| {
        let message = format!(
            "the processor of rank {rank} is of another kind than that of rank 0, and what breaks would be judged by other \
             kernels: let machines of one kind share the run"
        );
        Err(CaseError::Body { message })
    });
    agreed(engine, told)
}

/// Choices that made no difference.
fn warnings(scene: &Scene, unused: &[String]) -> Vec<String> {
    let (own, usual) = (&scene.solver, SolverSettings::default());
    let set = [
        ("linear", own.linear != usual.linear),
        ("preconditioner", own.preconditioner != usual.preconditioner),
        ("newton", own.newton != usual.newton),
        ("start", own.start != usual.start),
        ("max_iterations", own.max_iterations != usual.max_iterations),
        ("products", own.products != usual.products),
    ];
    let idle = set.into_iter().filter(|(_, is_set)| *is_set).map(|(key, _)| {
        format!(
            "`{key}` of [solver] makes no difference over ranks: options of PETSc stand behind `--`"
        )
    });
    let unused = unused
        .iter()
        .map(|option| format!("no part of PETSc asked for the option {option}: is it misspelt?"));
    idle.chain(unused).collect()
}

/// Refuses what runs of many ranks do not do.
fn refuse(case: &Case) -> Result<(), CaseError> {
    let scene = &case.scene;
    let motion = scene.motion.as_ref();
    let cannot = [
        (
            motion.is_none() && (case.can_break() || case.n_states() > 0),
            "load steps of bodies that break or remember run in one process: leave --petsc out",
        ),
        (
            motion.is_some_and(|motion| motion.method == Method::Midpoint),
            "motions by the midpoint rule run in one process: leave --petsc out, or take an explicit method",
        ),
        (
            motion.is_none()
                && (scene.steps.find != Find::Newton || scene.steps.control != Control::Load),
            "over ranks equilibria are found by Newton's method at given loads: leave `find` and `control` out of [steps]",
        ),
    ];
    if let Some((_, message)) = cannot.iter().find(|(is_so, _)| *is_so) {
        return Err(CaseError::Body { message: (*message).to_string() });
    }
    Ok(())
}

/// What of sets are a rank's own points, among those that it holds.
fn own_of(selection: &Selection, share: &Share) -> Selection {
    let own = share.own_of_held();
    let of = |set: &PointSet| PointSet {
        points: set.points.iter().copied().filter(|point| own.contains(point)).collect(),
        ..set.clone()
    };
    let sets = selection.sets.iter().map(of).collect();
    Selection { sets, probes: Vec::new(), warnings: Vec::new() }
}

/// Interactions that there are, and those without a measure at rest, which are left out.
type Counts = [InteractionCounts; 2];

/// Those of the whole body. Collective.
fn counts(engine: &Engine, energy: &Total<'_>) -> Counts {
    let report = energy.report();
    let Report { bonds, triangles, tetrahedra, dropped_triangles, dropped_tetrahedra, .. } = report;
    let all = [bonds, triangles, tetrahedra, dropped_triangles, dropped_tetrahedra];
    let mut all = all.map(|count| count as f64);
    engine.sum(&mut all);
    let [bonds, triangles, tetrahedra, flat, flat_tetrahedra] = all.map(|count| count as usize);
    let dropped = InteractionCounts { bonds: 0, triangles: flat, tetrahedra: flat_tetrahedra };
    [InteractionCounts { bonds, triangles, tetrahedra }, dropped]
}

fn solver_summary(solves: Solves) -> SolverSummary {
    SolverSummary {
        linear: "PETSc".to_owned(),
        linear_reason: "the run is over ranks".to_owned(),
        preconditioner: None,
        linear_iterations: solves.iterations as usize,
        linear_solves: solves.systems as usize,
        factorizations: 0,
        tangents: solves.systems as usize,
        gradients: 0,
    }
}
