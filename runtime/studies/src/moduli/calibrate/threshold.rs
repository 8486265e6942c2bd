//! The threshold at which a lattice has a wanted fracture energy.
//!
//! The varied parameter changes by factors of two from the scene's value, to both sides, until the fracture
//! energy of the lattice is above the target at one end and below it at the other; where a value is not
//! admissible, or things no longer break, steps are halved, so that the way ends where the values do. In
//! between the root is found with one end on each side of it. Every fracture energy is evaluated on the
//! lattice.

use super::super::fracture::name_of_plane;
use super::super::{FractureEnergy, NoFractureEnergy};
use super::{CalibrateError, Problem, REACHED, input};

/// What the fracture energy of a lattice shall be.
#[derive(Clone, Debug, PartialEq)]
pub struct FractureTarget {
    /// The normal of the plane in lattice coordinates; that of the first in the table where there is none.
    pub normal: Option<Vec<i32>>,
    /// In J/m^2.
    pub value: f64,
}

impl FractureTarget {
    /// As it is written: `Gc`, `Gc[110]`.
    pub fn name(&self) -> String {
        self.normal.as_ref().map_or("Gc".to_string(), |normal| name_of_plane(normal))
    }
}

/// Most halvings of a step at the end of what is admissible.
const HALVINGS: u32 = 45;

/// The largest ratio of the parameter to the scene's value is two to this power.
const FARTHEST: f64 = 40.0;

/// A step that shows to which side the fracture energy grows.
const NEAR: f64 = 1e-3;

/// Most steps towards the root.
const STEPS: usize = 200;

/// The logarithm of base 2 of the ratio of the parameter to the scene's value, and the fracture energy there.
type Place = (f64, f64);

/// The end of a way: the parameter there, and what is wrong with it.
type End = (f64, String);

/// The search for one parameter.
pub(super) struct Search<'a> {
    problem: &'a Problem<'a>,
    target: &'a FractureTarget,
    /// A power of two of it is the parameter.
    unit: f64,
    evaluations: usize,
}

/// Why there is nothing at a value of the parameter.
enum Stop {
    /// It is not admissible there.
    Value(String),
    /// There is no fracture energy there.
    Energy(NoFractureEnergy),
    /// The case cannot be evaluated at all.
    Case(CalibrateError),
}

impl Stop {
    fn text(&self) -> String {
        match self {
            Stop::Value(message) => message.clone(),
            Stop::Energy(why) => why.to_string(),
            Stop::Case(error) => error.to_string(),
        }
    }
}

impl<'a> Search<'a> {
    /// For the one parameter of a problem.
    pub(super) fn new(problem: &'a Problem<'a>, target: &'a FractureTarget) -> Search<'a> {
        let base = problem.base()[0];
        let unit = if base == 0.0 { 1.0 } else { base };
        Search { problem, target, unit, evaluations: 0 }
    }

    /// The value of the parameter, and how many fracture energies that took.
    pub(super) fn run(mut self) -> Result<(f64, usize), CalibrateError> {
        let start = self.start()?;
        let mut seen = vec![start];
        let mut ends = Vec::new();
        for side in self.sides(start)? {
            let (way, end) = self.walk(start, side)?;
            let pairs = std::iter::once(&start).chain(&way).zip(&way);
            for (from, to) in pairs {
                if self.miss(from.1) * self.miss(to.1) <= 0.0 {
                    let found = self.between(*from, *to)?;
                    return Ok((found, self.evaluations));
                }
            }
            ends.extend(end);
            seen.extend(way);
        }
        Err(self.unreachable(&seen, &ends))
    }

    fn parameter(&self, x: f64) -> f64 {
        self.unit * libm::exp2(x)
    }

    /// Below 0 where it is too small, above where it is too large: the logarithm of the ratio to the
    /// target.
    fn miss(&self, energy: f64) -> f64 {
        libm::log((energy / self.target.value).max(f64::MIN_POSITIVE))
    }

    fn energy(&mut self, x: f64) -> Result<f64, Stop> {
        self.evaluations += 1;
        let problem = self.problem;
        let case = problem
            .with(&[self.parameter(x)])
            .map_err(|error| Stop::Value(format!("{}; {}", error.message, error.help)))?;
        let found = FractureEnergy::new(&case, &problem.inside)
            .map_err(|error| Stop::Case(error.into()))?
            .map_err(Stop::Energy)?;
        // The plane is one of those of the lattice.
        let energy = found.along(self.target.normal.as_deref()).unwrap_or(f64::NAN);
        let none = || Stop::Energy(NoFractureEnergy::NotFinite("bonds"));
        if energy.is_finite() { Ok(energy) } else { Err(none()) }
    }

    /// Where the scene's value has no fracture energy, another one.
    fn start(&mut self) -> Result<Place, CalibrateError> {
        let mut first = None;
        for x in [0.0, -1.0, 1.0, -2.0, 2.0, -4.0, 4.0, -8.0, 8.0, -16.0, 16.0] {
            match self.energy(x) {
                Ok(energy) => return Ok((x, energy)),
                Err(Stop::Case(error)) => return Err(error),
                Err(stop @ Stop::Energy(NoFractureEnergy::NeverBreaks(_)))
                | Err(stop @ Stop::Value(_)) => {
                    first.get_or_insert(stop);
                }
                // No threshold changes that.
                Err(Stop::Energy(why)) => {
                    return Err(input(
                        "the scene has no fracture energy that could be calibrated",
                        why.to_string(),
                    ));
                }
            }
        }
        let why = first.map_or(String::new(), |stop| stop.text());
        let name = &self.problem.names[0];
        Err(input(
            format!("there is no fracture energy at `{name}` = {:e}, nor near it", self.unit),
            why,
        ))
    }

    /// First the side to which the fracture energy comes nearer to the target.
    fn sides(&mut self, start: Place) -> Result<[f64; 2], CalibrateError> {
        for side in [1.0, -1.0] {
            match self.energy(start.0 + side * NEAR) {
                Ok(there) if self.miss(there).abs() < self.miss(start.1).abs() => {
                    return Ok([side, -side]);
                }
                Ok(_) => return Ok([-side, side]),
                Err(Stop::Case(error)) => return Err(error),
                Err(_) => {}
            }
        }
        Ok([1.0, -1.0])
    }

    /// Places ever farther to one side, until the target lies between the last two, and what ended the way
    /// otherwise.
    fn walk(
        &mut self,
        start: Place,
        side: f64,
    ) -> Result<(Vec<Place>, Option<End>), CalibrateError> {
        let (mut way, mut step, mut at) = (Vec::new(), 1.0, start);
        let (mut end, mut halvings) = (None, 0);
        while halvings < HALVINGS && (at.0 + side * step).abs() <= FARTHEST {
            let x = at.0 + side * step;
            match self.energy(x) {
                Ok(energy) => {
                    way.push((x, energy));
                    if self.miss(at.1) * self.miss(energy) <= 0.0 {
                        return Ok((way, None));
                    }
                    at = (x, energy);
                    // Beyond an end there is nothing more.
                    step *= if end.is_some() { 0.5 } else { 2.0 };
                    halvings += u32::from(end.is_some());
                }
                Err(Stop::Case(error)) => return Err(error),
                Err(stop) => {
                    end = Some((self.parameter(x), stop.text()));
                    step *= 0.5;
                    halvings += 1;
                }
            }
        }
        Ok((way, end))
    }

    /// The parameter between two places, by the rule of false position; where one end stays, its value counts
    /// half (Illinois), and where that is slow the interval is halved.
    fn between(&mut self, mut low: Place, mut high: Place) -> Result<f64, CalibrateError> {
        let [mut of_low, mut of_high] = [low.1, high.1].map(|energy| self.miss(energy));
        let mut stayed = 0;
        for step in 0..STEPS {
            let width = high.0 - low.0;
            let ratio = of_low / (of_low - of_high);
            let is_slow = step % 4 == 3;
            let part = if is_slow || !(ratio > 0.0 && ratio < 1.0) { 0.5 } else { ratio };
            let x = low.0 + part * width;
            let best = if of_low.abs() < of_high.abs() { low } else { high };
            if self.parameter(x) == self.parameter(low.0)
                || self.parameter(x) == self.parameter(high.0)
                || self.miss(best.1).abs() < 4.0 * f64::EPSILON
            {
                break;
            }
            let energy = match self.energy(x) {
                Ok(energy) => energy,
                Err(Stop::Case(error)) => return Err(error),
                Err(stop) => return Err(self.gap(self.parameter(x), &stop)),
            };
            let here = self.miss(energy);
            if here * self.miss(low.1) > 0.0 {
                (low, of_low) = ((x, energy), here);
                of_high *= if stayed == 1 { 0.5 } else { 1.0 };
                stayed = 1;
            } else {
                (high, of_high) = ((x, energy), here);
                of_low *= if stayed == -1 { 0.5 } else { 1.0 };
                stayed = -1;
            }
        }
        let is_low = self.miss(low.1).abs() < self.miss(high.1).abs();
        let (x, energy) = if is_low { low } else { high };
        if self.miss(energy).abs() > REACHED {
            return Err(self.jump([low, high]));
        }
        Ok(self.parameter(x))
    }

    fn asked(&self) -> String {
        let (name, value) = (self.target.name(), self.target.value);
        let parameter = &self.problem.names[0];
        format!("{name} = {value:.6e} J/m^2 cannot be reached by varying {parameter}")
    }

    fn unreachable(&self, seen: &[Place], ends: &[End]) -> CalibrateError {
        let (name, parameter) = (self.target.name(), &self.problem.names[0]);
        let range = |of: &dyn Fn(&Place) -> f64| {
            seen.iter().map(of).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                [low.min(x), high.max(x)]
            })
        };
        let [low, high] = range(&|place| place.1);
        if high - low <= 1e-9 * high.abs() {
            let message =
                format!("{name} does not depend on `{parameter}`: it is {high:.6e} J/m^2");
            return input(message, "vary the parameter that says when something breaks");
        }
        let near = |p: &&Place, q: &&Place| self.miss(p.1).abs().total_cmp(&self.miss(q.1).abs());
        let closest = seen.iter().min_by(near).map_or(String::new(), |(x, energy)| {
            let at = self.parameter(*x);
            format!(": closest is {name} = {energy:.6e} J/m^2 at {parameter} = {at:.6e}")
        });
        let message = format!("{}{closest}", self.asked());
        let [from, to] = range(&|place| self.parameter(place.0));
        let mut helps = vec![format!(
            "{name} reaches from about {low:.4e} to {high:.4e} J/m^2 with {parameter} from {from:.4e} to \
             {to:.4e}"
        )];
        let end = |(at, why): &End| format!("at {parameter} = {at:.6e}: {why}");
        helps.extend(ends.iter().map(end));
        helps.extend(self.problem.not_varied());
        CalibrateError::Unreachable { message, helps }
    }

    fn jump(&self, ends: [Place; 2]) -> CalibrateError {
        let (name, parameter) = (self.target.name(), &self.problem.names[0]);
        let place = |(x, energy): Place| {
            format!("{energy:.9e} J/m^2 at {parameter} = {:e}", self.parameter(x))
        };
        let [low, high] = ends.map(place);
        let help = format!("{name} jumps there: it is {low} and {high}");
        CalibrateError::Unreachable { message: self.asked(), helps: vec![help] }
    }

    fn gap(&self, at: f64, stop: &Stop) -> CalibrateError {
        let help = format!("at {} = {at:e}: {}", self.problem.names[0], stop.text());
        CalibrateError::Unreachable { message: self.asked(), helps: vec![help] }
    }
}
