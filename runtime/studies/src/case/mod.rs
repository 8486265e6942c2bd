//! A scene made ready: body, compiled energies, discrete energy.
//!
//! | stage | what |
//! |---|---|
//! | [`Case::outline`] | scene, potentials and parameter values checked together |
//! | [`Case::read`] | the same, and the body built |
//! | [`Case::energy`] | the discrete total energy |
//!
//! [`crate::moduli`] looks at the body at rest, [`crate::simulation`] plans and runs it.

mod directions;
mod dissipation;
mod error;
pub(crate) mod explain;
mod family;
mod fields;
mod fracture;
mod model;
mod points;
mod potential;
pub(crate) mod size;

pub use error::{CaseError, UNREADABLE};
pub(crate) use fields::Columns;
pub use fields::{FieldsInTime, WrongField};
pub(crate) use model::state_laws;
use points::Filled;
pub(crate) use potential::settings;
pub use potential::{Compiled, Potential};

use std::path::{Path, PathBuf};
use std::sync::Arc;

use piola_grammar::Diagnostic;

use crate::scene::selection::{self, Selection};
use crate::scene::{Finding, MAX_SCENE_BYTES, Material, Scene, SceneReport};
use piola_mechanics::body::Body;
use piola_mechanics::energy::NonFinite;
use piola_mechanics::kernel::Measure;

use piola_mechanics::materials::Materials;
use piola_output::mesh::Mesh;

/// A library of potentials: text by name, and all names.
pub struct Library<'a> {
    /// The text of a potential.
    pub find: &'a dyn Fn(&str) -> Option<&'static str>,
    /// All names, offered where one is misspelt.
    pub names: &'a [&'a str],
}

/// A scene with its potentials and its body.
#[derive(Clone, Debug)]
pub struct Case {
    /// The scene.
    pub scene: Scene,
    /// Its potentials, at least one: their energies add up.
    pub potentials: Vec<Potential>,
    /// The points that are left after removals.
    pub body: Arc<Body>,
    /// Of which material they are; nothing where all are of one.
    pub materials: Option<Arc<Materials>>,
    /// What parameters take from the table of the points.
    pub(crate) columns: Columns,
    /// The cells that the points are of, where they are of a mesh.
    pub mesh: Option<Arc<Mesh>>,
    /// FNV-1a of the files that the points and their sets are of; `None` of a lattice.
    pub(crate) content: Option<u64>,
    /// Findings about the scene that do not stop the work; spans as in [`Scene::report`].
    pub warnings: Vec<Diagnostic>,
    /// Where the scene is: a cloud is named relative to it.
    folder: PathBuf,
}

/// Whether an energy of a potential is in the part of this name: with several potentials that of its own, and of
/// its material, stands before it, and energies that are worked out together are one part.
fn is_part_of(part: &str, potential: &str, energy: &str) -> bool {
    let (whose, energies) =
        part.split_once(": ").map_or((None, part), |(whose, energies)| (Some(whose), energies));
    let is_own = whose.is_none_or(|whose| {
        whose
            .strip_prefix(potential)
            .is_some_and(|rest| rest.is_empty() || rest.starts_with(" of "))
    });
    is_own && energies.split(" + ").flat_map(|one| one.split(" | ")).any(|one| one == energy)
}

/// Adds to what is wrong with a scene what is wrong with its potentials and their parameters.
fn add_potentials(report: &mut SceneReport, scene: &Scene, folder: &Path, library: &Library<'_>) {
    for material in &scene.materials {
        let found = match Potential::read(scene, material, folder, library) {
            // What is missing may stand in what could not be read.
            Err(CaseError::Scene(more)) => {
                let is_sure = |one: &Finding| one.diagnostic.code != "missing-parameter";
                more.findings.into_iter().filter(is_sure).collect()
            }
            Err(CaseError::Text { name, text, diagnostics }) => {
                let source = report.source(name, text);
                let of_text = |diagnostic| Finding { source, diagnostic };
                diagnostics.into_iter().map(of_text).collect()
            }
            _ => Vec::new(),
        };
        report.findings.extend(found);
    }
    report.findings.sort_by_key(|finding| (finding.source, finding.diagnostic.span.start));
    // Materials of one potential have its mistakes in common.
    report.findings.dedup();
}

impl Case {
    /// Reads a scene file and everything it names, and makes its points.
    ///
    /// # Errors
    /// Everything that is wrong with the first of scene, potentials, parameters and points that has
    /// anything wrong.
    pub fn read(
        path: &Path,
        overrides: &[String],
        library: &Library<'_>,
    ) -> Result<Case, CaseError> {
        Case::outline(path, overrides, library)?.with_points()
    }

    /// The same without points: of a cloud the file is not read yet, a lattice is not filled.
    ///
    /// # Errors
    /// Everything that is wrong with the first of scene, potential and parameters that has anything
    /// wrong.
    pub fn outline(
        path: &Path,
        overrides: &[String],
        library: &Library<'_>,
    ) -> Result<Case, CaseError> {
        Case::outline_of(&error::read_text(path, MAX_SCENE_BYTES as u64)?, path, overrides, library)
    }

    /// The same of a text that is the scene's, whatever its file holds.
    ///
    /// # Errors
    /// As [`Case::outline`].
    pub fn outline_of(
        text: &str,
        path: &Path,
        overrides: &[String],
        library: &Library<'_>,
    ) -> Result<Case, CaseError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let read = Scene::read_partly(text, &path.display().to_string(), overrides);
        let mut scene = read.map_err(|(mut report, part)| {
            if let Some(scene) = part {
                add_potentials(&mut report, &scene, folder, library);
            }
            CaseError::from(*report)
        })?;
        let materials = scene.materials.iter();
        let potentials: Vec<Potential> = materials
            .map(|material| Potential::read(&scene, material, folder, library))
            .collect::<Result<_, _>>()?;
        if potentials.iter().any(|potential| potential.model.has_gradient_energy()) {
            scene.correspondence.get_or_insert_default();
        } else if scene.correspondence.is_some() {
            return Err(no_gradients(&scene, &potentials));
        }
        for Potential { model, .. } in &potentials {
            let of_cliques: Vec<&str> =
                Measure::ALL.into_iter().flat_map(|measure| model.of_clique(measure)).collect();
            let is_of_family =
                |one: &&str| !["l", "a", "v"].contains(one) && !of_cliques.contains(one);
            let families = model.arguments().into_iter().filter(is_of_family);
            check_corrections(&scene, model.name(), families, FAMILIES)?;
        }
        directions::check_corrections(&scene, &potentials)?;
        let mut warnings = scene.warnings.clone();
        for potential in &potentials {
            let model = &potential.model;
            if model.weighs_volumes() {
                warnings.extend(scene.weigh_volumes(model.name()));
            }
        }
        let has_families = potentials.iter().any(Potential::has_families);
        let has_interactions =
            |p: &Potential| !p.model.measures().is_empty() || !p.model.coupled().is_empty();
        let dissipates = |p: &Potential| !p.model.dissipations().is_empty();
        if has_families && potentials.iter().any(|p| has_interactions(p) || dissipates(p)) {
            // Families sum over volumes: so does what is beside them, unless the scene says otherwise.
            scene.horizon.weigh_volumes();
        }
        if let Some(thickness) = scene.body.thickness
            && !has_families
        {
            let message = "the thickness changes nothing: all energies are of interactions";
            warnings.push(Diagnostic::warning("idle-entry", thickness.span, message).help(
                "energies of `l`, `a` and `v` are per product of areas; psi(F) and energies of \
                 gathered values are per volume",
            ));
        }
        let body = Arc::new(Body::new(scene.body.dimension, &[], &[], None));
        let folder = folder.to_path_buf();
        let columns = Columns::default();
        let case = Case {
            scene,
            potentials,
            body,
            materials: None,
            columns,
            mesh: None,
            content: None,
            warnings,
            folder,
        };
        for potential in &case.potentials {
            case.check_families(potential)?;
        }
        case.check_gradient_functions()?;
        case.check_colour()?;
        Ok(case)
    }

    /// The same with its points.
    ///
    /// # Errors
    /// A cloud that cannot be read, a box that is none, more points than the memory holds.
    pub fn with_points(mut self) -> Result<Case, CaseError> {
        let filled = points::fill(&mut self.scene, &self.folder)?;
        let Filled { body, columns, mesh, content, warnings } = filled;
        self.materials = selection::materials(&self.scene, &body)?.map(Arc::new);
        (self.body, self.columns, self.mesh) = (Arc::new(body), columns, mesh);
        self.content = content;
        self.warnings.extend(warnings);
        self.warnings.extend(self.warnings_of_cracks());
        self.with_fields()
    }

    /// The title of a run with the energies of its body that are modelled, `plate: psi(l) + psi(a) of rubber`;
    /// `modelled` are the names of the parts of the energy.
    pub(crate) fn headline(&self, title: &str, modelled: &[String]) -> String {
        let mut parts: Vec<String> = Vec::new();
        for Potential { model, .. } in &self.potentials {
            let is_modelled = |energy: &&String| {
                modelled.iter().any(|part| is_part_of(part, model.name(), energy))
            };
            let all: Vec<String> =
                model.arguments().iter().map(|argument| format!("psi({argument})")).collect();
            let mut energies: Vec<&str> =
                all.iter().filter(is_modelled).map(String::as_str).collect();
            if energies.is_empty() {
                energies = all.iter().map(String::as_str).collect();
            }
            let part = format!("{} of {}", energies.join(" + "), model.name());
            if !parts.contains(&part) {
                parts.push(part);
            }
        }
        let parts = parts.join(", ");
        if title.is_empty() { parts } else { format!("{title}: {parts}") }
    }

    /// Compiles the energies of all potentials with the derivatives that the scene asks for.
    ///
    /// # Errors
    /// Energies that are too large, or that need what is not there.
    pub fn compile(&self) -> Result<Vec<Compiled>, CaseError> {
        let compile = |(potential, place): (&Potential, (usize, usize))| {
            let mut compiled = potential.compile(&self.scene)?;
            // Of triangles and tetrahedra those count whose coefficient is not 0.
            check_corrections(&self.scene, &compiled.name, compiled.of_interactions(), CLIQUES)?;
            (compiled.law, compiled.layer) = place;
            if !self.scene.regions.is_empty() {
                compiled.label =
                    format!("{} of {}", compiled.name, self.scene.law_name(compiled.law));
            }
            Ok(compiled)
        };
        self.potentials.iter().zip(self.places()).map(compile).collect()
    }

    /// The box whose lattice can be made slab by slab, without the whole: nothing is asked of its points by their number
    /// in a file.
    #[cfg(feature = "petsc")]
    pub(crate) fn box_in_slabs(&self) -> Option<&crate::scene::LatticeShape> {
        let crate::scene::Points::Lattice(shape) = &self.scene.body.points else { return None };
        let is_listed = |set: &crate::scene::SetDefinition| {
            matches!(set.members, crate::scene::Members::Listed { .. })
        };
        (!self.scene.sets.iter().any(is_listed)).then_some(shape)
    }

    /// The same with a slab of its points, without values of what varies; `anywhere` says whether something is so in any
    /// slab.
    ///
    /// # Errors
    /// Points of two materials, or of none.
    #[cfg(feature = "petsc")]
    pub(crate) fn with_slab(
        mut self,
        body: Body,
        anywhere: &dyn Fn(bool) -> bool,
    ) -> Result<Case, CaseError> {
        self.materials = selection::materials_of(&self.scene, &body, anywhere)?.map(Arc::new);
        self.body = Arc::new(body);
        self.warnings.extend(self.warnings_of_cracks());
        Ok(self)
    }

    /// The same body of one of its materials alone; `None` where it has no such material.
    pub fn of_material(&self, name: &str) -> Option<Case> {
        let law = self.scene.regions.iter().position(|region| region.name.value == name)?;
        let mut case = Case { materials: None, ..self.clone() };
        let is_own = |material: &Material| material.law == law;
        let all = self.potentials.iter().zip(&self.scene.materials);
        case.potentials = all.filter(|(_, of)| is_own(of)).map(|(own, _)| own.clone()).collect();
        case.scene.materials.retain(is_own);
        case.scene.materials.iter_mut().for_each(|material| material.law = 0);
        case.scene.regions.clear();
        case.scene.interfaces.clear();
        Some(case)
    }

    /// The same body of each of its materials alone, with their names; itself where it is of one.
    pub fn of_each_material(&self) -> Vec<(Option<&str>, Case)> {
        if self.scene.regions.is_empty() {
            return vec![(None, self.clone())];
        }
        let names = self.scene.regions.iter().map(|region| region.name.value.as_str());
        names.filter_map(|name| Some((Some(name), self.of_material(name)?))).collect()
    }

    /// The thickness of the body in m, by which energies per volume become energies per area; 1 where
    /// there are none, and in three dimensions.
    pub fn thickness(&self) -> f64 {
        let has_families = self.potentials.iter().any(Potential::has_families);
        let stated = self.scene.body.thickness.filter(|_| has_families);
        stated.map_or(1.0, |thickness| thickness.value)
    }

    /// An interaction that cannot be evaluated, in the user's words: points, positions, the energy
    /// and the operation that failed, in several lines.
    pub fn describe(&self, found: &NonFinite) -> String {
        explain::explain(self, found)
    }

    /// The points of sets and probes.
    ///
    /// # Errors
    /// Sets without points, probes outside the body.
    pub fn selection(&self) -> Result<Selection, CaseError> {
        Ok(selection::select(&self.scene, &self.body)?)
    }
}

/// A scene that says how deformation gradients are made for potentials that have none.
fn no_gradients(scene: &Scene, potentials: &[Potential]) -> CaseError {
    let names: Vec<&str> = potentials.iter().map(|potential| potential.model.name()).collect();
    let has = if names.len() == 1 { "has" } else { "have" };
    let names = names.join(" and ");
    let message = format!("[correspondence] needs a psi(F), and {names} {has} none");
    let found = Diagnostic::error("conflicting-keys", scene.material().potential.span, message)
        .label("its energies are of other arguments")
        .help("leave [correspondence] out, or take a potential with psi(F)");
    CaseError::Scene(scene.report(vec![found]))
}

/// Why energies of gathered values have no corrections, and what to write.
const FAMILIES: [&str; 2] = [
    "gathered values are sums over the family that a point has",
    "leave it out, and divide in the potential by what a family sums to, as `linear_peridynamic_solid` \
     does",
];

/// The same of energies of triangles and tetrahedra.
const CLIQUES: [&str; 2] =
    ["triangles and tetrahedra have none", "leave it out, or set their coefficients to 0"];

/// Refuses corrections of bonds beside energies of other arguments; `others` is about those that are none
/// of F.
fn check_corrections<'a>(
    scene: &Scene,
    name: &str,
    mut arguments: impl Iterator<Item = &'a str>,
    others: [&'static str; 2],
) -> Result<(), CaseError> {
    let Some(span) = scene.horizon.correction_span else { return Ok(()) };
    let Some(other) = arguments.find(|argument| *argument != "l") else { return Ok(()) };
    let [label, help] = match other {
        "F" => [
            "deformation gradients are exact for linear fields, at faces as inside",
            "leave it out: psi(F) has its energy per volume at every point",
        ],
        _ => others,
    };
    let message = format!("corrections are of bonds, and {name} has a psi({other})");
    let found = Diagnostic::error("conflicting-keys", span, message).label(label).help(help);
    Err(CaseError::Scene(scene.report(vec![found])))
}
