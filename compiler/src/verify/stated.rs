//! Which subexpression of an energy of several variables loses digits, in the user's words where it can
//! be found in the text.
//!
//! Forms are graphs of components, in which nothing of the text is left but its values. So what loses
//! digits is looked up by its true value among the numbers that the text states, each evaluated as it
//! was written; what is only made by differentiation is what the energy as written loses digits in.

use super::cause::{Cause, Compared, Exact, Part, Stated};
use crate::density::DensityForm;
use crate::expression::number::Number;
use crate::expression::{Input, NodeId, Operator};
use crate::model::{Model, Variant};
use crate::point::sample::Sample;
use crate::point::{GradientEnergyForms, axes};
use crate::values::Values;

/// Two true values that differ by less than this part of themselves are one.
const SAME: f64 = 1e-12;

/// Two errors that differ by less than this factor are one.
const AS_FAR_OFF: f64 = 16.0;

/// Inputs of an energy, in doubles as a kernel gets them, and exactly.
struct Given<D, E> {
    double: D,
    exact: E,
}

/// Where psi, P or dP (`order` 0, 1, 2) of these forms loses its digits at a gradient.
pub(crate) fn cause_of_gradient(
    (model, values): (&Model, &Values),
    forms: &GradientEnergyForms,
    order: usize,
    sample: &Sample,
) -> Option<Cause> {
    let near = forms.near.as_ref().filter(|_| forms.is_near(&sample.change));
    let form = near.unwrap_or(&forms.far);
    let d = forms.dimension;
    let axes = match (form.has_axes(), near.is_some()) {
        (false, _) => Vec::new(),
        (true, true) => axes::at_one(d, &sample.change, true),
        (true, false) => axes::at_one(d, &sample.gradient, false),
    };
    let axis = |input| axes.iter().find(|(known, _)| *known == input).map(|(_, x)| *x);
    let place = |k: u8| d * usize::from(k / 3) + usize::from(k % 3);
    let at_rest = |k: u8| f64::from(u8::from(k.is_multiple_of(4)));
    let given = Given {
        double: |input| match input {
            Input::Variable(k) => sample.gradient[place(k)],
            Input::VariableChange(k) => sample.change[place(k)],
            Input::Direction(k) => sample.direction[place(k)],
            _ => axis(input).unwrap_or(f64::NAN),
        },
        exact: |input| match input {
            Input::Variable(k) if sample.is_near() => {
                Exact::line(sample.change[place(k)], 0.0, at_rest(k))
            }
            Input::VariableChange(k) if !sample.is_near() => {
                Exact::line(sample.gradient[place(k)], 0.0, -at_rest(k))
            }
            Input::Variable(k) => Exact::constant(sample.gradient[place(k)]),
            Input::VariableChange(k) => Exact::constant(sample.change[place(k)]),
            Input::Direction(k) => Exact::constant(sample.direction[place(k)]),
            // Axes are found before machine code runs, and are inputs of it.
            _ => Exact::constant(axis(input).unwrap_or(f64::NAN)),
        },
    };
    let variant = model.variant(values.dimension)?;
    cause((model, values, variant), form, order, &given, near.is_none())
}

/// Where the energy of points or of bonds, its gradient or its product (`order` 0, 1, 2) loses its digits
/// for these variables: of bonds first the length, whose value at rest is given, then the integrals.
pub(crate) fn cause_of_gathered(
    (model, values): (&Model, &Values),
    form: &DensityForm,
    order: usize,
    (variables, direction, reference): (&[f64], &[f64], Option<f64>),
) -> Option<Cause> {
    let first = usize::from(reference.is_some());
    let rest = reference.unwrap_or(f64::NAN);
    let given = Given {
        double: |input| match input {
            Input::Current(_) => variables[0],
            Input::Reference(_) => rest,
            Input::Change(_) => (variables[0] - rest) / rest,
            Input::Integral(k) => variables[first + usize::from(k)],
            Input::Direction(k) => direction[usize::from(k)],
            _ => f64::NAN,
        },
        exact: |input| match input {
            Input::Change(_) => {
                let change = Exact::line(variables[0], 0.0, -rest);
                Exact::binary(Operator::Divide, change, Exact::constant(rest))
            }
            Input::Current(_) => Exact::constant(variables[0]),
            Input::Reference(_) => Exact::constant(rest),
            Input::Integral(k) => Exact::constant(variables[first + usize::from(k)]),
            Input::Direction(k) => Exact::constant(direction[usize::from(k)]),
            _ => Exact::constant(f64::NAN),
        },
    };
    let variant = model.variant(values.dimension)?;
    cause((model, values, variant), form, order, &given, true)
}

/// Where a function of several numbers, its gradient or its product loses its digits; inputs are given as doubles, and
/// exactly.
pub(crate) fn cause_of_several(
    (model, values): (&Model, &Values),
    form: &DensityForm,
    order: usize,
    (double, exact): (impl Fn(Input) -> f64, impl Fn(Input) -> Exact),
) -> Option<Cause> {
    let variant = model.variant(values.dimension)?;
    cause((model, values, variant), form, order, &Given { double, exact }, true)
}

/// Where psi, its gradient or its product (`order` 0, 1, 2) loses its digits at a place; inputs are given
/// as doubles, and numbers like these exactly. Unless `as_written`, what the energy as written loses says
/// nothing of the form.
fn cause<D: Fn(Input) -> f64, E: Fn(Input) -> Exact>(
    (model, values, variant): (&Model, &Values, &Variant),
    form: &DensityForm,
    order: usize,
    given: &Given<D, E>,
    as_written: bool,
) -> Option<Cause> {
    let roots = match order {
        0 => std::slice::from_ref(&form.psi),
        1 => &form.gradient,
        _ => &form.product,
    };
    let (graph, roots) = form.graph.extract(roots);
    let compared = Compared::new(&graph, &given.double, &given.exact);
    let off = |root: &NodeId| compared.difference(*root);
    let root = roots.iter().max_by(|x, y| off(x).total_cmp(&off(y)))?;
    let (node, mut cause) = compared.cause(model, order, *root)?;
    let written = as_written_at(values, variant, given);
    let (found, error) = (compared.truth(node), compared.error(node));
    // Where the energy runs as written what it states has lost the same digits.
    let has_lost = |stated| !as_written || AS_FAR_OFF * written.error(stated) > error;
    let same = variant
        .stated
        .iter()
        .find(|(stated, _)| is_multiple(found, written.truth(*stated)) && has_lost(*stated));
    cause.stated = same.map(|(_, stated)| *stated).or_else(|| {
        let lost = |(node, _): &&(NodeId, Stated)| written.error_made(*node);
        let worst = variant.stated.iter().max_by(|x, y| lost(x).total_cmp(&lost(y)))?;
        let part = if order == 0 { Part::Whole } else { Part::Derivative };
        (as_written && lost(&worst) > 0.0).then_some(Stated { part, ..worst.1 })
    });
    Some(cause)
}

/// All that is written, with these values.
fn as_written_at<'a, D: Fn(Input) -> f64, E: Fn(Input) -> Exact>(
    values: &Values,
    variant: &'a Variant,
    given: &Given<D, E>,
) -> Compared<'a> {
    let known = |input| match input {
        Input::Parameter(i) => values.parameters.get(usize::from(i)).copied(),
        Input::Horizon => Some(values.horizon),
        _ => None,
    };
    Compared::new(
        &variant.graph,
        |input| known(input).unwrap_or_else(|| (given.double)(input)),
        |input| known(input).map_or_else(|| (given.exact)(input), Exact::constant),
    )
}

/// Whether one number is the other times a power of two: factors like these are moved about.
fn is_multiple(x: f64, y: f64) -> bool {
    let ratio = (x / y).abs();
    if !(ratio > 0.0 && ratio.is_finite()) {
        return false;
    }
    let (part, _) = libm::frexp(ratio);
    (part - 0.5).abs() < SAME || 1.0 - part < SAME
}
