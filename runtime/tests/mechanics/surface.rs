//! Corrected bonds: against sums written out here, against a beam of another program (beams.json), and
//! what a correction promises.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::assembly::{AssemblyError, DiscreteEnergy, Elements, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::kernel::{Law, Measure};
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::materials::Materials;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::newton::NewtonSettings;
use piola_runtime::solve::steps::{Drive, StepSettings, run_steps};
use piola_runtime::surface::{CorrectionError, Surface, Volumes, Weighting};
use piola_runtime::weights::Weights;
use rayon::ThreadPoolBuilder;

use crate::common::{cloud, displacements, distance, lattice, laws, numbers, reference, seth_hill};

/// Of the lattices here.
const H: f64 = 0.1;

/// Horizon in spacings, no length of a bond.
const M: f64 = 2.3;

fn weighting(weights: Weights, surface: Surface, volumes: Volumes) -> Weighting {
    Weighting { weights, surface, volumes }
}

/// What corrects bonds.
fn corrections() -> Vec<Weighting> {
    let mut all = vec![weighting(Weights::Volumes, Surface::None, Volumes::Partial)];
    for surface in [Surface::Energy, Surface::Directional] {
        all.push(weighting(Weights::Volumes, surface, Volumes::Partial));
        for weights in [Weights::Uniform, Weights::Truncated, Weights::Volumes] {
            all.push(weighting(weights, surface, Volumes::Whole));
        }
    }
    all
}

/// A box with a notch. The first has no point whose family is full.
fn bodies() -> [Arc<Body>; 3] {
    let body = |counts: &[usize], nodes: Nodes| {
        let upper = counts.iter().map(|n| H * *n as f64).collect();
        let lattice = Lattice { lower: vec![0.0; counts.len()], upper, spacing: H, nodes };
        let points = lattice.points().unwrap();
        let d = counts.len();
        let kept = points.positions.chunks(d).zip(&points.volumes);
        let kept = kept.filter(|(x, _)| (x[0] - 0.7).abs() > 0.11 || x[1] > 0.16);
        let (positions, volumes): (Vec<&[f64]>, Vec<f64>) = kept.unzip();
        Arc::new(Body::new(d, &positions.concat(), &volumes, Some(H)))
    };
    [
        body(&[14, 4, 3], Nodes::Corners),
        body(&[24, 13], Nodes::Corners),
        body(&[13, 8, 9], Nodes::Cells),
    ]
}

fn energy(body: &Arc<Body>, weighting: Weighting, laws: Laws) -> DiscreteEnergy {
    DiscreteEnergy::new(Arc::clone(body), M * H, weighting, laws).unwrap()
}

fn total(energy: &DiscreteEnergy, u: &[f64]) -> f64 {
    let mut parts = [0.0];
    energy.evaluate(u, Wanted::Energy, &mut parts).unwrap();
    parts[0]
}

/// `C/2 L (l/L - 1)^2`, of which `psi''(L) L^2 = C L`.
const C: f64 = 3.0;

/// `w_bulk/w` for strains along each axis and for one alike in all directions, over families that are
/// written out: `reach` whole spacings each way. Of weights that are products of volumes.
fn gains(body: &Body, surface: Surface, part: &dyn Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let d = body.dimension();
    let strained = |xi: &[f64], axis: usize| {
        let length = xi.iter().map(|x| x * x).sum::<f64>().sqrt();
        let along = xi[axis] / length;
        let strain = match surface {
            Surface::Directional => along * along,
            _ => 1.0,
        };
        0.25 * C * length * strain * strain * part(length)
    };
    let cell = (0..d).fold(1.0, |volume, _| volume * H);
    let mut inside = vec![0.0; d];
    for place in 0..7_usize.pow(d as u32) {
        let step = |axis: usize| (place / 7_usize.pow(axis as u32) % 7) as f64 - 3.0;
        let xi: Vec<f64> = (0..d).map(|axis| H * step(axis)).collect();
        let square: f64 = (0..d).map(|axis| step(axis) * step(axis)).sum();
        if square > 0.0 && square < M * M {
            (0..d).for_each(|axis| inside[axis] += cell * strained(&xi, axis));
        }
    }
    let of_point = |i: usize| -> Vec<f64> {
        let density = |axis: usize| -> f64 {
            let others = (0..body.n_points()).filter(|j| *j != i);
            let bond = |j: usize| -> f64 {
                let ends = body.position(j).iter().zip(body.position(i));
                let xi: Vec<f64> = ends.map(|(to, from)| to - from).collect();
                let is_near = xi.iter().map(|x| x * x).sum::<f64>() < M * M * H * H;
                if is_near { body.volumes()[j] * strained(&xi, axis) } else { 0.0 }
            };
            others.map(bond).sum()
        };
        (0..d).map(|axis| inside[axis] / density(axis)).collect()
    };
    (0..body.n_points()).map(of_point).collect()
}

/// The part of a cell, written as LAMMPS does.
fn ramp(length: f64) -> f64 {
    let half = 0.5 * H;
    if length > M * H - half {
        -length / (2.0 * half) + (1.0 + (M * H - half) / (2.0 * half))
    } else {
        1.0
    }
}

fn whole(_: f64) -> f64 {
    1.0
}

/// The energy of displacements, bond by bond; `scale` multiplies psi of a bond.
fn written_out(
    (body, u): (&Body, &[f64]),
    surface: Surface,
    part: &dyn Fn(f64) -> f64,
    scale: impl Fn(usize, usize) -> f64,
) -> f64 {
    let (d, gains) = (body.dimension(), gains(body, surface, part));
    let mut sum = 0.0;
    for i in 0..body.n_points() {
        for j in i + 1..body.n_points() {
            let xi: Vec<f64> = (0..d).map(|k| body.position(j)[k] - body.position(i)[k]).collect();
            let length = xi.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > M * H {
                continue;
            }
            let now: f64 = (0..d).map(|k| xi[k] + u[j * d + k] - u[i * d + k]).map(|x| x * x).sum();
            let strain = now.sqrt() / length - 1.0;
            let factor = match surface {
                Surface::None => 1.0,
                Surface::Energy => 0.5 * (gains[i][0] + gains[j][0]),
                Surface::Directional => {
                    let axis = |k: usize| 2.0 * xi[k] / (length * (gains[i][k] + gains[j][k]));
                    1.0 / (0..d).map(axis).map(|x| x * x).sum::<f64>().sqrt()
                }
            };
            let weight = body.volumes()[i] * body.volumes()[j] * factor * part(length);
            sum += weight * scale(i, j) * 0.5 * C * length * strain * strain;
        }
    }
    sum
}

#[test]
fn energies_are_those_of_sums_written_out() {
    for body in bodies() {
        let u = displacements(&body, 0.1, 3);
        for surface in [Surface::None, Surface::Energy, Surface::Directional] {
            for (volumes, part) in
                [(Volumes::Whole, whole as fn(f64) -> f64), (Volumes::Partial, ramp)]
            {
                let weighting = weighting(Weights::Volumes, surface, volumes);
                let found = total(&energy(&body, weighting, laws([C, 0.0, 0.0], 1)), &u);
                let expected = written_out((&body, &u), surface, &part, |_, _| 1.0);
                // Some thousand bonds, strains of 0.1 from rounded lengths.
                assert!((found / expected - 1.0).abs() < 1e-13, "{weighting:?} {found} {expected}");
            }
        }
    }
}

/// Points measure themselves by the law of their own material, which cancels here; bonds between the
/// two have the mean of both laws.
#[test]
fn of_two_materials_each_point_takes_its_own() {
    for body in bodies() {
        let u = displacements(&body, 0.1, 4);
        let of_point = |point: usize| u8::from((point * 7) % 5 < 2);
        let materials = Materials::new((0..body.n_points()).map(of_point).collect(), Vec::new());
        let neighborhood = Arc::new(Neighborhood::new(&body, M * H).unwrap());
        let of = |c: f64| laws([c, 0.0, 0.0], 1).into_elements(body.dimension());
        let scale = |i: usize, j: usize| {
            0.5 * [i, j].map(|p| [1.0, 5.0][of_point(p) as usize]).iter().sum::<f64>()
        };
        for surface in [Surface::Energy, Surface::Directional] {
            let energy = DiscreteEnergy::of_materials(
                Arc::clone(&body),
                Arc::clone(&neighborhood),
                weighting(Weights::Volumes, surface, Volumes::Whole),
                Some(Arc::new(materials.clone())),
                vec![of(C), of(5.0 * C)],
            )
            .unwrap();
            let expected = written_out((&body, &u), surface, &whole, scale);
            assert!((total(&energy, &u) / expected - 1.0).abs() < 1e-13, "{surface:?}");
            balanced_and_exact(&energy, &u);
        }
    }
}

/// Forces are derivatives of the energy, and tangents and products those of forces; forces balance.
fn balanced_and_exact(energy: &DiscreteEnergy, u: &[f64]) {
    let (n, d) = (u.len(), energy.dimension());
    let p = displacements(energy.body(), 1.0, 9);
    let moved = |step: f64| -> Vec<f64> { u.iter().zip(&p).map(|(u, p)| u + step * p).collect() };
    let mut forces = vec![0.0; n];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    energy.evaluate(u, Wanted::Tangent(&mut forces, &mut tangent), &mut [0.0]).unwrap();
    let step = 1e-5;
    let slope = (total(energy, &moved(step)) - total(energy, &moved(-step))) / (2.0 * step);
    let along: f64 = forces.iter().zip(&p).map(|(f, p)| f * p).sum();
    // A central difference: step^2, and roundoff over step.
    let terms: f64 = forces.iter().zip(&p).map(|(f, p)| (f * p).abs()).sum();
    assert!((slope - along).abs() < 1e-9 * terms, "{slope} {along} {terms}");
    let at = |step: f64| {
        let mut forces = vec![0.0; n];
        energy.forces(&moved(step), &mut forces).unwrap();
        forces
    };
    let bent: Vec<f64> =
        at(step).iter().zip(&at(-step)).map(|(a, b)| (a - b) / (2.0 * step)).collect();
    let mut product = vec![0.0; n];
    energy.hessian(u).unwrap().multiply(&p, &mut product);
    assert!(distance(&bent, &product) < 1e-7, "{}", distance(&bent, &product));
    let whole = crate::common::dense(&tangent);
    let by_tangent: Vec<f64> =
        whole.chunks(n).map(|row| row.iter().zip(&p).map(|(k, p)| k * p).sum()).collect();
    assert!(distance(&product, &by_tangent) < 1e-13);
    let largest = forces.iter().fold(0.0, |most: f64, f| most.max(f.abs()));
    for axis in 0..d {
        let sum: f64 = forces.iter().skip(axis).step_by(d).sum();
        assert!(sum.abs() < 1e-13 * n as f64 * largest, "{sum:e} of {largest:e}");
        let other = (axis + 1) % d;
        let x = |dof: usize| energy.positions()[dof] + u[dof];
        let moment: f64 = (0..n / d)
            .map(|point| point * d)
            .map(|k| x(k + axis) * forces[k + other] - x(k + other) * forces[k + axis])
            .sum();
        assert!(moment.abs() < 1e-13 * n as f64 * largest, "{moment:e} of {largest:e}");
    }
}

#[test]
fn forces_are_exact_derivatives_and_balance() {
    let [thin, ..] = bodies();
    let u = displacements(&thin, 0.1, 5);
    for weighting in corrections() {
        balanced_and_exact(&energy(&thin, weighting, laws([C, 0.0, 0.0], -2)), &u);
    }
}

/// By the length, by its square; with the horizon in it.
const PSI: [&str; 2] = ["3*L*(l/L - 1)^2 + 0.01*l", "exp(-L/delta)*L*((l/L)^2 - 1)^2 + 0.02*l^2/L"];

fn compiled(psi: &str, level: Level, d: usize) -> Laws {
    let (_, model) = check_text(&format!("potential p\npsi(l) = {psi}\n")).unwrap();
    let settings: [(String, Setting); 0] = [];
    let values = model.values(d, &settings, Some(M * H)).unwrap();
    let mut compiled = model.compile(&values, Mode::Jit(level), Form::Accurate).unwrap();
    let law: Box<dyn Law> = Box::new(compiled.kernels.remove(0));
    Laws { bond: Some(law), ..Laws::default() }
}

/// What an energy gives: its value, forces, tangent and a product.
fn state(energy: &DiscreteEnergy, u: &[f64]) -> [Vec<f64>; 4] {
    let (mut parts, mut forces) = (vec![0.0], vec![f64::NAN; u.len()]);
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    energy.evaluate(u, Wanted::Tangent(&mut forces, &mut tangent), &mut parts).unwrap();
    let (mut alone, mut found) = (vec![f64::NAN; u.len()], vec![0.0]);
    energy.evaluate(u, Wanted::Forces(&mut alone), &mut found).unwrap();
    assert!(found == parts && alone == forces);
    let p: Vec<f64> = u.iter().rev().copied().collect();
    let mut product = vec![f64::NAN; u.len()];
    energy.hessian(u).unwrap().multiply(&p, &mut product);
    [parts, forces, tangent.values, product]
}

#[test]
fn rows_of_a_lattice_give_what_batches_give_and_threads_the_same_bits() {
    let [_, plane, solid] = bodies();
    for body in [plane, solid] {
        let u = displacements(&body, 0.05, 6);
        for weighting in corrections() {
            for psi in PSI {
                let of = |level| energy(&body, weighting, compiled(psi, level, body.dimension()));
                let (rows, batches) = (of(Level::Fast), of(Level::Strict));
                assert_eq!(rows.along_rows(), [Measure::Length]);
                assert_eq!(batches.along_rows(), []);
                let (found, expected) = (state(&rows, &u), state(&batches, &u));
                for (found, expected) in found.iter().zip(&expected) {
                    let error = distance(found, expected);
                    assert!(error < 1e-13, "{weighting:?} {psi}: {error:e}");
                }
                for threads in [1, 2, 5] {
                    let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    let again = pool.install(|| state(&of(Level::Fast), &u));
                    assert!(again == found, "{threads}");
                }
            }
        }
    }
}

/// What `energy` promises: at a strain that is alike in all directions the body stores what its volume
/// would inside the lattice, whatever its shape. (Not every point: bonds have the mean of both ends.)
#[test]
fn a_body_that_swells_stores_what_its_volume_would_inside() {
    for body in bodies() {
        let (d, strain) = (body.dimension(), 1e-2);
        let u: Vec<f64> = body.positions().iter().map(|x| strain * x).collect();
        for volumes in [Volumes::Whole, Volumes::Partial] {
            // A full family around the middle of a block of nine spacings.
            let block = lattice(&vec![0.0; d], &vec![8; d], H);
            let part = if volumes == Volumes::Whole { whole } else { ramp };
            let middle = (0..block.n_points())
                .find(|point| block.position(*point).iter().all(|x| (x - 4.0 * H).abs() < 1e-9));
            let center = block.position(middle.unwrap()).to_vec();
            let of_neighbor = |x: &[f64]| {
                let square: f64 = x.iter().zip(&center).map(|(x, c)| (x - c) * (x - c)).sum();
                let (length, is_near) = (square.sqrt(), square > 0.0 && square < M * M * H * H);
                let psi = 0.5 * C * length * strain * strain;
                if is_near { 0.5 * block.volumes()[0] * part(length) * psi } else { 0.0 }
            };
            let density: f64 = block.positions().chunks(d).map(of_neighbor).sum();
            let of = |surface| {
                let weighting = weighting(Weights::Volumes, surface, volumes);
                total(&energy(&body, weighting, laws([C, 0.0, 0.0], 1)), &u)
            };
            let expected = density * body.volumes().iter().sum::<f64>();
            assert!((of(Surface::Energy) / expected - 1.0).abs() < 1e-12);
            // The bodies are small: without it they store 14 % to 59 % less.
            assert!(of(Surface::None) < 0.9 * expected);
        }
    }
}

/// The small cantilever of beams.json: the first layers held, dead loads on the top.
struct Cantilever {
    fixed: Vec<usize>,
    loads: Vec<f64>,
}

impl Drive for Cantilever {
    fn fixed(&self) -> &[usize] {
        &self.fixed
    }

    fn prescribed(&self, _: f64, values: &mut [f64]) {
        values.fill(0.0);
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        loads.iter_mut().zip(&self.loads).for_each(|(to, load)| *to = t * load);
    }
}

/// Another program's displacements, to 1e-10 of the largest. It measures against the energy of the
/// continuum, `9/2 K`, ours against that of the lattice: all bonds differ by one number, so the load is
/// multiplied by it, too, and displacements are the same.
#[test]
fn the_small_cantilever_is_that_of_another_program() {
    let (h, k) = (0.05, 20e9 / 1.5);
    let horizon = 12f64.sqrt() * h;
    let c = 18.0 * k / (std::f64::consts::PI * horizon * horizon * horizon * horizon);
    // c/4 sum_j V L over the full family: r^2 <= 12 spacings^2.
    let mut lengths = BTreeMap::new();
    for place in 0..343_i64 {
        let step = [place % 7 - 3, place / 7 % 7 - 3, place / 49 - 3];
        let square: i64 = step.iter().map(|x| x * x).sum();
        *lengths.entry(square).or_insert(0.0) += 1.0;
    }
    let near = lengths.iter().filter(|(square, _)| (1..=12).contains(*square));
    let sum: f64 = near.map(|(square, count)| count * (*square as f64).sqrt() * h).sum();
    let bulk = 0.25 * c * h * h * h * sum;
    let rows = reference("beams.json");
    let rows = rows["small_cantilever"]["rows"].as_array().unwrap();
    let mut compared = 0;
    for row in rows.iter().filter(|row| row["stretch"] == "s") {
        let (surface, scale) = match row["correction"].as_str().unwrap() {
            "none" => (Surface::None, 1.0),
            "iso" => (Surface::Energy, bulk / (4.5 * k)),
            other => panic!("{other}"),
        };
        let body = lattice(&[0.0; 3], &[14, 2, 3], h);
        let bond = Some(seth_hill(c, 1));
        let weighting = weighting(Weights::Volumes, surface, Volumes::Whole);
        let laws = Laws { bond, ..Laws::default() };
        let energy = DiscreteEnergy::new(Arc::clone(&body), horizon, weighting, laws).unwrap();
        assert_eq!(energy.report().bonds, row["bonds"].as_u64().unwrap());
        let at = |point: usize, axis: usize| (body.position(point)[axis] / h).round() as i32;
        let held = (0..body.n_points()).filter(|point| at(*point, 0) < 3);
        let fixed: Vec<usize> = held.flat_map(|point| 3 * point..3 * point + 3).collect();
        let mut loads = vec![0.0; 3 * body.n_points()];
        for point in (0..body.n_points()).filter(|p| at(*p, 0) >= 3 && at(*p, 2) == 3) {
            let half = if at(point, 0) == 14 { 0.5 } else { 1.0 };
            loads[3 * point + 2] = -scale * half * 10e3 * h / 3.0;
        }
        let newton = NewtonSettings { tolerance: 1e-14, ..NewtonSettings::default() };
        let settings = StepSettings { newton, ..StepSettings::default() };
        let (drive, watch) = (Cantilever { fixed, loads }, Watch::default());
        let solved =
            run_steps(&energy, &drive, &settings, &watch, &mut |_, _| ControlFlow::Continue(()));
        let found = body.to_user_order(&solved.unwrap().displacements, 3);
        let expected: Vec<f64> = row["u"].as_array().unwrap().iter().flat_map(numbers).collect();
        let largest = expected.iter().fold(0.0, |most: f64, u| most.max(u.abs()));
        let apart = found.iter().zip(&expected).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max);
        println!("{}: {:.1e}", row["correction"], apart / largest);
        assert!(apart < 1e-10 * largest, "{}: {:e}", row["correction"], apart / largest);
        compared += 1;
    }
    assert_eq!(compared, 2);
}

#[test]
fn what_cannot_be_corrected_is_refused() {
    let refuse = |body: &Arc<Body>, weighting: Weighting, laws: Laws| match DiscreteEnergy::new(
        Arc::clone(body),
        M * H,
        weighting,
        laws,
    ) {
        Err(AssemblyError::Correction(error)) => error,
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("accepted"),
    };
    let bonds = || laws([1.0, 0.0, 0.0], 1);
    let [body, ..] = bodies();
    for surface in [Surface::Energy, Surface::Directional] {
        let of = |weights| weighting(weights, surface, Volumes::Whole);
        let error = refuse(&cloud(&[5, 4, 3], H, 1), of(Weights::Volumes), bonds());
        assert_eq!(error, CorrectionError::Cloud);
        let error = refuse(&body, of(Weights::Volumes), laws([1.0, 1.0, 0.0], 1));
        assert_eq!(error, CorrectionError::NotBonds(Measure::Area));
        assert_eq!(refuse(&body, of(Weights::Unit), bonds()), CorrectionError::Springs);
        let error = refuse(&body, of(Weights::Volumes), laws([-1.0, 0.0, 0.0], 1));
        assert!(
            matches!(&error, CorrectionError::NoStiffness { place, found, .. }
            if place == "inside the lattice" && *found < 0.0),
            "{error}"
        );
        // Long bonds stiffen, short ones soften: on the whole only where there are long ones.
        let mixed = compiled("(L - 0.13)*(l/L - 1)^2", Level::Fast, 3);
        let wire = lattice(&[0.0; 3], &[1, 1, 1], H);
        let error = refuse(&wire, of(Weights::Volumes), mixed);
        assert!(error.to_string().contains("point 0 (counted from 0"), "{error}");
    }
    let partial = weighting(Weights::Uniform, Surface::None, Volumes::Partial);
    assert_eq!(refuse(&body, partial, bonds()), CorrectionError::PartialWeights(Weights::Uniform));
    let elements = Elements::default();
    let none = DiscreteEnergy::with_elements(body, M * H, partial, elements).err();
    assert_eq!(none, Some(AssemblyError::NoEnergy));
}
