//! The one way through the interactions of a slab: owner by owner, in batches through an element, to
//! a sink that says what becomes of them.
//!
//! What every pass needs of an owner stands here; who sums in another way, as bonds and tetrahedra do
//! for rows of the tangent, takes from here what is shared.

use std::ops::Range;

use super::DiscreteEnergy;
use super::kind::Kind;
use crate::element::{CAPACITY, Contributions, Element, InteractionBatch, NonFiniteLane, Order};
use crate::energy::{Argument, NonFinite};
use crate::interaction::{Bits, Clique, CliqueRoom, OwnerCliques};

/// What becomes of interactions with `K` corners besides the owner.
pub(super) trait Sink<const D: usize, const K: usize> {
    /// Begins with an owner; `false` where its interactions have been summed in another way, but for
    /// those that the sink then lists in `gathered`.
    fn begin(&mut self, _cliques: &OwnerCliques<'_, D>, _gathered: &mut Gathered<D>) -> bool {
        true
    }

    /// Whether the interaction is to be evaluated; asked where interactions are counted.
    #[inline(always)]
    fn wants(&self, _clique: &Clique) -> bool {
        true
    }

    /// Takes a batch: interactions of the owner, and for each of them, side by side, what its element
    /// gave.
    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions);

    /// Ends with an owner.
    fn end(&mut self, _cliques: &OwnerCliques<'_, D>) {}
}

/// A visit of a slab at displacements `u`, up to some derivatives.
#[derive(Clone, Copy)]
pub(super) struct Visit<'a> {
    pub(super) energy: &'a DiscreteEnergy,
    pub(super) slab: usize,
    pub(super) order: Order,
    pub(super) u: &'a [f64],
    /// The owners that are visited, where these are not all.
    pub(super) only: Option<&'a Bits>,
}

impl Visit<'_> {
    /// Hands the slab's interactions of one kind to a sink.
    pub(super) fn run<const D: usize, const K: usize>(
        &self,
        kind: &Kind,
        (cliques, gathered): (&mut CliqueRoom<D>, &mut Gathered<D>),
        sink: &mut impl Sink<D, K>,
    ) -> Result<(), NonFinite> {
        self.energy.for_each_owner_of::<D, K, _>((self.slab, self.only), cliques, |cliques| {
            gathered.begin(kind, cliques, self.u);
            if let Some(factors) = kind.factors.as_ref().filter(|_| K == 1) {
                let own = self.energy.neighborhood.bonds(cliques.owner());
                gathered.members.correct(&factors[own]);
            }
            if sink.begin(cliques, gathered) {
                let mut list = |clique: Clique, sink: &mut _| -> Result<(), NonFinite> {
                    gathered.list.push(clique);
                    // Tetrahedra are too many to be listed.
                    if K == 3 && gathered.list.len() == CAPACITY {
                        self.flush(kind, cliques, gathered, sink)?;
                    }
                    Ok(())
                };
                // What triangles and tetrahedra remember is found by their numbers.
                match K > 1 && kind.has_states() {
                    true => cliques.each_numbered::<K, _>(|clique| match sink.wants(&clique) {
                        true => list(clique, &mut *sink),
                        false => Ok(()),
                    })?,
                    false => cliques.each::<K, _>(|clique| list(clique, &mut *sink))?,
                }
            }
            self.flush(kind, cliques, gathered, sink)?;
            sink.end(cliques);
            Ok(())
        })
    }

    /// Evaluates what is listed and hands it on.
    fn flush<const D: usize, const K: usize>(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        gathered: &mut Gathered<D>,
        sink: &mut impl Sink<D, K>,
    ) -> Result<(), NonFinite> {
        let result = match gathered.law {
            Some(law) => {
                self.evaluate(kind, (law, 1.0), cliques, gathered, 0..gathered.list.len(), sink)
            }
            None => self.flush_mixed(kind, cliques, gathered, sink),
        };
        gathered.list.clear();
        result
    }

    /// The same where points are of several materials: interactions go with those whose corners are of
    /// the same ones.
    #[cold]
    fn flush_mixed<const D: usize, const K: usize>(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        gathered: &mut Gathered<D>,
        sink: &mut impl Sink<D, K>,
    ) -> Result<(), NonFinite> {
        let Some(materials) = &kind.materials else { return Ok(()) };
        // The materials of the corners but the owner's, ascending, as one number.
        let of_corners = |clique: &Clique| -> u32 {
            let mut corners = clique
                .corners::<K>()
                .map(|member| materials.of(cliques.members()[member] as usize));
            corners.sort_unstable();
            corners.into_iter().fold(0, |all, own| all << 8 | u32::from(own))
        };
        gathered.sort_by(of_corners);
        let mut start = 0;
        while start < gathered.list.len() {
            let (corners, _) = gathered.order[start];
            let points = named(cliques, &gathered.list[start].corners::<K>());
            let same = gathered.order[start..].partition_point(|(other, _)| *other <= corners);
            let lanes = start..start + same;
            for part in kind.parts_of(&points).iter() {
                self.evaluate(kind, part, cliques, gathered, lanes.clone(), sink)?;
            }
            start = lanes.end;
        }
        Ok(())
    }

    /// Evaluates some of what is listed by one law, which has this part in it, and hands it on.
    fn evaluate<const D: usize, const K: usize>(
        &self,
        kind: &Kind,
        (law, part): (usize, f64),
        cliques: &OwnerCliques<'_, D>,
        gathered: &mut Gathered<D>,
        lanes: Range<usize>,
        sink: &mut impl Sink<D, K>,
    ) -> Result<(), NonFinite> {
        let Some(element) = kind.element(law) else { return Ok(()) };
        let Gathered { list, members, batch, out, .. } = gathered;
        for lanes in list[lanes].chunks(CAPACITY) {
            members.gather::<K>(kind, cliques, lanes, batch);
            if part != 1.0 {
                batch.weight.iter_mut().for_each(|weight| *weight *= part);
            }
            if let Some(fields) = kind.fields_of(law) {
                let (owner, measure) = (cliques.owner(), kind.measure());
                let point = |member: usize| cliques.members()[member] as usize;
                let first = match K {
                    // Members are the owner's later neighbours, with its bonds.
                    1 => self.energy.neighborhood.bonds(owner).start,
                    _ => fields.0.first_number(measure, owner),
                };
                let numbered = |clique: &Clique| {
                    let corners = clique.corners::<K>();
                    let own = if K == 1 { corners[0] } else { clique.number as usize };
                    let members = corners.into_iter().map(point);
                    (std::iter::once(owner).chain(members), first + own)
                };
                batch.take_fields(fields, measure, lanes.iter().map(numbered));
            }
            element.evaluate(batch, self.order, out).map_err(|lane| {
                let points = lanes[lane.lane].corners::<K>();
                Refusal { element, lane }.of::<D>(named(cliques, &points), self.u)
            })?;
            sink.take(cliques, lanes, out);
        }
        Ok(())
    }
}

/// Interactions of one owner on their way through an element.
pub(super) struct Gathered<const D: usize> {
    /// Those that come next.
    pub(super) list: Vec<Clique>,
    /// The law that all of them take; nothing where they take several.
    pub(super) law: Option<usize>,
    pub(super) members: Members<D>,
    batch: InteractionBatch,
    out: Contributions,
    /// By what they were sorted, each with its place before; and room for sorting.
    order: Vec<(u32, u32)>,
    sorted: Vec<Clique>,
}

/// What interactions need of their owner and of its members.
pub(super) struct Members<const D: usize> {
    /// Displacements relative to the owner, in m.
    pub(super) displacement: Vec<[f64; D]>,
    /// Shares in the weights: the owner's, and those of the members.
    pub(super) own_share: f64,
    pub(super) shares: Vec<f64>,
    /// Of the bonds with the members, where they are corrected.
    factors: Vec<f64>,
}

impl<const D: usize> Gathered<D> {
    /// Room for owners of so many members.
    pub(super) fn new(kind: &Kind, members: usize) -> Gathered<D> {
        let measure = kind.measure();
        let listed = match measure.points() - 1 {
            1 => members,
            2 => members * members / 2,
            _ => CAPACITY,
        };
        Gathered {
            list: Vec::with_capacity(listed),
            law: None,
            members: Members {
                displacement: Vec::with_capacity(members),
                own_share: 0.0,
                shares: Vec::with_capacity(members),
                factors: Vec::with_capacity(kind.factors.as_ref().map_or(0, |_| members)),
            },
            batch: InteractionBatch::new(measure, D),
            out: Contributions::new(measure, D),
            order: Vec::new(),
            sorted: Vec::new(),
        }
    }

    /// Sorts what comes next by a number, equal ones in their order.
    fn sort_by(&mut self, number: impl Fn(&Clique) -> u32) {
        let Gathered { list, order, sorted, .. } = self;
        order.clear();
        order.extend((0..).zip(&*list).map(|(place, clique)| (number(clique), place)));
        order.sort_unstable();
        sorted.clear();
        sorted.extend(order.iter().map(|(_, place)| list[*place as usize]));
        std::mem::swap(list, sorted);
    }

    fn begin(&mut self, kind: &Kind, cliques: &OwnerCliques<'_, D>, u: &[f64]) {
        // A refusal ends a pass with interactions left.
        self.list.clear();
        self.law = kind.law_of(cliques);
        let Members { displacement, own_share, shares, factors } = &mut self.members;
        factors.clear();
        let (owner, members) = (cliques.owner(), cliques.members().iter());
        let own = row::<D>(u, owner);
        displacement.clear();
        displacement.extend(members.clone().map(|&member| minus(&row(u, member as usize), &own)));
        *own_share = kind.weights.share(owner);
        shares.clear();
        shares.extend(members.map(|&member| kind.weights.share(member as usize)));
    }
}

impl<const D: usize> Members<D> {
    /// Takes in the factors of an owner's bonds; broken ones are at rest.
    fn correct(&mut self, factors: &[f64]) {
        self.factors.extend_from_slice(factors);
        let broken =
            self.displacement.iter_mut().zip(factors).filter(|(_, factor)| **factor == 0.0);
        broken.for_each(|(displacement, _)| *displacement = [0.0; D]);
    }

    /// Fills a batch, of at most [`CAPACITY`].
    fn gather<const K: usize>(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        lanes: &[Clique],
        batch: &mut InteractionBatch,
    ) {
        let lanes = &lanes[..lanes.len().min(CAPACITY)];
        let corners = |lane: usize| lanes[lane].corners::<K>();
        batch.gather(lanes.len(), cliques.reference(), &self.displacement, corners);
        let mut known = ([usize::MAX; K], 0.0);
        for lane in 0..lanes.len() {
            let corners = corners(lane);
            // Neighbouring interactions share all corners but the last.
            if corners[..K - 1] != known.0[..K - 1] || lane == 0 {
                let begun = corners.map(|member| self.shares[member]);
                known = (corners, kind.weights.begin(self.own_share, &begun[..K - 1]));
            }
            let last = self.shares[corners[K - 1]];
            batch.weight[lane] = kind.weights.join_last(known.1, last);
        }
        if !self.factors.is_empty() {
            let of_lane = |lane: usize| self.factors[corners(lane)[0]];
            (0..lanes.len()).for_each(|lane| batch.weight[lane] *= of_lane(lane));
        }
    }
}

/// An interaction that its element refused.
pub(super) struct Refusal<'a> {
    pub(super) element: &'a dyn Element,
    pub(super) lane: NonFiniteLane,
}

impl Refusal<'_> {
    /// What is known of it, from its points.
    pub(super) fn of<const D: usize>(&self, points: Vec<usize>, u: &[f64]) -> NonFinite {
        let (element, NonFiniteLane { value, reference, .. }) = (self.element, self.lane);
        NonFinite {
            argument: Argument::Measure(element.measure()),
            displacements: points.iter().flat_map(|&point| row::<D>(u, point)).collect(),
            points,
            value,
            reference,
            inverted: element.forbids_inversion() && value <= 0.0,
        }
    }
}

/// The points of an interaction of an owner, from its members.
pub(super) fn named<const D: usize>(
    cliques: &OwnerCliques<'_, D>,
    members: &[usize],
) -> Vec<usize> {
    let point = |&member: &usize| cliques.members()[member] as usize;
    std::iter::once(cliques.owner()).chain(members.iter().map(point)).collect()
}

/// What an array of `D` numbers per point has for one.
#[inline(always)]
pub(super) fn row<const D: usize>(rows: &[f64], point: usize) -> [f64; D] {
    std::array::from_fn(|axis| rows[point * D + axis])
}

/// `p - q`.
#[inline(always)]
pub(super) fn minus<const D: usize>(p: &[f64; D], q: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|axis| p[axis] - q[axis])
}
