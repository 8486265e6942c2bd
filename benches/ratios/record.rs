//! What was measured: as `docs/measured/ratios.json` keeps it, and as the documents show it.
//!
//! A document holds a table between `<!-- measured: NAME -->` and `<!-- end -->`. The text between is made
//! here from the record, by the benchmark and by the test that finds tables which were edited by hand.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Where the record lies, from the root.
pub(crate) const PATH: &str = "docs/measured/ratios.json";

/// The documents that show tables of the record, from the root.
pub(crate) const DOCUMENTS: [&str; 3] = [
    "docs/measured/performance.md",
    "docs/measured/accuracy.md",
    "docs/measured/correspondence.md",
];

/// The name of the table that says what the others were measured with.
pub(crate) const CIRCUMSTANCES: &str = "circumstances";

/// The last measurement of every section, by its name.
#[derive(Debug, Default, Deserialize, Serialize)]
pub(crate) struct Record {
    pub(crate) sections: BTreeMap<String, Section>,
}

/// Tables that were measured in one go.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct Section {
    pub(crate) circumstances: Circumstances,
    pub(crate) tables: Vec<Table>,
}

/// What a section was measured with.
#[derive(Clone, Debug, Deserialize, Eq, Ord, PartialEq, PartialOrd, Serialize)]
pub(crate) struct Circumstances {
    /// Its short name, and whether the code was changed since.
    pub(crate) commit: String,
    /// Year, month and day.
    pub(crate) date: String,
    pub(crate) processor: String,
    /// Threads that can run at once.
    pub(crate) processors: usize,
    /// Sets of vector instructions.
    pub(crate) vectors: Vec<String>,
    /// First lines of what compilers say of their version.
    pub(crate) compilers: Vec<String>,
}

/// A table with a line that says how it was measured.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct Table {
    /// What documents call it.
    pub(crate) name: String,
    pub(crate) how: String,
    pub(crate) rows: Rows,
}

/// What stands in a table.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Rows {
    /// Ours beside theirs.
    Ratios(Ratios),
    /// Anything else.
    Plain { columns: Vec<String>, rows: Vec<Vec<Cell>> },
}

/// Rows of two numbers and their ratio.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct Ratios {
    /// Heads of the two columns of numbers, with their unit.
    pub(crate) columns: [String; 2],
    /// Which way they are divided.
    pub(crate) ratio: Division,
    pub(crate) rows: Vec<Row>,
}

/// Which of the two numbers of a row stands above the other.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Division {
    /// Below 1 where ours is less.
    OursByTheirs,
    /// Above 1 where ours is less: how many times faster.
    TheirsByOurs,
}

/// Two numbers that are held against each other.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct Row {
    pub(crate) what: String,
    pub(crate) ours: f64,
    pub(crate) theirs: f64,
    pub(crate) of: Statistic,
    pub(crate) bar: Bar,
}

/// Of how many runs a number is the least, the same for both numbers of a row.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Statistic {
    /// The least of so many: what the least disturbed run took.
    Least(usize),
    /// The only run.
    Once,
}

/// What a ratio is held to.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Bar {
    /// At least the bar; better still the second number.
    AtLeast(f64, f64),
    /// At most the bar; better still the second number.
    AtMost(f64, f64),
    /// Nothing: shown for comparison.
    None,
}

/// An entry of a table that is not a ratio.
#[derive(Debug, Deserialize, Serialize)]
#[serde(untagged)]
pub(crate) enum Cell {
    /// Shown with three significant digits.
    Number(f64),
    Text(String),
}

impl Record {
    /// The document with all its tables as they are recorded, or what is wrong with it.
    pub(crate) fn render(&self, document: &str) -> Result<String, String> {
        let mut out = String::new();
        let mut rest = document;
        while let Some((before, after)) = rest.split_once("<!-- measured: ") {
            let (name, after) =
                after.split_once(" -->\n").ok_or("a mark of a table does not end in ` -->`")?;
            let (_, after) = after
                .split_once("<!-- end -->")
                .ok_or_else(|| format!("the table `{name}` has no `<!-- end -->`"))?;
            let text = self
                .text(name)
                .ok_or_else(|| format!("{PATH} has no table `{name}`: measure it"))?;
            out += &format!("{before}<!-- measured: {name} -->\n{text}<!-- end -->");
            rest = after;
        }
        Ok(out + rest)
    }

    fn text(&self, name: &str) -> Option<String> {
        if name == CIRCUMSTANCES {
            return Some(self.circumstances());
        }
        let mut tables = self.sections.values().flat_map(|section| &section.tables);
        tables.find(|table| table.name == name).map(Table::text)
    }

    /// Which sections were measured with what.
    fn circumstances(&self) -> String {
        let mut groups: BTreeMap<&Circumstances, Vec<&str>> = BTreeMap::new();
        for (name, section) in &self.sections {
            groups.entry(&section.circumstances).or_default().push(name);
        }
        let row = |(with, names): (&Circumstances, Vec<&str>)| {
            let sections = if groups_are_one(self) { "all".into() } else { names.join(", ") };
            format!(
                "| {sections} | {} | {} | {}, {} threads, {} | {} |\n",
                with.commit,
                with.date,
                with.processor,
                with.processors,
                with.vectors.join(", "),
                with.compilers.join("; ")
            )
        };
        let rows: String = groups.into_iter().map(row).collect();
        format!(
            "| sections | commit | date | processor | compilers |\n|---|---|---|---|---|\n{rows}"
        )
    }
}

/// Whether all sections were measured with the same.
fn groups_are_one(record: &Record) -> bool {
    let mut all = record.sections.values().map(|section| &section.circumstances);
    let first = all.next();
    all.all(|with| Some(with) == first)
}

impl Table {
    /// As it stands in a document.
    pub(crate) fn text(&self) -> String {
        let (columns, rows) = match &self.rows {
            Rows::Ratios(ratios) => {
                (ratios.heads(), ratios.rows.iter().map(|row| ratios.cells(row)).collect())
            }
            Rows::Plain { columns, rows } => {
                let cells = |row: &Vec<Cell>| row.iter().map(Cell::text).collect();
                (columns.clone(), rows.iter().map(cells).collect::<Vec<Vec<String>>>())
            }
        };
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = format!("|{}\n", "---|".repeat(columns.len()));
        let rows: String = rows.iter().map(|row| line(row)).collect();
        format!("{}\n\n{}{rule}{rows}", self.how, line(&columns))
    }
}

impl Ratios {
    fn heads(&self) -> Vec<String> {
        let [ours, theirs] = self.columns.clone();
        let bare = |head: &str| head.split(',').next().unwrap_or_default().to_string();
        let ratio = match self.ratio {
            Division::OursByTheirs => format!("{} / {}", bare(&ours), bare(&theirs)),
            Division::TheirsByOurs => format!("{} / {}", bare(&theirs), bare(&ours)),
        };
        let mut heads = vec!["what".into(), ours, theirs, ratio, "runs".into()];
        if self.has_bars() {
            heads.extend(["bar (stretch)".into(), String::new()]);
        }
        heads
    }

    fn cells(&self, row: &Row) -> Vec<String> {
        let ratio = self.ratio(row);
        let runs = match row.of {
            Statistic::Least(runs) => format!("least of {runs}"),
            Statistic::Once => "once".into(),
        };
        let mut cells =
            vec![row.what.clone(), number(row.ours), number(row.theirs), number(ratio), runs];
        if self.has_bars() {
            cells.extend([row.bar.text(), row.bar.verdict(ratio).into()]);
        }
        cells
    }

    fn has_bars(&self) -> bool {
        self.rows.iter().any(|row| !matches!(row.bar, Bar::None))
    }

    /// The ratio of the two numbers as they are shown, so that whoever divides them finds it.
    fn ratio(&self, row: &Row) -> f64 {
        let shown = |x: f64| number(x).parse().unwrap_or(x);
        let (ours, theirs) = (shown(row.ours), shown(row.theirs));
        match self.ratio {
            Division::OursByTheirs => ours / theirs,
            Division::TheirsByOurs => theirs / ours,
        }
    }
}

impl Bar {
    fn text(self) -> String {
        match self {
            Bar::AtLeast(bar, stretch) => format!(">= {bar} ({stretch})"),
            Bar::AtMost(bar, stretch) => format!("<= {bar} ({stretch})"),
            Bar::None => String::new(),
        }
    }

    fn verdict(self, ratio: f64) -> &'static str {
        let (bar, stretch) = match self {
            Bar::AtLeast(bar, stretch) => (ratio >= bar, ratio >= stretch),
            Bar::AtMost(bar, stretch) => (ratio <= bar, ratio <= stretch),
            Bar::None => return "",
        };
        match (bar, stretch) {
            (_, true) => "stretch met",
            (true, false) => "met",
            (false, false) => "**missed**",
        }
    }
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Cell::Number(x) => number(*x),
            Cell::Text(text) => text.clone(),
        }
    }
}

/// Three significant digits.
pub(crate) fn number(x: f64) -> String {
    if !x.is_finite() || x == 0.0 {
        return format!("{x}");
    }
    let digits = 2 - libm::floor(libm::log10(x.abs())) as i32;
    format!("{x:.*}", digits.clamp(0, 9) as usize)
}
