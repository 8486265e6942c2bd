//! Potentials whose points gather tensors, through the program: a plate that breaks and moduli as those of
//! deformation gradients, steps of two materials, and what is refused.

use crate::support::{SceneFolder, numbers, piola, repository, table};

const LAW: &str = "parameter lambda in Pa\nparameter mu in Pa, mu > 0\nparameter s0 = 0.002\n";
const ENERGY: &str = "lambda/2*tr(E)^2 + mu*(E : E)\nbreak when l/L - 1 > s0\n";

/// A plate of a material with a crack, whose law is the built-in discretisation or the text of it.
fn plate(is_text: bool, driven: &str) -> SceneFolder {
    let (potential, keys) = match is_text {
        true => ("text.piola", ""),
        false => ("gradient.piola", "[correspondence]\ninfluence = \"1/L\"\n"),
    };
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [[0.0, 0.0], [0.1, 0.04]]\nspacing = 2e-3\n[horizon]\nspacings = 3.015\n\
         [material]\npotential = \"{potential}\"\ndensity = \"2440 kg/m^3\"\n\
         parameters = {{ lambda = \"24 GPa\", mu = \"24 GPa\" }}\n{keys}\
         [sets]\nlower = \"Y < 2e-3\"\nupper = \"Y > 0.038\"\n\
         [[crack]]\nsegment = [[-0.01, 0.02], [0.05, 0.02]]\n\
         [fracture]\nunbreakable = [\"lower\", \"upper\"]\n{driven}"
    ));
    let own = std::fs::read_to_string(
        repository("examples/correspondence_as_text").join("bond_quadrature.piola"),
    );
    let own = own.unwrap().replace("psi(xi, H, w0)", "parameter s0 = 0.002\npsi(xi, H, w0)");
    folder.file("text.piola", own + "break when l/L - 1 > s0\n");
    folder.file("gradient.piola", format!("potential gradient\n{LAW}psi(F) = {ENERGY}"));
    folder
}

/// Both break the same bonds, and have the same account of energy.
#[test]
fn a_plate_breaks_by_its_text_as_by_the_built_in_discretisation() {
    let driven = "[[load]]\nset = \"lower\"\ndensity = [0, -8e9]\n[[load]]\nset = \"upper\"\n\
                  density = [0, 8e9]\n[motion]\nend = \"25 us\"\n[output]\nframes = 1\n";
    let [text, gradient] = [true, false].map(|is_text| {
        let folder = plate(is_text, driven);
        folder.run(&[]).expect(0);
        table(&folder.out().join("motion.csv"))
    });
    assert_eq!((text.0.len(), text.1.len()), (gradient.0.len(), gradient.1.len()));
    let broken = text.0.iter().position(|name| *name == "broken_bonds").unwrap();
    let most = |rows: &[Vec<f64>]| rows.last().unwrap()[broken];
    assert!(most(&text.1) > most(&text.1[..1]) + 10.0, "{}", most(&text.1));
    // Energies to 1e-10 of the largest: errors of forces grow over 50 steps.
    let largest = text.1.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (text, gradient) in text.1.iter().flatten().zip(gradient.1.iter().flatten()) {
        assert!((text - gradient).abs() <= 1e-10 * largest, "{text} {gradient}");
    }
}

/// Moduli of the lattice are those of the energy of F, in every text.
#[test]
fn moduli_of_texts_are_those_of_the_gradient() {
    for file in ["nodal", "nodal_with_constant", "silling", "wan", "isotropic", "bond_quadrature"] {
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [[0.0, 0.0], [20.0, 20.0]]\nspacing = 1.0\nthickness = 0.3\n\
             [horizon]\nspacings = 3\n[material]\npotential = \"{file}.piola\"\n\
             parameters = {{ lambda = 3.0, mu = 2.0{} }}\n",
            if file == "silling" { ", Cs = 7.0" } else { "" }
        ));
        let texts = repository("examples/correspondence_as_text");
        let text = std::fs::read_to_string(texts.join(format!("{file}.piola"))).unwrap();
        folder.file(&format!("{file}.piola"), text);
        let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        let voigt: Vec<f64> = numbers(&found["voigt"]);
        for (found, expected) in voigt.iter().zip([7.0, 3.0, 0.0, 3.0, 7.0, 0.0, 0.0, 0.0, 2.0]) {
            assert!((found - expected).abs() < 1e-13, "{file}: {voigt:?}");
        }
    }
}

/// Scalars that points gather with the directions of bonds: squares of two that are perpendicular add up to what no
/// direction has, and a fibre along the other axis has the moduli of that one.
#[test]
fn moduli_of_gathered_scalars_see_directions() {
    let voigt = |integrand: &str, bonds: &str| -> Vec<f64> {
        let folder = SceneFolder::new(
            "[body]\nbox = [[0.0, 0.0], [20.0, 20.0]]\nspacing = 1.0\nthickness = 0.3\n\
             [horizon]\nspacings = 3\n[material]\npotential = \"law.piola\"\n",
        );
        let law = format!(
            "potential law\nparameter b = 0.3\n\
             rest = integral(L^2)\ns = integral(({integrand})*L*(l - L))/rest\npsi(s) = 3*s^2 + s^3\n\
             psi(l, s, rest) = b*({bonds})*L*(l/L - 1)^2*(1 + s)/rest\n"
        );
        folder.file("law.piola", law);
        let found = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0).json();
        numbers(&found["voigt"])
    };
    let isotropic = voigt("1", "1");
    let one = "((0.6*Xi(1) + 0.8*Xi(2))/L)^2 + ((0.6*Xi(2) - 0.8*Xi(1))/L)^2";
    let both = voigt(one, one);
    for (found, expected) in both.iter().zip(&isotropic) {
        assert!((found - expected).abs() < 1e-13 * isotropic[0], "{both:?} {isotropic:?}");
    }
    let along = voigt("(Xi(1)/L)^2", "Xi(1)^4/L^4");
    let across = voigt("(Xi(2)/L)^2", "Xi(2)^4/L^4");
    assert!(along[0] > 2.0 * along[4], "{along:?}");
    for (i, j) in [(0, 4), (1, 1), (4, 0), (8, 8)] {
        assert!((along[i] - across[j]).abs() < 1e-13 * along[0], "{along:?} {across:?}");
    }
}

/// A strip of two materials of one text is solved, and its plan says what is modelled; neighbours of other potentials
/// are refused with what to write.
#[test]
fn bodies_of_two_materials_have_one_text() {
    let scene = |second: &str| {
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [[0.0, 0.0], [20.0, 8.0]]\nspacing = 1.0\n[horizon]\nspacings = 2\n\
             [sets]\nsoft = \"X < 10\"\nstiff = \"X > 10\"\nleft = \"X < 2\"\nright = \"X > 18\"\n\
             [[material]]\nset = \"soft\"\npotential = \"text.piola\"\n\
             parameters = {{ lambda = 1.0, mu = 1.0 }}\n\
             [[material]]\nset = \"stiff\"\npotential = \"{second}\"\n\
             parameters = {{ lambda = 3.0, mu = 2.0 }}\n\
             [[prescribe]]\nset = \"left\"\nu = [0, 0]\n\
             [[prescribe]]\nset = \"right\"\nu = [\"0.5*t\", 0]\n[steps]\nincrements = 2\n"
        ));
        let texts = repository("examples/correspondence_as_text");
        for (file, own) in [("text.piola", "bond_quadrature"), ("other.piola", "isotropic")] {
            let text = std::fs::read_to_string(texts.join(format!("{own}.piola"))).unwrap();
            folder.file(file, text);
        }
        folder
    };
    let folder = scene("text.piola");
    folder.run(&[]).expect(0);
    let plan = piola(&["plan", &folder.scene()]).expect(0).stdout;
    assert!(plan.contains("psi(xi, H, w0)") && plan.contains("gathered over families"), "{plan}");
    scene("other.piola").run(&[]).expect(2).says(&["what neighbours gather", "one potential"]);
}
