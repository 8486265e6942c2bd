//! `piola._piola`: what the module of Python cannot do by itself. Its face is `python/piola`.
//!
//! | part | what |
//! |---|---|
//! | `command` | the command line, its data, messages and findings as values |
//! | `law` | a potential on arrays of measures or deformation gradients |
//! | `body` | a scene's body: energy, gradient, tangent, products on arrays |
//! | `steps` | load steps one by one, with loads that a loop in Python gives |
//!
//! The interpreter is free while anything is computed.

mod body;
mod command;
mod error;
mod law;
mod steps;
mod wait;

use pyo3::prelude::*;

/// The extension module.
#[pymodule]
fn _piola(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<error::Error>())?;
    module.add_function(wrap_pyfunction!(command::command, module)?)?;
    module.add_function(wrap_pyfunction!(command::main, module)?)?;
    module.add_function(wrap_pyfunction!(law::library, module)?)?;
    module.add_class::<law::Law>()?;
    module.add_class::<body::Body>()?;
    module.add_class::<steps::Steps>()
}
