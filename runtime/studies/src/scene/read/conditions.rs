//! `[sets]`, `[[prescribe]]`, `[[load]]`, `[[probe]]`.

use piola_grammar::{Diagnostic, Span};

use super::Context;
use crate::scene::expression::Role;
use crate::scene::reader::{Field, Reader, Schema, Table};
use crate::scene::tree::{Kind, Node};
use crate::scene::{
    Given, Listing, Load, LoadKind, Located, Members, Prescription, Probe, Quantity, SetDefinition,
};
use piola_grammar::suggest;

static SETS: Schema = Schema { title: "[sets]", keys: &[("*", "\"X < 0.1\"")] };
static LISTED: Schema =
    Schema { title: "a set", keys: &[("group", "\"left face\""), ("numbers", "\"left.txt\"")] };
static PRESCRIBE: Schema = Schema {
    title: "[[prescribe]]",
    keys: &[
        ("set", "\"left\""),
        ("u", "[0, \"0.1*t\"]"),
        ("v", "[0, \"0.1*t\"]"),
        ("a", "[0, \"0.1*t\"]"),
    ],
};
static LOAD: Schema = Schema {
    title: "[[load]]",
    keys: &[
        ("set", "\"right\""),
        ("force", "[\"0.1*t\", 0]"),
        ("density", "[0, -9.81]"),
        ("acceleration", "[0, -9.81]"),
    ],
};
static PROBE: Schema =
    Schema { title: "[[probe]]", keys: &[("name", "\"tip\""), ("at", "[1.0, 0.5]")] };
pub(super) static TABLES: [&Schema; 4] = [&SETS, &PRESCRIBE, &LOAD, &PROBE];

/// Words that stand for something else where names of sets and probes appear.
const RESERVED: [&str; 8] = ["X", "Y", "Z", "t", "u", "v", "w", "free"];

impl Reader {
    /// The point sets, and the names of all of them, readable or not: a set with a wrong condition
    /// is not reported again where it is used.
    pub(super) fn sets(
        &mut self,
        node: Option<&Node>,
        dimension: Option<usize>,
    ) -> (Vec<String>, Vec<SetDefinition>) {
        let (mut names, mut sets) = (Vec::new(), Vec::new());
        let entries = match node.map(|node| (&node.kind, node)) {
            None => return (names, sets),
            Some((Kind::Table(entries), _)) => entries,
            Some((_, node)) => {
                let message = format!("expected the table [sets], found {}", node.kind_name());
                self.error(Diagnostic::error("wrong-type", node.span, message));
                return (names, sets);
            }
        };
        for entry in entries {
            self.check_name("set", &entry.key, entry.key_span);
            names.push(entry.key.clone());
            let field = Field { schema: &SETS, key: &entry.key, node: &entry.node };
            let name = Located { value: entry.key.clone(), span: entry.key_span };
            let members = match &entry.node.kind {
                Kind::Table(_) => self.listed(&entry.node),
                _ => self.expression(field, Role::Condition, dimension).map(Members::Where),
            };
            sets.extend(members.map(|members| SetDefinition { name, members }));
        }
        (names, sets)
    }

    /// A set as a file lists it.
    fn listed(&mut self, node: &Node) -> Option<Members> {
        let table = self.table(&LISTED, node)?;
        let by = match self.either(&table, "group", "numbers")? {
            "group" => {
                let field = table.field("group")?;
                match field.node.kind {
                    Kind::Number { whole: Some(number), .. } => {
                        Listing::Group(Located { value: number.to_string(), span: field.node.span })
                    }
                    _ => Listing::Group(self.name(field)?),
                }
            }
            _ => Listing::Numbers(self.name(table.field("numbers")?)?),
        };
        Some(Members::listed(by))
    }

    /// Groups are of files of meshes and clouds.
    pub(super) fn check_groups(&mut self, sets: &[SetDefinition], context: &Context) {
        for set in sets {
            if let Members::Listed { by: Listing::Group(name), .. } = &set.members
                && context.groups == super::Groups::None
                && context.spacing.is_some()
            {
                let message = "groups are of meshes and clouds, and this body has none";
                let found = Diagnostic::error("conflicting-keys", name.span, message);
                self.error(found.help("write a condition in a string: \"X < 0.1\""));
            }
        }
    }

    /// Names become columns of tables, so they are plain words that mean nothing else there.
    pub(super) fn check_name(&mut self, what: &str, name: &str, span: Span) {
        let message = if RESERVED.contains(&name) {
            format!("a {what} cannot be called `{name}`: that name is taken")
        } else if is_plain(name) {
            return;
        } else {
            format!("a {what} cannot be called `{name}`")
        };
        let help = "a name starts with a letter and goes on with letters, digits, _ and -";
        self.error(Diagnostic::error("bad-name", span, message).help(help));
    }

    /// Groups of a file may have any names, sets that are named after them may not.
    fn check_group_name(&mut self, name: &str, span: Span) {
        if is_plain(name) && !RESERVED.contains(&name) {
            return;
        }
        let message =
            format!("a set cannot be called `{name}`, as a group of the body's file may be");
        let found = Diagnostic::error("bad-name", span, message);
        let group = name.replace('\\', "\\\\").replace('"', "\\\"");
        self.error(found.help(format!(
            "give it another name under [sets], clamp = {{ group = \"{group}\" }}, and write that here"
        )));
    }

    pub(super) fn known_set(
        &mut self,
        table: &Table<'_>,
        context: &Context,
    ) -> Option<Located<usize>> {
        let field = self.required(table, "set")?;
        self.set_named(field, context)
    }

    /// The set that a text names.
    pub(super) fn set_named(
        &mut self,
        field: Field<'_>,
        context: &Context,
    ) -> Option<Located<usize>> {
        let text = self.text(field)?;
        let known = context.sets.borrow().iter().position(|name| *name == text.value);
        let index = known.or_else(|| {
            let index = context.adopt(&text.value, field.node.span)?;
            self.check_group_name(&text.value, field.node.span);
            Some(index)
        });
        if index.is_none() {
            let sets = context.sets.borrow();
            let names: Vec<&str> = sets.iter().map(String::as_str).collect();
            let message = format!("there is no set `{}`", text.value);
            let diagnostic = Diagnostic::error("unknown-set", field.node.span, message);
            self.error(match suggest(&text.value, names.iter().copied().take(256)) {
                Some(near) => diagnostic.label(format!("did you mean `{near}`?")),
                None if names.is_empty() => {
                    diagnostic.help(format!("define it under [sets]: {} = \"X < 0.1\"", text.value))
                }
                None => diagnostic.help(format!("the sets are {}", some(&names))),
            });
        }
        index.map(|value| Located { value, span: field.node.span })
    }

    pub(super) fn prescriptions(
        &mut self,
        node: Option<&Node>,
        context: &Context,
    ) -> Vec<Prescription> {
        let tables = self.tables(&PRESCRIBE, node);
        let read = tables.iter().filter_map(|table| {
            let set = self.known_set(table, context);
            // Without any of them `u` is what is missing.
            let given =
                *self.one_of(table, &Given::ALL, Given::key).unwrap_or(&Given::Displacement);
            let components = self.required(table, given.key()).and_then(|field| {
                let items = self.components(field, context.dimension)?;
                let read: Vec<_> =
                    items.iter().map(|item| self.displacement(field.item(item), context)).collect();
                read.into_iter().collect()
            });
            Some(Prescription { set: set?, given, components: components? })
        });
        read.collect()
    }

    fn displacement(
        &mut self,
        field: Field<'_>,
        context: &Context,
    ) -> Option<Located<Option<Quantity>>> {
        if let Kind::Text(text) = &field.node.kind
            && text.value == "free"
        {
            return Some(Located { value: None, span: field.node.span });
        }
        let quantity = self.quantity(field, context)?;
        Some(Located { value: Some(quantity.value), span: quantity.span })
    }

    fn quantity(&mut self, field: Field<'_>, context: &Context) -> Option<Located<Quantity>> {
        let value = match field.node.kind {
            Kind::Text(_) => {
                Quantity::Expression(self.expression(field, Role::Number, context.dimension)?)
            }
            Kind::Number { .. } => Quantity::Number(self.number(field)?),
            _ => {
                self.wrong_type(field, "a number or an expression in a string");
                return None;
            }
        };
        Some(Located { value, span: field.node.span })
    }

    pub(super) fn loads(&mut self, node: Option<&Node>, context: &Context) -> Vec<Load> {
        let tables = self.tables(&LOAD, node);
        let read = tables.iter().filter_map(|table| {
            let set = self.known_set(table, context);
            let kind = self.one_of(table, &LoadKind::ALL, LoadKind::key).copied();
            if LoadKind::ALL.iter().all(|kind| table.get(kind.key()).is_none()) {
                self.either(table, LoadKind::Force.key(), LoadKind::Density.key());
            }
            let components = kind.and_then(|kind| table.field(kind.key())).and_then(|field| {
                let items = self.components(field, context.dimension)?;
                let read: Vec<_> =
                    items.iter().map(|item| self.force(field.item(item), context)).collect();
                read.into_iter().collect()
            });
            Some(Load { set: set?, kind: kind?, components: components? })
        });
        read.collect()
    }

    /// Which of several keys a table has; of two at once the reader complains.
    pub(super) fn one_of<'k, T: Copy>(
        &mut self,
        table: &Table<'_>,
        all: &'k [T],
        key: impl Fn(T) -> &'static str,
    ) -> Option<&'k T> {
        let mut found = all.iter().filter(|one| table.get(key(**one)).is_some());
        match (found.next(), found.next()) {
            (Some(one), Some(other)) => {
                self.either(table, key(*one), key(*other));
                None
            }
            (one, _) => one,
        }
    }

    fn force(&mut self, field: Field<'_>, context: &Context) -> Option<Located<Quantity>> {
        if let Kind::Text(text) = &field.node.kind
            && text.value == "free"
        {
            let message = "a load is a number or an expression, never \"free\"";
            let diagnostic = Diagnostic::error("free-load", field.node.span, message);
            self.error(diagnostic.help("write 0 where nothing acts"));
            return None;
        }
        self.quantity(field, context)
    }

    pub(super) fn probes(&mut self, node: Option<&Node>, context: &Context) -> Vec<Probe> {
        let tables = self.tables(&PROBE, node);
        let mut probes: Vec<Probe> = Vec::new();
        for table in &tables {
            let name = self.required(table, "name").and_then(|field| self.name(field));
            let at = self.required(table, "at").and_then(|field| {
                let value = self.vector(field, context.dimension)?;
                Some(Located { value, span: field.node.span })
            });
            let Some(name) = name else { continue };
            self.check_name("probe", &name.value, name.span);
            if let Some(first) = probes.iter().find(|probe| probe.name == name) {
                let message = format!("two probes are called `{}`", name.value);
                self.error(
                    Diagnostic::error("duplicate-probe", name.span, message)
                        .note(first.name.span, "the first stands here"),
                );
            }
            probes.extend(at.map(|at| Probe { name, at }));
        }
        probes
    }
}

/// The first names of a list.
fn some(names: &[&str]) -> String {
    const SHOWN: usize = 20;
    let more = if names.len() > SHOWN { ", .." } else { "" };
    format!("{}{more}", names[..names.len().min(SHOWN)].join(", "))
}

/// A letter, and then letters, digits, `_` and `-`.
fn is_plain(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(|c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-')
}
