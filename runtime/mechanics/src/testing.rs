//! Networks of springs that implement [`Energy`] in a few lines, for the tests of the solvers.

use std::sync::Arc;

use crate::energy::{Argument, Energy, Hessian, NonFinite, Wanted};
use crate::interaction::Report;
use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};

/// psi, psi' and psi'' (with respect to the length) from the strain `e = l/L - 1` and `L`.
pub type SpringLaw = fn(f64, f64) -> (f64, f64, f64);

/// Seth-Hill with n = 1 and C = 1: `psi = 1/2 L e^2`.
pub fn linear(e: f64, length: f64) -> (f64, f64, f64) {
    (0.5 * length * e * e, e, 1.0 / length)
}

/// The strain at which [`softening`] carries most.
pub const PEAK: f64 = 0.1;

/// `psi' = e exp(-e/PEAK)`: the force falls beyond the peak.
pub fn softening(e: f64, length: f64) -> (f64, f64, f64) {
    let decay = libm::exp(-e / PEAK);
    let psi = length * PEAK * PEAK * (1.0 - (1.0 + e / PEAK) * decay);
    (psi, e * decay, (1.0 - e / PEAK) * decay / length)
}

/// `psi = 1/2 L ln(l/L)^2`, declared not finite below a fifth of the length.
pub fn logarithmic(e: f64, length: f64) -> (f64, f64, f64) {
    if e < -0.8 {
        return (f64::NAN, f64::NAN, f64::NAN);
    }
    let (ln, stretch) = (libm::log1p(e), 1.0 + e);
    (0.5 * length * ln * ln, ln / stretch, (1.0 - ln) / (length * stretch * stretch))
}

/// [`linear`], declared not finite at strains beyond 0.3.
pub fn limited(e: f64, length: f64) -> (f64, f64, f64) {
    if e.abs() > 0.3 { (f64::NAN, f64::NAN, f64::NAN) } else { linear(e, length) }
}

/// A network of springs: each bond once with weight 1.
pub struct SpringNetwork {
    pub dimension: usize,
    pub positions: Vec<f64>,
    pub bonds: Vec<(usize, usize)>,
    pub law: SpringLaw,
    names: Arc<[String]>,
    pattern: Arc<BlockPattern>,
}

impl SpringNetwork {
    pub fn new(
        dimension: usize,
        positions: Vec<f64>,
        bonds: Vec<(usize, usize)>,
        law: SpringLaw,
    ) -> SpringNetwork {
        let n = positions.len() / dimension;
        let mut rows: Vec<Vec<u32>> = (0..n as u32).map(|i| vec![i]).collect();
        for &(i, j) in &bonds {
            rows[i.min(j)].push(i.max(j) as u32);
        }
        rows.iter_mut().for_each(|row| row.sort_unstable());
        let mut row_start = vec![0];
        row_start.extend(rows.iter().scan(0, |total, row| {
            *total += row.len();
            Some(*total)
        }));
        let pattern = BlockPattern { dimension, row_start, columns: rows.concat() };
        let names = Arc::new(["psi(l)".to_string()]);
        SpringNetwork { dimension, positions, bonds, law, names, pattern: Arc::new(pattern) }
    }

    /// A lattice of `counts` points with unit spacing, bonds up to `reach` spacings.
    pub fn lattice(counts: &[usize], reach: f64, law: SpringLaw) -> SpringNetwork {
        let d = counts.len();
        let n: usize = counts.iter().product();
        let cell = |mut p: usize| {
            let mut cell = vec![0i64; d];
            for a in (0..d).rev() {
                cell[a] = (p % counts[a]) as i64;
                p /= counts[a];
            }
            cell
        };
        let cells: Vec<Vec<i64>> = (0..n).map(cell).collect();
        let reach_squared = (reach * reach * (1.0 + 1e-6)) as i64;
        let mut bonds = Vec::new();
        for i in 0..n {
            for j in i + 1..n {
                // Points are ordered by their first coordinate.
                if cells[j][0] - cells[i][0] > reach as i64 {
                    break;
                }
                let squared = (0..d).map(|a| (cells[j][a] - cells[i][a]).pow(2)).sum::<i64>();
                if squared <= reach_squared {
                    bonds.push((i, j));
                }
            }
        }
        let positions = cells.concat().iter().map(|&x| x as f64).collect();
        SpringNetwork::new(d, positions, bonds, law)
    }

    pub fn n_points(&self) -> usize {
        self.positions.len() / self.dimension
    }

    pub fn position(&self, point: usize) -> &[f64] {
        &self.positions[point * self.dimension..(point + 1) * self.dimension]
    }

    /// All degrees of freedom of the points that satisfy `condition`, ascending.
    pub fn dofs_where(&self, condition: impl Fn(&[f64]) -> bool) -> Vec<usize> {
        let d = self.dimension;
        (0..self.n_points())
            .filter(|&p| condition(self.position(p)))
            .flat_map(|p| p * d..(p + 1) * d)
            .collect()
    }

    fn block(&self, i: usize, j: usize) -> usize {
        let start = self.pattern.row_start[i];
        let row = &self.pattern.columns[start..self.pattern.row_start[i + 1]];
        start + row.binary_search(&(j as u32)).unwrap()
    }

    fn assemble(
        &self,
        u: &[f64],
        mut gradient: Option<&mut [f64]>,
        mut tangent: Option<&mut BlockMatrix>,
    ) -> Result<f64, NonFinite> {
        let d = self.dimension;
        if let Some(gradient) = gradient.as_deref_mut() {
            gradient.fill(0.0);
        }
        if let Some(tangent) = tangent.as_deref_mut() {
            tangent.values.fill(0.0);
        }
        let mut energy = 0.0;
        for &(i, j) in &self.bonds {
            let xi: Vec<f64> =
                (0..d).map(|a| self.positions[j * d + a] - self.positions[i * d + a]).collect();
            let eta: Vec<f64> = (0..d).map(|a| u[j * d + a] - u[i * d + a]).collect();
            let reference = xi.iter().map(|x| x * x).sum::<f64>().sqrt();
            let zeta: Vec<f64> = (0..d).map(|a| xi[a] + eta[a]).collect();
            let length = zeta.iter().map(|x| x * x).sum::<f64>().sqrt();
            let twice = (0..d).map(|a| eta[a] * (2.0 * xi[a] + eta[a])).sum::<f64>();
            let strain = twice / (reference * (length + reference));
            let (psi, force, stiffness) = (self.law)(strain, reference);
            if !psi.is_finite() {
                let (argument, points) = (Argument::Measure(Measure::Length), vec![i, j]);
                let displacements = [&u[i * d..(i + 1) * d], &u[j * d..(j + 1) * d]].concat();
                let inverted = false;
                let value = length;
                return Err(NonFinite {
                    argument,
                    points,
                    displacements,
                    value,
                    reference,
                    inverted,
                });
            }
            energy += psi;
            if let Some(gradient) = gradient.as_deref_mut() {
                for a in 0..d {
                    gradient[i * d + a] -= force * zeta[a] / length;
                    gradient[j * d + a] += force * zeta[a] / length;
                }
            }
            if let Some(tangent) = tangent.as_deref_mut() {
                let places = [(self.block(i, i), 1.0), (self.block(j, j), 1.0)];
                let coupling = (self.block(i.min(j), i.max(j)), -1.0);
                for a in 0..d {
                    for b in 0..d {
                        let nn = zeta[a] * zeta[b] / (length * length);
                        let unit = if a == b { 1.0 } else { 0.0 };
                        let entry = stiffness * nn + force / length * (unit - nn);
                        for (block, sign) in places.iter().chain([&coupling]) {
                            tangent.values[block * d * d + a * d + b] += sign * entry;
                        }
                    }
                }
            }
        }
        Ok(energy)
    }
}

impl Energy for SpringNetwork {
    fn dimension(&self) -> usize {
        self.dimension
    }

    fn positions(&self) -> &[f64] {
        &self.positions
    }

    fn parts(&self) -> &Arc<[String]> {
        &self.names
    }

    fn report(&self) -> Report {
        Report { bonds: self.bonds.len() as u64, ..Report::default() }
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        let energy = match wanted {
            Wanted::Energy => self.assemble(u, None, None)?,
            Wanted::Forces(forces) => self.assemble(u, Some(forces), None)?,
            Wanted::Tangent(forces, tangent) => self.assemble(u, Some(forces), Some(tangent))?,
            Wanted::Diagonal(forces, diagonal) => {
                let mut tangent = BlockMatrix::zeros(&self.pattern);
                let energy = self.assemble(u, Some(forces), Some(&mut tangent))?;
                let block = self.dimension * self.dimension;
                let rows = self.pattern.row_start.iter().zip(diagonal.chunks_exact_mut(block));
                for (row, out) in rows {
                    out.copy_from_slice(&tangent.values[row * block..(row + 1) * block]);
                }
                energy
            }
        };
        // Without parts forces come alone.
        parts.iter_mut().for_each(|part| *part = energy);
        Ok(())
    }

    /// No solver asks for them.
    fn shares(&self, _: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        shares.fill(f64::NAN);
        Ok(())
    }

    /// Nor for these.
    fn virials(&self, _: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        virials.fill(f64::NAN);
        Ok(())
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        let mut tangent = BlockMatrix::zeros(&self.pattern);
        self.assemble(u, None, Some(&mut tangent))?;
        Ok(Box::new(tangent))
    }
}

impl Hessian for BlockMatrix {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        product.copy_from_slice(&BlockMatrix::multiply(self, p));
    }
}

/// Numbers in [-1, 1) that are the same on every machine.
pub fn pseudo_random(n: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| next()).collect()
}

/// Bonds of so many that go at once, in no order, and which are lost behind that: some, more, and all.
#[cfg(test)]
pub(crate) fn goes_to_pieces(n: usize) -> Vec<(Vec<usize>, Vec<bool>)> {
    let mut is_lost = vec![false; n];
    let shares = [-0.99, -0.9, -0.5, 0.0, 0.7, 2.0];
    let goes = shares.iter().enumerate().map(|(seed, share)| {
        let chances = pseudo_random(n, seed as u64 + 40);
        let is_new = |bond: &usize| !is_lost[*bond] && chances[*bond] < *share;
        let new: Vec<usize> = (0..n).rev().filter(is_new).collect();
        new.iter().for_each(|bond| is_lost[*bond] = true);
        (new, is_lost.clone())
    });
    goes.collect()
}
