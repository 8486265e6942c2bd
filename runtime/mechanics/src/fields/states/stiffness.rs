//! What the stored Hessian and springs like it take from the second derivatives of all bonds and states.

use super::StateEnergy;
use super::linear::Linear;
use crate::energy::NonFinite;
use crate::fields::springs;
use crate::fields::stored::{Linearised, Seen, Tensor};
use crate::matrix::BlockMatrix;
use crate::neighborhood::Neighborhood;

/// The least part of the stiffest spring that a bond has.
const SOFTEST: f64 = 1e-2;

/// The same numbers as [`Linear`], of families.
pub(super) struct StateStiffness<'a, const D: usize> {
    energy: &'a StateEnergy,
    linear: Linear,
    /// `G_ij = V_j g' n` of all directed bonds, for each active integral.
    weights: Vec<[f64; D]>,
    /// `V_i d2w_i/dI2`, `m x m` for each point.
    points: Vec<f64>,
}

impl<'a, const D: usize> StateStiffness<'a, D> {
    pub(super) fn new(energy: &'a StateEnergy, u: &[f64]) -> Result<Self, NonFinite> {
        let linear = energy.finite::<D>(u)?;
        let m = linear.n_active();
        let (neighborhood, volumes) = (&energy.neighborhood, energy.body.volumes());
        let mut weights = vec![[0.0; D]; 2 * neighborhood.n_bonds() * m];
        let mirrored = neighborhood.mirrored();
        for i in 0..neighborhood.n_points() {
            let bonds = neighborhood.bonds(i);
            let later = neighborhood.places(i).end - bonds.len();
            for (k, (bond, j)) in bonds.zip(neighborhood.upper(i)).enumerate() {
                let of = linear.bond::<D>(bond);
                let place = later + k;
                for (a, slope) in of.slopes.iter().enumerate() {
                    let (here, there) = (volumes[j as usize] * slope, -volumes[i] * slope);
                    weights[place * m + a] = of.normal.map(|n| here * n);
                    weights[mirrored[place] as usize * m + a] = of.normal.map(|n| there * n);
                }
            }
        }
        let squares = (m * m).max(1);
        let rows = linear.by_states().chunks_exact(squares).zip(volumes);
        let points = rows.flat_map(|(row, volume)| row.iter().map(move |s| volume * s)).collect();
        Ok(StateStiffness { energy, linear, weights, points })
    }
}

impl<const D: usize> Linearised<D> for StateStiffness<'_, D> {
    #[inline(always)]
    fn neighborhood(&self) -> &Neighborhood {
        &self.energy.neighborhood
    }

    #[inline(always)]
    fn n_fields(&self) -> usize {
        self.linear.n_active()
    }

    #[inline(always)]
    fn weights(&self) -> &[[f64; D]] {
        &self.weights
    }

    #[inline(always)]
    fn at_point(&self, point: usize) -> &[f64] {
        let size = self.linear.n_active() * self.linear.n_active();
        &self.points[point * size..(point + 1) * size]
    }

    #[inline(always)]
    fn is_direct(&self) -> bool {
        true
    }

    #[inline(always)]
    fn is_mixed(&self) -> bool {
        self.linear.is_mixed()
    }

    #[inline(always)]
    fn mixed(&self, end: usize, seen: Seen, out: &mut [f64]) {
        let of = self.linear.bond::<D>(seen.bond);
        let [i, j] = seen.ends;
        let weight = seen.sign * self.energy.body.volumes()[i] * self.energy.body.volumes()[j];
        // The owner of a bond is its lower end.
        let mixed = of.mixed[usize::from(end != i.min(j))];
        for (out, c) in out.as_chunks_mut::<D>().0.iter_mut().zip(mixed) {
            *out = of.normal.map(|n| weight * c * n);
        }
    }

    #[inline(always)]
    fn direct(&self, seen: Seen) -> Tensor<D> {
        let of = self.linear.bond::<D>(seen.bond);
        std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                let across = if r == c { of.across } else { 0.0 };
                of.along_less_across * of.normal[r] * of.normal[c] + across
            })
        })
    }
}

impl StateEnergy {
    /// Fills a matrix with springs like the bonds.
    pub(super) fn like_bonds<const D: usize>(&self, u: &[f64], matrix: &mut BlockMatrix) {
        let springs = self.springs.get_or_init(|| self.at_rest::<D>());
        let stiffness = |bond: usize, _: [usize; 2], _: &[f64; D]| springs[bond];
        springs::fill(&self.body, (&self.neighborhood, &self.slabs), u, stiffness, matrix);
    }

    /// Stiffnesses of springs like the bonds at rest; where the energy has none there, of all the same.
    fn at_rest<const D: usize>(&self) -> Vec<f64> {
        let u = vec![0.0; self.body.positions().len()];
        let springs = self.finite::<D>(&u).map(|linear| self.like_uniform_expansion::<D>(&linear));
        let springs = springs.unwrap_or_default();
        let stiffest = springs.iter().fold(0.0, |most: f64, k| most.max(*k));
        if stiffest > 0.0 && springs.iter().all(|k| k.is_finite()) {
            springs.iter().map(|k| k.max(SOFTEST * stiffest)).collect()
        } else {
            vec![1.0; self.rest.len()]
        }
    }

    /// Stiffnesses that keep the energy of families under uniform expansion `dl = e L`.
    fn like_uniform_expansion<const D: usize>(&self, linear: &Linear) -> Vec<f64> {
        let (m, volumes) = (linear.n_active(), self.body.volumes());
        let bonds = || {
            (0..self.body.n_points()).flat_map(|i| {
                let later = self.neighborhood.upper(i).iter().map(|j| j as usize);
                self.neighborhood.bonds(i).zip(later).map(move |(bond, j)| (bond, [i, j]))
            })
        };
        // What integrals change by.
        let mut expansion = vec![0.0; self.body.n_points() * m];
        for (bond, [i, j]) in bonds() {
            for (a, slope) in linear.bond::<D>(bond).slopes.iter().enumerate() {
                expansion[i * m + a] += volumes[j] * slope * self.rest[bond];
                expansion[j * m + a] += volumes[i] * slope * self.rest[bond];
            }
        }
        let spring = |(bond, ends): (usize, [usize; 2])| {
            let of = linear.bond::<D>(bond);
            let mut shared = 0.0;
            for (end, mixed) in ends.into_iter().zip(of.mixed) {
                let expansion = &expansion[end * m..(end + 1) * m];
                let rows = linear.by_states()[end * m * m..].chunks_exact(m.max(1));
                for (row, slope) in rows.zip(of.slopes) {
                    let coupled = row.iter().zip(expansion).fold(0.0, |sum, (s, x)| sum + s * x);
                    shared += slope * coupled;
                }
                shared += mixed.iter().zip(expansion).fold(0.0, |sum, (c, x)| sum + 2.0 * c * x);
            }
            let along = of.along_less_across + of.across;
            let shared = volumes[ends[0]] * volumes[ends[1]] * shared / self.rest[bond];
            // Less than nothing is no spring: what a bond has by itself sets the least.
            (along + shared).max(0.1 * along)
        };
        bonds().map(spring).collect()
    }
}
