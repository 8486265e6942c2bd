//! STL files, as text or binary: triangles of a closed surface, and the lattice that fills it.

use crate::error::MeshError;
use crate::scan::{Scan, shown};

/// Bytes before the triangles of a binary file, and of one of them.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// A column of cells is this part of a spacing from the next: extents to it are whole.
const WHOLE: f64 = 1e-6;

/// A surface of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Corners in the file's unit of length.
    pub triangles: Vec<[[f64; 3]; 3]>,
}

/// What lies inside a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Filling {
    /// The middles of its cells, `n x 3` row by row, the last axis fastest.
    pub positions: Vec<f64>,
    /// x and y of a line along z that goes in, by the order of corners, where it is inside already: surfaces
    /// overlap there, or one is inside another and its triangles are not turned.
    pub nested: Option<[f64; 2]>,
}

/// Reads the triangles; normals are passed over.
///
/// # Errors
/// Anything that breaks the format, and a surface without triangles.
pub fn read(bytes: &[u8]) -> Result<Surface, MeshError> {
    let announced = bytes
        .get(80..HEADER)
        .map_or(0, |count| u64::from(u32::from_le_bytes([count[0], count[1], count[2], count[3]])));
    let head = &bytes[..bytes.len().min(512)];
    let is_text =
        head.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
            && !head.contains(&0);
    let fits = (HEADER as u64) + announced * (TRIANGLE as u64) == bytes.len() as u64;
    // Binary files may begin with `solid`, too: the length decides.
    let triangles = if fits && bytes.len() >= HEADER {
        binary(bytes)?
    } else if is_text {
        text(bytes)?
    } else if bytes.len() < HEADER {
        let message = "the file is neither text, `solid ..`, nor long enough for a binary STL";
        return Err(MeshError::broken((0, 0), message).in_binary());
    } else {
        let message = format!(
            "{announced} triangles are announced, which makes {} bytes, and the file has {}",
            HEADER as u64 + announced * TRIANGLE as u64,
            bytes.len()
        );
        return Err(MeshError::broken((80, 84), message)
            .in_binary()
            .help("it was cut, or is no STL file"));
    };
    if triangles.is_empty() {
        let end = bytes.len();
        return Err(MeshError::unusable((end, end), "the surface has no triangles"));
    }
    Ok(Surface { triangles })
}

fn binary(bytes: &[u8]) -> Result<Vec<[[f64; 3]; 3]>, MeshError> {
    let mut triangles = Vec::with_capacity((bytes.len() - HEADER) / TRIANGLE);
    for (number, record) in bytes[HEADER..].chunks_exact(TRIANGLE).enumerate() {
        let mut triangle = [[0.0; 3]; 3];
        for (k, four) in record[12..48].chunks_exact(4).enumerate() {
            let x = f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
            if !x.is_finite() {
                let at = HEADER + number * TRIANGLE + 12 + 4 * k;
                let message = format!("a coordinate of triangle {} is {x}", number + 1);
                return Err(MeshError::broken((at, at + 4), message).in_binary());
            }
            triangle[k / 3][k % 3] = f64::from(x);
        }
        triangles.push(triangle);
    }
    Ok(triangles)
}

fn text(bytes: &[u8]) -> Result<Vec<[[f64; 3]; 3]>, MeshError> {
    let mut scan = Scan::new(bytes);
    // `solid` and a name that may have any words.
    scan.filled_line();
    let mut triangles = Vec::new();
    loop {
        let (word, place) = scan.word("`facet` or `endsolid`")?;
        match word {
            "facet" => triangles.push(facet(&mut scan)?),
            "endsolid" => {
                scan.line();
                // Another solid may follow.
                match scan.filled_line() {
                    None => return Ok(triangles),
                    Some(line) if line.text.starts_with(b"solid") => {}
                    Some(line) => {
                        let message = "`solid` or the end of the file should stand here";
                        return Err(MeshError::broken((line.start, line.start), message));
                    }
                }
            }
            other => {
                let message =
                    format!("`facet` or `endsolid` should stand here, not `{}`", shown(other));
                return Err(MeshError::broken(place, message));
            }
        }
    }
}

/// What follows `facet`.
fn facet(scan: &mut Scan<'_>) -> Result<[[f64; 3]; 3], MeshError> {
    expect(scan, "normal")?;
    for _ in 0..3 {
        // Some programs write `nan` where a triangle is flat; it is of no use here.
        scan.word("a component of the normal")?;
    }
    expect(scan, "outer")?;
    expect(scan, "loop")?;
    let mut triangle = [[0.0; 3]; 3];
    for corner in &mut triangle {
        expect(scan, "vertex")?;
        for x in corner {
            *x = scan.float("a coordinate of a vertex")?;
        }
    }
    expect(scan, "endloop")?;
    expect(scan, "endfacet")?;
    Ok(triangle)
}

fn expect(scan: &mut Scan<'_>, expected: &str) -> Result<(), MeshError> {
    let (word, place) = scan.word(&format!("`{expected}`"))?;
    if word == expected {
        return Ok(());
    }
    let message = format!("`{expected}` should stand here, not `{}`", shown(word));
    Err(MeshError::broken(place, message))
}

impl Surface {
    /// The box around it: two opposite corners.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for corner in self.triangles.iter().flatten() {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(corner[axis]);
                bounds[1][axis] = bounds[1][axis].max(corner[axis]);
            }
        }
        bounds
    }

    /// The lattice of cells of this spacing around it: its lower corner and the cells along each axis. The
    /// box is in its middle.
    pub fn lattice(&self, spacing: f64) -> ([f64; 3], [f64; 3]) {
        let [low, high] = self.bounds();
        let cells = [0, 1, 2].map(|axis| {
            let cells = (high[axis] - low[axis]) / spacing;
            let whole = cells.round();
            // A box of whole cells keeps them, whatever rounding says of its extent.
            if (cells - whole).abs() <= WHOLE * whole.max(1.0) && whole > 0.0 {
                whole
            } else {
                cells.ceil()
            }
        });
        let lower =
            [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]) - 0.5 * cells[axis] * spacing);
        (lower, cells)
    }

    /// The volume that it encloses in the file's unit cubed, by the order of corners: where surfaces overlap,
    /// and where the surface of a hollow is turned outwards like the others, twice.
    pub fn volume(&self) -> f64 {
        // About a corner, so that a place far from the origin costs no digits.
        let origin = self.triangles.first().map_or([0.0; 3], |triangle| triangle[0]);
        let six_times = self.triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|x| [0, 1, 2].map(|axis| x[axis] - origin[axis]));
            a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        });
        six_times.sum::<f64>().abs() / 6.0
    }

    /// The middles of the cells that lie inside: what is inside two surfaces is outside. At most
    /// [`lattice`](Surface::lattice)'s cells are looked at: see that they are not too many first.
    ///
    /// # Errors
    /// A surface that is not closed, or has no middle of a cell inside.
    pub fn fill(&self, spacing: f64) -> Result<Filling, MeshError> {
        let (lower, cells) = self.lattice(spacing);
        let counts = cells.map(|cells| cells as usize);
        let middle = |axis: usize, k: usize| lower[axis] + (k as f64 + 0.5) * spacing;
        let mut crossings: Vec<(u64, Crossing)> = Vec::new();
        for triangle in &self.triangles {
            let range = |axis: usize| {
                let x = triangle.map(|corner| corner[axis]);
                let (low, high) = (x[0].min(x[1]).min(x[2]), x[0].max(x[1]).max(x[2]));
                let first = ((low - lower[axis]) / spacing - 0.5).floor().max(0.0) as usize;
                let last = ((high - lower[axis]) / spacing + 0.5).ceil().max(0.0) as usize;
                first..last.min(counts[axis])
            };
            for i in range(0) {
                for j in range(1) {
                    let column = (i * counts[1] + j) as u64;
                    let at = [middle(0, i), middle(1, j)];
                    crossings.extend(crossing(triangle, at).map(|found| (column, found)));
                }
            }
        }
        crossings.sort_unstable_by(|(a, p), (b, q)| a.cmp(b).then(p.z.total_cmp(&q.z)));
        let (mut positions, mut nested) = (Vec::new(), None);
        for column in crossings.chunk_by(|a, b| a.0 == b.0) {
            let (i, j) = (column[0].0 as usize / counts[1], column[0].0 as usize % counts[1]);
            let (x, y) = (middle(0, i), middle(1, j));
            if column.len() % 2 == 1 {
                let message = format!(
                    "the surface is not closed: the line through x = {x:.6}, y = {y:.6} along z meets it \
                     {} times",
                    column.len()
                );
                return Err(MeshError::unusable((0, 0), message)
                    .in_binary()
                    .help("repair it: every edge belongs to two triangles"));
            }
            if nested.is_none() && is_nested(column.iter().map(|(_, found)| found), spacing) {
                nested = Some([x, y]);
            }
            for pair in column.chunks_exact(2) {
                let first = ((pair[0].1.z - lower[2]) / spacing - 0.5).ceil().max(0.0) as usize;
                for k in first..counts[2] {
                    let z = middle(2, k);
                    if z >= pair[1].1.z {
                        break;
                    }
                    positions.extend_from_slice(&[x, y, z]);
                }
            }
        }
        if positions.is_empty() {
            let message =
                format!("no middle of a cell of spacing {spacing} lies inside the surface");
            return Err(MeshError::unusable((0, 0), message)
                .in_binary()
                .help("take a smaller spacing, and look at the file's unit of length"));
        }
        Ok(Filling { positions, nested })
    }
}

/// Where a line along z meets a triangle.
#[derive(Clone, Copy)]
struct Crossing {
    z: f64,
    /// Whether the triangle, by the order of its corners, looks towards larger z.
    is_upward: bool,
}

/// Whether what a line meets, one behind the other, is somewhere inside two surfaces, by the order of corners: further
/// than surfaces that touch, each with its rounding.
fn is_nested<'a>(met: impl Iterator<Item = &'a Crossing> + Clone, spacing: f64) -> bool {
    let mut depth = 0_i32;
    met.clone().zip(met.skip(1)).any(|(here, next)| {
        depth += if here.is_upward { 1 } else { -1 };
        depth.abs() > 1 && next.z - here.z > WHOLE * spacing
    })
}

/// Where the line through `at` along z meets a triangle.
///
/// Which side of an edge the line is on is worked out from the lesser end to the greater, so that the two
/// triangles of an edge agree to the last bit, and the line that passes it meets one of them.
fn crossing(triangle: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> Option<Crossing> {
    let mut inside = false;
    for k in 0..3 {
        let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
        if (a[1] <= y) != (b[1] <= y) {
            let (a, b) = if (a[1], a[0]) <= (b[1], b[0]) { (a, b) } else { (b, a) };
            let along = (y - a[1]) / (b[1] - a[1]);
            inside ^= x < a[0] + along * (b[0] - a[0]);
        }
    }
    if !inside {
        return None;
    }
    let [a, b, c] = triangle;
    let (p, q) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let area = p[0] * q[1] - p[1] * q[0];
    let r = [x - a[0], y - a[1]];
    let (s, t) = ((r[0] * q[1] - r[1] * q[0]) / area, (p[0] * r[1] - p[1] * r[0]) / area);
    let z = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2]);
    let (low, high) = (a[2].min(b[2]).min(c[2]), a[2].max(b[2]).max(c[2]));
    // Triangles on edge make no more than their extent of rounding.
    let z = if z.is_nan() { low } else { z.clamp(low, high) };
    Some(Crossing { z, is_upward: area > 0.0 })
}
