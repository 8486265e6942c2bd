//! Which degrees of freedom are fixed, and the way between all of them and the free ones.
//!
//! Degree of freedom `d * point + component` is component `component` of the displacement of
//! `point`. A fixed one has a prescribed value; the equations are solved for the free ones.

use std::sync::OnceLock;

/// The fixed degrees of freedom of a body.
#[derive(Clone, Debug)]
pub struct Constraints {
    fixed: Vec<usize>,
    /// Made when it is first asked for.
    free: OnceLock<Vec<usize>>,
    is_fixed: Vec<bool>,
}

impl PartialEq for Constraints {
    fn eq(&self, other: &Constraints) -> bool {
        self.is_fixed == other.is_fixed
    }
}

/// A list of fixed degrees of freedom that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConstraintError {
    /// The list names a degree of freedom that the body does not have.
    #[error("degree of freedom {dof} is prescribed, but the body has only {n_dofs}")]
    OutOfRange {
        /// The number in the list.
        dof: usize,
        /// How many there are.
        n_dofs: usize,
    },
    /// The list names a degree of freedom twice or is not in ascending order.
    #[error("prescribed degrees of freedom must ascend: {dof} follows {previous}")]
    NotAscending {
        /// The entry before.
        previous: usize,
        /// The entry that does not ascend.
        dof: usize,
    },
}

impl Constraints {
    /// Takes the fixed degrees of freedom, ascending, out of `n_dofs`.
    pub fn new(n_dofs: usize, fixed: &[usize]) -> Result<Constraints, ConstraintError> {
        let mut is_fixed = vec![false; n_dofs];
        for (place, &dof) in fixed.iter().enumerate() {
            if dof >= n_dofs {
                return Err(ConstraintError::OutOfRange { dof, n_dofs });
            }
            if place > 0 && fixed[place - 1] >= dof {
                return Err(ConstraintError::NotAscending { previous: fixed[place - 1], dof });
            }
            is_fixed[dof] = true;
        }
        Ok(Constraints { fixed: fixed.to_vec(), free: OnceLock::new(), is_fixed })
    }

    /// Nothing is fixed.
    pub fn none(n_dofs: usize) -> Constraints {
        Constraints { fixed: Vec::new(), free: OnceLock::new(), is_fixed: vec![false; n_dofs] }
    }

    /// All degrees of freedom, fixed and free.
    pub fn n_dofs(&self) -> usize {
        self.is_fixed.len()
    }

    /// How many are free.
    pub fn n_free(&self) -> usize {
        self.n_dofs() - self.fixed.len()
    }

    /// The fixed degrees of freedom, ascending.
    pub fn fixed(&self) -> &[usize] {
        &self.fixed
    }

    /// The free degrees of freedom, ascending.
    pub fn free(&self) -> &[usize] {
        let all = || (0..self.n_dofs()).filter(|&dof| !self.is_fixed[dof]).collect();
        self.free.get_or_init(all)
    }

    /// Whether a degree of freedom is fixed.
    pub fn is_fixed(&self, dof: usize) -> bool {
        self.is_fixed[dof]
    }

    /// The free entries of a full vector.
    pub fn free_part(&self, full: &[f64]) -> Vec<f64> {
        self.free().iter().map(|&dof| full[dof]).collect()
    }

    /// Writes `values`, one per free degree of freedom, into a full vector.
    pub fn scatter_free(&self, values: &[f64], full: &mut [f64]) {
        for (&dof, &value) in self.free().iter().zip(values) {
            full[dof] = value;
        }
    }

    /// Writes `values`, one per fixed degree of freedom, into a full vector.
    pub fn scatter_fixed(&self, values: &[f64], full: &mut [f64]) {
        for (&dof, &value) in self.fixed.iter().zip(values) {
            full[dof] = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_and_free_vectors_map_both_ways() {
        let constraints = Constraints::new(5, &[1, 4]).unwrap();
        assert_eq!(constraints.free(), [0, 2, 3]);
        let mut full = vec![0.0, 10.0, 20.0, 30.0, 40.0];
        assert_eq!(constraints.free_part(&full), [0.0, 20.0, 30.0]);
        constraints.scatter_free(&[1.0, 2.0, 3.0], &mut full);
        constraints.scatter_fixed(&[-1.0, -4.0], &mut full);
        assert_eq!(full, [1.0, -1.0, 2.0, 3.0, -4.0]);
        assert!(constraints.is_fixed(4) && !constraints.is_fixed(3));
    }

    #[test]
    fn unusable_lists_are_refused() {
        let twice = ConstraintError::NotAscending { previous: 2, dof: 2 };
        assert_eq!(Constraints::new(4, &[0, 2, 2]), Err(twice));
        let outside = ConstraintError::OutOfRange { dof: 4, n_dofs: 4 };
        assert_eq!(Constraints::new(4, &[4]), Err(outside));
    }
}
