//! Tables: measured points in a file, and the curve through them.
//!
//! The curve is a cubic between two points, and straight beyond the first and the last. Its slopes at the
//! points are those of Fritsch and Carlson (SIAM J. Numer. Anal. 17, 1980) in the form of Fritsch and
//! Butland (SIAM J. Sci. Stat. Comput. 5, 1984): it rises and falls where the points do, and its slope is
//! continuous. It becomes choices between the numbers of its pieces, so that whatever reads a graph knows it.

use std::collections::HashMap;
use std::rc::Rc;

use piola_grammar::ast::{Ast, ExprId, ExprKind, Text};
use piola_grammar::{Diagnostic, Span, shortened};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::value::{IN_UNIT, Kind, Quantity, Value};
use super::{Files, MAX_FINDINGS};
use crate::expression::{Comparison, ExprGraph, Node, NodeId, Operator, TooManyNodes};
use crate::values::unit_product;

/// Most points of a table: the kernel of an energy holds a choice for each of them.
const MAX_ROWS: usize = 200;

/// Most tables of a potential.
const MAX_TABLES: usize = 100;

/// A column: what it measures and how many SI units one of its unit is.
type Column = (Dimension, f64);

/// Points in SI units with the slopes of the curve there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table {
    columns: [Column; 2],
    x: Vec<f64>,
    y: Vec<f64>,
    slopes: Vec<f64>,
}

/// The tables of a file, each read once; what is wrong with one is told where it is named first.
pub(super) fn read_all(
    ast: &Ast,
    files: Files<'_>,
    errors: &mut Vec<Diagnostic>,
) -> HashMap<String, Rc<Table>> {
    let mut tables = HashMap::new();
    let mut seen = Vec::new();
    for (_, expression) in ast.arena.iter() {
        let ExprKind::Table { file, .. } = &expression.kind else { continue };
        if seen.contains(&file.text.as_str()) || errors.len() >= MAX_FINDINGS {
            continue;
        }
        seen.push(&file.text);
        if seen.len() > MAX_TABLES {
            let message = format!("a potential has at most {MAX_TABLES} tables");
            errors.push(Diagnostic::error("too-large", file.span, message));
            break;
        }
        let read = match files(&file.text) {
            Ok(text) => Table::read(&file.text, &text),
            Err(reason) => Err(format!("cannot read {}: {reason}", shortened(&file.text))),
        };
        match read {
            Ok(table) => drop(tables.insert(file.text.clone(), Rc::new(table))),
            Err(message) => errors.push(wrong(file.span, message)),
        }
    }
    tables
}

fn wrong(span: Span, message: String) -> Diagnostic {
    Diagnostic::error("wrong-table", span, message).help(format!(
        "a table is a file at or below the folder of the potential, with 2 to {MAX_ROWS} lines \
         `x, y`, x ascending, under a line of names such as `strain [1], stress [MPa]`"
    ))
}

impl Table {
    /// Reads `x, y` line by line; blank lines and what follows `#` do not count. The first line may
    /// hold names, with units in brackets. Errors name the file, the line and the column.
    fn read(name: &str, text: &str) -> Result<Table, String> {
        let none = (Dimension::NONE, 1.0);
        let mut table = Table { columns: [none; 2], x: vec![], y: vec![], slopes: vec![] };
        let mut is_first = true;
        // Spreadsheets put a byte order mark in front.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or("");
            if line.trim().is_empty() {
                continue;
            }
            let at = |column: usize, what: String| {
                format!("{}:{}:{column}: {what}", shortened(name), number + 1)
            };
            let Some((left, right)) = line.split_once(',').filter(|(_, r)| !r.contains(',')) else {
                return Err(at(1, format!("`{}` is not `x, y`", shortened(line.trim()))));
            };
            let cells = [(left, 1), (right, left.chars().count() + 2)];
            // Names, not numbers that cannot be read.
            let is_name =
                |cell: &str| cell.trim_matches([' ', '\t', '"']).starts_with(char::is_alphabetic);
            if std::mem::take(&mut is_first) && is_name(left) && is_name(right) {
                for (column, (cell, place)) in table.columns.iter_mut().zip(cells) {
                    *column = unit_of(cell).map_err(|what| at(place, what))?;
                }
                continue;
            }
            let [x, y] = cells.map(|(cell, place)| match cell.trim().parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(at(place, format!("`{}` is not a finite number", shortened(cell.trim())))),
            });
            let (x, y) = (x? * table.columns[0].1, y? * table.columns[1].1);
            if let Some(last) = table.x.last().filter(|last| **last >= x) {
                return Err(at(1, format!("x is {x} here and {last} before: it must ascend")));
            }
            if table.x.len() == MAX_ROWS {
                return Err(at(1, format!("a table has at most {MAX_ROWS} points")));
            }
            table.x.push(x);
            table.y.push(y);
        }
        if table.x.len() < 2 {
            let n = table.x.len();
            return Err(format!("{}: a table has at least 2 points, not {n}", shortened(name)));
        }
        table.slopes = slopes(&table.x, &table.y);
        if !table.pieces().into_iter().flatten().all(f64::is_finite) {
            return Err(format!("{}: the curve has slopes that are not finite", shortened(name)));
        }
        Ok(table)
    }

    /// The numbers of every piece, beyond the points too: where `t` counts from, and the coefficients of
    /// 1, `t`, `t^2` and `t^3`. `t` counts from the end where the curve is nearer to 0: an energy that
    /// is 0 at a point keeps its digits on both sides of it.
    fn pieces(&self) -> Vec<[f64; 5]> {
        let straight = |k: usize| [self.x[k], self.y[k], self.slopes[k], 0.0, 0.0];
        let inside = |k: usize| {
            let width = self.x[k + 1] - self.x[k];
            let chord = (self.y[k + 1] - self.y[k]) / width;
            let (left, right) = (self.slopes[k], self.slopes[k + 1]);
            let cube = (left + right - 2.0 * chord) / (width * width);
            if self.y[k].abs() <= self.y[k + 1].abs() {
                [self.x[k], self.y[k], left, (3.0 * chord - 2.0 * left - right) / width, cube]
            } else {
                let square = (left + 2.0 * right - 3.0 * chord) / width;
                [self.x[k + 1], self.y[k + 1], right, square, cube]
            }
        };
        let last = self.x.len() - 1;
        let all = (0..last).map(inside);
        [straight(0)].into_iter().chain(all).chain([straight(last)]).collect()
    }

    /// The curve at `x`.
    fn curve(&self, graph: &mut ExprGraph, x: NodeId) -> Result<NodeId, TooManyNodes> {
        let [from, constant, slope, square, cube] = self.search(graph, x, 0, &self.pieces())?;
        let mut join = |operator, x, y| graph.intern(Node::Binary(operator, x, y));
        let t = join(Operator::Subtract, x, from)?;
        let mut sum = cube;
        for coefficient in [square, slope, constant] {
            let product = join(Operator::Multiply, t, sum)?;
            sum = join(Operator::Add, coefficient, product)?;
        }
        Ok(sum)
    }

    /// The numbers of the piece that holds `x`; the first of these pieces ends at point `at`. Numbers
    /// alone are chosen: they have no derivatives, and those of the curve cost no second search.
    fn search(
        &self,
        graph: &mut ExprGraph,
        x: NodeId,
        at: usize,
        pieces: &[[f64; 5]],
    ) -> Result<[NodeId; 5], TooManyNodes> {
        if let [only] = pieces {
            let mut numbers = [x; 5];
            for (number, value) in numbers.iter_mut().zip(only) {
                *number = graph.intern(Node::number(*value))?;
            }
            return Ok(numbers);
        }
        let (left, right) = pieces.split_at(pieces.len() / 2);
        let middle = at + left.len();
        let point = graph.intern(Node::number(self.x[middle - 1]))?;
        let condition = graph.intern(Node::Compare(Comparison::Less, x, point))?;
        let mut numbers = self.search(graph, x, at, left)?;
        for (number, other) in numbers.iter_mut().zip(self.search(graph, x, middle, right)?) {
            if *number != other {
                *number = graph.intern(Node::Select(condition, *number, other))?;
            }
        }
        Ok(numbers)
    }
}

/// The unit in the brackets of `stress [MPa]`; a column without brackets is of pure numbers.
fn unit_of(head: &str) -> Result<Column, String> {
    let Some((_, rest)) = head.split_once('[') else { return Ok((Dimension::NONE, 1.0)) };
    let unit = rest.split(']').next().unwrap_or("").trim();
    let known = unit_product(unit).filter(|(_, scale)| scale.is_normal());
    known.ok_or_else(|| format!("`{}` is not a unit", shortened(unit)))
}

/// The slopes at the points.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let widths: Vec<f64> = x.windows(2).map(|x| x[1] - x[0]).collect();
    let chords: Vec<f64> = y.windows(2).zip(&widths).map(|(y, h)| (y[1] - y[0]) / h).collect();
    if n == 2 {
        return vec![chords[0]; 2];
    }
    // At an end by three points, cut off where that would leave the points.
    let end = |k: [usize; 2]| {
        let ([h, h_next], [d, d_next]) = (k.map(|k| widths[k]), k.map(|k| chords[k]));
        let slope = ((2.0 * h + h_next) * d - h * d_next) / (h + h_next);
        if slope * d <= 0.0 {
            0.0
        } else if d * d_next <= 0.0 && slope.abs() > 3.0 * d.abs() {
            3.0 * d
        } else {
            slope
        }
    };
    let inside = |k: usize| {
        let (d, d_next) = (chords[k - 1], chords[k]);
        if d * d_next <= 0.0 {
            return 0.0;
        }
        let (w, w_next) = (2.0 * widths[k] + widths[k - 1], widths[k] + 2.0 * widths[k - 1]);
        (w + w_next) / (w / d + w_next / d_next)
    };
    let mut slopes = vec![end([0, 1])];
    slopes.extend((1..n - 1).map(inside));
    slopes.push(end([n - 2, n - 3]));
    slopes
}

impl Elaborator<'_> {
    /// `table("data.csv", x)`
    pub(super) fn table(
        &mut self,
        file: &Text,
        (x, at): (Value, ExprId),
        span: Span,
    ) -> Option<Value> {
        let quantity = self.number(x, at)?;
        let Some(table) = self.symbols.tables.get(&file.text).cloned() else {
            if self.ast.is_none() {
                let message = "expressions of a scene know no tables".to_string();
                self.report(Diagnostic::error("wrong-table", span, message));
            }
            return None;
        };
        let [wanted, found] = table.columns.map(|(dimension, _)| Quantity::Known(dimension));
        if wanted.unify(quantity).is_none() {
            let message = format!(
                "{} is read off at {}, this is {}",
                shortened(&file.text),
                wanted.describe(),
                quantity.describe()
            );
            let error = Diagnostic::error("dimension-mismatch", self.arena[at].span, message);
            self.report(
                error
                    .label("has another unit")
                    .help("the first line of the file may state units: `strain [1], stress [MPa]`"),
            );
            return None;
        }
        match table.curve(&mut self.graph, x.node) {
            Ok(node) => {
                let quantity = if self.checked { found } else { Quantity::Any };
                // Without dimensions parameters count in their own units, and a table in those of the SI.
                let has_units = table.columns.iter().any(|c| *c != (Dimension::NONE, 1.0));
                let uses = x.uses | if has_units && !self.checked { IN_UNIT } else { 0 };
                self.make(self.graph[node], Kind::Number(quantity), uses, span)
            }
            Err(TooManyNodes) => {
                self.out_of_room(span);
                None
            }
        }
    }
}

#[cfg(test)]
mod tests;
