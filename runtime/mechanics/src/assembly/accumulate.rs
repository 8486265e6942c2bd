//! What the interactions of one owner add to the rows of its members and to its own row.
//!
//! Elements return compact derivatives. The owner's gradient is minus the sum over the members; its
//! coupling with a member is minus the column sum of that member, its diagonal block the sum of
//! everything. So the members' sums are gathered first and the owner's row is written once.

use super::pairs::PairNumbers;
use super::rows::{Block, Rows};
use crate::element::{CAPACITY, Contributions, Order};
use crate::geometry::packed;
use crate::interaction::{Clique, OwnerCliques};

/// What of interactions is added up besides their energies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Added {
    pub(super) forces: bool,
    pub(super) blocks: bool,
}

impl Added {
    /// All that an order asks for.
    pub(super) fn new(order: Order) -> Added {
        Added { forces: order >= Order::Force, blocks: order == Order::Tangent }
    }
}

/// Sums over the interactions of one owner, per member.
#[derive(Default)]
pub(super) struct OwnerSums<const D: usize> {
    gradient: Vec<[f64; D]>,
    /// Upper triangles of the members' own blocks.
    diagonal: Vec<Block<D>>,
    /// For member `j` the sum over the other members `k` of the blocks `(k, j)`.
    column: Vec<Block<D>>,
    /// Blocks of pairs of members, for tetrahedra: each pair lies in many of them.
    pairs: Vec<Block<D>>,
}

impl<const D: usize> OwnerSums<D> {
    /// Room for so many members and pairs of them.
    pub(super) fn with_capacity(members: usize, pairs: usize) -> OwnerSums<D> {
        OwnerSums {
            gradient: Vec::with_capacity(members),
            diagonal: Vec::with_capacity(members),
            column: Vec::with_capacity(members),
            pairs: Vec::with_capacity(pairs),
        }
    }

    /// Starts a new owner.
    pub(super) fn reset(&mut self, added: Added, n_members: usize, n_pairs: usize) {
        let zero = [[0.0; D]; D];
        let restart = |blocks: &mut Vec<Block<D>>, n: usize| {
            blocks.clear();
            blocks.resize(n, zero);
        };
        if added.forces {
            self.gradient.clear();
            self.gradient.resize(n_members, [0.0; D]);
        }
        if added.blocks {
            restart(&mut self.diagonal, n_members);
            restart(&mut self.column, n_members);
            restart(&mut self.pairs, n_pairs);
        }
    }

    /// Adds to the gradient of a member.
    pub(super) fn add_gradient(&mut self, member: usize, part: &[f64; D]) {
        for axis in 0..D {
            self.gradient[member][axis] += part[axis];
        }
    }

    /// Adds to the own block of a member, of which the upper triangle counts.
    pub(super) fn add_diagonal(&mut self, member: usize, part: &Block<D>) {
        add(&mut self.diagonal[member], part);
    }

    /// Adds to the block of a pair.
    pub(super) fn add_pair(&mut self, number: usize, part: &Block<D>) {
        add(&mut self.pairs[number], part);
    }

    /// Adds the gradients of a batch of interactions with `K` members.
    #[inline(always)]
    fn add_gradients<const K: usize>(&mut self, lanes: &[Clique], out: &Contributions) {
        let gradient = &out.gradient[..K * D];
        for (p, lane) in lanes.iter().enumerate() {
            for (corner, member) in lane.corners::<K>().into_iter().enumerate() {
                let sum = &mut self.gradient[member];
                for axis in 0..D {
                    sum[axis] += gradient[corner * D + axis][p];
                }
            }
        }
    }

    /// Adds a batch of triangles. Their pair blocks go straight to the tangent: each pair of members
    /// lies in one triangle of the owner only.
    pub(super) fn add_triangles(
        &mut self,
        lanes: &[Clique],
        out: &Contributions,
        added: Added,
        cliques: &OwnerCliques<'_, D>,
        rows: &mut Rows<'_>,
    ) {
        let lanes = &lanes[..lanes.len().min(CAPACITY)];
        if added.forces {
            self.add_gradients::<2>(lanes, out);
        }
        if added.blocks {
            match rows.has_couplings() {
                true => self.add_triangle_blocks::<true>(lanes, out, cliques, rows),
                false => self.add_triangle_blocks::<false>(lanes, out, cliques, rows),
            }
        }
    }

    fn add_triangle_blocks<const COUPLINGS: bool>(
        &mut self,
        lanes: &[Clique],
        out: &Contributions,
        cliques: &OwnerCliques<'_, D>,
        rows: &mut Rows<'_>,
    ) {
        let h = &out.hessian[..packed(2 * D, 2 * D - 1, 2 * D - 1) + 1];
        for run in runs(lanes, |lane| lane.members[0]) {
            // Triangles on one edge (owner, j) follow each other: the sums of j stay in registers.
            let j = lanes[run.start].members[0] as usize;
            let point = cliques.members()[j] as usize;
            let blocks = rows.blocks::<D>(point, 0, rows.n_blocks(point));
            let (mut own, mut column) = ([[0.0; D]; D], [[0.0; D]; D]);
            for p in run {
                let k = lanes[p].members[1] as usize;
                let first = if COUPLINGS { (1 + lanes[p].place as usize) * D * D } else { 0 };
                let block = &mut blocks[first..][..D * D];
                let (own_k, column_k) = (&mut self.diagonal[k], &mut self.column[k]);
                for r in 0..D {
                    for c in 0..D {
                        let mixed = h[packed(2 * D, r, D + c)][p];
                        if COUPLINGS {
                            block[r * D + c] += mixed;
                        }
                        column_k[r][c] += mixed;
                        column[c][r] += mixed;
                    }
                    for c in r..D {
                        own[r][c] += h[packed(2 * D, r, c)][p];
                        own_k[r][c] += h[packed(2 * D, D + r, D + c)][p];
                    }
                }
            }
            add(&mut self.diagonal[j], &own);
            add(&mut self.column[j], &column);
        }
    }

    /// Adds a batch of tetrahedra.
    pub(super) fn add_tetrahedra(
        &mut self,
        lanes: &[Clique],
        pairs: &PairNumbers,
        out: &Contributions,
        added: Added,
    ) {
        let lanes = &lanes[..lanes.len().min(CAPACITY)];
        if added.forces {
            self.add_gradients::<3>(lanes, out);
        }
        if added.blocks {
            self.add_tetrahedron_blocks(lanes, pairs, out);
        }
    }

    fn add_tetrahedron_blocks(
        &mut self,
        lanes: &[Clique],
        pairs: &PairNumbers,
        out: &Contributions,
    ) {
        let h = &out.hessian[..packed(3 * D, 3 * D - 1, 3 * D - 1) + 1];
        for run in runs(lanes, |lane| lane.corners::<2>()) {
            // Tetrahedra on one triangle (owner, j, k) follow each other.
            let [j, k] = lanes[run.start].corners();
            let mut base = [[[0.0; D]; D]; 3];
            for p in run {
                let [_, _, l] = lanes[p].corners();
                let own_l = &mut self.diagonal[l];
                for r in 0..D {
                    for c in r..D {
                        base[0][r][c] += h[packed(3 * D, r, c)][p];
                        base[1][r][c] += h[packed(3 * D, D + r, D + c)][p];
                        own_l[r][c] += h[packed(3 * D, 2 * D + r, 2 * D + c)][p];
                    }
                    for c in 0..D {
                        base[2][r][c] += h[packed(3 * D, r, D + c)][p];
                    }
                }
                for (corner, member) in [j, k].into_iter().enumerate() {
                    let block = &mut self.pairs[pairs.of(member, l) as usize];
                    for r in 0..D {
                        for c in 0..D {
                            block[r][c] += h[packed(3 * D, corner * D + r, 2 * D + c)][p];
                        }
                    }
                }
            }
            add(&mut self.diagonal[j], &base[0]);
            add(&mut self.diagonal[k], &base[1]);
            add(&mut self.pairs[pairs.of(j, k) as usize], &base[2]);
        }
    }

    /// Writes the sums of this owner to the rows of its points. With tetrahedra, `pairs` were
    /// numbered member by member in the order of [`OwnerCliques::later`].
    pub(super) fn write(
        &mut self,
        cliques: &OwnerCliques<'_, D>,
        added: Added,
        rows: &mut Rows<'_>,
    ) {
        let (owner, members) = (cliques.owner(), cliques.members());
        if added.forces {
            let mut total = [0.0; D];
            for (part, &point) in self.gradient.iter().zip(members) {
                rows.add_gradient(point as usize, part);
                for axis in 0..D {
                    total[axis] -= part[axis];
                }
            }
            rows.add_gradient(owner, &total);
        }
        if added.blocks {
            self.write_pairs(cliques, rows);
            self.write_owner(owner, members, rows);
        }
    }

    fn write_pairs(&mut self, cliques: &OwnerCliques<'_, D>, rows: &mut Rows<'_>) {
        let (pairs, column) = (&self.pairs, &mut self.column);
        if pairs.is_empty() {
            return;
        }
        let mut number = 0;
        for j in 0..cliques.members().len() {
            for (k, place) in cliques.later(j) {
                let part = &pairs[number];
                number += 1;
                if rows.has_couplings() {
                    rows.add_block(cliques.members()[j] as usize, 1 + place, part);
                }
                for r in 0..D {
                    for c in 0..D {
                        column[k][r][c] += part[r][c];
                        column[j][c][r] += part[r][c];
                    }
                }
            }
        }
    }

    fn write_owner(&self, owner: usize, members: &[u32], rows: &mut Rows<'_>) {
        let mut total = [[0.0; D]; D];
        for (member, &point) in members.iter().enumerate() {
            let own = symmetric(&self.diagonal[member]);
            let mut sum = self.column[member];
            add(&mut sum, &own);
            add(&mut total, &sum);
            rows.add_block(point as usize, 0, &own);
            if rows.has_couplings() {
                rows.add_block(owner, 1 + member, &sum.map(|row| row.map(|x| -x)));
            }
        }
        rows.add_block(owner, 0, &symmetrised(&total));
    }
}

/// Ranges of consecutive lanes with the same key.
fn runs<K: PartialEq>(
    lanes: &[Clique],
    key: impl Fn(&Clique) -> K,
) -> impl Iterator<Item = std::ops::Range<usize>> {
    let mut start = 0;
    std::iter::from_fn(move || {
        let first = key(lanes.get(start)?);
        let len = lanes[start..].iter().take_while(|lane| key(lane) == first).count();
        start += len;
        Some(start - len..start)
    })
}

#[inline(always)]
fn add<const D: usize>(sum: &mut Block<D>, part: &Block<D>) {
    for r in 0..D {
        for c in 0..D {
            sum[r][c] += part[r][c];
        }
    }
}

/// The whole of a symmetric block from its upper triangle.
#[inline(always)]
fn symmetric<const D: usize>(upper: &Block<D>) -> Block<D> {
    let mut whole = *upper;
    for r in 1..D {
        for c in 0..r {
            whole[r][c] = upper[c][r];
        }
    }
    whole
}

/// The sum of all blocks of an owner's row, which is symmetric but for rounding, and exactly so where it is
/// stored.
pub(super) fn symmetrised<const D: usize>(total: &Block<D>) -> Block<D> {
    let mut symmetrised = *total;
    for r in 0..D {
        for c in 0..D {
            symmetrised[r][c] = 0.5 * (total[r][c] + total[c][r]);
        }
    }
    symmetrised
}
