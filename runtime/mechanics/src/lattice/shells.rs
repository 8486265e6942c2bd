//! The cliques of an endless lattice by their measure: counted in integers, so exactly.
//!
//! Every clique is counted from its longest edges. From both of their ends these run along all
//! vectors of the lattice, of which one in each orbit of its point group is enough: one in 48 in
//! space, one in 8 in the plane. What lies around an edge that is a longest one lies in the lens of
//! two balls, which leaves few corners to try.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::kernel::Measure;

/// The cliques of one measure per point of the lattice, each once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shell {
    /// Length, area measure or volume measure, in spacings.
    pub measure: f64,
    /// How many they are.
    pub count: u64,
    /// Mean of `n_x^4 + n_y^4 + n_z^4` with the unit vector `n` along bonds, normal to triangles in
    /// space. Of measures that a linear map multiplies by its determinant: 0.
    pub fourth: f64,
}

/// All cliques of a kind, with the whole horizon `ratio*spacing`: ascending, without collinear
/// triangles and coplanar tetrahedra.
pub fn shells(dimension: usize, ratio: f64, measure: Measure) -> Vec<Shell> {
    let orbits = orbits(dimension, reach(ratio));
    let (tallies, parts) = match measure {
        Measure::Length => (tally(&orbits, Orbit::bonds), 2),
        Measure::Area => (tally(&orbits, |orbit, to| orbit.triangles(dimension, to)), 12),
        Measure::Volume if dimension == 2 => (Tallies::new(), 120),
        Measure::Volume => (tally(&orbits, Orbit::tetrahedra), 120),
    };
    let is_root = !measure.is_signed(dimension);
    let shell = |(key, tally): (u64, Tally)| {
        let size = key as f64;
        Shell {
            measure: if is_root { size.sqrt() } else { size },
            count: tally.parts / parts,
            fourth: tally.fourth as f64 / (tally.parts as f64 * size * size),
        }
    };
    tallies.into_iter().map(shell).collect()
}

/// Largest squared distance of neighbours, in spacings.
fn reach(ratio: f64) -> i64 {
    let radius = ratio * (1.0 + crate::neighborhood::HORIZON_TOLERANCE);
    (radius * radius).floor() as i64
}

/// Cliques with one measure, in parts: an edge that is one of `e` longest ones counts as a whole
/// number of parts for every `e`, and each edge counts from both ends.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    parts: u64,
    /// Fourth powers of the components of what `Shell::fourth` is the mean of, per part.
    fourth: u128,
}

/// By the measure where a linear map multiplies it by its determinant, else by its square.
type Tallies = BTreeMap<u64, Tally>;

fn add(tallies: &mut Tallies, key: i64, parts: u64, fourth: u128) {
    let tally = tallies.entry(key.unsigned_abs()).or_default();
    tally.parts += parts;
    tally.fourth += fourth;
}

/// Integers add up to the same in any order.
fn tally(orbits: &[Orbit], count: impl Fn(&Orbit, &mut Tallies) + Sync) -> Tallies {
    let one_more = |mut tallies: Tallies, orbit: &Orbit| {
        count(orbit, &mut tallies);
        tallies
    };
    let join = |mut tallies: Tallies, others: Tallies| {
        for (key, tally) in others {
            let sum = tallies.entry(key).or_default();
            sum.parts += tally.parts;
            sum.fourth += tally.fourth;
        }
        tallies
    };
    orbits.par_iter().fold(Tallies::new, one_more).reduce(Tallies::new, join)
}

type Vector = [i64; 3];

/// A vector of the lattice and how many its images under the point group are.
struct Orbit {
    vector: Vector,
    square: i64,
    size: u64,
}

/// A corner that may complete a clique on a longest edge.
struct Corner {
    place: Vector,
    /// Squared distances from the ends.
    square: i64,
    other: i64,
    /// How many of its edges to the ends are as long.
    ties: usize,
}

/// One vector with `x >= y >= z >= 0` for each orbit, in the plane `z = 0`.
fn orbits(dimension: usize, reach: i64) -> Vec<Orbit> {
    let most = reach.isqrt();
    let mut orbits = Vec::new();
    for x in 1..=most {
        for y in 0..=x {
            for z in 0..=if dimension == 3 { y } else { 0 } {
                let vector = [x, y, z];
                let square = dot(vector, vector);
                if square <= reach {
                    orbits.push(Orbit { vector, square, size: images(&vector[..dimension]) });
                }
            }
        }
    }
    orbits
}

/// How many vectors signs and exchanges make of one.
fn images(components: &[i64]) -> u64 {
    let signs: u64 = components.iter().map(|x| if *x == 0 { 1 } else { 2 }).product();
    let equal = components.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let orders = match (components.len(), equal) {
        (_, 0) => [1, 1, 2, 6][components.len()],
        (3, 1) => 3,
        _ => 1,
    };
    signs * orders
}

impl Orbit {
    fn bonds(&self, tallies: &mut Tallies) {
        add(tallies, self.square, self.size, u128::from(self.size) * fourth(self.vector));
    }

    /// Triangles of which the vector is a longest edge: its ends and a corner of the lens.
    fn triangles(&self, dimension: usize, tallies: &mut Tallies) {
        for corner in self.lens(dimension) {
            let normal = cross(self.vector, corner.place);
            let parts = self.size * 6 / (1 + corner.ties as u64);
            if dimension == 2 {
                add(tallies, normal[2], parts, 0);
            } else {
                add(tallies, dot(normal, normal), parts, u128::from(parts) * fourth(normal));
            }
        }
    }

    /// Tetrahedra of which the vector p is a longest edge: its ends and two corners q, r of the lens.
    ///
    /// The lens turns into itself by `q -> p - q`: q and r are taken from one half of it, and with
    /// them `p - r`, which spans the same volume with p and q.
    fn tetrahedra(&self, tallies: &mut Tallies) {
        let p = self.vector;
        let mut half = self.lens(3);
        half.retain(|q| q.place < [0, 1, 2].map(|axis| p[axis] - q.place[axis]));
        // No volume is larger than the product of the edges.
        let most = u128::from(self.square.unsigned_abs()).pow(3).isqrt() as usize + 1;
        let mut found = vec![0u64; 6 * most];
        for (index, q) in half.iter().enumerate() {
            let (normal, along) = (cross(p, q.place), dot(p, q.place));
            for r in &half[index + 1..] {
                let volume = dot(normal, r.place).unsigned_abs() as usize;
                let inner = dot(q.place, r.place);
                let distances =
                    [q.square + r.square - 2 * inner, q.square + r.other - 2 * (along - inner)];
                for distance in distances {
                    if distance <= self.square {
                        let ties = q.ties + r.ties + usize::from(distance == self.square);
                        found[ties * most + volume] += 2;
                    }
                }
            }
        }
        for (place, found) in found.into_iter().enumerate().filter(|(_, found)| *found > 0) {
            let (ties, volume) = (place / most, place % most);
            if volume > 0 {
                add(tallies, volume as i64, self.size * 60 / (1 + ties as u64) * found, 0);
            }
        }
    }

    /// Points at which no edge to the ends of the vector is longer than the vector; not those in line
    /// with it.
    fn lens(&self, dimension: usize) -> Vec<Corner> {
        let most = self.square.isqrt();
        let depth = if dimension == 3 { most } else { 0 };
        let mut lens = Vec::new();
        for x in -most..=most {
            for y in -most..=most {
                for z in -depth..=depth {
                    let place = [x, y, z];
                    let square = dot(place, place);
                    let other = square + self.square - 2 * dot(place, self.vector);
                    let is_near = square <= self.square && other <= self.square;
                    if is_near && cross(self.vector, place) != [0; 3] {
                        let ties =
                            usize::from(square == self.square) + usize::from(other == self.square);
                        lens.push(Corner { place, square, other, ties });
                    }
                }
            }
        }
        lens
    }
}

fn fourth(p: Vector) -> u128 {
    p.iter().map(|x| u128::from(x.unsigned_abs()).pow(4)).sum()
}

fn dot(p: Vector, q: Vector) -> i64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

fn cross(p: Vector, q: Vector) -> Vector {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::SQRT_2;

    use super::*;

    /// Points of the ball around the origin that come after it in lexicographic order: with it, each
    /// clique has one translate among them that holds the origin as its first point.
    fn later(dimension: usize, reach: i64) -> Vec<Vector> {
        let most = reach.isqrt();
        let depth = if dimension == 3 { most } else { 0 };
        let line = -most..=most;
        let plane = line.clone().flat_map(|x| line.clone().map(move |y| (x, y)));
        let all = plane.flat_map(|(x, y)| (-depth..=depth).map(move |z| [x, y, z]));
        all.filter(|p| *p > [0; 3] && dot(*p, *p) <= reach).collect()
    }

    fn near(p: Vector, q: Vector, reach: i64) -> bool {
        let between = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
        dot(between, between) <= reach
    }

    /// Count and sum of fourth powers by key, one clique after the other.
    fn one_by_one(dimension: usize, reach: i64, measure: Measure) -> BTreeMap<u64, (u64, u128)> {
        let mut found = BTreeMap::new();
        let mut add = |key: i64, fourth: u128| {
            let entry: &mut (u64, u128) = found.entry(key.unsigned_abs()).or_default();
            *entry = (entry.0 + 1, entry.1 + fourth);
        };
        let points = later(dimension, reach);
        for (i, &p) in points.iter().enumerate() {
            if measure == Measure::Length {
                add(dot(p, p), fourth(p));
                continue;
            }
            let rest: Vec<Vector> =
                points[i + 1..].iter().copied().filter(|q| near(p, *q, reach)).collect();
            for (j, &q) in rest.iter().enumerate() {
                let normal = cross(p, q);
                match measure {
                    Measure::Area if normal == [0; 3] => {}
                    Measure::Area if dimension == 2 => add(normal[2], 0),
                    Measure::Area => add(dot(normal, normal), fourth(normal)),
                    _ => {
                        let corners = rest[j + 1..].iter().filter(|r| near(q, **r, reach));
                        let volumes = corners.map(|r| dot(normal, *r)).filter(|v| *v != 0);
                        volumes.for_each(|volume| add(volume, 0));
                    }
                }
            }
        }
        found
    }

    #[test]
    fn shells_are_those_of_all_cliques_one_by_one() {
        use Measure::{Area, Length, Volume};
        let cases: [(usize, Measure, &[f64]); 5] = [
            (2, Length, &[1.0, SQRT_2, 3.0, 7.3, 32.0]),
            (3, Length, &[1.0, SQRT_2, 3.0, 4.5, 12.0]),
            (2, Area, &[1.0, SQRT_2, 2.0, 3.015, 9.0, 17.2]),
            (3, Area, &[1.0, SQRT_2, 2.0, 3.0, 5.5]),
            (3, Volume, &[1.0, SQRT_2, 3f64.sqrt(), 2.0, 3.0, 3.7]),
        ];
        for (dimension, measure, ratios) in cases {
            for &ratio in ratios {
                let expected = one_by_one(dimension, reach(ratio), measure);
                let found = shells(dimension, ratio, measure);
                assert_eq!(found.len(), expected.len(), "{dimension} {measure:?} {ratio}");
                for (shell, (key, (count, sum))) in found.iter().zip(&expected) {
                    let root = !measure.is_signed(dimension);
                    let size = if root { (*key as f64).sqrt() } else { *key as f64 };
                    assert_eq!((shell.measure, shell.count), (size, *count));
                    let key = u128::from(*key);
                    let mean = *sum as f64 / (u128::from(*count) * key * key) as f64;
                    // Three roundings here and there.
                    assert!((shell.fourth - mean).abs() <= 6.0 * f64::EPSILON * mean);
                }
            }
        }
    }

    #[test]
    fn orbits_make_up_the_ball() {
        for (dimension, ratio) in [(2, 1.0), (2, 12.5), (3, 1.0), (3, 7.1)] {
            let total: u64 = orbits(dimension, reach(ratio)).iter().map(|o| o.size).sum();
            assert_eq!(total, 2 * later(dimension, reach(ratio)).len() as u64);
        }
    }
}
