//! Energies whose force is affine in the measure: psi is a polynomial of second degree in it.
//!
//! Such an energy is known from three numbers at rest, `psi`, `psi'` and `psi''`. Passes over many
//! interactions may then work it out where they stand, without a kernel.

use crate::density::DensityForm;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::specialise::ScalarEnergy;

impl ScalarEnergy {
    /// Whether psi is a polynomial of at most second degree in the measure, as it stands: no condition,
    /// no function and no quotient holds the measure.
    pub(crate) fn is_affine(&self) -> bool {
        let degrees = degrees(&self.graph);
        let degree = |root: usize| degrees[self.roots[root].0 as usize];
        (0..3).all(|root| degree(root).is_some_and(|degree| degree as usize + root <= 2))
    }
}

impl ScalarEnergy {
    /// Whether psi and its derivatives are multiples of the only field.
    pub(crate) fn is_multiple_of_field(&self) -> bool {
        let [(field, _)] = self.fields[..] else { return false };
        let degrees = degrees_in(&self.graph, Input::Parameter(field));
        let is_zero = |root: NodeId| self.graph.as_number(root) == Some(0.0);
        self.roots.iter().all(|root| degrees[root.0 as usize] == Some(1) || is_zero(*root))
    }
}

/// Of each node the degree to which it is a homogeneous function of an input; nothing where it is none,
/// or of another degree than 0 or 1.
fn degrees_in(graph: &ExprGraph, input: Input) -> Vec<Option<u8>> {
    let mut degrees: Vec<Option<u8>> = Vec::with_capacity(graph.len());
    for (_, node) in graph.nodes() {
        let of = |id: NodeId| degrees[id.0 as usize];
        let degree = match node {
            Node::Input(found) => Some(u8::from(found == input)),
            Node::Unary(Function::Negate, x) => of(x),
            Node::Binary(Operator::Add | Operator::Subtract, x, y) => {
                of(x).filter(|_| of(x) == of(y))
            }
            Node::Binary(Operator::Multiply, x, y) => of(x).zip(of(y)).map(|(x, y)| x + y),
            Node::Binary(Operator::Divide, x, y) if of(y) == Some(0) => of(x),
            _ => node.operands().all(|x| of(x) == Some(0)).then_some(0),
        };
        degrees.push(degree.filter(|degree| *degree <= 1));
    }
    degrees
}

impl DensityForm {
    /// The integrals that psi of a bond holds besides the length, where it is a polynomial of at most
    /// second degree in that.
    pub(crate) fn affine_beside(&self) -> Option<Vec<u8>> {
        let (graph, roots) = self.graph.extract(&[self.psi]);
        degrees(&graph)[roots[0].0 as usize]?;
        let integral = |node: Node| match node {
            Node::Input(Input::Integral(k)) => Some(k),
            _ => None,
        };
        Some(graph.nodes().filter_map(|(_, node)| integral(node)).collect())
    }
}

/// The degree of each node as a polynomial in the measure; nothing where it is none, or a high one.
fn degrees(graph: &ExprGraph) -> Vec<Option<u8>> {
    const MOST: f64 = 2.0;
    let mut degrees: Vec<Option<u8>> = Vec::with_capacity(graph.len());
    for (_, node) in graph.nodes() {
        let of = |id: NodeId| degrees[id.0 as usize];
        let degree = match node {
            Node::Input(Input::Current(_) | Input::Change(_)) => Some(1),
            Node::Unary(Function::Negate, x) => of(x),
            Node::Binary(Operator::Add | Operator::Subtract, x, y) => {
                of(x).zip(of(y)).map(|(x, y)| x.max(y))
            }
            Node::Binary(Operator::Multiply, x, y) => of(x).zip(of(y)).map(|(x, y)| x + y),
            Node::Binary(Operator::Divide, x, y) if of(y) == Some(0) => of(x),
            Node::PowerConstant(x, power) if f64::from_bits(power) == MOST => {
                of(x).map(|degree| 2 * degree)
            }
            _ => node.operands().all(|x| of(x) == Some(0)).then_some(0),
        };
        degrees.push(degree.filter(|degree| f64::from(*degree) <= MOST));
    }
    degrees
}

#[cfg(test)]
mod tests {
    use crate::measure::Measure;
    use crate::specialise::Form;
    use crate::test_support::{model, values};

    /// Whether it is by the length, and by its square.
    fn is_affine(psi: &str) -> [Option<bool>; 2] {
        let model = model(&format!("potential p\npsi(l) = {psi}"));
        let values = values(&model, 3, &[]);
        let by_length = model.specialise_as(&values, Form::Accurate).unwrap();
        let by_square = model.squared(&values, Measure::Length);
        [Some(by_length.energies[0].is_affine()), by_square.map(|energy| energy.is_affine())]
    }

    #[test]
    fn polynomials_of_second_degree_are() {
        assert_eq!(is_affine("1/2*L*(l/L - 1)^2"), [Some(true), None]);
        assert_eq!(is_affine("(l - L)^2/L + 3*l"), [Some(true), None]);
        assert_eq!(is_affine("1/2*L*(((l/L)^2 - 1)/2)^2"), [Some(false), Some(true)]);
        assert_eq!(is_affine("exp(-L/delta)*(l^2 - L^2)^2/L^3 + l^2/L"), [Some(false), Some(true)]);
    }

    #[test]
    fn energies_of_bonds_are_affine_beside_the_integrals_they_hold() {
        let beside = |psi: &str| {
            let integrals = "m = integral(L^2)\ns = integral(l*L)/m";
            let model = model(&format!("potential p\n{integrals}\npsi(l, m, s) = {psi}"));
            let values = values(&model, 3, &[]);
            let (form, _) = model.specialise_gathered(&values, true, Form::Accurate).unwrap();
            form.unwrap().affine_beside()
        };
        assert_eq!(beside("(l - L)^2/m"), Some(vec![0]));
        assert_eq!(beside("m*L*(l - L)"), Some(vec![0]));
        assert_eq!(beside("(l - L)^2*ln(s) + l*L").map(|held| held.len()), Some(2));
        assert_eq!(beside("m*(l - L)^3"), None);
        assert_eq!(beside("m*ln(l/L)"), None);
    }

    /// A law may have the same second derivative everywhere and no affine force: where it has a kink.
    #[test]
    fn kinks_conditions_and_functions_are_not() {
        for psi in [
            "abs(l - L)",
            "max(l, L)",
            "if l > L then l - L else 0",
            "if l > L then (l - L)^2 else (l - L)^2 + L*(l - L)",
            "L*(l/L - 1)^3",
            "L*ln(l/L)^2",
            "L^2/l",
            "L*sin(l/L)",
        ] {
            assert_eq!(is_affine(psi)[0], Some(false), "{psi}");
        }
    }
}
