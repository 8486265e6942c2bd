//! A complete scene as TOML.

use std::fmt::Write;

use piola_mechanics::deformation::{Discretisation, Stabilisation};
use piola_mechanics::fracture::crack::Crack;
use piola_mechanics::words::Words;
use piola_solvers::singular::Singular;
use piola_solvers::steps::{Control, Loose};

use super::keys::{number, string, texts};
use super::read::{MOTION_KEYS, OUTPUT_KEYS, SOLVER_KEYS, STEPS_KEYS};
use super::{
    BodyShape, CorrespondenceSettings, CrackEntry, CrackShape, FractureSettings, Horizon,
    HorizonExtent, Initial, InterfaceRule, Listing, Load, Material, Members, ParameterText, Plane,
    Points, Prescription, Probe, Quantity, Region, Scene, SetDefinition, Track,
};

impl Scene {
    /// The scene as TOML with every default written out; it reads back to an equal scene.
    ///
    /// Numbers are written with the fewest digits that read back to the same bits.
    pub fn resolved_toml(&self) -> String {
        let mut out = String::new();
        write_body(&mut out, &self.body);
        write_horizon(&mut out, &self.horizon);
        write_materials(&mut out, self);
        if let Some(settings) = &self.correspondence {
            write_correspondence(&mut out, settings);
        }
        write_sets(&mut out, &self.sets);
        for initial in &self.initial {
            write_initial(&mut out, initial, &self.sets);
        }
        for prescription in &self.prescriptions {
            write_prescription(&mut out, prescription, &self.sets);
        }
        for load in &self.loads {
            write_load(&mut out, load, &self.sets);
        }
        for probe in &self.probes {
            write_probe(&mut out, probe);
        }
        for crack in &self.cracks {
            write_crack(&mut out, crack, &self.sets);
        }
        write_fracture(&mut out, &self.fracture, &self.sets);
        for track in &self.tracks {
            write_track(&mut out, track, &self.sets);
        }
        match &self.motion {
            Some(motion) => write_pairs(&mut out, "[motion]", texts(motion, &MOTION_KEYS)),
            None => {
                let is_idle = |key: &str| match self.steps.control {
                    Control::Load => ["tie", "events", "arcs"].contains(&key),
                    Control::Event => ["breaking", "arcs"].contains(&key),
                    Control::ArcLength => ["tie", "events"].contains(&key),
                };
                let steps = texts(&self.steps, &STEPS_KEYS).into_iter();
                write_pairs(&mut out, "[steps]", steps.filter(|(key, _)| !is_idle(key)).collect());
            }
        }
        write_pairs(&mut out, "[solver]", texts(&self.solver, &SOLVER_KEYS));
        // Of a motion `every` stands in the place of `frames`, where it says which are written.
        let is_written = |key: &str| match (&self.motion, self.output.every) {
            (None, _) => !["every", "rows", "checkpoint"].contains(&key),
            (Some(_), every) => every.is_none() || key != "frames",
        };
        let output = texts(&self.output, &OUTPUT_KEYS);
        let output = output.into_iter().filter(|(key, _)| is_written(key)).collect();
        write_pairs(&mut out, "[output]", output);
        out
    }

    /// The part of it that says what the body is made of.
    pub fn material_toml(&self) -> String {
        let mut out = String::new();
        write_materials(&mut out, self);
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
            pair(out, "nodes", word(lattice.nodes));
        }
        Points::Cloud { path } => pair(out, "points", string(&path.value)),
        Points::Mesh(mesh) => {
            pair(out, "mesh", string(&mesh.path.value));
            pair(out, "unit", number(mesh.unit));
            match mesh.spacing {
                Some(spacing) => pair(out, "spacing", number(spacing)),
                None => pair(out, "nodes", word(mesh.nodes)),
            }
        }
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
    pair(out, "weights", word(horizon.weights));
    pair(out, "surface", word(horizon.surface));
    pair(out, "volumes", word(horizon.volumes));
}

fn write_materials(out: &mut String, scene: &Scene) {
    let several = !scene.regions.is_empty();
    for (number, material) in scene.materials.iter().enumerate() {
        let is_first = !scene.materials[..number].iter().any(|other| other.law == material.law);
        let region = scene.regions.get(material.law).filter(|_| is_first);
        if several && material.law >= scene.regions.len() {
            continue;
        }
        section(
            out,
            match (is_first, several) {
                (false, _) => "[[material.plus]]",
                (true, false) => "[material]",
                (true, true) => "[[material]]",
            },
        );
        if let Some(Region { name, set }) = region {
            if let Some(set) = set {
                pair(out, "set", string(&scene.sets[set.value].name.value));
            }
            pair(out, "name", string(&name.value));
        }
        let parameters =
            if is_first { "[material.parameters]" } else { "[material.plus.parameters]" };
        write_material(out, parameters, material);
    }
    for interface in &scene.interfaces {
        section(out, "[[interface]]");
        let name = |material: usize| string(&scene.regions[material].name.value);
        let between = interface.between.map(|material| name(material.value));
        pair(out, "between", format!("[{}]", between.join(", ")));
        match interface.rule {
            InterfaceRule::Mean => pair(out, "rule", string("mean")),
            InterfaceRule::As(material) => pair(out, "as", name(material)),
            InterfaceRule::Potential(law) => {
                let own = scene.materials.iter().filter(|material| material.law == law);
                own.for_each(|own| write_material(out, "[interface.parameters]", own));
            }
        }
    }
}

fn write_material(out: &mut String, parameters: &str, material: &Material) {
    pair(out, "potential", string(&material.potential.value));
    if let Some(density) = material.density {
        pair(out, "density", number(density.value));
    }
    section(out, parameters);
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
        write!(f, "{}", self.discretisation.word())?;
        if let Discretisation::Stabilised(stabilisation) = self.discretisation {
            write!(f, " ({})", stabilisation.word())?;
        }
        let influence = self.influence.text();
        write!(f, ", order {}, influence {influence}", self.order.word())?;
        match self.plane {
            Plane::Strain => Ok(()),
            Plane::Stress => write!(f, ", plane stress"),
        }
    }
}

fn write_correspondence(out: &mut String, settings: &CorrespondenceSettings) {
    section(out, "[correspondence]");
    pair(out, "discretisation", word(settings.discretisation));
    if let Discretisation::Stabilised(stabilisation) = settings.discretisation {
        pair(out, "stabilisation", word(stabilisation));
        if let Stabilisation::Silling { stiffness } = stabilisation {
            pair(out, "stiffness", number(stiffness));
        }
    }
    pair(out, "order", word(settings.order));
    pair(out, "influence", string(settings.influence.text()));
    if settings.plane != Plane::default() {
        pair(out, "plane", word(settings.plane));
    }
}

fn write_sets(out: &mut String, sets: &[SetDefinition]) {
    section(out, "[sets]");
    for set in sets {
        let members = match &set.members {
            Members::Where(condition) => string(&condition.text),
            Members::Listed { by: Listing::Group(name), .. } => {
                format!("{{ group = {} }}", string(&name.value))
            }
            Members::Listed { by: Listing::Numbers(path), .. } => {
                format!("{{ numbers = {} }}", string(&path.value))
            }
        };
        pair(out, &key(&set.name.value), members);
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
    pair(out, prescription.given.key(), format!("[{}]", components.join(", ")));
}

fn write_initial(out: &mut String, initial: &Initial, sets: &[SetDefinition]) {
    section(out, "[[initial]]");
    pair(out, "set", string(&sets[initial.set.value].name.value));
    for (key, components) in [("u", &initial.displacements), ("v", &initial.velocities)] {
        if let Some(components) = components {
            let components: Vec<String> = components.value.iter().map(quantity).collect();
            pair(out, key, format!("[{}]", components.join(", ")));
        }
    }
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

fn write_crack(out: &mut String, crack: &CrackEntry, sets: &[SetDefinition]) {
    section(out, "[[crack]]");
    let corners = |corners: &mut dyn Iterator<Item = &[f64]>| {
        format!("[{}]", corners.map(vector).collect::<Vec<String>>().join(", "))
    };
    match &crack.shape {
        CrackShape::Across(Crack::Segment(ends)) => {
            pair(out, "segment", corners(&mut ends.iter().map(|end| &end[..])));
        }
        CrackShape::Across(Crack::Polygon(all)) => {
            pair(out, "polygon", corners(&mut all.iter().map(|corner| &corner[..])));
        }
        CrackShape::Between(both) => {
            let [one, other] = both.map(|set| string(&sets[set.value].name.value));
            pair(out, "between", format!("[{one}, {other}]"));
        }
    }
    pair(out, "damaged", crack.damaged);
}

fn write_fracture(out: &mut String, fracture: &FractureSettings, sets: &[SetDefinition]) {
    let FractureSettings { unbreakable, loose, singular } = fracture;
    if *fracture == FractureSettings::default() {
        return;
    }
    section(out, "[fracture]");
    if *loose != Loose::default() {
        pair(out, "loose", string(loose.word()));
    }
    if *singular != Singular::default() {
        pair(out, "singular", string(singular.word()));
    }
    if unbreakable.is_empty() {
        return;
    }
    let names: Vec<String> =
        unbreakable.iter().map(|set| string(&sets[set.value].name.value)).collect();
    pair(out, "unbreakable", format!("[{}]", names.join(", ")));
}

fn write_track(out: &mut String, track: &Track, sets: &[SetDefinition]) {
    section(out, "[[track]]");
    pair(out, "name", string(&track.name.value));
    pair(out, "axis", word(track.axis));
    pair(out, "threshold", number(track.threshold));
    if let Some(set) = track.set {
        pair(out, "set", string(&sets[set.value].name.value));
    }
    if let Some(thickness) = track.thickness {
        pair(out, "thickness", number(thickness));
    }
}

fn write_pairs(out: &mut String, header: &str, pairs: Vec<(&str, String)>) {
    section(out, header);
    pairs.into_iter().for_each(|(key, value)| pair(out, key, value));
}

fn section(out: &mut String, header: &str) {
    let gap = if out.is_empty() { "" } else { "\n" };
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{gap}{header}");
}

fn pair(out: &mut String, key: &str, value: impl std::fmt::Display) {
    let _ = writeln!(out, "{key} = {value}");
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

fn word(value: impl Words) -> String {
    string(value.word())
}

/// A key, quoted unless it is plain.
fn key(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !name.is_empty() && name.chars().all(plain) { name.into() } else { string(name) }
}
