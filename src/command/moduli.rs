//! `piola moduli`: the elastic moduli of the discrete body.

use piola_runtime::moduli::{Moduli, moduli};
use serde_json::{Value, json};

use super::{Exit, scene};
use crate::cli::{Format, Moduli as Arguments};
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Arguments) -> Exit {
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
    let Some(cases) = scene::of_materials(&case, arguments.material.as_deref()) else {
        return Exit::Input;
    };
    if case.has_fields() {
        console::note(
            "parameters that vary have everywhere the values of the middle of their points at t = 0",
        );
    }
    let mut all = Vec::new();
    for (name, case) in &cases {
        let stated = case.scene.material().density.map(|density| density.value);
        match moduli(case, arguments.density.or(stated)) {
            Ok(found) => all.push((*name, found)),
            Err(error) => {
                scene::print_error(&error);
                return Exit::Input;
            }
        }
    }
    console::out(&match arguments.format {
        Format::Human => human(&all),
        Format::Json => format!("{:#}\n", machine(&all)),
    });
    for (name, found) in &all {
        if !found.stiffness.is_stable() {
            let whose = name.map_or(String::new(), |name| format!(" of `{name}`"));
            let message =
                format!("a homogeneous strain costs no energy: the body{whose} is not stable");
            render::warning(&message);
        }
    }
    Exit::Done
}

fn human(all: &[(Option<&str>, Moduli)]) -> String {
    let one = |(name, found): &(Option<&str>, Moduli)| match name {
        Some(name) => format!("material `{name}`, as if the body were of it alone\n{found}"),
        None => found.to_string(),
    };
    all.iter().map(one).collect::<Vec<_>>().join("\n")
}

fn machine(all: &[(Option<&str>, Moduli)]) -> Value {
    if let [(None, found)] = all {
        return found.json();
    }
    let one = |(name, found): &(Option<&str>, Moduli)| {
        (name.unwrap_or_default().to_string(), found.json())
    };
    json!({ "materials": all.iter().map(one).collect::<serde_json::Map<_, _>>() })
}
