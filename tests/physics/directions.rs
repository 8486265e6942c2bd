//! Bonds by their direction: moduli and fracture energies against sums over the vectors of the lattice, and a
//! lamina by bonds and by a deformation gradient.

use crate::examples;
use crate::support::{SceneFolder, number, numbers, piola, table};

const SPACING: f64 = 0.5;
const RATIO: f64 = 2.3;

/// As stiff as the fourth power of the cosine says, and as tough as its square.
fn law(d: usize) -> String {
    let n = ["0.6, 0.8", "0.48, 0.6, 0.64"][d - 2];
    format!(
        "potential p\ndimensions {d}\nn = vector({n})\nc = n*Xi/L\n\
         psi(l) = 1/2*(2 + 9*c^4)*L*(l/L - 1)^2\nbreak when l/L - 1 > 0.01*(1 + 3*c^2)\n"
    )
}

/// One of each pair of opposite vectors of the lattice: unit vector, length, square of the cosine.
fn vectors(d: usize) -> Vec<(Vec<f64>, f64, f64)> {
    let n = [&[0.6, 0.8][..], &[0.48, 0.6, 0.64]][d - 2];
    let range = -2_i32..=2;
    let mut found = Vec::new();
    for x in range.clone() {
        for y in range.clone() {
            for z in if d == 3 { range.clone() } else { 0..=0 } {
                let vector = [f64::from(x), f64::from(y), f64::from(z)];
                let size = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
                if [x, y, z] <= [0; 3] || size > RATIO {
                    continue;
                }
                let unit: Vec<f64> = vector[..d].iter().map(|x| x / size).collect();
                let cosine: f64 = unit.iter().zip(n).map(|(e, n)| e * n).sum();
                found.push((unit, SPACING * size, cosine * cosine));
            }
        }
    }
    found
}

fn folder(d: usize) -> SceneFolder {
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [{:?}, {:?}]\nspacing = {SPACING}\n[horizon]\nspacings = {RATIO}\n\
         weights = \"volumes\"\n[material]\npotential = \"law.piola\"\n",
        vec![0.0; d],
        vec![3.0; d]
    ));
    folder.file("law.piola", law(d));
    folder
}

#[test]
fn moduli_and_fracture_energies_are_sums_over_bonds() {
    for d in [2, 3] {
        let folder = folder(d);
        let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        let volume = libm::pow(SPACING, d as f64);
        let pairs =
            [&[[0, 0], [1, 1], [0, 1]][..], &[[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]]];
        let pairs = pairs[d - 2];
        let size = number(&found["C11"]);
        for (row, [a, i]) in pairs.iter().enumerate() {
            let own = numbers(&found["voigt"][row]);
            for (column, [b, j]) in pairs.iter().enumerate() {
                let part = |(n, length, c): &(Vec<f64>, f64, f64)| {
                    volume * (2.0 + 9.0 * c * c) * length * n[*a] * n[*i] * n[*b] * n[*j]
                };
                let expected: f64 = vectors(d).iter().map(part).sum();
                let off = (own[column] - expected).abs() / size;
                assert!(off < 1e-14, "{d} {row} {column}: {} {expected}", own[column]);
            }
        }
        let planes = found["fracture"]["planes"].as_array().unwrap();
        for (ones, plane) in (1..=d).zip(planes) {
            let normal: Vec<f64> =
                (0..d).map(|k| if k < ones { 1.0 / (ones as f64).sqrt() } else { 0.0 }).collect();
            let part = |(n, length, c): &(Vec<f64>, f64, f64)| {
                let strain = 0.01 * (1.0 + 3.0 * c);
                let psi = 0.5 * (2.0 + 9.0 * c * c) * length * strain * strain;
                let way: f64 = n.iter().zip(&normal).map(|(n, m)| n * m).sum();
                volume * psi * length * way.abs()
            };
            let expected: f64 = vectors(d).iter().map(part).sum();
            let off = number(&plane[1]) / expected - 1.0;
            assert!(off.abs() < 1e-12, "{d} {ones}: {plane} {expected}");
        }
    }
}

/// The strip of bonds shears and bends as that with psi(F) does. What differs is the lattice's own direction and
/// faces that lack bonds.
#[test]
fn a_lamina_of_bonds_is_that_of_a_gradient() {
    let scene = "examples/lamina/scene.toml";
    let along = ["moduli", scene, "--set", "material.parameters.phi=0", "--format", "json"];
    let found = piola(&along).expect(0).json();
    let expected = [[40e9, 5e9, 0.0], [5e9, 14e9, 0.0], [0.0, 0.0, 5e9]];
    for (row, expected) in expected.iter().enumerate() {
        let own = numbers(&found["voigt"][row]);
        // The scene has ten digits of what was found for nine digits of E.
        assert!(
            own.iter().zip(expected).all(|(x, y)| (x - y).abs() < 200.0),
            "{own:?} {expected:?}"
        );
    }
    let bonds = examples::run("lamina", &[]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let gradient = "examples/lamina/gradient.toml";
    piola(&["run", gradient, "--out", out.to_str().unwrap()]).expect(0);
    let [bonds, gradient] = [bonds.path(), &out].map(|path| {
        let last = |file: &str| table(&path.join(file)).1.pop().unwrap();
        (last("probes.csv"), last("reactions.csv"))
    });
    println!("{bonds:?}\n{gradient:?}");
    let ratio = |of: fn(&(Vec<f64>, Vec<f64>)) -> f64| of(&bonds) / of(&gradient);
    // Aside by 0.13 mm, a quarter of the way along.
    assert!((ratio(|run| run.0[2]) - 1.0).abs() < 0.03, "{bonds:?} {gradient:?}");
    assert!(bonds.0[2] < -1.2e-4, "{bonds:?}");
    assert!((ratio(|run| run.1[3]) - 1.0).abs() < 0.08, "{bonds:?} {gradient:?}");
}

/// Springs along bonds and across them: the strains that turn nothing cost what the sums say.
#[test]
fn springs_across_bonds_change_poissons_ratio() {
    for d in [2, 3] {
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [{:?}, {:?}]\nspacing = {SPACING}\n[horizon]\nspacings = {RATIO}\n\
             weights = \"volumes\"\n[material]\npotential = \"law.piola\"\n",
            vec![0.0; d],
            vec![3.0; d]
        ));
        folder.file(
            "law.piola",
            "potential p\nallow \"not-objective\" \"linear\"\nw = xi - Xi\ns = w*Xi/L\n\
             psi(xi) = 1/2*(5*s^2 + 2*(w*w - s^2))/L\n",
        );
        let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        let sum = |of: fn(&[f64]) -> f64| -> f64 {
            let part = |(n, length, _): &(Vec<f64>, f64, f64)| {
                libm::pow(SPACING, d as f64) * length * of(n)
            };
            vectors(d).iter().map(part).sum()
        };
        let [fourth, mixed, second] = [
            sum(|n| libm::pow(n[0], 4.0)),
            sum(|n| n[0] * n[0] * n[1] * n[1]),
            sum(|n| n[0] * n[0]),
        ];
        for (name, expected) in [
            ("C11", 3.0 * fourth + 2.0 * second),
            ("C12", 3.0 * mixed),
            ("C44", 3.0 * mixed + 0.5 * 2.0 * second),
        ] {
            let off = number(&found[name]) / expected - 1.0;
            assert!(off.abs() < 1e-14, "{d} {name}: {off:e}");
        }
        assert!(number(&found["stress"][0][0]).abs() == 0.0);
    }
}
