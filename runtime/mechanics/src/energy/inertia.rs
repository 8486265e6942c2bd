//! Springs that hold every degree of freedom to a place of its own: what inertia and damping are to a
//! step of implicit integration.

use std::sync::Arc;

use super::{Energy, Hessian, NonFinite, Wanted, check_sizes};
use crate::interaction::Report;
use crate::matrix::BlockPattern;

/// `1/2 sum k (u - a)^2` over all degrees of freedom.
pub struct Inertia {
    dimension: usize,
    positions: Vec<f64>,
    names: Arc<[String]>,
    pattern: Arc<BlockPattern>,
    /// `k` in N/m.
    stiffness: Vec<f64>,
    /// `a` in m.
    places: Vec<f64>,
}

impl Inertia {
    /// Of a body with these positions at rest, with a stiffness in N/m, not negative, and a place for the
    /// displacement of each degree of freedom: all `n x d`, in m.
    pub fn new(
        dimension: usize,
        positions: &[f64],
        stiffness: Vec<f64>,
        places: Vec<f64>,
    ) -> Inertia {
        let n_dofs = positions.len();
        assert!(stiffness.len() == n_dofs && places.len() == n_dofs, "one per degree of freedom");
        let n = positions.len() / dimension;
        let pattern = BlockPattern {
            dimension,
            row_start: (0..=n).collect(),
            columns: (0..n as u32).collect(),
        };
        Inertia {
            dimension,
            positions: positions.to_vec(),
            names: ["inertia".to_owned()].into(),
            pattern: Arc::new(pattern),
            stiffness,
            places,
        }
    }

    /// The stiffness of a point's block, row by row.
    fn fill(&self, blocks: &mut [f64]) {
        let d = self.dimension;
        blocks.fill(0.0);
        for (block, own) in blocks.chunks_exact_mut(d * d).zip(self.stiffness.chunks_exact(d)) {
            (0..d).for_each(|axis| block[axis * (d + 1)] = own[axis]);
        }
    }
}

impl Energy for Inertia {
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
        Report::default()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        check_sizes(self, u, &wanted, parts);
        let off = || u.iter().zip(&self.places).zip(&self.stiffness);
        if let [part] = parts {
            *part = off().fold(0.0, |sum, ((u, a), k)| sum + 0.5 * k * (u - a) * (u - a));
        }
        let pull = |forces: &mut [f64]| {
            forces.iter_mut().zip(off()).for_each(|(force, ((u, a), k))| *force = k * (u - a));
        };
        match wanted {
            Wanted::Energy => {}
            Wanted::Forces(forces) => pull(forces),
            Wanted::Tangent(forces, tangent) => {
                pull(forces);
                self.fill(&mut tangent.values);
            }
            Wanted::Diagonal(forces, diagonal) => {
                pull(forces);
                self.fill(diagonal);
            }
        }
        Ok(())
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        let d = self.dimension;
        for (point, share) in shares.iter_mut().enumerate() {
            let own = point * d..(point + 1) * d;
            *share = own.fold(0.0, |sum, dof| {
                let off = u[dof] - self.places[dof];
                sum + 0.5 * self.stiffness[dof] * off * off
            });
        }
        Ok(())
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        let d = self.dimension;
        for (place, virial) in virials.iter_mut().enumerate() {
            let (dof, column) = (place / d, place % d);
            let arm = self.positions[dof / d * d + column];
            *virial = self.stiffness[dof] * (u[dof] - self.places[dof]) * arm;
        }
        Ok(())
    }

    fn hessian(&self, _: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        Ok(Box::new(Diagonal(&self.stiffness)))
    }
}

struct Diagonal<'a>(&'a [f64]);

impl Hessian for Diagonal<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        product.iter_mut().zip(p).zip(self.0).for_each(|((product, p), k)| *product = k * p);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::BlockMatrix;

    #[test]
    fn derivatives_are_those_of_the_energy() {
        let x = [0.0, 0.0, 1.0, 0.0];
        let (k, a) = (vec![1.0, 2.0, 3.0, 0.0], vec![0.1, 0.0, 0.0, 5.0]);
        let inertia = Inertia::new(2, &x, k, a);
        let u = [0.2, 0.3, -0.4, 1.0];
        let mut forces = [0.0; 4];
        let mut tangent = BlockMatrix::zeros(inertia.pattern());
        let parts = inertia.tangent(&u, &mut forces, &mut tangent).unwrap();
        assert!((parts.total() - 0.5 * (0.01 + 0.18 + 0.48)).abs() < 1e-15);
        let known = [0.1, 0.6, -1.2, 0.0];
        assert!(forces.iter().zip(known).all(|(x, y)| (x - y).abs() < 1e-15), "{forces:?}");
        assert_eq!(tangent.values, [1.0, 0.0, 0.0, 2.0, 3.0, 0.0, 0.0, 0.0]);
        let (mut product, mut shares) = ([0.0; 4], [0.0; 2]);
        inertia.hessian(&u).unwrap().multiply(&[1.0; 4], &mut product);
        assert_eq!(product, [1.0, 2.0, 3.0, 0.0]);
        inertia.shares(&u, &mut shares).unwrap();
        assert!((shares[0] + shares[1] - parts.total()).abs() < 1e-15);
        let mut virials = [0.0; 8];
        inertia.virials(&u, &mut virials).unwrap();
        assert_eq!(virials[4], forces[2]);
        let mut diagonal = [0.0; 8];
        inertia.tangent_diagonal(&u, &mut forces, &mut diagonal).unwrap();
        assert_eq!(diagonal, *tangent.values);
    }
}
