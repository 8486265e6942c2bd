//! What follows from a study: which setting is cheap and accurate enough, and how the scene's own
//! and the defaults do.

use super::axes::{Changes, DEFAULT, OWN};
use super::front::Standing;
use super::outcome::{Measured, Outcome};
use super::{Quantity, Reference, Resolution};

/// An arithmetic error of this part of the discretisation error cannot be seen.
const VISIBLE: f64 = 0.1;

/// Settings with up to this many times the least error count as accurate as the best.
const AS_GOOD: f64 = 10.0;

/// What a setting must reach.
#[derive(Clone, Debug, PartialEq)]
pub enum Demand {
    /// A tenth of the discretisation error of each quantity that has an estimate.
    Resolution(Vec<Option<f64>>),
    /// The relative error that the user named, for every quantity.
    Accuracy(f64),
    /// Ten times the least error of all settings: nothing else is known.
    Best(f64),
}

impl Demand {
    /// What it is, in words.
    pub fn words(&self) -> String {
        match self {
            Demand::Resolution(_) => "arithmetic error <= 0.1 of the discretisation error".into(),
            Demand::Accuracy(error) => format!("error <= {error:.1e}, as asked for"),
            Demand::Best(error) => format!(
                "error <= {error:.1e}, ten times the least: the discretisation error is unknown"
            ),
        }
    }

    /// Whether these errors reach it.
    pub fn is_met(&self, errors: &[f64], worst: f64) -> bool {
        match self {
            Demand::Resolution(limits) => limits
                .iter()
                .zip(errors)
                .all(|(limit, error)| limit.is_none_or(|limit| *error <= limit)),
            Demand::Accuracy(limit) | Demand::Best(limit) => worst <= *limit,
        }
    }
}

/// How a setting compares with the fastest one that is as accurate as the best.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// The setting's index.
    pub setting: usize,
    /// Which setting dominates it, if one does.
    pub dominated_by: Option<usize>,
    /// Its median time over that of the fastest setting with at most ten times the least error.
    pub ratio: f64,
}

/// What follows from a study; settings by their indices.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// What is accurate enough.
    pub demand: Demand,
    /// The fastest setting that is, by median.
    pub cheapest: Option<usize>,
    /// The fastest setting with at most ten times the least error.
    pub as_good: Option<usize>,
    /// The scene's own setting, and that of the defaults where it differs.
    pub assessed: Vec<Assessment>,
}

/// Draws the conclusions. `accuracy` is the error that the user calls small enough, if any.
pub fn verdict(
    outcomes: &[Outcome],
    quantities: &[Quantity],
    reference: &Reference,
    resolution: &Resolution,
    accuracy: Option<f64>,
) -> Verdict {
    let measured: Vec<(usize, &Measured)> = outcomes
        .iter()
        .enumerate()
        .filter(|(_, outcome)| outcome.setting.changes == Changes::Solution)
        .filter_map(|(index, outcome)| Some((index, outcome.result.as_ref().ok()?)))
        .collect();
    let least = measured.iter().map(|(_, m)| m.worst).fold(f64::INFINITY, f64::min);
    let good_enough = AS_GOOD * least.max(reference.level);
    let fastest = |fits: &dyn Fn(&Measured) -> bool| {
        let fitting = measured.iter().filter(|(_, m)| fits(m));
        fitting.min_by(|(_, p), (_, q)| p.times.median.total_cmp(&q.times.median)).map(|(i, _)| *i)
    };
    let hidden: Vec<Option<f64>> = quantities
        .iter()
        .zip(&resolution.errors)
        .map(|(quantity, error)| {
            error.filter(|_| *quantity != Quantity::Residual).map(|error| VISIBLE * error)
        })
        .collect();
    let demand = match accuracy {
        Some(accuracy) => Demand::Accuracy(accuracy),
        None if hidden.iter().any(Option::is_some) => Demand::Resolution(hidden),
        None => Demand::Best(good_enough),
    };
    let cheapest = fastest(&|m| demand.is_met(&m.errors, m.worst));
    let as_good = fastest(&|m| m.worst <= good_enough);
    let time =
        |index: usize| measured.iter().find(|(i, _)| *i == index).map(|(_, m)| m.times.median);
    let assess = |(index, m): &(usize, &Measured)| {
        Some(Assessment {
            setting: *index,
            dominated_by: match m.standing {
                Some(Standing::Dominated(by)) => Some(by),
                _ => None,
            },
            ratio: m.times.median / time(as_good?)?,
        })
    };
    let is_assessed =
        |index: usize| [OWN, DEFAULT].contains(&outcomes[index].setting.name.as_str());
    let assessed = measured.iter().filter(|(index, _)| is_assessed(*index)).filter_map(assess);
    Verdict { assessed: assessed.collect(), demand, cheapest, as_good }
}
