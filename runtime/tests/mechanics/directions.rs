//! Energies of bonds that depend on their direction, against sums over all pairs of points written by hand.

use std::path::{Path, PathBuf};

use piola_runtime::case::Case;
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::matrix::BlockMatrix;

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

/// A cloud and a lattice with an energy of this text.
fn bodies(name: &str, d: usize, energy: &str) -> [Case; 2] {
    let text = format!("potential p\ndimensions {d}\n{energy}");
    [Points::Lattice, Points::Cloud]
        .map(|points| case(&format!("{name}_{d}_{points:?}"), points, d, &text))
}

fn forces(energy: &dyn Energy, u: &[f64]) -> (f64, Vec<f64>) {
    let mut forces = vec![0.0; u.len()];
    let total = energy.forces(u, &mut forces).unwrap().total();
    (total, forces)
}

/// Of bonds of a direction at rest forces and moments balance, and a turned body stores what it stored.
#[test]
fn energies_of_directions_are_objective() {
    for d in [2, 3] {
        let text = potential(d, LOGARITHM.0);
        let cases = [Points::Lattice, Points::Cloud]
            .map(|points| case(&format!("objective_{d}_{points:?}"), points, d, &text));
        for case in cases {
            let energy = case.energy(case.compile().unwrap()).unwrap();
            let u = displacement(&case, 0.05);
            let (total, own) = forces(&energy, &u);
            let scale = own.iter().fold(0.0, |sum, g| sum + g.abs());
            let n = case.body.n_points();
            let now = |u: &[f64], i: usize, c: usize| case.body.position(i)[c] + u[i * d + c];
            for c in 0..d {
                let sum = (0..n).fold(0.0, |sum, i| sum + own[i * d + c]);
                assert!(sum.abs() < 1e-14 * scale, "{d} {sum}");
            }
            let moment = (0..n).fold(0.0, |sum, i| {
                sum + now(&u, i, 0) * own[i * d + 1] - now(&u, i, 1) * own[i * d]
            });
            assert!(moment.abs() < 1e-13 * scale, "{d} {moment}");
            let (cos, sin) = (libm::cos(0.7), libm::sin(0.7));
            let turn = |x: [f64; 2]| [cos * x[0] - sin * x[1], sin * x[0] + cos * x[1]];
            let mut turned = u.clone();
            for i in 0..n {
                let there = turn([now(&u, i, 0), now(&u, i, 1)]);
                (0..2).for_each(|c| turned[i * d + c] = there[c] - case.body.position(i)[c]);
            }
            let (there, of_turned) = forces(&energy, &turned);
            assert!((there / total - 1.0).abs() < 1e-12, "{d} {total} {there}");
            let expected: Vec<f64> = (0..n)
                .flat_map(|i| {
                    let [x, y] = turn([own[i * d], own[i * d + 1]]);
                    [x, y].into_iter().chain(own[i * d + 2..(i + 1) * d].iter().copied())
                })
                .collect();
            assert!(distance(&of_turned, &expected) < 1e-12, "{d}");
        }
    }
}

/// What holds `xi` only by its length is the energy of that length.
#[test]
fn energies_of_vectors_by_their_length_are_those_of_lengths() {
    for d in [2, 3] {
        let of_length = bodies("by_length", d, "psi(l) = (1 + Xi(1)^2/L^2)*L*ln(l/L)^2");
        let of_vector =
            bodies("by_vector", d, "psi(xi) = (1 + Xi(1)^2/L^2)*norm(Xi)*ln(norm(xi)/norm(Xi))^2");
        for (one, other) in of_length.iter().zip(&of_vector) {
            let [one_energy, other_energy] =
                [one, other].map(|case| case.energy(case.compile().unwrap()).unwrap());
            for size in [1e-10, 0.05] {
                let u = displacement(one, size);
                let ((a, f), (b, g)) = (forces(&one_energy, &u), forces(&other_energy, &u));
                assert!((a / b - 1.0).abs() < 1e-13, "{d} {size} {a} {b}");
                assert!(distance(&f, &g) < 1e-13, "{d} {size}");
                let products = [&one_energy, &other_energy].map(|energy| {
                    let mut out = vec![0.0; u.len()];
                    energy.hessian(&u).unwrap().multiply(&f, &mut out);
                    out
                });
                assert!(distance(&products[0], &products[1]) < 1e-12, "{d} {size}");
            }
        }
    }
}

/// Springs along bonds and across them, linear in displacements, against sums over all pairs; and digits at a
/// strain of 1e-12.
#[test]
fn linear_springs_of_vectors_are_sums_over_all_bonds() {
    let text = "w = xi - Xi\ns = w*Xi/L\npsi(xi) = (3*s^2 + 0.5*(w*w - s^2))/(2*L)";
    for d in [2, 3] {
        for case in bodies("springs", d, text) {
            let energy = case.energy(case.compile().unwrap()).unwrap();
            for size in [1e-12, 0.05] {
                let u = displacement(&case, size);
                let (total, found) = forces(&energy, &u);
                let (body, mut expected) = (&case.body, vec![0.0; u.len()]);
                for i in 0..body.n_points() {
                    for j in 0..i {
                        let (p, q) = (body.position(i), body.position(j));
                        let xi: Vec<f64> = p.iter().zip(q).map(|(p, q)| p - q).collect();
                        let rest = xi.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
                        if rest > RATIO * SPACING * (1.0 + 1e-9) {
                            continue;
                        }
                        let w: Vec<f64> = (0..d).map(|c| u[i * d + c] - u[j * d + c]).collect();
                        let s: f64 = w.iter().zip(&xi).map(|(w, x)| w * x).sum::<f64>() / rest;
                        let weight = body.volumes()[i] * body.volumes()[j] / rest;
                        for c in 0..d {
                            let force = weight * (2.5 * s * xi[c] / rest + 0.5 * w[c]);
                            expected[i * d + c] += force;
                            expected[j * d + c] -= force;
                        }
                    }
                }
                let work: f64 = expected.iter().zip(&u).map(|(g, u)| 0.5 * g * u).sum();
                let off = [total / work - 1.0, distance(&found, &expected)];
                println!("{d} {size}: {off:?}");
                assert!(off.iter().all(|x| x.abs() < 1e-12), "{d} {size} {off:?}");
            }
        }
    }
}

/// A law that bends, of `xi` in many ways: forces are derivatives of the energy, products of forces, and the
/// stored tangent is the same operator, symmetric.
#[test]
fn derivatives_of_energies_of_vectors() {
    for d in [2, 3] {
        let n = ["0.6, 0.8", "0.48, 0.6, 0.64"][d - 2];
        let text = format!(
            "n = vector({n})\nw = xi - Xi\npsi(l) = L*(l/L - 1)^2\n\
             psi(xi) = (w*n)^2*exp(l/L - 1)/L + sqrt(w*w + L^2)*(l/L - 1)^2 + (xi*n)^2*(w*w)/L^3"
        );
        for case in bodies("bent", d, &text) {
            let energy = case.energy(case.compile().unwrap()).unwrap();
            let u = displacement(&case, 0.03);
            let p: Vec<f64> = (0..u.len()).map(|k| libm::cos(1.3 * k as f64)).collect();
            let step = 1e-6 * SPACING;
            let at = |by: f64| -> (f64, Vec<f64>) {
                let moved: Vec<f64> = u.iter().zip(&p).map(|(u, p)| u + by * p).collect();
                forces(&energy, &moved)
            };
            let ((low, before), (high, after), (_, own)) = (at(-step), at(step), at(0.0));
            let slope: f64 = own.iter().zip(&p).map(|(g, p)| g * p).sum();
            let size: f64 = own.iter().map(|g| g.abs()).sum();
            assert!(((high - low) / (2.0 * step) - slope).abs() < 1e-8 * size, "{d}");
            let mut product = vec![0.0; u.len()];
            energy.hessian(&u).unwrap().multiply(&p, &mut product);
            let differences: Vec<f64> =
                after.iter().zip(&before).map(|(x, y)| (x - y) / (2.0 * step)).collect();
            assert!(distance(&differences, &product) < 1e-7, "{d}");
            let mut stored = BlockMatrix::zeros(energy.pattern());
            let (mut parts, mut out) = (vec![0.0; energy.parts().len()], vec![0.0; u.len()]);
            energy.evaluate(&u, Wanted::Tangent(&mut out, &mut stored), &mut parts).unwrap();
            assert!(distance(&stored.multiply(&p), &product) < 1e-12, "{d}");
            let mut of_forces = vec![0.0; u.len()];
            energy.hessian(&u).unwrap().multiply(&own, &mut of_forces);
            let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
            let (one, other) = (dot(&own, &product), dot(&p, &of_forces));
            assert!((one - other).abs() < 1e-12 * one.abs().max(size), "{d} {one} {other}");
            let sum = |c: usize| own.iter().skip(c).step_by(d).sum::<f64>();
            assert!((0..d).all(|c| sum(c).abs() < 1e-13 * size), "{d}");
        }
    }
}

/// Bonds beside gathered values, along rows and point by point, against sums over all pairs.
#[test]
fn directed_bonds_beside_gathered_values_are_sums_over_all_bonds() {
    for d in [2, 3] {
        let n = ["0.6, 0.8", "0.6, 0.8, 0"][d - 2];
        let text = format!(
            "n = vector({n})\nm = integral(L^2)\ns = integral(L*(l - L))/m\npsi(s) = 0*s^2\n\
             psi(l, m) = (0.3 + (n*Xi/L)^4)*(l - L)^2/L*(m/m)"
        );
        for case in bodies("beside", d, &text) {
            let energy = case.energy(case.compile().unwrap()).unwrap();
            let u = displacement(&case, 0.02);
            let (total, found) = forces(&energy, &u);
            let (expected, expected_forces) = by_hand(&case, &u, SQUARE.1);
            let off = [total / expected - 1.0, distance(&found, &expected_forces)];
            println!("{d}: {off:?} {:?}", energy.report().ways);
            assert!(off.iter().all(|x| x.abs() < 1e-12), "{d} {off:?}");
        }
    }
}
