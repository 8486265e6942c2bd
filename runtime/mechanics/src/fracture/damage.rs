//! What of a body is broken, point by point.

use rayon::prelude::*;

use super::Status;
use crate::body::Body;
use crate::interaction::{Clique, Degeneracy, Lost, OwnerCliques, Ranks, Slabs, never_fails};
use crate::neighborhood::Neighborhood;

/// The damage of all points by their bonds, kept from one look to the next: a crack that runs changes it at
/// few of them.
#[derive(Debug, Default)]
pub(super) struct Damage {
    /// Empty before the first look.
    shares: Vec<f64>,
    /// Ends of bonds whose status has changed since the last look.
    stale: Vec<usize>,
}

impl Damage {
    /// Notes that a bond is broken that was not, or the other way round.
    pub(super) fn touch(&mut self, neighborhood: &Neighborhood, bond: usize) {
        if !self.shares.is_empty() {
            self.stale.extend(neighborhood.ends(bond));
        }
    }

    /// The share of the volume of each point's neighbours whose bonds with it are broken. Bonds of `absent`
    /// (ascending) do not count.
    pub(super) fn shares(
        &mut self,
        (body, neighborhood): (&Body, &Neighborhood),
        is_broken: &[bool],
        absent: &[usize],
    ) -> &[f64] {
        let of_point = |point: usize| {
            let (mut family, mut lost) = (0.0, 0.0);
            // In the order of the neighbours, so that the last bit does not depend on what broke first.
            each_bond(neighborhood, point, |bond, other| {
                if absent.binary_search(&bond).is_err() {
                    let volume = body.volumes()[other];
                    family += volume;
                    lost += if is_broken[bond] { volume } else { 0.0 };
                }
            });
            if family > 0.0 { lost / family } else { 0.0 }
        };
        if self.shares.is_empty() {
            self.shares = (0..body.n_points()).into_par_iter().map(of_point).collect();
        }
        self.stale.sort_unstable();
        self.stale.dedup();
        for point in self.stale.drain(..) {
            self.shares[point] = of_point(point);
        }
        &self.shares
    }
}

/// Visits the bonds of a point with its neighbours, in the order of these.
fn each_bond(neighborhood: &Neighborhood, point: usize, mut visit: impl FnMut(usize, usize)) {
    let row = neighborhood.row(point).iter().map(|other| other as usize);
    for earlier in row.take_while(|other| *other < point) {
        let place = neighborhood.upper(earlier).place(point as u32);
        let first = neighborhood.bonds(earlier).start;
        place.iter().for_each(|place| visit(first + place, earlier));
    }
    let later = neighborhood.upper(point).iter().map(|other| other as usize);
    neighborhood.bonds(point).zip(later).for_each(|(bond, other)| visit(bond, other));
}

/// The measures at rest of the triangles (`K = 2`) or tetrahedra (`K = 3`) at each point, added up: twice
/// areas in m^2, six times volumes in m^3.
pub(super) struct OfCliques<'a, const D: usize, const K: usize> {
    pub(super) body: &'a Body,
    pub(super) neighborhood: &'a Neighborhood,
    /// What never was there, because its edges were not.
    pub(super) absent: &'a Lost,
}

impl<const D: usize, const K: usize> OfCliques<'_, D, K> {
    /// Of all that were there.
    pub(super) fn whole(&self) -> Vec<f64> {
        self.sum(None)
    }

    /// Of those that are gone.
    pub(super) fn gone(&self, lost: &Lost) -> Vec<f64> {
        self.sum(Some(lost))
    }

    fn sum(&self, lost: Option<&Lost>) -> Vec<f64> {
        let slabs = Slabs::new(self.neighborhood);
        let of_slab = |slab: usize| self.of_slab(&slabs, slab, lost);
        let parts: Vec<Vec<f64>> = (0..slabs.len()).into_par_iter().map(of_slab).collect();
        let mut all = vec![0.0; self.body.n_points()];
        for (slab, part) in parts.iter().enumerate() {
            let touched = &mut all[slabs.touched(slab)];
            touched.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        all
    }

    fn of_slab(&self, slabs: &Slabs, slab: usize, lost: Option<&Lost>) -> Vec<f64> {
        let OfCliques { body, neighborhood, absent } = *self;
        let touched = slabs.touched(slab);
        let mut sums = vec![0.0; touched.len()];
        let make = |lost| {
            let all = OwnerCliques::<D>::new(
                body,
                neighborhood,
                Degeneracy::new(body),
                slabs.touched(slab),
            );
            all.with_lost(Some(lost))
        };
        let mut whole = make(absent);
        let mut left = lost.map(make);
        let mut numbers = Vec::new();
        for owner in slabs.owners(slab) {
            if let (Some(lost), Some(left)) = (lost, &mut left) {
                if !lost.owners().has(owner) {
                    continue;
                }
                numbers.clear();
                left.set_of::<K>(owner);
                never_fails(left.each_numbered::<K, _>(|clique| {
                    numbers.push(clique.number);
                    Ok(())
                }));
            }
            whole.set_of::<K>(owner);
            never_fails(whole.each_numbered::<K, _>(|clique| {
                if lost.is_none() || numbers.binary_search(&clique.number).is_err() {
                    let measure = measure::<D, K>(whole.reference(), &clique);
                    let members = clique.corners::<K>().map(|m| whole.members()[m] as usize);
                    for point in std::iter::once(owner).chain(members) {
                        sums[point - touched.start] += measure;
                    }
                }
                Ok(())
            }));
        }
        sums
    }
}

/// The measure at rest of a clique whose members are at these vectors from the owner.
pub(super) fn measure<const D: usize, const K: usize>(
    reference: &[[f64; D]],
    clique: &Clique,
) -> f64 {
    let edge = |k: usize| {
        let xi = &reference[clique.corners::<K>()[k]];
        [xi[0], xi[1], if D == 3 { xi[2] } else { 0.0 }]
    };
    let ([a, b, c], [x, y, z]) = (edge(0), edge(1));
    let normal = [b * z - c * y, c * x - a * z, a * y - b * x];
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    if K == 2 { dot(normal, normal).sqrt() } else { dot(normal, edge(2)).abs() }
}

/// What is gone of a body's cliques: those with a broken edge, and those of so many points besides the owner
/// that broke themselves.
pub(super) fn lost_of(
    status: &Status,
    neighborhood: &Neighborhood,
    (corners, ranks): (usize, Option<&Ranks>),
) -> Lost {
    let broken = (0..status.is_broken.len()).filter(|bond| status.is_broken[*bond]);
    let mut lost = without_edges(neighborhood, &broken.collect::<Vec<usize>>());
    if let (Some(ranks), Some(own)) = (ranks, &status.lost) {
        lost.lose_cliques(corners, ranks, &own.own(corners).collect::<Vec<usize>>());
    }
    lost
}

/// All but the cliques with one of these bonds as an edge.
pub(super) fn without_edges(neighborhood: &Neighborhood, bonds: &[usize]) -> Lost {
    let mut lost = Lost::nothing_of(neighborhood);
    lost.lose_edges(bonds, &Lost::owners_of(neighborhood, bonds));
    lost
}
