//! Steps of bodies that can break against steps of bodies that cannot.

use std::sync::Arc;

use piola_compiler::{Form, Level, Measure, Mode, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::Discretisation;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::{Criteria, Criterion, Layer};
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture as _};
use piola_runtime::neighborhood::Neighborhood;

use crate::clock::{Clock, in_turn};
use crate::families::{self, correspondence, solid};
use crate::forces::HORIZON;
use crate::motion::{motion, shaken, step};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 15;

/// Of a hundred bonds one is broken, where some are.
const ONE_OF: usize = 100;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "breaking",
        "A step of velocity Verlet of bonds that break at a stretch which none of them comes to, against the same \
         bonds without a criterion; 40^3 points, horizon 3, one thread; runs in turn. 1 % broken: every hundredth \
         bond.",
        ["breaking, ms", "elastic, ms"],
        Division::OursByTheirs,
    );
    let (lattice, cloud) = (cube(40), shaken(40));
    with_threads(1, || {
        for (name, n) in [("true stretch", 1.0), ("modified stretch", 2.0)] {
            let law = SethHill::new(n);
            for (kind, body) in [("lattice", &lattice), ("cloud", &cloud)] {
                against_elastic(&mut table, &format!("{name}, {kind}"), body, &law, false);
                against_elastic(
                    &mut table,
                    &format!("{name}, {kind}, 1 % broken"),
                    body,
                    &law,
                    true,
                );
            }
        }
    });
    let mut others = Table::of_ratios(
        "breaking-others",
        "The same of families whose bonds break, 20^3 points, horizon 3.015, and of triangles (14^3 points) and \
         tetrahedra (8^3), n = 1, that break by conditions of their own. 1 % broken: every hundredth bond, triangle or \
         tetrahedron, so that hardly a point has all of its own.",
        ["breaking, ms", "elastic, ms"],
        Division::OursByTheirs,
    );
    with_threads(1, || of_other_kinds(&mut others));
    vec![table, others]
}

/// A step of both, and a row.
fn compare(
    table: &mut Table,
    what: &str,
    (breaking, elastic): (&Breaking, &dyn Energy),
    u: &[f64],
    bar: Bar,
) {
    let before = breaking.n_broken();
    let [mut ours, mut theirs] = [breaking as &dyn Energy, elastic].map(|energy| motion(energy, u));
    let times = in_turn(ROUNDS, Clock::Wall, [&mut || step(&mut ours), &mut || step(&mut theirs)]);
    let [ours, theirs] = times.map(|times| times.least() * 1e3);
    table.ratio(what, [ours, theirs], Statistic::Least(ROUNDS), bar);
    assert_eq!(breaking.n_broken(), before, "nothing breaks on the way");
}

const WHOLE: Bar = Bar::AtMost(1.1, 1.03);
const SOME_BROKEN: Bar = Bar::AtMost(1.3, 1.1);

fn against_elastic(table: &mut Table, what: &str, body: &Arc<Body>, law: &SethHill, broken: bool) {
    let elastic = law.energy(body, HORIZON, &[Measure::Length]);
    let own = Box::new(law.energy(body, HORIZON, &[Measure::Length]));
    let breaking = breaking((body, HORIZON), own, BY_STRETCH);
    if broken {
        let some: Vec<usize> = (0..breaking.n_bonds()).step_by(ONE_OF).collect();
        breaking.take_out(&some);
    }
    let bar = if broken { SOME_BROKEN } else { WHOLE };
    compare(table, what, (&breaking, &elastic), &displacement(body), bar);
}

/// Bonds, areas or volumes that break when they are twice as large.
const BY_STRETCH: &str = "potential p\npsi(l) = (l/L - 1)^2\nbreak when l/L - 1 > 1";
const BY_AREA: &str = "potential p\npsi(a) = (a/A - 1)^2\nbreak when a/A - 1 > 1";
const BY_VOLUME: &str = "potential p\npsi(v) = (v/V - 1)^2\nbreak when v/V - 1 > 1";

/// Bodies of families, and of triangles and tetrahedra that have conditions of their own.
fn of_other_kinds(table: &mut Table) {
    type Made<'a> = &'a dyn Fn() -> Box<dyn Energy>;
    let body = cube(20);
    let families: [(&str, Made<'_>); 3] = [
        ("CC", &|| Box::new(correspondence(&body, Discretisation::Nodal))),
        ("BAQP", &|| Box::new(correspondence(&body, Discretisation::BondQuadrature))),
        ("LPS", &|| Box::new(solid(&body))),
    ];
    for (name, made) in families {
        for broken in [false, true] {
            let (elastic, own) = (made(), made());
            let breaking = breaking((&body, families::HORIZON), own, BY_STRETCH);
            let what = match broken {
                true => format!("{name}, 1 % broken"),
                false => name.to_owned(),
            };
            if broken {
                breaking.take_out(&(0..breaking.n_bonds()).step_by(ONE_OF).collect::<Vec<_>>());
            }
            let bar = if broken { SOME_BROKEN } else { WHOLE };
            compare(table, &what, (&breaking, &*elastic), &displacement(&body), bar);
        }
    }
    let law = SethHill::new(1.0);
    let cliques = [
        ("triangles, by their areas", 14, Measure::Area, BY_AREA),
        ("tetrahedra, by their volumes", 8, Measure::Volume, BY_VOLUME),
    ];
    for (name, n, measure, text) in cliques {
        let body = cube(n);
        let kinds = ["", ", a crack through 1 % of the bonds", ", 1 % broken"];
        for (number, kind) in kinds.into_iter().enumerate() {
            let [elastic, own] = [(), ()].map(|()| law.energy(&body, HORIZON, &[measure]));
            let breaking = breaking((&body, HORIZON), Box::new(own), text);
            match number {
                0 => {}
                1 => breaking.take_out(&crack(&body)),
                _ => {
                    let all = 0..breaking.n_cliques(measure);
                    breaking.take_out_cliques(measure, &all.step_by(ONE_OF).collect::<Vec<_>>());
                }
            }
            let bar = if number > 0 { SOME_BROKEN } else { WHOLE };
            let what = format!("{name}{kind}");
            compare(table, &what, (&breaking, &elastic), &displacement(&body), bar);
        }
    }
}

/// One of a hundred bonds: those across the middle that are nearest to a face.
fn crack(body: &Body) -> Vec<usize> {
    let neighborhood = Neighborhood::new(body, HORIZON).expect("points with neighbours");
    let x = |point: usize| body.position(point);
    let [low, high] = [0, body.n_points() - 1].map(|point| x(point)[0]);
    let n = neighborhood.n_bonds();
    let is_beyond = |point: usize| x(point)[0] > 0.5 * (low + high);
    let crosses = |bond: &usize| {
        let [p, q] = neighborhood.ends(*bond);
        is_beyond(p) != is_beyond(q)
    };
    let mut across: Vec<usize> = (0..n).filter(crosses).collect();
    let depth = |bond: usize| neighborhood.ends(bond).map(|point| x(point)[1]).iter().sum::<f64>();
    across.sort_by(|p, q| depth(*p).total_cmp(&depth(*q)));
    across.truncate(n / ONE_OF);
    across.sort_unstable();
    across
}

/// The same body, which breaks by the condition of a text.
fn breaking((body, horizon): (&Arc<Body>, f64), energy: Box<dyn Energy>, text: &str) -> Breaking {
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).expect("points with neighbours"));
    let (_, model) = check_text(text).expect("a potential");
    let values = model.values(3, &[], None).expect("values");
    let criteria = model.criteria(&values, Mode::Jit(Level::Fast), Form::Accurate);
    let criterion = |one: piola_compiler::Criterion| Criterion {
        measure: one.measure(),
        holds_at_zero: one.holds_at_zero,
        margin: Box::new(one.margin),
    };
    let own = criteria.expect("a condition").into_iter().map(criterion).collect();
    let layers = vec![Layer { of_law: vec![own], materials: None }];
    let criteria = Criteria::new((body, &neighborhood), layers, vec![false; body.n_points()]);
    let (names, around) = (Arc::clone(energy.parts()), (Arc::clone(body), neighborhood));
    Breaking::new(around, vec![energy], names, (criteria, Memory::default()), Vec::new())
}
