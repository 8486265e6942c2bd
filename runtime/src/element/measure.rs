//! The element that differentiates in the measure: psi', psi'' from a law, the rest by geometry.

use super::batch::{Channel, Contributions, InteractionBatch, Measures, STRIDE};
use super::{Element, NonFiniteLane, Order};
use crate::geometry::bond::Bond;
use crate::geometry::tetrahedron::Tetrahedron;
use crate::geometry::triangle::{PlaneTriangle, SpaceTriangle};
use crate::geometry::{Geometry, Lanes, Variable, WIDTH};
use crate::kernel::{Batch, Derivatives, Law, Measure};

/// An energy density of one measure on the geometry of that measure.
///
/// With `s` the variable of the measure, the compact gradient is `dpsi/ds ds` and the compact
/// Hessian `d2psi/ds2 ds ds + dpsi/ds d2s`.
pub struct MeasureElement {
    measure: Measure,
    dimension: usize,
    law: Box<dyn Law>,
}

impl MeasureElement {
    /// The interactions of a measure in 2 or 3 dimensions.
    pub fn new(measure: Measure, dimension: usize, law: Box<dyn Law>) -> MeasureElement {
        MeasureElement { measure, dimension, law }
    }
}

impl Element for MeasureElement {
    fn measure(&self) -> Measure {
        self.measure
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        let law = &*self.law;
        match (self.measure, self.dimension) {
            (Measure::Length, 2) => evaluate::<Bond, 2>(law, batch, order, out),
            (Measure::Length, _) => evaluate::<Bond, 3>(law, batch, order, out),
            (Measure::Area, 2) => evaluate::<PlaneTriangle, 4>(law, batch, order, out),
            (Measure::Area, _) => evaluate::<SpaceTriangle, 6>(law, batch, order, out),
            (Measure::Volume, _) => evaluate::<Tetrahedron, 9>(law, batch, order, out),
        }
    }
}

fn evaluate<G: Geometry<C>, const C: usize>(
    law: &dyn Law,
    batch: &InteractionBatch,
    order: Order,
    out: &mut Contributions,
) -> Result<(), NonFiniteLane> {
    let n = batch.len();
    measure_all::<G, C>(batch, &mut out.measures);
    let measures = &mut out.measures;
    out.derivatives.resize(n);
    let inputs = Batch {
        measure: &measures.measure[..n],
        reference: &measures.reference[..n],
        change: &measures.change[..n],
    };
    law.evaluate(inputs, &mut out.derivatives);
    let (mut first, mut second) = ([0.0; STRIDE], [0.0; STRIDE]);
    let slopes = Slopes { energy: &mut out.energy, first: &mut first, second: &mut second };
    slopes.fill(G::VARIABLE, batch, order, measures, &out.derivatives)?;
    match order {
        Order::Energy => {}
        Order::Gradient => gradient_all::<G, C>(batch, &first, &mut out.gradient),
        Order::Tangent => hessian_all::<G, C>(batch, &first, &second, out),
    }
    Ok(())
}

/// Weighted energies and their derivatives in the variable.
struct Slopes<'a> {
    energy: &'a mut Channel,
    first: &'a mut Channel,
    second: &'a mut Channel,
}

impl Slopes<'_> {
    fn fill(
        self,
        variable: Variable,
        batch: &InteractionBatch,
        order: Order,
        measures: &Measures,
        derivatives: &Derivatives,
    ) -> Result<(), NonFiniteLane> {
        let mut finite = true;
        for lane in 0..batch.len() {
            let weight = batch.weight[lane];
            self.energy[lane] = weight * derivatives.psi[lane];
            finite &= self.energy[lane].is_finite() & measures.change[lane].is_finite();
            if order == Order::Energy {
                continue;
            }
            // Without a Hessian psi'' has no say, not even at a kink of the measure.
            let curvature = if order == Order::Tangent { derivatives.d2psi[lane] } else { 0.0 };
            let (first, second) =
                variable.slopes(measures.measure[lane], derivatives.dpsi[lane], curvature);
            self.first[lane] = weight * first * measures.orientation[lane];
            finite &= self.first[lane].is_finite();
            if order == Order::Tangent {
                self.second[lane] = weight * second;
                finite &= self.second[lane].is_finite();
            }
        }
        if finite { Ok(()) } else { Err(self.first_refused(batch, order, measures)) }
    }

    fn first_refused(
        &self,
        batch: &InteractionBatch,
        order: Order,
        measures: &Measures,
    ) -> NonFiniteLane {
        let is_fine = |&lane: &usize| {
            self.energy[lane].is_finite()
                && measures.change[lane].is_finite()
                && (order == Order::Energy || self.first[lane].is_finite())
                && (order != Order::Tangent || self.second[lane].is_finite())
        };
        let lane = (0..batch.len()).find(|lane| !is_fine(lane)).unwrap_or(0);
        let (value, reference) = (measures.measure[lane], measures.reference[lane]);
        NonFiniteLane { lane, value, reference }
    }
}

#[inline(always)]
fn load(channel: &Channel, lane: usize) -> Lanes {
    Lanes(std::array::from_fn(|k| channel[lane + k]))
}

#[inline(always)]
fn store(channel: &mut Channel, lane: usize, value: Lanes) {
    channel[lane..lane + WIDTH].copy_from_slice(&value.0);
}

/// The channels as an array: their number is known where the geometry is.
#[inline(always)]
fn channels<const C: usize>(all: &[Channel]) -> &[Channel; C] {
    all.first_chunk().expect("the batch was made for this measure")
}

/// Lanes beyond the batch's length hold old interactions; what comes of them is never read.
fn measure_all<G: Geometry<C>, const C: usize>(batch: &InteractionBatch, out: &mut Measures) {
    let reference = channels::<C>(&batch.reference);
    let displacement = channels::<C>(&batch.displacement);
    for lane in (0..batch.len()).step_by(WIDTH) {
        let rest: [Lanes; C] = std::array::from_fn(|c| load(&reference[c], lane));
        let eta: [Lanes; C] = std::array::from_fn(|c| load(&displacement[c], lane));
        let change = G::change(&rest, &eta);
        store(&mut out.measure, lane, change.measure);
        store(&mut out.reference, lane, change.reference);
        store(&mut out.change, lane, change.change);
        store(&mut out.orientation, lane, change.orientation);
    }
}

#[inline(always)]
fn current<const C: usize>(batch: &InteractionBatch, lane: usize) -> [Lanes; C] {
    let reference = channels::<C>(&batch.reference);
    let displacement = channels::<C>(&batch.displacement);
    std::array::from_fn(|c| load(&reference[c], lane) + load(&displacement[c], lane))
}

fn gradient_all<G: Geometry<C>, const C: usize>(
    batch: &InteractionBatch,
    first: &Channel,
    out: &mut [Channel],
) {
    for lane in (0..batch.len()).step_by(WIDTH) {
        let gradient = G::gradient(&current::<C>(batch, lane));
        let first = load(first, lane);
        for c in 0..C {
            store(&mut out[c], lane, first * gradient[c]);
        }
    }
}

fn hessian_all<G: Geometry<C>, const C: usize>(
    batch: &InteractionBatch,
    first: &Channel,
    second: &Channel,
    out: &mut Contributions,
) {
    let (to_gradient, to_hessian) = (&mut out.gradient[..], &mut out.hessian[..]);
    for lane in (0..batch.len()).step_by(WIDTH) {
        let x = current::<C>(batch, lane);
        let gradient = G::gradient(&x);
        let (first, second) = (load(first, lane), load(second, lane));
        for c in 0..C {
            store(&mut to_gradient[c], lane, first * gradient[c]);
        }
        G::hessian(&x, &gradient, first, second, |place, value| {
            store(&mut to_hessian[place], lane, value);
        });
    }
}
