//! A potential of a scene: its text, the checked model, the values of its parameters, and its energies
//! compiled.

use std::cell::RefCell;
use std::path::Path;

use num_dual::HyperDual64;
use piola_compiler::{
    CoupledKernel, Criterion, Dropped, GatheredKernels, Interval, Kernel, Mode, Model, NextState,
    Of, OfFamily, Setting, ValueError, Values, VectorKernels, check_text, check_text_with,
};
use piola_grammar::Diagnostic;
use piola_mechanics::assembly::Elements;
use piola_mechanics::deformation::Discretisation;
use piola_mechanics::element::{
    CoordinateElement, CoupledElement, Element, MeasureElement, SumElement, VectorElement,
};
use piola_mechanics::kernel::{Coupled, Measure, VariablesLaw};
use piola_mechanics::materials::StateOf;
use piola_mechanics::sheet::PlaneStress;

use super::family::FamilyFunctions;
use super::fields::{self, Columns, Field};
use super::{CaseError, Library, explain};
use crate::scene::{
    DerivativeSource, Material, ParameterSetting, ParameterText, Plane, Points, PotentialText,
    Scene, SolverSettings, files_below,
};

/// One of the potentials whose energies add up.
#[derive(Clone, Debug)]
pub struct Potential {
    /// Its text.
    pub text: PotentialText,
    /// The texts of the files that it imports and of its tables, in the order in which they were read.
    pub(crate) beside: Vec<String>,
    /// The checked potential.
    pub model: Model,
    /// Parameter values and horizon in SI units.
    pub values: Values,
    /// The parameters that vary, in the order of [`Values::fields`].
    pub(crate) fields: Vec<Field>,
}

/// The energies of a potential, ready for assembly, and what is not modelled.
pub struct Compiled {
    /// The name of the potential.
    pub name: String,
    /// The number of its law: that of its material, or of an interface.
    pub law: usize,
    /// How many potentials of the same law come before it: those with one number are of one sum.
    pub layer: usize,
    /// What it is called among others: by its material, where there are several.
    pub label: String,
    /// One element per measure that has an energy.
    pub elements: Elements,
    /// Measures that have an energy, ascending.
    pub measures: Vec<Measure>,
    /// The energy of the deformation gradient.
    pub gradient: Option<Box<dyn VariablesLaw>>,
    /// Energies of what points gather over their families.
    pub gathered: Option<GatheredKernels>,
    /// The same of vectors, and of what both ends of bonds gather, in the place of these.
    pub vectors: Option<VectorKernels>,
    /// What these are functions of, for points and for bonds: `theta`, `l, m`.
    pub arguments: [String; 2],
    /// When its bonds break.
    pub criteria: Vec<Criterion>,
    /// When they do by what families give, and what is remembered with that.
    pub of_families: FamilyFunctions,
    /// What is remembered, and what that becomes.
    pub next_states: Vec<NextState>,
    /// What bonds dissipate, as a function of their rate.
    pub dissipation: Option<Kernel>,
    /// What is left out, and why.
    pub dropped: Vec<Dropped>,
}

impl Compiled {
    /// What its energies of bonds, triangles and tetrahedra are functions of, as written in `psi(..)`.
    pub(crate) fn of_interactions(&self) -> impl Iterator<Item = &str> {
        let Elements { bond, triangle, tetrahedron } = &self.elements;
        [bond, triangle, tetrahedron].into_iter().flatten().map(|element| element.argument())
    }

    /// Whether it has energies of what points gather.
    pub(crate) fn gathers(&self) -> bool {
        self.gathered.is_some() || self.vectors.is_some()
    }

    /// Whether it has energies of interactions; what has no energy at all is refused there.
    pub(crate) fn has_interactions(&self) -> bool {
        !self.measures.is_empty() || (!self.gathers() && self.gradient.is_none())
    }
}

impl Potential {
    /// Whether a parameter changes with t.
    pub(crate) fn changes_in_time(&self) -> bool {
        self.fields.iter().any(|field| !field.is_steady())
    }

    /// Reads and checks what a scene names.
    ///
    /// # Errors
    /// A text that cannot be read or has mistakes, values that its parameters cannot have.
    pub(crate) fn read(
        scene: &Scene,
        material: &Material,
        folder: &Path,
        library: &Library<'_>,
    ) -> Result<Potential, CaseError> {
        let text = scene.potential(material, folder, library.find, library.names)?;
        let folder = text.path.as_deref().and_then(Path::parent);
        let beside = RefCell::new(Vec::new());
        let checked = match folder {
            Some(folder) => check_text_with(&text.text, &|name: &str| {
                files_below(folder)(name).inspect(|found| beside.borrow_mut().push(found.clone()))
            }),
            None => check_text(&text.text),
        };
        let beside = beside.into_inner();
        let (_, model) = checked.map_err(|found| wrong(&text, found))?;
        let mut values = values(scene, material, &model)?.with_states(&model);
        if scene.motion.is_none() || model.families_remember_time() {
            values = values.following_states(&model);
        }
        let mut fields = Vec::new();
        if matches!(scene.body.points, Points::Lattice(_)) {
            let of = (&model, &values);
            fields = Field::of(scene, material, of, &Columns::default())?;
            for (number, field) in values.fields.iter().zip(&fields) {
                values.parameters[usize::from(*number)] = fields::typical(scene, field);
            }
        }
        let potential = Potential { text, beside, model, values, fields };
        potential.check_plane(scene, material)?;
        Ok(potential)
    }

    /// Whether it has energies of families, which are per volume: of F or of gathered values.
    pub(crate) fn has_families(&self) -> bool {
        self.model.has_gradient_energy() || self.model.has_gathered_energy()
    }

    /// Of each field what remembers it, where it changes.
    pub(super) fn which_are_states(&self, scene: &Scene) -> Vec<Option<StateOf>> {
        let kind =
            |field: &u16| Some(stored_at(self.model.kind_of_state(usize::from(*field))?, scene));
        self.values.fields.iter().map(kind).collect()
    }

    /// Refuses plane stress for a potential with other energies than those of F: they would be those
    /// of a solid.
    fn check_plane(&self, scene: &Scene, material: &Material) -> Result<(), CaseError> {
        let others = self.model.arguments().into_iter().find(|argument| *argument != "F");
        let Some(other) = others.filter(|_| is_sheet(scene) && self.model.has_gradient_energy())
        else {
            return Ok(());
        };
        let message = format!(
            "plane stress takes the energies of {} as those of a solid, and psi({other}) is one of the plane",
            self.model.name()
        );
        let found = Diagnostic::error("conflicting-keys", material.potential.span, message)
            .label(format!("it has psi(F) and psi({other})"))
            .help("put psi(F) into a potential of its own, and the others into one that [[material.plus]] names");
        Err(CaseError::Scene(scene.report(vec![found])))
    }

    /// Its energies of gathered values as those of the vectors of bonds.
    ///
    /// # Errors
    /// Energies that are too large.
    pub(crate) fn compile_as_vectors(
        &self,
        scene: &Scene,
    ) -> Result<Option<VectorKernels>, CaseError> {
        let made =
            self.model.compile_as_vectors(&self.values, mode(&scene.solver), scene.solver.form);
        made.map_err(|error| CaseError::compile(&self.text, &error))
    }

    /// Compiles the energies with the derivatives that the solver asks for, for a body of this
    /// dimension.
    ///
    /// # Errors
    /// Energies that are too large, or that need what is not there.
    pub(crate) fn compile(&self, scene: &Scene) -> Result<Compiled, CaseError> {
        let solver = &scene.solver;
        let by_coordinates = solver.derivatives == DerivativeSource::HyperdualCoordinates;
        if solver.derivatives == DerivativeSource::Hyperdual
            && self.values.follow_states(&self.model)
            && !self.model.updates().is_empty()
            && scene.motion.is_none()
        {
            let message =
                "what is remembered needs symbolic derivatives in load steps: hyper-dual numbers hold it"
                    .to_string();
            return Err(CaseError::Body { message });
        }
        if by_coordinates && !self.values.fields.is_empty() {
            let message =
                "derivatives by hyper-dual coordinates know no parameters that vary and no states: choose \
                 \"hyperdual\", which takes them by the measure"
                    .to_string();
            return Err(CaseError::Body { message });
        }
        let compiled = self
            .model
            .compile(&self.values, mode(solver), solver.form)
            .map_err(|error| CaseError::compile(&self.text, &error))?;
        let piola_compiler::Compiled { kernels, gradient, gathered, vectors, coupled, dropped } =
            compiled;
        let criteria = self
            .model
            .criteria(&self.values, mode(solver), solver.form)
            .map_err(|error| CaseError::compile(&self.text, &error))?;
        let how = (mode(solver), solver.form);
        let of_families = FamilyFunctions::new(&self.model, &self.values, how)
            .map_err(|error| CaseError::compile(&self.text, &error))?;
        let next_states = self
            .model
            .next_states(&self.values, mode(solver), solver.form)
            .map_err(|error| CaseError::compile(&self.text, &error))?;
        let dissipation = self
            .model
            .dissipation(&self.values, mode(solver))
            .map_err(|error| CaseError::compile(&self.text, &error))?;
        let left = [gradient.is_some(), gathered.is_some() || vectors.is_some()];
        if let Some(what) = of_families.without_energy(left) {
            let name = self.model.name();
            let message = format!(
                "parameters leave nothing of the energies of {what} of {name}, by which bonds break or something \
                 is remembered: give parameters that leave some of them, or take a potential without these lines"
            );
            return Err(CaseError::Body { message });
        }
        let mut elements = Elements::default();
        if by_coordinates && !coupled.is_empty() {
            let message =
                "derivatives by hyper-dual coordinates know energies of one measure: choose \
                 \"hyperdual\", which takes several by the measures"
                    .to_string();
            return Err(CaseError::Body { message });
        }
        let measures = kernels.iter().map(Kernel::measure);
        let mut measures: Vec<Measure> =
            measures.chain(coupled.iter().map(|k| k.clique())).collect();
        measures.sort_unstable();
        measures.dedup();
        for kernel in kernels {
            let measure = kernel.measure();
            let element = Some(self.element(kernel, scene));
            match measure {
                Measure::Length => elements.bond = element,
                Measure::Area => elements.triangle = element,
                Measure::Volume => elements.tetrahedron = element,
            }
        }
        for kernel in coupled {
            let element = self.coupled_element(kernel, scene);
            let place = match element.measure() {
                Measure::Length => &mut elements.bond,
                Measure::Area => &mut elements.triangle,
                Measure::Volume => &mut elements.tetrahedron,
            };
            *place = Some(match place.take() {
                Some(first) => Box::new(SumElement::new(first, element)),
                None => element,
            });
        }
        let gradient = gradient.map(|kernel| -> Box<dyn VariablesLaw> {
            if is_sheet(scene) { Box::new(PlaneStress::new(kernel)) } else { Box::new(kernel) }
        });
        let (name, label) = (self.model.name().to_string(), self.model.name().to_string());
        let arguments = [false, true].map(|of_bonds| self.arguments(of_bonds));
        let (law, layer) = (0, 0);
        Ok(Compiled {
            name,
            law,
            layer,
            label,
            elements,
            measures,
            gradient,
            gathered,
            vectors,
            arguments,
            criteria,
            of_families,
            next_states,
            dissipation,
            dropped,
        })
    }

    fn element(&self, kernel: Kernel, scene: &Scene) -> Box<dyn Element> {
        let (measure, dimension) = (kernel.measure(), scene.body.dimension);
        let forbids_inversion = self.declares_positive(measure);
        if scene.solver.derivatives == DerivativeSource::HyperdualCoordinates {
            let written = self.model.written(&self.values, measure);
            let psi = move |m: HyperDual64, reference: f64| {
                written.evaluate(m, HyperDual64::from_re(reference))
            };
            let mut element = CoordinateElement::new(measure, dimension, psi);
            if forbids_inversion {
                element.forbid_inversion();
            }
            return Box::new(element);
        }
        let mut element = MeasureElement::new(measure, dimension, Box::new(kernel));
        if forbids_inversion {
            element.forbid_inversion();
        }
        Box::new(element)
    }

    fn coupled_element(&self, kernel: CoupledKernel, scene: &Scene) -> Box<dyn Element> {
        let (measure, law) = (kernel.clique(), Box::new(Coupled::new(kernel)));
        if measure == Measure::Length {
            return Box::new(VectorElement::new(scene.body.dimension, law));
        }
        let mut element = CoupledElement::new(measure, scene.body.dimension, law);
        if self.declares_positive(measure) {
            element.forbid_inversion();
        }
        Box::new(element)
    }

    /// Whether the potential declares a domain that a measure leaves at 0 or before it is negative.
    fn declares_positive(&self, measure: Measure) -> bool {
        let Some(variant) = self.model.variant(self.values.dimension) else { return false };
        let read = [0.0, -1.0].map(|m| explain::read(&variant.graph, &self.values, m, 1.0));
        let leaves =
            |domain: &Interval| read.iter().any(|r| !domain.contains(r.number(domain.root)));
        let own = piola_compiler::Argument::Measure(measure);
        variant.domains.iter().any(|domain| domain.argument == own && leaves(domain))
    }

    /// What the energies of gathered values are functions of: `theta`, or `theta) + psi(phi`.
    fn arguments(&self, of_bonds: bool) -> String {
        let energies = self.model.variant(self.values.dimension).map(|v| &v.gathered_energies);
        let mut heads: Vec<&str> = Vec::new();
        for energy in energies.into_iter().flatten().filter(|energy| energy.of_bonds == of_bonds) {
            if !heads.contains(&energy.head.as_str()) {
                heads.push(&energy.head);
            }
        }
        heads.join(") + psi(")
    }

    /// What is wrong with the potential, at its places in the text.
    pub(crate) fn wrong(&self, diagnostics: Vec<Diagnostic>) -> CaseError {
        wrong(&self.text, diagnostics)
    }

    /// Values with other parameters.
    ///
    /// # Errors
    /// What is wrong with them.
    pub(crate) fn values_for(
        &self,
        parameters: &[(String, Setting)],
    ) -> Result<Values, Vec<ValueError>> {
        self.model.values(self.values.dimension, parameters, Some(self.values.horizon))
    }
}

fn wrong(potential: &PotentialText, diagnostics: Vec<Diagnostic>) -> CaseError {
    CaseError::Text { name: potential.place(), text: potential.text.clone(), diagnostics }
}

/// How derivatives are evaluated.
fn mode(solver: &SolverSettings) -> Mode {
    match solver.derivatives {
        DerivativeSource::Jit => Mode::Jit(solver.level),
        DerivativeSource::Interpreter => Mode::Interpreter,
        DerivativeSource::Hyperdual | DerivativeSource::HyperdualCoordinates => Mode::HyperDual,
    }
}

/// Whether the body is in plane stress: its energies of F are those of a solid.
pub(crate) fn is_sheet(scene: &Scene) -> bool {
    scene.correspondence.as_ref().is_some_and(|settings| settings.plane == Plane::Stress)
}

/// The parameters that a scene gives.
pub(crate) fn settings(scene: &Scene, material: &Material) -> Vec<(String, Setting)> {
    let setting = |parameter: &ParameterSetting| match &parameter.value.value {
        // Typical values come with the expressions.
        _ if fields::varying(scene, parameter).is_some() => Setting::Field(1.0),
        ParameterText::Number(number) => Setting::Number(*number),
        ParameterText::Quantity(text) => Setting::Text(text.clone()),
    };
    let given = material.parameters.iter();
    given.map(|p| (p.name.value.clone(), setting(p))).collect()
}

/// Values of the parameters; what is wrong with one is shown at its place in the scene.
fn values(scene: &Scene, material: &Material, model: &Model) -> Result<Values, CaseError> {
    let horizon = Some(scene.horizon_radius());
    let is_solid = is_sheet(scene) && model.has_gradient_energy();
    let dimension = if is_solid { 3 } else { scene.body.dimension };
    model.values(dimension, &settings(scene, material), horizon).map_err(|errors| {
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

/// What remembers states of a kind: bonds do with their own deformation gradients, points with theirs.
pub(super) fn stored_at(kind: Of, scene: &Scene) -> StateOf {
    let at_bonds = scene
        .correspondence
        .as_ref()
        .is_none_or(|settings| settings.discretisation == Discretisation::BondQuadrature);
    match kind {
        Of::Measure(measure) => StateOf::Interactions(measure),
        Of::Family(OfFamily::Gradient) if at_bonds => StateOf::Interactions(Measure::Length),
        Of::Family(_) => StateOf::Points,
    }
}
