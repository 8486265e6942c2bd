//! What each of many processes takes of a body: a slab of points, and the halo that its forces depend on.

use serde::Serialize;

use super::{Extent, MemoryItem, Plan, blocks, matrix_bytes, total};

/// Distances are compared with this part of themselves to spare, as runs do it.
const MARGIN: f64 = 1e-6;

/// Memory of a process with MPI and PETSc before it has read a scene, in bytes.
pub(super) const PROGRAM: &str = "45 MB";

/// Of what PETSc has for each entry of a block in own rows, in bytes: its matrix, a number and a column.
const MATRIX: f64 = 12.0;

/// Coarse levels, interpolation and what sets them up, by one process and by several, in bytes per own point and `d^2`:
/// measured on cubes of bonds. Tangents that reach further take no more, as more points become one on the next level.
const MULTIGRID: [f64; 2] = [410.0, 1100.0];

/// Vectors of own points that exist while a frame of a motion is written.
const FRAME_VECTORS: usize = 11;

/// Items of a plan that PETSc has in another form.
const SOLVERS: [&str; 4] = ["tangent", "factor", "preconditioner", "vectors of GMRES"];

/// What the largest of so many processes takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RanksPlan {
    /// How many processes there are.
    pub ranks: usize,
    /// How many points one owns.
    pub own: usize,
    /// How many it holds besides, which others own.
    pub halo: usize,
    /// Memory by item, in bytes.
    pub memory: Vec<MemoryItem>,
    /// All items together, in bytes.
    pub memory_total: u64,
    /// Bytes that it receives whenever displacements are brought, and velocities where bonds dissipate: once a step of a
    /// motion, once an evaluation of forces or tangent in load steps.
    pub received: u64,
    /// From how many others these come.
    pub messages: usize,
    /// How many processes the body has room for: with more of them one owns less than it holds of others.
    pub room: usize,
}

impl RanksPlan {
    /// Of a body and its plan for one process. Forces depend on points as far as `reach`, and the tangent couples points
    /// over so many bonds, `coupled`; lengths in m. What dissipates needs velocities besides displacements.
    pub(crate) fn new(
        plan: &Plan,
        extent: &Extent,
        (horizon, reach, coupled): (f64, f64, usize),
        dissipates: bool,
        ranks: usize,
    ) -> RanksPlan {
        let (n, d) = (extent.points, extent.dimension);
        let own = n.div_ceil(ranks);
        let longest = extent.sides.iter().fold(1.0_f64, |most, side| most.max(*side));
        // A cut is in the middle of a layer, whose rest belongs to the halo.
        let deep = ((reach * (1.0 + MARGIN) / extent.spacing).floor() + 0.5) * n as f64 / longest;
        let sides = ranks.saturating_sub(1).min(2);
        let halo = ((sides as f64 * deep) as usize).min(n - own);
        let share = (own + halo) as f64 / n.max(1) as f64;
        let layers = horizon / extent.spacing;
        let upper = blocks(extent, layers, &plan.interactions, coupled);
        let memory = memory(plan, (own, share), d, (upper, ranks));
        let across = (halo as f64 / sides.max(1) as f64 / own.max(1) as f64).ceil() as usize;
        RanksPlan {
            ranks,
            own,
            halo,
            memory_total: total(&memory),
            memory,
            received: (8 * d * halo * if dissipates { 2 } else { 1 }) as u64,
            messages: (sides * across).min(ranks - 1),
            room: ((n as f64 / (2.0 * deep)) as usize).max(1),
        }
    }
}

fn memory(
    plan: &Plan,
    (own, share): (usize, f64),
    d: usize,
    (upper, ranks): (f64, usize),
) -> Vec<MemoryItem> {
    let is_solver = |item: &&MemoryItem| !SOLVERS.iter().any(|name| item.item.starts_with(name));
    let held = |item: &MemoryItem| (item.item, item.bytes as f64 * share);
    let mut items: Vec<(&'static str, f64)> =
        plan.memory.iter().filter(is_solver).map(held).collect();
    let part = own as f64 / plan.points.max(1) as f64;
    if plan.motion.is_some() {
        items.push(("a frame as it is written", (own * 8 * d * FRAME_VECTORS) as f64));
    } else {
        let (values, columns) = matrix_bytes(d, upper);
        // Whole rows of own points: of each block its column, and where it stands if it is below the diagonal.
        let entries = (2.0 * upper - plan.points as f64) * (d * d) as f64 * part;
        let multigrid = MULTIGRID[usize::from(ranks > 1)];
        items.push(("tangent, upper blocks", (values + columns) * share));
        items.push(("tangent, rows of own points", entries * 12.0 / (d * d) as f64));
        items.push(("matrix of PETSc", entries * MATRIX));
        items.push(("multigrid of PETSc", (own * d * d) as f64 * multigrid));
    }
    items.into_iter().map(|(item, bytes)| MemoryItem { item, bytes: bytes as u64 }).collect()
}
