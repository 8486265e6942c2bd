//! Audits of generated potentials, and the numbers of any precision that they measure against: whatever
//! a program computes, none panics.

#[path = "support/audited.rs"]
mod audited;

use std::ops::Range;

use audited::{Seen, audited, evaluated, split};
use piola_compiler::verify::sample::Random;

/// Evaluates programs of so many bytes one after the other, and audits some; those that panic, by their
/// number.
fn follow(programs: u64, audits: u64, lengths: Range<u64>) -> (Seen, usize, Vec<u64>) {
    let (mut seen, mut n_points, mut panics) = (Seen::default(), 0, Vec::new());
    for number in 0..programs {
        let mut random = Random::new(number << 32);
        let length = lengths.start + random.bits() % (lengths.end - lengths.start);
        let bytes: Vec<u8> = (0..length).map(|_| random.bits() as u8).collect();
        let (numbers, text) = split(&bytes);
        // Every so many, evenly.
        let is_audited = (number + 1) * audits / programs > number * audits / programs;
        let found = std::panic::catch_unwind(|| {
            let seen = evaluated(&text, numbers);
            (seen, if is_audited { audited(&text) } else { 0 })
        });
        match found {
            Ok((more, points)) => {
                seen.add(more);
                n_points += points;
            }
            Err(_) => {
                println!("program {number} panics, as said above:\n{text}");
                panics.push(number);
            }
        }
    }
    println!("{seen:?}, {n_points} points of audits, panics {panics:?}");
    (seen, n_points, panics)
}

/// Expressions that are exactly 0 or 1 at rest, and ones whose binary exponents pass 2^63 or 2^20.
const EXTREME: [&str; 12] = [
    "ln(x)",
    "log1p(ln(x))",
    "x^0",
    "x^x",
    "exp(0*x)",
    "expm1(x - 1)",
    "cos(x - 1)",
    "(1 + ln(x))^x",
    "((((((x + 1)^4096)^4096)^4096)^4096)^4096)^4096",
    "((((((x + 1)^-4096)^4096)^4096)^4096)^4096)^4096",
    "((x + 1)^4096)^1024",
    "((x + 1)^-4096)^1024",
];

/// Functions of the `y` that an extreme expression is.
const OF_EXTREME: [&str; 33] = [
    "-y",
    "abs(y)",
    "sign(y)",
    "sqrt(y)",
    "exp(y)",
    "ln(y)",
    "log1p(y)",
    "expm1(y)",
    "log1pmx(y)",
    "sin(y)",
    "cos(y)",
    "tan(y)",
    "asin(y)",
    "acos(y)",
    "atan(y)",
    "sinh(y)",
    "cosh(y)",
    "tanh(y)",
    "erf(y)",
    "1/y",
    "y - 1",
    "y + 1/3",
    "y*y",
    "y/y",
    "y^0.5",
    "y^y",
    "2^y",
    "y^-3",
    "min(y, 1)",
    "max(y, x)",
    "atan2(y, x)",
    "atan2(1, y)",
    "if y > 1 then y else 1/y",
];

#[test]
fn functions_of_exact_and_of_extreme_results_do_not_panic() {
    let mut seen = Seen::default();
    for inner in EXTREME {
        for outer in OF_EXTREME {
            let psi = format!("{outer} + sqrt(1 + {outer})");
            let text = format!("potential p\nx = l/L\ny = {inner}\npsi(l) = {psi}\n");
            match std::panic::catch_unwind(|| evaluated(&text, [0.7, 0.9])) {
                Ok(more) => seen.add(more),
                Err(_) => panic!("this program panics, as said above:\n{text}"),
            }
        }
    }
    println!("{seen:?}");
    // None is right where there is none, or beyond 2^20.
    assert!(seen.differ == 0 && seen.agree > 3000, "{seen:?}");
}

#[test]
fn audits_of_generated_potentials_do_not_panic() {
    let (seen, n_points, panics) = follow(400, 4, 16..416);
    assert!(panics.is_empty(), "{panics:?}");
    let all = seen.agree + seen.differ + seen.doubtful + seen.none;
    assert!(2 * seen.agree > all && 100 * seen.differ < all, "{seen:?}");
    assert!(n_points > 50, "{n_points}");
}

/// Each audited whole, and short ones, of a declaration or two and an energy: those of some hundred bytes
/// take seconds each. `cargo test --release --workspace --test audited -- --ignored --nocapture`
#[test]
#[ignore = "two hours"]
fn audits_of_100_000_generated_potentials_do_not_panic() {
    let (seen, n_points, panics) = follow(100_000, 100_000, 16..72);
    assert!(panics.is_empty(), "{panics:?}");
    assert!(100 * seen.differ < seen.agree && n_points > 1_000_000, "{seen:?}, {n_points}");
}
