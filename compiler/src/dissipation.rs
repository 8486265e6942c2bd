//! What bonds dissipate, compiled: a potential R of how fast a bond's length changes.
//!
//! Before: `dissipation(l) = R`, a function of `rate(l)`, `l` and `L`. After: R, the force `R'` and the
//! viscosity `R''`, exact derivatives by the rate, as a kernel like that of an energy: the rate stands in the
//! place of the measure, and the length is one more field, behind those of the values.

use crate::breaking::{BondFunction, BondFunctionKind};
use crate::expression::{ExprGraph, Input, Node, NodeId, Operator, TooManyNodes};
use crate::kernel::{Kernel, Mode, WrittenEnergy};
use crate::measure::Measure;
use crate::model::{Model, Variant};
use crate::specialise::{CompileError, Form, Named, ScalarEnergy, of_measure, symbolic_of};
use crate::values::Values;

/// The rate, where it is the variable.
const RATE: Input = Input::Current(Measure::Length);

impl Values {
    /// A length of bonds in m: half of the horizon, or of 1 m where there is none.
    pub(crate) fn typical_length(&self) -> f64 {
        0.5 * Some(self.horizon).filter(|horizon| horizon.is_finite()).unwrap_or(1.0)
    }

    /// The same with states and, behind all fields, the length of the bond among them.
    fn with_length(self, model: &Model, length: f64) -> Values {
        let number = model.number_of_length();
        let mut values = self.with_states(model).with_field(number);
        values.parameters.resize(usize::from(number), 0.0);
        values.parameters.push(length);
        values
    }
}

impl Model {
    /// What bonds dissipate: the sum of all `dissipation(l)` for these values, as a kernel. It takes the rate
    /// of the length in m/s in the place of the measure, `L` in m, `(rate - L)/L` as the change, and where it
    /// takes fields those of the values [with states](Values::with_states) and the length in m behind them.
    /// It gives R in W/m^(2d), R' in W s/m^(2d+1), R'' in W s^2/m^(2d+2). Nothing where nothing is dissipated.
    ///
    /// # Errors
    /// A potential that is too large, or the horizon where none is given.
    pub fn dissipation(&self, values: &Values, mode: Mode) -> Result<Option<Kernel>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let Some(named) = named(variant) else { return Ok(None) };
        let (graph, root) = named.made(self.by_rate(variant))?;
        named.has_horizon(&graph, &[root], values.horizon.is_nan())?;
        let values = self.at_typical_length(values);
        let subject = (Measure::Length, root);
        let made = of_measure(&graph, self.parameters(), subject, &values, Form::Textbook);
        let made = named.made(made)?;
        named.fits(&made.graph)?;
        let written = || WrittenEnergy::of_root(&graph, root, &values);
        let kernel = Kernel::new(made, (mode, Form::Textbook), written)?;
        Ok((!kernel.is_constant()).then_some(kernel))
    }

    /// The same as written at one length in m, as a function of the rate and `L`.
    pub fn written_dissipation(&self, values: &Values, length: f64) -> Option<WrittenEnergy> {
        let variant = self.variant(values.dimension)?;
        named(variant)?;
        let (graph, root) = self.by_rate(variant).ok()?;
        let values = values.clone().with_length(self, length);
        Some(WrittenEnergy::of_root(&graph, root, &values))
    }

    /// The same for those who print it, with symbols for parameters where there are no values.
    pub(crate) fn dissipation_function(
        &self,
        variant: &Variant,
        values: Option<&Values>,
    ) -> Result<Option<BondFunction>, CompileError> {
        let Some(named) = named(variant) else { return Ok(None) };
        let (graph, root) = named.made(self.by_rate(variant))?;
        let (subject, parameters) = ((Measure::Length, root), self.parameters());
        let made = match values.map(|values| self.at_typical_length(values)) {
            Some(values) => of_measure(&graph, parameters, subject, &values, Form::Textbook),
            None => symbolic_of(&graph, parameters, subject),
        };
        let function = named.made(made.and_then(|made| self.as_written(made)))?;
        let texts: Vec<&str> = variant.dissipations.iter().map(|one| one.text.as_str()).collect();
        let (kind, text) = (BondFunctionKind::Dissipation, texts.join(" + "));
        Ok(Some(BondFunction { kind, text, function }))
    }

    fn at_typical_length(&self, values: &Values) -> Values {
        values.clone().with_length(self, values.typical_length())
    }

    /// The sum of all dissipations with the rate as the variable, and the length as a parameter.
    fn by_rate(&self, variant: &Variant) -> Result<(ExprGraph, NodeId), TooManyNodes> {
        let roots: Vec<NodeId> = variant.dissipations.iter().map(|one| one.root).collect();
        let length = Input::Parameter(self.number_of_length());
        let renamed = |_: &mut ExprGraph, input| match input {
            Input::Rate => Ok(Node::Input(RATE)),
            Input::Current(Measure::Length) => Ok(Node::Input(length)),
            other => Ok(Node::Input(other)),
        };
        let (mut graph, roots) = renaming(&variant.graph, &roots, renamed)?;
        let sum =
            |sum: NodeId, root: &NodeId| graph.intern(Node::Binary(Operator::Add, sum, *root));
        let root = roots[1..].iter().try_fold(roots[0], sum)?;
        Ok((graph, root))
    }

    /// The same function with the rate and the length under their names.
    fn as_written(&self, by_rate: ScalarEnergy) -> Result<ScalarEnergy, TooManyNodes> {
        let number = self.number_of_length();
        let named = |graph: &mut ExprGraph, input| match input {
            RATE => Ok(Node::Input(Input::Rate)),
            Input::Parameter(own) if own == number => Ok(Node::Input(RATE)),
            Input::Change(measure) => {
                let rate = graph.intern(Node::Input(Input::Rate))?;
                let reference = graph.intern(Node::Input(Input::Reference(measure)))?;
                let one = graph.intern(Node::number(1.0))?;
                let over = graph.intern(Node::Binary(Operator::Divide, rate, reference))?;
                Ok(Node::Binary(Operator::Subtract, over, one))
            }
            other => Ok(Node::Input(other)),
        };
        let (graph, roots) = renaming(&by_rate.graph, &by_rate.roots, named)?;
        let mut fields = by_rate.fields;
        fields.retain(|(own, _)| *own != number);
        let depends = |own: &(u16, f64)| graph.depends_on(&roots, Input::Parameter(own.0));
        if !fields.iter().any(depends) {
            fields.clear();
        }
        let roots = [roots[0], roots[1], roots[2]];
        Ok(ScalarEnergy { measure: by_rate.measure, graph, roots, fields })
    }
}

/// As errors name it; nothing where nothing is dissipated.
fn named(variant: &Variant) -> Option<Named<'static>> {
    let first = variant.dissipations.first()?;
    Some(Named { argument: Measure::Length.symbol(), span: first.span })
}

/// Some roots in a graph of their own, with other nodes in the place of inputs.
fn renaming(
    source: &ExprGraph,
    roots: &[NodeId],
    mut instead: impl FnMut(&mut ExprGraph, Input) -> Result<Node, TooManyNodes>,
) -> Result<(ExprGraph, Vec<NodeId>), TooManyNodes> {
    let (source, roots) = source.extract(roots);
    let mut graph = ExprGraph::new();
    let mut place: Vec<NodeId> = Vec::with_capacity(source.len());
    for (_, node) in source.nodes() {
        let node = match node {
            Node::Input(input) => instead(&mut graph, input)?,
            other => other.map_operands(|x| place[x.0 as usize]),
        };
        place.push(graph.intern(node)?);
    }
    Ok((graph, roots.iter().map(|root| place[root.0 as usize]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Batch, Level};
    use crate::test_support::{codes, model, values};

    /// R, R' and R'' at a rate, a length and a length at rest.
    fn at(model: &Model, [rate, length, reference]: [f64; 3], mode: Mode) -> [f64; 3] {
        let kernel = model.dissipation(&values(model, 3, &[]), mode).unwrap().unwrap();
        let fields: Vec<f64> = if kernel.fields().is_empty() { vec![] } else { vec![length] };
        let change = [(rate - reference) / reference];
        let batch =
            Batch { measure: &[rate], reference: &[reference], change: &change, fields: &fields };
        let found = kernel.derivatives(batch);
        [found.psi[0], found.dpsi[0], found.d2psi[0]]
    }

    #[test]
    fn force_and_viscosity_are_derivatives_by_the_rate() {
        let dashpot = model(
            "potential p\nparameter eta = 3\npsi(l) = (l/L - 1)^2\ndissipation(l) = 1/2*eta*rate(l)^2",
        );
        let of_strain = model(
            "potential p\npsi(l) = (l/L - 1)^2\nw = rate(l)/L\ndissipation(l) = 1/2*l*w^2\n\
             dissipation(l) = (w - 1)^2",
        );
        for mode in [Mode::Jit(Level::Strict), Mode::Interpreter, Mode::HyperDual] {
            assert_eq!(at(&dashpot, [-2.0, 1.5, 1.0], mode), [6.0, -6.0, 3.0]);
            // w = 2: 1/2*3*4 + 1, (3*2 + 2)/L, (3 + 2)/L^2.
            assert_eq!(at(&of_strain, [4.0, 3.0, 2.0], mode), [7.0, 4.0, 1.25]);
        }
    }

    #[test]
    fn what_is_no_dissipation_of_bonds_is_refused() {
        let with = |line: &str| {
            codes(&format!("potential p\nparameter k = 1\npsi(l) = (l/L - 1)^2\n{line}\n"))
        };
        assert!(with("dissipation(l) = k*rate(l)^2").is_empty());
        for (line, code) in [
            ("dissipation(a) = k*rate(l)^2", "unknown-measure"),
            ("dissipation(F) = k*rate(l)^2", "unknown-measure"),
            ("dissipation(l) = k*(l/L - 1)^2", "wrong-measure"),
            ("dissipation(l) = k*rate(a)^2", "wrong-measure"),
            ("dissipation(l) = k*rate(l/L)^2", "wrong-measure"),
            ("dissipation(l) = k*rate(l)^2*a/A", "wrong-measure"),
            ("theta = integral(l)\ndissipation(l) = theta*rate(l)^2", "wrong-measure"),
            ("theta = integral(rate(l))\npsi(theta) = theta^2", "wrong-measure"),
            ("psi(l) = rate(l)^2", "wrong-measure"),
            ("psi(a) = a*rate(l)^2", "wrong-measure"),
            ("break when rate(l) > 1", "wrong-measure"),
            ("domain rate(l)*l in (0, 1)", "wrong-measure"),
            ("state h = 0\nupdate h = rate(l)", "wrong-measure"),
            ("dissipation(l) = rate", "function-without-arguments"),
            ("dissipation(l) = rate(l, L)", "wrong-number-of-arguments"),
            ("dissipation = 3", "reserved-name"),
            ("parameter rate = 1\ndissipation(l) = rate(l)^2", "not-a-function"),
            ("parameter m = 1, rate(l) > 0", "wrong-measure"),
        ] {
            assert_eq!(with(line), [code], "{line}");
        }
    }

    #[test]
    fn its_unit_is_that_of_the_energy_per_second() {
        let with = |unit: &str, body: &str| {
            codes(&format!(
                "potential p\nparameter C = 1 in J/m^(2*d + 1)\nparameter eta = 1 in {unit}\n\
                 psi(l) = C*L*(l/L - 1)^2\ndissipation(l) = {body}\n"
            ))
        };
        assert!(with("W*s^2/m^(2*d + 2)", "1/2*eta*rate(l)^2").is_empty());
        assert!(with("s", "1/2*eta*C*L*(rate(l)/L)^2").is_empty());
        assert_eq!(with("W/m^(2*d + 2)", "1/2*eta*rate(l)^2"), ["dimension-mismatch"]);
        assert_eq!(with("s", "1/2*eta*C*rate(l)^2"), ["dimension-mismatch"]);
    }
}
