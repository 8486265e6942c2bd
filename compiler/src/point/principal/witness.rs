//! The trace of a function of `U` over numbers that carry derivatives.
//!
//! The columns of `F` are turned, by a constant rotation, to where their products `c_ij` are
//! perpendicular but for what the derivatives add. To second order the trace of `g(c)`, with
//! `g(c) = f(sqrt(c))`, is then `sum_i g(c_ii) + sum_(i<j) g'[c_i, c_j] c_ij^2`: functions of single
//! numbers, whose derivatives come with the numbers. The divided difference `g'[c_i, c_j]` is an
//! integral over `g''` where `c_i` and `c_j` are near each other, else a quotient.

use num_dual::HyperDual64;

use super::axes::{Axes, Components, LANES};
use crate::expression::graph::component;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::random_rounding::RandomlyRounded;
use crate::expression::real::Real;
use crate::expression::{Function, Operator};

/// Numbers over which the trace of a function of `U` can be taken.
pub trait Principal: Number {
    /// A rotation, axis by axis, that makes the columns of a gradient perpendicular, as constants.
    fn right_axes(d: usize, gradient: &[Self]) -> Vec<Self>;
    /// `g'` at the value of a number, as a constant.
    fn slope(g: &dyn Fn(Self) -> Self, a: &Self) -> Self;
    /// `(g'(a) - g'(b))/(a - b)` as a constant, from the values and `g'` there.
    fn divided_slope(g: &dyn Fn(Self) -> Self, a: [&Self; 2], b: [&Self; 2]) -> Self;
}

/// The columns of `F`, turned by a constant rotation, by their products `c_ij`.
pub(crate) struct Products<N> {
    d: usize,
    /// Row by row.
    products: Vec<N>,
}

impl<N: Principal> Products<N> {
    /// Of a gradient; components of `F` by [`component`].
    pub(crate) fn new(d: usize, gradient: &[N]) -> Self {
        let at = |row, column| usize::from(component(row, column));
        let times = |x: &N, y: &N| N::binary(Operator::Multiply, x.clone(), y.clone());
        let axes = N::right_axes(d, gradient);
        let turned = |(i, a): (usize, usize)| {
            sum((0..d).map(|b| times(&gradient[at(a, b)], &axes[at(i, b)])))
        };
        let columns: Vec<N> = pairs(d).map(turned).collect();
        let product = |(i, j): (usize, usize)| {
            sum((0..d).map(|a| times(&columns[i * d + a], &columns[j * d + a])))
        };
        Products { d, products: pairs(d).map(product).collect() }
    }

    /// The trace of the function `f` of `U`.
    pub(crate) fn trace(&self, f: &dyn Fn(N) -> N) -> N {
        let (d, products) = (self.d, &self.products);
        let g = |square: N| f(N::unary(Function::Sqrt, square));
        let squares = || (0..d).map(|i| &products[i * d + i]);
        let slopes: Vec<N> = squares().map(|square| N::slope(&g, square)).collect();
        let along = squares().map(|square| g(square.clone()));
        let across = pairs(d).filter(|(i, j)| i < j).map(|(i, j)| {
            let slope = N::divided_slope(
                &g,
                [&products[i * d + i], &slopes[i]],
                [&products[j * d + j], &slopes[j]],
            );
            let product = &products[i * d + j];
            let square = N::binary(Operator::Multiply, product.clone(), product.clone());
            N::binary(Operator::Multiply, slope, square)
        });
        sum(along.chain(across))
    }
}

fn sum<N: Number>(terms: impl Iterator<Item = N>) -> N {
    terms.reduce(|x, y| N::binary(Operator::Add, x, y)).unwrap_or(N::constant(0.0))
}

fn pairs(d: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..d * d).map(move |k| (k / d, k % d))
}

/// Abscissae and weights of Gauss and Legendre with eight points on -1 to 1, the positive half.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// Within this ratio the integral has all digits.
const CLOSE: f64 = 1.3;

impl Principal for HyperDual64 {
    fn right_axes(d: usize, gradient: &[Self]) -> Vec<Self> {
        axes_in_doubles(d, gradient)
    }

    fn slope(g: &dyn Fn(Self) -> Self, a: &Self) -> Self {
        HyperDual64::from_re(g(HyperDual64::new(a.re, 1.0, 1.0, 0.0)).eps1)
    }

    fn divided_slope(g: &dyn Fn(Self) -> Self, a: [&Self; 2], b: [&Self; 2]) -> Self {
        let varied = |x: f64| g(HyperDual64::new(x, 1.0, 1.0, 0.0));
        let ([a, slope_a], [b, slope_b]) = (a.map(|x| x.re), b.map(|x| x.re));
        if a.max(b) > CLOSE * a.min(b) {
            return HyperDual64::from_re((slope_a - slope_b) / (a - b));
        }
        let (middle, half) = (0.5 * (a + b), 0.5 * (a - b));
        let both = |(x, weight): (f64, f64)| {
            let sum = varied(middle - half * x).eps1eps2 + varied(middle + half * x).eps1eps2;
            0.5 * weight * sum
        };
        HyperDual64::from_re(GAUSS.into_iter().map(both).sum())
    }
}

/// Derivatives at the value multiply `c_ij^2`, which is 0 but for what derivatives add, and there are none: what
/// rounding leaves of it is a square of roundings. So they are not worked out.
impl Principal for RandomlyRounded {
    fn right_axes(d: usize, gradient: &[Self]) -> Vec<Self> {
        axes_in_doubles(d, gradient)
    }

    fn slope(_: &dyn Fn(Self) -> Self, _: &Self) -> Self {
        RandomlyRounded::constant(0.0)
    }

    fn divided_slope(_: &dyn Fn(Self) -> Self, _: [&Self; 2], _: [&Self; 2]) -> Self {
        RandomlyRounded::constant(0.0)
    }
}

/// Axes as doubles know them, from the values of a gradient.
fn axes_in_doubles<N: Number>(d: usize, gradient: &[N]) -> Vec<N> {
    let mut values: Components = [[0.0; LANES]; 9];
    for (value, x) in values.iter_mut().zip(gradient) {
        value[0] = x.value();
    }
    let axes = Axes::far(d, &values).right;
    axes.map(|axis| N::constant(axis[0])).to_vec()
}

impl<const BITS: usize> Principal for Precise<BITS> {
    fn right_axes(d: usize, gradient: &[Self]) -> Vec<Self> {
        match gradient.iter().map(|x| x.parts().map(|parts| parts[0].clone())).collect() {
            Some(values) => {
                let values: Vec<Real<BITS>> = values;
                rotation::<BITS>(d, &values).into_iter().map(Precise::exactly).collect()
            }
            None => vec![Precise::nothing(); gradient.len()],
        }
    }

    fn slope(g: &dyn Fn(Self) -> Self, a: &Self) -> Self {
        let varied = a.parts().map(|[a, ..]| g(Precise::at(a.clone(), 1)));
        let slope = varied.and_then(|g| g.parts().map(|[_, slope, _]| slope.clone()));
        slope.map_or(Precise::nothing(), Precise::exactly)
    }

    fn divided_slope(g: &dyn Fn(Self) -> Self, a: [&Self; 2], b: [&Self; 2]) -> Self {
        let values =
            |[x, slope]: [&Self; 2]| Some((x.parts()?[0].clone(), slope.parts()?[0].clone()));
        let (Some((a, slope_a)), Some((b, slope_b))) = (values(a), values(b)) else {
            return Precise::nothing();
        };
        let apart = &a - &b;
        // With a quarter of the digits in common, quotient and derivative are right to half of them.
        if apart.size().shifted(BITS as isize / 4) >= a.size() {
            return Precise::exactly((slope_a - slope_b) / apart);
        }
        let middle = g(Precise::at((a + b) / Real::from(2), 1));
        middle.parts().map_or(Precise::nothing(), |parts| Precise::exactly(parts[2].clone()))
    }
}

/// Axes, one after the other by [`component`], that make the columns of a gradient perpendicular to all
/// digits: one-sided Jacobi rotations.
fn rotation<const BITS: usize>(d: usize, gradient: &[Real<BITS>]) -> Vec<Real<BITS>> {
    let at = |row, column| usize::from(component(row, column));
    let mut columns = vec![Real::from(0); 9];
    let mut axes = columns.clone();
    for i in 0..d {
        axes[at(i, i)] = Real::from(1);
        (0..d).for_each(|j| columns[at(i, j)] = gradient[at(j, i)].clone());
    }
    let dot = |rows: &[Real<BITS>], p: usize, q: usize| {
        (0..d).map(|k| &rows[at(p, k)] * &rows[at(q, k)]).fold(Real::from(0), |x, y| x + y)
    };
    for _ in 0..40 {
        let mut turned = false;
        for (p, q) in pairs(d).filter(|(p, q)| p < q) {
            let product = dot(&columns, p, q);
            let (first, second) = (dot(&columns, p, p), dot(&columns, q, q));
            let square = &product * &product;
            // Where one of them is no number there is nothing to turn.
            let is_oblique = square.shifted(BITS as isize * 2 - 16) > &first * &second;
            if !is_oblique {
                continue;
            }
            let one = Real::from(1);
            let cotangent = (&second - &first) / (Real::from(2) * &product);
            let length = (&one + &cotangent * &cotangent).sqrt();
            let tangent = &one / (cotangent.size() + length);
            let tangent = if cotangent < Real::from(0) { -tangent } else { tangent };
            let cosine = &one / (&one + &tangent * &tangent).sqrt();
            let sine = &cosine * &tangent;
            for rows in [&mut columns, &mut axes] {
                for k in 0..d {
                    let (x, y) = (rows[at(p, k)].clone(), rows[at(q, k)].clone());
                    rows[at(p, k)] = &cosine * &x - &sine * &y;
                    rows[at(q, k)] = &sine * x + &cosine * y;
                }
            }
            turned = true;
        }
        if !turned {
            break;
        }
    }
    axes
}

#[cfg(test)]
mod tests {
    use super::*;

    const BITS: usize = 256;

    /// Axes are perpendicular and of unit length, and so much more than half the digits are right: nothing
    /// else makes the trace of a function of `U` what it is.
    #[test]
    fn rotations_are_orthogonal_and_make_columns_perpendicular() {
        for (d, gradient) in [(2, [9, 4, 0, -2, 7, 0, 0, 0, 0]), (3, [9, 4, 1, -2, 7, 3, 5, 0, 6])]
        {
            let gradient: Vec<Real<BITS>> = gradient.map(Real::from).to_vec();
            let axes = rotation::<BITS>(d, &gradient);
            let at = |row, column| usize::from(component(row, column));
            let turned = |i: usize, a: usize| {
                (0..d).fold(Real::from(0), |sum, b| sum + &gradient[at(a, b)] * &axes[at(i, b)])
            };
            let near = |x: Real<BITS>, expected: i32| {
                (x - Real::from(expected)).size().shifted(BITS as isize - 32) < Real::from(1)
            };
            for (i, j) in pairs(d) {
                let both = |a: usize| &axes[at(i, a)] * &axes[at(j, a)];
                let product = (0..d).map(both).fold(Real::from(0), |x, y| x + y);
                assert!(near(product, i32::from(i == j)), "{d}: axes {i}, {j}");
                let both = (0..d).map(|a| turned(i, a) * turned(j, a));
                let product = both.fold(Real::from(0), |x, y| x + y);
                assert!(i == j || near(product, 0), "{d}: columns {i}, {j}");
            }
        }
    }
}
