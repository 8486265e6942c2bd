//! Energies of bonds that depend on their direction, against sums over all pairs of points written by hand.

use std::path::{Path, PathBuf};

use piola_runtime::case::Case;
use piola_runtime::energy::Energy;

use crate::common::distance;
use crate::fields::{displacement, read};

/// A lattice, or the same points as a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Points {
    Lattice,
    Cloud,
}

/// The two laws by hand: psi' over `C*(..)` and the energy, of `e = l/L - 1`.
type Law = fn(f64) -> [f64; 2];

const SQUARE: (&str, Law) = ("L*(l/L - 1)^2", |e| [e * e, 2.0 * e]);
const LOGARITHM: (&str, Law) = ("L*ln(l/L)^2", |e| {
    let ln = libm::log1p(e);
    [ln * ln, 2.0 * ln / (1.0 + e)]
});
const SPACING: f64 = 0.125;
const RATIO: f64 = 2.1;

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("directions_{name}"));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn case(name: &str, points: Points, d: usize, potential: &str) -> Case {
    let folder = folder(name);
    let sides = [1.5, 1.25, 1.0];
    let body = match points {
        Points::Lattice => {
            format!("box = [{:?}, {:?}]\nspacing = {SPACING}", vec![0.0; d], &sides[..d])
        }
        Points::Cloud => {
            let mut csv = format!("{},volume\n", ["x", "y", "z"][..d].join(","));
            let counts: Vec<usize> = sides[..d].iter().map(|x| (x / SPACING) as usize).collect();
            for number in 0..counts.iter().product() {
                let (mut rest, mut row) = (number, Vec::new());
                for (axis, count) in counts.iter().enumerate() {
                    let wave = libm::sin((number + 7 * axis) as f64);
                    row.push(((rest % count) as f64 + 0.1 * wave) * SPACING);
                    rest /= count;
                }
                let volume = libm::pow(SPACING, d as f64) * (1.0 + 0.1 * libm::cos(number as f64));
                row.push(volume);
                let row: Vec<String> = row.iter().map(f64::to_string).collect();
                csv += &(row.join(",") + "\n");
            }
            std::fs::write(folder.join("points.csv"), csv).unwrap();
            format!("dimension = {d}\npoints = \"points.csv\"")
        }
    };
    let text = format!(
        "[body]\n{body}\n[horizon]\nradius = {}\nweights = \"volumes\"\n[material]\n\
         potential = \"law.piola\"\n",
        RATIO * SPACING
    );
    read(&folder, &text, potential)
}

/// `0.3 + (n*e)^4` of the direction of a bond, with `n` along (3, 4, 0)/5.
fn factor(direction: &[f64]) -> f64 {
    let cosine = 0.6 * direction[0] + 0.8 * direction[1];
    0.3 + cosine * cosine * cosine * cosine
}

fn potential(d: usize, law: &str) -> String {
    let n = ["0.6, 0.8", "0.6, 0.8, 0"][d - 2];
    format!("potential p\ndimensions {d}\nn = vector({n})\npsi(l) = (0.3 + (n*Xi/L)^4)*{law}")
}

/// Energy and forces over all pairs.
fn by_hand(case: &Case, u: &[f64], law: Law) -> (f64, Vec<f64>) {
    let (body, d) = (&case.body, case.body.dimension());
    let (mut energy, mut forces) = (0.0, vec![0.0; u.len()]);
    for i in 0..body.n_points() {
        for j in 0..i {
            let (p, q) = (body.position(i), body.position(j));
            let xi: Vec<f64> = p.iter().zip(q).map(|(p, q)| p - q).collect();
            let eta: Vec<f64> = (0..d).map(|c| u[i * d + c] - u[j * d + c]).collect();
            let norm = |x: &[f64]| x.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
            let rest = norm(&xi);
            if rest > RATIO * SPACING * (1.0 + 1e-9) {
                continue;
            }
            let now: Vec<f64> = xi.iter().zip(&eta).map(|(x, h)| x + h).collect();
            let length = norm(&now);
            let grown: f64 = (0..d).map(|c| eta[c] * (2.0 * xi[c] + eta[c])).sum();
            let [psi, slope] = law(grown / (length + rest) / rest);
            let direction: Vec<f64> = xi.iter().map(|x| x / rest).collect();
            let weight = body.volumes()[i] * body.volumes()[j] * factor(&direction);
            energy += weight * rest * psi;
            for c in 0..d {
                let force = weight * slope * now[c] / length;
                forces[i * d + c] += force;
                forces[j * d + c] -= force;
            }
        }
    }
    (energy, forces)
}

#[test]
fn bodies_are_sums_over_all_bonds() {
    for d in [2, 3] {
        for points in [Points::Lattice, Points::Cloud] {
            for (name, (text, law)) in [("square", SQUARE), ("logarithm", LOGARITHM)] {
                let case = case(&format!("{name}_{d}_{points:?}"), points, d, &potential(d, text));
                let energy = case.energy(case.compile().unwrap()).unwrap();
                let way = match (name, points) {
                    ("square", Points::Lattice) => "rows",
                    ("square", Points::Cloud) => "fours",
                    _ => "batches",
                };
                assert_eq!(energy.report().ways, [way], "{name} {d} {points:?}");
                for size in [1e-9, 0.02] {
                    let u = displacement(&case, size);
                    let mut forces = vec![0.0; u.len()];
                    let total = energy.forces(&u, &mut forces).unwrap().total();
                    let (expected, expected_forces) = by_hand(&case, &u, law);
                    let off = [total / expected - 1.0, distance(&forces, &expected_forces)];
                    println!("{name} {d} {points:?} {size}: {off:?}");
                    assert!(off.iter().all(|x| x.abs() < 1e-12), "{name} {d} {points:?} {off:?}");
                }
            }
        }
    }
}

/// Axes exchanged with the fibre: the same energy.
#[test]
fn a_body_turned_with_its_fibre_has_the_same_energy() {
    let text = |n: &str| {
        format!("potential p\ndimensions 2\nn = vector({n})\npsi(l) = abs(n*Xi)^3/L^2*(l/L - 1)^2")
    };
    let energy = |n: &str, u: fn(f64, f64) -> [f64; 2]| {
        let scene = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 3\n\
                     [material]\npotential = \"law.piola\"\n";
        let case = read(&folder(&n.replace([',', ' ', '.'], "_")), scene, &text(n));
        let energy = case.energy(case.compile().unwrap()).unwrap();
        let positions = case.body.positions().as_chunks::<2>().0;
        let u: Vec<f64> = positions.iter().flat_map(|[x, y]| u(*x, *y)).collect();
        energy.forces(&u, &mut vec![0.0; u.len()]).unwrap().total()
    };
    let one = energy("0.6, 0.8", |x, y| [0.1 * x * y, 0.05 * y]);
    let turned = energy("0.8, 0.6", |x, y| [0.05 * x, 0.1 * x * y]);
    let other = energy("0.8, -0.6", |x, y| [0.1 * x * y, 0.05 * y]);
    assert!((one / turned - 1.0).abs() < 1e-12, "{one} {turned}");
    assert!((one / other - 1.0).abs() > 0.1, "{one} {other}");
}
