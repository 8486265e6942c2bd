//! What may be typed of studies: many runs of a scene, moduli of its material, what a run left.

use std::path::PathBuf;

use clap::Args;

use super::{AuditFormat, Format, MOST_THREADS, count};

#[derive(Debug, Args)]
pub(crate) struct Trade {
    /// A scene file
    #[arg(required_unless_present = "list")]
    pub(crate) scene: Option<PathBuf>,
    /// What is compared: energy, `reaction[:SET]`, `probe[:NAME]`, displacement, residual; energy, all
    /// reactions and probes and the residual if not given
    #[arg(long = "quantity", value_name = "NAME", value_delimiter = ',')]
    pub(crate) quantities: Vec<String>,
    /// Axes whose settings are combined with each other; the usual ones one at a time, and some
    /// combinations, if not given
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    pub(crate) axes: Vec<String>,
    /// A key of the scene and values to be tried, combined with each other and with the axes:
    /// material.potential=silling2000,miranda_modified_stretch
    #[arg(long = "vary", value_name = "KEY=VALUE,VALUE")]
    pub(crate) varied: Vec<String>,
    /// List the axes, or the settings of a scene, and do nothing
    #[arg(long)]
    pub(crate) list: bool,
    /// Time for everything, in s
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS")]
    pub(crate) budget: f64,
    /// Runs of each setting, as far as the budget allows
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) repeats: u16,
    /// The relative error that is small enough; a tenth of the discretisation error if not given
    #[arg(long, value_name = "ERROR")]
    pub(crate) accuracy: Option<f64>,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How many threads work; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
    /// A new or empty folder for trade.csv, trade.json, trade.svg and trade.png
    #[arg(short, long)]
    pub(crate) out: Option<PathBuf>,
    /// Replace the results of an earlier run in the folder
    #[arg(long)]
    pub(crate) force: bool,
    /// How the table is written
    #[arg(long, default_value = "human")]
    pub(crate) format: AuditFormat,
}

#[derive(Debug, Args)]
pub(crate) struct Sweep {
    /// A scene file
    pub(crate) scene: PathBuf,
    /// A key of the scene, or a parameter of its [material], and its values: FIRST:LAST:COUNT at even
    /// steps, FIRST:LAST:COUNT:log by even factors, or VALUE,VALUE; several keys are combined
    #[arg(long = "vary", value_name = "KEY=VALUES", required = true)]
    pub(crate) varied: Vec<String>,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How many threads work, on as many runs at once; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
    /// A new or empty folder for sweep.csv, sweep.json, sweep.svg and sweep.png
    #[arg(short, long)]
    pub(crate) out: Option<PathBuf>,
    /// Replace the results of an earlier study in the folder
    #[arg(long)]
    pub(crate) force: bool,
    /// How the table is written
    #[arg(long, default_value = "human")]
    pub(crate) format: AuditFormat,
}

#[derive(Debug, Args)]
pub(crate) struct Moduli {
    /// A scene file; only body, horizon and material are needed
    pub(crate) scene: PathBuf,
    /// Density of the solid in kg/m^3: adds wave speeds and the largest stable time step
    #[arg(long, value_name = "KG/M^3")]
    pub(crate) density: Option<f64>,
    /// One of the materials of the scene, as if the body were of it alone; without it all of them
    #[arg(long, value_name = "NAME")]
    pub(crate) material: Option<String>,
    /// Override a value of the scene, e.g. `horizon.spacings=4`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How the result is written
    #[arg(long, default_value = "human")]
    pub(crate) format: Format,
}

#[derive(Debug, Args)]
pub(crate) struct Calibrate {
    /// A scene file; only body, horizon and material are needed
    pub(crate) scene: PathBuf,
    /// Moduli that the body shall have, in Pa or with a unit: `E=200e9,nu=0.3`; names are E, nu, K, mu,
    /// C11, C12, C44, dilation (1 - 2 nu) and, in two dimensions, E_strain and nu_strain; of bodies that
    /// break also a fracture energy in J/m^2, `Gc` or of another plane `Gc[110]`
    #[arg(long = "target", value_name = "NAME=VALUE", value_delimiter = ',', required = true)]
    pub(crate) targets: Vec<String>,
    /// Parameters of the potential that may change
    #[arg(long, value_name = "NAME", value_delimiter = ',', required = true)]
    pub(crate) vary: Vec<String>,
    /// The material whose parameters change, as if the body were of it alone
    #[arg(long, value_name = "NAME")]
    pub(crate) material: Option<String>,
    /// Override a value of the scene, e.g. `horizon.spacings=4`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How the result is written
    #[arg(long, default_value = "human")]
    pub(crate) format: Format,
}

#[derive(Debug, Args)]
pub(crate) struct Report {
    /// The folder of a run
    pub(crate) folder: PathBuf,
    /// The page; report.html in the folder if not given
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
}

pub(crate) const PICTURE_EXAMPLE: &str = "Examples:
  piola picture out/bar --field stress_xx --at 0.5
  piola picture out/bar --film --seconds 6
  piola picture out/bar --force right";

#[derive(Debug, Args)]
pub(crate) struct Picture {
    /// The folder of a run
    pub(crate) folder: PathBuf,
    /// What colours show: a field of the frames, of a vector or tensor its size or, with `_x` or `_xy` behind
    /// its name, a component; the displacement if not given
    #[arg(long, value_name = "NAME", conflicts_with = "force")]
    pub(crate) field: Option<String>,
    /// The time or load parameter whose nearest frame is drawn; the last if not given
    #[arg(long, value_name = "T", allow_negative_numbers = true, conflicts_with_all = ["film", "force"])]
    pub(crate) at: Option<f64>,
    /// Draw all frames, as an animated PNG
    #[arg(long, conflicts_with = "force")]
    pub(crate) film: bool,
    /// How long the film is, in s; its last picture stands a second longer
    #[arg(long, default_value_t = 5.0, value_parser = seconds, requires = "film", conflicts_with = "force")]
    pub(crate) seconds: f64,
    /// Draw the force on this set against its displacement, from the body at rest on
    #[arg(long, value_name = "SET")]
    pub(crate) force: Option<String>,
    /// Against the displacement of another set, or of a probe
    #[arg(long, value_name = "SET|PROBE", requires = "force")]
    pub(crate) against: Option<String>,
    /// The picture, .png or .svg; body.png, film.png or force.png in the folder if not given
    #[arg(short, long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
}

/// A length of a film.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=600.0).contains(&seconds) => Ok(seconds),
        _ => Err("a number of seconds from 0.1 to 600".to_string()),
    }
}

#[derive(Debug, Args)]
pub(crate) struct Watch {
    /// A scene file
    pub(crate) scene: PathBuf,
    /// Where the results go; those of an earlier run in the folder are replaced
    #[arg(short, long)]
    pub(crate) out: PathBuf,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How many threads work; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
}
