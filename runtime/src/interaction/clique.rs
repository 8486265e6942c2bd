//! The cliques of one owner.

use std::convert::Infallible;

use super::Degeneracy;
use crate::body::Body;
use crate::neighborhood::Neighborhood;

/// The later neighbours of one point, who of them are neighbours of each other, and the triangles
/// and tetrahedra that follow.
///
/// Members are named by their place in the owner's row of later neighbours, ascending. One value
/// serves many owners in turn: [`OwnerCliques::set`] moves on to the next.
#[derive(Debug)]
pub struct OwnerCliques<'a, const D: usize> {
    body: &'a Body,
    neighborhood: &'a Neighborhood,
    degeneracy: Degeneracy,
    owner: usize,
    members: &'a [u32],
    /// Reference vectors from the owner to its members, in m.
    reference: Vec<[f64; D]>,
    /// Their squares.
    squares: Vec<f64>,
    /// Row `j` has a bit for each member `k > j` within the horizon of `j`, then a spare word.
    bits: Vec<u64>,
    /// 64-bit words of a row, without the spare.
    words: usize,
    /// Place of `k` in the row of later neighbours of `j`, at `j*columns + k`.
    place: Vec<u32>,
    /// Member number of a point (`point - first`); the first bit of the spare word for all others.
    member_of: Vec<u32>,
    first: usize,
}

impl<'a, const D: usize> OwnerCliques<'a, D> {
    /// For owners whose cliques stay within `points`.
    pub fn new(
        body: &'a Body,
        neighborhood: &'a Neighborhood,
        degeneracy: Degeneracy,
        points: std::ops::Range<usize>,
    ) -> Self {
        debug_assert_eq!(body.dimension(), D, "the dimension of the body");
        OwnerCliques {
            body,
            neighborhood,
            degeneracy,
            owner: points.start,
            members: &[],
            reference: Vec::new(),
            squares: Vec::new(),
            bits: Vec::new(),
            words: 0,
            place: Vec::new(),
            member_of: vec![0; points.len()],
            first: points.start,
        }
    }

    /// Moves to another owner.
    pub fn set(&mut self, owner: usize) {
        self.owner = owner;
        self.members = self.neighborhood.upper(owner);
        let here: [f64; D] = self.position(owner);
        self.reference.clear();
        for &member in self.members {
            let there = self.position(member as usize);
            self.reference.push(std::array::from_fn(|axis| there[axis] - here[axis]));
        }
        self.squares.clear();
        self.squares.extend(self.reference.iter().map(square));
        self.connect();
    }

    fn position(&self, point: usize) -> [f64; D] {
        let position = self.body.position(point);
        std::array::from_fn(|axis| position[axis])
    }

    /// Fills `bits` and `place`. Points that are no members land in the spare word: the loop needs
    /// no branch.
    fn connect(&mut self) {
        let n = self.members.len();
        if n != 0 && n.div_ceil(64) != self.words {
            self.words = n.div_ceil(64);
            self.member_of.fill(64 * self.words as u32);
        }
        let (stride, columns) = (self.words + 1, self.columns());
        self.bits.clear();
        self.bits.resize(n * stride, 0);
        self.place.resize(self.place.len().max(n * columns), 0);
        for (member, &point) in self.members.iter().enumerate() {
            self.member_of[point as usize - self.first] = member as u32;
        }
        let last = self.members.last().copied().unwrap_or(0);
        for (j, &point) in self.members.iter().enumerate() {
            let row = self.neighborhood.upper(point as usize);
            let row = &row[..row.partition_point(|&k| k <= last)];
            let bits = &mut self.bits[j * stride..(j + 1) * stride];
            let place = &mut self.place[j * columns..(j + 1) * columns];
            if let [only, _] = bits {
                // One word, as on lattices of up to three spacings, stays in a register.
                for (index, &k) in row.iter().enumerate() {
                    let member = self.member_of[k as usize - self.first];
                    *only |= u64::from(member < 64) << (member % 64);
                    place[member as usize] = index as u32;
                }
                continue;
            }
            for (index, &k) in row.iter().enumerate() {
                let member = self.member_of[k as usize - self.first] as usize;
                bits[member / 64] |= 1 << (member % 64);
                place[member] = index as u32;
            }
        }
        for &point in self.members {
            self.member_of[point as usize - self.first] = 64 * self.words as u32;
        }
    }

    fn columns(&self) -> usize {
        64 * self.words + 1
    }

    /// The owner: the lowest point of its cliques.
    pub fn owner(&self) -> usize {
        self.owner
    }

    /// Its later neighbours, ascending.
    pub fn members(&self) -> &'a [u32] {
        self.members
    }

    /// Reference vectors from the owner to the members, in m.
    pub fn reference(&self) -> &[[f64; D]] {
        &self.reference
    }

    /// Place of member `k` in the row of later neighbours of member `j < k`, for neighbours only.
    #[inline(always)]
    pub fn place(&self, j: usize, k: usize) -> usize {
        self.place[j * self.columns() + k] as usize
    }

    /// Visits pairs `j < k` of members that are neighbours, in lexicographic order.
    pub fn for_each_pair(&self, mut visit: impl FnMut(usize, usize)) {
        for j in 0..self.members.len() {
            for (word, &bits) in self.row(j).iter().enumerate() {
                for_each_bit(word, bits, |k| visit(j, k));
            }
        }
    }

    /// Visits each triangle of the owner once: members `j < k`, in lexicographic order. Stops at
    /// the visitor's first error; otherwise returns how many collinear ones were dropped.
    pub fn triangles<E>(
        &self,
        mut visit: impl FnMut(usize, usize) -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut dropped = 0;
        for j in 0..self.members.len() {
            for (word, &row) in self.row(j).iter().enumerate() {
                let mut bits = row;
                while bits != 0 {
                    let k = next_bit(word, &mut bits);
                    if self.is_collinear(j, k) {
                        dropped += 1;
                    } else {
                        visit(j, k)?;
                    }
                }
            }
        }
        Ok(dropped)
    }

    #[inline(always)]
    fn is_collinear(&self, j: usize, k: usize) -> bool {
        let (first, second) = (&self.reference[j], &self.reference[k]);
        let edge = self.squares[j].max(self.squares[k]);
        let area = square(&cross(first, second));
        // No edge is longer than twice the longest at the owner: most triangles pass here.
        self.degeneracy.is_collinear(area, 4.0 * edge)
            && self.degeneracy.is_collinear(area, edge.max(between(first, second)))
    }

    /// Visits each tetrahedron of the owner once: members `j < k < l`, in lexicographic order.
    /// Stops at the visitor's first error; otherwise returns how many coplanar ones were dropped.
    pub fn tetrahedra<E>(
        &self,
        mut visit: impl FnMut(usize, usize, usize) -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut dropped = 0;
        for j in 0..self.members.len() {
            for (word, &row) in self.row(j).iter().enumerate() {
                let mut bits = row;
                while bits != 0 {
                    let k = next_bit(word, &mut bits);
                    dropped += self.tetrahedra_on(j, k, &mut visit)?;
                }
            }
        }
        Ok(dropped)
    }

    /// The tetrahedra on one triangle.
    fn tetrahedra_on<E>(
        &self,
        j: usize,
        k: usize,
        visit: &mut impl FnMut(usize, usize, usize) -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut dropped = 0;
        let (first, second) = (&self.reference[j], &self.reference[k]);
        let normal = cross(first, second);
        let longest = self.squares[j].max(self.squares[k]);
        let base = longest.max(between(first, second));
        let (row_j, row_k) = (self.row(j), self.row(k));
        for word in 0..self.words {
            let mut bits = row_j[word] & row_k[word];
            while bits != 0 {
                let l = next_bit(word, &mut bits);
                let third = &self.reference[l];
                let height = (0..D).fold(0.0, |sum, axis| sum + normal[axis] * third[axis]);
                let volume = height * height;
                // No edge is longer than twice the longest at the owner: most pass here.
                let flat = self.degeneracy.is_coplanar(volume, 4.0 * longest.max(self.squares[l]))
                    && {
                        let edges = between(first, third).max(between(second, third));
                        let edge = base.max(self.squares[l]).max(edges);
                        self.degeneracy.is_coplanar(volume, edge)
                    };
                if flat {
                    dropped += 1;
                } else {
                    visit(j, k, l)?;
                }
            }
        }
        Ok(dropped)
    }

    fn row(&self, j: usize) -> &[u64] {
        &self.bits[j * (self.words + 1)..][..self.words]
    }
}

/// Turns the result of a visit that cannot fail into its number.
pub(crate) fn never_fails<T>(result: Result<T, Infallible>) -> T {
    match result {
        Ok(value) => value,
        Err(never) => match never {},
    }
}

#[inline(always)]
fn next_bit(word: usize, bits: &mut u64) -> usize {
    let bit = bits.trailing_zeros() as usize;
    *bits &= *bits - 1;
    word * 64 + bit
}

fn for_each_bit(word: usize, mut bits: u64, mut visit: impl FnMut(usize)) {
    while bits != 0 {
        visit(next_bit(word, &mut bits));
    }
}

#[inline(always)]
fn square<const D: usize>(p: &[f64; D]) -> f64 {
    let mut sum = p[0] * p[0];
    for axis in 1..D {
        sum += p[axis] * p[axis];
    }
    sum
}

/// Squared distance.
#[inline(always)]
fn between<const D: usize>(p: &[f64; D], q: &[f64; D]) -> f64 {
    square(&std::array::from_fn::<f64, D, _>(|axis| q[axis] - p[axis]))
}

/// Cross product; in the plane its only component is the third.
#[inline(always)]
fn cross<const D: usize>(p: &[f64; D], q: &[f64; D]) -> [f64; 3] {
    let third = p[0] * q[1] - p[1] * q[0];
    if D == 2 {
        [0.0, 0.0, third]
    } else {
        [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], third]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All cliques of all owners, by brute force over the neighbour graph.
    fn brute_force(neighborhood: &Neighborhood, size: usize) -> Vec<Vec<usize>> {
        let mut all: Vec<Vec<usize>> = (0..neighborhood.n_points()).map(|i| vec![i]).collect();
        for _ in 1..size {
            let mut longer = Vec::new();
            for clique in &all {
                let last = clique[clique.len() - 1];
                for next in last + 1..neighborhood.n_points() {
                    let near = |&p: &usize| neighborhood.row(p).contains(&(next as u32));
                    if clique.iter().all(near) {
                        longer.push([clique.as_slice(), &[next]].concat());
                    }
                }
            }
            all = longer;
        }
        all
    }

    fn scattered(n: usize) -> Body {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let positions: Vec<f64> = (0..3 * n).map(|_| next()).collect();
        Body::new(3, &positions, &vec![1.0; n], None)
    }

    #[test]
    fn every_clique_is_visited_once_and_in_order() {
        // The second horizon has more than 64 later neighbours: several words.
        for (n, horizon) in [(60, 0.45), (150, 0.9)] {
            let body = scattered(n);
            let neighborhood = Neighborhood::new(&body, horizon).unwrap();
            let mut cliques =
                OwnerCliques::<3>::new(&body, &neighborhood, Degeneracy::new(&body), 0..n);
            let (mut triangles, mut tetrahedra) = (Vec::new(), Vec::new());
            for owner in 0..n {
                cliques.set(owner);
                let point = |member: usize| cliques.members()[member] as usize;
                never_fails(cliques.triangles(|j, k| {
                    triangles.push(vec![owner, point(j), point(k)]);
                    let place = cliques.place(j, k);
                    assert_eq!(neighborhood.upper(point(j))[place] as usize, point(k));
                    Ok(())
                }));
                if n < 100 {
                    never_fails(cliques.tetrahedra(|j, k, l| {
                        tetrahedra.push(vec![owner, point(j), point(k), point(l)]);
                        Ok(())
                    }));
                }
            }
            assert!(triangles == brute_force(&neighborhood, 3), "{} triangles", triangles.len());
            if n < 100 {
                assert!(!tetrahedra.is_empty());
                assert!(tetrahedra == brute_force(&neighborhood, 4), "{}", tetrahedra.len());
            }
        }
    }

    #[test]
    fn a_visitor_can_stop() {
        let body = scattered(40);
        let neighborhood = Neighborhood::new(&body, 0.6).unwrap();
        let mut cliques =
            OwnerCliques::<3>::new(&body, &neighborhood, Degeneracy::new(&body), 0..40);
        cliques.set(0);
        let mut visits = 0;
        let result = cliques.triangles(|_, _| {
            visits += 1;
            if visits == 3 { Err("enough") } else { Ok(()) }
        });
        assert_eq!((result, visits), (Err("enough"), 3));
    }
}
