//! Kernels in C and Rust, compiled for the processor at hand and run as programs of their own: a
//! comparison that needs no foreign code in this process.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::samples::Samples;

/// A compiled program.
pub(crate) struct Program {
    /// How it was compiled.
    pub(crate) name: String,
    /// Whether our kernels are held to a multiple of its times.
    pub(crate) is_barred: bool,
    path: PathBuf,
}

/// What a program says of one kernel.
pub(crate) struct Found {
    /// Measure and exponent.
    pub(crate) name: String,
    /// Least time in ns per interaction.
    pub(crate) least: f64,
    /// Sums of squares of energies, gradients and tangents.
    pub(crate) sums: [f64; 3],
}

/// A compiler with its flags, and whether it sets a bar.
struct Recipe {
    compiler: &'static str,
    flags: &'static [&'static str],
    is_barred: bool,
}

const RECIPES: [Recipe; 6] = [
    Recipe { compiler: "cc", flags: &["-O3", "-march=native"], is_barred: true },
    Recipe {
        compiler: "cc",
        flags: &["-O3", "-march=native", "-fno-math-errno"],
        is_barred: false,
    },
    Recipe { compiler: "cc", flags: &["-O3", "-march=native", "-ffast-math"], is_barred: true },
    Recipe {
        compiler: "cc",
        flags: &["-O3", "-march=native", "-ffast-math", "-mprefer-vector-width=128"],
        is_barred: false,
    },
    Recipe { compiler: "rustc", flags: &["-O", "-Ctarget-cpu=native"], is_barred: true },
    Recipe { compiler: "rustc", flags: &["-O"], is_barred: false },
];

/// All programs whose compiler is here.
pub(crate) fn compile() -> Vec<Program> {
    RECIPES.iter().enumerate().filter_map(|(number, recipe)| recipe.compile(number)).collect()
}

impl Recipe {
    fn compile(&self, number: usize) -> Option<Program> {
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/ratios/foreign");
        let path = scratch().join(format!("kernels{number}"));
        let mut command = Command::new(self.compiler);
        command.args(self.flags);
        if self.compiler == "rustc" {
            command.args(["--edition", "2024"]).arg(sources.join("kernels.rs"));
            command.arg("-o").arg(&path);
        } else {
            command.arg(sources.join("kernels.c")).arg("-o").arg(&path).arg("-lm");
        }
        let name = format!("`{} {}`", self.compiler, self.flags.join(" "));
        match command.output() {
            Ok(output) if output.status.success() => {
                Some(Program { name, is_barred: self.is_barred, path })
            }
            Ok(output) => {
                eprintln!("{name} failed:\n{}", String::from_utf8_lossy(&output.stderr));
                None
            }
            Err(error) => {
                eprintln!("{name} is left out: {error}");
                None
            }
        }
    }
}

impl Program {
    /// Times and results of all kernels.
    pub(crate) fn run(&self, input: &Path) -> Vec<Found> {
        let output = Command::new(&self.path).arg(input).output().expect("it was just compiled");
        assert!(output.status.success(), "{} ended with {}", self.name, output.status);
        let text = String::from_utf8(output.stdout).expect("plain text");
        text.lines().map(read).collect()
    }
}

/// `bond 2.7 12.1 12.5 1e3 2e3 3e3`: least and median time, sums of squares.
fn read(line: &str) -> Found {
    let mut words = line.split(' ');
    let name: Vec<&str> = words.by_ref().take(2).collect();
    let numbers: Vec<f64> = words.map(|word| word.parse().expect("a number")).collect();
    let sums = [numbers[2], numbers[3], numbers[4]];
    Found { name: name.join(" "), least: numbers[0], sums }
}

/// Writes the interactions that all programs evaluate.
pub(crate) fn write_inputs() -> PathBuf {
    let path = scratch().join("interactions");
    let all =
        [Samples::<3>::new().blocks(), Samples::<6>::new().blocks(), Samples::<9>::new().blocks()];
    std::fs::write(&path, all.concat()).expect("the build folder can be written to");
    path
}

fn scratch() -> &'static Path {
    Path::new(env!("CARGO_TARGET_TMPDIR"))
}
