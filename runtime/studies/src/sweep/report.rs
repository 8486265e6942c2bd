//! The runs of a study as a table, as JSON and as a picture.

use std::fmt::Write as _;

use piola_output::picture::{SweepChart, SweepLine, SweepPicture};
use piola_output::{OutputError, OutputFile, OutputFolder, decimal};
use serde_json::{Map, Value, json};

use super::{Outcome, Row, Sweep, Variation};
use crate::simulation::{Course, NamedVector};
use crate::written::{field, number};

/// A number that runs lead to.
struct Column {
    /// Its name in tables, `left_x`.
    name: String,
    unit: &'static str,
    value: Box<dyn Fn(&Course) -> f64>,
}

/// A column whose values are a smaller part of the largest is one of rounding.
const ROUNDING: f64 = 1e-9;

/// Names of the components of a vector: of forces, of displacements.
const AXES: [&str; 3] = ["x", "y", "z"];
const COMPONENTS: [&str; 3] = ["u", "v", "w"];

impl Outcome {
    /// Its word in tables.
    pub fn word(&self) -> &'static str {
        match self {
            Outcome::Reached(_) => "reached",
            Outcome::NotConverged(_) => "not converged",
            Outcome::Refused(_) => "refused",
            Outcome::Interrupted => "interrupted",
        }
    }

    fn message(&self) -> &str {
        match self {
            Outcome::NotConverged(reason) | Outcome::Refused(reason) => reason,
            _ => "",
        }
    }

    fn course(&self) -> Option<&Course> {
        match self {
            Outcome::Reached(course) => Some(course),
            _ => None,
        }
    }
}

impl Sweep {
    /// How many runs ended so.
    pub fn count(&self, is_meant: impl Fn(&Outcome) -> bool) -> usize {
        self.rows.iter().filter(|row| is_meant(&row.outcome)).count()
    }

    /// Writes table, summary and picture.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn write(&self, folder: &OutputFolder, title: &str) -> Result<(), OutputError> {
        folder.write(OutputFile::SweepTable, self.to_csv().as_bytes())?;
        folder.write(OutputFile::SweepSummary, self.to_json(title).as_bytes())?;
        let picture = self.picture(title);
        folder.write(OutputFile::SweepSvg, picture.to_svg().as_bytes())?;
        folder.write(OutputFile::SweepPng, &picture.to_png()?)
    }

    /// What the runs lead to: of all the same, those of the first that reached its end.
    fn columns(&self) -> Vec<Column> {
        let Some(first) = self.rows.iter().find_map(|row| row.outcome.course()) else {
            return Vec::new();
        };
        let mut columns = vec![column("energy", "J", Course::energy)];
        let end = |course: &Course| course.moments.last().cloned().unwrap_or_default();
        if first.moments.len() > 1 {
            columns.push(column("kinetic", "J", move |course| end(course).kinetic));
        }
        let moment = end(first);
        for (place, set) in moment.reactions.iter().enumerate() {
            columns.extend(components(set, "", AXES, "N", move |course, axis| {
                end(course).reactions.get(place).map_or(f64::NAN, |set| set.value[axis])
            }));
        }
        for (place, probe) in moment.probes.iter().enumerate() {
            columns.extend(components(probe, "", COMPONENTS, "m", move |course, axis| {
                end(course).probes.get(place).map_or(f64::NAN, |probe| probe.value[axis])
            }));
        }
        if let Some(failure) = &first.failure {
            let of = |course: &Course| course.failure.clone().unwrap_or_default();
            columns.push(column("first_break", "s", move |course| of(course).first));
            columns.push(column("broken_bonds", "", move |course| of(course).bonds as f64));
            columns.push(column("released", "J", move |course| of(course).released));
            for place in 0..failure.peaks.len() {
                let name = format!("peak_{}", failure.peaks[place].name);
                columns.push(Column {
                    name,
                    unit: "N",
                    value: Box::new(move |course| {
                        of(course).peaks.get(place).map_or(f64::NAN, |peak| peak.value[0])
                    }),
                });
            }
        }
        columns
    }

    /// A table for people: the runs as lines.
    pub fn to_text(&self) -> String {
        let columns = self.columns();
        let mut lines: Vec<Vec<String>> = Vec::new();
        let varied = self.variations.iter().map(|variation| variation.name().to_string());
        let heads = columns.iter().map(|c| with_unit(&c.name, c.unit));
        let more = ["iterations", "s", "state"].map(String::from);
        lines.push(varied.chain(heads).chain(more).collect());
        for row in &self.rows {
            let mut line = row.values.clone();
            let course = row.outcome.course();
            line.extend(columns.iter().map(|c| {
                course
                    .map_or_else(|| "-".to_string(), |course| format!("{:.6e}", (c.value)(course)))
            }));
            line.push(course.map_or_else(|| "-".to_string(), |c| c.iterations.to_string()));
            line.push(format!("{:.2}", row.seconds));
            line.push(row.outcome.word().to_string());
            lines.push(line);
        }
        let mut out = aligned(&lines);
        for row in self.rows.iter().filter(|row| !row.outcome.message().is_empty()) {
            let _ = writeln!(out, "{}: {}", self.title_of(row), row.outcome.message());
        }
        let reached = self.count(|outcome| matches!(outcome, Outcome::Reached(_)));
        let _ = writeln!(
            out,
            "{reached} of {} runs reached their end, {:.2} s together",
            self.rows.len(),
            self.seconds
        );
        out
    }

    /// `C2 = 20, n = 2`
    pub fn title_of(&self, row: &Row) -> String {
        let parts = self.variations.iter().zip(&row.values);
        let parts: Vec<String> =
            parts.map(|(v, value)| format!("{} = {value}", v.name())).collect();
        parts.join(", ")
    }

    /// The table as CSV: the keys that were varied, what was found, how the run ended.
    pub fn to_csv(&self) -> String {
        let columns = self.columns();
        let mut heads: Vec<String> = self.variations.iter().map(|v| field(&v.key)).collect();
        heads.extend(columns.iter().map(|column| field(&column.name)));
        heads.extend(
            ["steps", "iterations", "residual", "seconds", "state", "message"].map(String::from),
        );
        let mut out = heads.join(",") + "\n";
        for row in &self.rows {
            let mut fields: Vec<String> = row.values.iter().map(|value| field(value)).collect();
            let course = row.outcome.course();
            let known = |value: &dyn Fn(&Course) -> String| course.map(value).unwrap_or_default();
            fields.extend(columns.iter().map(|c| known(&|course| decimal((c.value)(course)))));
            fields.push(known(&|course| course.steps.to_string()));
            fields.push(known(&|course| course.iterations.to_string()));
            fields.push(known(&|course| decimal(course.residual)));
            fields.push(decimal(row.seconds));
            fields.push(row.outcome.word().to_string());
            fields.push(field(row.outcome.message()));
            out += &(fields.join(",") + "\n");
        }
        out
    }

    /// Everything as JSON.
    pub fn to_json(&self, title: &str) -> String {
        let columns = self.columns();
        let varied: Vec<Value> =
            self.variations.iter().map(|v| json!({ "key": v.key, "values": v.values })).collect();
        let units: Map<String, Value> =
            columns.iter().map(|c| (c.name.clone(), json!(c.unit))).collect();
        let row = |row: &Row| {
            let values: Map<String, Value> = self
                .variations
                .iter()
                .zip(&row.values)
                .map(|(variation, value)| (variation.key.clone(), json!(value)))
                .collect();
            let mut out =
                json!({ "values": values, "state": row.outcome.word(), "seconds": row.seconds });
            if let Some(course) = row.outcome.course() {
                let found: Map<String, Value> =
                    columns.iter().map(|c| (c.name.clone(), number((c.value)(course)))).collect();
                out["found"] = Value::Object(found);
                out["steps"] = json!(course.steps);
                out["iterations"] = json!(course.iterations);
                out["residual"] = number(course.residual);
            } else {
                out["message"] = json!(row.outcome.message());
            }
            out
        };
        let rows: Vec<Value> = self.rows.iter().map(row).collect();
        let all = json!({
            "title": title,
            "varied": varied,
            "units": units,
            "rows": rows,
            "seconds": self.seconds,
        });
        format!("{all:#}\n")
    }

    /// Energy, reactions and probes against the values of the first key, a line for each combination of the
    /// others.
    pub fn picture(&self, title: &str) -> SweepPicture {
        let first = &self.variations[0];
        let numbers = first.numbers();
        let counts = numbers.is_none();
        let along = numbers.unwrap_or_else(|| (1..=first.values.len()).map(|k| k as f64).collect());
        let reached = self.count(|outcome| matches!(outcome, Outcome::Reached(_)));
        let mut charts: Vec<SweepChart> = Vec::new();
        let columns = self.columns();
        for (kind, unit) in [("energy", "J"), ("reaction", "N"), ("displacement", "m")] {
            let own: Vec<&Column> = columns
                .iter()
                .filter(|column| column.unit == unit && (unit != "J" || column.name == kind))
                .collect();
            let (which, lines) = self.lines(&own, &along);
            if !lines.is_empty() {
                let name = if which == kind { which } else { format!("{kind} {which}") };
                let name = name.trim_end().to_string();
                charts.push(SweepChart { name, unit: unit.to_string(), lines });
            }
        }
        if charts.is_empty() {
            let (name, unit) = ("energy".to_string(), "J".to_string());
            charts.push(SweepChart { name, unit, lines: Vec::new() });
        }
        let words = |counts: bool| {
            if counts {
                format!("{}: number of the value", first.name())
            } else {
                first.name().to_string()
            }
        };
        let mut note = format!("{reached} of {} runs reached their end", self.rows.len());
        if counts {
            let values = first.values.iter().enumerate().take(8);
            let named: Vec<String> =
                values.map(|(k, value)| format!("{} {value}", k + 1)).collect();
            let _ = write!(note, "; {}", named.join(", "));
        }
        SweepPicture {
            title: format!("{title}: {}", names(&self.variations)),
            varied: words(counts),
            counts,
            charts,
            note,
        }
    }

    /// A line per column, but for what is rounding beside the largest; where other keys are varied, too, one
    /// per combination of their values, of the column that changes most, which is named.
    fn lines(&self, columns: &[&Column], along: &[f64]) -> (String, Vec<SweepLine>) {
        let points = |column: &Column, rows: &[&Row]| -> Vec<(f64, f64)> {
            let place = |row: &Row| {
                let values = &self.variations[0].values;
                values
                    .iter()
                    .position(|value| *value == row.values[0])
                    .map_or(f64::NAN, |k| along[k])
            };
            let found = |row: &Row| row.outcome.course().map_or(f64::NAN, &column.value);
            let mut points: Vec<(f64, f64)> =
                rows.iter().map(|row| (place(row), found(row))).collect();
            points.sort_by(|p, q| p.0.total_cmp(&q.0));
            points
        };
        let all: Vec<&Row> = self.rows.iter().collect();
        let heights = |column: &Column| -> Vec<f64> {
            points(column, &all).into_iter().map(|p| p.1).filter(|y| y.is_finite()).collect()
        };
        let size =
            |column: &Column| heights(column).iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let largest = columns.iter().map(|column| size(column)).fold(0.0, f64::max);
        if self.variations.len() == 1 {
            let shown = columns.iter().filter(|column| size(column) > ROUNDING * largest);
            let line = |column: &&Column| SweepLine {
                name: column.name.clone(),
                points: points(column, &all),
            };
            return (String::new(), shown.map(line).collect());
        }
        let change = |column: &Column| {
            let heights = heights(column);
            let most = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            most - heights.iter().copied().fold(f64::INFINITY, f64::min)
        };
        let by_change = |p: &&&Column, q: &&&Column| change(p).total_cmp(&change(q));
        let Some(chosen) = columns.iter().max_by(by_change) else {
            return (String::new(), Vec::new());
        };
        let mut groups: Vec<(&[String], Vec<&Row>)> = Vec::new();
        for row in &self.rows {
            match groups.iter_mut().find(|(others, _)| *others == &row.values[1..]) {
                Some((_, rows)) => rows.push(row),
                None => groups.push((&row.values[1..], vec![row])),
            }
        }
        let line = |(others, rows): &(&[String], Vec<&Row>)| {
            let named = self.variations[1..].iter().zip(others.iter());
            let names: Vec<String> =
                named.map(|(v, value)| format!("{} {value}", v.name())).collect();
            SweepLine { name: names.join(", "), points: points(chosen, rows) }
        };
        (chosen.name.clone(), groups.iter().map(line).collect())
    }
}

fn names(variations: &[Variation]) -> String {
    let names: Vec<&str> = variations.iter().map(Variation::name).collect();
    names.join(", ")
}

fn column(name: &str, unit: &'static str, value: impl Fn(&Course) -> f64 + 'static) -> Column {
    Column { name: name.to_string(), unit, value: Box::new(value) }
}

/// A column for each component of a vector.
fn components(
    vector: &NamedVector,
    prefix: &str,
    names: [&'static str; 3],
    unit: &'static str,
    value: impl Fn(&Course, usize) -> f64 + Copy + 'static,
) -> Vec<Column> {
    let one = |axis: usize| Column {
        name: format!("{prefix}{}_{}", vector.name, names[axis]),
        unit,
        value: Box::new(move |course| value(course, axis)),
    };
    (0..vector.value.len().min(names.len())).map(one).collect()
}

fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_string() } else { format!("{name}, {unit}") }
}

/// Lines with their fields under each other, numbers to the right.
fn aligned(lines: &[Vec<String>]) -> String {
    let n = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width = |k: usize| lines.iter().filter_map(|l| l.get(k)).map(|f| f.chars().count()).max();
    let widths: Vec<usize> = (0..n).map(|k| width(k).unwrap_or(0)).collect();
    let mut out = String::new();
    for line in lines {
        let fields = line.iter().zip(&widths).enumerate();
        let padded: Vec<String> = fields
            .map(|(k, (field, width))| {
                if k + 1 == n { field.clone() } else { format!("{field:>width$}", width = *width) }
            })
            .collect();
        out += padded.join("  ").trim_end();
        out.push('\n');
    }
    out
}
