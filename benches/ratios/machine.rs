//! What the tables were measured with.

use std::process::Command;

/// Prints processors, vector instructions and compilers.
pub(crate) fn print() {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    println!(
        "{processors} processor(s), {}, with {}; {}; {}.",
        std::env::consts::ARCH,
        vectors().join(", "),
        first_line("rustc"),
        first_line("cc")
    );
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

fn first_line(compiler: &str) -> String {
    let output = Command::new(compiler).arg("--version").output();
    let text = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    match text.ok().and_then(|text| text.lines().next().map(str::to_string)) {
        Some(line) => line,
        None => format!("no {compiler}"),
    }
}
