//! Frames as `.vtu` files: VTK's unstructured grid with one vertex cell per point, and of lattices
//! quadrilaterals or hexahedra between them, of meshes whose corners are the points their cells. Where
//! points are the cells of a mesh, that is a grid of its own, with the points' numbers as cell data.
//!
//! The format is VTK XML with raw appended data, little endian, `UInt64` headers, zlib blocks
//! (docs.vtk.org, "VTK XML file formats"). Points stand at their reference positions and carry
//! `displacement`, so that ParaView's *Warp By Vector* shows the deformed body; two-dimensional
//! vectors are padded with zero. Numbers are stored as `f64` bit for bit.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;

use piola_meshes::Shape;

use super::mesh::{Mesh, PointsAre};
use super::{Frame, Points, decimal};

/// Uncompressed bytes per zlib block: small enough to compress blocks on all threads.
const BLOCK: usize = 1 << 18;

/// The number of a form among VTK's cell types. Corners are in Gmsh's order, in which VTK finds volumes
/// positive.
fn vtk(shape: Shape) -> u8 {
    match shape {
        Shape::Point => 1,
        Shape::Line => 3,
        Shape::Triangle => 5,
        Shape::Quadrilateral => 9,
        Shape::Tetrahedron => 10,
        Shape::Hexahedron => 12,
        Shape::Wedge => 13,
        Shape::Pyramid => 14,
    }
}

/// The form that has this number.
pub(crate) fn shape_of(vtk_type: u8) -> Option<Shape> {
    let all = [
        Shape::Point,
        Shape::Line,
        Shape::Triangle,
        Shape::Quadrilateral,
        Shape::Tetrahedron,
        Shape::Hexahedron,
        Shape::Wedge,
        Shape::Pyramid,
    ];
    all.into_iter().find(|shape| vtk(*shape) == vtk_type)
}

/// A frame as the bytes of a `.vtu` file.
///
/// Point arrays: `displacement` (m), `residual` (N), in motion `velocity` (m/s), `volume` (m^d), `held` (0 or 1)
/// and the frame's own.
pub fn encode_vtu(points: &Points, frame: &Frame) -> Vec<u8> {
    let mut grid = Grid::new(points.dimension);
    let mut point_data = grid.arrays(&[("displacement", &frame.displacement, points.dimension)]);
    point_data += &grid.arrays(&of_points(points, frame, &held(points)));
    let positions = grid.positions(&points.positions);
    let mut cells = Cells::of_vertices(points.n_points());
    match &points.mesh {
        Some(mesh) if mesh.points_are() == PointsAre::Vertices => cells.add_mesh(mesh),
        _ => cells.add_lattice(points),
    }
    grid.file(frame.t, [&point_data, "", &positions], points.n_points(), &cells)
}

/// The mesh of a body whose points are its cells, as the bytes of a `.vtu` file: `displacement` (m) at the
/// vertices, everything that [`encode_vtu`] has of points at the cells.
pub fn encode_cells(mesh: &Mesh, points: &Points, frame: &Frame) -> Vec<u8> {
    let d = points.dimension;
    let carried = mesh.carried(&points.positions, &frame.displacement, &points.held);
    let mut grid = Grid::new(d);
    let point_data = grid.arrays(&[("displacement", &carried, d)]);
    let cell_data = grid.arrays(&of_points(points, frame, &held(points)));
    let positions = grid.positions(mesh.vertices());
    let mut cells = Cells::default();
    cells.add_mesh(mesh);
    grid.file(frame.t, [&point_data, &cell_data, &positions], mesh.vertices().len() / d, &cells)
}

/// 1 of points whose displacement is prescribed, 0 of others.
fn held(points: &Points) -> Vec<f64> {
    points.held.iter().map(|held| f64::from(*held)).collect()
}

/// What is known of points beside their displacement: names, values, components; `held` as numbers.
fn of_points<'a>(
    points: &'a Points,
    frame: &'a Frame,
    held: &'a [f64],
) -> Vec<(&'a str, &'a [f64], usize)> {
    let d = points.dimension;
    let mut arrays = vec![("residual", &frame.residual[..], d)];
    if !frame.velocity.is_empty() {
        arrays.push(("velocity", &frame.velocity, d));
    }
    arrays.push(("volume", &points.volumes, 1));
    if !held.is_empty() {
        arrays.push(("held", held, 1));
    }
    arrays.extend(frame.fields.iter().map(|f| (&f.name[..], &f.values[..], f.components)));
    arrays
}

/// Cells in VTK's arrays.
#[derive(Default)]
struct Cells {
    connectivity: Vec<i64>,
    ends: Vec<i64>,
    types: Vec<u8>,
}

impl Cells {
    fn of_vertices(n: usize) -> Cells {
        let connectivity = (0..n as i64).collect();
        Cells { connectivity, ends: (1..=n as i64).collect(), types: vec![vtk(Shape::Point); n] }
    }

    fn add(&mut self, shape: Shape, corners: &[u32]) {
        self.connectivity.extend(corners.iter().map(|corner| i64::from(*corner)));
        self.ends.push(self.connectivity.len() as i64);
        self.types.push(vtk(shape));
    }

    fn add_lattice(&mut self, points: &Points) {
        let flat = points.dimension == 2;
        let shape = if flat { Shape::Quadrilateral } else { Shape::Hexahedron };
        points.cells.chunks_exact(shape.n_corners()).for_each(|cell| self.add(shape, cell));
    }

    fn add_mesh(&mut self, mesh: &Mesh) {
        (0..mesh.n_cells()).for_each(|cell| self.add(mesh.shape(cell), mesh.corners(cell)));
    }
}

/// A file as it grows: the appended section, and what points into it.
struct Grid {
    dimension: usize,
    appended: Appended,
}

impl Grid {
    fn new(dimension: usize) -> Grid {
        Grid { dimension, appended: Appended::default() }
    }

    fn arrays(&mut self, arrays: &[(&str, &[f64], usize)]) -> String {
        let array = |&(name, values, components): &(&str, &[f64], usize)| {
            let width = if components == 2 { 3 } else { components };
            let bytes = float_bytes(&padded(values, components, width));
            self.appended.array("Float64", name, width, &bytes)
        };
        arrays.iter().map(array).collect()
    }

    fn positions(&mut self, positions: &[f64]) -> String {
        let bytes = float_bytes(&padded(positions, self.dimension, 3));
        self.appended.array("Float64", "Points", 3, &bytes)
    }

    fn file(
        mut self,
        t: f64,
        [point_data, cell_data, positions]: [&str; 3],
        n: usize,
        cells: &Cells,
    ) -> Vec<u8> {
        let appended = &mut self.appended;
        let integers = |numbers: &[i64]| integer_bytes(numbers.iter().copied());
        let connectivity = integers(&cells.connectivity);
        let connectivity = appended.array("Int64", "connectivity", 1, &connectivity);
        let offsets = appended.array("Int64", "offsets", 1, &integers(&cells.ends));
        let types = appended.array("UInt8", "types", 1, &cells.types);
        let (n_cells, t) = (cells.types.len(), decimal(t));
        let cell_data = match cell_data {
            "" => String::new(),
            some => format!("<CellData>\n{some}</CellData>\n"),
        };

        let mut out = format!(
        r#"<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor">
<UnstructuredGrid>
<FieldData>
<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">{t}</DataArray>
</FieldData>
<Piece NumberOfPoints="{n}" NumberOfCells="{n_cells}">
<PointData Vectors="displacement">
{point_data}</PointData>
{cell_data}<Points>
{positions}</Points>
<Cells>
{connectivity}{offsets}{types}</Cells>
</Piece>
</UnstructuredGrid>
<AppendedData encoding="raw">
_"#
    )
    .into_bytes();
        out.extend_from_slice(&self.appended.bytes);
        out.extend_from_slice(b"\n</AppendedData>\n</VTKFile>\n");
        out
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PointField;
    use crate::frames::decode_vtu;

    fn field(name: &str, components: usize, values: Vec<f64>) -> PointField {
        PointField { name: name.to_owned(), components, values }
    }

    /// `n` points with values that use all bits, some of them special.
    fn sample(dimension: usize, n: usize) -> (Points, Frame) {
        let mut state = 42u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut many = |count: usize| (0..count).map(|_| next()).collect::<Vec<f64>>();
        let points = Points {
            dimension,
            positions: many(n * dimension),
            volumes: many(n),
            spacing: None,
            cells: Vec::new(),
            mesh: None,
            held: Vec::new(),
        };
        let mut frame = Frame {
            t: 0.1 + 0.2,
            displacement: many(n * dimension),
            residual: many(n * dimension),
            velocity: many(n * dimension),
            fields: vec![
                field("a \"<&>\" b", 1, many(n)),
                field("vector", dimension, many(n * dimension)),
                field("tensor", 9, many(9 * n)),
            ],
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
        let [scalar, vector, tensor] = &frame.fields[..] else { panic!("three") };
        for field in [scalar, tensor] {
            let read = file.array(&field.name).unwrap();
            assert_eq!(read.components, field.components);
            assert_eq!(bits(&read.values), bits(&field.values));
        }
        expect_vectors(&vector.values, &file.array("vector").unwrap().values);
        expect_vectors(&frame.velocity, &file.array("velocity").unwrap().values);
        assert_eq!(file.arrays.len(), 7);
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
    fn a_lattice_has_cells_between_its_points() {
        let (mut points, mut frame) = sample(3, 8);
        points.positions = (0..8).flat_map(|k| [k / 4, k / 2 % 2, k % 2].map(f64::from)).collect();
        points.cells = crate::cells::of_lattice(3, &points.positions, 1.0);
        frame.fields.clear();
        // The reader looks at every cell.
        decode_vtu(&encode_vtu(&points, &frame)).unwrap();
        assert_eq!(points.cells.len(), 8);
        points.cells[3] = points.cells[2];
        assert!(decode_vtu(&encode_vtu(&points, &frame)).is_err());
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
