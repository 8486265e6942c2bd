//! Bodies that break: an energy at a status that changes between evaluations only.
//!
//! | module | does |
//! |---|---|
//! | [`Breaking`] | the energy of what is left, and its [`Fracture`] |
//! | [`criteria`] | which bonds break at given displacements |
//! | [`memory`] | what bonds, triangles and tetrahedra remember, and what that becomes (`states`: of the body) |
//! | `cliques` | which triangles and tetrahedra break by a criterion of their own |
//! | `fields` | which bonds break by deformation gradients, and by what points gather |
//! | `walk` | what is left of triangles and tetrahedra, shown to both |
//! | `inspect` | what there is to see: damage (`damage`), states at points (`means`), single bonds ([`Inspection`]) |
//! | `present` | energy, forces and tangent of what is left |
//! | `listed` | all that has numbers, with its points |
//! | `joined` | what holds points together where only triangles and tetrahedra have energies |
//! | [`crack`] | which bonds a crack cuts that is there from the start |
//!
//! With the status `h` a body has one energy `E(u; h)`, of which forces and tangents are exact
//! derivatives as ever. `h` changes in [`Fracture::advance`] alone, at fixed `u`: so what breaking releases
//! is by definition `E(u; old) - E(u; new)`, and so is what is dissipated where something is remembered. All
//! bonds are judged at the same displacements, with what they remember as it is, before any of them is taken out
//! or changes, and none comes back: but for [`Fracture::restore`], after attempts at an equilibrium
//! that came to nothing, which never were states of the body. A triangle or a tetrahedron with a broken edge is broken, too; one that
//! breaks itself leaves its bonds as they are.

mod cliques;
pub mod crack;
pub mod criteria;
mod damage;
mod equilibria;
mod fields;
mod inspect;
mod joined;
mod listed;
mod means;
pub mod memory;
mod present;
mod release;
mod states;
mod walk;

use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use crate::body::Body;
use crate::dissipation::Dashpots;
use crate::energy::{Energy, NonFinite, Term, Total};
use crate::interaction::{Lost, Ranks, n_neighbors};
use crate::kernel::Measure;
use crate::materials::StateOf;
use crate::matrix::BlockPattern;
use crate::neighborhood::Neighborhood;
use criteria::Criteria;
pub use criteria::Judged;
pub use criteria::margin::{Foremost, over_rest};
use damage::Damage;
pub use equilibria::left_of;
pub use fields::{Asked, FamilyCriterion, FamilyNextState};
use inspect::Inspected;
pub use inspect::{Inspection, Look, OnThreshold};
use memory::Memory;
use present::Damping;
pub use release::{Held, Interactions, Release};

/// Triangles and tetrahedra, in the order of [`Interactions::cliques`].
const CLIQUES: [Measure; 2] = [Measure::Area, Measure::Volume];

/// The status of a body that can break, and how it changes. Bonds have the numbers of the neighbourhood
/// ([`Neighborhood::bonds`]).
pub trait Fracture: Inspection {
    /// Breaks the bonds whose criteria say so at displacements `u`, after a way of the displacements
    /// `step*direction`, all in m and `n x d`, and triangles and tetrahedra; others remember what they have come
    /// to `dt` s after the last time.
    ///
    /// # Errors
    /// Margins, next states and energies that are not finite.
    fn advance(&self, u: &[f64], dt: f64, way: (f64, &[f64])) -> Result<Release, NonFinite>;

    /// The same where the energy has worked out forces at these displacements just before, and nothing since,
    /// and nothing is [remembered](Fracture::n_states): bonds, triangles and tetrahedra are judged only where that pass has
    /// seen some beyond their limits. If any break, the forces are no longer those of the body.
    ///
    /// # Errors
    /// As [`Fracture::advance`].
    fn advance_behind_forces(&self, u: &[f64], way: (f64, &[f64])) -> Result<Release, NonFinite>;

    /// Whether bonds break by conditions of deformation gradients, or of gathered values.
    fn has_family_conditions(&self) -> bool;

    /// The bonds that break at displacements `u` in m by such conditions at the points that [count](Energy::counted), by
    /// their ends.
    ///
    /// # Errors
    /// Margins that are not finite.
    fn judged_by_families(&self, u: &[f64]) -> Result<Vec<[usize; 2]>, NonFinite>;

    /// When bonds break the next time, those between these ends do by such conditions, and no others: of a slab the owners
    /// of families have judged them.
    fn decide_for_families(&self, bonds: &[[usize; 2]]);

    /// From now on energies follow what comes to be remembered in `dt` s, as load steps ask: forces are those
    /// at the states that come of it, and the tangent is their derivative, where the laws are made for it;
    /// energies at these states are no potential of the forces. With nothing they are again what they are
    /// between changes of the status.
    fn follow(&self, dt: Option<f64>);

    /// Whether energies can [follow](Fracture::follow) all that is remembered: what is remembered with deformation
    /// gradients, or by points, is held on the way to an equilibrium.
    fn can_follow(&self) -> bool;

    /// All remember what they come to at displacements `to`, `dt` s after the last time, on a way from
    /// displacements `from`, in m; none breaks, and energies follow nothing any more. What is dissipated is
    /// the mean of what the change takes from the energy at both ends of the way, which is of second order
    /// in the way: the fall of the energy at `to` alone would count the way beyond what held.
    ///
    /// # Errors
    /// As [`Fracture::advance`].
    fn evolve(&self, ways: [&[f64]; 2], dt: f64) -> Result<Release, NonFinite>;

    /// Breaks the bonds whose criteria say so at displacements `u` in m; what others remember stays.
    ///
    /// # Errors
    /// As [`Fracture::advance`].
    fn advance_bonds(&self, u: &[f64]) -> Result<Release, NonFinite>;

    /// How many states there are, of bonds, of triangles and of tetrahedra.
    fn n_states(&self) -> usize;

    /// What is remembered, in SI units: state by state, of each all that remember it in their order.
    fn states(&self) -> Vec<f64>;

    /// What remembers each of these states.
    fn remembering(&self) -> Vec<StateOf>;

    /// Shows all bonds, triangles or tetrahedra that have numbers, ascending, with their points: the owner, which is the
    /// lowest, and behind it the others, in lexicographic order. Of triangles and tetrahedra those have numbers that have
    /// criteria of their own, or remember.
    fn each(&self, measure: Measure, see: &mut dyn FnMut(usize, &[usize]));

    /// Gives back what [`Fracture::states`] told, and says nothing of energies.
    fn remember(&self, states: &[f64]);

    /// Breaks the bond, triangle or tetrahedron whose margin is largest, and those within `tie` of it, if any
    /// breaks at `u` at all: as [`Fracture::foremost`] finds them.
    ///
    /// # Errors
    /// As [`Fracture::advance`].
    fn advance_foremost(&self, u: &[f64], tie: f64) -> Result<Release, NonFinite>;

    /// What is closest to breaking at displacements `u` in m; nothing where nothing can break. With it go
    /// those whose margins are below the largest by no more than `tie`, a share.
    ///
    /// # Errors
    /// Margins that are not finite.
    fn foremost(&self, u: &[f64], tie: f64) -> Result<Option<Foremost>, NonFinite>;

    /// Breaks these at displacements `u` in m, whatever criteria say: there is no way that led there.
    ///
    /// # Errors
    /// Energies that are not finite.
    fn break_at(&self, u: &[f64], which: &Interactions) -> Result<Release, NonFinite>;

    /// Makes these the ones that are broken: as [`Fracture::gone`] had them at the last equilibrium, after
    /// attempts that never became states.
    fn restore(&self, gone: &Interactions);

    /// The bonds that are broken, and the triangles and tetrahedra that broke by criteria of their own.
    fn gone(&self) -> Interactions {
        let cliques = CLIQUES.map(|measure| self.broken_cliques(measure));
        Interactions { bonds: self.broken(), cliques }
    }

    /// Of a body in which triangles and tetrahedra alone have energies: a pattern in which points are connected
    /// that what is left of these holds together. Nothing where bonds have energies, or families.
    fn joined(&self) -> Option<BlockPattern>;

    /// The bonds that are broken, in ascending order.
    fn broken(&self) -> Vec<usize>;

    /// Breaks these bonds, and says nothing of energies: bonds of a crack, or of an earlier run.
    fn take_out(&self, bonds: &[usize]);

    /// How many bonds there are, and how many of them are broken; without those that never were there. Of a slab of a
    /// body those whose lower point [counts](Energy::counted).
    fn counts(&self) -> [usize; 2];

    /// How many numbers of bonds there are.
    fn n_bonds(&self) -> usize;

    /// How many numbers of triangles there are, or of tetrahedra, where these have criteria of their own.
    fn n_cliques(&self, measure: Measure) -> usize;

    /// How many triangles, or tetrahedra, there are where these have criteria of their own, and how many of
    /// them broke by these; nothing where they have none. Of a slab those whose owner counts.
    fn counts_of(&self, measure: Measure) -> Option<[usize; 2]>;

    /// How many bonds, triangles and tetrahedra are broken, of those that [`Fracture::counts`] and
    /// [`Fracture::counts_of`] count.
    fn n_broken(&self) -> [usize; 3] {
        let [areas, volumes] =
            CLIQUES.map(|measure| self.counts_of(measure).map_or(0, |counts| counts[1]));
        [self.counts()[1], areas, volumes]
    }

    /// The triangles, or the tetrahedra, that broke by criteria of their own, by their [`Ranks`], ascending.
    fn broken_cliques(&self, measure: Measure) -> Vec<usize>;

    /// Breaks these triangles or tetrahedra, and says nothing of energies; does nothing where these have no
    /// criteria of their own.
    fn take_out_cliques(&self, measure: Measure, numbers: &[usize]);
}

/// Energies of a body, added up, that lose bonds.
pub struct Breaking {
    body: Arc<Body>,
    neighborhood: Arc<Neighborhood>,
    names: Arc<[String]>,
    /// Of the body before anything breaks.
    pattern: OnceLock<Arc<BlockPattern>>,
    bond_pattern: OnceLock<Option<Arc<BlockPattern>>>,
    criteria: Criteria,
    memory: Memory,
    /// What bonds that are there dissipate.
    dissipation: Option<Damping>,
    /// Bonds that count as if they had never been there, ascending.
    absent: Vec<usize>,
    status: Arc<RwLock<Status>>,
    /// What others have decided that breaks next by conditions of families.
    decided: Mutex<Option<Vec<usize>>>,
    /// What is kept for those who look.
    inspected: Inspected,
}

/// What changes when bonds break.
struct Status {
    energy: Total<'static>,
    is_broken: Vec<bool>,
    n_broken: usize,
    /// Where triangles or tetrahedra have criteria of their own, or remember anything.
    lost: Option<Lost>,
    damage: Damage,
}

impl Status {
    fn note(&mut self, neighborhood: &Neighborhood, bonds: &[usize]) {
        if let Some(lost) = &mut self.lost {
            lost.lose_edges(bonds, &Lost::owners_of(neighborhood, bonds));
        }
        for &bond in bonds {
            self.n_broken += usize::from(!self.is_broken[bond]);
            self.is_broken[bond] = true;
            self.damage.touch(neighborhood, bond);
        }
    }
}

impl Breaking {
    /// Energies of the body of these neighbours, which [can lose bonds](Energy::can_lose_bonds) if any may
    /// break; `names` has a name for each of their parts. Bonds of `absent` (in ascending order) are not there
    /// at all: their points are not damaged by that.
    pub fn new(
        (body, neighborhood): (Arc<Body>, Arc<Neighborhood>),
        terms: Vec<Box<dyn Energy>>,
        names: Arc<[String]>,
        (criteria, memory): (Criteria, Memory),
        absent: Vec<usize>,
    ) -> Breaking {
        let has_cliques = !criteria.cliques.are_empty();
        let by_fields = terms.iter().any(|term| term.has_field_conditions());
        let loses_none = criteria.are_empty() && !has_cliques && !by_fields && absent.is_empty();
        let has_cliques = has_cliques || memory.has_cliques();
        let can_lose = loses_none || terms.iter().all(|term| term.can_lose_bonds());
        assert!(can_lose, "energies that can lose bonds");
        let keeps_pattern = terms.iter().all(|term| term.keeps_pattern());
        let terms = terms.into_iter().map(Term::Owned).collect();
        let mut energy = Total::named(terms, Arc::clone(&names));
        if !criteria.are_empty() && memory.is_empty() {
            energy.watch(criteria.limits());
        }
        if memory.is_empty() {
            criteria.cliques.be_watched(&mut energy);
        }
        let (pattern, bond_pattern) = (OnceLock::new(), OnceLock::new());
        if !keeps_pattern {
            let _ = pattern.set(Arc::clone(energy.pattern()));
            let _ = bond_pattern.set(energy.bond_pattern().cloned());
        }
        let is_broken = vec![false; neighborhood.n_bonds()];
        let lost = has_cliques.then(|| Lost::nothing_of(&neighborhood));
        let damage = Damage::default();
        let status = Status { energy, is_broken, n_broken: 0, lost, damage };
        let status = Arc::new(RwLock::new(status));
        let breaking = Breaking {
            body,
            neighborhood,
            names,
            pattern,
            bond_pattern,
            criteria,
            memory,
            dissipation: None,
            absent,
            status,
            decided: Mutex::default(),
            inspected: Inspected::default(),
        };
        breaking.take_out(&breaking.absent);
        breaking
    }

    /// The same of bonds that dissipate as long as they are there.
    pub fn with_dissipation(self, dissipation: Dashpots) -> Breaking {
        let status = Arc::clone(&self.status);
        Breaking { dissipation: Some(Damping { dashpots: dissipation, status }), ..self }
    }

    fn all_owners(&self) -> Vec<Range<usize>> {
        std::iter::once(0..self.body.n_points()).collect()
    }

    /// What breaks at displacements `u`: of bonds among those of some owners, and of triangles and tetrahedra among those
    /// of owners that may be known.
    fn judge(
        &self,
        u: &[f64],
        owners: &[Range<usize>],
        of_cliques: [Option<Vec<Range<usize>>>; 2],
    ) -> Result<Interactions, NonFinite> {
        let status = &*self.now();
        let Status { is_broken, lost, .. } = status;
        let around = (&*self.body, &*self.neighborhood);
        let bonds = self.criteria.judge(around, u, owners, |bond| !is_broken[bond])?;
        let bonds = self.with_fields(status, u, bonds)?;
        let Criteria { cliques, is_unbreakable, .. } = &self.criteria;
        let cliques = match lost {
            Some(lost) => cliques.judge(around, u, (lost, is_unbreakable), of_cliques)?,
            None => Default::default(),
        };
        Ok(Interactions { bonds, cliques })
    }

    /// Breaks what was found: bonds, and then of triangles and tetrahedra what has not gone with them.
    fn break_all(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        found: &Interactions,
    ) -> Result<Release, NonFinite> {
        let mut release = Release::default();
        if found.is_empty() {
            return Ok(release);
        }
        self.see_breaking(u, &found.bonds)?;
        let mut status = self.change();
        if !found.bonds.is_empty() {
            release = status.energy.break_bonds(u, way, &found.bonds)?;
            status.note(&self.neighborhood, &found.bonds);
        }
        for (kind, (measure, numbers)) in CLIQUES.into_iter().zip(&found.cliques).enumerate() {
            let Some(ranks) = self.ranks(measure).filter(|_| !numbers.is_empty()) else { continue };
            let cliques = (measure, ranks, &numbers[..]);
            release.add(status.energy.break_cliques(u, way, cliques)?);
            if let Some(lost) = &mut status.lost {
                lost.lose_cliques(n_neighbors(measure), ranks, numbers);
            }
            release.cliques[kind] += numbers.len();
        }
        Ok(release)
    }

    /// The numbers of triangles or tetrahedra, where these have criteria of their own.
    fn ranks(&self, measure: Measure) -> Option<&Ranks> {
        self.criteria.cliques.kinds().find(|kind| kind.0 == measure).map(|kind| kind.1)
    }

    fn change(&self) -> RwLockWriteGuard<'_, Status> {
        self.status.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// A status that a panic elsewhere has left is as good as any: it changes in one go.
    fn now(&self) -> RwLockReadGuard<'_, Status> {
        now(&self.status)
    }
}

fn now(status: &RwLock<Status>) -> RwLockReadGuard<'_, Status> {
    status.read().unwrap_or_else(PoisonError::into_inner)
}

impl Fracture for Breaking {
    fn advance(&self, u: &[f64], dt: f64, way: (f64, &[f64])) -> Result<Release, NonFinite> {
        let breaking = self.judge(u, &self.all_owners(), [None, None])?;
        let mut release = self.change_states((u, dt), way, &breaking)?;
        release.add(self.break_all(u, way, &breaking)?);
        Ok(release)
    }

    fn advance_behind_forces(&self, u: &[f64], way: (f64, &[f64])) -> Result<Release, NonFinite> {
        assert!(self.memory.is_empty(), "bonds remember nothing");
        let exceeding = |measure| self.now().energy.exceeding(measure);
        let bonds = exceeding(Measure::Length).unwrap_or_else(|| self.all_owners());
        let breaking = self.judge(u, &bonds, CLIQUES.map(exceeding))?;
        self.break_all(u, way, &breaking)
    }

    fn has_family_conditions(&self) -> bool {
        self.now().energy.has_field_conditions()
    }

    fn judged_by_families(&self, u: &[f64]) -> Result<Vec<[usize; 2]>, NonFinite> {
        self.broken_by_families(u)
    }

    fn decide_for_families(&self, bonds: &[[usize; 2]]) {
        self.decide(bonds);
    }

    fn follow(&self, dt: Option<f64>) {
        self.memory.set_time_step(dt.unwrap_or(-1.0));
    }

    fn can_follow(&self) -> bool {
        !self.now().energy.has_field_states()
    }

    fn evolve(&self, ways: [&[f64]; 2], dt: f64) -> Result<Release, NonFinite> {
        self.evolve_states(ways, dt)
    }

    fn advance_bonds(&self, u: &[f64]) -> Result<Release, NonFinite> {
        let breaking = self.judge(u, &self.all_owners(), [None, None])?;
        self.break_all(u, (0.0, &vec![0.0; u.len()]), &breaking)
    }

    fn n_states(&self) -> usize {
        self.memory.n_states()
    }

    fn states(&self) -> Vec<f64> {
        self.memory.all()
    }

    fn remembering(&self) -> Vec<StateOf> {
        (0..self.memory.n_states()).filter_map(|number| self.memory.kind_of(number)).collect()
    }

    fn each(&self, measure: Measure, see: &mut dyn FnMut(usize, &[usize])) {
        self.list(measure, see);
    }

    fn remember(&self, states: &[f64]) {
        self.memory.set_all(states);
    }

    fn advance_foremost(&self, u: &[f64], tie: f64) -> Result<Release, NonFinite> {
        self.judge_foremost(u, tie)
    }

    fn foremost(&self, u: &[f64], tie: f64) -> Result<Option<Foremost>, NonFinite> {
        self.find_foremost(u, tie)
    }

    fn break_at(&self, u: &[f64], which: &Interactions) -> Result<Release, NonFinite> {
        self.break_all(u, (0.0, &vec![0.0; u.len()]), which)
    }

    fn restore(&self, gone: &Interactions) {
        self.put_back(&gone.bonds);
        for (measure, broken) in CLIQUES.into_iter().zip(&gone.cliques) {
            self.put_back_cliques(measure, broken);
        }
    }

    fn joined(&self) -> Option<BlockPattern> {
        self.joined_by_cliques()
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
        status.note(&self.neighborhood, bonds);
        status.energy.lose(bonds);
    }

    fn n_bonds(&self) -> usize {
        self.neighborhood.n_bonds()
    }

    fn n_cliques(&self, measure: Measure) -> usize {
        self.ranks(measure).map_or(0, Ranks::count)
    }

    fn counts(&self) -> [usize; 2] {
        let (counted, bonds) = (self.body.counted(), self.neighborhood.bond_starts());
        let numbers = bonds[counted.start]..bonds[counted.end];
        let status = self.now();
        let n_broken = match numbers.len() == self.neighborhood.n_bonds() {
            true => status.n_broken,
            false => {
                status.is_broken[numbers.clone()].iter().filter(|is_broken| **is_broken).count()
            }
        };
        let absent = self.absent.iter().filter(|bond| numbers.contains(bond)).count();
        [numbers.len() - absent, n_broken - absent]
    }

    fn counts_of(&self, measure: Measure) -> Option<[usize; 2]> {
        let ranks = self.ranks(measure)?;
        let counted = self.body.counted();
        let numbers = ranks.first(counted.start)..ranks.first(counted.end);
        let is_counted = |number: &usize| numbers.contains(number);
        let of = |lost: &Lost| lost.own(n_neighbors(measure)).filter(is_counted).count();
        let broken = self.now().lost.as_ref().map_or(0, of);
        Some([numbers.len(), broken])
    }

    fn broken_cliques(&self, measure: Measure) -> Vec<usize> {
        let status = self.now();
        status.lost.iter().flat_map(|lost| lost.own(n_neighbors(measure))).collect()
    }

    fn take_out_cliques(&self, measure: Measure, numbers: &[usize]) {
        let Some(ranks) = self.ranks(measure).filter(|_| !numbers.is_empty()) else { return };
        let mut status = self.change();
        status.energy.lose_cliques(measure, ranks, numbers);
        if let Some(lost) = &mut status.lost {
            lost.lose_cliques(n_neighbors(measure), ranks, numbers);
        }
    }
}
