//! The history of a bond for people.

use std::fmt::{self, Display, Formatter};

use super::{BondCondition, BondHistory, BondRow};

/// Rows of a table for people, at most, beside those that matter.
const MOST_ROWS: usize = 30;

impl BondCondition {
    /// `` `l/L - 1 > s0` (critical stretch) of steel ``.
    fn name(&self) -> String {
        let reason = self.reason.as_ref().map_or(String::new(), |reason| format!(" ({reason})"));
        let of = self.of.as_ref().map_or(String::new(), |of| format!(" of {of}"));
        format!("`{}`{reason}{of}", self.text)
    }
}

impl Display for BondHistory {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let [p, q] = &self.points;
        writeln!(f, "the bond of {p} and {q}")?;
        writeln!(
            f,
            "{:e} m long at rest, within the horizon of {:e} m",
            self.length_at_rest, self.horizon
        )?;
        self.write_materials(f)?;
        for (number, condition) in self.conditions.iter().enumerate() {
            writeln!(f, "margin {}: it breaks when {}", number + 1, condition.name())?;
        }
        writeln!(f)?;
        self.write_rows(f)?;
        writeln!(f, "\n{}", self.verdict())
    }
}

impl BondHistory {
    fn write_materials(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let [Some(p), Some(q)] = self.points.each_ref().map(|point| point.material.as_ref()) else {
            return Ok(());
        };
        let mut laws: Vec<&str> = Vec::new();
        for of in self.conditions.iter().filter_map(|condition| condition.of.as_deref()) {
            if !laws.contains(&of) {
                laws.push(of);
            }
        }
        let whose = match &laws[..] {
            [] => "no conditions".to_owned(),
            [one] => format!("the conditions of {one}"),
            all => format!("the conditions of {}, any of which is enough", all.join(" and ")),
        };
        match p == q {
            true => writeln!(f, "its points are of {p}; it takes {whose}"),
            false => writeln!(f, "its points are of {p} and {q}; it takes {whose}"),
        }
    }

    fn write_rows(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut names: Vec<String> = ["t", "length", "stretch"].map(str::to_owned).to_vec();
        names.extend((1..=self.conditions.len()).map(|number| format!("margin {number}")));
        names.extend(self.states.iter().cloned());
        names.extend(["energy", "broken"].map(str::to_owned));
        let line = |cells: &[String]| {
            let cells: Vec<String> = cells.iter().map(|cell| format!("{cell:>12}")).collect();
            cells.join(" ")
        };
        writeln!(f, "{}", line(&names))?;
        let shown = self.shown();
        for row in &shown {
            let numbers = [row.t, row.length, row.stretch].into_iter();
            let numbers = numbers.chain(row.margins.iter().copied());
            let numbers = numbers.chain(row.states.iter().copied()).chain([row.energy]);
            let mut cells: Vec<String> = numbers.map(|x| format!("{x:.4e}")).collect();
            cells.push(if row.broken { "yes" } else { "no" }.to_owned());
            writeln!(f, "{}", line(&cells))?;
        }
        if shown.len() < self.rows.len() {
            let (some, all) = (shown.len(), self.rows.len());
            writeln!(f, "{some} of {all} rows; --format json has all")?;
        }
        Ok(())
    }

    /// Rows spread evenly, the first and the last, and those around where the bond broke.
    fn shown(&self) -> Vec<&BondRow> {
        let stride = self.rows.len().div_ceil(MOST_ROWS).max(1);
        let first_broken = self.rows.iter().position(|row| row.broken);
        let is_shown = |number: &usize| {
            number.is_multiple_of(stride)
                || number + 1 == self.rows.len()
                || first_broken.is_some_and(|first| *number == first || number + 1 == first)
        };
        (0..self.rows.len()).filter(is_shown).map(|number| &self.rows[number]).collect()
    }

    /// Why it broke, or did not, in sentences.
    pub fn verdict(&self) -> String {
        let unit = if self.is_motion { " s" } else { "" };
        let mut text = match (&self.broke, &self.unbreakable, &self.largest) {
            (Some(broke), ..) => {
                let by: Vec<String> = broke
                    .conditions
                    .iter()
                    .map(|k| {
                        let margin = broke.row.margins[*k];
                        format!("{}, its margin {margin:e}", self.conditions[*k].name())
                    })
                    .collect();
                let by = match by.is_empty() {
                    true => "at its threshold, by the choice of an event".to_owned(),
                    false => format!("by {}", by.join(", and by ")),
                };
                format!("It broke at t = {:e}{unit}, {by}.", broke.t)
            }
            (None, Some(set), _) => {
                format!(
                    "It did not break, and cannot: a point of it is of the set `{set}`, which is unbreakable."
                )
            }
            (None, None, None) => "It did not break: no condition is about it.".to_owned(),
            (None, None, Some(_)) => "It did not break.".to_owned(),
        };
        if let (None, Some(largest)) = (&self.broke, &self.largest) {
            let share = largest.share.map_or(String::new(), |share| {
                format!(": {:.4} of the way from rest to the threshold was made", share)
            });
            text += &format!(
                " Its margin was largest at t = {:e}{unit}, {:e} by {}{share}.",
                largest.t,
                largest.margin,
                self.conditions[largest.condition].name()
            );
        }
        if !self.ended.1.is_empty() {
            let t = self.rows.last().map_or(0.0, |row| row.t);
            text += &format!(" The run came to t = {t:e}{unit} only: {}.", self.ended.1);
        }
        text
    }

    /// All of it for programs, in SI units.
    pub fn json(&self) -> serde_json::Value {
        let mut json = serde_json::json!(self);
        json["ended"] = serde_json::json!({ "reason": self.ended.0, "message": self.ended.1 });
        json["verdict"] = serde_json::json!(self.verdict());
        json
    }
}
