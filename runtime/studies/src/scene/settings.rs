//! What a scene says of how it is solved and what is written: `[steps]`, `[solver]`, `[output]`.

use piola_compiler::Form;
use piola_mechanics::energy::Products;
use piola_mechanics::kernel::Level;
use piola_mechanics::words::Words;
use piola_solvers::linear::{LinearMethod, PreconditionerChoice};
use piola_solvers::newton::NewtonVariant;
use piola_solvers::steps::{BreakSettings, Breaking, Control, Find, Start};

/// `[steps]`: t runs from 0 to `end` in equal increments.
#[derive(Clone, Debug, PartialEq)]
pub struct Steps {
    /// The last t.
    pub end: f64,
    /// How many increments there are, unless the solver cuts back.
    pub increments: usize,
    /// How an equilibrium is found.
    pub find: Find,
    /// What steps go by.
    pub control: Control,
    /// Where bonds break: which of them do at a step.
    pub breaking: Breaking,
    /// By which share of the way from rest a bond may be behind the first and break in one event with it.
    pub tie: f64,
    /// After how many events a run ends.
    pub events: usize,
    /// After how many steps along the way a run ends.
    pub arcs: usize,
}

impl Default for Steps {
    fn default() -> Self {
        let BreakSettings { control, breaking, tie, events, arcs, .. } = BreakSettings::default();
        let find = Find::default();
        Steps { end: 1.0, increments: 25, find, control, breaking, tie, events, arcs }
    }
}

/// `[solver]`: how equilibrium is found.
#[derive(Clone, Debug, PartialEq)]
pub struct SolverSettings {
    /// 2-norm of the free residual over the larger of the 2-norms of reactions and applied loads.
    pub tolerance: f64,
    /// Where an increment starts.
    pub start: Start,
    /// How much of each Newton step is new.
    pub newton: NewtonVariant,
    /// How linear systems are solved.
    pub linear: LinearMethod,
    /// What makes conjugate gradients and GMRES converge.
    pub preconditioner: PreconditionerChoice,
    /// How products with the tangent come about.
    pub products: Products,
    /// Where the derivatives come from.
    pub derivatives: DerivativeSource,
    /// Level of the machine code.
    pub level: Level,
    /// In which form energies are evaluated.
    pub form: Form,
    /// What strain is computed from.
    pub strain: StrainSource,
    /// How passes go over the interactions.
    pub passes: Passes,
    /// Newton iterations per increment.
    pub max_iterations: usize,
    /// What an end state that is not stable means.
    pub unstable: Unstable,
}

impl Default for SolverSettings {
    fn default() -> Self {
        SolverSettings {
            tolerance: 1e-10,
            start: Start::default(),
            newton: NewtonVariant::default(),
            linear: LinearMethod::default(),
            preconditioner: PreconditionerChoice::default(),
            products: Products::default(),
            derivatives: DerivativeSource::default(),
            level: Level::default(),
            form: Form::default(),
            strain: StrainSource::default(),
            passes: Passes::default(),
            max_iterations: 25,
            unstable: Unstable::default(),
        }
    }
}

/// What an end state means whose tangent is not positive definite: a maximum or a saddle of the
/// energy, which no body keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unstable {
    /// The run has failed.
    #[default]
    Fail,
    /// It is what the scene is about.
    Accept,
}

impl Words for Unstable {
    const WORDS: &'static [(&'static str, Unstable)] =
        &[("fail", Unstable::Fail), ("accept", Unstable::Accept)];
}

/// Where psi' and psi'' come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DerivativeSource {
    /// Machine code of the symbolic derivatives.
    #[default]
    Jit,
    /// The symbolic derivatives, interpreted.
    Interpreter,
    /// Hyper-dual numbers of the measure.
    Hyperdual,
    /// Hyper-dual numbers of the points' coordinates, as in firooz2023.
    HyperdualCoordinates,
}

impl Words for DerivativeSource {
    const WORDS: &'static [(&'static str, DerivativeSource)] = &[
        ("jit", DerivativeSource::Jit),
        ("interpreter", DerivativeSource::Interpreter),
        ("hyperdual", DerivativeSource::Hyperdual),
        ("hyperdual-coordinates", DerivativeSource::HyperdualCoordinates),
    ];
}

/// What strain is computed from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StrainSource {
    /// Displacements.
    #[default]
    Displacements,
    /// Current positions, rounded as a program that stores them has them; to compare with.
    Positions,
}

impl Words for StrainSource {
    const WORDS: &'static [(&'static str, StrainSource)] =
        &[("displacements", StrainSource::Displacements), ("positions", StrainSource::Positions)];
}

/// How passes go over the interactions of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passes {
    /// The shortest way: along the rows of a lattice or by fours, without kernels where laws are affine.
    #[default]
    Auto,
    /// Along lists of neighbours, in batches through kernels; to compare with.
    Batches,
}

impl Words for Passes {
    const WORDS: &'static [(&'static str, Passes)] =
        &[("auto", Passes::Auto), ("batches", Passes::Batches)];
}

/// `[output]`: what is written.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSettings {
    /// How many frames the run writes after the undeformed one.
    pub frames: usize,
    /// Of a motion: the time between frames in s, in place of their number.
    pub every: Option<f64>,
    /// Of a motion: how many rows its tables have after the first.
    pub rows: usize,
    /// Of a motion: the time of the wall between checkpoints in s.
    pub checkpoint: f64,
    /// What frames have of every point beside displacement and residual.
    pub fields: Vec<FrameField>,
    /// What the picture's colours show.
    pub colour: ColourBy,
}

/// What the colours of a picture show.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ColourBy {
    /// The magnitude of the displacement.
    #[default]
    Displacement,
    /// The magnitude of the velocity.
    Velocity,
    /// That of the acceleration.
    Acceleration,
    /// The field of this name.
    EnergyDensity,
    /// The field of this name.
    Damage,
    /// The field `damage_a`.
    DamageOfAreas,
    /// The field `damage_v`.
    DamageOfVolumes,
    /// The mean of what bonds of a point remember as this.
    State(String),
    /// The field of this name.
    Jacobian,
    /// The field of this name.
    VonMises,
}

impl ColourBy {
    /// All but the states, with their words.
    const WORDS: [(&'static str, ColourBy); 9] = [
        ("displacement", ColourBy::Displacement),
        ("velocity", ColourBy::Velocity),
        ("acceleration", ColourBy::Acceleration),
        ("energy_density", ColourBy::EnergyDensity),
        ("damage", ColourBy::Damage),
        ("damage_a", ColourBy::DamageOfAreas),
        ("damage_v", ColourBy::DamageOfVolumes),
        ("jacobian", ColourBy::Jacobian),
        ("von_mises", ColourBy::VonMises),
    ];

    /// As a scene has it: one of its words, or `state NAME`.
    pub fn of_word(word: &str) -> Option<ColourBy> {
        if let Some(state) = word.strip_prefix(STATE) {
            return (!state.is_empty()).then(|| ColourBy::State(state.to_owned()));
        }
        ColourBy::WORDS.into_iter().find(|(own, _)| *own == word).map(|(_, colour)| colour)
    }

    /// What a scene may have.
    pub fn words() -> Vec<&'static str> {
        ColourBy::WORDS.iter().map(|(word, _)| *word).chain(["state NAME"]).collect()
    }

    /// As a scene has it.
    pub fn word(&self) -> String {
        match self {
            ColourBy::State(name) => format!("{STATE}{name}"),
            other => {
                let own = ColourBy::WORDS.into_iter().find(|(_, colour)| colour == other);
                own.map_or_else(String::new, |(word, _)| word.to_owned())
            }
        }
    }
}

/// How the name of a field begins that has the means of a state.
pub(crate) const STATE: &str = "state ";

/// What a frame may have of every point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameField {
    /// Its energy over its volume.
    EnergyDensity,
    /// `F`.
    DeformationGradient,
    /// `det F`.
    Jacobian,
    /// Green and Lagrange's strain.
    Strain,
    /// Singular values of `F`.
    PrincipalStretches,
    /// First Piola-Kirchhoff stress.
    PiolaStress,
    /// Cauchy's stress.
    Stress,
    /// The equivalent of it by von Mises.
    VonMises,
    /// Its eigenvalues.
    PrincipalStresses,
    /// Of a motion.
    Acceleration,
    /// The share of its neighbours' volume whose bonds with it are broken.
    Damage,
    /// The share of the triangles at it that are gone.
    DamageOfAreas,
    /// The share of the tetrahedra at it that are gone.
    DamageOfVolumes,
    /// The means of what its bonds remember.
    States,
    /// How many points are within the horizon.
    Neighbours,
    /// Which sets a point is in.
    Sets,
}

impl Words for FrameField {
    const WORDS: &'static [(&'static str, FrameField)] = &[
        ("energy_density", FrameField::EnergyDensity),
        ("deformation_gradient", FrameField::DeformationGradient),
        ("jacobian", FrameField::Jacobian),
        ("strain", FrameField::Strain),
        ("principal_stretches", FrameField::PrincipalStretches),
        ("piola_stress", FrameField::PiolaStress),
        ("stress", FrameField::Stress),
        ("von_mises", FrameField::VonMises),
        ("principal_stresses", FrameField::PrincipalStresses),
        ("acceleration", FrameField::Acceleration),
        ("damage", FrameField::Damage),
        ("damage_a", FrameField::DamageOfAreas),
        ("damage_v", FrameField::DamageOfVolumes),
        ("states", FrameField::States),
        ("neighbours", FrameField::Neighbours),
        ("sets", FrameField::Sets),
    ];
}

impl Default for OutputSettings {
    fn default() -> Self {
        OutputSettings {
            frames: 25,
            every: None,
            rows: 1000,
            checkpoint: 600.0,
            fields: Vec::new(),
            colour: ColourBy::default(),
        }
    }
}
