//! The machine at hand: measured once, and kept in the user's folder of caches.

use std::env;
use std::path::PathBuf;

use piola_runtime::machine::{Machine, Rates};

use super::Exit;
use crate::console;

/// What is known of this machine; measured in a second where nothing is.
pub(super) fn at_hand() -> Machine {
    Machine::kept_in(file().as_deref())
}

/// `piola info --machine`.
pub(super) fn show(renew: bool) -> Exit {
    let file = file();
    let kept = file.as_deref().filter(|_| !renew).and_then(Machine::read);
    let is_kept = kept.is_some();
    let machine = kept.unwrap_or_else(Machine::measured);
    let place = match &file {
        None => "not kept: neither XDG_CACHE_HOME nor HOME names a folder".to_string(),
        Some(file) if is_kept => format!("kept in {}", file.display()),
        Some(file) => match machine.keep_in(file) {
            Ok(()) => format!("measured now, and kept in {}", file.display()),
            Err(error) => format!("measured now, and not kept: {error}"),
        },
    };
    console::out(&console::printable(&describe(&machine, &place)));
    Exit::Done
}

/// `piola/machine.json` in the folder for caches; none where the user has no such folder.
fn file() -> Option<PathBuf> {
    // What is not absolute means nothing, as the XDG specification says.
    let folder = |name| env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let caches = folder("XDG_CACHE_HOME").or_else(|| Some(folder("HOME")?.join(".cache")))?;
    Some(caches.join("piola").join("machine.json"))
}

fn describe(machine: &Machine, place: &str) -> String {
    let Machine { processor, lanes, threads, one, all, factorisation, .. } = machine;
    let row = |name: &str, rate: fn(&Rates) -> f64, unit: &str, what: &str| {
        let [one, all] = [one, all].map(|rates| rate(rates) * 1e-9);
        format!("{name:<12}{one:>12.1}{all:>12.1}   {unit:<28}{what}\n")
    };
    let memory = row("memory", |r| r.bandwidth, "GB/s", "through a triad beyond the caches");
    let arithmetic = row(
        "arithmetic",
        |r| r.arithmetic,
        "1e9 multiply-adds per s",
        "in registers, the most there is",
    );
    let factorisation = format!(
        "{:<12}{:>12.1}{:>12}   {:<28}of a dense Cholesky factorisation\n",
        "factorising",
        factorisation * 1e-9,
        "",
        "1e9 operations per s"
    );
    let all = if *threads == 1 { "1 thread".to_string() } else { format!("{threads} threads") };
    format!(
        "{processor}; {all}, registers of {lanes} numbers\n\n{:<12}{:>12}{all:>12}\n\
         {memory}{arithmetic}{factorisation}\n{place}\n`piola info --machine --renew` measures again\n",
        "", "1 thread"
    )
}
