//! The cliques of one owner.

mod lost;

pub use lost::{Bits, Lost, Ranks};

use std::convert::Infallible;

use rayon::prelude::*;

use super::{Degeneracy, Slabs};
use crate::body::Body;
use crate::neighborhood::Neighborhood;

/// A clique of an owner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clique {
    /// Its other points, as members of the owner, ascending; 0 beyond their number.
    pub(crate) members: [u32; 3],
    /// Of a triangle the place of the second member in the row of later neighbours of the first.
    pub(crate) place: u32,
    /// Its number among all that the owner had, where these are counted; else 0.
    pub(crate) number: u32,
}

impl Clique {
    /// Its first members.
    #[inline(always)]
    pub(crate) fn corners<const K: usize>(&self) -> [usize; K] {
        std::array::from_fn(|corner| self.members[corner] as usize)
    }
}

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
    members: Vec<u32>,
    /// Reference vectors from the owner to its members, in m.
    reference: Vec<[f64; D]>,
    /// Their squares.
    squares: Vec<f64>,
    /// Row `j` has a bit for each member `k > j` within the horizon of `j`, then, from a new word on,
    /// a bit for the place of each of them in the neighbourhood's row of later neighbours of `j`.
    bits: Vec<u64>,
    /// 64-bit words of the first part of a row.
    words: usize,
    /// 64-bit words of the second part.
    place_words: usize,
    /// Member number of a point (`point - first`), [`NO_MEMBER`] for all others.
    member_of: Vec<u32>,
    first: usize,
    /// Rows of all owners, without collinear pairs.
    contributing: Option<&'a ContributingPairs>,
    /// What is gone of the body's cliques.
    lost: Option<&'a Lost>,
    /// The bits before pairs with broken edges were cleared; empty where none are.
    all: Vec<u64>,
    /// Which cliques of the size to be visited broke themselves, and the first number of the owner.
    broken: Option<(&'a Bits, usize)>,
}

/// The arrays of [`OwnerCliques`], kept for the next owners.
#[derive(Debug, Default)]
pub(crate) struct CliqueRoom<const D: usize> {
    members: Vec<u32>,
    reference: Vec<[f64; D]>,
    squares: Vec<f64>,
    bits: Vec<u64>,
    all: Vec<u64>,
    /// [`NO_MEMBER`] for all.
    member_of: Vec<u32>,
}

impl<const D: usize> CliqueRoom<D> {
    /// Large enough for all owners.
    pub(crate) fn new(neighborhood: &Neighborhood, slabs: &Slabs) -> CliqueRoom<D> {
        let n = neighborhood.most_later();
        let points = (0..slabs.len()).map(|slab| slabs.touched(slab).len()).max();
        CliqueRoom {
            members: Vec::with_capacity(n),
            reference: Vec::with_capacity(n),
            squares: Vec::with_capacity(n),
            bits: Vec::with_capacity(2 * n * n.div_ceil(64)),
            all: Vec::new(),
            member_of: vec![NO_MEMBER; points.unwrap_or(0)],
        }
    }
}

/// What stands for the number of a point that is no member.
const NO_MEMBER: u32 = u32::MAX;

impl<'a, const D: usize> OwnerCliques<'a, D> {
    /// For owners whose cliques stay within `points`.
    pub fn new(
        body: &'a Body,
        neighborhood: &'a Neighborhood,
        degeneracy: Degeneracy,
        points: std::ops::Range<usize>,
    ) -> Self {
        let room = CliqueRoom::default();
        OwnerCliques::in_room(body, neighborhood, degeneracy, points, room)
    }

    /// The same in arrays that are there.
    pub(crate) fn in_room(
        body: &'a Body,
        neighborhood: &'a Neighborhood,
        degeneracy: Degeneracy,
        points: std::ops::Range<usize>,
        room: CliqueRoom<D>,
    ) -> Self {
        let CliqueRoom { members, reference, squares, bits, all, mut member_of } = room;
        member_of.resize(points.len().max(member_of.len()), NO_MEMBER);
        debug_assert_eq!(body.dimension(), D, "the dimension of the body");
        OwnerCliques {
            body,
            neighborhood,
            degeneracy,
            owner: points.start,
            members,
            reference,
            squares,
            bits,
            words: 0,
            place_words: neighborhood.most_later().div_ceil(64),
            member_of,
            first: points.start,
            contributing: None,
            lost: None,
            all,
            broken: None,
        }
    }

    /// The arrays, for others.
    pub(crate) fn into_room(self) -> CliqueRoom<D> {
        let OwnerCliques { members, reference, squares, bits, all, member_of, .. } = self;
        CliqueRoom { members, reference, squares, bits, all, member_of }
    }

    /// Takes pairs from a table: no triangle has to be tested again, and members that are collinear
    /// with the owner no longer count as pairs. Tetrahedra on them are coplanar.
    pub fn with_contributing(self, contributing: Option<&'a ContributingPairs>) -> Self {
        OwnerCliques { contributing, ..self }
    }

    /// Moves to another owner.
    pub fn set(&mut self, owner: usize) {
        self.set_bonds(owner);
        self.connect();
    }

    /// Moves to another owner, of which bonds alone will be visited.
    pub(crate) fn set_bonds(&mut self, owner: usize) {
        self.owner = owner;
        self.broken = None;
        self.all.clear();
        self.members.clear();
        self.members.extend(self.neighborhood.upper(owner));
        let here: [f64; D] = self.position(owner);
        self.reference.clear();
        for place in 0..self.members.len() {
            let there = self.position(self.members[place] as usize);
            self.reference.push(std::array::from_fn(|axis| there[axis] - here[axis]));
        }
        self.squares.clear();
        self.squares.extend(self.reference.iter().map(square));
    }

    fn position(&self, point: usize) -> [f64; D] {
        let position = self.body.position(point);
        std::array::from_fn(|axis| position[axis])
    }

    /// Fills `bits`.
    fn connect(&mut self) {
        self.words = self.members.len().div_ceil(64);
        let stride = self.stride();
        self.bits.clear();
        if let Some(contributing) = self.contributing {
            self.bits.extend_from_slice(contributing.rows(self.owner));
            return;
        }
        self.bits.resize(self.members.len() * stride, 0);
        for (member, &point) in self.members.iter().enumerate() {
            self.member_of[point as usize - self.first] = member as u32;
        }
        let last = self.members.last().copied().unwrap_or(0);
        for (j, &point) in self.members.iter().enumerate() {
            let row = self.neighborhood.upper(point as usize).up_to(last);
            let bits = &mut self.bits[j * stride..(j + 1) * stride];
            if let [members, places] = bits {
                // One word each, as on lattices of up to three spacings: no branch.
                for (index, k) in row.iter().enumerate() {
                    let member = self.member_of[k as usize - self.first];
                    let is_member = u64::from(member != NO_MEMBER);
                    *members |= is_member << (member % 64);
                    *places |= is_member << (index % 64);
                }
                continue;
            }
            let (members, places) = bits.split_at_mut(self.words);
            for (index, k) in row.iter().enumerate() {
                let member = self.member_of[k as usize - self.first];
                if member != NO_MEMBER {
                    members[member as usize / 64] |= 1 << (member % 64);
                    places[index / 64] |= 1 << (index % 64);
                }
            }
        }
        for &point in &self.members {
            self.member_of[point as usize - self.first] = NO_MEMBER;
        }
    }

    fn stride(&self) -> usize {
        self.words + self.place_words
    }

    /// Clears the bits of pairs that are collinear with the owner.
    fn drop_collinear(&mut self) {
        for j in 0..self.members.len() {
            let dropped: Vec<_> = self.later(j).filter(|&(k, _)| self.is_collinear(j, k)).collect();
            let (start, words) = (j * self.stride(), self.words);
            for (k, place) in dropped {
                self.bits[start + k / 64] &= !(1 << (k % 64));
                self.bits[start + words + place / 64] &= !(1 << (place % 64));
            }
        }
    }

    /// The owner: the lowest point of its cliques.
    pub fn owner(&self) -> usize {
        self.owner
    }

    /// Its later neighbours, ascending.
    pub fn members(&self) -> &[u32] {
        &self.members
    }

    /// Reference vectors from the owner to the members, in m.
    pub fn reference(&self) -> &[[f64; D]] {
        &self.reference
    }

    /// The members `k > j` that are neighbours of member `j`, ascending, each with its place in the
    /// row of later neighbours of `j`.
    #[inline(always)]
    pub fn later(&self, j: usize) -> impl Iterator<Item = (usize, usize)> {
        let (members, places) =
            self.bits[j * self.stride()..][..self.stride()].split_at(self.words);
        ones(members).zip(ones(places))
    }

    /// Visits each clique of the owner and `K` members once, in lexicographic order. Stops at the
    /// visitor's first error.
    #[inline(always)]
    pub(crate) fn each<const K: usize, E>(
        &self,
        mut visit: impl FnMut(Clique) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.broken.is_some() && K > 1 {
            return self.each_numbered::<K, E>(visit);
        }
        let mut visit = |members: [usize; 3], place: usize| {
            visit(Clique { members: members.map(|m| m as u32), place: place as u32, number: 0 })
        };
        match K {
            1 => (0..self.members.len()).try_for_each(|j| visit([j, 0, 0], 0)),
            2 => self.triangles(|j, k, place| visit([j, k, 0], place)).map(|_| ()),
            _ => self.tetrahedra(|j, k, l| visit([j, k, l], 0)).map(|_| ()),
        }
    }

    /// Visits each triangle of the owner once: members `j < k` and the place of `k` in the row of
    /// later neighbours of `j`, in lexicographic order. Stops at the visitor's first error; otherwise
    /// returns how many collinear ones were dropped.
    pub fn triangles<E>(
        &self,
        mut visit: impl FnMut(usize, usize, usize) -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut dropped = 0;
        for j in 0..self.members.len() {
            let row = &self.bits[j * self.stride()..][..self.stride()];
            match (self.contributing, row) {
                (Some(_), &[mut members, mut places]) => {
                    while members != 0 {
                        visit(j, next_bit(0, &mut members), next_bit(0, &mut places))?;
                    }
                }
                (Some(_), _) => {
                    self.later(j).try_for_each(|(k, place)| visit(j, k, place))?;
                }
                (None, _) => {
                    for (k, place) in self.later(j) {
                        if self.is_collinear(j, k) {
                            dropped += 1;
                        } else {
                            visit(j, k, place)?;
                        }
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
            for k in ones(self.row(j)) {
                dropped += self.tetrahedra_on((j, k), (self.row(j), self.row(k)), &mut visit)?;
            }
        }
        Ok(dropped)
    }

    /// Whether members `j < k` are neighbours.
    #[inline(always)]
    pub fn are_neighbors(&self, j: usize, k: usize) -> bool {
        self.row(j)[k / 64] >> (k % 64) & 1 == 1
    }

    /// Visits the members that are neighbours of both `j < k` and come after them, ascending.
    #[inline(always)]
    pub fn for_each_common(&self, j: usize, k: usize, mut visit: impl FnMut(usize)) {
        for (word, (of_j, of_k)) in self.row(j).iter().zip(self.row(k)).enumerate() {
            let mut bits = of_j & of_k;
            while bits != 0 {
                visit(next_bit(word, &mut bits));
            }
        }
    }

    /// Squared lengths of the reference vectors.
    pub fn squares(&self) -> &[f64] {
        &self.squares
    }

    /// What counts as coplanar.
    pub fn degeneracy(&self) -> Degeneracy {
        self.degeneracy
    }

    /// The tetrahedra on one triangle, from the bits of its members.
    fn tetrahedra_on<E>(
        &self,
        (j, k): (usize, usize),
        (row_j, row_k): (&[u64], &[u64]),
        visit: &mut impl FnMut(usize, usize, usize) -> Result<(), E>,
    ) -> Result<u64, E> {
        let mut dropped = 0;
        let (first, second) = (&self.reference[j], &self.reference[k]);
        let normal = cross(first, second);
        let longest = self.squares[j].max(self.squares[k]);
        let base = longest.max(between(first, second));
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
        &self.bits[j * self.stride()..][..self.words]
    }
}

/// Which triangles every owner has, for bodies that have them: two bits per pair of neighbours are
/// read faster than neighbours are compared and areas computed.
#[derive(Debug)]
pub struct ContributingPairs {
    /// Where the words of each owner start.
    start: Vec<usize>,
    words: Vec<u64>,
}

impl ContributingPairs {
    /// Finds them, slab by slab.
    pub fn new<const D: usize>(
        body: &Body,
        neighborhood: &Neighborhood,
        degeneracy: Degeneracy,
        slabs: &Slabs,
    ) -> ContributingPairs {
        let of_slab = |slab: usize| {
            let touched = slabs.touched(slab);
            let mut cliques = OwnerCliques::<D>::new(body, neighborhood, degeneracy, touched);
            let (mut lengths, mut words) = (Vec::new(), Vec::new());
            for owner in slabs.owners(slab) {
                cliques.set(owner);
                cliques.drop_collinear();
                lengths.push(cliques.bits.len());
                words.extend_from_slice(&cliques.bits);
            }
            (lengths, words)
        };
        let found: Vec<_> = (0..slabs.len()).into_par_iter().map(of_slab).collect();
        let mut start = vec![0];
        let lengths = found.iter().flat_map(|(lengths, _)| lengths);
        start.extend(lengths.scan(0, |end, length| {
            *end += length;
            Some(*end)
        }));
        let words = found.into_iter().flat_map(|(_, words)| words).collect();
        ContributingPairs { start, words }
    }

    /// Bytes that the table of a body takes.
    pub fn bytes(neighborhood: &Neighborhood) -> usize {
        let place_words = neighborhood.most_later().div_ceil(64);
        let of_owner = |owner: usize| {
            let n = neighborhood.upper(owner).len();
            8 * n * (n.div_ceil(64) + place_words)
        };
        (0..neighborhood.n_points()).map(of_owner).sum()
    }

    fn rows(&self, owner: usize) -> &[u64] {
        &self.words[self.start[owner]..self.start[owner + 1]]
    }
}

/// Turns the result of a visit that cannot fail into its number.
pub fn never_fails<T>(result: Result<T, Infallible>) -> T {
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

/// The places of the bits that are set, ascending.
#[inline(always)]
fn ones(words: &[u64]) -> impl Iterator<Item = usize> {
    let mut rest = words.iter();
    let mut bits = rest.next().copied().unwrap_or(0);
    let mut word = 0;
    std::iter::from_fn(move || {
        while bits == 0 {
            bits = *rest.next()?;
            word += 1;
        }
        Some(next_bit(word, &mut bits))
    })
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
                for next in clique[clique.len() - 1] + 1..neighborhood.n_points() {
                    let near = |&p: &usize| neighborhood.row(p).contains(next as u32);
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
                never_fails(cliques.triangles(|j, k, place| {
                    triangles.push(vec![owner, point(j), point(k)]);
                    assert_eq!(neighborhood.upper(point(j)).at(place) as usize, point(k));
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
        let result = cliques.triangles(|_, _, _| {
            visits += 1;
            if visits == 3 { Err("enough") } else { Ok(()) }
        });
        assert_eq!((result, visits), (Err("enough"), 3));
    }
}
