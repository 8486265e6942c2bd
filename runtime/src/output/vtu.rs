//! Frames as `.vtu` files: VTK's unstructured grid with one vertex cell per point.
//!
//! The format is VTK XML with raw appended data, little endian, `UInt64` headers, zlib blocks
//! (docs.vtk.org, "VTK XML file formats"). Points stand at their reference positions and carry
//! `displacement`, so that ParaView's *Warp By Vector* shows the deformed body; two-dimensional
//! vectors are padded with zero. Numbers are stored as `f64` bit for bit.
//!
//! [`read_vtu`] reads exactly what [`encode_vtu`] writes; it is for tests and for users who want
//! to check a frame without VTK, and it never trusts the lengths that a file claims.

use std::collections::HashMap;
use std::fs;
use std::io::{Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;

use super::{Frame, OutputError, Points, atomic::Operation, decimal};

/// Uncompressed bytes per zlib block: small enough to compress blocks on all threads.
const BLOCK: usize = 1 << 18;

/// The code of a vertex among VTK's cell types.
const VTK_VERTEX: u8 = 1;

/// A frame as the bytes of a `.vtu` file.
///
/// Point arrays: `displacement` (m), `residual` (N), `volume` (m^d) and the frame's scalars.
pub fn encode_vtu(points: &Points, frame: &Frame) -> Vec<u8> {
    let n = points.n_points();
    let d = points.dimension;
    let mut appended = Appended::default();
    let mut point_data = String::new();
    let mut add = |name: &str, values: &[f64], components: usize| {
        let width = if components > 1 { 3 } else { 1 };
        let bytes = float_bytes(&padded(values, components, width));
        point_data.push_str(&appended.array("Float64", name, width, &bytes));
    };
    add("displacement", &frame.displacement, d);
    add("residual", &frame.residual, d);
    add("volume", &points.volumes, 1);
    for (name, values) in &frame.scalars {
        add(name, values, 1);
    }
    let positions = float_bytes(&padded(&points.positions, d, 3));
    let positions = appended.array("Float64", "Points", 3, &positions);
    let connectivity = integer_bytes(0..n as i64);
    let connectivity = appended.array("Int64", "connectivity", 1, &connectivity);
    let offsets = integer_bytes(1..=n as i64);
    let offsets = appended.array("Int64", "offsets", 1, &offsets);
    let types = appended.array("UInt8", "types", 1, &vec![VTK_VERTEX; n]);
    let t = decimal(frame.t);

    let mut out = format!(
        r#"<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor">
<UnstructuredGrid>
<FieldData>
<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">{t}</DataArray>
</FieldData>
<Piece NumberOfPoints="{n}" NumberOfCells="{n}">
<PointData Vectors="displacement">
{point_data}</PointData>
<Points>
{positions}</Points>
<Cells>
{connectivity}{offsets}{types}</Cells>
</Piece>
</UnstructuredGrid>
<AppendedData encoding="raw">
_"#
    )
    .into_bytes();
    out.extend_from_slice(&appended.bytes);
    out.extend_from_slice(b"\n</AppendedData>\n</VTKFile>\n");
    out
}

/// The appended section as it grows.
#[derive(Default)]
struct Appended {
    bytes: Vec<u8>,
}

impl Appended {
    /// Appends the compressed `raw` and returns the element that points at it.
    fn array(&mut self, kind: &str, name: &str, components: usize, raw: &[u8]) -> String {
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(&compress(raw));
        let name = escape(name);
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{offset}\"/>\n"
        )
    }
}

/// `[blocks][block size][size of the last block if partial][compressed sizes..]`, then the blocks.
fn compress(raw: &[u8]) -> Vec<u8> {
    // The blocks are compressed in parallel and joined in order: the same bytes on any number of
    // threads.
    let blocks: Vec<Vec<u8>> = raw
        .par_chunks(BLOCK)
        .map(|block| {
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(block).expect("writing to memory cannot fail");
            encoder.finish().expect("writing to memory cannot fail")
        })
        .collect();
    let mut header = vec![blocks.len() as u64, BLOCK as u64, (raw.len() % BLOCK) as u64];
    header.extend(blocks.iter().map(|block| block.len() as u64));
    let mut out: Vec<u8> = header.iter().flat_map(|word| word.to_le_bytes()).collect();
    out.extend(blocks.iter().flatten());
    out
}

/// Rows of `components` numbers, padded with zeros to `width`.
fn padded(values: &[f64], components: usize, width: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(values.len() / components.max(1) * width);
    for row in values.chunks_exact(components) {
        out.extend_from_slice(row);
        out.resize(out.len() + width - components, 0.0);
    }
    out
}

fn float_bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn integer_bytes(values: impl Iterator<Item = i64>) -> Vec<u8> {
    values.flat_map(i64::to_le_bytes).collect()
}

/// Text as it may stand inside an XML attribute; control characters, which XML 1.0 forbids, go.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => {}
            c => out.push(c),
        }
    }
    out
}

fn unescape(text: &str) -> String {
    let text = text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"");
    text.replace("&amp;", "&")
}

/// A frame read back.
#[derive(Clone, Debug, PartialEq)]
pub struct VtuFile {
    /// Load parameter.
    pub t: f64,
    /// Reference positions, `n x 3`, in m.
    pub positions: Vec<f64>,
    /// Point arrays in the order of the file.
    pub arrays: Vec<VtuArray>,
}

/// One array over the points of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct VtuArray {
    /// Its name.
    pub name: String,
    /// Numbers per point: 3 for vectors, 1 for scalars.
    pub components: usize,
    /// `n x components`, row by row.
    pub values: Vec<f64>,
}

impl VtuFile {
    /// The array of this name.
    pub fn array(&self, name: &str) -> Option<&VtuArray> {
        self.arrays.iter().find(|array| array.name == name)
    }
}

/// Why a file is not a frame written by piola, or not all of one.
#[derive(Debug, thiserror::Error)]
pub enum VtuError {
    /// The file could not be read.
    #[error(transparent)]
    Io(#[from] OutputError),
    /// The content is not what piola writes.
    #[error("not a whole piola frame: {0}")]
    Content(String),
}

fn content(reason: impl Into<String>) -> VtuError {
    VtuError::Content(reason.into())
}

/// Reads a frame written by piola, checking every length and the cells.
pub fn read_vtu(path: &Path) -> Result<VtuFile, VtuError> {
    let bytes = fs::read(path).map_err(Operation::Read.on(path))?;
    decode_vtu(&bytes)
}

/// The inverse of [`encode_vtu`] (two-dimensional vectors stay padded).
pub fn decode_vtu(bytes: &[u8]) -> Result<VtuFile, VtuError> {
    const START: &[u8] = b"<AppendedData encoding=\"raw\">\n_";
    const END: &[u8] = b"\n</AppendedData>\n</VTKFile>\n";
    let start = bytes
        .windows(START.len())
        .position(|window| window == START)
        .ok_or_else(|| content("there is no appended data"))?;
    let header = std::str::from_utf8(&bytes[..start]).map_err(|_| content("header not UTF-8"))?;
    let appended = bytes[start + START.len()..]
        .strip_suffix(END)
        .ok_or_else(|| content("the end of the file is missing"))?;

    let piece = tag(header, "<Piece ").ok_or_else(|| content("there is no piece"))?;
    let n: usize = number(piece.0.get("NumberOfPoints"), "NumberOfPoints")?;
    if number::<usize>(piece.0.get("NumberOfCells"), "NumberOfCells")? != n {
        return Err(content("there must be one cell per point"));
    }
    let after_time = header.split_once("Name=\"TimeValue\"").map(|(_, rest)| rest);
    let time = after_time.and_then(|rest| rest.split_once('>')?.1.split_once('<'));
    let t = number(time.map(|(text, _)| text.to_owned()).as_ref(), "TimeValue")?;

    let mut file = VtuFile { t, positions: Vec::new(), arrays: Vec::new() };
    let mut rest = piece.1;
    let mut cells_seen = 0;
    while let Some((attributes, after)) = tag(rest, "<DataArray ") {
        rest = after;
        let name = attributes.get("Name").map(|name| unescape(name)).unwrap_or_default();
        let components: usize = number(attributes.get("NumberOfComponents"), "NumberOfComponents")?;
        let offset: usize = number(attributes.get("offset"), "offset")?;
        let raw = inflate(appended, offset)?;
        let kind = attributes.get("type").map(String::as_str).unwrap_or_default();
        let size = if kind == "UInt8" { 1 } else { 8 };
        let expected = n.checked_mul(components).and_then(|count| count.checked_mul(size));
        if expected != Some(raw.len()) {
            return Err(content(format!("`{name}` has {} bytes for {n} points", raw.len())));
        }
        match (kind, name.as_str()) {
            ("Float64", "Points") if components == 3 => file.positions = floats(&raw),
            ("Float64", _) => file.arrays.push(VtuArray { name, components, values: floats(&raw) }),
            _ => {
                cells_seen += 1;
                check_cells(&name, &raw, n)?;
            }
        }
    }
    if cells_seen != 3 || file.positions.len() != 3 * n {
        return Err(content("the points or the cells are missing"));
    }
    Ok(file)
}

/// The cells must be vertices 0, 1, .. n-1.
fn check_cells(name: &str, raw: &[u8], n: usize) -> Result<(), VtuError> {
    let expected = match name {
        "connectivity" => integer_bytes(0..n as i64),
        "offsets" => integer_bytes(1..=n as i64),
        "types" => vec![VTK_VERTEX; n],
        _ => return Err(content(format!("unknown array `{name}`"))),
    };
    if raw == expected {
        Ok(())
    } else {
        Err(content(format!("`{name}` is not one vertex a point")))
    }
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

fn number<T: std::str::FromStr>(text: Option<&String>, name: &str) -> Result<T, VtuError> {
    text.and_then(|text| text.trim().parse().ok())
        .ok_or_else(|| content(format!("`{name}` is missing or not a number")))
}

fn floats(raw: &[u8]) -> Vec<f64> {
    let word = |chunk: &[u8]| f64::from_le_bytes(chunk.try_into().expect("chunks of eight bytes"));
    raw.chunks_exact(8).map(word).collect()
}

/// Undoes [`compress`] for the array that starts at `offset`.
fn inflate(appended: &[u8], offset: usize) -> Result<Vec<u8>, VtuError> {
    let mut at = offset;
    let mut word = || {
        let bytes = at.checked_add(8).and_then(|end| appended.get(at..end));
        at = at.saturating_add(8);
        let bytes = bytes.ok_or_else(|| content("an array is cut short"))?;
        let word = u64::from_le_bytes(bytes.try_into().expect("eight bytes"));
        usize::try_from(word).map_err(|_| content("a length is out of range"))
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
        let compressed = compressed.ok_or_else(|| content("an array is cut short"))?;
        let before = out.len();
        ZlibDecoder::new(compressed)
            .take(expected as u64 + 1)
            .read_to_end(&mut out)
            .map_err(|error| content(format!("a block does not inflate: {error}")))?;
        if out.len() - before != expected {
            return Err(content("a block has the wrong length"));
        }
        at += size;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n` points with values that use all bits, some of them special.
    fn sample(dimension: usize, n: usize) -> (Points, Frame) {
        let mut state = 42u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut many = |count: usize| (0..count).map(|_| next()).collect::<Vec<f64>>();
        let points =
            Points { dimension, positions: many(n * dimension), volumes: many(n), spacing: None };
        let mut frame = Frame {
            t: 0.1 + 0.2,
            displacement: many(n * dimension),
            residual: many(n * dimension),
            scalars: vec![("a \"<&>\" b".to_owned(), many(n))],
        };
        for (slot, special) in
            frame.residual.iter_mut().zip([f64::INFINITY, -0.0, f64::MIN_POSITIVE / 8.0])
        {
            *slot = special;
        }
        (points, frame)
    }

    fn check_round_trip(dimension: usize, n: usize) {
        let (points, frame) = sample(dimension, n);
        let file = decode_vtu(&encode_vtu(&points, &frame)).unwrap();
        assert_eq!(file.t.to_bits(), frame.t.to_bits());
        let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let expect_vectors = |values: &[f64], read: &[f64]| {
            assert_eq!(bits(&padded(values, dimension, 3)), bits(read));
        };
        expect_vectors(&points.positions, &file.positions);
        expect_vectors(&frame.displacement, &file.array("displacement").unwrap().values);
        expect_vectors(&frame.residual, &file.array("residual").unwrap().values);
        assert_eq!(bits(&file.array("volume").unwrap().values), bits(&points.volumes));
        let (name, values) = &frame.scalars[0];
        assert_eq!(bits(&file.array(name).unwrap().values), bits(values));
        assert_eq!(file.arrays.len(), 4);
    }

    #[test]
    fn frames_read_back_bit_for_bit() {
        check_round_trip(2, 7);
        check_round_trip(3, 1);
        // Several blocks with a partial last one, and exactly full blocks (BLOCK / 8 numbers).
        check_round_trip(2, 30_000);
        check_round_trip(3, BLOCK / 8);
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_number_of_threads() {
        let (points, frame) = sample(3, 50_000);
        let encode = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| encode_vtu(&points, &frame))
        };
        assert_eq!(encode(1), encode(3));
    }

    #[test]
    fn cut_or_damaged_files_are_errors_and_never_panics() {
        let (points, frame) = sample(2, 40);
        let bytes = encode_vtu(&points, &frame);
        for length in 0..bytes.len() {
            assert!(decode_vtu(&bytes[..length]).is_err(), "cut at {length}");
        }
        // Damage anywhere must not panic; damage to a length or a block must be noticed.
        for place in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[place] ^= 0x40;
            let _ = decode_vtu(&damaged);
        }
        let start = bytes.windows(2).position(|pair| pair == b"\n_").unwrap() + 2;
        for place in start..start + 32 {
            let mut damaged = bytes.clone();
            damaged[place] ^= 0x40;
            // The nominal block size of an array of one partial block is not used.
            if !(start + 8..start + 16).contains(&place) {
                assert!(decode_vtu(&damaged).is_err(), "damage at {place}");
            }
        }
    }
}
