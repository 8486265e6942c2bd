//! Tables while they are filled.

use crate::record::{Bar, Cell, Division, Ratios, Row, Rows, Statistic, Table};

impl Table {
    /// A table of ratios without rows: how documents call it, how it is measured, the heads of the two
    /// columns of numbers with their unit, and which way they are divided.
    pub(crate) fn of_ratios(
        name: &str,
        how: impl Into<String>,
        columns: [&str; 2],
        ratio: Division,
    ) -> Table {
        let columns = columns.map(str::to_string);
        let rows = Rows::Ratios(Ratios { columns, ratio, rows: Vec::new() });
        Table { name: name.into(), how: how.into(), rows }
    }

    /// A table of any columns, without rows.
    pub(crate) fn plain(name: &str, how: impl Into<String>, columns: &[&str]) -> Table {
        let columns = columns.iter().map(|column| (*column).to_string()).collect();
        let rows = Rows::Plain { columns, rows: Vec::new() };
        Table { name: name.into(), how: how.into(), rows }
    }

    /// Adds a row of a table of ratios.
    pub(crate) fn ratio(
        &mut self,
        what: impl Into<String>,
        [ours, theirs]: [f64; 2],
        of: Statistic,
        bar: Bar,
    ) {
        let Rows::Ratios(ratios) = &mut self.rows else {
            unreachable!("{} is no table of ratios", self.name)
        };
        ratios.rows.push(Row { what: what.into(), ours, theirs, of, bar });
    }

    /// The same for a row that may stand there already: of both numbers the least of all runs counts.
    pub(crate) fn more_runs(
        &mut self,
        what: String,
        [ours, theirs]: [f64; 2],
        runs: usize,
        bar: Bar,
    ) {
        let Rows::Ratios(ratios) = &mut self.rows else {
            unreachable!("{} is no table of ratios", self.name)
        };
        match ratios.rows.iter_mut().find(|row| row.what == what) {
            Some(Row {
                ours: least, theirs: their_least, of: Statistic::Least(before), ..
            }) => {
                *least = least.min(ours);
                *their_least = their_least.min(theirs);
                *before += runs;
            }
            _ => self.ratio(what, [ours, theirs], Statistic::Least(runs), bar),
        }
    }

    /// Adds a row of a plain table.
    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        let Rows::Plain { rows, .. } = &mut self.rows else {
            unreachable!("{} is a table of ratios", self.name)
        };
        rows.push(cells.into_iter().collect());
    }
}

impl From<f64> for Cell {
    fn from(x: f64) -> Cell {
        Cell::Number(x)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}
