//! Energies of several measures of one interaction: of a triangle's area with its sides and angles, of a
//! tetrahedron's volume with its faces and edges.
//!
//! Before: a model with values. After: psi with its gradient by these measures, and what that changes by
//! in a direction; the geometry of each measure is the runtime's. Angles follow from sides and area, and
//! are no variables of their own.

pub(crate) mod form;
mod kernel;
mod sums;
#[cfg(test)]
mod tests;

pub use kernel::{CoupledBatch, CoupledKernel, WrittenCoupledEnergy};

use crate::clique::{Part, Variable};
use crate::density::DensityForm;
use crate::expression::{ExprGraph, Input, Node, NodeId};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::{CoupledEnergy, Model, Variant};
use crate::simplify::Simplifier;
use crate::specialise::{CompileError, Dropped, Form, Named, folded_into, known, sum_in};
use crate::values::Values;
use crate::written::Written;

/// Most variables: the volume, four faces and six edges of a tetrahedron.
pub const MAX_VARIABLES: usize = 11;

/// An energy of several measures with its derivatives, ready for machine code.
#[derive(Clone, Debug)]
pub struct CoupledForm {
    /// psi, its gradient and its product.
    pub density: DensityForm,
    /// What it is a function of: the measure of the whole first, if it is among them.
    pub variables: Vec<Variable>,
}

/// The energies of triangles, or of tetrahedra.
fn energies(variant: &Variant, clique: Measure) -> impl Iterator<Item = &CoupledEnergy> {
    variant.coupled_energies.iter().filter(move |energy| energy.clique == clique)
}

/// What the energies are functions of, as written: `a, l1, l2`; of several side by side, `a, l1) + psi(angle`.
pub(crate) fn argument(variant: &Variant, clique: Measure) -> String {
    let mut heads: Vec<&str> = Vec::new();
    for energy in energies(variant, clique) {
        if !heads.contains(&energy.head.as_str()) {
            heads.push(&energy.head);
        }
    }
    heads.join(") + psi(")
}

/// What some roots depend on: the measure of the whole, edges, faces. An angle stands for the area and the
/// sides that it follows from, the whole for nothing at all.
fn variables(graph: &ExprGraph, roots: &[NodeId], clique: Measure) -> Vec<Variable> {
    let needed = graph.reachable(roots);
    let (mut whole, mut parts) = (false, Vec::new());
    for (_, node) in graph.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        match node {
            Node::Input(Input::Part(Part::Angle(k)) | Input::PartAtRest(Part::Angle(k))) => {
                whole = true;
                parts.extend(Part::sides(k));
            }
            Node::Input(Input::Part(part) | Input::PartAtRest(part) | Input::PartChange(part)) => {
                parts.push(part);
            }
            Node::Input(Input::Current(_) | Input::Reference(_) | Input::Change(_)) => whole = true,
            _ => {}
        }
    }
    parts.sort_unstable();
    parts.dedup();
    let whole = (whole || parts.is_empty()).then(|| Variable::whole(clique));
    whole.into_iter().chain(parts.iter().filter_map(|part| Variable::of(*part, clique))).collect()
}

impl Model {
    /// The energies of several measures of triangles (`clique` is the area) or of tetrahedra (the volume)
    /// for these values, if something is left of them; and what is left out.
    ///
    /// # Errors
    /// As for [`Model::specialise`].
    pub fn specialise_coupled(
        &self,
        values: &Values,
        clique: Measure,
        which: Form,
    ) -> Result<(Option<CoupledForm>, Vec<Dropped>), CompileError> {
        let (fold, is_missing) = (known(values), values.horizon.is_nan());
        self.form_of(values.dimension, clique, (&fold, is_missing), (which, &values.fields))
    }

    /// The same with parameters left as symbols, as written.
    ///
    /// # Errors
    /// As for [`Model::specialise`].
    pub fn symbolic_coupled(
        &self,
        dimension: usize,
        clique: Measure,
    ) -> Result<Option<CoupledForm>, CompileError> {
        let nothing = (&|_| None, false);
        Ok(self.form_of(dimension, clique, nothing, (Form::Textbook, &[]))?.0)
    }

    fn form_of(
        &self,
        dimension: usize,
        clique: Measure,
        (fold, is_missing): (&impl Fn(Input) -> Option<f64>, bool),
        (which, fields): (Form, &[u16]),
    ) -> Result<(Option<CoupledForm>, Vec<Dropped>), CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let Some(first) = energies(variant, clique).next() else { return Ok((None, Vec::new())) };
        let argument = argument(variant, clique);
        if clique == Measure::Volume && dimension == 2 {
            let reason =
                format!("psi({argument}) is dropped: there are no tetrahedra in two dimensions");
            return Ok((None, vec![Dropped { argument, reason }]));
        }
        let named = Named { argument: &argument, span: first.span };
        let roots: Vec<NodeId> = energies(variant, clique).map(|energy| energy.root).collect();
        named.has_horizon(&variant.graph, &roots, is_missing)?;
        let (mut dropped, mut graph, mut psi) = (Vec::new(), Simplifier::new(), None);
        for energy in energies(variant, clique) {
            let subject = (energy.head.as_str(), energy.orders.as_slice());
            let (exact, parameters) = (Simplifier::exact(), &self.parameters);
            let sum = sum_in(exact, &variant.graph, parameters, subject, fold, &mut dropped);
            let Some((exact, root)) = named.made(sum)? else { continue };
            let added = (|| {
                let place = folded_into(&mut graph, exact.graph(), &[root])?;
                let n = graph.number(energy.orders.len() as f64)?;
                let mean = graph.divide(place[root.0 as usize], n)?;
                psi.map_or(Ok(mean), |sum| graph.add(sum, mean))
            })();
            psi = Some(named.made(added)?);
        }
        let Some(psi) = psi else { return Ok((None, dropped)) };
        let made = form::make(graph, psi, clique, which, fields);
        let made = named.made(made)?;
        named.fits(&made.density.graph)?;
        Ok((Some(made), dropped))
    }

    /// Compiles what is left of them; gives back what is left out.
    pub(crate) fn compile_coupled(
        &self,
        values: &Values,
        mode: Mode,
        which: Form,
        kernels: &mut Vec<CoupledKernel>,
    ) -> Result<Vec<Dropped>, CompileError> {
        let mut all_dropped = Vec::new();
        for clique in self.coupled() {
            let (made, dropped) = self.specialise_coupled(values, clique, which)?;
            all_dropped.extend(dropped);
            let Some(made) = made else { continue };
            let written = self.written_coupled(values, clique, &made.variables);
            kernels.push(CoupledKernel::new(made, (clique, mode), written)?);
        }
        Ok(all_dropped)
    }

    /// The energies of triangles or of tetrahedra as written, as functions of these variables; 0 where
    /// there are none.
    pub fn written_coupled(
        &self,
        values: &Values,
        clique: Measure,
        variables: &[Variable],
    ) -> WrittenCoupledEnergy {
        let variant = self.variant(values.dimension);
        let energy = match variant {
            Some(variant) => {
                let roots: Vec<NodeId> = energies(variant, clique).map(|e| e.root).collect();
                Written::new(&variant.graph, &roots, values)
            }
            None => Written::nothing(values),
        };
        let argument = variant.map_or_else(String::new, |variant| argument(variant, clique));
        WrittenCoupledEnergy { energy, argument, variables: variables.to_vec() }
    }
}
