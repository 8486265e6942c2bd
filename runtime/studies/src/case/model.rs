//! The energies that a scene models, added up.

use std::mem::take;
use std::sync::Arc;

use piola_compiler::{GatheredKernels, Integrand, VectorKernels};
use piola_mechanics::assembly::{AssemblyError, DiscreteEnergy, Elements};
use piola_mechanics::deformation::influence::{Constant, CubicSpline, Influence, InverseLength};
use piola_mechanics::deformation::{DeformationEnergy, Discretisation, Formulation, Stabilisation};
use piola_mechanics::energy::{Energy, Term, Total};
use piola_mechanics::fracture::{criteria, memory};
use piola_mechanics::kernel::{Law, Measure, VariablesLaw};
use piola_mechanics::materials::{ByMaterial, Fields, MaterialLaw, Materials};
use piola_mechanics::neighborhood::Neighborhood;
use piola_mechanics::sheet::Thick;
use piola_mechanics::states::{StateEnergy, StateLaws};
use piola_mechanics::vectors::{VectorEnergy, VectorLaws};

use super::family::{FamilyFunctions, OfLayer};
use super::fracture::{criterion, next_state, of_layers};
use super::{Case, CaseError, Compiled, FieldsInTime, size};
use crate::scene::{InfluenceChoice, NamedInfluence, Passes, StrainSource};

impl Case {
    /// The discrete total energy: the sum of all energies of all potentials.
    ///
    /// # Errors
    /// A body that cannot be assembled: isolated or coincident points, nothing to model, more
    /// neighbours than the machine's memory holds, neighbours that determine no deformation gradient.
    pub fn energy(&self, compiled: Vec<Compiled>) -> Result<Total<'static>, CaseError> {
        Ok(self.energy_in_time(compiled)?.0)
    }

    /// The same with the parameters that vary: where these change with t, the energy does.
    ///
    /// # Errors
    /// As [`Case::energy`].
    pub fn energy_in_time(
        &self,
        mut compiled: Vec<Compiled>,
    ) -> Result<(Total<'static>, FieldsInTime<'_>), CaseError> {
        let n_laws = self.scene.n_laws();
        // Triangles and tetrahedra without an energy have nothing to lose.
        let has = Measure::ALL.map(|measure| {
            measure == Measure::Length || compiled.iter().any(|one| one.measures.contains(&measure))
        });
        let criteria = of_layers(
            &mut compiled,
            n_laws,
            |one| {
                let all = take(&mut one.criteria).into_iter();
                all.filter(|one| has[one.measure() as usize]).collect()
            },
            criterion,
        );
        let states = of_layers(&mut compiled, n_laws, |one| take(&mut one.next_states), next_state);
        let fields = FieldsInTime::new(self).map_err(|wrong| self.wrong_field(wrong))?;
        let horizon = self.scene.horizon_radius();
        size::check_neighbors(&self.body, horizon, size::family(&self.body, horizon))?;
        let neighborhood = Neighborhood::new(&self.body, horizon).map_err(AssemblyError::from)?;
        let neighborhood = Arc::new(neighborhood);
        let dashpots = self.dashpots(&mut compiled, &fields, &neighborhood)?;
        let layers = self.layers(compiled);
        let alone = layers.len() == 1;
        let (mut terms, mut names) = (Vec::new(), Vec::new());
        for (number, layer) in layers.into_iter().enumerate() {
            let potential = layer.name();
            let materials = fields.materials(number);
            for term in self.terms((number, layer), &neighborhood, materials)? {
                let own = term.parts().iter();
                names.extend(own.map(|part| match alone {
                    true => part.clone(),
                    false => format!("{potential}: {part}"),
                }));
                terms.push(term);
            }
        }
        let names: Arc<[String]> = names.into();
        if !self.can_break() && self.n_states() == 0 {
            let terms = terms.into_iter().map(Term::Owned).collect();
            let total = Total::named(terms, names);
            return Ok(match dashpots {
                Some(dashpots) => (total.with_dissipation(dashpots), fields),
                None => (total, fields),
            });
        }
        let layer =
            |(number, of_law)| criteria::Layer { of_law, materials: fields.materials(number) };
        let criteria = criteria.into_iter().enumerate().map(layer).collect();
        let states = states.into_iter().enumerate().filter_map(|(number, of_law)| {
            Some(memory::Layer { of_law, materials: fields.materials(number)? })
        });
        let mut breaking = self.breaking(terms, names, neighborhood, (criteria, states.collect()));
        if let Some(dashpots) = dashpots {
            breaking = breaking.with_dissipation(dashpots);
        }
        Ok((Total::of(Box::new(breaking)), fields))
    }

    /// The same as a run of the scene sees it: strain and products come about as the scene says.
    ///
    /// # Errors
    /// As [`Case::energy`].
    pub fn solved_energy(
        &self,
        compiled: Vec<Compiled>,
    ) -> Result<(Total<'static>, FieldsInTime<'_>), CaseError> {
        self.check_control()?;
        self.check_dissipation()?;
        let solver = &self.scene.solver;
        let (energy, fields) = self.energy_in_time(compiled)?;
        self.check_singular(&energy)?;
        let energy = energy.with_products(solver.products);
        Ok((energy.from_positions(solver.strain == StrainSource::Positions), fields))
    }

    /// What is added up: of every law its first potential, then of every law its second, and so on.
    fn layers(&self, compiled: Vec<Compiled>) -> Vec<Layer> {
        let n_laws = self.scene.n_laws();
        let n_layers = compiled.iter().map(|one| one.layer + 1).max().unwrap_or(0);
        let empty = || Layer((0..n_laws).map(|_| None).collect());
        let mut layers: Vec<Layer> = (0..n_layers).map(|_| empty()).collect();
        for one in compiled {
            let (layer, law) = (one.layer, one.law);
            layers[layer].0[law] = Some(one);
        }
        layers
    }

    /// The energies of a layer: of interactions, of gathered states, of deformation gradients.
    fn terms(
        &self,
        (number, layer): (usize, Layer),
        neighborhood: &Arc<Neighborhood>,
        materials: Option<Arc<Materials>>,
    ) -> Result<Vec<Box<dyn Energy>>, CaseError> {
        let fields = materials.as_deref().and_then(Materials::fields);
        let found = || (Arc::clone(&self.body), Arc::clone(neighborhood));
        let in_batches = self.scene.solver.passes == Passes::Batches;
        let mut terms: Vec<Box<dyn Energy>> = Vec::new();
        let has_interactions = layer.present().any(Compiled::has_interactions);
        let Parts { elements, gathered, vectors, gradients, mut functions } = layer.parts();
        if has_interactions {
            let ((body, neighborhood), weighting) = (found(), self.scene.horizon.weighting());
            let materials = materials.clone();
            let energy =
                DiscreteEnergy::of_materials(body, neighborhood, weighting, materials, elements)?;
            terms.push(Box::new(if in_batches { energy.in_batches() } else { energy }));
        }
        if gathered.iter().any(Option::is_some) {
            let (laws, numbers) = states_of_materials(gathered, self.thickness(), fields);
            let (n_laws, n_variables) = (functions.len(), laws.integrals.len());
            let of = OfLayer { number, n_laws, n_variables, fields };
            let (mut criteria, mut next) = (Vec::new(), Vec::new());
            for (law, (own, numbers)) in functions.iter_mut().zip(&numbers).enumerate() {
                let place = (law, own.gradient_criteria.len());
                criteria.extend(of.by_gathered(place, numbers, take(&mut own.gathered_criteria)));
                next.extend(of.next_by_gathered(law, numbers, take(&mut own.gathered_next)));
            }
            let (body, neighborhood) = found();
            let materials = materials.clone();
            let energy = StateEnergy::of_materials(body, neighborhood, materials, laws)?;
            let energy = if in_batches { energy.in_batches() } else { energy };
            terms.push(Box::new(energy.with_criteria(criteria).with_next_states(next)));
        }
        if vectors.iter().any(Option::is_some) {
            self.check_neighbours(number, &vectors, &functions)?;
            let (body, neighborhood) = found();
            let laws = vectors_of_materials(vectors, self.thickness());
            let of = OfLayer { number, n_laws: functions.len(), n_variables: 0, fields };
            let (mut criteria, mut next) = (Vec::new(), Vec::new());
            for (law, own) in functions.iter_mut().enumerate() {
                let place = (law, own.gradient_criteria.len());
                criteria.extend(of.by_vectors(place, take(&mut own.vector_criteria)));
                next.extend(of.next_by_vectors(law, take(&mut own.vector_next)));
            }
            let energy = VectorEnergy::new(body, neighborhood, materials.clone(), laws)?;
            terms.push(Box::new(energy.with_criteria(criteria).with_next_states(next)));
        }
        if gradients.iter().any(Option::is_some) {
            let energy = self.correspondence(gradients, found().1, materials.clone())?;
            let energy = if in_batches { energy.in_batches() } else { energy };
            let n_variables = self.body.dimension() * self.body.dimension();
            let of = OfLayer { number, n_laws: functions.len(), n_variables, fields };
            let (mut criteria, mut next) = (Vec::new(), Vec::new());
            for (law, own) in functions.into_iter().enumerate() {
                criteria.extend(of.by_gradients(law, own.gradient_criteria));
                next.extend(of.next_by_gradients(law, own.gradient_next));
            }
            terms.push(Box::new(energy.with_criteria(criteria).with_next_states(next)));
        }
        Ok(terms)
    }

    /// Refuses materials of several potentials where one holds what neighbours gather: those would gather something
    /// else.
    fn check_neighbours(
        &self,
        layer: usize,
        vectors: &[Option<(VectorKernels, [String; 2])>],
        functions: &[FamilyFunctions],
    ) -> Result<(), CaseError> {
        let mut conditions = functions.iter().flat_map(|own| &own.vector_criteria);
        let what = if vectors.iter().flatten().any(|(kernels, _)| kernels.has_neighbours()) {
            "an energy of bonds"
        } else if conditions.any(|one| one.margin.has_neighbours()) {
            "a condition"
        } else {
            return Ok(());
        };
        let own = self.potentials.iter().zip(self.places()).filter(|(_, place)| place.1 == layer);
        let mut texts: Vec<&str> = own.map(|(potential, _)| &*potential.text.text).collect();
        texts.dedup();
        if texts.len() <= 1 {
            return Ok(());
        }
        let message = format!(
            "{what} holds what neighbours gather, and here neighbours of other materials gather by another \
             potential: give all materials one potential, each with its parameters"
        );
        Err(CaseError::Body { message })
    }

    fn correspondence(
        &self,
        laws: Vec<Option<Box<dyn VariablesLaw>>>,
        neighborhood: Arc<Neighborhood>,
        materials: Option<Arc<Materials>>,
    ) -> Result<DeformationEnergy, CaseError> {
        let (horizon, thickness) = (self.scene.horizon_radius(), self.thickness());
        let d = self.body.dimension();
        let settings = self.scene.correspondence.clone().unwrap_or_default();
        let influence = influence(&settings.influence, d, horizon);
        let formulation = Formulation {
            horizon,
            order: settings.order,
            discretisation: discretisation(settings.discretisation, thickness),
            influence: &*influence,
        };
        let laws = laws.into_iter().map(|law| law.map(|law| thick(law, thickness)));
        let body = Arc::clone(&self.body);
        let fields = materials.as_deref().and_then(Materials::fields);
        let laws = laws.map(|law| law.map(|law| (law, None))).collect();
        let law = by_material(d * d, laws, fields);
        Ok(DeformationEnergy::of_materials(body, neighborhood, formulation, materials, law)?)
    }
}

/// One potential of each law, where it has one.
struct Layer(Vec<Option<Compiled>>);

/// The energies of a layer by kind, those of each law.
#[derive(Default)]
struct Parts {
    elements: Vec<Elements>,
    gathered: Vec<Option<(GatheredKernels, [String; 2])>>,
    vectors: Vec<Option<(VectorKernels, [String; 2])>>,
    gradients: Vec<Option<Box<dyn VariablesLaw>>>,
    functions: Vec<FamilyFunctions>,
}

impl Layer {
    fn present(&self) -> impl Iterator<Item = &Compiled> {
        self.0.iter().flatten()
    }

    /// The names of its potentials.
    fn name(&self) -> String {
        let mut names: Vec<&str> = self.present().map(|compiled| compiled.name.as_str()).collect();
        names.dedup();
        names.join(" | ")
    }

    fn parts(self) -> Parts {
        let mut parts = Parts::default();
        for compiled in self.0 {
            let (elements, gathered, vectors, gradient, functions) = match compiled {
                Some(one) => {
                    let gathered = one.gathered.map(|kernels| (kernels, one.arguments.clone()));
                    let vectors = one.vectors.map(|kernels| (kernels, one.arguments));
                    (one.elements, gathered, vectors, one.gradient, one.of_families)
                }
                None => Default::default(),
            };
            parts.elements.push(elements);
            parts.gathered.push(gathered);
            parts.vectors.push(vectors);
            parts.gradients.push(gradient);
            parts.functions.push(functions);
        }
        parts
    }
}

/// A law and, unless they are all, which of the variables of all materials it has.
pub(super) type Numbered = (Box<dyn VariablesLaw>, Option<Vec<usize>>);

/// The laws of several materials as one; the law itself of one material.
pub(super) fn by_material(
    n_variables: usize,
    mut laws: Vec<Option<Numbered>>,
    fields: Option<&Fields>,
) -> Box<dyn VariablesLaw> {
    if let [Some(_)] = &laws[..]
        && let Some((law, _)) = laws.pop().flatten()
    {
        return law;
    }
    let law = |(number, own): (usize, Option<Numbered>)| {
        let (law, variables) = own?;
        let variables = variables.unwrap_or_else(|| (0..n_variables).collect());
        let fields = fields.map_or(0..0, |fields| fields.of_law(number));
        Some(MaterialLaw { law, variables, fields })
    };
    let laws = laws.into_iter().enumerate().map(law).collect();
    Box::new(ByMaterial::new(n_variables, fields.map_or(0, Fields::len), laws))
}

/// The energies of gathered states of several materials: of integrals that are the same function in
/// several of them there is one. With which of all integrals each material has.
fn states_of_materials(
    gathered: Vec<Option<(GatheredKernels, [String; 2])>>,
    thickness: f64,
    fields: Option<&Fields>,
) -> (StateLaws, Vec<Vec<usize>>) {
    let mut laws = StateLaws::default();
    let mut numbers_of: Vec<Vec<usize>> = Vec::new();
    let mut known: Vec<Integrand> = Vec::new();
    let (mut points, mut bonds) = (Vec::new(), Vec::new());
    for (material, of_material) in gathered.into_iter().enumerate() {
        let Some((kernels, arguments)) = of_material else {
            points.push(None);
            bonds.push(None);
            numbers_of.push(Vec::new());
            continue;
        };
        // Those of one material stay apart, also where its parameters make them alike.
        let mut numbers: Vec<usize> = Vec::new();
        for (integral, function) in kernels.integrals.into_iter().zip(kernels.functions) {
            let alike =
                |k: &usize| function.is_shared() && known[*k] == function && !numbers.contains(k);
            let number = (0..known.len()).find(alike).unwrap_or(known.len());
            if number == known.len() {
                known.push(function);
                laws.integrals.push(Box::new(integral));
                laws.of_law.push(material);
            }
            numbers.push(number);
        }
        let with_length = || std::iter::once(0).chain(numbers.iter().map(|k| k + 1)).collect();
        let thick = |law| thick(law, thickness);
        points.push(kernels.points.map(|law| (thick(law), Some(numbers.clone()))));
        bonds.push(kernels.bonds.map(|law| (thick(law), Some(with_length()))));
        numbers_of.push(numbers);
        add_arguments(&mut laws.arguments, &arguments);
    }
    let n = laws.integrals.len();
    let some = |laws: &[Option<Numbered>]| laws.iter().any(Option::is_some);
    laws.points = some(&points).then(|| by_material(n, points, fields));
    laws.bonds = some(&bonds).then(|| by_material(n + 1, bonds, fields));
    (laws, numbers_of)
}

/// Adds what the energies of one more material are functions of, of points and of bonds.
fn add_arguments(all: &mut [String; 2], own: &[String; 2]) {
    for (all, own) in all.iter_mut().zip(own) {
        if !own.is_empty() && all != own {
            *all = if all.is_empty() { own.clone() } else { format!("{all}) | psi({own}") };
        }
    }
}

/// The energies of what points of several materials gather of vectors.
fn vectors_of_materials(
    vectors: Vec<Option<(VectorKernels, [String; 2])>>,
    thickness: f64,
) -> VectorLaws {
    let mut arguments: [String; 2] = Default::default();
    for (_, own) in vectors.iter().flatten() {
        add_arguments(&mut arguments, own);
    }
    let of_law = vectors.into_iter().map(|law| law.map(|(kernels, _)| kernels)).collect();
    VectorLaws { of_law, thickness, arguments }
}

/// A law per volume as one per volume of points: per area in two dimensions.
fn thick(law: impl VariablesLaw + 'static, thickness: f64) -> Box<dyn VariablesLaw> {
    if thickness == 1.0 { Box::new(law) } else { Box::new(Thick { law, thickness }) }
}

/// The energies of gathered states of a body of this thickness.
pub(crate) fn state_laws(
    kernels: GatheredKernels,
    arguments: [String; 2],
    thickness: f64,
) -> StateLaws {
    StateLaws {
        integrals: kernels.integrals.into_iter().map(|g| Box::new(g) as Box<dyn Law>).collect(),
        of_law: Vec::new(),
        points: kernels.points.map(|law| thick(law, thickness)),
        bonds: kernels.bonds.map(|law| thick(law, thickness)),
        arguments,
    }
}

/// Of the material's volume as of the points': per area in two dimensions.
fn discretisation(of_material: Discretisation, thickness: f64) -> Discretisation {
    match of_material {
        Discretisation::Stabilised(Stabilisation::Silling { stiffness }) => {
            Discretisation::Stabilised(Stabilisation::Silling { stiffness: stiffness * thickness })
        }
        other => other,
    }
}

fn influence(choice: &InfluenceChoice, dimension: usize, horizon: f64) -> Box<dyn Influence> {
    match choice {
        InfluenceChoice::Named(NamedInfluence::CubicSpline) => {
            Box::new(CubicSpline { dimension, horizon })
        }
        InfluenceChoice::Named(NamedInfluence::Constant) => Box::new(Constant),
        InfluenceChoice::Named(NamedInfluence::Inverse) => Box::new(InverseLength),
        InfluenceChoice::Expression(expression) => {
            let expression = expression.clone();
            Box::new(move |length: f64| expression.influence(length, horizon))
        }
    }
}
