//! One kind of interaction: what its members store, by the materials of their points, and how much each
//! counts.

use std::ops::Range;
use std::sync::Arc;

use super::Elements;
use super::quadratic::{AffineLaw, Quadratic, Shares};
use crate::body::Body;
use crate::element::Element;
use crate::interaction::OwnerCliques;
use crate::kernel::Measure;
use crate::materials::{Fields, Materials, Parts, StateOf};
use crate::neighborhood::Neighborhood;
use crate::surface::{CorrectionError, Weighting};
use crate::weights::CliqueWeights;

/// The interactions of one measure.
pub(super) struct Kind {
    measure: Measure,
    /// Of each law; one where the body is of one material.
    elements: Vec<Option<Box<dyn Element>>>,
    pub(super) weights: CliqueWeights,
    /// What multiplies the weights of bonds, by their numbers; nothing where these hold.
    pub(super) factors: Option<Vec<f64>>,
    pub(super) materials: Option<Arc<Materials>>,
}

impl Kind {
    pub(super) fn new(
        measure: Measure,
        elements: Vec<Option<Box<dyn Element>>>,
        weights: CliqueWeights,
        materials: Option<Arc<Materials>>,
    ) -> Kind {
        Kind { measure, elements, weights, factors: None, materials }
    }

    /// The same with corrected bonds, if these are its interactions.
    pub(super) fn corrected(
        mut self,
        weighting: Weighting,
        body: &Body,
        neighborhood: &Neighborhood,
    ) -> Result<Kind, CorrectionError> {
        if self.measure == Measure::Length {
            let (weights, materials) = (&self.weights, self.materials.as_deref());
            let factors = weighting.factors(body, neighborhood, weights, &self.elements, materials);
            self.factors = factors?;
        }
        Ok(self)
    }

    pub(super) fn measure(&self) -> Measure {
        self.measure
    }

    /// What its energies are functions of, as written in `psi(..)`; those of several laws side by side.
    pub(super) fn argument(&self) -> String {
        let mut all: Vec<&str> = self.elements().map(|element| element.argument()).collect();
        all.sort_unstable();
        all.dedup();
        all.join(") | psi(")
    }

    /// The element of a law, where interactions of this kind have an energy in it.
    #[inline(always)]
    pub(super) fn element(&self, law: usize) -> Option<&dyn Element> {
        self.elements[law].as_deref()
    }

    /// How many laws there are.
    pub(super) fn n_laws(&self) -> usize {
        self.elements.len()
    }

    /// The elements of all laws that have one.
    pub(super) fn elements(&self) -> impl Iterator<Item = &dyn Element> + Clone {
        self.elements.iter().flatten().map(|element| &**element)
    }

    /// The one law that all interactions of an owner take; nothing where its members are of several
    /// materials.
    #[inline(always)]
    pub(super) fn law_of<const D: usize>(&self, cliques: &OwnerCliques<'_, D>) -> Option<usize> {
        let Some(materials) = &self.materials else { return Some(0) };
        let own = materials.of(cliques.owner());
        let same = materials.n_laws() == 1
            || cliques.members().iter().all(|member| materials.of(*member as usize) == own);
        same.then_some(usize::from(own))
    }

    /// The laws of an interaction, from the materials of its points.
    pub(super) fn parts(&self, corners: &[u8]) -> Parts {
        self.materials.as_ref().map_or(Parts::whole(0), |materials| materials.parts(corners))
    }

    /// The same from its points.
    pub(super) fn parts_of(&self, points: &[usize]) -> Parts {
        let Some(materials) = &self.materials else { return Parts::whole(0) };
        let mut corners = [0; 4];
        let corners = &mut corners[..points.len()];
        corners.iter_mut().zip(points).for_each(|(corner, point)| *corner = materials.of(*point));
        materials.parts(corners)
    }

    /// The fields of a law, where its element takes some.
    #[inline(always)]
    pub(super) fn fields_of(&self, law: usize) -> Option<(&Fields, Range<usize>)> {
        if self.element(law)?.n_fields() == 0 {
            return None;
        }
        let fields = self.materials.as_deref()?.fields()?;
        Some((fields, fields.of_law(law)))
    }

    /// Whether these interactions remember something that a law takes.
    pub(super) fn has_states(&self) -> bool {
        self.takes_states(Some(StateOf::Interactions(self.measure)))
    }

    /// Whether a law takes states of a kind, or of any.
    fn takes_states(&self, kind: Option<StateOf>) -> bool {
        let has = |(fields, own): (&Fields, Range<usize>)| fields.have_states(own, kind);
        (0..self.elements.len()).any(|law| self.fields_of(law).is_some_and(has))
    }

    /// The values of the field that affine laws are a multiple of, in equal parts of so many corners.
    pub(super) fn parts_of_field(&self, corners: usize) -> Option<Shares> {
        let (fields, own) = self.fields_of(0).filter(|_| !self.is_by_direction(0))?;
        let n_points = self.materials.as_ref().map_or(0, |materials| materials.n_points());
        let part = |point: usize| fields.mean(own.start, std::iter::once(point)) / corners as f64;
        Some(Shares::added((0..n_points).map(part)))
    }

    /// Whether the fields of a law are the direction of bonds at rest and nothing else.
    fn is_by_direction(&self, law: usize) -> bool {
        self.fields_of(law).is_some_and(|(fields, own)| fields.are_direction(own))
    }

    /// Whether an element takes fields.
    pub(super) fn has_fields(&self) -> bool {
        self.elements().any(|element| element.n_fields() > 0)
    }

    /// Whether some interactions may not turn inside out.
    pub(super) fn forbids_inversion(&self) -> bool {
        self.elements().any(|element| element.forbids_inversion())
    }

    /// Whether the interaction of these points may not.
    pub(super) fn forbids_inversion_of(&self, points: &[usize]) -> bool {
        let parts = self.parts_of(points);
        let mut elements = parts.iter().filter_map(|(law, _)| self.element(law));
        elements.any(|element| element.forbids_inversion())
    }

    /// Whether the laws of all interactions are affine in the measure, or all in its square.
    pub(super) fn is_affine(&self) -> bool {
        self.affine_laws().is_some()
    }

    /// The laws, where passes need no kernel for them; nothing of those without an element.
    pub(super) fn affine_laws(&self) -> Option<AffineLaws<'_>> {
        let mut laws: Vec<Option<AffineLaw<'_>>> = Vec::with_capacity(self.elements.len());
        for (number, element) in self.elements.iter().enumerate() {
            laws.push(match element.as_deref() {
                Some(element) => {
                    Some(AffineLaw::of(element.law()?.0, self.is_by_direction(number))?)
                }
                None => None,
            });
        }
        // What bonds have from their own ends is known once.
        let by_direction =
            (0..laws.len()).all(|law| self.fields_of(law).is_none() || self.is_by_direction(law));
        // Of several laws each would have a field of its own, and what changes in time or from bond to bond
        // is looked up.
        let steady = || self.fields_of(0).is_some_and(|(fields, _)| fields.is_steady());
        let has_states = || self.takes_states(None);
        if self.has_fields() && !by_direction && !(laws.len() == 1 && steady() && !has_states()) {
            return None;
        }
        let by_square = laws.iter().flatten().next()?.by_square;
        let alike = laws.iter().flatten().all(|law| law.by_square == by_square);
        alike.then_some(AffineLaws { laws, by_square })
    }
}

/// Laws of which passes need no kernel.
pub(super) struct AffineLaws<'a> {
    laws: Vec<Option<AffineLaw<'a>>>,
    pub(super) by_square: bool,
}

impl AffineLaws<'_> {
    /// The energy of interactions with these parts in the laws, of one measure at rest, of bonds with this
    /// direction; nothing where it is not finite.
    pub(super) fn at(
        &self,
        parts: Parts,
        reference: f64,
        direction: &[f64],
        weight: f64,
    ) -> Option<Quadratic> {
        let mut sum = Quadratic { reference, ..Quadratic::default() };
        for (law, part) in parts.iter() {
            let Some(law) = self.laws[law] else { continue };
            sum.add(&law.at(reference, direction, weight * part)?);
        }
        Some(sum)
    }
}

impl Elements {
    /// Kind by kind, in the order of [`Measure::ALL`], those of each law.
    pub(super) fn by_kind(of_laws: Vec<Elements>) -> [Vec<Option<Box<dyn Element>>>; 3] {
        let mut kinds = [const { Vec::new() }; 3];
        for Elements { bond, triangle, tetrahedron } in of_laws {
            kinds.iter_mut().zip([bond, triangle, tetrahedron]).for_each(|(kind, element)| {
                kind.push(element);
            });
        }
        kinds
    }
}
