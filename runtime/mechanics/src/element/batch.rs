//! Interactions side by side, one array per number: the form in which elements take and give them.

use std::ops::Range;

use crate::geometry::packed_len;
use crate::interaction::n_neighbors;
use crate::kernel::{Measure, Order, Outputs};
use crate::materials::Fields;

/// How many interactions fit into a batch: their numbers stay in the first-level cache. A multiple of
/// `WIDEST`.
pub const CAPACITY: usize = 32;

/// As many interactions as the widest registers hold.
pub(crate) const WIDEST: usize = 8;

/// One number of every interaction of a batch.
pub type Channel = [f64; CAPACITY];

/// A batch of interactions of one kind.
#[derive(Clone, Debug)]
pub struct InteractionBatch {
    len: usize,
    /// Reference vectors from the owner to the other corners, in m: channel `corner*d + axis`.
    pub reference: Vec<Channel>,
    /// Relative displacements of the other corners, in m: channel `corner*d + axis`.
    pub displacement: Vec<Channel>,
    /// Weights in m^(d*(corners)).
    pub weight: Channel,
    /// Parameters that vary, in SI units: field by field, [`Self::padded_len`] numbers each. Nothing where
    /// the element takes none.
    pub fields: Vec<f64>,
}

impl InteractionBatch {
    /// An empty batch for interactions of this measure.
    pub fn new(measure: Measure, dimension: usize) -> InteractionBatch {
        let channels = n_neighbors(measure) * dimension;
        InteractionBatch {
            len: 0,
            reference: vec![[0.0; CAPACITY]; channels],
            displacement: vec![[0.0; CAPACITY]; channels],
            weight: [0.0; CAPACITY],
            fields: Vec::new(),
        }
    }

    /// Takes some fields: the mean over the corners, or what interactions of this measure remember by
    /// themselves; of each its points and its number.
    #[inline(always)]
    pub(crate) fn take_fields<I: Iterator<Item = usize>>(
        &mut self,
        (fields, of_law): (&Fields, Range<usize>),
        measure: Measure,
        interactions: impl Iterator<Item = (I, usize)> + Clone,
    ) {
        self.fields.clear();
        let padded = self.padded_len();
        let directions = match measure {
            Measure::Length => fields.directions_in(of_law.clone()),
            // Nothing of triangles and tetrahedra sees it.
            _ => of_law.end..of_law.end,
        };
        let before = of_law.start..directions.start;
        fields.add_of(measure, before, padded, interactions.clone(), &mut self.fields);
        self.take_directions(directions.len());
        let behind = directions.end..of_law.end;
        fields.add_of(measure, behind, padded, interactions, &mut self.fields);
    }

    /// Takes so many components of the direction of bonds at rest as fields.
    #[inline(always)]
    fn take_directions(&mut self, components: usize) {
        if components == 0 {
            return;
        }
        let padded = self.padded_len();
        let mut over = [0.0; CAPACITY];
        for channel in &self.reference[..components] {
            over.iter_mut().zip(channel).for_each(|(square, x)| *square += x * x);
        }
        over.iter_mut().for_each(|square| *square = 1.0 / square.sqrt());
        for channel in &self.reference[..components] {
            let mut direction = [0.0; CAPACITY];
            for ((to, x), over) in direction.iter_mut().zip(channel).zip(&over) {
                *to = x * over;
            }
            self.fields.extend_from_slice(&direction[..padded]);
        }
    }

    /// Takes a time step in s for a law of so many fields, if it takes one behind the others or where its
    /// fields have a place for it.
    pub(crate) fn take_time_step(
        &mut self,
        (fields, of_law): (&Fields, Range<usize>),
        n_fields: usize,
        dt: f64,
    ) {
        let time_step = fields.time_steps().iter().find(|field| of_law.contains(field));
        let place = time_step.map_or(of_law.len(), |field| field - of_law.start);
        if n_fields > place {
            let padded = self.padded_len();
            self.fields.resize(n_fields * padded, dt);
            self.fields[place * padded..][..padded].fill(dt);
        }
    }

    /// How many interactions it holds.
    pub fn len(&self) -> usize {
        self.len
    }

    /// How many lanes are computed: whole groups of the widest registers. Lanes beyond [`Self::len`]
    /// repeat the last interaction with weight 0.
    pub fn padded_len(&self) -> usize {
        self.len.next_multiple_of(WIDEST)
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Takes `len` bonds: `bond(lane)` is the vector from the owner at rest, the relative
    /// displacement, both in m, and the weight. `len` is at least 1 and at most [`CAPACITY`].
    #[inline(always)]
    pub fn fill<const D: usize>(
        &mut self,
        len: usize,
        bond: impl Fn(usize) -> ([f64; D], [f64; D], f64),
    ) {
        let len = len.min(CAPACITY);
        self.len = len;
        let padded = self.padded_len();
        let (to_reference, to_displacement) =
            (&mut self.reference[..D], &mut self.displacement[..D]);
        for lane in 0..len {
            let (rest, eta, weight) = bond(lane);
            for axis in 0..D {
                to_reference[axis][lane] = rest[axis];
                to_displacement[axis][lane] = eta[axis];
            }
            self.weight[lane] = weight;
        }
        for channel in to_reference.iter_mut().chain(to_displacement) {
            let last = channel[len - 1];
            channel[len..padded].fill(last);
        }
        self.weight[len..].fill(0.0);
    }

    /// Takes `len` interactions of `K` corners besides the owner: `corners(lane)` names the corners
    /// by their places in `reference` and `displacement`, vectors from the owner in m.
    ///
    /// `len` is at most [`CAPACITY`]. The weights of these lanes are left to the caller.
    #[inline(always)]
    pub fn gather<const K: usize, const D: usize>(
        &mut self,
        len: usize,
        reference: &[[f64; D]],
        displacement: &[[f64; D]],
        corners: impl Fn(usize) -> [usize; K],
    ) {
        let len = len.min(CAPACITY);
        self.len = len;
        let padded = self.padded_len();
        let (to_reference, to_displacement) =
            (&mut self.reference[..K * D], &mut self.displacement[..K * D]);
        let corner_of = |lane: usize, corner: usize| corners(lane.min(len - 1))[corner];
        // Neighbouring interactions share all corners but the last: those are written once for all.
        for corner in 0..K - 1 {
            let mut lane = 0;
            while lane < padded {
                let shared = corner_of(lane, corner);
                let start = lane;
                while lane < padded && corner_of(lane, corner) == shared {
                    lane += 1;
                }
                for axis in 0..D {
                    let channel = corner * D + axis;
                    to_reference[channel][start..lane].fill(reference[shared][axis]);
                    to_displacement[channel][start..lane].fill(displacement[shared][axis]);
                }
            }
        }
        for lane in 0..padded {
            let last = corner_of(lane, K - 1);
            let (rest, eta) = (&reference[last], &displacement[last]);
            for axis in 0..D {
                to_reference[(K - 1) * D + axis][lane] = rest[axis];
                to_displacement[(K - 1) * D + axis][lane] = eta[axis];
            }
        }
        self.weight[len..].fill(0.0);
    }
}

/// What an element returns for a batch; entries beyond the batch's length mean nothing.
#[derive(Clone, Debug)]
pub struct Contributions {
    /// Weighted energies in J.
    pub energy: Channel,
    /// Weighted compact gradients in N: channel `corner*d + axis`.
    pub gradient: Vec<Channel>,
    /// Upper triangles of the weighted compact Hessians in N/m, row by row (see
    /// [`crate::geometry::packed`]).
    pub hessian: Vec<Channel>,
    /// Weighted derivatives in the variable of the measure.
    pub(super) first: Channel,
    /// Weighted second derivatives in the variable of the measure.
    pub(super) second: Channel,
    /// Room for the measures of the batch.
    pub(super) measures: Measures,
    /// Room for the derivatives in the measure.
    pub(super) derivatives: Derivatives,
}

impl Contributions {
    /// Whether what an order asks for of one interaction is finite, with so many coordinates of its other corners.
    pub(super) fn is_finite(&self, lane: usize, order: Order, coordinates: usize) -> bool {
        let all = |channels: &[Channel]| channels.iter().all(|channel| channel[lane].is_finite());
        (!order.has_energy() || self.energy[lane].is_finite())
            && (order == Order::Energy || all(&self.gradient[..coordinates]))
            && (order != Order::Tangent || all(&self.hessian[..packed_len(coordinates)]))
    }

    /// The energies of the first `len` interactions, then zeros to the end of their group.
    #[inline(always)]
    pub(crate) fn energies(&mut self, len: usize) -> &[f64] {
        let padded = len.next_multiple_of(WIDEST);
        self.energy[len..padded].fill(0.0);
        &self.energy[..padded]
    }
}

/// psi, psi' and psi'' of a batch, as far as they were asked for.
#[derive(Clone, Debug)]
pub(super) struct Derivatives {
    pub(super) psi: Channel,
    pub(super) dpsi: Channel,
    pub(super) d2psi: Channel,
}

impl Derivatives {
    pub(super) fn outputs(&mut self) -> Outputs<'_> {
        Outputs { psi: &mut self.psi, dpsi: &mut self.dpsi, d2psi: &mut self.d2psi }
    }
}

/// The measures of a batch.
#[derive(Clone, Debug)]
pub(super) struct Measures {
    pub(super) measure: Channel,
    pub(super) reference: Channel,
    pub(super) change: Channel,
    pub(super) slope: Channel,
    /// Lanes whose interactions are thin: see `Measuring`.
    pub(super) thin: Vec<usize>,
}

impl Contributions {
    /// Room for the interactions of this measure.
    pub fn new(measure: Measure, dimension: usize) -> Contributions {
        let channels = n_neighbors(measure) * dimension;
        let zero = [0.0; CAPACITY];
        Contributions {
            energy: zero,
            gradient: vec![zero; channels],
            hessian: vec![zero; packed_len(channels)],
            first: zero,
            second: zero,
            measures: Measures {
                measure: zero,
                reference: zero,
                change: zero,
                slope: zero,
                thin: Vec::with_capacity(CAPACITY),
            },
            derivatives: Derivatives { psi: zero, dpsi: zero, d2psi: zero },
        }
    }
}
