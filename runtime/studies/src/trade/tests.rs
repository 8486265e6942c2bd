//! Studies of a small strip, and the table of axes against the scenes it is for.

use std::time::Duration;

use super::axes::{COMBINATIONS, DEFAULT, OWN, available, reference_overrides, settings, word_of};
use super::front::Standing;
use super::*;
use crate::case::Library;

const LAW: &str = "potential law\nparameter C1 = 1\npsi(l) = 1/2*C1*L*(l/L - 1)^2\n";
const BRITTLE: &str = "potential brittle\nparameter C1 = 1\npsi(l) = 1/2*C1*L*(l/L - 1)^2\n\
                       break when l/L - 1 > 0.005\n";
const STRIP: &str = "
[body]
dimension = 2
box = [[0.0, 0.0], [1.0, 0.4]]
spacing = 0.1
nodes = \"corners-full\"
[horizon]
spacings = 3
[material]
potential = \"law\"
[sets]
left = \"X < 0.25\"
right = \"X > 0.75\"
[[prescribe]]
set = \"left\"
u = [0, 0]
[[prescribe]]
set = \"right\"
u = [\"0.2*t\", 0]
[[probe]]
name = \"middle\"
at = [0.5, 0.2]
[steps]
increments = 3
";

/// A strip with a slit that is torn apart.
const TORN: &str = "
[body]
dimension = 2
box = [[0.0, 0.0], [1.0, 0.6]]
spacing = 0.1
[horizon]
spacings = 3
[material]
potential = \"brittle\"
density = 1.0
[sets]
low = \"Y < 0.1\"
high = \"Y > 0.5\"
[[crack]]
segment = [[-0.1, 0.3], [0.4, 0.3]]
[fracture]
unbreakable = [\"low\", \"high\"]
[[prescribe]]
set = \"low\"
v = [0, 0]
[[prescribe]]
set = \"high\"
v = [0, 1e-4]
[motion]
end = 200.0
";

/// A folder with the strip, and a reader of it.
struct Strip {
    folder: tempfile::TempDir,
}

impl Strip {
    fn new(text: &str) -> Strip {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("scene.toml"), text).unwrap();
        Strip { folder }
    }

    fn read(&self, overrides: &[String]) -> Result<Case, CaseError> {
        let find = |name: &str| match name {
            "law" => Some(LAW),
            "brittle" => Some(BRITTLE),
            _ => None,
        };
        let library = Library { find: &find, names: &["law", "brittle"] };
        Case::read(&self.folder.path().join("scene.toml"), overrides, &library)
    }

    fn study(&self, options: &Options) -> Result<Study, TradeError> {
        study(&|overrides| self.read(overrides), options, &mut |_| {})
    }
}

fn options() -> Options {
    Options {
        quantities: Vec::new(),
        axes: Vec::new(),
        varied: Vec::new(),
        repeats: 2,
        budget: Duration::from_secs(60),
        accuracy: None,
    }
}

#[test]
fn every_axis_is_known_to_the_scene_or_waits_for_its_key() {
    let strip = Strip::new(STRIP);
    let resolved = strip.read(&[]).unwrap().scene.resolved_toml();
    let known = available(&resolved);
    assert!(known.len() >= 8, "{known:?}");
    for axis in &known {
        if !axis.default.is_empty() {
            // A scene that says nothing gets the default.
            let found = word_of(&resolved, axis.key).unwrap();
            let same = found == axis.default || found.parse::<f64>() == axis.default.parse::<f64>();
            assert!(same, "{}: {found}", axis.key);
        }
        let readable = |word: &&str| strip.read(&[format!("{}={word}", axis.key)]).is_ok();
        let n_readable = (axis.words)().iter().filter(|word| readable(word)).count();
        assert!(n_readable >= 2, "{}: {n_readable} of its words are read", axis.name);
        assert!(axis.reference.is_empty() || readable(&axis.reference), "{}", axis.name);
    }
    let names = |name: &str| AXES.iter().filter(|axis| axis.name == name).count();
    let thrown = Strip::new(THROWN);
    let of_motion = available(&thrown.read(&[]).unwrap().scene.resolved_toml());
    for axis in AXES.iter().filter(|axis| axis.scenes != axes::Scenes::Equilibria) {
        assert!(of_motion.iter().any(|known| known.name == axis.name), "{}", axis.name);
        let readable = |word: &&&str| thrown.read(&[format!("{}={word}", axis.key)]).is_ok();
        assert!((axis.words)().iter().filter(readable).count() >= 2, "{}", axis.name);
    }
    for row in COMBINATIONS {
        for (name, word) in *row {
            assert_eq!(names(name), 1, "{name}");
            assert!(!word.is_empty());
        }
    }
    assert!(reference_overrides(&resolved).contains(&"solver.linear=cholesky".to_string()));
}

#[test]
fn settings_are_different_scenes() {
    let strip = Strip::new(STRIP);
    let read = |overrides: &[String]| strip.read(overrides);
    let usual = settings(&read, &[], &[]).unwrap();
    assert_eq!(usual[0].name, OWN);
    // The strip's own setting is that of the defaults, so there is no second one.
    assert!(usual.iter().all(|setting| setting.name != DEFAULT));
    for (i, setting) in usual.iter().enumerate() {
        for other in &usual[..i] {
            assert_ne!(setting.case.scene, other.case.scene, "{} {}", setting.name, other.name);
        }
    }
    let tight = Strip::new(&format!("{STRIP}[solver]\ntolerance = 1e-13\n"));
    let read = |overrides: &[String]| tight.read(overrides);
    let names: Vec<String> =
        settings(&read, &[], &[]).unwrap().into_iter().map(|setting| setting.name).collect();
    assert!(names.contains(&DEFAULT.to_string()), "{names:?}");

    // Two axes give all their combinations: 7 tolerances by 3 starts.
    let axes = ["tolerance", "start", "start"].map(str::to_string);
    let names: Vec<String> =
        settings(&read, &axes, &[]).unwrap().into_iter().map(|setting| setting.name).collect();
    assert_eq!(names.len(), 21, "{names:?}");
    assert!(names.contains(&"tolerance=1e-6 start=last".to_string()), "{names:?}");
    // Values of any key, alone or with axes.
    let varied = ["material.parameters.C1=1,2,3", "prescribe.1.u=[0.1, 0],[0.3, 0]"];
    let varied = varied.map(str::to_string);
    let found = settings(&read, &["strain".to_string()], &varied).unwrap();
    assert_eq!(
        found.len(),
        4 * 3 * 2 + 1,
        "three values, two and one beside the scene's own; the default"
    );
    assert!(found.iter().any(|s| s.name == "strain=positions C1=2 u=[0.3, 0]"));
    assert!(found.iter().filter(|s| s.changes == axes::Changes::Question).count() == 22);
    for wrong in ["C1", "material.parameters.C1=1,,2", "=3"] {
        let error = settings(&read, &[], &[wrong.to_string()]).unwrap_err();
        assert!(matches!(error, TradeError::WrongVariation { .. }), "{wrong}: {error}");
    }
    let unknown = settings(&read, &[], &["material.potential=law,unheard".to_string()]);
    assert!(matches!(unknown, Err(TradeError::Case(_))));
    let error = settings(&read, &["speed".to_string()], &[]).unwrap_err();
    assert!(error.help().unwrap().contains("tolerance"), "{error}");
    let all: Vec<String> =
        ["tolerance", "linear", "derivatives", "increments", "start"].map(str::to_string).to_vec();
    assert!(matches!(settings(&read, &all, &[]), Err(TradeError::TooManySettings { .. })));
}

#[test]
fn a_study_knows_what_is_exact() {
    let strip = Strip::new(STRIP);
    let mut options = options();
    options.axes = ["tolerance", "strain"].map(str::to_string).to_vec();
    let study = strip.study(&options).unwrap();
    let find = |name: &str| {
        let found = study.outcomes.iter().find(|outcome| outcome.setting.name == name);
        found.unwrap_or_else(|| panic!("no {name}")).result.as_ref().unwrap()
    };
    // A loose tolerance errs, a tight one does not, the residual agrees.
    let (loose, tight) = (find("tolerance=1e-2"), find("tolerance=1e-12"));
    assert!(loose.worst > 1e-7 && loose.worst < 1e-1, "{:e}", loose.worst);
    assert!(tight.worst <= 1e-11, "{:e}", tight.worst);
    let residual = study.quantities.iter().position(|q| *q == Quantity::Residual).unwrap();
    assert!(loose.errors[residual] > tight.errors[residual]);
    assert!(study.reference.level < 1e-12, "{:e}", study.reference.level);
    assert!(study.reference.witnesses.len() == 2, "{:?}", study.reference.witnesses);
    // Errors e that go with the spacing h differ between two lattices by e (h' - h)/h.
    assert!(!study.resolution.alternates.is_empty(), "{:?}", study.resolution.notes);
    for lattice in &study.resolution.alternates {
        let numbers = lattice.differences.iter().zip(&lattice.errors);
        // Residuals of different bodies are not compared.
        for ((difference, error), _) in
            numbers.zip(&study.quantities).filter(|(_, q)| **q != Quantity::Residual)
        {
            let expected = error * (lattice.spacing - 0.1).abs() / 0.1;
            assert!((difference - expected).abs() <= 1e-12 * difference, "{lattice:?}");
        }
    }
    // The lattice of 0.1 has an error that no arithmetic has.
    let (_, error) = study.least_resolution().unwrap();
    assert!(error > 1e-3 && error < 1.0, "{error:e}");
    let cheapest = &study.outcomes[study.verdict.cheapest.unwrap()];
    assert!(cheapest.result.as_ref().unwrap().worst <= 0.1 * error);
    assert!(study.solver_toml(0).contains("tolerance = 1e-10"));
    assert!(matches!(
        study.outcomes[0].result.as_ref().unwrap().standing,
        Some(Standing::Front | Standing::Near | Standing::Dominated(_))
    ));
}

#[test]
fn what_cannot_be_compared_says_so() {
    let strip = Strip::new(STRIP);
    let mut wrong = options();
    wrong.quantities = vec!["heat".to_string()];
    let error = strip.study(&wrong).unwrap_err();
    assert!(error.help().unwrap().contains("reaction:right"), "{error}");
    let mut short = options();
    short.budget = Duration::ZERO;
    assert!(matches!(strip.study(&short), Err(TradeError::NoReference { .. })));
    // The demand of the user replaces that of the lattice.
    let mut asked = options();
    asked.axes = vec!["tolerance".to_string()];
    asked.accuracy = Some(1e-30);
    let study = strip.study(&asked).unwrap();
    assert!(
        study.verdict.cheapest.is_none()
            || study.outcomes.iter().any(|o| { o.result.as_ref().is_ok_and(|m| m.worst == 0.0) })
    );
}

/// The strip, thrown against what holds it.
const THROWN: &str = "
[body]
dimension = 2
box = [[0.0, 0.0], [1.0, 0.4]]
spacing = 0.1
nodes = \"corners-full\"
[horizon]
spacings = 3
[material]
potential = \"law\"
density = 1.0
[sets]
left = \"X < 0.25\"
all = \"X > -1\"
[[prescribe]]
set = \"left\"
u = [0, 0]
[[initial]]
set = \"all\"
v = [\"0.001*sin(2*X)\", 0]
[[probe]]
name = \"tip\"
at = [1.0, 0.2]
[motion]
end = 120.0
";

#[test]
fn errors_of_a_motion_go_with_the_square_of_the_step() {
    let strip = Strip::new(THROWN);
    let mut options = options();
    options.axes = ["step", "method"].map(str::to_string).to_vec();
    let study = strip.study(&options).unwrap();
    let names: Vec<String> = study.quantities.iter().map(Quantity::name).collect();
    assert_eq!(names, ["energy", "kinetic", "reaction:left", "probe:tip", "residual"]);
    let find = |name: &str| {
        let found = study.outcomes.iter().find(|outcome| outcome.setting.name == name);
        found.unwrap_or_else(|| panic!("no {name}")).result.as_ref().unwrap()
    };
    let (long, short) = (find("step=0.4"), find("step=0.1"));
    assert!(long.steps.is_multiple_of(20) && short.steps > 3 * long.steps);
    let times = (short.steps as f64 / long.steps as f64) * (short.steps as f64 / long.steps as f64);
    for (one, other) in long.errors.iter().zip(&short.errors).take(4) {
        assert!((one / other / times - 1.0).abs() < 0.15, "{long:?} {short:?}");
    }
    assert!(study.reference.level < 0.1 * short.worst, "{:e}", study.reference.level);
    // The midpoint rule is another way to the same course.
    let implicit = find("step=0.1 method=midpoint");
    assert!(implicit.worst < 0.3 && implicit.worst > short.worst, "{implicit:?}");
    let residual = study.quantities.len() - 1;
    assert!(short.errors[residual] < 1e-12, "the account closes");
    assert!(study.solver_toml(0).starts_with("[motion]\nmethod = \"verlet\""));
    assert!(study.to_text().contains("twice its step"));
    // Equilibria have other axes.
    let read = |overrides: &[String]| strip.read(overrides);
    let error = settings(&read, &["newton".to_string()], &[]).unwrap_err();
    assert!(error.help().unwrap().contains("method"), "{error}");
}

#[test]
fn bodies_that_break_are_compared_by_how_they_did() {
    let strip = Strip::new(TORN);
    let mut options = options();
    options.axes = vec!["step".to_string()];
    options.repeats = 1;
    let study = strip.study(&options).unwrap();
    let names: Vec<String> = study.quantities.iter().map(Quantity::name).collect();
    let failure = ["first_break", "half_broken", "broken_bonds", "released"];
    assert_eq!(names, [&failure[..], &["peak:low", "peak:high", "residual"]].concat());
    let reference = study.reference.course.failure.as_ref().unwrap();
    assert!(0.0 < reference.first && reference.first < reference.half && reference.half < 200.0);
    assert!(reference.bonds > 10 && reference.released > 0.0);
    // What is released has been put in by the grips.
    let put_in: f64 = 1e-4 * 200.0 * reference.peaks[1].value[0];
    assert!(reference.released < put_in, "{reference:?}");
    let find = |name: &str| {
        let found = study.outcomes.iter().find(|outcome| outcome.setting.name == name);
        found.unwrap_or_else(|| panic!("no {name}")).result.as_ref().unwrap()
    };
    // A step of the longer motion is the least by which times are known.
    let (long, short) = (find("step=0.8"), find("step=0.1"));
    let step = 200.0 / long.steps as f64;
    assert!((long.values[0] - reference.first).abs() <= 2.0 * step, "{long:?}");
    assert!(short.errors[0] <= long.errors[0] && short.errors[0] < 0.01, "{short:?} {long:?}");
    assert!((long.values[2] - reference.bonds as f64).abs() < 0.5 * reference.bonds as f64);
    assert!(study.to_text().contains("The reference has first_break"));
    assert!(study.to_json("torn").contains("\"half_broken\""));
    // A crack alone breaks nothing more: the quantities are those of other motions.
    let whole = Strip::new(&TORN.replace("\"brittle\"", "\"law\""));
    let usual = quantity::quantities(&whole.read(&[]).unwrap(), &[]).unwrap();
    assert_eq!(usual[0], Quantity::Energy);
    let wanted = ["released".to_string()];
    assert!(quantity::quantities(&whole.read(&[]).unwrap(), &wanted).is_err());
}
