//! Discretisations of deformation gradients as text against the built-in ones: forces and products with the Hessian,
//! per bond.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, Stabilisation};
use piola_runtime::energy::Energy;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::vectors::{VectorEnergy, VectorLaws};

use crate::assembly::assert_close;
use crate::clock::{Clock, in_turn};
use crate::families::{HORIZON, correspondence};
use crate::ours::{cube, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};
use crate::tensors::{LAMBDA, MU};

const ROUNDS: usize = 15;
const POINTS: usize = 10;

/// Stiffness of Silling's stabilisation.
const STIFFNESS: f64 = 10.0;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "families-as-text",
        "Forces and products with the Hessian per bond (each once) of 10^3 points, horizon 3.015, constant influence, \
         St Venant-Kirchhoff material, one thread; runs in turn. Texts: `examples/correspondence_as_text`, whose points \
         gather tensors.",
        ["built in, ns", "text, ns"],
        Division::TheirsByOurs,
    );
    let kinds = [
        ("nodal", ["CC, forces", "CC, product"], Discretisation::Nodal),
        (
            "silling",
            ["CS, forces", "CS, product"],
            Discretisation::Stabilised(Stabilisation::Silling { stiffness: STIFFNESS }),
        ),
        ("wan", ["CW, forces", "CW, product"], Discretisation::Stabilised(Stabilisation::Wan)),
        ("bond_quadrature", ["BAQP, forces", "BAQP, product"], Discretisation::BondQuadrature),
    ];
    with_threads(1, || {
        let body = cube(POINTS);
        for (file, names, discretisation) in kinds {
            let built_in = correspondence(&body, discretisation);
            let text = of_text(&body, file);
            for (name, times) in names.into_iter().zip(compare(names, &body, [&built_in, &text])) {
                table.ratio(name, times, Statistic::Least(ROUNDS), Bar::None);
            }
        }
    });
    vec![table]
}

/// The energy of a text with constant influence.
fn of_text(body: &Arc<Body>, file: &str) -> VectorEnergy {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/correspondence_as_text");
    let text = std::fs::read_to_string(format!("{folder}/{file}.piola")).expect("it is there");
    let (_, model) =
        check_text(&text.replace("w(L) = 1/L", "w(L) = 1 + 0*L")).expect("it is right");
    let all = [("lambda", LAMBDA), ("mu", MU), ("Cs", STIFFNESS)];
    let own =
        all.into_iter().filter(|(name, _)| model.parameters().iter().any(|p| p.name == *name));
    let settings: Vec<(String, Setting)> =
        own.map(|(name, x)| (name.to_string(), Setting::Number(x))).collect();
    let values = model.values(3, &settings, Some(HORIZON)).expect("these values are allowed");
    let compiled = model.compile(&values, Mode::Jit(Level::default()), Form::Accurate);
    let kernels = compiled.expect("it compiles").vectors.expect("it gathers vectors");
    let arguments = ["H".to_string(), "xi, H".to_string()];
    let laws = VectorLaws { of_law: vec![Some(kernels)], thickness: 1.0, arguments };
    let lists = Arc::new(Neighborhood::new(body, HORIZON).expect("a cube has neighbours"));
    VectorEnergy::new(Arc::clone(body), lists, None, laws).expect("a cube has families")
}

/// Forces and products, in ns per bond, of both.
fn compare(
    names: [&'static str; 2],
    body: &Body,
    [built_in, text]: [&dyn Energy; 2],
) -> [[f64; 2]; 2] {
    let u = displacement(body);
    let p: Vec<f64> = u.iter().rev().copied().collect();
    let mut out =
        [[vec![0.0; u.len()], vec![0.0; u.len()]], [vec![0.0; u.len()], vec![0.0; u.len()]]];
    let [[force, text_force], [product, text_product]] = &mut out;
    let forces = in_turn(
        ROUNDS,
        Clock::Wall,
        [
            &mut || {
                built_in.forces(&u, force).expect("all is finite");
            },
            &mut || {
                text.forces(&u, text_force).expect("all is finite");
            },
        ],
    );
    let hessians = [built_in, text].map(|energy| energy.hessian(&u).expect("all is finite"));
    let products = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || hessians[0].multiply(&p, product), &mut || hessians[1].multiply(&p, text_product)],
    );
    for (name, [ours, theirs]) in names.into_iter().zip(&out) {
        assert_close(name, ours, theirs);
    }
    let bonds = Neighborhood::new(body, HORIZON).expect("a cube has neighbours").n_bonds() as f64;
    [forces, products].map(|times| times.map(|times| times.least() / bonds * 1e9))
}
