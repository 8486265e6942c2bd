//! Energies of gathered states: ordinary state-based peridynamics.
//!
//! A point gathers integrals over its family, `I_k,i = sum_j V_j g_k(l_ij, L_ij)`. The total energy is
//! `W = sum_i V_i psi(I_i) + sum_(i<j) V_i V_j (phi(l_ij, I_i) + phi(l_ij, I_j))/2`, the same as
//! `sum_i V_i w_i` with `w_i = psi(I_i) + 1/2 sum_j V_j phi(l_ij, I_i)`, a function of one family.
//!
//! | module | does |
//! |---|---|
//! | `passes` | what points gather, energies, forces: each bond once |
//! | `linear` | products with the Hessian from second derivatives at fixed displacements |
//! | `stiffness` | the same for the stored Hessian, and springs like it |
//! | `broken` | families that lose bonds |
//! | `functions` | conditions of gathered values under which bonds break, and what points remember next |
//! | `rows`, `sweep`, `gaps` | along the rows of lattices, where laws are affine; the bonds of a slab there; bonds that are lost |
//!
//! The derivative goes the way back (reverse mode): `a_i = dw_i/dI_i`, then each bond has
//! `t_ij = 1/2 dphi(l, I_i)/dl + sum_k a_ik g_k'` from either end, and the force at a point is
//! `sum_j V_i V_j (t_ij + t_ji) n_ij`. Products with the Hessian go through the same steps once more,
//! forward, with second derivatives that are worked out once at the same displacements.
//!
//! Silling, Epton, Weckner, Xu, Askari 2007; Partmann, Wieners, Weinberg 2026, (3.17) to (3.23).

mod broken;
mod functions;
mod gaps;
mod linear;
mod passes;
mod rows;
mod stiffness;
mod sweep;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::assembly::AssemblyError;
use crate::assembly::error::check_neighbors;
use crate::assembly::sum::Sum;
use crate::body::Body;
use crate::energy::{Energy, Hessian, NonFinite, Wanted, check_sizes};
use crate::fields::stored;
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};
use crate::interaction::{Report, Slabs};
use crate::kernel::{Batch, Law, Measure, Order, Outputs, Variables, VariablesLaw};
use crate::materials::{Fields, Materials};
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;
use crate::weights::check_families;
use broken::Whole;
use linear::Linear;
use passes::{States, Work};
use rows::AlongRows;
use stiffness::StateStiffness;

/// What a potential gathers, and its energies.
#[derive(Default)]
pub struct StateLaws {
    /// The integrands `g_k(l, L)`.
    pub integrals: Vec<Box<dyn Law>>,
    /// Of which law they are, by number, where some take fields; else it may be empty.
    pub of_law: Vec<usize>,
    /// The energy of points, of the integrals, in J/m^d.
    pub points: Option<Box<dyn VariablesLaw>>,
    /// The energy of bonds, of the length and the integrals, in J/m^(2d).
    pub bonds: Option<Box<dyn VariablesLaw>>,
    /// What the energies of points and of bonds are functions of, for the names of the parts.
    pub arguments: [String; 2],
}

impl StateLaws {
    fn names(&self) -> Arc<[String]> {
        let has = [self.points.is_some(), self.bonds.is_some()];
        let parts = self.arguments.iter().zip(has).filter(|part| part.1);
        parts.map(|(argument, _)| format!("psi({argument})")).collect()
    }
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
    neighborhood: Arc<Neighborhood>,
    slabs: Slabs,
    /// Lengths at rest of each bond once, in m.
    rest: Vec<f64>,
    laws: StateLaws,
    /// Where the laws are those of several materials.
    materials: Option<Arc<Materials>>,
    /// Integrals that change with displacements.
    changing: Vec<usize>,
    /// The others, point by point among all, and 0 for those that change.
    at_rest: Vec<f64>,
    /// What goes along the rows of a lattice.
    rows: Option<AlongRows>,
    /// `psi(theta)`, `psi(l, m)`: as the potential writes them, those that are modelled.
    names: Arc<[String]>,
    pattern: OnceLock<Arc<BlockPattern>>,
    bond_pattern: OnceLock<Arc<BlockPattern>>,
    /// Stiffnesses of springs like the bonds at rest, in N/m.
    springs: OnceLock<Vec<f64>>,
    /// By which bonds break.
    criteria: Vec<FamilyCriterion>,
    /// What points remember.
    next_states: Vec<FamilyNextState>,
    /// The families before bonds were lost.
    whole: Option<Box<Whole>>,
    /// Room for passes, and for their threads.
    states: Pool<States>,
    work: Pool<Work>,
}

impl StateEnergy {
    /// Finds the neighbours.
    ///
    /// # Errors
    ///
    /// Points without neighbours, laws of other variables than the integrals.
    pub fn new(body: Arc<Body>, horizon: f64, laws: StateLaws) -> Result<StateEnergy, StateError> {
        let neighborhood = Neighborhood::new(&body, horizon).map_err(AssemblyError::from)?;
        StateEnergy::among(body, Arc::new(neighborhood), laws)
    }

    /// Takes neighbours that energies of the body share.
    ///
    /// # Errors
    ///
    /// Points without neighbours, laws of other variables than the integrals.
    pub fn among(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        laws: StateLaws,
    ) -> Result<StateEnergy, StateError> {
        StateEnergy::of_materials(body, neighborhood, None, laws)
    }

    /// The same for a body of several materials: points, and bonds at each of their ends, take the law of
    /// their material. Every point gathers the integrals of all materials. See
    /// [`crate::materials::ByMaterial`].
    ///
    /// # Errors
    ///
    /// As [`StateEnergy::among`].
    pub fn of_materials(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        materials: Option<Arc<Materials>>,
        laws: StateLaws,
    ) -> Result<StateEnergy, StateError> {
        let expected = laws.integrals.len();
        for (law, expected) in [(&laws.points, expected), (&laws.bonds, expected + 1)] {
            let found = law.as_ref().map_or(expected, |law| law.n_variables());
            if found != expected {
                return Err(StateError::WrongLaw { found, expected });
            }
        }
        check_neighbors(&body, &neighborhood)?;
        check_families(&body).map_err(AssemblyError::from)?;
        if u32::try_from(2 * neighborhood.n_bonds()).is_err() {
            return Err(StateError::TooManyBonds { bonds: neighborhood.n_bonds() });
        }
        let n_integrals = laws.integrals.len();
        let mut energy = StateEnergy {
            slabs: Slabs::new(&neighborhood),
            rest: rest_lengths(&body, &neighborhood),
            changing: Vec::new(),
            at_rest: vec![0.0; body.n_points() * n_integrals],
            body,
            neighborhood,
            rows: None,
            names: laws.names(),
            laws,
            materials,
            pattern: OnceLock::new(),
            bond_pattern: OnceLock::new(),
            springs: OnceLock::new(),
            criteria: Vec::new(),
            next_states: Vec::new(),
            whole: None,
            states: Pool::new(),
            work: Pool::new(),
        };
        energy.changing = (0..n_integrals).filter(|k| energy.is_changing(*k)).collect();
        let points: Vec<usize> = (0..energy.body.n_points()).collect();
        energy.fix(&points);
        energy.rows = AlongRows::new(&energy);
        Ok(energy)
    }

    /// Whether an integral depends on displacements, or on fields that change.
    fn is_changing(&self, integral: usize) -> bool {
        let is_steady = self.fields_of(integral).is_none_or(|(fields, _)| fields.is_steady());
        !(self.laws.integrals[integral].is_constant() && is_steady)
    }

    /// Works out the integrals that do not change around some points, once for all passes.
    fn fix(&mut self, points: &[usize]) {
        let m = self.n_integrals();
        let fixed: Vec<usize> = (0..m).filter(|k| !self.changing.contains(k)).collect();
        if fixed.is_empty() {
            return;
        }
        let values: Vec<Vec<f64>> =
            points.par_iter().map(|point| self.at_rest_around(*point, &fixed)).collect();
        for (point, values) in points.iter().zip(values) {
            fixed.iter().zip(values).for_each(|(k, value)| self.at_rest[point * m + k] = value);
        }
    }

    /// Some integrals of a point at rest, by the order of its neighbours.
    fn at_rest_around(&self, point: usize, integrals: &[usize]) -> Vec<f64> {
        let row = self.neighborhood.row(point);
        let lengths: Vec<f64> =
            row.iter().map(|j| self.body.distance([point, j as usize])).collect();
        let (nothing, mut given) = (vec![0.0; row.len()], Vec::new());
        let mut out = [nothing.clone(), nothing.clone(), nothing.clone()];
        let value = |&k: &usize| {
            given.clear();
            if let Some((fields, own)) = self.fields_of(k) {
                let ends = |b: usize| [point, row.at(b) as usize].into_iter();
                fields.add(own, row.len(), ends, &mut given);
            }
            let (measure, reference) = (&lengths[..], &lengths[..]);
            let batch = Batch { measure, reference, change: &nothing, fields: &given };
            let [psi, dpsi, d2psi] = &mut out;
            self.laws.integrals[k].evaluate(batch, Order::Energy, Outputs { psi, dpsi, d2psi });
            let terms = row.iter().zip(&*psi);
            terms.fold(0.0, |sum, (j, psi)| sum + self.body.volumes()[j as usize] * psi)
        };
        integrals.iter().map(value).collect()
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
        let mut states = self.states.take(States::default);
        match self.body.dimension() {
            2 => self.gather::<2>(u, Order::Energy, &mut states),
            _ => self.gather::<3>(u, Order::Energy, &mut states),
        }
        states.integrals.clone()
    }

    /// `given` becomes what the points of a law take of fields, after what is there.
    fn give(&self, n: usize, ends: impl Fn(usize) -> [usize; 2], given: &mut Vec<f64>) {
        if let Some(fields) = self.fields() {
            fields.add(0..fields.len(), n, |place| ends(place).into_iter(), given);
        }
    }

    fn fields(&self) -> Option<&Fields> {
        self.materials.as_deref().and_then(Materials::fields)
    }

    /// The fields of an integrand, where it takes some.
    fn fields_of(&self, integral: usize) -> Option<(&Fields, Range<usize>)> {
        if self.laws.integrals[integral].fields().is_empty() {
            return None;
        }
        let law = self.laws.of_law.get(integral).copied().unwrap_or(0);
        self.fields().map(|fields| (fields, fields.of_law(law)))
    }

    /// The numbers of the laws of some points.
    fn laws_of(&self, points: Range<usize>) -> &[u8] {
        self.materials.as_ref().map_or(&[], |materials| materials.of_points(points))
    }

    fn n_integrals(&self) -> usize {
        self.laws.integrals.len()
    }

    /// The energy and, unless `out` is absent, its derivative at `u`.
    fn assemble<const D: usize>(
        &self,
        u: &[f64],
        mut out: Option<&mut [f64]>,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let has = [self.laws.points.is_some(), self.laws.bonds.is_some()];
        let along_rows =
            self.rows.as_ref().and_then(|rows| rows.assemble::<D>(self, u, out.as_deref_mut()));
        if let Some(energies) = along_rows {
            let energies = energies.iter().zip(has).filter(|part| part.1);
            parts.iter_mut().zip(energies).for_each(|(part, (energy, _))| *part = *energy);
            return Ok(());
        }
        if let Some(rows) = &self.rows {
            rows.note_nothing();
        }
        let order = if out.is_some() { Order::Gradient } else { Order::Energy };
        let states = self.states::<D>(u, order)?;
        if let Some(out) = out {
            out.fill(0.0);
            self.forces::<D>(&states, out);
            self.check::<D>(&states.integrals, u, out)?;
        }
        let energies = [&states.points, &states.bonds].into_iter().zip(has).filter(|part| part.1);
        for (part, (densities, _)) in parts.iter_mut().zip(energies) {
            *part = Sum::of_products(densities, self.body.volumes()).value();
        }
        Ok(())
    }

    fn evaluate_in<const D: usize>(
        &self,
        u: &[f64],
        wanted: Wanted<'_>,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let assemble = |forces: Option<&mut [f64]>| self.assemble::<D>(u, forces, parts);
        stored::evaluate(wanted, assemble, || StateStiffness::<D>::new(self, u))
    }

    fn hessian_in<const D: usize>(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        if let Some(hessian) = self.rows.as_ref().and_then(|rows| rows.hessian::<D>(self, u)) {
            return Ok(Box::new(hessian));
        }
        let linear = self.finite::<D>(u)?;
        Ok(Box::new(StateHessian { energy: self, linear, changes: Pool::new() }))
    }

    /// Refuses forces that are not finite.
    fn check<const D: usize>(
        &self,
        integrals: &[f64],
        u: &[f64],
        out: &[f64],
    ) -> Result<(), NonFinite> {
        match out.iter().position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(place) => {
                let (i, m) = (place / D, self.n_integrals());
                Err(self.named(i, integrals.get(i * m).copied(), u))
            }
        }
    }

    fn named(&self, point: usize, integral: Option<f64>, u: &[f64]) -> NonFinite {
        NonFinite::of_gathered(self.body.dimension(), point, integral, u)
    }
}

/// Lengths at rest of each bond once, in m.
fn rest_lengths(body: &Body, neighborhood: &Neighborhood) -> Vec<f64> {
    let owners = 0..neighborhood.n_points();
    let of_owner = |i| neighborhood.upper(i).iter().map(move |j| body.distance([i, j as usize]));
    owners.flat_map(of_owner).collect()
}

/// From point by point to variable by variable.
fn by_variables(rows: &[f64], m: usize, variables: &mut Vec<f64>) {
    variables.clear();
    variables.extend((0..m).flat_map(|k| rows.iter().skip(k).step_by(m)));
}

fn at_points<'a>(
    current: &'a [f64],
    (laws, given): (&'a [u8], &'a [f64]),
    n: usize,
) -> Variables<'a> {
    Variables { n, current, change: &[], given, laws }
}

impl Energy for StateEnergy {
    fn dimension(&self) -> usize {
        self.body.dimension()
    }

    fn counted(&self) -> Range<usize> {
        self.body.counted()
    }

    fn positions(&self) -> &[f64] {
        self.body.positions()
    }

    fn parts(&self) -> &Arc<[String]> {
        &self.names
    }

    fn report(&self) -> Report {
        let mut report = Report::of_families(&self.neighborhood, self.body.counted());
        if self.rows.is_some() {
            report.ways.push("rows");
        }
        report
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        let whole =
            self.whole.as_ref().map_or(&self.neighborhood, |whole| &whole.lost.neighborhood);
        let make = || Arc::new(BlockPattern::of_reach(whole, self.dimension(), 2));
        self.pattern.get_or_init(make)
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        let make = || Arc::new(BlockPattern::of_bonds(&self.neighborhood, self.dimension()));
        Some(self.bond_pattern.get_or_init(make))
    }

    fn springs(&self, u: &[f64], springs: &mut BlockMatrix) {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.dimension() {
            2 => self.like_bonds::<2>(u, springs),
            _ => self.like_bonds::<3>(u, springs),
        }
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        check_sizes(self, u, &wanted, parts);
        match self.dimension() {
            2 => self.evaluate_in::<2>(u, wanted, parts),
            _ => self.evaluate_in::<3>(u, wanted, parts),
        }
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        let states = match self.body.dimension() {
            2 => self.states::<2>(u, Order::Energy)?,
            _ => self.states::<3>(u, Order::Energy)?,
        };
        let densities = states.points.iter().zip(&states.bonds).zip(self.body.volumes());
        for (share, ((points, bonds), volume)) in shares.iter_mut().zip(densities) {
            *share = (points + bonds) * volume;
        }
        Ok(())
    }

    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        if self.names.len() == 1 {
            return self.shares(u, shares);
        }
        let states = match self.body.dimension() {
            2 => self.states::<2>(u, Order::Energy)?,
            _ => self.states::<3>(u, Order::Energy)?,
        };
        let densities = [&states.points, &states.bonds][part].iter().zip(self.body.volumes());
        shares.iter_mut().zip(densities).for_each(|(share, (psi, volume))| *share = psi * volume);
        Ok(())
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        virials.fill(0.0);
        match self.body.dimension() {
            2 => self.add_virials::<2>(u, virials),
            _ => self.add_virials::<3>(u, virials),
        }
    }

    fn has_field_conditions(&self) -> bool {
        !self.criteria.is_empty()
    }

    fn has_field_states(&self) -> bool {
        !self.next_states.is_empty()
    }

    fn change_field_states(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        _breaking: &[usize],
    ) -> Result<Release, NonFinite> {
        match self.body.dimension() {
            _ if self.next_states.is_empty() => Ok(Release::default()),
            2 => self.change_states::<2>(u, way),
            _ => self.change_states::<3>(u, way),
        }
    }

    fn field_margins(&self, u: &[f64], asked: Asked) -> Result<Vec<Judged>, NonFinite> {
        match self.dimension() {
            _ if self.criteria.is_empty() => Ok(Vec::new()),
            2 => self.margins::<2>(u, asked),
            _ => self.margins::<3>(u, asked),
        }
    }

    fn can_lose_bonds(&self) -> bool {
        true
    }

    fn singular(&self) -> Vec<usize> {
        self.whole.as_ref().map_or_else(Vec::new, |_| self.neighborhood.isolated())
    }

    fn watch(&mut self, limits: &[f32]) -> bool {
        let Some(rows) = &mut self.rows else { return false };
        let whole = self.whole.as_ref().map_or(&self.neighborhood, |of| &of.lost.neighborhood);
        rows.watch(whole, limits, self.slabs.len());
        true
    }

    fn exceeding(&self, measure: Measure) -> Option<Vec<Range<usize>>> {
        let watched =
            self.rows.as_ref().filter(|_| measure == Measure::Length)?.watched.as_ref()?;
        let slabs = (0..self.slabs.len()).filter(|slab| watched.is_beyond(*slab));
        Some(slabs.map(|slab| self.slabs.owners(slab)).collect())
    }

    fn lose(&mut self, bonds: &[usize]) {
        self.lose_bonds(bonds);
    }

    fn regain(&mut self, bonds: &[usize]) {
        self.regain_bonds(bonds);
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.dimension() {
            2 => self.hessian_in::<2>(u),
            _ => self.hessian_in::<3>(u),
        }
    }
}

/// The Hessian with the second derivatives of all bonds and states.
struct StateHessian<'a> {
    energy: &'a StateEnergy,
    linear: Linear,
    /// Room for products.
    changes: Pool<Vec<f64>>,
}

impl Hessian for StateHessian<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        let n = self.energy.body.positions().len();
        assert!(p.len() == n && product.len() == n, "vectors are n x d");
        let mut changes = self.changes.take(Vec::new);
        product.fill(0.0);
        match self.energy.dimension() {
            2 => self.energy.multiply::<2>(&self.linear, p, &mut changes, product),
            _ => self.energy.multiply::<3>(&self.linear, p, &mut changes, product),
        }
    }
}
