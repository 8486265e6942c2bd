//! Gmsh's `.msh` files, versions 2.2 and 4.1, as text or binary ("MSH file format" of its reference manual).
//!
//! Physical groups become groups by their names, `curve 3` where they have none. Elements of no
//! group belong to the mesh as well.

mod elements;
mod v2;
mod v4;

use rustc_hash::FxHashMap;

use crate::error::MeshError;
use crate::kind::Kind;
use crate::mesh::{ENTITIES, Mesh};
use crate::scan::{Line, Scan, shown};

/// Reads a mesh.
///
/// # Errors
/// Anything that breaks the format; versions, precisions and elements that are not read.
pub fn read(bytes: &[u8]) -> Result<Mesh, MeshError> {
    let mut scan = Scan::new(bytes);
    let mut file = File::default();
    let version = format(&mut scan)?;
    while let Some(line) = next_section(&mut scan)? {
        let name = &line.text[1..];
        match (name, version) {
            (b"PhysicalNames", _) => file.physical_names(&mut scan)?,
            (b"Entities", Version::Four) => file.entities(&mut scan)?,
            (b"Nodes", Version::Four) => file.nodes_of_blocks(&mut scan)?,
            (b"Elements", Version::Four) => file.elements_of_blocks(&mut scan)?,
            (b"Nodes", Version::Two) => file.nodes(&mut scan)?,
            (b"Elements", Version::Two) => file.elements(&mut scan)?,
            (b"PartitionedEntities", _) => {
                let message = "the mesh is cut into parts";
                return Err(MeshError::unusable(line.range(), message)
                    .help("save it whole: in Gmsh, Mesh > Unpartition"));
            }
            _ => {
                skip_section(&mut scan, &line)?;
                continue;
            }
        }
        end_section(&mut scan, &line)?;
    }
    if !file.has_nodes {
        let end = bytes.len();
        return Err(MeshError::broken((end, end), "the file has no $Nodes"));
    }
    file.mesh.merge_duplicates();
    Ok(file.mesh)
}

/// The versions that are read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Version {
    Two,
    Four,
}

/// What of a file is read so far.
#[derive(Default)]
struct File {
    mesh: Mesh,
    /// Names of physical groups by dimension and number.
    names: FxHashMap<(i64, i64), String>,
    /// Physical groups of entities by dimension and number.
    groups: FxHashMap<(i64, i64), Vec<i64>>,
    /// Indices of nodes by their numbers.
    index: FxHashMap<u64, u32>,
    has_nodes: bool,
}

impl File {
    /// The name of a physical group.
    fn name(&self, dimension: usize, tag: i64) -> String {
        let tag = tag.abs();
        let name = self.names.get(&(dimension as i64, tag));
        name.cloned().unwrap_or_else(|| format!("{} {tag}", ENTITIES[dimension.min(3)]))
    }

    fn physical_names(&mut self, scan: &mut Scan<'_>) -> Result<(), MeshError> {
        // Text in binary files, too.
        let binary = std::mem::replace(&mut scan.binary, false);
        let count = scan.size("the number of names")?;
        let count = scan.count(count, 6, "names")?;
        for _ in 0..count {
            let dimension = scan.int("the dimension of a physical group")?;
            let tag = scan.int("the number of a physical group")?;
            let line = scan.line().unwrap_or(Line { text: b"", start: scan.bytes.len() });
            let quoted = line.text.strip_prefix(b"\"").and_then(|text| text.strip_suffix(b"\""));
            let Some(name) = quoted.and_then(|name| std::str::from_utf8(name).ok()) else {
                let message = "the name of a physical group should stand here in quotes";
                return Err(MeshError::broken(line.range(), message));
            };
            self.names.insert((dimension, tag), name.to_string());
        }
        scan.binary = binary;
        Ok(())
    }

    /// Remembers a node by its number.
    fn number_node(&mut self, tag: u64, scan: &Scan<'_>) -> Result<(), MeshError> {
        let index = self.index.len() as u32;
        match self.index.insert(tag, index) {
            None => Ok(()),
            Some(_) => Err(scan.error(format!("there are two nodes {tag}"))),
        }
    }

    /// The index of a node that an element names.
    fn node(&self, tag: u64, element: u64, scan: &Scan<'_>) -> Result<u32, MeshError> {
        self.index.get(&tag).copied().ok_or_else(|| {
            scan.error(format!("element {element} has a node {tag}, and there is none"))
        })
    }

    fn take_nodes(&mut self, nodes: Vec<[f64; 3]>, scan: &Scan<'_>) -> Result<(), MeshError> {
        if std::mem::replace(&mut self.has_nodes, true) {
            return Err(scan.error("there are two sections $Nodes"));
        }
        self.mesh = Mesh::with_nodes(nodes);
        Ok(())
    }
}

fn format(scan: &mut Scan<'_>) -> Result<Version, MeshError> {
    let Some(line) = scan.filled_line().filter(|line| line.text == b"$MeshFormat") else {
        return Err(MeshError::broken((0, 0), "the file does not begin with $MeshFormat")
            .help("it is none of Gmsh's .msh files"));
    };
    let (version, place) = scan.word("the version of the format")?;
    let is_binary = scan.int("0 for text or 1 for binary")?;
    let size = scan.int("the size of numbers")?;
    let known = match version {
        "4.1" => Version::Four,
        "2" | "2.0" | "2.1" | "2.2" => Version::Two,
        other => {
            let message = format!("version {} of the format is not read", shown(other));
            return Err(MeshError::unusable(place, message).help(
                "save it as version 4.1 or 2.2: gmsh -format msh41, or Mesh.MshFileVersion",
            ));
        }
    };
    if size != 8 {
        return Err(scan.error(format!("numbers have {size} bytes: 8 are read")));
    }
    if is_binary == 1 {
        scan.line();
        scan.binary = true;
        if scan.int("the number 1 in this machine's order of bytes")? != 1 {
            return Err(scan
                .error("the file was written on a machine with another order of bytes")
                .help("save it as text"));
        }
    } else if is_binary != 0 {
        return Err(scan.error(format!("text is 0 and binary 1, not {is_binary}")));
    }
    end_section(scan, &line)?;
    Ok(known)
}

/// The line `$Name` of the next section.
fn next_section<'a>(scan: &mut Scan<'a>) -> Result<Option<Line<'a>>, MeshError> {
    let Some(line) = scan.filled_line() else { return Ok(None) };
    if line.text.len() > 1 && line.text[0] == b'$' && !line.text.starts_with(b"$End") {
        return Ok(Some(line));
    }
    let message = "a section, `$Name`, should begin here";
    let error = MeshError::broken((line.start, line.start), message);
    Err(if scan.binary { error.in_binary() } else { error })
}

fn end_section(scan: &mut Scan<'_>, begin: &Line<'_>) -> Result<(), MeshError> {
    let name = String::from_utf8_lossy(&begin.text[1..]);
    let expected = format!("$End{name}");
    match scan.filled_line() {
        Some(line) if line.text == expected.as_bytes() => Ok(()),
        Some(line) => {
            let message =
                format!("`{expected}` should stand here: more or less follows than announced");
            let error = MeshError::broken((line.start, line.start), message);
            Err(if scan.binary { error.in_binary() } else { error })
        }
        None => {
            let end = scan.bytes.len();
            let message = format!("the file ends where `{expected}` should stand");
            Err(MeshError::broken((end, end), message).help("it was cut: write or copy it again"))
        }
    }
}

/// Goes behind the end of a section that is of no use here.
fn skip_section(scan: &mut Scan<'_>, begin: &Line<'_>) -> Result<(), MeshError> {
    let end = [b"$End", &begin.text[1..]].concat();
    let rest = &scan.bytes[scan.at..];
    match rest.windows(end.len()).position(|window| window == end) {
        Some(at) => {
            scan.at += at + end.len();
            scan.line();
            Ok(())
        }
        None => {
            let message = format!("`{}` is missing", String::from_utf8_lossy(&end));
            let end = scan.bytes.len();
            Err(MeshError::broken((end, end), message).help("the file was cut"))
        }
    }
}

/// The kind of a type of elements.
fn kind(number: i64, scan: &Scan<'_>) -> Result<Kind, MeshError> {
    elements::kind(number).ok_or_else(|| {
        let message = format!("elements of type {number} are not read");
        let mut error = scan.error(message);
        error.diagnostic.code = "unusable-mesh";
        error.help("save the mesh with elements of first or second order: Mesh.ElementOrder")
    })
}
