//! Principal stretches and axes of a deformation gradient: `F = sum_i s_i n_i N_i`.
//!
//! Far from rest by one-sided Jacobi rotations of the columns of `F`, which keep the digits of small
//! stretches that `C = F'*F` would lose; near rest by rotations of `C - I = H + H' + H'*H`, so that
//! `s_i - 1` has the digits of `H`.

use pulp::{Arch, Simd, WithSimd};

use crate::expression::Input;
use crate::expression::graph::{self, component};

/// Most sweeps; three or four are usual, because convergence is quadratic.
const SWEEPS: usize = 30;

/// Vectors count as perpendicular when their product is this small against their lengths.
const PERPENDICULAR: f64 = f64::EPSILON;

/// Squares below this are taken again without their underflow.
const SMALL_SQUARE: f64 = 1e-280;

/// Places that are looked at side by side, in the same steps.
pub(crate) const LANES: usize = 4;

/// One number for each of the places.
type Lanes = [f64; LANES];

/// Components for each of the places, by [`component`].
pub(crate) type Components = [Lanes; 9];

/// Principal stretches and axes of some places; axis `i` is row `i`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axes {
    pub(crate) stretches: [Lanes; 3],
    /// Stretches less 1.
    pub(crate) changes: [Lanes; 3],
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

/// The numbers they are for one `F`, near rest for one `F - I`, row by row.
pub(crate) fn at_one(d: usize, of: &[f64], is_near: bool) -> Vec<(Input, f64)> {
    let mut tensor = [[0.0; LANES]; 9];
    for (k, x) in of.iter().enumerate() {
        tensor[usize::from(component(k / d, k % d))] = [*x; LANES];
    }
    let axes = if is_near { Axes::near(d, &tensor) } else { Axes::far(d, &tensor) };
    let inputs: Vec<Input> = inputs(d).collect();
    let mut arrays = vec![[0.0]; inputs.len()];
    axes.write(d, &[true], 0, &mut arrays);
    inputs.into_iter().zip(arrays).map(|(input, [x])| (input, x)).collect()
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
        let arch = Arch::new();
        let mut axes = match d {
            2 => arch.dispatch(Far::<2>(gradient)),
            _ => arch.dispatch(Far::<3>(gradient)),
        };
        for lane in 0..LANES {
            if axes.stretches[..d].iter().any(|stretches| stretches[lane] == 0.0) {
                axes.complete(d, lane);
            }
        }
        axes
    }

    /// Of `F = I + H` for small `H`.
    pub(crate) fn near(d: usize, change: &Components) -> Axes {
        let arch = Arch::new();
        match d {
            2 => arch.dispatch(Near::<2>(change)),
            _ => arch.dispatch(Near::<3>(change)),
        }
    }

    /// Axes of stretches that are 0 have no direction of their own: any that is perpendicular to the
    /// others serves.
    fn complete(&mut self, d: usize, lane: usize) {
        let vanishes = self.stretches.map(|stretch| stretch[lane] == 0.0);
        for i in (0..d).filter(|i| vanishes[*i]) {
            let mut best = ([0.0; 3], 0.0);
            for unit in 0..d {
                let mut candidate = [0.0; 3];
                candidate[unit] = 1.0;
                for j in (0..d).filter(|j| *j < i || !vanishes[*j]) {
                    let along = self.left[at(j, unit)][lane];
                    for (a, x) in candidate.iter_mut().enumerate().take(d) {
                        *x -= along * self.left[at(j, a)][lane];
                    }
                }
                let length = candidate.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length > best.1 {
                    best = (candidate, length);
                }
            }
            for a in 0..d {
                self.left[at(i, a)][lane] = best.0[a] / best.1;
            }
        }
    }

    /// Writes the numbers of the chosen lanes to the entries from `start` on of one array for each of
    /// [`inputs`].
    pub(crate) fn write(
        &self,
        d: usize,
        chosen: &[bool],
        start: usize,
        arrays: &mut [impl AsMut<[f64]>],
    ) {
        let numbers = self.stretches[..d].iter().chain(&self.changes[..d]);
        let components = pairs(d).map(|(i, a)| at(i, a));
        let left = components.clone().map(|k| &self.left[k]);
        let axes = left.chain(components.map(|k| &self.right[k]));
        for (array, number) in arrays.iter_mut().zip(numbers.chain(axes)) {
            let places = &mut array.as_mut()[start..start + chosen.len()];
            for ((place, number), chosen) in places.iter_mut().zip(number).zip(chosen) {
                if *chosen {
                    *place = *number;
                }
            }
        }
    }
}

/// In one register of 256 bits where the machine has them; the bits are the same in any.
struct Far<'a, const D: usize>(&'a Components);

impl<const D: usize> WithSimd for Far<'_, D> {
    type Output = Axes;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Axes {
        far::<D>(self.0)
    }
}

/// The same near rest.
struct Near<'a, const D: usize>(&'a Components);

impl<const D: usize> WithSimd for Near<'_, D> {
    type Output = Axes;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Axes {
        near::<D>(self.0)
    }
}

/// Columns of `F` are turned until they are perpendicular.
#[inline(always)]
fn far<const D: usize>(gradient: &Components) -> Axes {
    let scale = each(|k| {
        let largest = gradient.iter().fold(0.0, |most: f64, x| most.max(x[k].abs()));
        power_of_two(largest)
    });
    // Columns as rows.
    let mut columns = [[0.0; LANES]; 9];
    for (row, column) in pairs(D) {
        columns[at(column, row)] = each(|k| gradient[at(row, column)][k] / scale[k]);
    }
    let mut right = identity::<D>();
    sweep::<D>(
        #[inline(always)]
        |p, q| {
            let product = dot::<D>(&columns, p, q);
            let (first, second) = (dot::<D>(&columns, p, p), dot::<D>(&columns, q, q));
            let small = each(|k| PERPENDICULAR * first[k].sqrt() * second[k].sqrt());
            let Some(turn) = Turn::new(&product, &small, &first, &second) else { return false };
            turn.rows::<D>(&mut columns, p, q);
            turn.rows::<D>(&mut right, p, q);
            true
        },
    );
    let zero = [[0.0; LANES]; 3];
    let mut axes = Axes { stretches: zero, changes: zero, left: columns, right };
    for i in 0..D {
        let lengths = lengths::<D>(&axes.left, i);
        axes.stretches[i] = each(|k| lengths[k] * scale[k]);
        axes.changes[i] = each(|k| axes.stretches[i][k] - 1.0);
        for a in 0..D {
            axes.left[at(i, a)] = each(|k| axes.left[at(i, a)][k] / lengths[k]);
        }
    }
    axes
}

/// `C - I` is turned to its principal axes.
#[inline(always)]
fn near<const D: usize>(change: &Components) -> Axes {
    let mut strain = [[0.0; LANES]; 9];
    for (i, j) in pairs(D) {
        strain[at(i, j)] = each(|k| {
            let product: f64 = (0..D).map(|r| change[at(r, i)][k] * change[at(r, j)][k]).sum();
            (change[at(i, j)][k] + change[at(j, i)][k]) + product
        });
    }
    // Turning leaves as much by rounding.
    let small =
        each(|k| PERPENDICULAR * strain.iter().fold(0.0, |most: f64, x| most.max(x[k].abs())));
    let mut right = identity::<D>();
    sweep::<D>(
        #[inline(always)]
        |p, q| {
            let (product, first, second) = (strain[at(p, q)], strain[at(p, p)], strain[at(q, q)]);
            let Some(turn) = Turn::new(&product, &small, &first, &second) else { return false };
            turn.rows::<D>(&mut strain, p, q);
            turn.columns::<D>(&mut strain, p, q);
            turn.rows::<D>(&mut right, p, q);
            true
        },
    );
    let zero = [[0.0; LANES]; 3];
    let mut axes = Axes { stretches: zero, changes: zero, left: [[0.0; LANES]; 9], right };
    for i in 0..D {
        let square = strain[at(i, i)];
        axes.changes[i] = each(|k| square[k] / (1.0 + (1.0 + square[k]).sqrt()));
        axes.stretches[i] = each(|k| 1.0 + axes.changes[i][k]);
        for a in 0..D {
            axes.left[at(i, a)] = each(|k| {
                let moved: f64 = (0..D).map(|b| change[at(a, b)][k] * right[at(i, b)][k]).sum();
                right[at(i, a)][k] + moved
            });
        }
        let lengths = dot::<D>(&axes.left, i, i).map(f64::sqrt);
        for a in 0..D {
            axes.left[at(i, a)] = each(|k| axes.left[at(i, a)][k] / lengths[k]);
        }
    }
    axes
}

/// Rotations in a plane that make two vectors perpendicular; where they are so already, none.
struct Turn {
    needed: [bool; LANES],
    cosine: Lanes,
    sine: Lanes,
}

impl Turn {
    /// From products of the vectors with each other and with themselves, and what of the first counts
    /// as nothing; none where nobody needs one.
    #[inline(always)]
    fn new(product: &Lanes, small: &Lanes, first: &Lanes, second: &Lanes) -> Option<Turn> {
        // False where something is no number.
        let needed: [bool; LANES] = std::array::from_fn(|k| product[k].abs() > small[k]);
        if !needed.contains(&true) {
            return None;
        }
        let tangent = each(|k| {
            // Of twice the angle.
            let cotangent = (second[k] - first[k]) / (2.0 * product[k]);
            (1.0 / (cotangent.abs() + (1.0 + cotangent * cotangent).sqrt())).copysign(cotangent)
        });
        let cosine = each(|k| 1.0 / (1.0 + tangent[k] * tangent[k]).sqrt());
        let sine = each(|k| cosine[k] * tangent[k]);
        Some(Turn { needed, cosine, sine })
    }

    #[inline(always)]
    fn pair(&self, x: &Lanes, y: &Lanes) -> (Lanes, Lanes) {
        let (c, s) = (&self.cosine, &self.sine);
        // A place whose turn is over keeps its bits, whatever the others do.
        let turned =
            |k: usize, turned: f64, before: f64| if self.needed[k] { turned } else { before };
        (
            each(|k| turned(k, c[k] * x[k] - s[k] * y[k], x[k])),
            each(|k| turned(k, s[k] * x[k] + c[k] * y[k], y[k])),
        )
    }

    #[inline(always)]
    fn rows<const D: usize>(&self, tensor: &mut Components, p: usize, q: usize) {
        for k in 0..D {
            (tensor[at(p, k)], tensor[at(q, k)]) = self.pair(&tensor[at(p, k)], &tensor[at(q, k)]);
        }
    }

    #[inline(always)]
    fn columns<const D: usize>(&self, tensor: &mut Components, p: usize, q: usize) {
        for k in 0..D {
            (tensor[at(k, p)], tensor[at(k, q)]) = self.pair(&tensor[at(k, p)], &tensor[at(k, q)]);
        }
    }
}

/// The same for each lane. A loop: the closures of `array::from_fn` stay functions of their own, which know nothing of
/// the registers of the machine.
#[inline(always)]
fn each(f: impl Fn(usize) -> f64) -> Lanes {
    let mut all = [0.0; LANES];
    for k in 0..LANES {
        all[k] = f(k);
    }
    all
}

#[inline(always)]
fn at(row: usize, column: usize) -> usize {
    usize::from(component(row, column))
}

#[inline(always)]
fn pairs(d: usize) -> impl Iterator<Item = (usize, usize)> + Clone {
    (0..d * d).map(move |k| (k / d, k % d))
}

/// Turns in one plane after the other until none is needed; written out, so that places of components
/// are known and stay in registers.
#[inline(always)]
fn sweep<const D: usize>(mut turn: impl FnMut(usize, usize) -> bool) {
    for _ in 0..SWEEPS {
        let mut turned = turn(0, 1);
        if D == 3 {
            turned |= turn(0, 2);
            turned |= turn(1, 2);
        }
        if !turned {
            break;
        }
    }
}

#[inline(always)]
fn dot<const D: usize>(rows: &Components, p: usize, q: usize) -> Lanes {
    each(|k| (0..D).map(|a| rows[at(p, a)][k] * rows[at(q, a)][k]).sum())
}

/// Lengths of a row.
#[inline(always)]
fn lengths<const D: usize>(rows: &Components, i: usize) -> Lanes {
    let squares = dot::<D>(rows, i, i);
    let mut lengths = squares.map(f64::sqrt);
    for k in (0..LANES).filter(|k| squares[*k] < SMALL_SQUARE) {
        lengths[k] = (0..D).fold(0.0, |sum, a| libm::hypot(sum, rows[at(i, a)][k]));
    }
    lengths
}

fn identity<const D: usize>() -> Components {
    let mut identity = [[0.0; LANES]; 9];
    (0..D).for_each(|i| identity[at(i, i)] = [1.0; LANES]);
    identity
}

/// The power of two below a size; 1 for 0 and for what is no finite number.
#[inline(always)]
fn power_of_two(size: f64) -> f64 {
    let exponent = size.to_bits() & 0x7ff0_0000_0000_0000;
    let is_normal = exponent != 0 && exponent != 0x7ff0_0000_0000_0000;
    if is_normal { f64::from_bits(exponent) } else { 1.0 }
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

    type Tensor = [f64; 9];

    fn tensor(d: usize, mut of: impl FnMut(usize, usize) -> f64) -> Tensor {
        let mut tensor = [0.0; 9];
        pairs(d).for_each(|(i, j)| tensor[at(i, j)] = of(i, j));
        tensor
    }

    /// The axes of one gradient.
    struct Alone {
        stretches: [f64; 3],
        changes: [f64; 3],
        left: Tensor,
        right: Tensor,
    }

    /// The last lane, beside others that take as many steps as they please.
    fn alone(tensor: &Tensor, of: impl Fn(&Components) -> Axes) -> Alone {
        let axes = of(&tensor.map(|x| each(|k| if k + 1 == LANES { x } else { x * k as f64 })));
        let last = LANES - 1;
        Alone {
            stretches: axes.stretches.map(|x| x[last]),
            changes: axes.changes.map(|x| x[last]),
            left: axes.left.map(|x| x[last]),
            right: axes.right.map(|x| x[last]),
        }
    }

    fn far(d: usize, gradient: &Tensor) -> Alone {
        alone(gradient, |gradient| Axes::far(d, gradient))
    }

    fn near(d: usize, change: &Tensor) -> Alone {
        alone(change, |change| Axes::near(d, change))
    }

    fn dot(rows: &Tensor, p: usize, q: usize, d: usize) -> f64 {
        (0..d).map(|k| rows[at(p, k)] * rows[at(q, k)]).sum()
    }

    /// Largest errors of `F = sum s n N`, and of the axes as perpendicular unit vectors.
    fn errors(d: usize, gradient: &Tensor, axes: &Alone) -> [f64; 2] {
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
                let axes = far(d, &gradient);
                let found = errors(d, &gradient, &axes);
                assert!(found[0] < 4e-15 && found[1] < 4e-15, "{found:?} for {gradient:?}");
            }
        }
    }

    /// Also where squares of components are no numbers, or nothing.
    #[test]
    fn stretches_scale_with_the_gradient() {
        let mut number = numbers();
        for d in [2, 3] {
            for k in 0..200 {
                let gradient = tensor(d, |_, _| number());
                let exponent = [-900, -600, 600, 900][k % 4];
                let scaled = tensor(d, |i, j| libm::ldexp(gradient[at(i, j)], exponent));
                let (axes, far) = (far(d, &gradient), far(d, &scaled));
                assert_eq!(far.stretches, axes.stretches.map(|x| libm::ldexp(x, exponent)));
                assert_eq!((far.left, far.right), (axes.left, axes.right));
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
                let axes = near(d, &change);
                // sum e^2 + 2 sum e = C:I - d, and the same from sums of products.
                let e = axes.changes;
                let trace: f64 = (0..d).map(|i| e[i] * e[i] + 2.0 * e[i]).sum();
                let straight: f64 = (0..d).map(|i| 2.0 * change[at(i, i)]).sum();
                let squares: f64 = change.iter().map(|h| h * h).sum();
                assert!((trace - (straight + squares)).abs() < 8e-15 * size, "{change:?}");
                let gradient = tensor(d, |i, j| change[at(i, j)] + if i == j { 1.0 } else { 0.0 });
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
            let axes = far(3, &gradient);
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
            let axes = far(3, &gradient);
            let found = errors(3, &tensor(3, |i, j| gradient[at(i, j)]), &axes);
            assert!(found[1] == 0.0, "{diagonal:?}: {found:?}");
        }
        assert!(far(3, &[f64::NAN; 9]).stretches[0].is_nan());
    }
}
