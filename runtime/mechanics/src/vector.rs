//! Sums over vectors, always in the order of the entries: the same bits for any thread count.

/// The 2-norm, free of overflow and underflow: forces in nanometre units may be 1e-200.
pub fn norm(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = values.clone().map(f64::abs).fold(0.0, f64::max);
    if largest == 0.0 || !largest.is_finite() {
        // `max` passes over NaN; the sum below would not.
        return if values.clone().any(f64::is_nan) { f64::NAN } else { largest };
    }
    if (1e-140..1e140).contains(&largest) {
        values.fold(0.0, |sum, x| sum + x * x).sqrt()
    } else {
        let scaled = values.fold(0.0, |sum, x| sum + (x / largest) * (x / largest));
        largest * scaled.sqrt()
    }
}

/// The 2-norm of a slice.
pub fn norm_of(values: &[f64]) -> f64 {
    norm(values.iter().copied())
}

/// The scalar product, in eight sums side by side: one sum would wait for each of its additions.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (x, y) = (x.chunks_exact(8), y.chunks_exact(8));
    let tail = x.remainder().iter().zip(y.remainder()).fold(0.0, |sum, (x, y)| sum + x * y);
    let mut sums = [0.0; 8];
    for (x, y) in x.zip(y) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().fold(tail, |sum, x| sum + x)
}

/// Whether all numbers are finite.
pub(crate) fn are_finite(values: &[f64]) -> bool {
    // 0 times a number that is not finite is not 0: sums tell of all.
    let mut sums = [0.0; 8];
    let (groups, rest) = values.as_chunks::<8>();
    for group in groups {
        for k in 0..8 {
            sums[k] += 0.0 * group[k];
        }
    }
    rest.iter().for_each(|x| sums[0] += 0.0 * x);
    sums == [0.0; 8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scalar_products_miss_no_entry() {
        for n in 0..30 {
            let x: Vec<f64> = (0..n).map(f64::from).collect();
            let expected: i32 = (0..n).map(|k| k * (k + 1)).sum();
            let y: Vec<f64> = x.iter().map(|x| x + 1.0).collect();
            assert_eq!(dot(&x, &y), f64::from(expected), "{n} entries");
        }
    }

    #[test]
    fn norms_neither_overflow_nor_underflow() {
        for scale in [1.0, 1e-200, 1e200] {
            let norm = norm_of(&[3.0 * scale, -4.0 * scale]);
            assert!((norm / (5.0 * scale) - 1.0).abs() < 1e-15, "{norm:e}");
        }
        assert_eq!(norm_of(&[]), 0.0);
        assert!(norm_of(&[0.0, f64::NAN]).is_nan());
        assert_eq!(norm_of(&[1.0, f64::INFINITY]), f64::INFINITY);
    }
}
