//! Every limit is a typed error with its place, found in seconds on a small stack.
//!
//! The programs are as long as a file may be and built to be expensive: if a pass were quadratic or
//! recursive they would take minutes or overflow.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use piola_compiler::expression::graph::MAX_NODES;
use piola_compiler::specialise::MAX_OPERATIONS;
use piola_compiler::{CompileError, Form, Level, Mode, Model, Setting, check, print};
use piola_grammar::{MAX_BYTES, MAX_NESTING, parse};

/// Far above the 1 to 3 s that the slowest case takes on a slow machine.
const LONG: Duration = Duration::from_secs(60);

/// Runs on a stack of 2 MiB, as a test's thread has, and not for long.
fn on_a_small_stack<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let start = Instant::now();
    let thread = std::thread::Builder::new().stack_size(2 << 20).spawn(work).unwrap();
    let result = thread.join().unwrap();
    assert!(start.elapsed() < LONG, "{:?}", start.elapsed());
    result
}

fn model(text: &str) -> Model {
    assert!(text.len() <= MAX_BYTES);
    check(&parse(text).unwrap()).unwrap_or_else(|e| panic!("{:#?}", &e[..1]))
}

/// The code, the place and the number of the findings.
fn refused(text: String) -> (&'static str, String, usize) {
    on_a_small_stack(move || {
        assert!(text.len() <= MAX_BYTES);
        let found = match parse(&text) {
            Ok(ast) => check(&ast).expect_err("a limit is passed"),
            Err(found) => found,
        };
        let place = &text[found[0].span.range()];
        (found[0].code, place.chars().take(40).collect(), found.len())
    })
}

/// Compiles with every parameter 1 and prints in every way.
fn compiled(text: String) -> Result<Vec<usize>, CompileError> {
    on_a_small_stack(move || {
        let model = model(&text);
        let one = |name: &str| (name.to_string(), Setting::Number(1.0));
        let settings: Vec<_> = model.parameters().iter().map(|p| one(&p.name)).collect();
        let values = model.values(3, &settings, Some(1.0)).unwrap();
        model.compile(&values, Mode::Jit(Level::Strict), Form::Accurate)?;
        let specialised = model.specialise(&values)?;
        for energy in &specialised.energies {
            print::text(&model, energy);
            print::latex(&model, energy);
        }
        print::c_source(&model, &specialised.energies, None);
        Ok(specialised.energies.iter().map(|e| e.graph.len()).collect())
    })
}

/// Definitions `k0 = first`, `k1 = next(k0)`, ... and an energy of the last one.
fn chain(n: usize, first: &str, next: impl Fn(usize, &str) -> String) -> String {
    let mut text = format!("potential p\nparameter C\nk0 = {first}\n");
    for i in 1..n {
        let _ = writeln!(text, "k{i} = {}", next(i, &format!("k{}", i - 1)));
    }
    text + &format!("psi(l) = k{}\n", n - 1)
}

fn repeated(n: usize, part: &str, separator: &str) -> String {
    vec![part; n].join(separator)
}

fn joined(n: usize, separator: &str, part: impl Fn(usize) -> String) -> String {
    (0..n).map(part).collect::<Vec<_>>().join(separator)
}

#[test]
fn a_file_has_a_megabyte() {
    let text = format!("potential p\npsi(l) = l\n#{}", "x".repeat(MAX_BYTES));
    let found = parse(&text).unwrap_err();
    assert_eq!(found[0].code, "file-too-large");
}

#[test]
fn parentheses_nest_so_deep() {
    let nested = |n| format!("potential p\npsi(l) = {}l{}", "(".repeat(n), ")".repeat(n));
    assert_eq!(refused(nested(MAX_NESTING + 1)).0, "nesting-too-deep");
    assert_eq!(compiled(nested(MAX_NESTING)).unwrap(), [3]);
}

#[test]
fn a_row_of_200_000_terms_is_too_large_at_its_place() {
    let text = format!("potential p\npsi(l) = {}", repeated(200_000, "l", "+"));
    let (code, place, n) = refused(text);
    assert_eq!((code, n), ("too-large", 1));
    assert!(place.starts_with("l+l+l"), "{place}");
}

#[test]
fn a_chain_of_definitions_may_be_as_long_as_the_graph() {
    let sines = |n| chain(n, "l", |_, k| format!("sin({k})"));
    assert_eq!(compiled(sines(400)).unwrap().len(), 1);
    assert_eq!(refused(sines(MAX_NODES + 1)).0, "too-large");
    // It fits the graph of the energy, but not that of its derivatives.
    let Err(CompileError::TooLarge { limit, span, .. }) = compiled(sines(MAX_NODES - 10)) else {
        panic!("a limit is passed")
    };
    assert_eq!(limit, MAX_NODES);
    assert_eq!(&sines(MAX_NODES - 10)[span.range()], format!("k{}", MAX_NODES - 11));
}

#[test]
fn a_kernel_has_so_many_operations() {
    let sum =
        |n| format!("potential p\npsi(l) = {}", joined(n, " + ", |i| format!("exp({i}.5*l)")));
    let graph = compiled(sum(400)).unwrap();
    assert!((2800..=MAX_OPERATIONS).contains(&graph[0]), "{graph:?}");
    let text = sum(800);
    let Err(CompileError::TooLarge { limit, span, .. }) = compiled(text.clone()) else {
        panic!("a limit is passed")
    };
    assert_eq!(limit, MAX_OPERATIONS);
    assert!(text[span.range()].starts_with("exp(0.5*l) + "));
}

#[test]
fn what_is_shared_is_not_expanded() {
    // 2^99 terms and factors if written out.
    assert!(compiled(chain(100, "l/L", |_, k| format!("{k}*{k}"))).is_ok());
    assert!(compiled(chain(100, "l/L", |_, k| format!("{k} + {k}"))).is_ok());
    assert!(compiled(chain(100, "C*l/L", |_, k| format!("sqrt({k} + {k}/{k})"))).is_ok());
    let doubling = (1..60).fold("f0(x) = x + 1\n".to_string(), |text, i| {
        text + &format!("f{i}(x) = f{}(x + {i})*f{}(x - {i})\n", i - 1, i - 1)
    });
    assert_eq!(refused(format!("potential p\n{doubling}psi(l) = f59(l)")).0, "too-large");
}

#[test]
fn terms_with_zero_coefficients_are_found_in_one_pass() {
    let shared = joined(4000, " + ", |i| format!("C*l^{i}"));
    let text = format!("potential p\nparameter C\ns = {shared}\n{}", "psi(l)=s\n".repeat(90_000));
    on_a_small_stack(move || {
        let model = model(&text);
        let zero = [("C".to_string(), Setting::Number(0.0))];
        let values = model.values(3, &zero, None).unwrap();
        let specialised = model.specialise(&values).unwrap();
        assert_eq!((specialised.energies.len(), specialised.dropped.len()), (0, 1));
    });
}

#[test]
fn calls_are_bounded() {
    let deep = |n| {
        (1..n).fold("potential p\nf0(x) = x + 1\n".to_string(), |text, i| {
            text + &format!("f{i}(x) = f{}(x) + {i}\n", i - 1)
        }) + &format!("psi(l) = f{}(l)\n", n - 1)
    };
    assert!(compiled(deep(256)).is_ok());
    assert_eq!(refused(deep(3000)).0, "too-large");
    // Looking at the body once more for each call would take an hour.
    let body = repeated(150_000, "x", "+");
    let calls = joined(50_000, "+", |i| format!("f({i})"));
    assert_eq!(refused(format!("potential p\nf(x) = {body}\npsi(l) = {calls}")).0, "too-large");
    let many = joined(70_000, ",", |i| format!("x{i}"));
    let (code, place, _) = refused(format!("potential p\nf({many}) = x1\npsi(l) = l"));
    assert_eq!((code, place.as_str()), ("too-large", "x100"));
}

#[test]
fn parameters_are_counted() {
    let many = |n| {
        let lines = joined(n, "\n", |i| format!("parameter p{i}"));
        format!("potential p\n{lines}\npsi(l) = p{}*l", n - 1)
    };
    assert!(compiled(many(1000)).is_ok());
    let (code, place, _) = refused(many(1001));
    assert_eq!((code, place.as_str()), ("too-large", "p1000"));
}

#[test]
fn a_hundred_findings_are_enough() {
    let lines = |n, line: fn(usize) -> String| joined(n, "\n", line);
    let many = |lines: String| format!("potential p\nparameter C in m\n{lines}\npsi(l) = l");
    for (text, code) in [
        (many(lines(90_000, |_| "k = 1".to_string())), "duplicate-name"),
        (many(lines(60_000, |i| format!("k{i} = C+1"))), "dimension-mismatch"),
        (many(lines(60_000, |i| format!("k{i} = zz"))), "unknown-name"),
        (many(format!("k = {}", repeated(90_000, "paramatric", "+"))), "unknown-name"),
    ] {
        let (found, _, n) = refused(text);
        assert_eq!((found, n), (code, 100));
    }
}

#[test]
fn references_cancel_without_recursion_that_grows() {
    let text =
        format!("potential p\npsi(l) = {}*(l{})", repeated(9000, "L", "*"), "/L".repeat(9000));
    assert_eq!(compiled(text).unwrap(), [3]);
}

#[test]
fn a_horizon_that_is_needed_and_missing_is_named_at_its_energy() {
    let text = "potential p\npsi(a) = a\npsi(l) = l*delta\npsi(l) = l";
    let model = model(text);
    let values = model.values(3, &[], None).unwrap();
    let Err(CompileError::NoHorizon { argument, span }) =
        model.compile(&values, Mode::Jit(Level::Strict), Form::Accurate)
    else {
        panic!("the horizon is missing")
    };
    assert_eq!((argument.as_str(), &text[span.range()]), ("l", "l*delta"));
    let values = model.values(3, &[], Some(0.1)).unwrap();
    assert_eq!(
        model.compile(&values, Mode::Jit(Level::Strict), Form::Accurate).unwrap().kernels.len(),
        2
    );
}
