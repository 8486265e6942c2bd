//! What drives a body in motion: the conditions of a scene, split by what they depend on.
//!
//! Conditions are asked for at every time step. So numbers, and expressions without `t`, are worked
//! out once; expressions of `t` alone once a step; only expressions of both once a step and point, by
//! machine code.

use std::sync::{Mutex, PoisonError};

use piola_compiler::CompiledFormula;
use piola_mechanics::body::Body;
use piola_solvers::motion::{Initial, MotionDrive};

use super::boundary::{BoundaryConditions, NonFiniteCondition};
use super::motion::Given;
use super::{LoadKind, Quantity};

/// The conditions of a scene on its body as functions of time.
pub struct MotionConditions<'a> {
    boundary: &'a BoundaryConditions<'a>,
    displaced: Prescribed<'a>,
    driven: Prescribed<'a>,
    accelerated: Prescribed<'a>,
    loads: Terms<'a>,
    /// The first condition that is not finite: the solver only sees the number.
    problem: Mutex<Option<NonFiniteCondition>>,
}

/// Degrees of freedom, ascending, and what is prescribed for them.
struct Prescribed<'a> {
    dofs: Vec<usize>,
    values: Terms<'a>,
}

/// A vector as a function of `t`.
struct Terms<'a> {
    /// What does not depend on `t`; nothing where that is 0.
    constant: Vec<f64>,
    varying: Vec<Term<'a>>,
}

/// A component of an entry of the scene that depends on `t`.
struct Term<'a> {
    quantity: &'a Quantity,
    /// How messages call it, the set and the component.
    what: &'static str,
    set: usize,
    axis: usize,
    /// Entry of the vector, point in the body's order, and factor.
    places: Vec<(usize, usize, f64)>,
    /// Machine code for an expression that differs from point to point.
    compiled: Option<Compiled>,
}

/// An expression of place and time for all places of a term.
struct Compiled {
    code: CompiledFormula,
    /// X, Y and Z of the places; t, and what the expression gives.
    coordinates: [Vec<f64>; 3],
    room: Mutex<[Vec<f64>; 2]>,
}

/// For fewer places the interpreter is done before machine code is made.
const LEAST_COMPILED: usize = 32;

impl<'a> MotionConditions<'a> {
    /// Works out what does not depend on time; `masses` has one entry per point, in kg.
    ///
    /// # Errors
    /// A condition that is not finite.
    pub fn new(
        boundary: &'a BoundaryConditions<'a>,
        masses: &[f64],
    ) -> Result<MotionConditions<'a>, NonFiniteCondition> {
        Ok(MotionConditions {
            displaced: Prescribed::new(boundary, Given::Displacement)?,
            driven: Prescribed::new(boundary, Given::Velocity)?,
            accelerated: Prescribed::new(boundary, Given::Acceleration)?,
            loads: loads(boundary, masses)?,
            boundary,
            problem: Mutex::new(None),
        })
    }

    /// The condition that was not finite when the solver asked for it.
    pub fn problem(&self) -> Option<NonFiniteCondition> {
        self.problem.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn fill(&self, terms: &Terms<'_>, t: f64, values: &mut [f64]) {
        if let Err(problem) = terms.at(self.boundary, t, values) {
            values.fill(f64::NAN);
            *self.problem.lock().unwrap_or_else(PoisonError::into_inner) = Some(problem);
        }
    }
}

impl MotionDrive for MotionConditions<'_> {
    fn displaced(&self) -> &[usize] {
        &self.displaced.dofs
    }

    fn displacements(&self, t: f64, values: &mut [f64]) {
        self.fill(&self.displaced.values, t, values);
    }

    fn driven(&self) -> &[usize] {
        &self.driven.dofs
    }

    fn velocities(&self, t: f64, values: &mut [f64]) {
        self.fill(&self.driven.values, t, values);
    }

    fn accelerated(&self) -> &[usize] {
        &self.accelerated.dofs
    }

    fn accelerations(&self, t: f64, values: &mut [f64]) {
        self.fill(&self.accelerated.values, t, values);
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        self.fill(&self.loads, t, loads);
    }

    fn loads_change(&self) -> bool {
        !self.loads.varying.is_empty()
    }
}

impl<'a> Prescribed<'a> {
    fn new(
        boundary: &'a BoundaryConditions<'a>,
        given: Given,
    ) -> Result<Prescribed<'a>, NonFiniteCondition> {
        let entries = boundary.prescribed_entries().filter(|(_, entry)| entry.given == given);
        let dofs: Vec<usize> = entries.map(|(dof, _)| dof).collect();
        let d = boundary.body().dimension();
        let mut terms: Vec<Term<'a>> = Vec::new();
        for entry in boundary.scene().prescriptions.iter().filter(|entry| entry.given == given) {
            for (axis, component) in entry.components.iter().enumerate() {
                let Some(quantity) = &component.value else { continue };
                let points = &boundary.set(entry.set.value).points;
                let place = |point: &usize| {
                    let place = dofs.binary_search(&(point * d + axis)).ok()?;
                    Some((place, *point, 1.0))
                };
                terms.push(Term {
                    quantity,
                    what: match given {
                        Given::Displacement => "displacement",
                        Given::Velocity => "velocity",
                        Given::Acceleration => "acceleration",
                    },
                    set: entry.set.value,
                    axis,
                    places: points.iter().filter_map(place).collect(),
                    compiled: None,
                });
            }
        }
        Ok(Prescribed { values: Terms::new(boundary, dofs.len(), terms)?, dofs })
    }
}

/// The loads: a `force` is shared by volume, a `density` acts on each point's volume, an
/// `acceleration` on its mass.
fn loads<'a>(
    boundary: &'a BoundaryConditions<'a>,
    masses: &[f64],
) -> Result<Terms<'a>, NonFiniteCondition> {
    let (body, d) = (boundary.body(), boundary.body().dimension());
    let mut terms = Vec::new();
    for load in &boundary.scene().loads {
        let set = boundary.set(load.set.value);
        for (axis, component) in load.components.iter().enumerate() {
            let place = |&point: &usize| {
                let factor = match load.kind {
                    LoadKind::Force => body.volumes()[point] / set.volume,
                    LoadKind::Density => body.volumes()[point],
                    LoadKind::Acceleration => masses[point],
                };
                (point * d + axis, point, factor)
            };
            terms.push(Term {
                quantity: &component.value,
                what: load.kind.key(),
                set: load.set.value,
                axis,
                places: set.points.iter().map(place).collect(),
                compiled: None,
            });
        }
    }
    Terms::new(boundary, d * body.n_points(), terms)
}

impl<'a> Terms<'a> {
    fn new(
        boundary: &BoundaryConditions<'_>,
        n: usize,
        terms: Vec<Term<'a>>,
    ) -> Result<Terms<'a>, NonFiniteCondition> {
        let is_constant = |term: &Term<'_>| !term.quantity.names("t");
        let mut constant = vec![0.0; if terms.iter().any(is_constant) { n } else { 0 }];
        let mut varying = Vec::new();
        for mut term in terms {
            if !is_constant(&term) {
                term.compile(boundary.body());
                varying.push(term);
            } else {
                term.add(boundary, 0.0, &mut constant)?;
            }
        }
        Ok(Terms { constant, varying })
    }

    fn at(
        &self,
        boundary: &BoundaryConditions<'_>,
        t: f64,
        values: &mut [f64],
    ) -> Result<(), NonFiniteCondition> {
        match &self.constant[..] {
            [] => values.fill(0.0),
            constant => values.copy_from_slice(constant),
        }
        self.varying.iter().try_for_each(|term| term.add(boundary, t, values))
    }
}

impl Term<'_> {
    fn is_by_point(&self) -> bool {
        ["X", "Y", "Z"].iter().any(|name| self.quantity.names(name))
    }

    /// Makes machine code where it pays.
    fn compile(&mut self, body: &Body) {
        let Quantity::Expression(expression) = self.quantity else { return };
        if !self.is_by_point() || self.places.len() < LEAST_COMPILED {
            return;
        }
        let along = |axis: usize| {
            let of = |place: &(usize, usize, f64)| body.position(place.1).get(axis).copied();
            self.places.iter().map(|place| of(place).unwrap_or(0.0)).collect()
        };
        let empty = || vec![0.0; self.places.len()];
        self.compiled = expression.compiled().map(|code| Compiled {
            code,
            coordinates: [along(0), along(1), along(2)],
            room: Mutex::new([empty(), empty()]),
        });
    }

    fn add(
        &self,
        boundary: &BoundaryConditions<'_>,
        t: f64,
        values: &mut [f64],
    ) -> Result<(), NonFiniteCondition> {
        let value =
            |point| boundary.evaluate(self.quantity, self.what, self.set, point, self.axis, t);
        if let Some(compiled) = &self.compiled {
            let mut room = compiled.room.lock().unwrap_or_else(PoisonError::into_inner);
            let [times, found] = &mut *room;
            times.fill(t);
            let [x, y, z] = &compiled.coordinates;
            compiled.code.values(&[x, y, z, times], found);
            for ((entry, point, factor), found) in self.places.iter().zip(found) {
                // Who interprets the expression says where it is not finite.
                let own = if found.is_finite() { *found } else { value(*point)? };
                values[*entry] += factor * own;
            }
            return Ok(());
        }
        let Some(first) = self.places.first().filter(|_| !self.is_by_point()) else {
            for (entry, point, factor) in &self.places {
                values[*entry] += factor * value(*point)?;
            }
            return Ok(());
        };
        let everywhere = value(first.1)?;
        for (entry, _, factor) in &self.places {
            values[*entry] += factor * everywhere;
        }
        Ok(())
    }
}

/// Where the points of a scene start, in the body's order.
///
/// # Errors
/// A condition that is not finite.
pub fn initial(boundary: &BoundaryConditions<'_>) -> Result<Initial, NonFiniteCondition> {
    let (body, d) = (boundary.body(), boundary.body().dimension());
    let zero = vec![0.0; d * body.n_points()];
    let mut start = Initial { displacements: zero.clone(), velocities: zero };
    for entry in &boundary.scene().initial {
        let both = [
            (&entry.displacements, &mut start.displacements, "initial displacement"),
            (&entry.velocities, &mut start.velocities, "initial velocity"),
        ];
        for (components, values, what) in both {
            let Some(components) = components else { continue };
            for &point in &boundary.set(entry.set.value).points {
                for (axis, quantity) in components.value.iter().enumerate() {
                    values[point * d + axis] =
                        boundary.evaluate(quantity, what, entry.set.value, point, axis, 0.0)?;
                }
            }
        }
    }
    Ok(start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::{Case, Library};

    const SCENE: &str = r#"[body]
box = [[0.0, 0.0], [1.0, 1.0]]
spacing = 0.1
[horizon]
spacings = 3
[material]
potential = "law.piola"
density = 1000
[sets]
all = "X > -1"
[[load]]
set = "all"
density = ["sin(3*t)*X + t*Y", "t"]
[[load]]
set = "all"
acceleration = ["1/(0.5 - t*X)", 0]
[motion]
end = 1.0
"#;

    /// Machine code for a hundred points gives what the interpreter does, and names who has no number.
    #[test]
    fn loads_of_place_and_time_are_compiled() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, SCENE).unwrap();
        std::fs::write(folder.path().join("law.piola"), "potential p\npsi(l) = l^2\n").unwrap();
        let library = Library { find: &|_| None, names: &[] };
        let case = Case::read(&path, &[], &library).unwrap();
        let (body, selection) = (&case.body, case.selection().unwrap());
        let boundary = BoundaryConditions::new(&case.scene, body, &selection).unwrap();
        let masses = case.masses().unwrap();
        let drive = MotionConditions::new(&boundary, &masses).unwrap();
        assert_eq!(drive.loads.varying.iter().filter(|term| term.compiled.is_some()).count(), 2);
        let mut loads = vec![0.0; 2 * body.n_points()];
        drive.loads(0.3, &mut loads);
        for (point, (load, volume)) in loads.chunks(2).zip(body.volumes()).enumerate() {
            let (x, y) = (body.position(point)[0], body.position(point)[1]);
            let own = libm::sin(3.0 * 0.3) * x + 0.3 * y + 1000.0 / (0.5 - 0.3 * x);
            assert!((load[0] / volume - own).abs() < 1e-12 * own.abs(), "{point}");
            assert!((load[1] / volume - 0.3).abs() < 1e-15);
        }
        let x = body.position(17)[0];
        drive.loads(0.5 / x, &mut loads);
        assert!(loads.iter().all(|load| load.is_nan()));
        let problem = drive.problem().unwrap();
        assert!((problem.position[0] - x).abs() < 1e-12, "{problem}");
    }
}
