//! The folder of a run: a closed set of names, so that nothing a user types can become part of a path
//! inside it, and one run at a time.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::atomic::{Operation, OutputError, Temporary, of_partial, write_atomically};

/// The files of an output folder: these and no others are written or, with force, removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputFile {
    /// `run.pvd`, the list of frames.
    Collection,
    /// `frames/frame_000000.vtu` and so on.
    Frame(usize),
    /// `frames/cells_000000.vtu`: the mesh of a body whose points are its cells.
    Cells(usize),
    /// `frames/frame_000000.pvtu`: the list of what several processes wrote of a frame.
    Pieces(usize),
    /// `frames/frame_000000_0000.vtu`: what one of them wrote.
    Piece(usize, usize),
    /// `displacement.csv`.
    Displacement,
    /// `reactions.csv`.
    Reactions,
    /// `force_displacement.csv`.
    Forces,
    /// `energy.csv`.
    Energy,
    /// `probes.csv`.
    Probes,
    /// `motion.csv`.
    Motion,
    /// `fracture.csv`.
    Fracture,
    /// `checkpoint.bin`.
    Checkpoint,
    /// `checkpoint_0_0000.bin`: what one of several processes has of it; first of the two that take turns, then of the
    /// part.
    CheckpointPart(usize, usize),
    /// `scene.resolved.toml`.
    ResolvedScene,
    /// `picture.svg`.
    PictureSvg,
    /// `picture.png`.
    PicturePng,
    /// `body.png`: the body at one of its times.
    BodyPicture,
    /// `film.png`: the body at all of them.
    Film,
    /// `force.png`: force against displacement.
    ForcePicture,
    /// `summary.json`.
    Summary,
    /// `report.html`.
    Report,
    /// `trade.csv`.
    TradeTable,
    /// `trade.json`.
    TradeSummary,
    /// `trade.svg`.
    TradeSvg,
    /// `trade.png`.
    TradePng,
    /// `sweep.csv`.
    SweepTable,
    /// `sweep.json`.
    SweepSummary,
    /// `sweep.svg`.
    SweepSvg,
    /// `sweep.png`.
    SweepPng,
}

/// The folder of the frames inside the output folder.
const FRAMES: &str = "frames";

impl OutputFile {
    /// All files but frames and parts of checkpoints; `run.pvd` first, so that a removal that is cut short leaves no
    /// list of frames that are gone.
    const SINGLE: [OutputFile; 25] = [
        OutputFile::Collection,
        OutputFile::Checkpoint,
        OutputFile::Displacement,
        OutputFile::Reactions,
        OutputFile::Forces,
        OutputFile::Energy,
        OutputFile::Probes,
        OutputFile::Motion,
        OutputFile::Fracture,
        OutputFile::ResolvedScene,
        OutputFile::PictureSvg,
        OutputFile::PicturePng,
        OutputFile::BodyPicture,
        OutputFile::Film,
        OutputFile::ForcePicture,
        OutputFile::Summary,
        OutputFile::Report,
        OutputFile::TradeTable,
        OutputFile::TradeSummary,
        OutputFile::TradeSvg,
        OutputFile::TradePng,
        OutputFile::SweepTable,
        OutputFile::SweepSummary,
        OutputFile::SweepSvg,
        OutputFile::SweepPng,
    ];

    /// The file's name without its folder.
    pub fn name(self) -> String {
        match self {
            OutputFile::Collection => "run.pvd".to_owned(),
            OutputFile::Frame(index) => format!("frame_{index:06}.vtu"),
            OutputFile::Cells(index) => format!("cells_{index:06}.vtu"),
            OutputFile::Pieces(index) => format!("frame_{index:06}.pvtu"),
            OutputFile::Piece(index, piece) => format!("frame_{index:06}_{piece:04}.vtu"),
            OutputFile::Displacement => "displacement.csv".to_owned(),
            OutputFile::Reactions => "reactions.csv".to_owned(),
            OutputFile::Forces => "force_displacement.csv".to_owned(),
            OutputFile::Energy => "energy.csv".to_owned(),
            OutputFile::Probes => "probes.csv".to_owned(),
            OutputFile::Motion => "motion.csv".to_owned(),
            OutputFile::Fracture => "fracture.csv".to_owned(),
            OutputFile::Checkpoint => "checkpoint.bin".to_owned(),
            OutputFile::CheckpointPart(turn, part) => format!("checkpoint_{turn}_{part:04}.bin"),
            OutputFile::ResolvedScene => "scene.resolved.toml".to_owned(),
            OutputFile::PictureSvg => "picture.svg".to_owned(),
            OutputFile::PicturePng => "picture.png".to_owned(),
            OutputFile::BodyPicture => "body.png".to_owned(),
            OutputFile::Film => "film.png".to_owned(),
            OutputFile::ForcePicture => "force.png".to_owned(),
            OutputFile::Summary => "summary.json".to_owned(),
            OutputFile::Report => "report.html".to_owned(),
            OutputFile::TradeTable => "trade.csv".to_owned(),
            OutputFile::TradeSummary => "trade.json".to_owned(),
            OutputFile::TradeSvg => "trade.svg".to_owned(),
            OutputFile::TradePng => "trade.png".to_owned(),
            OutputFile::SweepTable => "sweep.csv".to_owned(),
            OutputFile::SweepSummary => "sweep.json".to_owned(),
            OutputFile::SweepSvg => "sweep.svg".to_owned(),
            OutputFile::SweepPng => "sweep.png".to_owned(),
        }
    }

    /// The path relative to the output folder, with `/` on every system as `run.pvd` needs it.
    pub fn relative(self) -> String {
        match self {
            OutputFile::Frame(_)
            | OutputFile::Cells(_)
            | OutputFile::Pieces(_)
            | OutputFile::Piece(..) => format!("{FRAMES}/{}", self.name()),
            _ => self.name(),
        }
    }
}

/// A folder that holds one run.
///
/// As long as it exists no other process gets hold of the folder.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    lock: Lock,
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
        // Only who holds the folder looks into it: check and creation are one step.
        let lock = Lock::take(path)?;
        let found = entries(path)?;
        if let Some(example) = found.first() {
            if !force {
                let (path, example) = (path.to_owned(), example.clone());
                let resumable = found.contains(&OutputFile::Checkpoint.name());
                return Err(OutputError::NotEmpty { path, example, resumable });
            }
            remove_earlier_run(path)?;
        }
        Ok(OutputFolder { path: path.to_owned(), lock })
    }

    /// Takes hold of the folder of an earlier run, and leaves everything in it but what that run had
    /// begun to write when it was killed.
    ///
    /// # Errors
    /// A folder that is not there, or in which another run is.
    pub fn open(path: &Path) -> Result<OutputFolder, OutputError> {
        let found = fs::metadata(path).map_err(Operation::ReadFolder.on(path))?;
        if !found.is_dir() {
            return Err(OutputError::NotAFolder { path: path.to_owned() });
        }
        // A link named `frames` may lead out of the folder.
        let frames = path.join(FRAMES);
        match fs::symlink_metadata(&frames) {
            Ok(found) if found.is_dir() => {}
            Ok(_) => return Err(OutputError::NotAFolder { path: frames }),
            Err(_) => return Err(OutputError::NoCheckpoint { path: path.to_owned() }),
        }
        let folder = OutputFolder { path: path.to_owned(), lock: Lock::take(path)? };
        remove_partials(path)?;
        Ok(folder)
    }

    /// Removes a file, if it is there.
    pub fn remove(&self, file: OutputFile) -> Result<(), OutputError> {
        remove_if_there(&self.path_of(file))
    }

    /// Removes frames from this one on, if they are there.
    pub(crate) fn remove_frames_from(&self, first: usize) -> Result<(), OutputError> {
        remove_frames(&self.path, |name| frame_number(name).is_some_and(|number| number >= first))
    }

    /// Removes the checkpoint with all of its parts.
    pub fn remove_checkpoint(&self) -> Result<(), OutputError> {
        // First what names the parts.
        self.remove(OutputFile::Checkpoint)?;
        remove_parts(&self.path, |_| true)
    }

    /// Takes the folder away again if nothing was written into it.
    pub fn remove_if_empty(self) {
        drop(self.lock);
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

/// The file whose lock says that a run holds the folder.
const LOCK: &str = ".piola.lock";

/// An exclusive lock, given up when this is dropped or the process ends, however it ends.
#[derive(Debug)]
struct Lock {
    // Fields are dropped in order: the file is removed while it is still locked.
    _name: Temporary,
    _file: File,
}

impl Lock {
    fn take(folder: &Path) -> Result<Lock, OutputError> {
        let path = folder.join(LOCK);
        loop {
            let file = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
            let file = file.map_err(Operation::Lock.on(folder))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(OutputError::InUse { path: folder.to_owned() });
                }
                // A file system without locks: runs in one folder are not told from each other there.
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(error)) => return Err(Operation::Lock.on(folder)(error)),
            }
            // Whoever held the folder before may have removed the file since it was opened.
            if is_at(&file, &path) {
                let name = Temporary::new(path);
                let file = name.create(|_| Ok(file)).map_err(Operation::Lock.on(folder))?;
                return Ok(Lock { _name: name, _file: file });
            }
        }
    }
}

/// Whether the open file is the one that has this name now.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |found: fs::Metadata| (found.dev(), found.ino());
    match (file.metadata(), fs::metadata(path)) {
        (Ok(opened), Ok(named)) => identity(opened) == identity(named),
        _ => false,
    }
}

/// Open files keep their names on such systems.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

/// The names in a folder, sorted, without that of the lock.
fn entries(folder: &Path) -> Result<Vec<String>, OutputError> {
    let list = fs::read_dir(folder).map_err(Operation::ReadFolder.on(folder))?;
    let mut names = Vec::new();
    for entry in list {
        let entry = entry.map_err(Operation::ReadFolder.on(folder))?;
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.retain(|name| name != LOCK);
    names.sort();
    Ok(names)
}

fn remove_earlier_run(folder: &Path) -> Result<(), OutputError> {
    for file in OutputFile::SINGLE {
        remove_if_there(&folder.join(file.name()))?;
    }
    remove_partials(folder)?;
    remove_parts(folder, |_| true)?;
    remove_frames(folder, |_| true)
}

/// Removes those of the parts of a checkpoint.
fn remove_parts(folder: &Path, those: impl Fn(&str) -> bool) -> Result<(), OutputError> {
    for name in entries(folder)?.iter().filter(|name| is_part_name(name) && those(name)) {
        remove_if_there(&folder.join(name))?;
    }
    Ok(())
}

/// Removes what has a temporary name.
fn remove_partials(folder: &Path) -> Result<(), OutputError> {
    let ours = OutputFile::SINGLE.map(OutputFile::name);
    let is_ours = |name: &str| ours.iter().any(|file| file == name);
    for name in entries(folder)?.iter().filter(|name| of_partial(name).is_some_and(is_ours)) {
        remove_if_there(&folder.join(name))?;
    }
    let is_partial = |name: &str| of_partial(name).is_some();
    remove_parts(folder, is_partial)?;
    remove_frames(folder, is_partial)
}

/// Removes those of the frames.
fn remove_frames(folder: &Path, those: impl Fn(&str) -> bool) -> Result<(), OutputError> {
    let frames = folder.join(FRAMES);
    // A link named `frames` may lead out of the folder: it is refused later, never followed.
    if fs::symlink_metadata(&frames).is_ok_and(|found| found.is_dir()) {
        let names = entries(&frames)?;
        for name in names.iter().filter(|name| frame_number(name).is_some() && those(name)) {
            remove_if_there(&frames.join(name))?;
        }
    }
    Ok(())
}

/// The number of a frame of which this is the name of a file, or its temporary name: `frame_000012.vtu`,
/// `cells_000012.vtu`, `frame_000012.pvtu` or `frame_000012_0003.vtu`.
fn frame_number(name: &str) -> Option<usize> {
    let (stem, ending) = of_partial(name).unwrap_or(name).split_once('.')?;
    let number = match (stem.strip_prefix("frame_"), stem.strip_prefix("cells_"), ending) {
        (Some(number), _, "pvtu") | (_, Some(number), "vtu") => number,
        (Some(number), _, "vtu") => match number.split_once('_') {
            Some((number, piece)) => of_digits(piece, 4).map(|_| number)?,
            None => number,
        },
        _ => return None,
    };
    of_digits(number, 6)
}

/// `checkpoint_0_0003.bin`, or its temporary name.
fn is_part_name(name: &str) -> bool {
    let stem = of_partial(name).unwrap_or(name).strip_suffix(".bin");
    let numbers = stem.and_then(|stem| stem.strip_prefix("checkpoint_")?.split_once('_'));
    numbers.is_some_and(|(turn, part)| ["0", "1"].contains(&turn) && of_digits(part, 4).is_some())
}

/// The number that a word of so many digits or more is.
fn of_digits(word: &str, least: usize) -> Option<usize> {
    let is_one = word.len() >= least && word.bytes().all(|byte| byte.is_ascii_digit());
    word.parse().ok().filter(|_| is_one)
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

    #[test]
    fn one_run_at_a_time_holds_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        let held = OutputFolder::create(&path, false).unwrap();
        for force in [false, true] {
            let error = OutputFolder::create(&path, force).unwrap_err();
            assert!(matches!(error, OutputError::InUse { .. }), "{error}");
        }
        held.write(OutputFile::Summary, b"mine").unwrap();
        drop(held);
        assert!(!path.join(LOCK).exists());
        let error = OutputFolder::create(&path, false).unwrap_err();
        assert!(matches!(error, OutputError::NotEmpty { .. }), "{error}");
        assert_eq!(fs::read(path.join("summary.json")).unwrap(), b"mine");
        // A lock that a killed run left behind holds nobody.
        fs::write(path.join(LOCK), "").unwrap();
        OutputFolder::create(&path, true).unwrap();
    }

    #[test]
    fn a_folder_without_results_goes_and_one_with_results_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        OutputFolder::create(&path, false).unwrap().remove_if_empty();
        assert!(!path.exists());
        let folder = OutputFolder::create(&path, false).unwrap();
        folder.write(OutputFile::Summary, b"kept").unwrap();
        let summary = folder.path_of(OutputFile::Summary);
        folder.remove_if_empty();
        assert_eq!(fs::read(summary).unwrap(), b"kept");
    }

    #[test]
    fn a_leftover_partial_is_replaced_and_a_link_is_not_followed() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(&dir.path().join("run"), false).unwrap();
        let outside = dir.path().join("outside.txt");
        fs::write(&outside, "mine").unwrap();
        let partial = format!(".energy.csv.{}.partial", std::process::id());
        let partial = folder.path().join(partial);
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
        drop(folder);
        let ours = [
            ".run.pvd.partial",
            ".summary.json.4711.partial",
            "frames/.frame_000008.vtu.partial",
            "frames/.frame_000008.vtu.4711.partial",
            "frames/frame_000008.pvtu",
            "frames/frame_000008_0013.vtu",
            "frames/.frame_000008_0013.vtu.4711.partial",
        ];
        let theirs = [
            "notes.txt",
            "other.csv",
            "frames/mine.vtu",
            "frames/frame_1.vtu",
            "frames/frame_000001_1.vtu",
        ];
        for name in ours.iter().chain(&theirs) {
            fs::write(dir.path().join(name), "x").unwrap();
        }
        let error = OutputFolder::create(dir.path(), false).unwrap_err();
        assert!(matches!(&error, OutputError::NotEmpty { .. }), "{error}");
        assert!(error.help().unwrap().contains("--force"));

        OutputFolder::create(dir.path(), true).unwrap();
        assert_eq!(names(dir.path()), ["frames", "notes.txt", "other.csv"]);
        assert_eq!(
            names(&dir.path().join("frames")),
            ["frame_000001_1.vtu", "frame_1.vtu", "mine.vtu"]
        );
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
