//! What ranks bring each other of a body's points.

use std::cell::{Cell, RefCell};
use std::ops::Range;

use piola_petsc::{Engine, EngineError, Halo};
use piola_solvers::motion::Others;

use super::share::Share;

/// Brings numbers of the halo's points from their owners.
pub(super) struct Exchange<'e> {
    engine: &'e Engine,
    halo: Halo<'e>,
    /// Degrees of freedom of own points, of all that are held.
    own: Range<usize>,
    first: usize,
    n_held: usize,
    /// Own numbers, and behind them those of the halo.
    room: RefCell<Vec<f64>>,
    failure: Cell<Option<EngineError>>,
}

impl<'e> Exchange<'e> {
    /// Of `d` numbers a point. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn new(
        engine: &'e Engine,
        share: &Share,
        d: usize,
    ) -> Result<Exchange<'e>, EngineError> {
        let own = share.own_of_held();
        Ok(Exchange {
            engine,
            halo: Halo::new(engine, &share.ranges, &share.ghosts(), d)?,
            own: own.start * d..own.end * d,
            first: share.held.start,
            n_held: share.held.len(),
            room: RefCell::new(vec![0.0; share.held.len() * d]),
            failure: Cell::new(None),
        })
    }

    /// Gives the halo's points in `values`, of all that are held, the numbers that their owners have. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn fill(&self, values: &mut [f64]) -> Result<(), EngineError> {
        let (own, mut room) = (self.own.clone(), self.room.borrow_mut());
        room[..own.len()].copy_from_slice(&values[own.clone()]);
        self.halo.fill(&mut room)?;
        let (before, behind) = room[own.len()..].split_at(own.start);
        values[..own.start].copy_from_slice(before);
        values[own.end..].copy_from_slice(behind);
        Ok(())
    }

    /// What PETSc has reported while a body moved.
    pub(super) fn failure(&self) -> Option<EngineError> {
        self.failure.take()
    }
}

impl Others for Exchange<'_> {
    fn first(&self) -> usize {
        self.first
    }

    /// Where that fails, nothing is known of other points: the motion ends, and says why.
    fn bring(&self, values: &mut [f64]) {
        if let Err(failure) = self.fill(values) {
            values.fill(f64::NAN);
            self.failure.set(Some(failure));
        }
    }

    fn are_there(&self) -> bool {
        self.engine.ranks() > 1
    }

    fn share(&self, pairs: &mut Vec<[usize; 2]>) {
        let mut some = [f64::from(u8::from(!pairs.is_empty()))];
        self.engine.max(&mut some);
        if some == [0.0] {
            return;
        }
        let number = |point: &usize| ((self.first + point) as u64).to_le_bytes();
        let own: Vec<u8> = pairs.iter().flatten().flat_map(number).collect();
        let mut all = self.engine.gather(&own).unwrap_or_default().concat();
        self.engine.broadcast(&mut all);
        let held = self.first..self.first + self.n_held;
        let point = |bytes: &[u8; 8]| {
            let number = u64::from_le_bytes(*bytes) as usize;
            held.contains(&number).then(|| number - held.start)
        };
        let numbers = all.as_chunks::<8>().0.as_chunks::<2>().0.iter();
        *pairs = numbers.filter_map(|[one, other]| Some([point(one)?, point(other)?])).collect();
        pairs.sort_unstable();
        pairs.dedup();
    }

    fn sum(&self, numbers: &mut [f64]) {
        self.engine.sum(numbers);
    }

    fn max(&self, numbers: &mut [f64]) {
        self.engine.max(numbers);
    }
}
