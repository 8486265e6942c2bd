//! What may be typed.

mod editors;
mod eval;
mod studies;

use std::path::PathBuf;

use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum};
use piola_runtime::simulation::Place;

use crate::console::{Color, Verbosity};
use crate::library::Kind;
pub(crate) use editors::{Fmt, New, Template};
pub(crate) use eval::{Eval, MeasureName};
pub(crate) use studies::{Calibrate, Moduli, Picture, Report, Sweep, Trade, Watch};

/// What scripts need to know.
const EXIT_CODES: &str = "Data go to stdout, all else to stderr.
Exit codes: 0 done, also with warnings; 1 a check, verification or evaluation found failures, or the
end state of a run is not stable;
2 wrong usage or input; 3 the solver did not converge; 130 or 143 interrupted or terminated.";

const RUN_EXAMPLE: &str = "Example:
  piola run examples/square/scene.toml --out out/square --set body.spacing=0.1";

const WATCH_EXAMPLE: &str = "Example:
  piola watch rubber/scene.toml --out rubber/out";

const REPORT_EXAMPLE: &str = "Example:
  piola report out/square";

const EVAL_EXAMPLE: &str = "Example:
  printf 'l,L\\n1.1,1\\n' | piola eval firooz2023 --measure l --set C1=1 --set n=2 --points -";

const COMPILE_EXAMPLE: &str = "Example:
  piola compile gent --set mu=0.5e6 --set Jm=30 --set K=1e8 --out out/gent";

const BENCH_EXAMPLE: &str = "Examples:
  piola bench firooz2023 --set n=2.7
  piola bench examples/first/scene.toml --threads 1";

const TRADE_EXAMPLE: &str = "Example:
  piola trade examples/square/scene.toml --out out/trade
  piola trade examples/square/scene.toml --axes tolerance,start --quantity energy,probe:edge";

const SWEEP_EXAMPLE: &str = "Examples:
  piola sweep examples/first/scene.toml --vary C2=0:5.4e12:10 --out out/sweep
  piola sweep examples/square/scene.toml --vary horizon.spacings=2,3,4 --vary body.spacing=0.1,0.05";

const MODULI_EXAMPLE: &str = "Example:
  piola moduli examples/cube_C1/scene.toml --density 7800";

const CALIBRATE_EXAMPLE: &str = "Example:
  piola calibrate examples/square/scene.toml --target E=200e9,nu=0.4 --vary C1,C2";

const EXPLAIN_BOND_EXAMPLE: &str = "Example:
  piola explain-bond examples/areas_that_fail/scene.toml --at 0.0705,0.0195 0.0705,0.0205";

const SCHEMA_EXAMPLE: &str = "Example:
  piola schema scene > scene.schema.json
  a scene that begins with `#:schema scene.schema.json` is completed by editors that know TOML (taplo)";

const COMPLETIONS_EXAMPLE: &str = "Example:
  piola completions bash > ~/.local/share/bash-completion/completions/piola";

/// Interaction potentials of peridynamics: one line of energy in, exact forces and solved bodies out.
#[derive(Debug, Parser)]
#[command(name = "piola", version, max_term_width = 100, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub(crate) voice: Voice,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// How much is said, and how it looks.
#[derive(Debug, Args)]
#[command(next_help_heading = "Messages")]
pub(crate) struct Voice {
    /// Say nothing but errors and warnings
    #[arg(short, long, global = true, action = ArgAction::SetTrue, conflicts_with = "verbose")]
    quiet: bool,
    /// Also tell of every iteration
    #[arg(short, long, global = true, action = ArgAction::SetTrue)]
    verbose: bool,
    /// Colours in messages; `auto` heeds NO_COLOR and TERM=dumb
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto")]
    pub(crate) color: Color,
    /// Also add messages to this file, those that --quiet leaves out among them
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) log: Option<PathBuf>,
}

impl Voice {
    pub(crate) fn verbosity(&self) -> Verbosity {
        match (self.quiet, self.verbose) {
            (true, _) => Verbosity::Quiet,
            (_, true) => Verbosity::Verbose,
            _ => Verbosity::Normal,
        }
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Write a commented scene and law to begin with
    #[command(after_help = editors::NEW_EXAMPLE)]
    New(New),
    /// Check potentials and scenes: syntax, names, dimensions, probable mistakes; all in one run
    Check(Check),
    /// Print psi, psi', psi'' of a potential, or any stage of its compilation
    Derive(Derive),
    /// Write a potential as C, or as an object file, with a header, for other programs
    #[command(after_help = COMPILE_EXAMPLE)]
    Compile(Compile),
    /// Compare generated derivatives with hyper-dual numbers and the interpreter
    Verify(Verify),
    /// Count the right digits of psi, psi', psi'' from tiny strains to huge stretches
    Audit(Audit),
    /// Evaluate psi, psi', psi'' at given measures: CSV in, CSV out
    #[command(after_help = EVAL_EXAMPLE)]
    Eval(Eval),
    /// Energy, forces and tangent of a body for a given displacement
    Energy(Energy),
    /// Solve a scene and write frames, tables, a picture and a summary
    #[command(after_help = RUN_EXAMPLE)]
    Run(Run),
    /// Run a scene, and again whenever it or a file beside it changes
    #[command(after_help = WATCH_EXAMPLE)]
    Watch(Watch),
    /// Put what a run left on one page of HTML: the body to be turned, charts, numbers, settings
    #[command(after_help = REPORT_EXAMPLE)]
    Report(Report),
    /// Draw the body of a run at one time or at all, coloured by a field; or force against displacement
    #[command(after_help = studies::PICTURE_EXAMPLE)]
    Picture(Picture),
    /// Say what a scene will model, what it drops and why, and what it costs
    Plan(Plan),
    /// Time an energy in all its ways, or the phases of a scene
    #[command(after_help = BENCH_EXAMPLE)]
    Bench(Bench),
    /// Solve a scene for many values of some of its keys, side by side; one table and picture
    #[command(after_help = SWEEP_EXAMPLE)]
    Sweep(Sweep),
    /// Measure error and time of a scene over its settings; pick the cheapest that is accurate enough
    #[command(after_help = TRADE_EXAMPLE)]
    Trade(Trade),
    /// Read the elastic moduli of a scene's material off its lattice and horizon
    #[command(after_help = MODULI_EXAMPLE)]
    Moduli(Moduli),
    /// Find parameters of the potential for which the discrete body has given moduli
    #[command(after_help = CALIBRATE_EXAMPLE)]
    Calibrate(Calibrate),
    /// List the library of potentials, or show one of them; or what this machine can do
    Info(Info),
    /// Say what the code of a message means, with examples; list all codes
    Explain(Explain),
    /// Run a scene and tell why a bond of it broke, or did not: the history of its margins, states, energy
    #[command(after_help = EXPLAIN_BOND_EXAMPLE)]
    ExplainBond(ExplainBond),
    /// Write potentials in the layout of the library: blanks, columns, empty lines
    #[command(after_help = editors::FMT_EXAMPLE)]
    Fmt(Fmt),
    /// Answer an editor over stdin and stdout by the language server protocol
    Lsp,
    /// Print the JSON schema of scene files, of summary.json or of findings, for editors and programs
    #[command(after_help = SCHEMA_EXAMPLE)]
    Schema {
        /// What it is of
        subject: Subject,
    },
    /// Print completions for a shell
    #[command(after_help = COMPLETIONS_EXAMPLE)]
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

/// A count from 1 to so many.
fn count<const MOST: usize>(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (1..=MOST).contains(&count) => Ok(count),
        _ => Err(format!("a whole number from 1 to {MOST}")),
    }
}

/// A positive number, `inf` among them.
fn bound(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(bound) if bound > 0.0 => Ok(bound),
        _ => Err("a positive number, or inf".to_string()),
    }
}

/// More threads than any machine has processors are a mistake.
const MOST_THREADS: usize = 4096;

/// Most processes that are planned for.
const MOST_RANKS: usize = 10_000_000;

/// How messages and results are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// For people.
    #[default]
    Human,
    /// For programs.
    Json,
}

/// How findings are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Findings {
    /// For people.
    #[default]
    Human,
    /// An object a line.
    Json,
    /// FILE:LINE:COLUMN: error[CODE]: MESSAGE, a line each.
    Short,
    /// Commands that GitHub shows at the lines of a change.
    Github,
    /// A log of SARIF 2.1.0.
    Sarif,
}

impl From<Format> for Findings {
    fn from(format: Format) -> Findings {
        match format {
            Format::Human => Findings::Human,
            Format::Json => Findings::Json,
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct Check {
    /// Potential files (.piola), names of the library, or scenes (.toml)
    #[arg(required = true)]
    pub(crate) files: Vec<String>,
    /// Also tell of what proven potentials do: energies that do not resist collapse or inversion
    #[arg(long)]
    pub(crate) pedantic: bool,
    /// Override a value of scenes, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How findings are written
    #[arg(long, default_value = "human")]
    pub(crate) format: Findings,
}

/// Values for a potential.
#[derive(Clone, Debug, Args)]
pub(crate) struct Inputs {
    /// Parameter values, in the declared unit or with one: `n=2`, `E="200 GPa"`; of a vector `mu=1,2,3`
    #[arg(long = "set", value_name = "NAME=VALUE")]
    pub(crate) settings: Vec<String>,
    /// The horizon in m, for energies that depend on `delta`
    #[arg(long, value_name = "METRES")]
    pub(crate) delta: Option<f64>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Emit {
    /// psi, psi', psi'' in the piola language
    #[default]
    Text,
    /// The same in LaTeX
    Latex,
    /// Kernels as C99
    C,
    /// The syntax tree
    Ast,
    /// What the checker made of it
    Model,
    /// The expression graph after simplification
    Graph,
    /// Cranelift's intermediate form
    Clif,
    /// Machine instructions of this computer
    Asm,
}

#[derive(Debug, Args)]
pub(crate) struct Derive {
    /// A potential file (.piola), or a name of the library
    pub(crate) file: String,
    /// What to print
    #[arg(long, default_value = "text")]
    pub(crate) emit: Emit,
    /// Number of dimensions; the largest the potential is defined in if not given
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub(crate) dim: Option<u8>,
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// Level of the machine code, for `--emit clif` and `asm`
    #[arg(long, default_value = "fast")]
    pub(crate) level: Level,
    /// Say what was rewritten so that the energy keeps its digits, and what that gained
    #[arg(long)]
    pub(crate) explain: bool,
}

/// What there are schemas of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Subject {
    /// Scene files
    Scene,
    /// summary.json of a run
    Summary,
    /// A line of `piola check --format json`
    Finding,
}

/// What a potential is compiled to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Product {
    /// C99 and a header.
    #[default]
    C,
    /// An object file, by the C compiler of the machine (CC, or cc), and a header.
    Obj,
}

#[derive(Debug, Args)]
pub(crate) struct Compile {
    /// A potential file (.piola), or a name of the library
    pub(crate) file: String,
    /// What is written
    #[arg(long, default_value = "c")]
    pub(crate) emit: Product,
    /// Number of dimensions; the largest the potential is defined in if not given
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub(crate) dim: Option<u8>,
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// The folder for NAME.c or NAME.o, and NAME.h
    #[arg(short, long)]
    pub(crate) out: PathBuf,
    /// Replace files of these names
    #[arg(long)]
    pub(crate) force: bool,
}

/// How an audit is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum AuditFormat {
    /// A table for people.
    #[default]
    Human,
    /// A row per regime and derivative.
    Csv,
    /// An object per energy.
    Json,
}

#[derive(Debug, Args)]
pub(crate) struct Audit {
    /// A potential file (.piola), or a name of the library
    pub(crate) file: String,
    /// Number of dimensions; the largest the potential is defined in if not given
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub(crate) dim: Option<u8>,
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// Points per regime
    #[arg(long, default_value_t = 12, value_parser = count::<100_000>)]
    pub(crate) points: usize,
    /// Largest error that passes, in units of 2^-53 of the value, beside its zeros of what rounding the
    /// inputs changes it by
    #[arg(long, default_value_t = 64.0, value_parser = bound)]
    pub(crate) bar: f64,
    /// Level of the machine code
    #[arg(long, default_value = "fast")]
    pub(crate) level: Level,
    /// Look at the energy as it was written, without the rewrites that keep its digits
    #[arg(long)]
    pub(crate) textbook: bool,
    /// How the table is written
    #[arg(long, default_value = "human")]
    pub(crate) format: AuditFormat,
    /// Draw error against strain: FILE.svg or FILE.png
    #[arg(long, value_name = "FILE")]
    pub(crate) picture: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct Verify {
    /// Potential files (.piola), or names of the library
    #[arg(required = true)]
    pub(crate) files: Vec<String>,
    /// Number of dimensions; all the potential is defined in if not given
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub(crate) dim: Option<u8>,
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// Points per energy, far from rest; as many again are near it
    #[arg(long, default_value_t = 1000, value_parser = count::<10_000_000>)]
    pub(crate) points: usize,
    /// How the report is written
    #[arg(long, default_value = "human")]
    pub(crate) format: Format,
}

/// How closely machine code follows the interpreter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Level {
    /// To the last bit
    Strict,
    /// With elementary functions of its own, within 2 units in the last place
    Fast,
}

impl From<Level> for piola_compiler::Level {
    fn from(level: Level) -> Self {
        match level {
            Level::Strict => piola_compiler::Level::Strict,
            Level::Fast => piola_compiler::Level::Fast,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Mode {
    /// Machine code
    #[default]
    Jit,
    /// The same graph, interpreted
    Interpreter,
    /// The energy as written, over hyper-dual numbers
    Hyperdual,
}

#[derive(Debug, Args)]
pub(crate) struct Energy {
    /// A scene file; only body, horizon and material are needed
    pub(crate) scene: PathBuf,
    /// CSV with the columns `u,v[,w]` in the order of the points; no displacement if not given
    #[arg(long)]
    pub(crate) displacement: Option<PathBuf>,
    /// Also give the tangent
    #[arg(long)]
    pub(crate) tangent: bool,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How the result is written
    #[arg(long, default_value = "json")]
    pub(crate) format: Format,
}

#[derive(Debug, Args)]
pub(crate) struct Run {
    /// A scene file
    #[arg(required_unless_present = "resume")]
    pub(crate) scene: Option<PathBuf>,
    /// Where the results go; a new or empty folder
    #[arg(short, long)]
    pub(crate) out: Option<PathBuf>,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How many threads work; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
    /// Replace the results of an earlier run in the folder
    #[arg(long)]
    pub(crate) force: bool,
    /// Try even if the plan says that memory will not suffice
    #[arg(long)]
    pub(crate) yes: bool,
    /// Go on with the motion whose results are in this folder, where its checkpoint stands; a scene is
    /// named only if its file has moved
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["out", "settings", "force"])]
    pub(crate) resume: Option<PathBuf>,
    /// Run over the processes of `mpirun`, by PETSc, whose options stand behind `--`
    #[cfg(feature = "petsc")]
    #[arg(long)]
    pub(crate) petsc: bool,
    /// Options of PETSc
    #[cfg(feature = "petsc")]
    #[arg(last = true, requires = "petsc", value_name = "OPTIONS")]
    pub(crate) options: Vec<String>,
}

#[derive(Debug, Args)]
pub(crate) struct Plan {
    /// A scene file
    pub(crate) scene: PathBuf,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How many threads will work; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
    /// What each of so many processes takes, too, where they share the scene (`--petsc`)
    #[arg(long, value_name = "N", value_parser = count::<MOST_RANKS>)]
    pub(crate) ranks: Option<usize>,
    /// How the plan is written
    #[arg(long, default_value = "human")]
    pub(crate) format: Format,
}

#[derive(Debug, Args)]
pub(crate) struct Bench {
    /// A potential file (.piola), a name of the library, or a scene (.toml); firooz2023 if not given
    #[arg(value_name = "FILE|SCENE")]
    pub(crate) subject: Option<String>,
    /// Number of dimensions of a potential; the largest it is defined in if not given
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub(crate) dim: Option<u8>,
    /// Parameters of a potential, or values of a scene (`body.spacing=0.1`)
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// How many threads work on a scene; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
    /// How the times are written
    #[arg(long, default_value = "human")]
    pub(crate) format: Format,
}

#[derive(Debug, Args)]
pub(crate) struct Info {
    /// A potential of the library, or a potential file
    pub(crate) potential: Option<String>,
    /// List potentials of one kind alone
    #[arg(long, conflicts_with_all = ["potential", "machine"])]
    pub(crate) kind: Option<Kind>,
    /// Show what `bench` and `plan` take this machine for: its memory's bandwidth and its arithmetic
    #[arg(long, conflicts_with = "potential")]
    pub(crate) machine: bool,
    /// Measure the machine again, in a second
    #[arg(long, requires = "machine")]
    pub(crate) renew: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Explain {
    /// The code in the brackets of a message, e.g. `not-stress-free`; all codes if not given
    pub(crate) code: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct ExplainBond {
    /// A scene file
    pub(crate) scene: PathBuf,
    /// The ends of the bond: numbers of two points, counted from 0 in the order of the frames, or their
    /// coordinates at rest in m, `0.1,0.25`
    #[arg(long, num_args = 2, value_names = ["P", "Q"], required = true, allow_hyphen_values = true)]
    pub(crate) at: Vec<Place>,
    /// Override a value of the scene, e.g. `body.spacing=0.1`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// How many threads work; all processors if not given
    #[arg(long, value_parser = count::<MOST_THREADS>)]
    pub(crate) threads: Option<usize>,
    /// How the history is written
    #[arg(long, default_value = "human")]
    pub(crate) format: Format,
}
