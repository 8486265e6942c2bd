//! Potentials that depend on the direction of bonds at rest: where that stands among their fields, and what
//! does not know it.

use std::ops::Range;

use piola_grammar::Diagnostic;
use piola_mechanics::surface::Surface;

use super::{Case, CaseError, Potential};
use crate::scene::Scene;

impl Potential {
    /// Whether all of its fields are components of the direction of bonds.
    pub(crate) fn varies_by_direction_alone(&self) -> bool {
        let directions = self.model.directions(self.values.dimension);
        self.values.fields.iter().all(|field| directions.contains(field))
    }

    /// Of each field its axis, where it is a component of the direction of bonds.
    pub(super) fn axes_of_directions(&self) -> Vec<Option<u8>> {
        let directions = self.model.directions(self.values.dimension);
        let axis =
            |field: &u16| directions.contains(field).then(|| (field - directions.start) as u8);
        self.values.fields.iter().map(axis).collect()
    }
}

impl Case {
    /// Of each potential where the direction of a bond stands among its fields.
    pub(crate) fn places_of_directions(&self) -> Vec<Range<usize>> {
        let of = |Potential { values, model, .. }: &Potential| {
            let directions = model.directions(values.dimension);
            let first = values.fields.partition_point(|field| *field < directions.start);
            first..first + directions.len()
        };
        self.potentials.iter().map(of).collect()
    }
}

/// Refuses surface corrections of bonds whose energy depends on their direction: what these lack at a face is
/// compared by their lengths.
///
/// # Errors
/// At the key.
pub(super) fn check_corrections(scene: &Scene, potentials: &[Potential]) -> Result<(), CaseError> {
    let Some(potential) = potentials.iter().find(|one| one.model.sees_directions()) else {
        return Ok(());
    };
    let Some(span) = scene.horizon.correction_span else { return Ok(()) };
    if scene.horizon.weighting().surface == Surface::None {
        return Ok(());
    }
    let message = format!(
        "surface corrections compare bonds by their lengths, and {} depends on `Xi`",
        potential.model.name()
    );
    let found = Diagnostic::error("conflicting-keys", span, message)
        .help("leave `surface` out, or take a potential without `Xi`");
    Err(CaseError::Scene(scene.report(vec![found])))
}

/// The unit vector from one place to another.
pub(super) fn direction(from: &[f64], to: &[f64]) -> Vec<f64> {
    let square = from.iter().zip(to).fold(0.0, |sum, (p, q)| sum + (q - p) * (q - p));
    from.iter().zip(to).map(|(p, q)| (q - p) / square.sqrt()).collect()
}
