//! Files that appear whole or not at all.
//!
//! A file is written under a temporary name beside its place (`.summary.json.4711.partial`, with the
//! number of the process), flushed and synchronised to disk, and then renamed: a reader, or a run
//! killed at any moment, sees the old file or the new one.

use std::collections::BTreeSet;
use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

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
        /// Whether the run in it can be taken up again.
        resumable: bool,
    },
    /// Another run holds the folder.
    #[error("another run of piola is writing into `{}`", path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// A folder is needed, but a file (or a link) stands at its place.
    #[error("`{}` is not a folder", path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// A run shall go on that left nothing to go on from.
    #[error("`{}` holds no checkpoint", path.display())]
    NoCheckpoint {
        /// The folder.
        path: PathBuf,
    },
    /// A checkpoint that is cut, damaged, or of another version.
    #[error("`{}` is damaged, or was written by another version of piola", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
    },
    /// A table that is not as it was at the checkpoint.
    #[error(
        "`{}` has {found} bytes, and had {expected} at the checkpoint: it was changed since",
        path.display()
    )]
    Table {
        /// The file.
        path: PathBuf,
        /// How long it is.
        found: u64,
        /// How long it must be at least.
        expected: u64,
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
            OutputError::NotEmpty { resumable: true, .. } => Some(
                "`piola run --resume FOLDER` (with `--petsc` where it began so) goes on with the run in it; `--force` \
                 replaces it",
            ),
            OutputError::NotEmpty { resumable: false, .. } => {
                Some("name another folder, or write `--force` to replace an earlier run in it")
            }
            OutputError::InUse { .. } => Some("wait until it has ended, or name another folder"),
            OutputError::NotAFolder { .. } => Some("name another folder, or remove what is there"),
            OutputError::NoCheckpoint { .. } => Some(
                "runs of scenes with [motion] leave one when they are interrupted, and every ten \
                 minutes (`checkpoint` in [output]); it is removed when all steps are done",
            ),
            OutputError::Checkpoint { .. } | OutputError::Table { .. } => {
                Some("begin anew: `piola run SCENE --out FOLDER --force`")
            }
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
    /// Taking hold of a folder.
    Lock,
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
            Operation::Lock => "lock",
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
    let path = target.with_file_name(partial_name(&name));
    // A leftover of a killed run; removing a link removes the link, not what it points to.
    if fs::symlink_metadata(&path).is_ok() {
        fs::remove_file(&path).map_err(Operation::Remove.on(&path))?;
    }
    let partial = Temporary::new(path);
    let file = partial.create(|path| disk.create(path)).map_err(Operation::Write.on(target))?;
    fill_file(disk, file, fill).map_err(Operation::Write.on(target))?;
    disk.rename(&partial.path, target).map_err(Operation::Rename.on(target))
}

fn fill_file<D: Disk>(
    disk: &D,
    file: D::File,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 16, file);
    fill(&mut out)?;
    let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    // Without this a power cut after the rename could leave an empty file under the final name.
    disk.synchronise(file)
}

fn partial_name(name: &str) -> String {
    format!(".{name}.{}.partial", std::process::id())
}

/// The name of a file whose temporary name this is, of any process.
pub(super) fn of_partial(name: &str) -> Option<&str> {
    let inner = name.strip_prefix('.')?.strip_suffix(".partial")?;
    match inner.rsplit_once('.') {
        Some((file, process)) if process.bytes().all(|b| b.is_ascii_digit()) => Some(file),
        _ => Some(inner),
    }
}

/// Files that shall not outlive the process.
static TEMPORARY: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn temporary() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all temporary files and lets nobody make another: for a program about to exit in the
/// middle of its work.
pub fn abandon() {
    let names = temporary();
    for path in names.iter() {
        let _ = fs::remove_file(path);
    }
    // Threads that write wait for the list, until the process is gone.
    std::mem::forget(names);
}

/// A file that is removed when this is dropped, if it is still there, or by [`abandon`].
#[derive(Debug)]
pub(super) struct Temporary {
    path: PathBuf,
}

impl Temporary {
    pub(super) fn new(path: PathBuf) -> Temporary {
        Temporary { path }
    }

    /// Makes the file, in one step with the entry in the list of those to be removed.
    pub(super) fn create<F>(&self, make: impl FnOnce(&Path) -> io::Result<F>) -> io::Result<F> {
        let mut names = temporary();
        let file = make(&self.path)?;
        names.insert(self.path.clone());
        Ok(file)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // After a rename there is nothing left to remove; what cannot be removed stays.
        if temporary().remove(&self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::HashMap;

    use super::*;

    #[test]
    fn temporary_names_tell_the_file_and_the_process() {
        let name = partial_name("frame_000001.vtu");
        assert!(name.contains(&std::process::id().to_string()), "{name}");
        assert_eq!(of_partial(&name), Some("frame_000001.vtu"));
        assert_eq!(of_partial(".run.pvd.partial"), Some("run.pvd"));
        assert_eq!(of_partial("run.pvd"), None);
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
}
