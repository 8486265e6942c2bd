//! What holds for every text: from reading it to running its machine code.
//!
//! Used by the property tests and, with more time, by the fuzz target `check_derive_compile`.

use piola_compiler::verify::same_bits;
use piola_compiler::{
    Batch, CompileError, Form, Kernel, Level, Mode, Model, ScalarEnergy, Setting, Specialised,
    Values, check, check_text, print,
};
use piola_grammar::{Diagnostic, parse};

/// How far a text came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It does not parse.
    Unreadable,
    /// The checker refuses it.
    Refused,
    /// Its defaults break its own conditions, or it is too large to compile.
    NotCompiled,
    /// It was compiled and evaluated in at least one dimension.
    Compiled,
}

/// Points of all kinds: at rest, stretched, collapsed, inverted, tiny, huge, no numbers at all.
/// The change is what a caller computes it to be, or something that does not fit the others.
const POINTS: [[f64; 3]; 14] = [
    [1.0, 1.0, 0.0],
    [1.5, 1.0, 0.5],
    [0.3, 0.7, (0.3 - 0.7) / 0.7],
    [1.000_000_1, 1.0, 1e-7],
    [0.0, 1.0, -1.0],
    [-0.0, 2.0, -1.0],
    [-2.0, 0.5, -5.0],
    [1e-310, 1.0, -1.0],
    [1e300, 1e-3, 1e303],
    [1e8, 1.0, 1e8 - 1.0],
    [-1e155, 3.0, -1e155],
    [f64::INFINITY, 1.0, f64::INFINITY],
    [f64::NAN, 1.0, f64::NAN],
    [2.0, 1.0, f64::NAN],
];

/// Follows a text as far as it goes and asserts what holds on the way.
///
/// # Panics
/// Where something does not hold, which is what a test wants.
pub(crate) fn follow(text: &str) -> Outcome {
    let model = match check_text(text) {
        Ok((_, model)) => model,
        Err(found) => {
            findings(text, &found);
            return if parse(text).is_err() { Outcome::Unreadable } else { Outcome::Refused };
        }
    };
    let lints = model.lint(true);
    if !lints.is_empty() {
        findings(text, &lints);
    }
    let mut outcome = Outcome::NotCompiled;
    for dimension in model.dimensions().collect::<Vec<_>>() {
        let symbolic = model.symbolic(dimension);
        if let Ok(symbolic) = placed(text, symbolic) {
            prints(&model, &symbolic, dimension);
        }
        let Some(values) = some_values(&model, dimension) else { continue };
        let Ok(specialised) = placed(text, model.specialise(&values)) else { continue };
        prints(&model, &specialised, dimension);
        evaluates(&model, &values);
        for energy in &specialised.energies {
            round_trip(&model, energy, dimension);
        }
        outcome = Outcome::Compiled;
    }
    outcome
}

/// Findings can be shown: they lie inside the text, between characters.
fn findings(text: &str, found: &[Diagnostic]) {
    assert!(!found.is_empty());
    for finding in found {
        assert!(text.get(finding.span.range()).is_some(), "{finding:?}");
        for note in &finding.notes {
            assert!(text.get(note.span.range()).is_some(), "{finding:?}");
        }
    }
}

/// An error of compilation is a limit, at a place in the text.
fn placed<T>(text: &str, result: Result<T, CompileError>) -> Result<T, CompileError> {
    if let Err(error) = &result {
        let CompileError::TooLarge { span, .. } = error else { panic!("{error}\n{text}") };
        assert!(text.get(span.range()).is_some_and(|place| !place.is_empty()), "{error:?}");
    }
    result
}

/// Defaults, and 1 for what has none.
pub(crate) fn some_values(model: &Model, dimension: usize) -> Option<Values> {
    let defaults = &model.variant(dimension)?.defaults;
    let missing = model.parameters().iter().zip(defaults).filter(|(_, value)| value.is_none());
    let settings: Vec<(String, Setting)> =
        missing.map(|(p, _)| (p.name.clone(), Setting::Number(1.0))).collect();
    model.values(dimension, &settings, Some(0.5)).ok()
}

/// Every printer comes to an end, and what it prints can be read.
fn prints(model: &Model, specialised: &Specialised, dimension: usize) {
    for energy in &specialised.energies {
        for root in 0..3 {
            let again = potential_of(model, energy, dimension, root);
            let ast = parse(&again).unwrap_or_else(|e| panic!("{e:#?}\n{again}"));
            check(&ast).unwrap_or_else(|e| panic!("{e:#?}\n{again}"));
        }
        let latex = print::latex(model, energy);
        assert!(balanced(&latex), "{latex}");
        print::graph_listing(model, energy.measure, &energy.graph, &energy.roots);
    }
    print::c_source(model, &specialised.energies, None);
}

/// Whether braces match, and every `\left` has its `\right`.
pub(crate) fn balanced(latex: &str) -> bool {
    let mut open = 0_i64;
    for c in latex.chars() {
        open += i64::from(c == '{') - i64::from(c == '}');
        if open < 0 {
            return false;
        }
    }
    let count = |what| latex.matches(what).count();
    open == 0
        && count(r"\left") == count(r"\right")
        && count(r"\begin{cases}") == count(r"\end{cases}")
}

/// A potential whose energy is psi, psi' or psi'' as it was printed.
pub(crate) fn potential_of(
    model: &Model,
    energy: &ScalarEnergy,
    dimension: usize,
    root: usize,
) -> String {
    let printed = print::text(model, energy);
    let lines: Vec<&str> = printed.lines().collect();
    let (named, roots) = lines.split_at(lines.len() - 3);
    let mut out = format!("potential again\ndimensions {dimension}\n");
    for parameter in model.parameters() {
        out.push_str(&format!("parameter {}\n", parameter.name));
    }
    for line in named {
        out.push_str(&format!("{line}\n"));
    }
    let (_, expression) = roots[root].split_once(" = ").unwrap();
    out.push_str(&format!("psi({}) = {expression}\n", energy.measure.symbol()));
    out
}

/// Machine code gives the interpreter's bits, at any point.
fn evaluates(model: &Model, values: &Values) {
    let compiled = model.compile(values, Mode::Jit(Level::Strict)).unwrap();
    let interpreted = model.compile(values, Mode::Interpreter).unwrap();
    let dual = model.compile(values, Mode::HyperDual).unwrap();
    assert_eq!(compiled.kernels.len(), interpreted.kernels.len());
    for (code, graph) in compiled.kernels.iter().zip(&interpreted.kernels) {
        let (machine, reference) = (run(code), run(graph));
        for (i, point) in POINTS.iter().enumerate() {
            let pairs = machine[i].iter().zip(&reference[i]);
            assert!(
                pairs.clone().all(|(x, y)| same_bits(*x, *y)),
                "psi({}) at {point:?}: {:?} {:?}",
                code.measure().symbol(),
                machine[i],
                reference[i]
            );
        }
    }
    dual.kernels.iter().for_each(|kernel| drop(run(kernel)));
}

/// psi, psi', psi'' at every point.
fn run(kernel: &Kernel) -> Vec<[f64; 3]> {
    let column = |k: usize| POINTS.iter().map(|p| p[k]).collect::<Vec<f64>>();
    let (measure, reference, change) = (column(0), column(1), column(2));
    let batch = Batch { measure: &measure, reference: &reference, change: &change };
    let out = kernel.derivatives(batch);
    (0..POINTS.len()).map(|i| [out.psi[i], out.dpsi[i], out.d2psi[i]]).collect()
}

/// What is printed means the same: read again, each root gives the same bits.
pub(crate) fn round_trip(model: &Model, energy: &ScalarEnergy, dimension: usize) {
    let original = interpret(energy);
    for root in 0..3 {
        let text = potential_of(model, energy, dimension, root);
        let again = check(&parse(&text).unwrap()).unwrap();
        let settings: Vec<(String, Setting)> = again
            .parameters()
            .iter()
            .map(|p| (p.name.clone(), Setting::Number(f64::MAX)))
            .collect();
        // Values were folded in before it was printed: parameters have no part in it.
        let values = again.values(dimension, &settings, Some(f64::MAX)).unwrap();
        // What was printed is in its accurate form already.
        let specialised = again.specialise_as(&values, Form::Textbook).unwrap();
        let [read] = specialised.energies.as_slice() else { panic!("{text}") };
        for (i, point) in POINTS.iter().enumerate() {
            let (x, y) = (original[i][root], interpret(read)[i][0]);
            assert!(same_bits(x, y), "at {point:?}: {x:e}, printed and read {y:e}\n{text}");
        }
    }
}

/// psi, psi', psi'' of a specialised energy at every point.
fn interpret(energy: &ScalarEnergy) -> Vec<[f64; 3]> {
    use piola_compiler::expression::interpret::Interpreter;
    let mut interpreter = Interpreter::<f64>::new();
    let at = |point: &[f64; 3]| {
        energy.run(&mut interpreter, &point[0], &point[1], &point[2]);
        energy.roots.map(|root| interpreter.number(root))
    };
    POINTS.iter().map(at).collect()
}
