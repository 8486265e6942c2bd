//! What is compared between two ways to solve a scene: numbers at its end.

use super::TradeError;
use crate::scene::Scene;
use crate::simulation::{Equilibrium, NamedVector};

/// A number, or a vector, of an equilibrium.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The total energy.
    Energy,
    /// The reaction of a set.
    Reaction(String),
    /// The displacement of a probe.
    Probe(String),
    /// The displacements of all points.
    Displacement,
    /// The free residual over the reaction: its value, not its difference from the reference.
    Residual,
}

impl Quantity {
    /// As `--quantity` names it.
    pub fn name(&self) -> String {
        match self {
            Quantity::Energy => "energy".to_string(),
            Quantity::Reaction(set) => format!("reaction:{set}"),
            Quantity::Probe(probe) => format!("probe:{probe}"),
            Quantity::Displacement => "displacement".to_string(),
            Quantity::Residual => "residual".to_string(),
        }
    }

    /// As [`Quantity::error`], for equilibria of different bodies: the residual says nothing there.
    pub fn difference(&self, found: &Equilibrium, reference: &Equilibrium) -> f64 {
        if *self == Quantity::Residual { f64::NAN } else { self.error(found, reference) }
    }

    /// How far `found` is from `reference`, relative to the size of such quantities in the
    /// reference: the energy; the largest reaction of a set; the largest displacement of a point; the norm of all displacements. NaN where the two are of different
    /// bodies.
    pub fn error(&self, found: &Equilibrium, reference: &Equilibrium) -> f64 {
        let named = |all: &[NamedVector], name: &str| {
            all.iter().find(|vector| vector.name == name).map(|vector| vector.value.clone())
        };
        let largest = |vectors: &[NamedVector]| {
            vectors.iter().map(|vector| norm(&vector.value)).fold(0.0, f64::max)
        };
        let (here, there, scale) = match self {
            Quantity::Residual => return found.residual,
            Quantity::Energy => {
                let energy = reference.energy.total();
                (Some(vec![found.energy.total()]), Some(vec![energy]), energy.abs())
            }
            Quantity::Reaction(set) => {
                let [here, there] = [found, reference].map(|e| named(&e.reactions, set));
                (here, there, largest(&reference.reactions))
            }
            Quantity::Probe(probe) => {
                let [here, there] = [found, reference].map(|e| named(&e.probes, probe));
                let d = there.as_ref().map_or(1, Vec::len).max(1);
                let points = reference.displacements.chunks_exact(d).map(norm);
                (here, there, points.fold(0.0, f64::max))
            }
            Quantity::Displacement => {
                let [here, there] = [found, reference].map(|e| Some(e.displacements.clone()));
                (here, there, norm(&reference.displacements))
            }
        };
        match (here, there) {
            (Some(here), Some(there)) if here.len() == there.len() => {
                let difference: Vec<f64> = here.iter().zip(&there).map(|(h, t)| h - t).collect();
                let difference = norm(&difference);
                // The same numbers are right on any scale.
                if difference == 0.0 { 0.0 } else { difference / scale }
            }
            _ => f64::NAN,
        }
    }
}

/// The 2-norm, without overflow or underflow: a body of nanometres has squares of 1e-36.
fn norm(x: &[f64]) -> f64 {
    let largest = x.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    largest * x.iter().map(|x| (x / largest) * (x / largest)).sum::<f64>().sqrt()
}

/// The quantities that were asked for, or the usual ones: energy, the reactions of sets with
/// prescribed values, probes, the residual. `reaction` and `probe` stand for all of them.
///
/// # Errors
/// A quantity that the scene does not have.
pub fn quantities(scene: &Scene, wanted: &[String]) -> Result<Vec<Quantity>, TradeError> {
    let mut prescribed: Vec<usize> = scene.prescriptions.iter().map(|p| p.set.value).collect();
    prescribed.sort_unstable();
    prescribed.dedup();
    let set = |index: usize| Quantity::Reaction(scene.sets[index].name.value.clone());
    let of_prescribed: Vec<Quantity> = prescribed.into_iter().map(set).collect();
    let probes = scene.probes.iter().map(|probe| Quantity::Probe(probe.name.value.clone()));
    let probes: Vec<Quantity> = probes.collect();
    if wanted.is_empty() {
        let mut usual = vec![Quantity::Energy];
        usual.extend(of_prescribed);
        usual.extend(probes);
        usual.push(Quantity::Residual);
        return Ok(usual);
    }
    let sets = (0..scene.sets.len()).map(set);
    let mut all = vec![Quantity::Energy, Quantity::Displacement, Quantity::Residual];
    all.extend(sets.chain(probes.iter().cloned()));
    let mut chosen: Vec<Quantity> = Vec::new();
    for name in wanted {
        let found: Vec<Quantity> = match name.as_str() {
            "reaction" => of_prescribed.clone(),
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

    fn equilibrium(factor: f64) -> Equilibrium {
        let vector = |name: &str, value: [f64; 2]| NamedVector {
            name: name.to_string(),
            value: value.map(|x| x * factor).to_vec(),
        };
        Equilibrium {
            energy: energy(4.0 * factor),
            displacements: [0.0, 0.0, 3.0, 4.0].map(|x| x * factor).to_vec(),
            reactions: vec![vector("held", [0.0, 0.0]), vector("moved", [10.0, 0.0])],
            probes: vec![vector("tip", [3.0, 4.0])],
            residual: 1e-12,
            ..Equilibrium::default()
        }
    }

    #[test]
    fn errors_are_relative_to_the_size_of_the_quantity() {
        let (reference, mut found) = (equilibrium(1.0), equilibrium(1.0));
        found.energy = energy(4.1);
        // The held set has no reaction: the error is relative to that of the other.
        found.reactions[0].value[1] = 0.1;
        found.probes[0].value = vec![3.0, 4.5];
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
                let (found, reference) = (equilibrium(1.5 * factor), equilibrium(factor));
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
