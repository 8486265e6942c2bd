//! Energies of what points gather of vectors inside an endless lattice, in a homogeneous displacement.
//!
//! All points gather the same then: a point has `w = psi(s) + 1/2 sum_b V phi(G X_b, s, s)` with `s` from
//! `I = sum_b V g(G X_b)`, a function of the displacement gradient `G` alone, whose derivatives go the way of
//! [`piola_mechanics::vectors`] for one family.

use std::convert::Infallible;

use piola_compiler::{FamilyBatch, FamilyKernel, Slot, VectorKernels};
use piola_mechanics::interaction::never_fails;

use super::Affine;
use super::fracture::half_space;

/// The energy per volume of points of `u = G X` to second order. `ratio` is the horizon over the spacing,
/// which is in m.
pub(super) fn of_vectors(kernels: &VectorKernels, d: usize, ratio: f64, spacing: f64) -> Affine {
    let half = half_space(d, ratio).into_iter();
    let vectors = half.flat_map(|x| [x.clone(), x.iter().map(|x| -x).collect()]);
    let offsets: Vec<Vec<f64>> =
        vectors.map(|x| x.iter().map(|x| spacing * f64::from(*x)).collect()).collect();
    let volume = (1..d).fold(spacing, |volume, _| volume * spacing);
    let family = Family { kernels, d, offsets, volume };
    let rest = vec![0.0; d * d];
    let base = family.pass(&rest, None);
    let stress = base.stress.clone();
    let product = |direction: &nalgebra::DVector<f64>| {
        let change = family.pass(direction.as_slice(), Some(&base));
        Ok::<_, Infallible>(nalgebra::DVector::from_vec(change.stress))
    };
    never_fails(Affine::of_products(d, stress, product))
}

/// The family of a point.
struct Family<'a> {
    kernels: &'a VectorKernels,
    d: usize,
    /// From the point to its neighbours at rest, in m.
    offsets: Vec<Vec<f64>>,
    /// Of each neighbour, in m^d.
    volume: f64,
}

/// What a point gathers, derivatives of the energy by that and by `G`; or what these change by.
#[derive(Clone)]
struct State {
    values: Vec<f64>,
    adjoint: Vec<f64>,
    stress: Vec<f64>,
}

impl Family<'_> {
    /// At a displacement gradient from rest; in the direction of one from `base`, which is at rest.
    fn pass(&self, gradient: &[f64], base: Option<&State>) -> State {
        let (n, kernels) = (self.kernels.n_gathered, self.kernels);
        let zeros = || vec![0.0; n];
        let mut state =
            State { values: zeros(), adjoint: zeros(), stress: vec![0.0; self.d * self.d] };
        let slopes = self.through(&kernels.integrands, (gradient, &state), base);
        self.each(&kernels.integrands, &slopes, |slot, _, slope| {
            if let Slot::Multiplier(k) = slot {
                state.values[k] += self.volume * slope;
            }
        });
        if let Some(kernel) = &kernels.functions {
            let slopes = self.through(kernel, (gradient, &state), base);
            self.each(kernel, &slopes, |slot, _, slope| {
                if let Slot::Multiplier(k) = slot {
                    state.values[k] = slope;
                }
            });
        }
        for (kernel, weight) in [(&kernels.points, 1.0), (&kernels.bonds, 0.5 * self.volume)] {
            let Some(kernel) = kernel else { continue };
            let slopes = self.through(kernel, (gradient, &state), base);
            self.each(kernel, &slopes, |slot, place, slope| match slot {
                // The same at both ends.
                Slot::Own(k) | Slot::Neighbour(k) => state.adjoint[k] += weight * slope,
                Slot::Moved(row) => self.pull(&mut state.stress, (row, place), weight * slope),
                _ => {}
            });
        }
        if let Some(kernel) = &kernels.functions {
            let slopes = self.through(kernel, (gradient, &state), base);
            self.each(kernel, &slopes, |slot, _, slope| {
                if let Slot::Own(k) = slot {
                    state.adjoint[k] += slope;
                }
            });
        }
        let slopes = self.through(&kernels.integrands, (gradient, &state), base);
        self.each(&kernels.integrands, &slopes, |slot, place, slope| {
            if let Slot::Moved(row) = slot {
                self.pull(&mut state.stress, (row, place), self.volume * slope);
            }
        });
        state
    }

    /// Adds what a component of a bond's vector pulls with.
    fn pull(&self, stress: &mut [f64], (row, place): (usize, usize), slope: f64) {
        for (column, x) in self.offsets[place].iter().enumerate() {
            stress[row * self.d + column] += slope * x;
        }
    }

    /// The derivatives of a kernel, variable by variable: at all bonds, or at the point.
    fn each(&self, kernel: &FamilyKernel, slopes: &[f64], mut take: impl FnMut(Slot, usize, f64)) {
        let n = self.places(kernel);
        for (slot, slopes) in kernel.variables().iter().zip(slopes.chunks(n)) {
            slopes.iter().enumerate().for_each(|(place, slope)| take(*slot, place, *slope));
        }
    }

    fn places(&self, kernel: &FamilyKernel) -> usize {
        if kernel.given().contains(&Slot::Length) { self.offsets.len() } else { 1 }
    }

    fn through(
        &self,
        kernel: &FamilyKernel,
        (gradient, now): (&[f64], &State),
        base: Option<&State>,
    ) -> Vec<f64> {
        let (n, d) = (self.places(kernel), self.d);
        let rest = vec![0.0; d * d];
        let at = |slots: &[Slot], gradient: &[f64], state: &State| -> Vec<f64> {
            let value = |slot: Slot, place: usize| match slot {
                Slot::Length => norm(&self.offsets[place]),
                Slot::Moved(row) => {
                    let row = &gradient[row * d..(row + 1) * d];
                    row.iter().zip(&self.offsets[place]).fold(0.0, |sum, (g, x)| sum + g * x)
                }
                Slot::Own(k) | Slot::Neighbour(k) => state.values[k],
                Slot::Multiplier(k) => state.adjoint[k],
            };
            slots.iter().flat_map(|slot| (0..n).map(|place| value(*slot, place))).collect()
        };
        let (whole, state) = match base {
            Some(base) => (&rest[..], base),
            None => (gradient, now),
        };
        let variables = at(kernel.variables(), whole, state);
        let given = at(kernel.given(), whole, state);
        // Directions are the only fields that are left; a point has none.
        let axes = 0..kernel.fields().len();
        let unit = |axis: usize, place: usize| {
            self.offsets[place].get(axis).map_or(0.0, |x| x / norm(&self.offsets[place]))
        };
        let fields: Vec<f64> =
            axes.flat_map(|axis| (0..n).map(move |place| unit(axis, place))).collect();
        let batch = FamilyBatch { n, variables: &variables, given: &given, fields: &fields };
        let mut slopes = vec![0.0; variables.len()];
        match base {
            Some(_) => {
                kernel.product(batch, &at(kernel.variables(), gradient, now), &mut slopes);
            }
            None => kernel.evaluate(batch, &mut vec![0.0; n], &mut slopes),
        }
        slopes
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |sum, x| sum + x * x).sqrt()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use piola_compiler::{Form, Level, Mode, Setting, check_text};
    use piola_mechanics::body::Body;
    use piola_mechanics::energy::Energy as _;
    use piola_mechanics::neighborhood::Neighborhood;
    use piola_mechanics::vectors::{VectorEnergy, VectorLaws};

    use super::*;

    const HORIZON: f64 = 1.5;

    /// Points and bonds pull at rest, by what both ends gather; functions of integrals bend.
    const TENSE: &str = "potential tense
n = if d == 3 then vector(0.48, 0.6, 0.64) else vector(0.6, 0.8)
K = integral(dyad(Xi, Xi))
H = integral(dyad(xi - Xi, Xi))*inv(K)
m = integral(L^2)
q = integral((n*xi)^2*xi*(1 + n*Xi))/m
S = dyad(q)*(1 + tr(H)^2)
psi(H, S) = 0.3*tr(H) + H : H + tr(S) + 0.2*(H : S)
psi(xi, H, q) = (xi - Xi - H*Xi)*(xi - Xi - neighbour(H)*Xi) + 0.1*l^2*(1 + q*neighbour(q)) + 0.2*tr(H)*(n*xi)^2
";

    fn kernels(d: usize) -> VectorKernels {
        let (_, model) = check_text(TENSE).unwrap();
        let none: [(String, Setting); 0] = [];
        let values = model.values(d, &none, Some(HORIZON)).unwrap();
        let mode = Mode::Jit(Level::Strict);
        model.compile(&values, mode, Form::Accurate).unwrap().vectors.unwrap()
    }

    /// First and second derivatives against central differences of the energy density of a point whose neighbours
    /// have whole families, steps h: off by h^2, and by 1e-16/h or 1e-16/h^2 of the energy.
    #[test]
    fn derivatives_are_those_of_the_energy_density() {
        for d in [2usize, 3] {
            let side = 7usize;
            let n = side.pow(d as u32);
            let place = |p: usize, c: usize| (p / side.pow(c as u32) % side) as f64;
            let positions: Vec<f64> =
                (0..n).flat_map(|p| (0..d).map(move |c| place(p, c))).collect();
            let body = Arc::new(Body::new(d, &positions, &vec![1.0; n], Some(1.0)));
            let neighborhood = Arc::new(Neighborhood::new(&body, HORIZON).unwrap());
            let arguments = Default::default();
            let laws = VectorLaws { of_law: vec![Some(kernels(d))], thickness: 1.0, arguments };
            let energy = VectorEnergy::new(Arc::clone(&body), neighborhood, None, laws).unwrap();
            let middle = |p: &usize| body.position(*p).iter().all(|x| *x == 3.0);
            let centre = (0..n).find(middle).unwrap();
            let density = |steps: &[(usize, f64)]| {
                let mut g = vec![0.0; d * d];
                steps.iter().for_each(|&(k, h)| g[k] += h);
                let row = |x: &[f64], r: usize| (0..d).map(|c| g[r * d + c] * x[c]).sum::<f64>();
                let rows = body.positions().chunks_exact(d);
                let u: Vec<f64> =
                    rows.flat_map(|x| (0..d).map(|r| row(x, r)).collect::<Vec<f64>>()).collect();
                energy.densities(&u, body.volumes()).unwrap()[centre]
            };
            let found = of_vectors(&kernels(d), d, HORIZON, 1.0);
            let most = found.stress.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let stiffest = found.tangent(0, 0).abs();
            for i in 0..d * d {
                let h = 1e-5;
                let expected = (density(&[(i, h)]) - density(&[(i, -h)])) / (2.0 * h);
                let error = (found.stress[i] - expected).abs();
                assert!(error < 1e-7 * most, "{d}: {i} {} {expected}", found.stress[i]);
                for j in 0..d * d {
                    let h = 1e-4;
                    let at = |a: f64, b: f64| density(&[(i, a * h), (j, b * h)]);
                    let mixed = at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0);
                    let expected = mixed / (4.0 * h * h);
                    let error = (found.tangent(i, j) - expected).abs();
                    assert!(error < 1e-5 * stiffest, "{d}: {i} {j} {error:e} {stiffest:e}");
                }
            }
        }
    }
}
