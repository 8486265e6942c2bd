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
use crate::scene::{DerivativeSource, StrainSource};

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

/// What is set in a scene for words of axes.
fn overrides(words: &[(&'static Axis, &'static str)]) -> Vec<String> {
    let beside = words.iter().flat_map(|(axis, _)| axis.beside).map(|set| set.to_string());
    let own = words.iter().map(|(axis, word)| format!("{}={word}", axis.key));
    beside.chain(own).collect()
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

/// Words to be set, each with its axis.
type Pairs = Vec<(&'static Axis, &'static str)>;

/// The settings of a study, the scene's own first; two that read to one scene count once, and a
/// word that the scene's reader does not know is left out.
///
/// Without `axes`: the defaults, every usual axis changed alone, and [`COMBINATIONS`]. With `axes`:
/// every combination of their words.
///
/// # Errors
/// An axis that there is not; too many settings; the scene itself.
pub fn settings(read: &ReadCase<'_>, axes: &[String]) -> Result<Vec<Setting>, TradeError> {
    let own = read(&[])?;
    let resolved = own.scene.resolved_toml();
    let available = available(&resolved);
    let wanted = if axes.is_empty() {
        usual(&available, &resolved)
    } else {
        product(&chosen(&available, axes)?, &resolved)?
    };
    // What is slow comes last: the budget may end before.
    let mut wanted = wanted;
    wanted.sort_by_key(|words| words.iter().any(|(axis, _)| axis.name == "derivatives"));
    let defaults: Pairs = available
        .iter()
        .filter(|axis| axis.changes == Changes::Solution && !axis.default.is_empty())
        .map(|axis| (*axis, axis.default))
        .collect();
    let mut settings = vec![Setting {
        name: OWN.to_string(),
        overrides: Vec::new(),
        changes: Changes::Solution,
        case: own,
    }];
    for (name, words) in
        [(Some(DEFAULT), defaults)].into_iter().chain(wanted.into_iter().map(|words| (None, words)))
    {
        let overrides = overrides(&words);
        let Ok(case) = read(&overrides) else { continue };
        if settings.iter().any(|other| other.case.scene == case.scene) {
            continue;
        }
        let question = words.iter().any(|(axis, _)| axis.changes == Changes::Question);
        settings.push(Setting {
            name: name.map_or_else(|| name_of(&words), str::to_string),
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

fn name_of(words: &Pairs) -> String {
    let parts: Vec<String> =
        words.iter().map(|(axis, word)| format!("{}={word}", axis.name)).collect();
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
fn other_words(axis: &'static Axis, resolved: &str) -> Vec<&'static str> {
    let own = word_of(resolved, axis.key).unwrap_or_default();
    (axis.words)().into_iter().filter(|word| !same_word(word, &own)).collect()
}

fn usual(available: &[&'static Axis], resolved: &str) -> Vec<Pairs> {
    let mut all: Vec<Pairs> = Vec::new();
    for axis in available.iter().copied().filter(|axis| axis.usual) {
        all.extend(other_words(axis, resolved).into_iter().map(|word| vec![(axis, word)]));
    }
    for row in COMBINATIONS {
        let find = |name: &str| available.iter().copied().find(|axis| axis.name == name);
        let words: Option<Pairs> =
            row.iter().map(|&(name, word)| find(name).map(|axis| (axis, word))).collect();
        all.extend(words);
    }
    all
}

/// Every combination of the words of some axes, the scene's own among them.
fn product(axes: &[&'static Axis], resolved: &str) -> Result<Vec<Pairs>, TradeError> {
    let choices: Vec<Vec<&'static str>> =
        axes.iter().map(|axis| other_words(axis, resolved)).collect();
    let found = choices.iter().map(|words| words.len() + 1).product::<usize>();
    if found > MOST_SETTINGS {
        return Err(TradeError::TooManySettings { found, limit: MOST_SETTINGS });
    }
    let mut all: Vec<Pairs> = vec![Vec::new()];
    for (axis, words) in axes.iter().zip(&choices) {
        let shorter = all.clone();
        for word in words {
            all.extend(
                shorter.iter().map(|before| [before.as_slice(), &[(*axis, *word)]].concat()),
            );
        }
    }
    all.retain(|words| !words.is_empty());
    Ok(all)
}
