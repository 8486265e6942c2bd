//! Files that appear whole or not at all, in a folder that piola owns.
//!
//! A file is written under a temporary name beside its place (`.summary.json.partial`), flushed
//! and synchronised to disk, and then renamed: a reader, or a run killed at any moment, sees the
//! old file or the new one. The names are a closed set ([`OutputFile`]), so nothing a user types
//! can become part of a path inside the folder.

use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Something went wrong on the way to a file.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The operating system refused.
    #[error("cannot {operation} `{}`: {source}", path.display())]
    Io {
        /// What was tried.
        operation: Operation,
        /// On which path.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// The folder holds something and `force` was not given.
    #[error("the output folder `{}` is not empty: it holds `{example}`", path.display())]
    NotEmpty {
        /// The folder.
        path: PathBuf,
        /// One of its entries.
        example: String,
    },
    /// A folder is needed, but a file (or a link) stands at its place.
    #[error("`{}` is not a folder", path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// The picture could not be drawn.
    #[error("cannot draw `{file}`: {reason}")]
    Picture {
        /// Which file.
        file: &'static str,
        /// Why, in the drawing library's words.
        reason: String,
    },
}

impl OutputError {
    /// What the user can do about it, where we know.
    pub fn help(&self) -> Option<&'static str> {
        match self {
            OutputError::NotEmpty { .. } => {
                Some("name another folder, or write `--force` to replace an earlier run in it")
            }
            OutputError::NotAFolder { .. } => Some("name another folder, or remove what is there"),
            OutputError::Io { .. } | OutputError::Picture { .. } => None,
        }
    }
}

/// What was being done to a path when an error occurred.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Making a folder.
    CreateFolder,
    /// Listing a folder.
    ReadFolder,
    /// Reading a file.
    Read,
    /// Writing the temporary file.
    Write,
    /// Giving the temporary file its name.
    Rename,
    /// Removing a file of an earlier run.
    Remove,
}

impl fmt::Display for Operation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Operation::CreateFolder => "create the folder",
            Operation::ReadFolder => "list the folder",
            Operation::Read => "read",
            Operation::Write => "write",
            Operation::Rename => "move into place",
            Operation::Remove => "remove",
        })
    }
}

impl Operation {
    /// For `map_err`: attaches the operation and the path to an `io::Error`.
    pub(super) fn on(self, path: &Path) -> impl FnOnce(io::Error) -> OutputError {
        let path = path.to_owned();
        move |source| OutputError::Io { operation: self, path, source }
    }
}

/// The files of an output folder: these and no others are written or, with force, removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputFile {
    /// `run.pvd`, the list of frames.
    Collection,
    /// `frames/frame_000000.vtu` and so on.
    Frame(usize),
    /// `displacement.csv`.
    Displacement,
    /// `reactions.csv`.
    Reactions,
    /// `energy.csv`.
    Energy,
    /// `probes.csv`.
    Probes,
    /// `scene.resolved.toml`.
    ResolvedScene,
    /// `picture.svg`.
    PictureSvg,
    /// `picture.png`.
    PicturePng,
    /// `summary.json`.
    Summary,
    /// `trade.csv`.
    TradeTable,
    /// `trade.json`.
    TradeSummary,
    /// `trade.svg`.
    TradeSvg,
    /// `trade.png`.
    TradePng,
}

/// The folder of the frames inside the output folder.
const FRAMES: &str = "frames";

impl OutputFile {
    /// All files but the frames; `run.pvd` first, so that a removal that is cut short leaves no
    /// list of frames that are gone.
    const SINGLE: [OutputFile; 13] = [
        OutputFile::Collection,
        OutputFile::Displacement,
        OutputFile::Reactions,
        OutputFile::Energy,
        OutputFile::Probes,
        OutputFile::ResolvedScene,
        OutputFile::PictureSvg,
        OutputFile::PicturePng,
        OutputFile::Summary,
        OutputFile::TradeTable,
        OutputFile::TradeSummary,
        OutputFile::TradeSvg,
        OutputFile::TradePng,
    ];

    /// The file's name without its folder.
    pub fn name(self) -> String {
        match self {
            OutputFile::Collection => "run.pvd".to_owned(),
            OutputFile::Frame(index) => format!("frame_{index:06}.vtu"),
            OutputFile::Displacement => "displacement.csv".to_owned(),
            OutputFile::Reactions => "reactions.csv".to_owned(),
            OutputFile::Energy => "energy.csv".to_owned(),
            OutputFile::Probes => "probes.csv".to_owned(),
            OutputFile::ResolvedScene => "scene.resolved.toml".to_owned(),
            OutputFile::PictureSvg => "picture.svg".to_owned(),
            OutputFile::PicturePng => "picture.png".to_owned(),
            OutputFile::Summary => "summary.json".to_owned(),
            OutputFile::TradeTable => "trade.csv".to_owned(),
            OutputFile::TradeSummary => "trade.json".to_owned(),
            OutputFile::TradeSvg => "trade.svg".to_owned(),
            OutputFile::TradePng => "trade.png".to_owned(),
        }
    }

    /// The path relative to the output folder, with `/` on every system as `run.pvd` needs it.
    pub fn relative(self) -> String {
        match self {
            OutputFile::Frame(_) => format!("{FRAMES}/{}", self.name()),
            _ => self.name(),
        }
    }
}

/// A folder that holds one run.
#[derive(Clone, Debug)]
pub struct OutputFolder {
    path: PathBuf,
}

impl OutputFolder {
    /// Creates the folder and its `frames`, or takes over an empty one.
    ///
    /// An existing folder with anything in it is refused unless `force`; then the files of an
    /// earlier run, and only those, are removed first.
    pub fn create(path: &Path, force: bool) -> Result<OutputFolder, OutputError> {
        let folder = OutputFolder::create_without_frames(path, force)?;
        let frames = path.join(FRAMES);
        match fs::symlink_metadata(&frames) {
            Ok(found) if !found.is_dir() => return Err(OutputError::NotAFolder { path: frames }),
            Ok(_) => {}
            Err(_) => fs::create_dir(&frames).map_err(Operation::CreateFolder.on(&frames))?,
        }
        Ok(folder)
    }

    /// The same for what leaves no frames.
    pub fn create_without_frames(path: &Path, force: bool) -> Result<OutputFolder, OutputError> {
        fs::create_dir_all(path).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => {
                OutputError::NotAFolder { path: path.to_owned() }
            }
            _ => Operation::CreateFolder.on(path)(source),
        })?;
        if let Some(example) = entries(path)?.first() {
            if !force {
                let example = example.clone();
                return Err(OutputError::NotEmpty { path: path.to_owned(), example });
            }
            remove_earlier_run(path)?;
        }
        Ok(OutputFolder { path: path.to_owned() })
    }

    /// Takes the folder away again if nothing was written into it.
    pub fn remove_if_empty(&self) {
        // Only empty folders can be removed so; what is left is what someone wants to keep.
        let _ = fs::remove_dir(self.path.join(FRAMES));
        let _ = fs::remove_dir(&self.path);
    }

    /// Where the folder is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where a file of the folder is, or would be.
    pub fn path_of(&self, file: OutputFile) -> PathBuf {
        self.path.join(file.relative())
    }

    /// Writes a whole file.
    pub fn write(&self, file: OutputFile, content: &[u8]) -> Result<(), OutputError> {
        self.write_with(file, |out| out.write_all(content))
    }

    /// Writes a file through `fill`; if that fails, what stood there before stays as it was.
    pub fn write_with(
        &self,
        file: OutputFile,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        write_atomically(&self.path_of(file), fill)
    }
}

/// Writes `target` whole or not at all: temporary name in the same folder, flush, sync, rename.
pub fn write_atomically(
    target: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), OutputError> {
    write_on(&System, target, fill)
}

/// What the order of writing rests on; tests cut the power of another one.
trait Disk {
    type File: Write;

    /// Makes a file that is not there yet; follows no link that someone may have put there.
    fn create(&self, path: &Path) -> io::Result<Self::File>;
    /// Returns when the content would survive a power cut.
    fn synchronise(&self, file: Self::File) -> io::Result<()>;
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
}

/// The operating system's.
struct System;

impl Disk for System {
    type File = File;

    fn create(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).create_new(true).open(path)
    }

    fn synchronise(&self, file: File) -> io::Result<()> {
        file.sync_data()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }
}

fn write_on<D: Disk>(
    disk: &D,
    target: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), OutputError> {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let partial = target.with_file_name(partial_name(&name));
    // A leftover of a killed run; removing a link removes the link, not what it points to.
    if fs::symlink_metadata(&partial).is_ok() {
        fs::remove_file(&partial).map_err(Operation::Remove.on(&partial))?;
    }
    let outcome = fill_new_file(disk, &partial, fill)
        .map_err(Operation::Write.on(target))
        .and_then(|()| disk.rename(&partial, target).map_err(Operation::Rename.on(target)));
    if outcome.is_err() {
        // Nothing more can be done if this fails too; the first error is the one to report.
        let _ = fs::remove_file(&partial);
    }
    outcome
}

fn fill_new_file<D: Disk>(
    disk: &D,
    partial: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 16, disk.create(partial)?);
    fill(&mut out)?;
    let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    // Without this a power cut after the rename could leave an empty file under the final name.
    disk.synchronise(file)
}

fn partial_name(name: &str) -> String {
    format!(".{name}.partial")
}

/// The names in a folder, sorted.
fn entries(folder: &Path) -> Result<Vec<String>, OutputError> {
    let list = fs::read_dir(folder).map_err(Operation::ReadFolder.on(folder))?;
    let mut names = Vec::new();
    for entry in list {
        let entry = entry.map_err(Operation::ReadFolder.on(folder))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

fn remove_earlier_run(folder: &Path) -> Result<(), OutputError> {
    for file in OutputFile::SINGLE {
        remove_if_there(&folder.join(file.name()))?;
        remove_if_there(&folder.join(partial_name(&file.name())))?;
    }
    let frames = folder.join(FRAMES);
    // A link named `frames` may lead out of the folder: it is refused later, never followed.
    if fs::symlink_metadata(&frames).is_ok_and(|found| found.is_dir()) {
        for name in entries(&frames)?.iter().filter(|name| is_frame_name(name)) {
            remove_if_there(&frames.join(name))?;
        }
    }
    Ok(())
}

/// `frame_000012.vtu`, or its temporary name.
fn is_frame_name(name: &str) -> bool {
    let partial = name.strip_prefix('.').and_then(|rest| rest.strip_suffix(".partial"));
    let digits = partial
        .unwrap_or(name)
        .strip_prefix("frame_")
        .and_then(|rest| rest.strip_suffix(".vtu"))
        .unwrap_or("");
    digits.len() >= 6 && digits.bytes().all(|b| b.is_ascii_digit())
}

fn remove_if_there(path: &Path) -> Result<(), OutputError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(Operation::Remove.on(path)(error))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::HashMap;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        entries(folder).unwrap()
    }

    #[test]
    fn an_interrupted_write_leaves_the_old_file_whole() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(&dir.path().join("run"), false).unwrap();
        folder.write(OutputFile::Summary, b"old").unwrap();
        let error = folder
            .write_with(OutputFile::Summary, |out| {
                out.write_all(&[b'n'; 200_000])?; // more than the buffer: some of it is on disk
                Err(io::Error::other("disk on fire"))
            })
            .unwrap_err();
        assert!(matches!(error, OutputError::Io { operation: Operation::Write, .. }));
        assert!(error.to_string().contains("summary.json"), "{error}");
        assert!(error.to_string().contains("disk on fire"), "{error}");
        assert_eq!(fs::read(folder.path_of(OutputFile::Summary)).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["frames", "summary.json"], "no partial is left");
    }

    /// A disk that keeps the names of files at once and their content only when it is synchronised,
    /// and what a power cut after each operation would leave under the name of the target.
    struct Careless {
        target: PathBuf,
        /// Content that survives, by name.
        kept: RefCell<HashMap<PathBuf, Vec<u8>>>,
        left: RefCell<Vec<Vec<u8>>>,
    }

    struct CarelessFile<'a> {
        disk: &'a Careless,
        path: PathBuf,
        written: Vec<u8>,
    }

    impl Careless {
        fn cut_power(&self) {
            self.left.borrow_mut().push(self.kept.borrow()[&self.target].clone());
        }
    }

    impl Write for CarelessFile<'_> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.written.extend(bytes);
            self.disk.cut_power();
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl<'a> Disk for &'a Careless {
        type File = CarelessFile<'a>;

        fn create(&self, path: &Path) -> io::Result<CarelessFile<'a>> {
            self.kept.borrow_mut().insert(path.to_owned(), Vec::new());
            self.cut_power();
            Ok(CarelessFile { disk: self, path: path.to_owned(), written: Vec::new() })
        }

        fn synchronise(&self, file: CarelessFile<'a>) -> io::Result<()> {
            self.kept.borrow_mut().insert(file.path, file.written);
            self.cut_power();
            Ok(())
        }

        fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
            let content = self.kept.borrow_mut().remove(from).unwrap();
            self.kept.borrow_mut().insert(to.to_owned(), content);
            self.cut_power();
            Ok(())
        }
    }

    #[test]
    fn a_power_cut_leaves_the_old_file_or_the_new_one() {
        let target = PathBuf::from("nowhere/summary.json");
        let (old, new) = (b"old".to_vec(), vec![b'n'; 200_000]);
        let kept = RefCell::new(HashMap::from([(target.clone(), old.clone())]));
        let disk = Careless { target: target.clone(), kept, left: RefCell::default() };
        write_on(&&disk, &target, |out| {
            new.chunks(50_000).try_for_each(|part| out.write_all(part))
        })
        .unwrap();
        let left = disk.left.into_inner();
        assert!(left.len() > 4, "{}", left.len());
        assert!(left.iter().all(|content| *content == old || *content == new));
        assert_eq!(left.last(), Some(&new));
    }

    #[test]
    fn a_folder_without_results_goes_and_one_with_results_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        OutputFolder::create(&path, false).unwrap().remove_if_empty();
        assert!(!path.exists());
        let folder = OutputFolder::create(&path, false).unwrap();
        folder.write(OutputFile::Summary, b"kept").unwrap();
        folder.remove_if_empty();
        assert_eq!(fs::read(folder.path_of(OutputFile::Summary)).unwrap(), b"kept");
    }

    #[test]
    fn a_leftover_partial_is_replaced_and_a_link_is_not_followed() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(&dir.path().join("run"), false).unwrap();
        let outside = dir.path().join("outside.txt");
        fs::write(&outside, "mine").unwrap();
        let partial = folder.path().join(".energy.csv.partial");
        #[cfg(unix)]
        std::os::unix::fs::symlink(&outside, &partial).unwrap();
        #[cfg(not(unix))]
        fs::write(&partial, "left by a killed run").unwrap();
        folder.write(OutputFile::Energy, b"t\n").unwrap();
        assert_eq!(fs::read_to_string(&outside).unwrap(), "mine");
        assert_eq!(fs::read(folder.path_of(OutputFile::Energy)).unwrap(), b"t\n");
        assert_eq!(names(folder.path()), ["energy.csv", "frames"]);
    }

    #[test]
    fn a_non_empty_folder_needs_force_and_force_removes_only_our_files() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        folder.write(OutputFile::Summary, b"{}").unwrap();
        folder.write(OutputFile::Frame(7), b"frame").unwrap();
        let ours = [".run.pvd.partial", "frames/.frame_000008.vtu.partial"];
        let theirs = ["notes.txt", "other.csv", "frames/mine.vtu", "frames/frame_1.vtu"];
        for name in ours.iter().chain(&theirs) {
            fs::write(dir.path().join(name), "x").unwrap();
        }
        let error = OutputFolder::create(dir.path(), false).unwrap_err();
        assert!(matches!(&error, OutputError::NotEmpty { .. }), "{error}");
        assert!(error.help().unwrap().contains("--force"));

        OutputFolder::create(dir.path(), true).unwrap();
        assert_eq!(names(dir.path()), ["frames", "notes.txt", "other.csv"]);
        assert_eq!(names(&dir.path().join("frames")), ["frame_1.vtu", "mine.vtu"]);
    }

    #[test]
    fn a_file_in_the_place_of_a_folder_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "x").unwrap();
        for path in [file.clone(), file.join("below")] {
            let error = OutputFolder::create(&path, true).unwrap_err();
            assert!(matches!(error, OutputError::NotAFolder { .. }), "{error}");
        }
        assert_eq!(fs::read_to_string(&file).unwrap(), "x");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_named_frames_is_refused_and_its_target_untouched() {
        let dir = tempfile::tempdir().unwrap();
        let elsewhere = dir.path().join("elsewhere");
        let run = dir.path().join("run");
        fs::create_dir(&elsewhere).unwrap();
        fs::create_dir(&run).unwrap();
        fs::write(elsewhere.join("frame_000001.vtu"), "precious").unwrap();
        std::os::unix::fs::symlink(&elsewhere, run.join("frames")).unwrap();
        let error = OutputFolder::create(&run, true).unwrap_err();
        assert!(matches!(error, OutputError::NotAFolder { .. }), "{error}");
        assert_eq!(names(&elsewhere), ["frame_000001.vtu"]);
    }

    #[test]
    fn a_missing_folder_is_created_with_its_parents() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(&dir.path().join("a/b/c"), false).unwrap();
        folder.write(OutputFile::Frame(12), b"x").unwrap();
        assert!(dir.path().join("a/b/c/frames/frame_000012.vtu").is_file());
    }
}
