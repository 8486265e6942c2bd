//! The bonds of one point, evaluated at once.

use crate::body::Body;
use crate::geometry::Geometry;
use crate::geometry::bond::Bond;
use crate::kernel::{Batch, Law, Order, Outputs, Variables, VariablesLaw};
use crate::neighborhood::Neighborhood;

/// Work arrays for the bonds of one point: one entry per neighbour, ascending.
#[derive(Default)]
pub(super) struct Family<const D: usize> {
    /// Volumes of the neighbours in m^d.
    pub(super) volumes: Vec<f64>,
    /// Unit vectors towards them, as they are now.
    pub(super) normals: Vec<[f64; D]>,
    /// Present lengths, lengths at rest in m, and relative changes.
    pub(super) length: Vec<f64>,
    pub(super) rest: Vec<f64>,
    pub(super) change: Vec<f64>,
    /// What laws gave last: value, derivatives.
    pub(super) psi: Vec<f64>,
    pub(super) first: Vec<f64>,
    pub(super) second: Vec<f64>,
    variables: Vec<f64>,
    directions: Vec<f64>,
    /// Derivatives by the variables of an energy of bonds, or products, variable by variable.
    pub(super) slopes: Vec<f64>,
}

impl<const D: usize> Family<D> {
    /// How many bonds there are.
    pub(super) fn len(&self) -> usize {
        self.length.len()
    }

    /// Takes the bonds of a point at displacements `u` in m.
    pub(super) fn take(&mut self, body: &Body, neighborhood: &Neighborhood, u: &[f64], i: usize) {
        let (positions, u) = (body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
        self.volumes.clear();
        self.normals.clear();
        self.length.clear();
        self.rest.clear();
        self.change.clear();
        for &j in neighborhood.row(i) {
            let j = j as usize;
            let reference: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
            let moved: [f64; D] = std::array::from_fn(|c| u[j][c] - u[i][c]);
            let bond = <Bond as Geometry<D>>::change(&reference, &moved);
            self.volumes.push(body.volumes()[j]);
            self.normals.push(std::array::from_fn(|c| (reference[c] + moved[c]) / bond.measure));
            self.length.push(bond.measure);
            self.rest.push(bond.reference);
            self.change.push(bond.change);
        }
        for array in [&mut self.psi, &mut self.first, &mut self.second] {
            array.resize(self.length.len(), 0.0);
        }
    }

    /// A law of the length at all bonds: `psi`, and as the order asks `first` and `second`.
    pub(super) fn law(&mut self, law: &dyn Law, order: Order) {
        let batch = Batch { measure: &self.length, reference: &self.rest, change: &self.change };
        let (psi, dpsi, d2psi) = (&mut self.psi[..], &mut self.first[..], &mut self.second[..]);
        law.evaluate(batch, order, Outputs { psi, dpsi, d2psi });
    }

    /// `slopes` become what the derivatives of an energy of bonds change by with all lengths by
    /// `length` and with the integrals by `changes`.
    pub(super) fn multiply(
        &mut self,
        law: &dyn VariablesLaw,
        integrals: &[f64],
        length: f64,
        changes: &[f64],
    ) {
        let n = self.set_variables(integrals);
        self.slopes.resize((1 + integrals.len()) * n, 0.0);
        self.directions.clear();
        self.directions.resize(n, length);
        for change in changes {
            self.directions.resize(self.directions.len() + n, *change);
        }
        let at = Variables { n, current: &self.variables, change: &self.change, given: &self.rest };
        law.product(at, &self.directions, &mut self.slopes);
    }

    fn set_variables(&mut self, integrals: &[f64]) -> usize {
        let n = self.length.len();
        self.variables.clear();
        self.variables.extend_from_slice(&self.length);
        for integral in integrals {
            self.variables.resize(self.variables.len() + n, *integral);
        }
        n
    }

    /// The derivatives by variable `k` of all bonds.
    pub(super) fn slope(&self, k: usize) -> &[f64] {
        &self.slopes[k * self.len()..(k + 1) * self.len()]
    }

    /// `sum_j V_j x_j`
    pub(super) fn integral(&self, values: &[f64]) -> f64 {
        self.volumes.iter().zip(values).fold(0.0, |sum, (volume, x)| sum + volume * x)
    }
}
