//! Bonds of affine laws that no lattice repeats, four at a time: geometry, law and sums in one go.
//!
//! Points have rows of four numbers, coordinates with zeros behind them, each a register: relative vectors
//! of a bond are one subtraction, and its forces one addition to the row of its other point. Only what
//! the law asks for, the square of the length and how much it has grown, is summed across registers, for
//! four bonds of an owner side by side. Of a bond two numbers are kept: its length at rest and the
//! coefficient of its law ([`super::quadratic`]), with its weight. No kernel is called.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::DiscreteEnergy;
use super::axes::Wanted;
use super::kind::{AffineLaws, Kind};
use super::registers::{Aligned, Four, Placed, Portable, Registers};
use super::sum::Sum;
use crate::element::WIDEST;
use crate::geometry::{dot, each};
use crate::neighborhood::Neighborhood;

/// Owners whose bonds are prepared at a time.
const CHUNK: usize = 1024;

/// The bonds of a body in fours, with an affine law that knows neither forces nor energy at rest.
pub(super) struct BondFours {
    /// Where the fours of each owner begin.
    start: Vec<usize>,
    /// The later points. In the last four of an owner its last bond stands for those that are missing,
    /// without weight.
    others: Vec<[u32; 4]>,
    /// Lengths at rest in m; none where laws are by squares.
    lengths: Vec<Aligned>,
    /// Coefficients of the square of what has grown.
    bent: Vec<Aligned>,
    /// How much the squares of lengths may grow before a bond may break, in m^2; none where nobody watches.
    limits: Vec<[f32; 4]>,
    /// The coefficients of bonds that were taken out.
    lost: BTreeMap<usize, f64>,
    #[cfg(target_arch = "x86_64")]
    wide: Option<pulp::x86::V3>,
}

/// Work arrays of a thread: rows of the points that a slab touches.
#[derive(Default)]
pub(super) struct FoursRoom {
    first: usize,
    places: Vec<Placed>,
    /// Of a product.
    direction: Vec<Aligned>,
    /// Forces in N, or a product.
    forces: Vec<Aligned>,
    /// Whether some bond has grown beyond its limit.
    pub(super) is_beyond: bool,
}

impl BondFours {
    /// Nothing of laws that are not affine, or of which something is left at rest.
    pub(super) fn new(energy: &DiscreteEnergy) -> Option<BondFours> {
        let kind = energy.bonds.as_ref()?;
        let laws = kind.affine_laws()?;
        let n = energy.body.n_points();
        let positions = match energy.body.dimension() {
            2 => rows::<2>(energy.body.positions()).collect(),
            _ => rows::<3>(energy.body.positions()).collect::<Vec<Four>>(),
        };
        let chunks: Vec<Range> =
            (0..n.div_ceil(CHUNK)).map(|k| k * CHUNK..n.min((k + 1) * CHUNK)).collect();
        let prepared = |owners: &Range| Prepared::new(energy, (kind, &laws), &positions, owners);
        let parts: Vec<Prepared> = chunks.par_iter().map(prepared).collect::<Option<_>>()?;
        let count = parts.iter().map(|part| part.others.len()).sum();
        let mut all = BondFours {
            start: Vec::with_capacity(n + 1),
            others: Vec::with_capacity(count),
            lengths: Vec::with_capacity(if laws.by_square { 0 } else { count }),
            bent: Vec::with_capacity(count),
            limits: Vec::new(),
            lost: BTreeMap::new(),
            #[cfg(target_arch = "x86_64")]
            wide: pulp::x86::V3::try_new(),
        };
        all.start.push(0);
        for part in parts {
            for fours in part.counts {
                all.start.push(all.start.last().copied().unwrap_or(0) + fours);
            }
            all.others.extend(part.others);
            all.bent.extend(part.bent);
            if !laws.by_square {
                all.lengths.extend(part.lengths);
            }
        }
        Some(all)
    }

    /// Takes out bonds.
    pub(super) fn lose(&mut self, neighborhood: &Neighborhood, bonds: &[usize]) {
        for &bond in bonds {
            let [owner, _] = neighborhood.ends(bond);
            let place = bond - neighborhood.bonds(owner).start;
            let four = self.start[owner] + place / 4;
            let bent = std::mem::take(&mut self.bent[four].0[place % 4]);
            self.lost.entry(bond).or_insert(bent);
            if let Some(limits) = self.limits.get_mut(four) {
                // Places behind the last bond of an owner stand for it.
                let lasts = if bond + 1 == neighborhood.bonds(owner).end {
                    place % 4..4
                } else {
                    place % 4..place % 4 + 1
                };
                limits[lasts].fill(f32::INFINITY);
            }
        }
    }

    /// Puts back bonds that were taken out; who watches has to watch anew.
    pub(super) fn regain(&mut self, neighborhood: &Neighborhood, bonds: &[usize]) {
        for bond in bonds {
            let Some(bent) = self.lost.remove(bond) else { continue };
            let [owner, _] = neighborhood.ends(*bond);
            let place = bond - neighborhood.bonds(owner).start;
            self.bent[self.start[owner] + place / 4].0[place % 4] = bent;
        }
    }

    /// Watches bonds that may grow by so much, in m^2, each by its number.
    pub(super) fn watch(&mut self, neighborhood: &Neighborhood, limits: &[f32]) {
        self.limits.clear();
        for owner in 0..neighborhood.n_points() {
            for four in limits[neighborhood.bonds(owner)].chunks(4) {
                self.limits.push(each(|lane| four[lane.min(four.len() - 1)]));
            }
        }
    }

    /// Adds up the bonds of a slab, forces, or a product with a direction, in `room`; nothing where
    /// something is not finite: then kernels name it.
    pub(super) fn add<const D: usize>(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        (u, p): (&[f64], Option<&[f64]>),
        wanted: Wanted,
        room: &mut FoursRoom,
    ) -> Option<Sum> {
        let (touched, owners) = (energy.slabs.touched(slab), energy.slabs.owners(slab));
        let numbers = touched.start * D..touched.end * D;
        let positions = rows::<D>(&energy.body.positions()[numbers.clone()]);
        let moved = positions.zip(rows::<D>(&u[numbers.clone()]));
        room.first = touched.start;
        room.places.clear();
        room.places.extend(moved.map(|(position, displacement)| Placed { position, displacement }));
        if let Some(p) = p {
            room.direction.clear();
            room.direction.extend(rows::<D>(&p[numbers]).map(Aligned));
        }
        room.forces.clear();
        room.forces.resize(touched.len(), Aligned::default());
        room.is_beyond = false;
        let mut sum = Sum::default();
        let sum_of = wanted.has_energy().then_some(&mut sum);
        let pass = Pass { fours: self, owners, room, sum: sum_of, is_product: p.is_some() };
        #[cfg(target_arch = "x86_64")]
        if let Some(wide) = self.wide {
            return pulp::Simd::vectorize(wide, OnWide { wide, pass }).then_some(sum);
        }
        pass.run(Portable).then_some(sum)
    }
}

type Range = std::ops::Range<usize>;

fn rows<const D: usize>(of: &[f64]) -> impl Iterator<Item = Four> {
    of.as_chunks::<D>().0.iter().map(|row| each(|axis| if axis < D { row[axis] } else { 0.0 }))
}

impl FoursRoom {
    /// Shows what each point has got.
    pub(super) fn each<const D: usize>(&self, mut see: impl FnMut(usize, &[f64; D])) {
        for (place, forces) in self.forces.iter().enumerate() {
            see(self.first + place, &each(|axis| forces.0[axis]));
        }
    }
}

/// The bonds of some owners.
#[derive(Default)]
struct Prepared {
    counts: Vec<usize>,
    others: Vec<[u32; 4]>,
    lengths: Vec<Aligned>,
    bent: Vec<Aligned>,
}

impl Prepared {
    fn new(
        energy: &DiscreteEnergy,
        (kind, laws): (&Kind, &AffineLaws<'_>),
        positions: &[Four],
        owners: &Range,
    ) -> Option<Prepared> {
        let weights = &kind.weights;
        let field = kind.parts_of_field(2);
        let mut all = Prepared::default();
        let mut own: Vec<u32> = Vec::new();
        for owner in owners.clone() {
            let begun = weights.begin(weights.share(owner), &[]);
            let first = energy.neighborhood.bonds(owner).start;
            own.clear();
            own.extend(energy.neighborhood.upper(owner));
            let fours = own.chunks(4);
            all.counts.push(fours.len());
            for (bonds, four) in (first..).step_by(4).zip(fours) {
                let last = four.len() - 1;
                let others: [u32; 4] = each(|lane| four[lane.min(last)]);
                let (mut lengths, mut bent) = ([0.0; 4], [0.0; 4]);
                for lane in 0..4 {
                    let other = others[lane] as usize;
                    let vector: Four = each(|k| positions[other][k] - positions[owner][k]);
                    lengths[lane] = dot(&vector, &vector).sqrt();
                    if lane > last {
                        continue;
                    }
                    let mut weight: f64 = weights.join_last(begun, weights.share(other));
                    if let Some(factors) = &kind.factors {
                        weight *= factors[bonds + lane];
                    }
                    if let Some(halves) = &field {
                        weight *= halves.at(owner) + halves.at(other);
                    }
                    let direction: Four = each(|k| vector[k] / lengths[lane]);
                    let direction = &direction[..energy.body.dimension()];
                    let parts = kind.parts_of(&[owner, other]);
                    let law = laws.at(parts, lengths[lane], direction, weight)?;
                    if law.rest != 0.0 || law.linear != 0.0 {
                        return None;
                    }
                    bent[lane] = law.bent;
                }
                all.others.push(others);
                all.lengths.push(Aligned(lengths));
                all.bent.push(Aligned(bent));
            }
        }
        Some(all)
    }
}

/// The bonds of a slab on their way.
struct Pass<'a> {
    fours: &'a BondFours,
    owners: Range,
    room: &'a mut FoursRoom,
    /// Where energies are added.
    sum: Option<&'a mut Sum>,
    is_product: bool,
}

/// What a pass gives.
const FORCES: u8 = 0;
const ENERGIES: u8 = 1;
const PRODUCTS: u8 = 2;

/// The same in registers of four numbers.
#[cfg(target_arch = "x86_64")]
struct OnWide<'a> {
    wide: pulp::x86::V3,
    pass: Pass<'a>,
}

#[cfg(target_arch = "x86_64")]
impl pulp::WithSimd for OnWide<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> bool {
        self.pass.run(self.wide)
    }
}

impl Pass<'_> {
    /// Whether all is finite.
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) -> bool {
        let of = match (self.is_product, self.sum.is_some()) {
            (true, _) => PRODUCTS,
            (false, true) => ENERGIES,
            (false, false) => FORCES,
        };
        match (self.fours.limits.is_empty(), of) {
            (_, PRODUCTS) => self.sweep_by::<R, PRODUCTS, false>(registers),
            (true, ENERGIES) => self.sweep_by::<R, ENERGIES, false>(registers),
            (true, _) => self.sweep_by::<R, FORCES, false>(registers),
            (false, ENERGIES) => self.sweep_by::<R, ENERGIES, true>(registers),
            (false, _) => self.sweep_by::<R, FORCES, true>(registers),
        }
    }

    #[inline(always)]
    fn sweep_by<R: Registers, const OF: u8, const WATCHES: bool>(self, registers: R) -> bool {
        match self.fours.lengths.is_empty() {
            true => self.sweep::<R, true, OF, WATCHES>(registers),
            false => self.sweep::<R, false, OF, WATCHES>(registers),
        }
    }

    #[inline(always)]
    fn sweep<R: Registers, const BY_SQUARE: bool, const OF: u8, const WATCHES: bool>(
        mut self,
        r: R,
    ) -> bool {
        let BondFours { start, others, lengths, bent, limits, .. } = self.fours;
        let FoursRoom { first, ref places, ref direction, ref mut forces, ref mut is_beyond } =
            *self.room;
        let (places, direction, forces) = (&places[..], &direction[..], &mut forces[..]);
        let zero = r.row(&[0.0; 4]);
        let mut refused = zero;
        let mut beyond = r.row(&[f64::NEG_INFINITY; 4]);
        for owner in self.owners {
            let here = &places[owner - first];
            let (rest, moved) = (r.row(&here.position), r.row(&here.displacement));
            let towards = if OF == PRODUCTS { r.row(&direction[owner - first].0) } else { zero };
            let mut own = zero;
            let range = start[owner]..start[owner + 1];
            let lengths = if BY_SQUARE { &[][..] } else { &lengths[range.clone()] };
            let limits = if WATCHES { &limits[range.clone()] } else { &[][..] };
            let fours = others[range.clone()].iter().zip(&bent[range]);
            for (four, (others, bent)) in fours.enumerate() {
                let others: [usize; 4] = others.map(|other| other as usize - first);
                let ends = others.map(|other| &places[other]);
                let eta = ends.map(|end| r.subtract(r.row(&end.displacement), moved));
                let xi = ends.map(|end| r.subtract(r.row(&end.position), rest));
                let x: [R::Row; 4] = each(|k| r.add(xi[k], eta[k]));
                // l^2 - L^2, without the digits that the difference would lose.
                let grown = r.sums(each(|k| r.multiply(eta[k], r.add(xi[k], x[k]))));
                if WATCHES {
                    let limit = r.row(&limits[four].map(f64::from));
                    beyond = r.larger(r.subtract(grown, limit), beyond);
                }
                let bent = r.row(&bent.0);
                let twice = r.add(bent, bent);
                let four_times = r.add(twice, twice);
                let length = if BY_SQUARE {
                    None
                } else {
                    let now = r.root(r.sums(each(|k| r.multiply(x[k], x[k]))));
                    let at_rest = r.row(&lengths[four].0);
                    Some((now, at_rest, r.add(now, at_rest)))
                };
                // The derivative by l^2/2, with one quotient: they take longest.
                let pull = match length {
                    None => r.multiply(four_times, grown),
                    Some((now, _, sum)) => r.divide(r.multiply(twice, grown), r.multiply(sum, now)),
                };
                refused = r.add(refused, r.multiply(pull, zero));
                let pulls = r.spread(pull);
                let mut parts: [R::Row; 4] = each(|k| r.multiply(pulls[k], x[k]));
                if OF == PRODUCTS {
                    let along = others.map(|other| r.subtract(r.row(&direction[other].0), towards));
                    let second = match length {
                        None => r.add(four_times, four_times),
                        Some((now, at_rest, _)) => {
                            let cube = r.multiply(now, r.multiply(now, now));
                            r.divide(r.multiply(twice, at_rest), cube)
                        }
                    };
                    let stretched = r.sums(each(|k| r.multiply(x[k], along[k])));
                    let stretched = r.multiply(second, stretched);
                    refused = r.add(refused, r.multiply(stretched, zero));
                    let stretched = r.spread(stretched);
                    parts = each(|k| {
                        r.add(r.multiply(pulls[k], along[k]), r.multiply(stretched[k], x[k]))
                    });
                }
                for k in 0..4 {
                    own = r.add(own, parts[k]);
                    let row = &mut forces[others[k]].0;
                    *row = r.numbers(r.add(r.row(row), parts[k]));
                }
                if OF == ENERGIES
                    && let Some(sum) = &mut self.sum
                {
                    let t = length.map_or(grown, |(_, _, sum)| r.divide(grown, sum));
                    let energies = r.numbers(r.multiply(r.multiply(bent, t), t));
                    let mut terms = [0.0; WIDEST];
                    terms[..4].copy_from_slice(&energies);
                    sum.add(&terms);
                }
            }
            let row = &mut forces[owner - first].0;
            *row = r.numbers(r.subtract(r.row(row), own));
        }
        *is_beyond = r.numbers(beyond).iter().any(|x| *x >= 0.0);
        r.numbers(refused).iter().all(|x| *x == 0.0)
    }
}
