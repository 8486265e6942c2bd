//! Forces of a body of two materials against those of the same body of one.

use piola_runtime::case::{Case, Library};
use piola_runtime::energy::{Energy, Wanted};

use crate::clock::{Clock, in_turn};
use crate::ours::{displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 15;

/// Half of the box, and balls in it.
const SETS: [(&str, &str); 2] = [
    ("halves", "X < 20"),
    (
        "balls",
        "sqrt((X - 8)^2 + (Y - 10)^2 + (Z - 10)^2) < 6 or sqrt((X - 20)^2 + (Y - 10)^2 + (Z - 10)^2) < 6 \
         or sqrt((X - 32)^2 + (Y - 10)^2 + (Z - 10)^2) < 6",
    ),
];

/// What a body is made of.
#[derive(Clone, Copy)]
enum Made {
    Even,
    Graded,
    OfTwo(&'static str),
}

/// What is measured: a name, the text of a potential or its name in the library, its parameters of both
/// materials, further tables of the scene, and the horizon in spacings.
struct Measured {
    name: &'static str,
    potential: Result<&'static str, &'static str>,
    parameters: [&'static str; 2],
    /// The same as functions of the place, with the first material's as their means: not 1, with which a law
    /// has a multiplication less.
    graded: &'static str,
    further: &'static str,
    horizon: f64,
}

const MEASURED: [Measured; 6] = [
    Measured {
        name: "bonds, affine, in runs",
        potential: Ok("potential p\nparameter C\npsi(l) = C*L*(l/L - 1)^2\n"),
        parameters: ["C = 3", "C = 10"],
        graded: "C = \"1 + 0.1*X\"",
        further: "",
        horizon: 3.0,
    },
    Measured {
        name: "bonds, logarithmic, in batches",
        potential: Ok("potential p\nparameter C\npsi(l) = C*L*ln(l/L)^2\n"),
        parameters: ["C = 3", "C = 10"],
        graded: "C = \"1 + 0.1*X\"",
        further: "",
        horizon: 3.0,
    },
    Measured {
        name: "triangles, affine, in runs",
        potential: Ok(
            "potential p\nparameter C\npsi(l) = C*L*(l/L - 1)^2\npsi(a) = C*A*(a/A - 1)^2\n",
        ),
        parameters: ["C = 3", "C = 10"],
        graded: "C = \"1 + 0.1*X\"",
        further: "",
        horizon: 2.0,
    },
    Measured {
        name: "linear peridynamic solid, in runs",
        potential: Err("linear_peridynamic_solid"),
        parameters: ["K = 2, G = 1", "K = 20, G = 10"],
        graded: "K = \"2 + 0.2*X\", G = \"1 + 0.1*X\"",
        further: "",
        horizon: 3.0,
    },
    Measured {
        name: "neo-Hooke at points",
        potential: Err("neo_hooke"),
        parameters: ["mu = 1, lambda = 2", "mu = 10, lambda = 20"],
        graded: "mu = \"1 + 0.1*X\", lambda = \"2 + 0.2*X\"",
        further: "[correspondence]\ndiscretisation = \"nodal\"\n",
        horizon: 3.0,
    },
    Measured {
        name: "neo-Hooke at bonds",
        potential: Err("neo_hooke"),
        parameters: ["mu = 1, lambda = 2", "mu = 10, lambda = 20"],
        graded: "mu = \"1 + 0.1*X\", lambda = \"2 + 0.2*X\"",
        further: "",
        horizon: 3.0,
    },
];

fn library(name: &str) -> Option<&'static str> {
    match name {
        "neo_hooke" => Some(include_str!("../../potentials/neo_hooke.piola")),
        "linear_peridynamic_solid" => {
            Some(include_str!("../../potentials/linear_peridynamic_solid.piola"))
        }
        _ => None,
    }
}

impl Measured {
    /// The body of one material, with numbers or graded, or of two by a set.
    fn case(&self, made: Made) -> Case {
        let folder = tempfile::tempdir().expect("there is room for a scene");
        let name = self.potential.map_or_else(|name| name, |_| "p.piola");
        if let Ok(text) = self.potential {
            std::fs::write(folder.path().join(name), text).expect("it can be written");
        }
        let material =
            |parameters: &str| format!("potential = \"{name}\"\nparameters = {{ {parameters} }}\n");
        let [one, two] = self.parameters.map(material);
        let materials = match made {
            Made::Even => format!("[material]\n{one}"),
            Made::Graded => format!("[material]\n{}", material(self.graded)),
            Made::OfTwo(set) => {
                format!(
                    "[sets]\nsecond = \"{set}\"\n[[material]]\n{one}[[material]]\nset = \"second\"\n{two}"
                )
            }
        };
        let scene = format!(
            "[body]\nbox = [[0, 0, 0], [40, 20, 20]]\nspacing = 1\n[horizon]\nspacings = {}\n{}{materials}",
            self.horizon, self.further
        );
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, scene).expect("it can be written");
        let library = Library { find: &library, names: &[] };
        Case::read(&file, &[], &library).unwrap_or_else(|error| panic!("{error}"))
    }
}

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "materials",
        "Forces alone of 40 x 20 x 20 points of two materials, by halves of the box or three balls in it, and of \
         one with graded parameters, against the same body of one with numbers; per bond (each once), one thread, \
         runs in turn.",
        ["other, ns", "one, ns"],
        Division::OursByTheirs,
    );
    with_threads(1, || MEASURED.iter().for_each(|measured| compare(&mut table, measured)));
    vec![table]
}

fn compare(table: &mut Table, measured: &Measured) {
    let made = [Made::Even, Made::OfTwo(SETS[0].1), Made::OfTwo(SETS[1].1), Made::Graded];
    let cases = made.map(|made| measured.case(made));
    let energies = cases.each_ref().map(|case| {
        let compiled = case.compile().expect("it compiles");
        case.energy(compiled).expect("it is a body")
    });
    let u = displacement(&cases[0].body);
    let mut out = [(); 4].map(|()| vec![0.0; u.len()]);
    let [first, second, third, fourth] = &mut out;
    let forces = |number: usize, out: &mut [f64]| {
        energies[number].evaluate(&u, Wanted::Forces(out), &mut []).expect("all is finite");
    };
    let times = in_turn(
        ROUNDS,
        Clock::Wall,
        [
            &mut || forces(0, first),
            &mut || forces(1, second),
            &mut || forces(2, third),
            &mut || forces(3, fourth),
        ],
    );
    let bonds = energies[0].bonds().n_blocks() - cases[0].body.n_points();
    let [one, halves, balls, graded] = times.map(|times| times.least() / bonds as f64 * 1e9);
    let of = Statistic::Least(ROUNDS);
    for (kind, other) in [(SETS[0].0, halves), (SETS[1].0, balls), ("graded", graded)] {
        let bar = if kind == SETS[1].0 { Bar::None } else { Bar::AtMost(1.15, 1.05) };
        table.ratio(format!("{}, {kind}", measured.name), [other, one], of, bar);
    }
}
