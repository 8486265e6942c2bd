//! Points that fly off: that go further in one step than the body is large.

use piola_mechanics::vector::norm_of;

use super::others::flag;
use super::{FlownOff, Motion, MotionError, Others, ROUNDED};

impl<O: Others> Motion<'_, O> {
    /// The velocity of the centre of mass in m/s. Collective, as all here.
    fn drift_velocity(&self) -> Vec<f64> {
        let d = self.energy.dimension();
        let mut sums = vec![0.0; d + 1];
        for (dof, v) in self.v.value.iter().enumerate() {
            sums[dof % d] += self.mass(dof) * v;
        }
        sums[d] = self.masses[self.energy.counted()].iter().fold(0.0, |sum, mass| sum + mass);
        self.others.sum(&mut sums);
        sums[..d].iter().map(|momentum| momentum / sums[d]).collect()
    }

    /// The degrees of freedom of points that count.
    fn counted_dofs(&self) -> std::ops::Range<usize> {
        let (d, counted) = (self.energy.dimension(), self.energy.counted());
        counted.start * d..counted.end * d
    }

    /// Whether the body as a whole is so fast, and no point goes further than it is large as seen from its
    /// centre of mass.
    pub(super) fn stays_together(&self) -> bool {
        let (d, drift) = (self.energy.dimension(), self.drift_velocity());
        let stays = |dof: usize| {
            let drift = drift[dof % d];
            let way = self.dt * (self.v.value[dof] - drift).abs();
            way <= self.extent + ROUNDED * self.dt * drift.abs()
        };
        let mut leaves = [flag(!self.counted_dofs().all(stays))];
        self.others.max(&mut leaves);
        leaves == [0.0]
    }

    /// What is to be said of the point that goes furthest; [`MotionError::Elsewhere`] where that is another's.
    pub(super) fn flown_off(&self) -> MotionError {
        let (d, t) = (self.energy.dimension(), self.time(self.done));
        let (drift, critical) = (self.drift_velocity(), self.unstable_by_now());
        // Where nothing is a number, the first point stands for all.
        let drift = |dof: usize| if drift[dof % d].is_finite() { drift[dof % d] } else { 0.0 };
        let way = |dof: usize| self.dt * (self.v.value[dof] - drift(dof));
        let far = |dof: &usize| if way(*dof).is_nan() { f64::INFINITY } else { way(*dof).abs() };
        let farther = |one: &usize, other: &usize| far(one).total_cmp(&far(other));
        // Of those that are equally far, the first.
        let dof = self.counted_dofs().rev().max_by(farther).unwrap_or(0);
        let mut furthest = [far(&dof)];
        self.others.max(&mut furthest);
        if far(&dof) < furthest[0] {
            return MotionError::Elsewhere;
        }
        if let Err(problem) = self.check_loads(t) {
            return problem;
        }
        MotionError::FlownOff(Box::new(FlownOff {
            t,
            step: self.done,
            point: dof / d,
            way: norm_of(&(dof / d * d..dof / d * d + d).map(way).collect::<Vec<f64>>()),
            extent: self.extent,
            dt: self.dt,
            critical,
        }))
    }
}
