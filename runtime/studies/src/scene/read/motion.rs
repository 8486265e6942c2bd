//! `[motion]`, `[[initial]]`, and what a body that moves needs beside them.

use piola_grammar::{Diagnostic, Span};

use super::Context;
use crate::scene::expression::Role;
use crate::scene::keys::{Row, Slot, named};
use crate::scene::reader::{Field, Reader, Schema, Table};
use crate::scene::tree::{Entry, Kind, Node};
use crate::scene::{
    ColourBy, FrameField, Given, Initial, Load, LoadKind, Located, Material, Motion,
    OutputSettings, Prescription, Quantity, Region,
};

pub(super) static MOTION: Schema = Schema { title: "[motion]", keys: &named(&MOTION_KEYS) };
pub(super) static INITIAL: Schema = Schema {
    title: "[[initial]]",
    keys: &[("set", "\"left\""), ("u", "[\"0.01*X\", 0]"), ("v", "[0, \"-32*X\"]")],
};

/// In the order in which they are written.
pub(in crate::scene) const MOTION_KEYS: [Row<Motion>; 6] = [
    ("method", "\"verlet\"", |motion| Slot::Word(&mut motion.method)),
    ("end", "\"60 us\"", |motion| Slot::Seconds(&mut motion.end)),
    ("step", "\"auto\"", |motion| Slot::SecondsOr(&mut motion.step, "auto")),
    ("safety", "0.9", |motion| Slot::Fraction(&mut motion.safety)),
    ("damping", "0.0", |motion| Slot::NotNegative(&mut motion.damping)),
    ("unstable", "true", |motion| Slot::Switch(&mut motion.unstable)),
];

/// Most frames of a motion, each a file.
const MOST_FRAMES: f64 = 1e6;

impl Reader {
    pub(super) fn motion(&mut self, entry: &Entry) -> Option<Motion> {
        let table = self.table(&MOTION, &entry.node)?;
        self.required(&table, "end")?;
        let motion = self.settings(Some(&table), &MOTION_KEYS);
        Some(Motion { span: entry.key_span, ..motion })
    }

    pub(super) fn initial(&mut self, node: Option<&Node>, context: &Context) -> Vec<Initial> {
        let tables = self.tables(&INITIAL, node);
        let read = tables.iter().filter_map(|table| {
            let set = self.known_set(table, context);
            let [displacements, velocities] =
                ["u", "v"].map(|key| table.field(key).map(|field| self.start(field, context)));
            if displacements.is_none() && velocities.is_none() {
                let message = "[[initial]] has neither `u` nor `v`";
                self.error(Diagnostic::error("missing-key", table.span, message));
            }
            let read = |components: Option<Option<_>>| match components {
                Some(components) => components.map(Some),
                None => Some(None),
            };
            let (displacements, velocities) = (read(displacements), read(velocities));
            Some(Initial { set: set?, displacements: displacements?, velocities: velocities? })
        });
        read.collect()
    }

    fn start(&mut self, field: Field<'_>, context: &Context) -> Option<Located<Vec<Quantity>>> {
        let items = self.components(field, context.dimension)?;
        let component = |reader: &mut Reader, item: Field<'_>| match item.node.kind {
            Kind::Text(_) => {
                reader.expression(item, Role::Start, context.dimension).map(Quantity::Expression)
            }
            Kind::Number { .. } => reader.number(item).map(Quantity::Number),
            _ => {
                reader.wrong_type(item, "a number or an expression in a string");
                None
            }
        };
        let read: Vec<Option<Quantity>> =
            items.iter().map(|item| component(self, field.item(item))).collect();
        let value = read.into_iter().collect::<Option<Vec<Quantity>>>()?;
        Some(Located { value, span: field.node.span })
    }

    /// What only bodies that move have, and what they need: a density of every material.
    pub(super) fn check_motion(
        &mut self,
        motion: Option<&Motion>,
        [steps, initial]: [Option<&Entry>; 2],
        (prescriptions, loads): (&[Prescription], &[Load]),
        (materials, regions): (&[Material], &[Region]),
    ) {
        let Some(motion) = motion else {
            let given = prescriptions.iter().filter_map(|entry| match entry.given {
                Given::Displacement => None,
                Given::Velocity => Some(("a prescribed velocity", entry.set.span)),
                Given::Acceleration => Some(("a prescribed acceleration", entry.set.span)),
            });
            let accelerations = loads.iter().filter(|load| load.kind == LoadKind::Acceleration);
            let spans = given.chain(accelerations.map(|load| ("an acceleration", load.set.span)));
            for (what, span) in spans.chain(initial.map(|entry| ("[[initial]]", entry.key_span))) {
                let message =
                    format!("{what} is for bodies that move, and the scene has no [motion]");
                let help = "write [motion] with an `end` in s, in place of [steps]";
                self.error(Diagnostic::error("conflicting-keys", span, message).help(help));
            }
            return;
        };
        if let Some(steps) = steps {
            let message = "a body that moves has no load steps: the scene has [motion] and [steps]";
            let found = Diagnostic::error("conflicting-keys", steps.key_span, message);
            self.error(found.note(motion.span, "one of the two is enough"));
        }
        let n_bodies = regions.len().max(1);
        for law in 0..n_bodies {
            let own = materials.iter().find(|material| material.law == law);
            if let Some(own) = own.filter(|own| own.density.is_none()) {
                let message = "a body that moves needs the density of its material";
                let found = Diagnostic::error("missing-key", own.potential.span, message);
                let help = "write density = \"2440 kg/m^3\" beside the potential";
                self.error(found.note(motion.span, "it moves here").help(help));
            }
        }
    }

    /// Keys of `[output]` that tables of a motion have alone.
    pub(super) fn check_output(
        &mut self,
        motion: Option<&Motion>,
        output: Option<&Table<'_>>,
        settings: &OutputSettings,
    ) {
        let Some(output) = output else { return };
        let every = settings.every.zip(output.field("every"));
        if let (Some(motion), Some((every, field))) = (motion, every) {
            if let Some(frames) = output.get("frames") {
                let message = "`every` and `frames` both say which frames are written";
                let found = Diagnostic::error("conflicting-keys", frames.key_span, message);
                self.error(found.help("leave one of them out"));
            }
            if motion.end / every > MOST_FRAMES {
                let frames = motion.end / every;
                let message = format!("{frames:.1e} frames lead to the end of {:e} s", motion.end);
                let found = Diagnostic::error("out-of-range", field.node.span, message);
                self.error(
                    found.help(format!("write at most {MOST_FRAMES} of them: a longer time")),
                );
            }
        }
        if motion.is_none() {
            let moved = settings.fields.contains(&FrameField::Acceleration);
            let coloured = matches!(settings.colour, ColourBy::Velocity | ColourBy::Acceleration);
            for (key, moved) in [("fields", moved), ("colour", coloured)] {
                if let Some(entry) = output.get(key).filter(|_| moved) {
                    let message = format!(
                        "`{key}` asks for what bodies that move have, and the scene has no [motion]"
                    );
                    self.error(Diagnostic::error("conflicting-keys", entry.key_span, message));
                }
            }
            for key in ["every", "rows", "checkpoint"] {
                if let Some(entry) = output.get(key).filter(|entry| !is_word(entry, "frames")) {
                    let message =
                        format!("`{key}` is for bodies that move, and the scene has no [motion]");
                    self.error(Diagnostic::error("conflicting-keys", entry.key_span, message));
                }
            }
        }
    }

    /// The density of a material in kg/m^3.
    pub(super) fn density(&mut self, table: &Table<'_>) -> Option<Option<Located<f64>>> {
        let Some(field) = table.field("density") else { return Some(None) };
        let value = match &field.node.kind {
            Kind::Text(text) => match piola_compiler::quantity("density", &text.value, UNIT) {
                Ok(value) => value,
                Err(error) => {
                    let found = Diagnostic::error(error.code, text.content, error.message);
                    self.error(
                        found.help("write density = \"2440 kg/m^3\", or a number in kg/m^3"),
                    );
                    return None;
                }
            },
            _ => self.number(field)?,
        };
        if !(value > 0.0 && value.is_finite()) {
            self.out_of_range(field, "greater than 0");
            return None;
        }
        Some(Some(Located {
            value,
            span: Span::new(field.node.span.start as usize, field.node.span.end as usize),
        }))
    }
}

/// The unit of densities.
const UNIT: &str = "kg/m^3";

fn is_word(entry: &Entry, word: &str) -> bool {
    matches!(&entry.node.kind, Kind::Text(text) if text.value == word)
}
