//! psi, psi' and psi'' right to the last bit.

use super::sample::Point;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::kernel::WrittenEnergy;

/// psi, psi' and psi'' of the energy as written, for exactly this measure and reference, each rounded
/// once; nothing where one of them is no finite real number.
///
/// The precision grows until two of them agree and no difference has lost its digits (Ziv's strategy);
/// what is exactly zero never gets that far, and takes the highest.
pub fn truth(written: &WrittenEnergy, point: Point) -> Option<[f64; 3]> {
    truth_beside(written, point, 0.0)
}

/// The same for the measure plus a number, added exactly.
pub(crate) fn truth_beside(written: &WrittenEnergy, point: Point, by: f64) -> Option<[f64; 3]> {
    let mut last = None;
    let levels: [(bool, Level); 4] = [
        (false, evaluate::<256>),
        (false, evaluate::<512>),
        // With 128 of so many digits left no function can have been that unlucky.
        (true, evaluate::<1408>),
        (true, evaluate::<4096>),
    ];
    for (enough, evaluate) in levels {
        let (rounded, doubtful) = evaluate(written, point, by);
        let rounded = rounded?;
        if !doubtful && (enough || last == Some(rounded)) {
            return Some(rounded);
        }
        last = Some(rounded);
    }
    last
}

/// An evaluation at some precision.
type Level = fn(&WrittenEnergy, Point, f64) -> Evaluation;

/// Rounded values, and whether digits may be missing.
type Evaluation = (Option<[f64; 3]>, bool);

fn evaluate<const BITS: usize>(written: &WrittenEnergy, point: Point, by: f64) -> Evaluation {
    let measure = Precise::<BITS>::line(point.measure, 1.0, by);
    let psi = written.evaluate(measure, Precise::constant(point.reference));
    (psi.parts().map(|_| psi.rounded()), psi.doubtful())
}
