//! The fracture energy of lattices, against counts of what crosses a plane, and thresholds that are found for
//! it.

use crate::support::{Outcome, SceneFolder, number, piola};

type Point = [i32; 3];

/// Energies of every kind of interaction with conditions of their own.
fn law(d: usize, more: &str) -> String {
    let volumes = "psi(v) = 1/2*C3*V*(v/V - 1)^2\n";
    format!(
        "potential torn\nparameter C1 = 3\nparameter C2 = 20\nparameter C3 = 7\nparameter s0 = 0.04\n\
         parameter g0 = 1\npsi(l) = 1/2*C1*L*(l/L - 1)^2\npsi(a) = 1/2*C2*A*(a/A - 1)^2\n{}\
         break when l/L - 1 > s0\n{more}",
        if d == 3 { volumes } else { "" }
    )
}

fn scene(d: usize, ratio: f64, material: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [{:?}, {:?}]\nspacing = 0.5\n[horizon]\nspacings = {ratio}\nweights = \"unit\"\n\
         [material]\n{material}\n",
        vec![0; d],
        vec![2; d]
    ))
}

fn moduli(folder: &SceneFolder) -> serde_json::Value {
    piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json()
}

fn planes(found: &serde_json::Value) -> Vec<f64> {
    let planes = found["fracture"]["planes"].as_array().unwrap_or_else(|| panic!("{found:#}"));
    planes.iter().map(|plane| number(&plane[1])).collect()
}

fn at(point: &[f64; 3], other: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| other[k] - point[k])
}

/// The length, the area or the volume; signed where it may change its sign.
fn measure(d: usize, corners: &[[f64; 3]]) -> f64 {
    let edges: Vec<[f64; 3]> = corners[1..].iter().map(|corner| at(&corners[0], corner)).collect();
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    match edges[..] {
        [p] => dot(p, p).sqrt(),
        [p, q] if d == 2 => p[0] * q[1] - p[1] * q[0],
        [p, q] => (dot(p, p) * dot(q, q) - dot(p, q) * dot(p, q)).sqrt(),
        [p, q, r] => {
            p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
                + p[2] * (q[0] * r[1] - q[1] * r[0])
        }
        _ => unreachable!(),
    }
}

/// What an interaction with corners on both sides of a plane holds when it breaks: the corners above are moved
/// in small steps until an edge, or its own measure, is beyond its threshold.
fn held(d: usize, corners: &[[f64; 3]], normal: [f64; 3], height: f64, limits: [f64; 2]) -> f64 {
    let is_above = |corner: &[f64; 3]| (0..3).map(|k| corner[k] * normal[k]).sum::<f64>() > height;
    let moved = |opening: f64| -> Vec<[f64; 3]> {
        let by = |corner: &[f64; 3]| if is_above(corner) { opening } else { 0.0 };
        corners.iter().map(|one| std::array::from_fn(|k| one[k] + by(one) * normal[k])).collect()
    };
    let growth = |opening: f64, of: &[usize]| {
        let pick = |all: &[[f64; 3]]| of.iter().map(|k| all[*k]).collect::<Vec<_>>();
        measure(d, &pick(&moved(opening))) / measure(d, &pick(corners)) - 1.0
    };
    let n = corners.len();
    let all: Vec<usize> = (0..n).collect();
    let is_broken = |opening: f64| {
        let mut pairs = (0..n).flat_map(|p| (p + 1..n).map(move |q| [p, q]));
        pairs.any(|pair| growth(opening, &pair) > limits[0])
            || n > 2 && growth(opening, &all).abs() > limits[1]
    };
    let mut high = 0.0;
    while !is_broken(high) {
        high += 1e-3;
    }
    let mut low = (high - 1e-3_f64).max(0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if is_broken(middle) { high = middle } else { low = middle }
    }
    let strain = growth(high, &all);
    [3.0, 20.0, 7.0][n - 2] / 2.0 * measure(d, corners).abs() * strain * strain
}

/// All interactions of a block that cross a plane between two layers, each with all that lie beside it in the
/// plane as one: the first of its corners is on one line.
fn count(d: usize, square: i32, normal: Point, limits: [f64; 2]) -> f64 {
    let h = 0.5;
    let reach = 1 + f64::from(square).sqrt() as i32;
    let block = || (-3 * reach..=3 * reach).map(|x| [x, 0, 0]);
    let around: Vec<Point> = (-reach..=reach)
        .flat_map(|x| (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |z| [x, y, z])))
        .filter(|p| d == 3 || p[2] == 0)
        .collect();
    let near = |p: &Point, q: &Point| (0..3).map(|k| (p[k] - q[k]).pow(2)).sum::<i32>() <= square;
    let mut cliques: Vec<Vec<Point>> = Vec::new();
    for first in block() {
        let mut level = vec![vec![first]];
        for _ in 0..d {
            let mut longer: Vec<Vec<Point>> = Vec::new();
            for clique in &level {
                let last = clique[clique.len() - 1];
                let next = around.iter().map(|p| [0, 1, 2].map(|k| first[k] + p[k]));
                for next in next.filter(|next| *next > last && clique.iter().all(|p| near(p, next)))
                {
                    longer.push([&clique[..], &[next]].concat());
                }
            }
            cliques.extend(longer.iter().cloned());
            level = longer;
        }
    }
    let size = f64::from(normal.iter().map(|n| n * n).sum::<i32>()).sqrt();
    let unit = normal.map(|n| f64::from(n) / size);
    let mut sum = 0.0;
    for clique in cliques {
        let corners: Vec<[f64; 3]> =
            clique.iter().map(|corner| corner.map(|x| h * f64::from(x))).collect();
        let height = |p: &Point| (0..3).map(|k| p[k] * normal[k]).sum::<i32>();
        let above = clique.iter().filter(|p| height(p) > 0).count();
        if above == 0 || above == clique.len() || measure(d, &corners).abs() < 1e-9 {
            continue;
        }
        sum += held(d, &corners, unit, 0.5 * h / size, limits);
    }
    let area = (1..d).fold(1.0, |area, _| area * h) * size;
    sum / area
}

/// Triangles and tetrahedra, broken with the first of their edges, and by conditions of their own.
#[test]
fn the_fracture_energy_of_cliques_is_that_of_a_count() {
    let cases = [(2, 2.0, 4), (2, 3.0, 9), (3, 1.0, 1), (3, 1.5, 2)];
    for (d, ratio, square) in cases {
        for own in [f64::INFINITY, 0.03] {
            let mut more = String::new();
            if own.is_finite() {
                more.push_str("break when abs(a/A - 1) > g0\n");
                more.push_str(if d == 3 { "break when abs(v/V - 1) > g0\n" } else { "" });
            }
            let g0 = if own.is_finite() { own } else { 1.0 };
            let material = format!("potential = \"torn.piola\"\nparameters = {{ g0 = {g0} }}");
            let folder = scene(d, ratio, &material);
            folder.file("torn.piola", law(d, &more));
            let found = planes(&moduli(&folder));
            let normals = [[1, 0, 0], [1, 1, 0], [1, 1, 1]];
            assert_eq!(found.len(), d);
            for (found, normal) in found.iter().zip(normals) {
                let expected = count(d, square, normal, [0.04, own]);
                let error = (found / expected - 1.0).abs();
                assert!(error < 1e-11, "{d} {ratio} {normal:?}: {found:e} {expected:e} {error:e}");
            }
        }
    }
}

/// An energy of several measures that is one of the area alone.
#[test]
fn energies_of_several_measures_hold_what_those_of_one_do() {
    let of = |energy: &str| {
        let folder = scene(2, 2.0, "potential = \"torn.piola\"");
        folder.file("torn.piola", law(2, "").replace("psi(a) = 1/2*C2*A*(a/A - 1)^2", energy));
        moduli(&folder)
    };
    let plain = planes(&of("psi(a) = 1/2*C2*A*(a/A - 1)^2"));
    let coupled = planes(&of("psi(a, l1, l2, l3) = 1/2*C2*A*(a/A - 1)^2 + 0*l1*l2*l3"));
    for (plain, coupled) in plain.iter().zip(coupled) {
        assert!((coupled / plain - 1.0).abs() < 1e-11, "{coupled:e} {plain:e}");
    }
}

/// Where nothing can be told it is said why.
#[test]
fn bodies_without_a_fracture_energy_say_why() {
    let folder = scene(2, 2.0, "potential = \"torn.piola\"");
    let without = law(2, "").replace("break when l/L - 1 > s0", "break when abs(a/A - 1) > g0");
    folder.file("torn.piola", &without);
    let json = moduli(&folder);
    assert!(json["fracture"].is_null());
    assert!(
        json["no_fracture"].as_str().unwrap().contains("some bonds across a plane never break")
    );
    let text = piola(&["moduli", &folder.scene()]).expect(0).stdout;
    assert!(text.contains("Gc") && text.contains("none"), "{text}");
    let gathered = "potential torn\nparameter s0 = 0.1\nm = integral(L^2)\npsi(l, m) = (l - L)^2/m\n\
                    break when l/L - 1 > s0\n";
    folder.file("torn.piola", gathered);
    assert!(moduli(&folder)["no_fracture"].as_str().unwrap().contains("families"));
}

fn calibrate(folder: &SceneFolder, target: &str, vary: &str, more: &[&str]) -> Outcome {
    let scene = folder.scene();
    piola(&[&["calibrate", &scene, "--target", target, "--vary", vary], more].concat())
}

fn brittle(d: usize, ratio: f64) -> SceneFolder {
    let folder = scene(d, ratio, "potential = \"torn.piola\"");
    folder.file("torn.piola", law(d, ""));
    folder
}

/// What `calibrate` prints is what `moduli` reads off the lattice.
#[test]
fn calibrated_bodies_have_the_fracture_energy() {
    for (target, number_of_plane) in [("Gc", 0), ("Gc[110]", 1), ("Gc[111]", 2)] {
        let folder = brittle(3, 1.5);
        let targets = format!("E=2e3,{target}=0.5 kJ/m^2");
        let found = calibrate(&folder, &targets, "C2,s0", &["--format", "json"]).expect(0).json();
        let [c2, s0] = ["C2", "s0"].map(|name| number(&found["parameters"][name]));
        let material =
            format!("potential = \"torn.piola\"\nparameters = {{ C2 = {c2}, s0 = {s0} }}");
        let again = scene(3, 1.5, &material);
        again.file("torn.piola", law(3, ""));
        let json = moduli(&again);
        assert!((number(&json["E"]) / 2e3 - 1.0).abs() < 1e-9, "{json:#}");
        let reached = planes(&json)[number_of_plane];
        assert!((reached / 500.0 - 1.0).abs() < 1e-9, "{reached}");
    }
    // The same to paste.
    let text = calibrate(&brittle(2, 3.0), "Gc[11]=2.5", "s0", &[]).expect(0).stdout;
    assert!(text.contains("# The fracture energy follows from s0"), "{text}");
    assert!(text.contains("asked for 2.5") && text.contains("\ns0 = "), "{text}");
}

/// On fine lattices the parameter is that of the continuum ball.
#[test]
fn the_threshold_comes_to_that_of_the_continuum() {
    let error = |ratio: f64| {
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [[0, 0, 0], [2, 2, 2]]\nspacing = 0.5\n[horizon]\nspacings = {ratio}\n\
             [material]\npotential = \"prototype_microelastic_brittle\"\n\
             parameters = {{ K = 7e9, Gc = 50 }}\n"
        ));
        let json = calibrate(&folder, "Gc=2700", "Gc", &["--format", "json"]).expect(0).json();
        let parameter = number(&json["parameters"]["Gc"]);
        println!("{ratio} spacings: {parameter}");
        (parameter / 2700.0 - 1.0).abs()
    };
    let [coarse, fine] = [3.015, 25.015].map(error);
    assert!(fine < 0.012 && fine < 0.2 * coarse, "{coarse} {fine}");
}

/// Where it takes the work of forces along the way.
#[test]
fn thresholds_of_bonds_that_soften_are_found() {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0, 0], [2, 2, 2]]\nspacing = 0.5\n[horizon]\nspacings = 2\n[material]\n\
         potential = \"bilinear_softening\"\nparameters = { K = 7, Gc = 0.03, s0 = 0.02 }\n",
    );
    let json = calibrate(&folder, "K=9,Gc=0.05", "K,Gc", &["--format", "json"]).expect(0).json();
    let [k, gc] = ["K", "Gc"].map(|name| number(&json["parameters"][name]));
    let again = SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [2, 2, 2]]\nspacing = 0.5\n[horizon]\nspacings = 2\n[material]\n\
         potential = \"bilinear_softening\"\nparameters = {{ K = {k}, Gc = {gc}, s0 = 0.02 }}\n",
    ));
    let found = moduli(&again);
    assert!((number(&found["K"]) / 9.0 - 1.0).abs() < 1e-9);
    assert!((planes(&found)[0] / 0.05 - 1.0).abs() < 1e-9, "{found:#}");
}

#[test]
fn fracture_energies_that_cannot_be_met_say_what_stands_in_the_way() {
    let folder = brittle(2, 2.0);
    for (target, vary, parts) in [
        ("Gc=1", "s0,C1", &["2 parameters are varied for 1 targets"][..]),
        ("Gc=-1", "s0", &["no fracture energy", "positive number, in J/m^2"]),
        ("Gc=1,Gc[11]=2", "s0", &["`Gc` is a target, too"]),
        ("Gc[111]=1", "s0", &["no plane of this lattice", "Gc[10], Gc[11]"]),
        ("Gc=1 Pa", "s0", &["`1 Pa` is not a number in J/m^2"]),
        ("Gc=1", "C3", &["does not depend on `C3`"]),
        ("E=1,Gc=1", "C1,C2", &["every one of C1, C2 changes the moduli"]),
        ("E=1,Gc=1", "g0,s0", &["the moduli depend neither on `g0` nor on `s0`"]),
    ] {
        calibrate(&folder, target, vary, &[]).expect(2).says(parts);
    }
    let bounded = law(2, "").replace("s0 = 0.04", "s0 = 0.04, s0 > 0.01, s0 < 0.1");
    folder.file("torn.piola", &bounded);
    calibrate(&folder, "Gc=1e3", "s0", &[]).expect(1).says(&[
        "Gc = 1.000000e3 J/m^2 cannot be reached by varying s0: closest is Gc =",
        "Gc reaches from about",
        "breaks `s0 < 0.1`",
        "not varied: C1",
    ]);
    let elastic = scene(2, 2.0, "potential = \"javili2020\"");
    calibrate(&elastic, "Gc=1", "C1", &[]).expect(2).says(&["no fracture energy", "break when"]);
}
