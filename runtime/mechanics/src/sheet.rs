//! Laws of bodies in two dimensions: their thickness, and plane stress.

use crate::kernel::{Variables, VariablesLaw};

/// A law per volume made one per area.
pub struct Thick<L> {
    /// In J/m^3 and Pa.
    pub law: L,
    /// In m.
    pub thickness: f64,
}

impl<L: VariablesLaw> VariablesLaw for Thick<L> {
    fn n_variables(&self) -> usize {
        self.law.n_variables()
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        self.law.evaluate(at, psi, gradient);
        psi.iter_mut().chain(gradient).for_each(|x| *x *= self.thickness);
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        self.law.product(at, direction, product);
        product.iter_mut().for_each(|x| *x *= self.thickness);
    }

    fn stretch_across(&self, at: Variables<'_>, across: &mut [f64]) -> bool {
        self.law.stretch_across(at, across)
    }
}

/// The energy of a sheet whose faces nothing pulls: `psi(F) = min psi(F + F33 e3 x e3)` by F33 > 0.
///
/// At the minimum `P33 = 0`, so that P is that of the solid, and `dP = A:dF - A33:dF A33/A3333`.
/// Shears across the sheet stay 0: the plane is one of the solid's planes of symmetry. Where no F33
/// leaves the faces free, energy and stress are not numbers.
pub struct PlaneStress<L> {
    solid: L,
}

/// Newton steps for F33: quadratic convergence takes a handful, a bad start some halvings more.
const MOST_STEPS: usize = 60;

/// After a step this small, against the strains, the next would change nothing.
const LAST_STEP: f64 = 1e-9;

/// A sheet as thin as this, against its thickness at rest, has vanished.
const THINNEST: f64 = 1e-12;

/// Number of the component 33 of a tensor in space.
const ACROSS: usize = 8;

impl<L: VariablesLaw> PlaneStress<L> {
    /// `solid` is a law of the nine components of `F` in space.
    ///
    /// # Panics
    /// If it has another number of variables: a mistake of the caller.
    pub fn new(solid: L) -> PlaneStress<L> {
        assert_eq!(solid.n_variables(), 9, "the law of a solid");
        PlaneStress { solid }
    }

    /// `F33 - 1` of free faces at every place; not a number where there is none.
    fn thinning(&self, at: Variables<'_>) -> Vec<f64> {
        let n = at.n;
        let mut found = self.linear_thinning(at);
        for (p, h) in found.iter_mut().enumerate() {
            if 1.0 + *h < 0.2 || !h.is_finite() {
                let area = determinant(at, p);
                *h = if area > 0.0 { 1.0 / area - 1.0 } else { 0.0 };
            }
        }
        let mut is_done = vec![false; n];
        let (mut psi, mut stress) = (vec![0.0; n], vec![0.0; 9 * n]);
        for _ in 0..MOST_STEPS {
            let solid = Solid::new(at, &found);
            self.solid.evaluate(solid.variables(), &mut psi, &mut stress);
            let column = self.column(&solid);
            for p in 0..n {
                let (pull, stiffness) = (stress[ACROSS * n + p], column[ACROSS * n + p]);
                if is_done[p] || !pull.is_finite() {
                    continue;
                }
                let newton = -pull / stiffness;
                let (thickness, h) = (1.0 + found[p], found[p]);
                // Downhill where the energy is not convex, and never through zero.
                let step = if stiffness > 0.0 { newton } else { -pull.signum() * thickness };
                let step = step.clamp(-0.5 * thickness, thickness);
                found[p] += step;
                let strain = (0..4).fold(h.abs(), |most, k| most.max(at.change[k * n + p].abs()));
                let is_there = 1.0 + found[p] > THINNEST;
                is_done[p] = is_there && step == newton && step.abs() <= LAST_STEP * strain;
            }
            if is_done.iter().all(|done| *done) {
                return found;
            }
        }
        for (h, done) in found.iter_mut().zip(is_done) {
            if !done {
                *h = f64::NAN;
            }
        }
        found
    }

    /// What it is for infinitesimal strains.
    fn linear_thinning(&self, at: Variables<'_>) -> Vec<f64> {
        // Where parameters vary, so does the law at rest.
        let n = if at.given.is_empty() { 1 } else { at.n };
        let current: Vec<f64> =
            [1.0, 0.0, 0.0, 1.0].into_iter().flat_map(|x| std::iter::repeat_n(x, n)).collect();
        let rest = Variables {
            n,
            current: &current,
            change: &vec![0.0; 4 * n],
            given: at.given,
            laws: &[],
        };
        let column = self.column(&Solid::new(rest, &vec![0.0; n]));
        let own = |component: usize, p: usize| column[component * n + p.min(n - 1)];
        let strain = |p: usize| {
            let planes = IN_PLANE.iter().enumerate();
            planes.fold(0.0, |sum, (k, solid)| sum + own(*solid, p) * at.change[k * at.n + p])
        };
        (0..at.n).map(|p| -strain(p) / own(ACROSS, p)).collect()
    }

    /// The derivative of P by F33.
    fn column(&self, solid: &Solid<'_>) -> Vec<f64> {
        let n = solid.n;
        let mut direction = vec![0.0; 9 * n];
        direction[ACROSS * n..].fill(1.0);
        let mut column = vec![0.0; 9 * n];
        self.solid.product(solid.variables(), &direction, &mut column);
        column
    }
}

impl<L: VariablesLaw> VariablesLaw for PlaneStress<L> {
    fn n_variables(&self) -> usize {
        4
    }

    fn stretch_across(&self, at: Variables<'_>, across: &mut [f64]) -> bool {
        across.iter_mut().zip(self.thinning(at)).for_each(|(across, h)| *across = 1.0 + h);
        true
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        let solid = Solid::new(at, &self.thinning(at));
        if gradient.is_empty() {
            return self.solid.evaluate(solid.variables(), psi, gradient);
        }
        let mut stress = vec![0.0; 9 * at.n];
        self.solid.evaluate(solid.variables(), psi, &mut stress);
        for (k, component) in IN_PLANE.iter().enumerate() {
            let from = component * at.n;
            gradient[k * at.n..(k + 1) * at.n].copy_from_slice(&stress[from..from + at.n]);
        }
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        let n = at.n;
        let solid = Solid::new(at, &self.thinning(at));
        let (along, mut change) = (in_space(n, direction), vec![0.0; 9 * n]);
        self.solid.product(solid.variables(), &along, &mut change);
        let column = self.column(&solid);
        for (k, component) in IN_PLANE.iter().enumerate() {
            for p in 0..n {
                let thinning = -change[ACROSS * n + p] / column[ACROSS * n + p];
                let place = component * n + p;
                product[k * n + p] = change[place] + column[place] * thinning;
            }
        }
    }
}

/// Numbers of the components 11, 12, 21, 22 of a tensor in space.
const IN_PLANE: [usize; 4] = [0, 1, 3, 4];

/// Deformation gradients of a solid.
struct Solid<'a> {
    n: usize,
    current: Vec<f64>,
    change: Vec<f64>,
    given: &'a [f64],
}

impl<'a> Solid<'a> {
    /// Those of the plane, with `F33 - 1` of every place.
    fn new(at: Variables<'a>, thinning: &[f64]) -> Solid<'a> {
        let n = at.n;
        let (mut current, mut change) = (in_space(n, at.current), in_space(n, at.change));
        for (p, h) in thinning.iter().enumerate() {
            current[ACROSS * n + p] = 1.0 + h;
            change[ACROSS * n + p] = *h;
        }
        Solid { n, current, change, given: at.given }
    }

    fn variables(&self) -> Variables<'_> {
        let (current, change) = (&self.current[..], &self.change[..]);
        Variables { n: self.n, current, change, given: self.given, laws: &[] }
    }
}

/// Tensors of the plane with zeros across.
fn in_space(n: usize, plane: &[f64]) -> Vec<f64> {
    let mut space = vec![0.0; 9 * n];
    for (k, component) in IN_PLANE.iter().enumerate() {
        space[component * n..(component + 1) * n].copy_from_slice(&plane[k * n..(k + 1) * n]);
    }
    space
}

fn determinant(at: Variables<'_>, p: usize) -> f64 {
    let f = |k: usize| at.current[k * at.n + p];
    f(0) * f(3) - f(1) * f(2)
}

#[cfg(test)]
mod tests {
    use piola_compiler::{Form, Level, Mode, Setting, check_text};

    use super::*;

    /// A law of the library's form with numbers for its parameters.
    fn solid(psi: &str, dimension: usize, values: &[(&str, f64)]) -> Box<dyn VariablesLaw> {
        let names: Vec<String> = values.iter().map(|(n, _)| format!("parameter {n}\n")).collect();
        let text = format!("potential p\n{}psi(F) = {psi}\n", names.concat());
        let (_, model) = check_text(&text).unwrap();
        let values: Vec<(String, Setting)> =
            values.iter().map(|(n, x)| (n.to_string(), Setting::Number(*x))).collect();
        let values = model.values(dimension, &values, None).unwrap();
        let mode = Mode::Jit(Level::Strict);
        Box::new(model.compile(&values, mode, Form::Accurate).unwrap().gradient.unwrap())
    }

    /// The law at one place: energy, stress, and the product with a direction.
    fn at(law: &dyn VariablesLaw, h: [f64; 4], direction: [f64; 4]) -> (f64, [f64; 4], [f64; 4]) {
        let current = [1.0 + h[0], h[1], h[2], 1.0 + h[3]];
        let at = Variables { n: 1, current: &current, change: &h, given: &[], laws: &[] };
        let (mut psi, mut stress, mut product) = ([0.0], [0.0; 4], [0.0; 4]);
        law.evaluate(at, &mut psi, &mut stress);
        law.product(at, &direction, &mut product);
        (psi[0], stress, product)
    }

    const ST_VENANT: &str = "lambda/2*tr(E)^2 + mu*(E : E)";
    const NEO_HOOKE: &str = "mu/2*(tr(C) - d - 2*ln(J)) + lambda/2*ln(J)^2";
    const DIRECTION: [f64; 4] = [0.3, -0.7, 0.2, 0.9];

    fn norm(x: [f64; 4]) -> f64 {
        x.iter().fold(0.0, |sum, x| sum + x * x).sqrt()
    }

    #[test]
    fn a_sheet_of_st_venant_and_kirchhoff_has_the_reduced_constant() {
        // E33 = -lambda/(lambda + 2 mu) tr E leaves lambda' = 2 lambda mu/(lambda + 2 mu), exactly.
        let (lambda, mu) = (3.0, 2.0);
        let sheet = PlaneStress::new(solid(ST_VENANT, 3, &[("lambda", lambda), ("mu", mu)]));
        let reduced = 2.0 * lambda * mu / (lambda + 2.0 * mu);
        let plane = solid(ST_VENANT, 2, &[("lambda", reduced), ("mu", mu)]);
        for scale in [1.0, 1e-3, 1e-9, 1e-12] {
            let h = [0.2, 0.1, -0.05, -0.1].map(|x| x * scale);
            let (psi, stress, product) = at(&sheet, h, DIRECTION);
            let (psi_2d, stress_2d, product_2d) = at(&*plane, h, DIRECTION);
            assert!((psi - psi_2d).abs() <= 1e-14 * psi_2d, "{scale} {psi} {psi_2d}");
            for (found, expected) in [(stress, stress_2d), (product, product_2d)] {
                let difference = norm(std::array::from_fn(|k| found[k] - expected[k]));
                assert!(difference <= 2e-14 * norm(expected), "{scale} {difference:e}");
            }
        }
    }

    #[test]
    fn stress_and_products_are_derivatives() {
        let sheet = PlaneStress::new(solid(NEO_HOOKE, 3, &[("lambda", 3.0), ("mu", 2.0)]));
        for h in [[0.5, 0.3, -0.2, 0.1], [-0.6, 0.0, 0.1, 0.4], [4.0, 1.0, 0.0, -0.5]] {
            let moved = |t: f64| std::array::from_fn(|k| h[k] + t * DIRECTION[k]);
            let (_, stress, product) = at(&sheet, h, DIRECTION);
            let t = 1e-4;
            // Richardson's fourth order leaves 1e-12 or so.
            let difference = |of: &dyn Fn(f64) -> f64| {
                let central = |t: f64| (of(t) - of(-t)) / (2.0 * t);
                (4.0 * central(t / 2.0) - central(t)) / 3.0
            };
            let slope = difference(&|t| at(&sheet, moved(t), DIRECTION).0);
            let along = (0..4).fold(0.0, |sum, k| sum + stress[k] * DIRECTION[k]);
            assert!((slope - along).abs() < 1e-9 * norm(stress), "{slope} {along}");
            for k in 0..4 {
                let slope = difference(&|t| at(&sheet, moved(t), DIRECTION).1[k]);
                assert!((slope - product[k]).abs() < 1e-9 * norm(product), "{k} {slope}");
            }
        }
    }

    #[test]
    fn a_pulled_sheet_gets_thinner_as_the_solid_does() {
        // Uniaxial stress of the neo-Hookean solid: mu (l^2 - 1) + lambda ln J = 0 across.
        let (lambda, mu) = (3.0, 2.0);
        let sheet = PlaneStress::new(solid(NEO_HOOKE, 3, &[("lambda", lambda), ("mu", mu)]));
        for stretch in [0.05, 0.5, 1.5, 20.0] {
            let mut lateral = 1.0_f64;
            for _ in 0..200 {
                let g = mu * (lateral * lateral - 1.0)
                    + lambda * libm::log(stretch * lateral * lateral);
                lateral -= (g / (2.0 * mu * lateral + 2.0 * lambda / lateral))
                    .clamp(-0.5 * lateral, 0.5 * lateral);
            }
            let (_, stress, _) = at(&sheet, [stretch - 1.0, 0.0, 0.0, lateral - 1.0], DIRECTION);
            assert!(stress[3].abs() < 1e-13 * mu * (1.0 + stretch), "{stretch}: {stress:?}");
            let pull = (mu * (stretch * stretch - 1.0)
                + lambda * libm::log(stretch * lateral * lateral))
                / stretch;
            assert!((stress[0] - pull).abs() < 1e-13 * (mu * stretch + pull.abs()), "{stress:?}");
        }
    }

    #[test]
    fn places_of_a_batch_are_as_they_are_alone() {
        let sheet = PlaneStress::new(solid(NEO_HOOKE, 3, &[("lambda", 3.0), ("mu", 2.0)]));
        // From nothing to a strain that takes many steps; nothing is known of places before others.
        let places: [[f64; 4]; 5] = [
            [4.0, 1.0, 0.0, -0.5],
            [0.0; 4],
            [1e-9, 2e-9, 0.0, -1e-9],
            [-0.6, 0.0, 0.1, 0.4],
            [0.5, 0.3, -0.2, 0.1],
        ];
        let n = places.len();
        let columns = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            (0..4 * n).map(|k| of(k % n, k / n)).collect()
        };
        let change = columns(&|p, k| places[p][k]);
        let current = columns(&|p, k| places[p][k] + if k % 3 == 0 { 1.0 } else { 0.0 });
        let direction = columns(&|p, k| DIRECTION[k] * (1.0 + p as f64));
        let batch = Variables { n, current: &current, change: &change, given: &[], laws: &[] };
        let (mut psi, mut stress) = (vec![0.0; n], vec![0.0; 4 * n]);
        let (mut psi_alone, mut product) = (vec![0.0; n], vec![0.0; 4 * n]);
        sheet.evaluate(batch, &mut psi, &mut stress);
        sheet.evaluate(batch, &mut psi_alone, &mut []);
        sheet.product(batch, &direction, &mut product);
        assert_eq!(psi, psi_alone);
        for (p, h) in places.into_iter().enumerate() {
            let along = DIRECTION.map(|x| x * (1.0 + p as f64));
            let expected = at(&sheet, h, along);
            let of = |array: &[f64]| std::array::from_fn(|k| array[k * n + p]);
            assert_eq!((psi[p], of(&stress), of(&product)), expected, "{h:?}");
        }
    }

    #[test]
    fn a_thick_sheet_has_so_much_more_of_everything() {
        let (law, thickness) = (|| solid(ST_VENANT, 2, &[("lambda", 3.0), ("mu", 2.0)]), 0.25);
        let thick = Thick { law: law(), thickness };
        let h = [0.3, -0.1, 0.2, -0.4];
        let (psi, stress, product) = at(&*law(), h, DIRECTION);
        // A quarter is exact.
        let expected = (thickness * psi, stress.map(|x| thickness * x));
        let (psi, stress, thick_product) = at(&thick, h, DIRECTION);
        assert_eq!((psi, stress), expected);
        assert_eq!(thick_product, product.map(|x| thickness * x));
    }

    #[test]
    fn where_no_thickness_is_free_of_stress_nothing_is_a_number() {
        // tr E > (lambda + 2 mu)/(2 lambda): E33 would be below -1/2.
        let sheet = PlaneStress::new(solid(ST_VENANT, 3, &[("lambda", 100.0), ("mu", 1.0)]));
        let (psi, stress, _) = at(&sheet, [1.0, 0.0, 0.0, 1.0], DIRECTION);
        assert!(psi.is_nan() && stress[0].is_nan());
    }
}
