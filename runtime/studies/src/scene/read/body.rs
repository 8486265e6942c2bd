//! `[body]` and `[horizon]`.

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::surface::{Surface, Volumes};
use piola_mechanics::weights::Weights;
use piola_mechanics::words::Words;

use super::Context;
use crate::scene::check;
use crate::scene::expression::{Expression, Role};
use crate::scene::reader::{Field, Reader, Schema, Table};
use crate::scene::tree::Kind;
use crate::scene::{
    BodyShape, Horizon, HorizonExtent, LatticeShape, Located, MeshFormat, MeshShape, Points,
};

pub(super) static BODY: Schema = Schema {
    title: "[body]",
    keys: &[
        ("dimension", "2"),
        ("box", "[[0.0, 0.0], [1.0, 1.0]]"),
        ("spacing", "0.05"),
        ("nodes", "\"cells\""),
        ("remove", "[\"(X-0.5)^2 + (Y-0.5)^2 < 0.2^2\"]"),
        ("points", "\"cloud.csv\""),
        ("mesh", "\"bar.msh\""),
        ("unit", "\"mm\""),
        ("thickness", "0.01"),
    ],
};
pub(super) static HORIZON: Schema = Schema {
    title: "[horizon]",
    keys: &[
        ("spacings", "3"),
        ("radius", "0.15"),
        ("weights", "\"uniform\""),
        ("surface", "\"directional\""),
        ("volumes", "\"partial\""),
    ],
};

impl Reader {
    /// The dimension is known even if something else in the body is wrong.
    pub(super) fn body(&mut self, table: &Table<'_>) -> Option<(Option<usize>, Option<BodyShape>)> {
        let shape = match table.get("mesh") {
            Some(_) => self.one_of(table, &["box", "points", "mesh"], |key| key).copied(),
            None => self.either(table, "box", "points"),
        };
        let corners = table.field("box").and_then(|field| self.corners(field));
        let dimension = self.dimension(table, corners.as_ref());
        let remove = self.or(Some(table), "remove", Vec::new(), |reader, field| {
            reader.conditions(field, dimension)
        });
        let points = match shape {
            Some("box") => self.lattice(table, corners, dimension).map(Points::Lattice),
            Some("mesh") => self.mesh(table),
            Some(_) => self.cloud(table),
            None => None,
        };
        let thickness = self.or(Some(table), "thickness", None, |reader, field| {
            let span = field.node.span;
            if dimension == Some(3) {
                let message = "`thickness` is of bodies in two dimensions";
                let error = Diagnostic::error("conflicting-keys", span, message);
                reader.error(error.help("leave it out: in three dimensions the points have it"));
                return None;
            }
            reader.positive(field).map(|value| Some(Located { value, span }))
        });
        let body = match (dimension, points, remove, thickness) {
            (Some(dimension), Some(points), Some(remove), Some(thickness)) => {
                Some(BodyShape { dimension, points, remove, thickness })
            }
            _ => None,
        };
        Some((dimension, body))
    }

    fn corners(&mut self, field: Field<'_>) -> Option<[Vec<f64>; 2]> {
        let items = self.array(field)?;
        let [first, second] = items else {
            let message = format!("a box has two opposite corners, not {}", items.len());
            let diagnostic = Diagnostic::error("box-corners", field.node.span, message);
            self.error(diagnostic.help("write box = [[0.0, 0.0], [1.0, 1.0]]"));
            return None;
        };
        let corners = [first, second].map(|corner| self.vector(field.item(corner), None));
        let [Some(first), Some(second)] = corners else { return None };
        if first.len() == second.len() && (2..=3).contains(&first.len()) {
            return Some([first, second]);
        }
        let message = format!(
            "the corners of a box have 2 or 3 coordinates each, not {} and {}",
            first.len(),
            second.len()
        );
        self.error(Diagnostic::error("box-corners", field.node.span, message));
        None
    }

    fn dimension(&mut self, table: &Table<'_>, corners: Option<&[Vec<f64>; 2]>) -> Option<usize> {
        let Some(field) = table.field("dimension") else {
            if mesh_format(table) == Some(MeshFormat::Stl) {
                return Some(3);
            }
            if table.get("box").is_none() {
                self.required(table, "dimension");
            }
            return corners.map(|corners| corners[0].len());
        };
        let Kind::Number { whole: Some(dimension @ 2..=3), .. } = field.node.kind else {
            match field.node.kind {
                Kind::Number { .. } => self.out_of_range(field, "2 or 3"),
                _ => self.wrong_type(field, "a number"),
            }
            return None;
        };
        let dimension = dimension as usize;
        if let (Some(corners), Some(field)) = (corners, table.field("box"))
            && corners[0].len() != dimension
        {
            let count = corners[0].len();
            let message = format!("the box has {count} coordinates in {dimension} dimensions");
            self.error(Diagnostic::error("component-count", field.node.span, message));
        }
        Some(dimension)
    }

    fn conditions(
        &mut self,
        field: Field<'_>,
        dimension: Option<usize>,
    ) -> Option<Vec<Expression>> {
        let items = self.array(field)?;
        let read: Vec<Option<Expression>> = items
            .iter()
            .map(|item| self.expression(field.item(item), Role::Condition, dimension))
            .collect();
        read.into_iter().collect()
    }

    fn lattice(
        &mut self,
        table: &Table<'_>,
        corners: Option<[Vec<f64>; 2]>,
        dimension: Option<usize>,
    ) -> Option<LatticeShape> {
        let spacing_field = self.required(table, "spacing");
        let spacing = spacing_field.and_then(|field| self.positive(field));
        let nodes = self.option(table, "nodes");
        let ([first, second], spacing, nodes) = (corners?, spacing?, nodes?);
        let low: Vec<f64> = first.iter().zip(&second).map(|(a, b)| a.min(*b)).collect();
        let high: Vec<f64> = first.iter().zip(&second).map(|(a, b)| a.max(*b)).collect();
        let lattice = LatticeShape { low, high, spacing, nodes };
        if dimension != Some(lattice.low.len()) {
            return None;
        }
        let spans = (spacing_field?.node.span, table.field("box")?.node.span);
        match check::lattice(&lattice, spans.0, spans.1) {
            None => Some(lattice),
            Some(diagnostic) => {
                self.error(diagnostic);
                None
            }
        }
    }

    fn cloud(&mut self, table: &Table<'_>) -> Option<Points> {
        for key in ["spacing", "nodes", "unit"] {
            if let Some(entry) = table.get(key) {
                let message = format!("`{key}` belongs to a box; a cloud brings its own points");
                self.error(Diagnostic::error("conflicting-keys", entry.key_span, message));
            }
        }
        let field = self.required(table, "points")?;
        Some(Points::Cloud { path: self.name(field)? })
    }

    fn mesh(&mut self, table: &Table<'_>) -> Option<Points> {
        let field = self.required(table, "mesh")?;
        let path = self.name(field)?;
        let Some(format) = MeshFormat::of(&path.value) else {
            let message = format!("`{}` is none of the meshes that are read", path.value);
            let found = Diagnostic::error("unknown-mesh", path.span, message);
            self.error(found.help(
                "they end in .msh (Gmsh), .inp (Abaqus) or .stl; clouds of points are `points`",
            ));
            return None;
        };
        let is_surface = format == MeshFormat::Stl;
        let (idle, message) = match is_surface {
            true => ("nodes", "`nodes` is of cells, and a surface is filled with points"),
            false => ("spacing", "`spacing` fills a surface, and a mesh brings its own cells"),
        };
        if let Some(entry) = table.get(idle) {
            let found = Diagnostic::error("conflicting-keys", entry.key_span, message);
            self.error(found.help("leave it out"));
        }
        let spacing = match is_surface {
            true => {
                let field = self.required(table, "spacing");
                Some(field.and_then(|field| self.positive(field))?)
            }
            false => None,
        };
        let unit = self.or(Some(table), "unit", 1.0, Reader::unit_of_length)?;
        let nodes = if is_surface { None } else { Some(self.option(table, "nodes")?) };
        let nodes = nodes.unwrap_or(crate::scene::MeshNodes::Cells);
        Some(Points::Mesh(MeshShape { path, format, unit, nodes, spacing }))
    }

    /// A unit in m: its name, or how long it is.
    fn unit_of_length(&mut self, field: Field<'_>) -> Option<f64> {
        let Kind::Text(text) = &field.node.kind else { return self.positive(field) };
        match piola_compiler::quantity("unit", &format!("1 {}", text.value), "m") {
            Ok(length) => Some(length),
            Err(error) => {
                let found = Diagnostic::error(error.code, text.content, error.message);
                self.error(found.help("write unit = \"mm\", or how long one is in m, unit = 1e-3"));
                None
            }
        }
    }

    pub(super) fn horizon(&mut self, table: &Table<'_>, context: &Context) -> Option<Horizon> {
        let key = self.either(table, "spacings", "radius");
        let field = key.and_then(|key| table.field(key));
        let size = field.and_then(|field| self.positive(field));
        let weights = self.weights(table, context);
        let surface = self.correction(table, "surface", Surface::None, context);
        let volumes = self.correction(table, "volumes", Volumes::Whole, context);
        let (field, size, spacing) = (field?, size?, context.spacing?);
        let (extent, radius) = match key? {
            "spacings" => (HorizonExtent::Spacings(size), size * spacing),
            _ => (HorizonExtent::Radius(size), size),
        };
        if let Some(diagnostic) = check::horizon(radius, spacing, field.node.span) {
            self.error(diagnostic);
            return None;
        }
        let weights_span = table.field("weights").map(|field| field.node.span);
        let (weights, surface, volumes) = (weights?, surface?, volumes?);
        let correction_span = surface.1.or(volumes.1);
        let mut horizon = Horizon {
            extent,
            weights,
            weights_span,
            surface: surface.0,
            volumes: volumes.0,
            correction_span,
        };
        if volumes.0 == Volumes::Partial {
            horizon.weigh_volumes();
        }
        match check::correction(&horizon) {
            None => Some(horizon),
            Some(diagnostic) => {
                self.error(diagnostic);
                None
            }
        }
    }

    /// A correction of bonds, and where the scene asks for it.
    fn correction<T: Words + PartialEq>(
        &mut self,
        table: &Table<'_>,
        key: &'static str,
        none: T,
        context: &Context,
    ) -> Option<(T, Option<Span>)> {
        let Some(field) = table.field(key) else { return Some((none, None)) };
        let (chosen, span) = (self.choice::<T>(field)?, field.node.span);
        if chosen == none {
            return Some((none, None));
        }
        if context.spacing == Some(0.0) {
            let message = format!(
                "`{key}` compares bonds with those inside the body's lattice, and the body is a cloud \
                 of points"
            );
            let diagnostic = Diagnostic::error("conflicting-keys", span, message);
            self.error(diagnostic.help(
                "leave it out; energies of `F` and of gathered values need no correction at faces",
            ));
            return None;
        }
        Some((chosen, Some(span)))
    }

    fn weights(&mut self, table: &Table<'_>, context: &Context) -> Option<Weights> {
        let Some(field) = table.field("weights") else {
            return Some(match context.spacing? {
                0.0 => Weights::Truncated,
                _ => Weights::Uniform,
            });
        };
        let weights = self.choice(field)?;
        if weights == Weights::Uniform && context.spacing == Some(0.0) {
            let message = "uniform weights need a lattice, and the body is a cloud of points";
            let diagnostic = Diagnostic::error("uniform-on-cloud", field.node.span, message);
            self.error(diagnostic.help("write weights = \"truncated\""));
            return None;
        }
        Some(weights)
    }
}

/// The kind of mesh that a body is made of, by the ending of its file.
fn mesh_format(table: &Table<'_>) -> Option<MeshFormat> {
    match &table.field("mesh")?.node.kind {
        Kind::Text(text) => MeshFormat::of(&text.value),
        _ => None,
    }
}
