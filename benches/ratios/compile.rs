//! How long it takes until an energy is machine code.

use piola_compiler::{Form, Level, Mode};

use crate::clock::{Clock, in_turn};
use crate::ours::SethHill;
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 9;
/// What a kernel may take, in ms.
const ALLOWED: f64 = 5.0;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "compile",
        "From the checked potential to machine code: specialised, differentiated, rewritten, compiled. A \
         potential has three kernels, of bonds, triangles and tetrahedra, and energies with even powers alone \
         a second one each; allowed are 5 ms for each of the three.",
        ["ours, ms", "allowed, ms"],
        Division::OursByTheirs,
    );
    for level in [Level::Fast, Level::Strict] {
        for n in [1.0, 2.0, 2.7, 0.0, -3.0] {
            potential(&mut table, level, n);
        }
    }
    vec![table]
}

fn potential(table: &mut Table, level: Level, n: f64) {
    let energy = SethHill::new(n);
    let mut kernels = 0;
    let mut compile = || {
        let compiled = energy
            .model
            .compile(&energy.values, Mode::Jit(level), Form::Accurate)
            .expect("it compiles");
        kernels = compiled.kernels.len();
    };
    let [times] = in_turn(ROUNDS, Clock::Wall, [&mut compile]);
    let exponent = if n == 0.0 { "ln".to_string() } else { format!("n = {n}") };
    let is_default = level == Level::default();
    let name =
        format!("{exponent}, `{}`{}", level.name(), if is_default { " (default)" } else { "" });
    let bar = if is_default { Bar::AtMost(1.0, 0.2) } else { Bar::None };
    let allowed = ALLOWED * kernels as f64;
    table.ratio(name, [times.least() * 1e3, allowed], Statistic::Least(ROUNDS), bar);
}
