//! Parameters that vary from point to point: against bodies of several materials, against numbers, and
//! forces and tangents as derivatives of the energy.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use piola_runtime::case::{Case, Library};
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::matrix::BlockMatrix;

use crate::common::{Random, distance, norm};

/// A scene of one kind of energy, with its parameters as functions of the text of one of them.
struct Kind {
    name: &'static str,
    dimension: usize,
    potential: &'static str,
    parameters: fn(&str) -> String,
    further: &'static str,
    /// Whether each interaction of two materials has the mean of their energies, which is the energy of
    /// the mean of their parameters.
    is_mean: bool,
    /// Whether the body is so large that its bonds go along rows.
    is_large: bool,
}

const BOND: &str = "potential p\nparameter C, C > 0\nparameter b = 0.3\npsi(l) = C*L*(l/L - 1)^2";
const CURVED: &str =
    "potential p\nparameter C\nparameter b = 0.3\npsi(l) = C*L*ln(l/L)^2 + b*L*(l/L - 1)^2";
const AREAS: &str = "potential p\nparameter C\npsi(l) = C*L*(l/L - 1)^2\npsi(a) = C*A*(a/A - 1)^2";
const VOLUMES: &str =
    "potential p\nparameter C\npsi(l) = C*L*(l/L - 1)^2\npsi(v) = C*V*(v/V - 1)^2";
const CLIQUES: &str = "potential p\nparameter C\nparameter b = 0.3\npsi(l) = C*L*(l/L - 1)^2\n\
     psi(a) = C*A*(a/A - 1)^2\npsi(v) = (C + b)*V*(v/V - 1)^2";
const PLANE: &str =
    "potential p\nparameter C\npsi(l) = C*L*((l/L)^2 - 1)^2\npsi(a) = C^2*A*(a/A - 1)^2";
const GATHERED: &str = "potential p\nparameter C\nparameter b = 0.3\nm = integral(L^2)\n\
     s = integral(L*(l - L)*C)/m\npsi(s) = (C + b)*s^2\npsi(l, s) = b*L*(l/L - 1)^2*(1 + s/7)";

const DIRECTED: &str = "potential p\ndimensions 3\nparameter C\nparameter b = 0.3\n\
     n = vector(0.6, 0.8, 0)\npsi(l) = C*(b + (n*Xi/L)^4)*L*(l/L - 1)^2";
const DIRECTED_LOGARITHM: &str = "potential p\ndimensions 2\nparameter C\nparameter b = 0.3\n\
     psi(l) = C*abs(Xi(1)/L)*L*ln(l/L)^2 + b*L*(l/L - 1)^2";
const DIRECTED_INTEGRANDS: &str = "potential p\ndimensions 2\nparameter C\nparameter b = 0.3\n\
     c = (Xi*vector(0.8, -0.6)/L)^2\nm = integral(c*L^2)\ns = integral((1 + c)*L*(l - L)*C)/m\n\
     psi(s) = (C + b)*s^2\npsi(l, s) = b*(2 - c)*L*(l/L - 1)^2*(1 + s/7)";

const VECTORS: &str = "potential p\ndimensions 2\nparameter C\nparameter b = 0.3\nK = integral(dyad(Xi, Xi))\n\
     H = integral(C*dyad(xi - Xi, Xi))*inv(K)\npsi(H) = (C + b)*(H : H)\n\
     psi(xi, H) = b*((xi - Xi - H*Xi)*(xi - Xi - neighbour(H)*Xi) + C*(l - L)^2)/L";

const DIRECTED_BESIDE: &str = "potential p\ndimensions 2\nparameter C\nparameter b = 0.3\n\
     m = integral(L^2)\ns = integral(L*(l - L))/m\npsi(s) = b*s^2\n\
     psi(l, m) = C*(b + (Xi*vector(0.8, -0.6)/L)^2)*(l - L)^2/m";

fn only(c: &str) -> String {
    format!("{{ C = {c} }}")
}

fn elastic(c: &str) -> String {
    format!("{{ lambda = 1.5, mu = {c} }}")
}

fn solid(c: &str) -> String {
    format!("{{ K = 3.0, G = {c} }}")
}

fn bulk(c: &str) -> String {
    format!("{{ K = {c}, G = 0.7 }}")
}

const POINTS: &str = "[correspondence]\ndiscretisation = \"nodal\"\n";
const WAN: &str = "[correspondence]\ndiscretisation = \"stabilised\"\nstabilisation = \"wan\"\n";
const BONDS: &str = "[correspondence]\ndiscretisation = \"bond-quadrature\"\n";
const SHEET: &str = "[correspondence]\nplane = \"stress\"\ndiscretisation = \"nodal\"\n";

#[rustfmt::skip]
const KINDS: [Kind; 20] = [
    Kind { name: "vectors", dimension: 2, potential: VECTORS, parameters: only, further: "", is_mean: false, is_large: false },
    Kind { name: "directed beside states", dimension: 2, potential: DIRECTED_BESIDE, parameters: only, further: "", is_mean: false, is_large: true },
    Kind { name: "directed rows", dimension: 3, potential: DIRECTED, parameters: only, further: "", is_mean: true, is_large: true },
    Kind { name: "directed batches", dimension: 2, potential: DIRECTED_LOGARITHM, parameters: only, further: "", is_mean: true, is_large: false },
    Kind { name: "directed integrands", dimension: 2, potential: DIRECTED_INTEGRANDS, parameters: only, further: "", is_mean: false, is_large: false },
    Kind { name: "space", dimension: 3, potential: AREAS, parameters: only, further: "", is_mean: true, is_large: true },
    Kind { name: "affine areas", dimension: 2, potential: AREAS, parameters: only, further: "", is_mean: true, is_large: true },
    Kind { name: "affine volumes", dimension: 3, potential: VOLUMES, parameters: only, further: "", is_mean: true, is_large: true },
    Kind { name: "rows", dimension: 3, potential: BOND, parameters: only, further: "", is_mean: true, is_large: false },
    Kind { name: "plane rows", dimension: 2, potential: BOND, parameters: only, further: "", is_mean: true, is_large: true },
    Kind { name: "batches", dimension: 2, potential: CURVED, parameters: only, further: "", is_mean: true, is_large: false },
    Kind { name: "cliques", dimension: 3, potential: CLIQUES, parameters: only, further: "", is_mean: true, is_large: false },
    Kind { name: "areas", dimension: 2, potential: PLANE, parameters: only, further: "", is_mean: false, is_large: false },
    Kind { name: "points", dimension: 2, potential: "neo_hooke", parameters: elastic, further: POINTS, is_mean: true, is_large: false },
    Kind { name: "stabilised", dimension: 2, potential: "neo_hooke", parameters: elastic, further: WAN, is_mean: true, is_large: false },
    Kind { name: "bond quadrature", dimension: 3, potential: "neo_hooke", parameters: elastic, further: BONDS, is_mean: true, is_large: false },
    Kind { name: "sheet", dimension: 2, potential: "neo_hooke", parameters: elastic, further: SHEET, is_mean: true, is_large: false },
    Kind { name: "bulk modulus", dimension: 3, potential: "linear_peridynamic_solid", parameters: bulk, further: "", is_mean: true, is_large: false },
    Kind { name: "shear modulus", dimension: 3, potential: "linear_peridynamic_solid", parameters: solid, further: "", is_mean: false, is_large: false },
    Kind { name: "integrands", dimension: 2, potential: GATHERED, parameters: only, further: "", is_mean: false, is_large: false },
];

impl Kind {
    fn case(&self, materials: &str, further: &str) -> Case {
        // Tests run at once: each case has a folder of its own.
        static CASES: AtomicUsize = AtomicUsize::new(0);
        let number = CASES.fetch_add(1, Ordering::Relaxed);
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fields_{number}"));
        std::fs::create_dir_all(&folder).unwrap();
        let sides = match (self.dimension, self.is_large) {
            (2, false) => "[1, 0.5]",
            (2, true) => "[2, 2]",
            (_, false) => "[1, 0.5, 0.5]",
            (_, true) => "[1.5, 1.5, 1.5]",
        };
        let lower = if self.dimension == 2 { "[0, 0]" } else { "[0, 0, 0]" };
        let text = format!(
            "[body]\nbox = [{lower}, {sides}]\nspacing = 0.125\n[horizon]\nspacings = 2.1\n\
             weights = \"volumes\"\n{materials}{}{further}[sets]\nleft = \"X < 0.5\"\n",
            self.further
        );
        read(&folder, &text, self.potential)
    }

    /// The body of one material, with this value of the parameter.
    fn of(&self, value: &str) -> Case {
        let parameters = (self.parameters)(value);
        self.case(
            &format!("[material]\npotential = \"{}\"\nparameters = {parameters}\n", self.law()),
            "",
        )
    }

    /// The body of two materials with values of their own.
    fn of_two(&self, left: &str, right: &str) -> Case {
        let one = |head: &str, value: &str| {
            let parameters = (self.parameters)(value);
            format!(
                "[[material]]\n{head}\npotential = \"{}\"\nparameters = {parameters}\n",
                self.law()
            )
        };
        self.case(&(one("set = \"left\"", left) + &one("name = \"rest\"", right)), "")
    }

    fn law(&self) -> &'static str {
        if self.potential.contains(' ') { "law.piola" } else { self.potential }
    }
}

pub(crate) fn read(folder: &Path, text: &str, potential: &str) -> Case {
    std::fs::write(folder.join("law.piola"), potential).unwrap();
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, text).unwrap();
    let find = |name: &str| match name {
        "neo_hooke" => Some(include_str!("../../../potentials/neo_hooke.piola")),
        "linear_peridynamic_solid" => {
            Some(include_str!("../../../potentials/linear_peridynamic_solid.piola"))
        }
        _ => None,
    };
    let library = Library { find: &find, names: &[] };
    Case::read(&scene, &[], &library).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// A smooth displacement with a little noise.
pub(crate) fn displacement(case: &Case, size: f64) -> Vec<f64> {
    let d = case.body.dimension();
    let mut random = Random(7);
    (0..case.body.n_points())
        .flat_map(|point| {
            let x = case.body.position(point).to_vec();
            (0..d)
                .map(|axis| {
                    let wave = libm::sin(2.0 * x[0] + 0.7 * axis as f64) + x[1] * x[0];
                    size * (wave + 0.1 * random.next())
                })
                .collect::<Vec<f64>>()
        })
        .collect()
}

fn evaluate(case: &Case, u: &[f64]) -> (f64, Vec<f64>) {
    let energy = case.energy(case.compile().unwrap()).unwrap();
    let mut forces = vec![0.0; u.len()];
    let total = energy.forces(u, &mut forces).unwrap().total();
    (total, forces)
}

fn agree(kind: &Kind, what: &str, one: &Case, other: &Case, tolerance: f64) {
    let u = displacement(one, 0.01);
    let ((energy, forces), (expected, expected_forces)) = (evaluate(one, &u), evaluate(other, &u));
    let off = (energy / expected - 1.0).abs();
    let off_forces = distance(&forces, &expected_forces);
    println!("{}: {what}: energy {off:.1e}, forces {off_forces:.1e}", kind.name);
    assert!(off < tolerance && off_forces < tolerance, "{}: {what}", kind.name);
}

#[test]
fn a_field_that_is_the_same_everywhere_is_a_number() {
    for kind in &KINDS {
        agree(kind, "the same everywhere", &kind.of("\"2.5 + 0*X\""), &kind.of("2.5"), 1e-13);
    }
}

/// Laws are linear in the parameter: interactions between two halves have the mean of their energies.
#[test]
fn fields_with_two_values_are_two_materials() {
    for kind in KINDS.iter().filter(|kind| kind.is_mean) {
        let graded = kind.of("\"if X < 0.5 then 2 else 5\"");
        agree(kind, "two values", &graded, &kind.of_two("2.0", "5.0"), 1e-13);
    }
}

/// Two materials with fields of their own, that of the whole body where they have the same.
#[test]
fn materials_have_fields_of_their_own() {
    for kind in &KINDS {
        let field = "\"1 + X + Y^2\"";
        let both = kind.of_two(field, field);
        let energy = |case: &Case| evaluate(case, &displacement(case, 0.01)).0;
        let (one, two) = (energy(&kind.of(field)), energy(&both));
        // Where they meet each takes the mean over its own corners: near, not the same.
        assert!((one / two - 1.0).abs() < 0.02, "{}: {one} {two}", kind.name);
        let number = kind.of_two(field, "2.0");
        let other = kind.of_two(field, "\"2 + 0*X\"");
        agree(kind, "a number beside a field", &number, &other, 1e-13);
    }
}

#[test]
fn forces_and_tangents_are_derivatives_of_the_energy() {
    for kind in &KINDS {
        let case = kind.of("\"2 + X*Y + sin(3*X)\"");
        let energy = case.energy(case.compile().unwrap()).unwrap();
        let u = displacement(&case, 0.01);
        let p = Random(11).vector(u.len());
        let moved = |by: f64| -> Vec<f64> { u.iter().zip(&p).map(|(u, p)| u + by * p).collect() };
        let at = |by: f64| {
            let mut forces = vec![0.0; u.len()];
            let total = energy.forces(&moved(by), &mut forces).unwrap().total();
            (total, forces)
        };
        let step = 1e-5 * 0.125;
        let ((low, low_forces), (high, high_forces)) = (at(-step), at(step));
        let (_, forces) = at(0.0);
        let slope = (high - low) / (2.0 * step);
        let expected: f64 = forces.iter().zip(&p).map(|(g, p)| g * p).sum();
        let scale = norm(&forces) * norm(&p);
        assert!((slope - expected).abs() < 1e-7 * scale, "{}: {slope} {expected}", kind.name);
        let mut product = vec![0.0; u.len()];
        energy.hessian(&u).unwrap().multiply(&p, &mut product);
        let differences: Vec<f64> =
            high_forces.iter().zip(&low_forces).map(|(h, l)| (h - l) / (2.0 * step)).collect();
        let off = distance(&differences, &product);
        let mut stored = BlockMatrix::zeros(energy.pattern());
        let mut parts = vec![0.0; energy.parts().len()];
        let mut out = vec![0.0; u.len()];
        energy.evaluate(&u, Wanted::Tangent(&mut out, &mut stored), &mut parts).unwrap();
        let by_matrix = distance(&stored.multiply(&p), &product);
        println!("{}: products off by {off:.1e}, stored by {by_matrix:.1e}", kind.name);
        assert!(off < 1e-6 && by_matrix < 1e-12, "{}: {off:.1e} {by_matrix:.1e}", kind.name);
        assert!(distance(&out, &forces) < 1e-12, "{}", kind.name);
    }
}

/// The same bits with any number of threads.
#[test]
fn fields_give_the_same_bits_for_any_number_of_threads() {
    for kind in &KINDS {
        let found = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let case = kind.of("\"2 + X*Y\"");
                evaluate(&case, &displacement(&case, 0.01))
            })
        });
        assert_eq!(found[0], found[1], "{}", kind.name);
    }
}

/// Bonds whose law is a multiple of the field go along rows, as those without do.
#[test]
fn multiples_of_a_field_go_along_rows() {
    let ways = |name: &str, value: &str| {
        let kind = KINDS.iter().find(|kind| kind.name == name).unwrap();
        let case = Kind { is_large: true, ..*kind }.of(value);
        case.energy(case.compile().unwrap()).unwrap().report().ways
    };
    for name in ["rows", "plane rows", "affine areas", "affine volumes"] {
        assert_eq!(ways(name, "2.0"), ["rows"], "{name}");
        assert_eq!(ways(name, "\"2 + X\""), ["rows"], "{name}");
        assert_eq!(ways(name, "\"2 + t\""), ["batches"], "{name}");
    }
    assert_eq!(ways("batches", "\"2 + X\""), ["batches"]);
    assert!(ways("directed beside states", "2.0").contains(&"rows"));
    assert_eq!(ways("directed rows", "2.0"), ["rows"]);
    assert_eq!(ways("directed rows", "\"2 + X\""), ["batches"]);
    for name in ["bulk modulus", "shear modulus"] {
        assert!(ways(name, "2.0").contains(&"rows"), "{name}");
        assert_eq!(ways(name, "2.0"), ways(name, "\"2 + X\""), "{name}");
    }
}

/// What changes with t is set anew: energies are then those of the numbers at that time, forth and back.
/// Stabilisations keep the stiffness of the start.
#[test]
fn fields_that_change_are_those_of_their_time() {
    for kind in KINDS.iter().filter(|kind| kind.name != "stabilised") {
        let case = kind.of("\"2 + t*(1 + X)\"");
        let u = displacement(&case, 0.01);
        let (energy, fields) = case.energy_in_time(case.compile().unwrap()).unwrap();
        for (t, value) in [(0.0, "2.0"), (1.0, "\"3 + X\""), (0.5, "\"2.5 + X/2\""), (0.0, "2.0")] {
            assert!(fields.advance(t).unwrap());
            let mut forces = vec![0.0; u.len()];
            let total = energy.forces(&u, &mut forces).unwrap().total();
            let (expected, expected_forces) = evaluate(&kind.of(value), &u);
            let off = (total / expected - 1.0).abs();
            let off_forces = distance(&forces, &expected_forces);
            assert!(off < 1e-13 && off_forces < 1e-12, "{} {t}: {off:e} {off_forces:e}", kind.name);
        }
    }
    assert!(!KINDS[0].of("\"2 + X\"").changes_in_time());
}

/// The derivative of the energy of every point by a uniform gradient of displacements: against differences
/// of these energies, and in their sum against the forces.
#[test]
fn virials_are_derivatives_of_the_energies_of_points() {
    for kind in &KINDS {
        for case in [kind.of("\"2 + X\""), kind.of_two("2.0", "5.0")] {
            let energy = case.energy(case.compile().unwrap()).unwrap();
            let (d, n) = (case.body.dimension(), case.body.n_points());
            let u = displacement(&case, 0.02);
            let mut virials = vec![0.0; n * d * d];
            energy.virials(&u, &mut virials).unwrap();
            let x = case.body.positions();
            let mut forces = vec![0.0; u.len()];
            energy.forces(&u, &mut forces).unwrap();
            let (mut off, mut off_sum) = (0.0_f64, 0.0_f64);
            for place in 0..d * d {
                let (row, column) = (place / d, place % d);
                let shares = |h: f64| {
                    let along = |dof: usize| h * x[dof / d * d + column];
                    let moved = |dof: usize| if dof % d == row { along(dof) } else { 0.0 };
                    let moved: Vec<f64> = (0..u.len()).map(|dof| u[dof] + moved(dof)).collect();
                    let mut shares = vec![0.0; n];
                    energy.shares(&moved, &mut shares).unwrap();
                    shares
                };
                let (after, before) = (shares(1e-5), shares(-1e-5));
                let own = || virials.iter().skip(place).step_by(d * d);
                for ((own, after), before) in own().zip(&after).zip(&before) {
                    off = off.max((own - (after - before) / 2e-5).abs());
                }
                let pull = (0..n).fold(0.0, |sum, i| sum + forces[i * d + row] * x[i * d + column]);
                off_sum = off_sum.max((own().fold(0.0, |sum, own| sum + own) - pull).abs());
            }
            let largest = virials.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            println!("{}: {:.1e}, sum {:.1e}", kind.name, off / largest, off_sum / largest);
            assert!(off <= 1e-7 * largest && off_sum <= 1e-11 * largest, "{}", kind.name);
        }
    }
}

/// Of every part of an energy, the shares of points sum to it, and the parts to the shares of all.
#[test]
fn shares_of_points_come_by_parts() {
    for kind in &KINDS {
        let case = kind.of("\"2 + X\"");
        let energy = case.energy(case.compile().unwrap()).unwrap();
        let n = case.body.n_points();
        let u = displacement(&case, 0.02);
        let whole = energy.energy(&u).unwrap();
        let (mut shares, mut sums) = (vec![0.0; n], vec![0.0; n]);
        for (part, (name, value)) in whole.iter().enumerate() {
            energy.shares_of(part, &u, &mut shares).unwrap();
            let sum = shares.iter().fold(0.0, |sum, share| sum + share);
            let off = (sum - value).abs();
            assert!(off <= 1e-12 * whole.magnitude(), "{}, {name}: {sum} {value}", kind.name);
            sums.iter_mut().zip(&shares).for_each(|(sum, share)| *sum += share);
        }
        energy.shares(&u, &mut shares).unwrap();
        let largest = shares.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let near = |(sum, share): (&f64, &f64)| (sum - share).abs() <= 1e-13 * largest;
        assert!(sums.iter().zip(&shares).all(near), "{}", kind.name);
    }
}
