//! Corrections of bonds: what is read, what is refused, and the way back to text.

use piola_mechanics::surface::Weighting;

use super::*;

const LEAST: &str = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.05\n[horizon]\nspacings = 3\n\
    [material]\npotential = \"solid\"\n";
const CLOUD: &str = "[body]\ndimension = 2\npoints = \"c.csv\"\n[horizon]\nradius = 0.5\n\
    [material]\npotential = \"solid\"\n";

fn with(text: &str, keys: &str) -> Result<Scene, SceneReport> {
    let text = text.replace("[material]", &format!("{keys}\n[material]"));
    Scene::read(&text, "scene.toml", &[])
}

#[test]
fn corrections_are_read_and_written() {
    let weighting = |text: &str, keys: &str| {
        let scene = with(text, keys).unwrap_or_else(|report| panic!("{report}"));
        let again = Scene::read(&scene.resolved_toml(), "scene.toml", &[]);
        assert_eq!(again.unwrap_or_else(|report| panic!("{report}")), scene);
        (scene.horizon.weighting(), scene.horizon.correction_span.is_some())
    };
    let of = |weights, surface, volumes| Weighting { weights, surface, volumes };
    let none = of(Weights::Uniform, Surface::None, Volumes::Whole);
    assert_eq!(weighting(LEAST, ""), (none, false));
    assert_eq!(weighting(LEAST, "surface = \"none\"\nvolumes = \"whole\""), (none, false));
    let faces = of(Weights::Uniform, Surface::Directional, Volumes::Whole);
    assert_eq!(weighting(LEAST, "surface = \"directional\""), (faces, true));
    // Parts of volumes are of volumes.
    let both = of(Weights::Volumes, Surface::Energy, Volumes::Partial);
    assert_eq!(weighting(LEAST, "surface = \"energy\"\nvolumes = \"partial\""), (both, true));
    let cloud = of(Weights::Truncated, Surface::None, Volumes::Whole);
    assert_eq!(weighting(CLOUD, "surface = \"none\"\nvolumes = \"whole\""), (cloud, false));
}

#[test]
fn corrections_that_mean_nothing_are_refused_where_they_stand() {
    for (text, keys, expected) in [
        (LEAST, "surface = \"some\"", "unknown-choice at \"some\""),
        (LEAST, "surface = true", "wrong-type at true"),
        (LEAST, "volumes = \"half\"", "unknown-choice at \"half\""),
        (LEAST, "weights = \"unit\"\nsurface = \"energy\"", "conflicting-keys at \"energy\""),
        (LEAST, "weights = \"uniform\"\nvolumes = \"partial\"", "conflicting-keys at \"partial\""),
        (
            LEAST,
            "weights = \"truncated\"\nvolumes = \"partial\"",
            "conflicting-keys at \"partial\"",
        ),
        (CLOUD, "surface = \"directional\"", "conflicting-keys at \"directional\""),
        (CLOUD, "volumes = \"partial\"", "conflicting-keys at \"partial\""),
    ] {
        let report = with(text, keys).unwrap_err();
        let found: Vec<String> = report
            .findings
            .iter()
            .map(|finding| {
                let place = &report.sources[finding.source].text[finding.diagnostic.span.range()];
                format!("{} at {place}", finding.diagnostic.code)
            })
            .collect();
        assert_eq!(found, [expected], "{keys}");
    }
}
