//! Laws over batches of deformation gradients.

use crate::fields::stored::Tensor;
use crate::kernel::Variables;
use crate::materials::{LawOfPoints, Place};
use crate::vector::are_finite;

/// Deformation gradients evaluated at once.
pub(super) const CAPACITY: usize = 128;

/// Components of all tensors of a batch.
type Components = [f64; 9 * CAPACITY];

/// Arrays of a batch: component by component, as laws take them. They fit on a thread's stack.
pub(super) struct LawBatch<const D: usize> {
    n: usize,
    /// What the law takes of fields.
    given: Vec<f64>,
    current: Components,
    change: Components,
    direction: Components,
    psi: [f64; CAPACITY],
    out: Components,
}

impl<const D: usize> LawBatch<D> {
    pub(super) fn new() -> LawBatch<D> {
        let zero = [0.0; 9 * CAPACITY];
        LawBatch {
            n: 0,
            given: Vec::new(),
            current: zero,
            change: zero,
            direction: zero,
            psi: [0.0; CAPACITY],
            out: zero,
        }
    }

    /// psi and, if asked for, the stress at displacement gradients `h`, at most [`CAPACITY`], with the
    /// numbers of their laws. `Err` holds the first lane where something is not finite.
    pub(super) fn evaluate(
        &mut self,
        (law, laws): (LawOfPoints<'_>, &[u8]),
        (places, h): (impl Fn(usize) -> Place, &[Tensor<D>]),
        with_stress: bool,
    ) -> Result<(), usize> {
        self.take(h);
        law.give(self.n, places, &mut self.given);
        let size = D * D * self.n;
        let at = Variables {
            n: self.n,
            current: &self.current[..size],
            change: &self.change[..size],
            given: &self.given,
            laws,
        };
        let out = &mut self.out[..if with_stress { size } else { 0 }];
        law.law.evaluate(at, &mut self.psi[..self.n], out);
        self.check(with_stress, true)
    }

    /// The second derivatives at `h` times `directions`.
    pub(super) fn multiply(
        &mut self,
        (law, laws): (LawOfPoints<'_>, &[u8]),
        (places, h): (impl Fn(usize) -> Place, &[Tensor<D>]),
        directions: &[Tensor<D>],
    ) -> Result<(), usize> {
        self.take(h);
        law.give(self.n, places, &mut self.given);
        let (n, size) = (self.n, D * D * self.n);
        for (lane, direction) in directions.iter().enumerate() {
            for (k, x) in direction.as_flattened().iter().enumerate() {
                self.direction[k * n + lane] = *x;
            }
        }
        let at = Variables {
            n,
            current: &self.current[..size],
            change: &self.change[..size],
            given: &self.given,
            laws,
        };
        law.law.product(at, &self.direction[..size], &mut self.out[..size]);
        self.check(true, false)
    }

    /// The second derivatives at one place, `d^2 x d^2` row by row; `Err`
    /// holds its determinant.
    pub(super) fn second(
        &mut self,
        (law, number): (LawOfPoints<'_>, u8),
        (place, h): (Place, &Tensor<D>),
    ) -> Result<&[f64], f64> {
        // One lane for each unit direction: products come out as columns, and rows are the same.
        let lanes = [*h; 9];
        let mut directions = [[[0.0; D]; D]; 9];
        for (k, direction) in directions[..D * D].iter_mut().enumerate() {
            direction[k / D][k % D] = 1.0;
        }
        let places = (|_| place, &lanes[..D * D]);
        self.multiply((law, &[number; 9][..D * D]), places, &directions[..D * D])
            .map_err(|_| determinant(h))?;
        Ok(&self.out[..D * D * D * D])
    }

    fn take(&mut self, h: &[Tensor<D>]) {
        self.n = h.len();
        for (lane, h) in h.iter().enumerate() {
            for r in 0..D {
                for c in 0..D {
                    let place = (r * D + c) * self.n + lane;
                    self.change[place] = h[r][c];
                    self.current[place] = if r == c { 1.0 + h[r][c] } else { h[r][c] };
                }
            }
        }
    }

    fn check(&self, with_out: bool, with_psi: bool) -> Result<(), usize> {
        let size = if with_out { D * D * self.n } else { 0 };
        let psi = &self.psi[..if with_psi { self.n } else { 0 }];
        if are_finite(psi) && are_finite(&self.out[..size]) {
            return Ok(());
        }
        let bad = |lane: &usize| {
            psi.get(*lane).is_some_and(|x| !x.is_finite())
                || (0..size / self.n).any(|k| !self.out[k * self.n + lane].is_finite())
        };
        Err((0..self.n).find(bad).unwrap_or(0))
    }

    /// The energy densities.
    pub(super) fn psi(&self) -> &[f64] {
        &self.psi[..self.n]
    }

    /// The stress, or the product, of a lane.
    #[inline(always)]
    pub(super) fn tensor(&self, lane: usize) -> Tensor<D> {
        std::array::from_fn(|r| std::array::from_fn(|c| self.out[(r * D + c) * self.n + lane]))
    }
}

/// The determinant of `I + H`.
pub(super) fn determinant<const D: usize>(h: &Tensor<D>) -> f64 {
    let f = |r: usize, c: usize| if r == c { 1.0 + h[r][c] } else { h[r][c] };
    if D == 2 {
        return f(0, 0) * f(1, 1) - f(0, 1) * f(1, 0);
    }
    let minor = |c: usize| {
        let (p, q) = ((c + 1) % 3, (c + 2) % 3);
        f(1, p) * f(2, q) - f(1, q) * f(2, p)
    };
    f(0, 0) * minor(0) + f(0, 1) * minor(1) + f(0, 2) * minor(2)
}
