//! Energies of gathered states inside an endless lattice, in a homogeneous displacement.
//!
//! A point has `w = psi(I) + 1/2 sum_b V phi(l_b, I)` with
//! `I_k = sum_b V g_k(l_b)`: all of it a function of one family, as in [`piola_mechanics::states`]. Integrals
//! change with the volume alone to first order, so that mixed derivatives are volumetric.

use piola_mechanics::geometry::double::Double;
use piola_mechanics::kernel::{Law, Measure, Variables, VariablesLaw};
use piola_mechanics::lattice::Shell;
use piola_mechanics::states::StateLaws;

use super::cubic::Cubic;
use super::inside::AtRest;

/// The family of a point by the lengths of its bonds.
struct Family<'a> {
    dimension: f64,
    /// In m.
    spacing: f64,
    shells: &'a [Shell],
    /// Volumes of the neighbours of each length together, in m^d.
    volumes: Vec<f64>,
    /// In m.
    lengths: Vec<f64>,
    /// Of the energy: sums over the bonds of each length of `l` times its first and `l^2` times its
    /// second derivative.
    first: Vec<f64>,
    second: Vec<f64>,
}

/// The energy per volume of a point with these bonds.
pub(super) fn of_states(
    laws: &StateLaws,
    dimension: usize,
    spacing: f64,
    shells: &[Shell],
) -> Cubic {
    let cell = (1..dimension).fold(spacing, |volume, _| volume * spacing);
    let zeros = vec![0.0; shells.len()];
    let mut family = Family {
        dimension: dimension as f64,
        spacing,
        shells,
        volumes: shells.iter().map(|shell| 2.0 * shell.count as f64 * cell).collect(),
        lengths: shells.iter().map(|shell| shell.measure * spacing).collect(),
        first: zeros.clone(),
        second: zeros,
    };
    let integrands: Vec<AtRest> = laws.integrals.iter().map(|law| family.at_rest(&**law)).collect();
    let integrals: Vec<f64> =
        integrands.iter().map(|g| family.sum(g.psi.iter().copied())).collect();
    // dI_k = swelling_k tr(G).
    let swelling: Vec<f64> = integrands
        .iter()
        .map(|g| family.sum(g.slopes().map(|[first, _]| first)) / family.dimension)
        .collect();
    let mut adjoint = vec![0.0; integrals.len()];
    let mut volumetric = Double::new(0.0);
    if let Some(law) = &laws.points {
        let at = Variables { n: 1, current: &integrals, change: &[], given: &[], laws: &[] };
        law.evaluate(at, &mut [0.0], &mut adjoint);
        let mut product = vec![0.0; integrals.len()];
        law.product(at, &swelling, &mut product);
        volumetric = dot(&swelling, &product);
    }
    if let Some(law) = &laws.bonds {
        volumetric = volumetric + family.add_bonds(&**law, &integrals, &swelling, &mut adjoint);
    }
    for (integrand, adjoint) in integrands.iter().zip(&adjoint) {
        family.add_law(integrand, *adjoint);
    }
    let mut sum = Cubic::new(dimension);
    sum.add_volumetric(0.0, volumetric.rounded());
    for ((shell, first), second) in shells.iter().zip(&family.first).zip(&family.second) {
        sum.add(Measure::Length, shell.fourth, *first, *second);
    }
    sum
}

impl Family<'_> {
    fn at_rest(&self, law: &dyn Law) -> AtRest {
        AtRest::new(law, Measure::Length, self.shells, self.spacing)
    }

    /// `sum_b V x_b`.
    fn sum(&self, values: impl Iterator<Item = f64>) -> f64 {
        let products = self.volumes.iter().zip(values).map(|(volume, x)| volume * x);
        products.fold(Double::new(0.0), |sum, x| sum + Double::new(x)).rounded()
    }

    /// Adds `factor*sum_b V g(l_b)` to the energy.
    fn add_law(&mut self, law: &AtRest, factor: f64) {
        for (place, [first, second]) in law.slopes().enumerate() {
            self.first[place] += factor * self.volumes[place] * first;
            self.second[place] += factor * self.volumes[place] * second;
        }
    }

    /// Adds `1/2 sum_b V phi(l_b, I)` to the energy, its derivatives by the integrals to `adjoint`.
    /// Gives back its second derivative by the volume, but for those by lengths alone.
    fn add_bonds(
        &mut self,
        law: &dyn VariablesLaw,
        integrals: &[f64],
        swelling: &[f64],
        adjoint: &mut [f64],
    ) -> Double {
        let n = self.lengths.len();
        let repeated = |values: &[f64]| -> Vec<f64> {
            values.iter().flat_map(|x| std::iter::repeat_n(*x, n)).collect()
        };
        let current = [&self.lengths[..], &repeated(integrals)].concat();
        let change = vec![0.0; n];
        let at =
            Variables { n, current: &current, change: &change, given: &self.lengths, laws: &[] };
        let mut slopes = vec![0.0; current.len()];
        law.evaluate(at, &mut vec![0.0; n], &mut slopes);
        for (k, a) in adjoint.iter_mut().enumerate() {
            *a += 0.5 * self.sum(slopes[(k + 1) * n..][..n].iter().copied());
        }
        let product = |length: f64, integrals: &[f64]| {
            let direction = [repeated(&[length]), repeated(integrals)].concat();
            let mut product = vec![0.0; direction.len()];
            law.product(at, &direction, &mut product);
            product
        };
        let by_length = product(1.0, &vec![0.0; swelling.len()]);
        let by_integrals = product(0.0, swelling);
        let mut volumetric = Double::new(0.0);
        for place in 0..n {
            let (weight, length) = (0.5 * self.volumes[place], self.lengths[place]);
            self.first[place] += weight * (length * slopes[place]);
            self.second[place] += weight * (length * (length * by_length[place]));
            // Lengths change by l tr(G)/d, in the mean over all directions.
            let mixed = 2.0 * length / self.dimension * by_integrals[place];
            let squares = swelling.iter().zip(by_integrals[n + place..].iter().step_by(n));
            let both = squares.fold(mixed, |sum, (s, product)| sum + s * product);
            volumetric = volumetric + Double::new(weight * both);
        }
        volumetric
    }
}

fn dot(x: &[f64], y: &[f64]) -> Double {
    let products = x.iter().zip(y).map(|(x, y)| Double::new(*x) * Double::new(*y));
    products.fold(Double::new(0.0), |sum, product| sum + product)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use piola_compiler::{Form, Level, Mode, check_text};

    use super::*;
    use piola_mechanics::body::Body;
    use piola_mechanics::energy::Energy as _;
    use piola_mechanics::lattice::shells;
    use piola_mechanics::states::StateEnergy;

    /// Every energy pulls at rest, that of bonds also by what its ends gather.
    const TENSE: &str = "potential tense
m = integral(L^2)
s = integral((l - L)*L)/m
psi(s) = s^2 + 0.3*s
psi(l, s) = (0.4 + s)^2*l^2 + 0.2*l
";

    fn laws(d: usize) -> StateLaws {
        let (_, model) = check_text(TENSE).unwrap();
        let values = model.values(d, &[], Some(1.5)).unwrap();
        let mode = Mode::Jit(Level::Strict);
        let gathered = model.compile(&values, mode, Form::Accurate).unwrap().gathered.unwrap();
        let integrals = gathered.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>);
        StateLaws {
            of_law: Vec::new(),
            integrals: integrals.collect(),
            points: gathered.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
            bonds: gathered.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
            arguments: Default::default(),
        }
    }

    fn energy(d: usize) -> StateEnergy {
        let positions: Vec<f64> = (0..5usize.pow(d as u32) * d)
            .map(|k| (k / d / 5usize.pow((k % d) as u32) % 5) as f64)
            .collect();
        let n = positions.len() / d;
        let body = Arc::new(Body::new(d, &positions, &vec![1.0; n], Some(1.0)));
        StateEnergy::new(body, 1.5, laws(d)).unwrap()
    }

    /// First and second derivatives against central differences of the energy density of the point,
    /// steps h: off by h^2, and by 1e-16/h or 1e-16/h^2 of the energy.
    #[test]
    fn derivatives_are_those_of_the_energy_density() {
        for d in [2, 3] {
            let energy = energy(d);
            let middle = |p: &usize| energy.body().position(*p).iter().all(|x| *x == 2.0);
            let centre = (0..energy.body().n_points()).find(middle).unwrap();
            let density = |g: &[f64]| {
                let rows = energy.body().positions().chunks_exact(d);
                let along = |x: &[f64], r: usize| (0..d).map(|c| g[r * d + c] * x[c]).sum::<f64>();
                let u: Vec<f64> =
                    rows.flat_map(|x| (0..d).map(|r| along(x, r)).collect::<Vec<f64>>()).collect();
                energy.densities(&u, energy.body().volumes()).unwrap()[centre]
            };
            let moved = |steps: &[(usize, f64)]| {
                let mut g = vec![0.0; d * d];
                steps.iter().for_each(|&(k, h)| g[k] += h);
                density(&g)
            };
            let found = of_states(&laws(d), d, 1.0, &shells(d, 1.5, Measure::Length)).affine();
            let most = found.stress.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let stiffest = found.tangent(0, 0).abs();
            for i in 0..d * d {
                let h = 1e-5;
                let expected = (moved(&[(i, h)]) - moved(&[(i, -h)])) / (2.0 * h);
                let error = (found.stress[i] - expected).abs();
                assert!(error < 1e-8 * most, "{d}: {i} {} {expected}", found.stress[i]);
                for j in 0..d * d {
                    let h = 1e-4;
                    let at = |a: f64, b: f64| moved(&[(i, a * h), (j, b * h)]);
                    let mixed = at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0);
                    let expected = mixed / (4.0 * h * h);
                    let error = (found.tangent(i, j) - expected).abs();
                    assert!(error < 1e-6 * stiffest, "{d}: {i} {j} {error:e} {stiffest:e}");
                }
            }
        }
    }
}
