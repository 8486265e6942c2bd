//! A cell list: the neighbours of chunks of points.

use std::collections::HashMap;
use std::ops::Range;

use super::row::Span;
use super::{COINCIDENCE, HORIZON_TOLERANCE, distance_squared};
use crate::body::Body;

/// Rows of consecutive points, or of all: each a span of steps, which alike rows share.
#[derive(Default)]
pub(super) struct Rows {
    pub(super) steps: Vec<u32>,
    pub(super) spans: Vec<Span>,
    /// The span of every point.
    pub(super) of: Vec<u32>,
    /// The last span with a hash.
    known: HashMap<u64, u32>,
}

impl Rows {
    /// Room for so many points.
    pub(super) fn with_capacity(n: usize) -> Rows {
        Rows { of: Vec::with_capacity(n), ..Rows::default() }
    }

    /// The number of a row like this one, which is kept if there was none; `later` of its steps lead to later points.
    pub(super) fn number(&mut self, steps: &[u32], later: usize) -> u32 {
        let hash = steps.iter().fold(later as u64, |hash, step| {
            (hash.rotate_left(5) ^ u64::from(*step)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        if let Some(&number) = self.known.get(&hash) {
            let span = &self.spans[number as usize];
            if span.later() == later && &self.steps[span.all()] == steps {
                return number;
            }
        }
        let number = self.spans.len() as u32;
        self.known.insert(hash, number);
        self.spans.push(Span::new(self.steps.len(), steps.len(), later));
        self.steps.extend_from_slice(steps);
        number
    }
}

/// What a search has found for a chunk of points.
#[derive(Default)]
pub(super) struct Found {
    pub(super) rows: Rows,
    pub(super) shell_bonds: usize,
    /// The lowest pair of coincident points.
    pub(super) coincident: Option<(usize, usize)>,
}

/// Points sorted into cubes of at least the horizon's size.
pub(super) struct CellList {
    lower: Vec<f64>,
    size: f64,
    counts: [usize; 3],
    start: Vec<u32>,
    points: Vec<u32>,
}

impl CellList {
    pub(super) fn new(body: &Body, reach: f64) -> CellList {
        let d = body.dimension();
        let column = |axis: usize| body.positions().iter().skip(axis).step_by(d).copied();
        let lower: Vec<f64> = (0..d).map(|a| column(a).fold(f64::INFINITY, f64::min)).collect();
        let upper: Vec<f64> = (0..d).map(|a| column(a).fold(f64::NEG_INFINITY, f64::max)).collect();
        // Cells larger than the horizon are allowed: a sparse cloud must not fill the memory.
        let mut size = reach;
        let most = 8.0 * body.n_points() as f64 + 64.0;
        let along = |axis: usize, size: f64| ((upper[axis] - lower[axis]) / size).floor() + 1.0;
        while (0..d).map(|axis| along(axis, size)).product::<f64>() > most {
            size *= 2.0;
        }
        let mut counts = [1; 3];
        for axis in 0..d {
            counts[axis] = along(axis, size).max(1.0) as usize;
        }
        let mut cells =
            CellList { lower, size, counts, start: Vec::new(), points: vec![0; body.n_points()] };
        cells.sort(body);
        cells
    }

    /// Counting sort: within a cell, points keep their order.
    fn sort(&mut self, body: &Body) {
        let mut start = vec![0u32; self.counts.iter().product::<usize>() + 1];
        for point in 0..body.n_points() {
            start[self.index(self.cell(body.position(point))) + 1] += 1;
        }
        for cell in 1..start.len() {
            start[cell] += start[cell - 1];
        }
        let mut next = start.clone();
        for point in 0..body.n_points() {
            let slot = &mut next[self.index(self.cell(body.position(point)))];
            self.points[*slot as usize] = point as u32;
            *slot += 1;
        }
        self.start = start;
    }

    fn cell(&self, position: &[f64]) -> [usize; 3] {
        let mut cell = [0; 3];
        for axis in 0..position.len() {
            let place = ((position[axis] - self.lower[axis]) / self.size) as usize;
            cell[axis] = place.min(self.counts[axis] - 1);
        }
        cell
    }

    fn index(&self, cell: [usize; 3]) -> usize {
        (cell[0] * self.counts[1] + cell[1]) * self.counts[2] + cell[2]
    }

    /// The rows of the wanted among some points; those of others are empty.
    pub(super) fn search(
        &self,
        body: &Body,
        horizon: f64,
        points: Range<usize>,
        wanted: &impl Fn(usize) -> bool,
    ) -> Found {
        let mut found = Found { rows: Rows::with_capacity(points.len()), ..Found::default() };
        let reach = horizon * (1.0 + HORIZON_TOLERANCE);
        let shell = horizon * (1.0 - HORIZON_TOLERANCE);
        let coincident = horizon * COINCIDENCE;
        let mut row: Vec<u32> = Vec::new();
        for i in points {
            row.clear();
            let here = body.position(i);
            let mut take = |j: u32| {
                let squared = distance_squared(here, body.position(j as usize));
                if squared <= reach * reach && j as usize != i {
                    row.push(j);
                    let is_upper = j as usize > i;
                    found.shell_bonds += usize::from(is_upper && squared >= shell * shell);
                    if squared < coincident * coincident && is_upper {
                        let pair = (i, j as usize);
                        found.coincident = Some(found.coincident.map_or(pair, |old| old.min(pair)));
                    }
                }
            };
            if wanted(i) {
                self.for_each_candidate(here, &mut take);
            }
            row.sort_unstable();
            let later = row.iter().rev().take_while(|j| **j as usize > i).count();
            row.iter_mut().for_each(|j| *j = j.wrapping_sub(i as u32));
            let number = found.rows.number(&row, later);
            found.rows.of.push(number);
        }
        found
    }

    /// Visits the points of the cells around a position.
    fn for_each_candidate(&self, position: &[f64], mut visit: impl FnMut(u32)) {
        let cell = self.cell(position);
        let around =
            |axis: usize| cell[axis].saturating_sub(1)..(cell[axis] + 2).min(self.counts[axis]);
        for x in around(0) {
            for y in around(1) {
                // The cells of one column are neighbours in memory.
                let column = around(2);
                let first = self.index([x, y, column.start]);
                let last = self.index([x, y, column.end - 1]);
                let range = self.start[first] as usize..self.start[last + 1] as usize;
                for &point in &self.points[range] {
                    visit(point);
                }
            }
        }
    }
}
