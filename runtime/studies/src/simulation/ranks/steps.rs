//! Load steps over ranks: each is Newton's method from where the tangent of the last equilibrium leads.

use piola_petsc::{Engine, EngineError, Newton};

use super::slab::Slab;
use crate::case::{CaseError, FieldsInTime};
use crate::scene::boundary::BoundaryConditions;
use crate::simulation::run::RunError;

/// How often an increment is halved before there is no way on.
const HALVINGS: u32 = 8;

/// A body between two load steps.
pub(super) struct LoadSteps<'a, 's> {
    pub(super) engine: &'a Engine,
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
    /// How many times linear systems were solved, and iterations of these.
    pub(super) solves: [u64; 2],
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
        let way = self.slab.response(&mut self.newton, &self.u, &self.given).map_err(lost)?;
        let guess = way.map(|way| u.iter().zip(&way).map(|(u, way)| u + way).collect::<Vec<f64>>());
        self.slab.settle(&mut u);
        if let Some(mut guess) = guess {
            self.slab.settle(&mut guess);
            // A start that is not defined is no start.
            if self.slab.look_at(&guess, false).map_err(lost)? {
                u = guess;
            }
        }
        if !self.slab.look_at(&u, false).map_err(lost)? {
            return Ok(Err("the energy is not finite where Newton's method starts".to_owned()));
        }
        let outcome = self.newton.solve(self.slab, &mut u).map_err(lost)?;
        self.solves[0] += outcome.iterations;
        self.solves[1] += outcome.linear_iterations;
        if !outcome.converged {
            return Ok(Err(format!("{}, residual {:e} N", outcome.reason, outcome.residual)));
        }
        self.slab.settle(&mut u);
        // Forces are then those of the equilibrium, whatever was tried last.
        self.slab.look_at(&u, false).map_err(lost)?;
        self.given = self.slab.prescribed().to_vec();
        self.u = u;
        Ok(Ok(outcome.iterations as usize))
    }

    /// Parameters, prescribed displacements and loads at `t`.
    pub(super) fn give(&mut self, t: f64) -> Result<(), RunError> {
        let given = self.fields.advance(t).map_err(|wrong| wrong.to_string()).and_then(|_| {
            let values = self.boundary.prescribed(t).map_err(|problem| problem.to_string())?;
            let loads = self.boundary.loads(t).map_err(|problem| problem.to_string())?;
            Ok((values, loads))
        });
        let (values, loads) = agreed(self.engine, given)?;
        self.slab.drive(self.boundary.fixed_dofs(), &values, &loads);
        Ok(())
    }
}

/// What all ranks have, or why one has not. Collective.
pub(super) fn agreed<T>(engine: &Engine, own: Result<T, String>) -> Result<T, RunError> {
    let told = engine.agree(own.as_ref().map(|_| ()).map_err(Clone::clone));
    match (told, own) {
        (Ok(()), Ok(value)) => Ok(value),
        (Err(failure), _) => Err(body(failure.message)),
        (Ok(()), Err(message)) => Err(body(message)),
    }
}

/// What PETSc reports.
pub(super) fn lost(error: EngineError) -> RunError {
    body(error.message)
}

fn body(message: String) -> RunError {
    CaseError::Body { message }.into()
}
