//! Figures of the papers, drawn by this program: Figs. 8 and 9 of javili2020, Figs. 13 and 14 and the
//! checkerboard of partmann2026. What they show is said in `examples/README.md`.
//!
//! ```text
//! cargo run --release --example figures -- out/figures                 # all
//! cargo run --release --example figures -- out/figures checkerboard    # some, by name
//! ```

mod checkerboard;
mod poisson;
#[cfg(test)]
mod tests;
mod traction;

use std::fmt::Write as _;
use std::path::Path;

use piola_runtime::case::{Case, Library};
use piola_runtime::output::OutputError;
use piola_runtime::output::atomic::write_atomically;
use piola_runtime::output::picture::{LogarithmicPanel, LogarithmicPlot};

/// A panel with its lines: name, and value against value.
pub(crate) struct Panel {
    pub(crate) title: &'static str,
    pub(crate) x: &'static str,
    pub(crate) y: &'static str,
    pub(crate) lines: Vec<Line>,
}

/// A name, and values with what was found there; signs are kept here, and lost in the picture.
pub(crate) type Line = (String, Vec<(f64, f64)>);

/// All figures by name.
const FIGURES: [&str; 3] = ["checkerboard", "poisson", "traction"];

fn main() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().map_or("out/figures", String::as_str));
    let wanted = arguments.get(1..).unwrap_or_default();
    if let Some(unknown) = wanted.iter().find(|name| !FIGURES.contains(&name.as_str())) {
        return Err(format!("there is no figure `{unknown}`: {}", FIGURES.join(", ")));
    }
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for name in FIGURES {
        if !wanted.is_empty() && !wanted.iter().any(|w| w == name) {
            continue;
        }
        match name {
            "checkerboard" => {
                let (picture, table) = checkerboard::slices()?;
                write(folder, name, table, picture.to_svg(), picture.to_png())?;
            }
            "poisson" => {
                let title = "How far Poisson's ratio is from its limit";
                draw(folder, name, title, poisson::panels()?)?;
            }
            _ => {
                let title = "A bar under tension: error of its elongation";
                draw(folder, name, title, traction::panels()?)?;
            }
        }
    }
    Ok(())
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
    write(folder, name, table, picture.to_svg(), picture.to_png())
}

fn write(
    folder: &Path,
    name: &str,
    table: String,
    svg: String,
    png: Result<Vec<u8>, OutputError>,
) -> Result<(), String> {
    let files = [
        (format!("{name}.csv"), table.into_bytes()),
        (format!("{name}.svg"), svg.into_bytes()),
        (format!("{name}.png"), png.map_err(|error| error.to_string())?),
    ];
    for (name, content) in files {
        write_atomically(&folder.join(name), |file| file.write_all(&content))
            .map_err(|error| error.to_string())?;
    }
    Ok(())
}
