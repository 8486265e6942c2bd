//! Principal stretches and axes of a deformation gradient: `F = sum_i s_i n_i N_i`.
//!
//! Far from rest by one-sided Jacobi rotations of the columns of `F`, which keep the digits of small
//! stretches that `C = F'*F` would lose; near rest by rotations of `C - I = H + H' + H'*H`, so that
//! `s_i - 1` has the digits of `H`.

use crate::expression::Input;
use crate::expression::graph::{self, component};

/// Most sweeps; three or four are usual, because convergence is quadratic.
const SWEEPS: usize = 30;

/// Vectors count as perpendicular when their product is this small against their lengths.
const PERPENDICULAR: f64 = f64::EPSILON;

/// Numbers of one place: components by [`component`].
pub(crate) type Components = [f64; 9];

/// Principal stretches and axes; axis `i` is row `i`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axes {
    pub(crate) stretches: [f64; 3],
    /// Stretches less 1.
    pub(crate) changes: [f64; 3],
    pub(crate) left: Components,
    pub(crate) right: Components,
}

/// The inputs that stand for axes, in the order of [`Axes::write`].
pub(crate) fn inputs(dimension: usize) -> impl Iterator<Item = Input> {
    let numbers = |of: fn(u8) -> Input| (0..dimension as u8).map(of);
    let components = |of: fn(u8) -> Input| graph::components(dimension).into_iter().map(of);
    numbers(Input::Stretch)
        .chain(numbers(Input::StretchChange))
        .chain(components(Input::LeftAxis))
        .chain(components(Input::RightAxis))
}

/// Whether an input is one of these.
pub(crate) fn is_one(input: Input) -> bool {
    matches!(
        input,
        Input::Stretch(_) | Input::StretchChange(_) | Input::LeftAxis(_) | Input::RightAxis(_)
    )
}

impl Axes {
    /// Of `F`; what is no number anywhere in it is none in all of the result.
    pub(crate) fn far(d: usize, gradient: &Components) -> Axes {
        let scale = power_of_two(gradient.iter().fold(0.0, |most: f64, x| most.max(x.abs())));
        // Columns as rows.
        let mut columns = [0.0; 9];
        for (row, column) in pairs(d) {
            columns[at(column, row)] = gradient[at(row, column)] / scale;
        }
        let mut right = identity(d);
        for _ in 0..SWEEPS {
            let mut turned = false;
            for (p, q) in planes(d) {
                let product = dot(&columns, p, q, d);
                let (first, second) = (dot(&columns, p, p, d), dot(&columns, q, q, d));
                let small = PERPENDICULAR * first.sqrt() * second.sqrt();
                // Also where something is no number.
                if product.abs() <= small || product.is_nan() || small.is_nan() {
                    continue;
                }
                let turn = Turn::new((second - first) / (2.0 * product));
                turn.rows(&mut columns, p, q, d);
                turn.rows(&mut right, p, q, d);
                turned = true;
            }
            if !turned {
                break;
            }
        }
        let mut axes = Axes { stretches: [1.0; 3], changes: [0.0; 3], left: columns, right };
        for i in 0..d {
            // Squares of the smallest would be none.
            let length = (0..d).fold(0.0, |sum, a| libm::hypot(sum, axes.left[at(i, a)]));
            axes.stretches[i] = length * scale;
            axes.changes[i] = axes.stretches[i] - 1.0;
            for a in 0..d {
                axes.left[at(i, a)] /= length;
            }
        }
        axes.complete(d);
        axes
    }

    /// Of `F = I + H` for small `H`.
    pub(crate) fn near(d: usize, change: &Components) -> Axes {
        // C - I
        let mut strain = [0.0; 9];
        for (i, j) in pairs(d) {
            let product: f64 = (0..d).map(|k| change[at(k, i)] * change[at(k, j)]).sum();
            strain[at(i, j)] = (change[at(i, j)] + change[at(j, i)]) + product;
        }
        let mut right = identity(d);
        for _ in 0..SWEEPS {
            let mut turned = false;
            for (p, q) in planes(d) {
                let product = strain[at(p, q)];
                let (first, second) = (strain[at(p, p)], strain[at(q, q)]);
                let small = 0.5 * PERPENDICULAR * first.abs().max(second.abs());
                // Also where something is no number.
                if product.abs() <= small || product.is_nan() || small.is_nan() {
                    continue;
                }
                let turn = Turn::new((second - first) / (2.0 * product));
                turn.rows(&mut strain, p, q, d);
                turn.columns(&mut strain, p, q, d);
                turn.rows(&mut right, p, q, d);
                turned = true;
            }
            if !turned {
                break;
            }
        }
        let mut axes = Axes { stretches: [1.0; 3], changes: [0.0; 3], left: [0.0; 9], right };
        for i in 0..d {
            let square = strain[at(i, i)];
            axes.changes[i] = square / (1.0 + (1.0 + square).sqrt());
            axes.stretches[i] = 1.0 + axes.changes[i];
            for a in 0..d {
                let moved: f64 = (0..d).map(|b| change[at(a, b)] * right[at(i, b)]).sum();
                axes.left[at(i, a)] = right[at(i, a)] + moved;
            }
            let length = dot(&axes.left, i, i, d).sqrt();
            for a in 0..d {
                axes.left[at(i, a)] /= length;
            }
        }
        axes
    }

    /// Axes of stretches that are 0 have no direction of their own: any that is perpendicular to the
    /// others serves.
    fn complete(&mut self, d: usize) {
        for i in (0..d).filter(|i| self.stretches[*i] == 0.0).collect::<Vec<_>>() {
            let done: Vec<usize> = (0..d)
                .filter(|j| *j < i || self.stretches[*j] != 0.0)
                .filter(|j| *j != i)
                .collect();
            let mut best = ([0.0; 3], 0.0);
            for unit in 0..d {
                let mut candidate = [0.0; 3];
                candidate[unit] = 1.0;
                for &j in &done {
                    let along = self.left[at(j, unit)];
                    for (a, x) in candidate.iter_mut().enumerate().take(d) {
                        *x -= along * self.left[at(j, a)];
                    }
                }
                let length = candidate.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length > best.1 {
                    best = (candidate, length);
                }
            }
            for a in 0..d {
                self.left[at(i, a)] = best.0[a] / best.1;
            }
        }
    }

    /// Writes its numbers to entry `p` of one array for each of [`inputs`].
    pub(crate) fn write(&self, d: usize, p: usize, arrays: &mut [impl AsMut<[f64]>]) {
        let numbers = self.stretches[..d].iter().chain(&self.changes[..d]).copied();
        let axes = |tensor: &Components| {
            let tensor = *tensor;
            pairs(d).map(move |(i, a)| tensor[at(i, a)])
        };
        let numbers = numbers.chain(axes(&self.left)).chain(axes(&self.right));
        for (array, number) in arrays.iter_mut().zip(numbers) {
            array.as_mut()[p] = number;
        }
    }
}

/// A rotation in a plane that makes two vectors perpendicular.
struct Turn {
    cosine: f64,
    sine: f64,
}

impl Turn {
    /// From the cotangent of twice the angle.
    fn new(cotangent: f64) -> Turn {
        let size = cotangent.abs() + libm::hypot(1.0, cotangent);
        let tangent = libm::copysign(1.0 / size, cotangent);
        let cosine = 1.0 / libm::sqrt(1.0 + tangent * tangent);
        Turn { cosine, sine: cosine * tangent }
    }

    fn pair(&self, x: f64, y: f64) -> (f64, f64) {
        (self.cosine * x - self.sine * y, self.sine * x + self.cosine * y)
    }

    fn rows(&self, tensor: &mut Components, p: usize, q: usize, d: usize) {
        for k in 0..d {
            (tensor[at(p, k)], tensor[at(q, k)]) = self.pair(tensor[at(p, k)], tensor[at(q, k)]);
        }
    }

    fn columns(&self, tensor: &mut Components, p: usize, q: usize, d: usize) {
        for k in 0..d {
            (tensor[at(k, p)], tensor[at(k, q)]) = self.pair(tensor[at(k, p)], tensor[at(k, q)]);
        }
    }
}

fn at(row: usize, column: usize) -> usize {
    usize::from(component(row, column))
}

fn pairs(d: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..d * d).map(move |k| (k / d, k % d))
}

fn planes(d: usize) -> impl Iterator<Item = (usize, usize)> {
    pairs(d).filter(|(p, q)| p < q)
}

fn dot(rows: &Components, p: usize, q: usize, d: usize) -> f64 {
    (0..d).map(|k| rows[at(p, k)] * rows[at(q, k)]).sum()
}

fn identity(d: usize) -> Components {
    let mut identity = [0.0; 9];
    (0..d).for_each(|i| identity[at(i, i)] = 1.0);
    identity
}

/// The power of two below a size; 1 for 0 and for what is no finite number.
fn power_of_two(size: f64) -> f64 {
    if size == 0.0 || !size.is_finite() {
        return 1.0;
    }
    libm::ldexp(1.0, libm::ilogb(size).clamp(-1000, 1000))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from -1 to 1 by a recurrence.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 1_u64;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    fn tensor(d: usize, mut of: impl FnMut(usize, usize) -> f64) -> Components {
        let mut tensor = [0.0; 9];
        pairs(d).for_each(|(i, j)| tensor[at(i, j)] = of(i, j));
        tensor
    }

    /// Largest errors of `F = sum s n N`, and of the axes as perpendicular unit vectors.
    fn errors(d: usize, gradient: &Components, axes: &Axes) -> [f64; 2] {
        let mut errors = [0.0_f64; 2];
        let size = gradient.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        for (a, b) in pairs(d) {
            let sum: f64 = (0..d)
                .map(|i| axes.stretches[i] * axes.left[at(i, a)] * axes.right[at(i, b)])
                .sum();
            errors[0] = errors[0].max((sum - gradient[at(a, b)]).abs() / size);
            for rows in [&axes.left, &axes.right] {
                let unit = if a == b { 1.0 } else { 0.0 };
                errors[1] = errors[1].max((dot(rows, a, b, d) - unit).abs());
            }
        }
        errors
    }

    #[test]
    fn stretches_and_axes_give_the_gradient_back() {
        let mut number = numbers();
        for d in [2, 3] {
            for k in 0..2000 {
                let size = libm::pow(10.0, f64::from(k % 13) - 6.0);
                let gradient = tensor(d, |_, _| size * number());
                let axes = Axes::far(d, &gradient);
                let found = errors(d, &gradient, &axes);
                assert!(found[0] < 4e-15 && found[1] < 4e-15, "{found:?} for {gradient:?}");
            }
        }
    }

    #[test]
    fn small_changes_keep_their_digits() {
        let mut number = numbers();
        for d in [2, 3] {
            for k in 0..2000 {
                let size = 0.25 * libm::pow(10.0, -f64::from(k % 16));
                let change = tensor(d, |_, _| size * number());
                let axes = Axes::near(d, &change);
                // sum e^2 + 2 sum e = C:I - d, and the same from sums of products.
                let e = axes.changes;
                let trace: f64 = (0..d).map(|i| e[i] * e[i] + 2.0 * e[i]).sum();
                let straight: f64 = (0..d).map(|i| 2.0 * change[at(i, i)]).sum();
                let squares: f64 = change.iter().map(|h| h * h).sum();
                assert!((trace - (straight + squares)).abs() < 8e-15 * size, "{change:?}");
                let gradient = tensor(d, |i, j| change[at(i, j)] + identity(d)[at(i, j)]);
                let found = errors(d, &gradient, &axes);
                assert!(found[0] < 4e-15 && found[1] < 4e-15, "{found:?} for {change:?}");
            }
        }
    }

    #[test]
    fn small_stretches_beside_large_ones_keep_their_digits() {
        for stretches in [[1e-6, 1e6, 1.0], [1e-150, 1.0, 1e150], [1e-300, 1e-300, 1e-300]] {
            // Columns of any direction: no rounding but of the directions.
            let angle = 0.3_f64;
            let (c, s) = (libm::cos(angle), libm::sin(angle));
            let rotation = [c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0];
            let gradient = tensor(3, |i, j| rotation[at(i, j)] * stretches[j]);
            let axes = Axes::far(3, &gradient);
            let mut found = axes.stretches;
            found.sort_by(f64::total_cmp);
            let mut expected = stretches;
            expected.sort_by(f64::total_cmp);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-15, "{found:e} for {expected:e}");
            }
        }
    }

    #[test]
    fn equal_and_vanishing_stretches_have_axes_too() {
        for diagonal in [[1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 3.0]] {
            let gradient = tensor(3, |i, j| if i == j { diagonal[i] } else { 0.0 });
            let axes = Axes::far(3, &gradient);
            let found = errors(3, &tensor(3, |i, j| gradient[at(i, j)]), &axes);
            assert!(found[1] == 0.0, "{diagonal:?}: {axes:?}");
        }
        assert!(Axes::far(3, &[f64::NAN; 9]).stretches[0].is_nan());
    }
}
