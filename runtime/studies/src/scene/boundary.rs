//! What is done to a body: prescribed displacements and loads as functions of t.
//!
//! Degrees of freedom are numbered `d * point + component` in the body's order.

use piola_grammar::Diagnostic;
use piola_mechanics::body::Body;

use super::selection::{PointSet, Selection, coordinates};
use super::{AXES, Load, LoadKind, Prescription, Quantity, Scene, SceneReport};

/// The prescribed displacements and the loads of a scene on its body.
///
/// No component is prescribed twice.
#[derive(Clone, Debug)]
pub struct BoundaryConditions<'a> {
    scene: &'a Scene,
    body: &'a Body,
    selection: &'a Selection,
    fixed_dofs: Vec<usize>,
    /// For each fixed degree of freedom, its entry of [`Scene::prescriptions`].
    entries: Vec<u32>,
    /// Loads that change reactions only; spans as in [`Scene::report`].
    pub warnings: Vec<Diagnostic>,
}

/// A displacement or load of a scene that is not a finite number.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the {quantity} along {} of `{set}` is {value} at point {point} {} and t = {t}: {expression}",
    AXES[*.axis], coordinates(.position)
)]
pub struct NonFiniteCondition {
    /// `displacement`, `velocity`, `force`, `density` or `acceleration`; the first two also `initial`.
    pub quantity: &'static str,
    /// 0, 1, 2 for X, Y, Z.
    pub axis: usize,
    /// The set's name.
    pub set: String,
    /// The point in the user's order.
    pub point: usize,
    /// Its reference position in m.
    pub position: Vec<f64>,
    /// The time.
    pub t: f64,
    /// What the scene says.
    pub expression: String,
    /// What came out.
    pub value: f64,
}

/// Marks a degree of freedom that no entry prescribes.
const FREE: u32 = u32::MAX;

impl<'a> BoundaryConditions<'a> {
    /// Brings the entries of a scene together; components that two entries prescribe are errors.
    pub fn new(
        scene: &'a Scene,
        body: &'a Body,
        selection: &'a Selection,
    ) -> Result<BoundaryConditions<'a>, SceneReport> {
        let (owners, errors) = prescribe(scene, body, selection);
        if !errors.is_empty() {
            return Err(scene.report(errors));
        }
        let fixed_dofs: Vec<usize> = (0..owners.len()).filter(|&dof| owners[dof] != FREE).collect();
        let entries = fixed_dofs.iter().map(|&dof| owners[dof]).collect();
        let warnings = idle_loads(scene, body, selection, &owners);
        Ok(BoundaryConditions { scene, body, selection, fixed_dofs, entries, warnings })
    }

    /// The degrees of freedom whose displacement is prescribed, ascending.
    pub fn fixed_dofs(&self) -> &[usize] {
        &self.fixed_dofs
    }

    /// The scene.
    pub(super) fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// The body.
    pub(super) fn body(&self) -> &'a Body {
        self.body
    }

    /// A set of points, by its number in the scene.
    pub(super) fn set(&self, number: usize) -> &'a PointSet {
        &self.selection.sets[number]
    }

    /// The fixed degrees of freedom, ascending, with what prescribes them.
    pub(super) fn prescribed_entries(&self) -> impl Iterator<Item = (usize, &'a Prescription)> {
        let entry = |entry: &u32| &self.scene.prescriptions[*entry as usize];
        self.fixed_dofs.iter().copied().zip(self.entries.iter().map(entry))
    }

    /// The prescribed displacements at `t` in m, one per entry of [`Self::fixed_dofs`].
    pub fn prescribed(&self, t: f64) -> Result<Vec<f64>, NonFiniteCondition> {
        let dimension = self.body.dimension();
        let value = |(&dof, &entry): (&usize, &u32)| {
            let prescription = &self.scene.prescriptions[entry as usize];
            let (point, axis) = (dof / dimension, dof % dimension);
            match &prescription.components[axis].value {
                Some(quantity) => {
                    self.evaluate(quantity, "displacement", prescription.set.value, point, axis, t)
                }
                // Only prescribed components own a degree of freedom.
                None => Ok(0.0),
            }
        };
        self.fixed_dofs.iter().zip(&self.entries).map(value).collect()
    }

    /// The forces at `t` in N, `n x d` row by row.
    ///
    /// A `force` is shared over its set by volume, `f_p = F(X_p, t) V_p / sum V`; a `density` acts on
    /// each point's volume, `f_p = b(X_p, t) V_p`.
    pub fn loads(&self, t: f64) -> Result<Vec<f64>, NonFiniteCondition> {
        let dimension = self.body.dimension();
        let mut forces = vec![0.0; self.body.n_points() * dimension];
        for load in &self.scene.loads {
            let set = &self.selection.sets[load.set.value];
            for &point in &set.points {
                let share = match load.kind {
                    LoadKind::Force => self.body.volumes()[point] / set.volume,
                    LoadKind::Density => self.body.volumes()[point],
                    // The reader allows it to bodies that move alone.
                    LoadKind::Acceleration => f64::NAN,
                };
                for (axis, component) in load.components.iter().enumerate() {
                    let (quantity, kind) = (&component.value, load.kind.key());
                    let value = self.evaluate(quantity, kind, load.set.value, point, axis, t)?;
                    forces[point * dimension + axis] += share * value;
                }
            }
        }
        Ok(forces)
    }

    pub(super) fn evaluate(
        &self,
        quantity: &Quantity,
        what: &'static str,
        set: usize,
        point: usize,
        axis: usize,
        t: f64,
    ) -> Result<f64, NonFiniteCondition> {
        let position = self.body.position(point);
        let value = quantity.value(position, t);
        if value.is_finite() {
            return Ok(value);
        }
        Err(NonFiniteCondition {
            quantity: what,
            axis,
            set: self.selection.sets[set].name.clone(),
            point: self.body.user_index()[point] as usize,
            position: position.to_vec(),
            t,
            expression: match quantity {
                Quantity::Number(number) => number.to_string(),
                Quantity::Expression(expression) => expression.text.clone(),
            },
            value,
        })
    }
}

/// Which entry prescribes each degree of freedom, and every overlap of two entries.
fn prescribe(scene: &Scene, body: &Body, selection: &Selection) -> (Vec<u32>, Vec<Diagnostic>) {
    let dimension = body.dimension();
    let mut owners = vec![FREE; body.n_points() * dimension];
    let mut errors = Vec::new();
    for (index, entry) in scene.prescriptions.iter().enumerate() {
        for (axis, component) in entry.components.iter().enumerate() {
            if component.value.is_none() {
                continue;
            }
            // For each earlier entry: how many points overlap, and the first of them.
            let mut overlaps: Vec<(u32, usize, usize)> = Vec::new();
            for &point in &selection.sets[entry.set.value].points {
                let owner = &mut owners[point * dimension + axis];
                if *owner == FREE {
                    *owner = index as u32;
                } else if let Some(found) = overlaps.iter_mut().find(|o| o.0 == *owner) {
                    found.1 += 1;
                } else {
                    overlaps.push((*owner, 1, point));
                }
            }
            errors.extend(overlaps.iter().map(|&(earlier, count, point)| {
                let earlier = &scene.prescriptions[earlier as usize];
                let place = coordinates(body.position(point));
                prescribed_twice(scene, earlier, entry, axis, count, &place)
            }));
        }
    }
    (owners, errors)
}

fn prescribed_twice(
    scene: &Scene,
    earlier: &Prescription,
    later: &Prescription,
    axis: usize,
    count: usize,
    place: &str,
) -> Diagnostic {
    let name = |entry: &Prescription| scene.sets[entry.set.value].name.value.clone();
    let (first, second) = (name(earlier), name(later));
    let points = if count == 1 { "1 point".into() } else { format!("{count} points") };
    let axis_name = AXES[axis];
    let message = format!(
        "the {axis_name} component of {points} is prescribed twice, by `{first}` and by `{second}`"
    );
    Diagnostic::error("prescribed-twice", later.components[axis].span, message)
        .label(format!("for `{second}`, which shares the point {place}"))
        .note(earlier.components[axis].span, format!("for `{first}`"))
        .help("write \"free\" for one of them, or make the sets disjoint")
}

/// Warns of loads on prescribed components.
fn idle_loads(
    scene: &Scene,
    body: &Body,
    selection: &Selection,
    owners: &[u32],
) -> Vec<Diagnostic> {
    let dimension = body.dimension();
    let warning = |load: &Load, axis: usize| {
        let component = &load.components[axis];
        let set = &selection.sets[load.set.value];
        let fixed = |point: &&usize| owners[**point * dimension + axis] != FREE;
        let mut on_fixed = set.points.iter().filter(fixed);
        let first = *on_fixed.next().filter(|_| !component.value.is_zero())?;
        let points = match 1 + on_fixed.count() {
            1 => "1 point".into(),
            count if count == set.points.len() && body.is_whole() => "all points".into(),
            count => format!("{count} points"),
        };
        let axis = AXES[axis];
        let message = format!(
            "the load along {axis} acts on {points} of `{}` whose {axis} component is prescribed",
            set.name
        );
        let place = coordinates(body.position(first));
        Some(
            Diagnostic::warning("load-on-prescribed", component.span, message)
                .label(format!("at {place} it changes the reaction and nothing else")),
        )
    };
    let axes = |load: &'_ Load| 0..load.components.len();
    scene
        .loads
        .iter()
        .flat_map(|load| axes(load).filter_map(move |axis| warning(load, axis)))
        .collect()
}
