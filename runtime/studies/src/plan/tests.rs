//! Counts against brute force, estimates against measurements.

use piola_mechanics::interaction::{Census, Degeneracy, Slabs};
use piola_mechanics::neighborhood::Neighborhood;

use super::count::bonds_in_box;
use super::*;
use crate::machine::{Machine, Rates};

fn lattice(counts: [usize; 3], d: usize) -> Body {
    let mut positions = Vec::new();
    for x in 0..counts[0] {
        for y in 0..counts[1] {
            for z in 0..counts[2] {
                positions.extend(&[x as f64 * 0.1, y as f64 * 0.1, z as f64 * 0.1][..d]);
            }
        }
    }
    let n = positions.len() / d;
    Body::new(d, &positions, &vec![libm::pow(0.1, d as f64); n], Some(0.1))
}

const ALL: Needed = Needed { triangles: true, tetrahedra: true };

fn counted(body: &Body, horizon: f64, needed: Needed) -> InteractionCount {
    count_interactions(body, &Neighborhood::new(body, horizon).unwrap(), needed)
}

/// Every interaction of a body, by the census that the assembly takes.
fn census(body: &Body, horizon: f64) -> Census {
    let neighborhood = Neighborhood::new(body, horizon).unwrap();
    let slabs = Slabs::new(&neighborhood);
    Census::new(body, &neighborhood, Degeneracy::new(body), &slabs, |_| true)
}

#[test]
fn a_small_body_is_counted_exactly() {
    for (counts, d) in [([9, 7, 1], 2), ([6, 6, 5], 3)] {
        let body = lattice(counts, d);
        let (found, exact) = (counted(&body, 0.2, ALL), census(&body, 0.2));
        assert!(found.exact);
        assert_eq!(found.bonds, exact.bonds);
        assert_eq!(found.triangles, exact.triangles);
        assert_eq!(found.tetrahedra, exact.tetrahedra);
    }
}

#[test]
fn a_sample_of_a_large_body_is_close() {
    let body = lattice([14, 13, 12], 3);
    let (estimate, exact) = (counted(&body, 0.2, ALL), census(&body, 0.2));
    assert!(!estimate.exact);
    assert_eq!(estimate.bonds, exact.bonds);
    let error = |estimate: u64, exact: u64| (estimate as f64 / exact as f64 - 1.0).abs();
    assert!(error(estimate.triangles, exact.triangles) < 0.1, "{estimate:?} {exact:?}");
    assert!(error(estimate.tetrahedra, exact.tetrahedra) < 0.1, "{estimate:?} {exact:?}");
}

#[test]
fn what_is_not_needed_is_not_counted() {
    let found = counted(&lattice([14, 13, 12], 3), 0.2, Needed::default());
    assert_eq!((found.triangles, found.tetrahedra, found.exact), (0, 0, true));
}

/// Factors of lattices ordered by faer's approximate minimum degree: sides, horizon in spacings,
/// entries, flops.
const MEASURED: &[([f64; 3], f64, f64, f64)] = &[
    ([30.0, 30.0, 1.0], 3.0, 2.3645e5, 3.9074e7),
    ([100.0, 100.0, 1.0], 2.0, 2.4465e6, 6.0688e8),
    ([100.0, 100.0, 1.0], 3.0, 6.1931e6, 3.0904e9),
    ([200.0, 200.0, 1.0], 4.0, 5.6893e7, 7.2874e10),
    ([400.0, 40.0, 1.0], 3.0, 7.4571e6, 2.2782e9),
    ([400.0, 400.0, 1.0], 3.0, 1.8689e8, 2.9396e11),
    ([8.0, 8.0, 8.0], 3.0, 5.9333e5, 2.9866e8),
    ([16.0, 16.0, 16.0], 2.0, 1.1997e7, 1.9370e10),
    ([20.0, 20.0, 20.0], 3.0, 6.4150e7, 2.4777e11),
    ([26.0, 26.0, 26.0], 3.0, 2.5502e8, 1.9182e12),
    ([60.0, 10.0, 10.0], 3.0, 2.1567e7, 3.0373e10),
    ([40.0, 40.0, 8.0], 3.0, 8.9852e7, 2.9431e11),
    ([100.0, 40.0, 5.0], 3.0, 1.0393e8, 2.3415e11),
];

#[test]
fn factors_are_estimated_within_their_promise() {
    for &(sides, layers, entries, flops) in MEASURED {
        let d = if sides[2] == 1.0 { 2 } else { 3 };
        let estimate = estimate_factor(&sides[..d], layers, d);
        let (e, f) = (estimate.entries / entries, estimate.flops / flops);
        assert!((0.6..1.3).contains(&e), "{sides:?}: entries {e} of the truth");
        assert!((0.4..1.5).contains(&f), "{sides:?}: flops {f} of the truth");
    }
}

#[test]
fn a_factor_has_at_least_the_dense_triangle_of_a_tiny_body() {
    let estimate = estimate_factor(&[2.0, 2.0], 3.0, 2);
    assert_eq!(estimate.entries, 8.0 * 8.0 / 2.0);
}

fn scene(settings: &str) -> Scene {
    let text = format!(
        "[body]\nbox = [[0, 0, 0], [2, 2, 2]]\nspacing = 0.1\n\
         [horizon]\nspacings = 3\n[material]\npotential = \"p\"\n{settings}"
    );
    Scene::read(&text, "scene.toml", &[]).unwrap()
}

fn plan(scene: &Scene, available_memory: Option<u64>) -> Plan {
    plan_of(lattice([20, 20, 20], 3), scene, available_memory)
}

fn plan_of(body: Body, scene: &Scene, available_memory: Option<u64>) -> Plan {
    plan_with(body, scene, &[], available_memory)
}

fn plan_with(
    body: Body,
    scene: &Scene,
    families: &[Families],
    available_memory: Option<u64>,
) -> Plan {
    plan_of_sum(body, scene, (usize::from(families.is_empty()), families), available_memory)
}

fn plan_of_sum(
    body: Body,
    scene: &Scene,
    sum: (usize, &[Families]),
    available_memory: Option<u64>,
) -> Plan {
    plan_at(Pace::usual(1), body, scene, sum, available_memory)
}

fn plan_at(
    pace: Pace,
    body: Body,
    scene: &Scene,
    (of_interactions, families): (usize, &[Families]),
    available_memory: Option<u64>,
) -> Plan {
    let input = input(&body, scene, of_interactions, families);
    Plan::new(PlanInput { pace, available_memory, ..input })
}

fn input<'a>(
    body: &Body,
    scene: &'a Scene,
    of_interactions: usize,
    families: &[Families],
) -> PlanInput<'a> {
    let interactions = counted(body, scene.horizon_radius(), Needed::default());
    PlanInput {
        scene,
        extent: Extent::of(body),
        notes: Vec::new(),
        interactions: InteractionCount { triangles: 6_820_000, exact: false, ..interactions },
        kernels: vec![
            KernelNote { energy: "psi(l)".into(), modelled: true, reason: String::new() },
            KernelNote { energy: "psi(v)".into(), modelled: false, reason: "C3 = 0".into() },
        ],
        energies: [1; 3],
        without_kernels: [false; 3],
        breaks: false,
        breaks_cliques: [false; 2],
        states: [0; 4],
        of_interactions,
        families: families.to_vec(),
        prescribed: 1200,
        threads: 1,
        pace: Pace::usual(1),
        available_memory: None,
    }
}

/// The cube of 20^3 points with 408,364 bonds: times and memory that were measured.
#[test]
fn estimates_are_within_a_factor_of_three_of_measurements() {
    let within = |estimate: f64, measured: f64| {
        assert!(estimate < 3.0 * measured && measured < 3.0 * estimate, "{estimate} {measured}");
    };
    let direct = plan(&scene("[solver]\nlinear = \"cholesky\""), None);
    assert_eq!(direct.interactions.bonds, 408_364);
    assert_eq!(direct.unknowns, 22_800);
    assert_eq!(direct.linear.method, LinearMethod::Cholesky);
    within(direct.time.linear, 6.2);
    within(direct.time.assembly, 0.30);
    within(direct.memory_total as f64, 922e6);
    let iterative = plan(&scene("[solver]\nlinear = \"cg\""), None);
    within(iterative.time.linear, 0.08);
    assert!(iterative.memory_total < direct.memory_total / 8);
    let jacobi = "[solver]\nlinear = \"cg\"\npreconditioner = \"block-jacobi\"";
    within(plan(&scene(jacobi), None).time.linear, 0.25);
    let lu = plan(&scene("[solver]\nlinear = \"lu\""), None);
    within(lu.time.linear, 26.0);
    within(lu.memory_total as f64, 3.56e9);
}

/// Each rate of a machine where it counts: twice as fast is half as long.
#[test]
fn times_are_those_of_the_machine() {
    let rates = |bandwidth, arithmetic| Rates { bandwidth, arithmetic };
    let machine = Machine {
        version: String::new(),
        processor: String::new(),
        lanes: 8,
        threads: 3,
        one: rates(1e10, 1e10),
        all: rates(2e10, 2e10),
        factorisation: 2e10,
    };
    let faster = Machine { factorisation: 4e10, ..machine.clone() };
    let time = |linear: &str, machine: &Machine, threads| {
        let scene = scene(&format!("[solver]\nlinear = \"{linear}\""));
        let (body, pace) = (lattice([10, 10, 10], 3), Pace::of(machine, threads));
        plan_at(pace, body, &scene, (1, &[]), None).time
    };
    let (one, all) = (time("cg", &machine, 1), time("cg", &machine, 3));
    assert_eq!((one.linear, all.setup), (2.0 * all.linear, one.setup));
    // Three threads that have the arithmetic of two.
    assert!((one.assembly / all.assembly - 1.7).abs() < 1e-12, "{one:?} {all:?}");
    assert_eq!(one, time("cg", &faster, 1));
    for direct in ["cholesky", "lu"] {
        let of = |machine, threads| time(direct, machine, threads);
        assert_eq!(of(&machine, 1).linear, of(&machine, 3).linear);
        assert_eq!(of(&machine, 1).linear, 2.0 * of(&faster, 1).linear);
        assert_eq!(of(&machine, 1).assembly, of(&faster, 1).assembly);
    }
}

/// A third of the time for products, two thirds for assembly, and tables: 38 and 11 ns a triangle for 55 and 40.
#[test]
fn laws_without_kernels_take_less_time_and_have_tables() {
    let scene = scene("[solver]\nlinear = \"matrix-free\"\n");
    let input = input(&lattice([20, 20, 20], 3), &scene, 1, &[]);
    let [kernels, none] = [false, true]
        .map(|without| Plan::new(PlanInput { without_kernels: [without; 3], ..input.clone() }));
    let products = none.time.linear / kernels.time.linear;
    assert!((0.2..0.35).contains(&products), "{products}");
    let assembly = none.time.assembly / kernels.time.assembly;
    assert!((0.6..0.75).contains(&assembly), "{assembly}");
    let bytes = |plan: &Plan| {
        let tables = plan.memory.iter().find(|item| item.item == "tables of cliques");
        tables.map(|item| item.bytes)
    };
    assert_eq!(bytes(&kernels), None);
    // Four bytes of a bond, and 852 triangles of a point in tables of 256 bytes each.
    assert_eq!(bytes(&none), Some(4 * 408_364 + 256 * 6_820_000 / 8000));
}

#[test]
fn what_exceeds_the_machine_is_refused() {
    let direct = scene("[solver]\nlinear = \"cholesky\"");
    assert_eq!(plan(&direct, None).refusal(), None);
    let refusal = plan(&direct, Some(100_000_000)).refusal().unwrap();
    assert!(refusal.contains("factor") && refusal.contains("100 MB"), "{refusal}");
}

#[test]
fn auto_avoids_a_factor_and_a_matrix_that_do_not_fit() {
    let auto = scene("");
    let of = |memory| plan_of(lattice([10, 10, 10], 3), &auto, memory);
    let plenty = of(None);
    assert_eq!(plenty.linear.method, LinearMethod::Cholesky, "{}", plenty.linear.reason);
    // The factor takes 13 MB, the matrix 3 MB.
    let small = of(Some(12_000_000));
    assert_eq!(small.linear.method, LinearMethod::Cg, "{}", small.linear.reason);
    assert!(small.linear.reason.contains("exceeds"), "{}", small.linear.reason);
    assert_eq!(small.refusal(), None);
    let tiny = of(Some(4_000_000));
    assert_eq!(tiny.linear.method, LinearMethod::MatrixFree, "{}", tiny.linear.reason);
    assert_eq!(tiny.refusal(), None);
}

/// 20^3 points take 2.3e11 operations: more than the solver spends on one factorisation.
#[test]
fn auto_iterates_where_the_solver_does() {
    assert_eq!(plan(&scene(""), None).linear.method, LinearMethod::Cg);
}

#[test]
fn the_time_grows_with_the_increments() {
    let few = plan(&scene("[steps]\nincrements = 10"), None).time;
    let many = plan(&scene("[steps]\nincrements = 20"), None).time;
    let (few, many) = (few.total - few.setup, many.total - many.setup);
    assert!((many / few - 2.0).abs() < 1e-12);
}

#[test]
fn a_plan_reads_well_and_is_json() {
    let plan = plan(&scene(""), Some(8_000_000_000));
    let text = plan.to_string();
    let parts = ["408 364", "triangles (estimated)", "C3 = 0", "dropped", "available", "8.0 GB"];
    for part in parts.into_iter().chain(["conjugate gradients:", "22800 unknowns in three"]) {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    assert!(text.lines().all(|line| line.len() < 80 && line == line.trim_end()), "{text}");
    let json = serde_json::to_value(&plan).unwrap();
    assert_eq!(json["interactions"]["bonds"], 408_364);
    assert_eq!(json["linear"], "cg");
    assert!(json["linear_reason"].as_str().unwrap().contains("a factorisation would take"));
    assert_eq!(json["kernels"][1]["reason"], "C3 = 0");
}

#[test]
fn this_machine_has_memory() {
    assert!(available_memory().unwrap() > 1_000_000);
}

#[test]
fn a_body_has_what_its_energies_need_and_nothing_else() {
    let scene_of = |linear: &str| scene(&format!("[solver]\nlinear = \"{linear}\"\n"));
    let items = |families: &[Families], linear: &str| -> Vec<&str> {
        let plan = plan_with(lattice([10, 10, 10], 3), &scene_of(linear), families, None);
        plan.memory.iter().map(|item| item.item).collect()
    };
    let bonds = items(&[], "auto");
    for absent in ["deformation gradients", "bond quadrature", "gathered states", "stabilisation"] {
        assert!(!bonds.contains(&absent), "{bonds:?}");
    }
    let nodal = items(&[Families::Nodal], "auto");
    assert!(nodal.contains(&"deformation gradients") && !nodal.contains(&"bond quadrature"));
    assert!(!nodal.contains(&"tangent, upper blocks"), "{nodal:?}");
    assert!(items(&[Families::BondQuadrature], "auto").contains(&"bond quadrature"));
    assert!(items(&[Families::States(2)], "auto").contains(&"gathered states"));
    assert!(items(&[Families::Nodal], "cg").contains(&"tangent, upper blocks"));
    // A stored tangent reaches three horizons.
    let bytes = |families: &[Families]| {
        let plan = plan_with(lattice([10, 10, 10], 3), &scene_of("cg"), families, None);
        let tangent = plan.memory.iter().find(|item| item.item == "tangent, upper blocks");
        tangent.unwrap().bytes
    };
    assert!(bytes(&[Families::BondQuadrature]) > 8 * bytes(&[]));
    assert!(bytes(&[Families::Nodal]) > 4 * bytes(&[]));
}

/// Blocks of the patterns of stored tangents: sides, horizon in spacings, of two horizons and of three.
const PATTERNS: &[([usize; 3], f64, f64, f64)] = &[
    ([40, 40, 1], 3.0, 74_900.0, 152_378.0),
    ([40, 40, 1], 2.0, 31_230.0, 61_660.0),
    ([10, 10, 10], 2.0, 61_356.0, 145_864.0),
    ([9, 9, 9], 3.0, 128_184.0, 233_906.0),
];

#[test]
fn blocks_of_stored_tangents_are_estimated() {
    for &(sides, layers, two, three) in PATTERNS {
        let d = if sides[2] == 1 { 2 } else { 3 };
        let body = lattice(sides, d);
        let interactions = counted(&body, 0.1 * layers, Needed::default());
        for (reach, measured) in [(2, two), (3, three)] {
            let ratio = blocks(&Extent::of(&body), layers, &interactions, reach) / measured;
            assert!((0.95..1.5).contains(&ratio), "{sides:?} {layers} {reach}: {ratio}");
        }
    }
}

fn first(solved: f64, stored: Option<ChangeOver>) -> FirstIncrement {
    FirstIncrement {
        iterations: 4,
        assembly: 0.5,
        linear: 1.2,
        line_search: 0.3,
        solved,
        stored,
        ..FirstIncrement::default()
    }
}

/// What goes before a stored tangent is taken once; increments are like the iterations after.
#[test]
fn a_change_over_is_paid_once() {
    let scene = scene("[steps]\nincrements = 10");
    let planned = || plan_with(lattice([8, 8, 8], 3), &scene, &[Families::Nodal], None);
    let stored = planned().stored.unwrap();
    let rehearsed = |solved, change| {
        let mut plan = planned();
        plan.rehearsed(first(solved, change));
        plan
    };
    let change = |iterations| {
        let reason = "they take long".to_string();
        Some(ChangeOver { reason, iterations, seconds: 1.4 })
    };
    let close = |x: f64, y: f64| assert!((x / y - 1.0).abs() < 1e-12, "{x} {y}");
    let setup = planned().time.setup;
    // Without one every increment takes 2 s.
    let products = rehearsed(1.0, None);
    close(products.time.total, setup + 10.0 * 2.0);
    assert_eq!(products.memory_total, planned().memory_total);
    // Three iterations after it take 0.6 s; an increment has four.
    let solved = rehearsed(1.0, change(1));
    close(solved.time.total, setup + 1.4 + 10.0 * 0.8);
    close(solved.time.assembly + solved.time.linear, 0.2);
    close(solved.time.assembly / solved.time.linear, stored.assembly / stored.linear);
    assert_eq!(solved.memory, stored.memory);
    // Half an increment, and one that was not solved.
    close(rehearsed(0.5, change(1)).time.increment, 1.6);
    close(rehearsed(0.0, change(1)).time.increment, 5.0 * 0.2);
    // None of them seen: the estimate.
    let unseen = rehearsed(0.0, change(4)).time;
    close(unseen.increment, 5.0 * (stored.assembly + stored.linear));
    assert_eq!(unseen.basis, Basis::Iterations);
    let text = solved.to_string();
    for part in ["gradients, then by Cholesky with a stored", "system, Cholesky", "they take long"]
    {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    assert!(!text.contains("where one takes over"), "{text}");
}

/// A stored tangent may take over in `auto` alone, beyond the bonds, where it fits.
#[test]
fn a_stored_tangent_is_planned_where_it_may_take_over() {
    let of = |linear: &str, families: &[Families], memory| {
        let scene = scene(&format!("[solver]\nlinear = \"{linear}\""));
        plan_with(lattice([8, 8, 8], 3), &scene, families, memory)
    };
    let nodal = [Families::Nodal];
    let auto = of("auto", &nodal, None);
    let stored = auto.stored.clone().unwrap();
    assert!(stored.memory_total > 2 * auto.memory_total && stored.products >= 30, "{stored:?}");
    let cholesky = of("cholesky", &nodal, None);
    assert_eq!((stored.memory, stored.assembly), (cholesky.memory, cholesky.time.assembly));
    let text = auto.to_string();
    let after = format!("takes more than {} products", stored.products);
    // Lines are broken anywhere.
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    for part in ["with a stored tangent", "where one takes over", &after] {
        assert!(words.contains(part), "{part} is not in\n{text}");
    }
    assert!(text.lines().all(|line| line.len() < 80 && line == line.trim_end()), "{text}");
    assert_eq!(cholesky.stored, None);
    assert_eq!(of("matrix-free", &nodal, None).stored, None);
    assert_eq!(of("auto", &[], None).stored, None);
    assert_eq!(of("auto", &nodal, Some(5_000_000)).stored, None);
}

/// Terms of a sum have patterns of their own, and all but the largest need an array for their blocks.
#[test]
fn terms_of_a_sum_need_memory() {
    let scene_of = |linear: &str| scene(&format!("[solver]\nlinear = \"{linear}\""));
    let bonds = counted(&lattice([10, 10, 10], 3), 0.3, Needed::default()).bonds;
    let bytes = |of_interactions: usize, families: &[Families], linear: &str| {
        let (body, sum) = (lattice([10, 10, 10], 3), (of_interactions, families));
        let plan = plan_of_sum(body, &scene_of(linear), sum, None);
        plan.memory.iter().find(|item| item.item == "terms of the sum").map(|item| item.bytes)
    };
    let of_bonds = bonds + 1000;
    assert_eq!(bytes(1, &[], "cg"), None);
    assert_eq!(bytes(0, &[Families::Nodal], "cg"), None);
    assert_eq!(bytes(3, &[], "cg"), Some((72 + 2 * 4) * of_bonds));
    assert_eq!(bytes(1, &[Families::Nodal], "cg"), Some((72 + 4) * of_bonds));
    // Springs add up, of interactions alone no matrix does.
    assert_eq!(bytes(1, &[Families::Nodal], "matrix-free"), Some((72 + 4) * of_bonds));
    assert_eq!(bytes(2, &[], "matrix-free"), Some(4 * of_bonds));
    let body = lattice([10, 10, 10], 3);
    let interactions = counted(&body, 0.3, Needed::default());
    let wide = blocks(&Extent::of(&body), 3.0, &interactions, 3) as u64;
    let three = [Families::BondQuadrature, Families::BondQuadrature];
    let bytes = bytes(1, &three, "cg").unwrap();
    assert!(bytes.abs_diff((72 + 4) * wide + 4 * of_bonds) < 80, "{bytes} {wide}");
}

/// Boxes that are not filled, and bodies that are not searched, have what they are counted to have.
#[test]
fn boxes_and_samples_come_close_to_the_count() {
    use crate::scene::Nodes;
    for (counts, horizon) in [([40, 30, 1], 0.3), ([16, 14, 12], 0.2)] {
        let d = if counts[2] == 1 { 2 } else { 3 };
        let body = lattice(counts, d);
        let exact = counted(&body, horizon, ALL);
        let shape = LatticeShape {
            low: vec![0.0; d],
            high: counts[..d].iter().map(|n| *n as f64 * 0.1).collect(),
            spacing: 0.1,
            nodes: Nodes::Cells,
        };
        let boxed = count_in_box(&shape, horizon, ALL);
        assert_eq!((boxed.bonds, boxed.bonds_exact, boxed.exact), (exact.bonds, true, false));
        let family = 2.0 * exact.bonds as f64 / body.n_points() as f64;
        let sampled = estimate_interactions(&body, horizon, family, ALL).unwrap();
        for found in [boxed, sampled] {
            let pairs = [
                (found.bonds, exact.bonds),
                (found.triangles, exact.triangles),
                (found.tetrahedra, exact.tetrahedra),
            ];
            for (found, exact) in pairs {
                assert!(
                    (found as f64 - exact as f64).abs() <= 0.15 * exact as f64,
                    "{found} {exact}"
                );
            }
        }
    }
    // Beyond so many differences a ball counts: 1 % at a horizon of 160 spacings.
    let counts = [1e4, 1e4, 1e4];
    let ball = 2.0 / 3.0 * std::f64::consts::PI * 160.0 * 160.0 * 160.0 * 1e12;
    assert!((bonds_in_box(&counts, 160.0) / ball - 1.0).abs() < 0.01);
}

/// An event takes as long as the Newton iterations that lead to it, and how many there are is not known.
#[test]
fn events_have_a_cost_and_no_number() {
    let events =
        "[steps]\ncontrol = \"event\"\nevents = 700\nincrements = 2\n[solver]\nlinear = \"cg\"";
    let plan = plan(&scene(events), None);
    let found = plan.events.unwrap();
    let iteration = plan.time.assembly + plan.time.linear;
    assert_eq!((found.most, found.each), (700, 5.0 * iteration));
    assert_eq!(found.total, plan.time.setup + 2.0 * plan.time.increment + 700.0 * found.each);
    let text = plan.to_string();
    assert!(text.contains("run of 700 events") && text.contains("the number of events"), "{text}");
    let mut slower = plan;
    let first = FirstIncrement { iterations: 4, linear: 8.0, solved: 1.0, ..Default::default() };
    slower.rehearsed(first);
    assert_eq!(slower.events.unwrap().each, 10.0);
}

#[test]
fn processes_share_a_body() {
    // Along x a hundred layers of a hundred points; forces reach four spacings.
    let body = lattice([100, 10, 10], 3);
    let (extent, steps) = (Extent::of(&body), scene(""));
    let moved = scene("density = 1\n[motion]\nend = 1\nstep = 0.1\n");
    for scene in [steps, moved] {
        let plan = plan_of(body.clone(), &scene, None);
        let of = |ranks: usize| RanksPlan::new(&plan, &extent, (0.2, 0.4, 1), false, ranks);
        let alone = of(1);
        assert_eq!((alone.own, alone.halo, alone.messages, alone.received), (10_000, 0, 0, 0));
        let two = of(2);
        assert_eq!((two.own, two.halo, two.messages), (5_000, 450, 1));
        let ten = of(10);
        assert_eq!((ten.own, ten.halo, ten.messages, ten.received), (1_000, 900, 2, 24 * 900));
        assert_eq!(ten.room, 11);
        // A slab of two layers and a half needs points of two others on each side.
        assert_eq!(of(40).messages, 4);
        let bytes = [&alone, &two, &ten].map(|plan| plan.memory_total);
        assert!(
            bytes[0] > bytes[2] && bytes[1] > bytes[2] && 10 * bytes[2] > bytes[0],
            "{bytes:?}"
        );
    }
}
