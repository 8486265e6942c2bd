//! Energies of the fields `u` and `H`: what they ask for and where their derivatives go.

use rayon::prelude::*;

use super::batch::{CAPACITY, LawBatch};
use super::operator::Tensor;
use crate::assembly::sum::Sum;
use crate::element::WIDEST;
use crate::interaction::Slabs;
use crate::kernel::VariablesLaw;

/// Displacements with their gradients at the points.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a, const D: usize> {
    pub(super) u: &'a [[f64; D]],
    pub(super) h: &'a [Tensor<D>],
}

/// What is asked of an energy.
#[derive(Clone, Copy)]
pub(super) enum Pass<'a, const D: usize> {
    /// Its value.
    Energy,
    /// Also its derivatives.
    Gradient,
    /// Its second derivatives times these fields.
    Product(Fields<'a, D>),
}

/// What a pass leaves behind at some points; arrays that are not wanted are empty.
#[derive(Default)]
pub(super) struct Duals<'a, const D: usize> {
    /// The first of the points.
    pub(super) first: usize,
    /// The energy by points in J: half of a bond's for either end. Only of [`Pass::Energy`].
    pub(super) shares: &'a mut [f64],
    /// Derivatives by `H`, or products.
    pub(super) stress: &'a mut [Tensor<D>],
    /// Derivatives by `u`, as far as the energy depends on it other than by `H`, or products.
    pub(super) force: &'a mut [[f64; D]],
}

/// Points or bonds whose energy is not finite, and the determinant of their deformation gradient.
pub(super) struct Failure {
    pub(super) points: Vec<usize>,
    pub(super) determinant: f64,
}

/// `sum_i V_i psi(F_i)` over all points.
pub(super) fn over_points<const D: usize>(
    law: &dyn VariablesLaw,
    volumes: &[f64],
    fields: Fields<'_, D>,
    pass: Pass<'_, D>,
    duals: &mut Duals<'_, D>,
) -> Result<Sum, Failure> {
    let chunks = volumes.len().div_ceil(CAPACITY);
    let range = |chunk: usize| chunk * CAPACITY..volumes.len().min((chunk + 1) * CAPACITY);
    let evaluate = |batch: &mut LawBatch<D>, chunk: usize| -> Result<Sum, Failure> {
        let h = &fields.h[range(chunk)];
        let done = match pass {
            Pass::Energy => batch.evaluate(law, h, false),
            Pass::Gradient => batch.evaluate(law, h, true),
            Pass::Product(direction) => batch.multiply(law, h, &direction.h[range(chunk)]),
        };
        done.map_err(|lane| Failure {
            points: vec![range(chunk).start + lane],
            determinant: super::batch::determinant(&h[lane]),
        })?;
        Ok(match pass {
            Pass::Product(_) => Sum::default(),
            _ => weighted(batch.psi(), &volumes[range(chunk)]),
        })
    };
    let sums: Vec<Result<Sum, Failure>> = if !duals.stress.is_empty() {
        let run = |batch: &mut LawBatch<D>, (chunk, out): (usize, &mut [Tensor<D>])| {
            let sum = evaluate(batch, chunk)?;
            for (lane, (out, volume)) in out.iter_mut().zip(&volumes[range(chunk)]).enumerate() {
                *out = batch.tensor(lane);
                out.as_flattened_mut().iter_mut().for_each(|x| *x *= volume);
            }
            Ok(sum)
        };
        let stress = duals.stress.par_chunks_mut(CAPACITY).enumerate();
        stress.map_init(LawBatch::new, run).collect()
    } else if !duals.shares.is_empty() {
        let run = |batch: &mut LawBatch<D>, (chunk, out): (usize, &mut [f64])| {
            let sum = evaluate(batch, chunk)?;
            for (out, (psi, volume)) in
                out.iter_mut().zip(batch.psi().iter().zip(&volumes[range(chunk)]))
            {
                *out = volume * psi;
            }
            Ok(sum)
        };
        let shares = duals.shares.par_chunks_mut(CAPACITY).enumerate();
        shares.map_init(LawBatch::new, run).collect()
    } else {
        (0..chunks).into_par_iter().map_init(LawBatch::new, evaluate).collect()
    };
    joined(sums)
}

/// The sum of the products of two arrays.
pub(crate) fn weighted(values: &[f64], weights: &[f64]) -> Sum {
    let mut sum = Sum::default();
    for (values, weights) in values.chunks(WIDEST).zip(weights.chunks(WIDEST)) {
        let mut terms = [0.0; WIDEST];
        for (term, (value, weight)) in terms.iter_mut().zip(values.iter().zip(weights)) {
            *term = weight * value;
        }
        sum.add(&terms);
    }
    sum
}

/// The sum of all parts in their order; the first failure counts.
pub(super) fn joined(parts: Vec<Result<Sum, Failure>>) -> Result<Sum, Failure> {
    let mut total = Sum::default();
    for part in parts {
        total.join(&part?);
    }
    Ok(total)
}

/// Visits the bonds slab by slab: even slabs at once, then the odd ones. A slab's bonds belong to
/// their lower points and touch its own points and those of the next slab, whose part of `duals` the
/// visit gets. Where nothing is left behind all slabs go at once.
pub(super) fn over_bonds<const D: usize>(
    slabs: &Slabs,
    duals: Duals<'_, D>,
    visit: impl Fn(usize, Duals<'_, D>) -> Result<Sum, Failure> + Sync,
) -> Result<Sum, Failure> {
    let mut parts: Vec<(usize, Result<Sum, Failure>)> = Vec::with_capacity(slabs.len());
    let Duals { shares, stress, force, .. } = duals;
    let n_colors = if shares.is_empty() && stress.is_empty() { 1 } else { 2 };
    for color in 0..n_colors {
        let (mut shares, mut stress, mut force) = (&mut *shares, &mut *stress, &mut *force);
        let mut at = 0;
        let mut tasks = Vec::new();
        for slab in (color..slabs.len()).step_by(n_colors) {
            let touched = slabs.touched(slab);
            // Empty arrays may be cut more than once.
            let skip = touched.start.saturating_sub(at);
            let own = Duals {
                first: touched.start,
                shares: cut(&mut shares, skip, touched.len()),
                stress: cut(&mut stress, skip, touched.len()),
                force: cut(&mut force, skip, touched.len()),
            };
            tasks.push((slab, own));
            at = touched.end;
        }
        let run = |(slab, own)| (slab, visit(slab, own));
        let done: Vec<_> = tasks.into_par_iter().with_max_len(1).map(run).collect();
        parts.extend(done);
    }
    parts.sort_by_key(|(slab, _)| *slab);
    joined(parts.into_iter().map(|(_, part)| part).collect())
}

/// Leaves out `skip` entries and takes `length`; of an empty array nothing.
fn cut<'a, T>(rest: &mut &'a mut [T], skip: usize, length: usize) -> &'a mut [T] {
    if rest.is_empty() {
        return &mut [];
    }
    let (_, tail) = std::mem::take(rest).split_at_mut(skip);
    let (taken, tail) = tail.split_at_mut(length);
    *rest = tail;
    taken
}
