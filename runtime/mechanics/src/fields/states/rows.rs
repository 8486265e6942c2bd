//! Gathered states along the rows of a lattice, without neighbour lists and kernels of bonds.
//!
//! Where integrands and the energies of bonds are polynomials of second degree in the length, what a bond
//! adds is known from a few numbers at rest: those of integrands from its vector, that of its own energy,
//! which knows its ends by what they have gathered at rest, bond by bond. Points have kernels as ever.
//! Whatever is not finite is refused and goes as on clouds, where it is named.

use std::sync::atomic::{AtomicBool, Ordering};

use pulp::Arch;
use rayon::prelude::*;

use super::StateEnergy;
use super::gaps::Gaps;
use super::passes::{States, Work, clear};
use super::sweep::{AtPoints, Gathering, Pass, Pulling};
use crate::assembly::quadratic::{AffineLaw, Quadratic};
use crate::assembly::sum::Sum;
use crate::element::WIDEST;
use crate::energy::Hessian;
use crate::geometry::{dot, each};
use crate::interaction::runs::Runs;
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::kernel::{Variables, VariablesLaw};
use crate::materials::{Fields, StateOf};
use crate::neighborhood::Neighborhood;
use crate::pool::{Pool, Taken};
use crate::vector::are_finite;

/// Most integrals that change.
const MOST: usize = 2;

/// What is known of the bonds of a lattice.
pub(super) struct AlongRows {
    pub(super) runs: Runs,
    /// The integrals that change, as far as energies are functions of them.
    changing: Vec<usize>,
    /// Of each vector their integrands.
    pub(super) integrands: Vec<[Quadratic; MOST]>,
    /// How many there are; one of nothing where there are none.
    n_integrands: usize,
    /// Of each bond, run by run, with room behind: `V_i V_j` times the mean over both ends of the
    /// derivative of its energy at rest, where it is not 0, and of half the second.
    pub(super) linear: Option<Vec<f64>>,
    pub(super) bent: Vec<f64>,
    /// The energy of bonds at rest, in J.
    pub(super) at_rest: f64,
    /// The first bond of each slab.
    first_bond: Vec<usize>,
    /// Where bonds are lost.
    pub(super) gaps: Option<Box<Gaps>>,
    /// Where somebody watches.
    pub(super) watched: Option<Watched>,
    /// With room before and behind.
    pub(super) volumes: Vec<f64>,
    arch: Arch,
    room: Pool<Room>,
    slabs: Pool<OfSlab>,
}

/// Numbers of points for a pass over the body.
#[derive(Default)]
struct Room {
    displacement: Vec<f64>,
    direction: Vec<f64>,
    adjoint: Vec<f64>,
    change: Vec<f64>,
    /// What points gather of a product.
    gathered: Vec<f64>,
    /// Energies of slabs; nothing where something is not finite.
    energies: Vec<Option<Sum>>,
}

/// Bonds that are watched.
pub(super) struct Watched {
    /// How much longer a bond of each vector may become before it may break, in m.
    pub(super) limits: Vec<f64>,
    /// Whether some of each slab were beyond that when energies were last worked out.
    are_beyond: Vec<AtomicBool>,
}

impl Watched {
    pub(super) fn note(&self, slab: usize, is_beyond: bool) {
        self.are_beyond[slab].store(is_beyond, Ordering::Relaxed);
    }

    pub(super) fn is_beyond(&self, slab: usize) -> bool {
        self.are_beyond[slab].load(Ordering::Relaxed)
    }
}

/// What the points that a slab touches get.
struct OfSlab {
    own: Vec<f64>,
    other: Vec<f64>,
}

impl OfSlab {
    /// Large enough for every slab.
    fn new(energy: &StateEnergy) -> OfSlab {
        let points = (0..energy.slabs.len()).map(|slab| energy.slabs.touched(slab).len()).max();
        let kinds = energy.body.dimension().max(MOST);
        let room = || Vec::with_capacity(kinds * (points.unwrap_or(0) + 2 * WIDEST));
        OfSlab { own: room(), other: room() }
    }
}

impl AlongRows {
    /// Nothing where laws are others or bonds do not repeat.
    pub(super) fn new(energy: &StateEnergy) -> Option<AlongRows> {
        // What no energy is a function of need not be gathered.
        let is_wanted = energy.laws.points.is_some();
        let changing = if is_wanted { energy.changing.clone() } else { Vec::new() };
        let laws = changing.iter().map(|&k| AffineLaw::by_measure(&*energy.laws.integrals[k]));
        let laws: Vec<AffineLaw<'_>> = laws.collect::<Option<_>>()?;
        let is_fixed = |k: usize| !energy.changing.contains(&k);
        let of_bonds = energy.laws.bonds.as_ref();
        // What bonds have at rest is known once.
        let changes = |fields: &Fields| {
            !fields.is_steady() || fields.have_states(0..fields.len(), Some(StateOf::Points))
        };
        if of_bonds.is_some() && energy.fields().is_some_and(changes) {
            return None;
        }
        if laws.len() > MOST || of_bonds.is_some_and(|law| !law.is_affine_beside(&is_fixed)) {
            return None;
        }
        let runs = Runs::new(&energy.body, &energy.neighborhood, &energy.slabs)?;
        let lengths: Vec<f64> = match energy.body.dimension() {
            2 => runs.vectors::<2>().iter().map(|x| dot(x, x).sqrt()).collect(),
            _ => runs.vectors::<3>().iter().map(|x| dot(x, x).sqrt()).collect(),
        };
        let of_vector = |length: &f64| {
            let mut all = [Quadratic { reference: *length, ..Quadratic::default() }; MOST];
            for (of, law) in all.iter_mut().zip(&laws) {
                *of = law.at(*length, &[], 1.0)?;
            }
            Some(all)
        };
        let integrands = lengths.iter().map(of_vector).collect::<Option<_>>()?;
        let Bonds { linear, bent, at_rest } = Bonds::new(energy, &runs, &lengths)?;
        let room = [0.0; WIDEST];
        let is_stressed = linear.iter().any(|x| *x != 0.0);
        Some(AlongRows {
            runs,
            integrands,
            n_integrands: laws.len().max(1),
            changing,
            linear: is_stressed.then_some(linear),
            bent,
            at_rest,
            first_bond: (0..energy.slabs.len()).map(|slab| energy.bonds_of(slab).start).collect(),
            gaps: None,
            watched: None,
            volumes: [&room, energy.body.volumes(), &room].concat(),
            arch: Arch::new(),
            room: Pool::new(),
            slabs: Pool::new(),
        })
    }

    /// See [`crate::energy::Energy::watch`]; bonds by their numbers in the `whole` families. Of all with one vector the
    /// least counts.
    pub(super) fn watch(&mut self, whole: &Neighborhood, limits: &[f32], n_slabs: usize) {
        let mut least = vec![f64::INFINITY; self.integrands.len()];
        for (ends, vector) in self.runs.bonds() {
            let length = self.integrands[vector][0].reference;
            let bond = whole.bond_between(ends);
            let grown = bond.map_or(f64::NEG_INFINITY, |bond| f64::from(limits[bond]));
            let square = length * length + grown;
            let longer = match square > 0.0 && grown < f64::INFINITY {
                true => grown / (square.sqrt() + length),
                false => grown,
            };
            least[vector] = least[vector].min(longer);
        }
        let are_beyond = (0..n_slabs).map(|_| AtomicBool::new(true)).collect();
        self.watched = Some(Watched { limits: least, are_beyond });
    }

    /// Nobody knows which bonds are beyond their limits.
    pub(super) fn note_nothing(&self) {
        if let Some(watched) = &self.watched {
            (0..watched.are_beyond.len()).for_each(|slab| watched.note(slab, true));
        }
    }

    /// From one kind of number of points to the next.
    pub(super) fn stride(&self) -> usize {
        self.volumes.len()
    }

    /// The energies of points and of bonds and, unless `out` is absent, the derivative of their sum;
    /// nothing where something is not finite.
    pub(super) fn assemble<const D: usize>(
        &self,
        energy: &StateEnergy,
        u: &[f64],
        out: Option<&mut [f64]>,
    ) -> Option<[f64; 2]> {
        let mut room = self.room.take(Room::default);
        let (states, bonds) = self.states::<D>(energy, u, out.is_some(), &mut room)?;
        if let Some(out) = out {
            out.fill(0.0);
            let Room { displacement, adjoint, energies, .. } = &mut *room;
            let points = AtPoints { displacement, adjoint, ..AtPoints::default() };
            self.pull::<D, false>(energy, points, energies, out)?;
            if !are_finite(out) {
                return None;
            }
        }
        let points = Sum::of_products(&states.points, energy.body.volumes()).value();
        Some([points, bonds + self.at_rest])
    }

    /// What points gather, with their energies and the energy of bonds; in `room` the derivatives by the
    /// integrals where they are wanted. Nothing where something is not finite.
    fn states<'a, const D: usize>(
        &self,
        energy: &'a StateEnergy,
        u: &[f64],
        with_slopes: bool,
        room: &mut Room,
    ) -> Option<(Taken<'a, States>, f64)> {
        let (m, n) = (energy.n_integrals(), energy.body.n_points());
        energy.work.provide(|| Work::new(energy));
        self.slabs.provide(|| OfSlab::new(energy));
        self.columns::<D>(u, &mut room.displacement);
        let mut taken = energy.states.take(States::default);
        let states = &mut *taken;
        states.integrals.clear();
        states.integrals.extend_from_slice(&energy.at_rest);
        let points = AtPoints { displacement: &room.displacement, ..AtPoints::default() };
        let to = (m, &self.changing[..]);
        self.gather::<D, false>(energy, points, to, &mut room.energies, &mut states.integrals);
        let mut bonds = Sum::default();
        for sum in &room.energies {
            bonds.join(sum.as_ref()?);
        }
        clear(&mut states.points, n);
        clear(&mut states.adjoint, n * m);
        energy.of_points(with_slopes, states);
        if !(are_finite(&states.points) && are_finite(&states.adjoint)) {
            return None;
        }
        let adjoint = |point: usize, k: usize| match self.changing.get(k) {
            Some(integral) => states.adjoint[point * m + integral],
            None => 0.0,
        };
        self.kinds(adjoint, &mut room.adjoint);
        Some((taken, bonds.value()))
    }

    /// `out` becomes vectors of points (`n x d`) axis by axis.
    fn columns<const D: usize>(&self, vectors: &[f64], out: &mut Vec<f64>) {
        out.resize(D * self.stride(), 0.0);
        out.par_chunks_mut(self.stride()).enumerate().for_each(|(axis, out)| {
            let vectors = vectors.as_chunks::<D>().0;
            out[WIDEST..].iter_mut().zip(vectors).for_each(|(out, x)| *out = x[axis]);
        });
    }

    /// `out` becomes what points have of each integral that changes.
    fn kinds(&self, number: impl Fn(usize, usize) -> f64 + Sync, out: &mut Vec<f64>) {
        out.resize(self.n_integrands * self.stride(), 0.0);
        out.par_chunks_mut(self.stride()).enumerate().for_each(|(k, out)| {
            let end = out.len() - WIDEST;
            let points = out[WIDEST..end].iter_mut().enumerate();
            points.for_each(|(point, out)| *out = number(point, k));
        });
    }

    /// Adds what points gather to `out`, which has so many numbers of each point, those of integrands at
    /// these places.
    fn gather<const D: usize, const PRODUCT: bool>(
        &self,
        energy: &StateEnergy,
        points: AtPoints<'_>,
        (width, places): (usize, &[usize]),
        energies: &mut Vec<Option<Sum>>,
        out: &mut [f64],
    ) {
        energies.clear();
        energies.resize(energy.slabs.len(), None);
        let shared = Part::new(Layout::Points(width), out);
        let own = Part::new(Layout::Slabs, energies);
        visit(&energy.slabs, shared, own, |slab, [here, next], sum| {
            let mut out = Touched::new(here, next);
            let mut got = self.slabs.take(|| OfSlab::new(energy));
            let pass = self.pass(energy, slab, points, self.n_integrands, &mut got);
            sum.into_values()[0] = match self.n_integrands {
                1 => self.arch.dispatch(Gathering::<D, 1, PRODUCT>(pass)),
                _ => self.arch.dispatch(Gathering::<D, MOST, PRODUCT>(pass)),
            };
            let stride = got.own.len() / self.n_integrands;
            for (at, point) in energy.slabs.touched(slab).enumerate() {
                for (k, place) in places.iter().enumerate() {
                    let at = k * stride + at + WIDEST;
                    out[point * width + place] += got.own[at] + got.other[at];
                }
            }
        });
    }

    /// Adds forces or a product to `out`; nothing where something is not finite.
    fn pull<const D: usize, const PRODUCT: bool>(
        &self,
        energy: &StateEnergy,
        points: AtPoints<'_>,
        fine: &mut Vec<Option<Sum>>,
        out: &mut [f64],
    ) -> Option<()> {
        fine.clear();
        fine.resize(energy.slabs.len(), None);
        let shared = Part::new(Layout::Points(1), out.as_chunks_mut::<D>().0);
        let own = Part::new(Layout::Slabs, fine);
        visit(&energy.slabs, shared, own, |slab, [here, next], is_fine| {
            let mut out = Touched::new(here, next);
            let mut got = self.slabs.take(|| OfSlab::new(energy));
            let pass = self.pass(energy, slab, points, D, &mut got);
            let all_finite = match self.n_integrands {
                1 => self.arch.dispatch(Pulling::<D, 1, PRODUCT>(pass)),
                _ => self.arch.dispatch(Pulling::<D, MOST, PRODUCT>(pass)),
            };
            is_fine.into_values()[0] = all_finite.then(Sum::default);
            let stride = got.own.len() / D;
            for (at, point) in energy.slabs.touched(slab).enumerate() {
                let force = &mut out[point];
                for axis in 0..D {
                    let at = axis * stride + at + WIDEST;
                    force[axis] += got.other[at] - got.own[at];
                }
            }
        });
        fine.iter().all(Option::is_some).then_some(())
    }

    fn pass<'a>(
        &'a self,
        energy: &StateEnergy,
        slab: usize,
        points: AtPoints<'a>,
        kinds: usize,
        got: &'a mut OfSlab,
    ) -> Pass<'a> {
        let touched = energy.slabs.touched(slab);
        let numbers = kinds * (touched.len() + 2 * WIDEST);
        let OfSlab { own, other } = got;
        clear(own, numbers);
        clear(other, numbers);
        let (first, first_bond) = (touched.start, self.first_bond[slab]);
        Pass { rows: self, slab, first, first_bond, points, own, other }
    }

    /// The Hessian at `u`; nothing where something is not finite.
    pub(super) fn hessian<'a, const D: usize>(
        &'a self,
        energy: &'a StateEnergy,
        u: &[f64],
    ) -> Option<RowHessian<'a, D>> {
        let mut room = self.room.take(Room::default);
        let (states, _) = self.states::<D>(energy, u, true, &mut room)?;
        let by_states = energy.seconds_of_points(&states, &self.changing);
        are_finite(&by_states).then_some(RowHessian { rows: self, energy, room, by_states })
    }
}

/// The Hessian at some displacements. Geometry is worked out again in each product: that is faster than
/// to read it.
pub(super) struct RowHessian<'a, const D: usize> {
    rows: &'a AlongRows,
    energy: &'a StateEnergy,
    /// Holds displacements and adjoints.
    room: Taken<'a, Room>,
    /// `d2w/dI2` of points, row by row.
    by_states: Vec<f64>,
}

impl<const D: usize> Hessian for RowHessian<'_, D> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        let RowHessian { rows, energy, room: at, by_states } = self;
        assert!(p.len() == energy.body.positions().len() && product.len() == p.len(), "n x d");
        let mut room = rows.room.take(Room::default);
        let Room { direction, change, gathered, energies, .. } = &mut *room;
        rows.columns::<D>(p, direction);
        let (displacement, adjoint) = (&at.displacement[..], &at.adjoint[..]);
        let points = AtPoints { displacement, direction, adjoint, change: &[] };
        let a = rows.changing.len();
        clear(gathered, energy.body.n_points() * a);
        if a > 0 {
            let places: [usize; MOST] = each(|k| k);
            let to = (a, &places[..a]);
            rows.gather::<D, true>(energy, points, to, energies, gathered);
        }
        let of_point = |point: usize, k: usize| {
            let row = by_states.iter().skip((point * a + k) * a).take(a);
            let own = gathered.iter().skip(point * a);
            row.zip(own).fold(0.0, |sum, (s, x)| sum + s * x)
        };
        rows.kinds(of_point, change);
        product.fill(0.0);
        let points = AtPoints { change, ..points };
        // What is not finite was refused before, unless the direction is not.
        let _ = rows.pull::<D, true>(energy, points, energies, product);
    }
}

/// The energies of bonds, run by run, with room behind.
struct Bonds {
    linear: Vec<f64>,
    bent: Vec<f64>,
    at_rest: f64,
}

impl Bonds {
    /// Nothing where something is not finite.
    fn new(energy: &StateEnergy, runs: &Runs, lengths: &[f64]) -> Option<Bonds> {
        let n = energy.neighborhood.n_bonds();
        let [mut linear, mut bent] = [(); 2].map(|()| vec![0.0; n + WIDEST]);
        let mut at_rest = vec![Sum::default(); energy.slabs.len()];
        let own = (
            Part::new(energy.per_bond(1), &mut linear[..n]),
            Part::new(energy.per_bond(1), &mut bent[..n]),
            Part::new(Layout::Slabs, &mut at_rest),
        );
        visit(&energy.slabs, (), own, |slab, _, (linear, bent, at_rest)| {
            let all = (linear.into_values(), bent.into_values(), &mut at_rest.into_values()[0]);
            Bonds::of_slab(energy, (runs, lengths), slab, all);
        });
        let mut all = Sum::default();
        at_rest.iter().for_each(|sum| all.join(sum));
        let at_rest = all.value();
        let all_finite = are_finite(&linear) && are_finite(&bent) && at_rest.is_finite();
        all_finite.then_some(Bonds { linear, bent, at_rest })
    }

    fn of_slab(
        energy: &StateEnergy,
        (runs, lengths): (&Runs, &[f64]),
        slab: usize,
        (linear, bent, at_rest): (&mut [f64], &mut [f64], &mut Sum),
    ) {
        let Some(law) = &energy.laws.bonds else { return };
        let (m, volumes) = (energy.n_integrals(), energy.body.volumes());
        let (mut run_at_rest, mut lengths_of_run) = (AtRest::default(), Vec::new());
        let mut bond = 0;
        for run in runs.of_slab(slab) {
            let (i, j, n) = (run.owner as usize, run.other as usize, run.len as usize);
            for end in [i, j] {
                let integrals = &energy.at_rest[end * m..(end + n) * m];
                let law = (&**law, energy.laws_of(end..end + n));
                let length = lengths[run.vector as usize];
                let given = &mut run_at_rest.given;
                given.clear();
                given.resize(n, length);
                energy.give(n, |k| [i + k, j + k], given);
                lengths_of_run.clear();
                lengths_of_run.resize(n, length);
                run_at_rest.evaluate(law, &lengths_of_run, integrals);
                let AtRest { psi, slopes, bends, .. } = &mut run_at_rest;
                for k in 0..n {
                    let half = 0.5 * volumes[i + k] * volumes[j + k];
                    psi[k] *= half;
                    linear[bond + k] += half * slopes[k];
                    bent[bond + k] += half * 0.5 * bends[k];
                }
                psi.resize(n.next_multiple_of(WIDEST), 0.0);
                at_rest.add(psi);
            }
            bond += n;
        }
    }
}

/// Bonds at rest, with what one of their ends has gathered, before their law.
#[derive(Default)]
pub(super) struct AtRest {
    integrals: Vec<f64>,
    variables: Vec<f64>,
    change: Vec<f64>,
    /// Lengths, and fields.
    pub(super) given: Vec<f64>,
    direction: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// First derivatives by all variables, and what the length changes them by.
    pub(super) slopes: Vec<f64>,
    pub(super) bends: Vec<f64>,
}

impl AtRest {
    /// Of bonds of these lengths, with the integrals of their ends; what is given is filled in.
    pub(super) fn evaluate(
        &mut self,
        (law, laws): (&dyn VariablesLaw, &[u8]),
        lengths: &[f64],
        integrals: &[f64],
    ) {
        let n = lengths.len();
        let m = integrals.len() / n;
        super::by_variables(integrals, m, &mut self.integrals);
        self.variables.clear();
        self.variables.extend_from_slice(lengths);
        self.variables.extend_from_slice(&self.integrals);
        self.direction.clear();
        self.direction.resize(n, 1.0);
        self.direction.resize((1 + m) * n, 0.0);
        clear(&mut self.change, n);
        clear(&mut self.psi, n);
        clear(&mut self.slopes, (1 + m) * n);
        clear(&mut self.bends, (1 + m) * n);
        let (current, change) = (&self.variables[..], &self.change[..]);
        let at = Variables { n, current, change, given: &self.given, laws };
        law.evaluate(at, &mut self.psi, &mut self.slopes);
        law.product(at, &self.direction, &mut self.bends);
    }
}
