//! Derivatives of the two materials, by hand and by dual numbers.

use num_dual::{Dual64, DualNum, HyperDual64};

use super::BULK;
use crate::tensors::{MU, Material, by_hand, numbers};

/// First and second derivatives of what the models store.
pub(super) trait Derivatives {
    /// St Venant-Kirchhoff material.
    type Solid: Material;
    /// The derivative of `(K - 5G/3)/2 theta^2`.
    fn pressure(theta: f64) -> f64;
    /// What it changes by.
    fn pressure_change(theta: f64, change: f64) -> f64;
    /// The derivative of `scale e^2/2` by `l`, `e = l - L`.
    fn tension(scale: f64, length: f64, rest: f64) -> f64;
    /// What it changes by.
    fn tension_change(scale: f64, length: f64, rest: f64, change: f64) -> f64;
}

/// As a program for these models alone would have them.
pub(super) struct ByHand;

impl Derivatives for ByHand {
    type Solid = by_hand::StVenantKirchhoff;

    #[inline(always)]
    fn pressure(theta: f64) -> f64 {
        (BULK - 5.0 * MU / 3.0) * theta
    }

    #[inline(always)]
    fn pressure_change(_theta: f64, change: f64) -> f64 {
        (BULK - 5.0 * MU / 3.0) * change
    }

    #[inline(always)]
    fn tension(scale: f64, length: f64, rest: f64) -> f64 {
        scale * (length - rest)
    }

    #[inline(always)]
    fn tension_change(scale: f64, _length: f64, _rest: f64, change: f64) -> f64 {
        scale * change
    }
}

/// By dual numbers, compiled for each energy.
pub(super) struct ByNumbers;

#[inline(always)]
fn of_dilatation<T: DualNum<Primitive = f64> + Copy>(theta: T) -> T {
    theta * theta * (0.5 * (BULK - 5.0 * MU / 3.0))
}

#[inline(always)]
fn of_length<T: DualNum<Primitive = f64> + Copy>(scale: f64, length: T, rest: f64) -> T {
    let e = length - rest;
    e * e * (0.5 * scale)
}

impl Derivatives for ByNumbers {
    type Solid = numbers::ByNumbers<numbers::StVenantKirchhoff>;

    #[inline(always)]
    fn pressure(theta: f64) -> f64 {
        of_dilatation(Dual64::new(theta, 1.0)).eps
    }

    #[inline(always)]
    fn pressure_change(theta: f64, change: f64) -> f64 {
        of_dilatation(HyperDual64::new(theta, 1.0, change, 0.0)).eps1eps2
    }

    #[inline(always)]
    fn tension(scale: f64, length: f64, rest: f64) -> f64 {
        of_length(scale, Dual64::new(length, 1.0), rest).eps
    }

    #[inline(always)]
    fn tension_change(scale: f64, length: f64, rest: f64, change: f64) -> f64 {
        of_length(scale, HyperDual64::new(length, 1.0, change, 0.0), rest).eps1eps2
    }
}
