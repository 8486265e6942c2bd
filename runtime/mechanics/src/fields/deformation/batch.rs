//! Laws over batches of deformation gradients.

use crate::fields::stored::Tensor;
use crate::kernel::Variables;
use crate::materials::{LawOfPoints, Place};
use crate::vector::are_finite;

/// Deformation gradients evaluated at once.
pub(super) const CAPACITY: usize = 128;

/// A number of each tensor of a whole batch.
pub(super) type Column = [f64; CAPACITY];

/// Components of all tensors of a batch, row by row: a column each, or as laws take them, one behind the other.
pub(super) type Columns = [Column; 9];

/// Arrays of a batch: component by component, as laws take them. They fit on a thread's stack.
pub(super) struct LawBatch<const D: usize> {
    n: usize,
    /// What the law takes of fields.
    given: Vec<f64>,
    current: Columns,
    change: Columns,
    direction: Columns,
    psi: Column,
    out: Columns,
}

impl<const D: usize> LawBatch<D> {
    pub(super) fn new() -> LawBatch<D> {
        let zero = [[0.0; CAPACITY]; 9];
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
        self.evaluate_taken((law, laws), places, with_stress)
    }

    /// The same at what was taken.
    pub(super) fn evaluate_taken(
        &mut self,
        (law, laws): (LawOfPoints<'_>, &[u8]),
        places: impl Fn(usize) -> Place,
        with_stress: bool,
    ) -> Result<(), usize> {
        law.give(self.n, places, &mut self.given);
        let size = D * D * self.n;
        let at = Variables {
            n: self.n,
            current: &self.current.as_flattened()[..size],
            change: &self.change.as_flattened()[..size],
            given: &self.given,
            laws,
        };
        let out = &mut self.out.as_flattened_mut()[..if with_stress { size } else { 0 }];
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
        let (n, all) = (self.n, self.direction.as_flattened_mut());
        for (lane, direction) in directions.iter().enumerate() {
            for (k, x) in direction.as_flattened().iter().enumerate() {
                all[k * n + lane] = *x;
            }
        }
        self.multiply_taken((law, laws), places)
    }

    /// The same of what was taken.
    pub(super) fn multiply_taken(
        &mut self,
        (law, laws): (LawOfPoints<'_>, &[u8]),
        places: impl Fn(usize) -> Place,
    ) -> Result<(), usize> {
        law.give(self.n, places, &mut self.given);
        let size = D * D * self.n;
        let at = Variables {
            n: self.n,
            current: &self.current.as_flattened()[..size],
            change: &self.change.as_flattened()[..size],
            given: &self.given,
            laws,
        };
        let out = &mut self.out.as_flattened_mut()[..size];
        law.law.product(at, &self.direction.as_flattened()[..size], out);
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
        Ok(&self.out.as_flattened()[..D * D * D * D])
    }

    fn take(&mut self, h: &[Tensor<D>]) {
        self.n = h.len();
        for (lane, h) in h.iter().enumerate() {
            for r in 0..D {
                for c in 0..D {
                    let place = (r * D + c) * self.n + lane;
                    self.change.as_flattened_mut()[place] = h[r][c];
                    let current = if r == c { 1.0 + h[r][c] } else { h[r][c] };
                    self.current.as_flattened_mut()[place] = current;
                }
            }
        }
    }

    /// Columns of displacement gradients and directions, to be written before [`LawBatch::take_columns`].
    #[inline(always)]
    pub(super) fn columns(&mut self) -> [&mut Columns; 2] {
        [&mut self.change, &mut self.direction]
    }

    /// Takes the first `n` lanes of what was written, of which laws then see nothing else.
    #[inline(always)]
    pub(super) fn take_columns(&mut self, n: usize) {
        for k in 0..D * D {
            self.current[k] = self.change[k];
            if k % (D + 1) == 0 {
                self.current[k].iter_mut().for_each(|x| *x += 1.0);
            }
        }
        self.n = n;
        // Of a whole batch columns stand one behind the other.
        if n == CAPACITY {
            return;
        }
        for of in [&mut self.current, &mut self.change, &mut self.direction] {
            let all = of.as_flattened_mut();
            (1..D * D).for_each(|k| all.copy_within(k * CAPACITY..k * CAPACITY + n, k * n));
        }
    }

    /// Makes columns of the stresses, or products, which nothing else then finds.
    #[inline(always)]
    pub(super) fn out_as_columns(&mut self) -> &mut Columns {
        let (n, all) = (self.n, self.out.as_flattened_mut());
        if n < CAPACITY {
            (1..D * D).rev().for_each(|k| all.copy_within(k * n..(k + 1) * n, k * CAPACITY));
        }
        &mut self.out
    }

    fn check(&self, with_out: bool, with_psi: bool) -> Result<(), usize> {
        let size = if with_out { D * D * self.n } else { 0 };
        let psi = &self.psi[..if with_psi { self.n } else { 0 }];
        let out = &self.out.as_flattened()[..size];
        if are_finite(psi) && are_finite(out) {
            return Ok(());
        }
        let bad = |lane: &usize| {
            psi.get(*lane).is_some_and(|x| !x.is_finite())
                || (0..size / self.n).any(|k| !out[k * self.n + lane].is_finite())
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
        self.lane(&self.out, lane)
    }

    /// The displacement gradient of a lane.
    pub(super) fn gradient(&self, lane: usize) -> Tensor<D> {
        self.lane(&self.change, lane)
    }

    #[inline(always)]
    fn lane(&self, of: &Columns, lane: usize) -> Tensor<D> {
        let all = of.as_flattened();
        std::array::from_fn(|r| std::array::from_fn(|c| all[(r * D + c) * self.n + lane]))
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
