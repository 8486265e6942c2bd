//! Interactions that turn inside out: how many have, and which would first on the way to another
//! state.
//!
//! In `D` dimensions these are the cliques of `D + 1` points: triangles in the plane, tetrahedra in
//! space. Their measure is a determinant of `D` vectors from the owner.

use super::DiscreteEnergy;
use super::kind::Kind;
use super::visit::{minus, named, row};
use crate::energy::{Argument, Inversion, NonFinite};
use crate::interaction::{CliqueRoom, OwnerCliques, never_fails};

/// The places of the first zero are told apart down to this part of their distance.
const RESOLUTION: f64 = 0.01;

/// Zeros before this part of the way are not told apart: no step of that length is of use.
const NEAREST: f64 = 1.0 / 4096.0;

/// Where the members of an owner are, relative to it, at the start and at the end of a way.
#[derive(Default)]
pub(super) struct Motion<const D: usize> {
    from: Vec<[f64; D]>,
    to: Vec<[f64; D]>,
    /// Bounds of the lengths at the start, and of those on the way.
    near: Vec<f64>,
    reach: Vec<f64>,
}

impl<const D: usize> Motion<D> {
    fn set(&mut self, cliques: &OwnerCliques<'_, D>, start: &[f64], end: &[f64]) {
        let Motion { from, to, near, reach } = self;
        vectors(cliques, start, from);
        vectors(cliques, end, to);
        near.clear();
        near.extend(from.iter().map(size));
        reach.clear();
        let ways = from.iter().zip(&*to).map(|(from, to)| size(&minus(to, from)));
        reach.extend(near.iter().zip(ways).map(|(near, way)| near + way));
    }
}

/// How many of the cliques that a slab owns are turned inside out.
pub(super) fn count<const D: usize>(
    energy: &DiscreteEnergy,
    slab: usize,
    (cliques, Motion { from: now, .. }): (&mut CliqueRoom<D>, &mut Motion<D>),
    u: &[f64],
) -> u64 {
    let mut inverted = 0;
    never_fails(energy.for_each_owner::<D, D, _>(slab, cliques, |cliques| {
        vectors(cliques, u, now);
        cliques.each::<D, _>(|clique| {
            let members = clique.corners::<D>();
            let rest = members.map(|member| cliques.reference()[member]);
            let now = members.map(|member| now[member]);
            inverted += u64::from(determinant(&now) * determinant(&rest) < 0.0);
            Ok(())
        })
    }));
    inverted
}

/// The first clique of a slab to be turned inside out on the way from `start` to `end`.
pub(super) fn first<const D: usize>(
    energy: &DiscreteEnergy,
    kind: &Kind,
    slab: usize,
    (cliques, motion): (&mut CliqueRoom<D>, &mut Motion<D>),
    (start, end): (&[f64], &[f64]),
) -> Option<Inversion> {
    let mut first: Option<(f64, Vec<usize>)> = None;
    never_fails(energy.for_each_owner::<D, D, _>(slab, cliques, |cliques| {
        motion.set(cliques, start, end);
        let Motion { from, to, near, reach } = &*motion;
        cliques.each::<D, _>(|clique| {
            let members = clique.corners::<D>();
            let begin = members.map(|member| from[member]);
            // Short ways change a determinant by no more than this (Hadamard, term by term).
            let product = |sizes: &[f64]| members.iter().fold(1.0, |p, &member| p * sizes[member]);
            if determinant(&begin).abs() > product(reach) - product(near) {
                return Ok(());
            }
            let rest = members.map(|member| cliques.reference()[member]);
            let path = along(&begin, &members.map(|member| to[member]));
            let path = path.map(|x| x * determinant(&rest).signum());
            let limit = first.as_ref().map_or(1.0, |known| known.0);
            if let Some(part) = first_zero(&path[..=D], 0.0, 1.0).filter(|part| *part < limit) {
                let points = named(cliques, &members);
                if kind.forbids_inversion_of(&points) {
                    first = Some((part, points));
                }
            }
            Ok(())
        })
    }));
    let (part, points) = first?;
    let there = |point: usize| -> [f64; D] {
        let (start, end) = (row::<D>(start, point), row::<D>(end, point));
        std::array::from_fn(|axis| start[axis] + part * (end[axis] - start[axis]))
    };
    Some(Inversion { part, first: turned(energy, kind, points, there) })
}

/// The clique of these points at some displacements.
fn turned<const D: usize>(
    energy: &DiscreteEnergy,
    kind: &Kind,
    points: Vec<usize>,
    u: impl Fn(usize) -> [f64; D],
) -> NonFinite {
    let from_owner = |place: &dyn Fn(usize) -> [f64; D]| -> [[f64; D]; D] {
        std::array::from_fn(|corner| minus(&place(points[corner + 1]), &place(points[0])))
    };
    let at_rest = |point| row::<D>(energy.body.positions(), point);
    let (rest, eta) = (from_owner(&at_rest), from_owner(&u));
    let now: [[f64; D]; D] =
        std::array::from_fn(|c| std::array::from_fn(|axis| rest[c][axis] + eta[c][axis]));
    let reference = determinant(&rest);
    NonFinite {
        argument: Argument::Measure(kind.measure()),
        displacements: points.iter().flat_map(|&point| u(point)).collect(),
        value: determinant(&now) * reference.signum(),
        reference: reference.abs(),
        inverted: true,
        points,
    }
}

/// Vectors from the owner to its members at the displacements `u`.
fn vectors<const D: usize>(cliques: &OwnerCliques<'_, D>, u: &[f64], out: &mut Vec<[f64; D]>) {
    let own = row::<D>(u, cliques.owner());
    let members = cliques.members().iter().zip(cliques.reference());
    out.clear();
    out.extend(members.map(|(&member, rest)| -> [f64; D] {
        let eta = minus(&row(u, member as usize), &own);
        std::array::from_fn(|axis| rest[axis] + eta[axis])
    }));
}

/// A bound of the length of a vector.
fn size<const D: usize>(x: &[f64; D]) -> f64 {
    x.iter().fold(0.0, |sum, x| sum + x.abs())
}

fn determinant<const D: usize>(x: &[[f64; D]; D]) -> f64 {
    let minor = |p: usize, q: usize| x[1][p] * x[2][q] - x[1][q] * x[2][p];
    match D {
        2 => x[0][0] * x[1][1] - x[0][1] * x[1][0],
        _ => x[0][0] * minor(1, 2) + x[0][1] * minor(2, 0) + x[0][2] * minor(0, 1),
    }
}

/// The determinant on the straight way from `start` to `end`, as the coefficients of Bernstein's
/// polynomials of degree `D`: where they are positive, so is the determinant.
///
/// It is linear in each vector. So coefficient `k` is the mean over all choices of `k` vectors that
/// stand at their end while the others stand at their start.
fn along<const D: usize>(start: &[[f64; D]; D], end: &[[f64; D]; D]) -> [f64; 4] {
    let mut sums = [0.0; 4];
    let mut choices = [0.0; 4];
    for choice in 0..1usize << D {
        let chosen = std::array::from_fn(|c| if choice >> c & 1 == 1 { end[c] } else { start[c] });
        let k = choice.count_ones() as usize;
        sums[k] += determinant(&chosen);
        choices[k] += 1.0;
    }
    std::array::from_fn(|k| if choices[k] > 0.0 { sums[k] / choices[k] } else { 0.0 })
}

/// A place before the first zero in `from..to` and close to it, by halving; `None` where there is
/// none. A polynomial whose coefficients are all positive has no zero.
fn first_zero(coefficients: &[f64], from: f64, to: f64) -> Option<f64> {
    if coefficients.iter().all(|&b| b > 0.0) {
        return None;
    }
    let found = to - from <= RESOLUTION * from || to <= NEAREST;
    let starts_positive = coefficients.first().is_some_and(|&b| b > 0.0);
    if found || !starts_positive {
        return Some(from);
    }
    let middle = 0.5 * (from + to);
    let (left, right) = halves(coefficients);
    let n = coefficients.len();
    first_zero(&left[..n], from, middle).or_else(|| first_zero(&right[..n], middle, to))
}

/// The coefficients on either half of the interval (de Casteljau).
fn halves(coefficients: &[f64]) -> ([f64; 4], [f64; 4]) {
    let last = coefficients.len() - 1;
    let (mut left, mut right, mut work) = ([0.0; 4], [0.0; 4], [0.0; 4]);
    work[..=last].copy_from_slice(coefficients);
    for level in 0..=last {
        left[level] = work[0];
        right[last - level] = work[last - level];
        for k in 0..last - level {
            work[k] = 0.5 * (work[k] + work[k + 1]);
        }
    }
    (left, right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_followed_exactly() {
        // x1 = (1, t), x2 = (t, 1): 1 - t^2 on the way to t = 2 is 1 - 4 s^2.
        let path = along(&[[1.0, 0.0], [0.0, 1.0]], &[[1.0, 2.0], [2.0, 1.0]]);
        assert_eq!(path, [1.0, 1.0, -3.0, 0.0]);
        let zero = first_zero(&path[..=2], 0.0, 1.0).unwrap();
        assert!((0.495..=0.5).contains(&zero), "{zero}");
        // (1 - 3 s)(1 - 1.5 s)(1 - s/2): three factors on the diagonal.
        let diagonal = |x: f64, y: f64, z: f64| [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
        let path = along(&diagonal(1.0, 1.0, 1.0), &diagonal(-2.0, -0.5, 0.5));
        assert!(path[3] > 0.0, "it turns twice");
        let zero = first_zero(&path, 0.0, 1.0).unwrap();
        assert!((0.33..=1.0 / 3.0).contains(&zero), "{zero}");
        assert_eq!(
            first_zero(&along(&diagonal(1.0, 1.0, 1.0), &diagonal(0.1, 2.0, 9.0)), 0.0, 1.0),
            None
        );
    }

    #[test]
    fn a_state_at_or_beyond_the_turn_goes_nowhere() {
        assert_eq!(first_zero(&[0.0, 1.0, 1.0], 0.0, 1.0), Some(0.0));
        assert_eq!(first_zero(&[f64::NAN; 4], 0.0, 1.0), Some(0.0));
        assert_eq!(first_zero(&[1.0, -1e9, -1e9], 0.0, 1.0), Some(0.0));
    }
}
