//! `[[crack]]`, `[fracture]`, `[[track]]`.

use piola_grammar::Diagnostic;
use piola_mechanics::fracture::crack::Crack;
use piola_solvers::singular::Singular;
use piola_solvers::steps::Loose;

use super::Context;
use crate::scene::reader::{Field, Reader, Schema, Table};
use crate::scene::tree::{Entry, Node};
use crate::scene::{CrackEntry, CrackShape, FractureSettings, Located, Track, TrackAxis};

static CRACK: Schema = Schema {
    title: "[[crack]]",
    keys: &[
        ("segment", "[[0.0, 0.02], [0.05, 0.02]]"),
        ("polygon", "[[0, 0.02, 0], [0.05, 0.02, 0], [0.05, 0.02, 0.01], [0, 0.02, 0.01]]"),
        ("between", "[\"one\", \"other\"]"),
        ("damaged", "true"),
    ],
};
static FRACTURE: Schema = Schema {
    title: "[fracture]",
    keys: &[("unbreakable", "[\"grip\"]"), ("loose", "\"freeze\""), ("singular", "\"release\"")],
};

static TRACK: Schema = Schema {
    title: "[[track]]",
    keys: &[
        ("name", "\"tip\""),
        ("axis", "\"X\""),
        ("threshold", "0.35"),
        ("set", "\"upper\""),
        ("thickness", "0.004"),
    ],
};
pub(super) static TABLES: [&Schema; 3] = [&CRACK, &FRACTURE, &TRACK];

/// The damage at which a point is of a crack.
const THRESHOLD: f64 = 0.35;

/// Most corners of a crack: every bond is held against every edge.
const MOST_CORNERS: usize = 1000;

impl Reader {
    /// The cracks of a body, in the order of the file.
    pub(super) fn cracks(&mut self, node: Option<&Node>, context: &Context) -> Vec<CrackEntry> {
        let tables = self.tables(&CRACK, node);
        tables.iter().filter_map(|table| self.crack(table, context)).collect()
    }

    fn crack(&mut self, table: &Table<'_>, context: &Context) -> Option<CrackEntry> {
        let key = self.key_of_crack(table)?;
        let damaged = self.or(Some(table), "damaged", true, Reader::switch);
        let field = table.field(key)?;
        let span = table.span;
        if key == "between" {
            let shape = CrackShape::Between(self.two_sets(field, context)?);
            return Some(CrackEntry { shape, damaged: damaged?, span });
        }
        let (wanted, other) = if key == "segment" { (2, "polygon") } else { (3, "segment") };
        if context.dimension.is_some_and(|dimension| dimension != wanted) {
            let message = format!("a {key} is a crack in {wanted} dimensions");
            let found = Diagnostic::error("conflicting-keys", field.node.span, message);
            self.error(found.help(format!("write `{other} = [..]`")));
            return None;
        }
        let shape = match key {
            "segment" => {
                let corners: Vec<[f64; 2]> = self.corners_of(field)?;
                let [p, q] = corners[..] else {
                    self.out_of_range(field, "two points, [[X, Y], [X, Y]]");
                    return None;
                };
                Crack::Segment([p, q])
            }
            _ => {
                let corners: Vec<[f64; 3]> = self.corners_of(field)?;
                if corners.len() < 3 || corners.len() > MOST_CORNERS {
                    self.out_of_range(field, "3 to 1000 corners, [[X, Y, Z], ..]");
                    return None;
                }
                Crack::Polygon(corners)
            }
        };
        if let Err(error) = shape.check() {
            let found = Diagnostic::error("out-of-range", field.node.span, error.to_string());
            self.error(found.help("write the corners in their order around the crack"));
            return None;
        }
        Some(CrackEntry { shape: CrackShape::Across(shape), damaged: damaged?, span })
    }

    /// The one of its keys that says where a crack is.
    fn key_of_crack(&mut self, table: &Table<'_>) -> Option<&'static str> {
        let is_there = |key: &&str| table.get(key).is_some();
        match (is_there(&"between"), ["segment", "polygon"].into_iter().find(is_there)) {
            (true, None) => Some("between"),
            (true, Some(other)) => self.either(table, "between", other),
            (false, Some(_)) => self.either(table, "segment", "polygon"),
            (false, None) => {
                let message = "[[crack]] has neither `segment`, `polygon` nor `between`";
                let found = Diagnostic::error("missing-key", table.span, message);
                self.error(found.help(
                    "write the ends or the corners of the crack, or the names of two sets whose \
                     bonds with each other it cuts",
                ));
                None
            }
        }
    }

    fn two_sets(&mut self, field: Field<'_>, context: &Context) -> Option<[Located<usize>; 2]> {
        let items = self.array(field)?;
        let [one, other] = items else {
            self.out_of_range(field, "two names of sets, [\"one\", \"other\"]");
            return None;
        };
        let both = [one, other].map(|item| self.set_named(field.item(item), context));
        let [Some(one), Some(other)] = both else { return None };
        Some([one, other])
    }

    fn corners_of<const D: usize>(&mut self, field: Field<'_>) -> Option<Vec<[f64; D]>> {
        let items = self.array(field)?;
        let corner = |item: &Node| {
            let numbers = self.vector(field.item(item), Some(D))?;
            numbers.try_into().ok()
        };
        let read: Vec<Option<[f64; D]>> = items.iter().map(corner).collect();
        read.into_iter().collect()
    }

    /// The cracks that are followed, in the order of the file.
    pub(super) fn tracks(&mut self, node: Option<&Node>, context: &Context) -> Vec<Track> {
        let tables = self.tables(&TRACK, node);
        let mut tracks: Vec<Track> = Vec::new();
        for table in &tables {
            let Some(track) = self.track(table, context) else { continue };
            if let Some(first) = tracks.iter().find(|other| other.name == track.name) {
                let message = format!("two tracks are called `{}`", track.name.value);
                let found = Diagnostic::error("conflicting-keys", track.name.span, message);
                self.error(found.note(first.name.span, "the first stands here"));
            }
            tracks.push(track);
        }
        tracks
    }

    fn track(&mut self, table: &Table<'_>, context: &Context) -> Option<Track> {
        let name = self.required(table, "name").and_then(|field| self.name(field));
        if let Some(name) = &name {
            self.check_name("track", &name.value, name.span);
        }
        let axis = self.required(table, "axis").and_then(|field| {
            let axis: TrackAxis = self.choice(field)?;
            if context.dimension.is_some_and(|dimension| axis.number_and_sign().0 >= dimension) {
                let message = "there is no Z in two dimensions";
                let found = Diagnostic::error("no-third-dimension", field.node.span, message);
                self.error(found.help("write axis = \"X\" or \"Y\""));
                return None;
            }
            Some(axis)
        });
        let threshold = self.or(Some(table), "threshold", THRESHOLD, Reader::fraction);
        let positive = |reader: &mut Reader, field| reader.positive(field).map(Some);
        let thickness = self.or(Some(table), "thickness", None, positive);
        let set = self.or(Some(table), "set", None, |reader, field| {
            reader.set_named(field, context).map(Some)
        });
        let (threshold, thickness) = (threshold?, thickness?);
        Some(Track { name: name?, axis: axis?, threshold, set: set?, thickness })
    }

    /// `[fracture]`, of a body that moves or of load steps.
    pub(super) fn fracture(
        &mut self,
        entry: Option<&Entry>,
        context: &Context,
        moves: bool,
    ) -> Option<FractureSettings> {
        let Some(entry) = entry else { return Some(FractureSettings::default()) };
        let table = self.table(&FRACTURE, &entry.node)?;
        let steps = "load steps: in a motion parts that come loose go their way";
        if !self.belongs(&table, "loose", !moves, steps) {
            return None;
        }
        let loose = self.or(Some(&table), "loose", Loose::default(), Reader::choice);
        let singular = self.or(Some(&table), "singular", Singular::default(), Reader::choice);
        let (loose, singular) = (loose?, singular?);
        let Some(field) = table.field("unbreakable") else {
            return Some(FractureSettings { unbreakable: Vec::new(), loose, singular });
        };
        let items = self.array(field)?;
        let set = |item: &Node| self.set_named(field.item(item), context);
        let read: Vec<Option<Located<usize>>> = items.iter().map(set).collect();
        let unbreakable = read.into_iter().collect::<Option<Vec<_>>>()?;
        Some(FractureSettings { unbreakable, loose, singular })
    }
}
