//! Moduli for people.

use std::fmt;

use super::{Basis, FractureEnergy, Moduli, Modulus, NoFractureEnergy, name_of_plane};

impl fmt::Display for Moduli {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = self.stiffness.dimension();
        match (self.basis, self.spacing) {
            (Basis::Lattice, Some(spacing)) => writeln!(
                f,
                "inside an endless lattice of spacing {spacing} m, horizon {:.6} spacings, \
                 {d} dimensions",
                self.horizon / spacing
            )?,
            _ => writeln!(
                f,
                "the whole cloud with its surface, displaced linearly: upper bounds; horizon {} m, \
                 {d} dimensions",
                self.horizon
            )?,
        }
        let shears: &[&str] = if d == 2 { &["xy"] } else { &["yz", "xz", "xy"] };
        let names = [&["xx", "yy", "zz"][..d], shears].concat();
        writeln!(f, "elasticity tensor, Pa (Voigt; shears are angles)")?;
        let voigt = self.stiffness.voigt();
        let largest = voigt.amax();
        for (row, name) in names.iter().enumerate() {
            write!(f, "  {name}")?;
            for column in 0..names.len() {
                let entry = voigt[(row, column)];
                // What is rounding prints as 0.
                let shown = if entry.abs() < 1e-13 * largest { 0.0 } else { entry };
                write!(f, "{shown:>14.6e}")?;
            }
            writeln!(f)?;
        }
        for modulus in Modulus::ALL.into_iter().filter(|modulus| modulus.exists(d)) {
            let value = match self.stiffness.modulus(modulus) {
                Some(value) if modulus.is_stress() || modulus == Modulus::Dilation => {
                    format!("{value:.8e}")
                }
                Some(value) => format!("{value:.9}"),
                None => "none".to_string(),
            };
            let unit = if modulus.is_stress() { "Pa" } else { "" };
            line(f, modulus.name(), &value, unit, meaning(modulus, d))?;
        }
        let zener = format!("{:.9}", self.stiffness.zener());
        line(f, "Zener", &zener, "", "2 C44/(C11 - C12), 1 if isotropic")?;
        let kelvin = self.stiffness.kelvin();
        let least = kelvin.first().copied().unwrap_or(f64::NAN);
        let stable = if self.stiffness.is_stable() {
            "least stiffness against a unit strain: stable"
        } else {
            "least stiffness against a unit strain: NOT STABLE"
        };
        line(f, "Kelvin", &format!("{least:.8e}"), "Pa", stable)?;
        let stress = self.stress.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let zero = if stress <= 1e-12 * largest {
            "largest stress at rest: none but rounding"
        } else {
            "largest stress at rest: NOT STRESS-FREE"
        };
        line(f, "stress", &format!("{stress:.3e}"), "Pa", zero)?;
        if let Some(waves) = &self.waves {
            let speed = |speed: Option<f64>| speed.map_or("none".into(), |c| format!("{c:.6}"));
            line(f, "c_L", &speed(waves.longitudinal), "m/s", "long longitudinal waves along x")?;
            line(f, "c_T", &speed(waves.shear), "m/s", "long shear waves along x")?;
        }
        if let Some(step) = &self.time_step {
            let meaning = format!(
                "largest step of central differences: Lanczos on {} points, {} products, \
                 eigenvalue to {:.0e}",
                step.points, step.products, step.uncertainty
            );
            line(f, "dt", &format!("{:.6e}", step.seconds), "s", &meaning)?;
        }
        match &self.fracture {
            Ok(fracture) => of_fracture(f, fracture)?,
            Err(NoFractureEnergy::NothingBreaks) => {}
            Err(why) => line(f, "Gc", "none", "", &why.to_string())?,
        }
        Ok(())
    }
}

fn of_fracture(f: &mut fmt::Formatter<'_>, fracture: &FractureEnergy) -> fmt::Result {
    let meaning = match fracture.has_cliques {
        true => {
            "work to pull two rigid halves apart along this normal, until all across has broken"
        }
        false => "energy of the bonds across a plane of this normal when they break",
    };
    for (normal, energy) in &fracture.planes {
        line(f, &name_of_plane(normal), &format!("{energy:.8e}"), "J/m^2", meaning)?;
    }
    let Some([least, most]) = fracture.critical_stretch else { return Ok(()) };
    let meaning = match least == most {
        true => "stretch less 1 at which bonds break".to_string(),
        false => format!("stretch less 1 at which the first bonds break, {most:.6e} the last"),
    };
    // The laws of the library call their own threshold s0, and it need not be this one.
    line(f, "s_c", &format!("{least:.8e}"), "", &meaning)
}

fn line(
    f: &mut fmt::Formatter<'_>,
    name: &str,
    value: &str,
    unit: &str,
    meaning: &str,
) -> fmt::Result {
    writeln!(f, "{name:<10}{value:>16} {unit:<4} {meaning}")
}

fn meaning(modulus: Modulus, dimension: usize) -> &'static str {
    match (modulus, dimension) {
        (Modulus::Young, 2) => "uniaxial stress along x in the plane: of a sheet (plane stress)",
        (Modulus::Young, _) => "uniaxial stress along x",
        (Modulus::Poisson, 2) => "of a sheet; 1 keeps the area",
        (Modulus::Poisson, _) => "lateral strain along y; 1/2 keeps the volume",
        (Modulus::YoungStrain, _) => "of the solid whose slice this is (plane strain)",
        (Modulus::PoissonStrain, _) => "of that solid; 1/2 keeps the volume",
        (Modulus::Dilation, 2) => "1 - nu with all its digits: change of area over axial strain",
        (Modulus::Dilation, _) => {
            "1 - 2 nu with all its digits: change of volume over axial strain"
        }
        (Modulus::Bulk, 2) => "mean stress over change of area",
        (Modulus::Bulk, _) => "mean stress over change of volume",
        (Modulus::Shear, _) => "mean over all directions",
        (Modulus::C11, _) => "uniaxial strain along x",
        (Modulus::C12, _) => "lateral stress there",
        (Modulus::C44, _) => "shear along the axes",
    }
}
