//! The largest stable step of explicit integration, with lumped masses.
//!
//! Without dissipation it is `2/omega`, with the largest eigenvalue `omega^2` of `M^-1 K`. It is found by
//! Lanczos' method with exact products: an eigenvalue lies within the residual of the one found, and it is the
//! largest unless the start has nothing of its eigenvector. The sums of the rows of `K` bound it for certain,
//! from above.
//!
//! What bonds dissipate acts with velocities that a straight line leads to ([`super`]). A motion of growth `z`
//! per step then obeys `z^3 - 2 z^2 + z + W z^2 + m (3 z^2 - 4 z + 1)/2 = 0`, with the means `W` of
//! `dt^2 M^-1 K` and `m` of `dt M^-1 C` over it, `C` the second derivative of the Rayleigh potential. By the
//! criterion of Schur and Cohn no root lies outside the unit circle as long as `W + 4 m <= 4`: steps up to
//! `2/(sqrt(omega^2 + mu^2) + mu)` are stable, with the largest eigenvalue `mu` of `M^-1 C`. Where both belong
//! to one motion, as where all bonds are as viscous as stiff, longer ones are not.

use piola_mechanics::energy::{Energy, Hessian, NonFinite};
use piola_mechanics::matrix::BlockMatrix;
use piola_mechanics::vector::dot;
use rayon::prelude::*;

use super::others::{Nobody, Others};
use crate::constraint::Constraints;

/// How far the largest eigenvalue is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// It is known when the residual is at most this part of it.
    pub tolerance: f64,
    /// Most products with the Hessian.
    pub products: usize,
}

impl Default for Precision {
    fn default() -> Self {
        Precision { tolerance: 1e-4, products: 200 }
    }
}

/// The largest stable step at some displacements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalStep {
    /// In s: 2 over the largest angular frequency, and less where bonds dissipate.
    pub seconds: f64,
    /// The largest angular frequency in 1/s; the residual of its square is added, so that the step
    /// errs on the safe side.
    pub frequency: f64,
    /// The largest eigenvalue of `M^-1 C` in 1/s with its residual; 0 where nothing is dissipated.
    pub viscosity: f64,
    /// The residual over the eigenvalue.
    pub uncertainty: f64,
    /// Products with the Hessian.
    pub products: usize,
}

impl CriticalStep {
    /// At rest at displacements `u` (`n x d`) in m; `masses` has one entry per point, in kg. Nothing where
    /// neither the largest eigenvalue of `M^-1 K` nor that of `M^-1 C` is positive.
    ///
    /// # Errors
    /// Second derivatives that are not finite.
    pub fn find(
        energy: &dyn Energy,
        u: &[f64],
        masses: &[f64],
        constraints: &Constraints,
        precision: Precision,
    ) -> Result<Option<CriticalStep>, NonFinite> {
        let at_rest = vec![0.0; u.len()];
        CriticalStep::find_moving(energy, (u, &at_rest), masses, constraints, precision)
    }

    /// The same with velocities (`n x d`) in m/s, on which depends what is dissipated.
    ///
    /// # Errors
    /// As [`CriticalStep::find`].
    pub fn find_moving(
        energy: &dyn Energy,
        (u, v): (&[f64], &[f64]),
        masses: &[f64],
        constraints: &Constraints,
        precision: Precision,
    ) -> Result<Option<CriticalStep>, NonFinite> {
        let hessians = Hessians::of(energy, (u, v))?;
        Ok(hessians.critical(&Nobody, energy.dimension(), masses, constraints, precision))
    }
}

/// Second derivatives by displacements and, where bonds dissipate, by velocities.
pub(super) struct Hessians<'a> {
    stiffness: Box<dyn Hessian + 'a>,
    viscosity: Option<Box<dyn Hessian + 'a>>,
}

impl<'a> Hessians<'a> {
    /// At displacements in m and velocities in m/s, `n x d`.
    ///
    /// # Errors
    /// As [`CriticalStep::find`].
    pub(super) fn of(
        energy: &'a dyn Energy,
        (u, v): (&[f64], &[f64]),
    ) -> Result<Hessians<'a>, NonFinite> {
        let viscosity = energy.dissipation().map(|dissipation| dissipation.viscosity(u, v));
        Ok(Hessians { stiffness: energy.hessian(u)?, viscosity: viscosity.transpose()? })
    }

    /// What [`CriticalStep::find`] says, of a body in `d` dimensions; where it has other parts, degrees of freedom
    /// beyond this one are fixed. Collective.
    pub(super) fn critical(
        &self,
        others: &dyn Others,
        d: usize,
        masses: &[f64],
        constraints: &Constraints,
        precision: Precision,
    ) -> Option<CriticalStep> {
        // Fixed degrees of freedom are scaled away, before and after the product.
        let scale: Vec<f64> = (0..masses.len() * d)
            .map(|dof| if constraints.is_fixed(dof) { 0.0 } else { 1.0 / masses[dof / d].sqrt() })
            .collect();
        let mut free = [constraints.n_free() as f64];
        others.sum(&mut free);
        let precision =
            Precision { products: precision.products.min(free[0] as usize), ..precision };
        let body = (others, d);
        let stiff = Largest::of(body, &*self.stiffness, &scale, precision);
        let viscous = match &self.viscosity {
            Some(viscosity) => Largest::of(body, &**viscosity, &scale, precision),
            None => Largest::default(),
        };
        let (frequency, viscosity) = (stiff.bound().sqrt(), viscous.bound());
        if frequency == 0.0 && viscosity == 0.0 {
            return None;
        }
        let seconds = match viscosity {
            0.0 => 2.0 / frequency,
            _ => 2.0 / ((stiff.bound() + viscosity * viscosity).sqrt() + viscosity),
        };
        let uncertainty = stiff.uncertainty().max(viscous.uncertainty());
        let products = stiff.products + viscous.products;
        Some(CriticalStep { seconds, frequency, viscosity, uncertainty, products })
    }
}

/// The largest eigenvalue of `M^-1 A` for a matrix `A`, as far as it is known.
#[derive(Clone, Copy, Debug, Default)]
struct Largest {
    value: f64,
    residual: f64,
    products: usize,
}

impl Largest {
    /// By Lanczos' method on `M^-1/2 A M^-1/2`, from a vector that nothing distinguishes; `scale` has the
    /// entries of `M^-1/2`, 0 of what is fixed.
    fn of(
        (others, d): (&dyn Others, usize),
        matrix: &dyn Hessian,
        scale: &[f64],
        precision: Precision,
    ) -> Largest {
        let n = scale.len();
        let sum = |part: f64| {
            let mut parts = [part];
            others.sum(&mut parts);
            parts[0]
        };
        let mut vector = start(scale, others.first() * d);
        let length = sum(dot(&vector, &vector)).sqrt();
        vector.iter_mut().for_each(|x| *x /= length);
        let [mut before, mut product, mut scaled] = [(); 3].map(|()| vec![0.0; n]);
        put(&mut scaled, |dof| vector[dof] * scale[dof]);
        let (mut diagonal, mut beside): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let (mut found, most) = ((0.0, f64::INFINITY), precision.products);
        while diagonal.len() < most {
            others.bring(&mut scaled);
            matrix.multiply(&scaled, &mut product);
            let along = sum(change(&mut product, |dof, x| {
                let x = x * scale[dof];
                (x, x * vector[dof])
            }));
            let last = beside.last().copied().unwrap_or(0.0);
            let square = sum(change(&mut product, |dof, x| {
                let x = x - (along * vector[dof] + last * before[dof]);
                (x, x * x)
            }));
            let norm = square.sqrt();
            diagonal.push(along);
            let (k, ends) = (diagonal.len(), norm <= 1e-12 * along.abs());
            if k.is_multiple_of(10) || k == most || ends {
                found = largest(&diagonal, &beside, norm);
                if found.1 <= precision.tolerance * found.0 || ends {
                    break;
                }
            }
            beside.push(norm);
            std::mem::swap(&mut before, &mut vector);
            put(&mut vector, |dof| product[dof] / norm);
            put(&mut scaled, |dof| vector[dof] * scale[dof]);
        }
        Largest { value: found.0, residual: found.1, products: diagonal.len() }
    }

    fn is_positive(self) -> bool {
        self.value > 0.0 && self.value.is_finite()
    }

    /// The eigenvalue on the safe side; 0 where it is not positive.
    fn bound(self) -> f64 {
        if self.is_positive() { self.value + self.residual } else { 0.0 }
    }

    fn uncertainty(self) -> f64 {
        if self.is_positive() { self.residual / self.value } else { 0.0 }
    }
}

/// A step in s that is stable for certain where nothing is dissipated: `2/sqrt(max_i sum_j |K_ij|/m_i)` over the
/// free degrees of freedom (Gershgorin); infinite without stiffness. Takes the whole tangent into memory.
///
/// # Errors
/// Second derivatives that are not finite.
pub fn step_by_row_sums(
    energy: &dyn Energy,
    u: &[f64],
    masses: &[f64],
    constraints: &Constraints,
) -> Result<f64, NonFinite> {
    let (d, pattern) = (energy.dimension(), energy.pattern());
    let mut tangent = BlockMatrix::zeros(pattern);
    energy.tangent(u, &mut vec![0.0; u.len()], &mut tangent)?;
    let mut sums = vec![0.0; u.len()];
    for row in 0..pattern.n_rows() {
        for place in pattern.row_start[row]..pattern.row_start[row + 1] {
            let column = pattern.columns[place] as usize;
            for (r, c) in (0..d).flat_map(|r| (0..d).map(move |c| (r, c))) {
                let (one, other) = (row * d + r, column * d + c);
                if constraints.is_fixed(one) || constraints.is_fixed(other) {
                    continue;
                }
                let entry = tangent.values[(place * d + r) * d + c].abs();
                sums[one] += entry;
                // Of two blocks that mirror each other one is stored.
                if column != row {
                    sums[other] += entry;
                }
            }
        }
    }
    let over_mass = sums.iter().enumerate().map(|(dof, sum)| sum / masses[dof / d]);
    Ok(2.0 / over_mass.fold(0.0, f64::max).sqrt())
}

/// The largest eigenvalue of the tridiagonal matrix and the residual of its vector in the space
/// that goes on with `norm`.
///
/// The pivots `q_1 = d_1 - x`, `q_k = d_k - x - b_(k-1)^2/q_(k-1)` are negative throughout above all eigenvalues and
/// nowhere else (Sturm). The vector follows from the pivots from above and those from below, which meet where the
/// vector is large (a twisted factorisation: Dhillon, Parlett, 2004), so that its last component has digits also where
/// it is tiny.
fn largest(diagonal: &[f64], beside: &[f64], norm: f64) -> (f64, f64) {
    let n = diagonal.len();
    if !diagonal.iter().chain(&beside[..n - 1]).all(|x| x.is_finite()) {
        return (f64::NAN, f64::INFINITY);
    }
    let next =
        |k: usize, beside: f64, pivot: f64, x: f64| diagonal[k] - x - beside * (beside / pivot);
    let is_above = |x: f64| {
        let mut pivot = diagonal[0] - x;
        for k in 1..n {
            if pivot >= 0.0 {
                return false;
            }
            pivot = next(k, beside[k - 1], pivot, x);
        }
        pivot < 0.0
    };
    let radius = |k: usize| {
        let [left, right] = [k.checked_sub(1), Some(k).filter(|k| k + 1 < n)];
        [left, right].into_iter().flatten().map(|k| beside[k].abs()).sum::<f64>()
    };
    let most = (0..n).map(|k| diagonal[k] + radius(k)).fold(f64::NEG_INFINITY, f64::max);
    let mut low = diagonal.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut high = most + 8.0 * f64::EPSILON * most.abs() + f64::MIN_POSITIVE;
    loop {
        let middle = low + 0.5 * (high - low);
        if middle <= low || middle >= high {
            break;
        }
        *if is_above(middle) { &mut high } else { &mut low } = middle;
    }
    let mut down = vec![diagonal[0] - high];
    for k in 1..n {
        down.push(next(k, beside[k - 1], down[k - 1], high));
    }
    let mut up = vec![diagonal[n - 1] - high; n];
    for k in (0..n - 1).rev() {
        up[k] = next(k, beside[k], up[k + 1], high);
    }
    let gap = |k: usize| (down[k] + up[k] - (diagonal[k] - high)).abs();
    let twist = (0..n).min_by(|j, k| gap(*j).total_cmp(&gap(*k))).unwrap_or(0);
    let (mut square, mut component) = (1.0, 1.0);
    for k in (0..twist).rev() {
        component *= -beside[k] / down[k];
        square += component * component;
    }
    component = 1.0;
    for k in twist + 1..n {
        component *= -beside[k - 1] / up[k];
        square += component * component;
    }
    (high, norm * component.abs() / square.sqrt())
}

/// Entries that one task works on; fixed, so that sums do not depend on threads.
const PIECE: usize = 8192;

/// Gives every entry a value.
fn put(to: &mut [f64], value: impl Fn(usize) -> f64 + Sync) {
    to.par_chunks_mut(PIECE).enumerate().for_each(|(piece, to)| {
        let first = piece * PIECE;
        to.iter_mut().enumerate().for_each(|(k, x)| *x = value(first + k));
    });
}

/// Gives every entry a value by what it was, and adds up what comes with the values.
fn change(of: &mut [f64], value: impl Fn(usize, f64) -> (f64, f64) + Sync) -> f64 {
    let sums: Vec<f64> = (of.par_chunks_mut(PIECE).enumerate())
        .map(|(piece, of)| {
            let mut sum = 0.0;
            for (k, x) in of.iter_mut().enumerate() {
                let (new, part) = value(piece * PIECE + k, *x);
                *x = new;
                sum += part;
            }
            sum
        })
        .collect();
    sums.iter().fold(0.0, |sum, part| sum + part)
}

/// Reproducible numbers (Knuth's MMIX generator) of the degrees of freedom from the `first` of the body on, zero
/// where the scale is.
fn start(scale: &[f64], first: usize) -> Vec<f64> {
    let mut state = skipped(1, first);
    let mut next = || {
        state = Step::ONE.of(state);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    scale.iter().map(|scale| if *scale == 0.0 { 0.0 * next() } else { next() }).collect()
}

/// A step of the generator, or several at once: `factor*state + term`.
#[derive(Clone, Copy)]
struct Step {
    factor: u64,
    term: u64,
}

impl Step {
    const ONE: Step = Step { factor: 6364136223846793005, term: 1442695040888963407 };

    fn of(self, state: u64) -> u64 {
        self.factor.wrapping_mul(state).wrapping_add(self.term)
    }
}

/// The state so many steps on.
fn skipped(mut state: u64, mut steps: usize) -> u64 {
    let mut step = Step::ONE;
    while steps > 0 {
        if steps % 2 == 1 {
            state = step.of(state);
        }
        step = Step { factor: step.factor.wrapping_mul(step.factor), term: step.of(step.term) };
        steps /= 2;
    }
    state
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, SymmetricEigen};

    use super::*;

    #[test]
    fn numbers_are_those_of_the_whole_body_in_any_part() {
        let whole = start(&[1.0; 100], 0);
        for first in [0, 1, 2, 7, 64, 99] {
            assert_eq!(start(&vec![1.0; 100 - first], first), whole[first..]);
        }
    }

    /// Against a decomposition of the whole matrix, with its vectors: random ones, one whose largest eigenvalue has
    /// converged, and single numbers.
    #[test]
    fn largest_eigenvalues_are_those_of_a_decomposition() {
        let mut state = 7;
        let mut random = || {
            state = Step::ONE.of(state);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let mut all: Vec<(Vec<f64>, Vec<f64>)> = vec![(vec![3.0], vec![]), (vec![-3.0], vec![])];
        for n in [2, 3, 10, 57, 200] {
            let diagonal: Vec<f64> = (0..n).map(|_| 5.0 * random()).collect();
            all.push((diagonal, (1..n).map(|_| random()).collect()));
            // That of a chain of springs.
            all.push((vec![2.0; n], vec![-1.0; n - 1]));
        }
        all.push((vec![1e9, 1.0, 2.0, 3.0], vec![1.0, 1.0, 1.0]));
        for (diagonal, beside) in all {
            let n = diagonal.len();
            let matrix = DMatrix::from_fn(n, n, |r, c| match r.abs_diff(c) {
                0 => diagonal[r],
                1 => beside[r.min(c)],
                _ => 0.0,
            });
            let eigen = SymmetricEigen::new(matrix);
            let (value, place) = (eigen.eigenvalues.max(), eigen.eigenvalues.imax());
            let last = eigen.eigenvectors[(n - 1, place)].abs();
            let size = diagonal.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            let (found, residual) = largest(&diagonal, &beside, 2.0);
            assert!((found - value).abs() <= 1e-13 * size, "{n}: {found} {value}");
            assert!(
                (residual - 2.0 * last).abs() <= 1e-6 * residual + 1e-7,
                "{n}: {residual} {last}"
            );
        }
        assert!(largest(&[1.0, f64::NAN], &[1.0], 1.0).0.is_nan());
    }
}
