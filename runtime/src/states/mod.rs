//! Energies of gathered states: ordinary state-based peridynamics.
//!
//! A point gathers integrals over its family, `I_k,i = sum_j V_j g_k(l_ij, L_ij)`. The total energy is
//! `W = sum_i V_i psi(I_i) + sum_(i<j) V_i V_j (phi(l_ij, I_i) + phi(l_ij, I_j))/2`, the same as
//! `sum_i V_i w_i` with `w_i = psi(I_i) + 1/2 sum_j V_j phi(l_ij, I_i)`, a function of one family.
//!
//! | module | does |
//! |---|---|
//! | `family` | the bonds of one point, evaluated at once |
//! | `homogeneous` | one point in a homogeneous displacement, for moduli |
//! | `tangent` | the exact Hessian, stored, and springs like it |
//!
//! The derivative goes the way back (reverse mode): `a_i = dw_i/dI_i`, then each bond has
//! `t_ij = 1/2 dphi(l, I_i)/dl + sum_k a_ik g_k'` from either end, and the force at a point is
//! `sum_j V_i V_j (t_ij + t_ji) n_ij`. Products with the Hessian go through the same steps once more,
//! forward. Every point sums over its own family in the order of the body, so that all points go at
//! once and the bits do not depend on the number of threads.
//!
//! Silling, Epton, Weckner, Xu, Askari 2007; Partmann, Wieners, Weinberg 2026, (3.17) to (3.23).

mod family;
mod homogeneous;
mod tangent;

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::assembly::AssemblyError;
use crate::assembly::error::check_neighbors;
use crate::body::Body;
use crate::correspondence::operator::reverse;
use crate::correspondence::sweep::weighted;
use crate::correspondence::tangent::pattern;
use crate::energy::{Argument, EnergyParts, NonFinite, TotalEnergy};
use crate::kernel::{Law, Order, Variables, VariablesLaw};
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::neighborhood::Neighborhood;
use family::{Along, Family};
use tangent::Stiffness;

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 64;

/// What a potential gathers, and its energies.
#[derive(Default)]
pub struct StateLaws {
    /// The integrands `g_k(l, L)`.
    pub integrals: Vec<Box<dyn Law>>,
    /// The energy of points, of the integrals, in J/m^d.
    pub points: Option<Box<dyn VariablesLaw>>,
    /// The energy of bonds, of the length and the integrals, in J/m^(2d).
    pub bonds: Option<Box<dyn VariablesLaw>>,
    /// An energy of bonds that gathers nothing, in J/m^(2d).
    pub plain: Option<Box<dyn Law>>,
}

/// Why a body has no energy of gathered states.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StateError {
    /// The body is empty, its neighbours cannot be found, or points have none.
    #[error(transparent)]
    Body(#[from] AssemblyError),
    /// An energy has other variables than the integrals.
    #[error("an energy density of {found} variables was given where there are {expected}")]
    WrongLaw {
        /// How many variables it has.
        found: usize,
        /// How many it should have.
        expected: usize,
    },
    /// More bonds than can be numbered.
    #[error("{bonds} bonds are too many: gathered states are limited to 2^31 bonds")]
    TooManyBonds {
        /// How many there are, each once.
        bonds: usize,
    },
}

/// The discrete total energy of gathered states.
pub struct StateEnergy {
    body: Arc<Body>,
    neighborhood: Neighborhood,
    /// For each directed bond `(i, j)` the place of `(j, i)`.
    reverse: Vec<u32>,
    laws: StateLaws,
    pattern: OnceLock<Arc<BlockPattern>>,
    bond_pattern: OnceLock<Arc<BlockPattern>>,
    /// Stiffnesses of springs like the bonds at rest, for each directed bond, in N/m.
    springs: OnceLock<Vec<f64>>,
}

/// What points and bonds know of each other: integrals, `a_i` by points, and for each directed bond
/// half the derivative of its energy by the length; or what these change by.
struct States {
    integrals: Vec<f64>,
    adjoint: Vec<f64>,
    half: Vec<f64>,
    /// Energies per volume of points and of the bonds of points, in J/m^d.
    points: Vec<f64>,
    bonds: Vec<f64>,
}

/// One task's part of arrays by points and by directed bonds.
struct Part<'a> {
    first: usize,
    adjoint: &'a mut [f64],
    half: &'a mut [f64],
    points: &'a mut [f64],
    bonds: &'a mut [f64],
}

impl StateEnergy {
    /// Finds the neighbours.
    ///
    /// # Errors
    ///
    /// Points without neighbours, laws of other variables than the integrals.
    pub fn new(body: Arc<Body>, horizon: f64, laws: StateLaws) -> Result<StateEnergy, StateError> {
        let expected = laws.integrals.len();
        for (law, expected) in [(&laws.points, expected), (&laws.bonds, expected + 1)] {
            let found = law.as_ref().map_or(expected, |law| law.n_variables());
            if found != expected {
                return Err(StateError::WrongLaw { found, expected });
            }
        }
        let neighborhood = Neighborhood::new(&body, horizon).map_err(AssemblyError::from)?;
        check_neighbors(&body, &neighborhood)?;
        if u32::try_from(2 * neighborhood.n_bonds()).is_err() {
            return Err(StateError::TooManyBonds { bonds: neighborhood.n_bonds() });
        }
        let reverse = reverse(&neighborhood);
        let (pattern, bond_pattern, springs) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        Ok(StateEnergy { body, neighborhood, reverse, laws, pattern, bond_pattern, springs })
    }

    /// The body.
    pub fn body(&self) -> &Arc<Body> {
        &self.body
    }

    /// Who is within the horizon of whom.
    pub fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// The integrals of all points at displacements `u` (`n x d`, m), point by point.
    pub fn integrals(&self, u: &[f64]) -> Vec<f64> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.body.dimension() {
            2 => self.gather::<2>(u, None),
            _ => self.gather::<3>(u, None),
        }
    }

    /// The energy per volume at every point in J/m^d; a bond belongs to its ends as their states say.
    pub fn energy_densities(&self, u: &[f64]) -> Result<Vec<f64>, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        let states = match self.body.dimension() {
            2 => self.states::<2>(u, false)?,
            _ => self.states::<3>(u, false)?,
        };
        Ok(states.points.iter().zip(&states.bonds).map(|(x, y)| x + y).collect())
    }

    fn n_integrals(&self) -> usize {
        self.laws.integrals.len()
    }

    /// The integrals, or what they change by along `p`.
    fn gather<const D: usize>(&self, u: &[f64], p: Option<&[f64]>) -> Vec<f64> {
        let m = self.n_integrals();
        let mut integrals = vec![0.0; self.body.n_points() * m];
        if m == 0 {
            return integrals;
        }
        let point = |family: &mut Family<D>, (i, out): (usize, &mut [f64])| {
            family.take(&self.body, &self.neighborhood, u, i);
            if let Some(p) = p {
                family.take_direction(&self.neighborhood, p, i);
            }
            for (law, out) in self.laws.integrals.iter().zip(out) {
                if p.is_none() {
                    family.law(&**law, Order::Energy);
                    *out = family.integral(&family.psi);
                    continue;
                }
                family.law(&**law, Order::Gradient);
                let changes = family.first.iter().zip(&family.along).zip(&family.volumes);
                *out = changes.fold(0.0, |sum, ((slope, along), v)| sum + v * slope * along);
            }
        };
        let points = integrals.par_chunks_exact_mut(m).enumerate().with_min_len(POINTS);
        points.map_init(Family::default, point).collect::<()>();
        integrals
    }

    /// Energies and, if asked for, their derivatives.
    fn states<const D: usize>(&self, u: &[f64], with_slopes: bool) -> Result<States, NonFinite> {
        let mut states = self.empty(self.gather::<D>(u, None));
        let m = self.n_integrals();
        let integrals = std::mem::take(&mut states.integrals);
        let fill = |family: &mut Family<D>, part: Part<'_>| {
            let n = part.points.len();
            if let Some(law) = &self.laws.points {
                let current = by_variables(&integrals[part.first * m..(part.first + n) * m], m);
                let mut slopes = vec![0.0; if with_slopes { m * n } else { 0 }];
                law.evaluate(at_points(n, &current), part.points, &mut slopes);
                for (place, x) in slopes.iter().enumerate() {
                    part.adjoint[place % n * m + place / n] = *x;
                }
            }
            let start = self.neighborhood.places(part.first).start;
            for k in 0..n {
                let i = part.first + k;
                let places = self.neighborhood.places(i);
                let half = &mut part.half[places.start - start..places.end - start];
                family.take(&self.body, &self.neighborhood, u, i);
                if let Some(law) = &self.laws.bonds {
                    family.bonds(&**law, &integrals[i * m..(i + 1) * m], with_slopes);
                    part.bonds[k] += 0.5 * family.integral(&family.psi);
                    if with_slopes {
                        add_halves(half, family.slope(0));
                        for (v, a) in part.adjoint[k * m..(k + 1) * m].iter_mut().enumerate() {
                            *a += 0.5 * family.integral(family.slope(v + 1));
                        }
                    }
                }
                if let Some(law) = &self.laws.plain {
                    let order = if with_slopes { Order::Gradient } else { Order::Energy };
                    family.law(&**law, order);
                    part.bonds[k] += 0.5 * family.integral(&family.psi);
                    if with_slopes {
                        add_halves(half, &family.first);
                    }
                }
            }
        };
        self.parts(&mut states).into_par_iter().map_init(Family::default, fill).collect::<()>();
        states.integrals = integrals;
        let bad = |i: &usize| {
            let own = &states.adjoint[i * m..(i + 1) * m];
            let bonds = &states.half[self.neighborhood.places(*i)];
            let energies = [states.points[*i], states.bonds[*i]];
            ![&energies[..], own, bonds].concat().iter().all(|x| x.is_finite())
        };
        match (0..self.body.n_points()).find(bad) {
            None => Ok(states),
            Some(i) => Err(self.named(i, states.integrals.get(i * m).copied(), u)),
        }
    }

    /// What the derivatives of `states` change by along `p`.
    fn changes<const D: usize>(&self, u: &[f64], p: &[f64], states: &States) -> States {
        let mut changes = self.empty(self.gather::<D>(u, Some(p)));
        let m = self.n_integrals();
        let moved = std::mem::take(&mut changes.integrals);
        let fill = |family: &mut Family<D>, part: Part<'_>| {
            let n = part.points.len();
            if let Some(law) = &self.laws.points {
                let own = part.first * m..(part.first + n) * m;
                let current = by_variables(&states.integrals[own.clone()], m);
                let direction = by_variables(&moved[own], m);
                let mut product = vec![0.0; m * n];
                law.product(at_points(n, &current), &direction, &mut product);
                for (place, x) in product.iter().enumerate() {
                    part.adjoint[place % n * m + place / n] = *x;
                }
            }
            let start = self.neighborhood.places(part.first).start;
            for k in 0..n {
                let i = part.first + k;
                let places = self.neighborhood.places(i);
                let half = &mut part.half[places.start - start..places.end - start];
                family.take(&self.body, &self.neighborhood, u, i);
                family.take_direction(&self.neighborhood, p, i);
                if let Some(law) = &self.laws.bonds {
                    let own = i * m..(i + 1) * m;
                    let integrals = &states.integrals[own.clone()];
                    family.multiply(&**law, integrals, Along::Direction, &moved[own]);
                    add_halves(half, family.slope(0));
                    for (v, a) in part.adjoint[k * m..(k + 1) * m].iter_mut().enumerate() {
                        *a += 0.5 * family.integral(family.slope(v + 1));
                    }
                }
                if let Some(law) = &self.laws.plain {
                    family.law(&**law, Order::Tangent);
                    for (half, (second, along)) in
                        half.iter_mut().zip(family.second.iter().zip(&family.along))
                    {
                        *half += 0.5 * second * along;
                    }
                }
            }
        };
        self.parts(&mut changes).into_par_iter().map_init(Family::default, fill).collect::<()>();
        changes.integrals = moved;
        changes
    }

    /// `force` (`n x d`) becomes the gradient or, with changes along a direction, the product.
    fn forces<const D: usize>(
        &self,
        u: &[f64],
        states: &States,
        along: Option<(&[f64], &States)>,
        force: &mut [f64],
    ) {
        let m = self.n_integrals();
        let point = |(family, tension): &mut (Family<D>, Vec<[f64; 2]>),
                     (i, force): (usize, &mut [f64; D])| {
            family.take(&self.body, &self.neighborhood, u, i);
            if let Some((p, _)) = along {
                family.take_direction(&self.neighborhood, p, i);
            }
            tension.clear();
            for place in self.neighborhood.places(i) {
                let both = |of: &States| of.half[place] + of.half[self.reverse[place] as usize];
                tension.push([both(states), along.map_or(0.0, |(_, changes)| both(changes))]);
            }
            for (k, law) in self.laws.integrals.iter().enumerate() {
                let order = if along.is_some() { Order::Tangent } else { Order::Gradient };
                family.law(&**law, order);
                for (b, &j) in self.neighborhood.row(i).iter().enumerate() {
                    let both = |of: &States| of.adjoint[i * m + k] + of.adjoint[j as usize * m + k];
                    let slope = family.first[b];
                    tension[b][0] += both(states) * slope;
                    if let Some((_, changes)) = along {
                        let bent = both(states) * family.second[b] * family.along[b];
                        tension[b][1] += both(changes) * slope + bent;
                    }
                }
            }
            let mut sum = [0.0; D];
            for (b, [now, change]) in tension.iter().enumerate() {
                let (normal, volume) = (&family.normals[b], family.volumes[b]);
                for c in 0..D {
                    let part = match along {
                        None => now * normal[c],
                        Some(_) => {
                            let across = family.differences[b][c] - family.along[b] * normal[c];
                            change * normal[c] + now / family.length[b] * across
                        }
                    };
                    sum[c] -= volume * part;
                }
            }
            *force = sum.map(|x| self.body.volumes()[i] * x);
        };
        let points = force.as_chunks_mut::<D>().0.par_iter_mut().enumerate().with_min_len(POINTS);
        points.map_init(Default::default, point).collect::<()>();
    }

    /// Energy and, unless `out` is absent, its derivative at `u`, or the product with `direction`.
    fn evaluate<const D: usize>(
        &self,
        u: &[f64],
        direction: Option<&[f64]>,
        out: Option<&mut [f64]>,
    ) -> Result<EnergyParts, NonFinite> {
        let states = self.states::<D>(u, out.is_some())?;
        if let Some(out) = out {
            match direction {
                None => self.forces::<D>(u, &states, None, out),
                Some(p) => {
                    let changes = self.changes::<D>(u, p, &states);
                    self.forces::<D>(u, &states, Some((p, &changes)), out);
                }
            }
            if let Some(place) = out.iter().position(|x| !x.is_finite()) {
                let (i, m) = (place / D, self.n_integrals());
                return Err(self.named(i, states.integrals.get(i * m).copied(), u));
            }
        }
        Ok(EnergyParts {
            bonds: weighted(&states.bonds, self.body.volumes()).value(),
            deformation: weighted(&states.points, self.body.volumes()).value(),
            ..EnergyParts::default()
        })
    }

    /// Zeros for everything but the integrals.
    fn empty(&self, integrals: Vec<f64>) -> States {
        let n = self.body.n_points();
        States {
            adjoint: vec![0.0; integrals.len()],
            integrals,
            half: vec![0.0; self.reverse.len()],
            points: vec![0.0; n],
            bonds: vec![0.0; n],
        }
    }

    /// Cuts arrays into the parts of tasks.
    fn parts<'a>(&self, states: &'a mut States) -> Vec<Part<'a>> {
        let (n, m) = (self.body.n_points(), self.n_integrals());
        let mut adjoint = &mut states.adjoint[..];
        let mut half = &mut states.half[..];
        let mut points = &mut states.points[..];
        let mut bonds = &mut states.bonds[..];
        let mut parts = Vec::with_capacity(n.div_ceil(POINTS));
        for first in (0..n).step_by(POINTS) {
            let last = n.min(first + POINTS) - 1;
            let count = last + 1 - first;
            let directed =
                self.neighborhood.places(last).end - self.neighborhood.places(first).start;
            parts.push(Part {
                first,
                adjoint: cut(&mut adjoint, count * m),
                half: cut(&mut half, directed),
                points: cut(&mut points, count),
                bonds: cut(&mut bonds, count),
            });
        }
        parts
    }

    fn named(&self, point: usize, integral: Option<f64>, u: &[f64]) -> NonFinite {
        let d = self.body.dimension();
        NonFinite {
            argument: Argument::Gathered,
            points: vec![point],
            displacements: u[point * d..(point + 1) * d].to_vec(),
            value: integral.unwrap_or(f64::NAN),
            reference: 1.0,
            inverted: false,
        }
    }
}

/// Takes `length` entries from the front.
fn cut<'a>(rest: &mut &'a mut [f64], length: usize) -> &'a mut [f64] {
    let (taken, tail) = std::mem::take(rest).split_at_mut(length);
    *rest = tail;
    taken
}

fn add_halves(half: &mut [f64], slopes: &[f64]) {
    half.iter_mut().zip(slopes).for_each(|(half, slope)| *half += 0.5 * slope);
}

/// From point by point to variable by variable.
fn by_variables(rows: &[f64], m: usize) -> Vec<f64> {
    (0..m).flat_map(|k| rows.iter().skip(k).step_by(m).copied()).collect()
}

fn at_points(n: usize, current: &[f64]) -> Variables<'_> {
    Variables { n, current, change: &[], given: &[] }
}

impl TotalEnergy for StateEnergy {
    fn dimension(&self) -> usize {
        self.body.dimension()
    }

    fn positions(&self) -> &[f64] {
        self.body.positions()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        self.pattern.get_or_init(|| Arc::new(pattern(&self.neighborhood, self.dimension(), 2)))
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        let make = || Arc::new(BlockPattern::of_bonds(&self.neighborhood, self.dimension()));
        Some(self.bond_pattern.get_or_init(make))
    }

    fn bond_tangent(&self, u: &[f64], tangent: &mut BlockMatrix) {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.dimension() {
            2 => self.like_bonds::<2>(u, tangent),
            _ => self.like_bonds::<3>(u, tangent),
        }
    }

    fn energy(&self, u: &[f64]) -> Result<EnergyParts, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.dimension() {
            2 => self.evaluate::<2>(u, None, None),
            _ => self.evaluate::<3>(u, None, None),
        }
    }

    fn gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<EnergyParts, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        assert_eq!(gradient.len(), u.len(), "the gradient is n x d");
        match self.dimension() {
            2 => self.evaluate::<2>(u, None, Some(gradient)),
            _ => self.evaluate::<3>(u, None, Some(gradient)),
        }
    }

    fn tangent(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        tangent: &mut BlockMatrix,
    ) -> Result<EnergyParts, NonFinite> {
        let parts = self.gradient(u, gradient)?;
        let block = self.dimension() * self.dimension();
        assert_eq!(tangent.values.len(), self.pattern().n_blocks() * block, "the energy's pattern");
        match self.dimension() {
            2 => Stiffness::<2>::new(self, u)?.tangent(tangent),
            _ => Stiffness::<3>::new(self, u)?.tangent(tangent),
        }
        Ok(parts)
    }

    fn tangent_diagonal(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        diagonal: &mut [f64],
    ) -> Result<EnergyParts, NonFinite> {
        let parts = self.gradient(u, gradient)?;
        assert_eq!(diagonal.len(), u.len() * self.dimension(), "the diagonal is n x d x d");
        match self.dimension() {
            2 => Stiffness::<2>::new(self, u)?.diagonal(diagonal),
            _ => Stiffness::<3>::new(self, u)?.diagonal(diagonal),
        }
        Ok(parts)
    }

    fn tangent_product(&self, u: &[f64], p: &[f64], product: &mut [f64]) -> Result<(), NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        assert!(p.len() == u.len() && product.len() == u.len(), "vectors are n x d");
        match self.dimension() {
            2 => self.evaluate::<2>(u, Some(p), Some(product)),
            _ => self.evaluate::<3>(u, Some(p), Some(product)),
        }
        .map(|_| ())
    }
}
