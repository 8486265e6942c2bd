//! The element of several measures: derivatives of psi by each of them from a law, the rest by the geometry
//! of edges, faces and the whole.
//!
//! With `m_i` the measures, the compact gradient is `sum_i psi_i dm_i` and the compact Hessian
//! `sum_ij psi_ij dm_i dm_j + sum_i psi_i d2m_i`. Edges and faces that do not hold the owner are vectors
//! between its neighbours; what they add to the owner's rows follows from those of the others.

use super::batch::{CAPACITY, Contributions, InteractionBatch};
use super::{Element, NonFiniteLane, Order, THIN};
use crate::geometry::bond::Bond;
use crate::geometry::double::Double;
use crate::geometry::tetrahedron::Tetrahedron;
use crate::geometry::triangle::{PlaneTriangle, SpaceTriangle};
use crate::geometry::{Change, Geometry, each, packed, packed_len};
use crate::interaction::n_neighbors;
use crate::kernel::{CoupledLaw, Measure, Variables};
use crate::pool::Pool;

/// Coordinates of all points of a tetrahedron.
const COORDINATES: usize = 12;

/// An energy density of several measures on their geometry.
pub struct CoupledElement {
    measure: Measure,
    dimension: usize,
    law: Box<dyn CoupledLaw>,
    forbids_inversion: bool,
    rooms: Pool<Room>,
}

/// Measures of a batch variable by variable, and what the law makes of them.
struct Room {
    current: Vec<f64>,
    /// Values at rest, then fields.
    given: Vec<f64>,
    change: Vec<f64>,
    slope: Vec<f64>,
    psi: Vec<f64>,
    gradient: Vec<f64>,
    direction: Vec<f64>,
    /// Second derivatives: products with the direction of each variable in turn.
    second: Vec<f64>,
}

impl Room {
    /// For the largest batch.
    fn new(law: &dyn CoupledLaw) -> Room {
        let (n_parts, n_fields) = (law.parts().len(), law.fields().len());
        let empty = |n: usize| Vec::with_capacity(n * CAPACITY);
        Room {
            current: empty(n_parts),
            given: empty(n_parts + n_fields),
            change: empty(n_parts),
            slope: empty(n_parts),
            psi: empty(1),
            gradient: empty(n_parts),
            direction: empty(n_parts),
            second: empty(n_parts * n_parts),
        }
    }
}

/// Reference vectors and displacements of one interaction, from the owner, whose are 0.
struct Shape {
    rest: [f64; COORDINATES],
    moved: [f64; COORDINATES],
    dimension: usize,
}

/// What a measure and its derivatives need of its points.
#[derive(Clone, Copy)]
struct Points<'a> {
    shape: &'a Shape,
    points: &'a [u8],
}

impl CoupledElement {
    /// The triangles (`measure` is the area) or tetrahedra (the volume) of a law in 2 or 3 dimensions. A
    /// signed measure stays positive if the law is not finite where it is 0 or minus that at rest, all other
    /// measures at rest.
    pub fn new(measure: Measure, dimension: usize, law: Box<dyn CoupledLaw>) -> CoupledElement {
        let signed = law.parts().iter().position(|part| part.measure == measure);
        let signed = signed.filter(|_| measure.is_signed(dimension));
        let n = law.parts().len();
        let given = [vec![1.0; n], law.fields().to_vec()].concat();
        let psi = |signed: usize, stretch: f64| {
            let (mut current, mut change, mut psi) = (vec![1.0; n], vec![0.0; n], [0.0]);
            (current[signed], change[signed]) = (stretch, stretch - 1.0);
            let at =
                Variables { n: 1, current: &current, change: &change, given: &given, laws: &[] };
            law.evaluate(at, &mut psi, &mut []);
            psi[0]
        };
        let forbids_inversion =
            signed.is_some_and(|signed| super::breaks_down(|stretch| psi(signed, stretch)));
        CoupledElement { measure, dimension, law, forbids_inversion, rooms: Pool::new() }
    }

    /// A signed measure stays positive, whatever the law says.
    pub fn forbid_inversion(&mut self) {
        self.forbids_inversion = self.measure.is_signed(self.dimension);
    }

    fn shape(&self, batch: &InteractionBatch, lane: usize) -> Shape {
        let d = self.dimension;
        let mut shape = Shape { rest: [0.0; 12], moved: [0.0; 12], dimension: d };
        for channel in 0..n_neighbors(self.measure) * d {
            shape.rest[d + channel] = batch.reference[channel][lane];
            shape.moved[d + channel] = batch.displacement[channel][lane];
        }
        shape
    }

    /// Fills the room with the measures of a batch.
    fn measure_all(&self, batch: &InteractionBatch, room: &mut Room) {
        let (n, parts) = (batch.len(), self.law.parts());
        for array in [&mut room.current, &mut room.change, &mut room.slope, &mut room.given] {
            array.clear();
            array.resize(n * parts.len(), 0.0);
        }
        for lane in 0..n {
            let shape = self.shape(batch, lane);
            for (k, part) in parts.iter().enumerate() {
                let points = Points { shape: &shape, points: &part.points };
                let Change { measure, reference, change, slope } = points.change(part.measure);
                let place = k * n + lane;
                (room.current[place], room.given[place]) = (measure, reference);
                (room.change[place], room.slope[place]) = (change, slope);
            }
        }
        for k in 0..self.n_fields() {
            room.given.extend(&batch.fields[k * batch.padded_len()..][..n]);
        }
    }

    /// psi and its derivatives by the measures, as far as they are asked for.
    fn evaluate_law(&self, n: usize, order: Order, room: &mut Room) {
        let Room { current, given, change, psi, gradient, direction, second, .. } = room;
        let (all, n_parts) = (current.len(), self.law.parts().len());
        let at = Variables { n, current, change, given, laws: &[] };
        psi.resize(n, 0.0);
        gradient.resize(if order == Order::Energy { 0 } else { all }, 0.0);
        self.law.evaluate(at, psi, gradient);
        second.resize(if order == Order::Tangent { n_parts * all } else { 0 }, 0.0);
        for (k, product) in second.chunks_exact_mut(all.max(1)).enumerate() {
            direction.clear();
            direction.resize(all, 0.0);
            direction[k * n..(k + 1) * n].fill(1.0);
            self.law.product(at, direction, product);
        }
    }

    /// The derivatives of one interaction by the positions of its points.
    fn differentiate(
        &self,
        (batch, lane): (&InteractionBatch, usize),
        order: Order,
        room: &Room,
        out: &mut Contributions,
    ) {
        let (d, n, parts) = (self.dimension, batch.len(), self.law.parts());
        let (shape, weight) = (self.shape(batch, lane), batch.weight[lane]);
        let mut gradient = [0.0; COORDINATES];
        let mut hessian = [[0.0; COORDINATES]; COORDINATES];
        let mut slopes = [[0.0; COORDINATES]; piola_compiler::MAX_VARIABLES];
        for (k, part) in parts.iter().enumerate() {
            let place = k * n + lane;
            let points = Points { shape: &shape, points: &part.points };
            let (measure, slope) = (room.current[place], room.slope[place]);
            let first = weight * room.gradient[place];
            slopes[k] = points.slope(part.measure, (measure, slope));
            gradient.iter_mut().zip(&slopes[k]).for_each(|(sum, slope)| *sum += first * slope);
            if order == Order::Tangent {
                points.add_curvature(part.measure, (measure, slope), first, &mut hessian);
            }
        }
        let coordinates = n_neighbors(self.measure) * d;
        for channel in 0..coordinates {
            out.gradient[channel][lane] = gradient[d + channel];
        }
        if order != Order::Tangent {
            return;
        }
        for (i, product) in room.second.chunks_exact(parts.len() * n).enumerate() {
            let mut changed = [0.0; COORDINATES];
            for (j, slope) in slopes[..parts.len()].iter().enumerate() {
                let second = weight * product[j * n + lane];
                changed.iter_mut().zip(slope).for_each(|(sum, slope)| *sum += second * slope);
            }
            // The rows of the neighbours, right of the diagonal: all that is wanted.
            for row in d..d + coordinates {
                let (slope, own) = (slopes[i][row], row..d + coordinates);
                let sums = hessian[row][own.clone()].iter_mut().zip(&changed[own]);
                sums.for_each(|(sum, c)| *sum += slope * c);
            }
        }
        for row in 0..coordinates {
            for column in row..coordinates {
                let entry = hessian[d + row][d + column];
                out.hessian[packed(coordinates, row, column)][lane] = entry;
            }
        }
    }
}

impl Element for CoupledElement {
    fn measure(&self) -> Measure {
        self.measure
    }

    fn argument(&self) -> &str {
        self.law.argument()
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn forbids_inversion(&self) -> bool {
        self.forbids_inversion
    }

    fn n_fields(&self) -> usize {
        self.law.fields().len()
    }

    fn provide(&self) {
        self.rooms.provide(|| Room::new(&*self.law));
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        let mut room = self.rooms.take(|| Room::new(&*self.law));
        self.measure_all(batch, &mut room);
        self.evaluate_law(batch.len(), order, &mut room);
        for lane in 0..batch.len() {
            out.energy[lane] = batch.weight[lane] * room.psi[lane];
            if order != Order::Energy {
                self.differentiate((batch, lane), order, &room, out);
            }
            let is_refused = || {
                let shape = self.shape(batch, lane);
                let whole = Points { shape: &shape, points: &[0, 1, 2, 3] };
                let Change { measure, reference, .. } = whole.change(self.measure);
                (measure, reference)
            };
            let coordinates = n_neighbors(self.measure) * self.dimension;
            let is_finite = out.is_finite(lane, order, coordinates);
            if !is_finite || self.forbids_inversion {
                let (value, reference) = is_refused();
                if !is_finite || value < self.least() {
                    return Err(NonFiniteLane { lane, value, reference });
                }
            }
        }
        Ok(())
    }
}

impl Points<'_> {
    /// Vectors from the first point to the others.
    fn vectors<const C: usize>(&self, all: &[f64; COORDINATES]) -> [f64; C] {
        let d = self.shape.dimension;
        let at = |point: usize, axis: usize| all[usize::from(self.points[point]) * d + axis];
        each(|c| at(1 + c / d, c % d) - at(0, c % d))
    }

    /// The measure, at rest and now; of what is thin in twice the digits.
    fn change(&self, measure: Measure) -> Change<f64> {
        match (measure, self.shape.dimension) {
            (Measure::Length, 2) => self.change_of::<Bond, 2>(),
            (Measure::Length, _) => self.change_of::<Bond, 3>(),
            (Measure::Area, 2) => self.change_of::<PlaneTriangle, 4>(),
            (Measure::Area, _) => self.change_of::<SpaceTriangle, 6>(),
            (Measure::Volume, _) => self.change_of::<Tetrahedron, 9>(),
        }
    }

    fn change_of<G: Geometry<C>, const C: usize>(&self) -> Change<f64> {
        let rest: [f64; C] = self.vectors(&self.shape.rest);
        let moved: [f64; C] = self.vectors(&self.shape.moved);
        let change = G::change(&rest, &moved);
        let is_thin = |measure: f64, vectors: &[f64; C]| {
            let largest = G::largest_square(vectors);
            largest.is_some_and(|largest| measure * measure < THIN * THIN * largest)
        };
        let now: [f64; C] = each(|c| rest[c] + moved[c]);
        if !is_thin(change.reference, &rest) && !is_thin(change.measure, &now) {
            return change;
        }
        let doubles = |numbers: &[f64; C]| -> [Double; C] { each(|c| Double::new(numbers[c])) };
        let Change { measure, reference, change, slope } =
            G::change(&doubles(&rest), &doubles(&moved));
        Change {
            measure: measure.rounded(),
            reference: reference.rounded(),
            change: change.rounded(),
            slope: slope.rounded(),
        }
    }

    /// The derivatives of the measure by the positions of all points.
    fn slope(&self, measure: Measure, now: (f64, f64)) -> [f64; COORDINATES] {
        match (measure, self.shape.dimension) {
            (Measure::Length, 2) => self.slope_of::<Bond, 2>(now),
            (Measure::Length, _) => self.slope_of::<Bond, 3>(now),
            (Measure::Area, 2) => self.slope_of::<PlaneTriangle, 4>(now),
            (Measure::Area, _) => self.slope_of::<SpaceTriangle, 6>(now),
            (Measure::Volume, _) => self.slope_of::<Tetrahedron, 9>(now),
        }
    }

    fn slope_of<G: Geometry<C>, const C: usize>(
        &self,
        (measure, slope): (f64, f64),
    ) -> [f64; COORDINATES] {
        let factor = G::VARIABLE.slopes(measure, slope, 1.0, 0.0).0;
        let gradient = G::gradient(&self.now::<C>());
        let mut all = [0.0; COORDINATES];
        for (c, part) in gradient.iter().enumerate() {
            for (place, sign) in self.places(c) {
                all[place] += sign * factor * part;
            }
        }
        all
    }

    /// Adds a factor times the second derivatives of the measure.
    fn add_curvature(
        &self,
        measure: Measure,
        now: (f64, f64),
        factor: f64,
        hessian: &mut [[f64; COORDINATES]; COORDINATES],
    ) {
        match (measure, self.shape.dimension) {
            (Measure::Length, 2) => self.add_curvature_of::<Bond, 2>(now, factor, hessian),
            (Measure::Length, _) => self.add_curvature_of::<Bond, 3>(now, factor, hessian),
            (Measure::Area, 2) => self.add_curvature_of::<PlaneTriangle, 4>(now, factor, hessian),
            (Measure::Area, _) => self.add_curvature_of::<SpaceTriangle, 6>(now, factor, hessian),
            (Measure::Volume, _) => self.add_curvature_of::<Tetrahedron, 9>(now, factor, hessian),
        }
    }

    fn add_curvature_of<G: Geometry<C>, const C: usize>(
        &self,
        (measure, slope): (f64, f64),
        factor: f64,
        hessian: &mut [[f64; COORDINATES]; COORDINATES],
    ) {
        let x = self.now::<C>();
        let gradient = G::gradient(&x);
        let (first, second) = G::VARIABLE.slopes(measure, slope, factor, 0.0);
        let mut entries = [0.0; packed_len(9)];
        G::hessian(&x, &gradient, first, second, |place, value| entries[place] = value);
        for row in 0..C {
            for column in 0..C {
                let entry = entries[packed(C, row.min(column), row.max(column))];
                for (i, sign) in self.places(row) {
                    for (j, other) in self.places(column) {
                        hessian[i][j] += sign * other * entry;
                    }
                }
            }
        }
    }

    fn now<const C: usize>(&self) -> [f64; C] {
        let (rest, moved): ([f64; C], [f64; C]) =
            (self.vectors(&self.shape.rest), self.vectors(&self.shape.moved));
        each(|c| rest[c] + moved[c])
    }

    /// The coordinates whose difference is component `c` of the vectors.
    fn places(&self, c: usize) -> [(usize, f64); 2] {
        let d = self.shape.dimension;
        let at = |point: usize| usize::from(self.points[point]) * d + c % d;
        [(at(1 + c / d), 1.0), (at(0), -1.0)]
    }
}
