//! The element that differentiates in the coordinates: the way of firooz2023.
//!
//! The energy is a program on hyper-dual numbers; one run per pair of corner coordinates gives one
//! entry of the Hessian exactly. It knows no geometry but the textbook formula of the measure, and
//! it is slow: 10 to 78 runs per interaction. It checks [`super::MeasureElement`] and shows what the
//! papers' way costs.

use num_dual::{DualNum, HyperDual64};

use super::batch::{Contributions, InteractionBatch};
use super::{Element, NonFiniteLane, Order, breaks_down};
use crate::geometry::packed;
use crate::interaction::n_neighbors;
use crate::kernel::Measure;

/// An energy density that can be run on hyper-dual numbers.
pub trait CoordinateEnergy: Send + Sync {
    /// psi of the current measure and its reference value.
    fn psi(&self, measure: HyperDual64, reference: f64) -> HyperDual64;
}

impl<F> CoordinateEnergy for F
where
    F: Fn(HyperDual64, f64) -> HyperDual64 + Send + Sync,
{
    fn psi(&self, measure: HyperDual64, reference: f64) -> HyperDual64 {
        self(measure, reference)
    }
}

/// An energy density whose derivatives come from hyper-dual coordinates.
#[derive(Debug)]
pub struct CoordinateElement<E> {
    measure: Measure,
    dimension: usize,
    energy: E,
    forbids_inversion: bool,
}

/// Up to four corners of up to three coordinates each.
type Corners<T> = [[T; 3]; 4];

impl<E: CoordinateEnergy> CoordinateElement<E> {
    /// The interactions of a measure in 2 or 3 dimensions. A signed measure stays positive if the
    /// energy is not finite at 0 or at minus the reference.
    pub fn new(measure: Measure, dimension: usize, energy: E) -> CoordinateElement<E> {
        let psi = |stretch: f64| energy.psi(HyperDual64::from_re(stretch), 1.0).re;
        let forbids_inversion = measure.is_signed(dimension) && breaks_down(psi);
        CoordinateElement { measure, dimension, energy, forbids_inversion }
    }

    /// A signed measure stays positive, whatever the energy says.
    pub fn forbid_inversion(&mut self) {
        self.forbids_inversion = self.measure.is_signed(self.dimension);
    }

    /// Positions of the corners, counted from the owner's reference position.
    fn corners(
        &self,
        batch: &InteractionBatch,
        lane: usize,
        with_displacement: bool,
    ) -> Corners<f64> {
        let mut corners = [[0.0; 3]; 4];
        for other in 0..n_neighbors(self.measure) {
            for axis in 0..self.dimension {
                let channel = other * self.dimension + axis;
                corners[other + 1][axis] = batch.reference[channel][lane];
                if with_displacement {
                    corners[other + 1][axis] += batch.displacement[channel][lane];
                }
            }
        }
        corners
    }

    /// Energy with its derivatives in the coordinates number `first` and `second`.
    fn run(
        &self,
        corners: &Corners<f64>,
        rest: (f64, f64),
        first: usize,
        second: usize,
    ) -> HyperDual64 {
        let (reference, orientation) = rest;
        let mut x = corners.map(|corner| corner.map(HyperDual64::from_re));
        let place = |index: usize| (index / self.dimension, index % self.dimension);
        let ((corner, axis), (other, direction)) = (place(first), place(second));
        x[corner][axis].eps1 = 1.0;
        x[other][direction].eps2 = 1.0;
        let measure = textbook_measure(self.measure, self.dimension, &x) * orientation;
        self.energy.psi(measure, reference)
    }

    fn evaluate_lane(
        &self,
        batch: &InteractionBatch,
        lane: usize,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        let at_rest = self.corners(batch, lane, false).map(|c| c.map(HyperDual64::from_re));
        let signed = textbook_measure(self.measure, self.dimension, &at_rest).re;
        let rest = (signed.abs(), 1f64.copysign(signed));
        let corners = self.corners(batch, lane, true);
        let n = (n_neighbors(self.measure) + 1) * self.dimension;
        let mut finite = true;
        for row in 0..n {
            let columns = match order {
                Order::Energy if row > 0 => continue,
                Order::Energy | Order::Force | Order::Gradient => row..=row,
                Order::Tangent => 0..=row,
            };
            for column in columns {
                let result = self.run(&corners, rest, row, column);
                finite &= self.keep((row, column), result * batch.weight[lane], lane, order, out);
            }
        }
        let now = corners.map(|corner| corner.map(HyperDual64::from_re));
        let value = textbook_measure(self.measure, self.dimension, &now).re * rest.1;
        if finite && !(self.forbids_inversion && value <= 0.0) {
            return Ok(());
        }
        Err(NonFiniteLane { lane, value, reference: rest.0 })
    }

    /// Stores what one run was made for; whether that is finite. The owner's rows are left out:
    /// they follow from the others, as in every element.
    fn keep(
        &self,
        (row, column): (usize, usize),
        result: HyperDual64,
        lane: usize,
        order: Order,
        out: &mut Contributions,
    ) -> bool {
        let (d, size) = (self.dimension, n_neighbors(self.measure) * self.dimension);
        out.energy[lane] = result.re;
        let mut finite = result.re.is_finite();
        if order >= Order::Force && row == column {
            finite &= result.eps1.is_finite();
            if row >= d {
                out.gradient[row - d][lane] = result.eps1;
            }
        }
        if order == Order::Tangent {
            finite &= result.eps1eps2.is_finite();
            if column >= d {
                out.hessian[packed(size, column - d, row - d)][lane] = result.eps1eps2;
            }
        }
        finite
    }
}

impl<E: CoordinateEnergy> Element for CoordinateElement<E> {
    fn measure(&self) -> Measure {
        self.measure
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn forbids_inversion(&self) -> bool {
        self.forbids_inversion
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        (0..batch.len()).try_for_each(|lane| self.evaluate_lane(batch, lane, order, out))
    }
}

/// `|xi|`, `|xi1 x xi2|` (signed in the plane) or `xi1.(xi2 x xi3)` from the positions of the
/// corners (javili2020, Eq. (20)).
fn textbook_measure(measure: Measure, dimension: usize, x: &Corners<HyperDual64>) -> HyperDual64 {
    let edge = |corner: usize| -> [HyperDual64; 3] {
        std::array::from_fn(|axis| x[corner][axis] - x[0][axis])
    };
    let cross = |p: [HyperDual64; 3], q: [HyperDual64; 3]| {
        [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
    };
    let dot = |p: [HyperDual64; 3], q: [HyperDual64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    match measure {
        Measure::Length => dot(edge(1), edge(1)).sqrt(),
        Measure::Area => {
            let normal = cross(edge(1), edge(2));
            if dimension == 2 { normal[2] } else { dot(normal, normal).sqrt() }
        }
        Measure::Volume => dot(edge(1), cross(edge(2), edge(3))),
    }
}
