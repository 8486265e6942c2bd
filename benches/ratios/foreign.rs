//! Kernels in C and Rust, compiled for the processor at hand and run as programs of their own: a
//! comparison that needs no foreign code in this process.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::samples::Samples;

/// A compiled program.
pub(crate) struct Program {
    /// How it was compiled.
    pub(crate) name: String,
    /// Whether its compiler may compute as if numbers were real (`-ffast-math`).
    pub(crate) is_fast: bool,
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

/// A compiler with its flags, and whether it may compute as if numbers were real.
struct Recipe {
    compiler: &'static str,
    flags: &'static [&'static str],
    is_fast: bool,
}

impl Recipe {
    const fn fast(compiler: &'static str, flags: &'static [&'static str]) -> Recipe {
        Recipe { compiler, flags, is_fast: true }
    }

    const fn strict(compiler: &'static str, flags: &'static [&'static str]) -> Recipe {
        Recipe { compiler, flags, is_fast: false }
    }
}

/// Both C compilers choose registers of 256 bits where there are wider ones, unless they are told.
const RECIPES: [Recipe; 9] = [
    Recipe::fast("cc", &["-O3", "-march=native", "-ffast-math"]),
    Recipe::fast("cc", &["-O3", "-march=native", "-ffast-math", "-mprefer-vector-width=512"]),
    Recipe::fast("clang", &["-O3", "-march=native", "-ffast-math"]),
    Recipe::fast("clang", &["-O3", "-march=native", "-ffast-math", "-mprefer-vector-width=512"]),
    Recipe::strict("cc", &["-O3", "-march=native"]),
    Recipe::strict("cc", &["-O3", "-march=native", "-fno-math-errno"]),
    Recipe::strict("clang", &["-O3", "-march=native"]),
    Recipe::strict("clang", &["-O3", "-march=native", "-fno-math-errno"]),
    Recipe::strict("rustc", &["-O", "-Ctarget-cpu=native"]),
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
                Some(Program { name, is_fast: self.is_fast, path })
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
