//! Bodies that are turned further than they are strained.
//!
//! `F - I` of such a body has the size of the angle, and terms of that size cancel until an energy of the size of the
//! strain squared is left: of psi at a strain of 1e-8 nothing is. An energy that sees no rotation is the same for
//! `R'*F` with any rotation `R`. One near that of the body leaves `R'*F - I` as small as the strain, and
//! `P(F) = R*P(R'*F)`. What F knows of the strain is kept, and no more. Products dP are as exact without
//! this, and more so, because a direction that is turned is rounded, but for roots of what is 0 at rest.
//!
//! Before: places of a block, as they are given. After: the same, those turned back that gain by it.

use pulp::{Arch, Simd, WithSimd};

use super::MOST;
use super::kernel::{BLOCK, GradientBatch, NEAR, WrittenGradientEnergy};
use crate::expression::Operator;
use crate::expression::number::Number;
use crate::expression::precise::Precise;

/// Largest strain of a body that is turned back, the sum of the sizes of E = (C - I)/2: what is left of `F - I`
/// is then below [`NEAR`].
const STRAINED: f64 = NEAR / 4.0;

/// How many times the strain the sum of the sizes of `F - I` has to be: below that, psi loses fewer digits than F
/// has of the strain, but for some.
const FURTHER: f64 = 32.0;

/// Places that are turned in the same steps.
const LANES: usize = 8;

/// A component of all places of a block.
type Component = [f64; BLOCK];

/// The components of a block, row by row.
type Tensors = [Component; MOST];

/// Places of a block of which some are turned back.
pub(super) struct TurnedBack {
    dimension: usize,
    /// Where the form near rest is evaluated.
    reach: f64,
    n: usize,
    marked: [bool; BLOCK],
    /// `F - I` as it was.
    given: Tensors,
    rotations: Tensors,
    gradient: Tensors,
    change: Tensors,
    direction: Tensors,
}

/// Marks the places of a block, from `start` on, that are turned further than they are strained; whether there is one.
pub(super) fn mark(
    dimension: usize,
    at: GradientBatch<'_>,
    start: usize,
    marks: &mut [bool],
) -> bool {
    let (mut room, count) = ([&[][..]; MOST], dimension * dimension);
    for (k, component) in room.iter_mut().enumerate().take(count) {
        *component = &at.change[k * at.n + start..][..marks.len()];
    }
    Arch::new().dispatch(Find { dimension, change: &room[..count], marks })
}

impl TurnedBack {
    /// Room for blocks, which [`TurnedBack::take`] fills.
    pub(super) fn new(dimension: usize, reach: f64) -> TurnedBack {
        let [given, rotations, gradient, change, direction] = [[[0.0; BLOCK]; MOST]; 5];
        let (n, marked) = (0, [false; BLOCK]);
        TurnedBack { dimension, reach, n, marked, given, rotations, gradient, change, direction }
    }

    /// Takes the places of a block, from `start` on, with a direction or without, and turns those back that are marked.
    #[inline(never)]
    pub(super) fn take(
        &mut self,
        at: GradientBatch<'_>,
        start: usize,
        marked: &[bool],
        direction: &[f64],
    ) {
        self.n = marked.len();
        self.marked[..self.n].copy_from_slice(marked);
        for k in 0..self.dimension * self.dimension {
            let first = k * at.n + start;
            let [change, gradient] =
                [at.change, at.gradient].map(|array| &array[first..first + marked.len()]);
            self.given[k][..self.n].copy_from_slice(change);
            self.change[k][..self.n].copy_from_slice(change);
            self.gradient[k][..self.n].copy_from_slice(gradient);
            if !direction.is_empty() {
                self.direction[k][..self.n]
                    .copy_from_slice(&direction[first..first + marked.len()]);
            }
        }
        Arch::new().dispatch(Back(self));
        if self.dimension == 3 {
            for p in (0..self.n).filter(|p| marked[*p]) {
                let h: [f64; MOST] = std::array::from_fn(|k| self.given[k][p]);
                // Beyond a third of a turn.
                if h[0] + h[4] + h[8] < -3.0 {
                    self.turn_back::<1>(p, 3, |of| rotation_of(of, largest_part(&h)));
                }
            }
        }
        self.leave_mirrors(at, start);
        if !direction.is_empty() {
            self.turn_direction();
        }
    }

    /// Leaves places as they were that no rotation brings near rest: a body that is turned inside out may have no
    /// strain.
    fn leave_mirrors(&mut self, at: GradientBatch<'_>, start: usize) {
        let n_components = self.dimension * self.dimension;
        for p in 0..self.n {
            if !self.marked[p] || (0..n_components).all(|k| self.change[k][p].abs() < self.reach) {
                continue;
            }
            self.marked[p] = false;
            for k in 0..n_components {
                self.change[k][p] = self.given[k][p];
                self.gradient[k][p] = at.gradient[k * at.n + start + p];
            }
        }
    }

    /// Which places are turned back.
    pub(super) fn marked(&self) -> &[bool] {
        &self.marked[..self.n]
    }

    /// `F`, then `F - I`, then the direction if there is one.
    pub(super) fn components(&self, has_direction: bool) -> impl Iterator<Item = &[f64]> {
        let n_components = self.dimension * self.dimension;
        let given = [&self.gradient, &self.change, &self.direction].into_iter();
        let given = given.take(if has_direction { 3 } else { 2 });
        given.flat_map(move |tensor| tensor[..n_components].iter().map(|array| &array[..self.n]))
    }

    /// A stress, or what it changes by, turned as the body is.
    pub(super) fn turn(&self, stress: &mut [&mut [f64]]) {
        let TurnedBack { dimension, marked, rotations, .. } = self;
        Arch::new().dispatch(Turn { d: *dimension, is_back: false, marked, rotations, stress });
    }

    /// A direction, turned back.
    fn turn_direction(&mut self) {
        let TurnedBack { dimension: d, n, marked, rotations, direction, .. } = self;
        let mut arrays: [&mut [f64]; MOST] = Default::default();
        for (array, component) in arrays.iter_mut().zip(direction) {
            *array = &mut component[..*n];
        }
        let stress = &mut arrays[..*d * *d];
        Arch::new().dispatch(Turn { d: *d, is_back: true, marked, rotations, stress });
    }
}

/// Finds places that are turned further than they are strained.
struct Find<'a> {
    dimension: usize,
    change: &'a [&'a [f64]],
    marks: &'a mut [bool],
}

impl WithSimd for Find<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        let (d, n) = (self.dimension, self.marks.len());
        let mut room = [[0.0; BLOCK]; 3];
        let [size, strain, twice] = room.each_mut().map(|array| &mut array[..n]);
        for component in self.change {
            add(size, component, |h| h.abs());
        }
        // The diagonal of E first: it is enough to see of most places that they are not.
        for distance in 0..d {
            for i in 0..d - distance {
                let j = i + distance;
                twice.copy_from_slice(self.change[i * d + j]);
                add(twice, self.change[j * d + i], |h| h);
                for k in 0..d {
                    let both = self.change[k * d + i].iter().zip(self.change[k * d + j]);
                    for (twice, (x, y)) in twice.iter_mut().zip(both) {
                        *twice += x * y;
                    }
                }
                add(strain, twice, |twice| 0.5 * twice.abs());
            }
            let mut some = 0;
            for ((mark, strain), size) in self.marks.iter_mut().zip(&*strain).zip(&*size) {
                *mark = (*strain < STRAINED) & (*size > FURTHER * *strain);
                some += u32::from(*mark);
            }
            if some == 0 {
                return false;
            }
        }
        true
    }
}

/// Adds a function of each entry.
#[inline(always)]
fn add(sum: &mut [f64], of: &[f64], function: impl Fn(f64) -> f64) {
    for (sum, x) in sum.iter_mut().zip(of) {
        *sum += function(*x);
    }
}

/// Turns the places of a block back that are marked.
struct Back<'a>(&'a mut TurnedBack);

impl WithSimd for Back<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for first in (0..BLOCK).step_by(LANES) {
            match self.0.dimension {
                #[expect(
                    clippy::redundant_closure,
                    reason = "handed on itself it stays a function"
                )]
                2 => self.0.turn_back::<LANES>(first, 2, |h| rotation_in_the_plane(h)),
                _ => self.0.turn_back::<LANES>(first, 3, |h| rotation_of(h, 3)),
            }
        }
    }
}

/// A tensor of places beside each other, row by row.
type Lanes<const N: usize> = [[f64; N]; MOST];

/// The same for each of the places. A loop: the closures of `array::from_fn` stay functions of their own, which know
/// nothing of the registers of the machine.
#[inline(always)]
fn each<const N: usize>(of: impl Fn(usize) -> f64) -> [f64; N] {
    let mut all = [0.0; N];
    for p in 0..N {
        all[p] = of(p);
    }
    all
}

impl TurnedBack {
    /// The rotations of places beside each other, and `F` and `F - I` without them where they are marked.
    #[inline(always)]
    fn turn_back<const N: usize>(
        &mut self,
        first: usize,
        d: usize,
        rotation: impl Fn(&Lanes<N>) -> Lanes<N>,
    ) {
        let mut h = [[0.0; N]; MOST];
        for k in 0..MOST {
            h[k] = each(|p| self.given[k][first + p]);
        }
        // R - I and what H is more than that.
        let beyond = rotation(&h);
        let mut rest = h;
        for k in 0..MOST {
            rest[k] = each(|p| h[k][p] - beyond[k][p]);
        }
        let marked: [bool; N] = std::array::from_fn(|p| self.marked[first + p]);
        for i in 0..d {
            for j in 0..d {
                let (k, unit) = (i * d + j, f64::from(u8::from(i == j)));
                let mut back = rest[k];
                for m in 0..d {
                    back = each(|p| back[p] + beyond[m * d + i][p] * rest[m * d + j][p]);
                }
                for p in 0..N {
                    self.rotations[k][first + p] = unit + beyond[k][p];
                    if marked[p] {
                        self.change[k][first + p] = back[p];
                        self.gradient[k][first + p] = unit + back[p];
                    }
                }
            }
        }
    }
}

/// Multiplies tensors by rotations from the left, or by their transposes, where they are marked.
struct Turn<'a, 'b> {
    d: usize,
    is_back: bool,
    marked: &'a [bool],
    rotations: &'a Tensors,
    stress: &'a mut [&'b mut [f64]],
}

impl WithSimd for Turn<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Turn { d, is_back, marked, rotations, stress } = self;
        for j in 0..d {
            let mut columns = [[0.0; BLOCK]; 3];
            for i in 0..d {
                for k in 0..d {
                    let rotation = &rotations[if is_back { k * d + i } else { i * d + k }];
                    let terms = rotation.iter().zip(&*stress[k * d + j]);
                    for (sum, (rotation, of)) in columns[i].iter_mut().zip(terms) {
                        *sum += rotation * of;
                    }
                }
            }
            for (i, column) in columns.iter().enumerate().take(d) {
                let turned = column.iter().zip(marked);
                for (stress, (turned, mark)) in stress[i * d + j].iter_mut().zip(turned) {
                    *stress = if *mark { *turned } else { *stress };
                }
            }
        }
    }
}

/// `R - I` of the rotation that is nearest to `I + H`.
#[inline(always)]
fn rotation_in_the_plane<const N: usize>(h: &Lanes<N>) -> Lanes<N> {
    let cosine: [f64; N] = each(|p| 2.0 + h[0][p] + h[3][p]);
    let sine: [f64; N] = each(|p| h[2][p] - h[1][p]);
    let length: [f64; N] = each(|p| (cosine[p] * cosine[p] + sine[p] * sine[p]).sqrt());
    let s: [f64; N] = each(|p| sine[p] / length[p]);
    let c: [f64; N] = each(|p| {
        let near = -s[p] * (sine[p] / (length[p] + cosine[p]));
        if cosine[p] > 0.0 { near } else { cosine[p] / length[p] - 1.0 }
    });
    let mut rotation = [[0.0; N]; MOST];
    (rotation[0], rotation[1], rotation[2], rotation[3]) = (c, each(|p| -s[p]), s, c);
    rotation
}

/// Of the quaternion that a rotation near `I + H` has, the largest part: 3 for the real one.
fn largest_part(h: &[f64; MOST]) -> usize {
    let trace = h[0] + h[4] + h[8];
    let size = |k: usize| if k == 3 { 3.0 + trace } else { 1.0 + h[4 * k] };
    (0..3).fold(3, |best, k| if size(k) > size(best) { k } else { best })
}

/// `R - I` of a rotation near `I + H`: that of the quaternion which a rotation has, found by one of its parts
/// (Shepperd 1978, J. Guidance and Control 1, 223). It is of any length; each quaternion is one of a rotation.
#[inline(always)]
fn rotation_of<const N: usize>(h: &Lanes<N>, largest: usize) -> Lanes<N> {
    let trace: [f64; N] = each(|p| h[0][p] + h[4][p] + h[8][p]);
    let skew = |k: usize, l: usize| -> [f64; N] { each(|p| h[k][p] - h[l][p]) };
    let plus = |k: usize, l: usize| -> [f64; N] { each(|p| h[k][p] + h[l][p]) };
    let along = |k: usize| -> [f64; N] { each(|p| 2.0 * h[k][p] - trace[p]) };
    let real = || -> [f64; N] { each(|p| 4.0 + trace[p]) };
    let [w, x, y, z] = match largest {
        3 => [real(), skew(7, 5), skew(2, 6), skew(3, 1)],
        0 => [skew(7, 5), along(0), plus(1, 3), plus(2, 6)],
        1 => [skew(2, 6), plus(1, 3), along(4), plus(5, 7)],
        _ => [skew(3, 1), plus(2, 6), plus(5, 7), along(8)],
    };
    let square: [f64; N] = each(|p| w[p] * w[p] + x[p] * x[p] + y[p] * y[p] + z[p] * z[p]);
    let by: [f64; N] = each(|p| 2.0 / square[p]);
    // -(a^2 + b^2) on the diagonal, a b - w c and a b + w c beside it.
    let on = |a: &[f64; N], b: &[f64; N]| each(|p| -by[p] * (a[p] * a[p] + b[p] * b[p]));
    let beside = |a: &[f64; N], b: &[f64; N], c: &[f64; N], sign: f64| {
        each(|p| by[p] * (a[p] * b[p] + sign * w[p] * c[p]))
    };
    [
        on(&y, &z),
        beside(&x, &y, &z, -1.0),
        beside(&x, &z, &y, 1.0),
        beside(&x, &y, &z, 1.0),
        on(&x, &z),
        beside(&y, &z, &x, -1.0),
        beside(&x, &z, &y, -1.0),
        beside(&y, &z, &x, 1.0),
        on(&x, &y),
    ]
}

/// Quaternions of rotations with which an energy is tried: by little, by about a right angle, by nearly half a turn.
const TRIED: [[f64; 4]; 3] =
    [[8.0, 1.0, -2.0, 1.5], [2.0, 1.0, 0.5, -1.5], [0.125, -2.0, 1.0, 3.0]];

/// `F - I` at which it is tried, row by row.
const STRAINS: [[f64; 9]; 2] = [
    [0.0625, 0.03125, -0.0234375, 0.015625, -0.046875, 0.0546875, -0.0078125, 0.0390625, 0.078125],
    [
        -0.0546875, -0.015625, 0.0390625, 0.046875, 0.0703125, -0.03125, 0.0234375, -0.0078125,
        -0.0625,
    ],
];

/// Shares of an energy below this are what 256 bits leave of nothing.
const NOTHING: f64 = 1e-40;

type Exact = Precise<256>;
type Tensor = [[Exact; 3]; 3];

/// Whether an energy sees no rotation: it has the same value, to nearly all of 256 bits, for some bodies that are
/// turned in several ways.
pub(super) fn is_blind(written: &WrittenGradientEnergy, d: usize) -> bool {
    let psi =
        |tensor: &Tensor| written.psi(|c| tensor[usize::from(c) / 3][usize::from(c) % 3].clone());
    STRAINS.iter().all(|h| {
        let entry = |i: usize, j: usize| {
            let more = if i < d && j < d { h[3 * i + j] } else { 0.0 };
            Exact::constant(f64::from(u8::from(i == j)) + more)
        };
        let body: Tensor = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
        let expected = psi(&body);
        TRIED.iter().all(|[w, x, y, z]| {
            let about = if d == 2 { [*w, 0.0, 0.0, *z] } else { [*w, *x, *y, *z] };
            let found = psi(&product(&rotation(about), &body));
            let difference =
                Exact::binary(Operator::Subtract, expected.clone(), found).rounded()[0];
            difference.abs() <= NOTHING * expected.rounded()[0].abs()
        })
    })
}

/// The rotation of a quaternion of any length.
fn rotation([w, x, y, z]: [f64; 4]) -> Tensor {
    let square = w * w + x * x + y * y + z * z;
    let times_square = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ];
    let over =
        |x: f64| Exact::binary(Operator::Divide, Exact::constant(x), Exact::constant(square));
    times_square.map(|row| row.map(over))
}

fn product(x: &Tensor, y: &Tensor) -> Tensor {
    let term = |i: usize, k: usize, j: usize| {
        Exact::binary(Operator::Multiply, x[i][k].clone(), y[k][j].clone())
    };
    let entry = |i: usize, j: usize| {
        let first = Exact::binary(Operator::Add, term(i, 0, j), term(i, 1, j));
        Exact::binary(Operator::Add, first, term(i, 2, j))
    };
    std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{model, values};

    fn sees_no_rotation(psi: &str, d: usize) -> bool {
        let model = model(&format!("potential p\npsi(F) = {psi}"));
        is_blind(&model.written_gradient(&values(&model, d, &[])), d)
    }

    #[test]
    fn energies_of_the_stretch_alone_see_no_rotation() {
        for psi in ["tr(C) - 3 - 2*ln(J)", "ln(U) : ln(U)", "max(C(1, 1) - 1, 0)^2", "(J - 1)^2"] {
            assert!(sees_no_rotation(psi, 2) && sees_no_rotation(psi, 3), "{psi}");
        }
        for psi in ["(F - I) : (F - I)", "tr(C) - 3 + (F(1, 1) - 1)^2", "tr(F)"] {
            assert!(!sees_no_rotation(psi, 2) && !sees_no_rotation(psi, 3), "{psi}");
        }
    }

    /// Of rotations by all angles about many axes, those by half a turn among them.
    #[test]
    fn rotations_are_orthogonal_and_near_the_body() {
        let mut random = crate::verify::sample::Random::new(0x726f_7461);
        for k in 0..2000 {
            let [w, x, y, z] = std::array::from_fn(|_| random.uniform(-1.0, 1.0));
            let about = if k % 4 == 0 { [0.0, x, y, z] } else { [w, x, y, z] };
            let exact = rotation(about).map(|row| row.map(|entry| entry.rounded()[0]));
            let stretched = |i: usize, j: usize| {
                exact[i][j] * (1.0 + 0.03 * (j as f64 - 1.0)) - f64::from(u8::from(i == j))
            };
            let h: [f64; MOST] = std::array::from_fn(|k| stretched(k / 3, k % 3));
            let found = rotation_of(&h.map(|x| [x]), largest_part(&h));
            let r = |i: usize, j: usize| f64::from(u8::from(i == j)) + found[3 * i + j][0];
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| r(k, i) * r(k, j)).sum();
                    let unit = f64::from(u8::from(i == j));
                    assert!((dot - unit).abs() < 8.0 * f64::EPSILON, "{about:?}: {dot}");
                    assert!((r(i, j) - exact[i][j]).abs() < 0.1, "{about:?}: {found:?}");
                }
            }
            let angle = random.uniform(-3.2, 3.2);
            let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
            let mut h = [[0.0]; MOST];
            h[..4].copy_from_slice(
                &[1.02 * cosine - 1.0, -0.98 * sine, 1.02 * sine, 0.98 * cosine - 1.0].map(|x| [x]),
            );
            let [[c], [minus], [s], [same], ..] = rotation_in_the_plane(&h);
            assert!(c == same && minus == -s);
            assert!(((1.0 + c) * (1.0 + c) + s * s - 1.0).abs() < 4.0 * f64::EPSILON);
            assert!((1.0 + c - cosine).abs() < 0.05 && (s - sine).abs() < 0.05, "{angle}");
        }
    }
}
