//! A scene made ready: body, compiled energies, discrete energy, boundary conditions.
//!
//! | stage | what |
//! |---|---|
//! | [`Case::outline`] | scene, potential and parameter values checked together |
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
mod rehearsal;
mod run;
mod size;

pub use cost::{LinearCost, PassCost, SceneCost, cost};
pub use equilibrium::{Attempt, Equilibrium, NamedVector, solve};
pub use error::CaseError;
pub use model::ModelledEnergy;
pub use run::{Ending, RunError, RunOptions, run};

use std::path::{Path, PathBuf};
use std::sync::Arc;

use num_dual::HyperDual64;
use piola_compiler::{
    Dropped, GatheredKernels, Interval, Kernel, Mode, Model, Setting, Values, check_text,
};
use piola_grammar::Diagnostic;

use crate::assembly::Elements;
use crate::body::Body;
use crate::element::{CoordinateElement, Element, MeasureElement};
use crate::energy::NonFinite;
use crate::kernel::{Measure, VariablesLaw};
use crate::lattice::Lattice;
use crate::moduli::moduli;
use crate::output::read::read_cloud;
use crate::scene::selection::{self, Selection};
use crate::scene::{
    DerivativeSource, MAX_SCENE_BYTES, ParameterText, Plane, Points, PotentialText, Scene,
};
use crate::sheet::PlaneStress;

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

/// A scene with its potential and its body.
#[derive(Clone, Debug)]
pub struct Case {
    /// The scene.
    pub scene: Scene,
    /// The text of its potential.
    pub potential: PotentialText,
    /// The checked potential.
    pub model: Model,
    /// Parameter values and horizon in SI units.
    pub values: Values,
    /// The points that are left after removals.
    pub body: Arc<Body>,
    /// Findings about the scene that do not stop the work; spans as in [`Scene::report`].
    pub warnings: Vec<Diagnostic>,
    /// Where the scene is: a cloud is named relative to it.
    folder: PathBuf,
}

/// Energies ready for assembly, and what is not modelled.
pub struct Compiled {
    /// One element per measure that has an energy.
    pub elements: Elements,
    /// Measures that have an energy, ascending.
    pub measures: Vec<Measure>,
    /// The energy of the deformation gradient.
    pub gradient: Option<Box<dyn VariablesLaw>>,
    /// Energies of what points gather over their families.
    pub gathered: Option<GatheredKernels>,
    /// psi(l) beside them: it is then no element.
    pub plain: Option<Kernel>,
    /// What is left out, and why.
    pub dropped: Vec<Dropped>,
}

impl Case {
    /// Reads a scene file and everything it names, and makes its points.
    ///
    /// # Errors
    /// Everything that is wrong with the first of scene, potential, parameters and points that has
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
        let potential = scene.potential(folder, library.find, library.names)?;
        let model = checked(&potential)?;
        let values = values(&scene, &model)?;
        if model.has_gradient_energy() {
            scene.correspondence.get_or_insert_default();
        } else if scene.correspondence.is_some() {
            let message = format!("[correspondence] needs a psi(F), and {} has none", model.name());
            let place = scene.material.potential.span;
            let found = Diagnostic::error("conflicting-keys", place, message)
                .label("its energies are of other arguments")
                .help("leave [correspondence] out, or take a potential with psi(F)");
            return Err(CaseError::Scene(scene.report(vec![found])));
        }
        let mut warnings = scene.warnings.clone();
        if model.weighs_volumes() {
            warnings.extend(scene.weigh_volumes(model.name()));
        }
        if let Some(thickness) = scene.body.thickness
            && !has_thickness(&model)
        {
            let message = "the thickness changes nothing: all energies are of interactions";
            warnings.push(Diagnostic::warning("idle-entry", thickness.span, message).help(
                "energies of `l`, `a` and `v` are per product of areas; psi(F) and energies of \
                 gathered values are per volume",
            ));
        }
        let body = Arc::new(Body::new(scene.body.dimension, &[], &[], None));
        let folder = folder.to_path_buf();
        Ok(Case { scene, potential, model, values, body, warnings, folder })
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

    /// Compiles the energies with the derivatives that the scene asks for.
    ///
    /// # Errors
    /// Energies that are too large, or that need what is not there.
    pub fn compile(&self) -> Result<Compiled, CaseError> {
        let mode = match self.scene.solver.derivatives {
            DerivativeSource::Jit => Mode::Jit(self.scene.solver.level),
            DerivativeSource::Interpreter => Mode::Interpreter,
            DerivativeSource::Hyperdual | DerivativeSource::HyperdualCoordinates => Mode::HyperDual,
        };
        let form = self.scene.solver.form;
        let piola_compiler::Compiled { kernels, gradient, gathered, dropped } = self
            .model
            .compile(&self.values, mode, form)
            .map_err(|error| CaseError::compile(&self.potential, &error))?;
        let dimension = self.scene.body.dimension;
        let in_coordinates =
            self.scene.solver.derivatives == DerivativeSource::HyperdualCoordinates;
        let mut elements = Elements::default();
        let mut measures = Vec::new();
        let mut plain = None;
        for kernel in kernels {
            let measure = kernel.measure();
            measures.push(measure);
            if gathered.is_some() && measure == Measure::Length {
                plain = Some(kernel);
                continue;
            }
            let element: Box<dyn Element> = if in_coordinates {
                let written = self.model.written(&self.values, measure);
                let psi = move |m: HyperDual64, reference: f64| {
                    written.evaluate(m, HyperDual64::from_re(reference))
                };
                let mut element = CoordinateElement::new(measure, dimension, psi);
                if self.declares_positive(measure) {
                    element.forbid_inversion();
                }
                Box::new(element)
            } else {
                let mut element = MeasureElement::new(measure, dimension, Box::new(kernel));
                if self.declares_positive(measure) {
                    element.forbid_inversion();
                }
                Box::new(element)
            };
            match measure {
                Measure::Length => elements.bond = Some(element),
                Measure::Area => elements.triangle = Some(element),
                Measure::Volume => elements.tetrahedron = Some(element),
            }
        }
        let gradient = gradient.map(|kernel| -> Box<dyn VariablesLaw> {
            if is_sheet(&self.scene) {
                Box::new(PlaneStress::new(kernel))
            } else {
                Box::new(kernel)
            }
        });
        Ok(Compiled { elements, measures, gradient, gathered, plain, dropped })
    }

    /// The thickness of the body in m, by which energies per volume become energies per area; 1 where
    /// there are none, and in three dimensions.
    pub fn thickness(&self) -> f64 {
        let stated = self.scene.body.thickness.filter(|_| has_thickness(&self.model));
        stated.map_or(1.0, |thickness| thickness.value)
    }

    /// Whether the potential declares a domain that a measure leaves at 0 or before it is negative.
    fn declares_positive(&self, measure: Measure) -> bool {
        let Some(variant) = self.model.variant(self.body.dimension()) else { return false };
        let read = [0.0, -1.0].map(|m| explain::read(&variant.graph, &self.values, m, 1.0));
        let leaves =
            |domain: &Interval| read.iter().any(|r| !domain.contains(r.number(domain.root)));
        let own = piola_compiler::Argument::Measure(measure);
        variant.domains.iter().any(|domain| domain.argument == own && leaves(domain))
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
    /// What [`Model::unfit_at_rest`] finds, at its place in the potential.
    pub fn check_rest(&self) -> Result<(), CaseError> {
        let mut diagnostics = self.model.unfit_at_rest(&self.values);
        diagnostics.extend(self.unfit_lattice());
        if diagnostics.is_empty() {
            return Ok(());
        }
        let (name, text) = (self.potential.name.clone(), self.potential.text.clone());
        Err(CaseError::Text { name, text, diagnostics })
    }

    /// Stress at rest, and strains that cost nothing, of energies of F and of gathered values inside a
    /// lattice: what they are for one point does not tell.
    fn unfit_lattice(&self) -> Vec<Diagnostic> {
        let is_lattice = matches!(self.scene.body.points, Points::Lattice(_));
        let has_others = self.model.has_gradient_energy() || self.model.has_gathered_energy();
        if !is_lattice || !has_others {
            return Vec::new();
        }
        // What is no number at rest is named by the run itself, with its place.
        let Ok(found) = moduli(self, None) else { return Vec::new() };
        let size = |values: &[f64]| values.iter().fold(0.0f64, |size, x| size.max(x.abs()));
        let (stress, kelvin) = (size(&found.stress), found.stiffness.kelvin());
        let largest = size(&kelvin);
        let stressed = (stress > NO_STRESS * largest).then(|| {
            let message =
                format!("the body is not stress-free: {stress:.3e} Pa at rest, of moduli of {largest:.3e} Pa");
            self.model.unfit_tensor_energy("not-stress-free", message)
        });
        let soft = (!found.stiffness.is_stable()).then(|| {
            let least = kelvin.iter().copied().fold(f64::INFINITY, f64::min);
            let message = format!(
                "the body is not stiff at rest: against one strain its modulus is {least:.3e} Pa, the \
                 largest is {largest:.3e} Pa"
            );
            self.model.unfit_tensor_energy("not-stiff-at-rest", message)
        });
        stressed.into_iter().chain(soft).flatten().collect()
    }

    /// The points of sets and probes.
    ///
    /// # Errors
    /// Sets without points, probes outside the body.
    pub fn selection(&self) -> Result<Selection, CaseError> {
        Ok(selection::select(&self.scene, &self.body)?)
    }
}

/// Whether a model has energies per volume, which a thickness multiplies.
fn has_thickness(model: &Model) -> bool {
    model.has_gradient_energy() || model.has_gathered_energy()
}

/// Whether the body is in plane stress: its energy is that of a solid.
fn is_sheet(scene: &Scene) -> bool {
    scene.correspondence.as_ref().is_some_and(|settings| settings.plane == Plane::Stress)
}

fn checked(potential: &PotentialText) -> Result<Model, CaseError> {
    let wrong = |diagnostics| CaseError::Text {
        name: potential.name.clone(),
        text: potential.text.clone(),
        diagnostics,
    };
    check_text(&potential.text).map(|(_, model)| model).map_err(wrong)
}

/// The parameters that a scene gives.
pub(crate) fn settings(scene: &Scene) -> Vec<(String, Setting)> {
    let setting = |text: &ParameterText| match text {
        ParameterText::Number(number) => Setting::Number(*number),
        ParameterText::Quantity(text) => Setting::Text(text.clone()),
    };
    let given = scene.material.parameters.iter();
    given.map(|p| (p.name.value.clone(), setting(&p.value.value))).collect()
}

/// Values of the parameters; what is wrong with one is shown at its place in the scene.
fn values(scene: &Scene, model: &Model) -> Result<Values, CaseError> {
    let material = &scene.material;
    let settings = settings(scene);
    let horizon = Some(scene.horizon_radius());
    let dimension = if is_sheet(scene) { 3 } else { scene.body.dimension };
    model.values(dimension, &settings, horizon).map_err(|errors| {
        let diagnostics = errors.into_iter().map(|error| {
            let given = material.parameters.iter().find(|p| p.name.value == error.parameter);
            let span = match (given, error.code) {
                (Some(given), "unknown-parameter") => given.name.span,
                (Some(given), _) => given.value.span,
                (None, _) => material.potential.span,
            };
            Diagnostic::error(error.code, span, error.message).help(error.help)
        });
        CaseError::Scene(scene.report(diagnostics.collect()))
    })
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
