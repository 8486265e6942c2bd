//! Families that lose bonds.
//!
//! A family without a bond is a smaller family: its shape tensor and all weights are those of what is left. A
//! point whose neighbours no longer determine a deformation gradient is released: its gradient is that of
//! rest from then on, and with it its energy; what stabilises it goes, too.

use std::sync::{Arc, OnceLock};

use super::operator::GradientOperator;
use super::quadrature::BondQuadrature;
use super::stabilisation::Deviations;
use super::{DeformationEnergy, Discretisation, Families, OperatorOrder, Places};
use crate::materials::LawOfPoints;
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;

/// The families before any bond was lost.
pub(super) struct Whole {
    pub(super) neighborhood: Arc<Neighborhood>,
    /// Over its largest value, for each directed bond.
    influence: Vec<f64>,
    is_lost: Vec<bool>,
}

impl Whole {
    /// The influence of the directed bonds that are left.
    fn influence_of(&self, left: &Neighborhood) -> Vec<f64> {
        let mut influence = Vec::with_capacity(2 * left.n_bonds());
        for point in 0..left.n_points() {
            let own = self.neighborhood.row(point).iter();
            let mut known = own.zip(&self.influence[self.neighborhood.places(point)]);
            // Both rows are ascending.
            let of = |other: &u32| known.by_ref().find(|(j, _)| *j == other).map(|(_, w)| *w);
            influence.extend(left.row(point).iter().filter_map(of));
        }
        influence
    }
}

impl Places {
    /// The discretisation of some families with its weights.
    pub(super) fn new(
        operator: &GradientOperator,
        influence: &[f64],
        law: LawOfPoints<'_>,
        discretisation: Discretisation,
        families: Families,
    ) -> Result<Places, super::DeformationError> {
        Ok(match discretisation {
            Discretisation::Nodal => Places::Points,
            Discretisation::Stabilised(kind) => {
                let is_stationary = operator.order() == OperatorOrder::First;
                let how = (kind, is_stationary, families);
                Places::Stabilised(Deviations::new(operator, influence, law, how)?)
            }
            Discretisation::BondQuadrature => {
                let (body, neighborhood) = (operator.body(), operator.neighborhood());
                Places::Bonds(BondQuadrature::new(body, neighborhood, influence, families)?)
            }
        })
    }
}

impl DeformationEnergy {
    /// See [`crate::energy::Energy::lose`]; or puts bonds back.
    pub(super) fn lose_bonds(&mut self, bonds: &[usize], is_lost: bool) {
        let mut whole = self.whole.take().unwrap_or_else(|| {
            let neighborhood = Arc::clone(self.operator.shared_neighborhood());
            let is_lost = vec![false; neighborhood.n_bonds()];
            let influence = self.operator.influence().to_vec();
            Box::new(Whole { neighborhood, influence, is_lost })
        });
        bonds.iter().for_each(|bond| whole.is_lost[*bond] = is_lost);
        let left = Arc::new(whole.neighborhood.without(&whole.is_lost));
        let influence = whole.influence_of(&left);
        let (order, families) = (self.operator.order(), Families::Left);
        let operator = GradientOperator::new(&self.body, left, order, &influence, families);
        let made = operator.and_then(|operator| {
            let law = self.law();
            let places = Places::new(&operator, &influence, law, self.discretisation, families)?;
            Ok((operator, places))
        });
        // Families that are left are not refused.
        if let Ok((operator, places)) = made {
            (self.operator, self.places) = (operator, places);
        }
        (self.bond_pattern, self.room) = (OnceLock::new(), Pool::new());
        self.whole = Some(whole);
    }
}
