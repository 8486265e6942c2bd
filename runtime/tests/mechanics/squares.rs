//! Elements that take a measure by its square, `q = m^2/M`: the same bodies as by the measure itself.

use std::sync::Arc;

use piola_compiler::{Form, Kernel, Level, Mode, Model, Setting, Values, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Batch, Law, Measure, Order, Outputs};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{cloud, displacements, distance};

const FAST: Mode = Mode::Jit(Level::Fast);

/// Energies of lengths and areas that are functions of squares.
fn even(n: f64) -> String {
    format!(
        "potential p\nS(x) = (x^({n:?}) - 1)/({n:?})\n\
         psi(l) = 1/2*L*S(l/L)^2\npsi(a) = 150*A*S(a/A)^2\n"
    )
}

fn kernels(text: &str, dimension: usize, mode: Mode) -> Vec<Kernel> {
    let (_, model): (_, Model) = check_text(text).unwrap();
    let settings: [(String, Setting); 0] = [];
    let values: Values = model.values(dimension, &settings, Some(0.3)).unwrap();
    model.compile(&values, mode, Form::Accurate).unwrap().kernels
}

/// A kernel as a law that does not tell of its squares.
fn by_measure(kernel: Kernel) -> Box<dyn Law> {
    Box::new(move |batch: Batch<'_>, order: Order, out: Outputs<'_>| {
        kernel.evaluate(batch, order, out);
    })
}

fn energy(
    body: &Arc<Body>,
    horizon: f64,
    kernels: Vec<Kernel>,
    boxed: impl Fn(Kernel) -> Box<dyn Law>,
) -> DiscreteEnergy {
    let mut laws = Laws::default();
    for kernel in kernels {
        match kernel.measure() {
            Measure::Length => laws.bond = Some(boxed(kernel)),
            Measure::Area => laws.triangle = Some(boxed(kernel)),
            Measure::Volume => laws.tetrahedron = Some(boxed(kernel)),
        }
    }
    DiscreteEnergy::new(Arc::clone(body), horizon, Weights::Unit, laws).unwrap()
}

fn by_square(kernel: Kernel) -> Box<dyn Law> {
    Box::new(kernel)
}

struct State {
    energy: f64,
    gradient: Vec<f64>,
    tangent: Vec<f64>,
}

fn state(energy: &DiscreteEnergy, u: &[f64]) -> State {
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let parts = energy.tangent(u, &mut gradient, &mut tangent).unwrap();
    State { energy: parts.total(), gradient, tangent: tangent.values }
}

/// Errors of energy, gradient and tangent.
fn errors(found: &State, expected: &State) -> [f64; 3] {
    [
        (found.energy / expected.energy - 1.0).abs(),
        distance(&found.gradient, &expected.gradient),
        distance(&found.tangent, &expected.tangent),
    ]
}

fn body(dimension: usize) -> Arc<Body> {
    cloud(if dimension == 2 { &[9, 6] } else { &[6, 4, 4] }, 0.1, 7)
}

#[test]
fn bodies_are_those_of_measures_and_of_hyper_dual_numbers() {
    for dimension in [2, 3] {
        let body = body(dimension);
        for n in [2.0, -2.0, 4.0] {
            let text = even(n);
            let kernels = |mode| kernels(&text, dimension, mode);
            let squared = kernels(FAST).iter().filter(|k| k.squared().is_some()).count();
            assert_eq!(squared, dimension - 1, "lengths, and areas in space");
            let squares = energy(&body, 0.21, kernels(FAST), by_square);
            let measures = energy(&body, 0.21, kernels(FAST), by_measure);
            let written = energy(&body, 0.21, kernels(Mode::HyperDual), by_square);
            // As written an energy loses u/strain: measured are 2.4e-15, 1.2e-13, 1.1e-10, and 3.1e-16
            // between squares and measures.
            for (strain, bar) in [(0.05, 1e-14), (1e-3, 5e-13), (1e-6, 5e-10)] {
                let u = displacements(&body, strain, 11);
                let found = state(&squares, &u);
                let error = errors(&found, &state(&measures, &u));
                assert!(
                    error.iter().all(|x| *x <= 1.5e-15),
                    "{dimension}, {n}, {strain}: {error:?}"
                );
                let error = errors(&found, &state(&written, &u));
                assert!(error.iter().all(|x| *x <= bar), "{dimension}, {n}, {strain}: {error:?}");
            }
        }
    }
}

#[test]
fn forces_of_tiny_strains_keep_their_digits() {
    for dimension in [2, 3] {
        let body = body(dimension);
        let energy = energy(&body, 0.21, kernels(&even(2.0), dimension, FAST), by_square);
        let unit = displacements(&body, 1.0, 9);
        let forces = |strain: f64| -> Vec<f64> {
            let u: Vec<f64> = unit.iter().map(|x| x * strain).collect();
            state(&energy, &u).gradient.iter().map(|force| force / strain).collect()
        };
        let expected = forces(1e-14);
        for strain in [1e-10, 1e-20, 1e-100] {
            let error = distance(&forces(strain), &expected);
            assert!(error <= 10.0 * strain + 1e-13, "strain {strain:e}: {error:e}");
        }
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let body = body(3);
    let energy = energy(&body, 0.21, kernels(&even(2.0), 3, FAST), by_square);
    let u = displacements(&body, 0.05, 11);
    let bits = |threads: usize| -> Vec<u64> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let State { energy, gradient, tangent } = pool.install(|| state(&energy, &u));
        [vec![energy], gradient, tangent].concat().into_iter().map(f64::to_bits).collect()
    };
    let expected = bits(1);
    assert!(bits(2) == expected && bits(3) == expected);
}

/// Three points, two of which meet: a bond and the triangle collapse.
fn meeting() -> (Arc<Body>, [f64; 9]) {
    let body = Arc::new(Body::new(3, &[0., 0., 0., 1., 0., 0., 0., 1., 0.], &[1.0; 3], None));
    // Sorted along x, the user's point 1 comes last.
    (body, [0., 0., 0., 0., 0., 0., -1., 0., 0.])
}

#[test]
fn a_measure_of_zero_is_a_number_like_any_other() {
    let (body, mut u) = meeting();
    let energy = energy(&body, 2.0, kernels(&even(2.0), 3, FAST), by_square);
    let at_zero = state(&energy, &u);
    assert!(at_zero.gradient.iter().chain(&at_zero.tangent).all(|x| x.is_finite()));
    u[6..].copy_from_slice(&[-1.0 + 1e-9, 2e-9, 1e-9]);
    let near = state(&energy, &u);
    // The triangle is stiff: it pulls with 1.5e-7 there.
    assert!(distance(&at_zero.gradient, &near.gradient) < 2e-6);
    assert!(distance(&at_zero.tangent, &near.tangent) < 1e-8);
}

#[test]
fn what_is_refused_is_told_as_a_measure() {
    let (body, u) = meeting();
    let infinite = "potential p\npsi(l) = L^3/l^2\n";
    let error = energy(&body, 2.0, kernels(infinite, 3, FAST), by_square).energy(&u).unwrap_err();
    assert_eq!((error.points, error.value, error.reference), (vec![0, 2], 0.0, 1.0));

    // Not a number below half the length, and below half the area.
    let body = Arc::new(Body::new(3, &[0., 0., 0., 3., 0., 0., 0., 2., 0.], &[1.0; 3], None));
    let mut u = [0.0; 9];
    u[6] = -1.8;
    for (psi, value, reference) in [
        ("psi(l) = L*ln(l^2/L^2 - 1/4)", 1.2, 3.0),
        ("psi(l) = L^3/l^2\npsi(a) = A*ln(a^2/A^2 - 1/4)", 2.4, 6.0),
    ] {
        let kernels = kernels(&format!("potential p\n{psi}\n"), 3, FAST);
        assert!(kernels.iter().all(|kernel| kernel.squared().is_some()));
        let error = energy(&body, 4.0, kernels, by_square).energy(&u).unwrap_err();
        assert!((error.value / value - 1.0).abs() < 1e-15, "{psi}: {}", error.value);
        assert_eq!(error.reference, reference, "{psi}");
    }
}
