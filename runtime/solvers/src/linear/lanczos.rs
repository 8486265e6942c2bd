//! What conjugate gradients have seen of the spectrum.
//!
//! The step lengths `alpha` and the ratios `beta` of the method are the entries of the Lanczos
//! matrix of `M^-1 K` (Golub, Van Loan, Matrix Computations, 2013, section 11.3.6):
//! `T[k][k] = 1/alpha[k] + beta[k-1]/alpha[k-1]` and `T[k][k+1] = sqrt(beta[k])/alpha[k]`. Its
//! eigenvalues, the Ritz values, lie within the spectrum, and the outer ones soon reach its ends.

/// Bisections: each halves the interval, so these reach rounding.
const BISECTIONS: usize = 60;

/// The recurrence of a run of conjugate gradients.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lanczos {
    diagonal: Vec<f64>,
    off_diagonal: Vec<f64>,
    /// `beta/alpha` of the last iteration, the part that it leaves to the next diagonal.
    carried: f64,
}

/// Extreme Ritz values of the preconditioned matrix: the true spectrum reaches at least as far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RitzValues {
    /// The smallest.
    pub smallest: f64,
    /// The largest.
    pub largest: f64,
}

impl RitzValues {
    /// An estimate from below of the condition of the preconditioned matrix.
    pub fn condition(&self) -> f64 {
        self.largest / self.smallest
    }
}

impl Lanczos {
    /// Notes an iteration: its step length, and the ratio that leads to the next direction.
    pub(super) fn push(&mut self, alpha: f64, beta: f64) {
        self.diagonal.push(1.0 / alpha + self.carried);
        self.off_diagonal.push(beta.sqrt() / alpha);
        self.carried = beta / alpha;
    }

    /// The extreme Ritz values; `None` before the first iteration.
    pub(super) fn extremes(&self) -> Option<RitzValues> {
        let n = self.diagonal.len();
        // Every eigenvalue lies in a disc of Gershgorin.
        let radius = |k: usize| {
            let before = if k > 0 { self.off_diagonal[k - 1] } else { 0.0 };
            before + if k + 1 < n { self.off_diagonal[k] } else { 0.0 }
        };
        let least = (0..n).map(|k| self.diagonal[k] - radius(k)).reduce(f64::min)?;
        let most = (0..n).map(|k| self.diagonal[k] + radius(k)).reduce(f64::max)?;
        let (smallest, largest) =
            (self.eigenvalue(1, least, most), self.eigenvalue(n, least, most));
        Some(RitzValues { smallest, largest })
    }

    /// The eigenvalue below which, itself included, there are `number`.
    fn eigenvalue(&self, number: usize, least: f64, most: f64) -> f64 {
        let (mut low, mut high) = (least, most);
        for _ in 0..BISECTIONS {
            let middle = low + 0.5 * (high - low);
            if self.count_below(middle) >= number {
                high = middle;
            } else {
                low = middle;
            }
        }
        low + 0.5 * (high - low)
    }

    /// How many eigenvalues are below `x`: the negative pivots of `T - x`.
    fn count_below(&self, x: f64) -> usize {
        let mut pivot = f64::INFINITY;
        let mut count = 0;
        for (k, diagonal) in self.diagonal.iter().enumerate() {
            let coupling = if k > 0 { self.off_diagonal[k - 1] } else { 0.0 };
            // A pivot that vanishes is moved by less than rounding.
            let divisor = if pivot == 0.0 { f64::EPSILON * diagonal.abs() } else { pivot };
            pivot = diagonal - x - coupling / divisor * coupling;
            count += usize::from(pivot < 0.0);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lanczos matrices of known spectrum: `2 cos(k pi/(n+1))` shifted by 2 for ones off the
    /// diagonal of twos.
    #[test]
    fn extremes_are_those_of_a_known_matrix() {
        for n in [1, 2, 5, 40] {
            let lanczos =
                Lanczos { diagonal: vec![2.0; n], off_diagonal: vec![1.0; n], carried: 0.0 };
            let found = lanczos.extremes().unwrap();
            let turn = std::f64::consts::PI / (n as f64 + 1.0);
            let expected = [2.0 - 2.0 * libm::cos(turn), 2.0 + 2.0 * libm::cos(turn)];
            assert!((found.smallest - expected[0]).abs() < 1e-14, "{n}: {found:?}");
            assert!((found.largest - expected[1]).abs() < 1e-14, "{n}: {found:?}");
        }
        assert_eq!(Lanczos::default().extremes(), None);
    }

    #[test]
    fn scales_do_not_matter() {
        for scale in [1e-200, 1e200] {
            let mut lanczos = Lanczos::default();
            lanczos.push(1.0 / scale, 0.25);
            lanczos.push(0.5 / scale, 0.0);
            let found = lanczos.extremes().unwrap();
            // [[1, 1/2], [1/2, 2 + 1/4]]
            let root = (1.25f64 * 1.25 + 1.0).sqrt();
            assert!((found.smallest / scale - (3.25 - root) / 2.0).abs() < 1e-14, "{found:?}");
            assert!((found.largest / scale - (3.25 + root) / 2.0).abs() < 1e-14, "{found:?}");
        }
    }
}
