//! The elasticity tensor and the numbers that are read off it.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::Affine;

/// The elasticity tensor in Voigt's notation, in Pa: stress over strain with shears `gamma = 2 eps`.
///
/// The order is xx, yy, zz, yz, xz, xy in three dimensions and xx, yy, xy in two. What a change of
/// volume costs stands apart: where it costs nearly all, the sum has few digits of the rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Stiffness {
    dimension: usize,
    /// A part of each of the first d x d entries, in Pa.
    volumetric: f64,
    /// The other parts.
    rest: DMatrix<f64>,
    /// The entries.
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
    /// Change of volume (2D: of area) over axial strain under uniaxial stress along the first axis:
    /// `1 - 2 nu` (2D: `1 - nu`) of bodies that are alike along the others, with all digits.
    Dilation,
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
    pub const ALL: [Modulus; 10] = [
        Modulus::Young,
        Modulus::Poisson,
        Modulus::YoungStrain,
        Modulus::PoissonStrain,
        Modulus::Dilation,
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
            Modulus::Dilation => "dilation",
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
        !matches!(self, Modulus::Poisson | Modulus::PoissonStrain | Modulus::Dilation)
    }

    /// Whether stable bodies may have 0 and negative ones.
    pub(super) fn has_any_sign(self) -> bool {
        matches!(self, Modulus::Poisson | Modulus::PoissonStrain | Modulus::C12)
    }
}

impl Stiffness {
    /// The symmetric part of the second derivatives: strains alone.
    pub fn new(affine: &Affine) -> Stiffness {
        let dimension = affine.dimension();
        let modes = pairs(dimension);
        let entry = |row: usize, column: usize| {
            let numbers = |[a, b]: [usize; 2]| [dimension * a + b, dimension * b + a];
            let (rows, columns) = (numbers(modes[row]), numbers(modes[column]));
            let sum = rows.iter().flat_map(|&r| columns.iter().map(move |&c| (r, c)));
            0.25 * sum.map(|place| affine.rest[place]).sum::<f64>()
        };
        let n = modes.len();
        // Rounding alone makes the two halves differ.
        let rest = DMatrix::from_fn(n, n, |r, c| 0.5 * (entry(r, c) + entry(c, r)));
        Stiffness::of(dimension, affine.volumetric, rest)
    }

    fn of(dimension: usize, volumetric: f64, rest: DMatrix<f64>) -> Stiffness {
        let n = rest.nrows();
        let is_normal = |r: usize, c: usize| r < dimension && c < dimension;
        let part = |r: usize, c: usize| if is_normal(r, c) { volumetric } else { 0.0 };
        let voigt = DMatrix::from_fn(n, n, |r, c| part(r, c) + rest[(r, c)]);
        Stiffness { dimension, volumetric, rest, voigt }
    }

    /// The sum with `factor` times another one, or a difference of two.
    pub(super) fn plus(&self, factor: f64, other: &Stiffness) -> Stiffness {
        let volumetric = self.volumetric + factor * other.volumetric;
        Stiffness::of(self.dimension, volumetric, &self.rest + factor * &other.rest)
    }

    /// `factor` times as stiff.
    pub(super) fn scaled(&self, factor: f64) -> Stiffness {
        Stiffness::of(self.dimension, self.volumetric * factor, &self.rest * factor)
    }

    /// The largest entry in absolute value, in Pa.
    pub(super) fn size(&self) -> f64 {
        self.voigt.amax()
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
        let (d, n) = (self.dimension, self.rest.nrows());
        let weight = |k: usize| if k < d { 1.0 } else { std::f64::consts::SQRT_2 };
        let mandel = DMatrix::from_fn(n, n, |r, c| weight(r) * weight(c) * self.rest[(r, c)]);
        // Changes of volume first: shapes know nothing of what they cost.
        let basis = volume_and_shapes(d, n);
        let mut turned = basis.transpose() * mandel * basis;
        turned[(0, 0)] += d as f64 * self.volumetric;
        if turned.iter().any(|x| !x.is_finite()) {
            return vec![f64::NAN; n];
        }
        let mut moduli: Vec<f64> =
            SymmetricEigen::new(turned).eigenvalues.iter().copied().collect();
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

    /// The derivative of one of its numbers along a change of the tensor.
    pub fn slope(&self, modulus: Modulus, change: &Stiffness) -> Option<f64> {
        self.with_slope(modulus, Some(change)).map(|(_, slope)| slope)
    }

    /// Zener's ratio `2 C44/(C11 - C12)`: 1 for isotropic bodies.
    pub fn zener(&self) -> f64 {
        let c = &self.rest;
        2.0 * c[(self.dimension, self.dimension)] / (c[(0, 0)] - c[(0, 1)])
    }

    fn with_slope(&self, modulus: Modulus, change: Option<&Stiffness>) -> Option<(f64, f64)> {
        if !modulus.exists(self.dimension) {
            return None;
        }
        let found = match modulus {
            Modulus::Young | Modulus::Poisson | Modulus::Dilation => {
                self.uniaxial(change)?.with_slope(modulus)
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
            _ => (self.linear(modulus), change.map_or(0.0, |change| change.linear(modulus))),
        };
        (found.0.is_finite() && found.1.is_finite()).then_some(found)
    }

    /// A number that is a sum of entries.
    fn linear(&self, modulus: Modulus) -> f64 {
        let (d, n, c) = (self.dimension, self.rest.nrows(), &self.rest);
        let normal = (0..d).map(|i| c[(i, i)]).sum::<f64>() / d as f64;
        let cross = match d {
            2 => c[(0, 1)],
            _ => (c[(0, 1)] + c[(0, 2)] + c[(1, 2)]) / 3.0,
        };
        let shear = (d..n).map(|i| c[(i, i)]).sum::<f64>() / (n - d) as f64;
        match modulus {
            Modulus::C11 => self.voigt[(0, 0)],
            Modulus::C12 => self.voigt[(0, 1)],
            Modulus::C44 => self.voigt[(d, d)],
            Modulus::Bulk => self.volumetric + (normal + (d - 1) as f64 * cross) / d as f64,
            Modulus::Shear if d == 2 => 0.25 * (normal - cross) + 0.5 * shear,
            Modulus::Shear => (normal - cross + 3.0 * shear) / 5.0,
            _ => f64::NAN,
        }
    }

    /// The body under uniaxial stress along the first axis, and what it changes by; nothing where the
    /// tensor cannot be inverted.
    ///
    /// With `C = R + v j j'`, `y = R^-1 j` and `s = 1/(1 + v j.y)` the compliance is
    /// `R^-1 - v s y y'`, and its sums over the first d columns are `s y` (Sherman and Morrison).
    fn uniaxial(&self, change: Option<&Stiffness>) -> Option<Uniaxial> {
        let (d, n) = (self.dimension, self.rest.nrows());
        let inverse = self.rest.clone().try_inverse()?;
        let pressed = DVector::from_fn(n, |k, _| (0..d).map(|c| inverse[(k, c)]).sum::<f64>());
        let total = pressed.rows(0, d).sum();
        let pressed = &pressed / (1.0 + self.volumetric * total);
        // Strains under unit stresses along the axes; sums over the axes for `pressed`.
        let column = |axis: usize| {
            let alone: DVector<f64> = inverse.column(axis).into();
            let share = (0..d).map(|c| inverse[(axis, c)]).sum::<f64>();
            alone - self.volumetric * share * &pressed
        };
        let (first, volume) = (column(0), pressed[0]);
        let slope = |other: &DVector<f64>, other_volume: f64| {
            change.map_or(0.0, |change| {
                let volumetric = change.volumetric * volume * other_volume;
                -(volumetric + first.dot(&(&change.rest * other)))
            })
        };
        let at =
            |axis: usize| Number { value: first[axis], slope: slope(&column(axis), pressed[axis]) };
        Some(Uniaxial {
            dimension: d,
            axial: at(0),
            lateral: at(1),
            last: at(d - 1),
            volume: Number { value: volume, slope: slope(&pressed, pressed.rows(0, d).sum()) },
        })
    }
}

/// A number and its derivative.
#[derive(Clone, Copy)]
struct Number {
    value: f64,
    slope: f64,
}

/// Strains under a unit stress along the first axis, in 1/Pa.
struct Uniaxial {
    dimension: usize,
    axial: Number,
    lateral: Number,
    /// Along the last axis.
    last: Number,
    /// Of all axes together.
    volume: Number,
}

impl Uniaxial {
    /// Young's modulus, Poisson's ratio or the dilation, with derivative.
    fn with_slope(&self, modulus: Modulus) -> (f64, f64) {
        let Number { value: axial, slope: axial_slope } = self.axial;
        let over = |part: Number| {
            let ratio = part.value / axial;
            (ratio, (part.slope - ratio * axial_slope) / axial)
        };
        let (dilation, _) = over(self.volume);
        match modulus {
            Modulus::Young => (1.0 / axial, -axial_slope / (axial * axial)),
            Modulus::Poisson => {
                // From the dilation, which keeps the digits that nu near 1/2 (2D: 1) cannot hold.
                let nu = match self.dimension {
                    2 => 1.0 - dilation,
                    _ => 0.5 * (1.0 - dilation - (self.lateral.value - self.last.value) / axial),
                };
                (nu, -over(self.lateral).1)
            }
            _ => over(self.volume),
        }
    }
}

/// An orthogonal matrix: strains of equal parts along all axes first, then other normal strains, shears.
fn volume_and_shapes(d: usize, n: usize) -> DMatrix<f64> {
    let normals: &[&[f64]] = match d {
        2 => &[&[1.0, 1.0], &[1.0, -1.0]],
        _ => &[&[1.0, 1.0, 1.0], &[1.0, -1.0, 0.0], &[1.0, 1.0, -2.0]],
    };
    DMatrix::from_fn(n, n, |row, column| match normals.get(column) {
        Some(normal) if row < d => normal[row] / normal.iter().map(|x| x * x).sum::<f64>().sqrt(),
        Some(_) => 0.0,
        None => f64::from(u8::from(row == column)),
    })
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

    /// What volume costs is taken from the entry xx, yy.
    fn split(voigt: DMatrix<f64>) -> Stiffness {
        let d = if voigt.nrows() == 3 { 2 } else { 3 };
        let volumetric = voigt[(0, 1)];
        let part = |r: usize, c: usize| if r < d && c < d { volumetric } else { 0.0 };
        let rest =
            DMatrix::from_fn(voigt.nrows(), voigt.nrows(), |r, c| voigt[(r, c)] - part(r, c));
        Stiffness::of(d, volumetric, rest)
    }

    fn isotropic(dimension: usize, lambda: f64, mu: f64) -> Stiffness {
        let n = if dimension == 2 { 3 } else { 6 };
        let stiffness = |k: usize| if k < dimension { 2.0 * mu } else { mu };
        let rest = DMatrix::from_fn(n, n, |r, c| if r == c { stiffness(r) } else { 0.0 });
        Stiffness::of(dimension, lambda, rest)
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

    /// Where shear costs 1e-12 of what volume costs, entries hold four digits of it.
    #[test]
    fn bodies_that_keep_their_volume_keep_their_digits() {
        let (lambda, mu) = (1e12, 1.0 / 3.0);
        for d in [2, 3] {
            let body = isotropic(d, lambda, mu);
            let bulk = lambda + 2.0 / d as f64 * mu;
            let young = [4.0 * bulk * mu / (bulk + mu), 9.0 * bulk * mu / (3.0 * bulk + mu)][d - 2];
            let dilation = young / (d as f64 * bulk);
            let shear = body.kelvin()[0];
            for (found, expected) in [
                (body.modulus(Modulus::Young).unwrap(), young),
                (body.modulus(Modulus::Dilation).unwrap(), dilation),
                (body.modulus(Modulus::Shear).unwrap(), mu),
                (shear, 2.0 * mu),
                (body.zener(), 1.0),
            ] {
                let error = (found / expected - 1.0).abs();
                assert!(error < 4e-15, "{d}: {found:e} {expected:e} {error:.1e}");
            }
        }
    }

    /// What is a stress grows with the tensor; plain numbers do not.
    #[test]
    fn stresses_scale_with_the_tensor_and_ratios_do_not() {
        for d in [2, 3] {
            let here = isotropic(d, 3.0, 2.0);
            let twice = split(2.0 * here.voigt());
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
            let broken = split(voigt);
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
                    let moved = split(here.voigt() + step * &change);
                    moved.modulus(modulus).unwrap()
                };
                let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
                let found = here.slope(modulus, &split(change.clone())).unwrap();
                assert!((found - expected).abs() < 1e-8 * (1.0 + expected.abs()), "{modulus:?}");
            }
        }
    }
}
