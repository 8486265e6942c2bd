//! `piola moduli`: the elastic moduli of the discrete body.

use piola_runtime::moduli::moduli;

use super::{Exit, scene};
use crate::cli::{Format, Moduli};
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Moduli) -> Exit {
    if let Some(density) = arguments.density
        && !(density.is_finite() && density > 0.0)
    {
        render::error(&format!("--density {density}: a positive number, in kg/m^3"), None);
        return Exit::Input;
    }
    let Some(case) = scene::read(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    scene::print_warnings(&case, case.warnings.clone());
    match moduli(&case, arguments.density) {
        Ok(found) => {
            console::out(&match arguments.format {
                Format::Human => found.to_string(),
                Format::Json => format!("{:#}\n", found.json()),
            });
            if !found.stiffness.is_stable() {
                render::warning("a homogeneous strain costs no energy: the body is not stable");
            }
            Exit::Done
        }
        Err(error) => {
            scene::print_error(&error);
            Exit::Input
        }
    }
}
