//! What the tests of this crate run on several ranks, one case at a time:
//!
//! ```text
//! mpirun -n 3 ranks CASE [number ..] -- [option of PETSc ..]
//! ```
//!
//! Case `lattice` with the size of a cube, a horizon in spacings and a pull measures solvers.

mod lattice;
mod small;
mod springs;

use std::process::ExitCode;

use piola_petsc::Engine;

/// Bounds of ranks that share out `all` points.
fn ranges(all: usize, ranks: usize) -> Vec<u64> {
    (0..=ranks).map(|rank| (all * rank / ranks) as u64).collect()
}

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let options = match arguments.iter().position(|argument| argument == "--") {
        Some(at) => arguments.split_off(at).split_off(1),
        None => Vec::new(),
    };
    let engine = match Engine::start("ranks", &options) {
        Ok(engine) => engine,
        Err(error) => return ended(0, error.to_string()),
    };
    let case = arguments.first().map(String::as_str).unwrap_or_default();
    let numbers: Vec<f64> = arguments.iter().skip(1).filter_map(|text| text.parse().ok()).collect();
    let result = match case {
        "sums" => small::sums(&engine),
        "messages" => small::messages(&engine),
        "halo" => small::halo(&engine),
        "wrong" => small::wrong(&engine),
        "logarithms" => small::logarithms(&engine),
        "dies" => small::dies(&engine),
        "panics" => small::panics(&engine),
        "lattice" => lattice::solve(&engine, &numbers, lattice::Fault::None),
        "late" => lattice::solve(&engine, &numbers, lattice::Fault::Late),
        "early" => lattice::solve(&engine, &numbers, lattice::Fault::Early),
        "row" => lattice::solve(&engine, &numbers, lattice::Fault::Row),
        "refuses" => lattice::solve(&engine, &numbers, lattice::Fault::Refused),
        "linear" => lattice::linear(&engine, &numbers),
        _ => Err(format!("no case {case:?}")),
    };
    let rank = engine.rank();
    match result {
        Ok(lines) => {
            if rank == 0 {
                print!("{lines}");
            }
            ExitCode::SUCCESS
        }
        Err(message) => ended(rank, message),
    }
}

/// Says why, one write for a line: those of ranks are not mixed.
fn ended(rank: usize, message: String) -> ExitCode {
    eprint!("{}", format_args!("rank {rank} says: {message}\n").to_string().as_str());
    ExitCode::from(3)
}
