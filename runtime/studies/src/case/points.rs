//! The points of a scene: a box filled with a lattice, a cloud, a mesh, the inside of a surface.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use piola_grammar::{Diagnostic, suggest};
use piola_mechanics::body::Body;
use piola_mechanics::lattice::Nodes;
use piola_meshes::stl::Filling;
use piola_meshes::{Mesh, MeshPoints, Place, Shape, abaqus, cloud, gmsh, stl};
use piola_output::mesh as output;
use piola_output::read::{self, read_cloud};
use piola_output::summary::{FNV1A64_OF_NOTHING, fnv1a64};

use super::fields::Columns;
use super::{CaseError, error, size};
use crate::scene::selection::{self, typical_spacing};
use crate::scene::{
    HorizonExtent, LatticeShape, Listing, Members, MeshFormat, MeshNodes, MeshShape, Points, Scene,
};

/// Largest file of points or cells that is read, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The column of a cloud that says of which block a point is, and what its groups are called.
const BLOCK_COLUMN: &str = "block_id";
const BLOCK: &str = "block_";

/// The part of its volume by which the points of a surface may miss it without a word.
const NEAR_VOLUME: f64 = 0.05;

/// The points of a scene.
pub(super) struct Filled {
    pub(super) body: Body,
    pub(super) columns: Columns,
    /// The cells that are left of a mesh.
    pub(super) mesh: Option<Arc<output::Mesh>>,
    /// Of the content of all files that they are of; `None` where there are none.
    pub(super) content: Option<u64>,
    pub(super) warnings: Vec<Diagnostic>,
}

/// Files of points, cells and sets, and a hash of all that was read of them.
struct Files<'a> {
    /// They are named relative to it.
    folder: &'a Path,
    content: Option<u64>,
}

impl Files<'_> {
    fn bytes(&mut self, file: &Path) -> Result<Vec<u8>, CaseError> {
        let bytes = error::read_bytes(file, MAX_BYTES)?;
        self.content = Some(fnv1a64(self.content.unwrap_or(FNV1A64_OF_NOTHING), &bytes));
        Ok(bytes)
    }

    fn text(&mut self, file: &Path) -> Result<String, CaseError> {
        error::as_text(file, self.bytes(file)?)
    }
}

/// Points as their file lists them.
struct Listed {
    positions: Vec<f64>,
    volumes: Vec<f64>,
    /// Of a lattice, in m.
    spacing: Option<f64>,
    groups: Groups,
    warnings: Vec<Diagnostic>,
}

/// What groups of points are made of.
enum Groups {
    None,
    Mesh(Box<Mesh>, MeshPoints),
    /// A cloud: its file, its text as it was written, and as a table between commas where that is another.
    Table {
        file: PathBuf,
        made: Option<String>,
        written: String,
    },
}

/// The points of the scene without those that it removes. Of the scene, sets that its files list get their
/// points, and a horizon in mean spacings its radius.
pub(super) fn fill(scene: &mut Scene, folder: &Path) -> Result<Filled, CaseError> {
    let dimension = scene.body.dimension;
    let mut files = Files { folder, content: None };
    let Listed { positions, volumes, spacing, groups, mut warnings } = match &scene.body.points {
        Points::Lattice(shape) => of_lattice(shape)?,
        Points::Cloud { path } => of_cloud(&folder.join(&path.value), dimension, &mut files)?,
        Points::Mesh(shape) => match shape.spacing {
            Some(spacing) => of_surface(shape, spacing, &mut files)?,
            None => of_mesh(scene, shape, &mut files)?,
        },
    };
    let kept = selection::kept(scene, &positions, &volumes, spacing)?;
    list_sets(scene, &mut files, &groups, volumes.len(), &kept.keep)?;
    let rows = positions.chunks_exact(dimension).zip(&volumes).zip(&kept.keep);
    let mut left = (Vec::new(), Vec::new());
    for ((position, volume), _) in rows.filter(|(_, keep)| **keep) {
        left.0.extend_from_slice(position);
        left.1.push(*volume);
    }
    let columns = match &groups {
        Groups::Table { file, made, written } => {
            Columns::read(made.as_ref().unwrap_or(written), scene, &kept.keep)
                .map_err(|errors| CaseError::table(file, written, errors))?
        }
        _ => Columns::default(),
    };
    if let (HorizonExtent::Spacings(count), None) = (scene.horizon.extent, spacing) {
        let mean = typical_spacing(dimension, &left.1, None);
        scene.horizon.extent = HorizonExtent::Radius(count * mean);
    }
    let mesh = match (&groups, &scene.body.points) {
        (Groups::Mesh(mesh, points), Points::Mesh(shape)) => {
            Some(Arc::new(cells_left(mesh, points, shape, &kept.keep)))
        }
        _ => None,
    };
    let body = Body::new(dimension, &left.0, &left.1, spacing);
    let content = files.content;
    warnings.extend(kept.warnings);
    Ok(Filled { body, columns, mesh, content, warnings })
}

fn of_lattice(shape: &LatticeShape) -> Result<Listed, CaseError> {
    size::check_lattice(shape)?;
    let points = shape.lattice().points()?;
    let (positions, volumes) = (points.positions, points.volumes);
    let spacing = Some(shape.spacing);
    Ok(Listed { positions, volumes, spacing, groups: Groups::None, warnings: Vec::new() })
}

fn of_cloud(file: &Path, dimension: usize, files: &mut Files<'_>) -> Result<Listed, CaseError> {
    let written = files.text(file)?;
    let made = match cloud::is_comma_separated(&written) {
        true => None,
        false => Some(
            cloud::as_table(&written)
                .map_err(|error| CaseError::mesh(file, written.as_bytes(), error))?,
        ),
    };
    let table = made.as_ref().unwrap_or(&written);
    let read =
        read_cloud(table, dimension).map_err(|errors| CaseError::table(file, &written, errors))?;
    let groups = Groups::Table { file: file.to_path_buf(), made, written };
    let (positions, volumes) = (read.positions, read.volumes);
    Ok(Listed { positions, volumes, spacing: None, groups, warnings: Vec::new() })
}

fn of_mesh(scene: &Scene, shape: &MeshShape, files: &mut Files<'_>) -> Result<Listed, CaseError> {
    let file = files.folder.join(&shape.path.value);
    let bytes = files.bytes(&file)?;
    let read = match shape.format {
        MeshFormat::Abaqus => abaqus::read,
        _ => gmsh::read,
    };
    let place = match shape.nodes {
        MeshNodes::Cells => Place::Cells,
        MeshNodes::Corners => Place::Corners,
    };
    let told = |error| CaseError::mesh(&file, &bytes, error);
    let mesh = read(&bytes).map_err(told)?;
    let points = mesh.points(place).map_err(told)?;
    let (own, d) = (points.dimension, scene.body.dimension);
    if own != d {
        let message = format!("the mesh has cells of {own} dimensions, and the body has {d}");
        let found = Diagnostic::error("unusable-mesh", shape.path.span, message);
        let found = found.help(format!("write dimension = {own}"));
        return Err(CaseError::Scene(scene.report(vec![found])));
    }
    let scale = if d == 2 { shape.unit * shape.unit } else { shape.unit * shape.unit * shape.unit };
    let positions = points.positions.iter().map(|x| x * shape.unit).collect();
    let volumes: Vec<f64> = points.volumes.iter().map(|volume| volume * scale).collect();
    if let Some(volume) = volumes.iter().find(|volume| !volume.is_normal()) {
        let message = format!("a cell has the volume {volume:e} m^{d}, which no number holds well");
        let found = Diagnostic::error("unusable-mesh", shape.path.span, message);
        let found = found.help("look at `unit`: it is the length of one unit of the file in m");
        return Err(CaseError::Scene(scene.report(vec![found])));
    }
    let groups = Groups::Mesh(Box::new(mesh), points);
    Ok(Listed { positions, volumes, spacing: None, groups, warnings: Vec::new() })
}

fn of_surface(shape: &MeshShape, spacing: f64, files: &mut Files<'_>) -> Result<Listed, CaseError> {
    let file = files.folder.join(&shape.path.value);
    let bytes = files.bytes(&file)?;
    let told = |error| CaseError::mesh(&file, &bytes, error);
    let mut surface = stl::read(&bytes).map_err(told)?;
    surface.triangles.iter_mut().flatten().flatten().for_each(|x| *x *= shape.unit);
    let (low, cells) = surface.lattice(spacing);
    let high = [0, 1, 2].map(|axis| low[axis] + cells[axis] * spacing);
    let (low, high) = (low.to_vec(), high.to_vec());
    size::check_lattice(&LatticeShape { low, high, spacing, nodes: Nodes::Cells })?;
    let Filling { positions, nested } = surface.fill(spacing).map_err(told)?;
    let volumes = vec![spacing * spacing * spacing; positions.len() / 3];
    let filled = volumes.len() as f64 * (spacing * spacing * spacing);
    let warnings = warning_of_volume(shape, filled, surface.volume(), nested).into_iter().collect();
    Ok(Listed { positions, volumes, spacing: Some(spacing), groups: Groups::None, warnings })
}

/// What to know of a surface whose points have another volume in m^3 than it encloses; `nested` is where it is
/// inside itself.
fn warning_of_volume(
    shape: &MeshShape,
    filled: f64,
    enclosed: f64,
    nested: Option<[f64; 2]>,
) -> Option<Diagnostic> {
    if nested.is_none() && (filled / enclosed - 1.0).abs() <= NEAR_VOLUME {
        return None;
    }
    let message =
        format!("the points have {filled:.4e} m^3, and the surface encloses {enclosed:.4e} m^3");
    let found = Diagnostic::warning("surface-volume", shape.path.span, message);
    Some(match nested {
        None => found.help("a smaller `spacing` follows the surface more closely"),
        Some([x, y]) => found
            .label(format!("the line through x = {x:.4e} m, y = {y:.4e} m goes in twice before it goes out"))
            .help(
                "what is inside two surfaces is left empty: join bodies that overlap in the program that drew them; \
                 where a hollow is meant, turn its triangles, and this is not said",
            ),
    })
}

/// The cells of a mesh that are left with their points, for pictures and frames.
fn cells_left(mesh: &Mesh, points: &MeshPoints, shape: &MeshShape, keep: &[bool]) -> output::Mesh {
    let at_corners = shape.nodes == MeshNodes::Corners;
    // Vertices are renumbered: to points that are left, or in the order in which cells that are left use them.
    let mut numbers = vec![u32::MAX; mesh.nodes().len()];
    let mut vertices = Vec::new();
    let push = |node: usize, vertices: &mut Vec<f64>| {
        let x = &mesh.nodes()[node][..points.dimension];
        vertices.extend(x.iter().map(|x| x * shape.unit));
        (vertices.len() / points.dimension - 1) as u32
    };
    if at_corners {
        for node in 0..numbers.len() {
            let point = mesh.point_at(points, node as u32);
            if point.is_some_and(|point| keep[point as usize]) {
                numbers[node] = push(node, &mut vertices);
            }
        }
    }
    let mut cells: Vec<(Shape, Vec<u32>)> = Vec::new();
    for (cell, (form, corners)) in mesh.cells(points).enumerate() {
        let is_left = match at_corners {
            true => corners.iter().all(|node| numbers[*node as usize] != u32::MAX),
            false => keep[cell],
        };
        if !is_left {
            continue;
        }
        let number = |node: &u32| {
            let number = &mut numbers[*node as usize];
            if *number == u32::MAX {
                *number = push(*node as usize, &mut vertices);
            }
            *number
        };
        cells.push((form, corners.iter().map(number).collect()));
    }
    let points_are =
        if at_corners { output::PointsAre::Vertices } else { output::PointsAre::Cells };
    let cells = cells.iter().map(|(form, corners)| (*form, &corners[..]));
    output::Mesh::new(points.dimension, vertices, cells, points_are)
}

/// Gives sets that files list their points; `keep` says which of all points are left.
fn list_sets(
    scene: &mut Scene,
    files: &mut Files<'_>,
    groups: &Groups,
    n_points: usize,
    keep: &[bool],
) -> Result<(), CaseError> {
    let mut wrong = Vec::new();
    let mut blocks = None;
    for set in &mut scene.sets {
        let Members::Listed { by, inside } = &mut set.members else { continue };
        let found = match by {
            Listing::Numbers(path) => {
                let file = files.folder.join(&path.value);
                let text = files.text(&file)?;
                let numbers = cloud::read_numbers(&text, n_points)
                    .map_err(|error| CaseError::mesh(&file, text.as_bytes(), error))?;
                let mut found = vec![false; n_points];
                numbers.into_iter().for_each(|number| found[number] = true);
                Ok(found)
            }
            Listing::Group(name) => match groups {
                Groups::Mesh(mesh, points) => mesh
                    .members(&name.value, points)
                    .ok_or_else(|| mesh.groups().iter().map(|group| group.name.clone()).collect()),
                Groups::Table { file, made, written } => {
                    let blocks = match &blocks {
                        Some(blocks) => blocks,
                        None => blocks.insert(
                            read_blocks(made.as_ref().unwrap_or(written))
                                .map_err(|errors| CaseError::table(file, written, errors))?,
                        ),
                    };
                    of_block(blocks, &name.value)
                }
                Groups::None => Err(Vec::new()),
            },
        };
        match found {
            Ok(found) => {
                let kept = found.iter().zip(keep).filter(|(_, keep)| **keep);
                *inside = Arc::new(kept.map(|(inside, _)| *inside).collect());
            }
            Err(known) => wrong.push((set.members.clone(), known)),
        }
    }
    if wrong.is_empty() {
        return Ok(());
    }
    let names: Vec<&str> = scene.sets.iter().map(|set| set.name.value.as_str()).collect();
    let found = wrong.iter().map(|(members, known)| unknown_group(members, known, &names));
    Err(CaseError::Scene(scene.report(found.collect())))
}

/// Of every point its block; none where the cloud has no such column.
fn read_blocks(text: &str) -> Result<Vec<f64>, Vec<read::TableError>> {
    if !read::column_names(text).iter().any(|name| name == BLOCK_COLUMN) {
        return Ok(Vec::new());
    }
    let rows = read::read_numbers(text, &[BLOCK_COLUMN], |_| None)?;
    Ok(rows.into_iter().map(|row| row[0]).collect())
}

/// The points of `block_3`, or `3`; else the names of the blocks that are there.
fn of_block(blocks: &[f64], name: &str) -> Result<Vec<bool>, Vec<String>> {
    let number = name.strip_prefix(BLOCK).unwrap_or(name).parse::<f64>().ok();
    match number.filter(|number| blocks.contains(number)) {
        Some(number) => Ok(blocks.iter().map(|block| *block == number).collect()),
        None => {
            let mut all = blocks.to_vec();
            all.sort_by(f64::total_cmp);
            all.dedup();
            Err(all.iter().take(MOST_NAMES).map(|block| format!("{BLOCK}{block}")).collect())
        }
    }
}

/// Most names in a message.
const MOST_NAMES: usize = 20;

fn unknown_group(members: &Members, known: &[String], sets: &[&str]) -> Diagnostic {
    let name = match members {
        Members::Listed { by: Listing::Group(name), .. } => name.value.as_str(),
        _ => "",
    };
    let message = format!("the file of the body has no group `{name}`");
    let found = Diagnostic::error("unknown-group", members.span(), message);
    let all = || known.iter().map(String::as_str);
    let others = sets.iter().copied().filter(|set| *set != name);
    if let Some(near) = suggest(name, all().chain(others).take(256)) {
        return found.label(format!("did you mean `{near}`?"));
    }
    let shown: Vec<&str> = all().take(MOST_NAMES).collect();
    let more = if known.len() > MOST_NAMES { ", .." } else { "" };
    match shown[..] {
        [] => found.help("it has no groups: write a condition under [sets], \"X < 0.1\""),
        _ => found.help(format!("its groups are {}{more}", shown.join(", "))),
    }
}
