//! Conditions of gathered values under which bonds break: one that holds the length of a bond is asked of a bond
//! with what either of its ends gathers, one without of a point, and breaks all of its bonds.

use rayon::prelude::*;

use super::StateEnergy;
use crate::energy::NonFinite;
use crate::fracture::{Asked, Judged};
use crate::geometry::Geometry;
use crate::geometry::bond::Bond;
use crate::kernel::{Variables, VariablesLaw};

/// Points whose bonds are judged by one task; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// Places that go through a margin at once.
const CAPACITY: usize = 128;

/// A condition of what points gather.
pub struct GatheredCriterion {
    /// The number of the layer of energies that it belongs to.
    pub layer: usize,
    /// The law in it: points that take this law are judged, and their ends of bonds.
    pub law: u8,
    /// Which of the conditions of fields of the law it is, from 0.
    pub number: usize,
    /// Whether it holds the length of a bond.
    pub of_bonds: bool,
    /// The margin, in the place of psi, with the variables of energies of bonds or of points.
    pub margin: Box<dyn VariablesLaw>,
    /// Whether bonds break where it is 0, too.
    pub holds_at_zero: bool,
}

/// A body at some displacements: what points gather, point by point, and displacements in m.
#[derive(Clone, Copy)]
struct Deformed<'a> {
    integrals: &'a [f64],
    u: &'a [f64],
}

impl StateEnergy {
    /// The same with conditions under which bonds break.
    pub fn with_criteria(self, criteria: Vec<GatheredCriterion>) -> StateEnergy {
        StateEnergy { criteria, ..self }
    }

    /// See [`crate::energy::Energy::field_margins`].
    pub(super) fn margins<const D: usize>(
        &self,
        u: &[f64],
        asked: Asked,
    ) -> Result<Vec<Judged>, NonFinite> {
        let integrals = self.integrals(u);
        let now = Deformed { integrals: &integrals, u };
        let nowhere = vec![0.0; u.len()];
        let at_rest = (asked != Asked::Breaking).then(|| self.integrals(&nowhere));
        let at_rest = at_rest.as_deref().map(|integrals| Deformed { integrals, u: &nowhere });
        let mut all = Vec::new();
        for criterion in &self.criteria {
            let judge = |places: Vec<[usize; 2]>| self.judge::<D>(criterion, &places, now, at_rest);
            if let Asked::Bond([i, j]) = asked {
                let places = if criterion.of_bonds { [[i, j], [j, i]] } else { [[i; 2], [j; 2]] };
                all.extend(judge(places.to_vec())?);
                continue;
            }
            let n = self.body.n_points();
            let chunk = |number: usize| {
                let points = number * CHUNK..n.min((number + 1) * CHUNK);
                let row = |i: usize| self.neighborhood.row(i).iter().map(move |j| [i, *j as usize]);
                judge(match criterion.of_bonds {
                    true => points.flat_map(row).collect(),
                    false => points.map(|i| [i; 2]).collect(),
                })
            };
            let parts: Result<Vec<_>, NonFinite> =
                (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
            all.extend(parts?.concat());
        }
        Ok(all)
    }

    /// Judges places by what their first points gather, those that take the law.
    fn judge<const D: usize>(
        &self,
        criterion: &GatheredCriterion,
        places: &[[usize; 2]],
        now: Deformed<'_>,
        at_rest: Option<Deformed<'_>>,
    ) -> Result<Vec<Judged>, NonFinite> {
        let GatheredCriterion { layer, law, number, holds_at_zero, .. } = *criterion;
        let of = |point: usize| self.materials.as_ref().map_or(0, |materials| materials.of(point));
        let own: Vec<[usize; 2]> =
            places.iter().filter(|ends| of(ends[0]) == law).copied().collect();
        let mut found = Vec::new();
        for places in own.chunks(CAPACITY) {
            let rest = match at_rest {
                Some(at_rest) => self.values::<D>(criterion, places, at_rest)?,
                None => Vec::new(),
            };
            let margins = self.values::<D>(criterion, places, now)?;
            for (k, (ends, margin)) in places.iter().zip(margins).enumerate() {
                let breaks = margin > 0.0 || holds_at_zero && margin == 0.0;
                if at_rest.is_some() || breaks {
                    let (of, at_rest) = (Some(*ends), rest.get(k).copied().unwrap_or(f64::NAN));
                    let law = usize::from(law);
                    found.push(Judged { of, layer, law, number, margin, at_rest, breaks });
                }
            }
        }
        Ok(found)
    }

    /// Margins at some places.
    fn values<const D: usize>(
        &self,
        criterion: &GatheredCriterion,
        places: &[[usize; 2]],
        Deformed { integrals, u }: Deformed<'_>,
    ) -> Result<Vec<f64>, NonFinite> {
        let (n, m) = (places.len(), self.n_integrals());
        let positions = self.body.positions().as_chunks::<D>().0;
        let displacements = u.as_chunks::<D>().0;
        let (mut current, mut change, mut given) = (Vec::new(), Vec::new(), Vec::new());
        if criterion.of_bonds {
            for &[i, j] in places {
                let xi: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
                let eta = std::array::from_fn(|c| displacements[j][c] - displacements[i][c]);
                let now = <Bond as Geometry<D>>::change(&xi, &eta);
                current.push(now.measure);
                change.push(now.change);
                given.push(xi.iter().fold(0.0, |sum, x| sum + x * x).sqrt());
            }
        }
        current.extend((0..m).flat_map(|k| places.iter().map(move |[i, _]| integrals[i * m + k])));
        self.give(n, |place| places[place], &mut given);
        let laws = vec![criterion.law; n];
        let at = Variables { n, current: &current, change: &change, given: &given, laws: &laws };
        let mut margins = vec![0.0; n];
        criterion.margin.evaluate(at, &mut margins, &mut []);
        match margins.iter().position(|margin| !margin.is_finite()) {
            Some(lane) => {
                let point = places[lane][0];
                Err(self.named(point, integrals.get(point * m).copied(), u))
            }
            None => Ok(margins),
        }
    }
}
