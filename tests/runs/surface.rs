//! Corrections of bonds through the program: what is refused with its place, and moduli inside.

use crate::support::{SceneFolder, number, piola};

fn block(horizon: &str, material: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [1, 1, 1]]\nspacing = 0.2\n[horizon]\nspacings = 3\n{horizon}\n\
         [material]\n{material}\n"
    ))
}

#[test]
fn what_has_no_bonds_to_correct_is_refused_with_its_place() {
    for (material, parts) in [
        (
            "potential = \"neo_hooke\"\nparameters = { mu = 1.0, lambda = 1.0 }",
            ["psi(F)", "exact for linear fields"],
        ),
        (
            "potential = \"linear_peridynamic_solid\"\nparameters = { K = 1.0, G = 1.0 }",
            ["psi(theta)", "sums over the family"],
        ),
        (
            "potential = \"javili2020\"\nparameters = { C1 = 1.0, C2 = 1.0 }",
            ["psi(a)", "triangles and tetrahedra have none"],
        ),
    ] {
        for key in ["surface = \"directional\"", "volumes = \"partial\""] {
            let folder = block(key, material);
            let place = format!("scene.toml:6:{}", key.find('"').unwrap() + 1);
            for command in ["plan", "moduli"] {
                let said = piola(&[command, &folder.scene()]).expect(2);
                said.says(&["conflicting-keys", &place, parts[0], parts[1]]);
            }
        }
    }
    // Coefficients of 0 are no triangles.
    let bonds = "potential = \"javili2020\"\nparameters = { C1 = 1.0, C2 = 0.0, C3 = 0.0 }";
    piola(&["moduli", &block("surface = \"energy\"", bonds).scene()]).expect(0);
}

#[test]
fn plans_count_the_memory_of_corrections() {
    let bonds = "potential = \"silling2000\"\nparameters = { K = 1.0 }\n[sets]\nlow = \"X < 0.3\"\n\
                 [[prescribe]]\nset = \"low\"\nu = [0, 0, 0]";
    let of = |horizon: &str| piola(&["plan", &block(horizon, bonds).scene()]).expect(0).stdout;
    assert!(of("surface = \"energy\"").contains("corrections of bonds"));
    assert!(!of("").contains("corrections of bonds"));
}

/// A parameter that is the same everywhere, written as an expression, is a number: as a factor of psi, and
/// where stiffness against length depends on it. One that varies as a factor leaves factors as they are.
#[test]
fn parameters_that_vary_count_at_each_point() {
    let law = "potential p\nparameter C = 1\nparameter n = 1\n\
               psi(l) = C*L*exp(-n*L)*(l/L - 1)^2\n";
    let energy = |surface: &str, level: &str, parameters: &str| {
        let material = format!("potential = \"p.piola\"\nparameters = {{ {parameters} }}");
        let folder = block(&format!("surface = \"{surface}\""), &material);
        folder.file("p.piola", law);
        let row = |point: usize| {
            let place = |axis: i32| (point as f64 / f64::from(10_i32.pow(axis as u32))).floor();
            format!("{:?},{:?},0\n", 1e-3 * (place(0) % 7.0), 1e-3 * (place(1) % 5.0))
        };
        let u: String = (0..125).map(row).collect();
        let level = format!("solver.level=\"{level}\"");
        let said = folder.energy(&format!("u,v,w\n{u}"), &["--set", &level]).json();
        number(&said["energy"])
    };
    for surface in ["energy", "directional"] {
        for level in ["fast", "strict"] {
            let of = |parameters: &str| energy(surface, level, parameters);
            let close = |x: f64, y: f64| assert!((x / y - 1.0).abs() < 1e-12, "{x} {y}");
            close(of("C = \"2 + 0*X\", n = 3.0"), of("C = 2.0, n = 3.0"));
            close(of("C = 2.0, n = \"3 + 0*X\""), of("C = 2.0, n = 3.0"));
            // Linear in C, factors do not depend on it.
            let graded = of("C = \"2 + X\", n = 3.0");
            let parts = of("C = \"1 + X\", n = 3.0") + of("C = 1.0, n = 3.0");
            close(graded, parts);
        }
    }
}

/// Inside, the surface changes nothing and parts of cells multiply bonds by 1/2 + (3 - L), L in spacings.
#[test]
fn moduli_inside_count_parts_of_cells_and_no_surface() {
    let of = |horizon: &str| {
        let folder = block(horizon, "potential = \"silling2000\"\nparameters = { K = 1.0 }");
        let said = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        number(&said["C11"])
    };
    let whole = of("");
    assert_eq!(of("surface = \"directional\""), whole);
    assert_eq!(of("surface = \"energy\""), whole);
    let sum = |part: &dyn Fn(f64) -> f64| -> f64 {
        let mut sum = 0.0;
        for place in 0..343_i32 {
            let step = [place % 7 - 3, place / 7 % 7 - 3, place / 49 - 3];
            let square = f64::from(step.iter().map(|x| x * x).sum::<i32>());
            if square > 0.0 && square <= 9.0 {
                let (x, length) = (f64::from(step[0]), square.sqrt());
                sum += part(length) * x * x * x * x / (square * length);
            }
        }
        sum
    };
    let expected = sum(&|length| (3.5 - length).min(1.0)) / sum(&|_| 1.0);
    assert!(expected < 0.95, "{expected}");
    let found = of("volumes = \"partial\"") / whole;
    assert!((found / expected - 1.0).abs() < 1e-14, "{found} {expected}");
}
