//! Parameters that vary from point to point, and maybe in time.
//!
//! A point has the values of the parameters of its material. What belongs to a point alone takes them; an
//! interaction takes the mean of its corners, of those that have a value: where materials meet, the
//! parameters of one are not those of the other. A field may also be a state: then each bond has a value of
//! its own, which it remembers, or each triangle, or each tetrahedron; or points have, and what belongs to a
//! point takes that point's. Or it may be a component of the direction that a bond has at rest, which follows
//! from the positions of its ends.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use crate::body::Body;
use crate::interaction::Ranks;
use crate::kernel::Measure;

/// What remembers a state, each a value of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateOf {
    /// Bonds, triangles or tetrahedra.
    Interactions(Measure),
    /// Points.
    Points,
}

/// The fields of all laws, one after the other, at all points.
#[derive(Debug)]
pub struct Fields {
    n_points: usize,
    /// Where the fields of each law start among all, and the end.
    first: Vec<usize>,
    typical: Vec<f64>,
    /// Bits of numbers, field by field: they may be set anew between passes.
    values: Vec<AtomicU64>,
    is_steady: bool,
    /// What remembers each that is a state; nothing of those that are none.
    state_of: Vec<Option<StateOf>>,
    /// Which of them are the time step in which laws follow their states, at most one of each law: it is
    /// below 0 where states are held.
    time_steps: Vec<usize>,
    /// The axis of each that is a component of the direction of bonds at rest; nothing of those that are none.
    axes: Vec<Option<u8>>,
    /// Where the points are, if there are such fields.
    body: Option<Arc<Body>>,
    /// What interactions have of each that is a state of theirs, by their numbers; once there are some. Those of
    /// points are among the values.
    states: Vec<OnceLock<Box<[AtomicU64]>>>,
    /// The numbers of triangles, and of tetrahedra, once these have states.
    ranks: [OnceLock<Ranks>; 2],
}

impl Fields {
    /// `of_laws` has typical values of the fields of each law, in SI units; points have none yet. They
    /// are steady unless they are set again after energies were made.
    pub fn new(n_points: usize, of_laws: &[Vec<f64>], is_steady: bool) -> Fields {
        let mut first = vec![0];
        first.extend(of_laws.iter().scan(0, |end, own| {
            *end += own.len();
            Some(*end)
        }));
        let typical = of_laws.concat();
        let nothing = || AtomicU64::new(f64::NAN.to_bits());
        let values = (0..n_points * typical.len()).map(|_| nothing()).collect();
        let states = typical.iter().map(|_| OnceLock::new()).collect();
        let state_of = vec![None; typical.len()];
        let axes = vec![None; typical.len()];
        Fields {
            n_points,
            first,
            typical,
            values,
            is_steady,
            state_of,
            time_steps: Vec::new(),
            axes,
            body: None,
            states,
            ranks: Default::default(),
        }
    }

    /// The same where some fields are states: each bond, triangle, tetrahedron or point has a value of its own.
    pub fn with_states(self, state_of: Vec<Option<StateOf>>) -> Fields {
        assert_eq!(state_of.len(), self.len(), "one for each field");
        Fields { state_of, ..self }
    }

    /// The same where some fields are components of the direction of bonds at rest, each with its axis: the unit
    /// vector from one end to the other, in the body that all of them are of.
    pub fn with_directions(self, axes: Vec<Option<u8>>, body: &Arc<Body>) -> Fields {
        assert_eq!(axes.len(), self.len(), "one for each field");
        assert_eq!(body.n_points(), self.n_points, "the fields of its points");
        let body = axes.iter().any(Option::is_some).then(|| Arc::clone(body));
        Fields { axes, body, ..self }
    }

    /// The same where some fields, by their numbers, are the time step in s in which laws follow their states;
    /// below 0 laws hold them. They are not steady.
    pub fn with_time_steps(self, time_steps: Vec<usize>) -> Fields {
        let is_steady = self.is_steady && time_steps.is_empty();
        Fields { is_steady, time_steps, ..self }
    }

    /// The fields that are the time step, by their numbers.
    pub(crate) fn time_steps(&self) -> &[usize] {
        &self.time_steps
    }

    /// Gives all points a time step in s; below 0 for laws that hold their states.
    pub(crate) fn set_time_step(&self, dt: f64) {
        for field in &self.time_steps {
            (0..self.n_points).for_each(|point| self.set(*field, point, dt));
        }
    }

    /// Gives bonds, or others with these numbers, the states that they begin with, which `values` tells of a
    /// field. Nothing happens where they have some.
    pub(crate) fn begin_states(
        &self,
        measure: Measure,
        ranks: Option<&Ranks>,
        values: impl Fn(usize) -> Vec<f64>,
    ) {
        if let (Some(ranks), Some(own)) = (ranks, self.ranks_of(measure)) {
            own.get_or_init(|| ranks.clone());
        }
        let kind = Some(StateOf::Interactions(measure));
        for field in self.numbers_of_states().filter(|k| self.state_of[*k] == kind) {
            self.states[field].get_or_init(|| {
                let bits = values(field).into_iter().map(f64::to_bits);
                bits.map(AtomicU64::new).collect()
            });
        }
    }

    /// Where the numbers of triangles or tetrahedra are kept.
    fn ranks_of(&self, measure: Measure) -> Option<&OnceLock<Ranks>> {
        self.ranks.get((measure as usize).wrapping_sub(1))
    }

    /// The first number of an owner's triangles or tetrahedra; 0 where these have no states.
    #[inline(always)]
    pub(crate) fn first_number(&self, measure: Measure, owner: usize) -> usize {
        let ranks = self.ranks_of(measure).and_then(OnceLock::get);
        ranks.map_or(0, |ranks| ranks.first(owner))
    }

    /// Whether some of these fields are states, of a kind or of any.
    #[inline(always)]
    pub(crate) fn have_states(&self, fields: Range<usize>, kind: Option<StateOf>) -> bool {
        let is_it = |state: &Option<StateOf>| state.is_some() && (kind.is_none() || *state == kind);
        self.state_of[fields].iter().any(is_it)
    }

    /// What remembers a field that is a state.
    pub(crate) fn kind_of_state(&self, field: usize) -> Option<StateOf> {
        self.state_of[field]
    }

    /// The numbers of the fields that are states.
    pub(crate) fn numbers_of_states(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(|field| self.state_of[*field].is_some())
    }

    /// What interactions remember as a field that is a state of theirs; nothing before they have begun.
    #[inline(always)]
    fn states_of(&self, field: usize, measure: Measure) -> Option<&[AtomicU64]> {
        if self.state_of[field] != Some(StateOf::Interactions(measure)) {
            return None;
        }
        self.states[field].get().map(|states| &**states)
    }

    /// How many interactions remember a field that is a state, or points; 0 before interactions have begun.
    pub(crate) fn n_remembering(&self, field: usize) -> usize {
        match self.state_of[field] {
            Some(StateOf::Points) => self.n_points,
            _ => self.states[field].get().map_or(0, |states| states.len()),
        }
    }

    /// What an interaction remembers as a field that is a state, or a point: nothing before an interaction has
    /// begun, not a number of a point that has none.
    pub(crate) fn state(&self, field: usize, number: usize) -> Option<f64> {
        if self.state_of[field] == Some(StateOf::Points) {
            return Some(self.at(field, number));
        }
        let value = &self.states[field].get()?[number];
        Some(f64::from_bits(value.load(Ordering::Relaxed)))
    }

    /// Gives an interaction another state, or a point.
    pub(crate) fn set_state(&self, field: usize, number: usize, value: f64) {
        if self.state_of[field] == Some(StateOf::Points) {
            self.set(field, number, value);
        } else if let Some(states) = self.states[field].get() {
            states[number].store(value.to_bits(), Ordering::Relaxed);
        }
    }

    /// Whether these are the components of the direction of bonds at rest, in their order, and nothing else.
    pub(crate) fn are_direction(&self, mut fields: Range<usize>) -> bool {
        let dimension = self.body.as_ref().map_or(0, |body| body.dimension());
        let first = fields.start;
        dimension > 0
            && fields.len() == dimension
            && fields.all(|field| self.axes[field].map(usize::from) == Some(field - first))
    }

    /// Which of these are the components of the direction of bonds, one after the other; none at the end where
    /// there are none.
    #[inline(always)]
    pub(crate) fn directions_in(&self, fields: Range<usize>) -> Range<usize> {
        let Some(body) = &self.body else { return fields.end..fields.end };
        let first = fields.clone().find(|field| self.axes[*field].is_some());
        first.map_or(fields.end..fields.end, |first| first..first + body.dimension())
    }

    /// The axis of a field that is a component of the direction of bonds, with the positions of points.
    #[inline(always)]
    fn along(&self, field: usize) -> Option<(usize, &Body)> {
        Some((usize::from(self.axes[field]?), self.body.as_deref()?))
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.typical.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.typical.is_empty()
    }

    /// Whether they stay as they are.
    pub fn is_steady(&self) -> bool {
        self.is_steady
    }

    /// The numbers of the fields of a law.
    pub fn of_law(&self, law: usize) -> Range<usize> {
        let end = |law: usize| self.first.get(law).copied().unwrap_or(self.len());
        end(law)..end(law + 1)
    }

    /// Gives a point the value of a field, in SI units. What was worked out before is that of the values
    /// before.
    pub fn set(&self, field: usize, point: usize, value: f64) {
        self.values[field * self.n_points + point].store(value.to_bits(), Ordering::Relaxed);
    }

    /// The value of a field at a point; not a number where the point has none.
    #[inline(always)]
    pub fn at(&self, field: usize, point: usize) -> f64 {
        f64::from_bits(self.values[field * self.n_points + point].load(Ordering::Relaxed))
    }

    /// What an interaction of some points takes: the mean of those that have a value, a typical one where
    /// none has.
    #[inline(always)]
    pub fn mean(&self, field: usize, points: impl Iterator<Item = usize> + Clone) -> f64 {
        let all = points.clone().map(|point| self.at(field, point));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
        if sum.is_nan() { self.mean_of_some(field, points) } else { sum / n }
    }

    #[cold]
    fn mean_of_some(&self, field: usize, points: impl Iterator<Item = usize>) -> f64 {
        let some = points.map(|point| self.at(field, point)).filter(|value| !value.is_nan());
        let (sum, n) = some.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
        if n == 0.0 { self.typical[field] } else { sum / n }
    }

    /// Adds to `out` what places take of some fields: field by field, of each all places in their order. States of
    /// points are those of the first of a place.
    #[inline(always)]
    pub(crate) fn add<I: Iterator<Item = usize> + Clone>(
        &self,
        fields: Range<usize>,
        n: usize,
        points: impl Fn(usize) -> I,
        out: &mut Vec<f64>,
    ) {
        for field in fields {
            if self.state_of[field] == Some(StateOf::Points) {
                out.extend((0..n).map(|place| self.mean(field, points(place).take(1))));
                continue;
            }
            if let Some((axis, body)) = self.along(field) {
                out.extend((0..n).map(|place| component(body, points(place), axis)));
                continue;
            }
            self.add_means(field, (0..n).map(&points), out);
        }
    }

    /// Adds to `out` the means of a field, of all places in their order: see [`Self::mean`].
    #[inline(always)]
    fn add_means<I: Iterator<Item = usize>>(
        &self,
        field: usize,
        places: impl Iterator<Item = I> + Clone,
        out: &mut Vec<f64>,
    ) {
        let values = &self.values[field * self.n_points..][..self.n_points];
        let value = move |point: usize| f64::from_bits(values[point].load(Ordering::Relaxed));
        let first = out.len();
        out.extend(places.clone().map(move |points| {
            let all = points.map(value);
            let (sum, n) = all.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
            sum / n
        }));
        // Of all at once, behind the loop: nearly always every point has a value.
        if out[first..].iter().fold(false, |misses, mean| misses | mean.is_nan()) {
            self.complete(field, places, &mut out[first..]);
        }
    }

    /// Takes the means of those points that have a value at places where not all have one.
    #[cold]
    fn complete<I: Iterator<Item = usize>>(
        &self,
        field: usize,
        places: impl Iterator<Item = I>,
        means: &mut [f64],
    ) {
        for (mean, points) in means.iter_mut().zip(places).filter(|(mean, _)| mean.is_nan()) {
            *mean = self.mean_of_some(field, points);
        }
    }

    /// Adds what so many places at a point take of all fields, with typical states.
    pub(crate) fn add_at_start(&self, n: usize, point: usize, out: &mut Vec<f64>) {
        for (field, (state, typical)) in self.state_of.iter().zip(&self.typical).enumerate() {
            let value = match state {
                Some(_) => *typical,
                None => self.mean(field, std::iter::once(point)),
            };
            out.resize(out.len() + n, value);
        }
    }

    /// The same of interactions, which have states of their own: their points and their numbers. Places beyond
    /// the last of them, `n` in all, take what that one takes.
    #[inline(always)]
    pub(crate) fn add_of<I: Iterator<Item = usize>>(
        &self,
        measure: Measure,
        fields: Range<usize>,
        n: usize,
        interactions: impl Iterator<Item = (I, usize)> + Clone,
        out: &mut Vec<f64>,
    ) {
        for field in fields {
            let (end, interactions) = (out.len() + n, interactions.clone());
            if let Some((axis, body)) = self.along(field) {
                out.extend(interactions.map(|(points, _)| component(body, points, axis)));
            } else if let Some(states) = self.states_of(field, measure) {
                let state = |number: usize| f64::from_bits(states[number].load(Ordering::Relaxed));
                out.extend(interactions.map(|(_, number)| state(number)));
            } else {
                self.add_means(field, interactions.map(|(points, _)| points), out);
            }
            out.resize(end, out.last().copied().unwrap_or(self.typical[field]));
        }
    }

    /// Adds typical values of all fields at so many places.
    pub(crate) fn add_typical(&self, n: usize, out: &mut Vec<f64>) {
        for value in &self.typical {
            out.resize(out.len() + n, *value);
        }
    }
}

/// A component of the unit vector from the first of some points to the second at rest; 0 where that is the same.
#[inline(always)]
fn component(body: &Body, mut points: impl Iterator<Item = usize>, axis: usize) -> f64 {
    let (Some(from), Some(to)) = (points.next(), points.next()) else { return 0.0 };
    if from == to {
        return 0.0;
    }
    let (from, to) = (body.position(from), body.position(to));
    let square = from.iter().zip(to).fold(0.0, |sum, (p, q)| sum + (q - p) * (q - p));
    (to[axis] - from[axis]) / square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interactions_take_the_mean_of_the_corners_that_have_a_value() {
        let fields = Fields::new(3, &[vec![7.0], vec![], vec![8.0, 9.0]], true);
        assert_eq!([0, 1, 2].map(|law| fields.of_law(law)), [0..1, 1..1, 1..3]);
        for (point, value) in [(0, 1.0), (1, 3.0)] {
            fields.set(0, point, value);
        }
        fields.set(2, 2, 5.0);
        let mean = |field, points: &[usize]| fields.mean(field, points.iter().copied());
        assert_eq!(mean(0, &[0, 1]), 2.0);
        assert_eq!(mean(0, &[1, 2]), 3.0);
        assert_eq!(mean(0, &[2]), 7.0);
        assert_eq!(mean(2, &[0, 1, 2]), 5.0);
        let mut out = vec![-1.0];
        fields.add(0..3, 2, |place| [place, place + 1].into_iter(), &mut out);
        assert_eq!(out, [-1.0, 2.0, 3.0, 8.0, 8.0, 9.0, 5.0]);
    }

    #[test]
    fn states_of_points_are_those_of_the_first_point() {
        let fields = Fields::new(3, &[vec![7.0, 8.0]], true);
        let fields = fields.with_states(vec![None, Some(StateOf::Points)]);
        for (point, value) in [(0, 1.0), (1, 3.0)] {
            fields.set(0, point, value);
            fields.set_state(1, point, 10.0 * value);
        }
        assert_eq!((fields.state(1, 1), fields.n_remembering(1)), (Some(30.0), 3));
        let mut out = Vec::new();
        fields.add(0..2, 3, |place| [[0, 1], [1, 0], [2, 0]][place].into_iter(), &mut out);
        assert_eq!(out, [2.0, 2.0, 1.0, 10.0, 30.0, 8.0]);
        out.clear();
        fields.add_at_start(2, 1, &mut out);
        assert_eq!(out, [3.0, 3.0, 8.0, 8.0]);
    }
}
