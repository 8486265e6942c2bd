//! Energies of the fields `u` and `H`: what they ask for and where their derivatives go.

use rayon::prelude::*;

use super::batch::{CAPACITY, LawBatch};
use crate::assembly::sum::Sum;
use crate::fields::stored::Tensor;
use crate::interaction::Slabs;
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::materials::{LawOfPoints, Place};

/// Displacements with their gradients at the points.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a, const D: usize> {
    pub(super) u: &'a [[f64; D]],
    pub(super) h: &'a [Tensor<D>],
}

/// The number of a component of `H`, counted row by row, where second derivatives are stored: these are kept column by column, so
/// that what belongs to one displacement stands side by side.
pub(super) fn turned<const D: usize>(component: usize) -> usize {
    component % D * D + component / D
}

/// What is asked of an energy.
#[derive(Clone, Copy)]
pub(super) enum Pass<'a, const D: usize> {
    /// Its value.
    Energy,
    /// Also its derivatives.
    Gradient,
    /// Also, in the place of the derivatives by `H`, those of the energies of points by a uniform `G`
    /// on top of the fields: half of a bond's for either end.
    Virial,
    /// Its second derivatives times these fields.
    Product(Fields<'a, D>),
}

/// What a pass leaves behind; arrays that are not wanted are empty.
#[derive(Default)]
pub(super) struct Duals<'a, const D: usize> {
    /// The energy by points in J: half of a bond's for either end. Only of [`Pass::Energy`].
    pub(super) shares: &'a mut [f64],
    /// Derivatives by `H`, or products.
    pub(super) stress: &'a mut [Tensor<D>],
    /// Derivatives by `u`, as far as the energy depends on it other than by `H`, or products.
    pub(super) force: &'a mut [[f64; D]],
}

/// The same at the points that the bonds of a slab touch.
pub(super) struct TouchedDuals<'a, const D: usize> {
    pub(super) shares: Touched<'a, f64>,
    pub(super) stress: Touched<'a, Tensor<D>>,
    pub(super) force: Touched<'a, [f64; D]>,
}

/// The energies of all chunks of points, or of all slabs, on their way to the sum: room for one pass
/// after the other.
pub(super) type Parts = Vec<Result<Sum, Failure>>;

/// Points or bonds whose energy is not finite, and the determinant of their deformation gradient.
pub(super) struct Failure {
    pub(super) points: Vec<usize>,
    pub(super) determinant: f64,
}

/// `sum_i V_i psi(F_i)` over all points.
pub(super) fn over_points<const D: usize>(
    law: LawOfPoints<'_>,
    volumes: &[f64],
    fields: Fields<'_, D>,
    pass: Pass<'_, D>,
    duals: &mut Duals<'_, D>,
    parts: &mut Parts,
) -> Result<Sum, Failure> {
    restart(parts, volumes.len().div_ceil(CAPACITY));
    let range = |chunk: usize| chunk * CAPACITY..volumes.len().min((chunk + 1) * CAPACITY);
    let evaluate = |batch: &mut LawBatch<D>, chunk: usize| -> Result<Sum, Failure> {
        let h = &fields.h[range(chunk)];
        let law = (law, law.numbers(range(chunk)));
        let places = (|lane| Place::at(range(chunk).start + lane), h);
        let done = match pass {
            Pass::Energy => batch.evaluate(law, places, false),
            Pass::Gradient | Pass::Virial => batch.evaluate(law, places, true),
            Pass::Product(direction) => batch.multiply(law, places, &direction.h[range(chunk)]),
        };
        done.map_err(|lane| Failure {
            points: vec![range(chunk).start + lane],
            determinant: super::batch::determinant(&h[lane]),
        })?;
        Ok(match pass {
            Pass::Product(_) => Sum::default(),
            _ => Sum::of_products(batch.psi(), &volumes[range(chunk)]),
        })
    };
    let chunks = parts.par_iter_mut().enumerate();
    if !duals.stress.is_empty() {
        let write = |batch: &LawBatch<D>, chunk: usize, out: &mut [Tensor<D>]| {
            for (lane, (out, volume)) in out.iter_mut().zip(&volumes[range(chunk)]).enumerate() {
                *out = batch.tensor(lane);
                out.as_flattened_mut().iter_mut().for_each(|x| *x *= volume);
            }
        };
        let chunks = chunks.zip(duals.stress.par_chunks_mut(CAPACITY));
        chunks.for_each_init(LawBatch::new, |batch, ((chunk, part), out)| {
            *part = evaluate(batch, chunk).inspect(|_| write(batch, chunk, out));
        });
    } else if !duals.shares.is_empty() {
        let write = |batch: &LawBatch<D>, chunk: usize, out: &mut [f64]| {
            let terms = batch.psi().iter().zip(&volumes[range(chunk)]);
            out.iter_mut().zip(terms).for_each(|(out, (psi, volume))| *out = volume * psi);
        };
        let chunks = chunks.zip(duals.shares.par_chunks_mut(CAPACITY));
        chunks.for_each_init(LawBatch::new, |batch, ((chunk, part), out)| {
            *part = evaluate(batch, chunk).inspect(|_| write(batch, chunk, out));
        });
    } else {
        chunks.for_each_init(LawBatch::new, |batch, (chunk, part)| *part = evaluate(batch, chunk));
    }
    joined(parts)
}

/// Makes room for so many parts.
fn restart(parts: &mut Parts, n: usize) {
    parts.clear();
    parts.resize_with(n, || Ok(Sum::default()));
}

/// The sum of all parts in their order; the first failure counts.
fn joined(parts: &mut Parts) -> Result<Sum, Failure> {
    let mut total = Sum::default();
    for part in parts.drain(..) {
        total.join(&part?);
    }
    Ok(total)
}

/// Visits the bonds slab by slab. A slab's bonds belong to their lower points and touch its own points
/// and those of the next slab, whose part of `duals` the visit gets.
pub(super) fn over_bonds<const D: usize>(
    slabs: &Slabs,
    duals: Duals<'_, D>,
    parts: &mut Parts,
    run: impl Fn(usize, TouchedDuals<'_, D>) -> Result<Sum, Failure> + Sync,
) -> Result<Sum, Failure> {
    restart(parts, slabs.len());
    let points = Layout::Points(1);
    let shared = (
        Part::new(points, duals.shares),
        Part::new(points, duals.stress),
        Part::new(points, duals.force),
    );
    let own = Part::new(Layout::Slabs, &mut parts[..]);
    visit(slabs, shared, own, |slab, [here, next], part| {
        let touched = TouchedDuals {
            shares: Touched::new(&mut here.0, &mut next.0),
            stress: Touched::new(&mut here.1, &mut next.1),
            force: Touched::new(&mut here.2, &mut next.2),
        };
        let done = run(slab, touched);
        part.into_values()[0] = done;
    });
    joined(parts)
}
