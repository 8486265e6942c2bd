//! Why a body cannot be assembled.

use super::Elements;
use crate::body::Body;
use crate::kernel::Measure;
use crate::neighborhood::{Neighborhood, NeighborhoodError};
use crate::surface::CorrectionError;
use crate::weights::WeightsError;

/// Why a body cannot be assembled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AssemblyError {
    /// The neighbours cannot be found.
    #[error(transparent)]
    Neighborhood(#[from] NeighborhoodError),
    /// The interactions cannot be weighted.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// Bonds cannot be corrected.
    #[error(transparent)]
    Correction(#[from] CorrectionError),
    /// The body has no points.
    #[error("the body has no points: its box is empty or every point was removed")]
    Empty,
    /// Points that nothing holds.
    #[error("{}", isolated_message(*count, first, *horizon))]
    Isolated {
        /// How many there are.
        count: usize,
        /// The first few: place in the user's order, position in m.
        first: Vec<(usize, Vec<f64>)>,
        /// In m.
        horizon: f64,
    },
    /// No kind of interaction has an energy.
    #[error(
        "no interaction has an energy: give at least one of psi(l), psi(a) and, in three dimensions, \
         psi(v) a coefficient other than 0"
    )]
    NoEnergy,
    /// Tetrahedra in the plane.
    #[error("psi(v) needs three dimensions, but the body has {dimension}: drop it")]
    VolumeInPlane {
        /// Of the body.
        dimension: usize,
    },
    /// An element in the place of another kind.
    #[error(
        "an element for {}({}) in {dimension} dimensions was given where psi({}) in \
         {body_dimension} dimensions belongs", "psi", found.symbol(), expected.symbol()
    )]
    WrongElement {
        /// The measure that belongs there.
        expected: Measure,
        /// The measure of the element.
        found: Measure,
        /// The dimension of the element.
        dimension: usize,
        /// The dimension of the body.
        body_dimension: usize,
    },
}

/// How many points an error lists.
const LISTED: usize = 5;

fn isolated_message(count: usize, first: &[(usize, Vec<f64>)], horizon: f64) -> String {
    let list: Vec<String> =
        first.iter().map(|(point, position)| format!("{point} at {position:?} m")).collect();
    let more = if count > first.len() { ", .." } else { "" };
    format!(
        "{count} points have no neighbour within the horizon {horizon} m: point {}{more} (counted \
         from 0 in the order of the input); enlarge the horizon or remove them",
        list.join(", point ")
    )
}

pub(super) fn check_elements(of_laws: &[Elements], dimension: usize) -> Result<(), AssemblyError> {
    let places = of_laws.iter().flat_map(|elements| {
        [
            (Measure::Length, &elements.bond),
            (Measure::Area, &elements.triangle),
            (Measure::Volume, &elements.tetrahedron),
        ]
    });
    if places.clone().all(|(_, element)| element.is_none()) {
        return Err(AssemblyError::NoEnergy);
    }
    if dimension == 2 && of_laws.iter().any(|elements| elements.tetrahedron.is_some()) {
        return Err(AssemblyError::VolumeInPlane { dimension });
    }
    for (expected, element) in places {
        let Some(element) = element else { continue };
        if element.measure() != expected || element.dimension() != dimension {
            return Err(AssemblyError::WrongElement {
                expected,
                found: element.measure(),
                dimension: element.dimension(),
                body_dimension: dimension,
            });
        }
    }
    Ok(())
}

pub(crate) fn check_neighbors(
    body: &Body,
    neighborhood: &Neighborhood,
) -> Result<(), AssemblyError> {
    assert_eq!(body.n_points(), neighborhood.n_points(), "neighbours of this body");
    if body.n_points() == 0 {
        return Err(AssemblyError::Empty);
    }
    let mut isolated = neighborhood.isolated();
    isolated.retain(|point| !body.is_cut(*point));
    if isolated.is_empty() {
        return Ok(());
    }
    let mut named: Vec<(usize, usize)> =
        isolated.iter().map(|&point| (body.user_index()[point] as usize, point)).collect();
    named.sort_unstable();
    let first = named.iter().take(LISTED).map(|&(user, p)| (user, body.position(p).to_vec()));
    Err(AssemblyError::Isolated {
        count: isolated.len(),
        first: first.collect(),
        horizon: neighborhood.horizon(),
    })
}
