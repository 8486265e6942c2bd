//! Kernels that are functions of the squared measure: which energies have one, that it is the same
//! function, and how many of its digits are right.

#[path = "support/library.rs"]
mod library;

use piola_compiler::expression::number::Number;
use piola_compiler::expression::precise::Precise;
use piola_compiler::expression::{Function, Operator};
use piola_compiler::verify::sample::Point;
use piola_compiler::verify::truth::truth;
use piola_compiler::{
    Batch, Form, Kernel, Level, Measure, Mode, Model, Setting, Values, WrittenEnergy, check_text,
};

const U: f64 = f64::EPSILON / 2.0;
const STRICT: Mode = Mode::Jit(Level::Strict);

fn model(psi: &str) -> Model {
    check_text(&format!("potential p\nparameter n = 1\n{psi}\n")).unwrap().1
}

fn values(model: &Model, dimension: usize, n: f64) -> Values {
    model.values(dimension, &[("n".to_string(), Setting::Number(n))], None).unwrap()
}

fn kernel(psi: &str, dimension: usize, n: f64, mode: Mode) -> Kernel {
    let model = model(psi);
    model.compile(&values(&model, dimension, n), mode, Form::Accurate).unwrap().kernels.remove(0)
}

#[test]
fn even_energies_of_roots_have_one() {
    let even = [
        "psi(l) = l^2",
        "psi(l) = l*l",
        "psi(l) = l*L*l",
        "psi(l) = L*(l/L)^2",
        "psi(l) = l^4/L^3",
        "psi(l) = (3*l)^-2",
        "psi(l) = 1/(l*l)",
        "psi(l) = -l^2*l^2",
        "psi(l) = 1/2*L*(((l/L)^2 - 1)/2)^2",
        "psi(l) = ((l^2 - L^2)/(2*L^2))^2",
        "psi(l) = L*exp(-(l/L)^2)",
        "psi(l) = ln(l^2/L^2)^2",
        "psi(l) = sqrt(l^2 + L^2)",
        "psi(l) = (l^2)^1.3 + l^2/l^4",
        "psi(a) = 1/2*A*((a/A)^2 - 1)^2",
    ];
    for psi in even {
        assert!(kernel(psi, 3, 1.0, STRICT).squared().is_some(), "{psi}");
    }
    let not = [
        "psi(l) = l",
        "psi(l) = l^3",
        "psi(l) = l^2.5",
        "psi(l) = l^2 + l",
        "psi(l) = (l - L)^2",
        "psi(l) = (l/L - 1)^2",
        "psi(l) = ln(l/L)^2",
        "psi(l) = exp(l)",
        "psi(l) = abs(l)^2",
        "psi(l) = if l > 2*L then l^4 else l^2",
        "psi(l) = 2^l",
        // At rest both sides must be equal to the last bit.
        "psi(l) = if l^2 > L^2 then l^4 else l^2",
        "psi(l) = max(l^2, L^2)",
        // 0/0 at l = 0, which must stay so.
        "psi(l) = l/l",
        "psi(l) = l^3/l",
        "psi(v) = v^2",
    ];
    for psi in not {
        assert!(kernel(psi, 3, 1.0, STRICT).squared().is_none(), "{psi}");
    }
}

#[test]
fn values_of_parameters_decide() {
    let psi = "S(x) = if n == 0 then ln(x) else (x^n - 1)/n\npsi(l) = 1/2*L*S(l/L)^2";
    let is_even = |n: f64| kernel(psi, 3, n, STRICT).squared().is_some();
    for n in [2.0, -2.0, 4.0, 10.0, -30.0] {
        assert!(is_even(n), "{n}");
    }
    for n in [1.0, 2.7, 0.0, 0.5, -1.0, 3.0, 2.0 + 1e-15] {
        assert!(!is_even(n), "{n}");
    }
}

#[test]
fn signed_areas_and_slow_ways_have_none() {
    let psi = "psi(a) = a^2";
    assert!(kernel(psi, 2, 1.0, STRICT).squared().is_none(), "in the plane");
    assert!(kernel(psi, 3, 1.0, Mode::Interpreter).squared().is_some());
    assert!(kernel(psi, 3, 1.0, Mode::HyperDual).squared().is_none());
    let model = model(psi);
    let textbook = model.compile(&values(&model, 3, 1.0), STRICT, Form::Textbook).unwrap();
    assert!(textbook.kernels[0].squared().is_none());
}

/// psi and its derivatives at one place.
fn at(kernel: &Kernel, measure: f64, reference: f64, change: f64) -> [f64; 3] {
    let batch =
        Batch { measure: &[measure], reference: &[reference], change: &[change], fields: &[] };
    let out = kernel.derivatives(batch);
    [out.psi[0], out.dpsi[0], out.d2psi[0]]
}

#[test]
fn no_domain_is_widened() {
    let at_zero = |psi: &str| {
        let kernel = kernel(psi, 3, 1.0, STRICT);
        at(kernel.squared().unwrap(), 0.0, 4.0, -1.0)[0]
    };
    assert!(at_zero("psi(l) = l^2/l^4").is_nan(), "0/0 as for the length");
    assert!(at_zero("psi(l) = l^2*l^-2").is_nan(), "0*inf as for the length");
    assert_eq!(at_zero("psi(l) = 1/l^2"), f64::INFINITY);
    assert_eq!(at_zero("psi(l) = ln(l^2/L^2)"), f64::NEG_INFINITY);
}

/// An even energy of space with its values.
struct Even {
    name: String,
    model: Model,
    values: Values,
    measure: Measure,
}

impl Even {
    fn kernel(&self, mode: Mode) -> Kernel {
        let kernels = self.model.compile(&self.values, mode, Form::Accurate).unwrap().kernels;
        kernels.into_iter().find(|kernel| kernel.measure() == self.measure).unwrap()
    }
}

/// The even energies of the library, and some more.
fn even_energies() -> Vec<Even> {
    let mut found = Vec::new();
    let mut collect = |name: String, model: &Model, values: Values| {
        for measure in [Measure::Length, Measure::Area] {
            if model.squared(&values, measure).is_some() {
                let (model, values) = (model.clone(), values.clone());
                let name = format!("{name}, psi({})", measure.symbol());
                found.push(Even { name, model, values, measure });
            }
        }
    };
    for case in library::cases().into_iter().filter(|case| case.values.dimension == 3) {
        collect(case.name, &case.model, case.values);
    }
    let more = [
        "psi(l) = L*(L^2/l^2 + l^2/L^2 - 2)",
        "psi(l) = L*(exp(((l/L)^2 - 1)/2) - 1)^2",
        "psi(l) = L*((l/L)^2 - 1 - ln((l/L)^2))",
    ];
    for psi in more {
        let model = model(psi);
        let values = values(&model, 3, 1.0);
        collect(psi.to_string(), &model, values);
    }
    for name in ["firooz2023 in 3D, n = -2", "firooz2023 in 3D, n = 4", "miranda"] {
        assert!(found.iter().any(|even| even.name.starts_with(name)), "{name}");
    }
    found
}

/// Stretches near rest by decades, and far from it.
fn stretches() -> Vec<f64> {
    let strains = (2..=14).flat_map(|k| [1.1, 5.7].map(|x| x * libm::pow(10.0, f64::from(-k))));
    let near = strains.flat_map(|strain| [1.0 + strain, 1.0 - strain]);
    let far = (-12..=12).map(|k| 1.037 * libm::pow(10.0, f64::from(k) / 2.0));
    near.chain(far).collect()
}

/// Measures at rest: lengths of a structure and of an atom, or an area between atoms.
const REFERENCES: [f64; 3] = [0.9e5, 1.7e-10, 2.9e-20];

/// The true psi, dpsi/dq and d2psi/dq2 of the energy as written at `m = sqrt(q*M)`.
fn truth_by_squares(written: &WrittenEnergy, point: Point) -> Option<[f64; 3]> {
    let [q, reference] = [Precise::<512>::variable(point.measure), constant(point.reference)];
    let measure = Precise::unary(Function::Sqrt, Precise::binary(Operator::Multiply, q, reference));
    let psi = written.evaluate(measure, constant(point.reference));
    (psi.parts().is_some() && !psi.doubtful()).then(|| psi.rounded())
}

fn constant(x: f64) -> Precise<512> {
    Precise::constant(x)
}

/// The largest errors of psi, psi', psi'' in `u`, psi'' along with `psi'/m`: together they make a
/// tangent.
fn see(worst: &mut [f64; 3], kernel: &Kernel, point: Point, expected: [f64; 3]) {
    let found = at(kernel, point.measure, point.reference, point.change());
    let beside = [0.0, 0.0, expected[1] / point.measure];
    for k in 0..3 {
        let scale = expected[k].abs() + beside[k].abs();
        // What underflows or overflows is no matter of digits.
        if (1e-250..1e250).contains(&scale) {
            worst[k] = worst[k].max((found[k] - expected[k]).abs() / scale / U);
        }
    }
}

/// The same function, with as many right digits or more: against numbers of any precision, near rest
/// and far from it.
#[test]
fn squares_keep_their_digits_as_measures_do() {
    for even in even_energies() {
        let written = even.model.written(&even.values, even.measure);
        let kernels = Level::ALL.map(|level| even.kernel(Mode::Jit(level)));
        let mut worst = [[[0.0; 3]; 2]; 2];
        let mut n_points = 0;
        for reference in REFERENCES {
            for stretch in stretches() {
                let at = |stretch: f64| Point { measure: stretch * reference, reference };
                let (root, square) = (at(stretch), at(stretch * stretch));
                let both = truth(&written, root).zip(truth_by_squares(&written, square));
                let Some((by_root, by_square)) = both else { continue };
                n_points += 1;
                for (kernel, [squares, measures]) in kernels.iter().zip(&mut worst) {
                    see(squares, kernel.squared().unwrap(), square, by_square);
                    see(measures, kernel, root, by_root);
                }
            }
        }
        assert!(n_points > 150, "{}: {n_points}", even.name);
        for (level, [squares, measures]) in Level::ALL.iter().zip(worst) {
            println!("{level:?} {}: squares {squares:.1?}, measures {measures:.1?}", even.name);
            // What a large power magnifies stays within the bar of the audit in either form.
            let bar = if even.name.contains("n = 30") { 64.0 } else { 8.0 };
            for k in 0..3 {
                assert!(
                    squares[k] <= measures[k].max(bar),
                    "{}, {level:?}: {squares:?}",
                    even.name
                );
            }
        }
    }
}

/// Displacements of 1e-160 on a bond of length 1.
#[test]
fn tiny_changes_keep_their_digits() {
    for even in even_energies().iter().filter(|even| even.name.starts_with("firooz")) {
        let kernel = even.kernel(STRICT);
        for change in [1e-160, -1e-200, 1e-300] {
            let plain = at(&kernel, 1.0, 1.0, change);
            let [psi, first, second] = at(kernel.squared().unwrap(), 1.0, 1.0, 2.0 * change);
            let bar = |x: f64| 16.0 * U * x.abs();
            assert!((2.0 * first - plain[1]).abs() <= bar(plain[1]), "{}", even.name);
            assert!((4.0 * second - plain[2]).abs() <= bar(plain[2]), "{}", even.name);
            assert!((0.0..1e-300).contains(&psi), "{}: {psi}", even.name);
        }
    }
}

#[test]
fn the_interpreter_gives_the_same_bits() {
    for even in even_energies() {
        let [code, graph] = [STRICT, Mode::Interpreter].map(|mode| even.kernel(mode));
        let (code, graph) = (code.squared().unwrap(), graph.squared().unwrap());
        for stretch in stretches() {
            let change = (stretch - 1.0) * (stretch + 1.0);
            let bits = |kernel| at(kernel, stretch * stretch, 1.0, change).map(f64::to_bits);
            assert_eq!(bits(code), bits(graph), "{} at {stretch:e}", even.name);
        }
    }
}
