//! Strain from positions, as in programs that store where points are and not how far they moved.
//!
//! A position `x = X + u` holds only the digits of `u` above `2^-53 |x|`; lengths, areas and volumes
//! worked out from positions know no others. So the energy is evaluated at `fl(X + u) - X`. What the
//! subtraction `l/L - 1` itself would lose besides is of the size of `2^-53`, no more than the
//! positions have lost already wherever `|x|` is not small against the bond.

use std::sync::Arc;

use super::{EnergyParts, Hessian, Inversion, NonFinite, Products, TotalEnergy};
use crate::matrix::{BlockMatrix, BlockPattern};

/// An energy that sees of the displacements what positions in double precision hold of them.
pub struct FromPositions<'a> {
    energy: &'a dyn TotalEnergy,
    /// Reference positions, `n x d`, in m.
    positions: &'a [f64],
}

impl<'a> FromPositions<'a> {
    /// `positions` are the reference positions in the body's order, `n x d`, in m.
    pub fn new(energy: &'a dyn TotalEnergy, positions: &'a [f64]) -> FromPositions<'a> {
        FromPositions { energy, positions }
    }

    fn held(&self, u: &[f64]) -> Vec<f64> {
        u.iter().zip(self.positions).map(|(u, x)| (x + u) - x).collect()
    }
}

impl TotalEnergy for FromPositions<'_> {
    fn dimension(&self) -> usize {
        self.energy.dimension()
    }

    fn positions(&self) -> &[f64] {
        self.positions
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        self.energy.pattern()
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        self.energy.bond_pattern()
    }

    fn bond_tangent(&self, u: &[f64], tangent: &mut BlockMatrix) {
        self.energy.bond_tangent(&self.held(u), tangent);
    }

    fn products(&self) -> Products {
        self.energy.products()
    }

    fn energy(&self, u: &[f64]) -> Result<EnergyParts, NonFinite> {
        self.energy.energy(&self.held(u))
    }

    fn gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<EnergyParts, NonFinite> {
        self.energy.gradient(&self.held(u), gradient)
    }

    fn tangent(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        tangent: &mut BlockMatrix,
    ) -> Result<EnergyParts, NonFinite> {
        self.energy.tangent(&self.held(u), gradient, tangent)
    }

    fn tangent_diagonal(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        diagonal: &mut [f64],
    ) -> Result<EnergyParts, NonFinite> {
        self.energy.tangent_diagonal(&self.held(u), gradient, diagonal)
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        self.energy.hessian(&self.held(u))
    }

    fn first_inversion(&self, u: &[f64], step: &[f64]) -> Option<Inversion> {
        self.energy.first_inversion(&self.held(u), step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::testing::{SpringNetwork, linear};

    #[test]
    fn only_what_a_position_holds_is_seen() {
        let springs = SpringNetwork::lattice(&[3, 1], 1.5, linear);
        let far = [1e6, 0.0, 1e6 + 1.0, 0.0, 1e6 + 2.0, 0.0];
        let energy = FromPositions::new(&springs, &far);
        // Half a unit of the last place of 1e6 is 5.8e-11: less is lost, more is rounded.
        assert_eq!(
            energy.held(&[1e-12, 1e-12, 2.5 * 1.1641532182693481e-10, 0.0, 1.0, 0.0]),
            [0.0, 1e-12, 2.0 * 1.1641532182693481e-10, 0.0, 1.0, 0.0]
        );
        let lost = energy.energy(&[0.0, 0.0, 1e-12, 0.0, 0.0, 0.0]).unwrap();
        assert_eq!(lost.total(), springs.energy(&[0.0; 6]).unwrap().total());
    }
}
