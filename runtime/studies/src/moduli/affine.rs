//! Energy per volume of homogeneous displacement gradients, to second order at rest.

use nalgebra::{DMatrix, DVector};
use piola_compiler::GatheredKernels;
use piola_mechanics::energy::{Energy, NonFinite};
use piola_mechanics::interaction::never_fails;
use piola_mechanics::kernel::{Variables, VariablesLaw};

use super::inside::Inside;
use crate::case::{Case, CaseError, Compiled, state_laws};

/// Derivatives at rest of the energy density W by the displacement gradient G in `u = G X`.
///
/// Components of `G` are numbered row by row: `G[a][i] = du_a/dX_i` has the number `d*a + i`. Second
/// derivatives are `volumetric` between any two of `G[0][0]`, `G[1][1]`, .., plus `rest`: where a body
/// hardly changes its volume, what its shape costs would drown in their sum.
#[derive(Clone, Debug, PartialEq)]
pub struct Affine {
    /// `dW/dG` in Pa: the stress at rest.
    pub stress: Vec<f64>,
    /// The part of `d2W/dG2` that is a square of the change of volume, in Pa.
    pub volumetric: f64,
    /// The rest of `d2W/dG2`, in Pa.
    pub rest: DMatrix<f64>,
}

impl Affine {
    /// For the material of a case: of a point inside an endless lattice, or of a whole cloud.
    ///
    /// # Errors
    /// As [`Case::compile`] and [`Case::energy`]; energies that are not finite at rest.
    pub fn new(case: &Case) -> Result<Affine, CaseError> {
        Affine::with(case, &Inside::new(case))
    }

    /// With the cliques of the lattice, which are the same for all parameters.
    pub(super) fn with(case: &Case, inside: &Inside) -> Result<Affine, CaseError> {
        let compiled = Inside::compile(case)?;
        if case.scene.body.points.spacing().is_none() {
            return Affine::of_cloud(case, compiled);
        }
        let mut affine = Affine::zero(case.scene.body.dimension);
        for (potential, mut compiled) in case.potentials.iter().zip(compiled) {
            if compiled.gathered.as_ref().is_some_and(sees_directions) {
                compiled.gathered = None;
                compiled.vectors = potential.compile_as_vectors(&case.scene)?;
            }
            affine = affine.of_potential(case, inside, compiled)?;
        }
        if affine.is_finite() {
            return Ok(affine);
        }
        let message = "at rest, inside the body: the energy or a derivative is not finite";
        Err(CaseError::Body { message: message.to_string() })
    }

    /// With the energies of a potential.
    fn of_potential(
        mut self,
        case: &Case,
        inside: &Inside,
        potential: Compiled,
    ) -> Result<Affine, CaseError> {
        let (weighting, thickness) = (case.scene.horizon.weighting(), case.thickness());
        let Compiled { elements, measures, gradient, gathered, vectors, arguments, .. } = potential;
        let d = self.dimension();
        if let Some(law) = &gradient {
            // Linear fields are differentiated exactly, so that every point has this energy.
            self = self.plus(&Affine::of_gradients(d, &**law));
        }
        let has_families = gradient.is_some() || gathered.is_some() || vectors.is_some();
        if let Some(kernels) = vectors {
            // Per volume of the solid, in the plane too.
            self = self.plus(&inside.of_vectors(&kernels)?);
        }
        if let Some(kernels) = gathered {
            let laws = state_laws(kernels, arguments, thickness);
            self = self.plus(&inside.of_states(&laws)?.over(thickness));
        }
        if !measures.is_empty() || !has_families {
            self = self.plus(&inside.of_interactions(elements, weighting)?.over(thickness));
        }
        Ok(self)
    }

    pub(super) fn zero(d: usize) -> Affine {
        Affine { stress: vec![0.0; d * d], volumetric: 0.0, rest: DMatrix::zeros(d * d, d * d) }
    }

    pub(super) fn plus(self, other: &Affine) -> Affine {
        Affine {
            stress: self.stress.iter().zip(&other.stress).map(|(x, y)| x + y).collect(),
            volumetric: self.volumetric + other.volumetric,
            rest: self.rest + &other.rest,
        }
    }

    /// The entry of `d2W/dG2` for two components of `G`, in Pa.
    pub fn tangent(&self, row: usize, column: usize) -> f64 {
        let d = self.dimension();
        // Diagonal components have the numbers 0, d + 1, 2 (d + 1).
        let is_diagonal = row.is_multiple_of(d + 1) && column.is_multiple_of(d + 1);
        self.rest[(row, column)] + if is_diagonal { self.volumetric } else { 0.0 }
    }

    fn is_finite(&self) -> bool {
        let mut numbers = self.stress.iter().chain(&self.rest).chain([&self.volumetric]);
        numbers.all(|x| x.is_finite())
    }

    /// Per volume, from numbers per area of a body of this thickness.
    pub(super) fn over(self, thickness: f64) -> Affine {
        Affine {
            stress: self.stress.iter().map(|x| x / thickness).collect(),
            volumetric: self.volumetric / thickness,
            rest: self.rest / thickness,
        }
    }

    pub(super) fn dimension(&self) -> usize {
        if self.stress.len() == 4 { 2 } else { 3 }
    }

    fn of_gradients(d: usize, law: &dyn VariablesLaw) -> Affine {
        let identity = identity(d);
        let (current, change) = (identity.as_slice(), &vec![0.0; d * d]);
        let at = Variables { n: 1, current, change, given: &[], laws: &[] };
        let mut stress = vec![0.0; d * d];
        law.evaluate(at, &mut [0.0], &mut stress);
        let product = |direction: &DVector<f64>| {
            let mut product = DVector::zeros(d * d);
            law.product(at, direction.as_slice(), product.as_mut_slice());
            Ok(product)
        };
        never_fails(Affine::of_products(d, stress, product))
    }

    /// Of the whole body with its surface.
    fn of_cloud(case: &Case, compiled: Vec<Compiled>) -> Result<Affine, CaseError> {
        let energy = case.energy(compiled)?;
        let volume = case.thickness() * case.body.volumes().iter().sum::<f64>();
        Affine::of_body(&energy, volume).map_err(|found| CaseError::Body {
            message: format!("at rest, inside the body: {found}"),
        })
    }

    fn of_body(energy: &dyn Energy, volume: f64) -> Result<Affine, NonFinite> {
        let d = energy.dimension();
        let positions = energy.positions();
        let n = positions.len() / d;
        let centre: Vec<f64> = (0..d)
            .map(|axis| positions.iter().skip(axis).step_by(d).sum::<f64>() / n.max(1) as f64)
            .collect();
        let rest = vec![0.0; n * d];
        let mut force = vec![0.0; n * d];
        // The derivative by each component of G, from forces.
        let moments = |force: &[f64]| {
            let mut sums = DVector::zeros(d * d);
            for (force, place) in force.chunks_exact(d).zip(positions.chunks_exact(d)) {
                for number in 0..d * d {
                    let (component, axis) = (number / d, number % d);
                    sums[number] += force[component] * (place[axis] - centre[axis]);
                }
            }
            sums / volume
        };
        energy.forces(&rest, &mut force)?;
        let stress = moments(&force).as_slice().to_vec();
        let hessian = energy.hessian(&rest)?;
        Affine::of_products(d, stress, |direction| {
            let row = |place: &[f64], c: usize| -> f64 {
                (0..d).map(|i| direction[d * c + i] * (place[i] - centre[i])).sum()
            };
            let places = positions.chunks_exact(d);
            let field: Vec<f64> =
                places.flat_map(|place| (0..d).map(move |c| row(place, c))).collect();
            hessian.multiply(&field, &mut force);
            Ok(moments(&force))
        })
    }

    /// From products of the second derivatives with tensors: stiffnesses against changes of shape come
    /// from products with such changes alone.
    pub(super) fn of_products<E>(
        d: usize,
        stress: Vec<f64>,
        mut product: impl FnMut(&DVector<f64>) -> Result<DVector<f64>, E>,
    ) -> Result<Affine, E> {
        let (extent, volume) = (d as f64, identity(d));
        let pressure = product(&volume)?.dot(&volume) / extent;
        let mut rest = DMatrix::zeros(d * d, d * d);
        let mut stiffness = 0.0;
        for (number, shape) in changes_of_shape(d).into_iter().enumerate() {
            let dual = &shape / shape.norm_squared();
            let product = product(&shape)?;
            // Second derivatives commute: what a shape does to the pressure, volume does to the shape.
            rest += &product * dual.transpose();
            rest += &dual * volume.transpose() * (product.dot(&volume) / extent);
            if number < d - 1 {
                stiffness += product.dot(&dual) / (extent - 1.0);
            }
        }
        rest += &volume * volume.transpose() * (stiffness / extent);
        Ok(Affine { stress, volumetric: (pressure - stiffness) / extent, rest })
    }
}

/// The components of the unit tensor.
fn identity(d: usize) -> DVector<f64> {
    DVector::from_fn(d * d, |k, _| f64::from(u8::from(k.is_multiple_of(d + 1))))
}

/// Orthogonal tensors without a trace, those of stretches first: with the unit tensor, all there are.
fn changes_of_shape(d: usize) -> Vec<DVector<f64>> {
    let of = |components: &[(usize, usize, f64)]| {
        let mut tensor = DVector::zeros(d * d);
        components.iter().for_each(|(a, i, x)| tensor[d * a + i] = *x);
        tensor
    };
    let mut shapes = vec![of(&[(0, 0, 1.0), (1, 1, -1.0)])];
    if d == 3 {
        shapes.push(of(&[(0, 0, 1.0), (1, 1, 1.0), (2, 2, -2.0)]));
    }
    for a in 0..d {
        shapes.extend((0..d).filter(|i| *i != a).map(|i| of(&[(a, i, 1.0)])));
    }
    shapes
}

/// Whether something that is gathered, or an energy of it, varies with the direction of bonds: of all that varies from
/// bond to bond inside a lattice, directions alone are left.
fn sees_directions(kernels: &GatheredKernels) -> bool {
    let of_bonds = kernels.bonds.iter().map(|kernel| kernel.fields().len());
    let fields = kernels.integrals.iter().map(|kernel| kernel.fields().len());
    fields.chain(of_bonds).any(|n| n > 0)
}
