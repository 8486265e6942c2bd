//! Numbers of pairs of an owner's members.

use crate::interaction::OwnerCliques;

/// Numbers of the pairs of an owner's members that are neighbours, in lexicographic order.
#[derive(Default)]
pub(super) struct PairNumbers {
    number: Vec<u32>,
    n_members: usize,
    count: usize,
}

impl PairNumbers {
    /// Room for the pairs of so many members.
    pub(super) fn with_capacity(members: usize) -> PairNumbers {
        PairNumbers { number: vec![0; members * members], ..PairNumbers::default() }
    }

    /// Numbers the pairs of an owner.
    pub(super) fn set<const D: usize>(&mut self, cliques: &OwnerCliques<'_, D>) {
        self.n_members = cliques.members().len();
        self.count = 0;
        self.number.resize(self.number.len().max(self.n_members * self.n_members), 0);
        for j in 0..self.n_members {
            for (k, _) in cliques.later(j) {
                self.number[j * self.n_members + k] = self.count as u32;
                self.count += 1;
            }
        }
    }

    /// How many pairs there are.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Those of the pairs of `j` with each member after it that is its neighbour.
    #[inline(always)]
    pub(super) fn row(&self, j: usize) -> &[u32] {
        &self.number[j * self.n_members..(j + 1) * self.n_members]
    }

    /// That of a pair of neighbours `j < k`.
    #[inline(always)]
    pub(super) fn of(&self, j: usize, k: usize) -> u32 {
        self.number[j * self.n_members + k]
    }
}
