//! From the tree of a scene to a [`Scene`]: one function per table.

mod body;
mod conditions;
mod correspondence;
mod fracture;
mod material;
mod motion;

use std::cell::RefCell;

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::energy::Products;
use piola_mechanics::words::Words;
use piola_solvers::linear::settled;
use piola_solvers::steps::{Control, Find};

use super::check;
use super::expression::{Expression, Role};
use super::keys::{Row, Slot, named};
use super::overrides;
use super::reader::{Field, Reader, Schema, Table};
use super::source::Sources;
use super::tree::{self, Kind, Node};
use material::Composition;
pub use material::MOST_LAWS;
pub(super) use motion::MOTION_KEYS;

use super::{
    Listing, Located, MAX_SCENE_BYTES, Members, OutputSettings, Points, Scene, SceneReport,
    SetDefinition, SolverSettings, Steps,
};

static SCENE: Schema = Schema {
    title: "a scene",
    keys: &[
        ("body", "{ .. }"),
        ("horizon", "{ .. }"),
        ("material", "{ .. }"),
        ("interface", "[{ .. }]"),
        ("correspondence", "{ .. }"),
        ("sets", "{ .. }"),
        ("initial", "[{ .. }]"),
        ("prescribe", "[{ .. }]"),
        ("load", "[{ .. }]"),
        ("probe", "[{ .. }]"),
        ("steps", "{ .. }"),
        ("motion", "{ .. }"),
        ("crack", "[{ .. }]"),
        ("fracture", "{ .. }"),
        ("track", "[{ .. }]"),
        ("solver", "{ .. }"),
        ("output", "{ .. }"),
    ],
};
static STEPS: Schema = Schema { title: "[steps]", keys: &named(&STEPS_KEYS) };
static SOLVER: Schema = Schema { title: "[solver]", keys: &named(&SOLVER_KEYS) };
static OUTPUT: Schema = Schema { title: "[output]", keys: &named(&OUTPUT_KEYS) };

/// Title and keys of a table.
pub(super) type Titled = (&'static str, &'static [(&'static str, &'static str)]);

/// Every table of a scene, those that stand once first.
pub(super) fn schemas() -> Vec<Titled> {
    let alone: [&Schema; 7] = [
        &body::BODY,
        &body::HORIZON,
        &correspondence::CORRESPONDENCE,
        &STEPS,
        &motion::MOTION,
        &SOLVER,
        &OUTPUT,
    ];
    let parts: [&[&Schema]; 5] =
        [&alone, &material::TABLES, &conditions::TABLES, &[&motion::INITIAL], &fracture::TABLES];
    parts.concat().into_iter().map(|schema| (schema.title, schema.keys)).collect()
}

pub(super) const STEPS_KEYS: [Row<Steps>; 8] = [
    ("end", "1.0", |steps| Slot::Positive(&mut steps.end)),
    ("increments", "25", |steps| Slot::Count(&mut steps.increments, 1)),
    ("find", "\"newton\"", |steps| Slot::Word(&mut steps.find)),
    ("control", "\"load\"", |steps| Slot::Word(&mut steps.control)),
    ("breaking", "\"all\"", |steps| Slot::Word(&mut steps.breaking)),
    ("tie", "1e-9", |steps| Slot::Fraction(&mut steps.tie)),
    ("events", "10000", |steps| Slot::Count(&mut steps.events, 1)),
    ("arcs", "1000", |steps| Slot::Count(&mut steps.arcs, 1)),
];

/// In the order in which they are written.
pub(super) const SOLVER_KEYS: [Row<SolverSettings>; 13] = [
    ("tolerance", "1e-10", |solver| Slot::Fraction(&mut solver.tolerance)),
    ("start", "\"last\"", |solver| Slot::Word(&mut solver.start)),
    ("newton", "\"full\"", |solver| Slot::Word(&mut solver.newton)),
    ("linear", "\"auto\"", |solver| Slot::Word(&mut solver.linear)),
    ("preconditioner", "\"auto\"", |solver| Slot::Word(&mut solver.preconditioner)),
    ("products", "\"exact\"", |solver| Slot::Word(&mut solver.products)),
    ("derivatives", "\"jit\"", |solver| Slot::Word(&mut solver.derivatives)),
    ("level", "\"fast\"", |solver| Slot::Word(&mut solver.level)),
    ("form", "\"accurate\"", |solver| Slot::Word(&mut solver.form)),
    ("strain", "\"displacements\"", |solver| Slot::Word(&mut solver.strain)),
    ("passes", "\"auto\"", |solver| Slot::Word(&mut solver.passes)),
    ("unstable", "\"fail\"", |solver| Slot::Word(&mut solver.unstable)),
    ("max_iterations", "25", |solver| Slot::Count(&mut solver.max_iterations, 1)),
];

pub(super) const OUTPUT_KEYS: [Row<OutputSettings>; 6] = [
    ("frames", "25", |output| Slot::Count(&mut output.frames, 0)),
    ("every", "\"1 us\"", |output| Slot::SecondsOr(&mut output.every, "frames")),
    ("rows", "1000", |output| Slot::Count(&mut output.rows, 1)),
    ("checkpoint", "\"600 s\"", |output| Slot::Seconds(&mut output.checkpoint)),
    ("fields", "[\"strain\", \"stress\"]", |output| Slot::Fields(&mut output.fields)),
    ("colour", "\"displacement\"", |output| Slot::Colour(&mut output.colour)),
];

impl Scene {
    /// Reads a scene and applies overrides (`solver.tolerance=1e-8`, see `--set`) to it.
    ///
    /// `name` is how messages call the file. All mistakes of the file and the overrides are
    /// reported at once. No file is opened.
    pub fn read(text: &str, name: &str, overrides: &[String]) -> Result<Scene, SceneReport> {
        Scene::read_partly(text, name, overrides).map_err(|(report, _)| *report)
    }

    /// The same; of a scene with mistakes what could be read of it, too, where that is enough to look at its
    /// potentials.
    pub(crate) fn read_partly(
        text: &str,
        name: &str,
        overrides: &[String],
    ) -> Result<Scene, (Box<SceneReport>, Option<Box<Scene>>)> {
        let mut sources = Sources::new(name, text);
        let size = text.len() + overrides.iter().map(String::len).sum::<usize>();
        if size > MAX_SCENE_BYTES {
            let message = format!("the scene has {size} bytes; at most {MAX_SCENE_BYTES} are read");
            let span = Span::new(0, text.len().min(1));
            let error = Diagnostic::error("scene-too-large", span, message);
            return Err((Box::new(sources.report(vec![error])), None));
        }
        let mut entries =
            tree::parse_document(text).map_err(|found| (Box::new(sources.report(found)), None))?;
        let mut reader = Reader::default();
        for text in overrides {
            if let Err(diagnostic) = overrides::apply(text, &mut entries, &mut sources) {
                reader.error(*diagnostic);
            }
        }
        let root = Node { span: Span::new(0, 0), kind: Kind::Table(entries) };
        match reader.scene(&root, &sources) {
            Some(scene) if reader.found.is_empty() => Ok(scene),
            part => Err((Box::new(sources.report(reader.found)), part.map(Box::new))),
        }
    }
}

/// What the tables need to know of each other.
struct Context {
    dimension: Option<usize>,
    /// The spacing of a lattice, 0 for other points, `None` if the body could not be read.
    spacing: Option<f64>,
    /// Names of sets; those that are groups of the body's file are added where they are named.
    sets: RefCell<Vec<String>>,
    groups: Groups,
    adopted: RefCell<Vec<SetDefinition>>,
}

/// Which names of sets may be groups of the body's file.
#[derive(Clone, Copy, PartialEq)]
enum Groups {
    /// Any: those of a mesh.
    Any,
    /// `block_1` and so on: those of a cloud.
    Blocks,
    None,
}

impl Context {
    fn new(dimension: Option<usize>, points: Option<&Points>, sets: Vec<String>) -> Context {
        let groups = match points {
            Some(Points::Mesh(mesh)) if mesh.spacing.is_none() => Groups::Any,
            Some(Points::Cloud { .. }) => Groups::Blocks,
            _ => Groups::None,
        };
        let spacing = points.map(|points| points.spacing().unwrap_or(0.0));
        let sets = RefCell::new(sets);
        Context { dimension, spacing, sets, groups, adopted: RefCell::default() }
    }

    /// Takes a name for a group of the body's file, if it may be one; its place among the sets.
    fn adopt(&self, name: &str, span: Span) -> Option<usize> {
        let fits = match self.groups {
            Groups::Any => true,
            Groups::Blocks => name.starts_with("block_"),
            Groups::None => false,
        };
        if !fits {
            return None;
        }
        let name = Located { value: name.to_string(), span };
        let members = Members::listed(Listing::Group(name.clone()));
        let mut sets = self.sets.borrow_mut();
        sets.push(name.value.clone());
        self.adopted.borrow_mut().push(SetDefinition { name, members });
        Some(sets.len() - 1)
    }
}

impl Reader {
    fn scene(&mut self, root: &Node, sources: &Sources) -> Option<Scene> {
        let root = self.table(&SCENE, root)?;
        let section = |reader: &mut Reader, schema: &'static Schema, key| {
            root.get(key).map(|entry| reader.table(schema, &entry.node))
        };
        let body_table = section(self, &body::BODY, "body");
        let horizon_table = section(self, &body::HORIZON, "horizon");
        let correspondence_table =
            section(self, &correspondence::CORRESPONDENCE, "correspondence").flatten();
        let steps_table = section(self, &STEPS, "steps").flatten();
        let solver_table = section(self, &SOLVER, "solver").flatten();
        let output_table = section(self, &OUTPUT, "output").flatten();

        let (dimension, body) = self.needed("body", body_table, Reader::body).unwrap_or_default();
        let (names, mut sets) = self.sets(root.get("sets").map(|entry| &entry.node), dimension);
        let context = Context::new(dimension, body.as_ref().map(|body| &body.points), names);
        self.check_groups(&sets, &context);
        let horizon =
            self.needed("horizon", horizon_table, |reader, table| reader.horizon(table, &context));
        let made_of = self.composition(root.get("material"), root.get("interface"), &context);
        let correspondence =
            correspondence_table.as_ref().map(|table| self.correspondence(table, dimension));
        let nodes = |key| root.get(key).map(|entry| &entry.node);
        let prescriptions = self.prescriptions(nodes("prescribe"), &context);
        let loads = self.loads(nodes("load"), &context);
        let initial = self.initial(nodes("initial"), &context);
        let probes = self.probes(nodes("probe"), &context);
        let cracks = self.cracks(nodes("crack"), &context);
        let fracture = self.fracture(root.get("fracture"), &context, root.get("motion").is_some());
        let tracks = self.tracks(nodes("track"), &context);
        let steps = self.steps(steps_table.as_ref());
        let solver = self.solver(solver_table.as_ref());
        let output = self.settings(output_table.as_ref(), &OUTPUT_KEYS);
        sets.extend(context.adopted.take());
        let warnings = check::warnings(&prescriptions, &loads, &sets);
        let motion = root.get("motion").map(|entry| self.motion(entry));
        let Composition { materials, regions, interfaces } = made_of?;
        let motion = match motion {
            Some(motion) => Some(motion?),
            None => None,
        };
        let keys = [root.get("steps"), root.get("initial")];
        self.check_motion(motion.as_ref(), keys, (&prescriptions, &loads), (&materials, &regions));
        self.check_output(motion.as_ref(), output_table.as_ref(), &output);
        Some(Scene {
            body: body?,
            horizon: horizon?,
            materials,
            regions,
            interfaces,
            correspondence: match correspondence {
                Some(settings) => Some(settings?),
                None => None,
            },
            sets,
            initial,
            prescriptions,
            loads,
            probes,
            cracks,
            fracture: fracture?,
            tracks,
            steps,
            motion,
            solver,
            output,
            warnings,
            sources: sources.clone(),
        })
    }

    /// Reads a table that every scene has; `None` within `Some` is a table of the wrong type.
    fn needed<'t, T>(
        &mut self,
        name: &str,
        table: Option<Option<Table<'t>>>,
        read: impl FnOnce(&mut Reader, &Table<'t>) -> Option<T>,
    ) -> Option<T> {
        match table {
            Some(table) => table.and_then(|table| read(self, &table)),
            None => {
                let message = format!("the scene has no [{name}]");
                self.error(Diagnostic::error("missing-table", Span::new(0, 0), message));
                None
            }
        }
    }

    /// Of two keys that exclude each other, the one that is there.
    pub(super) fn either<'k>(
        &mut self,
        table: &Table<'_>,
        one: &'k str,
        other: &'k str,
    ) -> Option<&'k str> {
        let title = table.schema.title;
        match (table.get(one), table.get(other)) {
            (Some(_), None) => Some(one),
            (None, Some(_)) => Some(other),
            (None, None) => {
                let message = format!("{title} has neither `{one}` nor `{other}`");
                self.error(Diagnostic::error("missing-key", table.span, message));
                None
            }
            (Some(first), Some(second)) => {
                let message = format!("{title} has both `{one}` and `{other}`");
                let (early, late) = match first.key_span < second.key_span {
                    true => (first, second),
                    false => (second, first),
                };
                self.error(
                    Diagnostic::error("conflicting-keys", late.key_span, message)
                        .note(early.key_span, "one of the two is enough"),
                );
                None
            }
        }
    }

    /// A string that is not empty.
    pub(super) fn name(&mut self, field: Field<'_>) -> Option<Located<String>> {
        let text = self.text(field)?;
        if text.value.trim().is_empty() {
            self.out_of_range(field, "a name");
            return None;
        }
        Some(Located { value: text.value.clone(), span: field.node.span })
    }

    pub(super) fn expression(
        &mut self,
        field: Field<'_>,
        role: Role,
        dimension: Option<usize>,
    ) -> Option<Expression> {
        let Kind::Text(text) = &field.node.kind else {
            self.wrong_type(field, "an expression in a string");
            return None;
        };
        match Expression::compile(text, role, dimension) {
            Ok(expression) => Some(expression),
            Err(found) => {
                found.into_iter().for_each(|diagnostic| self.error(diagnostic));
                None
            }
        }
    }

    fn steps(&mut self, table: Option<&Table<'_>>) -> Steps {
        let steps = self.settings(table, &STEPS_KEYS);
        let given = |key: &str| table.and_then(|table| table.get(key));
        let by_newton = |message| given("find").map(|entry| (entry, message, "find = \"newton\""));
        let refused = match (steps.control, steps.find) {
            (Control::Event, Find::Relaxation) => by_newton("events are found by Newton's method"),
            (Control::ArcLength, Find::Relaxation) => {
                by_newton("the way of equilibria is followed by Newton's method")
            }
            (Control::Event, _) => given("breaking").map(|entry| {
                (entry, "in an event the first bonds break, whatever `breaking` says", "tie = 1e-9")
            }),
            (Control::Load | Control::ArcLength, _) => None,
        };
        let has = |control| steps.control == control;
        let idle = [
            ("tie", has(Control::Event), "only steps by events have `tie`", "control = \"event\""),
            (
                "events",
                has(Control::Event),
                "only steps by events have `events`",
                "control = \"event\"",
            ),
            (
                "arcs",
                has(Control::ArcLength),
                "only steps along the way have `arcs`",
                "control = \"arc-length\"",
            ),
        ];
        let idle = idle.into_iter().find_map(|(key, fits, message, instead)| {
            given(key).filter(|_| !fits).map(|entry| (entry, message, instead))
        });
        if let Some((entry, message, instead)) = refused.or(idle) {
            let found = Diagnostic::error("conflicting-keys", entry.key_span, message);
            self.error(found.help(format!("write {instead}, or leave the key out")));
        }
        steps
    }

    fn solver(&mut self, table: Option<&Table<'_>>) -> SolverSettings {
        let solver = self.settings(table, &SOLVER_KEYS);
        self.check_products(table, &solver);
        solver
    }

    /// Products by differences of forces serve methods that store no tangent.
    fn check_products(&mut self, table: Option<&Table<'_>>, solver: &SolverSettings) {
        let entry = table.and_then(|table| table.get("products"));
        let stored =
            settled(solver.linear, false, solver.products).is_some_and(|c| c.stores_matrix);
        let Some(entry) = entry.filter(|_| solver.products != Products::Exact && stored) else {
            return;
        };
        let (linear, products) = (solver.linear.word(), solver.products.word());
        let message =
            format!("linear = \"{linear}\" needs the tangent, products = \"{products}\" has none");
        let help = "write linear = \"gmres\", or \"matrix-free\" for conjugate gradients";
        let diagnostic = Diagnostic::error("conflicting-keys", entry.key_span, message);
        self.error(diagnostic.help(help));
    }
}
