//! Frames as `.vtu` files: VTK's unstructured grid with one vertex cell per point, and of lattices
//! quadrilaterals or hexahedra between them, of meshes whose corners are the points their cells. Where
//! points are the cells of a mesh, that is a grid of its own, with the points' numbers as cell data.
//!
//! The format is VTK XML with raw appended data, little endian, `UInt64` headers, zlib blocks
//! (docs.vtk.org, "VTK XML file formats"). Points stand at their reference positions and carry
//! `displacement`, so that ParaView's *Warp By Vector* shows the deformed body; two-dimensional
//! vectors are padded with zero. Numbers are stored as `f64` bit for bit.

use std::io::{self, Write};

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

/// A frame as a `.vtu` file.
///
/// Point arrays: `displacement` (m), `residual` (N), in motion `velocity` (m/s), `volume` (m^d), `held` (0 or 1)
/// and the frame's own.
pub fn encode_vtu(points: &Points, frame: &Frame) -> Encoded {
    let cells = match (&points.mesh, points.spacing) {
        (Some(mesh), _) if mesh.points_are() == PointsAre::Vertices => Cells::of_mesh(mesh),
        (_, Some(spacing)) => Cells::of_lattice(points, spacing),
        _ => Cells::none(),
    };
    encode_with(points, frame, cells.with_vertices(points.n_points()), &[])
}

/// The same with these cells, and arrays over points behind the others.
pub(super) fn encode_with(
    points: &Points,
    frame: &Frame,
    cells: Cells,
    more: &[(&str, &[f64], usize)],
) -> Encoded {
    let mut grid = Grid::new(points.dimension);
    let mut point_data = grid.arrays(&[("displacement", &frame.displacement, points.dimension)]);
    point_data += &grid.arrays(&of_points(points, frame, &held(points)));
    point_data += &grid.arrays(more);
    let positions = grid.positions(&points.positions);
    grid.file(frame.t, [&point_data, "", &positions], points.n_points(), &cells)
}

/// The mesh of a body whose points are its cells, as a `.vtu` file: `displacement` (m) at the vertices,
/// everything that [`encode_vtu`] has of points at the cells.
pub fn encode_cells(mesh: &Mesh, points: &Points, frame: &Frame) -> Encoded {
    let d = points.dimension;
    let carried = mesh.carried(&points.positions, &frame.displacement, &points.held);
    let mut grid = Grid::new(d);
    let point_data = grid.arrays(&[("displacement", &carried, d)]);
    let cell_data = grid.arrays(&of_points(points, frame, &held(points)));
    let positions = grid.positions(mesh.vertices());
    let n = mesh.vertices().len() / d;
    grid.file(frame.t, [&point_data, &cell_data, &positions], n, &Cells::of_mesh(mesh))
}

/// A file in pieces, which are written one after the other: large bodies are not copied together.
pub struct Encoded {
    head: Vec<u8>,
    /// The compressed blocks of all arrays, each array behind its sizes.
    blocks: Vec<Vec<u8>>,
}

impl Encoded {
    /// Writes all of it.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_to(&self, out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&self.head)?;
        self.blocks.iter().try_for_each(|block| out.write_all(block))?;
        out.write_all(TAIL)
    }

    /// All of it.
    #[cfg(test)]
    pub(crate) fn to_vec(&self) -> Vec<u8> {
        [&self.head[..], &self.blocks.concat(), TAIL].concat()
    }
}

/// What ends a file.
const TAIL: &[u8] = b"\n</AppendedData>\n</VTKFile>\n";

/// 1 of points whose displacement is prescribed, 0 of others.
fn held(points: &Points) -> Vec<f64> {
    points.held.iter().map(|held| f64::from(*held)).collect()
}

/// What is known of points beside their displacement: names, values, components; `held` as numbers.
pub(super) fn of_points<'a>(
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

/// Cells in VTK's arrays: a vertex for each point, if wanted, and others behind them.
pub(super) struct Cells {
    n_vertices: usize,
    /// Of the others, one after the other.
    corners: Vec<u32>,
    forms: Forms,
}

/// What the cells that are no vertices are like.
pub(super) enum Forms {
    All(Shape),
    /// Where the corners of each end, and its type.
    Each(Vec<u32>, Vec<u8>),
}

impl Cells {
    pub(super) fn none() -> Cells {
        Cells { n_vertices: 0, corners: Vec::new(), forms: Forms::All(Shape::Point) }
    }

    /// The same behind a vertex for each of the first so many points.
    pub(super) fn with_vertices(self, n: usize) -> Cells {
        Cells { n_vertices: n, ..self }
    }

    /// Of a lattice those whose first corner is among the first so many points.
    pub(super) fn of_first(mut self, n: usize) -> Cells {
        if let Forms::All(shape) = &self.forms {
            let cells = self.corners.chunks_exact(shape.n_corners());
            let own = cells.filter(|cell| (cell[0] as usize) < n);
            self.corners = own.flatten().copied().collect();
        }
        self
    }

    pub(super) fn of_lattice(points: &Points, spacing: f64) -> Cells {
        let flat = points.dimension == 2;
        let shape = if flat { Shape::Quadrilateral } else { Shape::Hexahedron };
        let corners = crate::cells::of_lattice(points.dimension, &points.positions, spacing);
        Cells { corners, forms: Forms::All(shape), ..Cells::none() }
    }

    fn of_mesh(mesh: &Mesh) -> Cells {
        let (mut corners, mut ends, mut types) = (Vec::new(), Vec::new(), Vec::new());
        for cell in 0..mesh.n_cells() {
            corners.extend_from_slice(mesh.corners(cell));
            ends.push(corners.len() as u32);
            types.push(vtk(mesh.shape(cell)));
        }
        Cells { corners, forms: Forms::Each(ends, types), ..Cells::none() }
    }

    fn n_cells(&self) -> usize {
        self.n_vertices
            + match &self.forms {
                Forms::All(shape) => self.corners.len() / shape.n_corners(),
                Forms::Each(ends, _) => ends.len(),
            }
    }

    /// The corner at a place among those of all cells.
    fn corner(&self, place: usize) -> i64 {
        match place.checked_sub(self.n_vertices) {
            None => place as i64,
            Some(behind) => i64::from(self.corners[behind]),
        }
    }

    /// Where the corners of a cell end.
    fn end(&self, cell: usize) -> i64 {
        match (cell.checked_sub(self.n_vertices), &self.forms) {
            (None, _) => cell as i64 + 1,
            (Some(other), Forms::All(shape)) => {
                (self.n_vertices + (other + 1) * shape.n_corners()) as i64
            }
            (Some(other), Forms::Each(ends, _)) => self.n_vertices as i64 + i64::from(ends[other]),
        }
    }

    fn type_of(&self, cell: usize) -> u8 {
        match (cell.checked_sub(self.n_vertices), &self.forms) {
            (None, _) => vtk(Shape::Point),
            (Some(_), Forms::All(shape)) => vtk(*shape),
            (Some(other), Forms::Each(_, types)) => types[other],
        }
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
        arrays
            .iter()
            .map(|(name, values, components)| self.array(name, values, *components))
            .collect()
    }

    fn positions(&mut self, positions: &[f64]) -> String {
        let padded = if self.dimension == 2 { 2 } else { 3 };
        self.array("Points", positions, padded)
    }

    /// Rows of so many numbers, those of two padded with zero.
    fn array(&mut self, name: &str, values: &[f64], components: usize) -> String {
        let width = if components == 2 { 3 } else { components };
        let n = values.len() / components.max(1);
        let number = |place: usize| match (place / width, place % width) {
            _ if width == components => values[place].to_le_bytes(),
            (_, 2) => 0f64.to_le_bytes(),
            (row, component) => values[row * components + component].to_le_bytes(),
        };
        self.appended.array(("Float64", name, width), n * width, number)
    }

    fn file(
        mut self,
        t: f64,
        [point_data, cell_data, positions]: [&str; 3],
        n: usize,
        cells: &Cells,
    ) -> Encoded {
        let (appended, n_cells) = (&mut self.appended, cells.n_cells());
        let n_corners = cells.n_vertices + cells.corners.len();
        let connectivity = appended
            .array(("Int64", "connectivity", 1), n_corners, |k| cells.corner(k).to_le_bytes());
        let offsets =
            appended.array(("Int64", "offsets", 1), n_cells, |k| cells.end(k).to_le_bytes());
        let types = appended.array(("UInt8", "types", 1), n_cells, |k| [cells.type_of(k)]);
        let t = decimal(t);
        let cell_data = match cell_data {
            "" => String::new(),
            some => format!("<CellData>\n{some}</CellData>\n"),
        };

        let head = format!(
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
        Encoded { head, blocks: self.appended.blocks }
    }
}

/// The appended section as it grows.
#[derive(Default)]
struct Appended {
    blocks: Vec<Vec<u8>>,
    n_bytes: usize,
}

impl Appended {
    /// Appends so many values compressed, each of `WIDTH` bytes, and returns the element that points at them.
    fn array<const WIDTH: usize>(
        &mut self,
        (kind, name, components): (&str, &str, usize),
        n: usize,
        value: impl Fn(usize) -> [u8; WIDTH] + Sync,
    ) -> String {
        let offset = self.n_bytes;
        let blocks = compress(n, value);
        self.n_bytes += blocks.iter().map(Vec::len).sum::<usize>();
        self.blocks.extend(blocks);
        let name = escape(name);
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{offset}\"/>\n"
        )
    }
}

/// `[blocks][block size][size of the last block if partial][compressed sizes..]`, then the blocks.
fn compress<const WIDTH: usize>(
    n: usize,
    value: impl Fn(usize) -> [u8; WIDTH] + Sync,
) -> Vec<Vec<u8>> {
    // The blocks are compressed in parallel and joined in order: the same bytes on any number of
    // threads. Values are written out block by block, so that none of them stands in memory twice.
    let per_block = BLOCK / WIDTH;
    let blocks: Vec<Vec<u8>> = (0..n.div_ceil(per_block))
        .into_par_iter()
        .map_init(
            || Vec::with_capacity(BLOCK),
            |raw: &mut Vec<u8>, block| {
                raw.clear();
                let places = block * per_block..n.min((block + 1) * per_block);
                places.for_each(|place| raw.extend_from_slice(&value(place)));
                let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
                encoder.write_all(raw).expect("writing to memory cannot fail");
                let mut compressed = encoder.finish().expect("writing to memory cannot fail");
                compressed.shrink_to_fit();
                compressed
            },
        )
        .collect();
    let mut sizes = vec![blocks.len() as u64, BLOCK as u64, (n * WIDTH % BLOCK) as u64];
    sizes.extend(blocks.iter().map(|block| block.len() as u64));
    let head = sizes.iter().flat_map(|word| word.to_le_bytes()).collect();
    [head].into_iter().chain(blocks).collect()
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
        let file = decode_vtu(&encode_vtu(&points, &frame).to_vec()).unwrap();
        assert_eq!(file.t.to_bits(), frame.t.to_bits());
        let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let expect_vectors = |values: &[f64], read: &[f64]| {
            let padded = values
                .chunks_exact(dimension)
                .flat_map(|row| row.iter().copied().chain(std::iter::repeat_n(0.0, 3 - dimension)));
            assert_eq!(bits(&padded.collect::<Vec<f64>>()), bits(read));
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
        points.spacing = Some(1.0);
        frame.fields.clear();
        // The reader looks at every cell.
        decode_vtu(&encode_vtu(&points, &frame).to_vec()).unwrap();
        let mut cells = Cells { n_vertices: 8, ..Cells::of_lattice(&points, 1.0) };
        assert_eq!((cells.corners.len(), cells.n_cells()), (8, 9));
        cells.corners[3] = cells.corners[2];
        assert!(decode_vtu(&encode_with(&points, &frame, cells, &[]).to_vec()).is_err());
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_number_of_threads() {
        let (points, frame) = sample(3, 50_000);
        let encode = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| encode_vtu(&points, &frame).to_vec())
        };
        assert_eq!(encode(1), encode(3));
    }

    #[test]
    fn cut_or_damaged_files_are_errors_and_never_panics() {
        let (points, frame) = sample(2, 40);
        let bytes = encode_vtu(&points, &frame).to_vec();
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
