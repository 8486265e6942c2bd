//! Second derivatives of energies on a lattice: forms that its point group leaves alone.

use nalgebra::DMatrix;
use piola_mechanics::geometry::double::Double;
use piola_mechanics::kernel::Measure;

use super::Affine;

/// The energy per volume of `u = G X` to second order, summed up in twice the digits:
///
/// ```text
/// stress*t + 1/2*(volumetric*t^2 + squares*|G|^2 + products*tr(G^2) + axes*sum_a G_aa^2)
/// ```
///
/// with `t = tr(G)`. Means over all images of a clique under the point group have this form; those of
/// `n_i n_j` and `n_i n_j n_k n_l` for unit vectors `n` follow from the sum of the fourth powers.
pub(super) struct Cubic {
    dimension: usize,
    stress: Double,
    volumetric: Double,
    squares: Double,
    products: Double,
    axes: Double,
}

impl Cubic {
    pub(super) fn new(dimension: usize) -> Cubic {
        let zero = Double::new(0.0);
        Cubic {
            dimension,
            stress: zero,
            volumetric: zero,
            squares: zero,
            products: zero,
            axes: zero,
        }
    }

    /// Adds cliques with one measure m at rest: `first` is the sum of `m psi'` with their weights,
    /// `second` that of `m^2 psi''`, `fourth` as in [`piola_mechanics::lattice::Shell`].
    ///
    /// With `t`, `g = n.G n`: bonds have `dl/l = g`, `d2l/l = |G n|^2 - g^2`. Triangles with normal n
    /// have `da/a = t - g`, `d2a/a = t^2 - tr(G^2) - 2 t g + 2 n.G^2 n + |G^T n|^2 - g^2`, from
    /// `a = |cof(I + G) N|`. What `det(I + G)` multiplies has `dm/m = t`, `d2m/m = t^2 - tr(G^2)`.
    pub(super) fn add(&mut self, measure: Measure, fourth: f64, first: f64, second: f64) {
        let d = self.dimension as f64;
        match measure {
            _ if measure.is_signed(self.dimension) => {
                self.add_volumetric(first, second + first);
                add(&mut self.products, -first);
            }
            Measure::Length => {
                self.add_volumetric(first / d, 0.0);
                add(&mut self.squares, first / d);
                self.add_fourths(fourth, second - first);
            }
            _ => {
                self.add_volumetric(2.0 / 3.0 * first, (second + first) / 3.0);
                add(&mut self.squares, first / 3.0);
                add(&mut self.products, -first / 3.0);
                self.add_fourths(fourth, second - first);
            }
        }
    }

    /// Adds `first*t + second*t^2/2`.
    pub(super) fn add_volumetric(&mut self, first: f64, second: f64) {
        add(&mut self.stress, first);
        add(&mut self.volumetric, second);
    }

    /// Adds `factor/2` times the mean of `(n.G n)^2`.
    fn add_fourths(&mut self, fourth: f64, factor: f64) {
        let d = self.dimension as f64;
        // The means of n_x^2 n_y^2 and of n_x^4 - 3 n_x^2 n_y^2.
        let mixed = (1.0 - fourth) / (d * (d - 1.0));
        let alone = fourth / d - 3.0 * mixed;
        for sum in [&mut self.volumetric, &mut self.squares, &mut self.products] {
            add(sum, mixed * factor);
        }
        add(&mut self.axes, alone * factor);
    }

    /// The derivatives, rounded.
    pub(super) fn affine(&self) -> Affine {
        let d = self.dimension;
        let when = |is: bool, x: Double| if is { x } else { Double::new(0.0) };
        let entry = |row: usize, column: usize| {
            let (a, i, b, j) = (row / d, row % d, column / d, column % d);
            let square = when(row == column, self.squares);
            let product = when(a == j && b == i, self.products);
            let axis = when(row == column && a == i, self.axes);
            (square + product + axis).rounded()
        };
        let stress = |number: usize| when(number / d == number % d, self.stress).rounded();
        Affine {
            stress: (0..d * d).map(stress).collect(),
            volumetric: self.volumetric.rounded(),
            rest: DMatrix::from_fn(d * d, d * d, entry),
        }
    }
}

fn add(sum: &mut Double, x: f64) {
    *sum = *sum + Double::new(x);
}
