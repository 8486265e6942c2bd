//! A complete scene as TOML.

use std::fmt::Write;

use super::read::correspondence::{DISCRETISATIONS, INFLUENCES, ORDERS, PLANES, STABILISATIONS};
use super::read::{
    DERIVATIVES, FORMS, LEVELS, LINEAR, NEWTON, NODES, PRECONDITIONERS, PRODUCTS, STARTS, STRAINS,
    UNSTABLE, WEIGHTS,
};
use super::{
    BodyShape, CorrespondenceSettings, DiscretisationChoice, Horizon, HorizonExtent,
    InfluenceChoice, Load, Material, ParameterText, Plane, Points, Prescription, Probe, Quantity,
    Scene, SetDefinition,
};

impl Scene {
    /// The scene as TOML with every default written out; it reads back to an equal scene.
    ///
    /// Numbers are written with the fewest digits that read back to the same bits.
    pub fn resolved_toml(&self) -> String {
        let mut out = String::new();
        write_body(&mut out, &self.body);
        write_horizon(&mut out, &self.horizon);
        write_material(&mut out, &self.material);
        if let Some(settings) = &self.correspondence {
            write_correspondence(&mut out, settings);
        }
        write_sets(&mut out, &self.sets);
        for prescription in &self.prescriptions {
            write_prescription(&mut out, prescription, &self.sets);
        }
        for load in &self.loads {
            write_load(&mut out, load, &self.sets);
        }
        for probe in &self.probes {
            write_probe(&mut out, probe);
        }
        section(&mut out, "[steps]");
        pair(&mut out, "end", number(self.steps.end));
        pair(&mut out, "increments", self.steps.increments);
        section(&mut out, "[solver]");
        let solver = &self.solver;
        pair(&mut out, "tolerance", number(solver.tolerance));
        pair(&mut out, "start", word(STARTS, solver.start));
        pair(&mut out, "newton", word(NEWTON, solver.newton));
        pair(&mut out, "linear", word(LINEAR, solver.linear));
        pair(&mut out, "preconditioner", word(PRECONDITIONERS, solver.preconditioner));
        pair(&mut out, "products", word(PRODUCTS, solver.products));
        pair(&mut out, "derivatives", word(DERIVATIVES, solver.derivatives));
        pair(&mut out, "level", word(LEVELS, solver.level));
        pair(&mut out, "form", word(FORMS, solver.form));
        pair(&mut out, "strain", word(STRAINS, solver.strain));
        pair(&mut out, "unstable", word(UNSTABLE, solver.unstable));
        pair(&mut out, "max_iterations", solver.max_iterations);
        section(&mut out, "[output]");
        pair(&mut out, "frames", self.output.frames);
        out
    }

    /// The part of it that says what the body is made of.
    pub fn material_toml(&self) -> String {
        let mut out = String::new();
        write_material(&mut out, &self.material);
        out
    }
}

fn write_body(out: &mut String, body: &BodyShape) {
    section(out, "[body]");
    pair(out, "dimension", body.dimension);
    match &body.points {
        Points::Lattice(lattice) => {
            let corners = [vector(&lattice.low), vector(&lattice.high)];
            pair(out, "box", format!("[{}]", corners.join(", ")));
            pair(out, "spacing", number(lattice.spacing));
            pair(out, "nodes", word(NODES, lattice.nodes));
        }
        Points::Cloud { path } => pair(out, "points", string(&path.value)),
    }
    let conditions: Vec<String> = body.remove.iter().map(|c| string(&c.text)).collect();
    pair(out, "remove", format!("[{}]", conditions.join(", ")));
    if let Some(thickness) = body.thickness {
        pair(out, "thickness", number(thickness.value));
    }
}

fn write_horizon(out: &mut String, horizon: &Horizon) {
    section(out, "[horizon]");
    match horizon.extent {
        HorizonExtent::Spacings(count) => pair(out, "spacings", number(count)),
        HorizonExtent::Radius(radius) => pair(out, "radius", number(radius)),
    }
    pair(out, "weights", word(WEIGHTS, horizon.weights));
}

fn write_material(out: &mut String, material: &Material) {
    section(out, "[material]");
    pair(out, "potential", string(&material.potential.value));
    section(out, "[material.parameters]");
    for parameter in &material.parameters {
        let value = match &parameter.value.value {
            ParameterText::Number(value) => number(*value),
            ParameterText::Quantity(text) => string(text),
        };
        pair(out, &key(&parameter.name.value), value);
    }
}

impl std::fmt::Display for CorrespondenceSettings {
    /// In a few words, for a plan.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bare = |quoted: String| quoted.trim_matches('"').to_string();
        let stabilised = self.discretisation == DiscretisationChoice::Stabilised;
        write!(f, "{}", bare(word(DISCRETISATIONS, self.discretisation)))?;
        if stabilised {
            write!(f, " ({})", bare(word(STABILISATIONS, self.stabilisation)))?;
        }
        let influence = match &self.influence {
            InfluenceChoice::Expression(expression) => expression.text.clone(),
            named => bare(word(INFLUENCES, named.clone())),
        };
        write!(f, ", order {}, influence {influence}", bare(word(ORDERS, self.order)))?;
        match self.plane {
            Plane::Strain => Ok(()),
            Plane::Stress => write!(f, ", plane stress"),
        }
    }
}

fn write_correspondence(out: &mut String, settings: &CorrespondenceSettings) {
    section(out, "[correspondence]");
    pair(out, "discretisation", word(DISCRETISATIONS, settings.discretisation));
    if settings.discretisation == DiscretisationChoice::Stabilised {
        pair(out, "stabilisation", word(STABILISATIONS, settings.stabilisation));
    }
    if let Some(stiffness) = settings.stiffness {
        pair(out, "stiffness", number(stiffness));
    }
    pair(out, "order", word(ORDERS, settings.order));
    let influence = match &settings.influence {
        InfluenceChoice::Expression(expression) => string(&expression.text),
        named => word(INFLUENCES, named.clone()),
    };
    pair(out, "influence", influence);
    if settings.plane != Plane::default() {
        pair(out, "plane", word(PLANES, settings.plane));
    }
}

fn write_sets(out: &mut String, sets: &[SetDefinition]) {
    section(out, "[sets]");
    for set in sets {
        pair(out, &key(&set.name.value), string(&set.condition.text));
    }
}

fn write_prescription(out: &mut String, prescription: &Prescription, sets: &[SetDefinition]) {
    section(out, "[[prescribe]]");
    pair(out, "set", string(&sets[prescription.set.value].name.value));
    let components: Vec<String> = prescription
        .components
        .iter()
        .map(|component| component.value.as_ref().map_or("\"free\"".into(), quantity))
        .collect();
    pair(out, "u", format!("[{}]", components.join(", ")));
}

fn write_load(out: &mut String, load: &Load, sets: &[SetDefinition]) {
    section(out, "[[load]]");
    pair(out, "set", string(&sets[load.set.value].name.value));
    let components: Vec<String> = load.components.iter().map(|c| quantity(&c.value)).collect();
    pair(out, load.kind.key(), format!("[{}]", components.join(", ")));
}

fn write_probe(out: &mut String, probe: &Probe) {
    section(out, "[[probe]]");
    pair(out, "name", string(&probe.name.value));
    pair(out, "at", vector(&probe.at.value));
}

fn section(out: &mut String, header: &str) {
    let gap = if out.is_empty() { "" } else { "\n" };
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{gap}{header}");
}

fn pair(out: &mut String, key: &str, value: impl std::fmt::Display) {
    let _ = writeln!(out, "{key} = {value}");
}

/// Shortest decimals that read back to the same bits, as a TOML float.
fn number(value: f64) -> String {
    format!("{value:?}")
}

fn vector(values: &[f64]) -> String {
    let numbers: Vec<String> = values.iter().map(|value| number(*value)).collect();
    format!("[{}]", numbers.join(", "))
}

fn quantity(quantity: &Quantity) -> String {
    match quantity {
        Quantity::Number(value) => number(*value),
        Quantity::Expression(expression) => string(&expression.text),
    }
}

/// The word of a choice; every value of a choice has one.
pub(super) fn word<T: PartialEq>(choices: &[(&str, T)], value: T) -> String {
    choices.iter().find(|(_, v)| *v == value).map_or(String::new(), |(word, _)| string(word))
}

/// A key, quoted unless it is plain.
fn key(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !name.is_empty() && name.chars().all(plain) { name.into() } else { string(name) }
}

/// A TOML basic string.
fn string(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", c as u32);
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}
