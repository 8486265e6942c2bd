//! Parameters of a potential for which the discrete body has given moduli.
//!
//! Elasticity tensors that are linear in the parameters, as with coefficients of the energies, are
//! sampled once per parameter and then known exactly; the rest is Gauss and Newton on small
//! matrices from many starts. Others are sampled along the way. Either way the result is evaluated
//! anew, and only that counts. A fracture energy has a parameter of its own, which changes no modulus: it
//! is found when those of the moduli are.

mod response;
mod search;
mod threshold;

use piola_compiler::ValueError;

use super::inside::Inside;
use super::{Affine, FractureEnergy, Moduli, Modulus, Stiffness, moduli_with, name_of_plane};
use crate::case::{self, Case, CaseError, Potential};
use crate::scene::{Located, ParameterSetting, ParameterText, Scene};
use response::{Linear, Response, Sampled};
use search::{Found, explore, refine};
pub use threshold::FractureTarget;
use threshold::Search;

/// What a modulus shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Which.
    pub modulus: Modulus,
    /// In Pa, or a plain number.
    pub value: f64,
}

/// What a body shall have.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Elastic moduli.
    pub moduli: Vec<Target>,
    /// What breaking a plane of the lattice releases.
    pub fracture: Option<FractureTarget>,
}

/// A material that has the moduli asked for.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// The varied parameters in the units that the potential declares.
    pub parameters: Vec<(String, f64)>,
    /// The scene with them.
    pub scene: Scene,
    /// What the body then has.
    pub moduli: Moduli,
    /// Whether the elasticity tensor is linear in the parameters.
    pub linear: bool,
    /// How many elasticity tensors were computed.
    pub evaluations: usize,
    /// The varied parameter that the fracture energy follows from, where one was asked for.
    pub threshold: Option<String>,
    /// How many fracture energies were computed.
    pub fracture_evaluations: usize,
}

/// Why there is no such material.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The scene cannot be evaluated.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// What is asked for makes no sense.
    #[error("{message}")]
    Input {
        /// What is wrong.
        message: String,
        /// What to do.
        help: String,
    },
    /// No admissible values of the parameters do it.
    #[error("{message}")]
    Unreachable {
        /// Which targets, and what comes closest.
        message: String,
        /// What stands in the way, and what to vary.
        helps: Vec<String>,
    },
}

fn input(message: impl Into<String>, help: impl Into<String>) -> CalibrateError {
    CalibrateError::Input { message: message.into(), help: help.into() }
}

/// Largest residual of a target that counts as reached: relative for stresses, absolute for numbers.
const REACHED: f64 = 1e-10;

/// Largest change of the elasticity tensor, over its size, that a parameter without influence makes.
const IDLE: f64 = 1e-12;

/// Most parameters that can be varied.
const MOST_PARAMETERS: usize = 3;

/// Changes the named parameters of a scene until its body has the target moduli and fracture energy.
///
/// # Errors
/// Names that do not exist, more parameters than targets, parameters without influence, targets
/// that no admissible values reach, a fracture energy where none can be read off the lattice; everything that
/// is wrong with the scene.
pub fn calibrate(
    case: &Case,
    wanted: &Wanted,
    vary: &[String],
) -> Result<Calibrated, CalibrateError> {
    let problem = Problem::new(case, &wanted.moduli, vary)?;
    problem.check(wanted.fracture.as_ref())?;
    let Some(target) = &wanted.fracture else { return problem.solve()?.calibrated(None, 0) };
    let threshold = problem.threshold()?;
    let others: Vec<String> = vary.iter().filter(|name| **name != threshold).cloned().collect();
    let mut solved = match others.is_empty() {
        true => Solved::of(case.clone()),
        false => Problem { inside: problem.inside, ..Problem::new(case, &wanted.moduli, &others)? }
            .solve()?,
    };
    let own = Problem::new(&solved.case, &[], std::slice::from_ref(&threshold))?;
    let (found, evaluations) = Search::new(&own, target).run()?;
    let case = own.with(&[found]).map_err(|error| input(error.message, error.help))?;
    solved.parameters.push((threshold.clone(), found));
    let place = |name: &String| vary.iter().position(|varied| varied == name);
    solved.parameters.sort_by_key(|(name, _)| place(name));
    Solved { case, ..solved }.calibrated(Some(threshold), evaluations)
}

/// A case that has the moduli.
struct Solved {
    case: Case,
    parameters: Vec<(String, f64)>,
    linear: bool,
    evaluations: usize,
}

impl Solved {
    /// A case as it is.
    fn of(case: Case) -> Solved {
        Solved { case, parameters: Vec::new(), linear: false, evaluations: 0 }
    }

    fn calibrated(
        self,
        threshold: Option<String>,
        fracture_evaluations: usize,
    ) -> Result<Calibrated, CalibrateError> {
        Ok(Calibrated {
            parameters: self.parameters,
            moduli: moduli_with(&self.case, None, &Inside::new(&self.case))?,
            scene: self.case.scene,
            linear: self.linear,
            evaluations: self.evaluations,
            threshold,
            fracture_evaluations,
        })
    }
}

/// What is asked.
struct Problem<'a> {
    case: &'a Case,
    targets: &'a [Target],
    /// The varied parameters.
    names: Vec<String>,
    /// Whose parameters they are: the numbers of the potential and of the parameter there.
    places: Vec<(usize, usize)>,
    /// The lattice, which no parameter changes.
    inside: Inside,
}

/// Whose parameter of this name it is: the numbers of the potential and of the parameter there.
fn place_of(case: &Case, name: &str) -> Result<(usize, usize), CalibrateError> {
    let own = |potential: &Potential| {
        potential.model.parameters().iter().position(|parameter| parameter.name == name)
    };
    let potentials = case.potentials.iter().enumerate();
    let found: Vec<(usize, usize)> =
        potentials.filter_map(|(number, potential)| Some((number, own(potential)?))).collect();
    let model = |(number, _): &(usize, usize)| case.potentials[*number].model.name();
    match &found[..] {
        [place] => Ok(*place),
        [] => {
            let models = case.potentials.iter().map(|potential| &potential.model);
            let names = models.clone().map(|model| format!("`{}`", model.name()));
            let names = names.collect::<Vec<_>>().join(" and ");
            let all = models.flat_map(|model| model.parameters()).map(|p| p.name.as_str());
            let all = all.collect::<Vec<_>>().join(", ");
            let (has, whose) =
                if case.potentials.len() == 1 { ("has", "its") } else { ("have", "their") };
            let message = format!("{names} {has} no parameter `{name}`");
            Err(input(message, format!("{whose} parameters are {all}")))
        }
        [first, second, ..] => {
            let message = format!(
                "`{}` and `{}` both have a parameter `{name}`",
                model(first),
                model(second)
            );
            Err(input(message, "give one of them another name in its potential"))
        }
    }
}

/// The values of a potential with these parameters; the first that it does not admit.
fn values(
    potential: &Potential,
    parameters: &[(String, piola_compiler::Setting)],
) -> Result<piola_compiler::Values, ValueError> {
    potential.values_for(parameters).map_err(|mut errors| errors.swap_remove(0))
}

impl<'a> Problem<'a> {
    fn new(
        case: &'a Case,
        targets: &'a [Target],
        vary: &[String],
    ) -> Result<Problem<'a>, CalibrateError> {
        let d = case.scene.body.dimension;
        let mut places = Vec::new();
        for (place, name) in vary.iter().enumerate() {
            places.push(place_of(case, name)?);
            if vary[..place].contains(name) {
                return Err(input(format!("`{name}` is named twice"), "name it once"));
            }
        }
        for (place, target) in targets.iter().enumerate() {
            let name = target.modulus.name();
            if targets[..place].iter().any(|other| other.modulus == target.modulus) {
                return Err(input(format!("`{name}` has two targets"), "give it one"));
            }
            if !target.modulus.exists(d) {
                let message =
                    format!("`{name}` is a number of plane bodies, and this one is solid");
                return Err(input(message, "take E and nu"));
            }
            let positive = !target.modulus.has_any_sign();
            if !target.value.is_finite() || (positive && target.value <= 0.0) {
                let message = format!("{name} = {} is no modulus of a stable body", target.value);
                let unit = if target.modulus.is_stress() { ", in Pa" } else { "" };
                return Err(input(message, format!("{name} must be a positive number{unit}")));
            }
        }
        Ok(Problem { case, targets, names: vary.to_vec(), places, inside: Inside::new(case) })
    }

    /// Refuses what cannot be asked for.
    fn check(&self, fracture: Option<&FractureTarget>) -> Result<(), CalibrateError> {
        let (n_targets, n_varied) =
            (self.targets.len() + usize::from(fracture.is_some()), self.names.len());
        if n_targets == 0 || n_varied == 0 {
            return Err(input("there is nothing to calibrate", "name targets and parameters"));
        }
        if n_varied > n_targets || n_varied > MOST_PARAMETERS {
            let message = format!(
                "{n_varied} parameters are varied for {n_targets} targets: many values would do"
            );
            let help = format!(
                "vary at most as many parameters as there are targets, and at most {MOST_PARAMETERS}"
            );
            return Err(input(message, help));
        }
        let Some(target) = fracture else { return Ok(()) };
        let (name, value) = (target.name(), target.value);
        if !(value.is_finite() && value > 0.0) {
            let message = format!("{name} = {value} is no fracture energy");
            return Err(input(message, "it must be a positive number, in J/m^2"));
        }
        let d = self.case.scene.body.dimension;
        let planes = FractureEnergy::normals(d);
        if target.normal.as_ref().is_some_and(|normal| !planes.contains(normal)) {
            let names: Vec<String> = planes.iter().map(|normal| name_of_plane(normal)).collect();
            let message = format!("`{name}` is no plane of this lattice of {d} dimensions");
            return Err(input(message, format!("there are Gc and {}", names.join(", "))));
        }
        Ok(())
    }

    /// The parameter that is varied for the fracture energy: the one that changes no modulus.
    fn threshold(&self) -> Result<String, CalibrateError> {
        if self.targets.is_empty() {
            return Ok(self.names[0].clone());
        }
        let base = self.base();
        let first = self.moduli_at(&base)?;
        let is_idle = |k: &usize| {
            // Of values that are not admissible others are tried.
            let moved = [1.25, 0.75, 1.01, 0.99].into_iter().find_map(|factor| {
                let mut at = base.clone();
                at[*k] = if at[*k] == 0.0 { factor - 1.0 } else { factor * at[*k] };
                self.moduli_at(&at).ok()
            });
            moved.is_some_and(|there| there.plus(-1.0, &first).size() <= IDLE * first.size())
        };
        let idle: Vec<&String> =
            (0..self.names.len()).filter(is_idle).map(|k| &self.names[k]).collect();
        match &idle[..] {
            [name] => Ok(name.to_string()),
            [] => {
                let message = format!(
                    "every one of {} changes the moduli: none is left for the fracture energy",
                    self.names.join(", ")
                );
                Err(input(message, "vary the parameter that says when something breaks, too"))
            }
            [first, second, ..] => {
                let message = format!("the moduli depend neither on `{first}` nor on `{second}`");
                Err(input(
                    message,
                    "vary one of them for the fracture energy, and others for the moduli",
                ))
            }
        }
    }

    /// The scene's own values of the varied parameters, in declared units.
    fn base(&self) -> Vec<f64> {
        let d = self.case.scene.body.dimension;
        let value = |&(potential, number): &(usize, usize)| {
            let Potential { model, values, .. } = &self.case.potentials[potential];
            let scale = model.variant(d).map_or(1.0, |variant| variant.units[number].scale);
            values.parameters[number] / scale
        };
        self.places.iter().map(value).collect()
    }

    /// The case with other values of the varied parameters.
    fn with(&self, parameters: &[f64]) -> Result<Case, ValueError> {
        let mut case = self.case.clone();
        for ((name, value), (potential, _)) in self.names.iter().zip(parameters).zip(&self.places) {
            let material = &mut case.scene.materials[*potential];
            let span = material.potential.span;
            let value = Located { value: ParameterText::Number(*value), span };
            match material.parameters.iter_mut().find(|p| p.name.value == *name) {
                Some(parameter) => parameter.value = value,
                None => material
                    .parameters
                    .push(ParameterSetting { name: Located { value: name.clone(), span }, value }),
            }
        }
        for (potential, material) in case.potentials.iter_mut().zip(&case.scene.materials) {
            let found = values(potential, &case::settings(&case.scene, material))?;
            let found = found.with_fields_of(&potential.values);
            potential.values = found.without_parameters_that_vary(&potential.model);
        }
        Ok(case)
    }

    /// Finds parameters for the moduli.
    fn solve(&self) -> Result<Solved, CalibrateError> {
        let base = self.base();
        let first = self.moduli_at(&base)?;
        let scale = self.scale(&first);
        let mut evaluations = 1;
        let linear = Linear::sample(self, &base, &first, scale, &mut evaluations)?;
        let found = match &linear {
            Some(linear) => {
                let starts = explore(linear, self, true);
                search::best(starts.iter().map(|start| refine(linear, self, start, true)))
            }
            None => {
                let sampled = Sampled::new(self, &base);
                let starts = sampled.starts();
                let found =
                    search::best(starts.iter().map(|start| refine(&sampled, self, start, true)));
                evaluations += sampled.evaluations();
                found
            }
        };
        let Some(found) = found else {
            return Err(self.unreachable(linear.as_ref(), None));
        };
        let (found, more) = self.correct(found, linear.as_ref(), scale)?;
        if found.worst() > REACHED {
            return Err(self.unreachable(linear.as_ref(), Some(&found)));
        }
        let case =
            self.with(&found.parameters).map_err(|error| input(error.message, error.help))?;
        Ok(Solved {
            case,
            parameters: self.names.iter().cloned().zip(found.parameters).collect(),
            linear: linear.is_some(),
            evaluations: evaluations + more,
        })
    }

    /// The condition of the potentials that these values break.
    fn broken(&self, parameters: &[f64]) -> Option<ValueError> {
        self.with(parameters).err()
    }

    fn moduli_at(&self, parameters: &[f64]) -> Result<Stiffness, CalibrateError> {
        let case = self.with(parameters).map_err(|error| input(error.message, error.help))?;
        Ok(Stiffness::new(&Affine::with(&case, &self.inside)?))
    }

    /// The size of the stresses to come, in Pa.
    fn scale(&self, first: &Stiffness) -> f64 {
        let stresses = self.targets.iter().filter(|target| target.modulus.is_stress());
        let largest = stresses.fold(0.0f64, |largest, target| largest.max(target.value.abs()));
        if largest > 0.0 { largest } else { first.size() }
    }

    /// How far each target is missed: relative for stresses, absolute for plain numbers; nothing for
    /// bodies that are not stable.
    fn residuals(&self, stiffness: &Stiffness) -> Option<Vec<f64>> {
        if !stiffness.is_stable() {
            return None;
        }
        self.targets.iter().map(|target| self.residual(target, stiffness)).collect()
    }

    fn residual(&self, target: &Target, stiffness: &Stiffness) -> Option<f64> {
        let value = stiffness.modulus(target.modulus)?;
        Some(match target.modulus {
            Modulus::Poisson | Modulus::PoissonStrain => value - target.value,
            Modulus::C12 => (value - target.value) / self.scale(stiffness),
            _ if value > 0.0 => libm::log(value / target.value),
            _ => return None,
        })
    }

    /// The derivative of [`Problem::residual`] along a change of the tensor.
    fn residual_slope(
        &self,
        target: &Target,
        stiffness: &Stiffness,
        change: &Stiffness,
    ) -> Option<f64> {
        let slope = stiffness.slope(target.modulus, change)?;
        Some(match target.modulus {
            Modulus::Poisson | Modulus::PoissonStrain => slope,
            Modulus::C12 => slope / self.scale(stiffness),
            _ => slope / stiffness.modulus(target.modulus)?,
        })
    }

    /// Evaluates what was found on the body itself, and takes off what rounding of a linear model
    /// has left. Gives back how many evaluations that took.
    fn correct(
        &self,
        mut found: Found,
        linear: Option<&Linear>,
        scale: f64,
    ) -> Result<(Found, usize), CalibrateError> {
        let Some(linear) = linear else { return Ok((found, 0)) };
        let mut best: Option<Found> = None;
        let mut evaluations = 0;
        for _ in 0..3 {
            let stiffness = self.moduli_at(&found.parameters)?;
            evaluations += 1;
            let Some(residuals) = self.residuals(&stiffness) else { break };
            let here = Found { parameters: found.parameters.clone(), residuals };
            let better = best.as_ref().is_none_or(|best| here.worst() < best.worst());
            if better {
                best = Some(here);
            }
            if !better || best.as_ref().is_some_and(|best| best.worst() < 1e-13) {
                break;
            }
            let moved = linear.rebased(&found.parameters, &stiffness, scale);
            let start = moved.variables(&found.parameters);
            match refine(&moved, self, &start, true) {
                Some(next) => found = next,
                None => break,
            }
        }
        Ok((best.unwrap_or(found), evaluations))
    }

    fn unreachable(&self, linear: Option<&Linear>, closest: Option<&Found>) -> CalibrateError {
        let list = |text: &dyn Fn(&Target) -> String| {
            self.targets.iter().map(text).collect::<Vec<_>>().join(", ")
        };
        let shown = |target: &Target, value: f64| match target.modulus.is_stress() {
            true => format!("{} = {value:.6e} Pa", target.modulus.name()),
            false => format!("{} = {value:.6}", target.modulus.name()),
        };
        let asked = list(&|target| shown(target, target.value));
        let mut message = format!("{asked} cannot be reached by varying {}", self.names.join(", "));
        let stiffness = closest.and_then(|found| self.moduli_at(&found.parameters).ok());
        if let (Some(stiffness), Some(found)) = (stiffness, closest) {
            let near = list(&|target| {
                shown(target, stiffness.modulus(target.modulus).unwrap_or(f64::NAN))
            });
            message =
                format!("{message}: closest is {near} at {}", self.assigned(&found.parameters));
        }
        let mut helps = Vec::new();
        if let Some(linear) = linear {
            helps.extend(self.ranges(linear));
            let starts = explore(linear, self, false);
            let free = search::best(starts.iter().map(|start| refine(linear, self, start, false)));
            let free = free.filter(|found| found.worst() <= REACHED);
            if let Some((found, broken)) =
                free.and_then(|found| self.broken(&found.parameters).map(|broken| (found, broken)))
            {
                helps.push(format!(
                    "it would take {}, but {}",
                    self.assigned(&found.parameters),
                    broken.message
                ));
            }
        }
        helps.extend(self.not_varied());
        CalibrateError::Unreachable { message, helps }
    }

    /// Which other parameters there are.
    fn not_varied(&self) -> Option<String> {
        let all = self.case.potentials.iter().flat_map(|potential| potential.model.parameters());
        let others: Vec<&str> = all
            .map(|parameter| parameter.name.as_str())
            .filter(|name| !self.names.iter().any(|varied| varied == name))
            .collect();
        (!others.is_empty()).then(|| format!("not varied: {}", others.join(", ")))
    }

    fn assigned(&self, parameters: &[f64]) -> String {
        let pairs = self.names.iter().zip(parameters);
        pairs.map(|(name, value)| format!("{name} = {value:.6e}")).collect::<Vec<_>>().join(", ")
    }

    /// Which plain numbers the admissible parameters reach.
    fn ranges(&self, linear: &Linear) -> Vec<String> {
        let plain = self.targets.iter().filter(|target| !target.modulus.is_stress());
        let admissible: Vec<Stiffness> = search::grid(linear.len())
            .into_iter()
            .filter(|x| self.broken(&linear.parameters(x)).is_none())
            .filter_map(|x| linear.stiffness(&x))
            .filter(Stiffness::is_stable)
            .collect();
        let range = |target: &Target| {
            let values = admissible.iter().filter_map(|s| s.modulus(target.modulus));
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            });
            let (name, varied) = (target.modulus.name(), self.names.join(", "));
            if low > high {
                format!("no stable body has admissible values of {varied}")
            } else if high - low < 1e-9 {
                format!("{name} is {low:.6} whatever {varied} is: vary another parameter as well")
            } else {
                format!("{name} reaches from about {low:.4} to {high:.4} with {varied}")
            }
        };
        plain.map(range).collect()
    }
}
