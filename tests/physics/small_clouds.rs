//! Energy, forces and tangent of small random clouds against 100-digit arithmetic
//! (cpd_small_clouds.json), through `piola energy` and the library's Seth-Hill energy.

use serde_json::Value;

use crate::support::{
    SceneFolder, dense_tangent, distance, energy_part, number, numbers, reference, to_csv,
};

/// Relative to the norm of each quantity; measured are 8.3e-15.
const TOLERANCE: f64 = 3.3e-14;

/// The cloud of a case as a scene; positions and volumes in `cloud.csv`.
fn scene(case: &Value) -> SceneFolder {
    let dimension = number(&case["D"]) as usize;
    let value = |key: &str| number(&case[key]);
    let third = if dimension == 3 { format!(", C3 = {:?}", value("C3")) } else { String::new() };
    let folder = SceneFolder::new(&format!(
        "[body]\n\
         dimension = {dimension}\n\
         points = \"cloud.csv\"\n\
         [horizon]\n\
         radius = {:?}\n\
         weights = \"truncated\"\n\
         [material]\n\
         potential = \"firooz2023\"\n\
         parameters = {{ C1 = {:?}, C2 = {:?}, n = {}{third} }}\n",
        value("delta"),
        value("C1"),
        value("C2"),
        value("n"),
    ));
    let positions = numbers(&case["X"]);
    let rows: Vec<f64> = positions
        .chunks_exact(dimension)
        .zip(numbers(&case["V"]))
        .flat_map(|(position, volume)| position.iter().copied().chain([volume]))
        .collect();
    folder.file("cloud.csv", to_csv(["x,y,volume", "x,y,z,volume"][dimension - 2], &rows));
    folder
}

fn displacement(case: &Value) -> String {
    let (rest, now) = (numbers(&case["X"]), numbers(&case["x"]));
    let u: Vec<f64> = now.iter().zip(&rest).map(|(x, rest)| x - rest).collect();
    to_csv(["u,v", "u,v,w"][number(&case["D"]) as usize - 2], &u)
}

#[test]
fn energy_gradient_and_tangent_agree() {
    let clouds = reference("cpd_small_clouds.json");
    let cases = clouds["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 7);
    for case in cases {
        let name = case["name"].as_str().unwrap();
        let found = scene(case).energy(&displacement(case), &[]).json();
        for (k, kind) in ["bonds", "triangles", "tetrahedra"].into_iter().enumerate() {
            let key = (k + 1).to_string();
            let expected = case["ncliques"][&key].as_u64().unwrap_or(0);
            assert_eq!(found["interactions"][kind].as_u64(), Some(expected), "{name} {kind}");
            let expected = case["energy_parts"][&key].as_f64().unwrap_or(0.0);
            let part = energy_part(&found, ["psi(l)", "psi(a)", "psi(v)"][k]);
            assert!((part - expected).abs() <= TOLERANCE * expected, "{name} {kind}: {part:e}");
        }
        let energy = number(&found["energy"]) / number(&case["energy"]) - 1.0;
        let gradient = distance(&numbers(&found["gradient"]), &numbers(&case["gradient"]));
        let tangent = distance(&dense_tangent(&found), &numbers(&case["hessian_rowmajor"]));
        println!("{name}: energy {energy:.1e}, gradient {gradient:.1e}, tangent {tangent:.1e}");
        for (quantity, error) in [("energy", energy), ("gradient", gradient), ("tangent", tangent)]
        {
            assert!(error.abs() <= TOLERANCE, "{name}: {quantity} {error:e}");
        }
    }
}

#[test]
fn every_source_of_derivatives_agrees_with_the_reference() {
    for case in reference("cpd_small_clouds.json")["cases"].as_array().unwrap() {
        let folder = scene(case);
        let hessian = numbers(&case["hessian_rowmajor"]);
        for source in ["interpreter", "hyperdual", "hyperdual-coordinates"] {
            let setting = format!("solver.derivatives={source}");
            let found = folder.energy(&displacement(case), &["--set", &setting]).json();
            let error = distance(&dense_tangent(&found), &hessian);
            println!("{} {source}: {error:.1e}", case["name"]);
            assert!(error <= TOLERANCE, "{} {source}: {error:e}", case["name"]);
        }
    }
}
