//! A study as text, CSV, JSON and a picture.

use std::fmt::Write as _;

use piola_output::picture::{Dot, DotKind, FrontPicture};
use piola_output::{OutputError, OutputFile, OutputFolder, decimal};
use serde_json::{Value, json};

use super::axes::{Changes, DEFAULT, OWN};
use super::front::Standing;
use super::outcome::{Measured, Outcome};
use super::study::Study;
use super::verdict::Demand;
use super::{Quantity, ROUNDOFF};
use crate::written::{field, number};

/// Characters of a reason in a table; the files have all of it.
const MOST_OF_A_REASON: usize = 100;

impl Study {
    /// Writes `trade.csv`, `trade.json`, `trade.svg` and `trade.png`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, folder: &OutputFolder, title: &str) -> Result<(), OutputError> {
        folder.write(OutputFile::TradeTable, self.to_csv().as_bytes())?;
        folder.write(OutputFile::TradeSummary, self.to_json(title).as_bytes())?;
        let picture = self.picture(title);
        folder.write(OutputFile::TradeSvg, picture.to_svg().as_bytes())?;
        folder.write(OutputFile::TradePng, &picture.to_png()?)
    }

    fn name(&self, index: usize) -> &str {
        &self.outcomes[index].setting.name
    }

    /// The settings that have numbers by time, then the others.
    fn sorted(&self) -> Vec<&Outcome> {
        let time = |outcome: &Outcome| {
            outcome.result.as_ref().map_or(f64::INFINITY, |measured| measured.times.median)
        };
        let mut sorted: Vec<&Outcome> = self.outcomes.iter().collect();
        sorted.sort_by(|p, q| time(p).total_cmp(&time(q)));
        sorted
    }

    fn standing_words(&self, measured: &Measured) -> String {
        match &measured.standing {
            Some(Standing::Front) => "front".to_string(),
            Some(Standing::Near) => "near".to_string(),
            Some(Standing::Dominated(by)) => format!("beaten by {}", self.name(*by)),
            None => "another body".to_string(),
        }
    }

    /// The discretisation error that any quantity has least.
    pub fn least_resolution(&self) -> Option<(&Quantity, f64)> {
        let known = self.quantities.iter().zip(&self.resolution.errors);
        known
            .filter_map(|(quantity, error)| Some((quantity, (*error)?)))
            .min_by(|(_, p), (_, q)| p.total_cmp(q))
    }

    /// The `[solver]` table of a setting, with all its keys; of a motion behind its `[motion]`.
    pub fn solver_toml(&self, index: usize) -> String {
        let resolved = self.outcomes[index].setting.case.scene.resolved_toml();
        let table = |header: &str| -> Option<String> {
            let lines = resolved.lines().skip_while(|line| *line != header);
            let table: Vec<&str> = lines.take_while(|line| !line.is_empty()).collect();
            (!table.is_empty()).then(|| table.join("\n") + "\n")
        };
        let tables: Vec<String> = ["[motion]", "[solver]"].into_iter().filter_map(table).collect();
        tables.join("\n")
    }

    fn is_of_motion(&self) -> bool {
        self.reference.course.moments.len() > 1
    }

    /// Tables and sentences for people.
    pub fn to_text(&self) -> String {
        let mut out = self.table();
        out.push('\n');
        self.write_background(&mut out);
        self.write_verdict(&mut out);
        out
    }

    fn table(&self) -> String {
        let widest = self.outcomes.iter().map(|o| o.setting.name.len()).max().unwrap_or(0).max(7);
        let names: Vec<String> = self.quantities.iter().map(Quantity::name).collect();
        let mut out = format!(
            "{:widest$} {:>9} {:>15} {:>4} {:>8}",
            "setting", "time, ms", "min..max", "runs", "worst"
        );
        for name in &names {
            let _ = write!(out, " {name:>w$}", w = name.len().max(8));
        }
        let counted = if self.is_of_motion() { "steps" } else { "its" };
        let _ = writeln!(out, " {counted:>9}  standing");
        for outcome in self.sorted() {
            let name = &outcome.setting.name;
            match &outcome.result {
                Ok(measured) => {
                    let times = measured.times;
                    let range = format!("{}..{}", millis(times.min), millis(times.max));
                    let _ = write!(
                        out,
                        "{name:widest$} {:>9} {range:>15} {:>4} {:>8}",
                        millis(times.median),
                        times.runs,
                        short(measured.worst)
                    );
                    for (error, name) in measured.errors.iter().zip(&names) {
                        let _ = write!(out, " {:>w$}", short(*error), w = name.len().max(8));
                    }
                    let iterations = match measured.linear_iterations {
                        0 if self.is_of_motion() => measured.steps.to_string(),
                        0 => measured.iterations.to_string(),
                        linear => format!("{}/{linear}", measured.iterations),
                    };
                    let _ = writeln!(out, " {iterations:>9}  {}", self.standing_words(measured));
                }
                Err(reason) => {
                    let line = reason.lines().next().unwrap_or_default();
                    let reason: String = line.chars().take(MOST_OF_A_REASON).collect();
                    let reason = if reason == line { reason } else { reason + " .." };
                    let _ = writeln!(out, "{name:widest$} failed: {reason}");
                }
            }
        }
        out
    }

    fn write_background(&self, out: &mut String) {
        let reference = &self.reference;
        let _ = writeln!(
            out,
            "Errors are relative to the reference: {}, {:.0} ms.",
            reference.overrides.join(", "),
            1e3 * reference.seconds
        );
        if reference.course.failure.is_some() {
            let values: Vec<String> = self
                .values_of_reference()
                .into_iter()
                .map(|(name, value, unit)| format!("{name} {value:.4e} {unit}").trim().to_string())
                .collect();
            let _ = writeln!(out, "The reference has {}.", values.join(", "));
        }
        let witnesses: Vec<String> = reference
            .witnesses
            .iter()
            .map(|(name, far)| format!("{name} {}", short(*far)))
            .collect();
        let witnesses =
            if witnesses.is_empty() { "none ran".to_string() } else { witnesses.join(", ") };
        let level = short(reference.level);
        let _ = if self.is_of_motion() {
            writeln!(
                out,
                "Errors are the largest of 20 times and the start, or of the whole motion where a quantity is \
                 one number of it. Below {level} there is the error of the \
                 reference: a run with twice its step differs from it by so much ({witnesses})."
            )
        } else {
            writeln!(
                out,
                "Below {level} there is only rounding: twice what equally exact runs differ from it \
                 ({witnesses}), at least 32 u."
            )
        };
        if let Some(error) = reference.displacement_error() {
            let _ = writeln!(
                out,
                "u*cond of the tangent, a bound for displacements: {}.",
                short(error)
            );
        }
        for alternate in &self.resolution.alternates {
            let named = self.quantities.iter().zip(&alternate.differences);
            let differences: Vec<String> = named
                .filter(|(_, difference)| difference.is_finite())
                .map(|(quantity, difference)| format!("{} {}", quantity.name(), short(*difference)))
                .collect();
            let _ = writeln!(
                out,
                "On a lattice of spacing {}, {:.3} in the same horizon, differ: {}.",
                decimal(alternate.spacing),
                alternate.ratio,
                differences.join(", ")
            );
        }
        for note in &self.resolution.notes {
            let _ = writeln!(out, "No estimate from another lattice: {note}.");
        }
        let errors = self.quantities.iter().zip(&self.resolution.errors);
        let errors: Vec<String> = errors
            .filter_map(|(quantity, error)| {
                Some(format!("{} {}", quantity.name(), short((*error)?)))
            })
            .collect();
        if !errors.is_empty() {
            let _ = writeln!(out, "Discretisation error, about: {}.", errors.join(", "));
        }
    }

    /// Of the quantities what the reference has at its end, with units.
    fn values_of_reference(&self) -> Vec<(String, f64, &'static str)> {
        let of = |quantity: &Quantity| {
            let (value, unit) = quantity.of(&self.reference.course)?;
            Some((quantity.name(), value, unit))
        };
        self.quantities.iter().filter_map(of).collect()
    }

    fn write_verdict(&self, out: &mut String) {
        let verdict = &self.verdict;
        for assessment in &verdict.assessed {
            let dominated = match assessment.dominated_by {
                Some(by) => format!("beaten by {}", self.name(by)),
                None => "not beaten beyond noise".to_string(),
            };
            let as_good = verdict.as_good.map_or("none", |index| self.name(index));
            let _ = writeln!(
                out,
                "`{}` is {dominated}; it takes {:.2} of the time of the fastest with an error of at most ten times the least, {as_good}.",
                self.name(assessment.setting),
                assessment.ratio
            );
        }
        let beaten = self.beaten();
        if !beaten.is_empty() {
            let _ = writeln!(out, "Beaten: {}.", beaten.join("; "));
        }
        match verdict.cheapest {
            Some(index) => {
                let _ = writeln!(
                    out,
                    "\n# the cheapest setting that is accurate enough ({}): {}\n{}",
                    verdict.demand.words(),
                    self.name(index),
                    self.solver_toml(index).trim_end()
                );
            }
            None => {
                let _ =
                    writeln!(out, "\nNo setting is accurate enough ({}).", verdict.demand.words());
            }
        }
    }

    /// The names of the settings that another beats.
    fn beaten(&self) -> Vec<&str> {
        let is_beaten = |outcome: &&Outcome| {
            let standing = outcome.result.as_ref().ok().and_then(|m| m.standing.as_ref());
            matches!(standing, Some(Standing::Dominated(_)))
        };
        self.outcomes.iter().filter(is_beaten).map(|o| o.setting.name.as_str()).collect()
    }

    /// `trade.csv`: a row for each setting.
    pub fn to_csv(&self) -> String {
        let mut out = "setting,changes,standing,median_s,min_s,max_s,runs,worst".to_string();
        for quantity in &self.quantities {
            let _ = write!(out, ",{}", field(&quantity.name()));
        }
        out.push_str(",steps,iterations,linear_iterations,cut_backs,overrides,reason\n");
        for outcome in self.sorted() {
            let setting = &outcome.setting;
            let overrides = field(&setting.overrides.join(" "));
            let _ = write!(out, "{},{}", field(&setting.name), setting.changes.word());
            match &outcome.result {
                Ok(m) => {
                    let t = m.times;
                    let standing = field(&self.standing_words(m));
                    let times = [t.median, t.min, t.max].map(decimal).join(",");
                    let _ = write!(out, ",{standing},{times},{},{}", t.runs, decimal(m.worst));
                    for error in &m.errors {
                        let _ = write!(out, ",{}", decimal(*error));
                    }
                    let counts = [m.steps, m.iterations, m.linear_iterations, m.cut_backs]
                        .map(|n| n.to_string());
                    let _ = writeln!(out, ",{},{overrides},", counts.join(","));
                }
                Err(reason) => {
                    let empty = ",".repeat(self.quantities.len() + 9);
                    let _ = writeln!(out, ",failed{empty},{overrides},{}", field(reason));
                }
            }
        }
        out
    }

    /// `trade.json`: everything.
    pub fn to_json(&self, title: &str) -> String {
        let reference = &self.reference;
        let names: Vec<String> = self.quantities.iter().map(Quantity::name).collect();
        let by_name = |values: &[f64]| -> Value {
            let pairs = names.iter().zip(values);
            pairs.map(|(name, value)| (name.clone(), number(*value))).collect()
        };
        let alternates: Vec<Value> = self
            .resolution
            .alternates
            .iter()
            .map(|a| {
                json!({
                    "spacing": number(a.spacing),
                    "spacings_in_horizon": number(a.ratio),
                    "seconds": number(a.seconds),
                    "differences": by_name(&a.differences),
                    "errors": by_name(&a.errors),
                })
            })
            .collect();
        let errors: Vec<f64> =
            self.resolution.errors.iter().map(|e| e.unwrap_or(f64::NAN)).collect();
        let settings: Vec<Value> =
            self.sorted().into_iter().map(|o| self.setting(o, &by_name)).collect();
        let value = json!({
            "scene": title,
            "quantities": names,
            "seconds": number(self.seconds),
            "reference": {
                "overrides": reference.overrides,
                "seconds": number(reference.seconds),
                "energy": number(reference.course.energy()),
                "values": self.values_of_reference().into_iter()
                    .map(|(name, value, _)| (name, number(value)))
                    .collect::<Value>(),
                "residual": number(reference.course.residual),
                "condition": reference.course.condition.map(number),
                "displacement_error": reference.displacement_error().map(number),
                "rounding_level": number(reference.level),
                "witnesses": reference
                    .witnesses
                    .iter()
                    .map(|(name, far)| (name.clone(), number(*far)))
                    .collect::<Value>(),
            },
            "discretisation": {
                "errors": by_name(&errors),
                "lattices": alternates,
                "notes": self.resolution.notes,
            },
            "settings": settings,
            "verdict": self.verdict_json(),
        });
        format!("{value:#}\n")
    }

    fn setting(&self, outcome: &Outcome, by_name: &dyn Fn(&[f64]) -> Value) -> Value {
        let setting = &outcome.setting;
        let mut value = json!({
            "name": setting.name,
            "overrides": setting.overrides,
            "changes": setting.changes.word(),
        });
        match &outcome.result {
            Ok(m) => {
                value["median_seconds"] = number(m.times.median);
                value["min_seconds"] = number(m.times.min);
                value["max_seconds"] = number(m.times.max);
                value["runs"] = json!(m.times.runs);
                value["worst"] = number(m.worst);
                value["errors"] = by_name(&m.errors);
                value["values"] = by_name(&m.values);
                value["standing"] = json!(match m.standing {
                    Some(Standing::Front) => "front",
                    Some(Standing::Near) => "near",
                    Some(Standing::Dominated(_)) => "dominated",
                    None => "other",
                });
                if let Some(Standing::Dominated(by)) = m.standing {
                    value["dominated_by"] = json!(self.name(by));
                }
                value["steps"] = json!(m.steps);
                value["iterations"] = json!(m.iterations);
                value["linear_iterations"] = json!(m.linear_iterations);
                value["cut_backs"] = json!(m.cut_backs);
            }
            Err(reason) => value["failed"] = json!(reason),
        }
        value
    }

    fn verdict_json(&self) -> Value {
        let verdict = &self.verdict;
        let name = |index: Option<usize>| index.map(|index| self.name(index).to_string());
        let assessed: Vec<Value> = verdict
            .assessed
            .iter()
            .map(|a| {
                json!({
                    "setting": self.name(a.setting),
                    "dominated_by": name(a.dominated_by),
                    "time_ratio": number(a.ratio),
                })
            })
            .collect();
        json!({
            "demand": verdict.demand.words(),
            "accuracy": match verdict.demand {
                Demand::Accuracy(error) | Demand::Best(error) => number(error),
                Demand::Resolution(_) => Value::Null,
            },
            "cheapest": name(verdict.cheapest),
            "solver": verdict.cheapest.map(|index| self.solver_toml(index)),
            "fastest_as_good_as_best": name(verdict.as_good),
            "assessed": assessed,
            "dominated": self.beaten(),
        })
    }

    /// The picture of the study.
    pub fn picture(&self, title: &str) -> FrontPicture {
        let dot = |outcome: &Outcome| {
            let measured = outcome.result.as_ref().ok()?;
            let times = measured.times;
            let kind = match &measured.standing {
                Some(Standing::Front) => DotKind::Front,
                Some(Standing::Near) => DotKind::Near,
                Some(Standing::Dominated(_)) => DotKind::Dominated,
                None if outcome.setting.changes == Changes::Question => DotKind::Question,
                None => return None,
            };
            let name = outcome.setting.name.clone();
            let marked = [OWN, DEFAULT].contains(&name.as_str());
            let times = [times.min, times.median, times.max];
            Some(Dot { name, times, error: measured.worst, kind, marked })
        };
        let mut lines = Vec::new();
        if let Some((quantity, error)) = self.least_resolution() {
            lines.push((format!("discretisation ({})", quantity.name()), error));
        }
        if let Some(error) = self.reference.displacement_error() {
            lines.push(("u*cond".to_string(), error));
        }
        let level = if self.is_of_motion() { "of the reference" } else { "rounding, measured" };
        lines.push((level.to_string(), self.reference.level));
        let compared: Vec<String> = self
            .quantities
            .iter()
            .filter(|quantity| **quantity != Quantity::Residual || self.quantities.len() == 1)
            .map(Quantity::name)
            .collect();
        FrontPicture {
            title: format!("{title}: what accuracy costs"),
            error: format!("largest error of {}", compared.join(", ")),
            dots: self.outcomes.iter().filter_map(dot).collect(),
            lines,
            least: ROUNDOFF,
        }
    }
}

fn millis(seconds: f64) -> String {
    let millis = 1e3 * seconds;
    if millis < 100.0 { format!("{millis:.1}") } else { format!("{millis:.0}") }
}

fn short(x: f64) -> String {
    if x == 0.0 { "0".to_string() } else { format!("{x:.1e}") }
}
