//! A part: its nodes, elements and sets, and where an instance puts it.

use rustc_hash::FxHashSet;

use super::keyword::{Cards, Keyword, text};
use super::{Numbers, fields};
use crate::error::MeshError;
use crate::kind::{Kind, Shape};
use crate::mesh::Mesh;
use crate::scan::{Line, shown};

/// Types that are no part of a body by their beginnings: beams, springs, masses, connections, rigid parts.
const LEFT_OUT: [&str; 17] = [
    "B2", "B3", "CONN", "DASHPOT", "DCOUP", "DISTRIB", "FRAME", "GAP", "HEATCAP", "ITS", "JOINT",
    "MASS", "PIPE", "R2D", "RB", "ROTARY", "SPRING",
];

/// A mesh as it is read.
#[derive(Default)]
pub(super) struct Part {
    pub(super) mesh: Mesh,
    nodes: Vec<[f64; 3]>,
    node: Numbers,
    element: Numbers,
    /// Elements that are left out.
    skipped: FxHashSet<u64>,
    /// Their types.
    pub(super) skipped_types: Vec<String>,
}

impl Part {
    /// `*Node`
    pub(super) fn nodes(
        &mut self,
        keyword: &Keyword<'_>,
        cards: &mut Cards<'_>,
    ) -> Result<(), MeshError> {
        if keyword.value("system").is_some_and(|system| !system.eq_ignore_ascii_case("r")) {
            let message = "coordinates that are not rectangular are not read";
            return Err(MeshError::unusable(keyword.line.range(), message)
                .help("write nodes with x, y and z"));
        }
        let mut added = Vec::new();
        while let Some(line) = cards.next_data() {
            text(&line)?;
            let mut fields = fields(&line);
            let Some((first, place)) = fields.next() else { continue };
            let tag = number(first, place, "the number of a node")?;
            let mut x = [0.0; 3];
            for (x, (field, place)) in x.iter_mut().zip(fields) {
                *x = float(field, place, "a coordinate of a node")?;
            }
            if self.node.insert(tag, self.nodes.len() as u32).is_some() {
                return Err(MeshError::broken(place, format!("there are two nodes {tag}")));
            }
            added.push(self.nodes.len() as u32);
            self.nodes.push(x);
        }
        self.mesh.push_nodes(&self.nodes[self.mesh.n_nodes()..]);
        if let Some(set) = keyword.value("nset") {
            self.mesh.group(&set.to_lowercase()).nodes.extend(added);
        }
        Ok(())
    }

    /// `*Element`
    pub(super) fn elements(
        &mut self,
        keyword: &Keyword<'_>,
        cards: &mut Cards<'_>,
    ) -> Result<(), MeshError> {
        let name = keyword.required("type")?.to_uppercase();
        let kind = kind(&name);
        if kind.is_none() && !LEFT_OUT.iter().any(|prefix| name.starts_with(prefix)) {
            let message = format!("elements of the type {} are not read", shown(&name));
            return Err(MeshError::unusable(keyword.line.range(), message).help(
                "write solids as C3D4, C3D5, C3D6, C3D8, C3D10, C3D15 or C3D20, sheets as CPS3, CPS4, CPS6 \
                 or CPS8, or leave them out",
            ));
        }
        if kind.is_none() && !self.skipped_types.contains(&name) {
            self.skipped_types.push(name);
        }
        let mut added = Vec::new();
        let mut nodes: Vec<u32> = Vec::new();
        while let Some(line) = cards.next_data() {
            let mut all = fields(&line);
            let Some((first, place)) = all.next() else { continue };
            let tag = number(first, place, "the number of an element")?;
            let Some((kind, order)) = kind else {
                self.skipped.insert(tag);
                continue;
            };
            nodes.clear();
            let mut current = line;
            loop {
                let missing = kind.nodes - nodes.len();
                let mut here = 0;
                for (field, place) in all.by_ref() {
                    here += 1;
                    if here > missing {
                        let message = format!("element {tag} has more than {} nodes", kind.nodes);
                        return Err(MeshError::broken(place, message));
                    }
                    nodes.push(self.node_of(tag, field, place)?);
                }
                if nodes.len() == kind.nodes {
                    break;
                }
                // An element goes on behind a comma at the end of its line.
                let goes_on = current.text.ends_with(b",");
                let Some(next) = goes_on.then(|| cards.next_data()).flatten() else {
                    let message = format!(
                        "element {tag} has {} nodes instead of {}",
                        nodes.len(),
                        kind.nodes
                    );
                    return Err(MeshError::broken(current.range(), message));
                };
                current = next;
                all = fields(&current);
            }
            if self.element.insert(tag, self.mesh.n_elements() as u32).is_some() {
                return Err(MeshError::broken(place, format!("there are two elements {tag}")));
            }
            let ordered = (0..kind.nodes).map(|k| nodes[order.get(k).copied().unwrap_or(k)]);
            added.push(self.mesh.push(kind, ordered, (tag, place, true)));
        }
        if let Some(set) = keyword.value("elset") {
            self.mesh.group(&set.to_lowercase()).elements.extend(added);
        }
        Ok(())
    }

    fn node_of(&self, element: u64, field: &str, place: (usize, usize)) -> Result<u32, MeshError> {
        let tag = number(field, place, "a node of an element")?;
        self.node.get(&tag).copied().ok_or_else(|| {
            let message = format!("element {element} has a node {tag}, and there is none");
            MeshError::broken(place, message)
        })
    }

    /// `*Nset` or `*Elset`
    pub(super) fn set(
        &mut self,
        keyword: &Keyword<'_>,
        cards: &mut Cards<'_>,
    ) -> Result<(), MeshError> {
        let name = keyword.required(&keyword.name)?.to_lowercase();
        let is_nodes = keyword.name == "nset";
        let members = self.members(keyword, is_nodes, cards)?;
        let group = self.mesh.group(&name);
        if is_nodes {
            group.nodes.extend(members)
        } else {
            group.elements.extend(members)
        }
        Ok(())
    }

    /// What the lines of a set list: indices of nodes or elements.
    pub(super) fn members(
        &self,
        keyword: &Keyword<'_>,
        is_nodes: bool,
        cards: &mut Cards<'_>,
    ) -> Result<Vec<u32>, MeshError> {
        let mut members = Vec::new();
        if let Some(elements) = keyword.value("elset").filter(|_| is_nodes) {
            let listed = self.named(elements, false, keyword.line.range())?;
            members.extend(listed.iter().flat_map(|element| self.mesh.nodes_at(*element)));
        }
        let generates = keyword.value("generate").is_some();
        while let Some(line) = cards.next_data() {
            text(&line)?;
            if generates {
                self.generate(&line, is_nodes, &mut members)?;
                continue;
            }
            for (field, place) in fields(&line) {
                match field.parse::<u64>() {
                    Ok(tag) => members.extend(self.member(tag, is_nodes, place)?),
                    Err(_) => members.extend(self.named(field, is_nodes, place)?),
                }
            }
        }
        Ok(members)
    }

    fn member(
        &self,
        tag: u64,
        is_nodes: bool,
        place: (usize, usize),
    ) -> Result<Option<u32>, MeshError> {
        let found = if is_nodes { self.node.get(&tag) } else { self.element.get(&tag) };
        match found {
            Some(index) => Ok(Some(*index)),
            None if !is_nodes && self.skipped.contains(&tag) => Ok(None),
            None => {
                let thing = if is_nodes { "node" } else { "element" };
                Err(MeshError::broken(place, format!("there is no {thing} {tag}")))
            }
        }
    }

    /// Another set, by its name.
    fn named(
        &self,
        name: &str,
        is_nodes: bool,
        place: (usize, usize),
    ) -> Result<Vec<u32>, MeshError> {
        let name = name.trim_matches('"').to_lowercase();
        let group = self.mesh.groups().iter().find(|group| group.name == name);
        let group = group.ok_or_else(|| {
            let message = format!("`{}` is no number, and no set before this line", shown(&name));
            MeshError::broken(place, message)
        })?;
        Ok(if is_nodes { group.nodes.clone() } else { group.elements.clone() })
    }

    /// `first, last, step`
    fn generate(
        &self,
        line: &Line<'_>,
        is_nodes: bool,
        members: &mut Vec<u32>,
    ) -> Result<(), MeshError> {
        let mut numbers = Vec::new();
        for (field, place) in fields(line) {
            numbers.push(number(field, place, "first, last and step of a set")?);
        }
        let (first, last, step) = match numbers[..] {
            [only] => (only, only, 1),
            [first, last] => (first, last, 1),
            [first, last, step] if step > 0 => (first, last, step),
            _ => {
                let message = "first, last and a positive step of a set should stand here";
                return Err(MeshError::broken(line.range(), message));
            }
        };
        // Those that are there: numbers may have gaps.
        let all = if is_nodes { &self.node } else { &self.element };
        let is_meant =
            |tag: &u64| (first..=last).contains(tag) && (tag - first).is_multiple_of(step);
        let mut found: Vec<(u64, u32)> = all
            .iter()
            .filter(|(tag, _)| is_meant(tag))
            .map(|(tag, index)| (*tag, *index))
            .collect();
        let is_left_out = !is_nodes && self.skipped.iter().any(is_meant);
        if found.is_empty() && !is_left_out {
            let thing = if is_nodes { "node" } else { "element" };
            let message = format!("there is no {thing} from {first} to {last} by {step}");
            return Err(MeshError::broken(line.range(), message));
        }
        found.sort_unstable();
        members.extend(found.into_iter().map(|(_, index)| index));
        Ok(())
    }

    /// `*Surface`: the elements, or nodes, that it lists.
    pub(super) fn surface(
        &mut self,
        keyword: &Keyword<'_>,
        cards: &mut Cards<'_>,
    ) -> Result<(), MeshError> {
        let is_nodes = keyword.value("type").is_some_and(|kind| kind.eq_ignore_ascii_case("node"));
        let mut members = Vec::new();
        while let Some(line) = cards.next_data() {
            text(&line)?;
            let mut fields = fields(&line);
            let Some((field, place)) = fields.next() else { continue };
            let listed = match field.parse::<u64>() {
                Ok(tag) => self.member(tag, is_nodes, place)?.into_iter().collect(),
                Err(_) => self.named(field, is_nodes, place)?,
            };
            match fields.next().filter(|(label, _)| !is_nodes && !SIDES.contains(label)) {
                Some((label, place)) => {
                    for element in listed {
                        members.push(self.face(element, label, place)?);
                    }
                }
                None => members.extend(listed),
            }
        }
        let group = self.mesh.group(&keyword.required("name")?.to_lowercase());
        if is_nodes {
            group.nodes.extend(members)
        } else {
            group.elements.extend(members)
        }
        Ok(())
    }

    /// The face of an element that a label names, as an element of its own.
    fn face(&mut self, element: u32, label: &str, place: (usize, usize)) -> Result<u32, MeshError> {
        let (shape, corners) = self.mesh.shape_at(element);
        let number = label.strip_prefix(['S', 's']).and_then(|digits| digits.parse::<usize>().ok());
        let faces = faces(shape);
        let face = number.and_then(|number| faces.get(number.checked_sub(1)?));
        let Some(face) = face else {
            let n = faces.len();
            let message = format!("`{}` is no face of this element: S1 to S{n} are", shown(label));
            return Err(MeshError::broken(place, message));
        };
        let nodes: Vec<u32> = face.iter().map(|k| corners[*k]).collect();
        let kind = match nodes.len() {
            2 => Kind::new(Shape::Line, 2),
            3 => Kind::new(Shape::Triangle, 3),
            _ => Kind::new(Shape::Quadrilateral, 4),
        };
        Ok(self.mesh.push(kind, nodes.into_iter(), (0, place, true)))
    }

    pub(super) fn into_mesh(self) -> Mesh {
        self.mesh
    }

    /// Adds the part where an instance puts it; its sets also under the name of the instance, if that is
    /// given.
    pub(super) fn add_to(
        &self,
        mesh: &mut Mesh,
        motion: &Motion,
        prefix: Option<&str>,
        sets: &[(String, bool, Vec<u32>)],
    ) {
        let (nodes, elements) = (mesh.n_nodes() as u32, mesh.n_elements() as u32);
        let moved: Vec<[f64; 3]> = self.nodes.iter().map(|x| motion.place(*x)).collect();
        mesh.push_nodes(&moved);
        mesh.push_all(&self.mesh, nodes);
        let mut add = |name: &str, of_nodes: &[u32], of_elements: &[u32]| {
            let group = mesh.group(name);
            group.nodes.extend(of_nodes.iter().map(|node| node + nodes));
            group.elements.extend(of_elements.iter().map(|element| element + elements));
        };
        for group in self.mesh.groups() {
            add(&group.name, &group.nodes, &group.elements);
            if let Some(prefix) = prefix {
                add(&format!("{prefix}.{}", group.name), &group.nodes, &group.elements);
            }
        }
        for (name, is_nodes, members) in sets {
            if *is_nodes { add(name, members, &[]) } else { add(name, &[], members) }
        }
    }
}

/// Where an instance puts its part: first shifted, then turned.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    shift: [f64; 3],
    /// A point of the axis, a unit vector along it, and the angle.
    turn: Option<([f64; 3], [f64; 3], f64)>,
}

impl Motion {
    pub(super) fn read(lines: &[Line<'_>]) -> Result<Motion, MeshError> {
        let mut motion = Motion::default();
        let mut rows = Vec::new();
        for line in lines {
            text(line)?;
            let numbers = fields(line).map(|(field, place)| float(field, place, "a number"));
            rows.push((numbers.collect::<Result<Vec<f64>, MeshError>>()?, line));
        }
        match &rows[..] {
            [] => {}
            [(shift, _), rest @ ..] if shift.len() <= 3 => {
                shift.iter().zip(&mut motion.shift).for_each(|(x, shift)| *shift = *x);
                match rest {
                    [] => {}
                    [(turn, line)] => motion.turn = Some(turning(turn, line)?),
                    [_, (_, line), ..] => return Err(too_much(line)),
                }
            }
            [(_, line), ..] => return Err(too_much(line)),
        }
        Ok(motion)
    }

    fn place(&self, x: [f64; 3]) -> [f64; 3] {
        let x = [0, 1, 2].map(|k| x[k] + self.shift[k]);
        let Some((origin, axis, angle)) = self.turn else { return x };
        // Rodrigues's rotation.
        let r = [0, 1, 2].map(|k| x[k] - origin[k]);
        let (sin, cos) = sin_cos(angle);
        let along = axis[0] * r[0] + axis[1] * r[1] + axis[2] * r[2];
        let across = [1, 2, 0].map(|k| {
            let (a, b) = (k, (k + 1) % 3);
            axis[a] * r[b] - axis[b] * r[a]
        });
        [0, 1, 2].map(|k| origin[k] + r[k] * cos + across[k] * sin + axis[k] * along * (1.0 - cos))
    }
}

/// Of an angle in degrees; exact at quarters of a turn.
fn sin_cos(degrees: f64) -> (f64, f64) {
    let quarters = degrees / 90.0;
    if quarters == quarters.round() {
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]
            [(quarters.rem_euclid(4.0)) as usize % 4];
    }
    let angle = degrees.to_radians();
    (libm::sin(angle), libm::cos(angle))
}

fn turning(numbers: &[f64], line: &Line<'_>) -> Result<([f64; 3], [f64; 3], f64), MeshError> {
    let [ax, ay, az, bx, by, bz, angle] = numbers[..] else { return Err(too_much(line)) };
    let axis = [bx - ax, by - ay, bz - az];
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length == 0.0 || !length.is_finite() {
        let message = "the two points of this axis are one";
        return Err(MeshError::broken(line.range(), message));
    }
    Ok(([ax, ay, az], axis.map(|x| x / length), angle))
}

fn too_much(line: &Line<'_>) -> MeshError {
    let message = "an instance has a line with three numbers, its shift, and one with two points of an \
                   axis and an angle";
    MeshError::broken(line.range(), message)
}

fn number(field: &str, place: (usize, usize), what: &str) -> Result<u64, MeshError> {
    field.parse().map_err(|_| {
        let message = format!("{what} should stand here, not `{}`", shown(field));
        MeshError::broken(place, message)
    })
}

fn float(field: &str, place: (usize, usize), what: &str) -> Result<f64, MeshError> {
    let value = field.parse::<f64>().or_else(|_| field.replace(['d', 'D'], "e").parse());
    value.ok().filter(|value| value.is_finite()).ok_or_else(|| {
        let message = format!("{what} should stand here, not `{}`", shown(field));
        MeshError::broken(place, message)
    })
}

/// Sides of shells, whose surface is the element.
const SIDES: [&str; 4] = ["SPOS", "SNEG", "spos", "sneg"];

/// Corners of the faces S1, S2, .. of an element, as Abaqus counts them; of plane elements of the edges.
fn faces(shape: Shape) -> &'static [&'static [usize]] {
    match shape {
        Shape::Point | Shape::Line => &[],
        Shape::Triangle => &[&[0, 1], &[1, 2], &[2, 0]],
        Shape::Quadrilateral => &[&[0, 1], &[1, 2], &[2, 3], &[3, 0]],
        Shape::Tetrahedron => &[&[0, 1, 2], &[0, 3, 1], &[1, 3, 2], &[2, 3, 0]],
        Shape::Pyramid => &[&[0, 1, 2, 3], &[0, 4, 1], &[1, 4, 2], &[2, 4, 3], &[3, 4, 0]],
        Shape::Wedge => &[&[0, 1, 2], &[3, 5, 4], &[0, 3, 4, 1], &[1, 4, 5, 2], &[2, 5, 3, 0]],
        Shape::Hexahedron => &[
            &[0, 1, 2, 3],
            &[4, 7, 6, 5],
            &[0, 4, 5, 1],
            &[1, 5, 6, 2],
            &[2, 6, 7, 3],
            &[3, 7, 4, 0],
        ],
    }
}

/// The kind of a type of elements, and which of its nodes is which of the kind's.
fn kind(name: &str) -> Option<(Kind, &'static [usize])> {
    const SOLIDS: [&str; 3] = ["C3D", "DC3D", "AC3D"];
    const SHEETS: [&str; 9] = ["CPS", "CPE", "DC2D", "AC2D", "S", "STRI", "M3D", "SFM3D", "R3D"];
    const LINES: [&str; 2] = ["T2D", "T3D"];
    let count = |prefix: &&str| {
        let rest = name.strip_prefix(*prefix)?;
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        rest[..digits].parse::<usize>().ok()
    };
    let first = |prefixes: &[&str]| prefixes.iter().find_map(count);
    let (shape, nodes) = match (first(&SOLIDS), first(&SHEETS), first(&LINES)) {
        (Some(n @ (4 | 10)), ..) => (Shape::Tetrahedron, n),
        (Some(5), ..) => (Shape::Pyramid, 5),
        (Some(n @ (6 | 15)), ..) => (Shape::Wedge, n),
        (Some(n @ (8 | 20)), ..) => (Shape::Hexahedron, n),
        (None, Some(n @ (3 | 6)), _) => (Shape::Triangle, n),
        (None, Some(65), _) if name.starts_with("STRI") => (Shape::Triangle, 6),
        (None, Some(n @ (4 | 8)), _) => (Shape::Quadrilateral, n),
        (None, None, Some(n @ (2 | 3))) => (Shape::Line, n),
        _ => return None,
    };
    let order: &[usize] = match (shape, nodes) {
        (Shape::Tetrahedron, 10) => &[0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
        (Shape::Hexahedron, 20) => {
            &[0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14]
        }
        (Shape::Wedge, 15) => &[0, 1, 2, 3, 4, 5, 6, 8, 12, 7, 13, 14, 9, 11, 10],
        _ => &[],
    };
    Some((Kind::new(shape, nodes), order))
}
