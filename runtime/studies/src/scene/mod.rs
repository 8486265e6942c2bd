//! Scenes: what a user writes in TOML about a body and what is done to it.
//!
//! | stage | input | output |
//! |---|---|---|
//! | [`Scene::read`] | text of the file, overrides | [`Scene`], or every mistake as a [`SceneReport`] |
//! | [`selection::kept`] | conditions of `remove`, points | which points stay |
//! | [`selection::select`] | [`Scene`], body | point sets, probes |
//! | [`boundary::BoundaryConditions::new`] | [`Scene`], body, point sets | fixed components, loads |
//! | [`drive::MotionConditions::new`] | the same, masses | conditions as functions of time |
//!
//! A [`Scene`] is complete: every default is filled in, every name of a set is known, every
//! expression is compiled, numbers are finite and in range, vectors have one entry per dimension.
//! [`Scene::resolved_toml`] writes it down, and that text reads back to an equal scene.

pub mod boundary;
mod check;
pub mod drive;
pub(crate) mod expression;
mod fracture;
mod keys;
mod motion;
mod overrides;
mod points;
mod potential;
mod read;
mod reader;
pub mod selection;
mod sets;
mod settings;
mod source;
mod tree;
mod vocabulary;
mod write;

#[cfg(test)]
mod answer_tests;
#[cfg(test)]
mod formula_tests;
#[cfg(test)]
mod horizon_tests;
#[cfg(test)]
mod material_tests;
#[cfg(test)]
mod motion_tests;
#[cfg(test)]
mod tests;

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::deformation::{Discretisation, OperatorOrder};
use piola_mechanics::surface::{Surface, Volumes};
use piola_mechanics::weights::Weights;
use piola_mechanics::words::Words;

pub use expression::Expression;
pub use fracture::{CrackEntry, CrackShape, FractureSettings, Track, TrackAxis};
pub use motion::{Given, Initial, Motion};
pub use piola_mechanics::lattice::Nodes;
pub use points::{BodyShape, LatticeShape, MeshFormat, MeshNodes, MeshShape, Points};
pub use potential::{PotentialText, files_below, meant};
pub use read::MOST_LAWS;
pub use sets::{Listing, Members, SetDefinition};
pub(crate) use settings::STATE;
pub use settings::{
    ColourBy, DerivativeSource, FrameField, OutputSettings, Passes, SolverSettings, Steps,
    StrainSource, Unstable,
};
pub use source::{Finding, SceneReport, SourceText, Sources};
pub use vocabulary::{KeyWords, TableWords, ValueWords, vocabulary};

/// The coordinates as expressions and messages name them.
pub const AXES: [&str; 3] = ["X", "Y", "Z"];

/// A scene file may have this many bytes, overrides included.
pub const MAX_SCENE_BYTES: usize = 1 << 20;

/// A scene as it was read: complete, checked, with every default filled in.
///
/// Two scenes are equal if they describe the same computation; where things stand in which file
/// does not count.
#[derive(Clone, Debug)]
pub struct Scene {
    /// `[body]`
    pub body: BodyShape,
    /// `[horizon]`
    pub horizon: Horizon,
    /// `[material]` or every `[[material]]` with their `[[material.plus]]`, and the potentials of every
    /// `[[interface]]`: at least one.
    pub materials: Vec<Material>,
    /// Every `[[material]]`; none where all of the body is of one `[material]`.
    pub regions: Vec<Region>,
    /// Every `[[interface]]`.
    pub interfaces: Vec<Interface>,
    /// `[correspondence]`, for potentials with an energy of `F`; filled in for them.
    pub correspondence: Option<CorrespondenceSettings>,
    /// `[sets]`, in the order of the file.
    pub sets: Vec<SetDefinition>,
    /// `[[initial]]`
    pub initial: Vec<Initial>,
    /// `[[prescribe]]`
    pub prescriptions: Vec<Prescription>,
    /// `[[load]]`
    pub loads: Vec<Load>,
    /// `[[probe]]`
    pub probes: Vec<Probe>,
    /// `[[crack]]`
    pub cracks: Vec<CrackEntry>,
    /// `[fracture]`
    pub fracture: FractureSettings,
    /// `[[track]]`
    pub tracks: Vec<Track>,
    /// `[steps]`
    pub steps: Steps,
    /// `[motion]`, in place of steps.
    pub motion: Option<Motion>,
    /// `[solver]`
    pub solver: SolverSettings,
    /// `[output]`
    pub output: OutputSettings,
    /// Findings that do not stop the work; spans as in [`Sources::report`].
    pub warnings: Vec<Diagnostic>,
    /// The texts from which the scene was read.
    pub sources: Sources,
}

impl PartialEq for Scene {
    fn eq(&self, other: &Scene) -> bool {
        // Taken apart so that a new field cannot be forgotten here.
        let Scene {
            body,
            horizon,
            materials,
            regions,
            interfaces,
            correspondence,
            sets,
            initial,
            prescriptions,
            loads,
            probes,
            cracks,
            fracture,
            tracks,
            steps,
            motion,
            solver,
            output,
            warnings: _,
            sources: _,
        } = self;
        *body == other.body
            && *horizon == other.horizon
            && *materials == other.materials
            && *regions == other.regions
            && *interfaces == other.interfaces
            && *correspondence == other.correspondence
            && *sets == other.sets
            && *initial == other.initial
            && *prescriptions == other.prescriptions
            && *loads == other.loads
            && *probes == other.probes
            && *cracks == other.cracks
            && *fracture == other.fracture
            && *tracks == other.tracks
            && *steps == other.steps
            && *motion == other.motion
            && *solver == other.solver
            && *output == other.output
    }
}

impl Scene {
    /// `[material]`, the first.
    pub fn material(&self) -> &Material {
        &self.materials[0]
    }

    /// The horizon in m.
    pub fn horizon_radius(&self) -> f64 {
        match self.horizon.extent {
            HorizonExtent::Radius(radius) => radius,
            // Of clouds and meshes the mean spacing is known with their points, and is a radius from then on.
            HorizonExtent::Spacings(count) => count * self.body.points.spacing().unwrap_or(0.0),
        }
    }

    /// Leads findings about this scene back to its texts.
    pub fn report(&self, diagnostics: Vec<Diagnostic>) -> SceneReport {
        self.sources.report(diagnostics)
    }
}

/// A value and where it stands. Equal if the values are.
#[derive(Clone, Copy, Debug)]
pub struct Located<T> {
    /// The value.
    pub value: T,
    /// Its place in the scene's texts.
    pub span: Span,
}

impl<T: PartialEq> PartialEq for Located<T> {
    fn eq(&self, other: &Located<T>) -> bool {
        self.value == other.value
    }
}

/// `[horizon]`: who interacts, and with which weight.
#[derive(Clone, Debug)]
pub struct Horizon {
    /// How far the interactions reach.
    pub extent: HorizonExtent,
    /// How neighbours are weighted.
    pub weights: Weights,
    /// Where the scene says so; without it the potential may ask for other weights.
    pub weights_span: Option<Span>,
    /// How bonds near faces are corrected.
    pub surface: Surface,
    /// What of a neighbour's volume counts.
    pub volumes: Volumes,
    /// Where the scene asks for one of the two.
    pub correction_span: Option<Span>,
}

impl PartialEq for Horizon {
    fn eq(&self, other: &Horizon) -> bool {
        self.extent == other.extent && self.weighting() == other.weighting()
    }
}

/// How far the interactions reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HorizonExtent {
    /// In spacings of a lattice; of other points in mean spacings, the root of their mean volume.
    Spacings(f64),
    /// In m.
    Radius(f64),
}

/// `[[material]]`: which points are of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Its name.
    pub name: Located<String>,
    /// Index into [`Scene::sets`]; nothing where it has all points that no other has.
    pub set: Option<Located<usize>>,
}

/// `[[interface]]`: what interactions of points of two materials take.
#[derive(Clone, Debug, PartialEq)]
pub struct Interface {
    /// Indices into [`Scene::regions`].
    pub between: [Located<usize>; 2],
    /// What they take.
    pub rule: InterfaceRule,
}

/// What interactions of points of two materials take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterfaceRule {
    /// The mean of their corners' energies.
    Mean,
    /// The law of one of the two.
    As(usize),
    /// A potential of its own: the number of its law, after those of the materials.
    Potential(usize),
}

impl InterfaceRule {
    /// The law of its own.
    pub fn law(&self) -> Option<usize> {
        match self {
            InterfaceRule::Potential(law) => Some(*law),
            InterfaceRule::Mean | InterfaceRule::As(_) => None,
        }
    }
}

/// `[material]`, `[[material]]`, `[[material.plus]]` or `[[interface]]`: a potential and its parameters.
/// The energies of all with one law add up.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The number of its law: an index into [`Scene::regions`], or one of an interface behind them.
    pub law: usize,
    /// A file beside the scene if it ends in `.piola`, else a name in the library.
    pub potential: Located<String>,
    /// The given parameters, in the order of the file.
    pub parameters: Vec<ParameterSetting>,
    /// In kg/m^3, where the scene says it; of the first potential of a law alone.
    pub density: Option<Located<f64>>,
}

/// The value of one parameter of a potential.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterSetting {
    /// Its name in the potential.
    pub name: Located<String>,
    /// Its value.
    pub value: Located<ParameterText>,
}

/// A parameter's value as it was written.
#[derive(Clone, Debug, PartialEq)]
pub enum ParameterText {
    /// A finite number in the unit that the potential declares.
    Number(f64),
    /// A number with a unit, such as `200 GPa`; the compiler converts it.
    Quantity(String),
}

/// `[correspondence]`: how a body gets its deformation gradients, and what is made of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CorrespondenceSettings {
    /// Where the energy density is evaluated; stiffnesses per volume of the material, in Pa/m^2.
    pub discretisation: Discretisation,
    /// Which polynomials are differentiated exactly.
    pub order: OperatorOrder,
    /// How much a neighbour counts.
    pub influence: InfluenceChoice,
    /// 2D: what happens across the plane.
    pub plane: Plane,
}

/// What happens across the plane of a two-dimensional body with an energy of `F`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Plane {
    /// Nothing: `psi(F)` is that of the plane.
    #[default]
    Strain,
    /// The body gets thinner or thicker until nothing pulls it across.
    Stress,
}

impl Words for Plane {
    const WORDS: &'static [(&'static str, Plane)] =
        &[("strain", Plane::Strain), ("stress", Plane::Stress)];
}

/// An influence function.
#[derive(Clone, Debug, PartialEq)]
pub enum InfluenceChoice {
    /// One that has a name.
    Named(NamedInfluence),
    /// An expression of `L` and `delta`.
    Expression(Expression),
}

/// An influence function that has a name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NamedInfluence {
    /// A cubic B-spline that ends at the horizon.
    #[default]
    CubicSpline,
    /// 1.
    Constant,
    /// One over the length of the bond.
    Inverse,
}

impl Words for NamedInfluence {
    const WORDS: &'static [(&'static str, NamedInfluence)] = &[
        ("cubic-spline", NamedInfluence::CubicSpline),
        ("constant", NamedInfluence::Constant),
        ("inverse", NamedInfluence::Inverse),
    ];
}

impl Default for InfluenceChoice {
    fn default() -> Self {
        InfluenceChoice::Named(NamedInfluence::default())
    }
}

impl InfluenceChoice {
    /// As the scene has it.
    pub fn text(&self) -> &str {
        match self {
            InfluenceChoice::Named(named) => named.word(),
            InfluenceChoice::Expression(expression) => &expression.text,
        }
    }
}

/// One `[[prescribe]]`: displacements, velocities or accelerations that are given.
#[derive(Clone, Debug, PartialEq)]
pub struct Prescription {
    /// Index into [`Scene::sets`], and where the set is named.
    pub set: Located<usize>,
    /// What is given.
    pub given: Given,
    /// One entry per dimension, in m, m/s or m/s^2; `None` leaves the component free.
    pub components: Vec<Located<Option<Quantity>>>,
}

/// One `[[load]]`: forces that are given.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Index into [`Scene::sets`], and where the set is named.
    pub set: Located<usize>,
    /// What the components mean.
    pub kind: LoadKind,
    /// One entry per dimension.
    pub components: Vec<Located<Quantity>>,
}

/// What the components of a load mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadKind {
    /// The total on the set in N, shared in proportion to the point volumes.
    Force,
    /// Force per volume, in N/m^d.
    Density,
    /// Force per mass, in m/s^2.
    Acceleration,
}

impl LoadKind {
    /// All of them.
    pub const ALL: [LoadKind; 3] = [LoadKind::Force, LoadKind::Density, LoadKind::Acceleration];

    /// Its key in a scene file.
    pub fn key(self) -> &'static str {
        match self {
            LoadKind::Force => "force",
            LoadKind::Density => "density",
            LoadKind::Acceleration => "acceleration",
        }
    }
}

/// A number or an expression of X, Y, Z, t.
#[derive(Clone, Debug, PartialEq)]
pub enum Quantity {
    /// A finite number.
    Number(f64),
    /// An expression.
    Expression(Expression),
}

impl Quantity {
    /// Its value at a reference position (2 or 3 numbers, in m) and a time.
    pub fn value(&self, position: &[f64], t: f64) -> f64 {
        match self {
            Quantity::Number(number) => *number,
            Quantity::Expression(expression) => expression.value(position, t),
        }
    }

    /// Whether this name stands in it as a word of its own.
    pub(crate) fn names(&self, name: &str) -> bool {
        matches!(self, Quantity::Expression(expression) if expression.names(name))
    }

    /// Whether it is the number 0.
    pub fn is_zero(&self) -> bool {
        matches!(self, Quantity::Number(number) if *number == 0.0)
    }
}

/// One `[[probe]]`: a place whose displacement is recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Its name.
    pub name: Located<String>,
    /// The place in m, one entry per dimension.
    pub at: Located<Vec<f64>>,
}
