//! Two equal bars that meet, against the textbook.

use crate::examples;
use crate::support::{json_file, number, table};

/// The speed goes over from one bar to the other, they part, and what both have is kept.
#[test]
fn equal_bars_exchange_their_speeds() {
    let run = examples::run("impact", &[]);
    let (_, rows) = table(&run.path().join("probes.csv"));
    let speed = 10.0;
    let parted = rows.iter().find(|row| row[0] > 50e-6).unwrap();
    let last = rows.last().unwrap();
    let mean = |column: usize| (last[column] - parted[column]) / (last[0] - parted[0]);
    let (left, right) = (mean(1), mean(4));
    println!("left {left:.3} m/s, right {right:.3} m/s");
    // A twentieth of the energy swings in both.
    assert!((right / speed - 1.0).abs() < 0.05 && left.abs() < 0.05 * speed, "{left} {right}");
    assert!(last[4] - last[1] > 1e-4, "the bars are apart");
    let (header, motion) = table(&run.path().join("motion.csv"));
    let column = |name: &str| header.iter().position(|x| x == name).unwrap();
    let momentum = column("momentum_x");
    let (first, last) = (&motion[0], &motion[motion.len() - 1]);
    assert!((last[momentum] / first[momentum] - 1.0).abs() < 1e-12);
    assert!(last[column("stored")] < 0.05 * first[column("kinetic")]);
    let summary = json_file(&run.path().join("summary.json"));
    assert!(number(&summary["motion"]["rounding"]) < 1e-12);
}
