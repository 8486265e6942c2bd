//! Figures of the papers, drawn by this program: Figs. 8 and 9 of javili2020, Figs. 13 and 14 of
//! partmann2026. What they show is said in `examples/README.md`.
//!
//! ```text
//! cargo run --release --example figures -- out/figures
//! ```

mod poisson;
#[cfg(test)]
mod tests;
mod traction;

use std::fmt::Write as _;
use std::path::Path;

use piola_runtime::output::atomic::write_atomically;
use piola_runtime::output::picture::{LogarithmicPanel, LogarithmicPlot};
use piola_runtime::simulation::{Case, Library};

/// A panel with its lines: name, and value against value.
pub(crate) struct Panel {
    pub(crate) title: &'static str,
    pub(crate) x: &'static str,
    pub(crate) y: &'static str,
    pub(crate) lines: Vec<Line>,
}

/// A name, and values with what was found there; signs are kept here, and lost in the picture.
pub(crate) type Line = (String, Vec<(f64, f64)>);

fn main() -> Result<(), String> {
    let folder = std::env::args().nth(1).unwrap_or("out/figures".to_string());
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    draw(folder, "poisson", "How far Poisson's ratio is from its limit", poisson::panels()?)?;
    draw(folder, "traction", "A bar under tension: error of its elongation", traction::panels()?)
}

/// A case of this folder.
pub(crate) fn case(name: &str, overrides: &[String]) -> Result<Case, String> {
    let potentials: [(&str, &'static str); 4] = [
        ("javili2020", include_str!("../../potentials/javili2020.piola")),
        ("silling2000", include_str!("../../potentials/silling2000.piola")),
        (
            "linear_peridynamic_solid",
            include_str!("../../potentials/linear_peridynamic_solid.piola"),
        ),
        ("st_venant_kirchhoff", include_str!("../../potentials/st_venant_kirchhoff.piola")),
    ];
    let find = |name: &str| potentials.iter().find(|(known, _)| *known == name).map(|p| p.1);
    let names = potentials.map(|(name, _)| name);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/figures").join(name);
    Case::read(&path, overrides, &Library { find: &find, names: &names })
        .map_err(|error| error.to_string())
}

/// Writes `NAME.csv`, `.svg` and `.png`, and prints the numbers.
fn draw(folder: &Path, name: &str, title: &str, panels: Vec<Panel>) -> Result<(), String> {
    let mut table = String::from("panel,line,x,y\n");
    for panel in &panels {
        println!("{}: {} against {}", panel.title, panel.y, panel.x);
        for (line, points) in &panel.lines {
            for (x, y) in points {
                println!("  {line:<28} {x:>10.4e} {y:>+13.6e}");
                let _ = writeln!(table, "{},\"{line}\",{x:e},{y:e}", panel.title);
            }
        }
    }
    let picture = LogarithmicPlot {
        title: title.to_string(),
        panels: panels
            .into_iter()
            .map(|Panel { title, x, y, lines }| LogarithmicPanel {
                title: title.to_string(),
                x,
                y,
                lines: lines
                    .into_iter()
                    .map(|(name, points)| {
                        (name, points.into_iter().map(|(x, y)| (x, y.abs())).collect())
                    })
                    .collect(),
            })
            .collect(),
    };
    let files = [
        (format!("{name}.csv"), table.into_bytes()),
        (format!("{name}.svg"), picture.to_svg().into_bytes()),
        (format!("{name}.png"), picture.to_png().map_err(|error| error.to_string())?),
    ];
    for (name, content) in files {
        write_atomically(&folder.join(name), |file| file.write_all(&content))
            .map_err(|error| error.to_string())?;
    }
    Ok(())
}
