use super::GradientBatch;
use super::sample::{Sample, evaluate, plus_identity};
use super::truth::truth;
use crate::test_support::{model, values};
use crate::verify::sample::Random;
use crate::verify::{Verification, verify};
use crate::{Form, Level, Mode};
use crate::{Model, Values};

const ST_VENANT: &str = "potential svk
parameter lambda = 3
parameter mu = 2
E = (F'*F - I)/2
psi(F) = lambda/2*tr(E)^2 + mu*(E : E)";

const NEO_HOOKE: &str = "potential nh
parameter lambda = 100
parameter mu = 1
psi(F) = mu/2*(tr(C) - d - 2*ln(J)) + lambda/2*ln(J)^2";

const STABLE: &str = "potential stable
parameter lambda = 100
parameter mu = 1
alpha = 1 + mu/lambda
psi(F) = mu/2*(tr(C) - d) + lambda/2*(J - alpha)^2 - mu^2/lambda/2";

const SMOOTH: &str = "potential smooth
parameter lambda = 1
parameter mu = 1
psi(F) = mu/2*(tr(C) - d) - mu*(J - 1) + lambda/2*(J - 1)^2";

const MOONEY: &str = "potential mooney
dimensions 3
parameter c1 = 0.3
parameter c2 = 0.7
parameter K = 11
I1 = J^(-2/3)*tr(C)
I2 = J^(-4/3)*(tr(C)^2 - C : C)/2
psi(F) = c1*(I1 - 3) + c2*(I2 - 3) + K/2*(J - 1)^2";

const FUNG: &str = "potential fung
parameter c = 2
parameter b = 3
Q = b*(E : E)
psi(F) = c/2*(exp(Q) - 1) + tr(E)^2";

const FIBRE: &str = "potential fibre
dimensions 3
parameter k = 3
I4 = I + C
stretch = tr(dev(sym(I4))*C)
psi(F) = E : E + (if stretch > 0 then k*stretch^2 else 0)";

const HENCKY: &str = "potential hencky
parameter lambda = 3
parameter mu = 1
psi(F) = mu*tr(ln(U)^2) + lambda/2*ln(J)^2";

const OGDEN: &str = "potential ogden
parameter p = 1.3
parameter q = -2
power(n) = (J^(-n/d)*tr(U^n) - d)/n
psi(F) = 2*power(p) - power(q) + 5*(J - 1)^2";

const BIOT: &str = "potential biot
parameter lambda = 3
parameter mu = 1
psi(F) = mu*(U - I) : (U - I) + lambda/2*tr(U - I)^2";

/// The error function about 1 and 0, angles of points to the right of the axis and above it.
const ANGLES: &str = "potential angles
parameter mu = 2
psi(F) = mu*(E : E) + (erf(J) - erf(1))^2 + erf(tr(E))*(J - 1)
psi(F) = (atan2(J, tr(C)) - atan2(1, d))^2 + atan2(J - 1, 3)^2 + (atan2(-3*J, F(1, 2)) + pi/2)^2
psi(F) = (atan2(2, -tr(C)) - atan2(2, -d))^2";

/// The energy is the sum of both.
const TWO: &str = "potential two
parameter k = 2
psi(F) = E : E
psi(F) = k*tr(E)^2";

/// Every operation that functions of `U` know.
const ALL_OF_STRETCH: &str = "potential all_of_stretch
parameter k = 2
S = 2*U + I*k - U/k
R = log1p(sqrt(U))*sym(U') - inv(U)^3
psi(F) = J^(1/3)*tr(S*R) + ln(U) : expm1(U/k) + tr(exp(-U) + U^2.5 + U^-4 - U^5 + (U + I)^-0.5)";

#[test]
fn energies_of_the_gradient_have_right_digits_near_rest_and_far_from_it() {
    for text in [
        ST_VENANT,
        TWO,
        NEO_HOOKE,
        STABLE,
        MOONEY,
        ANGLES,
        FUNG,
        FIBRE,
        HENCKY,
        OGDEN,
        BIOT,
        ALL_OF_STRETCH,
    ] {
        let model = model(text);
        for dimension in model.dimensions() {
            let values = values(&model, dimension, &[]);
            // True values of many elementary functions take long.
            let n = if text.contains('U') { 6 } else { 24 };
            let found = verified(&model, &values, n);
            println!("{} {dimension} {found:?}", model.name());
            assert!(found.passed(), "{} in {dimension} dimensions: {found:?}", model.name());
        }
    }
}

#[test]
fn outside_the_declared_domain_psi_is_no_number() {
    let text = "potential p\nparameter mu = 1\npsi(F) = mu/2*(E : E)\ndomain J in (0.5, 2]\n";
    let model = model(text);
    assert!(crate::print::model_listing(&model).contains("  domain J in (0.5, 2]\n"));
    for dimension in [2, 3] {
        let values = values(&model, dimension, &[]);
        for mode in [Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual] {
            let kernel = model.compile(&values, mode, Form::Accurate).unwrap().gradient.unwrap();
            let psi = |j: f64| {
                let mut gradient = plus_identity(&vec![0.0; dimension * dimension], 1.0);
                gradient[0] = j;
                let change = plus_identity(&gradient, -1.0);
                let mut psi = [0.0];
                let at = GradientBatch { n: 1, gradient: &gradient, change: &change, fields: &[] };
                kernel.evaluate(at, &mut psi, &mut []);
                psi[0]
            };
            for inside in [0.6, 0.9, 1.0, 2.0] {
                assert!(psi(inside).is_finite(), "{mode:?} {inside}");
            }
            for outside in [-1.0, 0.0, 0.5, 2.1, f64::NAN] {
                assert!(psi(outside).is_nan(), "{mode:?} {outside}");
            }
        }
        let found = verified(&model, &values, 40);
        assert!(found.passed() && found.n_places < 80, "{found:?}");
    }
}

/// Bounds of any quantity, of which one depends on a field that the energy knows nothing of.
#[test]
fn outside_the_domain_of_any_quantity_psi_is_no_number() {
    let text = "potential p\ndimensions 2\nparameter mu = 1\nparameter most = 3\npsi(F) = mu/2*(E : E)\n\
                domain tr(C)/most in (0, 1]\ndomain tr(ln(U)) in (-1, inf)\n";
    let model = model(text);
    for mode in [Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual] {
        let mut values = values(&model, 2, &[]).with_field(1);
        values.parameters[1] = 3.0;
        let kernel = model.compile(&values, mode, Form::Accurate).unwrap().gradient.unwrap();
        assert_eq!(kernel.fields().len(), 1);
        let n = 150;
        let stretch = |p: usize| 0.2 + 0.01 * p as f64;
        let most = |p: usize| if p.is_multiple_of(2) { 3.0 } else { 2.5 };
        let mut gradient = vec![0.0; 4 * n];
        for p in 0..n {
            (gradient[p], gradient[3 * n + p]) = (stretch(p), 1.0);
        }
        let mut change = gradient.clone();
        for p in 0..n {
            (change[p], change[3 * n + p]) = (stretch(p) - 1.0, 0.0);
        }
        let fields: Vec<f64> = (0..n).map(most).collect();
        let at = GradientBatch { n, gradient: &gradient, change: &change, fields: &fields };
        let mut psi = vec![0.0; n];
        kernel.evaluate(at, &mut psi, &mut []);
        for (p, psi) in psi.iter().enumerate() {
            let s = stretch(p);
            let inside = s * s + 1.0 <= most(p) && libm::log(s) > -1.0;
            assert_eq!(psi.is_finite(), inside, "{mode:?} {s} {psi}");
            assert_eq!(
                kernel.admits(&[s, 0.0, 0.0, 1.0]),
                s * s + 1.0 <= 3.0 && libm::log(s) > -1.0
            );
        }
    }
    let found = verified(&model, &values(&model, 2, &[]), 40);
    assert!(found.passed() && found.n_places < 80, "{found:?}");
}

/// A batch with places near rest and far from it, more than one block of them, gives at each place
/// what the place gives alone.
#[test]
fn places_of_a_batch_are_as_they_are_alone() {
    for (text, n) in [(ST_VENANT, 150), (OGDEN, 150), (HENCKY, 70)] {
        let model = model(text);
        for dimension in [2, 3] {
            let values = values(&model, dimension, &[]);
            let mut random = Random::new(3);
            let samples: Vec<Sample> = (0..n)
                .map(|p| {
                    let size = [1e-6, 0.1, 0.4][p % 3];
                    let change = (0..dimension * dimension)
                        .map(|_| 0.5 * size * random.uniform(-1.0, 1.0))
                        .collect();
                    Sample::of_change(change, &mut random)
                })
                .collect();
            for mode in [Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual] {
                let kernel = model.compile(&values, mode, Form::Accurate).unwrap();
                let kernel = kernel.gradient.unwrap();
                let together = evaluate(&kernel, &samples);
                let columns = |of: &dyn Fn(&Sample) -> &[f64]| -> Vec<f64> {
                    let components = 0..dimension * dimension;
                    components.flat_map(|k| samples.iter().map(move |s| of(s)[k])).collect()
                };
                let gradient = columns(&|s| &s.gradient);
                let change = columns(&|s| &s.change);
                let mut psi = vec![0.0; n];
                let batch = GradientBatch { n, gradient: &gradient, change: &change, fields: &[] };
                kernel.evaluate(batch, &mut psi, &mut []);
                let with_stress: Vec<f64> = together.iter().map(|found| found[0]).collect();
                assert_eq!(psi, with_stress, "{} {dimension} {mode:?}", model.name());
                for (sample, found) in samples.iter().zip(together) {
                    let alone = evaluate(&kernel, std::slice::from_ref(sample));
                    assert_eq!(found, alone[0], "{} {dimension} {mode:?}", model.name());
                }
            }
        }
    }
}

/// `F = L D R` with ones on the diagonals of the triangles: its determinant is that of the diagonal.
#[test]
fn the_declared_domain_is_of_the_determinant() {
    let text = "potential p\nparameter mu = 1\npsi(F) = mu/2*(E : E)\ndomain J in (0.5, 2]\n";
    let model = model(text);
    let mut random = Random::new(1);
    for d in [2, 3] {
        let values = values(&model, d, &[]);
        let mode = Mode::Jit(Level::Fast);
        let kernel = model.compile(&values, mode, Form::Accurate).unwrap().gradient.unwrap();
        let (mut samples, mut inside) = (Vec::new(), Vec::new());
        for _ in 0..200 {
            let mut triangle = |sign: i32, r: usize, c: usize| match (r as i32 - c as i32) * sign {
                0 => 1.0,
                below if below > 0 => random.uniform(-1.0, 1.0),
                _ => 0.0,
            };
            let lower: Vec<f64> = (0..d * d).map(|k| triangle(1, k / d, k % d)).collect();
            let upper: Vec<f64> = (0..d * d).map(|k| triangle(-1, k / d, k % d)).collect();
            let diagonal: Vec<f64> = (0..d).map(|_| random.uniform(-0.5, 2.5)).collect();
            let entry = |k: usize| {
                let terms =
                    (0..d).map(|s| lower[k / d * d + s] * diagonal[s] * upper[s * d + k % d]);
                terms.sum::<f64>()
            };
            let j: f64 = diagonal.iter().product();
            inside.push(0.5 < j && j <= 2.0);
            samples.push(Sample::of_gradient((0..d * d).map(entry).collect(), &mut random));
        }
        let n_inside = inside.iter().filter(|inside| **inside).count();
        assert!(n_inside > 20 && n_inside < 180, "{n_inside}");
        for (result, inside) in evaluate(&kernel, &samples).iter().zip(inside) {
            assert_eq!(!result[0].is_nan(), inside, "{d} {result:?}");
        }
    }
}

/// The norm of the strain has a kink at rest, its cube has none; it loses digits there as `C - I` does.
/// Divisors that are linear, or do not change to first order, are no constants.
#[test]
fn roots_and_quotients_have_values_near_rest() {
    near_rest("sqrt(E : E)^3", |size| 64.0 / size);
    for energy in [
        "(E : E)/tr(F)",
        "tr(E)^2/(1 + E : E)",
        "sqrt(tr(C) + 1)",
        "exp(-tr(E))",
        // Roots of 1 and of less.
        "(sqrt(tr(C)/3) - 1)^2",
        "(sqrt(tr(C)/12) - 1/2)^2",
    ] {
        near_rest(energy, |_| 64.0);
    }
}

/// `2 + (x - x)` does not vary, though it is no number: its powers are those of 2.
#[test]
fn sums_that_do_not_vary_are_constants_near_rest() {
    near_rest("(E : E)*(2 + (tr(F) - tr(F)))^-2", |_| 64.0);
}

/// psi, P and dP of an energy at random gradients within a tolerance in u, which may depend on the strain.
fn near_rest(energy: &str, tolerance: impl Fn(f64) -> f64) {
    let model = model(&format!("potential p\npsi(F) = {energy}\n"));
    let written = model.written_gradient(&values(&model, 3, &[]));
    let mut random = Random::new(2);
    for size in [0.2, 1e-3, 1e-6] {
        let change = (0..9).map(|_| size * random.uniform(-1.0, 1.0)).collect();
        let sample = Sample::of_change(change, &mut random);
        let truth = truth(&written, &sample).unwrap();
        for level in Level::ALL {
            let found = at(&model, &values(&model, 3, &[]), &sample, level);
            close_to(energy, &found, &truth, tolerance(size));
        }
    }
}

/// Inverted, nearly flat, turned by 90 degrees: diagonals, alone and before a rotation.
fn extreme_gradients() -> Vec<(&'static str, Vec<f64>)> {
    let diagonal = |x: f64, y: f64, z: f64| vec![x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z];
    let turned = |x: f64, y: f64, z: f64| vec![0.0, -y, 0.0, x, 0.0, 0.0, 0.0, 0.0, z];
    vec![
        ("inverted", diagonal(-0.5, 1.2, 0.9)),
        ("inside out", diagonal(-1.0, -1.0, -1.0)),
        ("flat", diagonal(1e-9, 1.0, 1.0)),
        ("flat and turned", turned(1e-9, 1.1, 0.8)),
        ("turned", turned(1.0, 1.0, 1.0)),
        // Powers of 2: the rounding of a volume of 1 is magnified by lambda/mu, as in any formula.
        ("turned and stretched", turned(1024.0, 1.0 / 1024.0, 1.0)),
        ("stretched", diagonal(1e6, 1e6, 1e6)),
        ("pressed", diagonal(1e-6, 1e-6, 1e-6)),
    ]
}

/// What is found for the one energy of a model.
fn verified(model: &Model, values: &Values, n: usize) -> Verification {
    verify(model, values, n).unwrap().0.remove(0)
}

/// psi, P and dP of one gradient, at a level.
fn at(model: &Model, values: &Values, sample: &Sample, level: Level) -> Vec<f64> {
    let compiled = model.compile(values, Mode::Jit(level), Form::Accurate).unwrap();
    let kernel = compiled.gradient.unwrap();
    let batch =
        GradientBatch { n: 1, gradient: &sample.gradient, change: &sample.change, fields: &[] };
    let (mut psi, mut stress, mut product) = ([0.0], [0.0; 9], [0.0; 9]);
    kernel.evaluate(batch, &mut psi, &mut stress);
    kernel.product(batch, &sample.direction, &mut product);
    psi.into_iter().chain(stress).chain(product).collect()
}

/// E19: St Venant-Kirchhoff and stable neo-Hookean energies are finite and right for every gradient,
/// also with lambda/mu = 1e8; the logarithm is no number where a body is turned inside out.
#[test]
fn e19_extreme_gradients_have_right_digits_or_none() {
    for text in [ST_VENANT, SMOOTH, NEO_HOOKE] {
        let model = model(text);
        // With lambda = mu the stable energy of a body pressed to nothing happens to vanish.
        for ratio in [2.0, 1e8] {
            let values = values(&model, 3, &[("lambda", ratio), ("mu", 1.0)]);
            let written = model.written_gradient(&values);
            for (name, gradient) in extreme_gradients() {
                let change = plus_identity(&gradient, -1.0);
                let sample = Sample { gradient, change, direction: DIRECTION.to_vec() };
                let label = format!("{} {ratio:e} {name}", model.name());
                for level in Level::ALL {
                    let found = at(&model, &values, &sample, level);
                    match truth(&written, &sample) {
                        Some(truth) => close(&label, &found, &truth),
                        None => {
                            assert_eq!(model.name(), "nh", "{label}");
                            assert!(found.iter().all(|x| !x.is_finite()), "{label}: {found:?}");
                        }
                    }
                }
            }
        }
    }
}

/// Equal principal stretches, and such that differ in some digit, are no special case.
#[test]
fn equal_stretches_lose_no_digits() {
    // Turned about two axes.
    let rotation = [0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6];
    for text in [HENCKY, OGDEN, BIOT] {
        let model = model(text);
        let values = values(&model, 3, &[]);
        let written = model.written_gradient(&values);
        for size in [0.5, 1.0, 2.0, 5.0] {
            for apart in [0.0, 1e-15, 1e-12, 1e-8, 1e-4, 0.1] {
                // Turned without a strain there is nothing but rounding.
                for turned in [false, true].into_iter().filter(|turned| !turned || size != 1.0) {
                    let stretches = [size, size * (1.0 + apart), size * (1.0 + 3.0 * apart)];
                    let gradient: Vec<f64> = (0..9)
                        .map(|k| match turned {
                            true => rotation[k] * stretches[k % 3],
                            false if k / 3 == k % 3 => stretches[k / 3],
                            false => 0.0,
                        })
                        .collect();
                    let change = plus_identity(&gradient, -1.0);
                    let sample = Sample { gradient, change, direction: DIRECTION.to_vec() };
                    let label = format!("{} {size} {apart:e} {turned}", model.name());
                    let truth = truth(&written, &sample).unwrap();
                    for level in Level::ALL {
                        close(&label, &at(&model, &values, &sample, level), &truth);
                    }
                }
            }
        }
    }
}

const DIRECTION: [f64; 9] = [0.5, 0.25, -0.125, 1.0, -0.5, 0.75, 0.375, -1.0, 0.625];

/// The second energy at a gradient against true values of the first.
fn the_same(texts: [&str; 2], name: &str, gradient: Vec<f64>) {
    let [first, second] = texts.map(model);
    let change = plus_identity(&gradient, -1.0);
    let sample = Sample { gradient, change, direction: DIRECTION.to_vec() };
    let truth = truth(&first.written_gradient(&values(&first, 3, &[])), &sample).unwrap();
    for level in Level::ALL {
        close(name, &at(&second, &values(&second, 3, &[]), &sample, level), &truth);
    }
}

#[test]
fn powers_of_the_stretch_are_those_of_products() {
    let by_strain = "potential p\npsi(F) = E : E + tr(E)^2 + tr(C*C*C)";
    let by_stretch = "potential p\npsi(F) = tr((U^2 - I)^2)/4 + tr(U^2 - I)^2/4 + tr(U^6)";
    for (name, gradient) in extreme_gradients() {
        the_same([by_strain, by_stretch], name, gradient);
    }
    // Isochoric powers 2 and -2 are Mooney's and Rivlin's.
    let ogden = "potential p
dimensions 3
psi(F) = 0.3*(J^(-2/3)*tr(U^2) - 3) + 0.7*(J^(2/3)*tr(U^-2) - 3) + 11/2*(J - 1)^2";
    let gradient = [0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6];
    let gradient = (0..9).map(|k| gradient[k] * [0.8, 1.3, 1.1][k % 3]).collect();
    the_same([MOONEY, ogden], "ogden", gradient);
    the_same([MOONEY, ogden], "ogden", vec![1.02, 0.01, 0.0, -0.03, 0.97, 0.02, 0.01, 0.0, 1.04]);
}

/// psi, P and dP within 64 u of their norms.
fn close(label: &str, found: &[f64], truth: &[f64]) {
    close_to(label, found, truth, 64.0);
}

/// Within a tolerance in u.
fn close_to(label: &str, found: &[f64], truth: &[f64], tolerance: f64) {
    let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    for (what, part) in [("psi", 0..1), ("P", 1..10), ("dP", 10..19)] {
        let difference: Vec<f64> = part.clone().map(|k| found[k] - truth[k]).collect();
        let size = norm(&truth[part]) * f64::EPSILON / 2.0;
        let error = norm(&difference) / size.max(f64::MIN_POSITIVE);
        println!("{label} {what}: {error:.1} u");
        assert!(error <= tolerance, "{label} {what}: {error} u");
    }
}

/// A mirror has no strain, and no rotation is near it; bodies beside it in a block are turned back.
#[test]
fn mirrors_are_evaluated_as_they_are() {
    for d in [2, 3] {
        for (psi, value) in [("E : E", Some(0.0)), ("tr(C) - d - 2*ln(J)", None)] {
            let model = model(&format!("potential p\npsi(F) = {psi} + 0.25*(J + 1)^2"));
            let compiled =
                model.compile(&values(&model, d, &[]), Mode::Interpreter, Form::Accurate);
            let kernel = compiled.unwrap().gradient.unwrap();
            // A mirror, then a quarter of a turn: component by component.
            let [mut gradient, mut change] = [vec![0.0; 2 * d * d], vec![0.0; 2 * d * d]];
            for k in 0..d * d {
                let (i, j) = (k / d, k % d);
                let unit = f64::from(u8::from(i == j));
                let turned = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]][i][j];
                gradient[2 * k] = if k == 0 { -1.0 } else { unit };
                gradient[2 * k + 1] = turned;
                change[2 * k] = gradient[2 * k] - unit;
                change[2 * k + 1] = turned - unit;
            }
            let at = GradientBatch { n: 2, gradient: &gradient, change: &change, fields: &[] };
            let (mut psi, mut stress) = ([0.0; 2], vec![0.0; 2 * d * d]);
            kernel.evaluate(at, &mut psi, &mut stress);
            match value {
                Some(value) => assert_eq!(psi[0], value, "{d}"),
                None => assert!(psi[0].is_nan(), "{d}: {psi:?}"),
            }
            assert!((psi[1] - 1.0).abs() < 1e-15, "{d}: {psi:?}");
        }
    }
}
