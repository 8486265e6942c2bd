//! Bonds, triangles and tetrahedra along the rows of lattices: the same energies, forces and products as in batches
//! of kernels.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::kernel::{Law, Measure};
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::surface::{Surface, Weighting};
use piola_runtime::weights::Weights;
use rayon::ThreadPoolBuilder;

use crate::common::{displacements, distance};

const SPACING: f64 = 0.1;

/// By the length, with a force at rest; by its square; not affine.
const TRUE: &str = "3*L*(l/L - 1)^2 + 0.01*l";
const MODIFIED: &str = "exp(-L/delta)*L*((l/L)^2 - 1)^2 + 0.02*l^2/L";
const LOGARITHMIC: &str = "L*ln(l/L)^2";

/// A box with a hole, far from the origin.
fn body(counts: &[usize], nodes: Nodes) -> Arc<Body> {
    let lower = vec![31.7; counts.len()];
    let upper = counts.iter().map(|n| 31.7 + SPACING * *n as f64).collect();
    let points = Lattice { lower, upper, spacing: SPACING, nodes }.points().unwrap();
    let d = counts.len();
    let away = |x: &[f64]| libm::hypot(x[0] - 32.5, x[1] - 32.4) > 0.31;
    let kept = points.positions.chunks(d).zip(&points.volumes).filter(|(x, _)| away(x));
    let (positions, volumes): (Vec<&[f64]>, Vec<f64>) = kept.unzip();
    Arc::new(Body::new(d, &positions.concat(), &volumes, Some(SPACING)))
}

fn bodies() -> [Arc<Body>; 4] {
    [
        body(&[31, 23], Nodes::Cells),
        body(&[26, 21], Nodes::Corners),
        body(&[14, 9, 13], Nodes::Corners),
        pieces(&body(&[10, 7, 9], Nodes::Corners)),
    ]
}

/// The same points in two pieces, the upper one listed first: some bonds of a vector go from the lower to
/// the upper point, others back.
fn pieces(of: &Body) -> Arc<Body> {
    let points = of.positions().chunks(of.dimension()).zip(of.volumes());
    let (upper, lower): (Vec<_>, Vec<_>) = points.partition(|(x, _)| x[1] > 32.05);
    let (positions, volumes): (Vec<&[f64]>, Vec<f64>) = upper.into_iter().chain(lower).unzip();
    Arc::new(Body::new(of.dimension(), &positions.concat(), &volumes, of.spacing()))
}

fn laws(psi: &str, level: Level, d: usize) -> Laws {
    laws_at(psi, level, d, 2.2 * SPACING)
}

fn laws_at(psi: &str, level: Level, d: usize, horizon: f64) -> Laws {
    let volumes = if d == 3 { "psi(v) = 30*V*(v/V - 1)^2 + 0.1*v" } else { "" };
    let text = format!("psi(l) = {psi}\npsi(a) = 20*A*(a/A - 1)^2\n{volumes}\n");
    laws_of(&text, level, d, horizon)
}

fn laws_of(energies: &str, level: Level, d: usize, horizon: f64) -> Laws {
    let (_, model) = check_text(&format!("potential p\n{energies}")).unwrap();
    let settings: [(String, Setting); 0] = [];
    let values = model.values(d, &settings, Some(horizon)).unwrap();
    let compiled = model.compile(&values, Mode::Jit(level), Form::Accurate).unwrap();
    let mut laws = Laws::default();
    for kernel in compiled.kernels {
        let slot = match kernel.measure() {
            Measure::Length => &mut laws.bond,
            Measure::Area => &mut laws.triangle,
            Measure::Volume => &mut laws.tetrahedron,
        };
        let law: Box<dyn Law> = Box::new(kernel);
        *slot = Some(law);
    }
    laws
}

/// The measures of a body's laws.
fn measures(body: &Body) -> &'static [Measure] {
    &Measure::ALL[..body.dimension()]
}

fn energy(body: &Arc<Body>, psi: &str, level: Level, weights: Weights) -> DiscreteEnergy {
    let laws = laws(psi, level, body.dimension());
    DiscreteEnergy::new(Arc::clone(body), 2.2 * SPACING, weights, laws).unwrap()
}

/// What an energy gives: its parts, forces, tangent, and a product without it.
struct State {
    parts: Vec<f64>,
    forces: Vec<f64>,
    tangent: Vec<f64>,
    product: Vec<f64>,
}

fn state(energy: &DiscreteEnergy, u: &[f64]) -> State {
    let nothing = vec![0.0; energy.parts().len()];
    let (mut parts, mut forces) = (nothing.clone(), vec![f64::NAN; u.len()]);
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    energy.evaluate(u, Wanted::Tangent(&mut forces, &mut tangent), &mut parts).unwrap();
    // All passes agree to the last bit.
    let mut others = [vec![f64::NAN; u.len()], vec![f64::NAN; u.len()]];
    let mut found = [nothing.clone(), nothing];
    energy.evaluate(u, Wanted::Energy, &mut found[0]).unwrap();
    energy.evaluate(u, Wanted::Forces(&mut others[0]), &mut found[1]).unwrap();
    energy.evaluate(u, Wanted::Forces(&mut others[1]), &mut []).unwrap();
    assert!(found.iter().all(|found| *found == parts), "{found:?}, {parts:?}");
    assert!(others.iter().all(|other| *other == forces));
    let (d, row_start) = (energy.body().dimension(), &energy.pattern().row_start);
    let mut diagonal = vec![0.0; u.len() * d];
    energy.evaluate(u, Wanted::Diagonal(&mut others[1], &mut diagonal), &mut found[1]).unwrap();
    assert!(others[1] == forces && found[1] == parts);
    for (point, own) in diagonal.chunks(d * d).enumerate() {
        assert_eq!(own, &tangent.values[row_start[point] * d * d..][..d * d]);
    }
    let p: Vec<f64> = u.iter().rev().copied().collect();
    let mut product = vec![f64::NAN; u.len()];
    energy.hessian(u).unwrap().multiply(&p, &mut product);
    State { parts, forces, tangent: tangent.values, product }
}

/// Positions are rounded by 32 m times 1.1e-16, lengths by 1e-14 of themselves and more: that far apart
/// are the bonds of runs, which are whole spacings, and those between positions.
#[test]
fn runs_give_what_batches_give() {
    for body in bodies() {
        for weights in [Weights::Uniform, Weights::Truncated, Weights::Volumes, Weights::Unit] {
            for psi in [TRUE, MODIFIED] {
                let of = |level| energy(&body, psi, level, weights);
                let (runs, batches) = (of(Level::Fast), of(Level::Strict));
                assert_eq!(runs.along_rows(), measures(&body));
                assert_eq!(batches.along_rows(), []);
                for strain in [0.3, 1e-3] {
                    let u = displacements(&body, strain, 5);
                    let (found, expected) = (state(&runs, &u), state(&batches, &u));
                    let errors = [
                        distance(&found.parts, &expected.parts),
                        distance(&found.forces, &expected.forces),
                        distance(&found.tangent, &expected.tangent),
                        distance(&found.product, &expected.product),
                    ];
                    let bars = errors.map(|error| error < 4e-13);
                    assert!(bars == [true; 4], "{psi}, {weights:?}, {strain}: {errors:?}");
                }
            }
        }
    }
}

/// The same points moved a little, so that nothing repeats.
fn cloud(of: &Body) -> Arc<Body> {
    let shaken = of.positions().iter().zip(displacements(of, 1e-3, 9));
    let positions: Vec<f64> = shaken.map(|(x, u)| x + u).collect();
    Arc::new(Body::new(of.dimension(), &positions, of.volumes(), None))
}

/// Of laws at rest at rest.
const BARE: [&str; 2] = ["3*L*(l/L - 1)^2", "exp(-L/delta)*L*((l/L)^2 - 1)^2"];

/// Bonds of clouds in fours, and of lattices whose runs are refused.
#[test]
fn fours_give_what_batches_give() {
    for body in bodies().map(|body| cloud(&body)) {
        for weights in [Weights::Volumes, Weights::Unit] {
            for psi in BARE {
                let of = |level| energy(&body, psi, level, weights);
                let (fours, batches) = (of(Level::Fast), of(Level::Strict));
                assert_eq!(fours.report().ways, ["batches", "fours"]);
                assert_eq!(batches.report().ways, ["batches"]);
                for strain in [0.3, 1e-3, 1e-9] {
                    let u = displacements(&body, strain, 5);
                    let (found, expected) = (state(&fours, &u), state(&batches, &u));
                    let errors = [
                        distance(&found.parts, &expected.parts),
                        distance(&found.forces, &expected.forces),
                        distance(&found.tangent, &expected.tangent),
                        distance(&found.product, &expected.product),
                    ];
                    let bars = errors.map(|error| error < 4e-15);
                    assert!(bars == [true; 4], "{psi}, {weights:?}, {strain}: {errors:?}");
                }
            }
        }
    }
}

/// Lattices so small that hardly a bond repeats, with bonds corrected at faces.
#[test]
fn fours_know_of_corrections() {
    for counts in [&[6, 4][..], &[4, 3, 3]] {
        let body = body(counts, Nodes::Corners);
        for surface in [Surface::Energy, Surface::Directional] {
            let weighting = Weighting { surface, ..Weighting::from(Weights::Volumes) };
            let of = |level| {
                let laws = Laws {
                    triangle: None,
                    tetrahedron: None,
                    ..laws(BARE[0], level, counts.len())
                };
                let (body, horizon) = (Arc::clone(&body), 2.2 * SPACING);
                DiscreteEnergy::new(body, horizon, weighting, laws).unwrap()
            };
            let (fours, batches) = (of(Level::Fast), of(Level::Strict));
            assert_eq!(fours.report().ways, ["fours"]);
            let u = displacements(&body, 0.1, 5);
            let [found, expected] = [&fours, &batches].map(|energy| {
                let (mut forces, mut parts) = (vec![0.0; u.len()], vec![0.0]);
                energy.evaluate(&u, Wanted::Forces(&mut forces), &mut parts).unwrap();
                [parts, forces].concat()
            });
            let error = distance(&found, &expected);
            assert!(error < 4e-15, "{counts:?} {surface:?}: {error:e}");
        }
    }
}

#[test]
fn what_fours_refuse_is_named() {
    let body = cloud(&bodies()[2]);
    let energy = energy(&body, BARE[0], Level::Fast, Weights::Unit);
    let (mut u, mut forces) = (vec![0.0; 3 * body.n_points()], vec![0.0; 3 * body.n_points()]);
    u[3 * 100 + 1] = f64::NAN;
    let error = energy.forces(&u, &mut forces).unwrap_err();
    assert!(error.points.contains(&100), "{error}");
    // A law with a force at rest keeps its kernel.
    let bent = self::energy(&body, TRUE, Level::Fast, Weights::Unit);
    assert_eq!(bent.report().ways, ["batches"]);
}

/// Lengths of 1e-25 and of 1e24 m: squares of areas are far from the ends of the range of numbers.
#[test]
fn the_unit_of_length_does_not_matter() {
    let at_rest = &bodies()[2];
    for exponent in [-80, 80] {
        let scaled = |x: &[f64]| x.iter().map(|x| libm::scalbn(*x, exponent)).collect::<Vec<f64>>();
        let spacing = libm::scalbn(SPACING, exponent);
        let (positions, volumes) = (scaled(at_rest.positions()), vec![1.0; at_rest.n_points()]);
        let body = Arc::new(Body::new(3, &positions, &volumes, Some(spacing)));
        let of = |level| {
            let laws = laws_at(TRUE, level, 3, 2.2 * spacing);
            DiscreteEnergy::new(Arc::clone(&body), 2.2 * spacing, Weights::Unit, laws).unwrap()
        };
        let (rows, batches) = (of(Level::Fast), of(Level::Strict));
        assert_eq!(rows.along_rows(), measures(&body));
        let u = scaled(&displacements(at_rest, 0.1, 6));
        let (found, expected) = (state(&rows, &u), state(&batches, &u));
        for (found, expected) in [
            (&found.parts, &expected.parts),
            (&found.forces, &expected.forces),
            (&found.product, &expected.product),
        ] {
            // Norms of such numbers are numbers, too.
            let largest = expected.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let over = |x: &[f64]| x.iter().map(|x| x / largest).collect::<Vec<f64>>();
            let error = distance(&over(found), &over(expected));
            assert!(error < 4e-13, "2^{exponent}: {error:e}");
        }
    }
}

/// The product is that with the stored tangent.
#[test]
fn products_are_those_of_the_tangent() {
    for body in bodies() {
        for psi in [TRUE, MODIFIED] {
            let energy = energy(&body, psi, Level::Fast, Weights::Uniform);
            let u = displacements(&body, 0.2, 3);
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            energy.tangent(&u, &mut vec![0.0; u.len()], &mut tangent).unwrap();
            let p: Vec<f64> = u.iter().rev().copied().collect();
            let found = state(&energy, &u).product;
            let error = distance(&found, &tangent.multiply(&p));
            assert!(error < 1e-13, "{psi}: {error:e}");
            // Solvers take products of the stored tangent where there are triangles.
            assert!(!energy.has_quick_products());
            let laws = Laws {
                triangle: None,
                tetrahedron: None,
                ..laws(psi, Level::Fast, body.dimension())
            };
            let horizon = 2.2 * SPACING;
            let bonds = DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Unit, laws);
            assert!(bonds.unwrap().has_quick_products());
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let lattice = &bodies()[2];
    for (body, psi) in [(lattice, MODIFIED), (&cloud(lattice), BARE[0])] {
        let energy = energy(body, psi, Level::Fast, Weights::Volumes);
        let u = displacements(body, 0.1, 8);
        let [one, two] = [1, 3].map(|threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| state(&energy, &u))
        });
        assert!(one.parts == two.parts && one.forces == two.forces && one.product == two.product);
        assert!(one.tangent == two.tangent);
    }
}

#[test]
fn laws_that_are_not_affine_and_strict_ones_go_in_batches() {
    let body = &bodies()[0];
    let of = |psi, level| energy(body, psi, level, Weights::Unit).along_rows();
    assert_eq!(of(LOGARITHMIC, Level::Fast), [Measure::Area]);
    assert_eq!(of(TRUE, Level::Fast), [Measure::Length, Measure::Area]);
    assert_eq!(of(TRUE, Level::Strict), []);
}

/// The triangles on a bond have owners in several slabs: where one of them is thin, no tangent goes by bonds. Forces and
/// products of the slabs that have it go in batches.
#[test]
fn a_thin_triangle_leaves_all_tangents_to_batches() {
    for body in [&bodies()[1], &bodies()[2]] {
        let d = body.dimension();
        let at = |point: usize| &body.positions()[d * point..][..d];
        // Two neighbours of a point in the middle, a spacing away along each of two axes.
        let own = body.n_points() / 2;
        let along = |axis: usize| {
            let is_there = |point: &usize| {
                let off =
                    |k: usize| at(*point)[k] - at(own)[k] - if k == axis { SPACING } else { 0.0 };
                (0..d).all(|k| off(k).abs() < 1e-6 * SPACING)
            };
            (0..body.n_points()).find(is_there).unwrap()
        };
        let (first, second) = (along(0), along(1));
        let mut u = displacements(body, 1e-3, 4);
        // The second lies between the two others, but for a thousandth of a spacing.
        for axis in 0..d {
            let (own, first) = (u[d * own + axis], u[d * first + axis]);
            u[d * second + axis] = 0.5 * (own + first);
        }
        u[d * second] += 0.5 * SPACING;
        u[d * second + 1] -= 0.999 * SPACING;
        let of = |level| energy(body, TRUE, level, Weights::Volumes);
        let (found, expected) = (state(&of(Level::Fast), &u), state(&of(Level::Strict), &u));
        for (what, found, expected) in [
            ("forces", &found.forces, &expected.forces),
            ("tangent", &found.tangent, &expected.tangent),
            ("product", &found.product, &expected.product),
        ] {
            let error = distance(found, expected);
            assert!(error < 4e-13, "{what}: {error:e}");
        }
    }
}

/// Along rows and in batches, by the square of areas in space.
fn by_squares_of_areas(body: &Arc<Body>, weights: Weights) -> [DiscreteEnergy; 2] {
    [Level::Fast, Level::Strict].map(|level| {
        let horizon = 2.2 * SPACING;
        let laws = laws_of("psi(a) = 20*A*((a/A)^2 - 1)^2\n", level, 3, horizon);
        DiscreteEnergy::new(Arc::clone(body), horizon, weights, laws).unwrap()
    })
}

#[test]
fn squares_of_areas_give_what_batches_give() {
    for body in &bodies()[2..] {
        for weights in [Weights::Unit, Weights::Volumes] {
            let energies = by_squares_of_areas(body, weights);
            assert_eq!(energies[0].along_rows(), [Measure::Area]);
            let u = displacements(body, 0.2, 7);
            let [found, expected] = energies.each_ref().map(|energy| state(energy, &u));
            for (what, found, expected) in [
                ("parts", &found.parts, &expected.parts),
                ("forces", &found.forces, &expected.forces),
                ("tangent", &found.tangent, &expected.tangent),
                ("product", &found.product, &expected.product),
            ] {
                let error = distance(found, expected);
                assert!(error < 4e-13, "{weights:?}, {what}: {error:e}");
            }
        }
    }
}

/// Laws by the square of the area have derivatives where two corners are one point.
#[test]
fn triangles_without_area_have_tangents() {
    let body = &bodies()[2];
    let mut u = vec![0.0; 3 * body.n_points()];
    let [rows, batches] = by_squares_of_areas(body, Weights::Unit);
    assert_eq!(rows.along_rows(), [Measure::Area]);
    let own = body.n_points() / 2;
    let next = rows.neighborhood().upper(own).iter().find(|other| {
        let bond = 3 * *other as usize;
        (body.positions()[bond] - body.positions()[3 * own] - SPACING).abs() < 1e-6 * SPACING
            && (1..3)
                .all(|k| (body.positions()[bond + k] - body.positions()[3 * own + k]).abs() < 1e-9)
    });
    u[3 * next.unwrap() as usize] = -SPACING;
    let (found, expected) = (state(&rows, &u), state(&batches, &u));
    for (found, expected) in
        [(&found.tangent, &expected.tangent), (&found.product, &expected.product)]
    {
        let error = distance(found, expected);
        assert!(error < 4e-13, "{error:e}");
    }
}

/// What runs refuse is worked out again in batches, which name the points, or find that it is finite.
#[test]
fn what_is_not_finite_is_named() {
    for body in [&bodies()[0], &bodies()[2]] {
        let energy = energy(body, TRUE, Level::Fast, Weights::Unit);
        assert!(!energy.along_rows().is_empty());
        let d = body.dimension();
        let (mut u, mut forces) = (vec![0.0; d * body.n_points()], vec![0.0; d * body.n_points()]);
        let at_rest = state(&energy, &u).forces;
        // A bond of the run, which is a spacing long, is of no length now.
        u[d * 100 + 1] = SPACING;
        let batches = self::energy(body, TRUE, Level::Strict, Weights::Unit);
        let mut expected = forces.clone();
        let found = (energy.forces(&u, &mut forces), batches.forces(&u, &mut expected));
        assert_eq!(found.0.is_ok(), found.1.is_ok());
        u[d * 100] = f64::INFINITY;
        let error = energy.forces(&u, &mut forces).unwrap_err();
        assert!(error.points.contains(&100), "{error}");
        energy.hessian(&u).unwrap().multiply(&expected, &mut forces);
        assert!(forces.iter().all(|x| x.is_nan()));
        // The next pass knows nothing of that.
        assert_eq!(state(&energy, &vec![0.0; u.len()]).forces, at_rest);
    }
}
