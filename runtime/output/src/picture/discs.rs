//! A point cloud as discs (two dimensions) or balls (three) of the points' volumes.

use std::collections::HashMap;

use super::charts::spread;
use super::motion::{Camera, Motion};

/// The discs to draw.
pub(super) struct Discs {
    pub(super) discs: Vec<Disc>,
    /// Every how many-th point is drawn, of those that can be seen.
    pub(super) every: usize,
}

/// One point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Disc {
    /// Current position in m.
    pub(super) at: [f64; 3],
    /// In m.
    pub(super) radius: f64,
    /// What its colour shows.
    pub(super) value: f64,
    /// Bit `s` tells whether the point is in set `s`.
    pub(super) sets: u32,
}

impl Discs {
    /// The points that the camera sees, at most `most` of them.
    pub(super) fn new(motion: &Motion, camera: &Camera, most: usize) -> Discs {
        let disc = |point: usize| Disc {
            at: motion.current(point),
            radius: radius(motion.points.volumes[point], motion.points.dimension),
            value: motion.value(point),
            sets: motion.sets_of(point),
        };
        let mut discs: Vec<Disc> = motion.finite_points().map(disc).collect();
        if motion.points.dimension == 3 {
            discs = visible(discs, camera);
        }
        let every = discs.len().div_ceil(most).max(1);
        if every > 1 {
            // Fewer points, each as large as those it stands for.
            let root = if motion.points.dimension == 2 { 0.5 } else { 1.0 / 3.0 };
            let growth = libm::pow(every as f64, root);
            let kept = spread(discs.len(), most).into_iter().map(|place| discs[place]);
            discs = kept.map(|disc| Disc { radius: disc.radius * growth, ..disc }).collect();
        }
        Discs { discs, every }
    }
}

/// Radius of the ball of this volume; of a disc somewhat larger than its area, so that fewer gaps
/// show between the points of a grid.
fn radius(volume: f64, dimension: usize) -> f64 {
    let pi = std::f64::consts::PI;
    if dimension == 2 { 1.12 * (volume / pi).sqrt() } else { libm::cbrt(0.75 * volume / pi) }
}

/// Leaves out points that lie more than a few radii behind the foremost one in their direction.
fn visible(discs: Vec<Disc>, camera: &Camera) -> Vec<Disc> {
    let mut radii: Vec<f64> = discs.iter().map(|disc| disc.radius).collect();
    radii.sort_by(f64::total_cmp);
    let Some(&typical) = radii.get(radii.len() / 2) else { return discs };
    let cell = |disc: &Disc| {
        let [x, y] = camera.flat(disc.at);
        ((x / typical / 2.0).floor() as i64, (y / typical / 2.0).floor() as i64)
    };
    let mut foremost: HashMap<(i64, i64), f64> = HashMap::new();
    for disc in &discs {
        let depth = foremost.entry(cell(disc)).or_insert(f64::NEG_INFINITY);
        *depth = depth.max(camera.nearness(disc.at));
    }
    let seen = |disc: &Disc| camera.nearness(disc.at) >= foremost[&cell(disc)] - 5.0 * typical;
    discs.into_iter().filter(seen).collect()
}
