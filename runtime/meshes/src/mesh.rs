//! Elements with their nodes and groups, and the points of a body that they become.

use rustc_hash::FxHashMap;

use crate::error::MeshError;
use crate::kind::{Degenerate, Kind, Rule, Shape};

/// No point.
const NONE: u32 = u32::MAX;

/// Coordinates of a plane mesh differ by less than this part of its size across the plane.
const FLAT: f64 = 1e-9;

/// Kinds of entities, which groups without a name are called after, by their dimensions.
pub(crate) const ENTITIES: [&str; 4] = ["point", "curve", "surface", "volume"];

/// Elements, their nodes, and groups of both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    nodes: Vec<[f64; 3]>,
    elements: Vec<Element>,
    /// Indices of nodes, element after element.
    connectivity: Vec<u32>,
    groups: Vec<Group>,
    /// Whether names are in lower case, whatever they are asked for in.
    pub(crate) ignores_case: bool,
    /// Places of groups by their names.
    names: FxHashMap<String, usize>,
}

/// One element of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Element {
    kind: Kind,
    /// Where its nodes begin.
    start: usize,
    /// Its number in the file.
    tag: u64,
    /// Where it stands in the file: the range of bytes of its first number or line.
    place: (usize, usize),
    is_text: bool,
}

/// Elements and nodes under one name.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Its name; its number where it has none.
    pub name: String,
    /// Indices of elements.
    pub(crate) elements: Vec<u32>,
    /// Indices of nodes.
    pub(crate) nodes: Vec<u32>,
}

/// Where points stand in a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// At the centres of gravity of the cells, with their volumes.
    Cells,
    /// At the corners of the cells; each cell's volume is shared by its corners alike.
    Corners,
}

/// A mesh as points with volumes.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPoints {
    /// 2 or 3.
    pub dimension: usize,
    /// `n x d` row by row, in the file's unit of length.
    pub positions: Vec<f64>,
    /// In that unit to the power of d; all positive.
    pub volumes: Vec<f64>,
    place: Place,
    /// Indices of the elements that are cells.
    cells: Vec<u32>,
    /// Of every node its point, where points stand at corners.
    of_node: Vec<u32>,
}

impl Mesh {
    pub(crate) fn with_nodes(nodes: Vec<[f64; 3]>) -> Mesh {
        Mesh { nodes, ..Mesh::default() }
    }

    /// Adds nodes behind those that are there.
    pub(crate) fn push_nodes(&mut self, nodes: &[[f64; 3]]) {
        self.nodes.extend_from_slice(nodes);
    }

    /// Adds the elements of another mesh, whose nodes begin at `first` here.
    pub(crate) fn push_all(&mut self, other: &Mesh, first: u32) {
        for element in &other.elements {
            let Element { kind, tag, place, is_text, .. } = *element;
            let nodes = other.nodes_of(element).iter().map(|node| node + first);
            self.push(kind, nodes, (tag, place, is_text));
        }
    }

    /// The form of an element and its corners.
    pub(crate) fn shape_at(&self, element: u32) -> (Shape, Vec<u32>) {
        let element = &self.elements[element as usize];
        (element.kind.shape, self.corners_of(element).to_vec())
    }

    /// The nodes of an element.
    pub(crate) fn nodes_at(&self, element: u32) -> &[u32] {
        self.nodes_of(&self.elements[element as usize])
    }

    pub(crate) fn n_nodes(&self) -> usize {
        self.nodes.len()
    }

    pub(crate) fn n_elements(&self) -> usize {
        self.elements.len()
    }

    /// Adds an element whose nodes exist; its index.
    pub(crate) fn push(
        &mut self,
        kind: Kind,
        nodes: impl Iterator<Item = u32>,
        (tag, place, is_text): (u64, (usize, usize), bool),
    ) -> u32 {
        let start = self.connectivity.len();
        self.connectivity.extend(nodes);
        self.elements.push(Element { kind, start, tag, place, is_text });
        (self.elements.len() - 1) as u32
    }

    /// The group of this name, made where there is none.
    pub(crate) fn group(&mut self, name: &str) -> &mut Group {
        let place = self.names.get(name).copied().unwrap_or_else(|| {
            self.groups.push(Group { name: name.into(), elements: vec![], nodes: vec![] });
            self.names.insert(name.into(), self.groups.len() - 1);
            self.groups.len() - 1
        });
        &mut self.groups[place]
    }

    /// The groups of the file.
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// The largest dimension of its elements.
    pub fn dimension(&self) -> usize {
        let dimensions = self.elements.iter().map(|element| element.kind.shape.dimension());
        dimensions.max().unwrap_or(0)
    }

    fn nodes_of(&self, element: &Element) -> &[u32] {
        &self.connectivity[element.start..element.start + element.kind.nodes]
    }

    fn corners_of(&self, element: &Element) -> &[u32] {
        &self.nodes_of(element)[..element.kind.shape.n_corners()]
    }

    /// Elements that are listed twice, as a file does where they are of two groups, become one.
    pub(crate) fn merge_duplicates(&mut self) {
        let mut order: Vec<u32> = (0..self.elements.len() as u32).collect();
        let key = |index: &u32| {
            let element = &self.elements[*index as usize];
            (element.kind.nodes, self.nodes_of(element), *index)
        };
        order.sort_unstable_by(|a, b| key(a).cmp(&key(b)));
        let mut first = vec![0; order.len()];
        let mut previous: Option<u32> = None;
        for &index in &order {
            let same = previous.filter(|p| key(p).0 == key(&index).0 && key(p).1 == key(&index).1);
            let representative = same.unwrap_or(index);
            first[index as usize] = representative;
            previous = Some(representative);
        }
        let mut renumbered = vec![NONE; order.len()];
        let mut elements = Vec::with_capacity(self.elements.len());
        for (index, element) in self.elements.iter().enumerate() {
            if first[index] as usize == index {
                renumbered[index] = elements.len() as u32;
                elements.push(*element);
            }
        }
        self.elements = elements;
        for group in &mut self.groups {
            let kept = |index: &mut u32| *index = renumbered[first[*index as usize] as usize];
            group.elements.iter_mut().for_each(kept);
        }
    }

    /// The points of a body.
    ///
    /// # Errors
    /// No elements of two or three dimensions; elements that are flat or turned inside out, coordinates or
    /// volumes that no number holds; plane elements that do not lie in the plane of x and y.
    pub fn points(&self, place: Place) -> Result<MeshPoints, MeshError> {
        let dimension = self.dimension();
        if dimension < 2 {
            let message = "the mesh has no cells: no elements of two or three dimensions";
            return Err(MeshError::unusable((0, 0), message)
                .help("export its solid or plane elements; in Gmsh their physical group, too"));
        }
        let is_cell = |i: &u32| self.elements[*i as usize].kind.shape.dimension() == dimension;
        let cells: Vec<u32> = (0..self.elements.len() as u32).filter(is_cell).collect();
        if dimension == 2 {
            self.check_plane(&cells)?;
        }
        let mut rules: FxHashMap<Kind, Rule> = FxHashMap::default();
        let mut of_node = vec![NONE; if place == Place::Corners { self.nodes.len() } else { 0 }];
        let mut points = MeshPoints {
            dimension,
            positions: Vec::new(),
            volumes: Vec::new(),
            place,
            cells: Vec::new(),
            of_node: Vec::new(),
        };
        let mut shares = vec![0.0; of_node.len()];
        let mut nodes = Vec::new();
        for &cell in &cells {
            let element = &self.elements[cell as usize];
            nodes.clear();
            nodes.extend(self.nodes_of(element).iter().map(|node| self.nodes[*node as usize]));
            let rule = rules.entry(element.kind).or_insert_with(|| Rule::new(element.kind));
            let measured = rule.measure(&nodes);
            let (volume, centre) = measured.map_err(|why| degenerate(element, why, dimension))?;
            match place {
                Place::Cells => {
                    points.positions.extend_from_slice(&centre[..dimension]);
                    points.volumes.push(volume);
                }
                Place::Corners => {
                    let share = volume / element.kind.shape.n_corners() as f64;
                    for &corner in self.corners_of(element) {
                        shares[corner as usize] += share;
                    }
                }
            }
        }
        for (node, share) in shares.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            of_node[node] = points.volumes.len() as u32;
            points.positions.extend_from_slice(&self.nodes[node][..dimension]);
            points.volumes.push(*share);
        }
        points.cells = cells;
        points.of_node = of_node;
        Ok(points)
    }

    fn check_plane(&self, cells: &[u32]) -> Result<(), MeshError> {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &cell in cells {
            for &node in self.nodes_of(&self.elements[cell as usize]) {
                let x = self.nodes[node as usize];
                for axis in 0..3 {
                    (low[axis], high[axis]) = (low[axis].min(x[axis]), high[axis].max(x[axis]));
                }
            }
        }
        let size = (high[0] - low[0]).max(high[1] - low[1]).max(high[2] - low[2]);
        if high[2] - low[2] <= FLAT * size {
            return Ok(());
        }
        let first = &self.elements[cells[0] as usize];
        let message = format!(
            "the mesh is a surface in space: its z reaches from {} to {}, and it has no solid elements",
            low[2], high[2]
        );
        Err(MeshError::unusable(first.place, message)
            .help("mesh the solid, or turn the sheet into the plane of x and y"))
    }

    /// The group of this name; of a number that of its kind of entity, `curve 3`, if there is one alone.
    fn named(&self, name: &str) -> Option<usize> {
        let lower = self.ignores_case.then(|| name.to_lowercase());
        let known = self.names.get(lower.as_deref().unwrap_or(name)).copied();
        let numbered = || {
            let mut found =
                ENTITIES.iter().filter_map(|kind| self.names.get(&format!("{kind} {name}")));
            found.next().copied().filter(|_| found.next().is_none())
        };
        known.or_else(numbered)
    }

    /// Which of its points are in the group of this name; nothing where there is none.
    ///
    /// Cells are in a group that names them or their faces, edges or corners. Of a group of nodes those
    /// cells are with a face all of whose corners are; where there is none, all that have one of the nodes.
    /// Points at corners are in a group that names them or elements they are corners of.
    pub fn members(&self, name: &str, points: &MeshPoints) -> Option<Vec<bool>> {
        let group = &self.groups[self.named(name)?];
        let mut inside = vec![false; points.volumes.len()];
        match points.place {
            Place::Corners => {
                let of = |element: &u32| self.corners_of(&self.elements[*element as usize]);
                let corners = group.elements.iter().flat_map(of);
                for node in corners.chain(&group.nodes) {
                    let point = points.of_node[*node as usize];
                    if point != NONE {
                        inside[point as usize] = true;
                    }
                }
            }
            Place::Cells => {
                self.mark_cells_of_elements(group, points, &mut inside);
                self.mark_cells_of_nodes(group, points, &mut inside);
            }
        }
        Some(inside)
    }

    fn mark_cells_of_elements(&self, group: &Group, points: &MeshPoints, inside: &mut [bool]) {
        let mut own = vec![false; self.elements.len()];
        group.elements.iter().for_each(|element| own[*element as usize] = true);
        // Of elements of lower dimension, by their least corner.
        let mut parts: FxHashMap<u32, Vec<u32>> = FxHashMap::default();
        for &index in &group.elements {
            let element = &self.elements[index as usize];
            if element.kind.shape.dimension() < points.dimension {
                let least = self.corners_of(element).iter().min();
                least.into_iter().for_each(|least| parts.entry(*least).or_default().push(index));
            }
        }
        for (point, &cell) in points.cells.iter().enumerate() {
            let corners = self.corners_of(&self.elements[cell as usize]);
            let has = |part: &u32| {
                let part = self.corners_of(&self.elements[*part as usize]);
                part.iter().all(|corner| corners.contains(corner))
            };
            let mut near = corners.iter().filter_map(|corner| parts.get(corner)).flatten();
            inside[point] |= own[cell as usize] || near.any(has);
        }
    }

    fn mark_cells_of_nodes(&self, group: &Group, points: &MeshPoints, inside: &mut [bool]) {
        if group.nodes.is_empty() {
            return;
        }
        let mut own = vec![false; self.nodes.len()];
        group.nodes.iter().for_each(|node| own[*node as usize] = true);
        let is_own = |corner: &u32| own[*corner as usize];
        let mut has_faces = false;
        let mut touched = Vec::new();
        for (point, &cell) in points.cells.iter().enumerate() {
            let element = &self.elements[cell as usize];
            let corners = self.corners_of(element);
            if !corners.iter().any(is_own) {
                continue;
            }
            touched.push(point);
            let faces = element.kind.shape.faces();
            if faces.iter().any(|face| face.iter().all(|k| is_own(&corners[*k]))) {
                inside[point] = true;
                has_faces = true;
            }
        }
        if !has_faces {
            touched.into_iter().for_each(|point| inside[point] = true);
        }
    }

    /// The point at a node, where points stand at corners.
    pub fn point_at(&self, points: &MeshPoints, node: u32) -> Option<u32> {
        points.of_node.get(node as usize).copied().filter(|point| *point != NONE)
    }

    /// The cells as shapes between nodes: of each its shape and its corners.
    pub fn cells<'a>(
        &'a self,
        points: &'a MeshPoints,
    ) -> impl Iterator<Item = (Shape, &'a [u32])> + 'a {
        points.cells.iter().map(|cell| {
            let element = &self.elements[*cell as usize];
            (element.kind.shape, self.corners_of(element))
        })
    }

    /// Where the nodes are, in the file's unit of length.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.nodes
    }
}

fn degenerate(element: &Element, why: Degenerate, dimension: usize) -> MeshError {
    let tag = element.tag;
    let (message, help) = match why {
        Degenerate::Empty => (
            format!("element {tag} has no {}", if dimension == 2 { "area" } else { "volume" }),
            "its nodes lie in one place, line or plane: repair the mesh, or its unit of length",
        ),
        Degenerate::Folded => (
            format!("element {tag} is turned inside out in a part of it"),
            "its nodes are in a wrong order, or too far from those of a regular element: repair the \
             mesh",
        ),
    };
    let error = MeshError::unusable(element.place, message).help(help);
    if element.is_text { error } else { error.in_binary() }
}
