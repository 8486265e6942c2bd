//! Bonds and points near rest at which two forms of an energy are compared, where they differ with numbers of 256 bits.

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::{ExprGraph, Input, NodeId, Operator};
use crate::point::truth::{by_lines, unit};
use crate::verify::UNIT_ROUNDOFF;

/// Strains of bonds, on both sides of rest.
const STRAINS: [f64; 7] = [1e-14, 1e-11, 1e-8, 1e-5, 1e-3, 0.03, 0.2];
/// What is 0 at rest is so many times the strain, so that nothing cancels by chance.
const RATIOS: [f64; 2] = [-2.0, -1.5];
/// Forms that differ by less, in units of what rounding makes of them, are equally good.
const FINE: f64 = 12.0;
/// A form has lost digits if its error is above this, and so many times that of the other.
const LOST: (f64, f64) = (48.0, 4.0);
/// What is smaller than a form says by this is 0 but for the rounding of 256 bits, and no form has digits of it.
const NOTHING: f64 = 1e-30;
/// A step of an input, as a share of it, over which a value changes little.
const STEP: f64 = 1e-3;
/// A length at rest of few digits, but no power of two, which would hide what rounding does.
const REFERENCE: f64 = 0.8125;

/// An energy of bonds, or of points, as written, with all digits of its numbers.
pub(super) struct Samples<'a> {
    exact: &'a ExprGraph,
    written: NodeId,
    of_bonds: bool,
    n_integrals: usize,
    /// The integrals that the energy depends on, and which of them are 0 at rest.
    integrals: Vec<(u8, bool)>,
}

/// A bond, or a point: a strain and the integrals, in the order of [`Samples::integrals`].
#[derive(Clone)]
struct Bond {
    strain: f64,
    integrals: Vec<f64>,
}

/// A graph and roots in it: those of one form, then those of the other.
struct Forms {
    graph: ExprGraph,
    roots: Vec<NodeId>,
}

impl<'a> Samples<'a> {
    pub(super) fn new(
        (exact, written): (&'a ExprGraph, NodeId),
        (of_bonds, n_integrals): (bool, usize),
        vanishing: &[Input],
    ) -> Samples<'a> {
        let all = 0..n_integrals as u8;
        let held = all.filter(|k| exact.depends_on(&[written], Input::Integral(*k)));
        let integrals = held.map(|k| (k, vanishing.contains(&Input::Integral(k)))).collect();
        Samples { exact, written, of_bonds, n_integrals, integrals }
    }

    /// How often psi, the entries of its gradient and of its product lose digits in each of two forms.
    pub(super) fn lost(&self, graph: &ExprGraph, forms: [&[NodeId]; 2]) -> Vec<[usize; 2]> {
        let (graph, roots) = graph.extract(&forms.concat());
        let forms = Forms { graph, roots };
        let mut lost = vec![[0, 0]; forms.roots.len() / 2];
        let first = usize::from(self.of_bonds);
        let integrals = self.integrals.iter().map(|(k, _)| first + usize::from(*k));
        let directions: Vec<usize> = (0..first).chain(integrals).collect();
        for bond in self.bonds() {
            for direction in &directions {
                self.compare(&forms, &bond, *direction, &mut lost);
            }
        }
        lost
    }

    fn bonds(&self) -> Vec<Bond> {
        let bond = |strain: f64| {
            // So few digits that their product with the reference is exact.
            let strain = f64::from_bits(strain.to_bits() & !7);
            let ratio = RATIOS[usize::from(strain < 0.0)];
            let integral = |(place, (_, vanishes)): (usize, &(u8, bool))| {
                let place = place as f64;
                let change = strain * ratio * (1.0 + 0.375 * place);
                if *vanishes { change } else { (1.25 + 0.125 * place) * (1.0 + change) }
            };
            let integrals = self.integrals.iter().enumerate().map(integral).collect();
            Bond { strain, integrals }
        };
        STRAINS.iter().flat_map(|e| [bond(*e), bond(-e)]).collect()
    }

    /// Counts what is lost of the roots at a bond, with products in the direction of one variable.
    fn compare(&self, forms: &Forms, bond: &Bond, direction: usize, lost: &mut [[usize; 2]]) {
        let values = self.values(forms, bond, direction);
        let sizes = self.sizes(forms, bond, direction);
        let mut truth = None;
        for (k, lost) in lost.iter_mut().enumerate() {
            let both = [values[k], values[sizes.len() + k]];
            let scale = UNIT_ROUNDOFF * sizes[k].max(f64::MIN_POSITIVE);
            if (both[0] - both[1]).abs() <= FINE * scale {
                continue;
            }
            let truth = truth.get_or_insert_with(|| self.truth(bond, direction));
            let Some(truth) = truth.as_ref().map(|truth| truth[k]) else { return };
            if truth.abs() < NOTHING * both[0].abs().max(both[1].abs()) {
                continue;
            }
            let errors = both.map(|x| {
                let error = (x - truth).abs() / scale;
                if error.is_nan() { f64::INFINITY } else { error }
            });
            let least = errors[0].min(errors[1]);
            for (lost, error) in lost.iter_mut().zip(errors) {
                *lost += usize::from(error > LOST.0 && error > LOST.1 * least);
            }
        }
    }

    fn values(&self, forms: &Forms, bond: &Bond, direction: usize) -> Vec<f64> {
        let mut interpreter = Interpreter::<f64>::new();
        interpreter.run(&forms.graph, |input| match input {
            Input::Current(_) => REFERENCE + REFERENCE * bond.strain,
            Input::Reference(_) => REFERENCE,
            Input::Change(_) => bond.strain,
            Input::Direction(k) => unit(usize::from(k), direction),
            other => self.known(bond, other),
        });
        forms.roots.iter().map(|root| interpreter.number(*root)).collect()
    }

    /// The value of an integral at a bond, and of a field one of few digits.
    fn known(&self, bond: &Bond, input: Input) -> f64 {
        match input {
            Input::Parameter(field) => 1.0 + 0.125 * f64::from(1 + field % 7),
            Input::Integral(k) => {
                let place = self.integrals.iter().position(|(known, _)| *known == k);
                place.map_or(f64::NAN, |place| bond.integrals[place])
            }
            _ => f64::NAN,
        }
    }

    /// The size of each root of the second form, or what a relative change of one of its inputs makes of it.
    fn sizes(&self, forms: &Forms, bond: &Bond, direction: usize) -> Vec<f64> {
        let of = |bond: &Bond| self.values(forms, bond, direction).split_off(forms.roots.len() / 2);
        let mut sizes: Vec<f64> = of(bond).iter().map(|x| x.abs()).collect();
        for varied in usize::from(!self.of_bonds)..=bond.integrals.len() {
            let [less, more] = [1.0 - STEP, 1.0 + STEP].map(|by| {
                let mut moved = bond.clone();
                match varied.checked_sub(1) {
                    None => moved.strain *= by,
                    Some(k) => moved.integrals[k] *= by,
                }
                of(&moved)
            });
            for ((size, less), more) in sizes.iter_mut().zip(less).zip(more) {
                *size = size.max((more - less).abs() / (2.0 * STEP));
            }
        }
        sizes
    }

    /// psi, its gradient and its product as written; nothing where one of them is no number.
    fn truth(&self, bond: &Bond, direction: usize) -> Option<Vec<f64>> {
        let first = usize::from(self.of_bonds);
        let places = 0..first + self.n_integrals;
        let direction: Vec<f64> = places.map(|k| unit(k, direction)).collect();
        by_lines(&direction, |slope| {
            let more = REFERENCE * bond.strain;
            let [rest, length, moved] =
                [(REFERENCE, 0.0, 0.0), (REFERENCE, slope(0), more), (0.0, slope(0), more)]
                    .map(|(value, slope, more)| Precise::line(value, slope, more));
            let change = Precise::binary(Operator::Divide, moved, rest.clone());
            let mut interpreter = Interpreter::<Precise<256>>::new();
            interpreter.run(self.exact, |input| match input {
                Input::Current(_) => length.clone(),
                Input::Reference(_) => rest.clone(),
                Input::Change(_) => change.clone(),
                Input::Integral(k) => {
                    Precise::line(self.known(bond, input), slope(first + usize::from(k)), 0.0)
                }
                other => Precise::line(self.known(bond, other), 0.0, 0.0),
            });
            interpreter.number(self.written)
        })
    }
}
