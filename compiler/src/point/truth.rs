//! True values of psi, P and dP, and the errors of others.

use super::kernel::WrittenGradientEnergy;
use super::sample::Sample;
use crate::expression::graph::{self, dimension};
use crate::expression::precise::Precise;

/// Binary digits of true values.
const BITS: usize = 256;

/// Values beyond this are left out: the squares of their norms pass the largest number, and products
/// on the way to them may.
const LARGEST: f64 = 1e150;

/// Where psi, P and dP stand among all numbers of a place.
pub(crate) fn parts(n_components: usize) -> [std::ops::Range<usize>; 3] {
    [0..1, 1..n_components + 1, n_components + 1..2 * n_components + 1]
}

/// The root of the sum of squares.
pub(crate) fn norm(numbers: impl IntoIterator<Item = f64>) -> f64 {
    numbers.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// psi, P and dP of the energy as written for exactly these numbers, each rounded once; nothing where
/// one of them is no finite number.
pub(crate) fn truth(written: &WrittenGradientEnergy, sample: &Sample) -> Option<Vec<f64>> {
    let truth = derivatives(written, sample, &sample.direction)?;
    truth.iter().all(|x| x.abs() < LARGEST).then_some(truth)
}

/// psi, P and dP for `dF = D`, from psi on lines along `D + e` and `D - e` for each unit direction:
/// `P:e = (P:(D + e) - P:(D - e))/2`, `e:A:D = ((D + e):A:(D + e) - (D - e):A:(D - e))/4`.
pub(crate) fn derivatives(
    written: &WrittenGradientEnergy,
    sample: &Sample,
    direction: &[f64],
) -> Option<Vec<f64>> {
    let given = sample.given();
    let components = graph::components(dimension(given.len()));
    let near = sample.is_near();
    by_lines(direction, |slope| {
        written.psi(|c| {
            let j = components.iter().position(|known| *known == c).unwrap_or(0);
            let rest = if near { f64::from(u8::from(c % 4 == 0)) } else { 0.0 };
            Precise::line(given[j], slope(j), rest)
        })
    })
}

/// The same for a function of any variables, from its values along lines: `psi` is given the slope of
/// each variable.
pub(crate) fn by_lines(
    direction: &[f64],
    psi: impl Fn(&dyn Fn(usize) -> f64) -> Precise<BITS>,
) -> Option<Vec<f64>> {
    let n = direction.len();
    let mut all = vec![0.0; 1 + 2 * n];
    for k in 0..n {
        let along = |sign: f64| psi(&|j| direction[j] + sign * unit(j, k));
        let (plus, minus) = (along(1.0), along(-1.0));
        let ([psi, first, second], [_, other_first, other_second]) =
            (plus.parts()?, minus.parts()?);
        all[0] = psi.to_f64();
        all[1 + k] = (first - other_first).to_f64() / 2.0;
        all[1 + n + k] = (second - other_second).to_f64() / 4.0;
    }
    Some(all)
}

pub(crate) fn unit(j: usize, k: usize) -> f64 {
    f64::from(u8::from(j == k))
}
