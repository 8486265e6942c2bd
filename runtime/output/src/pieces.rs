//! Frames in pieces: each process writes its own points as a `.vtu` file, and one of them a `.pvtu` that lists these.
//!
//! A piece has its own points first, and behind them borrowed ones: points of others that are corners of its cells, so
//! that no gap is seen between two pieces. The array `point` has the number of each point in the user's order, by
//! which readers put the body together; a borrowed point has there what its owner has.

use std::fmt::Write as _;
use std::path::Path;

use super::atomic::write_atomically;
use super::vtu::{Cells, Encoded, encode_with, escape};
use super::{Frame, OutputError, OutputFile, Points};

/// The array that has the numbers of points in the user's order.
pub const NUMBERS: &str = "point";

/// The points of a piece, in any order in which own ones come first.
#[derive(Clone, Debug)]
pub struct Piece {
    /// Own and borrowed ones.
    pub points: Points,
    /// Of each its number in the user's order of the whole body.
    pub numbers: Vec<f64>,
    /// How many are its own.
    pub n_own: usize,
}

impl Piece {
    /// Writes a frame of it, with values of all its points, into the folder of a run that another process may hold: by
    /// the number of the frame and that of the piece.
    ///
    /// # Errors
    /// A folder that this process does not see; a file that cannot be written.
    pub fn write(
        &self,
        folder: &Path,
        (index, piece): (usize, usize),
        frame: &Frame,
    ) -> Result<(), OutputError> {
        let encoded = self.encode(frame);
        let file = folder.join(OutputFile::Piece(index, piece).relative());
        write_atomically(&file, |out| encoded.write_to(out))
    }

    fn encode(&self, frame: &Frame) -> Encoded {
        // A cell is written by whoever has its first corner.
        let cells = match self.points.spacing {
            Some(spacing) => Cells::of_lattice(&self.points, spacing).of_first(self.n_own),
            None => Cells::none(),
        };
        let cells = cells.with_vertices(self.n_own);
        encode_with(&self.points, frame, cells, &[(NUMBERS, &self.numbers, 1)])
    }

    /// Names and numbers per point of what a frame of it has.
    pub(crate) fn arrays(&self, frame: &Frame) -> Vec<(String, usize)> {
        let d = self.points.dimension;
        let mut arrays = vec![("displacement".to_owned(), d)];
        let held: Vec<f64> = Vec::new();
        let others = super::vtu::of_points(&self.points, frame, &held);
        arrays.extend(others.iter().map(|(name, _, width)| ((*name).to_owned(), *width)));
        if !self.points.held.is_empty() {
            arrays.push(("held".to_owned(), 1));
        }
        arrays.push((NUMBERS.to_owned(), 1));
        arrays
    }
}

/// The list of the pieces of a frame, as VTK reads it.
pub(crate) fn list(index: usize, n_pieces: usize, arrays: &[(String, usize)]) -> String {
    let array = |name: &str, width: usize| {
        let width = if width == 2 { 3 } else { width };
        let name = escape(name);
        format!("<PDataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{width}\"/>\n")
    };
    let of_points: String = arrays.iter().map(|(name, width)| array(name, *width)).collect();
    let points = array("Points", 3);
    let mut out = format!(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"PUnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <PUnstructuredGrid GhostLevel=\"0\">\n\
         <PPointData Vectors=\"displacement\">\n{of_points}</PPointData>\n\
         <PPoints>\n{points}</PPoints>\n"
    );
    for piece in 0..n_pieces {
        let file = OutputFile::Piece(index, piece).name();
        let _ = writeln!(out, "<Piece Source=\"{file}\"/>");
    }
    out.push_str("</PUnstructuredGrid>\n</VTKFile>\n");
    out
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::pvd::FrameSeries;
    use crate::results::frame::{read, read_cells};
    use crate::vtu::encode_vtu;
    use crate::{OutputFolder, PointField};

    /// A lattice of 3 x 4 points, sorted along y, and a frame in motion of some of its points; numbers are in the
    /// order x by x.
    fn of_points(chosen: &[usize]) -> (Points, Frame) {
        let x = |point: &usize| [(point / 4) as f64 * 0.5, (point % 4) as f64 * 0.5];
        let vectors = |scale: f64| -> Vec<f64> {
            chosen
                .iter()
                .flat_map(|point| [*point as f64 * scale, 1.0 / (1 + point) as f64])
                .collect()
        };
        let points = Points {
            dimension: 2,
            positions: chosen.iter().flat_map(x).collect(),
            volumes: chosen.iter().map(|point| 1.0 + *point as f64).collect(),
            spacing: Some(0.5),
            mesh: None,
            held: chosen.iter().map(|point| point % 4 == 0).collect(),
        };
        let values = chosen.iter().map(|point| (*point as f64).sqrt()).collect();
        let frame = Frame {
            t: 0.1,
            displacement: vectors(1e-3),
            residual: vectors(2.0),
            velocity: vectors(-3.0),
            fields: vec![PointField { name: "damage".to_owned(), components: 1, values }],
        };
        (points, frame)
    }

    #[test]
    fn pieces_are_read_as_the_body_that_they_are_of() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        // Sorted along y; the cut is within a layer, and each piece borrows up to the next layer's end.
        let sorted: Vec<usize> = (0..4).flat_map(|y| [y, 4 + y, 8 + y]).collect();
        let pieces: Vec<(Piece, Frame)> = [(0..5, 9), (5..12, 12)]
            .map(|(own, end)| {
                let chosen = &sorted[own.start..end];
                let (points, frame) = of_points(chosen);
                let numbers = chosen.iter().map(|point| *point as f64).collect();
                (Piece { points, numbers, n_own: own.len() }, frame)
            })
            .to_vec();
        let mut series = FrameSeries::in_pieces(&folder, &pieces[0].0, 2).unwrap();
        for (number, (piece, frame)) in pieces.iter().enumerate() {
            piece.write(folder.path(), (0, number), frame).unwrap();
        }
        series.push(&pieces[0].1).unwrap();
        let list = fs::read_to_string(dir.path().join("run.pvd")).unwrap();
        assert!(list.contains("file=\"frames/frame_000000.pvtu\""), "{list}");

        let (points, frame) = of_points(&(0..12).collect::<Vec<_>>());
        let whole = dir.path().join("whole.vtu");
        fs::write(&whole, encode_vtu(&points, &frame).to_vec()).unwrap();
        let joined = folder.path_of(OutputFile::Pieces(0));
        let (one, other) = (read(&whole).unwrap(), read(&joined).unwrap());
        assert_eq!(one.positions, other.positions);
        let arrays = |frame: &crate::results::frame::ReadFrame| -> Vec<(String, usize, Vec<f64>)> {
            let all = frame.arrays.iter();
            all.map(|a| (a.name.clone(), a.components, a.values.clone())).collect()
        };
        assert_eq!(arrays(&one), arrays(&other));
        let cells = |path: &Path| {
            let mut cells = read_cells(path).unwrap().1;
            cells.sort_by(|(_, a), (_, b)| a.cmp(b));
            cells
        };
        assert_eq!(cells(&whole).len(), 6);
        assert_eq!(cells(&whole), cells(&joined), "no cell is missing, and none there twice");
        // The list names what the pieces have.
        let list = fs::read_to_string(&joined).unwrap();
        for name in ["displacement", "residual", "velocity", "volume", "damage", "held", "point"] {
            assert!(list.contains(&format!("Name=\"{name}\"")), "{name}: {list}");
        }
        // Without one of the pieces, or with a number beyond the body, there is no frame.
        let (mut piece, frame) = pieces[1].clone();
        piece.numbers[2] = 1e9;
        piece.write(folder.path(), (0, 1), &frame).unwrap();
        assert!(read(&joined).is_err());
        fs::remove_file(folder.path_of(OutputFile::Piece(0, 1))).unwrap();
        assert!(read(&joined).is_err());
    }
}
