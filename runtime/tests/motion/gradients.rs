//! Bodies that break by deformation gradients, those of bonds or those of points.

use std::sync::Arc;

use nalgebra::DMatrix;
use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::deformation::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::fracture::{Breaking, FamilyCriterion, Fracture, Inspection, Interactions};

use crate::bonds::{Random, cloud, lattice};
use crate::families;
use crate::families_break::{Case, Left, Margins, breaking, flies_apart, the_foremost_goes_first};

/// Above these `J - 1` and `E : E` break bonds.
const LIMITS: [f64; 2] = [0.15, 0.02];

const KINDS: [Discretisation; 3] = [
    Discretisation::Nodal,
    Discretisation::Stabilised(Stabilisation::Wan),
    Discretisation::BondQuadrature,
];

fn body((body, horizon): &Case, kind: Discretisation, level: Level) -> Breaking {
    let [volume, strain] = LIMITS;
    let text = format!(
        "potential p\npsi(F) = tr(E)^2\nbreak when J - 1 > {volume}\nbreak when E : E > {strain}"
    );
    let (_, model) = check_text(&text).unwrap();
    let values = model.values(body.dimension(), &[], Some(*horizon)).unwrap();
    let found = model.gradient_criteria(&values, Mode::Jit(level), Form::Accurate).unwrap();
    let criterion = |(number, one): (usize, piola_compiler::GradientCriterion)| {
        let (margin, holds_at_zero) = (Box::new(one.margin), one.holds_at_zero);
        FamilyCriterion::<Box<dyn piola_runtime::kernel::VariablesLaw>> {
            layer: 0,
            law: 0,
            number,
            margin,
            holds_at_zero,
        }
    };
    let criteria = found.into_iter().enumerate().map(criterion).collect();
    let energy = families::energy(body, *horizon, OperatorOrder::First, kind, "one");
    breaking(&(Arc::clone(body), *horizon), energy.with_criteria(criteria))
}

/// `F - I` of a point by what is left of its family; nothing where that determines none.
pub(crate) fn of_point(left: &Left<'_>, u: &[f64], point: usize) -> Option<DMatrix<f64>> {
    let d = left.body.dimension();
    let (mut shape, mut moved) = (DMatrix::zeros(d, d), DMatrix::zeros(d, d));
    for other in left.family(point) {
        let of = |x: &[f64]| DMatrix::from_vec(d, 1, left.along(x, [point, other]));
        let (dx, volume) = (of(left.body.positions()), left.body.volumes()[other]);
        shape += volume * (&dx * dx.transpose());
        moved += volume * (of(u) * dx.transpose());
    }
    let values = shape.clone().symmetric_eigenvalues();
    (values.min() > 1e-10 * values.max()).then(|| moved * shape.try_inverse().unwrap())
}

/// The largest margin of a gradient over its amount at rest.
fn margin(h: &DMatrix<f64>) -> f64 {
    let f = DMatrix::identity(h.nrows(), h.nrows()) + h;
    let e = 0.5 * (f.transpose() * &f - DMatrix::identity(h.nrows(), h.nrows()));
    let margins = [f.determinant() - 1.0, e.dot(&e)].into_iter().zip(LIMITS);
    margins.map(|(x, limit)| x / limit - 1.0).fold(f64::NEG_INFINITY, f64::max)
}

/// Of a bond by its own gradient, or by those of its ends.
fn margins(at_bonds: bool) -> impl Margins {
    move |left: &Left<'_>, u: &[f64]| -> Box<dyn Fn([usize; 2]) -> f64> {
        let (n, d) = (left.body.n_points(), left.body.dimension());
        let points: Vec<_> = (0..n).map(|point| of_point(left, u, point)).collect();
        if !at_bonds {
            let own: Vec<Option<f64>> = points.iter().map(|h| h.as_ref().map(margin)).collect();
            return Box::new(move |ends| {
                ends.iter().filter_map(|end| own[*end]).fold(f64::NEG_INFINITY, f64::max)
            });
        }
        let rest = || DMatrix::zeros(d, d);
        let of = |end: usize| points[end].clone().unwrap_or_else(rest);
        let bond = |k: usize| {
            let ends = [k / n, k % n];
            let mean = 0.5 * (of(ends[0]) + of(ends[1]));
            let along = |x: &[f64]| DMatrix::from_vec(d, 1, left.along(x, ends));
            let (dx, eta) = (along(left.body.positions()), along(u));
            let missing = eta - &mean * &dx;
            margin(&(mean + missing * dx.transpose() / dx.norm_squared()))
        };
        let own: Vec<f64> = (0..n * n).map(bond).collect();
        Box::new(move |[p, q]| own[p * n + q])
    }
}

fn bodies() -> [Case; 3] {
    [
        (cloud(&[9, 6], 0.1, 5), 0.25),
        (cloud(&[5, 4, 3], 0.1, 6), 0.2),
        (lattice(&[0.0, 0.0], &[11, 6], 0.1), 0.25),
    ]
}

#[test]
fn bonds_break_by_gradients_as_loops_say_and_the_account_closes() {
    for (case, kind) in bodies().iter().flat_map(|case| KINDS.map(|kind| (case, kind))) {
        let margins = margins(kind == Discretisation::BondQuadrature);
        let run = |threads| flies_apart(case, threads, || body(case, kind, Level::Fast), &margins);
        assert_eq!(run(1), run(2));
    }
}

/// The largest margin goes first; what broke in an attempt comes back.
#[test]
fn the_foremost_gradients_go_first_and_come_back() {
    for (case, kind) in bodies().iter().flat_map(|case| KINDS.map(|kind| (case, kind))) {
        let at_bonds = kind == Discretisation::BondQuadrature;
        let energy = body(case, kind, Level::Strict);
        let mut random = Random(21);
        let d = case.0.dimension();
        let x = case.0.positions().iter().enumerate();
        let strain = [0.1, -0.02, 0.04];
        let u: Vec<f64> = x.map(|(k, x)| strain[k % d] * x + 0.004 * random.next()).collect();
        the_foremost_goes_first(case, &energy, &u, &margins(at_bonds));
        let places = if at_bonds { 1 } else { 2 };
        assert_eq!(energy.look_at(0, &u).unwrap().margins.len(), 2 * places);
        energy.restore(&Interactions::default());
        let fresh = body(case, kind, Level::Strict);
        let judged = [&energy, &fresh].map(|energy| energy.foremost(&u, 1e-6).unwrap());
        assert_eq!(judged[0], judged[1]);
    }
}
