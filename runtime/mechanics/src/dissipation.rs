//! What bonds dissipate: forces that follow from how fast lengths change.
//!
//! The length of a bond along the unit vector `n` changes at the rate `n.(v_j - v_i)`. The Rayleigh potential
//! `R(v; u)` of a body is the sum over bonds of `weight*R(rate; l, L)`, weighted and corrected as energies of
//! bonds are, and dissipative forces are its exact derivatives by velocities: along the bonds, equal and
//! opposite, so that they change neither momentum nor angular momentum; a rigid motion has no rates.

use std::sync::Arc;

use crate::body::Body;
use crate::energy::{Argument, Dissipation, Hessian, NonFinite};
use crate::geometry::{dot, each};
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::interaction::{Census, Degeneracy, Slabs};
use crate::kernel::{Batch, Law, Measure, Order, Outputs};
use crate::materials::{Materials, Parts};
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;
use crate::surface::{CorrectionError, Surface, Weighting};
use crate::weights::CliqueWeights;

/// What the potentials of a body dissipate that add up to one energy.
pub struct Layer {
    /// Of each law of the materials, of the only one where there are none: R in W/m^(2d) with its derivatives
    /// by the rate, which stands in the place of the measure. Where it takes fields, these are those of its
    /// law, and the length in m behind them.
    pub of_law: Vec<Option<Box<dyn Law>>>,
    /// Which laws bonds take.
    pub materials: Option<Arc<Materials>>,
}

impl Layer {
    /// The part of a law in a bond; nothing where it has none.
    fn part(&self, ends: [usize; 2], law: usize) -> Option<f64> {
        let parts = match &self.materials {
            Some(materials) => materials.parts(&ends.map(|end| materials.of(end))),
            None => Parts::whole(0),
        };
        parts.iter().find(|part| part.0 == law).map(|part| part.1)
    }
}

/// The bonds of a body as dashpots.
pub struct Dashpots {
    body: Arc<Body>,
    neighborhood: Arc<Neighborhood>,
    slabs: Slabs,
    weights: CliqueWeights,
    /// The parts of cells that bonds take, by their numbers; nothing where these are whole.
    factors: Option<Vec<f64>>,
    layers: Vec<Layer>,
    rooms: Pool<Room>,
}

/// Where a body is and how it moves: displacements in m and velocities in m/s, `n x d`.
#[derive(Clone, Copy)]
struct Moving<'a> {
    u: &'a [f64],
    v: &'a [f64],
}

/// A bond of an owner.
struct Lane {
    other: usize,
    bond: usize,
    weight: f64,
    /// From the owner, of unit length; two components in the plane.
    along: [f64; 3],
}

/// Work arrays for the bonds of an owner.
#[derive(Default)]
struct Room {
    lanes: Vec<Lane>,
    lengths: Vec<f64>,
    /// One over them.
    inverse: Vec<f64>,
    rates: Vec<f64>,
    at_rest: Vec<f64>,
    /// `(rate - L)/L`, as laws take the change of a measure.
    change: Vec<f64>,
    fields: Vec<f64>,
    potential: Vec<f64>,
    force: Vec<f64>,
    viscosity: Vec<f64>,
}

impl Dashpots {
    /// What these layers dissipate. Bonds weigh what they do in energies, but for corrections of surfaces, which
    /// compare what is stored.
    ///
    /// # Errors
    /// Bonds that cannot be weighted.
    pub fn new(
        (body, neighborhood): (Arc<Body>, Arc<Neighborhood>),
        weighting: impl Into<Weighting>,
        layers: Vec<Layer>,
    ) -> Result<Dashpots, CorrectionError> {
        let weighting = Weighting { surface: Surface::None, ..weighting.into() };
        let slabs = Slabs::new(&neighborhood);
        let degeneracy = Degeneracy::new(&body);
        let census = Census::new(&body, &neighborhood, degeneracy, &slabs, |_| false);
        let (measure, horizon) = (Measure::Length, neighborhood.horizon());
        let weights = weighting.weights.of_measure(measure, &body, horizon, &census)?;
        let factors = weighting.factors(&body, &neighborhood, &weights, &[], None)?;
        let rooms = Pool::new();
        Ok(Dashpots { body, neighborhood, slabs, weights, factors, layers, rooms })
    }

    /// `forces` become `dR/dv` in N at displacements `u` in m and velocities `v` in m/s, without the bonds that
    /// are `gone`.
    ///
    /// # Errors
    /// Forces that are not finite.
    pub(crate) fn forces_of(
        &self,
        (u, v): (&[f64], &[f64]),
        gone: impl Fn(usize) -> bool + Sync,
        forces: &mut [f64],
    ) -> Result<(), NonFinite> {
        forces.fill(0.0);
        match self.body.dimension() {
            2 => self.add_forces::<2>(Moving { u, v }, gone, forces),
            _ => self.add_forces::<3>(Moving { u, v }, gone, forces),
        }
    }

    fn add_forces<const D: usize>(
        &self,
        now: Moving<'_>,
        gone: impl Fn(usize) -> bool + Sync,
        forces: &mut [f64],
    ) -> Result<(), NonFinite> {
        let shared = Part::new(Layout::Points(D), forces);
        self.over_slabs(shared, |slab, [here, next], room| {
            let mut rows = Touched::new(here, next);
            self.slabs.owners(slab).try_for_each(|owner| {
                self.each_bond::<D>(owner, (now, Order::Force), &gone, room, |lane, pull, _| {
                    spread::<D>(&mut rows, [owner, lane.other], pull, &lane.along);
                })
            })
        })
    }

    /// `d2R/dv2` at `u` and `v`, for products.
    ///
    /// # Errors
    /// Second derivatives that are not finite.
    pub(crate) fn viscosity_of(
        &self,
        (u, v): (&[f64], &[f64]),
        gone: impl Fn(usize) -> bool + Sync,
    ) -> Result<Viscosity<'_>, NonFinite> {
        let mut bonds = vec![[0.0; 4]; self.neighborhood.n_bonds()];
        match self.body.dimension() {
            2 => self.add_viscosities::<2>(Moving { u, v }, gone, &mut bonds)?,
            _ => self.add_viscosities::<3>(Moving { u, v }, gone, &mut bonds)?,
        }
        Ok(Viscosity { of: self, bonds })
    }

    fn add_viscosities<const D: usize>(
        &self,
        now: Moving<'_>,
        gone: impl Fn(usize) -> bool + Sync,
        bonds: &mut [[f64; 4]],
    ) -> Result<(), NonFinite> {
        let shared = Part::new(Layout::Rows(self.neighborhood.bond_starts(), 1), bonds);
        self.over_slabs(shared, |slab, [here, next], room| {
            let mut bonds = Touched::new(here, next);
            self.slabs.owners(slab).try_for_each(|owner| {
                self.each_bond::<D>(owner, (now, Order::Tangent), &gone, room, |lane, _, c| {
                    let [x, y, z] = lane.along;
                    bonds[lane.bond] = [x, y, z, bonds[lane.bond][3] + c];
                })
            })
        })
    }

    /// Visits all slabs with what they write to; the first error in their order.
    fn over_slabs<P: crate::interaction::schedule::Cut>(
        &self,
        shared: P,
        run: impl Fn(usize, [&mut P; 2], &mut Room) -> Result<(), NonFinite> + Sync,
    ) -> Result<(), NonFinite> {
        self.rooms.provide(Room::default);
        let mut outcomes: Vec<Result<(), NonFinite>> = Vec::new();
        outcomes.resize_with(self.slabs.len(), || Ok(()));
        let own = Part::new(Layout::Slabs, &mut outcomes[..]);
        visit(&self.slabs, shared, own, |slab, parts, outcome| {
            let mut room = self.rooms.take(Room::default);
            outcome.into_values()[0] = run(slab, parts, &mut room);
        });
        outcomes.into_iter().collect()
    }

    /// Shows an owner's bonds law by law, with their weighted `R'` in N and, at [`Order::Tangent`], `R''` in
    /// N s/m.
    fn each_bond<const D: usize>(
        &self,
        owner: usize,
        (now, order): (Moving<'_>, Order),
        gone: &(impl Fn(usize) -> bool + Sync),
        room: &mut Room,
        mut show: impl FnMut(&Lane, f64, f64),
    ) -> Result<(), NonFinite> {
        for layer in &self.layers {
            for (number, law) in layer.of_law.iter().enumerate() {
                let Some(law) = law else { continue };
                self.gather::<D>(owner, now, room, |bond, other| match gone(bond) {
                    true => None,
                    false => layer.part([owner, other], number),
                });
                if room.lanes.is_empty() {
                    continue;
                }
                room.take_fields(layer, (number, &**law), owner);
                room.evaluate(&**law, order);
                for (k, lane) in room.lanes.iter().enumerate() {
                    let [force, viscosity] =
                        [&room.force, &room.viscosity].map(|all| lane.weight * all[k]);
                    if !(force.is_finite() && viscosity.is_finite()) {
                        return Err(room.refused::<D>(owner, k, now.u));
                    }
                    show(lane, force, viscosity);
                }
            }
        }
        Ok(())
    }

    /// Lists an owner's bonds that have a part in a law, with their rates.
    fn gather<const D: usize>(
        &self,
        owner: usize,
        now: Moving<'_>,
        room: &mut Room,
        part: impl Fn(usize, usize) -> Option<f64>,
    ) {
        let rows = |values| <[f64]>::as_chunks::<D>(values).0;
        let (positions, u, v) = (rows(self.body.positions()), rows(now.u), rows(now.v));
        let begun = self.weights.begin(self.weights.share(owner), &[]);
        room.clear();
        let own = self.neighborhood.bonds(owner).zip(self.neighborhood.upper(owner));
        for (bond, other) in own {
            let other = other as usize;
            let factor = self.factors.as_ref().map_or(1.0, |factors| factors[bond]);
            let Some(part) = part(bond, other).filter(|_| factor != 0.0) else { continue };
            let between = |of: &[[f64; D]]| -> [f64; D] { each(|k| of[other][k] - of[owner][k]) };
            let (xi, eta, speed) = (between(positions), between(u), between(v));
            let x: [f64; D] = each(|axis| xi[axis] + eta[axis]);
            let mut along = [0.0; 3];
            along[..D].copy_from_slice(&x);
            let weight = part * factor * self.weights.join_last(begun, self.weights.share(other));
            room.lanes.push(Lane { other, bond, weight, along });
            // Squares and a product so far: roots and quotients go several at a time.
            room.lengths.push(dot(&x, &x));
            room.rates.push(dot(&x, &speed));
            room.at_rest.push(dot(&xi, &xi));
        }
        room.take_roots();
    }
}

impl Room {
    fn clear(&mut self) {
        self.lanes.clear();
        let Room { lengths, rates, at_rest, change, .. } = self;
        [lengths, rates, at_rest, change].into_iter().for_each(Vec::clear);
    }

    /// Makes lengths of squares, rates of products and unit vectors of those along bonds.
    fn take_roots(&mut self) {
        let n = self.lanes.len();
        self.inverse.resize(n, 0.0);
        self.change.resize(n, 0.0);
        let (lengths, inverse) = (&mut self.lengths[..n], &mut self.inverse[..n]);
        let (rates, at_rest) = (&mut self.rates[..n], &mut self.at_rest[..n]);
        let change = &mut self.change[..n];
        for k in 0..n {
            lengths[k] = lengths[k].sqrt();
            at_rest[k] = at_rest[k].sqrt();
            inverse[k] = 1.0 / lengths[k];
            rates[k] *= inverse[k];
            change[k] = (rates[k] - at_rest[k]) / at_rest[k];
        }
        for (lane, inverse) in self.lanes.iter_mut().zip(inverse) {
            lane.along.iter_mut().for_each(|x| *x *= *inverse);
        }
    }

    /// The fields of the bonds' law, and their lengths behind them, where the law takes some.
    fn take_fields(&mut self, layer: &Layer, (number, law): (usize, &dyn Law), owner: usize) {
        self.fields.clear();
        if law.fields().is_empty() {
            return;
        }
        let lanes = &self.lanes;
        if let Some(fields) = layer.materials.as_deref().and_then(Materials::fields) {
            let bonds = lanes.iter().map(|lane| ([owner, lane.other].into_iter(), lane.bond));
            let (measure, own) = (Measure::Length, fields.of_law(number));
            fields.add_of(measure, own, lanes.len(), bonds, &mut self.fields);
        }
        self.fields.extend_from_slice(&self.lengths);
    }

    fn evaluate(&mut self, law: &dyn Law, order: Order) {
        let n = self.lanes.len();
        let Room { potential, force, viscosity, .. } = self;
        [&mut *potential, &mut *force, &mut *viscosity].into_iter().for_each(|out| {
            out.clear();
            out.resize(n, 0.0);
        });
        let batch = Batch {
            measure: &self.rates,
            reference: &self.at_rest,
            change: &self.change,
            fields: &self.fields,
        };
        law.evaluate(batch, order, Outputs { psi: potential, dpsi: force, d2psi: viscosity });
    }

    fn refused<const D: usize>(&self, owner: usize, lane: usize, u: &[f64]) -> NonFinite {
        let points = vec![owner, self.lanes[lane].other];
        let of = |point: &usize| u[point * D..(point + 1) * D].to_vec();
        NonFinite {
            argument: Argument::Rate,
            displacements: points.iter().flat_map(of).collect(),
            points,
            value: self.rates[lane],
            reference: self.at_rest[lane],
            inverted: false,
        }
    }
}

/// Adds a pull along a bond to the rows of its points.
#[inline(always)]
fn spread<const D: usize>(
    rows: &mut Touched<'_, f64>,
    [owner, other]: [usize; 2],
    pull: f64,
    along: &[f64; 3],
) {
    let force: [f64; D] = each(|axis| pull * along[axis]);
    let own = rows.range(owner * D..(owner + 1) * D);
    own.iter_mut().zip(force).for_each(|(own, force)| *own -= force);
    let far = rows.range(other * D..(other + 1) * D);
    far.iter_mut().zip(force).for_each(|(far, force)| *far += force);
}

impl Dissipation for Dashpots {
    fn forces(&self, u: &[f64], v: &[f64], forces: &mut [f64]) -> Result<(), NonFinite> {
        self.forces_of((u, v), |_| false, forces)
    }

    fn viscosity(&self, u: &[f64], v: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        Ok(Box::new(self.viscosity_of((u, v), |_| false)?))
    }
}

/// The second derivative of R by velocities: of each bond its direction, and `R''` weighted in N s/m.
pub(crate) struct Viscosity<'a> {
    of: &'a Dashpots,
    bonds: Vec<[f64; 4]>,
}

impl Hessian for Viscosity<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        product.fill(0.0);
        match self.of.body.dimension() {
            2 => self.add_product::<2>(p, product),
            _ => self.add_product::<3>(p, product),
        }
    }
}

impl Viscosity<'_> {
    fn add_product<const D: usize>(&self, p: &[f64], product: &mut [f64]) {
        let Dashpots { neighborhood, slabs, .. } = self.of;
        let shared = Part::new(Layout::Points(D), product);
        visit(slabs, shared, (), |slab, [here, next], ()| {
            let mut rows = Touched::new(here, next);
            for owner in slabs.owners(slab) {
                let own = neighborhood.bonds(owner).zip(neighborhood.upper(owner));
                for (bond, other) in own {
                    let ([x, y, z, c], other) = (self.bonds[bond], other as usize);
                    let along = [x, y, z];
                    let rate = (0..D).fold(0.0, |sum, axis| {
                        sum + along[axis] * (p[other * D + axis] - p[owner * D + axis])
                    });
                    spread::<D>(&mut rows, [owner, other], c * rate, &along);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::{Lattice, Nodes};
    use crate::testing::pseudo_random;
    use crate::weights::Weights;

    /// `R = 1/2 l rate^2 + rate^4/4`, with the length as a field.
    struct Quartic;

    impl Law for Quartic {
        fn evaluate(&self, at: Batch<'_>, order: Order, out: Outputs<'_>) {
            for (k, (rate, length)) in at.measure.iter().zip(at.fields).enumerate() {
                out.psi[k] = 0.5 * length * rate * rate + 0.25 * rate * rate * rate * rate;
                out.dpsi[k] = length * rate + rate * rate * rate;
                if order == Order::Tangent {
                    out.d2psi[k] = length + 3.0 * rate * rate;
                }
            }
        }

        fn fields(&self) -> &[f64] {
            &[1.0]
        }
    }

    fn dashpots(d: usize) -> Dashpots {
        let (lower, upper) = (vec![0.0; d], [7.0, 3.0, 2.0][..d].to_vec());
        let lattice = Lattice { lower, upper, spacing: 1.0, nodes: Nodes::Cells };
        let points = lattice.points().unwrap();
        let body = Arc::new(Body::new(d, &points.positions, &points.volumes, Some(1.0)));
        let neighborhood = Arc::new(Neighborhood::new(&body, 2.1).unwrap());
        let layer = Layer { of_law: vec![Some(Box::new(Quartic))], materials: None };
        Dashpots::new((body, neighborhood), Weights::Volumes, vec![layer]).unwrap()
    }

    #[test]
    fn products_are_changes_of_forces() {
        for d in [2, 3] {
            let all = dashpots(d);
            let n = all.body.positions().len();
            let [u, v, p] = [1, 2, 3].map(|seed| pseudo_random(n, seed));
            let u: Vec<f64> = u.iter().map(|x| 0.1 * x).collect();
            let [mut one, mut two, mut product] = [(); 3].map(|()| vec![f64::NAN; n]);
            let h = 1e-5;
            let moved = |sign: f64| -> Vec<f64> {
                v.iter().zip(&p).map(|(v, p)| v + sign * h * p).collect()
            };
            all.forces(&u, &moved(1.0), &mut one).unwrap();
            all.forces(&u, &moved(-1.0), &mut two).unwrap();
            all.viscosity(&u, &v).unwrap().multiply(&p, &mut product);
            let largest = product.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            for k in 0..n {
                let slope = (one[k] - two[k]) / (2.0 * h);
                assert!((slope - product[k]).abs() <= 1e-8 * largest, "{slope} {}", product[k]);
            }
        }
    }

    #[test]
    fn forces_have_no_resultant_and_no_moment_and_rigid_motions_none_at_all() {
        let all = dashpots(2);
        let n = all.body.positions().len();
        let u: Vec<f64> = pseudo_random(n, 1).iter().map(|x| 0.1 * x).collect();
        let x: Vec<f64> = u.iter().zip(all.body.positions()).map(|(u, x)| x + u).collect();
        let mut forces = vec![f64::NAN; n];
        all.forces(&u, &pseudo_random(n, 2), &mut forces).unwrap();
        let pairs = || forces.chunks_exact(2).zip(x.chunks_exact(2));
        let sum = pairs().fold([0.0; 3], |[a, b, c], (f, x)| {
            [a + f[0], b + f[1], c + x[0] * f[1] - x[1] * f[0]]
        });
        assert!(sum.iter().all(|x| x.abs() < 1e-12), "{sum:?}");
        assert!(forces.iter().any(|f| f.abs() > 1.0));
        let rigid: Vec<f64> =
            x.chunks_exact(2).flat_map(|x| [2.0 - 3.0 * x[1], 3.0 * x[0]]).collect();
        all.forces(&u, &rigid, &mut forces).unwrap();
        assert!(forces.iter().all(|f| f.abs() < 1e-12), "{forces:?}");
    }

    #[test]
    fn bonds_that_are_gone_have_no_force() {
        let all = dashpots(3);
        let n = all.body.positions().len();
        let mut forces = vec![f64::NAN; n];
        let v = pseudo_random(n, 2);
        let [first, other] = all.neighborhood.ends(0);
        all.forces_of((&vec![0.0; n], &v), |bond| bond != 0, &mut forces).unwrap();
        let moved: Vec<usize> =
            (0..n / 3).filter(|p| forces[3 * p..3 * p + 3].iter().any(|f| *f != 0.0)).collect();
        assert_eq!(moved, [first, other]);
    }
}
