//! Families that breaking leaves too small, and what becomes of a run then.
//!
//! A family that has lost bonds may determine no deformation gradient any more, or have nothing left to gather
//! from. Its point is released: it has no energy by its family from then on. A run may go on like that, or end.

use piola_mechanics::energy::Energy;
use piola_mechanics::words::Words;

/// How many points a message lists.
const LISTED: usize = 5;

/// What becomes of a run in which a family has become too small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Singular {
    /// It goes on, and the point of the family is released.
    #[default]
    Release,
    /// It ends there; families that cracks have left too small before it begins are released.
    Stop,
    /// It ends there, and does not begin where cracks have left such a family.
    Refuse,
}

impl Words for Singular {
    const WORDS: &'static [(&'static str, Singular)] =
        &[("release", Singular::Release), ("stop", Singular::Stop), ("refuse", Singular::Refuse)];
}

/// Points whose families are too small.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", self.message())]
pub struct SmallFamilies {
    /// Ascending, in the body's order unless they are renumbered.
    pub points: Vec<usize>,
    /// Where they are at rest, in m.
    pub positions: Vec<Vec<f64>>,
}

impl SmallFamilies {
    /// Those of an energy but for known ones, both ascending; nothing where there are no others.
    pub fn of(energy: &dyn Energy, known: &[usize]) -> Option<SmallFamilies> {
        let is_new = |point: &usize| known.binary_search(point).is_err();
        let counted = energy.counted();
        let found = energy.singular().into_iter().filter(|point| counted.contains(point));
        let points: Vec<usize> = found.filter(is_new).collect();
        let (d, rest) = (energy.dimension(), energy.positions());
        let positions = points.iter().map(|point| rest[point * d..(point + 1) * d].to_vec());
        let positions = positions.collect();
        (!points.is_empty()).then_some(SmallFamilies { points, positions })
    }

    /// The same with other numbers of the points.
    pub fn numbered(self, number: impl Fn(usize) -> usize) -> SmallFamilies {
        let points = self.points.into_iter().map(number).collect();
        SmallFamilies { points, ..self }
    }

    fn message(&self) -> String {
        let place = |x: &[f64]| x.iter().map(f64::to_string).collect::<Vec<String>>().join(", ");
        let one = |(point, x): (&usize, &Vec<f64>)| format!("point {point} at ({})", place(x));
        let all = self.points.iter().zip(&self.positions);
        let mut message = all.take(LISTED).map(one).collect::<Vec<String>>().join(", ");
        if self.points.len() > LISTED {
            message += &format!(" and {} more", self.points.len() - LISTED);
        }
        let of = if self.points.len() == 1 { "family of" } else { "families of" };
        format!("too few bonds are left of the {of} {message}")
    }
}

/// Families that are looked at whenever something breaks.
pub(crate) struct Watched {
    choice: Singular,
    /// Those that were too small at the start.
    known: Vec<usize>,
}

impl Watched {
    /// Those of an energy at the start of a run.
    pub(crate) fn new(energy: &dyn Energy, choice: Singular) -> Watched {
        let known = if choice == Singular::Release { Vec::new() } else { energy.singular() };
        Watched { choice, known }
    }

    /// Whether any end a motion.
    pub(crate) fn end_motions(&self) -> bool {
        self.choice != Singular::Release
    }

    /// Those that have become too small since, where that ends a run.
    pub(crate) fn failed(&self, energy: &dyn Energy) -> Option<SmallFamilies> {
        match self.choice {
            Singular::Release => None,
            Singular::Stop | Singular::Refuse => SmallFamilies::of(energy, &self.known),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_list_some_points() {
        let few = SmallFamilies { points: vec![3], positions: vec![vec![0.5, -1.0]] };
        assert_eq!(
            few.clone().numbered(|point| point + 4).to_string(),
            "too few bonds are left of the family of point 7 at (0.5, -1)"
        );
        let many = SmallFamilies { points: vec![1; 7], positions: vec![vec![0.0; 3]; 7] };
        let message = many.to_string();
        assert!(message.ends_with("point 1 at (0, 0, 0) and 2 more"), "{message}");
    }
}
