//! Rows of a lattice with gaps: lost bonds are lanes without weight, and what is left of their ends' families has other
//! energies of bonds.

use rayon::prelude::*;

use super::StateEnergy;
use super::rows::{AlongRows, AtRest};
use crate::interaction::runs::{KeptInRuns, Runs};
use crate::kernel::VariablesLaw;
use crate::neighborhood::Neighborhood;

/// Which bonds are there, and what the bonds of all families had.
pub(super) struct Gaps {
    kept: KeptInRuns,
    /// Where the numbers of each bond are, run by run.
    places: Vec<u32>,
    /// [`AlongRows::bent`] of the whole families.
    bent: Vec<f64>,
}

impl Gaps {
    fn new(runs: &Runs, whole: &Neighborhood, bent: &[f64]) -> Gaps {
        let mut places = vec![0; whole.n_bonds()];
        let numbers = runs.bonds().filter_map(|(ends, _)| whole.bond_between(ends));
        numbers.zip(0..).for_each(|(bond, place)| places[bond] = place);
        Gaps { kept: runs.kept(whole), places, bent: bent.to_vec() }
    }
}

impl AlongRows {
    /// A bit for each bond of a run, a byte for [`WIDEST`](crate::element::WIDEST) of them; nothing where none is lost.
    #[inline(always)]
    pub(super) fn kept(&self, run: usize) -> Option<&[u8]> {
        self.gaps.as_ref().map(|gaps| gaps.kept.of_run(run))
    }

    /// Takes out bonds of the `whole` families by their ends, which are some of these points, where what is left is at
    /// rest without forces and energies; whether it is.
    pub(super) fn lose(
        &mut self,
        energy: &StateEnergy,
        whole: &Neighborhood,
        (bonds, points): (&[[usize; 2]], &[usize]),
    ) -> bool {
        if self.at_rest != 0.0 || self.linear.is_some() {
            return false;
        }
        let AlongRows { runs, bent, gaps, .. } = self;
        let gaps = gaps.get_or_insert_with(|| Box::new(Gaps::new(runs, whole, bent)));
        let numbers = bonds.iter().filter_map(|ends| whole.bond_between(*ends));
        numbers.for_each(|bond| gaps.kept.lose(bond));
        let Some(law) = &energy.laws.bonds else { return true };
        let of = |point: &usize| of_point((energy, &**law), whole, *point);
        let found: Option<Vec<_>> = points.par_iter().map(of).collect();
        let Some(found) = found else { return false };
        for (bond, number) in found.into_iter().flatten() {
            bent[gaps.places[bond] as usize] = number;
        }
        true
    }

    /// Puts all bonds back.
    pub(super) fn make_whole(&mut self, whole: &Neighborhood) {
        if let Some(gaps) = &mut self.gaps {
            (0..whole.n_bonds()).for_each(|bond| gaps.kept.regain(bond));
            self.bent.copy_from_slice(&gaps.bent);
        }
    }
}

/// The bonds that a point has left, by their numbers in the `whole` families, with half of the second derivative of
/// their energy at rest as [`AlongRows::bent`] has it; nothing where they are not at rest there.
fn of_point(
    (energy, law): (&StateEnergy, &dyn VariablesLaw),
    whole: &Neighborhood,
    point: usize,
) -> Option<Vec<(usize, f64)>> {
    let (m, volumes) = (energy.n_integrals(), energy.body.volumes());
    let ends = |other: u32| [point.min(other as usize), point.max(other as usize)];
    let bonds: Vec<[usize; 2]> = energy.neighborhood.row(point).iter().map(ends).collect();
    let length = |ends: &[usize; 2]| Some(energy.rest[energy.neighborhood.bond_between(*ends)?]);
    let lengths: Vec<f64> = bonds.iter().map(length).collect::<Option<_>>()?;
    let mut found: Vec<(usize, f64)> = Vec::with_capacity(bonds.len());
    for ends in &bonds {
        found.push((whole.bond_between(*ends)?, 0.0));
    }
    let mut room = AtRest::default();
    for side in 0..2 {
        let of_side = || bonds.iter().map(|ends| ends[side]);
        let integrals: Vec<f64> =
            of_side().flat_map(|end| &energy.at_rest[end * m..(end + 1) * m]).copied().collect();
        let laws: Vec<u8> =
            of_side().flat_map(|end| energy.laws_of(end..end + 1)).copied().collect();
        room.given.clear();
        room.given.extend_from_slice(&lengths);
        energy.give(bonds.len(), |k| bonds[k], &mut room.given);
        room.evaluate((law, &laws), &lengths, &integrals);
        let at_rest = room.psi.iter().chain(&room.slopes[..bonds.len()]);
        if at_rest.into_iter().any(|number| *number != 0.0) {
            return None;
        }
        for ((ends, found), bend) in bonds.iter().zip(&mut found).zip(&room.bends) {
            let half = 0.5 * volumes[ends[0]] * volumes[ends[1]];
            found.1 += half * 0.5 * bend;
        }
    }
    found.iter().all(|bond| bond.1.is_finite()).then_some(found)
}
