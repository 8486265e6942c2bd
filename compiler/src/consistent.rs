//! Interactions that remember, at load steps: energies at the states that they come to within the step.
//!
//! Before: psi, psi' and psi'' of a measure `m` with states `p` held, and what each state becomes, `P(m, p, dt)`.
//! After: psi and psi' at `p = P(m, p, dt)`, and the derivative of that psi' by the measure,
//! `psi'' + sum dpsi'/dp dP/dm`, the consistent tangent: what a bond, a triangle or a tetrahedron pulls with is
//! a function of its measure alone, so the tangent of the body stays symmetric whatever the update. A time step below 0 stands for states that
//! are held: then all three are what they were.

use crate::differentiate::derivative_by;
use crate::expression::{Comparison, Input, Node, NodeId, TooManyNodes};
use crate::measure::Measure;
use crate::model::{Model, Update};
use crate::simplify::Simplifier;
use crate::specialise::{
    CompileError, Form, Named, ScalarEnergy, folded, folded_into, of_measure, substituted_into,
};
use crate::values::Values;

impl Values {
    /// The same for load steps: with states and the time step in s among the fields, where the model has
    /// updates. Energies of measures then follow what comes to be remembered in that time, and hold what is
    /// remembered where the time step is below 0, as its typical value is.
    pub fn following_states(self, model: &Model) -> Values {
        let Some(dt) = model.number_of_time_step() else { return self };
        let mut values = self.with_states(model).with_field(dt);
        values.parameters[usize::from(dt)] = -1.0;
        values
    }

    /// Whether energies of measures follow what comes to be remembered.
    pub fn follow_states(&self, model: &Model) -> bool {
        model.number_of_time_step().is_some_and(|dt| self.fields.contains(&dt))
    }
}

impl Model {
    /// An energy of a measure at what its interactions come to remember, for values that
    /// [follow states](Values::following_states).
    pub(crate) fn consistent(
        &self,
        energy: &ScalarEnergy,
        values: &Values,
        form: Form,
    ) -> Result<ScalarEnergy, CompileError> {
        let depends =
            |state: usize| energy.graph.depends_on(&energy.roots, Input::Parameter(state as u16));
        let (Some(dt), Some(variant)) =
            (self.number_of_time_step(), self.variant(values.dimension))
        else {
            return Ok(energy.clone());
        };
        let measure = energy.measure;
        let own = || variant.updates.iter().filter(|update| update.of == measure);
        if !own().any(|update| depends(update.state)) {
            return Ok(energy.clone());
        }
        let next = |update: &Update<Measure>| {
            let subject = (measure, update.root);
            let named = Named { argument: measure.symbol(), span: update.span };
            let next = of_measure(&variant.graph, self.parameters(), subject, values, form);
            Ok(Next { state: update.state as u16, function: named.made(next)? })
        };
        let next = own().map(next).collect::<Result<Vec<Next>, CompileError>>()?;
        let span = variant.energies.iter().find(|one| one.measure == measure);
        let named = Named {
            argument: measure.symbol(),
            span: span.map_or(Default::default(), |one| one.span),
        };
        let made = named.made(composed(energy, &next, dt, values))?;
        named.fits(&made.graph)?;
        Ok(made)
    }
}

/// What a state becomes, with its derivative by the measure.
struct Next {
    state: u16,
    function: ScalarEnergy,
}

/// The energy with the next states in the place of the states.
fn composed(
    energy: &ScalarEnergy,
    next: &[Next],
    dt: u16,
    values: &Values,
) -> Result<ScalarEnergy, TooManyNodes> {
    // With states held: psi, psi', psi'', then the derivative of psi' by each state.
    let (mut held, place) = folded(&energy.graph, &energy.roots)?;
    let mut roots: Vec<NodeId> = energy.roots.iter().map(|root| place[root.0 as usize]).collect();
    for Next { state, .. } in next {
        let by_state = |graph: &mut Simplifier, input| match input {
            Input::Parameter(number) if number == *state => graph.number(1.0).map(Some),
            _ => Ok(None),
        };
        let slope = roots[1];
        let derivative = derivative_by(&mut held, slope, &by_state)?;
        roots.push(derivative.map_or_else(|| held.number(0.0), Ok)?);
    }
    let mut graph = Simplifier::new();
    let zero = graph.number(0.0)?;
    let step = graph.input(Input::Parameter(dt))?;
    let follows = graph.make(Node::Compare(Comparison::GreaterEqual, step, zero))?;
    let (mut states, mut rates) = (Vec::new(), Vec::new());
    for Next { state, function } in next {
        let [value, rate, _] = function.roots;
        let place = folded_into(&mut graph, &function.graph, &[value, rate])?;
        let now = graph.input(Input::Parameter(*state))?;
        let next = graph.make(Node::Select(follows, place[value.0 as usize], now))?;
        states.push((*state, next));
        rates.push(place[rate.0 as usize]);
    }
    let of_state = |input| match input {
        Input::Parameter(number) => states.iter().find(|one| one.0 == number).map(|one| one.1),
        _ => None,
    };
    let place = substituted_into(&mut graph, held.graph(), &roots, of_state)?;
    let roots: Vec<NodeId> = roots.iter().map(|root| place[root.0 as usize]).collect();
    let mut curvature = roots[2];
    for (mixed, rate) in roots[3..].iter().zip(rates) {
        let product = graph.multiply(*mixed, rate)?;
        curvature = graph.add(curvature, product)?;
    }
    let curvature = graph.make(Node::Select(follows, curvature, roots[2]))?;
    let (graph, roots) = graph.graph().extract(&[roots[0], roots[1], curvature]);
    let roots = [roots[0], roots[1], roots[2]];
    Ok(ScalarEnergy { measure: energy.measure, graph, roots, fields: values.typical().collect() })
}
