//! Energies of what the neighbours' displacements deviate from a point's deformation gradient.
//!
//! `1/2 sum_i V_i sum_j V_j w_ij z_ij . A_i z_ij` with `z_ij = (u_j - u_i) - H_i (X_j - X_i)`, the
//! deviation `x_j - x_i - F_i (X_j - X_i)` from displacements. With the operator of first order and
//! the same influence function `sum_j V_j w_ij z_ij x dX_ij = 0`, so that the force is
//! `w_ij A_i z_ij`, as printed (partmann2026 4.11, 4.13); with others it is the gradient all the
//! same, by the chain rule.

use nalgebra::DMatrix;
use pulp::Arch;

use super::Families;
use super::elastic::elasticity;
use super::error::DeformationError;
use super::operator::GradientOperator;
use super::sweep::{Fields, Pass, TouchedDuals};
use crate::assembly::sum::Sum;
use crate::body::Body;
use crate::element::WIDEST;
use crate::fields::stored::Tensor;
use crate::interaction::Slabs;
use crate::materials::LawOfPoints;
use crate::neighborhood::Neighborhood;

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
    stiffness: Vec<f64>,
    /// Whether the deviations of a family are orthogonal to its offsets, so that the energy is
    /// stationary with respect to `H`.
    is_stationary: bool,
}

/// `sum_j V_j w_ij` around every point.
pub(super) fn sums(body: &Body, neighborhood: &Neighborhood, influence: &[f64]) -> Vec<f64> {
    let sum = |point: usize| {
        let influence = &influence[neighborhood.places(point)];
        let row = neighborhood.row(point).iter().zip(influence);
        row.fold(0.0, |sum, (&j, w)| sum + body.volumes()[j as usize] * w)
    };
    (0..neighborhood.n_points()).map(sum).collect()
}

/// Refuses sums that are not positive.
pub(super) fn check_sums(
    body: &Body,
    sums: &[f64],
    what: &'static str,
) -> Result<(), DeformationError> {
    match sums.iter().position(|sum| !(*sum > 0.0 && sum.is_finite())) {
        None => Ok(()),
        Some(point) => Err(DeformationError::NoInfluence {
            point: body.user_index()[point] as usize,
            sum: sums[point],
            what,
        }),
    }
}

impl Deviations {
    /// `influence` has a value for each directed bond.
    pub(super) fn new(
        operator: &GradientOperator,
        influence: &[f64],
        law: LawOfPoints<'_>,
        (kind, is_stationary, families): (Stabilisation, bool, Families),
    ) -> Result<Deviations, DeformationError> {
        let (body, neighborhood) = (operator.body(), operator.neighborhood());
        let (d, volumes) = (body.dimension(), body.volumes());
        let mut strength = Vec::with_capacity(neighborhood.n_bonds());
        for i in 0..neighborhood.n_points() {
            let skipped = neighborhood.row(i).len() - neighborhood.upper(i).len();
            let influence = &influence[neighborhood.places(i)][skipped..];
            for (&j, w) in neighborhood.upper(i).iter().zip(influence) {
                strength.push(volumes[i] * volumes[j as usize] * w);
            }
        }
        let mut stiffness: Vec<f64> = match kind {
            Stabilisation::Silling { stiffness } => {
                let sums = sums(body, neighborhood, influence);
                if families == Families::Whole {
                    check_sums(body, &sums, "the stabilisation")?;
                }
                sums.iter().flat_map(|sum| isotropic(d, stiffness / sum)).collect()
            }
            Stabilisation::Wan | Stabilisation::Isotropic => {
                let wan = wan(body, neighborhood, influence, law, families)?;
                if kind == Stabilisation::Wan {
                    wan
                } else {
                    let trace = |a: &[f64]| a.iter().step_by(d + 1).fold(0.0, |sum, x| sum + x);
                    let mean = |a: &[f64]| isotropic(d, trace(a) / d as f64);
                    wan.chunks_exact(d * d).flat_map(mean).collect()
                }
            }
        };
        for (point, own) in stiffness.chunks_exact_mut(d * d).enumerate() {
            if operator.is_released(point) {
                own.fill(0.0);
            }
        }
        Ok(Deviations { strength, stiffness, is_stationary })
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
            for (&j, strength) in neighborhood.upper(i).iter().zip(strengths) {
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

/// `C : K_i^-1` of all points, `C` being the second derivative of their law at `F = I`.
fn wan(
    body: &Body,
    neighborhood: &Neighborhood,
    influence: &[f64],
    law: LawOfPoints<'_>,
    families: Families,
) -> Result<Vec<f64>, DeformationError> {
    let d = body.dimension();
    let n_laws = law.materials.map_or(1, |materials| materials.n_laws());
    let elasticities: Vec<_> = (0..n_laws).map(|k| elasticity(law, (k as u8, None), d)).collect();
    let has_fields = law.materials.is_some_and(|materials| materials.fields().is_some());
    let n = neighborhood.n_points();
    let mut all = Vec::with_capacity(n * d * d);
    for point in 0..n {
        let influence = &influence[neighborhood.places(point)];
        let mut shape = DMatrix::<f64>::zeros(d, d);
        for (&j, w) in neighborhood.row(point).iter().zip(influence) {
            let strength = body.volumes()[j as usize] * w;
            let (here, there) = (body.position(point), body.position(j as usize));
            for r in 0..d {
                for c in 0..d {
                    shape[(r, c)] += strength * (there[r] - here[r]) * (there[c] - here[c]);
                }
            }
        }
        let size = shape.amax();
        let inverse = (shape / size).try_inverse().filter(|k| k.iter().all(|x| x.is_finite()));
        let Some(inverse) = inverse else {
            if families == Families::Left {
                all.extend(std::iter::repeat_n(0.0, d * d));
                continue;
            }
            return Err(DeformationError::ShapeTensor {
                point: body.user_index()[point] as usize,
                position: body.position(point).to_vec(),
                neighbors: neighborhood.row(point).len(),
                functions: d,
                condition: f64::INFINITY,
                count: 1,
            });
        };
        let number = law.number(point);
        let own = has_fields.then(|| elasticity(law, (number, Some(point)), d));
        let elasticity = own.as_ref().unwrap_or(&elasticities[usize::from(number)]);
        for rc in 0..d * d {
            let row = &elasticity[rc * d * d..(rc + 1) * d * d];
            let entry = |(k, c): (usize, &f64)| c * inverse[(k / d, k % d)] / size;
            all.push(row.iter().enumerate().map(entry).fold(0.0, |sum, x| sum + x));
        }
    }
    Ok(all)
}
