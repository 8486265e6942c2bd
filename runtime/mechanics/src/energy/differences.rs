//! Products with the Hessian by differences of forces, as in Jacobian-free Newton-Krylov methods, to
//! compare with exact ones.
//!
//! Central differences are equation (3.73) of partmann2026, one-sided ones take half the forces. The
//! step there, (3.74), is `cbrt(eps) (|U| + 1)/|w|`: the 1 has a unit, so that the same body in
//! nanometres gets another one, and 2-norms grow with the number of points. Here a step moves the
//! point that moves most by a part of the smallest distance `h` of neighbours, which is what forces
//! change over. With `u` the unit roundoff, differences of order `p` err by `(s/h)^p` since forces
//! are not linear, and by `u max(|u|, h)/s` since displacements are rounded (maximum norms); both
//! are the same at
//!
//! `s = h (u max(1, |u|/h))^(1/(p+1))`.
//!
//! Scaling all lengths, or all forces, changes no digit of what that step is relative to `h`.

use super::{Energy, Hessian, NonFinite, Products, Wanted};
use crate::matrix::BlockPattern;
use crate::pool::Pool;

/// Unit roundoff of f64.
const ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// How far the point that moves most is moved from displacements `u`, in m; `smallest` is the smallest
/// distance of neighbours at rest.
pub(super) fn step(products: Products, smallest: f64, u: &[f64]) -> f64 {
    let rounding = ROUNDOFF * (largest(u) / smallest).max(1.0);
    smallest * products.balanced(rounding)
}

/// The largest entry.
fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}

/// The smallest distance of coupled points; 1 where there are none.
pub(super) fn smallest_distance(pattern: &BlockPattern, positions: &[f64]) -> f64 {
    let d = pattern.dimension;
    let mut smallest = f64::INFINITY;
    for i in 0..pattern.n_rows() {
        for &j in &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]] {
            if i != j as usize {
                let along = |a: usize| positions[i * d + a] - positions[j as usize * d + a];
                let distance = (1..d).fold(along(0), |sum, a| libm::hypot(sum, along(a))).abs();
                smallest = smallest.min(distance);
            }
        }
    }
    if smallest.is_finite() { smallest } else { 1.0 }
}

/// A Hessian that multiplies by differences of forces.
pub(super) struct ForceDifferences<'a> {
    energy: &'a dyn Energy,
    /// Displacements, `n x d`, in m.
    u: Vec<f64>,
    /// How far the point that moves most is moved, in m.
    step: f64,
    /// Forces at `u` in N, for one-sided differences; none for central ones.
    forces: Vec<f64>,
    /// Room for products.
    rooms: Pool<Room>,
}

/// What is kept from one product to the next.
#[derive(Default)]
struct Room {
    /// Displacements that are moved, and forces there.
    moved: Vec<f64>,
    behind: Vec<f64>,
}

impl Hessian for ForceDifferences<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        let size = largest(p);
        // What is not a number has no size, but makes no finite product either.
        if size == 0.0 && p.iter().all(|p| *p == 0.0) {
            product.fill(0.0);
        } else if self.differences(p, size, product).is_err() {
            product.fill(f64::NAN);
        }
    }
}

impl<'a> ForceDifferences<'a> {
    /// At the displacements `u`, with [`step`].
    pub(super) fn new(
        energy: &'a dyn Energy,
        products: Products,
        u: &[f64],
        step: f64,
    ) -> Result<ForceDifferences<'a>, NonFinite> {
        let mut differences = ForceDifferences {
            energy,
            u: u.to_vec(),
            step,
            forces: Vec::new(),
            rooms: Pool::new(),
        };
        if products == Products::OneSided {
            let mut forces = vec![0.0; u.len()];
            energy.evaluate(u, Wanted::Forces(&mut forces), &mut [])?;
            differences.forces = forces;
        }
        Ok(differences)
    }

    fn differences(&self, p: &[f64], size: f64, product: &mut [f64]) -> Result<(), NonFinite> {
        let mut room = self.rooms.take(Room::default);
        let Room { moved, behind } = &mut *room;
        let mut go = |way: f64, forces: &mut [f64]| {
            moved.clear();
            moved.extend(self.u.iter().zip(p).map(|(u, p)| u + way * self.step * (p / size)));
            self.energy.evaluate(moved, Wanted::Forces(forces), &mut [])
        };
        go(1.0, product)?;
        let (behind, steps) = if self.forces.is_empty() {
            behind.resize(p.len(), 0.0);
            go(-1.0, behind)?;
            (&*behind, 2.0)
        } else {
            (&self.forces, 1.0)
        };
        let factor = size / (steps * self.step);
        product.iter_mut().zip(behind).for_each(|(ahead, behind)| {
            *ahead = (*ahead - behind) * factor;
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Total;
    use super::*;
    use crate::testing::{SpringNetwork, linear, pseudo_random};
    use crate::vector::norm_of;

    /// The relative error of a product, and the step over the spacing.
    fn error(products: Products, u: &[f64], p: &[f64], springs: &SpringNetwork) -> (f64, f64) {
        let differences = Total::of(springs as &dyn Energy).with_products(products);
        let (mut found, mut exact) = (vec![f64::NAN; p.len()], vec![0.0; p.len()]);
        differences.hessian(u).unwrap().multiply(p, &mut found);
        springs.hessian(u).unwrap().multiply(p, &mut exact);
        let error: Vec<f64> = found.iter().zip(&exact).map(|(f, e)| f - e).collect();
        (norm_of(&error) / norm_of(&exact), differences.step(u))
    }

    #[test]
    fn errors_are_those_of_the_order_and_the_size_of_vectors_does_not_matter() {
        let springs = SpringNetwork::lattice(&[6, 5], 2.0, linear);
        let n = springs.positions.len();
        let u: Vec<f64> = pseudo_random(n, 1).iter().map(|x| 0.05 * x).collect();
        for (products, order) in [(Products::OneSided, 1e-8), (Products::Central, 2e-11)] {
            for size in [1e-200, 1.0, 1e200] {
                let p: Vec<f64> = pseudo_random(n, 2).iter().map(|x| size * x).collect();
                let scaled: Vec<f64> = p.iter().map(|x| x / size).collect();
                let differences = Total::of(&springs as &dyn Energy).with_products(products);
                let (mut found, mut exact) = (vec![f64::NAN; n], vec![0.0; n]);
                differences.hessian(&u).unwrap().multiply(&p, &mut found);
                springs.hessian(&u).unwrap().multiply(&scaled, &mut exact);
                let error: Vec<f64> = found.iter().zip(&exact).map(|(f, e)| f / size - e).collect();
                let error = norm_of(&error) / norm_of(&exact);
                assert!((0.01 * order..10.0 * order).contains(&error), "{products:?} {error:e}");
            }
        }
    }

    #[test]
    fn steps_balance_both_errors_where_displacements_are_large() {
        let springs = SpringNetwork::lattice(&[6, 5], 2.0, linear);
        let n = springs.positions.len();
        let p = pseudo_random(n, 2);
        for (products, power) in [(Products::OneSided, 0.5), (Products::Central, 2.0 / 3.0)] {
            let (_, near) = error(products, &vec![0.5; n], &p, &springs);
            assert_eq!(near, products.balanced(ROUNDOFF));
            // A body that has gone a million spacings has lost six digits of its strain.
            let far: Vec<f64> = vec![1e6; n];
            let (found, step) = error(products, &far, &p, &springs);
            let expected = libm::pow(1e6 * ROUNDOFF, power);
            assert!(step > near && found < 10.0 * expected, "{products:?} {found:e} {expected:e}");
        }
    }

    #[test]
    fn nothing_times_the_hessian_is_nothing() {
        let springs = SpringNetwork::lattice(&[3, 3], 1.5, linear);
        let mut product = [f64::NAN; 18];
        let differences = Total::of(&springs as &dyn Energy).with_products(Products::OneSided);
        differences.hessian(&[0.01; 18]).unwrap().multiply(&[0.0; 18], &mut product);
        assert_eq!(product, [0.0; 18]);
        let mut not_a_number = [0.0; 18];
        not_a_number[3] = f64::NAN;
        differences.hessian(&[0.01; 18]).unwrap().multiply(&not_a_number, &mut product);
        assert!(product.iter().any(|x| x.is_nan()));
    }
}
