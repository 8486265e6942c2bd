//! Bonds of affine laws on a lattice, run by run: geometry, law and sums in one go.
//!
//! Lanes of a register are the bonds of consecutive points. What a bond is at rest stands in the vector
//! of its run; displacements come from arrays of one axis each, and forces go to such arrays: nothing is
//! looked up and nothing scattered. Of an affine law three numbers at rest say everything (see
//! [`Law::is_affine`]), so no kernel is called.

use pulp::{Arch, Simd, WithSimd};

use super::sum::Sum;
use super::{DiscreteEnergy, Kind};
use crate::element::WIDEST;
use crate::geometry::bond::Bond;
use crate::geometry::lanes::Lanes;
use crate::geometry::squares::{Root, Squares};
use crate::geometry::{Scalar, dot, each};
use crate::interaction::runs::{Run, Runs};
use crate::kernel::{Batch, Law, Order, Outputs};
use crate::weights::CliqueWeights;

/// The bonds of a body in runs, with an affine law.
pub(super) struct BondRuns {
    runs: Runs,
    /// Of each vector of the runs.
    laws: Vec<Quadratic>,
    /// Whether laws are by `l^2 - L^2`, else by `l - L`.
    by_square: bool,
    /// What is left of weights where they are not the same for all, with room for a register behind.
    shares: Option<Shares>,
    arch: Arch,
}

/// The energy of the bonds of one vector, `rest + t*(linear + bent*t)` in J, where `t` is in m or m^2,
/// times what their weights have in common.
#[derive(Clone, Copy, Debug)]
struct Quadratic {
    /// In m.
    length: f64,
    rest: f64,
    linear: f64,
    bent: f64,
}

/// What points have in the weights of their bonds.
struct Shares {
    values: Vec<f64>,
    /// Whether they are added, else multiplied.
    are_added: bool,
}

impl BondRuns {
    /// Nothing where bonds do not repeat, and of laws that are not affine.
    pub(super) fn new(energy: &DiscreteEnergy, kind: &Kind) -> Option<BondRuns> {
        let (law, arch) = kind.element.law()?;
        let square = law.squared().filter(|law| law.is_affine());
        let by_square = square.is_some();
        let law = square.or(Some(law).filter(|law| law.is_affine()))?;
        let (common, shares) = Shares::of(&kind.weights);
        let runs = Runs::new(&energy.body, &energy.neighborhood, &energy.slabs)?;
        let lengths: Vec<f64> = match energy.body.dimension() {
            2 => runs.vectors::<2>().iter().map(|vector| dot(vector, vector).sqrt()).collect(),
            _ => runs.vectors::<3>().iter().map(|vector| dot(vector, vector).sqrt()).collect(),
        };
        let of_length = |length: &f64| Quadratic::new(law, by_square, *length, common);
        let laws = lengths.iter().map(of_length).collect::<Option<_>>()?;
        Some(BondRuns { runs, laws, by_square, shares, arch })
    }
}

impl Quadratic {
    /// From psi, psi' and psi'' at rest; nothing where they are not finite.
    fn new(law: &dyn Law, by_square: bool, length: f64, weight: f64) -> Option<Quadratic> {
        let (at, [mut psi, mut dpsi, mut d2psi]) = ([length], [[0.0]; 3]);
        let batch = Batch { measure: &at, reference: &at, change: &[0.0] };
        let out = Outputs { psi: &mut psi, dpsi: &mut dpsi, d2psi: &mut d2psi };
        law.evaluate(batch, Order::Tangent, out);
        // By `q = l^2/L`, of which `l^2 - L^2` is `L` times the change.
        let scale = if by_square { 1.0 / length } else { 1.0 };
        let rest = weight * psi[0];
        let linear = weight * (dpsi[0] * scale);
        let bent = weight * (0.5 * d2psi[0] * scale * scale);
        let all = [rest, linear, bent];
        all.iter().all(|x| x.is_finite()).then_some(Quadratic { length, rest, linear, bent })
    }
}

impl Shares {
    /// What all weights have in common, and what is left of them.
    fn of(weights: &CliqueWeights) -> (f64, Option<Shares>) {
        let (factor, shares, are_added) = match weights {
            CliqueWeights::Unit => return (1.0, None),
            CliqueWeights::Sum { factor, shares } => (*factor, shares, true),
            CliqueWeights::Product { factor, shares } => (*factor, shares, false),
        };
        let first = shares.first().copied().unwrap_or(0.0);
        if shares.iter().all(|share| *share == first) {
            let both = if are_added { first + first } else { first * first };
            return (factor * both, None);
        }
        let values = shares.iter().copied().chain([0.0; WIDEST]).collect();
        (factor, Some(Shares { values, are_added }))
    }
}

/// Work arrays for the runs of a slab: one number after the other for each axis, with room for a
/// register behind.
#[derive(Default)]
pub(super) struct RunRoom {
    displacement: Vec<f64>,
    direction: Vec<f64>,
    /// What points get as owners of bonds, to be taken off, and as their other ends.
    own: Vec<f64>,
    other: Vec<f64>,
}

impl RunRoom {
    /// Large enough for every slab.
    pub(super) fn new(energy: &DiscreteEnergy) -> RunRoom {
        let points = (0..energy.slabs.len()).map(|slab| energy.slabs.touched(slab).len()).max();
        let numbers = (points.unwrap_or(0) + WIDEST) * energy.body.dimension();
        let room = || Vec::with_capacity(numbers);
        RunRoom { displacement: room(), direction: room(), own: room(), other: room() }
    }
}

/// What the bonds of a slab give.
pub(super) struct OfRuns<'a> {
    pub(super) energy: Sum,
    /// Forces or a product, axis by axis.
    own: &'a [f64],
    other: &'a [f64],
    stride: usize,
    first: usize,
}

impl OfRuns<'_> {
    /// Shows what each point gets.
    pub(super) fn each<const D: usize>(&self, mut see: impl FnMut(usize, &[f64; D])) {
        for place in 0..self.stride - WIDEST {
            let part = |axis: usize| {
                self.other[axis * self.stride + place] - self.own[axis * self.stride + place]
            };
            see(self.first + place, &each(part));
        }
    }
}

/// What is wanted of the bonds of a slab.
#[derive(Clone, Copy)]
pub(super) enum Of<'a> {
    /// Energies and forces, as far as the order asks for them.
    Energy(Order),
    /// The Hessian times a vector of all points.
    Product(&'a [f64]),
}

impl BondRuns {
    /// Works out the bonds of a slab at displacements `u`; nothing where something is not finite.
    pub(super) fn visit<'r, const D: usize>(
        &self,
        energy: &DiscreteEnergy,
        slab: usize,
        (u, of): (&[f64], Of<'_>),
        room: &'r mut RunRoom,
    ) -> Option<OfRuns<'r>> {
        let touched = energy.slabs.touched(slab);
        let stride = touched.len() + WIDEST;
        let points = touched.start * D..touched.end * D;
        by_axes::<D>(&u[points.clone()], &mut room.displacement);
        if let Of::Product(p) = of {
            by_axes::<D>(&p[points], &mut room.direction);
        }
        for force in [&mut room.own, &mut room.other] {
            force.clear();
            force.resize(stride * D, 0.0);
        }
        let mut sum = Sum::default();
        let has_energy = matches!(of, Of::Energy(order) if order.has_energy());
        let has_forces = !matches!(of, Of::Energy(Order::Energy));
        let pass = Pass::<D> {
            runs: self,
            slab,
            first: touched.start,
            stride,
            displacement: &room.displacement,
            direction: &room.direction,
            own: &mut room.own,
            other: &mut room.other,
            energy: has_energy.then_some(&mut sum),
            has_forces,
        };
        let is_fine = match (self.by_square, matches!(of, Of::Product(_))) {
            (false, false) => self.arch.dispatch(Sweep::<D, false, false>(pass)),
            (false, true) => self.arch.dispatch(Sweep::<D, false, true>(pass)),
            (true, false) => self.arch.dispatch(Sweep::<D, true, false>(pass)),
            (true, true) => self.arch.dispatch(Sweep::<D, true, true>(pass)),
        };
        let found = OfRuns {
            energy: sum,
            own: &room.own,
            other: &room.other,
            stride,
            first: touched.start,
        };
        is_fine.then_some(found)
    }
}

/// From point by point to axis by axis.
fn by_axes<const D: usize>(rows: &[f64], axes: &mut Vec<f64>) {
    axes.clear();
    for axis in 0..D {
        axes.extend(rows.as_chunks::<D>().0.iter().map(|row| row[axis]));
        axes.extend([0.0; WIDEST]);
    }
}

/// The runs of a slab on their way.
struct Pass<'a, const D: usize> {
    runs: &'a BondRuns,
    slab: usize,
    /// The first point that the slab touches.
    first: usize,
    /// From one axis to the next.
    stride: usize,
    displacement: &'a [f64],
    direction: &'a [f64],
    own: &'a mut [f64],
    other: &'a mut [f64],
    /// Where energies are added.
    energy: Option<&'a mut Sum>,
    has_forces: bool,
}

/// The same for laws by lengths or their squares, for forces or products. Gives back whether all is
/// finite.
struct Sweep<'a, const D: usize, const SQUARE: bool, const PRODUCT: bool>(Pass<'a, D>);

/// As many ones as lanes of a register hold a bond, from so many places before the middle on.
const ONES_AND_ZEROS: [f64; 2 * WIDEST] =
    [1., 1., 1., 1., 1., 1., 1., 1., 0., 0., 0., 0., 0., 0., 0., 0.];

impl<const D: usize, const SQUARE: bool, const PRODUCT: bool> WithSimd
    for Sweep<'_, D, SQUARE, PRODUCT>
{
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Pass { runs, slab, first, stride, .. } = self.0;
        let vectors = runs.runs.vectors::<D>();
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let mut out = Added { refused: zero, energy: self.0.energy, has_forces: self.0.has_forces };
        let u: [&[f64]; D] = each(|axis| axis_of(self.0.displacement, axis, stride));
        let p: [&[f64]; D] =
            if PRODUCT { each(|axis| axis_of(self.0.direction, axis, stride)) } else { [&[]; D] };
        let mut own = axes_of::<D>(self.0.own, stride);
        let mut other = axes_of::<D>(self.0.other, stride);
        for run in runs.runs.of_slab(slab) {
            let bond = Repeated::new(simd, &vectors[run.vector as usize], &runs.laws, run);
            let [i, j] = [run.owner, run.other].map(|point| point as usize - first);
            let len = run.len as usize;
            let padded = len.next_multiple_of(Lanes::<S>::WIDTH);
            let mut ends = Ends::<S, D> {
                u: [registers_of::<S, D>(&u, i, padded), registers_of::<S, D>(&u, j, padded)],
                p: if PRODUCT {
                    [registers_of::<S, D>(&p, i, padded), registers_of::<S, D>(&p, j, padded)]
                } else {
                    [[&[]; D]; 2]
                },
                own: own.each_mut().map(|axis| S::as_mut_simd_f64s(&mut axis[i..i + padded]).0),
                other: other.each_mut().map(|axis| S::as_mut_simd_f64s(&mut axis[j..j + padded]).0),
                shares: runs.shares.as_ref().map(|shares| {
                    let of =
                        |point: usize| S::as_simd_f64s(&shares.values[first + point..][..padded]).0;
                    [of(i), of(j)]
                }),
                are_added: runs.shares.as_ref().is_some_and(|shares| shares.are_added),
            };
            let full = len / Lanes::<S>::WIDTH;
            for group in 0..full {
                step::<S, D, SQUARE, PRODUCT, false>(simd, &bond, &mut ends, group, one, &mut out);
            }
            if full * Lanes::<S>::WIDTH < len {
                let rest = len - full * Lanes::<S>::WIDTH;
                let inside = Lanes::load(simd, &ONES_AND_ZEROS[WIDEST - rest..], 0);
                step::<S, D, SQUARE, PRODUCT, true>(simd, &bond, &mut ends, full, inside, &mut out);
            }
        }
        out.refused.where_equal(zero, zero, one).largest() == 0.0
    }
}

/// The numbers of one axis.
#[inline(always)]
fn axis_of(of: &[f64], axis: usize, stride: usize) -> &[f64] {
    &of[axis * stride..][..stride]
}

#[inline(always)]
fn axes_of<const D: usize>(of: &mut [f64], stride: usize) -> [&mut [f64]; D] {
    let mut axes = of.chunks_exact_mut(stride);
    [(); D].map(|()| axes.next().unwrap_or_default())
}

#[inline(always)]
fn registers_of<'a, S: Simd, const D: usize>(
    of: &[&'a [f64]; D],
    point: usize,
    padded: usize,
) -> [&'a [S::f64s]; D] {
    each(|axis| S::as_simd_f64s(&of[axis][point..point + padded]).0)
}

/// What the bonds of a run read and write, register by register: at their owners and at the other ends.
struct Ends<'a, S: Simd, const D: usize> {
    u: [[&'a [S::f64s]; D]; 2],
    p: [[&'a [S::f64s]; D]; 2],
    own: [&'a mut [S::f64s]; D],
    other: [&'a mut [S::f64s]; D],
    shares: Option<[&'a [S::f64s]; 2]>,
    are_added: bool,
}

/// What is added up over all bonds of a slab.
struct Added<'a, S: Simd> {
    /// 0 as long as all is well.
    refused: Lanes<S>,
    energy: Option<&'a mut Sum>,
    has_forces: bool,
}

/// A register of bonds. Of the last of a run only some lanes are bonds.
#[inline(always)]
fn step<S: Simd, const D: usize, const SQUARE: bool, const PRODUCT: bool, const LAST: bool>(
    simd: S,
    bond: &Repeated<S, D>,
    ends: &mut Ends<'_, S, D>,
    group: usize,
    inside: Lanes<S>,
    out: &mut Added<'_, S>,
) {
    let lanes = |numbers: S::f64s| Lanes::new(simd, numbers);
    let relative = |of: &[[&[S::f64s]; D]; 2]| -> [Lanes<S>; D] {
        each(|axis| lanes(of[1][axis][group]) - lanes(of[0][axis][group]))
    };
    let mut eta = relative(&ends.u);
    if LAST {
        // Beyond the run there are bonds at rest without weight.
        eta = each(|axis| eta[axis] * inside);
    }
    let x: [Lanes<S>; D] = each(|axis| bond.vector[axis] + eta[axis]);
    let Changed { t, mut first, mut second } =
        bond.changed::<SQUARE, PRODUCT>(Bond::squares(&bond.vector, &eta));
    let mut weight = LAST.then_some(inside);
    if let Some([own, other]) = ends.shares {
        let (own, other) = (lanes(own[group]), lanes(other[group]));
        let both = if ends.are_added { own + other } else { own * other };
        weight = Some(if LAST { both * inside } else { both });
    }
    if let Some(weight) = weight {
        (first, second) = (first * weight, second * weight);
    }
    if out.has_forces {
        out.refused = out.refused + first.zero_or_nan();
        let mut part: [Lanes<S>; D] = each(|axis| first * x[axis]);
        if PRODUCT {
            out.refused = out.refused + second.zero_or_nan();
            let along = relative(&ends.p);
            let stretched = second * dot(&x, &along);
            part = each(|axis| first * along[axis] + stretched * x[axis]);
        }
        for axis in 0..D {
            let to = &mut ends.other[axis][group];
            *to = (lanes(*to) + part[axis]).numbers();
            let from = &mut ends.own[axis][group];
            *from = (lanes(*from) + part[axis]).numbers();
        }
    }
    if let Some(sum) = &mut out.energy {
        let mut energy = bond.rest + t * (bond.linear + bond.bent * t);
        if let Some(weight) = weight {
            energy = energy * weight;
        }
        out.refused = out.refused + energy.zero_or_nan();
        let mut energies = [0.0; WIDEST];
        energy.store(&mut energies[group * Lanes::<S>::WIDTH % WIDEST..], 0);
        sum.add(&energies);
    }
}

/// A bond of a run, in every lane of a register.
struct Repeated<S: Simd, const D: usize> {
    vector: [Lanes<S>; D],
    length: Lanes<S>,
    rest: Lanes<S>,
    linear: Lanes<S>,
    bent: Lanes<S>,
}

/// What a bond has become: how much its length or the square has grown, and the derivatives of its
/// energy by `s = l^2/2`.
struct Changed<S: Simd> {
    t: Lanes<S>,
    first: Lanes<S>,
    second: Lanes<S>,
}

impl<S: Simd, const D: usize> Repeated<S, D> {
    #[inline(always)]
    fn new(simd: S, vector: &[f64; D], laws: &[Quadratic], run: &Run) -> Repeated<S, D> {
        let all = |x: f64| Lanes::splat(simd, x);
        let Quadratic { length, rest, linear, bent } = laws[run.vector as usize];
        Repeated {
            vector: each(|axis| all(vector[axis])),
            length: all(length),
            rest: all(rest),
            linear: all(linear),
            bent: all(bent),
        }
    }

    #[inline(always)]
    fn changed<const SQUARE: bool, const PRODUCT: bool>(
        &self,
        squares: Squares<Lanes<S>>,
    ) -> Changed<S> {
        let twice = self.bent + self.bent;
        if SQUARE {
            let t = squares.grown;
            let slope = self.linear + twice * t;
            let bend = twice + twice;
            return Changed { t, first: slope + slope, second: bend + bend };
        }
        // One division for 1/l and 1/(l + L).
        let length = squares.now.sqrt();
        let sum = length + self.length;
        let over = length.alike(1.0) / (length * sum);
        let (t, over) = (squares.grown * (length * over), sum * over);
        let first = (self.linear + twice * t) * over;
        let second = if PRODUCT { (twice - first) * (over * over) } else { twice };
        Changed { t, first, second }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::CliqueWeights;

    #[test]
    fn weights_are_split_into_what_is_common_and_what_is_not() {
        let same = CliqueWeights::Product { factor: 3.0, shares: vec![2.0; 4] };
        let (common, shares) = Shares::of(&same);
        assert!(common == 12.0 && shares.is_none());
        let same = CliqueWeights::Sum { factor: 3.0, shares: vec![2.0; 4] };
        assert_eq!(Shares::of(&same).0, 12.0);
        let other = CliqueWeights::Sum { factor: 3.0, shares: vec![2.0, 1.0] };
        let (common, shares) = Shares::of(&other);
        assert_eq!(common, 3.0);
        assert_eq!(shares.unwrap().values.len(), 2 + WIDEST);
    }
}
