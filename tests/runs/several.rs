//! Tools that look at a file alone, `eval`, `audit`, `bench` and `derive`, with energies of several measures and of
//! what points gather.

use crate::support::{SceneFolder, number, piola, piola_with_input};

const SOLID: [&str; 5] = ["linear_peridynamic_solid", "--set", "K=3", "--set", "G=1"];

/// Rows of `piola eval`, each as long as its header.
fn evaluated(words: &[&str], table: &str) -> Vec<Vec<f64>> {
    let found =
        piola_with_input(&[&["eval"], words, &["--points", "-"]].concat(), table.as_bytes());
    let row = |line: &str| line.split(',').map(|x| x.parse().unwrap()).collect();
    found.expect(0).stdout.lines().skip(1).map(row).collect()
}

fn agrees(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (x, y) in found.iter().zip(expected) {
        assert!((x - y).abs() <= 1e-14 * y.abs(), "{found:?} for {expected:?}");
    }
}

#[test]
fn energies_of_points_and_bonds_are_evaluated_in_every_way() {
    for mode in ["jit", "interpreter", "hyperdual"] {
        let of = |measure, table| {
            let words =
                [&SOLID[..], &["--measure", measure, "--delta", "2", "--mode", mode]].concat();
            evaluated(&words, table).swap_remove(0)
        };
        // theta = 3*I2/I1, psi = (K - 5/3 G)/2 theta^2.
        let (k, theta) = (3.0 - 5.0 / 3.0, 0.75);
        let points = of("points", "I1,I2\n2,0.5\n");
        let by_first = -k * theta * theta / 2.0;
        agrees(&points, &[2.0, 0.5, k / 2.0 * theta * theta, by_first, k * theta * 1.5]);
        // 15 G/m*(delta/L)*(l - L)^2
        let bonds = of("bonds", "l,L,I1,I2\n1.25,1,2,0.5\n");
        let psi = 15.0 * 0.0625;
        agrees(&bonds, &[1.25, 1.0, 2.0, 0.5, psi, 15.0 * 0.5, -psi / 2.0, 0.0]);
    }
    let words = ["--measure", "bonds", "--delta", "2", "--points", "-"];
    let table = b"l,L,I1,I2\n1,1,2,0.5\n1,-1,2,0.5\n";
    piola_with_input(&[&["eval"], &SOLID[..], &words].concat(), table)
        .expect(2)
        .says(&["a reference measure is finite and > 0, not -1", "-:3:"]);
    let told = [&["eval"], &SOLID[..], &["--measure", "triangles", "--points", "-"]].concat();
    piola_with_input(&told, b"a\n").expect(2).says(&[
        "no energy of triangles, of several measures",
        "use --measure points or --measure bonds",
    ]);
}

#[test]
fn energies_of_triangles_and_of_vectors_are_evaluated() {
    let folder = SceneFolder::new("");
    let law = folder.file("law.piola", "potential law\npsi(a, l1) = a*(l1 - L1)^2 + (a - A)^2\n");
    let words = [&*law, "--measure", "triangles", "--dim", "2"];
    let found = evaluated(&words, "a,l1,l2,l3,A,L1,L2,L3\n2,1.5,1,1,1,1,1,1\n");
    let header = piola_with_input(&[&["eval"], &words[..], &["--points", "-"]].concat(), b"a\n");
    assert!(header.expect(2).stderr.contains("a,l1,l2,l3,A,L1,L2,L3"));
    // The mean over the orders of the corners: each side has a third.
    let psi = 2.0 * 0.25 / 3.0 + 1.0;
    let expected = [psi, 0.25 / 3.0 + 2.0, 2.0 / 3.0, 0.0, 0.0];
    for (x, y) in found[0][8..].iter().zip(expected) {
        assert!((x - y).abs() <= 1e-14, "{found:?}");
    }
    let text =
        "potential law\nw = xi - Xi\ns = w*Xi/L\npsi(xi) = (3*s^2 + 2*(w*w) + (l - L)^2)/L\n";
    let law = folder.file("vector.piola", text);
    let found = evaluated(&[&law, "--measure", "xi", "--dim", "2"], "Xi1,Xi2,u1,u2\n2,0,1,4\n");
    // xi = (3, 4), l = 5, L = 2; s = 1, w.w = 17.
    let expected = [(3.0 + 34.0 + 9.0) / 2.0, (6.0 + 4.0 + 3.6) / 2.0, (16.0 + 4.8) / 2.0];
    agrees(&found[0][4..], &expected);
    let text = "potential law\nM = integral(xi - Xi)\npsi(M) = M*M/2\npsi(xi, M) = (xi - Xi)*(M + neighbour(M))\n";
    let law = folder.file("vectors.piola", text);
    let of = |measure, table| {
        evaluated(&[&law, "--measure", measure, "--dim", "2"], table).swap_remove(0)
    };
    agrees(&of("points", "I1,I2\n3,4\n"), &[3.0, 4.0, 12.5, 3.0, 4.0]);
    let bond = "Xi1,Xi2,u1,u2,I1,I2,neighbour_I1,neighbour_I2\n1,0,0.5,0.25,1,2,3,4\n";
    let found = of("bonds", bond);
    agrees(&found[8..], &[3.5, 4.0, 6.0, 0.5, 0.25, 0.5, 0.25]);
}

#[test]
fn energies_of_several_numbers_are_audited() {
    for (law, titles) in [
        ("linear_peridynamic_solid", &["psi(theta)", "psi(l, m)"][..]),
        ("harmonic_angles", &["psi(l)", "psi(angle)"]),
        ("silling.piola", &["integral(..)", "H", "psi(H)", "psi(xi, H, w0)"]),
    ] {
        let own = crate::support::repository("examples/correspondence_as_text").join(law);
        let file = if law.contains('.') { own.display().to_string() } else { law.to_string() };
        let words = ["audit", &file, "--dim", "2", "--points", "1", "--format", "json"];
        let lines = piola(&words).expect(0).stdout;
        let audits: Vec<serde_json::Value> =
            lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let found: Vec<&str> =
            audits.iter().map(|audit| audit["subject"].as_str().unwrap()).collect();
        assert_eq!(found, titles);
        for audit in &audits {
            let regimes = audit["regimes"].as_array().unwrap();
            assert!(regimes.len() >= 14 && audit["passed"] == true, "{law}");
        }
    }
    // Equal numbers are subtracted: one third of the digits is gone, and where is said.
    let folder = SceneFolder::new("");
    let text = "potential lossy\ns = integral(l)\npsi(s) = (s^2 - 2.6*s + 1.69)*exp(-s)\n\
                psi(l1, l2, l3) = (l1*l2/(L1*L2) - l3/L3)^2\n";
    let lossy = folder.file("lossy.piola", text);
    let told = piola(&["audit", &lossy, "--dim", "2", "--points", "2"]).expect(1).stdout;
    for part in ["missed: psi at l1 over rest, less 1 = ", "l3 at rest = "] {
        assert!(told.contains(part), "{part}\n{told}");
    }
    // And by what.
    let text = "potential lossy\ns = integral((l/L)^2)\npsi(s) = (s - 3)^2 - 9 + 6*s\n\
                psi(l1, l2) = (l1/L1 - l2/L2)^2\n";
    let lossy = folder.file("lossy.piola", text);
    let told = piola(&["derive", &lossy, "--dim", "2", "--explain"]).expect(0).stdout;
    for part in ["psi(s) is off by ", " at I1 = ", "digits cancel in `(s - 3)^2 - 9 + 6*s`"] {
        assert!(told.contains(part), "{part}\n{told}");
    }
    let told = piola(&["derive", SOLID[0], "--explain"]).expect(0).stdout;
    assert!(told.contains("nothing is lost: psi, its gradient and what"), "{told}");
}

/// Conditions and next states of what points gather are audited, too.
#[test]
fn margins_and_next_states_of_points_are_audited() {
    let folder = SceneFolder::new("");
    let text = "potential p\nstate p = 0\nm = integral(L^2)\ntheta = 3/m*integral(L*(l - L))\n\
                update p = max(p, theta)\npsi(theta) = (1 - p)*theta^2\nbreak when theta > 1/8\n";
    let law = folder.file("law.piola", text);
    let told = piola(&["audit", &law, "--points", "3"]).expect(0).stdout;
    for part in ["psi(theta): largest", "break when theta > 1/8: ", "update p = max(p, theta): "] {
        assert!(told.contains(part), "{part}\n{told}");
    }
}

#[test]
fn energies_of_several_numbers_are_timed() {
    let words = [&["bench"], &SOLID[..], &["--dim", "2"]].concat();
    let found = piola(&[&words[..], &["--format", "json"]].concat()).expect(0).json();
    let ways = found["ways"].as_array().unwrap();
    for way in ways.iter().filter(|way| way["way"] != "hyper-dual coordinates") {
        let several = way["several"].as_array().unwrap();
        let functions: Vec<&str> =
            several.iter().map(|one| one["function"].as_str().unwrap()).collect();
        assert_eq!(functions, ["integrands", "energy of points", "energy of bonds"]);
        for one in several {
            for order in ["energy", "gradient", "product"] {
                assert!(number(&one["nanoseconds"][order]) > 0.0, "{one}");
            }
        }
    }
    let text = piola(&words).expect(0).stdout;
    assert!(text.contains("energy of points ") && text.contains("of several numbers: "), "{text}");
}

#[test]
fn derivatives_of_what_points_gather_are_printed() {
    let text = piola(&["derive", SOLID[0], "--dim", "2"]).expect(0).stdout;
    for line in ["# I2 = integral(w*(l - L)*L)", "f2'(l) = ", "psi(theta) = ", "dpsi/dI2 = "] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    for (emit, part) in [
        ("latex", r"\partial \psi/\partial I_{2} &= "),
        ("graph", "dpsi/dI1 = %"),
        ("c", "void linear_peridynamic_solid_points_product("),
        ("clif", "function u0:0"),
        ("asm", "ret"),
    ] {
        let text = piola(&["derive", SOLID[0], "--emit", emit]).expect(0).stdout;
        assert!(text.contains(part), "{part}\n{text}");
    }
}
