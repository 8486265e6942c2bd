//! Energies of bonds that depend on the direction of a bond at rest, an input of kernels.

#[path = "support/property.rs"]
#[allow(dead_code)] // the rest is for the other tests
mod property;

use piola_compiler::verify::sample::Random;
use piola_compiler::verify::{Outcome, verify};
use piola_compiler::{
    Batch, Form, Level, Measure, Mode, Model, Setting, Values, check_text, print,
};

const U: f64 = f64::EPSILON / 2.0;

/// Laws that see the direction in many ways, with what makes each finite.
const LAWS: [&str; 6] = [
    "(C + Cf*(n*Xi/L)^4)*L*(l/L - 1)^2",
    "C*L*ln(l/L)^2*abs(n*Xi)/L + C*L*(l/L - 1)^2",
    "C*(n*Xi/L)^2*(l - L)^2*exp(-L/delta)/L",
    "(C + Cf*(1 - (n*(Xi/norm(Xi)))^2)^(3/2))*L*((l/L)^2 - 1)^2",
    "if abs(Xi*n) > 0.9*L then Cf*L*(1 - cos(l/L - 1)) else C*L*(l/L - 1)^2",
    "C*L*(l/L - 1)^2*(Xi*dyad(n)*Xi)/(Xi*Xi)*cosh(n*Xi/L)",
];

fn model(d: usize, law: &str, more: &str) -> Model {
    let n = ["0.28, 0.96", "0.6, 0, -0.8"][d - 2];
    let text = format!(
        "potential p\ndimensions {d}\nparameter C = 3\nparameter Cf = 7\nn = vector({n})\n{more}\
         psi(l) = {law}\n"
    );
    check_text(&text).unwrap_or_else(|found| panic!("{found:?}\n{text}")).1
}

fn values(model: &Model, d: usize) -> Values {
    model.values(d, &[], Some(2.0)).unwrap()
}

fn directions(d: usize) -> Vec<Vec<f64>> {
    let mut random = Random::new(5);
    let mut all: Vec<Vec<f64>> =
        (0..d).map(|axis| vec_of(d, |k| if k == axis { 1.0 } else { 0.0 })).collect();
    for _ in 0..20 {
        let x = vec_of(d, |_| random.uniform(-1.0, 1.0));
        let size = x.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        all.push(x.iter().map(|x| x / size).collect());
    }
    all
}

fn vec_of(d: usize, component: impl FnMut(usize) -> f64) -> Vec<f64> {
    (0..d).map(component).collect()
}

const STRAINS: [f64; 9] = [1e-14, -1e-11, 1e-8, -1e-5, 1e-3, -0.03, 0.1, -0.4, 1.5];

/// Lengths at rest are powers of two, so that changes and lengths belong together.
const LENGTH: f64 = 0.5;

fn batch<'a>(measure: &'a [f64], reference: &'a [f64], fields: &'a [f64]) -> Batch<'a> {
    Batch { measure, reference, change: &STRAINS, fields }
}

/// psi, psi' and psi'' at all strains.
fn derivatives(model: &Model, values: &Values, mode: Mode, direction: &[f64]) -> [Vec<f64>; 3] {
    let kernel = &model.compile(values, mode, Form::Accurate).unwrap().kernels[0];
    let n = STRAINS.len();
    let (measure, reference) = (STRAINS.map(|e| LENGTH + LENGTH * e), [LENGTH; STRAINS.len()]);
    let fields: Vec<f64> = match kernel.fields() {
        [] => Vec::new(),
        _ => direction.iter().flat_map(|x| std::iter::repeat_n(*x, n)).collect(),
    };
    let out = kernel.derivatives(batch(&measure, &reference, &fields));
    [out.psi, out.dpsi, out.d2psi]
}

/// The witness is the kernel that has the same direction folded in.
#[test]
fn kernels_keep_their_digits_in_every_direction() {
    let mut worst = 0.0_f64;
    for (d, law) in [2, 3].into_iter().flat_map(|d| LAWS.map(|law| (d, law))) {
        let model = model(d, law, "");
        let values = values(&model, d);
        assert_eq!(values.fields.len(), d, "{law}");
        // Across `n` the cosine of a direction is what is left of two numbers.
        let n = [&[0.28, 0.96][..], &[0.6, 0.0, -0.8]][d - 2];
        let is_along = |e: &Vec<f64>| n.iter().zip(e).map(|(n, e)| n * e).sum::<f64>().abs() > 0.2;
        for direction in directions(d).into_iter().filter(is_along) {
            let folded = values.clone().with_direction(&model, &direction).without_fields();
            let expected = derivatives(&model, &folded, Mode::Jit(Level::Strict), &direction);
            let interpreted = derivatives(&model, &values, Mode::Interpreter, &direction);
            for level in Level::ALL {
                let found = derivatives(&model, &values, Mode::Jit(level), &direction);
                if level == Level::Strict {
                    assert_eq!(found, interpreted, "{law}");
                }
                for order in 0..3 {
                    for (k, expected) in expected[order].iter().enumerate() {
                        let off = (found[order][k] - expected).abs();
                        let units = off / (U * expected.abs() + f64::MIN_POSITIVE);
                        worst = worst.max(units);
                        let at = STRAINS[k];
                        assert!(units < 64.0, "{law} {direction:?} {order} {at} {units}");
                    }
                }
            }
        }
    }
    println!("at most {worst} roundings");
}

#[test]
fn energies_conditions_and_states_are_verified_in_several_directions() {
    let more = "state k = 0\nupdate k = max(k, (l/L - 1)*(1 + (n*Xi/L)^2))\n\
                break when l/L - 1 > 0.1*(2 - (Xi*n)^2/L^2)\n\
                dissipation(l) = (n*Xi)^2*rate(l)^2\n";
    for (d, law) in [2, 3].into_iter().flat_map(|d| LAWS.map(|law| (d, law))) {
        let model = model(d, law, more);
        for one in verify(&model, &values(&model, d), 40).unwrap().0 {
            assert_eq!(one.outcome(), Outcome::Passed, "{law} {:?} {:?}", one.subject, one.misses);
        }
    }
}

#[test]
fn what_is_printed_is_read_again() {
    for (d, law) in [2, 3].into_iter().flat_map(|d| LAWS.map(|law| (d, law))) {
        let model = model(d, law, "");
        let specialised = model.specialise(&values(&model, d)).unwrap();
        let text = print::text(&model, &specialised.energies[0]);
        assert!(text.contains("(Xi(1)/L)"), "{text}");
        property::round_trip(&model, &specialised.energies[0], d);
    }
}

/// The length is a factor of `n*Xi`, and `Xi/L` and `norm(Xi)` are known as what they are.
#[test]
fn directions_cancel_lengths() {
    let text = |law: &str| {
        let model = model(2, law, "");
        print::text(&model, &model.specialise(&values(&model, 2)).unwrap().energies[0])
    };
    let known = text("(Xi(1)/L)^2*(l - L)^2");
    assert_eq!(text("(vector(1, 0)*Xi/L)^2*(l - L)^2"), known);
    assert_eq!(text("(vector(1, 0)*(Xi/norm(Xi)))^2*(l - L)^2"), known);
}

#[test]
fn a_name_of_the_file_goes_before() {
    let text = "potential p\nparameter Xi = 2\npsi(l) = Xi*(l - L)^2";
    let (_, model) = check_text(text).unwrap();
    assert!(!model.sees_directions());
    assert!(model.values(3, &[], None).unwrap().fields.is_empty());
}

#[test]
fn components_count_among_what_varies() {
    let parameters: String = (0..6).map(|k| format!("parameter p{k} = 1\n")).collect();
    let sum: Vec<String> = (0..6).map(|k| format!("p{k}")).collect();
    let more = format!("{parameters}s = {}\n", sum.join(" + "));
    let model = model(3, "s*(n*Xi/L)^2*L*(l/L - 1)^2", &more);
    let field = |k: usize| (format!("p{k}"), Setting::Field(1.0));
    let with = |n: usize| model.values(3, &(0..n).map(field).collect::<Vec<_>>(), None);
    assert_eq!(with(5).unwrap().fields.len(), 8);
    assert_eq!(with(6).unwrap_err()[0].code, "too-large");
}

/// Laws of the vector of a bond.
const VECTORS: [&str; 5] = [
    "C*(xi(1) - Xi(1))^2/L + Cf*(sqrt(1 + ((xi(2) - Xi(2))/L)^2) - 1)*L",
    "1/2*C*((xi - Xi)*Xi/L)^2/L",
    "C*norm(xi)*ln(norm(xi)/norm(Xi))^2 + Cf*(xi - Xi)*dyad(n)*(xi - Xi)/L",
    "Cf*((xi - Xi)*n)^2*exp(l/L - 1)/L + C*L*(l/L - 1)^2",
    "C*sqrt(L^2 + (xi - Xi)*(xi - Xi))*abs(n*Xi)/L",
];

fn of_vector(d: usize, law: &str) -> String {
    let n = ["0.28, 0.96", "0.6, 0, -0.8"][d - 2];
    format!(
        "potential p\ndimensions {d}\nparameter C = 3\nparameter Cf = 7\nn = vector({n})\n\
         psi(xi) = {law}\n"
    )
}

#[test]
fn energies_of_vectors_are_verified() {
    for (d, law) in [2, 3].into_iter().flat_map(|d| VECTORS.map(|law| (d, law))) {
        let (_, model) = check_text(&of_vector(d, law)).unwrap();
        let found = verify(&model, &values(&model, d), 24).unwrap().0;
        assert!(!found.is_empty());
        for one in found {
            assert_eq!(one.outcome(), Outcome::Passed, "{law} {:?} {:?}", one.subject, one.misses);
        }
    }
}

/// Of the vector nothing but its length counts in `xi*xi` and `norm(xi)`; all else is not objective.
#[test]
fn energies_of_vectors_are_told_not_to_be_objective() {
    let codes = |law: &str| {
        let (_, model) = check_text(&of_vector(3, law)).unwrap();
        model.lint(false).into_iter().map(|lint| lint.code).collect::<Vec<_>>()
    };
    assert_eq!(codes("C*(xi*xi/(Xi*Xi) - 1)^2*norm(xi)"), [""; 0]);
    assert_eq!(codes("C*((xi - Xi)*n)^2/L"), ["not-objective"]);
}

#[test]
fn what_no_vector_of_a_bond_has_is_refused() {
    let found = |text: &str| match check_text(text) {
        Ok(_) => Vec::new(),
        Err(found) => found.into_iter().map(|one| one.code).collect::<Vec<_>>(),
    };
    let of = |law: &str| found(&of_vector(3, law));
    let lines = |lines: &str| found(&format!("potential p\ndimensions 3\n{lines}\n"));
    assert_eq!(of("(xi - Xi)*n"), ["wrong-measure"], "it is odd");
    assert_eq!(of("a*(xi*n)^2"), ["wrong-measure"]);
    assert_eq!(of("integral(L)*(xi*n)^2"), ["wrong-measure"]);
    assert_eq!(of("(xi(1) - Xi(1))^2/L*(if n*Xi > 0.99*L then 2 else 1)"), ["wrong-measure"]);
    assert_eq!(lines("Xi = 2\npsi(xi) = xi*xi"), ["reserved-name"]);
    assert_eq!(of("xi"), ["wrong-shape"]);
    assert_eq!(of("xi*xi + 1'"), ["wrong-shape"]);
    assert_eq!(lines("psi(xi, theta) = xi*xi"), ["wrong-measure"]);
    assert_eq!(lines("psi(l) = xi*xi"), ["unknown-name"; 2]);
    assert_eq!(lines("psi(l) = xi(1)^2\npsi(xi) = xi*xi")[0], "wrong-measure");
    assert_eq!(lines("m = integral(xi(1)^2)\npsi(m) = m\npsi(xi) = xi*xi"), [""; 0]);
    assert_eq!(lines("psi(xi) = xi*xi\nbreak when xi(1)^2 > L^2")[0], "wrong-measure");
    // Of its length any energy of bonds may be.
    assert_eq!(lines("psi(l) = xi*xi\npsi(xi) = xi*xi"), [""; 0]);
    assert_eq!(lines("parameter C in J/m^6\npsi(xi) = C*(xi*xi)"), ["dimension-mismatch"]);
    assert_eq!(lines("parameter C in J/m^8\npsi(xi) = C*(xi*xi)"), [""; 0]);
    assert_eq!(lines("parameter xi = 1\npsi(l) = xi*(l - L)^2"), [""; 0]);
}

/// Energies that see no direction take none, beside others that do.
#[test]
fn kernels_without_directions_take_no_fields() {
    let (_, model) = check_text(
        "potential p\ndimensions 2\npsi(F) = tr(E)^2\ntheta = integral(l - L)\npsi(theta) = theta^2\n\
         psi(l) = (Xi(1)/L)^2*(l - L)^2\npsi(a) = (a - A)^2",
    )
    .unwrap();
    for mode in [Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual] {
        let compiled = model.compile(&values(&model, 2), mode, Form::Accurate).unwrap();
        assert!(compiled.gradient.unwrap().fields().is_empty());
        assert!(compiled.gathered.unwrap().points.unwrap().fields().is_empty());
        let of_measures: Vec<usize> =
            compiled.kernels.iter().map(|one| one.fields().len()).collect();
        assert_eq!(of_measures, [2, 0]);
    }
}

/// Of the plane and of space in one file: every component has its array.
#[test]
fn printed_c_of_vectors_has_all_directions() {
    let text = "potential p\nw = xi - Xi\ns = w*Xi/L\npsi(xi) = (3*s^2 + w*w - s^2)/L";
    let (_, model) = check_text(text).unwrap();
    for d in [2, 3] {
        let form = model.specialise_coupled(&values(&model, d), Measure::Length, Form::Accurate);
        let source = print::coupled_c(&model, Measure::Length, &form.unwrap().0.unwrap());
        assert!(!source.contains("NAN"), "{source}");
        assert_eq!(source.contains("direction_3"), d == 3, "{source}");
    }
}
