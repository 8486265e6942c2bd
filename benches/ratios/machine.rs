//! What the tables were measured with.

use std::process::Command;

use crate::record::Circumstances;

/// Of this checkout, now, on this machine.
pub(crate) fn circumstances() -> Circumstances {
    let root = env!("CARGO_MANIFEST_DIR");
    Circumstances {
        commit: commit(root).unwrap_or_else(|| "unknown".into()),
        date: said("date", &["-u", "+%Y-%m-%d"]).unwrap_or_else(|| "unknown".into()),
        processor: processor().unwrap_or_else(|| std::env::consts::ARCH.into()),
        processors: std::thread::available_parallelism().map_or(1, usize::from),
        vectors: vectors().into_iter().map(str::to_string).collect(),
        compilers: ["rustc", "cc", "clang"]
            .into_iter()
            .filter_map(|compiler| said(compiler, &["--version"]))
            .collect(),
    }
}

/// The commit, with a word where anything but documents and this record was changed since.
fn commit(root: &str) -> Option<String> {
    let commit = said("git", &["-C", root, "rev-parse", "--short=10", "HEAD"])?;
    let changed =
        said("git", &["-C", root, "status", "--porcelain", "--", ".", ":!docs", ":!*.md"]);
    Some(if changed.is_some() { format!("{commit}, changed") } else { commit })
}

/// The first line that a program prints.
fn said(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.lines().next().map(|line| line.trim().to_string())
}

/// What Linux calls the processor.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_string())
}

#[cfg(target_arch = "x86_64")]
fn vectors() -> Vec<&'static str> {
    let known = [
        ("SSE2", true),
        ("AVX2", std::is_x86_feature_detected!("avx2")),
        ("FMA", std::is_x86_feature_detected!("fma")),
        ("AVX-512", std::is_x86_feature_detected!("avx512f")),
    ];
    known.into_iter().filter(|(_, here)| *here).map(|(name, _)| name).collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn vectors() -> Vec<&'static str> {
    vec!["vectors of 128 bits"]
}
