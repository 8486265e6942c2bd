//! The tetrahedra of one owner, summed over the pairs of their other corners before any derivative
//! of a volume is written out.
//!
//! With vectors from the owner, `v = xj.(xk x xl)` is linear in each. Let `f` and `s` be the weighted
//! first and second derivatives of the energy in `v`. For a pair `a < b` of an owner's members, with
//! `c` the third corner of each tetrahedron on that pair and `f` negative where `c` lies between `a`
//! and `b` in the order of the points, all that the derivatives need are the moments
//!
//! ```text
//! M = sum of s xc xc^T     p = sum of f xc
//! ```
//!
//! From `xb x xc = [xb] xc` follow the block of the pair and what it adds to its corners:
//!
//! ```text
//! block (a, b):           -[xb] M [xa]^T - [p]
//! block (a, a), (b, b):   [xb] M [xb]^T / 2,  [xa] M [xa]^T / 2
//! gradient at a, at b:    xb x p / 2,         -xa x p / 2
//! ```
//!
//! The halves are there because each tetrahedron is seen on both pairs at a corner. So a tetrahedron
//! costs three times nine products and sums instead of a Hessian of 45 entries and their scattering.
//! Tetrahedra on a fixed pair of members stand side by side in vector registers, and share the normal
//! of their base.

use pulp::{Arch, Simd, WithSimd};

use super::accumulate::{OwnerSums, TetrahedronLane};
use super::slab::{PairNumbers, Sum};
use crate::element::{Order, THIN, WIDEST};
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, cross, dot, each};
use crate::interaction::OwnerCliques;
use crate::kernel::{Batch, Law, Outputs};
use crate::weights::CliqueWeights;

/// Lanes evaluated at once: their numbers stay in the first-level cache.
const CAPACITY: usize = 256;

/// `xx, xy, xz, yy, yz, zz` of `M`, then `p`.
type Moments = [f64; 9];

type Vector = [f64; 3];

/// What is the same for all owners.
pub(super) struct Rules<'a> {
    pub(super) law: &'a dyn Law,
    pub(super) arch: Arch,
    pub(super) weights: &'a CliqueWeights,
    pub(super) order: Order,
    /// Smaller volumes are refused.
    pub(super) least: f64,
}

/// What is known of one owner.
pub(super) struct Owner<'a> {
    pub(super) cliques: &'a OwnerCliques<'a, 3>,
    /// Displacements of the members relative to the owner.
    pub(super) displacement: &'a [Vector],
    pub(super) own_share: f64,
    pub(super) shares: &'a [f64],
    pub(super) pairs: &'a PairNumbers,
}

impl Owner<'_> {
    fn rest(&self, member: usize) -> Vector {
        self.cliques.reference()[member]
    }

    fn now(&self, member: usize) -> Vector {
        plus(&self.rest(member), &self.displacement[member])
    }
}

/// Room for the tetrahedra of one owner after the other.
#[derive(Default)]
pub(super) struct TetrahedronSums {
    pairs: Vec<Moments>,
    thirds: Thirds,
    block: Block,
    /// Tetrahedra that have lost digits and need another treatment.
    pub(super) thin: Vec<TetrahedronLane>,
    energy: [f64; WIDEST],
    energy_error: [f64; WIDEST],
}

impl TetrahedronSums {
    /// Sums the tetrahedra of an owner; `false` if one of them was refused: the sums then mean
    /// nothing.
    pub(super) fn fill(&mut self, rules: &Rules<'_>, owner: &Owner<'_>) -> bool {
        self.pairs.clear();
        self.pairs.resize(owner.pairs.count(), [0.0; 9]);
        self.thin.clear();
        (self.energy, self.energy_error) = ([0.0; WIDEST], [0.0; WIDEST]);
        for k in 0..owner.cliques.members().len() {
            self.thirds.set(owner, k);
            let width = self.thirds.width();
            if width == 0 {
                continue;
            }
            self.block.restart();
            for j in (0..k).filter(|&j| owner.cliques.are_neighbors(j, k)) {
                if self.block.weight.len() + width > CAPACITY && !self.run(rules, owner) {
                    return false;
                }
                self.block.add_row(rules, owner, (j, k), &self.thirds);
            }
            if !self.run(rules, owner) {
                return false;
            }
            if rules.order >= Order::Gradient {
                self.thirds.add_to(&mut self.pairs, owner, k);
            }
        }
        true
    }

    /// Adds the energy to a sum.
    pub(super) fn add_energy(&self, sum: &mut Sum) {
        self.energy.iter().chain(&self.energy_error).for_each(|&part| sum.add(part));
    }

    /// Evaluates the block and empties it.
    fn run(&mut self, rules: &Rules<'_>, owner: &Owner<'_>) -> bool {
        let block = &mut self.block;
        if block.rows.is_empty() {
            return true;
        }
        let n = block.make_room();
        let measuring =
            Measuring { block, thirds: &self.thirds, weights: rules.weights, cliques: owner.cliques };
        if rules.arch.dispatch(measuring) {
            block.set_thin_apart(&self.thirds, owner, &mut self.thin);
        }
        let inputs = Batch {
            measure: &block.measure[..n],
            reference: &block.reference[..n],
            change: &block.change[..n],
        };
        let outputs =
            Outputs { psi: &mut block.psi, dpsi: &mut block.first, d2psi: &mut block.second };
        rules.law.evaluate(inputs, rules.order, outputs);
        let summing = Summing {
            block,
            thirds: &mut self.thirds,
            pairs: &mut self.pairs,
            energy: (&mut self.energy, &mut self.energy_error),
            order: rules.order,
            least: rules.least,
        };
        let is_fine = rules.arch.dispatch(summing);
        if rules.order >= Order::Gradient {
            block.scatter(&self.thirds.middle_moments, rules.order, &mut self.pairs);
        }
        block.restart();
        is_fine
    }

    /// Writes out the derivatives from the moments.
    pub(super) fn derive(&self, owner: &Owner<'_>, order: Order, sums: &mut OwnerSums<3>) {
        if order < Order::Gradient {
            return;
        }
        let mut number = 0;
        for a in 0..owner.cliques.members().len() {
            let xa = owner.now(a);
            for (b, _) in owner.cliques.later(a) {
                let xb = owner.now(b);
                let moments = &self.pairs[number];
                let p = [moments[6], moments[7], moments[8]];
                sums.add_gradient(a, &cross(&xb, &p).map(|g| 0.5 * g));
                sums.add_gradient(b, &cross(&xa, &p).map(|g| -0.5 * g));
                if order == Order::Tangent {
                    add_blocks(moments, (a, &xa), (b, &xb), number, sums);
                }
                number += 1;
            }
        }
    }
}

/// The blocks of one pair.
fn add_blocks(
    moments: &Moments,
    (a, xa): (usize, &Vector),
    (b, xb): (usize, &Vector),
    number: usize,
    sums: &mut OwnerSums<3>,
) {
    let &[xx, xy, xz, yy, yz, zz, px, py, pz] = moments;
    let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    // M [x]^T has the rows x x (row of M): M is symmetric.
    let (from_a, from_b) = (rows.map(|row| cross(xa, &row)), rows.map(|row| cross(xb, &row)));
    let mixed = crossed(xb, &from_a);
    let twist = [[0.0, -pz, py], [pz, 0.0, -px], [-py, px, 0.0]];
    let pair = std::array::from_fn(|r| std::array::from_fn(|c| -mixed[r][c] - twist[r][c]));
    sums.add_pair(number, &pair);
    sums.add_diagonal(a, &crossed(xb, &from_b).map(|row| row.map(|x| 0.5 * x)));
    sums.add_diagonal(b, &crossed(xa, &from_a).map(|row| row.map(|x| 0.5 * x)));
}

/// `[x] R`: the cross products of `x` with the columns of `R`.
fn crossed(x: &Vector, rows: &[Vector; 3]) -> [Vector; 3] {
    let mut product = [[0.0; 3]; 3];
    for column in 0..3 {
        let crossed = cross(x, &[rows[0][column], rows[1][column], rows[2][column]]);
        for row in 0..3 {
            product[row][column] = crossed[row];
        }
    }
    product
}

fn plus(p: &Vector, q: &Vector) -> Vector {
    std::array::from_fn(|axis| p[axis] + q[axis])
}

/// `x x^T` and `x`.
fn moments(x: &Vector) -> Moments {
    let [a, b, c] = *x;
    [a * a, a * b, a * c, b * b, b * c, c * c, a, b, c]
}

/// The third corners of the tetrahedra on all pairs `(j, k)` of one `k`: the later neighbours `l` of
/// `k`, side by side. Repeats the last to fill whole registers.
#[derive(Default)]
struct Thirds {
    members: Vec<u32>,
    rest: [Vec<f64>; 3],
    displacement: [Vec<f64>; 3],
    /// `xl xl^T` and `xl`.
    moments: [Vec<f64>; 9],
    square_at_rest: Vec<f64>,
    square: Vec<f64>,
    shares: Vec<f64>,
    /// Place of each member among the thirds, where it is one.
    place: Vec<u32>,
    /// Moments of the pairs `(k, l)`.
    sums: [Vec<f64>; 9],
    /// `xk xk^T` and `xk`.
    middle_moments: Moments,
}

impl Thirds {
    fn width(&self) -> usize {
        self.square.len()
    }

    fn set(&mut self, owner: &Owner<'_>, k: usize) {
        self.members.clear();
        self.place.resize(owner.cliques.members().len(), 0);
        for (l, _) in owner.cliques.later(k) {
            self.place[l] = self.members.len() as u32;
            self.members.push(l as u32);
        }
        let n = self.members.len();
        let width = n.next_multiple_of(WIDEST);
        let channels = self.rest.iter_mut().chain(&mut self.displacement);
        channels.chain(&mut self.moments).for_each(|channel| channel.resize(width, 0.0));
        self.square_at_rest.resize(width, 0.0);
        self.square.resize(width, 0.0);
        self.shares.resize(width, 0.0);
        for place in 0..width {
            let l = self.members[place.min(n - 1)] as usize;
            let (rest, eta, now) = (owner.rest(l), owner.displacement[l], owner.now(l));
            for axis in 0..3 {
                self.rest[axis][place] = rest[axis];
                self.displacement[axis][place] = eta[axis];
            }
            for (channel, moment) in self.moments.iter_mut().zip(moments(&now)) {
                channel[place] = moment;
            }
            self.square_at_rest[place] = dot(&rest, &rest);
            self.square[place] = dot(&now, &now);
            self.shares[place] = owner.shares[l];
        }
        for sums in &mut self.sums {
            sums.clear();
            sums.resize(width, 0.0);
        }
        self.middle_moments = moments(&owner.now(k));
    }

    /// Adds the moments of the pairs `(k, l)`.
    fn add_to(&self, pairs: &mut [Moments], owner: &Owner<'_>, k: usize) {
        for (place, &l) in self.members.iter().enumerate() {
            let pair = &mut pairs[owner.pairs.of(k, l as usize) as usize];
            for (moment, sums) in pair.iter_mut().zip(&self.sums) {
                *moment += sums[place];
            }
        }
    }
}

/// The tetrahedra on one pair `(j, k)`: one lane for each of the [`Thirds`].
struct Row {
    j: usize,
    k: usize,
    /// Number of the pair.
    pair: u32,
    /// Number of the first tetrahedron in [`Block::lanes`].
    first: usize,
    /// `Xj x Xk`, `xj x xk`, and their difference from displacements.
    normal_at_rest: Vector,
    normal: Vector,
    turned: Vector,
    /// `Xj` and `Xk`.
    rest: [Vector; 2],
    /// The longest of `|Xj|^2` and `|Xk|^2`, and of these and `|Xj - Xk|^2`.
    longest: [f64; 2],
    /// `|Xj|^2 |Xk|^2` and `|xj|^2 |xk|^2`.
    squares: [f64; 2],
    /// A volume such as tetrahedra here have: lanes without one are evaluated as if it were theirs.
    some_volume: f64,
    /// What `j`, `k` and the owner add to the weights.
    weight: f64,
    moments: Moments,
}

/// Rows that are evaluated at once.
#[derive(Default)]
struct Block {
    rows: Vec<Row>,
    /// Lane of each clique of four, and the number of its pair `(j, l)`.
    lanes: Vec<(u32, u32)>,
    /// 1 in lanes with a clique, then the weight of its tetrahedron; else 0.
    weight: Vec<f64>,
    sign: Vec<f64>,
    measure: Vec<f64>,
    reference: Vec<f64>,
    change: Vec<f64>,
    psi: Vec<f64>,
    /// psi', then `f`.
    first: Vec<f64>,
    /// psi'', then `s`.
    second: Vec<f64>,
}

impl Block {
    fn restart(&mut self) {
        self.rows.clear();
        self.lanes.clear();
        self.weight.clear();
    }

    fn add_row(
        &mut self,
        rules: &Rules<'_>,
        owner: &Owner<'_>,
        (j, k): (usize, usize),
        thirds: &Thirds,
    ) {
        let start = self.weight.len();
        let first = self.lanes.len();
        self.weight.resize(start + thirds.width(), 0.0);
        for l in owner.cliques.common(j, k) {
            let lane = start + thirds.place[l] as usize;
            self.weight[lane] = 1.0;
            self.lanes.push((lane as u32, owner.pairs.of(j, l)));
        }
        if self.lanes.len() == first {
            self.weight.truncate(start);
            return;
        }
        let rest = [owner.rest(j), owner.rest(k)];
        let (xj, xk) = (owner.now(j), owner.now(k));
        let (eta_j, eta_k) = (owner.displacement[j], owner.displacement[k]);
        let (square_j, square_k) = (owner.cliques.squares()[j], owner.cliques.squares()[k]);
        let longest = square_j.max(square_k);
        let edge: Vector = std::array::from_fn(|axis| rest[1][axis] - rest[0][axis]);
        self.rows.push(Row {
            j,
            k,
            pair: owner.pairs.of(j, k),
            first,
            normal_at_rest: cross(&rest[0], &rest[1]),
            normal: cross(&xj, &xk),
            turned: plus(&cross(&rest[0], &eta_k), &cross(&eta_j, &xk)),
            rest,
            longest: [longest, longest.max(dot(&edge, &edge))],
            squares: [square_j * square_k, dot(&xj, &xj) * dot(&xk, &xk)],
            some_volume: longest * longest.sqrt(),
            weight: rules.weights.begin(owner.own_share, &[owner.shares[j], owner.shares[k]]),
            moments: moments(&xj),
        });
    }

    /// Makes all arrays as long as there are lanes.
    fn make_room(&mut self) -> usize {
        let n = self.weight.len();
        let arrays = [&mut self.sign, &mut self.measure, &mut self.reference, &mut self.change];
        arrays.into_iter().for_each(|array| array.resize(n, 0.0));
        let arrays = [&mut self.psi, &mut self.first, &mut self.second];
        arrays.into_iter().for_each(|array| array.resize(n, 0.0));
        n
    }

    /// Takes thin tetrahedra out of the block.
    fn set_thin_apart(
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
                let is_thin = rest * rest < THIN * THIN * largest
                    || now * now < THIN * THIN * largest_now;
                if self.weight[lane] != 0.0 && is_thin {
                    self.weight[lane] = 0.0;
                    let l = thirds.members[place];
                    thin.push(TetrahedronLane {
                        members: [row.j as u32, row.k as u32, l],
                        pairs: [row.pair, pair, owner.pairs.of(row.k, l as usize)],
                    });
                }
            }
        }
    }

    /// Adds to the moments of the pairs `(j, l)`; their third corner lies between them.
    fn scatter(&self, middle: &Moments, order: Order, pairs: &mut [Moments]) {
        for &(lane, pair) in &self.lanes {
            let sums = &mut pairs[pair as usize];
            let first = self.first[lane as usize];
            for part in 6..9 {
                sums[part] -= first * middle[part];
            }
            if order == Order::Tangent {
                let second = self.second[lane as usize];
                for part in 0..6 {
                    sums[part] += second * middle[part];
                }
            }
        }
    }
}

/// The volumes and weights of a block; coplanar cliques get none. Returns whether some tetrahedra have
/// lost digits.
struct Measuring<'a> {
    block: &'a mut Block,
    thirds: &'a Thirds,
    weights: &'a CliqueWeights,
    cliques: &'a OwnerCliques<'a, 3>,
}

impl WithSimd for Measuring<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Measuring { block, thirds, weights, cliques } = self;
        let degeneracy = cliques.degeneracy();
        let splat = |x: f64| Lanes::splat(simd, x);
        let (zero, one) = (splat(0.0), splat(1.0));
        let groups = thirds.width() / Lanes::<S>::WIDTH;
        let mut thin = zero;
        for (number, row) in block.rows.iter().enumerate() {
            let splat_all = |x: &Vector| -> [Lanes<S>; 3] { each(|axis| splat(x[axis])) };
            let normal_at_rest = splat_all(&row.normal_at_rest);
            let (normal, turned) = (splat_all(&row.normal), splat_all(&row.turned));
            let squares: [Lanes<S>; 2] = each(|k| splat(THIN * THIN * row.squares[k]));
            let some_volume = splat(row.some_volume);
            for group in 0..groups {
                let lanes = number * groups + group;
                let load = |channels: &[Vec<f64>]| -> [Lanes<S>; 3] {
                    each(|axis| Lanes::load(simd, &channels[axis], group))
                };
                let (rest, eta) = (load(&thirds.rest), load(&thirds.displacement));
                let now = load(&thirds.moments[6..]);
                let at_rest = dot(&normal_at_rest, &rest);
                let volume = dot(&normal, &now);
                let grown = dot(&turned, &now) + dot(&normal_at_rest, &eta);
                let sign = at_rest.sign();
                let share = Lanes::load(simd, &thirds.shares, group);
                let is_clique = Lanes::load(simd, &block.weight, lanes);
                let mut weight = is_clique * weights.join_last(row.weight, share);
                let square = Lanes::load(simd, &thirds.square_at_rest, group);
                let edge = splat(4.0) * splat(row.longest[0]).max(square);
                let coplanar = is_clique * degeneracy.coplanar(at_rest * at_rest, edge);
                if coplanar.largest() > 0.0 {
                    // No edge is longer than twice the longest at the owner: now the edges themselves.
                    let mut edge = splat(row.longest[1]).max(square);
                    for corner in row.rest {
                        let away: [Lanes<S>; 3] = each(|axis| rest[axis] - splat(corner[axis]));
                        edge = edge.max(dot(&away, &away));
                    }
                    let coplanar = coplanar * degeneracy.coplanar(at_rest * at_rest, edge);
                    weight = coplanar.where_equal(zero, weight, zero);
                }
                weight.store(&mut block.weight, lanes);
                let used = |value: Lanes<S>, other: Lanes<S>| weight.where_equal(zero, other, value);
                used(sign * volume, some_volume).store(&mut block.measure, lanes);
                used(sign * at_rest, some_volume).store(&mut block.reference, lanes);
                used(grown / at_rest, zero).store(&mut block.change, lanes);
                sign.store(&mut block.sign, lanes);
                let largest = squares[0] * square;
                let largest_now = squares[1] * Lanes::load(simd, &thirds.square, group);
                let is_thin = (at_rest * at_rest).where_less(largest, one, zero);
                let is_thin = (volume * volume).where_less(largest_now, one, is_thin);
                thin = thin + used(is_thin, zero);
            }
        }
        thin.largest() > 0.0
    }
}

/// The energy of a block and the moments of its pairs `(j, k)` and `(k, l)`; whether all was finite
/// and no volume below the least.
struct Summing<'a> {
    block: &'a mut Block,
    thirds: &'a mut Thirds,
    pairs: &'a mut [Moments],
    energy: (&'a mut [f64; WIDEST], &'a mut [f64; WIDEST]),
    order: Order,
    least: f64,
}

impl WithSimd for Summing<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Summing { block, thirds, pairs, energy, order, least } = self;
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let (least, nothing) = (Lanes::splat(simd, least), Lanes::splat(simd, f64::NAN));
        let groups = thirds.width() / Lanes::<S>::WIDTH;
        // Sums over lanes have one order, whatever the width: that of the widest registers.
        let registers = WIDEST / Lanes::<S>::WIDTH;
        let channels = match order {
            Order::Energy => 0..0,
            Order::Gradient => 6..9,
            Order::Tangent => 0..9,
        };
        // 0 as long as all is well: the difference of a number and itself is 0 if it is finite.
        let mut refused = zero;
        for (number, row) in block.rows.iter().enumerate() {
            let start = number * groups;
            for group in 0..groups {
                let lanes = start + group;
                let weight = Lanes::load(simd, &block.weight, lanes);
                let part = weight * Lanes::load(simd, &block.psi, lanes);
                let measure = Lanes::load(simd, &block.measure, lanes);
                let change = Lanes::load(simd, &block.change, lanes);
                refused = refused + (part - part) + (change - change);
                refused = measure.where_less(least, nothing, refused);
                let register = group % registers;
                let sum = Lanes::load(simd, energy.0, register);
                let error = Lanes::load(simd, energy.1, register);
                let total = sum + part;
                let taken = total - sum;
                let lost = (sum - (total - taken)) + (part - taken);
                total.store(energy.0, register);
                (error + lost).store(energy.1, register);
                if order >= Order::Gradient {
                    let sign = Lanes::load(simd, &block.sign, lanes);
                    let first = weight * sign * Lanes::load(simd, &block.first, lanes);
                    first.store(&mut block.first, lanes);
                    refused = refused + (first - first);
                }
                if order == Order::Tangent {
                    let second = weight * Lanes::load(simd, &block.second, lanes);
                    second.store(&mut block.second, lanes);
                    refused = refused + (second - second);
                }
            }
            for channel in channels.clone() {
                let factors = if channel < 6 { &block.second } else { &block.first };
                let near = Lanes::splat(simd, row.moments[channel]);
                let mut total = [0.0; WIDEST];
                for register in 0..registers {
                    let mut sum = zero;
                    for group in (register..groups).step_by(registers) {
                        let factor = Lanes::load(simd, factors, start + group);
                        sum = sum + factor * Lanes::load(simd, &thirds.moments[channel], group);
                        let outer = Lanes::load(simd, &thirds.sums[channel], group);
                        (outer + factor * near).store(&mut thirds.sums[channel], group);
                    }
                    sum.store(&mut total, register);
                }
                let [a, b, c, d, e, f, g, h] = total;
                pairs[row.pair as usize][channel] += ((a + e) + (c + g)) + ((b + f) + (d + h));
            }
        }
        refused.where_equal(zero, zero, one).largest() == 0.0
    }
}
