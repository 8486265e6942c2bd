//! Energies and derivatives that are not finite numbers.

use super::Argument;

/// An interaction or a deformation gradient whose energy or derivatives are not finite numbers, or
/// that is turned inside out where its energy forbids that.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", self.message())]
pub struct NonFinite {
    /// What the energy depends on.
    pub argument: Argument,
    /// Its points in the body's order: 2, 3 or 4 of an interaction, the point or the two ends of the
    /// bond of a deformation gradient, the point that gathers.
    pub points: Vec<usize>,
    /// Their displacements in m, one after the other.
    pub displacements: Vec<f64>,
    /// Current value of the measure; the determinant of a deformation gradient; the first
    /// integral of a point; the rate of a bond in m/s.
    pub value: f64,
    /// Reference value of the measure, also beside its rate; 1 otherwise.
    pub reference: f64,
    /// Whether it is turned inside out where its energy forbids that.
    pub inverted: bool,
}

impl NonFinite {
    /// Of a point that gathers, whose first number this is, in `d` dimensions at displacements `u` (`n x d`, m).
    pub(crate) fn of_gathered(d: usize, point: usize, first: Option<f64>, u: &[f64]) -> NonFinite {
        NonFinite {
            argument: Argument::Gathered,
            points: vec![point],
            displacements: u[point * d..(point + 1) * d].to_vec(),
            value: first.unwrap_or(f64::NAN),
            reference: 1.0,
            inverted: false,
        }
    }

    fn message(&self) -> String {
        let what = if self.inverted { "turned inside out" } else { "not finite" };
        let (points, value) = (&self.points, self.value);
        match (self.argument, &points[..]) {
            (Argument::Measure(measure), _) => format!(
                "the energy of the {} of points {points:?} is {what}: measure {value:e}, reference {:e}",
                measure.interaction(),
                self.reference
            ),
            (Argument::Rate, _) => format!(
                "what the bond of points {points:?} dissipates is {what}: its length of {:e} m at rest changes by \
                 {value:e} m/s",
                self.reference
            ),
            (Argument::Gathered, _) => {
                format!("the energy of what is gathered around point {points:?} is {what}")
            }
            (Argument::DeformationGradient, [point]) => format!(
                "the energy of the deformation gradient at point {point} is {what}: determinant {value:e}"
            ),
            (Argument::DeformationGradient, _) => format!(
                "the energy of the deformation gradient at the bond of points {points:?} is {what}: \
                 determinant {value:e}"
            ),
        }
    }
}
