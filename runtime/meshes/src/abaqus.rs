//! Abaqus's `.inp` files: nodes, elements and sets of a flat file, or of parts and their instances
//! ("Input Syntax Rules" and the keyword reference of its manual).
//!
//! | keyword | what becomes of it |
//! |---|---|
//! | `*Node`, `*Element` | nodes and elements; types that are no part of a body (springs, masses, beams) are left out, others that are not read are refused |
//! | `*Nset`, `*Elset`, also `generate`, and the sets that `*Node` and `*Element` name | groups |
//! | `*Surface` | a group of the faces, elements or nodes that it lists |
//! | `*Part`, `*Instance` | the part's mesh, shifted and turned as the instance says |
//! | what makes nodes or elements elsewhere (`*Include`, `*Ngen`, ..) | refused |
//! | any other | passed over |

mod keyword;
mod part;

use rustc_hash::FxHashMap;

use crate::error::MeshError;
use crate::mesh::Mesh;
use crate::scan::Line;
use keyword::{Cards, Keyword};
use part::{Motion, Part};

/// Keywords that make a mesh of what stands elsewhere.
const REFUSED: [&str; 8] =
    ["include", "ngen", "nfill", "ncopy", "elgen", "elcopy", "system", "nmap"];

/// Reads a mesh.
///
/// # Errors
/// Anything that breaks the format; nodes and elements that are made by other keywords.
pub fn read(bytes: &[u8]) -> Result<Mesh, MeshError> {
    let mut cards = Cards::new(bytes);
    let mut file = File::default();
    while let Some(keyword) = cards.next_keyword()? {
        file.take(&keyword, &mut cards)?;
    }
    file.finish(bytes.len())
}

/// What of a file is read so far.
#[derive(Default)]
struct File {
    /// The flat file, or what stands outside parts.
    whole: Part,
    parts: Vec<(String, Part)>,
    instances: Vec<Instance>,
    /// Where keywords put what they say.
    within: Within,
}

/// A part at its place.
struct Instance {
    name: String,
    part: usize,
    motion: Motion,
    /// Sets of the assembly that name it: the set, whether of nodes, and what is in it.
    sets: Vec<(String, bool, Vec<u32>)>,
}

#[derive(Clone, Copy, Default, PartialEq)]
enum Within {
    #[default]
    Whole,
    Part(usize),
    Instance(usize),
}

impl File {
    fn take(&mut self, keyword: &Keyword<'_>, cards: &mut Cards<'_>) -> Result<(), MeshError> {
        let name = keyword.name.as_str();
        if REFUSED.contains(&name) || keyword.value("input").is_some() {
            let message = format!("`*{}` makes a mesh of what stands elsewhere", keyword.name);
            return Err(MeshError::unusable(keyword.line.range(), message)
                .help("write the whole mesh into one file: nodes, elements and sets"));
        }
        match name {
            "part" => {
                let part = keyword.required("name")?;
                self.parts.push((part.to_lowercase(), Part::default()));
                self.within = Within::Part(self.parts.len() - 1);
            }
            "end part" | "end instance" => self.within = Within::Whole,
            "instance" => self.instance(keyword, cards)?,
            "node" | "element" | "nset" | "elset" | "surface" => self.mesh(keyword, cards)?,
            _ => {}
        }
        Ok(())
    }

    fn instance(&mut self, keyword: &Keyword<'_>, cards: &mut Cards<'_>) -> Result<(), MeshError> {
        let name = keyword.required("name")?.to_lowercase();
        let part = keyword.required("part")?;
        let found = self.parts.iter().position(|(name, _)| *name == part.to_lowercase());
        let Some(part) = found else {
            let message = format!("there is no part `{part}` before this line");
            return Err(MeshError::broken(keyword.line.range(), message));
        };
        let mut rows = Vec::new();
        while let Some(line) = cards.next_data() {
            rows.push(line);
        }
        self.instances.push(Instance { name, part, motion: Motion::read(&rows)?, sets: vec![] });
        self.within = Within::Instance(self.instances.len() - 1);
        Ok(())
    }

    fn mesh(&mut self, keyword: &Keyword<'_>, cards: &mut Cards<'_>) -> Result<(), MeshError> {
        let of_instance = match keyword.value("instance") {
            Some(name) => {
                let found = self.instances.iter().position(|i| i.name == name.to_lowercase());
                Some(found.ok_or_else(|| {
                    let message = format!("there is no instance `{name}` before this line");
                    MeshError::broken(keyword.line.range(), message)
                })?)
            }
            None => match self.within {
                Within::Instance(instance) => Some(instance),
                _ => None,
            },
        };
        let is_set = matches!(keyword.name.as_str(), "nset" | "elset");
        if let Some(instance) = of_instance {
            if !is_set {
                let message = format!("`*{}` of an instance is not read", keyword.name);
                return Err(MeshError::unusable(keyword.line.range(), message)
                    .help("write the mesh into its part"));
            }
            let (number, is_nodes) = (self.instances[instance].part, keyword.name == "nset");
            let name = keyword.required(&keyword.name)?.to_lowercase();
            let members = self.parts[number].1.members(keyword, is_nodes, cards)?;
            self.instances[instance].sets.push((name, is_nodes, members));
            return Ok(());
        }
        let has_own_sets = self.parts.is_empty() || self.within != Within::Whole;
        let part = match self.within {
            Within::Part(part) => &mut self.parts[part].1,
            _ => &mut self.whole,
        };
        if self.within == Within::Whole && keyword.name == "surface" && !self.instances.is_empty() {
            // Of the assembly: its sets are not those of a part.
            return Ok(());
        }
        match keyword.name.as_str() {
            "node" => part.nodes(keyword, cards),
            "element" => part.elements(keyword, cards),
            "surface" => part.surface(keyword, cards),
            _ if has_own_sets => part.set(keyword, cards),
            _ => {
                let message = "this set names no instance, and the file has parts";
                // Of reference points and other things of the assembly.
                if part.mesh.n_nodes() > 0 || keyword.value("internal").is_some() {
                    return Ok(());
                }
                Err(MeshError::broken(keyword.line.range(), message)
                    .help("write `instance=` and its name"))
            }
        }
    }

    fn finish(self, end: usize) -> Result<Mesh, MeshError> {
        let skipped = |part: &Part| part.skipped_types.join(", ");
        let mut mesh = Mesh::default();
        let mut left_out = skipped(&self.whole);
        if self.instances.is_empty() {
            mesh = match self.parts.into_iter().next() {
                Some((_, part)) if self.whole.mesh.n_elements() == 0 => {
                    left_out = skipped(&part);
                    part.into_mesh()
                }
                _ => self.whole.into_mesh(),
            };
        } else {
            let several = self.instances.len() > 1;
            for instance in &self.instances {
                let part = &self.parts[instance.part].1;
                let prefix = several.then_some(instance.name.as_str());
                part.add_to(&mut mesh, &instance.motion, prefix, &instance.sets);
                left_out += &skipped(part);
            }
        }
        if mesh.n_nodes() == 0 {
            return Err(MeshError::broken((end, end), "the file has no nodes")
                .help("it is no input file of Abaqus with `*Node` and `*Element`"));
        }
        if mesh.dimension() < 2 && !left_out.is_empty() {
            let message =
                format!("the mesh has no cells: elements of the types {left_out} are not read");
            return Err(MeshError::unusable((end, end), message)
                .help("write solids as C3D4, C3D5, C3D6, C3D8, C3D10, C3D15 or C3D20, sheets as CPS3, CPS4, CPS6 or CPS8"));
        }
        mesh.ignores_case = true;
        mesh.merge_duplicates();
        Ok(mesh)
    }
}

/// Numbers of things by what a file calls them.
type Numbers = FxHashMap<u64, u32>;

/// The fields of a line, between commas, and where they stand; of an empty last one nothing.
fn fields<'a>(line: &Line<'a>) -> impl Iterator<Item = (&'a str, (usize, usize))> + use<'a> {
    let start = line.start;
    let text = std::str::from_utf8(line.text).unwrap_or("\u{fffd}");
    let mut at = start;
    let all = text.split(',').map(move |field| {
        let from = at + field.len() - field.trim_start().len();
        at += field.len() + 1;
        (field.trim(), (from, from + field.trim().len()))
    });
    let n = text.split(',').count();
    all.enumerate().filter(move |(k, (field, _))| k + 1 < n || !field.is_empty()).map(|(_, f)| f)
}
