//! How many interactions there are, per point and in all.

use std::ops::Range;

use rayon::prelude::*;

use super::clique::never_fails;
use super::{Degeneracy, OwnerCliques, Slabs};
use crate::body::Body;
use crate::kernel::Measure;
use crate::neighborhood::Neighborhood;

/// Ordered counts per point as in the papers, and totals with each interaction once.
///
/// Measures that no energy needs are not counted: their entries are empty and zero. Of a slab of a body totals are of
/// interactions whose owner counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Census {
    /// `#N1`: neighbours of each point.
    pub neighbors: Vec<u64>,
    /// `#N2`: ordered contributing pairs of each point.
    pub pairs: Vec<u64>,
    /// `#N3`: ordered contributing triples of each point.
    pub triples: Vec<u64>,
    /// Bonds.
    pub bonds: u64,
    /// Triangles with an area.
    pub triangles: u64,
    /// Tetrahedra with a volume.
    pub tetrahedra: u64,
    /// Collinear triples of points left out.
    pub dropped_triangles: u64,
    /// Coplanar quadruples of points left out.
    pub dropped_tetrahedra: u64,
}

impl Census {
    /// Counts the neighbours, and the cliques of the measures for which `needed` holds.
    pub fn new(
        body: &Body,
        neighborhood: &Neighborhood,
        degeneracy: Degeneracy,
        slabs: &Slabs,
        needed: impl Fn(Measure) -> bool,
    ) -> Census {
        let n = body.n_points();
        let mut census = Census {
            neighbors: (0..n).map(|i| neighborhood.row(i).len() as u64).collect(),
            bonds: neighborhood.n_bonds_of(body.counted()) as u64,
            ..Census::default()
        };
        let (areas, volumes) = (needed(Measure::Area), needed(Measure::Volume));
        if !areas && !volumes {
            return census;
        }
        let count = |slab: usize| {
            let (owners, touched) = (slabs.owners(slab), slabs.touched(slab));
            let points = (touched.clone(), body.counted());
            let mut count = SlabCount::new(points, areas, volumes);
            if body.dimension() == 2 {
                count.fill(OwnerCliques::<2>::new(body, neighborhood, degeneracy, touched), owners);
            } else {
                count.fill(OwnerCliques::<3>::new(body, neighborhood, degeneracy, touched), owners);
            }
            count
        };
        let counts: Vec<SlabCount> = (0..slabs.len()).into_par_iter().map(count).collect();
        census.pairs = vec![0; if areas { n } else { 0 }];
        census.triples = vec![0; if volumes { n } else { 0 }];
        for count in &counts {
            count.add_to(&mut census);
        }
        census
    }
}

/// The counts of the cliques that a slab owns; per point from the first point touched.
struct SlabCount {
    first: usize,
    /// The owners that count in totals.
    counted: Range<usize>,
    triangles_at: Vec<u64>,
    tetrahedra_at: Vec<u64>,
    triangles: u64,
    tetrahedra: u64,
    dropped_triangles: u64,
    dropped_tetrahedra: u64,
}

impl SlabCount {
    fn new(
        (touched, counted): (Range<usize>, Range<usize>),
        areas: bool,
        volumes: bool,
    ) -> SlabCount {
        SlabCount {
            first: touched.start,
            counted,
            triangles_at: vec![0; if areas { touched.len() } else { 0 }],
            tetrahedra_at: vec![0; if volumes { touched.len() } else { 0 }],
            triangles: 0,
            tetrahedra: 0,
            dropped_triangles: 0,
            dropped_tetrahedra: 0,
        }
    }

    fn fill<const D: usize>(&mut self, mut cliques: OwnerCliques<'_, D>, owners: Range<usize>) {
        for owner in owners {
            cliques.set(owner);
            let (own, first) = (owner - self.first, self.first);
            let counts = u64::from(self.counted.contains(&owner));
            let place = |member: usize| cliques.members()[member] as usize - first;
            if !self.triangles_at.is_empty() {
                let (at, mut found) = (&mut self.triangles_at, 0);
                self.dropped_triangles += counts
                    * never_fails(cliques.triangles(|j, k, _| {
                        at[place(j)] += 1;
                        at[place(k)] += 1;
                        found += 1;
                        Ok(())
                    }));
                at[own] += found;
                self.triangles += counts * found;
            }
            if !self.tetrahedra_at.is_empty() {
                let (at, mut found) = (&mut self.tetrahedra_at, 0);
                self.dropped_tetrahedra += counts
                    * never_fails(cliques.tetrahedra(|j, k, l| {
                        at[place(j)] += 1;
                        at[place(k)] += 1;
                        at[place(l)] += 1;
                        found += 1;
                        Ok(())
                    }));
                at[own] += found;
                self.tetrahedra += counts * found;
            }
        }
    }

    fn add_to(&self, census: &mut Census) {
        for (place, triangles) in self.triangles_at.iter().enumerate() {
            census.pairs[self.first + place] += 2 * triangles;
        }
        for (place, tetrahedra) in self.tetrahedra_at.iter().enumerate() {
            census.triples[self.first + place] += 6 * tetrahedra;
        }
        census.triangles += self.triangles;
        census.tetrahedra += self.tetrahedra;
        census.dropped_triangles += self.dropped_triangles;
        census.dropped_tetrahedra += self.dropped_tetrahedra;
    }
}
