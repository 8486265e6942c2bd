//! Weights of the interactions: the volumes that turn energy densities into energy.
//!
//! The papers sum over ordered neighbours of every point; each unordered interaction here carries
//! what its visits there add up to (the energy is the same, and only the energy defines forces):
//!
//! ```text
//! bond {a,i}:             W = 1/2 * 1 * (V_a V1_a + V_i V1_i)
//! triangle {a,i,j}:       W = 1/3 * 2 * (V_a V2_a + V_i V2_i + V_j V2_j)
//! tetrahedron {a,i,j,k}:  W = 1/4 * 6 * (V_a V3_a + V_i V3_i + V_j V3_j + V_k V3_k)
//! ```
//!
//! with effective neighbour volumes `Vk_a = VH_a^k/#Nk_a` (javili2020, section 3.1; `#Nk` counts
//! ordered contributing neighbours, pairs, triples).
//!
//! On a lattice whose points have unequal parts `p` of a cell `V`, uniform weights are
//! `1, 2, 6 * V Vk * p_a p_i ..`: with `p = 1` the sums above, with halves on faces the trapezoidal
//! rule for the papers' integrals. Sums would give half points whole neighbours.

use std::f64::consts::PI;

use crate::body::Body;
use crate::geometry::Scalar;
use crate::interaction::{Census, n_neighbors};
use crate::kernel::Measure;
use crate::lattice;
use crate::words::Words;

/// How interactions are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// `V1`, `V2`, `V3` of a point inside an endless lattice, with the volume of the full ball, at
    /// every point that has a whole cell. Lattices only.
    Uniform,
    /// `VH_a = ball*N1_a/max N1` with each point's own counts.
    Truncated,
    /// The product of the point volumes, times 1, 2, 6.
    Volumes,
    /// 1: spring networks, tests.
    Unit,
}

impl Words for Weights {
    const WORDS: &'static [(&'static str, Weights)] = &[
        ("uniform", Weights::Uniform),
        ("truncated", Weights::Truncated),
        ("volumes", Weights::Volumes),
        ("unit", Weights::Unit),
    ];
}

/// Why interactions cannot be weighted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WeightsError {
    /// Uniform weights of a cloud.
    #[error(
        "weights \"uniform\" need a lattice, but the points are a cloud: use \"truncated\" or \"volumes\""
    )]
    UniformCloud,
    /// A point without volume.
    #[error(
        "the volume of point {point} (counted from 0 in the order of the input) at {position:?} m is \
         {volume} m^{dimension}: volumes must be positive and finite"
    )]
    Volume {
        /// In the user's order.
        point: usize,
        /// In m.
        position: Vec<f64>,
        /// As given.
        volume: f64,
        /// 2 or 3.
        dimension: usize,
    },
    /// A product of volumes that is no number with all its digits.
    #[error(
        "the weight of a {} is a product of {} volumes and comes out as {weight:e}: volumes that small \
         or large vanish or overflow together; take another unit of length, in the parameters too",
        measure.interaction(),
        measure.points()
    )]
    Range {
        /// Of the interactions.
        measure: Measure,
        /// As it comes out.
        weight: f64,
    },
}

/// The weights of all interactions of one measure.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CliqueWeights {
    /// `factor*(s_a + s_i + ..)`.
    Sum { factor: f64, shares: Vec<f64> },
    /// `factor*s_a*s_i*..`.
    Product { factor: f64, shares: Vec<f64> },
    /// 1.
    Unit,
}

impl CliqueWeights {
    /// The share of each point in the weights of its interactions.
    #[inline(always)]
    pub(crate) fn share(&self, point: usize) -> f64 {
        match self {
            CliqueWeights::Sum { shares, .. } => shares[point],
            CliqueWeights::Product { shares, .. } => shares[point],
            CliqueWeights::Unit => 1.0,
        }
    }

    /// The part of a weight that the owner and all other corners but the last have.
    #[inline(always)]
    pub(crate) fn begin(&self, owner: f64, others: &[f64]) -> f64 {
        match self {
            CliqueWeights::Sum { .. } => others.iter().fold(owner, |sum, share| sum + share),
            CliqueWeights::Product { factor, .. } => {
                others.iter().fold(factor * owner, |product, share| product * share)
            }
            CliqueWeights::Unit => 1.0,
        }
    }

    /// The weight, from what [`CliqueWeights::begin`] gave and the shares of last corners.
    #[inline(always)]
    pub(crate) fn join_last<T: Scalar>(&self, begun: f64, last: T) -> T {
        match self {
            CliqueWeights::Sum { factor, .. } => last.alike(*factor) * (last.alike(begun) + last),
            CliqueWeights::Product { .. } => last.alike(begun) * last,
            CliqueWeights::Unit => last.alike(1.0),
        }
    }
}

impl Weights {
    /// The weight of every interaction of a measure inside an endless lattice, over the volume of a
    /// cell; `count` is how many ordered neighbours, pairs or triples a point has. All points have all
    /// neighbours there, so that truncated weights are the uniform ones.
    pub fn inside(
        self,
        measure: Measure,
        dimension: usize,
        horizon: f64,
        spacing: f64,
        count: u64,
    ) -> Result<f64, WeightsError> {
        let cell = (1..dimension).fold(spacing, |volume, _| volume * spacing);
        let (order, permutations) = orders(measure);
        match self {
            Weights::Unit => Ok(1.0 / cell),
            Weights::Volumes => {
                in_range(measure, (0..order).fold(permutations, |weight, _| weight * cell))
            }
            Weights::Uniform | Weights::Truncated => {
                let effective = effective(measure, ball(dimension, horizon), 1.0, count)?;
                Ok(permutations * effective)
            }
        }
    }

    /// The weights of the interactions of a measure; `census` has counted them.
    pub(crate) fn of_measure(
        self,
        measure: Measure,
        body: &Body,
        horizon: f64,
        census: &Census,
    ) -> Result<CliqueWeights, WeightsError> {
        check_volumes(body)?;
        let (order, permutations) = orders(measure);
        let factor = permutations / (order + 1) as f64;
        match self {
            Weights::Unit => Ok(CliqueWeights::Unit),
            Weights::Volumes => {
                check_products(measure, body)?;
                Ok(CliqueWeights::Product { factor: permutations, shares: body.volumes().to_vec() })
            }
            Weights::Uniform => {
                let spacing = body.spacing().ok_or(WeightsError::UniformCloud)?;
                let count = lattice::bulk_count(body.dimension(), horizon / spacing, measure);
                let cell = (1..body.dimension()).fold(spacing, |product, _| product * spacing);
                let whole = effective(measure, ball(body.dimension(), horizon), cell, count)?;
                let shares = body.volumes().iter().map(|volume| volume / cell).collect();
                Ok(CliqueWeights::Product { factor: permutations * whole, shares })
            }
            Weights::Truncated => {
                let most = || census.neighbors.iter().copied().max().unwrap_or(1);
                let most =
                    body.most_neighbors().map_or_else(most, |most| most as u64).max(1) as f64;
                let counts = counts(measure, census);
                let share = |point: usize| {
                    let part = census.neighbors[point] as f64 / most;
                    let family = ball(body.dimension(), horizon) * part;
                    effective(measure, family, body.volumes()[point], counts[point])
                };
                let shares: Result<_, _> = (0..body.n_points()).map(share).collect();
                Ok(CliqueWeights::Sum { factor, shares: shares? })
            }
        }
    }
}

/// How many neighbours an interaction has, and how many orders they have.
fn orders(measure: Measure) -> (usize, f64) {
    let order = n_neighbors(measure);
    (order, [1.0, 2.0, 6.0][order - 1])
}

/// `V VH^k/#Nk`; a point that no interaction of this kind contains has none to weight.
fn effective(measure: Measure, family: f64, volume: f64, count: u64) -> Result<f64, WeightsError> {
    if count == 0 {
        return Ok(0.0);
    }
    let (order, _) = orders(measure);
    in_range(measure, volume * ((1..order).fold(family, |power, _| power * family) / count as f64))
}

/// A product of volumes, unless it has vanished, lost digits or become infinite.
fn in_range(measure: Measure, weight: f64) -> Result<f64, WeightsError> {
    if weight.is_normal() { Ok(weight) } else { Err(WeightsError::Range { measure, weight }) }
}

/// Refuses volumes of which as many as an interaction has points multiply to nothing.
fn check_products(measure: Measure, body: &Body) -> Result<(), WeightsError> {
    let volumes = body.volumes().iter().copied();
    let extremes = [volumes.clone().reduce(f64::min), volumes.reduce(f64::max)];
    for volume in extremes.into_iter().flatten() {
        in_range(measure, (1..measure.points()).fold(volume, |product, _| product * volume))?;
    }
    Ok(())
}

/// Refuses volumes that energies of families cannot weight their bonds with.
pub(crate) fn check_families(body: &Body) -> Result<(), WeightsError> {
    check_volumes(body)?;
    check_products(Measure::Length, body)
}

/// Volume of the full neighbourhood in m^d.
fn ball(dimension: usize, horizon: f64) -> f64 {
    if dimension == 2 {
        PI * horizon * horizon
    } else {
        4.0 / 3.0 * PI * horizon * horizon * horizon
    }
}

fn counts(measure: Measure, census: &Census) -> &[u64] {
    match measure {
        Measure::Length => &census.neighbors,
        Measure::Area => &census.pairs,
        Measure::Volume => &census.triples,
    }
}

fn check_volumes(body: &Body) -> Result<(), WeightsError> {
    let is_bad = |volume: &f64| !(*volume > 0.0 && volume.is_finite());
    match body.volumes().iter().position(is_bad) {
        None => Ok(()),
        Some(point) => Err(WeightsError::Volume {
            point: body.user_index()[point] as usize,
            position: body.position(point).to_vec(),
            volume: body.volumes()[point],
            dimension: body.dimension(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(volumes: [f64; 2], spacing: Option<f64>) -> Body {
        Body::new(2, &[0.0, 0.0, 1.0, 0.0], &volumes, spacing)
    }

    fn census() -> Census {
        let counts = vec![1, 2];
        Census {
            neighbors: counts.clone(),
            pairs: vec![0, 4],
            triples: counts,
            ..Census::default()
        }
    }

    fn weight(weights: Weights, measure: Measure, body: &Body) -> f64 {
        let weights = weights.of_measure(measure, body, 2.0, &census()).unwrap();
        weights.join_last(weights.begin(weights.share(0), &[]), weights.share(1))
    }

    #[test]
    fn weights_follow_the_formulas() {
        let body = pair([3.0, 5.0], Some(1.0));
        assert_eq!(weight(Weights::Unit, Measure::Volume, &body), 1.0);
        assert_eq!(weight(Weights::Volumes, Measure::Length, &body), 15.0);
        assert_eq!(weight(Weights::Volumes, Measure::Area, &body), 30.0);
        assert_eq!(weight(Weights::Volumes, Measure::Volume, &body), 90.0);
        let ball = PI * 4.0;
        // 12 neighbours and 48 ordered pairs at ratio 2.
        for [p, q] in [[1.0, 1.0], [0.5, 0.25]] {
            // Cells of 16 m^2.
            let body = pair([16.0 * p, 16.0 * q], Some(4.0));
            let uniform = |measure| {
                let weights = Weights::Uniform.of_measure(measure, &body, 8.0, &census()).unwrap();
                weights.join_last(weights.begin(weights.share(0), &[]), weights.share(1))
            };
            let (ball, bond) = (PI * 64.0, uniform(Measure::Length));
            assert!((bond - 16.0 * p * q * ball / 12.0).abs() < 1e-14 * bond);
            // The third point is the second once more.
            let weights =
                Weights::Uniform.of_measure(Measure::Area, &body, 8.0, &census()).unwrap();
            let area = weights.join_last(weights.begin(p, &[q]), q);
            assert!((area - 2.0 * 16.0 * p * q * q * ball * ball / 48.0).abs() < 1e-14 * area);
        }
        // Half a ball at the first point, and no pair.
        let truncated = weight(Weights::Truncated, Measure::Length, &body);
        assert!((truncated - 0.5 * ball * (3.0 * 0.5 + 5.0 / 2.0)).abs() < 1e-13 * truncated);
        let truncated = weight(Weights::Truncated, Measure::Area, &body);
        assert!((truncated - 2.0 / 3.0 * 5.0 * ball * ball / 4.0).abs() < 1e-13 * truncated);
    }

    /// Products of volumes that lose digits are refused with what they are of; one that just holds is
    /// not.
    #[test]
    fn products_that_vanish_or_overflow_are_refused() {
        let of = |weights: Weights, measure: Measure, volume: f64, horizon: f64| {
            let body = Body::new(3, &[0.0; 6], &[1.0, volume], Some(0.5 * horizon));
            weights.of_measure(measure, &body, horizon, &census()).map(|_| ())
        };
        for (volume, measure, weight) in [
            (1e-160, Measure::Length, 1e-320),
            (1e160, Measure::Length, f64::INFINITY),
            (1e-104, Measure::Area, 1e-312),
            (1e-78, Measure::Volume, 1e-312),
        ] {
            let error = of(Weights::Volumes, measure, volume, 1.0).unwrap_err();
            let WeightsError::Range { measure: named, weight: found } = error else {
                panic!("{error}")
            };
            assert_eq!(named, measure);
            assert!((found - weight).abs() <= 1e-3 * weight || found == weight, "{found:e}");
        }
        assert_eq!(of(Weights::Volumes, Measure::Volume, 1e-76, 1.0), Ok(()));
        // A ball of 1e-28 m cubed three times has vanished.
        for weights in [Weights::Uniform, Weights::Truncated] {
            assert_eq!(of(weights, Measure::Volume, 1e-60, 1e-24), Ok(()));
            let error = of(weights, Measure::Volume, 1e-84, 1e-28).unwrap_err();
            assert!(error.to_string().contains("weight of a tetrahedron"), "{error}");
        }
        let inside = Weights::Volumes.inside(Measure::Volume, 3, 3e-40, 1e-40, 24);
        assert!(matches!(inside, Err(WeightsError::Range { .. })), "{inside:?}");
    }

    #[test]
    fn what_cannot_be_weighted_is_named() {
        let of = |body: &Body| Weights::Uniform.of_measure(Measure::Length, body, 2.0, &census());
        assert_eq!(of(&pair([1.0, 1.0], None)), Err(WeightsError::UniformCloud));
        for volume in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = of(&pair([1.0, volume], Some(1.0))).unwrap_err();
            assert!(matches!(error, WeightsError::Volume { point: 1, .. }), "{error}");
        }
    }
}
