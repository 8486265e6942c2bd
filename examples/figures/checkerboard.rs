//! Checkerboards (partmann2026 4.44): the energy per volume that models find in displacements which
//! alternate from point to point, in a plane through the middle of a cube.

use piola_runtime::case::Case;
use piola_runtime::energy::Energy as _;
use piola_runtime::output::picture::{Slice, SlicePlot};

use crate::case;

/// As the scene says, in m.
const SPACING: f64 = 0.025;

/// Largest component of the displacements, in spacings.
const AMPLITUDE: f64 = 1e-3;

/// A model as it is said in the scene.
pub(crate) struct Model {
    pub(crate) name: &'static str,
    overrides: &'static [&'static str],
}

const LAME: &str = "material.parameters={ lambda = 84e9, mu = 84e9 }";

pub(crate) const MODELS: [Model; 5] = [
    Model {
        name: "psi(F) at points: CC; CS, CW without deviations",
        overrides: &[LAME, "correspondence.discretisation=nodal", CONSTANT],
    },
    Model {
        name: "CW, with its energy of deviations",
        overrides: &[
            LAME,
            "correspondence.discretisation=stabilised",
            "correspondence.stabilisation=wan",
            CONSTANT,
        ],
    },
    Model {
        name: "psi(F) at bonds: BAQP",
        overrides: &[LAME, "correspondence.discretisation=bond-quadrature", CONSTANT],
    },
    Model {
        name: "ordinary state-based: LPS",
        overrides: &[
            "material.potential=linear_peridynamic_solid",
            "material.parameters={ K = 140e9, G = 84e9, p = 0 }",
        ],
    },
    Model {
        name: "bond-based: BB",
        overrides: &["material.potential=silling2000", "material.parameters={ K = 140e9 }"],
    },
];

const CONSTANT: &str = "correspondence.influence=constant";

/// Numbers of the plane through the middle, row by row, and how many are in a row.
pub(crate) struct Plane {
    columns: usize,
    values: Vec<f64>,
}

impl Plane {
    /// From numbers of all points of a body.
    fn new(case: &Case, of_points: &[f64]) -> Plane {
        let layer = |point: usize, axis: usize| {
            libm::round(case.body.position(point)[axis] / SPACING) as usize
        };
        let last = (0..case.body.n_points()).map(|point| layer(point, 2)).max().unwrap_or(0);
        let mut values = vec![0.0; (last + 1) * (last + 1)];
        for point in (0..case.body.n_points()).filter(|&point| layer(point, 2) == last / 2) {
            values[layer(point, 1) * (last + 1) + layer(point, 0)] = of_points[point];
        }
        Plane { columns: last + 1, values }
    }

    pub(crate) fn middle(&self) -> f64 {
        self.values[self.values.len() / 2]
    }
}

/// `A cos(pi y) cos(pi z)` and so on, lengths in spacings; in the body's order, in m.
fn displacements(case: &Case) -> Vec<f64> {
    let mut u = Vec::new();
    for x in case.body.positions().chunks_exact(3) {
        let sign = |a: usize| if libm::round(x[a] / SPACING) % 2.0 == 0.0 { 1.0 } else { -1.0 };
        for (p, q) in [(1, 2), (0, 2), (0, 1)] {
            u.push(AMPLITUDE * SPACING * sign(p) * sign(q));
        }
    }
    u
}

impl Model {
    fn case(&self) -> Result<Case, String> {
        let overrides: Vec<String> = self.overrides.iter().map(|text| text.to_string()).collect();
        case("checkerboard.toml", &overrides)
    }

    /// The energy per volume, in J/m^3.
    pub(crate) fn densities(&self) -> Result<Plane, String> {
        let case = self.case()?;
        let u = displacements(&case);
        let compiled = case.compile().map_err(|error| error.to_string())?;
        let energy = case.energy(compiled).map_err(|error| error.to_string())?;
        let densities = energy.densities(&u, case.body.volumes());
        Ok(Plane::new(&case, &densities.map_err(|found| case.describe(&found))?))
    }
}

/// The picture, and its table.
pub(crate) fn slices() -> Result<(SlicePlot, String), String> {
    let case = MODELS[0].case()?;
    let u: Vec<f64> = displacements(&case).into_iter().skip(2).step_by(3).collect();
    let moved = Plane::new(&case, &u);
    let mut panels = vec![Slice {
        title: "displacement along z".to_string(),
        note: "along x and y it alternates by rows and by columns".to_string(),
        quantity: ("", "m"),
        range: [-25e-6, 25e-6],
        columns: moved.columns,
        values: moved.values,
    }];
    let mut table = String::from("model,row,column,energy density (J/m^3)\n");
    for model in &MODELS {
        let plane = model.densities()?;
        println!("{:<52} {:>16.6}", model.name, plane.middle());
        for (place, x) in plane.values.iter().enumerate() {
            let (row, column) = (place / plane.columns, place % plane.columns);
            table.push_str(&format!("\"{}\",{row},{column},{x:e}\n", model.name));
        }
        panels.push(Slice {
            title: model.name.to_string(),
            note: format!("in the middle {:.3} kJ/m\u{b3}", plane.middle() / 1e3),
            quantity: ("energy density", "J/m\u{b3}"),
            range: [0.0, 7e5],
            columns: plane.columns,
            values: plane.values,
        });
    }
    let title =
        "Displacements that alternate from point to point, and what models store".to_string();
    Ok((SlicePlot { title, panels }, table))
}
