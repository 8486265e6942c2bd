//! Where the points of a lattice sit, and what of the body each has: sums over points are sums over
//! the body.

use crate::support::{SceneFolder, number, to_csv};

/// How many points an axis of so many cells has, and where the first is, in cells.
const NODES: [(&str, usize, f64); 3] =
    [("cells", 0, 0.5), ("corners", 1, 0.0), ("corners-full", 1, 0.0)];

/// A box of `cells` cells of edge `H`, by its points: indices along the axes, last axis fastest.
fn points(cells: &[usize], more: usize) -> Vec<Vec<usize>> {
    cells.iter().fold(vec![Vec::new()], |rows: Vec<Vec<usize>>, count| {
        let along = |row: Vec<usize>| (0..count + more).map(move |i| [&row[..], &[i]].concat());
        rows.into_iter().flat_map(along).collect()
    })
}

const H: f64 = 0.25;

/// The scene of a box of `cells` cells, and the uniform stretch `u = e X`.
fn stretched(cells: &[usize], nodes: usize, e: f64, rest: &str) -> (SceneFolder, String) {
    let (name, more, offset) = NODES[nodes];
    let upper: Vec<f64> = cells.iter().map(|n| *n as f64 * H).collect();
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [{:?}, {upper:?}]\nspacing = {H}\nnodes = \"{name}\"\n{rest}",
        vec![0.0; cells.len()]
    ));
    let u: Vec<f64> =
        points(cells, more).concat().iter().map(|i| e * H * (*i as f64 + offset)).collect();
    let header = ["u", "v", "w"][..cells.len()].join(",");
    (folder, to_csv(&header, &u))
}

/// A homogeneous deformation of an energy density has its value times the volume of the box, however
/// coarse the lattice; corners with whole cells weigh (n + 1)/n of it along each axis.
#[test]
fn an_energy_density_is_summed_over_the_box() {
    // Sums of a few hundred terms.
    const TOLERANCE: f64 = 1e-13;
    for cells in [vec![4, 6], vec![4, 5, 3]] {
        for (nodes, (name, ..)) in NODES.iter().enumerate() {
            for discretisation in ["nodal", "bond-quadrature"] {
                let (folder, u) = stretched(
                    &cells,
                    nodes,
                    0.1,
                    &format!(
                        "[horizon]\nspacings = 2\n[material]\n\
                         potential = \"st_venant_kirchhoff\"\n\
                         parameters = {{ lambda = 2.0, mu = 1.0 }}\n\
                         [correspondence]\ndiscretisation = \"{discretisation}\"\n"
                    ),
                );
                let d = cells.len() as f64;
                let strain = 0.5 * (1.1 * 1.1 - 1.0);
                let density = d * d * strain * strain + d * strain * strain;
                let of_box: f64 = cells.iter().map(|n| *n as f64 * H).product();
                let excess: f64 = match *name {
                    "corners-full" => cells.iter().map(|n| (*n as f64 + 1.0) / *n as f64).product(),
                    _ => 1.0,
                };
                let found = number(&folder.energy(&u, &[]).json()["energy"]);
                let expected = density * of_box * excess;
                let label = format!("{cells:?} {name} {discretisation}: {found} {expected}");
                assert!((found / expected - 1.0).abs() < TOLERANCE, "{label}");
            }
        }
    }
}

/// Bonds weigh the volumes of both ends, with uniform weights times a factor that is the same for all:
/// the ball of the horizon over what its lattice points have.
#[test]
fn bonds_weigh_what_of_a_cell_their_ends_have() {
    const TOLERANCE: f64 = 1e-13;
    let cells = [5, 3];
    // Two spacings: 12 neighbours.
    let ball = std::f64::consts::PI * 4.0 * H * H / (12.0 * H * H);
    for (weights, factor) in [("uniform", ball), ("volumes", 1.0)] {
        for (nodes, (name, more, _)) in NODES.iter().enumerate() {
            let rest = format!(
                "[horizon]\nspacings = 2\nweights = \"{weights}\"\n\
                 [material]\npotential = \"javili2020\"\nparameters = {{ C1 = 1.0 }}\n"
            );
            let (folder, u) = stretched(&cells, nodes, 0.1, &rest);
            let share = |p: &[usize]| -> f64 {
                let at_end = |(i, n): (&usize, &usize)| *i == 0 || i == n;
                let halved = p.iter().zip(&cells).filter(|pair| at_end(*pair)).count();
                if *name == "corners" { libm::pow(0.5, halved as f64) } else { 1.0 }
            };
            let points = points(&cells, *more);
            let mut expected = 0.0;
            for (a, p) in points.iter().enumerate() {
                for q in &points[a + 1..] {
                    let square: usize = p.iter().zip(q).map(|(i, j)| i.abs_diff(*j).pow(2)).sum();
                    if square <= 4 {
                        let length = H * (square as f64).sqrt();
                        let weight = factor * H * H * H * H * share(p) * share(q);
                        expected += weight * 0.5 * length * 0.01;
                    }
                }
            }
            let found = number(&folder.energy(&u, &[]).json()["energy"]);
            let label = format!("{name} {weights}: {found} {expected}");
            assert!((found / expected - 1.0).abs() < TOLERANCE, "{label}");
        }
    }
}

/// The volumes that a run writes, and what a force is shared by, sum to the body.
#[test]
fn loads_per_volume_pull_with_the_volume_of_the_box() {
    for (nodes, (name, ..)) in NODES.iter().enumerate() {
        let rest = "[horizon]\nspacings = 2\n[material]\npotential = \"javili2020\"\n\
                    parameters = { C1 = 1e3 }\n[sets]\nleft = \"X < 0.2\"\nall = \"X > -1\"\n\
                    [[prescribe]]\nset = \"left\"\nu = [0, 0]\n\
                    [[load]]\nset = \"all\"\ndensity = [0, \"-3*t\"]\n[steps]\nincrements = 1\n";
        let (folder, _) = stretched(&[4, 2], nodes, 0.0, rest);
        folder.run(&[]).expect(0);
        let (names, rows) = crate::support::table(&folder.out().join("reactions.csv"));
        let column = names.iter().position(|name| name == "left_y").unwrap();
        let reaction = rows.last().unwrap()[column];
        let area = if *name == "corners-full" { 1.25 * 0.75 } else { 0.5 };
        assert!((reaction / (3.0 * area) - 1.0).abs() < 1e-9, "{name}: {reaction}");
    }
}
