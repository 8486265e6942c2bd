//! The exact Hessian row by row: for small bodies, and as the witness of the products; and springs
//! like it.
//!
//! Of one family it is, with `G_k = dI_k/du` and `B_k = d(dw/dI_k)/du` at fixed integrals,
//! `V_i sum_k (R_k G_k^T + G_k B_k^T)` with `R_k = sum_m S_km G_m + B_k` and `S = d2w/dI2`, beside
//! what each bond has by itself.

use std::sync::Arc;

use rayon::prelude::*;

use super::family::Family;
use super::passes::States;
use super::{StateEnergy, at_points};
use crate::correspondence::bonds;
use crate::correspondence::operator::reverse;
use crate::energy::NonFinite;
use crate::kernel::Order;
use crate::matrix::BlockMatrix;

/// The least part of the stiffest spring that a bond has.
const SOFTEST: f64 = 1e-2;

/// Second derivatives by bonds and by families.
pub(super) struct Stiffness<'a, const D: usize> {
    energy: &'a StateEnergy,
    /// For each directed bond `(i, j)` the place of `(j, i)`.
    reverse: Vec<u32>,
    /// `G_k`, `B_k`, `R_k` for each directed bond and integral.
    bonds: Vec<[[f64; D]; 3]>,
    /// The same at the points themselves.
    own: Vec<[[f64; D]; 3]>,
    /// Blocks of the bonds by themselves, for each directed bond.
    direct: Vec<[[f64; D]; D]>,
    /// Stiffnesses by length alone, for each directed bond, in N/m; and those of springs that keep the
    /// energy of families under uniform expansion.
    along: Vec<f64>,
    spread: Vec<f64>,
}

/// What one point gives.
struct Row<const D: usize> {
    bonds: Vec<[[f64; D]; 3]>,
    own: Vec<[[f64; D]; 3]>,
    direct: Vec<[[f64; D]; D]>,
    along: Vec<f64>,
    spread: Vec<f64>,
}

impl<'a, const D: usize> Stiffness<'a, D> {
    pub(super) fn new(energy: &'a StateEnergy, u: &[f64]) -> Result<Self, NonFinite> {
        let states = energy.states::<D>(u, Order::Gradient)?;
        let reverse = reverse(&energy.neighborhood);
        let tension = energy.directed(&states.tension, &reverse);
        // Second derivatives of the energy of each bond by its length.
        let second: Vec<Vec<f64>> = (0..energy.body.n_points())
            .into_par_iter()
            .map_init(Family::<D>::default, |family, i| energy.by_length(family, u, &states, i))
            .collect();
        let second = second.concat();
        let along: Vec<f64> =
            reverse.iter().zip(&second).map(|(&back, x)| x + second[back as usize]).collect();
        let rows: Vec<Row<D>> = (0..energy.body.n_points())
            .into_par_iter()
            .map_init(Family::default, |family, i| {
                energy.row(family, u, (&states, &tension, &along), i)
            })
            .collect();
        let mut all = Stiffness {
            energy,
            reverse,
            bonds: Vec::new(),
            own: Vec::new(),
            direct: Vec::new(),
            along: Vec::new(),
            spread: Vec::new(),
        };
        for row in rows {
            all.bonds.extend(row.bonds);
            all.own.extend(row.own);
            all.direct.extend(row.direct);
            all.along.extend(row.along);
            all.spread.extend(row.spread);
        }
        Ok(all)
    }

    /// The whole tangent on its pattern.
    pub(super) fn tangent(&self, tangent: &mut BlockMatrix) {
        let pattern = Arc::clone(&tangent.pattern);
        let n = pattern.n_rows();
        let mut rows = Vec::with_capacity(n);
        let mut rest = &mut tangent.values[..];
        for point in 0..n {
            let columns = &pattern.columns[pattern.row_start[point]..pattern.row_start[point + 1]];
            let (row, tail) = std::mem::take(&mut rest).split_at_mut(columns.len() * D * D);
            rows.push((point, columns, row));
            rest = tail;
        }
        rows.into_par_iter().for_each(|(point, columns, row)| self.row(point, columns, row));
    }

    /// Its diagonal blocks.
    pub(super) fn diagonal(&self, blocks: &mut [f64]) {
        let blocks = blocks.par_chunks_exact_mut(D * D).enumerate();
        blocks.for_each(|(point, block)| self.row(point, &[point as u32], block));
    }

    /// The blocks of a row at some columns, ascending.
    fn row(&self, point: usize, columns: &[u32], out: &mut [f64]) {
        out.fill(0.0);
        let (neighborhood, reverse) = (&self.energy.neighborhood, &self.reverse);
        let m = self.energy.n_integrals();
        let mut add = |column: usize, block: &[[f64; D]; D], factor: f64| {
            let Ok(place) = columns.binary_search(&(column as u32)) else { return };
            let out = &mut out[place * D * D..(place + 1) * D * D];
            for (out, x) in out.iter_mut().zip(block.as_flattened()) {
                *out += factor * x;
            }
        };
        for place in neighborhood.places(point) {
            let j = neighborhood.row(point)[place - neighborhood.places(point).start];
            add(point, &self.direct[place], 1.0);
            add(j as usize, &self.direct[place], -1.0);
        }
        if m == 0 {
            return;
        }
        let own = |i: usize| &self.own[i * m..(i + 1) * m];
        let at = |place: usize| &self.bonds[place * m..(place + 1) * m];
        let places = neighborhood.places(point);
        let others = neighborhood.row(point).iter().zip(&reverse[places]);
        let others = others.map(|(&i, &place)| (i as usize, at(place as usize)));
        for (i, here) in [(point, own(point))].into_iter().chain(others) {
            let volume = self.energy.body.volumes()[i];
            let block = |there: &[[[f64; D]; 3]]| -> [[f64; D]; D] {
                std::array::from_fn(|r| {
                    std::array::from_fn(|c| {
                        here.iter().zip(there).fold(0.0, |sum, ([g, _, row], [h, b, _])| {
                            sum + row[r] * h[c] + g[r] * b[c]
                        })
                    })
                })
            };
            if i >= point {
                add(i, &block(own(i)), volume);
            }
            let row = neighborhood.row(i);
            let later = row.partition_point(|&b| (b as usize) < point);
            let start = neighborhood.places(i).start;
            for (k, &b) in row.iter().enumerate().skip(later) {
                if columns.len() > 1 || b as usize == point {
                    add(b as usize, &block(at(start + k)), volume);
                }
            }
        }
    }
}

impl StateEnergy {
    /// From each bond once to each directed bond.
    fn directed(&self, once: &[f64], reverse: &[u32]) -> Vec<f64> {
        let mut both = vec![0.0; reverse.len()];
        for i in 0..self.body.n_points() {
            let places = self.neighborhood.places(i);
            let later = places.end - self.neighborhood.upper(i).len();
            for (place, x) in (later..places.end).zip(&once[self.bond_start[i]..]) {
                both[place] = *x;
                both[reverse[place] as usize] = *x;
            }
        }
        both
    }

    /// Half the second derivative of the energy of each bond by its length, at the states of `i`.
    fn by_length<const D: usize>(
        &self,
        family: &mut Family<D>,
        u: &[f64],
        states: &States,
        i: usize,
    ) -> Vec<f64> {
        let m = self.n_integrals();
        family.take(&self.body, &self.neighborhood, u, i);
        let mut second = vec![0.0; family.len()];
        if let Some(law) = &self.laws.bonds {
            let integrals = &states.integrals[i * m..(i + 1) * m];
            family.multiply(&**law, integrals, 1.0, &vec![0.0; m]);
            super::add_halves(&mut second, family.slope(0));
        }
        second
    }

    fn row<const D: usize>(
        &self,
        family: &mut Family<D>,
        u: &[f64],
        (states, tension, along): (&States, &[f64], &[f64]),
        i: usize,
    ) -> Row<D> {
        let m = self.n_integrals();
        family.take(&self.body, &self.neighborhood, u, i);
        let places = self.neighborhood.places(i);
        let row = self.neighborhood.row(i);
        let n = row.len();
        let own_volume = self.body.volumes()[i];
        let integrals = &states.integrals[i * m..(i + 1) * m];
        // Tension and stiffness of each bond, from both ends; slopes of the integrands.
        let mut tension = tension[places.clone()].to_vec();
        let mut along = along[places].to_vec();
        let mut slopes: Vec<Vec<f64>> = Vec::with_capacity(m);
        for (k, law) in self.laws.integrals.iter().enumerate() {
            family.law(&**law, Order::Tangent);
            for b in 0..n {
                let a = states.adjoint[i * m + k] + states.adjoint[row[b] as usize * m + k];
                tension[b] += a * family.first[b];
                along[b] += a * family.second[b];
            }
            slopes.push(family.first.clone());
        }
        let direct = |b: usize| -> [[f64; D]; D] {
            let (normal, weight) = (&family.normals[b], own_volume * family.volumes[b]);
            let across = tension[b] / family.length[b];
            std::array::from_fn(|r| {
                std::array::from_fn(|c| {
                    let unit = f64::from(u8::from(r == c));
                    weight * ((along[b] - across) * normal[r] * normal[c] + across * unit)
                })
            })
        };
        let direct: Vec<[[f64; D]; D]> = (0..n).map(direct).collect();
        // S_km, and the derivatives of a bond's energy by length and integral.
        let mut by_states = vec![0.0; m * m];
        let mut mixed: Vec<Vec<f64>> = Vec::with_capacity(m);
        for k in 0..m {
            let mut unit = vec![0.0; m];
            unit[k] = 1.0;
            if let Some(law) = &self.laws.points {
                // Of one point they are in order already.
                law.product(at_points(1, integrals), &unit, &mut by_states[k * m..(k + 1) * m]);
            }
            let mut column = vec![0.0; n];
            if let Some(law) = &self.laws.bonds {
                family.multiply(&**law, integrals, 0.0, &unit);
                column.copy_from_slice(family.slope(0));
                for v in 0..m {
                    by_states[k * m + v] += 0.5 * family.integral(family.slope(v + 1));
                }
            }
            mixed.push(column);
        }
        let mut bonds = vec![[[0.0; D]; 3]; n * m];
        let mut own = vec![[[0.0; D]; 3]; m];
        for b in 0..n {
            let (normal, volume) = (&family.normals[b], family.volumes[b]);
            for k in 0..m {
                let g = volume * slopes[k][b];
                let mix = 0.5 * volume * mixed[k][b];
                let coupled = (0..m).fold(0.0, |sum, v| sum + by_states[k * m + v] * slopes[v][b]);
                let whole = [g, mix, volume * coupled + mix];
                for (kind, factor) in whole.into_iter().enumerate() {
                    for c in 0..D {
                        bonds[b * m + k][kind][c] = factor * normal[c];
                        own[k][kind][c] -= factor * normal[c];
                    }
                }
            }
        }
        // Under uniform expansion `dl = e L` these springs have the energy of the states.
        let expansion: Vec<f64> = slopes
            .iter()
            .map(|slopes| {
                let terms = slopes.iter().zip(&family.rest).zip(&family.volumes);
                terms.fold(0.0, |sum, ((slope, rest), volume)| sum + volume * slope * rest)
            })
            .collect();
        let spread = |b: usize| {
            let mut sum = 0.0;
            for k in 0..m {
                let row = &by_states[k * m..(k + 1) * m];
                let coupled = row.iter().zip(&expansion).fold(0.0, |sum, (s, x)| sum + s * x);
                sum += slopes[k][b] * coupled + mixed[k][b] * expansion[k];
            }
            own_volume * family.volumes[b] * sum / family.rest[b]
        };
        let spread = (0..n).map(spread).collect();
        let weighted = |b: usize| own_volume * family.volumes[b] * along[b];
        let along = (0..n).map(weighted).collect();
        Row { bonds, own, direct, along, spread }
    }

    /// Fills a matrix with springs like the bonds.
    pub(super) fn like_bonds<const D: usize>(&self, u: &[f64], matrix: &mut BlockMatrix) {
        let springs = self.springs.get_or_init(|| self.at_rest::<D>());
        let stiffness = |i: usize, k: usize, _: usize, _: &[f64; D]| {
            springs[self.neighborhood.places(i).start + k]
        };
        bonds::springs(&self.body, &self.neighborhood, u, stiffness, matrix);
    }

    /// Stiffnesses of springs like the bonds at rest; where the energy has none there, of all the same.
    fn at_rest<const D: usize>(&self) -> Vec<f64> {
        let u = vec![0.0; self.body.positions().len()];
        let whole = Stiffness::<D>::new(self, &u).ok().map(|stiffness| {
            let both = |(place, &back): (usize, &u32)| {
                let shared = stiffness.spread[place] + stiffness.spread[back as usize];
                let along = stiffness.along[place];
                // Less than nothing is no spring: what a bond has by itself sets the least.
                (along + shared).max(0.1 * along)
            };
            stiffness.reverse.iter().enumerate().map(both).collect::<Vec<f64>>()
        });
        let springs = whole.unwrap_or_default();
        let stiffest = springs.iter().fold(0.0, |most: f64, k| most.max(*k));
        if stiffest > 0.0 && springs.iter().all(|k| k.is_finite()) {
            springs.iter().map(|k| k.max(SOFTEST * stiffest)).collect()
        } else {
            vec![1.0; 2 * self.rest.len()]
        }
    }
}
