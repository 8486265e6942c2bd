//! Bonds that are taken out of the lists of neighbours.
//!
//! Lists have no gaps: what stands behind an entry that goes moves up. That takes one pass over them, which reads
//! and writes memory and works nothing out; what numbers of bonds and of points are made of is left to whoever
//! has them.

use super::Neighborhood;
#[cfg(test)]
use super::search::Rows;

/// Where entries were taken out of lists, ascending, as the lists were before.
#[derive(Debug, Default)]
pub(crate) struct Gaps {
    /// Among the neighbours of all points.
    places: Vec<usize>,
    /// Among all bonds.
    bonds: Vec<usize>,
}

impl Gaps {
    /// Takes the numbers of directed bonds out, which stand in the order of the neighbours.
    pub(crate) fn close_places<T: Copy>(&self, values: &mut Vec<T>) {
        close(values, &self.places);
    }

    /// Takes the numbers of bonds out.
    pub(crate) fn close_bonds<T: Copy>(&self, values: &mut Vec<T>) {
        close(values, &self.bonds);
    }
}

impl Neighborhood {
    /// Takes out bonds by their ends, the lower one first; those that are left are numbered anew.
    pub(crate) fn take_out(&mut self, bonds: &[[usize; 2]]) -> Gaps {
        let mut gaps = Gaps::default();
        let mut lost: Vec<[usize; 2]> = Vec::with_capacity(2 * bonds.len());
        for &[owner, other] in bonds {
            for (from, to) in [(owner, other), (other, owner)] {
                if let Some(place) = self.row(from).place(to as u32) {
                    gaps.places.push(self.row_start[from] + place);
                    lost.push([from, to]);
                }
            }
            let place = self.upper(owner).place(other as u32);
            gaps.bonds.extend(place.map(|place| self.bond_start[owner] + place));
        }
        gaps.places.sort_unstable();
        gaps.bonds.sort_unstable();
        lost.sort_unstable();
        for of_point in lost.chunk_by(|one, next| one[0] == next[0]) {
            self.keep_others(of_point[0][0], of_point);
        }
        self.count();
        gaps
    }

    /// A row of its own for a point, without some of its neighbours.
    fn keep_others(&mut self, point: usize, lost: &[[usize; 2]]) {
        let is_left = |other: &u32| lost.binary_search(&[point, *other as usize]).is_err();
        let left: Vec<u32> = self.row(point).iter().filter(is_left).collect();
        let later = left.iter().filter(|other| **other as usize > point).count();
        let before = self.spans[self.of[point] as usize];
        let span = before.left(self.steps.len(), left.len(), later);
        let steps = left.iter().map(|other| other.wrapping_sub(point as u32));
        if span.all().start == self.steps.len() {
            self.steps.extend(steps);
            self.of[point] = self.spans.len() as u32;
            self.spans.push(span);
        } else {
            self.steps[span.all()].iter_mut().zip(steps).for_each(|(to, step)| *to = step);
            self.spans[self.of[point] as usize] = span;
        }
    }
}

/// Takes out the values at some places.
fn close<T: Copy>(values: &mut Vec<T>, gaps: &[usize]) {
    let Some(&first) = gaps.first() else { return };
    let mut end = first;
    for (k, &gap) in gaps.iter().enumerate() {
        let next = gaps.get(k + 1).copied().unwrap_or(values.len());
        values.copy_within(gap + 1..next, end);
        end += next - gap - 1;
    }
    values.truncate(end);
}

#[cfg(test)]
impl PartialEq for Neighborhood {
    /// Whether the rows are the same, however they are kept.
    fn eq(&self, other: &Neighborhood) -> bool {
        let same = |point: usize| {
            let rows = [self.row(point), other.row(point)];
            rows[0].iter().eq(rows[1].iter()) && self.upper(point).len() == other.upper(point).len()
        };
        self.row_start == other.row_start
            && self.bond_start == other.bond_start
            && [self.shell_bonds, self.most_later] == [other.shell_bonds, other.most_later]
            && self.horizon == other.horizon
            && (0..self.n_points()).all(same)
    }
}

#[cfg(test)]
impl Neighborhood {
    /// The same without some bonds, by their numbers; those that are left are numbered anew.
    pub(crate) fn without(&self, is_lost: &[bool]) -> Neighborhood {
        let mut rows = Rows::with_capacity(self.n_points());
        for point in 0..self.n_points() {
            let is_left = |other: &u32| {
                !is_lost[self.bond_between([point, *other as usize]).unwrap_or_default()]
            };
            let left: Vec<u32> = self.row(point).iter().filter(is_left).collect();
            let later = left.iter().filter(|other| **other as usize > point).count();
            let steps: Vec<u32> =
                left.iter().map(|other| other.wrapping_sub(point as u32)).collect();
            let number = rows.number(&steps, later);
            rows.of.push(number);
        }
        Neighborhood::of_rows(self.horizon, rows, self.shell_bonds)
    }
}

#[cfg(test)]
mod tests {
    use crate::body::Body;
    use crate::neighborhood::Neighborhood;
    use crate::testing::pseudo_random;

    /// Some, then more, then all bonds that are left, in any order.
    #[test]
    fn lists_are_those_of_what_is_left() {
        for d in [2, 3] {
            let body = Body::new(d, &pseudo_random(90 * d, 7), &[1.0; 90], None);
            let whole = Neighborhood::new(&body, 0.7).unwrap();
            let n = whole.n_bonds();
            let (mut left, mut is_lost) = (whole.clone(), vec![false; n]);
            let mut values: Vec<usize> = (0..n).collect();
            for (seed, share) in [(1, -0.8), (2, 0.1), (3, 2.0)] {
                let chances = pseudo_random(n, seed);
                let goes = |bond: &usize| !is_lost[*bond] && chances[*bond] < share;
                let new: Vec<usize> = (0..n).rev().filter(goes).collect();
                assert!(!new.is_empty());
                let ends: Vec<[usize; 2]> = new.iter().map(|bond| whole.ends(*bond)).collect();
                new.iter().for_each(|bond| is_lost[*bond] = true);
                left.take_out(&ends).close_bonds(&mut values);
                assert_eq!(left, whole.without(&is_lost));
                let kept: Vec<usize> = (0..n).filter(|bond| !is_lost[*bond]).collect();
                assert_eq!(values, kept);
            }
            assert_eq!((left.n_bonds(), left.isolated().len()), (0, 90));
        }
    }
}
