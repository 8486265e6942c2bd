//! Bonds that are taken out of the lists of neighbours.
//!
//! Lists have no gaps: what stands behind an entry that goes moves up. That takes one pass over them, which reads
//! and writes memory and works nothing out; what numbers of bonds and of points are made of is left to whoever
//! has them.

use super::Neighborhood;

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
        for &[owner, other] in bonds {
            for (from, to) in [(owner, other), (other, owner)] {
                let place = self.row(from).binary_search(&(to as u32));
                gaps.places.extend(place.map(|place| self.row_start[from] + place));
            }
            let place = self.upper(owner).binary_search(&(other as u32));
            gaps.bonds.extend(place.map(|place| self.bond_start[owner] + place));
        }
        gaps.places.sort_unstable();
        gaps.bonds.sort_unstable();
        gaps.close_places(&mut self.neighbors);
        move_up(&mut self.row_start, &gaps.places);
        move_up(&mut self.upper_start, &gaps.places);
        move_up(&mut self.bond_start, &gaps.bonds);
        let later = |point: usize| self.upper(point).len();
        self.most_later = (0..self.n_points()).map(later).max().unwrap_or(0);
        gaps
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

/// Moves ascending starts of rows up by the gaps before them.
fn move_up(starts: &mut [usize], gaps: &[usize]) {
    let mut before = 0;
    for start in starts {
        while gaps.get(before).is_some_and(|gap| gap < start) {
            before += 1;
        }
        *start -= before;
    }
}

#[cfg(test)]
impl Neighborhood {
    /// The same without some bonds, by their numbers; those that are left are numbered anew.
    pub(crate) fn without(&self, is_lost: &[bool]) -> Neighborhood {
        let n = self.n_points();
        let kept = |point: usize| {
            let bonds = self.bonds(point).zip(self.upper(point));
            bonds.filter(|(bond, _)| !is_lost[*bond]).map(|(_, other)| *other)
        };
        let (mut lower, mut later) = (vec![0; n], vec![0; n]);
        for point in 0..n {
            for other in kept(point) {
                later[point] += 1;
                lower[other as usize] += 1;
            }
        }
        let mut all = Neighborhood {
            horizon: self.horizon,
            row_start: vec![0],
            upper_start: Vec::with_capacity(n),
            bond_start: vec![0],
            neighbors: Vec::new(),
            shell_bonds: self.shell_bonds,
            most_later: later.iter().copied().max().unwrap_or(0),
        };
        for point in 0..n {
            let start = all.row_start[point];
            all.upper_start.push(start + lower[point]);
            all.row_start.push(start + lower[point] + later[point]);
            all.bond_start.push(all.bond_start[point] + later[point]);
        }
        all.neighbors = vec![0; all.row_start[n]];
        // Owners come in order, so that rows are ascending.
        let mut next = all.row_start[..n].to_vec();
        for point in 0..n {
            for (k, other) in kept(point).enumerate() {
                all.neighbors[all.upper_start[point] + k] = other;
                all.neighbors[next[other as usize]] = point as u32;
                next[other as usize] += 1;
            }
        }
        all
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
