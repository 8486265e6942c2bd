//! Bodies of several materials: which laws an interaction takes whose points are not of one material.
//!
//! A point is of one material, by number. What belongs to a point alone, its `psi(F)` or what it gathers,
//! takes the law of its material. An interaction of points of one material takes that one's law, too; of
//! points of several it takes the mean of its corners: each corner has an equal part in it, with the law
//! of its material. That is what comes out where every point sums the energy of its own law over its
//! family. An [`Interface`] between two materials may say otherwise.
//!
//! Whatever an interaction takes, its energy is one function of positions: forces on its points balance.

mod field;
mod law;

use std::ops::Range;
use std::sync::Arc;

pub use field::{Fields, StateOf};
pub use law::{ByMaterial, MaterialLaw};

use crate::kernel::{Measure, VariablesLaw};

/// Most corners of an interaction.
const CORNERS: usize = 4;

/// What interactions of points of two materials take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interface {
    /// Corners of material `counts` are taken for corners of `as_material`.
    As {
        /// The material that gives way.
        counts: u8,
        /// The one whose law the interaction takes.
        as_material: u8,
    },
    /// Interactions of points of these two materials and no other take a law of its own.
    Law {
        /// The two materials.
        between: [u8; 2],
        /// The number of the law: those of materials come first.
        law: u8,
    },
}

/// The materials of the points of a body, and the rules between them.
#[derive(Clone, Debug, Default)]
pub struct Materials {
    /// In the body's order.
    of_point: Vec<u8>,
    interfaces: Vec<Interface>,
    n_laws: usize,
    fields: Option<Arc<Fields>>,
}

/// The laws that an interaction takes, by number, with the part that each has in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Parts {
    n: usize,
    parts: [(u8, f64); CORNERS],
}

impl Parts {
    /// All of one law.
    pub(crate) fn whole(law: u8) -> Parts {
        Parts { n: 1, parts: [(law, 1.0); CORNERS] }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.parts[..self.n].iter().map(|(law, part)| (usize::from(*law), *part))
    }
}

impl Materials {
    /// `of_point` has the material of each point in the body's order. Of several interfaces between the
    /// same materials the first counts.
    pub fn new(of_point: Vec<u8>, interfaces: Vec<Interface>) -> Materials {
        let named = interfaces.iter().map(|interface| match *interface {
            Interface::As { counts, as_material } => counts.max(as_material),
            Interface::Law { between, law } => between[0].max(between[1]).max(law),
        });
        let most = of_point.iter().copied().chain(named).max();
        let n_laws = most.map_or(0, |most| usize::from(most) + 1);
        Materials { of_point, interfaces, n_laws, fields: None }
    }

    /// The same with at least so many laws: some materials may have no point.
    pub fn with_laws(self, n_laws: usize) -> Materials {
        Materials { n_laws: n_laws.max(self.n_laws), ..self }
    }

    /// The same with parameters that vary.
    pub fn with_fields(self, fields: Arc<Fields>) -> Materials {
        Materials { fields: Some(fields).filter(|fields| !fields.is_empty()), ..self }
    }

    /// Parameters that vary; nothing where none does.
    pub fn fields(&self) -> Option<&Fields> {
        self.fields.as_deref()
    }

    /// The same, to be shared.
    pub(crate) fn shared_fields(&self) -> Option<&Arc<Fields>> {
        self.fields.as_ref()
    }

    /// The material of a point.
    #[inline(always)]
    pub fn of(&self, point: usize) -> u8 {
        self.of_point[point]
    }

    /// The materials of some points.
    pub(crate) fn of_points(&self, points: Range<usize>) -> &[u8] {
        &self.of_point[points]
    }

    /// How many points there are.
    pub fn n_points(&self) -> usize {
        self.of_point.len()
    }

    /// How many laws there must be: one of each material, then those of interfaces.
    pub fn n_laws(&self) -> usize {
        self.n_laws
    }

    /// The numbers of the laws that the interaction of some points takes, at most four.
    pub fn laws_of(&self, points: &[usize]) -> Vec<usize> {
        let corners: Vec<u8> = points.iter().take(CORNERS).map(|point| self.of(*point)).collect();
        if corners.is_empty() {
            return Vec::new();
        }
        self.parts(&corners).iter().map(|(law, _)| law).collect()
    }

    /// The laws that interactions of some points may take, ascending.
    pub(crate) fn laws_among(&self, points: Range<usize>) -> impl Iterator<Item = u8> + use<> {
        let mut has = [false; 1 + u8::MAX as usize];
        self.of_points(points).iter().for_each(|material| has[usize::from(*material)] = true);
        for interface in &self.interfaces {
            if let Interface::Law { between: [one, other], law } = *interface {
                has[usize::from(law)] |= has[usize::from(one)] && has[usize::from(other)];
            }
        }
        (0..=u8::MAX).filter(move |law| has[usize::from(*law)])
    }

    /// The laws of an interaction whose corners are of these materials, at most four.
    pub(crate) fn parts(&self, corners: &[u8]) -> Parts {
        let first = corners[0];
        if corners.iter().all(|corner| *corner == first) {
            return Parts::whole(first);
        }
        let mut taken = [0; CORNERS];
        let taken = &mut taken[..corners.len()];
        taken.copy_from_slice(corners);
        for interface in &self.interfaces {
            let has = |material: u8| corners.contains(&material);
            match *interface {
                Interface::Law { between: [p, q], law } => {
                    let alone = corners.iter().all(|corner| *corner == p || *corner == q);
                    if alone && has(p) && has(q) {
                        return Parts::whole(law);
                    }
                }
                Interface::As { counts, as_material } if has(as_material) => {
                    taken.iter_mut().filter(|corner| **corner == counts).for_each(|corner| {
                        *corner = as_material;
                    });
                }
                Interface::As { .. } => {}
            }
        }
        taken.sort_unstable();
        let (mut parts, share) = (Parts { n: 0, parts: [(0, 0.0); CORNERS] }, taken.len() as f64);
        for same in taken.chunk_by(|p, q| p == q) {
            parts.parts[parts.n] = (same[0], same.len() as f64 / share);
            parts.n += 1;
        }
        parts
    }
}

/// Where a law is evaluated: between two points or, twice the same, at one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) ends: [usize; 2],
    /// The number of the bond, where bonds remember something.
    pub(crate) bond: usize,
}

impl Place {
    /// At a point.
    #[inline(always)]
    pub(crate) fn at(point: usize) -> Place {
        Place { ends: [point; 2], bond: 0 }
    }
}

/// A law with the materials of the points at which it is evaluated.
#[derive(Clone, Copy)]
pub(crate) struct LawOfPoints<'a> {
    pub(crate) law: &'a dyn VariablesLaw,
    pub(crate) materials: Option<&'a Materials>,
}

impl<'a> LawOfPoints<'a> {
    /// `given` becomes what the law takes of fields at so many places.
    #[inline(always)]
    pub(crate) fn give(self, n: usize, places: impl Fn(usize) -> Place, given: &mut Vec<f64>) {
        given.clear();
        if let Some(fields) = self.fields() {
            let of = |place: usize| {
                let Place { ends, bond } = places(place);
                (ends.into_iter(), bond)
            };
            let places = (0..n).map(of);
            fields.add_of(Measure::Length, 0..fields.len(), n, places, given);
        }
    }

    /// Parameters that vary, and states; nothing where there are none.
    #[inline(always)]
    pub(crate) fn fields(self) -> Option<&'a Fields> {
        self.materials.and_then(Materials::fields)
    }

    /// Whether bonds remember something.
    pub(crate) fn has_states_of_bonds(self) -> bool {
        let kind = Some(StateOf::Interactions(Measure::Length));
        self.fields().is_some_and(|fields| fields.have_states(0..fields.len(), kind))
    }

    /// The numbers of the laws of some points, as [`crate::kernel::Variables`] takes them.
    #[inline(always)]
    pub(crate) fn numbers(self, points: Range<usize>) -> &'a [u8] {
        self.materials.map_or(&[], |materials| materials.of_points(points))
    }

    /// The number of the law of a point.
    #[inline(always)]
    pub(crate) fn number(self, point: usize) -> u8 {
        self.materials.map_or(0, |materials| materials.of(point))
    }

    /// The part of a law in an interaction; nothing where it has none.
    #[inline(always)]
    pub(crate) fn part(self, points: [usize; 2], law: u8) -> Option<f64> {
        let [one, other] = points.map(|point| self.number(point));
        if one == other {
            return (one == law).then_some(1.0);
        }
        let parts = self.parts(points);
        parts.iter().find(|(number, _)| *number == usize::from(law)).map(|(_, part)| part)
    }

    /// The laws of an interaction.
    #[inline(always)]
    pub(crate) fn parts(self, points: [usize; 2]) -> Parts {
        self.materials.map_or(Parts::whole(0), |all| all.parts(&points.map(|point| all.of(point))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(materials: &Materials, corners: &[u8]) -> Vec<(usize, f64)> {
        materials.parts(corners).iter().collect()
    }

    #[test]
    fn corners_have_equal_parts_unless_an_interface_says_otherwise() {
        let mean = Materials::new(vec![0, 1, 2], Vec::new());
        assert_eq!(parts(&mean, &[1, 1]), [(1, 1.0)]);
        assert_eq!(parts(&mean, &[1, 0]), [(0, 0.5), (1, 0.5)]);
        assert_eq!(parts(&mean, &[2, 0, 2]), [(0, 1.0 / 3.0), (2, 2.0 / 3.0)]);
        assert_eq!(parts(&mean, &[2, 0, 2, 1]), [(0, 0.25), (1, 0.25), (2, 0.5)]);
        assert_eq!(mean.n_laws(), 3);
        let rules = vec![
            Interface::As { counts: 0, as_material: 1 },
            Interface::Law { between: [2, 1], law: 3 },
        ];
        let ruled = Materials::new(vec![0, 1, 2], rules);
        assert_eq!(ruled.n_laws(), 4);
        assert_eq!(parts(&ruled, &[0, 0]), [(0, 1.0)]);
        assert_eq!(parts(&ruled, &[1, 0]), [(1, 1.0)]);
        assert_eq!(parts(&ruled, &[1, 2]), [(3, 1.0)]);
        assert_eq!(parts(&ruled, &[0, 2]), [(0, 0.5), (2, 0.5)]);
        // Of three materials: what counts as another does so, and the law is between two.
        assert_eq!(parts(&ruled, &[0, 1, 2]), [(1, 2.0 / 3.0), (2, 1.0 / 3.0)]);
    }
}
