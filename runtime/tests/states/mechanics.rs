//! Derivatives, momentum, rotations, threads.

use piola_compiler::verify::{Subject, verify};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Batch, Law, Order, Outputs};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::states::StateEnergy;
use std::sync::Arc;

use crate::common::{cloud, displacements, error, h_of, largest};
use crate::{energy, laws, library, solid, values};

/// Energies of points and bonds, mixed with each other; in any dimension.
const EVERYTHING: &str = "potential everything
parameter c = 1
w(L) = exp(-L/delta)
m = integral(w*L^2)
s = integral(w*(l - L)*L)/m
q = integral(w*ln(l/L)^2)/m
k = 1 + s
psi(s, q) = c*s^2 + exp(s)*q/(1 + q)
psi(l, s, m) = (1 + s^2)*(l - L)^2/m + w*s*(l/L - 1)^3 + 0.3*(l - L)^2/L + 0.1*ln(l/L)^2
";

/// A name, a text, parameters, and dimensions.
type Material = (&'static str, String, Vec<(&'static str, f64)>, Vec<usize>);

fn subjects() -> Vec<Material> {
    let moduli = vec![("K", 2.0), ("G", 0.7)];
    let logarithmic = library("logarithmic_states");
    vec![
        ("solid", solid("1/L"), moduli.clone(), vec![5, 4, 4]),
        ("solid, 1", solid("1"), moduli.clone(), vec![4, 4, 4]),
        ("logarithmic", logarithmic.clone(), moduli.clone(), vec![4, 4, 4]),
        ("logarithmic in the plane", logarithmic, moduli, vec![7, 6]),
        ("everything", EVERYTHING.into(), Vec::new(), vec![4, 4, 3]),
        ("everything in the plane", EVERYTHING.into(), Vec::new(), vec![7, 6]),
    ]
}

#[test]
fn forces_and_products_are_derivatives_of_the_energy() {
    for (name, text, parameters, counts) in subjects() {
        let d = counts.len();
        let body = cloud(&counts, 3);
        let energy = energy(&text, &parameters, &body, 2.3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        let p = displacements(&body, &h_of(d), 1.0, 9);
        let n = u.len();
        let at = |t: f64| -> Vec<f64> { u.iter().zip(&p).map(|(u, p)| u + t * p).collect() };
        let gradient = |u: &[f64]| {
            let mut gradient = vec![0.0; n];
            energy.forces(u, &mut gradient).unwrap();
            gradient
        };
        let h = 1e-5;
        let total = |t: f64| energy.energy(&at(t)).unwrap().total();
        let f = gradient(&u);
        let slope: f64 = f.iter().zip(&p).map(|(f, p)| f * p).sum();
        let differences = (total(h) - total(-h)) / (2.0 * h);
        assert!((differences / slope - 1.0).abs() < 2e-9, "{name}: {slope} {differences}");
        let mut product = vec![0.0; n];
        energy.hessian(&u).unwrap().multiply(&p, &mut product);
        let (after, before) = (gradient(&at(h)), gradient(&at(-h)));
        let steps: Vec<f64> = after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * h)).collect();
        assert!(error(&product, &steps) < 2e-9, "{name}: {:e}", error(&product, &steps));
        // The stored tangent says the same, and its diagonal too.
        let pattern = Arc::clone(energy.pattern());
        let blocks = vec![0.0; pattern.n_blocks() * d * d];
        let mut tangent = BlockMatrix { pattern: Arc::clone(&pattern), values: blocks };
        let (mut again, mut diagonal) = (vec![0.0; n], vec![0.0; n * d]);
        energy.tangent(&u, &mut again, &mut tangent).unwrap();
        let stored = tangent.multiply(&p);
        assert!(error(&stored, &product) < 6e-15, "{name}: {:e}", error(&stored, &product));
        energy.tangent_diagonal(&u, &mut again, &mut diagonal).unwrap();
        let own: Vec<f64> = pattern.row_start[..body.n_points()]
            .iter()
            .flat_map(|&start| tangent.values[start * d * d..(start + 1) * d * d].to_vec())
            .collect();
        assert!(diagonal == own, "{name}: {:e}", error(&diagonal, &own));
        assert_eq!(again, f);
    }
}

#[test]
fn forces_sum_to_zero_turn_nothing_and_rotate_with_the_body() {
    for (name, text, parameters, counts) in subjects() {
        let d = counts.len();
        let body = cloud(&counts, 3);
        let energy = energy(&text, &parameters, &body, 2.3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        let mut f = vec![0.0; u.len()];
        let before = energy.forces(&u, &mut f).unwrap().total();
        let x: Vec<f64> = u.iter().zip(body.positions()).map(|(u, x)| x + u).collect();
        for r in 0..d {
            let sum: f64 = f.iter().skip(r).step_by(d).sum();
            assert!(sum.abs() < 1.5e-14 * largest(&f), "{name}: {sum:e}");
            for s in 0..r {
                let points = x.chunks_exact(d).zip(f.chunks_exact(d));
                let turn: f64 = points.map(|(x, f)| x[r] * f[s] - x[s] * f[r]).sum();
                assert!(turn.abs() < 4e-15 * largest(&f) * largest(&x), "{name}: {turn:e}");
            }
        }
        let (sine, cosine) = (libm::sin(0.7), libm::cos(0.7));
        let rotated = |x: &[f64]| -> Vec<f64> {
            let turn = |x: &[f64]| {
                let mut x = x.to_vec();
                (x[0], x[1]) = (cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1]);
                x
            };
            x.chunks_exact(d).flat_map(turn).collect()
        };
        let moved: Vec<f64> =
            rotated(&x).iter().zip(body.positions()).map(|(x, rest)| x - rest).collect();
        let mut turned = vec![0.0; u.len()];
        let after = energy.forces(&moved, &mut turned).unwrap().total();
        assert!((after / before - 1.0).abs() < 3e-15, "{name}");
        assert!(error(&turned, &rotated(&f)) < 2.5e-14, "{name}");
    }
}

#[test]
fn the_bits_do_not_depend_on_threads() {
    for (name, text, parameters, counts) in subjects() {
        let d = counts.len();
        let body = cloud(&counts, 3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let energy = energy(&text, &parameters, &body, 2.3);
                let (mut f, mut product) = (vec![0.0; u.len()], vec![0.0; u.len()]);
                let parts = energy.forces(&u, &mut f).unwrap();
                energy.hessian(&u).unwrap().multiply(&f, &mut product);
                (parts.total().to_bits(), f, product)
            })
        };
        assert!(run(1) == run(2) && run(1) == run(5), "{name}");
    }
}

#[test]
fn products_do_not_depend_on_what_was_asked_before() {
    for (name, text, parameters, counts) in subjects() {
        let d = counts.len();
        let body = cloud(&counts, 3);
        let kept = energy(&text, &parameters, &body, 2.3);
        let p = displacements(&body, &h_of(d), 1.0, 9);
        let fields = [5, 6, 5].map(|seed| displacements(&body, &h_of(d), 0.05, seed));
        let hessians = fields.each_ref().map(|u| kept.hessian(u).unwrap());
        for (u, hessian) in fields.iter().zip(&hessians).flat_map(|both| [both, both]) {
            let (mut found, mut expected) = (vec![0.0; u.len()], vec![0.0; u.len()]);
            hessian.multiply(&p, &mut found);
            let fresh = energy(&text, &parameters, &body, 2.3);
            fresh.hessian(u).unwrap().multiply(&p, &mut expected);
            assert!(found == expected && found.iter().any(|x| *x != 0.0), "{name}");
        }
    }
}

#[test]
fn energies_that_are_not_finite_name_their_point() {
    // Beyond a third of stretch the logarithm has no value.
    let text = "potential broken\nm = integral(L^2)\npsi(l, m) = ln(4/3 - l/L)*L/m\n";
    let body = cloud(&[5, 4, 4], 3);
    let energy = energy(text, &[], &body, 1.8);
    let mut u = vec![0.0; 3 * body.n_points()];
    let point = body.n_points() / 2;
    u[3 * point] = 1.5;
    let found = energy.forces(&u, &mut vec![0.0; u.len()]).unwrap_err();
    let near = energy.neighborhood().row(point);
    let named = found.points[0];
    assert!(named == point || near.contains(named as u32), "{found:?}");
    // The energy alone, without its slopes, names the same one.
    assert_eq!(energy.energy(&u).unwrap_err().points, found.points);
    assert!(energy.hessian(&u).is_err());
    assert!(energy.energy(&vec![0.0; u.len()]).is_ok());
}

/// At rest psi and psi' of a bond vanish and psi'' is infinite: of all bonds only one is at rest.
#[test]
fn products_that_are_not_finite_name_their_point() {
    let text = "potential pointed\nm = integral(L^2)\npsi(l, m) = L*abs(l/L - 1)^1.5/m\n";
    let body = cloud(&[5, 4, 4], 3);
    let energy = energy(text, &[], &body, 1.8);
    let mut u = displacements(&body, &h_of(3), 0.05, 5);
    let one = body.n_points() / 2;
    let other = energy.neighborhood().upper(one).last().unwrap() as usize;
    [one, other].into_iter().for_each(|point| u[3 * point..3 * point + 3].fill(0.0));
    energy.forces(&u, &mut vec![0.0; u.len()]).unwrap();
    let Err(found) = energy.hessian(&u) else { panic!("psi'' of a bond is infinite") };
    // Rows of the two ends are not finite, the first is named.
    assert_eq!(found.points, vec![one], "{found:?} {other}");
    assert_eq!(found.displacements, vec![0.0; 3]);
}

#[test]
fn springs_like_the_tangent_are_positive() {
    for (name, text, parameters, counts) in subjects() {
        let d = counts.len();
        let body = cloud(&counts, 3);
        let energy = energy(&text, &parameters, &body, 2.3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        let pattern = Arc::clone(energy.bond_pattern().unwrap());
        let values = vec![0.0; pattern.n_blocks() * d * d];
        let mut springs = BlockMatrix { pattern, values };
        energy.springs(&u, &mut springs);
        for seed in 0..5 {
            let p = displacements(&body, &vec![0.0; d * d], 1.0, 20 + seed);
            let mut product = vec![0.0; u.len()];
            energy.hessian(&vec![0.0; u.len()]).unwrap().multiply(&p, &mut product);
            let work = |q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
            let ratio = work(&springs.multiply(&p)) / work(&product);
            assert!(ratio > 0.2 && ratio < 5.0, "{name}: {ratio}");
        }
    }
}

/// Strains of any order in energies of bonds, of gathered values beside them.
#[test]
fn strains_of_bonds_with_gathered_values_have_their_derivatives() {
    let text = "potential strained
m = integral(L^2)
s = integral((l - L)*L)/m
psi(l, s) = (((l/L)^3 - 1)^2 + s*((l/L)^-1 - 1)^2 + s^2*ln(l/L)^2)*L/m
";
    let (model, values) = values(text, &[], 3, 1.3);
    let (found, _) = verify(&model, &values, 200).unwrap();
    assert!(found.len() == 1 && found[0].passed(), "{found:?}");
}

#[test]
fn derivatives_are_verified_against_hyper_dual_numbers() {
    for (name, text, parameters, counts) in subjects() {
        let (model, values) = values(&text, &parameters, counts.len(), 1.3);
        let (found, _) = verify(&model, &values, 200).unwrap();
        let gathered = found.iter().filter(|found| matches!(found.subject, Subject::Gathered(_)));
        assert_eq!(gathered.count(), 2, "{name}");
        assert!(found.iter().all(|found| found.passed()), "{name}: {found:?}");
    }
}

/// An integrand of which nothing is known.
struct Opaque(Box<dyn Law>);

impl Law for Opaque {
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        self.0.evaluate(batch, order, out);
    }
}

#[test]
fn integrals_that_do_not_change_are_gathered_once() {
    for (name, text, parameters, counts) in subjects() {
        let d = counts.len();
        let body = cloud(&counts, 3);
        let known = laws(&text, &parameters, d, 2.3);
        let constant = known.integrals.iter().filter(|law| law.is_constant()).count();
        assert_eq!(constant, 1, "{name}: the weighted volume");
        let mut unknown = laws(&text, &parameters, d, 2.3);
        let integrals = unknown.integrals.into_iter();
        unknown.integrals = integrals.map(|g| Box::new(Opaque(g)) as Box<dyn Law>).collect();
        let u = displacements(&body, &h_of(d), 0.05, 5);
        let p = displacements(&body, &h_of(d), 1.0, 9);
        let all = |laws| {
            let energy = StateEnergy::new(Arc::clone(&body), 2.3, laws).unwrap();
            let (mut forces, mut product) = (vec![0.0; u.len()], vec![0.0; u.len()]);
            let parts = energy.forces(&u, &mut forces).unwrap();
            energy.hessian(&u).unwrap().multiply(&p, &mut product);
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            energy.tangent(&u, &mut forces, &mut tangent).unwrap();
            [vec![parts.total()], energy.integrals(&u), forces, product, tangent.values]
        };
        // The same terms in another order, of at most two hundred neighbours.
        for (one, other) in all(known).iter().zip(all(unknown)) {
            let largest = other.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            let off = one.iter().zip(&other).map(|(x, y)| (x - y).abs());
            assert!(off.fold(0.0, f64::max) < 200.0 * f64::EPSILON * largest, "{name}");
        }
    }
}
