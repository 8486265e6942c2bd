//! Elastic constants of endless lattices from one row of the assembled tangent, by the method of
//! long waves (Born and Huang): with `[ij,kl] = -1/(2V) sum_b K_ij(a,b) X_k X_l` a stress-free
//! cubic lattice has `C11 = [11,11]`, `C44 = [11,22]` and `C12 = 2 [12,12] - C44`.
//!
//! The row of a point knows only cliques through this point, and uniform weights are those of the
//! endless lattice at every point: a body of one horizon around it suffices.

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{lattice, laws, reference};

struct Moduli {
    c11: f64,
    c12: f64,
    c44: f64,
}

impl Moduli {
    /// Loading along a lattice axis, lateral strains free to follow in 3D and in 2D alike.
    fn poisson(&self, dimension: usize) -> f64 {
        if dimension == 2 { self.c12 / self.c11 } else { self.c12 / (self.c11 + self.c12) }
    }
}

fn moduli(dimension: usize, ratio: usize, coefficients: [f64; 3]) -> Moduli {
    let lower = vec![-(ratio as f64); dimension];
    let body = lattice(&lower, &vec![2 * ratio; dimension], 1.0);
    let energy =
        DiscreteEnergy::new(body.clone(), ratio as f64, Weights::Uniform, laws(coefficients, 1))
            .unwrap();
    let u = vec![0.0; body.positions().len()];
    let mut gradient = u.clone();
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let parts = energy.tangent(&u, &mut gradient, &mut tangent).unwrap();
    assert_eq!((parts.total(), gradient.iter().all(|&g| g == 0.0)), (0.0, true), "stress-free");
    let brackets = Brackets { body: &body, tangent: &tangent };
    let c44 = brackets.of([0, 0], [1, 1]);
    Moduli { c11: brackets.of([0, 0], [0, 0]), c12: 2.0 * brackets.of([0, 1], [0, 1]) - c44, c44 }
}

struct Brackets<'a> {
    body: &'a Body,
    tangent: &'a BlockMatrix,
}

impl Brackets<'_> {
    /// `[ij,kl]` of the point at the origin, for unit volume.
    fn of(&self, [i, j]: [usize; 2], [k, l]: [usize; 2]) -> f64 {
        let (pattern, d) = (&self.tangent.pattern, self.body.dimension());
        let at_origin = |point: usize| self.body.position(point).iter().all(|&x| x == 0.0);
        let origin = (0..self.body.n_points()).find(|&p| at_origin(p)).unwrap();
        let mut sum = 0.0;
        for row in 0..=origin {
            for place in pattern.row_start[row]..pattern.row_start[row + 1] {
                let column = pattern.columns[place] as usize;
                let (other, entry) = match (row == origin, column == origin) {
                    (true, _) => (column, i * d + j),
                    (_, true) => (row, j * d + i),
                    _ => continue,
                };
                let x = self.body.position(other);
                sum -= 0.5 * self.tangent.values[place * d * d + entry] * x[k] * x[l];
            }
        }
        sum
    }
}

fn assert_near(found: f64, expected: f64, case: &str) {
    // Measured are 2e-15.
    assert!((found - expected).abs() <= 1e-14 * expected.abs(), "{case}: {found} not {expected}");
}

#[test]
fn bulk_moduli_of_bonds() {
    let constants = reference("lattice_constants.json");
    for case in constants["poisson_bulk"].as_array().unwrap() {
        let (dimension, ratio) =
            (case["D"].as_u64().unwrap() as usize, case["ratio"].as_u64().unwrap() as usize);
        let found = moduli(dimension, ratio, [1.0, 0.0, 0.0]);
        let name = format!("d {dimension} ratio {ratio}");
        assert_near(found.c11, case["C11"].as_f64().unwrap(), &name);
        assert_near(found.c12, case["C12"].as_f64().unwrap(), &name);
        assert_near(found.c44, case["C44"].as_f64().unwrap(), &name);
        assert_near(found.poisson(dimension), case["nu"].as_f64().unwrap(), &name);
    }
}

#[test]
fn triangles_raise_poissons_ratio_in_the_plane() {
    let constants = reference("lattice_constants.json");
    for case in constants["poisson_vs_k2_2d"].as_array().unwrap() {
        let ratio = case["ratio"].as_u64().unwrap() as usize;
        let delta = ratio as f64;
        let c2 = case["k2"].as_f64().unwrap() / (delta * delta * delta);
        let found = moduli(2, ratio, [1.0, c2, 0.0]).poisson(2);
        assert_near(found, case["nu"].as_f64().unwrap(), &case.to_string());
    }
}

#[test]
fn tetrahedra_raise_poissons_ratio_in_space() {
    let constants = reference("lattice_constants.json");
    for case in constants["poisson_vs_k3_3d"].as_array().unwrap() {
        let ratio = case["ratio"].as_u64().unwrap() as usize;
        let c3 = case["k3"].as_f64().unwrap() / libm::pow(ratio as f64, 8.0);
        let found = moduli(3, ratio, [1.0, 0.0, c3]).poisson(3);
        assert_near(found, case["nu"].as_f64().unwrap(), &case.to_string());
    }
}
