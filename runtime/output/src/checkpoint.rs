//! `checkpoint.bin`: where a motion stands, so that a run goes on after it was ended, however it was.
//!
//! One line of text, the length of what follows and a header in JSON, the arrays as numbers of 64 bits
//! (little-endian), and FNV-1a (64 bits) of all that. Of a run by many processes each has its part in a file of the same
//! form, and this one names them.

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{self, Read as _, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::atomic::{Operation, write_atomically};
use super::summary::{FNV1A64_OF_NOTHING as START, fnv1a64};
use super::{OutputError, OutputFile, OutputFolder};

/// The first line; another number says another form.
const FIRST: &[u8] = b"piola checkpoint 1\n";

/// Where a run stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint<'a> {
    /// What is known of the run.
    pub header: Header,
    /// The state of the body, by name.
    pub arrays: Vec<(String, Cow<'a, [f64]>)>,
}

/// What a checkpoint knows beside the state of the body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// The scene's file, as it was found.
    pub scene: String,
    /// What was overridden, `KEY=VALUE`.
    pub settings: Vec<String>,
    /// What was run: [`super::summary::scene_hash`].
    pub scene_hash: String,
    /// What the reader was told so far.
    pub notes: Vec<String>,
    /// Lengths of the tables that grow by lines, in bytes.
    pub tables: Vec<u64>,
    /// Of a run by many processes: where the state of the body is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parts: Option<Parts>,
}

/// The parts of a checkpoint, each in a file of its own ([`OutputFile::CheckpointPart`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parts {
    /// How many there are.
    pub n: usize,
    /// Which of the two that take turns: one is whole while the other is written.
    pub turn: usize,
}

impl Header {
    /// The header of a folder's checkpoint, without a look at the rest; nothing where it has none.
    ///
    /// # Errors
    /// As [`Checkpoint::read`].
    pub fn read(folder: &OutputFolder) -> Result<Option<Header>, OutputError> {
        let path = folder.path_of(OutputFile::Checkpoint);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Operation::Read.on(&path)(error)),
        };
        let mut bytes = Vec::new();
        let read = file.take(LONGEST_HEADER).read_to_end(&mut bytes);
        read.map_err(Operation::Read.on(&path))?;
        match split(&bytes).and_then(|(header, _)| serde_json::from_slice::<Written>(header).ok()) {
            Some(written) => Ok(Some(written.header)),
            None => Err(OutputError::Checkpoint { path }),
        }
    }
}

/// In bytes, with what stands before it.
const LONGEST_HEADER: u64 = 1 << 20;

/// The header as it is written.
#[derive(Serialize, Deserialize)]
struct Written {
    #[serde(flatten)]
    header: Header,
    /// Names and lengths.
    arrays: Vec<(String, usize)>,
}

impl Checkpoint<'_> {
    /// Puts it in the place of an earlier one.
    pub fn write(&self, folder: &OutputFolder) -> Result<(), OutputError> {
        self.write_as(&folder.path_of(OutputFile::Checkpoint))
    }

    /// Writes a part of one: of which turn, and which part, into the folder of a run that another process may hold.
    pub fn write_part(
        &self,
        folder: &Path,
        (turn, part): (usize, usize),
    ) -> Result<(), OutputError> {
        self.write_as(&folder.join(OutputFile::CheckpointPart(turn, part).name()))
    }

    fn write_as(&self, path: &Path) -> Result<(), OutputError> {
        let lengths = self.arrays.iter().map(|(name, values)| (name.clone(), values.len()));
        let written = Written { header: self.header.clone(), arrays: lengths.collect() };
        write_atomically(path, |out| {
            let header = serde_json::to_vec(&written).map_err(io::Error::other)?;
            let mut sum = Summed { out, sum: START };
            sum.write_all(FIRST)?;
            sum.write_all(&(header.len() as u64).to_le_bytes())?;
            sum.write_all(&header)?;
            for (_, values) in &self.arrays {
                for value in values.iter() {
                    sum.write_all(&value.to_le_bytes())?;
                }
            }
            let check = sum.sum.to_le_bytes();
            sum.out.write_all(&check)
        })
    }

    /// The checkpoint of a folder; nothing where it has none.
    ///
    /// # Errors
    /// A file that cannot be read, is cut or damaged, or of another form.
    pub fn read(folder: &OutputFolder) -> Result<Option<Checkpoint<'static>>, OutputError> {
        let path = folder.path_of(OutputFile::Checkpoint);
        match fs::symlink_metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            _ => Checkpoint::read_as(path).map(Some),
        }
    }

    /// A part of one, as [`Checkpoint::write_part`] wrote it.
    ///
    /// # Errors
    /// A file that cannot be read, is cut or damaged, or of another form.
    pub fn read_part(
        folder: &Path,
        (turn, part): (usize, usize),
    ) -> Result<Checkpoint<'static>, OutputError> {
        Checkpoint::read_as(folder.join(OutputFile::CheckpointPart(turn, part).name()))
    }

    fn read_as(path: PathBuf) -> Result<Checkpoint<'static>, OutputError> {
        let bytes = fs::read(&path).map_err(Operation::Read.on(&path))?;
        decode(&bytes).ok_or(OutputError::Checkpoint { path })
    }

    /// An array by its name.
    pub fn array(&self, name: &str) -> Option<&[f64]> {
        self.arrays.iter().find(|(known, _)| known == name).map(|(_, values)| &values[..])
    }
}

fn decode(bytes: &[u8]) -> Option<Checkpoint<'static>> {
    let (content, check) = bytes.split_last_chunk::<8>()?;
    if fnv1a64(START, content) != u64::from_le_bytes(*check) {
        return None;
    }
    let (header, mut rest) = split(content)?;
    let written: Written = serde_json::from_slice(header).ok()?;
    let mut arrays = Vec::with_capacity(written.arrays.len());
    for (name, length) in written.arrays {
        let (own, after) = rest.split_at_checked(length.checked_mul(8)?)?;
        let values = own.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes));
        arrays.push((name, Cow::Owned(values.collect())));
        rest = after;
    }
    rest.is_empty().then_some(Checkpoint { header: written.header, arrays })
}

/// The header in JSON, and what follows.
fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.strip_prefix(FIRST)?.split_first_chunk::<8>()?;
    rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)
}

/// Writes on, and sums.
struct Summed<'a> {
    out: &'a mut dyn Write,
    sum: u64,
}

impl Write for Summed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let length = self.out.write(bytes)?;
        self.sum = fnv1a64(self.sum, &bytes[..length]);
        Ok(length)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Checkpoint<'static> {
        let header = Header {
            scene: "a \"b\"/scene.toml".to_owned(),
            settings: vec!["body.spacing=0.1".to_owned()],
            scene_hash: "fnv1a64:0123456789abcdef".to_owned(),
            notes: vec!["the body has become stiffer".to_owned()],
            tables: vec![1, 22, u64::MAX],
            parts: Some(Parts { n: 3, turn: 1 }),
        };
        let special = [0.1, -0.0, f64::NAN, f64::INFINITY, f64::MIN_POSITIVE / 8.0];
        let array = |name: &str, values: &[f64]| (name.to_owned(), Cow::Owned(values.to_vec()));
        let arrays = vec![array("u", &special), array("none", &[]), array("v", &[1e300; 9])];
        Checkpoint { header, arrays }
    }

    #[test]
    fn what_is_written_is_read_bit_for_bit() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        assert_eq!(Checkpoint::read(&folder).unwrap(), None);
        let sample = sample();
        sample.write(&folder).unwrap();
        let read = Checkpoint::read(&folder).unwrap().unwrap();
        assert_eq!(read.header, sample.header);
        assert_eq!(Header::read(&folder).unwrap(), Some(sample.header.clone()));
        assert_eq!(read.arrays.len(), sample.arrays.len());
        for ((name, values), (known, expected)) in read.arrays.iter().zip(&sample.arrays) {
            assert_eq!(name, known);
            let bits = |values: &[f64]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(values), bits(expected));
        }
    }

    #[test]
    fn cut_or_damaged_files_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        sample().write(&folder).unwrap();
        let bytes = fs::read(folder.path_of(OutputFile::Checkpoint)).unwrap();
        assert!(decode(&bytes).is_some());
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length]).is_none(), "cut at {length}");
        }
        for place in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[place] ^= 0x40;
            assert!(decode(&damaged).is_none(), "damage at {place}");
        }
    }
}
