//! What will be modelled and what it costs, before it is built.
//!
//! Small bodies are counted, larger ones from a sample of points, boxes that are not filled by their
//! sides ([`count_interactions`], [`estimate_interactions`], [`count_in_box`]). Times are right within
//! a factor of 3, memory within 1.5. Factorisations and products with a stored tangent rest on what the
//! machine at hand can do ([`Pace`]), interactions on constants that were measured on one core of a 3 GHz
//! server processor, and times of small bodies on their first increment.

mod count;
mod factor;
pub(crate) mod families;
mod ranks;
mod tables;
mod text;
mod time;

use std::convert::Infallible;

use piola_mechanics::body::Body;
use piola_solvers::linear::{
    self, Choice, Circumstances, LinearMethod, MEMORY_SHARE, PreconditionerChoice,
};
use piola_solvers::motion::Method;
use piola_solvers::steps::{Control, Find};
use serde::Serialize;

use crate::scene::{LatticeShape, Motion, Scene};
pub use count::{
    InteractionCount, Needed, count_in_box, count_interactions, estimate_interactions,
};
pub use factor::{FactorEstimate, estimate_factor};
pub use families::Families;
pub use ranks::RanksPlan;
use tables::tables;
pub(crate) use text::bytes as in_bytes;
use time::Passes;
pub use time::{Basis, ChangeOver, FirstIncrement, Pace, TimeEstimate};

/// Memory of a factorisation over that of its factor's numbers: padding, workspace, indices.
const CHOLESKY_OVERHEAD: f64 = 1.6;
/// The same for LU, which ignores symmetry and keeps two factors.
const LU_OVERHEAD: f64 = 8.0;
/// Numbers per point of the preconditioner: diagonal blocks and linear functions.
const PRECONDITIONER_NUMBERS: usize = 24;

/// What a run may need over what is planned.
const MEMORY_MARGIN: f64 = 1.2;

/// Vectors of displacements and forces that a run keeps.
const STATE_VECTORS: usize = 14;

/// What became of one energy of the potential.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KernelNote {
    /// The energy as the potential writes it, e.g. `psi(a)`.
    pub energy: String,
    /// Whether it is modelled.
    pub modelled: bool,
    /// Why, in words: `C2 = 0`, `no volumes in two dimensions`.
    pub reason: String,
}

/// One item of memory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MemoryItem {
    /// What it holds.
    pub item: &'static str,
    /// How much, in bytes.
    pub bytes: u64,
}

/// The outline of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// 2 or 3.
    pub dimension: usize,
    /// How many points there are.
    pub points: usize,
    /// The bounding box in spacings, one number per dimension, each at least 1.
    pub sides: Vec<f64>,
    /// The lattice spacing, or the edge of a point's mean volume, in m.
    pub spacing: f64,
    /// Whether the points are a lattice, so that most have the same neighbours in numbering.
    pub is_lattice: bool,
}

impl Extent {
    /// Of a body.
    pub fn of(body: &Body) -> Extent {
        let spacing = typical_spacing(body);
        let dimension = body.dimension();
        let side = |axis: usize| {
            let column = || body.positions().iter().skip(axis).step_by(dimension).copied();
            let least = column().fold(f64::INFINITY, f64::min);
            let most = column().fold(f64::NEG_INFINITY, f64::max);
            ((most - least) / spacing + 1.0).max(1.0)
        };
        let sides = (0..dimension).map(side).collect();
        let is_lattice = body.spacing().is_some();
        Extent { dimension, points: body.n_points(), sides, spacing, is_lattice }
    }

    /// Of a whole box.
    pub fn of_box(shape: &LatticeShape) -> Extent {
        let counts = shape.counts();
        let points = counts.iter().fold(1, |points: usize, n| points.saturating_mul(*n));
        let sides = counts.iter().map(|n| *n as f64).collect();
        Extent { dimension: counts.len(), points, sides, spacing: shape.spacing, is_lattice: true }
    }
}

/// Everything a plan is made from.
#[derive(Clone, Debug)]
pub struct PlanInput<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The outline of its body.
    pub extent: Extent,
    /// What [`count_interactions`] found.
    pub interactions: InteractionCount,
    /// The energies of the potential.
    pub kernels: Vec<KernelNote>,
    /// How many energies of bonds, triangles and tetrahedra there are; those of several measures count as
    /// often as they take longer.
    pub energies: [usize; 3],
    /// Whether passes over bonds, triangles and tetrahedra need no kernels: their laws are affine, and they go along
    /// the rows of a lattice, or, bonds of clouds, in fours.
    pub without_kernels: [bool; 3],
    /// Whether bonds can break, or are cut.
    pub breaks: bool,
    /// Whether triangles, and tetrahedra, can break by conditions of their own.
    pub breaks_cliques: [bool; 2],
    /// How many numbers each bond remembers, each triangle, each tetrahedron and each point.
    pub states: [usize; 4],
    /// How many potentials have energies of interactions.
    pub of_interactions: usize,
    /// What points know of their families, for each energy that needs it.
    pub families: Vec<Families>,
    /// How many displacement components are prescribed.
    pub prescribed: usize,
    /// What the plan does not know, in sentences.
    pub notes: Vec<String>,
    /// How many threads will work.
    pub threads: usize,
    /// How fast they are.
    pub pace: Pace,
    /// What the machine can give, in bytes; see [`available_memory`].
    pub available_memory: Option<u64>,
}

/// What will be modelled and what it costs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// 2 or 3.
    pub dimension: usize,
    /// How many points.
    pub points: usize,
    /// How many displacement components are solved for.
    pub unknowns: usize,
    /// Bonds, triangles, tetrahedra.
    pub interactions: InteractionCount,
    /// What became of the energies.
    pub kernels: Vec<KernelNote>,
    /// How linear systems will be solved, and why.
    #[serde(flatten)]
    pub linear: Choice,
    /// The stored tangent that takes over where products are not worth it, if one may.
    pub stored: Option<Stored>,
    /// Memory by item, in bytes; with the stored tangent where the first increment went over to it.
    pub memory: Vec<MemoryItem>,
    /// All items together, in bytes.
    pub memory_total: u64,
    /// What the machine can give, in bytes, if it tells.
    pub available_memory: Option<u64>,
    /// How many threads will work.
    pub threads: usize,
    /// How many increments the scene has.
    pub increments: usize,
    /// Time by phase.
    pub time: TimeEstimate,
    /// Whether energies are of families.
    #[serde(skip)]
    of_families: bool,
    /// Of a body that moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionPlan>,
    /// Of load steps that go by events.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub events: Option<EventPlan>,
    /// What each of many processes takes, where somebody asked for that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ranks: Option<RanksPlan>,
    /// What was seen of the first increment, if it was tried.
    pub first: Option<FirstIncrement>,
    /// What the plan does not know of the body, in sentences.
    pub notes: Vec<String>,
}

/// What is known of a motion before it begins.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MotionPlan {
    /// How many steps there are, where the scene says how long they are.
    pub steps: Option<f64>,
    /// Forces of one step, in s, at most; of a rule that looks for an equilibrium in every step about as
    /// much as its products take.
    pub pass: f64,
    /// All of them, where they are known.
    pub total: Option<f64>,
}

/// What is known of load steps by events before they begin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EventPlan {
    /// How many events there are at most: how many there will be nobody knows.
    pub most: usize,
    /// One of them, in s.
    pub each: f64,
    /// The run with so many of them, in s.
    pub total: f64,
}

/// Newton iterations of an event: the plate of `examples/double_notch` took 2600 factorisations for 511.
const EVENT_ITERATIONS: f64 = 5.0;

impl EventPlan {
    fn new(most: usize, time: &TimeEstimate) -> EventPlan {
        let each = EVENT_ITERATIONS * (time.assembly + time.linear);
        EventPlan { most, each, total: time.total + most as f64 * each }
    }
}

/// Products with the Hessian and evaluations of forces in a step of the midpoint rule: 90 to 150 were seen for
/// steps of ten critical ones.
const IMPLICIT_PASSES: f64 = 100.0;

impl MotionPlan {
    fn new(motion: &Motion, time: &TimeEstimate) -> MotionPlan {
        let steps = motion.step.map(|step| piola_solvers::motion::n_steps(motion.end, step));
        // Forces take no longer than forces with the tangent.
        let passes = if motion.method == Method::Midpoint { IMPLICIT_PASSES } else { 1.0 };
        let pass = passes * time.assembly;
        MotionPlan { steps, pass, total: steps.map(|steps| time.setup + steps * pass) }
    }
}

impl Plan {
    /// Estimates memory and time of a run.
    pub fn new(input: PlanInput<'_>) -> Plan {
        let linear = chosen(&input);
        let Costs { memory, time } = Costs::new(&input, &linear);
        let stored = Stored::new(&input, &linear);
        let unknowns = input.unknowns();
        let motion = input.scene.motion.as_ref().map(|motion| MotionPlan::new(motion, &time));
        let goes_by_events =
            input.scene.motion.is_none() && input.scene.steps.control == Control::Event;
        let events = goes_by_events.then(|| EventPlan::new(input.scene.steps.events, &time));
        let PlanInput { scene, extent, interactions, kernels, threads, mut notes, .. } = input;
        if scene.motion.is_none() && scene.steps.control == Control::ArcLength {
            notes.push(format!(
                "the number of steps: the plan takes {}, as if t never fell; a run along the way ends at \
                 `end`, after {} steps, the `arcs` of [steps], or before",
                scene.steps.increments, scene.steps.arcs
            ));
        }
        Plan {
            dimension: extent.dimension,
            points: extent.points,
            unknowns,
            interactions,
            kernels,
            linear,
            stored,
            memory_total: total(&memory),
            memory,
            available_memory: input.available_memory,
            threads,
            increments: scene.steps.increments,
            time,
            of_families: !input.families.is_empty(),
            motion,
            events,
            ranks: None,
            first: None,
            notes,
        }
    }

    /// Takes what was seen of the first increment instead of the estimates of its cost: the stored tangent
    /// for the run, where one took over.
    pub fn rehearsed(&mut self, first: FirstIncrement) {
        let step = self.stored.as_ref().map(|stored| (stored.assembly, stored.linear));
        self.time = self.time.of(&first, step, self.increments);
        self.events = self.events.map(|events| EventPlan::new(events.most, &self.time));
        if first.stored.is_some()
            && let Some(stored) = &self.stored
        {
            self.memory.clone_from(&stored.memory);
            self.memory_total = stored.memory_total;
        }
        self.first = Some(first);
    }

    /// Why this machine should not try, if it should not: estimates may be too low, so they keep a
    /// margin.
    pub fn refusal(&self) -> Option<String> {
        let needed = (self.memory_total as f64 * MEMORY_MARGIN) as u64;
        let available = self.available_memory.filter(|available| needed > *available)?;
        let largest = self.memory.iter().max_by_key(|item| item.bytes)?;
        Some(format!(
            "this needs about {} of memory ({} for the {}), and {} are available",
            text::bytes(self.memory_total),
            text::bytes(largest.bytes),
            largest.item,
            text::bytes(available)
        ))
    }
}

/// Memory that a new process may use now, in bytes: the machine's, or its control group's if less.
/// `None` on a system that does not tell.
pub fn available_memory() -> Option<u64> {
    let mut system = sysinfo::System::new().ok()?;
    system.refresh_memory();
    let machine = system.available_memory();
    Some(match system.cgroup_limits() {
        Some(limits) if limits.total_memory > 0 => machine.min(limits.free_memory),
        _ => machine,
    })
}

/// The lattice spacing, or the edge of a point's mean volume.
fn typical_spacing(body: &Body) -> f64 {
    crate::scene::selection::typical_spacing(body.dimension(), body.volumes(), body.spacing())
}

/// All items together, in bytes.
fn total(memory: &[MemoryItem]) -> u64 {
    memory.iter().map(|item| item.bytes).sum()
}

/// Blocks of the upper triangle of a matrix that couples points over so many bonds: as many as points of the
/// box that are within so many horizons.
fn blocks(extent: &Extent, layers: f64, interactions: &InteractionCount, reach: usize) -> f64 {
    let n = extent.points as f64;
    let bonds = interactions.bonds as f64;
    let in_box = |reach: usize| count::bonds_in_box(&extent.sides, layers * reach as f64);
    let wider = if reach == 1 { 1.0 } else { in_box(reach) / in_box(1).max(1.0) };
    (n + bonds * wider).min(0.5 * n * (n + 1.0))
}

/// Bytes of so many blocks, and a column number for each.
fn matrix_bytes(dimension: usize, blocks: f64) -> (f64, f64) {
    (blocks * (8 * dimension * dimension) as f64, 4.0 * blocks)
}

/// The tangent or its preconditioner, and its Cholesky factor.
#[derive(Clone, Copy)]
struct System {
    blocks: f64,
    factor: FactorEstimate,
}

impl PlanInput<'_> {
    fn unknowns(&self) -> usize {
        self.extent.points.saturating_mul(self.extent.dimension).saturating_sub(self.prescribed)
    }

    /// The horizon in spacings.
    fn layers(&self) -> f64 {
        self.scene.horizon_radius() / self.extent.spacing
    }

    fn blocks(&self, reach: usize) -> f64 {
        blocks(&self.extent, self.layers(), &self.interactions, reach)
    }

    /// Where points share an entry over so many bonds.
    fn system(&self, reach: usize) -> System {
        let Extent { ref sides, dimension, .. } = self.extent;
        let factor = estimate_factor(sides, self.layers() * reach as f64, dimension);
        System { blocks: self.blocks(reach), factor }
    }

    fn circumstances(&self, system: System) -> Circumstances {
        let memory = self.available_memory;
        Circumstances {
            dimension: self.extent.dimension,
            unknowns: self.unknowns(),
            matrix_bytes: matrix_bytes(self.extent.dimension, system.blocks).0,
            memory_limit: memory.map_or(f64::INFINITY, |m| MEMORY_SHARE * m as f64),
        }
    }
}

impl System {
    /// Operations and bytes of a factorisation.
    fn cost(self) -> (f64, f64) {
        (self.factor.flops, 8.0 * self.factor.entries)
    }
}

/// How linear systems are solved; a relaxation has none, and stores nothing.
fn asked(scene: &Scene) -> LinearMethod {
    match scene.steps.find {
        Find::Newton => scene.solver.linear,
        Find::Relaxation => LinearMethod::MatrixFree,
    }
}

/// The method that linear systems begin with.
fn chosen(input: &PlanInput<'_>) -> Choice {
    let solver = &input.scene.solver;
    let settled = linear::settled(asked(input.scene), !input.families.is_empty(), solver.products);
    let mut linear = settled.unwrap_or_else(|| {
        let system = input.system(1);
        let cost = || Ok::<_, Infallible>(system.cost());
        let Ok(choice) = linear::choose(&input.circumstances(system), cost);
        choice
    });
    if linear.method == LinearMethod::Ldlt {
        // Estimates do not tell the two apart.
        linear.method = LinearMethod::Cholesky;
    }
    linear
}

/// What a run costs with one method.
struct Costs {
    memory: Vec<MemoryItem>,
    time: TimeEstimate,
}

impl Costs {
    fn new(input: &PlanInput<'_>, linear: &Choice) -> Costs {
        let PlanInput { extent, interactions, families, pace, .. } = input;
        let dimension = extent.dimension;
        let System { blocks, factor } =
            input.system(if linear.stores_matrix { families::reach(families) } else { 1 });
        let mut memory = memory(extent, interactions, blocks, linear, factor, families);
        if input.scene.motion.is_some() {
            // Products with the Hessian are all that a motion wants beside forces.
            memory.truncate(
                2 + families.iter().map(|own| own.memory(1, 2, 1.0).len()).sum::<usize>(),
            );
        } else {
            memory.extend(families::terms(input.of_interactions, families, linear, |reach| {
                matrix_bytes(dimension, input.blocks(reach))
            }));
        }
        if input.scene.horizon.weighting().corrects() {
            // A factor by its number, and once more along rows, with their ends.
            let bytes = 20 * interactions.bonds;
            memory.push(MemoryItem { item: "corrections of bonds", bytes });
        }
        if input.breaks {
            // Whether it is broken, how far it may grow, and a factor with its place along rows.
            let bytes = 21 * interactions.bonds;
            memory.push(MemoryItem { item: "status of bonds", bytes });
        }
        memory.extend(tables(extent, interactions, input.without_kernels));
        if input.breaks_cliques != [false; 2] {
            // A bit in the energy and one beside it.
            let of = [interactions.triangles, interactions.tetrahedra];
            let judged = of.iter().zip(input.breaks_cliques).filter(|(_, breaks)| *breaks);
            let bytes = judged.map(|(n, _)| n / 4).sum();
            memory.push(MemoryItem { item: "status of cliques", bytes });
        }
        let remembering = [
            ("states of bonds", interactions.bonds),
            ("states of triangles", interactions.triangles),
            ("states of tetrahedra", interactions.tetrahedra),
            ("states of points", extent.points as u64),
        ];
        for ((item, n), states) in remembering.into_iter().zip(input.states) {
            let bytes = 8 * states as u64 * n;
            memory.extend((bytes > 0).then_some(MemoryItem { item, bytes }));
        }
        let passes = Passes::new(interactions, input.energies, input.without_kernels);
        let time = if families.is_empty() {
            let horizons = extent.sides.iter().fold(0.0_f64, |a, b| a.max(*b)) / input.layers();
            let choice = input.scene.solver.preconditioner;
            let jacobi = choice == PreconditionerChoice::BlockJacobi;
            let horizons = (jacobi || !linear.stores_matrix).then_some(horizons);
            TimeEstimate::new(passes, (dimension, blocks), linear, factor, horizons, *pace)
        } else {
            let work = (interactions.bonds as f64, passes);
            families::time(families, extent, work, (blocks, factor), linear, *pace)
        };
        Costs { memory, time: time.for_increments(input.scene.steps.increments) }
    }
}

/// A stored tangent that takes over from products for the rest of a run, and its Cholesky factor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stored {
    /// Products of one system after which it does; it does at once where the tangent is indefinite.
    pub products: usize,
    /// Memory by item, in bytes.
    pub memory: Vec<MemoryItem>,
    /// All items together, in bytes.
    pub memory_total: u64,
    /// Energy, forces and tangent, per Newton iteration, in s.
    pub assembly: f64,
    /// Factorisation, per Newton iteration, in s.
    pub linear: f64,
}

impl Stored {
    fn new(input: &PlanInput<'_>, begins: &Choice) -> Option<Stored> {
        let auto = asked(input.scene) == LinearMethod::Auto;
        if !auto || begins.method != LinearMethod::MatrixFree || input.families.is_empty() {
            return None;
        }
        let wide = input.system(families::reach(&input.families));
        let stored = input.circumstances(wide);
        let bonded = input.blocks(1) as usize;
        let products = linear::products_before_stored(&stored, wide.cost(), bonded)?;
        let choice = Choice {
            method: LinearMethod::Cholesky,
            stores_matrix: true,
            reason: begins.reason.clone(),
        };
        let Costs { memory, time } = Costs::new(input, &choice);
        let (assembly, linear) = (time.assembly, time.linear);
        Some(Stored { products, memory_total: total(&memory), memory, assembly, linear })
    }
}

/// Memory of the parts of a run.
fn memory(
    extent: &Extent,
    interactions: &InteractionCount,
    blocks: f64,
    linear: &Choice,
    factor: FactorEstimate,
    families: &[Families],
) -> Vec<MemoryItem> {
    let (n, d) = (extent.points, extent.dimension);
    let bonds = interactions.bonds as f64;
    let (values, columns) = matrix_bytes(d, blocks);
    // Rows that lattices share; of clouds those that were found, and those that are kept.
    let neighbourhood = 44.0 * n as f64 + if extent.is_lattice { 0.0 } else { 16.0 * bonds };
    let mut items = vec![
        ("points and displacements", (n * (8 * d + 12 + STATE_VECTORS * 8 * d)) as f64),
        ("neighbourhood", neighbourhood),
    ];
    for families in families {
        items.extend(families.memory(n, d, bonds));
    }
    let of_families = !families.is_empty();
    items.push(match (linear.stores_matrix, of_families) {
        (false, true) => ("preconditioner (bond-based)", values + columns),
        (false, false) => ("tangent, upper blocks", columns),
        _ => ("tangent, upper blocks", values + columns),
    });
    let factor_bytes = |overhead: f64| ("factor", factor.entries * 8.0 * overhead);
    match linear.method {
        LinearMethod::Cholesky => {
            items.push(("tangent, free components", 2.0 * values));
            items.push(factor_bytes(CHOLESKY_OVERHEAD));
        }
        LinearMethod::Lu => {
            items.push(("tangent, free components", 4.0 * values));
            items.push(factor_bytes(LU_OVERHEAD));
        }
        _ if !linear.stores_matrix && of_families && families::is_factorised(factor, blocks) => {
            items.push(("preconditioner, free part", 2.0 * values));
            items.push(("preconditioner, factor", factor_bytes(CHOLESKY_OVERHEAD).1));
        }
        _ => items.push(("preconditioner", (n * 8 * PRECONDITIONER_NUMBERS) as f64)),
    }
    if linear.method == LinearMethod::Gmres {
        items.push(("vectors of GMRES", (n * 8 * d * (linear::RESTART + 1)) as f64));
    }
    items.into_iter().map(|(item, bytes)| MemoryItem { item, bytes: bytes as u64 }).collect()
}

#[cfg(test)]
mod tests;
