//! Products with the tangent and its diagonal without the matrix, against the matrix.

use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Elements, Laws};
use piola_runtime::body::Body;
use piola_runtime::element::{
    Contributions, Element, InteractionBatch, MeasureElement, NonFiniteLane, Order,
};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::Measure;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{Random, cloud, displacements, distance, lattice, norm, seth_hill};

fn energy(dimension: usize, laws: [bool; 3]) -> (DiscreteEnergy, Vec<f64>) {
    let counts: &[usize] = if dimension == 2 { &[11, 6] } else { &[8, 4, 4] };
    let body = cloud(counts, 0.1, 3);
    let u = displacements(&body, 0.05, 5);
    let laws = Laws {
        bond: laws[0].then(|| seth_hill(1.0, 0)),
        triangle: laws[1].then(|| seth_hill(300.0, 2)),
        tetrahedron: (dimension == 3 && laws[2]).then(|| seth_hill(1e6, -1)),
    };
    (DiscreteEnergy::new(Arc::clone(&body), 0.21, Weights::Truncated, laws).unwrap(), u)
}

#[test]
fn products_and_diagonal_are_those_of_the_matrix() {
    for dimension in [2, 3] {
        for laws in [[true, false, false], [true, true, false], [true, false, true], [true; 3]] {
            let (energy, u) = energy(dimension, laws);
            let p = displacements(energy.body(), 0.3, 17);
            let (mut gradient, mut forces) = (vec![0.0; u.len()], vec![0.0; u.len()]);
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            let parts = energy.tangent(&u, &mut gradient, &mut tangent).unwrap();
            let mut product = vec![f64::NAN; u.len()];
            energy.hessian(&u).unwrap().multiply(&p, &mut product);
            let expected = tangent.multiply(&p);
            let scale = norm(&tangent.multiply_absolute(&p));
            let error = distance(&product, &expected) * norm(&expected);
            assert!(error <= 3e-16 * scale, "{dimension} {laws:?}: {error:e} {scale:e}");
            let block = dimension * dimension;
            let mut diagonal = vec![f64::NAN; u.len() * dimension];
            let again = energy.tangent_diagonal(&u, &mut forces, &mut diagonal).unwrap();
            assert_eq!(again, parts);
            assert!(forces == gradient, "{dimension} {laws:?}");
            let rows = energy.pattern().row_start.iter();
            let blocks: Vec<f64> = rows
                .take(u.len() / dimension)
                .flat_map(|row| &tangent.values[row * block..(row + 1) * block])
                .copied()
                .collect();
            assert!(diagonal == blocks, "{dimension} {laws:?}: the same sums");
            let points = u.len() / dimension;
            for point in [0, points / 3, points - 1] {
                let rows = &diagonal[point * block..(point + 1) * block];
                for axis in 0..dimension {
                    let mut unit = vec![0.0; u.len()];
                    unit[point * dimension + axis] = 1.0;
                    energy.hessian(&u).unwrap().multiply(&unit, &mut product);
                    let found = &product[point * dimension..(point + 1) * dimension];
                    let column: Vec<f64> = rows.chunks(dimension).map(|row| row[axis]).collect();
                    let error = distance(found, &column) * norm(&column);
                    assert!(error <= 1e-14 * norm(rows), "{dimension} {laws:?}: {error:e}");
                }
            }
        }
    }
}

/// A law whose tetrahedra are summed one by one, and not over pairs of their corners.
struct OneByOne(MeasureElement);

impl Element for OneByOne {
    fn measure(&self) -> Measure {
        self.0.measure()
    }

    fn dimension(&self) -> usize {
        self.0.dimension()
    }

    fn forbids_inversion(&self) -> bool {
        self.0.forbids_inversion()
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        self.0.evaluate(batch, order, out)
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    for dimension in [2, 3] {
        let (energy, u) = energy(dimension, [true; 3]);
        let p = displacements(energy.body(), 0.3, 17);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut out = [vec![0.0; u.len()], vec![0.0; u.len()], vec![0.0; 3 * u.len()]];
                let [product, gradient, diagonal] = &mut out;
                energy.hessian(&u).unwrap().multiply(&p, product);
                let diagonal = &mut diagonal[..u.len() * dimension];
                energy.tangent_diagonal(&u, gradient, diagonal).unwrap();
                out
            })
        };
        assert!(run(1) == run(2) && run(1) == run(4));
    }
}

/// A lattice whose points are off by 1e-5 of a spacing has tetrahedra as thin as that. Their volumes
/// have lost five digits where they are not worked out in twice the digits: forces then differ by
/// 1e-11 or so between the sums over pairs and the elements one by one: where the body is as flat now
/// as at rest, and where flat tetrahedra have opened.
#[test]
fn thin_tetrahedra_keep_their_digits_in_sums_over_pairs() {
    let mut random = Random(7);
    let regular = lattice(&[0.0; 3], &[4, 3, 3], 1.0);
    let positions: Vec<f64> =
        regular.positions().iter().map(|x| x + 1e-5 * random.next()).collect();
    let h = [0.1, 0.05, -0.08, 0.02, -0.06, 0.11, -0.03, 0.07, 0.04];
    // Thinness has no unit.
    for scale in [1.0, libm::ldexp(1.0, 30), libm::ldexp(1.0, -30)] {
        let scaled: Vec<f64> = positions.iter().map(|x| scale * x).collect();
        let body = Arc::new(Body::new(3, &scaled, regular.volumes(), None));
        let rows = body.positions().chunks_exact(3);
        let strained: Vec<f64> = rows
            .flat_map(|x| [0, 1, 2].map(|r| (0..3).map(|c| h[3 * r + c] * x[c]).sum::<f64>()))
            .collect();
        let opened: Vec<f64> =
            Random(11).vector(strained.len()).iter().map(|x| 0.3 * scale * x).collect();
        let laws = Laws { tetrahedron: Some(seth_hill(1.0, 1)), ..Laws::default() };
        let horizon = 2.1 * scale;
        let energy = DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Unit, laws).unwrap();
        let element = OneByOne(MeasureElement::new(Measure::Volume, 3, seth_hill(1.0, 1)));
        let elements = Elements { tetrahedron: Some(Box::new(element)), ..Elements::default() };
        let plain =
            DiscreteEnergy::with_elements(Arc::clone(&body), horizon, Weights::Unit, elements)
                .unwrap();
        let report = energy.report();
        assert!(100 * report.dropped_tetrahedra < report.tetrahedra, "thin ones are there");
        for u in [strained, opened] {
            let (mut gradient, mut one_by_one) = (vec![0.0; u.len()], vec![0.0; u.len()]);
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            energy.tangent(&u, &mut gradient, &mut tangent).unwrap();
            let mut whole = BlockMatrix::zeros(plain.pattern());
            plain.tangent(&u, &mut one_by_one, &mut whole).unwrap();
            let error = distance(&gradient, &one_by_one);
            assert!(error <= 1e-13, "{scale:e}: {error:e}");
            let error = distance(&tangent.values, &whole.values);
            assert!(error <= 1e-13, "{scale:e}: {error:e}");
            let p = displacements(&body, 0.3, 17);
            let mut product = vec![0.0; u.len()];
            energy.hessian(&u).unwrap().multiply(&p, &mut product);
            let expected = tangent.multiply(&p);
            let size = norm(&tangent.multiply_absolute(&p));
            let error = distance(&product, &expected) * norm(&expected);
            assert!(error <= 1e-14 * size, "{scale:e}: {error:e} {size:e}");
        }
    }
}
