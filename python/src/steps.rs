//! Load steps one by one: the solver waits on its thread while Python looks at a step and gives loads.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use piola_runtime::simulation::{Attempt, follow};
use piola_runtime::solve::{Event, Observer, Watch};
use pyo3::exceptions::PyStopIteration;
use pyo3::prelude::*;

use crate::body::read;
use crate::error;
use crate::wait::wait;

/// What a step is told of.
struct Step {
    t: f64,
    iterations: usize,
    energy: f64,
    /// Displacements and dE/du minus the loads, in the user's order.
    displacement: Vec<f64>,
    residual: Vec<f64>,
}

/// What comes from the solver.
enum Message {
    Step(Step),
    /// The end: nothing, or why there is no further step.
    End(Option<String>),
    /// No equilibrium was found, and why.
    NotConverged(String),
}

/// Loads beside those of the scene, in N, in the body's order; none where nothing was given.
type Loads = Arc<Mutex<Vec<f64>>>;

/// An iterator over converged steps.
#[pyclass]
pub(crate) struct Steps {
    from: Mutex<Receiver<Message>>,
    /// Whether to go on; dropped, the solver ends.
    go: Option<Mutex<Sender<()>>>,
    loads: Loads,
    order: Arc<[u32]>,
    dimension: usize,
    is_over: bool,
}

/// `t`, iterations, energy, displacement, residual.
type Told<'py> = (f64, usize, f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl Steps {
    #[new]
    fn new(py: Python<'_>, scene: &str, overrides: Vec<String>) -> PyResult<Steps> {
        let case = py.detach(|| read(scene, &overrides))?;
        if case.scene.motion.is_some() {
            return Err(error::plain("the scene has [motion]: steps are those of [steps]".into()));
        }
        let (send, from) = channel();
        let (go, wait) = channel::<()>();
        let loads: Loads = Arc::default();
        let order: Arc<[u32]> = case.body.user_index().into();
        let dimension = case.body.dimension();
        let given = loads.clone();
        std::thread::spawn(move || {
            // Nothing is begun before the first step is asked for.
            if wait.recv().is_err() {
                return;
            }
            let add = |_: f64, loads: &mut [f64]| {
                let given = given.lock().unwrap_or_else(PoisonError::into_inner);
                given.iter().zip(loads).for_each(|(given, load)| *load += given);
            };
            let d = case.body.dimension();
            let watch = Watch::by(Arc::new(Deaf));
            let followed = case.check_rest().and_then(|()| {
                follow(&case, &watch, &add, &mut |record, state| {
                    let pairs = state.internal_forces.iter().zip(state.loads);
                    let residual: Vec<f64> = pairs.map(|(g, f)| g - f).collect();
                    let step = Step {
                        t: record.t,
                        iterations: record.iterations,
                        energy: record.energy_parts.total(),
                        displacement: case.body.to_user_order(state.displacements, d),
                        residual: case.body.to_user_order(&residual, d),
                    };
                    match send.send(Message::Step(step)).is_ok() && wait.recv().is_ok() {
                        true => ControlFlow::Continue(()),
                        false => ControlFlow::Break(()),
                    }
                })
            });
            let _ = send.send(match followed {
                Ok(Attempt::NotConverged(reason)) => Message::NotConverged(reason),
                Ok(_) => Message::End(None),
                Err(found) => Message::End(Some(found.to_string())),
            });
        });
        let go = Some(Mutex::new(go));
        Ok(Steps { from: Mutex::new(from), go, loads, order, dimension, is_over: false })
    }

    /// How many points there are, and 2 or 3.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.order.len(), self.dimension)
    }

    /// The next converged step.
    fn next<'py>(&mut self, py: Python<'py>) -> PyResult<Told<'py>> {
        let Some(go) = self.go.as_ref().filter(|_| !self.is_over) else {
            return Err(PyStopIteration::new_err(()));
        };
        let lost = || error::plain("the solver ended in a defect".into());
        go.lock().unwrap_or_else(PoisonError::into_inner).send(()).map_err(|_| lost())?;
        let message = loop {
            match wait(py, &self.from) {
                Ok(message) => break message,
                Err(RecvTimeoutError::Timeout) => py.check_signals()?,
                Err(_) => return Err(lost()),
            }
        };
        match message {
            Message::Step(step) => Ok((
                step.t,
                step.iterations,
                step.energy,
                step.displacement.into_pyarray(py),
                step.residual.into_pyarray(py),
            )),
            Message::NotConverged(reason) => {
                self.is_over = true;
                Err(error::not_converged(py, reason))
            }
            Message::End(reason) => {
                self.is_over = true;
                Err(match reason {
                    Some(reason) => error::plain(reason),
                    None => PyStopIteration::new_err(()),
                })
            }
        }
    }

    /// Loads beside those of the scene from the next step on, in N, `n x d` in the user's order.
    fn set_loads(&self, loads: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let (given, d) = (loads.as_slice()?, self.dimension);
        if given.len() != self.order.len() * d {
            let message = format!("{} numbers for {} points", given.len(), self.order.len());
            return Err(error::plain(message));
        }
        let rows = self.order.iter().flat_map(|user| &given[*user as usize * d..][..d]);
        *self.loads.lock().unwrap_or_else(PoisonError::into_inner) = rows.copied().collect();
        Ok(())
    }

    /// Ends the solver.
    fn close(&mut self) {
        (self.go, self.is_over) = (None, true);
    }
}

/// Hears nothing.
struct Deaf;

impl Observer for Deaf {
    fn notice(&self, _: Event<'_>) {}
}
