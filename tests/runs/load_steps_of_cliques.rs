//! Load steps of bodies whose triangles and tetrahedra fail by themselves, beside bonds: event by event and round
//! by round against small bodies that are worked out here, clique by clique, with equilibria by elimination
//! and events by bisection.

use std::collections::BTreeSet;
use std::fs;

use crate::load_steps::{NOTCHED, Rows, solved};
use crate::support::{SceneFolder, number};

/// Stiffnesses of bonds, triangles and tetrahedra, and their thresholds, which vary.
const STIFFNESS: [f64; 3] = [3.0, 0.5, 0.2];
const LIMITS: [f64; 3] = [0.02, 0.012, 0.012];

/// By how much thresholds vary over the body.
fn varied(x: &[f64; 3]) -> f64 {
    1.0 + 0.3 * libm::sin(5.0 * x[0] + 3.0 * x[1] + 2.0 * x[2])
}

/// Bonds, triangles or tetrahedra of points one apart, each of volume 1.
struct Clique {
    points: Vec<usize>,
    kind: usize,
    at_rest: f64,
    limit: f64,
}

/// A body between two ends, of which the right one is pulled.
struct Lattice {
    d: usize,
    positions: Vec<[f64; 3]>,
    cliques: Vec<Clique>,
    is_broken: Vec<bool>,
    free: Vec<usize>,
    pulled: Vec<usize>,
}

/// The displacement of the right end at t = 1.
const PULLED: f64 = 0.2;

type Vector = [f64; 3];

fn minus(p: &Vector, q: &Vector) -> Vector {
    std::array::from_fn(|axis| p[axis] - q[axis])
}

fn cross(p: &Vector, q: &Vector) -> Vector {
    let at = |a: usize, b: usize| p[a] * q[b] - p[b] * q[a];
    [at(1, 2), at(2, 0), at(0, 1)]
}

fn dot(p: &Vector, q: &Vector) -> f64 {
    (0..3).map(|axis| p[axis] * q[axis]).sum()
}

fn scaled(p: &Vector, by: f64) -> Vector {
    p.map(|x| x * by)
}

/// Length, area or volume of points relative to the first, and its gradient by these.
fn measured(x: &[Vector]) -> (f64, Vec<Vector>) {
    match x {
        [x] => {
            let length = dot(x, x).sqrt();
            (length, vec![scaled(x, 1.0 / length)])
        }
        [x, y] => {
            let normal = cross(x, y);
            let area = dot(&normal, &normal).sqrt();
            let unit = scaled(&normal, 1.0 / area);
            (area, vec![cross(y, &unit), cross(&unit, x)])
        }
        [x, y, z] => {
            let signed = dot(x, &cross(y, z));
            let gradient = [cross(y, z), cross(z, x), cross(x, y)];
            (signed.abs(), gradient.map(|g| scaled(&g, signed.signum())).to_vec())
        }
        _ => unreachable!("at most four points"),
    }
}

impl Lattice {
    fn new(counts: &[usize], horizon: f64) -> Lattice {
        let d = counts.len();
        let mut positions = vec![[0.0; 3]];
        for (axis, n) in counts.iter().enumerate() {
            let along = |p: &Vector| {
                let mut all = vec![*p; *n];
                all.iter_mut().enumerate().for_each(|(k, q)| q[axis] = k as f64 + 0.5);
                all
            };
            positions = positions.iter().flat_map(along).collect();
        }
        let last = counts[0] as f64 - 0.5;
        let at = |x: f64| -> Vec<usize> {
            let here = |k: &usize| positions[*k][0] == x;
            (0..positions.len()).filter(here).collect()
        };
        let dofs = |points: Vec<usize>| points.into_iter().flat_map(|p| p * d..(p + 1) * d);
        let held: Vec<usize> = dofs(at(0.5)).chain(dofs(at(last))).collect();
        let free = (0..d * positions.len()).filter(|dof| !held.contains(dof)).collect();
        let pulled = at(last).into_iter().map(|point| point * d).collect();
        let mut all =
            Lattice { d, positions, cliques: Vec::new(), is_broken: Vec::new(), free, pulled };
        let mut found: Vec<Vec<usize>> = (0..all.positions.len()).map(|p| vec![p]).collect();
        for kind in 0..d {
            let near = |p: usize, q: usize| {
                let x = minus(&all.positions[p], &all.positions[q]);
                dot(&x, &x).sqrt() < horizon
            };
            let longer = |one: &Vec<usize>| {
                let next = one[one.len() - 1] + 1..all.positions.len();
                let next = next.filter(|q| one.iter().all(|p| near(*p, *q)));
                next.map(|q| [&one[..], &[q]].concat()).collect::<Vec<_>>()
            };
            found = found.iter().flat_map(longer).collect();
            let clique = |points: &Vec<usize>| {
                let (at_rest, _) =
                    measured(&all.edges(points, &vec![0.0; d * all.positions.len()]));
                let varied: f64 = points.iter().map(|p| varied(&all.positions[*p])).sum();
                let limit = LIMITS[kind] * varied / points.len() as f64;
                Clique { points: points.clone(), kind, at_rest, limit }
            };
            let new: Vec<Clique> =
                found.iter().map(clique).filter(|clique| clique.at_rest > 1e-9).collect();
            all.cliques.extend(new);
        }
        all.is_broken = vec![false; all.cliques.len()];
        all
    }

    fn edges(&self, points: &[usize], u: &[f64]) -> Vec<Vector> {
        let place = |point: usize| -> Vector {
            std::array::from_fn(|axis| match axis < self.d {
                true => self.positions[point][axis] + u[point * self.d + axis],
                false => 0.0,
            })
        };
        let first = place(points[0]);
        points[1..].iter().map(|point| minus(&place(*point), &first)).collect()
    }

    /// Whether a clique is there: neither it nor an edge of it is broken.
    fn is_left(&self, number: usize) -> bool {
        let own = &self.cliques[number].points;
        let is_edge = |k: usize| self.cliques[k].points.iter().all(|p| own.contains(p));
        let bonds = (0..self.cliques.len()).take_while(|k| self.cliques[*k].kind == 0);
        let mut broken = bonds.filter(|k| self.is_broken[*k]);
        !self.is_broken[number] && !broken.any(is_edge)
    }

    fn left(&self) -> Vec<usize> {
        (0..self.cliques.len()).filter(|k| self.is_left(*k)).collect()
    }

    /// Stored energy and forces; each set of neighbours of a point counts in every order.
    fn forces(&self, left: &[usize], u: &[f64]) -> (f64, Vec<f64>) {
        let (mut energy, mut forces) = (0.0, vec![0.0; u.len()]);
        for number in left {
            let Clique { points, kind, at_rest, .. } = &self.cliques[*number];
            let weight = [1.0, 2.0, 6.0][*kind] * STIFFNESS[*kind];
            let (now, gradient) = measured(&self.edges(points, u));
            let strain = now / at_rest - 1.0;
            energy += 0.5 * weight * at_rest * strain * strain;
            for (point, by) in points[1..].iter().zip(&gradient) {
                for axis in 0..self.d {
                    forces[point * self.d + axis] += weight * strain * by[axis];
                    forces[points[0] * self.d + axis] -= weight * strain * by[axis];
                }
            }
        }
        (energy, forces)
    }

    /// The equilibrium at `t`, by Newton's method with differences of forces.
    fn rest(&self, t: f64, from: &[f64]) -> Vec<f64> {
        let (left, mut u) = (self.left(), from.to_vec());
        self.pulled.iter().for_each(|dof| u[*dof] = PULLED * t);
        for _ in 0..50 {
            let (_, forces) = self.forces(&left, &u);
            let mut columns = Vec::new();
            for dof in &self.free {
                let step = 1e-6;
                let [above, below] = [step, -step].map(|step| {
                    let mut u = u.clone();
                    u[*dof] += step;
                    self.forces(&left, &u).1
                });
                columns.push((above, below, 2.0 * step));
            }
            let row = |dof: &usize| {
                let slope = |(above, below, way): &(Vec<f64>, Vec<f64>, f64)| {
                    (above[*dof] - below[*dof]) / way
                };
                columns.iter().map(slope).chain([-forces[*dof]]).collect::<Vec<f64>>()
            };
            let step = solved(self.free.iter().map(row).collect()).expect("a body that holds");
            self.free.iter().zip(&step).for_each(|(dof, step)| u[*dof] += step);
            if step.iter().all(|x| x.abs() < 1e-14) {
                return u;
            }
        }
        panic!("no equilibrium at t = {t}");
    }

    /// What is left, with margins over their amounts at rest.
    fn margins(&self, u: &[f64]) -> Vec<(usize, f64)> {
        let margin = |number: usize| {
            let Clique { points, kind, at_rest, limit } = &self.cliques[number];
            let strain = measured(&self.edges(points, u)).0 / at_rest - 1.0;
            let strain = if *kind == 2 { strain.abs() } else { strain };
            (number, strain / limit - 1.0)
        };
        self.left().into_iter().map(margin).collect()
    }

    fn largest(&self, u: &[f64]) -> f64 {
        self.margins(u).iter().map(|one| one.1).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Breaks what is not below a margin; how many there are.
    fn break_from(&mut self, least: f64, u: &[f64]) -> usize {
        let new: Vec<(usize, f64)> =
            self.margins(u).into_iter().filter(|one| one.1 >= least).collect();
        new.iter().for_each(|(number, _)| self.is_broken[*number] = true);
        new.len()
    }

    /// How many bonds, triangles and tetrahedra broke by their own criteria.
    fn counts(&self) -> [usize; 3] {
        [0, 1, 2].map(|kind| {
            let all = self.cliques.iter().zip(&self.is_broken);
            all.filter(|(clique, is_broken)| clique.kind == kind && **is_broken).count()
        })
    }

    /// The next time at which a margin is 0: below the present one where it is above 0, else beyond.
    fn next_event(&self, t: f64, from: &[f64]) -> (f64, Vec<f64>) {
        let is_above = self.largest(from) > 0.0;
        let step = if is_above { -2e-3 } else { 2e-3 };
        let (mut near, mut far) = ((t, from.to_vec()), (t, from.to_vec()));
        while (self.largest(&far.1) > 0.0) == is_above {
            near = far;
            far = (near.0 + step, self.rest(near.0 + step, &near.1));
        }
        for _ in 0..45 {
            let t = 0.5 * (near.0 + far.0);
            let u = self.rest(t, &near.1);
            if (self.largest(&u) > 0.0) == is_above { near = (t, u) } else { far = (t, u) }
        }
        near
    }

    /// The scene of this body, with a potential for it.
    fn scene(&self, counts: &[usize], steps: &str) -> SceneFolder {
        let zeros = vec!["0"; self.d].join(", ");
        let pulled = format!("\"{PULLED}*t\"{}", ", 0".repeat(self.d - 1));
        let last = counts[0] - 1;
        let horizon = if self.d == 2 { 1.5 } else { 1.8 };
        let z = if self.d == 2 { "" } else { " + 2*Z" };
        let names = ["s0", "g0", "h0"];
        let fields: Vec<String> = (0..self.d)
            .map(|k| {
                let (name, limit) = (names[k], LIMITS[k]);
                format!("{name} = \"{limit}*(1 + 0.3*sin(5*X + 3*Y{z}))\"")
            })
            .collect();
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [[{zeros}], {counts:?}]\nspacing = 1\n[horizon]\nspacings = {horizon}\n\
             weights = \"volumes\"\n[material]\npotential = \"cliques.piola\"\n\
             parameters = {{ {} }}\n[sets]\nleft = \"X < 1\"\nright = \"X > {last}\"\n\
             [[prescribe]]\nset = \"left\"\nu = [{zeros}]\n[[prescribe]]\nset = \"right\"\n\
             u = [{pulled}]\n[solver]\ntolerance = 1e-12\n[steps]\n{steps}",
            fields.join(", ")
        ));
        let [c1, c2, c3] = STIFFNESS;
        let mut text = format!(
            "potential cliques\nparameter s0 = 1, s0 > 0\nparameter g0 = 1, g0 > 0\n\
             psi(l) = 1/2*{c1}*L*(l/L - 1)^2\npsi(a) = 1/2*{c2}*A*(a/A - 1)^2\n\
             break when l/L - 1 > s0\nbreak when a/A - 1 > g0\n"
        );
        if self.d == 3 {
            text.push_str(&format!(
                "parameter h0 = 1, h0 > 0\npsi(v) = 1/2*{c3}*V*(v/V - 1)^2\n\
                 break when abs(v/V - 1) > h0\n"
            ));
        }
        folder.file("cliques.piola", &text);
        folder
    }
}

/// How many of each kind broke, row by row.
fn counts(rows: &Rows, d: usize) -> Vec<[usize; 3]> {
    let names = ["broken_bonds", "broken_areas", "broken_volumes"];
    let columns: Vec<Vec<f64>> = names[..d].iter().map(|name| rows.column(name)).collect();
    let row = |k: usize| [0, 1, 2].map(|kind| columns.get(kind).map_or(0, |all| all[k] as usize));
    (0..columns[0].len()).map(row).collect()
}

fn bodies() -> [(Vec<usize>, Lattice); 2] {
    [(vec![5, 3], 1.5), (vec![3, 2, 2], 1.8)].map(|(counts, horizon)| {
        let lattice = Lattice::new(&counts, horizon);
        (counts, lattice)
    })
}

/// Bonds, triangles and tetrahedra break one after the other, at the times that bisection finds.
#[test]
fn all_kinds_break_where_bisection_has_them() {
    for (size, mut of) in bodies() {
        let events = 13;
        let folder =
            of.scene(&size, &format!("control = \"event\"\nevents = {events}\nincrements = 1\n"));
        folder.run(&[]).expect(0);
        let rows = Rows::of(&folder);
        rows.close();
        let found: Vec<(f64, [usize; 3])> =
            rows.column("t").into_iter().zip(counts(&rows, of.d)).collect();
        let (mut t, mut u) = (0.0, vec![0.0; of.d * of.positions.len()]);
        let mut released = 0.0;
        assert_eq!(found.len(), events, "{found:?}");
        for (found_t, found_counts) in &found {
            (t, u) = of.next_event(t, &u);
            let before = of.forces(&of.left(), &u).0;
            assert_eq!(of.break_from(-1e-8, &u), 1);
            released += before - of.forces(&of.left(), &u).0;
            u = of.rest(t, &u);
            assert_eq!(*found_counts, of.counts(), "{found:?}");
            assert!((found_t / t - 1.0).abs() < 1e-7, "{found_t} {t} {found:?}");
        }
        assert!((rows.last("released") / released - 1.0).abs() < 1e-7);
        assert!((rows.last("total") / of.forces(&of.left(), &u).0 - 1.0).abs() < 1e-7);
        println!("{:?}", found);
        let kinds = of.counts().iter().filter(|n| **n > 0).count();
        assert!(kinds > 1, "{found:?}");
        let times: Vec<f64> = found.iter().map(|one| one.0).collect();
        assert!(times.windows(2).any(|pair| pair[1] < pair[0]), "{times:?}");
    }
}

/// Round by round at given loads: all at once, and the foremost alone.
#[test]
fn all_kinds_break_in_the_rounds_that_loops_find() {
    for which in ["all", "largest"] {
        for (size, mut of) in bodies() {
            let folder =
                of.scene(&size, &format!("breaking = \"{which}\"\nincrements = 20\nend = 0.5\n"));
            folder.run(&[]).expect(0);
            let rows = Rows::of(&folder);
            rows.close();
            let steps = folder.summary()["steps"].as_array().unwrap().clone();
            let mut u = vec![0.0; of.d * of.positions.len()];
            let mut all = [0; 3];
            for (step, (t, found)) in
                steps.iter().zip(rows.column("t").iter().zip(counts(&rows, of.d)))
            {
                u = of.rest(*t, &u);
                let mut rounds = 0;
                while of.largest(&u) > 0.0 {
                    let least = if which == "all" { 0.0 } else { of.largest(&u) };
                    of.break_from(least, &u);
                    u = of.rest(*t, &u);
                    rounds += 1;
                }
                assert_eq!(found, of.counts(), "{which} at {t}");
                assert_eq!(number(&step["rounds"]), f64::from(rounds), "{which} at {t}");
                let new = ["bonds_broke", "areas_broke", "volumes_broke"];
                for (kind, name) in new[..of.d].iter().enumerate() {
                    all[kind] += number(&step[*name]) as usize;
                }
                let stored = of.forces(&of.left(), &u).0;
                assert!((number(&step["energy"]) - stored).abs() < 1e-9 * stored.max(1e-3));
            }
            println!("{which}: {all:?}");
            assert_eq!(all, of.counts());
            assert!(all[1] > 0, "{all:?}");
        }
    }
}

/// The plate with two notches, whose triangles fail, too.
const FAILING: &str = "potential brittle\nparameter s0 = 0.01\npsi(l) = 1e13*L*(l/L - 1)^2\n\
                       psi(a) = 3e15*A*(a/A - 1)^2\nbreak when l/L - 1 > s0\n\
                       break when a/A - 1 > 0.009\n";

fn notched(change: impl Fn(&str) -> String) -> SceneFolder {
    let folder =
        SceneFolder::new(&change(&NOTCHED.replace("spacings = 3.015", "spacings = 2.015")));
    folder.file("brittle.piola", FAILING);
    folder
}

/// Events of triangles come in mirror images, and are the same bits for any number of threads.
#[test]
fn triangles_break_with_their_mirror_images() {
    let [one, two] = ["1", "2"].map(|threads| {
        let steps = "[steps]\ncontrol = \"event\"\nevents = 40";
        let folder = notched(|scene| scene.replace("[steps]", steps));
        folder.run(&["--threads", threads]).expect(0);
        let text = fs::read(folder.out().join("energy.csv")).unwrap();
        (folder, text)
    });
    assert_eq!(one.1, two.1);
    let rows = Rows::of(&one.0);
    rows.close();
    let mut sizes = [BTreeSet::new(), BTreeSet::new()];
    for pair in counts(&rows, 2).windows(2) {
        for (kind, sizes) in sizes.iter_mut().enumerate() {
            sizes.insert(pair[1][kind] - pair[0][kind]);
        }
    }
    println!("{sizes:?}");
    let [bonds, areas] = sizes;
    assert!(bonds.len() > 1 && areas.len() > 1, "{bonds:?} {areas:?}");
    assert!(bonds.iter().chain(&areas).all(|n| n % 2 == 0), "{bonds:?} {areas:?}");
}

/// What breaks in an attempt that fails comes back: behind it the body is one that never tried.
#[test]
fn cliques_that_break_in_a_failed_attempt_come_back() {
    let failing = notched(|scene| scene.to_owned() + "[solver]\nmax_iterations = 2\n");
    failing.run(&[]).expect(3).says(&["half the increment is tried", "no equilibrium"]);
    let rows = Rows::of(&failing);
    rows.close();
    let (t, broken) = (rows.column("t")[1], counts(&rows, 2));
    assert!(0.1 < t && t < 0.2, "{t}");
    let straight = |end: f64| {
        let steps = format!("end = {end}\nincrements = 1");
        let folder = notched(|scene| scene.replace("increments = 10", &steps));
        folder.run(&[]).expect(0);
        Rows::of(&folder)
    };
    let (there, tried) = (straight(t), straight(0.2));
    assert!(counts(&tried, 2)[0][1] > 10 * broken[1][1] && broken[1][1] > 0, "{broken:?}");
    assert_eq!(counts(&there, 2)[0], broken[1]);
    for name in ["total", "psi(l)", "psi(a)", "released", "relaxed"] {
        let (found, expected) = (rows.column(name)[1], there.last(name));
        let error = (found - expected).abs() / there.last("total");
        // Within the tolerance of residuals.
        assert!(error < 1e-10, "{name}: {error}");
    }
}

/// A point that hangs on triangles alone, in a body in which nothing else has energy, comes loose once all of
/// them are broken: by themselves, for their bonds stay.
#[test]
fn a_point_without_triangles_comes_loose() {
    let mut cloud = "x,y,z,volume\n1.5,1.5,3.3,1\n".to_owned();
    for k in 0..27 {
        let [x, y, z] = [k / 9, k / 3 % 3, k % 3].map(|at| f64::from(at) + 0.5);
        cloud += &format!("{x},{y},{z},1\n");
    }
    for (loose, code, says) in [
        ("freeze", 0, "came loose, and is held where it is: the point at (1.5, 1.5, 3.3)"),
        ("stop", 3, "have come loose: the point at (1.5, 1.5, 3.3)"),
    ] {
        let folder = SceneFolder::new(&format!(
            "[body]\ndimension = 3\npoints = \"points.csv\"\n[horizon]\nradius = 1.5\n[material]\npotential = \"areas.piola\"\n\
             parameters = {{ g0 = \"10 - 37.4625*max(0, Z - 2.5)\" }}\n[sets]\nlow = \"Z < 1\"\ntip = \"Z > 3\"\n\
             [fracture]\nloose = \"{loose}\"\n[[prescribe]]\nset = \"low\"\nu = [0, 0, 0]\n\
             [[load]]\nset = \"tip\"\nforce = [0, 0, \"t\"]\n[steps]\nincrements = 10\n"
        ));
        folder.file("points.csv", &cloud);
        folder.file(
            "areas.piola",
            "potential areas\nallow \"no-bond-energy\" \"triangles in space hold a cluster\"\nparameter g0 = 1\npsi(a) = 1/2*A*(a/A - 1)^2\nbreak when a/A - 1 > g0\n",
        );
        folder.run(&[]).expect(code).says(&[says, "translation along x"]);
        let rows = Rows::of(&folder);
        rows.close();
        // Eight triangles hold the point; nothing is strained that has lost it.
        let held = if code == 0 { 8.0 } else { 0.0 };
        assert_eq!(rows.last("broken_areas"), held);
        assert_eq!(rows.last("broken_bonds"), 0.0);
        assert!(code != 0 || rows.last("total") < 1e-20);
    }
}
