//! `piola calibrate`: parameters for which the discrete body has given moduli.

use piola_runtime::moduli::{
    CalibrateError, Calibrated, FractureTarget, Modulus, Target, Wanted, calibrate,
};
use serde_json::{Value, json};

use super::{Exit, scene};
use crate::cli::{Calibrate, Format};
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Calibrate) -> Exit {
    let Some(wanted) = wanted(&arguments.targets) else { return Exit::Input };
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
    match calibrate(case, &wanted, &arguments.vary) {
        Ok(found) => {
            console::out(&match arguments.format {
                Format::Human => human(&found, &wanted),
                Format::Json => format!("{:#}\n", machine(&found, &wanted)),
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

/// What all targets ask for; prints what is wrong.
fn wanted(targets: &[String]) -> Option<Wanted> {
    let mut wanted = Wanted::default();
    for text in targets {
        let Some((name, value)) = text.split_once('=') else {
            let help = "E=200e9,nu=0.3,Gc=2700";
            render::error(&format!("--target {text}: this is not NAME=VALUE"), Some(help));
            return None;
        };
        let (name, value) = (name.trim(), value.trim());
        if let Some(modulus) = Modulus::named(name) {
            let units = if modulus.is_stress() { &STRESSES[..] } else { &[] };
            let value = quantity(text, value, units)?;
            wanted.moduli.push(Target { modulus, value });
        } else if let Some(normal) = plane(name) {
            let target =
                FractureTarget { normal, value: quantity(text, value, &FRACTURE_ENERGIES)? };
            if let Some(first) = wanted.fracture.replace(target) {
                let message = format!("--target {text}: `{}` is a target, too", first.name());
                render::error(
                    &message,
                    Some("one threshold gives one fracture energy: name one plane"),
                );
                return None;
            }
        } else {
            let names = Modulus::ALL.map(Modulus::name).join(", ");
            let message = format!("--target {text}: there is no modulus `{name}`");
            let help = format!("there are {names}, and Gc, Gc[110] .. of bodies that break");
            render::error(&message, Some(help.as_str()));
            return None;
        }
    }
    Some(wanted)
}

/// Units of stresses in Pa.
const STRESSES: [(&str, f64); 4] = [("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0)];

/// Units of fracture energies in J/m^2.
const FRACTURE_ENERGIES: [(&str, f64); 5] =
    [("kJ/m^2", 1e3), ("mJ/m^2", 1e-3), ("J/m^2", 1.0), ("kN/m", 1e3), ("N/m", 1.0)];

/// `Gc` or `Gc[110]`, with the normal of the plane if it names one.
fn plane(name: &str) -> Option<Option<Vec<i32>>> {
    let of_plane = name.strip_prefix("Gc")?;
    if of_plane.is_empty() {
        return Some(None);
    }
    let digits = of_plane.strip_prefix('[')?.strip_suffix(']')?;
    let normal: Option<Vec<i32>> =
        digits.chars().map(|digit| digit.to_digit(10).map(|digit| digit as i32)).collect();
    normal.map(Some)
}

/// `200e9` or `200 GPa`; prints what is wrong.
fn quantity(text: &str, value: &str, units: &[(&str, f64)]) -> Option<f64> {
    let unit = units.iter().find(|(unit, _)| value.ends_with(unit));
    let (number, scale) = match unit {
        Some((unit, scale)) => (value[..value.len() - unit.len()].trim(), *scale),
        None => (value, 1.0),
    };
    match number.parse::<f64>() {
        Ok(number) if number.is_finite() => Some(number * scale),
        _ => {
            let unit = match units {
                [] => "",
                _ if units == STRESSES => " in Pa, or with kPa, MPa, GPa",
                _ => " in J/m^2, or with kJ/m^2, N/m",
            };
            render::error(&format!("--target {text}: `{value}` is not a number{unit}"), None);
            None
        }
    }
}

fn human(found: &Calibrated, wanted: &Wanted) -> String {
    let mut text = String::new();
    let names = |are_varied: bool| -> String {
        let names = found.parameters.iter().map(|(name, _)| name.as_str());
        let is_last = |name: &&str| found.threshold.as_deref() == Some(*name);
        names.filter(|name| is_last(name) != are_varied).collect::<Vec<_>>().join(", ")
    };
    if !wanted.moduli.is_empty() {
        let how = if found.linear { "are linear in" } else { "depend in no linear way on" };
        text.push_str(&format!(
            "# The moduli {how} {}; {} elasticity tensors were computed.\n",
            names(true),
            found.evaluations
        ));
    }
    if wanted.fracture.is_some() {
        text.push_str(&format!(
            "# The fracture energy follows from {}; it was computed {} times.\n",
            names(false),
            found.fracture_evaluations
        ));
    }
    for (name, achieved, value) in reached(found, wanted) {
        text.push_str(&format!("# {name} = {achieved}, asked for {value}\n"));
    }
    text.push_str(found.scene.material_toml().trim_start());
    for line in found.moduli.to_string().lines() {
        text.push_str(&format!("# {line}\n"));
    }
    text
}

/// Of each target its name, what the body has and what was asked for.
fn reached(found: &Calibrated, wanted: &Wanted) -> Vec<(String, f64, f64)> {
    let moduli = wanted.moduli.iter().map(|target| {
        let achieved = found.moduli.stiffness.modulus(target.modulus);
        (target.modulus.name().to_string(), achieved.unwrap_or(f64::NAN), target.value)
    });
    let fracture = wanted.fracture.iter().map(|target| {
        let energies = found.moduli.fracture.as_ref().ok();
        let achieved = energies.and_then(|energies| energies.along(target.normal.as_deref()));
        (target.name(), achieved.unwrap_or(f64::NAN), target.value)
    });
    moduli.chain(fracture).collect()
}

fn machine(found: &Calibrated, wanted: &Wanted) -> Value {
    let parameters: serde_json::Map<String, Value> =
        found.parameters.iter().map(|(name, value)| (name.clone(), json!(value))).collect();
    let asked: serde_json::Map<String, Value> =
        reached(found, wanted).into_iter().map(|(name, _, value)| (name, json!(value))).collect();
    json!({
        "parameters": parameters,
        "targets": asked,
        "moduli": found.moduli.json(),
        "linear": found.linear,
        "evaluations": found.evaluations,
        "fracture_evaluations": found.fracture_evaluations,
    })
}
