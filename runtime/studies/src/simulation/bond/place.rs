//! Which point is meant.

use std::str::FromStr;

use crate::case::{Case, CaseError};
use crate::scene::selection::{coordinates, nearest, typical_spacing};

/// Of how many spacings a point may be from where it is looked for.
const NEAR: f64 = 0.5;

/// A point as a user names it.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// By its number in the user's order, from 0.
    Number(usize),
    /// By where it is at rest, in m.
    At(Vec<f64>),
}

impl FromStr for Place {
    type Err = String;

    /// `17`, or `0.1,0.25`.
    fn from_str(text: &str) -> Result<Place, String> {
        let wrong = || "a point is its number, 17, or its coordinates in m, 0.1,0.25".to_owned();
        if let Ok(number) = text.trim().parse() {
            return Ok(Place::Number(number));
        }
        let number = |part: &str| part.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        let numbers: Option<Vec<f64>> = text.split(',').map(number).collect();
        match numbers {
            Some(numbers) if numbers.len() == 2 || numbers.len() == 3 => Ok(Place::At(numbers)),
            _ => Err(wrong()),
        }
    }
}

impl Place {
    /// The point in the body's order.
    ///
    /// # Errors
    /// Numbers and places of no point.
    pub fn point(&self, case: &Case) -> Result<usize, CaseError> {
        let (body, d) = (&case.body, case.body.dimension());
        let refused = |message| Err(CaseError::Body { message });
        match self {
            Place::Number(number) => {
                let found = body.user_index().iter().position(|own| *own as usize == *number);
                found.map_or_else(
                    || {
                        refused(format!(
                            "there is no point {number}: the {} points are counted from 0",
                            body.n_points()
                        ))
                    },
                    Ok,
                )
            }
            Place::At(place) if place.len() != d => refused(format!(
                "{} has {} coordinates, and the body has {d} dimensions",
                coordinates(place),
                place.len()
            )),
            Place::At(place) => {
                let (point, distance) = nearest(body, place);
                let spacing = typical_spacing(d, body.volumes(), body.spacing());
                if distance <= NEAR * spacing {
                    return Ok(point);
                }
                refused(format!(
                    "there is no point at {}: the nearest is point {} at {}, {distance:e} m away",
                    coordinates(place),
                    body.user_index()[point],
                    coordinates(body.position(point))
                ))
            }
        }
    }
}

/// Two points as a user names them, in the body's order.
///
/// # Errors
/// Those of [`Place::point`], and twice the same point.
pub fn points_of(case: &Case, places: &[Place; 2]) -> Result<[usize; 2], CaseError> {
    let ends = [places[0].point(case)?, places[1].point(case)?];
    if ends[0] == ends[1] {
        let (number, place) = (case.body.user_index()[ends[0]], case.body.position(ends[0]));
        let message = format!(
            "both ends are point {number} at {}: a bond is between two points",
            coordinates(place)
        );
        return Err(CaseError::Body { message });
    }
    Ok(ends)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_numbers_or_coordinates() {
        assert_eq!("17".parse(), Ok(Place::Number(17)));
        assert_eq!("-0.5, 1e-3".parse(), Ok(Place::At(vec![-0.5, 1e-3])));
        assert_eq!("1,2,3".parse(), Ok(Place::At(vec![1.0, 2.0, 3.0])));
        for wrong in ["", "x", "1.5", "1,2,3,4", "1,nan", "-1"] {
            assert!(wrong.parse::<Place>().is_err(), "{wrong}");
        }
    }
}
