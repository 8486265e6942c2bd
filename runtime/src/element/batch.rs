//! Interactions side by side, one array per number: the form in which elements take and give them.

use crate::geometry::packed_len;
use crate::interaction::n_neighbors;
use crate::kernel::{Derivatives, Measure};

/// How many interactions fit into a batch.
pub const CAPACITY: usize = 128;

/// Length of a channel: a little more than the capacity, because channels whose distance is a power
/// of two would share a few sets of the cache.
pub const STRIDE: usize = CAPACITY + 8;

/// One number of every interaction of a batch.
pub type Channel = [f64; STRIDE];

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
}

impl InteractionBatch {
    /// An empty batch for interactions of this measure.
    pub fn new(measure: Measure, dimension: usize) -> InteractionBatch {
        let channels = n_neighbors(measure) * dimension;
        InteractionBatch {
            len: 0,
            reference: vec![[0.0; STRIDE]; channels],
            displacement: vec![[0.0; STRIDE]; channels],
            weight: [0.0; STRIDE],
        }
    }

    /// How many interactions it holds.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether it can hold no more.
    pub fn is_full(&self) -> bool {
        self.len == CAPACITY
    }

    /// Forgets all interactions.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends an interaction of `K + 1` corners; the batch must not be full.
    #[inline(always)]
    pub fn push<const K: usize, const D: usize>(
        &mut self,
        reference: [&[f64; D]; K],
        displacement: [&[f64; D]; K],
        weight: f64,
    ) {
        let lane = self.len;
        for corner in 0..K {
            for axis in 0..D {
                self.reference[corner * D + axis][lane] = reference[corner][axis];
                self.displacement[corner * D + axis][lane] = displacement[corner][axis];
            }
        }
        self.weight[lane] = weight;
        self.len += 1;
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
    /// Room for the measures of the batch.
    pub(super) measures: Measures,
    /// Room for the derivatives in the measure.
    pub(super) derivatives: Derivatives,
}

/// The measures of a batch.
#[derive(Clone, Debug)]
pub(super) struct Measures {
    pub(super) measure: Channel,
    pub(super) reference: Channel,
    pub(super) change: Channel,
    pub(super) orientation: Channel,
}

impl Contributions {
    /// Room for the interactions of this measure.
    pub fn new(measure: Measure, dimension: usize) -> Contributions {
        let channels = n_neighbors(measure) * dimension;
        let zero = [0.0; STRIDE];
        Contributions {
            energy: zero,
            gradient: vec![zero; channels],
            hessian: vec![zero; packed_len(channels)],
            measures: Measures { measure: zero, reference: zero, change: zero, orientation: zero },
            derivatives: Derivatives::default(),
        }
    }
}
