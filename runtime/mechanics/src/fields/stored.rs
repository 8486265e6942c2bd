//! The exact Hessian row by row, and its diagonal, of an energy of what points gather: for small
//! bodies, and as the witness of the products.
//!
//! With `ds_i = sum_j G_ij (du_j - du_i)` for the fields `s` it is
//! `G^T S_ss G + G^T S_su + S_us G + S_uu`, the second derivatives `S` by the fields and by the
//! differences of displacements being blocks of points and bonds. A row takes from its point's family
//! what a displacement of the point does to the duals of all fields there, and spreads these over the
//! families of the points that they belong to.

use rayon::prelude::*;

use crate::energy::{NonFinite, Wanted};
use crate::matrix::BlockMatrix;
use crate::neighborhood::Neighborhood;

/// A `d x d` tensor, row by row.
pub(crate) type Tensor<const D: usize> = [[f64; D]; D];

/// A bond as one of its ends sees it.
#[derive(Clone, Copy)]
pub(crate) struct Seen {
    /// That end and the other.
    pub(crate) ends: [usize; 2],
    /// The number of the bond.
    pub(crate) bond: usize,
    /// 1 where that end owns it, -1 where the other does.
    pub(crate) sign: f64,
}

/// Second derivatives of an energy by fields `s` of `m` numbers at each point, and by the differences of
/// displacements of bonded points, at some displacements. Matrices are stored row by row.
pub(crate) trait Linearised<const D: usize>: Sync {
    /// Who gathers from whom.
    fn neighborhood(&self) -> &Neighborhood;

    /// `m`.
    fn n_fields(&self) -> usize;

    /// `G_ij` of all directed bonds in the order of the neighbours, as many vectors for each.
    fn weights(&self) -> &[[f64; D]];

    /// Adds `G^T x` to `out` (`d x c`) for `x` (`m x c`); of weights with one vector for each field.
    #[inline(always)]
    fn add_transposed(&self, weight: &[[f64; D]], x: &[f64], columns: usize, out: &mut [f64]) {
        for (row, weight) in x.chunks_exact(columns.max(1)).zip(weight) {
            for (out, weight) in out.chunks_exact_mut(columns).zip(weight) {
                out.iter_mut().zip(row).for_each(|(out, x)| *out += weight * x);
            }
        }
    }

    /// `x G` for `x` (`d x m`); of weights with one vector for each field.
    #[inline(always)]
    fn times(&self, x: &[f64], weight: &[[f64; D]]) -> Tensor<D> {
        let m = weight.len();
        std::array::from_fn(|r| {
            let row = x[r * m..(r + 1) * m].iter().zip(weight);
            row.fold([0.0; D], |sum, (x, g)| std::array::from_fn(|s| sum[s] + x * g[s]))
        })
    }

    /// By the field at a point twice (`m x m`), those of its bonds included.
    fn at_point(&self, point: usize) -> &[f64];

    /// By the fields at the two ends of a bond, where energies couple them: `m x m`, a row for each number at
    /// the end that sees it.
    fn across(&self, _seen: Seen) -> Option<&[f64]> {
        None
    }

    /// Whether energies couple the fields at the two ends of bonds.
    fn is_across(&self) -> bool {
        false
    }

    /// Whether energies of bonds depend on differences of displacements other than by the fields.
    fn is_direct(&self) -> bool;

    /// Whether [`Linearised::mixed`] are not all 0.
    fn is_mixed(&self) -> bool;

    /// `out` (`m x d`) becomes those by the field at one end of a bond and by `u_j - u_i`, seen from `i`.
    fn mixed(&self, end: usize, seen: Seen, out: &mut [f64]);

    /// By `u_j - u_i` twice.
    fn direct(&self, seen: Seen) -> Tensor<D>;
}

/// The energy by `assemble`, with forces where they are wanted, and what is wanted of its second
/// derivatives.
pub(crate) fn evaluate<const D: usize, L: Linearised<D>>(
    wanted: Wanted<'_>,
    assemble: impl FnOnce(Option<&mut [f64]>) -> Result<(), NonFinite>,
    linearise: impl FnOnce() -> Result<L, NonFinite>,
) -> Result<(), NonFinite> {
    match wanted {
        Wanted::Energy => assemble(None),
        Wanted::Forces(forces) => assemble(Some(forces)),
        Wanted::Tangent(forces, tangent) => {
            assemble(Some(forces))?;
            Rows::new(&linearise()?).fill(tangent);
            Ok(())
        }
        Wanted::Diagonal(forces, diagonal) => {
            assemble(Some(forces))?;
            Rows::new(&linearise()?).diagonal(diagonal);
            Ok(())
        }
    }
}

/// What rows are made from.
pub(crate) struct Rows<'a, const D: usize, L> {
    of: &'a L,
    /// How many vectors a weight has.
    width: usize,
    /// For each directed bond `(i, j)` the place of `(j, i)`.
    mirrored: Vec<u32>,
    /// `-sum_j G_ij`: the weights of points in their own families.
    own: Vec<[f64; D]>,
    /// Whether a displacement changes duals beyond the families that its point is in.
    is_across: bool,
}

impl<'a, const D: usize, L: Linearised<D>> Rows<'a, D, L> {
    pub(crate) fn new(of: &'a L) -> Rows<'a, D, L> {
        let neighborhood = of.neighborhood();
        let weights = of.weights();
        let width = weights.len() / (2 * neighborhood.n_bonds()).max(1);
        let own = |point: usize| {
            let places = neighborhood.places(point);
            let rows = &weights[places.start * width..places.end * width];
            (0..width).map(move |k| {
                let row = rows.iter().skip(k).step_by(width);
                row.fold([0.0; D], |sum, g| std::array::from_fn(|c| sum[c] - g[c]))
            })
        };
        Rows {
            of,
            width,
            mirrored: neighborhood.mirrored(),
            own: (0..neighborhood.n_points()).flat_map(own).collect(),
            is_across: of.is_across(),
        }
    }

    /// The whole matrix on its pattern.
    pub(crate) fn fill(&self, matrix: &mut BlockMatrix) {
        let pattern = std::sync::Arc::clone(&matrix.pattern);
        let n = pattern.n_rows();
        let fill = |scratch: &mut Scratch<D>, (point, out): (usize, &mut [f64])| {
            self.row(scratch, point, pattern.row(point), self.is_across, out);
        };
        let rows = matrix.rows().into_par_iter().enumerate();
        rows.map_init(|| self.scratch(n), fill).collect::<()>();
    }

    /// Its diagonal blocks.
    pub(crate) fn diagonal(&self, blocks: &mut [f64]) {
        let n = blocks.len() / (D * D);
        let fill = |scratch: &mut Scratch<D>, (point, out): (usize, &mut [f64])| {
            self.row(scratch, point, &[point as u32], false, out);
        };
        let blocks = blocks.par_chunks_exact_mut(D * D).enumerate();
        blocks.map_init(|| self.scratch(n), fill).collect::<()>();
    }

    fn scratch(&self, n: usize) -> Scratch<D> {
        Scratch::new(n, self.of.n_fields())
    }

    #[inline(always)]
    fn own(&self, point: usize) -> &[[f64; D]] {
        &self.own[point * self.width..(point + 1) * self.width]
    }

    #[inline(always)]
    fn weight(&self, place: usize) -> &[[f64; D]] {
        &self.of.weights()[place * self.width..(place + 1) * self.width]
    }

    /// The bond with neighbour number `k` of a point.
    #[inline(always)]
    fn seen(&self, point: usize, k: usize) -> Seen {
        let neighborhood = self.of.neighborhood();
        let other = neighborhood.row(point).at(k) as usize;
        let number = |owner: usize, place: usize| {
            let bonds = neighborhood.bonds(owner);
            bonds.end - (neighborhood.places(owner).end - place)
        };
        let place = neighborhood.places(point).start + k;
        let ends = [point, other];
        if point < other {
            Seen { ends, bond: number(point, place), sign: 1.0 }
        } else {
            Seen { ends, bond: number(other, self.mirrored[place] as usize), sign: -1.0 }
        }
    }

    /// The weights that a point has in the families of its neighbours.
    #[inline(always)]
    fn in_families(&self, point: usize) -> impl Iterator<Item = (usize, &[[f64; D]])> {
        let neighborhood = self.of.neighborhood();
        let places = &self.mirrored[neighborhood.places(point)];
        let row = neighborhood.row(point).iter().zip(places);
        row.map(|(i, &place)| (i as usize, self.weight(place as usize)))
    }

    /// The blocks of a row at some columns, ascending. `beyond` tells whether displacements of the
    /// point change duals outside its family.
    fn row(
        &self,
        scratch: &mut Scratch<D>,
        point: usize,
        columns: &[u32],
        beyond: bool,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        scratch.start(point, columns);
        let neighborhood = self.of.neighborhood();
        scratch.see(point);
        neighborhood.row(point).iter().for_each(|j| scratch.see(j as usize));
        if beyond {
            for i in neighborhood.row(point) {
                neighborhood.row(i as usize).iter().for_each(|j| scratch.see(j as usize));
            }
        }
        self.through_fields(scratch, point, self.own(point), out);
        for (i, weight) in self.in_families(point) {
            self.through_fields(scratch, i, weight, out);
        }
        if self.of.is_direct() {
            self.through_bonds(scratch, point, out);
        }
        self.spread(scratch, columns, out);
    }

    /// The force at the point by way of `s_i`, in which it has this weight.
    fn through_fields(
        &self,
        scratch: &mut Scratch<D>,
        i: usize,
        weight: &[[f64; D]],
        out: &mut [f64],
    ) {
        let m = self.of.n_fields();
        if let Some(duals) = scratch.duals(i) {
            self.of.add_transposed(weight, self.of.at_point(i), m, duals);
        }
        if !(self.is_across || self.of.is_mixed()) {
            return;
        }
        let mut at_i = [[0.0; D]; D];
        let mut mixed = std::mem::take(&mut scratch.mixed);
        for (k, j) in self.of.neighborhood().row(i).iter().enumerate() {
            let j = j as usize;
            let place = scratch.place(j);
            let is_mixed = self.of.is_mixed() && (place.is_some() || scratch.place(i).is_some());
            if !(is_mixed || self.is_across) {
                continue;
            }
            let seen = self.seen(i, k);
            if let (Some(across), Some(duals)) = (self.of.across(seen), scratch.duals(j)) {
                self.of.add_transposed(weight, across, m, duals);
            }
            if !is_mixed {
                continue;
            }
            self.of.mixed(i, seen, &mut mixed);
            let mut block = [[0.0; D]; D];
            self.of.add_transposed(weight, &mixed, D, block.as_flattened_mut());
            add(out, place, &block, 1.0);
            add(at_i.as_flattened_mut(), Some(0), &block, 1.0);
        }
        scratch.mixed = mixed;
        add(out, scratch.place(i), &at_i, -1.0);
    }

    /// The force at the point by the differences of displacements of its own bonds.
    fn through_bonds(&self, scratch: &mut Scratch<D>, point: usize, out: &mut [f64]) {
        let mut mixed = std::mem::take(&mut scratch.mixed);
        for k in 0..self.of.neighborhood().row(point).len() {
            let seen = self.seen(point, k);
            for end in seen.ends {
                if let Some(duals) = scratch.duals(end).filter(|_| self.of.is_mixed()) {
                    self.of.mixed(end, seen, &mut mixed);
                    subtract_turned::<D>(&mixed, duals);
                }
            }
            let direct = self.of.direct(seen);
            add(out, scratch.place(seen.ends[1]), &direct, -1.0);
            add(out, scratch.place(point), &direct, 1.0);
        }
        scratch.mixed = mixed;
    }

    /// From derivatives of the force by `s_j` to those by displacements.
    fn spread(&self, scratch: &Scratch<D>, columns: &[u32], out: &mut [f64]) {
        let m = D * self.of.n_fields();
        let duals = |slot: usize| &scratch.duals[slot * m..(slot + 1) * m];
        if let [only] = columns {
            let only = *only as usize;
            let own = std::iter::once((only, self.own(only)));
            for (j, weight) in own.chain(self.in_families(only)) {
                if let Some(slot) = scratch.slot(j) {
                    add(out, Some(0), &self.of.times(duals(slot), weight), 1.0);
                }
            }
            return;
        }
        let Some(&lowest) = columns.first() else { return };
        let neighborhood = self.of.neighborhood();
        for (slot, &j) in scratch.seen.iter().enumerate() {
            let j = j as usize;
            let (row, start) = (neighborhood.row(j), neighborhood.places(j).start);
            let later = row.before(lowest);
            for (k, b) in row.iter().enumerate().skip(later) {
                let block = self.of.times(duals(slot), self.weight(start + k));
                add(out, scratch.place(b as usize), &block, 1.0);
            }
            if let Some(place) = scratch.place(j) {
                add(out, Some(place), &self.of.times(duals(slot), self.own(j)), 1.0);
            }
        }
    }
}

/// Adds a block at a place, if there is one.
#[inline(always)]
fn add<const D: usize>(out: &mut [f64], place: Option<usize>, block: &Tensor<D>, factor: f64) {
    let Some(place) = place else { return };
    let out = &mut out[place * D * D..(place + 1) * D * D];
    for (out, x) in out.iter_mut().zip(block.as_flattened()) {
        *out += factor * x;
    }
}

/// Takes the transpose of `x` (`m x d`) from `duals` (`d x m`).
#[inline(always)]
fn subtract_turned<const D: usize>(x: &[f64], duals: &mut [f64]) {
    let m = duals.len() / D;
    for (k, row) in x.as_chunks::<D>().0.iter().enumerate() {
        for (r, x) in row.iter().enumerate() {
            duals[r * m + k] -= x;
        }
    }
}

const NOWHERE: u32 = u32::MAX;

/// Work arrays of one thread.
struct Scratch<const D: usize> {
    n_fields: usize,
    /// Which block of the row a point has.
    places: Vec<u32>,
    columns: Vec<u32>,
    /// Which slot of `duals` a point has.
    slots: Vec<u32>,
    seen: Vec<u32>,
    /// Derivatives of the force at the row's point by `s_j`, `d x m` for each point that was seen.
    duals: Vec<f64>,
    /// `m x d`.
    mixed: Vec<f64>,
}

impl<const D: usize> Scratch<D> {
    fn new(n: usize, n_fields: usize) -> Scratch<D> {
        Scratch {
            n_fields,
            places: vec![NOWHERE; n],
            columns: Vec::new(),
            slots: vec![NOWHERE; n],
            seen: Vec::new(),
            duals: Vec::new(),
            mixed: vec![0.0; n_fields * D],
        }
    }

    #[inline(always)]
    fn start(&mut self, point: usize, columns: &[u32]) {
        debug_assert!(columns.first() == Some(&(point as u32)));
        self.columns.iter().for_each(|&b| self.places[b as usize] = NOWHERE);
        self.seen.iter().for_each(|&j| self.slots[j as usize] = NOWHERE);
        self.columns.clear();
        self.columns.extend_from_slice(columns);
        for (place, &b) in columns.iter().enumerate() {
            self.places[b as usize] = place as u32;
        }
        self.seen.clear();
        self.duals.clear();
    }

    #[inline(always)]
    fn see(&mut self, point: usize) {
        if self.slots[point] == NOWHERE {
            self.slots[point] = self.seen.len() as u32;
            self.seen.push(point as u32);
            self.duals.resize(self.seen.len() * D * self.n_fields, 0.0);
        }
    }

    #[inline(always)]
    fn place(&self, point: usize) -> Option<usize> {
        (self.places[point] != NOWHERE).then_some(self.places[point] as usize)
    }

    #[inline(always)]
    fn slot(&self, point: usize) -> Option<usize> {
        (self.slots[point] != NOWHERE).then_some(self.slots[point] as usize)
    }

    #[inline(always)]
    fn duals(&mut self, point: usize) -> Option<&mut [f64]> {
        let (slot, size) = (self.slot(point)?, D * self.n_fields);
        Some(&mut self.duals[slot * size..(slot + 1) * size])
    }
}
