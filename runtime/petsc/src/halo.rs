//! Numbers of ghost points from their owners, and back.

use crate::engine::Engine;
use crate::error::EngineError;
use crate::ffi::RawHalo;

/// A plan of exchange, made once for a body that is shared out, and used in every evaluation.
///
/// Its arrays hold `d` numbers for each owned point, and behind them `d` numbers for each ghost in the order
/// in which the ghosts were given.
pub struct Halo<'e> {
    raw: RawHalo,
    ghosts: usize,
    d: usize,
    /// PETSc runs for as long as this lives.
    _engine: &'e Engine,
}

impl<'e> Halo<'e> {
    /// Rank `r` owns the points `ranges[r]..ranges[r + 1]`, the same ranges on all ranks; `ghosts` are the
    /// numbers of the points that this rank needs from others, in any order; `d` is at least 1. Collective.
    ///
    /// # Errors
    /// On every rank where on one the ranges are not ascending from 0, a ghost is its own point or none, or
    /// there are more points than PETSc counts; and what PETSc reports.
    pub fn new(
        engine: &'e Engine,
        ranges: &[u64],
        ghosts: &[u64],
        d: usize,
    ) -> Result<Halo<'e>, EngineError> {
        let placed = place(engine, ranges, ghosts, d);
        engine.agree(placed.as_ref().map(|_| ()).map_err(Clone::clone))?;
        let (owners, places) = placed.map_err(EngineError::new)?;
        let own = (ranges[engine.rank() + 1] - ranges[engine.rank()]) as usize;
        let raw = RawHalo::new(engine.running(), own, &owners, &places, d)?;
        Ok(Halo { raw, ghosts: ghosts.len(), d, _engine: engine })
    }

    /// Gives every ghost the numbers that its owner has for the point. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    ///
    /// # Panics
    /// If `local` is not of the length that the type says: a mistake of the caller, not of a user.
    pub fn fill(&self, local: &mut [f64]) -> Result<(), EngineError> {
        self.raw.fill(local)
    }

    /// Adds what ghosts hold to the numbers of their owners; ghosts keep theirs. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    ///
    /// # Panics
    /// If `local` is not of the length that the type says: a mistake of the caller, not of a user.
    pub fn add_back(&self, local: &mut [f64]) -> Result<(), EngineError> {
        self.raw.add_back(local)
    }

    /// Bytes that this rank receives in one [`fill`](Halo::fill).
    pub fn bytes(&self) -> u64 {
        (size_of::<f64>() * self.d * self.ghosts) as u64
    }
}

/// Owner of every ghost, and the place that it has there.
fn place(
    engine: &Engine,
    ranges: &[u64],
    ghosts: &[u64],
    d: usize,
) -> Result<(Vec<i32>, Vec<i64>), String> {
    // PETSc counts points here, however many numbers each has.
    check_ranges(engine, ranges, d.min(1))?;
    let most = engine.running().most();
    if ghosts.len() as u64 > most {
        return Err(format!("{} ghost points, and this PETSc counts to {most}", ghosts.len()));
    }
    let mut owners = Vec::with_capacity(ghosts.len());
    let mut places = Vec::with_capacity(ghosts.len());
    for &ghost in ghosts {
        // The last range that begins at or before the point: empty ones begin there too.
        let owner = ranges.partition_point(|&start| start <= ghost) - 1;
        if owner >= engine.ranks() {
            return Err(format!("point {ghost} is a ghost, and there are {}", ranges[owner]));
        }
        if owner == engine.rank() {
            return Err(format!("point {ghost} is a ghost on the rank that owns it"));
        }
        owners.push(owner as i32);
        places.push((ghost - ranges[owner]) as i64);
    }
    Ok((owners, places))
}

/// Whether ranges are as many as there are ranks, ascend from 0, and end where PETSc still counts.
pub(crate) fn check_ranges(engine: &Engine, ranges: &[u64], d: usize) -> Result<(), String> {
    let ranks = engine.ranks();
    if ranges.len() != ranks + 1 || ranges[0] != 0 || !ranges.is_sorted() {
        return Err(format!("ranges of {ranks} ranks are {} numbers from 0 up", ranks + 1));
    }
    let most = engine.running().most();
    let unknowns = ranges[ranks].checked_mul(d as u64).filter(|&unknowns| unknowns <= most);
    if d == 0 || unknowns.is_none() {
        return Err(format!(
            "{} points of {d} numbers each, and this PETSc counts to {most}: it needs to be built with \
             64-bit indices",
            ranges[ranks]
        ));
    }
    Ok(())
}
