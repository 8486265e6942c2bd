//! Figs. 13 and 14 of partmann2026: the elongation of a bar under tension against the horizon and
//! against the points over its width.

use std::time::Duration;

use piola_runtime::case::Case;
use piola_runtime::simulation::{Attempt, solve};

use crate::{Line, Panel, case};

const LENGTH: f64 = 0.1;
const WIDTH: f64 = 0.01;
const YOUNG: f64 = 210e9;
const FORCE: f64 = 200e3;

/// A model with what it is compared with, and how large a body it is tried on.
pub(crate) struct Model {
    pub(crate) name: &'static str,
    overrides: &'static [&'static str],
    reference: fn() -> f64,
    /// Largest horizon in spacings with five points over the width.
    horizon: usize,
    /// Most points over the width with a horizon of three spacings.
    across: usize,
}

pub(crate) const MODELS: [Model; 3] = [
    Model {
        name: "bond-based",
        overrides: &[
            "material.potential=silling2000",
            "material.parameters={ K = 140e9 }",
            "horizon.weights=volumes",
        ],
        reference: linear,
        horizon: 7,
        across: 10,
    },
    Model {
        name: "ordinary state-based",
        overrides: &[
            "material.potential=linear_peridynamic_solid",
            "material.parameters={ K = 140e9, G = 84e9, p = 0 }",
        ],
        reference: linear,
        horizon: 5,
        across: 8,
    },
    Model {
        name: "psi(F) at the bonds",
        overrides: &["material.parameters={ lambda = 84e9, mu = 84e9 }"],
        reference: st_venant_kirchhoff,
        horizon: 7,
        across: 10,
    },
];

pub(crate) fn panels() -> Result<Vec<Panel>, String> {
    Ok(vec![
        Panel {
            title: "partmann2026, Fig. 13",
            x: "horizon in spacings, 5 points over the width",
            y: "relative error",
            lines: lines(|model| (2..=model.horizon).map(|m| (m, [5, m])).collect())?,
        },
        Panel {
            title: "partmann2026, Fig. 14",
            x: "points over the width, horizon of 3 spacings",
            y: "relative error",
            lines: lines(|model| {
                let across = [3, 4, 5, 6, 8, 10].into_iter().filter(|n| *n <= model.across);
                across.map(|n| (n, [n, 3])).collect()
            })?,
        },
    ])
}

/// A place on the axis, with the points over the width and the horizon in spacings there.
type Body = (usize, [usize; 2]);

/// The errors of all models, each for bodies of its own.
fn lines(bodies: impl Fn(&Model) -> Vec<Body>) -> Result<Vec<Line>, String> {
    let line = |model: &Model| {
        let errors =
            bodies(model).into_iter().map(|(x, [n, m])| Ok((x as f64, model.error(n, m)?)));
        Ok((model.name.to_string(), errors.collect::<Result<Vec<_>, String>>()?))
    };
    MODELS.iter().map(line).collect()
}

impl Model {
    /// Relative, of the mean displacement of the loaded layer.
    pub(crate) fn error(&self, across: usize, horizon: usize) -> Result<f64, String> {
        let spacing = WIDTH / across as f64;
        let clamped = spacing * horizon as f64;
        let mut overrides = vec![
            format!("body.spacing={spacing:?}"),
            format!("body.box=[[{:?}, 0, 0], [{LENGTH:?}, {WIDTH:?}, {WIDTH:?}]]", -clamped),
            format!("horizon.spacings={horizon}"),
            format!("sets.pulled=X > {:?}", LENGTH - spacing),
        ];
        overrides.extend(self.overrides.iter().map(|text| text.to_string()));
        let case = case("bar.toml", &overrides)?;
        let reference = (self.reference)();
        Ok((elongation(&case, spacing)? - reference) / reference)
    }
}

fn elongation(case: &Case, spacing: f64) -> Result<f64, String> {
    let attempt = solve(case, Duration::from_secs(3600)).map_err(|error| error.to_string())?;
    let Attempt::Reached(equilibrium) = attempt else {
        return Err(format!("no equilibrium: {attempt:?}"));
    };
    let layer = (0..case.body.n_points()).filter(|&p| case.body.position(p)[0] > LENGTH - spacing);
    let moved = layer.map(|p| {
        let u = &equilibrium.displacements[3 * p..3 * p + 3];
        u.iter().fold(0.0, |sum, u| sum + u * u).sqrt()
    });
    let moved: Vec<f64> = moved.collect();
    Ok(moved.iter().sum::<f64>() / moved.len() as f64)
}

/// Eq. (5.1).
fn linear() -> f64 {
    FORCE * LENGTH / (YOUNG * WIDTH * WIDTH)
}

/// Eqs. (5.3), (5.4), by Newton's method from above.
fn st_venant_kirchhoff() -> f64 {
    let stress = FORCE / (WIDTH * WIDTH);
    let mut stretch = 1.0 + stress / YOUNG;
    for _ in 0..20 {
        let residual = stretch * stretch * stretch - stretch - 2.0 * stress / YOUNG;
        stretch -= residual / (3.0 * stretch * stretch - 1.0);
    }
    (stretch - 1.0) * LENGTH
}
