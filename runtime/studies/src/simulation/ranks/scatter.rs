//! Bodies from files: rank 0 reads them, and sends each rank what it holds.
//!
//! A message is a list of numbers, those of [`HEADER`] first, then row by row what belongs to the points of the rank:
//! places in the user's order of the whole body, positions in m and volumes, in the body's order; and in the user's order
//! columns that parameters take, and which points the sets have that files list. Names of columns come first.

use std::sync::Arc;

use piola_mechanics::body::{Body, SlabCut};
use piola_petsc::Engine;

use super::share::Share;
use super::steps::agreed;
use crate::case::{Case, Columns};
use crate::scene::{HorizonExtent, Members};
use crate::simulation::forecast::enough_points;
use crate::simulation::run::RunError;

/// How many numbers come before rows: of the whole body how many points it has, the axis that they are sorted along, their
/// spacing and the horizon in m, and the hash of files in two halves; the ends of what the rank owns, and of what it holds;
/// where the next points along the axis are, before it and behind, in m. What there is not is not a number.
const HEADER: usize = 12;

/// The part of a case that a rank has of one from files, without materials and values of what varies.
pub(super) struct Received {
    pub(super) case: Case,
    pub(super) body: Body,
    pub(super) share: Share,
    pub(super) n_points: usize,
}

/// Reads the points of a case without points on rank 0, and shares them out. Collective.
///
/// # Errors
/// On all ranks what is wrong with files; more ranks than points.
pub(super) fn scattered(mut outline: Case, engine: &Engine) -> Result<Received, RunError> {
    let read = (engine.rank() == 0).then(|| outline.clone().with_points()).transpose();
    let whole = agreed(engine, read)?;
    let n = whole.as_ref().map_or(0, |whole| whole.body.n_points());
    let enough = if whole.is_some() { enough_points(n, engine.ranks()) } else { Ok(()) };
    agreed(engine, enough)?;
    let mut names =
        whole.as_ref().map_or_else(Vec::new, |whole| whole.columns.names.join("\n").into_bytes());
    engine.broadcast(&mut names);
    let bytes = engine.scatter(|rank| {
        let numbers = whole.as_ref().map(|whole| message(whole, (rank, engine.ranks())));
        numbers.unwrap_or_default().into_iter().flat_map(f64::to_le_bytes).collect()
    });
    let numbers: Vec<f64> =
        bytes.as_chunks::<8>().0.iter().map(|eight| f64::from_le_bytes(*eight)).collect();
    drop(bytes);
    let names = String::from_utf8_lossy(&names);
    let names = names.lines().map(str::to_owned).collect();
    // What there is to know, and the cells of a mesh, rank 0 has.
    if let Some(mut whole) = whole {
        // Of cracks all ranks say what they see.
        let n_of_cracks = whole.warnings_of_cracks().len();
        whole.warnings.truncate(whole.warnings.len() - n_of_cracks);
        (outline.mesh, outline.warnings) = (whole.mesh, whole.warnings);
    }
    Ok(received((outline, names), &numbers, engine.ranks()))
}

/// What a rank is sent.
fn message(whole: &Case, (rank, ranks): (usize, usize)) -> Vec<f64> {
    let body = whole.body.as_ref();
    let (d, axis, share) =
        (body.dimension(), body.sorted_axis(), Share::of(body, whole.reach(), (rank, ranks)));
    let (own, held) = (share.own, share.held);
    let along = |point: usize| body.position(point)[axis];
    let radius = match whole.scene.horizon.extent {
        HorizonExtent::Radius(radius) => radius,
        HorizonExtent::Spacings(_) => f64::NAN,
    };
    let halves = whole.content.map(|content| [content >> 32, content & 0xffff_ffff]);
    let halves = halves.map_or([f64::NAN; 2], |halves| halves.map(|half| half as f64));
    let before = held.start.checked_sub(1).map_or(f64::NAN, along);
    let behind = if held.end < body.n_points() { along(held.end) } else { f64::NAN };
    let spacing = body.spacing().unwrap_or(f64::NAN);
    let mut numbers = vec![body.n_points() as f64, axis as f64, spacing, radius];
    numbers.extend(halves);
    numbers.extend([own.start, own.end, held.start, held.end].map(|point| point as f64));
    numbers.extend([before, behind]);
    assert_eq!(numbers.len(), HEADER, "as many as are read");
    let users = &body.user_index()[held.clone()];
    numbers.extend(users.iter().map(|user| f64::from(*user)));
    numbers.extend_from_slice(&body.positions()[held.start * d..held.end * d]);
    numbers.extend_from_slice(&body.volumes()[held]);
    let mut users = users.to_vec();
    users.sort_unstable();
    for column in &whole.columns.values {
        numbers.extend(users.iter().map(|user| column[*user as usize]));
    }
    for set in &whole.scene.sets {
        if let Members::Listed { inside, .. } = &set.members {
            numbers.extend(users.iter().map(|user| f64::from(u8::from(inside[*user as usize]))));
        }
    }
    numbers
}

/// What a rank has of its message.
fn received((mut case, names): (Case, Vec<String>), numbers: &[f64], ranks: usize) -> Received {
    let (header, mut rows) = numbers.split_at(HEADER);
    let there = |x: f64| (!x.is_nan()).then_some(x);
    let count = |place: usize| header[place] as usize;
    let (n_points, axis, d) = (count(0), count(1), case.scene.body.dimension);
    if let Some(radius) = there(header[3]) {
        case.scene.horizon.extent = HorizonExtent::Radius(radius);
    }
    case.content = there(header[4]).map(|high| (high as u64) << 32 | header[5] as u64);
    let ranges = Share::ranges(n_points, ranks);
    let share = Share { ranges, own: count(6)..count(7), held: count(8)..count(9) };
    let n = share.held.len();
    let mut take = |n: usize| {
        let (own, rest) = rows.split_at(n);
        rows = rest;
        own
    };
    let users = take(n).iter().map(|user| *user as u32).collect();
    let (positions, volumes) = (take(n * d).to_vec(), take(n).to_vec());
    let values = names.iter().map(|_| take(n).to_vec()).collect();
    case.columns = Columns { names, values };
    for set in &mut case.scene.sets {
        if let Members::Listed { inside, .. } = &mut set.members {
            *inside = Arc::new(take(n).iter().map(|x| *x > 0.0).collect());
        }
    }
    let cut = SlabCut {
        own: share.own_of_held(),
        before: there(header[10]),
        behind: there(header[11]),
        horizon: case.scene.horizon_radius(),
    };
    let body = Body::slab((d, axis), (positions, volumes), there(header[2]), users, cut);
    Received { case, body, share, n_points }
}
