//! How many digits of a derivative are right, by the way it is computed.
//!
//! Fig. 12 of firooz2023, and beside it errors that its energy does not show: those near rest. What
//! comes out is discussed in `examples/README.md`.
//!
//! ```text
//! cargo run --release --example differentiation -- out/differentiation
//! ```

mod methods;
mod numbers;
mod study;
#[cfg(test)]
mod tests;

use std::fmt::Write as _;
use std::path::Path;

use piola_runtime::output::atomic::write_atomically;
use piola_runtime::output::picture::{LogarithmicPanel, LogarithmicPlot};

use study::{Line, Panel};

/// Smaller steps are in the table only: to the eye nothing happens there.
const LEAST_DRAWN: f64 = 0.9e-20;

/// Larger errors are drawn so: no digit is right.
const LARGEST_DRAWN: f64 = 1.0;

fn main() -> Result<(), String> {
    let folder = std::env::args().nth(1).unwrap_or("out/differentiation".to_string());
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let panels = study::panels()?;
    let picture = picture(&panels);
    let files = [
        ("differentiation.svg", picture.to_svg().into_bytes()),
        ("differentiation.png", picture.to_png().map_err(|error| error.to_string())?),
        ("differentiation.csv", table(&panels).into_bytes()),
    ];
    for (name, content) in files {
        write_atomically(&folder.join(name), |file| file.write_all(&content))
            .map_err(|error| error.to_string())?;
    }
    print!("{}", summary(&panels));
    Ok(())
}

/// Every error, one a line.
fn table(panels: &[Panel]) -> String {
    let mut out = String::from("derivative,method,against,value,median_relative_error\n");
    for Panel { title, x, lines } in panels {
        for Line { name, errors } in lines {
            for (value, error) in errors {
                let _ = writeln!(out, "{title},\"{name}\",{x},{value:e},{error:e}");
            }
        }
    }
    out
}

/// The least error of every line and where it is.
fn summary(panels: &[Panel]) -> String {
    let mut out = String::new();
    for Panel { title, x, lines } in panels {
        let _ = writeln!(out, "{title:<26} {:>8}  at {x}", "error");
        for line in lines {
            let (error, value) = line.best();
            let _ = writeln!(out, "  {:<24} {error:>8.1e}  {value:.0e}", line.name);
        }
    }
    out
}

fn picture(panels: &[Panel]) -> LogarithmicPlot {
    let drawn = |line: &Line| {
        let errors = line.errors.iter().filter(|(x, _)| *x > LEAST_DRAWN);
        let errors = errors.map(|&(x, error)| (x, error.min(LARGEST_DRAWN)));
        (line.name.to_string(), errors.collect())
    };
    let panel = |panel: &Panel| LogarithmicPanel {
        title: panel.title.to_string(),
        x: panel.x,
        y: "median relative error",
        lines: panel.lines.iter().map(drawn).collect(),
    };
    LogarithmicPlot {
        title: "Ways to differentiate 1/2*C1*L*ln(l/L), and near rest 1/2*C1*L*S^2 with n = −1/2"
            .to_string(),
        panels: panels.iter().map(panel).collect(),
    }
}
