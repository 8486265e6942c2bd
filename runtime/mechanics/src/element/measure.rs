//! The element that differentiates in the measure: psi', psi'' from a law, the rest by geometry.

use std::marker::PhantomData;

use pulp::{Arch, Simd, WithSimd};

use super::batch::{Channel, Contributions, InteractionBatch, Measures};
use super::{Element, NonFiniteLane, Order, breaks_down};
use crate::geometry::bond::Bond;
use crate::geometry::double::Double;
use crate::geometry::lanes::Lanes;
use crate::geometry::squares::{Root, Squared};
use crate::geometry::tetrahedron::Tetrahedron;
use crate::geometry::triangle::{PlaneTriangle, SpaceTriangle};
use crate::geometry::{Geometry, Scalar, Variable, each, packed_len};
use crate::kernel::{Batch, Law, Measure, Outputs};

/// An energy density of one measure on the geometry of that measure.
///
/// With `s` the variable of the measure, the compact gradient is `dpsi/ds ds` and the compact
/// Hessian `d2psi/ds2 ds ds + dpsi/ds d2s`.
pub struct MeasureElement {
    measure: Measure,
    dimension: usize,
    law: Box<dyn Law>,
    forbids_inversion: bool,
    /// The widest registers of this machine.
    arch: Arch,
}

impl MeasureElement {
    /// The interactions of a measure in 2 or 3 dimensions. A signed measure stays positive if the
    /// law is not finite at 0 or at minus the reference.
    pub fn new(measure: Measure, dimension: usize, law: Box<dyn Law>) -> MeasureElement {
        let psi = |stretch: f64| {
            let (measure, change, mut psi) = (&[stretch], &[stretch - 1.0], [0.0]);
            let batch = Batch { measure, reference: &[1.0], change, fields: law.fields() };
            let out = Outputs { psi: &mut psi, dpsi: &mut [], d2psi: &mut [] };
            law.evaluate(batch, Order::Energy, out);
            psi[0]
        };
        let forbids_inversion = measure.is_signed(dimension) && breaks_down(psi);
        MeasureElement { measure, dimension, law, forbids_inversion, arch: Arch::new() }
    }

    /// A signed measure stays positive, whatever the law says.
    pub fn forbid_inversion(&mut self) {
        self.forbids_inversion = self.measure.is_signed(self.dimension);
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

    fn law(&self) -> Option<(&dyn Law, Arch)> {
        Some((&*self.law, self.arch))
    }

    fn n_fields(&self) -> usize {
        self.law.fields().len()
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        match (self.measure, self.dimension) {
            (Measure::Length, 2) => self.evaluate_root::<Bond, 2>(batch, order, out),
            (Measure::Length, _) => self.evaluate_root::<Bond, 3>(batch, order, out),
            (Measure::Area, 2) => {
                self.evaluate_as::<PlaneTriangle, 4>(&*self.law, batch, order, out)
            }
            (Measure::Area, _) => self.evaluate_root::<SpaceTriangle, 6>(batch, order, out),
            (Measure::Volume, _) => {
                self.evaluate_as::<Tetrahedron, 9>(&*self.law, batch, order, out)
            }
        }
    }
}

impl MeasureElement {
    /// A measure that is a root: by its square where the law is a function of it.
    fn evaluate_root<G: Root<C>, const C: usize>(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        match self.law.squared() {
            Some(law) => self.evaluate_as::<Squared<G>, C>(law, batch, order, out),
            None => self.evaluate_as::<G, C>(&*self.law, batch, order, out),
        }
    }

    fn evaluate_as<G: Geometry<C>, const C: usize>(
        &self,
        law: &dyn Law,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        self.arch.dispatch(Measuring::<G, C> { batch, out: &mut out.measures, shape: PhantomData });
        measure_thin::<G, C>(batch, &mut out.measures);
        let n = batch.padded_len();
        let measures = &out.measures;
        let inputs = Batch {
            measure: &measures.measure[..n],
            reference: &measures.reference[..n],
            change: &measures.change[..n],
            fields: if self.n_fields() == 0 { &[] } else { &batch.fields },
        };
        law.evaluate(inputs, order, out.derivatives.outputs());
        let least = self.least();
        let differentiating =
            Differentiating::<G, C> { batch, order, least, out, shape: PhantomData };
        if !self.arch.dispatch(differentiating) {
            return Err(first_refused(batch, order, least, out, G::VARIABLE));
        }
        differentiate_thin::<G, C>(batch, order, out);
        Ok(())
    }
}

/// Below this part of what its edges could span a measure is worked out in twice the digits: above,
/// it has lost at most six bits. On lattices of up to three spacings nothing is that thin.
pub(crate) const THIN: f64 = 1.0 / 64.0;

/// The measures of a batch; lists the thin ones, which have lost digits.
struct Measuring<'a, G, const C: usize> {
    batch: &'a InteractionBatch,
    out: &'a mut Measures,
    shape: PhantomData<G>,
}

impl<G: Geometry<C>, const C: usize> WithSimd for Measuring<'_, G, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (batch, out) = (self.batch, self.out);
        let (reference, displacement) = vectors::<C>(batch);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let thin_part = Lanes::splat(simd, THIN * THIN);
        out.thin.clear();
        for group in groups(simd, batch) {
            let rest: [Lanes<S>; C] = each(|c| Lanes::load(simd, &reference[c], group));
            let eta: [Lanes<S>; C] = each(|c| Lanes::load(simd, &displacement[c], group));
            let change = G::change(&rest, &eta);
            change.measure.store(&mut out.measure, group);
            change.reference.store(&mut out.reference, group);
            change.change.store(&mut out.change, group);
            change.slope.store(&mut out.slope, group);
            let now: [Lanes<S>; C] = each(|c| rest[c] + eta[c]);
            let (Some(largest_at_rest), Some(largest)) =
                (G::largest_square(&rest), G::largest_square(&now))
            else {
                continue;
            };
            let square_at_rest = G::VARIABLE.square(change.reference, change.reference);
            let square = G::VARIABLE.square(change.measure, change.reference);
            let thin = square_at_rest.where_less(thin_part * largest_at_rest, one, zero);
            let thin = square.where_less(thin_part * largest, one, thin);
            if thin.largest() > 0.0 {
                let mut marks = [0.0; super::batch::WIDEST];
                thin.store(&mut marks, 0);
                let lanes = (0..Lanes::<S>::WIDTH).filter(|&lane| marks[lane] > 0.0);
                let places = lanes.map(|lane| group * Lanes::<S>::WIDTH + lane);
                out.thin.extend(places.filter(|&place| place < batch.len()));
            }
        }
    }
}

/// Weighted energies and their derivatives from the derivatives in the measure. Returns whether all
/// that was asked for is finite and no measure is below `least`.
struct Differentiating<'a, G, const C: usize> {
    batch: &'a InteractionBatch,
    order: Order,
    /// Smaller measures are refused.
    least: f64,
    out: &'a mut Contributions,
    shape: PhantomData<G>,
}

impl<G: Geometry<C>, const C: usize> WithSimd for Differentiating<'_, G, C> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Differentiating { batch, order, least, out, .. } = self;
        let (reference, displacement) = vectors::<C>(batch);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let (least, nothing) = (Lanes::splat(simd, least), Lanes::splat(simd, f64::NAN));
        let (measures, derivatives) = (&out.measures, &out.derivatives);
        let (to_gradient, to_hessian) = (&mut out.gradient[..C], &mut out.hessian[..packed_len(C)]);
        // 0 as long as all is well.
        let mut refused = zero;
        for group in groups(simd, batch) {
            let load = |channel: &[f64]| Lanes::load(simd, channel, group);
            let weight = load(&batch.weight);
            let measure = load(&measures.measure);
            refused = refused + load(&measures.change).zero_or_nan();
            if order.has_energy() {
                let energy = weight * load(&derivatives.psi);
                energy.store(&mut out.energy, group);
                refused = refused + energy.zero_or_nan();
            }
            refused = measure.where_less(least, nothing, refused);
            if order == Order::Energy {
                continue;
            }
            // Without a Hessian psi'' has no say, not even at a kink of the measure.
            let curvature = if order == Order::Tangent { load(&derivatives.d2psi) } else { zero };
            let (slope, first) = (load(&measures.slope), load(&derivatives.dpsi));
            let (first, second) = G::VARIABLE.slopes(measure, slope, first, curvature);
            let first = weight * first;
            first.store(&mut out.first, group);
            refused = refused + first.zero_or_nan();
            let x: [Lanes<S>; C] = each(|c| load(&reference[c]) + load(&displacement[c]));
            let gradient = G::gradient(&x);
            for c in 0..C {
                (first * gradient[c]).store(&mut to_gradient[c], group);
            }
            if order == Order::Tangent {
                let second = weight * second;
                second.store(&mut out.second, group);
                refused = refused + second.zero_or_nan();
                G::hessian(&x, &gradient, first, second, |place, value| {
                    value.store(&mut to_hessian[place], group);
                });
            }
        }
        refused.where_equal(zero, zero, one).largest() == 0.0
    }
}

/// The lane that made a batch refused.
fn first_refused(
    batch: &InteractionBatch,
    order: Order,
    least: f64,
    out: &Contributions,
    variable: Variable,
) -> NonFiniteLane {
    let measures = &out.measures;
    let is_fine = |&lane: &usize| {
        (!order.has_energy() || out.energy[lane].is_finite())
            && measures.change[lane].is_finite()
            && measures.measure[lane] >= least
            && (order == Order::Energy || out.first[lane].is_finite())
            && (order != Order::Tangent || out.second[lane].is_finite())
    };
    let lane = (0..batch.len()).find(|lane| !is_fine(lane)).unwrap_or(0);
    let reference = measures.reference[lane];
    let value = variable.value(measures.measure[lane], reference);
    NonFiniteLane { lane, value, reference }
}

/// Groups of lanes that hold a batch, its padding included.
#[inline(always)]
fn groups<S: Simd>(_: S, batch: &InteractionBatch) -> std::ops::Range<usize> {
    0..batch.padded_len() / Lanes::<S>::WIDTH
}

/// Reference vectors and displacements as arrays: their number is known where the geometry is.
#[inline(always)]
fn vectors<const C: usize>(batch: &InteractionBatch) -> (&[Channel; C], &[Channel; C]) {
    let found = batch.reference.first_chunk().zip(batch.displacement.first_chunk());
    found.expect("the batch was made for this measure")
}

/// The thin interactions of a batch in twice the digits.
fn measure_thin<G: Geometry<C>, const C: usize>(batch: &InteractionBatch, out: &mut Measures) {
    let (reference, displacement) = vectors::<C>(batch);
    for &lane in &out.thin {
        let change = G::change(&doubles::<C>(reference, lane), &doubles(displacement, lane));
        out.measure[lane] = change.measure.rounded();
        out.reference[lane] = change.reference.rounded();
        out.change[lane] = change.change.rounded();
        out.slope[lane] = change.slope.rounded();
    }
}

/// The derivatives of the thin interactions of a batch in twice the digits.
fn differentiate_thin<G: Geometry<C>, const C: usize>(
    batch: &InteractionBatch,
    order: Order,
    out: &mut Contributions,
) {
    if order == Order::Energy {
        return;
    }
    let (reference, displacement) = vectors::<C>(batch);
    for &lane in &out.measures.thin {
        let (rest, eta) = (doubles::<C>(reference, lane), doubles::<C>(displacement, lane));
        let x: [Double; C] = each(|c| rest[c] + eta[c]);
        let gradient = G::gradient(&x);
        let (first, second) = (Double::new(out.first[lane]), Double::new(out.second[lane]));
        for c in 0..C {
            out.gradient[c][lane] = (first * gradient[c]).rounded();
        }
        if order == Order::Tangent {
            G::hessian(&x, &gradient, first, second, |place, value| {
                out.hessian[place][lane] = value.rounded();
            });
        }
    }
}

/// One lane in twice the digits.
fn doubles<const C: usize>(channels: &[Channel; C], lane: usize) -> [Double; C] {
    each(|c| Double::new(channels[c][lane]))
}
