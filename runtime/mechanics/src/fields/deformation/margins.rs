//! Conditions of deformation gradients under which bonds break: where the energy is at bonds, a bond by its own
//! gradient, else all bonds of a point by the point's.

use rayon::prelude::*;

use super::batch::{CAPACITY, LawBatch, determinant};
use super::quadrature::Bond;
use super::sweep::{Failure, Fields};
use super::{DeformationEnergy, Places, Room};
use crate::energy::NonFinite;
use crate::fields::stored::Tensor;
use crate::fracture::{Asked, FamilyCriterion, Judged};
use crate::materials::LawOfPoints;

/// Owners whose bonds are judged by one task; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// Places on their way through a margin.
struct Judging<'a, const D: usize> {
    criterion: &'a FamilyCriterion,
    law: LawOfPoints<'a>,
    /// Whether all margins are asked for, with those at rest.
    all: bool,
    found: Vec<Judged>,
}

impl DeformationEnergy {
    /// The same with conditions under which bonds break.
    pub fn with_criteria(self, criteria: Vec<FamilyCriterion>) -> DeformationEnergy {
        DeformationEnergy { criteria, ..self }
    }

    /// See [`crate::energy::Energy::field_margins`].
    pub(super) fn margins<const D: usize>(
        &self,
        u: &[f64],
        asked: Asked,
    ) -> Result<Vec<Judged>, NonFinite> {
        let mut room = self.room.take(Room::default);
        let h = self.gradients_in::<D>(u, &mut room.h);
        let fields = Fields { u: u.as_chunks::<D>().0, h };
        let mut all = Vec::new();
        for criterion in &self.criteria {
            let law = LawOfPoints { law: &*criterion.margin, ..self.law() };
            let judging =
                || Judging { criterion, law, all: asked != Asked::Breaking, found: Vec::new() };
            let found = match asked {
                Asked::Bond(ends) => self.judge_around(judging(), fields, ends),
                _ => self.judge_all(judging, fields),
            };
            all.extend(found.map_err(|failure| self.failed(failure, u))?);
        }
        Ok(all)
    }

    /// The places by which a bond is judged.
    fn judge_around<const D: usize>(
        &self,
        mut judging: Judging<'_, D>,
        fields: Fields<'_, D>,
        ends: [usize; 2],
    ) -> Result<Vec<Judged>, Failure> {
        let places: &[[usize; 2]] = match self.places {
            Places::Bonds(_) => &[ends],
            _ => &[[ends[0]; 2], [ends[1]; 2]],
        };
        let positions = self.body.positions().as_chunks::<D>().0;
        let mut batch = LawBatch::new();
        judging.judge(&mut batch, places, |place| gradient(positions, fields, place))?;
        Ok(judging.found)
    }

    /// All places, those of points in their order, those of bonds owner by owner.
    fn judge_all<'a, const D: usize>(
        &self,
        judging: impl Fn() -> Judging<'a, D> + Sync,
        fields: Fields<'_, D>,
    ) -> Result<Vec<Judged>, Failure> {
        let (n, neighborhood) = (self.body.n_points(), self.operator.neighborhood());
        let positions = self.body.positions().as_chunks::<D>().0;
        let at_bonds = matches!(self.places, Places::Bonds(_));
        let chunk = |number: usize| -> Result<Vec<Judged>, Failure> {
            let points = number * CHUNK..n.min((number + 1) * CHUNK);
            let mut places: Vec<[usize; 2]> = Vec::new();
            for i in points {
                match at_bonds {
                    true => places.extend(neighborhood.upper(i).iter().map(|j| [i, *j as usize])),
                    // What is left of a released family determines no gradient.
                    false if self.operator.is_released(i) => {}
                    false => places.push([i; 2]),
                }
            }
            let (mut batch, mut judging) = (LawBatch::new(), judging());
            judging.judge(&mut batch, &places, |place| gradient(positions, fields, place))?;
            Ok(judging.found)
        };
        let parts: Result<Vec<_>, Failure> =
            (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        Ok(parts?.concat())
    }
}

/// `F - I` of a bond, or of a point in the place of both of its ends.
fn gradient<const D: usize>(
    positions: &[[f64; D]],
    fields: Fields<'_, D>,
    [i, j]: [usize; 2],
) -> Tensor<D> {
    if i == j { fields.h[i] } else { Bond::new(positions, i, j).gradient(fields) }
}

impl<const D: usize> Judging<'_, D> {
    /// Judges the places that take the law.
    fn judge(
        &mut self,
        batch: &mut LawBatch<D>,
        places: &[[usize; 2]],
        gradient: impl Fn([usize; 2]) -> Tensor<D>,
    ) -> Result<(), Failure> {
        let number = self.criterion.law;
        let takes = |ends: &&[usize; 2]| self.law.part(**ends, number).is_some();
        let own: Vec<[usize; 2]> = places.iter().filter(takes).copied().collect();
        for places in own.chunks(CAPACITY) {
            let h: Vec<Tensor<D>> = places.iter().map(|place| gradient(*place)).collect();
            let at_rest = match self.all {
                true => Some(self.values(batch, places, &vec![[[0.0; D]; D]; h.len()])?),
                false => None,
            };
            let margins = self.values(batch, places, &h)?;
            self.criterion.judge(places, (&margins, at_rest.as_deref()), &mut self.found);
        }
        Ok(())
    }

    /// Margins at gradients.
    fn values(
        &self,
        batch: &mut LawBatch<D>,
        places: &[[usize; 2]],
        h: &[Tensor<D>],
    ) -> Result<Vec<f64>, Failure> {
        let laws = vec![self.criterion.law; places.len()];
        let law = (self.law, &laws[..]);
        let done = batch.evaluate(law, (|lane: usize| places[lane], h), false);
        done.map_err(|lane| Failure {
            points: places[lane].to_vec(),
            determinant: determinant(&h[lane]),
        })?;
        Ok(batch.psi().to_vec())
    }
}
