//! Bonds of a lattice that repeat from point to point.
//!
//! On a lattice whose points follow each other along a row, a bond from point `i` to point `j` is
//! followed by the same one from `i + 1` to `j + 1`. Such a run is two ranges of points and one vector:
//! a pass over it reads consecutive numbers and knows the bond at rest without looking.
//!
//! Before: the later neighbours of every point. After: the same bonds, each in one run of one slab, by
//! the first owner of their run.

use std::collections::BTreeMap;
use std::ops::Range;

use pulp::Simd;

use super::Slabs;
use crate::body::Body;
use crate::element::WIDEST;
use crate::geometry::lanes::Lanes;
use crate::materials::Materials;
use crate::neighborhood::Neighborhood;

/// A mean length below which runs are not worth it: each has its own beginning and end.
const SHORT: f64 = 6.0;

/// How far a bond may be from its vector, in spacings: far more than coordinates are rounded by, far
/// less than points of a cloud are displaced.
const TOLERANCE: f64 = 1e-9;

/// The bonds `(owner + k, other + k)` with `k < len`, which have one vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub(crate) owner: u32,
    pub(crate) other: u32,
    pub(crate) len: u32,
    /// The number of its vector.
    pub(crate) vector: u32,
}

/// The bonds of a lattice body.
#[derive(Clone, Debug)]
pub(crate) struct Runs {
    runs: Vec<Run>,
    /// Where those of each slab start.
    start: Vec<usize>,
    /// The vectors from the owner to the other end at rest, `d` numbers each, in m.
    vectors: Vec<f64>,
    /// Of each vector the materials of the owner and of the other end; nothing of bodies of one material.
    materials: Vec<[u8; 2]>,
}

impl Runs {
    /// The runs of a lattice body; nothing where bonds do not repeat or do so only in short runs.
    pub(crate) fn new(body: &Body, neighborhood: &Neighborhood, slabs: &Slabs) -> Option<Runs> {
        let spacing = body.spacing()?;
        let mut found = Finding::new(body, spacing, neighborhood.horizon())?;
        let mut start = vec![0];
        for slab in 0..slabs.len() {
            found.first = found.runs.len();
            for owner in slabs.owners(slab) {
                for other in neighborhood.upper(owner) {
                    found.add(body, [owner, other as usize])?;
                }
            }
            start.push(found.runs.len());
        }
        let Finding { runs, vectors, .. } = found;
        Some(Runs { runs, start, vectors, materials: Vec::new() })
            .filter(|runs| runs.mean_length() >= SHORT)
    }

    /// The same bonds in runs whose owners are of one material, and whose other ends are, too; a vector
    /// is listed once for each pair of materials that it joins. Nothing where runs are short then.
    pub(crate) fn between(self, materials: &Materials, dimension: usize) -> Option<Runs> {
        let mut known: BTreeMap<(u32, [u8; 2]), u32> = BTreeMap::new();
        let (mut runs, mut start) = (Vec::with_capacity(self.runs.len()), vec![0]);
        let mut of_vectors = Vec::new();
        let mut vectors = Vec::new();
        for slab in 0..self.start.len() - 1 {
            for run in self.of_slab(slab) {
                let (i, j) = (run.owner as usize, run.other as usize);
                let of_bond = |k: usize| [materials.of(i + k), materials.of(j + k)];
                let mut first = 0;
                while first < run.len as usize {
                    let joined = of_bond(first);
                    let same =
                        (first..run.len as usize).take_while(|k| of_bond(*k) == joined).count();
                    let vector = *known.entry((run.vector, joined)).or_insert_with(|| {
                        let own = run.vector as usize * dimension;
                        vectors.extend_from_slice(&self.vectors[own..own + dimension]);
                        of_vectors.push(joined);
                        of_vectors.len() as u32 - 1
                    });
                    let [owner, other] = [run.owner, run.other].map(|point| point + first as u32);
                    runs.push(Run { owner, other, len: same as u32, vector });
                    first += same;
                }
            }
            // Groups take runs by their first owners.
            runs[*start.last().unwrap_or(&0)..].sort_by_key(|run| run.owner);
            start.push(runs.len());
        }
        let cut = Runs { runs, start, vectors, materials: of_vectors };
        Some(cut).filter(|runs| runs.mean_length() >= SHORT)
    }

    /// The materials of the owner and of the other end of the bonds of a vector.
    pub(crate) fn materials(&self, vector: usize) -> [u8; 2] {
        self.materials.get(vector).copied().unwrap_or_default()
    }

    /// How many bonds a run has on average.
    pub(crate) fn mean_length(&self) -> f64 {
        let bonds: u64 = self.runs.iter().map(|run| u64::from(run.len)).sum();
        bonds as f64 / self.runs.len().max(1) as f64
    }

    /// The runs of a slab's owners.
    pub(crate) fn of_slab(&self, slab: usize) -> &[Run] {
        &self.runs[self.start[slab]..self.start[slab + 1]]
    }

    /// Their places among all runs.
    pub(crate) fn places(&self, slab: usize) -> Range<usize> {
        self.start[slab]..self.start[slab + 1]
    }

    /// Numbers of bonds as runs have them, each followed by nothing up to whole registers.
    pub(crate) fn in_runs(&self, neighborhood: &Neighborhood, of_bonds: &[f64]) -> InRuns {
        let (mut numbers, mut start) = (Vec::with_capacity(of_bonds.len()), Vec::new());
        let mut places = vec![0; of_bonds.len()];
        for run in &self.runs {
            start.push(numbers.len());
            for k in 0..run.len {
                let (owner, other) = ((run.owner + k) as usize, run.other + k);
                let later = neighborhood.upper(owner).before(other);
                let bond = neighborhood.bonds(owner).start + later;
                places[bond] = numbers.len();
                numbers.push(of_bonds[bond]);
            }
            numbers.resize(numbers.len().next_multiple_of(WIDEST), 0.0);
        }
        InRuns { numbers, start, places }
    }

    /// All bonds, each with a bit of its own.
    pub(crate) fn kept(&self, neighborhood: &Neighborhood) -> KeptInRuns {
        let (mut n_bytes, mut start) = (0, Vec::with_capacity(self.runs.len()));
        let mut places = vec![0; neighborhood.n_bonds()];
        for run in &self.runs {
            start.push(n_bytes);
            for k in 0..run.len {
                let (owner, other) = ((run.owner + k) as usize, run.other + k);
                let later = neighborhood.upper(owner).before(other);
                places[neighborhood.bonds(owner).start + later] = n_bytes * WIDEST + k as usize;
            }
            n_bytes += (run.len as usize).div_ceil(WIDEST);
        }
        KeptInRuns { bits: vec![u8::MAX; n_bytes], start, places }
    }

    /// The vectors at rest, in m.
    pub(crate) fn vectors<const D: usize>(&self) -> &[[f64; D]] {
        self.vectors.as_chunks::<D>().0
    }
}

/// A bit for every bond, run by run: whether it is still there.
pub(crate) struct KeptInRuns {
    bits: Vec<u8>,
    /// Where those of each run start.
    start: Vec<usize>,
    /// Where that of each bond is, counted in bits.
    places: Vec<usize>,
}

impl KeptInRuns {
    /// Takes out a bond.
    pub(crate) fn lose(&mut self, bond: usize) {
        let place = self.places[bond];
        self.bits[place / WIDEST] &= !(1 << (place % WIDEST));
    }

    /// Puts back a bond.
    pub(crate) fn regain(&mut self, bond: usize) {
        let place = self.places[bond];
        self.bits[place / WIDEST] |= 1 << (place % WIDEST);
    }

    /// The bits of a run, one byte for [`WIDEST`] bonds, and what is behind them.
    #[inline(always)]
    pub(crate) fn of_run(&self, run: usize) -> &[u8] {
        &self.bits[self.start[run]..]
    }
}

/// 1 for every bit of a byte, the lowest first, and 0 for those that are not there.
static OF_BITS: [[f64; WIDEST]; 256] = {
    let mut all = [[0.0; WIDEST]; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut bit = 0;
        while bit < WIDEST {
            if byte >> bit & 1 == 1 {
                all[byte][bit] = 1.0;
            }
            bit += 1;
        }
        byte += 1;
    }
    all
};

/// 1 for the bits of a register of a run, a byte for [`WIDEST`] bonds, and 0 for those that are not there.
#[inline(always)]
pub(crate) fn there<S: Simd>(simd: S, kept: &[u8], group: usize) -> Lanes<S> {
    let (first, width) = (group * Lanes::<S>::WIDTH, Lanes::<S>::WIDTH);
    let bits = &OF_BITS[usize::from(kept[first / WIDEST])];
    Lanes::load(simd, bits, first % WIDEST / width)
}

/// A number for every bond, run by run.
pub(crate) struct InRuns {
    numbers: Vec<f64>,
    /// Where those of each run start.
    start: Vec<usize>,
    /// Where that of each bond is.
    places: Vec<usize>,
}

impl InRuns {
    /// Another number of a bond.
    pub(crate) fn set(&mut self, bond: usize, number: f64) {
        self.numbers[self.places[bond]] = number;
    }

    /// The numbers of a run, and what is behind them.
    #[inline(always)]
    pub(crate) fn of_run(&self, run: usize) -> &[f64] {
        &self.numbers[self.start[run]..]
    }
}

/// A bond that some of consecutive owners have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Bundle {
    /// The number of its vector.
    pub(crate) vector: u32,
    /// The other end of the first owner's bond, whether that has it or not.
    pub(crate) other: i32,
    /// A bit for each owner that has it.
    pub(crate) owners: u8,
}

/// Owners of a slab in groups of [`WIDEST`], the last of what is left.
pub(crate) struct Groups<'a> {
    /// Those that come.
    owners: Range<usize>,
    coming: &'a [Run],
    room: &'a mut GroupRoom,
}

/// Room for [`Groups`].
pub(crate) struct GroupRoom {
    /// The runs that reach the group.
    active: Vec<Run>,
    bundles: Vec<Bundle>,
    /// The last bundle of each vector.
    last: Vec<Option<u32>>,
}

impl GroupRoom {
    /// For bonds of so many vectors.
    pub(crate) fn new(n_vectors: usize) -> GroupRoom {
        // Few groups have bonds of one vector with more than two places.
        let n = 3 * n_vectors;
        let (active, bundles) = (Vec::with_capacity(n), Vec::with_capacity(n));
        GroupRoom { active, bundles, last: vec![None; n_vectors] }
    }

    /// Adds the bonds of some owners to those of the same vector whose other ends are as far away, where some
    /// are there already: a group that goes around the end of a row has them in two runs.
    fn add(&mut self, bundle: Bundle) {
        let last = &mut self.last[bundle.vector as usize];
        match last.map(|number| &mut self.bundles[number as usize]) {
            Some(known) if known.other == bundle.other => known.owners |= bundle.owners,
            _ => {
                *last = Some(self.bundles.len() as u32);
                self.bundles.push(bundle);
            }
        }
    }
}

impl Groups<'_> {
    /// The next group: its owners, and the bonds that some of them have. A vector may occur twice, for
    /// different owners.
    pub(crate) fn next(&mut self) -> Option<(Range<usize>, &[Bundle])> {
        let (first, end) = (self.owners.start, self.owners.end.min(self.owners.start + WIDEST));
        if first == end {
            return None;
        }
        self.owners.start = end;
        let room = &mut *self.room;
        room.active.retain(|run| run.owners().end > first);
        while let Some((run, rest)) = self.coming.split_first()
            && run.owners().start < end
        {
            room.active.push(*run);
            self.coming = rest;
        }
        room.bundles.iter().for_each(|bundle| room.last[bundle.vector as usize] = None);
        room.bundles.clear();
        for number in 0..room.active.len() {
            let run = room.active[number];
            let own = run.owners();
            let lanes = own.start.max(first) - first..own.end.min(end) - first;
            room.add(Bundle {
                vector: run.vector,
                other: (first as i64 + i64::from(run.other) - i64::from(run.owner)) as i32,
                owners: lanes.fold(0, |owners, lane| owners | 1 << lane),
            });
        }
        Some((first..end, &room.bundles))
    }
}

/// All bonds of all points, both ways, in groups of at most [`WIDEST`] points.
pub(crate) struct Directed {
    bundles: Vec<Bundle>,
    /// Where those of each group start.
    start: Vec<usize>,
}

impl Directed {
    /// The bonds of a group of points; the number of a vector is that of [`Runs::vectors`], that of one
    /// turned around so many more as there are.
    pub(crate) fn of_group(&self, group: usize) -> &[Bundle] {
        &self.bundles[self.start[group]..self.start[group + 1]]
    }

    /// Takes out the bond of a point with another, one way.
    pub(crate) fn lose(&mut self, point: usize, other: usize) {
        let (group, lane) = (point / WIDEST, point % WIDEST);
        let own = &mut self.bundles[self.start[group]..self.start[group + 1]];
        let has = |bundle: &&mut Bundle| {
            bundle.owners >> lane & 1 == 1
                && bundle.other as isize + lane as isize == other as isize
        };
        if let Some(bundle) = own.iter_mut().find(has) {
            bundle.owners &= !(1 << lane);
        }
    }
}

impl Runs {
    /// The bonds of all points both ways, in groups of one range of points after the other.
    pub(crate) fn directed<const D: usize>(
        &self,
        points: impl Iterator<Item = Range<usize>>,
    ) -> Directed {
        let n = self.n_vectors::<D>() as u32;
        let back =
            |run: &Run| Run { owner: run.other, other: run.owner, vector: run.vector + n, ..*run };
        let mut both: Vec<Run> =
            self.runs.iter().map(back).chain(self.runs.iter().copied()).collect();
        both.sort_by_key(|run| (run.owner, run.vector));
        let mut room = GroupRoom::new(2 * n as usize);
        let mut groups = Groups { owners: 0..0, coming: &both, room: &mut room };
        let mut directed = Directed { bundles: Vec::new(), start: vec![0] };
        for range in points {
            groups.owners = range;
            while let Some((_, bundles)) = groups.next() {
                directed.bundles.extend_from_slice(bundles);
                directed.start.push(directed.bundles.len());
            }
        }
        directed
    }

    /// Every bond once: its ends and the number of its vector.
    pub(crate) fn bonds(&self) -> impl Iterator<Item = ([usize; 2], usize)> + '_ {
        let of_run = |run: &Run| {
            let (i, j, vector) = (run.owner as usize, run.other as usize, run.vector as usize);
            (0..run.len as usize).map(move |k| ([i + k, j + k], vector))
        };
        self.runs.iter().flat_map(of_run)
    }

    /// The owners of a slab in groups.
    pub(crate) fn groups<'a>(
        &'a self,
        slab: usize,
        owners: Range<usize>,
        room: &'a mut GroupRoom,
    ) -> Groups<'a> {
        room.active.clear();
        Groups { owners, coming: self.of_slab(slab), room }
    }

    /// How many vectors there are.
    pub(crate) fn n_vectors<const D: usize>(&self) -> usize {
        self.vectors::<D>().len()
    }
}

/// Runs on their way.
struct Finding {
    /// In m.
    spacing: f64,
    /// How many spacings a bond may have along an axis.
    reach: i32,
    runs: Vec<Run>,
    /// The first run of the slab.
    first: usize,
    vectors: Vec<f64>,
    /// For each vector of whole spacings its number, and the last run that has it.
    known: Vec<Option<(u32, usize)>>,
}

impl Finding {
    /// Nothing where vectors are more than points.
    fn new(body: &Body, spacing: f64, horizon: f64) -> Option<Finding> {
        let reach = (horizon / spacing).ceil() + 1.0;
        let vectors = libm::pow(2.0 * reach + 1.0, body.dimension() as f64);
        (vectors < 1e3 + body.n_points() as f64).then(|| Finding {
            spacing,
            reach: reach as i32,
            runs: Vec::new(),
            first: 0,
            vectors: Vec::new(),
            known: vec![None; vectors as usize],
        })
    }

    /// Adds a bond; nothing where it is none of a lattice.
    fn add(&mut self, body: &Body, [owner, other]: [usize; 2]) -> Option<()> {
        let mut place = 0;
        let mut vector = [0.0; 3];
        let ends = body.position(owner).iter().zip(body.position(other));
        for (part, (from, to)) in vector.iter_mut().zip(ends) {
            let steps = (to - from) / self.spacing;
            let whole = steps.round();
            if (steps - whole).abs() > TOLERANCE || whole.abs() > f64::from(self.reach) {
                return None;
            }
            *part = whole * self.spacing;
            place = place * (2 * self.reach as usize + 1) + (whole as i32 + self.reach) as usize;
        }
        let next = self.runs.len();
        let (number, run) = match &mut self.known[place] {
            Some(known) => (known.0, known),
            unknown => {
                let d = body.dimension();
                let number = (self.vectors.len() / d) as u32;
                self.vectors.extend_from_slice(&vector[..d]);
                (number, unknown.insert((number, next)))
            }
        };
        // Runs of slabs before end with them.
        let last = self.runs[self.first..].get_mut(run.1.wrapping_sub(self.first));
        match last.filter(|last| last.continues_to(owner, other)) {
            Some(last) => last.len += 1,
            None => {
                run.1 = next;
                let [owner, other] = [owner as u32, other as u32];
                self.runs.push(Run { owner, other, len: 1, vector: number });
            }
        }
        Some(())
    }
}

impl Run {
    fn owners(&self) -> Range<usize> {
        self.owner as usize..(self.owner + self.len) as usize
    }

    /// Whether a bond of the same vector comes next.
    fn continues_to(&self, owner: usize, other: usize) -> bool {
        let len = self.len as usize;
        self.owner as usize + len == owner && self.other as usize + len == other
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::lattice::{Lattice, Nodes};

    fn lattice(counts: &[f64], keep: impl Fn(&[f64]) -> bool) -> Body {
        let (lower, upper) = (vec![0.0; counts.len()], counts.to_vec());
        let lattice = Lattice { lower, upper, spacing: 1.0, nodes: Nodes::Cells };
        let points = lattice.points().unwrap();
        let d = counts.len();
        let kept = points.positions.chunks(d).filter(|x| keep(x)).flatten().copied();
        // A scale and a place that are no binary fractions.
        let positions: Vec<f64> = kept.map(|x| 0.1 * x + 7.3).collect();
        let volumes = vec![1.0; positions.len() / d];
        Body::new(d, &positions, &volumes, Some(0.1))
    }

    fn found(body: &Body) -> (Neighborhood, Slabs, Option<Runs>) {
        let neighborhood = Neighborhood::new(body, 0.3).unwrap();
        let slabs = Slabs::new(&neighborhood);
        let runs = Runs::new(body, &neighborhood, &slabs);
        (neighborhood, slabs, runs)
    }

    #[test]
    fn runs_hold_every_bond_once_with_its_vector() {
        let hole = |x: &[f64]| libm::hypot(x[0] - 6.0, x[1] - 11.0) > 3.0;
        for body in [lattice(&[24.0, 22.0], hole), lattice(&[12.0, 9.0, 20.0], |_| true)] {
            let (neighborhood, slabs, runs) = found(&body);
            let runs = runs.unwrap();
            let mut bonds = BTreeSet::new();
            for slab in 0..slabs.len() {
                for run in runs.of_slab(slab) {
                    for k in 0..run.len {
                        let (owner, other) = ((run.owner + k) as usize, (run.other + k) as usize);
                        assert!(slabs.owners(slab).contains(&owner));
                        assert!(bonds.insert((owner, other)), "once");
                        let d = body.dimension();
                        let vector = &runs.vectors[run.vector as usize * d..][..d];
                        for axis in 0..d {
                            let exact = body.position(other)[axis] - body.position(owner)[axis];
                            assert!((vector[axis] - exact).abs() < 1e-14);
                        }
                    }
                }
            }
            let expected = (0..body.n_points())
                .flat_map(|i| neighborhood.upper(i).iter().map(move |j| (i, j as usize)));
            assert!(bonds.into_iter().eq(expected));
        }
    }

    #[test]
    fn clouds_and_slender_bars_have_none() {
        assert!(found(&lattice(&[60.0, 4.0, 4.0], |_| true)).2.is_none());
        let mut body = lattice(&[20.0, 20.0], |_| true);
        assert!(found(&body).2.is_some());
        let shaken: Vec<f64> =
            body.positions().iter().map(|x| x + 1e-6 * libm::sin(1e5 * x)).collect();
        body = Body::new(2, &shaken, body.volumes(), Some(0.1));
        assert!(found(&body).2.is_none());
        body = Body::new(2, body.positions(), body.volumes(), None);
        assert!(found(&body).2.is_none());
    }
}
