//! Energies of deformation gradients and of gathered states: forces and products with the Hessian, per
//! bond, against plain Rust and against hyper-dual numbers.

mod bodies;
mod laws;

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Model, Setting, Values, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::influence::Constant;
use piola_runtime::deformation::{DeformationEnergy, Discretisation, Formulation, OperatorOrder};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Law, VariablesLaw};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::states::{StateEnergy, StateLaws};
use pulp::{Arch, Simd, WithSimd};

use crate::assembly::assert_close;
use crate::clock::{Clock, in_turn};
use crate::ours::{cube, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};
use crate::tensors::{LAMBDA, MU};
use bodies::{AtBonds, Nodal, Solid};
use laws::{ByHand, ByNumbers};

const ROUNDS: usize = 101;
const POINTS: usize = 14;
pub(crate) const HORIZON: f64 = 3.015;
/// The bulk modulus of the Lame parameters.
pub(crate) const BULK: f64 = LAMBDA + 2.0 * MU / 3.0;

/// Forces at displacements, which are kept, and products with the Hessian there: loops that become
/// part of their caller.
pub(crate) trait Loops {
    /// The gradient of the energy at `u` (`n x 3`).
    fn forces(&mut self, u: &[[f64; 3]], out: &mut [[f64; 3]]);

    /// The Hessian at the `u` of the last forces times `p`.
    fn product(&mut self, p: &[[f64; 3]], out: &mut [[f64; 3]]);
}

/// The same, compiled for the widest registers of the machine, as ours.
trait Plain {
    fn forces(&mut self, u: &[[f64; 3]], out: &mut [[f64; 3]]);
    fn product(&mut self, p: &[[f64; 3]], out: &mut [[f64; 3]]);
}

impl<B: Loops> Plain for B {
    fn forces(&mut self, u: &[[f64; 3]], out: &mut [[f64; 3]]) {
        Arch::new().dispatch(Wide::<B, false>(self, u, out));
    }

    fn product(&mut self, p: &[[f64; 3]], out: &mut [[f64; 3]]) {
        Arch::new().dispatch(Wide::<B, true>(self, p, out));
    }
}

/// Forces, or products, of a body in registers of whatever width.
struct Wide<'a, B, const IS_PRODUCT: bool>(&'a mut B, &'a [[f64; 3]], &'a mut [[f64; 3]]);

impl<B: Loops, const IS_PRODUCT: bool> WithSimd for Wide<'_, B, IS_PRODUCT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Wide(body, x, out) = self;
        if IS_PRODUCT { body.product(x, out) } else { body.forces(x, out) }
    }
}

/// Times of one model, in ns per bond.
struct Row {
    name: &'static str,
    ours: f64,
    by_hand: f64,
    by_numbers: f64,
}

pub(crate) fn run() -> Vec<Table> {
    let rows = with_threads(1, || {
        let body = cube(POINTS);
        let lists = Neighborhood::new(&body, HORIZON).expect("a cube has neighbours");
        let nodal = correspondence(&body, Discretisation::Nodal);
        let at_bonds = correspondence(&body, Discretisation::BondQuadrature);
        let solid = solid(&body);
        let mut rows = compare(
            ["CC, forces", "CC, product", "CC, first product"],
            (&body, &nodal),
            [&mut Nodal::<ByHand>::new(&body, &lists), &mut Nodal::<ByNumbers>::new(&body, &lists)],
        );
        rows.extend(compare(
            ["BAQP, forces", "BAQP, product", "BAQP, first product"],
            (&body, &at_bonds),
            [
                &mut AtBonds::<ByHand>::new(&body, &lists),
                &mut AtBonds::<ByNumbers>::new(&body, &lists),
            ],
        ));
        rows.extend(compare(
            ["LPS, forces", "LPS, product", "LPS, first product"],
            (&body, &solid),
            [&mut Solid::<ByHand>::new(&body, &lists), &mut Solid::<ByNumbers>::new(&body, &lists)],
        ));
        rows
    });
    let how = "Forces and products with the Hessian per bond (each once) of 14^3 points, horizon 3.015, constant \
               influence, one thread; runs in turn. St Venant-Kirchhoff material at points (CC) \
               and at bonds (BAQP), the linear solid (LPS).";
    let mut plain = Table::of_ratios(
        "families",
        format!(
            "{how} Theirs: loops for this one model in the same registers as ours, with derivatives by hand, with the \
             states of the last forces kept for products; before a first product they work out the forces."
        ),
        ["ours, ns", "plain, ns"],
        Division::OursByTheirs,
    );
    let mut numbers = Table::of_ratios(
        "families-hyper-dual",
        format!(
            "{how} Theirs: the same loops as plain Rust, with dual numbers for forces and hyper-dual ones for \
             products, one pass per component of F for eight tensors side by side (`benches/ratios/tensors/numbers.rs`, with what \
             was slower), and per length and dilatation."
        ),
        ["ours, ns", "hyper-dual, ns"],
        Division::TheirsByOurs,
    );
    for Row { name, ours, by_hand, by_numbers } in rows {
        let bar = match name {
            "CC, forces" | "CC, product" => Bar::AtMost(1.1, 0.8),
            "BAQP, forces" | "BAQP, product" => Bar::AtMost(1.3, 1.0),
            "LPS, forces" => Bar::AtMost(1.1, 0.8),
            "LPS, first product" => Bar::AtMost(1.3, 1.0),
            _ => Bar::None,
        };
        plain.ratio(name, [ours, by_hand], Statistic::Least(ROUNDS), bar);
        numbers.ratio(name, [ours, by_numbers], Statistic::Least(ROUNDS), Bar::None);
    }
    vec![plain, numbers]
}

fn compare(
    names: [&'static str; 3],
    (body, energy): (&Body, &dyn Energy),
    [by_hand, by_numbers]: [&mut dyn Plain; 2],
) -> Vec<Row> {
    let u = displacement(body);
    let p: Vec<f64> = u.iter().rev().copied().collect();
    let (u_rows, p_rows) = (u.as_chunks::<3>().0, p.as_chunks::<3>().0);
    let mut ours = [vec![0.0; u.len()], vec![0.0; u.len()]];
    let mut theirs: [[Vec<[f64; 3]>; 2]; 2] =
        std::array::from_fn(|_| std::array::from_fn(|_| vec![[0.0; 3]; u.len() / 3]));
    let [[hand_force, hand_product], [number_force, number_product]] = &mut theirs;
    let [force, product] = &mut ours;
    let bonds = Neighborhood::new(body, HORIZON).expect("a cube has neighbours").n_bonds() as f64;
    let forces = in_turn(
        ROUNDS,
        Clock::Wall,
        [
            &mut || {
                energy.forces(&u, force).expect("all is finite");
            },
            &mut || by_hand.forces(u_rows, hand_force),
            &mut || by_numbers.forces(u_rows, number_force),
        ],
    );
    let hessian = energy.hessian(&u).expect("all is finite");
    let products = in_turn(
        ROUNDS,
        Clock::Wall,
        [
            &mut || hessian.multiply(&p, product),
            &mut || by_hand.product(p_rows, hand_product),
            &mut || by_numbers.product(p_rows, number_product),
        ],
    );
    drop(hessian);
    // At displacements that are new each time: ours works out what it keeps, theirs the forces.
    let grown: Vec<f64> = u.iter().map(|u| 1.001 * u).collect();
    let (grown_rows, mut count) = (grown.as_chunks::<3>().0, 0);
    let mut unused = [vec![0.0; u.len()], vec![0.0; u.len()]];
    let (mut hand, mut number) = (vec![[0.0; 3]; u.len() / 3], vec![[0.0; 3]; u.len() / 3]);
    let firsts = in_turn(
        ROUNDS,
        Clock::Wall,
        [
            &mut || {
                count += 1;
                let at = if count % 2 == 0 { &u } else { &grown };
                energy.hessian(at).expect("all is finite").multiply(&p, &mut unused[count % 2]);
            },
            &mut || {
                by_hand.forces(grown_rows, &mut hand);
                by_hand.product(p_rows, &mut hand);
            },
            &mut || {
                by_numbers.forces(grown_rows, &mut number);
                by_numbers.product(p_rows, &mut number);
            },
        ],
    );
    for theirs in [&hand, &number] {
        assert_close(names[2], &unused[1], theirs.as_flattened());
    }
    assert_close(names[2], &unused[0], &ours[1]);
    for theirs in &theirs {
        for ((name, ours), theirs) in names.iter().zip(&ours).zip(theirs) {
            assert_close(name, ours, theirs.as_flattened());
        }
    }
    let row = |(name, times): (&'static str, [crate::clock::Times; 3])| {
        let [ours, by_hand, by_numbers] = times.map(|times| times.least() / bonds * 1e9);
        Row { name, ours, by_hand, by_numbers }
    };
    names.into_iter().zip([forces, products, firsts]).map(row).collect()
}

fn library(name: &str, parameters: &[(&str, f64)]) -> (Model, Values) {
    let path = format!("{}/potentials/{name}.piola", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).expect("the library is there");
    let (_, model) = check_text(&text).expect("the library is right");
    let settings: Vec<(String, Setting)> =
        parameters.iter().map(|(name, x)| (name.to_string(), Setting::Number(*x))).collect();
    let values = model.values(3, &settings, Some(HORIZON)).expect("these values are allowed");
    (model, values)
}

pub(crate) fn correspondence(
    body: &Arc<Body>,
    discretisation: Discretisation,
) -> DeformationEnergy {
    let (model, values) = library("st_venant_kirchhoff", &[("lambda", LAMBDA), ("mu", MU)]);
    let compiled = model.compile(&values, Mode::Jit(Level::default()), Form::Accurate);
    let law = compiled.expect("it compiles").gradient.expect("it has an energy of F");
    let formulation = Formulation {
        horizon: HORIZON,
        order: OperatorOrder::First,
        discretisation,
        influence: &Constant,
    };
    DeformationEnergy::new(Arc::clone(body), formulation, Box::new(law))
        .expect("a cube has families")
}

pub(crate) fn solid(body: &Arc<Body>) -> StateEnergy {
    let moduli = [("K", BULK), ("G", MU), ("p", 0.0)];
    let (model, values) = library("linear_peridynamic_solid", &moduli);
    let compiled = model.compile(&values, Mode::Jit(Level::default()), Form::Accurate);
    let kernels = compiled.expect("it compiles").gathered.expect("it gathers");
    let laws = StateLaws {
        of_law: Vec::new(),
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        points: kernels.points.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        bonds: kernels.bonds.map(|law| Box::new(law) as Box<dyn VariablesLaw>),
        ..StateLaws::default()
    };
    StateEnergy::new(Arc::clone(body), HORIZON, laws).expect("a cube has families")
}
