//! What there is to see of cracks: what is broken, which points are damaged, and which of these hang together.

use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::kernel::Measure;

use super::ROUNDED;
use crate::case::Case;
use crate::scene::selection::Selection;

/// Who looks at a body, or at the part of it that a process has.
pub(in crate::simulation) struct Lookout<'a> {
    case: &'a Case,
    energy: &'a Total<'a>,
    /// Of each track whether a point counts; nothing where all do.
    is_in: Vec<Option<Vec<bool>>>,
    /// The longest distance of points that hang together, in m.
    reach: f64,
    /// The number of the first point among all of the body.
    first: usize,
}

/// What is seen at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::simulation) struct Seen {
    /// How many bonds, triangles and tetrahedra are broken; nothing where they have no criteria of their own.
    pub(in crate::simulation) broken: [Option<usize>; 3],
    /// Of each track.
    pub(in crate::simulation) damaged: Vec<Damaged>,
}

/// The damaged points of a track.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::simulation) struct Damaged {
    /// Their numbers in the body, ascending.
    pub(super) points: Vec<usize>,
    /// Where they are along the axis of the track, in m.
    pub(super) places: Vec<f64>,
    /// Of what material.
    pub(super) laws: Vec<usize>,
    /// Two of them each that hang together, if the second is damaged, too.
    joins: Vec<[usize; 2]>,
}

impl<'a> Lookout<'a> {
    /// Nothing where nothing can break. Points have a typical spacing in m; the first is that of this number in the
    /// body.
    pub(in crate::simulation) fn new(
        case: &'a Case,
        energy: &'a Total<'a>,
        selection: &Selection,
        (spacing, first): (f64, usize),
    ) -> Option<Lookout<'a>> {
        energy.fracture()?;
        let is_in = case.scene.tracks.iter().map(|track| {
            let set = track.set.as_ref()?;
            let mut is_in = vec![false; case.body.n_points()];
            selection.sets[set.value].points.iter().for_each(|point| is_in[*point] = true);
            Some(is_in)
        });
        let reach = (case.body.dimension() as f64).sqrt() * spacing * (1.0 + ROUNDED);
        Some(Lookout { case, energy, is_in: is_in.collect(), reach, first })
    }

    pub(in crate::simulation) fn seen(&self) -> Seen {
        Seen { broken: self.broken(), damaged: self.damaged() }
    }

    /// Of what counts.
    pub(in crate::simulation) fn broken(&self) -> [Option<usize>; 3] {
        let Some(fracture) = self.energy.fracture() else { return [None; 3] };
        let of = |measure| fracture.counts_of(measure).map(|counts| counts[1]);
        [Some(fracture.counts()[1]), of(Measure::Area), of(Measure::Volume)]
    }

    /// Of each track, of the points that count.
    pub(in crate::simulation) fn damaged(&self) -> Vec<Damaged> {
        let tracks = &self.case.scene.tracks;
        let fracture = self.energy.fracture().filter(|_| !tracks.is_empty());
        let Some(damage) = fracture.map(|fracture| fracture.damage()) else { return Vec::new() };
        let of_track = |(number, track): (usize, &crate::scene::Track)| {
            let is_in = |point: usize| self.is_in[number].as_ref().is_none_or(|is_in| is_in[point]);
            let is_damaged = |point: usize| damage[point] >= track.threshold && is_in(point);
            self.damaged_of(track.axis.number_and_sign().0, is_damaged)
        };
        tracks.iter().enumerate().map(of_track).collect()
    }

    /// Of a track along an axis. Of points that do not count it is not known whether they are damaged.
    fn damaged_of(&self, axis: usize, is_damaged: impl Fn(usize) -> bool) -> Damaged {
        let (case, bonds, counted) = (self.case, self.energy.bonds(), self.energy.counted());
        let mut found = Damaged::default();
        for point in counted.clone().filter(|point| is_damaged(*point)) {
            let number = self.first + point;
            found.points.push(number);
            found.places.push(case.body.position(point)[axis]);
            let law = case.materials.as_ref().map_or(0, |materials| materials.of(point).into());
            found.laws.push(law);
            let row = bonds.row(point).iter().map(|other| *other as usize);
            let above = row.filter(|other| *other > point);
            for other in above.filter(|other| !counted.contains(other) || is_damaged(*other)) {
                let [p, q] = [point, other].map(|point| case.body.position(point));
                let squared = p.iter().zip(q).map(|(p, q)| (p - q) * (p - q)).sum::<f64>();
                if squared <= self.reach * self.reach {
                    found.joins.push([number, self.first + other]);
                }
            }
        }
        found
    }
}

#[cfg(feature = "petsc")]
impl Damaged {
    /// As numbers that processes send each other.
    pub(in crate::simulation) fn add_to(&self, numbers: &mut Vec<f64>) {
        let Damaged { points, places, laws, joins } = self;
        numbers.extend([points.len(), joins.len()].map(|n| n as f64));
        numbers.extend(points.iter().map(|point| *point as f64));
        numbers.extend(places);
        numbers.extend(laws.iter().map(|law| *law as f64));
        numbers.extend(joins.iter().flatten().map(|point| *point as f64));
    }

    /// Adds the points of the next part of a body, of which `numbers` has these and what other tracks have.
    pub(in crate::simulation) fn extend(&mut self, numbers: &mut impl Iterator<Item = f64>) {
        let [n, m] = [(); 2].map(|()| numbers.next().map_or(0, |n| n as usize));
        self.points.extend(numbers.by_ref().take(n).map(|point| point as usize));
        self.places.extend(numbers.by_ref().take(n));
        self.laws.extend(numbers.by_ref().take(n).map(|law| law as usize));
        let ends: Vec<usize> = numbers.by_ref().take(2 * m).map(|point| point as usize).collect();
        self.joins.extend(ends.as_chunks::<2>().0);
    }
}

impl Damaged {
    /// The place in the list of the farthest point, along an axis or against it, that hangs together with these.
    pub(super) fn farthest(&self, seeds: &[usize], sign: f64) -> Option<usize> {
        let place = |point: &usize| self.points.binary_search(point).ok();
        let mut pieces = Pieces::of(self.points.len());
        for [one, other] in &self.joins {
            if let (Some(one), Some(other)) = (place(one), place(other)) {
                pieces.join(one, other);
            }
        }
        let mut is_of_crack = vec![false; self.points.len()];
        for number in seeds.iter().filter_map(place) {
            is_of_crack[pieces.root(number)] = true;
        }
        let own = (0..self.points.len()).filter(|number| is_of_crack[pieces.root(*number)]);
        // Of those that are equally far, the first in the body's order.
        own.fold(None, |tip: Option<usize>, number| {
            let is_farther =
                tip.is_none_or(|tip| sign * self.places[number] > sign * self.places[tip]);
            if is_farther { Some(number) } else { tip }
        })
    }
}

/// Numbers that hang together.
struct Pieces(Vec<usize>);

impl Pieces {
    fn of(n: usize) -> Pieces {
        Pieces((0..n).collect())
    }

    fn root(&mut self, mut number: usize) -> usize {
        while self.0[number] != number {
            self.0[number] = self.0[self.0[number]];
            number = self.0[number];
        }
        number
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one), self.root(other));
        self.0[one.max(other)] = one.min(other);
    }
}
