//! What the program is measured against: ratios of times taken in turn in one process.
//!
//! `cargo bench --bench ratios` prints the tables of `docs/performance.md`; with names of sections
//! (`cargo bench --bench ratios -- assembly threads`) only those. Each row shows our number, the
//! other one, their ratio and the bar it is held to.

mod assembly;
mod clock;
mod compile;
mod families;
mod foreign;
mod growth;
mod hyperdual;
mod kernels;
mod machine;
mod memory;
mod memory_bound;
mod newton;
mod ours;
mod papers;
mod plain;
mod samples;
mod solve;
mod squares;
mod table;
mod threads;

/// A section: its name on the command line and what it measures.
type Section = (&'static str, fn());

const SECTIONS: [Section; 13] = [
    ("kernels", kernels::against_hyper_dual),
    ("squares", squares::run),
    ("foreign", kernels::against_foreign),
    ("papers", papers::run),
    ("assembly", assembly::run),
    ("families", families::run),
    ("threads", threads::run),
    ("bonds", memory_bound::run),
    ("newton", newton::run),
    ("solve", solve::run),
    ("memory", memory::run),
    ("compile", compile::run),
    ("growth", growth::run),
];

fn main() {
    // Cargo adds `--bench`; all that does not look like an option is the name of a section.
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let known = |name: &String| SECTIONS.iter().any(|(section, _)| section == name);
    if let Some(unknown) = wanted.iter().find(|name| !known(name)) {
        let names: Vec<&str> = SECTIONS.iter().map(|(name, _)| *name).collect();
        eprintln!("there is no section `{unknown}`: {}", names.join(", "));
        std::process::exit(2);
    }
    if std::env::var_os(memory::CHILD).is_some() {
        return memory::child();
    }
    machine::print();
    for (name, run) in SECTIONS {
        if wanted.is_empty() || wanted.iter().any(|w| w == name) {
            run();
        }
    }
}
