//! Bonds side by side, component by component: what is the same for all of them goes in vector registers, and only what
//! their ends have is taken one bond after the other.

use super::batch::{CAPACITY, Column, Columns};
use super::quadrature::Bond;
use super::sweep::{Fields, TouchedDuals};

/// The bonds of a batch at rest, and room.
pub(super) struct BondColumns<const D: usize> {
    dx: [Column; D],
    along: [Column; D],
    /// What the ends differ by in displacement, in m; how a bond pulls at its ends, in N.
    ends: [Column; D],
}

impl<const D: usize> BondColumns<D> {
    pub(super) fn new() -> BondColumns<D> {
        let zero = [[0.0; CAPACITY]; D];
        BondColumns { dx: zero, along: zero, ends: zero }
    }

    /// Takes the bonds of a batch.
    #[inline(always)]
    pub(super) fn set(&mut self, bonds: &[Bond<D>; CAPACITY]) {
        for (lane, bond) in bonds.iter().enumerate() {
            for c in 0..D {
                (self.dx[c][lane], self.along[c][lane]) = (bond.dx[c], bond.along[c]);
            }
        }
    }

    /// `F_ij - I` of every bond from the fields, as [`Bond::gradient`].
    #[inline(always)]
    pub(super) fn gradients(
        &mut self,
        bonds: &[Bond<D>; CAPACITY],
        fields: Fields<'_, D>,
        h: &mut Columns,
    ) {
        for (lane, bond) in bonds.iter().enumerate() {
            let [i, j] = bond.points;
            let ([h_i, h_j], [u_i, u_j]) =
                ([i, j].map(|point| &fields.h[point]), [i, j].map(|point| &fields.u[point]));
            for r in 0..D {
                for c in 0..D {
                    h[r * D + c][lane] = h_i[r][c] + h_j[r][c];
                }
                self.ends[r][lane] = u_j[r] - u_i[r];
            }
        }
        for r in 0..D {
            for lane in 0..CAPACITY {
                let mut missing = self.ends[r][lane];
                for c in 0..D {
                    h[r * D + c][lane] *= 0.5;
                    missing -= h[r * D + c][lane] * self.dx[c][lane];
                }
                for c in 0..D {
                    h[r * D + c][lane] += missing * self.along[c][lane];
                }
            }
        }
    }

    /// Makes of the stresses at bonds what either end gets, and how these pull at their ends.
    #[inline(always)]
    pub(super) fn pull(&mut self, weights: &Column, stress: &mut Columns) {
        for r in 0..D {
            for lane in 0..CAPACITY {
                let mut pull = 0.0;
                for c in 0..D {
                    stress[r * D + c][lane] *= weights[lane];
                    pull += stress[r * D + c][lane] * self.along[c][lane];
                }
                self.ends[r][lane] = pull;
                for c in 0..D {
                    let row = stress[r * D + c][lane];
                    stress[r * D + c][lane] = 0.5 * (row - pull * self.dx[c][lane]);
                }
            }
        }
    }

    /// Adds that to the ends of some bonds, the first ones of the batch.
    #[inline(always)]
    pub(super) fn scatter(
        &self,
        bonds: &[Bond<D>],
        stress: &Columns,
        duals: &mut TouchedDuals<'_, D>,
    ) {
        for (lane, bond) in bonds.iter().enumerate() {
            let [i, j] = bond.points;
            let ([stress_i, stress_j], [force_i, force_j]) =
                (duals.stress.pair(i, j), duals.force.pair(i, j));
            for r in 0..D {
                let pull = self.ends[r][lane];
                force_j[r] += pull;
                force_i[r] -= pull;
                for c in 0..D {
                    let half = stress[r * D + c][lane];
                    stress_i[r][c] += half;
                    stress_j[r][c] += half;
                }
            }
        }
    }
}
