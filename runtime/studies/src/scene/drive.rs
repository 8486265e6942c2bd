//! What drives a body in motion: the conditions of a scene, split by what they depend on.
//!
//! Conditions are asked for at every time step. So numbers, and expressions without `t`, are worked
//! out once; expressions of `t` alone once a step; only expressions of both once a step and point.

use std::sync::{Mutex, PoisonError};

use piola_solvers::motion::{Initial, MotionDrive};

use super::boundary::{BoundaryConditions, NonFiniteCondition};
use super::motion::Given;
use super::{LoadKind, Quantity};

/// The conditions of a scene on its body as functions of time.
pub struct MotionConditions<'a> {
    boundary: &'a BoundaryConditions<'a>,
    displaced: Prescribed<'a>,
    driven: Prescribed<'a>,
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
    /// What does not depend on `t`.
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
}

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
                    },
                    set: entry.set.value,
                    axis,
                    places: points.iter().filter_map(place).collect(),
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
        let mut constant = vec![0.0; n];
        let mut varying = Vec::new();
        for term in terms {
            if term.quantity.names("t") {
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
        values.copy_from_slice(&self.constant);
        self.varying.iter().try_for_each(|term| term.add(boundary, t, values))
    }
}

impl Term<'_> {
    fn add(
        &self,
        boundary: &BoundaryConditions<'_>,
        t: f64,
        values: &mut [f64],
    ) -> Result<(), NonFiniteCondition> {
        let value =
            |point| boundary.evaluate(self.quantity, self.what, self.set, point, self.axis, t);
        let by_point = ["X", "Y", "Z"].iter().any(|name| self.quantity.names(name));
        let Some(first) = self.places.first().filter(|_| !by_point) else {
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
