//! What a newcomer types, and what is answered.

use super::*;

const LEAST: &str = r#"[body]
box = [[0, 0], [1, 1]]
spacing = 0.05
[horizon]
spacings = 3
[material]
potential = "javili2020"
"#;

#[test]
fn what_a_newcomer_types_is_answered_with_what_to_write() {
    for (old, new, answer) in [
        ("spacing = 0.05", "spacing: 0.05", "joined by `=`: spacing = .."),
        ("spacing = 0.05", "spacing = 0.05 m", "without a unit"),
        ("spacing = 0.05", "spacing = \"50 mm\"", "lengths are in m"),
        ("spacing = 0.05", "spacing = \"half\"", "write spacing = 0.05"),
    ] {
        assert_eq!(LEAST.matches(old).count(), 1, "{old}");
        let report = Scene::read(&LEAST.replace(old, new), "scene.toml", &[]).unwrap_err();
        let helps: Vec<&String> =
            report.findings.iter().flat_map(|finding| &finding.diagnostic.helps).collect();
        assert!(helps.iter().any(|help| help.contains(answer)), "{new}: {helps:?}");
    }
}
