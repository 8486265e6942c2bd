//! Cracks that are there from the start: which bonds they cut.
//!
//! A crack is a segment in the plane, or a flat polygon in space. It cuts the bonds whose inside crosses
//! its inside. Bonds that only touch it are kept: those through its front, and those with an end on it. What
//! lies closer than `1e-9` of the horizon to a crack or its front lies on it, so that rounding of
//! coordinates does not decide.

use crate::body::Body;
use crate::geometry::{dot, each};
use crate::neighborhood::{HORIZON_TOLERANCE, Neighborhood};

/// Distances below this share of the horizon are none.
const TOUCHING: f64 = 1e-9;

/// A crack.
#[derive(Clone, Debug, PartialEq)]
pub enum Crack {
    /// Between two points, in m.
    Segment([[f64; 2]; 2]),
    /// A flat polygon, convex or not, by its corners in m.
    Polygon(Vec<[f64; 3]>),
}

/// What is wrong with a crack.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CrackError {
    /// A segment whose ends coincide, or a polygon of fewer than three corners or without an area.
    #[error("a crack needs an extent: its corners lie at one place or on one line")]
    Flat,
    /// Corners that are not in one plane.
    #[error("the corners of a crack lie in one plane: corner {corner} is {distance:e} m off it")]
    Bent {
        /// Counted from 0.
        corner: usize,
        /// In m.
        distance: f64,
    },
}

/// What a crack does to the bonds of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// The bonds that it cuts, ascending.
    pub bonds: Vec<usize>,
    /// How many bonds go through its front, and are kept.
    pub through_front: usize,
    /// How many have an end on it or lie in it, and are kept.
    pub touching: usize,
}

/// How a bond meets a crack.
#[derive(Clone, Copy, PartialEq)]
enum Meeting {
    Apart,
    Crossing,
    Front,
    Touching,
}

impl Crack {
    /// Whether it has an extent, and is flat.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self) -> Result<(), CrackError> {
        match self {
            Crack::Segment([p, q]) if p == q => Err(CrackError::Flat),
            Crack::Segment(_) => Ok(()),
            Crack::Polygon(corners) => Plane::of(corners).ok_or(CrackError::Flat)?.check(corners),
        }
    }

    /// The points of a body that are no further from the box around it than its horizon, in m.
    pub fn points_nearby(&self, body: &Body, horizon: f64) -> Vec<usize> {
        let corners: Vec<Vec<f64>> = match self {
            Crack::Segment(ends) => ends.iter().map(|end| end.to_vec()).collect(),
            Crack::Polygon(all) => all.iter().map(|corner| corner.to_vec()).collect(),
        };
        let reach = horizon * (1.0 + 2.0 * HORIZON_TOLERANCE);
        let is_near = |point: &usize| {
            body.position(*point).iter().enumerate().all(|(axis, x)| {
                let along = || corners.iter().filter_map(|corner| corner.get(axis));
                along().any(|corner| *corner >= x - reach)
                    && along().any(|corner| *corner <= x + reach)
            })
        };
        (0..body.n_points()).filter(is_near).collect()
    }

    /// The bonds of a body that it cuts. A crack of another dimension, or without an extent, cuts none.
    pub fn cut(&self, body: &Body, neighborhood: &Neighborhood) -> Cut {
        let near = TOUCHING * neighborhood.horizon();
        match self {
            Crack::Segment([p, q]) if body.dimension() == 2 => {
                let ends: &[[f64; 2]] = body.positions().as_chunks::<2>().0;
                cut(neighborhood, |i, j| segments([ends[i], ends[j]], [*p, *q], near))
            }
            Crack::Polygon(corners) if body.dimension() == 3 => {
                let Some(plane) = Plane::of(corners) else { return Cut::default() };
                let ends: &[[f64; 3]] = body.positions().as_chunks::<3>().0;
                cut(neighborhood, |i, j| plane.meets([ends[i], ends[j]], near))
            }
            _ => Cut::default(),
        }
    }
}

fn cut(neighborhood: &Neighborhood, meets: impl Fn(usize, usize) -> Meeting) -> Cut {
    let mut cut = Cut::default();
    for owner in 0..neighborhood.n_points() {
        for (bond, other) in neighborhood.bonds(owner).zip(neighborhood.upper(owner)) {
            match meets(owner, other as usize) {
                Meeting::Apart => {}
                Meeting::Crossing => cut.bonds.push(bond),
                Meeting::Front => cut.through_front += 1,
                Meeting::Touching => cut.touching += 1,
            }
        }
    }
    cut
}

/// The bonds between a point of one set and a point of the other, ascending: an interface that never held. Sets
/// have an entry per point; of a point that is in both, all bonds with points of either.
pub fn between(neighborhood: &Neighborhood, sets: [&[bool]; 2]) -> Vec<usize> {
    let mut bonds = Vec::new();
    for owner in 0..neighborhood.n_points() {
        for (bond, other) in neighborhood.bonds(owner).zip(neighborhood.upper(owner)) {
            let meets = |one: usize, two: usize| sets[0][one] && sets[1][two];
            if meets(owner, other as usize) || meets(other as usize, owner) {
                bonds.push(bond);
            }
        }
    }
    bonds
}

/// -1, 0 or 1: on which side something lies that is so far off.
fn side(distance: f64, near: f64) -> i8 {
    if distance.abs() <= near { 0 } else { distance.signum() as i8 }
}

/// The signed distance of a point from the line through two.
fn from_line([p, q]: [[f64; 2]; 2], x: [f64; 2]) -> f64 {
    let along: [f64; 2] = each(|axis| q[axis] - p[axis]);
    let to: [f64; 2] = each(|axis| x[axis] - p[axis]);
    (along[0] * to[1] - along[1] * to[0]) / dot(&along, &along).sqrt()
}

/// Whether boxes around two pairs of points are apart.
fn are_apart<const D: usize>(one: &[[f64; D]], other: &[[f64; D]], near: f64) -> bool {
    (0..D).any(|axis| {
        let range = |of: &[[f64; D]]| {
            let along = || of.iter().map(|x| x[axis]);
            let least = along().fold(f64::INFINITY, f64::min);
            (least, along().fold(f64::NEG_INFINITY, f64::max))
        };
        let (one, other) = (range(one), range(other));
        one.1 < other.0 - near || other.1 < one.0 - near
    })
}

fn segments(bond: [[f64; 2]; 2], crack: [[f64; 2]; 2], near: f64) -> Meeting {
    if are_apart(&bond, &crack, near) {
        return Meeting::Apart;
    }
    let ends = bond.map(|end| side(from_line(crack, end), near));
    let front = crack.map(|tip| side(from_line(bond, tip), near));
    match (ends[0] * ends[1], front[0] * front[1]) {
        (-1, -1) => Meeting::Crossing,
        (-1, 0) => Meeting::Front,
        (1, _) | (_, 1) => Meeting::Apart,
        _ => Meeting::Touching,
    }
}

/// The plane of a polygon, and that in its own two axes.
struct Plane {
    origin: [f64; 3],
    normal: [f64; 3],
    axes: [[f64; 3]; 2],
    corners: Vec<[f64; 2]>,
}

fn minus(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    each(|axis| p[axis] - q[axis])
}

fn cross(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    each(|k| p[(k + 1) % 3] * q[(k + 2) % 3] - p[(k + 2) % 3] * q[(k + 1) % 3])
}

fn unit(x: &[f64; 3]) -> [f64; 3] {
    let length = dot(x, x).sqrt();
    each(|axis| x[axis] / length)
}

impl Plane {
    /// Nothing of corners on a line.
    fn of(corners: &[[f64; 3]]) -> Option<Plane> {
        let origin = *corners.first()?;
        let arms: Vec<[f64; 3]> = corners.iter().map(|corner| minus(corner, &origin)).collect();
        let longest =
            |one: &&[f64; 3], other: &&[f64; 3]| dot(one, one).total_cmp(&dot(other, other));
        // Twice the area, as a vector (Newell's sum).
        let mut area = [0.0; 3];
        for pair in arms.windows(2) {
            let part = cross(&pair[0], &pair[1]);
            (0..3).for_each(|axis| area[axis] += part[axis]);
        }
        let arm = arms.iter().max_by(longest)?;
        let (square, size) = (dot(&area, &area).sqrt(), dot(arm, arm));
        if square.is_nan() || square <= TOUCHING * size {
            return None;
        }
        let normal = unit(&area);
        let first = unit(arm);
        let second = unit(&cross(&normal, &first));
        let axes = [unit(&cross(&second, &normal)), second];
        let corners = arms.iter().map(|arm| axes.map(|axis| dot(&axis, arm))).collect();
        Some(Plane { origin, normal, axes, corners })
    }

    fn check(&self, corners: &[[f64; 3]]) -> Result<(), CrackError> {
        let size = self.corners.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
        for (corner, x) in corners.iter().enumerate() {
            let distance = dot(&self.normal, &minus(x, &self.origin));
            if distance.abs() > 1e-6 * size {
                return Err(CrackError::Bent { corner, distance });
            }
        }
        Ok(())
    }

    fn meets(&self, bond: [[f64; 3]; 2], near: f64) -> Meeting {
        let arms = bond.map(|end| minus(&end, &self.origin));
        let heights = arms.map(|arm| dot(&self.normal, &arm));
        let sides = heights.map(|height| side(height, near));
        if sides[0] * sides[1] == 1 {
            return Meeting::Apart;
        }
        let flat = arms.map(|arm| self.axes.map(|axis| dot(&axis, &arm)));
        if sides == [0, 0] {
            // In the plane: an end on the crack, or an edge across the bond.
            let edges = || self.edges();
            let is_on = flat.iter().any(|end| self.place(*end, near) != Meeting::Apart);
            let crosses = || edges().any(|edge| segments(flat, edge, near) != Meeting::Apart);
            return if is_on || crosses() { Meeting::Touching } else { Meeting::Apart };
        }
        let part = heights[0] / (heights[0] - heights[1]);
        let place = each(|axis| flat[0][axis] + part * (flat[1][axis] - flat[0][axis]));
        match self.place(place, near) {
            Meeting::Apart => Meeting::Apart,
            _ if sides.contains(&0) => Meeting::Touching,
            place => place,
        }
    }

    fn edges(&self) -> impl Iterator<Item = [[f64; 2]; 2]> {
        let n = self.corners.len();
        (0..n).map(move |k| [self.corners[k], self.corners[(k + 1) % n]])
    }

    /// Where a place in the plane lies: inside, on the front, or outside.
    fn place(&self, x: [f64; 2], near: f64) -> Meeting {
        let mut is_inside = false;
        for [p, q] in self.edges() {
            let along: [f64; 2] = each(|axis| q[axis] - p[axis]);
            let to: [f64; 2] = each(|axis| x[axis] - p[axis]);
            let part = (dot(&along, &to) / dot(&along, &along)).clamp(0.0, 1.0);
            let off: [f64; 2] = each(|axis| to[axis] - part * along[axis]);
            if dot(&off, &off).sqrt() <= near {
                return Meeting::Front;
            }
            // A ray to the right crosses the edge.
            if (p[1] > x[1]) != (q[1] > x[1]) {
                let at = p[0] + (x[1] - p[1]) / (q[1] - p[1]) * along[0];
                is_inside ^= x[0] < at;
            }
        }
        if is_inside { Meeting::Crossing } else { Meeting::Apart }
    }
}
