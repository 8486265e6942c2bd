//! Energies exactly as written: not simplified, parameters not folded. Independent of everything that
//! happens after the check, and so the witness for it.

use num_dual::HyperDual64;

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Input, NodeId, Operator};
use crate::values::Values;

/// The sum of some energies, of whatever they are functions of.
#[derive(Clone, Debug)]
pub(crate) struct Written {
    graph: ExprGraph,
    roots: Vec<NodeId>,
    values: Values,
}

impl Written {
    /// The sum of these roots; 0 if there are none.
    pub(crate) fn new(graph: &ExprGraph, roots: &[NodeId], values: &Values) -> Written {
        let (graph, roots) = graph.extract(roots);
        Written { graph, roots, values: values.clone() }
    }

    /// The same where the potential is not defined in the dimension of the values.
    pub(crate) fn nothing(values: &Values) -> Written {
        Written { graph: ExprGraph::new(), roots: Vec::new(), values: values.clone() }
    }

    /// Typical values of fields.
    pub(crate) fn fields(&self) -> Vec<f64> {
        self.values.typical().map(|(_, value)| value).collect()
    }

    /// 2 or 3.
    pub(crate) fn dimension(&self) -> usize {
        self.values.dimension
    }

    /// The energy over any number type, from its inputs.
    pub(crate) fn sum<N: Number>(&self, input: impl Fn(Input) -> N) -> N {
        let terms = self.terms(input).into_iter();
        terms.reduce(|sum, term| N::binary(Operator::Add, sum, term)).unwrap_or(N::constant(0.0))
    }

    /// The energies one by one.
    pub(crate) fn terms<N: Number>(&self, input: impl Fn(Input) -> N) -> Vec<N> {
        let mut interpreter = Interpreter::new();
        interpreter.run(&self.graph, input);
        self.roots.iter().map(|root| interpreter.number(*root)).collect()
    }

    /// Inputs that are no variables: the checker makes no others but parameters and the horizon. Fields
    /// have the values given by their places among them, or typical ones.
    pub(crate) fn known<N: Number>(
        &self,
        input: Input,
        field: Option<&impl Fn(usize) -> f64>,
    ) -> N {
        N::constant(match input {
            Input::Parameter(i) => {
                let place = self.values.fields.iter().position(|own| *own == i);
                let given = field.zip(place).map(|(field, k)| field(k));
                given.unwrap_or(self.values.parameters[usize::from(i)])
            }
            Input::Horizon => self.values.horizon,
            _ => f64::NAN,
        })
    }
}

/// Variables of `n` places, variable by variable, and psi of place `p` as a function of them.
pub(crate) struct Dual<'a, P> {
    pub(crate) n: usize,
    pub(crate) variables: &'a [f64],
    pub(crate) psi: P,
}

impl<P: Fn(usize, &dyn Fn(usize) -> HyperDual64) -> HyperDual64> Dual<'_, P> {
    /// psi and, unless it is empty, its gradient.
    pub(crate) fn evaluate(&self, psi: &mut [f64], gradient: &mut [f64]) {
        if gradient.is_empty() {
            let at = |p: usize, k: usize| self.variables[k * self.n + p];
            for (p, psi) in psi.iter_mut().enumerate() {
                *psi = (self.psi)(p, &|k| HyperDual64::from_re(at(p, k))).re;
            }
            return;
        }
        self.every_place(None, |p, k, value| {
            psi[p] = value.re;
            gradient[k * self.n + p] = value.eps1;
        });
    }

    /// What the gradient changes by in a direction.
    pub(crate) fn product(&self, direction: &[f64], product: &mut [f64]) {
        self.every_place(Some(direction), |p, k, value| product[k * self.n + p] = value.eps1eps2);
    }

    /// One evaluation for each variable at each place: the first part varies the variable, the second
    /// goes along the direction.
    fn every_place(
        &self,
        direction: Option<&[f64]>,
        mut take: impl FnMut(usize, usize, HyperDual64),
    ) {
        let n_variables = self.variables.len() / self.n.max(1);
        for p in 0..self.n {
            for varied in 0..n_variables {
                let variable = |k: usize| {
                    let along = direction.map_or(0.0, |direction| direction[k * self.n + p]);
                    let own = f64::from(u8::from(k == varied));
                    HyperDual64::new(self.variables[k * self.n + p], own, along, 0.0)
                };
                take(p, varied, (self.psi)(p, &variable));
            }
        }
    }
}
