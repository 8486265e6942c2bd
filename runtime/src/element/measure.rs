//! The element that differentiates in the measure: psi', psi'' from a law, the rest by geometry.

use super::batch::{CAPACITY, Channel, Contributions, InteractionBatch, Measures, STRIDE};
use super::{Element, NonFiniteLane, Order, breaks_down, is_signed};
use crate::geometry::bond::Bond;
use crate::geometry::double::Double;
use crate::geometry::tetrahedron::Tetrahedron;
use crate::geometry::triangle::{PlaneTriangle, SpaceTriangle};
use crate::geometry::{Geometry, Lanes, Scalar, Variable, WIDTH, packed_len};
use crate::kernel::{Batch, Derivatives, Law, Measure};

/// An energy density of one measure on the geometry of that measure.
///
/// With `s` the variable of the measure, the compact gradient is `dpsi/ds ds` and the compact
/// Hessian `d2psi/ds2 ds ds + dpsi/ds d2s`.
pub struct MeasureElement {
    measure: Measure,
    dimension: usize,
    law: Box<dyn Law>,
    forbids_inversion: bool,
}

impl MeasureElement {
    /// The interactions of a measure in 2 or 3 dimensions. A signed measure stays positive if the
    /// law is not finite at 0 or at minus the reference.
    pub fn new(measure: Measure, dimension: usize, law: Box<dyn Law>) -> MeasureElement {
        let mut out = Derivatives::default();
        let psi = |stretch: f64| {
            out.resize(1);
            let (measure, change) = (&[stretch], &[stretch - 1.0]);
            law.evaluate(Batch { measure, reference: &[1.0], change }, &mut out);
            out.psi[0]
        };
        let forbids_inversion = is_signed(measure, dimension) && breaks_down(psi);
        MeasureElement { measure, dimension, law, forbids_inversion }
    }

    /// A signed measure stays positive, whatever the law says.
    pub fn forbid_inversion(&mut self) {
        self.forbids_inversion = is_signed(self.measure, self.dimension);
    }
}

impl Element for MeasureElement {
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
        let law = &*self.law;
        let least = if self.forbids_inversion { f64::MIN_POSITIVE } else { f64::NEG_INFINITY };
        match (self.measure, self.dimension) {
            (Measure::Length, 2) => evaluate::<Bond, 2>(law, least, batch, order, out),
            (Measure::Length, _) => evaluate::<Bond, 3>(law, least, batch, order, out),
            (Measure::Area, 2) => evaluate::<PlaneTriangle, 4>(law, least, batch, order, out),
            (Measure::Area, _) => evaluate::<SpaceTriangle, 6>(law, least, batch, order, out),
            (Measure::Volume, _) => evaluate::<Tetrahedron, 9>(law, least, batch, order, out),
        }
    }
}

fn evaluate<G: Geometry<C>, const C: usize>(
    law: &dyn Law,
    least: f64,
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
    let slopes = Slopes { least, energy: &mut out.energy, first: &mut first, second: &mut second };
    slopes.fill(G::VARIABLE, batch, order, measures, &out.derivatives)?;
    match order {
        Order::Energy => {}
        Order::Gradient => {
            gradient_all::<G, C>(batch, &out.measures.thin, &first, &mut out.gradient);
        }
        Order::Tangent => hessian_all::<G, C>(batch, &first, &second, out),
    }
    Ok(())
}

/// Weighted energies and their derivatives in the variable.
struct Slopes<'a> {
    /// Smaller measures are refused.
    least: f64,
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
            finite &= measures.measure[lane] >= self.least;
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
                && measures.measure[lane] >= self.least
                && (order == Order::Energy || self.first[lane].is_finite())
                && (order != Order::Tangent || self.second[lane].is_finite())
        };
        let lane = (0..batch.len()).find(|lane| !is_fine(lane)).unwrap_or(0);
        let (value, reference) = (measures.measure[lane], measures.reference[lane]);
        NonFiniteLane { lane, value, reference }
    }
}

#[inline(always)]
fn load(channel: &Channel, group: usize) -> Lanes {
    Lanes(channel.as_chunks().0[group])
}

#[inline(always)]
fn store(channel: &mut Channel, group: usize, value: Lanes) {
    channel.as_chunks_mut().0[group] = value.0;
}

/// Groups of lanes that hold a batch. The last may hold an old interaction besides, or nothing;
/// what comes of it is never read.
fn groups(batch: &InteractionBatch) -> std::ops::Range<usize> {
    0..batch.len().div_ceil(WIDTH).min(CAPACITY / WIDTH)
}

/// The channels as an array: their number is known where the geometry is.
#[inline(always)]
fn channels<const C: usize>(all: &[Channel]) -> &[Channel; C] {
    all.first_chunk().expect("the batch was made for this measure")
}

/// Below this part of what its edges could span a measure is worked out in twice the digits: above,
/// it has lost at most six bits. On lattices of up to three spacings nothing is that thin.
const THIN: f64 = 1.0 / 64.0;

fn measure_all<G: Geometry<C>, const C: usize>(batch: &InteractionBatch, out: &mut Measures) {
    let reference = channels::<C>(&batch.reference);
    let displacement = channels::<C>(&batch.displacement);
    out.thin.clear();
    for group in groups(batch) {
        let rest: [Lanes; C] = std::array::from_fn(|c| load(&reference[c], group));
        let eta: [Lanes; C] = std::array::from_fn(|c| load(&displacement[c], group));
        let change = G::change(&rest, &eta);
        store(&mut out.measure, group, change.measure);
        store(&mut out.reference, group, change.reference);
        store(&mut out.change, group, change.change);
        store(&mut out.orientation, group, change.orientation);
        let now = current::<C>(reference, displacement, group);
        let pair = [(change.reference, &rest), (change.measure, &now)];
        for (measure, vectors) in pair {
            let Some(largest) = G::largest_square(vectors) else { continue };
            for lane in 0..WIDTH {
                let place = group * WIDTH + lane;
                let thin = measure.0[lane] * measure.0[lane] < THIN * THIN * largest.0[lane];
                if thin && place < batch.len() && out.thin.last() != Some(&place) {
                    out.thin.push(place);
                }
            }
        }
    }
    for index in 0..out.thin.len() {
        let lane = out.thin[index];
        let change = G::change(&doubles(reference, lane), &doubles(displacement, lane));
        out.measure[lane] = change.measure.rounded();
        out.reference[lane] = change.reference.rounded();
        out.change[lane] = change.change.rounded();
        out.orientation[lane] = change.orientation.rounded();
    }
}

/// One lane in twice the digits.
fn doubles<const C: usize>(channels: &[Channel; C], lane: usize) -> [Double; C] {
    std::array::from_fn(|c| Double::splat(channels[c][lane]))
}

/// Current vectors of one lane in twice the digits.
fn current_doubles<const C: usize>(
    reference: &[Channel; C],
    displacement: &[Channel; C],
    lane: usize,
) -> [Double; C] {
    std::array::from_fn(|c| {
        Double::splat(reference[c][lane]) + Double::splat(displacement[c][lane])
    })
}

/// Current vectors.
#[inline(always)]
fn current<const C: usize>(
    reference: &[Channel; C],
    displacement: &[Channel; C],
    group: usize,
) -> [Lanes; C] {
    std::array::from_fn(|c| load(&reference[c], group) + load(&displacement[c], group))
}

fn gradient_all<G: Geometry<C>, const C: usize>(
    batch: &InteractionBatch,
    thin: &[usize],
    first: &Channel,
    out: &mut [Channel],
) {
    let (reference, displacement) = (channels(&batch.reference), channels(&batch.displacement));
    let out = &mut out[..C];
    for group in groups(batch) {
        let gradient = G::gradient(&current::<C>(reference, displacement, group));
        let first = load(first, group);
        for c in 0..C {
            store(&mut out[c], group, first * gradient[c]);
        }
    }
    for &lane in thin {
        let gradient = G::gradient(&current_doubles::<C>(reference, displacement, lane));
        for c in 0..C {
            out[c][lane] = (Double::splat(first[lane]) * gradient[c]).rounded();
        }
    }
}

fn hessian_all<G: Geometry<C>, const C: usize>(
    batch: &InteractionBatch,
    first: &Channel,
    second: &Channel,
    out: &mut Contributions,
) {
    let (reference, displacement) = (channels(&batch.reference), channels(&batch.displacement));
    let (to_gradient, to_hessian) = (&mut out.gradient[..C], &mut out.hessian[..packed_len(C)]);
    for group in groups(batch) {
        let x = current::<C>(reference, displacement, group);
        let gradient = G::gradient(&x);
        let (first, second) = (load(first, group), load(second, group));
        for c in 0..C {
            store(&mut to_gradient[c], group, first * gradient[c]);
        }
        G::hessian(&x, &gradient, first, second, |place, value| {
            store(&mut to_hessian[place], group, value);
        });
    }
    for index in 0..out.measures.thin.len() {
        let lane = out.measures.thin[index];
        let x = current_doubles::<C>(reference, displacement, lane);
        let gradient = G::gradient(&x);
        let (first, second) = (Double::splat(first[lane]), Double::splat(second[lane]));
        for c in 0..C {
            to_gradient[c][lane] = (first * gradient[c]).rounded();
        }
        G::hessian(&x, &gradient, first, second, |place, value| {
            to_hessian[place][lane] = value.rounded();
        });
    }
}
