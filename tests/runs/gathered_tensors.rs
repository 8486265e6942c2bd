//! Potentials whose points gather tensors, through the program: a plate that breaks and moduli as those of
//! deformation gradients, steps of two materials, and what is refused.

use crate::support::{SceneFolder, numbers, piola, repository, table};

/// A plate of a material with a crack, whose law is a built-in discretisation or the text of it, `file` of the
/// example, with the same condition.
fn plate((is_text, file): (bool, &str), condition: &str, driven: &str) -> SceneFolder {
    let at_points = if file == "nodal" { "discretisation = \"nodal\"\n" } else { "" };
    let (potential, keys) = match is_text {
        true => ("text.piola", String::new()),
        false => ("gradient.piola", format!("[correspondence]\ninfluence = \"1/L\"\n{at_points}")),
    };
    let folder = SceneFolder::new(&format!(
        "[body]\nbox = [[0.0, 0.0], [0.1, 0.04]]\nspacing = 2e-3\n[horizon]\nspacings = 3.015\n\
         [material]\npotential = \"{potential}\"\ndensity = \"2440 kg/m^3\"\n\
         parameters = {{ lambda = \"24 GPa\", mu = \"24 GPa\" }}\n{keys}\
         [sets]\nlower = \"Y < 2e-3\"\nupper = \"Y > 0.038\"\n\
         [[crack]]\nsegment = [[-0.01, 0.02], [0.05, 0.02]]\n\
         [fracture]\nunbreakable = [\"lower\", \"upper\"]\n{driven}"
    ));
    let texts = repository("examples/correspondence_as_text");
    let own = std::fs::read_to_string(texts.join(format!("{file}.piola"))).unwrap();
    let own = own.replacen("psi(", "parameter s0 = 0.002\nparameter wc = 6e4 in Pa\npsi(", 1);
    let written = condition.replace("J > 1", "det(I + Hb) > 1");
    folder.file(
        "text.piola",
        own + &written.replace("Hb", if at_points.is_empty() { "Hb" } else { "H" }),
    );
    folder.file(
        "gradient.piola",
        format!(
            "potential gradient\nparameter lambda in Pa\nparameter mu in Pa, mu > 0\n\
             parameter s0 = 0.002\nparameter wc = 6e4 in Pa\n\
             psi(F) = lambda/2*tr(E)^2 + mu*(E : E)\n{condition}"
        ),
    );
    folder
}

const BY_LENGTH: &str = "break when l/L - 1 > s0\n";
const BY_GRADIENT: &str = "break when lambda/2*tr(E)^2 + mu*(E : E) > wc and J > 1\n";

/// Both break the same bonds, and have the same account of energy: by lengths of bonds, by what a bond makes of what
/// its ends gather, and by what a point does.
#[test]
fn a_plate_breaks_by_its_text_as_by_the_built_in_discretisation() {
    let driven = "[[load]]\nset = \"lower\"\ndensity = [0, -8e9]\n[[load]]\nset = \"upper\"\n\
                  density = [0, 8e9]\n[motion]\nend = \"25 us\"\n[output]\nframes = 1\n";
    for (file, condition) in
        [("bond_quadrature", BY_LENGTH), ("bond_quadrature", BY_GRADIENT), ("nodal", BY_GRADIENT)]
    {
        let [text, gradient] = [true, false].map(|is_text| {
            let folder = plate((is_text, file), condition, driven);
            folder.run(&[]).expect(0);
            table(&folder.out().join("motion.csv"))
        });
        assert_eq!((text.0.len(), text.1.len()), (gradient.0.len(), gradient.1.len()));
        let broken = text.0.iter().position(|name| *name == "broken_bonds").unwrap();
        let column = |rows: &[Vec<f64>]| rows.iter().map(|row| row[broken]).collect::<Vec<f64>>();
        let counts = column(&text.1);
        println!("{file}: {counts:?}");
        assert_eq!(counts, column(&gradient.1), "{file}: {condition}");
        assert!(counts.last().unwrap() > &(counts[0] + 10.0), "{file}: {counts:?}");
        // Energies to 1e-10 of the largest: errors of forces grow over 50 steps.
        let largest = text.1.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        for (text, gradient) in text.1.iter().flatten().zip(gradient.1.iter().flatten()) {
            assert!((text - gradient).abs() <= 1e-10 * largest, "{file}: {text} {gradient}");
        }
    }
}

/// Load steps, events and the history of a bond see what is gathered.
#[test]
fn load_steps_and_events_break_by_what_is_gathered() {
    let steps = "[[prescribe]]\nset = \"lower\"\nu = [0, 0]\n[[prescribe]]\nset = \"upper\"\n\
                 u = [0, \"4e-5*t\"]\n[steps]\nincrements = 4\n[output]\nframes = 1\n";
    let at_the_end = |is_text: bool, more: &[&str]| {
        let folder = plate((is_text, "nodal"), BY_GRADIENT, steps);
        folder.run(more).expect(0);
        let (header, rows) = table(&folder.out().join("energy.csv"));
        let of = |name: &str| header.iter().position(|x| *x == name).unwrap();
        let last = rows.last().unwrap();
        [last[of("t")], last[of("broken_bonds")]]
    };
    let events = ["--set", "steps.control=\"event\"", "--set", "steps.events=3"];
    for more in [&[][..], &events] {
        let [text, gradient] = [true, false].map(|is_text| at_the_end(is_text, more));
        println!("{more:?}: {text:?} {gradient:?}");
        // The crack is there from the start.
        assert!(text[1] > 438.0 && text[1] == gradient[1], "{text:?} {gradient:?}");
        assert!((text[0] / gradient[0] - 1.0).abs() < 1e-9, "{text:?} {gradient:?}");
    }
    let folder = plate((true, "nodal"), BY_GRADIENT, steps);
    let ends = ["--at", "0.051,0.019", "0.051,0.021"];
    let told = piola(&[&["explain-bond", &folder.scene()], &ends[..]].concat()).expect(0);
    assert!(told.stdout.contains("> wc and det(I + H) > 1"), "{}", told.stdout);
}

/// Points remember what they gather of vectors as they remember deformation gradients: the same bonds break by it,
/// and as much is dissipated, in motions and in load steps.
#[test]
fn points_remember_as_those_of_deformation_gradients_do() {
    let motion = "[[load]]\nset = \"lower\"\ndensity = [0, -8e9]\n[[load]]\nset = \"upper\"\n\
                  density = [0, 8e9]\n[motion]\nend = \"25 us\"\n[output]\nframes = 1\n";
    let steps = "[[prescribe]]\nset = \"lower\"\nu = [0, 0]\n[[prescribe]]\nset = \"upper\"\n\
                 u = [0, \"1e-6*t\"]\n[steps]\nincrements = 4\n[output]\nframes = 1\n";
    for (driven, file, breaks) in [(motion, "motion.csv", true), (steps, "energy.csv", false)] {
        let [text, gradient] = [true, false].map(|is_text| {
            let folder = plate((is_text, "nodal"), "", driven);
            let (name, head, y, growth) = match is_text {
                true => ("text.piola", "psi(H)", "lambda/2*tr(E)^2 + mu*(E : E)", "det(I + H) - 1"),
                false => ("gradient.piola", "psi(F)", "lambda/2*tr(E)^2 + mu*(E : E)", "J - 1"),
            };
            let path = folder.path(name);
            let own = std::fs::read_to_string(&path).unwrap();
            let (before, _) = own.split_once("psi(").unwrap();
            let text = format!(
                "{before}parameter tau = 1e-6 in s\nstate k = 0\nstate age = 0 in s\ny = {y}\nupdate k = max(k, {growth})\n\
                 update age = age + dt*k\n{head} = exp(-40*k - age/tau)*y\nbreak when k > s0/2\n"
            );
            std::fs::write(path, text).unwrap();
            folder.run(&[]).expect(0);
            table(&folder.out().join(file))
        });
        let of = |name: &str| text.0.iter().position(|own| own == name).unwrap();
        let last = text.1.last().unwrap();
        println!("{:?}\n{last:?}", text.0);
        assert_eq!(text.1.len(), gradient.1.len());
        let grown = last[of("broken_bonds")] - text.1[0][of("broken_bonds")];
        assert!(last[of("dissipated")] > 0.0 && (grown > 0.0) == breaks, "{last:?}");
        let largest = text.1.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        for (row, other) in text.1.iter().zip(&gradient.1) {
            assert_eq!(row[of("broken_bonds")], other[of("broken_bonds")]);
            for (x, y) in row.iter().zip(other) {
                assert!((x - y).abs() <= 1e-9 * largest, "{row:?}\n{other:?}");
            }
        }
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
