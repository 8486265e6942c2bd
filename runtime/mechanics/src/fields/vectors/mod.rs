//! Energies of what points gather of the vectors of bonds: shape tensors, deformation gradients and whatever else a
//! potential writes.
//!
//! A point gathers integrals over its family, `I_i = sum_j V_j g(xi_ij, Xi_ij)`, and works out functions of them,
//! `s_i = s(I_i)`. The total energy is `W = sum_i V_i w_i` with
//! `w_i = psi(s_i) + 1/2 sum_j V_j phi(xi_ij, s_i, s_j)`, where `s` stands for integrals and functions alike. A
//! bond is seen from both of its ends, by either as its own vector.
//!
//! | module | does |
//! |---|---|
//! | `passes` | what points gather, energies, forces; and the same of directions: products with the Hessian |
//! | `linear` | second derivatives by what points gather, of which the stored Hessian is made |
//! | `broken` | families that lose bonds |
//! | `functions` | conditions under which bonds break, what points remember |
//!
//! The derivative goes the way back: `a_i = dw/ds_i`, then what these pull at the integrals, then what a bond pulls
//! with, `t_ij = 1/2 dphi/dxi + a_i . dg/dxi`. Kernels give all of it ([`piola_compiler::VectorKernels`]), for
//! values and for changes in a direction, so that forces and products are one way through the bonds.
//!
//! Partmann, Wieners, Weinberg 2026 for the models that are written so (CC, CS, CW, BAQP).

mod broken;
mod error;
mod functions;
mod linear;
mod passes;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use piola_compiler::{FamilyKernel, VectorKernels};

use crate::assembly::AssemblyError;
use crate::assembly::error::check_neighbors;
use crate::body::Body;
use crate::energy::{Energy, Hessian, NonFinite, Wanted, check_sizes};
use crate::fields::lost::LostBonds;
use crate::fields::{springs, stored};
use crate::fracture::{Asked, FamilyCriterion, FamilyNextState, Judged, Release};
use crate::interaction::{Report, Slabs};
use crate::materials::{Fields, Materials};
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;
use crate::weights::check_families;
pub use error::VectorError;
use linear::VectorStiffness;
use passes::{Gathered, Room, Sought};

/// What potentials gather of vectors, and their energies.
pub struct VectorLaws {
    /// The functions of each law, by its number: a point gathers, and sees its bonds, by the law of its material.
    /// Where one of them holds what neighbours gather, all laws gather the same numbers.
    pub of_law: Vec<Option<VectorKernels>>,
    /// What energies per volume of the solid are multiplied by in two dimensions, in m.
    pub thickness: f64,
    /// What the energies of points and of bonds are functions of, for the names of the parts.
    pub arguments: [String; 2],
}

/// The discrete total energy of what points gather of vectors.
pub struct VectorEnergy {
    body: Arc<Body>,
    neighborhood: Arc<Neighborhood>,
    slabs: Slabs,
    laws: VectorLaws,
    /// With the fields of the laws, among them the direction of bonds.
    materials: Arc<Materials>,
    /// `psi(H)`, `psi(xi, H)`: as the potential writes them, those that are modelled.
    names: Arc<[String]>,
    pattern: OnceLock<Arc<BlockPattern>>,
    bond_pattern: OnceLock<Arc<BlockPattern>>,
    /// What springs like the bonds at rest have, over the volumes of their ends, times their length.
    stiffness: OnceLock<f64>,
    /// Which points have no energy, because too little is left of their families.
    is_released: Vec<bool>,
    criteria: Vec<FamilyCriterion<FamilyKernel>>,
    next_states: Vec<FamilyNextState<FamilyKernel>>,
    /// The families before bonds were lost, and which are.
    lost: Option<LostBonds>,
    /// Room for passes, and for their threads.
    gathered: Pool<Gathered>,
    room: Pool<Room>,
}

impl VectorLaws {
    fn present(&self) -> impl Iterator<Item = (usize, &VectorKernels)> {
        self.of_law.iter().enumerate().filter_map(|(law, kernels)| Some((law, kernels.as_ref()?)))
    }

    /// Whether points have energies, and bonds.
    fn has(&self) -> [bool; 2] {
        let has = |part: fn(&VectorKernels) -> bool| self.present().any(|(_, own)| part(own));
        [has(|own| own.points.is_some()), has(|own| own.bonds.is_some())]
    }

    fn has_neighbours(&self) -> bool {
        self.present().any(|(_, kernels)| kernels.has_neighbours())
    }
}

impl VectorEnergy {
    /// Takes neighbours that energies of the body share, and the materials with their fields. Without them all
    /// points are of one law, which takes no fields but the direction of bonds.
    ///
    /// # Errors
    /// Points without neighbours; those whose neighbours do not span space, where the law has functions of
    /// integrals; more bonds than can be numbered.
    pub fn new(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        materials: Option<Arc<Materials>>,
        laws: VectorLaws,
    ) -> Result<VectorEnergy, VectorError> {
        check_neighbors(&body, &neighborhood)?;
        check_families(&body).map_err(AssemblyError::from)?;
        if u32::try_from(2 * neighborhood.n_bonds()).is_err() {
            return Err(VectorError::TooManyBonds { bonds: neighborhood.n_bonds() });
        }
        let parts = laws.arguments.iter().zip(laws.has()).filter(|part| part.1);
        let names = parts.map(|(argument, _)| format!("psi({argument})")).collect();
        let materials = materials.unwrap_or_else(|| Arc::new(of_directions(&body)));
        let n = body.n_points();
        let mut energy = VectorEnergy {
            slabs: Slabs::new(&neighborhood),
            body,
            neighborhood,
            laws,
            materials,
            names,
            pattern: OnceLock::new(),
            bond_pattern: OnceLock::new(),
            stiffness: OnceLock::new(),
            is_released: vec![false; n],
            criteria: Vec::new(),
            next_states: Vec::new(),
            lost: None,
            gathered: Pool::new(),
            room: Pool::new(),
        };
        let lacking: Vec<usize> = (0..n).filter(|point| !energy.has_family(*point)).collect();
        // Points whose families a slab has cut are released where these span nothing.
        lacking.iter().for_each(|point| energy.is_released[*point] = true);
        match lacking.into_iter().find(|point| !energy.body.is_cut(*point)) {
            None => Ok(energy),
            Some(point) => Err(VectorError::Flat {
                point: energy.body.user_index()[point] as usize,
                position: energy.body.position(point).to_vec(),
                neighbors: energy.neighborhood.row(point).len(),
            }),
        }
    }

    /// The body.
    pub fn body(&self) -> &Arc<Body> {
        &self.body
    }

    /// Who is within the horizon of whom, of what is left.
    pub fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// What all points gather at displacements `u` (`n x d`, m), point by point: integrals and functions of
    /// them in the order in which they are written.
    pub fn gathered(&self, u: &[f64]) -> Vec<f64> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        let mut gathered = self.gathered.take(Gathered::default);
        match self.body.dimension() {
            2 => self.gather::<2>(u, None, &mut gathered),
            _ => self.gather::<3>(u, None, &mut gathered),
        }
        gathered.values.clone()
    }

    fn fields(&self) -> Option<&Fields> {
        self.materials.fields()
    }

    /// The number of the law of a point.
    fn law_of(&self, point: usize) -> usize {
        usize::from(self.materials.of(point))
    }

    /// How many numbers a point gathers.
    fn n_gathered(&self) -> usize {
        self.laws.present().map(|(_, kernels)| kernels.n_gathered).max().unwrap_or(0)
    }

    fn assemble<const D: usize>(
        &self,
        u: &[f64],
        out: Option<&mut [f64]>,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let mut gathered = self.gathered.take(Gathered::default);
        let sought = out.map_or(Sought::Energy, Sought::Forces);
        let energies = self.energies::<D>(u, &mut gathered, sought)?;
        let energies = energies.into_iter().zip(self.laws.has()).filter(|part| part.1);
        parts.iter_mut().zip(energies).for_each(|(part, (energy, _))| *part = energy);
        Ok(())
    }

    fn evaluate_in<const D: usize>(
        &self,
        u: &[f64],
        wanted: Wanted<'_>,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let assemble = |forces: Option<&mut [f64]>| self.assemble::<D>(u, forces, parts);
        stored::evaluate(wanted, assemble, || VectorStiffness::<D>::new(self, u))
    }

    fn named(&self, point: usize, gathered: Option<f64>, u: &[f64]) -> NonFinite {
        NonFinite::of_gathered(self.body.dimension(), point, gathered, u)
    }

    /// The stiffness of springs: that which keeps the energy of a uniform expansion, of all springs together.
    fn like_uniform_expansion<const D: usize>(&self) -> f64 {
        let positions = self.body.positions();
        let n = self.body.n_points();
        let mean: [f64; D] = std::array::from_fn(|c| {
            positions.iter().skip(c).step_by(D).fold(0.0, |sum, x| sum + x) / n as f64
        });
        let p: Vec<f64> = positions.iter().enumerate().map(|(k, x)| x - mean[k % D]).collect();
        let rest = vec![0.0; p.len()];
        let energy = self.hessian(&rest).map(|hessian| {
            let mut product = vec![0.0; p.len()];
            hessian.multiply(&p, &mut product);
            product.iter().zip(&p).fold(0.0, |sum, (x, p)| sum + x * p)
        });
        let volumes = self.body.volumes();
        let mut springs = 0.0;
        for i in 0..n {
            for j in self.neighborhood.upper(i) {
                let j = j as usize;
                springs += volumes[i] * volumes[j] * self.body.distance([i, j]);
            }
        }
        match energy.map(|energy| energy / springs) {
            Ok(stiffness) if stiffness > 0.0 && stiffness.is_finite() => stiffness,
            _ => 1.0 / springs,
        }
    }

    fn like_bonds<const D: usize>(&self, u: &[f64], matrix: &mut BlockMatrix) {
        let all = *self.stiffness.get_or_init(|| self.like_uniform_expansion::<D>());
        let volumes = self.body.volumes();
        let stiffness = |_: usize, [i, j]: [usize; 2], dx: &[f64; D]| {
            let length = dx.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
            all * volumes[i] * volumes[j] / length
        };
        springs::fill(&self.body, (&self.neighborhood, &self.slabs), u, stiffness, matrix);
    }
}

/// One material with the direction of bonds as its only fields.
fn of_directions(body: &Arc<Body>) -> Materials {
    let d = body.dimension();
    let fields = Fields::new(body.n_points(), &[vec![0.0; d]], true);
    let fields = fields.with_directions((0..d as u8).map(Some).collect(), body);
    Materials::new(vec![0; body.n_points()], Vec::new()).with_fields(Arc::new(fields))
}

impl Energy for VectorEnergy {
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
        Report::of_families(&self.neighborhood, self.body.counted())
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        let whole = self.lost.as_ref().map_or(&self.neighborhood, |lost| &lost.neighborhood);
        let reach = if self.laws.has_neighbours() { 3 } else { 2 };
        let make = || Arc::new(BlockPattern::of_reach(whole, self.dimension(), reach));
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
        let mut gathered = self.gathered.take(Gathered::default);
        match self.dimension() {
            2 => self.energies::<2>(u, &mut gathered, Sought::Energy)?,
            _ => self.energies::<3>(u, &mut gathered, Sought::Energy)?,
        };
        let densities = gathered.points.iter().zip(&gathered.bonds).zip(self.body.volumes());
        for (share, ((points, bonds), volume)) in shares.iter_mut().zip(densities) {
            *share = (points + bonds) * volume;
        }
        Ok(())
    }

    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        if self.names.len() == 1 {
            return self.shares(u, shares);
        }
        let mut gathered = self.gathered.take(Gathered::default);
        match self.dimension() {
            2 => self.energies::<2>(u, &mut gathered, Sought::Energy)?,
            _ => self.energies::<3>(u, &mut gathered, Sought::Energy)?,
        };
        let densities = [&gathered.points, &gathered.bonds][part].iter().zip(self.body.volumes());
        shares.iter_mut().zip(densities).for_each(|(share, (psi, volume))| *share = psi * volume);
        Ok(())
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.dimension() {
            2 => self.changes_of_shares::<2>(u, virials),
            _ => self.changes_of_shares::<3>(u, virials),
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
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        match self.dimension() {
            2 => self.margins::<2>(u, asked),
            _ => self.margins::<3>(u, asked),
        }
    }

    fn can_lose_bonds(&self) -> bool {
        true
    }

    fn singular(&self) -> Vec<usize> {
        (0..self.body.n_points()).filter(|point| self.is_released[*point]).collect()
    }

    fn lose(&mut self, bonds: &[usize]) {
        self.lose_bonds(bonds);
    }

    fn regain(&mut self, bonds: &[usize]) {
        self.regain_bonds(bonds);
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        assert_eq!(u.len(), self.body.positions().len(), "displacements are n x d");
        let mut gathered = Gathered::default();
        match self.dimension() {
            2 => self.energies::<2>(u, &mut gathered, Sought::Adjoint)?,
            _ => self.energies::<3>(u, &mut gathered, Sought::Adjoint)?,
        };
        Ok(Box::new(VectorHessian { energy: self, u: u.to_vec(), gathered }))
    }
}

/// The Hessian, by what points gather at the displacements that it was made for.
struct VectorHessian<'a> {
    energy: &'a VectorEnergy,
    u: Vec<f64>,
    gathered: Gathered,
}

impl Hessian for VectorHessian<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        let n = self.energy.body.positions().len();
        assert!(p.len() == n && product.len() == n, "vectors are n x d");
        let mut change = self.energy.gathered.take(Gathered::default);
        let base = Some((&self.u[..], &self.gathered));
        match self.energy.dimension() {
            2 => self.energy.pass::<2>(p, base, &mut change, Sought::Forces(product)),
            _ => self.energy.pass::<3>(p, base, &mut change, Sought::Forces(product)),
        }
    }
}
