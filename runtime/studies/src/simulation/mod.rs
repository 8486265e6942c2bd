//! A scene made ready: body, compiled energies, discrete energy, boundary conditions.
//!
//! | stage | what |
//! |---|---|
//! | [`Case::outline`] | scene, potentials and parameter values checked together |
//! | [`Case::read`] | the same, and the body built |
//! | [`Case::plan`] | what will be modelled and what it costs |
//! | [`Case::energy`] | the discrete total energy |
//! | [`run()`] | load steps, with everything they leave in the output folder |
//! | [`cost()`] | time and memory of every phase up to the first linear system |
//! | [`solve()`] | load steps, and only the last equilibrium |

mod cost;
mod equilibrium;
mod error;
mod explain;
mod forecast;
mod model;
mod potential;
mod rehearsal;
mod run;
mod size;

pub use cost::{LinearCost, PassCost, SceneCost, cost};
pub use equilibrium::{Attempt, Equilibrium, NamedVector, solve};
pub use error::CaseError;
pub(crate) use model::state_laws;
pub(crate) use potential::settings;
pub use potential::{Compiled, Potential};
pub use run::{Ending, RunError, RunOptions, run};

use std::path::{Path, PathBuf};
use std::sync::Arc;

use piola_grammar::Diagnostic;

use crate::moduli::moduli;
use crate::scene::selection::{self, Selection};
use crate::scene::{MAX_SCENE_BYTES, Points, Scene};
use piola_mechanics::body::Body;
use piola_mechanics::energy::NonFinite;
use piola_mechanics::kernel::Measure;
use piola_mechanics::lattice::Lattice;
use piola_output::read::read_cloud;

/// Largest point cloud that is read, in bytes.
const MAX_CLOUD_BYTES: u64 = 1 << 30;

/// Stress at rest over the largest modulus that is rounding.
const NO_STRESS: f64 = 1e-9;

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
    /// Findings about the scene that do not stop the work; spans as in [`Scene::report`].
    pub warnings: Vec<Diagnostic>,
    /// Where the scene is: a cloud is named relative to it.
    folder: PathBuf,
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
        let text = error::read_text(path, MAX_SCENE_BYTES as u64)?;
        let mut scene = Scene::read(&text, &path.display().to_string(), overrides)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let materials = scene.materials.iter();
        let potentials: Vec<Potential> = materials
            .map(|material| Potential::read(&scene, material, folder, library))
            .collect::<Result<_, _>>()?;
        if potentials.iter().any(|potential| potential.model.has_gradient_energy()) {
            scene.correspondence.get_or_insert_default();
        } else if scene.correspondence.is_some() {
            return Err(no_gradients(&scene, &potentials));
        }
        let mut warnings = scene.warnings.clone();
        for potential in &potentials {
            let model = &potential.model;
            if model.weighs_volumes() {
                warnings.extend(scene.weigh_volumes(model.name()));
            }
        }
        let has_families = potentials.iter().any(Potential::has_families);
        if has_families && potentials.iter().any(|p| !p.model.measures().is_empty()) {
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
        Ok(Case { scene, potentials, body, warnings, folder })
    }

    /// The same with its points.
    ///
    /// # Errors
    /// A cloud that cannot be read, a box that is none, more points than the memory holds.
    pub fn with_points(mut self) -> Result<Case, CaseError> {
        let (body, warnings) = body(&self.scene, &self.folder)?;
        self.body = Arc::new(body);
        self.warnings.extend(warnings);
        Ok(self)
    }

    /// Compiles the energies of all potentials with the derivatives that the scene asks for.
    ///
    /// # Errors
    /// Energies that are too large, or that need what is not there.
    pub fn compile(&self) -> Result<Vec<Compiled>, CaseError> {
        self.potentials.iter().map(|potential| potential.compile(&self.scene)).collect()
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

    /// Refuses energies that have a force at rest, or leave the body without stiffness, for the
    /// scene's values.
    ///
    /// # Errors
    /// What [`Model::unfit_at_rest`](piola_compiler::Model::unfit_at_rest) finds, at its place in the
    /// potential.
    pub fn check_rest(&self) -> Result<(), CaseError> {
        let is_stiff = |number: usize| {
            let others = self.potentials.iter().enumerate().filter(|(other, _)| *other != number);
            others.into_iter().any(|(_, other)| {
                other.has_families() || other.model.measures().contains(&Measure::Length)
            })
        };
        for (number, potential) in self.potentials.iter().enumerate() {
            let found = potential.model.unfit_at_rest(&potential.values, is_stiff(number));
            if !found.is_empty() {
                return Err(potential.wrong(found));
            }
        }
        self.unfit_lattice().map_or(Ok(()), Err)
    }

    /// Stress at rest, and strains that cost nothing, of sums of energies and of energies of F and of
    /// gathered values inside a lattice: what they are for one interaction or point does not tell.
    fn unfit_lattice(&self) -> Option<CaseError> {
        let is_lattice = matches!(self.scene.body.points, Points::Lattice(_));
        // The message is about the first potential of families, or the first of all.
        let families = self.potentials.iter().find(|potential| potential.has_families());
        let several = self.potentials.first().filter(|_| self.potentials.len() > 1);
        let potential = families.or(several).filter(|_| is_lattice)?;
        // What is no number at rest is named by the run itself, with its place.
        let found = moduli(self, None).ok()?;
        let size = |values: &[f64]| values.iter().fold(0.0f64, |size, x| size.max(x.abs()));
        let (stress, kelvin) = (size(&found.stress), found.stiffness.kelvin());
        let largest = size(&kelvin);
        let stressed = (stress > NO_STRESS * largest).then(|| {
            let message =
                format!("the body is not stress-free: {stress:.3e} Pa at rest, of moduli of {largest:.3e} Pa");
            potential.model.unfit_sum("not-stress-free", message)
        });
        let soft = (!found.stiffness.is_stable()).then(|| {
            let least = kelvin.iter().copied().fold(f64::INFINITY, f64::min);
            let message = format!(
                "the body is not stiff at rest: against one strain its modulus is {least:.3e} Pa, the \
                 largest is {largest:.3e} Pa"
            );
            potential.model.unfit_sum("not-stiff-at-rest", message)
        });
        let found: Vec<Diagnostic> = stressed.into_iter().chain(soft).flatten().collect();
        (!found.is_empty()).then(|| potential.wrong(found))
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

/// The points of the scene without those that it removes.
fn body(scene: &Scene, folder: &Path) -> Result<(Body, Vec<Diagnostic>), CaseError> {
    let dimension = scene.body.dimension;
    let (positions, volumes, spacing) = match &scene.body.points {
        Points::Lattice(shape) => {
            let lattice = Lattice {
                lower: shape.low.clone(),
                upper: shape.high.clone(),
                spacing: shape.spacing,
                nodes: shape.nodes,
            };
            size::check_lattice(shape)?;
            let points = lattice.points()?;
            (points.positions, points.volumes, Some(shape.spacing))
        }
        Points::Cloud { path } => {
            let file = folder.join(&path.value);
            let text = error::read_text(&file, MAX_CLOUD_BYTES)?;
            let cloud = read_cloud(&text, dimension)
                .map_err(|error| CaseError::table(&file, &text, error))?;
            (cloud.positions, cloud.volumes, None)
        }
    };
    let kept = selection::kept(scene, &positions, &volumes, spacing)?;
    let rows = positions.chunks_exact(dimension).zip(&volumes).zip(&kept.keep);
    let mut left = (Vec::new(), Vec::new());
    for ((position, volume), _) in rows.filter(|(_, keep)| **keep) {
        left.0.extend_from_slice(position);
        left.1.push(*volume);
    }
    Ok((Body::new(dimension, &left.0, &left.1, spacing), kept.warnings))
}
