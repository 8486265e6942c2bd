//! Bonds of points whose horizon is cut: corrected volumes of cells, corrected stiffness at faces.
//!
//! A point near a face has fewer neighbours than one inside, and what its bonds store at a given strain is
//! less by that: faces are softer than the solid. A correction multiplies each bond by a number that is
//! worked out once, from the body before it moves. So the energy stays one function of displacements, and
//! forces are its exact derivatives.
//!
//! What is compared are energy densities of small strains, `1/2 psi''(L) (L e)^2` bond by bond, of the very
//! potential: at a point of the body, by the law of its own material for all its bonds, and inside the
//! endless lattice of the same spacing, horizon and weights. Their ratio `g = w_bulk/w` is 1 inside.
//!
//! | [`Surface`] | strain | `g` of a point |
//! |---|---|---|
//! | `Energy` | alike in all directions | one number (Macek, Silling 2007) |
//! | `Directional` | along one axis, none across | one for each axis (Madenci, Oterkus 2014; Le, Bobaru 2018) |
//!
//! A bond along the unit vector n between points i and j takes the factor
//! `1/sqrt(sum_k (n_k/g_k)^2)` with the means `g_k = (g_ik + g_jk)/2`; where `g` is the same for all axes,
//! that is the mean itself.
//!
//! With `Energy` the body as a whole stores at such a strain what its volume would inside: summed over
//! bonds, means of both ends are what every point has times its own `g`.

use rayon::prelude::*;

use crate::body::Body;
use crate::element::Element;
use crate::kernel::{Batch, Law, Measure, Order, Outputs};
use crate::lattice::{Shell, ordered, shells};
use crate::materials::Materials;
use crate::neighborhood::Neighborhood;
use crate::weights::{CliqueWeights, Weights, WeightsError};
use crate::words::Words;

/// How bonds of points near faces are corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// Not at all.
    None,
    /// By the energy of a strain that is alike in all directions.
    Energy,
    /// By the energies of strains along the axes.
    Directional,
}

impl Words for Surface {
    const WORDS: &'static [(&'static str, Surface)] = &[
        ("none", Surface::None),
        ("energy", Surface::Energy),
        ("directional", Surface::Directional),
    ];
}

/// What of a neighbour's volume a bond takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Volumes {
    /// All.
    Whole,
    /// The part of its cell that lies within the horizon, about: all up to half a spacing before the
    /// horizon, half at the horizon, in between a straight line.
    Partial,
}

impl Words for Volumes {
    const WORDS: &'static [(&'static str, Volumes)] =
        &[("whole", Volumes::Whole), ("partial", Volumes::Partial)];
}

impl Volumes {
    /// The part of a cell at the end of a bond of this length, `1/2 + (horizon - length)/spacing`, at
    /// most 1: the ramp of PDLAMMPS (Parks et al. 2008). All lengths in m. Cells whose centre lies beyond
    /// the horizon are no neighbours.
    pub fn part(self, length: f64, horizon: f64, spacing: f64) -> f64 {
        match self {
            Volumes::Whole => 1.0,
            Volumes::Partial => (0.5 + (horizon - length) / spacing).clamp(0.0, 1.0),
        }
    }
}

/// How interactions are weighted, and bonds corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weighting {
    /// Of all interactions.
    pub weights: Weights,
    /// Of bonds.
    pub surface: Surface,
    /// Of bonds.
    pub volumes: Volumes,
}

impl From<Weights> for Weighting {
    fn from(weights: Weights) -> Weighting {
        Weighting { weights, surface: Surface::None, volumes: Volumes::Whole }
    }
}

/// Why bonds cannot be corrected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CorrectionError {
    /// Points without a lattice.
    #[error(
        "corrections of bonds (surface, volumes) compare the body with the inside of its lattice, and \
         the points are a cloud: leave them out, or take a potential of deformation gradients or of \
         gathered values"
    )]
    Cloud,
    /// Energies of other interactions.
    #[error(
        "corrections (surface, volumes) are of bonds, and psi({}) is of {}: leave them out, or take a \
         potential with psi(l) alone", _0.symbol(), _0.interactions()
    )]
    NotBonds(Measure),
    /// Parts of cells with weights that do not sum volumes.
    #[error(
        "partial volumes are parts of the volumes of neighbours, and weights \"{}\" are not made of these: \
         take weights \"volumes\"", _0.word()
    )]
    PartialWeights(Weights),
    /// Springs have no volumes to be measured by.
    #[error(
        "a surface correction compares energies per volume, and weights \"unit\" have no volumes: \
         leave it out, or take weights \"volumes\" or \"uniform\""
    )]
    Springs,
    /// An element that is no function of its measure.
    #[error(
        "a surface correction needs psi(l) with derivatives by l: derivatives = \"hyperdual-coordinates\" \
         have none, take \"hyperdual\""
    )]
    Law,
    /// An energy that does not grow with the strain.
    #[error(
        "a surface correction compares energies of small strains, and the bonds {place} store \
         {found:e} J/m^{dimension} of it: psi''(L) must be positive on the whole"
    )]
    NoStiffness {
        /// Of which point: its place in the user's order and its position, or "inside the lattice".
        place: String,
        /// For a strain of 1, in J/m^d.
        found: f64,
        /// 2 or 3.
        dimension: usize,
    },
    /// The inside cannot be weighted.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// Of a point, or inside the lattice: a number for each axis.
type Axes = [f64; 3];

impl Weighting {
    /// Whether bonds are corrected.
    pub fn corrects(self) -> bool {
        self.surface != Surface::None || self.volumes != Volumes::Whole
    }

    /// Refuses corrections of what has none.
    pub(crate) fn check(
        self,
        body: &Body,
        mut measures: impl Iterator<Item = Measure>,
    ) -> Result<(), CorrectionError> {
        if !self.corrects() {
            return Ok(());
        }
        if body.spacing().is_none() {
            return Err(CorrectionError::Cloud);
        }
        if let Some(other) = measures.find(|measure| *measure != Measure::Length) {
            return Err(CorrectionError::NotBonds(other));
        }
        if self.volumes == Volumes::Partial && self.weights != Weights::Volumes {
            return Err(CorrectionError::PartialWeights(self.weights));
        }
        if self.weights == Weights::Unit {
            return Err(CorrectionError::Springs);
        }
        Ok(())
    }

    /// The factors of all bonds by their numbers; nothing where none is corrected. Of the bonds of each
    /// law there is an element, where they have an energy in it.
    pub(crate) fn factors(
        self,
        body: &Body,
        neighborhood: &Neighborhood,
        weights: &CliqueWeights,
        elements: &[Option<Box<dyn Element>>],
        materials: Option<&Materials>,
    ) -> Result<Option<Vec<f64>>, CorrectionError> {
        let Some(spacing) = body.spacing().filter(|_| self.corrects()) else { return Ok(None) };
        let horizon = neighborhood.horizon();
        let all = shells(body.dimension(), horizon / spacing, Measure::Length);
        let lattice = Corrected { of: self, body, neighborhood, weights, spacing, shells: &all };
        let gains = match self.surface {
            Surface::None => vec![[1.0; 3]; body.n_points()],
            _ => lattice.gains(elements, materials)?,
        };
        let of_owner = |owner: usize| {
            let others = neighborhood.upper(owner).iter().map(|other| other as usize);
            let factor =
                |other: usize| lattice.factor([owner, other], [&gains[owner], &gains[other]]);
            others.map(factor).collect::<Vec<f64>>()
        };
        let rows: Vec<Vec<f64>> = (0..body.n_points()).into_par_iter().map(of_owner).collect();
        Ok(Some(rows.concat()))
    }
}

/// A lattice body whose bonds are corrected.
struct Corrected<'a> {
    of: Weighting,
    body: &'a Body,
    neighborhood: &'a Neighborhood,
    weights: &'a CliqueWeights,
    /// In m.
    spacing: f64,
    /// The bonds of an endless lattice.
    shells: &'a [Shell],
}

/// `psi''(L) L^2` of a law, in J/m^(2d) with the part of a cell at its other end, by the square of L in
/// spacings.
type Stiffness = Vec<f64>;

/// A law with the energy densities of strains of 1 inside the lattice, four times as large.
type Measured = (Stiffness, Axes);

impl Corrected<'_> {
    /// `w_bulk/w` of all points, from the element that their material has for bonds.
    fn gains(
        &self,
        elements: &[Option<Box<dyn Element>>],
        materials: Option<&Materials>,
    ) -> Result<Vec<Axes>, CorrectionError> {
        let weight = self.weight_inside()?;
        let mut laws = Vec::new();
        for element in elements {
            let Some(element) = element else {
                laws.push(None);
                continue;
            };
            let (law, _) = element.law().ok_or(CorrectionError::Law)?;
            let measured = self.measure(law, law.fields(), weight);
            let inside = measured.1[0];
            if !(inside > 0.0 && inside.is_finite()) {
                let (place, found) = ("inside the lattice".to_string(), 0.25 * inside);
                let dimension = self.body.dimension();
                return Err(CorrectionError::NoStiffness { place, found, dimension });
            }
            laws.push(Some((law, measured)));
        }
        let of_point = |point: usize| {
            let number = materials.map_or(0, |materials| usize::from(materials.of(point)));
            let (law, measured) = laws[number].as_ref()?;
            let compare = |(stiffness, inside): &Measured| (self.at(point, stiffness), *inside);
            let Some(fields) =
                materials.and_then(Materials::fields).filter(|_| !law.fields().is_empty())
            else {
                return Some(compare(measured));
            };
            // Its own values, here as inside.
            let own = fields.of_law(number);
            let own: Vec<f64> =
                own.map(|field| fields.mean(field, std::iter::once(point))).collect();
            Some(compare(&self.measure(*law, &own, weight)))
        };
        let n = self.body.n_points();
        let densities: Vec<Option<(Axes, Axes)>> = (0..n).into_par_iter().map(of_point).collect();
        // Along an axis without bonds none asks for it.
        let is_fine = |(here, inside): &(Axes, Axes)| {
            here.iter().all(|w| *w >= 0.0) && here.iter().any(|w| *w > 0.0) && inside[0] > 0.0
        };
        let bad = densities.iter().position(|pair| pair.as_ref().is_some_and(|p| !is_fine(p)));
        if let Some((point, (here, _))) = bad.and_then(|point| Some((point, densities[point]?))) {
            return Err(self.without_stiffness(point, here));
        }
        let gain = |densities: Option<(Axes, Axes)>| match densities {
            Some((here, inside)) => [0, 1, 2].map(|axis| inside[axis] / here[axis]),
            None => [1.0; 3],
        };
        Ok(densities.into_iter().map(gain).collect())
    }

    fn without_stiffness(&self, point: usize, densities: Axes) -> CorrectionError {
        let (user, position) = (self.body.user_index()[point], self.body.position(point));
        CorrectionError::NoStiffness {
            place: format!(
                "of point {user} (counted from 0 in the order of the input) at {position:?} m"
            ),
            found: 0.25 * densities.into_iter().fold(f64::INFINITY, f64::min),
            dimension: self.body.dimension(),
        }
    }

    /// What the bonds of a law have at rest with these values of its fields, and what is inside with them.
    fn measure(&self, law: &dyn Law, fields: &[f64], weight: f64) -> Measured {
        let lengths: Vec<f64> =
            self.shells.iter().map(|shell| shell.measure * self.spacing).collect();
        let zeros = vec![0.0; lengths.len()];
        let (mut psi, mut first, mut second) = (zeros.clone(), zeros.clone(), zeros.clone());
        let fields: Vec<f64> =
            fields.iter().flat_map(|value| std::iter::repeat_n(*value, lengths.len())).collect();
        let at = Batch { measure: &lengths, reference: &lengths, change: &zeros, fields: &fields };
        let out = Outputs { psi: &mut psi, dpsi: &mut first, d2psi: &mut second };
        law.evaluate(at, Order::Tangent, out);
        let squares = self.shells.iter().map(|shell| square_of(shell.measure));
        let mut stiffness = vec![0.0; squares.clone().max().unwrap_or(0) + 1];
        for ((length, second), square) in lengths.iter().zip(&second).zip(squares) {
            stiffness[square] = self.part(*length) * length * length * second;
        }
        let inside = weight * self.sum_inside(&stiffness);
        (stiffness, [inside; 3])
    }

    /// The part of the cell at the end of a bond of this length in m.
    fn part(&self, length: f64) -> f64 {
        self.of.volumes.part(length, self.neighborhood.horizon(), self.spacing)
    }

    /// The weight of a bond inside the lattice, over the volume of a cell.
    fn weight_inside(&self) -> Result<f64, WeightsError> {
        let (d, horizon) = (self.body.dimension(), self.neighborhood.horizon());
        let count = ordered(Measure::Length, self.shells);
        self.of.weights.inside(Measure::Length, d, horizon, self.spacing, count)
    }

    /// The sum over the bonds of a point inside the lattice, for the strain of the correction.
    fn sum_inside(&self, stiffness: &Stiffness) -> f64 {
        let of_shell = |shell: &Shell| {
            // By symmetry a third, or half, along each axis.
            let part = match self.of.surface {
                Surface::Directional => shell.fourth / self.body.dimension() as f64,
                _ => 1.0,
            };
            2.0 * shell.count as f64 * part * stiffness[square_of(shell.measure)]
        };
        self.shells.iter().map(of_shell).sum()
    }

    /// Energy densities of strains of 1 at a point of the body, four times as large.
    fn at(&self, point: usize, stiffness: &Stiffness) -> Axes {
        let begun = self.weights.begin(self.weights.share(point), &[]);
        let mut sum = [0.0; 3];
        for other in self.neighborhood.row(point) {
            let other = other as usize;
            let (steps, square) = self.steps([point, other]);
            let weight = self.weights.join_last(begun, self.weights.share(other));
            let bond = weight * stiffness.get(square).copied().unwrap_or(0.0);
            for (sum, step) in sum.iter_mut().zip(steps) {
                let along = step * step / square as f64;
                *sum += match self.of.surface {
                    Surface::Directional => bond * along * along,
                    _ => bond,
                };
            }
        }
        let mut densities = sum.map(|sum| sum / self.body.volumes()[point]);
        if self.body.dimension() == 2 {
            // Of an axis that no bond has.
            densities[2] = densities[0];
        }
        densities
    }

    /// A bond's whole numbers of spacings along the axes, and the sum of their squares.
    fn steps(&self, [from, to]: [usize; 2]) -> (Axes, usize) {
        let (mut steps, mut square) = ([0.0; 3], 0.0);
        let ends = self.body.position(from).iter().zip(self.body.position(to));
        for (step, (from, to)) in steps.iter_mut().zip(ends) {
            *step = ((to - from) / self.spacing).round();
            square += *step * *step;
        }
        (steps, square as usize)
    }

    /// The factor of a bond.
    fn factor(&self, ends: [usize; 2], [one, other]: [&Axes; 2]) -> f64 {
        let (steps, square) = self.steps(ends);
        let mut sum = 0.0;
        for axis in 0..3 {
            let mean = 0.5 * (one[axis] + other[axis]);
            sum += steps[axis] * steps[axis] / (mean * mean);
        }
        let square = square as f64;
        self.part(square.sqrt() * self.spacing) * (square / sum).sqrt()
    }
}

/// The square of a length in spacings, which is whole.
fn square_of(length: f64) -> usize {
    (length * length).round() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::MeasureElement;
    use crate::interaction::{Census, Degeneracy, Slabs};

    /// Bonds inside are as they were, up to the rounding of sums of 92 bonds; those at faces, where a
    /// family is half of a full one and less, are stiffer, and most so along the normal.
    #[test]
    fn bonds_inside_keep_their_weights() {
        let law = |at: Batch<'_>, _: Order, out: Outputs<'_>| {
            out.d2psi
                .iter_mut()
                .zip(at.reference)
                .for_each(|(second, length)| *second = 1.0 / length);
        };
        let counts = [9_usize, 10, 11];
        let place = |point: usize| [point / 110, point / 11 % 10, point % 11];
        let positions: Vec<f64> = (0..990).flat_map(place).map(|step| 0.3 * step as f64).collect();
        let body = Body::new(3, &positions, &[0.027; 990], Some(0.3));
        let neighborhood = Neighborhood::new(&body, 0.3 * 2.9).unwrap();
        let slabs = Slabs::new(&neighborhood);
        let census = Census::new(&body, &neighborhood, Degeneracy::new(&body), &slabs, |_| false);
        let at = |point: usize| place(body.user_index()[point] as usize);
        // How far a point is from the nearest face, in spacings.
        let depth = |point: usize| {
            let of_axis = |(step, count): (usize, &usize)| step.min(count - 1 - step);
            at(point).into_iter().zip(&counts).map(of_axis).min().unwrap()
        };
        for weights in [Weights::Uniform, Weights::Truncated, Weights::Volumes] {
            let own = weights.of_measure(Measure::Length, &body, 0.3 * 2.9, &census).unwrap();
            for surface in [Surface::Energy, Surface::Directional] {
                let law = MeasureElement::new(Measure::Length, 3, Box::new(law));
                let elements: [Option<Box<dyn Element>>; 1] = [Some(Box::new(law))];
                let weighting = Weighting { surface, ..Weighting::from(weights) };
                let factors = weighting.factors(&body, &neighborhood, &own, &elements, None);
                let factors = factors.unwrap().unwrap();
                let (mut inside, mut normal, mut along) = (0, 0.0, 0.0);
                for owner in 0..body.n_points() {
                    let bonds = neighborhood.bonds(owner).zip(neighborhood.upper(owner));
                    for (bond, other) in bonds {
                        let (ends, factor) = ([owner, other as usize], factors[bond]);
                        if ends.iter().all(|end| depth(*end) >= 2) {
                            assert!((factor - 1.0).abs() < 1e-14, "{surface:?} {factor}");
                            inside += 1;
                        }
                        let steps = ends.map(at);
                        match steps {
                            [[4, 4, 0], [4, 4, 1]] => normal = factor,
                            [[4, 4, 0], [4, 5, 0]] | [[4, 5, 0], [4, 4, 0]] => along = factor,
                            _ => {}
                        }
                    }
                }
                assert!(inside > 1000);
                let is_directional = surface == Surface::Directional;
                assert!(along > 1.05 && normal > 1.05, "{surface:?} {along} {normal}");
                assert_eq!(normal > along, is_directional, "{weights:?} {along} {normal}");
            }
        }
    }

    #[test]
    fn parts_of_cells_fall_from_one_to_a_half_at_the_horizon() {
        let part = |length: f64| Volumes::Partial.part(length, 3.0, 1.0);
        let found = [1.0, 2.5, 2.75, 3.0, 3.25, 3.5, 4.0].map(part);
        assert_eq!(found, [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0]);
        assert_eq!(Volumes::Whole.part(3.0, 3.0, 1.0), 1.0);
    }
}
