//! Energies add up: all kinds in one potential, and potentials beside each other, against each of them
//! alone.

use serde_json::Value;

use crate::examples;
use crate::support::{
    Random, SceneFolder, dense_tangent, distance, energy_part, norm, number, numbers, piola, to_csv,
};

const HEAD: &str = "allow \"no-bond-energy\" \"a part of a sum\"\n\
    allow \"not-stiff-at-rest\" \"a part of a sum\"\n\
    theta = integral(l/L - 1)/integral(1)\n";

/// Names of energies, and statements that are one potential or several.
const ENERGIES: [(&str, &str); 6] = [
    ("psi(l)", "psi(l) = 1/2*2*L*(l/L - 1)^2\n"),
    ("psi(a)", "psi(a) = 1/2*30*A*(a/A - 1)^2\n"),
    ("psi(v)", "psi(v) = 1/2*40*V*(v/V - 1)^2\n"),
    ("psi(F)", "psi(F) = 1/2*(tr(C) - 3 - 2*ln(J)) + 1/2*(J - 1)^2\n"),
    ("psi(theta)", "psi(theta) = 3*theta^2\n"),
    ("psi(l, theta)", "psi(l, theta) = 1/2*(l - L)^2*(1 + theta)\n"),
];

/// A cube of 4^3 points.
fn scene(potentials: &[&str], more: &str) -> SceneFolder {
    let mut materials = String::new();
    for (number, _) in potentials.iter().enumerate() {
        let title = if number == 0 { "[material]" } else { "[[material.plus]]" };
        materials += &format!("{title}\npotential = \"p{number}.piola\"\n");
    }
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [0.4, 0.4, 0.4]]\nspacing = 0.1\n\
         [horizon]\nspacings = 2\nweights = \"volumes\"\n{materials}{more}"
    ));
    for (number, statements) in potentials.iter().enumerate() {
        let text = format!("potential p{number}\ndimensions 3\n{HEAD}{statements}");
        folder.file(&format!("p{number}.piola"), text);
    }
    folder
}

const N: usize = 64;

fn displacement() -> String {
    to_csv("u,v,w", &Random(5).vector(3 * N).iter().map(|x| 0.004 * x).collect::<Vec<f64>>())
}

/// Energy, forces and the whole tangent.
fn evaluated(folder: &SceneFolder) -> (Value, Vec<f64>, Vec<f64>) {
    let found = folder.energy(&displacement(), &[]).json();
    let forces: Vec<f64> = found["gradient"].as_array().unwrap().iter().flat_map(numbers).collect();
    let tangent = dense_tangent(&found);
    (found, forces, tangent)
}

/// Every energy stands on its own, sees the same displacements and adds to the others' forces and
/// tangents, which reach one to three horizons.
#[test]
fn all_kinds_of_energies_add_up_in_one_potential_and_beside_each_other() {
    let statements = ENERGIES.map(|(_, text)| text);
    let (one, forces, tangent) = evaluated(&scene(&[&statements.concat()], ""));
    let (several, other_forces, other_tangent) = evaluated(&scene(&statements, ""));
    let mut sums = (0.0, vec![0.0; 3 * N], vec![0.0; 9 * N * N]);
    for (number, (name, text)) in ENERGIES.into_iter().enumerate() {
        let (alone, forces, tangent) = evaluated(&scene(&[text], ""));
        let energy = number_of(&alone);
        assert!(energy != 0.0 && norm(&forces) > 0.0, "{name}");
        // Each is what it is alone, to the last bit.
        assert_eq!(energy_part(&one, name), energy, "{name}");
        assert_eq!(energy_part(&several, &format!("p{number}: {name}")), energy, "{name}");
        sums.0 += energy;
        sums.1.iter_mut().zip(&forces).for_each(|(sum, x)| *sum += x);
        sums.2.iter_mut().zip(&tangent).for_each(|(sum, x)| *sum += x);
    }
    for (found, forces, tangent) in
        [(&one, &forces, &tangent), (&several, &other_forces, &other_tangent)]
    {
        assert!((number_of(found) / sums.0 - 1.0).abs() < 1e-15);
        assert!(distance(forces, &sums.1) < 1e-15, "{:e}", distance(forces, &sums.1));
        assert!(distance(tangent, &sums.2) < 1e-15, "{:e}", distance(tangent, &sums.2));
    }
}

fn number_of(found: &Value) -> f64 {
    number(&found["energy"])
}

const PULLED: &str = "[sets]\nleft = \"X < 0.1\"\nright = \"X > 0.3\"\n\
    [[prescribe]]\nset = \"left\"\nu = [0, 0, 0]\n\
    [[prescribe]]\nset = \"right\"\nu = [\"0.04*t\", \"free\", \"free\"]\n";

/// A run of the sum, without a stored tangent and with one: the same equilibrium, and a column for
/// each part.
#[test]
fn a_sum_runs_with_and_without_a_stored_tangent() {
    let statements = ENERGIES.map(|(_, text)| text).concat();
    let mut reactions = Vec::new();
    for linear in ["auto", "cholesky", "gmres"] {
        let folder = scene(&[&statements], PULLED);
        folder.run(&["--set", &format!("solver.linear={linear}")]).expect(0);
        let summary = folder.summary();
        let last = summary["steps"].as_array().unwrap().last().unwrap();
        reactions.push(numbers(&last["reactions"]["right"])[0]);
        let energy = std::fs::read_to_string(folder.out().join("energy.csv")).unwrap();
        let header = "t,total,psi(l),psi(a),psi(v),psi(theta),\"psi(l, theta)\",psi(F)";
        assert_eq!(energy.lines().next(), Some(header));
        assert!(number(&summary["interactions"]["tetrahedra"]) > 0.0);
    }
    assert!(reactions[0] > 0.0);
    let error = reactions.iter().map(|x| (x / reactions[0] - 1.0).abs()).fold(0.0, f64::max);
    assert!(error < 1e-9, "{reactions:?}");
}

/// psi(F) at the points has no stiffness against displacements that alternate; soft bonds beside it have,
/// and the reaction is that of psi(F) at the bonds, which is stiff against them by itself.
#[test]
fn soft_bonds_hold_what_deformation_gradients_of_points_do_not_see() {
    let reaction = |overrides: &[&str]| {
        let run = examples::run("bonds_beside_F", &[&["steps.increments=1"], overrides].concat());
        numbers(&run.steps()[0]["reactions"]["right"])[0]
    };
    let beside = reaction(&[]);
    let alone = ["material.plus=[]", "correspondence.discretisation=bond-quadrature"];
    let at_bonds = reaction(&alone);
    println!("{beside} {at_bonds}");
    assert!((beside / at_bonds - 1.0).abs() < 0.02, "{beside} {at_bonds}");
}

/// Moduli of a sum are sums of moduli, and a plan names all of its energies.
#[test]
fn moduli_and_plans_know_all_energies() {
    let stiffness = |folder: &SceneFolder| {
        let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        found["voigt"].as_array().unwrap().iter().flat_map(numbers).collect::<Vec<f64>>()
    };
    let statements = ENERGIES.map(|(_, text)| text);
    let folder = scene(&statements, PULLED);
    let mut sum = vec![0.0; 36];
    for text in statements {
        let alone = stiffness(&scene(&[text], ""));
        sum.iter_mut().zip(alone).for_each(|(sum, x)| *sum += x);
    }
    assert!(distance(&stiffness(&folder), &sum) < 1e-13);
    let plan = piola(&["plan", &folder.scene(), "--format", "json"]).expect(0).json();
    let kernels: Vec<&str> =
        plan["kernels"].as_array().unwrap().iter().map(|k| k["energy"].as_str().unwrap()).collect();
    let expected: Vec<String> =
        ENERGIES.iter().enumerate().map(|(k, (name, _))| format!("p{k}: {name}")).collect();
    assert_eq!(kernels, expected);
    assert_eq!(plan["linear"], "matrix-free");
}

/// Families sum over volumes, and so do interactions beside them unless the scene says otherwise.
#[test]
fn interactions_beside_families_weigh_volumes_by_default() {
    let energy = |folder: &SceneFolder, weights: &[&str]| {
        let found = folder.energy(&displacement(), weights).json();
        energy_part(&found, "psi(l)")
    };
    let both = [ENERGIES[0].1, ENERGIES[4].1].concat();
    let stated = scene(&[&both], "");
    let text = std::fs::read_to_string(stated.scene()).unwrap();
    let silent = scene(&[&both], "");
    silent.file("scene.toml", text.replace("weights = \"volumes\"\n", ""));
    assert_eq!(energy(&silent, &[]), energy(&stated, &[]));
    let uniform = energy(&silent, &["--set", "horizon.weights=uniform"]);
    assert!((uniform / energy(&stated, &[]) - 1.0).abs() > 0.01, "{uniform}");
}

/// A sheet in plane stress takes psi(F) of a solid; what else there is stands in another potential.
#[test]
fn plane_stress_takes_its_energy_from_a_potential_of_its_own() {
    let of = |first: &str, plus: &str| {
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [[0, 0], [0.6, 0.4]]\nspacing = 0.1\n[horizon]\nspacings = 2\n\
             [correspondence]\nplane = \"stress\"\n[material]\npotential = \"first.piola\"\n{plus}"
        ));
        let solid = "psi(F) = 1/2*(tr(C) - 3 - 2*ln(J)) + (J - 1)^2\n";
        folder.file("first.piola", format!("potential first\n{solid}{first}"));
        folder.file("plane.piola", "potential plane\npsi(l) = (l - L)^2/L\n");
        folder
    };
    let bonds = "psi(l) = (l - L)^2/L\n";
    let refused = of(bonds, "");
    piola(&["check", &refused.scene()]).expect(1).says(&[
        "conflicting-keys",
        "it has psi(F) and psi(l)",
        "[[material.plus]]",
    ]);
    let taken = of("", "[[material.plus]]\npotential = \"plane.piola\"\n");
    let stiffness = |folder: &SceneFolder| {
        let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        numbers(&found["voigt"][0])[0]
    };
    assert!(stiffness(&taken) > stiffness(&of("", "")));
}

/// Of several potentials the one is named whose text, parameters or energies are wrong.
#[test]
fn mistakes_are_found_in_the_potential_that_has_them() {
    let folder = scene(&[ENERGIES[0].1, "psi(l) = k*(l - L)^2\n"], "");
    piola(&["check", &folder.scene()]).expect(1).says(&["p1.piola", "unknown name `k`"]);
    let folder = scene(&[ENERGIES[0].1, "parameter k, k > 0\npsi(l) = k*(l - L)^2\n"], "");
    piola(&["check", &folder.scene()]).expect(1).says(&["`k`", "scene.toml"]);
    let set = |value: &str| {
        piola(&[
            "energy",
            &folder.scene(),
            "--set",
            &format!("material.plus.0.parameters.k={value}"),
        ])
    };
    set("-1").expect(2).says(&["k > 0"]);
    set("1").expect(0);
    let folder = scene(&[ENERGIES[0].1, "psi(l) = 1/(l/L - 1)^2\n"], "");
    piola(&["energy", &folder.scene()]).expect(2).says(&["1/(l/L - 1)^2 is inf"]);
    let folder = scene(&["psi(a) = (a - A)^2\n", "psi(v) = (v - V)^2\n"], "");
    folder.file("p0.piola", "potential p0\npsi(a) = (a - A)^2\n");
    piola(&["energy", &folder.scene()]).expect(2).says(&["no-bond-energy", "p0.piola"]);
}
