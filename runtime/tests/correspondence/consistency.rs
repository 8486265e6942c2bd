//! Gradient, products, tangent and diagonal are derivatives of one energy, with the same bits for
//! any number of threads.
//!
//! The energy of St Venant-Kirchhoff material is a polynomial of fourth degree along every line:
//! differences over five points have no truncation error, whatever the step.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::influence::Constant;
use piola_runtime::deformation::{DeformationEnergy, Discretisation, Formulation, OperatorOrder};
use piola_runtime::energy::{Energy, Hessian};
use piola_runtime::kernel::{Variables, VariablesLaw};
use piola_runtime::matrix::BlockMatrix;

use crate::common::{
    DISCRETISATIONS, ORDERS, Random, cloud, displacements, energy, error, h_of, norm,
    st_venant_kirchhoff,
};

/// All combinations on a cloud in the plane and one in space.
fn for_each(check: impl Fn(&DeformationEnergy, &[f64], &str)) {
    for counts in [&[7, 6][..], &[4, 4, 4]] {
        let d = counts.len();
        let body = cloud(counts, 3);
        let u = displacements(&body, &h_of(d), 0.05, 5);
        for order in ORDERS {
            for discretisation in DISCRETISATIONS {
                for kernel in ["one", "cubic"] {
                    let horizon = if d == 2 { 3.2 } else { 2.8 };
                    let energy = energy(&body, horizon, order, discretisation, kernel);
                    check(&energy, &u, &format!("{d} {order:?} {discretisation:?} {kernel}"));
                }
            }
        }
    }
}

fn along(u: &[f64], p: &[f64], t: f64) -> Vec<f64> {
    u.iter().zip(p).map(|(u, p)| u + t * p).collect()
}

/// `f'(0)` of a polynomial of fourth degree.
fn derivative(f: impl Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let values = [-2.0, -1.0, 1.0, 2.0].map(f);
    let slope =
        |k: usize| (values[0][k] - values[3][k] + 8.0 * (values[2][k] - values[1][k])) / 12.0;
    (0..values[0].len()).map(slope).collect()
}

#[test]
fn products_do_not_depend_on_what_was_asked_before() {
    for_each(|kept, u, name| {
        let other: Vec<f64> = u.iter().map(|u| 1.1 * u).collect();
        let [here, there, fresh] = [u, &other, u].map(|u| kept.hessian(u).unwrap());
        let product = |hessian: &dyn Hessian| {
            let mut product = vec![0.0; u.len()];
            hessian.multiply(&other, &mut product);
            product
        };
        let (first, between, again) = (product(&*here), product(&*there), product(&*here));
        assert!(first == again && first == product(&*fresh) && first != between, "{name}");
    });
}

#[test]
fn the_gradient_is_the_derivative_of_the_energy() {
    for_each(|energy, u, name| {
        let p = displacements(energy.body(), &h_of(energy.dimension()), 0.03, 17);
        let mut gradient = vec![0.0; u.len()];
        let parts = energy.forces(u, &mut gradient).unwrap();
        assert_eq!(parts, energy.energy(u).unwrap(), "{name}");
        let slope: f64 = gradient.iter().zip(&p).map(|(g, p)| g * p).sum();
        let expected = derivative(|t| vec![energy.energy(&along(u, &p, t)).unwrap().total()])[0];
        assert!((slope / expected - 1.0).abs() < 8e-15, "{name}: {slope} {expected}");
    });
}

#[test]
fn products_are_derivatives_of_the_gradient() {
    for_each(|energy, u, name| {
        let p = displacements(energy.body(), &h_of(energy.dimension()), 0.03, 17);
        let mut product = vec![0.0; u.len()];
        energy.hessian(u).unwrap().multiply(&p, &mut product);
        let expected = derivative(|t| {
            let mut gradient = vec![0.0; u.len()];
            energy.forces(&along(u, &p, t), &mut gradient).unwrap();
            gradient
        });
        let error = error(&product, &expected);
        assert!(error < 2e-14, "{name}: {error:e}");
    });
}

#[test]
fn the_tangent_has_the_products_with_unit_vectors_as_columns() {
    for_each(|energy, u, name| {
        let (d, n) = (energy.dimension(), u.len());
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let mut gradient = vec![0.0; n];
        energy.tangent(u, &mut gradient, &mut tangent).unwrap();
        let mut dense = vec![0.0; n * n];
        tangent.entries().for_each(|(row, column, value)| dense[column * n + row] = value);
        let mut columns = Vec::with_capacity(n * n);
        for dof in 0..n {
            let mut unit = vec![0.0; n];
            unit[dof] = 1.0;
            let mut product = vec![0.0; n];
            energy.hessian(u).unwrap().multiply(&unit, &mut product);
            columns.extend(product);
        }
        // Coefficients of polynomials beyond the linear ones cancel more.
        let bars = if name.contains(" First ") { [5e-15, 1e-15] } else { [2e-14, 4e-15] };
        let wrong = error(&dense, &columns);
        assert!(wrong < bars[0], "{name}: {wrong:e}");
        let skew: Vec<f64> = (0..n * n).map(|k| columns[k] - columns[k % n * n + k / n]).collect();
        assert!(norm(&skew) < bars[1] * norm(&columns), "{name}");
        let mut diagonal = vec![0.0; n * d];
        let mut again = vec![0.0; n];
        energy.tangent_diagonal(u, &mut again, &mut diagonal).unwrap();
        assert_eq!(again, gradient);
        let blocks: Vec<f64> = (0..n * d)
            .map(|k| {
                let (point, r, c) = (k / (d * d), k / d % d, k % d);
                dense[(point * d + c) * n + point * d + r]
            })
            .collect();
        assert!(diagonal == blocks, "{name}: {:e}", error(&diagonal, &blocks));
    });
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let body = cloud(&[17, 9, 8], 11);
    let u = displacements(&body, &h_of(3), 0.05, 5);
    let p = displacements(&body, &h_of(3), 0.5, 6);
    for order in ORDERS {
        for discretisation in DISCRETISATIONS {
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let energy = energy(&body, 2.8, order, discretisation, "cubic");
                    let mut out = [vec![0.0; u.len()], vec![0.0; u.len()]];
                    let parts = energy.forces(&u, &mut out[0]).unwrap();
                    energy.hessian(&u).unwrap().multiply(&p, &mut out[1]);
                    (
                        energy.energy(&u).unwrap(),
                        parts,
                        energy.densities(&u, energy.body().volumes()).unwrap(),
                        out,
                    )
                })
            };
            let one = run(1);
            assert!(one == run(2) && one == run(4), "{order:?} {discretisation:?}");
        }
    }
}

/// Springs in place of the tangent have the energy of the material for uniform strains where
/// `lambda = mu`, as far as families of lattice points are alike in all directions, and a 1e-4th of
/// their stiffness across.
#[test]
fn springs_are_as_stiff_as_the_material() {
    for (counts, horizon) in [(&[12, 11][..], 3.2), (&[7, 6, 7], 3.2)] {
        let d = counts.len();
        let n: usize = counts.iter().product();
        let place = |p: usize, axis: usize| {
            let before: usize = counts[..axis].iter().product();
            (p / before % counts[axis]) as f64
        };
        let positions: Vec<f64> = (0..n * d).map(|k| place(k / d, k % d)).collect();
        let body = Arc::new(Body::new(d, &positions, &vec![1.0; n], Some(1.0)));
        let formulation = Formulation {
            horizon,
            order: OperatorOrder::First,
            discretisation: Discretisation::Nodal,
            influence: &Constant,
        };
        // lambda = 2 mu nu/(1 - 2 nu)
        let law = st_venant_kirchhoff(d, 210.0, 0.25);
        let energy = DeformationEnergy::new(Arc::clone(&body), formulation, law).unwrap();
        let rest = vec![0.0; n * d];
        let mut springs = BlockMatrix::zeros(energy.bond_pattern().unwrap());
        energy.springs(&rest, &mut springs);
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        let of_springs = |h: &[f64]| {
            let p = displacements(&body, h, 0.0, 1);
            dot(&p, &springs.multiply(&p))
        };
        let of_material = |h: &[f64]| {
            let p = displacements(&body, h, 0.0, 1);
            let mut product = vec![0.0; n * d];
            energy.hessian(&rest).unwrap().multiply(&p, &mut product);
            dot(&p, &product)
        };
        let strain = |entries: &[(usize, usize, f64)]| {
            let mut h = vec![0.0; d * d];
            entries.iter().for_each(|&(r, c, x)| h[r * d + c] = x);
            h
        };
        let all: Vec<(usize, usize, f64)> = (0..d).map(|r| (r, r, 1.0)).collect();
        let dilation = strain(&all);
        for h in [
            dilation.clone(),
            strain(&[(0, 0, 1.0)]),
            strain(&[(d - 1, d - 1, 1.0)]),
            strain(&[(0, 1, 1.0), (1, 0, 1.0)]),
            strain(&[(0, 0, 1.0), (1, 1, -1.0)]),
        ] {
            let ratio = of_springs(&h) / of_material(&h);
            println!("{d} {h:?} {ratio}");
            assert!((0.7..1.4).contains(&ratio), "{d} {h:?}: {ratio}");
        }
        if d == 2 {
            // Turned about a point every difference is across, as long as it is along when the body
            // swells.
            let turned = strain(&[(0, 1, -1.0), (1, 0, 1.0)]);
            let ratio = of_springs(&turned) / of_springs(&dilation);
            assert!((ratio / (1e-4 / (1.0 + 1e-4)) - 1.0).abs() < 1e-9, "{ratio:e}");
        }
    }
}

/// Springs turn with the body, whatever the unit of length: at a rotation they are those at rest, rotated.
#[test]
fn springs_turn_with_the_body() {
    for (counts, scale) in
        [(&[6, 5][..], 1.0), (&[6, 5], 1e-3), (&[4, 3, 4], 1.0), (&[4, 3, 4], 1e3)]
    {
        let d = counts.len();
        let cloud = cloud(counts, 3);
        let positions: Vec<f64> = cloud.positions().iter().map(|x| scale * x).collect();
        let body = Arc::new(Body::new(d, &positions, cloud.volumes(), None));
        let energy = energy(&body, 2.2 * scale, OperatorOrder::First, Discretisation::Nodal, "one");
        let (sine, cosine) = (libm::sin(1.1), libm::cos(1.1));
        let rotated = |x: &[f64]| -> Vec<f64> {
            let turn = |x: &[f64]| {
                let mut x = x.to_vec();
                (x[0], x[1]) = (cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1]);
                x
            };
            x.chunks_exact(d).flat_map(turn).collect()
        };
        let springs = |u: &[f64], p: &[f64]| {
            let mut springs = BlockMatrix::zeros(energy.bond_pattern().unwrap());
            energy.springs(u, &mut springs);
            springs.multiply(p)
        };
        let x = body.positions();
        let turned: Vec<f64> = rotated(x).iter().zip(x).map(|(now, rest)| now - rest).collect();
        let p = Random(7).vector(x.len());
        let expected = rotated(&springs(&vec![0.0; x.len()], &p));
        let found = springs(&turned, &rotated(&p));
        assert!(error(&found, &expected) < 1e-13, "{d} {scale}: {:e}", error(&found, &expected));
        // All points in one: springs are as they were at rest.
        let gathered: Vec<f64> = x.iter().map(|x| -x).collect();
        let same = springs(&gathered, &p);
        assert!(error(&same, &springs(&vec![0.0; x.len()], &p)) < 1e-15, "{d} {scale}");
    }
}

/// `psi = (H:H)^2/4`, which has no stiffness at rest.
struct Quartic(usize);

impl VariablesLaw for Quartic {
    fn n_variables(&self) -> usize {
        self.0 * self.0
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        for p in 0..at.n {
            let square: f64 = at.change.iter().skip(p).step_by(at.n).map(|h| h * h).sum();
            psi[p] = 0.25 * square * square;
            for k in (p..gradient.len()).step_by(at.n) {
                gradient[k] = square * at.change[k];
            }
        }
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        for p in 0..at.n {
            let places = || (p..product.len()).step_by(at.n);
            let square: f64 = places().map(|k| at.change[k] * at.change[k]).sum();
            let along: f64 = places().map(|k| at.change[k] * direction[k]).sum();
            let places: Vec<usize> = places().collect();
            for k in places {
                product[k] = square * direction[k] + 2.0 * along * at.change[k];
            }
        }
    }
}

/// A law without stiffness at rest has springs all the same, as stiff along one axis as along another.
#[test]
fn springs_without_stiffness_at_rest_prefer_no_axis() {
    for d in [2, 3] {
        let counts = vec![5usize; d];
        let n: usize = counts.iter().product();
        let place = |k: usize| (k / d / 5usize.pow((k % d) as u32) % 5) as f64;
        let positions: Vec<f64> = (0..n * d).map(place).collect();
        let body = Arc::new(Body::new(d, &positions, &vec![1.0; n], Some(1.0)));
        let formulation = Formulation {
            horizon: 1.5,
            order: OperatorOrder::First,
            discretisation: Discretisation::Nodal,
            influence: &Constant,
        };
        let energy =
            DeformationEnergy::new(Arc::clone(&body), formulation, Box::new(Quartic(d))).unwrap();
        let mut springs = BlockMatrix::zeros(energy.bond_pattern().unwrap());
        energy.springs(&vec![0.0; n * d], &mut springs);
        let work = |axis: usize| {
            let mut h = vec![0.0; d * d];
            h[axis * d + axis] = 1.0;
            let p = displacements(&body, &h, 0.0, 1);
            p.iter().zip(springs.multiply(&p)).map(|(p, q)| p * q).sum::<f64>()
        };
        for axis in 1..d {
            assert!(work(0) > 0.0 && (work(axis) / work(0) - 1.0).abs() < 1e-13, "{d} {axis}");
        }
    }
}
