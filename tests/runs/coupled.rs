//! Energies of several measures of a triangle or a tetrahedron in scenes: what runs, and what is refused.

use crate::support::{Outcome, SceneFolder, distance, energy_part, number, numbers, piola};

const PLANE: &str =
    "[body]\nbox = [[0.0, 0.0], [1.0, 1.0]]\nspacing = 0.1\n[horizon]\nspacings = 2\n";
const SPACE: &str = "[body]\nbox = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\nspacing = 0.25\n[horizon]\n\
                     spacings = 2\n";

fn scene(body: &str, more: &str, energies: &str) -> SceneFolder {
    let scene = format!("{body}[material]\npotential = \"law.piola\"\n{more}");
    let folder = SceneFolder::new(&scene);
    folder.file("law.piola", format!("potential law\nparameter k = 1\n{energies}\n"));
    folder
}

fn of(command: &str, folder: &SceneFolder, more: &[&str]) -> Outcome {
    piola(&[&[command, &folder.scene()], more].concat())
}

/// An energy that ignores all but the measure of the whole is one of that measure, in the lattice too.
#[test]
fn moduli_are_those_of_the_energy_of_one_measure() {
    let bonds = "psi(l) = (l/L - 1)^2";
    for (body, alone, several) in [
        (PLANE, "psi(a) = A*(a/A - 1)^2", "psi(a, l1) = A*(a/A - 1)^2"),
        (SPACE, "psi(a) = ln(a/A)^2", "psi(a, l1, l2) = ln(a/A)^2"),
        (SPACE, "psi(v) = (v/V - 1)^2", "psi(v, a1) = (v/V - 1)^2"),
    ] {
        let found = [alone, several].map(|energy| {
            let folder = scene(body, "", &format!("{bonds}\n{energy}"));
            of("moduli", &folder, &["--format", "json"]).expect(0).json()
        });
        for name in ["C11", "C12", "C44"] {
            let [alone, several] = [0, 1].map(|k| number(&found[k][name]));
            let error = (several - alone).abs() / alone.abs();
            assert!(error < 1e-13, "{several}: {name} {error:e}");
        }
    }
}

/// Bonds, and the angle between two.
const BENDING: &str = "psi(l) = (l/L - 1)^2
psi(angle, l1, l2) = 10*k*exp(2 - l1/L1 - l2/L2)*(angle - Angle)^2";

/// A displacement that bends the square, of about 0.1.
fn bent() -> String {
    let place = |k: usize| 0.05 + 0.1 * k as f64;
    let points = (0..10).flat_map(|i| (0..10).map(move |j| (place(i), place(j))));
    let rows = points.map(|(x, y)| format!("{},{}\n", 0.1 * x * y, 0.1 * x * x - 0.05 * y));
    format!("u,v\n{}", rows.collect::<String>())
}

/// Energies of parts and forces.
fn at(folder: &SceneFolder, more: &[&str]) -> (Vec<f64>, Vec<f64>) {
    let found = folder.energy(&bent(), more).expect(0).json();
    let parts = ["psi(l)", "psi(angle, l1, l2)"].map(|name| energy_part(&found, name));
    (parts.to_vec(), numbers(&found["gradient"]))
}

#[test]
fn parameters_that_vary_and_several_materials_are_known() {
    let one = at(&scene(PLANE, "", BENDING), &[]);
    assert!(one.0.iter().all(|part| *part > 0.0));
    let alike = |found: (Vec<f64>, Vec<f64>), case: &str| {
        let errors = [distance(&found.0, &one.0), distance(&found.1, &one.1)];
        assert!(errors.iter().all(|error| *error < 1e-14), "{case}: {errors:?}");
    };
    // The same value as a constant, as a field, and in two materials.
    let field = scene(PLANE, "parameters = { k = \"1 + 0*X\" }\n", BENDING);
    alike(at(&field, &[]), "a field");
    let half = scene(PLANE, "set = \"half\"\n", BENDING);
    let text = std::fs::read_to_string(half.scene()).unwrap().replace("[material]", "[[material]]");
    let two = format!(
        "{text}[[material]]\nname = \"rest\"\npotential = \"law.piola\"\n[sets]\nhalf = \"X < 0.5\"\n"
    );
    std::fs::write(half.scene(), two).unwrap();
    let (parts, forces) = at(&half, &[]);
    alike((parts, forces), "two materials");
    // A parameter that grows along X: between its smallest and its largest value.
    let graded = at(&scene(PLANE, "parameters = { k = \"1 + X\" }\n", BENDING), &[]);
    assert!(graded.0[1] > 1.1 * one.0[1] && graded.0[1] < 1.9 * one.0[1], "{graded:?}");
    for how in ["interpreter", "hyperdual"] {
        let set = format!("solver.derivatives={how}");
        alike(at(&scene(PLANE, "", BENDING), &["--set", &set]), how);
    }
}

#[test]
fn what_knows_one_measure_alone_says_so() {
    let folder = scene(PLANE, "", BENDING);
    of("plan", &folder, &["--set", "horizon.surface=energy"]).expect(2).says(&[
        "corrections are of bonds, and law has a psi(angle, l1, l2)",
        "triangles and tetrahedra have none",
    ]);
    of("plan", &folder, &["--set", "solver.derivatives=hyperdual-coordinates"])
        .expect(2)
        .says(&["energies of one measure: choose \"hyperdual\""]);
    let law = folder.path("law.piola");
    let points = folder.file("points.csv", "a,A\n1,1\n");
    piola(&["eval", &law, "--measure", "a", "--points", &points])
        .expect(2)
        .says(&["has no energy psi(a)", "use --measure l"]);
    let lossy =
        folder.file("lossy.piola", "potential p\npsi(l1, l2, l3) = (l1*l2/(L1*L2) - l3/L3)^2\n");
    let told = piola(&["verify", &lossy]).expect(1).stdout;
    assert!(told.contains("changes of l1, l2, l3 by ("), "{told}");
}

/// Stress and stiffness at rest are those of the lattice: what a triangle alone stores does not tell.
#[test]
fn a_body_that_moves_or_gives_way_at_rest_is_refused() {
    for (energies, code) in [
        ("psi(l) = (l/L - 1)^2\npsi(a, l1) = a/A*l1/L1", "not-stress-free"),
        ("psi(angle) = (angle - Angle)^2", "not-stiff-at-rest"),
    ] {
        let folder = scene(PLANE, "", energies);
        let refused = of("plan", &folder, &[]).expect(2);
        refused.says(&[&format!("error[{code}]"), "law.piola:", "at rest"]);
        let allowed = scene(PLANE, "", &format!("allow \"{code}\" \"as it is meant\"\n{energies}"));
        of("energy", &allowed, &[]).expect(0);
    }
}

/// A tetrahedron is bent into a run: plan, run and moduli of volumes with their faces and edges.
#[test]
fn tetrahedra_with_their_faces_and_edges_run() {
    let energies = "psi(l) = (l/L - 1)^2
psi(v, a1, a2, a3, a4) = k*(v/V - 1)^2*exp((a1/A1 - 1) + (a2/A2 - 1) + (a3/A3 - 1) + (a4/A4 - 1))
psi(v, l1, l6) = (l1/L1 - 1)*(l6/L6 - 1) + (v/V - 1)^2";
    let held = "[sets]\nleft = \"X < 0.3\"\nright = \"X > 0.7\"\n[[prescribe]]\nset = \"left\"\n\
                u = [0, 0, 0]\n[[prescribe]]\nset = \"right\"\nu = [\"0.2*t\", 0, 0]\n[steps]\n\
                increments = 2\n[output]\nframes = 2\n";
    let folder = scene(SPACE, held, energies);
    let plan = of("plan", &folder, &[]).expect(0).stdout;
    assert!(plan.contains("psi(v, a1, a2, a3, a4) + psi(v, l1, l6)"), "{plan}");
    folder.run(&[]).expect(0);
    let steps = folder.summary()["steps"].as_array().unwrap().clone();
    let parts = steps.last().unwrap()["energy_parts"].as_object().unwrap().clone();
    assert!(parts.contains_key("psi(v, a1, a2, a3, a4) + psi(v, l1, l6)"), "{parts:?}");
}
