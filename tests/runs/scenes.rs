//! Small scenes that the tests vary.

use crate::support::SceneFolder;

/// A strip of 11 x 5 points that is pulled along X: 55 points, 2 horizons wide, fractions of a
/// second.
pub(crate) const STRIP: &str = r#"
[body]
dimension = 2
box = [[0.0, 0.0], [1.0, 0.4]]
spacing = 0.1
nodes = "corners-full"
[horizon]
spacings = 2
[material]
potential = "javili2020"
parameters = { C1 = 1.0, C2 = 5.0 }
[sets]
left = "X < 0.15"
right = "X > 0.85"
[[prescribe]]
set = "left"
u = [0, 0]
[[prescribe]]
set = "right"
u = ["0.2*t", 0]
[[probe]]
name = "middle"
at = [0.5, 0.2]
[steps]
increments = 4
[output]
frames = 4
"#;

/// Its points.
pub(crate) const LATTICE: &str =
    "box = [[0.0, 0.0], [1.0, 0.4]]\nspacing = 0.1\nnodes = \"corners-full\"";

/// The strip with one piece of its text replaced.
#[track_caller]
pub(crate) fn strip_with(old: &str, new: &str) -> SceneFolder {
    assert_eq!(STRIP.matches(old).count(), 1, "`{old}`");
    SceneFolder::new(&STRIP.replace(old, new))
}

/// The strip.
pub(crate) fn strip() -> SceneFolder {
    SceneFolder::new(STRIP)
}
