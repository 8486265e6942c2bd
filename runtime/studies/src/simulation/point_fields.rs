//! What frames show of every point beside displacements: strains, stresses, energies.
//!
//! One definition serves every energy. The deformation gradient is that of the discretisation where the
//! energy is one of F, else that which fits the family best; the stress is the derivative of the point's
//! energy by a uniform gradient of displacements, over its volume.

use nalgebra::{Matrix3, SymmetricEigen};
use piola_mechanics::energy::{Energy, Total};
use piola_mechanics::fracture::left_of;
use piola_mechanics::kernel::Measure;
use piola_mechanics::least_squares;
use piola_mechanics::words::Words as _;
use piola_output::picture::{Colour, NamedPoints, unit_of};
use piola_output::{Frame, PointField};

use crate::case::Case;
use crate::scene::selection::{PointSet, Selection};
use crate::scene::{ColourBy, FrameField, STATE};

/// What is worked out for frames, and from what.
#[derive(Clone, Copy)]
pub(super) struct PointFields<'a> {
    pub(super) case: &'a Case,
    pub(super) energy: &'a Total<'a>,
    pub(super) selection: &'a Selection,
    /// Of a body that moves, in kg.
    pub(super) masses: Option<&'a [f64]>,
}

/// Displacements in m and `dE/du` minus the loads in N, in the body's order.
struct State<'a> {
    u: &'a [f64],
    residual: &'a [f64],
}

/// Tensors of all points as they are worked out, each at most once.
#[derive(Default)]
struct Tensors {
    /// `F - I`.
    gradient: Option<Vec<Matrix3<f64>>>,
    piola: Option<Vec<Matrix3<f64>>>,
    cauchy: Option<Vec<Matrix3<f64>>>,
}

/// The sets of a body, for a picture.
pub(super) fn named_sets(case: &Case, selection: &Selection) -> Vec<NamedPoints> {
    let number = |point: &usize| case.body.user_index()[*point] as usize;
    let named = |set: &PointSet| NamedPoints {
        name: set.name.clone(),
        points: set.points.iter().map(number).collect(),
    };
    selection.sets.iter().map(named).collect()
}

impl PointFields<'_> {
    /// Adds to a frame what the scene asks for.
    pub(super) fn fill(&self, frame: &mut Frame) {
        let (body, d) = (&self.case.body, self.case.body.dimension());
        let breaks = self.energy.fracture().is_some();
        if self.case.scene.output.fields.is_empty() && !breaks {
            return;
        }
        let state = State {
            u: &body.from_user_order(&frame.displacement, d),
            residual: &body.from_user_order(&frame.residual, d),
        };
        let mut tensors = Tensors::default();
        let asked = &self.case.scene.output.fields;
        // Whoever breaks a body wants to see where.
        let damage = (breaks && !asked.contains(&FrameField::Damage)).then_some(FrameField::Damage);
        for field in damage.iter().chain(asked) {
            match field {
                FrameField::Sets => self.sets(frame),
                FrameField::States => self.states(frame),
                field => {
                    let (components, values) = self.values(*field, &state, &mut tensors);
                    let values = self.case.body.to_user_order(&values, components);
                    let name = field.word().to_owned();
                    frame.fields.push(PointField { name, components, values });
                }
            }
        }
    }

    /// What the colours of a picture of this frame show, unless they show the displacement.
    pub(super) fn colour(&self, frame: &Frame) -> Option<Colour> {
        let (body, d) = (&self.case.body, self.case.body.dimension());
        let by = &self.case.scene.output.colour;
        let length = |x: &[f64]| x.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        let magnitudes = |of: &[f64]| of.chunks_exact(d).map(length).collect();
        let worked_out = |field| {
            let [u, residual] = [&frame.displacement, &frame.residual];
            let [u, residual] = [u, residual].map(|of| body.from_user_order(of, d));
            let state = State { u: &u, residual: &residual };
            let (components, values) = self.values(field, &state, &mut Tensors::default());
            body.to_user_order(&values, components)
        };
        let values = match by {
            ColourBy::Displacement => return None,
            ColourBy::Velocity => magnitudes(&frame.velocity),
            ColourBy::Acceleration => magnitudes(&worked_out(FrameField::Acceleration)),
            ColourBy::EnergyDensity => worked_out(FrameField::EnergyDensity),
            ColourBy::Damage => worked_out(FrameField::Damage),
            ColourBy::DamageOfAreas => worked_out(FrameField::DamageOfAreas),
            ColourBy::DamageOfVolumes => worked_out(FrameField::DamageOfVolumes),
            ColourBy::State(name) => body.to_user_order(&self.mean_of_state(name), 1),
            ColourBy::Jacobian => worked_out(FrameField::Jacobian),
            ColourBy::VonMises => worked_out(FrameField::VonMises),
        };
        let name = by.word();
        Some(Colour { unit: unit_of(&name), name, values })
    }

    /// The sets, for a picture.
    pub(super) fn named_sets(&self) -> Vec<NamedPoints> {
        named_sets(self.case, self.selection)
    }

    /// A field of its own for each set: 1 in it, else 0.
    fn sets(&self, frame: &mut Frame) {
        for set in &self.selection.sets {
            let mut values = vec![0.0; self.case.body.n_points()];
            set.points.iter().for_each(|point| values[*point] = 1.0);
            let values = self.case.body.to_user_order(&values, 1);
            frame.fields.push(PointField {
                name: format!("set {}", set.name),
                components: 1,
                values,
            });
        }
    }

    /// A field of its own for each state, by its name.
    fn states(&self, frame: &mut Frame) {
        for name in self.case.names_of_states() {
            let values = self.case.body.to_user_order(&self.mean_of_state(&name), 1);
            let name = format!("{STATE}{name}");
            frame.fields.push(PointField { name, components: 1, values });
        }
    }

    /// The mean over what is unbroken at each point of what is remembered by this name.
    fn mean_of_state(&self, name: &str) -> Vec<f64> {
        let numbers = self.case.states_called(name);
        match self.energy.fracture() {
            Some(fracture) => fracture.mean_states(&numbers),
            None => vec![f64::NAN; self.case.body.n_points()],
        }
    }

    fn damage_of(&self, measure: Measure) -> Vec<f64> {
        let whole = || vec![0.0; self.case.body.n_points()];
        self.energy.fracture().map_or_else(whole, |fracture| fracture.damage_of(measure))
    }

    /// How many numbers a point has, and these in the body's order.
    fn values(
        &self,
        field: FrameField,
        state: &State<'_>,
        tensors: &mut Tensors,
    ) -> (usize, Vec<f64>) {
        let (d, u) = (self.case.body.dimension(), state.u);
        let known = &mut tensors.gradient;
        match field {
            FrameField::EnergyDensity => {
                let volumes = self.volumes();
                // What is not a number is seen in the frame.
                let densities = self.energy.densities(u, &volumes);
                (1, densities.unwrap_or_else(|_| vec![f64::NAN; volumes.len()]))
            }
            FrameField::DeformationGradient => {
                let one = |h: &Matrix3<f64>| h + unit(d);
                (9, rows(self.gradient(u, known).iter().map(one)))
            }
            FrameField::Jacobian => {
                let h = self.gradient(u, known);
                let of_plane = |h: &Matrix3<f64>| (h + Matrix3::identity()).determinant();
                (1, h.iter().map(of_plane).zip(self.across(h)).map(|(j, f33)| j * f33).collect())
            }
            FrameField::Strain => (9, rows(self.gradient(u, known).iter().map(strain))),
            FrameField::PrincipalStretches => {
                let stretch = |e: f64| (1.0 + 2.0 * e).max(0.0).sqrt();
                let one = |h: &Matrix3<f64>| principal(strain(h), d).map(stretch);
                (
                    d,
                    self.gradient(u, known)
                        .iter()
                        .flat_map(|h| one(h).into_iter().take(d))
                        .collect(),
                )
            }
            FrameField::PiolaStress => (9, rows(self.piola(u, tensors).iter().copied())),
            FrameField::Stress => (9, rows(self.cauchy(u, tensors).iter().copied())),
            FrameField::VonMises => (1, self.cauchy(u, tensors).iter().map(von_mises).collect()),
            FrameField::PrincipalStresses => {
                let one = |stress: &Matrix3<f64>| principal(*stress, d).into_iter().take(d);
                (d, self.cauchy(u, tensors).iter().flat_map(one).collect())
            }
            FrameField::Acceleration => (d, self.acceleration(state)),
            FrameField::Damage => {
                let whole = || vec![0.0; self.case.body.n_points()];
                (1, self.energy.fracture().map_or_else(whole, |fracture| fracture.damage()))
            }
            FrameField::DamageOfAreas => (1, self.damage_of(Measure::Area)),
            FrameField::DamageOfVolumes => (1, self.damage_of(Measure::Volume)),
            FrameField::Neighbours | FrameField::Sets | FrameField::States => {
                (1, self.neighbours())
            }
        }
    }

    /// Volumes by which energies become energies per volume, in m^d, or m^3 of a body with a thickness.
    fn volumes(&self) -> Vec<f64> {
        let thickness = self.case.thickness();
        self.case.body.volumes().iter().map(|volume| thickness * volume).collect()
    }

    fn gradient<'t>(
        &self,
        u: &[f64],
        known: &'t mut Option<Vec<Matrix3<f64>>>,
    ) -> &'t [Matrix3<f64>] {
        known.get_or_insert_with(|| {
            // Of families that have lost bonds what is left counts.
            let fitted = || match self.energy.fracture() {
                Some(fracture) => {
                    let left = left_of(self.energy.bonds(), &fracture.broken());
                    least_squares::displacement_gradients(&self.case.body, &left, u)
                }
                None => {
                    least_squares::displacement_gradients(&self.case.body, self.energy.bonds(), u)
                }
            };
            let found = self.energy.displacement_gradients(u).unwrap_or_else(fitted);
            matrices(&found, self.case.body.dimension())
        })
    }

    fn piola<'t>(&self, u: &[f64], tensors: &'t mut Tensors) -> &'t [Matrix3<f64>] {
        tensors.piola.get_or_insert_with(|| {
            let d = self.case.body.dimension();
            let mut virials = vec![0.0; u.len() * d];
            if self.energy.virials(u, &mut virials).is_err() {
                virials.fill(f64::NAN);
            }
            let stresses = matrices(&virials, d).into_iter().zip(self.volumes());
            stresses.map(|(virial, volume)| virial / volume).collect()
        })
    }

    fn cauchy<'t>(&self, u: &[f64], tensors: &'t mut Tensors) -> &'t [Matrix3<f64>] {
        if tensors.cauchy.is_none() {
            let gradient = self.gradient(u, &mut tensors.gradient).to_vec();
            let across = self.across(&gradient);
            let piola = self.piola(u, tensors);
            let one = |((stress, h), f33): ((&Matrix3<f64>, &Matrix3<f64>), f64)| {
                let f = h + Matrix3::identity();
                stress * f.transpose() / (f.determinant() * f33)
            };
            tensors.cauchy = Some(piola.iter().zip(&gradient).zip(across).map(one).collect());
        }
        tensors.cauchy.as_deref().unwrap_or_default()
    }

    /// The stretch across sheets in plane stress; 1 of all other bodies.
    fn across(&self, gradient: &[Matrix3<f64>]) -> Vec<f64> {
        let d = self.case.body.dimension();
        let rows = gradient.iter().flat_map(|h| (0..d * d).map(|k| h[(k / d, k % d)]));
        let found = self.energy.stretches_across(&rows.collect::<Vec<f64>>());
        found.unwrap_or_else(|| vec![1.0; gradient.len()])
    }

    fn acceleration(&self, state: &State<'_>) -> Vec<f64> {
        let (d, masses) = (self.case.body.dimension(), self.masses.unwrap_or_default());
        let mass = |dof: usize| masses.get(dof / d).copied().unwrap_or(f64::NAN);
        state.residual.iter().enumerate().map(|(dof, residual)| -residual / mass(dof)).collect()
    }

    fn neighbours(&self) -> Vec<f64> {
        let bonds = self.energy.bonds();
        let mut counts = vec![0.0; self.case.body.n_points()];
        for i in 0..counts.len() {
            let row = &bonds.columns[bonds.row_start[i]..bonds.row_start[i + 1]];
            for j in row.iter().map(|j| *j as usize).filter(|j| *j != i) {
                counts[i] += 1.0;
                counts[j] += 1.0;
            }
        }
        counts
    }
}

/// `d x d` numbers per point, row by row; zeros beyond.
fn matrices(values: &[f64], d: usize) -> Vec<Matrix3<f64>> {
    let entry = |own: &[f64], r: usize, c: usize| if r < d && c < d { own[r * d + c] } else { 0.0 };
    values.chunks_exact(d * d).map(|own| Matrix3::from_fn(|r, c| entry(own, r, c))).collect()
}

/// Nine numbers per point, row by row.
fn rows(tensors: impl Iterator<Item = Matrix3<f64>>) -> Vec<f64> {
    tensors.flat_map(|tensor| <[[f64; 3]; 3]>::from(tensor.transpose())).flatten().collect()
}

/// The identity of so many dimensions.
fn unit(d: usize) -> Matrix3<f64> {
    Matrix3::from_fn(|r, c| if r == c && r < d { 1.0 } else { 0.0 })
}

/// `(F'F - I)/2` from `F - I`, without the digits that `F'F - I` would lose.
fn strain(h: &Matrix3<f64>) -> Matrix3<f64> {
    (h + h.transpose() + h.transpose() * h) * 0.5
}

/// Eigenvalues of the symmetric part, the largest first; those of a plane stand before a zero.
fn principal(tensor: Matrix3<f64>, d: usize) -> [f64; 3] {
    if tensor.iter().any(|x| !x.is_finite()) {
        return [f64::NAN; 3];
    }
    let tensor = (tensor + tensor.transpose()) * 0.5;
    let mut values: [f64; 3] = match d {
        2 => {
            let own = SymmetricEigen::new(tensor.fixed_view::<2, 2>(0, 0).into_owned());
            [own.eigenvalues[0], own.eigenvalues[1], 0.0]
        }
        _ => SymmetricEigen::new(tensor).eigenvalues.into(),
    };
    values[..d].sort_by(|x, y| y.total_cmp(x));
    values
}

/// `sqrt(3/2 s : s)` of the deviator `s`; of a plane with no stress across it.
fn von_mises(stress: &Matrix3<f64>) -> f64 {
    let stress = (stress + stress.transpose()) * 0.5;
    let deviator = stress - Matrix3::identity() * (stress.trace() / 3.0);
    (1.5 * deviator.dot(&deviator)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_of_stress_are_those_of_the_textbook() {
        let pulled = Matrix3::from_diagonal(&[5.0, 0.0, 0.0].into());
        assert!((von_mises(&pulled) - 5.0).abs() < 1e-15);
        let sheared = Matrix3::new(0.0, 2.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        assert!((von_mises(&sheared) - 2.0 * 3.0_f64.sqrt()).abs() < 1e-15);
        for d in [2, 3] {
            let found = principal(sheared, d);
            let known = if d == 2 { [2.0, -2.0, 0.0] } else { [2.0, 0.0, -2.0] };
            assert!(found.iter().zip(known).all(|(x, y)| (x - y).abs() < 1e-15), "{found:?}");
        }
        assert!(principal(sheared * f64::NAN, 3)[0].is_nan());
    }

    #[test]
    fn small_strains_keep_their_digits() {
        let h = Matrix3::new(1e-12, 0.0, 0.0, 3e-12, -2e-12, 0.0, 0.0, 0.0, 0.0);
        let strain = strain(&h);
        assert!((strain[(0, 1)] - 1.5e-12).abs() < 1e-23, "{strain}");
    }
}
