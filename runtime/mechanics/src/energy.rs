//! Energies of a body as the solvers see them, and their sum.

mod differences;
pub mod inertia;
mod non_finite;
mod total;

pub use non_finite::NonFinite;
pub use total::{Term, Total};

use std::ops::Range;
use std::sync::Arc;

use crate::fracture::{Asked, Fracture, Held, Judged, Release};
use crate::interaction::{Inverted, Ranks, Report};
use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};

/// An energy in J (per metre of thickness in two dimensions) by its parts, named as a potential writes
/// them: `psi(l)`, `psi(a)`, `psi(v)`, `psi(F)`, `psi(theta)`; `stabilisation`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnergyParts {
    names: Arc<[String]>,
    values: Vec<f64>,
}

impl EnergyParts {
    /// One value in J for each name.
    pub fn new(names: &Arc<[String]>, values: Vec<f64>) -> EnergyParts {
        assert_eq!(names.len(), values.len(), "a value for each name");
        EnergyParts { names: Arc::clone(names), values }
    }

    /// The total energy.
    pub fn total(&self) -> f64 {
        total(&self.values)
    }

    /// The sum of the absolute values: the scale of the rounding error of the total.
    pub fn magnitude(&self) -> f64 {
        magnitude(&self.values)
    }

    /// The part of this name; 0 where there is none.
    pub fn of(&self, name: &str) -> f64 {
        self.iter().find(|part| part.0 == name).map_or(0.0, |part| part.1)
    }

    /// Names and values, in the order of the terms.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.names.iter().map(String::as_str).zip(self.values.iter().copied())
    }
}

/// The sum of the parts of an energy.
pub fn total(parts: &[f64]) -> f64 {
    parts.iter().fold(0.0, |sum, part| sum + part)
}

/// The sum of their absolute values.
pub fn magnitude(parts: &[f64]) -> f64 {
    parts.iter().fold(0.0, |sum, part| sum + part.abs())
}

/// How products with the Hessian come about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Products {
    /// By the derivatives of the energy.
    #[default]
    Exact,
    /// By one-sided differences of forces, `(R(u + e v) - R(u))/e`.
    OneSided,
    /// By central differences of forces, `(R(u + e v) - R(u - e v))/(2 e)`: partmann2026 (3.73).
    Central,
}

impl Products {
    /// Their relative error for displacements that differ from point to point, to an order of
    /// magnitude; of smooth ones, where most of a product cancels, it is larger.
    pub fn error(self) -> f64 {
        let step = self.balanced(f64::EPSILON / 2.0);
        match self {
            Products::Exact => 0.0,
            Products::OneSided => step,
            Products::Central => step * step,
        }
    }

    /// The step, relative to what forces change over, by which rounding errors of this size over
    /// the step are the same as the errors of the order.
    pub(crate) fn balanced(self, rounding: f64) -> f64 {
        match self {
            Products::Exact => 0.0,
            Products::OneSided => rounding.sqrt(),
            Products::Central => libm::cbrt(rounding),
        }
    }
}

/// What an energy density depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Argument {
    /// The measure of an interaction.
    Measure(Measure),
    /// The deformation gradient at a point or at a bond.
    DeformationGradient,
    /// What is gathered over the family of a point.
    Gathered,
    /// How fast the length of a bond changes: what is dissipated is no energy.
    Rate,
}

/// An interaction on its way to be turned inside out.
#[derive(Clone, Debug, PartialEq)]
pub struct Inversion {
    /// The part of the way, between 0 and 1, up to which no interaction is turned.
    pub part: f64,
    /// The interaction that is turned first, where it has collapsed.
    pub first: NonFinite,
}

/// The Hessian of an energy at the displacements that it was made for, never stored as a matrix.
pub trait Hessian: Sync {
    /// `product` becomes `d2E/du2 p` in N (`n x d`), for `p` in m; NaN where second derivatives are not
    /// finite.
    fn multiply(&self, p: &[f64], product: &mut [f64]);
}

/// What a body dissipates: a Rayleigh potential `R(v; u)` in W, of which dissipative forces are the exact
/// derivatives by velocities. Vectors are `n x d`, in the body's order.
pub trait Dissipation: Send + Sync {
    /// `forces` become `dR/dv` in N at displacements `u` in m and velocities `v` in m/s: their power `dR/dv.v`
    /// is lost.
    ///
    /// # Errors
    /// Forces that are not finite.
    fn forces(&self, u: &[f64], v: &[f64], forces: &mut [f64]) -> Result<(), NonFinite>;

    /// `d2R/dv2` in N s/m at `u` and `v`, for products.
    ///
    /// # Errors
    /// Second derivatives that are not finite.
    fn viscosity(&self, u: &[f64], v: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite>;
}

/// What is worked out beside an energy. What is given is overwritten; vectors are `n x d`.
pub enum Wanted<'a> {
    /// Nothing.
    Energy,
    /// `dE/du` in N.
    Forces(&'a mut [f64]),
    /// `dE/du` in N and `d2E/du2` in N/m, on the pattern of the energy.
    Tangent(&'a mut [f64], &'a mut BlockMatrix),
    /// `dE/du` in N and the diagonal blocks of `d2E/du2` in N/m, `n x d x d` row by row.
    Diagonal(&'a mut [f64], &'a mut [f64]),
}

/// Of triangles of one area at rest in m^2, or tetrahedra of one volume in m^3: by how much that may change before one
/// may break, the least (below 0) and the most, in the same unit; nothing where it is not known.
pub type Limits<'a> = dyn Fn(f64) -> Option<[f64; 2]> + 'a;

/// An energy `E(u)` of a body, its gradient and its Hessian; all are exact derivatives of one energy.
///
/// Displacements `u` are `n x d` row by row, in m, in the body's order. Energies add up in a
/// [`Total`].
pub trait Energy: Send + Sync {
    /// 2 or 3.
    fn dimension(&self) -> usize;

    /// The points whose energy counts here, and at which forces are whole: all, but for a slab of a body
    /// ([`Body::part`](crate::body::Body::part)) its own.
    fn counted(&self) -> Range<usize> {
        0..self.positions().len() / self.dimension()
    }

    /// Positions at rest, `n x d`, in m.
    fn positions(&self) -> &[f64];

    /// The names of its parts.
    fn parts(&self) -> &Arc<[String]>;

    /// What the body consists of, as this energy sees it.
    fn report(&self) -> Report;

    /// Where the Hessian has blocks.
    fn pattern(&self) -> &Arc<BlockPattern>;

    /// Where [`Energy::springs`] has blocks, if there is such a matrix: for energies whose Hessian
    /// reaches so much further than their bonds that it is rather not stored.
    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        None
    }

    /// Fills `springs` with a matrix like the Hessian at `u`, in N/m, that couples bonded points only:
    /// products with the Hessian are preconditioned by it. Of families it is positive semi-definite;
    /// interactions beside them add their own Hessian, which is so near rest.
    fn springs(&self, _u: &[f64], _springs: &mut BlockMatrix) {}

    /// How products of [`Energy::hessian`] come about. Where they are not exact, they are all that
    /// solvers take of the Hessian, but for what they precondition by.
    fn products(&self) -> Products {
        Products::Exact
    }

    /// Whether products of [`Energy::hessian`] take less time than with the stored tangent.
    fn has_quick_products(&self) -> bool {
        false
    }

    /// The energy: `parts` become its parts in J, as many as there are names; and what is wanted
    /// beside it. Without `parts` forces come alone, and need no energies.
    ///
    /// # Errors
    /// Energies or derivatives that are wanted and not finite; what was given is undefined then.
    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite>;

    /// The energy by points: `shares` become J, one number per point. An interaction belongs to its points
    /// in equal parts, a bond with gathered values as these say.
    ///
    /// # Errors
    /// Energies that are not finite.
    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite>;

    /// The same of one of its parts, by its number.
    ///
    /// # Errors
    /// As [`Energy::shares`].
    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        assert!(
            part == 0 && self.parts().len() == 1,
            "an energy of several parts knows their shares"
        );
        self.shares(u, shares)
    }

    /// The energy of the points that [count](Energy::counted), with forces in N (`n x d`) where they are wanted:
    /// `parts` become its parts in J.
    ///
    /// # Errors
    /// As [`Energy::evaluate`].
    fn counted_energy(
        &self,
        u: &[f64],
        forces: Option<&mut [f64]>,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let (counted, n) = (self.counted(), u.len() / self.dimension());
        if counted.len() == n {
            return self.evaluate(u, forces.map_or(Wanted::Energy, Wanted::Forces), parts);
        }
        if let Some(forces) = forces {
            self.evaluate(u, Wanted::Forces(forces), &mut [])?;
        }
        let mut shares = vec![0.0; n];
        for (number, part) in parts.iter_mut().enumerate() {
            self.shares_of(number, u, &mut shares)?;
            *part = total(&shares[counted.clone()]);
        }
        Ok(())
    }

    /// How the energies of points change under a uniform displacement gradient `G` on top of `u`, where
    /// the whole body moves by `G X`: `virials` become `dE_i/dG` in J, `n x d x d` row by row, of the
    /// energies that [`Energy::shares`] gives. Over the volume that is the first Piola-Kirchhoff
    /// stress: of `psi(F)` its derivative, of bonds their virial.
    ///
    /// # Errors
    /// Derivatives that are not finite.
    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite>;

    /// `F - I` of every point at `u`, where the energy is one of deformation gradients: `n x d x d` row by
    /// row.
    fn displacement_gradients(&self, _u: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// Of sheets in plane stress: the stretch across the sheet, `F33`, of each point, for displacement
    /// gradients as [`Energy::displacement_gradients`] gives them; nothing of other energies.
    fn stretches_across(&self, _gradients: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// `d2E/du2` at `u`, for products: what they share is worked out now.
    ///
    /// # Errors
    /// Second derivatives that are not finite, where they are worked out now.
    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite>;

    /// What is turned inside out first on the straight way from `u` to `u + step`, among the
    /// interactions whose energies forbid it.
    fn first_inversion(&self, _u: &[f64], _step: &[f64]) -> Option<Inversion> {
        None
    }

    /// How many interactions are turned inside out at `u`.
    fn inverted(&self, _u: &[f64]) -> Inverted {
        Inverted::default()
    }

    /// Whether the pattern is the same after bonds are lost, which keep their blocks then.
    fn keeps_pattern(&self) -> bool {
        false
    }

    /// Whether bonds break by conditions of deformation gradients, or of gathered values.
    fn has_field_conditions(&self) -> bool {
        false
    }

    /// The margins of conditions of deformation gradients and of gathered values at displacements `u` in m (`n x d`).
    ///
    /// # Errors
    /// Margins that are not finite.
    fn field_margins(&self, _u: &[f64], _asked: Asked) -> Result<Vec<Judged>, NonFinite> {
        Ok(Vec::new())
    }

    /// Whether anything is remembered with deformation gradients, or by points with what they gather.
    fn has_field_states(&self) -> bool {
        false
    }

    /// Changes what of that changes at displacements `u` in m (`n x d`), to which a way `step*direction` has led,
    /// all worked out from states as they are, but for bonds that are about to break, by their numbers,
    /// ascending: how many places change, what the energy falls by, and of which work that takes half.
    ///
    /// # Errors
    /// Next states, energies and forces that are not finite; some states may have changed then.
    fn change_field_states(
        &self,
        _u: &[f64],
        _way: (f64, &[f64]),
        _breaking: &[usize],
    ) -> Result<Release, NonFinite> {
        Ok(Release::default())
    }

    /// Whether [`Energy::lose`] can take out bonds.
    fn can_lose_bonds(&self) -> bool {
        false
    }

    /// Takes out bonds, by their numbers in the neighbourhood: from now on they have no energy.
    fn lose(&mut self, _bonds: &[usize]) {}

    /// The points, ascending, whose families bonds that were taken out have left too small: what is left
    /// determines no deformation gradient, or there is nothing to gather from. They are released.
    fn singular(&self) -> Vec<usize> {
        Vec::new()
    }

    /// Takes out triangles or tetrahedra, by their numbers: from now on they have no energy, while their bonds
    /// keep theirs.
    fn lose_cliques(&mut self, _measure: Measure, _ranks: &Ranks, _numbers: &[usize]) {}

    /// Takes out triangles or tetrahedra as [`Energy::lose_cliques`], and says what they release as
    /// [`Energy::break_bonds`] does.
    ///
    /// # Errors
    /// Energies and forces that are not finite.
    fn break_cliques(
        &mut self,
        _u: &[f64],
        _way: (f64, &[f64]),
        _cliques: (Measure, &Ranks, &[usize]),
    ) -> Result<Release, NonFinite> {
        Ok(Release::default())
    }

    /// Puts back bonds that were taken out, with the triangles and tetrahedra on them: for attempts at an
    /// equilibrium that came to nothing.
    fn regain(&mut self, _bonds: &[usize]) {}

    /// The same of triangles or tetrahedra that were taken out by their numbers.
    fn regain_cliques(&mut self, _measure: Measure, _numbers: &[usize]) {}

    /// Takes how much the square of each bond's length may grow before it may break, in m^2, by its number;
    /// whether passes of forces will say which bonds have grown beyond that.
    fn watch(&mut self, _limits: &[f32]) -> bool {
        false
    }

    /// Takes how much triangles or tetrahedra may shrink (a number below 0) and grow before they may break, in the unit
    /// of their measure, from what it is at rest; whether passes of forces will say which have gone beyond that.
    fn watch_cliques(&mut self, _measure: Measure, _limits: &Limits<'_>) -> bool {
        false
    }

    /// Owners among whose bonds, triangles or tetrahedra some had gone beyond their limits when forces were last worked
    /// out, ascending; nothing where nobody watches.
    fn exceeding(&self, _measure: Measure) -> Option<Vec<Range<usize>>> {
        None
    }

    /// Takes out bonds at displacements `u`, to which a way `step*direction` has led: what they release is
    /// the energy before less the energy after, and `timing` half of the work over that way of the forces
    /// that go with them; of a slab what [counts](Energy::counted), where points beyond that have no `direction`.
    ///
    /// # Errors
    /// Energies and forces that are not finite.
    fn break_bonds(
        &mut self,
        u: &[f64],
        (step, direction): (f64, &[f64]),
        bonds: &[usize],
    ) -> Result<Release, NonFinite> {
        let mut forces = [vec![0.0; u.len()], vec![0.0; u.len()]];
        let mut parts = vec![0.0; self.parts().len()];
        self.counted_energy(u, Some(&mut forces[0]), &mut parts)?;
        let before = total(&parts);
        self.lose(bonds);
        self.counted_energy(u, Some(&mut forces[1]), &mut parts)?;
        let after = total(&parts);
        let [old, new] = &forces;
        let powers = old.iter().zip(new).zip(direction).map(|((old, new), v)| (old - new) * v);
        let power = powers.fold(0.0, |sum, power| sum + power);
        Ok(Release {
            energy: before - after,
            timing: 0.5 * step * power,
            ..Release::of(bonds.len())
        })
    }

    /// Adds what each of some bonds holds at displacements `u`, to which a way `step*direction` has led:
    /// energies of bonds alone, for these may change with what bonds remember.
    ///
    /// # Errors
    /// Energies and forces that are not finite.
    fn add_held(
        &self,
        _u: &[f64],
        _way: (f64, &[f64]),
        _bonds: &[usize],
        _held: &mut [Held],
    ) -> Result<(), NonFinite> {
        Ok(())
    }

    /// The same of triangles or tetrahedra by their numbers, ascending: of energies that hold what these remember.
    ///
    /// # Errors
    /// Energies and forces that are not finite.
    fn add_held_by_cliques(
        &self,
        _u: &[f64],
        _way: (f64, &[f64]),
        _cliques: (Measure, &Ranks, &[usize]),
        _held: &mut [Held],
    ) -> Result<(), NonFinite> {
        Ok(())
    }

    /// The status of a body that can break.
    fn fracture(&self) -> Option<&dyn Fracture> {
        None
    }

    /// What the body dissipates beside its energy; nothing where it dissipates nothing.
    fn dissipation(&self) -> Option<&dyn Dissipation> {
        None
    }

    /// The energy alone.
    ///
    /// # Errors
    /// As [`Energy::evaluate`].
    fn energy(&self, u: &[f64]) -> Result<EnergyParts, NonFinite> {
        self.named(u, Wanted::Energy)
    }

    /// The energy; `forces` (`n x d`) become `dE/du` in N.
    ///
    /// # Errors
    /// As [`Energy::evaluate`].
    fn forces(&self, u: &[f64], forces: &mut [f64]) -> Result<EnergyParts, NonFinite> {
        self.named(u, Wanted::Forces(forces))
    }

    /// The energy; `forces` become `dE/du` in N and `tangent` becomes `d2E/du2` in N/m.
    ///
    /// # Errors
    /// As [`Energy::evaluate`].
    fn tangent(
        &self,
        u: &[f64],
        forces: &mut [f64],
        tangent: &mut BlockMatrix,
    ) -> Result<EnergyParts, NonFinite> {
        self.named(u, Wanted::Tangent(forces, tangent))
    }

    /// The energy; `forces` become `dE/du` in N and `diagonal` (`n x d x d`) the diagonal blocks of
    /// `d2E/du2` in N/m, row by row.
    ///
    /// # Errors
    /// As [`Energy::evaluate`].
    fn tangent_diagonal(
        &self,
        u: &[f64],
        forces: &mut [f64],
        diagonal: &mut [f64],
    ) -> Result<EnergyParts, NonFinite> {
        self.named(u, Wanted::Diagonal(forces, diagonal))
    }

    /// The energy per volume at every point in J/m^d, with one volume per point in m^d.
    ///
    /// # Errors
    /// As [`Energy::shares`].
    fn densities(&self, u: &[f64], volumes: &[f64]) -> Result<Vec<f64>, NonFinite> {
        let mut densities = vec![0.0; volumes.len()];
        self.shares(u, &mut densities)?;
        densities.iter_mut().zip(volumes).for_each(|(share, volume)| *share /= volume);
        Ok(densities)
    }

    /// The energy by the names of its parts, and what is wanted beside it.
    ///
    /// # Errors
    /// As [`Energy::evaluate`].
    fn named(&self, u: &[f64], wanted: Wanted<'_>) -> Result<EnergyParts, NonFinite> {
        let mut values = vec![0.0; self.parts().len()];
        self.evaluate(u, wanted, &mut values)?;
        Ok(EnergyParts::new(self.parts(), values))
    }

    /// Which points are neighbours, as blocks.
    fn bonds(&self) -> &Arc<BlockPattern> {
        self.bond_pattern().unwrap_or_else(|| self.pattern())
    }
}

/// Refuses sizes that do not fit: mistakes of a caller, not of a user.
pub(crate) fn check_sizes(energy: &dyn Energy, u: &[f64], wanted: &Wanted<'_>, parts: &[f64]) {
    let (n, d) = (energy.positions().len(), energy.dimension());
    assert_eq!(u.len(), n, "displacements are n x d");
    let has_parts = !matches!(wanted, Wanted::Forces(_)) || !parts.is_empty();
    assert!(!has_parts || parts.len() == energy.parts().len(), "one number for each part");
    match wanted {
        Wanted::Energy => {}
        Wanted::Forces(forces) => assert_eq!(forces.len(), n, "forces are n x d"),
        Wanted::Tangent(forces, tangent) => {
            assert_eq!(forces.len(), n, "forces are n x d");
            let size = energy.pattern().n_blocks() * d * d;
            assert_eq!(tangent.values.len(), size, "the energy's pattern");
        }
        Wanted::Diagonal(forces, diagonal) => {
            assert_eq!(forces.len(), n, "forces are n x d");
            assert_eq!(diagonal.len(), n * d, "the diagonal is n x d x d");
        }
    }
}
