//! The energy of one point whose family is displaced by `u = G X`, to second order at rest.

use nalgebra::DMatrix;

use super::family::{Along, Family};
use super::{StateEnergy, at_points};
use crate::kernel::Order;

/// Derivatives of the energy per volume of one point by the components of `G`, row by row, in J/m^d.
pub(crate) struct Homogeneous {
    pub(crate) first: Vec<f64>,
    pub(crate) second: DMatrix<f64>,
}

/// What an energy of one point knows of its family at rest.
struct Rest {
    integrals: Vec<f64>,
    /// Derivatives of the energy per volume by the integrals.
    adjoint: Vec<f64>,
    /// Its derivatives by the lengths of the bonds, over their volumes.
    tension: Vec<f64>,
}

impl StateEnergy {
    /// For a point whose whole family is in the body.
    pub(crate) fn homogeneous(&self, point: usize) -> Homogeneous {
        match self.body.dimension() {
            2 => self.homogeneous_in::<2>(point),
            _ => self.homogeneous_in::<3>(point),
        }
    }

    fn homogeneous_in<const D: usize>(&self, point: usize) -> Homogeneous {
        let rest = vec![0.0; self.body.positions().len()];
        let mut family = Family::<D>::default();
        family.take(&self.body, &self.neighborhood, &rest, point);
        let state = self.unstrained(&mut family);
        let fields: Vec<Vec<f64>> = (0..D * D).map(|number| self.field::<D>(number)).collect();
        let mut first = vec![0.0; D * D];
        let mut changes = vec![Vec::new(); D * D];
        for (number, field) in fields.iter().enumerate() {
            family.take_direction(&self.neighborhood, field, point);
            first[number] = family.integral(&products(&state.tension, &family.along));
            changes[number] = self.tension_changes(&mut family, &state);
        }
        let mut second = DMatrix::zeros(D * D, D * D);
        for (row, field) in fields.iter().enumerate() {
            family.take_direction(&self.neighborhood, field, point);
            let (along, differences) = (family.along.clone(), family.differences.clone());
            for (column, field) in fields.iter().enumerate() {
                family.take_direction(&self.neighborhood, field, point);
                // A bond turns, too: its tension then pulls elsewhere.
                let turned = (0..family.len()).map(|b| {
                    let inner = (0..D)
                        .fold(0.0, |sum, c| sum + differences[b][c] * family.differences[b][c]);
                    let across = (inner - along[b] * family.along[b]) / family.length[b];
                    changes[column][b] * along[b] + state.tension[b] * across
                });
                let turned: Vec<f64> = turned.collect();
                second[(row, column)] = family.integral(&turned);
            }
        }
        Homogeneous { first, second }
    }

    /// `u = G X` with one component of `G`.
    fn field<const D: usize>(&self, number: usize) -> Vec<f64> {
        let (component, axis) = (number / D, number % D);
        let place = |x: &[f64; D]| {
            std::array::from_fn::<f64, D, _>(|c| if c == component { x[axis] } else { 0.0 })
        };
        self.body.positions().as_chunks::<D>().0.iter().flat_map(place).collect()
    }

    fn unstrained<const D: usize>(&self, family: &mut Family<D>) -> Rest {
        let mut integrals = Vec::new();
        for law in &self.laws.integrals {
            family.law(&**law, Order::Energy);
            integrals.push(family.integral(&family.psi));
        }
        let mut adjoint = vec![0.0; integrals.len()];
        if let Some(law) = &self.laws.points {
            law.evaluate(at_points(1, &integrals), &mut [0.0], &mut adjoint);
        }
        let mut tension = vec![0.0; family.len()];
        if let Some(law) = &self.laws.bonds {
            family.bonds(&**law, &integrals, true);
            super::add_halves(&mut tension, family.slope(0));
            for (v, a) in adjoint.iter_mut().enumerate() {
                *a += 0.5 * family.integral(family.slope(v + 1));
            }
        }
        if let Some(law) = &self.laws.plain {
            family.law(&**law, Order::Gradient);
            super::add_halves(&mut tension, &family.first);
        }
        for (law, a) in self.laws.integrals.iter().zip(&adjoint) {
            family.law(&**law, Order::Gradient);
            tension.iter_mut().zip(&family.first).for_each(|(t, slope)| *t += a * slope);
        }
        Rest { integrals, adjoint, tension }
    }

    /// What the tensions change by along the direction that the family has taken.
    fn tension_changes<const D: usize>(&self, family: &mut Family<D>, rest: &Rest) -> Vec<f64> {
        let moved: Vec<f64> = self
            .laws
            .integrals
            .iter()
            .map(|law| {
                family.law(&**law, Order::Gradient);
                family.integral(&products(&family.first, &family.along))
            })
            .collect();
        let mut adjoint = vec![0.0; moved.len()];
        if let Some(law) = &self.laws.points {
            law.product(at_points(1, &rest.integrals), &moved, &mut adjoint);
        }
        let mut tension = vec![0.0; family.len()];
        if let Some(law) = &self.laws.bonds {
            family.multiply(&**law, &rest.integrals, Along::Direction, &moved);
            super::add_halves(&mut tension, family.slope(0));
            for (v, a) in adjoint.iter_mut().enumerate() {
                *a += 0.5 * family.integral(family.slope(v + 1));
            }
        }
        if let Some(law) = &self.laws.plain {
            family.law(&**law, Order::Tangent);
            super::add_halves(&mut tension, &products(&family.second, &family.along));
        }
        for (k, law) in self.laws.integrals.iter().enumerate() {
            family.law(&**law, Order::Tangent);
            for (b, t) in tension.iter_mut().enumerate() {
                let bent = rest.adjoint[k] * family.second[b] * family.along[b];
                *t += adjoint[k] * family.first[b] + bent;
            }
        }
        tension
    }
}

fn products(x: &[f64], y: &[f64]) -> Vec<f64> {
    x.iter().zip(y).map(|(x, y)| x * y).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use piola_compiler::{Form, Level, Mode, check_text};

    use super::*;
    use crate::body::Body;
    use crate::kernel::{Law, VariablesLaw};
    use crate::states::StateLaws;

    /// Every energy pulls at rest, that of bonds also by what its ends gather.
    const TENSE: &str = "potential tense
m = integral(L^2)
s = integral((l - L)*L)/m
psi(s) = s^2 + 0.3*s
psi(l, s) = (0.4 + s)^2*l^2
psi(l) = 0.2*l
";

    fn energy(d: usize) -> StateEnergy {
        let positions: Vec<f64> = (0..5usize.pow(d as u32) * d)
            .map(|k| (k / d / 5usize.pow((k % d) as u32) % 5) as f64)
            .collect();
        let n = positions.len() / d;
        let body = Arc::new(Body::new(d, &positions, &vec![1.0; n], Some(1.0)));
        let (_, model) = check_text(TENSE).unwrap();
        let values = model.values(d, &[], Some(1.5)).unwrap();
        let mode = Mode::Jit(Level::Strict);
        let gathered = model.compile_gathered(&values, mode, Form::Accurate).unwrap().0.unwrap();
        let plain = model.compile(&values, mode).unwrap().kernels.pop().unwrap();
        let laws = StateLaws {
            integrals: gathered
                .integrals
                .into_iter()
                .map(|g| Box::new(g) as Box<dyn Law>)
                .collect(),
            points: gathered.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
            bonds: gathered.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
            plain: Some(Box::new(plain)),
        };
        StateEnergy::new(body, 1.5, laws).unwrap()
    }

    /// First and second derivatives against central differences of the energy density of the point,
    /// steps h: off by h^2, and by 1e-16/h or 1e-16/h^2 of the energy.
    #[test]
    fn derivatives_are_those_of_the_energy_density() {
        for d in [2, 3] {
            let energy = energy(d);
            let middle = |p: &usize| energy.body.position(*p).iter().all(|x| *x == 2.0);
            let centre = (0..energy.body.n_points()).find(middle).unwrap();
            let density = |g: &[f64]| {
                let rows = energy.body.positions().chunks_exact(d);
                let along = |x: &[f64], r: usize| (0..d).map(|c| g[r * d + c] * x[c]).sum::<f64>();
                let u: Vec<f64> =
                    rows.flat_map(|x| (0..d).map(|r| along(x, r)).collect::<Vec<f64>>()).collect();
                energy.energy_densities(&u).unwrap()[centre]
            };
            let moved = |steps: &[(usize, f64)]| {
                let mut g = vec![0.0; d * d];
                steps.iter().for_each(|&(k, h)| g[k] += h);
                density(&g)
            };
            let found = energy.homogeneous(centre);
            let most = found.first.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let stiffest = found.second.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            for i in 0..d * d {
                let h = 1e-5;
                let expected = (moved(&[(i, h)]) - moved(&[(i, -h)])) / (2.0 * h);
                let error = (found.first[i] - expected).abs();
                assert!(error < 1e-8 * most, "{d}: {i} {} {expected}", found.first[i]);
                for j in 0..d * d {
                    let h = 1e-4;
                    let at = |a: f64, b: f64| moved(&[(i, a * h), (j, b * h)]);
                    let mixed = at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0);
                    let expected = mixed / (4.0 * h * h);
                    let error = (found.second[(i, j)] - expected).abs();
                    assert!(error < 1e-6 * stiffest, "{d}: {i} {j} {error:e} {stiffest:e}");
                }
            }
        }
    }
}
