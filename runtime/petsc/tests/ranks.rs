//! The crate on 1 to 4 ranks: runs the program of `examples/ranks` by `mpirun`, each time with a limit of
//! time, as what goes wrong between ranks stands still.

#[path = "../../../compiler/tests/support/machine.rs"]
mod machine;
#[path = "support/mpirun.rs"]
mod mpirun;
#[path = "../examples/ranks/springs.rs"]
mod springs;

use std::io::Read;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus};
use std::sync::Mutex;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mpirun::mpirun;
use springs::{D, Springs};

/// One run at a time has the cores.
static TURN: Mutex<()> = Mutex::new(());

/// Longest time of a run; a rank that fails before an exchange takes ten seconds to end it.
const LIMIT: Duration = Duration::from_secs(60);

struct Run {
    status: ExitStatus,
    stdout: String,
    stderr: String,
}

impl Run {
    /// What stands behind a word at the beginning of lines.
    fn values(&self, word: &str) -> Vec<&str> {
        let lines = self.stdout.lines();
        lines.filter_map(|line| line.strip_prefix(word)?.strip_prefix(' ')).collect()
    }

    #[track_caller]
    fn succeeds(self) -> Run {
        assert!(self.status.success(), "{}\n{}\n{}", self.status, self.stdout, self.stderr);
        self
    }

    #[track_caller]
    fn fails_with(self, words: &str) -> Run {
        assert!(!self.status.success(), "{}", self.stdout);
        assert!(self.stderr.contains(words), "{words}\n{}", self.stderr);
        self
    }
}

/// The example next to this test.
fn program() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let path = test.parent().unwrap().parent().unwrap().join("examples/ranks");
    let remedy = "cargo build --example ranks with the options of this test";
    assert!(path.is_file(), "{} is not there: {remedy}", path.display());
    path
}

fn reader(mut from: impl Read + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        from.read_to_end(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// Sends a signal to the group of a process: mpirun passes it on to its ranks.
fn signal(child: &Child, name: &str) {
    let group = format!("-{}", child.id());
    let _ = Command::new("kill").args([&format!("-{name}"), "--", &group]).status();
}

/// Runs a case on some ranks; words before `--` are its numbers, those behind it options of PETSc.
#[track_caller]
fn run(ranks: usize, words: &str) -> Run {
    let _turn = TURN.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let mut command = mpirun(ranks, program());
    command.args(words.split_whitespace());
    let mut child = command.spawn().unwrap();
    let stdout = reader(child.stdout.take().unwrap());
    let stderr = reader(child.stderr.take().unwrap());
    let since = Instant::now();
    let status = loop {
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None if since.elapsed() > LIMIT => {
                signal(&child, "TERM");
                std::thread::sleep(Duration::from_secs(5));
                signal(&child, "KILL");
                let _ = child.wait();
                panic!("`{words}` on {ranks} ranks stood still: {}", stderr.join().unwrap());
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    Run { status, stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
}

#[test]
fn sums_have_the_same_bits_in_every_run() {
    if !machine::has_mpirun() {
        return;
    }
    for ranks in 1..=4 {
        let expected = |number: fn(f64, f64) -> f64, i: f64| {
            let mut sum = number(0.0, i);
            (1..ranks).for_each(|rank| sum += number(f64::from(rank), i));
            format!("{:016x}", sum.to_bits())
        };
        let first = run(ranks as usize, "sums").succeeds();
        let slope = |rank: f64, i: f64| 1e16 / (rank + 1.0) - i / 3.0;
        let sums = first.values("sum");
        assert_eq!(sums[0], expected(slope, 0.0));
        assert_eq!(sums[1], expected(slope, 39_999.0));
        assert_eq!(sums[2], expected(|rank, _| 0.1 * (rank + 1.0), 0.0));
        let nan = if ranks > 1 { "NaN" } else { "1e0" };
        let last = format!("{:e}", 0.1 * f64::from(ranks));
        assert_eq!(first.values("max"), ["1e16", "9.999999999986668e15", &last, nan]);
        for _ in 0..2 {
            assert_eq!(run(ranks as usize, "sums").succeeds().stdout, first.stdout);
        }
    }
}

#[test]
fn ranks_tell_each_other() {
    if !machine::has_mpirun() {
        return;
    }
    for ranks in 1..=4 {
        run(ranks, "messages").succeeds();
    }
}

#[test]
fn ghosts_have_the_numbers_of_their_owners() {
    if !machine::has_mpirun() {
        return;
    }
    for ranks in 1..=4 {
        run(ranks, "halo").succeeds();
    }
}

#[test]
fn what_is_wrong_on_one_rank_all_know() {
    if !machine::has_mpirun() {
        return;
    }
    for ranks in [1, 3] {
        let lines = run(ranks, "wrong").succeeds().stdout;
        let expected = [
            "rank 0: point 8 is a ghost, and there are 8".to_string(),
            "rank 0: point 0 is a ghost on the rank that owns it".to_string(),
            "rank 0: the columns of row 1 are not points of the body, ascending, with its own"
                .to_string(),
            format!("rank 0: ranges of {ranks} ranks are {} numbers from 0 up", ranks + 1),
        ];
        assert_eq!(lines.lines().collect::<Vec<_>>(), expected);
    }
}

/// Newton's method with a dense matrix, to rounding.
fn solved_here(size: [usize; 3], horizon: f64, pull: f64) -> Vec<f64> {
    let springs = Springs::new(size, horizon, 0..size.iter().product(), pull);
    let n = springs.own.len() * D;
    let mut u = vec![0.0; n];
    for _ in 0..20 {
        let mut right = vec![0.0; n];
        springs.residual(&u, &mut right);
        let mut blocks = vec![0.0; springs.columns.len() * D * D];
        springs.tangent(&u, &mut blocks);
        let mut dense = vec![vec![0.0; n]; n];
        for i in 0..springs.own.len() {
            for k in springs.starts[i]..springs.starts[i + 1] {
                for (a, b) in (0..D * D).map(|at| (at / D, at % D)) {
                    let column = springs.columns[k] as usize * D + b;
                    dense[i * D + a][column] = blocks[(k * D + a) * D + b];
                }
            }
        }
        let step = eliminated(dense, right);
        u.iter_mut().zip(&step).for_each(|(u, step)| *u -= step);
        if step.iter().all(|step| step.abs() < 1e-14) {
            return u;
        }
    }
    panic!("the reference does not converge");
}

/// Elimination with pivots of columns.
fn eliminated(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        let (done, below) = a.split_at_mut(k + 1);
        for (i, row) in below.iter_mut().enumerate().filter(|(_, row)| row[k] != 0.0) {
            let factor = row[k] / done[k][k];
            for j in k..n {
                row[j] -= factor * done[k][j];
            }
            b[k + 1 + i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    b
}

#[track_caller]
fn agrees(run: &Run, expected: &[f64]) {
    assert_eq!(run.values("converged"), ["true"], "{}", run.stdout);
    let found: Vec<f64> = run.values("u").iter().map(|text| text.parse().unwrap()).collect();
    assert_eq!(found.len(), expected.len());
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() < 1e-10, "unknown {i}: {found} and {expected}");
    }
}

#[test]
fn a_lattice_is_solved_the_same_on_any_ranks() {
    if !machine::has_mpirun() {
        return;
    }
    for (horizon, pull) in [(2, 0.8), (3, 2.0)] {
        let expected = solved_here([6, 4, 4], f64::from(horizon), pull);
        for ranks in 1..=4 {
            let run = run(ranks, &format!("lattice 6 {horizon} {pull} 4")).succeeds();
            agrees(&run, &expected);
            assert!(run.values("unused").is_empty(), "{}", run.stdout);
            assert!(run.stderr.is_empty(), "{}", run.stderr);
        }
    }
}

#[test]
fn options_choose_another_solver() {
    if !machine::has_mpirun() {
        return;
    }
    let expected = solved_here([6, 4, 4], 2.0, 0.8);
    for options in [
        "-ksp_type gmres -pc_type bjacobi",
        "-pc_type lu -ksp_type preonly -pc_factor_mat_solver_type mumps",
        "-snes_ksp_ew -mat_type baij -pc_type asm",
        "-snes_linesearch_type basic -pc_type jacobi",
        "-snes_mf_operator",
    ] {
        let run = run(2, &format!("lattice 6 2 0.8 4 -- {options}")).succeeds();
        agrees(&run, &expected);
        assert!(run.values("unused").is_empty(), "{}", run.stdout);
    }
}

#[test]
fn one_linear_system_is_solved() {
    if !machine::has_mpirun() {
        return;
    }
    for (ranks, options) in [(1, ""), (3, ""), (2, "-- -snes_ksp_ew"), (2, "-- -ksp_rtol 1e-10")] {
        let run = run(ranks, &format!("linear 7 2 0.5 {options}")).succeeds();
        assert_eq!(run.values("converged"), ["true", "true"]);
        assert_eq!(run.values("linear")[0], run.values("linear")[1]);
        let off: f64 = run.values("relative")[0].parse().unwrap();
        assert!(off < 1e-8, "{off}");
    }
}

#[test]
fn a_solver_that_fails_says_why() {
    if !machine::has_mpirun() {
        return;
    }
    for (options, reason) in [
        ("-ksp_max_it 2", "DIVERGED_LINEAR_SOLVE (DIVERGED_ITS)"),
        ("-snes_max_it 1", "DIVERGED_MAX_IT"),
    ] {
        let run = run(2, &format!("lattice 6 2 0.8 4 -- {options}")).succeeds();
        assert_eq!(run.values("converged"), ["false"]);
        assert_eq!(run.values("reason"), [reason]);
    }
}

#[test]
fn a_step_outside_of_the_domain_is_shortened_on_all_ranks() {
    if !machine::has_mpirun() {
        return;
    }
    for ranks in 1..=4 {
        let run = run(ranks, "logarithms").succeeds();
        assert_eq!(run.values("converged"), ["true", "false", "false", "true"]);
        let reasons = ["DIVERGED_FUNCTION_DOMAIN", "DIVERGED_JACOBIAN_DOMAIN"];
        assert_eq!(run.values("reason"), reasons);
        let off: f64 = run.values("off")[0].parse().unwrap();
        assert!(off < 1e-11, "{off}");
        // The last rank alone was outside.
        let mut counts = vec!["0.0"; ranks];
        counts[ranks - 1] = "1.0";
        assert_eq!(run.values("outside"), [format!("[{}]", counts.join(", "))]);
    }
}

#[test]
fn ranks_without_points_take_part() {
    if !machine::has_mpirun() {
        return;
    }
    for options in ["", "-- -pc_type bjacobi", "-- -pc_type jacobi -ksp_type cg"] {
        let run = run(3, &format!("lattice 2 1 0.8 1 {options}")).succeeds();
        agrees(&run, &[0.0, 0.0, 0.0, 0.8, 0.0, 0.0]);
    }
}

#[test]
fn options_are_checked() {
    if !machine::has_mpirun() {
        return;
    }
    let misspelt = run(2, "lattice 6 2 0.8 4 -- -ksp_tpye cg").succeeds();
    assert_eq!(misspelt.values("unused"), ["-ksp_tpye"]);
    run(2, "lattice 6 2 0.8 4 -- -pc_type nonsense").fails_with("PC type nonsense");
    run(2, "lattice 6 2 0.8 4 -- -ksp_rtol small").fails_with("small");
}

#[test]
fn a_failure_of_one_rank_ends_the_solve_on_all() {
    if !machine::has_mpirun() {
        return;
    }
    for (case, words) in [
        ("late", "panic: a mistake behind the exchange"),
        ("row", "panic: a mistake in a row"),
        ("refuses", "the material has no tangent"),
    ] {
        let run = run(3, &format!("{case} 6 2 0.8 4")).fails_with(words);
        // mpirun ends the others when the first one has ended, hence not all need come to say it.
        assert!(run.stderr.contains(&format!("says: rank 2: {words}")), "{}", run.stderr);
    }
    run(3, "early 6 2 0.8 4").fails_with("error: rank 2: panic: a mistake before the exchange");
    run(3, "panics").fails_with("a mistake of the last rank");
}

#[test]
fn a_rank_that_dies_ends_the_run() {
    if !machine::has_mpirun() {
        return;
    }
    for ranks in [2, 4] {
        let run = run(ranks, "dies");
        assert!(!run.status.success() || run.status.signal().is_some(), "{}", run.stdout);
        assert!(run.stdout.is_empty());
    }
}
