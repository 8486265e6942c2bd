//! What the program is measured against: times taken in turn in one process, beside each other.
//!
//! `cargo bench --bench ratios` measures everything, writes `docs/measured/ratios.json` and renders the
//! tables of the documents from it; with names of sections (`cargo bench --bench ratios -- assembly
//! threads`) it measures those and leaves the others as they were recorded, and with `render` it measures
//! nothing.

mod assembly;
mod bar;
mod breaking;
mod clock;
mod compile;
mod families;
mod forces;
mod foreign;
mod forms;
mod gradients;
mod growth;
mod hyperdual;
mod kernels;
mod laws;
mod levels;
mod machine;
mod materials;
mod memory;
mod memory_bound;
mod motion;
mod newton;
mod ours;
mod papers;
mod plain;
mod preconditioners;
mod record;
mod samples;
mod solve;
mod squares;
mod table;
mod tensors;
mod texts;
mod threads;

use std::path::Path;

use record::{DOCUMENTS, PATH, Record, Section, Table};

/// The word that asks for documents only.
const RENDER: &str = "render";

/// A section: its name on the command line and what it measures.
type Measurement = (&'static str, fn() -> Vec<Table>);

const SECTIONS: [Measurement; 24] = [
    ("kernels", kernels::against_hyper_dual),
    ("squares", squares::run),
    ("foreign", kernels::against_foreign),
    ("forms", forms::run),
    ("laws", laws::run),
    ("levels", levels::run),
    ("gradients", gradients::run),
    ("compile", compile::run),
    ("papers", papers::run),
    ("assembly", assembly::run),
    ("forces", forces::run),
    ("families", families::run),
    ("texts", texts::run),
    ("materials", materials::run),
    ("motion", motion::run),
    ("breaking", breaking::run),
    ("threads", threads::run),
    ("bonds", memory_bound::run),
    ("newton", newton::run),
    ("solve", solve::run),
    ("preconditioners", preconditioners::run),
    ("bar", bar::run),
    ("memory", memory::run),
    ("growth", growth::run),
];

fn main() {
    if std::env::var_os(memory::CHILD).is_some() {
        return memory::child();
    }
    // Cargo adds `--bench`; all that does not look like an option is a word of ours.
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let known =
        |word: &String| word == RENDER || SECTIONS.iter().any(|(section, _)| section == word);
    if let Some(unknown) = words.iter().find(|word| !known(word)) {
        let names: Vec<&str> = SECTIONS.iter().map(|(name, _)| *name).collect();
        eprintln!("there is no section `{unknown}`: {}, or `{RENDER}`", names.join(", "));
        std::process::exit(2);
    }
    let circumstances = machine::circumstances();
    for (name, run) in SECTIONS {
        if words.is_empty() || words.iter().any(|word| word == name) {
            let tables = run();
            for table in &tables {
                println!("\n### {}\n\n{}", table.name, table.text());
            }
            let circumstances = circumstances.clone();
            // After each section, so that an end before the last one loses nothing.
            put(name, Section { circumstances, tables });
        }
    }
    render();
}

/// Writes a section into the record, in the place of what was measured before.
fn put(name: &str, section: Section) {
    let mut record = read();
    record.sections.insert(name.into(), section);
    record.sections.retain(|name, _| SECTIONS.iter().any(|(section, _)| section == name));
    let text = serde_json::to_string_pretty(&record).expect("numbers and texts");
    std::fs::write(root().join(PATH), text + "\n").expect("the record can be written");
}

fn read() -> Record {
    match std::fs::read_to_string(root().join(PATH)) {
        Ok(text) => serde_json::from_str(&text).expect("the record is as it was written"),
        Err(_) => Record::default(),
    }
}

/// Renders the tables of all documents.
fn render() {
    let record = read();
    for document in DOCUMENTS {
        let path = root().join(document);
        let text = std::fs::read_to_string(&path).expect("the document is there");
        match record.render(&text) {
            Ok(rendered) => std::fs::write(path, rendered).expect("it can be written"),
            Err(error) => eprintln!("{document} stays as it is: {error}"),
        }
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}
