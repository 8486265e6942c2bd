//! Energies of gathered states: integrals `I_k = sum_j V_j g_k(l_ij, L_ij)` over the family of a
//! point, and energies of points `psi(I)` and of bonds `phi(l, I)`.
//!
//! Before: a model with values. After: the integrands with two derivatives by the length; `psi` and
//! `phi` with their gradients by all their variables, and with what these change by in a direction;
//! each as machine code over arrays.

pub(crate) mod family;
pub(crate) mod forms;
mod functions;
mod kernel;
mod near;
mod vector_functions;
pub(crate) mod vectors;

pub use family::{FamilyBatch, FamilyKernel, Slot, WrittenFamily};
pub use forms::{GatheredForms, GatheredFunction, GatheredFunctionKind};
pub use functions::{GatheredCriterion, GatheredNextState};
pub use kernel::{GatheredBatch, GatheredKernel, WrittenGatheredEnergy};
pub use vector_functions::{VectorCriterion, VectorNextState};
pub use vectors::VectorKernels;

use crate::clique::Part;
use crate::density::DensityForm;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::kernel::{Kernel, Mode, WrittenEnergy};
use crate::measure::Measure;
use crate::model::{GatheredEnergy, Integral, Model, Variant};
use crate::near::vanishes_at_rest;
use crate::point::adjoint::{self, Varied};
use crate::point::near::near_of_vanishing;
use crate::rewrite::{expand, rewrite};
use crate::simplify::Simplifier;
use crate::specialise::{
    CompileError, Dropped, Form, Known, Named, ScalarEnergy, folded, of_measure, or_zero, sum_in,
};
use crate::values::Values;
use crate::written::Written;

/// All that a potential gathers and the energies of it, compiled.
#[derive(Debug, Default)]
pub struct GatheredKernels {
    /// The integrands, functions of the length of a bond.
    pub integrals: Vec<Kernel>,
    /// What functions they are: equal ones have the same bits.
    pub functions: Vec<Integrand>,
    /// The energy of points in J/m^3.
    pub points: Option<GatheredKernel>,
    /// The energy of bonds in J/m^(2d).
    pub bonds: Option<GatheredKernel>,
}

/// The function that an integrand is, to compare with others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Integrand {
    nodes: Vec<Node>,
    roots: [NodeId; 3],
    has_fields: bool,
}

impl Integrand {
    fn new(energy: &ScalarEnergy) -> Integrand {
        let nodes = energy.graph.nodes().map(|(_, node)| node).collect();
        Integrand { nodes, roots: energy.roots, has_fields: !energy.fields.is_empty() }
    }

    /// Whether another potential may gather the same: what depends on fields of its own may not.
    pub fn is_shared(&self) -> bool {
        !self.has_fields
    }
}

/// psi, its gradient and its product in one graph. Variables are the length of the bond, for energies of
/// bonds, then the integrals. In the accurate form the integrals that are 0 at rest are known.
fn form(
    exact: &Simplifier,
    written: NodeId,
    (of_bonds, n_integrals): (bool, usize),
    vanishing: Option<&[Input]>,
    fields: &[u16],
) -> Result<DensityForm, TooManyNodes> {
    let (mut graph, place) = folded(exact.graph(), &[written])?;
    let mut psi = place[written.0 as usize];
    let varied = match of_bonds {
        true => Varied::LengthAndIntegrals(n_integrals),
        false => Varied::Integrals(n_integrals),
    };
    let accurate = of_bonds && vanishing.is_some();
    let length = Measure::Length;
    let mut applied = Vec::new();
    if accurate {
        psi = rewrite(&mut graph, psi, length, &mut applied)?;
    }
    let mut gradient = adjoint::gradient(&mut graph, psi, varied)?;
    if accurate {
        for root in &mut gradient {
            *root = rewrite(&mut graph, *root, length, &mut applied)?;
        }
    }
    let product = adjoint::product(&mut graph, &gradient, varied)?;
    let mut roots = vec![psi];
    roots.extend(gradient);
    roots.extend(product);
    if accurate {
        roots = expand(&mut graph, &roots, length, &mut applied)?;
    }
    if let Some(vanishing) = vanishing {
        let kind = (of_bonds, n_integrals);
        roots = near::kept(&mut graph, (exact, written), roots, kind, vanishing)?;
    }
    let (graph, roots) = graph.graph().extract(&roots);
    Ok(DensityForm::new(graph, &roots, kernel::inputs(of_bonds, n_integrals), fields))
}

/// Whether each term of an integrand has a component of `xi - Xi` as its factor.
fn is_nothing(graph: &ExprGraph, integral: &Integral) -> bool {
    let mut nothing: Vec<bool> = Vec::with_capacity(graph.len());
    for (_, node) in graph.nodes() {
        let of = |x: NodeId| nothing[x.0 as usize];
        nothing.push(match node {
            Node::Input(Input::Part(Part::Moved(_))) => true,
            Node::Unary(Function::Negate, x) => of(x),
            Node::Binary(Operator::Multiply, x, y) => of(x) || of(y),
            Node::Binary(Operator::Divide, x, _) => of(x),
            Node::Binary(Operator::Add | Operator::Subtract, x, y) => of(x) && of(y),
            _ => false,
        });
    }
    nothing[integral.root.0 as usize]
}

/// Functions of gathered values, and of lengths or not, that are added up.
#[derive(Clone, Copy)]
struct Subject<'a> {
    variant: &'a Variant,
    of_bonds: bool,
    roots: &'a [NodeId],
    /// Whether there is one also where parameters leave nothing of it: 0.
    is_kept: bool,
}

/// The energies of points or of bonds.
fn energies(variant: &Variant, of_bonds: bool) -> impl Iterator<Item = &GatheredEnergy> {
    variant.gathered_energies.iter().filter(move |energy| energy.of_bonds == of_bonds)
}

/// What the energies are functions of, as written: `theta`, `l, m`.
pub(crate) fn argument(variant: &Variant, of_bonds: bool) -> String {
    let mut heads: Vec<&str> = Vec::new();
    for energy in energies(variant, of_bonds) {
        if !heads.contains(&energy.head.as_str()) {
            heads.push(&energy.head);
        }
    }
    heads.join("), psi(")
}

impl Model {
    /// The energies of points, or of bonds, for these values, if something is left of them; and what is
    /// left out.
    ///
    /// # Errors
    /// As for [`Model::specialise`].
    pub fn specialise_gathered(
        &self,
        values: &Values,
        of_bonds: bool,
        which: Form,
    ) -> Result<(Option<DensityForm>, Vec<Dropped>), CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        self.energies_of_gathered((variant, of_bonds), Known(Some(values)), which)
    }

    /// The same of a variant, with parameters as symbols where there are no values.
    fn energies_of_gathered(
        &self,
        (variant, of_bonds): (&Variant, bool),
        known: Known<'_>,
        which: Form,
    ) -> Result<(Option<DensityForm>, Vec<Dropped>), CompileError> {
        let roots: Vec<NodeId> = energies(variant, of_bonds).map(|energy| energy.root).collect();
        let Some(first) = energies(variant, of_bonds).next() else { return Ok((None, Vec::new())) };
        let argument = argument(variant, of_bonds);
        let named = Named { argument: &argument, span: first.span };
        let subject = Subject { variant, of_bonds, roots: &roots, is_kept: false };
        self.gathered_form(subject, named, known, which)
    }

    /// The sum of some functions of gathered values, and of lengths or not.
    fn gathered_form(
        &self,
        Subject { variant, of_bonds, roots, is_kept }: Subject<'_>,
        named: Named<'_>,
        known: Known<'_>,
        which: Form,
    ) -> Result<(Option<DensityForm>, Vec<Dropped>), CompileError> {
        named.has_horizon(&variant.graph, roots, known.lacks_horizon())?;
        let kind = (of_bonds, variant.integrals.len());
        let mut dropped = Vec::new();
        let fold = known.fold();
        let vanishing = match which {
            Form::Accurate => Some(named.made(self.vanishing(variant, &fold))?),
            Form::Textbook => None,
        };
        let (exact, subject) = (Simplifier::exact(), (named.argument, roots));
        let made = sum_in(exact, &variant.graph, &self.parameters, subject, &fold, &mut dropped)
            .and_then(|energy| {
                let fields = known.fields();
                let made = |(graph, psi)| form(&graph, psi, kind, vanishing.as_deref(), fields);
                let energy = if is_kept { Some(or_zero(energy)?) } else { energy };
                energy.map(made).transpose()
            });
        let made = named.made(made)?;
        made.as_ref().map_or(Ok(()), |made| named.fits(&made.graph))?;
        Ok((made, dropped))
    }

    /// The integrals that are 0 at rest because their integrands are.
    fn vanishing(
        &self,
        variant: &Variant,
        fold: &impl Fn(Input) -> Option<f64>,
    ) -> Result<Vec<Input>, TooManyNodes> {
        let mut found = Vec::new();
        for (k, integral) in variant.integrals.iter().enumerate() {
            if integral.is_function {
                let (graph, root) = (&variant.graph, integral.root);
                let mut unused = Simplifier::new();
                let (_, vanishes) = near_of_vanishing(&mut unused, graph, root, &found)?;
                found.extend(vanishes.then_some(Input::Integral(k as u8)));
                continue;
            }
            if is_nothing(&variant.graph, integral) {
                found.push(Input::Integral(k as u8));
                continue;
            }
            let (exact, subject) =
                (Simplifier::exact(), ("l", std::slice::from_ref(&integral.root)));
            let parameters = &self.parameters;
            let made = sum_in(exact, &variant.graph, parameters, subject, fold, &mut Vec::new())?;
            let vanishes = match made {
                Some((graph, root)) => vanishes_at_rest(graph.graph(), root, Measure::Length)?,
                None => true,
            };
            if vanishes {
                found.push(Input::Integral(k as u8));
            }
        }
        Ok(found)
    }

    /// Compiles the integrals and the energies of them, if something is left of these; gives back what
    /// is left out.
    pub(crate) fn compile_gathered(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
        gathered: &mut Option<GatheredKernels>,
    ) -> Result<Vec<Dropped>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let mut kernels = GatheredKernels::default();
        let mut all_dropped = Vec::new();
        for of_bonds in [false, true] {
            let (made, dropped) = self.specialise_gathered(values, of_bonds, form)?;
            all_dropped.extend(dropped);
            let Some(made) = made else { continue };
            let written = self.written_gathered(values, of_bonds);
            let kernel = GatheredKernel::new(made, (mode, form), written)?;
            *(if of_bonds { &mut kernels.bonds } else { &mut kernels.points }) = Some(kernel);
        }
        if kernels.points.is_none() && kernels.bonds.is_none() {
            return Ok(all_dropped);
        }
        for integral in &variant.integrals {
            let named = Named { argument: "l", span: integral.span };
            named.has_horizon(&variant.graph, &[integral.root], values.horizon.is_nan())?;
            let subject = (Measure::Length, integral.root);
            let made = of_measure(&variant.graph, &self.parameters, subject, values, form);
            let made = named.made(made)?;
            named.fits(&made.graph)?;
            kernels.functions.push(Integrand::new(&made));
            let written = || WrittenEnergy::of_root(&variant.graph, integral.root, values);
            kernels.integrals.push(Kernel::new(made, (mode, form), written)?);
        }
        *gathered = Some(kernels);
        Ok(all_dropped)
    }

    /// The energy of points, or of bonds, as written; 0 where there is none.
    pub fn written_gathered(&self, values: &Values, of_bonds: bool) -> WrittenGatheredEnergy {
        let Some(variant) = self.variant(values.dimension) else {
            let energy = Written::nothing(values);
            return WrittenGatheredEnergy { energy, of_bonds, n_integrals: 0 };
        };
        let roots: Vec<NodeId> = energies(variant, of_bonds).map(|e| e.root).collect();
        let energy = Written::new(&variant.graph, &roots, values);
        WrittenGatheredEnergy { energy, of_bonds, n_integrals: variant.integrals.len() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{model, values};

    /// Energies of bonds keep their digits near rest in their accurate form, and lose them in the form
    /// they were written in: `x^2 - 1` at `x = 1 + 1e-9` has an error of 1e-16 of 2e-9.
    #[test]
    fn accurate_forms_of_bonds_keep_the_digits_that_textbook_forms_lose() {
        let text = "potential p\ns = integral(l)\npsi(l, s) = ((l/L)^2 - 1)^2*s";
        let model = model(text);
        let values = values(&model, 3, &[]);
        let e = 1e-9;
        let (variables, change, reference) = ([1.0 + e, 3.0], [e], [1.0]);
        let at = GatheredBatch {
            n: 1,
            variables: &variables,
            change: &change,
            reference: &reference,
            fields: &[],
        };
        let strain = e * (2.0 + e);
        let expected = [3.0 * strain * strain, 3.0 * 4.0 * strain * (1.0 + e), strain * strain];
        let error = |form: Form| {
            let compiled = model.compile(&values, Mode::Interpreter, form).unwrap();
            let kernel = compiled.gathered.unwrap().bonds.unwrap();
            let (mut psi, mut gradient) = ([0.0], [0.0; 2]);
            kernel.evaluate(at, &mut psi, &mut gradient);
            let found = [psi[0], gradient[0], gradient[1]];
            let errors = found.iter().zip(&expected).map(|(x, y)| (x / y - 1.0).abs());
            errors.collect::<Vec<f64>>()
        };
        let (accurate, textbook) = (error(Form::Accurate), error(Form::Textbook));
        assert!(accurate.iter().all(|x| *x < 16.0 * f64::EPSILON), "{accurate:?}");
        assert!(textbook.iter().all(|x| *x > 1e-9 && *x < 1e-6), "{textbook:?}");
    }
}
