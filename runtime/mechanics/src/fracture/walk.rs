//! Triangles and tetrahedra that are left, list by list through functions of them that are no energies.

use std::ops::Range;

use crate::body::Body;
use crate::element::{
    CAPACITY, Contributions, Element as _, InteractionBatch, MeasureElement, Order,
};
use crate::energy::{Argument, NonFinite};
use crate::geometry::each;
use crate::interaction::{Clique, Degeneracy, Lost, OwnerCliques, Ranks, Slabs, n_neighbors};
use crate::kernel::Measure;
use crate::materials::Fields;
use crate::neighborhood::Neighborhood;

/// The triangles or the tetrahedra of a body, by owners.
pub(super) struct OfOwners {
    pub(super) measure: Measure,
    pub(super) ranks: Ranks,
    slabs: Slabs,
    degeneracy: Degeneracy,
}

/// What they are seen with.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    pub(super) around: (&'a Body, &'a Neighborhood),
    /// Displacements in m, `n x d`.
    pub(super) u: &'a [f64],
    /// What is gone.
    pub(super) lost: &'a Lost,
}

/// Some cliques of an owner.
pub(super) struct Listed<'a, 'c, const D: usize> {
    walk: Walk<'a>,
    cliques: &'c OwnerCliques<'a, D>,
    /// Of the members relative to the owner, in m; and as many vectors of length 0.
    displacement: [&'c [[f64; D]]; 2],
    /// The number of the owner's first.
    first: usize,
}

/// Where functions of cliques are worked out.
pub(super) struct Room {
    batch: InteractionBatch,
    pub(super) out: Contributions,
}

impl Room {
    pub(super) fn new(measure: Measure, dimension: usize) -> Room {
        let batch = InteractionBatch::new(measure, dimension);
        Room { batch, out: Contributions::new(measure, dimension) }
    }
}

/// A function of cliques in the place of an energy.
pub(super) struct Of<'a> {
    pub(super) element: &'a MeasureElement,
    /// The fields of its law.
    pub(super) fields: Option<(&'a Fields, Range<usize>)>,
    /// The time since states were others, where it may take that.
    pub(super) dt: Option<f64>,
    /// Whether it is worked out of cliques at rest.
    pub(super) at_rest: bool,
}

impl OfOwners {
    pub(super) fn new((body, neighborhood): (&Body, &Neighborhood), measure: Measure) -> OfOwners {
        let slabs = Slabs::new(neighborhood);
        let ranks = match (body.dimension(), n_neighbors(measure)) {
            (2, _) => Ranks::new::<2, 2>(body, neighborhood, &slabs),
            (_, 2) => Ranks::new::<3, 2>(body, neighborhood, &slabs),
            _ => Ranks::new::<3, 3>(body, neighborhood, &slabs),
        };
        OfOwners { measure, ranks, slabs, degeneracy: Degeneracy::new(body) }
    }

    /// The points of the cliques of a slab's owners.
    pub(super) fn touched(&self, slab: usize) -> Range<usize> {
        self.slabs.touched(slab)
    }

    /// Stretches of at most so many owners that are of one slab each, in their order.
    pub(super) fn pieces(&self, owners: Range<usize>, most: usize) -> Vec<(usize, Range<usize>)> {
        let of_slab = |slab: usize| {
            let Range { start, end } = self.slabs.owners(slab);
            let (start, end) = (start.max(owners.start), end.min(owners.end));
            (start..end).step_by(most).map(move |k| (slab, k..end.min(k.saturating_add(most))))
        };
        (0..self.slabs.len()).flat_map(of_slab).collect()
    }

    /// These owners, ascending, slab by slab; those of slabs without any are left out.
    pub(super) fn by_slabs(&self, owners: &[Range<usize>]) -> Vec<(usize, Vec<Range<usize>>)> {
        let mut all: Vec<(usize, Vec<Range<usize>>)> = Vec::new();
        let mut slab = 0;
        for range in owners {
            let mut start = range.start;
            while start < range.end {
                while self.slabs.owners(slab).end <= start {
                    slab += 1;
                }
                let end = self.slabs.owners(slab).end.min(range.end);
                match all.last_mut().filter(|last| last.0 == slab) {
                    Some(last) => last.1.push(start..end),
                    None => all.push((slab, std::iter::once(start..end).collect())),
                }
                start = end;
            }
        }
        all
    }

    /// Shows the cliques that are left of some owners of a slab, each once, in lists of at most [`CAPACITY`].
    pub(super) fn show<'a, const D: usize, const K: usize>(
        &'a self,
        walk: Walk<'a>,
        (slab, owners): (usize, impl Iterator<Item = usize>),
        is_left_out: impl Fn(usize) -> bool,
        mut see: impl FnMut(&Listed<'a, '_, D>, &[Clique]) -> Result<(), NonFinite>,
    ) -> Result<(), NonFinite> {
        assert_eq!(K, n_neighbors(self.measure), "the size of the cliques");
        let (body, neighborhood) = walk.around;
        let touched = self.slabs.touched(slab);
        let cliques = OwnerCliques::<D>::new(body, neighborhood, self.degeneracy, touched);
        let mut cliques = cliques.with_lost(Some(walk.lost));
        let (mut displacement, mut nowhere, mut list) = (Vec::new(), Vec::new(), Vec::new());
        let points = walk.u.as_chunks::<D>().0;
        for owner in owners.filter(|owner| !is_left_out(*owner)) {
            cliques.set_of::<K>(owner);
            let own = points[owner];
            displacement.clear();
            displacement.extend(cliques.members().iter().map(|member| -> [f64; D] {
                each(|axis| points[*member as usize][axis] - own[axis])
            }));
            nowhere.resize(displacement.len(), [0.0; D]);
            let listed = Listed {
                walk,
                cliques: &cliques,
                displacement: [&displacement, &nowhere],
                first: self.ranks.first(owner),
            };
            cliques.each_numbered::<K, NonFinite>(|clique| {
                let mut members = clique.corners::<K>().into_iter();
                if members.any(|member| is_left_out(cliques.members()[member] as usize)) {
                    return Ok(());
                }
                list.push(clique);
                if list.len() == CAPACITY {
                    see(&listed, &list)?;
                    list.clear();
                }
                Ok(())
            })?;
            if !list.is_empty() {
                see(&listed, &list)?;
                list.clear();
            }
        }
        Ok(())
    }
}

impl<const D: usize> Listed<'_, '_, D> {
    /// The number of a clique among all of the body.
    pub(super) fn number(&self, clique: &Clique) -> usize {
        self.first + clique.number as usize
    }

    /// Vectors at rest from the owner to its members, in m.
    pub(super) fn reference(&self) -> &[[f64; D]] {
        self.cliques.reference()
    }

    /// The points of a clique, the owner first, and that once more where it has fewer than four.
    pub(super) fn points<const K: usize>(&self, clique: &Clique) -> [usize; 4] {
        let mut points = [self.cliques.owner(); 4];
        let members = clique.corners::<K>().map(|member| self.cliques.members()[member] as usize);
        points[1..=K].copy_from_slice(&members);
        points
    }

    /// Works out a function of at most [`CAPACITY`] cliques, as energies in the room.
    pub(super) fn evaluate<const K: usize>(
        &self,
        lanes: &[Clique],
        of: Of<'_>,
        Room { batch, out }: &mut Room,
    ) -> Result<(), NonFinite> {
        let Of { element, fields, dt, at_rest } = of;
        let displacement = self.displacement[usize::from(at_rest)];
        batch.gather(lanes.len(), self.cliques.reference(), displacement, |lane| {
            lanes[lane].corners::<K>()
        });
        batch.weight[..lanes.len()].fill(1.0);
        let measure = element.measure();
        if let Some(fields) = fields.filter(|_| element.n_fields() > 0) {
            let numbered = |clique: &Clique| {
                (self.points::<K>(clique).into_iter().take(K + 1), self.number(clique))
            };
            batch.take_fields(fields.clone(), measure, lanes.iter().map(numbered));
            if let Some(dt) = dt {
                batch.take_time_step(fields, element.n_fields(), dt);
            }
        }
        element.evaluate(batch, Order::Energy, out).map_err(|lane| {
            let points = self.points::<K>(&lanes[lane.lane])[..=K].to_vec();
            let of = |point: &usize| self.walk.u[point * D..(point + 1) * D].to_vec();
            NonFinite {
                argument: Argument::Measure(measure),
                displacements: points.iter().flat_map(of).collect(),
                points,
                value: lane.value,
                reference: lane.reference,
                inverted: false,
            }
        })
    }
}
