//! How many multiplications geometry takes, counted on the formulas that assembly evaluates.

use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::bond::Bond;
use super::tetrahedron::Tetrahedron;
use super::triangle::{PlaneTriangle, SpaceTriangle};
use super::{Geometry, Scalar};
use crate::kernel::{Measure, Order};

/// Multiplications, divisions and roots of one interaction: of its measure with the change since rest,
/// and as the order asks of its derivatives times those of an energy density. The density itself is not
/// counted, nor is an addition, which a machine can make beside a multiplication.
pub fn multiplications(measure: Measure, dimension: usize, order: Order) -> usize {
    match (measure, dimension) {
        (Measure::Length, 2) => of::<Bond, 2>(order),
        (Measure::Length, _) => of::<Bond, 3>(order),
        (Measure::Area, 2) => of::<PlaneTriangle, 4>(order),
        (Measure::Area, _) => of::<SpaceTriangle, 6>(order),
        (Measure::Volume, _) => of::<Tetrahedron, 9>(order),
    }
}

fn of<G: Geometry<C>, const C: usize>(order: Order) -> usize {
    let count = Cell::new(0);
    let x = [Counted(&count); C];
    G::change(&x, &x);
    if order >= Order::Gradient {
        let gradient = G::gradient(&x);
        // Each times psi' of the measure.
        count.set(count.get() + C);
        if order >= Order::Tangent {
            G::hessian(&x, &gradient, x[0], x[0], |_, _| {});
        }
    }
    count.get()
}

/// A number that is not worked out: only how often numbers are multiplied is.
#[derive(Clone, Copy)]
struct Counted<'a>(&'a Cell<usize>);

impl Counted<'_> {
    fn one_more(self) -> Self {
        self.0.set(self.0.get() + 1);
        self
    }
}

impl Mul for Counted<'_> {
    type Output = Self;
    fn mul(self, _: Self) -> Self {
        self.one_more()
    }
}

impl Div for Counted<'_> {
    type Output = Self;
    fn div(self, _: Self) -> Self {
        self.one_more()
    }
}

impl Add for Counted<'_> {
    type Output = Self;
    fn add(self, _: Self) -> Self {
        self
    }
}

impl Sub for Counted<'_> {
    type Output = Self;
    fn sub(self, _: Self) -> Self {
        self
    }
}

impl Neg for Counted<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        self
    }
}

impl Scalar for Counted<'_> {
    fn alike(self, _: f64) -> Self {
        self
    }
    fn sqrt(self) -> Self {
        self.one_more()
    }
    fn sign(self) -> Self {
        self
    }
    fn where_equal(self, _: Self, _: Self, _: Self) -> Self {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_are_counted() {
        let of = |measure, dimension| {
            [Order::Energy, Order::Gradient, Order::Tangent]
                .map(|order| multiplications(measure, dimension, order))
        };
        // A plane triangle: 2 each for a, A, xi x eta twice; 2 orientations, 1 quotient. Its gradient
        // has no products, its Hessian those of a dyad: 4 of the rows, 10 entries.
        assert_eq!(of(Measure::Area, 2), [11, 15, 29]);
        // A bond in the plane or in space: three scalar products, and what makes lengths of squares; the
        // dyad.
        let [plane, space] = [2, 3].map(|d| of(Measure::Length, d));
        assert_eq!([space[0] - plane[0], space[1] - space[0]], [3, 3]);
        assert_eq!([plane[2] - plane[1], space[2] - space[1]], [2 + 3, 3 + 6]);
        // An area in space: four vector products, three scalar ones, two roots and what makes a change
        // of them. A volume: four and four, two orientations, a quotient.
        assert_eq!(of(Measure::Area, 3)[0], 4 * 6 + 3 * 3 + 4);
        assert_eq!(of(Measure::Volume, 3)[0], 4 * 6 + 4 * 3 + 3);
    }
}
