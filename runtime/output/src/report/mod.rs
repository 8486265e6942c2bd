//! What a run left, on one page of HTML that needs nothing else: pictures, numbers, settings, and the body
//! to be turned around.
//!
//! | part of the page | from |
//! |---|---|
//! | picture | `picture.svg` or `picture.png`, the smaller |
//! | numbers of the run | `summary.json` |
//! | charts | the tables, at most [`MOST_ROWS`] rows of each |
//! | body | frames, as many points, evenly, and frames as [`MOST_BYTES`] hold, numbers in 65,535 steps |
//! | settings | `scene.resolved.toml` |

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};

use crate::OutputFile;
use crate::results::frame::{Array, read_faces};
use crate::results::{self, Results, ResultsError};

/// Rows of a table that the page has at most; of more every so many-th.
pub const MOST_ROWS: usize = 2000;

/// Points that the page shows at most; of more one of each cell of a grid.
pub const MOST_POINTS: usize = 20_000;

/// Bytes of the body at all times, before they are written as text.
pub const MOST_BYTES: usize = 2_000_000;

/// The largest number of a quantity in steps; the next stands for what is no number.
const STEPS: f64 = 65_534.0;

/// Writes the page of the run in a folder to a file, `report.html` in it if none is named. Gives the file.
///
/// # Errors
/// A folder without a run, files that cannot be read, a page that cannot be written.
pub fn write(folder: &Path, file: Option<&Path>, title: &str) -> Result<PathBuf, ResultsError> {
    let results = Results::open(folder)?;
    let page = page(&results, title)?;
    let file = file.map_or_else(|| folder.join(OutputFile::Report.name()), Path::to_owned);
    results::write(&file, page.as_bytes())?;
    Ok(file)
}

/// The page as text.
///
/// # Errors
/// Files that cannot be read.
pub fn page(results: &Results, title: &str) -> Result<String, ResultsError> {
    let mut tables = Vec::new();
    for file in [
        OutputFile::Reactions,
        OutputFile::Energy,
        OutputFile::Probes,
        OutputFile::Motion,
        OutputFile::Fracture,
    ] {
        // Without probes a table of them has times alone.
        let table = results.text(file)?;
        if let Some(table) =
            table.filter(|text| text.lines().next().is_some_and(|head| head.contains(',')))
        {
            tables.push(
                json!({ "name": file.name().trim_end_matches(".csv"), "text": thinned(&table) }),
            );
        }
    }
    let kinds = [(OutputFile::PictureSvg, "svg+xml"), (OutputFile::PicturePng, "png")];
    let pictures = kinds.into_iter().filter_map(|(file, kind)| {
        let bytes = fs::read(results.folder().join(file.name())).ok()?;
        Some((bytes.len(), format!("data:image/{kind};base64,{}", BASE64_STANDARD.encode(bytes))))
    });
    let picture = pictures.min_by_key(|(length, _)| *length).map(|(_, address)| address);
    let data = json!({
        "title": title,
        "summary": results.summary(),
        "tables": tables,
        "picture": picture,
        "scene": results.text(OutputFile::ResolvedScene)?,
        "body": body(results)?,
    });
    // Nothing in it may end the element that it stands in.
    let data = data.to_string().replace('<', "\\u003c");
    let escaped = title.replace('&', "&amp;").replace('<', "&lt;");
    // What was put in is not looked through again: the title is the first mark of the page, and comes last.
    let scripts =
        concat!(include_str!("charts.js"), include_str!("body.js"), include_str!("page.js"));
    Ok(include_str!("page.html")
        .replacen("DATA", &data, 1)
        .replacen("/* SCRIPT */", scripts, 1)
        .replacen("/* STYLE */", include_str!("page.css"), 1)
        .replacen("TITLE", &escaped, 1))
}

/// A table with its first and last rows and some between.
fn thinned(table: &str) -> String {
    let lines: Vec<&str> = table.lines().collect();
    let rows = lines.len().saturating_sub(1);
    if rows <= MOST_ROWS {
        return table.to_owned();
    }
    let kept = (0..MOST_ROWS).map(|k| lines[1 + k * (rows - 1) / (MOST_ROWS - 1)]);
    std::iter::once(lines[0]).chain(kept).collect::<Vec<&str>>().join("\n")
}

/// Points at all times; nothing where there are no frames.
fn body(results: &Results) -> Result<Value, ResultsError> {
    let frames = results.frames();
    let Some(last) = frames.last() else { return Ok(Value::Null) };
    let end = last.read()?;
    let n = end.positions.len() / 3;
    let shown = thinned_points(&end.positions);
    let bytes = 2 * shown.len() * (2 + end.arrays.len());
    let n_frames = (MOST_BYTES / bytes.max(1)).clamp(2, frames.len().max(2)).min(frames.len());
    // The first and the last, and some between.
    let chosen = (0..n_frames).map(|k| &frames[k * (frames.len() - 1) / (n_frames - 1).max(1)]);
    let mut times = Vec::new();
    let mut read = Vec::new();
    for frame in chosen {
        let found = frame.read()?;
        if found.positions.len() != end.positions.len() {
            return Err(ResultsError::Broken { path: frame.file.clone() });
        }
        times.push(frame.t);
        let of_shown = |array: Array| Array {
            values: rows_of(&shown, &array.values, array.components),
            ..array
        };
        read.push(found.arrays.into_iter().map(of_shown).collect::<Vec<Array>>());
    }
    let positions = rows_of(&shown, &end.positions, 3);
    let positions: Vec<u8> = positions.iter().flat_map(|x| (*x as f32).to_le_bytes()).collect();
    // Faces between points that are not shown are none.
    let faces = if shown.len() == n { read_faces(&last.file)? } else { Vec::new() };
    let faces: Vec<u8> = faces.iter().flatten().flat_map(|point| point.to_le_bytes()).collect();
    let moved = read.iter().map(|arrays| arrays[0].values.as_slice());
    Ok(json!({
        "dimension": results.dimension(),
        "faces": BASE64_STANDARD.encode(faces),
        "points": n,
        "shown": shown.len(),
        "frames": frames.len(),
        "times": times,
        "positions": BASE64_STANDARD.encode(positions),
        "moved": stepped(&moved.collect::<Vec<&[f64]>>()),
        "fields": fields(&read),
    }))
}

/// Of these points the numbers of an array, row by row.
fn rows_of(points: &[usize], values: &[f64], components: usize) -> Vec<f64> {
    points.iter().flat_map(|p| &values[p * components..][..components]).copied().collect()
}

/// What is known of points in all frames, by its sizes; displacements first.
fn fields(frames: &[Vec<Array>]) -> Vec<Value> {
    let names = frames.last().into_iter().flatten().map(|array| &array.name);
    let of = |name: &String| {
        // A field that a frame has not is none of all of them.
        let own = |arrays: &Vec<Array>| {
            let found = arrays.iter().find(|array| array.name == *name)?;
            Some(lengths(&found.values, found.components))
        };
        let sizes: Vec<Vec<f64>> = frames.iter().map(own).collect::<Option<_>>()?;
        let sizes: Vec<&[f64]> = sizes.iter().map(Vec::as_slice).collect();
        Some(json!({ "name": name, "values": stepped(&sizes) }))
    };
    names.filter_map(of).collect()
}

/// At most [`MOST_POINTS`] points, evenly over the body: one of each cell of a grid, that of its size.
fn thinned_points(positions: &[f64]) -> Vec<usize> {
    let rows: Vec<&[f64]> = positions.chunks_exact(3).collect();
    if rows.len() <= MOST_POINTS {
        return (0..rows.len()).collect();
    }
    let bound = |axis: usize, pick: fn(f64, f64) -> f64, from: f64| {
        rows.iter().map(|row| row[axis]).fold(from, pick)
    };
    let low = [0, 1, 2].map(|axis| bound(axis, f64::min, f64::INFINITY));
    let high = [0, 1, 2].map(|axis| bound(axis, f64::max, f64::NEG_INFINITY));
    let extents: Vec<f64> =
        low.iter().zip(high).map(|(low, high)| high - low).filter(|extent| *extent > 0.0).collect();
    let volume: f64 = extents.iter().product();
    let mut side = libm::pow(volume / MOST_POINTS as f64, 1.0 / extents.len().max(1) as f64);
    loop {
        let cell = |row: &[f64]| [0, 1, 2].map(|axis| ((row[axis] - low[axis]) / side) as u32);
        let mut cells = BTreeSet::new();
        let kept: Vec<usize> = (0..rows.len()).filter(|p| cells.insert(cell(rows[*p]))).collect();
        if kept.len() <= MOST_POINTS {
            return kept;
        }
        side *= 1.05;
    }
}

/// Of a vector or tensor of every point its size; a number stays.
fn lengths(values: &[f64], components: usize) -> Vec<f64> {
    match components {
        0 | 1 => values.to_vec(),
        _ => values
            .chunks_exact(components)
            .map(|row| libm::sqrt(row.iter().map(|x| x * x).sum::<f64>()))
            .collect(),
    }
}

/// Numbers in steps between the least and the greatest, 16 bits each.
fn stepped(frames: &[&[f64]]) -> Value {
    let finite = || frames.iter().copied().flatten().copied().filter(|x| x.is_finite());
    let low = finite().fold(f64::INFINITY, f64::min);
    let high = finite().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
    let scale = if high > low { STEPS / (high - low) } else { 0.0 };
    let step = |x: &f64| if x.is_finite() { ((x - low) * scale).round() as u16 } else { u16::MAX };
    let frame = |values: &&[f64]| {
        let bytes: Vec<u8> = values.iter().map(step).flat_map(u16::to_le_bytes).collect();
        BASE64_STANDARD.encode(bytes)
    };
    json!({ "low": low, "high": high, "frames": frames.iter().map(frame).collect::<Vec<String>>() })
}
