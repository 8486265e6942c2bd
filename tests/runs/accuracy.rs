//! `piola audit` and `piola derive --explain`: what is promised about digits, from outside.

use crate::support::{SceneFolder, number, numbers, piola};

/// Options that keep an audit short.
const QUICK: [&str; 4] = ["--points", "2", "--dim", "2"];

fn audit(file: &str, more: &[&str]) -> crate::support::Outcome {
    let mut arguments = vec!["audit", file];
    arguments.extend(QUICK);
    arguments.extend(more);
    piola(&arguments)
}

/// A regime of an audit.
struct Regime {
    /// `strain 1e-8`: what it is, and its size.
    label: String,
    kind: String,
    size: f64,
    /// Largest errors of psi and its derivatives in u of the value.
    raw: Vec<f64>,
    /// What is left of them where rounded inputs excuse what exceeds 64 u.
    left: Vec<f64>,
}

/// All regimes of an audit, whatever it is of.
fn regimes(arguments: &[&str]) -> Vec<Regime> {
    let json = ["--format", "json"];
    let lines = piola(&[&["audit"], arguments, &json].concat()).stdout;
    let audits = lines.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let regime = |regime: &serde_json::Value| {
        let label = regime["regime"].as_str().unwrap();
        let (kind, size) = label.split_once(' ').unwrap_or((label, "1"));
        Regime {
            label: label.to_string(),
            kind: kind.to_string(),
            size: size.parse().unwrap_or(1.0),
            raw: numbers(&regime["raw"]),
            left: numbers(&regime["errors"]),
        }
    };
    audits
        .flat_map(|a| a["regimes"].as_array().unwrap().iter().map(regime).collect::<Vec<_>>())
        .collect()
}

/// In the value alone but for where psi'' passes through zero: there it has no digits, 9e15 u.
#[test]
fn the_library_keeps_its_digits() {
    let quick = |name, more: &[&'static str]| [&[name], &QUICK[..], more].concat();
    let two = |name| quick(name, &[]);
    let mut audits = vec![two("firooz2023"), two("javili2020"), two("logarithmic")];
    audits.push(quick("firooz2023", &["--set", "n=1e-8"]));
    for level in ["strict", "fast"] {
        audits.push(quick("firooz2023", &["--set", "n=2.7", "--level", level]));
    }
    audits.push(vec!["silling2000", "--points", "2"]);
    audits.push(vec!["miranda_modified_stretch", "--points", "2"]);
    for arguments in audits {
        piola(&[&["audit"], &arguments[..]].concat()).expect(0);
        let mut worst = [0.0_f64; 3];
        for regime in regimes(&arguments).iter().filter(|regime| regime.kind != "zeros") {
            (0..3).for_each(|order| worst[order] = worst[order].max(regime.raw[order]));
        }
        println!("{arguments:?}: {worst:.1?}");
        assert!(worst.iter().all(|error| *error <= 32.0), "{arguments:?}: {worst:?}");
    }
}

#[test]
fn a_missed_bar_is_exit_1_and_names_the_input() {
    let outcome = audit("firooz2023", &["--set", "n=-0.5", "--textbook"]).expect(1);
    assert!(outcome.stdout.contains("  missed: psi' at l = "), "{}", outcome.stdout);
    audit("firooz2023", &["--set", "n=1", "--bar", "0.1"]).expect(1);
}

#[test]
fn an_audit_is_csv_json_and_a_picture() {
    let csv = audit("firooz2023", &["--set", "n=1", "--format", "csv"]).expect(0).stdout;
    let mut lines = csv.lines();
    assert_eq!(
        lines.next(),
        Some("measure,regime,points,order,raw,error,at,at_reference,at_change")
    );
    assert!(lines.clone().count() > 100 && lines.all(|line| line.split(',').count() == 9));

    let json = audit("javili2020", &["--format", "json"]).expect(0).stdout;
    let objects: Vec<serde_json::Value> =
        json.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(objects.len(), 2, "bonds and triangles");
    assert_eq!((&objects[0]["measure"], &objects[0]["passed"]), (&"l".into(), &true.into()));
    assert!(number(&objects[0]["regimes"][0]["errors"][0]) < 64.0);

    let folder = SceneFolder::new("");
    for name in ["audit.png", "audit.svg"] {
        audit("javili2020", &["--picture", &folder.path(name)]).expect(0);
        assert!(std::fs::metadata(folder.path(name)).unwrap().len() > 5000);
    }
    audit("javili2020", &["--picture", &folder.path("no/folder.png")]).expect(2);
}

/// Conditions and what bonds remember are audited like energies, and a threshold that loses its digits is
/// found, with what it loses them by.
#[test]
fn conditions_and_next_states_are_audited() {
    for name in ["prototype_microelastic_brittle", "bilinear_softening", "micro_plastic", "fatigue"]
    {
        let text = piola(&["audit", name, "--points", "3"]).expect(0).stdout;
        let remembers = name != "prototype_microelastic_brittle";
        assert_eq!(text.contains("\nupdate "), remembers, "{text}");
        assert_eq!(text.contains("\nbreak when "), name != "micro_plastic", "{text}");
        assert_eq!(text.contains("zeros of margin"), name != "micro_plastic", "{text}");
    }
    let folder = SceneFolder::new("");
    let lossy = "potential lossy\nparameter w = 1e-9\npsi(l) = (l - L)^2/L\ns = l/L\n\
                 break when w > s^2 - 2.6*s + 1.69\n";
    let file = folder.file("lossy.piola", lossy);
    let text = audit(&file, &[]).expect(1).stdout;
    let missed: Vec<&str> = text.lines().filter(|line| line.contains("missed")).collect();
    assert!(
        matches!(missed[..], [line] if line.starts_with("  missed: margin at l = 1.29")),
        "{text}"
    );
    let csv = audit(&file, &["--format", "csv"]).expect(1).stdout;
    assert!(csv.contains("\n\"break when w > s^2 - 2.6*s + 1.69\",zeros of margin,"), "{csv}");
    let explained = piola(&["derive", "--explain", &file]).expect(0).stdout;
    assert!(explained.contains("the margin of `w > s^2 - 2.6*s + 1.69` is off by"), "{explained}");
    // What bonds remember is known by its value there.
    piola(&["derive", "--explain", "micro_plastic"]).expect(0);
}

/// Of triangles and tetrahedra it is these that are judged.
#[test]
fn verify_names_what_breaks() {
    let folder = SceneFolder::new("");
    let text = "potential torn\npsi(l) = (l/L - 1)^2\npsi(a) = (a/A - 1)^2\npsi(v) = (v/V - 1)^2\n\
                break when l/L - 1 > 0.1\nbreak when a/A - 1 > 0.1\nbreak when abs(v/V - 1) > 0.2\n";
    let file = folder.file("torn.piola", text);
    let text = piola(&["verify", &file, "--dim", "3"]).expect(0).stdout;
    for (condition, what) in [
        ("l/L - 1 > 0.1", "bond"),
        ("a/A - 1 > 0.1", "triangle"),
        ("abs(v/V - 1) > 0.2", "tetrahedron"),
    ] {
        let line = text.lines().find(|line| line.contains(&format!("break when {condition}:")));
        let judged = format!("every {what} is judged as written");
        assert!(line.is_some_and(|line| line.contains(&judged)), "{text}");
    }
}

/// Audits an energy of bonds: the exit code, the largest errors raw and left of each order.
fn largest(energy: &str, more: &[&str], exit: i32) -> [[f64; 3]; 2] {
    let folder = SceneFolder::new("");
    let file = folder.file("p.piola", format!("potential p\npsi(l) = {energy}\n"));
    let arguments = [&[&file[..], "--points", "4"], more].concat();
    piola(&[&["audit"], &arguments[..]].concat()).expect(exit);
    let mut largest = [[0.0_f64; 3]; 2];
    for regime in regimes(&arguments) {
        for order in 0..3 {
            largest[0][order] = largest[0][order].max(regime.raw[order]);
            largest[1][order] = largest[1][order].max(regime.left[order]);
        }
    }
    println!("{energy} {more:?}: {largest:.1?}");
    largest
}

/// Differences that vanish far from rest have no digits there; the same energies as powers keep what the
/// rounded length leaves them.
#[test]
fn zeros_far_from_rest_are_looked_at() {
    for (energy, factored) in [
        ("(l/L)^2 - 2.6*(l/L) + 1.69", "(l/L - 1.3)^2"),
        ("((l/L)^2 - 4*(l/L) + 4)^2", "(l/L - 2)^4"),
    ] {
        let [_, left] = largest(energy, &[], 1);
        assert!(left[0] > 1e6, "{energy}: {left:?}");
        let [raw, _] = largest(factored, &[], 0);
        assert!(raw[0] > 1e10, "no digits on the zero itself: {raw:?}");
    }
}

/// In compression the length counts, not its change; and a logarithm that is typed behaves like the one
/// that takes the place of a difference.
#[test]
fn compression_is_not_excused() {
    let barrier = "l*log1pmx(l/L - 1)";
    let [_, left] = largest(barrier, &["--textbook"], 1);
    assert!(left[0] > 1e6, "{left:?}");
    largest(barrier, &[], 0);
    largest("l*(ln(l/L) - (l/L - 1))", &[], 0);
}

/// An exponential magnifies the rounding of its argument: no form of it could know more, and none is
/// called lost for it. A difference that cancels is.
#[test]
fn errors_count_in_what_rounded_inputs_leave_unknown() {
    let [raw, left] = largest("exp(-3*(l/L))*L", &[], 0);
    assert!(raw[0] > 100.0 && left[0] < 32.0, "{raw:?} {left:?}");
    let [_, left] = largest("(1 - cos(l/L - 1))*L", &["--textbook"], 1);
    assert!(left[0] > 1e3, "{left:?}");
}

/// A run takes even energies by squares: those kernels are verified and audited like the others.
#[test]
fn kernels_of_squares_are_verified_and_audited() {
    let even = ["firooz2023", "--dim", "3", "--set", "n=2", "--points", "20"];
    let found = piola(&[&["verify"], &even[..]].concat()).expect(0).stdout;
    for measure in ["l", "l^2/L", "a", "a^2/A", "v"] {
        assert!(found.contains(&format!("passed  firooz2023 d = 3 psi({measure}): ")), "{found}");
    }
    assert!(!found.contains("v^2"), "{found}");
    let text = piola(&[&["audit"], &even[..]].concat()).expect(0).stdout;
    assert!(text.contains("psi(l) runs as a function of l^2/L"), "{text}");
    let bar = [&["audit"], &even[..], &["--bar", "0.1"]].concat();
    let text = piola(&bar).expect(1).stdout;
    assert!(text.contains("  missed: psi at a^2/A = "), "{text}");
}

#[test]
fn rewrites_are_explained_with_what_they_gain() {
    let explain = |file: &str, set: &str| {
        piola(&["derive", file, "--explain", "--set", set]).expect(0).stdout
    };
    let text = explain("firooz2023", "n=-0.5");
    for part in ["difference_of_powers", "  before    (l/L)^-0.5 - 1\n", "  error     near rest "] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    assert!(explain("firooz2023", "n=1").contains("nothing is rewritten"));
}

/// The energies of the deformation gradient, with values far from incompressible and near it.
const OF_GRADIENTS: [(&str, &[&str]); 17] = [
    ("arruda_boyce", &["mu=1", "K=100"]),
    ("blatz_ko", &["mu=1", "f=0.6", "nu=0.3"]),
    ("exponentiated_hencky", &["mu=1", "K=100"]),
    ("fibre_reinforced", &["mu=1", "K=100", "k1=1"]),
    ("fung", &["c=1"]),
    ("gasser_ogden_holzapfel", &["mu=1", "K=100", "k1=1"]),
    ("gent", &["mu=1", "K=100"]),
    ("guccione", &["c=1", "K=100"]),
    ("hencky", &["lambda=100", "mu=1"]),
    ("hyperfoam", &["mu1=1", "alpha1=4.5", "mu2=-0.3", "alpha2=-4.5", "beta=0.33"]),
    ("lopez_pamies", &["mu1=1", "alpha1=1.1", "mu2=0.3", "alpha2=-2.474", "lambda=100"]),
    ("mooney_rivlin", &["C10=1", "C01=1", "K=100"]),
    ("neo_hooke", &["lambda=100", "mu=1"]),
    ("neo_hooke_stable", &["lambda=100", "mu=1"]),
    ("ogden", &["mu1=1", "alpha1=1.3", "mu2=-1", "K=100"]),
    ("st_venant_kirchhoff", &["lambda=100", "mu=1"]),
    ("yeoh", &["C1=1", "C2=-0.1", "C3=0.01", "K=100"]),
];

/// As many gradients as a user gets by default. `verify` leaves energies that it does not know 1e4 u far
/// from rest; those of the library need less, and have four times what they were measured to need: 18
/// and 14 u near rest, 960 and 88 u far from it.
#[test]
fn all_energies_of_the_deformation_gradient_are_verified() {
    let names = OF_GRADIENTS.map(|(name, _)| name);
    let arguments = [&["verify"], &names[..], &["--format", "json"]].concat();
    let found = piola(&arguments).expect(0).stdout;
    let mut verified = Vec::new();
    for line in found.lines() {
        let found: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!((&found["measure"], &found["passed"]), (&"F".into(), &true.into()), "{found}");
        let name = found["potential"].as_str().unwrap();
        let worst = |of: &str| numbers(&found[of]).into_iter().fold(0.0, f64::max);
        let (near, far) = (worst("worst_near_in_u"), worst("worst_far_in_u"));
        println!("{name} {}: near {near:.1} u, far {far:.1} u", found["dimension"]);
        let near_bar = if name == "mooney_rivlin" { 72.0 } else { 54.0 };
        let far_bar = match name {
            // Exponentials magnify the rounding of their argument.
            "fung" | "fibre_reinforced" | "gasser_ogden_holzapfel" | "guccione" => 3840.0,
            // So does the pole at the limit of extension.
            "gent" => 10_000.0,
            _ => 350.0,
        };
        assert!(near <= near_bar && far <= far_bar, "{found}");
        verified.push(name.to_string());
    }
    assert!(names.iter().all(|name| verified.iter().any(|found| found == name)), "{verified:?}");
}

/// What exceeds 64 u when errors count in the norm alone, in u, rounded up, and what of that rounded inputs
/// do not excuse. A change of volume alone has no stress but that of the volume, the small one where it is
/// squeezed to J = 1e-18: rounding F leaves deviations in P. Random gradients may be nearly singular. The
/// rest is not excused: exponentials and powers that magnify the rounding of their arguments.
const MISSED: [(&str, &str, [f64; 3], [f64; 3]); 30] = [
    ("arruda_boyce", "volumetric", [0.0, 9.6e15, 0.0], [0.0; 3]),
    ("blatz_ko", "random", [0.0, 192.0, 434.0], [0.0; 3]),
    ("exponentiated_hencky", "guards", [562.0, 0.0, 0.0], [0.0; 3]),
    ("exponentiated_hencky", "uniaxial", [75.0, 79.0, 76.0], [75.0, 79.0, 76.0]),
    ("exponentiated_hencky", "equibiaxial", [148.0, 149.0, 152.0], [148.0, 149.0, 152.0]),
    ("exponentiated_hencky", "isochoric", [87.0, 89.0, 91.0], [87.0, 89.0, 91.0]),
    ("exponentiated_hencky", "volumetric", [312.0, 312.0, 313.0], [312.0, 312.0, 313.0]),
    ("exponentiated_hencky", "shear", [68.0, 69.0, 72.0], [68.0, 69.0, 72.0]),
    ("exponentiated_hencky", "random", [505.0, 892.0, 1360.0], [0.0; 3]),
    ("gasser_ogden_holzapfel", "isochoric", [267.0, 270.0, 271.0], [267.0, 270.0, 271.0]),
    ("gasser_ogden_holzapfel", "volumetric", [0.0, 2.0e15, 0.0], [0.0; 3]),
    ("gasser_ogden_holzapfel", "random", [235.0, 237.0, 239.0], [235.0, 237.0, 239.0]),
    ("guccione", "guards", [102.0, 0.0, 0.0], [0.0; 3]),
    ("hyperfoam", "volumetric", [0.0, 0.0, 97.0], [0.0, 0.0, 97.0]),
    ("hyperfoam", "random", [0.0, 1450.0, 1820.0], [0.0; 3]),
    ("lopez_pamies", "random", [0.0, 0.0, 130.0], [0.0; 3]),
    ("fibre_reinforced", "volumetric", [0.0, 2.0e15, 0.0], [0.0; 3]),
    ("fibre_reinforced", "random", [314.0, 315.0, 314.0], [0.0; 3]),
    ("fung", "inverted", [329.0, 329.0, 333.0], [329.0, 329.0, 0.0]),
    ("hencky", "random", [0.0, 0.0, 118.0], [0.0; 3]),
    ("mooney_rivlin", "volumetric", [0.0, 3.8e18, 93.0], [0.0, 0.0, 93.0]),
    ("mooney_rivlin", "random", [0.0, 124.0, 171.0], [0.0; 3]),
    ("neo_hooke", "random", [0.0, 134.0, 170.0], [0.0; 3]),
    ("neo_hooke_stable", "random", [0.0, 108.0, 0.0], [0.0; 3]),
    ("ogden", "uniaxial", [0.0, 83.0, 0.0], [0.0, 83.0, 0.0]),
    ("ogden", "equibiaxial", [0.0, 74.0, 77.0], [0.0, 74.0, 77.0]),
    ("ogden", "volumetric", [0.0, 7.4e17, 0.0], [0.0; 3]),
    ("ogden", "random", [0.0, 89.0, 116.0], [0.0; 3]),
    ("yeoh", "volumetric", [0.0, 2.9e16, 0.0], [0.0, 97.0, 0.0]),
    ("yeoh", "random", [80.0, 97.0, 167.0], [0.0; 3]),
];

/// 64 u everywhere, but for [`MISSED`] and `turned` bodies, whose F knows a strain to u/strain, and psi and P no
/// better.
#[test]
fn energies_of_the_deformation_gradient_keep_their_digits() {
    let mut seen: Vec<(&str, String, usize, [f64; 2])> = Vec::new();
    for (name, values) in OF_GRADIENTS {
        for dimension in ["2", "3"] {
            let mut arguments = vec![name, "--points", "2", "--dim", dimension];
            arguments.extend(values.iter().flat_map(|value| ["--set", value]));
            let found = regimes(&arguments);
            if found.is_empty() {
                let refused = piola(&[&["audit"], &arguments[..]].concat());
                assert!(dimension == "2" && refused.stderr.contains("dimensions"), "{name}");
                continue;
            }
            assert!(found.len() > 30, "{name}: {}", found.len());
            for Regime { label, kind, size, raw, left } in &found {
                let is_turned = kind == "turned";
                let missed = MISSED.iter().find(|(n, k, ..)| (*n, *k) == (name, kind.as_str()));
                for order in 0..3 {
                    let lost = if is_turned && order < 2 { *size } else { 1.0 };
                    let raw = lost * raw[order];
                    let bar = missed.map_or(64.0, |missed| missed.2[order].max(64.0));
                    assert!(raw <= bar, "{name} {dimension}, {label}, order {order}: {raw:e}");
                    let left = left[order];
                    let bar = missed.map_or(64.0, |missed| missed.3[order].max(64.0));
                    assert!(left <= bar, "{name} {dimension}, {label}, {order} left: {left:e}");
                    seen.push((name, kind.to_string(), order, [raw, left]));
                }
            }
        }
    }
    // What is no miss any more is struck from the list.
    for (name, kind, raw, left) in MISSED {
        for order in 0..3 {
            let of = seen.iter().filter(|s| (s.0, s.1.as_str(), s.2) == (name, kind, order));
            let worst = of.fold([0.0_f64; 2], |w, s| [w[0].max(s.3[0]), w[1].max(s.3[1])]);
            println!("{name}, {kind}, order {order}: {worst:.3?} u, bar 64");
            assert!(raw[order] == 0.0 || worst[0] > 64.0, "{name} {kind}");
            assert!(left[order] == 0.0 || worst[1] > 64.0, "{name} {kind}, left");
        }
    }
}

#[test]
fn an_audit_of_gradients_is_a_table_csv_and_a_picture() {
    let text = audit("st_venant_kirchhoff", &[]).expect(0).stdout;
    for part in
        ["psi(F): largest errors", "of the norm;\nleft: ", " dP  ", "strain 1e-12 ", "shear 1e6 "]
    {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    let textbook = audit("st_venant_kirchhoff", &["--textbook"]).expect(1).stdout;
    assert!(textbook.contains("  missed: P at F - I = ("), "{textbook}");
    let csv = audit("st_venant_kirchhoff", &["--format", "csv"]).expect(0).stdout;
    assert!(csv.lines().all(|line| line.split(',').count() == 9), "{csv}");
    let folder = SceneFolder::new("");
    audit("st_venant_kirchhoff", &["--picture", &folder.path("audit.svg")]).expect(0);
    let picture = std::fs::read_to_string(folder.path("audit.svg")).unwrap();
    assert!(picture.contains("psi(F)") && picture.contains(">dP<"));
}

/// A barrier loses its digits twice as written; hyper-dual numbers of it cannot decide.
#[test]
fn verify_decides_where_the_written_energy_has_no_digits() {
    let folder = SceneFolder::new("");
    let file = folder.file("b.piola", "potential b\npsi(l) = L*(l/L - 1 - ln(l/L))\n");
    piola(&["verify", &file]).expect(0);
    audit(&file, &[]).expect(0);
    audit(&file, &["--textbook"]).expect(1);
}

/// Bonds that come to remember more than a double holds, or a number whose square none does: the potential is right,
/// and so is what is compiled.
#[test]
fn verify_says_nothing_of_next_states_beyond_doubles() {
    let folder = SceneFolder::new("");
    let text = "potential p\nparameter C\nstate k = 0\n\
                update k = max(k, exp(800*(l/L - 1)) - exp(799*(l/L - 1)))\n\
                psi(l) = C*L*(l/L - 1)^2/(1 + k)\n";
    let file = folder.file("beyond.piola", text);
    let told = piola(&["verify", &file, "--set", "C=1"]).stdout;
    assert!(told.contains(" load steps, psi(l): "), "{told}");
    for word in ["WRONG", "defect", "NaN", "expected inf"] {
        assert!(!told.contains(word), "{word} in {told}");
    }
}
