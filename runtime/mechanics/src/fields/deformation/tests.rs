//! What is built, and when.

use super::influence::Constant;
use super::*;
use crate::kernel::Variables;
use crate::neighborhood::Gaps;
use crate::testing::{goes_to_pieces, pseudo_random};

/// `psi = 1/2 H:H` of so many components.
struct Linear(usize);

impl VariablesLaw for Linear {
    fn n_variables(&self) -> usize {
        self.0
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        for p in 0..at.n {
            psi[p] = (0..self.0)
                .fold(0.0, |sum, k| sum + 0.5 * at.change[k * at.n + p] * at.change[k * at.n + p]);
        }
        if !gradient.is_empty() {
            gradient.copy_from_slice(at.change);
        }
    }

    fn product(&self, _at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        product.copy_from_slice(direction);
    }
}

fn energy(discretisation: Discretisation) -> DeformationEnergy {
    let positions: Vec<f64> = (0..60).flat_map(|k| [f64::from(k / 6), f64::from(k % 6)]).collect();
    let body = Arc::new(Body::new(2, &positions, &[1.0; 60], Some(1.0)));
    let formulation = Formulation {
        horizon: 1.5,
        order: OperatorOrder::First,
        discretisation,
        influence: &Constant,
    };
    DeformationEnergy::new(body, formulation, Box::new(Linear(4))).unwrap()
}

#[test]
fn patterns_are_the_reach_of_the_energy() {
    // In a lattice with horizon 1.5 neighbours are those of a king's move.
    for (discretisation, reach) in [(Discretisation::Nodal, 2), (Discretisation::BondQuadrature, 3)]
    {
        let energy = energy(discretisation);
        let pattern = energy.pattern();
        for i in 0..60 {
            let columns = &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]];
            let near = |j: &u32| {
                let offset = |a: usize| {
                    let (x, y) = (energy.body.position(i)[a], energy.body.position(*j as usize)[a]);
                    (x - y).abs() <= f64::from(reach)
                };
                offset(0) && offset(1)
            };
            let expected: Vec<u32> = (i as u32..60).filter(near).collect();
            assert_eq!(columns, expected);
        }
    }
}

/// All numbers of a JSON array, or array of arrays, in order.
fn numbers(value: &serde_json::Value) -> Vec<f64> {
    match value.as_array() {
        Some(items) => items.iter().flat_map(numbers).collect(),
        None => vec![value.as_f64().unwrap()],
    }
}

/// Largest difference over the largest of the second.
fn error(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0, |most: f64, x| most.max(x.abs()));
    largest(&mut found.iter().zip(expected).map(|(f, e)| f - e))
        / largest(&mut expected.iter().copied())
}

#[test]
fn shape_tensors_and_deformation_gradients_of_bonds_are_those_of_the_reference() {
    let path =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/reference/correspondence_cloud_A.json");
    let file: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let data = &file["cloud_A"];
    let horizon = data["delta"].as_f64().unwrap();
    let body = Arc::new(Body::new(3, &numbers(&data["X"]), &numbers(&data["V"]), None));
    let place = |user: u64| body.user_index().iter().position(|&p| u64::from(p) == user).unwrap();
    let cubic = influence::CubicSpline { dimension: 3, horizon };
    for (kernel, weight) in [("one", &Constant as &dyn Influence), ("cubic", &cubic)] {
        let neighborhood = Arc::new(Neighborhood::new(&body, horizon).unwrap());
        let influence = influences(&body, &neighborhood, weight).unwrap();
        // K_0 of the first point, lengths in horizons in ours.
        let first = place(0);
        let sum = stabilisation::sums(&body, &neighborhood, &influence)[first];
        let order = OperatorOrder::First;
        let operator = GradientOperator::new(&body, neighborhood, order, &influence).unwrap();
        let (strengths, offsets) = operator.family(first);
        // A power of two: strengths have no unit.
        let unit = sum / strengths.iter().sum::<f64>();
        let rows = offsets.chunks(3).zip(strengths.iter().map(|s| unit * s));
        let shape = moments::moment_matrix(3, rows) * (horizon * horizon);
        let expected = &data["models"][format!("CC_{kernel}")]["K0"];
        let found = error(shape.as_slice(), &numbers(expected));
        println!("K_{kernel} {found:e}");
        assert!(found < 1e-14, "{kernel}: {found:e}");

        let expected = &data["models"][format!("BAQP_{kernel}")];
        let found = sum / expected["omega0_pt0"].as_f64().unwrap() - 1.0;
        println!("w0_{kernel} {found:e}");
        assert!(found.abs() < 1e-14, "{kernel}: {found:e}");
        // F of the bond from point 0 to point 3, the first in its family.
        let bond = &expected["Ft_bond0"];
        let u = body.from_user_order(&numbers(&data["u"]), 3);
        let mut h = vec![[[0.0; 3]; 3]; body.n_points()];
        operator.gradient(&u, &mut h);
        let fields = Fields { u: u.as_chunks::<3>().0, h: &h };
        let [i, j] = ["i", "j"].map(|end| place(bond[end].as_u64().unwrap()));
        let positions = body.positions().as_chunks::<3>().0;
        let mut f = quadrature::Bond::new(positions, [i, j], 0).gradient(fields);
        (0..3).for_each(|k| f[k][k] += 1.0);
        let found = error(f.as_flattened(), &numbers(&bond["F"]));
        println!("F_{kernel} {found:e}");
        // Condition numbers reach 34; F is of the size 1.
        assert!(found < 1e-14, "{kernel}: {found:e}");
    }
}

/// A cloud so flat that moment matrices are nearly singular: gradients of linear fields lose the digits
/// of the root of the condition, and not those of the condition itself.
#[test]
fn linear_fields_are_exact_in_nearly_flat_families() {
    let noise = crate::testing::pseudo_random(3 * 125, 7);
    let positions: Vec<f64> = (0..3 * 125)
        .map(|k| {
            let place = (k / 3 / 5usize.pow(2 - (k % 3) as u32) % 5) as f64 + 0.2 * noise[k];
            if k % 3 == 2 { 3e-6 * place } else { place }
        })
        .collect();
    let body = Arc::new(Body::new(3, &positions, &[1.0; 125], None));
    let neighborhood = Arc::new(Neighborhood::new(&body, 2.5).unwrap());
    let influence = influences(&body, &neighborhood, &Constant).unwrap();
    let operator =
        GradientOperator::new(&body, neighborhood, OperatorOrder::First, &influence).unwrap();
    let condition = operator.condition();
    assert!(condition > 1e10, "{condition:e}");
    let slopes = [[0.3, -0.2, 0.1], [0.5, 0.7, -0.4], [-0.6, 0.2, 0.9]];
    let displacement = |x: &[f64]| slopes.map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum());
    let u: Vec<f64> =
        body.positions().chunks(3).flat_map(|x| -> [f64; 3] { displacement(x) }).collect();
    let mut h = vec![[[0.0; 3]; 3]; 125];
    operator.gradient(&u, &mut h);
    let wrong =
        h.iter().map(|h| error(h.as_flattened(), slopes.as_flattened())).fold(0.0, f64::max);
    println!("{condition:e}: {wrong:e}");
    assert!(wrong < 10.0 * f64::EPSILON * condition.sqrt(), "{condition:e}: {wrong:e}");
}

/// Bodies: a lattice whose rows are gone along, with one volume, and clouds with many.
fn bodies() -> [(Arc<Body>, f64); 3] {
    let lattice = (0..12 * 8 * 9).map(|k| [k / 72, k / 9 % 8, k % 9].map(f64::from));
    let lattice: Vec<f64> = lattice.flatten().collect();
    let cloud = |d: usize, n: usize| {
        let volumes: Vec<f64> = pseudo_random(n, 5).iter().map(|x| 2.0 + x).collect();
        Arc::new(Body::new(d, &pseudo_random(n * d, 3), &volumes, None))
    };
    [
        (Arc::new(Body::new(3, &lattice, &[1.0; 864], Some(1.0))), 2.01),
        (cloud(2, 150), 0.6),
        (cloud(3, 150), 1.2),
    ]
}

/// The bits of the weights of points and bonds.
fn bits(places: &Places) -> Vec<u64> {
    let numbers = match places {
        Places::Points => Vec::new(),
        Places::Stabilised(deviations) => {
            [&deviations.strength[..], &deviations.stiffness].concat()
        }
        Places::Bonds(quadrature) => quadrature.weight.clone(),
    };
    numbers.into_iter().map(f64::to_bits).collect()
}

/// What the ends of bonds that went have alone is what all points have of what is left, to the bit: gradients,
/// weights of bonds, stiffnesses against deviations.
#[test]
fn ends_have_what_all_points_have_of_what_is_left() {
    let kinds = [
        Discretisation::Nodal,
        Discretisation::Stabilised(Stabilisation::Silling { stiffness: 3.0 }),
        Discretisation::Stabilised(Stabilisation::Wan),
        Discretisation::BondQuadrature,
    ];
    let mut released = 0;
    for (body, horizon) in bodies() {
        let (d, n) = (body.dimension(), body.n_points());
        let cubic = influence::CubicSpline { dimension: d, horizon };
        for (discretisation, order) in kinds
            .into_iter()
            .flat_map(|kind| [(kind, OperatorOrder::First), (kind, OperatorOrder::Second)])
        {
            let formulation = Formulation { horizon, order, discretisation, influence: &cubic };
            let law = Box::new(Linear(d * d));
            let mut energy = DeformationEnergy::new(Arc::clone(&body), formulation, law).unwrap();
            let whole = Arc::clone(energy.operator.shared_neighborhood());
            let u = pseudo_random(n * d, 9);
            for (new, is_lost) in goes_to_pieces(whole.n_bonds()) {
                energy.lose(&new);
                let left = whole.without(&is_lost);
                assert_eq!(*energy.neighborhood(), left);
                let known = (energy.operator.bits(), bits(&energy.places));
                let h = energy.displacement_gradients(&u);
                assert_eq!(
                    energy.operator.has_rows(),
                    d * n == 3 * 864 && order == OperatorOrder::First
                );
                let rows = energy.operator.rows.take();
                let size = h.iter().fold(1e-9, |size: f64, x| size.max(x.abs()));
                for (one, other) in h.iter().zip(energy.displacement_gradients(&u)) {
                    assert!((one - other).abs() < 1e-11 * size, "{one:e} {other:e}");
                }
                energy.operator.rows = rows;
                let all: Vec<usize> = (0..n).collect();
                energy.operator.fit_again(&all);
                let law = LawOfPoints { law: &*energy.law, materials: None };
                let as_before = (&energy.operator, &Gaps::default());
                energy.places.lose(as_before, law, discretisation, &all);
                assert!((energy.operator.bits(), bits(&energy.places)) == known);
                assert_eq!(energy.displacement_gradients(&u), h);
                // What comes back is what never went.
                energy.regain(&new);
                energy.lose(&new);
                assert!((energy.operator.bits(), bits(&energy.places)) == known);
                assert_eq!(energy.displacement_gradients(&u), h);
                released += energy.singular().len();
            }
        }
    }
    assert!(released > 1000, "{released}");
}
