//! Frames and their list read back: the inverse of `runtime/output/src/vtu.rs` and `pvd.rs`, written
//! from the format, which never trusts the lengths that a file claims.
#![allow(dead_code)] // Every test binary uses its own part of this.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

/// The code of a vertex among VTK's cell types.
const VERTEX: u8 = 1;

/// A frame read back.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct VtuFile {
    /// Load parameter.
    pub(crate) t: f64,
    /// Reference positions, `n x 3`, in m.
    pub(crate) positions: Vec<f64>,
    /// Point arrays in the order of the file.
    pub(crate) arrays: Vec<VtuArray>,
}

/// One array over the points of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct VtuArray {
    /// Its name.
    pub(crate) name: String,
    /// Numbers per point: 3 for vectors, 1 for scalars.
    pub(crate) components: usize,
    /// `n x components`, row by row.
    pub(crate) values: Vec<f64>,
}

impl VtuFile {
    /// The array of this name.
    pub(crate) fn array(&self, name: &str) -> Option<&VtuArray> {
        self.arrays.iter().find(|array| array.name == name)
    }
}

/// Reads a frame written by piola, checking every length and the cells.
pub(crate) fn read_vtu(path: &Path) -> Result<VtuFile, String> {
    decode_vtu(&std::fs::read(path).map_err(|error| error.to_string())?)
}

/// The frame with this number in the folder of a run, whole or in pieces.
pub(crate) fn read_frame(folder: &Path, number: usize) -> Result<VtuFile, String> {
    let frames = folder.join("frames");
    match frames.join(format!("frame_{number:06}.pvtu")) {
        pieces if pieces.is_file() => read_pvtu(&pieces),
        _ => read_vtu(&frames.join(format!("frame_{number:06}.vtu"))),
    }
}

/// The same of a frame in pieces: each number of every point from the piece that is named last.
fn read_pvtu(path: &Path) -> Result<VtuFile, String> {
    let list = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
    let names = list.split("Source=\"").skip(1).filter_map(|rest| Some(rest.split_once('"')?.0));
    let mut whole: Option<VtuFile> = None;
    for name in names {
        let piece = read_vtu(&path.with_file_name(name))?;
        let numbers = piece.array("point").ok_or_else(|| wrong("a piece without numbers"))?;
        let numbers = numbers.values.iter().map(|number| *number as usize).collect::<Vec<_>>();
        let n = numbers.iter().max().map_or(0, |most| most + 1);
        let whole = whole.get_or_insert_with(|| {
            let empty = |array: &VtuArray| VtuArray { values: Vec::new(), ..array.clone() };
            let arrays = piece.arrays.iter().map(empty).collect();
            VtuFile { t: piece.t, positions: Vec::new(), arrays }
        });
        put(&mut whole.positions, &piece.positions, 3, (&numbers, n));
        let fresh = whole.arrays.iter_mut().zip(&piece.arrays);
        for (array, given) in fresh {
            if (&array.name, array.components) != (&given.name, given.components) {
                return Err(wrong("pieces of other arrays"));
            }
            put(&mut array.values, &given.values, given.components, (&numbers, n));
        }
    }
    let mut whole = whole.ok_or_else(|| wrong("no pieces"))?;
    whole.arrays.retain(|array| array.name != "point");
    Ok(whole)
}

fn put(all: &mut Vec<f64>, rows: &[f64], width: usize, (numbers, n): (&[usize], usize)) {
    all.resize(all.len().max(n * width), f64::NAN);
    for (row, number) in rows.chunks_exact(width).zip(numbers) {
        all[number * width..(number + 1) * width].copy_from_slice(row);
    }
}

/// The inverse of what writes frames (two-dimensional vectors stay padded).
pub(crate) fn decode_vtu(bytes: &[u8]) -> Result<VtuFile, String> {
    const START: &[u8] = b"<AppendedData encoding=\"raw\">\n_";
    const END: &[u8] = b"\n</AppendedData>\n</VTKFile>\n";
    let start = bytes
        .windows(START.len())
        .position(|window| window == START)
        .ok_or_else(|| wrong("there is no appended data"))?;
    let header = std::str::from_utf8(&bytes[..start]).map_err(|_| wrong("header not UTF-8"))?;
    let appended = bytes[start + START.len()..]
        .strip_suffix(END)
        .ok_or_else(|| wrong("the end of the file is missing"))?;

    let piece = tag(header, "<Piece ").ok_or_else(|| wrong("there is no piece"))?;
    let n: usize = number(piece.0.get("NumberOfPoints"), "NumberOfPoints")?;
    let n_cells: usize = number(piece.0.get("NumberOfCells"), "NumberOfCells")?;
    let after_time = header.split_once("Name=\"TimeValue\"").map(|(_, rest)| rest);
    let time = after_time.and_then(|rest| rest.split_once('>')?.1.split_once('<'));
    let t = number(time.map(|(text, _)| text.to_owned()).as_ref(), "TimeValue")?;

    let mut file = VtuFile { t, positions: Vec::new(), arrays: Vec::new() };
    let mut rest = piece.1;
    let mut cells: HashMap<String, Vec<u8>> = HashMap::new();
    while let Some((attributes, after)) = tag(rest, "<DataArray ") {
        rest = after;
        let name = attributes.get("Name").map(|name| unescape(name)).unwrap_or_default();
        let components: usize = number(attributes.get("NumberOfComponents"), "NumberOfComponents")?;
        let offset: usize = number(attributes.get("offset"), "offset")?;
        let raw = inflate(appended, offset)?;
        let kind = attributes.get("type").map(String::as_str).unwrap_or_default();
        let size = if kind == "UInt8" { 1 } else { 8 };
        let expected = n.checked_mul(components).and_then(|count| count.checked_mul(size));
        if kind == "Float64" && expected != Some(raw.len()) {
            return Err(wrong(format!("`{name}` has {} bytes for {n} points", raw.len())));
        }
        match (kind, name.as_str()) {
            ("Float64", "Points") if components == 3 => file.positions = floats(&raw),
            ("Float64", _) => file.arrays.push(VtuArray { name, components, values: floats(&raw) }),
            _ => {
                cells.insert(name, raw);
            }
        }
    }
    if file.positions.len() != 3 * n {
        return Err(wrong("the points are missing"));
    }
    check_cells(&cells, n, n_cells, file.array("point").is_some())?;
    Ok(file)
}

fn wrong(reason: impl std::fmt::Display) -> String {
    format!("not a whole piola frame: {reason}")
}

/// The cells must be vertices 0, 1, .. n-1, of a piece of its own points, and then quadrilaterals or hexahedra of
/// different points.
fn check_cells(
    cells: &HashMap<String, Vec<u8>>,
    n: usize,
    n_cells: usize,
    is_piece: bool,
) -> Result<(), String> {
    let array = |name: &str| {
        cells.get(name).ok_or_else(|| wrong(format!("the array `{name}` of cells is missing")))
    };
    let integers = |name: &str| -> Result<Vec<usize>, String> {
        let words = array(name)?.chunks(8).map(|chunk| chunk.try_into().ok());
        let words = words.collect::<Option<Vec<[u8; 8]>>>();
        let words = words.ok_or_else(|| wrong(format!("`{name}` is cut")))?;
        Ok(words.into_iter().map(|word| i64::from_le_bytes(word) as usize).collect())
    };
    let (points, ends, kinds) = (integers("connectivity")?, integers("offsets")?, array("types")?);
    let n_vertices = match is_piece {
        true => kinds.iter().take_while(|kind| **kind == VERTEX).count(),
        false => n,
    };
    if cells.len() != 3 || ends.len() != n_cells || kinds.len() != n_cells || n_cells < n_vertices {
        return Err(wrong("there must be a cell for each point at least"));
    }
    let mut start = 0;
    for (cell, (end, kind)) in ends.iter().zip(kinds).enumerate() {
        let own = points.get(start..*end).ok_or_else(|| wrong("a cell has no points"))?;
        let is_right = match (cell < n_vertices, kind) {
            (true, &VERTEX) => own == [cell],
            (false, 9) => own.len() == 4,
            (false, 12) => own.len() == 8,
            _ => false,
        };
        let differ = (1..own.len()).all(|k| !own[..k].contains(&own[k]));
        if !(is_right && differ && own.iter().all(|point| *point < n)) {
            return Err(wrong(format!("cell {cell} of kind {kind} has the points {own:?}")));
        }
        start = *end;
    }
    if start == points.len() { Ok(()) } else { Err(wrong("there are points of no cell")) }
}

/// The attributes of the first element that starts with `opening`, and the text after it.
fn tag<'a>(text: &'a str, opening: &str) -> Option<(HashMap<String, String>, &'a str)> {
    let (_, after) = text.split_once(opening)?;
    let (inside, rest) = after.split_once('>')?;
    let mut attributes = HashMap::new();
    let mut inside = inside;
    while let Some((name, after_name)) = inside.split_once("=\"") {
        let (value, after_value) = after_name.split_once('"')?;
        attributes.insert(name.trim().to_owned(), value.to_owned());
        inside = after_value;
    }
    Some((attributes, rest))
}

fn number<T: std::str::FromStr>(text: Option<&String>, name: &str) -> Result<T, String> {
    text.and_then(|text| text.trim().parse().ok())
        .ok_or_else(|| wrong(format!("`{name}` is missing or not a number")))
}

fn floats(raw: &[u8]) -> Vec<f64> {
    let word = |chunk: &[u8]| f64::from_le_bytes(chunk.try_into().expect("chunks of eight bytes"));
    raw.chunks_exact(8).map(word).collect()
}

/// Undoes the compression for the array that starts at `offset`.
fn inflate(appended: &[u8], offset: usize) -> Result<Vec<u8>, String> {
    let mut at = offset;
    let mut word = || {
        let bytes = at.checked_add(8).and_then(|end| appended.get(at..end));
        at = at.saturating_add(8);
        let bytes = bytes.ok_or_else(|| wrong("an array is cut short"))?;
        let word = u64::from_le_bytes(bytes.try_into().expect("eight bytes"));
        usize::try_from(word).map_err(|_| wrong("a length is out of range"))
    };
    let (n_blocks, block, last) = (word()?, word()?, word()?);
    let mut sizes = Vec::new(); // grows only as far as the file has words
    for _ in 0..n_blocks {
        sizes.push(word()?);
    }
    let mut out = Vec::new();
    for (index, size) in sizes.iter().enumerate() {
        let is_last = index + 1 == n_blocks;
        let expected = if is_last && last != 0 { last } else { block };
        let end = at.checked_add(*size);
        let compressed = end.and_then(|end| appended.get(at..end));
        let compressed = compressed.ok_or_else(|| wrong("an array is cut short"))?;
        let before = out.len();
        ZlibDecoder::new(compressed)
            .take(expected as u64 + 1)
            .read_to_end(&mut out)
            .map_err(|error| wrong(format!("a block does not inflate: {error}")))?;
        if out.len() - before != expected {
            return Err(wrong("a block has the wrong length"));
        }
        at += size;
    }
    Ok(out)
}

fn unescape(text: &str) -> String {
    let text = text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"");
    text.replace("&amp;", "&")
}

/// Times and relative paths of the frames that a `run.pvd` written by piola lists.
///
/// `None` if the text is not a whole list.
pub(crate) fn read_pvd(text: &str) -> Option<Vec<(f64, String)>> {
    let (_, body) = text.split_once("<Collection>\n")?;
    let body = body.strip_suffix("</Collection>\n</VTKFile>\n")?;
    let entry = |line: &str| {
        let attribute = |name: &str| {
            let (_, value) = line.split_once(&format!("{name}=\""))?;
            Some(value.split_once('"')?.0.to_owned())
        };
        Some((attribute("timestep")?.parse().ok()?, attribute("file")?))
    };
    body.lines().map(entry).collect()
}
