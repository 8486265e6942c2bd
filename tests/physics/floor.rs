//! Where the residuals of Newton's method come to rest: a tolerance is asked for that no rounding
//! meets, and what is reached is less than the tolerance that every example asks for.

use std::ops::ControlFlow;

use piola_runtime::case::{Case, FieldsInTime, Library};
use piola_runtime::scene::boundary::BoundaryConditions;
use piola_runtime::solve::Watch;
use piola_runtime::solve::newton::NewtonSettings;
use piola_runtime::solve::steps::{Drive, NotGiven, StepError, StepSettings, run_steps};

use crate::examples;
use crate::support::repository;

/// The end of the step from rest: somewhere where rounding matters.
const END: f64 = 0.04;

/// Below every residual but 0.
const UNREACHABLE: f64 = 1e-17;

/// Measured floors over the reaction. Bars are four times these, below what the examples ask for.
const FLOORS: [(&str, f64); 21] = [
    ("bimetal", 5.4e-14),
    ("bonds_beside_F", 4.2e-15),
    ("cantilever", 9.3e-14),
    ("clamped_beam", 1.1e-14),
    ("cork", 6.4e-15),
    ("correspondence_as_text", 6.6e-15),
    ("cube_C1", 7.1e-16),
    ("cube_C1_C2", 8.2e-16),
    ("cube_C1_C3", 5.5e-15),
    ("cube_incompressible", 6.8e-15),
    ("firooz2023_table6", 1.7e-15),
    ("first", 5.8e-15),
    ("inclusions", 5.2e-13),
    ("lamina", 1.9e-14),
    ("nanostrip", 2.8e-15),
    ("ring", 4.2e-15),
    ("square", 2.0e-15),
    ("square_incompressible", 2.4e-13),
    ("square_with_hole", 9.2e-15),
    ("torsion", 6.8e-15),
    ("traction_bar", 1.1e-14),
];

/// The boundary conditions of a scene, and its parameters that change in time.
struct Driven<'a>(BoundaryConditions<'a>, FieldsInTime<'a>);

impl Drive for Driven<'_> {
    fn fixed(&self) -> &[usize] {
        self.0.fixed_dofs()
    }

    fn begin(&self, t: f64) -> Result<bool, NotGiven> {
        self.1.advance(t).map_err(|_| NotGiven)
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        values.copy_from_slice(&self.0.prescribed(t).unwrap());
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        loads.copy_from_slice(&self.0.loads(t).unwrap());
    }
}

fn potential(name: &str) -> Option<&'static str> {
    let text = std::fs::read_to_string(repository("potentials").join(format!("{name}.piola")));
    text.ok().map(|text| &*text.leak())
}

/// The least residual over the reaction in one step from rest, and the tolerance that the scene
/// asks for.
fn floor(example: &str) -> (f64, f64) {
    let path = repository("examples").join(example).join("scene.toml");
    let library = Library { find: &potential, names: &[] };
    let case = Case::read(&path, &[], &library).unwrap();
    let (energy, fields) = case.energy_in_time(case.compile().unwrap()).unwrap();
    let selection = case.selection().unwrap();
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection).unwrap();
    let newton = NewtonSettings { tolerance: UNREACHABLE, ..NewtonSettings::default() };
    let settings = StepSettings { end: END, newton, ..StepSettings::default() };
    let outcome =
        run_steps(&energy, &Driven(boundary, fields), &settings, &Watch::default(), &mut |_, _| {
            ControlFlow::Continue(())
        });
    let reached = match outcome {
        Ok(outcome) => outcome.records[0].residual_over_reaction.clone(),
        Err(StepError::NotConverged(failed)) => failed.cause.history.residual_over_reaction,
        Err(error) => panic!("{example}: {error}"),
    };
    println!("{example}: {reached:?}");
    (reached.into_iter().fold(f64::INFINITY, f64::min), case.scene.solver.tolerance)
}

#[test]
fn the_floor_of_every_example_is_below_the_tolerance_that_it_asks_for() {
    assert!(FLOORS.iter().map(|(example, _)| example).eq(&examples::all()));
    for (example, measured) in FLOORS {
        let (floor, tolerance) = floor(example);
        println!("{example}: floor {floor:.1e}, tolerance {tolerance:.0e}");
        assert!(floor <= 4.0 * measured, "{example}: {floor:e}");
        assert!(4.0 * measured <= tolerance, "{example}: {tolerance:e}");
    }
}
