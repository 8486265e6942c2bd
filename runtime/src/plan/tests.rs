//! Counts against brute force, estimates against measurements.

use super::*;

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

fn near(body: &Body, a: usize, b: usize, reach: f64) -> bool {
    let pairs = body.position(a).iter().zip(body.position(b));
    pairs.map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt() <= reach
}

/// Triangles and tetrahedra of an owner, collinear and coplanar ones included.
fn cliques(body: &Body, reach: f64, upper: &[u32]) -> Cliques {
    let near = |a: u32, b: u32| near(body, a as usize, b as usize, reach);
    let mut found = Cliques::default();
    for (i, &a) in upper.iter().enumerate() {
        for (j, &b) in upper.iter().enumerate().skip(i + 1) {
            if near(a, b) {
                found.triangles += 1;
                let thirds = upper[j + 1..].iter().filter(|&&c| near(a, c) && near(b, c));
                found.tetrahedra += thirds.count() as u64;
            }
        }
    }
    found
}

#[test]
fn bonds_are_those_of_brute_force() {
    let reach = 0.3 * (1.0 + 1e-6);
    for (counts, d) in [([9, 7, 1], 2), ([5, 6, 7], 3)] {
        let body = lattice(counts, d);
        let n = body.n_points();
        let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
        let expected = pairs.filter(|&(a, b)| near(&body, a, b, reach)).count() as u64;
        assert_eq!(count_interactions(&body, 0.3, None).bonds, expected);
    }
}

#[test]
fn a_small_body_is_counted_exactly() {
    let body = lattice([6, 6, 5], 3);
    let reach = 0.2 * (1.0 + 1e-6);
    let counted =
        count_interactions(&body, 0.2, Some(&|_, upper: &[u32]| cliques(&body, reach, upper)));
    let n = body.n_points() as u32;
    let mut expected = Cliques::default();
    for owner in 0..n {
        let upper: Vec<u32> =
            (owner + 1..n).filter(|&b| near(&body, owner as usize, b as usize, reach)).collect();
        let owned = cliques(&body, reach, &upper);
        expected.triangles += owned.triangles;
        expected.tetrahedra += owned.tetrahedra;
    }
    assert!(counted.exact);
    assert_eq!(counted.triangles, expected.triangles);
    assert_eq!(counted.tetrahedra, expected.tetrahedra);
}

#[test]
fn a_sample_of_a_large_body_is_close() {
    let body = lattice([14, 13, 12], 3);
    let reach = 0.2 * (1.0 + 1e-6);
    let count = |_: usize, upper: &[u32]| cliques(&body, reach, upper);
    let estimate = count_interactions(&body, 0.2, Some(&count));
    let n = body.n_points() as u32;
    let mut exact = Cliques::default();
    for owner in 0..n {
        let candidates = (owner + 1..n).take(13 * 12 * 3);
        let upper: Vec<u32> =
            candidates.filter(|&b| near(&body, owner as usize, b as usize, reach)).collect();
        exact.triangles += cliques(&body, reach, &upper).triangles;
        exact.tetrahedra += cliques(&body, reach, &upper).tetrahedra;
    }
    assert!(!estimate.exact);
    let error = |estimate: u64, exact: u64| (estimate as f64 / exact as f64 - 1.0).abs();
    assert!(error(estimate.triangles, exact.triangles) < 0.1, "{estimate:?} {exact:?}");
    assert!(error(estimate.tetrahedra, exact.tetrahedra) < 0.1, "{estimate:?} {exact:?}");
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
        "[body]\nbox = [[0, 0, 0], [1.9, 1.9, 1.9]]\nspacing = 0.1\n\
         [horizon]\nspacings = 3\n[material]\npotential = \"p\"\n{settings}"
    );
    Scene::read(&text, "scene.toml", &[]).unwrap()
}

fn plan(scene: &Scene, available_memory: Option<u64>) -> Plan {
    let body = lattice([20, 20, 20], 3);
    let interactions = count_interactions(&body, scene.horizon_radius(), None);
    Plan::new(PlanInput {
        scene,
        body: &body,
        interactions: InteractionCount { triangles: 6_820_000, exact: false, ..interactions },
        kernels: vec![
            KernelNote { energy: "psi(l)".into(), modelled: true, reason: String::new() },
            KernelNote { energy: "psi(v)".into(), modelled: false, reason: "C3 = 0".into() },
        ],
        prescribed: 1200,
        threads: 1,
        available_memory,
    })
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
    assert_eq!(direct.linear, LinearMethod::Cholesky);
    within(direct.time.linear, 6.2);
    within(direct.time.assembly, 0.30);
    within(direct.memory_total as f64, 922e6);
    let iterative = plan(&scene("[solver]\nlinear = \"cg\""), None);
    within(iterative.time.linear, 0.39);
    assert!(iterative.memory_total < direct.memory_total / 4);
    let lu = plan(&scene("[solver]\nlinear = \"lu\""), None);
    within(lu.time.linear, 26.0);
    within(lu.memory_total as f64, 3.56e9);
}

#[test]
fn what_exceeds_the_machine_is_refused() {
    let direct = scene("[solver]\nlinear = \"cholesky\"");
    assert_eq!(plan(&direct, None).refusal(), None);
    let refusal = plan(&direct, Some(100_000_000)).refusal().unwrap();
    assert!(refusal.contains("factor") && refusal.contains("100 MB"), "{refusal}");
}

#[test]
fn auto_avoids_a_factor_that_does_not_fit() {
    let auto = scene("");
    assert_eq!(plan(&auto, None).linear, LinearMethod::Cholesky);
    let small = plan(&auto, Some(500_000_000));
    assert_eq!(small.linear, LinearMethod::Cg);
    assert_eq!(small.refusal(), None);
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
    for part in ["408 364", "triangles (estimated)", "C3 = 0", "dropped", "available", "8.0 GB"] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    assert!(text.lines().all(|line| line.len() < 80 && line == line.trim_end()), "{text}");
    let json = serde_json::to_value(&plan).unwrap();
    assert_eq!(json["interactions"]["bonds"], 408_364);
    assert_eq!(json["linear"], "cholesky");
    assert_eq!(json["kernels"][1]["reason"], "C3 = 0");
}

#[test]
fn this_machine_has_memory() {
    assert!(available_memory().unwrap() > 1_000_000);
}
