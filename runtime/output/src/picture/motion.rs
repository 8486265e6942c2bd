//! Where the points of a body are drawn, and from where they are seen.

use crate::Points;

/// Where points are and were; displacements magnified.
pub(super) struct Motion<'a> {
    pub(super) points: &'a Points,
    pub(super) displacement: &'a [f64],
    /// Displacements are drawn this many times as large as they are.
    pub(super) magnification: f64,
    /// What colours show; the magnitude of the displacement where there is nothing.
    pub(super) colours: Option<&'a [f64]>,
    /// Bit `s` of a point's number tells whether it is in set `s`.
    pub(super) sets: Vec<u32>,
}

impl Motion<'_> {
    pub(super) fn reference(&self, point: usize) -> [f64; 3] {
        in_space(self.points.position(point))
    }

    fn displacement(&self, point: usize) -> [f64; 3] {
        let d = self.points.dimension;
        in_space(&self.displacement[point * d..(point + 1) * d])
    }

    pub(super) fn current(&self, point: usize) -> [f64; 3] {
        let (x, u) = (self.reference(point), self.displacement(point));
        [0, 1, 2].map(|axis| x[axis] + self.magnification * u[axis])
    }

    /// Magnitude of the displacement in m, not magnified.
    pub(super) fn magnitude(&self, point: usize) -> f64 {
        let u = self.displacement(point);
        dot(u, u).sqrt()
    }

    /// The largest magnitude, in m.
    pub(super) fn largest(&self) -> f64 {
        self.finite_points().map(|point| self.magnitude(point)).fold(0.0, f64::max)
    }

    /// What its colour shows.
    pub(super) fn value(&self, point: usize) -> f64 {
        self.colours.map_or_else(|| self.magnitude(point), |values| values[point])
    }

    /// Whether all of its displacement is prescribed.
    pub(super) fn is_held(&self, point: usize) -> bool {
        self.points.held.get(point).is_some_and(|held| *held)
    }

    pub(super) fn sets_of(&self, point: usize) -> u32 {
        self.sets[point]
    }

    /// The least and the greatest of what colours show.
    pub(super) fn range(&self) -> [f64; 2] {
        self.finite_points().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], point| {
            let value = self.value(point);
            [low.min(value), high.max(value)]
        })
    }

    /// The points that can be drawn.
    pub(super) fn finite_points(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.points.n_points()).filter(|&point| {
            self.current(point).iter().all(|x| x.is_finite()) && self.value(point).is_finite()
        })
    }

    /// The box around all points at rest; that of those which can be drawn might change within a film.
    pub(super) fn reference_bounds(&self) -> ([f64; 3], [f64; 3]) {
        bounds((0..self.points.n_points()).map(|point| self.reference(point)))
    }
}

/// The direction from which the body is seen: an orthogonal projection.
pub(super) struct Camera {
    right: [f64; 3],
    up: [f64; 3],
    pub(super) towards: [f64; 3],
}

impl Camera {
    /// From above in two dimensions; in three from the front right, with z upwards.
    pub(super) fn new(dimension: usize) -> Camera {
        if dimension == 2 {
            let [right, up, towards] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            return Camera { right, up, towards };
        }
        let degree = std::f64::consts::PI / 180.0;
        let (azimuth, elevation) = (-58.0 * degree, 24.0 * degree);
        let (sa, ca) = (libm::sin(azimuth), libm::cos(azimuth));
        let (se, ce) = (libm::sin(elevation), libm::cos(elevation));
        Camera {
            right: [-sa, ca, 0.0],
            up: [-se * ca, -se * sa, ce],
            towards: [ce * ca, ce * sa, se],
        }
    }

    /// Place on the plane of projection, in m, y upwards.
    pub(super) fn flat(&self, p: [f64; 3]) -> [f64; 2] {
        [dot(p, self.right), dot(p, self.up)]
    }

    /// Larger is nearer to the viewer.
    pub(super) fn nearness(&self, p: [f64; 3]) -> f64 {
        dot(p, self.towards)
    }

    /// How bright a face with this outward normal is, in 0.7..1.
    pub(super) fn brightness(&self, normal: [f64; 3]) -> f64 {
        let light = [0, 1, 2]
            .map(|axis| 0.25 * self.right[axis] + 0.7 * self.up[axis] + 0.65 * self.towards[axis]);
        let length = (dot(normal, normal) * dot(light, light)).sqrt();
        0.7 + 0.3 * (dot(normal, light) / length).clamp(0.0, 1.0)
    }
}

pub(super) fn dot(p: [f64; 3], q: [f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

/// The least and the greatest coordinates; infinite if there are no points.
pub(super) fn bounds(points: impl Iterator<Item = [f64; 3]>) -> ([f64; 3], [f64; 3]) {
    let nothing = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    points.fold(nothing, |(low, high), p| {
        (
            [0, 1, 2].map(|axis| low[axis].min(p[axis])),
            [0, 1, 2].map(|axis| high[axis].max(p[axis])),
        )
    })
}

fn in_space(numbers: &[f64]) -> [f64; 3] {
    let mut out = [0.0; 3];
    out[..numbers.len()].copy_from_slice(numbers);
    out
}
