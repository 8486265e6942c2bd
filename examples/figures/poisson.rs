//! Figs. 8 and 9 of javili2020: Poisson's ratio against the coefficients of areas and volumes, here
//! of endless lattices, without dimensions: `C2 delta^3/C1` in the plane, `C3 delta^8/C1` in space.

use piola_runtime::moduli::{Affine, Modulus, Stiffness};

use crate::{Line, Panel, case};

/// Steps of the coefficient per decade.
const PER_DECADE: i32 = 4;

pub(crate) fn panels() -> Result<Vec<Panel>, String> {
    let plane = |ratio: f64| line(2, ratio, "C2", 3, 1.0);
    let space = |ratio: f64| line(3, ratio, "C3", 8, 0.5);
    Ok(vec![
        Panel {
            title: "javili2020, Fig. 8",
            x: "C2 delta^3/C1; lambda/mu",
            y: "1 - nu",
            lines: vec![plane(2.0)?, plane(3.0)?, plane(4.0)?, local(2, 1.0)],
        },
        Panel {
            title: "javili2020, Fig. 9",
            x: "C3 delta^8/C1; lambda/mu",
            y: "1/2 - nu",
            lines: vec![space(2.0)?, space(3.0)?, local(3, 0.5)],
        },
    ])
}

fn coefficients() -> impl Iterator<Item = f64> {
    (-2 * PER_DECADE..=4 * PER_DECADE)
        .map(|k| libm::pow(10.0, f64::from(k) / f64::from(PER_DECADE)))
}

/// The distance from the limit for a horizon of so many spacings.
fn line(d: usize, ratio: f64, name: &str, power: i32, limit: f64) -> Result<Line, String> {
    let found = |k: f64| -> Result<(f64, f64), String> {
        let delta = 0.1 * ratio;
        let coefficient = (0..power).fold(k, |k, _| k / delta);
        let corners = if d == 2 { "[[0, 0], [1, 1]]" } else { "[[0, 0, 0], [1, 1, 1]]" };
        let case = case(
            "lattice.toml",
            &[
                format!("body.box={corners}"),
                format!("horizon.spacings={ratio:?}"),
                format!("material.parameters.{name}={coefficient:?}"),
            ],
        )?;
        let affine = Affine::new(&case).map_err(|error| error.to_string())?;
        let nu = Stiffness::new(&affine).modulus(Modulus::Poisson);
        Ok((k, limit - nu.ok_or("the lattice is not stable")?))
    };
    let points: Result<Vec<_>, String> = coefficients().map(found).collect();
    Ok((format!("horizon of {ratio} spacings"), points?))
}

/// Local elasticity: `nu = lambda/(lambda + 2 mu)` in the plane, `lambda/(2 (lambda + mu))` in space.
fn local(d: usize, limit: f64) -> Line {
    let nu = |k: f64| if d == 2 { k / (k + 2.0) } else { k / (2.0 * (k + 1.0)) };
    ("local, against lambda/mu".to_string(), coefficients().map(|k| (k, limit - nu(k))).collect())
}
