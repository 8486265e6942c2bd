//! Bodies that many processes share: each moves a part, and hears of the others.
//!
//! Displacements of points that others move come once a step, and velocities where bonds dissipate; at its end all
//! hear whether one has failed, stops, wants an end or a pause, and how fast the fastest point is. Sums of the account are of
//! own points, and are added up where a row is due. What breaks is not told: whoever holds an interaction judges it
//! by the same numbers, and finds the same. Families are whole where their owner is, who tells what they break.

use piola_mechanics::fracture::Fracture;

use super::{Motion, MotionError};
use crate::watch::Event;

/// The other parts of a body. Its functions are collective: all parts call the same ones in the same order.
pub trait Others {
    /// The number of the first point that this part holds, among all of the body.
    fn first(&self) -> usize;

    /// Gives the points that do not count here the numbers that they have where they do; `values` are `n x d`.
    fn bring(&self, values: &mut [f64]);

    /// Whether there are other parts at all.
    fn are_there(&self) -> bool;

    /// Replaces pairs of points that this part holds by those of all parts that it holds, ascending.
    fn share(&self, pairs: &mut Vec<[usize; 2]>);

    /// Replaces every number by its sum over the parts, with the same bits in all of them.
    fn sum(&self, numbers: &mut [f64]);

    /// Replaces every number by its greatest over the parts; not a number where one part has that.
    fn max(&self, numbers: &mut [f64]);
}

/// Of a body that is whole: there is no other part.
#[derive(Clone, Copy, Debug)]
pub struct Nobody;

impl Others for Nobody {
    fn first(&self) -> usize {
        0
    }

    fn bring(&self, _: &mut [f64]) {}

    fn are_there(&self) -> bool {
        false
    }

    fn share(&self, _: &mut Vec<[usize; 2]>) {}

    fn sum(&self, _: &mut [f64]) {}

    fn max(&self, _: &mut [f64]) {}
}

/// What this part has, where all others have theirs, too.
pub(super) fn agreed<T>(
    others: &dyn Others,
    own: Result<T, MotionError>,
) -> Result<T, MotionError> {
    let mut fails = [flag(own.is_err())];
    others.max(&mut fails);
    own.and_then(|own| if fails == [0.0] { Ok(own) } else { Err(MotionError::Elsewhere) })
}

/// As a number that is added up and compared.
pub(super) fn flag(is_so: bool) -> f64 {
    f64::from(u8::from(is_so))
}

impl<O: Others> Motion<'_, O> {
    /// Learns of the whole body: how large it is, how much of it is free, and where its other points are.
    pub(super) fn join(&mut self) {
        let d = self.energy.dimension();
        let along = |axis: usize| self.energy.positions().iter().skip(axis).step_by(d).copied();
        let ends = |axis: usize| {
            [
                along(axis).fold(f64::NEG_INFINITY, f64::max),
                -along(axis).fold(f64::INFINITY, f64::min),
            ]
        };
        let mut ends: Vec<f64> = (0..d).flat_map(ends).collect();
        self.others.max(&mut ends);
        let sides = ends.chunks(2).map(|ends| ends[0] + ends[1]);
        self.extent = sides.fold(0.0, |sum, side| sum + side * side).sqrt();
        let mut free = [self.constraints.n_free() as f64];
        self.others.sum(&mut free);
        self.n_free = free[0] as usize;
        self.others.bring(&mut self.u.value);
    }

    /// Learns which bonds break here by conditions of families: of each its owner judges, who alone has it whole.
    /// Collective; a part that is not `ready` for that judges nothing.
    pub(super) fn judge_families(&self, ready: bool) -> Result<(), MotionError> {
        let asked =
            |fracture: &&dyn Fracture| self.others.are_there() && fracture.has_family_conditions();
        let Some(fracture) = self.energy.fracture().filter(asked) else { return Ok(()) };
        let judged =
            if ready { fracture.judged_by_families(&self.u.value) } else { Ok(Vec::new()) };
        let (mut bonds, own) = match judged {
            Ok(bonds) => (bonds, Ok(())),
            Err(cause) => (Vec::new(), Err(self.not_finite(cause))),
        };
        self.others.share(&mut bonds);
        fracture.decide_for_families(&bonds);
        own
    }

    /// At the end of a step: whether all parts have made it, and no point has flown off.
    ///
    /// # Errors
    /// What this part or another has found.
    pub(super) fn meet<T>(&mut self, went: Result<T, MotionError>) -> Result<T, MotionError> {
        if went.is_ok() && self.done > 0 {
            let (t, n_steps) = (self.time(self.done), self.n_steps);
            self.watch.notice(Event::Moved { t, step: self.done, n_steps });
        }
        let wants_end = flag(self.watch.wants_end());
        let has_changed = flag(self.left_behind != [0.0; 2]);
        let wants_pause = flag(self.wants_pause());
        let mut news = [flag(went.is_err()), wants_end, wants_pause, has_changed, self.fastest];
        self.others.max(&mut news);
        let [fails, wants_end, wants_pause, has_changed, fastest] = news;
        if has_changed > 0.0 {
            let mut left_behind = std::mem::take(&mut self.left_behind);
            self.others.sum(&mut left_behind);
            self.tell_of_gains(left_behind);
        }
        let went = went?;
        if fails > 0.0 {
            return Err(MotionError::Elsewhere);
        }
        self.wants_end = wants_end > 0.0;
        self.is_pause_due |= wants_pause > 0.0;
        if !(fastest.is_finite() && (self.dt * fastest <= self.extent || self.stays_together())) {
            return Err(self.flown_off());
        }
        Ok(went)
    }

    /// Stops where another part stops, because families there have become too small.
    pub(super) fn hear_of_stops(&mut self) {
        if !self.families.end_motions() || self.energy.fracture().is_none() {
            return;
        }
        let mut stops = [flag(self.stopped.is_some())];
        self.others.max(&mut stops);
        if stops[0] > 0.0 && self.stopped.is_none() {
            self.stopped = Some(MotionError::Elsewhere);
        }
    }
}
