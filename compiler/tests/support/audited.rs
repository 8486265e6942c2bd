//! What holds for the numbers that audits measure against, and for audits, of every program.
//!
//! Used by the tests and, with more time, by the fuzz target `audit`.

use piola_compiler::audit::{Settings, audit, functions};
use piola_compiler::expression::number::Number;
use piola_compiler::expression::precise::Precise;
use piola_compiler::{Form, Level, Model, Setting, Values, check_text};
use piola_grammar::generate::potential_text;

/// What a fuzzer's bytes are: two numbers of 64 bits, and a program.
pub(crate) fn split(bytes: &[u8]) -> ([f64; 2], String) {
    let (numbers, program) = bytes.split_at(bytes.len().min(16));
    let number = |k: usize| {
        let byte = |i: usize| numbers.get(8 * k + i).copied().unwrap_or(0x3f);
        f64::from_bits(u64::from_le_bytes(std::array::from_fn(byte)))
    };
    ([number(0), number(1)], potential_text(program))
}

/// What came of evaluations with 256 and 512 binary digits.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    /// The same energy to the last bit but one.
    pub(crate) agree: usize,
    /// Another energy, or none, though no difference has lost its digits: branches meet there, and
    /// rounding decides.
    pub(crate) differ: usize,
    /// A difference has lost its digits.
    pub(crate) doubtful: usize,
    /// No energy.
    pub(crate) none: usize,
}

impl Seen {
    pub(crate) fn add(&mut self, more: Seen) {
        self.agree += more.agree;
        self.differ += more.differ;
        self.doubtful += more.doubtful;
        self.none += more.none;
    }

    fn see(&mut self, few: &Precise<256>, many: &Precise<512>) {
        let close = (few.value() - many.value()).abs() <= f64::EPSILON * many.value().abs();
        match (few.parts().is_some(), many.parts().is_some()) {
            _ if few.doubtful() || many.doubtful() => self.doubtful += 1,
            (false, false) => self.none += 1,
            (true, true) if few.value() == many.value() || close => self.agree += 1,
            _ => self.differ += 1,
        }
    }
}

/// Evaluates every energy of a program over numbers of any precision, at these numbers and where results
/// are exact.
///
/// # Panics
/// Where that panics.
pub(crate) fn evaluated(text: &str, [x, y]: [f64; 2]) -> Seen {
    let mut seen = Seen::default();
    let Ok((_, model)) = check_text(text) else { return seen };
    let places = [[x, y], [y, y], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0], [2.0, 1.0]];
    for (dimension, values) in with_values(&model) {
        let Some(variant) = model.variant(dimension) else { continue };
        for energy in &variant.energies {
            let written = model.written(&values, energy.measure);
            for written in [written.clone(), written.of_square()] {
                for [measure, reference] in places {
                    seen.see(
                        &written.evaluate(Precise::variable(measure), Precise::constant(reference)),
                        &written.evaluate(Precise::variable(measure), Precise::constant(reference)),
                    );
                }
            }
        }
        let written = model.written_gradient(&values);
        for [stretch, slide] in places {
            // Stretched alike in all directions, and, but for rest, sheared in one plane.
            let component = |c: u8| match c {
                1 if stretch != 1.0 => slide,
                _ if c.is_multiple_of(4) => stretch,
                _ => 0.0,
            };
            seen.see(
                &written.psi(|c| Precise::line(component(c), 1.0, 0.0)),
                &written.psi(|c| Precise::line(component(c), 1.0, 0.0)),
            );
        }
    }
    seen
}

/// Audits every energy of a program; how many places have true values.
///
/// # Panics
/// Where that panics.
pub(crate) fn audited(text: &str) -> usize {
    let Ok((_, model)) = check_text(text) else { return 0 };
    let mut n_points = 0;
    for (_, values) in with_values(&model) {
        let settings =
            Settings { form: Form::Accurate, level: Level::Strict, points: 1, bar: 64.0 };
        let Ok((mut audits, _)) = audit(&model, &values, &settings) else { continue };
        audits.extend(functions(&model, &values, &settings).unwrap_or_default());
        let regimes = audits.iter().flat_map(|audit| &audit.regimes);
        n_points += regimes.map(|regime| regime.n_points).sum::<usize>();
    }
    n_points
}

/// Dimensions with defaults, and 1 for what has none.
fn with_values(model: &Model) -> Vec<(usize, Values)> {
    let values = |dimension: usize| {
        let defaults = &model.variant(dimension)?.defaults;
        let missing = model.parameters().iter().zip(defaults).filter(|(_, value)| value.is_none());
        let settings: Vec<(String, Setting)> =
            missing.map(|(p, _)| (p.name.clone(), Setting::Number(1.0))).collect();
        Some((dimension, model.values(dimension, &settings, Some(0.5)).ok()?))
    };
    model.dimensions().filter_map(values).collect()
}
