//! Scenes of several materials from outside: a laminate, moduli one by one, and what is refused.

use crate::support::{SceneFolder, piola};

/// A bar of two materials in a row, the left one ten times as stiff.
fn laminate(spacing: f64, further: &str) -> String {
    format!(
        "[body]\nbox = [[0, 0], [2, 0.25]]\nspacing = {spacing}\n[horizon]\nspacings = 2\n\
         [[material]]\nset = \"stiff\"\npotential = \"neo_hooke\"\n\
         parameters = {{ mu = \"10 MPa\", lambda = \"0 Pa\" }}\n\
         [[material]]\nname = \"soft\"\npotential = \"neo_hooke\"\n\
         parameters = {{ mu = \"1 MPa\", lambda = \"0 Pa\" }}\n{further}\
         [sets]\nstiff = \"X < 1\"\nleft = \"X < {spacing}\"\nright = \"X > 2 - {spacing}\"\n\
         [[prescribe]]\nset = \"left\"\nu = [0, 0]\n\
         [[prescribe]]\nset = \"right\"\nu = [\"2e-6*t\", 0]\n\
         [[probe]]\nname = \"middle\"\nat = [0.999, 0.125]\n[steps]\nincrements = 1\n"
    )
}

/// Springs in series: the soft half takes ten elevenths of the elongation. Points of the first row of a
/// half stand half a spacing from where it begins.
#[test]
fn two_materials_in_a_row_share_an_elongation_as_springs_in_series() {
    let error = |spacing: f64| {
        let folder = SceneFolder::new(&laminate(spacing, ""));
        folder.run(&[]).expect(0);
        let table = std::fs::read_to_string(folder.out().join("probes.csv")).unwrap();
        let last: Vec<f64> =
            table.lines().last().unwrap().split(',').map(|x| x.parse().unwrap()).collect();
        // In local elasticity: strains of 1 and 10 parts of the elongation of the free length.
        let strain = 2e-6 / (10.0 * (1.0 - 0.5 * spacing) + (1.0 - 0.5 * spacing));
        let expected = strain * (1.0 - spacing);
        (last[1] / expected - 1.0).abs()
    };
    let (coarse, fine) = (error(0.0625), error(0.03125));
    println!("{coarse:.3} {fine:.3}");
    assert!(coarse < 0.3 && fine < 0.6 * coarse, "{coarse} {fine}");
}

/// Two integrals, the other way round in the other material, also where a parameter makes them alike: the
/// energy of a body of both is that of the body of one.
#[test]
fn integrals_of_two_materials_are_told_apart() {
    let law = |s: &str, r: &str, energies: [&str; 2]| {
        format!(
            "potential p\nparameter q = 1\ns = integral({s})\nr = integral({r})\n\
             psi(s) = {}\npsi(r) = {}\npsi(l) = L*(l/L - 1)^2\n",
            energies[0], energies[1]
        )
    };
    let scene = |materials: &str| {
        format!(
            "[body]\nbox = [[0, 0], [1, 0.5]]\nspacing = 0.125\n[horizon]\nspacings = 2\n{materials}\
             [sets]\nleft = \"X < 0.5\"\n"
        )
    };
    let one = "[material]\npotential = \"a.piola\"\n";
    let two = "[[material]]\nset = \"left\"\npotential = \"a.piola\"\n\
               [[material]]\npotential = \"b.piola\"\n";
    let places = (0..32).map(|k| (f64::from(k / 4) / 8.0, f64::from(k % 4) / 8.0));
    let displacement: String =
        places.map(|(x, y)| format!("{},{}\n", 0.01 * x + 0.02 * y * y, 0.03 * x * y)).collect();
    for other in ["L^q*(l - L)", "L^3*(l - L)"] {
        let energy = |materials: &str| {
            let folder = SceneFolder::new(&scene(materials));
            folder.file("a.piola", law("L*(l - L)", other, ["s^2", "3*r^2"]));
            folder.file("b.piola", law(other, "L*(l - L)", ["3*s^2", "r^2"]));
            let table = folder.file("u.csv", format!("u,v\n{displacement}"));
            let given = ["energy", &folder.scene(), "--displacement", &table];
            piola(&given).expect(0).json()["energy"].as_f64().unwrap()
        };
        let (alone, both) = (energy(one), energy(two));
        assert!(alone > 0.0 && (both / alone - 1.0).abs() < 1e-14, "{other}: {alone} {both}");
    }
}

#[test]
fn moduli_are_those_of_each_material() {
    let folder = SceneFolder::new(&laminate(0.125, ""));
    let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
    for (name, mu) in [("stiff", 1e7), ("soft", 1e6)] {
        let c44 = found["materials"][name]["C44"].as_f64().unwrap();
        assert!((c44 / mu - 1.0).abs() < 1e-12, "{name}: {c44}");
    }
    let soft = ["moduli", &folder.scene(), "--material", "soft"];
    let shown = piola(&soft).expect(0).stdout;
    assert!(shown.contains("material `soft`") && !shown.contains("stiff`"), "{shown}");
    piola(&["moduli", &folder.scene(), "--material", "sotf"])
        .expect(2)
        .says(&["there is no material `sotf`", "the materials are stiff, soft"]);
    let calibrate = ["calibrate", &folder.scene(), "--target", "mu=3e6", "--vary", "mu"];
    piola(&calibrate).expect(2).says(&["several materials", "--material stiff or --material soft"]);
    let one = [&calibrate[..], &["--material", "soft"]].concat();
    let text = piola(&one).expect(0).stdout;
    assert!(text.contains("mu = 3000000.0") || text.contains("mu = 2999999.99"), "{text}");
}

#[test]
fn what_is_wrong_with_materials_is_said_at_its_place() {
    let interface = |text: &str| laminate(0.125, &format!("[[interface]]\n{text}\n"));
    let plain = laminate(0.125, "");
    let wrong = [
        (
            interface("between = [\"stiff\", \"sfot\"]\nrule = \"mean\""),
            "[unknown-material]",
            "did you mean `soft`?",
        ),
        (
            interface("between = [\"stiff\", \"stiff\"]\nrule = \"mean\""),
            "[out-of-range]",
            "two different materials",
        ),
        (
            interface("between = [\"stiff\", \"soft\"]\nrule = \"harmonic\""),
            "[unknown-choice]",
            "a `potential` in place of the rule",
        ),
        (interface("between = [\"stiff\", \"soft\"]\nrule = \"as\""), "[missing-key]", "`as`"),
        (
            interface(
                "between = [\"stiff\", \"soft\"]\nrule = \"mean\"\npotential = \"neo_hooke\"",
            ),
            "[conflicting-keys]",
            "one rule",
        ),
        (interface("between = [\"stiff\"]\nrule = \"mean\""), "[wrong-type]", "two materials"),
        (
            plain.replace("name = \"soft\"", "name = \"stiff\""),
            "[duplicate-material]",
            "the first stands here",
        ),
        (
            plain.replace("name = \"soft\"", "set = \"right\""),
            "[no-material]",
            "points are of no material",
        ),
        (
            plain.replace("name = \"soft\"", "set = \"left\""),
            "[two-materials]",
            "is of `stiff` and of `left`",
        ),
        (
            plain.replace("stiff = \"X < 1\"", "stiff = \"X < 9\""),
            "[empty-set]",
            "no point is left",
        ),
        (
            plain.replace("mu = \"1 MPa\"", "mu = \"-1 MPa\""),
            "[constraint-violated]",
            "breaks `mu > 0`",
        ),
    ];
    for (scene, code, text) in wrong {
        let folder = SceneFolder::new(&scene);
        piola(&["plan", &folder.scene()]).expect(2).says(&[code, text]);
    }
    let both = plain.replacen("[[material]]", "[material]", 2);
    let both =
        both.replacen("[material]\nname", "[[interface]]\nbetween = [\"a\", \"b\"]\nname", 1);
    let folder = SceneFolder::new(&both);
    piola(&["plan", &folder.scene()]).expect(2).says(&["[conflicting-keys]", "[[material]]"]);
}
