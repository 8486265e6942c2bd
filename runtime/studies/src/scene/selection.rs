//! Which points a scene means: what is removed, the point sets, the probes.
//!
//! Before: a checked [`Scene`] and points. After: every set has points, every probe sits at one;
//! boundaries that run so close to points that rounding decides are warned of.

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::body::Body;
use piola_mechanics::materials::{self, Materials};
use rayon::prelude::*;

use super::sets::holds;
use super::{
    AXES, Expression, Interface, InterfaceRule, Members, Probe, Region, Scene, SceneReport,
};

/// A point this many spacings from the boundary of a condition is on one side of it by chance.
const BOUNDARY_MARGIN: f64 = 1e-6;

/// A named set of points.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSet {
    /// Its name.
    pub name: String,
    /// Its points in the body's order, ascending; at least one.
    pub points: Vec<usize>,
    /// Sum of the points' volumes, in m^d.
    pub volume: f64,
}

/// A probe at its point.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbePoint {
    /// The probe's name.
    pub name: String,
    /// The nearest point, in the body's order.
    pub point: usize,
    /// How far the point is from the place that the scene names, in m.
    pub distance: f64,
}

/// The points that a scene means.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// In the order of [`Scene::sets`].
    pub sets: Vec<PointSet>,
    /// In the order of [`Scene::probes`].
    pub probes: Vec<ProbePoint>,
    /// Boundaries too close to points; spans as in [`Scene::report`].
    pub warnings: Vec<Diagnostic>,
}

impl PointSet {
    /// The sum over its points of a force per point (`n x d`, in N).
    pub fn sum(&self, forces: &[f64], d: usize) -> Vec<f64> {
        let along = |axis: usize| self.points.iter().fold(0.0, |sum, p| sum + forces[d * p + axis]);
        (0..d).map(along).collect()
    }
}

impl Selection {
    /// Of each set the sum of a force per point (`n x d`, in N).
    pub fn reactions(&self, residual: &[f64], d: usize) -> Vec<Vec<f64>> {
        self.sets.iter().map(|set| set.sum(residual, d)).collect()
    }

    /// Of each set the mean displacement by the points' volumes, of displacements `n x d` in m.
    pub fn means(&self, u: &[f64], volumes: &[f64], d: usize) -> Vec<Vec<f64>> {
        let along = |set: &PointSet, axis: usize| {
            set.points.iter().fold(0.0, |sum, p| sum + volumes[*p] * u[d * p + axis]) / set.volume
        };
        self.sets.iter().map(|set| (0..d).map(|axis| along(set, axis)).collect()).collect()
    }

    /// Of each probe the displacement of its point, of displacements `n x d` in m.
    pub fn displacements(&self, u: &[f64], d: usize) -> Vec<Vec<f64>> {
        let own = |probe: &ProbePoint| u[d * probe.point..d * (probe.point + 1)].to_vec();
        self.probes.iter().map(own).collect()
    }
}

/// Which points of a body remain.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// One entry per point.
    pub keep: Vec<bool>,
    /// Boundaries too close to points, conditions without effect; spans as in [`Scene::report`].
    pub warnings: Vec<Diagnostic>,
}

/// Evaluates `remove` at points that are not yet a [`Body`]: `positions` is `n x d` in m, `volumes`
/// has `n` entries in m^d, `spacing` is that of a lattice.
pub fn kept(
    scene: &Scene,
    positions: &[f64],
    volumes: &[f64],
    spacing: Option<f64>,
) -> Result<Kept, SceneReport> {
    kept_of(scene, (positions, positions), volumes, spacing)
}

/// The same of some points of a body; the others of `all` are at its ends.
pub(crate) fn kept_of(
    scene: &Scene,
    (positions, all): (&[f64], &[f64]),
    volumes: &[f64],
    spacing: Option<f64>,
) -> Result<Kept, SceneReport> {
    let dimension = scene.body.dimension;
    let spacing = typical_spacing(dimension, volumes, spacing);
    let mut keep = vec![true; volumes.len()];
    let mut warnings = Vec::new();
    for condition in &scene.body.remove {
        let removed = holds(condition, positions, dimension);
        for (keep, removed) in keep.iter_mut().zip(&removed) {
            *keep &= !removed;
        }
        if !removed.contains(&true) {
            let message = "this condition removes no point";
            warnings.push(
                Diagnostic::warning("idle-entry", condition.span, message)
                    .help(ranges(all, dimension)),
            );
        }
        let place = "of what is removed";
        warnings
            .extend(boundary_warning(condition, place, positions, dimension, spacing, &removed));
    }
    if keep.contains(&true) {
        return Ok(Kept { keep, warnings });
    }
    Err(nothing_left(scene, all))
}

/// Every point is removed; `positions` are of all, or of those farthest apart.
pub(crate) fn nothing_left(scene: &Scene, positions: &[f64]) -> SceneReport {
    let span = scene.body.remove.first().map_or(Span::default(), |condition| condition.span);
    let error = Diagnostic::error("nothing-left", span, "every point of the body is removed")
        .help(ranges(positions, scene.body.dimension));
    scene.report(vec![error])
}

/// Finds the points of every set and probe.
pub fn select(scene: &Scene, body: &Body) -> Result<Selection, SceneReport> {
    let (mut errors, mut warnings) = (Vec::new(), Vec::new());
    let mut sets = Vec::new();
    for number in 0..scene.sets.len() {
        let (set, warning) = set_of(scene, body, number);
        if set.points.is_empty() {
            errors.push(empty_set(scene, number, body.positions()));
        }
        warnings.extend(warning);
        sets.push(set);
    }
    let mut probes = Vec::new();
    for probe in &scene.probes {
        let (point, distance) = nearest(body, &probe.at.value);
        errors.extend(probe_outside(scene, probe, (body.position(point), distance)));
        probes.push(ProbePoint { name: probe.name.value.clone(), point, distance });
    }
    if errors.is_empty() {
        return Ok(Selection { sets, probes, warnings });
    }
    errors.extend(warnings);
    Err(scene.report(errors))
}

/// The points of a set by its number, which may be none, and where its boundary is too close to points.
pub(crate) fn set_of(scene: &Scene, body: &Body, number: usize) -> (PointSet, Option<Diagnostic>) {
    let (dimension, positions) = (body.dimension(), body.positions());
    let spacing = typical_spacing(dimension, body.volumes(), body.spacing());
    let set = &scene.sets[number];
    let name = &set.name.value;
    let inside = set.members.of(body);
    let points: Vec<usize> = (0..body.n_points()).filter(|&point| inside[point]).collect();
    let near = match &set.members {
        Members::Where(condition) => {
            let place = format!("of the set `{name}`");
            boundary_warning(condition, &place, positions, dimension, spacing, &inside)
        }
        Members::Listed { .. } => None,
    };
    let volume = points.iter().map(|&point| body.volumes()[point]).sum();
    (PointSet { name: name.clone(), points, volume }, near)
}

/// A set without points, by its number, in a body with points at these places.
pub(crate) fn empty_set(scene: &Scene, number: usize, positions: &[f64]) -> Diagnostic {
    let set = &scene.sets[number];
    let message = format!("the set `{}` has no points", set.name.value);
    Diagnostic::error("empty-set", set.members.span(), message)
        .label("this holds nowhere in the body")
        .help(ranges(positions, scene.body.dimension))
}

/// A probe that is further from the nearest point of the body than points are from each other; with that point's
/// place and how far it is, in m.
pub(crate) fn probe_outside(
    scene: &Scene,
    probe: &Probe,
    (place, distance): (&[f64], f64),
) -> Option<Diagnostic> {
    let reach = scene.body.points.spacing().unwrap_or(scene.horizon_radius());
    if distance <= reach * (1.0 + BOUNDARY_MARGIN) {
        return None;
    }
    let message = format!("the probe `{}` is outside the body", probe.name.value);
    let place = coordinates(place);
    let found = Diagnostic::error("probe-outside", probe.at.span, message);
    Some(found.help(format!("the nearest point is {place}, {} m away", readable(distance))))
}

/// Which points are in some of the sets of a scene; `sets` are indices into [`Scene::sets`].
pub fn in_sets(scene: &Scene, body: &Body, sets: &[usize]) -> Vec<bool> {
    let mut all = vec![false; body.n_points()];
    for set in sets {
        let inside = scene.sets[*set].members.of(body);
        all.iter_mut().zip(inside).for_each(|(all, inside)| *all |= inside);
    }
    all
}

/// Of which points the scene says that their bonds never break.
pub fn unbreakable(scene: &Scene, body: &Body) -> Vec<bool> {
    let sets: Vec<usize> = scene.fracture.unbreakable.iter().map(|set| set.value).collect();
    in_sets(scene, body, &sets)
}

/// The materials of the points of a body; nothing of a scene with one material.
pub fn materials(scene: &Scene, body: &Body) -> Result<Option<Materials>, SceneReport> {
    materials_of(scene, body, &|is_left| is_left)
}

/// The same of a slab of a body, where `anywhere` says whether what is asked is so in any slab.
pub(crate) fn materials_of(
    scene: &Scene,
    body: &Body,
    anywhere: &dyn Fn(bool) -> bool,
) -> Result<Option<Materials>, SceneReport> {
    if scene.regions.is_empty() {
        return Ok(None);
    }
    let mut of_point: Vec<Option<u8>> = vec![None; body.n_points()];
    let mut errors = Vec::new();
    let of_set = |region: &Region| Some(scene.sets[region.set?.value].members.of(body));
    for (number, region) in scene.regions.iter().enumerate() {
        let Some(inside) = of_set(region) else { continue };
        let name = &region.name.value;
        let twice = (0..of_point.len()).find(|point| inside[*point] && of_point[*point].is_some());
        if let Some((point, other)) = twice.and_then(|point| Some((point, of_point[point]?))) {
            let other = &scene.regions[usize::from(other)].name;
            let place = coordinates(body.position(point));
            let message = format!("the point at {place} is of `{}` and of `{name}`", other.value);
            let help =
                "a point is of one material: let one of the sets leave out what the other has";
            let found = Diagnostic::error("two-materials", region.name.span, message).help(help);
            errors.push(found.note(other.span, "the other stands here"));
        }
        let inside = of_point.iter_mut().zip(inside).filter(|(_, inside)| *inside);
        inside.for_each(|(material, _)| *material = Some(number as u8));
    }
    let rest = scene.regions.iter().position(|region| region.set.is_none());
    let left = of_point.iter().position(Option::is_none);
    let is_left = anywhere(left.is_some());
    match (rest, left) {
        (Some(rest), _) if is_left => {
            of_point.iter_mut().for_each(|of| *of = of.or(Some(rest as u8)));
        }
        (Some(rest), _) => {
            let message =
                "no point is left for this material: the sets of the others have them all";
            errors.push(Diagnostic::error("empty-set", scene.regions[rest].name.span, message));
        }
        (None, Some(point)) => {
            let count = of_point.iter().filter(|of| of.is_none()).count();
            let place = coordinates(body.position(point));
            let message =
                format!("{count} points are of no material, the one at {place} among them");
            let help = "write a [[material]] without a `set`: it has all points that no other has";
            let span = scene.regions[0].name.span;
            errors.push(Diagnostic::error("no-material", span, message).help(help));
        }
        (None, None) => {}
    }
    if !errors.is_empty() {
        return Err(scene.report(errors));
    }
    let interface = |interface: &Interface| {
        let between = interface.between.map(|material| material.value as u8);
        match interface.rule {
            InterfaceRule::Mean => None,
            InterfaceRule::As(material) => {
                let as_material = material as u8;
                let counts = if between[0] == as_material { between[1] } else { between[0] };
                Some(materials::Interface::As { counts, as_material })
            }
            InterfaceRule::Potential(law) => {
                Some(materials::Interface::Law { between, law: law as u8 })
            }
        }
    };
    let interfaces = scene.interfaces.iter().filter_map(interface).collect();
    let of_point = of_point.into_iter().map(|of| of.unwrap_or_default()).collect();
    Ok(Some(Materials::new(of_point, interfaces).with_laws(scene.n_laws())))
}

/// Warns if a step of [`BOUNDARY_MARGIN`] spacings changes where a point belongs.
fn boundary_warning(
    condition: &Expression,
    place: &str,
    positions: &[f64],
    dimension: usize,
    spacing: f64,
    inside: &[bool],
) -> Option<Diagnostic> {
    let steps = steps(dimension);
    let crossing = |(position, inside): (&[f64], &bool)| -> Option<[f64; 3]> {
        let crosses = |step: &&[f64; 3]| {
            let mut moved = [0.0; 3];
            for axis in 0..dimension {
                let x = position[axis];
                // Far from the origin a step must at least survive the rounding of coordinates.
                let length = (BOUNDARY_MARGIN * spacing).max(4.0 * f64::EPSILON * x.abs());
                moved[axis] = x + step[axis] * length;
            }
            condition.holds(&moved[..dimension]) != *inside
        };
        steps.iter().find(crosses).copied()
    };
    let crossings: Vec<Option<[f64; 3]>> =
        positions.par_chunks_exact(dimension).zip(inside).map(crossing).collect();
    let count = crossings.iter().flatten().count();
    let (point, step) =
        crossings.iter().enumerate().find_map(|(point, step)| step.map(|step| (point, step)))?;
    let example = coordinates(&positions[point * dimension..(point + 1) * dimension]);
    let points = if count == 1 { "a point" } else { "points" };
    let message = format!("the boundary {place} runs through {points}: rounding decides");
    let half = readable(spacing / 2.0);
    let n = if count == 1 { "1 point is".into() } else { format!("{count} points are") };
    let along = match step.iter().filter(|component| **component != 0.0).count() {
        1 => step.iter().position(|component| *component != 0.0).map_or("", |axis| AXES[axis]),
        _ => "every axis",
    };
    Some(
        Diagnostic::warning("boundary-on-points", condition.span, message)
            .label(format!("{n} within 1e-6 spacings of it, for example {example}"))
            .help(format!("move the limit along {along} by half a spacing, {half}")),
    )
}

/// Steps along the axes, then along the diagonals: only these cross a boundary at its corners.
fn steps(dimension: usize) -> Vec<[f64; 3]> {
    let mut steps = Vec::new();
    for axis in 0..dimension {
        for sign in [-1.0, 1.0] {
            let mut step = [0.0; 3];
            step[axis] = sign;
            steps.push(step);
        }
    }
    for corner in 0..1_u32 << dimension {
        let mut step = [0.0; 3];
        for (axis, component) in step[..dimension].iter_mut().enumerate() {
            *component = if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        }
        steps.push(step);
    }
    steps
}

/// The lattice spacing, or the edge of a point's mean volume.
pub(crate) fn typical_spacing(dimension: usize, volumes: &[f64], spacing: Option<f64>) -> f64 {
    spacing.unwrap_or_else(|| {
        edge_of(dimension, volumes.iter().sum::<f64>() / volumes.len().max(1) as f64)
    })
}

/// The edge of a square or a cube of a volume.
pub(crate) fn edge_of(dimension: usize, volume: f64) -> f64 {
    if dimension == 2 { volume.sqrt() } else { libm::cbrt(volume) }
}

/// The point next to a place; of several the one that the user listed first.
pub(crate) fn nearest(body: &Body, place: &[f64]) -> (usize, f64) {
    let squared = |point: usize| -> f64 {
        body.position(point).iter().zip(place).map(|(x, y)| (x - y) * (x - y)).sum()
    };
    let rank = |point: &usize| (squared(*point), body.user_index()[*point]);
    let order = |a: &usize, b: &usize| {
        let ((a, a_user), (b, b_user)) = (rank(a), rank(b));
        a.total_cmp(&b).then(a_user.cmp(&b_user))
    };
    let point = (0..body.n_points()).min_by(order).unwrap_or(0);
    (point, squared(point).sqrt())
}

/// In words, where the points are.
fn ranges(positions: &[f64], dimension: usize) -> String {
    let range = |axis: usize| {
        let column = || positions.iter().skip(axis).step_by(dimension).copied();
        let least = column().fold(f64::INFINITY, f64::min);
        let most = column().fold(f64::NEG_INFINITY, f64::max);
        format!("{} from {} to {}", AXES[axis], readable(least), readable(most))
    };
    let ranges: Vec<String> = (0..dimension).map(range).collect();
    format!("the points have {}", ranges.join(", "))
}

/// `(0.1, 0.25)`
pub(crate) fn coordinates(position: &[f64]) -> String {
    let numbers: Vec<String> = position.iter().map(|x| readable(*x).to_string()).collect();
    format!("({})", numbers.join(", "))
}

/// A number without the noise of its last digits.
fn readable(x: f64) -> f64 {
    format!("{x:.8e}").parse().unwrap_or(x)
}
