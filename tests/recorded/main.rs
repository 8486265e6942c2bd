//! What piola says, recorded: its messages for wrong programs, and every stage from an energy to
//! machine code.
//!
//! `PIOLA_BLESS=1 cargo test --release --test recorded` records what it says now.

#[path = "../support/mod.rs"]
mod support;

mod codes;
mod diagnostics;
mod stages;

use std::path::{Path, PathBuf};

/// A folder of recordings.
fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recorded").join(name)
}

/// Compares with the recording, or renews it.
#[track_caller]
fn compare(recording: &Path, found: &str) {
    if std::env::var_os("PIOLA_BLESS").is_some() {
        std::fs::write(recording, found).unwrap();
        return;
    }
    let recorded = std::fs::read_to_string(recording).unwrap_or_default();
    assert!(recorded == found, "{} says\n{recorded}\nbut piola says\n{found}", recording.display());
}
