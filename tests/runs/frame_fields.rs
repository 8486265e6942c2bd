//! What frames show of points beside displacements: against what uniform strains have.

use std::fs;

use crate::support::frames::{VtuFile, read_pvd, read_vtu};
use crate::support::{SceneFolder, numbers, piola};

const ALL: &str = "[\"energy_density\", \"deformation_gradient\", \"jacobian\", \"strain\", \
     \"principal_stretches\", \"piola_stress\", \"stress\", \"von_mises\", \"principal_stresses\", \
     \"neighbours\", \"sets\"]";

/// A body that is strained evenly, all but for two points near its centre, which find the same by themselves.
fn even(dimension: usize, potential: &str, further: &str) -> SceneFolder {
    let (bounds, u, free) = match dimension {
        2 => (
            "[[0, 0], [1, 1]]",
            "[\"t*(0.1*X + 0.05*Y)\", \"t*(-0.03*Y)\"]",
            "abs(X - 0.5) + abs(Y - 0.5) < 0.15",
        ),
        _ => (
            "[[0, 0, 0], [1, 1, 1]]",
            "[\"t*(0.1*X + 0.05*Y)\", \"t*(-0.03*Y)\", \"t*0.02*Z\"]",
            "abs(X - 0.5) + abs(Y - 0.5) + abs(Z - 0.5) < 0.15",
        ),
    };
    SceneFolder::new(&format!(
        "[body]\nbox = {bounds}\nspacing = 0.1\n[horizon]\nspacings = 2.1\n\
         [material]\npotential = \"{potential}\"\n{further}\n\
         [sets]\nheld = \"not ({free})\"\n\
         [[prescribe]]\nset = \"held\"\nu = {u}\n[steps]\nincrements = 2\n\
         [output]\nfields = {ALL}\n"
    ))
}

fn last_frame(folder: &SceneFolder) -> VtuFile {
    let out = folder.out();
    let frames = read_pvd(&fs::read_to_string(out.join("run.pvd")).unwrap()).unwrap();
    read_vtu(&out.join(&frames.last().unwrap().1)).unwrap()
}

/// The numbers of the point at the middle of the body.
fn in_the_middle(frame: &VtuFile, name: &str) -> Vec<f64> {
    let array = frame.array(name).unwrap_or_else(|| panic!("no {name}"));
    let x = frame.positions.chunks_exact(3);
    let z = frame.positions[2];
    let is_flat = frame.positions.chunks_exact(3).all(|x| x[2] == z);
    let near = |x: &[f64]| (0..if is_flat { 2 } else { 3 }).all(|c| (x[c] - 0.45).abs() < 0.01);
    let point = x.clone().position(near).expect("a point near the middle");
    array.values[point * array.components..(point + 1) * array.components].to_vec()
}

fn agree(what: &str, found: &[f64], known: &[f64], tolerance: f64) {
    assert_eq!(found.len(), known.len(), "{what}");
    let scale = known.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (x, y) in found.iter().zip(known) {
        assert!((x - y).abs() <= tolerance * scale, "{what}: {found:?}, not {known:?}");
    }
}

/// Neo-Hooke's law: P = mu (F - F^-T) + lambda ln J F^-T.
#[test]
fn a_body_of_psi_of_f_has_its_own_stress() {
    let parameters = "parameters = { lambda = 2.0, mu = 1.0 }";
    for discretisation in ["nodal", "bond-quadrature", "stabilised"] {
        let further =
            format!("{parameters}\n[correspondence]\ndiscretisation = \"{discretisation}\"");
        let folder = even(3, "neo_hooke", &further);
        folder.run(&[]).expect(0);
        let frame = last_frame(&folder);
        let resolved = fs::read_to_string(folder.out().join("scene.resolved.toml")).unwrap();
        assert!(resolved.contains("\"von_mises\"") && resolved.contains("colour"), "{resolved}");
        let f = [[1.1, 0.05, 0.0], [0.0, 0.97, 0.0], [0.0, 0.0, 1.02]];
        let j: f64 = 1.1 * 0.97 * 1.02;
        // The inverse of an upper triangle, turned.
        let inverse_t = [
            [1.0 / 1.1, 0.0, 0.0],
            [-0.05 / (1.1 * 0.97), 1.0 / 0.97, 0.0],
            [0.0, 0.0, 1.0 / 1.02],
        ];
        let ln = libm::log(j);
        let p: Vec<f64> = (0..9)
            .map(|k| (k / 3, k % 3))
            .map(|(r, c)| f[r][c] - inverse_t[r][c] + 2.0 * ln * inverse_t[r][c])
            .collect();
        let stress: Vec<f64> = (0..9)
            .map(|k| (0..3).fold(0.0, |sum, m| sum + p[k / 3 * 3 + m] * f[k % 3][m]) / j)
            .collect();
        agree("F", &in_the_middle(&frame, "deformation_gradient"), f.as_flattened(), 1e-9);
        agree("J", &in_the_middle(&frame, "jacobian"), &[j], 1e-9);
        agree("P", &in_the_middle(&frame, "piola_stress"), &p, 1e-9);
        agree("stress", &in_the_middle(&frame, "stress"), &stress, 1e-9);
        let e = [0.5 * (1.21 - 1.0), 0.5 * 1.1 * 0.05, 0.0];
        agree("E", &in_the_middle(&frame, "strain")[..3], &e, 1e-9);
        let stretches = in_the_middle(&frame, "principal_stretches");
        assert!(stretches[0] > stretches[1] && stretches[1] > stretches[2]);
        agree("stretches", &[stretches.iter().product()], &[j], 1e-9);
        let own = in_the_middle(&frame, "principal_stresses");
        agree("trace", &[own.iter().sum()], &[stress[0] + stress[4] + stress[8]], 1e-9);
        let apart = |k: usize| own[k] - own[(k + 1) % 3];
        let mises = (0..3).fold(0.0, |sum, k| sum + apart(k) * apart(k));
        agree("von Mises", &in_the_middle(&frame, "von_mises"), &[(0.5 * mises).sqrt()], 1e-9);
        // mu/2 (F : F - 3 - 2 ln J) + lambda/2 ln J^2.
        let squares = f.as_flattened().iter().fold(0.0, |sum, x| sum + x * x);
        let psi = 0.5 * (squares - 3.0 - 2.0 * ln) + ln * ln;
        agree("energy", &in_the_middle(&frame, "energy_density"), &[psi], 1e-9);
        assert_eq!(in_the_middle(&frame, "set held"), [0.0]);
        assert_eq!(in_the_middle(&frame, "neighbours"), [32.0]);
    }
}

/// St Venant-Kirchhoff's sheet with free faces: `E33 = -lambda/(lambda + 2 mu) (E11 + E22)`, so that its
/// stretch across and its true stress are known.
#[test]
fn a_sheet_in_plane_stress_gets_thinner() {
    for discretisation in ["nodal", "bond-quadrature"] {
        let further = format!(
            "parameters = {{ lambda = 2.0, mu = 1.0 }}\n[correspondence]\n\
             discretisation = \"{discretisation}\"\nplane = \"stress\""
        );
        let folder = even(2, "st_venant_kirchhoff", &further);
        folder.run(&[]).expect(0);
        let frame = last_frame(&folder);
        let f = [[1.1, 0.05], [0.0, 0.97]];
        let square = |r: usize, c: usize| f[0][r] * f[0][c] + f[1][r] * f[1][c];
        let e = |r: usize, c: usize| 0.5 * (square(r, c) - f64::from(u8::from(r == c)));
        let across = -2.0 / 4.0 * (e(0, 0) + e(1, 1));
        let f33 = (1.0 + 2.0 * across).sqrt();
        let trace = e(0, 0) + e(1, 1) + across;
        let s = |r: usize, c: usize| 2.0 * e(r, c) + if r == c { 2.0 * trace } else { 0.0 };
        let j = 1.1 * 0.97 * f33;
        let true_stress = |r: usize, c: usize| {
            let terms = (0..4).map(|k| f[r][k / 2] * s(k / 2, k % 2) * f[c][k % 2]);
            terms.fold(0.0, |sum, term| sum + term) / j
        };
        let known: Vec<f64> = (0..9)
            .map(|k| if k / 3 < 2 && k % 3 < 2 { true_stress(k / 3, k % 3) } else { 0.0 })
            .collect();
        agree("J", &in_the_middle(&frame, "jacobian"), &[j], 1e-9);
        agree("stress", &in_the_middle(&frame, "stress"), &known, 1e-9);
    }
}

/// Bonds, triangles and gathered states: the stress does the work that the energy takes, and for small
/// strains is what the moduli of the lattice make of them.
#[test]
fn bodies_of_interactions_have_the_stress_of_their_lattice() {
    for (dimension, potential, parameters) in [
        (2, "javili2020", "parameters = { C1 = 1.0, C2 = 0.5 }"),
        (3, "silling2000", "parameters = { K = 1.0 }"),
        (3, "linear_peridynamic_solid", "parameters = { K = 1.0, G = 0.4 }"),
    ] {
        let folder = even(dimension, potential, parameters);
        let text = fs::read_to_string(folder.scene()).unwrap();
        fs::write(folder.scene(), text.replace("t*", "1e-7*t*")).unwrap();
        folder.run(&[]).expect(0);
        let moduli = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        let c = numbers(&moduli["voigt"]);
        let frame = last_frame(&folder);
        let strain = in_the_middle(&frame, "strain");
        agree("strain", &[strain[0], strain[1]], &[1e-8, 2.5e-9], 1e-6);
        let stress = in_the_middle(&frame, "stress");
        let density = in_the_middle(&frame, "energy_density")[0];
        let work = stress.iter().zip(&strain).fold(0.0, |sum, (s, e)| sum + 0.5 * s * e);
        agree("work", &[work], &[density], 1e-5);
        // Voigt's order: the diagonal, and behind it yz, xz, xy with twice the strain; in a plane xy.
        let order: &[usize] = if dimension == 2 { &[0, 4, 1] } else { &[0, 4, 8, 5, 2, 1] };
        let twice = |place: usize| if place.is_multiple_of(4) { 1.0 } else { 2.0 };
        let n = order.len();
        let known: Vec<f64> = (0..n)
            .map(|r| {
                let terms = order.iter().enumerate();
                terms.fold(0.0, |sum, (s, e)| sum + c[r * n + s] * twice(*e) * strain[*e])
            })
            .collect();
        let found: Vec<f64> = order.iter().map(|place| stress[*place]).collect();
        agree(potential, &found, &known, 1e-6);
    }
}

#[test]
fn a_body_that_falls_is_accelerated() {
    let folder = SceneFolder::new(
        "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.25\n[horizon]\nspacings = 1.5\n\
         [material]\npotential = \"javili2020\"\ndensity = 1000\nparameters = { C1 = 1e6 }\n\
         [sets]\nall = \"X > -1\"\n[[load]]\nset = \"all\"\nacceleration = [0, -9.81]\n\
         [motion]\nend = 0.1\n[output]\nframes = 2\nfields = [\"acceleration\", \"jacobian\"]\n",
    );
    folder.run(&[]).expect(0);
    let frame = last_frame(&folder);
    let a = &frame.array("acceleration").unwrap().values;
    assert_eq!(a.len(), 3 * 16);
    a.chunks_exact(3).for_each(|a| agree("acceleration", a, &[0.0, -9.81, 0.0], 1e-9));
}

#[test]
fn fields_that_are_not_there_are_refused() {
    let scene = |fields: &str| {
        even(2, "javili2020", "").run(&["--set", &format!("output.fields={fields}")])
    };
    scene("[\"strains\"]").expect(2).says(&[
        "cannot be \"strains\"",
        "did you mean \"strain\"",
        "fields = [",
    ]);
    scene("[\"stress\", \"stress\"]").expect(2).says(&["stands here twice"]);
    scene("[\"acceleration\"]").expect(2).says(&["what bodies that move have"]);
    scene("\"stress\"").expect(2).says(&["expected an array", "[\"strain\""]);
}
