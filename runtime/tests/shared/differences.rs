//! Products by differences of forces against exact ones, for any kind of energy.

use piola_runtime::energy::{Energy, Products, Total};
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearError, LinearMethod, LinearOptions};
use piola_runtime::solve::newton::{Newton, NewtonReport, NewtonSettings};

/// Both differences, and the power of the unit roundoff by which they err.
pub(crate) const DIFFERENCES: [(Products, f64); 2] =
    [(Products::OneSided, 1.0 / 2.0), (Products::Central, 2.0 / 3.0)];

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    norm(&x.iter().zip(y).map(|(x, y)| x - y).collect::<Vec<f64>>()) / norm(y)
}

/// The relative error of a product at `u` with `p`.
fn error(energy: &dyn Energy, products: Products, u: &[f64], p: &[f64]) -> f64 {
    let (mut found, mut exact) = (vec![f64::NAN; p.len()], vec![0.0; p.len()]);
    let differences = Total::of(energy).with_products(products);
    differences.hessian(u).unwrap().multiply(p, &mut found);
    energy.hessian(u).unwrap().multiply(p, &mut exact);
    distance(&found, &exact)
}

/// Errors are of the order that they should be, whatever the units of length and of force: `make`
/// gives the same body, displacements and direction with lengths and moduli multiplied.
pub(crate) fn units_do_not_matter<E: Energy>(make: impl Fn(f64, f64) -> (E, Vec<f64>, Vec<f64>)) {
    for (products, power) in DIFFERENCES {
        let of = |length: f64, modulus: f64| {
            let (energy, u, p) = make(length, modulus);
            error(&energy, products, &u, &p)
        };
        let expected = of(1.0, 1.0);
        let order = libm::pow(f64::EPSILON / 2.0, power);
        println!("{products:?}: {expected:.1e} of {order:.1e}");
        assert!((0.01 * order..20.0 * order).contains(&expected), "{products:?} {expected:e}");
        for (length, modulus) in [(1e-9, 1.0), (1.0, 1e9), (1e6, 1e-9)] {
            let ratio = of(length, modulus) / expected;
            assert!((0.8..1.25).contains(&ratio), "{products:?} {length:e} {modulus:e}: {ratio}");
        }
    }
}

/// The points of the lower fifth along x are held, and forces keep the others at `u`.
fn solve(energy: &dyn Energy, u: &[f64], method: LinearMethod) -> (Vec<f64>, NewtonReport, Judged) {
    let d = energy.dimension();
    let along: Vec<f64> = energy.positions().iter().step_by(d).copied().collect();
    let low = along.iter().fold(f64::INFINITY, |least, x| least.min(*x));
    let high = along.iter().fold(f64::NEG_INFINITY, |most, x| most.max(*x));
    let held = |dof: &usize| along[dof / d] <= low + 0.2 * (high - low);
    let fixed: Vec<usize> = (0..u.len()).filter(held).collect();
    let constraints = Constraints::new(u.len(), &fixed).unwrap();
    let mut loads = vec![0.0; u.len()];
    energy.forces(u, &mut loads).unwrap();
    let mut found = vec![0.0; u.len()];
    fixed.iter().for_each(|&dof| (found[dof], loads[dof]) = (u[dof], 0.0));
    let options = LinearOptions { method, ..LinearOptions::default() };
    let mut newton = Newton::new(energy, &constraints, NewtonSettings::default(), options).unwrap();
    let report = newton.solve(&mut found, &loads).unwrap();
    let positive_definite = newton.judge().unwrap().positive_definite;
    let condition = newton.condition().unwrap();
    (found, report, Judged { positive_definite, condition })
}

/// What is known of the tangent at the end.
struct Judged {
    positive_definite: Option<bool>,
    condition: Option<f64>,
}

/// Differences lead to the equilibrium that exact products lead to, that is `u`.
pub(crate) fn equilibria_are_the_same(energy: &dyn Energy, u: &[f64]) {
    let (exact, report, judged) = solve(energy, u, LinearMethod::Auto);
    // Measured are 7.8e-15, and 1.8e-14 for the differences.
    assert!(distance(&exact, u) < 4e-14, "{:e}", distance(&exact, u));
    assert_eq!(judged.positive_definite, Some(true));
    let iterations = report.iterations;
    let gmres = solve(energy, u, LinearMethod::Gmres);
    assert_eq!(gmres.1.iterations, iterations);
    for (products, _) in DIFFERENCES {
        let differences = Total::of(energy).with_products(products);
        for method in [LinearMethod::Auto, LinearMethod::Gmres, LinearMethod::MatrixFree] {
            let (found, report, judged) = solve(&differences, u, method);
            let ratio = report.history.residual_over_reaction.last().unwrap();
            println!("{products:?} {method:?}: {} of {iterations}, {ratio:.1e}", report.iterations);
            assert!(distance(&found, &exact) < 9e-14, "{products:?} {method:?}");
            assert!(report.iterations <= iterations + 1, "{products:?} {method:?}");
            let by_gmres = method != LinearMethod::MatrixFree;
            let by = report.linear.iter().all(|l| (l.method == LinearMethod::Gmres) == by_gmres);
            assert!(by, "{products:?} {method:?}");
            // GMRES see no signs, and nothing else that would tell of the tangent.
            assert_eq!(judged.positive_definite.is_none(), by_gmres);
            assert_eq!(judged.condition.is_none(), by_gmres);
        }
        let constraints = Constraints::new(u.len(), &[0]).unwrap();
        let options = LinearOptions { method: LinearMethod::Cholesky, ..LinearOptions::default() };
        let refused = Newton::new(&differences, &constraints, NewtonSettings::default(), options);
        assert_eq!(refused.err(), Some(LinearError::ProductsOnly { method: "Cholesky" }));
    }
}

/// One, two and four threads leave the same bits.
pub(crate) fn bits_do_not_depend_on_threads(energy: &dyn Energy, u: &[f64]) {
    for (products, _) in DIFFERENCES {
        let differences = Total::of(energy).with_products(products);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| solve(&differences, u, LinearMethod::Gmres).0)
        };
        let one = run(1);
        assert!(one == run(2) && one == run(4), "{products:?}");
    }
}
