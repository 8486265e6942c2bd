//! Energies of what the neighbours' displacements deviate from a point's deformation gradient.
//!
//! `1/2 sum_i V_i sum_j V_j w_ij z_ij . A_i z_ij` with `z_ij = (u_j - u_i) - H_i (X_j - X_i)`, the
//! deviation `x_j - x_i - F_i (X_j - X_i)` from displacements. With the operator of first order and
//! the same influence function `sum_j V_j w_ij z_ij x dX_ij = 0`, so that the force is
//! `w_ij A_i z_ij`, as printed (partmann2026 4.11, 4.13); with others it is the gradient all the
//! same, by the chain rule.

use nalgebra::DMatrix;
use pulp::Arch;

use super::elastic::elasticity;
use super::error::DeformationError;
use super::moments::OperatorOrder;
use super::operator::GradientOperator;
use super::sweep::{Fields, Pass, TouchedDuals};
use crate::assembly::sum::Sum;
use crate::body::Body;
use crate::element::WIDEST;
use crate::fields::stored::Tensor;
use crate::interaction::Slabs;
use crate::materials::LawOfPoints;
use crate::neighborhood::{Gaps, Neighborhood};

/// The stiffness `A_i` against deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stabilisation {
    /// `A_i = stiffness/(sum_j V_j w_ij) I` (partmann2026 4.11), objective. The stiffness is
    /// `C_s C_b`, the literal `C_s` having the unit m^2 and `C_b = 18K/(pi delta^4)`.
    Silling {
        /// In Pa/m^2.
        stiffness: f64,
    },
    /// `A_i = C : K_i^-1` with the elasticity tensor `C` of the law at rest (4.13, 4.14). It is
    /// not objective: `K_i^-1` does not rotate with the body.
    Wan,
    /// `A_i = tr(C : K_i^-1)/d I`, the isotropic part of the one before: objective.
    Isotropic,
}

/// The stiffness of all points.
pub(super) struct Deviations {
    /// `V_i V_j w_ij` of each bond once.
    pub(super) strength: Vec<f64>,
    /// `A_i`, `d x d` row by row.
    pub(super) stiffness: Vec<f64>,
    /// Whether the deviations of a family are orthogonal to its offsets, so that the energy is
    /// stationary with respect to `H`.
    is_stationary: bool,
}

/// `sum_j V_j w_ij` around every point, of an influence for each directed bond.
pub(super) fn sums(body: &Body, neighborhood: &Neighborhood, influence: &[f64]) -> Vec<f64> {
    let around = (body.volumes(), neighborhood, influence);
    (0..neighborhood.n_points()).map(|point| sum_around(around, point)).collect()
}

/// The same around a point, of the influences of an operator.
pub(super) fn sum_of(operator: &GradientOperator, point: usize) -> f64 {
    let volumes = operator.body().volumes();
    sum_around((volumes, operator.neighborhood(), operator.influence()), point)
}

fn sum_around(
    (volumes, neighborhood, influence): (&[f64], &Neighborhood, &[f64]),
    point: usize,
) -> f64 {
    let influence = &influence[neighborhood.places(point)];
    let row = neighborhood.row(point).iter().zip(influence);
    row.fold(0.0, |sum, (j, w)| sum + volumes[j as usize] * w)
}

/// Refuses influences whose sums are not positive.
pub(super) fn check_sums(
    body: &Body,
    neighborhood: &Neighborhood,
    influence: &[f64],
    what: &'static str,
) -> Result<(), DeformationError> {
    let sums = sums(body, neighborhood, influence);
    let is_bad = |point: &usize| !(sums[*point] > 0.0 && sums[*point].is_finite());
    match (0..sums.len()).filter(|point| !body.is_cut(*point)).find(is_bad) {
        None => Ok(()),
        Some(point) => Err(DeformationError::NoInfluence {
            point: body.user_index()[point] as usize,
            sum: sums[point],
            what,
        }),
    }
}

impl Deviations {
    /// Of the families of an operator.
    ///
    /// # Errors
    /// Shape tensors without an inverse, where the stiffness takes it.
    pub(super) fn new(
        operator: &GradientOperator,
        law: LawOfPoints<'_>,
        kind: Stabilisation,
    ) -> Result<Deviations, DeformationError> {
        let (body, neighborhood) = (operator.body(), operator.neighborhood());
        let volumes = body.volumes();
        let mut strength = Vec::with_capacity(neighborhood.n_bonds());
        for i in 0..neighborhood.n_points() {
            let later = neighborhood.upper(i).iter().zip(operator.later_influence(i));
            strength.extend(later.map(|(j, w)| volumes[i] * volumes[j as usize] * w));
        }
        let of_points = OfPoints::new(operator, law, kind);
        let mut stiffness = Vec::with_capacity(body.n_points() * body.dimension().pow(2));
        for point in 0..body.n_points() {
            let own = of_points.stiffness(point);
            match own.filter(|_| !operator.is_released(point)) {
                Some(own) => stiffness.extend(own),
                None if body.is_cut(point) => {
                    stiffness.extend(std::iter::repeat_n(0.0, body.dimension().pow(2)));
                }
                None => return Err(of_points.singular(point)),
            }
        }
        let is_stationary = operator.order() == OperatorOrder::First;
        Ok(Deviations { strength, stiffness, is_stationary })
    }

    /// Follows an operator that has lost bonds: their ends have other stiffnesses, those that are released
    /// none.
    pub(super) fn lose(
        &mut self,
        (operator, gaps): (&GradientOperator, &Gaps),
        law: LawOfPoints<'_>,
        kind: Stabilisation,
        points: &[usize],
    ) {
        gaps.close_bonds(&mut self.strength);
        let of_points = OfPoints::new(operator, law, kind);
        let size = operator.body().dimension().pow(2);
        for &point in points {
            let own = &mut self.stiffness[point * size..(point + 1) * size];
            own.fill(0.0);
            let left = Some(point).filter(|point| !operator.is_released(*point));
            if let Some(stiffness) = left.and_then(|point| of_points.stiffness(point)) {
                own.copy_from_slice(&stiffness);
            }
        }
    }

    /// `A_i`.
    #[inline(always)]
    pub(super) fn stiffness<const D: usize>(&self, point: usize) -> Tensor<D> {
        let entries = &self.stiffness[point * D * D..(point + 1) * D * D];
        std::array::from_fn(|r| std::array::from_fn(|c| entries[r * D + c]))
    }

    /// The bonds of one slab; the energy is quadratic, so that products are derivatives along the
    /// direction.
    pub(super) fn visit<const D: usize>(
        &self,
        whole: (&Body, &Neighborhood, &Slabs),
        slab: usize,
        (fields, pass): (Fields<'_, D>, Pass<'_, D>),
        duals: TouchedDuals<'_, D>,
    ) -> Sum {
        Arch::new().dispatch(
            #[inline(always)]
            || self.visit_bonds(whole, slab, (fields, pass), duals),
        )
    }

    #[inline(always)]
    fn visit_bonds<const D: usize>(
        &self,
        (body, neighborhood, slabs): (&Body, &Neighborhood, &Slabs),
        slab: usize,
        (fields, pass): (Fields<'_, D>, Pass<'_, D>),
        duals: TouchedDuals<'_, D>,
    ) -> Sum {
        let Fields { u, h } = if let Pass::Product(direction) = pass { direction } else { fields };
        let TouchedDuals { mut shares, mut stress, mut force } = duals;
        let positions = body.positions().as_chunks::<D>().0;
        let mut sum = Sum::default();
        let (mut terms, mut n_terms) = ([0.0; WIDEST], 0);
        for i in slabs.owners(slab) {
            let a_i = self.stiffness::<D>(i);
            let strengths = &self.strength[neighborhood.bonds(i)];
            for (j, strength) in neighborhood.upper(i).iter().zip(strengths) {
                let j = j as usize;
                let dx: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
                let du: [f64; D] = std::array::from_fn(|r| u[j][r] - u[i][r]);
                let deviation = |point: usize| -> [f64; D] {
                    let h = &h[point];
                    std::array::from_fn(|r| (0..D).fold(du[r], |z, c| z - h[r][c] * dx[c]))
                };
                // Seen from j both the offset and the difference of displacements change sign.
                let (z_i, z_j) = (deviation(i), deviation(j));
                let t_i = times(&a_i, &z_i).map(|x| strength * x);
                let t_j = times(&self.stiffness::<D>(j), &z_j).map(|x| strength * x);
                let dot = |z: &[f64; D], t: &[f64; D]| (0..D).fold(0.0, |s, r| s + z[r] * t[r]);
                let (of_i, of_j) = (0.5 * dot(&z_i, &t_i), 0.5 * dot(&z_j, &t_j));
                terms[n_terms] = of_i + of_j;
                n_terms += 1;
                if n_terms == WIDEST {
                    sum.add(&terms);
                    n_terms = 0;
                }
                if !shares.is_empty() {
                    shares[i] += of_i;
                    shares[j] += of_j;
                }
                if force.is_empty() {
                    continue;
                }
                let [force_i, force_j] = force.pair(i, j);
                for r in 0..D {
                    force_j[r] += t_i[r] + t_j[r];
                    force_i[r] -= t_i[r] + t_j[r];
                }
                if self.is_stationary {
                    continue;
                }
                for (stress, t) in stress.pair(i, j).into_iter().zip([t_i, t_j]) {
                    for r in 0..D {
                        for c in 0..D {
                            stress[r][c] -= t[r] * dx[c];
                        }
                    }
                }
            }
        }
        terms[n_terms..].fill(0.0);
        sum.add(&terms);
        sum
    }
}

fn isotropic(d: usize, value: f64) -> Vec<f64> {
    (0..d * d).map(|k| if k % (d + 1) == 0 { value } else { 0.0 }).collect()
}

#[inline(always)]
fn times<const D: usize>(a: &Tensor<D>, z: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|r| (0..D).fold(0.0, |sum, c| sum + a[r][c] * z[c]))
}

/// What the stiffness of points is made of.
struct OfPoints<'a> {
    operator: &'a GradientOperator,
    law: LawOfPoints<'a>,
    kind: Stabilisation,
    /// The second derivative at `F = I` of each law, where stiffnesses take it.
    elasticities: Vec<Vec<f64>>,
    has_fields: bool,
}

impl<'a> OfPoints<'a> {
    fn new(
        operator: &'a GradientOperator,
        law: LawOfPoints<'a>,
        kind: Stabilisation,
    ) -> OfPoints<'a> {
        let d = operator.body().dimension();
        let n_laws = match kind {
            Stabilisation::Silling { .. } => 0,
            Stabilisation::Wan | Stabilisation::Isotropic => {
                law.materials.map_or(1, |materials| materials.n_laws())
            }
        };
        let elasticities = (0..n_laws).map(|k| elasticity(law, (k as u8, None), d)).collect();
        let has_fields = law.materials.is_some_and(|materials| materials.fields().is_some());
        OfPoints { operator, law, kind, elasticities, has_fields }
    }

    /// `A_i`; nothing where it takes the inverse of a shape tensor that has none.
    fn stiffness(&self, point: usize) -> Option<Vec<f64>> {
        let d = self.operator.body().dimension();
        match self.kind {
            Stabilisation::Silling { stiffness } => {
                Some(isotropic(d, stiffness / sum_of(self.operator, point)))
            }
            Stabilisation::Wan => self.wan(point),
            Stabilisation::Isotropic => self.wan(point).map(|a| {
                let trace = a.iter().step_by(d + 1).fold(0.0, |sum, x| sum + x);
                isotropic(d, trace / d as f64)
            }),
        }
    }

    /// `C : K_i^-1`, `C` being the second derivative of the point's law at `F = I`.
    fn wan(&self, point: usize) -> Option<Vec<f64>> {
        let (body, neighborhood) = (self.operator.body(), self.operator.neighborhood());
        let d = body.dimension();
        let influence = &self.operator.influence()[neighborhood.places(point)];
        let mut shape = DMatrix::<f64>::zeros(d, d);
        for (j, w) in neighborhood.row(point).iter().zip(influence) {
            let strength = body.volumes()[j as usize] * w;
            let (here, there) = (body.position(point), body.position(j as usize));
            for r in 0..d {
                for c in 0..d {
                    shape[(r, c)] += strength * (there[r] - here[r]) * (there[c] - here[c]);
                }
            }
        }
        let size = shape.amax();
        let inverse = (shape / size).try_inverse().filter(|k| k.iter().all(|x| x.is_finite()))?;
        let number = self.law.number(point);
        let own = self.has_fields.then(|| elasticity(self.law, (number, Some(point)), d));
        let elasticity = own.as_ref().unwrap_or(&self.elasticities[usize::from(number)]);
        let entry = |rc: usize| {
            let row = &elasticity[rc * d * d..(rc + 1) * d * d];
            let term = |(k, c): (usize, &f64)| c * inverse[(k / d, k % d)] / size;
            row.iter().enumerate().map(term).fold(0.0, |sum, x| sum + x)
        };
        Some((0..d * d).map(entry).collect())
    }

    fn singular(&self, point: usize) -> DeformationError {
        let body = self.operator.body();
        DeformationError::ShapeTensor {
            point: body.user_index()[point] as usize,
            position: body.position(point).to_vec(),
            neighbors: self.operator.neighborhood().row(point).len(),
            functions: body.dimension(),
            condition: f64::INFINITY,
            count: 1,
        }
    }
}
