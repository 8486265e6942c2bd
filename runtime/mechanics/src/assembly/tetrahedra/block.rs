//! The tetrahedra on all pairs with one middle corner, side by side.

use super::{Members, Moments, Owner, Rules, Vector, plus, visit};
use crate::element::{Order, THIN, WIDEST};
use crate::geometry::{cross, dot, each};
use crate::interaction::Clique;

/// One number of as many interactions as the widest registers hold.
pub(super) type Eight = [f64; WIDEST];

/// The third corners of the tetrahedra on all pairs `(j, k)` of one `k`: the later neighbours `l` of
/// `k`, side by side. Repeats the last to fill whole registers.
#[derive(Default)]
pub(super) struct Thirds {
    pub(super) k: usize,
    pub(super) members: Vec<u32>,
    pub(super) groups: Vec<Group>,
    /// Moments of the pairs `(k, l)`, group by group.
    pub(super) sums: Vec<[Eight; 9]>,
    /// Place of each member among the thirds, where it is one.
    pub(super) place: Vec<u32>,
}

/// What is known of some thirds.
#[derive(Clone, Copy, Default)]
pub(super) struct Group {
    /// `Xl`.
    pub(super) rest: [Eight; 3],
    /// `Xk x Xl`, `xk x xl`, and their difference from displacements.
    pub(super) normal_at_rest: [Eight; 3],
    pub(super) normal: [Eight; 3],
    pub(super) turned: [Eight; 3],
    /// `xl` and `xl xl^T`.
    pub(super) moments: [Eight; 9],
    pub(super) square_at_rest: Eight,
    pub(super) square: Eight,
    pub(super) share: Eight,
}

impl Thirds {
    pub(super) fn with_capacity(members: usize) -> Thirds {
        let groups = members.div_ceil(WIDEST);
        Thirds {
            k: 0,
            members: Vec::with_capacity(members),
            groups: Vec::with_capacity(groups),
            sums: Vec::with_capacity(groups),
            place: Vec::with_capacity(members),
        }
    }

    pub(super) fn width(&self) -> usize {
        WIDEST * self.groups.len()
    }

    pub(super) fn set(&mut self, owner: &Owner<'_>, members: &Members, k: usize) {
        self.k = k;
        self.members.clear();
        self.place.resize(owner.cliques.members().len(), 0);
        for (l, _) in owner.cliques.later(k) {
            self.place[l] = self.members.len() as u32;
            self.members.push(l as u32);
        }
        let n_groups = self.members.len().div_ceil(WIDEST);
        self.groups.resize(n_groups, Group::default());
        self.sums.clear();
        self.sums.resize(n_groups, [[0.0; WIDEST]; 9]);
        let (rest, displacement) = (owner.cliques.reference(), &owner.members.displacement);
        let (rest_k, eta_k, now_k) = (rest[k], displacement[k], members.now[k]);
        for (group, part) in self.groups.iter_mut().zip(self.members.chunks(WIDEST)) {
            for lane in 0..WIDEST {
                let l = part[lane.min(part.len() - 1)] as usize;
                let now = members.now[l];
                let at_rest = cross(&rest_k, &rest[l]);
                let normal = cross(&now_k, &now);
                let turned = plus(&cross(&rest_k, &displacement[l]), &cross(&eta_k, &now));
                for axis in 0..3 {
                    group.rest[axis][lane] = rest[l][axis];
                    group.normal_at_rest[axis][lane] = at_rest[axis];
                    group.normal[axis][lane] = normal[axis];
                    group.turned[axis][lane] = turned[axis];
                }
                let moments = &members.moments[l];
                for k in 0..9 {
                    group.moments[k][lane] = moments[k];
                }
                group.square_at_rest[lane] = owner.cliques.squares()[l];
                group.square[lane] = members.square[l];
                group.share[lane] = owner.members.shares[l];
            }
        }
    }

    /// Adds the moments of the pairs `(k, l)`.
    pub(super) fn add_to(&self, pairs: &mut [Moments], owner: &Owner<'_>, k: usize) {
        let numbers = owner.pairs.row(k);
        for (place, &l) in self.members.iter().enumerate() {
            let (sums, lane) = (&self.sums[place / WIDEST], place % WIDEST);
            let pair = &mut pairs[numbers[l as usize] as usize];
            for part in 0..9 {
                pair[part] += sums[part][lane];
            }
        }
    }
}

/// The tetrahedra on one pair `(j, k)`: one lane for each of the [`Thirds`].
pub(super) struct Row {
    pub(super) j: usize,
    /// Number of the pair.
    pub(super) pair: u32,
    /// Number of the first tetrahedron in [`Block::lanes`].
    pub(super) first: usize,
    /// The longest of `|Xj|^2` and `|Xk|^2`, and of these and `|Xj - Xk|^2`.
    pub(super) longest: [f64; 2],
    /// `|Xj|^2 |Xk|^2` and `|xj|^2 |xk|^2`.
    pub(super) squares: [f64; 2],
    /// What `j`, `k` and the owner add to the weights.
    pub(super) weight: f64,
}

/// Rows that are evaluated at once.
#[derive(Default)]
pub(super) struct Block {
    pub(super) rows: Vec<Row>,
    /// Lane of each clique of four, and the number of its pair `(j, l)`.
    pub(super) lanes: Vec<(u32, u32)>,
    /// 1 in lanes with a clique, then the weight of its tetrahedron; else 0.
    pub(super) weight: Vec<Eight>,
    pub(super) sign: Vec<Eight>,
    pub(super) measure: Vec<Eight>,
    pub(super) reference: Vec<Eight>,
    pub(super) change: Vec<Eight>,
    pub(super) psi: Vec<Eight>,
    /// psi', then `f`.
    pub(super) first: Vec<Eight>,
    /// psi'', then `s`.
    pub(super) second: Vec<Eight>,
}

impl Block {
    /// Room for so many groups of lanes.
    pub(super) fn with_capacity(groups: usize) -> Block {
        let lanes = || Vec::with_capacity(groups);
        Block {
            rows: Vec::with_capacity(groups),
            lanes: Vec::with_capacity(WIDEST * groups),
            weight: lanes(),
            sign: lanes(),
            measure: lanes(),
            reference: lanes(),
            change: lanes(),
            psi: lanes(),
            first: lanes(),
            second: lanes(),
        }
    }

    pub(super) fn restart(&mut self) {
        self.rows.clear();
        self.lanes.clear();
        self.weight.clear();
    }

    pub(super) fn add_row(
        &mut self,
        rules: &Rules<'_>,
        owner: &Owner<'_>,
        members: &Members,
        thirds: &Thirds,
        j: usize,
    ) {
        let (k, first) = (thirds.k, self.lanes.len());
        let (start, groups) = (self.weight.len(), thirds.groups.len());
        self.weight.resize(start + groups, [0.0; WIDEST]);
        self.lanes.resize(first + thirds.width(), (0, 0));
        let is_clique = self.weight[start..].as_flattened_mut();
        let lanes = &mut self.lanes[first..];
        let pairs = owner.pairs.row(j);
        let mut count = 0;
        owner.cliques.for_each_common(j, k, |l| {
            let place = thirds.place[l];
            is_clique[place as usize] = 1.0;
            lanes[count] = ((WIDEST * start) as u32 + place, pairs[l]);
            count += 1;
        });
        self.lanes.truncate(first + count);
        if count == 0 {
            self.weight.truncate(start);
            return;
        }
        let (rest, squares) = (owner.cliques.reference(), owner.cliques.squares());
        let visit::Members { own_share, shares, .. } = owner.members;
        let begun = rules.weights.begin(*own_share, &[shares[j], shares[k]]);
        let edge: Vector = each(|axis| rest[k][axis] - rest[j][axis]);
        let longest = squares[j].max(squares[k]);
        self.rows.push(Row {
            j,
            pair: pairs[k],
            first,
            longest: [longest, longest.max(dot(&edge, &edge))],
            squares: [squares[j] * squares[k], members.square[j] * members.square[k]],
            weight: begun,
        });
    }

    /// Makes all arrays as long as there are lanes.
    pub(super) fn make_room(&mut self) {
        let n = self.weight.len();
        let arrays = [&mut self.sign, &mut self.measure, &mut self.reference, &mut self.change];
        let others = [&mut self.psi, &mut self.first, &mut self.second];
        let arrays = arrays.into_iter().chain(others);
        arrays.for_each(|array| array.resize(n, [0.0; WIDEST]));
    }

    /// Takes thin tetrahedra out of the block.
    pub(super) fn set_thin_apart(&mut self, thirds: &Thirds, thin: &mut Vec<Clique>) {
        let width = thirds.width();
        for (number, row) in self.rows.iter().enumerate() {
            let end = self.rows.get(number + 1).map_or(self.lanes.len(), |next| next.first);
            for &(lane, _) in &self.lanes[row.first..end] {
                let lane = lane as usize;
                let place = lane - number * width;
                let (group, part) = (&thirds.groups[place / WIDEST], place % WIDEST);
                let now = self.measure.as_flattened()[lane];
                let rest = self.reference.as_flattened()[lane];
                let largest = row.squares[0] * group.square_at_rest[part];
                let largest_now = row.squares[1] * group.square[part];
                let is_thin =
                    rest * rest < THIN * THIN * largest || now * now < THIN * THIN * largest_now;
                let weight = &mut self.weight.as_flattened_mut()[lane];
                if *weight != 0.0 && is_thin {
                    *weight = 0.0;
                    let l = thirds.members[place];
                    let members = [row.j as u32, thirds.k as u32, l];
                    thin.push(Clique { members, place: 0, number: 0 });
                }
            }
        }
    }

    /// Adds to the moments of the pairs `(j, l)`; their third corner lies between them.
    pub(super) fn scatter(&self, middle: &Moments, order: Order, pairs: &mut [Moments]) {
        let (firsts, seconds) = (self.first.as_flattened(), self.second.as_flattened());
        for &(lane, pair) in &self.lanes {
            let sums = &mut pairs[pair as usize];
            let first = firsts[lane as usize];
            for part in 0..3 {
                sums[part] -= first * middle[part];
            }
            if order == Order::Tangent {
                let second = seconds[lane as usize];
                for part in 3..9 {
                    sums[part] += second * middle[part];
                }
            }
        }
    }
}
