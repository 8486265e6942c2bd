//! Tables in the form of `docs/performance.md`.

/// What a ratio is held to.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Bar {
    /// At least the bar; better still the second number.
    AtLeast(f64, f64),
    /// At most the bar; better still the second number.
    AtMost(f64, f64),
    /// Nothing: shown for comparison.
    None,
}

impl Bar {
    fn text(self) -> String {
        match self {
            Bar::AtLeast(bar, stretch) => format!(">= {bar} ({stretch})"),
            Bar::AtMost(bar, stretch) => format!("<= {bar} ({stretch})"),
            Bar::None => String::new(),
        }
    }

    fn verdict(self, ratio: f64) -> &'static str {
        let (bar, stretch) = match self {
            Bar::AtLeast(bar, stretch) => (ratio >= bar, ratio >= stretch),
            Bar::AtMost(bar, stretch) => (ratio <= bar, ratio <= stretch),
            Bar::None => return "",
        };
        match (bar, stretch) {
            (_, true) => "stretch met",
            (true, false) => "met",
            (false, false) => "not met",
        }
    }
}

/// Prints a heading, a line that says how it was measured, and the head of a table. `ours` and
/// `theirs` name the two columns of numbers with their unit.
pub(crate) fn head(title: &str, how: &str, ours: &str, theirs: &str) {
    println!("\n### {title}\n\n{how}\n");
    println!("| what | {ours} | {theirs} | ratio | bar (stretch) | |");
    println!("|---|---|---|---|---|---|");
}

/// Prints a row.
pub(crate) fn row(what: &str, ours: f64, theirs: f64, ratio: f64, bar: Bar) {
    let verdict = bar.verdict(ratio);
    println!(
        "| {what} | {} | {} | {} | {} | {verdict} |",
        number(ours),
        number(theirs),
        number(ratio),
        bar.text()
    );
}

/// Three significant digits.
pub(crate) fn number(x: f64) -> String {
    if !x.is_finite() || x == 0.0 {
        return format!("{x}");
    }
    let digits = 2 - libm::floor(libm::log10(x.abs())) as i32;
    format!("{x:.*}", digits.clamp(0, 9) as usize)
}
