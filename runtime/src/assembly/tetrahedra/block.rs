//! The tetrahedra on all pairs with one middle corner, side by side.

use super::super::accumulate::TetrahedronLane;
use super::{Members, Moments, Owner, Rules, Vector, plus};
use crate::element::{Order, THIN, WIDEST};
use crate::geometry::{cross, dot, each};

/// The third corners of the tetrahedra on all pairs `(j, k)` of one `k`: the later neighbours `l` of
/// `k`, side by side. Repeats the last to fill whole registers.
#[derive(Default)]
pub(super) struct Thirds {
    pub(super) k: usize,
    pub(super) members: Vec<u32>,
    /// `Xl`.
    pub(super) rest: [Vec<f64>; 3],
    /// `Xk x Xl`, `xk x xl`, and their difference from displacements.
    pub(super) normal_at_rest: [Vec<f64>; 3],
    pub(super) normal: [Vec<f64>; 3],
    pub(super) turned: [Vec<f64>; 3],
    /// `xl` and `xl xl^T`.
    pub(super) moments: [Vec<f64>; 9],
    pub(super) square_at_rest: Vec<f64>,
    pub(super) square: Vec<f64>,
    pub(super) shares: Vec<f64>,
    /// Place of each member among the thirds, where it is one.
    pub(super) place: Vec<u32>,
    /// Moments of the pairs `(k, l)`.
    pub(super) sums: [Vec<f64>; 9],
}

impl Thirds {
    pub(super) fn width(&self) -> usize {
        self.square.len()
    }

    pub(super) fn set(&mut self, owner: &Owner<'_>, members: &Members, k: usize) {
        self.k = k;
        self.members.clear();
        self.place.resize(owner.cliques.members().len(), 0);
        for (l, _) in owner.cliques.later(k) {
            self.place[l] = self.members.len() as u32;
            self.members.push(l as u32);
        }
        let n = self.members.len();
        let width = n.next_multiple_of(WIDEST);
        let vectors =
            [&mut self.rest, &mut self.normal_at_rest, &mut self.normal, &mut self.turned];
        let channels = vectors.into_iter().flatten().chain(&mut self.moments);
        let channels = channels.chain([&mut self.square_at_rest, &mut self.square]);
        channels.chain([&mut self.shares]).for_each(|channel| channel.resize(width, 0.0));
        let (rest, displacement) = (owner.cliques.reference(), owner.displacement);
        for place in 0..width {
            let l = self.members[place.min(n - 1)] as usize;
            let turned =
                plus(&cross(&rest[k], &displacement[l]), &cross(&displacement[k], &members.now[l]));
            let (at_rest, now) =
                (cross(&rest[k], &rest[l]), cross(&members.now[k], &members.now[l]));
            for axis in 0..3 {
                self.rest[axis][place] = rest[l][axis];
                self.normal_at_rest[axis][place] = at_rest[axis];
                self.normal[axis][place] = now[axis];
                self.turned[axis][place] = turned[axis];
            }
            for (channel, moment) in self.moments.iter_mut().zip(members.moments[l]) {
                channel[place] = moment;
            }
            self.square_at_rest[place] = owner.cliques.squares()[l];
            self.square[place] = members.square[l];
            self.shares[place] = owner.shares[l];
        }
        for sums in &mut self.sums {
            sums.clear();
            sums.resize(width, 0.0);
        }
    }

    /// Adds the moments of the pairs `(k, l)`.
    pub(super) fn add_to(&self, pairs: &mut [Moments], owner: &Owner<'_>, k: usize) {
        for (place, &l) in self.members.iter().enumerate() {
            let pair = &mut pairs[owner.pairs.of(k, l as usize) as usize];
            for (moment, sums) in pair.iter_mut().zip(&self.sums) {
                *moment += sums[place];
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
    pub(super) weight: Vec<f64>,
    pub(super) sign: Vec<f64>,
    pub(super) measure: Vec<f64>,
    pub(super) reference: Vec<f64>,
    pub(super) change: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// psi', then `f`.
    pub(super) first: Vec<f64>,
    /// psi'', then `s`.
    pub(super) second: Vec<f64>,
}

impl Block {
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
        let (k, start, first) = (thirds.k, self.weight.len(), self.lanes.len());
        self.weight.resize(start + thirds.width(), 0.0);
        self.lanes.resize(first + thirds.width(), (0, 0));
        let (is_clique, lanes) = (&mut self.weight[start..], &mut self.lanes[first..]);
        let pairs = owner.pairs.row(j);
        let mut count = 0;
        owner.cliques.for_each_common(j, k, |l| {
            let place = thirds.place[l];
            is_clique[place as usize] = 1.0;
            lanes[count] = (start as u32 + place, pairs[l]);
            count += 1;
        });
        self.lanes.truncate(first + count);
        if count == 0 {
            self.weight.truncate(start);
            return;
        }
        let (rest, squares) = (owner.cliques.reference(), owner.cliques.squares());
        let edge: Vector = each(|axis| rest[k][axis] - rest[j][axis]);
        let longest = squares[j].max(squares[k]);
        self.rows.push(Row {
            j,
            pair: pairs[k],
            first,
            longest: [longest, longest.max(dot(&edge, &edge))],
            squares: [squares[j] * squares[k], members.square[j] * members.square[k]],
            weight: rules.weights.begin(owner.own_share, &[owner.shares[j], owner.shares[k]]),
        });
    }

    /// Makes all arrays as long as there are lanes.
    pub(super) fn make_room(&mut self) -> usize {
        let n = self.weight.len();
        let arrays = [&mut self.sign, &mut self.measure, &mut self.reference, &mut self.change];
        arrays.into_iter().for_each(|array| array.resize(n, 0.0));
        let arrays = [&mut self.psi, &mut self.first, &mut self.second];
        arrays.into_iter().for_each(|array| array.resize(n, 0.0));
        n
    }

    /// Takes thin tetrahedra out of the block.
    pub(super) fn set_thin_apart(
        &mut self,
        thirds: &Thirds,
        owner: &Owner<'_>,
        thin: &mut Vec<TetrahedronLane>,
    ) {
        let width = thirds.width();
        for (number, row) in self.rows.iter().enumerate() {
            let end = self.rows.get(number + 1).map_or(self.lanes.len(), |next| next.first);
            for &(lane, pair) in &self.lanes[row.first..end] {
                let lane = lane as usize;
                let place = lane - number * width;
                let (now, rest) = (self.measure[lane], self.reference[lane]);
                let largest = row.squares[0] * thirds.square_at_rest[place];
                let largest_now = row.squares[1] * thirds.square[place];
                let is_thin =
                    rest * rest < THIN * THIN * largest || now * now < THIN * THIN * largest_now;
                if self.weight[lane] != 0.0 && is_thin {
                    self.weight[lane] = 0.0;
                    let l = thirds.members[place];
                    thin.push(TetrahedronLane {
                        members: [row.j as u32, thirds.k as u32, l],
                        pairs: [row.pair, pair, owner.pairs.of(thirds.k, l as usize)],
                    });
                }
            }
        }
    }

    /// Adds to the moments of the pairs `(j, l)`; their third corner lies between them.
    pub(super) fn scatter(&self, middle: &Moments, order: Order, pairs: &mut [Moments]) {
        for &(lane, pair) in &self.lanes {
            let sums = &mut pairs[pair as usize];
            let first = self.first[lane as usize];
            for part in 0..3 {
                sums[part] -= first * middle[part];
            }
            if order == Order::Tangent {
                let second = self.second[lane as usize];
                for part in 3..9 {
                    sums[part] += second * middle[part];
                }
            }
        }
    }
}
