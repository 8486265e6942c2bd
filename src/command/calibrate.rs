//! `piola calibrate`: parameters for which the discrete body has given moduli.

use piola_runtime::moduli::{CalibrateError, Calibrated, Modulus, Target, calibrate};
use serde_json::{Value, json};

use super::{Exit, scene};
use crate::cli::{Calibrate, Format};
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Calibrate) -> Exit {
    let Some(targets) =
        arguments.targets.iter().map(|text| target(text)).collect::<Option<Vec<_>>>()
    else {
        return Exit::Input;
    };
    let Some(case) = scene::read(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    scene::print_warnings(&case, case.warnings.clone());
    let Some(cases) = scene::of_materials(&case, arguments.material.as_deref()) else {
        return Exit::Input;
    };
    let [(_, case)] = &cases[..] else {
        let names: Vec<&str> = cases.iter().filter_map(|(name, _)| *name).collect();
        let help = format!("write --material {}", names.join(" or --material "));
        render::error("the scene has several materials", Some(help.as_str()));
        return Exit::Input;
    };
    match calibrate(case, &targets, &arguments.vary) {
        Ok(found) => {
            console::out(&match arguments.format {
                Format::Human => human(&found, &targets),
                Format::Json => format!("{:#}\n", machine(&found, &targets)),
            });
            Exit::Done
        }
        Err(CalibrateError::Case(error)) => {
            scene::print_error(&error);
            Exit::Input
        }
        Err(CalibrateError::Input { message, help }) => {
            render::error(&message, Some(help.as_str()));
            Exit::Input
        }
        Err(CalibrateError::Unreachable { message, helps }) => {
            render::error(&message, helps.iter().map(String::as_str));
            Exit::Findings
        }
    }
}

/// `E=200e9` or `E=200 GPa`; prints what is wrong.
fn target(text: &str) -> Option<Target> {
    let names = Modulus::ALL.map(Modulus::name).join(", ");
    let Some((name, value)) = text.split_once('=') else {
        render::error(&format!("--target {text}: this is not NAME=VALUE"), Some("E=200e9,nu=0.3"));
        return None;
    };
    let Some(modulus) = Modulus::named(name.trim()) else {
        let message = format!("--target {text}: there is no modulus `{}`", name.trim());
        render::error(&message, Some(format!("there are {names}").as_str()));
        return None;
    };
    let value = value.trim();
    let units = [("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0)];
    let unit = units.iter().find(|(unit, _)| modulus.is_stress() && value.ends_with(unit));
    let (number, scale) = match unit {
        Some((unit, scale)) => (value[..value.len() - unit.len()].trim(), *scale),
        None => (value, 1.0),
    };
    match number.parse::<f64>() {
        Ok(number) if number.is_finite() => Some(Target { modulus, value: number * scale }),
        _ => {
            let unit = if modulus.is_stress() { " in Pa, or with kPa, MPa, GPa" } else { "" };
            render::error(&format!("--target {text}: `{value}` is not a number{unit}"), None);
            None
        }
    }
}

fn human(found: &Calibrated, targets: &[Target]) -> String {
    let names: Vec<&str> = found.parameters.iter().map(|(name, _)| name.as_str()).collect();
    let how = if found.linear { "are linear in" } else { "depend in no linear way on" };
    let mut text = format!(
        "# The moduli {how} {}; {} elasticity tensors were computed.\n",
        names.join(", "),
        found.evaluations
    );
    for target in targets {
        let achieved = found.moduli.stiffness.modulus(target.modulus).unwrap_or(f64::NAN);
        text.push_str(&format!(
            "# {} = {achieved}, asked for {}\n",
            target.modulus.name(),
            target.value
        ));
    }
    text.push_str(found.scene.material_toml().trim_start());
    for line in found.moduli.to_string().lines() {
        text.push_str(&format!("# {line}\n"));
    }
    text
}

fn machine(found: &Calibrated, targets: &[Target]) -> Value {
    let parameters: serde_json::Map<String, Value> =
        found.parameters.iter().map(|(name, value)| (name.clone(), json!(value))).collect();
    let asked: serde_json::Map<String, Value> = targets
        .iter()
        .map(|target| (target.modulus.name().to_string(), json!(target.value)))
        .collect();
    json!({
        "parameters": parameters,
        "targets": asked,
        "moduli": found.moduli.json(),
        "linear": found.linear,
        "evaluations": found.evaluations,
    })
}
