//! What is compared between two ways to solve a scene: numbers at its end.

use super::TradeError;
use crate::case::Case;
use crate::simulation::{Course, Failure, Moment, NamedVector};

/// A number, or a vector, of an equilibrium.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The stored energy.
    Energy,
    /// The kinetic energy of a motion.
    Kinetic,
    /// The reaction of a set.
    Reaction(String),
    /// The displacement of a probe.
    Probe(String),
    /// The displacements of all points.
    Displacement,
    /// When the first bond breaks.
    FirstBreak,
    /// When half of the bonds are broken that are at the end.
    HalfBroken,
    /// How many bonds break.
    BrokenBonds,
    /// What they held.
    Released,
    /// The largest reaction of a set at any step.
    Peak(String),
    /// The free residual over the reaction: its value, not its difference from the reference.
    Residual,
}

impl Quantity {
    /// As `--quantity` names it.
    pub fn name(&self) -> String {
        match self {
            Quantity::Energy => "energy".to_string(),
            Quantity::Kinetic => "kinetic".to_string(),
            Quantity::Reaction(set) => format!("reaction:{set}"),
            Quantity::Probe(probe) => format!("probe:{probe}"),
            Quantity::Displacement => "displacement".to_string(),
            Quantity::FirstBreak => "first_break".to_string(),
            Quantity::HalfBroken => "half_broken".to_string(),
            Quantity::BrokenBonds => "broken_bonds".to_string(),
            Quantity::Released => "released".to_string(),
            Quantity::Peak(set) => format!("peak:{set}"),
            Quantity::Residual => "residual".to_string(),
        }
    }

    /// The size of what a course has at its end, and its unit; nothing where it has none of it.
    pub fn of(&self, course: &Course) -> Option<(f64, &'static str)> {
        if *self == Quantity::Residual {
            return None;
        }
        let unit = match self {
            Quantity::Energy | Quantity::Kinetic | Quantity::Released => "J",
            Quantity::Reaction(_) | Quantity::Peak(_) => "N",
            Quantity::Probe(_) | Quantity::Displacement => "m",
            Quantity::FirstBreak | Quantity::HalfBroken => "s",
            Quantity::BrokenBonds | Quantity::Residual => "",
        };
        let last = self.values(course).pop().filter(|value| !value.is_empty())?;
        Some((norm(&last), unit))
    }

    /// As [`Quantity::error`], for courses of different bodies: the residual, and the number of bonds, say
    /// nothing there.
    pub fn difference(&self, found: &Course, reference: &Course) -> f64 {
        match self {
            Quantity::Residual | Quantity::BrokenBonds => f64::NAN,
            _ => self.error(found, reference),
        }
    }

    /// How far `found` is from `reference` where that is farthest, relative to the largest size of such
    /// quantities in the reference, over all its moments: of the energies; of the reactions of sets; of the
    /// displacements of probes, and at the end of all points; the norm of all displacements. NaN where the two
    /// are of different bodies.
    pub fn error(&self, found: &Course, reference: &Course) -> f64 {
        if *self == Quantity::Residual {
            return found.residual;
        }
        let (here, there) = (self.values(found), self.values(reference));
        let is_comparable = here.len() == there.len()
            && here.iter().zip(&there).all(|(h, t)| h.len() == t.len() && !h.is_empty());
        if !is_comparable {
            return f64::NAN;
        }
        let apart = |(here, there): (&Vec<f64>, &Vec<f64>)| {
            norm(&here.iter().zip(there).map(|(h, t)| h - t).collect::<Vec<f64>>())
        };
        let farthest = here.iter().zip(&there).map(apart).fold(0.0, larger);
        // The same numbers are right on any scale.
        if farthest == 0.0 { 0.0 } else { farthest / self.scale(reference) }
    }

    /// Its numbers at every moment; none where it is not known.
    fn values(&self, course: &Course) -> Vec<Vec<f64>> {
        let named = |all: &[NamedVector], name: &str| {
            let found = all.iter().find(|vector| vector.name == name);
            found.map(|vector| vector.value.clone()).unwrap_or_default()
        };
        let at = |moment: &Moment| match self {
            Quantity::Energy => vec![moment.energy.total()],
            Quantity::Kinetic => vec![moment.kinetic],
            Quantity::Reaction(set) => named(&moment.reactions, set),
            Quantity::Probe(probe) => named(&moment.probes, probe),
            _ => Vec::new(),
        };
        let once = |value: &dyn Fn(&Failure) -> Vec<f64>| -> Vec<Vec<f64>> {
            course.failure.iter().map(value).collect()
        };
        match self {
            Quantity::Displacement => vec![course.displacements.clone()],
            Quantity::FirstBreak => once(&|failure| vec![failure.first]),
            Quantity::HalfBroken => once(&|failure| vec![failure.half]),
            Quantity::BrokenBonds => once(&|failure| vec![failure.bonds as f64]),
            Quantity::Released => once(&|failure| vec![failure.released]),
            Quantity::Peak(set) => once(&|failure| named(&failure.peaks, set)),
            _ => course.moments.iter().map(at).collect(),
        }
    }

    /// The largest size of such quantities.
    fn scale(&self, course: &Course) -> f64 {
        let largest = |of: &dyn Fn(&Moment) -> f64| course.moments.iter().map(of).fold(0.0, larger);
        let of = |vectors: &[NamedVector]| vectors.iter().map(|v| norm(&v.value)).fold(0.0, larger);
        match self {
            Quantity::Energy => largest(&|moment| moment.energy.total().abs()),
            Quantity::Kinetic => largest(&|moment| moment.kinetic),
            Quantity::Reaction(_) => largest(&|moment| of(&moment.reactions)),
            Quantity::Probe(_) => {
                let d = course.moments.iter().flat_map(|moment| &moment.probes).next();
                let d = d.map_or(1, |probe| probe.value.len()).max(1);
                let points = course.displacements.chunks_exact(d).map(norm);
                points.fold(largest(&|moment| of(&moment.probes)), larger)
            }
            Quantity::Displacement => norm(&course.displacements),
            Quantity::Peak(_) => course.failure.as_ref().map_or(0.0, |failure| of(&failure.peaks)),
            Quantity::Residual => 1.0,
            // One number.
            _ => self.values(course).iter().map(|value| norm(value)).fold(0.0, larger),
        }
    }
}

/// The larger one, and NaN where one is.
fn larger(x: f64, y: f64) -> f64 {
    if y > x || y.is_nan() { y } else { x }
}

/// The 2-norm, without overflow or underflow: a body of nanometres has squares of 1e-36.
fn norm(x: &[f64]) -> f64 {
    let largest = x.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    largest * x.iter().map(|x| (x / largest) * (x / largest)).sum::<f64>().sqrt()
}

/// The quantities that were asked for, or the usual ones: energies, the reactions of sets with
/// prescribed values, probes, the residual; of a motion in which bonds break when and how many do, what they
/// release, and the largest reactions. `reaction`, `peak` and `probe` stand for all of them.
///
/// # Errors
/// A quantity that the scene does not have.
pub fn quantities(case: &Case, wanted: &[String]) -> Result<Vec<Quantity>, TradeError> {
    let scene = &case.scene;
    let mut prescribed: Vec<usize> = scene.prescriptions.iter().map(|p| p.set.value).collect();
    prescribed.sort_unstable();
    prescribed.dedup();
    let set = |index: usize| Quantity::Reaction(scene.sets[index].name.value.clone());
    let of_prescribed: Vec<Quantity> = prescribed.iter().map(|index| set(*index)).collect();
    let peak = |index: usize| Quantity::Peak(scene.sets[index].name.value.clone());
    let peaks: Vec<Quantity> = prescribed.into_iter().map(peak).collect();
    let breaks = case.potentials.iter().any(|one| one.model.can_break());
    let failure = match scene.motion.is_some() && breaks {
        true => vec![
            Quantity::FirstBreak,
            Quantity::HalfBroken,
            Quantity::BrokenBonds,
            Quantity::Released,
        ],
        false => Vec::new(),
    };
    let probes = scene.probes.iter().map(|probe| Quantity::Probe(probe.name.value.clone()));
    let probes: Vec<Quantity> = probes.collect();
    let kinetic = scene.motion.as_ref().map(|_| Quantity::Kinetic);
    if wanted.is_empty() && !failure.is_empty() {
        // A crack that comes a little later makes energies at given times others by as much as they are.
        let residual = vec![Quantity::Residual];
        return Ok([failure, peaks, probes, residual].concat());
    }
    if wanted.is_empty() {
        let mut usual = vec![Quantity::Energy];
        usual.extend(kinetic);
        usual.extend(of_prescribed);
        usual.extend(probes);
        usual.push(Quantity::Residual);
        return Ok(usual);
    }
    let sets = (0..scene.sets.len()).map(set);
    let mut all = vec![Quantity::Energy, Quantity::Displacement, Quantity::Residual];
    all.extend(kinetic);
    if !failure.is_empty() {
        all.extend(failure.into_iter().chain((0..scene.sets.len()).map(peak)));
    }
    all.extend(sets.chain(probes.iter().cloned()));
    let mut chosen: Vec<Quantity> = Vec::new();
    for name in wanted {
        let found: Vec<Quantity> = match name.as_str() {
            "reaction" => of_prescribed.clone(),
            "peak" => peaks.clone(),
            "probe" => probes.clone(),
            _ => all.iter().filter(|quantity| quantity.name() == *name).cloned().collect(),
        };
        if found.is_empty() {
            let known = all.iter().map(Quantity::name).collect();
            return Err(TradeError::UnknownQuantity { name: name.clone(), known });
        }
        for quantity in found {
            if !chosen.contains(&quantity) {
                chosen.push(quantity);
            }
        }
    }
    Ok(chosen)
}

/// The largest of the errors; the residual counts only where nothing else was asked for.
pub fn worst(quantities: &[Quantity], errors: &[f64]) -> f64 {
    let is_alone = quantities.iter().all(|quantity| *quantity == Quantity::Residual);
    let counted = quantities
        .iter()
        .zip(errors)
        .filter(|(quantity, _)| is_alone || **quantity != Quantity::Residual)
        .map(|(_, error)| *error);
    counted.fold(0.0, |worst, error| if error > worst || error.is_nan() { error } else { worst })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use piola_mechanics::energy::EnergyParts;

    fn energy(value: f64) -> EnergyParts {
        let names: Arc<[String]> = Arc::new(["psi(l)".to_string()]);
        EnergyParts::new(&names, vec![value])
    }

    fn course(factor: f64) -> Course {
        let vector = |name: &str, value: [f64; 2]| NamedVector {
            name: name.to_string(),
            value: value.map(|x| x * factor).to_vec(),
        };
        let moment = Moment {
            energy: energy(4.0 * factor),
            kinetic: 2.0 * factor,
            reactions: vec![vector("held", [0.0, 0.0]), vector("moved", [10.0, 0.0])],
            probes: vec![vector("tip", [3.0, 4.0])],
        };
        Course {
            moments: vec![moment],
            displacements: [0.0, 0.0, 3.0, 4.0].map(|x| x * factor).to_vec(),
            residual: 1e-12,
            ..Course::default()
        }
    }

    #[test]
    fn errors_are_relative_to_the_size_of_the_quantity() {
        let (reference, mut found) = (course(1.0), course(1.0));
        found.moments[0].energy = energy(4.1);
        // The held set has no reaction: the error is relative to that of the other.
        found.moments[0].reactions[0].value[1] = 0.1;
        found.moments[0].probes[0].value = vec![3.0, 4.5];
        let check = |quantity: Quantity, expected: f64| {
            let error = quantity.error(&found, &reference);
            assert!((error - expected).abs() <= 1e-14 * expected, "{quantity:?} {error}");
        };
        check(Quantity::Energy, 0.025);
        check(Quantity::Reaction("held".to_string()), 0.01);
        check(Quantity::Reaction("moved".to_string()), 0.0);
        check(Quantity::Probe("tip".to_string()), 0.1);
        check(Quantity::Displacement, 0.0);
        check(Quantity::Residual, 1e-12);
        assert!(Quantity::Probe("none".to_string()).error(&found, &reference).is_nan());
        found.displacements.pop();
        assert!(Quantity::Displacement.error(&found, &reference).is_nan());
    }

    #[test]
    fn errors_do_not_depend_on_the_unit() {
        let quantities =
            [Quantity::Energy, Quantity::Reaction("moved".to_string()), Quantity::Displacement];
        for factor in [1e-200, 1e-9, 1.0, 1e200] {
            for quantity in &quantities {
                let (found, reference) = (course(1.5 * factor), course(factor));
                let error = quantity.error(&found, &reference);
                assert!((error - 0.5).abs() < 1e-14, "{quantity:?} {factor:e} {error}");
            }
        }
    }

    #[test]
    fn the_residual_counts_where_it_is_alone() {
        let both = [Quantity::Energy, Quantity::Residual];
        assert_eq!(worst(&both, &[1e-9, 1e-3]), 1e-9);
        assert_eq!(worst(&both[1..], &[1e-3]), 1e-3);
        assert!(worst(&[Quantity::Energy, Quantity::Displacement], &[f64::NAN, 1.0]).is_nan());
    }
}
