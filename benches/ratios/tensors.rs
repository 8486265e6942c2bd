//! Materials written for the benchmarks alone, eight tensors side by side: by hand and over dual numbers.

pub(crate) mod by_hand;
pub(crate) mod numbers;

pub(crate) type Tensor = [[f64; 3]; 3];

/// Tensors side by side.
pub(crate) const LANES: usize = 8;

/// A number in every lane.
pub(crate) type Channel = [f64; LANES];

/// A tensor in every lane.
pub(crate) type Tensors = [[Channel; 3]; 3];

pub(crate) const NO_TENSORS: Tensors = [[[0.0; LANES]; 3]; 3];

/// Lame parameters.
pub(crate) const LAMBDA: f64 = 1.0;
pub(crate) const MU: f64 = 1.0;

/// An energy of F with its derivatives.
pub(crate) trait Material {
    /// psi and `P(F)`.
    fn stress(f: &Tensors) -> (Channel, Tensors);
    /// `dP/dF : dF`.
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors;
}

#[inline(always)]
pub(crate) fn lane_of(tensors: &Tensors, lane: usize) -> Tensor {
    let mut tensor = [[0.0; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            tensor[r][c] = tensors[r][c][lane];
        }
    }
    tensor
}

#[inline(always)]
pub(crate) fn set_lane(tensors: &mut Tensors, lane: usize, tensor: &Tensor) {
    for r in 0..3 {
        for c in 0..3 {
            tensors[r][c][lane] = tensor[r][c];
        }
    }
}
