//! How far from rest the form near it is taken.
//!
//! Near rest a function is its value at rest, its slope and what is left. Where it falls steeply, as
//! `exp(-300*(J - 1))`, the three cancel at some distance, where the form as written has all its digits. Both forms
//! are tried at the end of the range and further in. Where they agree, as those of nearly all functions do, the form
//! near rest serves up to [`NEAR`]; else numbers of 256 bits tell how far it does.

use super::GradientEnergyForms;
use super::kernel::{GradientKernel, NEAR, WrittenGradientEnergy};
use super::sample::{self, Sample};
use super::truth::parts;
use crate::expression::graph;
use crate::expression::precise::Precise;
use crate::kernel::Mode;
use crate::specialise::CompileError;
use crate::values::Values;
use crate::verify::sample::Random;

/// Relative differences of both forms that need no explanation: of energies of fourth order the one as written has
/// as few digits where components are as small as [`TRIED`] says.
const ALIKE: f64 = 1e-9;

/// Largest components of the gradients at which both are held against each other.
const TRIED: [f64; 2] = [0.99 * NEAR, NEAR / 4.0];

/// Of these so many are looked at again, where the forms differ most.
const LOOKED_AT: usize = 3;

/// How often the range is halved at most.
const HALVINGS: usize = 40;

/// An error of the form near rest counts from here on, in parts, and if it is so many times that of the other.
const LOST: f64 = 1e-12;
const WORSE: f64 = 16.0;

/// Both forms of a function at gradients, psi, P and dP.
struct Tried<'a> {
    kernel: GradientKernel,
    written: &'a WrittenGradientEnergy,
    fields: Vec<f64>,
}

/// Below which `max |F - I|` the form near rest is to be taken: of functions of fields at their typical values, and
/// where some of these are 0, as states often are that nothing has changed yet, with 1 in their place, too.
///
/// # Errors
/// As [`GradientKernel::new`].
pub(super) fn reach(
    forms: &GradientEnergyForms,
    written: &WrittenGradientEnergy,
    values: &Values,
) -> Result<f64, CompileError> {
    if forms.near.is_none() {
        return Ok(NEAR);
    }
    let n_fields = forms.far.n_fields();
    let fields: Vec<f64> = values.typical().map(|(_, value)| value).take(n_fields).collect();
    let directions = directions(forms.dimension);
    let kernel = GradientKernel::new(forms.clone(), Mode::Interpreter)?;
    let mut tried = Tried { kernel, written, fields };
    let mut reach = tried.reach(&directions);
    if tried.fields.contains(&0.0) {
        tried.fields.iter_mut().filter(|x| **x == 0.0).for_each(|x| *x = 1.0);
        reach = reach.min(tried.reach(&directions));
    }
    Ok(reach)
}

/// Changes of the gradient whose largest component is 1: along all axes, along one, sheared, each with some of a
/// random one, and random ones. Where nothing but the volume changes, or nothing but the shape, some energies are 0,
/// and nothing follows from what rounding leaves of them.
fn directions(d: usize) -> Vec<Sample> {
    let mut random = Random::new(0x7265_6163_6821);
    let unit = |k: usize| (0..d * d).map(|j| f64::from(u8::from(j == k))).collect::<Vec<f64>>();
    let nothing = vec![0.0; d * d];
    let pure = [sample::diagonal(&vec![1.0; d]), unit(0), unit(1), nothing.clone(), nothing];
    let mut all = Vec::new();
    for change in pure {
        let some = sample::tensor(d * d, 0.25, &mut random);
        let change: Vec<f64> = change.iter().zip(some).map(|(h, more)| h + more).collect();
        let other = change.iter().map(|h| -h).collect();
        all.extend([change, other].map(|change| Sample::of_change(change, &mut random)));
    }
    all.iter().map(|one| scaled(one, 1.0)).collect()
}

/// The same with this largest component.
fn scaled(sample: &Sample, size: f64) -> Sample {
    let most = sample.change.iter().fold(0.0_f64, |most, h| most.max(h.abs()));
    let change: Vec<f64> = sample.change.iter().map(|h| h * (size / most)).collect();
    let gradient = sample::plus_identity(&change, 1.0);
    Sample { change, gradient, direction: sample.direction.clone() }
}

impl Tried<'_> {
    fn reach(&mut self, directions: &[Sample]) -> f64 {
        let differing = self.differing(directions);
        let (mut reach, mut size) = (NEAR, NEAR);
        for _ in 0..HALVINGS {
            let samples: Vec<Sample> =
                differing.iter().map(|one| scaled(one, 0.99 * size)).collect();
            let is_worse = self.near_is_worse(&samples);
            size *= 0.5;
            if is_worse {
                reach = size;
            } else if reach < NEAR {
                break;
            }
        }
        reach
    }

    /// The directions in which both forms differ, most of all first.
    fn differing(&mut self, directions: &[Sample]) -> Vec<Sample> {
        let mut found = vec![0.0_f64; directions.len()];
        for size in TRIED {
            let samples: Vec<Sample> = directions.iter().map(|one| scaled(one, size)).collect();
            let [near, far] = [true, false].map(|near| self.evaluate(&samples, near));
            for ((near, far), most) in near.iter().zip(&far).zip(&mut found) {
                for part in parts(directions[0].change.len()) {
                    *most = most.max(difference(&near[part.clone()], &far[part]));
                }
            }
        }
        let mut found: Vec<(f64, &Sample)> = found.into_iter().zip(directions).collect();
        found.retain(|(most, _)| *most > ALIKE);
        found.sort_by(|(x, _), (y, _)| y.total_cmp(x));
        found.into_iter().take(LOOKED_AT).map(|(_, sample)| sample.clone()).collect()
    }

    /// Whether the form near rest has lost digits that the one as written has: of psi, of P along a direction, of dP
    /// along it.
    fn near_is_worse(&mut self, samples: &[Sample]) -> bool {
        let [near, far] = [true, false].map(|near| self.evaluate(samples, near));
        let is_worse = |((near, far), sample): ((&Vec<f64>, &Vec<f64>), &Sample)| {
            let truth = self.truth(sample);
            let [near, far] = [near, far].map(|all| along(all, &sample.direction));
            (0..3).any(|k| {
                let error = |found: f64| {
                    let error = (found - truth[k]).abs();
                    if error.is_nan() { f64::INFINITY } else { error }
                };
                truth[k].is_finite()
                    && error(near[k]) > LOST * truth[k].abs()
                    && error(near[k]) > WORSE * error(far[k])
            })
        };
        near.iter().zip(&far).zip(samples).any(is_worse)
    }

    /// psi and its derivatives along the direction, rounded once; no numbers where there are none.
    fn truth(&self, sample: &Sample) -> [f64; 3] {
        let components = graph::components(self.kernel.dimension());
        let component = |c: u8| {
            let j = components.iter().position(|known| *known == c).unwrap_or(0);
            let at_rest = f64::from(u8::from(c.is_multiple_of(4)));
            Precise::line(sample.change[j], sample.direction[j], at_rest)
        };
        let field = |k: usize| self.fields[k];
        let field = (!self.fields.is_empty()).then_some(&field);
        let psi: Precise<256> = self.written.psi_with(component, field);
        psi.rounded()
    }

    /// psi, then P, then dP at every sample by one form.
    fn evaluate(&mut self, samples: &[Sample], near: bool) -> Vec<Vec<f64>> {
        self.kernel.set_reach(if near { 1.0 } else { 0.0 });
        let of = |k: usize| std::iter::repeat_n(self.fields[k], samples.len());
        let fields: Vec<f64> = (0..self.fields.len()).flat_map(of).collect();
        sample::evaluate_with(&self.kernel, samples, &fields)
    }
}

/// How much two tensors differ in parts of the second; 0 where neither has numbers, infinite where one has none.
fn difference(near: &[f64], far: &[f64]) -> f64 {
    let largest = |numbers: &mut dyn Iterator<Item = f64>| {
        numbers
            .fold(0.0, |most: f64, x| if x.is_finite() { most.max(x.abs()) } else { f64::INFINITY })
    };
    let [of_near, of_far] = [near, far].map(|one| largest(&mut one.iter().copied()));
    match [of_near, of_far].map(f64::is_finite) {
        [false, false] => 0.0,
        [true, true] if of_near == 0.0 && of_far == 0.0 => 0.0,
        [true, true] => largest(&mut near.iter().zip(far).map(|(x, y)| x - y)) / of_far,
        _ => f64::INFINITY,
    }
}

/// psi, P : D and D : dP of psi, P and dP.
fn along(all: &[f64], direction: &[f64]) -> [f64; 3] {
    let [_, stress, product] = parts(direction.len());
    let times = |part: &[f64]| part.iter().zip(direction).map(|(x, d)| x * d).sum();
    [all[0], times(&all[stress]), times(&all[product])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Form;
    use crate::test_support::{model, values};
    use crate::verify::{Outcome, verify};

    /// The forms of an energy of `F`.
    fn forms(energy: &str, d: usize) -> GradientEnergyForms {
        let model = model(&format!("potential p\nallow \"not-objective\"\npsi(F) = {energy}"));
        model.specialise_gradient(&values(&model, d, &[]), Form::Accurate).unwrap().0.unwrap()
    }

    #[test]
    fn forms_of_usual_energies_serve_up_to_the_end_of_the_range() {
        for energy in [
            "E : E",
            "(E : E)^4",
            "tr(C) - 3 - 2*ln(J) + (J - 1)^2",
            "exp(100*(E : E)) - 1",
            "-30*ln(1 - (tr(C) - 3)/30)",
            "tr(ln(U)^2)",
            "sqrt(1 + E : E)",
            "J",
        ] {
            for d in [2, 3] {
                assert_eq!(forms(energy, d).reach, NEAR, "{energy}, d = {d}");
            }
        }
    }

    /// States that are 0 as they begin, and the time step, hide nothing.
    #[test]
    fn fields_that_are_nothing_are_tried_as_one() {
        let text = "potential p\nstate k = 0\nallow \"not-objective\"\npsi(F) = exp(-k)*(E : E)\n\
                    update k = k + dt*exp(-300*(F : F - 2))";
        let model = model(text);
        let values = values(&model, 2, &[]);
        for function in model.gradient_functions(2, Some(&values)).unwrap() {
            assert!(function.forms.reach < 0.02, "{}", function.forms.reach);
        }
    }

    /// A steep function is as exact as it is written, and so are its derivatives, from the distance on where it is
    /// a small part of its value at rest.
    #[test]
    fn what_falls_steeply_is_taken_as_written_where_it_has_fallen() {
        for (energy, most) in [
            ("exp(-300*(F : F - 3))", 0.02),
            ("exp(-300*tr(E)) + 300*tr(E)", NEAR),
            ("1/exp(60*(J - 1))", 0.2),
            ("exp(-50*tr(ln(U)))", 0.25),
            ("(tr(C) - 3 - 2*ln(J))*exp(-1e5*(J - 1)^2)", 0.02),
        ] {
            for d in [2, 3] {
                let reach = forms(energy, d).reach;
                assert!(reach > 0.0 && reach <= most, "{energy}: {reach}");
                let text = format!("potential p\nallow \"not-objective\"\npsi(F) = {energy}");
                let model = model(&text);
                let (found, _) = verify(&model, &values(&model, d, &[]), 200).unwrap();
                assert_ne!(found[0].outcome(), Outcome::Wrong, "{energy}: {:?}", found[0].errors);
            }
        }
    }
}
