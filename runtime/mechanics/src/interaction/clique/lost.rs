//! Cliques that are gone: those with a broken edge, and those that broke by a criterion of their own.
//!
//! The neighbours of a body stay as they are, and with them the order of its cliques; owners leave out what
//! is gone. Edges are bits of bonds, triangles and tetrahedra that broke themselves bits by their numbers
//! in that order.

use std::sync::Arc;

use rayon::prelude::*;

use super::super::{Degeneracy, Slabs};
use super::{Clique, OwnerCliques, never_fails, ones};
use crate::body::Body;
use crate::neighborhood::Neighborhood;

/// A set of numbers below a bound, one bit for each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bits(Vec<u64>);

impl Bits {
    /// None of so many numbers.
    pub fn none_of(n: usize) -> Bits {
        Bits(vec![0; n.div_ceil(64)])
    }

    /// Puts a number in; whether it was not there before.
    pub fn insert(&mut self, number: usize) -> bool {
        let word = &mut self.0[number / 64];
        let is_new = *word >> (number % 64) & 1 == 0;
        *word |= 1 << (number % 64);
        is_new
    }

    /// Whether a number is there.
    #[inline(always)]
    pub fn has(&self, number: usize) -> bool {
        self.0[number / 64] >> (number % 64) & 1 == 1
    }

    /// Takes a number out.
    pub(crate) fn remove(&mut self, number: usize) {
        self.0[number / 64] &= !(1 << (number % 64));
    }

    /// Whether none is there.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.iter().all(|word| *word == 0)
    }

    /// Puts in all of another set below the same bound.
    fn insert_all(&mut self, other: &Bits) {
        self.0.iter_mut().zip(&other.0).for_each(|(own, other)| *own |= other);
    }

    /// Those that are there, ascending.
    pub fn iter(&self) -> impl Iterator<Item = usize> {
        ones(&self.0)
    }

    /// Whether any of a stretch of numbers is there.
    pub(crate) fn have_any(&self, numbers: std::ops::Range<usize>) -> bool {
        numbers.into_iter().any(|number| self.has(number))
    }
}

/// Numbers of the triangles of a body, or of its tetrahedra: each once, owner by owner, in lexicographic
/// order; those without a measure at rest have none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ranks {
    /// The first number of each owner, and how many there are.
    start: Arc<[usize]>,
}

impl Ranks {
    /// Of the cliques of `K + 1` points.
    pub fn new<const D: usize, const K: usize>(
        body: &Body,
        neighborhood: &Neighborhood,
        slabs: &Slabs,
    ) -> Ranks {
        let degeneracy = Degeneracy::new(body);
        let of_slab = |slab: usize| {
            let touched = slabs.touched(slab);
            let mut cliques = OwnerCliques::<D>::new(body, neighborhood, degeneracy, touched);
            let count = |owner: usize| {
                let mut n = 0;
                cliques.set(owner);
                never_fails(cliques.each::<K, _>(|_| {
                    n += 1;
                    Ok(())
                }));
                n
            };
            slabs.owners(slab).map(count).collect::<Vec<usize>>()
        };
        let counts: Vec<Vec<usize>> = (0..slabs.len()).into_par_iter().map(of_slab).collect();
        let mut start = vec![0];
        start.extend(counts.iter().flatten().scan(0, |end, n| {
            *end += n;
            Some(*end)
        }));
        Ranks { start: start.into() }
    }

    /// How many cliques there are.
    pub fn count(&self) -> usize {
        self.start.last().copied().unwrap_or(0)
    }

    /// The first number of an owner.
    pub fn first(&self, owner: usize) -> usize {
        self.start[owner]
    }

    /// The owner of a clique.
    pub fn owner(&self, number: usize) -> usize {
        self.start.partition_point(|first| *first <= number) - 1
    }
}

/// Cliques of one size that broke by a criterion of their own.
#[derive(Clone, Debug)]
struct Own {
    ranks: Ranks,
    broken: Bits,
    /// Owners of some of these.
    owners: Bits,
}

/// What is gone of the cliques of a body.
#[derive(Clone, Debug)]
pub struct Lost {
    bonds: Bits,
    /// Owners of triangles and tetrahedra that are gone.
    owners: Bits,
    /// Triangles and tetrahedra that broke themselves.
    own: [Option<Own>; 2],
}

impl Lost {
    /// Nothing yet.
    pub fn nothing_of(neighborhood: &Neighborhood) -> Lost {
        let bonds = Bits::none_of(neighborhood.n_bonds());
        Lost { bonds, owners: Bits::none_of(neighborhood.n_points()), own: [None, None] }
    }

    /// Owners whose triangles and tetrahedra are no longer all there.
    pub(crate) fn owners(&self) -> &Bits {
        &self.owners
    }

    /// Owners of triangles and tetrahedra that have one of these bonds as an edge.
    pub(crate) fn owners_of(neighborhood: &Neighborhood, bonds: &[usize]) -> Bits {
        let mut owners = Bits::none_of(neighborhood.n_points());
        for &bond in bonds {
            let [low, high] = neighborhood.ends(bond);
            owners.insert(low);
            let earlier = neighborhood.row(low).iter().map(|i| i as usize);
            let both = |i: &usize| neighborhood.upper(*i).contains(high as u32);
            earlier.take_while(|i| *i < low).filter(both).for_each(|i| {
                owners.insert(i);
            });
        }
        owners
    }

    /// Takes out all cliques with one of these edges, whose [`Lost::owners_of`] are given.
    pub(crate) fn lose_edges(&mut self, bonds: &[usize], owners: &Bits) {
        bonds.iter().for_each(|bond| {
            self.bonds.insert(*bond);
        });
        self.owners.insert_all(owners);
    }

    /// Takes out cliques of `corners` points besides the owner, by their numbers.
    pub(crate) fn lose_cliques(&mut self, corners: usize, ranks: &Ranks, numbers: &[usize]) {
        let n_owners = 64 * self.owners.0.len();
        let own = self.own[corners - 2].get_or_insert_with(|| Own {
            ranks: ranks.clone(),
            broken: Bits::none_of(ranks.count()),
            owners: Bits::none_of(n_owners),
        });
        for &number in numbers {
            own.broken.insert(number);
            let owner = own.ranks.owner(number);
            own.owners.insert(owner);
            self.owners.insert(owner);
        }
    }

    /// Whether nothing is gone.
    pub(crate) fn is_nothing(&self) -> bool {
        let is_whole = |own: &Own| own.broken.is_empty();
        self.bonds.is_empty() && self.own.iter().flatten().all(is_whole)
    }

    /// Puts back cliques with these edges, but for those that have another broken edge or broke themselves.
    pub(crate) fn regain_edges(&mut self, neighborhood: &Neighborhood, bonds: &[usize]) {
        bonds.iter().for_each(|bond| self.bonds.remove(*bond));
        self.find_owners(neighborhood);
    }

    /// Puts back cliques of `corners` points besides the owner that broke themselves, by their numbers.
    pub(crate) fn regain_cliques(
        &mut self,
        neighborhood: &Neighborhood,
        corners: usize,
        numbers: &[usize],
    ) {
        let Some(own) = &mut self.own[corners - 2] else { return };
        numbers.iter().for_each(|number| own.broken.remove(*number));
        own.owners.0.fill(0);
        for number in own.broken.iter() {
            own.owners.insert(own.ranks.owner(number));
        }
        self.find_owners(neighborhood);
    }

    /// Owners of what is gone, anew.
    fn find_owners(&mut self, neighborhood: &Neighborhood) {
        self.owners = Lost::owners_of(neighborhood, &self.bonds.iter().collect::<Vec<_>>());
        for own in self.own.iter().flatten() {
            self.owners.insert_all(&own.owners);
        }
    }

    /// The numbers of the cliques of so many points besides the owner that broke themselves, ascending.
    pub(crate) fn own(&self, corners: usize) -> impl Iterator<Item = usize> {
        self.own
            .get(corners.wrapping_sub(2))
            .into_iter()
            .flatten()
            .flat_map(|own| own.broken.iter())
    }

    /// Cliques of so many points besides the owner, where some of an owner broke themselves: their bits, and
    /// the first of its numbers.
    fn of_owner(&self, corners: usize, owner: usize) -> Option<(&Bits, usize)> {
        let own = self.own[corners - 2].as_ref().filter(|own| own.owners.has(owner))?;
        Some((&own.broken, own.ranks.first(owner)))
    }
}

impl<'a, const D: usize> OwnerCliques<'a, D> {
    /// Leaves out what is gone.
    pub(crate) fn with_lost(self, lost: Option<&'a Lost>) -> Self {
        OwnerCliques { lost, ..self }
    }

    /// Moves to another owner, of which cliques of `K` members will be visited.
    pub(crate) fn set_of<const K: usize>(&mut self, owner: usize) {
        if K == 1 {
            return self.set_bonds(owner);
        }
        self.set(owner);
        let Some(lost) = self.lost.filter(|lost| lost.owners.has(owner)) else { return };
        self.broken = lost.of_owner(K, owner);
        self.all.clone_from(&self.bits);
        self.drop_edges(lost);
    }

    /// Whether single cliques are gone whose edges are all there.
    pub(crate) fn have_own_losses(&self) -> bool {
        self.broken.is_some()
    }

    /// Clears the bits of pairs with a broken edge.
    fn drop_edges(&mut self, lost: &Lost) {
        let first = self.neighborhood.bonds(self.owner).start;
        let is_broken = |member: usize| lost.bonds.has(first + member);
        for j in 0..self.members.len() {
            let of_member = self.neighborhood.bonds(self.members[j] as usize).start;
            let (start, words) = (j * self.stride(), self.words);
            let (members, places) = self.all[start..][..self.stride()].split_at(words);
            for (k, place) in ones(members).zip(ones(places)) {
                if is_broken(j) || is_broken(k) || lost.bonds.has(of_member + place) {
                    self.bits[start + k / 64] &= !(1 << (k % 64));
                    self.bits[start + words + place / 64] &= !(1 << (place % 64));
                }
            }
        }
    }

    /// Visits each clique of the owner and `K` members that is left, with its number among all that the
    /// owner had. Stops at the visitor's first error.
    pub(crate) fn each_numbered<const K: usize, E>(
        &self,
        mut visit: impl FnMut(Clique) -> Result<(), E>,
    ) -> Result<(), E> {
        let rows = if self.all.is_empty() { &self.bits } else { &self.all };
        let row = |j: usize| &rows[j * self.stride()..][..self.stride()];
        let mut number = 0;
        let mut see = |members: [usize; 3], place: usize| {
            let [j, k, l] = members;
            let is_whole = self.are_neighbors(j, k)
                && (K == 2 || self.are_neighbors(j, l) && self.are_neighbors(k, l));
            let is_broken = self.broken.is_some_and(|(broken, first)| broken.has(first + number));
            let own = number as u32;
            number += 1;
            match is_whole && !is_broken {
                true => {
                    let members = members.map(|member| member as u32);
                    visit(Clique { members, place: place as u32, number: own })
                }
                false => Ok(()),
            }
        };
        for j in 0..self.members.len() {
            let (members, places) = row(j).split_at(self.words);
            for (k, place) in ones(members).zip(ones(places)) {
                if K == 2 {
                    if self.contributing.is_some() || !self.is_collinear(j, k) {
                        see([j, k, 0], place)?;
                    }
                    continue;
                }
                let words = (&row(j)[..self.words], &row(k)[..self.words]);
                self.tetrahedra_on((j, k), words, &mut |j, k, l| see([j, k, l], 0))?;
            }
        }
        Ok(())
    }
}
