//! From a syntax tree to machine code.
//!
//! | stage | input | output | module |
//! |---|---|---|---|
//! | [`check()`] | syntax tree | [`Model`]: names, types, dimensions are right | [`mod@check`] |
//! | [`Model::specialise`] | model, [`Values`] | simplified psi, psi', psi'' per measure | [`specialise`], [`simplify`], [`mod@rewrite`], [`mod@differentiate`] |
//! | [`Model::compile`] | model, values, [`Mode`], [`Form`] | [`Compiled`]: kernels over arrays | [`mod@compile`], [`kernel`], [`jit`] |
//!
//! Only the checker makes a [`Model`]; later stages trust it. Every stage can be printed
//! ([`mod@print`]); [`mod@lint`] looks at it for probable mistakes. [`WrittenEnergy`] evaluates the model as it was written, over any number type:
//! [`mod@verify`] holds everything else against it.

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

mod affine;
pub mod audit;
mod breaking;
pub mod check;
mod clique;
pub mod compile;
mod consistent;
pub mod coupled;
mod density;
pub mod differentiate;
mod dissipation;
mod example;
pub mod expression;
mod formula;
pub mod gathered;
pub mod jit;
pub mod kernel;
pub mod lint;
mod measure;
mod model;
mod near;
pub mod point;
pub mod print;
mod program;
pub mod remember;
pub mod rewrite;
pub mod simplify;
pub mod specialise;
mod squares;
mod tensors;
mod values;
pub mod verify;
mod written;

pub use breaking::{BondFunction, BondFunctionKind, Criterion, FamilyCriterion, NextState};
pub use check::names::reserved_names;
pub use check::unit::unit_names;
pub use check::{CODES, Files, check, check_text, check_text_with};
pub use clique::{Part as CliquePart, Variable};
pub use compile::{Compiled, Kind};
pub use coupled::{CoupledBatch, CoupledKernel, MAX_VARIABLES};
pub use density::DensityForm;
pub use formula::{CompiledFormula, Formula};
pub use gathered::{
    FamilyBatch, FamilyKernel, GatheredBatch, GatheredCriterion, GatheredForms, GatheredFunction,
    GatheredFunctionKind, GatheredKernel, GatheredKernels, GatheredNextState, Integrand, Slot,
    VectorCriterion, VectorKernels, VectorNextState, WrittenFamily,
};
pub use kernel::{Batch, Derivatives, Kernel, Level, Mode, Order, Outputs, WrittenEnergy};
pub use lint::{LINTS, Lint};
pub use measure::{Argument, Measure};
pub use model::{
    Break, Constraint, Dissipation, Energy, GatheredEnergy, GradientEnergy, Integral, Interval,
    Model, Of, OfFamily, Parameter, Update, Variant,
};
pub use point::{
    GradientBatch, GradientCriterion, GradientEnergyForms, GradientFunction, GradientFunctionKind,
    GradientKernel, GradientNextState,
};
pub use specialise::{CompileError, Dropped, Form, ScalarEnergy, Specialised};
pub use tensors::{NotInTensors, TensorForm};
pub use values::{MAX_FIELDS, Setting, ValueError, Values, is_quantity, quantity};

#[cfg(test)]
mod test_support;
