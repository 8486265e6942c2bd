//! Parts of a body that hang on nothing once bonds are broken, and what holds them.
//!
//! A part whose bonds to the rest are all broken keeps the rigid motions that nothing fixed forbids: they
//! cost no energy, and the tangent is singular. As many of its degrees of freedom are held where they are as
//! take these motions away and no more: it springs back to rest and carries nothing. A point that hangs on
//! bonds too few to hold it swings about them without force, and is held in the same way; where that is all
//! its points do, a whole arm goes, from its end. Where bonds have no energy of their own, the triangles and
//! tetrahedra that are left hold their points together.

use piola_mechanics::fracture::left_of;
use piola_mechanics::matrix::BlockPattern;
use piola_mechanics::vector::{dot, norm_of};

use super::{LoadSteps, Loose, StepError};
use crate::constraint::Constraints;
use crate::rigid_modes::{FreeComponent, UnderConstrained, connected_components, holders};

/// Bonds are taken as independent if a direction differs by more than this from those before it.
const APART: f64 = 1e-3;

/// Parts that move without force, and the degrees of freedom that take that from them.
#[derive(Default)]
struct Found {
    parts: Vec<FreeComponent>,
    /// The points of each.
    points: Vec<Vec<usize>>,
    dofs: Vec<usize>,
}

/// A body on the way.
struct Sight<'a> {
    d: usize,
    rest: &'a [f64],
    /// Where points are now, in m.
    now: Vec<f64>,
    constraints: &'a Constraints,
    /// Whether a component of a point is prescribed.
    is_prescribed: Vec<bool>,
}

impl LoadSteps<'_> {
    /// Holds what hangs on nothing at displacements `u`; gives it where the run is to end there.
    pub(super) fn hold_loose(
        &mut self,
        u: &[f64],
        loads: &[f64],
    ) -> Result<Option<UnderConstrained>, StepError> {
        let Some(fracture) = &self.fracture else { return Ok(None) };
        let gone = fracture.status.gone();
        if gone.is_empty() {
            return Ok(None);
        }
        // Families hold points by more than the directions of bonds, and so do triangles and tetrahedra.
        let (left, by_bonds) = match fracture.status.joined() {
            Some(joined) => (joined, false),
            None => {
                let bonds = self.energy.bonds();
                (left_of(bonds, &gone.bonds), self.energy.bond_pattern().is_none())
            }
        };
        let mut is_prescribed = vec![false; u.len() / self.dimension];
        self.drive.fixed().iter().for_each(|dof| is_prescribed[dof / self.dimension] = true);
        let rest = self.energy.positions();
        let sight = Sight {
            d: self.dimension,
            rest,
            now: rest.iter().zip(u).map(|(x, u)| x + u).collect(),
            constraints: &self.constraints,
            is_prescribed,
        };
        let found = sight.loose(&left, by_bonds);
        if found.dofs.is_empty() {
            return Ok(None);
        }
        let load = |points: &Vec<usize>| {
            let own = points.iter().flat_map(|p| p * self.dimension..(p + 1) * self.dimension);
            norm_of(&own.map(|dof| loads[dof]).collect::<Vec<f64>>())
        };
        let load = found.points.iter().map(load).fold(0.0, f64::max);
        let parts = UnderConstrained { components: found.parts };
        if self.settings.breaking.loose == Loose::Stop {
            return Ok(Some(parts));
        }
        let mut note = format!("came loose, and is held where it is: {parts}");
        if load > 0.0 {
            note += &format!("; loads of up to {load:.3e} N on it are held, too");
        }
        let mut fixed = [self.constraints.fixed(), &found.dofs].concat();
        fixed.sort_unstable();
        fixed.dedup();
        self.constrain(Constraints::new(u.len(), &fixed)?)?;
        if let Some(fracture) = &mut self.fracture {
            fracture.ledger.notes.push(note);
        }
        Ok(None)
    }

    /// Goes on with other constraints.
    pub(super) fn constrain(&mut self, constraints: Constraints) -> Result<(), StepError> {
        self.constraints = constraints;
        Ok(self.newton.constrain(&self.constraints, self.settings.linear)?)
    }
}

impl Sight<'_> {
    fn loose(&self, left: &BlockPattern, by_bonds: bool) -> Found {
        let mut found = Found::default();
        let hanging = if by_bonds { self.hanging(left, &mut found) } else { Vec::new() };
        let rest = if hanging.is_empty() { None } else { Some(without(left, &hanging)) };
        let is_hanging = |points: &[usize]| !hanging.is_empty() && hanging[points[0]];
        for points in connected_components(rest.as_ref().unwrap_or(left)) {
            if is_hanging(&points) {
                continue;
            }
            let (motions, dofs) = holders(self.d, &self.now, &points, self.constraints);
            if !dofs.is_empty() {
                found.note(self, points, motions, dofs);
            }
        }
        found.dofs.sort_unstable();
        found
    }

    /// Points that swing about their last bonds, one after the other; their other motions are those of the
    /// rest. Empty where there are none.
    fn hanging(&self, left: &BlockPattern, found: &mut Found) -> Vec<bool> {
        let n = left.n_rows();
        let mut degree = vec![0; n];
        for point in 0..n {
            for &other in left.row(point).iter().filter(|other| **other as usize != point) {
                degree[point] += 1;
                degree[other as usize] += 1;
            }
        }
        let few = |point: usize, degree: &[usize]| {
            degree[point] > 0 && degree[point] < self.d && !self.is_prescribed[point]
        };
        let mut next: Vec<usize> = (0..n).filter(|point| few(*point, &degree)).collect();
        if next.is_empty() {
            return Vec::new();
        }
        let others = neighbours(left);
        let mut is_hanging = vec![false; n];
        while let Some(point) = next.pop() {
            if is_hanging[point] || !few(point, &degree) {
                continue;
            }
            let own: Vec<usize> =
                others[point].iter().copied().filter(|other| !is_hanging[*other]).collect();
            let Some(dofs) = self.across(point, &own) else { continue };
            is_hanging[point] = true;
            if !dofs.is_empty() {
                let motions = vec!["rotation about its last bonds".to_owned()];
                found.note(self, vec![point], motions, dofs);
            }
            for other in own {
                degree[other] -= 1;
                next.push(other);
            }
        }
        is_hanging
    }

    /// What holds a point across its bonds to these; nothing where they are not independent.
    fn across(&self, point: usize, others: &[usize]) -> Option<Vec<usize>> {
        let d = self.d;
        let at = |point: usize| &self.now[point * d..(point + 1) * d];
        let mut span: Vec<Vec<f64>> = Vec::new();
        for &other in others {
            let bond: Vec<f64> = at(other).iter().zip(at(point)).map(|(x, y)| x - y).collect();
            let length = norm_of(&bond);
            let bond = beyond(&span, bond.iter().map(|x| x / length).collect());
            if norm_of(&bond) < APART || !length.is_normal() {
                return None;
            }
            span.push(unit(bond));
        }
        let axis = |a: usize| (0..d).map(|k| f64::from(u8::from(k == a))).collect::<Vec<f64>>();
        let mut dofs = Vec::new();
        // What is held already comes first.
        let (held, free): (Vec<usize>, Vec<usize>) =
            (0..d).partition(|a| self.constraints.is_fixed(point * d + a));
        for a in held {
            let rest = beyond(&span, axis(a));
            if norm_of(&rest) > APART {
                span.push(unit(rest));
            }
        }
        while span.len() < d {
            let rests = free.iter().map(|a| (*a, beyond(&span, axis(*a))));
            let (a, rest) = rests.max_by(|p, q| norm_of(&p.1).total_cmp(&norm_of(&q.1)))?;
            dofs.push(point * d + a);
            span.push(unit(rest));
        }
        Some(dofs)
    }
}

impl Found {
    fn note(
        &mut self,
        sight: &Sight<'_>,
        points: Vec<usize>,
        motions: Vec<String>,
        dofs: Vec<usize>,
    ) {
        let (d, example_point) = (sight.d, points[0]);
        let example_position = sight.rest[example_point * d..(example_point + 1) * d].to_vec();
        let n_points = points.len();
        self.parts.push(FreeComponent { n_points, example_point, example_position, motions });
        self.points.push(points);
        self.dofs.extend(dofs);
    }
}

/// What of a vector is beyond orthonormal ones.
fn beyond(span: &[Vec<f64>], mut vector: Vec<f64>) -> Vec<f64> {
    for one in span {
        let along = dot(one, &vector);
        vector.iter_mut().zip(one).for_each(|(x, y)| *x -= along * y);
    }
    vector
}

fn unit(vector: Vec<f64>) -> Vec<f64> {
    let length = norm_of(&vector);
    vector.iter().map(|x| x / length).collect()
}

/// The neighbours of every point.
fn neighbours(pattern: &BlockPattern) -> Vec<Vec<usize>> {
    let mut others = vec![Vec::new(); pattern.n_rows()];
    for point in 0..pattern.n_rows() {
        for &other in pattern.row(point).iter().filter(|other| **other as usize != point) {
            others[point].push(other as usize);
            others[other as usize].push(point);
        }
    }
    others
}

/// The pattern without the bonds of some points.
fn without(pattern: &BlockPattern, gone: &[bool]) -> BlockPattern {
    let mut left = BlockPattern {
        dimension: pattern.dimension,
        row_start: vec![0],
        columns: Vec::with_capacity(pattern.columns.len()),
    };
    for point in 0..pattern.n_rows() {
        let own = pattern.row(point).iter();
        let stays =
            |other: &&u32| **other as usize == point || !gone[point] && !gone[**other as usize];
        left.columns.extend(own.filter(stays));
        left.row_start.push(left.columns.len());
    }
    left
}
