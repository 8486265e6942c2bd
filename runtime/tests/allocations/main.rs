//! Passes keep their arrays: after the first call forces, energies and products allocate nothing. And
//! an energy is one number, whichever pass it comes from.
//!
//! All allocations of the process count: there is one test here, and nothing beside it.

#[allow(dead_code)]
#[path = "../mechanics/common.rs"]
mod common;
mod compiled;
#[allow(dead_code)]
#[path = "../correspondence/common.rs"]
mod families;
mod states;

use std::alloc::System;
use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::deformation::OperatorOrder;
use piola_runtime::energy::{Energy, EnergyParts, Products, Term, Total, Wanted};
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::Watch;
use piola_runtime::solve::motion::{Initial, Motion, MotionDrive, MotionSettings};
use piola_runtime::weights::Weights;
use rayon::{ThreadPool, ThreadPoolBuilder};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};

use common::{cloud, displacements, seth_hill};

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// How often memory was asked for so far, by all threads.
fn asked() -> usize {
    let stats = COUNTED.stats();
    stats.allocations + stats.reallocations
}

/// An energy with displacements of its body.
struct Case {
    name: String,
    energy: Box<dyn Energy>,
    u: Vec<f64>,
    /// Whether its tangent, too, is assembled in arrays that are there.
    keeps_tangent: bool,
}

impl Case {
    fn new(name: String, energy: Box<dyn Energy>, u: Vec<f64>) -> Case {
        Case { name, energy, u, keeps_tangent: false }
    }
}

fn interactions(counts: &[usize], kinds: [bool; 3]) -> Case {
    let body = cloud(counts, 0.1, 3);
    let u = displacements(&body, 0.05, 5);
    let laws = Laws {
        bond: kinds[0].then(|| seth_hill(1.0, 0)),
        triangle: kinds[1].then(|| seth_hill(300.0, 2)),
        tetrahedron: kinds[2].then(|| seth_hill(1e6, -1)),
    };
    let energy = DiscreteEnergy::new(body, 0.21, Weights::Truncated, laws).unwrap();
    let name = format!("interactions {kinds:?} in {} dimensions", counts.len());
    Case { keeps_tangent: true, ..Case::new(name, Box::new(energy), u) }
}

/// Bonds and triangles of different horizons: the tangent of one is added to that of the other.
fn sum_of_interactions() -> Case {
    let body = cloud(&[9, 4, 4], 0.1, 3);
    let u = displacements(&body, 0.05, 5);
    let term = |horizon: f64, laws: Laws| -> Term<'_> {
        Box::new(DiscreteEnergy::new(body.clone(), horizon, Weights::Unit, laws).unwrap()).into()
    };
    let bonds = Laws { bond: Some(seth_hill(1.0, 0)), ..Laws::default() };
    let triangles = Laws { triangle: Some(seth_hill(300.0, 2)), ..Laws::default() };
    let names = ["bonds", "triangles"].map(String::from).into();
    let energy = Total::named(vec![term(0.31, bonds), term(0.21, triangles)], names);
    let name = "a sum of interactions".to_string();
    Case { keeps_tangent: true, ..Case::new(name, Box::new(energy), u) }
}

fn cases() -> Vec<Case> {
    let (plane, space): (&[usize], &[usize]) = (&[13, 6], &[9, 4, 4]);
    let mut cases = vec![
        interactions(plane, [true, false, false]),
        interactions(plane, [true, true, false]),
        interactions(space, [true, false, false]),
        interactions(space, [true, true, false]),
        interactions(space, [true; 3]),
    ];
    for counts in [plane, space] {
        let d = counts.len();
        let body = families::cloud(counts, 7);
        let u = families::displacements(&body, &families::h_of(d), 0.01, 9);
        for (name, energy) in states::energies(&body, 2.3) {
            let name = format!("states {name} in {d} dimensions");
            cases.push(Case::new(name, Box::new(energy), u.clone()));
        }
        for (name, energy) in compiled::energies(&body, 2.3) {
            cases.push(Case::new(format!("{name} in {d} dimensions"), energy, u.clone()));
        }
        for order in [OperatorOrder::First, OperatorOrder::Second] {
            for place in families::DISCRETISATIONS {
                let energy = families::energy(&body, 2.3, order, place, "cubic");
                let name = format!("{place:?} {order:?} in {d} dimensions");
                cases.push(Case::new(name, Box::new(energy), u.clone()));
            }
        }
    }
    let lattice = lattice(&[26.0, 16.0]);
    let u = families::displacements(&lattice, &families::h_of(2), 0.01, 9);
    for (name, energy) in compiled::energies(&lattice, 2.3) {
        cases.push(Case::new(format!("{name} along rows"), energy, u.clone()));
    }
    cases.push(sum_of_interactions());
    cases.extend([Products::Exact, Products::OneSided, Products::Central].map(sum));
    cases
}

fn lattice(upper: &[f64]) -> Arc<Body> {
    let (lower, upper) = (vec![0.0; upper.len()], upper.to_vec());
    let points = Lattice { lower, upper, spacing: 1.0, nodes: Nodes::Cells }.points().unwrap();
    Arc::new(Body::new(2, &points.positions, &points.volumes, Some(1.0)))
}

/// Interactions and deformation gradients, which add up, with strain from positions.
fn sum(products: Products) -> Case {
    let counts = [9, 4, 4];
    let body = families::cloud(&counts, 7);
    let u = families::displacements(&body, &families::h_of(3), 0.01, 9);
    let laws = Laws { bond: Some(seth_hill(1.0, 0)), ..Laws::default() };
    let bonds = DiscreteEnergy::new(body.clone(), 2.3, Weights::Volumes, laws).unwrap();
    let place = families::DISCRETISATIONS[0];
    let gradients = families::energy(&body, 2.3, OperatorOrder::First, place, "cubic");
    let names = bonds.parts().iter().chain(gradients.parts().iter()).cloned().collect();
    let terms: Vec<Term<'_>> = vec![Box::new(bonds).into(), Box::new(gradients).into()];
    let energy = Total::named(terms, names).with_products(products).from_positions(true);
    Case::new(format!("a sum with {products:?} products"), Box::new(energy), u)
}

/// One call warms up, the second and the third allocate nothing.
fn allocates_nothing(case: &Case, what: &str, threads: usize, mut pass: impl FnMut() + Send) {
    pass();
    for call in [2, 3] {
        let before = asked();
        pass();
        let count = asked() - before;
        let name = &case.name;
        assert_eq!(count, 0, "{name}: {what}, call {call}, {threads} threads");
    }
}

fn count(case: &Case, pool: &ThreadPool) {
    let Case { energy, u, keeps_tangent, .. } = case;
    let p: Vec<f64> = u.iter().rev().copied().collect();
    let (mut out, mut parts) = (vec![0.0; u.len()], vec![0.0; energy.parts().len()]);
    let threads = pool.current_num_threads();
    // Jobs of other threads than the pool's are queued, which allocates.
    pool.install(|| {
        allocates_nothing(case, "energy", threads, || {
            energy.evaluate(u, Wanted::Energy, &mut parts).unwrap();
        });
        allocates_nothing(case, "forces", threads, || {
            energy.evaluate(u, Wanted::Forces(&mut out), &mut parts).unwrap();
        });
        allocates_nothing(case, "forces alone", threads, || {
            energy.evaluate(u, Wanted::Forces(&mut out), &mut []).unwrap();
        });
        let mut diagonal = vec![0.0; u.len() * energy.dimension()];
        if *keeps_tangent {
            let mut tangent = BlockMatrix::zeros(energy.pattern());
            allocates_nothing(case, "tangent", threads, || {
                energy.evaluate(u, Wanted::Tangent(&mut out, &mut tangent), &mut parts).unwrap();
            });
            allocates_nothing(case, "diagonal", threads, || {
                energy.evaluate(u, Wanted::Diagonal(&mut out, &mut diagonal), &mut parts).unwrap();
            });
        }
        let hessian = energy.hessian(u).unwrap();
        allocates_nothing(case, "product", threads, || hessian.multiply(&p, &mut out));
        assert!(out.iter().all(|x| x.is_finite()), "{}", case.name);
        steps_allocate_nothing(case, threads);
    });
}

/// Nothing drives the body.
struct Free;

impl MotionDrive for Free {
    fn displaced(&self) -> &[usize] {
        &[]
    }

    fn displacements(&self, _: f64, _: &mut [f64]) {}

    fn driven(&self) -> &[usize] {
        &[]
    }

    fn velocities(&self, _: f64, _: &mut [f64]) {}

    fn loads(&self, _: f64, loads: &mut [f64]) {
        loads.fill(0.0);
    }
}

/// Six steps in time ask for no more memory than one does, with the row that is due at its end.
fn steps_allocate_nothing(case: &Case, threads: usize) {
    let masses = vec![1.0; case.u.len() / case.energy.dimension()];
    let initial = Initial { displacements: case.u.clone(), velocities: vec![0.0; case.u.len()] };
    let settings =
        MotionSettings { end: 1e-5, step: Some(1e-7), unstable: true, ..MotionSettings::default() };
    let watch = Watch::default();
    let motion = Motion::new(&*case.energy, &masses, initial, &Free, &settings, &watch);
    let mut motion = motion.unwrap();
    let mut count = |step| {
        let before = asked();
        motion.advance_to(step).unwrap();
        asked() - before
    };
    count(3);
    let (one, six) = (count(4), count(10));
    assert_eq!(one, six, "{}: steps, {threads} threads", case.name);
}

/// The same bits from all passes.
fn compare(case: &Case) {
    let Case { name, energy, u, .. } = case;
    let bits = |parts: EnergyParts| -> Vec<u64> {
        parts.iter().map(|(_, value)| value.to_bits()).collect()
    };
    let mut forces = [vec![0.0; u.len()], vec![0.0; u.len()], vec![0.0; u.len()]];
    let expected = bits(energy.forces(u, &mut forces[0]).unwrap());
    assert_eq!(bits(energy.energy(u).unwrap()), expected, "{name}: the energy alone");
    energy.evaluate(u, Wanted::Forces(&mut forces[1]), &mut []).unwrap();
    assert!(forces[1] == forces[0], "{name}: forces without energies");
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let parts = energy.tangent(u, &mut forces[1], &mut tangent).unwrap();
    assert_eq!(bits(parts), expected, "{name}: the tangent");
    let mut diagonal = vec![0.0; u.len() * energy.dimension()];
    let parts = energy.tangent_diagonal(u, &mut forces[2], &mut diagonal).unwrap();
    assert_eq!(bits(parts), expected, "{name}: the diagonal");
    assert!(forces[2] == forces[0], "{name}: forces with the diagonal");
}

#[test]
fn passes_allocate_nothing_after_their_first_call_and_agree_on_the_energy() {
    // Threads that begin or end allocate: all begin before anything is counted, and none ends.
    let pools = [1, 2].map(|threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.broadcast(|_| ());
        pool
    });
    for case in cases() {
        pools.iter().for_each(|pool| count(&case, pool));
        compare(&case);
    }
}
