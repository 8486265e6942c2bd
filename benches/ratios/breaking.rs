//! Steps of bodies that can break against steps of bodies that cannot.

use std::sync::Arc;

use piola_compiler::{Form, Level, Measure, Mode, Setting, check_text};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::criteria::{Criteria, Criterion, Layer};
use piola_runtime::fracture::memory::Memory;
use piola_runtime::fracture::{Breaking, Fracture as _};
use piola_runtime::neighborhood::Neighborhood;

use crate::clock::{Clock, in_turn};
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
    vec![table]
}

fn against_elastic(table: &mut Table, what: &str, body: &Arc<Body>, law: &SethHill, broken: bool) {
    let elastic = law.energy(body, HORIZON, &[Measure::Length]);
    let breaking = breaking(body, law);
    if broken {
        let some: Vec<usize> = (0..breaking.n_bonds()).step_by(ONE_OF).collect();
        breaking.take_out(&some);
    }
    let u = displacement(body);
    let [mut ours, mut theirs] =
        [&breaking as &dyn Energy, &elastic].map(|energy| motion(energy, &u));
    let times = in_turn(ROUNDS, Clock::Wall, [&mut || step(&mut ours), &mut || step(&mut theirs)]);
    let expected = if broken { breaking.n_bonds().div_ceil(ONE_OF) } else { 0 };
    assert_eq!(breaking.counts()[1], expected, "nothing breaks on the way");
    let [ours, theirs] = times.map(|times| times.least() * 1e3);
    let bar = if broken { Bar::AtMost(1.3, 1.1) } else { Bar::AtMost(1.1, 1.03) };
    table.ratio(what, [ours, theirs], Statistic::Least(ROUNDS), bar);
}

/// The same bonds, which break when they are twice as long.
fn breaking(body: &Arc<Body>, law: &SethHill) -> Breaking {
    let neighborhood = Arc::new(Neighborhood::new(body, HORIZON).expect("points with neighbours"));
    let text = "potential p\nparameter s0\npsi(l) = (l/L - 1)^2\nbreak when l/L - 1 > s0";
    let (_, model) = check_text(text).expect("a potential");
    let settings = [("s0".to_string(), Setting::Number(1.0))];
    let values = model.values(3, &settings, None).expect("values");
    let criteria = model.criteria(&values, Mode::Jit(Level::Fast), Form::Accurate);
    let criterion = |one: piola_compiler::Criterion| Criterion {
        measure: one.measure(),
        holds_at_zero: one.holds_at_zero,
        margin: Box::new(one.margin),
    };
    let own = criteria.expect("a condition").into_iter().map(criterion).collect();
    let layers = vec![Layer { of_law: vec![own], materials: None }];
    let criteria = Criteria::new((body, &neighborhood), layers, vec![false; body.n_points()]);
    let energy: Box<dyn Energy> = Box::new(law.energy(body, HORIZON, &[Measure::Length]));
    let (names, around) = (Arc::clone(energy.parts()), (Arc::clone(body), neighborhood));
    Breaking::new(around, vec![energy], names, (criteria, Memory::default()), Vec::new())
}
