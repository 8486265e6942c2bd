//! Parameters that vary from place to place: kernels take their values where they are evaluated.
//!
//! The witness of a kernel with a field is the kernel that has the same number folded in.

#[path = "support/library.rs"]
#[allow(dead_code)]
mod library;

use library::{Case, cases, files};
use piola_compiler::{
    Batch, Form, GatheredBatch, GatheredKernel, GradientBatch, GradientKernel, Kernel, Level, Mode,
    Model, Setting, Values, check,
};
use piola_grammar::parse;

const U: f64 = f64::EPSILON / 2.0;

/// Strains from far below rounding to far from rest.
const STRAINS: [f64; 12] =
    [1e-14, -1e-12, 1e-9, -1e-7, 1e-5, -1e-3, 0.02, -0.1, 0.3, -0.45, 0.9, 3.0];

/// The same parameters, one of them as a field.
fn with_field(case: &Case, number: u16) -> Values {
    Values { fields: vec![number], ..case.values.clone() }
}

/// How often a field changes a kernel, in units in the last place of its largest part.
#[derive(Default)]
struct Worst(f64, String);

impl Worst {
    fn see(&mut self, found: f64, expected: f64, scale: f64, of: impl Fn() -> String) {
        if !(expected.is_finite() && scale.is_finite()) {
            return;
        }
        let off = (found - expected).abs();
        let units = if off == 0.0 { 0.0 } else { off / (U * scale) };
        if units.is_nan() || units > self.0 {
            *self = Worst(units, of());
        }
    }
}

fn measures(kernel: &Kernel, field: f64) -> [Vec<f64>; 3] {
    let n = STRAINS.len();
    let reference = vec![0.01; n];
    let measure: Vec<f64> = STRAINS.iter().map(|e| 0.01 + 0.01 * e).collect();
    let fields = vec![field; kernel.fields().len() * n];
    let batch =
        Batch { measure: &measure, reference: &reference, change: &STRAINS, fields: &fields };
    let out = kernel.derivatives(batch);
    [out.psi, out.dpsi, out.d2psi]
}

/// Machine code, the interpreter and hyper-dual numbers agree with the kernels that have the number
/// folded in. An exponent that varies has lost what a known one keeps near rest.
#[test]
fn kernels_with_fields_are_those_with_the_numbers_folded_in() {
    let mut worst = Worst::default();
    let mut seen = 0;
    for case in cases().iter().step_by(2) {
        for (i, parameter) in case.model.parameters().iter().enumerate() {
            if parameter.name == "n" {
                continue;
            }
            let (values, field) = (with_field(case, i as u16), case.values.parameters[i]);
            if field == 0.0 {
                continue;
            }
            let compile = |values: &Values, mode| {
                case.model.compile(values, mode, Form::Accurate).unwrap().kernels
            };
            let strict = Mode::Jit(Level::Strict);
            let own = compile(&values, strict);
            let interpreted = compile(&values, Mode::Interpreter);
            let dual = compile(&values, Mode::HyperDual);
            for (k, folded) in compile(&case.values, strict).iter().enumerate() {
                let (found, expected) = (measures(&own[k], field), measures(folded, field));
                let written = measures(&dual[k], field);
                let bits = measures(&interpreted[k], field);
                for order in 0..3 {
                    seen += usize::from(!own[k].fields().is_empty());
                    for (p, strain) in STRAINS.iter().enumerate() {
                        let same = bits[order][p].to_bits() == found[order][p].to_bits();
                        assert!(same || found[order][p].is_nan(), "{}", case.name);
                        let of =
                            || format!("{}: {} at {strain}, {order}", case.name, parameter.name);
                        worst.see(
                            found[order][p],
                            expected[order][p],
                            expected[order][p].abs(),
                            of,
                        );
                        // As written digits are lost near rest: only far from it they agree.
                        if strain.abs() > 0.1 {
                            let (written, found) = (written[order][p], found[order][p]);
                            let size = found.abs().max(expected[0][p].abs());
                            assert!(
                                !found.is_finite() || (written - found).abs() <= 1e-10 * size,
                                "{}: {written} {found}",
                                of()
                            );
                        }
                    }
                }
            }
        }
    }
    println!("fields change {seen} kernels by at most {:.1} u ({})", worst.0, worst.1);
    assert!(seen > 100, "{seen} kernels with fields");
    assert!(worst.0 > 0.0 && worst.0 < 48.0, "{:.1} u ({})", worst.0, worst.1);
}

/// All potentials of a kind, with numbers for their parameters.
fn of_library(is_wanted: impl Fn(&Model) -> bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, text) in files() {
        let model = check(&parse(&text).unwrap()).unwrap();
        if !is_wanted(&model) {
            continue;
        }
        for dimension in model.dimensions().collect::<Vec<_>>() {
            let variant = model.variant(dimension).unwrap();
            let missing = model.parameters().iter().zip(&variant.defaults);
            let missing = missing.filter(|(_, default)| default.is_none());
            let settings: Vec<_> = missing
                .enumerate()
                .map(|(k, (p, _))| (p.name.clone(), Setting::Number([2.0, 3.0, 1.5, 2.5][k % 4])))
                .collect();
            if let Ok(values) = model.values(dimension, &settings, Some(1.5)) {
                cases.push(Case { name: name.clone(), model: model.clone(), values });
            }
        }
    }
    cases
}

fn gradient(kernel: &GradientKernel, strain: f64, field: f64) -> (f64, Vec<f64>, Vec<f64>) {
    let d = kernel.dimension();
    let change: Vec<f64> = (0..d * d)
        .map(|k| strain * [0.7, -0.2, 0.1, 0.3, -0.4, 0.25, -0.15, 0.05, 0.5][k])
        .collect();
    let unit = |k: usize| if k.is_multiple_of(d + 1) { 1.0 } else { 0.0 };
    let gradient: Vec<f64> = change.iter().enumerate().map(|(k, h)| unit(k) + h).collect();
    let fields = vec![field; kernel.fields().len()];
    let at = GradientBatch { n: 1, gradient: &gradient, change: &change, fields: &fields };
    let (mut psi, mut stress, mut product) = ([0.0], vec![0.0; d * d], vec![0.0; d * d]);
    kernel.evaluate(at, &mut psi, &mut stress);
    kernel.product(at, &change, &mut product);
    (psi[0], stress, product)
}

/// Parameters that lose digits near rest where they are fields: exponents, the parts of a unit vector, and
/// what stands with such. What cancels there is known only where their values are.
const LOSE: [&str; 16] = [
    "N", "nu", "f", "alpha1", "alpha2", "alpha3", "beta", "nx", "ny", "nz", "mx", "my", "mz", "k2",
    "a", "kappa",
];

/// The same for energies of the deformation gradient, down to strains at which what is written has lost
/// all digits of psi.
#[test]
fn energies_of_gradients_keep_their_digits_with_fields() {
    let (mut worst, mut seen) = (Worst::default(), 0);
    for case in of_library(Model::has_gradient_energy) {
        for (i, parameter) in case.model.parameters().iter().enumerate() {
            let (values, field) = (with_field(&case, i as u16), case.values.parameters[i]);
            let keeps = !LOSE.contains(&parameter.name.as_str());
            let kernel = |values: &Values, mode| {
                case.model.compile(values, mode, Form::Accurate).unwrap().gradient.unwrap()
            };
            let own = kernel(&values, Mode::Jit(Level::Strict));
            let folded = kernel(&case.values, Mode::Jit(Level::Strict));
            let interpreted = kernel(&values, Mode::Interpreter);
            let dual = kernel(&values, Mode::HyperDual);
            seen += own.fields().len();
            for strain in [1e-9, 1e-6, 1e-3, 0.05, 0.2, 0.4, 0.9] {
                let of = || format!("{}: {} at {strain}", case.name, parameter.name);
                let found = gradient(&own, strain, field);
                assert_eq!(found, gradient(&interpreted, strain, field), "{}", of());
                let expected = gradient(&folded, strain, field);
                let written = gradient(&dual, strain, field);
                if keeps {
                    worst.see(found.0, expected.0, expected.0.abs(), of);
                }
                let pairs =
                    [(&found.1, &expected.1, &written.1), (&found.2, &expected.2, &written.2)];
                for (found, expected, written) in pairs {
                    for ((found, expected), written) in found.iter().zip(expected).zip(written) {
                        if keeps {
                            worst.see(*found, *expected, expected.abs(), of);
                        }
                        let loose = 1e-12 * expected.abs().max(1.0) / strain;
                        assert!((written - found).abs() <= loose, "{}: {written} {found}", of());
                    }
                }
            }
        }
    }
    println!("{seen} kernels of F with fields differ by {:.1} u at most ({})", worst.0, worst.1);
    assert!(seen > 10 && worst.0 > 0.0 && worst.0 < 64.0, "{:.1} u ({})", worst.0, worst.1);
}

fn gathered(kernel: &GatheredKernel, strain: f64, field: f64) -> (f64, Vec<f64>) {
    let m = kernel.n_variables();
    let bond = usize::from(kernel.of_bonds());
    let variables: Vec<f64> =
        (0..m).map(|k| if k < bond { 1.0 + strain } else { [3.0, 0.7, 1.9][k % 3] }).collect();
    let (change, reference) = (vec![strain; bond], vec![1.0; bond]);
    let fields = vec![field; kernel.fields().len()];
    let at = GatheredBatch {
        n: 1,
        variables: &variables,
        change: &change,
        reference: &reference,
        fields: &fields,
    };
    let (mut psi, mut slopes) = ([0.0], vec![0.0; m]);
    kernel.evaluate(at, &mut psi, &mut slopes);
    (psi[0], slopes)
}

#[test]
fn energies_of_gathered_values_take_fields() {
    let (mut worst, mut seen) = (Worst::default(), 0);
    for case in of_library(Model::has_gathered_energy) {
        for (i, parameter) in case.model.parameters().iter().enumerate() {
            let (values, field) = (with_field(&case, i as u16), case.values.parameters[i]);
            let kernels = |values: &Values, mode| {
                let made = case.model.compile(values, mode, Form::Accurate).unwrap().gathered;
                let made = made.unwrap();
                [made.points, made.bonds].into_iter().flatten().collect::<Vec<_>>()
            };
            let own = kernels(&values, Mode::Jit(Level::Strict));
            let folded = kernels(&case.values, Mode::Jit(Level::Strict));
            let dual = kernels(&values, Mode::HyperDual);
            for ((own, folded), dual) in own.iter().zip(&folded).zip(&dual) {
                seen += own.fields().len();
                for strain in [1e-6, 1e-2, 0.3] {
                    let of = || format!("{}: {} at {strain}", case.name, parameter.name);
                    let (found, expected) =
                        (gathered(own, strain, field), gathered(folded, strain, field));
                    let written = gathered(dual, strain, field);
                    assert!((written.0 - found.0).abs() <= 1e-9 * found.0.abs(), "{}", of());
                    worst.see(found.0, expected.0, expected.0.abs(), of);
                    for (found, expected) in found.1.iter().zip(&expected.1) {
                        worst.see(*found, *expected, expected.abs(), of);
                    }
                }
            }
        }
    }
    println!("{seen} kernels of gathered values with fields: {:.1} u ({})", worst.0, worst.1);
    assert!(seen > 3 && worst.0 < 64.0, "{:.1} u ({})", worst.0, worst.1);
}

/// A term that a parameter drops may hold the only field.
#[test]
fn fields_may_drop_out_of_an_energy() {
    let text = "potential p\nparameter k\nparameter g\npsi(l) = L*(l/L - 1)^2 + k*g*(l - L)^2";
    let model = check(&parse(text).unwrap()).unwrap();
    let settings = [("k".to_string(), Setting::Number(0.0)), ("g".into(), Setting::Field(2.0))];
    let values = model.values(3, &settings, Some(1.0)).unwrap();
    let of = |mode| {
        let kernel = model.compile(&values, mode, Form::Accurate).unwrap().kernels.remove(0);
        assert!(kernel.fields().is_empty());
        measures(&kernel, f64::NAN)
    };
    let (found, written) = (of(Mode::Jit(Level::Strict)), of(Mode::HyperDual));
    for (x, y) in found.iter().flatten().zip(written.iter().flatten()) {
        assert!((x - y).abs() <= 1e-6 * x.abs() + 1e-15, "{x} {y}");
    }
}

/// A multiple of its only field is told, at the fast level, where the law is affine in the measure.
#[test]
fn multiples_of_a_field_are_told() {
    let is_multiple = |psi: &str| {
        let text = format!("potential p\nparameter C\nparameter b = 2\npsi(l) = {psi}");
        let model = check(&parse(&text).unwrap()).unwrap();
        let of = |typical: f64| {
            let values =
                model.values(3, &[("C".into(), Setting::Field(typical))], Some(0.26)).unwrap();
            let mode = Mode::Jit(Level::Fast);
            model.compile(&values, mode, Form::Accurate).unwrap().kernels[0].is_multiple_of_field()
        };
        let found = [1.0, 2.5, 2.0625, 1e9].map(of);
        assert!(found.iter().all(|is_one| *is_one == found[0]), "{psi}: {found:?}");
        found[0]
    };
    assert!(is_multiple("1/2*C*L*(l/L - 1)^2"));
    assert!(is_multiple("1/2*C*L*(l/L - 1)^2 + C*b*l"));
    assert!(!is_multiple("1/2*C*L*(l/L - 1)^2 + b*l"));
    assert!(!is_multiple("1/2*C^2*L*(l/L - 1)^2"));
    assert!(!is_multiple("C*L*(l/L - 1)^4"));
}

/// Conditions on fields are checked where their values are.
#[test]
fn conditions_on_fields_are_checked_place_by_place() {
    let text = "potential p\nparameter C, C > 0\nparameter D, D > C\npsi(l) = C*l + D*l^2";
    let model = check(&parse(text).unwrap()).unwrap();
    let of = |c: f64| [("C".to_string(), Setting::Field(c)), ("D".into(), Setting::Number(3.0))];
    let values = model.values(3, &of(-1.0), None).unwrap();
    assert_eq!(values.fields, [0]);
    assert!(model.check_fields(&values, &[2.0]).is_empty());
    let broken = |c: f64| {
        let found = model.check_fields(&values, &[c]);
        found.into_iter().map(|error| error.parameter).collect::<Vec<_>>()
    };
    assert_eq!(broken(-1.0), ["C"]);
    assert_eq!(broken(4.0), ["D"]);
}
