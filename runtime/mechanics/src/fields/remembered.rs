//! What points remember of what they gather: all bonds of a point depend on it, so it is the energy of the body that
//! falls when it changes.

use rayon::prelude::*;

use crate::energy::{Energy, NonFinite, total};
use crate::fracture::{FamilyNextState, Release};
use crate::materials::Fields;

/// Points that are worked out by one task; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// A field, a point, and what it is to remember.
pub(super) type Change = (usize, usize, f64);

/// What points remember next, of those that do not remember it already.
pub(super) fn changes<M: Sync>(
    all: &[FamilyNextState<M>],
    (fields, n_points): (&Fields, usize),
    takes: impl Fn(&FamilyNextState<M>, usize) -> bool + Sync,
    next: impl Fn(&FamilyNextState<M>, &[[usize; 2]]) -> Result<Vec<f64>, NonFinite> + Sync,
) -> Result<Vec<Change>, NonFinite> {
    let mut changes = Vec::new();
    for one in all {
        let chunk = |number: usize| {
            let points = number * CHUNK..n_points.min((number + 1) * CHUNK);
            let own: Vec<[usize; 2]> = points.filter(|i| takes(one, *i)).map(|i| [i; 2]).collect();
            let next = next(one, &own)?;
            let places = own.iter().zip(next);
            let differs = |([i, _], x): &(&[usize; 2], f64)| one.differs(fields, *i, *x);
            Ok(places.filter(differs).map(|([i, _], x)| (one.field, *i, x)).collect::<Vec<_>>())
        };
        let parts: Result<Vec<_>, NonFinite> =
            (0..n_points.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        changes.extend(parts?.concat());
    }
    Ok(changes)
}

/// Lets points remember it, and says what that releases at displacements `u` in m, along a way as
/// [`Energy::change_field_states`] has it.
pub(super) fn release(
    energy: &impl Energy,
    fields: &Fields,
    changes: &[Change],
    (u, (step, direction)): (&[f64], (f64, &[f64])),
) -> Result<Release, NonFinite> {
    if changes.is_empty() {
        return Ok(Release::default());
    }
    let mut forces = vec![0.0; u.len()];
    let mut parts = vec![0.0; energy.parts().len()];
    let mut held = || {
        energy.counted_energy(u, Some(&mut forces), &mut parts)?;
        let energy = total(&parts);
        let power = forces.iter().zip(direction).fold(0.0, |sum, (force, v)| sum + force * v);
        Ok([energy, power])
    };
    let before = held()?;
    for (field, point, next) in changes {
        fields.set_state(*field, *point, *next);
    }
    let after = held()?;
    let mut points: Vec<usize> = changes.iter().map(|change| change.1).collect();
    points.sort_unstable();
    points.dedup();
    Ok(Release {
        changed: points.len(),
        dissipated: before[0] - after[0],
        timing: 0.5 * step * (before[1] - after[1]),
        ..Release::default()
    })
}
