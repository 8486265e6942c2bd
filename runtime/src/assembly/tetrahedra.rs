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
use super::slab::PairNumbers;
use super::sum::Sum;
use crate::element::{Order, THIN, WIDEST};
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, cross, dot, each};
use crate::interaction::OwnerCliques;
use crate::kernel::{Batch, Law, Outputs};
use crate::weights::CliqueWeights;

/// Lanes evaluated at once: their numbers stay in the first-level cache.
const CAPACITY: usize = 256;

/// `p`, then `xx, xy, xz, yy, yz, zz` of `M`.
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

/// The members of an owner now.
#[derive(Default)]
struct Members {
    now: Vec<Vector>,
    square: Vec<f64>,
    moments: Vec<Moments>,
}

impl Members {
    fn set(&mut self, owner: &Owner<'_>) {
        self.now.clear();
        let rest = owner.cliques.reference().iter();
        self.now.extend(rest.zip(owner.displacement).map(|(rest, eta)| plus(rest, eta)));
        self.square.clear();
        self.square.extend(self.now.iter().map(|x| dot(x, x)));
        self.moments.clear();
        self.moments.extend(self.now.iter().map(moments));
    }
}

/// Room for the tetrahedra of one owner after the other.
#[derive(Default)]
pub(super) struct TetrahedronSums {
    members: Members,
    pairs: Vec<Moments>,
    thirds: Thirds,
    block: Block,
    /// Tetrahedra that have lost digits and need another treatment.
    pub(super) thin: Vec<TetrahedronLane>,
    /// The energy of the owner.
    pub(super) energy: Sum,
}

impl TetrahedronSums {
    /// Sums the tetrahedra of an owner; `false` if one of them was refused: the sums then mean
    /// nothing.
    pub(super) fn fill(&mut self, rules: &Rules<'_>, owner: &Owner<'_>) -> bool {
        self.pairs.clear();
        self.pairs.resize(owner.pairs.count(), [0.0; 9]);
        self.thin.clear();
        self.energy = Sum::default();
        self.members.set(owner);
        for k in 0..owner.cliques.members().len() {
            self.thirds.set(owner, &self.members, k);
            let width = self.thirds.width();
            if width == 0 {
                continue;
            }
            self.block.restart();
            for j in (0..k).filter(|&j| owner.cliques.are_neighbors(j, k)) {
                if self.block.weight.len() + width > CAPACITY && !self.run(rules, owner) {
                    return false;
                }
                self.block.add_row(rules, owner, &self.members, &self.thirds, j);
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

    /// Evaluates the block and empties it.
    fn run(&mut self, rules: &Rules<'_>, owner: &Owner<'_>) -> bool {
        let block = &mut self.block;
        if block.rows.is_empty() {
            return true;
        }
        let n = block.make_room();
        let (members, thirds) = (&self.members, &self.thirds);
        let measuring = Measuring { block, thirds, members, weights: rules.weights, owner };
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
            members: &self.members,
            thirds: &mut self.thirds,
            pairs: &mut self.pairs,
            energy: &mut self.energy,
            order: rules.order,
            least: rules.least,
        };
        let is_fine = rules.arch.dispatch(summing);
        if rules.order >= Order::Gradient {
            block.scatter(&self.members.moments[self.thirds.k], rules.order, &mut self.pairs);
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
            let xa = self.members.now[a];
            for (b, _) in owner.cliques.later(a) {
                let xb = self.members.now[b];
                let moments = &self.pairs[number];
                let p = [moments[0], moments[1], moments[2]];
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
    let &[px, py, pz, xx, xy, xz, yy, yz, zz] = moments;
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

/// `x` and `x x^T`.
fn moments(x: &Vector) -> Moments {
    let [a, b, c] = *x;
    [a, b, c, a * a, a * b, a * c, b * b, b * c, c * c]
}

/// The third corners of the tetrahedra on all pairs `(j, k)` of one `k`: the later neighbours `l` of
/// `k`, side by side. Repeats the last to fill whole registers.
#[derive(Default)]
struct Thirds {
    k: usize,
    members: Vec<u32>,
    /// `Xl`.
    rest: [Vec<f64>; 3],
    /// `Xk x Xl`, `xk x xl`, and their difference from displacements.
    normal_at_rest: [Vec<f64>; 3],
    normal: [Vec<f64>; 3],
    turned: [Vec<f64>; 3],
    /// `xl` and `xl xl^T`.
    moments: [Vec<f64>; 9],
    square_at_rest: Vec<f64>,
    square: Vec<f64>,
    shares: Vec<f64>,
    /// Place of each member among the thirds, where it is one.
    place: Vec<u32>,
    /// Moments of the pairs `(k, l)`.
    sums: [Vec<f64>; 9],
}

impl Thirds {
    fn width(&self) -> usize {
        self.square.len()
    }

    fn set(&mut self, owner: &Owner<'_>, members: &Members, k: usize) {
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
    /// Number of the pair.
    pair: u32,
    /// Number of the first tetrahedron in [`Block::lanes`].
    first: usize,
    /// The longest of `|Xj|^2` and `|Xk|^2`, and of these and `|Xj - Xk|^2`.
    longest: [f64; 2],
    /// `|Xj|^2 |Xk|^2` and `|xj|^2 |xk|^2`.
    squares: [f64; 2],
    /// What `j`, `k` and the owner add to the weights.
    weight: f64,
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
    fn scatter(&self, middle: &Moments, order: Order, pairs: &mut [Moments]) {
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

/// The volumes and weights of a block; coplanar cliques get none. Returns whether some tetrahedra have
/// lost digits.
struct Measuring<'a> {
    block: &'a mut Block,
    thirds: &'a Thirds,
    members: &'a Members,
    weights: &'a CliqueWeights,
    owner: &'a Owner<'a>,
}

impl WithSimd for Measuring<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Measuring { block, thirds, members, weights, owner } = self;
        let degeneracy = owner.cliques.degeneracy();
        let splat = |x: f64| Lanes::splat(simd, x);
        let splat_all = |x: &Vector| -> [Lanes<S>; 3] { each(|axis| splat(x[axis])) };
        let (zero, one) = (splat(0.0), splat(1.0));
        let groups = thirds.width() / Lanes::<S>::WIDTH;
        let mut thin = zero;
        for (number, row) in block.rows.iter().enumerate() {
            let rest = splat_all(&owner.cliques.reference()[row.j]);
            let eta = splat_all(&owner.displacement[row.j]);
            let now = splat_all(&members.now[row.j]);
            let squares: [Lanes<S>; 2] = each(|k| splat(THIN * THIN * row.squares[k]));
            // Lanes without a tetrahedron are evaluated as if they had this volume, unstrained.
            let some_volume = splat(row.longest[0] * row.longest[0].sqrt());
            for group in 0..groups {
                let lanes = number * groups + group;
                let load = |channel: &[f64]| Lanes::load(simd, channel, group);
                let load_all = |channels: &[Vec<f64>; 3]| -> [Lanes<S>; 3] {
                    each(|axis| load(&channels[axis]))
                };
                let (normal_at_rest, normal) =
                    (load_all(&thirds.normal_at_rest), load_all(&thirds.normal));
                let at_rest = dot(&rest, &normal_at_rest);
                let volume = dot(&now, &normal);
                let grown = dot(&eta, &normal) + dot(&rest, &load_all(&thirds.turned));
                let sign = at_rest.sign();
                let is_clique = Lanes::load(simd, &block.weight, lanes);
                let square = load(&thirds.square_at_rest);
                let volume_squared = at_rest * at_rest;
                // No edge is longer than twice the longest at the owner, and those are edges: nearly
                // always that decides.
                let bound = splat(4.0) * splat(row.longest[0]).max(square);
                let mut edge = splat(row.longest[1]).max(square);
                let mut coplanar = degeneracy.coplanar(volume_squared, edge);
                let possible = degeneracy.coplanar(volume_squared, bound);
                if (is_clique * (possible - coplanar)).largest() > 0.0 {
                    let third = load_all(&thirds.rest);
                    for corner in [row.j, thirds.k] {
                        let corner = splat_all(&owner.cliques.reference()[corner]);
                        let away: [Lanes<S>; 3] = each(|axis| third[axis] - corner[axis]);
                        edge = edge.max(dot(&away, &away));
                    }
                    coplanar = possible * degeneracy.coplanar(volume_squared, edge);
                }
                let weight = is_clique * weights.join_last(row.weight, load(&thirds.shares));
                let weight = coplanar.where_equal(zero, weight, zero);
                weight.store(&mut block.weight, lanes);
                let used =
                    |value: Lanes<S>, other: Lanes<S>| weight.where_equal(zero, other, value);
                used(sign * volume, some_volume).store(&mut block.measure, lanes);
                used(sign * at_rest, some_volume).store(&mut block.reference, lanes);
                used(grown / at_rest, zero).store(&mut block.change, lanes);
                sign.store(&mut block.sign, lanes);
                let is_thin = volume_squared.where_less(squares[0] * square, one, zero);
                let largest_now = squares[1] * load(&thirds.square);
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
    members: &'a Members,
    thirds: &'a mut Thirds,
    pairs: &'a mut [Moments],
    energy: &'a mut Sum,
    order: Order,
    least: f64,
}

impl WithSimd for Summing<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> bool {
        let is_fine = self.weigh(simd);
        match self.order {
            Order::Energy => {}
            Order::Gradient => self.sum_moments::<S, 3>(simd),
            Order::Tangent => self.sum_moments::<S, 9>(simd),
        }
        is_fine
    }
}

impl Summing<'_> {
    /// Sums the energies and turns psi' and psi'' into `f` and `s`.
    #[inline(always)]
    fn weigh<S: Simd>(&mut self, simd: S) -> bool {
        let (block, energy, order) = (&mut *self.block, &mut *self.energy, self.order);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let (least, nothing) = (Lanes::splat(simd, self.least), Lanes::splat(simd, f64::NAN));
        // 0 as long as all is well: the difference of a number and itself is 0 if it is finite.
        let mut refused = zero;
        for lanes in 0..block.weight.len() / Lanes::<S>::WIDTH {
            let load = |channel: &[f64]| Lanes::load(simd, channel, lanes);
            let weight = load(&block.weight);
            let part = weight * load(&block.psi);
            part.store(&mut block.psi, lanes);
            let change = load(&block.change);
            refused = refused + (part - part) + (change - change);
            refused = load(&block.measure).where_less(least, nothing, refused);
            if order >= Order::Gradient {
                let first = weight * load(&block.sign) * load(&block.first);
                first.store(&mut block.first, lanes);
                refused = refused + (first - first);
            }
            if order == Order::Tangent {
                let second = weight * load(&block.second);
                second.store(&mut block.second, lanes);
                refused = refused + (second - second);
            }
        }
        energy.add(&block.psi[..block.weight.len()]);
        refused.where_equal(zero, zero, one).largest() == 0.0
    }

    /// Sums the first `PARTS` moments. Sums over lanes have one order, whatever the width of the
    /// registers: that of the widest.
    #[inline(always)]
    fn sum_moments<S: Simd, const PARTS: usize>(&mut self, simd: S) {
        let (block, thirds) = (&*self.block, &mut *self.thirds);
        let groups = thirds.width() / Lanes::<S>::WIDTH;
        let registers = WIDEST / Lanes::<S>::WIDTH;
        for (number, row) in block.rows.iter().enumerate() {
            let near = &self.members.moments[row.j];
            let mut totals = [[0.0; WIDEST]; PARTS];
            for register in 0..registers {
                let mut sums: [Lanes<S>; PARTS] = each(|_| Lanes::splat(simd, 0.0));
                for group in (register..groups).step_by(registers) {
                    let lanes = number * groups + group;
                    let first = Lanes::load(simd, &block.first, lanes);
                    let second = match PARTS {
                        3 => first,
                        _ => Lanes::load(simd, &block.second, lanes),
                    };
                    for part in 0..PARTS {
                        let factor = if part < 3 { first } else { second };
                        let far = Lanes::load(simd, &thirds.moments[part], group);
                        sums[part] = sums[part] + factor * far;
                        let outer = Lanes::load(simd, &thirds.sums[part], group);
                        let outer = outer + factor * Lanes::splat(simd, near[part]);
                        outer.store(&mut thirds.sums[part], group);
                    }
                }
                for part in 0..PARTS {
                    sums[part].store(&mut totals[part], register);
                }
            }
            let pair = &mut self.pairs[row.pair as usize];
            for part in 0..PARTS {
                let [a, b, c, d, e, f, g, h] = totals[part];
                pair[part] += ((a + e) + (c + g)) + ((b + f) + (d + h));
            }
        }
    }
}
