//! Parameters of a potential for which the discrete body has given moduli.
//!
//! Elasticity tensors that are linear in the parameters, as with coefficients of the energies, are
//! sampled once per parameter and then known exactly; the rest is Gauss and Newton on small
//! matrices from many starts. Others are sampled along the way. Either way the result is evaluated
//! anew, and only that counts.

mod response;
mod search;

use piola_compiler::ValueError;

use super::inside::Inside;
use super::{Affine, Moduli, Modulus, Stiffness, moduli_with};
use crate::case::{self, Case, CaseError, Potential};
use crate::scene::{Located, ParameterSetting, ParameterText, Scene};
use response::{Linear, Response, Sampled};
use search::{Found, explore, refine};

/// What a modulus shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Which.
    pub modulus: Modulus,
    /// In Pa, or a plain number.
    pub value: f64,
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

/// Most parameters that can be varied.
const MOST_PARAMETERS: usize = 3;

/// Changes the named parameters of a scene until its body has the target moduli.
///
/// # Errors
/// Names that do not exist, more parameters than targets, parameters without influence, targets
/// that no admissible values reach; everything that is wrong with the scene.
pub fn calibrate(
    case: &Case,
    targets: &[Target],
    vary: &[String],
) -> Result<Calibrated, CalibrateError> {
    let problem = Problem::new(case, targets, vary)?;
    let base = problem.base();
    let first = problem.moduli_at(&base)?;
    let scale = problem.scale(&first);
    let mut evaluations = 1;
    let linear = Linear::sample(&problem, &base, &first, scale, &mut evaluations)?;
    let found = match &linear {
        Some(linear) => {
            let starts = explore(linear, &problem, true);
            search::best(starts.iter().map(|start| refine(linear, &problem, start, true)))
        }
        None => {
            let sampled = Sampled::new(&problem, &base);
            let starts = sampled.starts();
            let found =
                search::best(starts.iter().map(|start| refine(&sampled, &problem, start, true)));
            evaluations += sampled.evaluations();
            found
        }
    };
    let Some(found) = found else {
        return Err(problem.unreachable(linear.as_ref(), None));
    };
    let (found, more) = problem.correct(found, linear.as_ref(), scale)?;
    if found.worst() > REACHED {
        return Err(problem.unreachable(linear.as_ref(), Some(&found)));
    }
    let solved =
        problem.with(&found.parameters).map_err(|error| input(error.message, error.help))?;
    Ok(Calibrated {
        parameters: problem.names.iter().cloned().zip(found.parameters).collect(),
        moduli: moduli_with(&solved, None, &problem.inside)?,
        scene: solved.scene,
        linear: linear.is_some(),
        evaluations: evaluations + more,
    })
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
        if targets.is_empty() || vary.is_empty() {
            return Err(input("there is nothing to calibrate", "name targets and parameters"));
        }
        if vary.len() > targets.len() || vary.len() > MOST_PARAMETERS {
            let message = format!(
                "{} parameters are varied for {} targets: many values would do",
                vary.len(),
                targets.len()
            );
            let help = format!(
                "vary at most as many parameters as there are targets, and at most {MOST_PARAMETERS}"
            );
            return Err(input(message, help));
        }
        Ok(Problem { case, targets, names: vary.to_vec(), places, inside: Inside::new(case) })
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
            potential.values = found.with_fields_of(&potential.values).without_fields();
        }
        Ok(case)
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
        let all = self.case.potentials.iter().flat_map(|potential| potential.model.parameters());
        let others: Vec<&str> = all
            .map(|parameter| parameter.name.as_str())
            .filter(|name| !self.names.iter().any(|varied| varied == name))
            .collect();
        if !others.is_empty() {
            helps.push(format!("not varied: {}", others.join(", ")));
        }
        CalibrateError::Unreachable { message, helps }
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
