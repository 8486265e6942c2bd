//! Families that lose bonds.
//!
//! A family without a bond is a smaller family: its shape tensor and all weights are those of what is left. A
//! point whose neighbours no longer determine a deformation gradient is released: its gradient is that of
//! rest from then on, and with it its energy; what stabilises it goes, too. Only what belongs to the ends of
//! bonds that go is worked out again, so that the result does not depend on the order in which they go.

use std::sync::{Arc, OnceLock};

use super::operator::GradientOperator;
use super::quadrature::BondQuadrature;
use super::stabilisation::{Deviations, Stabilisation, check_sums};
use super::{DeformationEnergy, Discretisation, Places};
use crate::fields::lost::{LostBonds, points_of};
use crate::materials::LawOfPoints;
use crate::neighborhood::Gaps;

/// The families before any bond was lost.
pub(super) struct Whole {
    pub(super) lost: LostBonds,
    /// Over its largest value, for each directed bond of the whole families.
    influence: Vec<f64>,
}

impl Places {
    /// The discretisation of whole families with its weights; `influence` has a value for each directed bond.
    pub(super) fn new(
        operator: &GradientOperator,
        influence: &[f64],
        law: LawOfPoints<'_>,
        discretisation: Discretisation,
    ) -> Result<Places, super::DeformationError> {
        let (body, neighborhood) = (operator.body(), operator.neighborhood());
        Ok(match discretisation {
            Discretisation::Nodal => Places::Points,
            Discretisation::Stabilised(kind) => {
                if matches!(kind, Stabilisation::Silling { .. }) {
                    check_sums(body, neighborhood, influence, "the stabilisation")?;
                }
                Places::Stabilised(Deviations::new(operator, law, kind)?)
            }
            Discretisation::BondQuadrature => {
                check_sums(body, neighborhood, influence, "bond quadrature")?;
                Places::Bonds(BondQuadrature::new(operator, law.has_states_of_bonds()))
            }
        })
    }

    /// Follows an operator that has lost bonds between these points.
    pub(super) fn lose(
        &mut self,
        left: (&GradientOperator, &Gaps),
        law: LawOfPoints<'_>,
        discretisation: Discretisation,
        points: &[usize],
    ) {
        match (self, discretisation) {
            (Places::Bonds(quadrature), _) => quadrature.lose(left, points),
            (Places::Stabilised(deviations), Discretisation::Stabilised(kind)) => {
                deviations.lose(left, law, kind, points);
            }
            _ => {}
        }
    }
}

impl DeformationEnergy {
    /// See [`crate::energy::Energy::lose`].
    pub(super) fn lose_bonds(&mut self, bonds: &[usize]) {
        let whole = self.whole.get_or_insert_with(|| {
            let lost = LostBonds::none_of(Arc::clone(self.operator.shared_neighborhood()));
            Box::new(Whole { lost, influence: self.operator.influence().to_vec() })
        });
        let ends = whole.lost.lose(bonds);
        self.take_out(&ends);
    }

    /// See [`crate::energy::Energy::regain`]: attempts that come to nothing are rare, so the whole families are
    /// made anew and lose what is still lost.
    pub(super) fn regain_bonds(&mut self, bonds: &[usize]) {
        let Some(mut whole) = self.whole.take() else { return };
        let still = whole.lost.regain(bonds);
        let (order, neighborhood) = (self.operator.order(), Arc::clone(&whole.lost.neighborhood));
        let operator = GradientOperator::new(&self.body, neighborhood, order, &whole.influence);
        let made = operator.and_then(|operator| {
            let (law, influence) = (self.law(), operator.influence());
            let places = Places::new(&operator, influence, law, self.discretisation)?;
            Ok((operator, places))
        });
        // They were made before.
        if let Ok((operator, places)) = made {
            (self.operator, self.places) = (operator, places);
        }
        self.take_out(&still);
        self.whole = Some(whole);
    }

    /// Takes out bonds that are there, by their ends.
    fn take_out(&mut self, bonds: &[[usize; 2]]) {
        let points = points_of(bonds);
        let gaps = self.operator.lose(bonds, &points);
        let law = LawOfPoints { law: &*self.law, materials: self.materials.as_deref() };
        self.places.lose((&self.operator, &gaps), law, self.discretisation, &points);
        self.bond_pattern = OnceLock::new();
    }
}
