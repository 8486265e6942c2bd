//! The fast level's functions against numbers of 192 digits, and both levels on a processor that has
//! neither AVX nor fma.

use super::CompiledKernel;
use super::code::{described, isa};
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::real::Real;
use crate::expression::{Function, Operator};
use crate::test_support::{model, values};
use crate::{Batch, Form, Level, Order, Outputs};

type Exact = Precise<BITS>;

const BITS: usize = 192;

/// Largest error of an inlined function in units in the last place.
const BAR: f64 = 2.0;

/// `psi` as written, compiled for this computer or for the least one of its kind.
fn compiled(psi: &str, level: Level, native: bool) -> CompiledKernel {
    let model = model(&format!("potential p\npsi(l) = {psi}"));
    let specialised = model.specialise_as(&values(&model, 3, &[]), Form::Textbook).unwrap();
    CompiledKernel::with_isa(&specialised.energies[0], level, isa(native).unwrap()).unwrap()
}

/// psi for every pair of `l` and `L`.
fn run(kernel: &CompiledKernel, pairs: &[(f64, f64)]) -> Vec<f64> {
    let (measure, reference): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
    let mut psi = vec![0.0; pairs.len()];
    let batch = Batch { measure: &measure, reference: &reference, change: &measure, fields: &[] };
    let out = Outputs { psi: &mut psi, dpsi: &mut [], d2psi: &mut [] };
    kernel.evaluate(batch, Order::Energy, out);
    psi
}

/// The error in units in the last place of the true value; 0 where that is beyond normal numbers.
fn error(found: f64, truth: &Exact) -> f64 {
    let value = truth.rounded()[0];
    let Some([exact, ..]) = truth.parts().filter(|_| value.is_normal()) else { return 0.0 };
    assert!(found.is_finite(), "a normal value is found as a number");
    let difference = Real::from(found) - exact;
    let spacing = value.abs().next_up() - value.abs();
    difference.to_f64().abs() / spacing
}

/// Largest error over the pairs, on both processors.
fn largest_error(psi: &str, pairs: &[(f64, f64)], truth: impl Fn(f64, f64) -> Exact) -> [f64; 2] {
    let truths: Vec<Exact> = pairs.iter().map(|&(x, y)| truth(x, y)).collect();
    [true, false].map(|native| {
        let found = run(&compiled(psi, Level::Fast, native), pairs);
        let errors = found.iter().zip(&truths).map(|(found, truth)| error(*found, truth));
        let largest = errors.zip(pairs).max_by(|x, y| x.0.total_cmp(&y.0)).expect("some pairs");
        println!("{psi}: {:.3} ulp at {:?}, native {native}", largest.0, largest.1);
        largest.0
    })
}

/// Numbers that spread over a decade, and over pieces of the table, without a pattern.
fn spread(from: f64, to: f64, n: usize) -> impl Iterator<Item = f64> {
    (0..n).map(move |k| {
        let part = (k as f64 * 0.618_033_988_749_894_9).fract();
        from * libm::pow(to / from, part)
    })
}

/// Positive numbers by decades.
fn decades(least: i32, most: i32, each: usize) -> Vec<f64> {
    let power = |k: i32| libm::pow(10.0, f64::from(k));
    (least..most).flat_map(|k| spread(power(k), power(k + 1), each)).collect()
}

fn both_signs(sizes: Vec<f64>) -> Vec<f64> {
    sizes.iter().flat_map(|x| [*x, -x]).collect()
}

fn alone(numbers: Vec<f64>) -> Vec<(f64, f64)> {
    numbers.into_iter().map(|x| (x, 1.0)).collect()
}

fn holds(function: Function, numbers: Vec<f64>) {
    let psi = format!("{}(l)", function.name());
    let truth = |x: f64, _| Exact::unary(function, Exact::constant(x));
    for error in largest_error(&psi, &alone(numbers), truth) {
        assert!(error > 0.4 && error <= BAR, "{psi}: {error}");
    }
}

#[test]
fn exponentials() {
    let mut numbers = both_signs(decades(-20, 2, 12));
    numbers.extend(both_signs(spread(100.0, 709.7, 150).collect()));
    // Halfway between the multiples of ln(2), where the reduced argument is largest.
    numbers.extend((-500..500).map(|k| (f64::from(k) + 0.5) * std::f64::consts::LN_2 / 2.0));
    numbers.extend(both_signs(spread(0.3, 1.1, 600).collect()));
    holds(Function::Exp, numbers.clone());
    holds(Function::Expm1, numbers);
}

#[test]
fn logarithms() {
    let mut numbers = decades(-307, 308, 2);
    // Around 1, and the whole table with its edges.
    numbers.extend(both_signs(decades(-16, -2, 12)).into_iter().map(|e| 1.0 + e));
    numbers.extend(spread(0.4, 3.0, 1000));
    numbers.extend((0..=128_u64).flat_map(|piece| {
        let edge = f64::from_bits(super::log_table::FIRST + (piece << 45));
        [edge, edge.next_down(), edge.next_up()]
    }));
    holds(Function::Ln, numbers);
}

#[test]
fn logarithms_near_one() {
    let mut numbers = both_signs(decades(-300, -1, 1));
    numbers.extend(decades(-1, 300, 1));
    numbers.extend(spread(0.001, 3.0, 1000));
    numbers.extend(spread(0.01, 1.0, 1000).map(|x| x - 1.0));
    numbers.extend((1..53).map(|k| f64::EPSILON * libm::pow(2.0, f64::from(k)) - 1.0));
    holds(Function::Log1p, numbers.clone());
    // Below, the truth loses its digits as well.
    numbers.retain(|x| x.abs() > 1e-20);
    numbers.extend([0.3, 0.3_f64.next_up(), -0.3, -0.3_f64.next_down()]);
    holds(Function::Log1pmx, numbers);
}

/// Powers keep their digits however large the exponent of `exp(y ln(x))` is.
#[test]
fn powers() {
    let mut pairs = Vec::new();
    for (k, x) in decades(-300, 300, 1).into_iter().chain(spread(0.5, 2.0, 400)).enumerate() {
        let logarithm = libm::log(x);
        // The exponents of potentials, and those that bring the power near the ends of the range.
        let exponents = [2.7, -0.3, 1.0 / 3.0, 30.0, -10.0, 1e-3, 1e-300];
        let far = [700.0, -700.0, 300.0, -20.0, 3.0, 0.01].map(|z| z / logarithm);
        pairs.push((x, exponents[k % exponents.len()]));
        pairs.push((x, far[k % far.len()]));
        let e = libm::pow(10.0, -((k % 16) as f64));
        pairs.extend([(1.0 + e, 2.7), (1.0 - 0.5 * e, 200.0 / (1.0 + 1e3 * e))]);
    }
    let truth = |x: f64, y| Exact::binary(Operator::Power, Exact::constant(x), Exact::constant(y));
    for error in largest_error("l^L", &pairs, truth) {
        assert!(error > 0.4 && error <= BAR, "{error}");
    }
}

/// Functions that are called at both levels keep the digits of `libm`.
#[test]
fn error_functions_and_angles() {
    let mut numbers = both_signs(decades(-300, 0, 1));
    numbers.extend(both_signs(spread(0.01, 6.5, 1500).collect()));
    let truth = |x: f64, _| Exact::unary(Function::Erf, Exact::constant(x));
    for error in largest_error("erf(l)", &alone(numbers), truth) {
        assert!(error > 0.4 && error < 1.0, "{error}");
    }
    let sizes = both_signs(decades(-150, 150, 1));
    let mut pairs: Vec<(f64, f64)> =
        sizes.iter().zip(sizes.iter().skip(7)).map(|(x, y)| (*x, *y)).collect();
    let near = both_signs(spread(0.01, 20.0, 300).collect());
    pairs.extend(near.iter().zip(near.iter().rev()).flat_map(|(x, y)| [(*x, *y), (*y, 1.0)]));
    let truth = |y: f64, x| Exact::binary(Operator::Atan2, Exact::constant(y), Exact::constant(x));
    for error in largest_error("atan2(l, L)", &pairs, truth) {
        assert!(error > 0.4 && error < 1.5, "{error}");
    }
}

/// Powers of one base whose exponents differ by 1 are made from each other.
#[test]
fn neighbouring_powers() {
    let pairs = alone(decades(-15, 15, 20));
    let truth = |x: f64, _| {
        let power = |c| Exact::power_constant(Exact::constant(x), c);
        Exact::binary(Operator::Multiply, power(2.7), power(1.7000000000000002))
    };
    for error in largest_error("l^2.7*l^(2.7 - 1)", &pairs, truth) {
        assert!(error > 0.4 && error <= 2.0 * BAR, "{error}");
    }
}

fn same_bits(x: f64, y: f64) -> bool {
    x.to_bits() == y.to_bits() || (x.is_nan() && y.is_nan())
}

/// Where an inlined function has no result of its own, the entry takes the strict level's; and it does
/// so alone: the entry beside it keeps its bits.
#[test]
fn special_arguments() {
    let special = [
        0.0,
        -0.0,
        -1.0,
        -2.5,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
        5e-324,
        -1e-310,
        709.9,
        -745.0,
        -800.0,
        1e301,
    ];
    let names = ["exp", "expm1", "ln", "log1p", "log1pmx"].map(|name| format!("{name}(l)"));
    for psi in names.into_iter().chain(["l^L".to_string(), "l^2.7".to_string()]) {
        for native in [true, false] {
            let [strict, fast] = Level::ALL.map(|level| compiled(&psi, level, native));
            let usual = (0.7, 1.3);
            let alone = run(&fast, &[usual])[0];
            for x in special {
                for y in if psi.contains('L') { &special[..] } else { &[1.0] } {
                    let y = *y;
                    let [expected, found] = [&strict, &fast].map(|k| run(k, &[(x, y)])[0]);
                    // Small numbers are no exception: they are their own expm1 and log1p.
                    let close = (found - expected).abs() <= 1e-15 * expected.abs();
                    let same = same_bits(found, expected) || (expected != 0.0 && close);
                    assert!(same, "{psi} at {x:e}, {y:e}: {found:e}, {expected:e}");
                    for pairs in [[(x, y), usual], [usual, (x, y)]] {
                        let pair = run(&fast, &pairs);
                        let k = usize::from(pairs[1] != usual);
                        assert!(same_bits(pair[k], found) && pair[1 - k] == alone, "{psi} {x:e}");
                    }
                }
            }
        }
    }
}

/// The strict level needs no more than every processor of the kind has, and gives the same bits there.
#[test]
fn the_least_processor_gives_the_same_bits() {
    let psi = [
        "if l < L then ln(l) else sin(l)*sign(l - 2)",
        "min(max(l, 0.5), L)^2.7 + sqrt(abs(l)) + (if not (l < 2) or L == 1 then 1/l else tanh(l))",
        "if l < 1 and L > 1 then -l^(-3/2) else expm1(l)",
    ];
    let pairs: Vec<(f64, f64)> =
        both_signs(decades(-3, 3, 9)).into_iter().map(|x| (x, 2.0 + x)).collect();
    for psi in psi {
        let [native, least] = [true, false].map(|n| run(&compiled(psi, Level::Strict, n), &pairs));
        assert!(native.iter().zip(&least).all(|(x, y)| same_bits(*x, *y)), "{psi}");
    }
}

#[test]
fn processors_are_told_apart_by_what_kernels_may_have_of_them() {
    let [own, again, least] = [true, true, false].map(|native| described(&*isa(native).unwrap()));
    assert_eq!(own, again);
    let has = |target: &str, what: &str| target.split(' ').any(|one| one == what);
    assert!(least.split(' ').all(|what| has(&own, what)), "{own}: {least}");
    #[cfg(target_arch = "x86_64")]
    {
        assert_eq!(has(&own, "has_fma"), std::is_x86_feature_detected!("fma"), "{own}");
        assert!(!has(&least, "has_fma"), "{least}");
    }
}
