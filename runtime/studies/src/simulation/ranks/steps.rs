//! Load steps over ranks: each is Newton's method from where the tangent of the last equilibrium leads.

use std::fmt::Display;

use piola_petsc::{Engine, EngineError, Newton};

use super::slab::Slab;
use crate::case::{Case, CaseError, FieldsInTime};
use crate::scene::boundary::BoundaryConditions;
use crate::simulation::run::RunError;

/// How often an increment is halved before there is no way on.
const HALVINGS: u32 = 8;

/// A body between two load steps.
pub(super) struct LoadSteps<'a, 's> {
    pub(super) engine: &'a Engine,
    /// Of what the rank holds.
    pub(super) case: &'s Case,
    pub(super) slab: &'s mut Slab<'a>,
    pub(super) newton: Newton<'a>,
    pub(super) boundary: &'s BoundaryConditions<'s>,
    pub(super) fields: &'s FieldsInTime<'s>,
    /// Own displacements in m, at the last equilibrium.
    pub(super) u: Vec<f64>,
    /// What is prescribed there, of all that are held.
    pub(super) given: Vec<f64>,
    /// Its time.
    pub(super) t: f64,
    pub(super) solves: Solves,
}

/// How many times linear systems were solved, and in how many iterations.
#[derive(Clone, Copy, Default)]
pub(super) struct Solves {
    pub(super) systems: u64,
    pub(super) iterations: u64,
}

impl Solves {
    fn add(&mut self, systems: u64, iterations: u64) {
        self.systems += systems;
        self.iterations += iterations;
    }
}

/// An equilibrium that was found.
pub(super) struct Found {
    pub(super) t: f64,
    /// Whether it stands at the end of an increment that the scene asks for.
    pub(super) nominal: bool,
    pub(super) iterations: usize,
}

/// Why a step has no equilibrium.
pub(super) struct NotFound {
    /// The time that was tried last.
    pub(super) t: f64,
    pub(super) reason: String,
}

impl LoadSteps<'_, '_> {
    /// Goes to `t`, in smaller steps where that is too far; `see` gets every equilibrium on the way. Collective.
    ///
    /// # Errors
    /// Conditions that are not finite, what PETSc reports, what `see` does not want.
    pub(super) fn go_to(
        &mut self,
        t: f64,
        see: &mut dyn FnMut(&mut Self, Found) -> Result<(), RunError>,
    ) -> Result<Result<(), NotFound>, RunError> {
        let shortest = (t - self.t) / f64::from(1_u32 << HALVINGS);
        let mut step = t - self.t;
        loop {
            let next = if step >= t - self.t { t } else { self.t + step };
            match self.attempt(next)? {
                Ok(iterations) => {
                    self.t = next;
                    see(self, Found { t: next, nominal: next == t, iterations })?;
                    if next == t {
                        return Ok(Ok(()));
                    }
                }
                Err(reason) if 0.5 * step < shortest => {
                    return Ok(Err(NotFound { t: next, reason }));
                }
                Err(_) => step *= 0.5,
            }
        }
    }

    /// Looks for the equilibrium at `t`: how many iterations led there, or why there is none.
    fn attempt(&mut self, t: f64) -> Result<Result<usize, String>, RunError> {
        self.give(t)?;
        let mut u = self.u.clone();
        self.slab.found = None;
        let way = self.slab.response(&mut self.newton, &self.u, &self.given).map_err(lost)?;
        if let Some((_, iterations)) = &way {
            self.solves.add(1, *iterations);
        }
        let guess =
            way.map(|(way, _)| u.iter().zip(&way).map(|(u, way)| u + way).collect::<Vec<f64>>());
        self.slab.settle(&mut u);
        if let Some(mut guess) = guess {
            self.slab.settle(&mut guess);
            // A start that is not defined is no start.
            if self.slab.look_at(&guess, false).map_err(lost)? {
                u = guess;
            }
        }
        if !self.slab.look_at(&u, false).map_err(lost)? {
            return Ok(Err(self.not_finite().unwrap_or_default()));
        }
        let outcome = self.newton.solve(self.slab, &mut u).map_err(lost)?;
        self.solves.add(outcome.iterations, outcome.linear_iterations);
        if !outcome.converged {
            let why = format!("{}, residual {:e} N", outcome.reason, outcome.residual);
            let place = self.not_finite();
            return Ok(Err(place.map_or_else(|| why.clone(), |place| format!("{why}; {place}"))));
        }
        self.slab.settle(&mut u);
        // Forces are then those of the equilibrium, whatever was tried last.
        self.slab.look_at(&u, false).map_err(lost)?;
        self.given = self.slab.prescribed().to_vec();
        self.u = u;
        Ok(Ok(outcome.iterations as usize))
    }

    /// The body at rest with its loads: whether forces are known there. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn rest(&mut self) -> Result<bool, RunError> {
        let n = self.boundary.fixed_dofs().len();
        let known = self.fields.advance(0.0).is_ok();
        let loads = self.boundary.loads(0.0).ok().filter(|_| known);
        // What is not given at rest is no reason for what happens later.
        if self.engine.agree(loads.as_ref().map(|_| ()).ok_or_else(String::new)).is_err() {
            return Ok(false);
        }
        self.slab.drive(self.boundary.fixed_dofs(), &vec![0.0; n], &loads.unwrap_or_default());
        self.slab.look_at(&self.u, false).map_err(lost)
    }

    /// The last equilibrium again, behind steps that came to nothing. Collective.
    ///
    /// # Errors
    /// As [`LoadSteps::go_to`].
    pub(super) fn return_to_last(&mut self) -> Result<(), RunError> {
        self.give(self.t)?;
        self.slab.look_at(&self.u, false).map_err(lost).map(|_| ())
    }

    /// What is not finite, in the words of the first rank that found it; nothing where none has. Collective.
    fn not_finite(&self) -> Option<String> {
        let found = self.slab.found.as_ref().map(|found| self.case.describe(found));
        self.engine.agree(found.map_or(Ok(()), Err)).err().map(|failure| failure.message)
    }

    /// Parameters, prescribed displacements and loads at `t`.
    pub(super) fn give(&mut self, t: f64) -> Result<(), RunError> {
        let given = || -> Result<(Vec<f64>, Vec<f64>), CaseError> {
            self.fields.advance(t).map_err(|wrong| self.case.wrong_field(wrong))?;
            Ok((self.boundary.prescribed(t)?, self.boundary.loads(t)?))
        };
        let given = given();
        let (values, loads) = agreed(self.engine, given)?;
        self.slab.drive(self.boundary.fixed_dofs(), &values, &loads);
        Ok(())
    }
}

/// What all ranks have, or why one has not: a rank that failed has its own error, others that of the first that did.
/// Collective.
pub(super) fn agreed<T>(
    engine: &Engine,
    own: Result<T, impl Display + Into<RunError>>,
) -> Result<T, RunError> {
    let told = engine.agree(own.as_ref().map(|_| ()).map_err(ToString::to_string));
    match (told, own) {
        (_, Err(error)) => Err(error.into()),
        (Err(failure), Ok(_)) => Err(body(failure.message)),
        (Ok(()), Ok(value)) => Ok(value),
    }
}

/// What PETSc reports.
pub(super) fn lost(error: EngineError) -> RunError {
    body(error.message)
}

fn body(message: String) -> RunError {
    CaseError::Body { message }.into()
}
