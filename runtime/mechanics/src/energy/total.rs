//! Sums of energies.
//!
//! This is the one place where energies add, and where it is decided what of the displacements they
//! see and how products with their Hessians come about.
//!
//! # Strain from positions
//! Programs that store where points are and not how far they moved know of the displacements what a
//! position `x = X + u` holds: the digits of `u` above `2^-53 |x|`. Lengths, areas and volumes worked
//! out from positions know no others. So the energy is evaluated at `fl(X + u) - X`. What the
//! subtraction `l/L - 1` itself would lose besides is of the size of `2^-53`, no more than the
//! positions have lost already wherever `|x|` is not small against the bond.

use std::ops::{Deref, Range};
use std::sync::{Arc, OnceLock};

use super::differences::{ForceDifferences, smallest_distance, step};
use super::{
    Dissipation, Energy, Hessian, Inversion, Limits, NonFinite, Products, Wanted, check_sizes,
};
use crate::dissipation::Dashpots;
use crate::fracture::{Asked, Fracture, Held, Judged, Release};
use crate::interaction::{Inverted, Ranks, Report};
use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::pool::Pool;

/// An energy of a sum, owned or borrowed.
pub enum Term<'a> {
    /// Owned.
    Owned(Box<dyn Energy + 'a>),
    /// Someone else's.
    Borrowed(&'a dyn Energy),
}

impl<'a> Deref for Term<'a> {
    type Target = dyn Energy + 'a;

    fn deref(&self) -> &(dyn Energy + 'a) {
        match self {
            Term::Owned(energy) => &**energy,
            Term::Borrowed(energy) => *energy,
        }
    }
}

impl<'a, E: Energy + 'a> From<Box<E>> for Term<'a> {
    fn from(energy: Box<E>) -> Term<'a> {
        Term::Owned(energy)
    }
}

impl<'a> From<&'a dyn Energy> for Term<'a> {
    fn from(energy: &'a dyn Energy) -> Term<'a> {
        Term::Borrowed(energy)
    }
}

/// The sum of energies of one body.
pub struct Total<'a> {
    terms: Vec<Term<'a>>,
    /// Which of the parts belong to each term.
    ranges: Vec<Range<usize>>,
    names: Arc<[String]>,
    pattern: OnceLock<Arc<BlockPattern>>,
    bond_pattern: OnceLock<Option<Arc<BlockPattern>>>,
    from_positions: bool,
    products: Products,
    /// What the body dissipates, where no term says it.
    dissipation: Option<Dashpots>,
    /// The smallest distance of neighbours at rest, in m, once it is asked for.
    smallest: OnceLock<f64>,
    /// Room for what the terms give before it is added.
    rooms: Pool<Room>,
}

/// What is kept from one evaluation to the next.
#[derive(Default)]
struct Room {
    /// Displacements that positions hold, `n x d`.
    held: Vec<f64>,
    /// Forces of one term, `n x d`.
    forces: Vec<f64>,
    /// Diagonal blocks of one term, or its energy by points.
    blocks: Vec<f64>,
    /// Blocks of the tangent of one term, on its pattern.
    tangent: Vec<f64>,
    /// The parts of its energy, where nobody asks for them.
    parts: Vec<f64>,
}

impl<'a> Total<'a> {
    /// The energy itself.
    pub fn of(energy: impl Into<Term<'a>>) -> Total<'a> {
        let energy = energy.into();
        let names = Arc::clone(energy.parts());
        Total::named(vec![energy], names)
    }

    /// The sum of at least one energy of the same body. `names` has as many names as the terms have
    /// parts together.
    pub fn named(terms: Vec<Term<'a>>, names: Arc<[String]>) -> Total<'a> {
        let mut end = 0;
        let ranges: Vec<Range<usize>> = terms
            .iter()
            .map(|term| {
                let start = end;
                end += term.parts().len();
                start..end
            })
            .collect();
        assert!(end == names.len() && !terms.is_empty(), "a name for each part");
        let same = |term: &Term<'_>| term.positions().len() == terms[0].positions().len();
        assert!(terms.iter().all(same), "energies of one body");
        Total {
            ranges,
            names,
            pattern: OnceLock::new(),
            bond_pattern: OnceLock::new(),
            from_positions: false,
            products: Products::Exact,
            dissipation: None,
            smallest: OnceLock::new(),
            rooms: Pool::new(),
            terms,
        }
    }

    /// The same with strain from positions, or from displacements.
    pub fn from_positions(self, from_positions: bool) -> Total<'a> {
        Total { from_positions, ..self }
    }

    /// The same with products that come about so.
    pub fn with_products(self, products: Products) -> Total<'a> {
        Total { products, ..self }
    }

    /// The same of a body that dissipates.
    pub fn with_dissipation(self, dissipation: Dashpots) -> Total<'a> {
        Total { dissipation: Some(dissipation), ..self }
    }

    /// How far the point that moves most is moved from displacements `u`, in m, for products by
    /// differences.
    pub fn step(&self, u: &[f64]) -> f64 {
        let smallest =
            self.smallest.get_or_init(|| smallest_distance(self.bonds(), self.positions()));
        step(self.products, *smallest, u)
    }

    /// The only energy; `None` of several.
    fn alone(&self) -> Option<&(dyn Energy + 'a)> {
        if let [term] = &self.terms[..] { Some(&**term) } else { None }
    }

    /// The displacements that the energies see; `room` is for them.
    fn held<'u>(&self, u: &'u [f64], room: &'u mut Vec<f64>) -> &'u [f64] {
        if !self.from_positions {
            return u;
        }
        room.clear();
        room.extend(u.iter().zip(self.positions()).map(|(u, x)| (x + u) - x));
        room
    }

    /// Fills `matrix` with the sum of what terms with these patterns fill their own matrices with, which
    /// take their turns in `room`.
    fn add_up<'p>(
        matrix: &mut BlockMatrix,
        patterns: impl Iterator<Item = &'p Arc<BlockPattern>> + Clone,
        room: &mut Vec<f64>,
        mut fill: impl FnMut(usize, &mut BlockMatrix) -> Result<(), NonFinite>,
    ) -> Result<(), NonFinite> {
        // One whose pattern this is fills it; the others are smaller.
        let is_whole =
            |pattern: &Arc<BlockPattern>| pattern.n_blocks() == matrix.pattern.n_blocks();
        let whole = patterns.clone().position(is_whole);
        match whole {
            Some(whole) => fill(whole, matrix)?,
            None => matrix.values.fill(0.0),
        }
        for (number, pattern) in patterns.enumerate() {
            if Some(number) != whole {
                let mut part = BlockMatrix::in_room(pattern, std::mem::take(room));
                let filled = fill(number, &mut part);
                if filled.is_ok() {
                    matrix.add(&part);
                }
                *room = part.values;
                filled?;
            }
        }
        Ok(())
    }

    /// The tangent of several energies, which add up.
    fn tangents(
        &self,
        u: &[f64],
        (own, room): (&mut Vec<f64>, &mut Vec<f64>),
        forces: &mut [f64],
        tangent: &mut BlockMatrix,
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        own.resize(forces.len(), 0.0);
        forces.fill(0.0);
        let patterns = self.terms.iter().map(|term| term.pattern());
        Total::add_up(tangent, patterns, room, |number, matrix| {
            let parts = &mut parts[self.ranges[number].clone()];
            self.terms[number].evaluate(u, Wanted::Tangent(own, matrix), parts)?;
            add(forces, own);
            Ok(())
        })
    }
}

/// Adds entry by entry.
fn add(sum: &mut [f64], part: &[f64]) {
    sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
}

/// The smallest pattern with the blocks of all, `None` of none.
fn union<'p>(patterns: impl Iterator<Item = &'p Arc<BlockPattern>>) -> Option<Arc<BlockPattern>> {
    patterns.fold(None, |union, pattern| match union {
        None => Some(Arc::clone(pattern)),
        Some(union) => Some(union.with(pattern)),
    })
}

impl Energy for Total<'_> {
    fn dimension(&self) -> usize {
        self.terms[0].dimension()
    }

    fn counted(&self) -> Range<usize> {
        self.terms[0].counted()
    }

    fn positions(&self) -> &[f64] {
        self.terms[0].positions()
    }

    fn parts(&self) -> &Arc<[String]> {
        &self.names
    }

    fn report(&self) -> Report {
        let reports = self.terms.iter().map(|term| term.report());
        reports.fold(Report::default(), Report::and)
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        if let Some(energy) = self.alone() {
            return energy.pattern();
        }
        let all = || union(self.terms.iter().map(|term| term.pattern()));
        self.pattern.get_or_init(|| all().unwrap_or_else(|| Arc::clone(self.terms[0].pattern())))
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        let all = || {
            self.terms.iter().find(|term| term.bond_pattern().is_some())?;
            union(self.terms.iter().map(|term| term.bonds()))
        };
        self.bond_pattern.get_or_init(all).as_ref()
    }

    fn springs(&self, u: &[f64], springs: &mut BlockMatrix) {
        let mut room = self.rooms.take(Room::default);
        let Room { held, forces, tangent, parts, .. } = &mut *room;
        let u = self.held(u, held);
        let patterns = self.terms.iter().map(|term| term.bonds());
        let filled = Total::add_up(springs, patterns, tangent, |number, matrix| {
            let term = &self.terms[number];
            if term.bond_pattern().is_some() {
                term.springs(u, matrix);
                return Ok(());
            }
            // Couples bonded points only, and is the Hessian itself.
            forces.resize(u.len(), 0.0);
            parts.resize(term.parts().len(), 0.0);
            term.evaluate(u, Wanted::Tangent(forces, matrix), parts)
        });
        // What is not finite is found by whoever asks for the energy at the same displacements.
        if filled.is_err() {
            springs.values.fill(f64::NAN);
        }
    }

    fn has_quick_products(&self) -> bool {
        let alone = self.alone().filter(|_| self.products == Products::Exact);
        alone.is_some_and(|energy| energy.has_quick_products())
    }

    fn products(&self) -> Products {
        self.products
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        check_sizes(self, u, &wanted, parts);
        let mut room = self.rooms.take(Room::default);
        let Room { held, forces: own, blocks, tangent: part, .. } = &mut *room;
        let u = self.held(u, held);
        if let Some(energy) = self.alone() {
            return energy.evaluate(u, wanted, parts);
        }
        let terms = || self.terms.iter().zip(&self.ranges);
        match wanted {
            Wanted::Energy => {
                for (term, range) in terms() {
                    term.evaluate(u, Wanted::Energy, &mut parts[range.clone()])?;
                }
            }
            Wanted::Forces(forces) => {
                own.resize(forces.len(), 0.0);
                forces.fill(0.0);
                for (term, range) in terms() {
                    // Without parts forces come alone.
                    let parts = parts.get_mut(range.clone()).unwrap_or_default();
                    term.evaluate(u, Wanted::Forces(own), parts)?;
                    add(forces, own);
                }
            }
            Wanted::Diagonal(forces, diagonal) => {
                own.resize(forces.len(), 0.0);
                blocks.resize(diagonal.len(), 0.0);
                forces.fill(0.0);
                diagonal.fill(0.0);
                for (term, range) in terms() {
                    let wanted = Wanted::Diagonal(own, blocks);
                    term.evaluate(u, wanted, &mut parts[range.clone()])?;
                    add(forces, own);
                    add(diagonal, blocks);
                }
            }
            Wanted::Tangent(forces, tangent) => {
                self.tangents(u, (own, part), forces, tangent, parts)?;
            }
        }
        Ok(())
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        let mut room = self.rooms.take(Room::default);
        let Room { held, blocks: own, .. } = &mut *room;
        let u = self.held(u, held);
        own.resize(shares.len(), 0.0);
        shares.fill(0.0);
        for term in &self.terms {
            term.shares(u, own)?;
            add(shares, own);
        }
        Ok(())
    }

    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        let mut room = self.rooms.take(Room::default);
        let u = self.held(u, &mut room.held);
        let all = self.terms.iter().zip(&self.ranges);
        for (term, range) in all.filter(|(_, range)| range.contains(&part)) {
            term.shares_of(part - range.start, u, shares)?;
        }
        Ok(())
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        let mut room = self.rooms.take(Room::default);
        let Room { held, blocks: own, .. } = &mut *room;
        let u = self.held(u, held);
        own.resize(virials.len(), 0.0);
        virials.fill(0.0);
        for term in &self.terms {
            term.virials(u, own)?;
            add(virials, own);
        }
        Ok(())
    }

    fn displacement_gradients(&self, u: &[f64]) -> Option<Vec<f64>> {
        let mut room = self.rooms.take(Room::default);
        let u = self.held(u, &mut room.held);
        self.terms.iter().find_map(|term| term.displacement_gradients(u))
    }

    fn stretches_across(&self, gradients: &[f64]) -> Option<Vec<f64>> {
        self.terms.iter().find_map(|term| term.stretches_across(gradients))
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        if self.products != Products::Exact {
            let (step, products) = (self.step(u), self.products);
            return Ok(Box::new(ForceDifferences::new(self, products, u, step)?));
        }
        let mut room = self.rooms.take(Room::default);
        let u = self.held(u, &mut room.held);
        if let Some(energy) = self.alone() {
            return energy.hessian(u);
        }
        let hessians: Result<Vec<_>, _> = self.terms.iter().map(|term| term.hessian(u)).collect();
        Ok(Box::new(SumOfHessians { terms: hessians?, rooms: Pool::new() }))
    }

    fn first_inversion(&self, u: &[f64], step: &[f64]) -> Option<Inversion> {
        let mut room = self.rooms.take(Room::default);
        let u = self.held(u, &mut room.held);
        let found = self.terms.iter().filter_map(|term| term.first_inversion(u, step));
        found.min_by(|p, q| p.part.total_cmp(&q.part))
    }

    fn field_margins(&self, u: &[f64], asked: Asked) -> Result<Vec<Judged>, NonFinite> {
        let found: Result<Vec<_>, _> =
            self.terms.iter().map(|term| term.field_margins(u, asked)).collect();
        Ok(found?.concat())
    }

    fn has_field_conditions(&self) -> bool {
        self.terms.iter().any(|term| term.has_field_conditions())
    }

    fn has_field_states(&self) -> bool {
        self.terms.iter().any(|term| term.has_field_states())
    }

    fn change_field_states(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        breaking: &[usize],
    ) -> Result<Release, NonFinite> {
        let mut all = self.terms.iter().map(|term| term.change_field_states(u, way, breaking));
        all.try_fold(Release::default(), |mut sum, release| {
            sum.add(release?);
            Ok(sum)
        })
    }

    fn can_lose_bonds(&self) -> bool {
        let can = |term: &Term<'_>| matches!(term, Term::Owned(_)) && term.can_lose_bonds();
        self.terms.iter().all(can)
    }

    fn lose(&mut self, bonds: &[usize]) {
        self.bond_pattern = OnceLock::new();
        for term in &mut self.terms {
            if let Term::Owned(energy) = term {
                energy.lose(bonds);
            }
        }
    }

    fn singular(&self) -> Vec<usize> {
        let mut all: Vec<usize> = self.terms.iter().flat_map(|term| term.singular()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    fn lose_cliques(&mut self, measure: Measure, ranks: &Ranks, numbers: &[usize]) {
        for term in &mut self.terms {
            if let Term::Owned(energy) = term {
                energy.lose_cliques(measure, ranks, numbers);
            }
        }
    }

    fn regain(&mut self, bonds: &[usize]) {
        self.bond_pattern = OnceLock::new();
        for term in &mut self.terms {
            if let Term::Owned(energy) = term {
                energy.regain(bonds);
            }
        }
    }

    fn regain_cliques(&mut self, measure: Measure, numbers: &[usize]) {
        for term in &mut self.terms {
            if let Term::Owned(energy) = term {
                energy.regain_cliques(measure, numbers);
            }
        }
    }

    fn break_cliques(
        &mut self,
        u: &[f64],
        way: (f64, &[f64]),
        cliques: (Measure, &Ranks, &[usize]),
    ) -> Result<Release, NonFinite> {
        let mut sum = Release::default();
        for term in &mut self.terms {
            if let Term::Owned(energy) = term {
                sum.add(energy.break_cliques(u, way, cliques)?);
            }
        }
        Ok(sum)
    }

    fn watch(&mut self, limits: &[f32]) -> bool {
        // One is enough.
        self.terms.iter_mut().any(|term| match term {
            Term::Owned(energy) => energy.watch(limits),
            Term::Borrowed(_) => false,
        })
    }

    fn watch_cliques(&mut self, measure: Measure, limits: &Limits<'_>) -> bool {
        self.terms.iter_mut().any(|term| match term {
            Term::Owned(energy) => energy.watch_cliques(measure, limits),
            Term::Borrowed(_) => false,
        })
    }

    fn exceeding(&self, measure: Measure) -> Option<Vec<Range<usize>>> {
        self.terms.iter().find_map(|term| term.exceeding(measure))
    }

    fn break_bonds(
        &mut self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
    ) -> Result<Release, NonFinite> {
        self.bond_pattern = OnceLock::new();
        let mut sum = Release::default();
        for term in &mut self.terms {
            if let Term::Owned(energy) = term {
                sum.add(energy.break_bonds(u, way, bonds)?);
            }
        }
        Ok(Release { bonds: bonds.len(), ..sum })
    }

    fn add_held(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        self.terms.iter().try_for_each(|term| term.add_held(u, way, bonds, held))
    }

    fn add_held_by_cliques(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        cliques: (Measure, &Ranks, &[usize]),
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        self.terms.iter().try_for_each(|term| term.add_held_by_cliques(u, way, cliques, held))
    }

    fn fracture(&self) -> Option<&dyn Fracture> {
        self.terms.iter().find_map(|term| term.fracture())
    }

    fn dissipation(&self) -> Option<&dyn Dissipation> {
        let own = self.dissipation.as_ref().map(|own| own as &dyn Dissipation);
        own.or_else(|| self.terms.iter().find_map(|term| term.dissipation()))
    }

    fn inverted(&self, u: &[f64]) -> Inverted {
        let found = self.terms.iter().map(|term| term.inverted(u));
        found.fold(Inverted::default(), Inverted::and)
    }
}

/// The Hessian of a sum of energies.
struct SumOfHessians<'a> {
    terms: Vec<Box<dyn Hessian + 'a>>,
    /// Room for products.
    rooms: Pool<Vec<f64>>,
}

impl Hessian for SumOfHessians<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        let mut own = self.rooms.take(Vec::new);
        own.resize(product.len(), 0.0);
        product.fill(0.0);
        for hessian in &self.terms {
            hessian.multiply(p, &mut own);
            add(product, &own);
        }
    }
}

#[cfg(test)]
mod tests;
