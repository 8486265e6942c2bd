//! `[material]`, `[[material]]` and `[[interface]]`: what a body is made of.

use piola_grammar::{Diagnostic, Span, names, suggest};

use super::Context;
use crate::scene::reader::{Field, Reader, Schema, Table};
use crate::scene::tree::{Entry, Kind, Node};
use crate::scene::{
    Interface, InterfaceRule, Located, Material, ParameterSetting, ParameterText, Region,
};

/// Most materials, with the interfaces that have potentials of their own.
pub const MOST_LAWS: usize = 255;

static MATERIAL: Schema = Schema {
    title: "[material]",
    keys: &[
        ("set", "\"left\""),
        ("name", "\"steel\""),
        ("potential", "\"law.piola\""),
        ("density", "\"2440 kg/m^3\""),
        ("parameters", "{ C1 = 1.0, E = \"200 GPa\" }"),
        ("plus", "[{ .. }]"),
    ],
};
static PLUS: Schema = Schema {
    title: "[[material.plus]]",
    keys: &[("potential", "\"law.piola\""), ("parameters", "{ C1 = 1.0, E = \"200 GPa\" }")],
};
static INTERFACE: Schema = Schema {
    title: "[[interface]]",
    keys: &[
        ("between", "[\"steel\", \"concrete\"]"),
        ("rule", "\"mean\""),
        ("as", "\"concrete\""),
        ("potential", "\"law.piola\""),
        ("parameters", "{ C1 = 1.0, E = \"200 GPa\" }"),
    ],
};
pub(super) static TABLES: [&Schema; 3] = [&MATERIAL, &PLUS, &INTERFACE];

/// The name of the material of all points that no other has, unless the scene gives it one.
const REST: &str = "rest";

/// What a body is made of.
#[derive(Default)]
pub(super) struct Composition {
    pub(super) materials: Vec<Material>,
    pub(super) regions: Vec<Region>,
    pub(super) interfaces: Vec<Interface>,
}

impl Reader {
    pub(super) fn composition(
        &mut self,
        material: Option<&Entry>,
        interface: Option<&Entry>,
        context: &Context,
    ) -> Option<Composition> {
        let Some(material) = material else {
            let message = "the scene has no [material]";
            self.error(Diagnostic::error("missing-table", Span::new(0, 0), message));
            return None;
        };
        let mut made_of = Composition::default();
        if let Kind::Array(_) = &material.node.kind {
            let tables = self.tables(&MATERIAL, Some(&material.node));
            if tables.is_empty() {
                let message = "the scene has no [[material]]";
                self.error(Diagnostic::error("missing-table", material.key_span, message));
            }
            let complete = self.regions(&tables, &mut made_of, context);
            let rules = self.tables(&INTERFACE, interface.map(|entry| &entry.node));
            let ruled =
                rules.iter().filter(|table| self.interface(table, &mut made_of).is_none()).count()
                    == 0;
            return (complete && ruled && self.check_laws(&made_of, material.key_span))
                .then_some(made_of);
        }
        if let Some(interface) = interface {
            let message =
                "an [[interface]] is between two materials, and the scene has one [material]";
            let help = "write [[material]] for each, with a `set` of its points";
            self.error(
                Diagnostic::error("conflicting-keys", interface.key_span, message).help(help),
            );
        }
        let table = self.table(&MATERIAL, &material.node)?;
        for key in ["set", "name"] {
            if let Some(entry) = table.get(key) {
                let message = format!("[material] is all of the body and has no `{key}`");
                let help = "write [[material]], twice the brackets, for one of several materials";
                self.error(
                    Diagnostic::error("conflicting-keys", entry.key_span, message).help(help),
                );
            }
        }
        made_of.materials = self.potentials(&table, 0)?;
        Some(made_of)
    }

    /// Every `[[material]]`; whether all could be read.
    fn regions(
        &mut self,
        tables: &[Table<'_>],
        made_of: &mut Composition,
        context: &Context,
    ) -> bool {
        let mut complete = !tables.is_empty();
        for (law, table) in tables.iter().enumerate() {
            let region = self.region(table, &made_of.regions, context);
            let potentials = self.potentials(table, law);
            complete &= region.is_some() && potentials.is_some();
            // A region that cannot be read keeps its number: others are not to be misread for it.
            made_of.regions.push(region.unwrap_or(Region {
                name: Located { value: String::new(), span: table.span },
                set: None,
            }));
            made_of.materials.extend(potentials.into_iter().flatten());
        }
        complete
    }

    fn region(
        &mut self,
        table: &Table<'_>,
        before: &[Region],
        context: &Context,
    ) -> Option<Region> {
        let set = match table.get("set") {
            Some(_) => Some(self.known_set(table, context)?),
            None => None,
        };
        let name = match table.field("name") {
            Some(field) => {
                let name = self.name(field)?;
                self.check_name("material", &name.value, name.span);
                name
            }
            None => match set {
                Some(set) => {
                    Located { value: context.sets.borrow()[set.value].clone(), span: set.span }
                }
                None => Located { value: REST.to_string(), span: table.span },
            },
        };
        if let Some(first) = before.iter().find(|region| region.name == name) {
            let message = format!("two materials are called `{}`", name.value);
            let help = "give each a name = \"..\" of its own";
            let found = Diagnostic::error("duplicate-material", name.span, message).help(help);
            self.error(found.note(first.name.span, "the first stands here"));
            return None;
        }
        if set.is_none()
            && let Some(first) = before.iter().find(|region| region.set.is_none())
        {
            let message = "two materials without a `set` would have the same points";
            let help = "the one without a `set` has all points that no other has: give one of them its set";
            let found = Diagnostic::error("missing-key", table.span, message).help(help);
            self.error(found.note(first.name.span, "the first stands here"));
            return None;
        }
        Some(Region { name, set })
    }

    /// One `[[interface]]`.
    fn interface(&mut self, table: &Table<'_>, made_of: &mut Composition) -> Option<()> {
        let field = self.required(table, "between")?;
        let Kind::Array(items) = &field.node.kind else {
            self.wrong_type(field, "the names of two materials");
            return None;
        };
        let [one, other] = &items[..] else {
            self.wrong_type(field, "the names of two materials");
            return None;
        };
        let of = |reader: &mut Reader, node: &Node| {
            reader.known_material(field.item(node), &made_of.regions)
        };
        let (one, other) = (of(self, one), of(self, other));
        let between = [one?, other?];
        if between[0] == between[1] {
            let message = "an interface lies between two different materials";
            self.error(Diagnostic::error("out-of-range", field.node.span, message));
            return None;
        }
        let pair = |interface: &&Interface| {
            let known = interface.between;
            known == between || known == [between[1], between[0]]
        };
        if let Some(first) = made_of.interfaces.iter().find(pair) {
            let message = "two interfaces are between the same materials";
            let found = Diagnostic::error("conflicting-keys", field.node.span, message);
            self.error(found.note(first.between[0].span, "the first stands here"));
            return None;
        }
        let rule = self.rule(table, between, made_of)?;
        made_of.interfaces.push(Interface { between, rule });
        Some(())
    }

    fn rule(
        &mut self,
        table: &Table<'_>,
        between: [Located<usize>; 2],
        made_of: &mut Composition,
    ) -> Option<InterfaceRule> {
        let word = match table.field("rule") {
            Some(field) => Some((field, self.text(field)?.value.as_str())),
            None => None,
        };
        if let Some((field, other)) = word.filter(|(_, word)| !["mean", "as"].contains(word)) {
            let message = format!("there is no rule `{other}`");
            let help = "write \"mean\", \"as\" with `as` = one of the two materials, or a `potential` in place of the rule";
            self.error(Diagnostic::error("unknown-choice", field.node.span, message).help(help));
            return None;
        }
        let others = ["as", "potential"].map(|key| table.get(key).is_some());
        match (word.map(|(_, word)| word), others) {
            (None | Some("as"), [true, false]) => {
                let field = self.required(table, "as")?;
                let material = self.known_material(field, &made_of.regions)?;
                if !between.contains(&material) {
                    let message = "`as` names one of the two materials of `between`";
                    self.error(Diagnostic::error("out-of-range", field.node.span, message));
                    return None;
                }
                Some(InterfaceRule::As(material.value))
            }
            (None, [false, true]) => {
                let behind = made_of.materials.iter().map(|m| m.law + 1).max().unwrap_or(0);
                let law = behind.max(made_of.regions.len());
                made_of.materials.push(self.material(table, law)?);
                Some(InterfaceRule::Potential(law))
            }
            (None | Some("mean"), [false, false]) => Some(InterfaceRule::Mean),
            (Some("as"), [false, _]) => {
                self.required(table, "as");
                None
            }
            _ => {
                let message = "an [[interface]] has one rule: \"mean\", `as` or a `potential`";
                self.error(Diagnostic::error("conflicting-keys", table.span, message));
                None
            }
        }
    }

    fn known_material(&mut self, field: Field<'_>, regions: &[Region]) -> Option<Located<usize>> {
        let text = self.text(field)?;
        let index = regions.iter().position(|region| region.name.value == text.value);
        if index.is_none() {
            let names: Vec<&str> =
                regions.iter().map(|region| region.name.value.as_str()).collect();
            let message = format!("there is no material `{}`", text.value);
            let found = Diagnostic::error("unknown-material", field.node.span, message);
            self.error(match suggest(&text.value, names.iter().copied()) {
                Some(near) => found.label(format!("did you mean `{near}`?")),
                None => found.help(format!("the materials are {}", names.join(", "))),
            });
        }
        index.map(|value| Located { value, span: field.node.span })
    }

    fn check_laws(&mut self, made_of: &Composition, span: Span) -> bool {
        let laws = made_of.materials.iter().map(|material| material.law + 1).max().unwrap_or(0);
        if laws > MOST_LAWS {
            let message = format!(
                "{laws} materials and interfaces with potentials of their own are too many"
            );
            let help = format!("write at most {MOST_LAWS}");
            self.error(Diagnostic::error("out-of-range", span, message).help(help));
        }
        laws <= MOST_LAWS
    }

    /// The potentials of one material, whose energies add up.
    fn potentials(&mut self, table: &Table<'_>, law: usize) -> Option<Vec<Material>> {
        let mut materials = vec![self.material(table, law)];
        let further = self.tables(&PLUS, table.field("plus").map(|field| field.node));
        materials.extend(further.iter().map(|table| self.material(table, law)));
        materials.into_iter().collect()
    }

    fn material(&mut self, table: &Table<'_>, law: usize) -> Option<Material> {
        let potential = self.required(table, "potential").and_then(|field| self.name(field));
        let parameters = self
            .or(Some(table), "parameters", Vec::new(), |reader, field| reader.parameters(field));
        let density = self.density(table);
        Some(Material { law, potential: potential?, parameters: parameters?, density: density? })
    }

    fn parameters(&mut self, field: Field<'_>) -> Option<Vec<ParameterSetting>> {
        let Kind::Table(entries) = &field.node.kind else {
            self.wrong_type(field, "a table");
            return None;
        };
        let mut complete = true;
        let mut parameters = Vec::new();
        for entry in entries {
            // A list holds the entries of a vector.
            let values: Vec<(String, &Node)> = match &entry.node.kind {
                Kind::Array(items) if !items.is_empty() => {
                    let named = |k: usize| names::entry(&entry.key, k as u32 + 1);
                    items.iter().enumerate().map(|(k, item)| (named(k), item)).collect()
                }
                _ => vec![(entry.key.clone(), &entry.node)],
            };
            for (name, node) in values {
                let item = Field { schema: field.schema, key: &entry.key, node };
                let value = self.parameter(item);
                complete &= value.is_some();
                parameters.extend(value.map(|value| ParameterSetting {
                    name: Located { value: name, span: entry.key_span },
                    value: Located { value, span: content_span(node) },
                }));
            }
        }
        complete.then_some(parameters)
    }

    fn parameter(&mut self, field: Field<'_>) -> Option<ParameterText> {
        match &field.node.kind {
            Kind::Text(text) => Some(ParameterText::Quantity(text.value.clone())),
            Kind::Number { .. } => self.number(field).map(ParameterText::Number),
            _ => {
                let found = field.node.kind_name();
                let message = format!("expected a number or a string, found {found}");
                let help = format!(
                    "write {0} = 1.0 or {0} = \"200 GPa\"; a vector of parameters has a list of them",
                    field.key
                );
                let diagnostic = Diagnostic::error("wrong-type", field.node.span, message);
                self.error(diagnostic.help(help));
                None
            }
        }
    }
}

/// What stands between the quotes of a string; all of any other value.
fn content_span(node: &Node) -> Span {
    match &node.kind {
        Kind::Text(text) => text.content,
        _ => node.span,
    }
}
