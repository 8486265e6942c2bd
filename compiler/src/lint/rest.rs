//! At rest: no force, and a stiffness.

use super::Finding;
use super::subject::{Subject, short};
use crate::clique::Part;
use crate::expression::Input;
use crate::model::{CoupledEnergy, Variant};

/// How much smaller than around it a value must be to count as 0.
const NOTHING: f64 = 1e-9;

/// Stretches beside rest, and which part of psi'' a tenth around it is there no power of the strain.
const BESIDE: [f64; 2] = [1.0 - 1e-7, 1.0 + 1e-7];
const ENOUGH: f64 = 1e-2;

/// psi' at rest, if it is a force and no rounding.
pub(super) fn not_stress_free(subject: &Subject<'_>) -> Option<Finding> {
    let (force, around) = at_rest(subject, 1)?;
    if force.abs() <= NOTHING * around {
        return None;
    }
    let symbol = subject.symbol();
    let rest = subject.measure().reference_symbol();
    Some(Finding {
        message: format!(
            "psi({symbol}) is not stress-free: psi'({symbol}) = {} at {}",
            short(force),
            subject.place(1.0)
        ),
        help: format!(
            "let the energy have its minimum at rest, as `({symbol}/{rest} - 1)^2` and \
             `ln({symbol}/{rest})^2` have"
        ),
    })
}

/// psi'' at rest, if it is not positive. Bonds across a fibre may have none.
pub(super) fn not_stiff(subject: &Subject<'_>) -> Option<Finding> {
    if subject.sees_direction() {
        return None;
    }
    let (stiffness, around) = at_rest(subject, 2)?;
    // Where branches meet at rest, it is that on both sides.
    let beside = BESIDE.map(|stretch| subject.at_stretch(stretch)[2]);
    if stiffness > NOTHING * around || beside.iter().all(|one| *one > ENOUGH * around) {
        return None;
    }
    let symbol = subject.symbol();
    let rest = subject.measure().reference_symbol();
    Some(Finding {
        message: format!(
            "psi({symbol}) is not stiff at rest: psi''({symbol}) = {} at {}",
            short(stiffness),
            subject.place(1.0)
        ),
        help: format!(
            "it stiffens no small deformation: add a term that is quadratic at rest, such as \
             `({symbol}/{rest} - 1)^2`"
        ),
    })
}

/// An energy of `xi` that holds more of it than its length: `Xi` does not turn with the body.
pub(super) fn not_objective(variant: &Variant, energy: &CoupledEnergy) -> Option<Finding> {
    let axes = 0..variant.dimension as u8;
    let moved = |axis| Input::Part(Part::Moved(axis));
    let mut held = axes.filter(|axis| variant.graph.depends_on(&[energy.root], moved(*axis)));
    held.next()?;
    Some(Finding {
        message: "psi(xi) is not objective: a body that is turned as a whole stores energy".into(),
        help:
            "it is meant for small rotations; `psi(l)` may hold `Xi`, and no rotation changes that"
                .into(),
    })
}

/// psi' or psi'' at rest, and its largest absolute value a tenth around it. None where rest does not
/// belong to the domain or the value is no number.
fn at_rest(subject: &Subject<'_>, order: usize) -> Option<(f64, f64)> {
    let value = subject.at_stretch(1.0)[order];
    if !subject.declares(1.0) || !value.is_finite() {
        return None;
    }
    let around = [0.9, 1.1].map(|stretch| subject.at_stretch(stretch)[order].abs());
    Some((value, around.into_iter().filter(|x| x.is_finite()).fold(value.abs(), f64::max)))
}
