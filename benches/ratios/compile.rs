//! How long it takes until an energy is machine code.

use piola_compiler::{Level, Mode};

use crate::clock::{Clock, in_turn};
use crate::ours::SethHill;
use crate::table::{Bar, head, row};

const ROUNDS: usize = 9;
/// What a kernel may take, in ms.
const ALLOWED: f64 = 5.0;

pub(crate) fn run() {
    head(
        "Compile time",
        "From the checked potential to machine code: specialised, differentiated, rewritten, compiled; mean of \
         the kernels of bonds, triangles and tetrahedra, least of some runs.",
        "ours, ms",
        "allowed, ms",
    );
    for n in [1.0, 2.0, 2.7, 0.0, -3.0] {
        let energy = SethHill::new(n);
        let mut kernels = 0;
        let mut compile = || {
            let compiled = energy
                .model
                .compile(&energy.values, Mode::Jit(Level::Strict))
                .expect("it compiles");
            kernels = compiled.kernels.len();
        };
        let [times] = in_turn(ROUNDS, Clock::Wall, [&mut compile]);
        let each = times.least() * 1e3 / kernels as f64;
        let name = if n == 0.0 { "ln".to_string() } else { format!("n = {n}") };
        row(&name, each, ALLOWED, each / ALLOWED, Bar::AtMost(1.0, 0.2));
    }
}
