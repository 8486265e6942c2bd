//! What tests need of the machine: where it is missing a test skips and says so, but for the gate,
//! in which it fails and says what to install.

use std::process::Command;

/// Where this is set, as by `.ci/run`, no test skips.
const MUST_RUN: &str = "PIOLA_TESTS_MUST_RUN";

/// Whether the test can run.
///
/// # Panics
/// Where something is missing and every test must run.
#[track_caller]
fn can_run(is_there: bool, missing: &str, remedy: &str) -> bool {
    if !is_there {
        let must_run = std::env::var_os(MUST_RUN).is_some_and(|value| !value.is_empty());
        assert!(!must_run, "{missing}, and {MUST_RUN} is set: {remedy}");
        println!("skipped: {missing}: {remedy}");
    }
    is_there
}

/// Whether there is a C compiler.
#[allow(dead_code)] // Every test binary asks for its own part of this.
#[track_caller]
pub(crate) fn has_c_compiler() -> bool {
    let version = Command::new("cc").arg("--version").output();
    let is_there = version.is_ok_and(|output| output.status.success());
    can_run(is_there, "there is no C compiler `cc`", "install one, on Debian gcc and libc6-dev")
}

/// Whether processes can be started that share a run by MPI.
#[allow(dead_code)]
#[track_caller]
pub(crate) fn has_mpirun() -> bool {
    let version = Command::new("mpirun").arg("--version").output();
    let is_there = version.is_ok_and(|output| output.status.success());
    can_run(is_there, "there is no `mpirun`", "install one, on Debian openmpi-bin")
}

/// Memory of this process in KiB as the system tells, by the name of a line of its status: `VmRSS`.
#[allow(dead_code)]
#[track_caller]
pub(crate) fn memory_kib(name: &str) -> Option<u64> {
    let found = std::fs::read_to_string("/proc/self/status").ok().and_then(|status| {
        let line = status.lines().find(|line| line.split(':').next() == Some(name))?;
        line.split_whitespace().nth(1)?.parse().ok()
    });
    let missing = format!("/proc/self/status does not tell {name}");
    can_run(found.is_some(), &missing, "run on Linux, with /proc mounted");
    found
}
