//! What is varied: a row of [`AXES`] per choice of a scene, a row of [`COMBINATIONS`] per
//! combination worth a look.
//!
//! An axis is a key of the scene and words for it. It exists where the resolved scene has the key:
//! a new key of `[solver]` needs a row here and nothing else.

use piola_compiler::Form;
use piola_mechanics::energy::Products;
use piola_mechanics::kernel::Level;
use piola_mechanics::words::Words;
use piola_solvers::linear::{LinearMethod, PreconditionerChoice};
use piola_solvers::motion::Method;
use piola_solvers::newton::NewtonVariant;
use piola_solvers::steps::Start;

use super::{ReadCase, TradeError};
use crate::case::Case;
use crate::scene::{DerivativeSource, Passes, StrainSource};

/// What an axis changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changes {
    /// How the answer is computed: its arithmetic error.
    Solution,
    /// What is asked: another discrete problem, whose answer differs for that reason.
    Question,
}

impl Changes {
    /// The word in tables.
    pub fn word(self) -> &'static str {
        match self {
            Changes::Solution => "solution",
            Changes::Question => "question",
        }
    }
}

/// One choice of a scene, with the words that are tried.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// As `--axes` names it, and as settings are called.
    pub name: &'static str,
    /// The key of the scene.
    pub key: &'static str,
    /// What it changes, in words.
    pub about: &'static str,
    /// What kind of change that is.
    pub changes: Changes,
    /// The words that are tried, besides the scene's own.
    pub words: fn() -> Vec<&'static str>,
    /// The word of the reference run; empty where the scene's own stays.
    pub reference: &'static str,
    /// The word of a scene that does not mention the key; empty where scenes have none in common.
    pub default: &'static str,
    /// Whether it is varied without being asked for.
    pub usual: bool,
    /// What a scene must have that it says something of.
    pub scenes: Scenes,
    /// What must be set beside it for it to count.
    pub beside: &'static [&'static str],
}

/// Which scenes an axis is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scenes {
    /// Those with equilibria.
    Equilibria,
    /// Those that move.
    Motions,
    /// All.
    All,
}

/// An axis of equilibria that is varied without being asked for: what the others are told apart from.
const USUAL: Axis = Axis {
    name: "",
    key: "",
    about: "",
    changes: Changes::Solution,
    words: Vec::new,
    reference: "",
    default: "",
    usual: true,
    scenes: Scenes::Equilibria,
    beside: &[],
};

/// All words of an option but `auto`, which stands for one of the others.
fn tried<T: Words>() -> Vec<&'static str> {
    T::words().into_iter().filter(|word| *word != "auto").collect()
}

/// All axes.
pub const AXES: &[Axis] = &[
    Axis {
        name: "tolerance",
        key: "solver.tolerance",
        about: "residual over reaction at which Newton's method ends",
        words: || vec!["1e-2", "1e-4", "1e-6", "1e-8", "1e-10", "1e-12"],
        default: "1e-10",
        ..USUAL
    },
    Axis {
        name: "start",
        key: "solver.start",
        about: "a step starts by the last tangent, on the line through the last two equilibria, or at the last",
        words: tried::<Start>,
        reference: "last",
        default: "tangent",
        ..USUAL
    },
    Axis {
        name: "linear",
        key: "solver.linear",
        about: "linear systems by factorisation or by iteration",
        words: tried::<LinearMethod>,
        reference: "cholesky",
        default: "auto",
        ..USUAL
    },
    Axis {
        name: "preconditioner",
        key: "solver.preconditioner",
        about: "what makes conjugate gradients converge sooner",
        words: tried::<PreconditionerChoice>,
        default: "auto",
        usual: false,
        ..USUAL
    },
    Axis {
        name: "products",
        key: "solver.products",
        about: "products with the tangent exact, or by differences of forces",
        words: tried::<Products>,
        reference: "exact",
        default: "exact",
        usual: false,
        ..USUAL
    },
    Axis {
        name: "newton",
        key: "solver.newton",
        about: "full Newton steps, inexact ones, or an old tangent",
        words: tried::<NewtonVariant>,
        reference: "full",
        default: "full",
        ..USUAL
    },
    Axis {
        name: "level",
        key: "solver.level",
        about: "kernels bit for bit as interpreted, or with vector functions and fma",
        words: tried::<Level>,
        reference: "strict",
        default: "fast",
        scenes: Scenes::All,
        ..USUAL
    },
    Axis {
        name: "derivatives",
        key: "solver.derivatives",
        about: "psi' and psi'' from machine code, interpreted, or by hyper-dual numbers",
        words: tried::<DerivativeSource>,
        reference: "jit",
        default: "jit",
        scenes: Scenes::All,
        ..USUAL
    },
    Axis {
        name: "form",
        key: "solver.form",
        about: "energies rewritten to keep their digits, or as written",
        words: tried::<Form>,
        reference: "accurate",
        default: "accurate",
        scenes: Scenes::All,
        ..USUAL
    },
    Axis {
        name: "strain",
        key: "solver.strain",
        about: "strain from displacements or from positions",
        words: tried::<StrainSource>,
        reference: "displacements",
        default: "displacements",
        scenes: Scenes::All,
        ..USUAL
    },
    Axis {
        name: "passes",
        key: "solver.passes",
        about: "along the rows of a lattice or by fours, or in batches along lists of neighbours",
        words: Passes::words,
        reference: "batches",
        default: "auto",
        scenes: Scenes::All,
        ..USUAL
    },
    Axis {
        name: "increments",
        key: "steps.increments",
        about: "how many steps lead to the end",
        changes: Changes::Question,
        words: || vec!["1", "5", "10", "20", "50", "100"],
        usual: false,
        ..USUAL
    },
    Axis {
        name: "horizon",
        key: "horizon.spacings",
        about: "the horizon in spacings: another body, whose forces reach further or less far",
        changes: Changes::Question,
        words: || vec!["2", "3", "4"],
        usual: false,
        scenes: Scenes::All,
        ..USUAL
    },
    Axis {
        name: "step",
        key: "motion.safety",
        about: "steps in time over the critical one, of the midpoint rule over ten times as much",
        words: || vec!["0.1", "0.2", "0.4", "0.6", "0.8", "0.95"],
        scenes: Scenes::Motions,
        beside: &["motion.step=auto"],
        ..USUAL
    },
    Axis {
        name: "method",
        key: "motion.method",
        about: "the rule of integration",
        words: tried::<Method>,
        reference: "verlet",
        default: "verlet",
        scenes: Scenes::Motions,
        ..USUAL
    },
];

/// Combinations that are tried besides single changes: one row each, axes and their words.
pub const COMBINATIONS: &[&[(&str, &str)]] = &[
    &[("start", "tangent"), ("tolerance", "1e-2")],
    &[("start", "tangent"), ("tolerance", "1e-4")],
    &[("start", "tangent"), ("tolerance", "1e-6")],
    &[("start", "tangent"), ("tolerance", "1e-8")],
    &[("start", "tangent"), ("tolerance", "1e-12")],
    &[("newton", "modified"), ("start", "tangent")],
    &[("newton", "modified"), ("tolerance", "1e-6")],
    &[("newton", "inexact"), ("linear", "cg")],
    &[("newton", "inexact"), ("linear", "cg"), ("tolerance", "1e-6")],
    &[("newton", "inexact"), ("linear", "cg"), ("start", "tangent")],
    &[("linear", "cg"), ("start", "tangent")],
    &[("linear", "cg"), ("tolerance", "1e-6")],
    &[("level", "fast"), ("start", "tangent")],
    &[("level", "fast"), ("start", "tangent"), ("tolerance", "1e-6")],
    &[("method", "midpoint"), ("step", "0.1")],
    &[("method", "midpoint"), ("step", "0.4")],
    &[("level", "strict"), ("step", "0.95")],
];

/// More settings than this are refused.
pub const MOST_SETTINGS: usize = 200;

/// What the scene's own setting and that of the defaults are called.
pub const OWN: &str = "scene";
/// See [`OWN`].
pub const DEFAULT: &str = "default";

/// A way to solve the scene.
#[derive(Debug)]
pub struct Setting {
    /// `linear=cg tolerance=1e-6`, [`OWN`] or [`DEFAULT`].
    pub name: String,
    /// What is set in the scene for it, `solver.linear=cg`.
    pub overrides: Vec<String>,
    /// Whether the answer is to the scene's own question.
    pub changes: Changes,
    /// The scene with it.
    pub case: Case,
}

/// Axes that this scene has: their keys stand in its resolved text, and say something of it.
pub fn available(resolved: &str) -> Vec<&'static Axis> {
    let document: toml::Table = toml::from_str(resolved).unwrap_or_default();
    let other = match document.contains_key("motion") {
        true => Scenes::Equilibria,
        false => Scenes::Motions,
    };
    let is_here = |axis: &&Axis| axis.scenes != other && word_of(resolved, axis.key).is_some();
    AXES.iter().filter(is_here).collect()
}

/// The overrides of the reference run, all but the tolerance.
pub fn reference_overrides(resolved: &str) -> Vec<String> {
    let fixed = available(resolved).into_iter().filter(|axis| !axis.reference.is_empty());
    fixed.map(|axis| format!("{}={}", axis.key, axis.reference)).collect()
}

/// The value of a key `table.key` in a resolved scene, without quotes.
pub fn word_of(resolved: &str, key: &str) -> Option<String> {
    let (table, key) = key.split_once('.')?;
    let document: toml::Table = toml::from_str(resolved).ok()?;
    let value = document.get(table)?.get(key)?;
    Some(match value {
        toml::Value::String(text) => text.clone(),
        other => other.to_string(),
    })
}

/// Whether two words mean the same value of a scene.
fn same_word(one: &str, other: &str) -> bool {
    match (one.parse::<f64>(), other.parse::<f64>()) {
        (Ok(x), Ok(y)) => x == y,
        _ => one == other,
    }
}

/// A word of an axis, or a value that the user wants tried.
#[derive(Clone, Debug)]
struct Choice {
    /// `tolerance=1e-6`.
    name: String,
    /// What is set in the scene for it.
    overrides: Vec<String>,
    changes: Changes,
    /// Whether the user named it: then it must be one that the scene's reader knows.
    is_given: bool,
}

impl Choice {
    fn of(axis: &Axis, word: &str) -> Choice {
        let beside = axis.beside.iter().map(|set| set.to_string());
        let own = format!("{}={word}", axis.key);
        Choice {
            name: format!("{}={word}", axis.name),
            overrides: beside.chain([own]).collect(),
            changes: axis.changes,
            is_given: false,
        }
    }

    /// All values of `material.potential=one,other`; another key asks another question.
    fn given(text: &str) -> Result<Vec<Choice>, TradeError> {
        let wrong = || TradeError::WrongVariation { text: text.to_string() };
        let (key, values) = text.split_once('=').ok_or_else(wrong)?;
        let name = key.rsplit('.').next().unwrap_or(key);
        let values = separate(values);
        if key.is_empty() || values.iter().any(|value| value.is_empty()) {
            return Err(wrong());
        }
        let choice = |value: &str| Choice {
            name: format!("{name}={value}"),
            overrides: vec![format!("{key}={value}")],
            changes: Changes::Question,
            is_given: true,
        };
        Ok(values.into_iter().map(choice).collect())
    }
}

/// The parts between commas that stand in no brackets and no quotes.
pub(crate) fn separate(text: &str) -> Vec<&str> {
    let (mut depth, mut quoted, mut start) = (0, false, 0);
    let mut parts = Vec::new();
    for (place, byte) in text.bytes().enumerate() {
        match byte {
            b'"' => quoted = !quoted,
            b'[' | b'{' | b'(' if !quoted => depth += 1,
            b']' | b'}' | b')' if !quoted => depth -= 1,
            b',' if !quoted && depth == 0 => {
                parts.push(text[start..place].trim());
                start = place + 1;
            }
            _ => {}
        }
    }
    parts.push(text[start..].trim());
    parts
}

/// The settings of a study, the scene's own first; two that read to one scene count once, and a
/// word of an axis that the scene's reader does not know is left out.
///
/// With nothing named: the defaults, every usual axis changed alone, and [`COMBINATIONS`]. Else every
/// combination of the words of `axes` and of the values of `varied`, `KEY=VALUE,VALUE`.
///
/// # Errors
/// An axis that there is not; too many settings; values that the scene does not take; the scene itself.
pub fn settings(
    read: &ReadCase<'_>,
    axes: &[String],
    varied: &[String],
) -> Result<Vec<Setting>, TradeError> {
    let own = read(&[])?;
    let resolved = own.scene.resolved_toml();
    let available = available(&resolved);
    let mut wanted = if axes.is_empty() && varied.is_empty() {
        usual(&available, &resolved)
    } else {
        let of_axis = |axis: &Axis| -> Vec<Choice> {
            let words = other_words(axis, &resolved);
            words.into_iter().map(|word| Choice::of(axis, word)).collect()
        };
        let known = chosen(&available, axes)?.into_iter().map(|axis| Ok(of_axis(axis)));
        let given = varied.iter().map(|text| Choice::given(text));
        product(&known.chain(given).collect::<Result<Vec<_>, TradeError>>()?)?
    };
    // What is slow comes last: the budget may end before.
    wanted.sort_by_key(|all| all.iter().any(|choice| choice.name.starts_with("derivatives=")));
    let defaults: Vec<Choice> = available
        .iter()
        .filter(|axis| axis.changes == Changes::Solution && !axis.default.is_empty())
        .map(|axis| Choice::of(axis, axis.default))
        .collect();
    let mut settings = vec![Setting {
        name: OWN.to_string(),
        overrides: Vec::new(),
        changes: Changes::Solution,
        case: own,
    }];
    let wanted = wanted.into_iter().map(|all| (None, all));
    for (name, all) in [(Some(DEFAULT), defaults)].into_iter().chain(wanted) {
        let overrides: Vec<String> =
            all.iter().flat_map(|choice| choice.overrides.iter().cloned()).collect();
        let case = match read(&overrides) {
            Ok(case) => case,
            Err(error) if all.iter().any(|choice| choice.is_given) => return Err(error.into()),
            Err(_) => continue,
        };
        if settings.iter().any(|other| other.case.scene == case.scene) {
            continue;
        }
        let question = all.iter().any(|choice| choice.changes == Changes::Question);
        settings.push(Setting {
            name: name.map_or_else(|| name_of(&all), str::to_string),
            overrides,
            changes: if question { Changes::Question } else { Changes::Solution },
            case,
        });
    }
    Ok(settings)
}

/// The setting with looser tolerances, the loosest first; those of [`AXES`].
pub fn relaxed(read: &ReadCase<'_>, setting: &Setting) -> Vec<Setting> {
    let own = setting.case.scene.solver.tolerance;
    let value = |word: &str| word.parse().unwrap_or(0.0);
    let others = |prefix: &str, parts: &[&str]| -> Vec<String> {
        parts.iter().filter(|part| !part.starts_with(prefix)).map(|part| part.to_string()).collect()
    };
    let with = |axis: &Axis, word: &str| {
        let words: Vec<&str> = setting.name.split(' ').collect();
        let mut name = others("tolerance=", &words);
        name.push(format!("tolerance={word}"));
        let set: Vec<&str> = setting.overrides.iter().map(String::as_str).collect();
        let mut overrides = others("solver.tolerance=", &set);
        overrides.push(format!("{}={word}", axis.key));
        let case = read(&overrides).ok()?;
        Some(Setting { name: name.join(" "), overrides, changes: setting.changes, case })
    };
    let Some(axis) = AXES.iter().find(|axis| axis.name == "tolerance") else { return Vec::new() };
    let mut looser: Vec<&str> =
        (axis.words)().into_iter().filter(|word| value(word) > own).collect();
    looser.sort_by(|p, q| f64::total_cmp(&value(q), &value(p)));
    looser.into_iter().filter_map(|word| with(axis, word)).collect()
}

fn name_of(all: &[Choice]) -> String {
    let parts: Vec<&str> = all.iter().map(|choice| choice.name.as_str()).collect();
    parts.join(" ")
}

fn chosen(available: &[&'static Axis], names: &[String]) -> Result<Vec<&'static Axis>, TradeError> {
    let find = |name: &String| {
        available.iter().copied().find(|axis| axis.name == *name).ok_or_else(|| {
            let known = available.iter().map(|axis| axis.name.to_string()).collect();
            TradeError::UnknownAxis { name: name.clone(), known }
        })
    };
    let mut axes: Vec<&'static Axis> = Vec::new();
    for name in names {
        let axis = find(name)?;
        if !axes.iter().any(|other| other.name == axis.name) {
            axes.push(axis);
        }
    }
    Ok(axes)
}

/// Words of an axis that differ from the scene's own.
fn other_words(axis: &Axis, resolved: &str) -> Vec<&'static str> {
    let own = word_of(resolved, axis.key).unwrap_or_default();
    (axis.words)().into_iter().filter(|word| !same_word(word, &own)).collect()
}

fn usual(available: &[&'static Axis], resolved: &str) -> Vec<Vec<Choice>> {
    let mut all: Vec<Vec<Choice>> = Vec::new();
    for axis in available.iter().filter(|axis| axis.usual) {
        let words = other_words(axis, resolved).into_iter();
        all.extend(words.map(|word| vec![Choice::of(axis, word)]));
    }
    for row in COMBINATIONS {
        let find = |name: &str| available.iter().find(|axis| axis.name == name);
        let choices: Option<Vec<Choice>> =
            row.iter().map(|(name, word)| find(name).map(|axis| Choice::of(axis, word))).collect();
        all.extend(choices);
    }
    all
}

/// Every combination of some choices, the scene's own among them.
fn product(choices: &[Vec<Choice>]) -> Result<Vec<Vec<Choice>>, TradeError> {
    let found = choices.iter().map(|words| words.len() + 1).product::<usize>();
    if found > MOST_SETTINGS {
        return Err(TradeError::TooManySettings { found, limit: MOST_SETTINGS });
    }
    let mut all: Vec<Vec<Choice>> = vec![Vec::new()];
    for words in choices {
        let shorter = all.clone();
        for word in words {
            let longer =
                |before: &Vec<Choice>| [before.as_slice(), std::slice::from_ref(word)].concat();
            all.extend(shorter.iter().map(longer));
        }
    }
    all.retain(|words| !words.is_empty());
    Ok(all)
}
