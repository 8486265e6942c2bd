//! What triangles and tetrahedra across a plane hold when they break.
//!
//! One breaks with the first of its edges, or by its own condition if that comes first. What it holds then
//! depends on the way in which it is deformed, and no way is given by the criterion. The one that is taken is
//! that of the whole lattice: the corners above the plane move away from those below it along its normal, and
//! neither group is deformed. An edge then is at its threshold where `abs(xi + s n)` is its critical length;
//! areas in the plane and volumes change with `s` in a straight line, the square of an area in space as a
//! quadratic.
//!
//! The corners of a clique lie at different heights above the plane. It crosses as many planes between two
//! neighbouring heights as these are apart, each time with the same corners above.

use std::collections::BTreeMap;

use piola_mechanics::element::{CAPACITY, Contributions, Element, InteractionBatch, Order};
use piola_mechanics::lattice::ordered;

use super::super::cliques::{Vector, cross, dot, for_each_clique, gather};
use super::super::inside::Inside;
use super::bonds::{Part, threshold};
use super::{Edges, NoFractureEnergy, norm, weight};
use crate::case::Case;

/// Cliques of a point that are taken one by one, each with every plane.
const MOST: u64 = 10_000_000;

/// How far the halves are pulled apart at most, in horizons.
const FARTHEST: f64 = 10.0;

/// Triangles or tetrahedra of one potential.
pub(super) struct Cliques<'a> {
    element: &'a dyn Element,
    parts: &'a [Part<'a>],
    edges: &'a Edges,
}

/// Conditions of their own: by the square of the measure in spacings, the smallest growth and the smallest
/// loss, in parts of the measure at rest.
type Own = BTreeMap<i64, [Option<f64>; 2]>;

impl<'a> Cliques<'a> {
    pub(super) fn new(
        element: &'a dyn Element,
        parts: &'a [Part<'a>],
        edges: &'a Edges,
    ) -> Cliques<'a> {
        Cliques { element, parts, edges }
    }

    fn name(&self) -> &'static str {
        self.element.measure().interactions()
    }

    /// Adds what they hold to the planes.
    pub(super) fn add(
        &self,
        (case, inside): (&Case, &Inside),
        planes: &mut [(Vec<i32>, f64)],
    ) -> Result<(), NoFractureEnergy> {
        let (measure, d, spacing) =
            (self.element.measure(), self.element.dimension(), inside.spacing());
        let orders: u64 = (1..=measure.points() as u64).product();
        let count = ordered(measure, inside.shells(measure)) / orders;
        if count > MOST {
            return Err(NoFractureEnergy::TooMany(count, self.name(), MOST));
        }
        let ratio = case.scene.horizon_radius() / spacing;
        let weight = weight(case, inside, measure)?;
        let mut own = Own::new();
        for (normal, sum) in planes {
            let mut held = Held::new(self.element);
            let mut crossings = |corners: &[Vector]| -> Result<(), NoFractureEnergy> {
                let limits = *own
                    .entry(key(corners))
                    .or_insert_with(|| self.thresholds(key(corners), spacing));
                for (crossing, way) in Crossing::all(corners, normal) {
                    match self.opening(&crossing, limits, FARTHEST * ratio) {
                        Opening::Breaks(opening) => {
                            let shift = spacing * opening;
                            held.take(&crossing, spacing, shift, weight * spacing * way)
                        }
                        Opening::Still => Ok(()),
                        Opening::Never => Err(NoFractureEnergy::NeverBreaks(self.name())),
                    }?;
                }
                Ok(())
            };
            for_each_clique(measure, d, ratio, &mut crossings)?;
            *sum += held.total()?;
        }
        Ok(())
    }

    fn thresholds(&self, key: i64, spacing: f64) -> [Option<f64>; 2] {
        let measure = self.element.measure();
        let unit = (1..measure.length_exponent()).fold(spacing, |unit, _| unit * spacing);
        let reference = (key as f64).sqrt() * unit;
        let is_signed = measure.is_signed(self.element.dimension());
        let of_side = |side: f64| threshold(self.parts, measure, reference, side);
        // A root ends at 0.
        [of_side(1.0), of_side(-1.0).filter(|loss| is_signed || *loss >= -1.0)]
    }

    /// How far the corners above are moved when the clique breaks, in spacings.
    fn opening(&self, crossing: &Crossing, own: [Option<f64>; 2], farthest: f64) -> Opening {
        let edges = crossing.edges().filter_map(|edge| {
            let d = self.element.dimension();
            let strain = self.edges.strain(&edge.map(|x| x as i32)[..d])?;
            Some(crossing.until_length(edge, strain))
        });
        let first = edges.fold(f64::INFINITY, f64::min);
        let by_itself = crossing.until_measure(own);
        let opening = first.min(by_itself);
        if opening <= farthest {
            Opening::Breaks(opening)
        } else if crossing.is_still() && self.element.law().is_some() {
            Opening::Still
        } else {
            Opening::Never
        }
    }
}

/// When a clique breaks.
enum Opening {
    /// Where the corners above are so far, in spacings.
    Breaks(f64),
    /// Its measure stays as it is, and so does its energy.
    Still,
    Never,
}

/// A clique with a plane between its corners.
struct Crossing<'a> {
    /// From its first corner, in spacings.
    corners: &'a [Vector],
    /// Unit normal.
    normal: [f64; 3],
    /// Whether each corner is above the plane, the first one in front.
    above: Vec<bool>,
}

impl<'a> Crossing<'a> {
    /// All that a clique has with planes of a normal, with the distance of the heights between which they
    /// lie, in spacings.
    fn all(corners: &'a [Vector], normal: &[i32]) -> Vec<(Crossing<'a>, f64)> {
        let size = norm(normal);
        let mut unit = [0.0; 3];
        unit.iter_mut().zip(normal).for_each(|(to, n)| *to = f64::from(*n) / size);
        let height = |corner: &Vector| -> i64 {
            corner.iter().zip(normal).map(|(x, n)| x * i64::from(*n)).sum()
        };
        let heights: Vec<i64> = std::iter::once(0).chain(corners.iter().map(height)).collect();
        let mut sorted = heights.clone();
        sorted.sort_unstable();
        sorted.dedup();
        let between = |pair: &[i64]| {
            let above = heights.iter().map(|height| *height >= pair[1]).collect();
            (Crossing { corners, normal: unit, above }, (pair[1] - pair[0]) as f64 / size)
        };
        sorted.windows(2).map(between).collect()
    }

    fn place(&self, corner: usize) -> Vector {
        if corner == 0 { [0; 3] } else { self.corners[corner - 1] }
    }

    /// Those between a corner below and one above.
    fn edges(&self) -> impl Iterator<Item = Vector> {
        let n = self.above.len();
        let pairs = (0..n).flat_map(move |p| (0..n).map(move |q| (p, q)));
        let across = pairs.filter(|(p, q)| !self.above[*p] && self.above[*q]);
        across.map(|(p, q)| {
            let (p, q) = (self.place(p), self.place(q));
            std::array::from_fn(|axis| q[axis] - p[axis])
        })
    }

    /// The opening at which an edge across the plane is longer by a part of its length.
    fn until_length(&self, edge: Vector, strain: f64) -> f64 {
        let edge = edge.map(|x| x as f64);
        let (height, square) = (dot(edge, self.normal), dot(edge, edge));
        let grown = square * (strain * (2.0 + strain));
        grown / (height + (height * height + grown).sqrt())
    }

    /// Displacements of the other corners against the first for an opening of 1.
    fn moves(&self) -> Vec<[f64; 3]> {
        let by =
            |is_above: bool| f64::from(u8::from(is_above)) - f64::from(u8::from(self.above[0]));
        self.above[1..].iter().map(|one| self.normal.map(|n| by(*one) * n)).collect()
    }

    /// The measure as a vector, that of an area in space, or its third component: at rest, and its change
    /// for an opening of 1.
    fn measure(&self) -> [[f64; 3]; 2] {
        let corners: Vec<[f64; 3]> =
            self.corners.iter().map(|corner| corner.map(|x| x as f64)).collect();
        let moves = self.moves();
        let plus = |x: [f64; 3], y: [f64; 3]| std::array::from_fn(|k| x[k] + y[k]);
        match (&corners[..], &moves[..]) {
            // The moves are parallel: what is quadratic in the opening is 0.
            ([p, q], [a, b]) => [cross(*p, *q), plus(cross(*a, *q), cross(*p, *b))],
            ([p, q, r], [a, b, c]) => {
                let change =
                    dot(cross(*a, *q), *r) + dot(cross(*p, *b), *r) + dot(cross(*p, *q), *c);
                [[0.0, 0.0, dot(cross(*p, *q), *r)], [0.0, 0.0, change]]
            }
            _ => [[0.0; 3]; 2],
        }
    }

    fn is_still(&self) -> bool {
        self.measure()[1] == [0.0; 3]
    }

    /// The first opening at which the measure has grown, or shrunk, by a part of itself.
    fn until_measure(&self, [growth, loss]: [Option<f64>; 2]) -> f64 {
        let [rest, change] = self.measure();
        let in_plane = self.normal[2] == 0.0 && self.corners.iter().all(|corner| corner[2] == 0);
        let is_line = self.corners.len() == 3 || in_plane;
        let until = |strain: f64| {
            if is_line {
                let opening = strain * rest[2] / change[2];
                return if opening > 0.0 { opening } else { f64::INFINITY };
            }
            // (1 + strain)^2 of the square of the area.
            let (a, b) = (dot(change, change), dot(rest, change));
            let c = -dot(rest, rest) * (strain * (2.0 + strain));
            first_root(a, b, c)
        };
        growth.into_iter().chain(loss).map(until).fold(f64::INFINITY, f64::min)
    }
}

/// The smallest positive root of `a x^2 + 2 b x + c`, with `a` not negative; infinite where there is none.
fn first_root(a: f64, b: f64, c: f64) -> f64 {
    let square = b * b - a * c;
    if square < 0.0 || (a == 0.0 && b == 0.0) {
        return f64::INFINITY;
    }
    let q = -(b + square.sqrt().copysign(b));
    [q / a, c / q].into_iter().filter(|x| *x > 0.0).fold(f64::INFINITY, f64::min)
}

/// Energies of cliques that break, batch by batch.
struct Held<'a> {
    element: &'a dyn Element,
    batch: InteractionBatch,
    out: Contributions,
    reference: Vec<f64>,
    displacement: Vec<f64>,
    weights: Vec<f64>,
    sum: f64,
}

impl<'a> Held<'a> {
    fn new(element: &'a dyn Element) -> Held<'a> {
        let (measure, d) = (element.measure(), element.dimension());
        Held {
            element,
            batch: InteractionBatch::new(measure, d),
            out: Contributions::new(measure, d),
            reference: Vec::new(),
            displacement: Vec::new(),
            weights: Vec::new(),
            sum: 0.0,
        }
    }

    /// One whose corners above the plane are moved by `shift` m.
    fn take(
        &mut self,
        crossing: &Crossing<'_>,
        spacing: f64,
        shift: f64,
        weight: f64,
    ) -> Result<(), NoFractureEnergy> {
        let d = self.element.dimension();
        for (corner, by) in crossing.corners.iter().zip(crossing.moves()) {
            self.reference.extend(corner[..d].iter().map(|x| *x as f64 * spacing));
            self.displacement.extend(by[..d].iter().map(|x| x * shift));
        }
        self.weights.push(weight);
        if self.weights.len() == CAPACITY { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), NoFractureEnergy> {
        let n = self.weights.len();
        if n == 0 {
            return Ok(());
        }
        let (n_others, d) = (self.element.measure().points() - 1, self.element.dimension());
        gather(&mut self.batch, [n_others, d], [&self.reference, &self.displacement]);
        self.batch.weight[..n].copy_from_slice(&self.weights);
        let found = self.element.evaluate(&self.batch, Order::Energy, &mut self.out);
        let energies = &self.out.energy[..n];
        if found.is_err() || energies.iter().any(|energy| !energy.is_finite()) {
            return Err(NoFractureEnergy::NotFinite(self.element.measure().interactions()));
        }
        self.sum += energies.iter().sum::<f64>();
        self.reference.clear();
        self.displacement.clear();
        self.weights.clear();
        Ok(())
    }

    fn total(mut self) -> Result<f64, NoFractureEnergy> {
        self.flush()?;
        Ok(self.sum)
    }
}

/// The square of the measure, in spacings.
fn key(corners: &[Vector]) -> i64 {
    match corners {
        [p, q] => {
            let normal = cross(*p, *q);
            dot(normal, normal)
        }
        [p, q, r] => {
            let volume = dot(cross(*p, *q), *r);
            volume * volume
        }
        _ => 0,
    }
}
