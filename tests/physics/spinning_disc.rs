//! A disc that spins freely, against the textbook.

use crate::examples;
use crate::support::{json_file, number, table};

/// The rim swings about the radius at which a thin disc would spin (Timoshenko and Goodier, section 32), from
/// rest to twice the stretch; momenta and the account of energy are kept.
#[test]
fn the_rim_swings_about_the_radius_of_the_textbook() {
    let run = examples::run("spinning_disc", &[]);
    let (_, rows) = table(&run.path().join("probes.csv"));
    let (x, radius) = (0.048, 0.05);
    let stretch: Vec<f64> = rows.iter().map(|row| libm::hypot(x + row[1], row[2]) - x).collect();
    let (modulus, nu, density, omega) = (210e9, 0.3, 7800.0, 5236.0);
    let known = (1.0 - nu) * density * omega * omega * x / (8.0 * modulus)
        * ((3.0 + nu) * radius * radius - (1.0 + nu) * x * x);
    let mean = stretch.iter().fold(0.0, |sum, u| sum + u) / stretch.len() as f64;
    let largest = stretch.iter().fold(0.0_f64, |most, u| most.max(*u));
    println!("mean {:e}, largest {:e} of {known:e}", mean / known - 1.0, largest / known);
    assert!((mean / known - 1.0).abs() < 0.03, "{mean:e} {known:e}");
    assert!((largest / known - 2.0).abs() < 0.1, "{largest:e} {known:e}");
    let (header, motion) = table(&run.path().join("motion.csv"));
    let column = |name: &str| header.iter().position(|x| x == name).unwrap();
    let spins = column("angular_momentum_z");
    let (first, last) = (&motion[0], &motion[motion.len() - 1]);
    assert!((last[spins] / first[spins] - 1.0).abs() < 1e-12);
    let summary = json_file(&run.path().join("summary.json"));
    assert!(number(&summary["motion"]["rounding"]) < 1e-12);
}
