//! Energies of deformation gradients, `psi(F)`: correspondence peridynamics.
//!
//! | module | does |
//! |---|---|
//! | [`influence`] | influence functions `w(L)` |
//! | `moments`, `operator` | `F_i - I = sum_j V_j (u_j - u_i) x Psi_ij`, and the transpose |
//! | `sweep`, `batch` | what is asked of an energy of the fields `u` and `H`, at points and at bonds; laws over batches |
//! | `stabilisation` | energies of what neighbours deviate from a point's deformation gradient |
//! | `quadrature` | deformation gradients at bonds |
//! | `shares` | the energy and its virials point by point |
//! | `functions` | conditions of deformation gradients under which bonds break, and what is remembered next |
//! | `linear` | second derivatives by the fields, of which the stored Hessian is made |
//! | `elastic` | the law at rest: stiffnesses of stabilisation and of springs like the Hessian |
//!
//! There is one way from displacements to an energy and back: displacements give `H = F - I` at the
//! points, laws and bonds give derivatives by `H` and by `u`, and the transpose of the first map
//! takes the former to forces. Products with the Hessian go the same way with the displacements
//! replaced by a direction. Strain comes from displacements, never from positions.
//!
//! Ganzenmueller, Hiermaier, May 2015 (correspondence models are total Lagrangian SPH); Partmann,
//! Wieners, Weinberg 2026 for the models and their names (CC, CS, CW, BAQP). Equation (4.33) there
//! is not the gradient of the energy, (4.31) is.

mod batch;
mod broken;
mod columns;
mod elastic;
mod error;
mod functions;
pub mod influence;
mod linear;
mod moments;
mod operator;
mod quadrature;
mod rows;
mod shares;
mod stabilisation;
mod sweep;
#[cfg(test)]
mod tests;
mod words;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use crate::assembly::error::check_neighbors;
use crate::assembly::{AssemblyError, sum::Sum};
use crate::body::Body;
use crate::energy::{Argument, Energy, Hessian, NonFinite, Wanted, check_sizes};
use crate::fields::stored::{self, Tensor};
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};
use crate::interaction::{Report, Slabs};
use crate::kernel::{Variables, VariablesLaw};
use crate::materials::{LawOfPoints, Materials, Place};
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;
use crate::weights::check_families;
use broken::Whole;
pub use error::DeformationError;
use influence::{Influence, influences};
use linear::{Bonds, FieldStiffness};
pub use moments::OperatorOrder;
use operator::GradientOperator;
use quadrature::BondQuadrature;
use stabilisation::Deviations;
pub use stabilisation::Stabilisation;
use sweep::{Duals, Failure, Fields, Parts, Pass, over_bonds, over_points};

/// Where the energy density is evaluated, and what keeps displacements that it does not see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Discretisation {
    /// `W = sum_i V_i psi(F_i)` (CC; total Lagrangian SPH). Displacements that alternate from point
    /// to point may leave every `F_i` as it is.
    Nodal,
    /// The same with the energy of the deviations from `F_i` (CS, CW).
    Stabilised(Stabilisation),
    /// `psi` at the bonds (BAQP, partmann2026 4.21 to 4.31): nothing alternates for free.
    #[default]
    BondQuadrature,
}

/// How a body gets its deformation gradients.
#[derive(Clone, Copy)]
pub struct Formulation<'a> {
    /// In m.
    pub horizon: f64,
    /// Which polynomials are differentiated exactly.
    pub order: OperatorOrder,
    /// Where the energy density is evaluated.
    pub discretisation: Discretisation,
    /// How much a neighbour counts.
    pub influence: &'a dyn Influence,
}

/// The discrete total energy of an energy density of the deformation gradient.
///
/// Every sum has an order that the body alone decides: the bits do not depend on the number of
/// threads.
pub struct DeformationEnergy {
    body: Arc<Body>,
    operator: GradientOperator,
    law: Box<dyn VariablesLaw>,
    /// Where the law is that of several materials.
    materials: Option<Arc<Materials>>,
    discretisation: Discretisation,
    places: Places,
    /// By which bonds break.
    criteria: Vec<FamilyCriterion>,
    /// What is remembered.
    next_states: Vec<FamilyNextState>,
    /// The families before bonds were lost.
    whole: Option<Box<Whole>>,
    slabs: Slabs,
    /// `psi(F)`, and `stabilisation` where there is one.
    names: Arc<[String]>,
    pattern: OnceLock<Arc<BlockPattern>>,
    bond_pattern: OnceLock<Arc<BlockPattern>>,
    /// Room for passes.
    room: Pool<Room>,
}

/// What passes work with, from point to point.
#[derive(Default)]
struct Room {
    /// Displacement gradients, and derivatives by them, `d x d` for each point.
    h: Vec<f64>,
    stress: Vec<f64>,
    /// The latter column by column.
    columns: Vec<f64>,
    parts: Parts,
}

/// Tensors row by row, from their numbers.
fn tensors<const D: usize>(numbers: &mut [f64]) -> &mut [Tensor<D>] {
    numbers.as_chunks_mut::<D>().0.as_chunks_mut::<D>().0
}

/// The discretisation with its weights.
enum Places {
    Points,
    Stabilised(Deviations),
    Bonds(BondQuadrature),
}

impl DeformationEnergy {
    /// Finds the neighbours and the weights of all families. `law` is `psi(F)` in J/m^d with its
    /// derivatives.
    ///
    /// # Errors
    ///
    /// Points without neighbours, shape tensors that are singular or nearly so (condition above
    /// 1e12), influence functions that are not finite, a law of other variables.
    pub fn new(
        body: Arc<Body>,
        formulation: Formulation<'_>,
        law: Box<dyn VariablesLaw>,
    ) -> Result<DeformationEnergy, DeformationError> {
        let neighborhood =
            Neighborhood::new(&body, formulation.horizon).map_err(AssemblyError::from)?;
        DeformationEnergy::among(body, Arc::new(neighborhood), formulation, law)
    }

    /// Takes neighbours within the formulation's horizon that energies of the body share.
    ///
    /// # Errors
    ///
    /// As [`DeformationEnergy::new`].
    pub fn among(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        formulation: Formulation<'_>,
        law: Box<dyn VariablesLaw>,
    ) -> Result<DeformationEnergy, DeformationError> {
        DeformationEnergy::of_materials(body, neighborhood, formulation, None, law)
    }

    /// The same for a body of several materials: points, and bonds by the interfaces between their ends,
    /// take the law of their number. See [`crate::materials::ByMaterial`].
    ///
    /// # Errors
    ///
    /// As [`DeformationEnergy::new`].
    pub fn of_materials(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        formulation: Formulation<'_>,
        materials: Option<Arc<Materials>>,
        law: Box<dyn VariablesLaw>,
    ) -> Result<DeformationEnergy, DeformationError> {
        let Formulation { horizon, order, discretisation, influence } = formulation;
        assert_eq!(neighborhood.horizon(), horizon, "neighbours within this horizon");
        let d = body.dimension();
        if law.n_variables() != d * d {
            return Err(DeformationError::WrongLaw { found: law.n_variables(), dimension: d });
        }
        check_neighbors(&body, &neighborhood)?;
        check_families(&body).map_err(AssemblyError::from)?;
        let influence = influences(&body, &neighborhood, influence)?;
        let operator = GradientOperator::new(&body, neighborhood, order, &influence)?;
        let of_points = LawOfPoints { law: &*law, materials: materials.as_deref() };
        let places = Places::new(&operator, &influence, of_points, discretisation)?;
        let slabs = Slabs::new(operator.neighborhood());
        let is_stabilised = matches!(places, Places::Stabilised(_));
        let names = ["psi(F)"].into_iter().chain(is_stabilised.then_some("stabilisation"));
        let names = names.map(String::from).collect();
        let (pattern, bond_pattern) = (OnceLock::new(), OnceLock::new());
        let room = Pool::new();
        Ok(DeformationEnergy {
            body,
            operator,
            law,
            materials,
            discretisation,
            places,
            criteria: Vec::new(),
            next_states: Vec::new(),
            whole: None,
            slabs,
            names,
            pattern,
            bond_pattern,
            room,
        })
    }

    fn law(&self) -> LawOfPoints<'_> {
        LawOfPoints { law: &*self.law, materials: self.materials.as_deref() }
    }

    /// The body.
    pub fn body(&self) -> &Arc<Body> {
        &self.body
    }

    /// Who is within the horizon of whom.
    pub fn neighborhood(&self) -> &Neighborhood {
        self.operator.neighborhood()
    }

    /// The largest condition number of a shape tensor, of lengths in horizons.
    pub fn condition(&self) -> f64 {
        self.operator.condition()
    }

    /// Whether the pattern of the Hessian has been built, which only a stored one needs.
    pub fn has_pattern(&self) -> bool {
        self.pattern.get().is_some()
    }

    /// `F_i - I` of all points at displacements `u` (`n x d`, m): `n x d x d`, row by row.
    pub fn displacement_gradients(&self, u: &[f64]) -> Vec<f64> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.body.dimension() {
            2 => self.gradients::<2>(u).into_flattened().into_flattened(),
            _ => self.gradients::<3>(u).into_flattened().into_flattened(),
        }
    }

    fn gradients<const D: usize>(&self, u: &[f64]) -> Vec<Tensor<D>> {
        let mut h = vec![[[0.0; D]; D]; self.body.n_points()];
        self.operator.gradient(u, &mut h);
        h
    }

    fn gradients_in<'a, const D: usize>(
        &self,
        u: &[f64],
        room: &'a mut Vec<f64>,
    ) -> &'a [Tensor<D>] {
        room.resize(self.body.n_points() * D * D, 0.0);
        let h = tensors::<D>(room);
        self.operator.gradient(u, h);
        h
    }

    /// The energy of the fields; `duals` become its derivatives, or products.
    fn sweep<const D: usize>(
        &self,
        fields: Fields<'_, D>,
        pass: Pass<'_, D>,
        mut duals: Duals<'_, D>,
        parts: &mut Parts,
    ) -> Result<[f64; 2], Failure> {
        let (law, volumes) = (self.law(), self.body.volumes());
        let whole = (&*self.body, self.operator.neighborhood(), &self.slabs);
        let mut stabilisation = Sum::default();
        let deformation = match &self.places {
            Places::Bonds(bonds) => over_bonds(&self.slabs, duals, parts, |slab, duals| {
                bonds.visit(law, whole, slab, (fields, pass), duals)
            })?,
            places => {
                let deformation = over_points(law, volumes, fields, pass, &mut duals, parts)?;
                if let Places::Stabilised(deviations) = places {
                    stabilisation = over_bonds(&self.slabs, duals, parts, |slab, duals| {
                        Ok(deviations.visit(whole, slab, (fields, pass), duals))
                    })?;
                }
                deformation
            }
        };
        Ok([deformation.value(), stabilisation.value()])
    }

    /// The energy and, unless `out` is absent, its derivative at `u`.
    fn assemble<const D: usize>(
        &self,
        u: &[f64],
        out: Option<&mut [f64]>,
        energies: &mut [f64],
    ) -> Result<(), NonFinite> {
        let mut room = self.room.take(Room::default);
        let Room { h, stress, columns, parts } = &mut *room;
        let h = self.gradients_in::<D>(u, h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let found = match out {
            None => self.sweep(fields, Pass::Energy, Duals::default(), parts),
            Some(out) => {
                out.fill(0.0);
                self.back(fields, Pass::Gradient, (stress, columns, parts), out)
            }
        };
        let found = found.map_err(|failure| self.failed(failure, u))?;
        energies.iter_mut().zip(found).for_each(|(part, energy)| *part = energy);
        Ok(())
    }

    /// The energy of the fields; adds its derivative, or the product, to `out`.
    fn back<const D: usize>(
        &self,
        fields: Fields<'_, D>,
        pass: Pass<'_, D>,
        (stress, columns, parts): (&mut Vec<f64>, &mut Vec<f64>, &mut Parts),
        out: &mut [f64],
    ) -> Result<[f64; 2], Failure> {
        stress.clear();
        stress.resize(fields.h.len() * D * D, 0.0);
        let stress = tensors::<D>(stress);
        let duals = Duals { stress, force: out.as_chunks_mut::<D>().0, ..Duals::default() };
        let energy = self.sweep(fields, pass, duals, parts)?;
        self.operator.add_transpose(stress, columns, out);
        Ok(energy)
    }

    fn evaluate_in<const D: usize>(
        &self,
        u: &[f64],
        wanted: Wanted<'_>,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let assemble = |forces: Option<&mut [f64]>| self.assemble::<D>(u, forces, parts);
        stored::evaluate(wanted, assemble, || self.stiffness::<D>(u))
    }

    /// Second derivatives by the fields.
    fn stiffness<const D: usize>(&self, u: &[f64]) -> Result<FieldStiffness<'_, D>, NonFinite> {
        let h = self.gradients::<D>(u);
        let fields = Fields { u: u.as_chunks::<D>().0, h: &h };
        let make = || {
            let (law, bonds) = match &self.places {
                Places::Points => (Some(self.law()), Bonds::None),
                Places::Stabilised(deviations) => (Some(self.law()), Bonds::Deviations(deviations)),
                Places::Bonds(bonds) => {
                    let place = (&*self.body, self.operator.neighborhood());
                    (None, Bonds::Quadrature(bonds.stiffness(self.law(), place, fields)?))
                }
            };
            let whole = (&*self.body, &self.slabs);
            FieldStiffness::new(whole, &self.operator, law, fields, bonds)
        };
        make().map_err(|failure| self.failed(failure, u))
    }

    fn failed(&self, failure: Failure, u: &[f64]) -> NonFinite {
        let d = self.body.dimension();
        NonFinite {
            argument: Argument::DeformationGradient,
            displacements: failure
                .points
                .iter()
                .flat_map(|&point| &u[point * d..(point + 1) * d])
                .copied()
                .collect(),
            points: failure.points,
            value: failure.determinant,
            reference: 1.0,
            inverted: false,
        }
    }
}

impl Energy for DeformationEnergy {
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
        let mut report = Report::of_families(self.neighborhood(), self.body.counted());
        if self.operator.has_rows() {
            report.ways.push("rows");
        }
        report
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        let reach = if matches!(self.places, Places::Bonds(_)) { 3 } else { 2 };
        self.pattern.get_or_init(|| {
            let own = || self.operator.neighborhood();
            let whole = self.whole.as_ref().map_or_else(own, |whole| &whole.lost.neighborhood);
            Arc::new(BlockPattern::of_reach(whole, self.dimension(), reach))
        })
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        Some(self.bond_pattern.get_or_init(|| {
            Arc::new(BlockPattern::of_bonds(self.operator.neighborhood(), self.dimension()))
        }))
    }

    fn springs(&self, u: &[f64], springs: &mut BlockMatrix) {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        let whole = (&*self.body, &self.slabs);
        match self.dimension() {
            2 => elastic::springs::<2>(whole, &self.operator, self.law(), u, springs),
            _ => elastic::springs::<3>(whole, &self.operator, self.law(), u, springs),
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
        shares.fill(0.0);
        match self.body.dimension() {
            2 => self.share::<2>(u, shares),
            _ => self.share::<3>(u, shares),
        }
    }

    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.shares(u, shares)?;
        if self.parts().len() > 1 {
            match self.body.dimension() {
                2 => self.keep_part::<2>(part, u, shares),
                _ => self.keep_part::<3>(part, u, shares),
            }?;
        }
        Ok(())
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        virials.fill(0.0);
        match self.body.dimension() {
            2 => self.virial::<2>(u, virials),
            _ => self.virial::<3>(u, virials),
        }
    }

    fn displacement_gradients(&self, u: &[f64]) -> Option<Vec<f64>> {
        Some(DeformationEnergy::displacement_gradients(self, u))
    }

    fn stretches_across(&self, gradients: &[f64]) -> Option<Vec<f64>> {
        let (n, d) = (self.body.n_points(), self.body.dimension());
        assert_eq!(gradients.len(), n * d * d, "a tensor for each point");
        let component = |k: usize| gradients.iter().skip(k).step_by(d * d);
        let change: Vec<f64> = (0..d * d).flat_map(|k| component(k).copied()).collect();
        let unit = |k: usize| if k / d == k % d { 1.0 } else { 0.0 };
        let current: Vec<f64> =
            (0..d * d).flat_map(|k| component(k).map(move |h| unit(k) + h)).collect();
        let (law, mut given, mut across) = (self.law(), Vec::new(), vec![0.0; n]);
        law.give(n, Place::at, &mut given);
        let (given, laws) = (&given[..], law.numbers(0..n));
        let at = Variables { n, current: &current, change: &change, given, laws };
        law.law.stretch_across(at, &mut across).then_some(across)
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
        breaking: &[usize],
    ) -> Result<Release, NonFinite> {
        match self.body.dimension() {
            _ if self.next_states.is_empty() => Ok(Release::default()),
            2 => self.change_states::<2>(u, way, breaking),
            _ => self.change_states::<3>(u, way, breaking),
        }
    }

    fn field_margins(&self, u: &[f64], asked: Asked) -> Result<Vec<Judged>, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
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
        (0..self.body.n_points()).filter(|point| self.operator.is_released(*point)).collect()
    }

    fn lose(&mut self, bonds: &[usize]) {
        self.lose_bonds(bonds);
    }

    fn regain(&mut self, bonds: &[usize]) {
        self.regain_bonds(bonds);
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        Ok(match self.dimension() {
            2 => Box::new(FieldHessian::<2> { energy: self, u: rows(u), h: self.gradients(u) }),
            _ => Box::new(FieldHessian::<3> { energy: self, u: rows(u), h: self.gradients(u) }),
        })
    }
}

/// The Hessian at displacements and their gradients at all points: each product evaluates the law again.
struct FieldHessian<'a, const D: usize> {
    energy: &'a DeformationEnergy,
    /// In m.
    u: Vec<[f64; D]>,
    h: Vec<Tensor<D>>,
}

impl<const D: usize> Hessian for FieldHessian<'_, D> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        let n = self.u.len() * D;
        assert!(p.len() == n && product.len() == n, "vectors are n x d");
        let mut room = self.energy.room.take(Room::default);
        let Room { h, stress, columns, parts } = &mut *room;
        let dh = self.energy.gradients_in::<D>(p, h);
        let along = Pass::Product(Fields { u: p.as_chunks::<D>().0, h: dh });
        let fields = Fields { u: &self.u, h: &self.h };
        product.fill(0.0);
        if self.energy.back(fields, along, (stress, columns, parts), product).is_err() {
            product.fill(f64::NAN);
        }
    }
}

/// A vector of every point.
fn rows<const D: usize>(u: &[f64]) -> Vec<[f64; D]> {
    u.as_chunks::<D>().0.to_vec()
}
