//! Bodies that break: an energy at a status that changes between evaluations only.
//!
//! | module | does |
//! |---|---|
//! | [`Breaking`] | the energy of what is left, and its [`Fracture`] |
//! | [`criteria`] | which bonds break at given displacements |
//! | [`crack`] | which bonds a crack cuts that is there from the start |
//!
//! With the status `h` a body has one energy `E(u; h)`, of which forces and tangents are exact
//! derivatives as ever. `h` changes in [`Fracture::advance`] alone, at fixed `u`: so what breaking releases
//! is by definition `E(u; old) - E(u; new)`. All bonds are judged at the same displacements before any of
//! them is taken out, and none comes back: but for [`Fracture::restore`], after attempts at an equilibrium
//! that came to nothing, which never were states of the body.

pub mod crack;
pub mod criteria;
mod equilibria;

use std::ops::Range;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use crate::body::Body;
use crate::energy::{Energy, Hessian, Inversion, NonFinite, Products, Term, Total, Wanted};
use crate::interaction::{Inverted, Report};
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::neighborhood::Neighborhood;
use criteria::Criteria;
pub use criteria::margin::Foremost;

/// What bonds that break leave behind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Release {
    /// How many bonds.
    pub bonds: usize,
    /// The energy that they held, in J.
    pub energy: f64,
    /// The work in J that their forces would have done over the second half of the way that led here: half
    /// of the power of `dE/du` of these bonds with the displacements of that way.
    pub timing: f64,
}

impl Release {
    /// Adds that of other bonds.
    pub fn add(&mut self, other: Release) {
        self.bonds += other.bonds;
        self.energy += other.energy;
        self.timing += other.timing;
    }
}

/// The status of a body that can break, and how it changes. Bonds have the numbers of the neighbourhood
/// ([`Neighborhood::bonds`]).
pub trait Fracture: Sync {
    /// Breaks the bonds whose criteria say so at displacements `u`, after a way of the displacements
    /// `step*direction`, all in m and `n x d`.
    ///
    /// # Errors
    /// Margins and energies that are not finite.
    fn advance(&self, u: &[f64], way: (f64, &[f64])) -> Result<Release, NonFinite>;

    /// The same where the energy has worked out forces at these displacements just before, and nothing since:
    /// bonds are judged only where that pass has seen some beyond their limits. If any break, the forces
    /// are no longer those of the body.
    ///
    /// # Errors
    /// As [`Fracture::advance`].
    fn advance_behind_forces(&self, u: &[f64], way: (f64, &[f64])) -> Result<Release, NonFinite>;

    /// Breaks the bond whose margin is largest, and those within `tie` of it, if any bond breaks at `u` at
    /// all: as [`Fracture::foremost`] finds them.
    ///
    /// # Errors
    /// As [`Fracture::advance`].
    fn advance_foremost(&self, u: &[f64], tie: f64) -> Result<Release, NonFinite>;

    /// The bonds that are closest to breaking at displacements `u` in m; none where no bond can break.
    /// With them go those whose margins are below the largest by no more than `tie`, a share.
    ///
    /// # Errors
    /// Margins that are not finite.
    fn foremost(&self, u: &[f64], tie: f64) -> Result<Option<Foremost>, NonFinite>;

    /// Breaks these bonds at displacements `u` in m, whatever criteria say: there is no way that led there.
    ///
    /// # Errors
    /// Energies that are not finite.
    fn break_at(&self, u: &[f64], bonds: &[usize]) -> Result<Release, NonFinite>;

    /// Makes these bonds, ascending, the ones that are broken: as [`Fracture::broken`] had them at the last
    /// equilibrium, after attempts that never became states.
    fn restore(&self, broken: &[usize]);

    /// The bonds that are broken, in ascending order.
    fn broken(&self) -> Vec<usize>;

    /// Breaks these bonds, and says nothing of energies: bonds of a crack, or of an earlier run.
    fn take_out(&self, bonds: &[usize]);

    /// The share of the volume of each point's neighbours whose bonds with it are broken, between 0 and 1:
    /// partmann2026 (5.8). 0 of a point that has no neighbours.
    fn damage(&self) -> Vec<f64>;

    /// How many bonds there are, and how many of them are broken; without those that never were there.
    fn counts(&self) -> [usize; 2];

    /// How many numbers of bonds there are.
    fn n_bonds(&self) -> usize;
}

/// A pattern of all bonds without those that are broken, by their numbers in ascending order.
pub fn left_of(bonds: &BlockPattern, broken: &[usize]) -> BlockPattern {
    let mut left = BlockPattern {
        dimension: bonds.dimension,
        row_start: vec![0],
        columns: Vec::with_capacity(bonds.columns.len()),
    };
    let (mut number, mut broken) = (0, broken.iter().copied().peekable());
    for row in bonds.row_start.windows(2) {
        let point = left.row_start.len() as u32 - 1;
        for &column in &bonds.columns[row[0]..row[1]] {
            let is_bond = column != point;
            if !(is_bond && broken.next_if_eq(&number).is_some()) {
                left.columns.push(column);
            }
            number += usize::from(is_bond);
        }
        left.row_start.push(left.columns.len());
    }
    left
}

/// Energies of a body, added up, that lose bonds.
pub struct Breaking {
    body: Arc<Body>,
    neighborhood: Arc<Neighborhood>,
    names: Arc<[String]>,
    pattern: Arc<BlockPattern>,
    bond_pattern: Option<Arc<BlockPattern>>,
    criteria: Criteria,
    /// Bonds that count as if they had never been there, ascending.
    absent: Vec<usize>,
    status: RwLock<Status>,
}

/// What changes when bonds break.
struct Status {
    energy: Total<'static>,
    is_broken: Vec<bool>,
    n_broken: usize,
}

impl Status {
    fn note(&mut self, bonds: &[usize]) {
        for &bond in bonds {
            self.n_broken += usize::from(!self.is_broken[bond]);
            self.is_broken[bond] = true;
        }
    }
}

impl Breaking {
    /// Energies of the body that [can lose bonds](Energy::can_lose_bonds), of these neighbours;
    /// `names` has a name for each of their parts. Bonds of `absent` (in ascending order) are not there
    /// at all: their points are not damaged by that.
    pub fn new(
        (body, neighborhood): (Arc<Body>, Arc<Neighborhood>),
        terms: Vec<Box<dyn Energy>>,
        names: Arc<[String]>,
        criteria: Criteria,
        absent: Vec<usize>,
    ) -> Breaking {
        assert!(terms.iter().all(|term| term.can_lose_bonds()), "energies that can lose bonds");
        let terms = terms.into_iter().map(Term::Owned).collect();
        let mut energy = Total::named(terms, Arc::clone(&names));
        if !criteria.are_empty() {
            energy.watch(criteria.limits());
        }
        let (pattern, bonds) = (Arc::clone(energy.pattern()), energy.bond_pattern().cloned());
        let is_broken = vec![false; neighborhood.n_bonds()];
        let status = RwLock::new(Status { energy, is_broken, n_broken: 0 });
        let bond_pattern = bonds;
        let breaking =
            Breaking { body, neighborhood, names, pattern, bond_pattern, criteria, absent, status };
        breaking.take_out(&breaking.absent);
        breaking
    }

    fn all_owners(&self) -> Vec<Range<usize>> {
        std::iter::once(0..self.body.n_points()).collect()
    }

    /// Breaks bonds of some owners.
    fn judge(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        owners: &[Range<usize>],
    ) -> Result<Release, NonFinite> {
        let bonds = {
            let Status { is_broken, .. } = &*self.now();
            let around = (&*self.body, &*self.neighborhood);
            self.criteria.judge(around, u, owners, |bond| !is_broken[bond])?
        };
        if bonds.is_empty() {
            return Ok(Release::default());
        }
        let mut status = self.change();
        let release = status.energy.break_bonds(u, way, &bonds)?;
        status.note(&bonds);
        Ok(release)
    }

    fn change(&self) -> RwLockWriteGuard<'_, Status> {
        self.status.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// A status that a panic elsewhere has left is as good as any: it changes in one go.
    fn now(&self) -> RwLockReadGuard<'_, Status> {
        self.status.read().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Fracture for Breaking {
    fn advance(&self, u: &[f64], way: (f64, &[f64])) -> Result<Release, NonFinite> {
        self.judge(u, way, &self.all_owners())
    }

    fn advance_behind_forces(&self, u: &[f64], way: (f64, &[f64])) -> Result<Release, NonFinite> {
        let exceeding = self.now().energy.exceeding();
        self.judge(u, way, &exceeding.unwrap_or_else(|| self.all_owners()))
    }

    fn advance_foremost(&self, u: &[f64], tie: f64) -> Result<Release, NonFinite> {
        self.judge_foremost(u, tie)
    }

    fn foremost(&self, u: &[f64], tie: f64) -> Result<Option<Foremost>, NonFinite> {
        self.find_foremost(u, tie)
    }

    fn break_at(&self, u: &[f64], bonds: &[usize]) -> Result<Release, NonFinite> {
        self.take_out_at(u, bonds)
    }

    fn restore(&self, broken: &[usize]) {
        self.put_back(broken);
    }

    fn broken(&self) -> Vec<usize> {
        let status = self.now();
        (0..status.is_broken.len()).filter(|bond| status.is_broken[*bond]).collect()
    }

    fn take_out(&self, bonds: &[usize]) {
        if bonds.is_empty() {
            return;
        }
        let mut status = self.change();
        status.note(bonds);
        status.energy.lose(bonds);
    }

    fn damage(&self) -> Vec<f64> {
        let status = self.now();
        let n = self.body.n_points();
        let (mut family, mut lost) = (vec![0.0; n], vec![0.0; n]);
        let volumes = self.body.volumes();
        let mut absent = self.absent.iter().copied().peekable();
        for point in 0..n {
            let bonds = self.neighborhood.bonds(point);
            for (bond, &other) in bonds.zip(self.neighborhood.upper(point)) {
                if absent.next_if_eq(&bond).is_some() {
                    continue;
                }
                let other = other as usize;
                family[point] += volumes[other];
                family[other] += volumes[point];
                if status.is_broken[bond] {
                    lost[point] += volumes[other];
                    lost[other] += volumes[point];
                }
            }
        }
        let share = |(lost, family): (&f64, &f64)| if *family > 0.0 { lost / family } else { 0.0 };
        lost.iter().zip(&family).map(share).collect()
    }

    fn n_bonds(&self) -> usize {
        self.neighborhood.n_bonds()
    }

    fn counts(&self) -> [usize; 2] {
        let absent = self.absent.len();
        [self.neighborhood.n_bonds() - absent, self.now().n_broken - absent]
    }
}

impl Energy for Breaking {
    fn dimension(&self) -> usize {
        self.body.dimension()
    }

    fn positions(&self) -> &[f64] {
        self.body.positions()
    }

    fn parts(&self) -> &Arc<[String]> {
        &self.names
    }

    fn report(&self) -> Report {
        self.now().energy.report()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        self.bond_pattern.as_ref()
    }

    fn springs(&self, u: &[f64], springs: &mut BlockMatrix) {
        self.springs_of_whole(u, springs);
    }

    fn products(&self) -> Products {
        self.now().energy.products()
    }

    fn has_quick_products(&self) -> bool {
        self.now().energy.has_quick_products()
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.evaluate(u, wanted, parts)
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.shares(u, shares)
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        self.now().energy.virials(u, virials)
    }

    fn displacement_gradients(&self, u: &[f64]) -> Option<Vec<f64>> {
        self.now().energy.displacement_gradients(u)
    }

    fn stretches_across(&self, gradients: &[f64]) -> Option<Vec<f64>> {
        self.now().energy.stretches_across(gradients)
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        Ok(Box::new(AtPresent { energy: self, u: u.to_vec() }))
    }

    fn first_inversion(&self, u: &[f64], step: &[f64]) -> Option<Inversion> {
        self.now().energy.first_inversion(u, step)
    }

    fn inverted(&self, u: &[f64]) -> Inverted {
        self.now().energy.inverted(u)
    }

    fn fracture(&self) -> Option<&dyn Fracture> {
        Some(self)
    }
}

/// The Hessian at the present status.
struct AtPresent<'a> {
    energy: &'a Breaking,
    /// Displacements, `n x d`, in m.
    u: Vec<f64>,
}

impl Hessian for AtPresent<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        match self.energy.now().energy.hessian(&self.u) {
            Ok(hessian) => hessian.multiply(p, product),
            Err(_) => product.fill(f64::NAN),
        }
    }
}
