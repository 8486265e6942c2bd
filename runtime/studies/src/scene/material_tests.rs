//! Scenes of several materials: what is read, and the way back to text.

use super::*;

fn read(text: &str) -> Scene {
    Scene::read(text, "scene.toml", &[]).unwrap_or_else(|report| panic!("{report}"))
}

/// Materials by set with a sum of energies, and every rule between them.
const SEVERAL: &str = r#"[body]
box = [[0.0, 0.0], [1.0, 1.0]]
spacing = 0.05
[horizon]
spacings = 3
[sets]
left = "X < 0.5"
upper = "X > 0.5 and Y > 0.5"
[[material]]
set = "left"
name = "steel"
potential = "law.piola"
parameters = { C1 = 1.0 }
[[material.plus]]
potential = "fibres.piola"
[[material]]
set = "upper"
potential = "law.piola"
[[material]]
potential = "other.piola"
[[interface]]
between = ["upper", "rest"]
potential = "glue.piola"
parameters = { C = "1 MPa" }
[[interface]]
between = ["steel", "rest"]
as = "rest"
[[interface]]
between = ["steel", "upper"]
rule = "mean"
"#;

#[test]
fn a_list_holds_the_entries_of_a_vector() {
    let least = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.05\n[horizon]\nspacings = 3\n[material]\n\
                 potential = \"javili2020\"\n";
    let text = format!("{least}parameters = {{ mu = [1, \"2 kPa\"], C1 = [3.0] }}\n");
    let scene = read(&text);
    let given = scene.material().parameters.iter();
    let given: Vec<(&str, &ParameterText)> =
        given.map(|one| (one.name.value.as_str(), &one.value.value)).collect();
    let expected = [
        ("mu1", &ParameterText::Number(1.0)),
        ("mu2", &ParameterText::Quantity("2 kPa".into())),
        ("C1_1", &ParameterText::Number(3.0)),
    ];
    assert_eq!(given, expected);
    let nested = format!("{least}parameters = {{ mu = [1, [2]] }}\n");
    let report = Scene::read(&nested, "scene.toml", &[]).unwrap_err().to_string();
    assert!(report.contains("expected a number or a string, found an array"), "{report}");
}

#[test]
fn materials_and_interfaces_are_read_and_written() {
    let scene = read(SEVERAL);
    let laws: Vec<(usize, &str)> =
        scene.materials.iter().map(|m| (m.law, m.potential.value.as_str())).collect();
    let expected = [
        (0, "law.piola"),
        (0, "fibres.piola"),
        (1, "law.piola"),
        (2, "other.piola"),
        (3, "glue.piola"),
    ];
    assert_eq!(laws, expected);
    let names: Vec<&str> = scene.regions.iter().map(|r| r.name.value.as_str()).collect();
    assert_eq!(names, ["steel", "upper", "rest"]);
    let rules: Vec<InterfaceRule> = scene.interfaces.iter().map(|i| i.rule).collect();
    let all = [InterfaceRule::Potential(3), InterfaceRule::As(2), InterfaceRule::Mean];
    assert_eq!(rules, all);
    assert_eq!((scene.n_laws(), scene.law_name(3).as_str()), (4, "upper and rest"));
    assert_eq!(read(&scene.resolved_toml()), scene);
    let other = Scene::read(
        SEVERAL,
        "scene.toml",
        &["material.1.parameters.C1=2", "interface.0.parameters.C=3"].map(String::from),
    );
    let other = other.unwrap_or_else(|report| panic!("{report}"));
    let value = |number: usize| other.materials[number].parameters[0].value.value.clone();
    assert_eq!([value(2), value(4)], [ParameterText::Number(2.0), ParameterText::Number(3.0)]);
}
