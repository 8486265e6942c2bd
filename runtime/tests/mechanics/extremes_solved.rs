//! Equilibria at extremes of strain, offset, stiffness ratio and unit.

use std::ops::ControlFlow;
use std::sync::Arc;

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::solve::Watch;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearError, LinearOptions};
use piola_runtime::solve::newton::{Newton, NewtonFailure, NewtonSettings};
use piola_runtime::solve::steps::{Drive, StepError, StepRecord, StepSettings, run_steps};
use piola_runtime::weights::Weights;

use crate::common::{U, distance, lattice, laws, norm};

/// Both ends of a body held along an axis, one pulled away by `pull` in m.
struct Pull {
    fixed: Vec<usize>,
    values: Vec<f64>,
}

impl Pull {
    fn along(body: &Body, axis: usize, pull: f64) -> Pull {
        let d = body.dimension();
        let place = |point: usize| body.position(point)[axis];
        let all = || (0..body.n_points()).map(place);
        let (low, high) =
            (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        let ends = (0..body.n_points()).filter(|&p| place(p) == low || place(p) == high);
        let fixed: Vec<usize> = ends.flat_map(|p| p * d..(p + 1) * d).collect();
        let moved = |dof: &usize| dof % d == axis && place(dof / d) == high;
        let values = fixed.iter().map(|dof| if moved(dof) { pull } else { 0.0 }).collect();
        Pull { fixed, values }
    }
}

impl Drive for Pull {
    fn fixed(&self) -> &[usize] {
        &self.fixed
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        values.iter_mut().zip(&self.values).for_each(|(to, value)| *to = t * value);
    }

    fn loads(&self, _: f64, loads: &mut [f64]) {
        loads.fill(0.0);
    }
}

/// One load step; displacements and the record.
fn solve(energy: &DiscreteEnergy, drive: &Pull, tolerance: f64) -> (Vec<f64>, StepRecord) {
    let newton = NewtonSettings { tolerance, ..NewtonSettings::default() };
    let settings = StepSettings { newton, ..StepSettings::default() };
    let outcome = run_steps(energy, drive, &settings, &Watch::default(), &mut |_, _| {
        ControlFlow::Continue(())
    })
    .unwrap();
    let record = outcome.records.last().unwrap().clone();
    assert_eq!(outcome.records.len(), 1, "no cut-back");
    (outcome.displacements, record)
}

/// Where the residual comes to rest, over the reaction, when a tolerance is asked for that no rounding
/// meets.
fn floor(energy: &DiscreteEnergy, drive: &Pull) -> f64 {
    let newton = NewtonSettings { tolerance: 1e-17, ..NewtonSettings::default() };
    let settings = StepSettings { newton, ..StepSettings::default() };
    match run_steps(energy, drive, &settings, &Watch::default(), &mut |_, _| {
        ControlFlow::Continue(())
    }) {
        Ok(outcome) => last(outcome.records.last().unwrap()),
        Err(StepError::NotConverged(failed)) => {
            let reached = failed.cause.history.residual_over_reaction;
            reached.into_iter().fold(f64::INFINITY, f64::min)
        }
        Err(error) => panic!("{error}"),
    }
}

fn last(record: &StepRecord) -> f64 {
    *record.residual_over_reaction.last().unwrap()
}

/// A cube of 4^3 points (360 bonds, 270 tetrahedra) with `C1 = 1`, pulled by 1e-3 of its size.
///
/// There is no exact solution to compare with. The cube pulled along x and along y are one problem
/// whose sums are rounded in different orders: half of the difference is taken as the error.
///
/// | C3/C1 | iterations | floor/reaction | condition | implied error | error seen |
/// |---|---|---|---|---|---|
/// | 0 | 3 | 3.1e-16 | 3.2e1 | 3.5e-15 | 2.2e-17 |
/// | 1e4 | 3 | 5.9e-16 | 1.5e6 | 1.6e-10 | 3.7e-13 |
/// | 1e8 | 3 | 6.7e-16 | 1.8e9 | 2.0e-7 | 1.4e-10 |
/// | 1e12 | 3 | 6.1e-16 | 1.5e9 | 1.7e-7 | 2.6e-10 |
///
/// Beyond 1e8 the stress of the tetrahedra stiffens what their volume leaves soft, and the condition
/// grows no more.
#[test]
fn e04_a_stiff_volume_leaves_newton_quadratic_and_the_error_below_the_estimate() {
    for (ratio, error_bar) in [(0.0, 1e-16), (1e4, 2e-12), (1e8, 7e-10), (1e12, 1.5e-9)] {
        let body = lattice(&[0.0; 3], &[3, 3, 3], 1.0);
        let energy =
            DiscreteEnergy::new(Arc::clone(&body), 1.42, Weights::Unit, laws([1.0, 0.0, ratio], 1))
                .unwrap();
        assert_eq!(energy.report().bonds, 360);
        assert_eq!(energy.report().tetrahedra, if ratio > 0.0 { 270 } else { 0 });
        let solved = [0, 1].map(|axis| solve(&energy, &Pull::along(&body, axis, 3e-3), 1e-14));
        // The point with x and y exchanged.
        let twin = |point: usize| {
            let x = body.position(point);
            let is_twin = |p: &usize| body.position(*p) == [x[1], x[0], x[2]];
            (0..body.n_points()).find(is_twin).unwrap()
        };
        let mirrored: Vec<f64> = (0..body.n_points())
            .flat_map(|p| [1, 0, 2].map(|axis| solved[1].0[3 * twin(p) + axis]))
            .collect();
        let error = 0.5 * distance(&mirrored, &solved[0].0);
        let record = &solved[0].1;
        let floor = floor(&energy, &Pull::along(&body, 0, 3e-3));
        let estimate = record.condition.unwrap() * U;
        println!(
            "{ratio:e}: {:?} floor {floor:e} its {} condition {:e} estimate {estimate:e} error {error:e}",
            record.residual_over_reaction,
            record.iterations,
            record.condition.unwrap()
        );
        assert!(record.iterations <= 8, "{record:?}");
        assert!(floor <= 2.7e-15, "{ratio:e}: {floor:e}");
        assert!(error <= error_bar, "{ratio:e}: {error:e}");
        assert!(error <= 10.0 * estimate, "{ratio:e}: {error:e} {estimate:e}");
    }
}

/// 11 x 11 points, horizon 3 spacings, n = 1, pulled by strains of 1e-1 to 1e-14 at offsets of 0 to
/// 1e6: residuals come to rest below 5.2e-16 of the reaction everywhere.
#[test]
fn e05_the_floor_of_newtons_method_is_flat_in_strain_and_offset() {
    let mut worst: f64 = 0.0;
    for offset in [0.0, 1.0, 1e3, 1e6] {
        let body = lattice(&[offset; 2], &[10, 10], 0.125);
        let energy = DiscreteEnergy::new(
            Arc::clone(&body),
            0.375,
            Weights::Uniform,
            laws([1.0, 0.0, 0.0], 1),
        )
        .unwrap();
        let at = |strain: f64| {
            let pull = Pull::along(&body, 1, 1.25 * strain);
            let (u, _) = solve(&energy, &pull, 1e-14);
            (u.iter().map(|u| u / strain).collect::<Vec<f64>>(), floor(&energy, &pull))
        };
        let (unit, _) = at(1e-14);
        for strain in [1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14] {
            let (scaled, floor) = at(strain);
            worst = worst.max(floor);
            let bent = distance(&scaled, &unit);
            // Measured are 0.064 strain.
            assert!(bent <= 0.25 * strain + 1e-14, "offset {offset} strain {strain:e}: {bent:e}");
        }
    }
    println!("worst floor {worst:e}");
    assert!(worst <= 2.4e-15, "{worst:e}");
}

/// Bonds of 1e-2 m at 1e6 m from the origin: points are rounded to 1e-8 of a bond, strains of 1e-12
/// are resolved all the same. The scaled displacements differ from those at the origin by 2.6e-10,
/// because the rounded points are another body.
#[test]
fn e15_far_from_the_origin_strains_below_the_rounding_of_the_points_are_resolved() {
    let solved = |offset: f64, strain: f64| {
        let body = lattice(&[offset; 2], &[10, 10], 0.01);
        let energy = DiscreteEnergy::new(
            Arc::clone(&body),
            0.03,
            Weights::Uniform,
            laws([1.0, 5.0, 0.0], 1),
        )
        .unwrap();
        let pull = Pull::along(&body, 0, 0.1 * strain);
        let (u, _) = solve(&energy, &pull, 1e-14);
        let scaled: Vec<f64> = u.iter().map(|u| u / strain).collect();
        (scaled, floor(&energy, &pull))
    };
    let (home, _) = solved(0.0, 1e-12);
    for strain in [1e-6, 1e-9, 1e-12] {
        let (far, floor) = solved(1e6, strain);
        let shift = distance(&far, &home);
        println!("strain {strain:e}: floor {floor:e}, shift {shift:e}");
        assert!(floor <= 2.4e-15, "{strain:e}: {floor:e}");
        // The rounded points are another body, by 1e-8 of a bond.
        assert!(shift <= 1.1e-9 + 0.25 * strain, "{strain:e}: {shift:e}");
    }
}

/// One scene in metres, nanometres, picometres and gigametres, at 1e9 Pa: C3 is 1e119, 1e155 and
/// 1e-97 in SI units, and neither displacements nor energy change by more than 2.2e-16. No product
/// of a run leaves the range of f64 at 1e-12 m, so nothing is made dimensionless inside.
#[test]
fn e14_the_unit_of_length_changes_no_digit() {
    let solved = |scale: f64| {
        let body = lattice(&[0.0; 3], &[4, 3, 3], 0.25 * scale);
        // An energy per volume of 1e9 Pa: C ~ Pa over the volume of the other points and the measure.
        let stiffness = |corners: i32, measure: i32| {
            1e9 * libm::pow(scale, f64::from(-3 * (corners - 1) - measure))
        };
        let coefficients = [stiffness(2, 1), 10.0 * stiffness(3, 2), 100.0 * stiffness(4, 3)];
        let laws = laws(coefficients, 1);
        let energy =
            DiscreteEnergy::new(Arc::clone(&body), 0.5 * scale, Weights::Volumes, laws).unwrap();
        let (u, record) = solve(&energy, &Pull::along(&body, 0, 0.05 * scale), 1e-13);
        let energy = record.energy_parts.total() / (scale * scale * scale);
        (u.iter().map(|u| u / scale).collect::<Vec<f64>>(), energy, coefficients[2])
    };
    let (reference, energy, _) = solved(1.0);
    for scale in [1e-9, 1e-12, 1e9] {
        let (u, scaled_energy, c3) = solved(scale);
        let (error, energy_error) =
            (distance(&u, &reference), (scaled_energy / energy - 1.0).abs());
        println!("{scale:e}: C3 {c3:e} u {error:e} energy {energy_error:e}");
        assert!(error <= 9e-16 && energy_error <= 9e-16, "{scale:e}: {error:e} {energy_error:e}");
    }
}

/// A flat sheet in space has no tetrahedra; with tetrahedra alone nothing resists, and that is said.
#[test]
fn e16_a_coplanar_family_leaves_a_singular_tangent_that_is_named() {
    let positions: Vec<f64> =
        (0..25).flat_map(|k| [f64::from(k / 5), f64::from(k % 5), 0.0]).collect();
    let body = Arc::new(Body::new(3, &positions, &[1.0; 25], None));
    let energy =
        DiscreteEnergy::new(Arc::clone(&body), 1.5, Weights::Volumes, laws([1.0, 0.0, 1.0], 1))
            .unwrap();
    assert_eq!(energy.report().tetrahedra, 0);
    assert!(energy.report().dropped_tetrahedra > 0);
    let drive = Pull::along(&body, 0, 0.0);
    let constraints = Constraints::new(75, drive.fixed()).unwrap();
    let settings = NewtonSettings::default();
    let options = LinearOptions::default();
    let mut newton = Newton::new(&energy, &constraints, settings, options).unwrap();
    let mut loads = vec![0.0; 75];
    let middle = (0..25).find(|&p| body.position(p) == [2.0, 2.0, 0.0]).unwrap();
    loads[3 * middle + 2] = 1.0;
    let error = newton.solve(&mut [0.0; 75], &loads).unwrap_err();
    assert!(
        matches!(error.failure, NewtonFailure::Linear(LinearError::Singular { .. })),
        "{error}"
    );
}

/// A tetrahedron on a fixed base, its apex pushed down by a load that carries the first Newton step
/// through the base. The logarithm and `V/v` both are infinite at `v = 0`; the second is finite
/// beyond. The first length tried is 0.1797, 0.9 of the way to the base less the resolution.
#[test]
fn e10_a_newton_step_ends_before_a_tetrahedron_turns_inside_out() {
    for (n, name) in [(0, "logarithm"), (-1, "reciprocal")] {
        let positions = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0.1, 0.1, 1.];
        let body = Arc::new(Body::new(3, &positions, &[1.0; 4], None));
        let laws = laws([0.0, 0.0, 1.0], n);
        let energy = DiscreteEnergy::new(Arc::clone(&body), 2.0, Weights::Unit, laws).unwrap();
        let apex = (0..4).find(|&p| body.user_index()[p] == 3).unwrap();
        let fixed: Vec<usize> = (0..12).filter(|dof| *dof != 3 * apex + 2).collect();
        let constraints = Constraints::new(12, &fixed).unwrap();
        let (settings, options) = (NewtonSettings::default(), LinearOptions::default());
        let mut newton = Newton::new(&energy, &constraints, settings, options).unwrap();
        let mut loads = vec![0.0; 12];
        // The stiffness at rest is 1: the full step goes to z = -4, the way to the base is 1/5.
        loads[3 * apex + 2] = -5.0;
        let mut u = [0.0; 12];
        let report = newton.solve(&mut u, &loads).unwrap();
        let first = report.step_lengths[0];
        println!("{name}: steps {:?}, z = {}", report.step_lengths, 1.0 + u[3 * apex + 2]);
        assert!(first <= 0.18, "{name}: {first}");
        assert!(u[3 * apex + 2] > -1.0, "{name}");
        assert_eq!(energy.inverted(&u).tetrahedra, 0);
        let mut turned = u;
        turned[3 * apex + 2] = -2.0;
        let error = energy.forces(&turned, &mut [0.0; 12]).unwrap_err();
        assert!(error.inverted && error.points.len() == 4, "{name}: {error}");
        // A jump of prescribed values is judged the same way.
        let mut jump = [0.0; 12];
        jump[3 * apex + 2] = -0.89;
        assert!(newton.check_jump(&[0.0; 12], &jump).is_ok(), "{name}");
        jump[3 * apex + 2] = -0.91;
        assert!(newton.check_jump(&[0.0; 12], &jump).is_err(), "{name}");
    }
}

/// Quadratic energies let tetrahedra pass through `v = 0`, and their number is known.
#[test]
fn e10_an_energy_that_is_finite_everywhere_may_turn_inside_out() {
    for n in [1, 2] {
        let body = lattice(&[0.0; 3], &[1, 1, 1], 1.0);
        let laws = laws([0.0, 0.0, 1.0], n);
        let energy = DiscreteEnergy::new(Arc::clone(&body), 1.8, Weights::Unit, laws).unwrap();
        let mirrored: Vec<f64> =
            body.positions().chunks_exact(3).flat_map(|x| [-2.0 * x[0], 0.0, 0.0]).collect();
        assert!(energy.first_inversion(&[0.0; 24], &mirrored).is_none());
        let mut gradient = [0.0; 24];
        let parts = energy.forces(&mirrored, &mut gradient).unwrap();
        assert_eq!(energy.inverted(&mirrored).tetrahedra, energy.report().tetrahedra);
        // n = 2 has a second minimum where every tetrahedron is mirrored.
        assert_eq!(parts.of("psi(v)") == 0.0 && norm(&gradient) == 0.0, n == 2);
    }
}
