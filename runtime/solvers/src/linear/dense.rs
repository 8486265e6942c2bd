//! A dense factorisation, of which sparse ones are made: what it takes tells what those take.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::{MatMut, Par};

/// Cholesky factorisations of the identity, `n x n`, on one thread.
pub struct DenseCholesky {
    n: usize,
    values: Vec<f64>,
    room: MemBuffer,
}

impl DenseCholesky {
    /// Of so many unknowns.
    pub fn new(n: usize) -> DenseCholesky {
        let values = (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect();
        let scratch = cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
        DenseCholesky { n, values, room: MemBuffer::new(scratch) }
    }

    /// Factorises in place; the identity is its own factor, so that it can go on.
    pub fn factorise(&mut self) {
        let matrix = MatMut::from_column_major_slice_mut(&mut self.values, self.n, self.n);
        let room = MemStack::new(&mut self.room);
        // The identity is positive definite.
        let _ = cholesky_in_place(matrix, Default::default(), Par::Seq, room, Default::default());
    }

    /// Multiplications and additions of one.
    pub fn operations(&self) -> f64 {
        let n = self.n as f64;
        n * n * n / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_identity_stays_what_it_is() {
        let mut dense = DenseCholesky::new(70);
        let identity = dense.values.clone();
        (0..2).for_each(|_| dense.factorise());
        assert_eq!(dense.values, identity);
        assert_eq!(identity.iter().sum::<f64>(), 70.0);
        // And it is worked on: what is no identity is not left alone.
        dense.values[0] = 4.0;
        dense.factorise();
        assert_eq!(dense.values[0], 2.0);
    }
}
