//! A lattice of springs that ranks share.

use std::fmt::Write;
use std::time::Instant;

use piola_petsc::{BlockRows, Engine, Halo, Newton, Outcome, Problem, Refusal};

use crate::ranges;
use crate::springs::{D, Springs};

/// What goes wrong on the last rank at the second tangent.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    None,
    /// A panic behind the exchange of halos.
    Late,
    /// A panic before it: the others wait.
    Early,
    /// A refusal in words.
    Refused,
    /// A panic in the middle of its rows.
    Row,
}

struct Shared<'e> {
    engine: &'e Engine,
    springs: Springs,
    halo: Halo<'e>,
    local: Vec<f64>,
    fault: Fault,
    tangents: usize,
    blocks: Vec<f64>,
    seconds: f64,
}

impl<'e> Shared<'e> {
    fn new(
        engine: &'e Engine,
        numbers: &[f64],
        fault: Fault,
    ) -> Result<(Shared<'e>, Newton<'e>), String> {
        let [side, horizon, pull, ..] = *numbers else {
            return Err("points of a side, horizon and pull, please".to_string());
        };
        let thick = numbers.get(3).map_or(side, |&thick| thick) as usize;
        let size = [side as usize, thick, thick];
        let ranges = ranges(size.iter().product(), engine.ranks());
        let own = ranges[engine.rank()] as usize..ranges[engine.rank() + 1] as usize;
        let springs = Springs::new(size, horizon, own, pull);
        let halo =
            Halo::new(engine, &ranges, &springs.ghosts, D).map_err(|error| error.to_string())?;
        let pattern =
            BlockRows { starts: springs.starts.clone(), columns: springs.columns.clone() };
        let newton = Newton::new(engine, &ranges, &pattern, D, &springs.rigid_motions())
            .map_err(|error| error.to_string())?;
        let local = vec![0.0; (springs.own.len() + springs.ghosts.len()) * D];
        let blocks = Vec::new();
        let (tangents, seconds) = (0, 0.0);
        let shared = Shared { engine, springs, halo, local, fault, tangents, blocks, seconds };
        Ok((shared, newton))
    }

    fn fill(&mut self, u: &[f64]) -> Result<(), Refusal> {
        self.local[..u.len()].copy_from_slice(u);
        self.halo.fill(&mut self.local)?;
        Ok(())
    }

    fn is_faulty(&self, fault: Fault) -> bool {
        let last = self.engine.rank() + 1 == self.engine.ranks();
        last && self.fault == fault && self.tangents == 2
    }
}

impl Problem for Shared<'_> {
    fn residual(&mut self, u: &[f64], r: &mut [f64]) -> Result<(), Refusal> {
        let since = Instant::now();
        self.fill(u)?;
        self.springs.residual(&self.local, r);
        self.seconds += since.elapsed().as_secs_f64();
        Ok(())
    }

    fn tangent(&mut self, u: &[f64]) -> Result<(), Refusal> {
        let since = Instant::now();
        self.tangents += 1;
        assert!(!self.is_faulty(Fault::Early), "a mistake before the exchange");
        self.fill(u)?;
        assert!(!self.is_faulty(Fault::Late), "a mistake behind the exchange");
        if self.is_faulty(Fault::Refused) {
            return Err(Refusal::Failed("the material has no tangent".to_string()));
        }
        self.blocks.clear();
        self.blocks.resize(self.springs.columns.len() * D * D, 0.0);
        self.springs.tangent(&self.local, &mut self.blocks);
        self.seconds += since.elapsed().as_secs_f64();
        Ok(())
    }

    fn row(&mut self, row: usize, values: &mut [f64]) {
        self.springs.row(&self.blocks, row, values);
        assert!(!self.is_faulty(Fault::Row) || row == 0, "a mistake in a row");
    }

    fn is_converged(&mut self, _: usize, norm: f64) -> bool {
        norm < 1e-11 * (self.springs.size[0] as f64)
    }
}

/// The outcome, options that nothing read, and on small lattices all displacements, a number a line.
pub(crate) fn solve(engine: &Engine, numbers: &[f64], fault: Fault) -> Result<String, String> {
    let (mut problem, mut newton) = Shared::new(engine, numbers, fault)?;
    let mut u = vec![0.0; problem.springs.own.len() * D];
    let since = Instant::now();
    let outcome = newton.solve(&mut problem, &mut u).map_err(|error| {
        let again = newton.solve(&mut problem, &mut u);
        assert_eq!(again, Err(error.clone()), "a broken solver says why");
        error.to_string()
    })?;
    let seconds = since.elapsed().as_secs_f64();
    let Outcome { converged, reason, iterations, linear_iterations, residual } = outcome;
    let mut lines = format!(
        "converged {converged}\nreason {reason}\niterations {iterations}\nlinear {linear_iterations}\n\
         residual {residual:e}\nseconds {seconds:.2}\nevaluation {:.2}\n",
        problem.seconds
    );
    for option in engine.unused_options().map_err(|error| error.to_string())? {
        writeln!(lines, "unused {option}").unwrap();
    }
    let bytes: Vec<u8> = u.iter().flat_map(|value| value.to_le_bytes()).collect();
    let all = engine.gather(&bytes).unwrap_or_default().concat();
    if all.len() < 8 * 2000 {
        for value in all.chunks_exact(8) {
            writeln!(lines, "u {:e}", f64::from_le_bytes(value.try_into().unwrap())).unwrap();
        }
    }
    Ok(lines)
}

/// The first step of Newton's method alone, and how far `K x` is from the right-hand side.
pub(crate) fn linear(engine: &Engine, numbers: &[f64]) -> Result<String, String> {
    let (mut problem, mut newton) = Shared::new(engine, numbers, Fault::None)?;
    let n = problem.springs.own.len() * D;
    let (u, mut right, mut x) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    problem.residual(&u, &mut right).map_err(|refusal| format!("{refusal:?}"))?;
    problem.tangent(&u).map_err(|refusal| format!("{refusal:?}"))?;
    let mut lines = String::new();
    // A second time: the first one left nothing behind.
    for _ in 0..2 {
        let outcome =
            newton.solve_linear(&mut problem, &right, &mut x).map_err(|error| error.to_string())?;
        writeln!(lines, "converged {}\nreason {}", outcome.converged, outcome.reason).unwrap();
        writeln!(lines, "linear {}", outcome.iterations).unwrap();
    }
    problem.fill(&x).map_err(|refusal| format!("{refusal:?}"))?;
    let places = &problem.springs.places;
    let mut squares = [0.0, 0.0];
    for i in 0..problem.springs.own.len() {
        for a in 0..D {
            let mut product = 0.0;
            for k in problem.springs.starts[i]..problem.springs.starts[i + 1] {
                for b in 0..D {
                    product +=
                        problem.blocks[(k * D + a) * D + b] * problem.local[places[k] * D + b];
                }
            }
            let off = product - right[i * D + a];
            squares[0] += off * off;
            squares[1] += right[i * D + a] * right[i * D + a];
        }
    }
    engine.sum(&mut squares);
    writeln!(lines, "relative {:e}", (squares[0] / squares[1]).sqrt()).unwrap();
    Ok(lines)
}
