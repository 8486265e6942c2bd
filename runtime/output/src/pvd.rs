//! `run.pvd`: the frames of a run with their times, as ParaView opens them.

use std::fmt::Write;

use super::mesh::{Mesh, PointsAre};
use super::pieces::{self, Piece};
use super::vtu::{encode_cells, encode_vtu};
use super::{Frame, OutputError, OutputFile, OutputFolder, Points, decimal};

/// The frames of a run, written one by one.
///
/// After every [`FrameSeries::push`] the folder holds a whole `run.pvd` that lists whole frames
/// only: the frame is written first, then the list is replaced. A run that is killed leaves its
/// earlier frames readable.
#[derive(Debug)]
pub struct FrameSeries<'a> {
    folder: &'a OutputFolder,
    form: Form<'a>,
    times: Vec<f64>,
}

/// How frames are written.
#[derive(Debug)]
enum Form<'a> {
    /// Whole, of these points.
    Whole(&'a Points),
    /// By so many processes, of which this is one's own piece.
    Pieces(&'a Piece, usize),
}

impl<'a> FrameSeries<'a> {
    /// A series without frames; writes an empty `run.pvd`.
    pub fn new(
        folder: &'a OutputFolder,
        points: &'a Points,
    ) -> Result<FrameSeries<'a>, OutputError> {
        FrameSeries { folder, form: Form::Whole(points), times: Vec::new() }.begun()
    }

    /// A series without frames, of each of which so many processes write pieces; writes an empty `run.pvd`.
    pub fn in_pieces(
        folder: &'a OutputFolder,
        own: &'a Piece,
        n_pieces: usize,
    ) -> Result<FrameSeries<'a>, OutputError> {
        FrameSeries { folder, form: Form::Pieces(own, n_pieces), times: Vec::new() }.begun()
    }

    fn begun(self) -> Result<FrameSeries<'a>, OutputError> {
        self.write_list()?;
        Ok(self)
    }

    /// Goes on behind the frames of these times; later ones are no frames any more.
    pub fn resume(
        folder: &'a OutputFolder,
        points: &'a Points,
        times: Vec<f64>,
    ) -> Result<FrameSeries<'a>, OutputError> {
        FrameSeries { folder, form: Form::Whole(points), times }.resumed()
    }

    /// The same of frames in pieces.
    pub fn resume_in_pieces(
        folder: &'a OutputFolder,
        own: &'a Piece,
        n_pieces: usize,
        times: Vec<f64>,
    ) -> Result<FrameSeries<'a>, OutputError> {
        FrameSeries { folder, form: Form::Pieces(own, n_pieces), times }.resumed()
    }

    fn resumed(self) -> Result<FrameSeries<'a>, OutputError> {
        let series = self.begun()?;
        series.folder.remove_frames_from(series.times.len())?;
        Ok(series)
    }

    /// The times of the frames.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Writes the next frame and the list that includes it. In pieces these are written before, and `frame` is that of
    /// one's own.
    pub fn push(&mut self, frame: &Frame) -> Result<(), OutputError> {
        let index = self.times.len();
        match self.form {
            Form::Whole(points) => {
                if let Some(mesh) = self.cells() {
                    let encoded = encode_cells(mesh, points, frame);
                    let file = OutputFile::Cells(index);
                    self.folder.write_with(file, |out| encoded.write_to(out))?;
                }
                let encoded = encode_vtu(points, frame);
                self.folder.write_with(OutputFile::Frame(index), |out| encoded.write_to(out))?;
            }
            Form::Pieces(piece, n) => {
                let list = pieces::list(index, n, &piece.arrays(frame));
                self.folder.write(OutputFile::Pieces(index), list.as_bytes())?;
            }
        }
        self.times.push(frame.t);
        self.write_list().inspect_err(|_| {
            self.times.pop();
        })
    }

    /// How many frames were written.
    pub fn n_frames(&self) -> usize {
        self.times.len()
    }

    /// The mesh whose cells are the points: of it frames have a second part.
    fn cells(&self) -> Option<&'a Mesh> {
        let Form::Whole(points) = self.form else { return None };
        points.mesh.as_deref().filter(|mesh| mesh.points_are() == PointsAre::Cells)
    }

    fn write_list(&self) -> Result<(), OutputError> {
        let frame = match self.form {
            Form::Whole(_) => OutputFile::Frame,
            Form::Pieces(..) => OutputFile::Pieces,
        };
        let list = collection(&self.times, frame, self.cells().is_some());
        self.folder.write(OutputFile::Collection, list.as_bytes())
    }
}

fn collection(times: &[f64], frame: fn(usize) -> OutputFile, has_cells: bool) -> String {
    let mut out = String::from(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n\
         <Collection>\n",
    );
    for (index, &t) in times.iter().enumerate() {
        let parts = [Some(frame(index)), has_cells.then_some(OutputFile::Cells(index))];
        for (part, file) in parts.into_iter().flatten().enumerate() {
            let (t, file) = (decimal(t), file.relative());
            let _ = writeln!(
                out,
                "<DataSet timestep=\"{t}\" group=\"\" part=\"{part}\" file=\"{file}\"/>"
            );
        }
    }
    out.push_str("</Collection>\n</VTKFile>\n");
    out
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::frames::{read_pvd, read_vtu};

    fn points() -> Points {
        Points {
            dimension: 2,
            positions: vec![0.0, 0.0, 1.0, 0.0],
            volumes: vec![1.0, 1.0],
            spacing: Some(1.0),
            mesh: None,
            held: Vec::new(),
        }
    }

    fn frame(t: f64) -> Frame {
        Frame {
            t,
            displacement: vec![t; 4],
            residual: vec![0.0; 4],
            velocity: Vec::new(),
            fields: Vec::new(),
        }
    }

    fn listed(folder: &OutputFolder) -> Vec<(f64, String)> {
        read_pvd(&fs::read_to_string(folder.path_of(OutputFile::Collection)).unwrap()).unwrap()
    }

    #[test]
    fn the_list_is_whole_after_every_frame() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        let points = points();
        let mut series = FrameSeries::new(&folder, &points).unwrap();
        assert_eq!(listed(&folder), []);
        for index in 0..12 {
            let t = index as f64 * 0.1;
            series.push(&frame(t)).unwrap();
            let list = listed(&folder);
            assert_eq!(list.len(), index + 1);
            for (time, file) in list {
                let read = read_vtu(&dir.path().join(file)).unwrap();
                assert_eq!(read.t, time);
                assert_eq!(read.array("displacement").unwrap().values[0], time);
            }
        }
    }

    #[test]
    fn a_stray_frame_is_not_picked_up() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        let points = points();
        let mut series = FrameSeries::new(&folder, &points).unwrap();
        series.push(&frame(0.0)).unwrap();
        // What a run killed in the middle of its second frame leaves behind.
        let partial = format!("frames/.frame_000001.vtu.{}.partial", std::process::id());
        fs::write(dir.path().join(partial), b"<VTK").unwrap();
        assert_eq!(listed(&folder), [(0.0, "frames/frame_000000.vtu".to_owned())]);
        series.push(&frame(1.0)).unwrap();
        assert_eq!(listed(&folder).len(), 2);
        let names: Vec<_> = fs::read_dir(dir.path().join("frames")).unwrap().collect();
        assert_eq!(names.len(), 2, "the partial is gone: {names:?}");
    }

    #[test]
    fn a_frame_that_cannot_be_written_is_not_listed() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        let points = points();
        let mut series = FrameSeries::new(&folder, &points).unwrap();
        series.push(&frame(0.0)).unwrap();
        // A folder in the place of the next frame makes the rename fail.
        let blocked = folder.path_of(OutputFile::Frame(1));
        fs::create_dir(&blocked).unwrap();
        let error = series.push(&frame(0.5)).unwrap_err();
        assert!(error.to_string().contains("frame_000001.vtu"), "{error}");
        assert_eq!(listed(&folder).len(), 1);
        assert_eq!(series.n_frames(), 1);
        fs::remove_dir(&blocked).unwrap();
        series.push(&frame(0.5)).unwrap();
        assert_eq!(listed(&folder)[1], (0.5, "frames/frame_000001.vtu".to_owned()));
    }

    #[test]
    fn cut_lists_are_noticed() {
        let whole = collection(&[0.0, 0.5], OutputFile::Frame, false);
        assert_eq!(read_pvd(&whole).unwrap().len(), 2);
        for length in 0..whole.len() {
            assert_eq!(read_pvd(&whole[..length]), None);
        }
    }
}
