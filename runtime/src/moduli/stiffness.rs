//! The elasticity tensor and the numbers that are read off it.

use nalgebra::{DMatrix, SymmetricEigen};

use super::Affine;

/// The elasticity tensor in Voigt's notation, in Pa: stress over strain with shears `gamma = 2 eps`.
///
/// The order is xx, yy, zz, yz, xz, xy in three dimensions and xx, yy, xy in two.
#[derive(Clone, Debug, PartialEq)]
pub struct Stiffness {
    dimension: usize,
    voigt: DMatrix<f64>,
}

/// A number that is read off an elasticity tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modulus {
    /// Stress over strain under uniaxial stress along the first axis, Pa.
    Young,
    /// Minus lateral over axial strain there, along the second axis.
    Poisson,
    /// 2D: Young's modulus of the isotropic solid whose plane strain has these moduli, Pa.
    YoungStrain,
    /// 2D: Poisson's ratio of that solid.
    PoissonStrain,
    /// Mean over all directions: a third (2D: half) of the stress' trace over the strain's, Pa.
    Bulk,
    /// Mean over all directions (Voigt's average), Pa.
    Shear,
    /// Pa.
    C11,
    /// Pa.
    C12,
    /// Shear stress over shear angle, yz (2D: xy), Pa.
    C44,
}

impl Modulus {
    /// All of them.
    pub const ALL: [Modulus; 9] = [
        Modulus::Young,
        Modulus::Poisson,
        Modulus::YoungStrain,
        Modulus::PoissonStrain,
        Modulus::Bulk,
        Modulus::Shear,
        Modulus::C11,
        Modulus::C12,
        Modulus::C44,
    ];

    /// As it is written in targets and tables.
    pub fn name(self) -> &'static str {
        match self {
            Modulus::Young => "E",
            Modulus::Poisson => "nu",
            Modulus::YoungStrain => "E_strain",
            Modulus::PoissonStrain => "nu_strain",
            Modulus::Bulk => "K",
            Modulus::Shear => "mu",
            Modulus::C11 => "C11",
            Modulus::C12 => "C12",
            Modulus::C44 => "C44",
        }
    }

    /// By its name.
    pub fn named(name: &str) -> Option<Modulus> {
        Modulus::ALL.into_iter().find(|modulus| modulus.name() == name)
    }

    /// Whether it exists in so many dimensions.
    pub fn exists(self, dimension: usize) -> bool {
        dimension == 2 || !matches!(self, Modulus::YoungStrain | Modulus::PoissonStrain)
    }

    /// Whether it is a stress, else a plain number.
    pub fn is_stress(self) -> bool {
        !matches!(self, Modulus::Poisson | Modulus::PoissonStrain)
    }
}

impl Stiffness {
    /// The symmetric part of the second derivatives: strains alone.
    pub fn new(affine: &Affine) -> Stiffness {
        let dimension = if affine.stress.len() == 4 { 2 } else { 3 };
        let modes = pairs(dimension);
        let entry = |row: usize, column: usize| {
            let numbers = |[a, b]: [usize; 2]| [dimension * a + b, dimension * b + a];
            let (rows, columns) = (numbers(modes[row]), numbers(modes[column]));
            let sum = rows.iter().flat_map(|&r| columns.iter().map(move |&c| (r, c)));
            0.25 * sum.map(|place| affine.tangent[place]).sum::<f64>()
        };
        let n = modes.len();
        // Rounding alone makes the two halves differ.
        let voigt = DMatrix::from_fn(n, n, |r, c| 0.5 * (entry(r, c) + entry(c, r)));
        Stiffness { dimension, voigt }
    }

    /// From a Voigt matrix, 3 x 3 or 6 x 6; in Pa.
    pub(super) fn from_voigt(voigt: DMatrix<f64>) -> Stiffness {
        Stiffness { dimension: if voigt.nrows() == 3 { 2 } else { 3 }, voigt }
    }

    /// 2 or 3.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The Voigt matrix in Pa.
    pub fn voigt(&self) -> &DMatrix<f64> {
        &self.voigt
    }

    /// Stiffnesses against unit tensors of strain, ascending, in Pa (Kelvin moduli): 2 mu and 3 K
    /// (2D: 2 K) of an isotropic body. All are positive where all homogeneous strains cost energy.
    pub fn kelvin(&self) -> Vec<f64> {
        let d = self.dimension;
        let weight = |k: usize| if k < d { 1.0 } else { std::f64::consts::SQRT_2 };
        let n = self.voigt.nrows();
        let mandel = DMatrix::from_fn(n, n, |r, c| weight(r) * weight(c) * self.voigt[(r, c)]);
        if mandel.iter().any(|x| !x.is_finite()) {
            return vec![f64::NAN; n];
        }
        let mut moduli: Vec<f64> =
            SymmetricEigen::new(mandel).eigenvalues.iter().copied().collect();
        moduli.sort_by(f64::total_cmp);
        moduli
    }

    /// Whether every homogeneous strain costs energy, beyond rounding.
    pub fn is_stable(&self) -> bool {
        let moduli = self.kelvin();
        let largest = moduli.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        moduli.iter().all(|x| *x > 1e-12 * largest)
    }

    /// One of its numbers; nothing where the tensor cannot be inverted for it.
    pub fn modulus(&self, modulus: Modulus) -> Option<f64> {
        self.with_slope(modulus, None).map(|(value, _)| value)
    }

    /// The derivative of one of its numbers along a change of the Voigt matrix.
    pub fn slope(&self, modulus: Modulus, change: &DMatrix<f64>) -> Option<f64> {
        self.with_slope(modulus, Some(change)).map(|(_, slope)| slope)
    }

    /// Zener's ratio `2 C44/(C11 - C12)`: 1 for isotropic bodies.
    pub fn zener(&self) -> f64 {
        let c = &self.voigt;
        2.0 * c[(self.dimension, self.dimension)] / (c[(0, 0)] - c[(0, 1)])
    }

    fn with_slope(&self, modulus: Modulus, change: Option<&DMatrix<f64>>) -> Option<(f64, f64)> {
        let d = self.dimension;
        if !modulus.exists(d) {
            return None;
        }
        let linear = |number: &dyn Fn(&DMatrix<f64>) -> f64| {
            (number(&self.voigt), change.map_or(0.0, number))
        };
        let normal = |c: &DMatrix<f64>| (0..d).map(|i| c[(i, i)]).sum::<f64>() / d as f64;
        let cross = |c: &DMatrix<f64>| match d {
            2 => c[(0, 1)],
            _ => (c[(0, 1)] + c[(0, 2)] + c[(1, 2)]) / 3.0,
        };
        let n = self.voigt.nrows();
        let shear = |c: &DMatrix<f64>| (d..n).map(|i| c[(i, i)]).sum::<f64>() / (n - d) as f64;
        let found = match modulus {
            Modulus::C11 => linear(&|c| c[(0, 0)]),
            Modulus::C12 => linear(&|c| c[(0, 1)]),
            Modulus::C44 => linear(&|c| c[(d, d)]),
            Modulus::Bulk => linear(&|c| (normal(c) + (d - 1) as f64 * cross(c)) / d as f64),
            Modulus::Shear if d == 2 => linear(&|c| 0.25 * (normal(c) - cross(c)) + 0.5 * shear(c)),
            Modulus::Shear => linear(&|c| (normal(c) - cross(c) + 3.0 * shear(c)) / 5.0),
            Modulus::Young | Modulus::Poisson => {
                let compliance = self.voigt.clone().try_inverse()?;
                let slope =
                    change.map_or(DMatrix::zeros(n, n), |c| -(&compliance * c * &compliance));
                let (axial, lateral) = (compliance[(0, 0)], compliance[(0, 1)]);
                let (axial_slope, lateral_slope) = (slope[(0, 0)], slope[(0, 1)]);
                if modulus == Modulus::Young {
                    (1.0 / axial, -axial_slope / (axial * axial))
                } else {
                    let nu = -lateral / axial;
                    (nu, -(lateral_slope + nu * axial_slope) / axial)
                }
            }
            Modulus::PoissonStrain => {
                let (nu, slope) = self.with_slope(Modulus::Poisson, change)?;
                (nu / (1.0 + nu), slope / ((1.0 + nu) * (1.0 + nu)))
            }
            Modulus::YoungStrain => {
                let (young, young_slope) = self.with_slope(Modulus::Young, change)?;
                let (nu, nu_slope) = self.with_slope(Modulus::PoissonStrain, change)?;
                let factor = 1.0 - nu * nu;
                (young * factor, young_slope * factor - 2.0 * young * nu * nu_slope)
            }
        };
        (found.0.is_finite() && found.1.is_finite()).then_some(found)
    }
}

/// The pairs of axes of Voigt's notation.
fn pairs(dimension: usize) -> &'static [[usize; 2]] {
    match dimension {
        2 => &[[0, 0], [1, 1], [0, 1]],
        _ => &[[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn isotropic(dimension: usize, lambda: f64, mu: f64) -> Stiffness {
        let n = if dimension == 2 { 3 } else { 6 };
        Stiffness::from_voigt(DMatrix::from_fn(n, n, |r, c| {
            let normal = r < dimension && c < dimension;
            let shear = if r == c { if normal { 2.0 * mu } else { mu } } else { 0.0 };
            shear + if normal { lambda } else { 0.0 }
        }))
    }

    #[test]
    fn isotropic_bodies_have_the_textbook_moduli() {
        let (young, nu) = (210.0, 0.3);
        let (lambda, mu) =
            (young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), young / (2.0 * (1.0 + nu)));
        let solid = isotropic(3, lambda, mu);
        let slice = isotropic(2, lambda, mu);
        let sheet = isotropic(2, 2.0 * lambda * mu / (lambda + 2.0 * mu), mu);
        for (stiffness, modulus, expected) in [
            (&solid, Modulus::Young, young),
            (&solid, Modulus::Poisson, nu),
            (&solid, Modulus::Bulk, lambda + 2.0 / 3.0 * mu),
            (&solid, Modulus::Shear, mu),
            (&sheet, Modulus::Young, young),
            (&sheet, Modulus::Poisson, nu),
            (&slice, Modulus::YoungStrain, young),
            (&slice, Modulus::PoissonStrain, nu),
            (&slice, Modulus::Bulk, lambda + mu),
            (&slice, Modulus::Shear, mu),
            (&slice, Modulus::C44, mu),
        ] {
            let found = stiffness.modulus(modulus).unwrap();
            assert!((found - expected).abs() <= 1e-13 * expected, "{modulus:?} {found}");
        }
        assert_eq!(solid.modulus(Modulus::YoungStrain), None);
        assert!((solid.zener() - 1.0).abs() < 1e-14);
        let kelvin = solid.kelvin();
        assert!((kelvin[0] - 2.0 * mu).abs() < 1e-12 * mu);
        assert!((kelvin[5] - 3.0 * (lambda + 2.0 / 3.0 * mu)).abs() < 1e-12 * young);
        assert!(solid.is_stable());
        assert!(!isotropic(3, -2.0, 1.0).is_stable());
    }

    /// What is a stress grows with the tensor; plain numbers do not.
    #[test]
    fn stresses_scale_with_the_tensor_and_ratios_do_not() {
        for d in [2, 3] {
            let here = isotropic(d, 3.0, 2.0);
            let twice = Stiffness::from_voigt(2.0 * here.voigt());
            for modulus in Modulus::ALL.into_iter().filter(|m| m.exists(d)) {
                let found = twice.modulus(modulus).unwrap() / here.modulus(modulus).unwrap();
                let expected = if modulus.is_stress() { 2.0 } else { 1.0 };
                assert!((found - expected).abs() < 1e-14, "{modulus:?}: {found}");
            }
        }
    }

    /// Eigenvalues alone would show some numbers beside those that are none.
    #[test]
    fn one_component_that_is_no_number_leaves_no_kelvin_modulus() {
        for place in 0..9 {
            let mut voigt = isotropic(2, 3.0, 2.0).voigt().clone();
            voigt[(place / 3, place % 3)] = f64::NAN;
            let broken = Stiffness::from_voigt(voigt);
            assert!(broken.kelvin().iter().all(|x| x.is_nan()), "{place}: {:?}", broken.kelvin());
            assert!(!broken.is_stable());
        }
    }

    #[test]
    fn slopes_are_those_of_the_moduli() {
        for d in [2, 3] {
            let here = isotropic(d, 3.0, 2.0);
            let n = here.voigt().nrows();
            let change = DMatrix::from_fn(n, n, |r, c| 0.1 * (r + c + r * c) as f64 + 0.3);
            for modulus in Modulus::ALL.into_iter().filter(|m| m.exists(d)) {
                let at = |step: f64| {
                    let moved = Stiffness::from_voigt(here.voigt() + step * &change);
                    moved.modulus(modulus).unwrap()
                };
                let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
                let found = here.slope(modulus, &change).unwrap();
                assert!((found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{modulus:?}");
            }
        }
    }
}
