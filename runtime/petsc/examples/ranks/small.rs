//! Cases of a few numbers.

use std::fmt::Write;

use piola_petsc::{BlockRows, Engine, Halo, Newton, Problem, Refusal};

use crate::ranges;

/// Bits of a sum whose value depends on the order, and of a maximum, of every rank.
pub(crate) fn sums(engine: &Engine) -> Result<String, String> {
    let rank = engine.rank() as f64;
    let mut values: Vec<f64> =
        (0..40_000).map(|i| 1e16 / (rank + 1.0) - f64::from(i) / 3.0).collect();
    values.extend([0.1 * (rank + 1.0), if rank == 1.0 { f64::NAN } else { 1.0 }]);
    let mut most = values.clone();
    engine.sum(&mut values);
    engine.max(&mut most);
    let own: Vec<u8> = values.iter().chain(&most).flat_map(|value| value.to_le_bytes()).collect();
    let all = engine.gather(&own).unwrap_or_default();
    let mut lines = String::new();
    for (rank, bytes) in all.iter().enumerate() {
        if *bytes != all[0] {
            return Err(format!("rank {rank} has other sums"));
        }
    }
    for value in [0, 39_999, 40_000, 40_001].map(|i| values[i]) {
        writeln!(lines, "sum {:016x}", value.to_bits()).unwrap();
    }
    for value in [0, 39_999, 40_000, 40_001].map(|i| most[i]) {
        writeln!(lines, "max {value:e}").unwrap();
    }
    Ok(lines)
}

/// SIGHUP, SIGILL and SIGTERM: PETSc would handle them, Rust and Open MPI do not.
const HANDLED_BY_PETSC: u64 = 1 | 1 << 3 | 1 << 14;

/// Signals that this process has handlers for, as bits; none where the system does not tell.
fn caught_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
    mask.map_or(0, |mask| u64::from_str_radix(mask.trim(), 16).unwrap())
}

/// Bytes and numbers between ranks, and that the engine has what it should of the process.
pub(crate) fn messages(engine: &Engine) -> Result<String, String> {
    let (rank, ranks) = (engine.rank(), engine.ranks());
    let own = vec![rank as u8; 3 * rank];
    let all = engine.gather(&own);
    let expected: Vec<Vec<u8>> = (0..ranks).map(|rank| vec![rank as u8; 3 * rank]).collect();
    assert_eq!(all, (rank == 0).then_some(expected));
    let mut bytes = if rank == 0 { b"from rank 0".to_vec() } else { vec![7; rank] };
    engine.broadcast(&mut bytes);
    assert_eq!(bytes, b"from rank 0");
    let part = |rank: usize| vec![rank as u8; 5 * rank];
    let scattered = engine.scatter(|to| {
        assert_eq!(engine.rank(), 0, "elsewhere it is not asked");
        part(to)
    });
    assert_eq!(scattered, part(rank));
    assert_eq!(
        engine.all_gather(10 + rank as u64),
        Vec::from_iter((0..ranks as u64).map(|r| 10 + r))
    );
    assert_eq!(engine.exclusive_sum(2), 2 * rank as u64);
    assert_eq!(engine.agree(Ok(())), Ok(()));
    let own = if rank > 0 { Err(format!("no luck on {rank}")) } else { Ok(()) };
    let agreed = engine.agree(own).err().map(|failure| failure.to_string());
    assert_eq!(agreed, (ranks > 1).then(|| "rank 1: no luck on 1".to_string()));
    let again = Engine::start("again", &[]).err().map(|error| error.message);
    assert_eq!(again.as_deref(), Some("PETSc was already started in this process"));
    assert_eq!(caught_signals() & HANDLED_BY_PETSC, 0);
    Ok("fine\n".to_string())
}

/// Halos of a chain and of a square lattice, both ways.
pub(crate) fn halo(engine: &Engine) -> Result<String, String> {
    let rank = engine.rank();
    for (width, d) in [(1, 1), (1, 3), (7, 2)] {
        let bounds = ranges(11 * width, engine.ranks());
        let own = bounds[rank]..bounds[rank + 1];
        // Two rows behind either end, the farther ones first.
        let reach = 2 * width as u64;
        let above = own.end..(own.end + reach).min(11 * width as u64);
        let ghosts: Vec<u64> = above.chain(own.start.saturating_sub(reach)..own.start).collect();
        let halo = Halo::new(engine, &bounds, &ghosts, d).map_err(|error| error.to_string())?;
        let n = (own.end - own.start) as usize * d;
        let number = |point: u64, a: usize| point as f64 + 0.25 * a as f64;
        let mut local: Vec<f64> =
            own.clone().flat_map(|point| (0..d).map(move |a| number(point, a))).collect();
        local.resize(n + ghosts.len() * d, f64::NAN);
        halo.fill(&mut local).map_err(|error| error.to_string())?;
        let points = own.clone().chain(ghosts.iter().copied());
        let expected: Vec<f64> =
            points.flat_map(|point| (0..d).map(move |a| number(point, a))).collect();
        assert_eq!(local, expected, "width {width}, {d} numbers");
        assert_eq!(halo.bytes(), (8 * d * ghosts.len()) as u64);
        // Every point gets one from each rank that has it as a ghost.
        local.fill(1.0);
        halo.add_back(&mut local).map_err(|error| error.to_string())?;
        let mut counted = local[..n].iter().sum::<f64>();
        let mut sums = [counted, (ghosts.len() * d + n) as f64];
        engine.sum(&mut sums);
        counted = sums[0];
        assert_eq!(counted, sums[1], "width {width}, {d} numbers");
    }
    Ok("fine\n".to_string())
}

/// Errors that one rank alone has are known to all.
pub(crate) fn wrong(engine: &Engine) -> Result<String, String> {
    let bounds = ranges(8, engine.ranks());
    let ghosts: &[u64] = if engine.rank() == 0 { &[8] } else { &[] };
    let mut lines = String::new();
    let error = Halo::new(engine, &bounds, ghosts, 1).err().ok_or("no error")?;
    writeln!(lines, "{error}").unwrap();
    let own: &[u64] = if engine.rank() == 0 { &[0] } else { &[] };
    let error = Halo::new(engine, &bounds, own, 1).err().ok_or("no error")?;
    writeln!(lines, "{error}").unwrap();
    let n = (bounds[engine.rank() + 1] - bounds[engine.rank()]) as usize;
    let columns = vec![0; n];
    let pattern = BlockRows { starts: (0..=n).collect(), columns };
    let error = Newton::new(engine, &bounds, &pattern, 1, &[]).err().ok_or("no error")?;
    writeln!(lines, "{error}").unwrap();
    let error = Halo::new(engine, &[0; 9], &[], 1).err().ok_or("no error")?;
    writeln!(lines, "{error}").unwrap();
    Ok(lines)
}

/// `ln u = 0` at every point: from 5 the first step leads below zero, where there is no logarithm.
struct Logarithms {
    outside: f64,
    /// Whether this rank has no tangent.
    stuck: bool,
    /// The tangent, a number a point.
    slopes: Vec<f64>,
}

impl Problem for Logarithms {
    fn residual(&mut self, u: &[f64], r: &mut [f64]) -> Result<(), Refusal> {
        if u.iter().any(|&u| u <= 0.0) {
            self.outside += 1.0;
            return Err(Refusal::Outside);
        }
        for (r, u) in r.iter_mut().zip(u) {
            *r = libm::log(*u);
        }
        Ok(())
    }

    fn tangent(&mut self, u: &[f64]) -> Result<(), Refusal> {
        self.slopes.clear();
        if self.stuck {
            return Err(Refusal::Outside);
        }
        self.slopes.extend(u.iter().map(|u| 1.0 / u));
        Ok(())
    }

    fn row(&mut self, row: usize, values: &mut [f64]) {
        values[0] = self.slopes[row];
    }

    fn is_converged(&mut self, _: usize, norm: f64) -> bool {
        norm < 1e-12
    }
}

/// The last rank alone steps outside; then a start outside of it.
pub(crate) fn logarithms(engine: &Engine) -> Result<String, String> {
    let bounds = ranges(8, engine.ranks());
    let own = bounds[engine.rank()]..bounds[engine.rank() + 1];
    let n = (own.end - own.start) as usize;
    let pattern = BlockRows { starts: (0..=n).collect(), columns: own.clone().collect() };
    let mut newton =
        Newton::new(engine, &bounds, &pattern, 1, &[]).map_err(|error| error.to_string())?;
    let mut problem = Logarithms { outside: 0.0, stuck: false, slopes: Vec::new() };
    let mut u: Vec<f64> = own.clone().map(|i| if i == 7 { 5.0 } else { 1.5 }).collect();
    let outcome = newton.solve(&mut problem, &mut u).map_err(|error| error.to_string())?;
    let mut lines = format!("converged {}\n", outcome.converged);
    let mut counts = vec![0.0; engine.ranks() + 1];
    counts[engine.rank()] = problem.outside;
    counts[engine.ranks()] = u.iter().map(|u| (u - 1.0).abs()).sum();
    engine.sum(&mut counts);
    writeln!(lines, "off {:e}", counts.pop().unwrap()).unwrap();
    writeln!(lines, "outside {counts:?}").unwrap();
    let mut u: Vec<f64> = own.map(|i| if i == 7 { -1.0 } else { 1.5 }).collect();
    let outcome = newton.solve(&mut problem, &mut u).map_err(|error| error.to_string())?;
    writeln!(lines, "converged {}\nreason {}", outcome.converged, outcome.reason).unwrap();
    u.fill(1.5);
    problem.stuck = engine.rank() == 0;
    let outcome = newton.solve(&mut problem, &mut u).map_err(|error| error.to_string())?;
    writeln!(lines, "converged {}\nreason {}", outcome.converged, outcome.reason).unwrap();
    // And what went wrong is over.
    problem.stuck = false;
    let outcome = newton.solve(&mut problem, &mut u).map_err(|error| error.to_string())?;
    writeln!(lines, "converged {}", outcome.converged).unwrap();
    Ok(lines)
}

/// The last rank is killed while the others wait for it.
pub(crate) fn dies(engine: &Engine) -> Result<String, String> {
    if engine.rank() + 1 == engine.ranks() {
        let own = std::process::id().to_string();
        let _ = std::process::Command::new("kill").args(["-KILL", &own]).status();
        std::thread::sleep(std::time::Duration::from_secs(600));
    }
    engine.sum(&mut [1.0]);
    Ok("nobody died\n".to_string())
}

/// The last rank panics outside of callbacks while the others wait for it.
pub(crate) fn panics(engine: &Engine) -> Result<String, String> {
    assert!(engine.rank() + 1 < engine.ranks(), "a mistake of the last rank");
    engine.sum(&mut [1.0]);
    Ok("nobody panicked\n".to_string())
}
