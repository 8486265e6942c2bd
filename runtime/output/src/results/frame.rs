//! Frames read back from `.vtu` files of piola, and put together of their pieces: points, displacements, what is known
//! of points, cells.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use flate2::read::ZlibDecoder;
use piola_meshes::Shape;

use super::{ResultsError, decoded};
use crate::pieces::NUMBERS;
use crate::vtu::shape_of;

/// What begins the arrays of a file, behind its header.
const START: &[u8] = b"<AppendedData encoding=\"raw\">\n_";

/// Most bytes of an array, unpacked.
const MOST_BYTES: u64 = 1 << 32;

/// Numbers of points are below this one: they have room in four bytes.
const MOST_POINTS: f64 = 4294967295.0;

/// An array over points.
pub(crate) struct Array {
    pub(crate) name: String,
    pub(crate) components: usize,
    pub(crate) values: Vec<f64>,
}

/// A frame.
pub(crate) struct ReadFrame {
    /// At rest, three numbers in m each.
    pub(crate) positions: Vec<f64>,
    /// Displacement first.
    pub(crate) arrays: Vec<Array>,
}

/// Cells: what each is, and its corners one after the other.
pub(crate) type ReadCells = Vec<(Shape, Vec<u32>)>;

/// The header of a file, and its arrays.
fn halves(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let start = bytes.windows(START.len()).position(|window| window == START)?;
    Some((std::str::from_utf8(&bytes[..start]).ok()?, &bytes[start + START.len()..]))
}

/// What a header has between two tags.
fn between<'h>(header: &'h str, open: &str, close: &str) -> Option<&'h str> {
    Some(header.split_once(open)?.1.split_once(close)?.0)
}

/// A frame, whole or in pieces.
pub(crate) fn read(path: &Path) -> Result<ReadFrame, ResultsError> {
    let Some(files) = pieces_of(path)? else { return decoded(path, decode) };
    let pieces = files.iter().map(|file| decoded(file, decode)).collect::<Result<Vec<_>, _>>()?;
    joined(&pieces).ok_or_else(|| ResultsError::Broken { path: path.to_owned() })
}

/// The body that pieces are of.
fn joined(pieces: &[ReadFrame]) -> Option<ReadFrame> {
    let places: Vec<Vec<usize>> = pieces.iter().map(numbers).collect::<Option<_>>()?;
    let n = places.iter().flatten().max()? + 1;
    // Each point is in a piece: there are no more than all of them have rows.
    let mut known = (n <= places.iter().map(Vec::len).sum()).then(|| vec![false; n])?;
    places.iter().flatten().for_each(|place| known[*place] = true);
    known.iter().all(|known| *known).then_some(())?;
    let of_body = pieces[0].arrays.iter().filter(|array| array.name != NUMBERS);
    let arrays = of_body.map(|first| {
        let own = |piece: &'_ ReadFrame| piece.arrays.iter().position(|one| one.name == first.name);
        let all: Vec<&Array> = pieces
            .iter()
            .map(|piece| own(piece).map(|number| &piece.arrays[number]))
            .collect::<Option<_>>()?;
        let components = first.components;
        all.iter().all(|array| array.components == components).then_some(())?;
        let rows = all.iter().map(|array| &array.values[..]);
        let values = at_places(rows, components, (&places, n));
        Some(Array { name: first.name.clone(), components, values })
    });
    let positions = pieces.iter().map(|piece| &piece.positions[..]);
    Some(ReadFrame {
        positions: at_places(positions, 3, (&places, n)),
        arrays: arrays.collect::<Option<_>>()?,
    })
}

/// Rows of so many numbers of pieces, at the places of their points among `n`.
fn at_places<'a>(
    pieces: impl Iterator<Item = &'a [f64]>,
    width: usize,
    (places, n): (&[Vec<usize>], usize),
) -> Vec<f64> {
    let mut all = vec![0.0; n * width];
    for (rows, places) in pieces.zip(places) {
        for (row, place) in rows.chunks_exact(width).zip(places) {
            all[place * width..(place + 1) * width].copy_from_slice(row);
        }
    }
    all
}

/// The positions of a frame and its cells but single points, whole or in pieces.
pub(crate) fn read_cells(path: &Path) -> Result<(Vec<f64>, ReadCells), ResultsError> {
    let Some(files) = pieces_of(path)? else { return decoded(path, decode_cells) };
    let mut all = Vec::new();
    for piece in files {
        let places = decoded(&piece, |bytes| numbers(&decode(bytes)?))?;
        let (_, cells) = decoded(&piece, decode_cells)?;
        let number = |corner: u32| places[corner as usize] as u32;
        all.extend(
            cells.into_iter().map(|(shape, own)| (shape, own.into_iter().map(number).collect())),
        );
    }
    Ok((read(path)?.positions, all))
}

/// The files of a frame that is in pieces.
fn pieces_of(path: &Path) -> Result<Option<Vec<PathBuf>>, ResultsError> {
    if path.extension().is_none_or(|ending| ending != "pvtu") {
        return Ok(None);
    }
    let list = decoded(path, |bytes| String::from_utf8(bytes.to_vec()).ok())?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let names = list.split("<Piece Source=\"").skip(1).filter_map(|rest| rest.split_once('"'));
    // Names of files beside it: nothing leads out of the folder.
    let files = names.filter_map(|(name, _)| Some(folder.join(Path::new(name).file_name()?)));
    Ok(Some(files.collect()))
}

/// What number each point of a piece has in the body.
fn numbers(piece: &ReadFrame) -> Option<Vec<usize>> {
    let array = piece.arrays.iter().find(|array| array.name == NUMBERS && array.components == 1)?;
    let is_number = |x: f64| (0.0..MOST_POINTS).contains(&x) && x.fract() == 0.0;
    let number = |x: &f64| is_number(*x).then_some(*x as usize);
    array.values.iter().map(number).collect()
}

/// The points of a file and their arrays.
fn decode(bytes: &[u8]) -> Option<ReadFrame> {
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
    arrays.iter().all(fits).then_some(ReadFrame { positions, arrays })
}

/// The positions of a file and its cells but single points.
fn decode_cells(bytes: &[u8]) -> Option<(Vec<f64>, ReadCells)> {
    let (header, appended) = halves(bytes)?;
    let points = between(header, "<Points>", "</Points>")?;
    let positions = array(points.split("<DataArray ").nth(1)?, appended)?.values;
    let n = positions.len() / 3;
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
    let mut cells = Vec::new();
    let mut start = 0;
    for (end, kind) in ends.into_iter().zip(kinds) {
        let own = corners.get(start..end)?;
        start = end;
        let shape = shape_of(kind)?;
        if shape == Shape::Point {
            continue;
        }
        let is_whole = own.len() == shape.n_corners() && own.iter().all(|corner| *corner < n);
        let own = own.iter().map(|corner| *corner as u32).collect();
        cells.push(is_whole.then_some((shape, own))?);
    }
    Some((positions, cells))
}

/// Faces of a cell by its corners, as VTK numbers them.
fn faces_of(shape: Shape) -> &'static [[usize; 4]] {
    match shape {
        Shape::Point | Shape::Line => &[],
        Shape::Triangle => &[[0, 1, 2, 2]],
        Shape::Quadrilateral => &[[0, 1, 2, 3]],
        Shape::Tetrahedron => &[[0, 2, 1, 1], [0, 1, 3, 3], [1, 2, 3, 3], [0, 3, 2, 2]],
        Shape::Hexahedron => {
            &[[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        }
        Shape::Wedge => &[[0, 1, 2, 2], [3, 5, 4, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]],
        Shape::Pyramid => &[[0, 3, 2, 1], [0, 1, 4, 4], [1, 2, 4, 4], [2, 3, 4, 4], [3, 0, 4, 4]],
    }
}

/// The faces of all cells of a frame but those between two of them, four corners each; of a triangle the last twice.
pub(crate) fn read_faces(path: &Path) -> Result<Vec<[u32; 4]>, ResultsError> {
    Ok(outside(read_cells(path)?.1))
}

fn outside(cells: ReadCells) -> Vec<[u32; 4]> {
    let mut seen: BTreeMap<[u32; 4], Option<[u32; 4]>> = BTreeMap::new();
    for (shape, corners) in cells {
        for face in faces_of(shape) {
            let own = face.map(|k| corners[k]);
            let mut key = own;
            key.sort_unstable();
            seen.entry(key).and_modify(|face| *face = None).or_insert(Some(own));
        }
    }
    seen.into_values().flatten().collect()
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
            let points = Points {
                dimension: 3,
                volumes: vec![1.0; n],
                positions,
                spacing: Some(1.0),
                mesh: None,
                held: Vec::new(),
            };
            let frame = Frame {
                t: 0.0,
                displacement: vec![0.0; 3 * n],
                residual: vec![0.0; 3 * n],
                velocity: Vec::new(),
                fields: Vec::new(),
            };
            let bytes = encode_vtu(&points, &frame).to_vec();
            (outside(decode_cells(&bytes).unwrap().1), points.positions)
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
            mesh: None,
            held: Vec::new(),
        };
        let frame = Frame {
            t: 0.5,
            displacement: vec![0.1, 0.2, 0.3, 0.4],
            residual: vec![0.0; 4],
            velocity: Vec::new(),
            fields: vec![PointField { name: "a<b".into(), components: 1, values: vec![5.0, 6.0] }],
        };
        let bytes = encode_vtu(&points, &frame).to_vec();
        let read = decode(&bytes).unwrap();
        assert_eq!(read.positions, [0.0, 1.0, 0.0, 2.0, 3.0, 0.0]);
        assert!(decode_cells(&bytes).unwrap().1.is_empty());
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
