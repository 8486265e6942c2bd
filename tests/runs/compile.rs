//! `piola compile`: what a C program gets that includes its header.

use std::path::Path;
use std::process::Command;

use crate::support::machine::has_c_compiler;
use crate::support::{piola, piola_with_input};

/// A program that evaluates a bond and a gradient with what was compiled.
const MAIN: &str = r#"
#include <stdio.h>
#include "javili2020.h"
#include "gent.h"
int main(void) {
  double l[] = {1.1, 0.7}, L[] = {1.0, 0.5}, e[2], psi[2], d1[2], d2[2];
  for (int i = 0; i < 2; i++) e[i] = (l[i] - L[i]) / L[i];
  javili2020_l(2, l, L, e, psi, d1, d2);
  for (int i = 0; i < 2; i++) printf("%.17g %.17g %.17g\n", psi[i], d1[i], d2[i]);
  double F[9] = {1.2, 0.1, 0, 0, 0.9, 0, 0, 0, 1.05}, H[9], P[9], energy[1];
  for (int k = 0; k < 9; k++) H[k] = F[k] - (k % 4 == 0);
  gent_F(1, F, H, energy, P);
  printf("%.17g", energy[0]);
  for (int k = 0; k < 9; k++) printf(" %.17g", P[k]);
  printf("\n%g %d\n", GENT_mu, JAVILI2020_DIMENSION);
  return 0;
}
"#;

fn numbers(text: &str) -> Vec<f64> {
    text.split([' ', ',', '\n'])
        .filter(|word| !word.is_empty())
        .map(|x| x.parse().unwrap())
        .collect()
}

/// What `piola eval` says, behind the columns that it was given.
fn evaluated(words: &[&str], table: &str, given: usize) -> Vec<f64> {
    let rest = ["--points", "-", "--level", "strict"];
    let found =
        piola_with_input(&[&["eval"], words, &rest[..]].concat(), table.as_bytes()).expect(0);
    let rows = found.stdout.lines().skip(1);
    rows.flat_map(|row| numbers(row)[given..].to_vec()).collect()
}

#[test]
fn a_c_program_has_the_numbers_of_the_strict_kernels() {
    if !has_c_compiler() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let bond = ["--set", "C1=2", "--set", "C2=0", "--set", "C3=0"];
    let rubber = ["--set", "mu=5e5", "--set", "Jm=30", "--set", "K=1e8"];
    piola(&[&["compile", "javili2020", "--out", out], &bond[..]].concat()).expect(0);
    let made = [&["compile", "gent", "--emit", "obj", "--out", out], &rubber[..]].concat();
    piola(&made).expect(0).says(&["gent.o", "gent.h"]);
    piola(&made).expect(2).says(&["gent.o` exists", "--force"]);
    piola(&[&made[..], &["--force"]].concat()).expect(0);
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("main.c"), MAIN).unwrap();
    let flags = [
        "-std=c99",
        "-O1",
        "-ffp-contract=off",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wno-unused-parameter",
        "-Wno-unused-function",
    ];
    let files = ["main.c", "javili2020.c", "gent.o"].map(at);
    let mut compiler = Command::new("cc");
    compiler.args(flags).args(files).arg("-lm").arg("-o").arg(at("main"));
    let linked = compiler.output().unwrap();
    assert!(linked.status.success(), "{}", String::from_utf8_lossy(&linked.stderr));
    let said = Command::new(at("main")).output().unwrap();
    let text = String::from_utf8(said.stdout).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[3], "500000 3");
    let expected = evaluated(
        &[&["javili2020", "--measure", "l"], &bond[..]].concat(),
        "l,L\n1.1,1\n0.7,0.5\n",
        2,
    );
    assert_eq!(numbers(&lines[..2].join("\n")), expected);
    let table = "F11,F12,F13,F21,F22,F23,F31,F32,F33\n1.2,0.1,0,0,0.9,0,0,0,1.05\n";
    let expected = evaluated(&[&["gent", "--measure", "F"], &rubber[..]].concat(), table, 9);
    let found = numbers(lines[2]);
    // The elementary functions of the C library differ from ours in their last digit.
    let size = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (x, y) in found.iter().zip(&expected) {
        assert!((x - y).abs() <= 1e-14 * size, "{x} {y}");
    }
}

#[test]
fn a_header_says_what_functions_of_gathered_values_take() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let values = ["--set", "K=1", "--set", "G=1"];
    piola(&[&["compile", "linear_peridynamic_solid", "--out", out], &values[..]].concat())
        .expect(0)
        .says(&["linear_peridynamic_solid.c"]);
    let header = folder.path().join("linear_peridynamic_solid.h");
    let header = std::fs::read_to_string(header).unwrap();
    for line in [
        "/* I1 is the sum of V_j f: integral(w*L^2) */\nvoid linear_peridynamic_solid_integrand_1(",
        " * variables: I1, I2 */\nvoid linear_peridynamic_solid_points(",
        " * variables: l, I1, I2; given: L, (l/L - 1) */\nvoid linear_peridynamic_solid_bonds(",
    ] {
        assert!(header.contains(line), "{line}\n{header}");
    }
}

#[test]
fn what_cannot_be_compiled_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new").display().to_string();
    let told = |words: &[&str], says: &str| {
        piola(&[&["compile", "--out", &out], words].concat()).expect(2).says(&[says]);
    };
    let nothing = folder.path().join("nothing.piola").display().to_string();
    std::fs::write(&nothing, "potential nothing\nparameter k = 0\npsi(l) = k*(l - L)^2\n").unwrap();
    told(&[&nothing], "leave no energy");
    told(&["gent"], "missing-parameter");
    told(&["gnt"], "did you mean `gent`");
    assert!(!Path::new(&out).exists());
}
