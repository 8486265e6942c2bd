//! Printed C compiles and gives the same numbers: algebraic kernels to the last bit, others within
//! what the C library's elementary functions differ from `libm`.

#[path = "../support/library.rs"]
mod library;
#[path = "../support/machine.rs"]
mod machine;

mod bonds;
mod gathered;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use library::{Case, cases};
use piola_compiler::expression::power::PowerPlan;
use piola_compiler::expression::{ExprGraph, Node, Operator};
use piola_compiler::verify::sample::{Point, Random, points};
use piola_compiler::verify::{Columns, UNIT_ROUNDOFF, same_bits};
use piola_compiler::{
    CoupledBatch, Derivatives, Form, GradientBatch, GradientEnergyForms, Level, Measure, Mode,
    Model, ScalarEnergy, Setting, Values, check, print,
};
use piola_grammar::parse;

/// Points far from rest, and as many near it, for each energy.
const POINTS: usize = 60;

/// The strict level: no contraction, and a C99 compiler that may optimise.
const FLAGS: [&str; 5] = ["-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Werror"];

/// One function of the C program and what it must give.
struct Function {
    /// Of the case, for messages.
    name: String,
    /// In C.
    symbol: String,
    points: Vec<Point>,
    expected: Derivatives,
    algebraic: bool,
    /// The Seth-Hill exponent or 1: `(x^n - 1)/n` magnifies errors of `x^n`.
    exponent: f64,
}

#[test]
fn printed_c_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let folder = Folder::new("piola_c_source");
    let mut all: Vec<Case> = cases();
    all.extend(every_operation());
    let mut functions = Vec::new();
    let mut sources = Vec::new();
    for (number, case) in all.iter().enumerate() {
        // One C file per case, its functions named after the case.
        let specialised = case.model.specialise(&case.values).unwrap();
        let potential = case.model.name();
        let text = print::c_source(&case.model, &specialised.energies, None);
        let text = text.replace(&format!("void {potential}_"), &format!("void case{number}_"));
        let path = folder.0.join(format!("case{number}.c"));
        std::fs::write(&path, text).unwrap();
        sources.push(path);
        for energy in &specialised.energies {
            functions.push(function(number, case, energy));
        }
    }
    compare(&functions, &run(&folder, sources, &main_c(&functions)));
}

/// What a program of these files and a `main` prints.
fn run(folder: &Folder, mut sources: Vec<PathBuf>, main_c: &str) -> String {
    let main = folder.0.join("main.c");
    std::fs::write(&main, main_c).unwrap();
    sources.push(main);
    let program = folder.0.join("program");
    let mut compiler = Command::new("cc");
    compiler.args(FLAGS).args(&sources).arg("-o").arg(&program).arg("-lm");
    let built = compiler.output().unwrap();
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let ran = Command::new(&program).output().unwrap();
    assert!(ran.status.success());
    String::from_utf8(ran.stdout).unwrap()
}

/// An energy of the deformation gradient at places near rest and far from it.
struct Gradients {
    name: String,
    symbol: String,
    dimension: usize,
    /// `F`, `F - I` and `dF`, component after component.
    inputs: [Vec<f64>; 3],
    /// psi, P and dP of our kernel.
    expected: [Vec<f64>; 3],
    algebraic: bool,
}

/// Elementary functions differ from those of `libm` by an ulp; energies magnify that as they magnify
/// the rounding of their arguments. In 2^-53 of the norm; measured are 3 (glibc 2.36).
const GRADIENT_BAR: f64 = 16.0;

#[test]
fn printed_c_of_the_gradient_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let folder = Folder::new("piola_c_source_gradient");
    let (mut all, mut sources) = (Vec::new(), Vec::new());
    for (file, text) in library::files() {
        let model = check(&parse(&text).unwrap()).unwrap();
        for dimension in model.dimensions().filter(|_| model.has_gradient_energy()) {
            let unset = model.parameters().iter().enumerate().filter(|(i, _)| {
                model.variant(dimension).unwrap().defaults[*i].is_none_or(|x| x == 0.0)
            });
            let set = unset.map(|(_, p)| (p.name.clone(), Setting::Number(0.5)));
            let values = model.values(dimension, &set.collect::<Vec<_>>(), None).unwrap();
            let (forms, _) = model.specialise_gradient(&values, Form::Accurate).unwrap();
            let forms = forms.unwrap();
            let symbol = format!("case{}", all.len());
            let text = print::c_source(&model, &[], Some(&forms));
            let path = folder.0.join(format!("{symbol}.c"));
            let text = text.replace(&format!("void {}_F", model.name()), &format!("void {symbol}"));
            std::fs::write(&path, text).unwrap();
            sources.push(path);
            all.push(gradients(format!("{file} in {dimension}D"), symbol, &model, &values, &forms));
        }
    }
    assert!(all.len() >= 10, "{}", all.len());
    let printed = run(&folder, sources, &gradients_main(&all));
    let mut numbers =
        printed.lines().map(|bits| f64::from_bits(u64::from_str_radix(bits, 16).unwrap()));
    let (mut n_exact, mut worst) = (0, 0.0_f64);
    for case in &all {
        let found = case.expected.each_ref().map(|e| -> Vec<f64> {
            (0..e.len()).map(|_| numbers.next().expect("one line per number")).collect()
        });
        for (found, expected) in found.iter().zip(&case.expected) {
            if case.algebraic {
                assert!(
                    found.iter().zip(expected).all(|(x, y)| same_bits(*x, *y)),
                    "{}",
                    case.name
                );
                n_exact += 1;
                continue;
            }
            for p in 0..PLACES {
                let of =
                    |x: &[f64]| -> Vec<f64> { x.iter().skip(p).step_by(PLACES).copied().collect() };
                let (found, expected) = (of(found), of(expected));
                let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
                if !norm(&mut expected.iter().copied()).is_finite() {
                    // Exponentials overflow far from rest.
                    let found = norm(&mut found.iter().copied());
                    assert!(!found.is_finite(), "{} at place {p}", case.name);
                    continue;
                }
                let error = norm(&mut found.iter().zip(&expected).map(|(x, y)| x - y))
                    / (norm(&mut expected.iter().copied()) * UNIT_ROUNDOFF);
                assert!(error <= GRADIENT_BAR, "{} at place {p}: {error} u", case.name);
                worst = worst.max(error);
            }
        }
    }
    assert!(numbers.next().is_none());
    println!("{n_exact} arrays equal to the last bit, others within {worst:.1} u");
    assert!(n_exact >= 9 && worst > 0.0, "St Venant-Kirchhoff and stable energies are algebraic");
}

/// Places of each energy, as many near rest as far from it.
const PLACES: usize = 96;

fn gradients(
    name: String,
    symbol: String,
    model: &Model,
    values: &Values,
    forms: &GradientEnergyForms,
) -> Gradients {
    let d = values.dimension;
    let mut random = Random::new(0x6320_4600);
    let mut change = vec![0.0; d * d * PLACES];
    for p in 0..PLACES {
        // Far from rest: dominated by the diagonal, so never turned inside out.
        let size = if p % 2 == 0 { libm::pow(10.0, -((p / 2 % 12) as f64) - 1.0) } else { 0.4 };
        for k in 0..d * d {
            let stretch = if k / d == k % d && p % 2 == 1 { 2.0 } else { 0.0 };
            change[k * PLACES + p] = stretch + size * random.uniform(-1.0, 1.0);
        }
    }
    let rest = |k: usize| f64::from(u8::from(k / PLACES / d == k / PLACES % d));
    let gradient: Vec<f64> = change.iter().enumerate().map(|(k, h)| rest(k) + h).collect();
    let direction: Vec<f64> = change.iter().map(|_| random.uniform(-1.0, 1.0)).collect();
    let mode = Mode::Jit(Level::Strict);
    let kernel = model.compile(values, mode, Form::Accurate).unwrap().gradient.unwrap();
    let at = GradientBatch { n: PLACES, gradient: &gradient, change: &change, fields: &[] };
    let mut expected = [PLACES, d * d * PLACES, d * d * PLACES].map(|n| vec![0.0; n]);
    let [psi, stress, product] = &mut expected;
    kernel.evaluate(at, psi, stress);
    kernel.product(at, &direction, product);
    let near = forms.near.as_ref().expect("a form near rest");
    let algebraic = [&forms.far, near].iter().all(|form| has_only_exact_operations(&form.graph));
    let inputs = [gradient, change, direction];
    Gradients { name, symbol, dimension: d, inputs, expected, algebraic }
}

/// A program that runs both functions of every energy and prints the bits of psi, P and dP.
fn gradients_main(all: &[Gradients]) -> String {
    let mut out = String::from(
        "#include <stddef.h>\n#include <stdint.h>\n#include <stdio.h>\n#include <string.h>\n",
    );
    let _ = writeln!(
        out,
        "typedef void value(size_t, const double *, const double *, double *, double *);\n\
         typedef void product(size_t, const double *, const double *, const double *, double *);\n\
         static double in[3][9 * {PLACES}], out[3][9 * {PLACES}];\n\
         static void run(value *f, product *g, size_t m, const uint64_t *bits) {{\n\
         \x20 const size_t sizes[3] = {{{PLACES}, m, m}};\n\
         \x20 for (size_t k = 0; k < 3; k++) memcpy(in[k], bits + k * m, m * sizeof(double));\n\
         \x20 f({PLACES}, in[0], in[1], out[0], out[1]);\n\
         \x20 g({PLACES}, in[0], in[1], in[2], out[2]);\n\
         \x20 for (size_t k = 0; k < 3; k++)\n\
         \x20   for (size_t i = 0; i < sizes[k]; i++) {{\n\
         \x20     uint64_t u;\n\
         \x20     memcpy(&u, &out[k][i], sizeof u);\n\
         \x20     printf(\"%016llx\\n\", (unsigned long long)u);\n\
         \x20   }}\n\
         }}"
    );
    for case in all {
        let _ = writeln!(out, "value {0};\nproduct {0}_product;", case.symbol);
    }
    out.push_str("int main(void) {\n");
    for case in all {
        let bits: Vec<String> =
            case.inputs.iter().flatten().map(|x| format!("{:#x}u", x.to_bits())).collect();
        let _ = writeln!(
            out,
            "  {{ static const uint64_t bits[] = {{{}}};\n    run({1}, {1}_product, {2}, bits); }}",
            bits.join(","),
            case.symbol,
            case.dimension * case.dimension * PLACES
        );
    }
    out.push_str("  return 0;\n}\n");
    out
}

/// Reads one line of three numbers, as bits, per point.
fn compare(functions: &[Function], printed: &str) {
    let mut lines = printed.lines();
    let (mut n_exact, mut n_other, mut worst) = (0, 0, 0.0_f64);
    for f in functions {
        for (i, point) in f.points.iter().enumerate() {
            let line = lines.next().expect("one line per point");
            let found: Vec<f64> = line
                .split(' ')
                .map(|bits| f64::from_bits(u64::from_str_radix(bits, 16).unwrap()))
                .collect();
            let expected = [f.expected.psi[i], f.expected.dpsi[i], f.expected.d2psi[i]];
            for order in 0..3 {
                let (x, y) = (found[order], expected[order]);
                let place =
                    format!("{} {} order {order} at {point:?}: {x:e} {y:e}", f.name, f.symbol);
                if f.algebraic {
                    assert!(same_bits(x, y), "{place}");
                    n_exact += 1;
                    continue;
                }
                n_other += 1;
                if same_bits(x, y) {
                    continue;
                }
                let below = if order == 0 { 0.0 } else { expected[order - 1].abs() };
                let scale = y.abs() + below / point.measure.abs();
                let allowed = four_ulp(point.change(), f.exponent) * scale;
                let ratio = (x - y).abs() / (allowed + f64::MIN_POSITIVE);
                assert!(ratio <= 1.0, "{place}: {ratio} times what is allowed");
                worst = worst.max(ratio);
            }
        }
    }
    assert!(lines.next().is_none());
    println!(
        "{n_exact} values of algebraic kernels equal to the last bit; {n_other} values of others, \
         largest error over tolerance {worst:.2}"
    );
    assert!(n_exact > 10_000 && n_other > 10_000);
}

fn function(number: usize, case: &Case, energy: &ScalarEnergy) -> Function {
    let variant = case.model.variant(case.values.dimension).unwrap();
    let points = points(variant, energy.measure, &case.values, POINTS);
    let compiled =
        case.model.compile(&case.values, Mode::Jit(Level::Strict), Form::Accurate).unwrap();
    let kernel = compiled.kernels.iter().find(|k| k.measure() == energy.measure).unwrap();
    let expected = kernel.derivatives(Columns::new(&points).batch());
    let of_n = case.model.parameters().iter().position(|p| p.name == "n");
    Function {
        name: case.name.clone(),
        symbol: format!("case{number}_{}", energy.measure.symbol()),
        points,
        expected,
        algebraic: is_algebraic(energy),
        exponent: of_n.map_or(1.0, |i| case.values.parameters[i]),
    }
}

/// 4 units in the last place, magnified near rest as the formula magnifies the error of `ln(l/L)` or
/// of `(l/L)^n`.
fn four_ulp(change: f64, exponent: f64) -> f64 {
    let magnified = if exponent == 0.0 { 1.0 } else { 1.0 + 1.0 / (exponent * change).abs() };
    4.0 * f64::EPSILON * magnified
}

/// Whether only operations occur that every IEEE 754 system rounds alike.
fn is_algebraic(energy: &ScalarEnergy) -> bool {
    has_only_exact_operations(&energy.graph)
}

fn has_only_exact_operations(graph: &ExprGraph) -> bool {
    !graph.nodes().any(|(_, node)| match node {
        Node::Unary(function, _) => function.libm().is_some(),
        Node::Binary(operator, ..) => operator == Operator::Power,
        Node::PowerConstant(_, bits) => {
            matches!(PowerPlan::new(f64::from_bits(bits)), PowerPlan::General(_))
        }
        _ => false,
    })
}

/// Potentials that together hold every algebraic operation, every number that is hard to print, and
/// every function of the C library.
fn every_operation() -> Vec<Case> {
    let algebraic = "\
        k = if not (l > 2*L) and l/L < 0.9 or l == L then 5e-324*1e300*1e20 else 1/3\n\
        psi(l) = min(l, 2*L, 1.7) - max(-l, k, 0.1)*sign(l - L) + abs(l - 1.5*L)^1.5\n\
        psi(l) = sqrt(l)^-3 + (l/L)^-0.5 + (if l > 1e300 then 1/0 else -(0/0)*0)*0\n\
        psi(v) = min(v, V)/max(v, -V) + sqrt(v) + 123456789012345680000*v^-14.5\n";
    let functions = "\
        x = l/L\n\
        psi(l) = exp(-x) + ln(x) + log1p(x) + expm1(-x) + sin(x) + cos(x) + atan(x)\n\
        psi(l) = erf(x) + atan2(x, 2 - x)\n\
        psi(a) = sinh(A/(a + A)) + cosh(A/(a + A)) + tanh(a/A) + (a/A)^(-A/(a + A)) + (a/A)^0.3\n\
        domain l/L in (0.5, 3)\ndomain a/A in (0.5, 3)\n";
    let case = |name: &str, body: &str| {
        let model = check(&parse(&format!("potential {name}\n{body}")).unwrap()).unwrap();
        let values = model.values(3, &[], None).unwrap();
        Case { name: name.to_string(), model, values }
    };
    let cases = vec![case("every_algebraic_operation", algebraic), case("functions", functions)];
    let algebraic = cases[0].model.specialise(&cases[0].values).unwrap();
    assert!(algebraic.energies.iter().all(is_algebraic));
    assert_eq!(algebraic.energies[1].measure, Measure::Volume);
    cases
}

/// A program that runs every function at its points and prints the bits of what comes out.
fn main_c(functions: &[Function]) -> String {
    let mut out = String::from(
        "#include <stddef.h>\n#include <stdint.h>\n#include <stdio.h>\n#include <string.h>\n",
    );
    for f in functions {
        let _ = writeln!(
            out,
            "void {}(size_t, const double *, const double *, const double *, double *, double *, \
             double *);",
            f.symbol
        );
    }
    out.push_str(
        "typedef void kernel(size_t, const double *, const double *, const double *, double *,\n\
         \x20   double *, double *);\n\
         static void run(kernel *f, size_t n, const uint64_t *bits) {\n\
         \x20 double in[3][1024], out[3][1024];\n\
         \x20 for (size_t k = 0; k < 3; k++) memcpy(in[k], bits + k * n, n * sizeof(double));\n\
         \x20 f(n, in[0], in[1], in[2], out[0], out[1], out[2]);\n\
         \x20 for (size_t i = 0; i < n; i++)\n\
         \x20   for (size_t k = 0; k < 3; k++) {\n\
         \x20     uint64_t u;\n\
         \x20     memcpy(&u, &out[k][i], sizeof u);\n\
         \x20     printf(\"%016llx%c\", (unsigned long long)u, k < 2 ? ' ' : '\\n');\n\
         \x20   }\n\
         }\n\
         int main(void) {\n",
    );
    for f in functions {
        assert!(f.points.len() <= 1024);
        let mut bits = Vec::new();
        bits.extend(f.points.iter().map(|p| p.measure.to_bits()));
        bits.extend(f.points.iter().map(|p| p.reference.to_bits()));
        bits.extend(f.points.iter().map(|p| p.change().to_bits()));
        let bits: Vec<String> = bits.iter().map(|b| format!("{b:#x}u")).collect();
        let _ = writeln!(
            out,
            "  {{ static const uint64_t bits[] = {{{}}};\n    run({}, {}, bits); }}",
            bits.join(","),
            f.symbol,
            f.points.len()
        );
    }
    out.push_str("  return 0;\n}\n");
    out
}

/// A folder of one's own, gone at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Energies of several measures: `measures`, `reference`, `change` and a direction, measure after measure.
#[test]
fn printed_c_of_several_measures_gives_the_same_numbers() {
    if !machine::has_c_compiler() {
        return;
    }
    let text = "potential p\npsi(a, l1) = (a/A - 1)^2*(l1/L1)^3/(1 + a*l1)
psi(v, a1, l6) = abs(v)/V*(a1/A1 - 1)^2*sqrt(l6)";
    let model = check(&parse(text).unwrap()).unwrap();
    let values = model.values(3, &[], None).unwrap();
    let compiled = model.compile(&values, Mode::Jit(Level::Strict), Form::Accurate).unwrap();
    assert_eq!(compiled.coupled.len(), 2);
    for kernel in &compiled.coupled {
        let (form, _) = model.specialise_coupled(&values, kernel.clique(), Form::Accurate).unwrap();
        let form = form.unwrap();
        assert!(has_only_exact_operations(&form.density.graph));
        let (m, n) = (kernel.variables().len(), 7);
        let mut random = Random::new(0x0f_ac_e5);
        let mut numbers =
            |low, high| -> Vec<f64> { (0..m * n).map(|_| random.uniform(low, high)).collect() };
        let (reference, change) = (numbers(0.5, 2.0), numbers(-0.3, 0.3));
        let direction = numbers(-1.0, 1.0);
        let variables: Vec<f64> =
            reference.iter().zip(&change).map(|(rest, e)| rest * (1.0 + e)).collect();
        let at = CoupledBatch {
            n,
            variables: &variables,
            reference: &reference,
            change: &change,
            fields: &[],
        };
        let (mut psi, mut gradient, mut product) =
            (vec![0.0; n], vec![0.0; m * n], vec![0.0; m * n]);
        kernel.evaluate(at, &mut psi, &mut gradient);
        kernel.product(at, &direction, &mut product);
        let name = format!("p_{}", kernel.clique().interaction());
        let folder = Folder::new(&format!("piola_c_source_{name}"));
        let source = print::c_source(&model, &[], None);
        let source = source + &print::coupled_c(&model, kernel.clique(), &form);
        let path = folder.0.join("energies.c");
        std::fs::write(&path, source).unwrap();
        let arrays = [&variables, &reference, &change, &direction].map(|array| {
            let numbers: Vec<String> = array.iter().map(|x| format!("{x:?}")).collect();
            format!("{{{}}}", numbers.join(","))
        });
        let main = several_main(&name, m * n, n, &arrays);
        let printed = run(&folder, vec![path], &main);
        let found = printed.lines().map(|bits| u64::from_str_radix(bits, 16).unwrap());
        let expected = [psi, gradient, product].concat();
        assert!(found.eq(expected.iter().map(|x| x.to_bits())), "{name}");
    }
}

/// A program that runs both functions of an energy and prints the bits of psi, gradient and product.
fn several_main(name: &str, all: usize, n: usize, arrays: &[String; 4]) -> String {
    let [m, rest, change, direction] = arrays;
    format!(
        "#include <stddef.h>\n#include <stdint.h>\n#include <stdio.h>\n#include <string.h>\n\
         void {name}(size_t, const double *, const double *, const double *, double *, double *);\n\
         void {name}_product(size_t, const double *, const double *, const double *, const double *, \
         double *);\n\
         int main(void) {{\n\
         \x20 static const double m[] = {m}, r[] = {rest}, e[] = {change}, d[] = {direction};\n\
         \x20 static double out[{n} + 2 * {all}];\n\
         \x20 {name}({n}, m, r, e, out, out + {n});\n\
         \x20 {name}_product({n}, m, r, e, d, out + {n} + {all});\n\
         \x20 for (size_t i = 0; i < {n} + 2 * {all}; i++) {{\n\
         \x20   uint64_t u;\n\
         \x20   memcpy(&u, &out[i], sizeof u);\n\
         \x20   printf(\"%016llx\\n\", (unsigned long long)u);\n\
         \x20 }}\n\
         \x20 return 0;\n\
         }}\n"
    )
}
