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

    /// Takes `len` interactions of `K` corners besides the owner: `corners(lane)` names the corners
    /// by their places in `reference` and `displacement`, vectors from the owner in m.
    ///
    /// `len` is at most [`CAPACITY`]. The weights are left to the caller.
    #[inline(always)]
    pub fn gather<const K: usize, const D: usize>(
        &mut self,
        len: usize,
        reference: &[[f64; D]],
        displacement: &[[f64; D]],
        corners: impl Fn(usize) -> [usize; K],
    ) {
        let len = len.min(CAPACITY);
        let (to_reference, to_displacement) =
            (&mut self.reference[..K * D], &mut self.displacement[..K * D]);
        for lane in 0..len {
            let corners = corners(lane);
            for corner in 0..K {
                let (rest, eta) = (&reference[corners[corner]], &displacement[corners[corner]]);
                for axis in 0..D {
                    to_reference[corner * D + axis][lane] = rest[axis];
                    to_displacement[corner * D + axis][lane] = eta[axis];
                }
            }
        }
        self.len = len;
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
    /// Lanes whose interactions are thin: see `measure_all`.
    pub(super) thin: Vec<usize>,
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
            measures: Measures {
                measure: zero,
                reference: zero,
                change: zero,
                orientation: zero,
                thin: Vec::new(),
            },
            derivatives: Derivatives::default(),
        }
    }
}
