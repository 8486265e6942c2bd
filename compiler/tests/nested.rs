//! How many random laws that cancel at rest keep their digits there, and whether the audit finds those
//! that do not.

#[path = "support/nested.rs"]
mod generator;
#[path = "support/processors.rs"]
mod processors;

use std::collections::BTreeMap;
use std::ops::Range;

use generator::{Nested, law};
use piola_compiler::audit::{Place, Regime, Settings, audit};
use piola_compiler::expression::number::Number;
use piola_compiler::expression::precise::Precise;
use piola_compiler::verify::sample::Point;
use piola_compiler::verify::truth::truth;
use piola_compiler::{Batch, Form, Level, Measure, Mode};
use processors::on_all_processors;

/// Half the distance from 1 to the next number.
const U: f64 = f64::EPSILON / 2.0;

/// Largest error in u of `abs(t) + abs(e*dt/de)` of a value `t` at a strain `e`.
const BAR: f64 = 64.0;

/// Strains up to this are near rest.
const NEAR: f64 = 0.25;

/// An error in u of the value for which no rounding of a random strain is an excuse.
const HOPELESS: f64 = 1e9;

/// What was measured last: to be raised, or lowered, with every law that is gained.
struct Bounds {
    /// At least so many laws keep psi, psi' and psi'' near rest.
    kept: usize,
    /// At most so many are lost, and the audit calls them fine.
    overlooked: usize,
}

/// What was found for a law.
struct Found {
    /// The largest errors, and the strains where they are.
    worst: [(f64, f64); 3],
    /// Whether the audit is content with it near rest.
    is_fine: bool,
}

impl Found {
    fn is_kept(&self) -> bool {
        self.worst.iter().all(|(error, _)| *error <= BAR)
    }
}

#[test]
fn laws_that_cancel_at_rest_keep_their_digits() {
    follow(0..100, Bounds { kept: 95, overlooked: 0 });
}

/// `cargo test --release --workspace --test nested -- --ignored --nocapture`
#[test]
#[ignore = "minutes"]
fn four_hundred_more_laws_that_cancel_at_rest_keep_their_digits() {
    follow(100..500, Bounds { kept: 368, overlooked: 0 });
}

fn follow(seeds: Range<u64>, bounds: Bounds) {
    let laws: Vec<Nested> = seeds.map(law).collect();
    let found = on_all_processors(&laws, look_at);
    let mut by_outer: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    let mut kept_orders = [0; 3];
    let (mut kept, mut overlooked, mut blamed) = (0, 0, 0);
    for (law, found) in laws.iter().zip(&found) {
        let is_kept = found.is_kept();
        kept += usize::from(is_kept);
        overlooked += usize::from(!is_kept && found.is_fine);
        blamed += usize::from(is_kept && !found.is_fine);
        let counts = by_outer.entry(law.outer).or_default();
        counts[0] += usize::from(is_kept);
        counts[1] += 1;
        for (order, (error, _)) in found.worst.iter().enumerate() {
            kept_orders[order] += usize::from(*error <= BAR);
        }
        println!("{}", row(law, found));
    }
    for (outer, [kept, all]) in by_outer {
        println!("{outer:30} {kept} of {all}");
    }
    println!(
        "{kept} of {} kept, psi, psi', psi'' alone {kept_orders:?}; overlooked by the audit {overlooked}, \
         kept and not fine {blamed}",
        laws.len()
    );
    assert!(kept >= bounds.kept, "{kept}");
    assert!(overlooked <= bounds.overlooked, "{overlooked}");
}

/// A line of the table: the errors and the strains where they are, and the law.
fn row(law: &Nested, found: &Found) -> String {
    let mark = match (found.is_kept(), found.is_fine) {
        (true, true) => "  ",
        (true, false) => " ?",
        (false, true) => "*!",
        (false, false) => "* ",
    };
    let number = |x: f64| if x < 1e4 { format!("{x:.1}") } else { format!("{x:.0e}") };
    let worst = found.worst.map(|(error, e)| format!("{:>7} at {e:>8.0e}", number(error)));
    let lines: Vec<&str> = law.text.lines().filter(|line| line.contains(" = ")).collect();
    format!("{mark} {:3} {}  {}", law.seed, worst.join(" "), lines.join("; "))
}

fn look_at(law: &Nested) -> Found {
    let written = law.model.written(&law.values, Measure::Length);
    let strains = strains();
    let measure: Vec<f64> = strains.iter().map(|e| 1.0 + e).collect();
    let reference = vec![1.0; strains.len()];
    let outputs = Level::ALL.map(|level| {
        let mode = Mode::Jit(level);
        let compiled = law.model.compile(&law.values, mode, Form::Accurate).unwrap();
        let batch =
            Batch { measure: &measure, reference: &reference, change: &strains, fields: &[] };
        let out = compiled.kernels[0].derivatives(batch);
        [out.psi, out.dpsi, out.d2psi]
    });
    let mut worst = [(0.0, 0.0); 3];
    for (k, e) in strains.iter().enumerate() {
        let point = Point { measure: measure[k], reference: 1.0 };
        let Some(expected) = truth(&written, point) else { continue };
        let more = || {
            // The third derivative, from true values so near that they differ by a millionth.
            let by = libm::ldexp(*e, -20);
            let beside = Precise::<512>::line(measure[k], 1.0, by);
            let beside = written.evaluate(beside, Precise::constant(1.0)).rounded()[2];
            (beside - expected[2]) / by
        };
        for order in 0..3 {
            let errors = outputs.each_ref().map(|out| (out[order][k] - expected[order]).abs());
            // Not a number where one of them is none.
            let [strict, fast] = errors;
            let error = if fast > strict || fast.is_nan() { fast } else { strict } / U;
            if error == 0.0 {
                continue;
            }
            let size = expected[order].abs();
            let scale = if error <= BAR * size {
                size
            } else {
                size + (e * expected.get(order + 1).copied().unwrap_or_else(more)).abs()
            };
            worst[order] = larger(worst[order], error / scale, *e);
        }
    }
    let mut found = Found { worst, is_fine: audit_is_content(law) };
    // Two points of a regime may miss what twelve find, as many as the program takes.
    found.is_fine &=
        found.is_kept() || errors(law, BAR, 12).iter().all(|regime| is_within(&regime.worst));
    found
}

fn larger(worst: (f64, f64), error: f64, strain: f64) -> (f64, f64) {
    let error = if error.is_nan() { f64::INFINITY } else { error };
    if error > worst.0 { (error, strain) } else { worst }
}

/// What the audit says near rest. It works out what rounded inputs excuse, which takes seconds for a law
/// that is lost; so it is asked without excuses first. Errors of more than `HOPELESS` have none at a strain
/// that is drawn at random.
fn audit_is_content(law: &Nested) -> bool {
    let raw = errors(law, f64::INFINITY, 2);
    let strains = raw.into_iter().filter(|regime| regime.strain.is_some());
    if strains.flat_map(|regime| regime.raw).any(|error| error > HOPELESS) {
        return false;
    }
    errors(law, BAR, 2).iter().all(|regime| {
        regime.worst.iter().zip(&regime.at).all(|(error, at)| {
            let is_near = match at {
                Some(Place::Interaction(point)) => point.change().abs() <= NEAR,
                _ => true,
            };
            !is_near || *error <= BAR
        })
    })
}

/// The regimes of the audit of a law, with so many points each.
fn errors(law: &Nested, bar: f64, points: usize) -> Vec<Regime> {
    let settings = Settings { form: Form::Accurate, level: Level::Fast, points, bar };
    let (mut audits, _) = audit(&law.model, &law.values, &settings).unwrap();
    audits.swap_remove(0).regimes
}

fn is_within(worst: &[f64; 3]) -> bool {
    worst.iter().all(|error| *error <= BAR)
}

/// Strains of both signs from 1e-15 to a quarter, each the exact change of a stretch.
fn strains() -> Vec<f64> {
    let small = (0..30).map(|k| libm::pow(10.0, -15.0 + 14.0 * f64::from(k) / 30.0));
    let large = (1..=10).map(|k| 0.025 * f64::from(k) - 1e-3);
    let sizes = small.chain(large);
    sizes.flat_map(|e| [e, -e]).map(|e| (1.0 + e) - 1.0).filter(|e| *e != 0.0).collect()
}
