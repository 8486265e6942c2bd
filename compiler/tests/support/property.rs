//! What holds for every text: from reading it to running its machine code.
//!
//! Used by the property tests and, with more time, by the fuzz target `check_derive_compile`.

#[path = "dissipation.rs"]
mod dissipation;
#[path = "functions.rs"]
mod functions;
#[path = "held.rs"]
mod held;
#[path = "noise.rs"]
mod noise;

use piola_compiler::point::NEAR;
use piola_compiler::verify::sample::{Point, Random};
use piola_compiler::verify::{Columns, same_bits};
use piola_compiler::{
    Batch, CompileError, Compiled, Form, GradientEnergyForms, Kernel, Kind, Level, Mode, Model,
    ScalarEnergy, Setting, Specialised, Values, check, check_text, print,
};
use piola_grammar::generate::potential_text;
use piola_grammar::{Diagnostic, parse};

pub(crate) use held::Held;
use held::{OfGradient, OfMeasure, hold};

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

/// What a fuzzer's bytes are: the first one chooses, the rest is taken as text, or as the choices of
/// the program generator, whose programs must all parse.
///
/// # Panics
/// As for [`follow`].
pub(crate) fn input(bytes: &[u8]) -> (Outcome, Held) {
    let Some((&choice, rest)) = bytes.split_first() else {
        return (Outcome::Unreadable, Held::default());
    };
    if choice % 2 == 0 {
        return follow(&String::from_utf8_lossy(rest));
    }
    let text = potential_text(rest);
    let (outcome, held) = follow(&text);
    assert_ne!(outcome, Outcome::Unreadable, "{text}");
    (outcome, held)
}

/// Follows a text as far as it goes and asserts what holds on the way.
///
/// # Panics
/// Where something does not hold, which is what a test wants.
pub(crate) fn follow(text: &str) -> (Outcome, Held) {
    let mut held = Held::default();
    let model = match check_text(text) {
        Ok((_, model)) => model,
        Err(found) => {
            findings(text, &found);
            let unreadable = parse(text).is_err();
            return (if unreadable { Outcome::Unreadable } else { Outcome::Refused }, held);
        }
    };
    let lints = model.lint(true);
    if !lints.is_empty() {
        findings(text, &lints);
    }
    let mut outcome = Outcome::NotCompiled;
    for dimension in model.dimensions().collect::<Vec<_>>() {
        if let Ok(symbolic) = placed(text, model.symbolic(dimension)) {
            prints(&model, &symbolic, dimension);
        }
        if let Ok(Some(symbolic)) = placed(text, model.symbolic_gradient(dimension)) {
            prints_gradient(&model, &symbolic);
        }
        let Some(values) = some_values(&model, dimension) else { continue };
        let Ok(specialised) = placed(text, model.specialise(&values)) else { continue };
        prints(&model, &specialised, dimension);
        evaluates(&model, &values);
        // Nothing of them but `d` is another in the plane.
        if Some(dimension) == model.dimensions().last() {
            held.add(functions::follow(text, &model, &values).as_functions());
        }
        held.add(holds(&model, &values, &specialised));
        for energy in &specialised.energies {
            round_trip(&model, energy, dimension);
        }
        let gradient = model.specialise_gradient(&values, Form::Accurate);
        let Ok((forms, dropped)) = placed(text, gradient) else { continue };
        if let Some(forms) = &forms {
            prints_gradient(&model, forms);
            held.add(holds_gradient(&model, &values, forms, dropped.is_empty()));
        }
        if forms.is_some() || !specialised.energies.is_empty() {
            outcome = Outcome::Compiled;
        }
    }
    (outcome, held)
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

/// The same for the energy of the deformation gradient, whose text is not read again.
fn prints_gradient(model: &Model, forms: &GradientEnergyForms) {
    assert!(!print::gradient_text(model, forms).is_empty());
    let latex = print::gradient_latex(model, forms);
    assert!(balanced(&latex), "{latex}");
    print::gradient_listing(model, forms);
    print::c_source(model, &[], Some(forms));
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

/// Energies of other kinds may be too large to be compiled.
fn of_measures(model: &Model, values: &Values, mode: Mode) -> Compiled {
    model.compile_only(&[Kind::Measures], values, mode, Form::Accurate).unwrap()
}

/// Machine code gives the interpreter's bits, at any point.
fn evaluates(model: &Model, values: &Values) {
    let compiled = of_measures(model, values, Mode::Jit(Level::Strict));
    let interpreted = of_measures(model, values, Mode::Interpreter);
    let dual = of_measures(model, values, Mode::HyperDual);
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

/// Places where compiled energies are held against what was written: stretches and sizes at rest.
/// At rest the size is not 1, which would hide powers of it; near rest strains are exact.
const PLACES: [[f64; 2]; 9] = [
    [0.25, 0.7],
    [0.81, 2.3],
    [1.0 - 1.0 / 256.0, 1.5],
    [1.0, 0.7],
    [1.0 + 1.0 / 4096.0, 1.25],
    [1.23, 0.4],
    [2.9, 1.3],
    [-0.6, 1.7],
    [0.0, 0.9],
];

/// Machine code gives what was written, and no numbers where that is none.
fn holds(model: &Model, values: &Values, specialised: &Specialised) -> Held {
    let points =
        PLACES.map(|[stretch, reference]| Point { measure: stretch * reference, reference });
    let mut held = Held::default();
    for level in Level::ALL {
        let kernels = of_measures(model, values, Mode::Jit(level)).kernels;
        for (kernel, energy) in kernels.iter().zip(&specialised.energies) {
            let measure = energy.measure;
            let symbol = measure.symbol();
            let whole = specialised.dropped.iter().all(|dropped| dropped.argument != symbol);
            let mut compare = |kernel: &Kernel, energy, written: &_, points: &[Point]| {
                let out = kernel.derivatives(Columns::new(points).batch());
                for (i, &point) in points.iter().enumerate() {
                    let found = [out.psi[i], out.dpsi[i], out.d2psi[i]];
                    match hold(&OfMeasure { energy, written, point }, found, whole) {
                        Ok(more) => held.add(more),
                        Err(what) => panic!("psi({symbol}) at {point:?}, {level:?}: {what}"),
                    }
                }
            };
            let written = model.written(values, measure);
            compare(kernel, energy, &written, &points);
            if let Some((kernel, energy)) = kernel.squared().zip(model.squared(values, measure)) {
                compare(kernel, &energy, &written.of_square(), &points.map(Point::squared));
            }
        }
    }
    held
}

/// Sizes of `F - I`: at rest, near it, and where the form as written is evaluated.
const SIZES: [f64; 6] = [0.0, 1e-3, 0.05, 0.2, 0.5, 1.2];

/// Machine code of an energy of the deformation gradient gives the interpreter's bits and what was
/// written.
fn holds_gradient(
    model: &Model,
    values: &Values,
    forms: &GradientEnergyForms,
    whole: bool,
) -> Held {
    let d = values.dimension;
    let variant = model.variant(d).unwrap();
    let written = model.written_gradient(values);
    let kernel = |mode| {
        let compiled = model.compile_only(&[Kind::Gradient], values, mode, Form::Accurate);
        compiled.unwrap().gradient.unwrap()
    };
    let interpreted = kernel(Mode::Interpreter);
    let mut held = Held::default();
    for level in Level::ALL {
        let kernel = kernel(Mode::Jit(level));
        let mut random = Random::new(d as u64);
        for size in SIZES {
            // Multiples of 2^-20: F is exact, and products with D have few digits.
            let mut tensor = |size: f64| -> Vec<f64> {
                let component =
                    |_| (random.uniform(-size, size) * 1_048_576.0).round() / 1_048_576.0;
                (0..d * d).map(component).collect()
            };
            let (change, direction) = (tensor(size), tensor(1.0));
            let near = change.iter().all(|h| h.abs() < NEAR);
            let form = forms.near.as_ref().filter(|_| near).unwrap_or(&forms.far);
            let [change, direction] = [&change[..], &direction[..]];
            let place = |kernel| OfGradient {
                variant,
                values,
                kernel,
                form,
                written: &written,
                change,
                direction,
            };
            let found = place(&kernel).compiled();
            if level == Level::Strict {
                let expected = place(&interpreted).compiled();
                let same = found.iter().zip(&expected).all(|(x, y)| same_bits(*x, *y));
                assert!(same, "psi(F) at I + {change:?}: {found:?} {expected:?}");
            }
            match hold(&place(&kernel), found, whole) {
                Ok(more) => held.add(more),
                Err(what) => {
                    panic!("psi(F) at I + {change:?} along {direction:?}, {level:?}: {what}")
                }
            }
        }
    }
    held
}

/// psi, psi', psi'' at every point.
fn run(kernel: &Kernel) -> Vec<[f64; 3]> {
    let column = |k: usize| POINTS.iter().map(|p| p[k]).collect::<Vec<f64>>();
    let (measure, reference, change) = (column(0), column(1), column(2));
    let batch = Batch { measure: &measure, reference: &reference, change: &change, fields: &[] };
    let out = kernel.derivatives(batch);
    (0..POINTS.len()).map(|i| [out.psi[i], out.dpsi[i], out.d2psi[i]]).collect()
}

/// What is printed means the same: read again, each root gives the same bits.
pub(crate) fn round_trip(model: &Model, energy: &ScalarEnergy, dimension: usize) {
    let original = interpret(energy);
    for root in 0..3 {
        let text = potential_of(model, energy, dimension, root);
        let again =
            check(&parse(&text).unwrap()).unwrap_or_else(|found| panic!("{found:?}\n{text}"));
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
