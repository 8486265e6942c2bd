//! What points gather of vectors, for an energy that uses all there is: derivatives, momentum, shares, threads,
//! lost bonds.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::vectors::{VectorEnergy, VectorLaws};

use crate::common::{cloud, displacements, error, h_of, largest};

/// Odd integrands, functions of integrals that are not linear and hold each other, scalars beside tensors, what both
/// ends gather, and a direction that no rotation of the body turns: not objective.
const EVERYTHING: &str = "potential everything
parameter c = 0.3
w(L) = exp(-L/delta)
n = if d == 3 then vector(0.48, 0.6, 0.64) else vector(0.6, 0.8)
m = integral(w*L^2)
K = integral(w*dyad(Xi, Xi))
H = integral(w*dyad(xi - Xi, Xi))*inv(K)
q = integral(w*(l/L)*(n*xi)*xi)/m
S = dyad(q)*(1 + tr(H)^2)
s = integral(w*(l - L)*L)/m
psi(H, S, s) = tr(H'*H) + c*(H : S) + exp(s)*s^2 + (q*q)^2
z = xi - Xi - H*Xi
psi(xi, H, s, q) = w*(z*z + c*(z*neighbour(q))^2 + (l/L - 1)^2*(1 + s*neighbour(s)) + c*(q - neighbour(q))*xi)
";

/// The same words in an energy that no rotation changes.
const OBJECTIVE: &str = "potential objective
parameter c = 0.3
w(L) = 1/L
K = integral(w*dyad(Xi, Xi))
G = integral(w*dyad(xi, Xi))*inv(K)
k = integral(w*xi)
C = G'*G
z = xi - (G + neighbour(G))*Xi/2
psi(C) = tr(dev(C)^2) + (det(C) - 1)^2
psi(xi, G, k) = w*(z*z + c*(k*neighbour(k)) + c*(k*xi)^2/L^2 + (norm(xi)/L - 1)^2)
";

/// The energy with two parts, points and bonds.
fn energy(text: &str, body: &Arc<Body>, horizon: f64, mode: Mode) -> VectorEnergy {
    let (_, model) = check_text(text).unwrap_or_else(|found| panic!("{found:?}"));
    let none: [(String, Setting); 0] = [];
    let values = model.values(body.dimension(), &none, Some(horizon)).unwrap();
    let kernels = model.compile(&values, mode, Form::Accurate).unwrap().vectors.unwrap();
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).unwrap());
    let arguments = ["points".to_string(), "bonds".to_string()];
    let laws = VectorLaws { of_law: vec![Some(kernels)], thickness: 1.0, arguments };
    VectorEnergy::new(Arc::clone(body), neighborhood, None, laws).unwrap()
}

const HORIZON: f64 = 2.3;
const FAST: Mode = Mode::Jit(Level::Fast);

/// A name, a text, a cloud.
fn subjects() -> Vec<(&'static str, &'static str, Vec<usize>)> {
    vec![
        ("everything in the plane", EVERYTHING, vec![7, 6]),
        ("everything", EVERYTHING, vec![4, 4, 3]),
        ("objective in the plane", OBJECTIVE, vec![7, 6]),
        ("objective", OBJECTIVE, vec![4, 4, 3]),
    ]
}

/// A body, displacements, a direction.
fn deformed(counts: &[usize]) -> (Arc<Body>, Vec<f64>, Vec<f64>) {
    let (body, d) = (cloud(counts, 3), counts.len());
    let u = displacements(&body, &h_of(d), 0.05, 5);
    let p = displacements(&body, &h_of(d), 1.0, 9);
    (body, u, p)
}

fn forces(energy: &dyn Energy, u: &[f64]) -> Vec<f64> {
    let mut forces = vec![0.0; u.len()];
    energy.forces(u, &mut forces).unwrap();
    forces
}

fn product(energy: &dyn Energy, u: &[f64], p: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; u.len()];
    energy.hessian(u).unwrap().multiply(p, &mut product);
    product
}

#[test]
fn forces_and_products_are_derivatives_of_the_energy() {
    for (name, text, counts) in subjects() {
        let (body, u, p) = deformed(&counts);
        let (d, energy) = (counts.len(), energy(text, &body, HORIZON, FAST));
        let at = |t: f64| -> Vec<f64> { u.iter().zip(&p).map(|(u, p)| u + t * p).collect() };
        // Central differences are off by h^2, and by 1e-16/h.
        let h = 1e-5;
        let total = |t: f64| energy.energy(&at(t)).unwrap().total();
        let f = forces(&energy, &u);
        let slope: f64 = f.iter().zip(&p).map(|(f, p)| f * p).sum();
        let differences = (total(h) - total(-h)) / (2.0 * h);
        assert!((differences / slope - 1.0).abs() < 1e-8, "{name}: {slope} {differences}");
        let along = product(&energy, &u, &p);
        let (after, before) = (forces(&energy, &at(h)), forces(&energy, &at(-h)));
        let steps: Vec<f64> = after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * h)).collect();
        assert!(error(&along, &steps) < 1e-8, "{name}: {:e}", error(&along, &steps));
        // The stored tangent says the same, and its diagonal too.
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let (mut again, mut diagonal) = (vec![0.0; u.len()], vec![0.0; u.len() * d]);
        energy.tangent(&u, &mut again, &mut tangent).unwrap();
        let stored = tangent.multiply(&p);
        println!("{name}: stored {:.1e}", error(&stored, &along));
        assert!(error(&stored, &along) < 1e-13, "{name}: {:e}", error(&stored, &along));
        energy.tangent_diagonal(&u, &mut again, &mut diagonal).unwrap();
        let pattern = energy.pattern();
        let own: Vec<f64> = pattern.row_start[..body.n_points()]
            .iter()
            .flat_map(|&start| tangent.values[start * d * d..(start + 1) * d * d].to_vec())
            .collect();
        assert!(error(&diagonal, &own) < 1e-14, "{name}: {:e}", error(&diagonal, &own));
        assert_eq!(again, f);
        // Second derivatives commute.
        let q = displacements(&body, &vec![0.0; d * d], 1.0, 21);
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        let (one, other) = (dot(&q, &along), dot(&p, &product(&energy, &u, &q)));
        assert!((one - other).abs() < 1e-13 * largest(&along) * u.len() as f64, "{name}");
    }
}

#[test]
fn forces_sum_to_zero_and_those_of_objective_energies_turn_nothing() {
    for (name, text, counts) in subjects() {
        let (body, u, _) = deformed(&counts);
        let (d, energy) = (counts.len(), energy(text, &body, HORIZON, FAST));
        let f = forces(&energy, &u);
        let x: Vec<f64> = u.iter().zip(body.positions()).map(|(u, x)| x + u).collect();
        let mut turns = 0.0_f64;
        for r in 0..d {
            let sum: f64 = f.iter().skip(r).step_by(d).sum();
            assert!(sum.abs() < 3e-14 * largest(&f), "{name}: {sum:e}");
            for s in 0..r {
                let points = x.chunks_exact(d).zip(f.chunks_exact(d));
                let turn: f64 = points.map(|(x, f)| x[r] * f[s] - x[s] * f[r]).sum();
                turns = turns.max(turn.abs());
            }
        }
        let is_objective = turns < 3e-14 * largest(&f) * largest(&x);
        assert_eq!(is_objective, name.starts_with("objective"), "{name}: {turns:e}");
    }
}

#[test]
fn shares_are_the_energy_and_virials_what_they_change_by() {
    for (name, text, counts) in subjects() {
        let (body, u, _) = deformed(&counts);
        let (d, n) = (counts.len(), body.n_points());
        let energy = energy(text, &body, HORIZON, FAST);
        let shares = |u: &[f64]| {
            let mut shares = vec![0.0; n];
            energy.shares(u, &mut shares).unwrap();
            shares
        };
        let total = energy.energy(&u).unwrap().total();
        assert!((shares(&u).iter().sum::<f64>() / total - 1.0).abs() < 1e-14, "{name}");
        let mut virials = vec![0.0; n * d * d];
        energy.virials(&u, &mut virials).unwrap();
        let h = 1e-5;
        for component in 0..d * d {
            let (row, column) = (component / d, component % d);
            let moved = |h: f64| -> Vec<f64> {
                let mut u = u.clone();
                for (u, x) in u.chunks_exact_mut(d).zip(body.positions().chunks_exact(d)) {
                    u[row] += h * x[column];
                }
                u
            };
            let (after, before) = (shares(&moved(h)), shares(&moved(-h)));
            let steps: Vec<f64> =
                after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * h)).collect();
            let found: Vec<f64> = virials.iter().skip(component).step_by(d * d).copied().collect();
            assert!(error(&found, &steps) < 1e-7, "{name}: {:e}", error(&found, &steps));
        }
    }
}

/// Machine code at the strict level and the interpreter have the same bits for any number of threads; hyper-dual
/// numbers of what is written agree.
#[test]
fn ways_agree_and_bits_do_not_depend_on_threads() {
    for (name, text, counts) in subjects() {
        let (body, u, p) = deformed(&counts);
        let all = |mode: Mode, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = energy(text, &body, HORIZON, mode);
                let mut tangent = BlockMatrix::zeros(energy.pattern());
                let mut again = vec![0.0; u.len()];
                energy.tangent(&u, &mut again, &mut tangent).unwrap();
                [forces(&energy, &u), product(&energy, &u, &p), tangent.values]
            })
        };
        let strict = Mode::Jit(Level::Strict);
        let expected = all(strict, 1);
        assert!(all(strict, 3) == expected && all(Mode::Interpreter, 2) == expected, "{name}");
        for mode in [FAST, Mode::HyperDual] {
            for (found, expected) in all(mode, 2).iter().zip(&expected) {
                assert!(error(found, expected) < 1e-13, "{name}: {:e}", error(found, expected));
            }
        }
    }
}

/// A body that has lost bonds is one whose families never had them; what comes back is what was there.
#[test]
fn families_without_bonds_are_smaller_families() {
    for (name, text, counts) in subjects() {
        let (body, u, p) = deformed(&counts);
        let mut energy = energy(text, &body, HORIZON, FAST);
        let whole = [forces(&energy, &u), product(&energy, &u, &p)];
        let n_bonds = energy.neighborhood().n_bonds();
        let lost: Vec<usize> = (0..n_bonds).step_by(9).collect();
        energy.lose(&lost);
        let now = [forces(&energy, &u), product(&energy, &u, &p)];
        assert!(now[0] != whole[0]);
        // Central differences of what is left: off by h^2, and by 1e-16/h.
        let h = 1e-5;
        let at = |t: f64| -> Vec<f64> { u.iter().zip(&p).map(|(u, p)| u + t * p).collect() };
        let total = |t: f64| energy.energy(&at(t)).unwrap().total();
        let slope: f64 = now[0].iter().zip(&p).map(|(f, p)| f * p).sum();
        let differences = (total(h) - total(-h)) / (2.0 * h);
        assert!((differences / slope - 1.0).abs() < 1e-8, "{name}: {slope} {differences}");
        energy.regain(&lost);
        let again = [forces(&energy, &u), product(&energy, &u, &p)];
        assert!(again == whole, "{name}");
        // A point whose bonds do not span space is told; without any it has no force.
        let own: Vec<usize> = energy.neighborhood().bonds(0).collect();
        energy.lose(&own[1..]);
        assert_eq!(energy.singular(), [0], "{name}");
        assert!(forces(&energy, &u).iter().all(|x| x.is_finite()), "{name}");
        energy.lose(&own[..1]);
        assert_eq!(energy.singular(), [0], "{name}");
        assert!(forces(&energy, &u)[..counts.len()].iter().all(|x| *x == 0.0), "{name}");
        energy.regain(&own);
        assert!(energy.singular().is_empty() && forces(&energy, &u) == whole[0], "{name}");
    }
}

/// Near rest energies, forces and products keep their digits: strains of 1e-9 against the same times 2^20, of an energy
/// that is quadratic there to what is left of it.
#[test]
fn digits_are_kept_near_rest() {
    for (name, text, counts) in [
        ("nodal", include_str!("../../../examples/correspondence_as_text/nodal.piola"), vec![7, 6]),
        ("wan", include_str!("../../../examples/correspondence_as_text/wan.piola"), vec![4, 4, 3]),
        (
            "bond_quadrature",
            include_str!("../../../examples/correspondence_as_text/bond_quadrature.piola"),
            vec![7, 6],
        ),
    ] {
        let text = text.replace("lambda in Pa", "lambda = 1.2 in Pa");
        let text = text.replace("mu     in Pa", "mu = 0.8 in Pa");
        let (body, u, p) = deformed(&counts);
        let energy = energy(&text, &body, HORIZON, FAST);
        let rest = vec![0.0; u.len()];
        let scaled = |t: f64| -> Vec<f64> { u.iter().map(|u| t * u).collect() };
        let linear = product(&energy, &rest, &u);
        let t = 1e-9;
        let found: Vec<f64> = forces(&energy, &scaled(t)).iter().map(|f| f / t).collect();
        // What is left is of the order of the strain.
        println!("{name}: {:.1e}", error(&found, &linear));
        assert!(error(&found, &linear) < 10.0 * t, "{name}: {:e}", error(&found, &linear));
        let (near, at_rest) = (product(&energy, &scaled(t), &p), product(&energy, &rest, &p));
        assert!(error(&near, &at_rest) < 10.0 * t, "{name}");
        let energy_of = |t: f64| energy.energy(&scaled(t)).unwrap().total() / (t * t);
        let half: f64 = 0.5 * linear.iter().zip(&u).map(|(k, u)| k * u).sum::<f64>();
        assert!(
            (energy_of(t) / half - 1.0).abs() < 10.0 * t,
            "{name}: {:e}",
            energy_of(t) / half - 1.0
        );
    }
}
