//! Frames read back from `.vtu` files of piola: points, displacements and what is known of points.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::ReportError;

/// What begins the arrays of a file, behind its header.
const START: &[u8] = b"<AppendedData encoding=\"raw\">\n_";

/// Most bytes of an array, unpacked.
const MOST_BYTES: u64 = 1 << 32;

/// An array over points.
pub(super) struct Array {
    pub(super) name: String,
    pub(super) components: usize,
    pub(super) values: Vec<f64>,
}

/// A frame.
pub(super) struct Read {
    pub(super) positions: Vec<f64>,
    /// Displacement first.
    pub(super) arrays: Vec<Array>,
}

/// The points of a frame and their arrays.
pub(super) fn read(path: &Path) -> Result<Read, ReportError> {
    let bytes = std::fs::read(path).map_err(|error| ReportError::unreadable(path, &error))?;
    decode(&bytes).ok_or_else(|| ReportError::Broken { path: path.to_owned() })
}

/// Corners of what is seen of the cells of a frame of so many points, four each; of a triangle the last twice.
pub(super) fn faces(path: &Path, n: usize) -> Result<Vec<[u32; 4]>, ReportError> {
    let bytes = std::fs::read(path).map_err(|error| ReportError::unreadable(path, &error))?;
    decode_faces(&bytes, n).ok_or_else(|| ReportError::Broken { path: path.to_owned() })
}

/// The header of a file, and its arrays.
fn halves(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let start = bytes.windows(START.len()).position(|window| window == START)?;
    Some((std::str::from_utf8(&bytes[..start]).ok()?, &bytes[start + START.len()..]))
}

/// What a header has between two tags.
fn between<'h>(header: &'h str, open: &str, close: &str) -> Option<&'h str> {
    Some(header.split_once(open)?.1.split_once(close)?.0)
}

fn decode(bytes: &[u8]) -> Option<Read> {
    let (header, appended) = halves(bytes)?;
    let arrays = |part: &str| -> Option<Vec<Array>> {
        part.split("<DataArray ").skip(1).map(|tag| array(tag, appended)).collect()
    };
    let positions = arrays(between(header, "<Points>", "</Points>")?)?.pop()?.values;
    let arrays = arrays(between(header, "<PointData", "</PointData>")?)?;
    let fits = |array: &Array| {
        array.components > 0 && array.values.len() * 3 == positions.len() * array.components
    };
    arrays.first().filter(|first| first.name == "displacement" && first.components == 3)?;
    arrays.iter().all(fits).then_some(Read { positions, arrays })
}

/// Faces of a cell by its corners, as VTK numbers them.
fn faces_of(kind: u8) -> &'static [[usize; 4]] {
    match kind {
        5 => &[[0, 1, 2, 2]],
        9 => &[[0, 1, 2, 3]],
        10 => &[[0, 2, 1, 1], [0, 1, 3, 3], [1, 2, 3, 3], [0, 3, 2, 2]],
        12 => &[[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
        13 => &[[0, 1, 2, 2], [3, 5, 4, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]],
        14 => &[[0, 3, 2, 1], [0, 1, 4, 4], [1, 2, 4, 4], [2, 3, 4, 4], [3, 0, 4, 4]],
        _ => &[],
    }
}

/// The faces of all cells but those between two of them.
fn decode_faces(bytes: &[u8], n: usize) -> Option<Vec<[u32; 4]>> {
    let (header, appended) = halves(bytes)?;
    let part = between(header, "<Cells>", "</Cells>")?;
    let raw = |name: &str| {
        let (_, tag) = part.split_once(&format!("Name=\"{name}\""))?;
        let (_, rest) = tag.split_once("offset=\"")?;
        unpack(appended, rest.split_once('"')?.0.parse().ok()?)
    };
    let numbers = |name: &str| -> Option<Vec<usize>> {
        let eight = |eight: &[u8]| usize::try_from(i64::from_le_bytes(eight.try_into().ok()?)).ok();
        raw(name)?.chunks_exact(8).map(eight).collect()
    };
    let (corners, ends, kinds) = (numbers("connectivity")?, numbers("offsets")?, raw("types")?);
    let mut seen: BTreeMap<[u32; 4], Option<[u32; 4]>> = BTreeMap::new();
    let mut start = 0;
    for (end, kind) in ends.into_iter().zip(kinds) {
        let cell = corners.get(start..end)?;
        start = end;
        for face in faces_of(kind) {
            let mut own = [0; 4];
            for (corner, k) in own.iter_mut().zip(face) {
                *corner = cell.get(*k).filter(|point| **point < n).map(|point| *point as u32)?;
            }
            let mut key = own;
            key.sort_unstable();
            seen.entry(key).and_modify(|face| *face = None).or_insert(Some(own));
        }
    }
    Some(seen.into_values().flatten().collect())
}

fn array(tag: &str, appended: &[u8]) -> Option<Array> {
    let attribute = |name: &str| {
        let (_, rest) = tag.split_once(&format!("{name}=\""))?;
        Some(rest.split_once('"')?.0)
    };
    let raw = unpack(appended, attribute("offset")?.parse().ok()?)?;
    let values =
        raw.chunks_exact(8).map(|eight| f64::from_le_bytes(eight.try_into().unwrap_or_default()));
    let unescaped = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&amp;", "&")];
    let name = attribute("Name")?.to_owned();
    Some(Array {
        name: unescaped.iter().fold(name, |name, (code, c)| name.replace(code, c)),
        components: attribute("NumberOfComponents")?.parse().ok()?,
        values: values.collect(),
    })
}

/// The blocks of an array: their number, two sizes, the packed size of each, then the blocks.
fn unpack(appended: &[u8], offset: usize) -> Option<Vec<u8>> {
    let number = |at: usize| -> Option<usize> {
        let eight = appended.get(at..at.checked_add(8)?)?;
        usize::try_from(u64::from_le_bytes(eight.try_into().ok()?)).ok()
    };
    let n = number(offset)?;
    if n > appended.len() / 8 {
        return None;
    }
    let mut at = offset + 24 + 8 * n;
    let mut out = Vec::new();
    for block in 0..n {
        let size = number(offset + 24 + 8 * block)?;
        let packed = appended.get(at..at.checked_add(size)?)?;
        ZlibDecoder::new(packed).take(MOST_BYTES).read_to_end(&mut out).ok()?;
        at += size;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vtu::encode_vtu;
    use crate::{Frame, PointField, Points};

    #[test]
    fn a_lattice_is_seen_from_outside() {
        let lattice = |sizes: [usize; 3]| {
            let mut positions = Vec::new();
            for x in 0..sizes[0] {
                for y in 0..sizes[1] {
                    positions.extend((0..sizes[2]).flat_map(|z| [x as f64, y as f64, z as f64]));
                }
            }
            let n = positions.len() / 3;
            let cells = crate::cells::of_lattice(3, &positions, 1.0);
            let points = Points {
                dimension: 3,
                volumes: vec![1.0; n],
                positions,
                spacing: Some(1.0),
                cells,
                mesh: None,
            };
            let frame = Frame {
                t: 0.0,
                displacement: vec![0.0; 3 * n],
                residual: vec![0.0; 3 * n],
                velocity: Vec::new(),
                fields: Vec::new(),
            };
            (decode_faces(&encode_vtu(&points, &frame), n).unwrap(), points.positions)
        };
        assert_eq!(lattice([2, 2, 2]).0.len(), 6);
        // Two by three by four cells: 2 (2*3 + 3*4 + 2*4) faces.
        let (faces, positions) = lattice([3, 4, 5]);
        assert_eq!(faces.len(), 52);
        for face in faces {
            let corner = |k: usize| &positions[3 * face[k] as usize..][..3];
            let side = |p: usize, q: usize| -> f64 {
                corner(p).iter().zip(corner(q)).map(|(x, y)| (x - y).abs()).sum()
            };
            assert!(
                [(0, 1), (1, 2), (2, 3), (3, 0)].iter().all(|(p, q)| side(*p, *q) == 1.0),
                "{face:?}"
            );
        }
    }

    #[test]
    fn what_was_written_is_read() {
        let points = Points {
            dimension: 2,
            positions: vec![0.0, 1.0, 2.0, 3.0],
            volumes: vec![1.0, 2.0],
            spacing: None,
            cells: Vec::new(),
            mesh: None,
        };
        let frame = Frame {
            t: 0.5,
            displacement: vec![0.1, 0.2, 0.3, 0.4],
            residual: vec![0.0; 4],
            velocity: Vec::new(),
            fields: vec![PointField { name: "a<b".into(), components: 1, values: vec![5.0, 6.0] }],
        };
        let bytes = encode_vtu(&points, &frame);
        let read = decode(&bytes).unwrap();
        assert_eq!(read.positions, [0.0, 1.0, 0.0, 2.0, 3.0, 0.0]);
        assert!(decode_faces(&bytes, 2).unwrap().is_empty());
        assert_eq!(read.arrays[0].name, "displacement");
        assert_eq!(read.arrays[0].values, [0.1, 0.2, 0.0, 0.3, 0.4, 0.0]);
        let last = read.arrays.last().unwrap();
        assert_eq!((last.name.as_str(), &last.values[..]), ("a<b", &[5.0, 6.0][..]));
        // Cut anywhere it is refused.
        for end in 0..bytes.len() - 40 {
            assert!(decode(&bytes[..end]).is_none() || end > bytes.len() - 200, "{end}");
        }
    }
}
